//! A run: a scenario becomes a world, the world steps, recorders listen, and a summary remains.

mod narrow;

use std::sync::{Arc, Mutex};

use appell_model::scalar::Scalar;
use appell_model::terrain::Terrain;
use serde::{Deserialize, Serialize};

use crate::block::Block;
use crate::build::{self, Values};
use crate::change::Rewiring;
use crate::controller::Track;
use crate::decide::{Deciding, Standing, changes, reach};
use crate::drawing::drawing;
use crate::foreign::{Pool, Reach, digests};
use crate::judge::{Judge, Verdict};
use crate::layout::{Assignment, Goal, Layout};
use crate::live::{Script, Workshop};
use crate::meter::Meter;
use crate::plan::{self, Path, PlanError};
use crate::plant::{Chosen, Numerics, Plant, PlantError, Start};
use crate::record::{Event, Header, RecordError, Recorder};
use crate::relief::Grids;
use crate::scenario::{
    Controller, Diagnostic, Diagnostics, Drive, Level, Loaded, Precision, Robot, Scenario, Sensor,
    Statistics, Task,
};
use crate::world::{Failure, Listener, Parts, RobotBlocks, SimError, Swapped, World};

pub use narrow::NarrowRun;
pub(crate) use narrow::world;

/// Ticks between two reports of progress.
const PROGRESS_TICKS: u64 = 1024;

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
    /// SHA-256 of the resolved scenario, and of the plug-ins that it names.
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
    /// Changes of controllers, in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub swaps: Vec<Swapped>,
    /// Controllers that failed, where the run went on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failures: Vec<Failure>,
    /// Tables of how far robots are apart.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub statistics: Vec<StatisticsTable>,
}

/// Mean and standard deviation of signals over the recorded rows.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct StatisticsTable {
    /// Name.
    pub name: String,
    /// Number of rows that were recorded; 0 for ratios.
    pub samples: u64,
    /// Digits after the point to print.
    pub decimals: u32,
    /// One for each signal.
    pub rows: Vec<StatisticsRow>,
}

/// Figures of one signal.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct StatisticsRow {
    /// Path below the robot.
    pub signal: String,
    /// Unit; empty for ratios.
    pub unit: String,
    /// Mean, or the ratio of two means; none where the divisor is 0.
    pub mean: Option<f64>,
    /// Standard deviation of these rows (divided by their number), or the ratio of two.
    pub std: Option<f64>,
}

/// A world together with what describes it.
pub struct Run {
    /// The world.
    pub world: World,
    /// What recordings of it begin with.
    pub header: Header,
    /// Planned path of each robot that follows one.
    pub paths: Vec<Option<Path>>,
    scenario: Scenario,
    integrators: Vec<String>,
    /// Signals that are commanded from outside.
    outsides: Vec<crate::signal::Signal>,
    pub(crate) script: Script,
    pub(crate) rewiring: Rewiring,
}

