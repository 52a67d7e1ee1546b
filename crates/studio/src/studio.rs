//! The studio without its clock and its network: lines that are driven, changed, branched and undone.
//!
//! A line is a scenario and what a run of it has come to. Every change is put into the scenario, as a number
//! that changes at a time, a swap of controllers at a time, or another scenario from the beginning; so each
//! line can be driven again at any time, saved, and repeated from the command line bit for bit. Undoing drives
//! the scenario of before. Driving again is quick: a minute takes some hundredths of a second.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use appell_sim::change::{Session, is_changeable};
use appell_sim::crowd::is_crowd;
use appell_sim::record::{self, Recording};
use appell_sim::report;
use appell_sim::run::{Run, Summary};
use appell_sim::scenario::{
    self, Beacon, Change, Controller, Diagnostics, Law, Level, Loaded, Overrides, Robot, Scenario,
    Standby, Swap, Template,
};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::history::History;

/// Steps driven at once while nobody else may look.
const CHUNK: u64 = 2000;
/// Most lines beside each other.
const LINES_MAX: usize = 8;
/// Most steps back.
const UNDO_MAX: usize = 200;
/// What the controller is called that hands command.
pub const HAND: &str = "hand";

/// Why something was not done.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refusal {
    /// Path of the value, or empty.
    pub path: String,
    /// What is wrong, and what would be right.
    pub problem: String,
    /// A remedy, or empty.
    pub hint: String,
}

impl Refusal {
    /// One without a path.
    pub fn new(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Refusal {
            path: String::new(),
            problem: problem.into(),
            hint: hint.into(),
        }
    }
}

impl From<Diagnostics> for Refusal {
    fn from(diagnostics: Diagnostics) -> Self {
        let first = diagnostics.0.into_iter().next().expect("never empty");
        Refusal {
            path: first.path,
            problem: first.problem,
            hint: first.hint.unwrap_or_default(),
        }
    }
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.path.is_empty() {
            write!(f, "{}: ", self.path)?;
        }
        write!(f, "{}", self.problem)?;
        if !self.hint.is_empty() {
            write!(f, "\n  hint: {}", self.hint)?;
        }
        Ok(())
    }
}

/// What a page asks for. `at` is the instant it looks at, s: before the end of the line a change makes a branch.
/// Changes with one `gesture` are undone together.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Command {
    /// Lets time run.
    Play {},
    /// Holds time.
    Pause {},
    /// Goes on to the next row and holds.
    Step {},
    /// Seconds of the run per second; 0 for as fast as can be.
    Speed {
        /// The factor.
        factor: f64,
    },
    /// Drives the line again from its beginning.
    Restart {},
    /// Sets a number by its path.
    Change {
        /// Path.
        path: String,
        /// Value.
        value: f64,
        /// Instant, s.
        at: Option<f64>,
        /// Gesture.
        gesture: Option<u64>,
    },
    /// Lets another controller or model take over.
    Swap {
        /// Name of the robot.
        robot: String,
        /// Name of what takes over.
        to: String,
        /// Instant, s.
        at: Option<f64>,
    },
    /// Sets values from the beginning, by path, as TOML.
    Edit {
        /// Paths and values.
        set: Vec<(String, String)>,
        /// Gesture.
        gesture: Option<u64>,
    },
    /// Puts a beacon into the arena.
    AddBeacon {
        /// Its place, m.
        position: [f64; 2],
    },
    /// Takes a beacon out of the arena.
    RemoveBeacon {
        /// Its name.
        name: String,
    },
    /// Lets a built-in law, or hands, take over, which the scenario has not named yet.
    Engage {
        /// Name of the robot.
        robot: String,
        /// A law of path following, or `hand`.
        with: String,
        /// Instant, s.
        at: Option<f64>,
    },
    /// A new line from an instant of this one on.
    Branch {
        /// The instant, s.
        at: f64,
    },
    /// Takes the last change back.
    Undo {},
    /// Makes it again.
    Redo {},
    /// Lets the same scenario run along at another level, or no longer.
    Ghost {
        /// The level.
        level: Level,
        /// Whether it runs along.
        on: bool,
    },
    /// Goes on with another line.
    Activate {
        /// Its number.
        line: u32,
    },
    /// Leaves a line out.
    Drop {
        /// Its number.
        line: u32,
    },
    /// Writes the scenario of the line beside the one that was opened.
    Save {
        /// Name of the file, without extension.
        name: String,
        /// Whether it may replace another.
        #[serde(default)]
        replace: bool,
    },
    /// Opens another scenario of the folder.
    Open {
        /// Its name in the list of scenarios.
        name: String,
    },
}

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
    loaded: Loaded,
    session: Option<Session>,
    summary: Option<Summary>,
}

