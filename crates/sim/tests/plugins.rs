//! Plug-ins in worlds: they take over from each other, and what they do wrong harms nobody else.
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use appell_plugin::digest;
use appell_sim::record::{Memory, Recorder, Recording};
use appell_sim::run::{Outcome, Run, Summary};
use appell_sim::scenario::{load, load_text};

/// A folder for the files of a test.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("appell-plugins-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// Two robots: one that homes by itself, and one that a file drives.
const SCENARIO: &str = r#"
schema = 1
name = "hostile"
[time]
duration = 1.0
[arena]
size = [6.0, 4.0]
[[arena.beacon]]
name = "dock"
position = [4.5, 3.0]
[[robot]]
name = "bystander"
file = "ROBOT"
pose = [1.0, 1.0, 0.0]
controller = { kind = "homing" }
task = { kind = "homing", beacon = "dock", distance = 0.45 }
[[robot]]
name = "driven"
file = "ROBOT"
pose = [1.0, 3.0, 0.0]
controller = { kind = "plugin", file = "FILE", period = 0.02, time_limit = 1.0, memory = 160, parameters = { PARAMETERS } }
"#;

const ROBOT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../robots/three-wheeler.toml"
);

/// Runs the file in a scenario.
fn run(file: &Path, scenario: &str) -> Result<(Summary, Recording), String> {
    let name = file.file_name().expect("a name").to_string_lossy();
    let text = scenario
        .replace("ROBOT", ROBOT)
        .replace("FILE", &name)
        .replace("PARAMETERS", "");
    let place = file.with_file_name("scenario.toml");
    let loaded = load_text(&text, &place, &Vec::new()).map_err(|error| error.to_string())?;
    let mut run = Run::new(&loaded, 0).map_err(|error| error.to_string())?;
    let mut memory = Memory::new();
    let summary = run.execute(&mut memory, &mut |_| {});
    let summary = summary.map_err(|error| error.to_string())?;
    Ok((summary, memory.into_recording()))
}

/// The last value of a signal of the robot that is driven.
fn last(recording: &Recording, signal: &str) -> f64 {
    let values = recording.column(&format!("robot.driven.{signal}"));
    *values.expect("a signal").last().expect("rows")
}

/// A controller in Python around the lines of a step.
fn python(lines: &str) -> String {
    let body: String = lines.lines().map(|line| format!("    {line}\n")).collect();
    format!(
        "import os, sys, time, math, ctypes, signal\nfrom appell_plugin import controller\n\n\
         @controller(inputs={{\"pose.x\": \"m\"}}, outputs={{\"command.forward\": (\"m/s\", -1.0, 1.0), \"command.yaw_rate\": \"rad/s\"}})\n\
         def step(now, inputs, parameters, memory):\n\
         \x20   memory[\"k\"] = memory.get(\"k\", 0) + 1\n\
         \x20   if memory[\"k\"] < 5:\n        return [0.2, 0.1]\n{body}    return [0.2, 0.1]\n"
    )
}

/// A program without the module: `describe` and `step` are expressions of the answers' bytes.
fn raw(describe: &str, step: &str) -> String {
    format!(
        r#"#!/usr/bin/env python3
import json, os, struct, sys, time
out = sys.stdout.buffer
number = 0
def say(kind, body):
    out.write(struct.pack("<IHH", len(body), kind, number) + body); out.flush()
def give(*bytes):
    for part in bytes:
        out.write(part); out.flush()
NORMAL = dict(protocol=1, name="raw", inputs=[], outputs=[dict(name="command.forward", unit="m/s")])
def but(**change):
    return json.dumps(dict(NORMAL, **change)).encode()
PORT = dict(name="command.forward", unit="m/s")
k = 0
while True:
    head = sys.stdin.buffer.read(8)
    if len(head) < 8: break
    length, kind, number = struct.unpack("<IHH", head)
    body = sys.stdin.buffer.read(length)
    if kind == 1: say(101, {describe})
    elif kind == 3:
        k += 1
        if k < 5: say(103, struct.pack("<IId", 0, 0, 0.2))
        else: {step}
    else: say(kind + 100, b"")
"#
    )
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let file = folder.join(name);
    std::fs::write(&file, text).expect("a file");
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).expect("a mode");
    file
}

/// The signals of the robot that does nothing wrong, bit for bit.
fn bystander(recording: &Recording) -> Vec<u64> {
    let signals = recording.header.signals.iter().zip(&recording.columns);
    let own = signals.filter(|(signal, _)| signal.path.starts_with("robot.bystander."));
    own.flat_map(|(_, column)| column.iter().map(|value| value.to_bits()))
        .collect()
}

