//! Elementary functions with the same bits on every machine and in every lane.
//!
//! A platform's own sine or exponential differs from the next one's in the last bits, which a long run
//! amplifies; these use only operations that IEEE 754 rounds exactly, in one written order. They are
//! called through [`Scalar`], and each is written once for `f64` and lanes alike, without branches.
//!
//! Coefficients are our own minimax fits (Remez exchange with 200 bits for the relative error of the
//! result; rounded to `f64` from the lowest power upwards, refitting the rest each time, but for the
//! exponential, rounded at once); the error quoted at each is that of the rounded polynomial alone. Two-
//! and three-word constants are the number split into `f64`s whose sum has 106 or 159 bits.
//!
//! NaN in gives NaN out, of unspecified sign and payload.

use core::f64::consts::{FRAC_2_PI, FRAC_PI_2, LN_2, LOG2_E, PI, TAU};

use crate::scalar::{Mask, Scalar};

/// Largest magnitude of an angle that [`Scalar::sin_cos`] and [`wrap_angle`] take, rad.
///
/// Neighboring `f64`s are 0.125 rad apart there. Beyond it both give NaN: a heading of that size is
/// an error elsewhere, and a made-up direction would hide it.
pub const ANGLE_MAX: f64 = 1e15;

/// What the elementary functions need to know of the binary form of a number.
pub(crate) trait Bits: Scalar {
    /// 2ⁿ for integral n in [-1022, 1023].
    fn power_of_two(self) -> Self;

    /// Exponent k and fraction f in [√½, √2) with x = 2ᵏ f, for positive normal x.
    fn split(self) -> (Self, Self);

    /// Whether bit `index` of the significand is set; after adding [`ROUND`], that of the integer.
    fn has_bit(self, index: u32) -> Self::Mask;
}

/// Adding and subtracting 1.5 · 2⁵² rounds to an integer, ties to even, for magnitudes up to 2⁵¹;
/// in between, the low bits hold that integer in two's complement.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// Binary form of [`core::f64::consts::FRAC_1_SQRT_2`], the start of the interval of [`Bits::split`].
pub(crate) const SQRT_HALF_BITS: u64 = 0x3fe6_a09e_667f_3bcd;

/// Binary form of 1.
pub(crate) const ONE_BITS: u64 = 0x3ff0_0000_0000_0000;

/// Bits of the significand.
pub(crate) const SIGNIFICAND: u64 = 0x000f_ffff_ffff_ffff;

/// 2⁵²: an integer below it, placed in the significand of this number, is added to it.
pub(crate) const TWO_52: f64 = 4_503_599_627_370_496.0;

/// [`Bits::power_of_two`] of one lane.
#[inline(always)]
pub(crate) fn power_of_two(n: f64) -> f64 {
    // The sum holds the biased exponent in its lowest bits; the shift drops all others.
    f64::from_bits((n + (TWO_52 + 1023.0)).to_bits() << 52)
}

/// [`Bits::split`] of one lane.
#[inline(always)]
pub(crate) fn split(x: f64) -> (f64, f64) {
    // Shifted so that a significand below that of √½ borrows from the exponent. The exponent becomes a
    // number through the significand of 2⁵², as lanes have no conversion from 64-bit integers.
    let shifted = x.to_bits().wrapping_add(ONE_BITS - SQRT_HALF_BITS);
    let exponent = f64::from_bits((shifted >> 52) | TWO_52.to_bits()) - (TWO_52 + 1023.0);
    let fraction = f64::from_bits((shifted & SIGNIFICAND).wrapping_add(SQRT_HALF_BITS));
    (exponent, fraction)
}

/// [`Bits::has_bit`] of one lane.
#[inline(always)]
pub(crate) fn has_bit(x: f64, index: u32) -> bool {
    x.to_bits() & (1 << index) != 0
}

impl Bits for f64 {
    #[inline(always)]
    fn power_of_two(self) -> Self {
        power_of_two(self)
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        split(self)
    }

    #[inline(always)]
    fn has_bit(self, index: u32) -> bool {
        has_bit(self, index)
    }
}

/// c₀ + c₁ x + c₂ x² + …, lowest power first, by fused steps.
///
/// A macro, since a loop over the coefficients may stay a loop and then keeps lanes out of registers.
macro_rules! polynomial {
    ($t:ty, $x:expr; $c:expr $(,)?) => { <$t>::from($c) };
    ($t:ty, $x:expr; $c:expr, $($rest:expr),+ $(,)?) => {
        polynomial!($t, $x; $($rest),+).mul_add($x, <$t>::from($c))
    };
}

