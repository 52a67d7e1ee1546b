//! Several numbers side by side, one trial per lane, for the vector instructions of the machine.
//!
//! Each operation is a loop over the lanes that the compiler turns into vector instructions; the bits
//! of a lane are those of the same run with plain `f64`, whatever the instruction set.

// Indexed loops throughout: iterator adapters pass closures, which need not be inlined into a caller
// compiled for a wider instruction set.
#![allow(clippy::needless_range_loop)]

#[cfg(target_arch = "x86_64")]
mod avx;
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
pub mod narrow;

use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::math::{self, Bits};
#[cfg(target_arch = "x86_64")]
use crate::scalar::Registers;
use crate::scalar::{Mask, Scalar};

/// `N` numbers side by side.
///
/// Aligned to 32 bytes: one AVX register for four lanes and two for eight, and no load crosses a
/// cache line in steps of a register. Fewer lanes than four waste room.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub struct Lanes<const N: usize>(
    /// Value of each lane.
    pub [f64; N],
);

/// Most lanes of a number: a register of AVX-512 in single precision.
pub const LANES_MAX: usize = 16;

/// Four lanes: one register of AVX2.
pub type Lanes4 = Lanes<4>;

/// Eight lanes: one register of AVX-512, two of AVX2.
pub type Lanes8 = Lanes<8>;

/// One truth value per lane of [`Lanes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LaneMask<const N: usize>(
    /// Value of each lane.
    pub [bool; N],
);

/// Work on numbers of a kind that is chosen at run time.
pub trait AnyLanes {
    /// What comes of it.
    type Output;
    /// Does it with numbers of one, four or eight lanes.
    fn run<T: Scalar<Single = f64>>(self) -> Self::Output;
}

/// The widest lanes that are of use on this machine: 4 or 8 (1 without vector registers).
pub fn widest() -> usize {
    #[cfg(target_arch = "x86_64")]
    {
        if crate::wide::has(Registers::Avx512) {
            8
        } else if crate::wide::has(Registers::Avx2) {
            4
        } else {
            1
        }
    }
    #[cfg(target_family = "wasm")]
    {
        1
    }
    #[cfg(not(any(target_arch = "x86_64", target_family = "wasm")))]
    4
}

/// Does a job on at most `lanes` lanes, as many as the machine has registers for. Lanes are a matter
/// of speed: each has the bits of the run with plain numbers.
pub fn dispatch<J: AnyLanes>(lanes: usize, job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    match lanes.min(widest()) {
        8.. => job.run::<avx::Avx8>(),
        4.. => job.run::<avx::Avx4>(),
        _ => job.run::<f64>(),
    }
    // A page has one trial at a time, and is to load fast.
    #[cfg(target_family = "wasm")]
    {
        let _ = lanes;
        job.run::<f64>()
    }
    #[cfg(not(any(target_arch = "x86_64", target_family = "wasm")))]
    match lanes {
        4.. => job.run::<Lanes4>(),
        _ => job.run::<f64>(),
    }
}

impl<const N: usize> From<f64> for Lanes<N> {
    /// The same value in every lane.
    #[inline(always)]
    fn from(value: f64) -> Self {
        Self([value; N])
    }
}

/// An operator of two numbers, and its assigning form, lane by lane.
macro_rules! operator {
    ($trait:ident, $method:ident, $symbol:tt) => {
        impl<const N: usize> $trait for Lanes<N> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut result = self;
                for i in 0..N {
                    result.0[i] = self.0[i] $symbol other.0[i];
                }
                result
            }
        }
    };
    ($trait:ident, $method:ident, $symbol:tt, $assign:ident, $assign_method:ident) => {
        operator!($trait, $method, $symbol);

        impl<const N: usize> $assign for Lanes<N> {
            #[inline(always)]
            fn $assign_method(&mut self, other: Self) {
                *self = *self $symbol other;
            }
        }
    };
}

operator!(Add, add, +, AddAssign, add_assign);
operator!(Sub, sub, -, SubAssign, sub_assign);
operator!(Mul, mul, *, MulAssign, mul_assign);
operator!(Div, div, /);

impl<const N: usize> Neg for Lanes<N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let mut result = self;
        for i in 0..N {
            result.0[i] = -self.0[i];
        }
        result
    }
}

/// A loop over the lanes of `result` with the given expression.
macro_rules! each_lane {
    ($start:expr, $i:ident => $value:expr) => {{
        let mut result = $start;
        for $i in 0..N {
            result.0[$i] = $value;
        }
        result
    }};
}

