//! `appell compare`.

use appell_sim::compare::{Entry, block, divergence, drives, parting};
use appell_sim::record::Memory;
use appell_sim::report::{self, Press};
use appell_sim::run::Run;
use appell_sim::scenario;
use serde_json::json;

use crate::arguments::{Changes, CompareOptions};
use crate::run::folder_or;
use crate::{exit, terminal};

/// Runs a scenario at several levels, and shows where they part.
pub fn compare(options: &CompareOptions) -> u8 {
    let drives = match &options.drives {
        Some(drives) => drives.clone(),
        // What is wrong with the file is said below, with the first of its variants.
        None => {
            let changes = Changes {
                set: options.set.clone(),
                ..Changes::default()
            };
            let overrides = changes.overrides().unwrap_or_default();
            scenario::load(&options.scenario, &overrides)
                .map_or(vec!["torque".into()], |loaded| drives(&loaded.scenario))
        }
    };
    if !(options.beyond.is_finite() && options.beyond > 0.0) {
        let got = options.beyond;
        terminal::error(&format!("--beyond: must be a distance > 0 in m, got {got}"));
        return exit::BAD_INPUT;
    }
    let mut variants: Vec<(String, Changes)> = Vec::new();
    for level in &options.levels {
        let changes = |drive: Option<&String>| Changes {
            level: Some(level.clone()),
            drive: drive.cloned(),
            integrator: options.integrator.clone(),
            seed: options.seed,
            set: options.set.clone(),
        };
        if level == "kinematic" {
            variants.push((level.clone(), changes(None)));
        } else {
            for drive in &drives {
                variants.push((format!("{level}, {drive}"), changes(Some(drive))));
            }
        }
    }
    let mut entries = Vec::new();
    for (label, changes) in variants {
        let built = changes
            .overrides()
            .map_err(|problem| terminal::error(&problem))
            .and_then(|overrides| {
                scenario::load(&options.scenario, &overrides)
                    .and_then(|loaded| Run::new(&loaded, 0))
                    .map_err(|diagnostics| terminal::error(&diagnostics.to_string()))
            });
        let Ok(mut run) = built else {
            return exit::BAD_INPUT;
        };
        let mut memory = Memory::new();
        match run.execute(&mut memory, &mut |_| {}) {
            Ok(summary) => entries.push(Entry {
                label,
                recording: memory.into_recording(),
                summary,
            }),
            Err(error) => {
                terminal::error(&error.to_string());
                return exit::FAILED;
            }
        }
    }
    let Some(last) = entries.last() else {
        terminal::error("--levels: must name at least one level");
        return exit::BAD_INPUT;
    };
    let folder = folder_or(
        options.out.as_ref(),
        &format!(
            "{}-compare",
            last.summary.scenario.trim_end_matches("-compare")
        ),
    );
    terminal::print(&table(&entries, options.beyond));
    let mut data = report::data(&last.recording, &last.summary);
    data["comparison"] = block(&entries);
    let drawn = Press::new().and_then(|press| {
        let page = press.page(&data)?;
        let svg = press.plots(&apart(&entries), &json!([apart_plot(&entries)]), &json!({}))?;
        let png = report::png(&svg, 2.0)?;
        Ok([
            ("report.html", page.into_bytes()),
            ("divergence.svg", svg.into_bytes()),
            ("divergence.png", png),
        ])
    });
    let files = match drawn {
        Ok(files) => files,
        Err(error) => {
            terminal::error(&error.to_string());
            return exit::INTERNAL;
        }
    };
    let written = std::fs::create_dir_all(&folder).and_then(|()| {
        files
            .iter()
            .try_for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes))
    });
    if let Err(error) = written {
        terminal::error(&format!("{}: cannot be written: {error}", folder.display()));
        return exit::OUTPUT;
    }
    terminal::print(&format!("report: {}", folder.join("report.html").display()));
    let failed = entries
        .iter()
        .any(|entry| entry.summary.verdict == appell_sim::run::Outcome::Failed);
    if failed { exit::FAILED } else { exit::PASSED }
}

fn signal(k: usize) -> String {
    format!("compare.run{k}.distance")
}