/// A change that can be taken back.
struct Undo {
    what: String,
    before: Loaded,
    /// The line that went on before, if the change made a branch.
    from: Option<u32>,
}

/// The lines, and what is done with them.
pub struct Studio {
    lines: Vec<Line>,
    active: u32,
    next_id: u32,
    next_name: usize,
    undo: Vec<Undo>,
    redo: Vec<Undo>,
    gesture: Option<u64>,
    ghosts: Vec<Level>,
    /// Changes of the file that was opened: a branch keeps those that are still to come.
    planned: (Vec<Swap>, Vec<Change>),
    file: PathBuf,
    overrides: Vec<(String, String)>,
    trust_native: bool,
    saved: Option<String>,
    notice: Option<String>,
    /// Whether time runs.
    pub is_playing: bool,
    /// Seconds of the run per second, or none for as fast as can be.
    pub speed: Option<f64>,
}

fn quoted(word: impl Serialize) -> String {
    serde_json::to_string(&word).expect("plain data")
}

fn level_name(level: Level) -> &'static str {
    match level {
        Level::Kinematic => "kinematic",
        Level::Rolling => "rolling",
        Level::Slip => "slip",
    }
}

/// A name of a file without a way in it.
fn is_plain(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (1..=64).contains(&name.len()) && name.chars().all(allowed)
}

impl Studio {
    /// Opens a scenario or a recording.
    ///
    /// # Errors
    /// It cannot be read or built.
    pub fn open(file: &Path, overrides: &Overrides, trust_native: bool) -> Result<Studio, Refusal> {
        let mut studio = Studio {
            lines: Vec::new(),
            active: 0,
            next_id: 1,
            next_name: 0,
            undo: Vec::new(),
            redo: Vec::new(),
            gesture: None,
            ghosts: Vec::new(),
            planned: (Vec::new(), Vec::new()),
            file: file.to_owned(),
            overrides: overrides.to_vec(),
            trust_native,
            saved: None,
            notice: None,
            is_playing: false,
            speed: Some(1.0),
        };
        studio.read(file)?;
        Ok(studio)
    }

    fn read(&mut self, file: &Path) -> Result<(), Refusal> {
        let ending = file.extension().and_then(|ending| ending.to_str());
        let recording = match ending {
            Some("mcap" | "parquet") => Some(Recording::read(file).map_err(|error| {
                Refusal::new(error.to_string(), error.hint().unwrap_or_default())
            })?),
            _ => None,
        };
        let loaded = match &recording {
            None => scenario::load(file, &self.overrides)?,
            Some(recording) if recording.header.scenario_text.is_empty() => {
                return Err(Refusal::new(
                    format!(
                        "{}: must be the recording of a run, got one without its scenario",
                        file.display()
                    ),
                    "trials of a batch have a report of their own; `appell run` records a run",
                ));
            }
            Some(recording) => scenario::load_text(&recording.header.scenario_text, file, &[])?,
        };
        if is_crowd(&loaded.scenario) {
            return Err(Refusal::new(
                "must have robots of count = 1 to be driven here",
                "give --set robot.NAME.count=1, or open its recording with `appell plot`",
            ));
        }
        let loaded = Loaded {
            trust_native: self.trust_native,
            ..loaded
        };
        let planned = (loaded.scenario.swap.clone(), loaded.scenario.change.clone());
        let name = "A".to_owned();
        let line = match recording {
            None => self.begin(loaded, name, "as opened".to_owned(), Kind::Driven)?,
            Some(recording) => {
                let summary = recording.summary.clone();
                Line {
                    id: self.new_id(),
                    name,
                    what: "recorded".to_owned(),
                    kind: Kind::Recorded,
                    parent: None,
                    scene: scene(&loaded, &History::new(&recording.header)),
                    history: Arc::new(Mutex::new(History::of(&recording))),
                    session: None,
                    summary: summary.and_then(|summary| serde_json::from_value(summary).ok()),
                    loaded,
                }
            }
        };
        self.planned = planned;
        self.file = file.to_owned();
        self.active = line.id;
        self.lines = vec![line];
        self.next_name = 1;
        (self.undo, self.redo) = (Vec::new(), Vec::new());
        (self.saved, self.notice) = (None, None);
        self.ghosts.clear();
        self.is_playing = false;
        Ok(())
    }

