//! Measured orders of the integrators, and what the exponential one does where RK4 fails.

use crate::common::{Differential, Method, SLEIGH, integrate, motor, slope};
use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::integrate::{Adaptive, Exponential, RungeKutta4, spectral_radius};

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

/// Five halvings on the sleigh: the slope must be that of the method within 0.05.
#[test]
fn order_rk4() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let x0 = SLEIGH.state([0.0, 0.0, 0.3], [0.5, 2.0]);
    let u = vec![0.0; system.sizes().input];
    let (truth, _) = integrate(&system, &x0, &u, 3.2, Method::Adaptive(1e-14));
    let steps = [0.04, 0.02, 0.01, 0.005, 0.0025];
    let errors = steps.map(|h| {
        distance(
            &integrate(&system, &x0, &u, 3.2, Method::Rk4(h)).0[..3],
            &truth[..3],
        )
    });
    let order = slope(&steps, &errors);
    assert!(
        (order - f64::from(RungeKutta4::<f64>::ORDER)).abs() < 0.05,
        "order {order:.3}, errors {errors:?}"
    );
}

/// With motors the stages are made for velocities and currents alone; the rest, gathered from them, is
/// of the same order. The truth is by the rates of all states.
#[test]
fn order_rk4_of_what_is_gathered() {
    let robot = Differential {
        drive: motor(2e-2),
        viscous: 2e-2,
        ..SLEIGH
    };
    let system = robot.rolling(Ground::flat(9.81));
    let mut u = vec![0.0; system.sizes().input];
    (u[0], u[1]) = (6.0, 9.0);
    let x0 = robot.state([0.0, 0.0, 0.3], [0.3, 0.5]);
    let (truth, _) = integrate(&system, &x0, &u, 0.64, Method::Adaptive(1e-14));
    let steps = [0.008, 0.004, 0.002, 0.001];
    let runs = steps.map(|h| integrate(&system, &x0, &u, 0.64, Method::Rk4(h)).0);
    let at = system.platform().layout().ledger();
    for (name, states) in [
        ("pose", 0..3),
        ("ledger", at..at + 4),
        ("spins", at + 4..at + 6),
    ] {
        let errors =
            [0, 1, 2, 3].map(|k| distance(&runs[k][states.clone()], &truth[states.clone()]));
        let order = slope(&steps, &errors);
        // Steps of two fifths to a twentieth of L/R: not quite small yet.
        assert!(
            (order - f64::from(RungeKutta4::<f64>::ORDER)).abs() < 0.1,
            "{name}: order {order:.3}, errors {errors:?}"
        );
    }
}

/// The exponential method on a motor-driven turn, with the motor fully resolved by neither.
#[test]
fn order_exponential() {
    let robot = Differential {
        drive: motor(1e-4),
        ..SLEIGH
    };
    let system = robot.rolling(Ground::plane(9.81, 0.1, 0.4));
    let layout = system.platform().layout().clone();
    let mut u = vec![0.0; layout.input()];
    (u[0], u[1]) = (6.0, 9.0);
    let x0 = robot.state([0.0, 0.0, 0.3], [0.3, 0.5]);
    let (truth, _) = integrate(&system, &x0, &u, 0.64, Method::Adaptive(1e-13));
    let steps = [0.02, 0.01, 0.005, 0.0025, 0.00125];
    let at = layout.velocity();
    let errors = steps.map(|h| {
        let (x, _) = integrate(&system, &x0, &u, 0.64, Method::Exponential(h));
        distance(&x[at..at + 2], &truth[at..at + 2])
    });
    let order = slope(&steps, &errors);
    assert!(
        (order - f64::from(Exponential::<f64>::ORDER)).abs() < 0.05,
        "order {order:.3}, errors {errors:?}"
    );
}

/// Errors of the adaptive pair at fixed steps, by a tolerance that accepts everything.
fn adaptive_errors<const N: usize>(
    robot: &Differential,
    twist: [f64; 2],
    end: f64,
    steps: [f64; N],
    truth: &[f64],
) -> [f64; N] {
    let system = robot.rolling(Ground::flat(9.81));
    let x0 = robot.state([0.0, 0.0, 0.3], twist);
    let u = vec![0.0; system.sizes().input];
    let held = appell_model::dynamics::Held(&u);
    steps.map(|h| {
        let (mut x, mut mode) = (x0.clone(), vec![1.0; 2]);
        let mut adaptive = Adaptive::new(&system, 1.0, 1.0);
        adaptive.step_max = h;
        for k in 0..(end / h).round() as usize {
            adaptive.set_next_step(h);
            let (from, to) = (k as f64 * h, (k + 1) as f64 * h);
            adaptive
                .advance(&system, &held, from, to, &mut x, &mut mode, None)
                .expect("a smooth problem");
        }
        distance(&x[..truth.len()], truth)
    })
}

