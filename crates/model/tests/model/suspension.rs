//! Springs under the chassis: oscillators, flight, dive and lean in closed form, energy, rest, the stiff limit.

use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{Body, Platform, WheelOutput, YAW};
use appell_model::scalar::Scalar;
use appell_model::slip::{Implicit, Loads, Slip};
use appell_model::stance::{Footing, Standing};
use appell_model::suspension::Suspension;
use appell_model::terrain::{Form, Relief, Terrain, heading};
use appell_model::tire::Tire;
use appell_model::wheel::Wheel;

use crate::common::{Method, integrate, motor, slope};
use crate::slip::{TORQUE, brush, four, laws};
use crate::terrain::{GRAVITY, waves};
use crate::terrain_slip::{at, outputs};

const ROLL: f64 = 0.5;
const PITCH: f64 = 0.9;
const HEIGHT: f64 = 0.15;
/// A static deflection of 2 cm: 3.5 Hz.
const STIFFNESS: f64 = 3600.0;

/// The robot of the tests of slip, with its center of mass in the middle or as it is there.
fn platform(wheels: Vec<Wheel<f64>>, middle: bool) -> Platform<f64> {
    let body = Body {
        mass: 28.0,
        inertia_com: 1.4,
        center_of_mass: if middle {
            Vec2::zero()
        } else {
            vec2(0.02, -0.01)
        },
        com_height: HEIGHT,
    };
    Platform::new(body, wheels).expect("a platform")
}

fn springs(stiffness: f64, damping: f64) -> Suspension<f64> {
    Suspension {
        stiffness: vec![stiffness; 4],
        damping: vec![damping; 4],
        roll_inertia: ROLL,
        pitch_inertia: PITCH,
    }
}

fn on(
    platform: Platform<f64>,
    tire: Tire<f64>,
    features: Vec<Relief>,
    suspension: &Suspension<f64>,
) -> Slip<f64> {
    let footing = Footing::new(&platform, Terrain::new(features), GRAVITY)
        .expect("it stands on four")
        .on_springs(&platform, suspension);
    let tires = vec![tire; platform.wheels().len()];
    Slip::new(platform, tires, Ground::flat(GRAVITY), Loads::Dynamic)
        .expect("a robot")
        .on(footing)
}

fn run(system: &Slip<f64>, u: &[f64], step: f64, count: u64, x: &mut [f64]) {
    let mut mode = vec![1.0; system.layout().wheels];
    assert!(Implicit::new(system).steps(system, u, step, count, x, &mut mode));
}

fn still(system: &Slip<f64>) -> Vec<f64> {
    vec![0.0; system.sizes().input]
}

fn stored(system: &Slip<f64>, x: &[f64]) -> f64 {
    let y = outputs(system, x, &still(system));
    y[3] + y[4] + y[5]
}

