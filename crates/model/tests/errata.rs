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
use std::f64::consts::TAU;

/// A published form has to miss its check by more than this part of the terms it adds up.
const MARGIN: f64 = 1e-2;
/// Some twenty operations, each rounded to 1e-16 of the terms added up.
const ROUNDING: f64 = 1e-14;
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
/// Commanded spin rates, rad/s: an arc forward.
const RATES: [f64; 2] = [3.0, 7.0];

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

/// A robot in motion under wheel torques and in-plane gravity.
#[derive(Clone, Copy)]
struct Instant {
    robot: Differential,
    yaw: f64,
    /// V, m/s, and ω, rad/s.
    twist: [f64; 2],
    /// Left and right, N·m.
    torque: [f64; 2],
    /// World frame, m/s².
    gravity: Vec2<f64>,
    /// Inertia of the rotor of each motor, kg·m².
    rotor: f64,
}

impl Instant {
    /// The symbols of [ZNL]: m, a, i_z about the axle midpoint, l, ρ.
    fn symbols(&self) -> [f64; 5] {
        let (m, a) = (self.robot.mass, -self.robot.ahead);
        let i_z = self.robot.inertia_com + m * a * a;
        [m, a, i_z, 2.0 * self.robot.half_track, self.robot.radius]
    }

    /// f_x, f_y, cos φ, sin φ of [ZNL].
    fn weight(&self) -> [f64; 4] {
        let f = self.gravity * self.robot.mass;
        [f.x, f.y, self.yaw.cos(), self.yaw.sin()]
    }

    /// What is left of d'Alembert's principle along the virtual twist `along`, W, and the sum of
    /// the sizes of its terms: Σ m (a − g)·δv + Σ J n² q̈ δq − Σ τ δq.
    fn lost_power(&self, [v_rate, w_rate]: [f64; 2], along: [f64; 2]) -> (f64, f64) {
        let ([v, w], half) = (self.twist, self.robot.half_track);
        let ahead = vec2(self.yaw.cos(), self.yaw.sin());
        let (mut sum, mut size) = (0.0, 0.0);
        let mut add = |term: f64| (sum, size) = (sum + term, size + term.abs());
        for (x, y, mass) in POINTS {
            let arm = ahead * x + ahead.perpendicular() * y;
            let virtual_velocity = ahead * along[0] + arm.perpendicular() * along[1];
            let acceleration = ahead * v_rate + ahead.perpendicular() * (v * w)
                + arm.perpendicular() * w_rate
                - arm * (w * w);
            add(mass * acceleration.dot(virtual_velocity));
            add(-mass * self.gravity.dot(virtual_velocity));
        }
        for (side, torque) in [(-half, self.torque[0]), (half, self.torque[1])] {
            let turn = |twist: [f64; 2]| (twist[0] + side * twist[1]) / self.robot.radius;
            let gear = MOTOR.gear_ratio;
            add(self.rotor * gear * turn([v_rate, w_rate]) * gear * turn(along));
            add(-torque * turn(along));
        }
        (sum, size)
    }
}

fn instant(twist: [f64; 2], torque: [f64; 2]) -> Instant {
    Instant {
        robot: robot(),
        yaw: 1.1,
        twist,
        torque,
        gravity: Vec2::zero(),
        rotor: 0.0,
    }
}

/// In motion, with and without torques.
fn level() -> [Instant; 3] {
    [
        instant([0.8, -1.7], [0.0, 0.0]),
        instant([-0.6, 1.3], [0.4, -0.9]),
        instant([0.5, 2.1], [1.1, 0.7]),
    ]
}

/// The same instants on a slope, and one at rest.
fn slope() -> [Instant; 4] {
    let [a, b, c] = level();
    [a, b, c, instant([0.0; 2], [0.0; 2])].map(|at| Instant {
        gravity: Ground::plane(9.81, 0.2, 0.4).gravity,
        ..at
    })
}

