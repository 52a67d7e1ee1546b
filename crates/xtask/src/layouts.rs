//! Task layouts (`appell-layout/1`) through the shipped scenario, controllers and judges.
//!
//! A layout becomes the scenario that a person would write for it; what runs is what `appell run`
//! runs, and the CSV is read off its recording.

use std::fmt::Write;
use std::path::Path;

use appell_sim::record::{Memory, Recording};
use appell_sim::run::{Outcome, Run};
use appell_sim::scenario::{self, Loaded};
use serde::Deserialize;
use serde_json::Value;

/// Period of control and of the rows written, s: voltages are held over it.
const PERIOD: f64 = 0.01;

/// A layout as its file gives it.
#[derive(Clone, Debug, Deserialize)]
pub struct LayoutFile {
    /// Schema of the file.
    pub schema: String,
    /// Kind of task.
    pub task: String,
    /// Width and height, m.
    pub arena: [f64; 2],
    /// Radius of every beacon, m.
    pub beacon_radius: f64,
    /// Positions, m.
    pub beacons: Vec<[f64; 2]>,
    /// Start pose.
    pub start: [f64; 3],
    /// What to do; its keys depend on the task.
    pub goal: Value,
    /// s.
    pub time_limit: f64,
    /// Parameters of the motor-driven two-wheel model.
    pub robot: Robot,
}

/// Parameters of the robot, in the symbols of the two-wheel equations.
#[allow(non_snake_case, missing_docs)]
#[derive(Clone, Debug, Deserialize)]
pub struct Robot {
    pub mass: f64,
    pub com_offset: f64,
    pub inertia_axle: f64,
    pub track: f64,
    pub wheel_radius: f64,
    pub wheel_inertia: f64,
    pub L: f64,
    pub R: f64,
    pub K_M: f64,
    pub K_e: f64,
    pub gear: f64,
    #[serde(default = "one")]
    pub gear_efficiency: f64,
    pub u_max: f64,
    pub collision_radius: f64,
}

fn one() -> f64 {
    1.0
}

/// The scenario for a layout; `extra` is more TOML, such as a `[terrain]` table.
pub fn scenario_text(layout: &LayoutFile, extra: &str) -> Result<String, String> {
    let mut text = String::new();
    let r = &layout.robot;
    let names = |indices: &Value| -> Result<String, String> {
        let list = indices
            .as_array()
            .ok_or("goal: a list of beacons is missing")?;
        let quoted: Result<Vec<String>, String> = list
            .iter()
            .map(|k| {
                k.as_u64()
                    .map(|k| format!("\"b{k}\""))
                    .ok_or_else(|| "goal: an index is missing".to_owned())
            })
            .collect();
        Ok(format!("[{}]", quoted?.join(", ")))
    };
    let number = |key: &str| {
        layout.goal[key]
            .as_f64()
            .ok_or_else(|| format!("goal.{key}: a number is missing"))
    };
    let side = |key: &str, words: [&str; 3]| -> String {
        let sign = layout.goal[key].as_i64().unwrap_or(0).signum() + 1;
        words[sign as usize].to_owned()
    };
    let task = match layout.task.as_str() {
        "homing" => format!(
            "beacon = \"b{}\"\ndistance = {:?}\nspeed = {:?}\nhold = {:?}",
            layout.goal["beacon"]
                .as_u64()
                .ok_or("goal.beacon: an index is missing")?,
            number("d_goal")?,
            number("v_stop")?,
            number("t_hold")?
        ),
        "gate" => format!(
            "beacons = {}\ndirection = \"{}\"\nexit = {:?}",
            names(&layout.goal["pair"])?,
            side("direction", ["first-right", "any", "first-left"]),
            number("d_exit")?
        ),
        "eight" => format!(
            "beacons = {}\nlaps = {}\nclose = {:?}",
            names(&layout.goal["pair"])?,
            layout.goal["laps"].as_u64().unwrap_or(1),
            number("d_close")?
        ),
        "slalom" => format!(
            "chain = {}\nfirst_side = \"{}\"\noffset_max = {:?}",
            names(&layout.goal["chain"])?,
            side("first_side", ["right", "any", "left"]),
            number("s_max")?
        ),
        other => return Err(format!("task {other}: unknown")),
    };
    let half = 0.5 * r.track;
    let inertia_com = r.inertia_axle - r.mass * r.com_offset * r.com_offset;
    let _ = write!(
        text,
        "schema = 1\nname = \"layout\"\n\n[time]\nstep = 0.001\nduration = {:?}\n\n[arena]\nsize = {:?}\n",
        layout.time_limit, layout.arena
    );
    for (k, position) in layout.beacons.iter().enumerate() {
        let _ = write!(
            text,
            "[[arena.beacon]]\nname = \"b{k}\"\nposition = {position:?}\nradius = {:?}\n",
            layout.beacon_radius
        );
    }
    let _ = write!(
        text,
        "\n{extra}\n[[robot]]\nname = \"r\"\npose = {:?}\nlevel = \"rolling\"\ndrive = \"dc-motor\"\n\n\
         [robot.platform]\nschema = 1\nname = \"layout\"\ncollision_radius = {:?}\n\
         body = {{ mass = {:?}, inertia_com = {inertia_com:?}, center_of_mass = [{:?}, 0.0, 0.1] }}\n",
        layout.start, r.collision_radius, r.mass, -r.com_offset
    );
    for (name, y) in [("l", half), ("r", -half)] {
        let _ = write!(
            text,
            "[[robot.platform.wheel]]\nname = \"{name}\"\nmount = [0.0, {y:?}]\nradius = {:?}\nspin_inertia = {:?}\n\
             drive = {{ kind = \"dc-motor\", resistance = {:?}, inductance = {:?}, torque_constant = {:?}, \
             back_emf_constant = {:?}, gear_ratio = {:?}, gear_efficiency = {:?}, voltage_max = {:?} }}\n",
            r.wheel_radius,
            r.wheel_inertia,
            r.R,
            r.L,
            r.K_M,
            r.K_e,
            r.gear,
            r.gear_efficiency,
            r.u_max
        );
    }
    let _ = write!(
        text,
        "\n[robot.controller]\nkind = \"{0}\"\nperiod = {PERIOD}\n\n[robot.task]\nkind = \"{0}\"\n{task}\n\n[record]\nperiod = {PERIOD}\n",
        layout.task
    );
    Ok(text)
}

