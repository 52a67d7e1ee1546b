//! Steered wheels: from a twist to their angles, and to what their motors take.

use core::f64::consts::{FRAC_PI_2, PI};

use appell_model::math::hypot;
use appell_model::math::single::atan2;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{Layout, MAX_WHEELS, Platform};
use appell_model::solve::{Mobility, Row, Square, dot};

use crate::scenario::{self, Level};

/// The steered wheels of a robot, and the geometry under their present angles.
pub(super) struct Steering {
    platform: Platform<f64>,
    level: Level,
    /// Driven wheels.
    driven: Vec<usize>,
    leads: Vec<Lead>,
    /// Scratch: a state with the measured steering angles.
    x: Vec<f64>,
    /// Inverse of the mass matrix, straight ahead: how a twist gives way to what the wheels allow.
    inverse: Square<f64>,
    /// Distance of the farthest wheel, m: what yaw counts by.
    size: f64,
}

/// A wheel that a motor steers.
struct Lead {
    wheel: usize,
    /// Whether other wheels are linked to it.
    is_linked: bool,
    /// Index of its angle in the state.
    at: usize,
    limit: f64,
    rate_max: f64,
    torque_max: f64,
    /// Gain of the angle's loop, rad/s.
    bandwidth: f64,
    /// Gain of the rate loop, N·m·s/rad.
    gain: f64,
}

/// Speed of its mount below which a wheel keeps its angle, m/s.
const STILL: f64 = 1e-6;

impl Lead {
    /// What is known of the k-th steered wheel, for a servo of this period, s.
    fn new(
        file: &scenario::Platform,
        layout: &Layout,
        mobility: &Square<f64>,
        k: usize,
        period: f64,
    ) -> Lead {
        let wheel = layout.steered[k];
        let name = &file.wheel[wheel].name;
        let scenario::Steering::Steered {
            angle_max_deg,
            rate_max,
            torque_max,
            bandwidth,
            ..
        } = file.wheel[wheel].steering
        else {
            unreachable!("only steered wheels are driven about their pivots");
        };
        let swivel = layout.swivels.iter().position(|&i| i == wheel);
        // What the steering motor feels.
        let inertia = 1.0 / mobility[layout.eta + k][layout.eta + k];
        Lead {
            wheel,
            is_linked: file.wheel.iter().any(
                |w| matches!(&w.steering, scenario::Steering::Linked { to, .. } if to == name),
            ),
            at: layout.swivel(swivel.expect("a steered wheel swivels")),
            limit: angle_max_deg.to_radians(),
            rate_max,
            torque_max: torque_max.unwrap_or(f64::MAX),
            // A loop of samples is no faster than that.
            bandwidth: bandwidth.min(0.25 / period),
            // The rate loop is four times as fast as that of the angle, so that the angle does not run
            // over, but takes two periods at least.
            gain: inertia * (4.0 * bandwidth).min(0.5 / period),
        }
    }

    /// The angle at which the wheel rolls along a velocity of its mount, the nearer of both ends
    /// leading. Where the limit forbids both, the robot rather drives the way that it is told,
    /// `backwards` or not.
    fn towards(&self, velocity: Vec2<f64>, backwards: bool) -> f64 {
        let wanted = atan2(velocity.y, velocity.x);
        let turned = wanted - PI.copysign(wanted);
        let near = if wanted.abs() > FRAC_PI_2 {
            turned
        } else {
            wanted
        };
        let chosen = match (near.abs() <= self.limit, backwards) {
            (true, _) => near,
            (false, false) => wanted,
            (false, true) => turned,
        };
        chosen.clamp(-self.limit, self.limit)
    }

    /// Rate, rad/s, or torque, N·m, that turns the wheel towards an angle.
    fn command(&self, level: Level, target: f64, angle: f64, rate: f64) -> f64 {
        let wanted = (self.bandwidth * (target - angle)).clamp(-self.rate_max, self.rate_max);
        match level {
            Level::Kinematic => wanted,
            Level::Rolling => {
                (self.gain * (wanted - rate)).clamp(-self.torque_max, self.torque_max)
            }
        }
    }
}

