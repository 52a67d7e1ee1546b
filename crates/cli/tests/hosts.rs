//! Plug-ins in all hosts, through the program: modules of WebAssembly, the templates, the examples, and files that
//! change while a run goes on.
#![cfg(all(unix, feature = "wasm"))]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn appell(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_appell"));
    command
        .args(arguments)
        .output()
        .expect("the program starts")
}

fn text(output: &Output) -> String {
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    format!("{out}{err}")
}

/// A folder that is not there yet.
fn fresh(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn word(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

fn done(command: &mut Command) {
    let output = command.output().expect("it starts");
    assert!(output.status.success(), "{command:?}\n{}", text(&output));
}

/// Compiles C to a library, or to a module.
fn compile(source: &Path, to: &str) -> PathBuf {
    let file = source.with_extension(to);
    let (compiler, flags): (_, &[&str]) = match to {
        "wasm" => (
            "clang",
            &[
                "--target=wasm32",
                "-mbulk-memory",
                "-nostdlib",
                "-Wl,--no-entry,--export-dynamic",
            ],
        ),
        _ => ("cc", &["-shared", "-fPIC"]),
    };
    done(
        Command::new(compiler)
            .args(flags)
            .args(["-O2", "-ffp-contract=off", "-I"])
            .args([
                &Path::new(ROOT).join("sdk/c"),
                Path::new("-o"),
                &file,
                source,
            ]),
    );
    file
}

fn summary(out: &Path) -> Value {
    let bytes = std::fs::read(out.join("summary.json")).expect("a summary");
    serde_json::from_slice(&bytes).expect("JSON")
}

/// The law of the tests: sums, products and a quotient, which all hosts round alike.
const LAW: &str = r#"
#include "appell_plugin.h"
typedef struct { double gain, sum; int steps; } Member;
static Member members[64];
static int made, unused;
static int deep(int k) { volatile char room[4096]; room[k % 4096] = (char)k; return k ? deep(k + 1) + room[0] : 0; }
uint32_t appell_abi(void) { return APPELL_ABI; }
const char *appell_describe(void)
{
    return "{\"protocol\": 1, \"name\": \"law\", \"inputs\": [{\"name\": \"pose.x\", \"unit\": \"m\"}],"
        " \"outputs\": [{\"name\": \"command.forward\", \"unit\": \"m/s\", \"min\": -1000, \"max\": 1000}],"
        " \"parameters\": [{\"name\": \"gain\", \"default\": 0.001}]}";
}
void *appell_create(const double *p, const char *c)
{
    (void)c, (void)deep, (void)unused;
    if (made == 64) return 0;
    members[made].gain = p[0];
    return &members[made++];
}
void appell_destroy(void *m) { (void)m; }
const char *appell_reason(void *m) { (void)m; return "in its own words"; }
int32_t appell_step(void *m, double t, double dt, const double *in, double *out)
{
    Member *self = m;
    (void)t;
    self->sum += in[0] * self->gain;
    out[0] = self->sum + dt / (2.0 + in[0]);
    if (++self->steps < 5) return 0;
    STEP;
    return 0;
}
size_t appell_save(void *m, uint8_t *bytes, size_t room)
{
    if (room >= sizeof(Member)) __builtin_memcpy(bytes, m, sizeof(Member));
    return sizeof(Member);
}
int32_t appell_restore(void *m, const uint8_t *bytes, size_t length)
{
    if (length != sizeof(Member)) return 1;
    __builtin_memcpy(m, bytes, length);
    return 0;
}
int32_t appell_take_over(void *m, const double *out) { ((Member *)m)->sum += out[0]; return 0; }
"#;

const LAW_IN_PYTHON: &str = r#"
from appell_plugin import controller

@controller(
    inputs={"pose.x": "m"},
    outputs={"command.forward": ("m/s", -1000.0, 1000.0)},
    parameters={"gain": 0.001},
)
def law(now, inputs, parameters, memory):
    memory["sum"] = memory.get("sum", 0.0) + inputs["pose.x"] * parameters["gain"]
    return memory["sum"] + now.dt / (2.0 + inputs["pose.x"])
"#;

/// One law in three hosts gives the same bits, and each passes the tests that all pass.
#[test]
fn peer_hosts_agree() {
    let folder = fresh("agree");
    std::fs::create_dir_all(&folder).expect("a folder");
    let source = folder.join("law.c");
    std::fs::write(&source, LAW.replace("STEP;", "")).expect("a file");
    let python = folder.join("law.py");
    std::fs::write(&python, LAW_IN_PYTHON).expect("a file");
    let (module, library) = (compile(&source, "wasm"), compile(&source, "so"));
    let files = [word(&module), word(&library), word(&python)];
    let tested = appell(&[&["plugin", "test"], &files[..]].concat());
    assert!(tested.status.success(), "{}", text(&tested));
    assert_eq!(text(&tested).matches("ok  ").count(), 3 * 7 + 2);
    let agree = format!("the same answers as {}: bit for bit", files[0]);
    assert_eq!(text(&tested).matches(&agree).count(), 2);
}

/// Two robots: one that homes by itself, and one that a module drives.
const SCENARIO: &str = r#"
schema = 1
name = "hostile"
[time]
duration = 0.5
[arena]
size = [6.0, 4.0]
[[arena.beacon]]
name = "dock"
position = [4.5, 3.0]
[[robot]]
name = "bystander"
file = "ROOT/robots/three-wheeler.toml"
pose = [1.0, 1.0, 0.0]
controller = { kind = "homing" }
task = { kind = "homing", beacon = "dock", distance = 0.45 }
[[robot]]
name = "driven"
file = "ROOT/robots/three-wheeler.toml"
pose = [1.0, 3.0, 0.0]
controller = { kind = "plugin", file = "law.wasm", period = 0.02, fuel = 1000000, memory = 64 }
"#;

/// Columns of the robot that does nothing wrong.
fn bystander(out: &Path) -> Vec<String> {
    let table = std::fs::read_to_string(out.join("recording.csv")).expect("a recording");
    let mut lines = table.lines();
    let head: Vec<&str> = lines.next().expect("a head").split(',').collect();
    let own = |line: &str| {
        let cells = line.split(',').zip(&head);
        let own = cells.filter(|(_, name)| name.starts_with("robot.bystander."));
        own.map(|(cell, _)| cell).collect::<Vec<_>>().join(",")
    };
    lines.map(own).collect()
}

/// Whatever a module does in its step, the run goes on, its recording is whole, the other robot has the same
/// bits, and the same happens at the same step each time.
#[test]
fn refusal_of_hostile_modules_harms_no_other_robot() {
    let cases = [
        (
            "for (;;) unused++",
            "used up its fuel of 1000000 instructions",
        ),
        ("__builtin_trap()", "trapped: it panicked"),
        (
            "*(volatile int *)0xfffffff0 = 1",
            "trapped: out of bounds memory access",
        ),
        ("out[0] = deep(1)", "trapped"),
        (
            "for (;;) if (__builtin_wasm_memory_grow(0, 16) == (unsigned long)-1) unused++",
            "asked for more memory than its 64 MiB",
        ),
        ("out[0] = 0.0 / (dt - dt)", "must be finite, got NaN"),
        ("out[0] = 1.0 / (dt - dt)", "must be finite, got inf"),
        ("out[0] = -1001", "must be at least -1000"),
        ("return 3", "in its own words"),
        (
            "((void (*)(double, int))(unsigned long)(1 + unused))(1.0, 2)",
            "trapped",
        ),
        (
            "volatile int none = 0; out[0] = self->steps / none",
            "integer divide by zero",
        ),
        (
            "__builtin_memset(members, 255, 1 << 30)",
            "used up its fuel of 1000000 instructions",
        ),
    ];
    let folder = fresh("hostile");
    std::fs::create_dir_all(&folder).expect("a folder");
    let (scenario, source) = (folder.join("scenario.toml"), folder.join("law.c"));
    std::fs::write(&scenario, SCENARIO.replace("ROOT", ROOT)).expect("a file");
    let drive = |step: &str, out: &Path| {
        std::fs::write(&source, LAW.replace("STEP", step)).expect("a file");
        compile(&source, "wasm");
        let run = [
            "run",
            word(&scenario),
            "--no-report",
            "--csv",
            "--out",
            word(out),
        ];
        let output = appell(&run);
        assert!(out.join("recording.csv").exists(), "{}", text(&output));
        (bystander(out), summary(out))
    };
    let out = folder.join("out");
    let (expected, told) = drive("", &out);
    assert_eq!(told["failures"], Value::Null);
    assert!(expected.len() > 40);
    for (step, problem) in cases {
        let (own, told) = drive(step, &out);
        assert_eq!(own, expected, "{step}");
        assert_eq!(told["error"], Value::Null);
        let failure = &told["failures"][0];
        assert_eq!(failure["step"], 80, "{step}");
        let told = failure["problem"].as_str().unwrap_or_default();
        assert!(told.contains(problem), "{step}: {told}");
        assert_eq!(&drive(step, &out).1["failures"][0], failure, "{step}");
        let listed = appell(&["plot", word(&out.join("recording.mcap"))]);
        assert!(listed.status.success(), "{step}: {}", text(&listed));
    }
}

/// What `plugin new` writes builds with the command that it prints, and passes its tests and its task; Rust and
/// AssemblyScript with the same bits.
#[test]
fn invariant_starters_of_modules() {
    let mut modules = Vec::new();
    for language in ["rust", "assemblyscript"] {
        let folder = fresh(&format!("starter-{language}"));
        let written = appell(&["plugin", "new", word(&folder), "--language", language]);
        let said = text(&written);
        assert!(written.status.success(), "{said}");
        let next: Vec<&str> = said
            .split("next: ")
            .nth(1)
            .expect("it says")
            .lines()
            .collect();
        done(Command::new("sh").args(["-c", next[0]]));
        let module = next[1].trim().trim_start_matches("appell plugin test ");
        let tested = appell(&["plugin", "test", module]);
        assert!(tested.status.success(), "{}", text(&tested));
        let out = folder.join("out");
        let scenario = folder.join("scenario.toml");
        let ran = appell(&["run", word(&scenario), "--no-report", "--out", word(&out)]);
        assert!(ran.status.success(), "{}", text(&ran));
        modules.push(module.to_owned());
    }
    let tested = appell(&["plugin", "test", &modules[0], &modules[1]]);
    assert!(tested.status.success(), "{}", text(&tested));
}

/// The plug-ins of the book: each of the four tasks, a model, and a controller changed from host to host.
#[test]
fn invariant_examples_pass() {
    let examples = Path::new(ROOT).join("examples/plugins");
    done(&mut Command::new(examples.join("build.sh")));
    let folder = fresh("examples");
    for name in ["homing", "gate", "eight", "slalom", "wheel_legged", "swap"] {
        let scenario = examples.join(format!("{name}.toml"));
        let out = folder.join(name);
        let ran = appell(&["run", word(&scenario), "--no-report", "--out", word(&out)]);
        assert!(ran.status.success(), "{}", text(&ran));
        assert_eq!(summary(&out)["failures"], Value::Null, "{name}");
    }
    let of = |name: &str| {
        summary(&folder.join(name))["swaps"]
            .as_array()
            .map_or(0, Vec::len)
    };
    assert_eq!((of("swap"), of("wheel_legged")), (3, 3));
    // The model in C moves alike as a module.
    let scenario = examples.join("wheel_legged.toml");
    let modules = [
        word(&scenario),
        "--set",
        "robot.tri.model.legs.plugin.file=\"wheel_legged.wasm\"",
    ];
    let out = folder.join("legs");
    let ran = appell(&[&["run", "--no-report", "--out", word(&out)], &modules[..]].concat());
    assert!(ran.status.success(), "{}", text(&ran));
    // Of one source in Rust, with the mathematics in it, module and library agree.
    let target = examples.join("pursuit/target");
    let module = target.join("wasm32-unknown-unknown/release/pursuit.wasm");
    let library = target.join("release/libpursuit.so");
    let tested = appell(&["plugin", "test", word(&module), word(&library)]);
    assert!(tested.status.success(), "{}", text(&tested));
}

/// A file that changes while the run goes on takes over; a broken one does not; a word on the standard input
/// changes controllers; and the scenario that is kept repeats it all.
#[test]
fn invariant_what_was_watched_repeats() {
    let folder = fresh("watched");
    std::fs::create_dir_all(&folder).expect("a folder");
    let scenarios = Path::new(ROOT).join("scenarios");
    let scenario = std::fs::read_to_string(scenarios.join("swap.toml")).expect("a scenario");
    let robots = format!("{ROOT}/robots");
    std::fs::write(
        folder.join("swap.toml"),
        scenario.replace("../robots", &robots),
    )
    .expect("a file");
    let source = std::fs::read_to_string(scenarios.join("pursuit.py")).expect("a file");
    let file = folder.join("pursuit.py");
    std::fs::write(&file, &source).expect("a file");
    let out = folder.join("out");
    let mut child = Command::new(env!("CARGO_BIN_EXE_appell"))
        .args([
            "run",
            word(&folder.join("swap.toml")),
            "--no-report",
            "--csv",
        ])
        .args(["--watch", "--pace", "1.5", "--out", word(&out)])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program starts");
    // It has begun when it records; what is done then may fall into any step.
    let begun = Instant::now();
    while !out.join("recording.csv").exists() && begun.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(10));
    }
    let edit = |text: &str| {
        std::fs::write(&file, text).expect("a file");
        // Two looks of the watcher, and the start of Python on a busy machine.
        std::thread::sleep(Duration::from_millis(1200));
    };
    edit(&source.replace("0.8 * now.dt", "0.7 * now.dt"));
    let mut words = child.stdin.take().expect("a pipe");
    writeln!(words, "tri pursuit-v2").expect("it listens");
    edit("this is no Python");
    edit(&source.replace("0.8 * now.dt", "0.9 * now.dt"));
    assert!(child.wait().expect("it ends").success());
    let first = summary(&out);
    assert_eq!(first["verdict"], "passed");
    let swaps = first["swaps"].as_array().expect("changes");
    let refused = |swap: &&Value| !swap["refused"].is_null();
    assert_eq!(swaps.iter().filter(refused).count(), 1, "{swaps:?}");
    assert!(
        swaps.iter().any(|swap| swap["to"] == "pursuit-v2"),
        "{swaps:?}"
    );

    let again = folder.join("again");
    let kept = out.join("scenario.toml");
    let ran = appell(&[
        "run",
        word(&kept),
        "--no-report",
        "--csv",
        "--out",
        word(&again),
    ]);
    assert!(ran.status.success(), "{}", text(&ran));
    let table = |out: &Path| std::fs::read(out.join("recording.csv")).expect("a recording");
    assert!(table(&out) == table(&again), "another trajectory");
    let made = |summary: &Value| {
        let swaps = summary["swaps"].as_array().cloned().unwrap_or_default();
        swaps
            .into_iter()
            .filter(|swap| swap["refused"].is_null())
            .collect::<Vec<_>>()
    };
    assert_eq!(made(&first), made(&summary(&again)));
}

