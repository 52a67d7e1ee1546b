//! Speed of one robot, side by side in one run: ratios, not absolutes.
//!
//! `cargo bench -p appell-sim --bench step -- [model] [world] [slalom]`. Each figure is the least of
//! several repetitions.
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
use appell_sim::record::{Closing, Event, Header, Mcap, RecordError, Recorder};
use appell_sim::run::Run;
use appell_sim::scenario::{self, Integrator};

const STEPS: usize = 20_000;
/// Steps for which a command is held: a controller at 100 Hz.
const HELD: usize = 10;
const ROUNDS: usize = 60;

/// Least time of each act, s, over rounds in which they take turns: a disturbance of the machine
/// then falls on all of them, and ratios hold.
fn least<const N: usize>(rounds: usize, mut acts: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut best = [f64::INFINITY; N];
    for _ in 0..rounds {
        for (best, act) in best.iter_mut().zip(&mut acts) {
            let start = Instant::now();
            act();
            *best = best.min(start.elapsed().as_secs_f64());
        }
    }
    best
}

/// The closed form of the two-wheel robot with motors, by hand: seven states and the angles of both
/// wheels, heading as (cos, sin) renewed once a step. What the general model is measured against.
/// Constants are multiplied out, so that no division is left in the loop. Supply and driver limit
/// the voltage as the robot's do; it keeps no energy ledger, and it knows one robot.
struct Hand {
    per_mass: f64,
    per_inertia: f64,
    am: f64,
    half: f64,
    per_radius: f64,
    gain: f64,
    emf: f64,
    r: f64,
    per_l: f64,
    /// R I_max and the voltage of the supply.
    window: f64,
    supply: f64,
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
    fn voltage<const LIMITED: bool>(&self, command: f64, emf: f64) -> f64 {
        if !LIMITED {
            return command;
        }
        // The scalar's, which are one instruction each; those of f64 look for NaN besides.
        let (max, min) = (<f64 as Scalar>::max, <f64 as Scalar>::min);
        let command = min(max(command, -self.supply), self.supply);
        let lowest = min(emf - self.window, self.supply);
        let highest = max(emf + self.window, -self.supply);
        min(max(command, lowest), highest)
    }

    #[inline(always)]
    fn rate<const LIMITED: bool>(&self, x: &HandState, u: [f64; 2]) -> HandState {
        let [_, _, _, cos, sin, v, w, left, right, _, _] = *x;
        let (tl, tr) = (self.gain * left, self.gain * right);
        let (traction, turning) = ((tl + tr) * self.per_radius, (tr - tl) * self.per_radius);
        let dv = w.mul_add(-self.am * w, traction) * self.per_mass;
        let dw = w.mul_add(self.am * v, self.half * turning) * self.per_inertia;
        let (ql, qr) = (
            (-self.half).mul_add(w, v) * self.per_radius,
            self.half.mul_add(w, v) * self.per_radius,
        );
        let (el, er) = (self.emf * ql, self.emf * qr);
        let dl = (-self.r).mul_add(left, self.voltage::<LIMITED>(u[0], el) - el) * self.per_l;
        let dr = (-self.r).mul_add(right, self.voltage::<LIMITED>(u[1], er) - er) * self.per_l;
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
    fn step_plain<const LIMITED: bool>(&self, x: &mut HandState, u: [f64; 2], h: f64) {
        let a = self.rate::<LIMITED>(x, u);
        let b = self.rate::<LIMITED>(&ahead(x, &a, 0.5 * h), u);
        let c = self.rate::<LIMITED>(&ahead(x, &b, 0.5 * h), u);
        let d = self.rate::<LIMITED>(&ahead(x, &c, h), u);
        for i in 0..11 {
            x[i] += h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
        }
        let (sin, cos) = Scalar::sin_cos(x[2]);
        (x[3], x[4]) = (cos, sin);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn steps_fused<const LIMITED: bool>(&self, x: &mut HandState, u: [f64; 2], h: f64) {
        for _ in 0..HELD {
            self.step_plain::<LIMITED>(x, u, h);
        }
    }

    fn steps<const LIMITED: bool>(&self, x: &mut HandState, u: [f64; 2], h: f64) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            // SAFETY: the features were found on this processor.
            #[allow(unsafe_code)]
            unsafe {
                self.steps_fused::<LIMITED>(x, u, h);
            }
            return;
        }
        for _ in 0..HELD {
            self.step_plain::<LIMITED>(x, u, h);
        }
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
    fn finish(&mut self, _: Closing<'_>) -> Result<(), RecordError> {
        Ok(())
    }
}

/// Whether a part was asked for on the command line; without a word, all are.
fn wanted(part: &str) -> bool {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"))
        .collect();
    words.is_empty() || words.iter().any(|word| word == part)
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let scenario = root.join("scenarios/slalom.toml");
    let loaded = scenario::load(&scenario, &[]).expect("the shipped scenario is valid");
    if wanted("model") {
        model(&loaded);
    }
    if wanted("world") {
        world(&loaded);
    }
    if wanted("slalom") {
        slalom(&loaded);
    }
}

/// The general model beside the hand-written loop.
fn model(loaded: &scenario::Loaded) {
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
        per_mass: 1.0 / 12.0,
        per_inertia: 1.0 / 1.4,
        am: -0.5,
        half: 0.2,
        per_radius: 1.0 / 0.1,
        gain: 1.0,
        emf: 1.0,
        r: 1.2,
        per_l: 1.0 / 0.002,
        window: 1e6,
        supply: 24.0,
    };
    let start: HandState = [0.0, 0.0, 0.3, 0.955, 0.2955, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0];
    let mut by_hand = || {
        let mut x = start;
        for k in 0..STEPS / HELD {
            hand.steps::<true>(&mut x, black_box([6.0 + (k & 1) as f64, 7.0]), 1e-3);
        }
        black_box(x);
    };
    let mut unlimited = || {
        let mut x = start;
        for k in 0..STEPS / HELD {
            hand.steps::<false>(&mut x, black_box([6.0 + (k & 1) as f64, 7.0]), 1e-3);
        }
        black_box(x);
    };
    // Inputs change every ten steps, as they do under a controller at 100 Hz.
    let general = |file: &scenario::Platform, exponential: bool| {
        let platform = build::platform(file, DriveModel::AsBuilt, 9.81).expect("checked");
        let x0 = build::rest_state(&platform, [0.0, 0.0, 0.3], &[]);
        let system = Rolling::new(platform, Ground::flat(9.81));
        let sizes = system.sizes();
        let mut u = vec![0.0; sizes.input];
        move || {
            let (mut x, mut mode) = (x0.clone(), vec![1.0; sizes.mode]);
            let mut rk4 = RungeKutta4::new(sizes.state, sizes.input);
            let mut etd = Exponential::new(&system, 1e-3).expect("constant geometry");
            for k in 0..STEPS / HELD {
                (u[0], u[1]) = (6.0 + (k & 1) as f64, 7.0);
                let (held, count) = (Held(black_box(&u[..])), HELD as u64);
                if exponential {
                    etd.steps(&system, &held, 0.0, 1e-3, count, &mut x, &mut mode);
                } else {
                    rk4.steps(&system, &held, 0.0, 1e-3, count, &mut x, &mut mode);
                }
            }
            black_box(&x);
        }
    };
    let (mut two, mut caster) = (general(&bare, false), general(&file, false));
    let (mut two_etd, mut caster_etd) = (general(&bare, true), general(&file, true));
    let times = least(
        ROUNDS,
        [
            &mut by_hand,
            &mut unlimited,
            &mut two,
            &mut caster,
            &mut two_etd,
            &mut caster_etd,
        ],
    );
    let names = [
        "hand-written closed form, RK4",
        "the same without its limits",
        "general model, two wheels, RK4",
        "general model with caster, RK4",
        "general model, two wheels, ETD2",
        "general model with caster, ETD2",
    ];
    for (name, time) in names.iter().zip(times) {
        println!(
            "{name:34} {:7.1} ns/step   {:5.2} x hand-written",
            1e9 * time / STEPS as f64,
            time / times[0]
        );
    }
}

