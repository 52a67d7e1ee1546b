//! Uneven ground: what wheels meet, how a robot stands, energy, and the plane as its own limit.

use std::f64::consts::{FRAC_PI_2, PI};

use appell_model::drive::Drive;
use appell_model::dynamics::Dynamics;
use appell_model::following::Following;
use appell_model::ground::Ground;
use appell_model::kinematic::Kinematic;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{Body, Platform, WheelOutput, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::stance::{Footing, Standing};
use appell_model::terrain::{Disc, Form, Grid, Relief, Terrain, heading};
use appell_model::wheel::{Rim, Steering, Wheel};

use crate::common::{Method, integrate, motor};

fn sin(angle: f64) -> f64 {
    Scalar::sin_cos(angle).0
}

fn cos(angle: f64) -> f64 {
    Scalar::sin_cos(angle).1
}

fn tan(angle: f64) -> f64 {
    sin(angle) / cos(angle)
}

fn sqrt(value: f64) -> f64 {
    Scalar::sqrt(value)
}

pub const GRAVITY: f64 = 9.81;
const TORQUE: Drive<f64> = Drive::Torque { torque_max: 1e3 };

fn wheel(name: &str, mount: [f64; 2], steering: Steering<f64>, drive: Drive<f64>) -> Wheel<f64> {
    Wheel {
        name: name.into(),
        mount: vec2(mount[0], mount[1]),
        radius: 0.08,
        steering,
        rim: Rim::Plain,
        mass: 0.4,
        inertia_vertical: 2e-3,
        spin_inertia: 1.5e-3,
        viscous: 0.0,
        pivot_viscous: 0.0,
        dry_friction: 0.0,
        friction_rounding: 0.0,
        stiffness: 1.0,
        brake: 0.0,
        drive,
    }
}

/// Two driven wheels, two that swivel in front.
fn platform(drive: Drive<f64>) -> Platform<f64> {
    let fixed = Steering::Fixed { angle: 0.0 };
    let free = Steering::Free { trail: 0.03 };
    let body = Body {
        mass: 12.0,
        inertia_com: 0.3,
        center_of_mass: vec2(0.12, 0.01),
        com_height: 0.15,
    };
    let idle = |name: &str, mount| {
        let mut caster = wheel(name, mount, free, Drive::None);
        (caster.mass, caster.inertia_vertical, caster.spin_inertia) = (0.0, 0.0, 0.0);
        caster
    };
    Platform::new(
        body,
        vec![
            wheel("left", [0.0, 0.2], fixed, drive),
            wheel("right", [0.0, -0.2], fixed, drive),
            idle("front left", [0.3, 0.15]),
            idle("front right", [0.3, -0.15]),
        ],
    )
    .expect("a platform")
}

pub fn waves(amplitude: f64) -> Vec<Relief> {
    let wave = |angle: f64, period: f64, phase: f64| Relief::Wave {
        at: vec2(-50.0, -50.0),
        along: heading(angle),
        form: Form::Sine,
        amplitude,
        period,
        phase,
        length: 200.0,
    };
    vec![wave(0.3, 1.3, 0.4), wave(1.2, 2.1, 1.0)]
}

fn following(platform: Platform<f64>, features: Vec<Relief>) -> Following<f64, Rolling<f64>> {
    let footing =
        Footing::new(&platform, Terrain::new(features), GRAVITY).expect("it stands on four");
    Following::new(Rolling::new(platform, Ground::flat(GRAVITY)), footing)
}

fn start<S>(system: &Following<f64, S>, pose: [f64; 3], twist: [f64; 2]) -> Vec<f64>
where
    S: appell_model::following::Planar<f64>,
{
    let platform = system.level().platform();
    let layout = platform.layout();
    let mut x = vec![0.0; layout.state()];
    (x[0], x[1], x[YAW]) = (pose[0], pose[1], pose[2]);
    platform.renew_angles(&mut x);
    let at = layout.velocity();
    (x[at], x[at + 1]) = (twist[0], twist[1]);
    system.state(&x)
}

/// On a step, a plane, and a circular hill a wheel's center goes as geometry says.
#[test]
fn closed_form_what_a_wheel_meets() {
    let r = 0.1;
    let step = Terrain::new(vec![Relief::Ramp {
        at: vec2(1.0, 0.0),
        along: vec2(1.0, 0.0),
        rise: 0.04,
        length: 0.0,
    }]);
    for k in 0..400 {
        let x = 0.8 + 0.001 * f64::from(k) + 1e-5;
        for (way, turn) in [(1.0, 0.0), (-1.0, PI), (0.5, PI / 3.0)] {
            let touch = step.touch(&Disc::upright(vec2(x, 0.3), heading(turn), r));
            // Distance to the edge along the way of the wheel.
            let ahead = (1.0 - x) / way;
            let on_edge = 0.04 + sqrt((r * r - ahead * ahead).max(0.0)) - r;
            let expected = if x >= 1.0 {
                0.04
            } else if ahead.abs() < r && on_edge > 0.0 {
                on_edge
            } else {
                0.0
            };
            // The wheel is taken a nanometre beside the edge.
            assert!((touch.depth - expected).abs() < 1e-8, "{x} {touch:?}");
            if expected > 0.0 && expected < 0.04 {
                let grade = ahead / sqrt(r * r - ahead * ahead);
                let off = touch.gradient.dot(heading(turn)) - grade;
                assert!(
                    off.abs() < 1e-6 * (1.0 + grade.abs()),
                    "{x} {turn} {off} {touch:?}"
                );
            }
        }
    }
    // A plane of 20°: its center keeps its radius from it.
    let grade = 20.0_f64.to_radians();
    let plane = Terrain::new(vec![Relief::Slope {
        uphill: heading(0.7),
        grade: tan(grade),
    }]);
    let touch = plane.touch(&Disc::upright(vec2(0.4, -0.2), heading(0.7), r));
    let height = tan(grade) * vec2(0.4, -0.2).dot(heading(0.7));
    assert!((touch.depth + r - height - r / cos(grade)).abs() < 1e-14);
    assert!(
        (touch.gradient - heading(0.7) * tan(grade))
            .dot(heading(0.7))
            .abs()
            < 1e-14
    );
    // A square hole narrower than the wheel lets it in by r − √(r² − b²/4).
    let hole = Terrain::new(vec![Relief::Block {
        at: vec2(0.0, 0.0),
        along: vec2(1.0, 0.0),
        half: [0.05, 1.0],
        rise: -0.2,
    }]);
    let touch = hole.touch(&Disc::upright(Vec2::zero(), vec2(1.0, 0.0), r));
    let depth = r - sqrt(r * r - 0.05 * 0.05);
    assert!((touch.depth + depth).abs() < 1e-8, "{touch:?}");
}

/// The gradient of the wheel's height is what differences give, on waves, edges and grids.
#[test]
fn peer_gradients_against_differences() {
    let heights: Vec<f64> = (0..40 * 40)
        .map(|k| {
            let (x, y) = (f64::from(k % 40), f64::from(k / 40));
            0.03 * sin(0.9 * x) * cos(0.7 * y)
        })
        .collect();
    let grid = Grid::new(vec2(-1.0, -1.0), [0.05, 0.06], 40, heights).expect("a grid");
    let triangle = Relief::Wave {
        at: vec2(-1.0, 0.0),
        along: heading(0.2),
        form: Form::Triangle,
        amplitude: 0.02,
        period: 0.3,
        phase: 0.5,
        length: 3.0,
    };
    let grounds = [
        Terrain::new(waves(0.05)),
        Terrain::new(vec![Relief::Grid(grid)]),
        Terrain::new(vec![triangle]),
    ];
    let h = 1e-6;
    let mut kinks = 0;
    for ground in &grounds {
        for k in 0..300 {
            let t = f64::from(k);
            let point = vec2(0.7 * sin(1.7 * t), 0.7 * sin(2.3 * t + 1.0));
            let way = heading(0.37 * t);
            let height = |p: Vec2<f64>| ground.touch(&Disc::upright(p, way, 0.08)).depth;
            let slope = |d: Vec2<f64>| (height(point + d * h) - height(point - d * h)) / (2.0 * h);
            let touch = ground.touch(&Disc::upright(point, way, 0.08));
            let along = (slope(way) - touch.gradient.dot(way)).abs();
            let left = way.perpendicular();
            let across = (slope(left) - touch.gradient.dot(left)).abs();
            // A wheel on two points at once has no gradient.
            if along.max(across) > 2e-5 {
                kinks += 1;
            }
        }
    }
    assert!(kinks < 9, "{kinks} of 900 places");
}

/// A grid is a cubic convolution: it has its nodes' heights, and planes and parabolas are exact.
#[test]
fn closed_form_grid() {
    let (nx, ny) = (12, 9);
    let f = |x: f64, y: f64| 0.3 + 0.2 * x - 0.1 * y + 0.05 * x * x - 0.02 * x * y;
    let (origin, spacing) = (vec2(-0.3, 0.2), [0.1, 0.07]);
    let heights = (0..nx * ny)
        .map(|k| {
            let (i, j) = (k % nx, k / nx);
            f(
                origin.x + spacing[0] * f64::from(i),
                origin.y + spacing[1] * f64::from(j),
            )
        })
        .collect();
    let grid = Grid::new(origin, spacing, nx as usize, heights).expect("a grid");
    let ground = Terrain::new(vec![Relief::Grid(grid)]);
    for k in 0..200 {
        let t = f64::from(k) / 200.0;
        let point = vec2(-0.2 + 0.9 * t, 0.28 + 0.39 * (1.0 - t));
        let (height, gradient) = ground.surface(point);
        let exact = vec2(0.2 + 0.1 * point.x - 0.02 * point.y, -0.1 - 0.02 * point.x);
        assert!((height - f(point.x, point.y)).abs() < 1e-15);
        assert!((gradient - exact).dot(gradient - exact).sqrt() < 1e-13);
    }
    // Beyond its rim it goes on level.
    let (height, gradient) = ground.surface(vec2(-7.0, 0.41));
    assert!((height - f(-0.3, 0.41)).abs() < 1e-15 && gradient.x == 0.0);
    assert!(Grid::new(origin, spacing, 7, vec![0.0; 15]).is_none());
    assert!(Grid::new(origin, [0.1, 0.0], 2, vec![0.0; 4]).is_none());
    assert!(Grid::new(origin, spacing, 2, vec![0.0, 1.0, f64::NAN, 0.0]).is_none());
}

/// A plane as uneven ground and the plane of the flat levels are the same motion, forces and loads.
#[test]
fn peer_plane_against_its_own_level() {
    let tilt = 0.2;
    let uphill = 0.6;
    let fixed = Steering::Fixed { angle: 0.0 };
    let body = Body {
        mass: 12.0,
        inertia_com: 0.3,
        center_of_mass: vec2(0.02, 0.01),
        com_height: 0.15,
    };
    // Without casters, whose masses the two count at other places.
    let mecanum = |name: &str, mount: [f64; 2], angle: f64| {
        let mut wheel = wheel(name, mount, fixed, TORQUE);
        wheel.rim = Rim::Rollers { angle };
        // Hardly gives: its chassis lies in the plane.
        wheel.stiffness = 1e4;
        wheel
    };
    let q = FRAC_PI_2 / 2.0;
    let platform = Platform::new(
        body,
        vec![
            mecanum("a", [0.2, 0.15], -q),
            mecanum("b", [0.2, -0.15], q),
            mecanum("c", [-0.2, 0.15], q),
            mecanum("d", [-0.2, -0.15], -q),
        ],
    )
    .expect("a platform");
    let flat = Rolling::new(platform.clone(), Ground::plane(GRAVITY, tilt, uphill + PI));
    let features = vec![Relief::Slope {
        uphill: heading(uphill),
        grade: tan(tilt),
    }];
    let uneven = following(platform, features);
    // In the plane the robot heads along the slope's own axes; on the map these are `uphill`.
    let turned = 0.0;
    let u = {
        let mut u = vec![0.0; flat.sizes().input];
        u[..4].copy_from_slice(&[0.9, 0.4, 0.7, 0.2]);
        u
    };
    let mut x = vec![0.0; flat.sizes().state];
    x[YAW] = uphill + turned;
    flat.platform().renew_angles(&mut x);
    let (end, mode) = integrate(&flat, &x, &u, 2.0, Method::Rk4(1e-3));
    let from = start(&uneven, [0.0, 0.0, uphill + turned], [0.0, 0.0]);
    let (over, over_mode) = integrate(&uneven, &from, &u, 2.0, Method::Rk4(1e-3));
    // Ways along the slope are shorter on the map.
    let way = vec2(end[0], end[1]);
    let axis = heading(uphill);
    let map = axis * (way.dot(axis) * cos(tilt)) + axis.perpendicular() * axis.cross(way);
    let off = vec2(over[0], over[1]) - map;
    // Its tires give by a tenth of a micrometre.
    assert!(off.dot(off).sqrt() < 1e-6, "{off:?}");
    let mut y = vec![0.0; flat.sizes().output];
    flat.output(&end, &u, &mode, &mut y);
    let mut z = vec![0.0; uneven.sizes().output];
    uneven.output(&over, &u, &over_mode, &mut z);
    // Outputs of body and wheels: twist, kinetic energy, margin, forces, loads.
    for k in (0..y.len()).filter(|&k| k != 4) {
        assert!(
            (y[k] - z[k]).abs() < 1e-6 * (1.0 + y[k].abs()),
            "{k}: {} {}",
            y[k],
            z[k]
        );
    }
    // Its tilt is the slope's, split in roll and pitch by its heading.
    let [height, roll, pitch] = z[y.len()..] else {
        panic!("height, roll and pitch")
    };
    let normal = cos(roll) * cos(pitch);
    assert!((normal - cos(tilt)).abs() < 1e-6, "{roll} {pitch}");
    assert!((height - tan(tilt) * map.dot(axis)).abs() < 1e-6);
}

/// Without losses the energy of motion and height stays: to the order of the method, and as far as
/// tires give, which what follows the ground leaves out of account.
#[test]
fn order_energy_on_hills() {
    let steps = [0.02, 0.01, 0.005, 0.0025];
    let errors = |stiffness: f64| {
        let soft = platform(TORQUE);
        // On three wheels: of four hard ones another lifts every other moment.
        let mut wheels = soft.wheels()[..3].to_vec();
        wheels[2].mount = vec2(0.3, 0.0);
        wheels.iter_mut().for_each(|w| w.stiffness = stiffness);
        let platform = Platform::new(*soft.body(), wheels).expect("a platform");
        let system = following(platform, waves(0.03));
        let from = start(&system, [0.3, 0.2, 0.4], [0.9, 0.5]);
        let u = vec![0.0; system.sizes().input];
        let energy = |x: &[f64], mode: &[f64]| {
            let mut y = vec![0.0; system.sizes().output];
            system.output(x, &u, mode, &mut y);
            y[3] + y[4]
        };
        let before = energy(&from, &[1.0; 3]);
        steps.map(|step| {
            let (x, mode) = integrate(&system, &from, &u, 3.0, Method::Rk4(step));
            assert_eq!(system.stand(&x).standing, Standing::Stands);
            (energy(&x, &mode) - before).abs()
        })
    };
    let hard = errors(1e4);
    // The way to what is left at small steps is of the method's order.
    let order =
        Scalar::ln((hard[1] - hard[0]).abs() / (hard[2] - hard[1]).abs()) / core::f64::consts::LN_2;
    assert!(order > 3.8, "{order} {hard:?}");
    // It moves with 5 J: a millionth; with tires that give, some hundred thousandths.
    assert!(hard[3] < 1e-5, "{hard:?}");
    let soft = errors(1.0)[3];
    assert!(soft < 5e-4, "{soft:e}");
}

/// Three wheels stand on any ground; of four on a twisted one that does not give, one lifts; where the
/// center of mass is beyond the wheels it falls, and before a wall it is blocked.
#[test]
fn known_answer_stances() {
    let block = |rise: f64| {
        vec![Relief::Block {
            at: vec2(0.3, 0.15),
            along: vec2(1.0, 0.0),
            half: [0.05, 0.05],
            rise,
        }]
    };
    let system = following(platform(TORQUE), block(0.06));
    let x = start(&system, [0.0; 3], [0.0; 2]);
    let stance = system.stand(&x);
    assert_eq!(stance.standing, Standing::Stands);
    // Front left up: it stands on that, the left and right ones.
    let lifted: Vec<bool> = stance.lifted[..4].to_vec();
    assert_eq!(
        lifted.iter().filter(|&&lifted| lifted).count(),
        1,
        "{stance:?}"
    );
    assert!(lifted[3]);
    let weight: f64 = stance.loads[..4].iter().sum();
    assert!((weight - 12.8 * GRAVITY).abs() < 0.02 * weight);
    // Nose up by 6 cm over 30.
    let [_, roll, pitch] = stance.attitude;
    assert!(
        roll.abs() < 5e-3 && (pitch + 0.2).abs() < 5e-3,
        "{roll} {pitch}"
    );

    let steep = vec![Relief::Slope {
        uphill: vec2(0.0, 1.0),
        grade: 1.6,
    }];
    let system = following(platform(TORQUE), steep);
    let x = start(&system, [0.0; 3], [0.0; 2]);
    let stance = system.stand(&x);
    assert_eq!(stance.standing, Standing::Falls, "{stance:?}");

    let wall = vec![Relief::Ramp {
        at: vec2(0.379, 0.0),
        along: vec2(1.0, 0.0),
        rise: 0.2,
        length: 0.0,
    }];
    let system = following(platform(TORQUE), wall);
    let x = start(&system, [0.0; 3], [0.0; 2]);
    assert_eq!(system.stand(&x).standing, Standing::Blocked(2));
}

/// Kinematics on a hill: ways on the map are those along the chassis, foreshortened.
#[test]
fn closed_form_kinematic_on_a_slope() {
    let platform = platform(Drive::Rate { rate_max: 1e3 });
    let tilt = 0.3;
    let features = vec![Relief::Slope {
        uphill: vec2(1.0, 0.0),
        grade: tan(tilt),
    }];
    let footing = Footing::new(&platform, Terrain::new(features), GRAVITY).expect("a stance");
    let level = Kinematic::new(platform).expect("two driven wheels");
    let system = Following::new(level, footing);
    let from = start(&system, [0.0; 3], [0.0; 2]);
    let mut u = vec![0.0; system.sizes().input];
    (u[0], u[1]) = (5.0, 5.0);
    let (x, _) = integrate(&system, &from, &u, 2.0, Method::Rk4(1e-3));
    // 0.8 m along the slope; the chassis sags by some mrad on its tires, to the rear and to one side.
    let pitch = x[x.len() - 1];
    assert!((pitch + tilt).abs() < 3e-3);
    assert!((x[0] - 0.8 * cos(tilt)).abs() < 1e-5, "{}", x[0]);
    assert!(x[1].abs() < 1e-3);
}

/// Motors climb: what they supply is what height, motion and losses hold.
#[test]
fn invariant_ledger_on_waves() {
    let system = following(platform(motor(5e-3)), waves(0.06));
    let from = start(&system, [0.1, 0.0, 0.2], [0.0, 0.0]);
    let layout = system.level().platform().layout().clone();
    let mut u = vec![0.0; system.sizes().input];
    (u[0], u[1]) = (7.0, 8.0);
    let stored = |x: &[f64], mode: &[f64]| {
        let mut y = vec![0.0; system.sizes().output];
        system.output(x, &u, mode, &mut y);
        assert!(y[layout.wheel_output(0, WheelOutput::Load)] > 0.0);
        y[3] + y[4] + y[5]
    };
    let before = stored(&from, &[1.0; 4]);
    let (x, mode) = integrate(&system, &from, &u, 2.0, Method::Rk4(1e-3));
    let at = layout.ledger();
    let spent = x[at] - x[at + 1] - x[at + 2] - x[at + 3];
    let residual = stored(&x, &mode) - before - spent;
    assert!(x[at] > 10.0, "it worked");
    // As far as tires give.
    assert!(residual.abs() < 2e-4 * x[at], "{residual:e} of {}", x[at]);
}
