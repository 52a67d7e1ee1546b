//! Messages of ROS as plain data, and their definitions: those that robots of a run send and take.
//!
//! Units, axes and meanings are those of REP 103 and REP 105. The fields are written one after the other as
//! they stand here, which is what CDR and the wire of ROS 1 have in common.

use serde::{Deserialize, Serialize};

/// A time: seconds and nanoseconds.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds of the second.
    pub nanosec: u32,
}

impl Time {
    /// The time nearest to `t`, s, which is in [0, 2³¹).
    pub fn of(t: f64) -> Self {
        let nanoseconds = (t * 1e9).round() as u64;
        Time {
            sec: (nanoseconds / 1_000_000_000) as i32,
            nanosec: (nanoseconds % 1_000_000_000) as u32,
        }
    }

    /// The same in seconds.
    pub fn seconds(self) -> f64 {
        f64::from(self.sec) + 1e-9 * f64::from(self.nanosec)
    }
}

/// std_msgs/Header.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Header {
    /// Time of the simulation.
    pub stamp: Time,
    /// Frame that the values are in.
    pub frame_id: String,
}

/// geometry_msgs/Vector3 and geometry_msgs/Point.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Vector3 {
    /// Forward, or east.
    pub x: f64,
    /// Left, or north.
    pub y: f64,
    /// Up.
    pub z: f64,
}

/// geometry_msgs/Quaternion.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }
    }
}

/// geometry_msgs/Pose.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Pose {
    pub position: Vector3,
    pub orientation: Quaternion,
}

/// geometry_msgs/Transform.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Transform {
    pub translation: Vector3,
    pub rotation: Quaternion,
}

/// geometry_msgs/Twist: m/s and rad/s in the frame of the robot.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Twist {
    pub linear: Vector3,
    pub angular: Vector3,
}

/// A covariance of x, y, z and the turns about them, row after row.
pub type Covariance = [[f64; 6]; 6];

/// geometry_msgs/PoseWithCovariance.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct PoseWithCovariance {
    pub pose: Pose,
    pub covariance: Covariance,
}

/// geometry_msgs/TwistWithCovariance.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct TwistWithCovariance {
    pub twist: Twist,
    pub covariance: Covariance,
}

/// geometry_msgs/TwistStamped.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct TwistStamped {
    pub header: Header,
    pub twist: Twist,
}

/// nav_msgs/Odometry: the pose in the frame of the header, the twist in that of the child.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Odometry {
    pub header: Header,
    pub child_frame_id: String,
    pub pose: PoseWithCovariance,
    pub twist: TwistWithCovariance,
}

/// geometry_msgs/TransformStamped.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct TransformStamped {
    pub header: Header,
    pub child_frame_id: String,
    pub transform: Transform,
}

/// tf2_msgs/TFMessage.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Transforms {
    pub transforms: Vec<TransformStamped>,
}

/// sensor_msgs/JointState: rad, rad/s, N·m.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct JointState {
    pub header: Header,
    pub name: Vec<String>,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

/// sensor_msgs/Imu: rad/s, m/s². What the accelerometer feels includes the ground's push against gravity.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Imu {
    pub header: Header,
    pub orientation: Quaternion,
    pub orientation_covariance: [f64; 9],
    pub angular_velocity: Vector3,
    pub angular_velocity_covariance: [f64; 9],
    pub linear_acceleration: Vector3,
    pub linear_acceleration_covariance: [f64; 9],
}

/// rosgraph_msgs/Clock.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Clock {
    pub clock: Time,
}

/// vision_msgs/ObjectHypothesisWithPose.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Hypothesis {
    pub class_id: String,
    pub score: f64,
    pub pose: PoseWithCovariance,
}

/// vision_msgs/Detection3D.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Detection {
    pub header: Header,
    pub results: Vec<Hypothesis>,
    /// Center and size of what was seen.
    pub center: Pose,
    pub size: Vector3,
    pub id: String,
}

/// vision_msgs/Detection3DArray.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Detections {
    pub header: Header,
    pub detections: Vec<Detection>,
}

/// What is sent.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[allow(missing_docs)]
pub enum Message {
    Clock(Clock),
    Odometry(Box<Odometry>),
    Transforms(Transforms),
    JointState(JointState),
    Imu(Box<Imu>),
    Detections(Detections),
    Twist(Twist),
    TwistStamped(TwistStamped),
}

impl Message {
    /// The message as ROS 2 writes it: four bytes that say "CDR, little-endian", then CDR.
    pub fn to_cdr(&self) -> Vec<u8> {
        to_cdr(self)
    }

    /// The time that it tells of, if it says one.
    pub fn stamp(&self) -> Option<Time> {
        match self {
            Message::Clock(clock) => Some(clock.clock),
            Message::Odometry(odometry) => Some(odometry.header.stamp),
            Message::Transforms(all) => all.transforms.first().map(|one| one.header.stamp),
            Message::JointState(joints) => Some(joints.header.stamp),
            Message::Imu(imu) => Some(imu.header.stamp),
            Message::Detections(seen) => Some(seen.header.stamp),
            Message::Twist(_) => None,
            Message::TwistStamped(stamped) => Some(stamped.header.stamp),
        }
    }
}

