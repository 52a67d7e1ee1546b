//! Controllers: open-loop signals, noise on commands, and the followers of paths.

mod follower;
mod law;
mod track;

use std::io::Read;
use std::path::Path as FilePath;

use std::sync::Arc;

use appell_model::lanewise::Lanewise;
use appell_model::math::single::sin_cos;
use appell_model::scalar::Scalar;

use crate::block::{Kernel, Now, Port, Wired};
use crate::noise::Streams;
use crate::scenario::Signal as SignalFile;

pub use follower::{PathFollower, path_follower};
pub(crate) use law::clamp;
pub use track::Track;

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
        // Tables are read when the controller is built, and what comes from outside has no block.
        SignalFile::Table { .. } | SignalFile::External {} => 0.0,
    }
}

/// Largest CSV file that is read, bytes.
const TABLE_BYTES_MAX: u64 = 64 << 20;

/// Reads columns of a CSV file with a header row, by their names.
///
/// # Errors
/// The file cannot be read, has no such column or no row, or a cell is not a finite number.
pub fn read_columns(file: &FilePath, names: &[&str]) -> Result<Vec<Vec<f64>>, String> {
    read_csv(file, &|header| {
        let place = |name: &&str| {
            let found = header.iter().position(|known| known == name);
            found.ok_or_else(|| format!("must have a column \"{name}\", got {}", header.join(", ")))
        };
        names.iter().map(place).collect()
    })
    .map(|(_, columns)| columns)
}

/// Reads time, from the first column, and one column of a CSV file with a header row.
///
/// # Errors
/// As [`read_columns`], or times that do not increase.
pub fn read_table(file: &FilePath, column: &str) -> Result<(Vec<f64>, Vec<f64>), String> {
    let (lines, mut columns) = read_csv(file, &|header| {
        let found = header.iter().position(|known| *known == column);
        found
            .map(|place| vec![0, place])
            .ok_or_else(|| format!("must have a column \"{column}\", got {}", header.join(", ")))
    })?;
    let (values, times) = (columns.pop(), columns.pop());
    let (values, times) = (values.unwrap_or_default(), times.unwrap_or_default());
    if let Some(k) = (1..times.len()).find(|&k| times[k] <= times[k - 1]) {
        return Err(format!(
            "line {}: times must increase, got {}",
            lines[k], times[k]
        ));
    }
    Ok((times, values))
}

/// Picks columns by the names of a header row.
type Pick<'a> = &'a dyn Fn(&[&str]) -> Result<Vec<usize>, String>;

/// Lines of the rows, from 1, and the columns picked.
fn read_csv(file: &FilePath, pick: Pick<'_>) -> Result<(Vec<usize>, Vec<Vec<f64>>), String> {
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
    let places = pick(&names)?;
    let mut columns = vec![Vec::new(); places.len()];
    let mut numbers = Vec::new();
    for (line, row) in lines {
        numbers.push(line + 1);
        let cells: Vec<&str> = row.split(',').map(str::trim).collect();
        for (column, &place) in columns.iter_mut().zip(&places) {
            let text = cells.get(place).copied().unwrap_or_default();
            let number = text.parse().ok().filter(|n: &f64| n.is_finite());
            column.push(number.ok_or_else(|| {
                format!(
                    "line {} column {}: must be a finite number, got \"{text}\"",
                    line + 1,
                    place + 1
                )
            })?);
        }
    }
    if columns.iter().any(Vec::is_empty) {
        return Err("must have at least one row below the header".into());
    }
    Ok((numbers, columns))
}

/// A waveform in each lane.
#[derive(Clone, Debug)]
pub struct Waveforms(Vec<Arc<Waveform>>);

impl Waveforms {
    /// The same in `lanes` lanes.
    pub fn new(waveform: Waveform, lanes: usize) -> Self {
        let shared = Arc::new(waveform);
        Waveforms((0..lanes).map(|_| shared.clone()).collect())
    }

    #[inline(always)]
    fn at<T: Scalar>(&self, t: T) -> T {
        T::from_lanes(|lane| self.0[lane].at(t.lane(lane)))
    }
}

