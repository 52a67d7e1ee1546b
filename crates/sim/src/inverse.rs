//! Inverse dynamics of a robot along a trajectory: what a motion demands of drives and ground.

use std::f64::consts::PI;

use appell_model::drive::Drive;
use appell_model::ground::Ground;
use appell_model::math::hypot;
use appell_model::math::single::{atan2, sin_cos};
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::Platform;
use appell_model::rolling::Rolling;

use crate::build::rest_state;
use crate::plan::{Path, SpeedLimits};
use crate::signal::Signal;
use crate::spline::Spline;

/// Motion at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Time, s.
    pub t: f64,
    /// Pose x, y, yaw of the base: m, m, rad.
    pub pose: [f64; 3],
    /// Twist forward, left, yaw rate: m/s, m/s, rad/s, base axes.
    pub twist: [f64; 3],
    /// Rates of the components of the twist: m/s², m/s², rad/s².
    pub rates: [f64; 3],
}

/// The first place where a limit is broken.
#[derive(Clone, Debug, PartialEq)]
pub struct Breach {
    /// Time, s.
    pub t: f64,
    /// Position, m.
    pub position: [f64; 2],
    /// What is broken, as a sentence.
    pub text: String,
}

/// What a trajectory demands.
#[derive(Clone, Debug, Default)]
pub struct Demanded {
    /// Times, s.
    pub times: Vec<f64>,
    /// Signals with their values at those times.
    pub columns: Vec<(Signal, Vec<f64>)>,
    /// The first breach of each kind, in the order of time.
    pub breaches: Vec<Breach>,
}

/// Fewest samples of a trajectory.
const SAMPLES_MIN: usize = 4;

/// Motion along sampled poses (m, m, rad) at increasing times, s: by cubic splines.
///
/// # Errors
/// Too few samples, or of different numbers.
pub fn sampled(t: &[f64], x: &[f64], y: &[f64], yaw: &[f64]) -> Result<Vec<Motion>, String> {
    if t.len() < SAMPLES_MIN || [x, y, yaw].iter().any(|column| column.len() != t.len()) {
        return Err(format!(
            "must have at least {SAMPLES_MIN} rows, got {}",
            t.len()
        ));
    }
    // An angle that is wrapped would turn back at full speed.
    let mut turned = yaw.to_vec();
    for k in 1..turned.len() {
        let turns = ((turned[k] - turned[k - 1]) / std::f64::consts::TAU).round();
        turned[k] -= turns * std::f64::consts::TAU;
    }
    let splines = [x, y, &turned].map(|values| Spline::new(t, values));
    Ok(t.iter()
        .map(|&t| {
            let [
                [x, x_rate, x_bend],
                [y, y_rate, y_bend],
                [yaw, turn, turn_rate],
            ] = [0, 1, 2].map(|k: usize| splines[k].at(t));
            let (sin, cos) = sin_cos(yaw);
            let velocity = vec2(x_rate, y_rate).rotated(cos, -sin);
            // The rate of the components, as the axes turn with the base.
            let rates = vec2(x_bend, y_bend).rotated(cos, -sin) - velocity.perpendicular() * turn;
            Motion {
                t,
                pose: [x, y, yaw],
                twist: [velocity.x, velocity.y, turn],
                rates: [rates.x, rates.y, turn_rate],
            }
        })
        .collect())
}

