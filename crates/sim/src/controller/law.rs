//! Laws of path following: from where a robot is beside its path to how it should move.

use appell_model::math::single::{atan2, sin_cos};
use appell_model::math::wrap_angle;
use appell_model::pose_error::PoseError;

use crate::plan::Path;
use crate::scenario::Law;

/// Time by which the commands lead, for the lag of drives and hold, s.
const LEAD: f64 = 0.04;
/// Twice the damping ratio of the offset over the way driven: 2 would be critical.
const DAMPING: f64 = 1.8;
/// Largest angle of the front wheel that the Stanley law imagines, rad.
const STANLEY_MAX: f64 = 1.2;

/// A robot beside its path.
pub struct Place<'a> {
    /// The path.
    pub path: &'a Path,
    /// Arc length of the point of the path that the errors are taken from, m.
    pub progress: f64,
    /// Pose of the robot: m, m, rad.
    pub pose: [f64; 3],
    /// How far the robot is before that point, along the path, m.
    pub along: f64,
    /// How far the robot is to the left of the path, m.
    pub offset: f64,
    /// Heading of the robot less that of the path, rad.
    pub heading_error: f64,
    /// Distance over which errors are to be driven out, m.
    pub lookahead: f64,
    /// Largest speed, m/s.
    pub speed_max: f64,
}

/// A wanted twist: m/s, m/s, rad/s, in the robot's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Forward speed.
    pub forward: f64,
    /// Speed to the left.
    pub left: f64,
    /// Yaw rate.
    pub yaw_rate: f64,
}

/// Gains of offset (1/m²) and heading error (1/m) that minimize
/// ∫ (d²/L⁴ + θ²/L² + u²) ds for d′ = θ, θ′ = u − κ² d: the errors beside a path of curvature κ,
/// to first order, per length driven. L is the lookahead, m; κ in 1/m.
///
/// The Riccati equation of two states has a closed form. `[eq:regulator]`
pub fn regulator(curvature: f64, lookahead: f64) -> [f64; 2] {
    let weight = 1.0 / (lookahead * lookahead);
    let square = curvature * curvature;
    // √(κ⁴ + w²) − κ², without the difference.
    let root = (square * square + weight * weight).sqrt();
    let offset = weight * weight / (root + square);
    [offset, (2.0 * offset + weight).sqrt()]
}

