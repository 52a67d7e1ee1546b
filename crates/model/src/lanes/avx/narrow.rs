//! Lanes of single precision: twice as many in a register.

use super::*;
use crate::lanes::narrow::{Bits as NarrowBits, Halves, halves};

/// Columns of rows, by halves in double precision.
#[inline(always)]
fn by_halves<T: Halves>(rows: &[&[f64; 8]; LANES_MAX]) -> [T; 8] {
    let mut after = *rows;
    after.copy_within(<T::Wide as Scalar>::LANES.., 0);
    let (low, high) = (T::Wide::columns(rows), T::Wide::columns(&after));
    let mut columns = [T::zero(); 8];
    for k in 0..8 {
        columns[k] = T::narrowed([low[k], high[k]]);
    }
    columns
}

bit_mask!(
    /// Sixteen truth values.
    NarrowMask16, __mmask16, 16
);

bit_mask!(
    /// Eight truth values, apart from their numbers: AVX2 has no register for them.
    NarrowMask8, u8, 8
);

/// Eight numbers in a register of AVX2.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Narrow8(__m256);

register! {
    Narrow8, NarrowMask8, f32 x 8, Registers::Avx2, halves;
    _mm256_set1_ps
    _mm256_add_ps _mm256_sub_ps _mm256_mul_ps _mm256_div_ps _mm256_fmadd_ps _mm256_sqrt_ps
    _mm256_min_ps _mm256_max_ps
}

impl Narrow8 {
    #[inline(always)]
    fn transposed(rows: &[&[f64; 8]; LANES_MAX]) -> [Self; 8] {
        by_halves(rows)
    }

    #[inline(always)]
    fn flip(self, bits: Self) -> Self {
        Self(vector!(_mm256_xor_ps(self.0, bits.0)))
    }

    #[inline(always)]
    fn signed(self, sign: Self) -> Self {
        let top = Self::from(-0.0).0;
        let (size, sign) = vector!((_mm256_andnot_ps(top, self.0), _mm256_and_ps(top, sign.0)));
        Self(vector!(_mm256_or_ps(size, sign)))
    }

    #[inline(always)]
    fn rounded_down(self) -> Self {
        Self(vector!(_mm256_floor_ps(self.0)))
    }

    /// From 32 equal bits for each truth value.
    #[inline(always)]
    fn found(lanes: __m256) -> NarrowMask8 {
        NarrowMask8(vector!(_mm256_movemask_ps(lanes)) as u8)
    }

    #[inline(always)]
    fn compare_less(self, other: Self) -> NarrowMask8 {
        Self::found(vector!(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn compare_less_equal(self, other: Self) -> NarrowMask8 {
        Self::found(vector!(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn choose(mask: NarrowMask8, yes: Self, no: Self) -> Self {
        let bit = vector!(_mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128));
        let all = vector!(_mm256_set1_epi32(i32::from(mask.0)));
        let lanes = vector!(_mm256_cmpeq_epi32(_mm256_and_si256(all, bit), bit));
        Self(vector!(_mm256_blendv_ps(
            no.0,
            yes.0,
            _mm256_castsi256_ps(lanes)
        )))
    }
}

impl NarrowBits for Narrow8 {
    #[inline(always)]
    fn has_bit(self, index: u32) -> NarrowMask8 {
        let bit = vector!(_mm256_set1_epi32(1 << index));
        let bits = vector!(_mm256_castps_si256(self.0));
        let found = vector!(_mm256_cmpeq_epi32(_mm256_and_si256(bits, bit), bit));
        Self::found(vector!(_mm256_castsi256_ps(found)))
    }
}

impl Halves for Narrow8 {
    type Wide = Avx4;

    #[inline(always)]
    fn widened(self) -> [Avx4; 2] {
        let high = vector!(_mm256_extractf128_ps::<1>(self.0));
        let low = vector!(_mm256_castps256_ps128(self.0));
        [low, high].map(|half| Avx4(vector!(_mm256_cvtps_pd(half))))
    }

    #[inline(always)]
    fn narrowed([low, high]: [Avx4; 2]) -> Self {
        let low = vector!(_mm256_castps128_ps256(_mm256_cvtpd_ps(low.0)));
        Self(vector!(_mm256_insertf128_ps::<1>(
            low,
            _mm256_cvtpd_ps(high.0)
        )))
    }
}

/// Sixteen numbers in a register of AVX-512.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Narrow16(__m512);

register! {
    Narrow16, NarrowMask16, f32 x 16, Registers::Avx512, halves;
    _mm512_set1_ps
    _mm512_add_ps _mm512_sub_ps _mm512_mul_ps _mm512_div_ps _mm512_fmadd_ps _mm512_sqrt_ps
    _mm512_min_ps _mm512_max_ps
}

impl Narrow16 {
    #[inline(always)]
    fn transposed(rows: &[&[f64; 8]; LANES_MAX]) -> [Self; 8] {
        by_halves(rows)
    }

    #[inline(always)]
    fn flip(self, bits: Self) -> Self {
        Self(vector!(_mm512_xor_ps(self.0, bits.0)))
    }

    #[inline(always)]
    fn signed(self, sign: Self) -> Self {
        let top = Self::from(-0.0).0;
        let (size, sign) = vector!((_mm512_andnot_ps(top, self.0), _mm512_and_ps(top, sign.0)));
        Self(vector!(_mm512_or_ps(size, sign)))
    }

    #[inline(always)]
    fn rounded_down(self) -> Self {
        const DOWN: i32 = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;
        Self(vector!(_mm512_roundscale_ps::<DOWN>(self.0)))
    }

    #[inline(always)]
    fn compare_less(self, other: Self) -> NarrowMask16 {
        NarrowMask16(vector!(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn compare_less_equal(self, other: Self) -> NarrowMask16 {
        NarrowMask16(vector!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0)))
    }

    #[inline(always)]
    fn choose(mask: NarrowMask16, yes: Self, no: Self) -> Self {
        Self(vector!(_mm512_mask_blend_ps(mask.0, no.0, yes.0)))
    }
}

impl NarrowBits for Narrow16 {
    #[inline(always)]
    fn has_bit(self, index: u32) -> NarrowMask16 {
        let bit = vector!(_mm512_set1_epi32(1 << index));
        NarrowMask16(vector!(_mm512_test_epi32_mask(
            _mm512_castps_si512(self.0),
            bit
        )))
    }
}

impl Halves for Narrow16 {
    type Wide = Avx8;

    #[inline(always)]
    fn widened(self) -> [Avx8; 2] {
        let high = vector!(_mm512_extractf32x8_ps::<1>(self.0));
        let low = vector!(_mm512_castps512_ps256(self.0));
        [low, high].map(|half| Avx8(vector!(_mm512_cvtps_pd(half))))
    }

    #[inline(always)]
    fn narrowed([low, high]: [Avx8; 2]) -> Self {
        let low = vector!(_mm512_castps256_ps512(_mm512_cvtpd_ps(low.0)));
        Self(vector!(_mm512_insertf32x8::<1>(
            low,
            _mm512_cvtpd_ps(high.0)
        )))
    }
}
