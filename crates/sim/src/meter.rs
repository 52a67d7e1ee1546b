//! The meter: figures of merit of a run, from the rows on their way to the recorder.

use std::collections::BTreeMap;

use appell_model::scalar::{Mask, Scalar};
use appell_model::wide::{Job, widest};

use crate::judge::Judge;
use crate::run::{StatisticsRow, StatisticsTable};
use crate::scenario::Scenario;
use crate::signal::Signal;

/// Measures runs in lanes.
pub(crate) struct Meter<T> {
    robots: Vec<Gauge<T>>,
    differences: Vec<Vec<Spread<T>>>,
}

/// A figure of a run with its unit and, where there is one, a remark.
pub(crate) struct Figure<S> {
    pub name: String,
    pub value: S,
    pub unit: String,
    pub note: String,
}

/// Running mean and sum of squares of a difference of two columns (B. P. Welford, *Note on a method
/// for calculating corrected sums of squares and products*, Technometrics 4(3) 1962).
struct Spread<T> {
    columns: [usize; 2],
    unit: String,
    count: T,
    mean: T,
    squares: T,
}

impl<T: Scalar> Spread<T> {
    fn add(&mut self, value: T, of: T::Mask) {
        let count = self.count + T::one();
        let before = value - self.mean;
        let mean = self.mean + before / count;
        let squares = self.squares + before * (value - mean);
        self.count = T::select(of, count, self.count);
        self.mean = T::select(of, mean, self.mean);
        self.squares = T::select(of, squares, self.squares);
    }

    /// Standard deviation of the values themselves.
    fn std(&self) -> T {
        (self.squares / self.count.max(T::one())).sqrt()
    }
}

