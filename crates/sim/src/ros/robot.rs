//! What one robot says: columns of the row, and the messages that they make.

use appell_model::platform::Platform;
use appell_model::scalar::Scalar;

use crate::build::{self, Values};
use crate::plant::command_signal;
use crate::scenario::{OdometryMethod, Robot, Scenario, Sensor, Steering, Terrain};
use crate::sensor::{believed, twist_from_rates};
use crate::signal::Signal;

use super::message::{
    Covariance, Detection, Detections, Header, Hypothesis, Imu, JointState, Message, Odometry,
    Pose, PoseWithCovariance, Quaternion, Time, Transform, TransformStamped, Twist, TwistStamped,
    TwistWithCovariance, Vector3, kind,
};
use super::odometry::{Estimate, Reckon, Uncertainty, moved, way};
use super::{Service, Topic};

/// What stands where a variance is zero: readers take a covariance of zeros for an unknown one.
const KNOWN: f64 = 1e-12;

/// Where the odometry comes from.
enum Source {
    /// The odometry sensor: x, y, yaw.
    Sensor([usize; 3]),
    /// The wheels: columns of their angles, and the way per angle of each.
    Wheels(Vec<usize>, [Vec<f64>; 3]),
    /// A law of the wheels: columns of their angles.
    Law(Vec<usize>, Box<dyn Reckon>),
    /// The true motion, where wheels that steer tell no twist by themselves.
    Truth,
}

/// A joint: its name, and the columns of angle, rate and torque.
struct Joint {
    name: String,
    position: usize,
    velocity: usize,
    effort: Option<usize>,
}

/// A wheel's frame: where it stands, what its plane turns by, and its spin.
struct WheelFrame {
    name: String,
    mount: [f64; 2],
    radius: f64,
    trail: f64,
    angle: f64,
    steering: Option<usize>,
    spin: usize,
}

struct SeenBeacon {
    name: String,
    radius: f64,
    /// Range, bearing, visible.
    columns: [usize; 3],
}

/// An inertial unit among the sensors: its readings, their variances, and when they come.
struct Inertial {
    /// Yaw rate, and accelerations forward, left and up.
    columns: [usize; 4],
    /// Of the yaw rate, (rad/s)², and of an acceleration, (m/s²)².
    variance: [f64; 2],
    period: f64,
    next: f64,
}

struct Topics {
    odom: usize,
    joint_states: usize,
    imu: usize,
    truth: usize,
    beacons: Option<usize>,
    cmd_vel: usize,
    cmd_vel_stamped: usize,
}

/// One robot.
pub(super) struct Talk {
    /// Before the names of its frames.
    prefix: String,
    /// Names of the frames of its odometry and its base.
    frames: [String; 2],
    /// Whether its odometry is a transform, too.
    has_transform: bool,
    topics: Topics,
    start: [f64; 3],
    pose: [usize; 3],
    twist: [usize; 3],
    command: [Option<usize>; 3],
    joints: Vec<Joint>,
    wheels: Vec<WheelFrame>,
    source: Source,
    /// Names of the driven wheels, and the way per angle of each, where wheels alone tell the twist.
    driven: (Vec<String>, [Vec<f64>; 3]),
    /// Time between two readings of the odometry, s; 0 for every row.
    period: f64,
    uncertainty: Uncertainty,
    /// Variance of a reading, rad².
    readings: f64,
    estimate: Estimate,
    /// Time and angles, or pose, of the last reading.
    last: Option<(f64, Vec<f64>)>,
    beacons: Vec<SeenBeacon>,
    /// Time between two looks at beacons, s, and the time of the next.
    look: (f64, f64),
    /// Standard deviations of range and bearing.
    beacon_std: [f64; 2],
    inertial: Option<Inertial>,
    /// Gravity along the normal of the ground, and down its slope in the arena, m/s².
    gravity: (f64, [f64; 2]),
    /// Time and velocities of the row before.
    before: Option<(f64, [f64; 2])>,
}

fn about_z(angle: f64) -> Quaternion {
    let (z, w) = Scalar::sin_cos(0.5 * angle);
    Quaternion {
        x: 0.0,
        y: 0.0,
        z,
        w,
    }
}

/// First about y, then about z.
fn about_y_then_z(y: f64, z: f64) -> Quaternion {
    let (sin_y, cos_y) = Scalar::sin_cos(0.5 * y);
    let (sin_z, cos_z) = Scalar::sin_cos(0.5 * z);
    Quaternion {
        x: -sin_z * sin_y,
        y: cos_z * sin_y,
        z: sin_z * cos_y,
        w: cos_z * cos_y,
    }
}

