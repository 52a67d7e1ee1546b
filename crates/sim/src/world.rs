//! The world: a table of named signals, the blocks that read and write it, and the step loop.
//!
//! A step is sense → decide → record → move → judge. Within a stage blocks run robot after robot in
//! the order of their wiring. Time is the tick times the step, never a sum.
//!
//! A world may hold several trials in lanes. They share its ticks, each counted from its own start,
//! and go on until their own end; the others do not notice when another trial takes a lane over.

mod changes;
mod look;
mod saved;
mod slot;

use std::collections::BTreeMap;

use appell_model::scalar::{Mask, Scalar};

use crate::block::{Block, BlockError, Detail, Now, finite_lanes};
use crate::judge::{Judge, Verdict};
use crate::layout::Layout;
use crate::record::{Event, RecordError, Recorder};
use crate::signal::Signal;

use changes::Roster;
pub(crate) use changes::{Change, To};
pub use changes::{Failure, Swapped};
pub(crate) use look::Referee;
use slot::{Due, Shared, Slot, gcd};

/// A mask with another value in one lane.
fn with<M: Mask>(mask: M, lane: usize, value: bool) -> M {
    M::from_lanes(|i| if i == lane { value } else { mask.lane(i) })
}

/// Robots, their blocks and the table of signals, of one trial or of several in lanes.
pub struct World<T: Scalar = f64> {
    step: f64,
    tick: u64,
    /// Ticks of a trial.
    end: u64,
    /// The tick at which each lane's trial began, and its own ticks since.
    begun: Vec<u64>,
    ticks: Vec<u64>,
    /// Which lanes have a trial that goes on, and the first tick at which time is up for one of them.
    running: T::Mask,
    next_end: u64,
    /// Whether a judge has decided since it was asked for last.
    has_decided: bool,
    /// What broke trials off since it was asked for last.
    broken: Vec<(usize, SimError)>,
    record: Due,
    signals: Vec<Signal>,
    row: Vec<T>,
    sensors: Vec<Slot<T>>,
    controllers: Vec<Slot<T>>,
    /// The first model of each robot, then those that stand by; and which of them moves each robot.
    plants: Vec<Slot<T>>,
    driving: Vec<usize>,
    /// Whether any of them is from a file.
    any_foreign: bool,
    /// Readings of each robot's motion.
    readings: Vec<Due>,
    pub(crate) referees: Vec<Referee<T>>,
    /// The controllers of each robot.
    rosters: Vec<Roster>,
    /// Changes of controllers to come, in order, the first at `next_change`.
    changes: Vec<Change>,
    next_change: usize,
    /// Those that were.
    swapped: Vec<Swapped>,
    /// Controllers that failed.
    failures: Vec<Failure>,
    events: Vec<(usize, Event)>,
}

/// Listens to a world: rows of some lanes, and events of one.
pub(crate) trait Listener<T: Scalar> {
    /// A row of signals at a time of each lane, s, for those lanes that have one.
    fn frame(&mut self, t: T, row: &[T], of: T::Mask) -> Result<(), RecordError>;
    /// Something that happened in a lane.
    fn event(&mut self, lane: usize, event: &Event) -> Result<(), RecordError>;
}

/// A recorder, which knows of no lanes.
struct Alone<'a>(&'a mut dyn Recorder);

impl Listener<f64> for Alone<'_> {
    fn frame(&mut self, t: f64, row: &[f64], _of: bool) -> Result<(), RecordError> {
        self.0.frame(t, row)
    }

    fn event(&mut self, _lane: usize, event: &Event) -> Result<(), RecordError> {
        self.0.event(event)
    }
}

