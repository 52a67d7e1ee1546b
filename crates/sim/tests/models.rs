//! Models that take over from each other while a robot drives.

use std::path::Path;

use appell_sim::record::{Memory, Recorder, Recording};
use appell_sim::run::{Outcome, Run, Summary};
use appell_sim::scenario::load_text;

const SCENARIOS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenarios");

/// The slalom, of a robot with models that stand by, and changes of them.
fn scenario(models: &str, swaps: &[(f64, &str)]) -> String {
    let text = std::fs::read_to_string(Path::new(SCENARIOS).join("slalom.toml"));
    let text = text.expect("a scenario");
    let (head, task) = text.split_at(text.find("[robot.task]").expect("the slalom has a task"));
    let swap =
        |(at, to): &(f64, &str)| format!("\n[[swap]]\nat = {at}\nrobot = \"tri\"\nto = \"{to}\"\n");
    let swaps: String = swaps.iter().map(swap).collect();
    format!("{head}{models}\n{task}\n{swaps}")
}

const MODELS: &str = r#"
[[robot.model]]
name = "kinematic"
level = "kinematic"

[[robot.model]]
name = "torque"
drive = "torque"
"#;

fn build(text: &str) -> Result<Run, String> {
    let file = Path::new(SCENARIOS).join("models.toml");
    let loaded = load_text(text, &file, &Vec::new()).map_err(|error| error.to_string())?;
    Run::new(&loaded, 0).map_err(|error| error.to_string())
}

fn run(text: &str) -> (Summary, Recording) {
    let mut run = build(text).expect("a run");
    let mut memory = Memory::new();
    let summary = run.execute(&mut memory, &mut |_| {}).expect("a summary");
    (summary, memory.into_recording())
}

fn column<'a>(recording: &'a Recording, signal: &str) -> &'a [f64] {
    let path = format!("robot.tri.{signal}");
    recording.column(&path).expect("a signal")
}

/// Largest change of a signal from row to row.
fn jump(recording: &Recording, signal: &str) -> f64 {
    let values = column(recording, signal);
    let steps = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    steps.fold(0.0, f64::max)
}

/// From motors to ideal rates, to torques and back: pose, angles and speed go on where they were.
#[test]
fn invariant_models_take_over_without_a_bump() {
    let (alone, plain) = run(&scenario(MODELS, &[]));
    let swaps = [(3.0, "kinematic"), (6.003, "torque"), (9.0, "model")];
    let (summary, recording) = run(&scenario(MODELS, &swaps));
    assert_eq!(summary.verdict, Outcome::Passed);
    let told: Vec<(&str, &str)> = summary
        .swaps
        .iter()
        .map(|swap| (swap.from.as_str(), swap.to.as_str()))
        .collect();
    let expected = [
        ("model", "kinematic"),
        ("kinematic", "torque"),
        ("torque", "model"),
    ];
    assert_eq!(told, expected);
    // Rows are 10 ms apart, in which the robot moves 9 mm and its wheels turn by 0.12 rad.
    assert!(jump(&recording, "pose.x") < 0.01);
    assert!(jump(&recording, "wheel.left.spin_angle") < 0.13);
    // At 0.9 m/s² it changes its speed by 9 mm/s in a row; the ideal rates follow the command without
    // the lag of some hundredths of a second, and that may come at once.
    assert!(jump(&recording, "twist.forward") < 0.04);
    // Before the first change nothing is different.
    let rows = 300;
    for signal in ["pose.x", "pose.yaw", "wheel.right.current"] {
        assert_eq!(
            column(&recording, signal)[..rows],
            column(&plain, signal)[..rows]
        );
    }
    // What a model does not know is zero while it drives.
    let current = column(&recording, "wheel.left.current");
    assert!(current[..290].iter().any(|&value| value != 0.0));
    assert!(current[301..890].iter().all(|&value| value == 0.0));
    // Figures that only some models know are left out, of all others as ever.
    let has = |name: &str| summary.robots[0].metrics.iter().any(|m| m.name == name);
    assert!(has("path length") && !has("energy supplied"));
    assert_eq!(alone.verdict, Outcome::Passed);
}

