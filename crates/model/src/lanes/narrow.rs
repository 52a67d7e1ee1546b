//! Numbers of single precision: twice as many lanes to a register, and seven digits.
//!
//! Arithmetic is that of `f32`, and so are sine and cosine, of which every step needs one; the other
//! elementary functions are those of `f64`, rounded. The bits are the
//! same on every machine and in every lane here, too, but they are other bits than those of `f64`.

use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::AnyLanes;
use crate::scalar::Scalar;

/// Does a job on at most `lanes` lanes of single precision, as [`super::dispatch`]; there are twice as
/// many as of `f64`.
pub fn dispatch<J: AnyLanes>(lanes: usize, job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    match lanes.min(2 * super::widest()) {
        16.. => job.run::<super::avx::Narrow16>(),
        8.. => job.run::<super::avx::Narrow8>(),
        _ => job.run::<Narrow>(),
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        let _ = lanes;
        job.run::<Narrow>()
    }
}

/// Numbers of single precision that two registers of `f64`s hold exactly.
pub(super) trait Halves: Scalar {
    /// Such a register.
    type Wide: Scalar;
    /// In double precision.
    fn widened(self) -> [Self::Wide; 2];
    /// Rounded to single precision.
    fn narrowed(halves: [Self::Wide; 2]) -> Self;
}

/// Largest magnitude of an angle of which there are sine and cosine, rad: neighboring numbers are 0.06 rad
/// apart there.
pub const ANGLE_MAX: f64 = 1e6;

/// π/2 as three numbers of single precision.
const FRAC_PI_2_WORDS: [f64; 3] = [
    1.570_796_370_506_286_6,
    -4.371_138_828_673_793e-8,
    -1.715_124_510_005_881_9e-15,
];

/// Adding and subtracting 1.5 · 2²³ rounds to an integer, as [`crate::math`] does in double precision.
const ROUND: f64 = 12_582_912.0;

/// What sine and cosine need to know of the binary form of a number.
pub(crate) trait Bits: Scalar {
    /// Whether bit `index` of the significand is set; after adding [`ROUND`], that of the integer.
    fn has_bit(self, index: u32) -> Self::Mask;
}

/// Sine and cosine, to one and a half units in the last place; the steps are those of [`crate::math`], with which
/// they share their reasons.
#[inline(always)]
pub(crate) fn sin_cos<T: Bits>(x: T) -> (T, T) {
    let x = T::select(x.abs().less_equal(T::from(ANGLE_MAX)), x, T::from(f64::NAN));
    let shifted = x.mul_add(T::from(core::f64::consts::FRAC_2_PI), T::from(ROUND));
    let q = -(shifted - T::from(ROUND));
    let r = q.mul_add(T::from(FRAC_PI_2_WORDS[0]), x);
    let r = q.mul_add(T::from(FRAC_PI_2_WORDS[1]), r);
    let r = q.mul_add(T::from(FRAC_PI_2_WORDS[2]), r);
    let r2 = r * r;
    // (sin r - r) / r³, |r| ≤ π/4; relative error of the sine 3.8e-9.
    let s = T::from(-1.951_525e-4).mul_add(r2, T::from(8.332_160_3e-3));
    let s = s.mul_add(r2, T::from(-0.166_666_552));
    // (cos r - 1) / r², the first coefficient held; relative error of the cosine 1.2e-10.
    let c = T::from(2.443_311_9e-5).mul_add(r2, T::from(-1.388_731_65e-3));
    let c = c.mul_add(r2, T::from(0.041_666_645_6));
    let c = c.mul_add(r2, T::from(-0.5));
    let sin = (r2 * r).mul_add(s, r).copysign(r);
    let cos = r2.mul_add(c, T::one());

    let next = shifted + T::one();
    crate::math::quarters(
        shifted.has_bit(0),
        [shifted.has_bit(1), next.has_bit(1)],
        (sin, cos),
    )
}

/// The elementary functions, named as those of [`crate::math`]; all others by way of `f64`.
pub(super) mod halves {
    use super::Halves;
    pub(crate) use super::sin_cos;
    use crate::scalar::Scalar;

    macro_rules! function {
        ($($name:ident)*) => {
            $(#[inline(always)]
            pub fn $name<T: Halves>(x: T) -> T {
                let [low, high] = x.widened();
                T::narrowed([low.$name(), high.$name()])
            })*
        };
    }

    function!(atan exp ln tanh);

    #[inline(always)]
    pub fn atan2<T: Halves>(y: T, x: T) -> T {
        let ([low, high], x) = (y.widened(), x.widened());
        T::narrowed([low.atan2(x[0]), high.atan2(x[1])])
    }
}

/// One number of single precision.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct Narrow(f32);

impl From<f64> for Narrow {
    #[inline(always)]
    fn from(value: f64) -> Self {
        Self(value as f32)
    }
}

macro_rules! operator {
    ($($trait:ident $method:ident $symbol:tt;)*) => {
        $(impl $trait for Narrow {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0 $symbol other.0)
            }
        })*
    };
}

macro_rules! assignment {
    ($($trait:ident $method:ident $symbol:tt;)*) => {
        $(impl $trait for Narrow {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                self.0 $symbol other.0;
            }
        })*
    };
}

operator! { Add add +; Sub sub -; Mul mul *; Div div /; }
assignment! { AddAssign add_assign +=; SubAssign sub_assign -=; MulAssign mul_assign *=; }

