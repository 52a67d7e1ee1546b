//! What a recording tells of its scene, for reports to draw: arena, robots, goals and paths.

use appell_model::planar::vec2;
use appell_model::terrain::Terrain as Relief;
use serde_json::{Value, json};

use crate::layout::{Assignment, Goal};
use crate::plan::Path;
use crate::run::drive_name;
use crate::scenario::{
    Drive, Form, Relief as Feature, Robot, Scenario, Steering, TRAILER, Terrain, Trailer, Wheel,
};

/// What reports draw, beside the signals: arena, robots, goals and paths.
pub(crate) fn drawing(
    scenario: &Scenario,
    paths: &[Option<Path>],
    assignments: &[Option<Assignment>],
    integrators: &[String],
    relief: Option<&Relief>,
) -> Value {
    let terrain = match (&scenario.terrain, relief) {
        (Terrain::Uneven { .. }, Some(relief)) => {
            let mut drawn = heights(relief, scenario.arena.size);
            drawn["jumps"] = json!(jumps(&scenario.terrain));
            drawn
        }
        (terrain, _) => even(terrain),
    };
    let beacons: Vec<Value> = scenario
        .arena
        .beacon
        .iter()
        .map(|b| json!({"name": b.name, "position": b.position, "radius": b.radius}))
        .collect();
    let robots: Vec<Value> = scenario
        .robot
        .iter()
        .enumerate()
        .map(|(k, robot)| draw_robot(robot, paths[k].as_ref(), assignments[k].as_ref(), scenario))
        .collect();
    json!({
        "title": scenario.title,
        "integrator": integrators.first(),
        "arena": {
            "size": scenario.arena.size,
            "beacons": beacons,
            "terrain": terrain,
            "friction": scenario.terrain.friction(),
            "patches": scenario.terrain.patches(),
        },
        "robots": robots,
        "statistics": scenario.statistics,
    })
}

fn even(terrain: &Terrain) -> Value {
    match terrain {
        Terrain::Plane {
            slope_deg,
            downhill_heading_deg,
            ..
        } => {
            json!({"kind": "plane", "slope_deg": slope_deg, "downhill_heading_deg": downhill_heading_deg})
        }
        Terrain::Flat { .. } | Terrain::Uneven { .. } => json!({"kind": "flat"}),
    }
}

/// Features whose height jumps, which cells alone would draw as slopes.
fn jumps(terrain: &Terrain) -> Vec<&Feature> {
    let is_sudden = |feature: &&Feature| match feature {
        Feature::Step { .. } | Feature::Block { .. } => true,
        Feature::Wave { form, .. } => *form == Form::Square,
        Feature::Ramp { length, .. } => *length == 0.0,
        Feature::Slope { .. } | Feature::Map { .. } | Feature::Roughness { .. } => false,
    };
    terrain.relief().iter().filter(is_sudden).collect()
}

/// Cells along the longer side of the arena for which a height is drawn.
const CELLS: f64 = 160.0;
/// Steps in which heights are told, from the lowest to the highest.
const LEVELS: f64 = 1000.0;

/// Heights of uneven ground in the middles of square cells, row after row from the lowest y.
fn heights(relief: &Relief, size: [f64; 2]) -> Value {
    let cell = size[0].max(size[1]) / CELLS;
    let [columns, rows] = size.map(|length| (length / cell).round().max(1.0) as usize);
    let at = |k: usize| (k as f64 + 0.5) * cell;
    let height = |k: usize| relief.height(vec2(at(k % columns), at(k / columns)));
    let heights: Vec<f64> = (0..columns * rows).map(height).collect();
    let low = heights.iter().fold(f64::MAX, |low, &h| low.min(h));
    let high = heights.iter().fold(f64::MIN, |high, &h| high.max(h));
    let span = if high > low { high - low } else { 1.0 };
    let levels: Vec<u32> = heights
        .iter()
        .map(|h| ((h - low) / span * LEVELS).round() as u32)
        .collect();
    json!({
        "kind": "uneven",
        "cell": cell,
        "columns": columns,
        "low": low,
        "high": high,
        "levels": levels,
    })
}

