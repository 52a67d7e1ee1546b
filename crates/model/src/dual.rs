//! Dual numbers: a value together with its exact derivatives with respect to `N` inputs.
//!
//! Forward mode. For an input u, x = v + Σ dₖ εₖ with dₖ = ∂x/∂uₖ and εⱼ εₖ = 0. The value has
//! exactly the bits of the run without derivatives, because each rule computes it by the very same
//! operation. Units of a derivative are those of the value over those of the input.
//!
//! Where a function has a corner, the derivative is that of one side or zero, never NaN, as each
//! method says; comparisons and selections go by the value alone.

// Indexed loops throughout: iterator adapters pass closures, which need not be inlined into a caller
// compiled for a wider instruction set.
#![allow(clippy::needless_range_loop)]

use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::scalar::{Registers, Scalar};

/// A number and its derivatives with respect to `N` inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<T, const N: usize> {
    /// The number itself.
    pub value: T,
    /// Its derivative with respect to each input.
    pub derivative: [T; N],
}

impl<T: Scalar, const N: usize> Dual<T, N> {
    /// A constant: all derivatives are zero.
    #[inline(always)]
    pub fn constant(value: T) -> Self {
        Self {
            value,
            derivative: [T::zero(); N],
        }
    }

    /// Input number `index < N`: its derivative with respect to itself is one, to the others zero.
    #[inline(always)]
    pub fn variable(value: T, index: usize) -> Self {
        let mut result = Self::constant(value);
        result.derivative[index] = T::one();
        result
    }

    /// A function of `self` with the given value and slope d(value)/d(self).
    #[inline(always)]
    fn chain(self, value: T, slope: T) -> Self {
        let mut result = Self::constant(value);
        for k in 0..N {
            result.derivative[k] = self.derivative[k] * slope;
        }
        result
    }
}

impl<T: Scalar, const N: usize> From<f64> for Dual<T, N> {
    /// A constant.
    #[inline(always)]
    fn from(value: f64) -> Self {
        Self::constant(T::from(value))
    }
}

impl<T: Scalar, const N: usize> Add for Dual<T, N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let mut result = Self::constant(self.value + other.value);
        for k in 0..N {
            result.derivative[k] = self.derivative[k] + other.derivative[k];
        }
        result
    }
}

impl<T: Scalar, const N: usize> Sub for Dual<T, N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let mut result = Self::constant(self.value - other.value);
        for k in 0..N {
            result.derivative[k] = self.derivative[k] - other.derivative[k];
        }
        result
    }
}

impl<T: Scalar, const N: usize> Mul for Dual<T, N> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let mut result = Self::constant(self.value * other.value);
        for k in 0..N {
            result.derivative[k] =
                self.derivative[k].mul_add(other.value, self.value * other.derivative[k]);
        }
        result
    }
}

impl<T: Scalar, const N: usize> Div for Dual<T, N> {
    type Output = Self;

    #[inline(never)]
    fn div(self, other: Self) -> Self {
        let mut result = Self::constant(self.value / other.value);
        let inverse = T::one() / other.value;
        for k in 0..N {
            result.derivative[k] =
                (-result.value).mul_add(other.derivative[k], self.derivative[k]) * inverse;
        }
        result
    }
}

impl<T: Scalar, const N: usize> Neg for Dual<T, N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let mut result = Self::constant(-self.value);
        for k in 0..N {
            result.derivative[k] = -self.derivative[k];
        }
        result
    }
}

impl<T: Scalar, const N: usize> AddAssign for Dual<T, N> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Scalar, const N: usize> SubAssign for Dual<T, N> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<T: Scalar, const N: usize> MulAssign for Dual<T, N> {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl<T: Scalar, const N: usize> Scalar for Dual<T, N> {
    type Mask = T::Mask;
    type Single = Dual<T::Single, N>;

    const LANES: usize = T::LANES;
    const REGISTERS: Registers = Registers::Unasked;

    #[inline(always)]
    fn from_lanes(value: impl FnMut(usize) -> f64) -> Self {
        Self::constant(T::from_lanes(value))
    }

    #[inline(always)]
    fn lane(self, index: usize) -> f64 {
        self.value.lane(index)
    }

    #[inline(always)]
    fn single(self, index: usize) -> Self::Single {
        let mut result = Dual::constant(self.value.single(index));
        for k in 0..N {
            result.derivative[k] = self.derivative[k].single(index);
        }
        result
    }

    #[inline(always)]
    fn from_singles(mut single: impl FnMut(usize) -> Self::Single) -> Self {
        let mut result = Self::constant(T::from_singles(|i| single(i).value));
        for k in 0..N {
            result.derivative[k] = T::from_singles(|i| single(i).derivative[k]);
        }
        result
    }