/// What fails while it runs: a line of a step, and what is told.
const FAULTS: [(&str, &str); 25] = [
    ("raise ValueError('x' * 2_000_000)", "step: ValueError: xxx"),
    ("while True: pass", "step: gave no answer within 1 s"),
    ("time.sleep(9)", "step: gave no answer within 1 s"),
    (
        "raise ValueError('no')",
        "step: ValueError: no (fault.py, line ",
    ),
    ("1 // 0", "step: ZeroDivisionError"),
    ("memory['nothing']", "step: KeyError: 'nothing'"),
    (
        "os._exit(3)",
        "step: ended without an answer (exit status: 3)",
    ),
    (
        "sys.exit(4)",
        "step: ended without an answer (exit status: 4)",
    ),
    (
        "ctypes.string_at(0)",
        "step: ended without an answer (signal: 11",
    ),
    (
        "os.kill(os.getpid(), signal.SIGKILL)",
        "step: ended without an answer (signal: 9",
    ),
    ("os.abort()", "step: ended without an answer (signal: 6"),
    ("os.closerange(0, 64)", "step: ended without an answer"),
    (
        "return [math.nan, 0.0]",
        "outputs.command.forward: must be finite, got NaN",
    ),
    (
        "return [0.0, math.inf]",
        "outputs.command.yaw_rate: must be finite, got inf",
    ),
    (
        "return [0.0, -math.inf]",
        "outputs.command.yaw_rate: must be finite, got -inf",
    ),
    (
        "return [1.5, 0.0]",
        "outputs.command.forward: must be at most 1 m/s, got 1.5",
    ),
    (
        "return [0.0]",
        "step: ValueError: it must return 2 outputs, got 1",
    ),
    (
        "return [0.0] * 100000",
        "step: ValueError: it must return 2 outputs, got 100000",
    ),
    (
        "return None",
        "step: ValueError: it must return its outputs, got None",
    ),
    (
        "return {'command.forward': 0.0}",
        "missing: command.yaw_rate",
    ),
    (
        "return {'x': 0, 'command.forward': 0, 'command.yaw_rate': 0}",
        "not outputs: x",
    ),
    ("return ['a', 'b']", "step: struct.error"),
    ("bytearray(1 << 40)", "step: MemoryError"),
    (
        "l = []\nwhile True: l.append(bytearray(1 << 24))",
        "step: MemoryError",
    ),
    ("f = lambda: f()\nf()", "step: RecursionError"),
];

/// The same without the module, for what the module would not let through.
const RAW_FAULTS: [(&str, &str); 12] = [
    (
        "give(struct.pack('<IHHIId', 16, 103, number - 1, 0, 0, 0.1))",
        "answered with something else than an answer",
    ),
    (
        "give(b'hello, world, this is no message')",
        "answered with something else than an answer",
    ),
    (
        "print('a debugging line', flush=True)",
        "answered with something else than an answer",
    ),
    (
        "give(struct.pack('<IHH', 1 << 31, 103, number))",
        "answered with 2147483648 bytes",
    ),
    (
        "say(104, b'')",
        "answered with something else than an answer: kind 104",
    ),
    ("say(103, b'')", "step: answered with too few bytes"),
    (
        "say(103, struct.pack('<IIdd', 0, 0, 0.1, 0.2))",
        "step: answered with too many bytes",
    ),
    (
        "say(103, struct.pack('<II', 7, 0))",
        "step: answered with neither outputs nor a reason",
    ),
    (
        "say(103, struct.pack('<II', 1, 99))",
        "step: answered with too few bytes",
    ),
    (
        "say(103, struct.pack('<II', 1, 2) + bytes([255, 254]))",
        "step: \u{fffd}\u{fffd}",
    ),
    (
        "(give(struct.pack('<I', 16)), sys.exit(1))",
        "step: ended without an answer (exit status: 1)",
    ),
    (
        "[(give(bytes([b])), time.sleep(0.3)) for b in struct.pack('<IHHIId', 16, 103, number, 0, 0, 0.1)]",
        "step: gave no answer within 1 s",
    ),
];

