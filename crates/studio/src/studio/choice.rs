//! What can be chosen of what is found: robot files, tasks, and recordings beside the line that goes on.

use std::path::{Path, PathBuf};

use appell_sim::record::Recording;
use appell_sim::scenario::{self, Controller, Follower, Loaded, Scenario, Task};
use serde_json::{Value, json};

use super::command::Refusal;
use super::edits::HAND;
use super::{Studio, files, is_plain};

/// Tasks that are made of beacons, with how many of them each needs.
const TASKS: [(&str, usize); 4] = [("homing", 1), ("gate", 2), ("eight", 2), ("slalom", 2)];
/// Most files that are listed of a kind.
const FILES_MAX: usize = 200;

/// Names of the plain files of a folder that end so, without their ending, in order.
fn stems(folder: &Path, ending: &str) -> Vec<String> {
    let mut names = files(folder, |name| {
        let stem = name.strip_suffix(ending)?;
        is_plain(stem).then(|| stem.to_owned())
    });
    names.truncate(FILES_MAX);
    names
}

/// A controller that follows the path of a task of this kind as another did.
fn of_kind(kind: &str, follower: Follower) -> Controller {
    match kind {
        "homing" => Controller::Homing(follower),
        "gate" => Controller::Gate(follower),
        "eight" => Controller::Eight(follower),
        "slalom" => Controller::Slalom(follower),
        _ => Controller::Route(follower),
    }
}

/// Lets followers of a robot follow the path of another task; the first is made where there is none.
fn follow(robot: &mut scenario::Robot, kind: &str) {
    let first = robot.controllers().find_map(|(_, one)| one.follower());
    let follower = first.cloned().unwrap_or_else(|| {
        serde_json::from_value(json!({})).expect("a follower has defaults for all")
    });
    let standby = robot.standby.iter_mut().map(|one| &mut one.controller);
    for controller in robot.controller.iter_mut().chain(standby) {
        if let Some(own) = controller.follower().cloned() {
            *controller = of_kind(kind, own);
        }
    }
    let follows = robot.controllers().any(|(_, one)| one.follower().is_some());
    if !follows {
        robot.controller = Some(of_kind(kind, follower));
    }
}

/// A task of this kind among the beacons, in the order in which they stand.
fn task_of(kind: &str, scenario: &Scenario) -> Option<Task> {
    let names: Vec<&str> = scenario
        .arena
        .beacon
        .iter()
        .map(|b| b.name.as_str())
        .collect();
    let (_, least) = TASKS.iter().find(|(known, _)| *known == kind)?;
    if names.len() < *least {
        return None;
    }
    let text = match kind {
        "homing" => json!({"beacon": names.last(), "distance": 0.3}),
        "gate" | "eight" => json!({"beacons": names[..2]}),
        _ => json!({"chain": names}),
    };
    let mut text = text;
    text["kind"] = kind.into();
    serde_json::from_value(text).ok()
}

impl Studio {
    /// The folder of robot files: `robots`, beside the scenario or its folder.
    fn robots_folder(&self) -> Option<PathBuf> {
        let beside = [
            self.folder().join("robots"),
            self.folder().join("../robots"),
        ];
        let is_folder =
            |folder: &PathBuf| std::fs::symlink_metadata(folder).is_ok_and(|about| about.is_dir());
        beside.into_iter().find(is_folder)
    }

    /// Recordings by the names of their runs: beside what was opened, and of folders of runs.
    fn recordings(&self) -> Vec<(String, PathBuf)> {
        let own = self.folder();
        let mut found: Vec<(String, PathBuf)> = stems(own, ".mcap")
            .into_iter()
            // That of a run goes by the name of its folder.
            .filter(|stem| stem != "recording")
            .map(|stem| (stem.clone(), own.join(format!("{stem}.mcap"))))
            .collect();
        for runs in [own.join(".."), own.join("../runs"), own.join("runs")] {
            let entries = std::fs::read_dir(runs).into_iter().flatten();
            found.extend(entries.filter_map(|entry| {
                let entry = entry.ok()?;
                entry.file_type().ok()?.is_dir().then_some(())?;
                let name = entry.file_name().into_string().ok()?;
                let file = entry.path().join("recording.mcap");
                let is_file = std::fs::symlink_metadata(&file).is_ok_and(|about| about.is_file());
                (is_file && is_plain(&name)).then_some((name, file))
            }));
        }
        found.sort();
        found.dedup_by(|one, other| one.0 == other.0);
        found.truncate(FILES_MAX);
        found
    }

    /// What can be chosen, for pages.
    pub(super) fn choices(&self) -> Value {
        let scenario = &self.active().loaded.scenario;
        let beacons = scenario.arena.beacon.len();
        let tasks = TASKS.iter().filter(|(_, least)| beacons >= *least);
        let recordings = self.recordings();
        json!({
            "platforms": self.robots_folder().map_or_else(Vec::new, |folder| stems(&folder, ".toml")),
            "tasks": tasks.map(|(kind, _)| kind).collect::<Vec<_>>(),
            "recordings": recordings.iter().map(|(name, _)| name).collect::<Vec<_>>(),
        })
    }

