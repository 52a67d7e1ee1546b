//! A line: a scenario, and what a run of it has come to.

use std::path::Path;
use std::sync::{Arc, Mutex};

use appell_sim::change::{Session, is_changeable};
use appell_sim::record::{self, Recording};
use appell_sim::report;
use appell_sim::run::Summary;
use appell_sim::scenario::{self, Change, Controller, Level, Loaded, Scenario, Template};
use serde_json::{Value, json};

use super::command::Refusal;
use super::edits::{HAND, LAWS};
use crate::history::History;

/// Steps driven at once while nobody else may look.
const CHUNK: u64 = 2000;
/// What a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Driven here.
    Driven,
    /// Runs along at another level.
    Ghost(Level),
    /// Read from a file.
    Recorded,
}

/// A scenario, and what a run of it has come to.
pub struct Line {
    /// Number, never used twice.
    pub id: u32,
    /// Letter.
    pub name: String,
    /// What made it.
    pub what: String,
    /// What it is.
    pub kind: Kind,
    /// The line it branched from, and when, s.
    pub parent: Option<(String, f64)>,
    /// What it has driven.
    pub history: Arc<Mutex<History>>,
    /// What a page draws it from.
    pub scene: Arc<str>,
    pub(super) loaded: Loaded,
    pub(super) session: Option<Session>,
    pub(super) summary: Option<Summary>,
}

impl Line {
    /// The time at which it stands, s.
    pub fn now(&self) -> f64 {
        self.tick() as f64 * self.step()
    }

    /// The step of its physics, s.
    pub fn step(&self) -> f64 {
        self.loaded.scenario.time.step
    }

    /// The tick at which it stands.
    pub(super) fn tick(&self) -> u64 {
        match &self.session {
            Some(session) => session.run.world.tick(),
            None => self.last_tick(),
        }
    }

    /// The tick of its last row.
    pub(super) fn last_tick(&self) -> u64 {
        let history = self.history.lock().expect("nothing panics with it");
        let step = self.loaded.scenario.time.step;
        history
            .times
            .last()
            .map_or(0, |t| (t / step).round() as u64)
    }

    /// The tick at which it ends, at the latest.
    pub(super) fn end_tick(&self) -> u64 {
        let time = &self.loaded.scenario.time;
        (time.duration / time.step).round() as u64
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.history.lock().expect("nothing panics with it").rows()
    }

    /// Whether nothing more comes.
    pub fn is_over(&self) -> bool {
        self.session.as_ref().is_none_or(Session::is_over)
    }

    pub(super) fn advance(&mut self, ticks: u64) -> bool {
        let Some(session) = &mut self.session else {
            return false;
        };
        let mut history = self.history.lock().expect("nothing panics with it");
        if history.is_full() {
            return false;
        }
        let goes_on = session.advance(ticks, &mut *history);
        let goes_on = goes_on.expect("a history in memory takes all rows");
        if !goes_on && self.summary.is_none() {
            self.summary = Some(session.summary());
        }
        goes_on
    }

    pub(super) fn drive_to(&mut self, tick: u64) {
        while self.tick() < tick {
            if !self.advance(CHUNK.min(tick - self.tick())) {
                return;
            }
        }
    }

    pub(super) fn changes(&self) -> &[Change] {
        match &self.session {
            Some(session) => session.run.changes(),
            None => &self.loaded.scenario.change,
        }
    }

    /// The same as [`Line::document`], not read anew and checked.
    pub(super) fn scenario(&self) -> Scenario {
        let session = self.session.as_ref();
        let changed = session.and_then(|session| session.run.repetition());
        changed.unwrap_or_else(|| self.loaded.scenario.clone())
    }

    /// The scenario that drives this line by itself.
    pub fn document(&self) -> Result<Loaded, Refusal> {
        let changed = self
            .session
            .as_ref()
            .and_then(|session| session.run.repetition());
        match changed {
            None => Ok(self.loaded.clone()),
            Some(scenario) => {
                let loaded = scenario::load_text(&scenario.to_toml(), &self.loaded.file, &[])?;
                Ok(Loaded {
                    trust_native: self.loaded.trust_native,
                    ..loaded
                })
            }
        }
    }

    /// The summary so far.
    pub fn summary(&self) -> Option<Summary> {
        let session = self.session.as_ref();
        self.summary
            .clone()
            .or_else(|| session.map(Session::summary))
    }

