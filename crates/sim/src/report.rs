//! What people see of a run: pictures, plots and the self-contained `report.html`.
//!
//! The drawing is done by the plain ES modules of `web/`, run here by an embedded JavaScript engine
//! and in the report's page by the browser: one text draws the robot everywhere.

#[cfg(not(target_family = "wasm"))]
mod press;

use serde_json::{Map, Value, json};

use crate::crowd::spreads;
use crate::record::{Event, Recording};
use crate::run::{Outcome, RobotSummary, Summary};

#[cfg(not(target_family = "wasm"))]
pub use press::{Press, ReportError, png};

/// Report and pictures of a run, by file name.
///
/// # Errors
/// They cannot be drawn, which is a defect.
#[cfg(not(target_family = "wasm"))]
pub fn pages(
    recording: &Recording,
    summary: &Summary,
) -> Result<Vec<(&'static str, Vec<u8>)>, ReportError> {
    let data = data(recording, summary);
    let press = Press::new()?;
    let svg = press.arena(&data)?;
    let png = png(&svg, 2.0)?;
    let page = press.page(&data)?;
    Ok(vec![
        ("trajectory.svg", svg.into_bytes()),
        ("trajectory.png", png),
        ("report.html", page.into_bytes()),
    ])
}

/// The data that all drawing functions take, from a recording and its summary.
pub fn data(recording: &Recording, summary: &Summary) -> Value {
    let header = &recording.header;
    let extra = &header.extra;
    let robots = extra["robots"].as_array().cloned().unwrap_or_default();
    let mut derived = Map::new();
    let mut plots = difference_plots(recording, &extra["statistics"], &mut derived);
    if extra["crowd"].is_null() {
        plots.extend(robots.iter().flat_map(|robot| {
            robot_plots(recording, robot, extra, robots.len() > 1, &mut derived)
        }));
    } else {
        plots.extend(crowd_plots(&robots));
    }
    let mut signals = Map::new();
    for (signal, column) in header.signals.iter().zip(&recording.columns) {
        if is_drawn(&signal.path, &plots) {
            signals.insert(
                signal.path.clone(),
                json!({"unit": signal.unit, "values": rounded(column)}),
            );
        }
    }
    signals.extend(derived);
    // Of a crowd what went wrong is shown: the others stand on one another where they arrived.
    let is_told = |event: &&Event| {
        let of = summary
            .robots
            .iter()
            .find(|robot| robot.name == event.robot);
        extra["crowd"].is_null() || of.is_none_or(|robot| robot.verdict != Outcome::Passed)
    };
    let events: Vec<Value> = recording
        .events
        .iter()
        .filter(is_told)
        .enumerate()
        .map(|(k, event)| {
            let (text, detail) = match event.text.split_once(", ") {
                Some((text, detail)) => (text, json!(detail)),
                None => (event.text.as_str(), Value::Null),
            };
            json!({"n": k + 1, "t": event.t, "robot": event.robot, "text": text, "position": event.position, "detail": detail})
        })
        .collect();
    let metrics: Vec<Value> = if extra["crowd"].is_null() {
        summary
            .robots
            .iter()
            .flat_map(|robot| {
                let prefix = if summary.robots.len() > 1 { format!("{}: ", robot.name) } else { String::new() };
                robot.metrics.iter().map(move |m| {
                    json!({"name": format!("{prefix}{}", m.name), "value": m.value, "unit": m.unit, "note": m.note})
                })
            })
            .collect()
    } else {
        let robots: Vec<&RobotSummary> = summary.robots.iter().collect();
        let told = spreads(&robots).into_iter().map(|spread| {
            let [low, median, high] = spread.quantiles;
            let note = format!("median of all; 90 % in {} … {}", digits(low), digits(high));
            json!({"name": spread.name, "value": median, "unit": spread.unit, "note": note})
        });
        told.collect()
    };
    let title = extra["title"].as_str().filter(|title| !title.is_empty());
    json!({
        "version": header.version,
        "scenario": {
            "name": header.scenario,
            "title": title.unwrap_or(&header.scenario),
            "text": header.scenario_text,
            "file": header.scenario,
            "hash": header.hash,
            "seed": header.seed,
            "step": header.step,
            "integrator": extra["integrator"],
            "recorded_period": header.period,
        },
        "verdict": {
            "status": match summary.verdict {
                Outcome::Passed => "passed",
                Outcome::Failed => "failed",
                Outcome::Stopped => "stopped",
            },
            "sentence": match extra["crowd"].as_u64() {
                None => sentence(summary),
                Some(all) => format!("{} Shown are {} of {all} robots.", sentence(summary), robots.len()),
            },
        },
        "arena": extra["arena"],
        "robots": robots,
        "time": recording.times,
        "signals": signals,
        "events": events,
        "metrics": metrics,
        "statistics": summary.statistics,
        "plots": plots,
        "comparison": Value::Null,
    })
}

