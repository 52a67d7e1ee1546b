//! The studio without its clock and its network: lines that are driven, changed, branched and undone.
//!
//! A line is a scenario and what a run of it has come to. Every change is put into the scenario, as a number
//! that changes at a time, a swap of controllers at a time, or another scenario from the beginning; so each
//! line can be driven again at any time, saved, and repeated from the command line bit for bit. Undoing drives
//! the scenario of before. Driving again is quick: a minute takes some hundredths of a second.

mod batch;
mod choice;
mod command;
mod edits;
mod line;
mod plugins;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use appell_sim::change::Session;
use appell_sim::crowd::is_crowd;
use appell_sim::record::Recording;
use appell_sim::run::Run;
use appell_sim::scenario::{self, Beacon, Change, Level, Loaded, Overrides, Scenario, Swap};
use serde_json::{Value, json};

use crate::history::History;
use batch::Opened;

pub use command::{Command, Refusal};
pub use edits::HAND;
use line::scene;
pub use line::{Kind, Line};

/// A change that can be taken back.
struct Undo {
    what: String,
    before: Scenario,
    /// The line that went on before, if the change made a branch.
    from: Option<u32>,
}

/// What becomes of plug-ins that are programs of this machine: libraries, FMUs, and whatever is started.
///
/// A page can load any file that lies beside the scenario, so who starts the studio says what may run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Native {
    /// None is started.
    Refused,
    /// Each runs in a process of its own.
    Apart,
    /// Libraries run in this process.
    Here,
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
    batch: Option<Opened>,
    hashes: plugins::Hashes,
    native: Native,
    saved: Option<String>,
    notice: Option<String>,
    /// Whether time runs.
    pub is_playing: bool,
    /// Seconds of the run per second, or none for as fast as can be.
    pub speed: Option<f64>,
}

/// A name of a file without a way in it.
pub(crate) fn is_plain(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (1..=64).contains(&name.len()) && name.chars().all(allowed)
}

/// Names of the plain files of a folder that `of` makes names from, in order.
fn files(folder: &Path, of: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| {
            let entry = entry.ok()?;
            // Not what leads elsewhere.
            entry.file_type().ok()?.is_file().then_some(())?;
            of(&entry.file_name().into_string().ok()?)
        })
        .collect();
    names.sort();
    names
}

