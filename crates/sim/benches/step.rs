//! Speed of one robot, side by side in one run: ratios, not absolutes.
//!
//! `cargo bench -p appell-sim`. Each figure is the least of several repetitions.
#![allow(missing_docs)]

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use appell_model::dynamics::{Dynamics, Held};
use appell_model::ground::Ground;
use appell_model::integrate::{Exponential, RungeKutta4};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_sim::build::{self, DriveModel};
use appell_sim::record::{Event, Header, Mcap, RecordError, Recorder};
use appell_sim::run::Run;
use appell_sim::scenario;
use serde_json::Value;

const STEPS: usize = 200_000;

/// Least time of `rounds` repetitions, ns per step.
fn least(rounds: usize, steps: usize, mut act: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..rounds {
        let start = Instant::now();
        act();
        best = best.min(start.elapsed().as_secs_f64());
    }
    1e9 * best / steps as f64
}

/// The closed form of the two-wheel robot with motors, by hand: seven states and the angles of both
/// wheels, heading as (cos, sin) renewed once a step. What the general model is measured against.
struct Hand {
    m: f64,
    i: f64,
    am: f64,
    half: f64,
    radius: f64,
    gain: f64,
    emf: f64,
    r: f64,
    l: f64,
}

type HandState = [f64; 11];

#[inline(always)]
fn ahead(x: &HandState, k: &HandState, h: f64) -> HandState {
    let mut moved = *x;
    for i in 0..moved.len() {
        moved[i] = h.mul_add(k[i], x[i]);
    }
    moved
}

impl Hand {
    #[inline(always)]
    fn rate(&self, x: &HandState, u: [f64; 2]) -> HandState {
        let [_, _, _, cos, sin, v, w, left, right, _, _] = *x;
        let (tl, tr) = (self.gain * left, self.gain * right);
        let dv = (w.mul_add(-self.am * w, (tl + tr) / self.radius)) / self.m;
        let dw = (w.mul_add(self.am * v, self.half * (tr - tl) / self.radius)) / self.i;
        let (ql, qr) = (
            (v - self.half * w) / self.radius,
            (v + self.half * w) / self.radius,
        );
        let dl = (u[0] - self.r * left - self.emf * ql) / self.l;
        let dr = (u[1] - self.r * right - self.emf * qr) / self.l;
        [
            v * cos,
            v * sin,
            w,
            -sin * w,
            cos * w,
            dv,
            dw,
            dl,
            dr,
            ql,
            qr,
        ]
    }

    #[inline(always)]
    fn step_plain(&self, x: &mut HandState, u: [f64; 2], h: f64) {
        let a = self.rate(x, u);
        let b = self.rate(&ahead(x, &a, 0.5 * h), u);
        let c = self.rate(&ahead(x, &b, 0.5 * h), u);
        let d = self.rate(&ahead(x, &c, h), u);
        for i in 0..11 {
            x[i] += h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
        }
        let (sin, cos) = Scalar::sin_cos(x[2]);
        (x[3], x[4]) = (cos, sin);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn step_fused(&self, x: &mut HandState, u: [f64; 2], h: f64) {
        self.step_plain(x, u, h);
    }

    fn step(&self, x: &mut HandState, u: [f64; 2], h: f64) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            // SAFETY: the features were found on this processor.
            #[allow(unsafe_code)]
            unsafe {
                self.step_fused(x, u, h);
            }
            return;
        }
        self.step_plain(x, u, h);
    }
}

struct Nothing;

impl Recorder for Nothing {
    fn begin(&mut self, _: &Header) -> Result<(), RecordError> {
        Ok(())
    }
    fn frame(&mut self, _: f64, row: &[f64]) -> Result<(), RecordError> {
        black_box(row);
        Ok(())
    }
    fn event(&mut self, _: &Event) -> Result<(), RecordError> {
        Ok(())
    }
    fn finish(&mut self, _: &Value) -> Result<(), RecordError> {
        Ok(())
    }
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let scenario = root.join("scenarios/slalom.toml");
    let loaded = scenario::load(&scenario, &[]).expect("the shipped scenario is valid");
    let file = loaded.scenario.robot[0].platform.clone().expect("loaded");
    let bare = scenario::Platform {
        wheel: file
            .wheel
            .iter()
            .filter(|w| w.name != "caster")
            .cloned()
            .collect(),
        ..file.clone()
    };

