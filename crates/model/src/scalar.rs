//! The number type of every equation: one plain `f64`, several lanes, or a dual number.
//!
//! Equations are written once, generic in [`Scalar`], and named as the methods of `f64`. Every
//! operation rounds the same way on every machine and in every lane: additions, products, quotients,
//! square roots and fused multiply-adds are exact to IEEE 754, and the elementary functions come from
//! [`crate::math`] rather than from the platform's library.
//!
//! All of it is `#[inline(always)]`, so that a batch loop compiled for a wider instruction set takes
//! the arithmetic with it; a call that stays outside would fall back to the portable instructions.
//!
//! On a variable of the concrete type `f64` the inherent methods win over this trait: there
//! `x.sin_cos()` is the platform's and differs in the last bits, and `x.max(y)` treats NaN
//! differently. Write `Scalar::sin_cos(x)` there.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::lanes::LANES_MAX;
use crate::math;

/// A number in an equation: `f64`, [`crate::lanes::Lanes`] or [`crate::dual::Dual`].
///
/// There is no order on it and no conversion to `bool`: lanes may disagree. Decisions on values are
/// made with [`Scalar::select`], [`Scalar::min`] and [`Scalar::max`]. `==` compares whole values,
/// for tests.
pub trait Scalar:
    Copy
    + Send
    + Sync
    + 'static
    + Debug
    + PartialEq
    + From<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// The outcome of a comparison, one `bool` per lane.
    type Mask: Mask;

    /// What a single lane holds: `f64`, or a dual number.
    type Single: Scalar;

    /// Number of lanes; 1 for `f64`.
    const LANES: usize;

    /// What the processor must have.
    const REGISTERS: Registers = Registers::Any;

    /// Whether integrators are compiled size by size for it: fast, and large.
    const TWINS: bool = false;

    /// Whether it has the precision of `f32`.
    const IS_NARROW: bool = false;

    /// Largest finite number.
    const LARGEST: f64 = if Self::IS_NARROW {
        f32::MAX as f64
    } else {
        f64::MAX
    };

    /// Smallest positive number of full precision.
    const LEAST: f64 = if Self::IS_NARROW {
        f32::MIN_POSITIVE as f64
    } else {
        f64::MIN_POSITIVE
    };

    /// Share of a matrix's trace below which a pivot is but rounding.
    const ROUNDING: f64 = if Self::IS_NARROW { 1e-5 } else { 1e-12 };

    /// Builds a number from the value of each lane; derivatives are zero.
    fn from_lanes(value: impl FnMut(usize) -> f64) -> Self;

    /// Value of one lane, `index < LANES`.
    fn lane(self, index: usize) -> f64;

    /// What one lane holds, `index < LANES`.
    fn single(self, index: usize) -> Self::Single;

    /// Builds a number from what each lane holds.
    fn from_singles(single: impl FnMut(usize) -> Self::Single) -> Self;

    /// The columns of a table of which each lane gives a row.
    #[inline(always)]
    fn columns(rows: &[&[f64; 8]; LANES_MAX]) -> [Self; 8] {
        let mut columns = [Self::zero(); 8];
        for (k, column) in columns.iter_mut().enumerate() {
            *column = Self::from_lanes(|lane| rows[lane][k]);
        }
        columns
    }

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::from(0.0)
    }

    /// One in every lane.
    #[inline(always)]
    fn one() -> Self {
        Self::from(1.0)
    }

    /// `self · a + b` with a single rounding, also where the machine has no such instruction.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// Square root; NaN below zero.
    fn sqrt(self) -> Self;

    /// Sine and cosine of an angle, rad; NaN for |angle| > [`math::ANGLE_MAX`].
    fn sin_cos(self) -> (Self, Self);

    /// Inverse tangent in [-π/2, π/2], rad.
    fn atan(self) -> Self;

    /// Angle of the point (`x`, `self`) in [-π, π], rad; signs and zeros as in IEEE 754.
    fn atan2(self, x: Self) -> Self;

    /// eˣ; overflows to infinity and underflows gradually to zero.
    fn exp(self) -> Self;

    /// Natural logarithm; -∞ at zero and NaN below.
    fn ln(self) -> Self;

    /// Hyperbolic tangent.
    fn tanh(self) -> Self;

    /// Largest integer not above `self`.
    fn floor(self) -> Self;

    /// Magnitude of `self` with the sign of `sign`, which may be a signed zero.
    fn copysign(self, sign: Self) -> Self;

    /// Magnitude.
    fn abs(self) -> Self;

    /// `other` where it is strictly smaller, else `self`: a NaN in `self` stays, one in `other` is
    /// dropped, unlike `f64::min`.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(other.less(self), other, self)
    }

    /// `other` where it is strictly larger, else `self`: a NaN in `self` stays, one in `other` is
    /// dropped, unlike `f64::max`.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(self.less(other), other, self)
    }

    /// Where `self < other`; false where either is NaN.
    fn less(self, other: Self) -> Self::Mask;

    /// Where `self ≤ other`; false where either is NaN.
    fn less_equal(self, other: Self) -> Self::Mask;

    /// Where the value is neither infinite nor NaN; derivatives are not looked at.
    fn is_finite(self) -> Self::Mask;

    /// `yes` where the mask holds, else `no`; what is not taken has no influence, not even NaN.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
}

