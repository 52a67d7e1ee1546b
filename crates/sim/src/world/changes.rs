//! Changes of controllers, and what follows where one fails.

use appell_model::scalar::Scalar;
use serde::{Deserialize, Serialize};

use super::{Shared, Slot, World, gcd};
use crate::block::{Block, BlockError, Cost, Detail, Now, Port, Recovery};
use crate::foreign::commands_twist;
use crate::record::Event;

/// A change of controllers.
#[derive(Clone, Debug)]
pub(crate) struct Change {
    pub tick: u64,
    /// Place of the robot.
    pub robot: usize,
    pub to: To,
}

/// What takes over: a controller or a model, by its place among the robot's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum To {
    Controller(usize),
    Model(usize),
}

/// A change of controllers that was made, or could not be.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Swapped {
    /// Time, s.
    pub t: f64,
    /// Name of the robot.
    pub robot: String,
    /// The controller that wrote commands before.
    pub from: String,
    /// The one that was to take over.
    pub to: String,
    /// SHA-256 of the new one's file, of a plug-in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hash: Option<String>,
    /// Why the old one went on, if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// A controller that failed, where the run went on.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Failure {
    /// Time, s.
    pub t: f64,
    /// Step of the simulation.
    pub step: u64,
    /// Path of the controller.
    pub block: String,
    /// What happened: the field, and what is wrong with it.
    pub problem: String,
}

/// The controllers and models of a robot, by name, and which of them run.
pub(super) struct Roster {
    pub(super) names: Vec<String>,
    pub(super) active: usize,
    pub(super) models: Vec<String>,
    pub(super) model: usize,
}

impl<T: Scalar> World<T> {
    /// Makes the changes that are due.
    pub(super) fn change_controllers(&mut self, t: T) {
        while let Some(change) = self.changes.get(self.next_change)
            && change.tick <= self.tick
        {
            let (robot, to) = (change.robot, change.to);
            self.next_change += 1;
            match to {
                To::Controller(to) => self.swap(robot, to, t),
                To::Model(to) => self.swap_models(robot, to, t),
            }
        }
    }

    /// Lets another controller of a robot take over, if it can.
    #[cold]
    fn swap(&mut self, robot: usize, to: usize, t: T) {
        let roster = &self.rosters[robot];
        let from = roster.active;
        if from == to {
            return;
        }
        let name = self.referees[robot].robot.clone();
        let mut told = Swapped {
            t: t.lane(0),
            robot: name.clone(),
            from: roster.names[from].clone(),
            to: roster.names[to].clone(),
            hash: None,
            refused: None,
        };
        let (old, new) = (1 << from, 1 << to);
        for slot in &mut self.controllers {
            if slot.robot != robot || slot.with & new == 0 || slot.with & old != 0 {
                continue;
            }
            slot.gather(&self.row);
            let before: Vec<T> = slot.columns().map(|k| self.row[k]).collect();
            if let Err(error) = slot.block.take_over(&slot.buffer, &before) {
                told.refused = Some(error.problem);
            }
            if let Some(hash) = slot.block.origin() {
                told.hash = Some(hash.to_owned());
            }
        }
        if told.refused.is_none() {
            self.rosters[robot].active = to;
            self.silence(robot, old, new);
        }
        self.tell_swap(robot, told, t);
    }

    /// Lets another model of a robot take over, if it can, and what commands it.
    #[cold]
    fn swap_models(&mut self, robot: usize, to: usize, t: T) {
        let roster = &self.rosters[robot];
        let from = roster.model;
        if from == to {
            return;
        }
        let mut told = Swapped {
            t: t.lane(0),
            robot: self.referees[robot].robot.clone(),
            from: roster.models[from].clone(),
            to: roster.models[to].clone(),
            hash: None,
            refused: None,
        };
        let is_new = |slot: &Slot<T>| slot.robot == robot && slot.models & (1 << to) != 0;
        let (old, new) = (self.driving[robot], self.plants.iter().position(is_new));
        let new = new.expect("a model has its plant");
        self.plants[old].observe(Detail::Everything, &mut self.row);
        let written: Vec<usize> = self.plants[old].columns().collect();
        let slot = &mut self.plants[new];
        // What the old one does not know begins at zero.
        let last = |k: usize| match written.contains(&k) {
            true => self.row[k],
            false => T::zero(),
        };
        let before: Vec<T> = slot.columns().map(last).collect();
        slot.gather(&self.row);
        told.hash = slot.block.origin().map(str::to_owned);
        if let Err(error) = slot.block.take_over(&slot.buffer, &before) {
            told.refused = Some(error.problem);
        } else {
            self.driving[robot] = new;
            self.rosters[robot].model = to;
            // Each sees the other's last words only.
            let commanded = |models: u64| {
                let slots = self.controllers.iter();
                slots.filter(move |slot| {
                    slot.robot == robot && slot.models != u64::MAX && slot.models & models != 0
                })
            };
            let stays: Vec<usize> = self.plants[new]
                .columns()
                .chain(commanded(1 << to).flat_map(Slot::columns))
                .collect();
            let gone: Vec<usize> = written
                .into_iter()
                .chain(commanded(1 << from).flat_map(Slot::columns))
                .collect();
            self.zero(&gone, &stays);
            self.plants[new].observe(Detail::Everything, &mut self.row);
            self.command_anew(robot, to, t);
        }
        self.tell_swap(robot, told, t);
    }

