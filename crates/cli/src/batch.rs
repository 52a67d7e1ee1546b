//! `appell batch`.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use appell_sim::batch::{
    self, Batch, BatchError, BatchSummary, Crew, Picture, Shard, Store, Trials, VariantSummary,
};
use appell_sim::record::Memory;
use appell_sim::report::{self, Press};
use appell_sim::scenario::{Precision, TRIALS_MAX};

use crate::arguments::{BatchCommand, BatchOptions, MergeOptions};
use crate::{exit, terminal};

/// Exit code and what to print.
type Failure = (u8, String);

/// Runs many trials of a scenario, or joins shards of them.
pub fn batch(options: &BatchOptions) -> u8 {
    let done = match &options.command {
        Some(BatchCommand::Merge(options)) => join(options),
        None => run(options),
    };
    match done {
        Ok(text) => {
            terminal::print(&text);
            exit::PASSED
        }
        Err((code, problem)) => {
            terminal::error(&problem);
            code
        }
    }
}

fn failed(error: BatchError) -> Failure {
    match error {
        BatchError::Scenario(_) => (exit::BAD_INPUT, error.to_string()),
        BatchError::Folder { .. } => (exit::OUTPUT, error.to_string()),
    }
}

fn run(options: &BatchOptions) -> Result<String, Failure> {
    let bad = |problem: String| (exit::BAD_INPUT, problem);
    let mut overrides = options.changes.overrides().map_err(bad)?;
    let precision = options.precision.map(Precision::from);
    overrides.extend(precision.map(|p| ("batch.precision".to_owned(), p.name().to_owned())));
    let vary: Result<Vec<_>, String> = options.vary.iter().map(|text| batch::parse(text)).collect();
    let vary = vary.map_err(|problem| bad(format!("--vary {problem}")))?;
    if let Some(twice) = (1..vary.len()).find(|&k| vary[..k].iter().any(|v| v.path == vary[k].path))
    {
        let path = &vary[twice].path;
        return Err(bad(format!(
            "--vary must name a path once, got {path} twice"
        )));
    }
    let shard = options.shard.as_deref().map(Shard::parse).transpose();
    let shard = shard.map_err(|problem| bad(format!("--shard {problem}")))?;
    if let Some(trials) = options.trials
        && !(1..=TRIALS_MAX).contains(&trials)
    {
        let problem = format!("--trials must be in [1, {TRIALS_MAX}], got {trials}");
        return Err(bad(problem));
    }
    let file = options.scenario.as_ref().expect("clap asks for it");
    let sampling = options.sampling.map(Into::into);
    let batch = Batch::new(file, &overrides, options.trials, &vary, sampling).map_err(failed)?;
    let manifest = batch.manifest();
    let folder = options
        .out
        .clone()
        .unwrap_or_else(|| Path::new("runs").join(format!("{}-batch", manifest.scenario)));
    let store = Store::open(&folder, manifest).map_err(failed)?;
    let own = shard.unwrap_or(Shard::WHOLE);
    let count = batch.share(own);
    let bar = terminal::Progress::new(&manifest.scenario, count as f64, "trials/s");
    let progress = Mutex::new(bar);
    let told = |done: u64| {
        if let Ok(mut progress) = progress.try_lock() {
            progress.at(done as f64);
        }
    };
    let mut crew = Crew {
        threads: options.threads.unwrap_or(0) as usize,
        ..Crew::default()
    };
    crew.lanes = options.lanes.map_or(crew.lanes, usize::from);
    batch.execute(&store, own, crew, &told).map_err(failed)?;
    if let Ok(progress) = progress.lock() {
        progress.done();
    }
    if let Some(Shard { index, count: of }) = shard {
        return Ok(format!(
            "{}: shard {index} of {of}, {count} of {} rows, in {}\n  \
             next: appell batch merge DIR… --out DIR",
            manifest.scenario,
            manifest.rows(),
            folder.display()
        ));
    }
    let (summary, trials) = batch::sum_up(&store).map_err(failed)?;
    let pictures = if options.no_report {
        Vec::new()
    } else {
        pictures(&batch, &trials)?
    };
    let shown = write(&store, &summary, &trials, &pictures, !options.no_report)?;
    Ok(printed(&summary, &folder, &shown, options.json))
}

fn join(options: &MergeOptions) -> Result<String, Failure> {
    let store = batch::merge(&options.folders, &options.out).map_err(failed)?;
    let (summary, trials) = batch::sum_up(&store).map_err(failed)?;
    let shown = write(&store, &summary, &trials, &[], !options.no_report)?;
    Ok(printed(&summary, &options.out, &shown, options.json))
}

