//! Plug-ins as blocks: controllers and models in files of their own.

use std::any::Any;
use std::cell::RefCell;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use appell_model::scalar::Scalar;
use appell_plugin::{Fault, Limits, Plugin};
use serde_json::{Value, json};

use crate::block::{
    Block, BlockError, Cost, Detail, Now, Port, Recovery, restore_numbers, save_numbers,
};
use crate::plan;
use crate::scenario::{OnFailure, Plugin as File, Robot, Scenario, Task};

/// What the commands of a plug-in begin with, and what else it may write, to be looked at.
const COMMAND: &str = "command.";
const OWN: &str = "controller.";

/// What a model must write, what else it may write, to be looked at, and what it may read.
const MOTION: [&str; 6] = [
    "pose.x",
    "pose.y",
    "pose.yaw",
    "twist.forward",
    "twist.left",
    "twist.yaw_rate",
];
const OF_MODEL: &str = "model.";
const COMMANDS: [(&str, &str); 4] = [
    ("command.forward", "m/s"),
    ("command.left", "m/s"),
    ("command.yaw_rate", "rad/s"),
    ("brake", "1"),
];

/// Of so many steps one is measured: looking at the clock takes longer than a short step does.
const MEASURED: u64 = 8;

/// How a saved plug-in was.
const FAILED: u8 = 0;
const RUNNING: u8 = 1;
const UNKNOWN: u8 = 2;

/// Plug-ins that run and wait for work: the trials of a batch take turns with them.
#[derive(Default)]
pub(crate) struct Pool(Mutex<Vec<Idle>>);

struct Idle {
    file: PathBuf,
    limits: Limits,
    plugin: Plugin,
}

impl Pool {
    /// One of a file, new if none waits.
    fn take(&self, file: &Path, limits: &Limits) -> Result<Plugin, Fault> {
        let mut idle = self.0.lock().expect("nothing panics with it");
        let found = idle
            .iter()
            .position(|one| one.file == file && one.limits == *limits);
        if let Some(k) = found {
            return Ok(idle.swap_remove(k).plugin);
        }
        drop(idle);
        Plugin::open(file, limits.clone())
    }

    fn give(&self, file: &Path, limits: &Limits, plugin: Plugin) {
        if plugin.is_alive() {
            let mut idle = self.0.lock().expect("nothing panics with it");
            idle.push(Idle {
                file: file.to_owned(),
                limits: limits.clone(),
                plugin,
            });
        }
    }
}

/// A plug-in in a world of plain numbers; in lanes it only holds a place, for it is run alone.
pub(crate) struct Foreign<T> {
    name: String,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    file: PathBuf,
    limits: Limits,
    parameters: std::collections::BTreeMap<String, f64>,
    context: Value,
    role: Role,
    recovery: Recovery,
    hash: String,
    pool: Arc<Pool>,
    /// Saving, too, has to speak to it.
    life: RefCell<Life>,
    /// Inputs that do not change, with their places among all, in order.
    constants: Vec<(usize, f64)>,
    values: [Vec<f64>; 2],
    /// Steps that were made, and what those took that were measured.
    steps: u64,
    cost: Cost,
    numbers: PhantomData<T>,
}

/// Whether any of a robot's signals commands its twist.
pub(crate) fn commands_twist(ports: &[Port]) -> bool {
    // robot.NAME.command.forward
    let field = |port: &Port| port.path.split('.').nth(2) == Some("command");
    ports.iter().any(field)
}

/// How far a plug-in has come.
enum Life {
    /// It is started when it is needed first.
    Waiting,
    Running(Box<Plugin>, u32),
    /// It failed: its commands, or rates, are zero.
    Failed,
}

/// A plug-in of a robot before it is built.
pub(crate) struct Request<'a> {
    pub scenario: &'a Scenario,
    pub robot: &'a Robot,
    /// Name among the robot's controllers, or its models.
    pub name: &'a str,
    pub plugin: &'a File,
    pub folder: &'a Path,
    /// Whether a library may be loaded into this process.
    pub is_trusted: bool,
    pub trial: u64,
    /// The way of its task, where there is one.
    pub way: Option<&'a plan::Path>,
    pub reach: &'a Reach,
    pub role: Role,
}

/// What a plug-in is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// It decides.
    Controller,
    /// It moves: reads commands, and writes pose and twist.
    Model,
}

