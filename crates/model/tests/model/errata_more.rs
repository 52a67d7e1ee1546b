//! Errata of the Pioneer-2DX lecture (Dąbkowski) and of the mecanum note (Sergeev): for each slip of
//! algebra or physics the published form fails a named check, and the shipped model passes it.

use appell_model::drive::Drive;
use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform, WheelOutput, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::wheel::{Rim, Steering, Wheel};

/// The lecture's symbols: wheel and frame masses, half the track, frame's center behind the axle,
/// wheel radius; inertias of a wheel's spin and diameter, and of the frame.
const M1: f64 = 1.5;
const M4: f64 = 8.0;
const L1: f64 = 0.35;
const L2: f64 = 0.07;
const R: f64 = 0.15;
const I_Z1: f64 = 0.02;
const I_X1: f64 = 0.01;
const I_Z4: f64 = 0.3;
const H1: f64 = L1 / R;
/// Inertia before β̈.
const I_BETA: f64 = 2.0 * M1 * L1 * L1 + M4 * L2 * L2 + I_Z4 + 2.0 * I_X1 + 2.0 * I_Z1 * H1 * H1;
/// What rolling resists with, N·m: a bound N f of each wheel.
const ROLLING: f64 = 0.09;

/// Heading β, rates β̇ and α̇ (mean of the wheels), torques of the right and the left wheel.
#[derive(Clone, Copy)]
struct Instant {
    beta: f64,
    turn: f64,
    spin: f64,
    torque: [f64; 2],
    /// Bound of the rolling resistance, N·m.
    rolling: f64,
}

/// Accelerations β̈, α̈ and the multipliers λ₁, λ₂ (force of the ground, world axes).
#[derive(Clone, Copy, Debug)]
struct Answer {
    accelerations: [f64; 2],
    multipliers: [f64; 2],
}

const INSTANTS: [Instant; 3] = [
    Instant {
        beta: 0.7,
        turn: 1.1,
        spin: 4.0,
        torque: [0.8, -0.3],
        rolling: 0.0,
    },
    Instant {
        beta: -2.1,
        turn: -0.8,
        spin: 2.5,
        torque: [0.2, 0.9],
        rolling: 0.0,
    },
    Instant {
        beta: 1.3,
        turn: 0.4,
        spin: -3.0,
        torque: [-0.5, 0.1],
        rolling: 0.0,
    },
];

/// The shipped model at an instant; wheel 1 is the right one.
fn shipped(at: Instant) -> Answer {
    let wheel = |name: &str, side: f64| Wheel {
        name: name.into(),
        mount: vec2(0.0, side),
        radius: R,
        steering: Steering::Fixed { angle: 0.0 },
        rim: Rim::Plain,
        mass: M1,
        inertia_vertical: I_X1,
        spin_inertia: I_Z1,
        viscous: 0.0,
        pivot_viscous: 0.0,
        dry_friction: at.rolling,
        friction_rounding: 0.0,
        stiffness: 1.0,
        brake: 0.0,
        drive: Drive::Torque {
            torque_max: f64::INFINITY,
        },
    };
    let body = Body {
        mass: M4,
        inertia_com: I_Z4,
        center_of_mass: vec2(-L2, 0.0),
        com_height: 0.1,
    };
    let wheels = vec![wheel("right", -L1), wheel("left", L1)];
    let system = Rolling::new(
        Platform::new(body, wheels).expect("an axle"),
        Ground::flat(9.81),
    );
    let layout = system.platform().layout().clone();
    let mut x = vec![0.0; layout.state()];
    x[YAW] = at.beta;
    system.platform().renew_angles(&mut x);
    let v = system
        .platform()
        .velocity_from_twist(vec2(R * at.spin, 0.0), at.turn, &[]);
    x[layout.velocity()..][..2].copy_from_slice(&v[..2]);
    let mut u = vec![0.0; layout.input()];
    u[..2].copy_from_slice(&at.torque);
    let mode = rates(at).map(f64::signum);
    let (mut dx, mut y) = (vec![0.0; layout.state()], vec![0.0; layout.output()]);
    system.derivative(&x, &u, &mode, &mut dx);
    system.output(&x, &u, &mode, &mut y);
    let mut v_rate = v;
    v_rate[..2].copy_from_slice(&dx[layout.velocity()..][..2]);
    let (along, turning) = system.platform().twist(&v_rate);
    let sum = |what| (0..2).map(|i| y[layout.wheel_output(i, what)]).sum::<f64>();
    let force = vec2(sum(WheelOutput::Longitudinal), sum(WheelOutput::Lateral));
    let world = force.rotated(x[YAW + 1], x[YAW + 2]);
    Answer {
        accelerations: [turning, along.x / R],
        multipliers: [world.x, world.y],
    }
}

