//! Recordings: the rows, events and header of a run, written to MCAP, CSV, Parquet or memory.
//!
//! A [`Recorder`] takes the run as it happens: [`Recorder::begin`], then frames and events in the
//! order of time, then [`Recorder::finish`]. A [`Recording`] is a run read back.
//!
//! | format | floats | header, units, events, summary | after `kill -9` |
//! | --- | --- | --- | --- |
//! | [`Mcap`] | bit-exact | kept | readable up to the last chunk, at most 0.25 s are lost |
//! | [`Csv`] | shortest round-trip decimals; the sign and payload of NaN are lost | dropped | readable up to the last 64 KiB |
//! | [`Parquet`] | bit-exact | kept | unreadable: the index is at the end of the file |
//! | [`Memory`] | bit-exact | kept | gone |
//!
//! The same rows give the same bytes: no clock, no random number, no host name enters a file.

mod compression;
mod container;
mod csv;
mod error;
mod mcap;
mod memory;
mod outlet;
mod parquet;
mod protobuf;
pub mod rosbag;
#[cfg(test)]
mod tests;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer, Serialize};

use crate::signal::Signal;

pub use csv::Csv;
pub use error::RecordError;
pub use mcap::Mcap;
pub use memory::Memory;
pub use outlet::Sink;
pub use parquet::Parquet;
pub use rosbag::Rosbag;

/// What a run leaves in its folder besides its scenario.
const LEFT: [&str; 9] = [
    "summary.json",
    "report.html",
    "trajectory.svg",
    "trajectory.png",
    "recording.mcap",
    "recording.csv",
    "recording.parquet",
    "ros2/metadata.yaml",
    "ros2/ros2_0.mcap",
];

/// Takes away what an earlier run left in a folder, which is not to be taken for the next one's.
///
/// # Errors
/// A file that cannot be removed, and why.
pub fn clear(folder: &Path) -> Result<(), (PathBuf, std::io::Error)> {
    for name in LEFT {
        let path = folder.join(name);
        if path.exists()
            && let Err(error) = std::fs::remove_file(&path)
        {
            return Err((path, error));
        }
    }
    Ok(())
}

/// Most signals one file holds.
const SIGNALS_MAX: usize = 1 << 16;

/// Largest text of one event, bytes.
const EVENT_BYTES_MAX: usize = 1 << 20;

/// What was run, and what each column means.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Name of the scenario.
    pub scenario: String,
    /// The resolved scenario, TOML.
    #[serde(default)]
    pub scenario_text: String,
    /// Hash of the resolved scenario, and of the plug-ins that it names.
    pub hash: String,
    /// Seed of the run.
    pub seed: u64,
    /// Version of the program.
    pub version: String,
    /// Step of the simulation, s.
    pub step: f64,
    /// Time between two frames, s.
    pub period: f64,
    /// One signal per column, in the order of the rows.
    pub signals: Vec<Signal>,
    /// Drawing data for reports.
    pub extra: serde_json::Value,
}

/// Something that happened at one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Time of the simulation, s.
    pub t: f64,
    /// Name of the robot, empty for the world.
    pub robot: String,
    /// Kind, one word: `collision`, `goal`.
    pub kind: String,
    /// A sentence for people.
    pub text: String,
    /// Place in the world frame, m. Files keep coordinates that are not finite as NaN.
    #[serde(default, deserialize_with = "position")]
    pub position: Option<[f64; 2]>,
}

/// Reads coordinates; JSON writes those that are not finite as `null`.
fn position<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f64; 2]>, D::Error> {
    let position = Option::<[Option<f64>; 2]>::deserialize(deserializer)?;
    Ok(position.map(|place| place.map(|coordinate| coordinate.unwrap_or(f64::NAN))))
}

/// Takes a run as it happens.
///
/// When a call fails because of the file (disk full), nothing of that call's row or event was
/// taken and nothing earlier was lost: once there is room, the same call goes on from there.
pub trait Recorder: Send {
    /// Opens the recording; called once, before anything else.
    ///
    /// # Errors
    /// The header cannot be recorded (two signals of one path), or the file cannot be written.
    fn begin(&mut self, header: &Header) -> Result<(), RecordError>;

    /// Records the values at time `t` (s), one per signal of the header.
    ///
    /// # Errors
    /// `t` is negative or not finite, the row has the wrong length, or writing failed.
    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError>;

    /// Records an event.
    ///
    /// # Errors
    /// The time is negative or not finite, the text is above 1 MiB, or writing failed.
    fn event(&mut self, event: &Event) -> Result<(), RecordError>;

    /// Closes the recording with its summary and waits until the disk has it.
    ///
    /// # Errors
    /// Writing failed.
    fn finish(&mut self, summary: Closing<'_>) -> Result<(), RecordError>;
}

/// What became of a run: put into data by those that write it, for of many robots it is long.
pub type Closing<'a> = &'a dyn Fn() -> serde_json::Value;

/// Takes a run and keeps nothing.
#[derive(Clone, Copy, Debug)]
pub struct Nothing;

impl Recorder for Nothing {
    fn begin(&mut self, _header: &Header) -> Result<(), RecordError> {
        Ok(())
    }
    fn frame(&mut self, _t: f64, _row: &[f64]) -> Result<(), RecordError> {
        Ok(())
    }
    fn event(&mut self, _event: &Event) -> Result<(), RecordError> {
        Ok(())
    }
    fn finish(&mut self, _summary: Closing<'_>) -> Result<(), RecordError> {
        Ok(())
    }
}

/// Writes to several recorders.
pub struct Fan {
    /// Recorders of files.
    pub files: Vec<Box<dyn Recorder>>,
    /// What the report is drawn from.
    pub memory: Option<Memory>,
}

impl Fan {
    fn each(
        &mut self,
        mut act: impl FnMut(&mut dyn Recorder) -> Result<(), RecordError>,
    ) -> Result<(), RecordError> {
        for file in &mut self.files {
            act(file.as_mut())?;
        }
        self.memory.as_mut().map_or(Ok(()), |memory| act(memory))
    }
}

impl Recorder for Fan {
    fn begin(&mut self, header: &Header) -> Result<(), RecordError> {
        self.each(|recorder| recorder.begin(header))
    }
    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        self.each(|recorder| recorder.frame(t, row))
    }
    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.each(|recorder| recorder.event(event))
    }
    fn finish(&mut self, summary: Closing<'_>) -> Result<(), RecordError> {
        self.each(|recorder| recorder.finish(summary))
    }
}

