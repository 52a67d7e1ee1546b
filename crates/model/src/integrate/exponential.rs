//! An exponential method for motors: stable for any winding.

use super::{Aligned, On, Steps, multiply};
use crate::dynamics::{CORE_INPUT, Core, Dynamics, Input, Nodes, Work};
use crate::lanewise;
use crate::lanewise::Lanewise;
use crate::scalar::{Mask, Scalar};
use crate::wide::{Job, widest};

/// An exponential midpoint method of order 2 (ETD2): the linear part of the stiff states is exact,
/// the rest is taken at the middle of the step; states that only follow are summed by Gauss's rule
/// with three nodes. `[eq:etd]`
#[derive(Clone, Debug)]
pub struct Exponential<T: Scalar> {
    size: usize,
    /// The states of the linear part.
    range: core::ops::Range<usize>,
    step: f64,
    /// Which modes the matrices were made for.
    signature: Vec<T>,
    linear: Vec<T>,
    /// To the first, middle and last node of the quadrature, and to the end of the step.
    propagators: [Propagator<T>; 4],
    slopes: [Vec<T>; 4],
    stage: Vec<T>,
    others: [Vec<T>; 2],
    start: Vec<T>,
    rest: Vec<T>,
    input: Vec<T>,
    scratch: [Vec<T>; 3],
    /// Two, unknown to the compiler.
    sides: usize,
}

/// e^{Ah} and ∫₀ʰ e^{As} ds, row-major.
#[derive(Clone, Debug)]
struct Propagator<T> {
    exponential: Vec<T>,
    integral: Vec<T>,
    /// Where the core is paired, the integral for forward speed and the sum of the currents, and for yaw
    /// rate and their difference.
    pairs: Vec<T>,
}

impl<T: Scalar> Lanewise for Exponential<T> {
    type One = Exponential<f64>;

    fn fits(&self, one: &Exponential<f64>) -> bool {
        self.range == one.range && self.step == one.step
    }

    fn put(&mut self, lane: usize, one: &Exponential<f64>) {
        self.signature.put(lane, &one.signature);
        self.linear.put(lane, &one.linear);
        self.propagators.put(lane, &one.propagators);
    }
}

lanewise!(Propagator {} state { exponential, integral, pairs });

/// Shares of the step at Gauss's three nodes, (1 ± √(3/5))/2 and ½, and at its end.
const SHARES: [f64; 4] = [0.112_701_665_379_258_3, 0.5, 0.887_298_334_620_741_7, 1.0];
const MIDDLE: usize = 1;
const END: usize = 3;
/// Most halvings of the step that the matrix exponential is begun with.
const DOUBLINGS_MAX: usize = 60;

impl<T: Scalar> Exponential<T> {
    /// Order of the method.
    pub const ORDER: u32 = 2;

    /// Prepares steps of `step` seconds; `None` if the system has no constant linear part.
    pub fn new<S: Dynamics<T>>(system: &S, step: f64) -> Option<Self> {
        let sizes = system.sizes();
        let mut linear = vec![T::zero(); sizes.state * sizes.state];
        let free = vec![T::one(); sizes.mode];
        let range = system.linear_part(&free, &mut linear)?;
        let size = range.len();
        let square = || vec![T::zero(); size * size];
        let propagator = || Propagator {
            exponential: square(),
            integral: square(),
            pairs: vec![T::zero(); if system.is_paired() { 8 } else { 0 }],
        };
        let states = || vec![T::zero(); sizes.state];
        let mut method = Exponential {
            size,
            range,
            step,
            signature: vec![T::one(); sizes.mode],
            linear,
            propagators: core::array::from_fn(|_| propagator()),
            slopes: core::array::from_fn(|_| states()),
            stage: states(),
            others: [states(), states()],
            start: states(),
            rest: vec![T::zero(); size],
            input: vec![T::zero(); sizes.input],
            scratch: [square(), square(), square()],
            sides: 2,
        };
        method.prepare(system, &free, step);
        Some(method)
    }

