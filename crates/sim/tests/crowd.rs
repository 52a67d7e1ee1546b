//! Robots by count: each is a trial by itself, whatever carries it.

use std::path::{Path, PathBuf};

use appell_sim::batch::{Batch, Crew};
use appell_sim::crowd::{Crowd, MOTION};
use appell_sim::record::{Memory, Recording};
use appell_sim::run::{Run, Summary};
use appell_sim::scenario::{self, Vary};

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../scenarios")
        .join(name)
}

fn set(changes: &[(&str, &str)]) -> Vec<(String, String)> {
    let owned = |&(path, value): &(&str, &str)| (path.to_owned(), value.to_owned());
    changes.iter().map(owned).collect()
}

fn crowd(changes: &[(&str, &str)], threads: usize, lanes: usize) -> (Recording, Summary) {
    let loaded = scenario::load(&shipped("crowd.toml"), &set(changes));
    let loaded = loaded.unwrap_or_else(|error| panic!("{error}"));
    let crew = Crew { threads, lanes };
    let mut crowd = Crowd::new(&loaded, crew).unwrap_or_else(|error| panic!("{error}"));
    let mut memory = Memory::new();
    let summary = crowd.execute(&mut memory, &mut |_| {}).expect("runs");
    (memory.into_recording(), summary)
}

fn alone(mut run: Run) -> (Recording, Summary) {
    let mut memory = Memory::new();
    let summary = run.execute(&mut memory, &mut |_| {}).expect("runs");
    (memory.into_recording(), summary)
}

/// Columns of one robot until it left the run, bit for bit, less the last row where that is off the
/// grid of the record.
fn assert_same(crowd: &Recording, name: &str, own: &Recording, own_name: &str, fields: &[&str]) {
    let rows = own.times.len() - 1;
    for field in fields {
        let column = |recording: &Recording, name: &str| -> Vec<u64> {
            let path = format!("robot.{name}.{field}");
            let values = recording.column(&path).unwrap_or_else(|| panic!("{path}"));
            values[..rows].iter().map(|value| value.to_bits()).collect()
        };
        assert_eq!(column(crowd, name), column(own, own_name), "{name} {field}");
    }
}

#[test]
fn invariant_a_robot_of_a_count_is_a_trial_of_a_batch() {
    const COUNT: &str = "11";
    let (recording, summary) = crowd(&[("robot.tri.count", COUNT)], 0, 8);
    let loaded = scenario::load(&shipped("crowd.toml"), &[]).expect("valid");
    let vary: Vec<Vary> = loaded.scenario.robot[0]
        .vary
        .iter()
        .map(|vary| Vary {
            path: format!("robot.tri.{}", vary.path),
            ..vary.clone()
        })
        .collect();
    let single = set(&[("robot.tri.count", "1"), ("robot.tri.vary", "[]")]);
    let batch = Batch::new(&shipped("crowd.toml"), &single, Some(11), &vary, None).expect("valid");
    for trial in [0, 3, 7, 8, 10] {
        let scenario = batch.scenario(0, trial).expect("a trial");
        let (own, told) = alone(Run::new(&scenario, trial).expect("a trial"));
        let name = format!("tri-{trial}");
        assert_same(&recording, &name, &own, "tri", &MOTION);
        let robot = &summary.robots[usize::try_from(trial).expect("small")];
        assert_eq!(robot.name, name);
        assert_eq!(robot.reason, told.robots[0].reason);
        assert_eq!(robot.metrics, told.robots[0].metrics);
    }
}

#[test]
fn invariant_a_crowd_has_the_same_bits_by_any_crew() {
    let changes = [("robot.tri.count", "11"), ("time.duration", "3.0")];
    let (first, told) = crowd(&changes, 1, 1);
    assert_eq!(first.times.len(), 301);
    assert_eq!(first.columns.len(), 11 * MOTION.len());
    for (threads, lanes) in [(1, 4), (2, 8), (3, 8)] {
        let (other, again) = crowd(&changes, threads, lanes);
        assert_eq!(first.times, other.times);
        assert_eq!(
            first.columns, other.columns,
            "{threads} threads, {lanes} lanes"
        );
        assert_eq!(first.events, other.events);
        assert_eq!(told, again);
    }
}

