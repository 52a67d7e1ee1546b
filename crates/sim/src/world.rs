//! The world: a table of named signals, the blocks that read and write it, and the step loop.
//!
//! A step is sense → decide → record → move → judge. Within a stage blocks run robot after robot in
//! the order of their wiring. Time is the tick times the step, never a sum.

use std::collections::BTreeMap;

use crate::block::{Block, BlockError, Detail};
use crate::judge::{Judge, Verdict};
use crate::layout::Layout;
use crate::record::{Event, RecordError, Recorder};
use crate::signal::Signal;

/// When something is due that repeats: a division at every tick costs more than the tick's logic.
#[derive(Clone, Copy, Debug)]
struct Due {
    /// Ticks between two times.
    period: u64,
    next: u64,
}

impl Due {
    fn every(period: u64) -> Self {
        Due { period, next: 0 }
    }

    /// Whether it is due at this tick; if so, it is next due a period later.
    fn now(&mut self, tick: u64) -> bool {
        let due = tick == self.next;
        if due {
            self.next += self.period;
        }
        due
    }

    /// Goes to another tick, at which nothing has been done yet.
    fn seek(&mut self, tick: u64) {
        self.next = tick.next_multiple_of(self.period);
    }
}

/// A block in its place: when it is due, what it reads and where it writes.
pub(crate) struct Slot {
    pub block: Box<dyn Block>,
    due: Due,
    inputs: Vec<usize>,
    outputs: std::ops::Range<usize>,
    buffer: Vec<f64>,
}

/// What judges a robot.
pub(crate) struct Referee {
    pub robot: String,
    pub judge: Judge,
    pub layout: Layout,
    pub has_task: bool,
    /// Its looks.
    due: Due,
    /// Columns of x, y, forward and left speed.
    watched: [usize; 4],
    /// Column of the clearance.
    clearance: usize,
}

/// Robots, their blocks and the table of signals.
pub struct World {
    step: f64,
    tick: u64,
    end: u64,
    record: Due,
    signals: Vec<Signal>,
    row: Vec<f64>,
    sensors: Vec<Slot>,
    controllers: Vec<Slot>,
    plants: Vec<Slot>,
    /// Readings of each plant's motion.
    readings: Vec<Due>,
    pub(crate) referees: Vec<Referee>,
    events: Vec<Event>,
}

