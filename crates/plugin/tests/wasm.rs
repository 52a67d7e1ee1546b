//! Plug-ins as modules of WebAssembly, compiled from C.
#![cfg(feature = "wasm")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use appell_plugin::{Fault, Limits, Plugin, conformance, wire::Call};
use serde_json::json;

/// A member remembers a sum and a count of steps.
const SOURCE: &str = r#"
#include "appell_plugin.h"
typedef struct { double gain, sum; int steps; } Member;
static Member members[64];
static int made, unused;
static int deep(int k) { volatile char room[4096]; room[k % 4096] = (char)k; return k ? deep(k + 1) + room[0] : 0; }
INITIALIZE
uint32_t appell_abi(void) { return ABI; }
const char *appell_describe(void) { DESCRIBE; return TEXT; }
void *appell_create(const double *p, const char *c)
{
    (void)deep, (void)unused;
    CREATE;
    if (made == 64 || c[0] != '{') return 0;
    members[made].gain = p[0];
    return &members[made++];
}
void appell_destroy(void *m) { (void)m; DESTROY; }
const char *appell_reason(void *m) { (void)m; REASON; return "in its own words"; }
int32_t appell_step(void *m, double t, double dt, const double *in, double *out)
{
    BEGIN;
    Member *self = m;
    self->sum += in[0] * self->gain;
    out[0] = self->sum + dt + 1.0 / in[1];
    (void)t;
    if (++self->steps < 5) return 0;
    STEP;
    return 0;
}
size_t appell_save(void *m, uint8_t *bytes, size_t room)
{
    SAVE;
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

const TEXT: &str = r#""{\"protocol\": 1, \"name\": \"total\", \"inputs\": [{\"name\": \"pose.x\", \"unit\": \"m\"}, {\"name\": \"pose.y\", \"unit\": \"m\"}], \"outputs\": [{\"name\": \"command.forward\", \"unit\": \"m/s\", \"min\": -1000, \"max\": 1000}], \"parameters\": [{\"name\": \"gain\", \"default\": 2}]}""#;

/// Compiles the source with some of its words replaced, for this machine or for all.
fn compile(name: &str, words: &[(&str, &str)], is_module: bool) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("appell-wasm-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let mut text = SOURCE.to_owned();
    let defaults = [
        ("INITIALIZE", ""),
        ("ABI", "APPELL_ABI"),
        ("DESCRIBE", ""),
        ("TEXT", TEXT),
        ("CREATE", ""),
        ("DESTROY", ""),
        ("REASON", ""),
        ("BEGIN", ""),
        ("STEP", ""),
        ("SAVE", ""),
    ];
    for (word, default) in defaults {
        let given = words.iter().find(|(of, _)| *of == word);
        let marks = text.replace(&format!("APPELL_{word}"), "\0");
        let default = default.replace("APPELL_ABI", "\0");
        let with = given.map_or(default.as_str(), |(_, with)| with);
        text = marks
            .replace(word, with)
            .replace('\0', &format!("APPELL_{word}"));
    }
    let source = folder.join(format!("{name}.c"));
    std::fs::write(&source, text).expect("a file");
    let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sdk/c");
    let (compiler, file, flags): (&str, _, &[&str]) = match is_module {
        true => (
            "clang",
            folder.join(format!("{name}.wasm")),
            &[
                "--target=wasm32",
                "-mbulk-memory",
                "-nostdlib",
                "-Wl,--no-entry,--export-dynamic",
                "-Wl,-z,stack-size=1048576",
            ],
        ),
        false => (
            "cc",
            folder.join(format!("{name}.so")),
            &["-shared", "-fPIC"],
        ),
    };
    let status = Command::new(compiler)
        .args(flags)
        .args(["-O2", "-ffp-contract=off", "-I"])
        .args([&header, Path::new("-o"), &file, &source])
        .status();
    let status = status.unwrap_or_else(|error| panic!("{compiler} compiles the tests: {error}"));
    assert!(status.success(), "{name}");
    file
}

fn open(name: &str, words: &[(&str, &str)], limits: &Limits) -> Result<Plugin, Fault> {
    Plugin::open(&compile(name, words, true), limits.clone())
}

/// The steps of one member, up to the first that fails.
fn drive(plugin: &mut Plugin, steps: usize) -> (Vec<f64>, Option<Fault>) {
    let mut rows = Vec::new();
    let member = match plugin.create(&BTreeMap::new(), &json!({})) {
        Ok(member) => member,
        Err(fault) => return (rows, Some(fault)),
    };
    for k in 0..steps {
        let mut output = [0.0];
        let input = [0.1 * k as f64, 1.0 + k as f64];
        if let Err(fault) = plugin.step(member, 0.01 * k as f64, 0.01, &input, &mut output) {
            return (rows, Some(fault));
        }
        rows.push(output[0]);
    }
    plugin.destroy(member);
    (rows, None)
}

#[test]
fn peer_native_library_has_the_same_bits() {
    let limits = Limits::default();
    let mut module = open("peer", &[], &limits).expect("a module");
    let trusted = Limits {
        is_trusted: true,
        ..limits
    };
    let mut native = Plugin::open(&compile("peer", &[], false), trusted).expect("a library");
    assert_eq!(module.descriptor(), native.descriptor());
    let (a, b) = (drive(&mut module, 50), drive(&mut native, 50));
    assert_eq!(a.0.len(), 50);
    assert!(a.1.is_none() && b.1.is_none());
    // Sums and quotients, which all machines round alike.
    assert!(
        a.0.iter()
            .zip(&b.0)
            .all(|(a, b)| a.to_bits() == b.to_bits())
    );
}

#[test]
fn invariant_conformance() {
    let file = compile("conformance", &[], true);
    let findings = conformance(&file, &Limits::default(), 100).expect("findings");
    assert_eq!(findings.len(), 7);
    for finding in findings {
        assert!(
            finding.result.is_ok(),
            "{}: {:?}",
            finding.rule,
            finding.result
        );
    }
}

/// Steps members one by one, inside.
const MANY: &str =
    "int32_t appell_step_many(int32_t count, void *const *m, const double *t, double dt,
    const double *in, double *out)
{
    for (int32_t k = 0; k < count; k++)
        if (appell_step(m[k], t[k], dt, in + 2 * k, out + k)) return k + 1;
    return 0;
}";

