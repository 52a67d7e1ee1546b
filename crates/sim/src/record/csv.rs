//! CSV: a line of names, then one line per row; nothing else, so that any program reads it.

use std::fs::File;
use std::path::Path;

use super::outlet::{Outlet, Sink};
use super::{
    Closing, Event, Header, RecordError, Recorder, Recording, Stage, check_begin, check_event,
    check_row,
};
use crate::signal::Signal;

/// Bytes gathered before they are written.
const BLOCK: usize = 64 << 10;

/// Writes `t,<path>…` and the rows as shortest decimals that round-trip.
///
/// Units, header, events and summary are not written.
pub struct Csv<W: Sink = File> {
    outlet: Outlet<W>,
    stage: Stage,
    signals: usize,
}

impl Csv {
    /// A recorder that writes `path`.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        Ok(Self {
            outlet: Outlet::create(path)?,
            stage: Stage::Created,
            signals: 0,
        })
    }
}

impl<W: Sink> Csv<W> {
    /// A recorder that writes to `sink`, called `name` in messages.
    pub fn new(sink: W, name: &Path) -> Self {
        Self {
            outlet: Outlet::new(sink, name),
            stage: Stage::Created,
            signals: 0,
        }
    }

    /// The sink, with what it has taken so far.
    pub fn into_sink(self) -> W {
        self.outlet.sink
    }
}

impl<W: Sink> Recorder for Csv<W> {
    fn begin(&mut self, header: &Header) -> Result<(), RecordError> {
        check_begin(self.stage, header).map_err(|reason| self.outlet.refused(reason))?;
        self.stage = Stage::Open;
        self.signals = header.signals.len();
        let line = &mut self.outlet.pending;
        line.push(b't');
        for Signal { path, .. } in &header.signals {
            line.push(b',');
            if path.contains([',', '"', '\n', '\r']) {
                line.extend_from_slice(format!("\"{}\"", path.replace('"', "\"\"")).as_bytes());
            } else {
                line.extend_from_slice(path.as_bytes());
            }
        }
        line.push(b'\n');
        self.outlet.drain()
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        check_row(self.stage, t, row, self.signals)
            .map_err(|reason| self.outlet.refused(reason))?;
        if self.outlet.pending.len() >= BLOCK {
            self.outlet.drain()?;
        }
        let mut decimal = zmij::Buffer::new();
        let line = &mut self.outlet.pending;
        line.extend_from_slice(decimal.format(t).as_bytes());
        for value in row {
            line.push(b',');
            line.extend_from_slice(decimal.format(*value).as_bytes());
        }
        line.push(b'\n');
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        check_event(self.stage, event).map_err(|reason| self.outlet.refused(reason))
    }

    fn finish(&mut self, _summary: Closing<'_>) -> Result<(), RecordError> {
        self.stage = Stage::Finished;
        self.outlet.close()
    }
}

/// Reads a CSV of numbers whose first column is the time.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Recording, RecordError> {
    let corrupt = |reason: String| RecordError::corrupt(path, reason);
    let text = std::str::from_utf8(bytes).map_err(|_| corrupt("not UTF-8 text".to_owned()))?;
    let (names, body) = names(text).ok_or_else(|| corrupt("line 1 has no end".to_owned()))?;
    let mut names = names.into_iter();
    if names.next().as_deref() != Some("t") {
        return Err(corrupt("the first column must be t".to_owned()));
    }
    let signals: Vec<Signal> = names.map(|path| Signal::new(path, "")).collect();
    let mut recording = Recording {
        columns: vec![Vec::new(); signals.len()],
        header: Header {
            signals,
            ..Header::default()
        },
        complete: body.is_empty() || body.ends_with('\n'),
        ..Recording::default()
    };
    // The rows follow the names; a quoted name may hold line ends, so lines are counted from here.
    let whole = body.rfind('\n').map_or("", |end| &body[..end]);
    for (index, line) in whole.lines().enumerate() {
        let row = row(line, recording.columns.len())
            .map_err(|reason| corrupt(format!("row {}: {reason}", index + 1)))?;
        recording.times.push(row[0]);
        for (column, value) in recording.columns.iter_mut().zip(&row[1..]) {
            column.push(*value);
        }
    }
    Ok(recording)
}

/// The fields of the first line, and the text after it.
fn names(text: &str) -> Option<(Vec<String>, &str)> {
    let mut names = vec![String::new()];
    let mut quoted = false;
    let mut letters = text.char_indices().peekable();
    while let Some((at, letter)) = letters.next() {
        let name = names
            .last_mut()
            .expect("names starts with one name and only grows");
        match letter {
            '"' if quoted && letters.next_if(|(_, next)| *next == '"').is_some() => name.push('"'),
            '"' => quoted = !quoted,
            ',' if !quoted => names.push(String::new()),
            '\n' if !quoted => {
                if name.ends_with('\r') {
                    name.pop();
                }
                return Some((names, &text[at + 1..]));
            }
            other => name.push(other),
        }
    }
    None
}

/// The time and values of one line.
fn row(line: &str, signals: usize) -> Result<Vec<f64>, String> {
    let row = line
        .split(',')
        .map(|field| {
            field
                .trim()
                .parse()
                .map_err(|_| format!("must be numbers, got {:.40}", field))
        })
        .collect::<Result<Vec<f64>, String>>()?;
    if row.len() == signals + 1 {
        Ok(row)
    } else {
        Err(format!(
            "must have {} fields, got {}",
            signals + 1,
            row.len()
        ))
    }
}
