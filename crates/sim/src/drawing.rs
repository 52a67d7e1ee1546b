//! What a recording tells of its scene, for reports to draw: arena, robots, goals and paths.

use serde_json::{Value, json};

use crate::layout::{Assignment, Goal};
use crate::plan::Path;
use crate::run::drive_name;
use crate::scenario::{Drive, Robot, Scenario, Steering, TRAILER, Terrain, Trailer, Wheel};

/// What reports draw, beside the signals: arena, robots, goals and paths.
pub(crate) fn drawing(
    scenario: &Scenario,
    paths: &[Option<Path>],
    assignments: &[Option<Assignment>],
    integrators: &[String],
) -> Value {
    let terrain = match &scenario.terrain {
        Terrain::Flat { .. } => json!({"kind": "flat"}),
        Terrain::Plane {
            slope_deg,
            downhill_heading_deg,
            ..
        } => {
            json!({"kind": "plane", "slope_deg": slope_deg, "downhill_heading_deg": downhill_heading_deg})
        }
    };
    let friction = match &scenario.terrain {
        Terrain::Flat { friction, .. } | Terrain::Plane { friction, .. } => friction,
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
            "friction": friction,
            "patches": scenario.terrain.patches(),
        },
        "robots": robots,
        "statistics": scenario.statistics,
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
