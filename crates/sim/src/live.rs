//! Changes of controllers and models that nobody planned: on command, or because a file changed while the run went on.
//!
//! A new version of a plug-in is opened apart from the run ([`Workshop::open`]), on another thread if need
//! be, and joins it between two steps ([`Run::install`]). What was changed is written down as a scenario that
//! does the same at the same times ([`Run::repetition`]): a run of that one has the same signals, bit for bit.

use std::path::{Path as FilePath, PathBuf};
use std::sync::Arc;

use appell_plugin::Fault;

use crate::foreign::{Foreign, Pool, Reach, Request, Role};
use crate::plan::Path;
use crate::run::Run;
use crate::scenario::{Controller, Model, Plugin, Robot, STANDBY_MAX, Scenario, Standby, Swap};
use crate::world::{Change, To};

/// What new versions of a run's plug-ins are opened with.
pub struct Workshop {
    scenario: Scenario,
    is_trusted: bool,
    trial: u64,
    reaches: Vec<Reach>,
    paths: Vec<Option<Path>>,
    pool: Arc<Pool>,
}

/// A plug-in of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Name of the robot.
    pub robot: String,
    /// Name among the robot's controllers, or its models.
    pub name: String,
    /// File, as the scenario names it.
    pub file: String,
}

/// A new version of a plug-in, ready to join.
pub struct Successor {
    robot: usize,
    role: Role,
    /// Whose place it takes, and its own name.
    of: String,
    name: String,
    block: Foreign<f64>,
    plugin: Plugin,
}

/// Why a change could not be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Unchanged(String);

impl Workshop {
    pub(crate) fn new(
        run: &Run,
        reaches: Vec<Reach>,
        is_trusted: bool,
        trial: u64,
        pool: &Arc<Pool>,
    ) -> Self {
        Workshop {
            scenario: run.scenario().clone(),
            is_trusted,
            trial,
            reaches,
            paths: run.paths.clone(),
            pool: pool.clone(),
        }
    }

    /// The plug-ins that the scenario names.
    pub fn sources(&self) -> Vec<Source> {
        let of_robot = |robot: &Robot| {
            let source = |(name, plugin): (&str, &Plugin)| Source {
                robot: robot.name.clone(),
                name: name.to_owned(),
                file: plugin.file.clone(),
            };
            robot.plugins().map(source).collect::<Vec<_>>()
        };
        self.scenario.robot.iter().flat_map(of_robot).collect()
    }

    /// Whether a robot of the scenario has a controller or model of this name, or any plug-in this file.
    pub fn is_taken(&self, robot: &str, name: &str, file: &str) -> bool {
        let mut own = self
            .scenario
            .robot
            .iter()
            .filter(|known| known.name == robot);
        let named = own.any(|robot| {
            let mut controllers = robot.controllers().map(|(known, _)| known);
            controllers.any(|known| known == name) || robot.models().any(|known| known == name)
        });
        let mut plugins = self.scenario.robot.iter().flat_map(Robot::plugins);
        named || plugins.any(|(_, plugin)| plugin.file == file)
    }

    /// Opens another version of a plug-in: `file`, relative to `folder`, under a `name` of its own among the
    /// robot's controllers.
    ///
    /// # Errors
    /// It cannot be opened, or does not fit the robot.
    pub fn open(
        &self,
        source: &Source,
        name: &str,
        file: &str,
        folder: &FilePath,
    ) -> Result<Successor, Fault> {
        let named = |robot: &Robot| robot.name == source.robot;
        let index = self.scenario.robot.iter().position(named);
        let index = index.expect("a source names a robot of the scenario");
        let robot = &self.scenario.robot[index];
        let of_name = |(known, _): &(&str, &Plugin)| *known == source.name;
        let (_, plugin) = robot
            .plugins()
            .find(of_name)
            .expect("a source names a plug-in of its robot");
        let role = match robot.models().any(|model| model == source.name) {
            true => Role::Model,
            false => Role::Controller,
        };
        let plugin = Plugin {
            file: file.to_owned(),
            ..plugin.clone()
        };
        let request = Request {
            scenario: &self.scenario,
            robot,
            name,
            plugin: &plugin,
            folder,
            is_trusted: self.is_trusted,
            trial: self.scenario.trial + self.trial,
            way: self.paths[index].as_ref(),
            reach: &self.reaches[index],
            role,
        };
        let block = Foreign::new(&request, &self.pool)?;
        Ok(Successor {
            robot: index,
            role,
            of: source.name.clone(),
            name: name.to_owned(),
            block,
            plugin,
        })
    }
}