    let hand = Hand {
        m: 12.0,
        i: 1.4,
        am: -0.5,
        half: 0.2,
        radius: 0.1,
        gain: 1.0,
        emf: 1.0,
        r: 1.2,
        l: 0.002,
    };
    let by_hand = least(7, STEPS, || {
        let mut x: HandState = [0.0, 0.0, 0.3, 0.955, 0.2955, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0];
        for k in 0..STEPS {
            hand.step(&mut x, black_box([6.0 + (k & 1) as f64, 7.0]), 1e-3);
        }
        black_box(x);
    });
    println!("hand-written closed form, RK4         {by_hand:8.1} ns/step");

    let general = |file: &scenario::Platform, name: &str, exponential: bool| {
        let platform = build::platform(file, DriveModel::AsBuilt, 9.81).expect("checked");
        let x0 = build::rest_state(&platform, [0.0, 0.0, 0.3], &[]);
        let system = Rolling::new(platform, Ground::flat(9.81));
        let sizes = system.sizes();
        let mut u = vec![0.0; sizes.input];
        let time = least(7, STEPS, || {
            let (mut x, mut mode) = (x0.clone(), vec![1.0; sizes.mode]);
            let mut rk4 = RungeKutta4::new(sizes.state, sizes.input);
            let mut etd = Exponential::new(&system, 1e-3).expect("constant geometry");
            for k in 0..STEPS {
                (u[0], u[1]) = (6.0 + (k & 1) as f64, 7.0);
                if exponential {
                    etd.step(&system, &Held(black_box(&u)), 0.0, 1e-3, &mut x, &mut mode);
                } else {
                    rk4.step(&system, &Held(black_box(&u)), 0.0, 1e-3, &mut x, &mut mode);
                }
            }
            black_box(&x);
        });
        println!(
            "{name:37} {time:8.1} ns/step   {:5.2} x hand-written",
            time / by_hand
        );
    };
    general(&bare, "general model, two wheels, RK4", false);
    general(&file, "general model with caster, RK4", false);
    general(&bare, "general model, two wheels, ETD2", true);

    for (label, period) in [
        ("no rows recorded (1 row per 10 s)", 10.0),
        ("row built at 100 Hz, not written", 0.01),
    ] {
        let mut changed = loaded.clone();
        changed.scenario.record.period = period;
        changed.scenario.robot[0].task = None;
        let mut steps = 0;
        let time = least(5, 1, || {
            let mut run = Run::new(&loaded_with(&changed), 0).expect("valid");
            steps = 0;
            while run.world.step(&mut Nothing).expect("runs") {
                steps += 1;
            }
        });
        println!("world step, {label:33} {:6.1} ns/step", time / steps as f64);
    }
    for (label, period) in [("100 Hz", 0.01), ("1 kHz", 0.001)] {
        let mut changed = loaded_with(&loaded);
        changed.scenario.record.period = period;
        let mut simulated = 0.0;
        let folder = std::env::temp_dir().join("appell-bench");
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let time = least(5, 1, || {
            let mut run = Run::new(&changed, 0).expect("valid");
            let mut recorder = Mcap::create(&folder.join("bench.mcap")).expect("a file");
            let summary = run.execute(&mut recorder, &mut |_| {}).expect("runs");
            simulated = summary.duration;
        });
        println!(
            "slalom with MCAP recording at {label:7} {:8.0} times real time",
            simulated / (1e-9 * time)
        );
    }
}

/// The same scenario without a task ends after its duration: a fixed number of steps.
fn loaded_with(loaded: &scenario::Loaded) -> scenario::Loaded {
    let mut changed = loaded.clone();
    if changed.scenario.robot[0].task.is_none() {
        changed.scenario.robot[0].controller = Some(scenario::Controller::Signals {
            period: 0.01,
            channel: vec![scenario::Channel {
                to: "forward".into(),
                signal: scenario::Signal::Sine {
                    amplitude: 0.3,
                    period: 5.0,
                    phase_deg: 0.0,
                    offset: 0.0,
                },
            }],
        });
    }
    changed
}
