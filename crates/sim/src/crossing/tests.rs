//! Crossings against geometry on paper, and the laws that every one of them keeps.

use super::*;

fn step(height: f64) -> Obstacle {
    Obstacle::Step { height }
}

fn trench(width: f64, depth: f64) -> Obstacle {
    Obstacle::Trench { width, depth }
}

/// A wheel against an edge: on the arc about it, on the level otherwise.
#[test]
fn closed_form_wheels_on_edges() {
    let profile = Profile::of(&step(0.15));
    assert_eq!(profile.stand(-0.2, 0.1).center, 0.1);
    assert_eq!(profile.stand(0.2, 0.1).center, 0.25);
    let stand = profile.stand(-0.06, 0.1);
    assert!((stand.center - 0.23).abs() < 1e-15 && stand.contact == 0.0);
    // In a trench it leans on the nearer edge.
    let trench = Profile::of(&trench(0.2, 0.5));
    assert!((trench.stand(0.04, 0.1).center - (0.01_f64 - 0.0016).sqrt()).abs() < 1e-15);
    assert!((trench.stand(0.17, 0.1).center - (0.01_f64 - 0.0009).sqrt()).abs() < 1e-15);
}

/// No disc enters the ground, no leg or joint exceeds its limit or its rate, the center of mass stays
/// over the support, the hinges keep their distance, and each leg system stands.
#[test]
fn invariant_of_all_crossings() {
    let build = Build::ASSUMED;
    for obstacle in [
        step(0.08),
        step(0.1),
        step(0.15),
        step(0.25),
        trench(0.2, 0.3),
        trench(0.23, 5.0),
        trench(0.3, 0.2),
        trench(0.6, 0.2),
        trench(1.2, 0.2),
        trench(0.8, 0.09),
    ] {
        let crossing = cross(&obstacle, &build);
        assert_eq!(crossing.refusal, None, "{obstacle:?}");
        let profile = Profile::of(&obstacle);
        let last = &crossing.frames[crossing.frames.len() - 1];
        assert!(last.wheels[3][0] > profile.end(), "{obstacle:?}");
        assert!(last.touches.iter().all(|touches| *touches));
        let mut before: Option<&Frame> = None;
        for frame in &crossing.frames {
            let at = format!("{obstacle:?} at {:.3} s", frame.t);
            for wheel in frame.wheels {
                let stand = profile.stand(wheel[0], build.limits.wheel_radius);
                // Bisections end within 1e-15 of angles, on arcs as steep as the grid of places lets
                // them be.
                assert!(wheel[1] > stand.center - 1e-9, "{at}: {wheel:?}");
            }
            assert!(frame.touches[0] || frame.touches[1], "{at}: front legs");
            assert!(frame.touches[2] || frame.touches[3], "{at}: rear legs");
            assert!(
                frame.margin > 0.0 && frame.pitch.abs() <= build.pitch_max,
                "{at}"
            );
            assert!(frame.tilt.abs() <= build.tilt_max + 1e-12, "{at}");
            let [[x0, z0], [x1, z1]] = frame.hinges;
            let apart = appell_model::math::hypot(x0 - x1, z0 - z1);
            // A bisection of the pitch to 1e-15, on ground as steep as the grid of places lets it be.
            assert!((apart - build.hinges).abs() < 1e-9, "{at}: {apart}");
            for leg in frame.legs {
                assert!(leg.abs() <= build.leg_max, "{at}");
            }
            if let Some(before) = before {
                let dt = frame.t - before.t;
                for (now, then) in [
                    (frame.legs[0], before.legs[0]),
                    (frame.legs[1], before.legs[1]),
                    (frame.tilt, before.tilt),
                ] {
                    assert!((now - then).abs() <= build.joint_rate * dt + 1e-9, "{at}");
                }
            }
            before = Some(frame);
        }
    }
}

/// With its front legs on a step and its rear legs before it the body pitches by asin H/L.
#[test]
fn closed_form_pitch_across_a_step() {
    let crossing = cross(&step(0.15), &Build::ASSUMED);
    let level =
        |frame: &&Frame| frame.legs == [0.0; 2] && frame.hinges[0][1] - frame.hinges[1][1] > 0.14;
    let frame = crossing.frames.iter().find(level).expect("stands across");
    let sine = Scalar::sin_cos(frame.pitch).0;
    assert!(
        (sine - 0.15 / Build::ASSUMED.hinges).abs() < 1e-12,
        "{}",
        frame.pitch
    );
}

/// A trench that is bridged is crossed level: the hinges sink by less than a wheel does between edges
/// that the pitch leaves over.
#[test]
fn invariant_bridging_keeps_level() {
    let crossing = cross(&trench(0.2, 3.0), &Build::ASSUMED);
    for frame in &crossing.frames {
        assert_eq!(frame.legs, [0.0; 2]);
        assert!(frame.pitch.abs() < 1e-9 && (frame.hinges[0][1] - 0.1).abs() < 1e-9);
    }
}

/// Robots that cannot: too high, too short of reach, top-heavy forward.
#[test]
fn refusal_of_what_the_robot_cannot_do() {
    let turned = cross(&step(0.26), &Build::ASSUMED);
    assert!(turned.frames.is_empty() && turned.refusal.is_some_and(|r| r.contains("turns away")));
    let stiff = Build {
        leg_max: 0.2,
        ..Build::ASSUMED
    };
    let refusal = cross(&step(0.25), &stiff)
        .refusal
        .expect("legs that hardly swing");
    assert!(refusal.contains("no sequence of postures"), "{refusal}");
    // As wide as the hinges are apart: both leg systems have to swing at once, each at an edge.
    let both = cross(&trench(0.6, 0.25), &Build::ASSUMED);
    assert!(
        both.refusal
            .is_some_and(|r| r.contains("runs into a wall or off an edge"))
    );
    let upright = Build {
        pitch_max: 0.1,
        ..Build::ASSUMED
    };
    let stopped = cross(&step(0.2), &upright);
    assert!(
        stopped.refusal.is_some_and(|r| r.contains("pitches by")) && !stopped.frames.is_empty()
    );
}
