//! The errata of the sources: each published form fails a check that the shipped model passes.
//!
//! [ZNL] is the paper of Zenkevich, Nazarova and Lisitsyn, [BLOG] the two-wheel post; equation
//! numbers are theirs. The judge of the dynamics is a robot made of point masses and d'Alembert's
//! principle, which knows neither i_z nor a. Where an equation has several errors, the others are
//! granted corrected, so that each test convicts one.
#![allow(clippy::disallowed_methods)] // The truth is computed by other means than the model.

use crate::common::{Differential, Method, SLEIGH, integrate};
use appell_model::drive::{DcMotor, Drive};
use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::kinematic::Kinematic;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{WheelOutput, YAW};

/// A published form misses its check by more than this part of the terms.
const MARGIN: f64 = 1e-2;
/// Some hundred operations at most, each rounded to 1e-16 of the terms added up.
const ROUNDING: f64 = 1e-14;
/// The body as point masses (x, y, mass), base frame: lopsided, but balanced about x.
#[rustfmt::skip]
const POINTS: [[f64; 3]; 4] =
    [[0.2, 0.1, 2.0], [-0.15, -0.2, 1.0], [-0.3, 0.05, 3.0], [-0.1, -0.075, 2.0]];
/// Its mass, centre and inertia Σ m r² − m a², with l ≠ 1 and ρ ≠ 1.
const ROBOT: Differential = Differential {
    mass: 8.0,
    ahead: -0.85 / 8.0,
    inertia_com: 0.47125 - 0.85 * 0.85 / 8.0,
    half_track: 0.19,
    radius: 0.083,
    spin_inertia: 0.0,
    ..SLEIGH
};
const HEADING: f64 = 1.1;
/// [ZNL]'s m, a, i_z about the axle midpoint, l, ρ; and L, R, K_M = K_w, i of the motors.
const M: f64 = ROBOT.mass;
const A: f64 = -ROBOT.ahead;
const I_Z: f64 = ROBOT.inertia_com + M * A * A;
const L: f64 = 2.0 * ROBOT.half_track;
const RHO: f64 = ROBOT.radius;
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

/// Left and right, or along V and ω.
type Pair = [f64; 2];
/// An instant with the currents and the voltages of its motors.
type Circuit = (Instant, Pair, Pair);

/// Asserts that the published form violates the check and that the shipped model holds it.
pub fn judge<A, B>(
    check: impl Fn(&dyn Fn(A) -> B) -> f64,
    published: impl Fn(A) -> B,
    shipped: impl Fn(A) -> B,
) {
    judge_within(ROUNDING, check, published, shipped);
}

