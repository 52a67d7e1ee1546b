//! `appell inverse`.

use std::path::Path;

use appell_sim::build;
use appell_sim::controller::read_table;
use appell_sim::inverse::{self, Demanded, Motion};
use appell_sim::plan::SpeedLimits;
use appell_sim::record::Recording;
use appell_sim::run::Run;
use appell_sim::scenario::{self, Controller, Loaded, Robot, Terrain};

use crate::arguments::InverseOptions;
use crate::{exit, terminal};

/// Prints and writes what a trajectory demands of a robot.
pub fn inverse(options: &InverseOptions) -> u8 {
    match answer(options) {
        Ok((robot, demanded)) => {
            terminal::print(&summary(&robot, &demanded));
            if let Err(error) = std::fs::write(&options.out, csv(&demanded)) {
                terminal::error(&format!(
                    "{}: cannot be written: {error}",
                    options.out.display()
                ));
                return exit::OUTPUT;
            }
            terminal::print(&format!("table: {}", options.out.display()));
            if demanded.breaches.is_empty() {
                exit::PASSED
            } else {
                exit::FAILED
            }
        }
        Err(problem) => {
            terminal::error(&problem);
            exit::BAD_INPUT
        }
    }
}

fn answer(options: &InverseOptions) -> Result<(String, Demanded), String> {
    let overrides = options.changes.overrides()?;
    let loaded =
        scenario::load(&options.scenario, &overrides).map_err(|error| error.to_string())?;
    let robots = &loaded.scenario.robot;
    let robot = match &options.robot {
        None => &robots[0],
        Some(name) => robots
            .iter()
            .find(|robot| robot.name == *name)
            .ok_or_else(|| {
                let names: Vec<&str> = robots.iter().map(|robot| robot.name.as_str()).collect();
                format!("--robot: must be one of {}, got {name}", names.join(", "))
            })?,
    };
    if robot.level == scenario::Level::Slip {
        return Err(format!(
            "robot.{}.level: must be \"rolling\", got \"slip\"\n  hint: a motion has its torques where wheels roll; add --level rolling",
            robot.name
        ));
    }
    if let Terrain::Uneven { .. } = loaded.scenario.terrain {
        return Err("terrain.kind: must be \"flat\" or \"plane\", got \"uneven\"\n  hint: a motion has its torques on even ground".into());
    }
    let motions = match &options.of {
        Some(file) => from_file(file, options, robot)?,
        None => from_task(&loaded, robot)?,
    };
    let ground = build::ground(&loaded.scenario.terrain);
    let friction = loaded.scenario.terrain.friction();
    let file = robot.platform.as_ref().ok_or("the robot has no platform")?;
    let platform = build::platform(file, build::DriveModel::AsBuilt, ground.gravity_normal)
        .map_err(|error| format!("{error:?}"))?;
    let demanded = inverse::demanded(&platform, ground, friction, &motions);
    Ok((robot.name.clone(), demanded))
}

/// The planned path of the robot's task, driven within the limits of its controller.
fn from_task(loaded: &Loaded, robot: &Robot) -> Result<Vec<Motion>, String> {
    let hint = "\n  hint: give a trajectory with --of FILE";
    let Some(tuning) = robot.controller.as_ref().and_then(Controller::follower) else {
        return Err(format!(
            "robot.{}.controller: must plan a path, got one that does not{hint}",
            robot.name
        ));
    };
    let run = Run::new(loaded, 0).map_err(|error| error.to_string())?;
    let index = loaded
        .scenario
        .robot
        .iter()
        .position(|other| other.name == robot.name);
    let path = index
        .and_then(|k| run.paths[k].as_ref())
        .ok_or_else(|| format!("robot.{}.task: has no path{hint}", robot.name))?;
    let limits = SpeedLimits {
        speed: tuning.speed,
        acceleration: tuning.acceleration,
        lateral_acceleration: tuning.lateral_acceleration,
        yaw_rate: tuning.yaw_rate,
    };
    Ok(inverse::along(path, &limits))
}

/// A recording of the robot, or a table with t, x, y and yaw.
fn from_file(file: &Path, options: &InverseOptions, robot: &Robot) -> Result<Vec<Motion>, String> {
    let named = |problem: String| format!("{}: {problem}", file.display());
    let prefix = format!("robot.{}.pose", robot.name);
    let is_table = file.extension().is_some_and(|extension| extension == "csv");
    let recorded = match Recording::read(file) {
        Ok(recording) if recording.column(&format!("{prefix}.x")).is_some() => Some(recording),
        Ok(_) if !is_table => return Err(named(format!("must hold the signal {prefix}.x"))),
        Err(error) if !is_table => return Err(error.to_string()),
        // A CSV that is no recording of this robot is a table of poses.
        Ok(_) | Err(_) => None,
    };
    let (times, x, y, yaw) = match recorded {
        Some(recording) => {
            let column = |axis: &str| {
                let path = format!("{prefix}.{axis}");
                recording
                    .column(&path)
                    .map(<[f64]>::to_vec)
                    .unwrap_or_default()
            };
            let poses = (column("x"), column("y"), column("yaw"));
            (recording.times.clone(), poses.0, poses.1, Some(poses.2))
        }
        None => {
            let (times, x) = read_table(file, "x").map_err(named)?;
            let (_, y) = read_table(file, "y").map_err(named)?;
            let yaw = match options.ahead {
                Some(_) => None,
                None => Some(read_table(file, "yaw").map_err(named)?.1),
            };
            (times, x, y, yaw)
        }
    };
    match (options.ahead, yaw) {
        (Some(ahead), _) => inverse::led(&times, &x, &y, ahead, robot.pose[2]),
        (None, Some(yaw)) => inverse::sampled(&times, &x, &y, &yaw),
        (None, None) => Err("must have a column \"yaw\"".into()),
    }
    .map_err(named)
}

/// Peak of each signal, and the breaches.
fn summary(robot: &str, demanded: &Demanded) -> String {
    let end = demanded.times.last().copied().unwrap_or(0.0);
    let mut out = format!(
        "{robot}: {} instants over {end:.3} s\n",
        demanded.times.len()
    );
    for (signal, values) in &demanded.columns {
        if signal.path.starts_with("pose.") || signal.path.ends_with("spin_rate") {
            continue;
        }
        let (low, high) = values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &value| {
                (low.min(value), high.max(value))
            });
        out += &format!(
            "  {:32} {:>12} … {:>12} {}\n",
            signal.path,
            terminal::number(low),
            terminal::number(high),
            signal.unit
        );
    }
    if demanded.breaches.is_empty() {
        out += "  within all limits\n";
    }
    for breach in &demanded.breaches {
        let [x, y] = breach.position;
        out += &format!(
            "  beyond a limit from t = {:.3} s at ({x:.3}, {y:.3}): {}\n",
            breach.t, breach.text
        );
    }
    out
}

fn csv(demanded: &Demanded) -> String {
    let names: Vec<&str> = demanded
        .columns
        .iter()
        .map(|(signal, _)| signal.path.as_str())
        .collect();
    let mut text = format!("t,{}\n", names.join(","));
    for (k, t) in demanded.times.iter().enumerate() {
        text += &t.to_string();
        for (_, values) in &demanded.columns {
            text += &format!(",{}", values[k]);
        }
        text.push('\n');
    }
    text
}