/// Poses of the base whose point at `ahead` m in front of the axle goes through (x, y), m, without
/// side slip, from a heading, rad: the wheels follow where the point leads.
///
/// # Errors
/// A point on the axle leads nowhere, or too few samples.
pub fn led(
    t: &[f64],
    x: &[f64],
    y: &[f64],
    ahead: f64,
    heading: f64,
) -> Result<Vec<Motion>, String> {
    if ahead == 0.0 {
        return Err("must be a point off the axle, got 0 m".into());
    }
    if t.len() < SAMPLES_MIN {
        return Err(format!(
            "must have at least {SAMPLES_MIN} rows, got {}",
            t.len()
        ));
    }
    let splines = [Spline::new(t, x), Spline::new(t, y)];
    let turn = |t: f64, yaw: f64| {
        let (sin, cos) = sin_cos(yaw);
        (cos * splines[1].at(t)[1] - sin * splines[0].at(t)[1]) / ahead
    };
    let mut yaw = heading;
    let mut motions = Vec::with_capacity(t.len());
    for (k, &now) in t.iter().enumerate() {
        let [[px, vx, ax], [py, vy, ay]] = [0, 1].map(|k: usize| splines[k].at(now));
        let (sin, cos) = sin_cos(yaw);
        let velocity = vec2(vx, vy).rotated(cos, -sin);
        let bend = vec2(ax, ay).rotated(cos, -sin);
        // The point's velocity in the base is (V, ω·ahead); its rate gives both accelerations.
        let yaw_rate = velocity.y / ahead;
        let rate = bend - velocity.perpendicular() * yaw_rate;
        motions.push(Motion {
            t: now,
            pose: [px - ahead * cos, py - ahead * sin, yaw],
            twist: [velocity.x, 0.0, yaw_rate],
            rates: [rate.x, 0.0, rate.y / ahead],
        });
        if let Some(&next) = t.get(k + 1) {
            // Runge–Kutta 4 over parts of the interval.
            const PARTS: usize = 4;
            let h = (next - now) / PARTS as f64;
            for part in 0..PARTS {
                let at = now + part as f64 * h;
                let a = turn(at, yaw);
                let b = turn(at + 0.5 * h, yaw + 0.5 * h * a);
                let c = turn(at + 0.5 * h, yaw + 0.5 * h * b);
                let d = turn(at + h, yaw + h * c);
                yaw += h / 6.0 * (a + 2.0 * (b + c) + d);
            }
        }
    }
    Ok(motions)
}

/// Motion along a planned path within speed limits, from rest to rest.
pub fn along(path: &Path, limits: &SpeedLimits) -> Vec<Motion> {
    let speeds = path.speed_profile(limits);
    let last = speeds.len() - 1;
    let mut t = 0.0;
    let mut motions = Vec::with_capacity(speeds.len());
    for k in 0..=last {
        let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
        let span = (after - before).max(1) as f64 * path.ds;
        let v = speeds[k];
        // v dv/ds, and the bend of the path as it changes on the way.
        let rate = 0.5 * (speeds[after] * speeds[after] - speeds[before] * speeds[before]) / span;
        let bend = (path.curvature[after] - path.curvature[before]) / span;
        let [x, y] = path.points[k];
        motions.push(Motion {
            t,
            pose: [x, y, path.heading[k]],
            twist: [v, 0.0, v * path.curvature[k]],
            rates: [rate, 0.0, rate * path.curvature[k] + v * v * bend],
        });
        if k < last {
            t += 2.0 * path.ds / (v + speeds[k + 1]).max(1e-9);
        }
    }
    motions
}

/// What the drives give and the ground must: limits of one wheel.
struct Wheel {
    name: String,
    index: usize,
    drive: Drive<f64>,
}

