//! The servo: from a twist to wheel rates, and from wheel rates to what the drives take.
//!
//! One cascade serves every level: rate drives take the wheel rates; torque drives take the torque
//! of the wanted acceleration plus a PI controller of the rate error; motors the voltage for that
//! torque on top of their back-EMF. Limits are kept, and the integral part stops at them.

mod steering;

use appell_model::drive::Drive;
use appell_model::planar::vec2;
use appell_model::platform::{MAX_WHEELS, Platform};
use appell_model::solve::{
    MAX_DOF, Mobility, Row, Square, add_outer, dot, invert, product, zero_row,
};
use appell_model::wheel::Wheel;

use crate::block::{Block, BlockError, Port, restore_numbers, save_numbers};
use crate::scenario;
use crate::signal::Signal;

use steering::Steering;

/// The cascade of one robot.
pub struct Servo {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    axles: Vec<Axle>,
    integral_time: f64,
    /// Feedback of rate (1) and angle (1/s) for ideal rate sources.
    feedback: Option<[f64; 2]>,
    /// What turns steered wheels, if there are any.
    steering: Option<Steering>,
    /// Per axle: last reference, rad/s, then the integral of the torque, N·m, or of the reference,
    /// rad; then whether it has run; then the wanted angle of each steered wheel, rad.
    state: Vec<f64>,
}

/// One driven wheel as the servo knows it.
struct Axle {
    /// Rate per twist component (forward, left, yaw rate).
    rate: [f64; 3],
    /// Torque per acceleration of each axle's reference, kg·m².
    inertia: Vec<f64>,
    viscous: f64,
    /// Gain of the rate error, N·m·s/rad.
    gain: f64,
    drive: Drive<f64>,
    rate_max: f64,
}

impl Servo {
    /// Derives gains from the platform: a wheel-rate loop of the given bandwidth (rad/s).
    /// Commands go to the ports that `to` names.
    pub fn new(
        robot: &scenario::Robot,
        platform: &Platform<f64>,
        period: f64,
        to: &dyn Fn(&Wheel<f64>) -> Port,
    ) -> Servo {
        let (file, level) = (&robot.servo, robot.level);
        let name = format!("robot.{}", robot.name);
        let wheels = platform.wheels();
        let driven = driven(platform);
        let port = |path: String, unit: &str| Signal {
            path: format!("{name}.{path}"),
            unit: unit.to_owned(),
        };
        let mut inputs = vec![
            port("command.forward".into(), "m/s"),
            port("command.left".into(), "m/s"),
            port("command.yaw_rate".into(), "rad/s"),
        ];
        let mut outputs = Vec::new();
        for &i in &driven {
            inputs.push(port(format!("wheel.{}.spin_rate", wheels[i].name), "rad/s"));
            outputs.push(to(&wheels[i]));
        }
        let feedback = (file.rate_feedback > 0.0 || file.angle_feedback > 0.0)
            .then_some([file.rate_feedback, file.angle_feedback]);
        if feedback.is_some() {
            for &i in &driven {
                inputs.push(port(format!("wheel.{}.spin_angle", wheels[i].name), "rad"));
            }
        }

        let leads = platform.layout().steered.clone();
        for &i in &leads {
            let wheel = &wheels[i].name;
            inputs.push(port(format!("wheel.{wheel}.steering_angle"), "rad"));
            inputs.push(port(format!("wheel.{wheel}.steering_rate"), "rad/s"));
            let (field, unit) = crate::plant::steering_signal(level);
            outputs.push(port(format!("wheel.{wheel}.{field}"), unit));
        }

        let x = crate::build::rest_state(platform, [0.0; 3], &[]);
        let n = platform.layout().dof();
        let reduced = platform.reduce(&x);
        let inverse = invert(n, &reduced.mass);
        let mut mobility = Mobility::new(n, &inverse);
        platform.guide(&x, &mut mobility, &mut zero_row());
        let rows: Vec<_> = driven
            .iter()
            .map(|&i| platform.spin_row(i, &platform.wheel_frame(i, &x)))
            .collect();
        let inertias = if leads.is_empty() {
            acceleration_torques(n, &reduced.mass, &rows)
        } else {
            guided_torques(n, mobility.matrix(), &rows)
        };
        let steering = Steering::new(robot, platform, inverse, mobility.matrix(), period);
        let bandwidth = file.bandwidth.unwrap_or(0.2 / period);
        let axles = driven
            .iter()
            .zip(&rows)
            .zip(inertias)
            .map(|((&i, row), inertia)| {
                let wheel = &wheels[i];
                let rate = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|t| {
                    let v = platform.velocity_from_twist(vec2(t[0], t[1]), t[2], &[]);
                    dot(n, row, &v)
                });
                let felt = 1.0 / dot(n, row, &product(n, mobility.matrix(), row));
                let rate_max = match &wheel.drive {
                    Drive::None => 0.0,
                    Drive::Rate { rate_max } => *rate_max,
                    Drive::Torque { .. } => f64::INFINITY,
                    // Voltage is left for control above the reference.
                    Drive::DcMotor(motor) => 0.95 * motor.no_load_rate(),
                };
                Axle {
                    rate,
                    inertia,
                    viscous: wheel.viscous,
                    gain: bandwidth * felt,
                    drive: wheel.drive,
                    rate_max,
                }
            })
            .collect::<Vec<_>>();
        let mut state = vec![0.0; 2 * axles.len() + 1];
        // Steered wheels stay as they start until there is somewhere to go.
        state.extend(steering.iter().flat_map(Steering::angles));
        Servo {
            inputs,
            outputs,
            state,
            axles,
            steering,
            integral_time: file.integral_time,
            feedback,
        }
    }
}

