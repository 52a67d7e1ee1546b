//! The shipped model against reference vectors, another tool's result, and the task layouts.

use std::path::{Path, PathBuf};

use appell_model::drive::Drive;
use appell_model::dual::Dual;
use appell_model::dynamics::{Dynamics, Input};
use appell_model::ground::Ground;
use appell_model::integrate::Adaptive;
use appell_model::lanes::Lanes4;
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::wheel::{Rim, Steering, Wheel};
use appell_sim::run::Outcome;
use xtask::layouts::{self, LayoutFile};
use xtask::vectors::{Method, Vector, deviations, points, run, strategies};

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests")
        .join(name)
}

fn vectors() -> Vec<(String, Vector)> {
    xtask::json_files(&folder("vectors"))
        .expect("the vectors are in the repository")
        .into_iter()
        .map(|(stem, text)| (stem, serde_json::from_str(&text).expect("a vector")))
        .collect()
}

/// Every state and output of every vector within its own tolerance (1e-9 or 1e-8), adaptively.
#[test]
fn peer_vectors() {
    let all = vectors();
    assert!(all.len() >= 40, "the vectors are there");
    for (stem, vector) in all {
        if vector.model == "obstacle_strategy" {
            let rows = strategies(&vector).unwrap_or_else(|e| panic!("{stem}: {e:?}"));
            assert_eq!(rows.len(), vector.data.len(), "{stem}");
            for (row, data) in rows.iter().zip(&vector.data) {
                assert_eq!(Some(row[0].as_str()), data[4].as_str(), "{stem}: {data:?}");
            }
            continue;
        }
        let rows = if vector.kind == "pointwise" {
            points(&vector)
        } else {
            run::<f64>(&vector, Method::Adaptive(1e-12))
        };
        let rows = rows.unwrap_or_else(|e| panic!("{stem}: {e:?}"));
        assert_eq!(rows.len(), vector.data.len(), "{stem}");
        for (column, error, tolerance) in deviations(&vector, &rows) {
            assert!(
                error <= tolerance,
                "{stem} {column}: {error:e} of {tolerance:e}"
            );
        }
    }
}

/// RK4 at one step in three scalars: the same bits, and within the vector's tolerance. The step is
/// 1 ms for mechanics; electrical states need h ≤ L/(30 R), 50 µs for these motors.
#[test]
fn peer_vectors_by_three_scalars() {
    for (stem, vector) in vectors() {
        let taken = ["diff_", "wheel_legged_", "pose_error_"];
        if !taken.iter().any(|start| stem.starts_with(start)) {
            continue;
        }
        let step = if vector.model == "diff_motor" {
            5e-5
        } else {
            1e-3
        };
        let method = Method::RungeKutta4(step);
        let scalar = run::<f64>(&vector, method).expect("runs");
        for (column, error, tolerance) in deviations(&vector, &scalar) {
            assert!(
                error <= tolerance,
                "{stem} {column}: {error:e} of {tolerance:e}"
            );
        }
        let lanes = run::<Lanes4>(&vector, method).expect("runs");
        let duals = run::<Dual<f64, 1>>(&vector, method).expect("runs");
        for (row, (lane_row, dual_row)) in scalar.iter().zip(lanes.iter().zip(&duals)) {
            for (k, value) in row.iter().enumerate() {
                for lane in 0..4 {
                    assert_eq!(
                        lane_row[k].lane(lane).to_bits(),
                        value.to_bits(),
                        "{stem} column {k}"
                    );
                }
                assert_eq!(
                    dual_row[k].value.to_bits(),
                    value.to_bits(),
                    "{stem} column {k}"
                );
            }
        }
    }
}