/// Distances from the first run as plottable signals.
fn apart(entries: &[Entry]) -> serde_json::Value {
    let mut signals = serde_json::Map::new();
    let mut time = Vec::new();
    let all: Vec<_> = (1..entries.len())
        .map(|k| divergence(&entries[k], &entries[0]))
        .collect();
    let count = all.iter().map(|d| d.times.len()).min().unwrap_or(0);
    for (k, distance) in all.iter().enumerate() {
        time = distance.times[..count].to_vec();
        signals.insert(
            signal(k + 1),
            json!({"unit": "m", "values": distance.distances[..count]}),
        );
    }
    json!({"time": time, "signals": signals, "events": [], "robots": [], "arena": {"size": [1, 1], "beacons": []}})
}

fn apart_plot(entries: &[Entry]) -> serde_json::Value {
    let lines: Vec<_> = entries
        .iter()
        .enumerate()
        .skip(1)
        .map(|(k, entry)| json!({"signal": signal(k), "label": entry.label, "role": "other"}))
        .collect();
    json!({"title": format!("distance from the {} run at the same instant", entries[0].label), "unit": "mm", "scale": 1000.0, "lines": lines, "limits": []})
}

/// Level and drive of a label.
fn parts(label: &str) -> (&str, Option<&str>) {
    label
        .split_once(", ")
        .map_or((label, None), |(level, drive)| (level, Some(drive)))
}

/// Where each run leaves the one of the level before it with the same drive.
fn partings(entries: &[Entry], limit: f64) -> String {
    let mut text = String::new();
    for (k, entry) in entries.iter().enumerate() {
        let (level, drive) = parts(&entry.label);
        let before = entries[..k].iter().rev().find(|other| {
            let (other_level, other_drive) = parts(&other.label);
            other_level != level && (other_drive == drive || other_drive.is_none())
        });
        let Some(before) = before else { continue };
        let apart = format!("{} leaves {}", entry.label, before.label);
        let Some(parting) = parting(entry, before, limit) else {
            text.push_str(&format!(
                "{apart}: never by more than {:.0} mm\n",
                1e3 * limit
            ));
            continue;
        };
        let [x, y] = parting.place;
        text.push_str(&format!(
            "{apart}: by more than {:.0} mm from {:.2} s at ({x:.2}, {y:.2})",
            1e3 * limit,
            parting.time
        ));
        if let Some([now, highest]) = parting.demand {
            text.push_str(&format!(
                ", where friction of {:.2} is asked for ({}); until then at most {:.2} ({})",
                now.0, now.1, highest.0, highest.1
            ));
        }
        text.push('\n');
    }
    text
}

fn table(entries: &[Entry], limit: f64) -> String {
    let mut text = format!(
        "{:22} {:8} {:>8} {:>8} {:>12} {:>20} {:>14}\n",
        "level, drive",
        "verdict",
        "time, s",
        "path, m",
        "clearance, m",
        "apart, mm",
        format!("beyond {:.0} mm", 1e3 * limit)
    );
    for (k, entry) in entries.iter().enumerate() {
        let robot = &entry.summary.robots[0];
        let metric = |name: &str| {
            let found = robot.metrics.iter().find(|m| m.name == name);
            found.map_or("-".into(), |m| format!("{:.3}", m.value))
        };
        let (apart, beyond) = if k == 0 {
            ("reference".into(), String::new())
        } else {
            let divergence = divergence(entry, &entries[0]);
            let (largest, at) = divergence.largest();
            let beyond = divergence
                .first_beyond(limit)
                .map_or("never".into(), |t| format!("from {t:.2} s"));
            (format!("{:.1} at {at:.2} s", 1e3 * largest), beyond)
        };
        text.push_str(&format!(
            "{:22} {:8} {:>8} {:>8} {:>12} {:>20} {:>14}\n",
            entry.label,
            format!("{:?}", robot.verdict).to_lowercase(),
            metric("time"),
            metric("path length"),
            metric("beacon clearance"),
            apart,
            beyond
        ));
    }
    text + &partings(entries, limit)
}
