//! The terminal: color, pipes, progress and tables.

use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use appell_sim::crowd::spreads;
use appell_sim::run::{Metric, Outcome, RobotSummary, StatisticsTable, Summary};
use appell_sim::world::Failure;

use crate::arguments::Color;

static COLOR: AtomicBool = AtomicBool::new(false);

/// Decides on color once.
pub fn set_color(color: Color) {
    let on = match color {
        Color::Always => true,
        Color::Never => false,
        Color::Auto => std::io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none(),
    };
    COLOR.store(on, Ordering::Relaxed);
}

/// A closed pipe (`appell … | head`) ends the program quietly: see [`print`].
pub fn survive_closed_pipes() {
    std::panic::set_hook(Box::new(|panic| {
        eprintln!("appell: a defect of this program, please report it: {panic}");
        std::process::exit(i32::from(crate::exit::INTERNAL));
    }));
}

/// Prints to standard output; ends quietly when nobody reads it.
pub fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| {
        if text.ends_with('\n') {
            Ok(())
        } else {
            out.write_all(b"\n")
        }
    });
    if written.and_then(|()| out.flush()).is_err() {
        std::process::exit(0);
    }
}

/// Writes files into a folder, names it unless `quiet`, and gives the exit code.
pub fn write_folder(folder: &Path, files: &[(String, Vec<u8>)], quiet: bool) -> u8 {
    let written = std::fs::create_dir_all(folder).and_then(|()| {
        files
            .iter()
            .try_for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes))
    });
    match written {
        Ok(()) => {
            if !quiet {
                print(&format!("pictures: {}", folder.display()));
            }
            crate::exit::PASSED
        }
        Err(problem) => {
            error(&format!(
                "{}: cannot be written: {problem}",
                folder.display()
            ));
            crate::exit::OUTPUT
        }
    }
}

/// Prints an error with what was wrong.
pub fn error(text: &str) {
    complain("error:", "1;31", text);
}

/// Prints what deserves attention and stops nothing.
pub fn warning(text: &str) {
    complain("warning:", "1;33", text);
}

/// Prints what happens while something goes on, beside its results.
pub fn remark(text: &str) {
    eprintln!("{}", text.replace('\x1b', "\u{fffd}"));
}

fn complain(mark: &str, code: &str, text: &str) {
    let text = text.replace('\x1b', "\u{fffd}");
    if std::io::stderr().is_terminal() && COLOR.load(Ordering::Relaxed) {
        eprintln!("\x1b[{code}m{mark}\x1b[0m {text}");
    } else {
        eprintln!("{mark} {text}");
    }
}

fn styled(text: &str, code: &str) -> String {
    if COLOR.load(Ordering::Relaxed) {
        format!("\x1b[{code}m{text}\x1b[0m")
    } else {
        text.to_owned()
    }
}

/// A verdict as a word.
pub fn verdict(outcome: Outcome) -> String {
    match outcome {
        Outcome::Passed => styled("PASSED", "1;32"),
        Outcome::Failed => styled("FAILED", "1;31"),
        Outcome::Stopped => styled("STOPPED", "1;33"),
    }
}

/// Four significant digits, without an exponent where that is short.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let size = value.abs();
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    if value == value.round() && size < 1e5 {
        return format!("{value}");
    }
    let whole = [1.0, 10.0, 100.0, 1000.0]
        .iter()
        .filter(|&&limit| size >= limit)
        .count();
    format!("{value:.*}", 4_usize.saturating_sub(whole.max(1)).max(1))
}

/// Most robots whose metrics are printed one by one.
const ROBOTS_MAX: usize = 8;

/// What a robot is and does, after its name.
fn kind(robot: &RobotSummary) -> String {
    format!(
        "{} · level {} · drive {} · {}",
        robot.task,
        serde_json::to_value(robot.level)
            .ok()
            .and_then(|v| v.as_str().map(str::to_owned))
            .unwrap_or_default(),
        robot.drive,
        robot.integrator
    )
}

/// Metrics of many robots: of each kind how many passed, and quantiles.
fn crowd(summary: &Summary) -> String {
    let mut kinds: Vec<(String, Vec<&RobotSummary>)> = Vec::new();
    for robot in &summary.robots {
        // Robots of a count are called NAME-0, NAME-1, …
        let name = match robot.name.rsplit_once('-') {
            Some((name, place)) if place.parse::<u64>().is_ok() => name,
            _ => robot.name.as_str(),
        };
        let kind = format!("{name} · {}", kind(robot));
        match kinds.iter_mut().find(|(known, _)| *known == kind) {
            Some((_, robots)) => robots.push(robot),
            None => kinds.push((kind, vec![robot])),
        }
    }
    let mut text = String::new();
    for (kind, robots) in kinds {
        text.push_str(&styled(&format!("{} × {kind}", robots.len()), "1"));
        text.push('\n');
        for outcome in [Outcome::Passed, Outcome::Failed, Outcome::Stopped] {
            let mut of = robots.iter().filter(|robot| robot.verdict == outcome);
            let count = of.clone().count();
            if let Some(first) = of.next() {
                let word = verdict(outcome);
                text.push_str(&format!(
                    "  {word}  {count}, such as {}: {}\n",
                    first.name, first.reason
                ));
            }
        }
        text.push_str(&format!(
            "  {:26} {:>10} {:>10} {:>10}\n",
            "", "5 %", "median", "95 %"
        ));
        for spread in spreads(&robots) {
            let [low, median, high] = spread.quantiles.map(number);
            let row = format!(
                "  {:26} {low:>10} {median:>10} {high:>10} {}",
                spread.name, spread.unit
            );
            text.push_str(row.trim_end());
            text.push('\n');
        }
    }
    text
}

