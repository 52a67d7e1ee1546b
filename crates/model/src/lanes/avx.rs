//! Lanes in vector registers of x86-64.
//!
//! [`super::dispatch`] alone hands these types out, after it has looked at the processor: no value of
//! them exists where the instructions do not.

#![allow(unsafe_code)]

use core::arch::x86_64::*;
use core::fmt;
use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::lanes::LANES_MAX;
use crate::math::{self, Bits};
use crate::scalar::{Mask, Registers, Scalar};

/// An intrinsic on values of this module.
// SAFETY: where a value of these types exists, the processor has their instructions (see above).
macro_rules! vector {
    ($call:expr) => {
        unsafe { $call }
    };
}

macro_rules! operator {
    ($type:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $type {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(vector!($intrinsic(self.0, other.0)))
            }
        }
    };
    ($type:ident, $trait:ident, $method:ident, $intrinsic:ident, $assign:ident, $assign_method:ident) => {
        operator!($type, $trait, $method, $intrinsic);

        impl $assign for $type {
            #[inline(always)]
            fn $assign_method(&mut self, other: Self) {
                self.0 = vector!($intrinsic(self.0, other.0));
            }
        }
    };
}

/// What all registers of numbers have in common; the intrinsics are named in turn.
macro_rules! register {
    (
        $type:ident, $mask:ident, $number:ident x $lanes:literal, $registers:expr, $functions:ident;
        $splat:ident
        $add:ident $sub:ident $mul:ident $div:ident $fma:ident $sqrt:ident $min:ident $max:ident
    ) => {
        impl $type {
            // No intrinsics here: where they are not inlined, they would be most of the work.
            // SAFETY: a register of numbers is as many numbers, in order.
            #[inline(always)]
            fn array(self) -> [$number; $lanes] {
                unsafe { core::mem::transmute(self) }
            }

            #[inline(always)]
            fn of_array(lanes: [$number; $lanes]) -> Self {
                unsafe { core::mem::transmute(lanes) }
            }
        }

        impl fmt::Debug for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.array().fmt(f)
            }
        }

        impl PartialEq for $type {
            fn eq(&self, other: &Self) -> bool {
                self.array() == other.array()
            }
        }

        impl From<f64> for $type {
            #[inline(always)]
            fn from(value: f64) -> Self {
                Self(vector!($splat(value as $number)))
            }
        }

        operator!($type, Add, add, $add, AddAssign, add_assign);
        operator!($type, Sub, sub, $sub, SubAssign, sub_assign);
        operator!($type, Mul, mul, $mul, MulAssign, mul_assign);
        operator!($type, Div, div, $div);

        impl Neg for $type {
            type Output = Self;

            #[inline(always)]
            fn neg(self) -> Self {
                self.flip(Self::from(-0.0))
            }
        }

        impl Scalar for $type {
            type Mask = $mask;
            type Single = f64;

            const LANES: usize = $lanes;
            const REGISTERS: Registers = $registers;
            const TWINS: bool = true;
            const IS_NARROW: bool = core::mem::size_of::<$number>() == 4;

            #[inline(always)]
            fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
                let mut lanes: [$number; $lanes] = [0.0; $lanes];
                for (i, lane) in lanes.iter_mut().enumerate() {
                    *lane = value(i) as $number;
                }
                Self::of_array(lanes)
            }

            #[inline(always)]
            fn lane(self, index: usize) -> f64 {
                f64::from(self.array()[index])
            }

            #[inline(always)]
            fn single(self, index: usize) -> f64 {
                self.lane(index)
            }

            #[inline(always)]
            fn from_singles(single: impl FnMut(usize) -> f64) -> Self {
                Self::from_lanes(single)
            }

            #[inline(always)]
            fn columns(rows: &[&[f64; 8]; LANES_MAX]) -> [Self; 8] {
                Self::transposed(rows)
            }

            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                Self(vector!($fma(self.0, a.0, b.0)))
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(vector!($sqrt(self.0)))
            }

            #[inline(always)]
            fn sin_cos(self) -> (Self, Self) {
                $functions::sin_cos(self)
            }

            #[inline(always)]
            fn atan(self) -> Self {
                $functions::atan(self)
            }

            #[inline(always)]
            fn atan2(self, x: Self) -> Self {
                $functions::atan2(self, x)
            }

            #[inline(always)]
            fn exp(self) -> Self {
                $functions::exp(self)
            }

            #[inline(always)]
            fn ln(self) -> Self {
                $functions::ln(self)
            }

            #[inline(always)]
            fn tanh(self) -> Self {
                $functions::tanh(self)
            }

            #[inline(always)]
            fn floor(self) -> Self {
                self.rounded_down()
            }

            #[inline(always)]
            fn copysign(self, sign: Self) -> Self {
                self.signed(sign)
            }

            #[inline(always)]
            fn abs(self) -> Self {
                self.signed(Self::from(0.0))
            }

            // The instructions give their second operand where either is NaN, or both are zero.
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self(vector!($min(other.0, self.0)))
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self(vector!($max(other.0, self.0)))
            }

            #[inline(always)]
            fn less(self, other: Self) -> $mask {
                self.compare_less(other)
            }

            #[inline(always)]
            fn less_equal(self, other: Self) -> $mask {
                self.compare_less_equal(other)
            }

            #[inline(always)]
            fn is_finite(self) -> $mask {
                self.abs().compare_less(Self::from(f64::INFINITY))
            }

            #[inline(always)]
            fn select(mask: $mask, yes: Self, no: Self) -> Self {
                Self::choose(mask, yes, no)
            }
        }
    };
}