fn planar_pose([x, y, yaw]: [f64; 3]) -> Pose {
    Pose {
        position: Vector3 { x, y, z: 0.0 },
        orientation: about_z(yaw),
    }
}

fn planar_twist([forward, left, yaw_rate]: [f64; 3]) -> Twist {
    Twist {
        linear: Vector3 {
            x: forward,
            y: left,
            z: 0.0,
        },
        angular: Vector3 {
            x: 0.0,
            y: 0.0,
            z: yaw_rate,
        },
    }
}

/// A planar covariance among the six; the others are known, for the robot stays on its plane.
fn spatial(planar: [[f64; 3]; 3]) -> Covariance {
    let mut covariance = Covariance::default();
    for (i, row) in covariance.iter_mut().enumerate() {
        row[i] = KNOWN;
    }
    for (i, row) in [0, 1, 5].into_iter().zip(planar) {
        for (j, value) in [0, 1, 5].into_iter().zip(row) {
            covariance[i][j] = if i == j { value.max(KNOWN) } else { value };
        }
    }
    covariance
}

fn known3() -> [f64; 9] {
    [KNOWN, 0.0, 0.0, 0.0, KNOWN, 0.0, 0.0, 0.0, KNOWN]
}

/// Variance of a wheel angle that is read with noise, and rounded down to steps of a turn, rad².
fn variance(std: f64, resolution: u32) -> f64 {
    let step = match resolution {
        0 => 0.0,
        steps => std::f64::consts::TAU / f64::from(steps),
    };
    std * std + step * step / 12.0
}