/// Runs of the trials that are worth a look, once more.
fn pictures(batch: &Batch, trials: &[Trials]) -> Result<Vec<Picture>, Failure> {
    let internal = |error: &dyn std::fmt::Display| (exit::INTERNAL, error.to_string());
    let press = Press::new().map_err(|error| internal(&error))?;
    let mut pictures = Vec::new();
    let telling = trials.iter().enumerate().flat_map(|(variant, trials)| {
        let found = batch::telling(batch.manifest(), trials).into_iter();
        found.map(move |(title, trial)| (variant, title, trial))
    });
    for (variant, title, trial) in telling {
        let mut memory = Memory::bounded(crate::run::REPORT_ROWS);
        let looked = batch.look(variant, trial, &mut memory);
        let summary = looked
            .map_err(|error| internal(&error))?
            .map_err(|error| internal(&error))?;
        let data = report::data(&memory.into_recording(), &summary);
        pictures.push(Picture {
            title: title.into(),
            variant,
            trial,
            reason: summary.reason,
            svg: press.arena(&data).map_err(|error| internal(&error))?,
        });
    }
    Ok(pictures)
}

/// Writes summary and report; the file to be looked at.
fn write(
    store: &Store,
    summary: &BatchSummary,
    trials: &[Trials],
    pictures: &[Picture],
    with_report: bool,
) -> Result<PathBuf, Failure> {
    let write = |name: &str, text: &str| {
        let path = store.folder().join(name);
        std::fs::write(&path, text).map_err(|error| {
            let hint = "choose another folder with --out, or make room";
            let path = path.display();
            let problem = format!("{path}: cannot be written: {error}\n  hint: {hint}");
            (exit::OUTPUT, problem)
        })?;
        Ok::<_, Failure>(path)
    };
    let json = serde_json::to_string_pretty(summary).expect("a summary is plain data");
    write("scenario.toml", &store.manifest().text)?;
    let shown = write("batch.json", &(json + "\n"))?;
    if !with_report {
        return Ok(shown);
    }
    let data = batch::report(store.manifest(), summary, trials, pictures);
    let page = Press::new().and_then(|press| press.batch(&data));
    let page = page.map_err(|error| (exit::INTERNAL, error.to_string()))?;
    write("report.html", &page)
}

fn printed(summary: &BatchSummary, folder: &Path, shown: &Path, json: bool) -> String {
    if json {
        serde_json::to_string_pretty(summary).expect("a summary is plain data")
    } else {
        text(summary, folder, shown)
    }
}

/// Four significant digits.
fn digits(value: f64) -> String {
    let size = value.abs();
    if (1e-3..1.0).contains(&size) {
        let zeros = [1e-1, 1e-2].iter().filter(|&&edge| size < edge).count();
        return format!("{value:.*}", 4 + zeros);
    }
    terminal::number(value)
}

fn text(summary: &BatchSummary, folder: &Path, shown: &Path) -> String {
    let mut out = String::new();
    if !summary.precision.is_double() {
        out += "in single precision\n";
    }
    for variant in &summary.variants {
        out += &variant_text(summary, variant);
    }
    if summary.variants.len() > 1 {
        let first = &summary.variants[0].name;
        out += &format!("less {first}, trial by trial, with 95 % intervals that do not hold 0\n");
    }
    for variant in &summary.variants {
        for pair in variant.paired.iter().filter(|p| p.mean.abs() > p.error) {
            out += &format!(
                "  {:20}{:>11} ± {:<11} {}\n",
                variant.name,
                digits(pair.mean),
                digits(pair.error),
                pair.figure
            );
        }
    }
    out += &format!("  rows: {}\n", folder.join("trials").display());
    out += &format!("  report: {}\n", shown.display());
    out
}

fn variant_text(summary: &BatchSummary, variant: &VariantSummary) -> String {
    let counts: Vec<String> = variant
        .verdicts
        .iter()
        .map(|(verdict, count)| format!("{count} {verdict}"))
        .collect();
    let name = match variant.name.as_str() {
        "" => summary.scenario.clone(),
        name => format!("{}, {name}", summary.scenario),
    };
    let mut out = format!("{name}: {} trials, {}\n", summary.trials, counts.join(", "));
    if let Some(success) = &variant.success {
        out += &format!(
            "passed {:.2} %, with 95 % confidence between {:.2} and {:.2} %\n",
            100.0 * success.share,
            100.0 * success.low,
            100.0 * success.high
        );
    }
    for (reason, count) in variant.failures.iter().take(8) {
        out += &format!("  {count:>8}  {reason}\n");
    }
    let names = variant.figures.iter().map(|f| f.name.chars().count());
    let width = names.max().unwrap_or(0).min(60);
    let heads = ["mean", "std", "5 %", "median", "95 %"].map(|head| format!("{head:>11}"));
    out += &format!("  {:width$}{}\n", "", heads.concat());
    for figure in &variant.figures {
        let [_, low, _, median, _, high, _] = figure.quantiles;
        let values = [figure.mean, figure.std, low, median, high]
            .map(|value| format!("{:>11}", digits(value)));
        let line = format!(
            "  {:width$}{} {}",
            figure.name,
            values.concat(),
            figure.unit
        );
        out += line.trim_end();
        out.push('\n');
    }
    let strong = variant
        .influences
        .iter()
        .filter(|i| i.correlation.abs() > 0.3);
    for (k, influence) in strong.take(8).enumerate() {
        if k == 0 {
            out += "  what the drawn values move most (rank correlation)\n";
        }
        out += &format!(
            "  {:>8.2}  {} and {}\n",
            influence.correlation, influence.drawn, influence.figure
        );
    }
    out
}
