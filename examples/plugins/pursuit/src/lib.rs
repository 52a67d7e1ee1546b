//! Pure pursuit of the planned path: steers for a point of it some way ahead.
//!
//! ```sh
//! cargo build --release --target wasm32-unknown-unknown   # target/wasm32-unknown-unknown/release/pursuit.wasm
//! cargo build --release                                   # target/release/libpursuit.so
//! appell run ../swap.toml --watch
//! ```
//!
//! The path is part of the context, which is JSON. Mathematics is that of the crate `libm`, so that module and
//! library have the same bits.

use std::f64::consts::TAU;

use appell_sdk::{Now, controller};
use serde::Deserialize;

controller! {
    name: "pursuit",
    version: env!("CARGO_PKG_VERSION"),
    about: "Pure pursuit of the planned path.",
    inputs: {
        x: "pose.x" in "m",
        y: "pose.y" in "m",
        yaw: "pose.yaw" in "rad",
    },
    outputs: {
        forward: "command.forward" in "m/s" [0.0, 2.0],
        yaw_rate: "command.yaw_rate" in "rad/s" [-4.0, 4.0],
        ahead: "controller.ahead" in "m",
    },
    parameters: {
        speed: 0.5 in "m/s" [0.0, 2.0],
        lookahead: 0.3 in "m" [0.05, 2.0],
    },
    memory: {
        x: Vec<f64> = Vec::new(),
        y: Vec<f64> = Vec::new(),
        heading: Vec<f64> = Vec::new(),
        ds: f64 = 0.0,
        nearest: Option<u64> = None,
        speed: f64 = 0.0,
    },
    start: start,
    step: step,
}

/// The part of the context that matters here.
#[derive(Deserialize)]
struct Context {
    path: Option<Way>,
}

#[derive(Deserialize)]
struct Way {
    ds: f64,
    points: Vec<[f64; 2]>,
    heading: Vec<f64>,
}

fn start(context: &str, _: &Parameters) -> Result<Memory, String> {
    let context: Context = serde_json::from_str(context).map_err(|error| error.to_string())?;
    let way = context.path.ok_or("there is no path to follow here")?;
    Ok(Memory {
        x: way.points.iter().map(|point| point[0]).collect(),
        y: way.points.iter().map(|point| point[1]).collect(),
        heading: way.heading,
        ds: way.ds,
        ..Memory::default()
    })
}

fn step(
    now: &Now<Outputs>,
    inputs: &Inputs,
    parameters: &Parameters,
    memory: &mut Memory,
) -> Result<Outputs, String> {
    let last = memory.x.len() - 1;
    let apart = |memory: &Memory, k: usize| {
        libm::hypot(memory.x[k] - inputs.x, memory.y[k] - inputs.y)
    };
    let mut nearest = match memory.nearest {
        Some(nearest) => nearest as usize,
        None => {
            if let Some(before) = now.before {
                memory.speed = before.forward.clamp(0.0, 2.0);
            }
            // The path may cross itself: a point that also points where the robot does.
            let cost = |k: &usize| {
                let turned = wrapped(memory.heading[*k] - inputs.yaw);
                apart(memory, *k) + 0.2 * turned.abs()
            };
            let best = (0..=last).min_by(|a, b| cost(a).total_cmp(&cost(b)));
            best.unwrap_or(0)
        }
    };
    while nearest < last && apart(memory, nearest + 1) <= apart(memory, nearest) {
        nearest += 1;
    }
    memory.nearest = Some(nearest as u64);

    let ahead = (parameters.lookahead / memory.ds).round().max(1.0) as usize;
    let ahead = last.min(nearest + ahead);
    let (dx, dy) = (memory.x[ahead] - inputs.x, memory.y[ahead] - inputs.y);
    let bearing = wrapped(libm::atan2(dy, dx) - inputs.yaw);
    let left = (last - nearest) as f64 * memory.ds;
    // A speed that half the braking distance allows, reached gently.
    let brakes = (2.0 * 0.4 * left).sqrt();
    let wanted = parameters.speed.min(brakes) * libm::cos(bearing).max(0.2);
    memory.speed += (wanted - memory.speed).clamp(-0.8 * now.dt, 0.8 * now.dt);
    let curvature = 2.0 * libm::sin(bearing) / libm::hypot(dx, dy).max(0.05);
    Ok(Outputs {
        forward: memory.speed.max(0.0),
        yaw_rate: (curvature * memory.speed).clamp(-3.0, 3.0),
        ahead: left,
    })
}

/// An angle within half a turn.
fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round_ties_even()
}
