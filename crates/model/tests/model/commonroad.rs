//! Single-track vehicles: published derivatives, steady cornering, and the way between the models.
//!
//! States, inputs, figures and parameters of vehicle 2, a BMW 320i, and of its tires: the package
//! `commonroad-vehicle-models` 3.0.2 (M. Althoff, G. Würsching), `unit_tests/test_derivatives.py`,
//! `parameters_vehicle2.yaml` and `parameters_tire.yaml`.

use appell_model::drive::Drive;
use appell_model::dual::Dual;
use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform};
use appell_model::scalar::Scalar;
use appell_model::single_track::{
    Chassis, DriftTrack, DynamicTrack, HEADING, KinematicTrack, Limits, SIDESLIP, SPEED, STEERING,
    YAW_RATE,
};
use appell_model::slip::{Implicit, Loads, Slip};
use appell_model::tire::combined::{Axis, Combined, Induced, Reading, Weight};
use appell_model::tire::{Curve, Tire};
use appell_model::wheel::{Rim, Steering, Wheel};

use crate::common::{Method, integrate};

/// Steering rate 0.15 rad/s, acceleration 0.63 g, more than the engine has.
const INPUT: [f64; 2] = [0.15, 0.63 * 9.81];

/// What the published program takes for the height of the center of mass: that of the sprung mass
/// (its text has 0.5748689544000001 m, of the whole).
const SPRUNG: f64 = 0.613_730_04;

fn limits<T: Scalar>() -> Limits<T> {
    Limits {
        steering: [T::from(-1.066), T::from(1.066)],
        steering_rate: [T::from(-0.4), T::from(0.4)],
        speed: [T::from(-13.9), T::from(50.8)],
        acceleration_max: T::from(11.5),
        speed_switch: T::from(7.319),
    }
}

fn chassis<T: Scalar>(height: f64) -> Chassis<T> {
    Chassis {
        front: T::from(1.156_195_706_4),
        rear: T::from(1.422_717_093_6),
        height: T::from(height),
        mass: T::from(1_093.295_233_467_404_6),
        inertia: T::from(1_791.599_530_012_285_6),
        gravity: T::from(9.81),
    }
}

/// Unlimited, with slip stiffnesses per load of front and rear.
fn linear<T: Scalar>(stiffness: [f64; 2]) -> [Curve<T>; 2] {
    stiffness.map(|stiffness| Curve::Linear {
        friction: T::from(f64::INFINITY),
        stiffness: T::from(stiffness),
    })
}

/// The single track of vehicle 2: μ C_S is the tires' p_Ky1 on both axles.
fn dynamic<T: Scalar>(height: f64, limits: Limits<T>) -> DynamicTrack<T> {
    DynamicTrack {
        chassis: chassis(height),
        tires: linear([21.92, 21.92]),
        limits,
    }
}

fn tire<T: Scalar>(reading: Reading) -> Combined<T> {
    Combined {
        along: Axis {
            friction: T::from(1.1739),
            stiffness: T::from(22.303),
            shape: T::from(1.6411),
            curvature: T::from(0.46403),
            slip_shift: T::from(0.0012297),
            force_shift: T::from(-8.8098e-06),
            weight: Weight {
                stiffness: T::from(13.276),
                decline: T::from(-13.778),
                decline_shift: T::from(0.0),
                shape: T::from(1.2568),
                curvature: T::from(0.65225),
                slip_shift: T::from(0.0050722),
            },
        },
        // Its shifts vanish without camber.
        across: Axis {
            friction: T::from(1.0489),
            stiffness: T::from(-21.92),
            shape: T::from(1.3507),
            curvature: T::from(-0.0074722),
            slip_shift: T::from(0.0),
            force_shift: T::from(0.0),
            weight: Weight {
                stiffness: T::from(7.1433),
                decline: T::from(9.1916),
                decline_shift: T::from(-0.027856),
                shape: T::from(1.0719),
                curvature: T::from(-0.27572),
                slip_shift: T::from(5.7448e-06),
            },
        },
        induced: Induced {
            share: T::from(-0.027825),
            decline: T::from(12.12),
            shape: T::from(1.9),
            stiffness: T::from(-10.704),
        },
        reading,
    }
}