impl Lanewise for Waveforms {
    type One = Waveforms;

    fn fits(&self, _one: &Waveforms) -> bool {
        true
    }

    fn put(&mut self, lane: usize, one: &Waveforms) {
        self.0[lane] = one.0[0].clone();
    }
}

/// Open loop: one waveform per output.
pub struct Signals(Vec<Waveforms>);

impl Signals {
    /// Writes each waveform to its port.
    pub fn wired(channels: Vec<(Port, Waveforms)>) -> Wired<Signals> {
        let (outputs, waveforms) = channels.into_iter().unzip();
        Wired::new(Vec::new(), outputs, Signals(waveforms))
    }
}

impl Lanewise for Signals {
    type One = Signals;

    fn fits(&self, one: &Signals) -> bool {
        self.0.fits(&one.0)
    }

    fn put(&mut self, lane: usize, one: &Signals) {
        self.0.put(lane, &one.0);
    }
}

impl<T: Scalar> Kernel<T> for Signals {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, _input: &[T], output: &mut [T]) {
        for k in 0..self.0.len() {
            output[k] = self.0[k].at(now.t);
        }
    }
}

/// Where the noise of a wheel comes from.
#[derive(Clone, Debug)]
pub enum NoiseSource<T> {
    /// Normal deviates, a new one in each period.
    Normal {
        /// The streams, keyed by the noise's path.
        streams: Streams,
        /// Mean.
        mean: T,
        /// Standard deviation.
        std: T,
    },
    /// A signal of time.
    Given(Waveforms),
}

impl<T: Scalar> Lanewise for NoiseSource<T> {
    type One = NoiseSource<f64>;

    fn fits(&self, one: &NoiseSource<f64>) -> bool {
        matches!(
            (self, one),
            (NoiseSource::Normal { .. }, NoiseSource::Normal { .. })
                | (NoiseSource::Given(_), NoiseSource::Given(_))
        )
    }

    fn put(&mut self, lane: usize, one: &NoiseSource<f64>) {
        match (self, one) {
            (
                NoiseSource::Normal { streams, mean, std },
                NoiseSource::Normal {
                    streams: of,
                    mean: middle,
                    std: spread,
                },
            ) => {
                streams.put(lane, of);
                mean.put(lane, middle);
                std.put(lane, spread);
            }
            (NoiseSource::Given(a), NoiseSource::Given(b)) => a.put(lane, b),
            _ => {}
        }
    }
}

/// Adds noise to the commands of drives.
pub struct WheelNoise<T>(Vec<NoiseSource<T>>);

impl<T: Scalar> WheelNoise<T> {
    /// For each wheel: the port that is read, the command, the noise in it, and its source.
    pub fn wired(wheels: Vec<([Port; 3], NoiseSource<T>)>) -> Wired<WheelNoise<T>> {
        let (mut inputs, mut outputs, mut sources) = (Vec::new(), Vec::new(), Vec::new());
        for ([wanted, command, noise], source) in wheels {
            inputs.push(wanted);
            outputs.extend([command, noise]);
            sources.push(source);
        }
        Wired::new(inputs, outputs, WheelNoise(sources))
    }
}

impl<T: Scalar> Lanewise for WheelNoise<T> {
    type One = WheelNoise<f64>;

    fn fits(&self, one: &WheelNoise<f64>) -> bool {
        self.0.fits(&one.0)
    }

    fn put(&mut self, lane: usize, one: &WheelNoise<f64>) {
        self.0.put(lane, &one.0);
    }
}

impl<T: Scalar> Kernel<T> for WheelNoise<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        for k in 0..self.0.len() {
            let noise = match &self.0[k] {
                NoiseSource::Normal { streams, mean, std } => {
                    *mean + *std * streams.normals::<T>(now.ticks)[0]
                }
                NoiseSource::Given(waveforms) => waveforms.at(now.t),
            };
            output[2 * k] = input[k] + noise;
            output[2 * k + 1] = noise;
        }
    }
}
