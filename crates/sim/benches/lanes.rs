//! Speed of many robots, side by side in one run: ratios, not absolutes.
//!
//! `cargo bench -p appell-sim --bench lanes -- [model] [batch] [crowd] [peers]`. Million steps of a robot per
//! second; each figure is the best of several repetitions that take turns. `peers` runs the programs of
//! `benches/peers` that are at hand.
#![allow(missing_docs)]

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use appell_model::drive::{DcMotor, Drive};
use appell_model::dynamics::{Dynamics, Held};
use appell_model::ground::Ground;
use appell_model::integrate::{Exponential, RungeKutta4, observe};
use appell_model::lanes::{AnyLanes, dispatch, narrow};
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::wheel::{Rim, Steering, Wheel};
use appell_sim::batch::{Batch, Crew, Shard, Store, parse, sum_up};
use appell_sim::crowd::Crowd;
use appell_sim::record::Nothing;
use appell_sim::run::Metric;
use appell_sim::scenario::load;

const STEPS: u64 = 2000;
const ROUNDS: usize = 30;
/// Trials of a batch: at its end lanes run empty.
const TRIALS: u64 = 2048;

/// A wheel with a motor; every lane has its own numbers.
fn wheel<T: Scalar>(name: &str, mount: [f64; 2], rim: Rim<T>) -> Wheel<T> {
    let of = |value: f64| T::from_lanes(|lane| value * (1.0 + 0.01 * lane as f64));
    let zero = T::zero();
    Wheel {
        name: name.into(),
        mount: vec2(T::from(mount[0]), T::from(mount[1])),
        radius: T::from(0.05),
        steering: Steering::Fixed { angle: zero },
        rim,
        mass: T::from(0.3),
        inertia_vertical: T::from(2e-4),
        spin_inertia: of(1e-3),
        viscous: of(1e-3),
        pivot_viscous: zero,
        dry_friction: zero,
        friction_rounding: zero,
        brake: zero,
        stiffness: T::one(),
        drive: Drive::DcMotor(DcMotor {
            resistance: of(1.2),
            inductance: of(1.2e-3),
            torque_constant: of(0.05),
            back_emf_constant: of(0.05),
            gear_ratio: T::from(20.0),
            gear_efficiency: T::from(0.8),
            voltage_max: T::from(24.0),
            current_max: T::from(10.0),
        }),
    }
}

fn robot<T: Scalar>(wheels: Vec<Wheel<T>>) -> Rolling<T> {
    let body = Body {
        mass: T::from_lanes(|lane| 9.0 + 0.1 * lane as f64),
        inertia_com: T::from(0.1),
        center_of_mass: vec2(T::from(0.05), T::zero()),
        com_height: T::from(0.1),
    };
    let platform = Platform::new(body, wheels).expect("a platform");
    Rolling::new(platform, Ground::flat(T::from(9.81)))
}

fn differential<T: Scalar>() -> Rolling<T> {
    let place = [("left", 0.15), ("right", -0.15)];
    robot(
        place
            .map(|(name, y)| wheel(name, [0.0, y], Rim::Plain))
            .to_vec(),
    )
}

fn mecanum<T: Scalar>() -> Rolling<T> {
    let wheels = [(0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15)].map(|(x, y)| {
        let angle = T::from(-std::f64::consts::FRAC_PI_4 * (x * y * 100.0_f64).signum());
        wheel(&format!("{x} {y}"), [x, y], Rim::Rollers { angle })
    });
    robot(wheels.to_vec())
}

/// Million steps per second of one robot with one method.
#[derive(Clone, Copy)]
struct Open {
    is_mecanum: bool,
    is_exponential: bool,
    /// Whether the energy ledger and the angles of wheels are left out: seven states are left.
    is_bare: bool,
    /// Steps after which forces are found, too; 0 for never.
    forces: u64,
}

impl AnyLanes for Open {
    type Output = f64;

