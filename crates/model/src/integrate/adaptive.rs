//! An adaptive pair with dense output, whose steps end at events.

use crate::dynamics::{Dynamics, Input};
use crate::scalar::{Mask, Scalar};

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
