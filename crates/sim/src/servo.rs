//! The servo: from a twist to wheel rates, and from wheel rates to what the drives take.
//!
//! One cascade serves every level: rate drives take the wheel rates; torque drives take the torque
//! of the wanted acceleration plus a PI controller of the rate error; motors the voltage for that
//! torque on top of their back-EMF. Limits are kept, and the integral part stops at them.

mod steering;

use appell_model::drive::Drive;
use appell_model::lanewise;

use appell_model::lanewise::Lanewise;
use appell_model::planar::vec2;
use appell_model::platform::{MAX_WHEELS, Platform};
use appell_model::scalar::{Mask, Scalar};
use appell_model::solve::{
    MAX_DOF, Mobility, Row, Square, add_outer, dot, invert, invert_known, product, zero_row,
};
use appell_model::wheel::Wheel;

use crate::block::{Kernel, Now, Port, Wired, restore_numbers, save_numbers};
use crate::build::Values;
use crate::scenario;
use crate::signal::Signal;

use steering::Steering;

/// The cascade of one robot.
pub struct Servo<T: Scalar> {
    axles: Vec<Axle<T>>,
    integral_time: T,
    /// Feedback of rate (1) and angle (1/s) for ideal rate sources.
    feedback: Option<[T; 2]>,
    /// What turns steered wheels, if there are any.
    steering: Option<Steering<T>>,
    /// Per axle: last reference, rad/s, then the integral of the torque, N·m, or of the reference,
    /// rad; then whether it has run; then the wanted angle of each steered wheel, rad.
    state: Vec<T>,
}

/// One driven wheel as the servo knows it.
struct Axle<T> {
    /// Rate per twist component (forward, left, yaw rate).
    rate: [T; 3],
    /// Torque per acceleration of each axle's reference, kg·m².
    inertia: Vec<T>,
    viscous: T,
    /// Gain of the rate error, N·m·s/rad.
    gain: T,
    drive: Drive<T>,
    rate_max: T,
}

lanewise!(Axle { drive } state { rate, inertia, viscous, gain, rate_max });

impl<T: Scalar> Lanewise for Servo<T> {
    type One = Servo<f64>;

    fn fits(&self, one: &Servo<f64>) -> bool {
        self.axles.fits(&one.axles)
            && self.feedback.is_some() == one.feedback.is_some()
            && self.steering.fits(&one.steering)
            && self.state.len() == one.state.len()
    }

    fn put(&mut self, lane: usize, one: &Servo<f64>) {
        self.axles.put(lane, &one.axles);
        self.integral_time.put(lane, &one.integral_time);
        self.feedback.put(lane, &one.feedback);
        self.steering.put(lane, &one.steering);
        self.state.put(lane, &one.state);
    }
}

