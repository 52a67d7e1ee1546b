//! Laws of path following: from where a robot is beside its path to how it should move.

use appell_model::math::{hypot, wrap_angle};
use appell_model::pose_error::PoseError;
use appell_model::scalar::Scalar;

use super::track::{Point, Tracks};
use crate::scenario::Law;

/// Time by which the commands lead, for the lag of drives and hold, s.
const LEAD: f64 = 0.04;
/// Twice the damping ratio of the offset over the way driven: 2 would be critical.
const DAMPING: f64 = 1.8;
/// Largest angle of the front wheel that the Stanley law imagines, rad.
const STANLEY_MAX: f64 = 1.2;

/// A robot beside its path.
pub struct Place<'a, T: Scalar> {
    /// The path.
    pub path: &'a Tracks<T>,
    /// Arc length of the point of the path that the errors are taken from, m.
    pub progress: T,
    /// That point: x and y, m.
    pub point: [T; 2],
    /// Pose of the robot: m, m, rad.
    pub pose: [T; 3],
    /// How far the robot is before that point, along the path, m.
    pub along: T,
    /// How far the robot is to the left of the path, m.
    pub offset: T,
    /// Heading of the robot less that of the path, rad.
    pub heading_error: T,
    /// Distance over which errors are to be driven out, m.
    pub lookahead: T,
    /// Largest speed, m/s.
    pub speed_max: T,
}

/// A wanted twist: m/s, m/s, rad/s, in the robot's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<T> {
    /// Forward speed.
    pub forward: T,
    /// Speed to the left.
    pub left: T,
    /// Yaw rate.
    pub yaw_rate: T,
}

/// Gains of offset (1/m²) and heading error (1/m) that minimize
/// ∫ (d²/L⁴ + θ²/L² + u²) ds for d′ = θ, θ′ = u − κ² d: the errors beside a path of curvature κ,
/// to first order, per length driven. L is the lookahead, m; κ in 1/m.
///
/// The Riccati equation of two states has a closed form. `[eq:regulator]`
#[inline(always)]
pub fn regulator<T: Scalar>(curvature: T, lookahead: T) -> [T; 2] {
    let weight = T::one() / (lookahead * lookahead);
    let square = curvature * curvature;
    // √(κ⁴ + w²) − κ², without the difference.
    let root = (square * square + weight * weight).sqrt();
    let offset = weight * weight / (root + square);
    [offset, (T::from(2.0) * offset + weight).sqrt()]
}

/// A value within two bounds.
#[inline(always)]
pub fn clamp<T: Scalar>(value: T, low: T, high: T) -> T {
    value.max(low).min(high)
}

