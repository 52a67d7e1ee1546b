//! What pages and the studio say to each other, whatever carries it: a socket, or a worker beside the page.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use appell_model::wheel_legged::obstacle::Obstacle;
use appell_sim::crossing::{Build, cross, drawing};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::history::{History, Series};
use crate::studio::{Command, Refusal, Studio};
use crate::wire;

/// Widest picture of series, points, and most signals in it.
const POINTS_MAX: usize = 8192;
const SIGNALS_MAX: usize = 64;
/// Longest obstacle that is asked about, m.
const LENGTH_MAX: f64 = 10.0;

/// A message to a page.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// JSON.
    Text(String),
    /// A frame of [`wire`].
    Binary(Vec<u8>),
}

/// What pages see of a line.
#[derive(Clone)]
pub struct Seen {
    /// Number.
    pub id: u32,
    /// What it is drawn from, as JSON.
    pub scene: Arc<str>,
    /// What it has driven.
    pub history: Arc<Mutex<History>>,
}

/// What pages see.
#[derive(Clone)]
pub struct View {
    /// Lines.
    pub lines: Vec<Seen>,
    /// What else there is, as JSON.
    pub state: Arc<str>,
    /// The figures of a batch, as JSON.
    pub batch: Option<Arc<str>>,
}

impl View {
    /// That of a studio as it is.
    pub fn of(studio: &Studio) -> View {
        let seen = studio.lines().iter().map(|line| Seen {
            id: line.id,
            scene: line.scene.clone(),
            history: line.history.clone(),
        });
        View {
            lines: seen.collect(),
            state: studio.state().to_string().into(),
            batch: studio.batch(),
        }
    }
}

/// What one page has been told.
#[derive(Default)]
pub struct Told {
    rows: BTreeMap<u32, usize>,
    state: Option<Arc<str>>,
}

impl Told {
    /// What the page has not seen yet: scenes of new lines, the state, and rows.
    pub fn news(&mut self, view: &View) -> Vec<Message> {
        let mut messages = Vec::new();
        for line in &view.lines {
            if !self.rows.contains_key(&line.id) {
                messages.push(Message::Text(format!(
                    "{{\"kind\":\"line\",\"id\":{},\"scene\":{}}}",
                    line.id, line.scene
                )));
            }
        }
        let told = self.state.as_ref();
        if told.is_none_or(|told| !Arc::ptr_eq(told, &view.state)) {
            messages.push(Message::Text(view.state.to_string()));
            self.state = Some(view.state.clone());
        }
        self.rows
            .retain(|id, _| view.lines.iter().any(|line| line.id == *id));
        for line in &view.lines {
            let history = line.history.lock().expect("nothing panics with it");
            let sent = self.rows.entry(line.id).or_insert(0);
            if history.rows() > *sent {
                messages.push(Message::Binary(wire::rows(line.id, &history, *sent)));
                *sent = history.rows();
            }
        }
        messages
    }
}

/// A request for series.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeriesRequest {
    line: u32,
    /// Paths; in an address separated by commas.
    signals: Paths,
    from: f64,
    to: f64,
    points: usize,
    /// Whether amplitudes by frequency are asked for, instead of values by time.
    #[serde(default)]
    spectrum: bool,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum Paths {
    List(Vec<String>),
    Text(String),
}

impl SeriesRequest {
    /// The series.
    ///
    /// # Errors
    /// There is no such line, or more is asked for than is given at once.
    pub fn find(&self, view: &View) -> Result<Series, Refusal> {
        let paths = match &self.signals {
            Paths::List(paths) => paths.clone(),
            Paths::Text(text) => text.split(',').map(str::to_owned).collect(),
        };
        if paths.len() > SIGNALS_MAX || !(1..=POINTS_MAX).contains(&self.points) {
            return Err(Refusal::new(
                format!("must be at most {SIGNALS_MAX} signals and 1 to {POINTS_MAX} points"),
                "",
            ));
        }
        if !(self.from.is_finite() && self.to.is_finite()) {
            return Err(Refusal::new("from and to must be finite times, s", ""));
        }
        let line = view.lines.iter().find(|line| line.id == self.line);
        let line =
            line.ok_or_else(|| Refusal::new(format!("there is no line {}", self.line), ""))?;
        let history = line.history.lock().expect("nothing panics with it");
        Ok(match self.spectrum {
            false => history.series(&paths, self.from, self.to, self.points),
            true => history.spectrum(&paths, self.from, self.to, self.points),
        })
    }

