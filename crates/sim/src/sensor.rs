//! Sensors: what a robot knows of its pose, its wheels and the beacons.

use appell_model::kinematic::along_arc;
use appell_model::math::single::{atan2, sin_cos};
use appell_model::math::{hypot, wrap_angle};
use appell_model::planar::vec2;
use appell_model::platform::{Platform, PlatformError};

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
            ..
        } => {
            let outputs: Vec<Port> = [("x", "m"), ("y", "m"), ("yaw", "rad")]
                .map(|(axis, unit)| port(format!("{robot}.sensor.{name}.{axis}"), unit))
                .to_vec();
            let streams = driven
                .iter()
                .map(|&i| {
                    stream(&format!(
                        "{robot}.sensor.{name}.{}",
                        platform.wheels()[i].name
                    ))
                })
                .collect();
            Box::new(Odometry {
                gain: twist_from_rates(platform, &driven, *radius_scale, *track_scale),
                method: *method,
                inputs: angles(),
                outputs,
                streams,
                resolution: *resolution,
                std: *angle_std,
                state: start
                    .iter()
                    .copied()
                    .chain(vec![0.0; driven.len()])
                    .collect(),
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

/// Dead reckoning between two readings. `[eq:odometry]`
struct Odometry {
    method: OdometryMethod,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    gain: [Vec<f64>; 3],
    streams: Vec<Stream>,
    resolution: u32,
    std: f64,
    /// x, y, yaw, then the last reading of each wheel.
    state: Vec<f64>,
}

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
        let mut moved = [0.0; 3];
        for (k, stream) in self.streams.iter().enumerate() {
            let mut angle = input[k];
            if self.std > 0.0 && tick > 0 {
                angle += self.std * stream.normals(tick)[0];
            }
            let angle = rounded(angle, self.resolution);
            let turned = angle - self.state[3 + k];
            self.state[3 + k] = angle;
            for (sum, gain) in moved.iter_mut().zip(&self.gain) {
                *sum += gain[k] * turned;
            }
        }
        let way = vec2(moved[0], moved[1]);
        let (yaw_sin, yaw_cos) = sin_cos(self.state[2]);
        let step = match self.method {
            OdometryMethod::Unrotated => way,
            OdometryMethod::Euler => way.rotated(yaw_cos, yaw_sin),
            OdometryMethod::Arc => {
                let half = sin_cos(0.5 * moved[2]);
                along_arc(way, moved[2], half).rotated(yaw_cos, yaw_sin)
            }
        };
        self.state[0] += step.x;
        self.state[1] += step.y;
        self.state[2] += moved[2];
        output.copy_from_slice(&self.state[..3]);
        Ok(())
    }
    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.state, bytes);
    }
    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        restore_numbers(&mut self.state, bytes)
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