    fn new_id(&mut self) -> u32 {
        self.next_id += 1;
        self.next_id - 1
    }

    fn new_name(&mut self) -> String {
        self.next_name += 1;
        let k = self.next_name - 1;
        let letter = char::from(b'A' + (k % 26) as u8);
        match k / 26 {
            0 => letter.to_string(),
            round => format!("{letter}{round}"),
        }
    }

    /// A line at its first instant.
    fn begin(
        &mut self,
        loaded: Loaded,
        name: String,
        what: String,
        kind: Kind,
    ) -> Result<Line, Refusal> {
        let run = Run::new(&loaded, 0)?;
        let history = History::new(&run.header);
        let mut line = Line {
            id: self.new_id(),
            name,
            what,
            kind,
            parent: None,
            scene: scene(&loaded, &history),
            history: Arc::new(Mutex::new(history)),
            session: Some(Session::new(run)),
            summary: None,
            loaded,
        };
        // The first row is there to be seen.
        line.advance(1);
        Ok(line)
    }

    fn place(&self, id: u32) -> Option<usize> {
        self.lines.iter().position(|line| line.id == id)
    }

    /// The line that goes on.
    pub fn active(&self) -> &Line {
        let place = self.place(self.active);
        &self.lines[place.expect("the active line is there")]
    }

    fn active_mut(&mut self) -> &mut Line {
        let place = self.place(self.active);
        &mut self.lines[place.expect("the active line is there")]
    }

    /// All lines.
    pub fn lines(&self) -> &[Line] {
        &self.lines
    }

    /// Drives the active line, and what runs along with it, for some steps. True while there is more to do.
    pub fn advance(&mut self, ticks: u64) -> bool {
        let goes_on = self.active_mut().advance(ticks);
        let tick = self.active().tick();
        for line in &mut self.lines {
            if matches!(line.kind, Kind::Ghost(_)) && line.tick() < tick {
                line.advance(tick - line.tick());
            }
        }
        if !goes_on {
            // Those that are slower are seen to their end, too.
            let end = self.active().end_tick();
            for line in &mut self.lines {
                if matches!(line.kind, Kind::Ghost(_)) {
                    line.drive_to(end);
                }
            }
            self.is_playing = false;
        }
        goes_on
    }