pub fn judge_within<A, B>(
    tolerance: f64,
    check: impl Fn(&dyn Fn(A) -> B) -> f64,
    published: impl Fn(A) -> B,
    shipped: impl Fn(A) -> B,
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

/// A robot in motion (V, ω) under wheel torques and in-plane gravity, world frame.
#[derive(Clone, Copy)]
struct Instant {
    robot: Differential,
    twist: Pair,
    torque: Pair,
    gravity: Vec2<f64>,
}

impl Instant {
    /// f_x cos φ + f_y sin φ and f_x sin φ − f_y cos φ of the weight.
    fn weight(&self) -> Pair {
        let (f, (sin, cos)) = (self.gravity * M, HEADING.sin_cos());
        [f.x * cos + f.y * sin, f.x * sin - f.y * cos]
    }

    /// What d'Alembert's principle leaves along a virtual twist, W, and the size of its terms:
    /// Σ m (a − g)·δv + Σ J q̈ δq − Σ τ δq.
    fn lost_power(&self, rates: Pair, along: Pair) -> (f64, f64) {
        let ([v, w], ahead) = (self.twist, vec2(HEADING.cos(), HEADING.sin()));
        let (mut sum, mut size) = (0.0, 0.0);
        let mut add = |term: f64| (sum, size) = (sum + term, size + term.abs());
        for [x, y, mass] in POINTS {
            let arm = ahead * x + ahead.perpendicular() * y;
            let path = ahead * along[0] + arm.perpendicular() * along[1];
            let tangential = ahead * rates[0] + arm.perpendicular() * rates[1];
            let normal = ahead.perpendicular() * (v * w) - arm * (w * w);
            add(mass * (tangential + normal).dot(path));
            add(-mass * self.gravity.dot(path));
        }
        let (turns, paths) = (spins(rates), spins(along));
        for k in 0..2 {
            add(self.robot.spin_inertia * turns[k] * paths[k]);
            add(-self.torque[k] * paths[k]);
        }
        (sum, size)
    }
}

/// Rates of the wheels whose rims move as the ends of the axle; also for virtual twists and rates.
fn spins([v, w]: Pair) -> Pair {
    [(v - 0.5 * L * w) / RHO, (v + 0.5 * L * w) / RHO]
}

/// On level ground, with and without torques.
fn level() -> [Instant; 2] {
    let at = Instant {
        robot: ROBOT,
        twist: [0.8, -1.7],
        torque: [0.0; 2],
        gravity: Vec2::zero(),
    };
    let (twist, torque) = ([-0.6, 1.3], [0.4, -0.9]);
    [
        at,
        Instant {
            twist,
            torque,
            ..at
        },
    ]
}

/// The same on a slope.
fn slope() -> [Instant; 2] {
    let gravity = Ground::plane(9.81, 0.2, 0.4).gravity;
    level().map(|at| Instant { gravity, ..at })
}

/// At rest on the slope, without torques.
fn rest() -> [Instant; 1] {
    let twist = [0.0; 2];
    [Instant {
        twist,
        ..slope()[0]
    }]
}

/// Accelerations (V̇, ω̇) and current rates of the shipped model.
fn shipped_circuit((at, current, voltage): Circuit) -> (Pair, Pair) {
    let mut ground = Ground::flat(9.81);
    ground.gravity = at.gravity;
    let system = at.robot.rolling(ground);
    let layout = system.platform().layout();
    let (v, i, motors) = (layout.velocity(), layout.current(), layout.motors.len());
    let mut x = at.robot.state([0.3, -0.7, HEADING], at.twist);
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
fn shipped_torques((at, rates): (Instant, Pair)) -> Pair {
    let rates = vec2(rates[0], rates[1]);
    let [none, left, right] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|torque| {
        let [v_rate, w_rate] = shipped(Instant { torque, ..at });
        vec2(v_rate, w_rate)
    });
    let (left, right, rates) = (left - none, right - none, rates - none);
    [rates.cross(right), left.cross(rates)].map(|share| share / left.cross(right))
}

/// Rim speeds of the shipped model at a twist.
fn shipped_rims(twist: Pair) -> Pair {
    let system = ROBOT.rolling(Ground::flat(9.81));
    let (layout, x) = (system.platform().layout(), ROBOT.state([0.0; 3], twist));
    let (u, mut y) = (vec![0.0; layout.input()], vec![0.0; layout.output()]);
    system.output(&x, &u, &[1.0; 2], &mut y);
    [0, 1].map(|i| RHO * y[layout.wheel_output(i, WheelOutput::SpinRate)])
}

/// Pose and its rate of the shipped model, from given wheel angles on, after rates were held.
fn shipped_drive(angles: Pair, rates: Pair, end: f64) -> ([f64; 3], [f64; 3]) {
    let system = Kinematic::new(ROBOT.platform()).expect("two driven wheels");
    let (layout, mut x) = (system.platform().layout(), ROBOT.state([0.0; 3], [0.0; 2]));
    let (mut u, mut dx) = (vec![0.0; layout.input()], vec![0.0; x.len()]);
    x[layout.spin(0)..][..2].copy_from_slice(&angles);
    u[..2].copy_from_slice(&rates);
    if end > 0.0 {
        x = integrate(&system, &x, &u, end, Method::Adaptive(1e-14)).0;
    }
    system.derivative(&x, &u, &[1.0; 2], &mut dx);
    ([x[0], x[1], x[YAW]], [dx[0], dx[1], dx[YAW]])
}

/// The current at which the rate of the shipped motor, linear in it, vanishes.
fn shipped_current([voltage, rate]: Pair) -> f64 {
    let winding = MOTOR.winding();
    let of = |current| winding.current_rate(voltage, current, winding.emf * rate);
    of(0.0) / (of(0.0) - of(1.0))
}

/// Check: d'Alembert's principle along both freedoms.
fn dalembert<const N: usize>(at: [Instant; N]) -> impl Fn(&dyn Fn(Instant) -> Pair) -> f64 {
    move |model| {
        worst(at.into_iter().flat_map(|at| {
            let lost = |along| at.lost_power(model(at), along);
            [lost([1.0, 0.0]), lost([0.0, 1.0])].map(|(sum, size)| sum / size)
        }))
    }
}

/// Check: balance of power, which is d'Alembert's principle along the motion itself.
fn power(model: &dyn Fn(Instant) -> Pair) -> f64 {
    worst(slope().map(|at| {
        let (sum, size) = at.lost_power(model(at), at.twist);
        sum / size
    }))
}

/// Check: d'Alembert's principle, for the torques that a model asks for given accelerations.
fn inverse(at: [Instant; 1], rates: Pair) -> impl Fn(&dyn Fn((Instant, Pair)) -> Pair) -> f64 {
    move |model| {
        let torque = model((at[0], rates));
        dalembert(at.map(|at| Instant { torque, ..at }))(&|_| rates)
    }
}

/// Check: rims move as the ends of the axle, turning about the left one, turning about a center
/// beyond the right one, and straight on.
fn axle(model: &dyn Fn(Pair) -> Pair) -> f64 {
    worst([[0.65 * L, 1.3], [0.8, -1.7], [0.4, 0.0]].map(|twist| {
        let ([left, right], ends) = (model(twist), spins(twist).map(|rate| RHO * rate));
        worst([left - ends[0], right - ends[1]]) / worst(ends)
    }))
}

/// Check: electric power of a steady motor = heat of the winding + power of the shaft.
fn steady(model: &dyn Fn(Pair) -> f64) -> f64 {
    worst([[7.0, 0.0], [7.0, 3.0]].map(|[voltage, rate]| {
        let current = model([voltage, rate]);
        let shaft = MOTOR.gear_ratio * MOTOR.torque_constant * current * rate;
        let heat = MOTOR.resistance * current * current;
        (voltage * current - heat - shaft) / (voltage * current)
    }))
}

/// Check: electric power = heat of the windings + rates of magnetic, kinetic, potential energy.
fn circuits(model: &dyn Fn(Circuit) -> (Pair, Pair)) -> f64 {
    worst(slope().map(|mut at| {
        (at.robot.drive, at.torque) = (Drive::DcMotor(MOTOR), [0.0; 2]);
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

/// [ZNL] (30), without weight (21), as inertia, lever of the torques and moment of the weight are
/// filled in.
fn znl_30(at: Instant, i_z: f64, lever: f64, moment: f64) -> Pair {
    let ([v, w], [left, right]) = (at.twist, at.torque);
    let v_rate = (-A * M * w * w + (left + right) / RHO + at.weight()[0]) / M;
    let turning = A * M * w * v + lever / (2.0 * RHO) * (right - left);
    [v_rate, (turning + moment) / i_z]
}

/// [ZNL] (28), mended but for the gear between current and wheel and the rates in the EMF.
fn znl_28((at, current, voltage): Circuit, gear: f64, turning: Pair) -> (Pair, Pair) {
    let torque = current.map(|i| gear * MOTOR.torque_constant * i);
    let rates = znl_30(Instant { torque, ..at }, I_Z, L, A * at.weight()[1]);
    let winding = MOTOR.winding();
    let rate = |k: usize| winding.current_rate(voltage[k], current[k], winding.emf * turning[k]);
    (rates, [rate(0), rate(1)])
}

/// [ZNL] (18): S of (q̈_l, q̈_r) and φ̈, with a factor before the second line.
fn znl_18(at: Instant, [left, right]: Pair, yaw: f64, factor: f64) -> f64 {
    let ([v, w], sum) = (at.twist, right + left);
    let second = 0.5 * RHO * w * w * sum - 0.5 * RHO * w * yaw * (2.0 * v / RHO);
    0.5 * (I_Z * yaw * yaw + 0.25 * M * RHO * RHO * sum * sum) + factor * second
}

/// Central difference with unit steps, exact on quadratic functions.
fn gradient([a, b]: Pair, of: impl Fn(Pair) -> f64) -> Pair {
    [(1.0, 0.0), (0.0, 1.0)].map(|(p, q)| 0.5 * (of([a + p, b + q]) - of([a - p, b - q])))
}

/// (6) puts the wheels ½ m to the left and right.
#[test]
fn errata_znl_6_wheel_positions() {
    // [ZNL] (3), (6): V_{l,r} = V + ωΩr_{l,r}, r_l = ½ y', r_r = −½ y'.
    let published = |[v, w]: Pair| [v - 0.5 * w, v + 0.5 * w];
    judge(axle, published, shipped_rims);
}

/// (7) and (9) lack the track. Check: closure; a right wheel that has rolled 2πl further than the
/// left has brought the robot back.
#[test]
fn errata_znl_7_9_yaw_rate() {
    let ([left, right], turn) = ([3.0, 7.0], std::f64::consts::TAU);
    let check = |model: &dyn Fn(f64) -> [f64; 3]| {
        let [x, y, yaw] = model(turn * L / RHO / (right - left));
        worst([x, y, yaw - turn])
    };
    // [ZNL] (7), (9): ω = ½ (V_r − V_l), φ̇ the same; integrated.
    let published = |t: f64| {
        let (v, w) = (0.5 * RHO * (right + left), 0.5 * RHO * (right - left));
        [v / w * (w * t).sin(), v / w * (1.0 - (w * t).cos()), w * t]
    };
    let ours = |t| shipped_drive([0.0; 2], [left, right], t).0;
    // The adaptive method at 1e-14 a step, over some hundreds of steps.
    judge_within(1e-11, check, published, ours);
}

/// (10) prints an integral as a rate. Check: closure; wheels turned forth and back leave the
/// heading as it was.
#[test]
fn errata_znl_10_third_line() {
    let check = |model: &dyn Fn((Pair, Pair)) -> f64| {
        let angle = |k: i32| 0.5 + f64::from(k.min(31 - k));
        let rate = |k: i32| if k < 16 { 1.0 } else { -1.0 };
        let model = |k| {
            model((
                [3.0 * angle(k), 7.0 * angle(k)],
                [3.0 * rate(k), 7.0 * rate(k)],
            ))
        };
        (0..32).map(model).sum::<f64>().abs()
    };
    // [ZNL] (10): φ̇ = (ρ/l)(q_r − q_l) + C, with C = 0 where the counting starts.
    let published = |([left, right], _): (Pair, Pair)| RHO / L * (right - left);
    let ours = |(angles, rates)| shipped_drive(angles, rates, 0.0).1[2];
    judge(check, published, ours);
}

/// φ̈ and (V̇, ω̇) of the tests of S.
const TURNING: f64 = -2.3;
const RATES: Pair = [0.9, TURNING];
fn turning() -> [Instant; 1] {
    [level()[0]]
}

/// Section 2.2 and (19) derive S by q, not q̈.
#[test]
fn errata_znl_19_derivative() {
    let s = |at, q: Pair| znl_18(at, q, RHO / L * (q[1] - q[0]), A * M);
    let check = inverse(turning(), RATES);
    // [ZNL] (19): Q_i = ∂S/∂q_i.
    let published = |(at, rates)| gradient([0.0; 2], |_q| s(at, spins(rates)));
    judge(&check, published, shipped_torques);
    let mended = check(&|(at, rates)| gradient(spins(rates), |q| s(at, q)));
    assert!(
        mended < ROUNDING,
        "S with a m, derived by q̈, is right: {mended:e}"
    );
}

/// (15) to (21) do not say about which axis i_z is: the central value is wrong.
#[test]
fn errata_znl_15_21_inertia_axis() {
    // [ZNL] (21), i_z about the center of mass.
    let published = |at: Instant| znl_30(at, ROBOT.inertia_com, L, A * at.weight()[1]);
    judge(power, published, shipped);
}

/// The second line of (18) lacks a m.
#[test]
fn errata_znl_18_second_line() {
    // [ZNL] (18): … + (ρ/2) φ̇² (q̈_r + q̈_l) − (ρ/2) φ̇ φ̈ (q̇_r + q̇_l).
    let s = |at, q: Pair| znl_18(at, q, RHO / L * (q[1] - q[0]), 1.0);
    let published = |(at, rates)| gradient(spins(rates), |q| s(at, q));
    judge(inverse(turning(), RATES), published, shipped_torques);
}

/// (18), derived with φ̈ held, has no inertia in yaw.
#[test]
fn errata_znl_18_yaw_held() {
    // [ZNL] (18), (19): ∂S/∂q̈_i at constant φ̈.
    let published = |(at, rates)| gradient(spins(rates), |q| znl_18(at, q, TURNING, A * M));
    judge(inverse(turning(), RATES), published, shipped_torques);
}

/// (20) has V̈ for V̇. Check: work = kinetic energy after a straight start from rest.
#[test]
fn errata_znl_20_acceleration() {
    let force = 2.0 * 0.3 / RHO;
    let check = |model: &dyn Fn(f64) -> Pair| {
        let [way, speed] = model(2.0);
        (0.5 * M * speed * speed / (force * way) - 1.0).abs()
    };
    // [ZNL] (20): m V̈ = −a m ω² + (τ_l + τ_r)/ρ, integrated from rest at ω = 0.
    let published = |t: f64| [force / M * t * t * t / 6.0, force / M * t * t / 2.0];
    let ours = |t| {
        let system = ROBOT.rolling(Ground::flat(9.81));
        let mut u = vec![0.0; system.sizes().input];
        u[..2].copy_from_slice(&[0.3; 2]);
        let start = ROBOT.state([0.0; 3], [0.0; 2]);
        let x = integrate(&system, &start, &u, t, Method::Rk4(1e-2)).0;
        [x[0], x[system.platform().layout().velocity()]]
    };
    // RK4 is exact here; 200 additions round.
    judge_within(1e-13, check, published, ours);
}

/// (20), (21) and (28) give the torques no lever in yaw.
#[test]
fn errata_znl_20_21_lever() {
    // [ZNL] (21): i_z ω̇ = a m ω V + (τ_r − τ_l)/(2ρ).
    let published = |at: Instant| znl_30(at, I_Z, 1.0, A * at.weight()[1]);
    judge(power, published, shipped);
}

/// Assumption 1 neglects what turns with the wheels: rotors of 1e-4 kg·m² count n²-fold.
#[test]
fn errata_znl_assumption_1_rotors() {
    let spin_inertia = MOTOR.gear_ratio * MOTOR.gear_ratio * 1e-4;
    let robot = Differential {
        spin_inertia,
        ..ROBOT
    };
    let check = dalembert(level().map(|at| Instant { robot, ..at }));
    // [ZNL] (21), mended.
    judge(check, |at| znl_30(at, I_Z, L, 0.0), shipped);
}

/// (22) lets an inductance take voltage at constant current, and (25) has the torque for its rate.
#[test]
fn errata_znl_22_25_inductance() {
    let (l, r, k_m) = (MOTOR.inductance, MOTOR.resistance, MOTOR.torque_constant);
    // [ZNL] (22): L I + R I + K_w i q̇ = U.
    let published = |[u, rate]: Pair| (u - MOTOR.back_emf(rate)) / (l + r);
    judge(steady, published, shipped_current);
    // [ZNL] (25): τ = −(R/L) τ − (K_M K_w i/L) q̇ + (K_M/L) U, solved for τ = K_M I of the shaft.
    let published = |[u, rate]: Pair| k_m / l * (u - MOTOR.back_emf(rate)) / (1.0 + r / l) / k_m;
    judge(steady, published, shipped_current);
}

/// (24) in (21), (26), (28): shaft turns wheel without the gear, and wheel shaft with it.
#[test]
fn errata_znl_24_26_28_gear() {
    // [ZNL] (24): τ = K_M I, used at the wheel.
    let published = |at: Circuit| znl_28(at, 1.0, spins(at.0.twist));
    judge(circuits, published, shipped_circuit);
}

/// (27) takes the wheel's radius for the track.
#[test]
fn errata_znl_27_rim_speed() {
    // [ZNL] (27): V + ωl/2 on the right, V − ωr/2 on the left.
    let published = |[v, w]: Pair| [v - w * RHO / 2.0, v + w * L / 2.0];
    judge(axle, published, shipped_rims);
}

/// (28) has the speed of the rim for the rate of the wheel.
#[test]
fn errata_znl_28_radius() {
    // [ZNL] (28): τ̇_{l,r} = … − (K_M K_w i/L)(V ∓ ωl/2) + ….
    let published = |at: Circuit| znl_28(at, MOTOR.gear_ratio, spins(at.0.twist).map(|q| RHO * q));
    judge(circuits, published, shipped_circuit);
}

/// (29) and (30) let the weight act at the axle midpoint: in motion, and released at rest.
#[test]
fn errata_znl_29_30_weight() {
    // [ZNL] (29): Q_{r,l} = τ_{r,l} + (ρ/2)(f_x cos φ + f_y sin φ), so that (30) has no moment.
    let published = |at| znl_30(at, I_Z, L, 0.0);
    judge(power, published, shipped);
    judge(dalembert(rest()), published, shipped);
}

/// After (30): two equal torques hold the robot. Check: equilibrium of the point masses.
#[test]
fn errata_znl_30_equal_torques() {
    // [ZNL] after (30): τ_l = τ_r = −(ρ/2)(f_x cos φ + f_y sin φ).
    let published = |(at, _): (Instant, Pair)| [-0.5 * RHO * at.weight()[0]; 2];
    judge(inverse(rest(), [0.0; 2]), published, shipped_torques);
}

/// The first method divides by ω.
#[test]
fn errata_blog_method_one() {
    // [BLOG] R = v/ω, φ̇_{l,r} = ω (R ∓ l/2)/r; here as rim speeds.
    let published = |[v, w]: Pair| [w * (v / w - 0.5 * L), w * (v / w + 0.5 * L)];
    judge(axle, published, shipped_rims);
}

/// An arc for v_l > v_r only. Check: share of misjudged motions among known ones. The amended
/// |v_l| ≠ |v_r| says the same as v_l ≠ ±v_r and passes.
#[test]
fn errata_blog_arc_condition() {
    let others = [[1.0, 1.0], [-2.0, -2.0], [1.5, -1.5], [-1.5, 1.5]];
    let arcs = [[2.0, 1.0], [1.0, 2.0], [0.0, 2.0], [-1.0, 2.0]];
    let check = |is_arc: &dyn Fn(Pair) -> bool| {
        let missed = arcs.into_iter().filter(|&rates| !is_arc(rates)).count();
        (missed + others.into_iter().filter(|&rates| is_arc(rates)).count()) as f64 / 8.0
    };
    // Driven for a second: the heading has changed, and the place.
    let ours = |rates| {
        let [x, y, yaw] = shipped_drive([0.0; 2], rates, 1.0).0;
        yaw.abs() > 1e-9 && x.hypot(y) > 1e-9
    };
    // [BLOG] kinds of motion, first form.
    judge(check, |[left, right]| left > right, ours);
    assert_eq!(check(&|[left, right]| left.abs() != right.abs()), 0.0);
}

/// The heading as the direction of v_c. Check: the speed along the heading is the mean of the
/// rims, in reverse as well.
#[test]
fn errata_blog_heading_in_reverse() {
    let check = |model: &dyn Fn(Pair) -> [f64; 3]| {
        worst([[3.0, 7.0], [-3.0, -7.0]].map(|[left, right]| {
            let [x_rate, y_rate, heading] = model([left, right]);
            let along = x_rate * heading.cos() + y_rate * heading.sin();
            along / (0.5 * RHO * (left + right)) - 1.0
        }))
    };
    let ours = |rates| {
        let (pose, [x_rate, y_rate, _]) = shipped_drive([0.0; 2], rates, 0.7);
        [x_rate, y_rate, pose[2]]
    };
    // [BLOG] θ is the angle between v_c and X.
    let published = |rates| {
        let [x_rate, y_rate, _] = ours(rates);
        [x_rate, y_rate, y_rate.atan2(x_rate)]
    };
    judge(check, published, ours);
}
