//! The single track that drifts: no angle is small, wheels spin, and tires take combined slip.

use super::{Chassis, HEADING, Limits, SIDESLIP, SLOW, SPEED, STEERING, YAW_RATE};
use super::{advance, sizes, twist};
use crate::dynamics::{Dynamics, Sizes};
use crate::planar::{Vec2, vec2};
use crate::scalar::Scalar;
use crate::tire::combined::Combined;

/// First of the spin rates of front and rear wheel, rad/s, in the state.
const SPIN: usize = 7;
/// Speed about which rolling fades into slipping, and width of that, m/s.
const FADE: [f64; 2] = [0.2, 0.05];
/// Time in which spin rates follow the ground in rolling, s.
const CATCH_UP: f64 = 0.02;

/// The single-track drift model (STD), equations (14) and (15), and below some 0.2 m/s and in reverse
/// rolling without slip, equation (13), into which it fades as the program of that text does.
///
/// The acceleration asked for becomes torque at the wheels, and load moves between the axles as if it
/// were attained. A wheel that stands does not turn backward. In reverse only rolling is modelled.
///
/// State: x, y of the center of mass in the world, m; δ; v; ψ; ψ̇; β; spin rates of front and rear
/// wheel, rad/s. Output: velocity of the center of mass in the base frame, m/s; yaw rate, rad/s; force
/// of the ground on front and rear axle, each along and across its wheels, N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriftTrack<T> {
    /// Masses and lengths.
    pub chassis: Chassis<T>,
    /// The tires of both axles.
    pub tire: Combined<T>,
    /// Radius of a wheel, m.
    pub radius: T,
    /// Spin inertia of an axle's wheels, kg·m².
    pub spin_inertia: T,
    /// Share of the torque of brakes that is the front axle's, T_s,b.
    pub brake_share: T,
    /// Share of the torque of the engine that is the front axle's, T_s,e.
    pub engine_share: T,
    /// What steering and drive can do.
    pub limits: Limits<T>,
}

/// The contacts of front and rear axle at an instant.
struct Contacts<T> {
    /// Speed of each along its wheels, at least 0, m/s.
    pace: [T; 2],
    /// Force of the ground, contact axes, N.
    force: [Vec2<T>; 2],
}

impl<T: Scalar> DriftTrack<T> {
    #[inline(always)]
    fn contacts(&self, x: &[T], acceleration: T) -> Contacts<T> {
        let (sin, cos) = x[SIDESLIP].sin_cos();
        let velocity = vec2(cos, sin) * x[SPEED];
        let (sin_steering, cos_steering) = x[STEERING].sin_cos();
        let front = self.chassis.front.mul_add(x[YAW_RATE], velocity.y);
        let rear = velocity.y - self.chassis.rear * x[YAW_RATE];
        let pace = [velocity.x * cos_steering + front * sin_steering, velocity.x]
            .map(|speed| speed.max(T::zero()));
        let least = T::from(SLOW);
        let moves = least.less(x[SPEED]);
        let ahead = T::select(moves, velocity.x, T::one());
        let angle = |side: T| (side / ahead).atan();
        let angles = [angle(front) - x[STEERING], angle(rear)];
        let load = self.chassis.loads(acceleration);
        let force = |k: usize| {
            let slip = T::one() - self.radius * x[SPIN + k] / pace[k].max(least);
            let angle = T::select(moves, angles[k], T::zero());
            self.tire.force(slip, angle, load[k])
        };
        Contacts {
            pace,
            force: [force(0), force(1)],
        }
    }
}

impl<T: Scalar> Dynamics<T> for DriftTrack<T> {
    fn sizes(&self) -> Sizes {
        sizes(9, 7)
    }

    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], _mode: &[T], dx: &mut [T]) {
        let (zero, one) = (T::zero(), T::one());
        let held = self.limits.hold(x[STEERING], x[SPEED], [u[0], u[1]]);
        let contacts = self.contacts(x, held[1]);
        let rolling = self.chassis.rolling(x, held);
        let slips = ((x[SPEED] - T::from(FADE[0])) / T::from(FADE[1])).tanh();
        let slips = T::from(0.5) * (slips + one);
        let fade = |slipping: T, rolling: T| slips * slipping + (one - slips) * rolling;

        // Forces in the base frame, and along and across the velocity.
        let (sin, cos) = x[STEERING].sin_cos();
        let front = contacts.force[0].rotated(cos, sin);
        let total = front + contacts.force[1];
        let (sin, cos) = x[SIDESLIP].sin_cos();
        let along = total.rotated(cos, -sin);
        let Chassis { mass, inertia, .. } = self.chassis;
        let moment = self.chassis.front * front.y - self.chassis.rear * contacts.force[1].y;
        let moves = T::from(SLOW).less(x[SPEED]);
        let speed = T::select(moves, x[SPEED], one);
        let sideslip_rate = T::select(moves, along.y / (mass * speed) - x[YAW_RATE], zero);

        advance(x, dx);
        dx[STEERING] = held[0];
        dx[SPEED] = fade(along.x / mass, held[1]);
        dx[HEADING] = fade(x[YAW_RATE], rolling.yaw_rate);
        dx[YAW_RATE] = fade(moment / inertia, rolling.yaw_acceleration);
        dx[SIDESLIP] = fade(sideslip_rate, rolling.sideslip_rate);

        let torque = mass * self.radius * held[1];
        let (brake, engine) = (torque.min(zero), torque.max(zero));
        for k in 0..2 {
            let share = |front: T| if k == 0 { front } else { one - front };
            let drive = share(self.brake_share) * brake + share(self.engine_share) * engine;
            let free = (drive - self.radius * contacts.force[k].x) / self.spin_inertia;
            // A wheel that stands does not turn backward.
            let rate = T::select(zero.less(x[SPIN + k]), free, free.max(zero));
            let caught = (contacts.pace[k] / self.radius - x[SPIN + k]) / T::from(CATCH_UP);
            dx[SPIN + k] = fade(rate, caught);
        }
    }

    fn output(&self, x: &[T], u: &[T], _mode: &[T], y: &mut [T]) {
        let held = self.limits.hold(x[STEERING], x[SPEED], [u[0], u[1]]);
        twist(x, x[YAW_RATE], y);
        for (k, force) in self.contacts(x, held[1]).force.into_iter().enumerate() {
            (y[3 + 2 * k], y[4 + 2 * k]) = (force.x, force.y);
        }
    }

    fn decide(&self, _x: &[T], _u: &[T], _mode: &mut [T]) {}

    fn settle(&self, x: &mut [T], _u: &[T], _mode: &mut [T]) {
        for k in 0..2 {
            x[SPIN + k] = x[SPIN + k].max(T::zero());
        }
    }

    fn guards(&self, _x: &[T], _u: &[T], _mode: &[T], _g: &mut [T]) {}
}
