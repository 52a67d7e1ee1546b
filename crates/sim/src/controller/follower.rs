//! The follower of a path: speed, progress and turning on the spot, round a law.

use appell_model::math::single::sin_cos;
use appell_model::math::wrap_angle;

use super::law::{Command, Place};
use crate::block::{Block, BlockError, Port, restore_numbers, save_numbers};
use crate::plan::{Path, SpeedLimits};
use crate::scenario::{Follower as Tuning, Heading, Law, PoseSource};

/// Follows a path: planned among the beacons, or given as a route.
///
/// By default the curvature of the path ahead plus feedback of offset and heading error, both over
/// the distance `lookahead` (C. Samson, *Control of chained systems: application to path following
/// and time-varying point-stabilization of mobile robots*, IEEE TAC 40(1) 1995). Where the path
/// points elsewhere, a robot that can turns on the spot first.
pub struct PathFollower {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    path: Path,
    /// Squared speed limit at each path point, m²/s².
    limits: Vec<f64>,
    tuning: Tuning,
    /// Whether it can turn on the spot.
    turns: bool,
    /// Heading at the start, rad.
    heading: f64,
    state: State,
}

/// What the follower remembers, as numbers so that it can be saved.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    /// Progress along the path, m.
    progress: f64,
    /// Commanded speed along the path, m/s.
    speed: f64,
    /// Commanded yaw rate, rad/s.
    yaw_rate: f64,
    /// 1 while turning on the spot.
    turning: f64,
    /// Commanded speeds forward and to the left, m/s.
    velocity: [f64; 2],
}

/// Heading error at which the follower stops to turn on the spot, and at which it drives on, rad.
const TURN: (f64, f64) = (0.8, 0.12);
/// Share of the speed that a robot keeps however far it is beside its path.
const SLOWEST: f64 = 0.15;
/// Yaw rate per heading error where the heading is turned for itself, 1/s.
const TURN_GAIN: f64 = 3.0;

impl PathFollower {
    /// A follower of `path` for robot `name`, which starts with a heading, rad, and may be able to
    /// turn on the spot.
    pub fn new(name: &str, path: Path, tuning: &Tuning, heading: f64, turns: bool) -> Self {
        let robot = format!("robot.{name}");
        let port = |path: &str, unit: &str| Port::new(format!("{robot}.{path}"), unit);
        let source = match tuning.pose {
            PoseSource::Truth => "pose",
            PoseSource::PoseSensor => "sensor.pose",
            PoseSource::Odometry => "sensor.odometry",
        };
        let limits = SpeedLimits {
            speed: tuning.speed,
            acceleration: tuning.acceleration,
            lateral_acceleration: tuning.lateral_acceleration,
            yaw_rate: match tuning.heading {
                Heading::Hold => f64::INFINITY,
                Heading::Steer | Heading::Along => tuning.yaw_rate,
            },
        };
        let squared = path.speed_profile(&limits).iter().map(|v| v * v).collect();
        PathFollower {
            // The true position serves only to report the true offset.
            inputs: vec![
                port(&format!("{source}.x"), "m"),
                port(&format!("{source}.y"), "m"),
                port(&format!("{source}.yaw"), "rad"),
                port("pose.x", "m"),
                port("pose.y", "m"),
            ],
            outputs: vec![
                port("command.forward", "m/s"),
                port("command.left", "m/s"),
                port("command.yaw_rate", "rad/s"),
                port("path.offset", "m"),
                port("path.progress", "m"),
                port("path.error.x", "m"),
                port("path.error.y", "m"),
                port("path.error.yaw", "rad"),
            ],
            path,
            limits: squared,
            tuning: tuning.clone(),
            turns,
            heading,
            state: State::default(),
        }
    }

    /// Speed limit at arc length s, m/s: between points the lowest of what can be reached from the one
    /// before, be braked from to the one after, and is allowed at either.
    fn limit(&self, s: f64) -> f64 {
        let last = self.limits.len() - 1;
        if last == 0 {
            return 0.0;
        }
        let steps = (s / self.path.ds).clamp(0.0, last as f64);
        let k = (steps.floor() as usize).min(last - 1);
        let gain = 2.0 * self.tuning.acceleration * self.path.ds;
        let share = steps - k as f64;
        let (before, after) = (self.limits[k], self.limits[k + 1]);
        let reached = before + share * gain;
        let braked = after + (1.0 - share) * gain;
        reached.min(braked).min(before.max(after)).sqrt()
    }

    /// Where a point is beside the path's point at arc length s: before it m, left of it m, its
    /// heading rad, its curvature 1/m.
    fn beside(&self, x: f64, y: f64, s: f64) -> (f64, f64, f64, f64) {
        let (point, heading, curvature) = self.path.at(s);
        let (sin, cos) = sin_cos(heading);
        let (dx, dy) = (x - point[0], y - point[1]);
        (dx * cos + dy * sin, dy * cos - dx * sin, heading, curvature)
    }

