//! What a wheel-legged robot does about steps and trenches, for people: words and a map.

use appell_model::wheel_legged::obstacle::{Decision, Limits, Obstacle, Strategy, decide};
use serde_json::{Value, json};

/// The limits, if they can be those of a robot.
///
/// # Errors
/// What is wrong with which of them: a length that is not finite or not above zero, wheels that
/// overlap, legs that climb less than a wheel.
pub fn limits(wheel_radius: f64, wheel_pitch: f64, height_max: f64) -> Result<Limits, String> {
    for (option, value) in [
        ("wheel-radius", wheel_radius),
        ("wheel-pitch", wheel_pitch),
        ("height-max", height_max),
    ] {
        // A robot of a millimeter or of a house has other limits than these.
        if !(0.01..=5.0).contains(&value) {
            return Err(format!(
                "--{option}: must be in [0.01, 5] m, got {value:e}\n  hint: lengths are in meters"
            ));
        }
    }
    if wheel_pitch < 2.0 * wheel_radius {
        return Err(format!(
            "--wheel-pitch: must be at least twice the wheel radius, {}, got {wheel_pitch}\n  hint: the wheels of a leg system would overlap",
            2.0 * wheel_radius
        ));
    }
    if height_max < wheel_radius {
        return Err(format!(
            "--height-max: must be at least the wheel radius, {wheel_radius}, got {height_max}\n  hint: so high a step needs no legs"
        ));
    }
    Ok(Limits {
        wheel_radius,
        wheel_pitch,
        height_max,
    })
}

/// A length of an obstacle, if it is one: `name` is what it is called in the error.
///
/// # Errors
/// A length that is not finite, below zero or above 100 m, which is no obstacle but a cliff.
pub fn length(name: &str, value: f64) -> Result<f64, String> {
    if value.is_finite() && (0.0..=100.0).contains(&value) {
        Ok(value)
    } else {
        Err(format!(
            "{name}: must be in [0, 100] m, got {value:e}\n  hint: lengths are in meters"
        ))
    }
}

/// A strategy in a word or two.
pub fn words(strategy: Strategy) -> &'static str {
    match strategy {
        Strategy::Direct => "drive on",
        Strategy::ClimbStep => "climb",
        Strategy::BridgeTrench => "bridge",
        Strategy::DescendClimb => "descend and climb",
        Strategy::Turn => "turn away",
    }
}

/// An obstacle in words.
pub fn name(obstacle: &Obstacle) -> String {
    match obstacle {
        Obstacle::Step { height } => format!("step of {height} m"),
        Obstacle::Trench { width, depth } => {
            format!("trench {width} m wide and {depth} m deep")
        }
    }
}

/// What to do about an obstacle, and why, as a sentence without its stop.
pub fn sentence(obstacle: &Obstacle, decision: &Decision) -> String {
    format!(
        "{}: {}, for {}",
        name(obstacle),
        words(decision.strategy),
        decision.reason
    )
}

