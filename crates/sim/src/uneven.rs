//! The pose error of a robot on uneven ground, under forces of several waves: a comparison.
//!
//! The study of Feng and Guo (2015), section 3, on `model::pose_error`: a robot regulates to a target
//! at rest while the ground pushes it along and across its motion. The error is that of the target in
//! the robot's frame: m, m, rad.

use appell_model::dynamics::{Dynamics, Input};
use appell_model::integrate::{Adaptive, Stalled};
use appell_model::pose_error::PoseError;
use appell_model::pose_error::excitation::Waveform;
use serde::Serialize;
use serde_json::{Value, json};

/// What a run is made of. SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Study {
    /// Mass, kg.
    pub mass: f64,
    /// Yaw inertia about the vertical through the axle midpoint, kg·m².
    pub inertia: f64,
    /// Lever arm of the force across, m.
    pub lever: f64,
    /// Speed that the robot wants, m/s.
    pub speed: f64,
    /// Yaw rate that it wants, rad/s.
    pub yaw_rate: f64,
    /// Error at the start: m, m, rad.
    pub start: [f64; 3],
    /// Amplitude of the force along the motion, N.
    pub along: f64,
    /// Amplitude of the force across it, N.
    pub across: f64,
    /// Period of both, s.
    pub period: f64,
    /// Phase of both at the start, rad.
    pub phase: f64,
    /// Dry friction that both forces have to overcome, as a share of their amplitudes: a force F acts
    /// as what is left of it above the friction.
    pub friction: f64,
    /// Period at which the waves are sampled, and held between, s; 0 for waves that are continuous.
    pub sampling: f64,
    /// What is equal among the waves.
    pub alike: Alike,
    /// Length of the run, s.
    pub duration: f64,
}

/// What is equal among the waves, apart from their period.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Alike {
    /// The amplitude.
    Amplitude,
    /// The effective value (root of the mean square): that of the sine at the study's amplitude.
    Effective,
}

impl Study {
    /// Numbers of a robot of the paper's size; the paper does not print its own.
    pub const DEFAULT: Study = Study {
        mass: 40.0,
        inertia: 3.0,
        lever: 0.25,
        speed: 0.2,
        yaw_rate: 0.1,
        start: [3.0, 1.5, 0.4],
        along: 8.0,
        across: 3.0,
        period: 2.37,
        phase: 0.0,
        friction: 0.0,
        sampling: 0.0,
        alike: Alike::Amplitude,
        duration: 12.0,
    };
}

/// The waves of the paper, in the order of its legend.
pub const WAVES: [Waveform; 3] = [Waveform::Sine, Waveform::Triangle, Waveform::Square];

/// A quantity that is compared.
pub struct Column {
    /// Name in tables.
    pub name: &'static str,
    /// What it is.
    pub title: &'static str,
    /// Unit.
    pub unit: &'static str,
}

/// The paper's six figures: the error and its rate.
pub const COLUMNS: [Column; 6] = [
    column("x_e", "error ahead, x_e", "m"),
    column("y_e", "error to the left, y_e", "m"),
    column("theta_e", "error of heading, θ_e", "rad"),
    column("x_e_rate", "rate of x_e", "m/s"),
    column("y_e_rate", "rate of y_e", "m/s"),
    column("theta_e_rate", "rate of θ_e", "rad/s"),
];

const fn column(name: &'static str, title: &'static str, unit: &'static str) -> Column {
    Column { name, title, unit }
}

/// Relative tolerance of a run: far below what a picture or four digits of a table show.
const TOLERANCE: f64 = 1e-11;
/// That of a run of a scan, which only compares.
const SCAN_TOLERANCE: f64 = 1e-9;

/// A run at its sample times.
#[derive(Clone, Debug)]
pub struct Series {
    /// Times, s.
    pub time: Vec<f64>,
    /// Each of [`COLUMNS`], by time.
    pub columns: [Vec<f64>; 6],
}

/// The forces between two breaks of a wave.
struct Push<'a> {
    study: &'a Study,
    wave: Waveform,
    scale: f64,
    /// A time between the breaks, s.
    inside: f64,
}

impl Push<'_> {
    fn wave(&self, t: f64) -> f64 {
        let study = self.study;
        let turns = study.phase / core::f64::consts::TAU;
        let cycles = |t: f64| t / study.period + turns;
        let raw = if study.sampling > 0.0 {
            let tick = (self.inside / study.sampling).floor();
            self.wave.at(cycles(tick * study.sampling))
        } else {
            self.wave.piece(cycles(t), cycles(self.inside))
        };
        let pushed = self.scale * raw;
        pushed - pushed.clamp(-study.friction, study.friction)
    }
}

impl Input<f64> for Push<'_> {
    fn at(&self, t: f64, u: &mut [f64]) {
        let wave = self.wave(t);
        let study = self.study;
        u.copy_from_slice(&[
            study.speed,
            study.yaw_rate,
            0.0,
            0.0,
            study.along * wave,
            study.across * wave,
        ]);
    }
}

