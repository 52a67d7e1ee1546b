//! What a run that is driven from outside leaves in a folder: the same files as `appell run`.

use std::path::{Path, PathBuf};

use appell_sim::record::{self, Event, Fan, Header, Mcap, Memory, RecordError, Recorder};
use appell_sim::report;
use appell_sim::run::Summary;

/// Most rows and robots that a report is drawn from.
const ROWS_MAX: usize = 16_000;
const ROBOTS_MAX: usize = 30;

/// The recording of a run, from its begin or its last reset on.
pub struct Tape {
    folder: PathBuf,
    header: Header,
    recorder: Fan,
    /// Time of the last row, s.
    last: Option<f64>,
}

fn told(path: &Path, error: &dyn std::fmt::Display) -> String {
    format!(
        "{}: cannot be written: {error}\n  hint: choose another folder with --out, or make room",
        path.display()
    )
}

impl Tape {
    /// Begins to record into a folder, which is made.
    ///
    /// # Errors
    /// It cannot be written to.
    pub fn open(folder: &Path, header: &Header) -> Result<Tape, String> {
        std::fs::create_dir_all(folder).map_err(|error| told(folder, &error))?;
        // What an earlier run left is not to be taken for this one's.
        record::clear(folder).map_err(|(path, error)| told(&path, &error))?;
        let scenario = folder.join("scenario.toml");
        std::fs::write(&scenario, &header.scenario_text)
            .map_err(|error| told(&scenario, &error))?;
        let file = Mcap::create(&folder.join("recording.mcap"));
        let file = file.map_err(|error| error.to_string())?;
        let mut recorder = Fan {
            files: vec![Box::new(file)],
            memory: Some(Memory::excerpt(ROWS_MAX, ROBOTS_MAX)),
        };
        recorder.begin(header).map_err(|error| error.to_string())?;
        Ok(Tape {
            folder: folder.to_owned(),
            header: header.clone(),
            recorder,
            last: None,
        })
    }

    /// Forgets what was recorded, and begins again.
    ///
    /// # Errors
    /// The folder cannot be written to any more.
    pub fn rewind(&mut self) -> Result<(), String> {
        *self = Tape::open(&self.folder, &self.header)?;
        Ok(())
    }

    /// Records a row. One of a time that has a row already, as after a robot was put elsewhere, is passed over.
    pub(crate) fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        if self.last.is_some_and(|last| t <= last) {
            return Ok(());
        }
        self.last = Some(t);
        self.recorder.frame(t, row)
    }

    pub(crate) fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.recorder.event(event)
    }

    /// Closes the recording, and writes the summary, the report and the picture.
    ///
    /// # Errors
    /// The folder cannot be written to any more.
    pub fn close(mut self, summary: &Summary) -> Result<(), String> {
        let value = serde_json::to_value(summary).expect("a summary is plain data");
        self.recorder
            .finish(&|| value.clone())
            .map_err(|error| error.to_string())?;
        let text = serde_json::to_string_pretty(&value).expect("plain data") + "\n";
        let memory = self.recorder.memory.expect("recorded for the report");
        let pages = report::pages(&memory.into_recording(), summary);
        let pages = pages.map_err(|error| error.to_string())?;
        let summary = ("summary.json", text.into_bytes());
        for (name, bytes) in pages.into_iter().chain([summary]) {
            let path = self.folder.join(name);
            std::fs::write(&path, bytes).map_err(|error| told(&path, &error))?;
        }
        Ok(())
    }
}
