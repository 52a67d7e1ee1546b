//! Signals of a plant: what it is commanded by, and what is known of it.

use appell_model::platform::Platform;
use appell_model::scalar::Scalar;
use appell_model::wheel::{Steering, Wheel};

use crate::block::Port;
use crate::scenario::Level;
use crate::signal::Signal;

/// Unit of the command of each kind of drive, and its name.
pub fn command_signal<T>(
    drive: &appell_model::drive::Drive<T>,
) -> Option<(&'static str, &'static str)> {
    use appell_model::drive::Drive;
    match drive {
        Drive::None => None,
        Drive::Rate { .. } => Some(("rate_command", "rad/s")),
        Drive::Torque { .. } => Some(("torque_command", "N·m")),
        Drive::DcMotor(_) => Some(("voltage", "V")),
    }
}

/// Name and unit of the command of a steering motor.
pub fn steering_signal(level: Level) -> (&'static str, &'static str) {
    match level {
        Level::Kinematic => ("steering_rate_command", "rad/s"),
        Level::Rolling | Level::Slip => ("steering_torque_command", "N·m"),
    }
}

/// Whether the contact of a wheel draws a force at level `slip`, as those of casters do not.
pub(super) fn draws<T: Scalar>(wheel: &Wheel<T>) -> bool {
    !matches!(wheel.steering, Steering::Free { .. })
}

/// What is known of the contacts at level `slip`.
pub(super) fn contact_ports<T: Scalar>(
    prefix: &str,
    platform: &Platform<T>,
    outputs: &mut Vec<Port>,
) {
    for wheel in platform.wheels().iter().filter(|wheel| draws(wheel)) {
        for (field, unit) in super::alone::SIGNALS {
            outputs.push(Port {
                path: format!("{prefix}.wheel.{}.{field}", wheel.name),
                unit: unit.into(),
            });
        }
    }
}

/// Inputs: a command per driven wheel, one per steering motor, then the brake. Outputs: see [`super::Plant::observe`].
pub(super) fn ports<T: Scalar>(
    prefix: &str,
    platform: &Platform<T>,
    level: Level,
    is_uneven: bool,
) -> (Vec<Port>, Vec<Port>) {
    let signal = |path: String, unit: &str| Signal {
        path: format!("{prefix}.{path}"),
        unit: unit.to_owned(),
    };
    let mut inputs = Vec::new();
    for wheel in platform.wheels() {
        if let Some((name, unit)) = command_signal(&wheel.drive) {
            inputs.push(signal(format!("wheel.{}.{name}", wheel.name), unit));
        }
    }
    for &i in &platform.layout().steered {
        let (name, unit) = steering_signal(level);
        let wheel = &platform.wheels()[i].name;
        inputs.push(signal(format!("wheel.{wheel}.{name}"), unit));
    }
    inputs.push(signal("brake".into(), "1"));
    let mut outputs = vec![
        signal("pose.x".into(), "m"),
        signal("pose.y".into(), "m"),
        signal("pose.yaw".into(), "rad"),
        signal("twist.forward".into(), "m/s"),
        signal("twist.left".into(), "m/s"),
        signal("twist.yaw_rate".into(), "rad/s"),
    ];
    for wheel in platform.wheels() {
        let mut add =
            |field: &str, unit| outputs.push(signal(format!("wheel.{}.{field}", wheel.name), unit));
        add("spin_angle", "rad");
        add("spin_rate", "rad/s");
        if wheel.swivels() {
            add("steering_angle", "rad");
            add("steering_rate", "rad/s");
        }
    }
    if is_uneven {
        outputs.push(signal("pose.z".into(), "m"));
        outputs.push(signal("pose.roll".into(), "rad"));
        outputs.push(signal("pose.pitch".into(), "rad"));
    }
    if level != Level::Kinematic {
        for wheel in platform.wheels() {
            let mut add = |field: &str, unit| {
                outputs.push(signal(format!("wheel.{}.{field}", wheel.name), unit))
            };
            if command_signal(&wheel.drive).is_some() {
                add("torque", "N·m");
            }
            if matches!(wheel.drive, appell_model::drive::Drive::DcMotor(_)) {
                add("current", "A");
            }
            add("force.longitudinal", "N");
            add("force.lateral", "N");
            add("load", "N");
        }
        for field in [
            "kinetic",
            "potential",
            "magnetic",
            "supplied",
            "windings",
            "gears",
            "friction",
            "residual",
        ] {
            outputs.push(signal(format!("energy.{field}"), "J"));
        }
    }
    (inputs, outputs)
}
