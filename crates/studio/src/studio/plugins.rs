//! Plug-ins while a line goes on: files that are found, loaded to stand by, taken anew, and left out.
//!
//! A plug-in that is taken anew is copied under a name of its own first, so that the line's scenario names what
//! it was driven with, and repeats it.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

use appell_sim::live::{version, version_file};
use appell_sim::scenario::{Controller, Plugin, Standby};
use serde_json::{Value, json};

use super::command::Refusal;
use super::line::Kind;
use super::{Studio, is_plain};

/// Most files that are listed, and the largest, bytes.
const FILES_MAX: usize = 64;
const SIZE_MAX: u64 = 64 << 20;

/// Hashes of files, as long as they are not written anew.
pub(super) type Hashes = RefCell<BTreeMap<String, (SystemTime, u64, String)>>;

/// What runs files of this extension.
fn host(file: &str) -> Option<&'static str> {
    match file.rsplit_once('.')?.1 {
        "wasm" => Some("wasm"),
        "py" => Some("python"),
        "so" | "dylib" | "dll" => Some("native"),
        "fmu" => Some("fmu"),
        _ => None,
    }
}

/// Whether a plug-in is a program of this machine: neither a module, which is sealed off, nor Python.
pub(super) fn is_native(file: &str) -> bool {
    !matches!(host(file), Some("wasm" | "python"))
}

impl Studio {
    /// SHA-256 of a file; none where it cannot be read, or is too large.
    fn hash(&self, file: &str) -> Option<String> {
        let path = self.folder().join(file);
        let about = std::fs::metadata(&path).ok()?;
        let (written, size) = (about.modified().ok()?, about.len());
        if !about.is_file() || size > SIZE_MAX {
            return None;
        }
        let mut hashes = self.hashes.borrow_mut();
        if let Some((then, length, hash)) = hashes.get(file)
            && (*then, *length) == (written, size)
        {
            return Some(hash.clone());
        }
        let hash = appell_plugin::digest(&std::fs::read(&path).ok()?);
        hashes.insert(file.to_owned(), (written, size, hash.clone()));
        Some(hash)
    }

    /// Whether there is something to tell of what steps take.
    pub(crate) fn has_costs(&self) -> bool {
        let mut robots = self.active().loaded.scenario.robot.iter();
        robots.any(|robot| robot.plugins().next().is_some())
    }

    /// Plug-ins of the active line, and files beside the scenario that could be some.
    pub(super) fn plugins(&self) -> Value {
        let scenario = &self.active().loaded.scenario;
        let mut named = Vec::new();
        let session = self.active().session.as_ref();
        for (index, robot) in scenario.robot.iter().enumerate() {
            for (place, (name, controller)) in robot.controllers().enumerate() {
                let Controller::Plugin(plugin) = controller else {
                    continue;
                };
                let cost = session.and_then(|session| session.run.cost(index, place));
                let cost = cost.filter(|cost| cost.steps > 0).map(|cost| {
                    let mean = cost.total / cost.steps as f64;
                    json!({"mean": mean, "longest": cost.longest, "steps": cost.steps})
                });
                named.push(json!({
                    "cost": cost,
                    "robot": robot.name,
                    "name": name,
                    "file": plugin.file,
                    "host": host(&plugin.file).unwrap_or("program"),
                    "hash": self.hash(&plugin.file),
                    "period": plugin.period,
                    "standby": robot.standby.iter().any(|one| one.name == name),
                }));
            }
        }
        json!({"named": named, "files": self.plugin_files()})
    }

    /// Files beside the scenario that could be plug-ins.
    pub(super) fn plugin_files(&self) -> Vec<Value> {
        let mut files = super::files(self.folder(), |name| {
            let stem = name.rsplit_once('.')?.0;
            (host(name).is_some() && is_plain(stem)).then(|| name.to_owned())
        });
        files.truncate(FILES_MAX);
        files
            .iter()
            .map(|file| json!({"file": file, "host": host(file), "hash": self.hash(file)}))
            .collect()
    }

    /// Lets a file beside the scenario stand by as a controller.
    pub(super) fn load(&mut self, robot: &str, file: &str) -> Result<(), Refusal> {
        let found = self.plugins();
        let mut files = found["files"].as_array().into_iter().flatten();
        if !files.any(|one| one["file"] == file) {
            return Err(Refusal::new(
                format!("must be one of the plug-ins beside the scenario, got {file:?}"),
                "",
            ));
        }
        let name = Path::new(file).file_stem().unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        let plugin: Plugin =
            serde_json::from_value(json!({"file": file})).expect("all else has defaults");
        self.stand_by(robot, &name, Controller::Plugin(plugin))
    }

