//! What decides for a robot: its controllers, those that stand by, the servo and the noise on commands.

use std::collections::BTreeMap;
use std::sync::Arc;

use appell_model::ground::Ground;
use appell_model::platform::Platform;
use appell_model::scalar::Scalar;
use appell_model::terrain::Terrain;
use appell_model::wheel::Wheel;
use appell_plugin::Fault;

use crate::block::{Block, Port};
use crate::build::{self, Values};
use crate::controller::{
    NoiseSource, Signals, Track, Waveform, Waveforms, WheelNoise, path_follower, read_table,
};
use crate::foreign::{Foreign, Pool, Reach, Request, Role};
use crate::noise::{Stream, Streams};
use crate::plan::Path;
use crate::plant::{Numerics, Plant, Start, command_signal};
use crate::run::{refuse, refuse_plant};
use crate::scenario::{
    Channel, Controller, Diagnostics, FIRST, Loaded, Model, Platform as PlatformFile, Plugin,
    Robot, Scenario, Signal,
};
use crate::servo::servo;
use crate::world::{Change, Controlled, To};

/// A robot whose controllers are built.
pub(crate) struct Deciding<'a, 'b, T: Scalar> {
    pub loaded: &'a Loaded,
    pub robot: &'a Robot,
    pub platform: &'a Platform<T>,
    pub file: &'a PlatformFile,
    /// The way of its task, where there is one.
    pub way: Option<(&'a Path, &'a Arc<Track>)>,
    /// Heading at the start, rad.
    pub heading: T,
    /// Seed and trial.
    pub key: (u64, u64),
    pub values: &'a Values<'b, T>,
    pub pool: &'a Arc<Pool>,
    /// Heights of uneven ground.
    pub relief: Option<&'a Arc<Terrain>>,
    /// What a plug-in may read and write.
    pub reach: Reach,
    /// Signals that are commanded from outside, to be added to.
    pub outsides: &'a mut Vec<Port>,
}

/// A model that stands by: its plant and, of another level of the robot, that one with its platform.
pub(crate) struct Standing<T: Scalar> {
    pub plant: Box<dyn Block<T>>,
    pub own: Option<(Robot, Platform<T>)>,
}

/// A block, and whether it commands the twist.
type Decider<T> = (Box<dyn Block<T>>, bool);

