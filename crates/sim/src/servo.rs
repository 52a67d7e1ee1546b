//! The servo: from a twist to wheel rates, and from wheel rates to what the drives take.
//!
//! One cascade serves every level: rate drives take the wheel rates; torque drives take the torque
//! of the wanted acceleration plus a PI controller of the rate error; motors the voltage for that
//! torque on top of their back-EMF. Limits are kept, and the integral part stops at them.

use appell_model::drive::Drive;
use appell_model::planar::vec2;
use appell_model::platform::{MAX_WHEELS, Platform};
use appell_model::solve::{MAX_DOF, add_outer, dot, invert, product, zero_row};
use appell_model::wheel::Wheel;

use crate::block::{Block, BlockError, Port, restore_numbers, save_numbers};
use crate::scenario;
use crate::signal::Signal;

/// The cascade of one robot.
pub struct Servo {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    axles: Vec<Axle>,
    integral_time: f64,
    /// Feedback of rate (1) and angle (1/s) for ideal rate sources.
    feedback: Option<[f64; 2]>,
    /// Per axle: last reference, rad/s, then the integral of the torque, N·m, or of the reference,
    /// rad; then whether it has run.
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
        name: &str,
        platform: &Platform<f64>,
        file: &scenario::Servo,
        period: f64,
        to: &dyn Fn(&Wheel<f64>) -> Port,
    ) -> Servo {
        let robot = format!("robot.{name}");
        let wheels = platform.wheels();
        let driven: Vec<usize> = (0..wheels.len())
            .filter(|&i| crate::plant::command_signal(&wheels[i].drive).is_some())
            .collect();
        let port = |path: String, unit: &str| Signal {
            path: format!("{robot}.{path}"),
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

        let x = crate::build::rest_state(platform, [0.0; 3], &[]);
        let n = platform.layout().dof();
        let reduced = platform.reduce(&x);
        let inverse = invert(n, &reduced.mass);
        let rows: Vec<_> = driven
            .iter()
            .map(|&i| platform.spin_row(i, &platform.wheel_frame(i, &x)))
            .collect();
        // v̇ from the axles' accelerations by least squares, then the smallest torques for M v̇.
        let mut normal = [zero_row::<f64>(); MAX_DOF];
        for row in &rows {
            add_outer(n, &mut normal, 1.0, row, row);
        }
        let pseudo = invert(n, &normal);
        let bandwidth = file.bandwidth.unwrap_or(0.2 / period);
        let axles = driven
            .iter()
            .zip(&rows)
            .map(|(&i, row)| {
                let wheel = &wheels[i];
                let rate = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|t| {
                    let v = platform.velocity_from_twist(vec2(t[0], t[1]), t[2], &[]);
                    dot(n, row, &v)
                });
                let share = product(n, &pseudo, row);
                let inertia = rows
                    .iter()
                    .map(|other| {
                        let v_rate = product(n, &pseudo, other);
                        dot(n, &share, &product(n, &reduced.mass, &v_rate))
                    })
                    .collect();
                let felt = 1.0 / dot(n, row, &product(n, &inverse, row));
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
        Servo {
            inputs,
            outputs,
            state: vec![0.0; 2 * axles.len() + 1],
            axles,
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
        let (rates, angles) = measured.split_at(count);
        // Too fast for one wheel is too fast for all: the path is kept, the speed is not.
        let mut scale: f64 = 1.0;
        for axle in &self.axles {
            let wanted: f64 = (0..3).map(|k| axle.rate[k] * twist[k]).sum();
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
        for (k, axle) in self.axles.iter().enumerate() {
            let wanted: f64 = (0..3).map(|j| axle.rate[j] * twist[j]).sum::<f64>() * scale;
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

/// The value within ± limit, and whether it was beyond.
fn limited(value: f64, limit: f64) -> (f64, bool) {
    (value.clamp(-limit, limit), value.abs() > limit)
}