impl Block for Servo {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    fn step(
        &mut self,
        _tick: u64,
        _t: f64,
        dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        let count = self.axles.len();
        let (twist, measured) = input.split_at(3);
        let (rates, measured) = measured.split_at(count);
        let (angles, steered) = match self.feedback {
            Some(_) => measured.split_at(count),
            None => (&[][..], measured),
        };
        let mut wanted = [0.0; MAX_WHEELS];
        match &mut self.steering {
            None => {
                for (k, axle) in self.axles.iter().enumerate() {
                    wanted[k] = (0..3).map(|j| axle.rate[j] * twist[j]).sum();
                }
            }
            Some(steering) => {
                let leads = steered.len() / 2;
                let mut turned = [[0.0; MAX_WHEELS]; 2];
                for k in 0..leads {
                    (turned[0][k], turned[1][k]) = (steered[2 * k], steered[2 * k + 1]);
                }
                wanted = steering.act(
                    twist,
                    &turned[0][..leads],
                    &turned[1][..leads],
                    &mut self.state[2 * count + 1..],
                    &mut output[count..],
                );
            }
        }
        // Too fast for one wheel is too fast for all: the path is kept, the speed is not.
        let mut scale: f64 = 1.0;
        for (axle, wanted) in self.axles.iter().zip(wanted) {
            if wanted.abs() > axle.rate_max {
                scale = scale.min(axle.rate_max / wanted.abs());
            }
        }
        let started = self.state[2 * count] != 0.0;
        // What the last period left undone, where commanded rates are the motion.
        let mut corrections = [0.0; MAX_WHEELS];
        if let (Some([of_rate, of_angle]), true) = (self.feedback, started) {
            for k in 0..count {
                let (last, turned) = (self.state[k], &mut self.state[count + k]);
                *turned += dt * last;
                corrections[k] = of_rate * (rates[k] - last) + of_angle * (angles[k] - *turned);
            }
        }
        let mut accelerations = [0.0; MAX_WHEELS];
        for k in 0..count {
            let wanted = wanted[k] * scale;
            if started {
                accelerations[k] = (wanted - self.state[k]) / dt;
            }
            self.state[k] = wanted;
        }
        self.state[2 * count] = 1.0;
        for (k, axle) in self.axles.iter().enumerate() {
            let reference = self.state[k];
            let integral = self.state[count + k];
            let error = reference - rates[k];
            let ahead: f64 = (0..count).map(|j| axle.inertia[j] * accelerations[j]).sum();
            let torque = ahead + axle.viscous * reference + axle.gain * error + integral;
            let (command, saturated) = match &axle.drive {
                Drive::None => (0.0, true),
                Drive::Rate { .. } => (reference - corrections[k], true),
                Drive::Torque { torque_max } => limited(torque, *torque_max),
                Drive::DcMotor(motor) => {
                    let current = torque / motor.torque_per_current();
                    let voltage = motor.resistance * current + motor.back_emf(rates[k]);
                    limited(voltage, motor.voltage_max)
                }
            };
            output[k] = command;
            // At a limit the integral may only lead away from it.
            let may_learn = !saturated || error * command < 0.0;
            if may_learn && self.feedback.is_none() {
                self.state[count + k] += axle.gain * error * dt / self.integral_time;
            }
        }
        Ok(())
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.state, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        restore_numbers(&mut self.state, bytes)
    }
}

/// The wheels that take a command.
fn driven(platform: &Platform<f64>) -> Vec<usize> {
    let wheels = platform.wheels();
    (0..wheels.len())
        .filter(|&i| crate::plant::command_signal(&wheels[i].drive).is_some())
        .collect()
}

/// Torque per acceleration of each axle: v̇ from the axles' accelerations by least squares, then the
/// smallest torques for M v̇.
fn acceleration_torques(n: usize, mass: &Square<f64>, rows: &[Row<f64>]) -> Vec<Vec<f64>> {
    let mut normal = [zero_row::<f64>(); MAX_DOF];
    for row in rows {
        add_outer(n, &mut normal, 1.0, row, row);
    }
    let pseudo = invert(n, &normal);
    let per_axle = |row: &Row<f64>| {
        let share = product(n, &pseudo, row);
        let inertia =
            |other: &Row<f64>| dot(n, &share, &product(n, mass, &product(n, &pseudo, other)));
        rows.iter().map(inertia).collect()
    };
    rows.iter().map(per_axle).collect()
}

/// The same where steered wheels guide: axles that must agree share what all together feel.
fn guided_torques(n: usize, mobility: &Square<f64>, rows: &[Row<f64>]) -> Vec<Vec<f64>> {
    let felt: f64 = rows
        .iter()
        .map(|row| dot(n, row, &product(n, mobility, row)))
        .sum();
    let own = |k: usize| {
        let shares = (0..rows.len()).map(|j| if j == k { 1.0 / felt } else { 0.0 });
        shares.collect()
    };
    (0..rows.len()).map(own).collect()
}

/// The value within ± limit, and whether it was beyond.
fn limited(value: f64, limit: f64) -> (f64, bool) {
    (value.clamp(-limit, limit), value.abs() > limit)
}
