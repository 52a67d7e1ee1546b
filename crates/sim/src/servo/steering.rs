//! Steered wheels: from a twist to their angles, and to what their motors take.

use core::f64::consts::{FRAC_PI_2, PI};

use appell_model::lanewise::Lanewise;
use appell_model::math::hypot;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{Layout, MAX_WHEELS, Platform};
use appell_model::scalar::{Mask, Scalar};
use appell_model::solve::{Mobility, Row, Square, dot};

use crate::controller::clamp;
use crate::scenario::{self, Level};

/// The steered wheels of a robot, and the geometry under their present angles.
pub(super) struct Steering<T: Scalar> {
    platform: Platform<T>,
    level: Level,
    /// Driven wheels.
    driven: Vec<usize>,
    leads: Vec<Lead<T>>,
    /// Scratch: a state with the measured steering angles.
    x: Vec<T>,
    /// Inverse of the mass matrix, straight ahead: how a twist gives way to what the wheels allow.
    inverse: Square<T>,
    /// Distance of the farthest wheel, m: what yaw counts by.
    size: T,
}

/// A wheel that a motor steers.
struct Lead<T> {
    wheel: usize,
    /// Whether other wheels are linked to it.
    is_linked: bool,
    /// Index of its angle in the state.
    at: usize,
    limit: T,
    rate_max: T,
    torque_max: T,
    /// Gain of the angle's loop, rad/s.
    bandwidth: T,
    /// Gain of the rate loop, N·m·s/rad.
    gain: T,
}

impl<T: Scalar> Lanewise for Lead<T> {
    type One = Lead<f64>;

    fn fits(&self, one: &Lead<f64>) -> bool {
        self.wheel == one.wheel && self.is_linked == one.is_linked && self.at == one.at
    }

    fn put(&mut self, lane: usize, one: &Lead<f64>) {
        self.limit.put(lane, &one.limit);
        self.rate_max.put(lane, &one.rate_max);
        self.torque_max.put(lane, &one.torque_max);
        self.bandwidth.put(lane, &one.bandwidth);
        self.gain.put(lane, &one.gain);
    }
}

impl<T: Scalar> Lanewise for Steering<T> {
    type One = Steering<f64>;

    fn fits(&self, one: &Steering<f64>) -> bool {
        self.platform.fits(&one.platform)
            && self.level == one.level
            && self.driven == one.driven
            && self.leads.fits(&one.leads)
    }

    fn put(&mut self, lane: usize, one: &Steering<f64>) {
        self.platform.put(lane, &one.platform);
        self.leads.put(lane, &one.leads);
        self.x.put(lane, &one.x);
        self.inverse.put(lane, &one.inverse);
        self.size.put(lane, &one.size);
    }
}

/// Speed of its mount below which a wheel keeps its angle, m/s.
const STILL: f64 = 1e-6;

impl<T: Scalar> Lead<T> {
    /// What is known of the k-th steered wheel, for a servo of this period, s.
    fn new(
        file: &scenario::Platform,
        layout: &Layout,
        mobility: &Square<T>,
        k: usize,
        period: f64,
    ) -> Lead<T> {
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
        let inertia = T::one() / mobility[layout.eta + k][layout.eta + k];
        Lead {
            wheel,
            is_linked: file.wheel.iter().any(
                |w| matches!(&w.steering, scenario::Steering::Linked { to, .. } if to == name),
            ),
            at: layout.swivel(swivel.expect("a steered wheel swivels")),
            limit: T::from(angle_max_deg.to_radians()),
            rate_max: T::from(rate_max),
            torque_max: T::from(torque_max.unwrap_or(T::LARGEST)),
            // A loop of samples is no faster than that.
            bandwidth: T::from(bandwidth.min(0.25 / period)),
            // The rate loop is four times as fast as that of the angle, so that the angle does not run
            // over, but takes two periods at least.
            gain: inertia * T::from((4.0 * bandwidth).min(0.5 / period)),
        }
    }

    /// The angle at which the wheel rolls along a velocity of its mount, the nearer of both ends
    /// leading. Where the limit forbids both, the robot rather drives the way that it is told,
    /// `backwards` or not.
    #[inline(always)]
    fn towards(&self, velocity: Vec2<T>, backwards: T::Mask) -> T {
        let wanted = velocity.y.atan2(velocity.x);
        let turned = wanted - T::from(PI).copysign(wanted);
        let behind = T::from(FRAC_PI_2).less(wanted.abs());
        let near = T::select(behind, turned, wanted);
        let far = T::select(backwards, turned, wanted);
        let chosen = T::select(near.abs().less_equal(self.limit), near, far);
        clamp(chosen, -self.limit, self.limit)
    }

    /// Rate, rad/s, or torque, N·m, that turns the wheel towards an angle.
    #[inline(always)]
    fn command(&self, level: Level, target: T, angle: T, rate: T) -> T {
        let wanted = self.bandwidth * (target - angle);
        let wanted = clamp(wanted, -self.rate_max, self.rate_max);
        match level {
            Level::Kinematic => wanted,
            Level::Rolling | Level::Slip => clamp(
                self.gain * (wanted - rate),
                -self.torque_max,
                self.torque_max,
            ),
        }
    }
}

