//! Single-track vehicles: both wheels of an axle are one, and roll, lean and pitch are left out.
//!
//! After M. Althoff, G. Würsching, *CommonRoad: Vehicle Models*, version 2020a; numbers of equations
//! are those of that text. δ is the steering angle of the front wheel, ψ the heading, β the angle of
//! the velocity of the center of mass against the heading, all counter-clockwise; v its magnitude,
//! negative in reverse. Inputs of all: wanted steering rate, rad/s, and wanted longitudinal
//! acceleration, m/s². `[eq:single-track]`

mod drift;

pub use drift::DriftTrack;

use crate::dynamics::{Dynamics, Sizes};
use crate::planar::vec2;
use crate::scalar::{Mask, Scalar};
use crate::tire::Curve;

/// Index of the steering angle δ, rad, in the state of each model, after x and y, m.
pub const STEERING: usize = 2;
/// Index of v, m/s.
pub const SPEED: usize = 3;
/// Index of the heading ψ, rad.
pub const HEADING: usize = 4;
/// Index of ψ̇, rad/s, where it is a state.
pub const YAW_RATE: usize = 5;
/// Index of β, rad, where it is a state.
pub const SIDESLIP: usize = 6;

/// Speed below which slip angles make no sense and wheels are taken to roll, m/s.
const SLOW: f64 = 0.1;

/// What steering and drive can do, equations (1), (2), (4), (5); not the friction circle (3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits<T> {
    /// Least and largest steering angle, rad.
    pub steering: [T; 2],
    /// Least and largest steering rate, rad/s.
    pub steering_rate: [T; 2],
    /// Least and largest speed, m/s.
    pub speed: [T; 2],
    /// Largest acceleration, and deceleration, m/s².
    pub acceleration_max: T,
    /// Speed from which power limits the acceleration instead, m/s.
    pub speed_switch: T,
}

/// Masses and lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis<T> {
    /// Distance from the center of mass ahead to the front axle, m.
    pub front: T,
    /// Distance from the center of mass back to the rear axle, m.
    pub rear: T,
    /// Height of the center of mass, m; at 0 no load moves between the axles.
    pub height: T,
    /// Mass, kg.
    pub mass: T,
    /// Yaw inertia about the center of mass, kg·m².
    pub inertia: T,
    /// Acceleration of gravity, m/s².
    pub gravity: T,
}

/// What rolling without slip asks of a vehicle; rad/s, rad/s², rad/s.
#[derive(Clone, Copy, Debug)]
struct Turn<T> {
    yaw_rate: T,
    yaw_acceleration: T,
    sideslip_rate: T,
}

impl<T: Scalar> Limits<T> {
    /// None.
    pub fn none() -> Self {
        let all = [T::from(f64::NEG_INFINITY), T::from(f64::INFINITY)];
        Limits {
            steering: all,
            steering_rate: all,
            speed: all,
            acceleration_max: all[1],
            speed_switch: all[1],
        }
    }

    /// Steering rate, rad/s, and acceleration, m/s², for those that are wanted, at δ and v.
    #[inline(always)]
    pub fn hold(&self, steering: T, speed: T, wanted: [T; 2]) -> [T; 2] {
        let least = -self.acceleration_max;
        let fast = self.speed_switch.less(speed);
        // Where it is not fast the quotient is not taken, and may be one by zero.
        let share = T::select(fast, self.speed_switch / speed, T::one());
        [
            within(steering, self.steering, wanted[0], self.steering_rate),
            within(
                speed,
                self.speed,
                wanted[1],
                [least, self.acceleration_max * share],
            ),
        ]
    }
}

/// A rate within its bounds, and none that leads out of the bounds of the value.
#[inline(always)]
fn within<T: Scalar>(value: T, [low, high]: [T; 2], rate: T, [least, most]: [T; 2]) -> T {
    let zero = T::zero();
    let down = value.less_equal(low).and(rate.less_equal(zero));
    let up = high.less_equal(value).and(zero.less_equal(rate));
    T::select(down.or(up), zero, rate.max(least).min(most))
}

impl<T: Scalar> Chassis<T> {
    /// Distance of the axles, m.
    #[inline(always)]
    pub fn wheelbase(&self) -> T {
        self.front + self.rear
    }

