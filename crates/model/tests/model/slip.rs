//! Slipping wheels: closed forms, the limit of rolling, rest, energy.

use appell_model::drive::Drive;
use appell_model::dynamics::{Dynamics, Held};
use appell_model::ground::Ground;
use appell_model::integrate::{Adaptive, RungeKutta4};
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{Body, Platform, WheelOutput, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::slip::{Implicit, Loads, Slip, SlipOutput};
use appell_model::tire::{Arcs, Curve, Friction, Onset, Tire};
use appell_model::wheel::{Rim, Steering, Wheel};

use crate::common::motor;

pub const TORQUE: Drive<f64> = Drive::Torque { torque_max: 1e3 };

fn wheel(name: &str, mount: [f64; 2], drive: Drive<f64>) -> Wheel<f64> {
    Wheel {
        name: name.into(),
        mount: vec2(mount[0], mount[1]),
        radius: 0.1,
        steering: Steering::Fixed { angle: 0.0 },
        rim: Rim::Plain,
        mass: 0.5,
        inertia_vertical: 2e-3,
        spin_inertia: 4e-3,
        viscous: 0.01,
        pivot_viscous: 0.0,
        dry_friction: 0.0,
        friction_rounding: 0.0,
        brake: 0.0,
        stiffness: 1.0,
        drive,
    }
}

pub fn four(drive: Drive<f64>) -> Vec<Wheel<f64>> {
    [(0.2, 0.25), (0.2, -0.25), (-0.2, 0.25), (-0.2, -0.25)]
        .iter()
        .map(|(x, y)| wheel(&format!("{x} {y}"), [*x, *y], drive))
        .collect()
}

pub fn platform(wheels: Vec<Wheel<f64>>) -> Platform<f64> {
    let body = Body {
        mass: 28.0,
        inertia_com: 1.4,
        center_of_mass: vec2(0.02, -0.01),
        com_height: 0.15,
    };
    Platform::new(body, wheels).expect("a platform")
}

pub fn brush(friction: f64, stiffness: f64) -> Tire<f64> {
    Tire::Slip {
        curve: Curve::Brush {
            friction,
            stiffness,
        },
        relaxation: 0.02,
        damping: 0.01,
    }
}

fn lugre(friction: f64) -> Tire<f64> {
    Tire::Lugre {
        friction: Friction::plain(friction),
        stiffness: 3e3,
        damping: 10.0,
        viscous: 0.0,
    }
}

fn coulomb(friction: f64, rounding: f64) -> Tire<f64> {
    Tire::Coulomb {
        friction: Friction::plain(friction),
        rounding,
    }
}

pub fn laws(friction: f64) -> [Tire<f64>; 5] {
    let slip = |curve| Tire::Slip {
        curve,
        relaxation: 0.02,
        damping: 0.01,
    };
    [
        coulomb(friction, 0.01),
        lugre(friction),
        brush(friction, 15.0),
        slip(Curve::Magic {
            friction,
            stiffness: 15.0,
            shape: 1.4,
            curvature: -0.2,
        }),
        slip(Curve::Linear {
            friction,
            stiffness: 15.0,
        }),
    ]
}

pub fn robot(wheels: Vec<Wheel<f64>>, tire: Tire<f64>, ground: Ground<f64>) -> Slip<f64> {
    let tires = vec![tire; wheels.len()];
    Slip::new(platform(wheels), tires, ground, Loads::Dynamic).expect("a robot")
}

pub fn at_rest(system: &Slip<f64>) -> Vec<f64> {
    let mut x = vec![0.0; system.layout().state()];
    system.platform().renew_angles(&mut x);
    system.rolling_state(&x, Vec2::zero(), 0.0)
}

fn outputs(system: &Slip<f64>, x: &[f64], u: &[f64], mode: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; system.sizes().output];
    system.output(x, u, mode, &mut y);
    y
}