const FMU: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Lag" guid="{lag}">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="T" valueReference="3" causality="parameter" variability="fixed"><Real start="1"/></ScalarVariable>
    <ScalarVariable name="start" valueReference="6" causality="output"><Real/></ScalarVariable>
  </ModelVariables>
</fmiModelDescription>
"#;

/// An FMU, whose ports are called as it likes, drives a robot: its speed follows the distance from the wall, with
/// a lag.
#[test]
fn invariant_an_fmu_drives() {
    let folder = fresh("fmu");
    let binaries = folder.join("binaries/linux64");
    std::fs::create_dir_all(&binaries).expect("a folder");
    std::fs::write(folder.join("modelDescription.xml"), FMU).expect("a file");
    let source = Path::new(ROOT).join("crates/plugin/tests/fmu/two.c");
    done(
        Command::new("cc")
            .args(["-shared", "-fPIC", "-O2", "-o"])
            .args([&binaries.join("lag.so"), &source])
            .arg("-lm"),
    );
    done(
        Command::new("python3")
            .args([
                "-m",
                "zipfile",
                "-c",
                "lag.fmu",
                "modelDescription.xml",
                "binaries",
            ])
            .current_dir(&folder),
    );
    let plugin = r#"file = "lag.fmu", period = 0.02, parameters = { T = 0.5 }"#;
    let whole = SCENARIO.replace("ROOT", ROOT);
    let (begin, _) = whole.split_once("file = \"law.wasm\"").expect("a plug-in");
    let scenario = folder.join("scenario.toml");
    let out = folder.join("out");
    let run = |ports: &str| {
        let own = format!("{begin}{plugin}{ports} }}\n");
        std::fs::write(&scenario, own).expect("a file");
        appell(&[
            "run",
            word(&scenario),
            "--no-report",
            "--csv",
            "--out",
            word(&out),
        ])
    };
    let ran = run(", ports = { u = \"pose.x\", y = \"command.forward\" }");
    assert!(
        text_of(&out).contains("robot.driven.controller.start"),
        "{}",
        text(&ran)
    );
    let told = summary(&out);
    assert_eq!(told["failures"], Value::Null);
    // A lag of 0.5 s towards 1 m/s has come to 1 − e⁻¹ of it after half a second, and the robot moves meanwhile.
    let table = text_of(&out);
    let head = table.lines().next().expect("a head");
    let place = head
        .split(',')
        .position(|name| name == "robot.driven.command.forward");
    let last = table.lines().last().expect("rows").split(',');
    let speed: f64 = last
        .into_iter()
        .nth(place.expect("a column"))
        .expect("a cell")
        .parse()
        .expect("a number");
    assert!((0.6..0.8).contains(&speed), "{speed}");

    let ran = run(", ports = { u = \"pose.x\", v = \"command.forward\" }");
    assert_eq!(ran.status.code(), Some(2));
    assert!(
        text(&ran).contains("ports.v: must be a port of the plug-in"),
        "{}",
        text(&ran)
    );
    let ran = run("");
    assert!(
        text(&ran).contains("inputs.u: must be a signal of the robot"),
        "{}",
        text(&ran)
    );
}

/// The table of a run.
fn text_of(out: &Path) -> String {
    std::fs::read_to_string(out.join("recording.csv")).expect("a recording")
}