/// π/2 in three words, the last two positive so that a zero keeps its sign.
const FRAC_PI_2_WORDS: [f64; 3] = [
    FRAC_PI_2,
    6.123_233_995_736_765e-17,
    1.082_856_673_921_913_9e-32,
];

/// See [`Scalar::sin_cos`].
#[inline(always)]
pub(crate) fn sin_cos<T: Bits>(x: T) -> (T, T) {
    let x = T::select(x.abs().less_equal(T::from(ANGLE_MAX)), x, T::from(f64::NAN));

    // x = q π/2 + r. The first step is exact: x and q times the first word are multiples of 2⁻⁵², so
    // r < 1 fits 53 bits; and where |x| < 1 is a finer multiple, the two are within a factor of two. The
    // second rounds once; the third counts only for an r that is tiny or a q that is huge.
    let shifted = x.mul_add(T::from(FRAC_2_PI), T::from(ROUND));
    let q = -(shifted - T::from(ROUND));
    let r = q.mul_add(T::from(FRAC_PI_2_WORDS[0]), x);
    let r = q.mul_add(T::from(FRAC_PI_2_WORDS[1]), r);
    let r = q.mul_add(T::from(FRAC_PI_2_WORDS[2]), r);
    let r2 = r * r;

    // (sin r - r) / r³, |r| ≤ π/4; relative error of the sine 3.8e-18.
    let s = polynomial!(T, r2;
        -0.166_666_666_666_666_3, 0.008_333_333_333_321_84, -0.000_198_412_698_293_585_28,
        2.755_731_353_851_322_6e-6, -2.505_073_438_884_790_6e-8, 1.589_543_324_832_83e-10);
    // (cos r - 1) / r², |r| ≤ π/4, the first coefficient held; relative error of the cosine 5.7e-20.
    let c = polynomial!(T, r2;
        -0.5, 0.041_666_666_666_666_595, -0.001_388_888_888_887_334, 2.480_158_728_899_980_2e-5,
        -2.755_731_421_618_240_4e-7, 2.087_570_525_814_782_6e-9, -1.135_874_117_544_938_3e-11);
    // The sign is copied because -0 plus a positive zero is +0.
    let sin = (r2 * r).mul_add(s, r).copysign(r);
    let cos = r2.mul_add(c, T::one());

    let next = shifted + T::one();
    quarters(
        shifted.has_bit(0),
        [shifted.has_bit(1), next.has_bit(1)],
        (sin, cos),
    )
}

/// Sine and cosine of an angle from those of what is left of it after whole quarters of a turn: whether these
/// are odd in number, and whether sine and cosine are negative in the quarter that they lead to.
#[inline(always)]
pub(crate) fn quarters<T: Scalar>(
    odd: T::Mask,
    [sin_negative, cos_negative]: [T::Mask; 2],
    (sin, cos): (T, T),
) -> (T, T) {
    let (sin, cos) = (T::select(odd, cos, sin), T::select(odd, sin, cos));
    (
        T::select(sin_negative, -sin, sin),
        T::select(cos_negative, -cos, cos),
    )
}

/// atan u + correction, for u in [0, 1] and a correction below a unit in the last place of π.
///
/// The correction joins the small terms, where its rounding costs nothing.
#[inline(always)]
fn atan_unit<T: Bits>(u: T, correction: T) -> T {
    let u2 = u * u;
    let u4 = u2 * u2;
    // (atan u - u) / u³, as even and odd half to shorten the chain; relative error of atan 7.0e-18.
    let even = polynomial!(T, u4;
        -0.333_333_333_333_330_7, -0.142_857_142_825_828, -0.090_909_069_997_692_85,
        -0.066_664_032_661_380_88, -0.052_534_877_427_896_524, -0.042_188_317_119_929_3,
        -0.029_890_562_871_939_09, -0.013_882_961_735_293_55, -0.002_877_742_478_358_756_2,
        -0.000_151_556_060_580_617_33);
    let odd = polynomial!(T, u4;
        0.199_999_999_999_517_48, 0.111_111_110_070_287_33, 0.076_922_797_697_607_4,
        0.058_805_219_403_052_86, 0.047_222_031_562_025_01, 0.036_634_163_906_293_35,
        0.021_967_323_972_363_787, 0.007_183_294_091_368_707_5, 0.000_828_657_428_005_636_7,
        1.316_177_915_703_19e-5);
    u + (u2 * u).mul_add(odd.mul_add(u2, even), correction)
}