    /// Series as CSV, in full where points are enough.
    ///
    /// # Errors
    /// As [`SeriesRequest::find`].
    pub fn table(&self, view: &View) -> Result<String, Refusal> {
        let series = self.find(view)?;
        let mut text = String::from(if self.spectrum { "frequency" } else { "t" });
        text.push(',');
        match &self.signals {
            Paths::List(paths) => text.push_str(&paths.join(",")),
            Paths::Text(paths) => text.push_str(paths),
        }
        for (k, t) in series.times.iter().enumerate() {
            text.push_str(&format!("\n{t}"));
            for column in &series.columns {
                text.push_str(&format!(",{}", column[k]));
            }
        }
        text.push('\n');
        Ok(text)
    }
}

/// What a page says.
#[derive(Deserialize)]
#[serde(untagged)]
pub enum Said {
    /// It asks for series, under a number of its own.
    Series {
        /// Its number.
        series: u32,
        /// What it asks for.
        #[serde(flatten)]
        asked: SeriesRequest,
    },
    /// It wants something done, under a number of its own.
    Command {
        /// Its number.
        id: u32,
        /// What it wants.
        #[serde(flatten)]
        command: Box<Command>,
    },
}

impl Said {
    /// What a page says.
    ///
    /// # Errors
    /// It is none of this: the answer that says so.
    pub fn read(text: &str) -> Result<Said, Message> {
        serde_json::from_str(text).map_err(|error| {
            let id = serde_json::from_str::<Value>(text).ok();
            let id = id.and_then(|said| said["id"].as_u64());
            let refusal = Refusal::new(
                format!("is no command: {error}"),
                "the book lists the commands",
            );
            no(id.and_then(|id| u32::try_from(id).ok()), &refusal)
        })
    }
}

/// The answer to a request for series.
pub fn series(number: u32, asked: &SeriesRequest, view: &View) -> Message {
    match asked.find(view) {
        Ok(found) => Message::Binary(wire::series(number, asked.line, &found)),
        Err(refusal) => no(None, &refusal),
    }
}

/// The answer to a command.
pub fn answer(id: u32, done: Result<Value, Refusal>) -> Message {
    match done {
        Ok(value) => Message::Text(json!({"kind": "done", "re": id, "value": value}).to_string()),
        Err(refusal) => no(Some(id), &refusal),
    }
}

fn no(id: Option<u32>, refusal: &Refusal) -> Message {
    Message::Text(json!({"kind": "refused", "re": id, "error": refusal}).to_string())
}

/// An obstacle: a step, or a trench with its width, m.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obstructed {
    height: f64,
    width: Option<f64>,
}

impl Obstructed {
    /// What a wheel-legged robot does about it, instant by instant.
    ///
    /// # Errors
    /// A length is out of its range.
    pub fn crossed(&self) -> Result<Value, Refusal> {
        let lengths = [self.height, self.width.unwrap_or(0.0)];
        let is_within = |length: &f64| (0.0..=LENGTH_MAX).contains(length);
        if !lengths.iter().all(is_within) {
            let problem = format!("height and width must be in [0, {LENGTH_MAX}] m");
            return Err(Refusal::new(problem, ""));
        }
        let obstacle = match self.width {
            None => Obstacle::Step {
                height: self.height,
            },
            Some(width) => Obstacle::Trench {
                width,
                depth: self.height,
            },
        };
        let build = Build::ASSUMED;
        Ok(drawing(&obstacle, &build, &cross(&obstacle, &build)))
    }
}