/// Runs the study under one wave; `count` + 1 samples from its start to its end.
///
/// # Errors
/// When the error outgrows what numbers hold.
pub fn run(study: &Study, wave: Waveform, count: usize) -> Result<Series, Stalled> {
    run_within(study, wave, count, TOLERANCE)
}

fn run_within(
    study: &Study,
    wave: Waveform,
    count: usize,
    tolerance: f64,
) -> Result<Series, Stalled> {
    let system = PoseError {
        mass: study.mass,
        inertia: study.inertia,
        lever: study.lever,
        ahead: 0.0,
    };
    let scale = match (study.alike, wave) {
        (Alike::Amplitude, _) | (_, Waveform::None) => 1.0,
        (Alike::Effective, wave) => Waveform::Sine.effective() / wave.effective(),
    };
    let samples: Vec<f64> = (0..=count)
        .map(|k| study.duration * k as f64 / count as f64)
        .collect();
    let mut stops = samples.clone();
    stops.extend(breaks(study, wave));
    stops.sort_by(f64::total_cmp);
    // Breaks beside a sample would make steps of no length.
    let least = 1e-9 * study.duration;
    let mut method = Adaptive::new(&system, tolerance, 0.1 * tolerance);
    method.step_max = 0.05 * study.period;
    let mut x = vec![0.0; 5];
    x[..3].copy_from_slice(&study.start);
    let (mut u, mut dx, mut mode) = (vec![0.0; 6], vec![0.0; 5], Vec::new());
    let mut series = Series {
        time: samples.clone(),
        columns: Default::default(),
    };
    let (mut t, mut next) = (0.0, 0);
    for stop in stops {
        if stop - t > least {
            let push = Push {
                study,
                wave,
                scale,
                inside: 0.5 * (t + stop),
            };
            method.advance(&system, &push, t, stop, &mut x, &mut mode, None)?;
            t = stop;
        }
        // The force has no part in the rates of the error itself, so that any piece of it will do.
        if next < samples.len() && samples[next] - t <= least {
            let push = Push {
                study,
                wave,
                scale,
                inside: t,
            };
            push.at(t, &mut u);
            system.derivative(&x, &u, &mode, &mut dx);
            for (k, column) in series.columns.iter_mut().enumerate() {
                column.push(if k < 3 { x[k] } else { dx[k - 3] });
            }
            next += 1;
        }
    }
    Ok(series)
}

/// Times at which the force jumps or kinks.
fn breaks(study: &Study, wave: Waveform) -> Vec<f64> {
    if study.sampling > 0.0 {
        let count = (study.duration / study.sampling).floor() as usize;
        return (1..=count).map(|k| k as f64 * study.sampling).collect();
    }
    let turns = study.phase / core::f64::consts::TAU;
    let last = study.duration / study.period + turns;
    let mut times = Vec::new();
    for place in wave.breaks() {
        let mut cycles = turns.floor() + place;
        while cycles < last {
            let t = (cycles - turns) * study.period;
            if t > 0.0 {
                times.push(t);
            }
            cycles += 1.0;
        }
    }
    times
}

/// Largest deviation of each column of a run from that of another, at their samples.
pub fn deviations(run: &Series, from: &Series) -> [f64; 6] {
    core::array::from_fn(|k| {
        let pairs = run.columns[k].iter().zip(&from.columns[k]);
        pairs.fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()))
    })
}

/// Which wave moves a column most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// Square, sine, triangle: that of their impulses.
    Impulses,
    /// The triangle above both others, as the paper's text has it.
    TriangleFirst,
    /// Square and triangle above the sine, as its abstract has it.
    SineLast,
    /// Another order.
    Other,
    /// Two waves are equal.
    Equal,
}

impl Order {
    /// The order of the deviations under sine, triangle and square.
    pub fn of([sine, triangle, square]: [f64; 3]) -> Order {
        // Some ten steps in a period, each within 1e-9, for a hundred periods.
        let equal = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.max(b);
        if equal(sine, triangle) || equal(sine, square) || equal(triangle, square) {
            Order::Equal
        } else if triangle > sine && triangle > square {
            Order::TriangleFirst
        } else if triangle > sine && square > sine {
            Order::SineLast
        } else if square > sine && sine > triangle {
            Order::Impulses
        } else {
            Order::Other
        }
    }
}

/// The orders of a study's six columns.
///
/// # Errors
/// As of [`run`].
pub fn orders(study: &Study, waves: [Waveform; 3]) -> Result<[Order; 6], Stalled> {
    let scanned = |wave| run_within(study, wave, SCAN_SAMPLES, SCAN_TOLERANCE);
    let still = scanned(Waveform::None)?;
    let mut found = [[0.0; 6]; 3];
    for (found, wave) in found.iter_mut().zip(waves) {
        *found = deviations(&scanned(wave)?, &still);
    }
    Ok(core::array::from_fn(|k| Order::of(found.map(|of| of[k]))))
}