/// Second word of π/2; the first is [`FRAC_PI_2`].
const FRAC_PI_2_LOW: f64 = 6.123_233_995_736_766e-17;

/// See [`Scalar::atan`].
#[inline(always)]
pub(crate) fn atan<T: Bits>(x: T) -> T {
    // atan x = π/2 - atan(1/x) beyond 1.
    let magnitude = x.abs();
    let steep = T::one().less(magnitude);
    let slope = T::select(steep, T::one() / magnitude, magnitude);
    let correction = T::select(steep, T::from(-FRAC_PI_2_LOW), T::zero());
    let angle = atan_unit(slope, correction);
    T::select(steep, T::from(FRAC_PI_2) - angle, angle).copysign(x)
}

/// See [`Scalar::atan2`].
#[inline(always)]
pub(crate) fn atan2<T: Bits>(y: T, x: T) -> T {
    let (zero, one) = (T::zero(), T::one());
    let (y_abs, x_abs) = (y.abs(), x.abs());
    let steep = x_abs.less(y_abs);
    let (small, large) = (
        T::select(steep, x_abs, y_abs),
        T::select(steep, y_abs, x_abs),
    );
    // 0/0 counts as 0 and ∞/∞ as 1, as IEEE 754 asks; comparisons are false for NaN, which stays.
    let slope = small / T::select(large.less_equal(zero), one, large);
    let infinity = T::from(f64::INFINITY);
    let both_infinite = infinity.less_equal(small).and(infinity.less_equal(large));
    let slope = T::select(both_infinite, one, slope);

    // From the nearest axis: 0 + a, π - a, π/2 - a or π/2 + a. A negative zero in `x` is behind.
    let side = one.copysign(x);
    let quarters = T::select(steep, one, one - side);
    let sense = T::select(steep, -side, side);
    let angle = atan_unit(slope, sense * quarters * T::from(FRAC_PI_2_LOW));
    quarters
        .mul_add(T::from(FRAC_PI_2), sense * angle)
        .copysign(y)
}

/// ln 2 in two words; the first is [`LN_2`].
const LN_2_LOW: f64 = 2.319_046_813_846_299_7e-17;

/// Integral n and eʳ - 1 with x = n ln 2 + r, |r| ≤ ½ ln 2, for |x| < 2⁵⁰.
#[inline(always)]
fn exp_parts<T: Bits>(x: T) -> (T, T) {
    // The first step is exact, as in `sin_cos`, and what the second rounds away comes back below.
    let n = x.mul_add(T::from(LOG2_E), T::from(ROUND)) - T::from(ROUND);
    let r_high = (-n).mul_add(T::from(LN_2), x);
    let r = (-n).mul_add(T::from(LN_2_LOW), r_high);
    let excess = n.mul_add(T::from(LN_2_LOW), r - r_high);
    let r2 = r * r;
    // (eʳ - 1 - r) / r², |r| ≤ ½ ln 2, as even and odd half; error of eʳ - 1 relative to r 6.3e-19.
    let even = polynomial!(T, r2;
        0.5, 0.041_666_666_666_666_7, 0.001_388_888_888_886_689_5, 2.480_158_736_046_48e-5,
        2.755_724_282_577_929_3e-7, 2.092_442_550_928_039e-9);
    let odd = polynomial!(T, r2;
        0.166_666_666_666_666_77, 0.008_333_333_333_321_648, 0.000_198_412_698_860_858_34,
        2.755_724_424_917_267e-6, 2.510_902_306_149_372_3e-8);
    // A difference, since the compiler pairs the operands of a sum of two fused results wrongly over
    // the lanes and leaves half of them scalar.
    (n, r - (-r2).mul_add(odd.mul_add(r, even), excess))
}

/// See [`Scalar::exp`].
#[inline(always)]
pub(crate) fn exp<T: Bits>(x: T) -> T {
    // Outside these bounds the result is 0 or ∞ anyway; a NaN passes, being the receiver.
    let x = x.max(T::from(-746.0)).min(T::from(710.0));
    let (n, growth) = exp_parts(x);
    // Scaled in two halves, since 2ⁿ alone may lie outside the range although the result does not.
    let half = n.mul_add(T::from(0.5), T::from(ROUND)) - T::from(ROUND);
    let scale = half.power_of_two();
    growth.mul_add(scale, scale) * (n - half).power_of_two()
}

