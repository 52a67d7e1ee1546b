//! The errata of the sources: each published form fails a check that the shipped model passes.
//!
//! [ZNL] is the paper of Zenkevich, Nazarova and Lisitsyn, [BLOG] the two-wheel post; equation
//! numbers are theirs. The judge of the dynamics is a robot made of point masses and d'Alembert's
//! principle, which knows neither i_z nor a. Where an equation has several errors, the others are
//! granted corrected, so that each test convicts one.
#![allow(clippy::disallowed_methods)] // The truth is computed by other means than the model.

mod common;

use appell_model::drive::{DcMotor, Drive};
use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::kinematic::Kinematic;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{WheelOutput, YAW};
use common::{Differential, Method, SLEIGH, integrate};

/// A published form has to miss its check by more than this part of the terms it adds up.
const MARGIN: f64 = 1e-2;
/// Some hundred operations at most, each rounded to 1e-16 of the terms added up.
const ROUNDING: f64 = 1e-14;
/// The adaptive method at 1e-14 a step, over some hundreds of steps.
const INTEGRATION: f64 = 1e-11;
/// The body as point masses, (x, y) in the base frame and mass: lopsided, but balanced about x.
const POINTS: [(f64, f64, f64); 4] = [
    (0.2, 0.1, 2.0),
    (-0.15, -0.2, 1.0),
    (-0.3, 0.05, 3.0),
    (-0.1, -0.075, 2.0),
];
const MOTOR: DcMotor<f64> = DcMotor {
    resistance: 0.9,
    inductance: 0.15,
    torque_constant: 0.047,
    back_emf_constant: 0.047,
    gear_ratio: 13.0,
    gear_efficiency: 1.0,
    voltage_max: f64::MAX,
    current_max: f64::MAX,
};
/// Commanded spin rates, rad/s, left and right as all pairs: an arc forward.
const RATES: [f64; 2] = [3.0, 7.0];
/// V̇, m/s², and ω̇, rad/s², of the inverse problem.
const ACCELERATION: [f64; 2] = [0.9, -2.3];

type Pair = [f64; 2];
/// A robot with V and ω.
type Moving = (Differential, Pair);
/// An instant with the currents and the voltages of its motors.
type Circuit = (Instant, Pair, Pair);

/// Asserts that the published form violates the check and that the shipped model holds it.
fn judge<A, B>(
    check: impl Fn(&dyn Fn(A) -> B) -> f64,
    published: impl Fn(A) -> B,
    shipped: impl Fn(A) -> B,
    tolerance: f64,
) {
    let (wrong, right) = (check(&published), check(&shipped));
    assert!(wrong > MARGIN, "the published form passes: {wrong:e}");
    assert!(right <= tolerance, "the shipped model fails: {right:e}");
}

/// The largest residual; what is not a number is no motion at all.
fn worst(residuals: impl IntoIterator<Item = f64>) -> f64 {
    let size = |r: f64| if r.is_nan() { f64::INFINITY } else { r.abs() };
    residuals.into_iter().map(size).fold(0.0, f64::max)
}

/// The robot of the point masses, with l ≠ 1, ρ ≠ 1 and its mass behind the axle.
fn robot() -> Differential {
    let sum = |of: fn(f64, f64) -> f64| POINTS.iter().map(|p| p.2 * of(p.0, p.1)).sum::<f64>();
    let mass = sum(|_, _| 1.0);
    let ahead = sum(|x, _| x) / mass;
    Differential {
        mass,
        ahead,
        inertia_com: sum(|x, y| x * x + y * y) - mass * ahead * ahead,
        half_track: 0.19,
        radius: 0.083,
        spin_inertia: 0.0,
        ..SLEIGH
    }
}

/// A robot in motion (V, ω) under wheel torques and in-plane gravity, world frame; with rotors.
#[derive(Clone, Copy)]
struct Instant {
    robot: Differential,
    yaw: f64,
    twist: Pair,
    torque: Pair,
    gravity: Vec2<f64>,
    rotor: f64,
}

