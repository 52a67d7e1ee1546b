//! Sensors: what a robot knows of its pose, its wheels and the beacons.

use appell_model::kinematic::along_arc;
use appell_model::math::single::{atan2, sin_cos};
use appell_model::math::{hypot, wrap_angle};
use appell_model::planar::vec2;
use appell_model::platform::{MAX_WHEELS, Platform, PlatformError};

use crate::block::{Block, BlockError, Port, restore_numbers, save_numbers};
use crate::layout::Beacon;
use crate::noise::Stream;
use crate::scenario::{OdometryMethod, Sensor};
use crate::signal::Signal;

fn port(path: String, unit: &str) -> Port {
    Signal {
        path,
        unit: unit.to_owned(),
    }
}

/// Builds the block of a sensor of robot `name`.
pub fn build(
    sensor: &Sensor,
    name: &str,
    platform: &Platform<f64>,
    beacons: &[Beacon],
    start: [f64; 3],
    key: (u64, u64),
) -> Box<dyn Block> {
    let robot = format!("robot.{name}");
    let stream = |path: &str| Stream::new(key.0, key.1, path);
    let pose = || -> Vec<Port> {
        [("x", "m"), ("y", "m"), ("yaw", "rad")]
            .map(|(axis, unit)| port(format!("{robot}.pose.{axis}"), unit))
            .to_vec()
    };
    let driven: Vec<usize> = (0..platform.wheels().len())
        .filter(|&i| crate::plant::command_signal(&platform.wheels()[i].drive).is_some())
        .collect();
    let angles = || -> Vec<Port> {
        driven
            .iter()
            .map(|&i| {
                port(
                    format!("{robot}.wheel.{}.spin_angle", platform.wheels()[i].name),
                    "rad",
                )
            })
            .collect()
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
            Box::new(PoseSensor {
                streams: outputs.iter().map(|p| stream(&p.path)).collect(),
                inputs: pose(),
                outputs,
                std: [*position_std, *position_std, *yaw_std],
            })
        }
        Sensor::Encoder {
            resolution,
            angle_std,
            ..
        } => {
            let outputs: Vec<Port> = driven
                .iter()
                .map(|&i| {
                    port(
                        format!("{robot}.sensor.encoder.{}", platform.wheels()[i].name),
                        "rad",
                    )
                })
                .collect();
            Box::new(Encoder {
                streams: outputs.iter().map(|p| stream(&p.path)).collect(),
                inputs: angles(),
                outputs,
                resolution: *resolution,
                std: *angle_std,
            })
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
            let streams = driven
                .iter()
                .map(|&i| stream(&format!("{base}.{}", platform.wheels()[i].name)))
                .collect();
            let reckoning = |method: OdometryMethod, scales: [f64; 2]| Reckoning {
                gain: twist_from_rates(platform, &driven, scales[0], scales[1]),
                method,
                pose: start,
            };
            let believed = [*radius_scale, *track_scale];
            Box::new(Odometry {
                inputs,
                outputs,
                streams,
                resolution: *resolution,
                std: *angle_std,
                readings: vec![0.0; driven.len()],
                believed: reckoning(*method, believed),
                causes: causes.then(|| Causes {
                    angles: vec![0.0; driven.len()],
                    chain: [
                        reckoning(OdometryMethod::Arc, [1.0; 2]),
                        reckoning(*method, [1.0; 2]),
                        reckoning(*method, believed),
                    ],
                }),
            })
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
            ];
            Box::new(MotionSensor {
                inputs,
                outputs: outputs
                    .map(|(what, unit)| port(format!("{robot}.sensor.motion.{what}"), unit))
                    .to_vec(),
                radii: [*straight_radius, *spot_radius],
                last: [0.0, 0.0, start[0], start[1]],
            })
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
            Box::new(RangeBearing {
                streams: beacons
                    .iter()
                    .map(|b| stream(&format!("{robot}.sensor.beacon.{}", b.name)))
                    .collect(),
                inputs: pose(),
                outputs,
                beacons: beacons.iter().map(|b| b.position).collect(),
                range_max: *range_max,
                half_view: 0.5 * view_deg.to_radians(),
                std: [*range_std, *bearing_std],
                last: vec![[0.0; 2]; beacons.len()],
            })
        }
    }
}

