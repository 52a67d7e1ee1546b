//! The wheel-legged robot: its center of mass, its simplifications, and its strategies.

use appell_model::drive::Drive;
use appell_model::dual::Dual;
use appell_model::dynamics::{Dynamics, Input};
use appell_model::integrate::{Adaptive, RungeKutta4};
use appell_model::kinematic::Kinematic;
use appell_model::lanes::Lanes4;
use appell_model::planar::vec2;
use appell_model::platform::{Platform, YAW};
use appell_model::scalar::Scalar;
use appell_model::wheel::{Steering, Wheel};
use appell_model::wheel_legged::obstacle::{Limits, Obstacle, Strategy, decide};
use appell_model::wheel_legged::{RearSteering, WheelLegged};

use crate::common::SLEIGH;

const FRONT: f64 = 0.3;
const REAR: f64 = 0.35;

fn robot<T: Scalar>(rear_steering: RearSteering) -> WheelLegged<T> {
    WheelLegged {
        front: T::from(FRONT),
        rear: T::from(REAR),
        rear_steering,
    }
}

/// Speed, front and rear steering that vary.
struct Weaving;

impl<T: Scalar> Input<T> for Weaving {
    fn at(&self, t: f64, u: &mut [T]) {
        let wave = |rate: f64| Scalar::sin_cos(rate * t).0;
        u[0] = T::from(0.5 + 0.2 * wave(0.7));
        u[1] = T::from(0.4 * wave(1.1));
        u[2] = T::from(-0.3 * wave(0.9));
    }
}

/// The general model of wheels, with a driven rear wheel and both steered, has the same twist: its
/// base is B, on the rear axle.
#[test]
fn peer_general_kinematic_model() {
    let like = SLEIGH.platform().wheels()[0].clone();
    let wheel = |name: &str, x: f64, drive| Wheel {
        name: name.into(),
        mount: vec2(x, 0.0),
        radius: 0.1,
        steering: Steering::Driven,
        drive,
        ..like.clone()
    };
    let rear = Drive::Rate {
        rate_max: f64::INFINITY,
    };
    let platform = Platform::new(
        *SLEIGH.platform().body(),
        vec![
            wheel("rear", 0.0, rear),
            wheel("front", FRONT + REAR, Drive::None),
        ],
    )
    .expect("two wheels");
    let general = Kinematic::new(platform).expect("driven");
    let layout = general.platform().layout().clone();
    for [speed, front, rear] in [
        [0.5, 0.3, 0.0],
        [0.7, -0.5, 0.4],
        [-0.4, 0.2, 0.2],
        [1.0, 0.1, -0.6],
    ] {
        let (mut x, mut u) = (vec![0.0; layout.state()], vec![0.0; layout.input()]);
        x[YAW] = 0.8;
        (x[layout.swivel(0)], x[layout.swivel(1)]) = (rear, front);
        general.platform().renew_angles(&mut x);
        u[0] = speed / 0.1;
        let (at_rear, turn) = general.platform().twist(&general.velocity(&x, &u));
        let (center, yaw_rate) = robot::<f64>(RearSteering::Exact).twist(speed, front, rear);
        // Speeds of meters per second, through a solve of size three.
        assert!((turn - yaw_rate).abs() < 1e-13, "{turn} {yaw_rate}");
        assert!((at_rear.x - center.x).abs() < 1e-13);
        assert!((at_rear.y + REAR * turn - center.y).abs() < 1e-13);
    }
}

/// With constant steering B goes round a circle of radius l cot α and the center of mass round one of
/// √(l² cot² α + l₂²).
#[test]
fn closed_form_circle() {
    let system = robot::<f64>(RearSteering::Exact);
    let u = [0.5, 0.3, 0.0];
    let (sin, cos) = Scalar::sin_cos(0.3);
    let radius = (FRONT + REAR) * cos / sin;
    let mut y = [0.0; 6];
    system.output(&[0.0; 3], &u, &[], &mut y);
    assert!((y[4] - 0.5 / radius).abs() < 1e-15);
    let speed = appell_model::math::hypot(y[2], y[3]);
    let around = (radius * radius + REAR * REAR).sqrt();
    assert!((speed - y[4] * around).abs() < 1e-15);
    // Both axles move along the body alike.
    assert!((y[5] * cos - 0.5).abs() < 1e-15);
}