impl Instant {
    /// The symbols of [ZNL]: m, a, i_z about the axle midpoint, l, ρ.
    fn symbols(&self) -> [f64; 5] {
        let (m, a) = (self.robot.mass, -self.robot.ahead);
        let i_z = self.robot.inertia_com + m * a * a;
        [m, a, i_z, 2.0 * self.robot.half_track, self.robot.radius]
    }

    /// The weight along the heading, f_x cos φ + f_y sin φ, and f_x sin φ − f_y cos φ.
    fn weight(&self) -> Pair {
        let (f, (sin, cos)) = (self.gravity * self.robot.mass, self.yaw.sin_cos());
        [f.x * cos + f.y * sin, f.x * sin - f.y * cos]
    }

    /// What d'Alembert's principle leaves along a virtual twist, W, and the size of its terms:
    /// Σ m (a − g)·δv + Σ J n² q̈ δq − Σ τ δq.
    fn lost_power(&self, [v_rate, w_rate]: Pair, along: Pair) -> (f64, f64) {
        let ([v, w], ahead) = (self.twist, vec2(self.yaw.cos(), self.yaw.sin()));
        let (mut sum, mut size) = (0.0, 0.0);
        let mut add = |term: f64| (sum, size) = (sum + term, size + term.abs());
        for (x, y, mass) in POINTS {
            let arm = ahead * x + ahead.perpendicular() * y;
            let path = ahead * along[0] + arm.perpendicular() * along[1];
            let tangential = ahead * v_rate + arm.perpendicular() * w_rate;
            let normal = ahead.perpendicular() * (v * w) - arm * (w * w);
            add(mass * (tangential + normal).dot(path));
            add(-mass * self.gravity.dot(path));
        }
        for (sign, torque) in [(-1.0, self.torque[0]), (1.0, self.torque[1])] {
            let side = sign * self.robot.half_track;
            let turn = |twist: Pair| (twist[0] + side * twist[1]) / self.robot.radius;
            let motor = |twist: Pair| MOTOR.gear_ratio * turn(twist);
            add(self.rotor * motor([v_rate, w_rate]) * motor(along));
            add(-torque * turn(along));
        }
        (sum, size)
    }
}

/// In motion on level ground, with and without torques.
fn level() -> Vec<Instant> {
    let at = |twist, torque| Instant {
        robot: robot(),
        yaw: 1.1,
        twist,
        torque,
        gravity: Vec2::zero(),
        rotor: 0.0,
    };
    let driven = [at([-0.6, 1.3], [0.4, -0.9]), at([0.5, 2.1], [1.1, 0.7])];
    [&[at([0.8, -1.7], [0.0; 2])], &driven[..]].concat()
}

/// The same on a slope.
fn slope() -> Vec<Instant> {
    let gravity = Ground::plane(9.81, 0.2, 0.4).gravity;
    level()
        .into_iter()
        .map(|at| Instant { gravity, ..at })
        .collect()
}

/// On a slope, at rest, with no torques.
fn rest() -> Vec<Instant> {
    let (twist, torque) = ([0.0; 2], [0.0; 2]);
    vec![Instant {
        twist,
        torque,
        ..slope()[0]
    }]
}

// The shipped models.

/// Accelerations (V̇, ω̇) and current rates.
fn shipped_circuit((at, current, voltage): Circuit) -> (Pair, Pair) {
    let gravity = Ground {
        gravity: at.gravity,
        gravity_normal: 9.6,
    };
    let system = at.robot.rolling(gravity);
    let layout = system.platform().layout();
    let (v, i, motors) = (layout.velocity(), layout.current(), layout.motors.len());
    let mut x = at.robot.state([0.3, -0.7, at.yaw], at.twist);
    let (mut u, mut dx) = (vec![0.0; layout.input()], vec![0.0; x.len()]);
    x[i..i + motors].copy_from_slice(&current[..motors]);
    u[..2].copy_from_slice(if motors > 0 { &voltage } else { &at.torque });
    system.derivative(&x, &u, &[1.0; 2], &mut dx);
    ([dx[v], dx[v + 1]], [dx[i], dx[i + 1]])
}

