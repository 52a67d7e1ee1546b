//! Worlds repeat: runs, robots side by side, saved states; and what they do is physics.

use std::path::{Path, PathBuf};

use appell_sim::record::{Memory, Recording};
use appell_sim::run::{Outcome, Run, Summary};
use appell_sim::scenario::{self, Loaded};

fn scenario_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../scenarios")
        .join(name)
}

fn load(name: &str, set: &[(&str, &str)]) -> Loaded {
    let overrides: Vec<(String, String)> = set
        .iter()
        .map(|(a, b)| ((*a).into(), (*b).into()))
        .collect();
    scenario::load(&scenario_file(name), &overrides).unwrap_or_else(|e| panic!("{e}"))
}

fn execute(loaded: &Loaded) -> (Recording, Summary) {
    let mut run = Run::new(loaded, 0).unwrap_or_else(|e| panic!("{e}"));
    let mut memory = Memory::new();
    let summary = run.execute(&mut memory, &mut |_| {}).expect("runs");
    (memory.into_recording(), summary)
}

fn bits(recording: &Recording) -> Vec<Vec<u64>> {
    recording
        .columns
        .iter()
        .map(|c| c.iter().map(|v| v.to_bits()).collect())
        .collect()
}

#[test]
fn invariant_a_run_repeats_to_the_bit() {
    let loaded = load("noisy.toml", &[]);
    let (a, b) = (execute(&loaded).0, execute(&loaded).0);
    assert_eq!(bits(&a), bits(&b));
    let other = load("noisy.toml", &[("seed", "99")]);
    assert_ne!(bits(&a), bits(&execute(&other).0), "the seed matters");
}

#[test]
fn invariant_a_second_robot_changes_no_bit_of_the_first() {
    let loaded = load("two-robots.toml", &[]);
    assert!(loaded.scenario.robot.len() >= 2);
    let mut alone = loaded.clone();
    alone.scenario.robot.truncate(1);
    let name = &loaded.scenario.robot[0].name;
    let (both, _) = execute(&loaded);
    let (one, _) = execute(&alone);
    let mut compared = 0;
    for (k, signal) in one.header.signals.iter().enumerate() {
        if !signal.path.starts_with(&format!("robot.{name}.")) {
            continue;
        }
        let other = both.column(&signal.path).expect("the same signal");
        // The run with both may last longer; the first rows must be the same.
        for (row, value) in one.columns[k].iter().enumerate().take(one.times.len() - 1) {
            assert_eq!(
                value.to_bits(),
                other[row].to_bits(),
                "{} row {row}",
                signal.path
            );
            compared += 1;
        }
    }
    assert!(compared > 1000);
}

/// Ticks between two saves.
const APART: u64 = 4;
/// Scenarios whose worlds are saved, with what is changed in them.
const SAVED: [(&str, &[(&str, &str)]); 2] = [
    ("noisy.toml", &[]),
    ("coast.toml", &[("time.integrator", "\"adaptive\"")]),
];

fn step(world: &mut appell_sim::world::World, recorder: &mut Memory, ticks: u64) {
    for _ in 0..ticks {
        world.step(recorder).expect("steps");
    }
}

fn recorder(run: &Run) -> Memory {
    let mut memory = Memory::new();
    appell_sim::record::Recorder::begin(&mut memory, &run.header).expect("opens");
    memory
}

/// A world saved at 1000 ticks: each state, restored in another process, gives the next one bit for
/// bit, and so by induction the whole run.
#[test]
fn invariant_saved_worlds_go_on_to_the_bit() {
    for (number, (name, set)) in SAVED.into_iter().enumerate() {
        let loaded = load(name, set);
        let mut run = Run::new(&loaded, 0).expect("valid");
        let mut memory = recorder(&run);
        let mut states = Vec::new();
        for _ in 0..=1000 {
            states.push(run.world.save());
            step(&mut run.world, &mut memory, APART);
        }
        let file =
            std::env::temp_dir().join(format!("appell-states-{number}-{}", std::process::id()));
        std::fs::write(&file, serde_json::to_vec(&states).expect("plain data")).expect("written");
        let child = std::process::Command::new(std::env::current_exe().expect("this test"))
            .args(["--exact", "restored_in_another_process", "--nocapture"])
            .env("APPELL_STATES", &file)
            .env("APPELL_SCENARIO", number.to_string())
            .output()
            .expect("runs");
        let text = String::from_utf8_lossy(&child.stdout).into_owned()
            + &String::from_utf8_lossy(&child.stderr);
        std::fs::remove_file(&file).expect("removed");
        assert!(
            child.status.success() && text.contains("1000 states went on"),
            "{name}: {text}"
        );
        let mut other = Run::new(&load("slalom.toml", &[]), 0).expect("valid").world;
        assert!(
            other.restore(&states[0]).is_err(),
            "a foreign state is refused"
        );
    }
}