impl<T: Scalar> Place<'_, T> {
    /// The path at arc length `s`, m, straight on beyond its end.
    #[inline(always)]
    fn ahead(&self, s: T) -> Point<T> {
        let point = self.path.at(s);
        let beyond = s - self.path.length;
        let past = T::zero().less(beyond);
        let (sin, cos) = point.heading.sin_cos();
        let on = |start: T, way: T| T::select(past, start + beyond * way, start);
        Point {
            place: [on(point.place[0], cos), on(point.place[1], sin)],
            heading: point.heading,
            curvature: T::select(past, T::zero(), point.curvature),
        }
    }

    /// Curvature of the path where the robot will be when its command takes effect, 1/m.
    #[inline(always)]
    fn curvature(&self, speed: T) -> T {
        self.path
            .at(self.progress + speed * T::from(LEAD))
            .curvature
    }

    /// The point of the path one lookahead on, from the robot: distance m, direction rad (world).
    #[inline(always)]
    fn goal_point(&self) -> (T, T) {
        let goal = self.ahead(self.progress + self.lookahead).place;
        let (dx, dy) = (goal[0] - self.pose[0], goal[1] - self.pose[1]);
        (hypot(dx, dy), dy.atan2(dx))
    }

    /// The twist of a robot that steers by turning, at a speed along the path, m/s.
    #[inline(always)]
    pub fn steer(&self, law: Law, speed: T) -> Command<T> {
        let gain = T::one() / self.lookahead;
        let (sine, cosine) = self.heading_error.sin_cos();
        let damping = T::from(DAMPING) * gain * sine;
        let bend = match law {
            Law::Samson => {
                let feedback = gain * gain * self.offset + damping;
                self.curvature(speed) - feedback
            }
            Law::PurePursuit => {
                let (distance, direction) = self.goal_point();
                let (sine, _) = wrap_angle(direction - self.pose[2]).sin_cos();
                T::from(2.0) * sine / distance.max(T::from(1e-6))
            }
            Law::Stanley => self.stanley(),
            Law::Lqr => {
                let curvature = self.curvature(speed);
                let [of_offset, of_heading] = regulator(curvature, self.lookahead);
                curvature - of_offset * self.offset - of_heading * self.heading_error
            }
            Law::Kanayama => {
                let error = self.error();
                let curvature = self.path.at(self.progress).curvature;
                let catching_up = self.speed_max * gain * error[0];
                let forward = speed * cosine + catching_up;
                let feedback = gain * gain * error[1] - damping;
                return Command {
                    forward: clamp(forward, -self.speed_max, self.speed_max),
                    left: T::zero(),
                    yaw_rate: speed * (curvature + feedback),
                };
            }
        };
        Command {
            forward: speed,
            left: T::zero(),
            yaw_rate: speed * bend,
        }
    }

    /// Curvature that a front wheel steers, which leads by the lookahead.
    #[inline(always)]
    fn stanley(&self) -> T {
        let (sine, cosine) = self.pose[2].sin_cos();
        let front = [
            self.pose[0] + self.lookahead * cosine,
            self.pose[1] + self.lookahead * sine,
        ];
        let (_, cosine) = self.heading_error.sin_cos();
        // Its foot on the path, by two corrections of where it would be on a straight one.
        let mut s = self.progress + self.along + self.lookahead * cosine;
        let (mut offset, mut heading) = (T::zero(), T::zero());
        for _ in 0..3 {
            let point = self.ahead(s.max(T::zero()));
            let (sin, cos) = point.heading.sin_cos();
            let (dx, dy) = (front[0] - point.place[0], front[1] - point.place[1]);
            (offset, heading) = (dy * cos - dx * sin, point.heading);
            let bend = (T::one() - point.curvature * offset).max(T::from(0.2));
            s += (dx * cos + dy * sin) / bend;
        }
        let angle = wrap_angle(heading - self.pose[2]) - offset.atan2(self.lookahead);
        let limit = T::from(STANLEY_MAX);
        let (sine, cosine) = clamp(angle, -limit, limit).sin_cos();
        sine / cosine / self.lookahead
    }

    /// The velocity of a robot that moves sideways, without a yaw rate.
    ///
    /// `[eq:sideways]` Its offset has a first-order motion: the laws of Samson and Stanley and the regulator agree on
    /// a direction that drives it out over the lookahead.
    #[inline(always)]
    pub fn move_sideways(&self, law: Law, speed: T) -> Command<T> {
        let heading = self.path.at(self.progress).heading;
        let (speed, direction) = match law {
            Law::Samson | Law::Stanley | Law::Lqr => {
                (speed, heading - self.offset.atan2(self.lookahead))
            }
            Law::PurePursuit => (speed, self.goal_point().1),
            Law::Kanayama => {
                let error = self.error();
                let gain = self.speed_max / self.lookahead;
                let (sine, cosine) = (-self.heading_error).sin_cos();
                let wanted = [
                    speed * cosine + gain * error[0],
                    speed * sine + gain * error[1],
                ];
                let size = hypot(wanted[0], wanted[1]);
                let direction = self.pose[2] + wanted[1].atan2(wanted[0]);
                (size.min(self.speed_max), direction)
            }
        };
        let (sine, cosine) = wrap_angle(direction - self.pose[2]).sin_cos();
        Command {
            forward: speed * cosine,
            left: speed * sine,
            yaw_rate: T::zero(),
        }
    }

    /// Pose of the path's point in the robot's axes (x_e, y_e, θ_e): m, m, rad. `[eq:pose-error]`
    #[inline(always)]
    pub fn error(&self) -> [T; 3] {
        let heading = self.pose[2] - self.heading_error;
        PoseError::of(self.pose, [self.point[0], self.point[1], heading])
    }
}