    /// Does what a page asks for.
    ///
    /// # Errors
    /// It cannot be done; nothing has changed then.
    pub fn handle(&mut self, command: Command) -> Result<Value, Refusal> {
        match command {
            Command::Play {} => {
                if self.active().session.is_none() || self.active().is_over() {
                    return Err(Refusal::new(
                        "the run is over",
                        "go back in time, and branch or change something there",
                    ));
                }
                self.is_playing = true;
            }
            Command::Pause {} => self.is_playing = false,
            Command::Step {} => {
                self.is_playing = false;
                let rows = self.active().rows();
                while self.active().rows() == rows && self.advance(1) {}
            }
            Command::Speed { factor } => {
                if factor != 0.0 && !(0.01..=100.0).contains(&factor) {
                    return Err(Refusal::new(
                        format!(
                            "speed: must be in [0.01, 100], or 0 for as fast as can be, got {factor}"
                        ),
                        "",
                    ));
                }
                self.speed = (factor != 0.0).then_some(factor);
            }
            Command::Restart {} => {
                let line = self.active();
                let (loaded, name) = (line.document()?, line.name.clone());
                let what = line.what.clone();
                let begun = self.begin(loaded, name, what, Kind::Driven)?;
                self.replace(begun);
                self.renew_ghosts();
                self.is_playing = false;
            }
            Command::Change {
                path,
                value,
                at,
                gesture,
            } => self.change(&path, value, at, gesture)?,
            Command::Swap { robot, to, at } => self.swap(&robot, &to, at)?,
            Command::Edit { set, gesture } => {
                let document = self.active().document()?;
                if set.len() > 64 {
                    return Err(Refusal::new("must be at most 64 values at once", ""));
                }
                let edited = self.reload(&document.scenario, &set)?;
                let words: Vec<String> = set
                    .iter()
                    .map(|(path, value)| format!("{path} = {value}"))
                    .collect();
                self.drive_anew(document, edited, words.join(", "), gesture)?;
            }
            Command::AddBeacon { position } => {
                let document = self.active().document()?;
                let mut scenario = document.scenario.clone();
                let beacons = &mut scenario.arena.beacon;
                let name = (1..)
                    .map(|k| format!("b{k}"))
                    .find(|name| beacons.iter().all(|beacon| beacon.name != *name))
                    .expect("numbers do not end");
                let radius = beacons.last().map_or(0.05, |last| last.radius);
                beacons.push(Beacon {
                    name: name.clone(),
                    position,
                    radius,
                });
                let edited = self.reload(&scenario, &[])?;
                self.drive_anew(document, edited, format!("beacon {name} placed"), None)?;
            }
            Command::RemoveBeacon { name } => {
                let document = self.active().document()?;
                let mut scenario = document.scenario.clone();
                scenario.arena.beacon.retain(|beacon| beacon.name != name);
                let edited = self.reload(&scenario, &[])?;
                self.drive_anew(document, edited, format!("beacon {name} removed"), None)?;
            }
            Command::Engage { robot, with, at } => self.engage(&robot, &with, at)?,
            Command::Branch { at } => {
                let before = self.active().document()?;
                let from = self.active;
                self.branch(at, "branch".to_owned())?;
                self.remember("branch".to_owned(), before, Some(from), None);
            }
            Command::Undo {} => self.step_back(false)?,
            Command::Redo {} => self.step_back(true)?,
            Command::Ghost { level, on } => {
                self.ghosts.retain(|known| *known != level);
                if on {
                    self.add_ghost(level)?;
                    self.ghosts.push(level);
                } else {
                    self.lines.retain(|line| line.kind != Kind::Ghost(level));
                }
            }
            Command::Activate { line } => {
                let known = self.lines.iter().find(|one| one.id == line);
                if known.is_none_or(|line| matches!(line.kind, Kind::Ghost(_))) {
                    return Err(Refusal::new(
                        format!("there is no line {line} to go on with"),
                        "",
                    ));
                }
                self.active = line;
                self.gesture = None;
                self.is_playing = false;
                (self.undo, self.redo) = (Vec::new(), Vec::new());
                self.renew_ghosts();
            }
            Command::Drop { line } => {
                if line == self.active {
                    return Err(Refusal::new(
                        "the line that goes on must stay",
                        "go on with another line first",
                    ));
                }
                self.lines.retain(|one| one.id != line);
            }
            Command::Save { name, replace } => return self.save(&name, replace),
            Command::Open { name } => {
                let listed = self.scenarios();
                if !listed.contains(&name) {
                    return Err(Refusal::new(
                        format!("must be one of the scenarios of the folder, got {name:?}"),
                        listed.join(", "),
                    ));
                }
                let file = self.folder().join(format!("{name}.toml"));
                let overrides = std::mem::take(&mut self.overrides);
                if let Err(refusal) = self.read(&file) {
                    self.overrides = overrides;
                    return Err(refusal);
                }
            }
        }
        Ok(json!({}))
    }

    /// The scenario with values at paths, read anew and checked.
    fn reload(&self, scenario: &Scenario, set: &Overrides) -> Result<Loaded, Refusal> {
        let file = &self.active().loaded.file;
        let loaded = scenario::load_text(&scenario.to_toml(), file, set)?;
        if is_crowd(&loaded.scenario) {
            return Err(Refusal::new(
                "must have robots of count = 1 to be driven here",
                "",
            ));
        }
        Ok(Loaded {
            trust_native: self.trust_native,
            ..loaded
        })
    }

    /// Puts another line in the place of the active one.
    fn replace(&mut self, mut line: Line) {
        let place = self.place(self.active);
        let old = &mut self.lines[place.expect("the active line is there")];
        line.parent = old.parent.take();
        self.active = line.id;
        *old = line;
    }

