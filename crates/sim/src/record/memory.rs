//! A recorder that keeps the rows in memory.

use std::path::Path;

use super::{
    Closing, Event, Header, RecordError, Recorder, Recording, Stage, check_begin, check_event,
    check_row,
};

/// Keeps the rows; [`Memory::into_recording`] gives them as columns.
#[derive(Debug)]
pub struct Memory {
    recording: Recording,
    /// Row after row: one cache line is written per step, not one per column.
    rows: Vec<f64>,
    stage: Stage,
    /// Most rows that are kept.
    limit: usize,
    /// Of how many frames one is kept; doubles whenever the limit is reached.
    stride: u64,
    frames: u64,
    /// Length of a row that is given.
    width: usize,
    /// Most robots that are kept, and the columns of those.
    robots: usize,
    columns: Option<Vec<usize>>,
}

impl Memory {
    /// An empty recorder.
    pub fn new() -> Self {
        Self {
            recording: Recording::default(),
            rows: Vec::new(),
            stage: Stage::Created,
            limit: usize::MAX,
            stride: 1,
            frames: 0,
            width: 0,
            robots: usize::MAX,
            columns: None,
        }
    }

    /// A recorder that keeps at most `limit` rows, evenly spread over the run, and the last one.
    pub fn bounded(limit: usize) -> Self {
        Self {
            limit: limit.max(2),
            ..Self::new()
        }
    }

    /// The same of at most so many robots, evenly chosen from all.
    pub fn excerpt(limit: usize, robots: usize) -> Self {
        Self {
            robots,
            ..Self::bounded(limit)
        }
    }

    /// Leaves robots out of the header where there are too many, and their columns.
    fn choose(&mut self) {
        let header = &mut self.recording.header;
        let robots = header.extra.get_mut("robots");
        let Some(robots) = robots.and_then(serde_json::Value::as_array_mut) else {
            return;
        };
        let all = robots.len();
        if all <= self.robots {
            return;
        }
        let chosen: Vec<usize> = (0..self.robots).map(|k| k * all / self.robots).collect();
        *robots = chosen.iter().map(|&k| robots[k].clone()).collect();
        let names: Vec<&str> = robots.iter().filter_map(|r| r["name"].as_str()).collect();
        let is_kept = |path: &str| {
            let of = path
                .strip_prefix("robot.")
                .and_then(|p| p.split('.').next());
            of.is_none_or(|of| names.contains(&of))
        };
        let columns: Vec<usize> = (0..header.signals.len())
            .filter(|&k| is_kept(&header.signals[k].path))
            .collect();
        header.signals = columns.iter().map(|&k| header.signals[k].clone()).collect();
        header.extra["crowd"] = all.into();
        self.columns = Some(columns);
    }

    /// Drops every other row.
    fn thin(&mut self) {
        let width = self.recording.header.signals.len();
        let kept = self.recording.times.len().div_ceil(2);
        for k in 1..kept {
            self.recording.times[k] = self.recording.times[2 * k];
            self.rows
                .copy_within(2 * k * width..(2 * k + 1) * width, k * width);
        }
        self.recording.times.truncate(kept);
        self.rows.truncate(kept * width);
        self.stride *= 2;
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
        self.width = header.signals.len();
        self.choose();
        self.stage = Stage::Open;
        Ok(())
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        check_row(self.stage, t, row, self.width).map_err(refused)?;
        let width = self.recording.header.signals.len();
        // The newest row always stands at the end; it stays if its turn has come.
        if self.frames > 0 && !(self.frames - 1).is_multiple_of(self.stride) {
            self.recording.times.pop();
            self.rows.truncate(self.rows.len() - width);
        }
        if self.recording.times.len() >= self.limit {
            self.thin();
        }
        self.recording.times.push(t);
        match &self.columns {
            Some(columns) => self.rows.extend(columns.iter().map(|&k| row[k])),
            None => self.rows.extend_from_slice(row),
        }
        self.frames += 1;
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        check_event(self.stage, event).map_err(refused)?;
        if self.columns.is_some() {
            let robots = self.recording.header.extra["robots"].as_array();
            let known = |robot: &serde_json::Value| robot["name"] == *event.robot;
            if !event.robot.is_empty() && !robots.is_some_and(|all| all.iter().any(known)) {
                return Ok(());
            }
        }
        self.recording.events.push(event.clone());
        Ok(())
    }

    fn finish(&mut self, summary: Closing<'_>) -> Result<(), RecordError> {
        self.recording.summary = Some(summary());
        self.recording.complete = true;
        self.stage = Stage::Finished;
        Ok(())
    }
}