/// What RK4 and the exponential method leave at 1 ms on the motor vectors: the largest deviation of
/// a state, as stated in the book's validation chapter.
#[test]
fn golden_motor_vectors_at_one_millisecond() {
    for (stem, vector) in vectors() {
        if vector.model != "diff_motor" {
            continue;
        }
        let worst = |method| {
            let rows = run::<f64>(&vector, method).expect("runs");
            let all = deviations(&vector, &rows);
            let pose = all
                .iter()
                .filter(|(name, ..)| ["x", "y", "phi"].contains(&name.as_str()))
                .map(|d| d.1)
                .fold(0.0, f64::max);
            let electric = all
                .iter()
                .filter(|(name, ..)| name.starts_with("W_"))
                .map(|d| d.1)
                .fold(0.0, f64::max);
            (pose, electric)
        };
        let (rk4, exponential) = (
            worst(Method::RungeKutta4(1e-3)),
            worst(Method::Exponential(1e-3)),
        );
        println!(
            "{stem}: RK4 pose {:.1e} energy {:.1e}; exponential pose {:.1e} energy {:.1e}",
            rk4.0, rk4.1, exponential.0, exponential.1
        );
        // Pose in m and rad, energies in J; bounds above what was measured (3e-11 and 8e-4; 2.3e-7 and 6e-3).
        assert!(rk4.0 < 1e-9 && rk4.1 < 1e-2, "{stem} {rk4:?}");
        assert!(
            exponential.0 < 1e-6 && exponential.1 < 1e-2,
            "{stem} {exponential:?}"
        );
    }
}

/// Torques of the wheel-set example.
struct Torques;

impl Input<f64> for Torques {
    fn at(&self, t: f64, u: &mut [f64]) {
        let turn = std::f64::consts::TAU * t;
        u.fill(0.0);
        u[0] = -2.0 * Scalar::sin_cos(turn).0;
        u[1] = -2.0 * Scalar::sin_cos(turn + std::f64::consts::FRAC_PI_2).0;
    }
}

/// A torque-driven wheel set with ideal rolling, from another tool's library (figures of its published
/// reference result): its own tolerance is about 2e-5 rad and 2e-6 m, which bounds the agreement (measured: 2.0e-5 rad, 2.1e-6 m).
#[test]
fn peer_modelica_rolling_wheel_set() {
    let wheel = |name: &str, side: f64| Wheel {
        name: name.into(),
        mount: vec2(0.0, side),
        radius: 0.1,
        steering: Steering::Fixed { angle: 0.0 },
        rim: Rim::Plain,
        mass: 0.5,
        inertia_vertical: 0.02,
        spin_inertia: 0.01,
        viscous: 0.0,
        pivot_viscous: 0.0,
        dry_friction: 0.0,
        friction_rounding: 0.0,
        stiffness: 1.0,
        brake: 0.0,
        drive: Drive::Torque {
            torque_max: f64::INFINITY,
        },
    };
    let body = Body {
        mass: 0.01,
        inertia_com: 0.001,
        center_of_mass: vec2(0.2, 0.0),
        com_height: 0.1,
    };
    let platform =
        Platform::new(body, vec![wheel("1", 0.25), wheel("2", -0.25)]).expect("a wheel set");
    let layout = platform.layout().clone();
    let mut x = vec![0.0; layout.state()];
    (x[0], x[1]) = (0.1, 0.1);
    platform.renew_angles(&mut x);
    let system = Rolling::new(platform, Ground::flat(9.81));
    let mut mode = vec![1.0; 2];
    let mut adaptive = Adaptive::new(&system, 1e-11, 1e-12);
    let text = std::fs::read_to_string(folder("rolling_wheel_set_driving.csv"))
        .expect("in the repository");
    let (mut t, mut worst_angle, mut worst_place) = (0.0, 0.0_f64, 0.0_f64);
    for line in text.lines().skip(1) {
        let row: Vec<f64> = line
            .split(',')
            .map(|cell| cell.parse().expect("a number"))
            .collect();
        adaptive
            .advance(&system, &Torques, t, row[0], &mut x, &mut mode, None)
            .expect("smooth");
        t = row[0];
        let spin = layout.spin(0);
        for (got, want) in [(x[YAW], row[3]), (x[spin], row[4]), (x[spin + 1], row[5])] {
            worst_angle = worst_angle.max((got - want).abs());
        }
        for (got, want) in [(x[0], row[6]), (x[1], row[7])] {
            worst_place = worst_place.max((got - want).abs());
        }
    }
    println!("largest deviation: {worst_angle:.1e} rad, {worst_place:.1e} m");
    assert!(
        t > 2.99 && worst_angle < 3e-5 && worst_place < 3e-6,
        "{worst_angle:e} rad {worst_place:e} m"
    );
    assert_eq!(system.sizes().mode, 2);
}

