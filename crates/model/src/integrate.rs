//! Integrators: Runge–Kutta 4 at a fixed step, an exponential method for motors, and an adaptive
//! pair that finds events.
//!
//! Each step is: decide the mode, move at constant mode, settle. A jump of the input ends a step;
//! seeing to that is the caller's part. Nothing allocates after construction.

use crate::dynamics::{Dynamics, Input, Work};
use crate::scalar::{Mask, Scalar};

/// The classical Runge–Kutta method of order 4.
#[derive(Clone, Debug)]
pub struct RungeKutta4<T> {
    slope: Vec<T>,
    sum: Vec<T>,
    stage: Vec<T>,
    input: Vec<T>,
}

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
    start: Vec<T>,
    rest: Vec<T>,
    input: Vec<T>,
    scratch: [Vec<T>; 3],
}

/// e^{Ah} and ∫₀ʰ e^{As} ds, row-major.
#[derive(Clone, Debug)]
struct Propagator<T> {
    exponential: Vec<T>,
    integral: Vec<T>,
}

/// Numbers that do not straddle cache lines, wherever the stack begins.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Aligned<T, const N: usize>([T; N]);

/// One step, as a job for the twin of a system whose sizes the compiler knows.
struct Step<'a, T, M, I> {
    method: &'a mut M,
    input: &'a I,
    t: f64,
    dt: f64,
    x: &'a mut [T],
    mode: &'a mut [T],
}

/// A method of fixed steps: `step` is compiled for fused multiply-add where the processor has it.
/// The bits are the same either way: `mul_add` is fused everywhere.
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
                let step = Step {
                    method: self,
                    input,
                    t,
                    dt,
                    x,
                    mode,
                };
                #[cfg(target_arch = "x86_64")]
                {
                    #[target_feature(enable = "avx2,fma")]
                    fn fused<T: Scalar, S: Dynamics<T>, I: Input<T>>(
                        system: &S,
                        step: Step<'_, T, $method<T>, I>,
                    ) {
                        // Twins are compiled for held inputs only, as control loops give them: they
                        // are large, and what varies within a step comes from tests and tools.
                        if I::HELD {
                            system.specialised(step);
                        } else {
                            step.run::<0, 0, S>(system);
                        }
                    }
                    if std::arch::is_x86_feature_detected!("avx2")
                        && std::arch::is_x86_feature_detected!("fma")
                    {
                        // SAFETY: the features that `fused` is compiled for were found on this
                        // processor.
                        #[allow(unsafe_code)]
                        unsafe {
                            fused(system, step);
                        }
                    } else {
                        // Rare machines, for which no sizes are compiled in.
                        step.run::<0, 0, S>(system);
                    }
                }
                #[cfg(not(target_arch = "x86_64"))]
                system.specialised(step);
            }
        }
    };
}

stepped!(RungeKutta4);
stepped!(Exponential);

mod rk4 {
    use super::*;

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

    impl<T: Scalar, I: Input<T>> Work<T> for Step<'_, T, RungeKutta4<T>, I> {
        type Output = ();

