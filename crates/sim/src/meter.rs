//! The meter: figures of merit of a run, from the rows on their way to the recorder.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::judge::Judge;
use crate::record::{Event, Header, RecordError, Recorder};
use crate::run::{Metric, StatisticsRow, StatisticsTable};
use crate::scenario::{Scenario, Terrain};

/// A recorder that passes everything on and measures on the way.
pub(crate) struct Meter<'a> {
    inner: &'a mut dyn Recorder,
    robots: Vec<Gauge>,
    differences: Vec<Vec<Spread>>,
}

/// Running mean and sum of squares of a difference of two columns (B. P. Welford, *Note on a method
/// for calculating corrected sums of squares and products*, Technometrics 4(3) 1962).
struct Spread {
    columns: [usize; 2],
    unit: String,
    count: u64,
    mean: f64,
    squares: f64,
}

impl Spread {
    fn add(&mut self, value: f64) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before * (value - self.mean);
    }

    /// Standard deviation of the values themselves.
    fn std(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}

/// Running figures of one robot, from the recorded rows.
#[derive(Default)]
struct Gauge {
    /// Columns of the forward and the left speed.
    speeds: Option<[usize; 2]>,
    /// Odometries whose error is told apart: name, columns of the whole error and of its causes, last
    /// values.
    odometries: Vec<(String, [usize; 5], [f64; 5])>,
    /// Column of the hitch angle of a trailer, and its largest size, rad.
    hitch: Option<(usize, f64)>,
    /// Column of the distance from the planned path.
    offset: Option<usize>,
    commands: Vec<(usize, &'static str)>,
    currents: Vec<usize>,
    torques: Vec<usize>,
    /// Each wheel, with the columns of longitudinal force, lateral force and load.
    forces: Vec<(String, [usize; 3])>,
    /// Columns of x and y.
    position: Option<[usize; 2]>,
    /// Column of the distance of the zero-moment point from the edge of the support.
    tip: Option<usize>,
    /// Columns of energy supplied, heat of windings and residual, with their last values.
    energies: Vec<(&'static str, usize, f64)>,
    /// Coefficient of friction of the ground, if it is known.
    friction: Option<f64>,
    /// Lowest load of a wheel, N, once loads are known.
    load: Option<f64>,
    /// Highest share of the friction limit, %.
    demand: f64,
    /// Lowest tip-over margin, m.
    margin: Option<f64>,
    /// Where a wheel first asked for more friction than there is, lifted, and the robot tipped.
    first_slip: Option<Place>,
    first_lift: Option<Place>,
    first_tip: Option<Place>,
    speed: f64,
    command_square: f64,
    command_peak: f64,
    torque_peak: f64,
    current_peak: f64,
    offset_square: f64,
    offset_peak: f64,
    rows: f64,
}

/// Where and when something happened first.
struct Place {
    t: f64,
    position: [f64; 2],
    /// The wheel; empty for the whole robot.
    wheel: String,
}

impl Place {
    /// As a note: `from 1.25 s at (0.50, 2.00), left`.
    fn note(&self) -> String {
        let wheel = match self.wheel.as_str() {
            "" => String::new(),
            wheel => format!(", {wheel}"),
        };
        let [x, y] = self.position;
        format!("from {:.2} s at ({x:.2}, {y:.2}){wheel}", self.t)
    }
}

/// The quotient, if it is a number.
fn divided(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    let quotient = a? / b?;
    quotient.is_finite().then_some(quotient)
}

impl<'a> Meter<'a> {
    /// Finds the columns of what it measures.
    pub(crate) fn new(inner: &'a mut dyn Recorder, scenario: &Scenario, header: &Header) -> Self {
        let robots = scenario
            .robot
            .iter()
            .map(|robot| {
                let friction = match scenario.terrain {
                    Terrain::Flat { friction, .. } | Terrain::Plane { friction, .. } => friction,
                };
                let mut gauge = Gauge {
                    friction,
                    ..Gauge::default()
                };
                let prefix = format!("robot.{}.", robot.name);
                for (k, signal) in header.signals.iter().enumerate() {
                    let Some(path) = signal.path.strip_prefix(&prefix) else {
                        continue;
                    };
                    match path {
                        // The speed to the left follows it.
                        "twist.forward" => gauge.speeds = Some([k, k + 1]),
                        "path.offset" => gauge.offset = Some(k),
                        // y follows x.
                        "pose.x" => gauge.position = Some([k, k + 1]),
                        "tip_margin" => gauge.tip = Some(k),
                        "wheel.trailer.steering_angle" => gauge.hitch = Some((k, 0.0)),
                        _ => {}
                    }
                    for known in ["energy.supplied", "energy.windings", "energy.residual"] {
                        if path == known {
                            gauge.energies.push((known, k, 0.0));
                        }
                    }
                    if let Some(sensor) = path
                        .strip_prefix("sensor.")
                        .and_then(|rest| rest.strip_suffix(".error.distance"))
                    {
                        let place = |cause: &str| {
                            let path = format!("{prefix}sensor.{sensor}.error.{cause}.distance");
                            header
                                .signals
                                .iter()
                                .position(|s| s.path == path)
                                .unwrap_or(k)
                        };
                        let [slip, method, geometry, encoder] = crate::sensor::CAUSES.map(place);
                        let columns = [k, slip, method, geometry, encoder];
                        gauge
                            .odometries
                            .push((sensor.to_owned(), columns, [0.0; 5]));
                    }
                    if path.starts_with("wheel.") {
                        for (ending, unit) in [
                            (".voltage", "V"),
                            (".torque_command", "N·m"),
                            (".rate_command", "rad/s"),
                        ] {
                            if path.ends_with(ending) {
                                gauge.commands.push((k, unit));
                            }
                        }
                        if path.ends_with(".current") {
                            gauge.currents.push(k);
                        }
                        if path.ends_with(".torque") {
                            gauge.torques.push(k);
                        }
                        if path.ends_with(".force.longitudinal") {
                            // The lateral force and the load follow it.
                            let wheel = path.split('.').nth(1).unwrap_or_default();
                            gauge.forces.push((wheel.to_owned(), [k, k + 1, k + 2]));
                        }
                    }
                }
                gauge
            })
            .collect();
        let column = |robot: &str, signal: &str| {
            let path = format!("robot.{robot}.{signal}");
            header.signals.iter().position(|s| s.path == path)
        };
        let mut differences = Vec::new();
        for wanted in scenario.statistics.iter() {
            differences.extend(wanted.difference.iter().map(|difference| {
                let spread = |signal: &String| {
                    let columns = [&difference.of, &difference.minus].map(|robot| {
                        column(robot, signal).expect("checked when the run was built")
                    });
                    Spread {
                        columns,
                        unit: header.signals[columns[0]].unit.clone(),
                        count: 0,
                        mean: 0.0,
                        squares: 0.0,
                    }
                };
                wanted.signals.iter().map(spread).collect()
            }));
        }
        Meter {
            inner,
            robots,
            differences,
        }
    }

    /// The tables that the scenario asks for.
    pub(crate) fn statistics(&self, scenario: &Scenario) -> Vec<StatisticsTable> {
        let Some(wanted) = &scenario.statistics else {
            return Vec::new();
        };
        let mut tables: Vec<StatisticsTable> = Vec::new();
        for (difference, spreads) in wanted.difference.iter().zip(&self.differences) {
            let rows = wanted.signals.iter().zip(spreads);
            tables.push(StatisticsTable {
                name: difference.name.clone(),
                samples: spreads[0].count,
                decimals: wanted.decimals,
                rows: rows
                    .map(|(signal, spread)| StatisticsRow {
                        signal: signal.clone(),
                        unit: spread.unit.clone(),
                        mean: Some(spread.mean),
                        std: Some(spread.std()),
                    })
                    .collect(),
            });
        }
        for ratio in &wanted.ratio {
            let row = |name: &str, signal: &String| {
                let table = tables.iter().find(|table| table.name == name);
                let rows = &table.expect("checked").rows;
                let row = rows.iter().find(|row| row.signal == *signal);
                row.expect("checked").clone()
            };
            let rows = ratio
                .signals
                .iter()
                .map(|signal| {
                    let (of, by) = (row(&ratio.of, signal), row(&ratio.by, signal));
                    StatisticsRow {
                        signal: signal.clone(),
                        unit: String::new(),
                        mean: divided(of.mean, by.mean),
                        std: divided(of.std, by.std),
                    }
                })
                .collect();
            tables.push(StatisticsTable {
                name: ratio.name.clone(),
                samples: 0,
                decimals: wanted.decimals,
                rows,
            });
        }
        tables
    }

    /// The figures of a robot, in the order in which they are shown.
    pub(crate) fn metrics(
        &self,
        robot: usize,
        judge: &Judge,
        scenario: &Scenario,
        end: f64,
    ) -> Vec<Metric> {
        let gauge = &self.robots[robot];
        let mut metrics = Vec::new();
        let mut add = |name: &str, value: f64, unit: &str, note: String| {
            metrics.push(Metric {
                name: name.into(),
                value,
                unit: unit.into(),
                note,
            });
        };
        add(
            "time",
            end,
            "s",
            format!("limit {} s", scenario.time.duration),
        );
        let judged: BTreeMap<&str, f64> = judge
            .metrics()
            .into_iter()
            .map(|(name, value, _)| (name, value))
            .collect();
        let beacon = judged
            .get("beacon clearance index")
            .and_then(|&k| scenario.arena.beacon.get(k as usize));
        let mut passed = 0;
        for (name, value, unit) in judge.metrics() {
            if name == "offset" {
                // One for each beacon of the chain, in order.
                let beacon = match scenario.robot[robot].task.as_ref() {
                    Some(crate::scenario::Task::Slalom { chain, .. }) => chain.get(passed).cloned(),
                    _ => None,
                };
                passed += 1;
                add(
                    &format!("offset at {}", beacon.unwrap_or_default()),
                    value,
                    unit,
                    String::new(),
                );
                continue;
            }
            let note = match name {
                "beacon clearance" => format!(
                    "{}, {:.2} s",
                    beacon.map_or("", |b| b.name.as_str()),
                    judged.get("beacon clearance time").copied().unwrap_or(0.0)
                ),
                "wall clearance" | "largest distance from route" => format!(
                    "{:.2} s",
                    judged
                        .get(format!("{name} time").as_str())
                        .copied()
                        .unwrap_or(0.0)
                ),
                "beacon clearance index"
                | "beacon clearance time"
                | "wall clearance time"
                | "largest distance from route time" => {
                    continue;
                }
                _ => String::new(),
            };
            add(name, value, unit, note);
        }
        let rows = gauge.rows.max(1.0);
        add("highest speed", gauge.speed, "m/s", String::new());
        if gauge.offset.is_some() {
            let note = format!("at most {:.1} mm", 1e3 * gauge.offset_peak);
            add(
                "cross-track error, RMS",
                (gauge.offset_square / rows).sqrt(),
                "m",
                note,
            );
        }
        if let Some((_, angle)) = gauge.hitch {
            let note = if angle > std::f64::consts::FRAC_PI_2 {
                "jackknifed: the trailer stands in its robot"
            } else {
                "the trailer is no part of the disc that must not touch"
            };
            add("largest hitch angle", angle.to_degrees(), "°", note.into());
        }
        for (sensor, _, errors) in &gauge.odometries {
            let [all, slip, method, geometry, encoder] = errors;
            let note = format!(
                "slip {slip:.4}, method {method:.4}, geometry {geometry:.4}, encoder {encoder:.4} m"
            );
            add(&format!("error of {sensor} at the end"), *all, "m", note);
        }
        if let Some((_, unit)) = gauge.commands.first() {
            let count = rows * gauge.commands.len() as f64;
            let note = format!("peak {:.4} {unit}", gauge.command_peak);
            add(
                "control effort, RMS",
                (gauge.command_square / count).sqrt(),
                unit,
                note,
            );
        }
        if !gauge.torques.is_empty() {
            add(
                "highest wheel torque",
                gauge.torque_peak,
                "N·m",
                String::new(),
            );
        }
        if !gauge.currents.is_empty() {
            add(
                "highest motor current",
                gauge.current_peak,
                "A",
                String::new(),
            );
        }
        let told = |place: &Option<Place>, what: &str, otherwise: String| match place {
            Some(place) => format!("{what} {}", place.note()),
            None => otherwise,
        };
        if let Some(load) = gauge.load {
            let note = told(&gauge.first_lift, "a wheel would lift", String::new());
            add("lowest wheel load", load, "N", note);
            if let Some(friction) = gauge.friction {
                let limit = format!("of μN, μ = {friction}");
                let note = told(&gauge.first_slip, "would slip", limit);
                add("highest friction used", gauge.demand, "%", note);
            }
        }
        if let Some(margin) = gauge.margin {
            let note = told(&gauge.first_tip, "would tip over", String::new());
            add("lowest tip-over margin", margin, "m", note);
        }
        let last = |key: &str| {
            let known = gauge.energies.iter().find(|(name, ..)| *name == key);
            known.map(|&(_, _, value)| value)
        };
        if let Some(supplied) = last("energy.supplied") {
            let heat = last("energy.windings").unwrap_or(0.0);
            let note = if gauge.currents.is_empty() {
                String::new()
            } else {
                format!("heat in windings {heat:.3} J")
            };
            add("energy supplied", supplied, "J", note);
            add(
                "energy ledger residual",
                last("energy.residual").unwrap_or(0.0),
                "J",
                String::new(),
            );
        }
        metrics
    }
}

impl Recorder for Meter<'_> {
    fn begin(&mut self, header: &Header) -> Result<(), RecordError> {
        self.inner.begin(header)
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        for spread in self.differences.iter_mut().flatten() {
            let [of, minus] = spread.columns;
            spread.add(row[of] - row[minus]);
        }
        for gauge in &mut self.robots {
            gauge.rows += 1.0;
            if let Some([forward, left]) = gauge.speeds {
                let speed = crate::plant::speed(row[forward], row[left]);
                gauge.speed = gauge.speed.max(speed);
            }
            if let Some((k, largest)) = &mut gauge.hitch {
                *largest = largest.max(row[*k].abs());
            }
            for (_, columns, last) in &mut gauge.odometries {
                *last = columns.map(|k| row[k]);
            }
            if let Some(k) = gauge.offset {
                gauge.offset_square += row[k] * row[k];
                gauge.offset_peak = gauge.offset_peak.max(row[k].abs());
            }
            for (_, k, last) in &mut gauge.energies {
                *last = row[*k];
            }
            for &(k, _) in &gauge.commands {
                gauge.command_square += row[k] * row[k];
                gauge.command_peak = gauge.command_peak.max(row[k].abs());
            }
            let position = gauge.position.map_or([0.0; 2], |at| at.map(|k| row[k]));
            // Nothing is allocated but for what happens for the first time.
            let here = |wheel: &str| Place {
                t,
                position,
                wheel: wheel.to_owned(),
            };
            // Without three contacts the loads are not known, and all are zero.
            let known = gauge
                .forces
                .iter()
                .any(|(_, columns)| row[columns[2]] != 0.0);
            for (wheel, columns) in gauge.forces.iter().filter(|_| known) {
                let [along, across, load] = columns.map(|k| row[k]);
                gauge.load = Some(gauge.load.map_or(load, |lowest| lowest.min(load)));
                if load < 0.0 && gauge.first_lift.is_none() {
                    gauge.first_lift = Some(here(wheel));
                }
                if let Some(friction) = gauge.friction {
                    let force = crate::plant::speed(along, across);
                    // A wheel that just touches needs no friction for a force that is rounding.
                    let share = if force < 1e-9 {
                        0.0
                    } else {
                        100.0 * force / (friction * load).max(1e-9)
                    };
                    gauge.demand = gauge.demand.max(share.min(1e6));
                    if share > 100.0 && gauge.first_slip.is_none() {
                        gauge.first_slip = Some(here(wheel));
                    }
                }
            }
            if let Some(margin) = gauge.tip.map(|k| row[k]) {
                gauge.margin = Some(gauge.margin.map_or(margin, |lowest| lowest.min(margin)));
                if margin < 0.0 && gauge.first_tip.is_none() {
                    gauge.first_tip = Some(here(""));
                }
            }
            for &k in &gauge.torques {
                gauge.torque_peak = gauge.torque_peak.max(row[k].abs());
            }
            for &k in &gauge.currents {
                gauge.current_peak = gauge.current_peak.max(row[k].abs());
            }
        }
        self.inner.frame(t, row)
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.inner.event(event)
    }

    fn finish(&mut self, summary: &Value) -> Result<(), RecordError> {
        self.inner.finish(summary)
    }
}
