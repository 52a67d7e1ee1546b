//! Tests of routes.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path as FilePath;

use super::{Fault, path};
use crate::plan::Path;
use crate::scenario::{Piece, Route};

fn built(route: Route, laps: u32) -> Result<Path, Fault> {
    path(&route, laps, [0.5, -0.25, 0.0], FilePath::new("."))
}

fn pieces(start: Option<[f64; 3]>, piece: Vec<Piece>) -> Path {
    built(Route::Pieces { start, piece }, 1).expect("pieces")
}

fn end(path: &Path) -> ([f64; 2], f64) {
    let last = path.points.len() - 1;
    (path.points[last], path.heading[last])
}

/// Distances of neighbors are ds, headings their directions, curvatures the rate of heading; to the
/// order of the spacing.
fn is_consistent(path: &Path) {
    for k in 1..path.points.len() - 1 {
        let [a, b, c] = [k - 1, k, k + 1].map(|k| path.points[k]);
        let chord = appell_model::math::hypot(b[0] - a[0], b[1] - a[1]);
        let bent = path.curvature[k].abs().max(path.curvature[k - 1].abs()) * path.ds;
        assert!(chord <= path.ds * (1.0 + 1e-9) && chord >= path.ds * (1.0 - 1e-9 - bent * bent));
        let along = appell_model::math::single::atan2(c[1] - a[1], c[0] - a[0]);
        let off = appell_model::math::wrap_angle(along - path.heading[k]);
        // A jump of the curvature bends the chord by a quarter of it times the spacing.
        assert!(off.abs() < 0.02, "{k}: {off}");
        let rate = (path.heading[k + 1] - path.heading[k - 1]) / (2.0 * path.ds);
        let jump = (path.curvature[k + 1] - path.curvature[k - 1]).abs();
        assert!(
            (rate - path.curvature[k]).abs() <= jump + 0.02,
            "{k}: {rate}"
        );
    }
}

#[test]
fn closed_form_pieces_end_where_closed_forms_say() {
    // A line of 1 m, a quarter circle to the left of 0.5 m, half a circle to the right of 0.3 m.
    let path = pieces(
        None,
        vec![
            Piece::Line { length: 1.0 },
            Piece::Arc {
                radius: 0.5,
                angle_deg: 90.0,
            },
            Piece::Arc {
                radius: 0.3,
                angle_deg: -180.0,
            },
        ],
    );
    let ([x, y], yaw) = end(&path);
    assert!((x - (0.5 + 1.0 + 0.5 + 0.6)).abs() < 1e-13 && (y - 0.25).abs() < 1e-13);
    assert!((yaw + FRAC_PI_2).abs() < 1e-13);
    assert!((path.length - (1.0 + 0.25 * PI + 0.3 * PI)).abs() < 1e-13);
    is_consistent(&path);
}

#[test]
fn closed_form_a_clothoid_ends_at_the_fresnel_integrals() {
    // Heading π s²/2 from 0 to 1: the integrals C(1), S(1) of Abramowitz and Stegun, table 7.7.
    let path = pieces(
        Some([0.0; 3]),
        vec![Piece::Clothoid {
            length: 1.0,
            from: None,
            to: PI,
        }],
    );
    let ([x, y], yaw) = end(&path);
    assert!((x - 0.779_893_400_376_822_8).abs() < 1e-13, "{x}");
    assert!((y - 0.438_259_147_390_354_8).abs() < 1e-13, "{y}");
    assert!((yaw - FRAC_PI_2).abs() < 1e-13);
    // One that goes on from the curvature before it joins without a jump.
    let path = pieces(
        None,
        vec![
            Piece::Arc {
                radius: 0.5,
                angle_deg: 60.0,
            },
            Piece::Clothoid {
                length: 0.8,
                from: None,
                to: -1.0,
            },
        ],
    );
    is_consistent(&path);
    let jump = |pair: &[f64]| (pair[1] - pair[0]).abs();
    assert!(path.curvature.windows(2).all(|pair| jump(pair) < 0.1));
}