fn drift<T: Scalar>(height: f64, tire: Combined<T>) -> DriftTrack<T> {
    DriftTrack {
        chassis: chassis(height),
        tire,
        radius: T::from(0.344),
        spin_inertia: T::from(1.7),
        brake_share: T::from(0.66),
        engine_share: T::from(0.0),
        limits: limits(),
    }
}

fn rate<T: Scalar>(system: &impl Dynamics<T>, x: &[T], u: &[T]) -> Vec<T> {
    let mut dx = vec![T::zero(); system.sizes().state];
    system.derivative(x, u, &[], &mut dx);
    dx
}

/// Thirteen digits, and 1e-13 of numbers below 1.
fn assert_digits(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (one, other) in found.iter().zip(expected) {
        let off = (one - other).abs();
        assert!(
            off < 1e-13 * other.abs().max(1.0),
            "{found:?} for {expected:?}"
        );
    }
}

/// The state that the figures of ST and STD are given for.
const STATE: [f64; 9] = [
    2.023_334_814_206_567_7,
    0.004_190_713_771_663_6,
    0.019_754_524_855_961_7,
    15.721_623_633_429_012,
    0.002_585_791_477_685_9,
    0.052_900_105_665_403_8,
    0.003_301_217_061_029_8,
    53.655_171_064_108_245,
    56.791_791_178_421_96,
];

/// KS: `test_ks`. The acceleration is what power leaves of the one asked for.
#[test]
fn known_answer_commonroad_kinematic() {
    let system = KinematicTrack {
        wheelbase: chassis::<f64>(0.0).wheelbase(),
        limits: limits(),
    };
    let x = [
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
        5.146_442_410_233_975,
        0.240_142_657_862_762_9,
    ];
    assert_digits(&rate(&system, &x, &INPUT), &expected);
}

/// ST: `test_st`, for which the height is that of the sprung mass.
#[test]
fn known_answer_commonroad_dynamic() {
    let expected = [
        15.721_351_203_086_24,
        0.092_552_797_971_935_5,
        0.15,
        5.353_677_327_641_392_5,
        0.052_900_105_665_403_8,
        0.643_558_939_774_860_6,
        0.031_329_797_164_129_1,
    ];
    let found = rate(&dynamic(SPRUNG, limits()), &STATE[..7], &INPUT);
    assert_digits(&found, &expected);
    // With the height of the text's table 4 the figures differ in the second digit.
    let text = rate(&dynamic(0.574_868_954_4, limits()), &STATE[..7], &INPUT);
    assert!((text[YAW_RATE] - expected[YAW_RATE]).abs() > 5e-3);
}

/// STD: `test_std`. These figures are of a program without load transfer, that is of height 0, and of
/// its reading of the tire's formulas.
#[test]
fn known_answer_commonroad_drift() {
    let expected = [
        15.721_351_203_086_24,
        0.092_552_797_971_935_51,
        0.15,
        11.359_186_518_121_511,
        0.052_900_105_665_403_8,
        0.587_089_469_442_836_2,
        -0.007_910_389_538_735_838,
        -1_403.483_354_651_399_6,
        72.253_138_723_075_31,
    ];
    let found = rate(&drift(0.0, tire(Reading::Program)), &STATE, &INPUT);
    assert_digits(&found, &expected);
}

/// STD of the same package's program as it stands, which has load transfer since and no longer gives its
/// own figures: run on the state of `test_std`.
#[test]
fn peer_commonroad_drift_with_load_transfer() {
    let expected = [
        15.721_351_203_086_24,
        0.092_552_797_971_935_51,
        0.15,
        11.340_113_304_616_798,
        0.052_900_105_665_403_8,
        0.466_681_022_626_497,
        -0.020_370_001_802_542_31,
        -1_072.466_525_346_979_8,
        -253.944_868_283_065_55,
    ];
    let found = rate(&drift(SPRUNG, tire(Reading::Program)), &STATE, &INPUT);
    assert_digits(&found, &expected);
}

