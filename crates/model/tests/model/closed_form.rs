//! Exact solutions: the torque-free sleigh, constant torque, coasting, the circle, the Euler spiral.
#![allow(clippy::disallowed_methods)] // The truth is computed by other means than the model.
#![allow(clippy::excessive_precision)] // Golden numbers have more digits than a double.

use crate::common::{Differential, Method, SLEIGH, integrate};
use appell_model::dynamics::{Dynamics, Input};
use appell_model::ground::Ground;
use appell_model::integrate::Adaptive;
use appell_model::kinematic::Kinematic;
use appell_model::platform::{WheelOutput, YAW};

/// Exact speed, yaw rate and heading of the torque-free robot with its centre of mass off the axle.
fn sleigh(robot: &Differential, v0: f64, w0: f64, heading0: f64, t: f64) -> [f64; 3] {
    let wheels = 2.0 * robot.spin_inertia / robot.radius.powi(2);
    let m = robot.mass + wheels;
    let j =
        robot.inertia_com + robot.mass * robot.ahead.powi(2) + wheels * robot.half_track.powi(2);
    let md = robot.mass * robot.ahead;
    let energy = 0.5 * (m * v0 * v0 + j * w0 * w0);
    let (v_end, w_top) = ((2.0 * energy / m).sqrt(), (2.0 * energy / j).sqrt());
    let k = md * v_end / j;
    let q = (m * j).sqrt() / md.abs();
    let c = (v0 / v_end).atanh();
    let s = k * t + c;
    let gd = |s: f64| 2.0 * (0.5 * s).tanh().atan();
    [
        v_end * s.tanh(),
        w0.signum() * w_top / s.cosh(),
        heading0 + w0.signum() * md.signum() * q * (gd(s) - gd(c)),
    ]
}

fn sleigh_error(robot: &Differential, method: Method, end: f64) -> f64 {
    let system = robot.rolling(Ground::flat(9.81));
    let x0 = robot.state([0.0, 0.0, 0.3], [0.5, 2.0]);
    let u = vec![0.0; system.sizes().input];
    let (x, _) = integrate(&system, &x0, &u, end, method);
    let exact = sleigh(robot, 0.5, 2.0, 0.3, end);
    let at = system.platform().layout().velocity();
    (x[at] - exact[0])
        .abs()
        .max((x[at + 1] - exact[1]).abs())
        .max((x[YAW] - exact[2]).abs())
}

/// RK4 at 1 ms: the error constant of the method at the rates of this robot is below 1e-11 over
/// 20 s, the target of the validation chapter; ahead, behind, and a second geometry.
#[test]
fn closed_form_sleigh_rk4() {
    let behind = Differential {
        ahead: -0.05,
        ..SLEIGH
    };
    let light = Differential {
        spin_inertia: 0.0,
        ..SLEIGH
    };
    for robot in [SLEIGH, behind, light] {
        for end in [1.0, 5.0, 20.0] {
            let error = sleigh_error(&robot, Method::Rk4(1e-3), end);
            assert!(
                error <= 1e-11,
                "ahead {} at {end} s: {error:e}",
                robot.ahead
            );
        }
    }
}

/// Adaptive at a tolerance of 1e-14 per step: 1e-12 over 20 s is the target.
#[test]
fn closed_form_sleigh_adaptive() {
    for end in [1.0, 5.0, 20.0] {
        let error = sleigh_error(&SLEIGH, Method::Adaptive(1e-14), end);
        assert!(error <= 1e-12, "at {end} s: {error:e}");
    }
}

/// The same robot's position at 20 s, from an integration to 30 digits: six to nine digits printed.
#[test]
fn peer_sleigh_position() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let x0 = SLEIGH.state([0.0, 0.0, 0.3], [0.5, 2.0]);
    let u = vec![0.0; system.sizes().input];
    let (x, _) = integrate(&system, &x0, &u, 20.0, Method::Rk4(1e-3));
    // Half a unit of the last printed digit.
    assert!((x[0] - -3.648_198_140).abs() < 6e-10, "x {}", x[0]);
    assert!((x[1] - 10.662_638_514).abs() < 6e-10, "y {}", x[1]);
}

/// Golden numbers of a sleigh with q = 2 (M = 10, J = 0.4, md = 1), a Taylor integration to 30
/// digits; doubles leave 1e-12.
#[test]
fn peer_sleigh_golden() {
    let robot = Differential {
        mass: 10.0,
        ahead: 0.1,
        inertia_com: 0.3,
        spin_inertia: 0.0,
        ..SLEIGH
    };
    let system = robot.rolling(Ground::flat(9.81));
    let at = system.platform().layout().velocity();
    let golden = [
        (
            1.0,
            [
                0.633931199917409224,
                0.450866769990696356,
                1.36688826403176526,
                0.316445399857612551,
                0.474068396754513314,
            ],
        ),
        (
            2.0,
            [
                0.640051469618582434,
                0.091394233829718101,
                1.59238060193332518,
                0.356039730348010519,
                1.10993698781870977,
            ],
        ),
        (
            5.0,
            [
                0.640312406148239923,
                0.000750543993395278,
                1.64901302332716499,
                0.227654353546893887,
                3.02630460419448315,
            ],
        ),
    ];
    let u = vec![0.0; system.sizes().input];
    for (t, row) in golden {
        let x0 = robot.state([0.0, 0.0, 0.3], [0.5, 2.0]);
        let (x, _) = integrate(&system, &x0, &u, t, Method::Adaptive(1e-14));
        let got = [x[at], x[at + 1], x[YAW], x[0], x[1]];
        for (value, golden) in got.iter().zip(row) {
            assert!((value - golden).abs() <= 1e-12, "at {t} s: {got:?}");
        }
    }
}