/// Why a step could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// A block could not go on.
    #[error("{error} at t = {t} s")]
    Block {
        /// What happened.
        error: BlockError,
        /// Time, s.
        t: f64,
    },
    /// A signal is not finite.
    #[error("{path}: is not finite at t = {t} s")]
    NotFinite {
        /// Path of the signal.
        path: String,
        /// Time, s.
        t: f64,
    },
    /// A number could not change as the scenario says.
    #[error("{path}: cannot change at t = {t} s: {problem}")]
    Change {
        /// Path of the number.
        path: String,
        /// Why not.
        problem: String,
        /// Time, s.
        t: f64,
    },
    /// The recording could not be written.
    #[error(transparent)]
    Record(#[from] RecordError),
}

/// A saved state does not fit this world.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("a saved state must come from the same scenario and version, got one that does not fit")]
pub struct RestoreError;

/// The blocks of one robot, for wiring.
pub(crate) struct RobotBlocks<T: Scalar> {
    pub name: String,
    pub sensors: Vec<(Box<dyn Block<T>>, u64)>,
    pub controllers: Vec<Controlled<T>>,
    /// Names of what is swapped.
    pub crew: Vec<String>,
    pub plant: Box<dyn Block<T>>,
    /// Names of its models, and those that stand by.
    pub models: Vec<String>,
    pub standing: Vec<Box<dyn Block<T>>>,
    pub judge: Judge<T::Single>,
    pub layout: Layout,
    pub has_task: bool,
    pub judge_period: u64,
}

/// A block that decides: its period in ticks, and the controllers and models of the robot with which it runs,
/// a bit each.
pub(crate) struct Controlled<T: Scalar> {
    pub block: Box<dyn Block<T>>,
    pub period: u64,
    pub with: u64,
    pub models: u64,
}

/// A world before it is wired: periods in ticks, and the robots.
pub(crate) struct Parts<T: Scalar> {
    pub step: f64,
    pub end: u64,
    pub record: u64,
    pub robots: Vec<RobotBlocks<T>>,
    /// In order.
    pub changes: Vec<Change>,
}

