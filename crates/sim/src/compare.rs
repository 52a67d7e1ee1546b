//! Several runs of one task side by side: where they part, and what each needed.

use appell_model::math::hypot;
use appell_model::scalar::Scalar;
use serde_json::{Map, Value, json};

use crate::record::Recording;
use crate::run::{Outcome, Summary};
use crate::scenario::{Drive, Scenario, Tire};

/// One of the runs compared.
pub struct Entry {
    /// What it is called.
    pub label: String,
    /// Its recording.
    pub recording: Recording,
    /// Its summary.
    pub summary: Summary,
}

/// Distance of one run from the first at equal times.
#[derive(Clone, Debug, PartialEq)]
pub struct Divergence {
    /// Times, s.
    pub times: Vec<f64>,
    /// Distances between the robots' origins, m.
    pub distances: Vec<f64>,
}

impl Divergence {
    /// Largest distance, m, and its time, s.
    pub fn largest(&self) -> (f64, f64) {
        let mut largest = (0.0, 0.0);
        for (&t, &distance) in self.times.iter().zip(&self.distances) {
            if distance > largest.0 {
                largest = (distance, t);
            }
        }
        largest
    }

    /// First time at which the distance exceeds `limit`, m.
    pub fn first_beyond(&self, limit: f64) -> Option<f64> {
        let at = self
            .distances
            .iter()
            .position(|&distance| distance > limit)?;
        Some(self.times[at])
    }
}

fn pose<'a>(entry: &'a Entry, robot: &str) -> [&'a [f64]; 3] {
    ["x", "y", "yaw"].map(|axis| {
        let column = entry
            .recording
            .column(&format!("robot.{robot}.pose.{axis}"));
        column.unwrap_or(&[])
    })
}

/// Distance of `entry`'s first robot from that of `reference` at the instants that both recorded.
pub fn divergence(entry: &Entry, reference: &Entry) -> Divergence {
    let robot = &entry.summary.robots[0].name;
    let ([x, y, _], [rx, ry, _]) = (pose(entry, robot), pose(reference, robot));
    let times = &entry.recording.times;
    // All have the same period; the last row of a run may stand between two of them.
    let count = times.len().min(reference.recording.times.len());
    let shared = (0..count)
        .take_while(|&k| times[k] == reference.recording.times[k])
        .count();
    Divergence {
        times: times[..shared].to_vec(),
        distances: (0..shared)
            .map(|k| hypot(x[k] - rx[k], y[k] - ry[k]))
            .collect(),
    }
}

/// A scenario with the tires of all robots stiffer by a factor: what they give is that much less.
pub fn stiffened(scenario: &Scenario, factor: f64) -> Scenario {
    let mut stiffer = scenario.clone();
    let platforms = stiffer.robot.iter_mut().filter_map(|r| r.platform.as_mut());
    for wheel in platforms.flat_map(|platform| &mut platform.wheel) {
        match &mut wheel.tire {
            Tire::Coulomb { rounding, .. } => *rounding /= factor,
            Tire::Lugre { stiffness, .. }
            | Tire::Brush { stiffness, .. }
            | Tire::MagicFormula { stiffness, .. }
            | Tire::Linear { stiffness, .. } => *stiffness *= factor,
        }
    }
    stiffer
}

/// How the distance of a run from another falls with stiffness.
#[derive(Clone, Debug, PartialEq)]
pub struct Convergence {
    /// Factors of stiffness, rising, and the largest distance at each, m.
    pub points: Vec<(f64, f64)>,
}

impl Convergence {
    /// By which power the distance falls from each point to the next.
    pub fn orders(&self) -> Vec<f64> {
        let fall = |w: &[(f64, f64)]| Scalar::ln(w[0].1 / w[1].1) / Scalar::ln(w[1].0 / w[0].0);
        self.points.windows(2).map(fall).collect()
    }

    /// Of all points: the slope of the line through their logarithms, by least squares.
    pub fn order(&self) -> f64 {
        let logs = || {
            self.points
                .iter()
                .map(|&(f, d)| (Scalar::ln(f), Scalar::ln(d)))
        };
        let count = self.points.len() as f64;
        let sum = logs().fold((0.0, 0.0), |sum, (f, d): (f64, f64)| (sum.0 + f, sum.1 + d));
        let (x, y) = (sum.0 / count, sum.1 / count);
        let (mut over, mut under) = (0.0, 0.0);
        for (f, d) in logs() {
            over += (f - x) * (d - y);
            under += (f - x) * (f - x);
        }
        -over / under
    }

    /// As the picture takes it.
    pub fn drawing(&self, title: &str) -> Value {
        json!({"title": title, "points": self.points, "order": self.order()})
    }
}