/// Torques, currents, voltages, power and contact forces that a motion needs, with the first place
/// where each limit is broken.
///
/// Steered wheels point where their mounts go; casters with mass and trailers swivel as the motion
/// makes them, from trailing behind at its start.
pub fn demanded(
    platform: &Platform<f64>,
    ground: Ground<f64>,
    friction: Option<f64>,
    motions: &[Motion],
) -> Demanded {
    let layout = platform.layout().clone();
    let wheels: Vec<Wheel> = platform
        .wheels()
        .iter()
        .enumerate()
        .map(|(index, wheel)| Wheel {
            name: wheel.name.clone(),
            index,
            drive: wheel.drive,
        })
        .collect();
    let weight = platform.total_mass() * ground.gravity_normal;
    let system = Rolling::new(platform.clone(), ground);
    let u = vec![0.0; layout.input()];
    let n = layout.dof();
    let mut table = Table::default();
    let swivels = Swivels::along(platform, motions);
    for (row, motion) in motions.iter().enumerate() {
        let [forward, left, turn] = motion.twist;
        let (rates, accelerations) = swivels.steering(platform, row);
        let v = platform.velocity_from_twist(vec2(forward, left), turn, &rates);
        let v_rate = platform.velocity_from_twist(
            vec2(motion.rates[0], motion.rates[1]),
            motion.rates[2],
            &accelerations,
        );
        let (velocity, _) = platform.twist(&v);
        let mut x = rest_state(platform, motion.pose, &swivels.angles[row]);
        x[layout.velocity()..][..n].copy_from_slice(&v[..n]);
        let spins = |v: &[f64; appell_model::solve::MAX_DOF]| -> Vec<f64> {
            let (velocity, yaw_rate) = platform.twist(v);
            platform.rates_from_twist(&x, [velocity.x, velocity.y, yaw_rate])
        };
        let (rates, spin_ups) = (spins(&v), spins(&v_rate));
        // Friction resists the way a wheel turns, or is about to.
        let mode: Vec<f64> = rates
            .iter()
            .zip(&spin_ups)
            .map(|(&rate, &up)| 1.0_f64.copysign(if rate == 0.0 { up } else { rate }))
            .collect();
        let demand = system.inverse(&x, &u, &mode, &v_rate);
        table.begin(motion);
        let slip = hypot(velocity.x - forward, velocity.y - left);
        table.put("trajectory.slip", "m/s", slip);
        table.refuse(slip > 1e-3 * (1.0 + hypot(forward, left)), "slip", || {
            format!("the wheels cannot roll this way: {slip:.4} m/s beside")
        });
        table.refuse(demand.residual > 1e-6 * weight, "residual", || {
            format!(
                "no drive gives the force that is missing: {:.4} N or N·m",
                demand.residual
            )
        });
        for wheel in &wheels {
            let (i, name) = (wheel.index, &wheel.name);
            let torque = demand.torque[i];
            table.put(&format!("wheel.{name}.spin_rate"), "rad/s", rates[i]);
            if !matches!(wheel.drive, Drive::None) {
                table.put(&format!("wheel.{name}.torque"), "N·m", torque);
            }
            match &wheel.drive {
                Drive::None | Drive::Rate { .. } => {}
                Drive::Torque { torque_max } => {
                    table.refuse(torque.abs() > *torque_max, "torque", || {
                        format!(
                            "torque of {name}: {torque:.3} N·m, the drive gives {torque_max:.3}"
                        )
                    });
                }
                Drive::DcMotor(motor) => {
                    let current = torque / motor.torque_per_current();
                    table.put(&format!("wheel.{name}.current"), "A", current);
                    table.refuse(current.abs() > motor.current_max, "current", || {
                        let most = motor.current_max;
                        format!(
                            "current of {name}: {current:.3} A, the driver lets through {most:.3}"
                        )
                    });
                }
            }
            if layout.steered.contains(&i) {
                let angle = platform.steering_angle(i, &x);
                table.put(&format!("wheel.{name}.steering_angle"), "rad", angle);
                let torque = demand.steering[i];
                table.put(&format!("wheel.{name}.steering_torque"), "N·m", torque);
            }
            let (along, across) = (demand.longitudinal[i], demand.lateral[i]);
            table.put(&format!("wheel.{name}.force.longitudinal"), "N", along);
            table.put(&format!("wheel.{name}.force.lateral"), "N", across);
            if system.support().is_some() {
                let load = demand.load[i];
                table.put(&format!("wheel.{name}.load"), "N", load);
                table.refuse(load < 0.0, "lift", || format!("{name} lifts: {load:.3} N"));
                if let Some(friction) = friction {
                    let force = hypot(along, across);
                    let limit = friction * load.max(0.0);
                    table.refuse(force > limit + 1e-9, "friction", || {
                        format!("{name} slips: {force:.3} N, μN is {limit:.3} N")
                    });
                }
            }
        }
        if system.support().is_some() {
            table.put("tip_margin", "m", demand.tip_margin);
            table.refuse(demand.tip_margin < 0.0, "tip", || {
                "the robot tips over".into()
            });
        }
    }
    table.electric(&wheels);
    table.done
}

/// Angles of the wheels that swivel, along a motion.
struct Swivels {
    /// Angle of each swivelling wheel at each instant, rad.
    angles: Vec<Vec<f64>>,
    /// Rate of each at each instant, rad/s.
    rates: Vec<Vec<f64>>,
    /// Angular acceleration of each, rad/s².
    accelerations: Vec<Vec<f64>>,
}

/// Speed of a mount below which its direction says nothing, m/s.
const STANDS: f64 = 1e-6;

impl Swivels {
    fn along(platform: &Platform<f64>, motions: &[Motion]) -> Swivels {
        let layout = platform.layout();
        let count = layout.swivels.len();
        let mut swivels = Swivels {
            angles: vec![vec![0.0; count]; motions.len()],
            rates: vec![vec![0.0; count]; motions.len()],
            accelerations: vec![vec![0.0; count]; motions.len()],
        };
        for (k, &i) in layout.swivels.iter().enumerate() {
            if layout.steered.contains(&i) {
                swivels.steer(k, platform.wheels()[i].mount, motions);
            } else if platform.wheels()[i].trail() != 0.0 {
                swivels.swing(k, i, platform, motions);
            }
        }
        swivels
    }

