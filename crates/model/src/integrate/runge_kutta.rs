//! The classical Runge–Kutta method at a fixed step.

use super::{Aligned, On, Steps};
use crate::dynamics::{Dynamics, Input, Work};
use crate::scalar::Scalar;
use crate::wide::{Job, widest};

/// The classical Runge–Kutta method of order 4.
#[derive(Clone, Debug)]
pub struct RungeKutta4<T> {
    slope: Vec<T>,
    sum: Vec<T>,
    stage: Vec<T>,
    input: Vec<T>,
    /// Four. A number that the compiler does not know leaves the loop over the stages of many lanes
    /// a loop: unrolled, it takes minutes to compile and is no faster.
    stages: usize,
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
            stages: 4,
        }
    }
}

impl<T: Scalar, I: Input<T>> Work<T> for Steps<'_, T, RungeKutta4<T>, I> {
    type Output = ();

    #[inline(never)]
    fn run<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) {
        let steps = self;
        widest::<T, _>(On::<_, _, N, Z> { system, steps });
    }
}

impl<T: Scalar, S: Dynamics<T>, I: Input<T>, const N: usize, const Z: usize> Job
    for On<'_, S, Steps<'_, T, RungeKutta4<T>, I>, N, Z>
{
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.steps.make::<N, Z, S>(self.system);
    }

    #[inline(always)]
    fn plain(self) {
        // Elsewhere twins are not asked for without fused multiply-add.
        if N == 0 || cfg!(not(target_arch = "x86_64")) {
            self.steps.make::<N, Z, S>(self.system);
        }
    }
}

impl<T: Scalar, I: Input<T>> Steps<'_, T, RungeKutta4<T>, I> {
    #[inline(always)]
    fn make<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) {
        let (t, dt) = (self.t, self.dt);
        if N == 0 {
            let n = self.x.len();
            let RungeKutta4 {
                slope,
                sum,
                stage,
                input: u,
                stages,
            } = self.method;
            let stages = if T::LANES > 1 { *stages } else { 4 };
            let (slope, sum, stage) = (&mut slope[..n], &mut sum[..n], &mut stage[..n]);
            for k in 0..self.count {
                let (t, buffers) = (
                    dt.mul_add(k as f64, t),
                    [&mut *slope, &mut *sum, &mut *stage],
                );
                step(
                    system, self.input, t, dt, stages, u, self.x, self.mode, buffers,
                );
            }
        } else {
            // Arrays of known length need no memory but registers.
            let [mut x, mut slope, mut sum, mut stage] = [Aligned([T::zero(); N]); 4];
            for k in 0..N {
                x.0[k] = self.x[k];
            }
            let stages = if T::LANES > 1 { self.method.stages } else { 4 };
            let u = &mut self.method.input;
            for k in 0..self.count {
                let buffers = [&mut slope.0[..], &mut sum.0[..], &mut stage.0[..]];
                let t = dt.mul_add(k as f64, t);
                step(
                    system, self.input, t, dt, stages, u, &mut x.0, self.mode, buffers,
                );
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
    stages: usize,
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
    for i in 0..stages {
        if i == 0 && T::LANES == 1 {
            system.derivative(x, u, mode, slope);
        } else {
            if input.held().is_none() && i > 0 {
                input.at(t + AHEAD[i] * dt, u);
            }
            let ahead = T::from(AHEAD[i] * dt);
            for part in 0..2 {
                let (begin, end) = S::READ[part];
                for k in begin..end.min(n) {
                    stage[k] = if i == 0 {
                        x[k]
                    } else {
                        ahead.mul_add(slope[k], x[k])
                    };
                }
            }
            system.derivative(stage, u, mode, slope);
        }
        let weight = T::from(WEIGHT[i] * dt);
        for k in 0..n {
            sum[k] = if i == 0 {
                weight * slope[k]
            } else {
                weight.mul_add(slope[k], sum[k])
            };
        }
    }
    for k in 0..n {
        x[k] += sum[k];
    }
    system.settle(x, u, mode);
}