fn draw_robot(
    robot: &Robot,
    path: Option<&Path>,
    assignment: Option<&Assignment>,
    scenario: &Scenario,
) -> Value {
    let platform = robot
        .platform
        .as_ref()
        .expect("a checked scenario has platforms");
    let mut wheels: Vec<Value> = platform.wheel.iter().map(draw_wheel).collect();
    wheels.extend(platform.trailer.iter().map(draw_trailer));
    let goal = match assignment {
        None => Value::Null,
        Some(Assignment::Route(route)) => {
            json!({"kind": "route", "tolerance": route.tolerance, "end": route.end})
        }
        Some(Assignment::Beacons(goal)) => draw_goal(goal),
    };
    // Every fifth point or so draws the same curve.
    let thinned = path.map(|path| {
        let every = (path.points.len() / 400).max(1);
        let last = path.points.len() - 1;
        let keep = (0..=last).filter(|k| k % every == 0 || *k == last);
        keep.map(|k| path.points[k].map(|v| (v * 1e4).round() / 1e4))
            .collect::<Vec<_>>()
    });
    let mass: f64 = platform.body.mass + platform.wheel.iter().map(|w| w.mass).sum::<f64>();
    let center = [0, 1].map(|axis| {
        let wheels: f64 = platform.wheel.iter().map(|w| w.mass * w.mount[axis]).sum();
        (platform.body.mass * platform.body.center_of_mass[axis] + wheels) / mass
    });
    json!({
        "name": robot.name,
        "level": robot.level,
        "drive": drive_name(robot),
        "collision_radius": platform.collision_radius,
        "footprint": platform.footprint,
        "center_of_mass": center,
        "wheels": wheels,
        "start": robot.pose,
        "goal": goal,
        "path": thinned,
        "duration": scenario.time.duration,
    })
}

fn draw_goal(goal: &Goal) -> Value {
    match goal {
        Goal::Homing {
            beacon, distance, ..
        } => json!({"kind": "homing", "beacon": beacon, "distance": distance}),
        Goal::Gate {
            pair,
            direction,
            exit,
        } => json!({"kind": "gate", "pair": pair, "direction": direction, "exit": exit}),
        Goal::Eight { pair, laps, .. } => {
            json!({"kind": "eight", "pair": pair, "laps": laps})
        }
        Goal::Slalom {
            chain, first_side, ..
        } => {
            let sides: Vec<i8> = (0..chain.len())
                .map(|k| if k % 2 == 0 { *first_side } else { -first_side })
                .collect();
            json!({"kind": "slalom", "chain": chain, "sides": sides})
        }
    }
}

fn draw_trailer(trailer: &Trailer) -> Value {
    json!({
        "name": TRAILER,
        "kind": "trailer",
        "mount": trailer.hitch,
        "angle": 0.0,
        "radius": trailer.radius,
        "width": trailer.width,
        "trail": trailer.length,
        "track": trailer.track,
        "footprint": trailer.footprint,
        "roller_angle": 0.0,
        "driven": false,
    })
}

fn draw_wheel(wheel: &Wheel) -> Value {
    // The angle of a wheel that swivels is a signal.
    let (kind, angle, trail) = match (&wheel.steering, &wheel.rim) {
        (Steering::Free { trail, .. }, _) => ("caster", 0.0, *trail),
        (Steering::Fixed { angle_deg }, crate::scenario::Rim::Rollers { .. }) => {
            ("rollers", *angle_deg, 0.0)
        }
        (Steering::Fixed { angle_deg }, crate::scenario::Rim::Plain) => ("fixed", *angle_deg, 0.0),
        (_, crate::scenario::Rim::Rollers { .. }) => ("rollers", 0.0, 0.0),
        (_, crate::scenario::Rim::Plain) => ("steered", 0.0, 0.0),
    };
    let roller = match wheel.rim {
        crate::scenario::Rim::Rollers { angle_deg } => angle_deg.to_radians(),
        crate::scenario::Rim::Plain => 0.0,
    };
    json!({
        "name": wheel.name,
        "kind": kind,
        "mount": wheel.mount,
        "angle": angle.to_radians(),
        "radius": wheel.radius,
        "width": wheel.width,
        "trail": trail,
        "roller_angle": roller,
        "driven": wheel.drive != Drive::None,
    })
}
