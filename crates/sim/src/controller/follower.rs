//! The follower of a path: speed, progress and turning on the spot, round a law.

use std::sync::Arc;

use appell_model::lanewise;
use appell_model::lanewise::{Alike, Lanewise};
use appell_model::math::{hypot, wrap_angle};
use appell_model::scalar::{Mask, Scalar};

use super::law::{Place, clamp};
use super::track::{Point, Track, Tracks};
use crate::block::{Kernel, Now, Port, Wired, restore_numbers, save_numbers};
use crate::build::Values;
use crate::plan::SpeedLimits;
use crate::scenario::{Follower as Tuning, Heading, Law, PoseSource};

/// Follows a path: planned among the beacons, or given as a route.
///
/// By default the curvature of the path ahead plus feedback of offset and heading error, both over
/// the distance `lookahead` (C. Samson, *Control of chained systems: application to path following
/// and time-varying point-stabilization of mobile robots*, IEEE TAC 40(1) 1995). Where the path
/// points elsewhere, a robot that can turns on the spot first.
pub type PathFollower<T> = Wired<Follower<T>>;

/// What follows a path; see [`PathFollower`].
pub struct Follower<T: Scalar> {
    path: Tracks<T>,
    law: Alike<Law>,
    heading: Alike<Heading>,
    speed: T,
    acceleration: T,
    lateral_acceleration: T,
    yaw_rate: T,
    yaw_acceleration: T,
    lookahead: T,
    /// Whether it can turn on the spot.
    turns: bool,
    /// Heading at the start, rad.
    start: T,
    state: State<T>,
    /// The point of the path at its progress.
    foot: Found<T>,
}

/// What the follower remembers.
#[derive(Clone, Copy, Debug)]
struct State<T> {
    /// Progress along the path, m.
    progress: T,
    /// Commanded speed along the path, m/s.
    speed: T,
    /// Commanded yaw rate, rad/s.
    yaw_rate: T,
    /// 1 while turning on the spot.
    turning: T,
    /// Commanded speeds forward and to the left, m/s.
    velocity: [T; 2],
}

impl<T: Scalar> State<T> {
    fn numbers(&self) -> [T; 6] {
        let [forward, left] = self.velocity;
        [
            self.progress,
            self.speed,
            self.yaw_rate,
            self.turning,
            forward,
            left,
        ]
    }

    fn of(n: [T; 6]) -> Self {
        State {
            progress: n[0],
            speed: n[1],
            yaw_rate: n[2],
            turning: n[3],
            velocity: [n[4], n[5]],
        }
    }
}

/// Heading error at which the follower stops to turn on the spot, and at which it drives on, rad.
const TURN: (f64, f64) = (0.8, 0.12);
/// Share of the speed that a robot keeps however far it is beside its path.
const SLOWEST: f64 = 0.15;
/// Places of the path that are looked at when it is taken over: some centimetres apart.
const SEARCHED: u32 = 500;
/// Yaw rate per heading error where the heading is turned for itself, 1/s.
const TURN_GAIN: f64 = 3.0;

lanewise!(State {} state { progress, speed, yaw_rate, turning, velocity });

lanewise!(Follower { law, heading, turns } state {
    path,
    speed,
    acceleration,
    lateral_acceleration,
    yaw_rate,
    yaw_acceleration,
    lookahead,
    start,
    state,
    foot
});

/// A point of the path that need not be looked up again, unless another trial came into a lane.
struct Found<T>(Option<Foot<T>>);

impl<T: Scalar> Lanewise for Found<T> {
    type One = Found<f64>;

    fn fits(&self, _one: &Found<f64>) -> bool {
        true
    }

    fn put(&mut self, _lane: usize, _one: &Found<f64>) {
        self.0 = None;
    }
}