/// The binary form of `f64`s, for the elementary functions.
macro_rules! bits {
    ($type:ident, $mask:ident) => {
        impl Bits for $type {
            #[inline(always)]
            fn power_of_two(self) -> Self {
                let sum = self + Self::from(math::TWO_52 + 1023.0);
                sum.shifted_left_52()
            }

            #[inline(always)]
            fn split(self) -> (Self, Self) {
                self.parts()
            }

            #[inline(always)]
            fn has_bit(self, index: u32) -> $mask {
                self.tests(1 << index)
            }
        }
    };
}

/// Four numbers in a register of AVX2.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Avx4(__m256d);

/// Four truth values, each as 64 equal bits.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Mask4(__m256d);

bits!(Avx4, Mask4);
register! {
    Avx4, Mask4, f64 x 4, Registers::Avx2, math;
    _mm256_set1_pd
    _mm256_add_pd _mm256_sub_pd _mm256_mul_pd _mm256_div_pd _mm256_fmadd_pd _mm256_sqrt_pd
    _mm256_min_pd _mm256_max_pd
}

impl Avx4 {
    /// Columns of four rows, by halves: pairs of rows, then of pairs.
    #[inline(always)]
    fn transposed(rows: &[&[f64; 8]; LANES_MAX]) -> [Self; 8] {
        let mut columns = [Self::from(0.0); 8];
        for half in [0, 4] {
            let mut pairs = [[Self::from(0.0).0; 2]; 2];
            for k in 0..2 {
                // SAFETY: half a row is four numbers, aligned as such.
                let first = vector!(_mm256_loadu_pd(rows[2 * k][half..].as_ptr()));
                let second = vector!(_mm256_loadu_pd(rows[2 * k + 1][half..].as_ptr()));
                pairs[k][0] = vector!(_mm256_unpacklo_pd(first, second));
                pairs[k][1] = vector!(_mm256_unpackhi_pd(first, second));
            }
            for odd in 0..2 {
                let (first, second) = (pairs[0][odd], pairs[1][odd]);
                let low = vector!(_mm256_permute2f128_pd::<0x20>(first, second));
                let high = vector!(_mm256_permute2f128_pd::<0x31>(first, second));
                columns[half + odd] = Self(low);
                columns[half + odd + 2] = Self(high);
            }
        }
        columns
    }

    #[inline(always)]
    fn flip(self, bits: Self) -> Self {
        Self(vector!(_mm256_xor_pd(self.0, bits.0)))
    }

    #[inline(always)]
    fn signed(self, sign: Self) -> Self {
        let top = Self::from(-0.0).0;
        let (size, sign) = vector!((_mm256_andnot_pd(top, self.0), _mm256_and_pd(top, sign.0)));
        Self(vector!(_mm256_or_pd(size, sign)))
    }

    #[inline(always)]
    fn rounded_down(self) -> Self {
        Self(vector!(_mm256_floor_pd(self.0)))
    }