/// SHA-256 of a text, in hexadecimal.
pub fn hash(text: &str) -> String {
    use sha2::Digest;
    let digest = sha2::Sha256::digest(text.as_bytes());
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 of a resolved scenario, and of the plug-ins that it names.
pub(crate) fn fingerprint(loaded: &Loaded) -> String {
    hash(&(loaded.resolved.clone() + &digests(&loaded.scenario, &loaded.folder)))
}

/// Why a plant cannot be built: a setting of the scenario, or one below `base`.
pub(crate) fn refuse_plant(loaded: &Loaded, base: &str, error: PlantError) -> Diagnostics {
    let path = match error.field.contains('.') {
        true => error.field.to_owned(),
        false => format!("{base}.{}", error.field),
    };
    refuse(loaded, path, error.problem, error.hint)
}

pub(crate) fn refuse(loaded: &Loaded, path: String, problem: String, hint: String) -> Diagnostics {
    Diagnostics(vec![Diagnostic {
        file: loaded.file.clone(),
        at: None,
        path,
        problem,
        hint: (!hint.is_empty()).then_some(hint),
    }])
}

/// What a scenario is built into, before its world is wired.
pub(crate) struct Assembly<T: Scalar> {
    pub parts: Parts<T>,
    pub paths: Vec<Option<Arc<Path>>>,
    pub assignments: Vec<Option<Assignment>>,
    pub integrators: Vec<String>,
    /// How its robots are stepped.
    pub chosen: Vec<Chosen>,
    /// Signals that are commanded from outside.
    pub outsides: Vec<crate::signal::Signal>,
    /// What the plug-ins of each robot may read and write.
    pub reaches: Vec<Reach>,
    /// Heights of uneven ground.
    pub relief: Option<Arc<Terrain>>,
}

/// What trials of a batch share: ways that were planned, heights of the ground, and plug-ins that run.
#[derive(Default)]
pub(crate) struct Plans {
    ways: Mutex<Vec<Plan>>,
    grids: Grids,
    pub plugins: Arc<Pool>,
}

struct Plan {
    layout: Layout,
    goal: Goal,
    path: Arc<Path>,
    track: Arc<Track>,
}

/// Most ways that are kept: a batch that varies the arena has a new one for each trial.
const PLANS_MAX: usize = 16;

impl Plans {
    /// Heights of the ground, where it is uneven.
    pub(crate) fn relief(&self, loaded: &Loaded) -> Result<Option<Arc<Terrain>>, Diagnostics> {
        let relief = self.grids.terrain(&loaded.scenario.terrain, &loaded.folder);
        relief.map_err(|found| {
            let path = format!("terrain.relief.{}.{}", found.index, found.error.field);
            refuse(loaded, path, found.error.problem, found.error.hint)
        })
    }

    fn way(&self, layout: &Layout, goal: &Goal) -> Result<(Arc<Path>, Arc<Track>), PlanError> {
        let known = |plan: &&Plan| plan.layout == *layout && plan.goal == *goal;
        let found = |plans: &Vec<Plan>| {
            let plan = plans.iter().find(known)?;
            Some((plan.path.clone(), plan.track.clone()))
        };
        if let Some(way) = found(&self.ways.lock().expect("nothing panics with it")) {
            return Ok(way);
        }
        let path = Arc::new(plan::plan(layout, goal)?);
        let track = Arc::new(Track::new(&path));
        let mut plans = self.ways.lock().expect("nothing panics with it");
        if plans.len() < PLANS_MAX {
            plans.push(Plan {
                layout: layout.clone(),
                goal: goal.clone(),
                path: path.clone(),
                track: track.clone(),
            });
        }
        Ok((path, track))
    }
}

/// Builds the blocks of a checked scenario, for a trial of its seed.
pub(crate) fn assemble<T: Scalar>(
    loaded: &Loaded,
    trial: u64,
    plans: &Plans,
    values: &Values<'_, T>,
) -> Result<Assembly<T>, Diagnostics> {
    let scenario = &loaded.scenario;
    if !scenario.change.is_empty() {
        return Err(refuse(
            loaded,
            "change".into(),
            "must be empty here: only a single run changes its numbers on the way".into(),
            "leave it out, or let a controller do it".into(),
        ));
    }
    let step = scenario.time.step;
    let ticks = |period: f64| -> u64 { (period / step).round().max(1.0) as u64 };
    let ground = build::ground_of(&scenario.terrain, values);
    let relief = plans.relief(loaded)?;
    let key = (scenario.seed, scenario.trial + trial);
    let mut robots = Vec::new();
    let (mut paths, mut assignments, mut integrators) = (Vec::new(), Vec::new(), Vec::new());
    let mut chosen = Vec::new();
    let mut outsides = Vec::new();
    let mut reaches = Vec::new();
    for (place, robot) in scenario.robot.iter().enumerate() {
        if robot.count > 1 {
            return Err(refuse(
                loaded,
                format!("robot.{}.count", robot.name),
                format!("must be 1 here, got {}", robot.count),
                "robots by count are for `appell run`; a batch takes its --trials".into(),
            ));
        }
        let file = robot
            .platform
            .as_ref()
            .expect("a checked scenario has platforms");
        let path = format!("robot.{}.platform", robot.name);
        let drives = build::drive_model(robot);
        let platform = build::platform_of(file, drives, ground.gravity_normal, &path, values)
            .expect("a checked platform can be built");
        let contacts = build::contacts(file, &scenario.terrain, relief.clone(), &path, values);
        let angles = build::start_angles(file);
        let pose = robot.pose.map(T::from);
        let start = Start {
            pose,
            twist: robot.twist.map(T::from),
            angles: &angles,
        };
        let settled = values.chosen(place);
        let numerics = Numerics {
            integrator: settled.map_or(scenario.time.integrator, |chosen| chosen.integrator),
            step,
            tolerance: scenario.time.tolerance,
            pairs: settled.is_none_or(|chosen| chosen.is_paired),
        };
        let name = &robot.name;
        let level = robot.level;
        let plant = Plant::new(
            name,
            platform.clone(),
            contacts,
            ground,
            level,
            numerics,
            start,
        )
        .map_err(|error| refuse_plant(loaded, &format!("robot.{name}"), error))?;
        integrators.push(plant.integrator());
        chosen.push(plant.chosen());
        let layout = build::layout(scenario, robot);
        let assignment = robot
            .task
            .as_ref()
            .map(|task| build::assignment(scenario, robot, task, &loaded.folder))
            .transpose()
            .map_err(|fault| {
                let path = fault.path(&format!("robot.{}.task", robot.name));
                refuse(loaded, path, fault.problem, fault.hint)
            })?;
        let sensors: Vec<(Box<dyn Block<T>>, u64)> = robot
            .sensor
            .iter()
            .map(|sensor| {
                let block = crate::sensor::build(
                    sensor,
                    &robot.name,
                    &platform,
                    (&layout.beacons, ground),
                    pose,
                    key,
                    values,
                );
                (block, ticks(sensor_period(sensor)))
            })
            .collect();
        let way = match &assignment {
            None => None,
            Some(Assignment::Route(route)) => {
                let path = Arc::new(route.path.clone());
                let track = Arc::new(Track::new(&path));
                Some((path, track))
            }
            // Only a follower needs a way among the beacons; a plug-in is told of it where there is one.
            Some(Assignment::Beacons(goal)) => {
                let kinds = |of: fn(&Controller) -> bool| robot.controllers().any(|(_, c)| of(c));
                if kinds(|controller| controller.follower().is_some()) {
                    Some(plans.way(&layout, goal).map_err(|error| {
                        let path = format!("robot.{}.task", robot.name);
                        let problem = format!("cannot be solved: {}", error.reason);
                        refuse(loaded, path, problem, error.hint)
                    })?)
                } else if kinds(|controller| matches!(controller, Controller::Plugin(_))) {
                    plans.way(&layout, goal).ok()
                } else {
                    None
                }
            }
        };
        let mut deciding = Deciding {
            loaded,
            robot,
            platform: &platform,
            file,
            way: way.as_ref().map(|(path, track)| (&**path, track)),
            heading: pose[2],
            key,
            values,
            pool: &plans.plugins,
            relief: relief.as_ref(),
            reach: reach(robot, &platform, &plant, &sensors),
            outsides: &mut outsides,
        };
        let models = deciding.models(ground, numerics, start)?;
        let (controllers, crew) = deciding.blocks(&models)?;
        let sensing = sensors.iter().flat_map(|(sensor, _)| sensor.inputs());
        let deciders = controllers.iter().filter(|one| one.models == u64::MAX);
        let read = sensing.chain(deciders.flat_map(|one| one.block.inputs()));
        for port in read.filter(|port| plant.outputs().contains(port)) {
            let lacks = |model: &&Standing<T>| !model.plant.outputs().contains(port);
            if let Some(k) = models.iter().position(|model| lacks(&model)) {
                return Err(refuse(
                    loaded,
                    format!("robot.{}.model.{}", robot.name, robot.model[k].name),
                    format!(
                        "must write {}, which a sensor or controller reads",
                        port.path
                    ),
                    "add it to the model's outputs, or leave out what reads it".into(),
                ));
            }
        }
        reaches.push(deciding.reach);
        let follows = robot.controllers().filter(|(_, c)| c.follower().is_some());
        let judge_period = follows.fold(0.01_f64, |least, (_, c)| least.min(c.period()));
        robots.push(RobotBlocks {
            name: robot.name.clone(),
            sensors,
            controllers,
            crew,
            plant: Box::new(plant),
            models: robot.models().map(str::to_owned).collect(),
            standing: models.into_iter().map(|model| model.plant).collect(),
            judge: match &assignment {
                None => Judge::new(&layout, None),
                Some(assignment) => Judge::of(&layout, assignment),
            },
            layout,
            has_task: assignment.is_some(),
            judge_period: ticks(judge_period),
        });
        paths.push(way.map(|(path, _)| path));
        assignments.push(assignment);
    }
    Ok(Assembly {
        parts: Parts {
            step,
            end: ticks(scenario.time.duration),
            record: ticks(scenario.record.period),
            robots,
            changes: changes(scenario),
        },
        paths,
        assignments,
        integrators,
        chosen,
        outsides,
        reaches,
        relief,
    })
}

impl Run {
    /// Builds the world of a checked scenario, for a trial of its seed.
    pub fn new(loaded: &Loaded, trial: u64) -> Result<Run, Diagnostics> {
        Run::planned(loaded, trial, &Arc::default())
    }

    /// The same, with what new versions of its plug-ins are opened with while it goes on.
    pub fn with_workshop(loaded: &Loaded, trial: u64) -> Result<(Run, Workshop), Diagnostics> {
        let plans = Arc::<Plans>::default();
        let (run, reaches) = Run::made(loaded, trial, &plans, Precision::F64)?;
        let workshop = Workshop::new(&run, reaches, loaded.trust_native, trial, &plans.plugins);
        Ok((run, workshop))
    }

    /// The same with ways that are known already.
    pub(crate) fn planned(
        loaded: &Loaded,
        trial: u64,
        plans: &Arc<Plans>,
    ) -> Result<Run, Diagnostics> {
        Run::made(loaded, trial, plans, Precision::F64).map(|(run, _)| run)
    }

    fn made(
        loaded: &Loaded,
        trial: u64,
        plans: &Arc<Plans>,
        precision: Precision,
    ) -> Result<(Run, Vec<Reach>), Diagnostics> {
        let scenario = &loaded.scenario;
        let mut first = loaded.clone();
        let changes = std::mem::take(&mut first.scenario.change);
        let mut assembly = assemble(&first, trial, plans, &Values::new(&[]))?;
        if !precision.is_double() {
            for integrator in &mut assembly.integrators {
                integrator.push_str(", single precision");
            }
        }
        let world = World::wire(assembly.parts);
        if let Some(statistics) = &scenario.statistics {
            check_statistics(loaded, statistics, &world)?;
        }
        let paths: Vec<Option<Path>> = assembly
            .paths
            .into_iter()
            .map(|path| path.map(Arc::unwrap_or_clone))
            .collect();
        let header = Header {
            scenario: scenario.name.clone(),
            scenario_text: loaded.resolved.clone(),
            hash: fingerprint(loaded),
            seed: scenario.seed,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            step: scenario.time.step,
            period: scenario.record.period,
            signals: world.signals().to_vec(),
            extra: drawing(
                scenario,
                &paths,
                &assembly.assignments,
                &assembly.integrators,
                assembly.relief.as_deref(),
            ),
        };
        let run = Run {
            world,
            header,
            paths,
            rewiring: Rewiring::new(&first, changes, trial, plans)?,
            scenario: scenario.clone(),
            integrators: assembly.integrators,
            outsides: assembly.outsides,
            script: Script::of(scenario),
        };
        Ok((run, assembly.reaches))
    }

    /// The scenario that is run.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Sets what is commanded from outside: the value of a channel whose signal is `external`, from this
    /// instant on. False where there is no such channel, or the value is not finite: nothing changes then.
    pub fn command(&mut self, path: &str, value: f64) -> bool {
        let is_outside = self.outsides.iter().any(|signal| signal.path == path);
        match self
            .world
            .column(path)
            .filter(|_| is_outside && value.is_finite())
        {
            Some(column) => {
                self.world.write(0, column, value);
                true
            }
            None => false,
        }
    }

    /// Steps to the end, into `recorder`; `progress` is told the time now and then.
    pub fn execute(
        &mut self,
        recorder: &mut dyn Recorder,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Summary, SimError> {
        self.execute_with(recorder, PROGRESS_TICKS, &mut |run| {
            progress(run.world.now());
        })
    }

    /// The same; at least every so many ticks `between` may look at the run, and change it.
    pub fn execute_with(
        &mut self,
        recorder: &mut dyn Recorder,
        ticks: u64,
        between: &mut dyn FnMut(&mut Run),
    ) -> Result<Summary, SimError> {
        recorder.begin(&self.header)?;
        let mut meter = self.meter();
        let mut shown = 0;
        let result = loop {
            match self.advance(ticks, &mut meter, recorder) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(error) => break Err(error),
            }
            if self.world.tick() - shown >= ticks {
                shown = self.world.tick();
                between(self);
            }
        };
        if let Err(error @ SimError::Record(_)) = result {
            return Err(error);
        }
        let summary = self.summary(&meter, result.as_ref().err());
        // What was recorded until a failure is closed in order.
        recorder.finish(&|| serde_json::to_value(&summary).expect("plain data"))?;
        Ok(summary)
    }

    /// What measures this run from its begin.
    pub(crate) fn meter(&self) -> Meter<f64> {
        Meter::new(&self.scenario, &self.header.signals)
    }

    /// Makes the changes that are due, a step, and goes on while nothing is due but motion, for at most
    /// `limit` steps.
    pub(crate) fn advance(
        &mut self,
        limit: u64,
        meter: &mut Meter<f64>,
        recorder: &mut dyn Recorder,
    ) -> Result<bool, SimError> {
        let limit = limit.min(self.change_due()?);
        let mut listener = Measured {
            scenario: &self.scenario,
            meter,
            recorder,
        };
        self.world.advance_with(limit, &mut listener)
    }

    /// What became of the run so far, which an error may have broken off.
    pub(crate) fn summary(&self, meter: &Meter<f64>, error: Option<&SimError>) -> Summary {
        let account = Account {
            scenario: &self.scenario,
            integrators: &self.integrators,
            hash: &self.header.hash,
        };
        account.summary(&self.world, meter, 0, error)
    }
}

/// Measures a run on the way to its recorder.
struct Measured<'a> {
    scenario: &'a Scenario,
    meter: &'a mut Meter<f64>,
    recorder: &'a mut dyn Recorder,
}

