//! Four checks in which other simulators were measured to err, on every level of model, from the
//! scenario to the recording: a circle for 20 s, constant torque, a grade of 20 %, a slow turn. The
//! book's table "Other simulators" states the errors that these tests print.

// The platform's own functions: a truth apart from ours.
#![allow(clippy::disallowed_methods)]

use std::path::Path;

use appell_sim::record::{Memory, Recording};
use appell_sim::run::Run;
use appell_sim::scenario;

/// The three-wheeler on its axle: M with the wheels' spin, kg; m d, kg·m; r and b, m; mass, kg.
const MASS_MOVED: f64 = 12.0;
const MOMENT: f64 = -0.5;
const RADIUS: f64 = 0.1;
const HALF_TRACK: f64 = 0.2;
const MASS: f64 = 10.0;
/// Its motors at the axle: N·m/A (and V·s/rad), Ω, H.
const CONSTANT: f64 = 1.0;
const RESISTANCE: f64 = 1.2;
const INDUCTANCE: f64 = 0.002;
const GRAVITY: f64 = 9.81;

/// Half a unit in the last place of 30 m, and of the wheels' 120 rad over the gear of wheel to yaw,
/// at each of 20 000 steps.
const POSITION: f64 = 20_000.0 * 1.8e-15;
const ANGLE: f64 = 20_000.0 * 7.1e-15 * RADIUS / (2.0 * HALF_TRACK);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Rung {
    Kinematic,
    Torque,
    Motors,
}

const RUNGS: [Rung; 3] = [Rung::Kinematic, Rung::Torque, Rung::Motors];

/// Runs the three-wheeler from (30, 30) along +x with a constant command per wheel (left, right).
fn drive(rung: Rung, commands: [f64; 2], twist: [f64; 2], grade: f64, duration: f64) -> Recording {
    let (level, drive) = match rung {
        Rung::Kinematic => ("kinematic", "as-built"),
        Rung::Torque => ("rolling", "torque"),
        Rung::Motors => ("rolling", "dc-motor"),
    };
    let slope = grade.atan().to_degrees();
    let text = format!(
        r#"schema = 1
name = "check"
seed = 1
[time]
step = 0.001
duration = {duration:?}
[record]
period = 0.1
[arena]
size = [60.0, 60.0]
[[arena.beacon]]
name = "far"
position = [1.0, 1.0]
[terrain]
kind = "plane"
slope_deg = {slope:?}
downhill_heading_deg = 180.0
[[robot]]
name = "r"
file = "../robots/three-wheeler.toml"
level = "{level}"
drive = "{drive}"
pose = [30.0, 30.0, 0.0]
twist = {twist:?}
[robot.controller]
kind = "signals"
period = 0.1
[[robot.controller.channel]]
to = "wheel.left"
signal = {{ kind = "constant", value = {left:?} }}
[[robot.controller.channel]]
to = "wheel.right"
signal = {{ kind = "constant", value = {right:?} }}
"#,
        left = commands[0],
        right = commands[1],
    );
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/check.toml");
    let loaded = scenario::load_text(&text, &folder, &[]).unwrap_or_else(|e| panic!("{e}"));
    let mut run = Run::new(&loaded, 0).unwrap_or_else(|e| panic!("{e}"));
    let mut memory = Memory::new();
    run.execute(&mut memory, &mut |_| {}).expect("runs");
    memory.into_recording()
}

/// Value of a signal of the robot at a time that is recorded, s.
fn at(recording: &Recording, path: &str, t: f64) -> f64 {
    let row = (t / 0.1).round() as usize;
    assert!((recording.times[row] - t).abs() < 1e-9);
    recording.column(&format!("robot.r.{path}")).expect(path)[row]
}

/// Prints an error for the book and holds it to its bound.
fn state(check: &str, rung: Rung, error: f64, bound: f64, unit: &str) {
    println!("{check:32} {rung:?}: {error:.1e} {unit}");
    assert!(
        error <= bound,
        "{check}, {rung:?}: {error:e} {unit}, bound {bound:e}"
    );
}

/// Commands per wheel that keep a steady turn, and the twist to start with.
fn steady(rung: Rung, v: f64, w: f64) -> ([f64; 2], [f64; 2]) {
    let rates = [(v - HALF_TRACK * w) / RADIUS, (v + HALF_TRACK * w) / RADIUS];
    // The centripetal force of the mass behind the axle, as the two wheels must give it.
    let sum = -RADIUS * MOMENT * w * w;
    let difference = RADIUS * MOMENT * v * w / HALF_TRACK;
    let torques = [0.5 * (sum - difference), 0.5 * (sum + difference)];
    match rung {
        Rung::Kinematic => (rates, [0.0; 2]),
        Rung::Torque => (torques, [v, w]),
        Rung::Motors => (
            [0, 1].map(|k| RESISTANCE * torques[k] / CONSTANT + CONSTANT * rates[k]),
            [v, w],
        ),
    }
}

/// When a rung has settled on its steady turn: motors start without current.
fn settled(rung: Rung) -> f64 {
    if rung == Rung::Motors { 20.0 } else { 0.0 }
}