    #[inline(never)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        let mut result = Self::constant(self.value.mul_add(a.value, b.value));
        for k in 0..N {
            let scaled = self.value.mul_add(a.derivative[k], b.derivative[k]);
            result.derivative[k] = self.derivative[k].mul_add(a.value, scaled);
        }
        result
    }

    /// The derivative at zero, where the slope is infinite, is zero: so `hypot` has one at rest.
    #[inline(never)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        let slope = T::select(root.less_equal(T::zero()), T::zero(), T::from(0.5) / root);
        self.chain(root, slope)
    }

    #[inline(never)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }

    #[inline(never)]
    fn atan(self) -> Self {
        let slope = T::one() / self.value.mul_add(self.value, T::one());
        self.chain(self.value.atan(), slope)
    }

    /// The derivative at the origin, where there is no direction, is zero. It needs the square of the
    /// radius, hence a radius from 1e-145 to 1e154; the value does not.
    #[inline(never)]
    fn atan2(self, x: Self) -> Self {
        let mut result = Self::constant(self.value.atan2(x.value));
        let square = self.value.mul_add(self.value, x.value * x.value);
        let inverse = T::select(square.less_equal(T::zero()), T::zero(), T::one() / square);
        for k in 0..N {
            let away = self.value * x.derivative[k];
            result.derivative[k] = x.value.mul_add(self.derivative[k], -away) * inverse;
        }
        result
    }

    #[inline(never)]
    fn exp(self) -> Self {
        let exp = self.value.exp();
        self.chain(exp, exp)
    }

    #[inline(never)]
    fn ln(self) -> Self {
        self.chain(self.value.ln(), T::one() / self.value)
    }

    #[inline(never)]
    fn tanh(self) -> Self {
        let tanh = self.value.tanh();
        self.chain(tanh, (-tanh).mul_add(tanh, T::one()))
    }

    /// The derivative is zero, also at the jumps.
    #[inline(always)]
    fn floor(self) -> Self {
        Self::constant(self.value.floor())
    }

    /// The derivative changes sign with the value; that of `sign` has no influence.
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        let slope = T::one().copysign(self.value) * T::one().copysign(sign.value);
        self.chain(self.value.copysign(sign.value), slope)
    }

    /// The derivative at a zero is that of the side its sign names.
    #[inline(always)]
    fn abs(self) -> Self {
        self.chain(self.value.abs(), T::one().copysign(self.value))
    }

    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        self.value.less(other.value)
    }

    #[inline(always)]
    fn less_equal(self, other: Self) -> Self::Mask {
        self.value.less_equal(other.value)
    }

    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.value.is_finite()
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        let mut result = Self::constant(T::select(mask, yes.value, no.value));
        for k in 0..N {
            result.derivative[k] = T::select(mask, yes.derivative[k], no.derivative[k]);
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Lanes;
    use crate::math::{hypot, wrap_angle};
    use crate::scalar::Mask;

    const POINTS: [(f64, f64); 8] = [
        (0.3, 0.7),
        (1.7, 0.4),
        (2.9, -1.3),
        (0.05, 5.0),
        (-0.8, 1.1),
        (-2.4, -0.6),
        (4.3, 1.3),
        (0.9, 1e-3),
    ];

    /// An equation of two inputs, for plain, dual and lane numbers alike.
    trait Equation {
        fn evaluate<T: Scalar>(x: T, y: T) -> T;
    }

    /// Value bits equal to the plain run, derivatives equal to central differences, and both equal in
    /// lanes of duals.
    fn check<E: Equation>(name: &str, points: &[(f64, f64)]) {
        for &(x, y) in points {
            let dual = E::evaluate(Dual::<f64, 2>::variable(x, 0), Dual::variable(y, 1));
            let plain = E::evaluate(x, y);
            assert_eq!(dual.value.to_bits(), plain.to_bits(), "{name}({x}, {y})");
            assert!(plain.is_finite(), "{name}({x}, {y}) is not in the domain");

            // Truncation h² f‴/6 is below 2e-9 of the scale, as the third derivatives are below 100
            // where h = 1e-5; rounding ε f/h is below 1e-11 (1 + f/x), hence the form of the scale.
            let (hx, hy) = (1e-5 * x.abs().min(1.0), 1e-5 * y.abs().min(1.0));
            let differences = [
                (E::evaluate(x + hx, y) - E::evaluate(x - hx, y)) / (2.0 * hx),
                (E::evaluate(x, y + hy) - E::evaluate(x, y - hy)) / (2.0 * hy),
            ];
            for k in 0..2 {
                let scale = 1.0 + dual.derivative[k].abs() + plain.abs() / [x, y][k].abs();
                let error = (dual.derivative[k] - differences[k]).abs() / scale;
                assert!(error < 2e-9, "{name}({x}, {y}), input {k}: {error:e}");
            }
        }

        type Wide = Dual<Lanes<4>, 2>;
        for chunk in points.chunks_exact(4) {
            let x = Wide::variable(Lanes::from_lanes(|i| chunk[i].0), 0);
            let y = Wide::variable(Lanes::from_lanes(|i| chunk[i].1), 1);
            let wide = E::evaluate(x, y);
            for (i, &(x, y)) in chunk.iter().enumerate() {
                let dual = E::evaluate(Dual::<f64, 2>::variable(x, 0), Dual::variable(y, 1));
                assert_eq!(wide.lane(i).to_bits(), dual.value.to_bits(), "{name}");
                for k in 0..2 {
                    let (lane, plain) = (wide.derivative[k].lane(i), dual.derivative[k]);
                    assert_eq!(lane.to_bits(), plain.to_bits(), "{name}, input {k}");
                }
            }
        }
    }

    macro_rules! check_each {
        ($points:expr; $($name:literal: |$x:ident, $y:ident| $value:expr;)*) => {$({
            struct This;
            impl Equation for This {
                fn evaluate<T: Scalar>($x: T, $y: T) -> T {
                    $value
                }
            }
            check::<This>($name, &$points);
        })*};
    }

    #[test]
    fn invariant_derivative_equals_difference() {
        check_each! { POINTS;
            "+": |x, y| x + y;
            "-": |x, y| x - y;
            "*": |x, y| x * y;
            "/": |x, y| x / y;
            "+=": |x, y| { let mut z = x; z += y; z };
            "-=": |x, y| { let mut z = x; z -= y; z };
            "*=": |x, y| { let mut z = x; z *= y; z };
            "neg": |x, y| -(x * y);
            "constant": |x, y| x * T::from(3.0) + y / T::from(7.0);
            "mul_add": |x, y| x.mul_add(y, x * x);
            "sin": |x, y| (x * y).sin_cos().0;
            "cos": |x, y| (x * y).sin_cos().1;
            "atan": |x, y| (x * y).atan();
            "atan2": |x, y| x.atan2(y);
            "atan2, second": |x, y| y.atan2(x * x);
            "exp": |x, y| (x - y).exp();
            "tanh": |x, y| (x * y).tanh();
            "floor": |x, y| x.floor() * y;
            "copysign": |x, y| x.copysign(y);
            "abs": |x, y| x.abs() * y.abs();
            "min": |x, y| x.min(y);
            "max": |x, y| x.max(y);
            "select": |x, y| T::select(x.less(y), x * x, y * y);
            "wrap_angle": |x, y| wrap_angle(x + y);
            "hypot": |x, y| hypot(x, y);
            "composed": |x, y| (x.sin_cos().1 * y + x.tanh()).atan2(hypot(x, y).exp());
            "sqrt": |x, y| (x * x + y.abs()).sqrt();
            "ln": |x, y| (x * x + y.abs()).ln();
        }
    }

    /// The corners named in the documentation: finite everywhere.
    #[test]
    fn closed_form_corners() {
        type D = Dual<f64, 2>;
        let zero = (D::variable(0.0, 0), D::variable(0.0, 1));
        assert_eq!(zero.0.sqrt().derivative, [0.0, 0.0]);
        assert_eq!(hypot(zero.0, zero.1).derivative, [0.0, 0.0]);
        assert_eq!(zero.0.atan2(zero.1).derivative, [0.0, 0.0]);
        assert_eq!(zero.0.abs().derivative, [1.0, 0.0]);
        assert_eq!((-zero.0).abs().derivative, [1.0, 0.0]);
        assert_eq!(D::variable(2.0, 0).floor().derivative, [0.0, 0.0]);
        // At a tie the receiver is kept, with its derivative.
        assert_eq!(zero.0.max(zero.1).derivative, [1.0, 0.0]);
        assert_eq!(zero.1.min(zero.0).derivative, [0.0, 1.0]);
    }

    /// What is not selected has no influence, so NaN behind a mask stays there.
    #[test]
    fn invariant_select_keeps_nan_out() {
        type D = Dual<f64, 1>;
        let bad = D::variable(-1.0, 0).ln() * D::from(f64::NAN);
        let good = D::variable(2.0, 0);
        assert_eq!(D::select(good.is_finite(), good, bad), good);
        assert!(!bad.is_finite() && good.less_equal(good).all());
    }
}
