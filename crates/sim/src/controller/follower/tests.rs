//! Tests of the follower and its laws.

use appell_model::math::single::{atan2, sin_cos};

use std::sync::Arc;

use super::super::law::{Place, regulator};
use super::super::track::{Track, Tracks};
use super::path_follower;
use crate::block::{Block, Now};
use crate::build::Values;
use crate::plan::Path;
use crate::route;
use crate::scenario::{Follower, Heading, Law, Piece, Route};

const LAWS: [Law; 5] = [
    Law::Samson,
    Law::PurePursuit,
    Law::Stanley,
    Law::Kanayama,
    Law::Lqr,
];

fn path_of(piece: Vec<Piece>) -> Path {
    let route = Route::Pieces { start: None, piece };
    route::path(&route, 1, [0.0; 3], std::path::Path::new(".")).expect("a path")
}

/// A body without inertia that moves as commanded; its poses at every period.
fn drive(path: &Path, law: Law, heading: Heading, start: [f64; 3], seconds: f64) -> Vec<[f64; 3]> {
    let mut tuning: Follower = toml::from_str("").expect("defaults");
    (tuning.law, tuning.heading) = (law, heading);
    let track = Arc::new(Track::new(path));
    let mut follower = path_follower(
        "r",
        "robot.r.controller",
        &track,
        &tuning,
        start[2],
        true,
        &Values::new(&[]),
    );
    let dt = 0.005;
    let (mut pose, mut poses) = (start, vec![start]);
    let mut output = [0.0; 8];
    for tick in 0..(seconds / dt) as u64 {
        let input = [pose[0], pose[1], pose[2], pose[0], pose[1]];
        let now = Now {
            ticks: &[tick],
            t: tick as f64 * dt,
            dt,
        };
        follower.step(&now, &input, &mut output).expect("a step");
        let [forward, left, turn] = [output[0], output[1], output[2]];
        // The chord of the arc points halfway.
        let (sin, cos) = sin_cos(pose[2] + 0.5 * turn * dt);
        pose[0] += (forward * cos - left * sin) * dt;
        pose[1] += (forward * sin + left * cos) * dt;
        pose[2] += turn * dt;
        poses.push(pose);
    }
    poses
}

#[test]
fn invariant_every_law_drives_an_offset_out() {
    let path = path_of(vec![Piece::Line { length: 6.0 }]);
    for heading in [Heading::Steer, Heading::Along, Heading::Hold] {
        for law in LAWS {
            let poses = drive(&path, law, heading, [0.0, 0.1, 0.0], 14.0);
            let late = poses.iter().filter(|pose| pose[0] > 4.0);
            let worst = late.map(|pose| pose[1].abs()).fold(0.0, f64::max);
            // After 16 lookaheads: e^(−0.9·16) of 0.1 m is far below; the period of 5 ms leaves the
            // rest.
            assert!(worst < 1e-3, "{law:?} {heading:?}: {worst}");
            let end = poses[poses.len() - 1];
            // A follower stands within 2 mm of the end, and brakes in steps.
            assert!((end[0] - 6.0).abs() < 5e-3, "{law:?} {heading:?}: {end:?}");
            // Samson's and Kanayama's damping of 0.9 overshoots by e^(−0.9 π / 0.44) of 0.1 m; pure
            // pursuit's of 0.7 by 4 %; with the limits of the yaw rate some more.
            let overshoot = poses.iter().map(|pose| -pose[1]).fold(0.0, f64::max);
            assert!(overshoot < 0.02, "{law:?} {heading:?}: {overshoot}");
        }
    }
}

#[test]
fn invariant_laws_stay_on_a_circle() {
    let path = path_of(vec![Piece::Arc {
        radius: 1.0,
        angle_deg: 350.0,
    }]);
    for heading in [Heading::Steer, Heading::Along, Heading::Hold] {
        for law in LAWS {
            let poses = drive(&path, law, heading, [0.0; 3], 12.0);
            let off = |pose: &[f64; 3]| {
                // A Stanley front wheel keeps to the circle, and the rear runs inside of it.
                let ahead = if law == Law::Stanley && heading == Heading::Steer {
                    0.25
                } else {
                    0.0
                };
                let (sin, cos) = sin_cos(pose[2]);
                let (x, y) = (pose[0] + ahead * cos, pose[1] + ahead * sin);
                (appell_model::math::hypot(x, y - 1.0) - 1.0).abs()
            };
            // The first stretch is the way to the law's own steady state.
            let settled = &poses[poses.len() / 3..];
            let settled = settled.iter().filter(|pose| {
                // Near its end the path is a line to what looks ahead.
                let angle = atan2(pose[0], 1.0 - pose[1]).rem_euclid(std::f64::consts::TAU);
                angle < 5.2
            });
            let worst = settled.map(off).fold(0.0, f64::max);
            // A sideways law points along the tangent plus the correction: it lags by half of the
            // turn of the path in a period; pure pursuit without turning cuts corners.
            let allowed = match (law, heading) {
                (Law::PurePursuit, Heading::Along | Heading::Hold) => 0.04,
                _ => 4e-3,
            };
            assert!(worst < allowed, "{law:?} {heading:?}: {worst}");
        }
    }
}