/// Accelerations (V̇, ω̇) and current rates of the shipped model.
fn shipped_circuit((at, current, voltage): Circuit) -> ([f64; 2], [f64; 2]) {
    let ground = Ground {
        gravity: at.gravity,
        gravity_normal: 9.6,
    };
    let system = at.robot.rolling(ground);
    let layout = system.platform().layout();
    let mut x = at.robot.state([0.3, -0.7, at.yaw], at.twist);
    let (mut u, mut dx) = (vec![0.0; layout.input()], vec![0.0; layout.state()]);
    let (v, i) = (layout.velocity(), layout.current());
    let motors = layout.motors.len();
    x[i..i + motors].copy_from_slice(&current[..motors]);
    u[..2].copy_from_slice(if motors > 0 { &voltage } else { &at.torque });
    system.derivative(&x, &u, &[1.0; 2], &mut dx);
    ([dx[v], dx[v + 1]], if motors > 0 { [dx[i], dx[i + 1]] } else { [0.0; 2] })
}

fn shipped(at: Instant) -> [f64; 2] {
    shipped_circuit((at, [0.0; 2], [0.0; 2])).0
}

/// The torques at which the shipped model has given accelerations: its affine law, solved.
fn shipped_torques((at, [v_rate, w_rate]): (Instant, [f64; 2])) -> [f64; 2] {
    let under = |torque| shipped(Instant { torque, ..at });
    let (none, left, right) = (under([0.0; 2]), under([1.0, 0.0]), under([0.0, 1.0]));
    let [a, b, c, d] = [0, 1].map(|k| [left[k] - none[k], right[k] - none[k]]).as_flattened()[..] else {
        unreachable!("two rows of two")
    };
    let (p, q) = (v_rate - none[0], w_rate - none[1]);
    [(p * d - q * b) / (a * d - b * c), (q * a - p * c) / (a * d - b * c)]
}

/// Rim speeds (left, right) of the shipped model at a twist.
fn shipped_rims((robot, twist): (Differential, [f64; 2])) -> [f64; 2] {
    let system = robot.rolling(Ground::flat(9.81));
    let layout = system.platform().layout();
    let (x, u) = (robot.state([0.3, -0.7, 1.1], twist), vec![0.0; layout.input()]);
    let mut y = vec![0.0; layout.output()];
    system.output(&x, &u, &[1.0; 2], &mut y);
    [0, 1].map(|i| robot.radius * y[layout.wheel_output(i, WheelOutput::SpinRate)])
}

/// State and its rate after commanded wheel rates have been held for a time.
fn shipped_drive(rates: [f64; 2], angles: [f64; 2], yaw: f64, end: f64) -> (Vec<f64>, Vec<f64>) {
    let drive = Drive::Rate { rate_max: f64::MAX };
    let robot = Differential { drive, ..robot() };
    let system = Kinematic::new(robot.platform()).expect("two driven wheels");
    let layout = system.platform().layout();
    let mut x = robot.state([0.0, 0.0, yaw], [0.0; 2]);
    (x[layout.spin(0)], x[layout.spin(1)]) = (angles[0], angles[1]);
    let (mut u, mut dx) = (vec![0.0; layout.input()], vec![0.0; layout.state()]);
    u[..2].copy_from_slice(&rates);
    if end > 0.0 {
        x = integrate(&system, &x, &u, end, Method::Adaptive(1e-14)).0;
    }
    system.derivative(&x, &u, &[1.0; 2], &mut dx);
    (x, dx)
}

// The checks. Each takes a model, published or shipped, and returns its relative residual.

/// D'Alembert's principle along both freedoms, for the accelerations of a model.
fn dalembert(instants: &[Instant], model: &dyn Fn(Instant) -> [f64; 2]) -> f64 {
    worst(instants.iter().flat_map(|at| {
        let accelerations = model(*at);
        [[1.0, 0.0], [0.0, 1.0]].map(|along| {
            let (sum, size) = at.lost_power(accelerations, along);
            sum / size
        })
    }))
}

/// Power of the torques = rate of the energy of the point masses.
fn power(instants: &[Instant], model: &dyn Fn(Instant) -> [f64; 2]) -> f64 {
    worst(instants.iter().map(|at| {
        let (sum, size) = at.lost_power(model(*at), at.twist);
        sum / size
    }))
}

/// D'Alembert's principle, for the torques that a model asks for given accelerations.
fn torques(instants: &[Instant], accelerations: [f64; 2], model: &Torques<'_>) -> f64 {
    worst(instants.iter().map(|at| {
        let torque = model((*at, accelerations));
        dalembert(&[Instant { torque, ..*at }], &|_| accelerations)
    }))
}
type Torques<'a> = dyn Fn((Instant, [f64; 2])) -> [f64; 2] + 'a;