fn shipped(at: Instant) -> Pair {
    shipped_circuit((at, [0.0; 2], [0.0; 2])).0
}

/// Torques for given accelerations: the shipped model is affine in them, and solved.
fn shipped_torques((at, [v_rate, w_rate]): (Instant, Pair)) -> Pair {
    let [none, left, right] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|torque| {
        let [v_rate, w_rate] = shipped(Instant { torque, ..at });
        vec2(v_rate, w_rate)
    });
    let (left, right, wanted) = (left - none, right - none, vec2(v_rate, w_rate) - none);
    [wanted.cross(right), left.cross(wanted)].map(|share| share / left.cross(right))
}

/// Rim speeds.
fn shipped_rims((robot, twist): Moving) -> Pair {
    let system = robot.rolling(Ground::flat(9.81));
    let layout = system.platform().layout();
    let (u, mut y) = (vec![0.0; layout.input()], vec![0.0; layout.output()]);
    system.output(&robot.state([0.3, -0.7, 1.1], twist), &u, &[1.0; 2], &mut y);
    [0, 1].map(|i| robot.radius * y[layout.wheel_output(i, WheelOutput::SpinRate)])
}

/// State and its rate after wheel rates have been held for a time, from given wheel angles.
fn shipped_drive(rates: Pair, angles: Pair, yaw: f64, end: f64) -> (Vec<f64>, Vec<f64>) {
    let drive = Drive::Rate { rate_max: f64::MAX };
    let robot = Differential { drive, ..robot() };
    let system = Kinematic::new(robot.platform()).expect("two driven wheels");
    let layout = system.platform().layout();
    let mut x = robot.state([0.0, 0.0, yaw], [0.0; 2]);
    let (mut u, mut dx) = (vec![0.0; layout.input()], vec![0.0; x.len()]);
    x[layout.spin(0)..][..2].copy_from_slice(&angles);
    u[..2].copy_from_slice(&rates);
    if end > 0.0 {
        x = integrate(&system, &x, &u, end, Method::Adaptive(1e-14)).0;
    }
    system.derivative(&x, &u, &[1.0; 2], &mut dx);
    (x, dx)
}

/// Pose after a time at [`RATES`].
fn shipped_arc(end: f64) -> [f64; 3] {
    let x = shipped_drive(RATES, [0.0; 2], 0.0, end).0;
    [x[0], x[1], x[YAW]]
}

// The checks. Each takes a model, published or shipped, and returns its relative residual.

/// D'Alembert's principle along both freedoms, for the accelerations of a model.
fn dalembert(at: Vec<Instant>) -> impl Fn(&dyn Fn(Instant) -> Pair) -> f64 {
    move |model| {
        worst(at.iter().flat_map(|&at| {
            let rates = model(at);
            let lost = [[1.0, 0.0], [0.0, 1.0]].map(|along| at.lost_power(rates, along));
            lost.map(|(sum, size)| sum / size)
        }))
    }
}

/// Power of the torques and the weight = rate of the kinetic energy of the point masses.
fn power(at: Vec<Instant>) -> impl Fn(&dyn Fn(Instant) -> Pair) -> f64 {
    move |model| {
        let lost = |at: &Instant| at.lost_power(model(*at), at.twist);
        worst(at.iter().map(lost).map(|(sum, size)| sum / size))
    }
}

/// D'Alembert's principle, for the torques that a model asks for given accelerations.
fn inverse(at: Vec<Instant>, rates: Pair) -> impl Fn(&dyn Fn((Instant, Pair)) -> Pair) -> f64 {
    move |model| {
        let under = |at: &Instant| Instant {
            torque: model((*at, rates)),
            ..*at
        };
        dalembert(at.iter().map(under).collect())(&|_| rates)
    }
}

/// The rims move as the ends of an axle of length l do: turning about the left one, turning about
/// a center beyond the right one, and straight on.
fn axle(model: &dyn Fn(Moving) -> Pair) -> f64 {
    let half = robot().half_track;
    worst([[1.3 * half, 1.3], [0.8, -1.7], [0.4, 0.0]].map(|[v, w]| {
        let [left, right] = model((robot(), [v, w]));
        worst([left - (v - half * w), right - (v + half * w)]) / (v.abs() + half * w.abs())
    }))
}