        #[inline(always)]
        fn run<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) {
            self.input.at(self.t, &mut self.method.input);
            system.decide(self.x, &self.method.input, self.mode);
            if N == 0 {
                let n = self.x.len();
                let RungeKutta4 {
                    slope,
                    sum,
                    stage,
                    input,
                } = self.method;
                let buffers = [&mut slope[..n], &mut sum[..n], &mut stage[..n]];
                stages(
                    system, self.input, self.t, self.dt, input, self.x, self.mode, buffers,
                );
            } else {
                // Arrays of known length need no memory but registers.
                let [mut x, mut slope, mut sum, mut stage] = [Aligned([T::zero(); N]); 4];
                for k in 0..N {
                    x.0[k] = self.x[k];
                }
                let buffers = [&mut slope.0[..], &mut sum.0[..], &mut stage.0[..]];
                let input = &mut self.method.input;
                stages(
                    system, self.input, self.t, self.dt, input, &mut x.0, self.mode, buffers,
                );
                for k in 0..N {
                    self.x[k] = x.0[k];
                }
            }
            system.settle(self.x, &self.method.input, self.mode);
        }
    }

    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn stages<T: Scalar, S: Dynamics<T>, I: Input<T>>(
        system: &S,
        input: &I,
        t: f64,
        dt: f64,
        u: &mut [T],
        x: &mut [T],
        mode: &[T],
        [slope, sum, stage]: [&mut [T]; 3],
    ) {
        const AHEAD: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
        const WEIGHT: [f64; 4] = [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];
        let n = x.len();
        system.derivative(x, u, mode, slope);
        let weight = T::from(WEIGHT[0] * dt);
        for k in 0..n {
            sum[k] = weight * slope[k];
        }
        for i in 1..4 {
            if !I::HELD {
                input.at(t + AHEAD[i] * dt, u);
            }
            let ahead = T::from(AHEAD[i] * dt);
            for k in 0..n {
                stage[k] = ahead.mul_add(slope[k], x[k]);
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
    }
}

mod etd {
    use super::*;

    /// Shares of the step at Gauss's three nodes, (1 ± √(3/5))/2 and ½, and at its end.
    const SHARES: [f64; 4] = [0.112_701_665_379_258_3, 0.5, 0.887_298_334_620_741_7, 1.0];
    const MIDDLE: usize = 1;
    const END: usize = 3;

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
                start: states(),
                rest: vec![T::zero(); size],
                input: vec![T::zero(); sizes.input],
                scratch: [square(), square(), square()],
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
            }
        }
    }

    impl<T: Scalar, I: Input<T>> Work<T> for Step<'_, T, Exponential<T>, I> {
        type Output = ();

        #[inline(always)]
        fn run<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) {
            self.input.at(self.t, &mut self.method.input);
            system.decide(self.x, &self.method.input, self.mode);
            self.method.renew(system, self.mode, self.dt);
            let Exponential {
                size,
                range,
                linear,
                propagators,
                slopes,
                stage,
                start,
                rest,
                input: u,
                ..
            } = self.method;
            let matrices = (&linear[..], &*propagators);
            if N == 0 {
                let n = self.x.len();
                let [first, middle, early, late] = slopes;
                let buffers = Buffers {
                    slopes: [
                        &mut first[..n],
                        &mut middle[..n],
                        &mut early[..n],
                        &mut late[..n],
                    ],
                    stage: &mut stage[..n],
                    start: &mut start[..*size],
                    rest: &mut rest[..*size],
                };
                nodes(
                    system,
                    self.input,
                    self.t,
                    self.dt,
                    range.start,
                    matrices,
                    u,
                    self.x,
                    self.mode,
                    buffers,
                );
            } else {
                let [mut x, mut stage] = [Aligned([T::zero(); N]); 2];
                for k in 0..N {
                    x.0[k] = self.x[k];
                }
                let [mut first, mut middle, mut early, mut late] = [Aligned([T::zero(); N]); 4];
                let [mut start, mut rest] = [Aligned([T::zero(); Z]); 2];
                let buffers = Buffers {
                    slopes: [&mut first.0, &mut middle.0, &mut early.0, &mut late.0],
                    stage: &mut stage.0,
                    start: &mut start.0,
                    rest: &mut rest.0,
                };
                nodes(
                    system,
                    self.input,
                    self.t,
                    self.dt,
                    S::STIFF,
                    matrices,
                    u,
                    &mut x.0,
                    self.mode,
                    buffers,
                );
                for k in 0..N {
                    self.x[k] = x.0[k];
                }
            }
            system.settle(self.x, u, self.mode);
        }
    }

    /// Room for a step: slopes at its start and at the three nodes (middle, first, last), a stage,
    /// and the stiff states at the start with what is not linear in their rates.
    struct Buffers<'a, T> {
        slopes: [&'a mut [T]; 4],
        stage: &'a mut [T],
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
        if !I::HELD {
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
        for side in 0..2 {
            let share = SHARES[OUTER[side]];
            let before = T::from(share * dt * (1.0 - share));
            let after = T::from(share * dt * share);
            for k in 0..n {
                let moved = before.mul_add(first[k], x[k]);
                stage[k] = after.mul_add(middle[k], moved);
            }
            propagators[OUTER[side]].apply(start, rest, &mut stage[from..from + size]);
            system.straighten(stage);
            if !I::HELD {
                input.at(t + share * dt, u);
            }
            if side == 0 {
                system.derivative(stage, u, mode, early);
            } else {
                system.derivative(stage, u, mode, late);
            }
        }
        let (outer, inner) = (T::from(dt * (5.0 / 18.0)), T::from(dt * (8.0 / 18.0)));
        for k in 0..n {
            let sum = inner.mul_add(middle[k], x[k]);
            x[k] = outer.mul_add(early[k] + late[k], sum);
        }
        propagators[END].apply(start, rest, &mut x[from..from + size]);
    }
}