    fn remember(&mut self, what: String, before: Loaded, from: Option<u32>, gesture: Option<u64>) {
        self.redo.clear();
        self.saved = None;
        self.notice = None;
        if gesture.is_some() && gesture == self.gesture {
            if let Some(last) = self.undo.last_mut() {
                last.what = what;
            }
            return;
        }
        self.gesture = gesture;
        if self.undo.len() >= UNDO_MAX {
            self.undo.remove(0);
        }
        self.undo.push(Undo { what, before, from });
    }

    /// Drives another scenario to where the active line is. The line stays to be seen, unless the last change
    /// belongs to the same gesture.
    fn drive_anew(
        &mut self,
        before: Loaded,
        after: Loaded,
        what: String,
        gesture: Option<u64>,
    ) -> Result<(), Refusal> {
        let goes_on = gesture.is_some() && gesture == self.gesture;
        let old = self.active();
        let (is_over, tick) = (old.is_over(), old.tick());
        // A line that has hardly begun need not stay.
        let replaces = goes_on || old.tick() <= 1;
        let name = match replaces {
            true => old.name.clone(),
            false => self.new_name(),
        };
        let mut line = self.begin(after, name, what.clone(), Kind::Driven)?;
        line.drive_to(if is_over { u64::MAX } else { tick });
        let from = self.active;
        if replaces {
            self.replace(line);
        } else {
            line.parent = Some((self.active().name.clone(), 0.0));
            self.add(line);
        }
        self.remember(what, before, (!replaces).then_some(from), gesture);
        self.renew_ghosts();
        Ok(())
    }

    /// Adds a line, which goes on from now on; the oldest goes where there are too many.
    fn add(&mut self, line: Line) {
        self.active = line.id;
        let ghosts = self
            .lines
            .iter()
            .position(|line| matches!(line.kind, Kind::Ghost(_)));
        let place = ghosts.unwrap_or(self.lines.len());
        self.lines.insert(place, line);
        let driven = |line: &Line| !matches!(line.kind, Kind::Ghost(_));
        while self.lines.iter().filter(|line| driven(line)).count() > LINES_MAX {
            let active = self.active;
            let oldest = self
                .lines
                .iter()
                .position(|line| driven(line) && line.id != active);
            self.lines.remove(oldest.expect("there are several"));
        }
    }

    /// A new line from an instant of the active one on, with what was done until then.
    fn branch(&mut self, at: f64, what: String) -> Result<(), Refusal> {
        let line = self.active();
        let document = line.document()?;
        let (step, end) = (document.scenario.time.step, line.tick());
        let limit = end as f64 * step;
        if !(0.0..=limit + step).contains(&at) {
            return Err(Refusal::new(
                format!("at: must be in [0, {limit}], what the line has driven, s, got {at}"),
                "",
            ));
        }
        let tick = (at / step).round() as u64;
        let is_past = |t: f64| (t / step).round() as u64 <= tick;
        let mut scenario = document.scenario.clone();
        let (swaps, changes) = &self.planned;
        scenario
            .swap
            .retain(|swap| is_past(swap.at) || swaps.contains(swap));
        scenario
            .change
            .retain(|change| is_past(change.at) || changes.contains(change));
        let parent = Some((line.name.clone(), at));
        let loaded = self.reload(&scenario, &[])?;
        let name = self.new_name();
        let mut branch = self.begin(loaded, name, what, Kind::Driven)?;
        branch.drive_to(tick);
        branch.parent = parent;
        self.add(branch);
        self.renew_ghosts();
        Ok(())
    }

    /// Whether a change at this instant is one of the past.
    fn is_past(&self, at: Option<f64>) -> bool {
        let line = self.active();
        let step = line.loaded.scenario.time.step;
        at.is_some_and(|at| {
            ((at / step).round() as u64) < line.last_tick() || line.session.is_none()
        })
    }