/// The contact forces of the sleigh: F = m v ω (1 − m d²/J) across, −(Iw/r²)(v̇ ± b ω̇) along.
#[test]
fn closed_form_sleigh_forces() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let layout = system.platform().layout().clone();
    let (v, w) = (0.4, 1.1);
    let x = SLEIGH.state([1.0, 2.0, 0.7], [v, w]);
    let u = vec![0.0; layout.input()];
    let mode = vec![1.0; layout.wheels];
    let mut y = vec![0.0; layout.output()];
    system.output(&x, &u, &mode, &mut y);
    let wheels = 2.0 * SLEIGH.spin_inertia / SLEIGH.radius.powi(2);
    let m = SLEIGH.mass + wheels;
    let j = SLEIGH.inertia_com
        + SLEIGH.mass * SLEIGH.ahead.powi(2)
        + wheels * SLEIGH.half_track.powi(2);
    let md = SLEIGH.mass * SLEIGH.ahead;
    let (v_dot, w_dot) = (md * w * w / m, -md * v * w / j);
    let side = SLEIGH.mass * v * w + md * w_dot;
    let get = |i, what| y[layout.wheel_output(i, what)];
    let sides = get(0, WheelOutput::Lateral) + get(1, WheelOutput::Lateral);
    // A few roundings of forces of some newtons.
    assert!((sides - side).abs() < 1e-13, "{sides} {side}");
    for (i, sign) in [(0, -1.0), (1, 1.0)] {
        let along = -SLEIGH.spin_inertia / SLEIGH.radius.powi(2)
            * (v_dot + sign * SLEIGH.half_track * w_dot);
        assert!((get(i, WheelOutput::Longitudinal) - along).abs() < 1e-14);
    }
}

/// A robot of VALIDATION C1–C2: M = 9.84 kg, all losses at the axles of two wheels.
fn coaster(viscous: f64, resistance: f64) -> Differential {
    Differential {
        mass: 9.84,
        ahead: 0.0,
        spin_inertia: 0.0,
        viscous: 0.5 * viscous * SLEIGH.radius.powi(2),
        dry: 0.5 * resistance * SLEIGH.radius,
        ..SLEIGH
    }
}

/// Constant torque against rolling resistance and viscous loss: v = (F/c)(1 − e^{−ct/M}).
#[test]
fn closed_form_constant_torque() {
    let robot = coaster(1.7, 0.3);
    let system = robot.rolling(Ground::flat(9.81));
    let layout = system.platform().layout().clone();
    let mut u = vec![0.0; layout.input()];
    (u[0], u[1]) = (0.1, 0.1);
    let x0 = robot.state([0.0; 3], [0.0, 0.0]);
    let (x, _) = integrate(&system, &x0, &u, 7.0, Method::Rk4(1e-3));
    // RK4 at 1 ms on rates of 0.17/s is exact to rounding.
    assert!(
        (x[layout.velocity()] - 0.7227733749424103).abs() < 1e-13,
        "{}",
        x[layout.velocity()]
    );
    assert!((x[0] - 3.0275790291417906).abs() < 1e-12, "{}", x[0]);
}

/// Coasting down: stops at t = (M/c) ln(1 + c v₀/F), stays, and does not chatter. The adaptive
/// method finds the instant; RK4 at 1 ms stops within its step.
#[test]
fn closed_form_coast_down() {
    let robot = coaster(1.7, 0.3);
    let system = robot.rolling(Ground::flat(9.81));
    let at = system.platform().layout().velocity();
    let u = vec![0.0; system.sizes().input];
    let x0 = robot.state([0.0; 3], [1.0, 0.0]);
    let (stop, way) = (10.980976853692395, 3.8504158493484);
    for method in [Method::Adaptive(1e-13), Method::Rk4(1e-3)] {
        let (x, mode) = integrate(&system, &x0, &u, 12.0, method);
        assert_eq!(&x[at..at + 2], &[0.0, 0.0], "it stands");
        assert_eq!(mode, vec![0.0, 0.0], "both wheels stick");
        // The fixed step misses the last part of a step: F/2M · h² ≈ 1.5e-8 m.
        let tolerance = match method {
            Method::Adaptive(_) => 1e-12,
            _ => 2e-8,
        };
        assert!((x[0] - way).abs() < tolerance, "{method:?}: {}", x[0] - way);
        let (later, _) = integrate(&system, &x, &u, 5.0, Method::Rk4(1e-3));
        assert_eq!(x[..5], later[..5], "it stays to the last bit");
    }
    // The instant itself: the state moves before it and not after.
    let mut x = x0.clone();
    let mut mode = vec![1.0; 2];
    let mut adaptive = Adaptive::new(&system, 1e-13, 1e-14);
    let held = appell_model::dynamics::Held(&u);
    let watch = |x: &[f64]| x[at] - 1e-9;
    let reached = adaptive
        .advance(&system, &held, 0.0, 12.0, &mut x, &mut mode, Some(&watch))
        .expect("a smooth problem");
    // 1 nm/s is reached 1e-9 · M/F before the stop.
    let before = 1e-9 * 9.84 / 0.3;
    assert!((reached + before - stop).abs() < 1e-11, "{reached}");
}