/// A version that joined: its robot, what it is, its name, and its file with all that belongs to it.
struct Joined {
    robot: usize,
    role: Role,
    name: String,
    plugin: Plugin,
}

/// What was changed by hand, as a scenario would say it.
#[derive(Default)]
pub(crate) struct Script {
    /// Versions, in the order in which they joined.
    joined: Vec<Joined>,
    /// All changes, planned ones, too.
    swaps: Vec<Swap>,
    is_changed: bool,
}

impl Script {
    /// Whether a plug-in was replaced by another version.
    pub(crate) fn has_joined(&self) -> bool {
        !self.joined.is_empty()
    }

    /// All changes of controllers and models, planned ones, too.
    pub(crate) fn swaps(&self) -> &[Swap] {
        &self.swaps
    }

    /// Something was changed by hand.
    pub(crate) fn touch(&mut self) {
        self.is_changed = true;
    }

    pub(crate) fn of(scenario: &Scenario) -> Self {
        Script {
            swaps: scenario.swap.clone(),
            ..Script::default()
        }
    }
}

impl Run {
    /// Lets another of a robot's controllers, or of its models, take over at the next step.
    ///
    /// # Errors
    /// There is no such robot, controller or model.
    pub fn swap(&mut self, robot: &str, to: &str) -> Result<(), Unchanged> {
        let mut robots = self.scenario().robot.iter();
        let index = robots.position(|known| known.name == robot);
        let Some(index) = index else {
            let names: Vec<&str> = self
                .scenario()
                .robot
                .iter()
                .map(|r| r.name.as_str())
                .collect();
            return Err(Unchanged(format!(
                "must be the name of a robot, got {robot:?}; one of {}",
                names.join(", ")
            )));
        };
        let names = self.world.crew(index);
        let models = self.world.models(index);
        // One that is alone takes no turns.
        let models = if models.len() > 1 { models } else { &[] };
        let place = |names: &[String]| names.iter().position(|known| known == to);
        let change = match (place(names), place(models)) {
            (Some(controller), _) => To::Controller(controller),
            (None, Some(model)) => To::Model(model),
            (None, None) => {
                let known: Vec<&str> = names.iter().chain(models).map(String::as_str).collect();
                return Err(Unchanged(format!(
                    "must be the name of a controller or model of robot {robot:?}, got {to:?}; one of {}",
                    known.join(", ")
                )));
            }
        };
        self.schedule(index, change, to.to_owned());
        Ok(())
    }

    fn schedule(&mut self, robot: usize, to: To, name: String) {
        let (tick, time) = (self.world.tick(), self.scenario().time.clone());
        self.world.schedule(Change { tick, robot, to });
        let swap = Swap {
            at: (tick as f64 * time.step).min(time.duration),
            robot: self.scenario().robot[robot].name.clone(),
            to: name,
        };
        self.script.swaps.push(swap);
        self.script.is_changed = true;
    }