/// Bytes before CDR that say that it is little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Plain data as ROS 2 writes it.
pub fn to_cdr<T: Serialize>(message: &T) -> Vec<u8> {
    let body = cdr_encoding::to_vec::<T, byteorder::LittleEndian>(message);
    let mut bytes = ENCAPSULATION.to_vec();
    bytes.extend(body.expect("messages are plain data"));
    bytes
}

/// Plain data from what ROS 2 wrote.
///
/// # Errors
/// It is not plain CDR, or too short; a sentence says which.
pub fn from_cdr<T: for<'de> Deserialize<'de>>(bytes: &[u8]) -> Result<T, String> {
    let Some((head, body)) = bytes.split_at_checked(4) else {
        return Err(format!("must be 4 bytes or more, got {}", bytes.len()));
    };
    let read = match head[..2] {
        [0, 1] => cdr_encoding::from_bytes::<T, byteorder::LittleEndian>(body),
        [0, 0] => cdr_encoding::from_bytes::<T, byteorder::BigEndian>(body),
        _ => return Err(format!("must be plain CDR, got representation {head:02x?}")),
    };
    read.map(|(message, _)| message)
        .map_err(|error| format!("is not the message that it is said to be: {error}"))
}

/// Types that are sent or taken, as ROS 2 names them.
pub mod kind {
    #![allow(missing_docs)]
    pub const CLOCK: &str = "rosgraph_msgs/msg/Clock";
    pub const ODOMETRY: &str = "nav_msgs/msg/Odometry";
    pub const TRANSFORMS: &str = "tf2_msgs/msg/TFMessage";
    pub const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
    pub const IMU: &str = "sensor_msgs/msg/Imu";
    pub const DETECTIONS: &str = "vision_msgs/msg/Detection3DArray";
    pub const TWIST: &str = "geometry_msgs/msg/Twist";
    pub const TWIST_STAMPED: &str = "geometry_msgs/msg/TwistStamped";
}

/// Fields of each type. A field's type without a package is of the same package.
const FIELDS: [(&str, &str); 22] = [
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    (
        "std_msgs/Header",
        "builtin_interfaces/Time stamp\nstring frame_id\n",
    ),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    (
        "geometry_msgs/Quaternion",
        "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    ),
    (
        "geometry_msgs/Pose",
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    ),
    (
        "geometry_msgs/Transform",
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    ),
    (
        "geometry_msgs/Twist",
        "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    ),
    (
        "geometry_msgs/PoseWithCovariance",
        "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    ),
    (
        "geometry_msgs/TwistWithCovariance",
        "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    ),
    (
        "geometry_msgs/TwistStamped",
        "std_msgs/Header header\ngeometry_msgs/Twist twist\n",
    ),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    (
        "nav_msgs/Odometry",
        "std_msgs/Header header\nstring child_frame_id\n\
         geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    ),
    (
        "tf2_msgs/TFMessage",
        "geometry_msgs/TransformStamped[] transforms\n",
    ),
    (
        "sensor_msgs/JointState",
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
         float64[] effort\n",
    ),
    (
        "sensor_msgs/Imu",
        "std_msgs/Header header\n\
         geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
         geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
         geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
    ),
    ("rosgraph_msgs/Clock", "builtin_interfaces/Time clock\n"),
    (
        "vision_msgs/ObjectHypothesis",
        "string class_id\nfloat64 score\n",
    ),
    (
        "vision_msgs/ObjectHypothesisWithPose",
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    ),
    (
        "vision_msgs/BoundingBox3D",
        "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    ),
    (
        "vision_msgs/Detection3D",
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n\
         vision_msgs/BoundingBox3D bbox\nstring id\n",
    ),
    (
        "vision_msgs/Detection3DArray",
        "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
    ),
];

fn fields(name: &str) -> Option<&'static str> {
    let found = FIELDS.iter().find(|(known, _)| *known == name);
    found.map(|(_, fields)| *fields)
}

/// The definition of a type (`nav_msgs/msg/Odometry`) with those that it is made of, as recordings of ROS 2
/// hold it.
///
/// # Panics
/// If the type is none of [`kind`].
pub fn definition(type_name: &str) -> String {
    let root = type_name.replace("/msg/", "/");
    let mut text = fields(&root).expect("a type of this module").to_owned();
    let mut told = vec![root];
    let mut next = 0;
    while next < told.len() {
        let body = fields(&told[next]).expect("a type of this module");
        for line in body.lines() {
            let kind = line.split([' ', '[']).next().unwrap_or_default();
            if kind.contains('/') && !told.iter().any(|known| known == kind) {
                let part = fields(kind).expect("a type of this module");
                text += &format!("{}\nMSG: {kind}\n{part}", "=".repeat(80));
                text.push('\n');
                told.push(kind.to_owned());
            }
        }
        next += 1;
    }
    text
}