/// The rims move as the ends of an axle of length l do: turning about one of them, turning about a
/// center beyond it, and straight on.
fn axle(model: &dyn Fn((Differential, [f64; 2])) -> [f64; 2]) -> f64 {
    let robot = robot();
    let half = robot.half_track;
    worst([[1.3 * half, 1.3], [0.8, -1.7], [0.4, 0.0]].map(|[v, w]| {
        let [left, right] = model((robot, [v, w]));
        let size = v.abs() + half * w.abs();
        worst([left - (v - half * w), right - (v + half * w)]) / size
    }))
}

/// A full circle: when the right wheel has rolled 2πl further than the left, the robot is back.
fn circle(model: &dyn Fn(f64) -> [f64; 3]) -> f64 {
    let robot = robot();
    let end = TAU * 2.0 * robot.half_track / (robot.radius * (RATES[1] - RATES[0]));
    let [x, y, yaw] = model(end);
    worst([x, y, yaw - TAU])
}

/// Exact pose after an arc at V, ω.
fn arc(v: f64, w: f64, t: f64) -> [f64; 3] {
    [v / w * (w * t).sin(), v / w * (1.0 - (w * t).cos()), w * t]
}

/// Dimension: a model with a result in m^p s^q gives the same motion in other units.
fn units(model: &dyn Fn(Winding) -> (f64, [i32; 2])) -> f64 {
    let here = Winding {
        robot: robot(),
        twist: [0.8, -1.7],
        motor: MOTOR,
        torque: 0.3,
        voltage: 7.0,
    };
    worst([(100.0_f64, 1.0_f64), (1.0, 60.0), (7.0, 0.2)].map(|(per_meter, per_second)| {
        let (value, [p, q]) = model(here);
        let there = model(here.counted(per_meter, per_second)).0;
        there / (value * per_meter.powi(p) * per_second.powi(q)) - 1.0
    }))
}

/// The numbers of a motor at a rolling wheel; `torque` is that of the wheel.
#[derive(Clone, Copy)]
struct Winding {
    robot: Differential,
    twist: [f64; 2],
    motor: DcMotor<f64>,
    torque: f64,
    voltage: f64,
}

impl Winding {
    /// The same in units of which so many make a meter and a second (kg and A are kept).
    fn counted(self, meter: f64, second: f64) -> Self {
        let (area, rate) = (meter * meter, 1.0 / second);
        let constant = area * rate * rate;
        Winding {
            robot: Differential {
                half_track: self.robot.half_track * meter,
                radius: self.robot.radius * meter,
                ..self.robot
            },
            twist: [self.twist[0] * meter * rate, self.twist[1] * rate],
            motor: DcMotor {
                resistance: self.motor.resistance * constant * rate,
                inductance: self.motor.inductance * constant,
                torque_constant: self.motor.torque_constant * constant,
                back_emf_constant: self.motor.back_emf_constant * constant,
                ..self.motor
            },
            torque: self.torque * constant,
            voltage: self.voltage * constant * rate,
        }
    }

    /// [ZNL]'s L, R, K_M, K_w, i.
    fn symbols(&self) -> [f64; 5] {
        let m = &self.motor;
        [m.inductance, m.resistance, m.torque_constant, m.back_emf_constant, m.gear_ratio]
    }
}

/// Rate of the left wheel's torque by the shipped motor and platform, N·m/s.
fn shipped_torque_rate(at: Winding) -> (f64, [i32; 2]) {
    let rate = shipped_rims((at.robot, at.twist))[0] / at.robot.radius;
    let per_current = at.motor.torque_per_current();
    let current_rate = at.motor.current_rate(at.voltage, at.torque / per_current, rate);
    (per_current * current_rate, [2, -3])
}

/// Electric power of a steady motor = heat of the winding + power of the shaft.
fn steady(model: &dyn Fn([f64; 2]) -> f64) -> f64 {
    worst([[7.0, 0.0], [7.0, 3.0], [-4.0, 2.0]].map(|[voltage, rate]| {
        let current = model([voltage, rate]);
        let shaft = MOTOR.gear_ratio * MOTOR.torque_constant * current * rate;
        let (supplied, heat) = (voltage * current, MOTOR.resistance * current * current);
        (supplied - heat - shaft) / (supplied.abs() + heat + shaft.abs())
    }))
}

/// An instant with the currents and voltages of the motors, left and right.
type Circuit = (Instant, [f64; 2], [f64; 2]);

