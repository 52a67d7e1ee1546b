//! The classical Runge–Kutta method at a fixed step.

use super::{Aligned, On, Steps};
use crate::dynamics::{CORE_INPUT, Core, Dynamics, Input, Nodes, Work};
use crate::scalar::{Mask, Scalar};
use crate::wide::{Job, widest};

/// The classical Runge–Kutta method of order 4.
#[derive(Clone, Debug)]
pub struct RungeKutta4<T> {
    slope: Vec<T>,
    sum: Vec<T>,
    stage: Vec<T>,
    start: Vec<T>,
    middle: Vec<T>,
    inner: Vec<T>,
    last: Vec<T>,
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
            start: vec![T::zero(); states],
            middle: vec![T::zero(); states],
            inner: vec![T::zero(); states],
            last: vec![T::zero(); states],
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
        // No method of `Option`: what is known of it must stay so.
        let core = (system.core(), self.input.held());
        let mut held = Aligned([T::zero(); CORE_INPUT]);
        if let (Some(_), Some(u)) = core {
            system.core_input(u, &mut held.0);
        }
        if N == 0 {
            let n = self.x.len();
            let RungeKutta4 {
                slope,
                sum,
                stage,
                start,
                middle,
                inner,
                last,
                input: u,
                stages,
            } = self.method;
            let stages = if T::LANES > 1 { *stages } else { 4 };
            let (slope, sum, stage) = (&mut slope[..n], &mut sum[..n], &mut stage[..n]);
            let (start, middle) = (&mut start[..n], &mut middle[..n]);
            let (inner, last) = (&mut inner[..n], &mut last[..n]);
            for k in 0..self.count {
                let t = dt.mul_add(k as f64, t);
                if let (Some(core), Some(_)) = core {
                    let buffers = [
                        &mut *slope,
                        &mut *sum,
                        &mut *stage,
                        start,
                        middle,
                        inner,
                        last,
                    ];
                    step_core(system, core, &held.0, dt, self.x, buffers);
                } else {
                    let buffers = [&mut *slope, &mut *sum, &mut *stage];
                    step(
                        system, self.input, t, dt, stages, u, self.x, self.mode, buffers,
                    );
                }
            }
        } else {
            // Arrays of known length need no memory but registers.
            let [mut x, mut slope, mut sum, mut stage] = [Aligned([T::zero(); N]); 4];
            let [mut start, mut middle] = [Aligned([T::zero(); N]); 2];
            let [mut inner, mut last] = [Aligned([T::zero(); N]); 2];
            for k in 0..N {
                x.0[k] = self.x[k];
            }
            let stages = if T::LANES > 1 { self.method.stages } else { 4 };
            let u = &mut self.method.input;
            for k in 0..self.count {
                let t = dt.mul_add(k as f64, t);
                if let (Some(core), Some(_)) = core {
                    let buffers = [
                        &mut slope.0[..],
                        &mut sum.0[..],
                        &mut stage.0[..],
                        &mut start.0[..],
                        &mut middle.0[..],
                        &mut inner.0[..],
                        &mut last.0[..],
                    ];
                    step_core(system, core, &held.0, dt, &mut x.0, buffers);
                } else {
                    let buffers = [&mut slope.0[..], &mut sum.0[..], &mut stage.0[..]];
                    step(
                        system, self.input, t, dt, stages, u, &mut x.0, self.mode, buffers,
                    );
                }
            }
            for k in 0..N {
                self.x[k] = x.0[k];
            }
        }
    }
}

/// A step of a system whose other states are gathered from its core: by Simpson's rule, with the mean
/// of the two inner stages in the middle, which is of the order of the method.
///
/// Additions are free beside multiplications, which processors have fewer units for.
#[inline(always)]
fn step_core<T: Scalar, S: Dynamics<T>>(
    system: &S,
    core: Core,
    held: &[T],
    dt: f64,
    x: &mut [T],
    [slope, outer, stage, start, middle, inner, last]: [&mut [T]; 7],
) {
    let (from, to) = core.summed;
    let (half, whole) = (T::from(0.5 * dt), T::from(dt));
    let sixth = T::from(dt * (1.0 / 6.0));
    system.core_enter(core, x, start);
    for i in core.read() {
        let at = core.angle(i);
        start[at + 1] = x[at + 1];
        start[at + 2] = x[at + 2];
    }
    let mut limited = system.core_rates(start, held, outer);
    for k in from..to {
        stage[k] = half.mul_add(outer[k], start[k]);
    }
    for i in core.read() {
        let at = core.angle(i);
        let turned = half * outer[at];
        stage[at + 1] = (-turned).mul_add(x[at + 2], x[at + 1]);
        stage[at + 2] = turned.mul_add(x[at + 1], x[at + 2]);
    }
    limited = limited.or(system.core_rates(stage, held, inner));
    for k in from..to {
        middle[k] = half.mul_add(inner[k], start[k]);
    }
    for i in core.read() {
        let at = core.angle(i);
        let turned = half * inner[at];
        middle[at + 1] = (-turned).mul_add(stage[at + 2], x[at + 1]);
        middle[at + 2] = turned.mul_add(stage[at + 1], x[at + 2]);
    }
    limited = limited.or(system.core_rates(middle, held, slope));
    for k in from..to {
        last[k] = whole.mul_add(slope[k], start[k]);
    }
    for i in core.read() {
        let at = core.angle(i);
        let turned = whole * slope[at];
        last[at + 1] = (-turned).mul_add(middle[at + 2], x[at + 1]);
        last[at + 2] = turned.mul_add(middle[at + 1], x[at + 2]);
    }
    // The two in the middle, together.
    for k in from..to {
        middle[k] += stage[k];
        inner[k] += slope[k];
    }
    for i in core.read() {
        let at = core.angle(i);
        middle[at + 1] += stage[at + 1];
        middle[at + 2] += stage[at + 2];
    }
    for k in core.spins.0..core.spins.1 {
        inner[k] += slope[k];
    }
    limited = limited.or(system.core_rates(last, held, slope));
    let nodes = Nodes {
        states: [&*start, &*middle, &*last],
        rates: [&*outer, &*inner, &*slope],
        is_simpson: true,
        share: T::from(2.0),
        weight: sixth,
    };
    system.gather(&nodes, held, limited, x);
    for k in from..to {
        let sum = (outer[k] + slope[k]) + (inner[k] + inner[k]);
        stage[k] = sixth.mul_add(sum, start[k]);
    }
    system.core_leave(core, stage, x);
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