/// What the plug-ins of a robot may read and write.
#[derive(Clone, Default)]
pub(crate) struct Reach {
    /// Signals that they may read.
    pub known: Vec<Port>,
    /// Signals that the robot's first model writes.
    pub moved: Vec<Port>,
    /// Commands of wheels: the name below the robot, and the signal that it stands for.
    pub commands: Vec<(String, Port)>,
}

/// Files of plug-ins with their SHA-256, a line each: what a scenario's text does not say of them.
pub(crate) fn digests(scenario: &Scenario, folder: &Path) -> String {
    let files = scenario.robot.iter().flat_map(Robot::plugins);
    let files = files.map(|(_, plugin)| plugin.file.as_str());
    let line = |file: &str| {
        let bytes = std::fs::read(folder.join(file)).unwrap_or_default();
        format!("\n# {file} {}", appell_plugin::digest(&bytes))
    };
    files.map(line).collect()
}

impl<T: Scalar> Foreign<T> {
    /// Starts a plug-in, asks it what it is, and joins its ports to the robot's signals.
    ///
    /// # Errors
    /// It cannot be started, or its ports do not fit the robot.
    pub(crate) fn new(request: &Request<'_>, pool: &Arc<Pool>) -> Result<Self, Fault> {
        let Request { robot, plugin, .. } = request;
        let file = request.folder.join(&plugin.file);
        let limits = Limits {
            answer: Duration::from_secs_f64(plugin.time_limit),
            memory: plugin.memory,
            fuel: plugin.fuel,
            is_trusted: request.is_trusted,
            ..Limits::default()
        };
        let mut opened = pool.take(&file, &limits)?;
        let context = request.context();
        // A member is made at once, so that what is wrong is found before the run begins.
        let member = opened.create(&plugin.parameters, &context)?;
        let descriptor = opened.descriptor();
        let prefix = format!("robot.{}.", robot.name);
        let known = |name: &String| {
            let inputs = descriptor.inputs.iter().map(|port| &port.name);
            inputs
                .chain(descriptor.outputs.iter().map(|port| &port.name))
                .any(|port| port == name)
        };
        if let Some(name) = plugin.ports.keys().find(|name| !known(name)) {
            return Err(Fault {
                field: format!("ports.{name}"),
                problem: "must be a port of the plug-in".into(),
                hint: "`appell plugin describe` lists them".into(),
            });
        }
        let (mut inputs, mut constants) = (Vec::new(), Vec::new());
        for (k, port) in descriptor.inputs.iter().enumerate() {
            let name = request.named(&port.name);
            match request.constant(&name) {
                Some(value) => {
                    request.in_unit(&port.name, "m", &port.unit)?;
                    constants.push((k, value));
                }
                None => inputs.push(request.input(&prefix, &port.name, &name, &port.unit)?),
            }
        }
        let mut outputs = Vec::new();
        for port in &descriptor.outputs {
            let name = request.named(&port.name);
            outputs.push(request.output(&prefix, &port.name, &name, &port.unit)?);
        }
        let twice =
            |(k, port): (usize, &Port)| outputs[..k].iter().any(|one| one.path == port.path);
        if let Some(k) = outputs.iter().enumerate().position(twice) {
            return Err(Fault {
                field: format!("outputs.{}", descriptor.outputs[k].name),
                problem: format!("must be a signal of its own, got {} again", outputs[k].path),
                hint: "give it another signal in ports".into(),
            });
        }
        let writes = |begins: &str| {
            let mut written = outputs.iter().filter_map(|p| p.path.strip_prefix(&prefix));
            written.any(|name| name.starts_with(begins))
        };
        let (twist, wheels) = (writes(COMMAND), writes("wheel."));
        if request.role == Role::Model {
            let written = |name: &&&str| {
                let path = format!("{prefix}{name}");
                outputs.iter().any(|port| port.path == path)
            };
            if let Some(name) = MOTION.iter().find(|name| !written(name)) {
                return Err(Fault {
                    field: "outputs".into(),
                    problem: format!("must have {name}, as every model"),
                    hint: format!("a model writes {}", MOTION.join(", ")),
                });
            }
        } else if twist && wheels || !(twist || wheels || writes("brake")) {
            return Err(Fault {
                field: "outputs".into(),
                problem: "must command either the twist or the wheels".into(),
                hint: format!("one of {}", request.writable().join(", ")),
            });
        }
        let recovery = match (&plugin.fallback, plugin.on_failure) {
            (Some(name), _) => {
                let place = match request.role {
                    Role::Controller => robot.controllers().position(|(other, _)| other == name),
                    Role::Model => robot.models().position(|other| other == name),
                };
                Recovery::Swap(place.expect("a checked fallback stands by"))
            }
            (None, OnFailure::Stop) => Recovery::Stop,
            (None, OnFailure::End) => Recovery::End,
        };
        let hash = opened.hash().to_owned();
        Ok(Foreign {
            name: format!("{prefix}{}", request.name),
            values: [
                Vec::with_capacity(descriptor.inputs.len()),
                vec![0.0; outputs.len()],
            ],
            constants,
            role: request.role,
            inputs,
            outputs,
            file,
            limits,
            parameters: plugin.parameters.clone(),
            context,
            recovery,
            hash,
            pool: pool.clone(),
            life: RefCell::new(Life::Running(Box::new(opened), member)),
            steps: 0,
            cost: Cost::default(),
            numbers: PhantomData,
        })
    }