    /// Remakes the matrices if a wheel began or ceased to stick, or the step changed.
    #[inline(always)]
    fn renew<S: Dynamics<T>>(&mut self, system: &S, mode: &[T], dt: f64) {
        let mut changed = T::Mask::splat(dt != self.step);
        for k in 0..mode.len() {
            // Only rest matters for the linear part, not the sense of motion.
            let moved = (mode[k].abs() - self.signature[k].abs()).abs();
            changed = changed.or(T::zero().less(moved));
        }
        if changed.any() {
            self.prepare(system, mode, dt);
        }
    }

    #[inline(never)]
    fn prepare<S: Dynamics<T>>(&mut self, system: &S, mode: &[T], dt: f64) {
        self.step = dt;
        self.signature.copy_from_slice(mode);
        system.linear_part(mode, &mut self.linear);
        let size = self.size;
        for (propagator, share) in self.propagators.iter_mut().zip(SHARES) {
            propagate(
                size,
                &self.linear,
                share * dt,
                propagator,
                &mut self.scratch,
            );
            propagator.pair();
        }
    }
}

impl<T: Scalar, I: Input<T>> Work<T> for Steps<'_, T, Exponential<T>, I> {
    type Output = ();
    const FOR_MOTORS: bool = true;

    #[inline(never)]
    fn run<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) {
        let steps = self;
        widest::<T, _>(On::<_, _, N, Z> { system, steps });
    }
}

impl<T: Scalar, S: Dynamics<T>, I: Input<T>, const N: usize, const Z: usize> Job
    for On<'_, S, Steps<'_, T, Exponential<T>, I>, N, Z>
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

impl<T: Scalar, I: Input<T>> Steps<'_, T, Exponential<T>, I> {
    #[inline(always)]
    fn make<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) {
        let [mut x, mut stage] = [Aligned([T::zero(); N]); 2];
        let [mut before, mut after] = [Aligned([T::zero(); N]); 2];
        let [mut first, mut middle, mut early, mut late] = [Aligned([T::zero(); N]); 4];
        let [mut start, mut rest] = [Aligned([T::zero(); Z]); 2];
        for k in 0..N {
            x.0[k] = self.x[k];
        }
        let mut held = Aligned([T::zero(); CORE_INPUT]);
        if let (Some(_), Some(u)) = (system.core(), self.input.held()) {
            system.core_input(u, &mut held.0);
        }
        for k in 0..self.count {
            let t = self.dt.mul_add(k as f64, self.t);
            let state: &mut [T] = if N == 0 { &mut *self.x } else { &mut x.0 };
            // A core has no modes: nothing in it can stick.
            if let (Some(_), Some(_)) = (system.core(), self.input.held()) {
                if self.method.step != self.dt {
                    self.method.prepare(system, self.mode, self.dt);
                }
            } else {
                self.input.at(t, &mut self.method.input);
                system.decide(state, &self.method.input, self.mode);
                self.method.renew(system, self.mode, self.dt);
            }
            let method = &mut *self.method;
            let matrices = (&method.linear[..], &method.propagators);
            let n = state.len();
            let buffers = if N == 0 {
                let [first, middle, early, late] = &mut method.slopes;
                let [before, after] = &mut method.others;
                Buffers {
                    slopes: [
                        &mut first[..n],
                        &mut middle[..n],
                        &mut early[..n],
                        &mut late[..n],
                    ],
                    stage: &mut method.stage[..n],
                    others: [&mut before[..n], &mut after[..n]],
                    start: &mut method.start[..method.size],
                    rest: &mut method.rest[..method.size],
                }
            } else {
                Buffers {
                    slopes: [&mut first.0, &mut middle.0, &mut early.0, &mut late.0],
                    stage: &mut stage.0,
                    others: [&mut before.0, &mut after.0],
                    start: &mut start.0,
                    rest: &mut rest.0,
                }
            };
            // No method of `Option`: what is known of it must stay so.
            if let (Some(core), Some(_)) = (system.core(), self.input.held()) {
                nodes_core(system, core, &held.0, self.dt, matrices.1, state, buffers);
                continue;
            }
            let from = if N == 0 { method.range.start } else { S::STIFF };
            let u = &mut method.input;
            nodes(
                system,
                self.input,
                t,
                self.dt,
                from,
                method.sides,
                matrices,
                u,
                state,
                self.mode,
                buffers,
            );
            system.settle(state, u, self.mode);
        }
        for k in 0..N {
            self.x[k] = x.0[k];
        }
    }
}