/// Members that step in one call have the bits of those that step one by one.
#[test]
fn invariant_together_as_alone() {
    let fails = ("STEP", "if (in[1] == 13.0) return 7");
    let limits = Limits::default();
    let mut alone = open("alone", &[fails], &limits).expect("a module");
    let mut plugin = open("together", &[fails, ("INITIALIZE", MANY)], &limits).expect("a module");
    let members: Vec<u32> = (0..3)
        .map(|_| {
            plugin
                .create(&BTreeMap::new(), &json!({}))
                .expect("a member")
        })
        .collect();
    let one = alone
        .create(&BTreeMap::new(), &json!({}))
        .expect("a member");
    let mut output = [0.0; 3];
    for k in 0..12 {
        let input = [0.3, 1.0 + f64::from(k)];
        let call = |&member: &u32| Call {
            member,
            t: f64::from(k),
            dt: 0.1,
            input: &input,
        };
        let calls: Vec<Call<'_>> = members.iter().map(call).collect();
        plugin.step_many(&calls, &mut output).expect("steps");
        let mut single = [0.0];
        alone
            .step(one, f64::from(k), 0.1, &input, &mut single)
            .expect("a step");
        assert!(
            output
                .iter()
                .all(|value| value.to_bits() == single[0].to_bits())
        );
    }
    let input = [0.3, 13.0];
    let call = |&member: &u32| Call {
        member,
        t: 12.0,
        dt: 0.1,
        input: &input,
    };
    let calls: Vec<Call<'_>> = members.iter().map(call).collect();
    let (place, fault) = plugin.step_many(&calls, &mut output).expect_err("7");
    assert_eq!(
        (place, fault.to_string().as_str()),
        (0, "step: in its own words")
    );
}