/// The implicit method has order 2, against Tsitouras' pair.
#[test]
fn order_implicit() {
    let ground = Ground::plane(9.81, 0.1, 0.7);
    for (drive, volts) in [(TORQUE, [1.0, 2.5]), (motor(1e-2), [6.0, 9.0])] {
        for tire in [coulomb(0.7, 0.2), brush(0.7, 8.0)] {
            let system = robot(four(drive), tire, ground);
            let mut u = vec![0.0; system.sizes().input];
            u[..4].copy_from_slice(&[volts[0], volts[1], volts[0], volts[1]]);
            let start = system.rolling_state(&at_rest(&system), vec2(0.5, 0.0), 0.0);
            let end = 0.4;
            let mut exact = start.clone();
            let mut mode = vec![1.0; 4];
            let mut adaptive = Adaptive::new(&system, 1e-11, 1e-12);
            adaptive
                .advance(&system, &Held(&u), 0.0, end, &mut exact, &mut mode, None)
                .expect("smooth");
            let error = |count: u64| {
                let (mut x, mut mode) = (start.clone(), vec![1.0; 4]);
                let mut implicit = Implicit::new(&system);
                assert!(implicit.steps(&system, &u, end / count as f64, count, &mut x, &mut mode));
                let off = x.iter().zip(&exact).take(8).map(|(a, b)| (a - b).abs());
                off.fold(0.0, f64::max)
            };
            let (coarse, fine) = (error(800), error(1600));
            let order = Scalar::ln(coarse / fine) / core::f64::consts::LN_2;
            // The brush's end of adhesion is a kink of the third derivative, passed by some wheels.
            assert!((order - 2.0).abs() < 0.1, "{order} {coarse:e} {fine:e}");
        }
    }
}

/// Braked on a slope: regularised friction creeps as its formula says, the others hold.
#[test]
fn closed_form_rest_on_a_slope() {
    let slope = 10.0_f64.to_radians();
    let ground = Ground::plane(9.81, slope, 0.4);
    let mut wheels = four(TORQUE);
    for wheel in &mut wheels {
        wheel.brake = 100.0;
    }
    for tire in laws(0.6) {
        let system = robot(wheels.clone(), tire, ground);
        let mut u = vec![0.0; system.sizes().input];
        u[system.layout().brake_input()] = 1.0;
        let (mut x, mut mode) = (at_rest(&system), vec![0.0; 4]);
        let mut implicit = Implicit::new(&system);
        assert!(implicit.steps(&system, &u, 1e-3, 1000, &mut x, &mut mode));
        let before = x.clone();
        assert!(implicit.steps(&system, &u, 1e-3, 100_000, &mut x, &mut mode));
        let moved = vec2(x[0] - before[0], x[1] - before[1]);
        let moved = moved.dot(moved).sqrt();
        if let Tire::Coulomb { rounding, .. } = tire {
            let (sin, cos) = Scalar::sin_cos(slope);
            let k = sin / cos / 0.6;
            let creep = 100.0 * rounding * k / (1.0 - k * k).sqrt();
            // Loads differ by wheel, and with them nothing: each slips alike. The heading stays to 1e-9.
            assert!((moved / creep - 1.0).abs() < 1e-9, "{moved} {creep}");
        } else {
            assert!(moved < 1e-9, "{tire:?} {moved:e}");
            let turned = (x[YAW] - before[YAW]).abs();
            assert!(turned < 1e-9, "{tire:?} {turned:e}");
        }
    }
}

/// Friction of two cubic arcs creeps on a slope where its first arc is tan ψ.
#[test]
fn closed_form_creep_of_cubic_arcs() {
    let slope = 10.0_f64.to_radians();
    let mut wheels = four(TORQUE);
    for wheel in &mut wheels {
        wheel.brake = 100.0;
    }
    let onset = |speed_min| Onset {
        slip: 0.0,
        speed_min,
    };
    let arcs = Arcs {
        breakaway: 0.6,
        kinetic: 0.4,
        peak: onset(0.1),
        sliding: onset(0.5),
    };
    let tire = Tire::Cubic { arcs };
    let system = robot(wheels, tire, Ground::plane(9.81, slope, 0.4));
    let mut u = vec![0.0; system.sizes().input];
    u[system.layout().brake_input()] = 1.0;
    let (mut x, mut mode) = (at_rest(&system), vec![0.0; 4]);
    assert!(Implicit::new(&system).steps(&system, &u, 1e-3, 5000, &mut x, &mut mode));
    let at = system.layout().velocity();
    let creep = vec2(x[at], x[at + 1]);
    let t = creep.dot(creep).sqrt() / 0.1;
    let (sin, cos) = Scalar::sin_cos(slope);
    let friction = 0.6 * 0.5 * t * (3.0 - t * t);
    // Newton's iterations end at some 1e-12 of the forces.
    assert!((friction - sin / cos).abs() < 1e-10, "{friction} {t}");
}