/// Closure: when the right wheel has rolled 2πl further than the left, the robot is back.
fn circle(model: &dyn Fn(f64) -> [f64; 3]) -> f64 {
    let (robot, turn) = (robot(), std::f64::consts::TAU);
    let further = turn * 2.0 * robot.half_track / robot.radius;
    let [x, y, yaw] = model(further / (RATES[1] - RATES[0]));
    worst([x, y, yaw - turn])
}

/// Electric power of a steady motor = heat of the winding + power of the shaft.
fn steady(model: &dyn Fn(Pair) -> f64) -> f64 {
    worst(
        [[7.0, 0.0], [7.0, 3.0], [-4.0, 2.0]].map(|[voltage, rate]| {
            let current = model([voltage, rate]);
            let shaft = MOTOR.gear_ratio * MOTOR.torque_constant * current * rate;
            let (supplied, heat) = (voltage * current, MOTOR.resistance * current * current);
            (supplied - heat - shaft) / (supplied.abs() + heat + shaft.abs())
        }),
    )
}

/// Electric power = heat of the windings + rates of magnetic, kinetic and potential energy.
fn electric_power(model: &dyn Fn(Circuit) -> (Pair, Pair)) -> f64 {
    worst(slope().into_iter().map(|at| {
        let drive = Drive::DcMotor(MOTOR);
        let robot = Differential { drive, ..at.robot };
        let at = Instant {
            robot,
            torque: [0.0; 2],
            ..at
        };
        let (current, voltage) = ([1.7, -0.6], [9.0, 4.0]);
        let (rates, current_rate) = model((at, current, voltage));
        let (mut sum, mut size) = at.lost_power(rates, at.twist);
        for k in 0..2 {
            let magnetic = MOTOR.inductance * current[k] * current_rate[k];
            let heat = MOTOR.resistance * current[k] * current[k];
            sum += magnetic + heat - voltage[k] * current[k];
            size += magnetic.abs() + heat + (voltage[k] * current[k]).abs();
        }
        sum / size
    }))
}

// The published equations that several tests share.

/// [ZNL] (30), of which (21) is the case without weight, with its V̇: as `i_z`, `lever` (of the
/// torques) and `swing` (moment of the weight) are filled in.
fn znl_30(at: Instant, i_z: f64, lever: f64, swing: f64) -> Pair {
    let ([m, a, _, _, rho], [v, w], [left, right]) = (at.symbols(), at.twist, at.torque);
    [
        (-a * m * w * w + (left + right) / rho + at.weight()[0]) / m,
        (a * m * w * v + lever / (2.0 * rho) * (right - left) + swing) / i_z,
    ]
}

/// [ZNL] (18): S of (q̈_l, q̈_r) and φ̈, with a factor before the second line.
fn znl_18(at: Instant, [left, right]: Pair, yaw: f64, factor: f64) -> f64 {
    let ([m, _, i_z, _, rho], [v, w], sum) = (at.symbols(), at.twist, right + left);
    let second = 0.5 * rho * w * w * sum - 0.5 * rho * w * yaw * (2.0 * v / rho);
    0.5 * (i_z * yaw * yaw + 0.25 * m * rho * rho * sum * sum) + factor * second
}

/// φ̈ for (q̈_l, q̈_r).
fn yaw_rate(at: Instant, [left, right]: Pair) -> f64 {
    at.robot.radius / (2.0 * at.robot.half_track) * (right - left)
}

/// (q̈_l, q̈_r) for (V̇, ω̇).
fn spin_rates(at: Instant, [v_rate, w_rate]: Pair) -> Pair {
    [-1.0, 1.0].map(|side| (v_rate + side * at.robot.half_track * w_rate) / at.robot.radius)
}

/// Central difference with unit steps, exact on quadratic functions.
fn gradient([a, b]: Pair, of: impl Fn(Pair) -> f64) -> Pair {
    let (left, right) = (
        of([a + 1.0, b]) - of([a - 1.0, b]),
        of([a, b + 1.0]) - of([a, b - 1.0]),
    );
    [0.5 * left, 0.5 * right]
}