/// The servo of a robot, with gains derived from its platform: a wheel-rate loop of the given bandwidth
/// (rad/s). Commands go to the ports that `to` names.
pub fn servo<T: Scalar>(
    robot: &scenario::Robot,
    platform: &Platform<T>,
    period: f64,
    to: &dyn Fn(&Wheel<T>) -> Port,
    values: &Values<'_, T>,
) -> Wired<Servo<T>> {
    let (file, level) = (&robot.servo, robot.level);
    // A robot that steers by skidding turns as its wheels are told, where they may slip.
    let released;
    let skids = level == scenario::Level::Slip && platform.layout().eta == 1;
    let platform = if skids {
        released = platform.clone().released();
        &released
    } else {
        platform
    };
    let name = format!("robot.{}", robot.name);
    let wheels = platform.wheels();
    let driven = driven(platform);
    let port = |path: String, unit: &str| Signal {
        path: format!("{name}.{path}"),
        unit: unit.to_owned(),
    };
    let at = |key: &str, value: f64| values.at(format_args!("{name}.servo.{key}"), value);
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
    let feedback = (file.rate_feedback > 0.0 || file.angle_feedback > 0.0).then(|| {
        [
            at("rate_feedback", file.rate_feedback),
            at("angle_feedback", file.angle_feedback),
        ]
    });
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

    let x = crate::build::rest_state(platform, [T::zero(); 3], &[]);
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
    let bandwidth = match file.bandwidth {
        Some(bandwidth) => at("bandwidth", bandwidth),
        None => T::from(0.2 / period),
    };
    let axles = driven
        .iter()
        .zip(&rows)
        .zip(inertias)
        .map(|((&i, row), inertia)| {
            let wheel = &wheels[i];
            let rate = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|t| {
                let [forward, left, turn] = t.map(T::from);
                let v = platform.velocity_from_twist(vec2(forward, left), turn, &[]);
                dot(n, row, &v)
            });
            let felt = T::one() / dot(n, row, &product(n, mobility.matrix(), row));
            let mut gain = bandwidth * felt;
            if level == scenario::Level::Slip {
                // A wheel that has lost its grip moves nothing but itself: half of what would make
                // its loop unstable at this period.
                gain = gain.min(T::from(0.5 / period) * wheel.spin_inertia);
            }
            let rate_max = match &wheel.drive {
                Drive::None => T::zero(),
                Drive::Rate { rate_max } => *rate_max,
                Drive::Torque { .. } => T::from(f64::INFINITY),
                // Voltage is left for control above the reference.
                Drive::DcMotor(motor) => T::from(0.95) * motor.no_load_rate(),
            };
            Axle {
                rate,
                inertia,
                viscous: wheel.viscous,
                gain,
                drive: wheel.drive,
                rate_max,
            }
        })
        .collect::<Vec<_>>();
    let mut state = vec![T::zero(); 2 * axles.len() + 1];
    // Steered wheels stay as they start until there is somewhere to go.
    state.extend(steering.iter().flat_map(Steering::angles));
    let servo = Servo {
        state,
        axles,
        steering,
        integral_time: at("integral_time", file.integral_time),
        feedback,
    };
    Wired::new(inputs, outputs, servo)
}

impl<T: Scalar> Kernel<T> for Servo<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        let dt = T::from(now.dt);
        let count = self.axles.len();
        let (twist, measured) = input.split_at(3);
        let (rates, measured) = measured.split_at(count);
        let (angles, steered) = match self.feedback {
            Some(_) => measured.split_at(count),
            None => (&[][..], measured),
        };
        let mut wanted = [T::zero(); MAX_WHEELS];
        match &mut self.steering {
            None => {
                for k in 0..count {
                    let rate = self.axles[k].rate;
                    wanted[k] = rate[0] * twist[0] + rate[1] * twist[1] + rate[2] * twist[2];
                }
            }
            Some(steering) => {
                let leads = steered.len() / 2;
                let mut turned = [[T::zero(); MAX_WHEELS]; 2];
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
        let mut scale = T::one();
        for k in 0..count {
            let (size, most) = (wanted[k].abs(), self.axles[k].rate_max);
            let over = most.less(size);
            let share = most / T::select(over, size, T::one());
            scale = T::select(over, scale.min(share), scale);
        }
        let started = T::zero().less(self.state[2 * count]);
        // What the last period left undone, where commanded rates are the motion.
        let mut corrections = [T::zero(); MAX_WHEELS];
        if let Some([of_rate, of_angle]) = self.feedback {
            for k in 0..count {
                let (last, before) = (self.state[k], self.state[count + k]);
                let turned = T::select(started, before + dt * last, before);
                self.state[count + k] = turned;
                let wrong = of_rate * (rates[k] - last) + of_angle * (angles[k] - turned);
                corrections[k] = T::select(started, wrong, T::zero());
            }
        }
        let mut accelerations = [T::zero(); MAX_WHEELS];
        for k in 0..count {
            let wanted = wanted[k] * scale;
            let change = (wanted - self.state[k]) / dt;
            accelerations[k] = T::select(started, change, T::zero());
            self.state[k] = wanted;
        }
        self.state[2 * count] = T::one();
        for k in 0..count {
            let axle = &self.axles[k];
            let reference = self.state[k];
            let integral = self.state[count + k];
            let error = reference - rates[k];
            let mut ahead = T::zero();
            for j in 0..count {
                ahead += axle.inertia[j] * accelerations[j];
            }
            let torque = ahead + axle.viscous * reference + axle.gain * error + integral;
            let always = T::Mask::splat(true);
            let (command, saturated) = match &axle.drive {
                Drive::None => (T::zero(), always),
                Drive::Rate { .. } => (reference - corrections[k], always),
                Drive::Torque { torque_max } => limited(torque, *torque_max),
                Drive::DcMotor(motor) => {
                    let current = torque / motor.torque_per_current();
                    let voltage = motor.resistance * current + motor.back_emf(rates[k]);
                    limited(voltage, motor.voltage_max)
                }
            };
            output[k] = command;
            if self.feedback.is_none() {
                // At a limit the integral may only lead away from it.
                let away = (error * command).less(T::zero());
                let learned = integral + axle.gain * error * dt / self.integral_time;
                self.state[count + k] = T::select(saturated.not().or(away), learned, integral);
            }
        }
    }

    /// Begins anew, from the angles that are measured.
    fn take_over(&mut self, input: &[T], _before: &[T]) {
        let count = self.axles.len();
        let measured = &input[3 + count..];
        let (angles, steered) = match self.feedback {
            Some(_) => measured.split_at(count),
            None => (&[][..], measured),
        };
        self.state[..=2 * count].fill(T::zero());
        self.state[count..count + angles.len()].copy_from_slice(angles);
        for k in 0..steered.len() / 2 {
            self.state[2 * count + 1 + k] = steered[2 * k];
        }
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.state, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        restore_numbers(&mut self.state, bytes)
    }
}