/// Running figures of one robot, from the recorded rows.
struct Gauge<T> {
    /// Columns of the forward and the left speed.
    speeds: Option<[usize; 2]>,
    /// Odometries whose error is told apart: name, columns of the whole error and of its causes, last
    /// values.
    odometries: Vec<(String, [usize; 5], [T; 5])>,
    /// Column of the hitch angle of a trailer, and its largest size, rad.
    hitch: Option<(usize, T)>,
    /// Column of the distance from the planned path.
    offset: Option<usize>,
    commands: Vec<(usize, &'static str)>,
    currents: Vec<usize>,
    torques: Vec<usize>,
    /// Each wheel, with the columns of longitudinal force, lateral force and load.
    forces: Vec<(String, [usize; 3])>,
    /// Where wheels may slip: which of those, with the column of the friction that it uses.
    used: Vec<(usize, usize)>,
    /// Columns of x and y.
    position: Option<[usize; 2]>,
    /// Column of the distance of the zero-moment point from the edge of the support.
    tip: Option<usize>,
    /// Columns of energy supplied, heat of windings and residual, with their last values.
    energies: Vec<(&'static str, usize, T)>,
    /// Coefficient of friction of the ground, if it is known.
    friction: Option<f64>,
    /// Whether the ground has patches, which only contacts know.
    passes_patches: bool,
    /// Lowest load of a wheel, N; infinite until loads are known.
    load: T,
    /// Highest share of the friction limit, %.
    demand: T,
    /// Lowest tip-over margin, m; infinite until it is known.
    margin: T,
    /// Where, in each lane, a wheel first asked for more friction than there is, lifted, and the
    /// robot tipped.
    first_slip: Vec<Option<Place>>,
    first_lift: Vec<Option<Place>>,
    first_tip: Vec<Option<Place>>,
    /// Whether that was told.
    tip_told: bool,
    speed: T,
    command_square: T,
    command_peak: T,
    torque_peak: T,
    current_peak: T,
    offset_square: T,
    offset_peak: T,
    rows: T,
}

impl<T: Scalar> Gauge<T> {
    fn new(friction: Option<f64>) -> Self {
        let (zero, endless) = (T::zero(), T::from(f64::INFINITY));
        let nowhere = || (0..T::LANES).map(|_| None).collect();
        Gauge {
            speeds: None,
            odometries: Vec::new(),
            hitch: None,
            offset: None,
            commands: Vec::new(),
            currents: Vec::new(),
            torques: Vec::new(),
            forces: Vec::new(),
            used: Vec::new(),
            position: None,
            tip: None,
            energies: Vec::new(),
            friction,
            passes_patches: false,
            load: endless,
            demand: zero,
            margin: endless,
            first_slip: nowhere(),
            first_lift: nowhere(),
            first_tip: nowhere(),
            tip_told: false,
            speed: zero,
            command_square: zero,
            command_peak: zero,
            torque_peak: zero,
            current_peak: zero,
            offset_square: zero,
            offset_peak: zero,
            rows: zero,
        }
    }

    /// Forgets what was measured in a lane.
    fn clear(&mut self, lane: usize) {
        let zero = |number: &mut T| set(number, lane, 0.0);
        for (.., last) in &mut self.odometries {
            last.iter_mut().for_each(zero);
        }
        if let Some((_, largest)) = &mut self.hitch {
            zero(largest);
        }
        for (.., last) in &mut self.energies {
            zero(last);
        }
        for number in [
            &mut self.demand,
            &mut self.speed,
            &mut self.command_square,
            &mut self.command_peak,
            &mut self.torque_peak,
            &mut self.current_peak,
            &mut self.offset_square,
            &mut self.offset_peak,
            &mut self.rows,
        ] {
            zero(number);
        }
        set(&mut self.load, lane, f64::INFINITY);
        set(&mut self.margin, lane, f64::INFINITY);
        self.first_slip[lane] = None;
        self.first_lift[lane] = None;
        self.first_tip[lane] = None;
    }

    /// Takes a row of these lanes.
    #[inline(always)]
    fn add(&mut self, t: T, row: &[T], of: T::Mask) {
        self.rows = T::select(of, self.rows + T::one(), self.rows);
        if let Some([forward, left]) = self.speeds {
            highest(
                &mut self.speed,
                crate::plant::speed(row[forward], row[left]),
                of,
            );
        }
        if let Some((k, largest)) = &mut self.hitch {
            highest(largest, row[*k], of);
        }
        for (_, columns, last) in &mut self.odometries {
            for part in 0..5 {
                last[part] = T::select(of, row[columns[part]], last[part]);
            }
        }
        if let Some(k) = self.offset {
            let sum = self.offset_square + row[k] * row[k];
            self.offset_square = T::select(of, sum, self.offset_square);
            highest(&mut self.offset_peak, row[k], of);
        }
        for (_, k, last) in &mut self.energies {
            *last = T::select(of, row[*k], *last);
        }
        for &(k, _) in &self.commands {
            let sum = self.command_square + row[k] * row[k];
            self.command_square = T::select(of, sum, self.command_square);
            highest(&mut self.command_peak, row[k], of);
        }
        for &k in &self.torques {
            highest(&mut self.torque_peak, row[k], of);
        }
        for &k in &self.currents {
            highest(&mut self.current_peak, row[k], of);
        }
        self.watch_contacts(t, row, of);
    }

    #[inline(always)]
    fn watch_contacts(&mut self, t: T, row: &[T], of: T::Mask) {
        // Without three contacts the loads are not known, and all are zero.
        let mut known = T::Mask::splat(false);
        for k in 0..self.forces.len() {
            known = known.or(T::zero().less(row[self.forces[k].1[2]].abs()));
        }
        let known = known.and(of);
        if known.any() {
            for wheel in 0..self.forces.len() {
                let [along, across, load] = self.forces[wheel].1;
                let load = row[load];
                self.load = T::select(known, self.load.min(load), self.load);
                // Where wheels may slip those that would pull have lifted, and carry nothing.
                let lifts = if self.used.is_empty() {
                    known.and(load.less(T::zero()))
                } else {
                    known.and(load.less_equal(T::zero()))
                };
                if lifts.any() {
                    note(&mut self.first_lift, lifts, wheel, t, row, self.position);
                }
                if let Some(friction) = self.friction
                    && self.used.is_empty()
                {
                    let force = crate::plant::speed(row[along], row[across]);
                    // A wheel that just touches needs no friction for a force that is rounding.
                    let limit = (T::from(friction) * load).max(T::from(1e-9));
                    let slight = force.less(T::from(1e-9));
                    let share = T::select(slight, T::zero(), T::from(100.0) * force / limit);
                    let most = self.demand.max(share.min(T::from(1e6)));
                    self.demand = T::select(known, most, self.demand);
                    let slips = known.and(T::from(100.0).less(share));
                    if slips.any() {
                        note(&mut self.first_slip, slips, wheel, t, row, self.position);
                    }
                }
            }
        }
        for k in 0..self.used.len() {
            let (wheel, column) = self.used[k];
            let share = T::from(100.0) * row[column];
            self.demand = T::select(of, self.demand.max(share), self.demand);
            // Sliding is approached, and reached within rounding.
            let slides = of.and(T::from(99.999).less(share));
            if slides.any() {
                note(&mut self.first_slip, slides, wheel, t, row, self.position);
            }
        }
        if let Some(k) = self.tip {
            let margin = row[k];
            self.margin = T::select(of, self.margin.min(margin), self.margin);
            let tips = of.and(margin.less(T::zero()));
            if tips.any() {
                note(&mut self.first_tip, tips, usize::MAX, t, row, self.position);
            }
        }
    }
}

/// Raises a peak to the size of a value in some lanes.
#[inline(always)]
fn highest<T: Scalar>(peak: &mut T, value: T, of: T::Mask) {
    *peak = T::select(of, peak.max(value.abs()), *peak);
}

/// Keeps where something happened first, in each lane. Allocates nothing.
fn note<T: Scalar>(
    first: &mut [Option<Place>],
    happened: T::Mask,
    wheel: usize,
    t: T,
    row: &[T],
    position: Option<[usize; 2]>,
) {
    for (lane, first) in first.iter_mut().enumerate() {
        if happened.lane(lane) && first.is_none() {
            *first = Some(Place {
                t: t.lane(lane),
                position: position.map_or([0.0; 2], |at| at.map(|k| row[k].lane(lane))),
                wheel,
            });
        }
    }
}

/// Puts a value into a lane.
fn set<T: Scalar>(number: &mut T, lane: usize, value: f64) {
    let before = *number;
    *number = T::from_lanes(|i| if i == lane { value } else { before.lane(i) });
}

/// Where and when something happened first.
struct Place {
    t: f64,
    position: [f64; 2],
    /// The wheel, of those with forces; none for the whole robot.
    wheel: usize,
}

impl Place {
    /// As a note: `from 1.25 s at (0.50, 2.00), left`.
    fn note(&self, wheels: &[(String, [usize; 3])]) -> String {
        let wheel = match wheels.get(self.wheel) {
            None => String::new(),
            Some((wheel, _)) => format!(", {wheel}"),
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

impl Meter<f64> {
    /// The next robot that began to tip and was not told of: its place in the scenario, when, s, and
    /// where, m.
    pub(crate) fn next_tip(&mut self) -> Option<(usize, f64, [f64; 2])> {
        let mut gauges = self.robots.iter_mut().enumerate();
        let (k, gauge) = gauges.find(|(_, g)| !g.tip_told && g.first_tip[0].is_some())?;
        gauge.tip_told = true;
        let place = gauge.first_tip[0].as_ref()?;
        Some((k, place.t, place.position))
    }
}

impl<T: Scalar> Meter<T> {
    /// Finds the columns of what it measures.
    pub(crate) fn new(scenario: &Scenario, signals: &[Signal]) -> Self {
        let robots = scenario
            .robot
            .iter()
            .map(|robot| {
                let mut gauge = Gauge::new(scenario.terrain.friction());
                gauge.passes_patches = !scenario.terrain.patches().is_empty();
                let prefix = format!("robot.{}.", robot.name);
                // Of models that take turns not all know forces, commands of drives and energies.
                let is_one = robot.model.is_empty();
                for (k, signal) in signals.iter().enumerate() {
                    let Some(path) = signal.path.strip_prefix(&prefix) else {
                        continue;
                    };
                    match path {
                        // The speed to the left follows it.
                        "twist.forward" => gauge.speeds = Some([k, k + 1]),
                        "path.offset" => gauge.offset = Some(k),
                        // y follows x.
                        "pose.x" => gauge.position = Some([k, k + 1]),
                        "tip_margin" if is_one => gauge.tip = Some(k),
                        "wheel.trailer.steering_angle" => gauge.hitch = Some((k, T::zero())),
                        _ => {}
                    }
                    for known in ["energy.supplied", "energy.windings", "energy.residual"] {
                        if path == known && is_one {
                            gauge.energies.push((known, k, T::zero()));
                        }
                    }
                    if let Some(sensor) = path
                        .strip_prefix("sensor.")
                        .and_then(|rest| rest.strip_suffix(".error.distance"))
                    {
                        let place = |cause: &str| {
                            let path = format!("{prefix}sensor.{sensor}.error.{cause}.distance");
                            signals.iter().position(|s| s.path == path).unwrap_or(k)
                        };
                        let [slip, method, geometry, encoder] = crate::sensor::CAUSES.map(place);
                        let columns = [k, slip, method, geometry, encoder];
                        gauge
                            .odometries
                            .push((sensor.to_owned(), columns, [T::zero(); 5]));
                    }
                    if path.starts_with("wheel.") && is_one {
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
                        if path.ends_with(".friction_use") {
                            // Behind the forces.
                            let wheel = path.split('.').nth(1).unwrap_or_default();
                            let place = gauge.forces.iter().position(|(name, _)| name == wheel);
                            gauge.used.extend(place.map(|place| (place, k)));
                        }
                    }
                }
                gauge
            })
            .collect();
        let column = |robot: &str, signal: &str| {
            let path = format!("robot.{robot}.{signal}");
            signals.iter().position(|s| s.path == path)
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
                        unit: signals[columns[0]].unit.clone(),
                        count: T::zero(),
                        mean: T::zero(),
                        squares: T::zero(),
                    }
                };
                wanted.signals.iter().map(spread).collect()
            }));
        }
        Meter {
            robots,
            differences,
        }
    }

