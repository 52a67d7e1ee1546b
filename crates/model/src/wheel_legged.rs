//! A wheel-legged robot with front and rear leg systems that steer: motion of its center of mass.
//!
//! After X.-Y. Feng and H.-Q. Guo, *Kinematic analysis of wheel-legged mobile robot based on the
//! uneven terrain*, J. Eng. Heilongjiang Univ. 6(4), 2015, equations (1)–(6), whose formulas were
//! reconstructed. B is the middle of the rear axle, A that of the front axle, O₂ the center of mass
//! between them; left and right wheels of a leg system steer alike. Wheels roll without slip.
//! Angles from the body's x-axis, counter-clockwise. `[eq:wheel-legged]`

pub mod obstacle;

use crate::dynamics::{Dynamics, Sizes};
use crate::planar::{Vec2, vec2};
use crate::scalar::Scalar;

/// What is made of the rear steering angle β.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RearSteering {
    /// It counts as it is, equation (2).
    Exact,
    /// It is small and left out, equations (3) to (6). The yaw rate errs by V_B |β|/(l₁ + l₂) to first
    /// order, so the angle must be small beside tan α, not only beside 1.
    Neglected,
}

/// The robot as the plane sees it.
///
/// State: x, y of O₂ in the world, m; heading θ, rad. Input: V_B, the speed of the rear axle along
/// its wheels, m/s; α, β, steering angles of front and rear, rad, |α| < π/2. Output: x, y of B in the
/// world, m; the velocity of O₂ in the base frame, m/s; yaw rate, rad/s; V_A, the speed of the front
/// axle along its wheels, m/s.
#[derive(Clone, Copy, Debug)]
pub struct WheelLegged<T> {
    /// Distance l₁ from the center of mass ahead to the front axle, m.
    pub front: T,
    /// Distance l₂ from the center of mass back to the rear axle, m.
    pub rear: T,
    /// What is made of β.
    pub rear_steering: RearSteering,
}

impl<T: Scalar> WheelLegged<T> {
    /// Yaw rate, rad/s, and sine and cosine of β, as far as it counts: the part of (2) that all else
    /// follows from, V_B (tan α cos β − sin β)/(l₁ + l₂) = V_B sin(α − β)/((l₁ + l₂) cos α).
    #[inline(always)]
    fn turn(&self, u: &[T]) -> (T, T, T) {
        let (sin_front, cos_front) = u[1].sin_cos();
        let (sin, cos) = match self.rear_steering {
            RearSteering::Exact => u[2].sin_cos(),
            RearSteering::Neglected => (T::zero(), T::one()),
        };
        let across = sin_front * cos - cos_front * sin;
        let base = self.front + self.rear;
        (u[0] * across / (base * cos_front), sin, cos)
    }

    /// Velocity of the center of mass, base frame, m/s, and yaw rate, rad/s, for V_B, m/s, α and β,
    /// rad. Equation (2).
    #[inline(always)]
    pub fn twist(&self, speed: T, front: T, rear: T) -> (Vec2<T>, T) {
        let (yaw_rate, sin, cos) = self.turn(&[speed, front, rear]);
        let across = self.rear.mul_add(yaw_rate, speed * sin);
        (vec2(speed * cos, across), yaw_rate)
    }

    /// Yaw acceleration, rad/s², for V_B, α and β and their rates, m/s², rad/s. Equation (5) is the
    /// case β = 0.
    #[inline(always)]
    pub fn yaw_acceleration(&self, inputs: [T; 3], rates: [T; 3]) -> T {
        let [speed, front, rear] = inputs;
        let (sin_front, cos_front) = front.sin_cos();
        let ((sin, cos), rear_rate) = match self.rear_steering {
            RearSteering::Exact => (rear.sin_cos(), rates[2]),
            RearSteering::Neglected => ((T::zero(), T::one()), T::zero()),
        };
        let tan = sin_front / cos_front;
        let along = rates[0] * (tan * cos - sin);
        let turned = rates[1] * cos / (cos_front * cos_front) - rear_rate * tan.mul_add(sin, cos);
        speed.mul_add(turned, along) / (self.front + self.rear)
    }

    /// Side speed of the rear axle, m/s, at a heading and rates (ẋ, ẏ, θ̇) of the center of mass, world
    /// frame: zero where β is, which is the constraint (4), and V_B sin β otherwise.
    #[inline(always)]
    pub fn rear_side_speed(&self, heading: T, rates: [T; 3]) -> T {
        let (sin, cos) = heading.sin_cos();
        rates[1] * cos - rates[0] * sin - self.rear * rates[2]
    }
}

impl<T: Scalar> Dynamics<T> for WheelLegged<T> {
    fn sizes(&self) -> Sizes {
        Sizes {
            state: 3,
            input: 3,
            output: 6,
            mode: 0,
            guards: 0,
        }
    }

    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], _mode: &[T], dx: &mut [T]) {
        let (velocity, yaw_rate) = self.twist(u[0], u[1], u[2]);
        let (sin, cos) = x[2].sin_cos();
        let world = velocity.rotated(cos, sin);
        dx[0] = world.x;
        dx[1] = world.y;
        dx[2] = yaw_rate;
    }

    fn output(&self, x: &[T], u: &[T], _mode: &[T], y: &mut [T]) {
        let (velocity, yaw_rate) = self.twist(u[0], u[1], u[2]);
        let (sin, cos) = x[2].sin_cos();
        y[0] = x[0] - self.rear * cos;
        y[1] = x[1] - self.rear * sin;
        y[2] = velocity.x;
        y[3] = velocity.y;
        y[4] = yaw_rate;
        // Both axles have the same speed along the body, which is rigid.
        let (_, _, cos_rear) = self.turn(u);
        y[5] = u[0] * cos_rear / u[1].sin_cos().1;
    }

    fn decide(&self, _x: &[T], _u: &[T], _mode: &mut [T]) {}
    fn settle(&self, _x: &mut [T], _u: &[T], _mode: &mut [T]) {}
    fn guards(&self, _x: &[T], _u: &[T], _mode: &[T], _g: &mut [T]) {}
}
