//! Batches: many trials of one scenario, each with random numbers of its own.
//!
//! A trial is a run of the scenario with its own number as the key of all random streams, and with
//! the values that the scenario varies drawn for it. Its row holds verdict, drawn values and every
//! figure of its summary. Rows are stored in parts of [`PART`] trials; a part is the same bytes
//! whatever the number of threads, and a batch that was broken off goes on with those it lacks.

mod draw;
mod figures;
mod part;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::record::{Event, Header, RecordError, Recorder};
use crate::run::{Outcome, Run, Summary, hash};
use crate::scenario::{self, Diagnostics, Loaded, Overrides, Vary};

pub use draw::{parse, refuse};
pub use figures::{BatchSummary, Figure, Success, report};

/// Trials of a part.
pub const PART: u64 = 256;
/// First trials, whose figures name the columns.
const PROBES: u64 = 8;

/// A column of a batch: a figure of the summary, or a value that is drawn.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Column {
    /// Name, unique.
    pub name: String,
    /// Unit; empty for pure numbers, and for drawn values, whose unit is that of the key.
    pub unit: String,
    /// What it belongs to: a robot, a table of statistics, or `drawn`.
    pub group: String,
}

/// What became of a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Number of the trial.
    pub trial: u64,
    /// `passed`, `failed`, `stopped`; or `invalid` where the drawn values make no scenario.
    pub verdict: String,
    /// One sentence.
    pub reason: String,
    /// One for each column; NaN where the trial has no such figure.
    pub values: Vec<f64>,
    /// Figures that no column has, as a JSON object; mostly empty.
    pub other: String,
}

/// Group of the columns of drawn values.
pub const DRAWN: &str = "drawn";

/// A batch, ready to run.
pub struct Batch {
    file: PathBuf,
    overrides: Vec<(String, String)>,
    loaded: Loaded,
    trials: u64,
    columns: Vec<Column>,
    /// SHA-256 of all that its rows follow from.
    hash: String,
}

/// Why a batch ended.
#[derive(Debug, thiserror::Error)]
pub enum BatchError {
    /// The scenario is wrong.
    #[error("{0}")]
    Scenario(#[from] Diagnostics),
    /// The folder cannot be used.
    #[error("{path}: {problem}\n  hint: {hint}")]
    Folder {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
        /// What to do.
        hint: &'static str,
    },
}

/// Takes a run and keeps nothing.
struct Nothing;

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
    fn finish(&mut self, _summary: &serde_json::Value) -> Result<(), RecordError> {
        Ok(())
    }
}

impl Batch {
    /// A batch of a scenario under overrides. The scenario says how many trials, unless `trials`
    /// does, and what varies, beside what `vary` adds.
    ///
    /// # Errors
    /// The scenario is wrong, or the first trial cannot be built.
    pub fn new(
        file: &Path,
        overrides: &Overrides,
        trials: Option<u64>,
        vary: &[Vary],
    ) -> Result<Batch, BatchError> {
        let mut loaded = scenario::load(file, overrides)?;
        let mut plan = loaded.scenario.batch.take().unwrap_or_default();
        plan.trials = trials.unwrap_or(plan.trials);
        plan.vary.extend_from_slice(vary);
        loaded.scenario.batch = Some(plan.clone());
        let mut batch = Batch {
            file: file.to_owned(),
            overrides: overrides.to_vec(),
            loaded,
            trials: plan.trials,
            columns: Vec::new(),
            hash: String::new(),
        };
        let drawn = plan.vary.iter().map(|vary| Column {
            name: vary.path.clone(),
            unit: String::new(),
            group: DRAWN.into(),
        });
        batch.columns = drawn.collect();
        let probes = PROBES.min(plan.trials);
        for trial in 0..probes {
            // A first trial that cannot be built is a mistake of the scenario; others are rows.
            let summary = match batch.summary(trial) {
                Ok(summary) => summary,
                Err(problem) if trial == 0 => return Err(problem.into()),
                Err(_) => continue,
            };
            for (column, _) in figures_of(&summary) {
                if !batch.columns.iter().any(|known| known.name == column.name) {
                    batch.columns.push(column);
                }
            }
        }
        // The first rows stand for all that the text only names, such as the files it reads.
        let probed: Vec<Row> = (0..probes).map(|trial| batch.trial(trial)).collect();
        batch.hash = hash(&format!(
            "{}\n{}\n{}\n{}\n{}",
            batch.loaded.resolved,
            env!("CARGO_PKG_VERSION"),
            serde_json::to_string(&plan).expect("a plan is plain data"),
            serde_json::to_string(&batch.columns).expect("columns are plain data"),
            part::root(&[part::leaf(&probed)]),
        ));
        Ok(batch)
    }

    /// The scenario.
    pub fn loaded(&self) -> &Loaded {
        &self.loaded
    }

    /// Number of trials.
    pub fn trials(&self) -> u64 {
        self.trials
    }

    /// Columns of the rows' values: first those that are drawn.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The scenario of a trial, with what is drawn for it.
    ///
    /// # Errors
    /// What was drawn makes no scenario.
    pub fn scenario(&self, trial: u64) -> Result<Loaded, Diagnostics> {
        let drawn = self.drawn(trial);
        if drawn.is_empty() {
            return Ok(self.loaded.clone());
        }
        let mut overrides = self.overrides.clone();
        for (path, value) in drawn {
            overrides.push((path, format!("{value:?}")));
        }
        scenario::load(&self.file, &overrides)
    }

    /// Values drawn for a trial, with their paths.
    pub fn drawn(&self, trial: u64) -> Vec<(String, f64)> {
        let plan = self.loaded.scenario.batch.as_ref();
        let vary = plan.map_or(&[][..], |batch| &batch.vary);
        draw::values(vary, self.loaded.scenario.seed, trial)
    }