/// Runs a layout; its recording, verdict and reason.
pub fn run(
    layout: &LayoutFile,
    extra: &str,
    overrides: &[(String, String)],
) -> Result<(Recording, Outcome, String), String> {
    let text = scenario_text(layout, extra)?;
    let loaded: Loaded = scenario::load_text(&text, Path::new("layout.toml"), overrides)
        .map_err(|e| e.to_string())?;
    let mut run = Run::new(&loaded, 0).map_err(|e| e.to_string())?;
    let mut memory = Memory::new();
    let summary = run
        .execute(&mut memory, &mut |_| {})
        .map_err(|e| e.to_string())?;
    Ok((memory.into_recording(), summary.verdict, summary.reason))
}

/// `t,x,y,phi,V,omega,u_l,u_r`: each row's voltages act from its time on.
fn csv(recording: &Recording) -> Option<String> {
    let columns = [
        "pose.x",
        "pose.y",
        "pose.yaw",
        "twist.forward",
        "twist.yaw_rate",
        "wheel.l.voltage",
        "wheel.r.voltage",
    ]
    .map(|path| recording.column(&format!("robot.r.{path}")));
    let mut text = String::from("t,x,y,phi,V,omega,u_l,u_r\n");
    for (k, t) in recording.times.iter().enumerate() {
        let _ = write!(text, "{t}");
        for column in &columns {
            let _ = write!(text, ",{}", (*column)?[k]);
        }
        text.push('\n');
    }
    Some(text)
}

/// Runs every layout of a folder and writes `<stem>.csv`; whether all passed.
pub fn run_folder(folder: &Path, out: &Path) -> std::io::Result<bool> {
    std::fs::create_dir_all(out)?;
    let mut good = true;
    for (stem, text) in crate::json_files(folder)? {
        let value: Value = serde_json::from_str(&text).unwrap_or(Value::Null);
        if value["schema"] != "appell-layout/1" {
            println!("passed over  {stem:28} {}", value["schema"]);
            continue;
        }
        let result = serde_json::from_value::<LayoutFile>(value)
            .map_err(|e| e.to_string())
            .and_then(|layout| run(&layout, "", &[]));
        match result {
            Ok((recording, verdict, reason)) => {
                let rows = csv(&recording).expect("a layout's robot has these signals");
                std::fs::write(out.join(format!("{stem}.csv")), rows)?;
                println!(
                    "{:12} {stem:28} {reason}",
                    format!("{verdict:?}").to_lowercase()
                );
                good &= verdict == Outcome::Passed;
            }
            Err(why) => {
                println!("WRONG        {stem:28} {why}");
                good = false;
            }
        }
    }
    Ok(good)
}