/// Without rear steering the exact form is the simple one, bit for bit, and the constraint (4) holds;
/// a small rear angle makes the simple one err by V β/l to first order.
#[test]
fn order_of_the_neglected_rear_angle() {
    let (exact, simple) = (
        robot::<f64>(RearSteering::Exact),
        robot::<f64>(RearSteering::Neglected),
    );
    let rates = |system: &WheelLegged<f64>, rear: f64| {
        let mut dx = [0.0; 3];
        system.derivative(&[0.0, 0.0, 0.7], &[0.6, 0.3, rear], &[], &mut dx);
        dx
    };
    assert_eq!(rates(&exact, 0.0), rates(&simple, 0.0));
    assert_eq!(rates(&simple, 0.2), rates(&simple, 0.0));
    assert!(simple.rear_side_speed(0.7, rates(&simple, 0.0)).abs() < 1e-16);
    let side = exact.rear_side_speed(0.7, rates(&exact, 0.2));
    assert!((side - 0.6 * Scalar::sin_cos(0.2_f64).0).abs() < 1e-15);
    let error = |rear: f64| rates(&simple, rear)[2] - rates(&exact, rear)[2];
    // The next term is V tan α β²/(2 l), a sixth of it at 0.01.
    for rear in [0.01, 0.001] {
        let first = 0.6 * rear / (FRONT + REAR);
        assert!((error(rear) - first).abs() < 0.5 * rear * first, "{rear}");
    }
}

/// The yaw acceleration is the derivative of the yaw rate along the inputs, (5) without rear steering.
#[test]
fn invariant_yaw_acceleration() {
    let (inputs, rates) = ([0.6, 0.3, -0.2], [0.15, 0.4, 0.25]);
    for rear_steering in [RearSteering::Exact, RearSteering::Neglected] {
        let along = |k: usize| Dual::<f64, 1> {
            value: inputs[k],
            derivative: [rates[k]],
        };
        let (_, turn) = robot::<Dual<f64, 1>>(rear_steering).twist(along(0), along(1), along(2));
        let found = robot::<f64>(rear_steering).yaw_acceleration(inputs, rates);
        assert!((turn.derivative[0] - found).abs() < 1e-15);
    }
    let (sin, cos) = Scalar::sin_cos(0.3_f64);
    let published = (0.15 * sin / cos + 0.6 * 0.4 / (cos * cos)) / (FRONT + REAR);
    let found = robot::<f64>(RearSteering::Neglected).yaw_acceleration(inputs, rates);
    assert!((published - found).abs() < 1e-15);
}

/// One step of Runge–Kutta 4 after the other in three scalars: the same bits. And of fourth order.
#[test]
fn invariant_scalars_agree_on_the_wheel_legged_robot() {
    fn drive<T: Scalar>(count: usize) -> Vec<T> {
        let system = robot::<T>(RearSteering::Exact);
        let mut method = RungeKutta4::new(3, 3);
        let mut x = vec![T::zero(); 3];
        let dt = 4.0 / count as f64;
        for k in 0..count {
            method.step(&system, &Weaving, k as f64 * dt, dt, &mut x, &mut []);
        }
        x
    }
    let plain = drive::<f64>(400);
    let (lanes, duals) = (drive::<Lanes4>(400), drive::<Dual<f64, 1>>(400));
    for k in 0..3 {
        assert_eq!(duals[k].value.to_bits(), plain[k].to_bits());
        for lane in 0..4 {
            assert_eq!(lanes[k].lane(lane).to_bits(), plain[k].to_bits());
        }
    }
    let system = robot::<f64>(RearSteering::Exact);
    let mut exact = vec![0.0; 3];
    let mut method = Adaptive::new(&system, 1e-13, 1e-14);
    method
        .advance(&system, &Weaving, 0.0, 4.0, &mut exact, &mut [], None)
        .expect("smooth");
    let error = |x: &[f64]| (0..3).map(|k| (x[k] - exact[k]).abs()).fold(0.0, f64::max);
    let ratio = error(&drive::<f64>(40)) / error(&drive::<f64>(80));
    // 2⁴, within what the fifth order adds at a tenth of a second.
    assert!((13.0..19.0).contains(&ratio), "{ratio}");
}

/// The boundaries belong to the milder strategy; harder obstacles are never met more lightly.
#[test]
fn known_answer_strategies() {
    let limits = Limits::PUBLISHED;
    assert!((limits.outer_length() - 0.43).abs() < 1e-15);
    let step = |height: f64| decide(&Obstacle::Step { height }, &limits).strategy;
    let trench =
        |width: f64, depth: f64| decide(&Obstacle::Trench { width, depth }, &limits).strategy;
    assert_eq!(
        [0.0, 0.1, 0.1001, 0.25, 0.2501].map(step),
        [
            Strategy::Direct,
            Strategy::Direct,
            Strategy::ClimbStep,
            Strategy::ClimbStep,
            Strategy::Turn
        ]
    );
    assert_eq!(trench(5.0, 0.1), Strategy::Direct);
    assert_eq!(trench(0.23, 9.0), Strategy::BridgeTrench);
    assert_eq!(trench(0.2301, 0.25), Strategy::DescendClimb);
    assert_eq!(trench(0.2301, 0.2501), Strategy::Turn);
    let reason = decide(&Obstacle::Step { height: 0.3 }, &limits)
        .reason
        .to_string();
    assert_eq!(
        reason,
        "its height of 0.3 m is above the 0.25 m that the legs climb"
    );
}