/// Room for a step: slopes at its start and at the three nodes (middle, first, last), a stage, states
/// at the outer nodes of a core, and the stiff states at the start with what is not linear in their rates.
struct Buffers<'a, T> {
    slopes: [&'a mut [T]; 4],
    stage: &'a mut [T],
    others: [&'a mut [T]; 2],
    start: &'a mut [T],
    rest: &'a mut [T],
}

/// `from` is the index of the first stiff state.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn nodes<T: Scalar, S: Dynamics<T>, I: Input<T>>(
    system: &S,
    input: &I,
    t: f64,
    dt: f64,
    from: usize,
    sides: usize,
    (linear, propagators): (&[T], &[Propagator<T>; 4]),
    u: &mut [T],
    x: &mut [T],
    mode: &[T],
    buffers: Buffers<'_, T>,
) {
    let Buffers {
        slopes: [first, middle, early, late],
        stage,
        start,
        rest,
        ..
    } = buffers;
    let (n, size) = (x.len(), start.len());
    for k in 0..size {
        start[k] = x[from + k];
    }
    system.derivative(x, u, mode, first);
    remainder(linear, start, &first[from..from + size], rest);

    // The middle of the step, which gives what is not linear.
    let half = T::from(0.5 * dt);
    for k in 0..n {
        stage[k] = half.mul_add(first[k], x[k]);
    }
    propagators[MIDDLE].apply(start, rest, &mut stage[from..from + size]);
    system.straighten(stage);
    if input.held().is_none() {
        input.at(t + 0.5 * dt, u);
    }
    system.derivative(stage, u, mode, middle);
    remainder(
        linear,
        &stage[from..from + size],
        &middle[from..from + size],
        rest,
    );

    // The outer nodes of the quadrature.
    const OUTER: [usize; 2] = [0, 2];
    // As the stages of Runge–Kutta 4, a loop for many lanes.
    let sides = if T::LANES > 1 { sides } else { 2 };
    for side in 0..sides {
        let share = SHARES[OUTER[side]];
        let before = T::from(share * dt * (1.0 - share));
        let after = T::from(share * dt * share);
        for k in 0..n {
            let moved = before.mul_add(first[k], x[k]);
            stage[k] = after.mul_add(middle[k], moved);
        }
        propagators[OUTER[side]].apply(start, rest, &mut stage[from..from + size]);
        system.straighten(stage);
        if input.held().is_none() {
            input.at(t + share * dt, u);
        }
        system.derivative(stage, u, mode, late);
        if side == 0 {
            for k in 0..n {
                early[k] = late[k];
            }
        }
    }
    let (outer, inner) = (T::from(dt * (5.0 / 18.0)), T::from(dt * (8.0 / 18.0)));
    for k in 0..n {
        let sum = inner.mul_add(middle[k], x[k]);
        x[k] = outer.mul_add(early[k] + late[k], sum);
    }
    propagators[END].apply(start, rest, &mut x[from..from + size]);
}