/// Lifted by 5 mm it heaves as a damped oscillator; pitched on ice it swings about its center of mass,
/// which has nothing to hold it there; wheels stand under their hubs.
#[test]
fn closed_form_heave_and_pitch() {
    let damping = 60.0;
    let robot = platform(four(TORQUE), true);
    let system = on(
        robot,
        brush(0.8, 15.0),
        vec![],
        &springs(STIFFNESS, damping),
    );
    let (mass, time) = (30.0, 0.7);
    let (k, c) = (4.0 * STIFFNESS, 4.0 * damping);
    let decay = c / (2.0 * mass);
    let rate = Scalar::sqrt(k / mass - decay * decay);
    let mut errors = Vec::new();
    let steps = [2e-3, 1e-3, 5e-4];
    for step in steps {
        let mut x = at(&system, [0.0; 3], Vec2::zero());
        x[system.attitude()] = 0.005;
        run(
            &system,
            &still(&system),
            step,
            (time / step).round() as u64,
            &mut x,
        );
        let (sin, cos) = Scalar::sin_cos(rate * time);
        let expected = 0.005 * Scalar::exp(-decay * time) * (cos + decay / rate * sin);
        errors.push((x[system.attitude()] - expected).abs());
        // It stays level, and where it is.
        assert!(x[0].abs() + x[system.attitude() + 2].abs() < 1e-12);
    }
    let order = slope(&steps, &errors);
    assert!((order - 2.0).abs() < 0.1, "{order} {errors:?}");
    // A thousandth of the 5 mm, by the second order at 1 ms and 3.5 Hz.
    assert!(errors[1] < 5e-6, "{errors:?}");

    // Gravity works against the springs: the wheels go aside under the center of mass.
    let robot = platform(four(TORQUE), true);
    let system = on(robot, brush(1e-9, 15.0), vec![], &springs(STIFFNESS, 0.0));
    let (_, _, up) = system.platform().balance();
    let inertia = PITCH + 28.0 * HEIGHT * HEIGHT + 4.0 * 0.5 * (0.04 + 0.01) - up * up / mass;
    let rate = Scalar::sqrt((4.0 * STIFFNESS * 0.04 - GRAVITY * (up - mass * 0.1)) / inertia);
    let mut x = at(&system, [0.0; 3], Vec2::zero());
    // Small, for the square of the angle is left out of the closed form.
    let tilt = 1e-4;
    x[system.attitude() + 2] = tilt;
    let time = 0.5;
    run(&system, &still(&system), 2e-4, 2500, &mut x);
    let (_, cos) = Scalar::sin_cos(rate * time);
    let off = (x[system.attitude() + 2] - tilt * cos).abs();
    // By the second order at 0.2 ms it is 1.2e-5 of the tilt.
    assert!(off < 5e-5 * tilt, "{off:e} {}", x[system.attitude() + 2]);
    // The center of mass stays over its place.
    let sway = x[0] + up / mass * x[system.attitude() + 2] - up / mass * tilt;
    assert!(sway.abs() < 5e-5 * tilt, "{sway:e}");
}

/// With its wheels off the ground it flies: a parabola, and momentum and energy of a free body that tumbles.
#[test]
fn closed_form_flight() {
    let robot = platform(four(TORQUE), false);
    let system = on(robot, brush(0.8, 15.0), vec![], &springs(STIFFNESS, 60.0));
    let a = system.attitude();
    let mut x = at(&system, [0.0; 3], vec2(1.5, 0.2));
    x[a] = 1.0;
    let v = system.layout().velocity();
    (x[v + 2], x[a + 3], x[a + 4], x[a + 5]) = (0.8, 0.3, 0.5, -0.4);
    let (mass, first, up) = system.platform().balance();
    let center = [first.x / mass, first.y / mass, up / mass];
    // Where the center of mass is, and how fast, in the world.
    let place = |x: &[f64]| {
        let (sin_roll, cos_roll) = Scalar::sin_cos(x[a + 1]);
        let (sin_pitch, cos_pitch) = Scalar::sin_cos(x[a + 2]);
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let turn = |[p, q, r]: [f64; 3]| {
            let (q, r) = (cos_roll * q - sin_roll * r, sin_roll * q + cos_roll * r);
            let (p, r) = (cos_pitch * p + sin_pitch * r, cos_pitch * r - sin_pitch * p);
            [cos * p - sin * q, sin * p + cos * q, r]
        };
        let arm = turn(center);
        let (w, h) = ([x[a + 4], x[a + 5], x[v + 2]], center);
        let swept = [
            w[1] * h[2] - w[2] * h[1],
            w[2] * h[0] - w[0] * h[2],
            w[0] * h[1] - w[1] * h[0],
        ];
        let speed = turn([x[v] + swept[0], x[v + 1] + swept[1], x[a + 3] + swept[2]]);
        ([x[0] + arm[0], x[1] + arm[1], x[a] + arm[2]], speed)
    };
    let (from, speed) = place(&x);
    let energy = stored(&system, &x);
    let input = still(&system);
    let (stepped, _) = integrate(&system, &x, &input, 0.3, Method::Rk4(1e-3));
    run(&system, &input, 1e-3, 300, &mut x);
    let time = 0.3;
    // The implicit method to its order, Runge's to its own: both by the same rates. Speeds and energy follow
    // with the rates of turning, below 3 per second, and the mass of 30 kg.
    for (x, close) in [(&x, 3e-6), (&stepped, 1e-10)] {
        let (to, left) = place(x);
        for k in 0..3 {
            let fall = if k == 2 { GRAVITY * time } else { 0.0 };
            let expected = from[k] + (speed[k] - 0.5 * fall) * time;
            assert!(
                (to[k] - expected).abs() < close,
                "{k}: {} {expected}",
                to[k]
            );
            assert!(
                (left[k] - speed[k] + fall).abs() < 3.0 * close,
                "{k}: {left:?}"
            );
        }
        let lost = x[system.layout().ledger() + 3];
        assert!((stored(&system, x) + lost - energy).abs() < 30.0 * close);
    }
}