/// Every layout passes at the kinematic level, with torques and with motors, and with motors on a
/// slope of 5° in four directions.
#[test]
fn invariant_layouts_pass_at_every_level() {
    let slope = |heading: f64| {
        format!(
            "[terrain]\nkind = \"plane\"\nslope_deg = 5.0\ndownhill_heading_deg = {heading:?}\n"
        )
    };
    let set = |path: &str, value: &str| vec![(format!("robot.*.{path}"), format!("\"{value}\""))];
    let variants = [
        (String::new(), set("level", "kinematic")),
        (String::new(), set("drive", "torque")),
        (String::new(), set("drive", "dc-motor")),
        (slope(0.0), Vec::new()),
        (slope(90.0), Vec::new()),
        (slope(180.0), Vec::new()),
        (slope(-90.0), Vec::new()),
    ];
    let files = xtask::json_files(&folder("layouts")).expect("in the repository");
    assert_eq!(files.len(), 6);
    for (stem, text) in files {
        let layout: LayoutFile = serde_json::from_str(&text).expect("a layout");
        for (extra, overrides) in &variants {
            let (_, verdict, reason) =
                layouts::run(&layout, extra, overrides).unwrap_or_else(|e| panic!("{stem}: {e}"));
            assert_eq!(
                verdict,
                Outcome::Passed,
                "{stem} {extra} {overrides:?}: {reason}"
            );
        }
    }
}

/// The reference pages of the book are those of the types.
#[test]
fn golden_reference_pages_are_current() {
    for (name, text) in xtask::docs::pages() {
        let path = xtask::root().join("docs/book/src/reference").join(name);
        let written = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            written == text,
            "{} is stale: run `cargo xtask docs`",
            path.display()
        );
    }
}

/// Each equation label cited in code exists in the book, and each module says what it is.
#[test]
fn invariant_documents_and_code_agree() {
    let mut book = String::new();
    for (_, text) in texts(xtask::root().join("docs/book/src"), "md") {
        book += &text;
    }
    let sources = texts(xtask::root().join("crates"), "rs");
    for (path, text) in &sources {
        assert!(
            text.starts_with("//!"),
            "{} does not open with //!",
            path.display()
        );
        for piece in text.split("[eq:").skip(1) {
            let label = piece.split(']').next().unwrap_or_default();
            if label.chars().all(|c| c.is_ascii_lowercase() || c == '-') && !label.is_empty() {
                assert!(
                    book.contains(&format!("[eq:{label}]")),
                    "{}: [eq:{label}] is not in the book",
                    path.display()
                );
            }
        }
    }
}

/// All files of an extension under a folder, with their texts.
fn texts(folder: PathBuf, extension: &str) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut stack = vec![folder];
    while let Some(folder) = stack.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                stack.push(path);
            } else if path.extension().is_some_and(|e| e == extension) {
                let text = std::fs::read_to_string(&path).expect("text");
                found.push((path, text));
            }
        }
    }
    assert!(!found.is_empty());
    found
}

/// The crate of equations depends on nothing and reads nothing.
#[test]
fn invariant_model_is_pure() {
    let root = xtask::root().join("crates/model");
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).expect("text");
    assert!(!manifest.contains("[dependencies]"));
    for (path, text) in texts(root.join("src"), "rs") {
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for banned in [
            "std::fs",
            "std::time",
            "std::io",
            "std::env",
            "println!",
            "HashMap",
        ] {
            assert!(!code.contains(banned), "{}: {banned}", path.display());
        }
    }
}