/// The wheels that take a command.
fn driven<T: Scalar>(platform: &Platform<T>) -> Vec<usize> {
    let wheels = platform.wheels();
    (0..wheels.len())
        .filter(|&i| crate::plant::command_signal(&wheels[i].drive).is_some())
        .collect()
}

/// Torque per acceleration of each axle: v̇ from the axles' accelerations by least squares, then the
/// smallest torques for M v̇.
fn acceleration_torques<T: Scalar>(n: usize, mass: &Square<T>, rows: &[Row<T>]) -> Vec<Vec<T>> {
    let mut normal = [zero_row::<T>(); MAX_DOF];
    for row in rows {
        add_outer(n, &mut normal, T::one(), row, row);
    }
    // Directions in which no axle drives, as sideways on plain wheels, are left out.
    let mut trace = T::zero();
    for k in 0..n {
        trace += normal[k][k];
    }
    let pseudo = invert_known(n, &normal, trace * T::from(T::ROUNDING));
    let per_axle = |row: &Row<T>| {
        let share = product(n, &pseudo, row);
        let inertia =
            |other: &Row<T>| dot(n, &share, &product(n, mass, &product(n, &pseudo, other)));
        rows.iter().map(inertia).collect()
    };
    rows.iter().map(per_axle).collect()
}

/// The same where steered wheels guide: axles that must agree share what all together feel.
fn guided_torques<T: Scalar>(n: usize, mobility: &Square<T>, rows: &[Row<T>]) -> Vec<Vec<T>> {
    let mut felt = T::zero();
    for row in rows {
        felt += dot(n, row, &product(n, mobility, row));
    }
    let own = |k: usize| {
        let shares = (0..rows.len()).map(|j| if j == k { T::one() / felt } else { T::zero() });
        shares.collect()
    };
    (0..rows.len()).map(own).collect()
}

/// The value within ± limit, and whether it was beyond.
#[inline(always)]
fn limited<T: Scalar>(value: T, limit: T) -> (T, T::Mask) {
    (value.max(-limit).min(limit), limit.less(value.abs()))
}
