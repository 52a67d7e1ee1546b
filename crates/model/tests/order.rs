//! Measured orders of the integrators, and what the exponential one does where RK4 fails.

mod common;

use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::integrate::{Adaptive, Exponential, RungeKutta4, spectral_radius};
use common::{Differential, Method, SLEIGH, integrate, motor, slope};

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

/// The adaptive pair, forced to fixed steps by a tolerance that accepts everything.
#[test]
fn order_adaptive() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let x0 = SLEIGH.state([0.0, 0.0, 0.3], [0.5, 2.0]);
    let u = vec![0.0; system.sizes().input];
    let (truth, _) = integrate(&system, &x0, &u, 3.2, Method::Adaptive(1e-14));
    let steps = [0.32, 0.16, 0.08, 0.04, 0.02];
    let errors = steps.map(|h| {
        let (mut x, mut mode) = (x0.clone(), vec![1.0; 2]);
        let mut adaptive = Adaptive::new(&system, 1.0, 1.0);
        adaptive.step_max = h;
        adaptive.set_next_step(h);
        let held = appell_model::dynamics::Held(&u);
        for k in 0..(3.2 / h).round() as usize {
            adaptive.set_next_step(h);
            let (t, end) = (k as f64 * h, (k + 1) as f64 * h);
            adaptive
                .advance(&system, &held, t, end, &mut x, &mut mode, None)
                .expect("a smooth problem");
        }
        distance(&x[..3], &truth[..3])
    });
    let order = slope(&steps, &errors);
    // Measured 5.69: steeper than the order, for a reason not yet found. The lower bound is the
    // claim; the upper one only keeps the measurement honest.
    let claim = f64::from(Adaptive::<f64>::ORDER);
    assert!(
        order > claim - 0.05 && order < claim + 1.0,
        "order {order:.3}, errors {errors:?}"
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