#[test]
fn invariant_a_robot_beside_a_crowd_is_recorded_whole_and_moves_the_same() {
    let text = std::fs::read_to_string(shipped("crowd.toml")).expect("readable");
    let beside = text.replacen("count = 100", "count = 3", 1)
        + r#"
[[robot]]
name = "lone"
file = "../robots/three-wheeler.toml"
pose = [1.0, 2.0, 0.0]

[robot.controller]
kind = "homing"

[robot.task]
kind = "homing"
beacon = "dock"
distance = 0.5
"#;
    let load = |text: &str| {
        let loaded = scenario::load_text(text, &shipped("crowd.toml"), &[]);
        loaded.unwrap_or_else(|error| panic!("{error}"))
    };
    let loaded = load(&beside);
    let mut crowd = Crowd::new(&loaded, Crew::default()).expect("builds");
    assert_eq!(crowd.count(), 4);
    let mut memory = Memory::new();
    crowd.execute(&mut memory, &mut |_| {}).expect("runs");
    let recording = memory.into_recording();
    let (head, rest) = beside.split_once("[[robot]]").expect("robots");
    let lone = &rest[rest.find("[[robot]]").expect("a second one")..];
    let (own, _) = alone(Run::new(&load(&format!("{head}{lone}")), 0).expect("builds"));
    let paths = own.header.signals.iter();
    let fields: Vec<&str> = paths
        .filter_map(|signal| signal.path.strip_prefix("robot.lone."))
        .collect();
    assert!(fields.len() > 40, "all signals are there");
    assert_same(&recording, "lone", &own, "lone", &fields);
}

#[test]
fn refusal_of_counts() {
    let refused = |changes: &[(&str, &str)]| -> String {
        let loaded = match scenario::load(&shipped("crowd.toml"), &set(changes)) {
            Ok(loaded) => loaded,
            Err(error) => return error.to_string(),
        };
        match Crowd::new(&loaded, Crew::default()) {
            Ok(_) => panic!("{changes:?} is accepted"),
            Err(error) => error.to_string(),
        }
    };
    let few = ("robot.tri.count", "3");
    let vary = |path: &str, draw: &str| format!("[{{ path = \"{path}\", draw = {draw} }}]");
    let uniform = "{ kind = \"uniform\", low = 0.0, high = 1.0 }";
    for (changes, says) in [
        (
            &[("robot.tri.count", "0")][..],
            "must be in [1, 9000], got 0",
        ),
        (
            &[("robot.tri.count", "9001")],
            "must be in [1, 9000], got 9001",
        ),
        (
            &[("robot.tri.count", "1")],
            "robot.tri.vary: must be left out",
        ),
        (
            &[few, ("robot.tri.vary", &vary("count", uniform))],
            "must be a number of the robot, got \"count\"",
        ),
        (
            &[few, ("robot.tri.vary", &vary("pose.7", uniform))],
            "pose is a list of 3 values",
        ),
        (
            &[few, ("robot.tri.vary", &vary("platform.body.mas", uniform))],
            "mas",
        ),
        (
            &[
                few,
                (
                    "robot.tri.vary",
                    &vary(
                        "platform.body.mass",
                        "{ kind = \"choice\", values = [-1.0] }",
                    ),
                ),
            ],
            "drawn for robot tri-0",
        ),
    ] {
        let told = refused(changes);
        assert!(told.contains(says), "{changes:?}: {told}");
    }
    let loaded = scenario::load(&shipped("crowd.toml"), &[]).expect("valid");
    let told = Run::new(&loaded, 0)
        .err()
        .expect("a crowd is no single run");
    assert!(told.to_string().contains("robot.tri.count: must be 1 here"));
}