impl Listener<f64> for Measured<'_> {
    fn frame(&mut self, t: f64, row: &[f64], of: bool) -> Result<(), RecordError> {
        self.meter.add(t, row, of);
        while let Some((robot, t, place)) = self.meter.next_tip() {
            self.recorder.event(&Event {
                t,
                robot: self.scenario.robot[robot].name.clone(),
                kind: "tip-over".into(),
                text: "would tip over: its zero-moment point leaves the wheels".into(),
                position: Some(place),
            })?;
        }
        self.recorder.frame(t, row)
    }

    fn event(&mut self, _lane: usize, event: &Event) -> Result<(), RecordError> {
        self.recorder.event(event)
    }
}

/// What a summary tells of besides the world.
pub(crate) struct Account<'a> {
    pub scenario: &'a Scenario,
    pub integrators: &'a [String],
    pub hash: &'a str,
}

impl Account<'_> {
    /// What became of the trial in a lane, which an error may have broken off.
    pub(crate) fn summary<T: Scalar>(
        &self,
        world: &World<T>,
        meter: &Meter<T>,
        lane: usize,
        error: Option<&SimError>,
    ) -> Summary {
        let now = world.time(lane);
        let robots: Vec<RobotSummary> = self
            .scenario
            .robot
            .iter()
            .zip(&world.referees)
            .zip(self.integrators)
            .enumerate()
            .map(|(k, ((robot, referee), integrator))| {
                let judge = &referee.judge(lane);
                let (verdict, reason) = match (referee.has_task, judge.verdict()) {
                    (_, Verdict::Failed) if referee.has_task => (Outcome::Failed, judge.reason()),
                    (true, Verdict::Passed) => (Outcome::Passed, judge.reason()),
                    (true, _) => (
                        Outcome::Failed,
                        format!(
                            "time was up after {} s: {}",
                            self.scenario.time.duration,
                            judge.timeout_reason()
                        ),
                    ),
                    (false, _) => (
                        Outcome::Stopped,
                        format!("ran {now:.6} s without a task").replace(".000000", ""),
                    ),
                };
                let figures = meter.metrics(k, lane, judge, self.scenario, now);
                RobotSummary {
                    name: robot.name.clone(),
                    verdict,
                    reason,
                    task: robot.task.as_ref().map_or("none", Task::kind).into(),
                    level: robot.level,
                    drive: drive_name(robot).into(),
                    integrator: integrator.clone(),
                    metrics: figures
                        .into_iter()
                        .map(|figure| Metric {
                            name: figure.name,
                            value: figure.value.lane(0),
                            unit: figure.unit,
                            note: figure.note,
                        })
                        .collect(),
                }
            })
            .collect();
        Summary {
            statistics: meter.statistics(lane, self.scenario),
            swaps: world.swapped().to_vec(),
            failures: world.failures().to_vec(),
            ..Summary::of(
                self.scenario,
                self.hash,
                now,
                robots,
                error.map(ToString::to_string),
            )
        }
    }
}