/// On a circle, whose positions are known, the slope is that of the method within 0.05.
#[test]
fn order_adaptive() {
    let robot = Differential {
        ahead: 0.0,
        ..SLEIGH
    };
    let (speed, yaw_rate, yaw, end) = (2.0, 2.0, 0.3, 1.6);
    let radius = speed / yaw_rate;
    let turned = |angle: f64| appell_model::scalar::Scalar::sin_cos(angle);
    let ((s0, c0), (s1, c1)) = (turned(yaw), turned(yaw + yaw_rate * end));
    let truth = [radius * (s1 - s0), radius * (c0 - c1)];
    let steps = [0.1, 0.05, 0.025, 0.0125, 0.00625];
    let errors = adaptive_errors(&robot, [speed, yaw_rate], end, steps, &truth);
    let order = slope(&steps, &errors);
    assert!(
        (order - f64::from(Adaptive::<f64>::ORDER)).abs() < 0.05,
        "order {order:.3}, errors {errors:?}"
    );
}

/// On the sleigh the pair looks steeper than it is: its terms of order 6 outweigh the small ones of
/// order 5 at every step whose error is above rounding. The slope falls towards 5 with the step.
#[test]
fn order_adaptive_on_the_sleigh_falls_to_five() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let x0 = SLEIGH.state([0.0, 0.0, 0.3], [0.5, 2.0]);
    let u = vec![0.0; system.sizes().input];
    let (truth, _) = integrate(&system, &x0, &u, 0.8, Method::Adaptive(1e-14));
    let steps = [0.08, 0.04, 0.02, 0.01];
    let errors = adaptive_errors(&SLEIGH, [0.5, 2.0], 0.8, steps, &truth[..2]);
    let slopes: Vec<f64> = (0..3)
        .map(|k| slope(&steps[k..k + 2], &errors[k..k + 2]))
        .collect();
    let falls = slopes.windows(2).all(|s| s[1] < s[0]);
    assert!(
        falls && slopes.iter().all(|&s| s > 4.95),
        "slopes {slopes:?}, errors {errors:?}"
    );
}

/// Dense output is of order 4: halving the step cuts its error about thirty-two-fold locally.
#[test]
fn order_dense_output() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let x0 = SLEIGH.state([0.0, 0.0, 0.3], [0.5, 2.0]);
    let u = vec![0.0; system.sizes().input];
    let held = appell_model::dynamics::Held(&u);
    let steps = [0.16, 0.08, 0.04, 0.02];
    let errors = steps.map(|h| {
        let (mut x, mut mode) = (x0.clone(), vec![1.0; 2]);
        let mut adaptive = Adaptive::new(&system, 1.0, 1.0);
        adaptive.set_next_step(h);
        adaptive
            .advance(&system, &held, 0.0, h, &mut x, &mut mode, None)
            .expect("a smooth problem");
        let mut middle = vec![0.0; x0.len()];
        adaptive.interpolate(0.4, &mut middle);
        let (truth, _) = integrate(&system, &x0, &u, 0.4 * h, Method::Adaptive(1e-14));
        distance(&middle[..3], &truth[..3])
    });
    let order = slope(&steps, &errors);
    assert!(
        (order - 5.0).abs() < 0.3,
        "local order {order:.3}, errors {errors:?}"
    );
}

/// L/R from 1 ms to 10 µs at steps of 1 ms, where RK4 is long unstable: within 5e-7 m over 10 s from
/// a jump of the voltage (an error ∝ h²; measured 2.9e-7 m).
#[test]
fn invariant_exponential_is_stable_for_any_motor() {
    for time_constant in [1e-3, 1e-4, 1e-5] {
        let robot = Differential {
            drive: motor(time_constant),
            ..SLEIGH
        };
        let system = robot.rolling(Ground::flat(9.81));
        let layout = system.platform().layout().clone();
        let mut u = vec![0.0; layout.input()];
        (u[0], u[1]) = (8.0, 9.0);
        let x0 = robot.state([0.0; 3], [0.0, 0.0]);
        let (truth, _) = integrate(&system, &x0, &u, 10.0, Method::Adaptive(1e-11));
        let (x, _) = integrate(&system, &x0, &u, 10.0, Method::Exponential(1e-3));
        let error = distance(&x[..2], &truth[..2]);
        assert!(error < 5e-7, "L/R {time_constant}: {error:e} m");
        let radius = spectral_radius(&system, &x0, &u, &[1.0, 1.0]);
        let rate = 1.0 / time_constant;
        assert!(
            (radius / rate - 1.0).abs() < 0.1,
            "fastest rate {radius}, expected about {rate}"
        );
    }
}