impl Talk {
    pub(super) fn new(
        scenario: &Scenario,
        robot: &Robot,
        alone: bool,
        signals: &[Signal],
        topics: &mut Vec<Topic>,
    ) -> Self {
        let name = &robot.name;
        let find = |path: String| signals.iter().position(|signal| signal.path == path);
        let maybe = |path: &str| find(format!("robot.{name}.{path}"));
        let at = |path: &str| maybe(path).expect("every model writes pose, twist and wheels");
        let file = robot.platform.as_ref();
        let file = file.expect("a checked scenario has platforms");
        let gravity = build::ground_of::<f64>(&scenario.terrain, &Values::new(&[]));
        let base = format!("robot.{name}.platform");
        let drives = build::drive_model(robot);
        let normal = gravity.gravity_normal;
        let platform: Platform<f64> =
            build::platform_of(file, drives, normal, &base, &Values::new(&[]))
                .expect("a checked platform can be built");

        let known = |wheel: &str| maybe(&format!("wheel.{wheel}.spin_angle")).is_some();
        let mut joints = Vec::new();
        let mut wheels = Vec::new();
        for wheel in file.wheel.iter().filter(|wheel| known(&wheel.name)) {
            let of = |what: &str| format!("wheel.{}.{what}", wheel.name);
            let encoder = maybe(&format!("sensor.encoder.{}", wheel.name));
            let spin = at(&of("spin_angle"));
            let rate = at(&of("spin_rate"));
            joints.push(Joint {
                name: wheel.name.clone(),
                position: encoder.unwrap_or(spin),
                velocity: rate,
                effort: maybe(&of("torque")),
            });
            let steering = maybe(&of("steering_angle"));
            if let (Some(position), Some(velocity)) = (steering, maybe(&of("steering_rate"))) {
                joints.push(Joint {
                    name: format!("{}_steering", wheel.name),
                    position,
                    velocity,
                    effort: None,
                });
            }
            let (angle, trail) = match wheel.steering {
                Steering::Fixed { angle_deg } => (angle_deg.to_radians(), 0.0),
                Steering::Free { trail, .. } => (0.0, trail),
                _ => (0.0, 0.0),
            };
            wheels.push(WheelFrame {
                name: wheel.name.clone(),
                mount: wheel.mount,
                radius: wheel.radius,
                trail,
                angle,
                steering,
                spin,
            });
        }

        let driven: Vec<usize> = (0..platform.wheels().len())
            .filter(|&i| command_signal(&platform.wheels()[i].drive).is_some())
            .collect();
        let steers = { file.wheel.iter() }.any(|wheel| {
            !matches!(
                wheel.steering,
                Steering::Fixed { .. } | Steering::Free { .. }
            )
        });
        let angle_of = |&i: &usize| {
            let wheel = &platform.wheels()[i].name;
            maybe(&format!("sensor.encoder.{wheel}"))
                .or_else(|| maybe(&format!("wheel.{wheel}.spin_angle")))
        };
        let angles: Option<Vec<usize>> = driven.iter().map(angle_of).collect();
        let none = [const { Vec::new() }; 3];
        let gain = match (steers, &angles) {
            (false, Some(_)) if !driven.is_empty() => {
                twist_from_rates(&platform, &driven, 1.0, 1.0)
            }
            _ => none.clone(),
        };
        let mut period = 0.0;
        let mut readings = (0.0, 0.0);
        let mut gained = gain.clone();
        let names = driven.iter().map(|&i| platform.wheels()[i].name.clone());
        let told = (names.collect(), gain.clone());
        let mut source = match (angles, gain[0].is_empty()) {
            (Some(columns), false) => Source::Wheels(columns, gain),
            _ => Source::Truth,
        };
        for sensor in &robot.sensor {
            match sensor {
                Sensor::Encoder {
                    period: each,
                    resolution,
                    angle_std,
                } if matches!(source, Source::Wheels(..)) => {
                    period = *each;
                    let variance = variance(*angle_std, *resolution);
                    readings = (variance, variance);
                }
                Sensor::Odometry {
                    period: each,
                    name: own,
                    method,
                    resolution,
                    angle_std,
                    radius_scale,
                    track_scale,
                    ..
                } if own == "odometry" && *method != OdometryMethod::Unrotated => {
                    period = *each;
                    // It begins with a reading without noise, though rounded.
                    readings = (
                        variance(0.0, *resolution),
                        variance(*angle_std, *resolution),
                    );
                    gained = match believed(&platform, *radius_scale, *track_scale) {
                        Ok(_) if !driven.is_empty() => {
                            twist_from_rates(&platform, &driven, *radius_scale, *track_scale)
                        }
                        _ => none.clone(),
                    };
                    source = Source::Sensor(
                        ["x", "y", "yaw"].map(|axis| at(&format!("sensor.odometry.{axis}"))),
                    );
                    break;
                }
                _ => {}
            }
        }

        let mut beacon_std = [0.0; 2];
        let mut look = 0.0;
        let mut beacons = Vec::new();
        let mut inertial = None;
        for sensor in &robot.sensor {
            if let Sensor::Imu {
                period,
                gyro_noise_density,
                accel_noise_density,
            } = sensor
            {
                inertial = Some(Inertial {
                    columns: ["yaw_rate", "forward", "left", "up"]
                        .map(|what| at(&format!("sensor.imu.{what}"))),
                    variance: [gyro_noise_density, accel_noise_density]
                        .map(|density| density * density / period),
                    period: *period,
                    next: 0.0,
                });
            }
            if let Sensor::RangeBearing {
                period,
                range_std,
                bearing_std,
                ..
            } = sensor
            {
                beacon_std = [*range_std, *bearing_std];
                look = *period;
                for beacon in &scenario.arena.beacon {
                    let columns = ["range", "bearing", "visible"]
                        .map(|what| at(&format!("sensor.beacon.{}.{what}", beacon.name)));
                    beacons.push(SeenBeacon {
                        name: beacon.name.clone(),
                        radius: beacon.radius,
                        columns,
                    });
                }
            }
        }

        let (prefix, base) = match alone {
            true => (String::new(), "/".to_owned()),
            false => (format!("{name}/"), format!("/{name}/")),
        };
        let mut topic = |name: &str, kind, service| {
            topics.push(Topic {
                name: format!("{base}{name}"),
                kind,
                service,
            });
            topics.len() - 1
        };
        let topics = Topics {
            odom: topic("odom", kind::ODOMETRY, Service::Reliable),
            joint_states: topic("joint_states", kind::JOINT_STATE, Service::Reliable),
            imu: topic("imu", kind::IMU, Service::Sensor),
            truth: topic("ground_truth", kind::ODOMETRY, Service::Reliable),
            beacons: (!beacons.is_empty())
                .then(|| topic("beacons", kind::DETECTIONS, Service::Sensor)),
            cmd_vel: topic("cmd_vel", kind::TWIST, Service::Reliable),
            cmd_vel_stamped: topic("cmd_vel_stamped", kind::TWIST_STAMPED, Service::Reliable),
        };
        let downhill = match &scenario.terrain {
            Terrain::Plane {
                slope_deg,
                downhill_heading_deg,
                gravity,
                ..
            } => {
                let (down, _) = Scalar::sin_cos(slope_deg.to_radians());
                let (y, x) = Scalar::sin_cos(downhill_heading_deg.to_radians());
                [gravity * down * x, gravity * down * y]
            }
            _ => [0.0; 2],
        };
        Talk {
            prefix,
            frames: ["odom", "base_link"].map(str::to_owned),
            has_transform: true,
            topics,
            start: robot.pose,
            pose: ["x", "y", "yaw"].map(|axis| at(&format!("pose.{axis}"))),
            twist: ["forward", "left", "yaw_rate"].map(|axis| at(&format!("twist.{axis}"))),
            command: ["forward", "left", "yaw_rate"].map(|axis| maybe(&format!("command.{axis}"))),
            joints,
            wheels,
            source,
            driven: told,
            period,
            uncertainty: Uncertainty::new(gained, readings.0, readings.1),
            readings: readings.1,
            estimate: Estimate::default(),
            last: None,
            beacons,
            look: (look, 0.0),
            beacon_std,
            inertial,
            gravity: (normal, downhill),
            before: None,
        }
    }