impl<T: Scalar> Propagator<T> {
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
    let norm = (0..T::LANES)
        .flat_map(|lane| (0..size).map(move |i| (lane, i)))
        .map(|(lane, i)| -> f64 {
            (0..size)
                .map(|k| linear[i * size + k].lane(lane).abs())
                .sum()
        })
        .fold(0.0, f64::max);
    let mut doublings = 0;
    let mut short = time;
    while norm * short > 0.5 && doublings < 60 {
        short *= 0.5;
        doublings += 1;
    }
    let [power, next, _] = scratch;
    let (exponential, integral) = (&mut result.exponential, &mut result.integral);
    let h = T::from(short);
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
    for _ in 0..doublings {
        // ∫₀²ʰ = ∫₀ʰ + e^{Ah} ∫₀ʰ.
        multiply(size, exponential, integral, next);
        for k in 0..size * size {
            integral[k] += next[k];
        }
        multiply(size, exponential, exponential, next);
        exponential.copy_from_slice(&next[..size * size]);
    }
}

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
    // ρ = lim ‖J^m‖^{1/m}: squared six times, with the scale taken out each time.
    let mut log = 0.0;
    let mut weight = 1.0;
    let mut next = vec![0.0; n * n];
    for _ in 0..7 {
        let norm = jacobian.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if norm == 0.0 {
            return 0.0;
        }
        log += weight * Scalar::ln(norm);
        weight *= 0.5;
        for entry in &mut jacobian {
            *entry /= norm;
        }
        multiply(n, &jacobian, &jacobian, &mut next);
        core::mem::swap(&mut jacobian, &mut next);
    }
    Scalar::exp(log)
}

/// The pair of Tsitouras (2011), orders 5 and 4, with dense output; steps end at events.
///
/// Ch. Tsitouras, *Runge–Kutta pairs of order 5(4) satisfying only the first column simplifying
/// assumption*, Computers & Mathematics with Applications 62 (2011) 770–775.
#[derive(Clone, Debug)]
pub struct Adaptive<T> {
    /// Tolerance relative to each state.
    pub relative: f64,
    /// Tolerance in units of each state.
    pub absolute: f64,
    /// Largest step, s.
    pub step_max: f64,
    step: f64,
    slopes: [Vec<T>; 7],
    start: Vec<T>,
    end: Vec<T>,
    stage: Vec<T>,
    input: Vec<T>,
    before: Vec<T>,
    after: Vec<T>,
    last_step: f64,
}

/// A function of the state whose change of sign ends an adaptive integration.
pub type Watch<'a, T> = &'a dyn Fn(&[T]) -> f64;

/// Why an adaptive integration gave up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stalled {
    /// The step fell below what time can resolve, at this time, s.
    StepTooSmall(f64),
    /// The state is no longer finite, at this time, s.
    NotFinite(f64),
}