/// A follower of a path for robot `name`, its tuning at the path `base` of the scenario, which starts with a heading, rad, and may be able to turn on
/// the spot.
pub fn path_follower<T: Scalar>(
    name: &str,
    base: &str,
    path: &Arc<Track>,
    tuning: &Tuning,
    heading: T,
    turns: bool,
    values: &Values<'_, T>,
) -> PathFollower<T> {
    let robot = format!("robot.{name}");
    let port = |path: &str, unit: &str| Port::new(format!("{robot}.{path}"), unit);
    let source = match tuning.pose {
        PoseSource::Truth => "pose",
        PoseSource::PoseSensor => "sensor.pose",
        PoseSource::Odometry => "sensor.odometry",
    };
    let at = |key: &str, value: f64| values.at(format_args!("{base}.{key}"), value);
    let speed = at("speed", tuning.speed);
    let acceleration = at("acceleration", tuning.acceleration);
    let lateral_acceleration = at("lateral_acceleration", tuning.lateral_acceleration);
    let yaw_rate = at("yaw_rate", tuning.yaw_rate);
    let limits = SpeedLimits {
        speed: speed.single(0),
        acceleration: acceleration.single(0),
        lateral_acceleration: lateral_acceleration.single(0),
        yaw_rate: match tuning.heading {
            Heading::Hold => T::Single::from(f64::INFINITY),
            Heading::Steer | Heading::Along => yaw_rate.single(0),
        },
    };
    let follower = Follower {
        path: Tracks::new(path, Arc::new(path.squared_limits(&limits))),
        law: Alike(tuning.law),
        heading: Alike(tuning.heading),
        speed,
        acceleration,
        lateral_acceleration,
        yaw_rate,
        yaw_acceleration: at("yaw_acceleration", tuning.yaw_acceleration),
        lookahead: at("lookahead", tuning.lookahead),
        turns,
        start: heading,
        state: State::of([T::zero(); 6]),
        foot: Found(None),
    };
    // The true position serves only to report the true offset.
    let inputs = vec![
        port(&format!("{source}.x"), "m"),
        port(&format!("{source}.y"), "m"),
        port(&format!("{source}.yaw"), "rad"),
        port("pose.x", "m"),
        port("pose.y", "m"),
    ];
    let outputs = vec![
        port("command.forward", "m/s"),
        port("command.left", "m/s"),
        port("command.yaw_rate", "rad/s"),
        port("path.offset", "m"),
        port("path.progress", "m"),
        port("path.error.x", "m"),
        port("path.error.y", "m"),
        port("path.error.yaw", "rad"),
    ];
    Wired::new(inputs, outputs, follower)
}

/// A point of a path with its directions.
#[derive(Clone, Copy)]
struct Foot<T> {
    point: Point<T>,
    /// Of the heading of the path.
    cos: T,
    sin: T,
}

impl<T: Scalar> Foot<T> {
    /// How far a position is before it, and to the left, m.
    #[inline(always)]
    fn beside(&self, x: T, y: T) -> [T; 2] {
        let (dx, dy) = (x - self.point.place[0], y - self.point.place[1]);
        [dx * self.cos + dy * self.sin, dy * self.cos - dx * self.sin]
    }
}

impl<T: Scalar> Follower<T> {
    /// The path at arc length s, m.
    #[inline(always)]
    fn foot(&self, s: T) -> Foot<T> {
        let point = self.path.at(s);
        let (sin, cos) = point.heading.sin_cos();
        Foot { point, cos, sin }
    }

    /// Moves the point that the errors are taken from on by a period `dt`, s; where it comes to.
    #[inline(always)]
    fn progress(&self, state: &mut State<T>, x: T, y: T, dt: T) -> Foot<T> {
        let mut foot = match self.foot.0 {
            Some(foot) => foot,
            None => self.foot(state.progress),
        };
        if self.law.0 == Law::Kanayama {
            // The reference goes its own way, but waits for a robot that is far behind.
            let [along, _] = foot.beside(x, y);
            let patience = T::from(2.0) + along / self.lookahead;
            let step = clamp(patience, T::zero(), T::one()) * state.speed * dt;
            state.progress = (state.progress + step).min(self.path.length);
            return self.foot(state.progress);
        }
        // The foot of the robot on the path moves forward only, and no faster than twice the robot.
        let reach = T::from(2.0) * (state.speed + self.acceleration * dt) * dt;
        for _ in 0..2 {
            let [along, offset] = foot.beside(x, y);
            let bend = (T::one() - foot.point.curvature * offset).max(T::from(0.2));
            let step = clamp(along / bend, T::zero(), reach);
            state.progress = (state.progress + step).min(self.path.length);
            foot = self.foot(state.progress);
        }
        foot
    }

    /// Speed along the path, m/s, for a robot `offset` beside it.
    #[inline(always)]
    fn speed(&self, state: &State<T>, offset: T, dt: T) -> T {
        let step = self.acceleration * dt;
        let way = (state.speed + T::from(0.5) * step).min(self.speed) * dt;
        let off = offset / (T::from(0.4) * self.lookahead);
        let slack = (T::one() / (T::one() + off * off)).max(T::from(SLOWEST));
        self.path.limit(state.progress + way, self.acceleration) * slack
    }
}

