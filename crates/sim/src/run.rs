//! A run: a scenario becomes a world, the world steps, recorders listen, and a summary remains.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::block::Block;
use crate::build;
use crate::controller::{PathFollower, Signals, Waveform, read_table};
use crate::judge::{Judge, Verdict};
use crate::layout::{Goal, Layout};
use crate::plan::{self, Path};
use crate::plant::{Numerics, Plant, Start, command_signal};
use crate::record::{Event, Header, RecordError, Recorder};
use crate::scenario::{
    Controller, Diagnostic, Diagnostics, Drive, Level, Loaded, Robot, Scenario, Sensor, Signal,
    Steering, Terrain, Wheel,
};
use crate::servo::Servo;
use crate::world::{RobotBlocks, SimError, World};

/// How a run ended.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// Every task was passed.
    Passed,
    /// A task failed, or time ran out before it was passed.
    Failed,
    /// There was no task, or the run was broken off.
    Stopped,
}

/// A number with its unit and, where there is one, a remark.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Metric {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit; empty for pure numbers.
    pub unit: String,
    /// Remark, such as where or when.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}

/// What became of one robot.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct RobotSummary {
    /// Name.
    pub name: String,
    /// Verdict on its task.
    pub verdict: Outcome,
    /// One sentence.
    pub reason: String,
    /// Kind of its task, or `none`.
    pub task: String,
    /// Level of the model.
    pub level: Level,
    /// Drive: `rate`, `torque` or `dc-motor`.
    pub drive: String,
    /// Method of integration.
    pub integrator: String,
    /// Metrics, in order.
    pub metrics: Vec<Metric>,
}

/// `summary.json`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Summary {
    /// Verdict on the run.
    pub verdict: Outcome,
    /// One sentence.
    pub reason: String,
    /// Name of the scenario.
    pub scenario: String,
    /// SHA-256 of the resolved scenario.
    pub hash: String,
    /// Seed.
    pub seed: u64,
    /// Version of the program.
    pub version: String,
    /// Time at the end, s.
    pub duration: f64,
    /// What broke the run off, if anything did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// The robots.
    pub robots: Vec<RobotSummary>,
}

/// A world together with what describes it.
pub struct Run {
    /// The world.
    pub world: World,
    /// What recordings of it begin with.
    pub header: Header,
    /// Planned path of each robot that follows one.
    pub paths: Vec<Option<Path>>,
    /// Goal of each robot.
    pub goals: Vec<Option<Goal>>,
    scenario: Scenario,
    integrators: Vec<String>,
}

