//! Slipping wheels on uneven ground: a plane, rest on hills, energy, and edges of a valley.

use std::f64::consts::{FRAC_PI_2, PI};

use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{Platform, WheelOutput, YAW};
use appell_model::scalar::Scalar;
use appell_model::slip::{Implicit, Loads, Slip, SlipOutput};
use appell_model::stance::{Footing, Standing};
use appell_model::terrain::{Relief, Terrain, heading};
use appell_model::tire::Tire;
use appell_model::wheel::Rim;

use crate::common::motor;
use crate::slip::{TORQUE, at_rest, brush, four, laws, platform, robot};
use crate::terrain::{GRAVITY, waves};

fn on(platform: Platform<f64>, tire: Tire<f64>, features: Vec<Relief>) -> Slip<f64> {
    let footing =
        Footing::new(&platform, Terrain::new(features), GRAVITY).expect("it stands on four");
    let tires = vec![tire; platform.wheels().len()];
    Slip::new(platform, tires, Ground::flat(GRAVITY), Loads::Dynamic)
        .expect("a robot")
        .on(footing)
}

pub fn at(system: &Slip<f64>, pose: [f64; 3], velocity: Vec2<f64>) -> Vec<f64> {
    let mut x = vec![0.0; system.layout().state()];
    (x[0], x[1], x[YAW]) = (pose[0], pose[1], pose[2]);
    system.platform().renew_angles(&mut x);
    system.rolling_state(&x, velocity, 0.0)
}

pub fn outputs(system: &Slip<f64>, x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; system.sizes().output];
    system.output(x, u, &vec![1.0; system.layout().wheels], &mut y);
    y
}

/// A plane as uneven ground and the plane of the flat level are the same motion, forces and loads; for
/// plain wheels and for rollers.
#[test]
fn peer_plane_against_its_own_level() {
    let (tilt, uphill) = (0.2, 0.6);
    let (sin, cos) = Scalar::sin_cos(tilt);
    for rollers in [false, true] {
        let mut wheels = four(TORQUE);
        for (wheel, turn) in wheels.iter_mut().zip([-1.0, 1.0, 1.0, -1.0]) {
            if rollers {
                wheel.rim = Rim::Rollers {
                    angle: turn * FRAC_PI_2 / 2.0,
                };
            }
            // Hardly gives: its chassis lies in the plane.
            wheel.stiffness = 1e4;
        }
        let tire = brush(0.7, 12.0);
        let ground = Ground::plane(GRAVITY, tilt, uphill + PI);
        let flat = robot(wheels.clone(), tire, ground);
        let slope = Relief::Slope {
            uphill: heading(uphill),
            grade: sin / cos,
        };
        let uneven = on(platform(wheels), tire, vec![slope]);
        let mut u = vec![0.0; flat.sizes().input];
        u[..4].copy_from_slice(&[4.0, 9.0, 2.0, 6.0]);
        let mut x = at(&flat, [0.0, 0.0, uphill], vec2(0.4, 0.0));
        let mut over = at(&uneven, [0.0, 0.0, uphill], vec2(0.4, 0.0));
        let mut mode = vec![1.0; 4];
        assert!(Implicit::new(&flat).steps(&flat, &u, 1e-3, 1500, &mut x, &mut mode));
        assert!(Implicit::new(&uneven).steps(&uneven, &u, 1e-3, 1500, &mut over, &mut mode));
        assert_eq!(uneven.stand(&mut over), Standing::Stands);
        // Ways along the slope are shorter on the map.
        let (way, axis) = (vec2(x[0], x[1]), heading(uphill));
        let map = axis * (way.dot(axis) * cos) + axis.perpendicular() * axis.cross(way);
        let off = vec2(over[0], over[1]) - map;
        // Where gravity points at the end of a step is predicted by the velocity at its start: some
        // 1e-6 after 1.5 s in steps of 1 ms.
        assert!(off.dot(off) < 1e-11, "{off:?} {map:?}");
        let (y, z) = (outputs(&flat, &x, &u), outputs(&uneven, &over, &u));
        for k in (0..y.len()).filter(|&k| k != 4) {
            let off = (y[k] - z[k]).abs();
            assert!(off < 2e-6 * (1.0 + y[k].abs()), "{k}: {} {}", y[k], z[k]);
        }
    }
}

/// Braked on a hill side, tires with stiction hold it.
#[test]
fn invariant_rest_on_hills() {
    let mut wheels = four(TORQUE);
    for wheel in &mut wheels {
        wheel.brake = 100.0;
    }
    for tire in laws(0.8) {
        let system = on(platform(wheels.clone()), tire, waves(0.03));
        let mut u = vec![0.0; system.sizes().input];
        u[system.layout().brake_input()] = 1.0;
        let mut x = at(&system, [0.2, 0.1, 0.4], Vec2::zero());
        let mut mode = vec![0.0; 4];
        let mut implicit = Implicit::new(&system);
        assert!(implicit.steps(&system, &u, 1e-3, 1000, &mut x, &mut mode));
        let before = x.clone();
        assert!(implicit.steps(&system, &u, 1e-3, 4000, &mut x, &mut mode));
        let moved = vec2(x[0] - before[0], x[1] - before[1]);
        let moved = moved.dot(moved).sqrt();
        // It leans: there is something to hold.
        assert!(x[system.attitude() + 1].abs() + x[system.attitude() + 2].abs() > 0.02);
        match tire {
            // It creeps, as on a plane.
            Tire::Coulomb { .. } => assert!(moved > 1e-3, "{moved:e}"),
            _ => assert!(moved < 1e-9, "{tire:?}: {moved:e}"),
        }
    }
}