/// The stiffer the tire, the closer to rolling, in proportion.
#[test]
fn order_towards_rolling() {
    let ground = Ground::flat(9.81);
    let mut wheels: Vec<Wheel<f64>> = [("left", 0.25), ("right", -0.25)]
        .map(|(name, y)| wheel(name, [0.0, y], TORQUE))
        .to_vec();
    let caster = Wheel {
        steering: Steering::Free { trail: 0.04 },
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 0.0,
        viscous: 0.0,
        ..wheel("caster", [-0.3, 0.0], Drive::None)
    };
    wheels.push(caster);
    let rolling = Rolling::new(platform(wheels.clone()), ground);
    let sizes = rolling.sizes();
    let mut u = vec![0.0; sizes.input];
    (u[0], u[1]) = (0.5, 0.8);
    let mut ideal = vec![0.0; sizes.state];
    rolling.platform().renew_angles(&mut ideal);
    let mut mode = vec![1.0; sizes.mode];
    let mut rk4 = RungeKutta4::new(sizes.state, sizes.input);
    rk4.steps(&rolling, &Held(&u), 0.0, 1e-3, 2000, &mut ideal, &mut mode);
    let off = |stiffness: f64| {
        let system = robot(wheels.clone(), brush(0.8, stiffness), ground);
        let (mut x, mut mode) = (at_rest(&system), vec![1.0; 3]);
        let mut implicit = Implicit::new(&system);
        assert!(implicit.steps(&system, &u, 1e-3, 2000, &mut x, &mut mode));
        let apart = vec2(x[0] - ideal[0], x[1] - ideal[1]);
        apart.dot(apart).sqrt()
    };
    // Beyond some 1e4 the method's own error, 1e-7, would show.
    let distances = [20.0, 80.0, 320.0, 1280.0].map(off);
    for pair in distances.windows(2) {
        let order = Scalar::ln(pair[0] / pair[1]) / Scalar::ln(4.0);
        assert!((order - 1.0).abs() < 0.05, "{distances:?}");
    }
}

/// A thousand robots left to themselves at random velocities on level ground: no contact law ever gives
/// them energy.
#[test]
fn invariant_friction_never_gives_energy() {
    let mut seed = 7_u64;
    let mut random = |low: f64, high: f64| {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * ((seed >> 11) as f64 / (1_u64 << 53) as f64)
    };
    for trial in 0..1000 {
        let count = 3 + trial % 4;
        let mut wheels = Vec::new();
        for k in 0..count {
            let angle = random(-3.0, 3.0);
            let place = [random(-0.4, 0.4), random(-0.4, 0.4)];
            let mut one = wheel(&format!("w{k}"), place, Drive::None);
            one.steering = Steering::Fixed { angle: 0.0 };
            if trial % 3 == 0 {
                one.rim = Rim::Rollers { angle: 0.3 * angle };
            }
            one.dry_friction = if trial % 5 == 0 { 0.05 } else { 0.0 };
            wheels.push(one);
        }
        let mut tire = laws(random(0.1, 1.2))[trial % 5];
        if let Tire::Lugre { damping, .. } = &mut tire {
            // Slip speeds reach 10 m/s: there a law with more than 4 μ/|s| is not passive.
            *damping = 0.04;
        }
        let system = robot(wheels, tire, Ground::flat(9.81));
        let mut x = at_rest(&system);
        let at = system.layout().velocity();
        (x[at], x[at + 1], x[at + 2]) = (random(-2.0, 2.0), random(-2.0, 2.0), random(-5.0, 5.0));
        for i in 0..count {
            x[system.rate(i)] = random(-40.0, 40.0);
        }
        let u = vec![0.0; system.sizes().input];
        let mut mode = vec![1.0; count];
        let mut implicit = Implicit::new(&system);
        let energy = |x: &[f64], mode: &[f64]| outputs(&system, x, &u, mode)[3];
        let first = energy(&x, &mode);
        let mut before = first;
        for _ in 0..40 {
            // At 1 ms the method itself, which is not algebraically stable, gives one robot in a
            // thousand a thousandth of its energy in the first violent steps.
            assert!(implicit.steps(&system, &u, 2.5e-4, 20, &mut x, &mut mode));
            let now = energy(&x, &mode);
            assert!(now.is_finite(), "{trial} {tire:?}");
            // Rounded friction has nowhere to keep energy; bristles and carcass do, and give it back.
            if matches!(tire, Tire::Coulomb { .. }) {
                assert!(now <= before * (1.0 + 1e-9), "{trial} {now} {before}");
            }
            assert!(
                now <= first * (1.0 + 1e-9),
                "{trial} {tire:?} {now} {first}"
            );
            before = now;
        }
    }
}