/// See [`Scalar::ln`].
#[inline(always)]
pub(crate) fn ln<T: Bits>(x: T) -> T {
    const TWO_54: f64 = 18_014_398_509_481_984.0;
    let subnormal = x.less(T::from(f64::MIN_POSITIVE));
    let (k, f) = T::select(subnormal, x * T::from(TWO_54), x).split();
    let k = k - T::select(subnormal, T::from(54.0), T::zero());

    // With z = f - 1, exact, and s = z / (2 + z): ln f = 2 atanh s, and 2 s = z - s z leaves the
    // rounding of the quotient only in small terms.
    let z = f - T::one();
    let s = z / (z + T::from(2.0));
    let s2 = s * s;
    // (2 atanh s - 2 s) / s³, |s| ≤ (√2 - 1)²; relative error of the logarithm 1.2e-18.
    let q = polynomial!(T, s2;
        0.666_666_666_666_673_4, 0.399_999_999_994_165_3, 0.285_714_287_420_692_9,
        0.222_221_985_995_449_2, 0.181_835_631_932_006_41, 0.153_140_748_598_646_2,
        0.147_957_442_698_971_82);
    let ln_f = (-s).mul_add((-s2).mul_add(q, z), z);
    let ln_x = k.mul_add(T::from(LN_2), k.mul_add(T::from(LN_2_LOW), ln_f));

    // Infinity and NaN are their own logarithms.
    let ln_x = T::select(x.less(T::from(f64::INFINITY)), ln_x, x);
    let ln_x = T::select(x.less_equal(T::zero()), T::from(f64::NEG_INFINITY), ln_x);
    T::select(x.less(T::zero()), T::from(f64::NAN), ln_x)
}

/// See [`Scalar::tanh`].
#[inline(always)]
pub(crate) fn tanh<T: Bits>(x: T) -> T {
    // |tanh x| = |g / (g + 2)| with g = exp(±2 x) - 1, which keeps the digits of a small x. With y < 0
    // g does not lose digits where it is small, with y > 0 the quotient does not where it is near 1,
    // which is what it rounds to from |x| = 20 on.
    let y = (x.abs() + x.abs()).min(T::from(40.0));
    let (n, growth) = exp_parts(T::select(y.less(T::one()), -y, y));
    let scale = n.power_of_two();
    let g = growth.mul_add(scale, scale - T::one());
    (g / (g + T::from(2.0))).copysign(x)
}

/// Second word of 2π; the first is [`TAU`].
const TAU_LOW: f64 = 2.449_293_598_294_706_4e-16;

/// The angle `a`, rad, less whole turns, in (-π, π].
///
/// An angle inside is unchanged to the bit, and `-PI` becomes `PI`. Elsewhere the error is below
/// 4.8e-16 rad, one unit in the last place of π, for |a| up to [`ANGLE_MAX`]; beyond it the result is
/// NaN. The derivative is one, also at the jump.
#[inline(always)]
pub fn wrap_angle<T: Scalar>(a: T) -> T {
    let (pi, tau) = (T::from(PI), T::from(TAU));
    let inside = a.abs().less_equal(pi);
    let turns = T::select(
        inside,
        T::zero(),
        (a * T::from(1.0 / TAU) + T::from(0.5)).floor(),
    );
    let r = (-turns).mul_add(tau, a);
    let r = (-turns).mul_add(T::from(TAU_LOW), r);
    // The count of turns may be one off at the ends, by its own rounding.
    let r = T::select(pi.less(r), r - tau, r);
    let r = T::select(r.less_equal(-pi), r + tau, r);
    T::select(a.abs().less_equal(T::from(ANGLE_MAX)), r, T::from(f64::NAN))
}

/// √(x² + y²), without guard against overflow.
///
/// Accurate for magnitudes from 1e-145 to 1e154; above, the sum overflows to infinity, and below it
/// underflows and digits are lost.
#[inline(always)]
pub fn hypot<T: Scalar>(x: T, y: T) -> T {
    x.mul_add(x, y * y).sqrt()
}

/// Single calls from outside a step loop.
pub mod single {
    use crate::scalar::Scalar;