    /// Whether it commands the twist, and not the wheels.
    pub(crate) fn is_twisted(&self) -> bool {
        commands_twist(&self.outputs)
    }

    /// Starts it where it waits, and lets it do something.
    fn with<R>(&self, act: impl FnOnce(&mut Plugin, u32) -> Result<R, Fault>) -> Result<R, Fault> {
        let mut life = self.life.borrow_mut();
        if let Life::Waiting = *life {
            let mut plugin = self.pool.take(&self.file, &self.limits)?;
            if plugin.hash() != self.hash {
                return Err(Fault {
                    field: "file".into(),
                    problem: "changed while it was used".into(),
                    hint: String::new(),
                });
            }
            let member = plugin.create(&self.parameters, &self.context)?;
            *life = Life::Running(Box::new(plugin), member);
        }
        match &mut *life {
            Life::Running(plugin, member) => act(plugin, *member),
            Life::Waiting | Life::Failed => Err(Fault {
                field: "step".into(),
                problem: "it has failed before".into(),
                hint: String::new(),
            }),
        }
    }

    /// Gives the process back.
    fn release(&mut self) {
        if let Life::Running(mut plugin, member) = self.life.replace(Life::Waiting) {
            plugin.destroy(member);
            self.pool.give(&self.file, &self.limits, *plugin);
        }
    }

    /// A model that failed stays where it is: nothing has a rate.
    fn stand(&self, outputs: &mut [f64]) {
        let moves = |port: &Port| ["m/s", "rad/s"].contains(&port.unit.as_str());
        for (port, value) in self.outputs.iter().zip(outputs) {
            if moves(port) {
                *value = 0.0;
            }
        }
    }

    fn failed(&mut self, fault: &Fault) -> BlockError {
        self.release();
        *self.life.get_mut() = Life::Failed;
        BlockError {
            block: self.name.clone(),
            problem: fault.to_string(),
            lanes: u32::MAX,
            then: self.recovery.clone(),
        }
    }
}

impl<T> Drop for Foreign<T> {
    fn drop(&mut self) {
        if let Life::Running(mut plugin, member) = self.life.replace(Life::Failed) {
            plugin.destroy(member);
            self.pool.give(&self.file, &self.limits, *plugin);
        }
    }
}

