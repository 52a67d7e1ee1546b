//! Plane vectors, generic in the scalar: world or base frame as the name of the variable says.

use core::ops::{Add, Mul, Neg, Sub};

use crate::scalar::Scalar;

/// A vector of the plane of motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vec2<T> {
    /// Component along x.
    pub x: T,
    /// Component along y.
    pub y: T,
}

/// Shorthand for [`Vec2`].
#[inline(always)]
pub fn vec2<T>(x: T, y: T) -> Vec2<T> {
    Vec2 { x, y }
}

impl<T: Scalar> Vec2<T> {
    /// The zero vector.
    #[inline(always)]
    pub fn zero() -> Self {
        vec2(T::zero(), T::zero())
    }

    /// The unit vector at an angle whose cosine and sine are given.
    #[inline(always)]
    pub fn direction(cos: T, sin: T) -> Self {
        vec2(cos, sin)
    }

    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> T {
        self.x.mul_add(other.x, self.y * other.y)
    }

    /// z-component of the vector product.
    #[inline(always)]
    pub fn cross(self, other: Self) -> T {
        self.x.mul_add(other.y, -(self.y * other.x))
    }

    /// The vector turned by +π/2 (Ω of the book).
    #[inline(always)]
    pub fn perpendicular(self) -> Self {
        vec2(-self.y, self.x)
    }

    /// The vector turned by an angle whose cosine and sine are given.
    #[inline(always)]
    pub fn rotated(self, cos: T, sin: T) -> Self {
        vec2(
            cos.mul_add(self.x, -(sin * self.y)),
            sin.mul_add(self.x, cos * self.y),
        )
    }
}

impl<T: Scalar> Add for Vec2<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        vec2(self.x + other.x, self.y + other.y)
    }
}

impl<T: Scalar> Sub for Vec2<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        vec2(self.x - other.x, self.y - other.y)
    }
}

impl<T: Scalar> Neg for Vec2<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        vec2(-self.x, -self.y)
    }
}

impl<T: Scalar> Mul<T> for Vec2<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: T) -> Self {
        vec2(self.x * factor, self.y * factor)
    }
}