/// The same for a system whose other states are gathered from its core. Φ being ∫ e^{As} ds, the stiff
/// states are z₀ + Φ (A z₀ + N): for the half step with the rates at the start, and for the rest with
/// what N is more in the middle than there.
#[inline(always)]
fn nodes_core<T: Scalar, S: Dynamics<T>>(
    system: &S,
    core: Core,
    held: &[T],
    dt: f64,
    propagators: &[Propagator<T>; 4],
    x: &mut [T],
    buffers: Buffers<'_, T>,
) {
    let Buffers {
        slopes: [first, middle, early, late],
        stage,
        others: [before, after],
        start: end,
        rest,
    } = buffers;
    let (from, to) = core.summed;
    let is_paired = system.is_paired();
    system.core_enter(core, x, late);
    for i in core.read() {
        let at = core.angle(i);
        late[at + 1] = x[at + 1];
        late[at + 2] = x[at + 2];
    }
    let mut limited = system.core_rates(late, held, first);
    let begin = &late[from..to];
    propagators[MIDDLE].lead(is_paired, begin, &first[from..to], &mut stage[from..to]);
    let half = T::from(0.5 * dt);
    for i in core.read() {
        let at = core.angle(i);
        turn(x, half * first[at], stage, at);
    }
    limited = limited.or(system.core_rest(stage, held, middle));
    limited = limited.or(system.core_rest(late, held, early));
    for k in from..to {
        rest[k - from] = first[k] + (middle[k] - early[k]);
    }
    propagators[0].lead(is_paired, begin, rest, &mut before[from..to]);
    propagators[2].lead(is_paired, begin, rest, &mut after[from..to]);
    propagators[END].lead(is_paired, begin, rest, end);

    // The angles at the nodes, with their rates on a straight line from the start through the middle.
    let quarter = T::from(0.25 * dt);
    for i in core.read() {
        let at = core.angle(i);
        turn(x, quarter * (first[at] + middle[at]), stage, at);
        for side in 0..2 {
            let (node, share) = if side == 0 {
                (&mut *before, SHARES[0])
            } else {
                (&mut *after, SHARES[2])
            };
            let steady = T::from(share * (1.0 - share) * dt);
            let turned = T::from(share * share * dt).mul_add(middle[at], steady * first[at]);
            turn(x, turned, node, at);
        }
    }
    if !is_paired {
        system.core_spins(before, early);
        system.core_spins(after, late);
    }
    // √(8/5): the weights of Gauss's nodes are 5, 8 and 5 in 18.
    let share = T::from(1.264_911_064_067_351_8);
    for k in from..to {
        stage[k] *= share;
    }
    for i in core.read() {
        let at = core.angle(i);
        stage[at + 1] *= share;
        stage[at + 2] *= share;
    }
    for k in core.spins.0..core.spins.1 {
        middle[k] *= share;
    }
    let nodes = Nodes {
        states: [&*before, &*stage, &*after],
        rates: [&*early, &*middle, &*late],
        is_simpson: false,
        share,
        weight: T::from(dt * (5.0 / 18.0)),
    };
    system.gather(&nodes, held, limited, x);
    for k in from..to {
        stage[k] = end[k - from];
    }
    system.core_leave(core, stage, x);
}

/// Cosine and sine behind an angle, turned by a small one: to second order, which leaves their length.
#[inline(always)]
fn turn<T: Scalar>(x: &[T], angle: T, turned: &mut [T], at: usize) {
    let (cos, sin) = (x[at + 1], x[at + 2]);
    let half = T::from(0.5) * angle;
    turned[at + 1] = (-angle).mul_add(half.mul_add(cos, sin), cos);
    turned[at + 2] = angle.mul_add((-half).mul_add(sin, cos), sin);
}

impl<T: Scalar> Propagator<T> {
    /// Finds the integral of what is paired.
    fn pair(&mut self) {
        if self.pairs.is_empty() {
            return;
        }
        let of = |row: usize, column: usize| self.integral[4 * row + column];
        let pairs = [
            of(0, 0),
            of(0, 2),
            of(2, 0) + of(3, 0),
            of(2, 2) + of(3, 2),
            of(1, 1),
            of(1, 3),
            of(3, 1) - of(2, 1),
            of(3, 3) - of(2, 3),
        ];
        self.pairs.copy_from_slice(&pairs);
    }