impl<T: Scalar> World<T> {
    /// Wires robots; every input finds the output of its path, or stays at zero. All lanes hold the
    /// same trial.
    pub(crate) fn wire(parts: Parts<T>) -> World<T> {
        let mut signals: Vec<Signal> = Vec::new();
        let mut index: BTreeMap<String, usize> = BTreeMap::new();
        let mut add = |signals: &mut Vec<Signal>, signal: &Signal| {
            let at = signals.len();
            if index.insert(signal.path.clone(), at).is_some() {
                unreachable!("two blocks write {}", signal.path);
            }
            signals.push(signal.clone());
            at
        };
        struct Placed<T: Scalar> {
            block: Box<dyn Block<T>>,
            period: u64,
            robot: usize,
            with: u64,
            models: u64,
            outputs: std::ops::Range<usize>,
            columns: Option<Vec<usize>>,
        }
        let (mut sensors, mut controllers, mut plants) = (Vec::new(), Vec::new(), Vec::new());
        let mut standing = Vec::new();
        let mut judges = Vec::new();
        let mut rosters = Vec::new();
        for (k, robot) in parts.robots.into_iter().enumerate() {
            let mut place = |(block, period): (Box<dyn Block<T>>, u64)| {
                let start = signals.len();
                for port in block.outputs() {
                    add(&mut signals, port);
                }
                Placed {
                    outputs: start..signals.len(),
                    block,
                    period,
                    robot: k,
                    with: u64::MAX,
                    models: u64::MAX,
                    columns: None,
                }
            };
            let plant = place((robot.plant, 1));
            let first = plant.outputs.start;
            plants.push(Placed { models: 1, ..plant });
            sensors.extend(robot.sensors.into_iter().map(&mut place));
            let begin = signals.len();
            // Of blocks that take turns several write a signal.
            let mut share = |begin: usize, controlled: Controlled<T>| {
                let start = signals.len();
                let mut columns = Vec::new();
                for port in controlled.block.outputs() {
                    let known = signals[begin..].iter().position(|s| s.path == port.path);
                    columns.push(match known {
                        Some(k) => begin + k,
                        None => add(&mut signals, port),
                    });
                }
                let beside = columns.iter().copied().eq(start..signals.len());
                Placed {
                    outputs: start..signals.len(),
                    block: controlled.block,
                    period: controlled.period,
                    robot: k,
                    with: controlled.with,
                    models: controlled.models,
                    columns: (!beside).then_some(columns),
                }
            };
            for controlled in robot.controllers {
                controllers.push(share(begin, controlled));
            }
            for (model, block) in robot.standing.into_iter().enumerate() {
                let controlled = Controlled {
                    block,
                    period: 1,
                    with: u64::MAX,
                    models: 2 << model,
                };
                standing.push(share(first, controlled));
            }
            rosters.push(Roster {
                names: robot.crew,
                active: 0,
                models: robot.models,
                model: 0,
            });
            let clearance = add(
                &mut signals,
                &Signal::new(format!("robot.{}.clearance", robot.name), "m"),
            );
            judges.push((
                robot.name,
                robot.judge,
                robot.layout,
                robot.has_task,
                robot.judge_period,
                clearance,
            ));
        }
        let driving: Vec<usize> = (0..plants.len()).collect();
        plants.extend(standing);
        // Inputs that nobody writes: commands of robots without a controller.
        for placed in sensors.iter().chain(&controllers).chain(&plants) {
            for port in placed.block.inputs() {
                if !index.contains_key(&port.path) {
                    index.insert(port.path.clone(), signals.len());
                    signals.push(port.clone());
                }
            }
        }
        let slot = |placed: Placed<T>| {
            let inputs: Vec<usize> = placed
                .block
                .inputs()
                .iter()
                .map(|p| index[&p.path])
                .collect();
            Slot {
                buffer: vec![T::zero(); inputs.len()],
                inputs,
                outputs: placed.outputs,
                block: placed.block,
                due: Due::every(placed.period),
                robot: placed.robot,
                with: placed.with,
                models: placed.models,
                shared: placed.columns.map(|columns| Shared {
                    values: vec![T::zero(); columns.len()],
                    columns,
                }),
            }
        };
        let sensors: Vec<Slot<T>> = sensors.into_iter().map(slot).collect();
        let controllers: Vec<Slot<T>> = controllers.into_iter().map(slot).collect();
        let plants: Vec<Slot<T>> = plants.into_iter().map(slot).collect();
        let referees: Vec<Referee<T>> = judges
            .into_iter()
            .map(|(robot, judge, layout, has_task, period, clearance)| {
                let watched = ["pose.x", "pose.y", "twist.forward", "twist.left"]
                    .map(|path| index[&format!("robot.{robot}.{path}")]);
                Referee::new(robot, judge, &layout, has_task, period, watched, clearance)
            })
            .collect();
        // A plant's motion is read by the blocks wired to it and by its judge.
        let readings = plants
            .iter()
            .zip(&referees)
            .map(|(plant, referee)| {
                let period = sensors
                    .iter()
                    .chain(&controllers)
                    .filter(|slot| slot.inputs.iter().any(|i| plant.outputs.contains(i)))
                    .map(|slot| slot.due.period)
                    .fold(referee.due.period, gcd);
                let mut due = Due::every(period);
                due.seek(1);
                due
            })
            .collect();
        let mut world = World {
            step: parts.step,
            tick: 0,
            end: parts.end,
            begun: vec![0; T::LANES],
            ticks: vec![0; T::LANES],
            running: T::Mask::splat(true),
            next_end: parts.end,
            has_decided: false,
            broken: Vec::with_capacity(T::LANES),
            record: Due::every(parts.record),
            row: vec![T::zero(); signals.len()],
            signals,
            sensors,
            controllers,
            any_foreign: plants.iter().any(|slot| slot.block.origin().is_some()),
            plants,
            driving,
            readings,
            referees,
            rosters,
            changes: parts.changes,
            next_change: 0,
            swapped: Vec::new(),
            failures: Vec::new(),
            events: Vec::with_capacity(64),
        };
        world.observe_everything();
        world.begin_judging(T::Mask::splat(true));
        world
    }