    fn one_of<'a>(what: &str, names: &'a [String], asked: &str) -> Result<&'a String, Refusal> {
        names.iter().find(|name| *name == asked).ok_or_else(|| {
            Refusal::new(
                format!("must be one of the {what} that are found, got {asked:?}"),
                names.join(", "),
            )
        })
    }

    /// Drives with the platform of another robot file. What was done to the old one's numbers is left out.
    pub(super) fn take_platform(&mut self, robot: &str, file: &str) -> Result<(), Refusal> {
        let folder = self.robots_folder().unwrap_or_default();
        let names = stems(&folder, ".toml");
        let name = Self::one_of("robot files", &names, file)?;
        let platform = scenario::load_robot(&folder.join(format!("{name}.toml")))?;
        let document = self.active().document()?;
        let mut scenario = document.scenario.clone();
        let Some(own) = scenario.robot.iter_mut().find(|own| own.name == robot) else {
            return Err(Refusal::new(format!("there is no robot {robot:?}"), ""));
        };
        own.platform = Some(platform);
        let of_old = format!("robot.{robot}.platform.");
        scenario.change.retain(|one| !one.path.starts_with(&of_old));
        let edited = self.reload(&scenario, &[])?;
        self.drive_anew(
            document.scenario,
            edited,
            format!("{robot}: {name}.toml"),
            None,
        )
    }

    /// Gives a robot another task: of a kind, among the beacons that stand; or that of another scenario, with its
    /// arena and where its robot starts.
    pub(super) fn take_task(
        &mut self,
        robot: &str,
        kind: Option<&str>,
        of: Option<&str>,
    ) -> Result<(), Refusal> {
        let document = self.active().document()?;
        let mut scenario = document.scenario.clone();
        let Some(k) = scenario.robot.iter().position(|own| own.name == robot) else {
            return Err(Refusal::new(format!("there is no robot {robot:?}"), ""));
        };
        let (task, what) = match (kind, of) {
            (Some(kind), None) => {
                let task = task_of(kind, &scenario).ok_or_else(|| {
                    let names: Vec<&str> = TASKS.iter().map(|(name, _)| *name).collect();
                    Refusal::new(
                        format!("must be a task for which there are beacons enough, got {kind:?}"),
                        names.join(", "),
                    )
                })?;
                (task, kind.to_owned())
            }
            (None, Some(of)) => {
                let names = self.scenarios();
                let name = Self::one_of("scenarios", &names, of)?;
                let file = self.folder().join(format!("{name}.toml"));
                let other = scenario::load(&file, &[])?.scenario;
                let first = other.robot.iter().find(|own| own.task.is_some());
                let Some(first) = first else {
                    let problem = format!("{name}.toml has no robot with a task");
                    return Err(Refusal::new(problem, "choose another"));
                };
                (scenario.arena, scenario.terrain) = (other.arena.clone(), other.terrain.clone());
                scenario.time.duration = other.time.duration;
                scenario.robot[k].pose = first.pose;
                (
                    first.task.clone().expect("has one"),
                    format!("task of {name}.toml"),
                )
            }
            _ => {
                return Err(Refusal::new(
                    "must be a kind of task, or a scenario that has one",
                    "",
                ));
            }
        };
        let own = &mut scenario.robot[k];
        follow(own, task.kind());
        own.task = Some(task);
        // What was changed of the old ground and its path need not be there any more.
        let is_own = format!("robot.{robot}.");
        scenario.change.retain(|one| {
            one.path.starts_with(&is_own) && !one.path.contains(&format!(".{HAND}."))
        });
        scenario.swap.clear();
        let edited = self.reload(&scenario, &[])?;
        self.drive_anew(document.scenario, edited, format!("{robot}: {what}"), None)
    }

    /// Shows a recording beside the lines that there are.
    pub(super) fn lay_beside(&mut self, name: &str) -> Result<(), Refusal> {
        let found = self.recordings();
        let names: Vec<String> = found.iter().map(|(name, _)| name.clone()).collect();
        Self::one_of("recordings", &names, name)?;
        let (_, file) = found
            .iter()
            .find(|(known, _)| known == name)
            .expect("is listed");
        let recording = Recording::read(file)
            .map_err(|error| Refusal::new(error.to_string(), error.hint().unwrap_or_default()))?;
        let loaded = of_recording(&recording, file)?;
        let line = self.recorded(&recording, loaded, name.to_owned());
        self.insert(line);
        Ok(())
    }
}

/// A scenario that is read from a recording.
pub(super) fn of_recording(recording: &Recording, file: &Path) -> Result<Loaded, Refusal> {
    if recording.header.scenario_text.is_empty() {
        return Err(Refusal::new(
            format!(
                "{}: must be the recording of a run, got one without its scenario",
                file.display()
            ),
            "trials of a batch have a report of their own; `appell run` records a run",
        ));
    }
    Ok(scenario::load_text(
        &recording.header.scenario_text,
        file,
        &[],
    )?)
}