/// The reason as a sentence: capital first, full stop last.
fn sentence(summary: &Summary) -> String {
    let mut letters = summary.reason.chars();
    let first: String = letters
        .next()
        .map(|c| c.to_uppercase().to_string())
        .unwrap_or_default();
    let text = first + letters.as_str();
    if text.ends_with('.') {
        text
    } else {
        text + "."
    }
}

/// Seven significant digits: more than any picture shows.
fn rounded(column: &[f64]) -> Vec<f64> {
    let largest = column.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    if !largest.is_finite() {
        return column.to_vec();
    }
    // Below this everything is rounding: a robot that drives straight does not yaw by 1e-18 rad/s.
    if largest < 1e-12 {
        return vec![0.0; column.len()];
    }
    let mut unit = 1.0;
    while unit * largest < 1e6 {
        unit *= 10.0;
    }
    while unit * largest > 1e7 {
        unit /= 10.0;
    }
    column
        .iter()
        .map(|value| (value * unit).round() / unit)
        .collect()
}

/// Whether a report draws the signal: as motion, as force, or in a plot.
fn is_drawn(path: &str, plots: &[Value]) -> bool {
    const MOTION: [&str; 5] = [
        ".pose.x",
        ".pose.y",
        ".pose.yaw",
        ".twist.forward",
        ".twist.left",
    ];
    const WHEEL: [&str; 5] = [
        ".spin_angle",
        ".steering_angle",
        ".force.longitudinal",
        ".force.lateral",
        ".load",
    ];
    let sensed = path.contains(".sensor.");
    let body = MOTION.iter().any(|end| path.ends_with(end)) && !sensed;
    let wheel = path.contains(".wheel.") && WHEEL.iter().any(|end| path.ends_with(end));
    let plotted = || {
        plots.iter().any(|plot| {
            plot["lines"]
                .as_array()
                .is_some_and(|lines| lines.iter().any(|line| line["signal"] == path))
        })
    };
    body || wheel || plotted()
}

/// Plots of the differences that statistics are made of: signals of one unit together.
fn difference_plots(
    recording: &Recording,
    statistics: &Value,
    derived: &mut Map<String, Value>,
) -> Vec<Value> {
    let mut plots: Vec<Value> = Vec::new();
    let texts = |value: &Value| -> Vec<String> {
        let all = value.as_array().into_iter().flatten();
        all.filter_map(|text| text.as_str().map(str::to_owned))
            .collect()
    };
    let signals = texts(&statistics["signals"]);
    for difference in statistics["difference"].as_array().into_iter().flatten() {
        let text = |key: &str| difference[key].as_str().unwrap_or_default();
        // By unit, and what wheels do apart from what the robot does.
        let mut groups: Vec<((String, bool), Vec<Value>)> = Vec::new();
        for signal in &signals {
            let path = |robot: &str| format!("robot.{robot}.{signal}");
            let (of, minus) = (path(text("of")), path(text("minus")));
            let (Some(a), Some(b)) = (recording.column(&of), recording.column(&minus)) else {
                continue;
            };
            let apart: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
            let known = recording.header.signals.iter().find(|s| s.path == of);
            let unit = known.map_or("", |signal| &signal.unit).to_owned();
            let name = format!("difference.{}.{signal}", text("name"));
            derived.insert(
                name.clone(),
                json!({"unit": unit, "values": rounded(&apart)}),
            );
            // The wheel, or the axis.
            let parts: Vec<&str> = signal.split('.').collect();
            let label = match parts.as_slice() {
                ["wheel", wheel, ..] => wheel,
                [.., last] => last,
                [] => "",
            };
            let line = json!({"signal": name, "label": label, "role": "other"});
            let group = (unit, signal.starts_with("wheel."));
            match groups.iter_mut().find(|(known, _)| *known == group) {
                Some((_, lines)) => lines.push(line),
                None => groups.push((group, vec![line])),
            }
        }
        for ((unit, of_wheels), lines) in groups {
            let what = match unit.as_str() {
                _ if of_wheels => "wheels",
                "m" => "position",
                "rad" => "angle",
                "m/s" => "speed",
                "rad/s" => "yaw rate",
                _ => "value",
            };
            let title = format!("{}: {what}", text("name"));
            plots.push(json!({"title": title, "unit": unit, "lines": lines, "limits": []}));
        }
    }
    plots
}