/// The table of a run's metrics.
pub fn summary(summary: &Summary) -> String {
    if summary.robots.len() > ROBOTS_MAX {
        return crowd(summary);
    }
    let mut text = String::new();
    for robot in &summary.robots {
        let heading = format!("{} · {}", robot.name, kind(robot));
        text.push_str(&styled(&heading, "1"));
        text.push('\n');
        if summary.robots.len() > 1 {
            text.push_str(&format!("  {}  {}\n", verdict(robot.verdict), robot.reason));
        }
        for Metric {
            name,
            value,
            unit,
            note,
        } in &robot.metrics
        {
            let row = format!(
                "  {name:26} {:>10} {unit:5} {}",
                number(*value),
                styled(note, "2")
            );
            text.push_str(row.trim_end());
            text.push('\n');
        }
    }
    for swap in &summary.swaps {
        let hash = swap.hash.as_ref();
        let hash = hash.map_or(String::new(), |hash| format!(" ({})", &hash[..12]));
        let line = match &swap.refused {
            None => format!("{}{hash} took over from {}", swap.to, swap.from),
            Some(problem) => format!("{} could not take over: {problem}", swap.to),
        };
        text.push_str(&format!(
            "  swap at {:.3} s  {}: {line}\n",
            swap.t, swap.robot
        ));
    }
    for failure in &summary.failures {
        let Failure {
            t, block, problem, ..
        } = failure;
        let line = format!("  failed at {t:.3} s  {block}: {problem}");
        text.push_str(&styled(&line, "31"));
        text.push('\n');
    }
    for table in &summary.statistics {
        text.push_str(&statistics(table));
    }
    text
}

/// A table of mean and standard deviation.
fn statistics(table: &StatisticsTable) -> String {
    let samples = match table.samples {
        0 => String::new(),
        samples => format!(" · {samples} samples"),
    };
    let names = table.rows.iter().map(|row| row.signal.chars().count());
    let width = names.max().unwrap_or(0).max(8);
    let mut text = styled(&format!("{}{samples}", table.name), "1");
    text.push_str(&format!("\n  {:width$} {:>14} {:>14}\n", "", "mean", "std"));
    let digits = table.decimals as usize;
    let number = |value: Option<f64>| match value {
        Some(value) => format!("{value:.digits$}"),
        None => "-".into(),
    };
    for row in &table.rows {
        let (mean, std) = (number(row.mean), number(row.std));
        let line = format!("  {:width$} {mean:>14} {std:>14} {}", row.signal, row.unit);
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// A progress bar that appears after a second, on a terminal only.
pub struct Progress {
    bar: Option<indicatif::ProgressBar>,
    start: Instant,
    end: f64,
    /// How far it was at first.
    begin: Option<f64>,
    name: String,
    unit: &'static str,
}

impl Progress {
    /// Progress up to `end` of something that is counted in `unit` per second: seconds of simulated
    /// time are "times real time".
    pub fn new(name: &str, end: f64, unit: &'static str) -> Self {
        Progress {
            bar: None,
            start: Instant::now(),
            end,
            begin: None,
            name: name.to_owned(),
            unit,
        }
    }

    /// Tells how far it is.
    pub fn at(&mut self, done: f64) {
        let begin = *self.begin.get_or_insert(done);
        if self.bar.is_none() {
            if self.start.elapsed() < Duration::from_secs(1) || !std::io::stderr().is_terminal() {
                return;
            }
            let style = indicatif::ProgressStyle::with_template(
                "{msg} [{bar:30}] {percent}%  {prefix}, {eta} left",
            )
            .expect("the template is valid")
            .progress_chars("=> ");
            let bar = indicatif::ProgressBar::new(1000)
                .with_style(style)
                .with_elapsed(self.start.elapsed());
            bar.set_message(self.name.clone());
            self.bar = Some(bar);
        }
        if let Some(bar) = &self.bar {
            let rate = (done - begin) / self.start.elapsed().as_secs_f64();
            let decimals = usize::from(rate < 10.0);
            bar.set_prefix(format!("{rate:.decimals$} {}", self.unit));
            bar.set_position((1000.0 * done / self.end) as u64);
        }
    }

    /// Takes the bar away.
    pub fn done(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
