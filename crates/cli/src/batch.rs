//! `appell batch`.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use appell_sim::batch::{self, Batch, BatchError, BatchSummary};
use appell_sim::report::Press;
use appell_sim::scenario::TRIALS_MAX;

use crate::arguments::BatchOptions;
use crate::{exit, terminal};

/// Runs many trials of a scenario.
pub fn batch(options: &BatchOptions) -> u8 {
    match run(options) {
        Ok((summary, folder)) => {
            let text = if options.json {
                serde_json::to_string_pretty(&summary).expect("a summary is plain data")
            } else {
                text(&summary, &folder, options)
            };
            terminal::print(&text);
            exit::PASSED
        }
        Err((code, problem)) => {
            terminal::error(&problem);
            code
        }
    }
}

fn run(options: &BatchOptions) -> Result<(BatchSummary, PathBuf), (u8, String)> {
    let bad = |problem: String| (exit::BAD_INPUT, problem);
    let failed = |error: BatchError| match error {
        BatchError::Scenario(_) => (exit::BAD_INPUT, error.to_string()),
        BatchError::Folder { .. } => (exit::OUTPUT, error.to_string()),
    };
    let overrides = options.changes.overrides().map_err(bad)?;
    let vary: Result<Vec<_>, String> = options.vary.iter().map(|text| batch::parse(text)).collect();
    let vary = vary.map_err(|problem| bad(format!("--vary {problem}")))?;
    if let Some(trials) = options.trials
        && !(1..=TRIALS_MAX).contains(&trials)
    {
        return Err(bad(format!(
            "--trials must be in [1, {TRIALS_MAX}], got {trials}"
        )));
    }
    let batch = Batch::new(&options.scenario, &overrides, options.trials, &vary).map_err(failed)?;
    let marks = batch.marks().map_err(failed)?;
    let name = &batch.loaded().scenario.name;
    let folder = options
        .out
        .clone()
        .unwrap_or_else(|| Path::new("runs").join(format!("{name}-batch")));
    let progress = terminal::Progress::new(name, batch.trials() as f64, "trials/s");
    let progress = Mutex::new(progress);
    let told = |done: u64| {
        if let Ok(mut progress) = progress.try_lock() {
            progress.at(done as f64);
        }
    };
    let threads = options.threads.unwrap_or(0) as usize;
    let summary = batch.execute(&folder, threads, &told).map_err(failed)?;
    if let Ok(progress) = progress.lock() {
        progress.done();
    }
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| {
            let hint = "choose another folder with --out, or make room";
            let problem = format!(
                "{}: cannot be written: {error}\n  hint: {hint}",
                path.display()
            );
            (exit::OUTPUT, problem)
        })
    };
    let json = serde_json::to_string_pretty(&summary).expect("a summary is plain data");
    write("batch.json", &(json + "\n"))?;
    write("scenario.toml", &batch.loaded().resolved)?;
    if !options.no_report {
        let data = batch::report(&batch, &summary, &marks);
        let page = Press::new().and_then(|press| press.batch(&data));
        let page = page.map_err(|error| (exit::INTERNAL, error.to_string()))?;
        write("report.html", &page)?;
    }
    Ok((summary, folder))
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

fn text(summary: &BatchSummary, folder: &Path, options: &BatchOptions) -> String {
    let counts: Vec<String> = summary
        .verdicts
        .iter()
        .map(|(verdict, count)| format!("{count} {verdict}"))
        .collect();
    let mut out = format!(
        "{}: {} trials, {}\n",
        summary.scenario,
        summary.trials,
        counts.join(", ")
    );
    if let Some(success) = &summary.success {
        out += &format!(
            "passed {:.2} %, with 95 % confidence between {:.2} and {:.2} %\n",
            100.0 * success.share,
            100.0 * success.low,
            100.0 * success.high
        );
    }
    for (reason, count) in summary.failures.iter().take(8) {
        out += &format!("  {count:>8}  {reason}\n");
    }
    let names = summary.figures.iter().map(|f| f.name.chars().count());
    let width = names.max().unwrap_or(0).min(60);
    let heads = ["mean", "std", "5 %", "median", "95 %"].map(|head| format!("{head:>11}"));
    out += &format!("  {:width$}{}\n", "", heads.concat());
    for figure in &summary.figures {
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
    let report = if options.no_report {
        folder.join("batch.json")
    } else {
        folder.join("report.html")
    };
    out += &format!("  rows: {}\n", folder.join("trials").display());
    out += &format!("  report: {}\n", report.display());
    out
}