impl Studio {
    /// Opens a scenario or a recording.
    ///
    /// # Errors
    /// It cannot be read or built.
    pub fn open(file: &Path, overrides: &Overrides, native: Native) -> Result<Studio, Refusal> {
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
            batch: None,
            hashes: plugins::Hashes::default(),
            native,
            saved: None,
            notice: None,
            is_playing: false,
            speed: Some(1.0),
        };
        studio.read(file)?;
        Ok(studio)
    }

    fn read(&mut self, file: &Path) -> Result<(), Refusal> {
        if let Some(folder) = batch::folder_of(file) {
            let opened = Opened::read(folder)?;
            // Its first trial is there to be seen, and the folder's own scenario to go back to.
            self.read(&folder.join("scenario.toml"))?;
            self.batch = Some(opened);
            return self.replay("", 0);
        }
        self.batch = None;
        let ending = file.extension().and_then(|ending| ending.to_str());
        let recording = match ending {
            Some("mcap" | "parquet") => Some(Recording::read(file).map_err(|error| {
                Refusal::new(error.to_string(), error.hint().unwrap_or_default())
            })?),
            _ => None,
        };
        let loaded = match &recording {
            None => scenario::load(file, &self.overrides)?,
            Some(recording) => choice::of_recording(recording, file)?,
        };
        if is_crowd(&loaded.scenario) {
            return Err(Refusal::new(
                "must have robots of count = 1 to be driven here",
                "give --set robot.NAME.count=1, or open its recording with `appell plot`",
            ));
        }
        let loaded = Loaded {
            trust_native: self.native == Native::Here,
            ..loaded
        };
        let planned = (loaded.scenario.swap.clone(), loaded.scenario.change.clone());
        let name = "A".to_owned();
        let line = match recording {
            None => self.begin(loaded, name, "as opened".to_owned(), Kind::Driven)?,
            Some(recording) => self.recorded(&recording, loaded, name),
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

    /// A line that was recorded.
    fn recorded(&mut self, recording: &Recording, loaded: Loaded, name: String) -> Line {
        let summary = recording.summary.clone();
        Line {
            id: self.new_id(),
            name,
            what: "recorded".to_owned(),
            kind: Kind::Recorded,
            parent: None,
            scene: scene(&loaded, &History::new(&recording.header)),
            history: Arc::new(Mutex::new(History::of(recording))),
            session: None,
            summary: summary.and_then(|summary| serde_json::from_value(summary).ok()),
            loaded,
        }
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

    /// Refuses plug-ins that may not run.
    fn admit(&self, scenario: &Scenario) -> Result<(), Refusal> {
        if self.native != Native::Refused {
            return Ok(());
        }
        for robot in &scenario.robot {
            for (name, plugin) in robot.plugins() {
                if plugins::is_native(&plugin.file) {
                    let (robot, file) = (&robot.name, &plugin.file);
                    return Err(Refusal::new(
                        format!(
                            "{name} of robot {robot} is a program of this machine, {file:?}, which the studio may not run"
                        ),
                        "if you trust it, start the studio with --allow-native",
                    ));
                }
            }
        }
        Ok(())
    }

    /// A line at its first instant.
    fn begin(
        &mut self,
        loaded: Loaded,
        name: String,
        what: String,
        kind: Kind,
    ) -> Result<Line, Refusal> {
        self.admit(&loaded.scenario)?;
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
                self.drive_anew(document.scenario, edited, words.join(", "), gesture)?;
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
                let what = format!("beacon {name} placed");
                self.drive_anew(document.scenario, edited, what, None)?;
            }
            Command::RemoveBeacon { name } => {
                let document = self.active().document()?;
                let mut scenario = document.scenario.clone();
                scenario.arena.beacon.retain(|beacon| beacon.name != name);
                let edited = self.reload(&scenario, &[])?;
                let what = format!("beacon {name} removed");
                self.drive_anew(document.scenario, edited, what, None)?;
            }
            Command::Engage { robot, with, at } => self.engage(&robot, &with, at)?,
            Command::Load { robot, file } => self.load(&robot, &file)?,
            Command::Reload { robot, name, at } => self.take_anew(&robot, &name, at)?,
            Command::Unload { robot, name } => self.unload(&robot, &name)?,
            Command::Branch { at } => {
                let before = self.active().scenario();
                let from = self.active;
                self.branch(at, "branch".to_owned())?;
                self.remember("branch".to_owned(), before, Some(from), None);
            }
            Command::Undo {} => self.step_back(false)?,
            Command::Redo {} => self.step_back(true)?,
            Command::Ghost { level, on } => {
                if on {
                    self.add_ghost(level)?;
                }
                self.ghosts.retain(|known| *known != level);
                if on {
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
                if let Some(Kind::Ghost(level)) = self.place(line).map(|k| self.lines[k].kind) {
                    self.ghosts.retain(|known| *known != level);
                }
                self.lines.retain(|one| one.id != line);
            }
            Command::Platform { robot, file } => self.take_platform(&robot, &file)?,
            Command::Task { robot, kind, of } => {
                self.take_task(&robot, kind.as_deref(), of.as_deref())?;
            }
            Command::Beside { recording } => self.lay_beside(&recording)?,
            Command::Trial { variant, trial } => self.replay(&variant, trial)?,
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

    fn folder(&self) -> &Path {
        match self.file.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        }
    }

    /// Scenarios beside the one that was opened, without their extension.
    pub fn scenarios(&self) -> Vec<String> {
        files(self.folder(), |name| {
            name.strip_suffix(".toml").map(str::to_owned)
        })
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

    /// Writes the recording of a line, in the format that the file's extension names.
    ///
    /// # Errors
    /// There is no such line, or the file cannot be written.
    pub fn write_recording(&self, line: u32, file: &Path) -> Result<Value, Refusal> {
        let line = self.lines.iter().find(|one| one.id == line);
        let line = line.ok_or_else(|| Refusal::new("there is no such line", ""))?;
        line.write_recording(file)
            .map(|()| Value::Null)
            .map_err(|error| Refusal::new(error.to_string(), ""))
    }

    /// The figures of the batch that is open, as JSON.
    pub fn batch(&self) -> Option<Arc<str>> {
        self.batch.as_ref().map(|opened| opened.text.clone())
    }

    /// Files that can be chosen or loaded, as JSON.
    pub fn files(&self) -> Value {
        json!([self.scenarios(), self.plugin_files(), self.choices()])
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
            "batch": self.batch.is_some(),
            "plugins": self.plugins(),
            "found": self.choices(),
        })
    }
}