/// Steady circle with the centre of mass off the axle: the torques that keep it, and its closure.
#[test]
fn closed_form_steady_circle() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let layout = system.platform().layout().clone();
    let mut u = vec![0.0; layout.input()];
    (u[0], u[1]) = (-0.056456918429003036, 0.02837691842900303);
    let x0 = SLEIGH.state([0.0; 3], [0.4, 0.8]);
    let turn = std::f64::consts::TAU / 0.8;
    let (x, _) = integrate(&system, &x0, &u, turn, Method::Adaptive(1e-13));
    // The circle is a fixed point of the reduced equations; one of its eigenvalues is −0.19/s, so
    // integration errors of 1e-13 stay of that size.
    assert!(
        x[0].abs() < 1e-12 && x[1].abs() < 1e-12,
        "{} {}",
        x[0],
        x[1]
    );
}

/// A linear ramp of yaw rate at constant speed, commanded to the kinematic level: a clothoid.
struct Spiral {
    speed: f64,
    ramp: f64,
}

impl Input<f64> for Spiral {
    fn at(&self, t: f64, u: &mut [f64]) {
        let half = SLEIGH.half_track;
        u[0] = (self.speed - half * self.ramp * t) / SLEIGH.radius;
        u[1] = (self.speed + half * self.ramp * t) / SLEIGH.radius;
    }
}

#[test]
fn closed_form_euler_spiral() {
    let robot = Differential {
        drive: appell_model::drive::Drive::Rate {
            rate_max: f64::INFINITY,
        },
        ..SLEIGH
    };
    let system = Kinematic::new(robot.platform()).expect("two driven wheels");
    let spiral = Spiral {
        speed: 0.7,
        ramp: 0.9,
    };
    let sizes = system.sizes();
    let mut x = robot.state([0.0; 3], [0.0, 0.0]);
    let mut mode = vec![1.0; sizes.mode];
    let mut adaptive = Adaptive::new(&system, 1e-14, 1e-15);
    let end = 3.0;
    adaptive
        .advance(&system, &spiral, 0.0, end, &mut x, &mut mode, None)
        .expect("a smooth problem");
    // Fresnel integrals by Gauss–Legendre quadrature of 3 points on 2000 intervals: 1e-15.
    let (mut cx, mut sx) = (0.0, 0.0);
    let n = 2000;
    let nodes = [
        (-0.6_f64.sqrt(), 5.0 / 9.0),
        (0.0, 8.0 / 9.0),
        (0.6_f64.sqrt(), 5.0 / 9.0),
    ];
    for k in 0..n {
        for (node, weight) in nodes {
            let t = end * (k as f64 + 0.5 + 0.5 * node) / n as f64;
            let angle = 0.5 * spiral.ramp * t * t;
            cx += weight * angle.cos();
            sx += weight * angle.sin();
        }
    }
    let scale = spiral.speed * 0.5 * end / n as f64;
    assert!((x[0] - scale * cx).abs() < 1e-12, "{}", x[0] - scale * cx);
    assert!((x[1] - scale * sx).abs() < 1e-12, "{}", x[1] - scale * sx);
    assert!((x[YAW] - 0.5 * spiral.ramp * end * end).abs() < 1e-13);
}

/// An hour on a slope of 10° with brakes on: the pose is the same to the last bit, at every method.
#[test]
fn invariant_parked_on_a_slope() {
    let robot = Differential {
        brake: 2.0,
        ..SLEIGH
    };
    let ground = Ground::plane(9.81, 10.0_f64.to_radians(), 0.7);
    let system = robot.rolling(ground);
    let layout = system.platform().layout().clone();
    let mut u = vec![0.0; layout.input()];
    u[layout.brake_input()] = 1.0;
    let x0 = robot.state([0.25, 0.75, 0.1], [0.0, 0.0]);
    for (method, end) in [
        (Method::Rk4(1e-3), 3600.0),
        (Method::Adaptive(1e-9), 3600.0),
        (Method::Exponential(1e-3), 60.0),
    ] {
        let (x, _) = integrate(&system, &x0, &u, end, method);
        assert_eq!(x[..5], x0[..5], "{method:?}");
    }
    // With half the brake torque that gravity asks for, it slides.
    u[layout.brake_input()] = 0.1;
    let (x, _) = integrate(&system, &x0, &u, 1.0, Method::Rk4(1e-3));
    assert!((x[0] - x0[0]).abs() > 0.1);
}