/// Under a steady force ahead it squats, as the moment of its
/// inertia about the ground demands of its springs.
#[test]
fn closed_form_squat() {
    let robot = platform(four(TORQUE), true);
    let system = on(robot, brush(2.0, 200.0), vec![], &springs(STIFFNESS, 150.0));
    let a = system.attitude();
    let (mass, _, up) = system.platform().balance();
    let mut u = still(&system);
    let at_wrench = system.layout().wrench_input();
    let mut x = at(&system, [0.0; 3], vec2(1.0, 0.0));
    // The force that acts in the plane of the wheels leaves its moment to the springs.
    u[at_wrench] = 30.0;
    run(&system, &u, 1e-3, 4000, &mut x);
    let mut dx = vec![0.0; x.len()];
    system.derivative(&x, &u, &[1.0; 4], &mut dx);
    let speedup = dx[system.layout().velocity()];
    let pitch = x[a + 2];
    let (sin, cos) = Scalar::sin_cos(pitch);
    // About the point on the ground: springs, inertia along the chassis, weight that leans back.
    let stiff = 4.0 * STIFFNESS * 0.04;
    let damped = 4.0 * 150.0 * 0.04 * x[a + 5];
    let settles = stiff * sin / cos + damped - (up - mass * 0.1) * GRAVITY * sin + up * speedup;
    // Of 2.2 N·m: what the springs' ways bring about of the second power of the angle.
    assert!(settles.abs() < 5e-4, "{settles:e} {pitch} {speedup}");
    assert!(pitch < -3e-3, "{pitch}");
    let y = outputs(&system, &x, &u);
    let load = |i| y[system.layout().wheel_output(i, WheelOutput::Load)];
    let transfer = load(2) + load(3) - load(0) - load(1);
    // What accelerates it, and what it leans back.
    let leans = (up - mass * 0.1) * GRAVITY * sin;
    let expected = (up * speedup - leans) / 0.2;
    assert!(
        (transfer - expected).abs() < 2e-3 * expected,
        "{transfer} {expected}"
    );
}

/// Motors drive over waves on springs with dampers: what they supply is what height, springs and motion hold
/// and what is lost, to the second order of the method.
#[test]
fn order_ledger_on_springs() {
    let robot = platform(four(motor(5e-3)), false);
    let system = on(
        robot,
        brush(0.9, 12.0),
        waves(0.02),
        &springs(STIFFNESS, 80.0),
    );
    let mut u = still(&system);
    u[..4].copy_from_slice(&[8.0, 10.0, 8.0, 10.0]);
    let steps = [2e-3, 1e-3, 5e-4];
    let ledger = system.layout().ledger();
    let errors = steps.map(|step: f64| {
        let mut x = at(&system, [0.1, 0.2, 0.3], Vec2::zero());
        let before = stored(&system, &x);
        run(&system, &u, step, (2.0 / step).round() as u64, &mut x);
        let gained = stored(&system, &x) - before;
        assert!(x[ledger] > 20.0, "{}", x[ledger]);
        (gained - (x[ledger] - x[ledger + 1] - x[ledger + 2] - x[ledger + 3])).abs()
    });
    let order = slope(&steps, &errors);
    // Of 20 J and more: where the contacts let go the order is first for a step.
    assert!((1.6..2.6).contains(&order), "{order} {errors:?}");
    assert!(errors[1] < 0.02, "{errors:?}");
}