    /// Variance of a reading of its wheels, rad²: the encoder's, or none.
    pub(super) fn variance(&self) -> f64 {
        match &self.source {
            Source::Wheels(..) => self.readings,
            _ => 0.0,
        }
    }

    pub(super) fn driven(&self) -> &(Vec<String>, [Vec<f64>; 3]) {
        &self.driven
    }

    /// Names its frames, and says whether its odometry is a transform, too.
    pub(super) fn call_frames(&mut self, frames: &[String; 2], has_transform: bool) {
        self.frames = frames.clone();
        self.has_transform = has_transform;
    }

    /// Sums its odometry by a law from now on, from where it began; the wheel that it has not, if one is asked for.
    pub(super) fn reckon_by(&mut self, law: Box<dyn Reckon>) -> Result<(), String> {
        let mut columns = Vec::new();
        for wheel in law.wheels() {
            let joint = self.joints.iter().find(|joint| joint.name == wheel);
            columns.push(joint.map(|joint| joint.position).ok_or(wheel)?);
        }
        self.source = Source::Law(columns, law);
        self.estimate = Estimate::default();
        self.last = None;
        Ok(())
    }

    fn header(&self, stamp: Time, frame: &str) -> Header {
        let frame_id = match frame {
            "" | "world" => frame.to_owned(),
            "odom" => format!("{}{}", self.prefix, self.frames[0]),
            "base_link" => format!("{}{}", self.prefix, self.frames[1]),
            _ => format!("{}{frame}", self.prefix),
        };
        Header { stamp, frame_id }
    }

    /// Transforms that stay: where the odometry begins.
    pub(super) fn fixed(&self, stamp: Time) -> Vec<TransformStamped> {
        let pose = planar_pose(self.start);
        vec![TransformStamped {
            header: self.header(stamp, "world"),
            child_frame_id: format!("{}{}", self.prefix, self.frames[0]),
            transform: Transform {
                translation: pose.position,
                rotation: pose.orientation,
            },
        }]
    }

    /// Takes the odometry's new reading over, if there is one; true if there was.
    fn reckon(&mut self, t: f64, row: &[f64]) -> bool {
        let due = self.last.as_ref().is_none_or(|(last, _)| {
            // Times are whole ticks: half of one of them is far from any rounding.
            t > *last && t - last > self.period * (1.0 - 1e-6)
        });
        if !due {
            return false;
        }
        let reading: Vec<f64> = match &self.source {
            Source::Sensor(columns) => columns.iter().map(|&column| row[column]).collect(),
            Source::Wheels(columns, _) | Source::Law(columns, _) => {
                columns.iter().map(|&column| row[column]).collect()
            }
            Source::Truth => self.pose.iter().map(|&column| row[column]).collect(),
        };
        if let Source::Law(_, law) = &mut self.source {
            let dt = self.last.as_ref().map_or(0.0, |(last, _)| t - last);
            self.estimate = law.read(&reading, dt);
        } else if let Some((last, before)) = &self.last {
            let dt = t - last;
            let triple = |values: &[f64]| [values[0], values[1], values[2]];
            let ahead = match &self.source {
                Source::Sensor(_) | Source::Truth | Source::Law(..) => {
                    way(triple(before), triple(&reading))
                }
                Source::Wheels(_, gain) => {
                    let turned: Vec<f64> = reading
                        .iter()
                        .zip(before)
                        .map(|(new, old)| new - old)
                        .collect();
                    [0, 1, 2].map(|axis| {
                        gain[axis]
                            .iter()
                            .zip(&turned)
                            .map(|(g, turned)| g * turned)
                            .sum()
                    })
                }
            };
            let estimate = &mut self.estimate;
            self.uncertainty.advance(estimate.pose[2], ahead);
            estimate.pose = moved(estimate.pose, ahead);
            estimate.twist = ahead.map(|part| part / dt);
            estimate.pose_covariance = self.uncertainty.pose();
            estimate.twist_covariance = self.uncertainty.twist(dt);
        }
        self.last = Some((t, reading));
        true
    }