    /// Forgets what was measured in a lane.
    pub(crate) fn clear(&mut self, lane: usize) {
        for gauge in &mut self.robots {
            gauge.clear(lane);
        }
        for spread in self.differences.iter_mut().flatten() {
            set(&mut spread.count, lane, 0.0);
            set(&mut spread.mean, lane, 0.0);
            set(&mut spread.squares, lane, 0.0);
        }
    }

    /// Takes a row of these lanes, at their times, s.
    pub(crate) fn add(&mut self, t: T, row: &[T], of: T::Mask) {
        widest::<T, _>(Add {
            meter: self,
            t,
            row,
            of,
        });
    }

    /// The tables that the scenario asks for.
    pub(crate) fn statistics(&self, lane: usize, scenario: &Scenario) -> Vec<StatisticsTable> {
        let Some(wanted) = &scenario.statistics else {
            return Vec::new();
        };
        let mut tables: Vec<StatisticsTable> = Vec::new();
        for (difference, spreads) in wanted.difference.iter().zip(&self.differences) {
            let rows = wanted.signals.iter().zip(spreads);
            tables.push(StatisticsTable {
                name: difference.name.clone(),
                samples: spreads[0].count.lane(lane) as u64,
                decimals: wanted.decimals,
                rows: rows
                    .map(|(signal, spread)| StatisticsRow {
                        signal: signal.clone(),
                        unit: spread.unit.clone(),
                        mean: Some(spread.mean.lane(lane)),
                        std: Some(spread.std().lane(lane)),
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
        lane: usize,
        judge: &Judge<T::Single>,
        scenario: &Scenario,
        end: f64,
    ) -> Vec<Figure<T::Single>> {
        type Number<T> = <T as Scalar>::Single;
        let gauge = &self.robots[robot];
        let mut metrics = Vec::new();
        let of = |number: T| number.single(lane);
        let plain = |number: T| number.lane(lane);
        let mut add = |name: &str, value: Number<T>, unit: &str, note: String| {
            metrics.push(Figure {
                name: name.into(),
                value,
                unit: unit.into(),
                note,
            });
        };
        add(
            "time",
            Number::<T>::from(end),
            "s",
            format!("limit {} s", scenario.time.duration),
        );
        let judged: BTreeMap<&str, f64> = judge
            .metrics()
            .into_iter()
            .map(|(name, value, _)| (name, value.lane(0)))
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
        let rows = gauge.rows.max(T::one());
        add("highest speed", of(gauge.speed), "m/s", String::new());
        if gauge.offset.is_some() {
            let note = format!("at most {:.1} mm", 1e3 * plain(gauge.offset_peak));
            add(
                "cross-track error, RMS",
                of((gauge.offset_square / rows).sqrt()),
                "m",
                note,
            );
        }
        if let Some((_, angle)) = gauge.hitch {
            let note = if plain(angle) > std::f64::consts::FRAC_PI_2 {
                "jackknifed: the trailer stands in its robot"
            } else {
                "the trailer is no part of the disc that must not touch"
            };
            let degrees = angle * T::from(180.0 / std::f64::consts::PI);
            add("largest hitch angle", of(degrees), "°", note.into());
        }
        for (sensor, _, errors) in &gauge.odometries {
            let [_, slip, method, geometry, encoder] = errors.map(plain);
            let all = of(errors[0]);
            let note = format!(
                "slip {slip:.4}, method {method:.4}, geometry {geometry:.4}, encoder {encoder:.4} m"
            );
            add(&format!("error of {sensor} at the end"), all, "m", note);
        }
        if let Some((_, unit)) = gauge.commands.first() {
            let count = rows * T::from(gauge.commands.len() as f64);
            let note = format!("peak {:.4} {unit}", plain(gauge.command_peak));
            add(
                "control effort, RMS",
                of((gauge.command_square / count).sqrt()),
                unit,
                note,
            );
        }
        if !gauge.torques.is_empty() {
            add(
                "highest wheel torque",
                of(gauge.torque_peak),
                "N·m",
                String::new(),
            );
        }
        if !gauge.currents.is_empty() {
            add(
                "highest motor current",
                of(gauge.current_peak),
                "A",
                String::new(),
            );
        }
        let told = |places: &[Option<Place>], what: &str, otherwise: String| match &places[lane] {
            Some(place) => format!("{what} {}", place.note(&gauge.forces)),
            None => otherwise,
        };
        if plain(gauge.load) < f64::INFINITY {
            let slips = !gauge.used.is_empty();
            let lifts = if slips {
                "a wheel lifts"
            } else {
                "a wheel would lift"
            };
            let note = told(&gauge.first_lift, lifts, String::new());
            add("lowest wheel load", of(gauge.load), "N", note);
            if slips {
                let limit = "of what the contact gives".to_owned();
                let note = told(&gauge.first_slip, "slides", limit);
                add("highest friction used", of(gauge.demand), "%", note);
            } else if let Some(friction) = gauge.friction {
                let limit = if gauge.passes_patches {
                    format!("of μN, μ = {friction}, patches left out")
                } else {
                    format!("of μN, μ = {friction}")
                };
                let note = told(&gauge.first_slip, "would slip", limit);
                add("highest friction used", of(gauge.demand), "%", note);
            }
        }
        if plain(gauge.margin) < f64::INFINITY {
            let note = told(&gauge.first_tip, "would tip over", String::new());
            add("lowest tip-over margin", of(gauge.margin), "m", note);
        }
        let last = |key: &str| {
            let known = gauge.energies.iter().find(|(name, ..)| *name == key);
            known.map(|&(_, _, value)| value)
        };
        if let Some(supplied) = last("energy.supplied") {
            let heat = last("energy.windings").map_or(0.0, plain);
            let note = if gauge.currents.is_empty() {
                String::new()
            } else {
                format!("heat in windings {heat:.3} J")
            };
            add("energy supplied", of(supplied), "J", note);
            add(
                "energy ledger residual",
                of(last("energy.residual").unwrap_or(T::zero())),
                "J",
                String::new(),
            );
        }
        metrics
    }
}

struct Add<'a, T: Scalar> {
    meter: &'a mut Meter<T>,
    t: T,
    row: &'a [T],
    of: T::Mask,
}

impl<T: Scalar> Job for Add<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for spread in self.meter.differences.iter_mut().flatten() {
            let [of, minus] = spread.columns;
            spread.add(self.row[of] - self.row[minus], self.of);
        }
        for gauge in &mut self.meter.robots {
            gauge.add(self.t, self.row, self.of);
        }
    }
}
