//! The ground: flat, or an inclined plane.

use crate::planar::{Vec2, vec2};
use crate::scalar::Scalar;

/// Gravity as a plane of motion sees it: a component in the plane (world frame) and one normal to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground<T> {
    /// In-plane gravity, world frame, m/s².
    pub gravity: Vec2<T>,
    /// Gravity normal to the plane, m/s².
    pub gravity_normal: T,
}

impl<T: Scalar> Ground<T> {
    /// A level floor; `gravity` in m/s².
    pub fn flat(gravity: T) -> Self {
        Ground {
            gravity: Vec2::zero(),
            gravity_normal: gravity,
        }
    }

    /// A plane that falls by `slope` (rad) towards the heading `downhill` (rad, plane frame).
    pub fn plane(gravity: T, slope: T, downhill: T) -> Self {
        let (sin, cos) = slope.sin_cos();
        let (down_sin, down_cos) = downhill.sin_cos();
        Ground {
            gravity: vec2(gravity * sin * down_cos, gravity * sin * down_sin),
            gravity_normal: gravity * cos,
        }
    }
}