    /// Lets the plants leave out what merely follows, where neither the blocks nor the reader of these
    /// columns reads it. What is left keeps its bits.
    pub(crate) fn leave_out(&mut self, observed: &[usize]) {
        let follows = |&column: &usize| {
            let path = &self.signals[column].path;
            path.contains(".energy.") || path.ends_with(".spin_angle")
        };
        let mut blocks = self.sensors.iter().chain(&self.controllers);
        if !observed.iter().any(follows) && !blocks.any(|slot| slot.inputs.iter().any(follows)) {
            for plant in &mut self.plants {
                plant.block.leave_out();
            }
        }
    }

    /// The least time, in ticks, after which everything falls due together: where trials may begin.
    pub(crate) fn cycle(&self) -> u64 {
        let blocks = self.sensors.iter().chain(&self.controllers);
        let periods = blocks.map(|slot| slot.due.period);
        let judges = self.referees.iter().map(|referee| referee.due.period);
        periods
            .chain(judges)
            .chain([self.record.period])
            .fold(1, |a, b| a / gcd(a, b) * b)
    }

    /// Whether a trial could take a lane over: it differs from those here in numbers alone.
    pub(crate) fn fits(&self, parts: &Parts<f64>) -> bool {
        let like = |slot: &Slot<T>, block: &dyn Block<f64>, period: u64| {
            slot.due.period == period && slot.block.fits(block.any())
        };
        let (mut sensors, mut controllers) = (self.sensors.iter(), self.controllers.iter());
        let robots = self.plants.iter().zip(&self.referees).zip(&parts.robots);
        let mut fit = self.step == parts.step
            && self.end == parts.end
            && self.record.period == parts.record
            && self.plants.len() == parts.robots.len()
            // Each lane would change controllers at a tick of its own.
            && self.rosters.iter().all(|roster| {
                roster.names.len() <= 1 && roster.models.len() <= 1
            });
        for ((plant, referee), robot) in robots {
            fit = fit
                && like(plant, robot.plant.as_ref(), 1)
                && robot.sensors.iter().all(|(block, period)| {
                    let slot = sensors.next();
                    slot.is_some_and(|slot| like(slot, block.as_ref(), *period))
                })
                && robot.controllers.iter().all(|one| {
                    let slot = controllers.next();
                    slot.is_some_and(|slot| like(slot, one.block.as_ref(), one.period))
                })
                && referee.fits(robot);
        }
        fit && sensors.next().is_none() && controllers.next().is_none()
    }

    /// Begins a trial, which fits, in a lane, at a tick at which everything falls due.
    pub(crate) fn put(&mut self, lane: usize, parts: Parts<f64>)
    where
        T: Scalar<Single = f64>,
    {
        debug_assert!(self.tick.is_multiple_of(self.cycle()), "not due yet");
        let (mut sensors, mut controllers) = (self.sensors.iter_mut(), self.controllers.iter_mut());
        let robots = self.plants.iter_mut().zip(&mut self.referees);
        for ((plant, referee), robot) in robots.zip(parts.robots) {
            plant.block.take(lane, robot.plant.any());
            let pairs = sensors.by_ref().zip(&robot.sensors);
            for (slot, (block, _)) in pairs.take(robot.sensors.len()) {
                slot.block.take(lane, block.any());
            }
            let pairs = controllers.by_ref().zip(&robot.controllers);
            for (slot, one) in pairs.take(robot.controllers.len()) {
                slot.block.take(lane, one.block.any());
            }
            referee.appoint(lane, robot.judge, &robot.layout);
        }
        // What was told of a trial that never ran is not told.
        self.events.retain(|(of, _)| *of != lane);
        // Outputs of what has not run yet are zero.
        for value in &mut self.row {
            let before = *value;
            *value = T::from_lanes(|i| if i == lane { 0.0 } else { before.lane(i) });
        }
        self.begun[lane] = self.tick;
        self.ticks[lane] = 0;
        self.set_running(lane, true);
        self.observe_everything();
        self.begin_judging(T::Mask::from_lanes(|i| i == lane));
    }

