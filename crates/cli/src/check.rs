//! `appell check`.

use std::io::Read;
use std::path::Path;

use appell_sim::batch::Crew;
use appell_sim::crowd::{Crowd, is_crowd};
use appell_sim::design::{Design, design, equations};
use appell_sim::run::Run;
use appell_sim::scenario;

use crate::arguments::{CheckOptions, Form};
use crate::{exit, terminal};

/// Checks a file and prints what its robots amount to.
pub fn check(options: &CheckOptions) -> u8 {
    let overrides = match options.changes.overrides() {
        Ok(overrides) => overrides,
        Err(problem) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    if is_robot(&options.file) {
        if !overrides.is_empty() {
            terminal::error(&format!(
                "{}: must be a scenario where values are set, got a robot file\n  hint: set \
                 robot.NAME.platform.… of a scenario that names the robot",
                options.file.display()
            ));
            return exit::BAD_INPUT;
        }
        return match scenario::load_robot(&options.file) {
            Ok(platform) => {
                let report = text(
                    &platform.name,
                    &platform.description,
                    &design(&platform, 9.81),
                ) + &equations_of(&platform, 9.81, options.equations);
                terminal::print(&format!(
                    "{}: a valid robot file\n\n{report}",
                    options.file.display()
                ));
                exit::PASSED
            }
            Err(diagnostics) => {
                terminal::error(&diagnostics.to_string());
                exit::BAD_INPUT
            }
        };
    }
    let built = scenario::load(&options.file, &overrides).and_then(|loaded| {
        let header = match is_crowd(&loaded.scenario) {
            true => Crowd::new(&loaded, Crew::default())?.header,
            false => Run::new(&loaded, 0)?.header,
        };
        Ok((header.signals.len(), loaded))
    });
    match built {
        Ok((signals, loaded)) => {
            let mut out = format!(
                "{}: a valid scenario with {signals} signals\n",
                options.file.display()
            );
            let gravity = loaded.scenario.terrain.gravity();
            for robot in &loaded.scenario.robot {
                if let Some(platform) = &robot.platform {
                    out.push('\n');
                    out.push_str(&text(
                        &robot.name,
                        &platform.description,
                        &design(platform, gravity),
                    ));
                    out.push_str(&equations_of(platform, gravity, options.equations));
                }
            }
            terminal::print(&out);
            exit::PASSED
        }
        Err(diagnostics) => {
            terminal::error(&diagnostics.to_string());
            exit::BAD_INPUT
        }
    }
}

/// Whether the file has the wheels of a robot file and not the robots of a scenario.
fn is_robot(file: &Path) -> bool {
    // More than a scenario may hold is not read here either.
    let mut text = String::new();
    let read =
        std::fs::File::open(file).and_then(|open| open.take(1 << 20).read_to_string(&mut text));
    if read.is_err() {
        return false;
    }
    let has = |table: &str| {
        text.lines()
            .any(|line| line.trim_start().starts_with(table))
    };
    has("[[wheel]]") && !has("[[robot]]") && !has("[arena")
}

/// The equations of a robot, if they were asked for.
fn equations_of(platform: &scenario::Platform, gravity: f64, form: Option<Form>) -> String {
    match form {
        None => String::new(),
        Some(Form::Text) => equations(platform, gravity).text(),
        Some(Form::Latex) => equations(platform, gravity).latex() + "\n",
    }
}

fn text(name: &str, description: &str, design: &Design) -> String {
    let mut out = format!("{name}: {description}\n");
    for finding in &design.findings {
        let row = format!(
            "  {:34} {:24} {}",
            finding.name, finding.value, finding.note
        );
        out.push_str(row.trim_end());
        out.push('\n');
    }
    for warning in &design.warnings {
        out.push_str(&format!("  warning: {warning}\n"));
    }
    out
}
