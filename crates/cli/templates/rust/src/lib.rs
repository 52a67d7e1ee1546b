//! A controller to start from: drives to the beacon of the task and stops beside it.
//!
//! ```sh
//! rustup target add wasm32-unknown-unknown                # once
//! cargo build --release --target wasm32-unknown-unknown   # a module, with the same bits on every machine
//! cargo build --release                                   # or a library for this machine
//! cargo test
//! ```

use std::f64::consts::TAU;

use appell_sdk::{Now, controller};

controller! {
    name: "NAME",
    version: env!("CARGO_PKG_VERSION"),
    about: "Turns to the beacon and drives to it.",
    // What it reads: signals of the robot with their units, and the place of the task's beacon.
    inputs: {
        x: "pose.x" in "m",
        y: "pose.y" in "m",
        yaw: "pose.yaw" in "rad",
        beacon_x: "task.beacon.x" in "m",
        beacon_y: "task.beacon.y" in "m",
    },
    // What it writes, and within which limits: more is a fault.
    outputs: {
        forward: "command.forward" in "m/s" [-1.0, 1.0],
        yaw_rate: "command.yaw_rate" in "rad/s" [-2.0, 2.0],
        distance: "controller.distance" in "m", // a signal of its own, recorded like any other
    },
    // Numbers that a scenario, --set and a batch can change.
    parameters: {
        speed: 0.6 in "m/s" [0.0, 1.0],
        gain: 2.0 in "1/s" [0.0, 10.0],
        stop: 0.4 in "m" [0.0, 5.0] "distance from the beacon",
    },
    // All that it remembers from step to step; it is saved and restored.
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
    let turn = dy.atan2(dx) - inputs.yaw;
    let bearing = turn - TAU * (turn / TAU).round_ties_even();

    // One that takes over from another begins at its speed, as far as it may.
    if let Some(before) = now.before {
        memory.speed = before.forward.clamp(-1.0, 1.0);
    }
    // Speed up gently; brake so as to stop in time.
    let brakes = (2.0 * 0.3 * left.max(0.0)).sqrt();
    let wanted = match bearing.abs() < 0.5 {
        true => parameters.speed.min(brakes),
        false => 0.0,
    };
    memory.speed += (wanted - memory.speed).clamp(-0.6 * now.dt, 0.6 * now.dt);
    Ok(Outputs {
        forward: memory.speed,
        yaw_rate: match left > 0.02 {
            true => (parameters.gain * bearing).clamp(-1.2, 1.2),
            false => 0.0,
        },
        distance: left,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_turns_before_it_drives() {
        let now = Now {
            t: 0.0,
            dt: 0.1,
            before: None,
        };
        let (parameters, mut memory) = (Parameters::default(), Memory::default());
        let beside = Inputs {
            beacon_y: 2.0,
            ..Inputs::default()
        };
        let outputs = step(&now, &beside, &parameters, &mut memory).expect("it steps");
        assert_eq!((outputs.forward, outputs.yaw_rate), (0.0, 1.2));
        let ahead = Inputs {
            beacon_x: 2.0,
            ..Inputs::default()
        };
        let outputs = step(&now, &ahead, &parameters, &mut memory).expect("it steps");
        assert_eq!((outputs.forward, outputs.yaw_rate), (0.06, 0.0));
    }
}
