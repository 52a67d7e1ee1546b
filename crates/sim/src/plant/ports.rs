//! Signals of a plant: what it is commanded by, and what is known of it.

use appell_model::platform::{BODY_OUTPUTS, LEDGER, Platform, WheelOutput, YAW};
use appell_model::scalar::Scalar;
use appell_model::slip::SLIP_OUTPUTS;
use appell_model::wheel::{Steering, Wheel};

use super::System;
use super::alone::SIGNALS;
use crate::block::{Detail, Port};
use crate::scenario::Level;

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
fn draws<T: Scalar>(wheel: &Wheel<T>) -> bool {
    !matches!(wheel.steering, Steering::Free { .. })
}

/// A command per driven wheel, one per steering motor, then the brake.
pub(super) fn inputs<T: Scalar>(prefix: &str, platform: &Platform<T>, level: Level) -> Vec<Port> {
    let mut inputs = Vec::new();
    for wheel in platform.wheels() {
        if let Some((name, unit)) = command_signal(&wheel.drive) {
            inputs.push(Port::new(
                format!("{prefix}.wheel.{}.{name}", wheel.name),
                unit,
            ));
        }
    }
    for &i in &platform.layout().steered {
        let (name, unit) = steering_signal(level);
        let wheel = &platform.wheels()[i].name;
        inputs.push(Port::new(format!("{prefix}.wheel.{wheel}.{name}"), unit));
    }
    inputs.push(Port::new(format!("{prefix}.brake"), "1"));
    inputs
}

/// What is known of a plant: signals, and where each comes from.
pub(super) struct Outputs {
    prefix: String,
    ports: Vec<Port>,
    /// The place of an output, and that in the model's state.
    state: Vec<[usize; 2]>,
    /// The place of an output, and that in the model's outputs.
    model: Vec<[usize; 2]>,
    /// How many of either are motion.
    motion: [usize; 2],
    /// Place of what the energy ledger does not explain.
    residual: Option<usize>,
}

impl Outputs {
    /// Those of a level; `is_overdriven` where more wheels are driven than there are directions to go.
    pub fn new<T: Scalar>(prefix: &str, system: &System<T>, is_overdriven: bool) -> Self {
        let platform = system.platform();
        let layout = platform.layout();
        let mut outputs = Outputs {
            prefix: prefix.to_owned(),
            ports: Vec::new(),
            state: Vec::new(),
            model: Vec::new(),
            motion: [0; 2],
            residual: None,
        };
        outputs.state("pose.x", "m", 0);
        outputs.state("pose.y", "m", 1);
        outputs.state("pose.yaw", "rad", YAW);
        outputs.model("twist.forward", "m/s", 0);
        outputs.model("twist.left", "m/s", 1);
        outputs.model("twist.yaw_rate", "rad/s", 2);
        let mut swivels = 0;
        for (i, wheel) in platform.wheels().iter().enumerate() {
            let path = |field: &str| format!("wheel.{}.{field}", wheel.name);
            let of = |output| layout.wheel_output(i, output);
            outputs.state(&path("spin_angle"), "rad", layout.spin(i));
            outputs.model(&path("spin_rate"), "rad/s", of(WheelOutput::SpinRate));
            if wheel.swivels() {
                outputs.state(&path("steering_angle"), "rad", layout.swivel(swivels));
                let rate = of(WheelOutput::SteeringRate);
                outputs.model(&path("steering_rate"), "rad/s", rate);
                swivels += 1;
            }
        }
        if let Some(at) = system.attitude() {
            outputs.state("pose.z", "m", at);
            outputs.state("pose.roll", "rad", at + 1);
            outputs.state("pose.pitch", "rad", at + 2);
        }
        outputs.motion = [outputs.state.len(), outputs.model.len()];
        if system.has_forces() {
            outputs.add_forces(system);
        } else if is_overdriven {
            // They may disagree.
            outputs.model("internal_slip", "rad/s", BODY_OUTPUTS - 1);
        }
        outputs
    }

    fn add_forces<T: Scalar>(&mut self, system: &System<T>) {
        let platform = system.platform();
        let layout = platform.layout();
        for (i, wheel) in platform.wheels().iter().enumerate() {
            let mut add = |field: &str, unit, of| {
                let path = format!("wheel.{}.{field}", wheel.name);
                self.model(&path, unit, layout.wheel_output(i, of));
            };
            if command_signal(&wheel.drive).is_some() {
                add("torque", "N·m", WheelOutput::Torque);
            }
            if matches!(wheel.drive, appell_model::drive::Drive::DcMotor(_)) {
                add("current", "A", WheelOutput::Current);
            }
            add("force.longitudinal", "N", WheelOutput::Longitudinal);
            add("force.lateral", "N", WheelOutput::Lateral);
            add("load", "N", WheelOutput::Load);
        }
        self.model("energy.kinetic", "J", 3);
        self.model("energy.potential", "J", 4);
        self.model("energy.magnetic", "J", 5);
        let entries: [_; LEDGER] = ["supplied", "windings", "gears", "friction"];
        for (k, entry) in entries.iter().enumerate() {
            self.state(&format!("energy.{entry}"), "J", layout.ledger() + k);
        }
        self.residual = Some(self.ports.len());
        self.port("energy.residual", "J");
        if system.tips() {
            self.model("tip_margin", "m", 6);
        }
        if let System::Alone(system) = system
            && let Some(contacts) = system.contacts()
        {
            for (i, wheel) in platform.wheels().iter().enumerate() {
                for (k, (field, unit)) in SIGNALS.into_iter().enumerate() {
                    if draws(wheel) {
                        let path = format!("wheel.{}.{field}", wheel.name);
                        self.model(&path, unit, contacts + i * SLIP_OUTPUTS + k);
                    }
                }
            }
            for (i, wheel) in platform.wheels().iter().enumerate() {
                if let Some(at) = system.travel() {
                    self.model(&format!("wheel.{}.travel", wheel.name), "m", at + i);
                }
            }
        }
    }

    fn port(&mut self, path: &str, unit: &str) {
        self.ports
            .push(Port::new(format!("{}.{path}", self.prefix), unit));
    }

    fn state(&mut self, path: &str, unit: &str, at: usize) {
        self.state.push([self.ports.len(), at]);
        self.port(path, unit);
    }

    fn model(&mut self, path: &str, unit: &str, at: usize) {
        self.model.push([self.ports.len(), at]);
        self.port(path, unit);
    }

    pub fn ports(&self) -> &[Port] {
        &self.ports
    }

    /// Those that are always up to date: pose, twist, wheel angles and rates, and on uneven ground height, roll
    /// and pitch.
    pub fn motion(&self) -> &[Port] {
        let [states, models] = self.motion;
        &self.ports[..states + models]
    }

    /// Place of what the energy ledger does not explain, where there are forces.
    pub fn residual(&self) -> Option<usize> {
        self.residual
    }

    /// Writes the outputs of a state `x` and a model's outputs `y`, but for the residual.
    pub fn show<T: Scalar>(&self, detail: Detail, x: &[T], y: &[T], output: &mut [T]) {
        let [states, models] = match detail {
            Detail::Motion => self.motion,
            Detail::Everything => [self.state.len(), self.model.len()],
        };
        for &[to, from] in &self.state[..states] {
            output[to] = x[from];
        }
        for &[to, from] in &self.model[..models] {
            output[to] = y[from];
        }
    }
}
