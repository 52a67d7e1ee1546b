//! Controllers: open-loop signals, and the followers of planned paths that solve the beacon tasks.

use std::io::Read;
use std::path::Path as FilePath;

use appell_model::math::single::sin_cos;
use appell_model::math::wrap_angle;

use crate::block::{Block, BlockError, Port, restore_numbers, save_numbers};
use crate::noise::Stream;
use crate::plan::{Path, SpeedLimits};
use crate::scenario::{Follower as Tuning, PoseSource, Signal as SignalFile};
use crate::signal::Signal as SignalName;

fn port(path: String, unit: &str) -> Port {
    SignalName {
        path,
        unit: unit.to_owned(),
    }
}

/// A signal of time, ready to be evaluated.
#[derive(Clone, Debug)]
pub enum Waveform {
    /// Any shape that a formula gives.
    Formula(SignalFile),
    /// Straight lines between rows.
    Table {
        /// Times, s, increasing.
        times: Vec<f64>,
        /// Values.
        values: Vec<f64>,
    },
}

impl Waveform {
    /// Value at time t, s.
    pub fn at(&self, t: f64) -> f64 {
        match self {
            Waveform::Formula(formula) => formula_at(formula, t),
            Waveform::Table { times, values } => {
                let next = times.partition_point(|&at| at <= t);
                if next == 0 {
                    values[0]
                } else if next == times.len() {
                    values[next - 1]
                } else {
                    let share = (t - times[next - 1]) / (times[next] - times[next - 1]);
                    values[next - 1] + share * (values[next] - values[next - 1])
                }
            }
        }
    }
}

/// Share of the period that has passed, in [0, 1).
fn phase(t: f64, period: f64, phase_deg: f64) -> f64 {
    let cycles = t / period + phase_deg / 360.0;
    cycles - cycles.floor()
}

fn formula_at(formula: &SignalFile, t: f64) -> f64 {
    match formula {
        SignalFile::Constant { value } => *value,
        SignalFile::Step { at, before, after } => {
            if t < *at {
                *before
            } else {
                *after
            }
        }
        SignalFile::Ramp {
            from_time,
            to_time,
            from,
            to,
        } => {
            let share = ((t - from_time) / (to_time - from_time)).clamp(0.0, 1.0);
            from + share * (to - from)
        }
        SignalFile::Sine {
            amplitude,
            period,
            phase_deg,
            offset,
        } => {
            let angle = std::f64::consts::TAU * phase(t, *period, *phase_deg);
            offset + amplitude * sin_cos(angle).0
        }
        SignalFile::Square {
            amplitude,
            period,
            phase_deg,
            offset,
        } => {
            let first = phase(t, *period, *phase_deg) < 0.5;
            offset + if first { *amplitude } else { -amplitude }
        }
        SignalFile::Triangle {
            amplitude,
            period,
            phase_deg,
            offset,
        } => {
            // 0 → 1 → −1 → 0 over a period.
            let share = phase(t, *period, *phase_deg);
            let shape = if share < 0.25 {
                4.0 * share
            } else if share < 0.75 {
                2.0 - 4.0 * share
            } else {
                4.0 * share - 4.0
            };
            offset + amplitude * shape
        }
        SignalFile::Sawtooth {
            amplitude,
            period,
            phase_deg,
            offset,
        } => offset + amplitude * (2.0 * phase(t, *period, *phase_deg) - 1.0),
        SignalFile::Stairs { at, values } => {
            // A tick's time may lie an ulp before the decimal that is meant.
            let reached = at.partition_point(|&from| from <= t + 1e-12 * t.abs().max(1.0));
            values[reached.max(1) - 1]
        }
        // Tables are read when the controller is built.
        SignalFile::Table { .. } => 0.0,
    }
}

/// Largest CSV file that is read, bytes.
const TABLE_BYTES_MAX: u64 = 64 << 20;

/// Reads time and one column of a CSV file with a header row.
pub fn read_table(file: &FilePath, column: &str) -> Result<(Vec<f64>, Vec<f64>), String> {
    let mut text = String::new();
    std::fs::File::open(file)
        .and_then(|open| open.take(TABLE_BYTES_MAX + 1).read_to_string(&mut text))
        .map_err(|error| format!("\"{}\" cannot be read: {error}", file.display()))?;
    if text.len() as u64 > TABLE_BYTES_MAX {
        return Err(format!(
            "\"{}\" must be at most {TABLE_BYTES_MAX} bytes, got more",
            file.display()
        ));
    }
    let mut lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty());
    let (_, header) = lines
        .next()
        .ok_or("must have a header row, got an empty file")?;
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let index = names
        .iter()
        .position(|name| *name == column)
        .ok_or_else(|| format!("must have a column \"{column}\", got {}", names.join(", ")))?;
    let (mut times, mut values) = (Vec::new(), Vec::new());
    for (line, row) in lines {
        let cell = |k: usize| -> Result<f64, String> {
            let text = row.split(',').nth(k).unwrap_or("").trim();
            let number: Result<f64, _> = text.parse();
            number.ok().filter(|n| n.is_finite()).ok_or_else(|| {
                format!(
                    "line {} column {}: must be a finite number, got \"{text}\"",
                    line + 1,
                    k + 1
                )
            })
        };
        let (t, value) = (cell(0)?, cell(index)?);
        if times.last().is_some_and(|&last| t <= last) {
            return Err(format!("line {}: times must increase, got {t}", line + 1));
        }
        times.push(t);
        values.push(value);
    }
    if times.is_empty() {
        return Err("must have at least one row below the header".into());
    }
    Ok((times, values))
}

