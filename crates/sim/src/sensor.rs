//! Sensors: what a robot knows of its pose, its wheels and the beacons.

use appell_model::ground::Ground;
use appell_model::kinematic::along_arc;
use appell_model::lanewise;
use appell_model::lanewise::Lanewise;
use appell_model::math::{hypot, wrap_angle};
use appell_model::planar::vec2;
use appell_model::platform::{MAX_WHEELS, Platform, PlatformError};
use appell_model::scalar::{Mask, Scalar};

use crate::block::{Block, Kernel, Now, Port, Wired, restore_numbers, save_numbers};
use crate::build::Values;
use crate::layout::Beacon;
use crate::noise::{Stream, Streams};
use crate::scenario::{OdometryMethod, Sensor};
use crate::signal::Signal;

fn port(path: String, unit: &str) -> Port {
    Signal {
        path,
        unit: unit.to_owned(),
    }
}

/// Builds the block of a sensor of robot `name`, among beacons and under gravity.
pub fn build<T: Scalar>(
    sensor: &Sensor,
    name: &str,
    platform: &Platform<T>,
    (beacons, ground): (&[Beacon], Ground<T>),
    start: [T; 3],
    key: (u64, u64),
    values: &Values<'_, T>,
) -> Box<dyn Block<T>> {
    let robot = format!("robot.{name}");
    let streams = |path: &str| Streams::new(Stream::new(key.0, key.1, path));
    let pose = || -> Vec<Port> {
        [("x", "m"), ("y", "m"), ("yaw", "rad")]
            .map(|(axis, unit)| port(format!("{robot}.pose.{axis}"), unit))
            .to_vec()
    };
    let wheels = platform.wheels();
    let driven: Vec<usize> = (0..wheels.len())
        .filter(|&i| crate::plant::command_signal(&wheels[i].drive).is_some())
        .collect();
    let angles = || -> Vec<Port> {
        let path = |&i: &usize| format!("{robot}.wheel.{}.spin_angle", wheels[i].name);
        driven.iter().map(|i| port(path(i), "rad")).collect()
    };
    match sensor {
        Sensor::Pose {
            position_std,
            yaw_std,
            ..
        } => {
            let outputs: Vec<Port> = [("x", "m"), ("y", "m"), ("yaw", "rad")]
                .map(|(axis, unit)| port(format!("{robot}.sensor.pose.{axis}"), unit))
                .to_vec();
            let at =
                |key: &str, value: f64| values.at(format_args!("{robot}.sensor.pose.{key}"), value);
            let position = at("position_std", *position_std);
            let kernel = PoseSensor {
                streams: outputs.iter().map(|p| streams(&p.path)).collect(),
                std: [position, position, at("yaw_std", *yaw_std)],
            };
            Box::new(Wired::new(pose(), outputs, kernel))
        }
        Sensor::Encoder {
            resolution,
            angle_std,
            ..
        } => {
            let path = |&i: &usize| format!("{robot}.sensor.encoder.{}", wheels[i].name);
            let outputs: Vec<Port> = driven.iter().map(|i| port(path(i), "rad")).collect();
            let kernel = Encoder {
                streams: outputs.iter().map(|p| streams(&p.path)).collect(),
                resolution: *resolution,
                std: values.at(format_args!("{robot}.sensor.encoder.angle_std"), *angle_std),
            };
            Box::new(Wired::new(angles(), outputs, kernel))
        }
        Sensor::Odometry {
            name,
            method,
            resolution,
            angle_std,
            radius_scale,
            track_scale,
            causes,
            ..
        } => {
            let base = format!("{robot}.sensor.{name}");
            let xyz = [("x", "m"), ("y", "m"), ("yaw", "rad")];
            let mut outputs: Vec<Port> = xyz
                .map(|(axis, unit)| port(format!("{base}.{axis}"), unit))
                .to_vec();
            let mut inputs = angles();
            if *causes {
                inputs.extend(pose());
                for cause in CAUSES {
                    let error = |axis: &str| format!("{base}.error.{cause}.{axis}");
                    outputs.extend(xyz.map(|(axis, unit)| port(error(axis), unit)));
                    outputs.push(port(error("distance"), "m"));
                }
                outputs.push(port(format!("{base}.error.distance"), "m"));
            }
            let at = |key: &str, value: f64| values.at(format_args!("{base}.{key}"), value);
            let reckoning = |method: OdometryMethod, scales: [T; 2]| Reckoning {
                gain: twist_from_rates(platform, &driven, scales[0], scales[1]),
                method,
                pose: start,
            };
            let believed = [
                at("radius_scale", *radius_scale),
                at("track_scale", *track_scale),
            ];
            let still = vec![T::zero(); driven.len()];
            let kernel = Odometry {
                streams: driven
                    .iter()
                    .map(|&i| streams(&format!("{base}.{}", wheels[i].name)))
                    .collect(),
                resolution: *resolution,
                std: at("angle_std", *angle_std),
                readings: still.clone(),
                believed: reckoning(*method, believed),
                causes: causes.then(|| Causes {
                    angles: still,
                    chain: [
                        reckoning(OdometryMethod::Arc, [T::one(); 2]),
                        reckoning(*method, [T::one(); 2]),
                        reckoning(*method, believed),
                    ],
                }),
            };
            Box::new(Wired::new(inputs, outputs, kernel))
        }
        Sensor::Motion {
            straight_radius,
            spot_radius,
            ..
        } => {
            let mut inputs = pose();
            let twist = [("forward", "m/s"), ("left", "m/s"), ("yaw_rate", "rad/s")];
            inputs.extend(twist.map(|(axis, unit)| port(format!("{robot}.twist.{axis}"), unit)));
            let outputs = [
                ("regime", "1"),
                ("radius", "m"),
                ("center.x", "m"),
                ("center.y", "m"),
            ]
            .map(|(what, unit)| port(format!("{robot}.sensor.motion.{what}"), unit))
            .to_vec();
            let kernel = MotionSensor {
                radii: [T::from(*straight_radius), T::from(*spot_radius)],
                last: [T::zero(), T::zero(), start[0], start[1]],
            };
            Box::new(Wired::new(inputs, outputs, kernel))
        }
        Sensor::RangeBearing {
            range_max,
            view_deg,
            range_std,
            bearing_std,
            ..
        } => {
            let mut outputs = Vec::new();
            for beacon in beacons {
                let base = format!("{robot}.sensor.beacon.{}", beacon.name);
                outputs.push(port(format!("{base}.range"), "m"));
                outputs.push(port(format!("{base}.bearing"), "rad"));
                outputs.push(port(format!("{base}.visible"), "1"));
            }
            let kernel = RangeBearing {
                streams: beacons
                    .iter()
                    .map(|b| streams(&format!("{robot}.sensor.beacon.{}", b.name)))
                    .collect(),
                beacons: beacons.iter().map(|b| b.position.map(T::from)).collect(),
                range_max: T::from(*range_max),
                half_view: T::from(0.5 * view_deg.to_radians()),
                std: [T::from(*range_std), T::from(*bearing_std)],
                last: vec![[T::zero(); 2]; beacons.len()],
            };
            Box::new(Wired::new(pose(), outputs, kernel))
        }
        Sensor::Imu {
            period,
            gyro_noise_density,
            accel_noise_density,
        } => {
            let of = |(what, unit): (&str, &str)| port(format!("{robot}.{what}"), unit);
            let inputs = [
                ("pose.yaw", "rad"),
                ("twist.forward", "m/s"),
                ("twist.left", "m/s"),
                ("twist.yaw_rate", "rad/s"),
            ];
            let outputs = [
                ("sensor.imu.yaw_rate", "rad/s"),
                ("sensor.imu.forward", "m/s²"),
                ("sensor.imu.left", "m/s²"),
                ("sensor.imu.up", "m/s²"),
            ]
            .map(of)
            .to_vec();
            let std = |key: &str, density: f64| {
                let density = values.at(format_args!("{robot}.sensor.imu.{key}"), density);
                density / T::from(period.sqrt())
            };
            let accel = std("accel_noise_density", *accel_noise_density);
            let kernel = Imu {
                streams: outputs.iter().map(|p| streams(&p.path)).collect(),
                period: T::from(*period),
                std: [
                    std("gyro_noise_density", *gyro_noise_density),
                    accel,
                    accel,
                    accel,
                ],
                gravity: [ground.gravity.x, ground.gravity.y, ground.gravity_normal],
                before: [T::zero(); 2],
            };
            Box::new(Wired::new(inputs.map(of).to_vec(), outputs, kernel))
        }
    }
}