    /// z ← z₀ + (∫ e^{As} ds) rate.
    #[inline(always)]
    fn lead(&self, is_paired: bool, start: &[T], rate: &[T], z: &mut [T]) {
        let size = start.len();
        let rate = &rate[..size];
        if is_paired {
            // Forward speed with the sum of the currents, yaw rate with their difference.
            let pairs = &self.pairs[..8];
            for k in 0..2 {
                let of = &pairs[4 * k..4 * k + 4];
                let (speed, current) = (rate[k], rate[k + 2]);
                z[k] = of[0].mul_add(speed, of[1].mul_add(current, start[k]));
                z[k + 2] = of[2].mul_add(speed, of[3].mul_add(current, start[k + 2]));
            }
            return;
        }
        for i in 0..size {
            let integral = &self.integral[i * size..(i + 1) * size];
            let mut sum = start[i];
            for k in 0..size {
                sum = integral[k].mul_add(rate[k], sum);
            }
            z[i] = sum;
        }
    }

    /// z ← e^{Ah} z₀ + (∫ e^{As} ds) N.
    #[inline(always)]
    fn apply(&self, start: &[T], rest: &[T], z: &mut [T]) {
        // Index loops: iterators are functions of their own and keep the step's instruction set out.
        let size = start.len();
        let rest = &rest[..size];
        for i in 0..size {
            let exponential = &self.exponential[i * size..(i + 1) * size];
            let integral = &self.integral[i * size..(i + 1) * size];
            let (mut free, mut forced) = (T::zero(), T::zero());
            for k in 0..size {
                free = exponential[k].mul_add(start[k], free);
                forced = integral[k].mul_add(rest[k], forced);
            }
            z[i] = free + forced;
        }
    }
}

/// N = ż − A z.
#[inline(always)]
fn remainder<T: Scalar>(linear: &[T], z: &[T], rate: &[T], rest: &mut [T]) {
    let size = z.len();
    for i in 0..size {
        let row = &linear[i * size..(i + 1) * size];
        let mut sum = rate[i];
        for k in 0..size {
            sum = (-row[k]).mul_add(z[k], sum);
        }
        rest[i] = sum;
    }
}

fused! {
    /// e^{At} and its integral, by scaling (to ‖At‖ ≤ ½), Taylor's series and doubling.
    fn propagate<T: Scalar>(
        size: usize,
        linear: &[T],
        time: f64,
        result: &mut Propagator<T>,
        scratch: &mut [Vec<T>; 3],
    ) {
        // At ‖At‖ ≤ ½ the 15th term is below 2⁻¹⁵/15! ≈ 2e-17.
        const TERMS: usize = 15;
        // Each lane has its own count of halvings: its bits must not depend on its neighbors.
        let mut norm = T::zero();
        for i in 0..size {
            let mut sum = T::zero();
            for k in 0..size {
                sum += linear[i * size + k].abs();
            }
            norm = norm.max(sum);
        }
        let mut h = T::from(time);
        let mut doublings = 0;
        let mut halved = [T::Mask::splat(false); DOUBLINGS_MAX];
        while doublings < DOUBLINGS_MAX {
            let long = T::from(0.5).less(norm * h);
            if !long.any() {
                break;
            }
            h = T::select(long, T::from(0.5) * h, h);
            halved[doublings] = long;
            doublings += 1;
        }
        let [power, next, _] = scratch;
        let (exponential, integral) = (&mut result.exponential, &mut result.integral);
        for i in 0..size {
            for k in 0..size {
                let unit = if i == k { T::one() } else { T::zero() };
                power[i * size + k] = unit;
                exponential[i * size + k] = unit;
                integral[i * size + k] = unit * h;
            }
        }
        for term in 1..=TERMS {
            multiply(size, power, linear, next);
            let factor = h * T::from(1.0 / term as f64);
            let spread = h * T::from(1.0 / (term + 1) as f64);
            for k in 0..size * size {
                power[k] = next[k] * factor;
                exponential[k] += power[k];
                integral[k] = power[k].mul_add(spread, integral[k]);
            }
        }
        for halved in &halved[..doublings] {
            // ∫₀²ʰ = ∫₀ʰ + e^{Ah} ∫₀ʰ.
            multiply(size, exponential, integral, next);
            for k in 0..size * size {
                integral[k] = T::select(*halved, integral[k] + next[k], integral[k]);
            }
            multiply(size, exponential, exponential, next);
            for k in 0..size * size {
                exponential[k] = T::select(*halved, next[k], exponential[k]);
            }
        }
    }
}