/// Open loop: one waveform per output.
pub struct Signals {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    waveforms: Vec<Waveform>,
}

impl Signals {
    /// Writes each waveform to its port.
    pub fn new(channels: Vec<(Port, Waveform)>) -> Self {
        let (outputs, waveforms) = channels.into_iter().unzip();
        Signals {
            inputs: Vec::new(),
            outputs,
            waveforms,
        }
    }
}

impl Block for Signals {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }
    fn outputs(&self) -> &[Port] {
        &self.outputs
    }
    fn step(
        &mut self,
        _tick: u64,
        t: f64,
        _dt: f64,
        _input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        for (k, waveform) in self.waveforms.iter().enumerate() {
            output[k] = waveform.at(t);
        }
        Ok(())
    }
}

/// Where the noise of a wheel comes from.
#[derive(Clone, Debug)]
pub enum NoiseSource {
    /// Normal deviates, a new one in each period.
    Normal {
        /// The stream, keyed by the noise's path.
        stream: Stream,
        /// Mean.
        mean: f64,
        /// Standard deviation.
        std: f64,
    },
    /// A signal of time.
    Given(Waveform),
}

/// Adds noise to the commands of drives.
pub struct WheelNoise {
    inputs: Vec<Port>,
    /// Of each wheel, the command and the noise in it.
    outputs: Vec<Port>,
    sources: Vec<NoiseSource>,
}

impl WheelNoise {
    /// For each wheel: the port that is read, the command, the noise, and its source.
    pub fn new(wheels: Vec<([Port; 3], NoiseSource)>) -> Self {
        let (mut inputs, mut outputs, mut sources) = (Vec::new(), Vec::new(), Vec::new());
        for ([wanted, command, noise], source) in wheels {
            inputs.push(wanted);
            outputs.extend([command, noise]);
            sources.push(source);
        }
        WheelNoise {
            inputs,
            outputs,
            sources,
        }
    }
}

impl Block for WheelNoise {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }
    fn outputs(&self) -> &[Port] {
        &self.outputs
    }
    fn step(
        &mut self,
        tick: u64,
        t: f64,
        _dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        for (k, source) in self.sources.iter().enumerate() {
            let noise = match source {
                NoiseSource::Normal { stream, mean, std } => mean + std * stream.normals(tick)[0],
                NoiseSource::Given(waveform) => waveform.at(t),
            };
            output[2 * k] = input[k] + noise;
            output[2 * k + 1] = noise;
        }
        Ok(())
    }
}

/// Follows a planned path: the beacon controllers.
///
/// Curvature of the path ahead plus feedback of offset and heading error, both over the distance
/// `lookahead` (C. Samson, *Control of chained systems: application to path following and
/// time-varying point-stabilization of mobile robots*, IEEE TAC 40(1) 1995). Where the path points
/// elsewhere, the robot turns on the spot first.
pub struct PathFollower {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    path: Path,
    /// Squared speed limit at each path point, m²/s².
    limits: Vec<f64>,
    tuning: Tuning,
    state: State,
}

/// What the follower remembers, as numbers so that it can be saved.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    /// Progress along the path, m.
    progress: f64,
    /// Commanded speed, m/s.
    speed: f64,
    /// Commanded yaw rate, rad/s.
    yaw_rate: f64,
    /// 1 while turning on the spot.
    turning: f64,
}

/// Heading error at which the follower stops to turn on the spot, and at which it drives on, rad.
const TURN: (f64, f64) = (0.8, 0.12);
/// Time by which the commands lead, for the lag of drives and hold, s.
const LEAD: f64 = 0.04;