    /// Lets what commands a model that took over do so at once: until it is due the model would be left to
    /// itself.
    fn command_anew(&mut self, robot: usize, model: usize, t: T) {
        for k in 0..self.controllers.len() {
            let slot = &mut self.controllers[k];
            let is_new = slot.models != u64::MAX && slot.models & (1 << model) != 0;
            if slot.robot != robot || !is_new || !slot.runs(&self.rosters) {
                continue;
            }
            slot.gather(&self.row);
            let before: Vec<T> = slot.columns().map(|k| self.row[k]).collect();
            let mut begun = slot.block.take_over(&slot.buffer, &before);
            if slot.due.next != self.tick {
                let now = Now {
                    ticks: &self.ticks,
                    t,
                    dt: slot.due.period as f64 * self.step,
                };
                begun = begun.and_then(|()| slot.step(&now, &mut self.row));
            }
            if let Err(error) = begun {
                self.recover(error, robot, t);
            }
        }
    }

    /// Does what follows where a model could not go on for `dt`.
    #[cold]
    pub(super) fn recover_motion(&mut self, error: BlockError, robot: usize, t: T, dt: f64) {
        let to = match error.then {
            Recovery::End => return self.break_off(error, dt),
            Recovery::Stop => return self.fail(error, robot, "it stays where it is", t),
            Recovery::Swap(to) => to,
        };
        let then = format!("{} is to take over", self.rosters[robot].models[to]);
        self.fail(error, robot, &then, t);
        self.swap_models(robot, to, t);
        let slot = &mut self.plants[self.driving[robot]];
        slot.gather(&self.row);
        let now = Now {
            ticks: &self.ticks,
            t,
            dt,
        };
        // The chain of those that take over from each other has an end.
        if let Err(error) = slot.block.step(&now, &slot.buffer, &mut []) {
            self.recover_motion(error, robot, t, dt);
        }
    }

    /// Zeros columns, but for some.
    fn zero(&mut self, columns: &[usize], but: &[usize]) {
        for &k in columns.iter().filter(|k| !but.contains(k)) {
            self.row[k] = T::zero();
        }
    }

    /// Zeros what only the controllers that went wrote.
    fn silence(&mut self, robot: usize, old: u64, new: u64) {
        let of = |with: u64| {
            let slots = self.controllers.iter();
            slots.filter(move |slot| slot.robot == robot && slot.with & with != 0)
        };
        let written: Vec<usize> = of(new).flat_map(Slot::columns).collect();
        let silent: Vec<usize> = of(old).flat_map(Slot::columns).collect();
        self.zero(&silent, &written);
    }

    /// Writes a change down.
    fn tell_swap(&mut self, robot: usize, told: Swapped, t: T) {
        let text = match &told.refused {
            Some(problem) => format!(
                "{} could not take over, {} goes on: {problem}",
                told.to, told.from
            ),
            None => {
                let hash = told.hash.as_ref();
                let hash = hash.map_or(String::new(), |hash| format!(" ({})", &hash[..12]));
                format!("{}{hash} took over from {}", told.to, told.from)
            }
        };
        self.tell(robot, "swap", text, t);
        self.swapped.push(told);
    }

    /// Does what follows where a controller could not go on.
    #[cold]
    pub(super) fn recover(&mut self, error: BlockError, robot: usize, t: T) {
        if error.then == Recovery::End {
            return self.break_off(error, 0.0);
        }
        let recovery = error.then.clone();
        let then = match recovery {
            Recovery::Swap(to) => format!("{} is to take over", self.rosters[robot].names[to]),
            _ => "its commands are zero from here".to_owned(),
        };
        self.fail(error, robot, &then, t);
        if let Recovery::Swap(to) = recovery {
            self.swap(robot, to, t);
        }
    }