/// The platform with wheels `radius_scale` times as large on a track `track_scale` times as wide.
///
/// # Errors
/// Its wheels may be locked: axles that met in one point need not do so any more.
pub fn believed<T: Scalar>(
    platform: &Platform<T>,
    radius_scale: T,
    track_scale: T,
) -> Result<Platform<T>, PlatformError> {
    let mut wheels = platform.wheels().to_vec();
    for wheel in &mut wheels {
        wheel.radius *= radius_scale;
        wheel.mount.y *= track_scale;
    }
    Platform::new(*platform.body(), wheels)
}

/// Rows (forward, left, yaw rate) over the driven wheels' rates: least squares, `[eq:kinematic]`,
/// for wheels believed larger by `radius_scale` and a track believed wider by `track_scale`.
pub(crate) fn twist_from_rates<T: Scalar>(
    platform: &Platform<T>,
    driven: &[usize],
    radius_scale: T,
    track_scale: T,
) -> [Vec<T>; 3] {
    use appell_model::solve::{MAX_DOF, add_outer, invert, product, zero_row};
    let believed = believed(platform, radius_scale, track_scale)
        .expect("a checked odometry believes in a platform that can move");
    let n = believed.layout().dof();
    let x = crate::build::rest_state(&believed, [T::zero(); 3], &[]);
    let rows: Vec<_> = driven
        .iter()
        .map(|&i| believed.spin_row(i, &believed.wheel_frame(i, &x)))
        .collect();
    let mut normal = [zero_row::<T>(); MAX_DOF];
    for row in &rows {
        add_outer(n, &mut normal, T::one(), row, row);
    }
    let inverse = invert(n, &normal);
    let mut gain = [const { Vec::new() }; 3];
    for row in &rows {
        let v = product(n, &inverse, row);
        let (velocity, yaw_rate) = believed.twist(&v);
        for (axis, value) in [velocity.x, velocity.y, yaw_rate].into_iter().enumerate() {
            gain[axis].push(value);
        }
    }
    gain
}