impl<T: Scalar> Deciding<'_, '_, T> {
    /// The blocks that decide, in their order, and the names of the controllers that take turns.
    ///
    /// # Errors
    /// A table cannot be read, or a plug-in cannot be used.
    pub(crate) fn blocks(
        &mut self,
        models: &[Standing<T>],
    ) -> Result<(Vec<Controlled<T>>, Vec<String>), Diagnostics> {
        let robot = self.robot;
        let step = self.loaded.scenario.time.step;
        let mut blocks: Vec<Controlled<T>> = Vec::new();
        let mut crew = Vec::new();
        // Those that command the twist, a bit each, and the shortest periods of them and of all.
        let (mut twisted, mut of_twisted, mut of_all) = (0_u64, f64::INFINITY, f64::INFINITY);
        for (k, (name, controller)) in robot.controllers().enumerate() {
            let (block, is_twisted) = self.controller(name, controller)?;
            let period = controller.period();
            of_all = of_all.min(period);
            if is_twisted {
                twisted |= 1 << k;
                of_twisted = of_twisted.min(period);
            }
            crew.push(name.to_owned());
            blocks.push(Controlled {
                block,
                period: ticks(period, step),
                with: 1 << k,
                models: u64::MAX,
            });
        }
        if !models.is_empty() && twisted.count_ones() as usize != crew.len() {
            return Err(refuse(
                self.loaded,
                format!("robot.{}.model", robot.name),
                "must stand by for controllers that command the twist, got one that commands wheels"
                    .into(),
                "command.forward and command.yaw_rate mean the same to every model".into(),
            ));
        }
        let everyone = match crew.len() {
            0 => return Ok((Vec::new(), crew)),
            1 => u64::MAX,
            count => (1 << count) - 1,
        };
        if let [only] = &mut blocks[..] {
            only.with = everyone;
        }
        let mut last = of_all;
        if twisted != 0 {
            last = robot.servo.period.unwrap_or(of_twisted);
            let standing = models.iter().map(|model| model.own.as_ref());
            let standing = standing.map(|own| own.map(|(robot, platform)| (robot, platform)));
            let all = std::iter::once(Some((robot, self.platform))).chain(standing);
            for (k, own) in all.enumerate() {
                let Some((robot, platform)) = own else {
                    continue;
                };
                let command = |wheel: &Wheel<T>| command_port(robot, wheel);
                blocks.push(Controlled {
                    block: Box::new(servo(robot, platform, last, &command, self.values)),
                    period: ticks(last, step),
                    with: if crew.len() == 1 { everyone } else { twisted },
                    models: if models.is_empty() { u64::MAX } else { 1 << k },
                });
            }
        }
        if twisted.count_ones() as usize != crew.len() {
            last = last.min(of_all);
        }
        if !robot.wheel_noise.is_empty() {
            blocks.push(Controlled {
                block: wheel_noise(self.loaded, robot, self.platform, self.key, self.values)?,
                period: ticks(last, step),
                with: everyone,
                models: u64::MAX,
            });
        }
        let mut units: BTreeMap<&str, &str> = BTreeMap::new();
        for port in blocks.iter().flat_map(|one| one.block.outputs()) {
            let unit = units.entry(&port.path).or_insert(&port.unit);
            if *unit != port.unit {
                return Err(refuse(
                    self.loaded,
                    format!("robot.{}.standby", robot.name),
                    format!(
                        "must agree on the units of signals that several write, got {} in {unit} and in {}",
                        port.path, port.unit
                    ),
                    "name one of the signals otherwise".into(),
                ));
            }
        }
        Ok((blocks, crew))
    }

    /// The models that stand by.
    ///
    /// # Errors
    /// One cannot be built, or gives less than what is read of the first.
    pub(crate) fn models(
        &self,
        ground: Ground<T>,
        numerics: Numerics,
        start: Start<'_, T>,
    ) -> Result<Vec<Standing<T>>, Diagnostics> {
        let robot = self.robot;
        let model = |model: &Model| {
            let base = format!("robot.{}.model.{}", robot.name, model.name);
            if let Some(plugin) = &model.plugin {
                let request = Request {
                    role: Role::Model,
                    ..self.request(&model.name, plugin)
                };
                let foreign = Foreign::<T>::new(&request, self.pool)
                    .map_err(|fault| self.refuse(&format!("{base}.plugin"), plugin, fault))?;
                return Ok(Standing {
                    plant: Box::new(foreign),
                    own: None,
                });
            }
            let own = Robot {
                level: model.level.unwrap_or(robot.level),
                drive: model.drive.unwrap_or(robot.drive),
                ..robot.clone()
            };
            let path = format!("robot.{}.platform", robot.name);
            let drives = build::drive_model(&own);
            let weighs = ground.gravity_normal;
            let platform = build::platform_of(self.file, drives, weighs, &path, self.values)
                .expect("a checked platform can be built");
            let terrain = &self.loaded.scenario.terrain;
            let relief = self.relief.cloned();
            let contacts = build::contacts(self.file, terrain, relief, &path, self.values);
            let (name, level) = (&robot.name, own.level);
            let plant = Plant::new(
                name,
                platform.clone(),
                contacts,
                ground,
                level,
                numerics,
                start,
            )
            .map_err(|error| refuse_plant(self.loaded, &base, error))?;
            Ok(Standing {
                plant: Box::new(plant),
                own: Some((own, platform)),
            })
        };
        robot.model.iter().map(model).collect()
    }