impl Summary {
    /// What became of robots together, which an error may have broken off after `duration`, s.
    pub(crate) fn of(
        scenario: &Scenario,
        hash: &str,
        duration: f64,
        robots: Vec<RobotSummary>,
        error: Option<String>,
    ) -> Summary {
        let (verdict, reason) = match &error {
            Some(error) => (Outcome::Stopped, error.clone()),
            None => overall(&robots),
        };
        Summary {
            verdict,
            reason,
            scenario: scenario.name.clone(),
            hash: hash.to_owned(),
            seed: scenario.seed,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            duration,
            error,
            robots,
            swaps: Vec::new(),
            failures: Vec::new(),
            statistics: Vec::new(),
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
    let none = robots.iter().all(|r| r.verdict == Outcome::Stopped);
    let reason = if robots.len() == 1 || none {
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
        | Sensor::Motion { period, .. }
        | Sensor::Imu { period, .. }
        | Sensor::RangeBearing { period, .. } => *period,
    }
}

/// Signals of statistics: those that both robots have.
fn check_statistics(
    loaded: &Loaded,
    statistics: &Statistics,
    world: &World,
) -> Result<(), Diagnostics> {
    for difference in &statistics.difference {
        for robot in [&difference.of, &difference.minus] {
            let prefix = format!("robot.{robot}.");
            for signal in &statistics.signals {
                if world.column(&format!("{prefix}{signal}")).is_none() {
                    let known: Vec<&str> = world
                        .signals()
                        .iter()
                        .filter_map(|known| known.path.strip_prefix(&prefix))
                        .collect();
                    return Err(refuse(
                        loaded,
                        "statistics.signals".into(),
                        format!("must be signals of robot \"{robot}\", got \"{signal}\""),
                        format!("it has: {}", known.join(", ")),
                    ));
                }
            }
        }
    }
    Ok(())
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
