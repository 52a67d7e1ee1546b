//! The study against reference trajectories, closed forms, and what it says of the paper's order.

use super::*;

/// The reference trajectories of this very setting, from independently written equations, at their
/// tolerance of 1e-9 of the column.
#[test]
fn peer_reference_trajectories() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../xtask/tests/vectors");
    for (wave, name) in WAVES.iter().zip(["sine", "triangle", "square"]) {
        let file = folder.join(format!("pose_error_static_{name}.json"));
        let text = std::fs::read_to_string(file).expect("in the repository");
        let vector: Value = serde_json::from_str(&text).expect("JSON");
        let rows = vector["data"].as_array().expect("rows");
        let found = run(&Study::DEFAULT, *wave, rows.len() - 1).expect("smooth");
        for (k, row) in rows.iter().enumerate() {
            let time = vector["t"][k].as_f64().expect("a time");
            assert!((found.time[k] - time).abs() < 1e-12);
            for column in 0..3 {
                let off = found.columns[column][k] - row[column].as_f64().expect("a number");
                assert!(off.abs() < 4e-9, "{name} {column} at {time} s: {off:e}");
            }
        }
    }
}

/// Largest change of the yaw rate: the impulse of half a period times d/J. Samples meet the half
/// period, and the steps there are within 1e-11.
#[test]
fn closed_form_yaw_rate_of_half_a_period() {
    let study = Study {
        duration: 5.0 * Study::DEFAULT.period,
        ..Study::DEFAULT
    };
    let still = run(&study, Waveform::None, 600).expect("smooth");
    for wave in WAVES {
        let largest = deviations(&run(&study, wave, 600).expect("smooth"), &still)[5];
        let impulse = wave.impulse() * study.across * study.period * study.lever / study.inertia;
        assert!((largest - impulse).abs() < 1e-9, "{wave:?}: {largest}");
    }
}

/// At equal period, amplitude and phase 0 the order is that of the impulses, in all columns.
#[test]
fn known_answer_square_sine_triangle() {
    let found = orders(&Study::DEFAULT, WAVES).expect("smooth");
    assert_eq!(found, [Order::Impulses; 6]);
}

/// The heading's deviation is a double integral of the force: no phase and no friction gives the
/// paper's order there. A phase that pushes the robot back first does for x_e.
#[test]
fn known_answer_phases_of_the_papers_order() {
    let at = |degrees: f64, friction: f64| {
        let phase = degrees.to_radians();
        orders(
            &Study {
                phase,
                friction,
                ..Study::DEFAULT
            },
            WAVES,
        )
        .expect("smooth")
    };
    for degrees in [0.0, 35.0, 90.0, 145.0, 180.0, 290.0] {
        for friction in [0.0, 0.5, 0.9] {
            let found = at(degrees, friction);
            assert_eq!(found[2], Order::Impulses, "{degrees}° {friction}");
            assert_eq!(found[5], Order::Impulses, "{degrees}° {friction}");
        }
    }
    assert_eq!(at(180.0, 0.0)[0], Order::TriangleFirst);
    assert_eq!(at(180.0, 0.5)[0], Order::Impulses);
}

/// Waves of equal effective value from their crests: the second integral of the triangle is the
/// largest, and the paper's order comes out for the error.
#[test]
fn known_answer_equal_effective_values() {
    let study = Study {
        alike: Alike::Effective,
        phase: core::f64::consts::FRAC_PI_2,
        ..Study::DEFAULT
    };
    let found = orders(&study, WAVES).expect("smooth");
    assert_eq!(found[..3], [Order::TriangleFirst; 3]);
}

/// What is sampled ever finer and held tends to the continuous wave; the hold delays by half a period,
/// so that the error is of first order; the next term, which grows with time, is 4 % of it here.
#[test]
fn order_of_sampling() {
    let exact = run(&Study::DEFAULT, Waveform::Sine, 240).expect("smooth");
    let worst = |sampling: f64| {
        let study = Study {
            sampling,
            ..Study::DEFAULT
        };
        deviations(&run(&study, Waveform::Sine, 240).expect("smooth"), &exact)[2]
    };
    let ratio = worst(Study::DEFAULT.period / 400.0) / worst(Study::DEFAULT.period / 800.0);
    assert!((ratio - 2.0).abs() < 0.1, "{ratio}");
}

/// Friction above the amplitude swallows all.
#[test]
fn invariant_friction_swallows_small_forces() {
    let study = Study {
        friction: 1.0,
        ..Study::DEFAULT
    };
    let still = run(&study, Waveform::None, 60).expect("smooth");
    for wave in WAVES {
        let moved = deviations(&run(&study, wave, 60).expect("smooth"), &still);
        // The steps of both runs differ, and each is within 1e-11.
        assert!(moved.iter().all(|d| *d < 1e-9), "{wave:?} {moved:?}");
    }
}

/// The order of three numbers.
#[test]
fn closed_form_orders() {
    assert_eq!(Order::of([2.0, 1.0, 3.0]), Order::Impulses);
    assert_eq!(Order::of([1.0, 3.0, 2.0]), Order::TriangleFirst);
    assert_eq!(Order::of([1.0, 2.0, 3.0]), Order::SineLast);
    assert_eq!(Order::of([3.0, 2.0, 1.0]), Order::Other);
    assert_eq!(Order::of([1.0, 1.0, 3.0]), Order::Equal);
}