/// [ZNL] (9) integrated: the pose after an arc.
fn arc(v: f64, w: f64, t: f64) -> [f64; 3] {
    [v / w * (w * t).sin(), v / w * (1.0 - (w * t).cos()), w * t]
}

/// [ZNL] (24), (26): rates of the currents τ/K_M, with `gear` where q̇ and τ pass it once more.
fn znl_26(current: Pair, voltage: Pair, turning: Pair) -> Pair {
    let (l, r, k_w, i) = (
        MOTOR.inductance,
        MOTOR.resistance,
        MOTOR.back_emf_constant,
        MOTOR.gear_ratio,
    );
    [0, 1].map(|k| -r / l * current[k] - k_w * i / l * turning[k] + voltage[k] / l)
}

// Kinematics.

/// (6) puts the wheels ½ m to the left and right. Check: rims are the ends of the axle.
#[test]
fn errata_znl_6_wheel_positions() {
    // [ZNL] (3), (6): V_{l,r} = V + ωΩr_{l,r}, r_l = ½ y', r_r = −½ y'.
    let published = |(_, [v, w]): Moving| [v - 0.5 * w, v + 0.5 * w];
    judge(axle, published, shipped_rims, ROUNDING);
}

/// (7) and (9) lack the track. Check: closure of a circle.
#[test]
fn errata_znl_7_9_yaw_rate() {
    let [left, right] = RATES.map(|rate| rate * robot().radius);
    // [ZNL] (7), (9): ω = ½ (V_r − V_l), φ̇ the same.
    let published = |t| arc(0.5 * (right + left), 0.5 * (right - left), t);
    judge(circle, published, shipped_arc, INTEGRATION);
}

/// The package feeds wheel rates to (9), which takes rim speeds. Check: closure of a circle.
#[test]
fn errata_znl_package_wheel_rates() {
    let ([left, right], l) = (RATES, 2.0 * robot().half_track);
    // [ZNL] components of the package, with (9) mended: q̇_{l,r} for V_{l,r}.
    let published = |t| arc(0.5 * (right + left), (right - left) / l, t);
    judge(circle, published, shipped_arc, INTEGRATION);
}

/// The third line of (10) is an integral, printed as a rate. Check: closure; wheels turned forth
/// and back leave the heading as it was.
#[test]
fn errata_znl_10_third_line() {
    let check = |model: &dyn Fn((Pair, Pair)) -> f64| {
        let rates = |k: i32| RATES.map(|rate| if k < 16 { rate } else { -rate });
        let angles = |k: i32| RATES.map(|rate| rate * (0.5 + f64::from(k.min(31 - k))));
        (0..32)
            .map(|k| model((angles(k), rates(k))))
            .sum::<f64>()
            .abs()
    };
    let k = robot().radius / (2.0 * robot().half_track);
    // [ZNL] (10): φ̇ = (ρ/l)(q_r − q_l) + C, with C = 0 where the counting starts.
    let published = |([left, right], _): (Pair, Pair)| k * (right - left);
    let ours = |(angles, rates)| shipped_drive(rates, angles, 0.0, 0.0).1[YAW];
    judge(check, published, ours, ROUNDING);
}

// Appell's equations.

/// Section 2.2 and (19) derive S by q. Check: d'Alembert's principle under the torques asked for.
#[test]
fn errata_znl_19_derivative() {
    let check = inverse(level(), ACCELERATION);
    let s = |at: Instant, q| znl_18(at, q, yaw_rate(at, q), -at.robot.ahead * at.robot.mass);
    // [ZNL] (19): Q_i = ∂S/∂q_i.
    let published = |(at, rates)| gradient([0.0; 2], |_q| s(at, spin_rates(at, rates)));
    judge(&check, published, shipped_torques, ROUNDING);
    // By q̈ the same S is right.
    assert!(check(&|(at, rates)| gradient(spin_rates(at, rates), |q| s(at, q))) < ROUNDING);
}