/// Rates of the right and the left wheel.
fn rates(at: Instant) -> [f64; 2] {
    [at.spin + H1 * at.turn, at.spin - H1 * at.turn]
}

/// Momentum of frame and wheels, world axes.
fn momentum(beta: f64, turn: f64, spin: f64) -> [f64; 2] {
    let (sin, cos) = Scalar::sin_cos(beta);
    let mass = 2.0 * M1 + M4;
    [
        mass * R * spin * cos + M4 * L2 * turn * sin,
        mass * R * spin * sin - M4 * L2 * turn * cos,
    ]
}

/// Check "Newton": the ground's force is the rate of momentum, by differences along the motion. The
/// largest error, N; differences of 1e-4 s leave 1e-7.
fn newton(answer: &dyn Fn(Instant) -> Answer) -> f64 {
    const H: f64 = 1e-4;
    INSTANTS
        .iter()
        .map(|&at| {
            let of = answer(at);
            let [turn_rate, spin_rate] = of.accelerations;
            let ahead = |h: f64| {
                let beta = at.beta + h * at.turn + 0.5 * h * h * turn_rate;
                momentum(beta, at.turn + h * turn_rate, at.spin + h * spin_rate)
            };
            let (after, before) = (ahead(H), ahead(-H));
            (0..2)
                .map(|k| ((after[k] - before[k]) / (2.0 * H) - of.multipliers[k]).abs())
                .fold(0.0, f64::max)
        })
        .fold(0.0, f64::max)
}

/// Check "energy": the drives' power is the rate of kinetic energy. The largest error, W.
fn energy(answer: &dyn Fn(Instant) -> Answer) -> f64 {
    INSTANTS
        .iter()
        .map(|&at| {
            let [turn_rate, spin_rate] = answer(at).accelerations;
            let forward = (2.0 * M1 + M4) * R * R + 2.0 * I_Z1;
            let rate = I_BETA * at.turn * turn_rate + forward * at.spin * spin_rate;
            let [right, left] = rates(at);
            (at.torque[0] * right + at.torque[1] * left - rate).abs()
        })
        .fold(0.0, f64::max)
}

/// The lecture's second pair of equations with a slip in the first: a coefficient of α̈ added, and
/// what multiplies m₄ l₂ r β̇.
fn decoupled(at: Instant, extra: f64, speed: impl Fn(f64) -> f64) -> [f64; 2] {
    let forward = (2.0 * M1 + M4) * R * R + 2.0 * I_Z1;
    let spin_rate = (at.torque[0] + at.torque[1] - M4 * L2 * R * at.turn * at.turn) / forward;
    let turning = (at.torque[0] - at.torque[1]) * H1;
    let turn_rate =
        (turning + M4 * L2 * R * speed(spin_rate) * at.turn - extra * spin_rate) / I_BETA;
    [turn_rate, spin_rate]
}

/// What the shipped model may leave in a check, and what a slip must at least show.
const PASSES: f64 = 1e-6;
const FAILS: f64 = 1e-2;

#[track_caller]
fn proves(
    check: impl Fn(&dyn Fn(Instant) -> Answer) -> f64,
    published: &dyn Fn(Instant) -> Answer,
) {
    let (ours, theirs) = (check(&shipped), check(published));
    assert!(ours < PASSES, "the shipped model is off by {ours:e}");
    assert!(
        theirs > FAILS,
        "the published form is off by {theirs:e} only"
    );
}