/// The other process of the test above; by itself it has nothing to restore.
#[test]
fn restored_in_another_process() {
    let (Ok(file), Ok(number)) = (
        std::env::var("APPELL_STATES"),
        std::env::var("APPELL_SCENARIO"),
    ) else {
        return;
    };
    let states: Vec<Vec<u8>> =
        serde_json::from_slice(&std::fs::read(file).expect("read")).expect("states");
    let (name, set) = SAVED[number.parse::<usize>().expect("a number")];
    let loaded = load(name, set);
    for pair in states.windows(2) {
        let mut run = Run::new(&loaded, 0).expect("valid");
        let mut memory = recorder(&run);
        run.world.restore(&pair[0]).expect("fits");
        step(&mut run.world, &mut memory, APART);
        assert!(
            run.world.save() == pair[1],
            "from tick {}",
            run.world.tick()
        );
    }
    println!("{} states went on", states.len() - 1);
}

/// Every shipped scenario does what it says at every level that it can run at.
#[test]
fn invariant_shipped_scenarios_pass() {
    let mut count = 0;
    for entry in std::fs::read_dir(scenario_file(""))
        .expect("scenarios")
        .flatten()
    {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !name.ends_with(".toml") {
            continue;
        }
        let loaded = load(&name, &[]);
        let tasks = loaded
            .scenario
            .robot
            .iter()
            .filter(|r| r.task.is_some())
            .count();
        let levels: &[&[(&str, &str)]] = if tasks == 0 {
            &[&[]]
        } else {
            &[
                &[("robot.*.level", "\"kinematic\"")],
                &[
                    ("robot.*.level", "\"rolling\""),
                    ("robot.*.drive", "\"torque\""),
                ],
                &[
                    ("robot.*.level", "\"rolling\""),
                    ("robot.*.drive", "\"dc-motor\""),
                ],
            ]
        };
        for set in levels {
            let (_, summary) = execute(&load(&name, set));
            let wanted = if tasks == 0 {
                Outcome::Stopped
            } else {
                Outcome::Passed
            };
            assert_eq!(
                summary.verdict, wanted,
                "{name} {set:?}: {}",
                summary.reason
            );
            assert!(summary.error.is_none(), "{name}: {:?}", summary.error);
            count += 1;
        }
    }
    assert!(count >= 24, "{count} runs");
}

#[test]
fn invariant_a_parked_robot_keeps_its_pose_to_the_bit() {
    let (recording, _) = execute(&load("parked.toml", &[]));
    for axis in ["x", "y", "yaw"] {
        let signal = recording
            .header
            .signals
            .iter()
            .find(|s| s.path.ends_with(&format!("pose.{axis}")))
            .expect("a pose");
        let column = recording.column(&signal.path).expect("recorded");
        assert!(
            column.iter().all(|v| v.to_bits() == column[0].to_bits()),
            "{}",
            signal.path
        );
    }
}

/// The ledger of every shipped scenario with the integrator that it asks for, beside the adaptive one.
#[test]
fn invariant_energy_ledger_of_the_slalom() {
    for (integrator, tolerance) in [("auto", 1e-6), ("adaptive", 1e-10)] {
        let set = [("time.integrator", integrator), ("time.tolerance", "1e-11")];
        let (_, summary) = execute(&load("slalom.toml", &set));
        let metric = |name: &str| {
            summary.robots[0]
                .metrics
                .iter()
                .find(|m| m.name == name)
                .expect("a metric")
                .value
        };
        let (residual, supplied) = (metric("energy ledger residual"), metric("energy supplied"));
        assert!(
            residual.abs() <= tolerance * supplied,
            "{integrator}: {residual:e} of {supplied} J"
        );
    }
}

#[test]
fn closed_form_blog_circle() {
    // Twist (0.2 m/s, 1 rad/s) on a track of 0.2 m and wheels of 0.04 m: 2.5 and 7.5 rad/s.
    let (recording, _) = execute(&load("circle.toml", &[("robot.*.level", "\"kinematic\"")]));
    let last = |end: &str| {
        let signal = recording
            .header
            .signals
            .iter()
            .find(|s| s.path.ends_with(end))
            .expect("a signal");
        *recording
            .column(&signal.path)
            .expect("recorded")
            .last()
            .expect("rows")
    };
    assert!((last("wheel.left.spin_rate") - 2.5).abs() < 1e-12);
    assert!((last("wheel.right.spin_rate") - 7.5).abs() < 1e-12);
}

/// A servo that saturates lets its integral go again: a jump of the command is reached in the end.
#[test]
fn invariant_servo_does_not_wind_up() {
    let set = [
        ("robot.*.servo.period", "0.066"),
        (
            "robot.*.controller.channel.forward.signal",
            "{ kind = \"constant\", value = 0.2 }",
        ),
        (
            "robot.*.controller.channel.yaw_rate.signal",
            "{ kind = \"constant\", value = 1.0 }",
        ),
    ];
    let (recording, _) = execute(&load("circle.toml", &set));
    let end = |end: &str| {
        let signal = recording
            .header
            .signals
            .iter()
            .find(|s| s.path.ends_with(end))
            .expect("a signal");
        *recording
            .column(&signal.path)
            .expect("recorded")
            .last()
            .expect("rows")
    };
    // The integral removes the error; a percent is left after the time of the scenario.
    assert!(
        (end("twist.forward") - 0.2).abs() < 2e-3,
        "{}",
        end("twist.forward")
    );
    assert!(
        (end("twist.yaw_rate") - 1.0).abs() < 1e-2,
        "{}",
        end("twist.yaw_rate")
    );
}