    fn request<'c>(&'c self, name: &'c str, plugin: &'c Plugin) -> Request<'c> {
        Request {
            scenario: &self.loaded.scenario,
            robot: self.robot,
            name,
            plugin,
            folder: &self.loaded.folder,
            is_trusted: self.loaded.trust_native,
            trial: self.key.1,
            way: self.way.map(|(path, _)| path),
            reach: &self.reach,
            role: Role::Controller,
        }
    }

    fn refuse(&self, base: &str, plugin: &Plugin, fault: Fault) -> Diagnostics {
        let path = match fault.field.starts_with("parameters.") {
            true => format!("{base}.{}", fault.field),
            false => format!("{base}.file"),
        };
        let problem = format!("\"{}\": {fault}", plugin.file);
        refuse(self.loaded, path, problem, fault.hint)
    }

    fn controller(&mut self, name: &str, own: &Controller) -> Result<Decider<T>, Diagnostics> {
        let robot = self.robot;
        let base = match name {
            FIRST => format!("robot.{}.controller", robot.name),
            _ => format!("robot.{}.standby.{name}.controller", robot.name),
        };
        match own {
            Controller::Homing(tuning)
            | Controller::Gate(tuning)
            | Controller::Eight(tuning)
            | Controller::Slalom(tuning)
            | Controller::Route(tuning) => {
                let (_, track) = self.way.expect("a checked follower has a task");
                let turns = crate::design::sharpest_curve(self.file).is_infinite();
                let name = &robot.name;
                let (heading, values) = (self.heading, self.values);
                let follower = path_follower(name, &base, track, tuning, heading, turns, values);
                Ok((Box::new(follower), true))
            }
            Controller::Signals { channel, .. } => self.signals(&base, channel),
            Controller::Plugin(plugin) => {
                let request = self.request(name, plugin);
                let foreign = Foreign::<T>::new(&request, self.pool)
                    .map_err(|fault| self.refuse(&base, plugin, fault))?;
                let is_twisted = foreign.is_twisted();
                Ok((Box::new(foreign), is_twisted))
            }
        }
    }

    fn signals(&mut self, base: &str, channels: &[Channel]) -> Result<Decider<T>, Diagnostics> {
        let mut is_twisted = false;
        let mut wired = Vec::new();
        for channel in channels {
            is_twisted |= ["forward", "left", "yaw_rate"].contains(&channel.to.as_str());
            let port = channel_port(&channel.to, self.robot, self.platform);
            let waveform = match &channel.signal {
                Signal::External {} => {
                    self.outsides.push(port);
                    continue;
                }
                Signal::Table { file, column } => {
                    let path = format!("{base}.channel.{}", channel.to);
                    table(self.loaded, path, file, column)?
                }
                formula => Waveform::Formula(formula.clone()),
            };
            wired.push((port, Waveforms::new(waveform, T::LANES)));
        }
        Ok((Box::new(Signals::wired(wired)), is_twisted))
    }
}

/// A period in ticks.
fn ticks(period: f64, step: f64) -> u64 {
    (period / step).round().max(1.0) as u64
}

/// The changes of controllers and models that a scenario asks for, in the order of time.
pub(crate) fn changes(scenario: &Scenario) -> Vec<Change> {
    let mut changes: Vec<Change> = scenario
        .swap
        .iter()
        .filter_map(|swap| {
            let named = |robot: &Robot| robot.name == swap.robot;
            let robot = scenario.robot.iter().position(named)?;
            let of = &scenario.robot[robot];
            let mut crew = of.controllers();
            let to = match crew.position(|(name, _)| name == swap.to) {
                Some(controller) => To::Controller(controller),
                None => To::Model(of.models().position(|name| name == swap.to)?),
            };
            let tick = (swap.at / scenario.time.step).round() as u64;
            Some(Change { tick, robot, to })
        })
        .collect();
    changes.sort_by_key(|change| change.tick);
    changes
}