/// A circle of 1 m radius for 20 s: the distance from the point of the circle where it should be.
#[test]
fn peer_checks_circle() {
    let (v, w) = (0.5, 0.5);
    for rung in RUNGS {
        let (commands, twist) = steady(rung, v, w);
        let from = settled(rung);
        let run = drive(rung, commands, twist, 0.0, from + 20.0);
        let pose = |t| ["pose.x", "pose.y", "pose.yaw"].map(|path| at(&run, path, t));
        let ([x0, y0, yaw], [x, y, _]) = (pose(from), pose(from + 20.0));
        let end = yaw + w * 20.0;
        let exact = [
            x0 + v / w * (end.sin() - yaw.sin()),
            y0 - v / w * (end.cos() - yaw.cos()),
        ];
        let error = (x - exact[0]).hypot(y - exact[1]);
        // The torque-driven circle, its mass behind the axle, is unstable at 0.37/s: ten times more.
        let bound = if rung == Rung::Torque {
            10.0 * POSITION
        } else {
            POSITION
        };
        state("circle of 1 m radius, 20 s", rung, error, bound, "m");
    }
}

/// Distance after `t` from rest under a constant voltage against a constant force, both motors alike:
/// v̇ = a i − f/M, L i̇ = U − R i − c v, by the eigenvalues of the 2 × 2 system.
fn motors_straight(voltage: f64, force: f64, t: f64) -> f64 {
    let a = 2.0 * CONSTANT / (RADIUS * MASS_MOVED);
    let c = CONSTANT / RADIUS;
    let i_end = force / MASS_MOVED / a;
    let v_end = (voltage - RESISTANCE * i_end) / c;
    let half = 0.5 * RESISTANCE / INDUCTANCE;
    let root = (half * half - a * c / INDUCTANCE).sqrt();
    let (fast, slow) = (-half - root, -half + root);
    // v = v_end + A e^{slow t} + B e^{fast t} with v(0) = 0 and v̇(0) = −a i_end.
    let b = (-a * i_end + slow * v_end) / (fast - slow);
    let amplitudes = [(slow, -v_end - b), (fast, b)];
    let sum: f64 = amplitudes
        .iter()
        .map(|(rate, amplitude)| amplitude * ((rate * t).exp() - 1.0) / rate)
        .sum();
    v_end * t + sum
}

/// Ten seconds straight ahead under a constant rate, torque or voltage.
#[test]
fn peer_checks_constant_command() {
    let t = 10.0;
    for rung in RUNGS {
        let (command, exact) = match rung {
            Rung::Kinematic => (5.0, RADIUS * 5.0 * t),
            Rung::Torque => (0.12, 0.5 * (2.0 * 0.12 / RADIUS / MASS_MOVED) * t * t),
            Rung::Motors => (6.0, motors_straight(6.0, 0.0, t)),
        };
        let run = drive(rung, [command; 2], [0.0; 2], 0.0, t);
        let error = (at(&run, "pose.x", t) - 30.0 - exact).abs();
        state("constant command, 10 s", rung, error, POSITION, "m");
    }
}

/// A grade of 20 %: commanded rates do not feel it, free wheels roll down it, torque and voltage
/// drive up against the weight.
#[test]
fn peer_checks_grade() {
    let t = 5.0;
    let weight = MASS * GRAVITY * 0.2 / (1.0_f64 + 0.04).sqrt();
    let cases = [
        (Rung::Kinematic, "up", 5.0, RADIUS * 5.0 * t),
        (
            Rung::Torque,
            "free",
            0.0,
            -0.5 * weight / MASS_MOVED * t * t,
        ),
        (
            Rung::Torque,
            "up",
            1.5,
            0.5 * (2.0 * 1.5 / RADIUS - weight) / MASS_MOVED * t * t,
        ),
        (Rung::Motors, "up", 10.0, motors_straight(10.0, weight, t)),
    ];
    for (rung, way, command, exact) in cases {
        let run = drive(rung, [command; 2], [0.0; 2], 0.2, t);
        let error = (at(&run, "pose.x", t) - 30.0 - exact).abs();
        state(
            &format!("grade of 20 %, {way}, 5 s"),
            rung,
            error,
            POSITION,
            "m",
        );
    }
}

/// A turn at 20 mm/s and 0.05 rad/s, 20 s: yaw as commanded, and at all times as the wheels turned.
#[test]
fn peer_checks_slow_turn() {
    let (v, w) = (0.02, 0.05);
    for rung in RUNGS {
        let (commands, twist) = steady(rung, v, w);
        let from = settled(rung);
        let run = drive(rung, commands, twist, 0.0, from + 20.0);
        let turned = at(&run, "pose.yaw", from + 20.0) - at(&run, "pose.yaw", from);
        state(
            "slow turn, 20 s",
            rung,
            (turned - w * 20.0).abs(),
            ANGLE,
            "rad",
        );
        let columns = [
            "pose.yaw",
            "wheel.left.spin_angle",
            "wheel.right.spin_angle",
        ]
        .map(|path| run.column(&format!("robot.r.{path}")).expect(path));
        let slip = (0..run.times.len())
            .map(|k| {
                let rolled = RADIUS * (columns[2][k] - columns[1][k]) / (2.0 * HALF_TRACK);
                (columns[0][k] - rolled).abs()
            })
            .fold(0.0, f64::max);
        state("slow turn, yaw less the wheels'", rung, slip, ANGLE, "rad");
    }
}