impl Neg for Narrow {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

/// Functions of `f64`, rounded.
macro_rules! rounded {
    ($($name:ident)*) => {
        $(#[inline(always)]
        fn $name(self) -> Self {
            Self::from(Scalar::$name(f64::from(self.0)))
        })*
    };
}

impl Bits for Narrow {
    #[inline(always)]
    fn has_bit(self, index: u32) -> bool {
        self.0.to_bits() & (1 << index) != 0
    }
}

impl Scalar for Narrow {
    type Mask = bool;
    type Single = f64;

    const LANES: usize = 1;
    const IS_NARROW: bool = true;

    #[inline(always)]
    fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
        Self::from(value(0))
    }

    #[inline(always)]
    fn lane(self, _index: usize) -> f64 {
        f64::from(self.0)
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
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self(self.0.mul_add(a.0, b.0))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
    }

    rounded!(atan exp ln tanh);

    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        Self::from(Scalar::atan2(f64::from(self.0), f64::from(x.0)))
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.floor())
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Self(self.0.copysign(sign.0))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }

    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self.0 < other.0
    }

    #[inline(always)]
    fn less_equal(self, other: Self) -> bool {
        self.0 <= other.0
    }

    #[inline(always)]
    fn is_finite(self) -> bool {
        self.0.is_finite()
    }

    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scalar::Mask;

    /// Values of either sign over twenty decades, zeros, infinities and NaN.
    fn value(index: usize) -> f64 {
        const SPECIAL: [f64; 8] = [
            0.0,
            -0.0,
            1.0,
            -1.0,
            1e-42,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
        ];
        if index < SPECIAL.len() {
            return SPECIAL[index];
        }
        let part = |step: f64| (index as f64 * step) % 1.0;
        let decade = crate::math::exp(part(0.754_877_666) * 46.0 - 23.0);
        (part(0.569_840_291) - 0.5) * decade
    }

    const COUNT: usize = 320;

    /// What all operations make of many pairs.
    struct All;

    impl AnyLanes for All {
        type Output = Vec<[f64; 22]>;

        fn run<T: Scalar<Single = f64>>(self) -> Self::Output {
            let mut found = vec![[0.0; 22]; COUNT * COUNT];
            for first in (0..COUNT * COUNT).step_by(T::LANES) {
                let x = T::from_lanes(|i| value((first + i) / COUNT));
                let y = T::from_lanes(|i| value((first + i) % COUNT));
                let ((sin, cos), mut sum) = (x.sin_cos(), x);
                sum += y;
                let masks = x
                    .less(y)
                    .or(y.is_finite())
                    .and(x.less_equal(T::zero()).not());
                let all = [
                    x + y,
                    x - y,
                    x * y,
                    x / y,
                    sum,
                    -x,
                    x.mul_add(y, T::from(1.25) - x),
                    x.sqrt(),
                    x.floor(),
                    x.copysign(y),
                    x.abs(),
                    x.min(y),
                    x.max(y),
                    T::select(x.less(y), x, T::one()),
                    T::select(masks, x, y),
                    T::select(x.is_finite(), x, y),
                    sin,
                    cos,
                    x.atan2(y),
                    x.exp(),
                    x.ln(),
                    x.tanh() + x.atan(),
                ];
                for i in 0..T::LANES {
                    found[first + i] = all.map(|value| value.lane(i));
                }
            }
            found
        }
    }

    #[test]
    fn invariant_narrow_lane_equals_plain_run() {
        let plain = dispatch(1, All);
        for lanes in [8, 16] {
            for (at, (a, b)) in dispatch(lanes, All).iter().zip(&plain).enumerate() {
                for (k, (a, b)) in a.iter().zip(b).enumerate() {
                    assert!(
                        a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan(),
                        "x{lanes}, operation {k} of {:e}, {:e}: {a:e}, plain {b:e}",
                        value(at / COUNT),
                        value(at % COUNT)
                    );
                }
            }
        }
    }

    /// Sine and cosine beside those of double precision of the same angle.
    #[test]
    fn peer_narrow_sine_and_cosine_of_double_precision() {
        let mut worst = 0.0_f64;
        for k in 0..400_000 {
            // Near multiples of π/2, and between.
            let angle = match k % 2 {
                0 => f64::from(k) * core::f64::consts::FRAC_PI_4 / 1000.0,
                _ => f64::from(k - 200_000) * 1.1,
            };
            let angle = Narrow::from(angle);
            let (sin, cos) = angle.sin_cos();
            let (exact_sin, exact_cos) = Scalar::sin_cos(angle.lane(0));
            for (got, exact) in [(sin, exact_sin), (cos, exact_cos)] {
                // In units of the last place of the result.
                let unit =
                    f64::from((exact as f32).abs().next_up()) - f64::from((exact as f32).abs());
                worst = worst.max((got.lane(0) - exact).abs() / unit);
            }
        }
        assert!(worst < 1.5, "{worst} units in the last place");
        let (sin, cos) = Narrow::from(1.1 * ANGLE_MAX).sin_cos();
        assert!(sin.lane(0).is_nan() && cos.lane(0).is_nan());
    }

    #[test]
    fn closed_form_narrow_numbers_have_seven_digits() {
        let third = (Narrow::from(1.0) / Narrow::from(3.0)).lane(0);
        assert!((3.0 * third - 1.0).abs() < 6e-8 && (3.0 * third - 1.0).abs() > 1e-9);
    }
}