/// Where text and program of the drift model differ: S_Vx is a force of 0.05 N in one and turns the
/// phase of the sine by 0.05 rad in the other, so that a wheel at its horizontal shift pulls with
/// hundreds of newtons; and the force along the axle that κ induces has the other sign.
#[test]
fn known_answer_readings_of_the_drift_model() {
    let load = 6000.0;
    let at = |reading, slip| tire(reading).force(slip, 0.0, load);
    // κ = −S_Hx: pure slip vanishes.
    let [text, program] = [Reading::Text, Reading::Program].map(|r| at(r, 0.0012297).x);
    let shift = -8.8098e-06 * load;
    // The weight at α = 0 is 1.
    assert!((text - shift).abs() < 1e-9, "{text}");
    let phase = 1.1739 * load * Scalar::sin_cos(shift).0;
    // Rounding of a force of 400 N.
    assert!(
        (program - phase).abs() < 1e-10 && program < -370.0,
        "{program}"
    );
    let [text, program] = [Reading::Text, Reading::Program].map(|r| at(r, 0.1).y);
    assert!(
        (text + program).abs() < 1e-10 && text.abs() > 50.0,
        "{text} {program}"
    );
}

/// Rolling below 0.1 m/s: β̇ and ψ̈ are the rates of tan β = tan δ l_r/L and of ψ̇ = v cos β tan δ/L, by
/// derivatives of those; the published program has the square on the tangent within β̇.
#[test]
fn closed_form_rates_of_rolling() {
    let Chassis { rear, .. } = chassis::<f64>(0.0);
    let base = chassis::<f64>(0.0).wheelbase();
    for (steering, speed) in [(0.3, 0.05), (-0.9, 0.02), (0.7, -0.08)] {
        let delta = Dual::<f64, 1> {
            value: steering,
            derivative: [0.2],
        };
        let v = Dual::<f64, 1> {
            value: speed,
            derivative: [0.6],
        };
        let of = |value: f64| Dual::<f64, 1>::from(value);
        let (sin, cos) = delta.sin_cos();
        let sideslip = (sin / cos * of(rear / base)).atan();
        let yaw_rate = v * sideslip.sin_cos().1 * sin / (cos * of(base));
        let x = [
            0.0,
            0.0,
            steering,
            speed,
            0.4,
            yaw_rate.value,
            sideslip.value,
        ];
        let dx = rate(&dynamic(0.5, Limits::none()), &x, &[0.2, 0.6]);
        // A few roundings of numbers below 1.
        assert!((dx[HEADING] - yaw_rate.value).abs() < 1e-15);
        assert!((dx[YAW_RATE] - yaw_rate.derivative[0]).abs() < 1e-15);
        assert!((dx[SIDESLIP] - sideslip.derivative[0]).abs() < 1e-15);
        let tan = sin.value / cos.value;
        let squared = tan * tan * rear / base;
        let published = rear / base * 0.2 / (cos.value * cos.value * (1.0 + squared * squared));
        assert!((published - sideslip.derivative[0]).abs() > 1e-3);
    }
}

/// Steady cornering of the linear single track with the friction of the axles apart: yaw rate
/// v δ/(L + K v²), K = (m/L)(b/C_f − a/C_r), sideslip (b/L − a m v²/(L² C_r)) δ/(1 + K v²/L); and where
/// it oversteers, the matrix of the motion is singular at √(−L/K).
#[test]
fn closed_form_steady_cornering() {
    for grip in [[1.0, 1.0], [0.8, 1.0], [1.0, 0.85]] {
        let stiffness = grip.map(|grip| 21.92 * grip);
        let system = DynamicTrack {
            tires: linear(stiffness),
            ..dynamic(SPRUNG, Limits::none())
        };
        let Chassis {
            front: a,
            rear: b,
            mass: m,
            ..
        } = system.chassis;
        let base = a + b;
        let load = system.chassis.loads(0.0);
        let [front, rear] = [0, 1].map(|k| stiffness[k] * load[k]);
        let gradient = m / base * (b / front - a / rear);
        for v in [5.0, 15.0, 30.0] {
            let mut x = [0.0; 7];
            (x[STEERING], x[SPEED]) = (0.02, v);
            let (x, _) = integrate(&system, &x, &[0.0, 0.0], 40.0, Method::Rk4(0.01));
            let stretch = gradient.mul_add(v * v, base);
            let yaw_rate = v * 0.02 / stretch;
            let sideslip = (b - a * m * v * v / (base * rear)) * 0.02 / stretch;
            // Forty seconds are at least sixty time constants; what is left are roundings.
            assert!((x[YAW_RATE] - yaw_rate).abs() < 1e-14, "{v}");
            assert!((x[SIDESLIP] - sideslip).abs() < 1e-14, "{v}");
        }
        if gradient < -1e-6 {
            let critical = (-base / gradient).sqrt();
            let column = |index: usize| {
                let mut x = [0.0; 7];
                (x[SPEED], x[index]) = (critical, 1.0);
                rate(&system, &x, &[0.0, 0.0])
            };
            let (yaw, side) = (column(YAW_RATE), column(SIDESLIP));
            let determinant = yaw[YAW_RATE] * side[SIDESLIP] - yaw[SIDESLIP] * side[YAW_RATE];
            // The products are near 10, and cancel.
            assert!(determinant.abs() < 1e-13, "{determinant:e}");
        }
    }
}

