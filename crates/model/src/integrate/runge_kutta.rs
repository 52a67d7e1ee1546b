//! The classical Runge–Kutta method at a fixed step.

use super::{Aligned, Steps};
use crate::dynamics::{Dynamics, Input, Work};
use crate::scalar::Scalar;

/// The classical Runge–Kutta method of order 4.
#[derive(Clone, Debug)]
pub struct RungeKutta4<T> {
    slope: Vec<T>,
    sum: Vec<T>,
    stage: Vec<T>,
    input: Vec<T>,
}

impl<T: Scalar> RungeKutta4<T> {
    /// Order of the method.
    pub const ORDER: u32 = 4;
    /// Largest |h λ| on the negative real axis for which the method is stable.
    pub const STABLE: f64 = 2.785;

    /// Makes room for a system of this many states and inputs.
    pub fn new(states: usize, inputs: usize) -> Self {
        RungeKutta4 {
            slope: vec![T::zero(); states],
            sum: vec![T::zero(); states],
            stage: vec![T::zero(); states],
            input: vec![T::zero(); inputs],
        }
    }
}

impl<T: Scalar, I: Input<T>> Work<T> for Steps<'_, T, RungeKutta4<T>, I> {
    type Output = ();

    #[inline(always)]
    fn run<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) {
        let (t, dt) = (self.t, self.dt);
        if N == 0 {
            let n = self.x.len();
            let RungeKutta4 {
                slope,
                sum,
                stage,
                input: u,
            } = self.method;
            let (slope, sum, stage) = (&mut slope[..n], &mut sum[..n], &mut stage[..n]);
            for k in 0..self.count {
                let (t, buffers) = (
                    dt.mul_add(k as f64, t),
                    [&mut *slope, &mut *sum, &mut *stage],
                );
                step(system, self.input, t, dt, u, self.x, self.mode, buffers);
            }
        } else {
            // Arrays of known length need no memory but registers.
            let [mut x, mut slope, mut sum, mut stage] = [Aligned([T::zero(); N]); 4];
            for k in 0..N {
                x.0[k] = self.x[k];
            }
            let u = &mut self.method.input;
            for k in 0..self.count {
                let buffers = [&mut slope.0[..], &mut sum.0[..], &mut stage.0[..]];
                let t = dt.mul_add(k as f64, t);
                step(system, self.input, t, dt, u, &mut x.0, self.mode, buffers);
            }
            for k in 0..N {
                self.x[k] = x.0[k];
            }
        }
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn step<T: Scalar, S: Dynamics<T>, I: Input<T>>(
    system: &S,
    input: &I,
    t: f64,
    dt: f64,
    u: &mut [T],
    x: &mut [T],
    mode: &mut [T],
    [slope, sum, stage]: [&mut [T]; 3],
) {
    const AHEAD: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
    const WEIGHT: [f64; 4] = [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];
    let n = x.len();
    input.at(t, u);
    system.decide(x, u, mode);
    system.derivative(x, u, mode, slope);
    let weight = T::from(WEIGHT[0] * dt);
    for k in 0..n {
        sum[k] = weight * slope[k];
    }
    for i in 1..4 {
        if input.held().is_none() {
            input.at(t + AHEAD[i] * dt, u);
        }
        let ahead = T::from(AHEAD[i] * dt);
        for part in 0..2 {
            let (begin, end) = S::READ[part];
            for k in begin..end.min(n) {
                stage[k] = ahead.mul_add(slope[k], x[k]);
            }
        }
        system.derivative(stage, u, mode, slope);
        let weight = T::from(WEIGHT[i] * dt);
        for k in 0..n {
            sum[k] = weight.mul_add(slope[k], sum[k]);
        }
    }
    for k in 0..n {
        x[k] += sum[k];
    }
    system.settle(x, u, mode);
}
