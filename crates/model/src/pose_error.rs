//! Pose error of a robot against a moving target, under disturbances of its speeds. `[eq:pose-error]`
//!
//! After X.-Y. Feng and H.-Q. Guo, *Kinematic analysis of wheel-legged mobile robot based on the
//! uneven terrain*, J. Eng. Heilongjiang Univ. 6(4), 2015, equations (7)–(17), with the terms of a
//! reference point off the axle that the published form leaves out, and with integrals in place of
//! products of force and time. Regulation to a target at rest, equation (17), is v₁ = ω₁ = 0 with the
//! reference point on the axle; there d(x_e² + y_e²)/dt = −2 x_e (v + Δv). The side forces that hold
//! the wheels to their direction are not in it: `[eq:disturbance]`.

pub mod excitation;

use crate::dynamics::{Dynamics, Sizes};
use crate::planar::vec2;
use crate::scalar::Scalar;

/// The error of a target's pose in the robot's frame.
///
/// State: x_e, y_e, m; θ_e, rad; Δv, m/s; Δω, rad/s. Input: v, ω of the robot; v₁, ω₁ of the target;
/// F₁ along, F₂ across the motion, N. Output: the robot's v + Δv and ω + Δω.
#[derive(Clone, Copy, Debug)]
pub struct PoseError<T> {
    /// Mass, kg.
    pub mass: T,
    /// Yaw inertia about the vertical through the reference point, kg·m².
    pub inertia: T,
    /// Lever arm of F₂ about that vertical, m.
    pub lever: T,
    /// Reference point ahead of the axle, m.
    pub ahead: T,
}

impl<T: Scalar> PoseError<T> {
    /// The error of a target pose (x₁, y₁, θ₁) seen from (x₀, y₀, θ₀), world frame: m, m, rad.
    #[inline(always)]
    pub fn of(robot: [T; 3], target: [T; 3]) -> [T; 3] {
        let (sin, cos) = robot[2].sin_cos();
        let off = vec2(target[0] - robot[0], target[1] - robot[1]).rotated(cos, -sin);
        [off.x, off.y, target[2] - robot[2]]
    }
}

impl<T: Scalar> Dynamics<T> for PoseError<T> {
    fn sizes(&self) -> Sizes {
        Sizes {
            state: 5,
            input: 6,
            output: 2,
            mode: 0,
            guards: 0,
        }
    }

    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], _mode: &[T], dx: &mut [T]) {
        let (speed, yaw_rate) = (u[0] + x[3], u[1] + x[4]);
        let (target_speed, target_rate) = (u[2], u[3]);
        let (sin, cos) = x[2].sin_cos();
        let swept = self.ahead * target_rate;
        dx[0] = yaw_rate * x[1] - speed + target_speed * cos - swept * sin;
        dx[1] = target_speed * sin + swept * cos - yaw_rate * x[0] - self.ahead * yaw_rate;
        dx[2] = target_rate - yaw_rate;
        dx[3] = u[4] / self.mass;
        dx[4] = u[5] * self.lever / self.inertia;
    }

    fn output(&self, x: &[T], u: &[T], _mode: &[T], y: &mut [T]) {
        y[0] = u[0] + x[3];
        y[1] = u[1] + x[4];
    }

    fn decide(&self, _x: &[T], _u: &[T], _mode: &mut [T]) {}
    fn settle(&self, _x: &mut [T], _u: &[T], _mode: &mut [T]) {}
    fn guards(&self, _x: &[T], _u: &[T], _mode: &[T], _g: &mut [T]) {}
}