    /// Moves the point that the errors are taken from on by a period `dt`, s.
    fn progress(&self, state: &mut State, x: f64, y: f64, dt: f64) {
        if self.tuning.law == Law::Kanayama {
            // The reference goes its own way, but waits for a robot that is far behind.
            let (along, ..) = self.beside(x, y, state.progress);
            let patience = (2.0 + along / self.tuning.lookahead).clamp(0.0, 1.0);
            let step = patience * state.speed * dt;
            state.progress = (state.progress + step).min(self.path.length);
            return;
        }
        // The foot of the robot on the path moves forward only, and no faster than twice the robot.
        for _ in 0..2 {
            let (along, offset, _, curvature) = self.beside(x, y, state.progress);
            let reach = 2.0 * (state.speed + self.tuning.acceleration * dt) * dt;
            let bend = (1.0 - curvature * offset).max(0.2);
            state.progress =
                (state.progress + (along / bend).clamp(0.0, reach)).min(self.path.length);
        }
    }

    /// Speed along the path, m/s, for a robot `offset` beside it.
    fn speed(&self, state: &State, offset: f64, dt: f64) -> f64 {
        let step = self.tuning.acceleration * dt;
        let way = (state.speed + 0.5 * step).min(self.tuning.speed) * dt;
        let off = offset / (0.4 * self.tuning.lookahead);
        let slack = (1.0 / (1.0 + off * off)).max(SLOWEST);
        self.limit(state.progress + way) * slack
    }
}

impl Block for PathFollower {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    fn step(
        &mut self,
        _tick: u64,
        _t: f64,
        dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        let [x, y, yaw] = [input[0], input[1], input[2]];
        let tuning = &self.tuning;
        let mut state = self.state;
        self.progress(&mut state, x, y, dt);
        let (along, offset, heading, curvature) = self.beside(x, y, state.progress);
        let place = Place {
            path: &self.path,
            progress: state.progress,
            pose: [x, y, yaw],
            along,
            offset,
            heading_error: wrap_angle(yaw - heading),
            lookahead: tuning.lookahead,
            speed_max: tuning.speed,
        };
        let left = self.path.length - state.progress - along.min(0.0);
        let arrived = left < 0.002;
        let step = tuning.acceleration * dt;
        // Speeds change no faster than the tuning allows; braking may use half as much again.
        let braked = state.speed - 1.5 * step;
        let heading_error = place.heading_error;
        let mut command = Command::default();
        if tuning.heading == Heading::Steer {
            let turn = if state.turning > 0.5 { TURN.1 } else { TURN.0 };
            let astray = heading_error.abs() > turn && !arrived && self.turns;
            state.turning = f64::from(u8::from(astray));
            if arrived {
                // Stands at the end of the path.
                state.speed = braked.max(0.0);
                command.forward = state.speed;
            } else if astray {
                state.speed = braked.max(0.0);
                command.forward = state.speed;
                command.yaw_rate =
                    (-TURN_GAIN * heading_error).clamp(-tuning.yaw_rate, tuning.yaw_rate);
                if state.speed > 0.05 {
                    // Brakes along the path before it turns.
                    command.yaw_rate *= 0.3;
                }
            } else {
                let (_, cosine) = sin_cos(heading_error);
                let speed = self.speed(&state, offset, dt) * cosine.max(0.2);
                state.speed = speed.min(state.speed + step).max(braked);
                command = place.steer(tuning.law, state.speed);
            }
        } else {
            let speed = if arrived {
                0.0
            } else {
                self.speed(&state, offset, dt)
            };
            state.speed = speed.min(state.speed + step).max(braked);
            command = place.move_sideways(tuning.law, state.speed);
            let (wanted, rate) = match tuning.heading {
                Heading::Along => {
                    let bend = curvature / (1.0 - curvature * offset).max(0.2);
                    (heading, state.speed * bend)
                }
                Heading::Steer | Heading::Hold => (self.heading, 0.0),
            };
            command.yaw_rate = rate - TURN_GAIN * wrap_angle(yaw - wanted);
        }
        if tuning.law == Law::Kanayama {
            // It asks for speed in proportion to how far the robot is behind.
            let change = 1.5 * tuning.acceleration.max(tuning.lateral_acceleration) * dt;
            let [forward, left] = state.velocity;
            command.forward = command.forward.clamp(forward - change, forward + change);
            command.left = command.left.clamp(left - change, left + change);
        }
        state.velocity = [command.forward, command.left];
        let wanted = command.yaw_rate.clamp(-tuning.yaw_rate, tuning.yaw_rate);
        let turn_step = tuning.yaw_acceleration * dt;
        state.yaw_rate = wanted.clamp(state.yaw_rate - turn_step, state.yaw_rate + turn_step);
        let (ahead, ..) = self.beside(input[3], input[4], state.progress);
        let (_, true_offset, ..) = self.beside(input[3], input[4], state.progress + ahead);
        let [x_error, y_error, yaw_error] = place.error();
        self.state = state;
        output.copy_from_slice(&[
            command.forward,
            command.left,
            state.yaw_rate,
            true_offset,
            state.progress,
            x_error,
            y_error,
            yaw_error,
        ]);
        Ok(())
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        let s = &self.state;
        let [forward, left] = s.velocity;
        let numbers = [s.progress, s.speed, s.yaw_rate, s.turning, forward, left];
        save_numbers(&numbers, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        let mut n = [0.0; 6];
        let used = restore_numbers(&mut n, bytes)?;
        self.state = State {
            progress: n[0],
            speed: n[1],
            yaw_rate: n[2],
            turning: n[3],
            velocity: [n[4], n[5]],
        };
        Some(used)
    }
}

#[cfg(test)]
mod tests;