impl<const N: usize> Mask for LaneMask<N> {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        Self([value; N])
    }

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> bool) -> Self {
        each_lane!(Self([false; N]), i => value(i))
    }

    #[inline(always)]
    fn lane(self, index: usize) -> bool {
        self.0[index]
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        each_lane!(self, i => self.0[i] & other.0[i])
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        each_lane!(self, i => self.0[i] | other.0[i])
    }

    #[inline(always)]
    fn not(self) -> Self {
        each_lane!(self, i => !self.0[i])
    }

    #[inline(always)]
    fn any(self) -> bool {
        let mut result = false;
        for i in 0..N {
            result |= self.0[i];
        }
        result
    }

    #[inline(always)]
    fn all(self) -> bool {
        let mut result = true;
        for i in 0..N {
            result &= self.0[i];
        }
        result
    }
}

impl<const N: usize> Scalar for Lanes<N> {
    type Mask = LaneMask<N>;
    type Single = f64;

    const LANES: usize = N;

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
        each_lane!(Self([0.0; N]), i => value(i))
    }

    #[inline(always)]
    fn lane(self, index: usize) -> f64 {
        self.0[index]
    }

    #[inline(always)]
    fn single(self, index: usize) -> f64 {
        self.0[index]
    }

    #[inline(always)]
    fn from_singles(single: impl FnMut(usize) -> f64) -> Self {
        Self::from_lanes(single)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        each_lane!(self, i => f64::mul_add(self.0[i], a.0[i], b.0[i]))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        each_lane!(self, i => f64::sqrt(self.0[i]))
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        math::sin_cos(self)
    }

    #[inline(always)]
    fn atan(self) -> Self {
        math::atan(self)
    }

    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        math::atan2(self, x)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        math::exp(self)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        math::ln(self)
    }

    #[inline(always)]
    fn tanh(self) -> Self {
        math::tanh(self)
    }

    #[inline(always)]
    fn floor(self) -> Self {
        each_lane!(self, i => f64::floor(self.0[i]))
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        each_lane!(self, i => f64::copysign(self.0[i], sign.0[i]))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        each_lane!(self, i => f64::abs(self.0[i]))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        each_lane!(self, i => <f64 as Scalar>::min(self.0[i], other.0[i]))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        each_lane!(self, i => <f64 as Scalar>::max(self.0[i], other.0[i]))
    }

    #[inline(always)]
    fn less(self, other: Self) -> LaneMask<N> {
        each_lane!(LaneMask([false; N]), i => self.0[i] < other.0[i])
    }

    #[inline(always)]
    fn less_equal(self, other: Self) -> LaneMask<N> {
        each_lane!(LaneMask([false; N]), i => self.0[i] <= other.0[i])
    }

    #[inline(always)]
    fn is_finite(self) -> LaneMask<N> {
        each_lane!(LaneMask([false; N]), i => f64::is_finite(self.0[i]))
    }

    #[inline(always)]
    fn select(mask: LaneMask<N>, yes: Self, no: Self) -> Self {
        each_lane!(no, i => if mask.0[i] { yes.0[i] } else { no.0[i] })
    }
}

impl<const N: usize> Bits for Lanes<N> {
    #[inline(always)]
    fn power_of_two(self) -> Self {
        each_lane!(self, i => math::power_of_two(self.0[i]))
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let (mut exponent, mut fraction) = (self, self);
        for i in 0..N {
            (exponent.0[i], fraction.0[i]) = math::split(self.0[i]);
        }
        (exponent, fraction)
    }