/// The multipliers of (P1) with the coefficient of β̇² in each as given.
fn first_pair(at: Instant, centripetal: f64) -> Answer {
    let ours = shipped(at);
    let [turn_rate, spin_rate] = ours.accelerations;
    let (sin, cos) = Scalar::sin_cos(at.beta);
    let mass = 2.0 * M1 + M4;
    let x = R * (spin_rate * cos - at.spin * at.turn * sin);
    let y = R * (spin_rate * sin + at.spin * at.turn * cos);
    let square = centripetal * M4 * L2 * at.turn * at.turn;
    Answer {
        multipliers: [
            mass * x + M4 * L2 * sin * turn_rate + square * cos,
            mass * y - M4 * L2 * cos * turn_rate + square * sin,
        ],
        ..ours
    }
}

#[test]
fn erratum_dab_1_and_2_lack_the_centripetal_force_of_the_frame() {
    proves(newton, &|at| first_pair(at, 0.0));
    let corrected = newton(&|at| first_pair(at, 1.0));
    assert!(corrected < PASSES, "{corrected:e}");
}

#[test]
fn erratum_dab_3_couples_equal_wheels() {
    let published = |at: Instant| Answer {
        accelerations: decoupled(at, 2.0 * I_Z1 * H1, |_| at.spin),
        multipliers: [0.0; 2],
    };
    proves(energy, &published);
    let corrected = energy(&|at: Instant| Answer {
        accelerations: decoupled(at, 0.0, |_| at.spin),
        multipliers: [0.0; 2],
    });
    assert!(corrected < PASSES, "{corrected:e}");
}

#[test]
fn erratum_dab_decoupled_lambda_2() {
    proves(newton, &|at| {
        let mut answer = first_pair(at, 1.0);
        let (_, cos) = Scalar::sin_cos(at.beta);
        // −α̇β̇ cos β for +α̇β̇ cos β.
        answer.multipliers[1] -= 2.0 * (2.0 * M1 + M4) * R * at.spin * at.turn * cos;
        answer
    });
}

#[test]
fn erratum_dab_decoupled_turning_by_an_acceleration() {
    proves(energy, &|at: Instant| Answer {
        accelerations: decoupled(at, 0.0, |spin_rate| spin_rate),
        multipliers: [0.0; 2],
    });
}

/// Check "losses": rolling resistance takes power from the robot whichever way a wheel turns.
#[test]
fn erratum_dab_rolling_resistance_without_sign() {
    let backwards = Instant {
        beta: 0.2,
        turn: 0.3,
        spin: -3.0,
        torque: [0.0; 2],
        rolling: ROLLING,
    };
    let power = |[turn_rate, spin_rate]: [f64; 2]| {
        let forward = (2.0 * M1 + M4) * R * R + 2.0 * I_Z1;
        I_BETA * backwards.turn * turn_rate + forward * backwards.spin * spin_rate
    };
    let taken = power(shipped(backwards).accelerations);
    let bound: f64 = rates(backwards)
        .iter()
        .map(|rate| rate.abs() * ROLLING)
        .sum();
    assert!((taken + bound).abs() < 1e-12, "{taken} W, {bound} W");
    // −N f as printed: a torque of −ROLLING at both wheels.
    let printed = Instant {
        torque: [-ROLLING; 2],
        rolling: 0.0,
        ..backwards
    };
    assert!(
        power(shipped(printed).accelerations) > 0.1,
        "it drives the robot"
    );
}

/// Check "counter-example": T_A ≤ μ N_A holds with T_A = 0 while each wheel pushes hard.
#[test]
fn erratum_dab_lumped_friction_is_not_sufficient() {
    // Both wheels at rest and pushed against each other: the robot begins to spin about its axle,
    // but for the small pull of the frame behind it.
    let at = Instant {
        beta: 0.0,
        turn: 0.0,
        spin: 0.0,
        torque: [2.0, -2.0],
        rolling: 0.0,
    };
    let of = shipped(at);
    let along = of.multipliers[0];
    let push = (at.torque[0] - I_Z1 * H1 * of.accelerations[0]) / R;
    assert!(
        along.abs() < 1e-12 && push > 5.0,
        "T_o {along:e} N, each wheel {push} N"
    );
}