    fn change(
        &mut self,
        path: &str,
        value: f64,
        at: Option<f64>,
        gesture: Option<u64>,
    ) -> Result<(), Refusal> {
        if !value.is_finite() {
            return Err(Refusal {
                path: path.to_owned(),
                problem: format!("must be finite, got {value}"),
                hint: String::new(),
            });
        }
        let before = self.active().document()?;
        if !is_changeable(path) {
            let set = [(path.to_owned(), scenario::number_text(value))];
            let edited = self.reload(&before.scenario, &set)?;
            let what = format!("{path} = {value}");
            return self.drive_anew(before, edited, what, gesture);
        }
        let goes_on = gesture.is_some() && gesture == self.gesture;
        let what = format!("{path} = {value}");
        let is_past = self.is_past(at) && !goes_on;
        if !is_past && (self.active().is_over() || self.active().session.is_none()) {
            // What is over is driven again with the number from the beginning.
            let mut scenario = before.scenario.clone();
            scenario.change.retain(|change| change.path != path);
            let set = [(path.to_owned(), scenario::number_text(value))];
            let edited = self.reload(&scenario, &set)?;
            return self.drive_anew(before, edited, what, gesture);
        }
        let from = self.active;
        if let (true, Some(at)) = (is_past, at) {
            self.branch(at, what.clone())?;
        }
        let session = self.active_mut().session.as_mut().expect("it goes on");
        if let Err(error) = session.run.change(path, value) {
            if is_past {
                // The branch for it has no use.
                let made = self.active;
                self.active = from;
                self.lines.retain(|line| line.id != made);
                self.next_name -= 1;
                self.renew_ghosts();
            }
            return Err(Refusal {
                path: path.to_owned(),
                ..Refusal::from(error)
            });
        }
        for line in &mut self.lines {
            if matches!(line.kind, Kind::Ghost(_))
                && let Some(session) = &mut line.session
                && !session.is_over()
            {
                // One of another level may not have the number.
                let _ = session.run.change(path, value);
            }
        }
        self.remember(what, before, is_past.then_some(from), gesture);
        Ok(())
    }

    fn swap(&mut self, robot: &str, to: &str, at: Option<f64>) -> Result<(), Refusal> {
        let before = self.active().document()?;
        let from = self.active;
        let is_past = self.is_past(at);
        let what = format!("{robot}: {to} takes over");
        if let (true, Some(at)) = (is_past, at) {
            self.branch(at, what.clone())?;
        } else if self.active().is_over() {
            return Err(Refusal::new(
                "the run is over",
                "go back in time and change the controller there",
            ));
        }
        let session = self.active_mut().session.as_mut().expect("it goes on");
        let swapped = session.run.swap(robot, to);
        if let Err(error) = swapped {
            if is_past {
                let made = self.active;
                self.active = from;
                self.lines.retain(|line| line.id != made);
            }
            return Err(Refusal::new(error.to_string(), ""));
        }
        self.remember(what, before, is_past.then_some(from), None);
        self.renew_ghosts();
        Ok(())
    }

    /// Adds a controller that stands by, if it does not yet, and lets it take over.
    fn engage(&mut self, robot: &str, with: &str, at: Option<f64>) -> Result<(), Refusal> {
        let document = self.active().document()?;
        let mut scenario = document.scenario.clone();
        let Some(own) = scenario.robot.iter_mut().find(|own| own.name == robot) else {
            return Err(Refusal::new(format!("there is no robot {robot:?}"), ""));
        };
        if own.controllers().all(|(name, _)| name != with) {
            let controller = match with {
                HAND => hand(own),
                law => follower(own, law)?,
            };
            own.standby.push(Standby {
                name: with.to_owned(),
                controller,
            });
            // Who stands by changes nothing before it takes over: the line is the same, bit for bit.
            let loaded = self.reload(&scenario, &[])?;
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
        }
        self.swap(robot, with, at)
    }

    /// Undoes, or does again.
    fn step_back(&mut self, again: bool) -> Result<(), Refusal> {
        let from = if again {
            &mut self.redo
        } else {
            &mut self.undo
        };
        let Some(step) = from.pop() else {
            let what = if again { "redo" } else { "undo" };
            return Err(Refusal::new(format!("there is nothing to {what}"), ""));
        };
        self.gesture = None;
        let now = Undo {
            what: step.what.clone(),
            before: self.active().document()?,
            from: None,
        };
        let left = self.active;
        match step.from.filter(|id| self.place(*id).is_some()) {
            // Undoing a branch is to go back to where it came from.
            Some(id) if !again => {
                self.active = id;
                self.lines.retain(|line| line.id != left);
                self.is_playing = false;
            }
            _ => {
                let old = self.active();
                let (is_over, tick) = (old.is_over(), old.tick());
                let name = old.name.clone();
                let mut line = self.begin(step.before, name, step.what, Kind::Driven)?;
                line.drive_to(if is_over { u64::MAX } else { tick });
                self.replace(line);
            }
        }
        if again {
            &mut self.undo
        } else {
            &mut self.redo
        }
        .push(now);
        self.saved = None;
        self.renew_ghosts();
        Ok(())
    }