/// Voltage × current = heat of the windings + rates of magnetic, kinetic and potential energy.
fn electric_power(model: &dyn Fn(Circuit) -> ([f64; 2], [f64; 2])) -> f64 {
    worst(slope()[..3].iter().map(|at| {
        let robot = Differential { drive: Drive::DcMotor(MOTOR), ..at.robot };
        let at = Instant { robot, torque: [0.0; 2], ..*at };
        let (current, voltage) = ([1.7, -0.6], [9.0, 4.0]);
        let (accelerations, current_rate) = model((at, current, voltage));
        let (mut sum, mut size) = at.lost_power(accelerations, at.twist);
        for k in 0..2 {
            let magnetic = MOTOR.inductance * current[k] * current_rate[k];
            let heat = MOTOR.resistance * current[k] * current[k];
            sum += magnetic + heat - voltage[k] * current[k];
            size += magnetic.abs() + heat + (voltage[k] * current[k]).abs();
        }
        sum / size
    }))
}

/// Central difference with unit steps, exact on quadratic functions.
fn gradient(at: [f64; 2], of: impl Fn([f64; 2]) -> f64) -> [f64; 2] {
    let [a, b] = at;
    [
        0.5 * (of([a + 1.0, b]) - of([a - 1.0, b])),
        0.5 * (of([a, b + 1.0]) - of([a, b - 1.0])),
    ]
}

/// [ZNL] (18): S for (q̈_l, q̈_r) and φ̈, with `factor` before the second line.
fn acceleration_energy(at: Instant, [left, right]: [f64; 2], yaw: f64, factor: f64) -> f64 {
    let [m, _, i_z, _, rho] = at.symbols();
    let ([v, yaw_rate], sum) = (at.twist, right + left);
    let spins = 2.0 * v / rho;
    0.5 * (i_z * yaw * yaw + 0.25 * m * rho * rho * sum * sum)
        + factor * 0.5 * rho * (yaw_rate * yaw_rate * sum - yaw_rate * yaw * spins)
}

/// (q̈_l, q̈_r) for (V̇, ω̇).
fn spin_accelerations(at: Instant, [v_rate, w_rate]: [f64; 2]) -> [f64; 2] {
    [-0.5, 0.5].map(|side| (v_rate + side * at.symbols()[3] * w_rate) / at.robot.radius)
}

/// φ̈ for (q̈_l, q̈_r).
fn yaw_acceleration(at: Instant, [left, right]: [f64; 2]) -> f64 {
    let [.., l, rho] = at.symbols();
    rho / l * (right - left)
}
const ACCELERATIONS: [f64; 2] = [0.9, -2.3];

// Kinematics.

/// (6) puts the wheels ½ m to the left and right. Check: the rims are the ends of the axle.
#[test]
fn errata_znl_6_wheel_positions() {
    // [ZNL] (3), (6): V_{l,r} = V + ωΩr_{l,r}, r_l = ½ y', r_r = −½ y'.
    let published = |(_, [v, w]): (Differential, [f64; 2])| [v - 0.5 * w, v + 0.5 * w];
    judge(axle, published, shipped_rims, ROUNDING);
}

/// (7) and (9) lack the track. Check: closure of a circle.
#[test]
fn errata_znl_7_9_yaw_rate() {
    let [left, right] = RATES.map(|rate| rate * robot().radius);
    // [ZNL] (7), (9): ω = ½ (V_r − V_l), φ̇ the same.
    let published = |end| arc(0.5 * (right + left), 0.5 * (right - left), end);
    judge(circle, published, shipped_circle, INTEGRATION);
}
/// The adaptive method at 1e-14 a step, over some hundreds of steps.
const INTEGRATION: f64 = 1e-11;
fn shipped_circle(end: f64) -> [f64; 3] {
    let x = shipped_drive(RATES, [0.0; 2], 0.0, end).0;
    [x[0], x[1], x[YAW]]
}

/// The package feeds wheel rates to (9), which takes rim speeds. Check: closure of a circle.
#[test]
fn errata_znl_package_wheel_rates() {
    let ([left, right], l) = (RATES, 2.0 * robot().half_track);
    // [ZNL] components of the package, with (9) mended: V_{l,r} replaced by q̇_{l,r}.
    let published = |end| arc(0.5 * (right + left), (right - left) / l, end);
    judge(circle, published, shipped_circle, INTEGRATION);
}