/// The platform with wheels `radius_scale` times as large on a track `track_scale` times as wide.
///
/// # Errors
/// Its wheels may be locked: axles that met in one point need not do so any more.
pub fn believed(
    platform: &Platform<f64>,
    radius_scale: f64,
    track_scale: f64,
) -> Result<Platform<f64>, PlatformError> {
    let mut wheels = platform.wheels().to_vec();
    for wheel in &mut wheels {
        wheel.radius *= radius_scale;
        wheel.mount.y *= track_scale;
    }
    Platform::new(*platform.body(), wheels)
}

/// Rows (forward, left, yaw rate) over the driven wheels' rates: least squares, `[eq:kinematic]`,
/// for wheels believed larger by `radius_scale` and a track believed wider by `track_scale`.
fn twist_from_rates(
    platform: &Platform<f64>,
    driven: &[usize],
    radius_scale: f64,
    track_scale: f64,
) -> [Vec<f64>; 3] {
    use appell_model::solve::{MAX_DOF, add_outer, invert, product, zero_row};
    let believed = believed(platform, radius_scale, track_scale)
        .expect("a checked odometry believes in a platform that can move");
    let n = believed.layout().dof();
    let x = crate::build::rest_state(&believed, [0.0; 3], &[]);
    let rows: Vec<_> = driven
        .iter()
        .map(|&i| believed.spin_row(i, &believed.wheel_frame(i, &x)))
        .collect();
    let mut normal = [zero_row::<f64>(); MAX_DOF];
    for row in &rows {
        add_outer(n, &mut normal, 1.0, row, row);
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

fn rounded(angle: f64, resolution: u32) -> f64 {
    if resolution == 0 {
        return angle;
    }
    let step = std::f64::consts::TAU / f64::from(resolution);
    (angle / step).floor() * step
}

struct PoseSensor {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    streams: Vec<Stream>,
    std: [f64; 3],
}

impl Block for PoseSensor {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }
    fn outputs(&self) -> &[Port] {
        &self.outputs
    }
    fn step(
        &mut self,
        tick: u64,
        _t: f64,
        _dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        for k in 0..3 {
            output[k] = input[k];
            if self.std[k] > 0.0 {
                output[k] += self.std[k] * self.streams[k].normals(tick)[0];
            }
        }
        Ok(())
    }
}

struct Encoder {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    streams: Vec<Stream>,
    resolution: u32,
    std: f64,
}

impl Block for Encoder {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }
    fn outputs(&self) -> &[Port] {
        &self.outputs
    }
    fn step(
        &mut self,
        tick: u64,
        _t: f64,
        _dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        for (k, stream) in self.streams.iter().enumerate() {
            let mut angle = input[k];
            if self.std > 0.0 {
                angle += self.std * stream.normals(tick)[0];
            }
            output[k] = rounded(angle, self.resolution);
        }
        Ok(())
    }
}

/// A pose summed from the turning of wheels. `[eq:odometry]`
struct Reckoning {
    gain: [Vec<f64>; 3],
    method: OdometryMethod,
    pose: [f64; 3],
}

impl Reckoning {
    /// Adds the way of a period in which the wheels turned by these angles, rad.
    fn add(&mut self, turned: &[f64]) {
        let mut moved = [0.0; 3];
        for (sum, gain) in moved.iter_mut().zip(&self.gain) {
            for (gain, turned) in gain.iter().zip(turned) {
                *sum += gain * turned;
            }
        }
        let way = vec2(moved[0], moved[1]);
        let (yaw_sin, yaw_cos) = sin_cos(self.pose[2]);
        let step = match self.method {
            OdometryMethod::Unrotated => way,
            OdometryMethod::Euler => way.rotated(yaw_cos, yaw_sin),
            OdometryMethod::Arc => {
                let half = sin_cos(0.5 * moved[2]);
                along_arc(way, moved[2], half).rotated(yaw_cos, yaw_sin)
            }
        };
        self.pose[0] += step.x;
        self.pose[1] += step.y;
        self.pose[2] += moved[2];
    }
}

/// Dead reckoning between two readings.
struct Odometry {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    streams: Vec<Stream>,
    resolution: u32,
    std: f64,
    /// Last reading of each wheel, rad.
    readings: Vec<f64>,
    believed: Reckoning,
    causes: Option<Causes>,
}

/// Odometries that lack one cause of error after the other; the differences between neighbors are
/// the parts of the error.
struct Causes {
    /// Last angle of each wheel, rad.
    angles: Vec<f64>,
    /// From exact angles: with the true geometry along arcs, with the method, with the believed
    /// geometry, too.
    chain: [Reckoning; 3],
}

/// Causes of an odometry's error, in the order in which they come in.
pub(crate) const CAUSES: [&str; 4] = ["slip", "method", "geometry", "encoder"];

