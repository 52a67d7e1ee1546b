//! The rules of uneven ground.

use super::*;
use crate::relief::{NODES_MAX, nodes};

/// Largest height of a feature either way, m.
const HEIGHT_MAX: f64 = 100.0;
/// Most features.
const FEATURES_MAX: usize = 64;

pub(super) fn check_relief(c: &mut Checker, features: &[Relief]) {
    c.require(
        features.len() <= FEATURES_MAX,
        "terrain.relief".into(),
        &format!("at most {FEATURES_MAX} features"),
        features.len(),
    );
    for (k, feature) in features.iter().enumerate() {
        check_feature(c, &format!("terrain.relief.{k}"), feature);
    }
}

fn check_feature(c: &mut Checker, base: &str, feature: &Relief) {
    let path = |field: &str| format!("{base}.{field}");
    match feature {
        Relief::Slope {
            slope_deg,
            downhill_heading_deg,
        } => check_slope(c, base, *slope_deg, *downhill_heading_deg),
        Relief::Step {
            at,
            heading_deg,
            rise,
        } => {
            check_place(c, base, *at, *heading_deg);
            check_height(c, path("rise"), *rise);
        }
        Relief::Ramp {
            at,
            heading_deg,
            rise,
            length,
        } => {
            check_place(c, base, *at, *heading_deg);
            check_height(c, path("rise"), *rise);
            c.positive(path("length"), *length);
        }
        Relief::Block {
            at,
            heading_deg,
            length,
            width,
            rise,
        } => {
            check_place(c, base, *at, *heading_deg);
            check_height(c, path("rise"), *rise);
            c.positive(path("length"), *length);
            c.positive(path("width"), *width);
        }
        Relief::Wave {
            form: _,
            at,
            heading_deg,
            amplitude,
            period,
            phase_deg,
            length,
        } => {
            check_place(c, base, *at, *heading_deg);
            check_height(c, path("amplitude"), *amplitude);
            c.finite(path("phase_deg"), *phase_deg);
            c.positive(path("length"), *length);
            let rule = "at least 0.001 m";
            let is_long = period.is_finite() && *period >= 1e-3;
            c.require(is_long, path("period"), rule, number(*period));
        }
        // What the numbers of a map must be, its file says.
        Relief::Map { file, .. } => {
            c.require(!file.is_empty(), path("file"), "a file", "\"\"");
        }
        Relief::Roughness {
            class: _,
            shortest,
            longest,
            origin,
            size,
            seed: _,
        } => {
            check_point(c, path("origin"), *origin);
            let is_long = |length: f64| (0.001..=1e4).contains(&length);
            c.require(
                is_long(*shortest),
                path("shortest"),
                "in [0.001, 10000] m",
                number(*shortest),
            );
            c.require(
                is_long(*longest) && longest > shortest,
                path("longest"),
                "in [0.001, 10000] m and above shortest",
                number(*longest),
            );
            let is_area = size.iter().all(|length| is_long(*length));
            let rule = "both in [0.001, 10000] m";
            c.require(is_area, path("size"), rule, format!("{size:?}"));
            if is_area && is_long(*shortest) {
                let [columns, rows] = nodes(*shortest, *size);
                let count = columns as f64 * rows as f64;
                if count > NODES_MAX {
                    c.refuse(
                        path("size"),
                        format!(
                            "must be smaller: with eight nodes to the shortest wave it has {count:.2e}, and {NODES_MAX:.0e} are allowed"
                        ),
                        "make the area smaller, or the shortest wave longer",
                    );
                }
            }
        }
    }
}

fn check_place(c: &mut Checker, base: &str, at: [f64; 2], heading_deg: f64) {
    check_point(c, format!("{base}.at"), at);
    c.finite(format!("{base}.heading_deg"), heading_deg);
}

fn check_point(c: &mut Checker, path: String, at: [f64; 2]) {
    let is_near = at.iter().all(|x| x.abs() <= 1e6);
    let rule = "within 1e6 m of the origin";
    c.require(is_near, path, rule, format!("{at:?}"));
}

fn check_height(c: &mut Checker, path: String, value: f64) {
    c.require(
        value.abs() <= HEIGHT_MAX,
        path,
        &format!("in [-{HEIGHT_MAX}, {HEIGHT_MAX}] m"),
        number(value),
    );
}
