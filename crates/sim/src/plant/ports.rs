//! Signals of a plant: what it is commanded by, and what is known of it.

use appell_model::platform::{BODY_OUTPUTS, LEDGER, Platform, WheelOutput, YAW};
use appell_model::scalar::Scalar;
use appell_model::slip::SLIP_OUTPUTS;
use appell_model::wheel::{Steering, Wheel};
use appell_model::wide::Job;

use crate::block::{Detail, Port};
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

/// Where outputs come from, in the order of [`ports`]: pairs of their place and that in the model's state, and in
/// its outputs.
pub(super) struct Sources {
    state: Vec<[usize; 2]>,
    model: Vec<[usize; 2]>,
    /// How many of either are motion.
    motion: [usize; 2],
    /// Place of what the energy ledger does not explain.
    pub residual: Option<usize>,
    /// Outputs so far.
    count: usize,
}

impl Sources {
    /// Those of a plant, which may have forces, be on uneven ground with its height, roll and pitch in the state,
    /// have more wheels driven than directions to go, or be watched for tipping over.
    pub fn new<T: Scalar>(
        platform: &Platform<T>,
        has_forces: bool,
        attitude: Option<usize>,
        is_overdriven: bool,
        tips: bool,
    ) -> Self {
        let layout = platform.layout();
        let mut sources = Sources {
            state: Vec::new(),
            model: Vec::new(),
            motion: [0; 2],
            residual: None,
            count: 0,
        };
        for at in [0, 1, YAW] {
            sources.add_state(at);
        }
        for at in 0..3 {
            sources.add_model(at);
        }
        let mut swivels = 0;
        for i in 0..layout.wheels {
            sources.add_state(layout.spin(i));
            sources.add_model(layout.wheel_output(i, WheelOutput::SpinRate));
            if layout.swivels.get(swivels) == Some(&i) {
                sources.add_state(layout.swivel(swivels));
                sources.add_model(layout.wheel_output(i, WheelOutput::SteeringRate));
                swivels += 1;
            }
        }
        if let Some(at) = attitude {
            (at..at + 3).for_each(|at| sources.add_state(at));
        }
        sources.motion = [sources.state.len(), sources.model.len()];
        if !has_forces {
            if is_overdriven {
                sources.add_model(BODY_OUTPUTS - 1);
            }
            return sources;
        }
        for (i, wheel) in platform.wheels().iter().enumerate() {
            let mut add = |of| sources.add_model(layout.wheel_output(i, of));
            if command_signal(&wheel.drive).is_some() {
                add(WheelOutput::Torque);
            }
            if matches!(wheel.drive, appell_model::drive::Drive::DcMotor(_)) {
                add(WheelOutput::Current);
            }
            add(WheelOutput::Longitudinal);
            add(WheelOutput::Lateral);
            add(WheelOutput::Load);
        }
        for at in 3..6 {
            sources.add_model(at);
        }
        for entry in 0..LEDGER {
            sources.add_state(layout.ledger() + entry);
        }
        sources.residual = Some(sources.count);
        sources.count += 1;
        if tips {
            sources.add_model(6);
        }
        sources
    }

    /// Adds those of [`contact_ports`], which stand in the model's outputs one after the other, and of the travel
    /// of springs.
    pub fn add_contacts<T: Scalar>(
        &mut self,
        platform: &Platform<T>,
        at: usize,
        travel: Option<usize>,
    ) {
        for (i, wheel) in platform.wheels().iter().enumerate() {
            if draws(wheel) {
                let at = at + i * SLIP_OUTPUTS;
                (at..at + SLIP_OUTPUTS).for_each(|at| self.add_model(at));
            }
        }
        if let Some(at) = travel {
            (at..at + platform.layout().wheels).for_each(|at| self.add_model(at));
        }
    }

    fn add_state(&mut self, at: usize) {
        self.state.push([self.count, at]);
        self.count += 1;
    }

    fn add_model(&mut self, at: usize) {
        self.model.push([self.count, at]);
        self.count += 1;
    }
}

/// Writes outputs of a state and a model's outputs, but for what the ledger does not explain.
pub(super) struct Show<'a, T> {
    pub sources: &'a Sources,
    pub detail: Detail,
    pub x: &'a [T],
    pub y: &'a [T],
    pub output: &'a mut [T],
}

impl<T: Scalar> Job for Show<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Sources { state, model, .. } = self.sources;
        let [states, models] = match self.detail {
            Detail::Motion => self.sources.motion,
            Detail::Everything => [state.len(), model.len()],
        };
        for k in 0..states {
            let [to, from] = state[k];
            self.output[to] = self.x[from];
        }
        for k in 0..models {
            let [to, from] = model[k];
            self.output[to] = self.y[from];
        }
    }
}