    fn add_ghost(&mut self, level: Level) -> Result<(), Refusal> {
        let active = self.active();
        let set = [("robot.*.level".to_owned(), quoted(level))];
        let loaded = self.reload(&active.document()?.scenario, &set)?;
        let (is_over, tick) = (active.is_over(), active.tick());
        let name = level_name(level).to_owned();
        let what = "runs along".to_owned();
        let mut ghost = self.begin(loaded, name, what, Kind::Ghost(level))?;
        ghost.drive_to(if is_over { u64::MAX } else { tick });
        self.lines.retain(|line| line.kind != Kind::Ghost(level));
        self.lines.push(ghost);
        Ok(())
    }

    /// Ghosts of the active line as it is now; those that cannot be built are left out, with a notice.
    fn renew_ghosts(&mut self) {
        for level in self.ghosts.clone() {
            if let Err(refusal) = self.add_ghost(level) {
                self.lines.retain(|line| line.kind != Kind::Ghost(level));
                self.notice = Some(format!(
                    "{} does not run along: {refusal}",
                    level_name(level)
                ));
            }
        }
    }

    fn folder(&self) -> &Path {
        match self.file.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        }
    }

    /// Scenarios beside the one that was opened, without their extension.
    pub fn scenarios(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder());
        let mut names: Vec<String> = entries
            .into_iter()
            .flatten()
            .filter_map(|entry| {
                let entry = entry.ok()?;
                // Not what leads elsewhere.
                entry.file_type().ok()?.is_file().then_some(())?;
                let name = entry.file_name().into_string().ok()?;
                name.strip_suffix(".toml").map(str::to_owned)
            })
            .collect();
        names.sort();
        names
    }

    fn save(&mut self, name: &str, replace: bool) -> Result<Value, Refusal> {
        if !is_plain(name) {
            return Err(Refusal::new(
                format!("name: must be 1 to 64 letters, digits, - and _, got {name:?}"),
                "the scenario is written beside the one that was opened",
            ));
        }
        let mut document = self.active().document()?;
        document.scenario.name = name.to_owned();
        let text = document.scenario.to_toml();
        let file = self.folder().join(format!("{name}.toml"));
        let about = std::fs::symlink_metadata(&file);
        if about.as_ref().is_ok_and(|about| !about.is_file()) {
            return Err(Refusal::new(
                format!("{name}.toml is no plain file"),
                "choose another name",
            ));
        }
        if about.is_ok() && !replace {
            return Err(Refusal::new(
                format!("{name}.toml is there already"),
                "choose another name, or replace it",
            ));
        }
        // Written apart and moved, so that a link is replaced and never followed.
        let fail = |error: std::io::Error| {
            Refusal::new(
                format!("{}: cannot be written: {error}", file.display()),
                "",
            )
        };
        let aside = self.folder().join(format!(".{name}.toml.part"));
        let _ = std::fs::remove_file(&aside);
        let mut open = std::fs::File::create_new(&aside).map_err(fail)?;
        std::io::Write::write_all(&mut open, text.as_bytes()).map_err(fail)?;
        std::fs::rename(&aside, &file).map_err(fail)?;
        self.saved = Some(name.to_owned());
        Ok(
            json!({"file": file.display().to_string(), "run": format!("appell run {}", file.display())}),
        )
    }

    /// Writes the active line's recording.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_recording(line: &Line, file: &Path) -> Result<(), record::RecordError> {
        let summary = line
            .summary
            .as_ref()
            .map_or(Value::Null, |summary| json!(summary));
        let mut recorder = record::create(file)?;
        let history = line.history.lock().expect("nothing panics with it");
        history.replay(recorder.as_mut(), &summary)
    }

    /// What pages show besides pictures, as JSON.
    pub fn state(&self) -> Value {
        let active = self.active();
        let changes: Vec<Value> = active
            .changes()
            .iter()
            .map(|change| json!([change.at, change.path, change.value]))
            .collect();
        let from = changes.len().saturating_sub(400);
        json!({
            "kind": "state",
            "file": self.file.file_name().map(|name| name.to_string_lossy()),
            "playing": self.is_playing,
            "speed": self.speed.unwrap_or(0.0),
            "active": self.active,
            "lines": self.lines.iter().map(Line::state).collect::<Vec<_>>(),
            "undo": self.undo.last().map(|undo| &undo.what),
            "redo": self.redo.last().map(|undo| &undo.what),
            "changed": !self.undo.is_empty(),
            "saved": self.saved,
            "notice": self.notice,
            "scenarios": self.scenarios(),
            "changes": &changes[from..],
            "robots": active.robots(),
            "beacons": active.loaded.scenario.arena.beacon,
            "ghosts": self.ghosts,
        })
    }
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
    fn tick(&self) -> u64 {
        match &self.session {
            Some(session) => session.run.world.tick(),
            None => self.last_tick(),
        }
    }

    /// The tick of its last row.
    fn last_tick(&self) -> u64 {
        let history = self.history.lock().expect("nothing panics with it");
        let step = self.loaded.scenario.time.step;
        history
            .times
            .last()
            .map_or(0, |t| (t / step).round() as u64)
    }

    /// The tick at which it ends, at the latest.
    fn end_tick(&self) -> u64 {
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

    fn advance(&mut self, ticks: u64) -> bool {
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

    fn drive_to(&mut self, tick: u64) {
        while self.tick() < tick {
            if !self.advance(CHUNK.min(tick - self.tick())) {
                return;
            }
        }
    }

    fn changes(&self) -> &[Change] {
        match &self.session {
            Some(session) => session.run.changes(),
            None => &self.loaded.scenario.change,
        }
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

    fn state(&self) -> Value {
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
    fn robots(&self) -> Vec<Value> {
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
                    Some(_) => vec!["samson", "pure-pursuit", "stanley", "kanayama", "lqr"],
                    None => Vec::new(),
                };
                offers.push(HAND);
                offers.retain(|offer| robot.controllers().all(|(name, _)| name != *offer));
                if robot.controller.is_none() && robot.standby.is_empty() {
                    offers.clear();
                }
                json!({
                    "name": robot.name,
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

/// A controller that hands command: channels that stay where they are put.
fn hand(robot: &Robot) -> Controller {
    let moves_sideways = robot.platform.as_ref().is_some_and(|platform| {
        let rollers = platform
            .wheel
            .iter()
            .filter(|wheel| !matches!(wheel.rim, scenario::Rim::Plain));
        rollers.count() >= 3
    });
    let channels = ["forward", "yaw_rate", "left"];
    let count = if moves_sideways { 3 } else { 2 };
    let channel: Vec<Value> = channels[..count]
        .iter()
        .map(|to| json!({"to": to, "signal": {"kind": "constant", "value": 0.0}}))
        .collect();
    let text = json!({"kind": "signals", "channel": channel});
    serde_json::from_value(text).expect("a controller")
}

/// The robot's own follower, with another law.
fn follower(robot: &Robot, law: &str) -> Result<Controller, Refusal> {
    let Ok(law) = serde_json::from_value::<Law>(json!(law)) else {
        return Err(Refusal::new(
            format!("must be a law of path following, or hand, got {law:?}"),
            "samson, pure-pursuit, stanley, kanayama, lqr",
        ));
    };
    let mut own = robot.controllers().map(|(_, controller)| controller);
    let Some(controller) = own.find(|controller| controller.follower().is_some()) else {
        return Err(Refusal::new(
            format!(
                "robot {} must have a controller that follows a path",
                robot.name
            ),
            "",
        ));
    };
    let mut controller = controller.clone();
    match &mut controller {
        Controller::Homing(follower)
        | Controller::Gate(follower)
        | Controller::Eight(follower)
        | Controller::Slalom(follower)
        | Controller::Route(follower) => follower.law = law,
        Controller::Signals { .. } | Controller::Plugin(_) => {}
    }
    Ok(controller)
}

/// What a page draws a line from: the drawing, signals, plots and numbers that can be changed.
fn scene(loaded: &Loaded, history: &History) -> Arc<str> {
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