/// SHA-256 of a text, in hexadecimal.
pub fn hash(text: &str) -> String {
    use sha2::Digest;
    let digest = sha2::Sha256::digest(text.as_bytes());
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn refuse(loaded: &Loaded, path: String, problem: String, hint: String) -> Diagnostics {
    Diagnostics(vec![Diagnostic {
        file: loaded.file.clone(),
        at: None,
        path,
        problem,
        hint: Some(hint),
    }])
}

impl Run {
    /// Builds the world of a checked scenario, for a trial of its seed.
    pub fn new(loaded: &Loaded, trial: u64) -> Result<Run, Diagnostics> {
        let scenario = &loaded.scenario;
        let step = scenario.time.step;
        let ticks = |period: f64| -> u64 { (period / step).round().max(1.0) as u64 };
        let ground = build::ground(&scenario.terrain);
        let key = (scenario.seed, trial);
        let mut robots = Vec::new();
        let (mut paths, mut goals, mut integrators) = (Vec::new(), Vec::new(), Vec::new());
        for robot in &scenario.robot {
            let file = robot
                .platform
                .as_ref()
                .expect("a checked scenario has platforms");
            let platform = build::platform(file, build::drive_model(robot), ground.gravity_normal)
                .expect("a checked platform can be built");
            let angles: Vec<f64> = file
                .wheel
                .iter()
                .filter_map(|wheel| match wheel.steering {
                    Steering::Free { angle_deg, .. } => Some(angle_deg.to_radians()),
                    Steering::Fixed { .. } => None,
                })
                .collect();
            let start = Start {
                pose: robot.pose,
                twist: robot.twist,
                angles: &angles,
            };
            let plant = Plant::new(
                &robot.name,
                platform.clone(),
                ground,
                robot.level,
                Numerics {
                    integrator: scenario.time.integrator,
                    step,
                    tolerance: scenario.time.tolerance,
                },
                start,
            )
            .map_err(|error| {
                let path = if error.field.contains('.') {
                    error.field.to_owned()
                } else {
                    format!("robot.{}.{}", robot.name, error.field)
                };
                refuse(loaded, path, error.problem, error.hint)
            })?;
            integrators.push(plant.integrator());
            let layout = build::layout(scenario, robot);
            let goal = robot.task.as_ref().map(|task| build::goal(scenario, task));
            let sensors = robot
                .sensor
                .iter()
                .map(|sensor| {
                    let block = crate::sensor::build(
                        sensor,
                        &robot.name,
                        &platform,
                        &layout.beacons,
                        robot.pose,
                        key,
                    );
                    (block, ticks(sensor_period(sensor)))
                })
                .collect();
            let mut controllers: Vec<(Box<dyn Block>, u64)> = Vec::new();
            let mut path = None;
            let mut judge_period: f64 = 0.01;
            match &robot.controller {
                None => {}
                Some(
                    Controller::Homing(tuning)
                    | Controller::Gate(tuning)
                    | Controller::Eight(tuning)
                    | Controller::Slalom(tuning),
                ) => {
                    let goal = goal.as_ref().expect("a checked follower has a task");
                    let planned = plan::plan(&layout, goal).map_err(|error| {
                        let path = format!("robot.{}.task", robot.name);
                        refuse(
                            loaded,
                            path,
                            format!("cannot be solved: {}", error.reason),
                            error.hint,
                        )
                    })?;
                    let follower = PathFollower::new(&robot.name, planned.clone(), tuning);
                    path = Some(planned);
                    controllers.push((Box::new(follower), ticks(tuning.period)));
                    let period = robot.servo.period.unwrap_or(tuning.period);
                    let servo = Servo::new(&robot.name, &platform, &robot.servo, period);
                    controllers.push((Box::new(servo), ticks(period)));
                    judge_period = judge_period.min(tuning.period);
                }
                Some(Controller::Signals { period, channel }) => {
                    let mut twisted = false;
                    let channels = channel
                        .iter()
                        .map(|channel| {
                            twisted |=
                                ["forward", "left", "yaw_rate"].contains(&channel.to.as_str());
                            let waveform = match &channel.signal {
                                Signal::Table { file, column } => {
                                    let table = read_table(&loaded.folder.join(file), column);
                                    let (times, values) = table.map_err(|problem| {
                                        let path = format!(
                                            "robot.{}.controller.channel.{}",
                                            robot.name, channel.to
                                        );
                                        refuse(
                                            loaded,
                                            path,
                                            problem,
                                            "the file changed while it was read".into(),
                                        )
                                    })?;
                                    Waveform::Table { times, values }
                                }
                                formula => Waveform::Formula(formula.clone()),
                            };
                            Ok((channel_port(&channel.to, &robot.name, &platform), waveform))
                        })
                        .collect::<Result<Vec<_>, Diagnostics>>()?;
                    controllers.push((Box::new(Signals::new(channels)), ticks(*period)));
                    if twisted {
                        let period = robot.servo.period.unwrap_or(*period);
                        let servo = Servo::new(&robot.name, &platform, &robot.servo, period);
                        controllers.push((Box::new(servo), ticks(period)));
                    }
                }
            }
            robots.push(RobotBlocks {
                name: robot.name.clone(),
                sensors,
                controllers,
                plant: Box::new(plant),
                judge: Judge::new(&layout, goal.as_ref()),
                layout,
                has_task: goal.is_some(),
                judge_period: ticks(judge_period),
            });
            paths.push(path);
            goals.push(goal);
        }
        let end = ticks(scenario.time.duration);
        let world = World::wire(step, end, ticks(scenario.record.period), robots);
        let header = Header {
            scenario: scenario.name.clone(),
            scenario_text: loaded.resolved.clone(),
            hash: hash(&loaded.resolved),
            seed: scenario.seed,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            step,
            period: scenario.record.period,
            signals: world.signals().to_vec(),
            extra: drawing(scenario, &paths, &goals, &integrators),
        };
        Ok(Run {
            world,
            header,
            paths,
            goals,
            scenario: scenario.clone(),
            integrators,
        })
    }

    /// Steps to the end, into `recorder`; `progress` is told the time now and then.
    pub fn execute(
        &mut self,
        recorder: &mut dyn Recorder,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Summary, SimError> {
        let mut meter = Meter::new(recorder, &self.scenario, &self.header);
        meter.begin(&self.header)?;
        let result = loop {
            match self.world.step(&mut meter) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(error) => break Err(error),
            }
            if self.world.tick().is_multiple_of(1024) {
                progress(self.world.now());
            }
        };
        let summary = self.summary(&meter, result.as_ref().err());
        let text = serde_json::to_value(&summary).expect("a summary is plain data");
        match result {
            Ok(()) => {
                meter.finish(&text)?;
                Ok(summary)
            }
            Err(error @ SimError::Record(_)) => Err(error),
            // What was recorded until the failure is closed in order.
            Err(_) => {
                meter.finish(&text)?;
                Ok(summary)
            }
        }
    }

    fn summary(&self, meter: &Meter<'_>, error: Option<&SimError>) -> Summary {
        let robots: Vec<RobotSummary> = self
            .scenario
            .robot
            .iter()
            .zip(&self.world.referees)
            .zip(&self.integrators)
            .enumerate()
            .map(|(k, ((robot, referee), integrator))| {
                let (verdict, reason) = match (referee.has_task, referee.judge.verdict()) {
                    (_, Verdict::Failed) if referee.has_task => {
                        (Outcome::Failed, referee.judge.reason())
                    }
                    (true, Verdict::Passed) => (Outcome::Passed, referee.judge.reason()),
                    (true, _) => (
                        Outcome::Failed,
                        format!(
                            "time was up after {} s: {}",
                            self.scenario.time.duration,
                            referee.judge.timeout_reason()
                        ),
                    ),
                    (false, _) => (
                        Outcome::Stopped,
                        format!("ran {:.6} s without a task", self.world.now())
                            .replace(".000000", ""),
                    ),
                };
                RobotSummary {
                    name: robot.name.clone(),
                    verdict,
                    reason,
                    task: task_name(self.goals[k].as_ref()).into(),
                    level: robot.level,
                    drive: drive_name(robot).into(),
                    integrator: integrator.clone(),
                    metrics: meter.metrics(k, &referee.judge, &self.scenario, self.world.now()),
                }
            })
            .collect();
        let (verdict, reason) = match error {
            Some(error) => (Outcome::Stopped, error.to_string()),
            None => overall(&robots),
        };
        Summary {
            verdict,
            reason,
            scenario: self.scenario.name.clone(),
            hash: self.header.hash.clone(),
            seed: self.scenario.seed,
            version: self.header.version.clone(),
            duration: self.world.now(),
            error: error.map(ToString::to_string),
            robots,
        }
    }
}

/// The verdict on all robots together.
fn overall(robots: &[RobotSummary]) -> (Outcome, String) {
    let worst = robots
        .iter()
        .find(|r| r.verdict == Outcome::Failed)
        .or_else(|| robots.iter().find(|r| r.verdict == Outcome::Passed))
        .unwrap_or(&robots[0]);
    let reason = if robots.len() == 1 {
        worst.reason.clone()
    } else {
        let passed = robots
            .iter()
            .filter(|r| r.verdict == Outcome::Passed)
            .count();
        format!(
            "{passed} of {} robots passed; {}: {}",
            robots.len(),
            worst.name,
            worst.reason
        )
    };
    (worst.verdict, reason)
}

fn sensor_period(sensor: &Sensor) -> f64 {
    match sensor {
        Sensor::Pose { period, .. }
        | Sensor::Encoder { period, .. }
        | Sensor::Odometry { period, .. }
        | Sensor::RangeBearing { period, .. } => *period,
    }
}

fn channel_port(
    to: &str,
    robot: &str,
    platform: &appell_model::platform::Platform<f64>,
) -> crate::signal::Signal {
    let named = |path: String, unit: &str| {
        crate::signal::Signal::new(format!("robot.{robot}.{path}"), unit)
    };
    match to {
        "forward" | "left" => named(format!("command.{to}"), "m/s"),
        "yaw_rate" => named("command.yaw_rate".into(), "rad/s"),
        "brake" => named("brake".into(), "1"),
        wheel => {
            let name = wheel.trim_start_matches("wheel.");
            let found = platform.wheels().iter().find(|w| w.name == name);
            let (field, unit) = found
                .and_then(|w| command_signal(&w.drive))
                .expect("a checked channel names a driven wheel");
            named(format!("wheel.{name}.{field}"), unit)
        }
    }
}

fn task_name(goal: Option<&Goal>) -> &'static str {
    match goal {
        None => "none",
        Some(Goal::Homing { .. }) => "homing",
        Some(Goal::Gate { .. }) => "gate",
        Some(Goal::Eight { .. }) => "eight",
        Some(Goal::Slalom { .. }) => "slalom",
    }
}

