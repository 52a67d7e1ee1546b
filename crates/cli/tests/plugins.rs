//! Plug-ins from the command line, and libraries in C, which only the program itself can serve.
#![cfg(unix)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

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
    let folder = std::env::temp_dir().join(format!("appell-cli-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn compile(source: &Path) -> PathBuf {
    let library = source.with_extension("so");
    let built = Command::new("cc")
        .args([
            "-shared",
            "-fPIC",
            "-O2",
            "-ffp-contract=off",
            "-Wall",
            "-Wextra",
            "-o",
        ])
        .args([&library, source])
        .arg("-lm")
        .output()
        .expect("a C compiler");
    assert!(
        built.status.success() && built.stderr.is_empty(),
        "{}",
        text(&built)
    );
    library
}

fn at(folder: &Path, name: &str) -> String {
    folder.join(name).to_string_lossy().into_owned()
}

fn run(scenario: &str, out: &Path, more: &[&str]) -> (Output, Value) {
    let out_text = out.to_string_lossy();
    let arguments = ["run", scenario, "--no-report", "--out", &out_text];
    let output = appell(&[&arguments[..], more].concat());
    let summary = std::fs::read(out.join("summary.json"));
    let summary = summary.map(|bytes| serde_json::from_slice(&bytes).expect("JSON"));
    (output, summary.unwrap_or(Value::Null))
}

/// What `plugin new` writes passes the tests and its task; in C served by a process and in this one, with
/// the same bits.
#[test]
fn invariant_starters_pass_their_tests_and_tasks() {
    for language in ["python", "c"] {
        let folder = fresh(&format!("starter-{language}"));
        let place = folder.to_string_lossy().into_owned();
        let written = appell(&["plugin", "new", &place, "--language", language]);
        assert!(written.status.success(), "{}", text(&written));
        let name = folder
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let file = match language {
            "c" => compile(&folder.join(format!("{name}.c")))
                .to_string_lossy()
                .into_owned(),
            _ => at(&folder, &format!("{name}.py")),
        };
        let trusts: &[&[&str]] = if language == "c" {
            &[&[], &["--trust-native"]]
        } else {
            &[&[]]
        };
        let mut recordings = Vec::new();
        for trust in trusts {
            let tested = appell(&[&["plugin", "test", &file], *trust].concat());
            assert!(tested.status.success(), "{}", text(&tested));
            assert_eq!(
                text(&tested).matches("ok  ").count(),
                7,
                "{}",
                text(&tested)
            );
            let (output, summary) = run(&at(&folder, "scenario.toml"), &folder.join("out"), trust);
            assert_eq!(summary["verdict"], "passed", "{}", text(&output));
            recordings.push(std::fs::read(folder.join("out/recording.mcap")).expect("a file"));
        }
        assert!(
            recordings
                .iter()
                .all(|recording| *recording == recordings[0])
        );
        let described = appell(&["plugin", "describe", &file, "--json"]);
        let described: Value = serde_json::from_slice(&described.stdout).expect("JSON");
        assert_eq!(described["outputs"][0]["name"], "command.forward");
        let again = appell(&["plugin", "new", &place]);
        assert_eq!(again.status.code(), Some(2));
        std::fs::remove_dir_all(folder).expect("removed");
    }
}

const LIBRARY: &str = r#"
#include "appell_plugin.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
static int deep(int k) { volatile char room[4096]; room[k % 4096] = (char)k; return k ? deep(k + 1) + room[0] : 0; }
static int member, steps;
uint32_t appell_abi(void) { return ABI; }
const char *appell_describe(void) { return DESCRIBE; }
void *appell_create(const double *p, const char *c) { (void)p; (void)c; return CREATE; }
void appell_destroy(void *m) { (void)m; }
const char *appell_reason(void *m) { (void)m; return "in its own words"; }
int32_t appell_step(void *m, double t, double dt, const double *in, double *out)
{
    (void)m; (void)t; (void)dt; (void)in; (void)deep; (void)member;
    out[0] = 0.2;
    if (++steps < 5) return 0;
    STEP;
    return 0;
}
"#;

const DESCRIBE: &str = r#""{\"protocol\": 1, \"name\": \"c\", \"inputs\": [], \"outputs\": [{\"name\": \"command.forward\", \"unit\": \"m/s\"}]}""#;

/// What a library does wrong in its step, and what is told.
const FAULTS: [(&str, &str); 9] = [
    (
        "*(volatile int *)0 = 1",
        "step: ended without an answer (signal: 11",
    ),
    // By which signal depends on where the stack lies: in the guard page the program itself says abort, beyond
    // it the system says segmentation fault.
    (
        "out[0] = deep(1)",
        "step: ended without an answer (signal: ",
    ),
    ("exit(3)", "step: ended without an answer (exit status: 3)"),
    ("abort()", "step: ended without an answer (signal: 6"),
    ("for (;;) out[0] += 1", "step: gave no answer within 0.3 s"),
    ("return 7", "step: in its own words"),
    (
        "out[0] = NAN",
        "outputs.command.forward: must be finite, got NaN",
    ),
    (
        "out[0] = 1.0 / 0.0",
        "outputs.command.forward: must be finite, got inf",
    ),
    (
        "while (malloc(1 << 20)) {} abort()",
        "step: ended without an answer (signal: 6",
    ),
];

/// What is wrong with a library before it steps.
const REFUSED: [([&str; 3], &str); 5] = [
    (
        ["99", DESCRIBE, "&member"],
        "describe.abi: must be 1, the version of the C interface, got 99",
    ),
    (["1", "0", "&member"], "describe: must be a text, got none"),
    (["1", "\"{\"", "&member"], "describe: must be JSON"),
    (["1", "\"{}\"", "&member"], "describe.protocol: must be 1"),
    (["1", DESCRIBE, "0"], "create: in its own words"),
];

#[test]
fn refusal_of_hostile_libraries() {
    let folder = fresh("hostile");
    let place = folder.to_string_lossy().into_owned();
    assert!(
        appell(&["plugin", "new", &place, "--language", "c"])
            .status
            .success()
    );
    let scenario = at(&folder, "scenario.toml");
    let written = std::fs::read_to_string(&scenario).expect("a file");
    let name = folder
        .file_name()
        .expect("a name")
        .to_string_lossy()
        .into_owned();
    let changed = written
        .replace(&format!("{name}.so"), "hostile.so")
        .replace(
            "parameters = { speed = 0.6 }",
            "time_limit = 0.3\nmemory = 300",
        )
        .replace("duration = 25.0", "duration = 0.5");
    std::fs::write(&scenario, changed).expect("a file");
    let source = folder.join("hostile.c");
    let build = |[abi, describe, create]: [&str; 3], step: &str| {
        let text = LIBRARY
            .replace("ABI", abi)
            .replace("DESCRIBE", describe)
            .replace("CREATE", create)
            .replace("STEP", step);
        std::fs::write(&source, text).expect("a file");
        compile(&source);
    };
    for (step, told) in FAULTS {
        build(["1", DESCRIBE, "&member"], step);
        let (output, summary) = run(&scenario, &folder.join("out"), &[]);
        let failure = &summary["failures"][0];
        let problem = failure["problem"].as_str().unwrap_or_default();
        assert!(
            problem.contains(told),
            "{step}: {problem}\n{}",
            text(&output)
        );
        assert_eq!(failure["step"], 80, "{step}");
        assert_eq!(summary["error"], Value::Null);
    }
    // What it prints harms nobody.
    build(
        ["1", DESCRIBE, "&member"],
        "printf(\"hello, world\\n\"), fflush(stdout)",
    );
    let (output, summary) = run(&scenario, &folder.join("out"), &[]);
    assert_eq!(summary["failures"], Value::Null, "{}", text(&output));
    for (parts, told) in REFUSED {
        build(parts, "");
        let (output, _) = run(&scenario, &folder.join("none"), &[]);
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output).contains(told), "{told}\n{}", text(&output));
    }
    std::fs::write(folder.join("hostile.so"), "no library").expect("a file");
    let (output, _) = run(&scenario, &folder.join("none"), &[]);
    assert!(
        text(&output).contains("cannot be loaded"),
        "{}",
        text(&output)
    );
    std::fs::remove_dir_all(folder).expect("removed");
}