/// (15) to (21) do not say about which axis i_z is. Check: power, with the central value for it.
#[test]
fn errata_znl_15_21_inertia_axis() {
    // [ZNL] (21), i_z about the center of mass.
    let published = |at: Instant| znl_30(at, at.robot.inertia_com, at.symbols()[3], 0.0);
    judge(power(level()), published, shipped, ROUNDING);
}

/// The second line of (18) lacks a m. Check: d'Alembert's principle under the torques asked for.
#[test]
fn errata_znl_18_second_line() {
    // [ZNL] (18): … + (ρ/2) φ̇² (q̈_r + q̈_l) − (ρ/2) φ̇ φ̈ (q̇_r + q̇_l).
    let s = |at, q| znl_18(at, q, yaw_rate(at, q), 1.0);
    let published = |(at, rates)| gradient(spin_rates(at, rates), |q| s(at, q));
    judge(
        inverse(level(), ACCELERATION),
        published,
        shipped_torques,
        ROUNDING,
    );
}

/// (18) derived with φ̈ held has no yaw inertia. Check: d'Alembert's principle, as before.
#[test]
fn errata_znl_18_yaw_held() {
    // [ZNL] (18), (19): ∂S/∂q̈_i at constant φ̈.
    let s = |at: Instant, q, yaw| znl_18(at, q, yaw, -at.robot.ahead * at.robot.mass);
    let published =
        |(at, rates): (_, Pair)| gradient(spin_rates(at, rates), |q| s(at, q, rates[1]));
    judge(
        inverse(level(), ACCELERATION),
        published,
        shipped_torques,
        ROUNDING,
    );
}

/// (20) has V̈ for V̇. Check: work = kinetic energy after a straight start from rest.
#[test]
fn errata_znl_20_acceleration() {
    let (mass, force) = (robot().mass, 2.0 * 0.3 / robot().radius);
    let check = |model: &dyn Fn(f64) -> Pair| {
        let [way, speed] = model(2.0);
        (0.5 * mass * speed * speed / (force * way) - 1.0).abs()
    };
    // [ZNL] (20): m V̈ = −a m ω² + (τ_l + τ_r)/ρ, integrated from rest at ω = 0.
    let published = |t: f64| [force / mass * t * t * t / 6.0, force / mass * t * t / 2.0];
    let ours = |t| {
        let system = robot().rolling(Ground::flat(9.81));
        let (mut u, x) = (
            vec![0.0; system.sizes().input],
            robot().state([0.0; 3], [0.0; 2]),
        );
        u[..2].copy_from_slice(&[0.3; 2]);
        let x = integrate(&system, &x, &u, t, Method::Rk4(1e-2)).0;
        [x[0], x[system.platform().layout().velocity()]]
    };
    // RK4 is exact here; 200 additions round.
    judge(check, published, ours, 1e-13);
}

/// (20), (21) and (28) give the torques no lever in yaw. Check: power of a turning robot.
#[test]
fn errata_znl_20_21_lever() {
    // [ZNL] (21): i_z ω̇ = a m ω V + (τ_r − τ_l)/(2ρ).
    let published = |at: Instant| znl_30(at, at.symbols()[2], 1.0, 0.0);
    judge(power(level()), published, shipped, ROUNDING);
}

/// Assumption 1 neglects what turns with the wheels. Check: d'Alembert's principle with rotors of
/// 1e-4 kg·m², which turn n times as fast.
#[test]
fn errata_znl_assumption_1_rotors() {
    let rotor = 1e-4;
    let spin_inertia = MOTOR.gear_ratio * MOTOR.gear_ratio * rotor;
    let robot = Differential {
        spin_inertia,
        ..robot()
    };
    let instants = level().into_iter().map(|at| Instant { robot, rotor, ..at });
    // [ZNL] (21), mended.
    let published = |at: Instant| znl_30(at, at.symbols()[2], at.symbols()[3], 0.0);
    judge(dalembert(instants.collect()), published, shipped, ROUNDING);
}

// Motors.