    /// Loads of front and rear axle, N, under a longitudinal acceleration, m/s²: what stands before
    /// (11).
    #[inline(always)]
    pub fn loads(&self, acceleration: T) -> [T; 2] {
        let per_length = self.mass / self.wheelbase();
        let moved = self.height * acceleration;
        [
            per_length * self.gravity.mul_add(self.rear, -moved),
            per_length * self.gravity.mul_add(self.front, moved),
        ]
    }

    /// Rolling without slip, equation (13), at the rates of δ and v.
    #[inline(always)]
    fn rolling(&self, x: &[T], [steering_rate, acceleration]: [T; 2]) -> Turn<T> {
        let (sin, cos) = x[STEERING].sin_cos();
        let (sin_side, cos_side) = x[SIDESLIP].sin_cos();
        let base = self.wheelbase();
        let (tan, tan_rate) = (sin / cos, steering_rate / (cos * cos));
        // tan β = tan δ l_r/(l_f + l_r).
        let share = self.rear / base;
        let lean = share * tan;
        let sideslip_rate = share * tan_rate / lean.mul_add(lean, T::one());
        // Rate of v cos β.
        let ahead = acceleration * cos_side - x[SPEED] * sin_side * sideslip_rate;
        Turn {
            yaw_rate: x[SPEED] * cos_side * tan / base,
            yaw_acceleration: (ahead * tan + x[SPEED] * cos_side * tan_rate) / base,
            sideslip_rate,
        }
    }
}

/// The kinematic single track (KS), equation (6): wheels roll without slip.
///
/// State: x, y of the middle of the rear axle in the world, m; δ; v, there along the heading; ψ.
/// Output: velocity of that point in the base frame, m/s; yaw rate, rad/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KinematicTrack<T> {
    /// Distance of the axles, m.
    pub wheelbase: T,
    /// What steering and drive can do.
    pub limits: Limits<T>,
}

impl<T: Scalar> KinematicTrack<T> {
    #[inline(always)]
    fn yaw_rate(&self, x: &[T]) -> T {
        let (sin, cos) = x[STEERING].sin_cos();
        x[SPEED] * sin / (cos * self.wheelbase)
    }
}

impl<T: Scalar> Dynamics<T> for KinematicTrack<T> {
    fn sizes(&self) -> Sizes {
        sizes(5, 3)
    }

    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], _mode: &[T], dx: &mut [T]) {
        let [steering_rate, acceleration] = self.limits.hold(x[STEERING], x[SPEED], [u[0], u[1]]);
        let (sin, cos) = x[HEADING].sin_cos();
        dx[0] = x[SPEED] * cos;
        dx[1] = x[SPEED] * sin;
        dx[STEERING] = steering_rate;
        dx[SPEED] = acceleration;
        dx[HEADING] = self.yaw_rate(x);
    }

    fn output(&self, x: &[T], _u: &[T], _mode: &[T], y: &mut [T]) {
        y[0] = x[SPEED];
        y[1] = T::zero();
        y[2] = self.yaw_rate(x);
    }

    fn decide(&self, _x: &[T], _u: &[T], _mode: &mut [T]) {}
    fn settle(&self, _x: &mut [T], _u: &[T], _mode: &mut [T]) {}
    fn guards(&self, _x: &[T], _u: &[T], _mode: &[T], _g: &mut [T]) {}
}

/// The single track at small angles, with load transfer (ST): equation (12), and below 0.1 m/s, where
/// slip angles make no sense, rolling without slip, equation (13).
///
/// With linear curves without a limit of friction it is the published model, where the stiffness per
/// load is μ C_S; any other curve does, too. In reverse, forces are opposed to slip here, as they are
/// ahead; the published form has them push.
///
/// State: x, y of the center of mass in the world, m; δ; v; ψ; ψ̇; β. Output: velocity of the center
/// of mass in the base frame, m/s; yaw rate, rad/s; side forces of front and rear axle, N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicTrack<T> {
    /// Masses and lengths.
    pub chassis: Chassis<T>,
    /// Side force per load of the tires of front and rear axle over the slip angle, rad.
    pub tires: [Curve<T>; 2],
    /// What steering and drive can do.
    pub limits: Limits<T>,
}

