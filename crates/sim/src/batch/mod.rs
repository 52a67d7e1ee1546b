//! Batches: many trials of one scenario, each with random numbers of its own.
//!
//! A trial is a run of the scenario with its own number as the key of all random streams, and with
//! the values that the scenario varies drawn for it. Its row holds verdict, drawn values and every
//! figure of its summary. Rows are stored in parts of [`PART`] trials; a part is the same bytes
//! whatever the number of threads or shards, and a batch that was broken off goes on with those it
//! lacks.

mod draw;
mod figures;
mod lanes;
mod part;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use appell_model::lanes::{dispatch, narrow};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::foreign::digests;
use crate::record::{Nothing, Recorder};
use crate::run::{NarrowRun, Outcome, Plans, Run, Summary, hash};
use crate::scenario::{
    self, Diagnostic, Diagnostics, Draw, Loaded, Overrides, Precision, Sampling, Template, Vary,
};
use crate::world::{Failure, SimError};

use lanes::{Queue, Worker};

pub use draw::{parse, refuse};
pub use figures::{
    BatchSummary, Figure, Influence, Paired, Picture, Success, Trials, VariantSummary, report,
    telling,
};
pub use part::Store;

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
    /// Name of its variant; empty where there are none.
    pub variant: String,
    /// `passed`, `failed`, `stopped` without a task; `error` where the run broke off, `invalid` where
    /// the drawn values make no scenario.
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

/// What a folder of rows belongs to: `batch.manifest`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Manifest {
    /// SHA-256 of all that the rows follow from.
    pub hash: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Title of the scenario.
    pub title: String,
    /// Seed.
    pub seed: u64,
    /// Version of the program.
    pub version: String,
    /// Precision of the numbers that its trials are computed with.
    #[serde(default, skip_serializing_if = "Precision::is_double")]
    pub precision: Precision,
    /// Number of trials of each variant.
    pub trials: u64,
    /// Names of the variants; one without a name where there are none.
    pub variants: Vec<String>,
    /// Whether a robot has a task.
    pub has_task: bool,
    /// Columns of the rows' values: first those that are drawn.
    pub columns: Vec<Column>,
    /// File of the run whose figures are marked.
    pub marked: Option<String>,
    /// Its figures, by the names of columns.
    pub marks: BTreeMap<String, f64>,
    /// The resolved scenario.
    pub text: String,
}

impl Manifest {
    /// Number of rows: all trials of one variant after the other.
    pub fn rows(&self) -> u64 {
        self.trials * self.variants.len() as u64
    }

    /// Number of parts.
    pub fn parts(&self) -> u64 {
        self.rows().div_ceil(PART)
    }

    /// Rows of a part.
    pub fn rows_of(&self, part: u64) -> Range<u64> {
        part * PART..((part + 1) * PART).min(self.rows())
    }

    /// Place of a variant's name.
    fn variant(&self, name: &str) -> usize {
        let found = self.variants.iter().position(|known| known == name);
        found.unwrap_or(self.variants.len())
    }

    /// Variant and trial of a row.
    pub fn place(&self, row: u64) -> (usize, u64) {
        ((row / self.trials) as usize, row % self.trials)
    }
}

/// A share of a batch: the `index`-th of `count`, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1.
    pub index: u64,
    /// Of how many.
    pub count: u64,
}

impl Shard {
    /// The whole batch.
    pub const WHOLE: Shard = Shard { index: 1, count: 1 };

    /// Reads `3/16`.
    ///
    /// # Errors
    /// What it must be.
    pub fn parse(text: &str) -> Result<Shard, String> {
        let wrong =
            || format!("must be I/N with 1 <= I <= N <= 1000000, such as 3/16; got \"{text}\"");
        let (index, count) = text.split_once('/').ok_or_else(wrong)?;
        let (index, count) = (index.trim().parse(), count.trim().parse());
        match (index, count) {
            (Ok(index), Ok(count)) if index >= 1 && index <= count && count <= 1_000_000 => {
                Ok(Shard { index, count })
            }
            _ => Err(wrong()),
        }
    }

    /// Whether a part, of `parts`, belongs to it: shards take ranges of parts.
    fn has(&self, part: u64, parts: u64) -> bool {
        part * self.count / parts == self.index - 1
    }
}

/// A batch, ready to run.
pub struct Batch {
    file: PathBuf,
    /// Each variant with its own overrides.
    variants: Vec<(Loaded, Vec<(String, String)>)>,
    templates: Vec<Template>,
    manifest: Manifest,
    plans: Arc<Plans>,
}