    fn run<T: Scalar<Single = f64>>(self) -> f64 {
        let mut system: Rolling<T> = if self.is_mecanum {
            mecanum()
        } else {
            differential()
        };
        if self.is_bare {
            system.leave_out();
        }
        let sizes = system.sizes();
        let mut x = vec![T::zero(); sizes.state];
        x[3] = T::one();
        let mut u = vec![T::zero(); sizes.input];
        for (k, volts) in [6.0, 5.0, 6.0, 5.0].into_iter().enumerate() {
            if k < system.platform().layout().wheels {
                u[k] = T::from(volts);
            }
        }
        let mut mode = vec![T::one(); sizes.mode];
        let mut y = vec![T::zero(); sizes.output];
        let mut classical = RungeKutta4::new(sizes.state, sizes.input);
        let mut exponential = Exponential::new(&system, 1e-3).expect("motors are linear");
        let together = if self.forces == 0 { STEPS } else { self.forces };
        let start = Instant::now();
        for _ in 0..STEPS / together {
            let held = Held(&u);
            let (x, mode) = (&mut x[..], &mut mode[..]);
            if self.is_exponential {
                exponential.steps(&system, &held, 0.0, 1e-3, together, x, mode);
            } else {
                classical.steps(&system, &held, 0.0, 1e-3, together, x, mode);
            }
            if self.forces > 0 {
                observe(&system, false, x, &u, mode, &mut y);
            }
        }
        let steps = (STEPS * T::LANES as u64) as f64;
        assert!(x.iter().all(|value| value.lane(0).is_finite()));
        1e-6 * steps / start.elapsed().as_secs_f64()
    }
}

/// Prints the speeds of the model; the base of all ratios, and the fastest of seven states alone in
/// double and single precision.
fn model() -> [f64; 3] {
    let open = |is_mecanum, is_exponential, forces| Open {
        is_mecanum,
        is_exponential,
        is_bare: false,
        forces,
    };
    let bare = |is_exponential| Open {
        is_bare: true,
        ..open(false, is_exponential, 0)
    };
    let [classical, exponential] = [false, true].map(|method| open(false, method, 0));
    // Lanes, of single precision from sixteen on.
    let acts = [
        ("(a) Runge-Kutta 4, one lane", 1, classical),
        ("(a) Runge-Kutta 4, x4", 4, classical),
        ("(a) Runge-Kutta 4, x8", 8, classical),
        ("(a) exponential, x8", 8, exponential),
        ("(a) Runge-Kutta 4, f32 x16", 16, classical),
        ("(a) exponential, f32 x16", 16, exponential),
        ("(a) seven states alone, Runge-Kutta 4, x8", 8, bare(false)),
        ("(a) seven states alone, exponential, x8", 8, bare(true)),
        (
            "(a) seven states alone, Runge-Kutta 4, f32 x16",
            16,
            bare(false),
        ),
        (
            "(a) seven states alone, exponential, f32 x16",
            16,
            bare(true),
        ),
        (
            "(c) mecanum, forces every step, x8",
            8,
            open(true, false, 1),
        ),
        (
            "(c) mecanum, forces every 10 steps, x8",
            8,
            open(true, false, 10),
        ),
    ];
    let mut best = [0.0_f64; 12];
    for _ in 0..ROUNDS {
        for (best, (_, lanes, act)) in best.iter_mut().zip(&acts) {
            *best = best.max(match lanes {
                16 => narrow::dispatch(16, *act),
                _ => dispatch(*lanes, *act),
            });
        }
    }
    // RK4, so that figures of other times can be set beside.
    let base = best[1].max(best[2]);
    println!("the general model, energy ledger and limits included but for seven states alone");
    for ((name, ..), speed) in acts.iter().zip(best) {
        println!("  {name:55} {speed:8.1} M/s  {:6.2} of (a)", speed / base);
    }
    [base, best[6].max(best[7]), best[8].max(best[9])]
}

