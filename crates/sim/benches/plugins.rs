//! What a step of a controller costs by host, side by side in one run.
//!
//! `cargo bench -p appell-sim --bench plugins`. Needs `cc`; without `python3` or the program itself
//! (`cargo build --release`) their rows are left out.
#![allow(missing_docs)]

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use appell_plugin::{Limits, Plugin};
use appell_sim::block::{Block, Kernel, Now, Port, Wired};

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
#include <math.h>
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
"#;

const PYTHON: &str = r#"
import math
from appell_plugin import controller
@controller(inputs={"x": "m", "y": "m", "yaw": "rad"}, outputs={"forward": "m/s", "yaw_rate": "rad/s"})
def law(now, inputs, parameters, memory):
    dx, dy = 4.0 - inputs["x"], 1.0 - inputs["y"]
    return 0.2 * min(math.sqrt(dx * dx + dy * dy), 1.0), 0.5 * (dy - inputs["yaw"])
"#;

/// Best of several repetitions, ns a step.
fn best(count: u64, mut step: impl FnMut(u64)) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..7 {
        let start = Instant::now();
        for k in 0..count {
            step(k);
        }
        best = best.min(start.elapsed().as_secs_f64() * 1e9 / count as f64);
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
    let mut output = [0.0; 2];
    Some(best(count, |k| {
        let input = [k as f64 * 1e-6, 0.5, 0.1];
        let stepped = plugin.step(member, 0.0, 0.01, black_box(&input), &mut output);
        stepped.expect("a step");
        black_box(output);
    }))
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
    let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sdk/c");
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

    println!("a step of a controller, ns, and what the border adds to one that is built in");
    println!("  {:40} {base:10.1}", "built in");
    for (name, file, is_trusted, count) in [
        ("C library in this process", &library, true, 1_000_000),
        ("C library in a process of its own", &library, false, 5_000),
        ("Python in a process of its own", &python, false, 2_000),
    ] {
        if let Some(time) = plugin(file, is_trusted, count) {
            println!("  {name:40} {time:10.1} {:+10.1}", time - base);
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
}