/// Nodes, weights and the difference of the two orders of Tsitouras' pair.
#[allow(clippy::excessive_precision)] // As published.
mod tableau {
    pub const C: [f64; 7] = [0.0, 0.161, 0.327, 0.9, 0.980_025_540_904_509_7, 1.0, 1.0];
    pub const A: [[f64; 6]; 7] = [
        [0.0; 6],
        [0.161, 0.0, 0.0, 0.0, 0.0, 0.0],
        [
            -0.008_480_655_492_356_989,
            0.335_480_655_492_357,
            0.0,
            0.0,
            0.0,
            0.0,
        ],
        [
            2.897_153_057_105_493_5,
            -6.359_448_489_975_075,
            4.362_295_432_869_581_5,
            0.0,
            0.0,
            0.0,
        ],
        [
            5.325_864_828_439_257,
            -11.748_883_564_062_828,
            7.495_539_342_889_836_5,
            -0.092_495_066_361_755_25,
            0.0,
            0.0,
        ],
        [
            5.861_455_442_946_42,
            -12.920_969_317_847_11,
            8.159_367_898_576_159,
            -0.071_584_973_281_401,
            -0.028_269_050_394_068_383,
            0.0,
        ],
        [
            0.096_460_766_818_065_23,
            0.01,
            0.479_889_650_414_499_6,
            1.379_008_574_103_742,
            -3.290_069_515_436_081,
            2.324_710_524_099_774,
        ],
    ];
    pub const DIFFERENCE: [f64; 7] = [
        0.001_780_011_052_225_777_14,
        0.000_816_434_459_656_746_9,
        -0.007_880_878_010_261_995,
        0.144_711_007_173_262_9,
        -0.582_357_165_452_555_2,
        0.458_082_105_929_186_97,
        -1.0 / 66.0,
    ];
    /// Coefficients of θ, θ², θ³, θ⁴ of the weight of each slope in the dense output.
    pub const DENSE: [[f64; 4]; 7] = [
        [
            1.0,
            -2.763_706_197_274_826,
            2.913_255_461_821_912_6,
            -1.053_088_497_729_021_6,
        ],
        [0.0, 0.131_7, -0.223_4, 0.101_7],
        [
            0.0,
            3.930_296_236_894_751_6,
            -5.941_033_872_131_505,
            2.490_627_285_651_253,
        ],
        [
            0.0,
            -12.411_077_166_933_676,
            30.338_188_630_282_32,
            -16.548_102_889_244_902,
        ],
        [
            0.0,
            37.509_313_416_511_04,
            -88.178_904_894_766_4,
            47.379_521_962_819_28,
        ],
        [
            0.0,
            -27.896_526_289_197_286,
            65.091_894_674_793_66,
            -34.870_657_861_496_61,
        ],
        [0.0, 1.5, -4.0, 2.5],
    ];
}

impl<T: Scalar> Adaptive<T> {
    /// Order of the method.
    pub const ORDER: u32 = 5;

    /// Makes room for `system`; tolerances as in the fields.
    pub fn new<S: Dynamics<T>>(system: &S, relative: f64, absolute: f64) -> Self {
        let sizes = system.sizes();
        let states = || vec![T::zero(); sizes.state];
        let guards = || vec![T::zero(); sizes.guards];
        Adaptive {
            relative,
            absolute,
            step_max: f64::INFINITY,
            step: 1e-3,
            slopes: core::array::from_fn(|_| states()),
            start: states(),
            end: states(),
            stage: states(),
            input: vec![T::zero(); sizes.input],
            before: guards(),
            after: guards(),
            last_step: 0.0,
        }
    }