/// The current at which its rate by the shipped motor, linear in it, vanishes.
fn shipped_current([voltage, rate]: Pair) -> f64 {
    let of = |current| MOTOR.current_rate(voltage, current, rate);
    of(0.0) / (of(0.0) - of(1.0))
}

/// (22) lets an inductance take voltage at constant current. Check: power of a steady motor.
#[test]
fn errata_znl_22_inductance() {
    // [ZNL] (22): L I + R I + K_w i q̇ = U.
    let published =
        |[u, rate]: Pair| (u - MOTOR.back_emf(rate)) / (MOTOR.inductance + MOTOR.resistance);
    judge(steady, published, shipped_current, ROUNDING);
}

/// (25) has the torque for its rate. Check: power of a steady motor.
#[test]
fn errata_znl_25_torque_rate() {
    let (l, r, k_m) = (MOTOR.inductance, MOTOR.resistance, MOTOR.torque_constant);
    // [ZNL] (25): τ = −(R/L) τ − (K_M K_w i/L) q̇ + (K_M/L) U, solved for τ = K_M I of the shaft.
    let published = |[u, rate]: Pair| k_m / l * (u - MOTOR.back_emf(rate)) / (1.0 + r / l) / k_m;
    judge(steady, published, shipped_current, ROUNDING);
}

/// (24) into (21), (26) and (28) lets the shaft of the motor turn the wheel without a gear, and the
/// wheel the motor with one. Check: power of robot and circuits together.
#[test]
fn errata_znl_24_26_28_gear() {
    // [ZNL] (24): τ = K_M I, used at the wheel.
    let published = |(at, current, voltage): Circuit| {
        let ([_, a, i_z, l, _], torque) =
            (at.symbols(), current.map(|i| MOTOR.torque_constant * i));
        let rates = znl_30(Instant { torque, ..at }, i_z, l, a * at.weight()[1]);
        (rates, znl_26(current, voltage, spin_rates(at, at.twist)))
    };
    judge(electric_power, published, shipped_circuit, ROUNDING);
}

/// (27) takes the wheel's radius for the track. Check: rims are the ends of the axle.
#[test]
fn errata_znl_27_rim_speed() {
    // [ZNL] (27): V + ωl/2 on the right, V − ωr/2 on the left.
    let published =
        |(robot, [v, w]): Moving| [v - 0.5 * w * robot.radius, v + w * robot.half_track];
    judge(axle, published, shipped_rims, ROUNDING);
}

/// (28) has the speed of the rim for the rate of the wheel. Check: power of robot and circuits.
#[test]
fn errata_znl_28_radius() {
    // [ZNL] (28): τ̇_{l,r} = … − (K_M K_w i/L)(V ∓ ωl/2) + …; the gear is mended.
    let published = |(at, current, voltage): Circuit| {
        let ([_, a, i_z, l, rho], per_current) = (at.symbols(), MOTOR.torque_per_current());
        let torque = current.map(|i| per_current * i);
        let rates = znl_30(Instant { torque, ..at }, i_z, l, a * at.weight()[1]);
        let rims = spin_rates(at, at.twist).map(|rate| rho * rate);
        (rates, znl_26(current, voltage, rims))
    };
    judge(electric_power, published, shipped_circuit, ROUNDING);
}

// Inclined plane.

/// (29) lets the weight act at the axle midpoint. Check: virtual work on the point masses.
#[test]
fn errata_znl_29_generalized_forces() {
    let check = |model: &dyn Fn(Instant) -> Pair| {
        worst(rest().into_iter().flat_map(|at| {
            let ([.., l, rho], forces) = (at.symbols(), model(at));
            // At rest d'Alembert's sum is minus the work of all forces.
            [(forces[0], -rho / l), (forces[1], rho / l)].map(|(force, turn)| {
                let (sum, size) = at.lost_power([0.0; 2], [0.5 * rho, turn]);
                (force + sum) / size
            })
        }))
    };
    // [ZNL] (29): Q_{r,l} = τ_{r,l} + (ρ/2)(f_x cos φ + f_y sin φ).
    let published = |at: Instant| {
        at.torque
            .map(|t| t + 0.5 * at.robot.radius * at.weight()[0])
    };
    // What the torques lack to hold the robot.
    let ours = |at| shipped_torques((at, [0.0; 2])).map(|hold| -hold);
    judge(check, published, ours, ROUNDING);
}