impl<T: Scalar> DynamicTrack<T> {
    /// Where the vehicle is too slow for slip angles, and its speed, or 1 m/s there.
    #[inline(always)]
    fn pace(&self, x: &[T]) -> (T::Mask, T) {
        let slow = x[SPEED].abs().less(T::from(SLOW));
        (slow, T::select(slow, T::one(), x[SPEED]))
    }

    /// Side forces of front and rear axle to the left, N, at a speed that is not 0.
    #[inline(always)]
    fn side_forces(&self, x: &[T], speed: T, acceleration: T) -> [T; 2] {
        let Chassis { front, rear, .. } = self.chassis;
        let curl = x[YAW_RATE] / speed;
        let forward = T::one().copysign(speed);
        let slip = [
            x[STEERING] - x[SIDESLIP] - front * curl,
            rear * curl - x[SIDESLIP],
        ];
        let load = self.chassis.loads(acceleration);
        [
            load[0] * self.tires[0].along(slip[0]) * forward,
            load[1] * self.tires[1].along(slip[1]) * forward,
        ]
    }
}

impl<T: Scalar> Dynamics<T> for DynamicTrack<T> {
    fn sizes(&self) -> Sizes {
        sizes(7, 5)
    }

    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], _mode: &[T], dx: &mut [T]) {
        let held = self.limits.hold(x[STEERING], x[SPEED], [u[0], u[1]]);
        let (slow, speed) = self.pace(x);
        let [front, rear] = self.side_forces(x, speed, held[1]);
        let rolling = self.chassis.rolling(x, held);
        let Chassis { mass, inertia, .. } = self.chassis;
        let moment = self.chassis.front * front - self.chassis.rear * rear;
        let sideslip_rate = (front + rear) / (mass * speed) - x[YAW_RATE];
        advance(x, dx);
        dx[STEERING] = held[0];
        dx[SPEED] = held[1];
        dx[HEADING] = T::select(slow, rolling.yaw_rate, x[YAW_RATE]);
        dx[YAW_RATE] = T::select(slow, rolling.yaw_acceleration, moment / inertia);
        dx[SIDESLIP] = T::select(slow, rolling.sideslip_rate, sideslip_rate);
    }

    fn output(&self, x: &[T], u: &[T], _mode: &[T], y: &mut [T]) {
        let held = self.limits.hold(x[STEERING], x[SPEED], [u[0], u[1]]);
        let (slow, speed) = self.pace(x);
        let rolling = self.chassis.rolling(x, held);
        let forces = self.side_forces(x, speed, held[1]);
        twist(x, T::select(slow, rolling.yaw_rate, x[YAW_RATE]), y);
        for k in 0..2 {
            y[3 + k] = T::select(slow, T::zero(), forces[k]);
        }
    }

    fn decide(&self, _x: &[T], _u: &[T], _mode: &mut [T]) {}
    fn settle(&self, _x: &mut [T], _u: &[T], _mode: &mut [T]) {}
    fn guards(&self, _x: &[T], _u: &[T], _mode: &[T], _g: &mut [T]) {}
}

/// Sizes of a model with as many states and outputs.
fn sizes(state: usize, output: usize) -> Sizes {
    Sizes {
        state,
        input: 2,
        output,
        mode: 0,
        guards: 0,
    }
}

/// Velocity of the center of mass, world frame, into the rates of its place.
#[inline(always)]
fn advance<T: Scalar>(x: &[T], dx: &mut [T]) {
    let (sin, cos) = (x[SIDESLIP] + x[HEADING]).sin_cos();
    dx[0] = x[SPEED] * cos;
    dx[1] = x[SPEED] * sin;
}

/// Velocity of the center of mass, base frame, and yaw rate, into the first outputs.
#[inline(always)]
fn twist<T: Scalar>(x: &[T], yaw_rate: T, y: &mut [T]) {
    let (sin, cos) = x[SIDESLIP].sin_cos();
    let velocity = vec2(cos, sin) * x[SPEED];
    (y[0], y[1], y[2]) = (velocity.x, velocity.y, yaw_rate);
}