    /// Integrates from t to `end`, s; the input must be smooth in between. With `watch`, stops
    /// where that function of the state changes sign. Returns the time reached.
    #[allow(clippy::too_many_arguments)]
    pub fn advance<S: Dynamics<T>, I: Input<T>>(
        &mut self,
        system: &S,
        input: &I,
        mut t: f64,
        end: f64,
        x: &mut [T],
        mode: &mut [T],
        watch: Option<Watch<'_, T>>,
    ) -> Result<f64, Stalled> {
        while t < end {
            input.at(t, &mut self.input);
            system.decide(x, &self.input, mode);
            self.start.copy_from_slice(x);
            system.guards(&self.start, &self.input, mode, &mut self.before);
            let watched = watch.map(|function| function(x));
            let remaining = end - t;
            let mut h = self.step.min(self.step_max);
            if h > remaining * (1.0 - 1e-9) {
                // No sliver of a step is left for rounding's sake.
                h = remaining;
            }
            loop {
                if h < 1e-14 * t.abs().max(1e-3) {
                    return Err(Stalled::StepTooSmall(t));
                }
                let error = self.attempt(system, input, t, h, mode);
                if !error.is_finite() {
                    if h < 1e-12 {
                        return Err(Stalled::NotFinite(t));
                    }
                    h *= 0.1;
                    continue;
                }
                // The usual controller of a method of order 5, with its safety factor.
                let root = Scalar::exp(0.2 * Scalar::ln(error.max(1e-10)));
                let factor = (0.9 / root).clamp(0.2, 5.0);
                if error <= 1.0 {
                    if h >= remaining {
                        self.step = self.step.max(h * factor);
                    } else {
                        self.step = h * factor;
                    }
                    break;
                }
                h *= factor.min(0.9);
            }
            let crossed = |method: &mut Self, h: f64| -> f64 {
                input.at(t + h, &mut method.input);
                system.guards(&method.end, &method.input, mode, &mut method.after);
                let mut lowest = f64::INFINITY;
                for (before, after) in method.before.iter().zip(&method.after) {
                    if before.lane(0) > 0.0 {
                        lowest = lowest.min(after.lane(0));
                    }
                }
                if let (Some(function), Some(was)) = (watch, watched)
                    && was != 0.0
                {
                    lowest = lowest.min(function(&method.end) * was.signum());
                }
                lowest
            };
            let mut lowest = crossed(self, h);
            if lowest <= 0.0 {
                // Bisection of the step itself: every trial is integrated afresh, so the event is
                // as exact as the method, and the accepted end lies just beyond it.
                let (mut low, mut high) = (0.0, h);
                while high - low > 1e-14 * (1.0 + t.abs()) {
                    let middle = 0.5 * (low + high);
                    self.attempt(system, input, t, middle, mode);
                    lowest = crossed(self, middle);
                    if lowest <= 0.0 {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                h = high;
                self.attempt(system, input, t, h, mode);
            }
            let stopped = match (watch, watched) {
                (Some(function), Some(was)) if was != 0.0 => {
                    function(&self.end) * was.signum() <= 0.0
                }
                _ => false,
            };
            x.copy_from_slice(&self.end);
            t = if h >= remaining { end } else { t + h };
            self.last_step = h;
            input.at(t, &mut self.input);
            system.settle(x, &self.input, mode);
            if !x.iter().all(|value| value.is_finite().all()) {
                return Err(Stalled::NotFinite(t));
            }
            if stopped {
                return Ok(t);
            }
        }
        Ok(t)
    }

    /// Length of the step that will be tried next, s: part of the state of a run.
    pub fn next_step(&self) -> f64 {
        self.step
    }

    /// Sets the length of the step to try next, s.
    pub fn set_next_step(&mut self, step: f64) {
        self.step = step;
    }

    /// State within the last step at θ ∈ [0, 1] of it, to order 4.
    pub fn interpolate(&self, theta: f64, x: &mut [T]) {
        for (k, value) in x.iter_mut().enumerate() {
            let mut sum = self.start[k];
            for (slope, c) in self.slopes.iter().zip(tableau::DENSE) {
                let weight = theta * (c[0] + theta * (c[1] + theta * (c[2] + theta * c[3])));
                sum = T::from(weight * self.last_step).mul_add(slope[k], sum);
            }
            *value = sum;
        }
    }

    /// One step from `start` into `end`; the error in units of the tolerance.
    fn attempt<S: Dynamics<T>, I: Input<T>>(
        &mut self,
        system: &S,
        input: &I,
        t: f64,
        h: f64,
        mode: &[T],
    ) -> f64 {
        let n = self.start.len();
        for i in 0..7 {
            self.stage.copy_from_slice(&self.start);
            for (j, &a) in tableau::A[i].iter().enumerate().take(i) {
                let weight = T::from(a * h);
                for k in 0..n {
                    self.stage[k] = weight.mul_add(self.slopes[j][k], self.stage[k]);
                }
            }
            input.at(t + tableau::C[i] * h, &mut self.input);
            system.derivative(&self.stage, &self.input, mode, &mut self.slopes[i]);
        }
        // The seventh stage is the solution of order 5.
        self.end.copy_from_slice(&self.stage);
        let mut worst: f64 = 0.0;
        for k in 0..n {
            if system.is_derived(k) {
                continue;
            }
            let mut error = 0.0;
            for (slope, weight) in self.slopes.iter().zip(tableau::DIFFERENCE) {
                error += weight * slope[k].lane(0);
            }
            let size = self.start[k].lane(0).abs().max(self.end[k].lane(0).abs());
            let scaled = (h * error).abs() / (self.absolute + self.relative * size);
            worst = if scaled.is_nan() {
                f64::NAN
            } else {
                worst.max(scaled)
            };
            if worst.is_nan() {
                return worst;
            }
        }
        worst
    }
}