    /// Goes on to a time at which trials may begin, where none goes on.
    pub(crate) fn skip(&mut self) {
        let cycle = self.cycle();
        self.skip_to((self.tick / cycle + 1) * cycle);
    }

    /// Goes on to a later tick, where no trial goes on.
    pub(crate) fn skip_to(&mut self, tick: u64) {
        debug_assert!(!self.running.any(), "a trial goes on");
        self.seek(tick);
    }

    /// Goes to a tick at which nothing has been done yet but reading and judging.
    fn seek(&mut self, tick: u64) {
        self.tick = tick;
        self.next_change = self.changes.partition_point(|change| change.tick < tick);
        self.record.seek(tick);
        for slot in self.sensors.iter_mut().chain(&mut self.controllers) {
            slot.due.seek(tick);
        }
        // What is read and judged after a move has been so at this tick.
        for due in &mut self.readings {
            due.seek(tick + 1);
        }
        for referee in &mut self.referees {
            referee.due.seek(tick + 1);
        }
    }

    /// Writes a signal that no block writes, in one lane.
    pub(crate) fn write(&mut self, lane: usize, column: usize, value: f64) {
        let before = self.row[column];
        self.row[column] = T::from_lanes(|i| if i == lane { value } else { before.lane(i) });
    }

    /// Lets the sensors look that are due at this tick, before anything is decided.
    pub(crate) fn sense(&mut self) {
        let t = self.times();
        self.run_due(Stage::Sense, t);
    }

    /// The verdict on a lane's tasks, if there are any: passed when all are.
    pub(crate) fn verdict(&self, lane: usize) -> Option<Verdict> {
        let tasks = self.referees.iter().filter(|referee| referee.has_task);
        tasks
            .map(|referee| referee.verdict(lane))
            .reduce(|a, b| match (a, b) {
                (Verdict::Failed, _) | (_, Verdict::Failed) => Verdict::Failed,
                (Verdict::Running, _) | (_, Verdict::Running) => Verdict::Running,
                (Verdict::Passed, Verdict::Passed) => Verdict::Passed,
            })
    }

    /// Ticks of a lane's trial.
    pub(crate) fn age(&self, lane: usize) -> u64 {
        self.ticks[lane]
    }

    /// Ticks between rows.
    pub(crate) fn period(&self) -> u64 {
        self.record.period
    }

    /// Leaves a lane empty; the others go on.
    pub(crate) fn clear(&mut self, lane: usize) {
        self.set_running(lane, false);
        self.events.retain(|(of, _)| *of != lane);
    }

    /// Time of a lane's trial, s.
    pub(crate) fn time(&self, lane: usize) -> f64 {
        // Of numbers with a sign conversion is one instruction.
        self.ticks[lane] as i64 as f64 * self.step
    }

    /// Time of all trials, s.
    fn times(&self) -> T {
        T::from_lanes(|lane| self.time(lane))
    }

    /// Says whether a lane has a trial that goes on.
    fn set_running(&mut self, lane: usize, runs: bool) {
        self.running = with(self.running, lane, runs);
        self.next_end = u64::MAX;
        for lane in 0..T::LANES {
            if self.running.lane(lane) {
                self.next_end = self.next_end.min(self.begun[lane] + self.end);
            }
        }
    }

    /// The present tick.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Names and units of the row.
    pub fn signals(&self) -> &[Signal] {
        &self.signals
    }

    /// Values of all signals.
    pub fn row(&self) -> &[T] {
        &self.row
    }

    /// Column of a path.
    pub fn column(&self, path: &str) -> Option<usize> {
        self.signals.iter().position(|signal| signal.path == path)
    }