/// An output that a step leaves out is not taken from the step before.
#[test]
fn invariant_nothing_is_left_of_the_step_before() {
    let words = [
        ("INITIALIZE", MANY),
        ("BEGIN", "if (in[1] == 13.0) return 0"),
    ];
    let trusted = Limits {
        is_trusted: true,
        ..Limits::default()
    };
    for is_module in [true, false] {
        let file = compile("left", &words, is_module);
        let mut plugin = Plugin::open(&file, trusted.clone()).expect("a plug-in");
        let mut member = || {
            plugin
                .create(&BTreeMap::new(), &json!({}))
                .expect("a member")
        };
        let members = [member(), member()];
        let mut step = |second: [f64; 2]| {
            let inputs = [[0.3, 1.0], second];
            let call = |k: usize| Call {
                member: members[k],
                t: 0.0,
                dt: 0.1,
                input: &inputs[k],
            };
            let (calls, mut output) = ([0, 1].map(call), [0.0; 2]);
            let many = plugin.step_many(&calls, &mut output);
            let last = &calls[1];
            let one = plugin.step(last.member, last.t, last.dt, last.input, &mut output[..1]);
            (
                many.map_err(|(place, fault)| (place, fault.to_string())),
                one,
            )
        };
        let (many, one) = step([0.3, 1.0]);
        assert!(many.is_ok() && one.is_ok());
        let (many, one) = step([0.3, 13.0]);
        let told = "outputs.command.forward: must be finite, got NaN";
        assert_eq!(many, Err((1, told.to_owned())));
        assert_eq!(one.expect_err("no number").to_string(), told);
    }
}

/// A context of any length has room, and the numbers of steps still do.
#[test]
fn invariant_long_contexts_have_room() {
    let mut plugin = open("long", &[], &Limits::default()).expect("a module");
    let (expected, _) = drive(&mut plugin, 3);
    let long = json!({ "path": "x".repeat(300_000) });
    let member = plugin.create(&BTreeMap::new(), &long).expect("a member");
    plugin.destroy(member);
    assert_eq!(drive(&mut plugin, 3).0, expected);
}

/// What a module does wrong, and what is told: the same each time, and at the same step.
#[test]
fn refusal_of_hostile_modules() {
    const LOOP: &str = "for (;;) unused++";
    const GROW: &str =
        "for (;;) if (__builtin_wasm_memory_grow(0, 16) == (unsigned long)-1) __builtin_trap()";
    let fuel = "used up its fuel of 1000000 instructions";
    let at_start = "used up its fuel of 500000000 instructions";
    let cases: [(&str, &str, &str, usize); 22] = [
        ("STEP", LOOP, fuel, 4),
        ("STEP", "__builtin_trap()", "step: trapped: it panicked", 4),
        (
            "STEP",
            "*(volatile int *)0xfffffff0 = 1",
            "step: trapped: out of bounds memory access",
            4,
        ),
        ("STEP", "out[0] = deep(1)", "step: trapped", 4),
        (
            "STEP",
            GROW,
            "step: asked for more memory than its 64 MiB",
            4,
        ),
        (
            "STEP",
            "out[0] = 0.0 / (dt - dt)",
            "outputs.command.forward: must be finite, got NaN",
            4,
        ),
        (
            "STEP",
            "out[0] = 1.0 / (dt - dt)",
            "outputs.command.forward: must be finite, got inf",
            4,
        ),
        (
            "STEP",
            "out[0] = 1001",
            "outputs.command.forward: must be at most 1000",
            4,
        ),
        ("STEP", "return 3", "step: in its own words", 4),
        (
            "STEP",
            "((void (*)(double, int))(unsigned long)(1 + unused))(1.0, 2)",
            "step: trapped",
            4,
        ),
        (
            "STEP",
            "volatile int none = 0; out[0] = self->steps / none",
            "step: trapped: integer divide by zero",
            4,
        ),
        ("CREATE", LOOP, at_start, 0),
        ("CREATE", "return 0", "create: in its own words", 0),
        ("CREATE", "__builtin_trap()", "create: trapped", 0),
        ("DESCRIBE", LOOP, at_start, 0),
        (
            "DESCRIBE",
            "return (const char *)0xfffffff0",
            "describe: a text must end with zero",
            0,
        ),
        ("TEXT", "0", "describe: must be a text, got none", 0),
        ("TEXT", "\"{\"", "describe: must be JSON", 0),
        (
            "ABI",
            "99",
            "describe.abi: must be 1, the version of the interface, got 99",
            0,
        ),
        (
            "INITIALIZE",
            "__attribute__((visibility(\"default\"))) void _initialize(void) { for (;;) unused++; }",
            at_start,
            0,
        ),
        (
            "INITIALIZE",
            "__attribute__((visibility(\"default\"))) void _initialize(void) { __builtin_trap(); }",
            "start: trapped",
            0,
        ),
        (
            "INITIALIZE",
            "__attribute__((import_module(\"wasi_snapshot_preview1\"), import_name(\"fd_write\"))) int fd_write(int); __attribute__((visibility(\"default\"))) void _initialize(void) { fd_write(1); }",
            "start.imports: must be mathematics, got wasi_snapshot_preview1.fd_write",
            0,
        ),
    ];
    let limits = Limits {
        fuel: 1_000_000,
        memory: 64,
        ..Limits::default()
    };
    for (k, (word, with, told, step)) in cases.into_iter().enumerate() {
        let file = compile(&format!("hostile{k}"), &[(word, with)], true);
        let attempt = || match Plugin::open(&file, limits.clone()) {
            Err(fault) => (0, fault.to_string()),
            Ok(mut plugin) => {
                let (rows, fault) = drive(&mut plugin, 10);
                let fault = fault.unwrap_or_else(|| panic!("no fault of {with}"));
                // What trapped is not spoken to again; what failed in order is.
                let is_trap = fault.problem.contains("trapped")
                    || fault.problem.contains("used up")
                    || fault.problem.contains("asked for");
                assert_eq!(plugin.is_alive(), !is_trap, "{with}");
                (rows.len(), fault.to_string())
            }
        };
        let (rows, fault) = attempt();
        assert!(fault.contains(told), "{with}: {fault}");
        assert_eq!(rows, step, "{with}");
        assert_eq!(attempt(), (rows, fault), "{with}");
    }
}