/// How much of the friction a contact force asks for, in percent of μN, to two digits: forces along and
/// across the wheel and its load, N.
pub fn friction_used(along: f64, across: f64, load: f64, friction: f64) -> f64 {
    let demand = appell_model::math::hypot(along, across);
    let limit = (friction * load).max(1e-9);
    (1e4 * demand / limit).round().min(1e7) / 100.0
}

/// Three significant digits.
fn digits(value: f64) -> String {
    let text = format!("{value:.2e}");
    match text.parse::<f64>() {
        Ok(rounded) if (1e-3..1e4).contains(&rounded.abs()) || rounded == 0.0 => {
            rounded.to_string()
        }
        _ => text,
    }
}

/// Plots of a crowd: a line for each robot.
fn crowd_plots(robots: &[Value]) -> Vec<Value> {
    let names: Vec<&str> = robots.iter().filter_map(|r| r["name"].as_str()).collect();
    let plot = |title: &str, unit: &str, field: &str| {
        let line = |name: &&str| json!({"signal": format!("robot.{name}.{field}"), "label": name, "role": "robot"});
        let lines: Vec<Value> = names.iter().map(line).collect();
        json!({"title": title, "unit": unit, "lines": lines, "limits": []})
    };
    vec![
        plot("forward speed", "m/s", "twist.forward"),
        plot("yaw rate", "rad/s", "twist.yaw_rate"),
        plot("distance to the nearest beacon", "m", "clearance"),
    ]
}