    /// What broke the trial of a lane off, if anything did.
    pub(crate) fn take_error(&mut self, lane: usize) -> Option<SimError> {
        let at = self.broken.iter().position(|(of, _)| *of == lane)?;
        Some(self.broken.swap_remove(at).1)
    }

    /// Whether a lane has a trial that goes on.
    pub(crate) fn runs(&self, lane: usize) -> bool {
        self.running.lane(lane)
    }

    /// How many lanes have a trial that goes on.
    pub(crate) fn going(&self) -> usize {
        (0..T::LANES).filter(|&lane| self.runs(lane)).count()
    }

    /// Makes a step and goes on while nothing is due but motion, for at most `limit` steps. Trials
    /// that ended do so before the step; true while the others, if there are any, go on.
    pub(crate) fn go(
        &mut self,
        limit: u64,
        listener: &mut dyn Listener<T>,
    ) -> Result<bool, RecordError> {
        let t = self.times();
        self.run_due(Stage::Sense, t);
        self.change_controllers(t);
        self.run_due(Stage::Decide, t);
        let mut ends = T::Mask::splat(false);
        if self.has_decided || self.tick >= self.next_end {
            self.has_decided = false;
            ends = T::Mask::from_lanes(|lane| {
                self.running.lane(lane) && (self.ticks[lane] >= self.end || self.is_decided(lane))
            });
        }
        if self.record.now(self.tick) {
            self.frame(t, self.running, listener)?;
        } else if ends.any() {
            self.frame(t, ends, listener)?;
        }
        if ends.any() {
            for lane in 0..T::LANES {
                if ends.lane(lane) {
                    self.set_running(lane, false);
                }
            }
        }
        if !self.running.any() {
            self.tell_events(listener)?;
            return Ok(false);
        }
        let next = self.next_due().min(self.next_end);
        let ahead = (next - self.tick).min(limit);
        let dt = ahead as f64 * self.step;
        for robot in 0..self.driving.len() {
            let slot = &mut self.plants[self.driving[robot]];
            slot.gather(&self.row);
            let now = Now {
                ticks: &self.ticks,
                t,
                dt,
            };
            if let Err(error) = slot.block.step(&now, &slot.buffer, &mut []) {
                self.recover_motion(error, robot, t, dt);
            }
        }
        self.tick += ahead;
        let tick = self.tick;
        for lane in 0..T::LANES {
            // A trial that broke off stays at its last instant.
            if self.running.lane(lane) {
                self.ticks[lane] = tick - self.begun[lane];
            }
        }
        for (robot, due) in self.readings.iter_mut().enumerate() {
            if due.now(tick) {
                self.plants[self.driving[robot]].observe(Detail::Motion, &mut self.row);
            }
        }
        for k in 0..self.referees.len() {
            if self.referees[k].due.now(tick) {
                self.look(k, self.running);
            }
        }
        self.tell_events(listener)?;
        Ok(self.running.any())
    }

    /// Hands events on.
    fn tell_events(&mut self, listener: &mut dyn Listener<T>) -> Result<(), RecordError> {
        if !self.events.is_empty() {
            for (lane, event) in self.events.drain(..) {
                listener.event(lane, &event)?;
            }
        }
        Ok(())
    }

    /// Runs the blocks of a stage that are due, in the order of their wiring.
    fn run_due(&mut self, stage: Stage, t: T) {
        let count = match stage {
            Stage::Sense => self.sensors.len(),
            Stage::Decide => self.controllers.len(),
        };
        for k in 0..count {
            let slot = match stage {
                Stage::Sense => &mut self.sensors[k],
                Stage::Decide => &mut self.controllers[k],
            };
            if !slot.due.now(self.tick) || !slot.runs(&self.rosters) {
                continue;
            }
            let dt = slot.due.period as f64 * self.step;
            let now = Now {
                ticks: &self.ticks,
                t,
                dt,
            };
            let stepped = slot.step(&now, &mut self.row);
            if let Err(error) = stepped {
                let robot = slot.robot;
                self.recover(error, robot, t);
            }
        }
    }