#[inline(always)]
fn rounded<T: Scalar>(angle: T, resolution: u32) -> T {
    if resolution == 0 {
        return angle;
    }
    let step = T::from(std::f64::consts::TAU / f64::from(resolution));
    (angle / step).floor() * step
}

/// Whether a standard deviation adds anything in any lane.
#[inline(always)]
fn is_noisy<T: Scalar>(std: T) -> bool {
    T::zero().less(std).any()
}

struct PoseSensor<T> {
    streams: Vec<Streams>,
    std: [T; 3],
}

lanewise!(PoseSensor { streams, std });

impl<T: Scalar> Kernel<T> for PoseSensor<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        for k in 0..3 {
            output[k] = input[k];
            if is_noisy(self.std[k]) {
                output[k] += self.std[k] * self.streams[k].normals::<T>(now.ticks)[0];
            }
        }
    }
}

struct Encoder<T> {
    streams: Vec<Streams>,
    resolution: u32,
    std: T,
}

lanewise!(Encoder {
    streams,
    resolution,
    std
});

impl<T: Scalar> Kernel<T> for Encoder<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        for k in 0..self.streams.len() {
            let mut angle = input[k];
            if is_noisy(self.std) {
                angle += self.std * self.streams[k].normals::<T>(now.ticks)[0];
            }
            output[k] = rounded(angle, self.resolution);
        }
    }
}

/// A pose summed from the turning of wheels. `[eq:odometry]`
struct Reckoning<T> {
    gain: [Vec<T>; 3],
    method: OdometryMethod,
    pose: [T; 3],
}

impl<T: Scalar> Lanewise for Reckoning<T> {
    type One = Reckoning<f64>;

    fn fits(&self, one: &Reckoning<f64>) -> bool {
        // The gains are zero or not by the geometry, and the start of a pose is of no account.
        self.method == one.method && self.gain[0].len() == one.gain[0].len()
    }

    fn put(&mut self, lane: usize, one: &Reckoning<f64>) {
        self.gain.put(lane, &one.gain);
        self.pose.put(lane, &one.pose);
    }
}

impl<T: Scalar> Reckoning<T> {
    /// Adds the way of a period in which the wheels turned by these angles, rad.
    #[inline(always)]
    fn add(&mut self, turned: &[T]) {
        let mut moved = [T::zero(); 3];
        for axis in 0..3 {
            let gain = &self.gain[axis];
            for k in 0..turned.len() {
                moved[axis] += gain[k] * turned[k];
            }
        }
        let way = vec2(moved[0], moved[1]);
        let (yaw_sin, yaw_cos) = self.pose[2].sin_cos();
        let step = match self.method {
            OdometryMethod::Unrotated => way,
            OdometryMethod::Euler => way.rotated(yaw_cos, yaw_sin),
            OdometryMethod::Arc => {
                let half = (T::from(0.5) * moved[2]).sin_cos();
                along_arc(way, moved[2], half).rotated(yaw_cos, yaw_sin)
            }
        };
        self.pose[0] += step.x;
        self.pose[1] += step.y;
        self.pose[2] += moved[2];
    }
}

