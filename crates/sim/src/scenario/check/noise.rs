//! Rules of noise, of the feedback that answers it, and of statistics.

use std::path::Path;

use super::super::*;
use super::{Checker, number};

/// Noise on commands: of wheels that are driven, each once, from a distribution or a file; and the
/// feedback that answers it.
pub(super) fn check_wheel_noise(c: &mut Checker, robot: &Robot, folder: &Path) {
    let base = format!("robot.{}.wheel_noise", robot.name);
    let names = robot.wheel_noise.iter().map(|noise| noise.wheel.as_str());
    c.unique(&base, "wheel", names);
    let wheels: &[Wheel] = robot.platform.as_ref().map_or(&[], |p| &p.wheel);
    let driven: Vec<&str> = wheels
        .iter()
        .filter(|wheel| wheel.drive != Drive::None)
        .map(|wheel| wheel.name.as_str())
        .collect();
    if !robot.wheel_noise.is_empty() && robot.controller.is_none() {
        c.refuse(
            base.clone(),
            "must go with a controller, whose commands it is added to, got none",
            "add [robot.controller]",
        );
    }
    for noise in &robot.wheel_noise {
        let path = |field: &str| format!("{base}.{}.{field}", noise.wheel);
        if !driven.contains(&noise.wheel.as_str()) {
            c.refuse(
                path("wheel"),
                format!("must name a driven wheel, got \"{}\"", noise.wheel),
                &format!("there are: {}", driven.join(", ")),
            );
        }
        c.finite(path("mean"), noise.mean);
        c.not_negative(path("std"), noise.std);
        match (&noise.file, &noise.column) {
            (None, None) => {}
            (Some(file), Some(column)) => {
                if noise.mean != 0.0 || noise.std != 0.0 {
                    c.refuse(
                        path("file"),
                        "must stand alone, got a mean or a standard deviation beside it",
                        "take the noise from the file or from a distribution",
                    );
                }
                if let Err(problem) = crate::controller::read_table(&folder.join(file), column) {
                    c.refuse(
                        path("file"),
                        problem,
                        "a CSV with a header row; its first column is time in s",
                    );
                }
            }
            (file, _) => {
                let missing = if file.is_some() { "column" } else { "file" };
                c.refuse(
                    path(missing),
                    "is missing",
                    "noise from a file needs both `file` and `column`",
                );
            }
        }
    }
    for (field, value) in [
        ("rate_feedback", robot.servo.rate_feedback),
        ("angle_feedback", robot.servo.angle_feedback),
    ] {
        let path = format!("robot.{}.servo.{field}", robot.name);
        c.not_negative(path.clone(), value);
        if value > 0.0 && robot.level != Level::Kinematic {
            c.refuse(
                path,
                "must be 0 but at level \"kinematic\"",
                "at other levels bandwidth and integral_time make the loop",
            );
        }
    }
    let periods = robot
        .controllers()
        .map(|(_, controller)| controller.period());
    let own = periods.reduce(f64::max).unwrap_or(0.0);
    let period = robot.servo.period.unwrap_or(own);
    let (rate, angle) = (robot.servo.rate_feedback, robot.servo.angle_feedback);
    // The loop e' = −K_P e − K_I T Σ e decays for K_P < 1 and K_I T < 2 (1 − K_P).
    if rate.max(angle) > 0.0 && (rate >= 1.0 || angle * period >= 2.0 * (1.0 - rate)) {
        c.refuse(
            format!("robot.{}.servo.angle_feedback", robot.name),
            format!(
                "must be less than 2 (1 - rate_feedback) / period, and rate_feedback less than 1, got {} and {} at {period} s",
                number(angle),
                number(rate)
            ),
            "beyond that the wheels swing up",
        );
    }
}

/// Statistics: differences of robots that there are, in signals that both have.
pub(super) fn check_statistics(c: &mut Checker, scenario: &Scenario, statistics: &Statistics) {
    let robots: Vec<&str> = scenario.robot.iter().map(|r| r.name.as_str()).collect();
    c.require(
        statistics.decimals <= 15,
        "statistics.decimals".into(),
        "at most 15",
        statistics.decimals,
    );
    for (list, length) in [
        ("signals", statistics.signals.len()),
        ("difference", statistics.difference.len()),
    ] {
        if length == 0 {
            c.refuse(
                format!("statistics.{list}"),
                "must have at least one entry",
                "a table has signals as rows and is a difference of two robots",
            );
        }
    }
    let names: Vec<&str> = statistics
        .difference
        .iter()
        .map(|difference| difference.name.as_str())
        .collect();
    c.unique("statistics.difference", "name", names.iter().copied());
    let ratios = statistics.ratio.iter().map(|ratio| ratio.name.as_str());
    c.unique("statistics.ratio", "name", ratios.clone());
    for name in names.iter().copied().chain(ratios) {
        let plain = !name.trim().is_empty() && !name.chars().any(char::is_control);
        c.require(
            plain && name.chars().count() <= 80,
            "statistics".into(),
            "given names of 1 to 80 printable characters",
            format!("{name:?}"),
        );
    }
    let mut known = |path: String, name: &str, all: &[&str], what: &str| {
        if !all.contains(&name) {
            c.refuse(
                path,
                format!("must name a {what}, got \"{name}\""),
                &format!("there are: {}", all.join(", ")),
            );
        }
    };
    for difference in &statistics.difference {
        let path = |field: &str| format!("statistics.difference.{}.{field}", difference.name);
        known(path("of"), &difference.of, &robots, "robot");
        known(path("minus"), &difference.minus, &robots, "robot");
    }
    let signals: Vec<&str> = statistics.signals.iter().map(String::as_str).collect();
    for ratio in &statistics.ratio {
        let path = |field: &str| format!("statistics.ratio.{}.{field}", ratio.name);
        known(path("of"), &ratio.of, &names, "difference");
        known(path("by"), &ratio.by, &names, "difference");
        for signal in &ratio.signals {
            known(path("signals"), signal, &signals, "signal of the tables");
        }
    }
}