impl Request<'_> {
    /// What a plug-in is told of its place.
    fn context(&self) -> Value {
        let robot = self.robot;
        json!({
            "robot": robot.name,
            "period": self.plugin.period,
            "step": self.scenario.time.step,
            "seed": self.scenario.seed,
            "trial": self.trial,
            "arena": self.scenario.arena,
            "task": robot.task,
            "pose": robot.pose,
            "platform": robot.platform,
            "path": self.way.map(|way| json!({
                "ds": way.ds,
                "points": way.points,
                "heading": way.heading,
                "curvature": way.curvature,
            })),
        })
    }

    /// The place of a beacon: `beacon.NAME.x`, or `task.beacon.x` of the one that the task names.
    fn constant(&self, name: &str) -> Option<f64> {
        let (place, axis) = name.rsplit_once('.')?;
        let beacon = match (place, &self.robot.task) {
            ("task.beacon", Some(Task::Homing { beacon, .. })) => beacon.as_str(),
            _ => place.strip_prefix("beacon.")?,
        };
        let mut beacons = self.scenario.arena.beacon.iter();
        let [x, y] = beacons.find(|known| known.name == beacon)?.position;
        match axis {
            "x" => Some(x),
            "y" => Some(y),
            _ => None,
        }
    }

    /// The signal below the robot that a port stands for.
    fn named(&self, port: &str) -> String {
        match self.plugin.ports.get(port) {
            Some(name) => name.clone(),
            None => port.to_owned(),
        }
    }

    /// Whether a unit is the signal's; of a port that was given a signal none will do.
    fn agrees(&self, port: &str, has: &str, unit: &str) -> bool {
        has == unit || unit.is_empty() && self.plugin.ports.contains_key(port)
    }

    /// Refuses an input in another unit than it has.
    fn in_unit(&self, port: &str, has: &str, unit: &str) -> Result<(), Fault> {
        if self.agrees(port, has, unit) {
            return Ok(());
        }
        Err(Fault {
            field: format!("inputs.{port}"),
            problem: format!("must be in {has}, got {unit:?}"),
            hint: "name the unit that the signal has; values are in SI units".into(),
        })
    }

    /// The signal that a port reads: `name` below the robot.
    fn input(&self, prefix: &str, port: &str, name: &str, unit: &str) -> Result<Port, Fault> {
        let path = format!("{prefix}{name}");
        let refuse = |problem: &str, hint: String| {
            Err(Fault {
                field: format!("inputs.{port}"),
                problem: problem.into(),
                hint,
            })
        };
        if self.role == Role::Model {
            let Some((_, wanted)) = COMMANDS.iter().find(|(known, _)| *known == name) else {
                let names: Vec<&str> = COMMANDS.iter().map(|(name, _)| *name).collect();
                let hint = format!("one of {}, or beacon.NAME.x", names.join(", "));
                return refuse("must be a command, for a model", hint);
            };
            self.in_unit(port, wanted, unit)?;
            return Ok(Port::new(path, *wanted));
        }
        let known = &self.reach.known;
        match known.iter().find(|known| known.path == path) {
            Some(found) => {
                self.in_unit(port, &found.unit, unit)?;
                Ok(found.clone())
            }
            None => {
                let names = known.iter().filter_map(|p| p.path.strip_prefix(prefix));
                let names: Vec<&str> = names.collect();
                let hint = format!("it has: {}; or beacon.NAME.x", names.join(", "));
                refuse("must be a signal of the robot", hint)
            }
        }
    }

    /// The signal that a port writes.
    fn output(&self, prefix: &str, port: &str, name: &str, unit: &str) -> Result<Port, Fault> {
        let (own, rule, names) = match self.role {
            Role::Controller => (
                OWN,
                "must be a command, or a signal of its own",
                self.writable(),
            ),
            Role::Model => (
                OF_MODEL,
                "must be a signal of the robot's motion, or of its own",
                MOTION.to_vec(),
            ),
        };
        let path = format!("{prefix}{name}");
        let port_of = |wanted: &str| Port::new(path.clone(), wanted);
        let found = match (self.role, name) {
            (Role::Model, _) => {
                let mut moved = self.reach.moved.iter();
                moved.find(|port| port.path == path).cloned()
            }
            (_, "command.forward" | "command.left") => Some(port_of("m/s")),
            (_, "command.yaw_rate") => Some(port_of("rad/s")),
            (_, "brake") => Some(port_of("1")),
            _ => {
                let mut commands = self.reach.commands.iter();
                let found = commands.find(|(command, _)| command == name);
                found.map(|(_, port)| port.clone())
            }
        };
        match found {
            Some(found) if self.agrees(port, &found.unit, unit) => Ok(found),
            Some(found) => Err(Fault {
                field: format!("outputs.{port}"),
                problem: format!("must be in {}, got {unit:?}", found.unit),
                hint: "values are in SI units".into(),
            }),
            None if name.strip_prefix(own).is_some_and(|rest| !rest.is_empty()) => {
                Ok(Port::new(path, unit))
            }
            // An FMU has what outputs it has.
            None if self.plugin.file.ends_with(".fmu") && !self.plugin.ports.contains_key(port) => {
                Ok(Port::new(format!("{prefix}{own}{name}"), unit))
            }
            None => Err(Fault {
                field: format!("outputs.{port}"),
                problem: rule.into(),
                hint: format!("one of {}, or {own}NAME", names.join(", ")),
            }),
        }
    }

    fn writable(&self) -> Vec<&str> {
        let twist = [
            "command.forward",
            "command.left",
            "command.yaw_rate",
            "brake",
        ];
        let wheels = self.reach.commands.iter().map(|(name, _)| name.as_str());
        twist.into_iter().chain(wheels).collect()
    }
}