    fused! {
        /// Sine and cosine of an angle, rad, as [`Scalar::sin_cos`].
        pub fn sin_cos(angle: f64) -> (f64, f64) {
            Scalar::sin_cos(angle)
        }
    }

    fused! {
        /// Angle of the point (x, y), rad, as [`Scalar::atan2`].
        pub fn atan2(y: f64, x: f64) -> f64 {
            Scalar::atan2(y, x)
        }
    }
}

#[cfg(test)]
#[allow(clippy::disallowed_methods)] // The platform's functions are the peer here.
mod tests {
    use core::f64::consts::FRAC_PI_4;

    use super::*;
    use crate::dual::Dual;

    const INFINITY: f64 = f64::INFINITY;

    /// Equally distributed in [low, high), the same on every machine (64-bit linear congruence).
    fn sample(count: usize, low: f64, high: f64) -> impl Iterator<Item = f64> {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        (0..count).map(move |_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            low + (high - low) * ((state >> 11) as f64 / 9_007_199_254_740_992.0)
        })
    }

    /// Distance in units in the last place of `expected`.
    fn ulps(value: f64, expected: f64) -> f64 {
        if value == expected {
            return 0.0;
        }
        let magnitude = expected.abs();
        (value - expected).abs() / (magnitude.next_up() - magnitude)
    }

    /// Asserts a largest distance from the platform's function over a dense sample.
    fn check(
        name: &str,
        bound: f64,
        range: (f64, f64),
        function: impl Fn(f64) -> f64,
        peer: impl Fn(f64) -> f64,
    ) {
        let (mut worst, mut at) = (0.0, 0.0);
        for x in sample(200_000, range.0, range.1) {
            let distance = ulps(function(x), peer(x));
            assert!(!distance.is_nan(), "{name}({x:e}) is NaN");
            if distance > worst {
                (worst, at) = (distance, x);
            }
        }
        assert!(
            worst <= bound,
            "{name}({at:e}) is {worst:.3} units off, bound {bound}"
        );
    }

    fn sin(x: f64) -> f64 {
        Scalar::sin_cos(x).0
    }

    fn cos(x: f64) -> f64 {
        Scalar::sin_cos(x).1
    }

    /// The error against 160-bit arithmetic, measured offline over 20 000 arguments a range, is at most
    /// 0.82 units for exp, 1.08 for ln, 1.70 for atan, 1.80 for atan2 and 2.14 for tanh. The platform's
    /// own result is rounded to a whole unit, and up to 2 units off itself (tanh): hence the bounds.
    #[test]
    fn peer_elementary_functions() {
        check("exp", 2.0, (-708.0, 709.7), Scalar::exp, f64::exp);
        check("exp", 2.0, (-1.0, 1.0), Scalar::exp, f64::exp);
        check("ln", 2.0, (0.4, 2.5), Scalar::ln, f64::ln);
        check("ln", 2.0, (1e-9, 1e9), Scalar::ln, f64::ln);
        check("atan", 3.0, (-1.2, 1.2), Scalar::atan, f64::atan);
        check("atan", 3.0, (-40.0, 40.0), Scalar::atan, f64::atan);
        check("tanh", 4.0, (-0.6, 0.6), Scalar::tanh, f64::tanh);
        check("tanh", 4.0, (-21.0, 21.0), Scalar::tanh, f64::tanh);
        // Every direction, at radii from 1e-30 to 1e30.
        check(
            "atan2 at angle",
            3.0,
            (-PI, PI),
            |a| Scalar::atan2(1e-30 * sin(a), 1e-30 * cos(a)),
            |a| f64::atan2(1e-30 * sin(a), 1e-30 * cos(a)),
        );
        check(
            "atan2 at angle",
            3.0,
            (-PI, PI),
            |a| Scalar::atan2(1e30 * sin(a), -3.0 * cos(a)),
            |a| f64::atan2(1e30 * sin(a), -3.0 * cos(a)),
        );
    }

    /// Measured offline against 160-bit arithmetic: at most 1.4 units and 1.2e-16 for |x| ≤ 1e9,
    /// near the zeros too, and 2.9 units and 3.2e-16 up to 1e15. The absolute bound adds one rounding
    /// of the peer, 1.1e-16.
    #[test]
    fn peer_sin_cos() {
        for (range, units, absolute) in [
            (FRAC_PI_4, 2.5, 2.3e-16),
            (100.0, 2.5, 2.3e-16),
            (1e5, 2.5, 2.3e-16),
            (1e9, 2.5, 2.3e-16),
            (ANGLE_MAX, 4.0, 4.5e-16),
        ] {
            check("sin", units, (-range, range), sin, f64::sin);
            check("cos", units, (-range, range), cos, f64::cos);
            for x in sample(100_000, -range, range) {
                assert!((sin(x) - x.sin()).abs() <= absolute, "sin({x:e})");
                assert!((cos(x) - x.cos()).abs() <= absolute, "cos({x:e})");
                // Next to the zeros, where only a faithful reduction leaves any digit.
                let near_zero = (x / FRAC_PI_2).round() * FRAC_PI_2;
                if near_zero.abs() <= ANGLE_MAX {
                    assert!(
                        ulps(sin(near_zero), near_zero.sin()) <= units,
                        "sin({near_zero:e})"
                    );
                    assert!(
                        ulps(cos(near_zero), near_zero.cos()) <= units,
                        "cos({near_zero:e})"
                    );
                }
            }
        }
    }

    /// Correctly rounded values from 200-bit arithmetic, at the worst arguments found and at the ends
    /// of the ranges; independent of the platform's functions. Bounds as measured, rounded up.
    #[test]
    #[allow(clippy::type_complexity)]
    fn golden_values() {
        let table: &[(fn(f64) -> f64, f64, f64)] = &[
            (Scalar::exp, 0.35506250457874433, 1.4262697998884646),
            (Scalar::exp, 561.8283584879713, 9.97598685204419e+243),
            (Scalar::exp, -321.2424568751296, 3.0631878172362012e-140),
            (Scalar::exp, -700.25, 7.678723813110872e-305),
            (Scalar::exp, -740.5, 2.5e-322),
            (Scalar::exp, 709.5, 1.3549863193146328e+308),
            (Scalar::exp, 1e-09, 1.000000001),
            (Scalar::ln, 0.7058319088558166, -0.34837815927603843),
            (Scalar::ln, 1.6958275713302267, 0.5281708643534416),
            (Scalar::ln, 0.5999794417805655, -0.5108598880520622),
            (Scalar::ln, 3.4025112673873785e-94, -215.21848497439976),
            (Scalar::ln, 1.0000000001, 1.000000082690371e-10),
            (Scalar::ln, 4e-320, -735.440946529854),
            (Scalar::ln, 1.7e+308, 709.7268368932282),
            (Scalar::atan, -0.9847543665230218, -0.777716944050407),
            (Scalar::atan, 1.0057226558514238, 0.7882513197430137),
            (Scalar::atan, 1.6380963010384986, 1.0227176904243207),
            (Scalar::atan, 1e-09, 1e-09),
            (Scalar::atan, 3e17, FRAC_PI_2),
            (Scalar::tanh, -0.2449067327643515, -0.24012497720834025),
            (Scalar::tanh, 0.19324716616446802, 0.19087699418134813),
            (Scalar::tanh, 3.118391073206408, 0.9960953580697011),
            (Scalar::tanh, 1e-09, 1e-09),
            (Scalar::tanh, -19.0, -0.9999999999999999),
        ];
        for (index, &(function, x, expected)) in table.iter().enumerate() {
            let distance = ulps(function(x), expected);
            assert!(distance <= 2.3, "row {index}, {x:e}: {distance} units");
        }
        for (x, sin_expected, cos_expected) in [
            (0.7922783445427646, 0.7119550294949168, 0.7022250607724649),
            (29.335916646096894, -0.8731281583638151, -0.4874907374219664),
            (-91156.97091414072, -0.49555837662942437, 0.8685746343017448),
            (
                -246368086.27024496,
                0.9999999999999998,
                -2.1479750718317156e-08,
            ),
            (988211107.016563, 9.40861506559227e-08, -0.9999999999999956),
            (PI, 1.2246467991473532e-16, -1.0),
            (1000000000.0, 0.5458434494486996, 0.8378871813639024),
            (-933165272543153.6, 0.6673013265790763, -0.7447878486829689),
            (355.0, -3.014435335948845e-05, -0.999999999545659),
            (
                398872310630943.94,
                -0.9083360235664096,
                -0.41824116044641385,
            ),
        ] {
            assert!(ulps(sin(x), sin_expected) <= 3.0, "sin({x:e})");
            assert!(ulps(cos(x), cos_expected) <= 3.0, "cos({x:e})");
        }
    }

    /// A sum over the bits of a sample of results: the same on every machine and optimization level.
    #[test]
    fn golden_bits() {
        fn digest(function: impl Fn(f64) -> f64, low: f64, high: f64) -> u64 {
            sample(20_000, low, high).fold(0xcbf2_9ce4_8422_2325, |hash: u64, x| {
                (hash ^ function(x).to_bits()).wrapping_mul(0x0000_0100_0000_01b3)
            })
        }
        let digests = [
            digest(sin, -1e6, 1e6),
            digest(cos, -1e6, 1e6),
            digest(Scalar::exp, -750.0, 750.0),
            digest(Scalar::ln, 1e-6, 100.0),
            digest(Scalar::atan, -10.0, 10.0),
            digest(|x| Scalar::atan2(x, 1.0 - x), -10.0, 10.0),
            digest(Scalar::tanh, -5.0, 5.0),
            digest(wrap_angle, -100.0, 100.0),
        ];
        let expected = [
            0x2c1d_5115_97dc_6f87,
            0xcb73_c639_ad9a_305f,
            0x087f_d481_ee2e_1cf0,
            0xf049_b84f_d673_0f07,
            0x4dea_0429_c65f_c985,
            0x4d30_7c35_e552_c4c8,
            0x00be_53f2_757d_88c2,
            0x5d58_1fab_b63a_67f4,
        ];
        assert_eq!(digests, expected, "{digests:#x?}");
    }

    #[test]
    fn closed_form_special_values() {
        fn same(value: f64, expected: f64) {
            let nan = value.is_nan() && expected.is_nan();
            assert!(
                nan || value.to_bits() == expected.to_bits(),
                "{value:e}, expected {expected:e}"
            );
        }
        let nan = f64::NAN;
        for (x, expected) in [
            (0.0, 1.0),
            (-0.0, 1.0),
            (INFINITY, INFINITY),
            (-INFINITY, 0.0),
        ] {
            same(Scalar::exp(x), expected);
        }
        for (x, expected) in [
            (710.0, INFINITY),
            (-746.0, 0.0),
            (1e300, INFINITY),
            (nan, nan),
        ] {
            same(Scalar::exp(x), expected);
        }
        for (x, expected) in [(1.0, 0.0), (0.0, -INFINITY), (-0.0, -INFINITY), (-1.0, nan)] {
            same(Scalar::ln(x), expected);
        }
        for (x, expected) in [(INFINITY, INFINITY), (-INFINITY, nan), (nan, nan)] {
            same(Scalar::ln(x), expected);
        }
        for (x, expected) in [(0.0, 0.0), (-0.0, -0.0), (INFINITY, FRAC_PI_2), (nan, nan)] {
            same(Scalar::atan(x), expected);
            same(Scalar::atan(-x), -expected);
        }
        for (x, expected) in [(0.0, 0.0), (INFINITY, 1.0), (1e300, 1.0), (nan, nan)] {
            same(Scalar::tanh(x), expected);
            same(Scalar::tanh(-x), -expected);
        }
        for (x, sine, cosine) in [(0.0, 0.0, 1.0), (-0.0, -0.0, 1.0), (1e-300, 1e-300, 1.0)] {
            same(sin(x), sine);
            same(cos(x), cosine);
        }
        for x in [INFINITY, -INFINITY, nan, ANGLE_MAX.next_up(), -1e300] {
            same(sin(x), nan);
            same(cos(x), nan);
            same(wrap_angle(x), nan);
        }
    }

    /// All pairs of signs, zeros and infinities, against the table of IEEE 754.
    #[test]
    fn peer_atan2_quadrants() {
        let values = [0.0, 1.0, 2.5, 1e-320, 1e300, INFINITY];
        for y in values.iter().flat_map(|&v| [v, -v]) {
            for x in values.iter().flat_map(|&v| [v, -v]) {
                let (angle, expected) = (Scalar::atan2(y, x), y.atan2(x));
                assert_eq!(
                    angle.is_sign_negative(),
                    expected.is_sign_negative(),
                    "({y:e}, {x:e})"
                );
                assert!(
                    ulps(angle, expected) <= 3.0,
                    "({y:e}, {x:e}): {angle} not {expected}"
                );
            }
            assert!(Scalar::atan2(y, f64::NAN).is_nan() && Scalar::atan2(f64::NAN, y).is_nan());
        }
        assert_eq!(Scalar::atan2(0.0, -1.0), PI);
        assert_eq!(Scalar::atan2(-0.0, -1.0), -PI);
        assert_eq!(Scalar::atan2(3.0, 0.0), FRAC_PI_2);
    }

    /// sin² + cos² = 1 and the quadrants follow each other, also over the seams of the reduction.
    #[test]
    fn invariant_unit_circle_across_the_seams() {
        for turns in [0.0, 1.0, 77.0, 1e5, 1e9, 1e14] {
            for eighth in 0..16 {
                let seam = TAU * turns + FRAC_PI_4 * f64::from(eighth);
                let (mut below, mut above) = (seam, seam);
                for _ in 0..40 {
                    for x in [below, above] {
                        let (s, c) = Scalar::sin_cos(x);
                        // Either is off by at most 3.2e-16, so the sum by √2 · 2 · 3.2e-16.
                        assert!((s * s + c * c - 1.0).abs() < 1e-15, "{x:e}");
                        assert_eq!(sin(-x), -s);
                        assert_eq!(cos(-x), c);
                    }
                    (below, above) = (below.next_down(), above.next_up());
                }
            }
        }
    }

    /// The sine grows with the angle through zero at large arguments: the reduction leaves no step.
    #[test]
    fn invariant_monotone_reduction_of_large_angles() {
        for turns in [1e3, 1e6, 1e9, 1e12] {
            let mut x = f64::round(turns) * TAU;
            let spacing = x.next_up() - x;
            let mut last = sin(x);
            for _ in 0..1000 {
                x = x.next_up();
                let next = sin(x);
                if cos(x) > 0.9 && spacing < 0.1 {
                    // Both ends are off by at most 3.2e-16, against a rise of 0.9 · spacing or more.
                    let rise = next - last;
                    assert!(
                        rise > 0.9 * spacing - 7e-16 && rise < spacing + 7e-16,
                        "{x:e}"
                    );
                }
                last = next;
            }
        }
    }

    #[test]
    fn closed_form_wrap_angle() {
        assert_eq!(wrap_angle(PI), PI);
        assert_eq!(wrap_angle(-PI), PI);
        assert_eq!(wrap_angle(TAU), -TAU_LOW);
        assert_eq!(wrap_angle(PI.next_down()), PI.next_down());
        assert_eq!(wrap_angle(-PI.next_down()), -PI.next_down());
        assert!(wrap_angle(-0.0_f64).is_sign_negative());
        for range in [10.0, 1e3, 1e6, 1e9, ANGLE_MAX] {
            for x in sample(50_000, -range, range) {
                for x in [x, (x / PI).round() * PI, ((x / PI).round() * PI).next_up()] {
                    let x = x.clamp(-ANGLE_MAX, ANGLE_MAX);
                    let wrapped = wrap_angle(x);
                    assert!(-PI < wrapped && wrapped <= PI, "{x:e} gives {wrapped:e}");
                    if x.abs() < PI {
                        assert_eq!(wrapped, x);
                    }
                    // 4.8e-16 of the wrapped angle and twice the error of the sine and cosine.
                    assert!((sin(wrapped) - sin(x)).abs() < 1e-15, "{x:e}");
                    assert!((cos(wrapped) - cos(x)).abs() < 1e-15, "{x:e}");
                }
            }
        }
    }

    /// Also at the jump, where a clamp would lose the derivative.
    #[test]
    fn closed_form_derivative_of_wrap_angle() {
        for angle in [0.0, 3.0, PI, -PI, PI.next_up(), 4.0, -100.0, 1e9] {
            let wrapped = wrap_angle(Dual::<f64, 1>::variable(angle, 0));
            assert_eq!(wrapped.derivative, [1.0], "{angle}");
            assert_eq!(wrapped.value.to_bits(), wrap_angle(angle).to_bits());
        }
    }

    #[test]
    fn closed_form_hypot() {
        assert_eq!(hypot(3.0, 4.0), 5.0);
        assert_eq!(hypot(-0.0, 0.0), 0.0);
        for x in sample(10_000, -5.0, 5.0) {
            // Three roundings of half a unit, of which the first two count half, and the peer's.
            assert!(ulps(hypot(x, 1.5), x.hypot(1.5)) <= 2.0);
        }
    }
}