/// In reverse a disturbance of a neutral vehicle dies out as it does ahead; forces that push with the
/// slip, as the published form has them, would make it grow.
#[test]
fn invariant_reverse_is_damped() {
    let system = dynamic(SPRUNG, Limits::none());
    for v in [-8.0, -2.0, 2.0, 8.0] {
        let mut x = [0.0; 7];
        (x[SPEED], x[YAW_RATE], x[SIDESLIP]) = (v, 0.01, -0.02);
        let column = |index: usize| {
            let mut x = [0.0; 7];
            (x[SPEED], x[index]) = (v, 1.0);
            rate(&system, &x, &[0.0, 0.0])[index]
        };
        // Forces alone are in the trace, so that it is positive where their sign is the other one.
        assert!(column(YAW_RATE) + column(SIDESLIP) < -40.0);
        let (x, _) = integrate(&system, &x, &[0.0, 0.0], 4.0, Method::Rk4(1e-3));
        let left = x[YAW_RATE].abs() + x[SIDESLIP].abs();
        // e^{-4 · 20 s⁻¹} at the slowest rate of some 20 per second.
        assert!(left < 1e-12, "{v} {left:e}");
    }
}

/// The drift model without shifts, with wheels that roll, at small angles is the linear single track of
/// the same stiffness: by symmetry what differs is of third order.
#[test]
fn order_drift_towards_linear() {
    let mut plain = tire(Reading::Text);
    (plain.along.slip_shift, plain.along.force_shift) = (0.0, 0.0);
    plain.along.weight.slip_shift = 0.0;
    let (system, limit) = (drift(SPRUNG, plain), dynamic(SPRUNG, limits()));
    let apart = |scale: f64| {
        let mut x = STATE;
        for index in [STEERING, YAW_RATE, SIDESLIP] {
            x[index] *= scale;
        }
        // Wheels that roll along their own planes, so that nothing but side force is left.
        let (sin, cos) = Scalar::sin_cos(x[SIDESLIP]);
        let (sin_steering, cos_steering) = Scalar::sin_cos(x[STEERING]);
        let side = system.chassis.front.mul_add(x[YAW_RATE], x[SPEED] * sin);
        x[7] = (x[SPEED] * cos * cos_steering + side * sin_steering) / system.radius;
        x[8] = x[SPEED] * cos / system.radius;
        let (drift, linear) = (rate(&system, &x, &[0.0; 2]), rate(&limit, &x, &[0.0; 2]));
        [YAW_RATE, SIDESLIP].map(|index| (drift[index] - linear[index]).abs())
    };
    let (coarse, fine) = (apart(0.1), apart(0.05));
    for (coarse, fine) in coarse.into_iter().zip(fine) {
        // The next term is of fifth order.
        assert!((coarse / fine - 8.0).abs() < 0.1, "{coarse:e} {fine:e}");
    }
}

/// Braked to a stop, the rear wheel of the drift model locks, none turns backward, and the vehicle
/// all but stays.
#[test]
fn invariant_locked_wheels_do_not_turn_backward() {
    let mut system = drift(SPRUNG, tire(Reading::Text));
    system.limits.speed[0] = 0.0;
    let mut x = [0.0; 9];
    (x[SPEED], x[7], x[8]) = (12.0, 12.0 / 0.344, 12.0 / 0.344);
    let (mut x, mut locked) = (x.to_vec(), false);
    for _ in 0..400 {
        x = integrate(&system, &x, &[0.0, -11.4], 0.01, Method::Rk4(1e-4)).0;
        locked |= x[8] == 0.0 && x[SPEED] > 1.0;
        assert!(x[7] >= 0.0 && x[8] >= 0.0);
        assert!(x.iter().all(|value| value.is_finite()));
    }
    // The share of slipping at rest, (1 + tanh(−4))/2, lets the locked wheel go on pulling by 3e-4 of
    // some 10 m/s², for less than three seconds.
    assert!(locked && x[SPEED].abs() < 0.01, "{x:?}");
}