    /// Steering rates and accelerations at an instant, of the wheels that motors steer.
    fn steering(&self, platform: &Platform<f64>, row: usize) -> (Vec<f64>, Vec<f64>) {
        let layout = platform.layout();
        let place = |i: &usize| layout.swivels.iter().position(|swivel| swivel == i);
        let places: Vec<usize> = layout.steered.iter().filter_map(place).collect();
        let of = |table: &[Vec<f64>]| places.iter().map(|&k| table[row][k]).collect();
        (of(&self.rates), of(&self.accelerations))
    }

    /// A wheel that points where its mount goes, the end nearer to where it pointed before leading.
    fn steer(&mut self, k: usize, mount: Vec2<f64>, motions: &[Motion]) {
        let mut known: Option<f64> = None;
        for (row, motion) in motions.iter().enumerate() {
            let at = |[x, y, turn]: [f64; 3]| vec2(x, y) + mount.perpendicular() * turn;
            let (velocity, rate) = (at(motion.twist), at(motion.rates));
            let square = velocity.dot(velocity);
            if square > STANDS * STANDS {
                let heading = atan2(velocity.y, velocity.x);
                let before = known.unwrap_or(0.0);
                let half_turns = ((heading - before) / PI).round();
                let angle = heading - half_turns * PI;
                if known.is_none() {
                    // Until it moves it stands as it will.
                    self.angles[..row]
                        .iter_mut()
                        .for_each(|angles| angles[k] = angle);
                }
                known = Some(angle);
                // Of a heading atan2(v_y, v_x).
                self.rates[row][k] = velocity.cross(rate) / square;
            }
            self.angles[row][k] = known.unwrap_or(0.0);
        }
        let last = motions.len() - 1;
        for row in 0..=last {
            let (before, after) = (row.saturating_sub(1), (row + 1).min(last));
            let span = motions[after].t - motions[before].t;
            if span > 0.0 {
                let change = self.rates[after][k] - self.rates[before][k];
                self.accelerations[row][k] = change / span;
            }
        }
    }

    /// A caster or trailer that swings as the constraint at its axle makes it, by Runge–Kutta 4 on
    /// twists that change evenly between the instants.
    fn swing(&mut self, k: usize, i: usize, platform: &Platform<f64>, motions: &[Motion]) {
        /// Steps between two instants.
        const STEPS: usize = 8;
        let wheel = &platform.wheels()[i];
        let rate = |angle: f64, twist: [f64; 3]| {
            let (sin, cos) = sin_cos(angle);
            let frame = wheel.frame(cos, sin);
            platform.caster_rate(i, &frame, vec2(twist[0], twist[1]), twist[2])
        };
        let mount = |twist: [f64; 3]| {
            let velocity = vec2(twist[0], twist[1]) + wheel.mount.perpendicular() * twist[2];
            (hypot(velocity.x, velocity.y) > STANDS).then(|| atan2(velocity.y, velocity.x))
        };
        // It trails behind where its pivot first goes.
        let mut angle = motions
            .iter()
            .find_map(|motion| mount(motion.twist))
            .unwrap_or(0.0);
        for row in 0..motions.len() {
            self.angles[row][k] = angle;
            self.rates[row][k] = rate(angle, motions[row].twist);
            let Some(next) = motions.get(row + 1) else {
                break;
            };
            let (from, to) = (motions[row].twist, next.twist);
            let h = (next.t - motions[row].t) / STEPS as f64;
            for step in 0..STEPS {
                let twist = |share: f64| {
                    let share = (step as f64 + share) / STEPS as f64;
                    [0, 1, 2].map(|axis| from[axis] + share * (to[axis] - from[axis]))
                };
                let first = rate(angle, twist(0.0));
                let second = rate(angle + 0.5 * h * first, twist(0.5));
                let third = rate(angle + 0.5 * h * second, twist(0.5));
                let last = rate(angle + h * third, twist(1.0));
                angle += h / 6.0 * (first + 2.0 * second + 2.0 * third + last);
            }
        }
    }
}

/// Columns as they grow, row by row.
#[derive(Default)]
struct Table {
    done: Demanded,
    next: usize,
    position: [f64; 2],
    kinds: Vec<&'static str>,
}

