//! `appell plot`.

use std::path::Path;

use appell_sim::record::Recording;
use appell_sim::report::{self, Press};
use serde_json::{Map, Value, json};

use crate::arguments::PlotOptions;
use crate::{exit, terminal};

/// Plots signals of a recording, one panel for each unit.
pub fn plot(options: &PlotOptions) -> u8 {
    let recording = match Recording::read(&options.recording) {
        Ok(recording) => recording,
        Err(error) => {
            let hint = error
                .hint()
                .map_or(String::new(), |hint| format!("\n  hint: {hint}"));
            terminal::error(&format!("{error}{hint}"));
            return exit::BAD_INPUT;
        }
    };
    if !recording.complete {
        terminal::warning(&format!(
            "{}: was not closed in order; what follows {} s is missing",
            options.recording.display(),
            recording.times.last().copied().unwrap_or(0.0)
        ));
    }
    if options.signals.is_empty() {
        let mut list = String::new();
        for signal in &recording.header.signals {
            list.push_str(&format!("{:48} {}\n", signal.path, signal.unit));
        }
        terminal::print(&list);
        return exit::PASSED;
    }
    let (span, as_png) = match (time_axis(options, &recording.times), picture(&options.out)) {
        (Ok(span), Ok(as_png)) => (span, as_png),
        (Err(problem), _) | (_, Err(problem)) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for wanted in &options.signals {
        let ending = format!(".{wanted}");
        let found: Vec<_> = recording
            .header
            .signals
            .iter()
            .filter(|s| s.path == *wanted || s.path.ends_with(&ending))
            .collect();
        if found.is_empty() {
            terminal::error(&format!(
                "{}: has no signal \"{wanted}\"\n  hint: `appell plot {}` lists them all",
                options.recording.display(),
                options.recording.display()
            ));
            return exit::BAD_INPUT;
        }
        for signal in found {
            match groups.iter_mut().find(|(unit, _)| *unit == signal.unit) {
                Some((_, paths)) if !paths.contains(&signal.path) => {
                    paths.push(signal.path.clone())
                }
                Some(_) => {}
                None => groups.push((signal.unit.clone(), vec![signal.path.clone()])),
            }
        }
    }
    let mut signals = Map::new();
    let mut specs = Vec::new();
    for (unit, paths) in &groups {
        for path in paths {
            let column = recording.column(path).unwrap_or(&[]);
            signals.insert(path.clone(), json!({"unit": unit, "values": column}));
        }
        for some in paths.chunks(6) {
            let lines: Vec<Value> = some
                .iter()
                .map(|path| json!({"signal": path, "label": short(path), "role": role(path)}))
                .collect();
            let title = if some.len() == 1 {
                short(&some[0])
            } else {
                common(some)
            };
            specs.push(json!({"title": title, "unit": unit, "lines": lines, "limits": []}));
        }
    }
    let data = json!({"time": recording.times, "signals": signals, "events": [], "robots": [], "arena": {"size": [1, 1], "beacons": []}});
    let limits = json!({"t0": span[0], "t1": span[1]});
    let drawn = Press::new()
        .and_then(|press| press.plots(&data, &Value::Array(specs), &limits))
        .and_then(|svg| {
            if as_png {
                report::png(&svg, 2.0)
            } else {
                Ok(svg.into_bytes())
            }
        });
    match drawn {
        Ok(bytes) => match std::fs::write(&options.out, bytes) {
            Ok(()) => {
                terminal::print(&format!("plot: {}", options.out.display()));
                exit::PASSED
            }
            Err(error) => {
                terminal::error(&format!(
                    "{}: cannot be written: {error}",
                    options.out.display()
                ));
                exit::OUTPUT
            }
        },
        Err(error) => {
            terminal::error(&error.to_string());
            exit::INTERNAL
        }
    }
}

/// The time axis: what was asked for, within what was recorded.
fn time_axis(options: &PlotOptions, times: &[f64]) -> Result<[f64; 2], String> {
    let (Some(&first), Some(&last)) = (times.first(), times.last()) else {
        return Err(format!(
            "{}: must hold at least one row, got none\n  hint: run the scenario again",
            options.recording.display()
        ));
    };
    let span = [options.from.unwrap_or(first), options.to.unwrap_or(last)];
    // A recording of one row is drawn as a point.
    let empty = span[0] >= span[1] && (options.from.is_some() || options.to.is_some());
    if !span.iter().all(|t| t.is_finite()) || empty || span[1] < first || span[0] > last {
        return Err(format!(
            "--from, --to: must be a span within {first} s … {last} s, got {} s … {} s",
            span[0], span[1]
        ));
    }
    Ok(span)
}

/// Whether the output is to be a PNG rather than an SVG.
fn picture(out: &Path) -> Result<bool, String> {
    match out.extension().and_then(|e| e.to_str()) {
        Some("svg") => Ok(false),
        Some("png") => Ok(true),
        _ => Err(format!(
            "--out: must end in .svg or .png, got {}",
            out.display()
        )),
    }
}

/// A path without `robot.NAME.`.
fn short(path: &str) -> String {
    path.split('.').skip(2).collect::<Vec<_>>().join(" ")
}

/// What the paths of a panel share: their last word.
fn common(paths: &[String]) -> String {
    let last = |path: &String| {
        path.rsplit('.')
            .next()
            .unwrap_or_default()
            .replace('_', " ")
    };
    let first = last(&paths[0]);
    if paths.iter().all(|path| last(path) == first) {
        first
    } else {
        "signals".into()
    }
}

fn role(path: &str) -> &'static str {
    if path.contains(".left.") {
        "left"
    } else if path.contains(".right.") {
        "right"
    } else {
        "other"
    }
}
