//! A recorder that keeps the rows in memory.

use std::path::Path;

use super::{
    Event, Header, RecordError, Recorder, Recording, Stage, check_begin, check_event, check_row,
};

/// Keeps everything; [`Memory::into_recording`] gives it as columns.
#[derive(Debug)]
pub struct Memory {
    recording: Recording,
    /// Row after row: one cache line is written per step, not one per column.
    rows: Vec<f64>,
    stage: Stage,
}

impl Memory {
    /// An empty recorder.
    pub fn new() -> Self {
        Self {
            recording: Recording::default(),
            rows: Vec::new(),
            stage: Stage::Created,
        }
    }

    /// The rows so far.
    pub fn into_recording(mut self) -> Recording {
        let width = self.recording.header.signals.len();
        self.recording.columns = (0..width)
            .map(|index| {
                self.rows
                    .iter()
                    .skip(index)
                    .step_by(width)
                    .copied()
                    .collect()
            })
            .collect();
        self.recording
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

/// An error of a recorder that has no file.
fn refused(reason: String) -> RecordError {
    RecordError::refused(Path::new("memory"), reason)
}

impl Recorder for Memory {
    fn begin(&mut self, header: &Header) -> Result<(), RecordError> {
        check_begin(self.stage, header).map_err(refused)?;
        self.recording.header = header.clone();
        self.stage = Stage::Open;
        Ok(())
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        check_row(self.stage, t, row, self.recording.header.signals.len()).map_err(refused)?;
        self.recording.times.push(t);
        self.rows.extend_from_slice(row);
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        check_event(self.stage, event).map_err(refused)?;
        self.recording.events.push(event.clone());
        Ok(())
    }

    fn finish(&mut self, summary: &serde_json::Value) -> Result<(), RecordError> {
        self.recording.summary = Some(summary.clone());
        self.recording.complete = true;
        self.stage = Stage::Finished;
        Ok(())
    }
}