/// A map over heights, widths and depths, m, with the strategy of [`decide`] in each of its areas;
/// the scales reach beyond all limits, and beyond the obstacle up to four times as far.
pub fn map(limits: &Limits, obstacle: Option<&Obstacle>) -> Value {
    let round = |value: f64| (value * 10.0).ceil() / 10.0;
    let mut height_max = round(1.5 * limits.height_max);
    let mut width_max = round(2.5 * limits.wheel_pitch);
    let at = obstacle.map(|obstacle| {
        let (kind, width, height) = match *obstacle {
            Obstacle::Step { height } => ("step", 0.0, height),
            Obstacle::Trench { width, depth } => ("trench", width, depth),
        };
        height_max = height_max.max(round(1.1 * height).min(4.0 * height_max));
        width_max = width_max.max(round(1.1 * width).min(4.0 * width_max));
        let decision = decide(obstacle, limits);
        let words = [
            format!("{}: {}", name(obstacle), self::words(decision.strategy)),
            format!("for {}", decision.reason),
        ];
        json!({"kind": kind, "width": width, "height": height, "words": words})
    });
    let heights = [0.0, limits.wheel_radius, limits.height_max, height_max];
    let widths = [0.0, limits.wheel_pitch, width_max];
    let middle = |pair: &[f64]| 0.5 * (pair[0] + pair[1]);
    let strategy = |obstacle| decide(&obstacle, limits).strategy;

    let mut steps: Vec<(f64, f64, Strategy)> = Vec::new();
    for pair in heights.windows(2) {
        let found = strategy(Obstacle::Step {
            height: middle(pair),
        });
        match steps.last_mut() {
            Some(last) if last.2 == found => last.1 = pair[1],
            _ => steps.push((pair[0], pair[1], found)),
        }
    }
    // Neighbors along a row are one area, and so are equal areas of neighboring rows.
    let mut trenches: Vec<([f64; 2], [f64; 2], Strategy)> = Vec::new();
    for depth in heights.windows(2) {
        let mut row: Vec<([f64; 2], Strategy)> = Vec::new();
        for width in widths.windows(2) {
            let found = strategy(Obstacle::Trench {
                width: middle(width),
                depth: middle(depth),
            });
            match row.last_mut() {
                Some(last) if last.1 == found => last.0[1] = width[1],
                _ => row.push(([width[0], width[1]], found)),
            }
        }
        for (width, found) in row {
            let below = trenches
                .iter_mut()
                .find(|(w, d, s)| *w == width && d[1] == depth[0] && *s == found);
            match below {
                Some(below) => below.1[1] = depth[1],
                None => trenches.push((width, [depth[0], depth[1]], found)),
            }
        }
    }
    json!({
        "title": "What a wheel-legged robot does about steps and trenches",
        "steps": steps.iter().map(|(a, b, s)| json!([a, b, s.key(), words(*s)])).collect::<Vec<_>>(),
        "trenches": trenches.iter().map(|(w, d, s)| json!([w[0], w[1], d[0], d[1], s.key(), words(*s)])).collect::<Vec<_>>(),
        "heights": [{"value": limits.wheel_radius, "name": "R"}, {"value": limits.height_max, "name": "limit"}],
        "widths": [{"value": limits.wheel_pitch, "name": "S₁"}],
        "height_max": height_max,
        "width_max": width_max,
        "obstacle": at,
    })
}

#[cfg(test)]
mod tests {
    use appell_model::wheel_legged::obstacle::{Limits, Obstacle};

    use super::{length, limits, map};

    #[test]
    fn refusal_lengths_that_are_none() {
        for value in [f64::NAN, f64::INFINITY, -0.1, 1e3] {
            assert!(
                length("--step", value).is_err_and(|e| e.contains("--step") && e.contains("hint"))
            );
        }
        for (radius, pitch, reach, at_fault) in [
            (0.0, 0.23, 0.25, "wheel-radius"),
            (0.1, f64::NAN, 0.25, "wheel-pitch"),
            (0.1, 0.19, 0.25, "wheel-pitch"),
            (0.1, 0.23, 0.05, "height-max"),
        ] {
            let refused = limits(radius, pitch, reach).expect_err("wrong");
            assert!(refused.contains(at_fault), "{refused}");
        }
    }

    /// The areas of the map tile both panels.
    #[test]
    fn invariant_the_map_has_no_gaps() {
        for obstacle in [
            None,
            Some(Obstacle::Trench {
                width: 3.0,
                depth: 0.2,
            }),
        ] {
            let map = map(&Limits::PUBLISHED, obstacle.as_ref());
            let number = |value: &serde_json::Value| value.as_f64().expect("a number");
            let steps = map["steps"].as_array().expect("a list");
            let tall: f64 = steps.iter().map(|s| number(&s[1]) - number(&s[0])).sum();
            assert!((tall - number(&map["height_max"])).abs() < 1e-12);
            let trenches = map["trenches"].as_array().expect("a list");
            let side = |t: &serde_json::Value, k: usize| number(&t[k + 1]) - number(&t[k]);
            let area: f64 = trenches.iter().map(|t| side(t, 0) * side(t, 2)).sum();
            let whole = number(&map["height_max"]) * number(&map["width_max"]);
            assert!((area - whole).abs() < 1e-12 * whole);
        }
    }
}