/// What drives a robot: `rate`, `torque`, `dc-motor` or `none`.
pub fn drive_name(robot: &Robot) -> &'static str {
    let platform = robot
        .platform
        .as_ref()
        .expect("a checked scenario has platforms");
    let built = platform.wheel.iter().find_map(|wheel| match wheel.drive {
        Drive::None => None,
        Drive::Torque { .. } => Some("torque"),
        Drive::DcMotor { .. } => Some("dc-motor"),
    });
    match (build::drive_model(robot), built) {
        (_, None) => "none",
        (build::DriveModel::Rate, _) => "rate",
        (build::DriveModel::Torque, _) => "torque",
        (build::DriveModel::AsBuilt, Some(built)) => built,
    }
}

/// A recorder that passes everything on and measures on the way.
struct Meter<'a> {
    inner: &'a mut dyn Recorder,
    robots: Vec<Gauge>,
}

/// Running figures of one robot, from the recorded rows.
#[derive(Default)]
struct Gauge {
    columns: BTreeMap<&'static str, usize>,
    commands: Vec<(usize, &'static str)>,
    currents: Vec<usize>,
    torques: Vec<usize>,
    /// Columns of longitudinal force, lateral force and load of each wheel.
    forces: Vec<[usize; 3]>,
    /// Coefficient of friction of the ground, if it is known.
    friction: Option<f64>,
    loaded: bool,
    /// Lowest load of a wheel, N.
    load: f64,
    /// Highest share of the friction limit, %.
    demand: f64,
    speed: f64,
    command_square: f64,
    command_peak: f64,
    torque_peak: f64,
    current_peak: f64,
    offset_square: f64,
    offset_peak: f64,
    last: BTreeMap<&'static str, f64>,
    rows: f64,
}

impl<'a> Meter<'a> {
    fn new(inner: &'a mut dyn Recorder, scenario: &Scenario, header: &Header) -> Self {
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
                    for known in [
                        "twist.forward",
                        "twist.left",
                        "path.offset",
                        "energy.supplied",
                        "energy.windings",
                        "energy.friction",
                        "energy.residual",
                    ] {
                        if path == known {
                            gauge.columns.insert(known, k);
                        }
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
                            gauge.forces.push([k, k + 1, k + 2]);
                        }
                    }
                }
                gauge
            })
            .collect();
        Meter { inner, robots }
    }

    fn metrics(&self, robot: usize, judge: &Judge, scenario: &Scenario, end: f64) -> Vec<Metric> {
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
                "wall clearance" => format!(
                    "{:.2} s",
                    judged.get("wall clearance time").copied().unwrap_or(0.0)
                ),
                "beacon clearance index" | "beacon clearance time" | "wall clearance time" => {
                    continue;
                }
                _ => String::new(),
            };
            add(name, value, unit, note);
        }
        let rows = gauge.rows.max(1.0);
        add("highest speed", gauge.speed, "m/s", String::new());
        if gauge.columns.contains_key("path.offset") {
            let note = format!("at most {:.1} mm", 1e3 * gauge.offset_peak);
            add(
                "cross-track error, RMS",
                (gauge.offset_square / rows).sqrt(),
                "m",
                note,
            );
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
        if gauge.loaded {
            let note = if gauge.load < 0.0 {
                "below 0: a wheel would lift"
            } else {
                ""
            };
            add("lowest wheel load", gauge.load, "N", note.into());
            if let Some(friction) = gauge.friction {
                let note = if gauge.demand > 100.0 {
                    "above 100: the wheels would slip"
                } else {
                    ""
                };
                let note = if note.is_empty() {
                    format!("of μN, μ = {friction}")
                } else {
                    note.into()
                };
                add("highest friction used", gauge.demand, "%", note);
            }
        }
        let last = |key| gauge.last.get(key).copied();
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
        for gauge in &mut self.robots {
            gauge.rows += 1.0;
            for (&name, &k) in &gauge.columns {
                match name {
                    "twist.forward" => {
                        let left = gauge.columns.get("twist.left").map_or(0.0, |&k| row[k]);
                        gauge.speed = gauge.speed.max(crate::plant::speed(row[k], left));
                    }
                    "path.offset" => {
                        gauge.offset_square += row[k] * row[k];
                        gauge.offset_peak = gauge.offset_peak.max(row[k].abs());
                    }
                    _ => {
                        gauge.last.insert(name, row[k]);
                    }
                }
            }
            for &(k, _) in &gauge.commands {
                gauge.command_square += row[k] * row[k];
                gauge.command_peak = gauge.command_peak.max(row[k].abs());
            }
            for &[along, across, load] in &gauge.forces {
                // Without three contacts the loads are not known, and all are zero.
                let known = gauge.forces.iter().any(|columns| row[columns[2]] != 0.0);
                if known {
                    gauge.load = if gauge.loaded {
                        gauge.load.min(row[load])
                    } else {
                        row[load]
                    };
                    gauge.loaded = true;
                    if let Some(friction) = gauge.friction {
                        let force = crate::plant::speed(row[along], row[across]);
                        // A wheel that just touches needs no friction for a force that is rounding.
                        let share = if force < 1e-9 {
                            0.0
                        } else {
                            100.0 * force / (friction * row[load]).max(1e-9)
                        };
                        gauge.demand = gauge.demand.max(share.min(1e6));
                    }
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

/// What reports draw, beside the signals: arena, robots, goals and paths.
fn drawing(
    scenario: &Scenario,
    paths: &[Option<Path>],
    goals: &[Option<Goal>],
    integrators: &[String],
) -> Value {
    let terrain = match &scenario.terrain {
        Terrain::Flat { .. } => json!({"kind": "flat"}),
        Terrain::Plane {
            slope_deg,
            downhill_heading_deg,
            ..
        } => {
            json!({"kind": "plane", "slope_deg": slope_deg, "downhill_heading_deg": downhill_heading_deg})
        }
    };
    let friction = match &scenario.terrain {
        Terrain::Flat { friction, .. } | Terrain::Plane { friction, .. } => friction,
    };
    let beacons: Vec<Value> = scenario
        .arena
        .beacon
        .iter()
        .map(|b| json!({"name": b.name, "position": b.position, "radius": b.radius}))
        .collect();
    let robots: Vec<Value> = scenario
        .robot
        .iter()
        .enumerate()
        .map(|(k, robot)| draw_robot(robot, paths[k].as_ref(), goals[k].as_ref(), scenario))
        .collect();
    json!({
        "title": scenario.title,
        "integrator": integrators.first(),
        "arena": {
            "size": scenario.arena.size,
            "beacons": beacons,
            "terrain": terrain,
            "friction": friction,
        },
        "robots": robots,
    })
}

fn draw_robot(
    robot: &Robot,
    path: Option<&Path>,
    goal: Option<&Goal>,
    scenario: &Scenario,
) -> Value {
    let platform = robot
        .platform
        .as_ref()
        .expect("a checked scenario has platforms");
    let wheels: Vec<Value> = platform.wheel.iter().map(draw_wheel).collect();
    let goal = match goal {
        None => Value::Null,
        Some(Goal::Homing {
            beacon, distance, ..
        }) => json!({"kind": "homing", "beacon": beacon, "distance": distance}),
        Some(Goal::Gate {
            pair,
            direction,
            exit,
        }) => json!({"kind": "gate", "pair": pair, "direction": direction, "exit": exit}),
        Some(Goal::Eight { pair, laps, .. }) => {
            json!({"kind": "eight", "pair": pair, "laps": laps})
        }
        Some(Goal::Slalom {
            chain, first_side, ..
        }) => {
            let sides: Vec<i8> = (0..chain.len())
                .map(|k| if k % 2 == 0 { *first_side } else { -first_side })
                .collect();
            json!({"kind": "slalom", "chain": chain, "sides": sides})
        }
    };
    // Every fifth point or so draws the same curve.
    let thinned = path.map(|path| {
        let every = (path.points.len() / 400).max(1);
        let last = path.points.len() - 1;
        let keep = (0..=last).filter(|k| k % every == 0 || *k == last);
        keep.map(|k| path.points[k].map(|v| (v * 1e4).round() / 1e4))
            .collect::<Vec<_>>()
    });
    let mass: f64 = platform.body.mass + platform.wheel.iter().map(|w| w.mass).sum::<f64>();
    let center = [0, 1].map(|axis| {
        let wheels: f64 = platform.wheel.iter().map(|w| w.mass * w.mount[axis]).sum();
        (platform.body.mass * platform.body.center_of_mass[axis] + wheels) / mass
    });
    json!({
        "name": robot.name,
        "level": robot.level,
        "drive": drive_name(robot),
        "collision_radius": platform.collision_radius,
        "footprint": platform.footprint,
        "center_of_mass": center,
        "wheels": wheels,
        "start": robot.pose,
        "goal": goal,
        "path": thinned,
        "duration": scenario.time.duration,
    })
}

fn draw_wheel(wheel: &Wheel) -> Value {
    let (kind, angle, trail) = match (&wheel.steering, &wheel.rim) {
        (Steering::Free { trail, angle_deg }, _) => ("caster", *angle_deg, *trail),
        (Steering::Fixed { angle_deg }, crate::scenario::Rim::Rollers { .. }) => {
            ("rollers", *angle_deg, 0.0)
        }
        (Steering::Fixed { angle_deg }, crate::scenario::Rim::Plain) => ("fixed", *angle_deg, 0.0),
    };
    let roller = match wheel.rim {
        crate::scenario::Rim::Rollers { angle_deg } => angle_deg.to_radians(),
        crate::scenario::Rim::Plain => 0.0,
    };
    json!({
        "name": wheel.name,
        "kind": kind,
        "mount": wheel.mount,
        "angle": angle.to_radians(),
        "radius": wheel.radius,
        "width": wheel.width,
        "trail": trail,
        "roller_angle": roller,
        "driven": wheel.drive != Drive::None,
    })
}

impl Layout {
    /// Distance between the robot's disc at `position` and the nearest beacon, m; negative inside.
    pub fn clearance(&self, position: [f64; 2]) -> f64 {
        self.beacons
            .iter()
            .map(|b| {
                let off = [position[0] - b.position[0], position[1] - b.position[1]];
                appell_model::math::hypot(off[0], off[1]) - b.radius - self.collision_radius
            })
            .fold(f64::MAX, f64::min)
    }
}
