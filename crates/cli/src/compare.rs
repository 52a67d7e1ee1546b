//! `appell compare`.

use appell_sim::compare::{Convergence, Entry, block, divergence, drives, parting, stiffened};
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
    let stiffer = match options.stiffen.map(|most| stiffen(options, &drives, most)) {
        None => None,
        Some(Ok(convergence)) => Some(convergence),
        Some(Err(code)) => return code,
    };
    let folder = folder_or(
        options.out.as_ref(),
        &format!(
            "{}-compare",
            last.summary.scenario.trim_end_matches("-compare")
        ),
    );
    terminal::print(&table(&entries, options.beyond));
    if let Some(convergence) = &stiffer {
        terminal::print(&falls(convergence));
    }
    let mut data = report::data(&last.recording, &last.summary);
    data["comparison"] = block(&entries);
    let drawn = Press::new().and_then(|press| {
        let page = press.page(&data)?;
        let svg = press.plots(&apart(&entries), &json!([apart_plot(&entries)]), &json!({}))?;
        let png = report::png(&svg, 2.0)?;
        let mut files = vec![
            ("report.html", page.into_bytes()),
            ("divergence.svg", svg.into_bytes()),
            ("divergence.png", png),
        ];
        if let Some(convergence) = &stiffer {
            let title = format!("{}: slip towards rolling", last.summary.scenario);
            let svg = press.convergence(&convergence.drawing(&title))?;
            files.push(("convergence.png", report::png(&svg, 2.0)?));
            files.push(("convergence.svg", svg.into_bytes()));
        }
        Ok(files)
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

/// Drives at level slip with ever stiffer tires, and says how far from rolling.
fn stiffen(options: &CompareOptions, drives: &[String], most: f64) -> Result<Convergence, u8> {
    if !(2.0..=1e6).contains(&most) {
        terminal::error(&format!("--stiffen: must be in [2, 1e6], got {most}"));
        return Err(exit::BAD_INPUT);
    }
    let refuse = |problem: String| {
        terminal::error(&problem);
        exit::BAD_INPUT
    };
    let loaded = |level: &str| {
        let changes = Changes {
            level: Some(level.to_owned()),
            drive: drives.first().cloned(),
            integrator: options.integrator.clone(),
            seed: options.seed,
            set: options.set.clone(),
        };
        let overrides = changes.overrides().map_err(refuse)?;
        scenario::load(&options.scenario, &overrides).map_err(|d| refuse(d.to_string()))
    };
    let drive = |loaded: &scenario::Loaded| {
        let mut run = Run::new(loaded, 0).map_err(|d| refuse(d.to_string()))?;
        let mut memory = Memory::new();
        let summary = run.execute(&mut memory, &mut |_| {}).map_err(|error| {
            terminal::error(&error.to_string());
            exit::FAILED
        })?;
        Ok::<_, u8>(Entry {
            label: String::new(),
            recording: memory.into_recording(),
            summary,
        })
    };
    let reference = drive(&loaded("rolling")?)?;
    let slips = loaded("slip")?;
    let mut points = Vec::new();
    let mut factor = 1.0;
    let mut stiffer = slips.clone();
    while factor <= most {
        stiffer.scenario = stiffened(&slips.scenario, factor);
        let apart = divergence(&drive(&stiffer)?, &reference);
        points.push((factor, apart.largest().0));
        factor *= 2.0;
    }
    Ok(Convergence { points })
}

/// The distances as a table, with the order from each to the next.
fn falls(convergence: &Convergence) -> String {
    let mut text = format!(
        "\n{:>14} {:>14} {:>8}\n",
        "tires stiffer", "from rolling, m", "order"
    );
    let mut orders = convergence.orders().into_iter();
    for (k, (factor, distance)) in convergence.points.iter().enumerate() {
        let order = if k == 0 { None } else { orders.next() };
        let order = order.map_or(String::new(), |order| format!("{order:.2}"));
        text.push_str(&format!("{:>13}× {distance:>14.3e} {order:>8}\n", factor));
    }
    text.push_str(&format!(
        "the distance falls by order {:.2}",
        convergence.order()
    ));
    if convergence.orders().last().is_some_and(|&last| last < 0.5) {
        text.push_str(
            "\nit does not go to zero: more than tires keeps them apart; at level slip the servo is softer \
             where driven wheels are light, and casters draw no force",
        );
    }
    text
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