    /// Writes its recording.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_recording(&self, file: &Path) -> Result<(), record::RecordError> {
        let summary = self
            .summary
            .as_ref()
            .map_or(Value::Null, |summary| json!(summary));
        let mut recorder = record::create(file)?;
        let history = self.history.lock().expect("nothing panics with it");
        history.replay(recorder.as_mut(), &summary)
    }

    pub(super) fn state(&self) -> Value {
        let history = self.history.lock().expect("nothing panics with it");
        let from = history.events.len().saturating_sub(400);
        let events: Vec<Value> = history.events[from..]
            .iter()
            .enumerate()
            .map(|(k, (_, event))| {
                let (text, detail) = match event.text.split_once(", ") {
                    Some((text, detail)) => (text, Some(detail)),
                    None => (event.text.as_str(), None),
                };
                json!({"n": from + k + 1, "t": event.t, "robot": event.robot, "kind": event.kind, "text": text, "detail": detail, "position": event.position})
            })
            .collect();
        let summary = self.summary.as_ref();
        json!({
            "id": self.id,
            "name": self.name,
            "what": self.what,
            "kind": match self.kind { Kind::Driven => "driven", Kind::Ghost(_) => "ghost", Kind::Recorded => "recorded" },
            "parent": self.parent,
            "trial": self.loaded.scenario.trial,
            "over": self.is_over(),
            "verdict": summary.map(|summary| summary.verdict),
            "sentence": summary.map(|summary| &summary.reason),
            "metrics": summary.map(|summary| summary.robots.iter().map(|robot| json!({"robot": robot.name, "metrics": robot.metrics})).collect::<Vec<_>>()),
            "end": history.times.last(),
            "duration": self.loaded.scenario.time.duration,
            "events": events,
        })
    }

    /// What decides for each robot, and what could.
    pub(super) fn robots(&self) -> Vec<Value> {
        let robots = self.loaded.scenario.robot.iter().enumerate();
        robots
            .map(|(k, robot)| {
                let session = self.session.as_ref();
                let (names, active) = session.map_or((&[][..], 0), |s| s.run.controllers(k));
                let known: Vec<Value> = robot
                    .controllers()
                    .map(|(name, controller)| {
                        let law = controller.follower().map(|follower| follower.law);
                        let file = match controller {
                            Controller::Plugin(plugin) => Some(&plugin.file),
                            _ => None,
                        };
                        json!({"name": name, "kind": controller.kind(), "law": law, "file": file})
                    })
                    .collect();
                let first = robot.controllers().find_map(|(_, c)| c.follower());
                let mut offers: Vec<&str> = match first {
                    Some(_) => LAWS.to_vec(),
                    None => Vec::new(),
                };
                offers.push(HAND);
                offers.retain(|offer| robot.controllers().all(|(name, _)| name != *offer));
                if robot.controller.is_none() && robot.standby.is_empty() {
                    offers.clear();
                }
                json!({
                    "name": robot.name,
                    "platform": robot.platform.as_ref().map(|platform| &platform.name),
                    "level": robot.level,
                    "drive": robot.drive,
                    "task": robot.task.as_ref().map(|task| task.kind()),
                    "controllers": known,
                    "driving": names.get(active),
                    "offers": offers,
                    "pose": robot.pose,
                })
            })
            .collect()
    }
}

/// What a page draws a line from: the drawing, signals, plots and numbers that can be changed.
pub(super) fn scene(loaded: &Loaded, history: &History) -> Arc<str> {
    let header = &history.header;
    let empty = Recording {
        columns: vec![Vec::new(); header.signals.len()],
        header: header.clone(),
        ..Recording::default()
    };
    let plots = report::data(&empty, &nothing(header))["plots"].take();
    let numbers = Template::of(loaded).numbers().into_iter();
    let numbers: Vec<Value> = numbers
        .map(|(path, value)| json!([path, value, is_changeable(&path)]))
        .collect();
    let scene = json!({
        "extra": header.extra,
        "name": header.scenario,
        "hash": header.hash,
        "seed": header.seed,
        "version": header.version,
        "step": header.step,
        "period": header.period,
        "signals": history.signals,
        "drawn": history.drawn,
        "plots": plots,
        "numbers": numbers,
    });
    scene.to_string().into()
}

/// A summary of a run that has not begun.
fn nothing(header: &record::Header) -> Summary {
    Summary {
        verdict: appell_sim::run::Outcome::Stopped,
        reason: String::new(),
        scenario: header.scenario.clone(),
        hash: header.hash.clone(),
        seed: header.seed,
        version: header.version.clone(),
        duration: 0.0,
        error: None,
        robots: Vec::new(),
        swaps: Vec::new(),
        failures: Vec::new(),
        statistics: Vec::new(),
    }
}
