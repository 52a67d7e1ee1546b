//! The kinematic single-track vehicle: a fixed rear axle and a steered front wheel.

use crate::common::SLEIGH;
use appell_model::drive::Drive;
use appell_model::dynamics::Dynamics;
use appell_model::kinematic::Kinematic;
use appell_model::planar::vec2;
use appell_model::platform::{Platform, YAW};
use appell_model::wheel::{Steering, Wheel};

/// A bicycle of wheelbase 1.1561957064 + 1.4227170936 m, wheels of 1 m, driven at the rear.
fn bicycle() -> Platform<f64> {
    let like = SLEIGH.platform().wheels()[0].clone();
    let wheel = |name: &str, x: f64, steering, drive| Wheel {
        name: name.into(),
        mount: vec2(x, 0.0),
        radius: 1.0,
        steering,
        drive,
        ..like.clone()
    };
    let rear = Drive::Rate {
        rate_max: f64::INFINITY,
    };
    Platform::new(
        *SLEIGH.platform().body(),
        vec![
            wheel("rear", 0.0, Steering::Fixed { angle: 0.0 }, rear),
            wheel(
                "front",
                1.156_195_706_4 + 1.422_717_093_6,
                Steering::Driven,
                Drive::None,
            ),
        ],
    )
    .expect("a bicycle")
}

/// The published derivative of CommonRoad's kinematic single-track model (M. Althoff, M. Koschi,
/// S. Manzinger, *CommonRoad: composable benchmarks for motion planning on roads*, IEEE IV 2017;
/// vehicle 2, a BMW 320i, test of the package's derivatives): position of the rear axle, steering
/// angle, speed and heading, to 13 digits. Its speed is an input here.
#[test]
fn known_answer_commonroad_kinematic_single_track() {
    let [x, y, steering, speed, yaw] = [
        3.957_942_229_793_652_6,
        0.039_165_010_277_140_5,
        0.037_849_142_721_181_1,
        16.354_695_786_088_357,
        0.029_471_735_105_281_6,
    ];
    let expected = [
        16.347_593_593_425_02,
        0.481_931_488_601_312_1,
        0.15,
        0.240_142_657_862_762_9,
    ];
    let system = Kinematic::new(bicycle()).expect("driven");
    let layout = system.platform().layout().clone();
    let (mut state, mut u) = (vec![0.0; layout.state()], vec![0.0; layout.input()]);
    (state[0], state[1], state[YAW]) = (x, y, yaw);
    state[layout.swivel(0)] = steering;
    system.platform().renew_angles(&mut state);
    // The rear wheel's radius is 1 m.
    u[0] = speed;
    u[layout.steering_input()] = 0.15;
    let mut rate = vec![0.0; layout.state()];
    system.derivative(&state, &u, &[1.0, 1.0], &mut rate);
    let found = [rate[0], rate[1], rate[layout.swivel(0)], rate[YAW]];
    for (found, expected) in found.into_iter().zip(expected) {
        // Thirteen digits.
        assert!(
            (found - expected).abs() < 1e-13 * expected.abs().max(1.0),
            "{found} for {expected}"
        );
    }
}

/// CommonRoad's kinematic single track with a trailer on the rear axle (KST; the package
/// `commonroad-vehicle-models` 3.0.2, `test_kst`; vehicle 4, a semi-trailer truck with wheelbases of
/// 3.6 m and 8.1 m): rates of place, steering, heading and hitch angle, to 13 digits.
#[test]
fn known_answer_commonroad_trailer() {
    let mut wheels = bicycle().wheels().to_vec();
    wheels[1].mount.x = 3.6;
    wheels.push(Wheel {
        name: "trailer".into(),
        steering: Steering::Free { trail: 8.1 },
        drive: Drive::None,
        ..wheels[0].clone()
    });
    let platform = Platform::new(*SLEIGH.platform().body(), wheels).expect("a truck");
    let system = Kinematic::new(platform).expect("driven");
    let layout = system.platform().layout().clone();
    let (mut state, mut u) = (vec![0.0; layout.state()], vec![0.0; layout.input()]);
    (state[0], state[1], state[YAW]) = (
        3.957_942_229_793_652_6,
        0.039_165_010_277_140_5,
        0.029_471_735_105_281_6,
    );
    state[layout.swivel(0)] = 0.037_849_142_721_181_1;
    state[layout.swivel(1)] = 0.029_471_735_105_281_6;
    system.platform().renew_angles(&mut state);
    u[0] = 16.354_695_786_088_357;
    u[layout.steering_input()] = 0.15;
    let mut rate = vec![0.0; layout.state()];
    system.derivative(&state, &u, &[1.0; 3], &mut rate);
    for (index, expected) in [
        (0, 16.347_593_593_425_02),
        (1, 0.481_931_488_601_312_1),
        (layout.swivel(0), 0.15),
        (YAW, 0.172_029_715_052_305_5),
        (layout.swivel(1), -0.231_527_429_694_442_76),
    ] {
        // Thirteen digits.
        let off: f64 = rate[index] - expected;
        assert!(
            off.abs() < 1e-13 * expected.abs().max(1.0),
            "{index} {off:e}"
        );
    }
}

