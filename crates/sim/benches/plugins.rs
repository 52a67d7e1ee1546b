//! What a step of a controller costs by host, side by side in one run.
//!
//! `cargo build --release && cargo bench -p appell-sim --features wasm --bench plugins`. Needs `cc`, `clang` with lld
//! and `python3`; a row that cannot be had says why.
#![allow(missing_docs)]

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use appell_plugin::wire::Call;
use appell_plugin::{Limits, Plugin};
use appell_sim::block::{Block, Kernel, Now, Port, Wired};
use appell_sim::record::{Memory, Recorder};
use appell_sim::run::Run;
use appell_sim::scenario::load;

/// The law of all rows: turn to a beacon, and drive.
struct Law<T> {
    gain: T,
}

appell_model::lanewise!(Law { gain });

impl Kernel<f64> for Law<f64> {
    #[inline(always)]
    fn act(&mut self, _now: &Now<'_, f64>, input: &[f64], output: &mut [f64]) {
        let (dx, dy) = (4.0 - input[0], 1.0 - input[1]);
        output[0] = 0.2 * (dx * dx + dy * dy).sqrt().min(1.0);
        output[1] = self.gain * (dy - input[2]);
    }
}

const C: &str = r#"
#include "appell_plugin.h"
static int member;
uint32_t appell_abi(void) { return APPELL_ABI; }
const char *appell_describe(void) { return "{\"protocol\": 1, \"name\": \"law\", \"inputs\": [{\"name\": \"x\", \"unit\": \"m\"}, {\"name\": \"y\", \"unit\": \"m\"}, {\"name\": \"yaw\", \"unit\": \"rad\"}], \"outputs\": [{\"name\": \"forward\", \"unit\": \"m/s\"}, {\"name\": \"yaw_rate\", \"unit\": \"rad/s\"}]}"; }
void *appell_create(const double *p, const char *c) { (void)p; (void)c; return &member; }
void appell_destroy(void *m) { (void)m; }
int32_t appell_step(void *m, double t, double dt, const double *in, double *out)
{
    (void)m; (void)t; (void)dt;
    const double dx = 4.0 - in[0], dy = 1.0 - in[1];
    out[0] = 0.2 * fmin(sqrt(dx * dx + dy * dy), 1.0);
    out[1] = 0.5 * (dy - in[2]);
    return 0;
}
int32_t appell_step_many(int32_t count, void *const *m, const double *t, double dt, const double *in, double *out)
{
    for (int32_t k = 0; k < count; k++) appell_step(m[k], t[k], dt, in + 3 * k, out + 2 * k);
    return 0;
}
"#;

const FMU: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Lag" guid="{lag}">
  <CoSimulation modelIdentifier="lag" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
  </ModelVariables>
</fmiModelDescription>
"#;

const PYTHON: &str = r#"
import math
from appell_plugin import controller
@controller(inputs={"x": "m", "y": "m", "yaw": "rad"}, outputs={"forward": "m/s", "yaw_rate": "rad/s"})
def law(now, inputs, parameters, memory):
    dx, dy = 4.0 - inputs["x"], 1.0 - inputs["y"]
    return 0.2 * min(math.sqrt(dx * dx + dy * dy), 1.0), 0.5 * (dy - inputs["yaw"])
"#;

/// Best of many rounds, ns a step. They are short: what else a busy machine does takes part in long ones.
fn best(count: u64, mut step: impl FnMut(u64)) -> f64 {
    const ROUNDS: u64 = 200;
    let steps = count.div_ceil(ROUNDS);
    let mut best = f64::INFINITY;
    for _ in 0..7 * ROUNDS {
        let start = Instant::now();
        for k in 0..steps {
            step(k);
        }
        best = best.min(start.elapsed().as_secs_f64() * 1e9 / steps as f64);
    }
    best
}

fn plugin(file: &Path, is_trusted: bool, count: u64) -> Option<f64> {
    let limits = Limits {
        is_trusted,
        ..Limits::default()
    };
    let opened = Plugin::open(file, limits);
    let mut plugin = opened
        .map_err(|fault| eprintln!("left out: {fault}"))
        .ok()?;
    let member = plugin
        .create(&BTreeMap::new(), &serde_json::Value::Null)
        .ok()?;
    let (reads, writes) = (
        plugin.descriptor().inputs.len(),
        plugin.descriptor().outputs.len(),
    );
    let mut output = vec![0.0; writes];
    let mut t = 0.0;
    Some(best(count, |k| {
        let input = [k as f64 * 1e-6, 0.5, 0.1];
        // An FMU keeps its time.
        let stepped = plugin.step(member, t, 0.01, black_box(&input[..reads]), &mut output);
        stepped.expect("a step");
        t += 0.01;
        black_box(&output);
    }))
}

/// Members that step in one call, ns for each.
fn together(file: &Path, is_trusted: bool) -> Option<f64> {
    const MEMBERS: usize = 1000;
    let limits = Limits {
        is_trusted,
        ..Limits::default()
    };
    let mut plugin = Plugin::open(file, limits).ok()?;
    let context = serde_json::Value::Null;
    let members: Vec<u32> = (0..MEMBERS)
        .map(|_| plugin.create(&BTreeMap::new(), &context).expect("a member"))
        .collect();
    let mut output = vec![0.0; 2 * MEMBERS];
    let input = [0.1, 0.5, 0.1];
    let calls: Vec<Call<'_>> = members
        .iter()
        .map(|&member| Call {
            member,
            t: 0.0,
            dt: 0.01,
            input: &input,
        })
        .collect();
    let all = best(300, |_| {
        let stepped = plugin.step_many(black_box(&calls), &mut output);
        stepped.expect("steps");
        black_box(&output);
    });
    Some(all / MEMBERS as f64)
}