/// Values that are drawn for one robot of a count, with their paths: those of a batch that varies the
/// same.
pub(crate) fn drawn(robot: &str, vary: &[Vary], seed: u64, trial: u64) -> Vec<(String, f64)> {
    let vary = vary.iter().map(|vary| Vary {
        path: format!("robot.{robot}.{}", vary.path),
        draw: vary.draw.clone(),
    });
    let plan = scenario::Batch {
        vary: vary.collect(),
        ..scenario::Batch::default()
    };
    draw::values(&plan, seed, trial)
}

/// Who runs a batch. The rows are the same whoever does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crew {
    /// Threads; 0 for one on each core.
    pub threads: usize,
    /// Most trials that a thread runs side by side: as many as its registers hold, up to 8; of single
    /// precision twice as many.
    pub lanes: usize,
}

impl Default for Crew {
    fn default() -> Self {
        Crew {
            threads: 0,
            lanes: appell_model::lanes::widest(),
        }
    }
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

impl Batch {
    /// A batch of a scenario under overrides. The scenario says how many trials, unless `trials`
    /// does, and what varies, unless `vary` says how else, or that more does.
    ///
    /// # Errors
    /// The scenario is wrong, or none of the first trials can be built.
    pub fn new(
        file: &Path,
        overrides: &Overrides,
        trials: Option<u64>,
        vary: &[Vary],
        sampling: Option<Sampling>,
    ) -> Result<Batch, BatchError> {
        let mut loaded = scenario::load(file, overrides)?;
        if loaded.scenario.trial > 0 {
            return Err(BatchError::Scenario(Diagnostics(vec![Diagnostic {
                file: file.to_owned(),
                at: None,
                path: "trial".into(),
                problem: format!(
                    "must be left out for a batch, got {}",
                    loaded.scenario.trial
                ),
                hint: Some("a batch has the trials from 0 on; `appell run` repeats the one".into()),
            }])));
        }
        let mut plan = loaded.scenario.batch.take().unwrap_or_default();
        plan.trials = trials.unwrap_or(plan.trials);
        plan.sampling = sampling.unwrap_or(plan.sampling);
        plan.vary
            .retain(|known| vary.iter().all(|new| new.path != known.path));
        plan.vary.extend_from_slice(vary);
        let drawn = |vary: &&Vary| !matches!(vary.draw, Draw::Grid { .. });
        let dimensions = plan.vary.iter().filter(drawn).count();
        if plan.sampling == Sampling::Sobol && dimensions > draw::SOBOL_MAX {
            return Err(BatchError::Scenario(Diagnostics(vec![Diagnostic {
                file: file.to_owned(),
                at: None,
                path: "batch.sampling".into(),
                problem: format!(
                    "must be another: Sobol's sequence serves at most {} varied values, got {dimensions}",
                    draw::SOBOL_MAX
                ),
                hint: Some("use \"latin-hypercube\"".into()),
            }])));
        }
        loaded.scenario.batch = Some(plan.clone());
        let text = loaded.scenario.to_toml();
        loaded.resolved = text;
        let marks = match &plan.mark {
            Some(file) => marks(&loaded.folder.join(file))?,
            None => BTreeMap::new(),
        };
        let scenario = &loaded.scenario;
        let manifest = Manifest {
            hash: String::new(),
            scenario: scenario.name.clone(),
            title: scenario.title.clone(),
            seed: scenario.seed,
            version: env!("CARGO_PKG_VERSION").into(),
            precision: plan.precision,
            trials: plan.trials,
            variants: match plan.variant.as_slice() {
                [] => vec![String::new()],
                named => named.iter().map(|variant| variant.name.clone()).collect(),
            },
            has_task: scenario.robot.iter().any(|robot| robot.task.is_some()),
            columns: Vec::new(),
            marked: plan.mark.clone(),
            marks,
            text: loaded.resolved.clone(),
        };
        let mut variants = Vec::new();
        for variant in &plan.variant {
            let mut own = overrides.to_vec();
            let values = variant.set.iter();
            own.extend(values.map(|(path, value)| (path.clone(), value.to_string())));
            let mut changed = scenario::load(file, &own).map_err(|mut problem| {
                for diagnostic in &mut problem.0 {
                    if variant.set.contains_key(&diagnostic.path) {
                        let name = format!("{}: variant {}", file.display(), variant.name);
                        diagnostic.file = PathBuf::from(name);
                    }
                }
                problem
            })?;
            changed.scenario.batch = Some(plan.clone());
            variants.push((changed, own));
        }
        if variants.is_empty() {
            variants.push((loaded, overrides.to_vec()));
        }
        let templates: Result<Vec<Template>, Diagnostics> = variants
            .iter()
            .map(|(_, own)| Template::read(file, own))
            .collect();
        let mut batch = Batch {
            file: file.to_owned(),
            templates: templates?,
            variants,
            manifest,
            plans: Arc::default(),
        };
        let drawn = plan.vary.iter().map(|vary| Column {
            name: vary.path.clone(),
            unit: String::new(),
            group: DRAWN.into(),
        });
        batch.manifest.columns = drawn.collect();
        // The first trials of each variant.
        let probes = PROBES.min(plan.trials);
        let places: Vec<(usize, u64)> = (0..batch.variants.len())
            .flat_map(|variant| (0..probes).map(move |trial| (variant, trial)))
            .collect();
        let probed: Vec<Result<Summary, Diagnostics>> = places
            .par_iter()
            .map(|&(variant, trial)| batch.summary(variant, trial))
            .collect();
        // A mistake of the settings breaks all trials, an unlucky draw only its own.
        if let Some(Err(problem)) = probed.first()
            && probed.iter().all(Result::is_err)
        {
            return Err(problem.clone().into());
        }
        for summary in probed.iter().flatten() {
            for (column, _) in figures_of(summary) {
                let columns = &mut batch.manifest.columns;
                if !columns.iter().any(|known| known.name == column.name) {
                    columns.push(column);
                }
            }
        }
        let marks = &batch.manifest.marks;
        let in_common = |column: &Column| marks.contains_key(&column.name);
        if let Some(marked) = &plan.mark
            && !batch.manifest.columns.iter().any(in_common)
        {
            return Err(BatchError::Scenario(Diagnostics(vec![Diagnostic {
                file: file.to_owned(),
                at: None,
                path: "batch.mark".into(),
                problem: format!(
                    "must be a scenario with figures of the same names, got \"{marked}\""
                ),
                hint: Some("name a scenario with the same robots and tables".into()),
            }])));
        }
        // The first rows stand for all that the text only names, such as the files it reads.
        let rows = places.into_iter().zip(probed);
        let probed: Vec<Row> = rows.map(|(place, probe)| batch.row(place, probe)).collect();
        let variants = batch.variants.iter();
        let plugins = variants.map(|(own, _)| digests(&own.scenario, &own.folder));
        batch.manifest.hash = hash(&format!(
            "{}{}\n{}\n{}\n{}\n{}",
            batch.manifest.text,
            plugins.collect::<String>(),
            env!("CARGO_PKG_VERSION"),
            serde_json::to_string(&plan).expect("a plan is plain data"),
            serde_json::to_string(&batch.manifest.columns).expect("columns are plain data"),
            part::root(&[part::leaf(&probed)]),
        ));
        Ok(batch)
    }