/// The third line of (10) is an integral and printed as a rate. Check: closure; wheels turned forth
/// and back again leave the heading as it was.
#[test]
fn errata_znl_10_third_line() {
    let check = |model: &dyn Fn([[f64; 2]; 2]) -> f64| {
        let turned = |k: f64| RATES.map(|rate| rate * k / 16.0);
        let forth = (0..16).map(|k| model([turned(f64::from(k) + 0.5), RATES]));
        let back = (0..16).map(|k| model([turned(15.5 - f64::from(k)), RATES.map(|r| -r)]));
        forth.chain(back).sum::<f64>() / 32.0
    };
    // [ZNL] (10): φ̇ = (ρ/l)(q_r − q_l) + C, with C = 0 where the counting starts.
    let published = |[[left, right], _]: [[f64; 2]; 2]| {
        robot().radius / (2.0 * robot().half_track) * (right - left)
    };
    let ours = |[angles, rates]: [[f64; 2]; 2]| shipped_drive(rates, angles, 0.0, 0.0).1[YAW];
    judge(check, published, ours, ROUNDING);
}

// Appell's equations.

/// Section 2.2 and (19) derive S by q. Check: d'Alembert's principle under the torques they ask for.
#[test]
fn errata_znl_19_derivative() {
    let check = |model: &Torques<'_>| torques(&level(), ACCELERATIONS, model);
    let of = |at: Instant, q: [f64; 2]| {
        let [m, a, ..] = at.symbols();
        acceleration_energy(at, q, yaw_acceleration(at, q), a * m)
    };
    // [ZNL] (19): Q_i = ∂S/∂q_i.
    let published = |(at, rates)| {
        let q_accelerations = spin_accelerations(at, rates);
        gradient([0.0; 2], |_q| of(at, q_accelerations))
    };
    judge(check, published, shipped_torques, ROUNDING * 10.0);
    // By q̈ it is right: the derivative, not S, was at fault.
    let mended = |(at, rates)| gradient(spin_accelerations(at, rates), |q| of(at, q));
    assert!(check(&mended) < ROUNDING * 10.0);
}

/// (15) to (21) do not say about which axis i_z is. Check: power with the central value for it.
#[test]
fn errata_znl_15_21_inertia_axis() {
    let check = |model: &dyn Fn(Instant) -> [f64; 2]| power(&level(), model);
    // [ZNL] (21) with i_z about the center of mass; V̇, l mended.
    let published = |at: Instant| {
        let ([m, a, _, l, rho], [v, w], [left, right]) = (at.symbols(), at.twist, at.torque);
        let i_z = at.robot.inertia_com;
        [
            (-a * m * w * w + (left + right) / rho) / m,
            (a * m * w * v + l / (2.0 * rho) * (right - left)) / i_z,
        ]
    };
    judge(check, published, shipped, ROUNDING);
}

/// The second line of (18) lacks a m. Check: d'Alembert's principle under the torques it asks for.
#[test]
fn errata_znl_18_second_line() {
    // [ZNL] (18): … + (ρ/2) φ̇² (q̈_r + q̈_l) − (ρ/2) φ̇ φ̈ (q̇_r + q̇_l).
    let published = |(at, rates)| {
        gradient(spin_accelerations(at, rates), |q| {
            acceleration_energy(at, q, yaw_acceleration(at, q), 1.0)
        })
    };
    let check = |model: &Torques<'_>| torques(&level(), ACCELERATIONS, model);
    judge(check, published, shipped_torques, ROUNDING * 10.0);
}

/// (18) derived with φ̈ held has no yaw inertia. Check: d'Alembert's principle, as before.
#[test]
fn errata_znl_18_yaw_held() {
    // [ZNL] (18), (19): ∂S/∂q̈_i at constant φ̈, with a m mended.
    let published = |(at, rates): (Instant, [f64; 2])| {
        let [m, a, ..] = at.symbols();
        gradient(spin_accelerations(at, rates), |q| acceleration_energy(at, q, rates[1], a * m))
    };
    let check = |model: &Torques<'_>| torques(&level(), ACCELERATIONS, model);
    judge(check, published, shipped_torques, ROUNDING * 10.0);
}