    pub(super) fn say<E>(
        &mut self,
        t: f64,
        row: &[f64],
        transforms: &mut Vec<TransformStamped>,
        say: &mut dyn FnMut(usize, Message) -> Result<(), E>,
    ) -> Result<(), E> {
        let stamp = Time::of(t);
        let values = |columns: [usize; 3]| columns.map(|column| row[column]);
        let base = format!("{}{}", self.prefix, self.frames[1]);
        if self.reckon(t, row) {
            let estimate = &self.estimate;
            let pose = planar_pose(estimate.pose);
            let odometry = Odometry {
                header: self.header(stamp, "odom"),
                child_frame_id: base.clone(),
                pose: PoseWithCovariance {
                    pose,
                    covariance: spatial(estimate.pose_covariance),
                },
                twist: TwistWithCovariance {
                    twist: planar_twist(estimate.twist),
                    covariance: spatial(estimate.twist_covariance),
                },
            };
            say(self.topics.odom, Message::Odometry(Box::new(odometry)))?;
            if self.has_transform {
                transforms.push(TransformStamped {
                    header: self.header(stamp, "odom"),
                    child_frame_id: base.clone(),
                    transform: Transform {
                        translation: pose.position,
                        rotation: pose.orientation,
                    },
                });
            }
        }
        let child = |frame: &str| format!("{}{frame}", self.prefix);
        for wheel in &self.wheels {
            let yaw = wheel.steering.map_or(wheel.angle, |column| row[column]);
            let (sin, cos) = Scalar::sin_cos(yaw);
            transforms.push(TransformStamped {
                header: self.header(stamp, "base_link"),
                child_frame_id: child(&wheel.name),
                transform: Transform {
                    translation: Vector3 {
                        x: wheel.mount[0] - wheel.trail * cos,
                        y: wheel.mount[1] - wheel.trail * sin,
                        z: wheel.radius,
                    },
                    rotation: about_y_then_z(row[wheel.spin], yaw),
                },
            });
        }
        let of = |joint: &dyn Fn(&Joint) -> f64| self.joints.iter().map(joint).collect();
        let has_efforts = self.joints.iter().any(|joint| joint.effort.is_some());
        let joints = JointState {
            header: self.header(stamp, ""),
            name: self.joints.iter().map(|joint| joint.name.clone()).collect(),
            position: of(&|joint| row[joint.position]),
            velocity: of(&|joint| row[joint.velocity]),
            effort: match has_efforts {
                true => of(&|joint| joint.effort.map_or(0.0, |column| row[column])),
                false => Vec::new(),
            },
        };
        say(self.topics.joint_states, Message::JointState(joints))?;

        let truth = values(self.pose);
        let twist = values(self.twist);
        let odometry = Odometry {
            header: self.header(stamp, "world"),
            child_frame_id: base,
            pose: PoseWithCovariance {
                pose: planar_pose(truth),
                covariance: spatial([[0.0; 3]; 3]),
            },
            twist: TwistWithCovariance {
                twist: planar_twist(twist),
                covariance: spatial([[0.0; 3]; 3]),
            },
        };
        say(self.topics.truth, Message::Odometry(Box::new(odometry)))?;

        let imu = match &self.inertial {
            Some(_) => self.measured(t, row),
            None => Some(self.imu(t, truth[2], twist)),
        };
        if let Some(imu) = imu {
            say(self.topics.imu, Message::Imu(Box::new(imu)))?;
        }
        if let Some(topic) = self.topics.beacons
            && t > self.look.1 - 1e-6 * self.look.0
        {
            self.look.1 = t + self.look.0;
            say(topic, Message::Detections(self.detections(stamp, row)))?;
        }
        if self.command.iter().any(Option::is_some) {
            let command = self.command.map(|column| column.map_or(0.0, |k| row[k]));
            let twist = planar_twist(command);
            say(self.topics.cmd_vel, Message::Twist(twist))?;
            let header = self.header(stamp, "base_link");
            let stamped = Message::TwistStamped(TwistStamped { header, twist });
            say(self.topics.cmd_vel_stamped, stamped)?;
        }
        Ok(())
    }