    /// What its rows belong to.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The scenario of a trial of a variant, with what is drawn for it.
    ///
    /// # Errors
    /// What was drawn makes no scenario.
    pub fn scenario(&self, variant: usize, trial: u64) -> Result<Loaded, Diagnostics> {
        let drawn = self.drawn(trial);
        let (loaded, own) = &self.variants[variant];
        if drawn.is_empty() {
            return Ok(loaded.clone());
        }
        let mut overrides = own.clone();
        for (path, value) in drawn {
            overrides.push((path, scenario::number_text(value)));
        }
        scenario::load(&self.file, &overrides).map_err(|mut problem| {
            // What was drawn is none of the user's own changes.
            for diagnostic in &mut problem.0 {
                let same = |(path, _): &(String, String)| *path == diagnostic.path;
                if diagnostic.at.is_none() && !own.iter().any(same) {
                    diagnostic.file = PathBuf::from("--vary");
                }
            }
            problem
        })
    }

    /// The same without its text, quickly.
    fn sketch(&self, variant: usize, trial: u64) -> Result<Loaded, Diagnostics> {
        let drawn = self.drawn(trial);
        if drawn.is_empty() {
            return Ok(self.variants[variant].0.clone());
        }
        let quick = scenario::with_numbers(&self.templates[variant], &drawn);
        quick.map_or_else(|| self.scenario(variant, trial), Ok)
    }