/// (20) has V̈ for V̇. Check: work = kinetic energy after a straight start from rest.
#[test]
fn errata_znl_20_acceleration() {
    let (torque, end) = ([0.3; 2], 2.0);
    let force = 2.0 * torque[0] / robot().radius;
    let check = |model: &dyn Fn(f64) -> [f64; 2]| {
        let [way, speed] = model(end);
        0.5 * robot().mass * speed * speed / (force * way) - 1.0
    };
    let check = |model: &dyn Fn(f64) -> [f64; 2]| check(model).abs();
    // [ZNL] (20): m V̈ = −a m ω² + (τ_l + τ_r)/ρ, integrated from rest at ω = 0.
    let published = |t: f64| [force / robot().mass * t.powi(3) / 6.0, force / robot().mass * t * t / 2.0];
    let ours = |t: f64| {
        let system = robot().rolling(Ground::flat(9.81));
        let mut u = vec![0.0; system.sizes().input];
        u[..2].copy_from_slice(&torque);
        let x = integrate(&system, &robot().state([0.0; 3], [0.0; 2]), &u, t, Method::Rk4(1e-2)).0;
        [x[0], x[system.platform().layout().velocity()]]
    };
    // RK4 is exact here; 200 additions round.
    judge(check, published, ours, 1e-13);
}

/// (20), (21) and (28) give the torques no lever in yaw. Check: power of a turning robot.
#[test]
fn errata_znl_20_21_lever() {
    let check = |model: &dyn Fn(Instant) -> [f64; 2]| power(&level(), model);
    // [ZNL] (21): ω̇ = (a m ω V + (τ_r − τ_l)/(2ρ))/i_z; V̇ mended.
    let published = |at: Instant| {
        let ([m, a, i_z, _, rho], [v, w], [left, right]) = (at.symbols(), at.twist, at.torque);
        [
            (-a * m * w * w + (left + right) / rho) / m,
            (a * m * w * v + (right - left) / (2.0 * rho)) / i_z,
        ]
    };
    judge(check, published, shipped, ROUNDING);
}

/// Assumption 1 neglects what turns with the wheels. Check: d'Alembert's principle with rotors of
/// 1e-4 kg·m², which turn n times as fast.
#[test]
fn errata_znl_assumption_1_rotors() {
    let instants = level().map(|at| {
        let rotor = 1e-4;
        let spin_inertia = MOTOR.gear_ratio * MOTOR.gear_ratio * rotor;
        Instant { robot: Differential { spin_inertia, ..at.robot }, rotor, ..at }
    });
    let check = |model: &dyn Fn(Instant) -> [f64; 2]| dalembert(&instants, model);
    // [ZNL] (21), all slips mended.
    let published = |at: Instant| {
        let ([m, a, i_z, l, rho], [v, w], [left, right]) = (at.symbols(), at.twist, at.torque);
        [
            (-a * m * w * w + (left + right) / rho) / m,
            (a * m * w * v + l / (2.0 * rho) * (right - left)) / i_z,
        ]
    };
    judge(check, published, shipped, ROUNDING);
}

// Motors.

/// (22) lets an inductance take voltage at constant current. Check: power of a steady motor.
#[test]
fn errata_znl_22_inductance() {
    let MOTOR = DcMotor { inductance, resistance, .. } else { unreachable!() };
    // [ZNL] (22): L I + R I + K_w i q̇ = U.
    let published = |[voltage, rate]: [f64; 2]| (voltage - MOTOR.back_emf(rate)) / (inductance + resistance);
    // The current at which the rate of the shipped motor, linear in it, vanishes.
    let ours = |[voltage, rate]: [f64; 2]| {
        let of = |current| MOTOR.current_rate(voltage, current, rate);
        of(0.0) / (of(0.0) - of(1.0))
    };
    judge(steady, published, ours, ROUNDING);
}