/// Dead reckoning between two readings.
struct Odometry<T> {
    streams: Vec<Streams>,
    resolution: u32,
    std: T,
    /// Last reading of each wheel, rad.
    readings: Vec<T>,
    believed: Reckoning<T>,
    causes: Option<Causes<T>>,
}

/// Odometries that lack one cause of error after the other; the differences between neighbors are
/// the parts of the error.
struct Causes<T> {
    /// Last angle of each wheel, rad.
    angles: Vec<T>,
    /// From exact angles: with the true geometry along arcs, with the method, with the believed
    /// geometry, too.
    chain: [Reckoning<T>; 3],
}

lanewise!(Odometry {
    streams,
    resolution,
    std,
    believed,
    causes
} state { readings });
lanewise!(Causes { chain } state { angles });

/// Causes of an odometry's error, in the order in which they come in.
pub(crate) const CAUSES: [&str; 4] = ["slip", "method", "geometry", "encoder"];

impl<T: Scalar> Kernel<T> for Odometry<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        let count = self.streams.len();
        let mut turned = [T::zero(); MAX_WHEELS];
        // The first reading is what the others are counted from.
        let begun = T::Mask::from_lanes(|lane| now.ticks[lane] > 0);
        for k in 0..count {
            let mut angle = input[k];
            if is_noisy(self.std) && begun.any() {
                let noise = self.std * self.streams[k].normals::<T>(now.ticks)[0];
                angle = T::select(begun, angle + noise, angle);
            }
            let angle = rounded(angle, self.resolution);
            turned[k] = angle - self.readings[k];
            self.readings[k] = angle;
        }
        self.believed.add(&turned[..count]);
        for axis in 0..3 {
            output[axis] = self.believed.pose[axis];
        }
        let Some(causes) = &mut self.causes else {
            return;
        };
        for k in 0..count {
            turned[k] = input[k] - causes.angles[k];
            causes.angles[k] = input[k];
        }
        let mut before = [input[count], input[count + 1], input[count + 2]];
        let total = hypot(
            self.believed.pose[0] - before[0],
            self.believed.pose[1] - before[1],
        );
        for part in 0..CAUSES.len() {
            let after = if part < 3 {
                causes.chain[part].add(&turned[..count]);
                causes.chain[part].pose
            } else {
                self.believed.pose
            };
            let at = 3 + 4 * part;
            for axis in 0..3 {
                output[at + axis] = after[axis] - before[axis];
            }
            output[at + 3] = hypot(output[at], output[at + 1]);
            before = after;
        }
        output[3 + 4 * CAUSES.len()] = total;
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.readings, bytes);
        save_numbers(&self.believed.pose, bytes);
        if let Some(causes) = &self.causes {
            save_numbers(&causes.angles, bytes);
            for reckoning in &causes.chain {
                save_numbers(&reckoning.pose, bytes);
            }
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        let mut used = restore_numbers(&mut self.readings, bytes)?;
        used += restore_numbers(&mut self.believed.pose, bytes.get(used..)?)?;
        if let Some(causes) = &mut self.causes {
            used += restore_numbers(&mut causes.angles, bytes.get(used..)?)?;
            for reckoning in &mut causes.chain {
                used += restore_numbers(&mut reckoning.pose, bytes.get(used..)?)?;
            }
        }
        Some(used)
    }
}

/// What kind of motion this is, and about which point. `[eq:rotation-center]`
struct MotionSensor<T> {
    /// Radius beyond which motion counts as straight, and below which as turning on the spot, m.
    radii: [T; 2],
    /// Regime, radius, center: what stays while the robot stands.
    last: [T; 4],
}

lanewise!(MotionSensor { radii } state { last });

/// Speed, m/s, and yaw rate, rad/s, below which a robot stands.
const STANDS: f64 = 1e-6;