/// Registers that a number lives in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Registers {
    /// Those of any processor, and nothing better is worth compiling: derivatives are asked for
    /// once a run, not in a batch.
    Unasked,
    /// Those of any processor, and vectors with fused multiply-add where it has them.
    Any,
    /// Vectors of 256 bits, with fused multiply-add.
    Avx2,
    /// Vectors of 512 bits.
    Avx512,
}

/// One truth value per lane, the outcome of comparing two [`Scalar`]s.
pub trait Mask: Copy + Send + Sync + 'static + Debug + PartialEq {
    /// The same value in every lane.
    fn splat(value: bool) -> Self;

    /// Builds a mask from the value of each lane.
    fn from_lanes(value: impl FnMut(usize) -> bool) -> Self;

    /// Value of one lane.
    fn lane(self, index: usize) -> bool;

    /// Lanes set in both.
    fn and(self, other: Self) -> Self;

    /// Lanes set in either.
    fn or(self, other: Self) -> Self;

    /// Lanes not set.
    fn not(self) -> Self;

    /// Whether any lane is set.
    fn any(self) -> bool;

    /// Whether all lanes are set.
    fn all(self) -> bool;
}

impl Mask for bool {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        value
    }

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> bool) -> Self {
        value(0)
    }

    #[inline(always)]
    fn lane(self, index: usize) -> bool {
        debug_assert!(index == 0, "f64 has one lane");
        self
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self | other
    }

    #[inline(always)]
    fn not(self) -> Self {
        !self
    }

    #[inline(always)]
    fn any(self) -> bool {
        self
    }

    #[inline(always)]
    fn all(self) -> bool {
        self
    }
}

impl Scalar for f64 {
    type Mask = bool;
    type Single = f64;

    const LANES: usize = 1;
    const TWINS: bool = true;

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
        value(0)
    }

    #[inline(always)]
    fn lane(self, index: usize) -> f64 {
        debug_assert!(index == 0, "f64 has one lane");
        self
    }

    #[inline(always)]
    fn single(self, index: usize) -> f64 {
        self.lane(index)
    }

    #[inline(always)]
    fn from_singles(mut single: impl FnMut(usize) -> f64) -> Self {
        single(0)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        f64::mul_add(self, a, b)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
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
        f64::floor(self)
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        f64::copysign(self, sign)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn less_equal(self, other: Self) -> bool {
        self <= other
    }

    #[inline(always)]
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }

    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
}

#[cfg(test)]
mod tests {
    use super::{Mask, Scalar};

    /// The receiver's NaN survives and the argument's is dropped, so that clamping a state against a
    /// constant never hides a bad state.
    #[test]
    fn invariant_clamping_keeps_a_nan_of_the_receiver() {
        assert!(Scalar::max(f64::NAN, 1.0).is_nan());
        assert!(Scalar::min(f64::NAN, 1.0).is_nan());
        assert_eq!(Scalar::max(1.0, f64::NAN), 1.0);
        assert_eq!(Scalar::min(1.0, f64::NAN), 1.0);
    }

    /// Zeros of either sign compare equal, so the receiver's is kept: the result has one defined sign.
    #[test]
    fn invariant_clamping_has_a_defined_sign_of_zero() {
        assert!(Scalar::max(-0.0, 0.0).is_sign_negative());
        assert!(Scalar::min(0.0, -0.0).is_sign_positive());
    }

    #[test]
    fn closed_form_min_max_select() {
        assert_eq!(Scalar::min(1.0, 2.0), 1.0);
        assert_eq!(Scalar::max(1.0, 2.0), 2.0);
        assert_eq!(<f64 as Scalar>::select(true, 1.0, f64::NAN), 1.0);
        assert_eq!(<f64 as Scalar>::from_lanes(|i| i as f64 + 3.0), 3.0);
        assert!(!Scalar::is_finite(f64::INFINITY) && !Scalar::is_finite(f64::NAN));
    }

    #[test]
    fn closed_form_bool_is_a_mask_of_one_lane() {
        assert!(bool::splat(true).and(false.not()).all());
        assert!(!Mask::or(false, false).any());
        assert!(<bool as Mask>::from_lanes(|i| i == 0).lane(0));
    }
}