/// Loads carry the weight and the moments of the forces; a wheel that would have to pull lifts off.
#[test]
fn invariant_loads_balance() {
    let system = robot(
        four(TORQUE),
        coulomb(0.9, 0.05),
        Ground::plane(9.81, 0.2, 1.0),
    );
    let mut x = at_rest(&system);
    let at = system.layout().velocity();
    let u = vec![0.0; system.sizes().input];
    let mode = [1.0; 4];
    let weight = 30.0 * system.ground().gravity_normal;
    for (sideways, lifted) in [(0.05, false), (-3.0, false)] {
        x[at + 1] = sideways;
        let y = outputs(&system, &x, &u, &mode);
        let loads: Vec<f64> = (0..4)
            .map(|i| y[system.layout().wheel_output(i, WheelOutput::Load)])
            .collect();
        let sum: f64 = loads.iter().sum();
        assert!((sum - weight).abs() < 1e-9 * weight, "{loads:?}");
        assert_eq!(loads.contains(&0.0), lifted, "{loads:?}");
    }
    // Twice as high, the same sideways slide lifts the wheels on one side.
    let mut wheels = four(TORQUE);
    wheels.truncate(4);
    let body = Body {
        mass: 28.0,
        inertia_com: 1.4,
        center_of_mass: vec2(0.0, 0.0),
        com_height: 0.35,
    };
    let tall = Slip::new(
        Platform::new(body, wheels).expect("a platform"),
        vec![coulomb(0.9, 0.01); 4],
        Ground::flat(9.81),
        Loads::Dynamic,
    )
    .expect("a robot");
    let mut x = at_rest(&tall);
    x[at + 1] = -3.0;
    let y = outputs(&tall, &x, &u, &mode);
    let loads: Vec<f64> = (0..4)
        .map(|i| y[tall.layout().wheel_output(i, WheelOutput::Load)])
        .collect();
    assert!(loads.iter().all(|load| *load >= 0.0), "{loads:?}");
    assert!(loads.contains(&0.0), "{loads:?}");
    // The zero-moment point lies beyond the wheels: it tips.
    assert!(y[6] < 0.0, "{}", y[6]);
}

/// Full throttle on ice, a push of 50 m/s sideways, wheels thrown in reverse: all stays finite.
#[test]
fn invariant_violence_stays_finite() {
    for tire in laws(0.02).into_iter().chain(laws(1.5)) {
        let system = robot(four(motor(1e-4)), tire, Ground::plane(9.81, 0.5, 2.0));
        let mut x = at_rest(&system);
        let at = system.layout().velocity();
        (x[at], x[at + 1], x[at + 2]) = (3.0, 50.0, -30.0);
        let mut u = vec![0.0; system.sizes().input];
        let mut mode = vec![1.0; 4];
        let mut implicit = Implicit::new(&system);
        for k in 0..200 {
            u[..4].fill(if k % 2 == 0 { 24.0 } else { -24.0 });
            assert!(implicit.steps(&system, &u, 1e-3, 10, &mut x, &mut mode));
            assert!(x.iter().all(|value| value.is_finite()), "{tire:?} {k}");
        }
    }
}

/// A skid-steer robot turns on the spot, which rolling forbids, and its ledger adds up.
#[test]
fn invariant_skid_steer_turns_on_the_spot() {
    let system = robot(four(motor(1e-3)), brush(0.8, 15.0), Ground::flat(9.81));
    let mut x = at_rest(&system);
    let mut u = vec![0.0; system.sizes().input];
    u[..4].copy_from_slice(&[-8.0, 8.0, -8.0, 8.0]);
    let mut mode = vec![1.0; 4];
    let mut implicit = Implicit::new(&system);
    assert!(implicit.steps(&system, &u, 1e-3, 3000, &mut x, &mut mode));
    let y = outputs(&system, &x, &u, &mode);
    assert!(y[2] > 0.5, "turns: {}", y[2]);
    assert!(y[0].abs() < 0.05, "stays: {}", y[0]);
    for i in 0..4 {
        let used = y[system.slip_output(i, SlipOutput::Use)];
        assert!((0.0..=1.0 + 1e-9).contains(&used), "{used}");
        assert!(y[system.slip_output(i, SlipOutput::Power)] > 0.0);
    }
    let ledger = system.layout().ledger();
    let [supplied, windings, gears, friction] = [0, 1, 2, 3].map(|k| x[ledger + k]);
    let stored = y[3] + y[5];
    let residual = stored - (supplied - windings - gears - friction);
    // What the method of order 2 loses at 1 ms, and the springs of the tires hold.
    assert!(residual.abs() < 2e-3 * supplied, "{residual} of {supplied}");
}