/// A recorder that writes `path`, in the format that its extension names.
///
/// # Errors
/// The extension is not `mcap`, `csv` or `parquet`, or the file cannot be created.
pub fn create(path: &Path) -> Result<Box<dyn Recorder>, RecordError> {
    Ok(match Format::of(path)? {
        Format::Mcap => Box::new(Mcap::create(path)?),
        Format::Csv => Box::new(Csv::create(path)?),
        Format::Parquet => Box::new(Parquet::create(path)?),
    })
}

/// A run read back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// What was run; of a CSV only the paths of the signals.
    pub header: Header,
    /// Time of each row, s.
    pub times: Vec<f64>,
    /// One column per signal of the header, each as long as `times`.
    pub columns: Vec<Vec<f64>>,
    /// Events in the order they were recorded.
    pub events: Vec<Event>,
    /// Summary, once the run was finished.
    pub summary: Option<serde_json::Value>,
    /// Whether the file was closed in order; otherwise its end is missing.
    pub complete: bool,
}

impl Recording {
    /// Reads a file, in the format that its extension names.
    ///
    /// An MCAP whose writer was killed gives all rows up to its last whole chunk, with `complete`
    /// false; so does a CSV without its last line's end.
    ///
    /// # Errors
    /// The file cannot be read, or it was closed in order and has been altered since.
    pub fn read(path: &Path) -> Result<Self, RecordError> {
        let format = Format::of(path)?;
        let bytes = std::fs::read(path).map_err(|source| RecordError::io(path, source))?;
        match format {
            Format::Mcap => mcap::read(path, &bytes),
            Format::Csv => csv::read(path, &bytes),
            Format::Parquet => parquet::read(path, bytes),
        }
    }

    /// The values of the signal called `path`.
    pub fn column(&self, path: &str) -> Option<&[f64]> {
        let index = self
            .header
            .signals
            .iter()
            .position(|signal| signal.path == path)?;
        self.columns.get(index).map(Vec::as_slice)
    }
}

/// The formats of files.
#[derive(Clone, Copy)]
enum Format {
    Mcap,
    Csv,
    Parquet,
}

impl Format {
    fn of(path: &Path) -> Result<Self, RecordError> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("mcap") => Ok(Self::Mcap),
            Some("csv") => Ok(Self::Csv),
            Some("parquet") => Ok(Self::Parquet),
            Some(_) | None => Err(RecordError::Extension {
                path: path.to_owned(),
            }),
        }
    }
}

/// Where a recorder is between its first and its last call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Created,
    Open,
    Finished,
}

/// The rules that all formats share; a reason when one is broken.
fn check_signals(signals: &[Signal]) -> Result<(), String> {
    if signals.len() > SIGNALS_MAX {
        return Err(format!(
            "at most {SIGNALS_MAX} signals fit in a file, got {}",
            signals.len()
        ));
    }
    let mut seen = HashSet::from(["t"]);
    for Signal { path, .. } in signals {
        if path.is_empty() {
            return Err("the path of a signal must not be empty".to_owned());
        }
        if !seen.insert(path) {
            return Err(format!(
                "signal {path}: paths must differ from each other and from t"
            ));
        }
    }
    Ok(())
}

/// A frame must come after `begin`, before `finish`, with one value per signal.
fn check_row(stage: Stage, t: f64, row: &[f64], signals: usize) -> Result<(), String> {
    check_open(stage, t)?;
    if row.len() == signals {
        Ok(())
    } else {
        Err(format!(
            "a row must have {signals} values, got {}",
            row.len()
        ))
    }
}

/// An event must come after `begin`, before `finish`, and be of bounded size.
fn check_event(stage: Stage, event: &Event) -> Result<(), String> {
    check_open(stage, event.t)?;
    let size = event.robot.len() + event.kind.len() + event.text.len();
    if size <= EVENT_BYTES_MAX {
        Ok(())
    } else {
        Err(format!(
            "an event must be at most {EVENT_BYTES_MAX} bytes, got {size}"
        ))
    }
}

/// The recorder is open, and nanoseconds since 0 fit in 63 bits.
fn check_open(stage: Stage, t: f64) -> Result<(), String> {
    if stage != Stage::Open {
        return Err(format!("the recorder must be open, it is {stage:?}").to_lowercase());
    }
    if (0.0..9.0e9).contains(&t) {
        Ok(())
    } else {
        Err(format!("time must be in 0..9e9 s, got {t}"))
    }
}

/// A recorder opens once.
fn check_begin(stage: Stage, header: &Header) -> Result<(), String> {
    if stage != Stage::Created {
        return Err("begin must be called once".to_owned());
    }
    // JSON has no other numbers.
    if !(header.step.is_finite() && header.period.is_finite()) {
        return Err(format!(
            "step {} and period {} must be finite",
            header.step, header.period
        ));
    }
    check_signals(&header.signals)
}