    /// Breaks trials off in which a block could not go on, `dt` after this tick.
    #[cold]
    fn break_off(&mut self, error: BlockError, dt: f64) {
        for lane in 0..T::LANES {
            if error.lanes & (1 << lane) != 0 && self.running.lane(lane) {
                self.set_running(lane, false);
                let (error, t) = (error.clone(), self.time(lane) + dt);
                self.broken.push((lane, SimError::Block { error, t }));
            }
        }
    }

    /// The first tick after this one at which anything is due.
    fn next_due(&self) -> u64 {
        let mut next = self.record.next;
        if let Some(change) = self.changes.get(self.next_change) {
            next = next.min(change.tick);
        }
        for slot in &self.sensors {
            next = next.min(slot.due.next);
        }
        for slot in &self.controllers {
            next = next.min(slot.due.next);
        }
        for due in &self.readings {
            next = next.min(due.next);
        }
        for referee in &self.referees {
            next = next.min(referee.due.next);
        }
        // A model from a file is moved tick by tick: it is told the time, and may fail in each.
        if self.any_foreign
            && self
                .driving
                .iter()
                .any(|&k| self.plants[k].block.origin().is_some())
        {
            next = next.min(self.tick + 1);
        }
        next
    }

    /// Whether every task of a lane's trial has its verdict.
    fn is_decided(&self, lane: usize) -> bool {
        let mut tasks = false;
        for referee in &self.referees {
            if referee.has_task {
                tasks = true;
                if referee.verdict(lane) == Verdict::Running {
                    return false;
                }
            }
        }
        tasks
    }

    /// Hands a row of these lanes on. One that is not finite breaks its trial off.
    fn frame(
        &mut self,
        t: T,
        mut of: T::Mask,
        listener: &mut dyn Listener<T>,
    ) -> Result<(), RecordError> {
        self.observe_everything();
        let finite = finite_lanes(&self.row);
        if !finite.or(of.not()).all() {
            self.refuse_endless(of);
            of = of.and(finite);
        }
        if of.any() {
            listener.frame(t, &self.row, of)?;
        }
        Ok(())
    }

    /// Breaks trials off whose signals are not finite.
    #[cold]
    fn refuse_endless(&mut self, of: T::Mask) {
        for lane in 0..T::LANES {
            let is_endless = |value: &T| !value.lane(lane).is_finite();
            let found = self.row.iter().position(is_endless);
            if let Some(k) = found.filter(|_| of.lane(lane) && self.running.lane(lane)) {
                self.set_running(lane, false);
                let (path, t) = (self.signals[k].path.clone(), self.time(lane));
                self.broken.push((lane, SimError::NotFinite { path, t }));
            }
        }
    }

    fn observe_everything(&mut self) {
        for &k in &self.driving {
            self.plants[k].observe(Detail::Everything, &mut self.row);
        }
    }
}

/// A stage of a step.
#[derive(Clone, Copy)]
enum Stage {
    Sense,
    Decide,
}

impl World {
    /// Time of the present tick, s.
    pub fn now(&self) -> f64 {
        self.time(0)
    }

    /// Makes one step: sense, decide, record, move, judge. True while there is more to do.
    pub fn step(&mut self, recorder: &mut dyn Recorder) -> Result<bool, SimError> {
        self.advance(1, recorder)
    }

    /// Makes a step and goes on while nothing is due but motion, for at most `limit` steps. The bits
    /// are the same as step by step.
    pub fn advance(&mut self, limit: u64, recorder: &mut dyn Recorder) -> Result<bool, SimError> {
        self.advance_with(limit, &mut Alone(recorder))
    }

    /// The same for a listener.
    pub(crate) fn advance_with(
        &mut self,
        limit: u64,
        listener: &mut dyn Listener<f64>,
    ) -> Result<bool, SimError> {
        let goes_on = self.go(limit, listener)?;
        match self.take_error(0) {
            Some(error) => Err(error),
            None => Ok(goes_on),
        }
    }
}