impl<T: Scalar> Steering<T> {
    /// What steers a robot; `None` without steered wheels. `mobility` is that of the platform straight
    /// ahead, `period` that of the servo, s.
    pub(super) fn new(
        robot: &scenario::Robot,
        platform: &Platform<T>,
        inverse: Square<T>,
        mobility: &Square<T>,
        period: f64,
    ) -> Option<Steering<T>> {
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
            x: {
                let angles = crate::build::start_angles(file).into_iter();
                let angles: Vec<T> = angles.map(T::from).collect();
                crate::build::rest_state(platform, [T::zero(); 3], &angles)
            },
            inverse,
            size: wheels
                .iter()
                .map(|wheel| hypot(wheel.mount.x, wheel.mount.y))
                .fold(T::zero(), T::max),
            platform: platform.clone(),
        })
    }

    /// The angles at the start, rad.
    pub(super) fn angles(&self) -> Vec<T> {
        self.leads.iter().map(|lead| self.x[lead.at]).collect()
    }

    /// Finds the wanted angles (kept in `targets`) for a twist, writes the steering commands, and
    /// gives the spin rate of each driven wheel, rad/s, for what the present angles allow of it.
    #[inline(always)]
    pub(super) fn act(
        &mut self,
        twist: &[T],
        angles: &[T],
        rates: &[T],
        targets: &mut [T],
        commands: &mut [T],
    ) -> [T; MAX_WHEELS] {
        for k in 0..self.leads.len() {
            self.x[self.leads[k].at] = angles[k];
        }
        for k in 0..self.leads.len() {
            let mount = self.platform.wheels()[self.leads[k].wheel].mount;
            let velocity = vec2(twist[0], twist[1]) + mount.perpendicular() * twist[2];
            // Standing still it keeps its angle.
            let moves = T::from(STILL).less(hypot(velocity.x, velocity.y));
            if !moves.any() {
                continue;
            }
            let wanted = if self.leads[k].is_linked {
                self.aim(k, twist, angles[k])
            } else {
                self.leads[k].towards(velocity, twist[0].less(T::zero()))
            };
            targets[k] = T::select(moves, wanted, targets[k]);
        }
        for k in 0..self.leads.len() {
            let lead = &self.leads[k];
            self.x[lead.at] = angles[k];
            commands[k] = lead.command(self.level, targets[k], angles[k], rates[k]);
        }
        let v = self.allowed(twist);
        let eta = self.platform.layout().eta;
        let mut wanted = [T::zero(); MAX_WHEELS];
        for k in 0..self.driven.len() {
            let i = self.driven[k];
            let frame = self.platform.wheel_frame(i, &self.x);
            wanted[k] = dot(eta, &self.platform.spin_row(i, &frame), &v);
        }
        wanted
    }

    /// What the wheels allow of a twist at the steering angles in `x`, as velocity coordinates.
    #[inline(always)]
    fn allowed(&mut self, twist: &[T]) -> Row<T> {
        self.platform.renew_angles(&mut self.x);
        let mut v = self
            .platform
            .velocity_from_twist(vec2(twist[0], twist[1]), twist[2], &[]);
        let mut mobility = Mobility::new(self.platform.layout().dof(), &self.inverse);
        self.platform.guide(&self.x, &mut mobility, &mut v);
        v
    }

    /// What an angle of the k-th steered wheel costs of a twist, see [`Steering::aim`].
    #[inline(never)]
    fn cost(&mut self, k: usize, twist: &[T], present: T, angle: T) -> T {
        self.x[self.leads[k].at] = angle;
        let v = self.allowed(twist);
        let (got, turn) = self.platform.twist(&v);
        let size = self.size;
        let off = hypot(got.x - twist[0], got.y - twist[1]);
        let turned = size * (turn - twist[2]);
        let scale = hypot(hypot(twist[0], twist[1]), size * twist[2]);
        let away = T::from(1e-4) * scale * (angle - present);
        off * off + turned * turned + away * away
    }

    /// The angle of a steered wheel with others linked to it at which the wheels allow most of a
    /// twist: yaw counts by the size of the robot, and of equal angles the nearest to the present one.
    #[inline(never)]
    fn aim(&mut self, k: usize, twist: &[T], present: T) -> T {
        const COARSE: usize = 48;
        const FINE: usize = 24;
        let limit = self.leads[k].limit;
        let step = T::from(2.0) * limit / T::from(COARSE as f64);
        let mut best = (self.cost(k, twist, present, present), present);
        for n in 0..=COARSE {
            let angle = T::from(n as f64) * step - limit;
            let found = self.cost(k, twist, present, angle);
            let better = found.less(best.0);
            best = (
                T::select(better, found, best.0),
                T::select(better, angle, best.1),
            );
        }
        // Golden section about the best of them.
        let golden = T::from(0.618_033_988_749_894_9);
        let mut low = (best.1 - step).max(-limit);
        let mut high = (best.1 + step).min(limit);
        for _ in 0..FINE {
            let reach = golden * (high - low);
            let (a, b) = (high - reach, low + reach);
            let of_a = self.cost(k, twist, present, a);
            let left = of_a.less(self.cost(k, twist, present, b));
            high = T::select(left, b, high);
            low = T::select(left, low, a);
        }
        T::from(0.5) * (low + high)
    }
}
