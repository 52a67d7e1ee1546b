//! Integrators: Runge–Kutta 4 at a fixed step, an exponential method for motors, and an adaptive
//! pair that finds events.
//!
//! Each step is: decide the mode, move at constant mode, settle. A jump of the input ends a step;
//! seeing to that is the caller's part. Nothing allocates after construction.

mod adaptive;
mod exponential;
mod runge_kutta;

use crate::dynamics::{Dynamics, Input, Work};
use crate::scalar::Scalar;
use crate::wide::is_at_hand;

pub use adaptive::{Adaptive, Stalled, Watch};
pub use exponential::Exponential;
pub use runge_kutta::RungeKutta4;

/// Numbers that do not straddle cache lines, wherever the stack begins.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Aligned<T, const N: usize>([T; N]);

/// Steps, as a job for the twin of a system whose sizes the compiler knows.
struct Steps<'a, T, M, I> {
    method: &'a mut M,
    input: &'a I,
    t: f64,
    dt: f64,
    count: u64,
    x: &'a mut [T],
    mode: &'a mut [T],
}

/// Steps on a system of N states and a linear part of size Z, or of sizes that only run time knows.
///
/// Each twin is a function of its own: together they would be one that takes minutes to compile.
struct On<'a, S, W, const N: usize, const Z: usize> {
    system: &'a S,
    steps: W,
}

/// A method of fixed steps, made by the widest instructions.
macro_rules! stepped {
    ($method:ident) => {
        impl<T: Scalar> $method<T> {
            /// Advances x and mode from t to t + dt, s.
            #[allow(clippy::too_many_arguments)]
            pub fn step<S: Dynamics<T>, I: Input<T>>(
                &mut self,
                system: &S,
                input: &I,
                t: f64,
                dt: f64,
                x: &mut [T],
                mode: &mut [T],
            ) {
                self.steps(system, input, t, dt, 1, x, mode);
            }

            /// Makes `count` steps of length dt from t: the same bits as one by one.
            #[allow(clippy::too_many_arguments)]
            pub fn steps<S: Dynamics<T>, I: Input<T>>(
                &mut self,
                system: &S,
                input: &I,
                t: f64,
                dt: f64,
                count: u64,
                x: &mut [T],
                mode: &mut [T],
            ) {
                let steps = Steps {
                    method: self,
                    input,
                    t,
                    dt,
                    count,
                    x,
                    mode,
                };
                // Twins are compiled for held inputs only, as control loops give them: they are
                // large, and what varies within a step comes from tests and tools; nor for machines
                // without fused multiply-add, which are rare.
                match input.held() {
                    Some(u) if is_at_hand::<T>() => system.specialised(u, steps),
                    _ => steps.run::<0, 0, S>(system),
                }
            }
        }
    };
}

stepped!(RungeKutta4);
stepped!(Exponential);

fused! {
    /// Outputs of a system, or of its motion alone; the same bits as [`Dynamics::output`] and
    /// [`Dynamics::motion`].
    pub fn observe<T: Scalar, S: Dynamics<T>>(
        system: &S,
        motion_only: bool,
        x: &[T],
        u: &[T],
        mode: &[T],
        y: &mut [T],
    ) {
        if motion_only {
            system.motion(x, u, mode, y);
        } else {
            system.output(x, u, mode, y);
        }
    }
}

#[inline(always)]
fn multiply<T: Scalar>(size: usize, a: &[T], b: &[T], result: &mut [T]) {
    for i in 0..size {
        for j in 0..size {
            let mut sum = T::zero();
            for k in 0..size {
                sum = a[i * size + k].mul_add(b[k * size + j], sum);
            }
            result[i * size + j] = sum;
        }
    }
}

/// Spectral radius of the Jacobian ∂ẋ/∂x at a state, 1/s: what decides whether a step is stable.
pub fn spectral_radius<S: Dynamics<f64>>(system: &S, x: &[f64], u: &[f64], mode: &[f64]) -> f64 {
    let n = x.len();
    let mut jacobian = vec![0.0; n * n];
    let (mut up, mut down) = (vec![0.0; n], vec![0.0; n]);
    let mut moved = x.to_vec();
    for k in 0..n {
        let shift = 1e-6 * (1.0 + x[k].abs());
        moved[k] = x[k] + shift;
        system.derivative(&moved, u, mode, &mut up);
        moved[k] = x[k] - shift;
        system.derivative(&moved, u, mode, &mut down);
        moved[k] = x[k];
        for i in 0..n {
            jacobian[i * n + k] = (up[i] - down[i]) / (2.0 * shift);
        }
    }
    radius(&mut without_integrals(jacobian))
}

/// A matrix without the states on which no rate depends, one after the other: each has the eigenvalue
/// zero, and the others are those of what is left. Most states only sum what a few do.
fn without_integrals(mut matrix: Vec<f64>) -> Vec<f64> {
    loop {
        let n = matrix.len().isqrt();
        let acts = |k: usize| (0..n).any(|i| matrix[i * n + k] != 0.0);
        let kept: Vec<usize> = (0..n).filter(|&k| acts(k)).collect();
        if kept.len() == n {
            return matrix;
        }
        let rows = kept.iter();
        matrix = rows
            .flat_map(|&i| kept.iter().map(move |&k| (i, k)))
            .map(|(i, k)| matrix[i * n + k])
            .collect();
    }
}

fused! {
    /// ρ = lim ‖J^m‖^{1/m}: squared seven times, with the scale taken out each time.
    fn radius(jacobian: &mut Vec<f64>) -> f64 {
        let n = jacobian.len().isqrt();
        let mut log = 0.0;
        let mut weight = 1.0;
        let mut next = vec![0.0; n * n];
        for _ in 0..7 {
            let mut norm = 0.0_f64;
            for k in 0..n * n {
                norm = Scalar::max(norm, jacobian[k].abs());
            }
            if norm == 0.0 {
                return 0.0;
            }
            log += weight * Scalar::ln(norm);
            weight *= 0.5;
            for k in 0..n * n {
                jacobian[k] /= norm;
            }
            multiply(n, jacobian, jacobian, &mut next);
            core::mem::swap(jacobian, &mut next);
        }
        Scalar::exp(log)
    }
}