/// What the plug-ins of a robot, if it has any, may read and write.
pub(crate) fn reach<T: Scalar>(
    robot: &Robot,
    platform: &Platform<T>,
    plant: &Plant<T>,
    sensors: &[(Box<dyn Block<T>>, u64)],
) -> Reach {
    if robot.plugins().next().is_none() {
        return Reach::default();
    }
    let sensed = sensors.iter().flat_map(|(sensor, _)| sensor.outputs());
    // The servo steers; wheels that steer are not commanded one by one.
    let steers = !platform.layout().steered.is_empty();
    let wheels = platform.wheels().iter().filter(|_| !steers);
    let command = |wheel: &Wheel<T>| {
        let (field, _) = command_signal(&wheel.drive)?;
        let name = format!("wheel.{}.{field}", wheel.name);
        Some((name, command_port(robot, wheel)))
    };
    Reach {
        known: plant.motion_ports().iter().chain(sensed).cloned().collect(),
        moved: plant.outputs().to_vec(),
        commands: wheels.filter_map(command).collect(),
    }
}

fn channel_port<T: Scalar>(
    to: &str,
    robot: &Robot,
    platform: &Platform<T>,
) -> crate::signal::Signal {
    let named = |path: String, unit: &str| {
        crate::signal::Signal::new(format!("robot.{}.{path}", robot.name), unit)
    };
    match to {
        "forward" | "left" => named(format!("command.{to}"), "m/s"),
        "yaw_rate" => named("command.yaw_rate".into(), "rad/s"),
        "brake" => named("brake".into(), "1"),
        wheel => {
            let name = wheel.trim_start_matches("wheel.");
            let found = platform.wheels().iter().find(|w| w.name == name);
            command_port(
                robot,
                found.expect("a checked channel names a driven wheel"),
            )
        }
    }
}

/// A column of a CSV file that a checked scenario names, at a path in it.
fn table(loaded: &Loaded, path: String, file: &str, column: &str) -> Result<Waveform, Diagnostics> {
    let table = read_table(&loaded.folder.join(file), column);
    let (times, values) = table.map_err(|problem| {
        let hint = "the file changed while it was read".into();
        refuse(loaded, path, problem, hint)
    })?;
    Ok(Waveform::Table { times, values })
}

/// The port to which a wheel's command is written: its drive's, or where noise is added on the way
/// what is wanted of it.
fn command_port<T>(robot: &Robot, wheel: &Wheel<T>) -> crate::signal::Signal {
    let (field, unit) = command_signal(&wheel.drive).expect("a driven wheel takes a command");
    let noisy = robot.wheel_noise.iter().any(|n| n.wheel == wheel.name);
    let field = if noisy { "wanted" } else { field };
    let path = format!("robot.{}.wheel.{}.{field}", robot.name, wheel.name);
    crate::signal::Signal::new(path, unit)
}

/// The block that adds noise to a robot's commands.
fn wheel_noise<T: Scalar>(
    loaded: &Loaded,
    robot: &Robot,
    platform: &Platform<T>,
    key: (u64, u64),
    values: &Values<'_, T>,
) -> Result<Box<dyn Block<T>>, Diagnostics> {
    let mut wheels = Vec::new();
    for noise in &robot.wheel_noise {
        let wheel = platform.wheels().iter().find(|w| w.name == noise.wheel);
        let wheel = wheel.expect("checked noise is of a driven wheel");
        let (field, unit) = command_signal(&wheel.drive).expect("a driven wheel takes a command");
        let path = |field: &str| format!("robot.{}.wheel.{}.{field}", robot.name, noise.wheel);
        let port = |field: &str| crate::signal::Signal::new(path(field), unit);
        let source = match (&noise.file, &noise.column) {
            (Some(file), Some(column)) => {
                let path = format!("robot.{}.wheel_noise.{}.file", robot.name, noise.wheel);
                NoiseSource::Given(Waveforms::new(table(loaded, path, file, column)?, T::LANES))
            }
            _ => {
                let name = path("noise");
                let stream = noise.stream.as_ref().unwrap_or(&name);
                let base = format!("robot.{}.wheel_noise.{}", robot.name, noise.wheel);
                NoiseSource::Normal {
                    streams: Streams::new(Stream::new(key.0, key.1, stream)),
                    mean: values.at(format_args!("{base}.mean"), noise.mean),
                    std: values.at(format_args!("{base}.std"), noise.std),
                }
            }
        };
        wheels.push(([port("wanted"), port(field), port("noise")], source));
    }
    Ok(Box::new(WheelNoise::wired(wheels)))
}