/// A car: fixed rear wheels, the left front wheel steered, the right one guided by an ideal linkage.
fn car(left: f64, right: f64) -> Platform<f64> {
    let like = SLEIGH.platform().wheels()[0].clone();
    let rear = Drive::Rate {
        rate_max: f64::INFINITY,
    };
    let wheel = |name: &str, mount: [f64; 2], steering, drive| Wheel {
        name: name.into(),
        mount: vec2(mount[0], mount[1]),
        radius: 0.3,
        steering,
        drive,
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 0.0,
        ..like.clone()
    };
    let fixed = Steering::Fixed { angle: 0.0 };
    let mut wheels = vec![
        wheel("rear left", [-0.2, 0.7], fixed, rear),
        wheel("rear right", [-0.2, -0.7], fixed, rear),
        wheel("front left", [2.3, left], Steering::Driven, Drive::None),
        wheel(
            "front right",
            [2.2, right],
            Steering::Guided { lead: 2 },
            Drive::None,
        ),
    ];
    wheels[2].inertia_vertical = 0.1;
    Platform::new(*SLEIGH.platform().body(), wheels).expect("a car")
}

/// The ideal linkage: the axles of all wheels meet in one point whatever the steering, so that the
/// contact of the guided wheel does not slip; and its angle's rate is that of its formula.
#[test]
fn invariant_guided_wheels_do_not_slip() {
    use appell_model::wheel::contact_velocity;
    let platform = car(0.7, -0.7);
    let system = Kinematic::new(platform.clone()).expect("driven");
    let layout = platform.layout().clone();
    let at = |steering: f64, rate: f64| {
        let (mut x, mut u) = (vec![0.0; layout.state()], vec![0.0; layout.input()]);
        x[layout.swivel(0)] = steering;
        platform.renew_angles(&mut x);
        (u[0], u[1]) = (5.0, 5.0);
        u[layout.steering_input()] = rate;
        (x, u)
    };
    for steering in [-0.7, -0.3, -0.01, 0.0, 0.2, 0.8] {
        let (x, u) = at(steering, 0.4);
        let v = system.velocity(&x, &u);
        let (velocity, turn) = platform.twist(&v);
        let frame = platform.wheel_frame(3, &x);
        let spin = platform.spin_rate(3, &frame, velocity, turn);
        let slip = contact_velocity(&platform.wheels()[3], &frame, velocity, turn, 0.0, spin);
        // Velocities of meters per second, through a solve of size three.
        assert!(slip.x.abs() < 1e-14 && slip.y.abs() < 1e-14, "{slip:?}");
        let mut dx = vec![0.0; layout.state()];
        system.derivative(&x, &u, &[1.0; 4], &mut dx);
        let h = 1e-6;
        let angle = |steering: f64| at(steering, 0.0).0[layout.swivel(1)];
        let slope = (angle(steering + h) - angle(steering - h)) / (2.0 * h);
        // The error of the difference quotient, 1e-10.
        assert!((dx[layout.swivel(1)] - 0.4 * slope).abs() < 1e-9);
    }
}

/// Steady cornering: radius of the rear axle L / tan γ, of the front wheel L / sin γ, yaw rate
/// v tan γ / L.
#[test]
fn known_answer_steady_cornering() {
    let system = Kinematic::new(bicycle()).expect("driven");
    let layout = system.platform().layout().clone();
    let base = 1.156_195_706_4 + 1.422_717_093_6;
    for steering in [-0.9_f64, -0.2, 0.05, 0.6, 1.2] {
        let (mut state, mut u) = (vec![0.0; layout.state()], vec![0.0; layout.input()]);
        state[layout.swivel(0)] = steering;
        system.platform().renew_angles(&mut state);
        u[0] = 2.0;
        let mut y = vec![0.0; layout.output()];
        system.output(&state, &u, &[1.0, 1.0], &mut y);
        let (sin, cos) = appell_model::scalar::Scalar::sin_cos(steering);
        assert!((y[2] - 2.0 * sin / cos / base).abs() < 1e-14);
        let front = layout.wheel_output(1, appell_model::platform::WheelOutput::SpinRate);
        // The front wheel rolls faster, as its circle is larger.
        assert!((y[front] - 2.0 / cos).abs() < 1e-13);
    }
}