/// (24) into (21), (26) and (28) lets the motor's shaft turn the wheel without a gear, and the wheel
/// the motor with one. Check: power of robot and circuits together.
#[test]
fn errata_znl_24_26_28_gear() {
    // [ZNL] (24): τ = K_M I; (26): τ̇ = −(R/L) τ − (K_M K_w i/L) q̇ + (K_M/L) U; (30) and l mended.
    let published = |(at, current, voltage): Circuit| {
        let ([m, a, i_z, l, rho], [v, w]) = (at.symbols(), at.twist);
        let [f_x, f_y, cos, sin] = at.weight();
        let (constant, emf) = (MOTOR.torque_constant, MOTOR.back_emf_constant);
        let [left, right] = current.map(|i| constant * i);
        let rate = |k: usize, q_rate: f64| {
            let torque_rate = -MOTOR.resistance / MOTOR.inductance * constant * current[k]
                - constant * emf * MOTOR.gear_ratio / MOTOR.inductance * q_rate
                + constant / MOTOR.inductance * voltage[k];
            torque_rate / constant
        };
        let v_rate = (-a * m * w * w + (left + right) / rho + f_x * cos + f_y * sin) / m;
        let swing = a * (f_x * sin - f_y * cos);
        let w_rate = (a * m * w * v + l / (2.0 * rho) * (right - left) + swing) / i_z;
        let (q_left, q_right) = ((v - 0.5 * l * w) / rho, (v + 0.5 * l * w) / rho);
        ([v_rate, w_rate], [rate(0, q_left), rate(1, q_right)])
    };
    judge(electric_power, published, shipped_circuit, ROUNDING);
}

/// (25) equates a torque with a rate. Check: dimension.
#[test]
fn errata_znl_25_rate() {
    // [ZNL] (25): τ = −(R/L) τ − (K_M K_w i/L) q̇ + (K_M/L) U, solved for τ, in N·m.
    let published = |at: Winding| {
        let [l, r, k_m, k_w, i] = at.symbols();
        let q_rate = (at.twist[0] - at.robot.half_track * at.twist[1]) / at.robot.radius;
        let right = -k_m * k_w * i / l * q_rate + k_m / l * at.voltage;
        (right / (1.0 + r / l), [2, -2])
    };
    judge(units, published, shipped_torque_rate, ROUNDING);
}

/// (27) takes the wheel's radius for the track. Check: the rims are the ends of the axle.
#[test]
fn errata_znl_27_rim_speed() {
    // [ZNL] (27): V + ωl/2 on the right, V − ωr/2 on the left.
    let published = |(robot, [v, w]): (Differential, [f64; 2])| {
        [v - 0.5 * w * robot.radius, v + w * robot.half_track]
    };
    judge(axle, published, shipped_rims, ROUNDING);
}

/// (28) has a rim speed for a wheel's rate. Check: dimension.
#[test]
fn errata_znl_28_radius() {
    // [ZNL] (28): τ̇_l = −(R/L) τ_l − (K_M K_w i/L)(V − ωl/2) + (K_M/L) U_l.
    let published = |at: Winding| {
        let [l, r, k_m, k_w, i] = at.symbols();
        let rim = at.twist[0] - at.robot.half_track * at.twist[1];
        let rate = -r / l * at.torque - k_m * k_w * i / l * rim + k_m / l * at.voltage;
        (rate, [2, -3])
    };
    judge(units, published, shipped_torque_rate, ROUNDING);
}

// Inclined plane.

/// (29) lets the weight act at the axle midpoint. Check: virtual work on the point masses.
#[test]
fn errata_znl_29_generalized_forces() {
    let check = |model: &dyn Fn(Instant) -> [f64; 2]| {
        worst(slope().into_iter().flat_map(|at| {
            let ([.., l, rho], forces) = (at.symbols(), model(at));
            // At rest d'Alembert's sum is minus the work of all forces.
            let still = Instant { twist: [0.0; 2], ..at };
            [0, 1].map(|k| {
                let side = [-rho / l, rho / l][k];
                let (sum, size) = still.lost_power([0.0; 2], [0.5 * rho, side]);
                (forces[k] + sum) / size
            })
        }))
    };
    // [ZNL] (29): Q_{r,l} = τ_{r,l} + (ρ/2)(f_x cos φ + f_y sin φ).
    let published = |at: Instant| {
        let (rho, [f_x, f_y, cos, sin]) = (at.robot.radius, at.weight());
        at.torque.map(|torque| torque + 0.5 * rho * (f_x * cos + f_y * sin))
    };
    // The shipped forces over (V, ω), turned to (q_l, q_r) by the inverse of the spin rows.
    let ours = |at: Instant| {
        let system = at.robot.rolling(Ground::flat(9.81));
        let reduced = system.reduced(&at.robot.state([0.0, 0.0, at.yaw], at.twist));
        let weight = at.gravity.rotated(at.yaw.cos(), -at.yaw.sin());
        let [v, w] = [0, 1].map(|k| reduced.momentum[0][k] * weight.x + reduced.momentum[1][k] * weight.y);
        let [[a, b], [c, d]] = [0, 1].map(|i| [reduced.spin[i][0], reduced.spin[i][1]]);
        let det = a * d - b * c;
        [at.torque[0] + (v * d - w * c) / det, at.torque[1] + (w * a - v * b) / det]
    };
    judge(check, published, ours, ROUNDING);
}