impl Place<'_> {
    /// Point, heading and curvature of the path at arc length `s`, m, straight on beyond its end.
    fn ahead(&self, s: f64) -> ([f64; 2], f64, f64) {
        let (point, heading, curvature) = self.path.at(s);
        let beyond = s - self.path.length;
        if beyond <= 0.0 {
            return (point, heading, curvature);
        }
        let (sin, cos) = sin_cos(heading);
        (
            [point[0] + beyond * cos, point[1] + beyond * sin],
            heading,
            0.0,
        )
    }

    /// Curvature of the path where the robot will be when its command takes effect, 1/m.
    fn curvature(&self, speed: f64) -> f64 {
        self.path.at(self.progress + speed * LEAD).2
    }

    /// The point of the path one lookahead on, from the robot: distance m, direction rad (world).
    fn goal_point(&self) -> (f64, f64) {
        let (goal, ..) = self.ahead(self.progress + self.lookahead);
        let (dx, dy) = (goal[0] - self.pose[0], goal[1] - self.pose[1]);
        (appell_model::math::hypot(dx, dy), atan2(dy, dx))
    }

    /// The twist of a robot that steers by turning, at a speed along the path, m/s.
    pub fn steer(&self, law: Law, speed: f64) -> Command {
        let gain = 1.0 / self.lookahead;
        let (sine, cosine) = sin_cos(self.heading_error);
        let bend = match law {
            Law::Samson => {
                let feedback = gain * gain * self.offset + DAMPING * gain * sine;
                self.curvature(speed) - feedback
            }
            Law::PurePursuit => {
                let (distance, direction) = self.goal_point();
                let (sine, _) = sin_cos(wrap_angle(direction - self.pose[2]));
                2.0 * sine / distance.max(1e-6)
            }
            Law::Stanley => self.stanley(),
            Law::Lqr => {
                let curvature = self.curvature(speed);
                let [of_offset, of_heading] = regulator(curvature, self.lookahead);
                curvature - of_offset * self.offset - of_heading * self.heading_error
            }
            Law::Kanayama => {
                let error = self.error();
                let (_, _, curvature) = self.path.at(self.progress);
                let catching_up = self.speed_max * gain * error[0];
                let forward = (speed * cosine + catching_up).clamp(-self.speed_max, self.speed_max);
                let feedback = gain * gain * error[1] - DAMPING * gain * sine;
                return Command {
                    forward,
                    left: 0.0,
                    yaw_rate: speed * (curvature + feedback),
                };
            }
        };
        Command {
            forward: speed,
            left: 0.0,
            yaw_rate: speed * bend,
        }
    }

    /// Curvature that a front wheel steers, which leads by the lookahead.
    fn stanley(&self) -> f64 {
        let (sine, cosine) = sin_cos(self.pose[2]);
        let front = [
            self.pose[0] + self.lookahead * cosine,
            self.pose[1] + self.lookahead * sine,
        ];
        let (_, cosine) = sin_cos(self.heading_error);
        // Its foot on the path, by two corrections of where it would be on a straight one.
        let mut s = self.progress + self.along + self.lookahead * cosine;
        let (mut offset, mut heading) = (0.0, 0.0);
        for _ in 0..3 {
            let (point, along, curvature) = self.ahead(s.max(0.0));
            let (sin, cos) = sin_cos(along);
            let (dx, dy) = (front[0] - point[0], front[1] - point[1]);
            (offset, heading) = (dy * cos - dx * sin, along);
            s += (dx * cos + dy * sin) / (1.0 - curvature * offset).max(0.2);
        }
        let angle = wrap_angle(heading - self.pose[2]) - atan2(offset, self.lookahead);
        let (sine, cosine) = sin_cos(angle.clamp(-STANLEY_MAX, STANLEY_MAX));
        sine / cosine / self.lookahead
    }

    /// The velocity of a robot that moves sideways, without a yaw rate.
    ///
    /// `[eq:sideways]` Its offset has a first-order motion: the laws of Samson and Stanley and the regulator agree on
    /// a direction that drives it out over the lookahead.
    pub fn move_sideways(&self, law: Law, speed: f64) -> Command {
        let (_, heading, _) = self.path.at(self.progress);
        let (speed, direction) = match law {
            Law::Samson | Law::Stanley | Law::Lqr => {
                (speed, heading - atan2(self.offset, self.lookahead))
            }
            Law::PurePursuit => (speed, self.goal_point().1),
            Law::Kanayama => {
                let error = self.error();
                let gain = self.speed_max / self.lookahead;
                let (sine, cosine) = sin_cos(-self.heading_error);
                let wanted = [
                    speed * cosine + gain * error[0],
                    speed * sine + gain * error[1],
                ];
                let size = appell_model::math::hypot(wanted[0], wanted[1]);
                let direction = self.pose[2] + atan2(wanted[1], wanted[0]);
                (size.min(self.speed_max), direction)
            }
        };
        let (sine, cosine) = sin_cos(wrap_angle(direction - self.pose[2]));
        Command {
            forward: speed * cosine,
            left: speed * sine,
            yaw_rate: 0.0,
        }
    }

    /// Pose of the path's point in the robot's axes (x_e, y_e, θ_e): m, m, rad. `[eq:pose-error]`
    pub fn error(&self) -> [f64; 3] {
        let (point, ..) = self.path.at(self.progress);
        let heading = self.pose[2] - self.heading_error;
        PoseError::of(self.pose, [point[0], point[1], heading])
    }
}