/// What is found before a run begins: the description, and what is told.
const REFUSED: [(&str, &str); 14] = [
    (
        "but(protocol=2)",
        "describe.protocol: must be 1, the version of the messages, got 2",
    ),
    ("b'not json'", "describe: must be JSON"),
    ("b'[1, 2]'", "describe.protocol: must be 1"),
    ("but(surprise=1)", "describe: unknown field `surprise`"),
    ("but(outputs=[])", "describe.outputs: must not be empty"),
    (
        "but(outputs=[PORT, PORT])",
        "describe.outputs: names must differ, got \"command.forward\" twice",
    ),
    (
        "but(outputs=[dict(PORT, name='a\\nb')])",
        "describe.outputs: names must be letters",
    ),
    (
        "but(outputs=[dict(PORT, min=1.0, max=0.0)])",
        "describe.outputs.command.forward: limits",
    ),
    (
        "but(inputs=[dict(name=f'a{k}', unit='m') for k in range(2000)])",
        "describe.inputs: must be at most 1024",
    ),
    (
        "but(inputs=[dict(name='pose.z', unit='m')])",
        "inputs.pose.z: must be a signal of the robot",
    ),
    (
        "but(inputs=[dict(name='pose.x', unit='mm')])",
        "inputs.pose.x: must be in m, got \"mm\"",
    ),
    (
        "but(outputs=[dict(name='pose.x', unit='m')])",
        "outputs.pose.x: must be a command",
    ),
    (
        "but(outputs=[PORT, dict(name='wheel.left.voltage', unit='V')])",
        "outputs: must command either the twist or the wheels",
    ),
    (
        "but(parameters=[dict(name='gain', default=2.0, max=1.0)])",
        "describe.parameters.gain: its default must be within its limits",
    ),
];

#[test]
fn refusal_of_hostile_steps_harms_no_other_robot() {
    let folder = folder("steps");
    let benign = write(&folder, "benign.py", &python("pass"));
    let (summary, recording) = run(&benign, SCENARIO).expect("a run");
    assert_eq!((summary.error, summary.failures), (None, Vec::new()));
    let expected = bystander(&recording);
    assert!(expected.len() > 1000);

    let of_module = FAULTS
        .iter()
        .map(|(line, told)| ("fault.py", python(line), told));
    let alone = RAW_FAULTS
        .iter()
        .map(|(line, told)| ("fault", raw("but()", line), told));
    for (name, text, told) in of_module.chain(alone) {
        let file = write(&folder, name, &text);
        let mut failures = Vec::new();
        for _ in 0..2 {
            let (summary, recording) = run(&file, SCENARIO).expect("a run");
            assert_eq!(summary.error, None, "{told}");
            assert_eq!(bystander(&recording), expected, "{told}");
            assert_eq!(summary.failures.len(), 1, "{told}");
            let failure = summary.failures[0].clone();
            assert_eq!(
                (failure.step, failure.block.as_str()),
                (80, "robot.driven.controller")
            );
            assert!(
                failure.problem.contains(told),
                "{}\n{told}",
                failure.problem
            );
            let events = &recording.events;
            assert!(
                events
                    .iter()
                    .any(|e| e.kind == "fault" && e.text.contains(told))
            );
            // The commands are zero from there.
            assert_eq!(last(&recording, "command.forward"), 0.0);
            failures.push(failure);
        }
        assert_eq!(failures[0], failures[1]);
    }
    std::fs::remove_dir_all(folder).expect("removed");
}

#[test]
fn refusal_of_descriptions_before_the_run() {
    let folder = folder("descriptions");
    for (describe, told) in REFUSED {
        let file = write(&folder, "refused", &raw(describe, "pass"));
        let problem = run(&file, SCENARIO).expect_err("a refusal");
        assert!(
            problem.contains("robot.driven.controller.file"),
            "{problem}"
        );
        assert!(problem.contains(told), "{problem}\n{told}");
    }
    let file = write(&folder, "ends.py", "import sys; sys.exit(3)");
    let problem = run(&file, SCENARIO).expect_err("a refusal");
    assert!(
        problem.contains("ended without an answer (exit status: 3)"),
        "{problem}"
    );
    let file = folder.join("ends.py").with_file_name("nowhere.py");
    let problem = run(&file, SCENARIO).expect_err("a refusal");
    assert!(
        problem.contains("must be a file, got \"nowhere.py\""),
        "{problem}"
    );
    let good = write(&folder, "good", &raw("but()", "pass"));
    let parameters = SCENARIO.replace("PARAMETERS", "gain = 1.0");
    let problem = run(&good, &parameters).expect_err("a refusal");
    assert!(problem.contains("controller.parameters.gain"), "{problem}");
    std::fs::remove_dir_all(folder).expect("removed");
}