impl Table {
    fn begin(&mut self, motion: &Motion) {
        self.done.times.push(motion.t);
        self.next = 0;
        self.position = [motion.pose[0], motion.pose[1]];
        let names = [
            "pose.x",
            "pose.y",
            "pose.yaw",
            "twist.forward",
            "twist.left",
            "twist.yaw_rate",
        ];
        let units = ["m", "m", "rad", "m/s", "m/s", "rad/s"];
        let values = motion.pose.iter().chain(&motion.twist);
        for ((name, unit), &value) in names.iter().zip(units).zip(values) {
            self.put(name, unit, value);
        }
    }

    fn put(&mut self, name: &str, unit: &str, value: f64) {
        if self.next == self.done.columns.len() {
            self.done
                .columns
                .push((Signal::new(name, unit), Vec::new()));
        }
        self.done.columns[self.next].1.push(value);
        self.next += 1;
    }

    /// Notes the first breach of a kind.
    fn refuse(&mut self, broken: bool, kind: &'static str, text: impl FnOnce() -> String) {
        if broken && !self.kinds.contains(&kind) {
            self.kinds.push(kind);
            let t = self.done.times.last().copied().unwrap_or(0.0);
            self.done.breaches.push(Breach {
                t,
                position: self.position,
                text: text(),
            });
        }
    }

    fn column(&self, name: &str) -> Option<&Vec<f64>> {
        let found = self
            .done
            .columns
            .iter()
            .find(|(signal, _)| signal.path == name);
        found.map(|(_, values)| values)
    }

    /// Voltages and power, once the currents are known at all times: U = R I + E + L İ.
    fn electric(&mut self, wheels: &[Wheel]) {
        let rows = self.done.times.len();
        let mut power = vec![0.0; rows];
        for wheel in wheels {
            let name = &wheel.name;
            let Some(rates) = self.column(&format!("wheel.{name}.spin_rate")).cloned() else {
                continue;
            };
            match &wheel.drive {
                Drive::DcMotor(motor) => {
                    let Some(currents) = self.column(&format!("wheel.{name}.current")).cloned()
                    else {
                        continue;
                    };
                    let slope = |k: usize| {
                        let (a, b) = (k.saturating_sub(1), (k + 1).min(rows - 1));
                        let span = self.done.times[b] - self.done.times[a];
                        if span > 0.0 {
                            (currents[b] - currents[a]) / span
                        } else {
                            0.0
                        }
                    };
                    let voltages: Vec<f64> = (0..rows)
                        .map(|k| {
                            motor.resistance * currents[k]
                                + motor.back_emf(rates[k])
                                + motor.inductance * slope(k)
                        })
                        .collect();
                    for k in 0..rows {
                        power[k] += voltages[k] * currents[k];
                    }
                    let most = motor.voltage_max;
                    if let Some(k) = voltages.iter().position(|voltage| voltage.abs() > most) {
                        self.done.breaches.push(Breach {
                            t: self.done.times[k],
                            position: self.place(k),
                            text: format!(
                                "voltage of {name}: {:.3} V, the supply gives {most:.3}",
                                voltages[k]
                            ),
                        });
                    }
                    let signal = Signal::new(format!("wheel.{name}.voltage"), "V");
                    self.done.columns.push((signal, voltages));
                }
                Drive::Torque { .. } => {
                    let torques = self.column(&format!("wheel.{name}.torque"));
                    for (k, torque) in torques.into_iter().flatten().enumerate() {
                        power[k] += torque * rates[k];
                    }
                }
                Drive::None | Drive::Rate { .. } => {}
            }
        }
        self.done.columns.push((Signal::new("power", "W"), power));
        self.done.breaches.sort_by(|a, b| a.t.total_cmp(&b.t));
    }

    fn place(&self, row: usize) -> [f64; 2] {
        ["pose.x", "pose.y"].map(|name| self.column(name).map_or(0.0, |values| values[row]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_spline_reproduces_cubics() {
        let t = [0.0, 0.3, 0.5, 1.1, 1.4, 2.0];
        let cubic = |t: f64| 1.0 + t * (-2.0 + t * (0.5 + 0.7 * t));
        let spline = Spline::new(&t, &t.map(cubic));
        for k in 0..=40 {
            let t = 0.05 * f64::from(k);
            let [value, rate, bend] = spline.at(t);
            // Differences of values of order one over intervals of 0.2 s.
            assert!((value - cubic(t)).abs() < 1e-14);
            assert!((rate - (-2.0 + t + 2.1 * t * t)).abs() < 1e-13);
            assert!((bend - (1.0 + 4.2 * t)).abs() < 1e-12);
        }
    }
}