#[test]
fn closed_form_a_rounded_square_is_four_lines_and_four_arcs() {
    let route = Route::Polyline {
        points: vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]],
        radius: 0.4,
        closed: true,
    };
    let once = built(route.clone(), 1).expect("a square");
    let round = 4.0 * (2.0 - 0.8) + TAU * 0.4;
    assert!((once.length - round).abs() < 1e-12);
    let ([x, y], yaw) = end(&once);
    assert!((x - 1.0).abs() < 1e-12 && y.abs() < 1e-12 && (yaw - TAU).abs() < 1e-12);
    is_consistent(&once);
    let thrice = built(route, 3).expect("three rounds");
    assert!((thrice.length - 3.0 * round).abs() < 1e-12);
    assert_eq!(thrice.points.len(), 3 * (once.points.len() - 1) + 1);
    assert!((end(&thrice).1 - 3.0 * TAU).abs() < 1e-11);
    is_consistent(&thrice);
}

#[test]
fn closed_form_a_closed_spline_through_a_circle_is_nearly_one() {
    // 24 knots: the error of a cubic spline is of the fourth power of their distance, that of its
    // curvature of the second.
    let points = (0..24).map(|k| {
        let (sin, cos) = appell_model::math::single::sin_cos(TAU * f64::from(k) / 24.0);
        [2.0 * cos, 2.0 * sin]
    });
    let route = Route::Spline {
        points: points.collect(),
        closed: true,
    };
    let path = built(route, 1).expect("a circle");
    assert!((path.length - TAU * 2.0).abs() < 1e-3);
    for (k, [x, y]) in path.points.iter().enumerate() {
        assert!((appell_model::math::hypot(*x, *y) - 2.0).abs() < 1e-4);
        assert!((path.curvature[k] - 0.5).abs() < 5e-3);
    }
    let (last, yaw) = end(&path);
    assert!((last[0] - 2.0).abs() < 1e-9 && last[1].abs() < 1e-9);
    assert!((yaw - path.heading[0] - TAU).abs() < 1e-6);
    is_consistent(&path);
}

#[test]
fn invariant_an_open_spline_goes_through_its_points() {
    let points = vec![[0.0, 0.0], [1.0, 0.5], [2.0, -0.5], [3.0, 0.4], [4.5, 0.0]];
    let path = built(
        Route::Spline {
            points: points.clone(),
            closed: false,
        },
        1,
    )
    .expect("a spline");
    is_consistent(&path);
    for knot in points {
        let away = |p: &[f64; 2]| appell_model::math::hypot(p[0] - knot[0], p[1] - knot[1]);
        let nearest = path.points.iter().map(away).fold(f64::MAX, f64::min);
        assert!(nearest <= 0.5 * path.ds + 1e-6, "{knot:?}: {nearest}");
    }
}

#[test]
fn refusal_names_the_field() {
    let line = |length: f64| vec![Piece::Line { length }];
    let corner = |radius: f64| Route::Polyline {
        points: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]],
        radius,
        closed: false,
    };
    let cases = [
        (
            Route::Pieces {
                start: None,
                piece: vec![],
            },
            "piece",
        ),
        (
            Route::Pieces {
                start: None,
                piece: line(0.0),
            },
            "piece.0.length",
        ),
        (
            Route::Pieces {
                start: Some([f64::NAN, 0.0, 0.0]),
                piece: line(1.0),
            },
            "start",
        ),
        (
            Route::Pieces {
                start: None,
                piece: line(1e5),
            },
            "",
        ),
        (corner(1.5), "radius"),
        (corner(0.0), "radius"),
        (
            Route::Spline {
                points: vec![[0.0, 0.0]; 5],
                closed: false,
            },
            "points",
        ),
        (
            Route::Spline {
                points: vec![[0.0, 0.0], [1.0, 1.0]],
                closed: false,
            },
            "points",
        ),
        (
            Route::File {
                file: "nothing.csv".into(),
                x: "x".into(),
                y: "y".into(),
                closed: false,
            },
            "file",
        ),
    ];
    for (route, field) in cases {
        let fault = built(route.clone(), 1).expect_err("a refusal");
        assert_eq!(fault.field, field, "{route:?}: {}", fault.problem);
    }
    let fault = built(corner(0.2), 2).expect_err("a refusal");
    assert_eq!(fault.field, "laps");
}
