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

/// A model in Python: it turns on the spot and drives as it is told, and fails at a time.
const PYTHON: &str = r#"
import math
from appell_plugin import controller

@controller(
    inputs={"command.forward": "m/s", "command.yaw_rate": "rad/s"},
    outputs={"pose.x": "m", "pose.y": "m", "pose.yaw": "rad", "twist.forward": "m/s", "twist.left": "m/s",
             "twist.yaw_rate": "rad/s", "model.clock": "s"},
    parameters={"end": (100.0, "s")},
)
def unicycle(now, inputs, parameters, memory):
    if now.before is not None:
        memory["pose"] = [now.before["pose." + axis] for axis in ("x", "y", "yaw")]
    if now.t >= parameters["end"]:
        raise ValueError("its time is up")
    v, w = inputs["command.forward"], inputs["command.yaw_rate"]
    x, y, yaw = memory["pose"]
    middle = yaw + 0.5 * now.dt * w
    memory["pose"] = [x + now.dt * v * math.cos(middle), y + now.dt * v * math.sin(middle), yaw + now.dt * w]
    return [*memory["pose"], v, 0.0, w, now.t]
"#;

fn unicycle(name: &str, more: &str) -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = folder.join("unicycle.py");
    std::fs::write(&file, PYTHON).expect("a file");
    let file = file.to_str().expect("a plain path");
    format!("{MODELS}\n[[robot.model]]\nname = \"own\"\nplugin = {{ file = \"{file}\"{more} }}\n")
}

/// A model of one's own is told the time of every tick, however far the world advances at once.
#[test]
fn invariant_own_models_know_every_tick() {
    let text = scenario(&unicycle("ticks", ""), &[(1.003, "own"), (4.0, "model")]);
    let (summary, at_once) = run(&text);
    assert_eq!(summary.verdict, Outcome::Passed);
    assert_eq!((summary.swaps.len(), summary.failures.len()), (2, 0));
    let mut one_by_one = build(&text).expect("a run");
    let mut memory = Memory::new();
    let again = one_by_one.execute_with(&mut memory, 1, &mut |_| {});
    assert_eq!(again.expect("a summary"), summary);
    assert!(memory.into_recording().columns == at_once.columns);
    // The clock is that of the last tick before each row.
    let clock = column(&at_once, "model.clock");
    for (k, &t) in clock.iter().enumerate().take(400).skip(102) {
        assert_eq!(t, (10 * k - 1) as f64 * 0.001, "{k}");
    }
    assert!(jump(&at_once, "pose.x") < 0.01);
}

/// One that fails hands the robot to its fallback where it was, at the tick at which it failed; or stands still.
#[test]
fn invariant_a_model_that_fails_has_its_successor() {
    let swaps = [(1.0, "own")];
    let fallback = ", parameters = { end = 2.0375 }, fallback = \"kinematic\"";
    let (summary, recording) = run(&scenario(&unicycle("falls", fallback), &swaps));
    assert_eq!(summary.verdict, Outcome::Passed);
    let failure = &summary.failures[0];
    assert_eq!(
        (failure.step, failure.block.as_str()),
        (2038, "robot.tri.own")
    );
    assert!(failure.problem.contains("its time is up"));
    let last = summary.swaps.last().expect("changes");
    assert_eq!((last.from.as_str(), last.to.as_str()), ("own", "kinematic"));
    assert!(jump(&recording, "pose.x") < 0.01);

    let (summary, recording) = run(&scenario(
        &unicycle("stands", ", parameters = { end = 2.0375 }"),
        &swaps,
    ));
    assert_eq!(summary.verdict, Outcome::Failed);
    assert_eq!(summary.failures.len(), 1);
    let x = column(&recording, "pose.x");
    assert!(x[204..].iter().all(|&value| value == x[204]));
    assert_eq!(column(&recording, "twist.forward")[204], 0.0);
}