    #[inline(always)]
    fn compare_less(self, other: Self) -> Mask4 {
        Mask4(vector!(_mm256_cmp_pd::<_CMP_LT_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn compare_less_equal(self, other: Self) -> Mask4 {
        Mask4(vector!(_mm256_cmp_pd::<_CMP_LE_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn choose(mask: Mask4, yes: Self, no: Self) -> Self {
        Self(vector!(_mm256_blendv_pd(no.0, yes.0, mask.0)))
    }

    #[inline(always)]
    fn integers(self) -> __m256i {
        vector!(_mm256_castpd_si256(self.0))
    }

    #[inline(always)]
    fn of_integers(bits: __m256i) -> Self {
        Self(vector!(_mm256_castsi256_pd(bits)))
    }

    #[inline(always)]
    fn shifted_left_52(self) -> Self {
        Self::of_integers(vector!(_mm256_slli_epi64::<52>(self.integers())))
    }

    /// As [`math::split`].
    #[inline(always)]
    fn parts(self) -> (Self, Self) {
        let splat = |bits: u64| vector!(_mm256_set1_epi64x(bits as i64));
        let lift = splat(math::ONE_BITS.wrapping_sub(math::SQRT_HALF_BITS));
        let shifted = vector!(_mm256_add_epi64(self.integers(), lift));
        let exponent = vector!(_mm256_srli_epi64::<52>(shifted));
        let exponent = vector!(_mm256_or_si256(exponent, splat(math::TWO_52.to_bits())));
        let fraction = vector!(_mm256_and_si256(shifted, splat(math::SIGNIFICAND)));
        let fraction = vector!(_mm256_add_epi64(fraction, splat(math::SQRT_HALF_BITS)));
        (
            Self::of_integers(exponent) - Self::from(math::TWO_52 + 1023.0),
            Self::of_integers(fraction),
        )
    }

    #[inline(always)]
    fn tests(self, bit: i64) -> Mask4 {
        let bit = vector!(_mm256_set1_epi64x(bit));
        let found = vector!(_mm256_and_si256(self.integers(), bit));
        Mask4(vector!(_mm256_castsi256_pd(_mm256_cmpeq_epi64(found, bit))))
    }
}

impl Mask4 {
    #[inline(always)]
    fn bits(self) -> i32 {
        vector!(_mm256_movemask_pd(self.0))
    }
}

impl fmt::Debug for Mask4 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04b}", self.bits())
    }
}

impl PartialEq for Mask4 {
    fn eq(&self, other: &Self) -> bool {
        self.bits() == other.bits()
    }
}

impl Mask for Mask4 {
    #[inline(always)]
    fn splat(value: bool) -> Self {
        Self(vector!(_mm256_castsi256_pd(_mm256_set1_epi64x(
            -i64::from(value)
        ))))
    }

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> bool) -> Self {
        let bit = |value: bool| -i64::from(value);
        let [a, b, c, d] = [value(0), value(1), value(2), value(3)].map(bit);
        Self(vector!(_mm256_castsi256_pd(_mm256_setr_epi64x(a, b, c, d))))
    }

    #[inline(always)]
    fn lane(self, index: usize) -> bool {
        self.bits() & (1 << index) != 0
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(vector!(_mm256_and_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(vector!(_mm256_or_pd(self.0, other.0)))
    }

    #[inline(always)]
    fn not(self) -> Self {
        Self(vector!(_mm256_xor_pd(self.0, Self::splat(true).0)))
    }

    #[inline(always)]
    fn any(self) -> bool {
        self.bits() != 0
    }

    #[inline(always)]
    fn all(self) -> bool {
        self.bits() == 0b1111
    }
}

/// Eight numbers in a register of AVX-512.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Avx8(__m512d);

bits!(Avx8, Mask8);
register! {
    Avx8, Mask8, f64 x 8, Registers::Avx512, math;
    _mm512_set1_pd
    _mm512_add_pd _mm512_sub_pd _mm512_mul_pd _mm512_div_pd _mm512_fmadd_pd _mm512_sqrt_pd
    _mm512_min_pd _mm512_max_pd
}

impl Avx8 {
    /// Columns of eight rows: pairs of rows, then of pairs, then of fours.
    #[inline(always)]
    fn transposed(rows: &[&[f64; 8]; LANES_MAX]) -> [Self; 8] {
        let mut pairs = [[Self::from(0.0).0; 2]; 4];
        for k in 0..4 {
            // SAFETY: a row is eight numbers, aligned as such.
            let first = vector!(_mm512_loadu_pd(rows[2 * k].as_ptr()));
            let second = vector!(_mm512_loadu_pd(rows[2 * k + 1].as_ptr()));
            pairs[k][0] = vector!(_mm512_unpacklo_pd(first, second));
            pairs[k][1] = vector!(_mm512_unpackhi_pd(first, second));
        }
        let mut columns = [Self::from(0.0); 8];
        for odd in 0..2 {
            let (a, b) = (pairs[0][odd], pairs[1][odd]);
            let (c, d) = (pairs[2][odd], pairs[3][odd]);
            // Columns 0 and 2, then 4 and 6, or those beside.
            let (ab, cd) = vector!((
                _mm512_shuffle_f64x2::<0x44>(a, b),
                _mm512_shuffle_f64x2::<0x44>(c, d)
            ));
            columns[odd] = Self(vector!(_mm512_shuffle_f64x2::<0x88>(ab, cd)));
            columns[odd + 2] = Self(vector!(_mm512_shuffle_f64x2::<0xdd>(ab, cd)));
            let (ab, cd) = vector!((
                _mm512_shuffle_f64x2::<0xee>(a, b),
                _mm512_shuffle_f64x2::<0xee>(c, d)
            ));
            columns[odd + 4] = Self(vector!(_mm512_shuffle_f64x2::<0x88>(ab, cd)));
            columns[odd + 6] = Self(vector!(_mm512_shuffle_f64x2::<0xdd>(ab, cd)));
        }
        columns
    }

    #[inline(always)]
    fn flip(self, bits: Self) -> Self {
        Self(vector!(_mm512_xor_pd(self.0, bits.0)))
    }

    #[inline(always)]
    fn signed(self, sign: Self) -> Self {
        let top = Self::from(-0.0).0;
        let (size, sign) = vector!((_mm512_andnot_pd(top, self.0), _mm512_and_pd(top, sign.0)));
        Self(vector!(_mm512_or_pd(size, sign)))
    }

    #[inline(always)]
    fn rounded_down(self) -> Self {
        const DOWN: i32 = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;
        Self(vector!(_mm512_roundscale_pd::<DOWN>(self.0)))
    }

    #[inline(always)]
    fn compare_less(self, other: Self) -> Mask8 {
        Mask8(vector!(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn compare_less_equal(self, other: Self) -> Mask8 {
        Mask8(vector!(_mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn choose(mask: Mask8, yes: Self, no: Self) -> Self {
        Self(vector!(_mm512_mask_blend_pd(mask.0, no.0, yes.0)))
    }

    #[inline(always)]
    fn integers(self) -> __m512i {
        vector!(_mm512_castpd_si512(self.0))
    }

    #[inline(always)]
    fn of_integers(bits: __m512i) -> Self {
        Self(vector!(_mm512_castsi512_pd(bits)))
    }

    #[inline(always)]
    fn shifted_left_52(self) -> Self {
        Self::of_integers(vector!(_mm512_slli_epi64::<52>(self.integers())))
    }

    /// As [`math::split`].
    #[inline(always)]
    fn parts(self) -> (Self, Self) {
        let splat = |bits: u64| vector!(_mm512_set1_epi64(bits as i64));
        let lift = splat(math::ONE_BITS.wrapping_sub(math::SQRT_HALF_BITS));
        let shifted = vector!(_mm512_add_epi64(self.integers(), lift));
        let exponent = vector!(_mm512_srli_epi64::<52>(shifted));
        let exponent = vector!(_mm512_or_si512(exponent, splat(math::TWO_52.to_bits())));
        let fraction = vector!(_mm512_and_si512(shifted, splat(math::SIGNIFICAND)));
        let fraction = vector!(_mm512_add_epi64(fraction, splat(math::SQRT_HALF_BITS)));
        (
            Self::of_integers(exponent) - Self::from(math::TWO_52 + 1023.0),
            Self::of_integers(fraction),
        )
    }

    #[inline(always)]
    fn tests(self, bit: i64) -> Mask8 {
        let bit = vector!(_mm512_set1_epi64(bit));
        Mask8(vector!(_mm512_test_epi64_mask(self.integers(), bit)))
    }
}

/// Truth values, a bit each.
macro_rules! bit_mask {
    ($(#[$meta:meta])* $mask:ident, $bits:ty, $lanes:literal) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(transparent)]
        pub struct $mask($bits);

        impl Mask for $mask {
            #[inline(always)]
            fn splat(value: bool) -> Self {
                Self(if value { <$bits>::MAX } else { 0 })
            }

            #[inline(always)]
            fn from_lanes(mut value: impl FnMut(usize) -> bool) -> Self {
                let mut bits = 0;
                for i in 0..$lanes {
                    bits |= <$bits>::from(value(i)) << i;
                }
                Self(bits)
            }

            #[inline(always)]
            fn lane(self, index: usize) -> bool {
                self.0 & (1 << index) != 0
            }

            #[inline(always)]
            fn and(self, other: Self) -> Self {
                Self(self.0 & other.0)
            }

            #[inline(always)]
            fn or(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }

            #[inline(always)]
            fn not(self) -> Self {
                Self(!self.0)
            }

            #[inline(always)]
            fn any(self) -> bool {
                self.0 != 0
            }

            #[inline(always)]
            fn all(self) -> bool {
                self.0 == <$bits>::MAX
            }
        }
    };
}

bit_mask!(
    /// Eight truth values.
    Mask8, __mmask8, 8
);

mod narrow;

pub use narrow::{Narrow8, Narrow16};