    /// What the inertial unit among the sensors has read, if it has. It knows of no orientation.
    fn measured(&mut self, t: f64, row: &[f64]) -> Option<Imu> {
        let header = self.header(Time::of(t), "base_link");
        let unit = self.inertial.as_mut()?;
        if t <= unit.next - 1e-6 * unit.period {
            return None;
        }
        unit.next = t + unit.period;
        let [yaw_rate, x, y, z] = unit.columns.map(|column| row[column]);
        let [gyro, accel] = unit.variance.map(|variance| variance.max(KNOWN));
        let diagonal = |xy: f64, z: f64| [xy, 0.0, 0.0, 0.0, xy, 0.0, 0.0, 0.0, z];
        let mut unknown = [0.0; 9];
        unknown[0] = -1.0;
        Some(Imu {
            header,
            orientation: Quaternion::default(),
            orientation_covariance: unknown,
            angular_velocity: Vector3 {
                x: 0.0,
                y: 0.0,
                z: yaw_rate,
            },
            angular_velocity_covariance: diagonal(KNOWN, gyro),
            linear_acceleration: Vector3 { x, y, z },
            linear_acceleration_covariance: diagonal(accel, accel),
        })
    }

    /// What an ideal inertial unit at the robot's origin measures. Accelerations are those since the row before.
    fn imu(&mut self, t: f64, yaw: f64, [forward, left, yaw_rate]: [f64; 3]) -> Imu {
        let changed = match self.before {
            Some((last, before)) if t > last => {
                [forward - before[0], left - before[1]].map(|change| change / (t - last))
            }
            _ => [0.0; 2],
        };
        self.before = Some((t, [forward, left]));
        let (normal, [down_x, down_y]) = self.gravity;
        let (sin, cos) = Scalar::sin_cos(yaw);
        Imu {
            header: self.header(Time::of(t), "base_link"),
            orientation: about_z(yaw),
            orientation_covariance: known3(),
            angular_velocity: Vector3 {
                x: 0.0,
                y: 0.0,
                z: yaw_rate,
            },
            angular_velocity_covariance: known3(),
            linear_acceleration: Vector3 {
                x: changed[0] - yaw_rate * left - (cos * down_x + sin * down_y),
                y: changed[1] + yaw_rate * forward - (cos * down_y - sin * down_x),
                z: normal,
            },
            linear_acceleration_covariance: known3(),
        }
    }

    /// The beacons that are seen, in the frame of the robot.
    fn detections(&self, stamp: Time, row: &[f64]) -> Detections {
        let header = self.header(stamp, "base_link");
        let seen = { self.beacons.iter() }.filter(|beacon| row[beacon.columns[2]] > 0.5);
        let detections = seen.map(|beacon| {
            let (range, bearing) = (row[beacon.columns[0]], row[beacon.columns[1]]);
            let (sin, cos) = Scalar::sin_cos(bearing);
            let pose = planar_pose([range * cos, range * sin, 0.0]);
            // Along the ray the range is uncertain, across it the bearing.
            let [along, across] = [self.beacon_std[0], range * self.beacon_std[1]].map(|s| s * s);
            let mut planar = [[0.0; 3]; 3];
            planar[0][0] = cos * cos * along + sin * sin * across;
            planar[1][1] = sin * sin * along + cos * cos * across;
            planar[0][1] = sin * cos * (along - across);
            planar[1][0] = planar[0][1];
            Detection {
                header: header.clone(),
                results: vec![Hypothesis {
                    class_id: "beacon".to_owned(),
                    score: 1.0,
                    pose: PoseWithCovariance {
                        pose,
                        covariance: spatial(planar),
                    },
                }],
                center: pose,
                size: Vector3 {
                    x: 2.0 * beacon.radius,
                    y: 2.0 * beacon.radius,
                    z: 0.0,
                },
                id: beacon.name.clone(),
            }
        });
        Detections {
            detections: detections.collect(),
            header: header.clone(),
        }
    }
}