/// A model that stands by changes nothing, to the last bit.
#[test]
fn invariant_standing_by_costs_nothing() {
    let (_, with) = run(&scenario(MODELS, &[]));
    let (_, without) = run(&scenario("", &[]));
    for signal in [
        "pose.x",
        "pose.y",
        "pose.yaw",
        "wheel.left.current",
        "energy.supplied",
    ] {
        assert_eq!(column(&with, signal), column(&without, signal), "{signal}");
    }
}

/// A world that was saved under a model that took over goes on in another with the same bits.
#[test]
fn invariant_a_saved_world_has_its_model() {
    let text = scenario(MODELS, &[(1.0, "kinematic"), (2.5, "torque")]);
    let mut first = build(&text).expect("a run");
    let mut silent = Memory::new();
    silent.begin(&first.header).expect("it listens");
    while first.world.tick() < 2000 {
        first.world.advance(1, &mut silent).expect("a step");
    }
    let saved = first.world.save();
    let mut second = build(&text).expect("a run");
    second.world.restore(&saved).expect("it fits");
    for _ in 0..1500 {
        first.world.step(&mut silent).expect("a step");
        second.world.step(&mut silent).expect("a step");
    }
    let bits = |run: &Run| {
        run.world
            .row()
            .iter()
            .map(|v| v.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&first), bits(&second));
    assert_eq!(first.world.swapped(), second.world.swapped());
    assert_eq!(first.world.swapped().len(), 2);
}

/// A change on command is the change of a scenario that plans it, and the kept scenario repeats it.
#[test]
fn invariant_a_command_is_a_plan() {
    let mut by_hand = build(&scenario(MODELS, &[])).expect("a run");
    let mut memory = Memory::new();
    let mut is_done = false;
    let summary = by_hand.execute_with(&mut memory, 7, &mut |run| {
        if run.world.tick() >= 3000 && !is_done {
            is_done = true;
            run.swap("tri", "kinematic").expect("it stands by");
            let refused = run.swap("tri", "nobody").expect_err("nobody");
            assert!(
                refused
                    .to_string()
                    .contains("one of controller, model, kinematic, torque")
            );
            assert!(run.swap("nobody", "model").is_err());
        }
    });
    let summary = summary.expect("a summary");
    let hand = memory.into_recording();
    let repetition = by_hand.repetition().expect("it was changed");
    assert_eq!(repetition.swap.len(), 1);
    let (again, planned) = run(&repetition.to_toml());
    assert_eq!(summary.swaps, again.swaps);
    assert!(hand.columns == planned.columns);
    assert!(
        build(&scenario(MODELS, &[]))
            .expect("a run")
            .repetition()
            .is_none()
    );
}

#[test]
fn refusal_of_models() {
    let refused = |models: &str, swaps: &[(f64, &str)]| {
        build(&scenario(models, swaps)).err().expect("a refusal")
    };
    let twice = MODELS.replace("torque\"\ndrive", "kinematic\"\ndrive");
    let cases = [
        (twice, "must differ from the others, got \"kinematic\" twice"),
        ("[[robot.model]]\nname = \"model\"".into(), "must be another, got \"model\""),
        ("[[robot.model]]\nname = \"controller\"".into(), "must be another, got \"controller\""),
        (
            "[[robot.model]]\nname = \"legs\"\nlevel = \"rolling\"\nplugin = { file = \"pursuit.py\" }".into(),
            "must not stand beside level and drive",
        ),
        (
            "[[robot.model]]\nname = \"legs\"\nplugin = { file = \"none.wasm\" }".into(),
            "robot.tri.model.legs.plugin.file: must be a file",
        ),
        (
            "[[robot.model]]\nname = \"legs\"\nplugin = { file = \"pursuit.py\", fallback = \"nobody\" }".into(),
            "one of model, legs",
        ),
        (
            format!("{MODELS}\n[[robot.wheel_noise]]\nwheel = \"left\"\nstd = 0.1"),
            "must not stand beside models",
        ),
        (
            format!("count = 3\n{MODELS}"),
            "",
        ),
    ];
    for (models, told) in cases {
        let problem = refused(&models, &[]);
        assert!(problem.contains(told), "{problem}");
    }
    let problem = refused(MODELS, &[(1.0, "nobody")]);
    assert!(
        problem.contains("one of controller, model, kinematic, torque"),
        "{problem}"
    );
}