/// The plots that matter for a robot and its task.
fn robot_plots(
    recording: &Recording,
    robot: &Value,
    extra: &Value,
    several: bool,
    derived: &mut Map<String, Value>,
) -> Vec<Value> {
    let name = robot["name"].as_str().unwrap_or_default();
    let base = format!("robot.{name}");
    let has = |path: &str| recording.column(&format!("{base}.{path}")).is_some();
    let mut plots = Vec::new();
    let mut plot = |title: &str, unit: &str, lines: Vec<Value>, more: Value| {
        if lines.is_empty() {
            return;
        }
        let title = if several {
            format!("{name}: {title}")
        } else {
            title.to_owned()
        };
        let mut spec = json!({"title": title, "unit": unit, "lines": lines, "limits": []});
        if let (Value::Object(spec), Value::Object(more)) = (&mut spec, more) {
            spec.extend(more);
        }
        plots.push(spec);
    };
    let line = |path: &str, label: &str, role: &str| json!({"signal": format!("{base}.{path}"), "label": label, "role": role});
    let wheels: Vec<&str> = robot["wheels"]
        .as_array()
        .into_iter()
        .flatten()
        .filter(|wheel| wheel["driven"] == true)
        .filter_map(|wheel| wheel["name"].as_str())
        .collect();
    let each_wheel = |field: &str| -> Vec<Value> {
        wheels
            .iter()
            .filter(|wheel| has(&format!("wheel.{wheel}.{field}")))
            .map(|wheel| {
                let role = match *wheel {
                    "left" => "left",
                    "right" => "right",
                    _ => "other",
                };
                line(&format!("wheel.{wheel}.{field}"), wheel, role)
            })
            .collect()
    };
    if !robot["goal"].is_null() {
        plot(
            "clearance to the nearest beacon",
            "m",
            vec![line("clearance", "", "main")],
            json!({"limits": [{"value": 0.0, "label": "touch"}], "mark_min": true}),
        );
    }
    let mut speed = vec![line("twist.forward", "robot", "main")];
    if has("command.forward") {
        speed.push(line("command.forward", "command", "command"));
    }
    // Only wheels with rollers, or steered ones, let a robot move sideways; 5 mm/s is drawn.
    let moves_left = |values: &[f64]| values.iter().any(|value| value.abs() > 0.005);
    if recording
        .column(&format!("{base}.twist.left"))
        .is_some_and(moves_left)
    {
        plot("speed forward", "m/s", speed, json!({}));
        let mut sideways = vec![line("twist.left", "robot", "main")];
        if has("command.left") {
            sideways.push(line("command.left", "command", "command"));
        }
        plot("speed to the left", "m/s", sideways, json!({}));
    } else {
        plot("speed", "m/s", speed, json!({}));
    }
    let mut turning = vec![line("twist.yaw_rate", "robot", "main")];
    if has("command.yaw_rate") {
        turning.push(line("command.yaw_rate", "command", "command"));
    }
    plot("yaw rate", "rad/s", turning, json!({}));
    if has("pose.z") {
        plot(
            "height of the base",
            "m",
            vec![line("pose.z", "", "main")],
            json!({}),
        );
        let tilt = vec![
            line("pose.roll", "roll", "other"),
            line("pose.pitch", "pitch", "main"),
        ];
        plot("roll and pitch", "rad", tilt, json!({}));
    }
    let noise = each_wheel("noise");
    let unit = noise
        .first()
        .and_then(|line| {
            let path = line["signal"].as_str()?;
            recording.header.signals.iter().find(|s| s.path == path)
        })
        .map_or("", |signal| &signal.unit);
    plot("noise on the command", unit, noise, json!({}));
    plot("motor voltage", "V", each_wheel("voltage"), json!({}));
    if has("path.offset") {
        plot(
            "offset from the planned path",
            "mm",
            vec![line("path.offset", "", "main")],
            json!({"scale": 1000.0}),
        );
    }
    for signal in &recording.header.signals {
        let Some(sensor) = signal
            .path
            .strip_prefix(&format!("{base}.sensor."))
            .and_then(|rest| rest.strip_suffix(".error.distance"))
        else {
            continue;
        };
        let mut lines = vec![line(
            &format!("sensor.{sensor}.error.distance"),
            "all",
            "main",
        )];
        for cause in crate::sensor::CAUSES {
            let path = format!("sensor.{sensor}.error.{cause}.distance");
            lines.push(line(&path, cause, "other"));
        }
        plot(
            &format!("error of {sensor} by cause"),
            "m",
            lines,
            json!({}),
        );
    }
    if has("sensor.motion.radius") {
        let radius = vec![line("sensor.motion.radius", "", "main")];
        plot("radius of the motion", "m", radius, json!({}));
    }
    plot("wheel torque", "N·m", each_wheel("torque"), json!({}));
    if wheels
        .iter()
        .all(|wheel| !has(&format!("wheel.{wheel}.torque")))
    {
        plot(
            "wheel rate command",
            "rad/s",
            each_wheel("rate_command"),
            json!({}),
        );
    }
    if let Some(friction) = extra["arena"]["friction"].as_f64() {
        let mut lines = Vec::new();
        for wheel in &wheels {
            let column = |field: &str| recording.column(&format!("{base}.wheel.{wheel}.{field}"));
            let (Some(along), Some(across), Some(load)) = (
                column("force.longitudinal"),
                column("force.lateral"),
                column("load"),
            ) else {
                continue;
            };
            let used: Vec<f64> = along
                .iter()
                .zip(across)
                .zip(load)
                .map(|((along, across), load)| friction_used(*along, *across, *load, friction))
                .collect();
            let path = format!("wheel.{wheel}.friction_used");
            derived.insert(
                format!("{base}.{path}"),
                json!({"unit": "%", "values": used}),
            );
            let role = match *wheel {
                "left" => "left",
                "right" => "right",
                _ => "other",
            };
            lines.push(line(&path, wheel, role));
        }
        plot(
            "friction used by the contact force",
            "% of μN",
            lines,
            json!({"limits": [{"value": 100.0, "label": "slip would begin"}], "mark_max": true}),
        );
    }
    plots
}