    /// Takes a plug-in anew from its file, as a version of its own, and lets it take over if the old one drives.
    pub(super) fn take_anew(
        &mut self,
        robot: &str,
        name: &str,
        at: Option<f64>,
    ) -> Result<(), Refusal> {
        let document = self.active().document()?;
        let own = document.scenario.robot.iter().find(|one| one.name == robot);
        let plugin = own.and_then(|own| {
            own.controllers()
                .find_map(|(known, controller)| match controller {
                    Controller::Plugin(plugin) if known == name => Some(plugin.clone()),
                    _ => None,
                })
        });
        let (Some(own), Some(plugin)) = (own, plugin) else {
            return Err(Refusal::new(
                format!("robot {robot:?} must have a plug-in {name:?}"),
                "",
            ));
        };
        let source = self.folder().join(&plugin.file);
        let is_free = |k: &usize| {
            let taken = version(name, *k);
            own.controllers().all(|(known, _)| known != taken)
                && !self
                    .folder()
                    .join(version_file(Path::new(&plugin.file), *k))
                    .exists()
        };
        let k = (1..).find(is_free).expect("numbers do not end");
        let kept = version_file(Path::new(&plugin.file), k);
        let copy = self.folder().join(&kept);
        std::fs::copy(&source, &copy).map_err(|error| {
            Refusal::new(
                format!("{}: cannot be copied: {error}", source.display()),
                "",
            )
        })?;
        let next = version(name, k);
        let drives = self.drives(robot) == Some(name.to_owned());
        let plugin = Plugin {
            file: kept.to_string_lossy().into_owned(),
            ..plugin
        };
        let done = self
            .stand_by(robot, &next, Controller::Plugin(plugin))
            .and_then(|()| match drives {
                true => self.swap(robot, &next, at),
                false => Ok(()),
            });
        if done.is_err() {
            // What could not be opened is named by nothing.
            let _ = std::fs::remove_file(&copy);
        }
        done
    }

    /// Leaves out a controller that stands by.
    pub(super) fn unload(&mut self, robot: &str, name: &str) -> Result<(), Refusal> {
        if self.drives(robot).as_deref() == Some(name) {
            return Err(Refusal::new(
                format!("{name} drives robot {robot}"),
                "let another controller take over first",
            ));
        }
        let mut scenario = self.active().document()?.scenario;
        let own = scenario.robot.iter_mut().find(|own| own.name == robot);
        let before = own.as_ref().map_or(0, |own| own.standby.len());
        let after = own.map_or(0, |own| {
            own.standby.retain(|one| one.name != name);
            own.standby.len()
        });
        if before == after {
            return Err(Refusal::new(
                format!("robot {robot:?} must have a controller {name:?} that stands by"),
                "",
            ));
        }
        self.rebuild(&scenario)
    }

    /// Who drives a robot of the active line.
    fn drives(&self, robot: &str) -> Option<String> {
        let line = self.active();
        let robots = &line.loaded.scenario.robot;
        let index = robots.iter().position(|own| own.name == robot)?;
        let (names, active) = line.session.as_ref()?.run.controllers(index);
        names.get(active).cloned()
    }

    /// Adds a controller that stands by.
    pub(super) fn stand_by(
        &mut self,
        robot: &str,
        name: &str,
        controller: Controller,
    ) -> Result<(), Refusal> {
        let mut scenario = self.active().document()?.scenario;
        let Some(own) = scenario.robot.iter_mut().find(|own| own.name == robot) else {
            return Err(Refusal::new(format!("there is no robot {robot:?}"), ""));
        };
        own.standby.push(Standby {
            name: name.to_owned(),
            controller,
        });
        self.rebuild(&scenario)
    }

    /// Drives the active line again with others that stand by. Who stands by changes nothing before it takes
    /// over: the line is the same, bit for bit.
    fn rebuild(&mut self, scenario: &appell_sim::scenario::Scenario) -> Result<(), Refusal> {
        let loaded = self.reload(scenario, &[])?;
        let old = self.active();
        let (name, what, tick) = (old.name.clone(), old.what.clone(), old.tick());
        let (is_over, from) = (old.is_over(), self.active);
        let mut line = self.begin(loaded, name, what, Kind::Driven)?;
        line.drive_to(if is_over { u64::MAX } else { tick });
        self.replace(line);
        for undo in self.undo.iter_mut().chain(&mut self.redo) {
            if undo.from == Some(from) {
                undo.from = Some(self.active);
            }
        }
        Ok(())
    }
}