    /// Lets a new version of a plug-in join, which takes over at the next step if the old one drives, and
    /// later where the old one would have.
    ///
    /// # Errors
    /// It reads or writes what the table of this run has no column for, or commands something else.
    pub fn install(&mut self, successor: Successor) -> Result<(), Unchanged> {
        let Successor {
            robot,
            role,
            of,
            name,
            block,
            plugin,
        } = successor;
        let known = match role {
            Role::Controller => self.world.crew(robot),
            Role::Model => self.world.models(robot),
        };
        if known.len() > STANDBY_MAX {
            return Err(Unchanged(format!(
                "{STANDBY_MAX} stand by already; start the run anew"
            )));
        }
        // Of versions the newest.
        let versions = self.script.joined.iter().filter(|one| one.robot == robot);
        let versions: Vec<&str> = versions.map(|one| one.name.as_str()).collect();
        let is_version =
            |known: &str| known == of || versions.contains(&known) && of_line(known, &of);
        let like = known.iter().rposition(|known| is_version(known));
        let like = like.expect("a successor has a predecessor");
        let old_name = known[like].clone();
        let block = Box::new(block);
        let (old, new) = match role {
            Role::Controller => {
                let joined = self.world.join(robot, like, name.clone(), block);
                (To::Controller(like), joined.map(To::Controller))
            }
            Role::Model => {
                let joined = self.world.join_model(robot, name.clone(), block);
                (To::Model(like), joined.map(To::Model))
            }
        };
        let new = new.map_err(Unchanged)?;
        let (tick, step) = (self.world.tick(), self.scenario().time.step);
        let robot_name = self.scenario().robot[robot].name.clone();
        for swap in &mut self.script.swaps {
            let is_ahead = (swap.at / step).round() as u64 >= tick;
            if is_ahead && swap.robot == robot_name && swap.to == old_name {
                swap.to.clone_from(&name);
            }
        }
        self.world.redirect(robot, old, new);
        self.script.joined.push(Joined {
            robot,
            role,
            name: name.clone(),
            plugin,
        });
        self.script.is_changed = true;
        if self.world.is_active(robot, old) {
            self.schedule(robot, new, name);
        }
        Ok(())
    }

    /// Writes down that a new version of a plug-in was refused: the old one goes on.
    pub fn refuse(&mut self, source: &Source, name: &str, problem: &str) {
        let named = |robot: &Robot| robot.name == source.robot;
        if let Some(robot) = self.scenario().robot.iter().position(named) {
            self.world.refuse(robot, &source.name, name, problem);
        }
    }

    /// The scenario that does by itself what was done by hand, if anything was; files of versions are as
    /// they were given to [`Workshop::open`].
    pub fn repetition(&self) -> Option<Scenario> {
        if !self.script.is_changed {
            return None;
        }
        let mut scenario = self.scenario().clone();
        for Joined {
            robot,
            role,
            name,
            plugin,
        } in &self.script.joined
        {
            let (robot, name) = (&mut scenario.robot[*robot], name.clone());
            match role {
                Role::Controller => robot.standby.push(Standby {
                    name,
                    controller: Controller::Plugin(plugin.clone()),
                }),
                Role::Model => robot.model.push(Model {
                    name,
                    level: None,
                    drive: None,
                    plugin: Some(plugin.clone()),
                }),
            }
        }
        scenario.swap = self.script.swaps.clone();
        scenario.change = self.changes().to_vec();
        Some(scenario)
    }
}

/// The name of the k-th version of a controller, counted from 1.
pub fn version(of: &str, k: usize) -> String {
    format!("{of}-v{k}")
}

/// Whether a name is that of a version.
fn of_line(name: &str, of: &str) -> bool {
    let number = name
        .strip_prefix(of)
        .and_then(|rest| rest.strip_prefix("-v"));
    number.is_some_and(|number| number.parse::<usize>().is_ok())
}

/// A file's name with its version in it: `follow.py`, the second, is `follow-v2.py`.
pub fn version_file(file: &FilePath, k: usize) -> PathBuf {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let name = match file.extension() {
        Some(extension) => format!("{}.{}", version(&stem, k), extension.to_string_lossy()),
        None => version(&stem, k),
    };
    file.with_file_name(name)
}