/// Where a run leaves another, and what friction the wheels ask for.
#[derive(Clone, Debug, PartialEq)]
pub struct Parting {
    /// Time, s.
    pub time: f64,
    /// Where the run stands then, m.
    pub place: [f64; 2],
    /// Force over normal load of the wheel that asks for most, and its name: at that time, and the
    /// highest until then; none without forces.
    pub demand: Option<[(f64, String); 2]>,
}

/// Where the first robot of `entry` is more than `limit`, m, from that of `reference`. The friction that
/// is asked for is that of the reference, if it has forces.
pub fn parting(entry: &Entry, reference: &Entry, limit: f64) -> Option<Parting> {
    let robot = &entry.summary.robots[0].name;
    let time = divergence(entry, reference).first_beyond(limit)?;
    let row = entry.recording.times.iter().position(|&t| t == time)?;
    let [x, y, _] = pose(entry, robot);
    let demands = |entry: &Entry| demands(entry, robot, row);
    Some(Parting {
        time,
        place: [x[row], y[row]],
        demand: demands(reference).or_else(|| demands(entry)),
    })
}

/// The friction that is asked for at a row, and the highest until then.
fn demands(entry: &Entry, robot: &str, row: usize) -> Option<[(f64, String); 2]> {
    // Below this load, N, a wheel is as good as lifted, and the ratio says nothing.
    const LIGHTEST: f64 = 0.1;
    let recording = &entry.recording;
    let prefix = format!("robot.{robot}.wheel.");
    let mut found: Option<[(f64, String); 2]> = None;
    for signal in &recording.header.signals {
        let wheel = signal.path.strip_prefix(&prefix);
        let Some(wheel) = wheel.and_then(|rest| rest.strip_suffix(".load")) else {
            continue;
        };
        let column = |field: &str| recording.column(&format!("{prefix}{wheel}.{field}"));
        let (along, across) = (column("force.longitudinal")?, column("force.lateral")?);
        let load = column("load")?;
        let [now, highest] =
            found.get_or_insert_with(|| [(0.0, String::new()), (0.0, String::new())]);
        for k in 0..=row {
            if load[k] < LIGHTEST {
                continue;
            }
            let demand = hypot(along[k], across[k]) / load[k];
            if demand > highest.0 {
                *highest = (demand, wheel.to_owned());
            }
            if k == row && demand > now.0 {
                *now = (demand, wheel.to_owned());
            }
        }
    }
    found
}

/// Colours by which the runs are told apart: the last, the run of the report, is drawn in black.
const COLORS: [&str; 4] = ["#CC79A7", "#009E73", "#56B4E9", "#E69F00"];

/// The comparison block of a report's data.
pub fn block(entries: &[Entry]) -> Value {
    let short = |column: &[f64]| {
        column
            .iter()
            .map(|v| (v * 1e5).round() / 1e5)
            .collect::<Vec<_>>()
    };
    let runs: Vec<Value> = entries
        .iter()
        .enumerate()
        .map(|(k, entry)| {
            let summary = &entry.summary.robots[0];
            let [x, y, yaw] = pose(entry, &summary.name);
            let last = k + 1 == entries.len();
            let mut metrics = Map::new();
            for (name, key, scale) in [
                ("time", "time, s", 1.0),
                ("path length", "path, m", 1.0),
                ("beacon clearance", "clearance, mm", 1e3),
                ("cross-track error, RMS", "off path RMS, mm", 1e3),
                ("energy supplied", "energy, J", 1.0),
            ] {
                if let Some(metric) = summary.metrics.iter().find(|m| m.name == name) {
                    metrics.insert(key.into(), json!(metric.value * scale));
                }
            }
            json!({
                "label": entry.label,
                "status": match summary.verdict {
                    Outcome::Passed => "passed",
                    Outcome::Failed => "failed",
                    Outcome::Stopped => "stopped",
                },
                "color": if last { "#15181D" } else { COLORS[k % COLORS.len()] },
                "dash": k == 0,
                "time": entry.recording.times,
                "x": short(x),
                "y": short(y),
                "yaw": short(yaw),
                "metrics": metrics,
            })
        })
        .collect();
    let distance: Vec<Value> = (1..entries.len())
        .map(|k| {
            let apart = divergence(&entries[k], &entries[0]);
            json!({"run": k, "time": apart.times, "values": short(&apart.distances)})
        })
        .collect();
    json!({"note": "same controller, same seed", "runs": runs, "reference": 0, "distance": distance})
}

/// The drives by which all robots of a scenario can be compared, in the words of the file.
pub fn drives(scenario: &Scenario) -> Vec<String> {
    let motors = scenario.robot.iter().all(|robot| {
        let wheels = robot.platform.iter().flat_map(|platform| &platform.wheel);
        let mut driven = wheels.filter(|wheel| wheel.drive != Drive::None).peekable();
        driven.peek().is_some() && driven.all(|w| matches!(w.drive, Drive::DcMotor { .. }))
    });
    let mut drives = vec!["torque".to_owned()];
    if motors {
        drives.push("dc-motor".into());
    }
    drives
}