/// A value of a dual number has the bits of the plain one, in all three models.
#[test]
fn invariant_duals_carry_the_bits() {
    fn bits<const N: usize, S, D>(plain: &S, dual: &D, x: &[f64; N])
    where
        S: Dynamics<f64>,
        D: Dynamics<Dual<f64, 1>>,
    {
        let lift = |values: &[f64]| -> Vec<Dual<f64, 1>> {
            values
                .iter()
                .map(|value| Dual::variable(*value, 0))
                .collect()
        };
        let expected = rate(plain, x, &INPUT);
        for (found, expected) in rate(dual, &lift(x), &lift(&INPUT)).iter().zip(expected) {
            assert_eq!(found.value.to_bits(), expected.to_bits());
            assert!(found.derivative[0].is_finite());
        }
    }
    let kinematic = KinematicTrack {
        wheelbase: 2.5,
        limits: Limits::none(),
    };
    let dual = KinematicTrack {
        wheelbase: Dual::from(2.5),
        limits: Limits::none(),
    };
    bits(&kinematic, &dual, &[1.0, 2.0, 0.3, 4.0, 0.5]);
    for speed in [15.0, 0.3, 0.0, -4.0] {
        let mut x = STATE;
        x[SPEED] = speed;
        let dual = dynamic(SPRUNG, Limits::none());
        let (state, _) = x.split_first_chunk::<7>().expect("nine");
        bits(&dynamic(SPRUNG, Limits::none()), &dual, state);
        let text = Reading::Text;
        bits(&drift(SPRUNG, tire(text)), &drift(SPRUNG, tire(text)), &x);
    }
}

/// The level `slip` with linear tires, of small slip and without load transfer, turns as the linear
/// single track does: two wheels on a line that share the weight, the front one at an angle.
#[test]
fn closed_form_slip_level_turns_as_the_single_track() {
    let (a, b, mass, speed) = (0.3, 0.5, 28.0, 5.0);
    let wheel = |name: &str, x: f64, angle: f64| Wheel {
        name: name.into(),
        mount: vec2(x, 0.0),
        radius: 0.1,
        steering: Steering::Fixed { angle },
        rim: Rim::Plain,
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 4e-3,
        viscous: 0.0,
        pivot_viscous: 0.0,
        dry_friction: 0.0,
        friction_rounding: 0.0,
        brake: 0.0,
        stiffness: 1.0,
        drive: Drive::Torque { torque_max: 1.0 },
    };
    let body = Body {
        mass,
        inertia_com: 1.4,
        center_of_mass: vec2(0.0, 0.0),
        com_height: 0.15,
    };
    for stiffness in [[5.0, 5.0], [5.0, 4.0], [9.0, 9.0]] {
        let off = [1e-2, 5e-3].map(|angle| {
            let wheels = vec![wheel("front", a, angle), wheel("rear", -b, 0.0)];
            let platform = Platform::new(body, wheels).expect("two wheels");
            let tires = stiffness.map(|stiffness| Tire::Slip {
                curve: Curve::Linear {
                    friction: 1.0,
                    stiffness,
                },
                relaxation: 0.02,
                damping: 0.0,
            });
            let ground = Ground::flat(9.81);
            let system =
                Slip::new(platform, tires.to_vec(), ground, Loads::Static).expect("no trailer");
            let mut x = vec![0.0; system.layout().state()];
            system.platform().renew_angles(&mut x);
            let mut x = system.rolling_state(&x, vec2(speed, 0.0), 0.0);
            let u = vec![0.0; system.sizes().input];
            let mut mode = vec![1.0; 2];
            assert!(Implicit::new(&system).steps(&system, &u, 1e-3, 3000, &mut x, &mut mode));
            let at = system.layout().velocity();
            let v = x[at];
            let [front, rear] = stiffness.map(|c| c * mass * 9.81 / 2.0);
            let stretch = a + b + mass / (a + b) * (b / front - a / rear) * v * v;
            x[at + 2] * stretch / (v * angle) - 1.0
        });
        // Of second order in the angle, as drag and curvature are.
        assert!(off[0].abs() < 1e-3, "{off:?}");
        assert!((off[0] / off[1] - 4.0).abs() < 0.1, "{off:?}");
    }
}