/// Why a step could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// A block could not go on.
    #[error(transparent)]
    Block(#[from] BlockError),
    /// A signal is not finite.
    #[error("{path}: is not finite at t = {t} s")]
    NotFinite {
        /// Path of the signal.
        path: String,
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
pub(crate) struct RobotBlocks {
    pub name: String,
    pub sensors: Vec<(Box<dyn Block>, u64)>,
    pub controllers: Vec<(Box<dyn Block>, u64)>,
    pub plant: Box<dyn Block>,
    pub judge: Judge,
    pub layout: Layout,
    pub has_task: bool,
    pub judge_period: u64,
}

impl World {
    /// Wires robots; every input finds the output of its path, or stays at zero.
    pub(crate) fn wire(step: f64, end: u64, record: u64, robots: Vec<RobotBlocks>) -> World {
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
        struct Placed {
            block: Box<dyn Block>,
            period: u64,
            outputs: std::ops::Range<usize>,
        }
        let (mut sensors, mut controllers, mut plants) = (Vec::new(), Vec::new(), Vec::new());
        let mut judges = Vec::new();
        for robot in robots {
            let mut place = |(block, period): (Box<dyn Block>, u64)| {
                let start = signals.len();
                for port in block.outputs() {
                    add(&mut signals, port);
                }
                Placed {
                    outputs: start..signals.len(),
                    block,
                    period,
                }
            };
            plants.push(place((robot.plant, 1)));
            sensors.extend(robot.sensors.into_iter().map(&mut place));
            controllers.extend(robot.controllers.into_iter().map(&mut place));
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
        // Inputs that nobody writes: commands of robots without a controller.
        for placed in sensors.iter().chain(&controllers).chain(&plants) {
            for port in placed.block.inputs() {
                if !index.contains_key(&port.path) {
                    index.insert(port.path.clone(), signals.len());
                    signals.push(port.clone());
                }
            }
        }
        let slot = |placed: Placed| {
            let inputs: Vec<usize> = placed
                .block
                .inputs()
                .iter()
                .map(|p| index[&p.path])
                .collect();
            Slot {
                buffer: vec![0.0; inputs.len()],
                inputs,
                outputs: placed.outputs,
                block: placed.block,
                due: Due::every(placed.period),
            }
        };
        let sensors: Vec<Slot> = sensors.into_iter().map(slot).collect();
        let controllers: Vec<Slot> = controllers.into_iter().map(slot).collect();
        let plants: Vec<Slot> = plants.into_iter().map(slot).collect();
        let referees: Vec<Referee> = judges
            .into_iter()
            .map(
                |(robot, judge, layout, has_task, period, clearance)| Referee {
                    watched: ["pose.x", "pose.y", "twist.forward", "twist.left"]
                        .map(|path| index[&format!("robot.{robot}.{path}")]),
                    robot,
                    judge,
                    layout,
                    has_task,
                    due: Due::every(period),
                    clearance,
                },
            )
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
            step,
            tick: 0,
            end,
            record: Due::every(record),
            row: vec![0.0; signals.len()],
            signals,
            sensors,
            controllers,
            plants,
            readings,
            referees,
            events: Vec::with_capacity(64),
        };
        world.observe_everything();
        world.judge(0);
        world
    }

    /// Time of the present tick, s.
    pub fn now(&self) -> f64 {
        self.tick as f64 * self.step
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
    pub fn row(&self) -> &[f64] {
        &self.row
    }

    /// Column of a path.
    pub fn column(&self, path: &str) -> Option<usize> {
        self.signals.iter().position(|signal| signal.path == path)
    }

    /// Makes one step: sense, decide, record, move, judge. True while there is more to do.
    pub fn step(&mut self, recorder: &mut dyn Recorder) -> Result<bool, SimError> {
        self.advance(1, recorder)
    }

    /// Makes a step and goes on while nothing is due but motion, for at most `limit` steps. The bits
    /// are the same as step by step.
    pub fn advance(&mut self, limit: u64, recorder: &mut dyn Recorder) -> Result<bool, SimError> {
        let (tick, t) = (self.tick, self.now());
        run_due(&mut self.sensors, tick, t, self.step, &mut self.row)?;
        run_due(&mut self.controllers, tick, t, self.step, &mut self.row)?;
        let ends = tick >= self.end || self.is_decided();
        if self.record.now(tick) || ends {
            self.frame(recorder)?;
        }
        if ends {
            return Ok(false);
        }
        let ahead = (self.next_due() - tick).min(limit);
        for slot in &mut self.plants {
            slot.gather(&self.row);
            let dt = ahead as f64 * self.step;
            slot.block.step(tick, t, dt, &slot.buffer, &mut [])?;
        }
        self.tick += ahead;
        let tick = self.tick;
        for (k, due) in self.readings.iter_mut().enumerate() {
            if due.now(tick) {
                self.plants[k].observe(Detail::Motion, &mut self.row);
            }
        }
        self.judge(tick);
        if !self.events.is_empty() {
            for event in self.events.drain(..) {
                recorder.event(&event)?;
            }
        }
        Ok(true)
    }

    /// The first tick after this one at which anything is due, or the end.
    fn next_due(&self) -> u64 {
        let mut next = self.end.min(self.record.next);
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
        next
    }

    /// Whether every task has its verdict.
    fn is_decided(&self) -> bool {
        let mut tasks = self
            .referees
            .iter()
            .filter(|referee| referee.has_task)
            .peekable();
        tasks.peek().is_some() && tasks.all(|referee| referee.judge.verdict() != Verdict::Running)
    }

    fn frame(&mut self, recorder: &mut dyn Recorder) -> Result<(), SimError> {
        self.observe_everything();
        if let Some(k) = self.row.iter().position(|value| !value.is_finite()) {
            return Err(SimError::NotFinite {
                path: self.signals[k].path.clone(),
                t: self.now(),
            });
        }
        recorder.frame(self.now(), &self.row)?;
        Ok(())
    }

    fn observe_everything(&mut self) {
        for slot in &mut self.plants {
            slot.observe(Detail::Everything, &mut self.row);
        }
    }

    fn judge(&mut self, tick: u64) {
        let t = tick as f64 * self.step;
        for referee in &mut self.referees {
            if !referee.due.now(tick) {
                continue;
            }
            let [x, y, forward, left] = referee.watched.map(|k| self.row[k]);
            let speed = crate::plant::speed(forward, left);
            referee.judge.observe(t, [x, y], speed);
            self.row[referee.clearance] = referee.layout.clearance([x, y]);
            for event in referee.judge.take_events() {
                self.events.push(Event {
                    t: event.t,
                    robot: referee.robot.clone(),
                    kind: "task".into(),
                    text: event.text,
                    position: Some(event.position),
                });
            }
        }
    }

    /// The whole state as bytes, at any tick.
    pub fn save(&self) -> Vec<u8> {
        let mut bytes = self.tick.to_le_bytes().to_vec();
        crate::block::save_numbers(&self.row, &mut bytes);
        for slot in self.slots() {
            slot.block.save(&mut bytes);
        }
        for referee in &self.referees {
            let judge = serde_json::to_vec(&referee.judge).expect("a judge is plain data");
            bytes.extend_from_slice(&(judge.len() as u64).to_le_bytes());
            bytes.extend_from_slice(&judge);
        }
        bytes
    }

    /// Takes back a state saved by a world of the same scenario and version.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), RestoreError> {
        self.try_restore(bytes).ok_or(RestoreError)
    }

    fn try_restore(&mut self, bytes: &[u8]) -> Option<()> {
        let tick = u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?);
        let mut at = 8;
        at += crate::block::restore_numbers(&mut self.row, &bytes[at..])?;
        let slots = self
            .sensors
            .iter_mut()
            .chain(&mut self.controllers)
            .chain(&mut self.plants);
        for slot in slots {
            at += slot.block.restore(bytes.get(at..)?)?;
        }
        for referee in &mut self.referees {
            let size = u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?) as usize;
            at += 8;
            referee.judge = serde_json::from_slice(bytes.get(at..at.checked_add(size)?)?).ok()?;
            at += size;
        }
        self.tick = tick;
        self.record.seek(tick);
        for slot in self.sensors.iter_mut().chain(&mut self.controllers) {
            slot.due.seek(tick);
        }
        // What is read and judged after a move has been so at the saved tick.
        for due in &mut self.readings {
            due.seek(tick + 1);
        }
        for referee in &mut self.referees {
            referee.due.seek(tick + 1);
        }
        (at == bytes.len()).then_some(())
    }

    fn slots(&self) -> impl Iterator<Item = &Slot> {
        self.sensors
            .iter()
            .chain(&self.controllers)
            .chain(&self.plants)
    }
}

impl Slot {
    /// Writes the outputs of the present state.
    fn observe(&mut self, detail: Detail, row: &mut [f64]) {
        self.gather(row);
        let outputs = &mut row[self.outputs.clone()];
        self.block.observe(&self.buffer, detail, outputs);
    }

    fn gather(&mut self, row: &[f64]) {
        // Zipped iterators are calls here, and this is the heart of every tick.
        for (k, &index) in self.inputs.iter().enumerate() {
            self.buffer[k] = row[index];
        }
    }
}

/// Runs the blocks of a stage that are due, in the order of their wiring.
fn run_due(
    slots: &mut [Slot],
    tick: u64,
    t: f64,
    step: f64,
    row: &mut [f64],
) -> Result<(), BlockError> {
    for slot in slots {
        if slot.due.now(tick) {
            slot.gather(row);
            let dt = slot.due.period as f64 * step;
            slot.block
                .step(tick, t, dt, &slot.buffer, &mut row[slot.outputs.clone()])?;
        }
    }
    Ok(())
}

/// Greatest common divisor.
fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}