impl<T: Scalar> Block<T> for Foreign<T> {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    fn step(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) -> Result<(), BlockError> {
        if let Life::Failed = self.life.get_mut() {
            output.fill(T::zero());
            return Ok(());
        }
        let [mut inputs, mut outputs] = std::mem::take(&mut self.values);
        inputs.clear();
        inputs.extend(input.iter().map(|number| number.lane(0)));
        for &(k, value) in &self.constants {
            inputs.insert(k, value);
        }
        // The world moves a model tick by tick.
        let (t, dt) = (now.t.lane(0), now.dt);
        let is_measured = self.steps % MEASURED == MEASURED - 1;
        self.steps += 1;
        let begun = is_measured.then(Instant::now);
        let stepped = self.with(|plugin, member| plugin.step(member, t, dt, &inputs, &mut outputs));
        if let Some(begun) = begun {
            let taken = begun.elapsed().as_secs_f64();
            self.cost.steps += 1;
            self.cost.total += taken;
            self.cost.longest = self.cost.longest.max(taken);
        }
        let result = match stepped {
            Ok(()) => {
                for (number, &value) in output.iter_mut().zip(&outputs) {
                    *number = T::from(value);
                }
                Ok(())
            }
            Err(fault) => {
                if self.recovery == Recovery::Stop {
                    output.fill(T::zero());
                    self.stand(&mut outputs);
                }
                Err(self.failed(&fault))
            }
        };
        self.values = [inputs, outputs];
        result
    }

    fn take_over(&mut self, _input: &[T], before: &[T]) -> Result<(), BlockError> {
        let before: Vec<f64> = before.iter().map(|number| number.lane(0)).collect();
        self.values[1].copy_from_slice(&before);
        self.with(|plugin, member| plugin.take_over(member, &before))
            .map_err(|fault| self.failed(&fault))
    }

    fn observe(&mut self, _input: &[T], _detail: Detail, output: &mut [T]) {
        for (number, &value) in output.iter_mut().zip(&self.values[1]) {
            *number = T::from(value);
        }
    }

    fn origin(&self) -> Option<&str> {
        Some(&self.hash)
    }

    fn cost(&self) -> Option<Cost> {
        Some(self.cost)
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        let has_failed = matches!(*self.life.borrow(), Life::Failed);
        let (state, memory) = match has_failed {
            true => (FAILED, Vec::new()),
            false => match self.with(|plugin, member| plugin.save(member)) {
                Ok(memory) => (RUNNING, memory),
                Err(_) => (UNKNOWN, Vec::new()),
            },
        };
        if self.role == Role::Model {
            save_numbers(&self.values[1], bytes);
        }
        bytes.push(state);
        bytes.extend_from_slice(&(memory.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&memory);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        let whole = bytes.len();
        let mut bytes = bytes;
        if self.role == Role::Model {
            let used = restore_numbers(&mut self.values[1], bytes)?;
            bytes = &bytes[used..];
        }
        let (&state, rest) = bytes.split_first()?;
        let length = u64::from_le_bytes(*rest.first_chunk()?) as usize;
        let memory = rest.get(8..8usize.checked_add(length)?)?;
        self.release();
        match state {
            FAILED => *self.life.get_mut() = Life::Failed,
            RUNNING => self
                .with(|plugin, member| plugin.restore(member, memory))
                .ok()?,
            // What could not be saved cannot go on.
            _ => return None,
        }
        Some(whole - bytes.len() + 9 + length)
    }

    fn any(&self) -> &dyn Any {
        self
    }

    fn fits(&self, _one: &dyn Any) -> bool {
        // It is one process, with a memory of its own.
        false
    }

    fn take(&mut self, _lane: usize, _one: &dyn Any) {}
}