/// Turning on the spot, four wheels at (±a, ±b) about the center of mass need rates as on a track
/// 1 + (a/b)² times as wide, whatever the friction and the law of isotropic tires.
#[test]
fn closed_form_effective_track_of_a_skid_steer() {
    let (a, b, radius) = (0.2, 0.25, 0.1);
    for tire in laws(0.5).into_iter().chain(laws(1.1)) {
        let body = Body {
            mass: 28.0,
            inertia_com: 1.4,
            center_of_mass: Vec2::zero(),
            com_height: 0.15,
        };
        let mut wheels = four(motor(1e-3));
        for wheel in &mut wheels {
            wheel.viscous = 0.0;
        }
        let platform = Platform::new(body, wheels).expect("a platform");
        let ground = Ground::flat(9.81);
        let system = Slip::new(platform, vec![tire; 4], ground, Loads::Dynamic).expect("a robot");
        let mut x = at_rest(&system);
        let mut u = vec![0.0; system.sizes().input];
        u[..4].copy_from_slice(&[-9.0, 9.0, -9.0, 9.0]);
        let mut mode = vec![1.0; 4];
        assert!(Implicit::new(&system).steps(&system, &u, 1e-3, 6000, &mut x, &mut mode));
        let yaw_rate = x[system.layout().velocity() + 2];
        let ideal = radius * x[system.rate(1)] / b;
        let wider = ideal / yaw_rate;
        let expected = 1.0 + (a / b) * (a / b);
        // Six seconds are many time constants of the turn; bristles that turn with a wheel lag a little.
        assert!(
            (wider - expected).abs() < 2e-3,
            "{tire:?} {wider} {expected}"
        );
    }
}

/// Braked so hard that load transfer feeds itself (friction above the wheelbase over the height): the
/// caster lifts, and the drive wheels carry all and brake with all their friction.
#[test]
fn closed_form_braking_beyond_the_caster() {
    let mut wheels: Vec<Wheel<f64>> = [("left", 0.25), ("right", -0.25)]
        .map(|(name, y)| wheel(name, [0.0, y], TORQUE))
        .to_vec();
    for wheel in &mut wheels {
        wheel.brake = 100.0;
    }
    wheels.push(Wheel {
        steering: Steering::Free { trail: 0.02 },
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 0.0,
        viscous: 0.0,
        brake: 0.0,
        ..wheel("caster", [-0.2, 0.0], Drive::None)
    });
    let body = Body {
        mass: 28.0,
        inertia_com: 1.4,
        center_of_mass: vec2(-0.05, 0.0),
        com_height: 0.25,
    };
    for (friction, lifts) in [(0.15, false), (0.7, true), (1.5, true)] {
        let platform = Platform::new(body, wheels.clone()).expect("a platform");
        let ground = Ground::flat(9.81);
        let tires = vec![coulomb(friction, 1e-3); 3];
        let system = Slip::new(platform, tires, ground, Loads::Dynamic).expect("a robot");
        let mut x = system.rolling_state(&at_rest(&system), vec2(2.0, 0.0), 0.0);
        let mut u = vec![0.0; system.sizes().input];
        u[system.layout().brake_input()] = 1.0;
        let mut mode = vec![0.0; 3];
        assert!(Implicit::new(&system).steps(&system, &u, 1e-3, 50, &mut x, &mut mode));
        let y = outputs(&system, &x, &u, &mode);
        let of = |i, what| y[system.layout().wheel_output(i, what)];
        let weight = 29.0 * 9.81;
        let caster = of(2, WheelOutput::Load);
        assert_eq!(caster == 0.0, lifts, "{friction}: {caster}");
        assert_eq!(y[6] < 0.0, lifts, "{friction}: {}", y[6]);
        let braked = of(0, WheelOutput::Longitudinal) + of(1, WheelOutput::Longitudinal);
        // Rounding 1e-3 against a slip of 1 m/s and more: friction less 1e-6 of it.
        let expected = -friction * (weight - caster);
        assert!(
            (braked / expected - 1.0).abs() < 1e-5,
            "{braked} {expected}"
        );
    }
}