/// What fails where no failure is told of makes no harm.
#[test]
fn refusal_of_what_ends_badly() {
    let limits = Limits {
        fuel: 1_000_000,
        ..Limits::default()
    };
    let mut plugin =
        open("destroy", &[("DESTROY", "for (;;) unused++")], &limits).expect("a module");
    assert_eq!(drive(&mut plugin, 3).0.len(), 3);
    assert!(!plugin.is_alive());
    let words = [
        ("STEP", "return 1"),
        ("REASON", "return (const char *)0xfffffff0"),
    ];
    let mut plugin = open("reason", &words, &limits).expect("a module");
    assert_eq!(
        drive(&mut plugin, 9).1.expect("a fault").to_string(),
        "step: gave 1"
    );
    let words = [("SAVE", "if (room == 0) return 0x7fffffff")];
    let mut plugin = open("save", &words, &limits).expect("a module");
    let member = plugin
        .create(&BTreeMap::new(), &json!({}))
        .expect("a member");
    let told = plugin.save(member).expect_err("too much").to_string();
    assert_eq!(told, "save: remembers 2147483647 bytes, more than 16777216");
}

#[test]
fn refusal_of_what_is_no_module() {
    let folder = std::env::temp_dir().join(format!("appell-wasm-{}-none", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let cases: [(&[u8], &str); 4] = [
        (b"", "must begin as a module does"),
        (b"(module)", "must begin as a module does"),
        (b"\0asm\x01\0\0\0", "must export its memory"),
        // A component.
        (b"\0asm\x0d\0\x01\0", "cannot be compiled"),
    ];
    for (k, (bytes, told)) in cases.into_iter().enumerate() {
        let file = folder.join(format!("{k}.wasm"));
        std::fs::write(&file, bytes).expect("a file");
        let fault = Plugin::open(&file, Limits::default())
            .expect_err("no module")
            .to_string();
        assert!(fault.contains(told), "{fault}");
    }
    std::fs::remove_dir_all(folder).expect("removed");
}