    /// Writes a failure down.
    fn fail(&mut self, error: BlockError, robot: usize, then: &str, t: T) {
        let failure = Failure {
            t: t.lane(0),
            step: self.ticks[0],
            block: error.block,
            problem: error.problem,
        };
        let Failure {
            step,
            block,
            problem,
            ..
        } = &failure;
        let text = format!("{block} failed at step {step}: {problem}; {then}");
        self.failures.push(failure);
        self.tell(robot, "fault", text, t);
    }

    /// An event of a robot, in a world of one trial.
    fn tell(&mut self, robot: usize, kind: &str, text: String, t: T) {
        let referee = &self.referees[robot];
        let [x, y, ..] = referee.watched.map(|k| self.row[k].lane(0));
        let event = Event {
            t: t.lane(0),
            robot: referee.robot.clone(),
            kind: kind.into(),
            text,
            position: Some([x, y]),
        };
        self.events.push((0, event));
    }

    /// Names of a robot's models.
    pub(crate) fn models(&self, robot: usize) -> &[String] {
        &self.rosters[robot].models
    }

    /// Names of a robot's controllers.
    pub(crate) fn crew(&self, robot: usize) -> &[String] {
        &self.rosters[robot].names
    }

    /// Whether a controller, or a model, of a robot runs.
    pub(crate) fn is_active(&self, robot: usize, one: To) -> bool {
        let roster = &self.rosters[robot];
        match one {
            To::Controller(place) => roster.active == place,
            To::Model(place) => roster.model == place,
        }
    }

    /// Adds a change that is due now, or later.
    pub(crate) fn schedule(&mut self, change: Change) {
        let after = self.changes.partition_point(|one| one.tick <= change.tick);
        self.changes.insert(after.max(self.next_change), change);
    }

    /// Lets another take over where `from` would have.
    pub(crate) fn redirect(&mut self, robot: usize, from: To, to: To) {
        for change in &mut self.changes[self.next_change..] {
            if change.robot == robot && change.to == from {
                change.to = to;
            }
        }
    }

    /// Adds a controller to a robot, in every way like another of its own; its place, or why not.
    pub(crate) fn join(
        &mut self,
        robot: usize,
        like: usize,
        name: String,
        block: Box<dyn Block<T>>,
    ) -> Result<usize, String> {
        let (inputs, columns) = self.columns_of(block.as_ref())?;
        let is_of = |slot: &Slot<T>| slot.robot == robot;
        let begin = self.controllers.iter().position(is_of);
        let begin = begin.ok_or("the robot has no controller")?;
        let new = self.rosters[robot].names.len();
        let old = &self.controllers[begin + like];
        if commands_twist(old.block.outputs()) != commands_twist(block.outputs()) {
            return Err("must command what its predecessor did: the twist, or the wheels".into());
        }
        let due = old.due;
        for (k, slot) in self
            .controllers
            .iter_mut()
            .enumerate()
            .filter(|(_, slot)| slot.robot == robot)
        {
            if k < begin + new {
                // One that was alone ran always.
                slot.with = 1 << (k - begin);
            } else if slot.with != u64::MAX && slot.with & (1 << like) != 0 {
                slot.with |= 1 << new;
            }
        }
        let slot = Slot {
            buffer: vec![T::zero(); inputs.len()],
            inputs,
            outputs: 0..0,
            block,
            due,
            robot,
            with: 1 << new,
            models: u64::MAX,
            shared: Some(Shared {
                values: vec![T::zero(); columns.len()],
                columns,
            }),
        };
        // What it reads of the motion has to be up to date when it is due.
        if slot
            .inputs
            .iter()
            .any(|k| self.plants[robot].outputs.contains(k))
        {
            let reading = &mut self.readings[robot];
            reading.period = gcd(reading.period, slot.due.period);
            reading.seek(self.tick + 1);
            self.plants[self.driving[robot]].observe(Detail::Motion, &mut self.row);
        }
        self.controllers.insert(begin + new, slot);
        self.rosters[robot].names.push(name);
        Ok(new)
    }