/// Samples of a run in a scan: 50 ms apart at 12 s.
const SCAN_SAMPLES: usize = 240;
/// Phases of a scan in a turn.
pub const PHASES: usize = 72;

/// Orders over phase and a second quantity.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Name of the second quantity, as the axis of a picture shows it.
    pub name: &'static str,
    /// What happens to the waves, in a word or two.
    pub deed: &'static str,
    /// Its values.
    pub values: Vec<f64>,
    /// For each value, for each phase from 0 to a turn, the orders of the columns.
    pub orders: Vec<Vec<[Order; 6]>>,
}

impl Scan {
    /// Scans the phase for each of the studies, in parallel.
    fn of(
        [name, deed]: [&'static str; 2],
        values: Vec<f64>,
        studies: &[Study],
    ) -> Result<Scan, Stalled> {
        let row = |study: &Study| -> Result<Vec<[Order; 6]>, Stalled> {
            let at = |k: usize| Study {
                phase: core::f64::consts::TAU * k as f64 / PHASES as f64,
                ..*study
            };
            (0..PHASES).map(|k| orders(&at(k), WAVES)).collect()
        };
        let workers = std::thread::available_parallelism().map_or(1, usize::from);
        let share = studies.len().div_ceil(workers).max(1);
        let parts: Vec<Result<Vec<_>, Stalled>> = std::thread::scope(|scope| {
            let threads: Vec<_> = studies
                .chunks(share)
                .map(|part| scope.spawn(move || part.iter().map(row).collect()))
                .collect();
            threads
                .into_iter()
                .map(|thread| thread.join().expect("a scan does not panic"))
                .collect()
        });
        let mut orders = Vec::new();
        for part in parts {
            orders.extend(part?);
        }
        Ok(Scan {
            name,
            deed,
            values,
            orders,
        })
    }

    /// How many of all cells of a column have an order.
    pub fn count(&self, column: usize, order: Order) -> usize {
        let cells = self.orders.iter().flatten();
        cells.filter(|orders| orders[column] == order).count()
    }

    /// Spans of phase, degrees, in which a column of a row has an order; the ends are phases of the
    /// scan.
    pub fn spans(&self, row: usize, column: usize, order: Order) -> Vec<[f64; 2]> {
        let mut spans: Vec<[f64; 2]> = Vec::new();
        let step = 360.0 / PHASES as f64;
        for (k, orders) in self.orders[row].iter().enumerate() {
            if orders[column] != order {
                continue;
            }
            let phase = k as f64 * step;
            match spans.last_mut() {
                Some(last) if phase - last[1] < 1.5 * step => last[1] = phase,
                _ => spans.push([phase, phase]),
            }
        }
        spans
    }
}

/// Scans of phase against sampling period, in periods of the wave from 0 (continuous) to ½, and
/// against friction, in amplitudes from 0 to 0.95. The study's own phase, sampling and friction do
/// not count.
///
/// # Errors
/// As of [`run`].
pub fn scans(study: &Study) -> Result<[Scan; 2], Stalled> {
    let shares: Vec<f64> = (0..20).map(|k| f64::from(k) / 20.0).collect();
    let frictions: Vec<Study> = shares
        .iter()
        .map(|&friction| Study {
            friction,
            sampling: 0.0,
            ..*study
        })
        .collect();
    let periods: Vec<f64> = (0..=20).map(|k| f64::from(k) / 40.0).collect();
    let samplings: Vec<Study> = periods
        .iter()
        .map(|share| Study {
            friction: 0.0,
            sampling: share * study.period,
            ..*study
        })
        .collect();
    Ok([
        Scan::of(["sampling period / period", "held"], periods, &samplings)?,
        Scan::of(
            ["friction / amplitude", "with friction"],
            shares,
            &frictions,
        )?,
    ])
}

/// What the drawing of the six figures needs: `runs` are the undisturbed one and those of [`WAVES`].
pub fn figures(runs: &[Series; 4]) -> Value {
    let names = ["none", "sine", "triangle", "square"];
    let columns: Vec<Value> = COLUMNS
        .iter()
        .enumerate()
        .map(|(k, column)| {
            let lines: Vec<Value> = names
                .iter()
                .zip(runs)
                .map(|(name, run)| json!({"name": name, "values": run.columns[k]}))
                .collect();
            json!({"title": column.title, "unit": column.unit, "lines": lines})
        })
        .collect();
    json!({"time": runs[0].time, "columns": columns})
}

/// What the drawing of scans needs.
pub fn maps(scans: &[Scan]) -> Value {
    let titles: Vec<&str> = COLUMNS.iter().map(|column| column.title).collect();
    let scans: Vec<Value> = scans
        .iter()
        .map(|scan| json!({"name": scan.name, "values": scan.values, "orders": scan.orders}))
        .collect();
    json!({"columns": titles, "scans": scans})
}

#[cfg(test)]
mod tests;