/// (30) has the yaw equation of level ground. Check: power on a slope, d'Alembert's principle when
/// released at rest.
#[test]
fn errata_znl_30_yaw_on_slope() {
    // [ZNL] (30): no moment of the weight in ω̇.
    let published = |at: Instant| znl_30(at, at.symbols()[2], at.symbols()[3], 0.0);
    judge(power(slope()), published, shipped, ROUNDING);
    judge(dalembert(rest()), published, shipped, ROUNDING);
}

/// After (30): two equal torques hold the robot. Check: equilibrium of the point masses.
#[test]
fn errata_znl_30_equal_torques() {
    // [ZNL] after (30): τ_l = τ_r = −(ρ/2)(f_x cos φ + f_y sin φ).
    let published = |(at, _): (Instant, Pair)| [-0.5 * at.robot.radius * at.weight()[0]; 2];
    judge(
        inverse(rest(), [0.0; 2]),
        published,
        shipped_torques,
        ROUNDING,
    );
}

// The blog.

/// The first method divides by ω. Check: rims are the ends of the axle, straight on as well.
#[test]
fn errata_blog_method_one() {
    // [BLOG] R = v/ω, φ̇_{l,r} = ω (R ∓ l/2)/r; here as rim speeds.
    let published =
        |(robot, [v, w]): Moving| [-1.0, 1.0].map(|side| w * (v / w + side * robot.half_track));
    judge(axle, published, shipped_rims, ROUNDING);
}

/// An arc for v_l > v_r only. Check: share of misjudged motions among known ones. The amended
/// |v_l| ≠ |v_r| says the same as v_l ≠ ±v_r and passes.
#[test]
fn errata_blog_arc_condition() {
    let others = [[1.0, 1.0], [-2.0, -2.0], [1.5, -1.5], [-1.5, 1.5]];
    let arcs = [
        [2.0, 1.0],
        [1.0, 2.0],
        [0.0, 2.0],
        [-1.0, 2.0],
        [-1.0, -2.0],
    ];
    let check = |is_arc: &dyn Fn(Pair) -> bool| {
        let missed = arcs.iter().filter(|&&rates| !is_arc(rates)).count();
        let wrong = others.iter().filter(|&&rates| is_arc(rates)).count();
        (missed + wrong) as f64 / 9.0
    };
    // Driven for a second: the heading has changed, and the place.
    let ours = |rates| {
        let x = shipped_drive(rates, [0.0; 2], 0.0, 1.0).0;
        x[YAW].abs() > 1e-9 && x[0].hypot(x[1]) > 1e-9
    };
    // [BLOG] kinds of motion, first form.
    judge(check, |[left, right]| left > right, ours, 0.0);
    assert_eq!(check(&|[left, right]| left.abs() != right.abs()), 0.0);
}

/// The heading as the direction of v_c. Check: constraint; the speed along the heading is the mean
/// of the rims, in reverse as well.
#[test]
fn errata_blog_heading_in_reverse() {
    let check = |model: &dyn Fn(Pair) -> (Pair, f64)| {
        worst([RATES, RATES.map(|rate| -rate)].map(|rates| {
            let ([x_rate, y_rate], heading) = model(rates);
            let mean = 0.5 * robot().radius * (rates[0] + rates[1]);
            (x_rate * heading.cos() + y_rate * heading.sin()) / mean - 1.0
        }))
    };
    let ours = |rates| {
        let (x, dx) = shipped_drive(rates, [0.0; 2], 1.1, 0.7);
        ([dx[0], dx[1]], x[YAW])
    };
    // [BLOG] θ is the angle between v_c and X.
    let published = |rates| {
        let ([x_rate, y_rate], _) = ours(rates);
        ([x_rate, y_rate], y_rate.atan2(x_rate))
    };
    judge(check, published, ours, ROUNDING);
}