#[test]
fn invariant_hold_keeps_the_heading() {
    let path = path_of(vec![
        Piece::Line { length: 1.0 },
        Piece::Arc {
            radius: 0.5,
            angle_deg: 180.0,
        },
    ]);
    for law in LAWS {
        let poses = drive(&path, law, Heading::Hold, [0.0, 0.0, 0.4], 10.0);
        assert!(poses.iter().all(|pose| (pose[2] - 0.4).abs() < 1e-12));
    }
}

#[test]
fn invariant_the_error_is_the_pose_of_the_path_in_the_robots_axes() {
    let path = path_of(vec![Piece::Arc {
        radius: 2.0,
        angle_deg: 90.0,
    }]);
    let tracks = Tracks::<f64>::new(&Track::new(&path), Arc::default());
    for k in 0..20 {
        let pose = [
            0.1 * f64::from(k),
            0.07 * f64::from(k) - 0.3,
            0.2 * f64::from(k),
        ];
        let s = 0.1 * f64::from(k);
        let (point, heading, _) = path.at(s);
        let (dx, dy) = (pose[0] - point[0], pose[1] - point[1]);
        let (sin, cos) = sin_cos(heading);
        let place = Place {
            path: &tracks,
            progress: s,
            point,
            pose,
            along: dx * cos + dy * sin,
            offset: dy * cos - dx * sin,
            heading_error: pose[2] - heading,
            lookahead: 0.3,
            speed_max: 1.0,
        };
        // diag(R(θ₀)ᵀ, 1)(p₁ − p₀), of the paper's eq. 7: 0 the robot, 1 the reference.
        let (sin, cos) = sin_cos(pose[2]);
        let expected = [
            -(dx * cos + dy * sin),
            -(dy * cos - dx * sin),
            heading - pose[2],
        ];
        for (got, expected) in place.error().iter().zip(expected) {
            assert!((got - expected).abs() < 1e-14, "{got} {expected}");
        }
    }
}

/// Cost of a gain from an initial state over 20 m, by Runge–Kutta 4 with steps of 5 mm.
fn cost(curvature: f64, lookahead: f64, gain: [f64; 2], start: [f64; 2]) -> f64 {
    let weight = 1.0 / (lookahead * lookahead);
    let rates = |state: [f64; 3]| {
        let u = -gain[0] * state[0] - gain[1] * state[1];
        let errors = weight * weight * state[0] * state[0] + weight * state[1] * state[1];
        [
            state[1],
            u - curvature * curvature * state[0],
            errors + u * u,
        ]
    };
    let ds = 5e-3;
    let mut state = [start[0], start[1], 0.0];
    for _ in 0..4000 {
        let ahead = |k: [f64; 3], h: f64| [0, 1, 2].map(|i| state[i] + h * k[i]);
        let first = rates(state);
        let second = rates(ahead(first, 0.5 * ds));
        let third = rates(ahead(second, 0.5 * ds));
        let last = rates(ahead(third, ds));
        state = [0, 1, 2]
            .map(|i| state[i] + ds / 6.0 * (first[i] + 2.0 * second[i] + 2.0 * third[i] + last[i]));
    }
    state[2]
}

#[test]
fn closed_form_regulators_gains_solve_riccati_and_cost_least() {
    for curvature in [0.0, 0.7, -2.0] {
        for lookahead in [0.15, 0.4] {
            let [k1, k2] = regulator(curvature, lookahead);
            let (square, weight) = (curvature * curvature, 1.0 / (lookahead * lookahead));
            let first = -2.0 * square * k1 - k1 * k1 + weight * weight;
            let last = 2.0 * k1 - k2 * k2 + weight;
            assert!(first.abs() < 1e-9 * weight * weight && last.abs() < 1e-12 * weight);
            for start in [[0.1, 0.0], [0.0, 0.5]] {
                let best = cost(curvature, lookahead, [k1, k2], start);
                for factors in [[1.1, 1.0], [0.9, 1.0], [1.0, 1.1], [1.0, 0.9]] {
                    let other = [k1 * factors[0], k2 * factors[1]];
                    assert!(cost(curvature, lookahead, other, start) > best);
                }
            }
        }
    }
}
