//! `appell replay`: a scenario under the commands of a bag of ROS 2, beside the odometry of the bag.

use std::fmt::Write;

use appell_sim::replay::{self, Choice, Comparison};
use appell_sim::scenario;

use crate::arguments::{RecordFormat, ReplayOptions, RunOptions};
use crate::{exit, run, terminal};

/// Drives the scenario, compares and prints.
pub fn replay(options: &ReplayOptions) -> u8 {
    match compared(options) {
        Ok(comparison) => {
            terminal::print(&match options.json {
                true => serde_json::to_string_pretty(&comparison).expect("plain data"),
                false => table(&comparison),
            });
            exit::PASSED
        }
        Err((code, problem)) => {
            if !problem.is_empty() {
                terminal::error(&problem);
            }
            code
        }
    }
}

fn compared(options: &ReplayOptions) -> Result<Comparison, (u8, String)> {
    let bad = |problem: String| (exit::BAD_INPUT, problem);
    if options.timeout.is_nan() || options.timeout <= 0.0 {
        return Err(bad(format!(
            "--cmd-vel-timeout: must be > 0 s, got {}",
            options.timeout
        )));
    }
    let overrides = options.changes.overrides().map_err(bad)?;
    let loaded = scenario::load(&options.scenario, &overrides);
    let loaded = loaded.map_err(|diagnostics| bad(diagnostics.to_string()))?;
    let choice = Choice {
        commands: options.cmd_vel.clone(),
        odometry: options.odom.clone(),
        robot: options.robot.clone(),
        timeout: options.timeout,
    };
    let robot = replay::robot_of(&loaded.scenario, &choice).map_err(bad)?;
    let recorded = replay::recorded(&options.bag, &choice).map_err(bad)?;
    let driven = replay::driven(&loaded.scenario, robot, &recorded, options.timeout);
    let loaded = scenario::load_text(&driven.to_toml(), &loaded.file, &Vec::new());
    let loaded = loaded.map_err(|diagnostics| bad(diagnostics.to_string()))?;
    let folder = run::folder_or(options.out.as_ref(), &loaded.scenario.name);
    let quiet = RunOptions {
        scenarios: vec![options.scenario.clone()],
        changes: options.changes.clone(),
        out: None,
        record: vec![RecordFormat::Ros2],
        csv: false,
        parquet: false,
        json: false,
        no_report: options.no_report,
        no_recording: false,
        trust_native: false,
        precision: crate::arguments::Precision::F64,
        watch: false,
        pace: None,
    };
    run::driven(&loaded, &folder, &quiet).map_err(|failure| (failure.code, failure.text))?;
    let own = Choice {
        commands: None,
        odometry: None,
        robot: None,
        timeout: options.timeout,
    };
    let simulated = replay::recorded(&folder.join("ros2"), &own);
    let simulated = simulated.map_err(|problem| (exit::INTERNAL, problem))?;
    let (comparison, rows) =
        replay::compare(&recorded.odometry, &simulated.odometry).map_err(bad)?;
    let mut table =
        "t,recorded.x,recorded.y,recorded.yaw,simulated.x,simulated.y,simulated.yaw\n".to_owned();
    for row in rows {
        let cells: Vec<String> = row.iter().map(f64::to_string).collect();
        let _ = writeln!(table, "{}", cells.join(","));
    }
    let json = serde_json::to_string_pretty(&comparison).expect("plain data") + "\n";
    for (name, text) in [("comparison.csv", table), ("comparison.json", json)] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| {
            (
                exit::OUTPUT,
                format!("{}: cannot be written: {error}", path.display()),
            )
        })?;
    }
    terminal::remark(&format!(
        "commands of {}, odometry of {}; written to {}",
        recorded.topics[0],
        recorded.topics[1],
        folder.display()
    ));
    Ok(comparison)
}

fn table(comparison: &Comparison) -> String {
    let degrees = f64::to_degrees;
    format!(
        "{} poses over {:.3} s and {:.3} m, simulated against recorded\n\n  \
         position   rms {:.6} m   largest {:.6} m at {:.3} s   at the end {:.6} m\n  \
         heading    rms {:.6}°   largest {:.6}°   at the end {:.6}°",
        comparison.poses,
        comparison.duration,
        comparison.distance,
        comparison.position_rms,
        comparison.position_max,
        comparison.position_max_at,
        comparison.position_end,
        degrees(comparison.yaw_rms),
        degrees(comparison.yaw_max),
        degrees(comparison.yaw_end),
    )
}
