//! Homing on a beacon: turns to it, drives there and stops beside it.
//!
//! ```sh
//! cargo build --release --target wasm32-unknown-unknown   # target/wasm32-unknown-unknown/release/homing.wasm
//! cargo build --release                                   # target/release/libhoming.so
//! appell run ../homing.toml
//! ```
//!
//! The arc tangent is that of the crate `libm`, so that module and library have the same bits.

use std::f64::consts::TAU;

use appell_sdk::{Now, controller};

controller! {
    name: "homing",
    version: env!("CARGO_PKG_VERSION"),
    about: "Turns to the beacon of the task, drives there and stops beside it.",
    inputs: {
        x: "pose.x" in "m",
        y: "pose.y" in "m",
        yaw: "pose.yaw" in "rad",
        beacon_x: "task.beacon.x" in "m",
        beacon_y: "task.beacon.y" in "m",
    },
    outputs: {
        forward: "command.forward" in "m/s" [0.0, 1.5],
        yaw_rate: "command.yaw_rate" in "rad/s" [-2.0, 2.0],
        left: "controller.left" in "m",
    },
    parameters: {
        speed: 0.8 in "m/s" [0.0, 1.5],
        acceleration: 0.6 in "m/s²" [0.05, 5.0] "of speeding up; half of it brakes",
        yaw_rate: 1.0 in "rad/s" [0.0, 2.0] "the fastest turn",
        gain: 2.0 in "1/s" [0.0, 10.0] "how hard it turns to the beacon",
        stop: 0.4 in "m" [0.0, 5.0] "distance from the beacon",
    },
    memory: { speed: f64 = 0.0 },
    step: step,
}

fn step(
    now: &Now<Outputs>,
    inputs: &Inputs,
    parameters: &Parameters,
    memory: &mut Memory,
) -> Result<Outputs, String> {
    let (dx, dy) = (inputs.beacon_x - inputs.x, inputs.beacon_y - inputs.y);
    let left = (dx * dx + dy * dy).sqrt() - parameters.stop;
    let turn = libm::atan2(dy, dx) - inputs.yaw;
    let bearing = turn - TAU * (turn / TAU).round_ties_even();

    if let Some(before) = now.before {
        memory.speed = before.forward.clamp(0.0, 1.5);
    }
    // As fast as it can still brake, and slower the less it looks at the beacon.
    let brakes = (parameters.acceleration * left.max(0.0)).sqrt();
    let ahead = (1.0 - bearing.abs()).max(0.0);
    let change = parameters.acceleration * now.dt;
    memory.speed += (parameters.speed.min(brakes) * ahead - memory.speed).clamp(-change, change);
    // Close by, the bearing turns faster than the robot could.
    let turning = match left > 0.02 {
        true => parameters.gain * bearing,
        false => 0.0,
    };
    Ok(Outputs {
        forward: memory.speed,
        yaw_rate: turning.clamp(-parameters.yaw_rate, parameters.yaw_rate),
        left,
    })
}