/// Longest step of a run, and longest of those in which controllers changed, microseconds.
fn changes() -> Option<[f64; 2]> {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/swap.toml");
    let loaded = load(&scenario, &Vec::new()).ok()?;
    let mut run = Run::new(&loaded, 0)
        .map_err(|error| eprintln!("left out: {error}"))
        .ok()?;
    let mut memory = Memory::new();
    memory.begin(&run.header).ok()?;
    let (mut steps, mut changes) = (Vec::new(), Vec::new());
    loop {
        let before = run.world.swapped().len();
        let start = Instant::now();
        let goes_on = run.world.step(&mut memory).ok()?;
        let took = 1e6 * start.elapsed().as_secs_f64();
        match run.world.swapped().len() > before {
            true => changes.push(took),
            false => steps.push(took),
        }
        if !goes_on {
            let longest = |of: &[f64]| of.iter().copied().fold(0.0, f64::max);
            return Some([longest(&steps), longest(&changes)]);
        }
    }
}

fn main() {
    let port = |path: &str| Port::new(path.to_owned(), "m");
    let inputs = ["x", "y", "yaw"].map(port).to_vec();
    let outputs = ["forward", "yaw_rate"].map(port).to_vec();
    let mut built_in: Box<dyn Block> = Box::new(Wired::new(inputs, outputs, Law { gain: 0.5 }));
    let mut output = [0.0; 2];
    let base = best(1_000_000, |k| {
        let now = Now {
            ticks: &[k],
            t: 0.0,
            dt: 0.01,
        };
        let input = [k as f64 * 1e-6, 0.5, 0.1];
        built_in
            .step(&now, black_box(&input), &mut output)
            .expect("a step");
        black_box(output);
    });

    let folder = std::env::temp_dir().join(format!("appell-bench-plugins-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let write = |name: &str, text: &str| -> PathBuf {
        let file = folder.join(name);
        std::fs::write(&file, text).expect("a file");
        file
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let header = root.join("sdk/c");
    let library = folder.join("law.so");
    let source = write("law.c", C);
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O2", "-I"])
        .arg(&header)
        .arg("-o")
        .args([&library, &source])
        .arg("-lm")
        .status();
    assert!(
        built.is_ok_and(|status| status.success()),
        "cc builds the library"
    );
    let python = write("law.py", PYTHON);
    let module = folder.join("law.wasm");
    let clang = Command::new("clang")
        .args([
            "--target=wasm32",
            "-mbulk-memory",
            "-nostdlib",
            "-O2",
            "-Wl,--no-entry,--export-dynamic",
        ])
        .arg("-I")
        .arg(&header)
        .arg("-o")
        .args([&module, &source])
        .status();
    assert!(
        clang.is_ok_and(|status| status.success()),
        "clang builds the module"
    );
    // An FMU is an archive, which Python can pack.
    let binaries = folder.join("binaries/linux64");
    std::fs::create_dir_all(&binaries).expect("a folder");
    write("modelDescription.xml", FMU);
    let lag = root.join("crates/plugin/tests/fmu/two.c");
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O2", "-o"])
        .args([&binaries.join("lag.so"), &lag])
        .arg("-lm")
        .status();
    let packed = Command::new("python3")
        .args([
            "-m",
            "zipfile",
            "-c",
            "lag.fmu",
            "modelDescription.xml",
            "binaries",
        ])
        .current_dir(&folder)
        .status();
    let is_packed = [built, packed]
        .into_iter()
        .all(|s| s.is_ok_and(|status| status.success()));
    assert!(is_packed, "cc and python3 make the FMU");
    let fmu = folder.join("lag.fmu");

    println!("a step of a controller, ns, and what the border adds to one that is built in");
    println!("  {:40} {base:10.1}", "built in");
    for (name, file, is_trusted, count) in [
        ("C library in this process", &library, true, 1_000_000),
        ("C as a module of WebAssembly", &module, false, 1_000_000),
        ("C library in a process of its own", &library, false, 5_000),
        ("FMU (a lag) in a process of its own", &fmu, false, 5_000),
        ("Python in a process of its own", &python, false, 2_000),
    ] {
        if let Some(time) = plugin(file, is_trusted, count) {
            println!("  {name:40} {time:10.1} {:+10.1}", time - base);
        }
    }
    println!("a thousand members in one call, ns for each");
    for (name, file, is_trusted) in [
        ("C library in this process", &library, true),
        ("C as a module of WebAssembly", &module, false),
    ] {
        if let Some(time) = together(file, is_trusted) {
            println!("  {name:40} {time:10.1}");
        }
    }
    if let Some([step, change]) = changes() {
        println!("steps of scenarios/swap.toml, microseconds");
        println!("  {:40} {step:10.1}", "the longest");
        println!(
            "  {:40} {change:10.1}",
            "the longest in which controllers change"
        );
    }
    let _ = std::fs::remove_dir_all(&folder);
}