/// The note's platform: rollers at ±45°, wheels at (±0.3, ±0.2), radius 0.1 m.
fn note() -> Platform<f64> {
    let quarter = std::f64::consts::FRAC_PI_4;
    let places = [
        (0.3, 0.2, 1.0),
        (0.3, -0.2, -1.0),
        (-0.3, 0.2, 1.0),
        (-0.3, -0.2, -1.0),
    ];
    let wheels = places.map(|(x, y, side)| Wheel {
        name: "w".into(),
        mount: vec2(x, y),
        radius: 0.1,
        steering: Steering::Fixed { angle: 0.0 },
        rim: Rim::Rollers {
            angle: side * quarter,
        },
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 0.01,
        viscous: 0.0,
        pivot_viscous: 0.0,
        dry_friction: 0.0,
        friction_rounding: 0.0,
        stiffness: 1.0,
        brake: 0.0,
        drive: Drive::Rate {
            rate_max: f64::INFINITY,
        },
    });
    let body = Body {
        mass: 10.0,
        inertia_com: 1.0,
        center_of_mass: vec2(0.0, 0.0),
        com_height: 0.1,
    };
    Platform::new(body, wheels.to_vec()).expect("a mecanum platform")
}

/// Where five legs of 4 s end, through wheel rates and back.
fn house(legs: [[f64; 2]; 5]) -> [f64; 2] {
    let platform = note();
    let mut x = vec![0.0; platform.layout().state()];
    platform.renew_angles(&mut x);
    let mut end = [0.0; 2];
    for [forward, left] in legs {
        let rates = platform.rates_from_twist(&x, [forward, left, 0.0]);
        let (twist, slip) = platform.twist_from_rates(&x, &rates);
        assert!(
            slip < 1e-14,
            "consistent rates leave nothing: {slip:e} rad/s"
        );
        end[0] += 4.0 * twist[0];
        end[1] += 4.0 * twist[1];
    }
    end
}

/// Check "closure": the path of the house ends where it begins.
#[test]
fn erratum_ser_fourth_leg_of_the_house() {
    const V: f64 = 0.1;
    let (sin, cos) = Scalar::sin_cos(std::f64::consts::FRAC_PI_3);
    let legs = |fourth: [f64; 2]| {
        [
            [V, 0.0],
            [V * sin, -V * cos],
            [-V * sin, -V * cos],
            fourth,
            [0.0, V],
        ]
    };
    let (ours, theirs) = (house(legs([-V, 0.0])), house(legs([0.0, -V])));
    assert!(ours.iter().all(|off| off.abs() < 1e-15), "{ours:?}");
    assert!(theirs.iter().any(|off| off.abs() > 0.1), "{theirs:?}");
}

/// Check "frame": body velocities may only be summed after turning them by the heading. On a circle
/// driven sideways the sum without it leaves as a straight line.
#[test]
fn erratum_ser_dead_reckoning_without_heading() {
    let platform = note();
    let mut x = vec![0.0; platform.layout().state()];
    let (turn, dt) = (0.5, 1e-3);
    let steps = (std::f64::consts::TAU / turn / dt).round() as usize;
    let (mut turned, mut summed) = (vec2(0.0, 0.0), vec2(0.0, 0.0));
    for k in 0..steps {
        // The heading at the middle of the step.
        x[YAW] = turn * dt * (k as f64 + 0.5);
        platform.renew_angles(&mut x);
        let rates = platform.rates_from_twist(&x, [0.0, 0.2, turn]);
        let (twist, _) = platform.twist_from_rates(&x, &rates);
        let velocity = vec2(twist[0], twist[1]);
        turned = turned + velocity.rotated(x[YAW + 1], x[YAW + 2]) * dt;
        summed = summed + velocity * dt;
    }
    // A whole turn but for the part of a step: 0.2 m/s times half a millisecond.
    assert!(turned.dot(turned).sqrt() < 2e-4, "{turned:?}");
    assert!(summed.dot(summed).sqrt() > 1.0, "{summed:?}");
}