impl<T: Scalar> Kernel<T> for Follower<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        let [x, y, yaw] = [input[0], input[1], input[2]];
        let (zero, dt) = (T::zero(), T::from(now.dt));
        let mut state = self.state;
        let foot = self.progress(&mut state, x, y, dt);
        self.foot = Found(Some(foot));
        let Point {
            place: point,
            heading,
            curvature,
        } = foot.point;
        let [along, offset] = foot.beside(x, y);
        let heading_error = wrap_angle(yaw - heading);
        let place = Place {
            path: &self.path,
            progress: state.progress,
            point,
            pose: [x, y, yaw],
            along,
            offset,
            heading_error,
            lookahead: self.lookahead,
            speed_max: self.speed,
        };
        let left = self.path.length - state.progress - along.min(zero);
        let arrived = left.less(T::from(0.002));
        let step = self.acceleration * dt;
        // Speeds change no faster than the tuning allows; braking may use half as much again.
        let braked = state.speed - T::from(1.5) * step;
        let faster = state.speed + step;
        let allowed = self.speed(&state, offset, dt);
        let mut command;
        if self.heading.0 == Heading::Steer {
            let turning = T::from(0.5).less(state.turning);
            let turn = T::select(turning, T::from(TURN.1), T::from(TURN.0));
            let astray = turn.less(heading_error.abs()).and(arrived.not());
            let astray = astray.and(T::Mask::splat(self.turns));
            state.turning = T::select(astray, T::one(), zero);
            let (_, cosine) = heading_error.sin_cos();
            let speed = allowed * cosine.max(T::from(0.2));
            let moving = speed.min(faster).max(braked);
            // It stands at the end of the path, and brakes along the path before it turns.
            let stands = arrived.or(astray);
            state.speed = T::select(stands, braked.max(zero), moving);
            command = place.steer(self.law.0, state.speed);
            let spin = clamp(
                T::from(-TURN_GAIN) * heading_error,
                -self.yaw_rate,
                self.yaw_rate,
            );
            let rolls = T::from(0.05).less(state.speed);
            let spin = T::select(rolls, spin * T::from(0.3), spin);
            command.forward = T::select(stands, state.speed, command.forward);
            command.left = T::select(stands, zero, command.left);
            let still = T::select(astray, spin, zero);
            command.yaw_rate = T::select(stands, still, command.yaw_rate);
        } else {
            let speed = T::select(arrived, zero, allowed);
            state.speed = speed.min(faster).max(braked);
            command = place.move_sideways(self.law.0, state.speed);
            let (wanted, rate) = if self.heading.0 == Heading::Along {
                let bend = (T::one() - curvature * offset).max(T::from(0.2));
                (heading, state.speed * (curvature / bend))
            } else {
                (self.start, zero)
            };
            command.yaw_rate = rate - T::from(TURN_GAIN) * wrap_angle(yaw - wanted);
        }
        if self.law.0 == Law::Kanayama {
            // It asks for speed in proportion to how far the robot is behind.
            let most = self.acceleration.max(self.lateral_acceleration);
            let change = T::from(1.5) * most * dt;
            let [forward, left] = state.velocity;
            command.forward = clamp(command.forward, forward - change, forward + change);
            command.left = clamp(command.left, left - change, left + change);
        }
        state.velocity = [command.forward, command.left];
        let wanted = clamp(command.yaw_rate, -self.yaw_rate, self.yaw_rate);
        let turn_step = self.yaw_acceleration * dt;
        state.yaw_rate = clamp(
            wanted,
            state.yaw_rate - turn_step,
            state.yaw_rate + turn_step,
        );
        let [ahead, _] = foot.beside(input[3], input[4]);
        let nearest = self.foot(state.progress + ahead);
        let [_, true_offset] = nearest.beside(input[3], input[4]);
        let error = place.error();
        output[0] = command.forward;
        output[1] = command.left;
        output[2] = state.yaw_rate;
        output[3] = true_offset;
        output[4] = state.progress;
        output[5] = error[0];
        output[6] = error[1];
        output[7] = error[2];
        self.state = state;
    }

    /// Goes on from the place of the path ahead that is nearest in position and heading, at the speed
    /// that was commanded.
    fn take_over(&mut self, input: &[T], before: &[T]) {
        let [x, y, yaw] = [input[0], input[1], input[2]];
        // Where it, or another follower, came to last.
        let progress = before[4].max(self.state.progress);
        let ahead = self.path.length - progress;
        let slack = T::from(0.1) * self.lookahead;
        let mut best = (T::from(T::LARGEST), progress);
        for k in 0..=SEARCHED {
            let s = ahead.mul_add(T::from(k as f64 / SEARCHED as f64), progress);
            let foot = self.foot(s);
            let [along, offset] = foot.beside(x, y);
            let off = self.lookahead * wrap_angle(yaw - foot.point.heading);
            let across = offset.mul_add(offset, off * off);
            let cost = along.mul_add(along, across);
            // Of laps that are as near the first counts.
            let nearer = (cost + slack * slack).less(best.0);
            best.0 = T::select(nearer, cost, best.0);
            best.1 = T::select(nearer, s, best.1);
        }
        let [forward, left] = [before[0], before[1]];
        self.foot = Found(None);
        self.state = State {
            progress: best.1,
            speed: hypot(forward, left),
            yaw_rate: before[2],
            turning: T::zero(),
            velocity: [forward, left],
        };
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.state.numbers(), bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        let mut numbers = [T::zero(); 6];
        let used = restore_numbers(&mut numbers, bytes)?;
        self.state = State::of(numbers);
        self.foot = Found(None);
        Some(used)
    }
}

#[cfg(test)]
mod tests;