impl Steering {
    /// What steers a robot; `None` without steered wheels. `mobility` is that of the platform straight
    /// ahead, `period` that of the servo, s.
    pub(super) fn new(
        robot: &scenario::Robot,
        platform: &Platform<f64>,
        inverse: Square<f64>,
        mobility: &Square<f64>,
        period: f64,
    ) -> Option<Steering> {
        let layout = platform.layout();
        if layout.steered.is_empty() {
            return None;
        }
        let file = robot
            .platform
            .as_ref()
            .expect("a checked robot has a platform");
        let wheels = platform.wheels();
        Some(Steering {
            level: robot.level,
            driven: super::driven(platform),
            leads: (0..layout.steered.len())
                .map(|k| Lead::new(file, layout, mobility, k, period))
                .collect(),
            x: crate::build::rest_state(platform, [0.0; 3], &crate::build::start_angles(file)),
            inverse,
            size: wheels
                .iter()
                .map(|wheel| hypot(wheel.mount.x, wheel.mount.y))
                .fold(0.0, f64::max),
            platform: platform.clone(),
        })
    }

    /// The angles at the start, rad.
    pub(super) fn angles(&self) -> Vec<f64> {
        self.leads.iter().map(|lead| self.x[lead.at]).collect()
    }

    /// Finds the wanted angles (kept in `targets`) for a twist, writes the steering commands, and
    /// gives the spin rate of each driven wheel, rad/s, for what the present angles allow of it.
    pub(super) fn act(
        &mut self,
        twist: &[f64],
        angles: &[f64],
        rates: &[f64],
        targets: &mut [f64],
        commands: &mut [f64],
    ) -> [f64; MAX_WHEELS] {
        for (lead, angle) in self.leads.iter().zip(angles) {
            self.x[lead.at] = *angle;
        }
        for k in 0..self.leads.len() {
            let mount = self.platform.wheels()[self.leads[k].wheel].mount;
            let velocity = vec2(twist[0], twist[1]) + mount.perpendicular() * twist[2];
            // Standing still it keeps its angle.
            if hypot(velocity.x, velocity.y) > STILL {
                targets[k] = if self.leads[k].is_linked {
                    self.aim(k, twist, angles[k])
                } else {
                    self.leads[k].towards(velocity, twist[0] < 0.0)
                };
            }
        }
        for (k, lead) in self.leads.iter().enumerate() {
            self.x[lead.at] = angles[k];
            commands[k] = lead.command(self.level, targets[k], angles[k], rates[k]);
        }
        let v = self.allowed(twist);
        let layout = self.platform.layout();
        let mut wanted = [0.0; MAX_WHEELS];
        for (k, &i) in self.driven.iter().enumerate() {
            let row = self
                .platform
                .spin_row(i, &self.platform.wheel_frame(i, &self.x));
            wanted[k] = dot(layout.eta, &row, &v);
        }
        wanted
    }

    /// What the wheels allow of a twist at the steering angles in `x`, as velocity coordinates.
    fn allowed(&mut self, twist: &[f64]) -> Row<f64> {
        self.platform.renew_angles(&mut self.x);
        let mut v = self
            .platform
            .velocity_from_twist(vec2(twist[0], twist[1]), twist[2], &[]);
        let mut mobility = Mobility::new(self.platform.layout().dof(), &self.inverse);
        self.platform.guide(&self.x, &mut mobility, &mut v);
        v
    }

    /// The angle of a steered wheel with others linked to it at which the wheels allow most of a
    /// twist: yaw counts by the size of the robot, and of equal angles the nearest to the present one.
    fn aim(&mut self, k: usize, twist: &[f64], present: f64) -> f64 {
        const COARSE: usize = 48;
        const FINE: usize = 24;
        let limit = self.leads[k].limit;
        let size = self.size;
        let at = self.leads[k].at;
        let mut cost = |angle: f64| {
            self.x[at] = angle;
            let v = self.allowed(twist);
            let (got, turn) = self.platform.twist(&v);
            let off = hypot(got.x - twist[0], got.y - twist[1]);
            let turned = size * (turn - twist[2]);
            let scale = hypot(hypot(twist[0], twist[1]), size * twist[2]);
            let away = 1e-4 * scale * (angle - present);
            off * off + turned * turned + away * away
        };
        let step = 2.0 * limit / COARSE as f64;
        let mut best = (cost(present), present);
        for n in 0..=COARSE {
            let angle = -limit + n as f64 * step;
            let found = cost(angle);
            if found < best.0 {
                best = (found, angle);
            }
        }
        // Golden section about the best of them.
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let (mut low, mut high) = ((best.1 - step).max(-limit), (best.1 + step).min(limit));
        for _ in 0..FINE {
            let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
            if cost(a) < cost(b) {
                high = b;
            } else {
                low = a;
            }
        }
        0.5 * (low + high)
    }
}