/// Million steps per second of a batch of homing robots with noisy odometry, and its threads' gain.
fn batch(base: f64) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/homing.toml");
    let speed = |precision: &str, period: &str, threads: usize, lanes: usize| {
        let sensor = format!("[{{ kind = \"odometry\", period = {period}, angle_std = 0.001 }}]");
        let overrides = [
            ("robot.tri.sensor", sensor.as_str()),
            ("robot.tri.controller.pose", "odometry"),
            ("robot.tri.controller.period", period),
            ("batch.precision", precision),
        ]
        .map(|(path, value)| (path.to_owned(), value.to_owned()));
        let vary = [parse("robot.tri.platform.body.mass=normal(9, 0.1)").expect("a draw")];
        let batch = Batch::new(&file, &overrides, Some(TRIALS), &vary, None).expect("a batch");
        let folder = std::env::temp_dir().join(format!("appell-bench-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let store = Store::open(&folder, batch.manifest()).expect("a folder");
        let start = Instant::now();
        let crew = Crew { threads, lanes };
        batch
            .execute(&store, Shard::WHOLE, crew, &|_| {})
            .expect("runs");
        let seconds = start.elapsed().as_secs_f64();
        let (summary, _) = sum_up(&store).expect("rows");
        let _ = std::fs::remove_dir_all(&folder);
        let time = summary.variants[0]
            .figures
            .iter()
            .find(|f| f.name == "time");
        1e-6 * TRIALS as f64 * time.expect("a time").mean * 1e3 / seconds
    };
    println!("batches, all included: building, judging, figures, rows");
    let mut single = 0.0_f64;
    let mut double = 0.0_f64;
    let mut fine = 0.0_f64;
    let mut plain = 0.0_f64;
    let [mut narrow_single, mut narrow_fine] = [0.0_f64; 2];
    for _ in 0..3 {
        plain = plain.max(speed("f64", "0.01", 1, 1));
        single = single.max(speed("f64", "0.01", 1, 8));
        double = double.max(speed("f64", "0.01", 2, 8));
        fine = fine.max(speed("f64", "0.001", 1, 8));
        narrow_single = narrow_single.max(speed("f32", "0.01", 1, 8));
        narrow_fine = narrow_fine.max(speed("f32", "0.001", 1, 8));
    }
    println!("  (b) control at 100 Hz, one lane                       {plain:8.1} M/s");
    println!(
        "  (b) control at 100 Hz, x8                             {single:8.1} M/s  {:6.2} of (a)",
        single / base
    );
    println!(
        "  (b) control at every step, x8                         {fine:8.1} M/s  {:6.2} of (a)",
        fine / base
    );
    println!(
        "  (b) control at 100 Hz, f32 x16                        {narrow_single:8.1} M/s  {:6.2} of (a)",
        narrow_single / base
    );
    println!(
        "  (b) control at every step, f32 x16                    {narrow_fine:8.1} M/s  {:6.2} of (a)",
        narrow_fine / base
    );
    println!(
        "  (d) two threads over one                                        {:6.2}",
        double / single
    );
}

/// Runs the peers and prints how much faster the lanes are.
fn peers([base, bare, narrow]: [f64; 3]) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../benches/peers/run.sh");
    let output = Command::new("sh").arg(&script).output().expect("a shell");
    eprint!("{}", String::from_utf8_lossy(&output.stderr));
    println!("peers");
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let Ok(value) = serde_json::from_str::<serde_json::Value>(line) else {
            continue;
        };
        if let (Some(peer), Some(speed)) = (value["peer"].as_str(), value["Msteps_per_s"].as_f64())
        {
            println!(
                "  {peer:40} {speed:8.3} M/s  (a) is {:8.2} times as fast, seven states alone {:8.2}, in f32 {:8.2}",
                base / speed,
                bare / speed,
                narrow / speed
            );
        }
    }
}

/// One world of a thousand robots with motors, odometry and a controller at 100 Hz, steps of 1 ms.
fn crowd() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/crowd.toml");
    let overrides = [("robot.tri.count".to_owned(), "1000".to_owned())];
    let loaded = load(&file, &overrides).expect("a scenario");
    let mut best = [0.0_f64; 3];
    for _ in 0..3 {
        for (best, (threads, lanes)) in best.iter_mut().zip([(1, 1), (1, 8), (2, 8)]) {
            let crew = Crew { threads, lanes };
            let mut crowd = Crowd::new(&loaded, crew).expect("robots");
            let start = Instant::now();
            let summary = crowd.execute(&mut Nothing, &mut |_| {}).expect("runs");
            // Robots leave when they are there: what counts is how long all were on their way.
            let of = |metric: &&Metric| metric.name == "time";
            let times = summary
                .robots
                .iter()
                .filter_map(|r| r.metrics.iter().find(of));
            let mean = times.map(|time| time.value).sum::<f64>() / 1000.0;
            *best = best.max(mean / start.elapsed().as_secs_f64());
        }
    }
    println!("one world of 1000 robots with motors and controllers, judged and measured");
    println!(
        "  (f) one thread, one lane                 {:8.1} times real time",
        best[0]
    );
    println!(
        "  (f) one thread, x8                       {:8.1} times real time",
        best[1]
    );
    println!(
        "  (f) two threads, x8                      {:8.1} times real time",
        best[2]
    );
}

fn main() {
    let wanted: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    let runs = |name: &str| wanted.is_empty() || wanted.iter().any(|w| w == name);
    if runs("crowd") {
        crowd();
    }
    if wanted.iter().all(|name| name == "crowd") && !wanted.is_empty() {
        return;
    }
    let speeds = model();
    if runs("batch") {
        batch(speeds[0]);
    }
    if runs("peers") {
        peers(speeds);
    }
}
