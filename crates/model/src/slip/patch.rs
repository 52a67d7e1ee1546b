//! Parts of the ground with friction of their own.

use crate::planar::Vec2;
use crate::scalar::{Mask, Scalar};

/// A part of the ground with a friction coefficient of its own: a rectangle along the world's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch<T> {
    /// Its corner with the smallest coordinates, m.
    pub low: Vec2<T>,
    /// Its corner with the largest, m.
    pub high: Vec2<T>,
    /// Friction coefficient in sliding.
    pub friction: T,
}

impl<T: Scalar> Patch<T> {
    /// Whether a point of the world lies on it.
    #[inline(always)]
    pub fn holds(&self, point: Vec2<T>) -> T::Mask {
        let x = self
            .low
            .x
            .less_equal(point.x)
            .and(point.x.less_equal(self.high.x));
        let y = self
            .low
            .y
            .less_equal(point.y)
            .and(point.y.less_equal(self.high.y));
        x.and(y)
    }
}