/// (30) has the yaw equation of level ground. Check: d'Alembert's principle on a slope.
#[test]
fn errata_znl_30_yaw_on_slope() {
    // [ZNL] (30), l mended.
    let published = |at: Instant| {
        let ([m, a, i_z, l, rho], [v, w], [left, right]) = (at.symbols(), at.twist, at.torque);
        let [f_x, f_y, cos, sin] = at.weight();
        [
            (-a * m * w * w + (left + right) / rho + f_x * cos + f_y * sin) / m,
            (a * m * w * v + l / (2.0 * rho) * (right - left)) / i_z,
        ]
    };
    let check = |model: &dyn Fn(Instant) -> [f64; 2]| dalembert(&slope(), model);
    judge(check, published, shipped, ROUNDING);
    let check = |model: &dyn Fn(Instant) -> [f64; 2]| power(&slope()[..3], model);
    judge(check, published, shipped, ROUNDING);
}

/// After (30): two equal torques hold the robot. Check: equilibrium of the point masses at rest.
#[test]
fn errata_znl_30_equal_torques() {
    let check = |model: &Torques<'_>| torques(&slope()[3..], [0.0; 2], model);
    // [ZNL] after (30): τ_l = τ_r = −(ρ/2)(f_x cos φ + f_y sin φ).
    let published = |(at, _): (Instant, [f64; 2])| {
        let [f_x, f_y, cos, sin] = at.weight();
        [-0.5 * at.robot.radius * (f_x * cos + f_y * sin); 2]
    };
    judge(check, published, shipped_torques, ROUNDING * 10.0);
}

// The blog.

/// The first method divides by ω. Check: the rims are the ends of the axle, straight on as well.
#[test]
fn errata_blog_method_one() {
    // [BLOG] R = v/ω, φ̇_{l,r} = ω (R ∓ l/2)/r; here as rim speeds.
    let published = |(robot, [v, w]): (Differential, [f64; 2])| {
        let radius = v / w;
        [w * (radius - robot.half_track), w * (radius + robot.half_track)]
    };
    judge(axle, published, shipped_rims, ROUNDING);
}

/// An arc for v_l > v_r only. Check: share of misjudged motions among known ones. The amended form,
/// |v_l| ≠ |v_r|, says the same as v_l ≠ ±v_r and passes.
#[test]
fn errata_blog_arc_condition() {
    let known = [
        ([1.0, 1.0], false),
        ([-2.0, -2.0], false),
        ([1.5, -1.5], false),
        ([-1.5, 1.5], false),
        ([2.0, 1.0], true),
        ([1.0, 2.0], true),
        ([0.0, 2.0], true),
        ([-1.0, 2.0], true),
        ([-1.0, -2.0], true),
    ];
    let check = |model: &dyn Fn([f64; 2]) -> bool| {
        let missed = known.iter().filter(|(speeds, is_arc)| model(*speeds) != *is_arc);
        missed.count() as f64 / known.len() as f64
    };
    // Driven for a second: the heading has changed, and the place.
    let ours = |speeds: [f64; 2]| {
        let x = shipped_drive(speeds, [0.0; 2], 0.0, 1.0).0;
        x[YAW].abs() > 1e-9 && x[0].hypot(x[1]) > 1e-9
    };
    // [BLOG] kinds of motion, first form: an arc if v_l > v_r.
    judge(check, |[left, right]| left > right, ours, 0.0);
    assert_eq!(check(&|[left, right]| left.abs() != right.abs()), 0.0);
}

/// The heading as the direction of v_c. Check: travel along the heading is the mean rim speed, in
/// reverse as well.
#[test]
fn errata_blog_heading_in_reverse() {
    let check = |model: &dyn Fn([f64; 2]) -> ([f64; 2], f64)| {
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
        let (travel, _) = ours(rates);
        (travel, travel[1].atan2(travel[0]))
    };
    // The state carries cos θ beside θ, renewed at each step.
    judge(check, published, ours, ROUNDING);
}