    /// Values drawn for a trial, with their paths; the same for all variants.
    pub fn drawn(&self, trial: u64) -> Vec<(String, f64)> {
        let plan = self.variants[0].0.scenario.batch.as_ref();
        plan.map_or_else(Vec::new, |plan| {
            draw::values(plan, self.manifest.seed, trial)
        })
    }

    fn summary(&self, variant: usize, trial: u64) -> Result<Summary, Diagnostics> {
        let summary = self.look(variant, trial, &mut Nothing)?;
        Ok(summary.expect("nothing is written that could fail"))
    }

    /// Runs one trial of a variant.
    pub fn trial(&self, variant: usize, trial: u64) -> Row {
        self.row((variant, trial), self.summary(variant, trial))
    }

    /// The row of a trial of a variant.
    fn row(&self, (variant, trial): (usize, u64), summary: Result<Summary, Diagnostics>) -> Row {
        let mut row = Row {
            trial,
            variant: self.manifest.variants[variant].clone(),
            verdict: "invalid".into(),
            reason: String::new(),
            values: vec![f64::NAN; self.manifest.columns.len()],
            other: String::new(),
        };
        for (k, (_, value)) in self.drawn(trial).into_iter().enumerate() {
            row.values[k] = value;
        }
        let summary = match summary {
            Ok(summary) => summary,
            Err(problem) => {
                row.reason = problem.to_string();
                return row;
            }
        };
        row.verdict = match summary.verdict {
            Outcome::Passed => "passed",
            Outcome::Failed => "failed",
            Outcome::Stopped if summary.error.is_some() => "error",
            Outcome::Stopped => "stopped",
        }
        .into();
        let mut other = BTreeMap::new();
        for (column, value) in figures_of(&summary) {
            let mut columns = self.manifest.columns.iter();
            let place = columns.position(|known| known.name == column.name);
            match place {
                Some(place) => row.values[place] = value,
                None => drop(other.insert(column.name, value)),
            }
        }
        if !other.is_empty() {
            row.other = serde_json::to_string(&other).expect("figures are plain data");
        }
        row.reason = summary.reason;
        // What a plug-in did wrong is why a trial is not like the others.
        if let Some(failure) = summary.failures.first() {
            let Failure { block, problem, .. } = failure;
            row.reason = format!("{} ({block} failed: {problem})", row.reason);
        }
        row
    }