impl PathFollower {
    /// A follower of `path` for robot `name`.
    pub fn new(name: &str, path: Path, tuning: &Tuning) -> Self {
        let robot = format!("robot.{name}");
        let source = match tuning.pose {
            PoseSource::Truth => "pose",
            PoseSource::PoseSensor => "sensor.pose",
            PoseSource::Odometry => "sensor.odometry",
        };
        let limits = SpeedLimits {
            speed: tuning.speed,
            acceleration: tuning.acceleration,
            lateral_acceleration: tuning.lateral_acceleration,
            yaw_rate: tuning.yaw_rate,
        };
        let squared = path.speed_profile(&limits).iter().map(|v| v * v).collect();
        PathFollower {
            // The true position serves only to report the true offset.
            inputs: [
                (source, "x", "m"),
                (source, "y", "m"),
                (source, "yaw", "rad"),
                ("pose", "x", "m"),
                ("pose", "y", "m"),
            ]
            .map(|(source, axis, unit)| port(format!("{robot}.{source}.{axis}"), unit))
            .to_vec(),
            outputs: vec![
                port(format!("{robot}.command.forward"), "m/s"),
                port(format!("{robot}.command.left"), "m/s"),
                port(format!("{robot}.command.yaw_rate"), "rad/s"),
                port(format!("{robot}.path.offset"), "m"),
                port(format!("{robot}.path.progress"), "m"),
            ],
            path,
            limits: squared,
            tuning: tuning.clone(),
            state: State::default(),
        }
    }

    /// Speed limit at arc length s, m/s: between points v² is linear, as under constant acceleration.
    fn limit(&self, s: f64) -> f64 {
        let last = self.limits.len() - 1;
        if last == 0 {
            return 0.0;
        }
        let steps = (s / self.path.ds).clamp(0.0, last as f64);
        let k = (steps.floor() as usize).min(last - 1);
        let share = steps - k as f64;
        (self.limits[k] + share * (self.limits[k + 1] - self.limits[k]))
            .max(0.0)
            .sqrt()
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
        let error_of = |x: f64, y: f64, s: f64| {
            let (point, heading, curvature) = self.path.at(s);
            let (sin, cos) = sin_cos(heading);
            let (dx, dy) = (x - point[0], y - point[1]);
            (dx * cos + dy * sin, dy * cos - dx * sin, heading, curvature)
        };
        let error = |s: f64| error_of(x, y, s);
        // The foot of the robot on the path moves forward only, and no faster than twice the robot.
        for _ in 0..2 {
            let (along, offset, _, curvature) = error(state.progress);
            let reach = 2.0 * (state.speed + tuning.acceleration * dt) * dt;
            let bend = (1.0 - curvature * offset).max(0.2);
            state.progress =
                (state.progress + (along / bend).clamp(0.0, reach)).min(self.path.length);
        }
        let (along, offset, heading, _) = error(state.progress);
        let heading_error = wrap_angle(yaw - heading);
        let left = self.path.length - state.progress - along.min(0.0);

        let turn = if state.turning > 0.5 { TURN.1 } else { TURN.0 };
        let arrived = left < 0.002;
        state.turning = f64::from(u8::from(heading_error.abs() > turn && !arrived));
        let step = tuning.acceleration * dt;
        let (mut speed, mut yaw_rate) = (0.0, 0.0);
        if arrived {
            // Stands at the end of the path.
        } else if state.turning > 0.5 {
            yaw_rate = (-3.0 * heading_error).clamp(-tuning.yaw_rate, tuning.yaw_rate);
            if state.speed > 0.05 {
                // Brakes along the path before it turns.
                yaw_rate *= 0.3;
            }
        } else {
            let ahead = state.progress + state.speed * dt + 0.5 * step * dt;
            let off = offset / (0.4 * tuning.lookahead);
            let slack = 1.0 / (1.0 + off * off);
            let (_, cosine) = sin_cos(heading_error);
            speed = (self.limit(ahead) * slack * cosine.max(0.2)).min(state.speed + step);
            let (_, _, _, curvature) = error(state.progress + speed * LEAD);
            let gain = 1.0 / tuning.lookahead;
            let (sine, _) = sin_cos(heading_error);
            let feedback = gain * gain * offset + 1.8 * gain * sine;
            yaw_rate = (speed * (curvature - feedback)).clamp(-tuning.yaw_rate, tuning.yaw_rate);
        }
        // Speeds change no faster than the tuning allows; braking may use half as much again.
        state.speed = speed.max(state.speed - 1.5 * step);
        let turn_step = tuning.yaw_acceleration * dt;
        state.yaw_rate = yaw_rate.clamp(state.yaw_rate - turn_step, state.yaw_rate + turn_step);
        let (ahead, ..) = error_of(input[3], input[4], state.progress);
        let (_, true_offset, ..) = error_of(input[3], input[4], state.progress + ahead);
        self.state = state;
        output.copy_from_slice(&[
            state.speed,
            0.0,
            state.yaw_rate,
            true_offset,
            state.progress,
        ]);
        Ok(())
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        let s = &self.state;
        save_numbers(&[s.progress, s.speed, s.yaw_rate, s.turning], bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        let mut n = [0.0; 4];
        let used = restore_numbers(&mut n, bytes)?;
        self.state = State {
            progress: n[0],
            speed: n[1],
            yaw_rate: n[2],
            turning: n[3],
        };
        Some(used)
    }
}