impl Block for Odometry {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }
    fn outputs(&self) -> &[Port] {
        &self.outputs
    }
    fn step(
        &mut self,
        tick: u64,
        _t: f64,
        _dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        let count = self.streams.len();
        let mut turned = [0.0; MAX_WHEELS];
        for (k, stream) in self.streams.iter().enumerate() {
            let mut angle = input[k];
            if self.std > 0.0 && tick > 0 {
                angle += self.std * stream.normals(tick)[0];
            }
            let angle = rounded(angle, self.resolution);
            turned[k] = angle - self.readings[k];
            self.readings[k] = angle;
        }
        self.believed.add(&turned[..count]);
        output[..3].copy_from_slice(&self.believed.pose);
        let Some(causes) = &mut self.causes else {
            return Ok(());
        };
        for (k, last) in causes.angles.iter_mut().enumerate() {
            turned[k] = input[k] - *last;
            *last = input[k];
        }
        let mut before = [input[count], input[count + 1], input[count + 2]];
        let total = hypot(
            self.believed.pose[0] - before[0],
            self.believed.pose[1] - before[1],
        );
        for reckoning in &mut causes.chain {
            reckoning.add(&turned[..count]);
        }
        let after = causes.chain.iter().chain(std::iter::once(&self.believed));
        for (part, reckoning) in output[3..].chunks_exact_mut(4).zip(after) {
            for axis in 0..3 {
                part[axis] = reckoning.pose[axis] - before[axis];
            }
            part[3] = hypot(part[0], part[1]);
            before = reckoning.pose;
        }
        output[3 + 4 * CAUSES.len()] = total;
        Ok(())
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
struct MotionSensor {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    /// Radius beyond which motion counts as straight, and below which as turning on the spot, m.
    radii: [f64; 2],
    /// Regime, radius, center: what stays while the robot stands.
    last: [f64; 4],
}

/// Speed, m/s, and yaw rate, rad/s, below which a robot stands.
const STANDS: f64 = 1e-6;

impl Block for MotionSensor {
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
        _dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        let [straight, spot] = self.radii;
        let velocity = vec2(input[3], input[4]);
        let (speed, turn) = (hypot(velocity.x, velocity.y), input[5]);
        if speed < STANDS && turn.abs() < STANDS {
            self.last[0] = 0.0;
            output.copy_from_slice(&self.last);
            return Ok(());
        }
        // Beyond the limit, the center stands at it.
        let is_straight = speed > straight * turn.abs();
        let radius = if is_straight {
            straight.copysign(turn)
        } else {
            speed / turn
        };
        let regime = if is_straight {
            1.0
        } else if radius.abs() > spot {
            2.0
        } else {
            3.0
        };
        // The center lies to the left of the motion, for a positive radius.
        let scale = radius / speed.max(f64::MIN_POSITIVE);
        let (sin, cos) = sin_cos(input[2]);
        let arm = (velocity.perpendicular() * scale).rotated(cos, sin);
        self.last = [regime, radius, input[0] + arm.x, input[1] + arm.y];
        output.copy_from_slice(&self.last);
        Ok(())
    }
    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.last, bytes);
    }
    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        restore_numbers(&mut self.last, bytes)
    }
}

struct RangeBearing {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    streams: Vec<Stream>,
    beacons: Vec<[f64; 2]>,
    range_max: f64,
    half_view: f64,
    std: [f64; 2],
    /// Last reading of each beacon: what stays on the port while it is not seen.
    last: Vec<[f64; 2]>,
}

impl Block for RangeBearing {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }
    fn outputs(&self) -> &[Port] {
        &self.outputs
    }
    fn step(
        &mut self,
        tick: u64,
        _t: f64,
        _dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError> {
        for (k, beacon) in self.beacons.iter().enumerate() {
            let (dx, dy) = (beacon[0] - input[0], beacon[1] - input[1]);
            let range = hypot(dx, dy);
            let bearing = wrap_angle(atan2(dy, dx) - input[2]);
            let visible = range <= self.range_max && bearing.abs() <= self.half_view;
            if visible {
                let [first, second] = self.streams[k].normals(tick);
                self.last[k] = [
                    (range + self.std[0] * first).max(0.0),
                    wrap_angle(bearing + self.std[1] * second),
                ];
            }
            output[3 * k] = self.last[k][0];
            output[3 * k + 1] = self.last[k][1];
            output[3 * k + 2] = f64::from(u8::from(visible));
        }
        Ok(())
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