/// A closed loop through `dyn` blocks: signals at 100 Hz, servo, plant, judge.
fn world(loaded: &scenario::Loaded) {
    for (label, integrator, period) in [
        ("RK4, no rows", Integrator::Rk4, 10.0),
        ("exponential, no rows", Integrator::Exponential, 10.0),
        ("exponential, rows at 100 Hz", Integrator::Exponential, 0.01),
    ] {
        let mut changed = loaded.clone();
        changed.scenario.record.period = period;
        changed.scenario.time.integrator = integrator;
        changed.scenario.time.duration = 100.0;
        let robot = &mut changed.scenario.robot[0];
        robot.task = None;
        robot.controller = Some(scenario::Controller::Signals {
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
        let mut best = f64::INFINITY;
        let mut run = Run::new(&changed, 0).expect("valid");
        for _ in 0..ROUNDS {
            let start = Instant::now();
            let goal = run.world.tick() + 1000;
            while run.world.tick() < goal {
                let limit = goal - run.world.tick();
                run.world.advance(limit, &mut Nothing).expect("runs");
            }
            best = best.min(start.elapsed().as_secs_f64() / 1000.0);
        }
        println!("world step, {label:34} {:6.1} ns/step", 1e9 * best);
    }
}

/// The slalom with motors, driven slowly enough to last a minute; planning is part of the time.
fn slalom(loaded: &scenario::Loaded) {
    for (label, period) in [("100 Hz", 0.01), ("1 kHz", 0.001)] {
        let mut changed = loaded.clone();
        changed.scenario.record.period = period;
        changed.scenario.time.duration = 120.0;
        if let Some(scenario::Controller::Slalom(tuning)) =
            &mut changed.scenario.robot[0].controller
        {
            tuning.speed = 0.128;
        }
        let folder = std::env::temp_dir().join("appell-bench");
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let (mut simulated, mut planned) = (0.0, f64::INFINITY);
        let mut silent = || {
            let mut run = Run::new(&changed, 0).expect("valid");
            run.execute(&mut Nothing, &mut |_| {}).expect("runs");
        };
        let mut recorded = || {
            let start = Instant::now();
            let mut run = Run::new(&changed, 0).expect("valid");
            planned = start.elapsed().as_secs_f64().min(planned);
            let mut recorder = Mcap::create(&folder.join("bench.mcap")).expect("a file");
            let summary = run.execute(&mut recorder, &mut |_| {}).expect("runs");
            simulated = summary.duration;
        };
        let [without, time] = least(15, [&mut silent, &mut recorded]);
        println!(
            "slalom of {simulated:.0} s with MCAP at {label:7} {:6.0} times real time \
             ({:.1} ms: building and planning {:.1}, run {:.1}, recording {:.1})",
            simulated / time,
            1e3 * time,
            1e3 * planned,
            1e3 * (without - planned),
            1e3 * (time - without)
        );
    }
}