    /// Adds a model to a robot, which nothing but controllers commands; its place, or why not.
    pub(crate) fn join_model(
        &mut self,
        robot: usize,
        name: String,
        block: Box<dyn Block<T>>,
    ) -> Result<usize, String> {
        let (inputs, columns) = self.columns_of(block.as_ref())?;
        let sensors = self.sensors.iter();
        let deciding = self
            .controllers
            .iter()
            .filter(|slot| slot.models == u64::MAX);
        let readers = sensors.chain(deciding).filter(|slot| slot.robot == robot);
        let moved = |k: &&usize| self.plants[robot].outputs.contains(k);
        let read = readers.flat_map(|slot| slot.inputs.iter().filter(moved));
        if let Some(&lacks) = read.into_iter().find(|k| !columns.contains(k)) {
            let path = &self.signals[lacks].path;
            return Err(format!(
                "must write {path}, which a sensor or controller reads"
            ));
        }
        let new = self.rosters[robot].models.len();
        self.any_foreign = true;
        self.plants.push(Slot {
            buffer: vec![T::zero(); inputs.len()],
            inputs,
            outputs: 0..0,
            block,
            due: self.plants[robot].due,
            robot,
            with: u64::MAX,
            models: 1 << new,
            shared: Some(Shared {
                values: vec![T::zero(); columns.len()],
                columns,
            }),
        });
        self.rosters[robot].models.push(name);
        Ok(new)
    }

    /// Columns of a block's inputs and outputs, in units that agree, or what there is no column for.
    fn columns_of(&self, block: &dyn Block<T>) -> Result<(Vec<usize>, Vec<usize>), String> {
        let column = |port: &Port| {
            let path = &port.path;
            let found = self.column(path).ok_or_else(|| {
                format!("{path}: must be among the signals from the beginning of the run")
            })?;
            let unit = &self.signals[found].unit;
            match port.unit == *unit {
                true => Ok(found),
                false => Err(format!("{path}: must be in {unit}, got {}", port.unit)),
            }
        };
        let inputs = block
            .inputs()
            .iter()
            .map(column)
            .collect::<Result<_, _>>()?;
        let outputs = block.outputs().iter().map(column);
        Ok((inputs, outputs.collect::<Result<_, _>>()?))
    }

    /// Writes down that a controller or model could not take over.
    pub(crate) fn refuse(&mut self, robot: usize, of: &str, to: &str, problem: &str) {
        let roster = &self.rosters[robot];
        let from = match roster.models.iter().any(|name| name == of) {
            true => roster.models[roster.model].clone(),
            false => roster.names[roster.active].clone(),
        };
        let text = format!("{to} could not take over, {from} goes on: {problem}");
        let t = T::from_lanes(|lane| self.time(lane));
        self.swapped.push(Swapped {
            t: t.lane(0),
            robot: self.referees[robot].robot.clone(),
            from,
            to: to.to_owned(),
            hash: None,
            refused: Some(problem.to_owned()),
        });
        self.tell(robot, "swap", text, t);
    }

    /// Controllers that failed so far, where the run went on.
    pub fn failures(&self) -> &[Failure] {
        &self.failures
    }

    /// Changes of controllers so far.
    pub fn swapped(&self) -> &[Swapped] {
        &self.swapped
    }
}

impl World {
    /// Tells of something at the next step.
    pub(crate) fn announce(&mut self, event: Event) {
        self.events.push((0, event));
    }

    /// Leaves out what was to be told of the same thing at this instant.
    pub(crate) fn forget(&mut self, event: &Event) {
        let what = |text: &str| text.split_once(": ").map(|(what, _)| what.to_owned());
        self.events.retain(|(_, one)| {
            one.t != event.t
                || one.kind != event.kind
                || one.robot != event.robot
                || what(&one.text) != what(&event.text)
        });
    }

    /// Takes over what another world has not told yet.
    pub(crate) fn inherit(&mut self, other: &mut World) {
        self.events.append(&mut other.events);
    }

    /// What steps of one of a robot's controllers take, where that is measured.
    pub(crate) fn cost(&self, robot: usize, controller: usize) -> Option<Cost> {
        let own = self.controllers.iter();
        let mut own = own.filter(|slot| slot.robot == robot && slot.with & (1 << controller) != 0);
        own.find_map(|slot| slot.block.cost())
    }

    /// Names of a robot's controllers, and the place of the one that drives, or takes over at the next step.
    pub(crate) fn deciding(&self, robot: usize) -> (&[String], usize) {
        let roster = &self.rosters[robot];
        // What takes over at the next step was chosen already.
        let waiting = self.changes[self.next_change..].iter();
        let due = waiting.take_while(|change| change.tick <= self.tick);
        let chosen = due.filter(|change| change.robot == robot);
        let chosen = chosen.filter_map(|change| match change.to {
            To::Controller(place) => Some(place),
            To::Model(_) => None,
        });
        (&roster.names, chosen.last().unwrap_or(roster.active))
    }

    /// Where a robot is, m.
    pub(crate) fn place(&self, robot: &str) -> Option<[f64; 2]> {
        let referee = self.referees.iter().find(|one| one.robot == robot)?;
        let [x, y, ..] = referee.watched.map(|k| self.row[k]);
        Some([x, y])
    }
}