    #[inline(always)]
    fn has_bit(self, index: u32) -> LaneMask<N> {
        each_lane!(LaneMask([false; N]), i => math::has_bit(self.0[i], index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{hypot, wrap_angle};

    /// Zeros, ends of the ranges, seams of the approximations, infinities and NaN.
    const SPECIAL: [f64; 24] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.5,
        2.0,
        core::f64::consts::PI,
        -core::f64::consts::PI,
        core::f64::consts::FRAC_PI_4,
        core::f64::consts::FRAC_1_SQRT_2,
        f64::MIN_POSITIVE,
        5e-324,
        -5e-324,
        f64::MAX,
        f64::MIN,
        709.782,
        -745.13,
        -708.5,
        1e15,
        1.000_000_1e15,
        1e9,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];

    /// Special values, then values of either sign over 30 decades (Weyl sequences, so the same on
    /// every machine).
    fn value(index: usize) -> f64 {
        if index < SPECIAL.len() {
            return SPECIAL[index];
        }
        let part = |step: f64| (index as f64 * step) % 1.0;
        let decade = math::exp(part(0.754_877_666) * 70.0 - 35.0);
        (part(0.569_840_291) - 0.5) * decade
    }

    const COUNT: usize = 400;

    /// Each lane must have the bits of the plain run; the pattern of a NaN is nobody's concern.
    fn check<const N: usize>(
        name: &str,
        lanes: impl Fn(Lanes<N>, Lanes<N>) -> Lanes<N>,
        plain: impl Fn(f64, f64) -> f64,
    ) {
        for first in 0..COUNT {
            // The lanes hold different values, so that an operation mixing them up is found.
            for offset in 0..SPECIAL.len() + 4 {
                let second = |i: usize| value((first + i + offset * 17) % COUNT);
                let a = Lanes::from_lanes(|i| value((first + 5 * i) % COUNT));
                let result = lanes(a, Lanes::from_lanes(second));
                for i in 0..N {
                    let expected = plain(a.lane(i), second(i));
                    let same = result.lane(i).to_bits() == expected.to_bits();
                    assert!(
                        same || result.lane(i).is_nan() && expected.is_nan(),
                        "{name}({:e}, {:e}): lane {:e}, plain {expected:e}",
                        a.lane(i),
                        second(i),
                        result.lane(i),
                    );
                }
            }
        }
    }

    /// The same text for lanes and for `f64`, through the trait in both cases.
    macro_rules! check_each {
        ($($name:literal: |$x:ident, $y:ident| $value:expr;)*) => {$({
            fn equation<T: Scalar>($x: T, $y: T) -> T {
                $value
            }
            check::<3>($name, equation, equation);
            check::<4>($name, equation, equation);
            check::<8>($name, equation, equation);
        })*};
    }

    #[test]
    fn invariant_lane_equals_plain_run_in_arithmetic() {
        check_each! {
            "+": |x, y| x + y;
            "-": |x, y| x - y;
            "*": |x, y| x * y;
            "/": |x, y| x / y;
            "+=": |x, y| { let mut z = x; z += y; z };
            "-=": |x, y| { let mut z = x; z -= y; z };
            "*=": |x, y| { let mut z = x; z *= y; z };
            "neg": |x, _y| -x;
            "mul_add": |x, y| x.mul_add(y, T::from(1.25) - x);
            "sqrt": |x, _y| x.sqrt();
            "floor": |x, _y| x.floor();
            "copysign": |x, y| x.copysign(y);
            "abs": |x, _y| x.abs();
            "min": |x, y| x.min(y);
            "max": |x, y| x.max(y);
            "less": |x, y| T::select(x.less(y), x, T::one());
            "less_equal": |x, y| T::select(x.less_equal(y), x, T::one());
            "is_finite": |x, y| T::select(x.is_finite(), x, y);
            "masks": |x, y| T::select(
                x.less(y).or(y.is_finite()).and(x.less_equal(T::zero()).not()), x, y);
        }
    }

    #[test]
    fn invariant_lane_equals_plain_run_in_functions() {
        check_each! {
            "sin": |x, _y| x.sin_cos().0;
            "cos": |x, _y| x.sin_cos().1;
            "atan": |x, _y| x.atan();
            "atan2": |x, y| x.atan2(y);
            "exp": |x, _y| x.exp();
            "ln": |x, _y| x.ln();
            "tanh": |x, _y| x.tanh();
            "wrap_angle": |x, _y| wrap_angle(x);
            "hypot": |x, y| hypot(x, y);
        }
    }

    /// Each number of a table comes to its lane and column.
    #[test]
    fn closed_form_columns_of_rows() {
        struct Columns;

        impl AnyLanes for Columns {
            type Output = ();

            fn run<T: Scalar<Single = f64>>(self) {
                let table: [[f64; 8]; LANES_MAX] = core::array::from_fn(|lane| {
                    core::array::from_fn(|column| (100 * lane + column) as f64)
                });
                let columns = T::columns(&table.each_ref());
                for (column, numbers) in columns.into_iter().enumerate() {
                    for lane in 0..T::LANES {
                        assert_eq!(numbers.lane(lane), table[lane][column]);
                    }
                }
            }
        }

        for lanes in [1, 4, 8] {
            dispatch(lanes, Columns);
        }
        for lanes in [1, 8, 16] {
            narrow::dispatch(lanes, Columns);
        }
    }

    #[test]
    fn closed_form_masks() {
        let mask = LaneMask::<4>::from_lanes(|i| i % 2 == 0);
        assert_eq!(mask.not(), LaneMask([false, true, false, true]));
        assert!(mask.any() && !mask.all() && mask.or(mask.not()).all());
        assert!(!mask.and(mask.not()).any() && LaneMask::<4>::splat(true).all());
        assert!(mask.lane(2) && !mask.lane(3));
    }

    /// A register of lanes must have no gaps.
    #[test]
    fn closed_form_layout() {
        assert_eq!(size_of::<Lanes4>(), 32);
        assert_eq!(size_of::<Lanes8>(), 64);
        assert_eq!(align_of::<Lanes4>(), 32);
    }
}