/// The implicit step and the rates at an instant are two ways to the same motion.
#[test]
fn peer_implicit_step_against_explicit_rates() {
    let robot = platform(four(motor(5e-3)), false);
    let tire = Tire::Slip {
        curve: appell_model::tire::Curve::Linear {
            friction: 0.9,
            stiffness: 4.0,
        },
        relaxation: 0.1,
        damping: 0.05,
    };
    let system = on(robot, tire, waves(0.02), &springs(STIFFNESS, 80.0));
    let mut u = still(&system);
    u[..4].copy_from_slice(&[8.0, 10.0, 8.0, 10.0]);
    let start = at(&system, [0.1, 0.2, 0.3], vec2(0.5, 0.0));
    let (exact, _) = integrate(&system, &start, &u, 0.4, Method::Rk4(5e-5));
    let steps = [1e-3, 5e-4, 2.5e-4];
    let errors = steps.map(|step: f64| {
        let mut x = start.clone();
        run(&system, &u, step, (0.4 / step).round() as u64, &mut x);
        let off = x.iter().zip(&exact).map(|(a, b)| (a - b).abs());
        // Contacts that swing fast in their relaxation are the most of it.
        off.fold(0.0, f64::max)
    });
    let order = slope(&steps, &errors);
    assert!((1.7..2.4).contains(&order), "{order} {errors:?}");
    assert!(errors[2] < 5e-4, "{errors:?}");
}

/// Braked on a slope, loads at rest are those of the flat level, and tires with stiction hold it.
#[test]
fn invariant_rest_on_a_slope() {
    let tilt = 10_f64.to_radians();
    let ground = Ground::plane(GRAVITY, tilt, 0.4);
    for tire in laws(0.8) {
        let mut wheels = four(TORQUE);
        for wheel in &mut wheels {
            wheel.brake = 100.0;
        }
        let robot = platform(wheels, false);
        let footing = Footing::new(&robot, Terrain::new(vec![]), ground.gravity_normal)
            .expect("it stands on four")
            .inclined(ground.gravity)
            .on_springs(&robot, &springs(STIFFNESS, 150.0));
        let even = Ground::flat(ground.gravity_normal);
        let system = Slip::new(robot.clone(), vec![tire; 4], even, Loads::Dynamic)
            .expect("a robot")
            .on(footing);
        let flat = Slip::new(robot, vec![tire; 4], ground, Loads::Dynamic).expect("a robot");
        let mut u = still(&system);
        u[system.layout().brake_input()] = 1.0;
        let mut x = at(&system, [0.2, 0.1, 1.1], Vec2::zero());
        let mut level = at(&flat, [0.2, 0.1, 1.1], Vec2::zero());
        run(&system, &u, 1e-3, 2000, &mut x);
        run(&flat, &u, 1e-3, 2000, &mut level);
        let before = x.clone();
        run(&system, &u, 1e-3, 4000, &mut x);
        let moved = vec2(x[0] - before[0], x[1] - before[1]);
        let moved = moved.dot(moved).sqrt();
        match tire {
            Tire::Coulomb { .. } => assert!(moved > 1e-3, "{moved:e}"),
            _ => assert!(moved < 1e-9, "{tire:?}: {moved:e}"),
        }
        let (y, z) = (outputs(&system, &x, &u), outputs(&flat, &level, &u));
        for i in 0..4 {
            let k = system.layout().wheel_output(i, WheelOutput::Load);
            // It leans by half a degree on its springs: gravity along it has more of a lever there.
            assert!((y[k] - z[k]).abs() < 1.0, "{i}: {} {}", y[k], z[k]);
        }
        let sum: f64 = (0..4)
            .map(|i| y[system.layout().wheel_output(i, WheelOutput::Load)])
            .sum();
        let weight = 30.0 * ground.gravity_normal;
        assert!((sum - weight).abs() < 1e-6 * weight, "{sum} {weight}");
    }
}