/// Motors drive over waves: what they supply is what height, motion and losses hold, to the second
/// order of the method.
#[test]
fn order_ledger_on_waves() {
    let mut wheels = four(motor(5e-3));
    for wheel in &mut wheels {
        // Tires that give hold energy which following the ground leaves out of account.
        wheel.stiffness = 10.0;
    }
    let system = on(platform(wheels), brush(0.9, 12.0), waves(0.02));
    let mut u = vec![0.0; system.sizes().input];
    u[..4].copy_from_slice(&[8.0, 10.0, 8.0, 10.0]);
    let stored = |x: &[f64]| {
        let y = outputs(&system, x, &u);
        y[3] + y[4] + y[5]
    };
    let residual = |step: f64, count: u64| {
        let mut x = at(&system, [0.1, 0.0, 0.2], Vec2::zero());
        let before = stored(&x);
        let mut mode = vec![1.0; 4];
        assert!(Implicit::new(&system).steps(&system, &u, step, count, &mut x, &mut mode));
        let ledger = system.layout().ledger();
        let [supplied, windings, gears, friction] = x[ledger..ledger + 4] else {
            panic!("four entries")
        };
        assert!(supplied > 20.0 && friction > 0.5, "{supplied} {friction}");
        let spent = supplied - windings - gears - friction;
        (stored(&x) - before - spent) / supplied
    };
    let (coarse, fine) = (residual(2e-3, 1000), residual(1e-3, 2000));
    // Quartered by half the step, but for what tires hold as they give.
    assert!(
        coarse.abs() < 3e-4 && fine.abs() < coarse.abs() / 3.0,
        "{coarse:e} {fine:e}"
    );
}

/// On both sides of a valley the contact forces carry the weight, each in its own direction, and slip
/// goes along the ground.
#[test]
fn closed_form_valley() {
    let grade = 0.4;
    let (sin, cos) = {
        let long = Scalar::sqrt(1.0 + grade * grade);
        (grade / long, 1.0 / long)
    };
    let slope = |at: f64, rise: f64| Relief::Ramp {
        at: vec2(at, 0.0),
        along: vec2(1.0, 0.0),
        rise,
        length: 10.0,
    };
    // Down to 0, and up at twice the grade beyond.
    let features = vec![slope(-10.0, -4.0), slope(0.0, 4.0)];
    let mut wheels = four(TORQUE);
    for wheel in &mut wheels {
        wheel.stiffness = 1e5;
    }
    let system = on(platform(wheels), brush(0.6, 8.0), features);
    let speed = 0.5;
    let mut x = at(&system, [0.0, 0.0, 0.0], vec2(speed, 0.0));
    for i in 0..4 {
        // Spinning: forces up to friction's.
        x[system.rate(i)] = 9.0;
        let at = system.deflection(i);
        (x[at], x[at + 1]) = (-4e-3, 0.0);
    }
    let u = vec![0.0; system.sizes().input];
    let y = outputs(&system, &x, &u);
    let mut carried = 0.0;
    for (i, wheel) in system.platform().wheels().iter().enumerate() {
        let of = |what| y[system.layout().wheel_output(i, what)];
        let (pull, load) = (of(WheelOutput::Longitudinal), of(WheelOutput::Load));
        assert!(pull > 1.0 && load > 1.0, "{pull} {load}");
        // Uphill in front, downhill behind.
        let up = if wheel.mount.x > 0.0 { sin } else { -sin };
        carried += load * cos + pull * up;
        let slip = y[system.slip_output(i, SlipOutput::Along)];
        let expected = speed / cos - wheel.radius * 9.0;
        assert!((slip - expected).abs() < 1e-6, "{slip} {expected}");
    }
    let weight = system.platform().total_mass() * GRAVITY;
    // A chassis that pitches by micrometres of its tires.
    assert!(
        (carried - weight).abs() < 1e-4 * weight,
        "{carried} {weight}"
    );
}

/// The flat level of a robot is untouched by what uneven ground adds.
#[test]
fn invariant_level_plane_is_flat() {
    let flat = robot(four(TORQUE), brush(0.7, 12.0), Ground::flat(GRAVITY));
    let uneven = on(platform(four(TORQUE)), brush(0.7, 12.0), Vec::new());
    let mut u = vec![0.0; flat.sizes().input];
    u[..4].copy_from_slice(&[1.0, 2.0, 1.5, 2.5]);
    let (mut x, mut over) = (at_rest(&flat), at_rest(&uneven));
    let mut mode = vec![1.0; 4];
    assert!(Implicit::new(&flat).steps(&flat, &u, 1e-3, 500, &mut x, &mut mode));
    assert!(Implicit::new(&uneven).steps(&uneven, &u, 1e-3, 500, &mut over, &mut mode));
    for k in 0..x.len() {
        // It leans by a fraction of a millimetre, for its weight is not in the middle.
        assert!((x[k] - over[k]).abs() < 2e-4 * (1.0 + x[k].abs()), "{k}");
    }
}