    /// Runs what a folder lacks of a shard; `progress` is told the number of trials of the shard that
    /// are done, at first those that were there, from any thread.
    ///
    /// # Errors
    /// The folder holds another batch, or cannot be written; what was written stays.
    pub fn execute(
        &self,
        store: &Store,
        shard: Shard,
        crew: Crew,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<(), BatchError> {
        let parts = self.manifest.parts();
        let mut missing = Vec::new();
        let mut there = 0;
        for part in (0..parts).filter(|&part| shard.has(part, parts)) {
            match store.read(part)? {
                None => missing.push(part),
                Some(rows) => there += rows.len() as u64,
            }
        }
        progress(there);
        let done = AtomicU64::new(there);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(crew.threads)
            .build()
            .map_err(|error| BatchError::Folder {
                path: store.folder().to_owned(),
                problem: format!("no threads: {error}"),
                hint: "ask for fewer with --threads",
            })?;
        let queue = Queue {
            manifest: &self.manifest,
            parts: &missing,
            next: AtomicU64::new(0),
            broken: AtomicBool::new(false),
        };
        // Parts of which some rows are there, and what could not be written.
        let open: Mutex<BTreeMap<u64, Vec<Row>>> = Mutex::default();
        let failure = Mutex::new(None);
        let hand_over = |row: u64, told: Row| {
            let part = row / PART;
            let full = {
                let mut open = open.lock().expect("nothing panics with it");
                let rows = open.entry(part).or_default();
                rows.push(told);
                let is_full = rows.len() as u64 == self.manifest.rows_of(part).count() as u64;
                is_full.then(|| open.remove(&part)).flatten()
            };
            if let Some(mut rows) = full {
                rows.sort_by_key(|row| (self.manifest.variant(&row.variant), row.trial));
                if let Err(error) = store.write(part, &rows) {
                    queue.broken.store(true, Ordering::Relaxed);
                    failure
                        .lock()
                        .expect("nothing panics with it")
                        .get_or_insert(error);
                }
            }
            progress(done.fetch_add(1, Ordering::Relaxed) + 1);
        };
        pool.broadcast(|_| {
            let worker = Worker {
                batch: self,
                queue: &queue,
                plans: &self.plans,
                hand_over: &hand_over,
            };
            match self.manifest.precision {
                Precision::F64 => dispatch(crew.lanes, worker),
                Precision::F32 => narrow::dispatch(2 * crew.lanes, worker),
            }
        });
        match failure.into_inner().expect("nothing panics with it") {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Runs one trial of a variant into a recorder, for a look at it; an error of that is within.
    ///
    /// # Errors
    /// What was drawn makes no scenario.
    pub fn look(
        &self,
        variant: usize,
        trial: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<Result<Summary, SimError>, Diagnostics> {
        let loaded = self.scenario(variant, trial)?;
        Ok(match self.manifest.precision {
            Precision::F64 => {
                let mut run = Run::planned(&loaded, trial, &self.plans)?;
                run.execute(recorder, &mut |_| {})
            }
            Precision::F32 => {
                let run = NarrowRun::planned(&loaded, trial, &self.plans, "batch.precision")?;
                run.execute(recorder, &mut |_| {})
            }
        })
    }

    /// Number of trials of a shard.
    pub fn share(&self, shard: Shard) -> u64 {
        let parts = self.manifest.parts();
        let own = (0..parts).filter(|&part| shard.has(part, parts));
        let rows = own.map(|part| self.manifest.rows_of(part));
        rows.map(|rows| rows.end - rows.start).sum()
    }
}

/// Figures of the run of a scenario, by the names of columns.
fn marks(file: &Path) -> Result<BTreeMap<String, f64>, BatchError> {
    let mut run = Run::new(&scenario::load(file, &[])?, 0)?;
    let summary = run.execute(&mut Nothing, &mut |_| {});
    let summary = summary.expect("nothing is written that could fail");
    let figures = figures_of(&summary).into_iter();
    let known = figures.filter(|(_, value)| value.is_finite());
    Ok(known.map(|(column, value)| (column.name, value)).collect())
}

/// What the rows of a folder say, and the trials of each variant.
///
/// # Errors
/// Parts are missing or cannot be read.
pub fn sum_up(store: &Store) -> Result<(BatchSummary, Vec<Trials>), BatchError> {
    let manifest = store.manifest();
    let variants = manifest.variants.iter();
    let mut trials: Vec<Trials> = variants.map(|_| Trials::new(manifest)).collect();
    let (mut leaves, mut missing) = (Vec::new(), Vec::new());
    for part in 0..manifest.parts() {
        match store.read(part)? {
            Some(stored) => {
                leaves.push(part::leaf(&stored));
                for (row, told) in manifest.rows_of(part).zip(&stored) {
                    trials[manifest.place(row).0].add(told);
                }
            }
            None => missing.push(part),
        }
    }
    if let Some(first) = missing.first() {
        return Err(BatchError::Folder {
            path: store.folder().to_owned(),
            problem: format!(
                "lacks {} of {} parts, the first from row {}",
                missing.len(),
                manifest.parts(),
                first * PART
            ),
            hint: "run the shards that are missing; a batch goes on with what it lacks",
        });
    }
    let summary = figures::sum_up(manifest, &trials, part::root(&leaves));
    Ok((summary, trials))
}

/// Brings the parts of several folders of one batch into one.
///
/// # Errors
/// The folders hold different batches, two attempts at one part differ, or writing failed.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Store, BatchError> {
    let stores: Result<Vec<Store>, BatchError> = folders
        .iter()
        .map(|folder| Store::existing(folder))
        .collect();
    let stores = stores?;
    let Some(first) = stores.first() else {
        return Err(BatchError::Folder {
            path: out.to_owned(),
            problem: "has nothing to be merged from".into(),
            hint: "name the folders of the shards",
        });
    };
    let merged = Store::open(out, first.manifest())?;
    for store in &stores {
        store.agrees(merged.manifest().precision)?;
        if store.manifest().hash != merged.manifest().hash {
            return Err(BatchError::Folder {
                path: store.folder().to_owned(),
                problem: format!("holds another batch than {}", first.folder().display()),
                hint: "merge shards of one scenario, with the same settings and version",
            });
        }
        for part in 0..merged.manifest().parts() {
            if let Some(rows) = store.read(part)? {
                merged.write(part, &rows)?;
            }
        }
    }
    Ok(merged)
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