/// Ever stiffer springs come to the chassis that follows the ground: between the root and the first power of
/// what they give, as their dampers at seven tenths of the critical do and they. The step stays at 1 ms
/// where the springs would swing at 2 kHz.
#[test]
fn order_stiff_springs_follow_the_ground() {
    let robot = platform(four(motor(5e-3)), false);
    let uphill = Relief::Slope {
        uphill: heading(0.3),
        grade: 0.15,
    };
    let mut u = still(&on(
        robot.clone(),
        brush(0.9, 12.0),
        vec![],
        &springs(1.0, 1.0),
    ));
    u[..4].copy_from_slice(&[8.0, 10.0, 8.0, 10.0]);
    let footing = Footing::new(&robot, Terrain::new(vec![uphill.clone()]), GRAVITY);
    let rigid = Slip::new(
        robot.clone(),
        vec![brush(0.9, 12.0); 4],
        Ground::flat(GRAVITY),
        Loads::Dynamic,
    )
    .expect("a robot")
    .on(footing.expect("it stands on four"));
    let mut x = at(&rigid, [0.1, 0.2, 0.5], Vec2::zero());
    run(&rigid, &u, 1e-3, 1500, &mut x);
    let gives = [1e-5, 1e-6, 1e-7];
    let errors = gives.map(|give: f64| {
        let damping = 0.7 * 2.0 * Scalar::sqrt(7.5 / give);
        let springs = springs(1.0 / give, damping);
        let system = on(
            robot.clone(),
            brush(0.9, 12.0),
            vec![uphill.clone()],
            &springs,
        );
        let mut soft = at(&system, [0.1, 0.2, 0.5], Vec2::zero());
        run(&system, &u, 1e-3, 1500, &mut soft);
        appell_model::math::hypot(soft[0] - x[0], soft[1] - x[1])
    });
    let order = slope(&gives, &errors);
    assert!((0.5..1.1).contains(&order), "{order} {errors:?}");
    assert!(errors[2] < 3e-5, "{errors:?}");
}

/// Off an edge it flies, lands and comes to rest upright; before a wall it says so.
#[test]
fn invariant_jump_and_landing() {
    let edge = Relief::Ramp {
        at: vec2(1.0, 0.0),
        along: heading(0.0),
        rise: -0.3,
        length: 0.0,
    };
    let robot = platform(four(TORQUE), false);
    let system = on(
        robot,
        brush(0.8, 15.0),
        vec![edge],
        &springs(STIFFNESS, 200.0),
    );
    let a = system.attitude();
    let mut x = at(&system, [0.0; 3], vec2(2.0, 0.0));
    let mut implicit = Implicit::new(&system);
    let mut mode = vec![1.0; 4];
    let u = still(&system);
    let mut flew = false;
    for _ in 0..6000 {
        assert!(implicit.steps(&system, &u, 1e-3, 1, &mut x, &mut mode));
        assert_eq!(system.stand(&mut x), Standing::Stands);
        assert!(x.iter().all(|value| value.is_finite()));
        let y = outputs(&system, &x, &u);
        flew |= (0..4).all(|i| y[system.layout().wheel_output(i, WheelOutput::Load)] == 0.0);
    }
    assert!(flew);
    assert!(x[0] > 2.0 && (x[a] + 0.3).abs() < 1e-3, "{:?}", &x[a..]);
    assert!(x[a + 1].abs() + x[a + 2].abs() < 0.02, "{:?}", &x[a..]);
}

/// Hard springs on a washboard leave the ground at every crest; the forces are found all the same, also
/// where a wheel that hardly turns lands on the next.
#[test]
fn invariant_hard_springs_on_a_washboard() {
    let board = Relief::Wave {
        at: vec2(1.0, 0.0),
        along: heading(0.0),
        form: Form::Sine,
        amplitude: 0.01,
        period: 0.3,
        phase: 0.0,
        length: 6.0,
    };
    for (stiffness, damping) in [(5.5e4, 130.0), (5.5e4, 1000.0), (1e6, 500.0), (3e3, 3000.0)] {
        let mut wheels = four(TORQUE);
        // Without inertia of its own: in sliding next to nothing holds it.
        wheels[1].spin_inertia = 0.0;
        let robot = platform(wheels, false);
        let suspension = springs(stiffness, damping);
        let system = on(robot, brush(0.9, 12.0), vec![board.clone()], &suspension);
        let mut x = at(&system, [0.0; 3], vec2(3.0, 0.0));
        let mut implicit = Implicit::new(&system);
        let mut mode = vec![1.0; 4];
        let u = still(&system);
        let mut least = f64::MAX;
        for step in 0..2500 {
            let found = implicit.steps(&system, &u, 1e-3, 1, &mut x, &mut mode);
            // In the air it is held, as a brake would.
            x[system.rate(1)] *= if step % 40 == 0 { 0.1 } else { 1.0 };
            assert!(found, "{stiffness} {damping} step {step}");
            assert_eq!(system.stand(&mut x), Standing::Stands);
            let y = outputs(&system, &x, &u);
            least = least.min(y[system.layout().wheel_output(0, WheelOutput::Load)]);
        }
        assert!(least == 0.0 && x[0] > 4.0, "{least} {}", x[0]);
    }
}