/// A failure ends the run where that is asked for, and hands over where someone stands by.
#[test]
fn invariant_what_follows_a_failure_is_chosen() {
    let folder = folder("policy");
    let file = write(&folder, "fails.py", &python("raise ValueError('no')"));
    let ends = SCENARIO.replace("time_limit", "on_failure = \"end\", time_limit");
    let (summary, _) = run(&file, &ends).expect("a run");
    assert!(
        summary
            .error
            .expect("an error")
            .contains("robot.driven.controller: step: ValueError: no")
    );
    assert!((summary.duration - 0.08).abs() < 1e-12);

    let fallback = "fallback = \"calm\", time_limit";
    let text = SCENARIO.replace("time_limit", fallback)
        + "[[robot.standby]]\nname = \"calm\"\ncontroller = { kind = \"signals\", channel = [{ to = \"forward\", signal = { kind = \"constant\", value = 0.125 } }] }\n";
    let (summary, recording) = run(&file, &text).expect("a run");
    assert_eq!(summary.error, None);
    let swap = &summary.swaps[0];
    assert_eq!(
        (swap.from.as_str(), swap.to.as_str()),
        ("controller", "calm")
    );
    assert_eq!(last(&recording, "command.forward"), 0.125);
    // What only the one that went wrote is silent.
    assert_eq!(last(&recording, "command.yaw_rate"), 0.0);

    // One that takes over and fails, too, has nobody behind it; and none may stand behind itself.
    let other = |fallback: &str| {
        SCENARIO.replace("time_limit", "fallback = \"other\", time_limit")
            + "[[robot.standby]]\nname = \"other\"\ncontroller = { kind = \"plugin\", file = \"FILE\""
            + fallback
            + " }\n"
    };
    let (summary, recording) = run(&file, &other("")).expect("a run");
    assert_eq!((summary.failures.len(), summary.swaps.len()), (2, 1));
    assert_eq!(last(&recording, "command.forward"), 0.0);
    let problem = run(&file, &other(", fallback = \"controller\"")).expect_err("a refusal");
    assert!(
        problem.contains("must not lead back, got controller -> other -> controller"),
        "{problem}"
    );
    std::fs::remove_dir_all(folder).expect("removed");
}

/// The shipped scenario of a change of controllers.
fn swap() -> Run {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/swap.toml");
    let loaded = load(&file, &Vec::new()).unwrap_or_else(|error| panic!("{error}"));
    Run::new(&loaded, 0).unwrap_or_else(|error| panic!("{error}"))
}

/// The robot does not notice: what takes over begins where the other ended, and a repetition has the
/// same bits.
#[test]
fn invariant_controllers_take_over_without_a_bump() {
    let run = || {
        let mut memory = Memory::new();
        let summary = swap().execute(&mut memory, &mut |_| {}).expect("runs");
        (summary, memory.into_recording())
    };
    let (summary, recording) = run();
    assert_eq!(summary.verdict, Outcome::Passed);
    let told: Vec<(f64, &str)> = summary.swaps.iter().map(|s| (s.t, s.to.as_str())).collect();
    assert_eq!(told, [(4.0, "pursuit"), (9.0, "controller")]);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/pursuit.py");
    let hash = digest(&std::fs::read(file).expect("a file"));
    assert_eq!(summary.swaps[0].hash.as_deref(), Some(hash.as_str()));
    // Both laws accelerate by at most 0.9 m/s² (half as much again when braking), and steer at 4 rad/s² at
    // most; the pursuit's own step of 20 ms is the longest.
    let change = |signal: &str| {
        let values = recording
            .column(&format!("robot.tri.{signal}"))
            .expect("a signal");
        let steps = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        steps.fold(0.0, f64::max)
    };
    assert!(change("command.forward") <= 1.5 * 0.9 * 0.02 + 1e-12);
    assert!(change("twist.forward") <= 0.03);
    let (again, same) = run();
    assert_eq!(again, summary);
    assert_eq!(same, recording);
}

/// A world that is saved while a plug-in drives goes on in another process of it as it would have.
#[test]
fn invariant_a_saved_plugin_goes_on() {
    let open = |run: &Run| {
        let mut memory = Memory::new();
        memory.begin(&run.header).expect("memory");
        memory
    };
    let mut whole = swap();
    let mut memory = open(&whole);
    let mut saved = Vec::new();
    while whole.world.advance(1, &mut memory).expect("steps") && whole.world.tick() < 9_500 {
        if [3_999, 4_000, 6_015, 8_990].contains(&whole.world.tick()) {
            saved.push(whole.world.save());
        }
    }
    let bits = |run: &Run| -> Vec<u64> { run.world.row().iter().map(|v| v.to_bits()).collect() };
    for bytes in saved {
        let mut other = swap();
        let mut memory = open(&other);
        other.world.restore(&bytes).expect("the same scenario");
        while other.world.advance(1, &mut memory).expect("steps") && other.world.tick() < 9_500 {}
        assert_eq!(bits(&other), bits(&whole));
    }
}