    fn summary(&self, trial: u64) -> Result<Summary, Diagnostics> {
        let mut run = Run::new(&self.scenario(trial)?, trial)?;
        let summary = run.execute(&mut Nothing, &mut |_| {});
        Ok(summary.expect("nothing is written that could fail"))
    }

    /// Runs one trial.
    pub fn trial(&self, trial: u64) -> Row {
        let mut row = Row {
            trial,
            verdict: "invalid".into(),
            reason: String::new(),
            values: vec![f64::NAN; self.columns.len()],
            other: String::new(),
        };
        for (k, (_, value)) in self.drawn(trial).into_iter().enumerate() {
            row.values[k] = value;
        }
        let summary = match self.summary(trial) {
            Ok(summary) => summary,
            Err(problem) => {
                row.reason = problem.to_string();
                return row;
            }
        };
        row.verdict = match summary.verdict {
            Outcome::Passed => "passed",
            Outcome::Failed => "failed",
            Outcome::Stopped => "stopped",
        }
        .into();
        let mut other = BTreeMap::new();
        for (column, value) in figures_of(&summary) {
            let place = self.columns.iter().position(|c| c.name == column.name);
            match place {
                Some(place) => row.values[place] = value,
                None => drop(other.insert(column.name, value)),
            }
        }
        if !other.is_empty() {
            row.other = serde_json::to_string(&other).expect("figures are plain data");
        }
        row.reason = summary.reason;
        row
    }

    /// Runs what a folder lacks, on `threads` threads (0: all cores), and sums it all up; `progress`
    /// is told the number of trials that are done, from any thread.
    ///
    /// # Errors
    /// The folder holds another batch, or cannot be written; what was written stays.
    pub fn execute(
        &self,
        folder: &Path,
        threads: usize,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<BatchSummary, BatchError> {
        let store = part::Store::open(folder, &self.hash, &self.columns)?;
        let parts = self.trials.div_ceil(PART);
        let range = |part: u64| part * PART..((part + 1) * PART).min(self.trials);
        let missing: Vec<u64> = (0..parts)
            .filter(|&part| store.read(part, range(part)).is_none())
            .collect();
        let lacking: u64 = missing.iter().map(|&part| range(part).count() as u64).sum();
        let done = AtomicU64::new(self.trials - lacking);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|error| BatchError::Folder {
                path: folder.to_owned(),
                problem: format!("no threads: {error}"),
                hint: "ask for fewer with --threads",
            })?;
        let broken = AtomicBool::new(false);
        let written: Result<Vec<()>, BatchError> = pool.install(|| {
            missing
                .par_iter()
                .map(|&part| {
                    let mut rows = Vec::with_capacity(PART as usize);
                    for trial in range(part) {
                        if broken.load(Ordering::Relaxed) {
                            return Ok(());
                        }
                        rows.push(self.trial(trial));
                        progress(done.fetch_add(1, Ordering::Relaxed) + 1);
                    }
                    store.write(part, &rows).inspect_err(|_| {
                        broken.store(true, Ordering::Relaxed);
                    })
                })
                .collect()
        });
        written?;
        let mut rows = Vec::with_capacity(self.trials as usize);
        let mut leaves = Vec::new();
        for part in 0..parts {
            let Some(stored) = store.read(part, range(part)) else {
                return Err(BatchError::Folder {
                    path: store.path(part),
                    problem: "cannot be read back".into(),
                    hint: "run the batch again: it goes on with what is missing",
                });
            };
            leaves.push(part::leaf(&stored));
            rows.extend(stored);
        }
        Ok(figures::sum_up(self, &rows, part::root(&leaves)))
    }

    /// Figures of the run that the scenario marks, by column name.
    ///
    /// # Errors
    /// That scenario is wrong.
    pub fn marks(&self) -> Result<BTreeMap<String, f64>, BatchError> {
        let plan = self.loaded.scenario.batch.as_ref();
        let Some(file) = plan.and_then(|batch| batch.mark.as_ref()) else {
            return Ok(BTreeMap::new());
        };
        let loaded = scenario::load(&self.loaded.folder.join(file), &[])?;
        let mut run = Run::new(&loaded, 0)?;
        let summary = run.execute(&mut Nothing, &mut |_| {});
        let summary = summary.expect("nothing is written that could fail");
        let figures = figures_of(&summary).into_iter();
        Ok(figures
            .map(|(column, value)| (column.name, value))
            .collect())
    }
}

/// Every figure of a summary with its column.
fn figures_of(summary: &Summary) -> Vec<(Column, f64)> {
    let mut figures = Vec::new();
    let several = summary.robots.len() > 1;
    for robot in &summary.robots {
        let name = |what: &str| match several {
            true => format!("{}: {what}", robot.name),
            false => what.to_owned(),
        };
        if several && robot.task != "none" {
            let column = Column {
                name: name("passed"),
                unit: String::new(),
                group: robot.name.clone(),
            };
            let passed = robot.verdict == Outcome::Passed;
            figures.push((column, f64::from(u8::from(passed))));
        }
        for metric in &robot.metrics {
            let column = Column {
                name: name(&metric.name),
                unit: metric.unit.clone(),
                group: robot.name.clone(),
            };
            figures.push((column, metric.value));
        }
    }
    for table in &summary.statistics {
        for row in &table.rows {
            for (what, value) in [("mean", row.mean), ("std", row.std)] {
                let column = Column {
                    name: format!("{}: {}, {what}", table.name, row.signal),
                    unit: row.unit.clone(),
                    group: table.name.clone(),
                };
                figures.push((column, value.unwrap_or(f64::NAN)));
            }
        }
    }
    figures
}

#[cfg(test)]
mod tests;