impl<T: Scalar> Kernel<T> for MotionSensor<T> {
    #[inline(always)]
    fn act(&mut self, _now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        let [straight, spot] = self.radii;
        let velocity = vec2(input[3], input[4]);
        let (speed, turn) = (hypot(velocity.x, velocity.y), input[5]);
        let limit = T::from(STANDS);
        let stands = speed.less(limit).and(turn.abs().less(limit));
        // Beyond the limit, the center stands at it.
        let is_straight = (straight * turn.abs()).less(speed);
        let bent = T::select(is_straight, T::one(), turn);
        let radius = T::select(is_straight, straight.copysign(turn), speed / bent);
        let is_arc = spot.less(radius.abs());
        let regime = T::select(is_arc, T::from(2.0), T::from(3.0));
        let regime = T::select(is_straight, T::one(), regime);
        // The center lies to the left of the motion, for a positive radius.
        let scale = radius / speed.max(T::from(T::LEAST));
        let (sin, cos) = input[2].sin_cos();
        let arm = (velocity.perpendicular() * scale).rotated(cos, sin);
        let moving = [regime, radius, input[0] + arm.x, input[1] + arm.y];
        let standing = [T::zero(), self.last[1], self.last[2], self.last[3]];
        for k in 0..4 {
            self.last[k] = T::select(stands, standing[k], moving[k]);
            output[k] = self.last[k];
        }
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.last, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        restore_numbers(&mut self.last, bytes)
    }
}

struct RangeBearing<T> {
    streams: Vec<Streams>,
    beacons: Vec<[T; 2]>,
    range_max: T,
    half_view: T,
    std: [T; 2],
    /// Last reading of each beacon: what stays on the port while it is not seen.
    last: Vec<[T; 2]>,
}

impl<T: Scalar> Lanewise for RangeBearing<T> {
    type One = RangeBearing<f64>;

    fn fits(&self, one: &RangeBearing<f64>) -> bool {
        // A place may be zero in one lane and not in another.
        self.beacons.len() == one.beacons.len()
    }

    fn put(&mut self, lane: usize, one: &RangeBearing<f64>) {
        self.streams.put(lane, &one.streams);
        self.beacons.put(lane, &one.beacons);
        self.range_max.put(lane, &one.range_max);
        self.half_view.put(lane, &one.half_view);
        self.std.put(lane, &one.std);
        self.last.put(lane, &one.last);
    }
}

impl<T: Scalar> Kernel<T> for RangeBearing<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        for k in 0..self.beacons.len() {
            let beacon = self.beacons[k];
            let (dx, dy) = (beacon[0] - input[0], beacon[1] - input[1]);
            let range = hypot(dx, dy);
            let bearing = wrap_angle(dy.atan2(dx) - input[2]);
            let near = range.less_equal(self.range_max);
            let visible = near.and(bearing.abs().less_equal(self.half_view));
            if visible.any() {
                let [first, second] = self.streams[k].normals::<T>(now.ticks);
                let measured = [
                    (range + self.std[0] * first).max(T::zero()),
                    wrap_angle(bearing + self.std[1] * second),
                ];
                for of in 0..2 {
                    self.last[k][of] = T::select(visible, measured[of], self.last[k][of]);
                }
            }
            output[3 * k] = self.last[k][0];
            output[3 * k + 1] = self.last[k][1];
            output[3 * k + 2] = T::select(visible, T::one(), T::zero());
        }
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        self.last.iter().for_each(|pair| save_numbers(pair, bytes));
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        let mut used = 0;
        for pair in &mut self.last {
            used += restore_numbers(pair, bytes.get(used..)?)?;
        }
        Some(used)
    }
}

struct Imu<T> {
    streams: Vec<Streams>,
    period: T,
    /// Of yaw rate and of accelerations forward, left and up.
    std: [T; 4],
    /// In the plane of the arena, and along its normal, m/s².
    gravity: [T; 3],
    /// Velocity forward and left at the last reading, m/s.
    before: [T; 2],
}

lanewise!(Imu { streams, period, std, gravity } state { before });

impl<T: Scalar> Kernel<T> for Imu<T> {
    #[inline(always)]
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) {
        let [yaw, forward, left, yaw_rate] = [input[0], input[1], input[2], input[3]];
        // The first reading has no velocity before it.
        let begun = T::Mask::from_lanes(|lane| now.ticks[lane] > 0);
        let changed =
            |velocity: T, before: T| T::select(begun, (velocity - before) / self.period, T::zero());
        let (sin, cos) = yaw.sin_cos();
        let pull = vec2(self.gravity[0], self.gravity[1]).rotated(cos, -sin);
        output[0] = yaw_rate;
        output[1] = changed(forward, self.before[0]) - yaw_rate * left - pull.x;
        output[2] = changed(left, self.before[1]) + yaw_rate * forward - pull.y;
        output[3] = self.gravity[2];
        self.before = [forward, left];
        for k in 0..4 {
            if is_noisy(self.std[k]) {
                output[k] += self.std[k] * self.streams[k].normals::<T>(now.ticks)[0];
            }
        }
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.before, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        restore_numbers(&mut self.before, bytes)
    }
}
