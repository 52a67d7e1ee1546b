//! The scenario file: what people write. Plain data, read strictly; the rules that types cannot say
//! are the simulator's, which knows what can be built from it ([`Draft::judged`]).
//!
//! The doc comments of these types are the reference manual: the JSON Schema and the book's tables
//! are made from them. Units are SI unless the key says otherwise.

mod batch;
mod control;
mod diagnostic;
mod read;
mod relief;
mod robot;
mod task;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use batch::{Batch, Draw, Precision, Sampling, Variant, Vary};
pub use control::{
    Change, Channel, Controller, FIRST, FIRST_MODEL, Follower, Heading, Law, Model, OnFailure,
    Plugin, PoseSource, STANDBY_MAX, Signal, Standby, Swap,
};
pub use diagnostic::{Diagnostic, Diagnostics};
pub use read::{Draft, Loaded, Overrides, Problems, RobotDraft, Template, number_text};
pub use relief::{Class, Form, Relief};
pub use robot::{Body, Drive, Friction, Platform, Rim, Steering, TRAILER, Tire, Trailer, Wheel};
pub use task::{Direction, Piece, Route, Side, Task};

/// Version of the scenario format that this program reads.
pub const SCHEMA: u32 = 1;

/// A scenario: an arena, robots in it, what each has to do, and what is recorded.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Version of this format; 1.
    pub schema: u32,
    /// Short name, used for the output folder: letters, digits, `-` and `_`.
    pub name: String,
    /// One line for people; the report's heading.
    #[serde(default)]
    pub title: String,
    /// Seed of all random numbers. A stream is keyed by (seed, trial, signal), so that one more
    /// sensor changes no other.
    #[serde(default)]
    pub seed: u64,
    /// Number of the trial whose random numbers a run has: that of a batch which it repeats.
    #[serde(default, skip_serializing_if = "defaults::is_first")]
    pub trial: u64,
    /// Step, duration and integrator.
    pub time: Time,
    /// The arena and its beacons.
    pub arena: Arena,
    /// The ground; flat if left out.
    #[serde(default)]
    pub terrain: Terrain,
    /// The robots, one or more.
    pub robot: Vec<Robot>,
    /// What is written, and how often.
    #[serde(default)]
    pub record: Record,
    /// Controllers that take over while the run goes on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub swap: Vec<Swap>,
    /// Numbers that change while the run goes on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub change: Vec<Change>,
    /// Tables of how far robots are apart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub statistics: Option<Statistics>,
    /// Many trials: what `appell batch` runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub batch: Option<Batch>,
}

impl Scenario {
    /// The scenario as TOML: enough to run it again.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a scenario is plain data")
    }
}

/// Tables of mean and standard deviation, over the recorded rows, of the differences between robots.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Signals, as paths below `robot.<name>.`; both robots must have them.
    pub signals: Vec<String>,
    /// Digits after the point in the printed tables.
    #[serde(default = "defaults::decimals")]
    pub decimals: u32,
    /// The tables.
    pub difference: Vec<Difference>,
    /// Tables of how many times larger one difference is than another.
    #[serde(default)]
    pub ratio: Vec<Ratio>,
}

/// A table of differences: the signals of one robot less those of another.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Difference {
    /// Name, unique among the differences.
    pub name: String,
    /// Name of the robot.
    pub of: String,
    /// Name of the robot whose signals are taken off.
    pub minus: String,
}

/// A table of one difference's figures divided by another's.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Ratio {
    /// Name.
    pub name: String,
    /// Name of the difference that is divided.
    pub of: String,
    /// Name of the difference that divides.
    pub by: String,
    /// Signals, of those of the tables.
    pub signals: Vec<String>,
}

/// Time: the step of the physics, the length of the run and the method.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Step of the physics, s. All periods are multiples of it.
    #[serde(default = "defaults::step")]
    pub step: f64,
    /// Longest duration of the run, s; a task that has not been passed by then has failed.
    pub duration: f64,
    /// Method of integration.
    #[serde(default)]
    pub integrator: Integrator,
    /// Relative tolerance of the adaptive integrator.
    #[serde(default = "defaults::tolerance")]
    pub tolerance: f64,
}

/// Methods of integration.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Integrator {
    /// Runge–Kutta 4 where it is accurate at this step, else the exponential method; where the
    /// geometry of the wheels changes and the step is too long for Runge–Kutta, the adaptive one.
    #[default]
    Auto,
    /// Runge–Kutta 4 at the fixed step; refused where it would be unstable.
    Rk4,
    /// Exponential midpoint: exact for the linear part of motors, however small L/R.
    Exponential,
    /// Tsitouras 5(4) with error control; finds the instants at which wheels stop or let go.
    Adaptive,
}

/// The arena: the rectangle [0, W] × [0, H] and its beacons.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Arena {
    /// Width and height, m.
    pub size: [f64; 2],
    /// 1 to 15 beacons.
    pub beacon: Vec<Beacon>,
}

/// A beacon: a post that robots find, pass and must not touch.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Beacon {
    /// Name, unique in the arena.
    pub name: String,
    /// Center, m.
    pub position: [f64; 2],
    /// Radius, m.
    #[serde(default = "defaults::beacon_radius")]
    pub radius: f64,
}

/// The ground.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Terrain {
    /// A level floor.
    Flat {
        /// Gravity, m/s².
        #[serde(default = "defaults::gravity")]
        gravity: f64,
        /// Coefficient of friction between wheels and ground: at level `slip` in place of the tires'
        /// own, at level `rolling` to judge the contact forces by.
        #[serde(default)]
        friction: Option<f64>,
        /// Parts of the ground with a friction of their own, for level `slip`.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        patch: Vec<Patch>,
    },
    /// An inclined plane; the arena lies in it.
    Plane {
        /// Slope, degrees.
        slope_deg: f64,
        /// Heading of the downhill direction in the arena, degrees.
        #[serde(default)]
        downhill_heading_deg: f64,
        /// Gravity, m/s².
        #[serde(default = "defaults::gravity")]
        gravity: f64,
        /// Coefficient of friction between wheels and ground: at level `slip` in place of the tires'
        /// own, at level `rolling` to judge the contact forces by.
        #[serde(default)]
        friction: Option<f64>,
        /// Parts of the ground with a friction of their own, for level `slip`.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        patch: Vec<Patch>,
    },
    /// Ground with hills, steps and grooves; the arena is the map beneath it.
    Uneven {
        /// Gravity, m/s².
        #[serde(default = "defaults::gravity")]
        gravity: f64,
        /// Coefficient of friction between wheels and ground: at level `slip` in place of the tires'
        /// own, at level `rolling` to judge the contact forces by.
        #[serde(default)]
        friction: Option<f64>,
        /// Parts of the ground with a friction of their own, for level `slip`.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        patch: Vec<Patch>,
        /// What makes it uneven; the heights of all are added.
        #[serde(default)]
        relief: Vec<Relief>,
    },
}

/// A rectangle of the ground with a friction coefficient of its own. Of patches that overlap the last
/// counts.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Patch {
    /// Its corner with the smallest coordinates, m.
    pub low: [f64; 2],
    /// Its corner with the largest coordinates, m.
    pub high: [f64; 2],
    /// Coefficient of friction.
    pub friction: f64,
}

impl Terrain {
    /// Gravity, m/s².
    pub fn gravity(&self) -> f64 {
        match self {
            Terrain::Flat { gravity, .. }
            | Terrain::Plane { gravity, .. }
            | Terrain::Uneven { gravity, .. } => *gravity,
        }
    }

    /// Coefficient of friction of all of it.
    pub fn friction(&self) -> Option<f64> {
        match self {
            Terrain::Flat { friction, .. }
            | Terrain::Plane { friction, .. }
            | Terrain::Uneven { friction, .. } => *friction,
        }
    }

    /// Its patches.
    pub fn patches(&self) -> &[Patch] {
        match self {
            Terrain::Flat { patch, .. }
            | Terrain::Plane { patch, .. }
            | Terrain::Uneven { patch, .. } => patch,
        }
    }

    /// What makes it uneven.
    pub fn relief(&self) -> &[Relief] {
        match self {
            Terrain::Flat { .. } | Terrain::Plane { .. } => &[],
            Terrain::Uneven { relief, .. } => relief,
        }
    }
}

impl Default for Terrain {
    fn default() -> Self {
        Terrain::Flat {
            gravity: defaults::gravity(),
            friction: None,
            patch: Vec::new(),
        }
    }
}

/// Level of the model.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// Wheels turn as commanded and roll: the rates command the motion.
    Kinematic,
    /// Masses, inertias and forces under ideal rolling.
    Rolling,
    /// Wheels that may slip: each draws its forces by its tire.
    Slip,
}

/// Which drives move the robot at levels `rolling` and `slip`.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriveChoice {
    /// The drives of the robot file.
    AsBuilt,
    /// Ideal torque sources with the largest torque that the drives of the file can give.
    Torque,
    /// The DC motors of the robot file; refused where it has none.
    DcMotor,
}

/// A robot in the arena.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Name, unique in the scenario.
    pub name: String,
    /// Number of robots of this kind, NAME-0, NAME-1 and so on, for `appell run`: they share the clock
    /// and the recording, which has the motion of each. Robot k has the noise of trial k of a batch,
    /// and leaves the run with its own verdict.
    #[serde(
        default = "defaults::count",
        skip_serializing_if = "defaults::is_count"
    )]
    pub count: u64,
    /// Values that are drawn for each robot of a count; paths below the robot, such as
    /// `platform.body.mass` or `pose.0`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub vary: Vec<Vary>,
    /// Robot file, relative to the scenario file; or write the platform inline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// The platform, inline; what a robot file holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub platform: Option<Platform>,
    /// Level of the model.
    #[serde(default = "defaults::level")]
    pub level: Level,
    /// Drives at level `rolling`.
    #[serde(default = "defaults::drive")]
    pub drive: DriveChoice,
    /// Start pose x, y, yaw: m, m, rad.
    pub pose: [f64; 3],
    /// Start twist: forward speed m/s and yaw rate rad/s (level `rolling`).
    #[serde(default)]
    pub twist: [f64; 2],
    /// Sensors.
    #[serde(default)]
    pub sensor: Vec<Sensor>,
    /// What decides; without one the robot is left to itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controller: Option<Controller>,
    /// Controllers that can take over, at a time (`[[swap]]`) or when another fails (`fallback`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub standby: Vec<Standby>,
    /// Models that can take over, at a time (`[[swap]]`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub model: Vec<Model>,
    /// The cascade from twist to wheel rates to drive commands.
    #[serde(default)]
    pub servo: Servo,
    /// What is added to the drives' commands.
    #[serde(default)]
    pub wheel_noise: Vec<WheelNoise>,
    /// What it has to do; without a task the run lasts its whole duration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<Task>,
}

/// Noise on the command of a drive, in the command's unit (rad/s, N·m or V), drawn anew in each
/// period of what commands the drive, the servo or the controller: normal with a mean, or the column of a file. Signal `wheel.<name>.noise`.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct WheelNoise {
    /// Name of the wheel.
    pub wheel: String,
    /// Mean.
    #[serde(default)]
    pub mean: f64,
    /// Standard deviation.
    #[serde(default)]
    pub std: f64,
    /// CSV file, relative to the scenario file, to take it from instead; its first column is time, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Name of the file's column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Name of the random stream; noises of one name and seed are alike, step by step. Its own
    /// signal's path if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stream: Option<String>,
}

/// A sensor; its outputs are signals of the robot.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Sensor {
    /// The true pose, with noise if given: `sensor.pose.x`, `.y`, `.yaw`.
    Pose {
        /// Period, s.
        period: f64,
        /// Standard deviation of x and y, m.
        #[serde(default)]
        position_std: f64,
        /// Standard deviation of yaw, rad.
        #[serde(default)]
        yaw_std: f64,
    },
    /// Angles of the driven wheels: `sensor.encoder.<wheel>`.
    Encoder {
        /// Period, s.
        period: f64,
        /// Steps per turn of the wheel; 0 for no rounding.
        #[serde(default)]
        resolution: u32,
        /// Standard deviation of the angle, rad.
        #[serde(default)]
        angle_std: f64,
    },
    /// Pose summed from the wheels' turning: `sensor.<name>.x`, `.y`, `.yaw`. Starts at the true
    /// pose.
    Odometry {
        /// Period, s.
        period: f64,
        /// Name, so that a robot may have several.
        #[serde(default = "defaults::odometry")]
        name: String,
        /// How the way of a period is summed.
        #[serde(default)]
        method: OdometryMethod,
        /// Steps per turn of the wheel; 0 for no rounding.
        #[serde(default)]
        resolution: u32,
        /// Standard deviation of each measured wheel angle, rad.
        #[serde(default)]
        angle_std: f64,
        /// Factor by which all wheel radii are believed larger than they are.
        #[serde(default = "defaults::one")]
        radius_scale: f64,
        /// Factor by which the track is believed wider than it is.
        #[serde(default = "defaults::one")]
        track_scale: f64,
        /// Whether to tell the error apart by its causes: `sensor.<name>.error.<cause>.x`, `.y`,
        /// `.yaw`, `.distance` of `slip` (what the wheels' turning does not tell), `method` (of
        /// summing), `geometry` (wrong radius or track) and `encoder` (steps and noise); their sum's
        /// `sensor.<name>.error.distance`.
        #[serde(default)]
        causes: bool,
    },
    /// The kind of motion and its center of rotation: `sensor.motion.regime` (0 rest, 1 straight,
    /// 2 arc, 3 on the spot), `.radius` (of the origin's path, positive with the center to the left),
    /// `.center.x`, `.center.y` (in the arena). At rest the last radius and center stay.
    Motion {
        /// Period, s.
        period: f64,
        /// Radius beyond which motion counts as straight, and at which the center then is put, m.
        #[serde(default = "defaults::straight_radius")]
        straight_radius: f64,
        /// Radius below which the robot turns on the spot, m.
        #[serde(default = "defaults::spot_radius")]
        spot_radius: f64,
    },
    /// Range and bearing of each beacon: `sensor.beacon.<name>.range`, `.bearing`, `.visible`.
    RangeBearing {
        /// Period, s.
        period: f64,
        /// Largest range, m.
        range_max: f64,
        /// Full angle of view about the heading, degrees.
        #[serde(default = "defaults::full_view")]
        view_deg: f64,
        /// Standard deviation of the range, m.
        #[serde(default)]
        range_std: f64,
        /// Standard deviation of the bearing, rad.
        #[serde(default)]
        bearing_std: f64,
    },
    /// An inertial unit at the robot's origin: `sensor.imu.yaw_rate`, and what its accelerometers feel, the
    /// ground's push against gravity included: `.forward`, `.left`, `.up`, of a change of velocity the mean over
    /// the last period.
    Imu {
        /// Period, s.
        period: f64,
        /// Noise density of the gyroscope, rad/s/√Hz: the standard deviation of a reading is this over the
        /// root of the period.
        #[serde(default)]
        gyro_noise_density: f64,
        /// Noise density of each accelerometer, m/s²/√Hz.
        #[serde(default)]
        accel_noise_density: f64,
    },
}

/// How odometry sums the way of a period.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum OdometryMethod {
    /// Along the arc of constant rates: exact where they are constant.
    #[default]
    Arc,
    /// Straight on in the direction at the start of the period (Euler), as many programs do.
    Euler,
    /// Along the axes of the robot's start, as if it never turned.
    Unrotated,
}

/// The cascade from a twist to wheel rates and from wheel rates to drive commands.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Servo {
    /// Period, s; that of the controller if left out.
    pub period: Option<f64>,
    /// Bandwidth of the wheel-rate loop, rad/s; a fifth of a step of its period if left out.
    pub bandwidth: Option<f64>,
    /// Time constant of the integral part, s.
    pub integral_time: f64,
    /// Level `kinematic`: correction of a wheel's rate command per error of its rate in the last
    /// period, 1. The commanded rate is the motion there, so that only noise leaves an error.
    pub rate_feedback: f64,
    /// Level `kinematic`: correction of a wheel's rate command per error of its angle, 1/s.
    pub angle_feedback: f64,
}

impl Default for Servo {
    fn default() -> Self {
        Servo {
            period: None,
            bandwidth: None,
            integral_time: 0.15,
            rate_feedback: 0.0,
            angle_feedback: 0.0,
        }
    }
}

/// What is written.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// Period of the recorded rows, s.
    pub period: f64,
    /// Formats, beside the MCAP file that every run writes.
    pub formats: Vec<Format>,
}

impl Default for Record {
    fn default() -> Self {
        Record {
            period: 0.01,
            formats: Vec::new(),
        }
    }
}

/// Formats of a recording.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// Comma-separated values.
    Csv,
    /// Apache Parquet.
    Parquet,
    /// A bag of ROS 2: the folder `ros2`, with standard messages in MCAP.
    Ros2,
}

/// Default values, each named so that the manual can state it.
mod defaults {
    use super::{DriveChoice, Level};

    pub fn count() -> u64 {
        1
    }
    pub fn is_count(count: &u64) -> bool {
        *count == self::count()
    }
    pub fn is_first(trial: &u64) -> bool {
        *trial == 0
    }
    pub fn trials() -> u64 {
        1000
    }
    pub fn step() -> f64 {
        0.001
    }
    pub fn tolerance() -> f64 {
        1e-9
    }
    pub fn beacon_radius() -> f64 {
        0.05
    }
    pub fn steering_rate() -> f64 {
        4.0
    }
    pub fn steering_bandwidth() -> f64 {
        20.0
    }
    pub fn decimals() -> u32 {
        6
    }
    pub fn odometry() -> String {
        "odometry".into()
    }
    pub fn gravity() -> f64 {
        9.81
    }
    pub fn level() -> Level {
        Level::Rolling
    }
    pub fn drive() -> DriveChoice {
        DriveChoice::AsBuilt
    }
    pub fn width() -> f64 {
        0.03
    }
    pub fn friction() -> f64 {
        0.8
    }
    pub fn slip_stiffness() -> f64 {
        15.0
    }
    pub fn relaxation() -> f64 {
        0.02
    }
    pub fn damping() -> f64 {
        0.01
    }
    pub fn rounding() -> f64 {
        0.01
    }
    pub fn stribeck() -> f64 {
        0.1
    }
    pub fn bristle_stiffness() -> f64 {
        1000.0
    }
    pub fn bristle_damping() -> f64 {
        5.0
    }
    pub fn shape() -> f64 {
        1.4
    }
    pub fn one() -> f64 {
        1.0
    }
    pub fn straight_radius() -> f64 {
        100.0
    }
    pub fn spot_radius() -> f64 {
        0.001
    }
    pub fn full_view() -> f64 {
        360.0
    }
    pub fn control_period() -> f64 {
        0.01
    }
    pub fn time_limit() -> f64 {
        1.0
    }
    pub fn memory() -> u64 {
        4096
    }
    pub fn fuel() -> u64 {
        100_000_000
    }
    pub fn speed() -> f64 {
        0.6
    }
    pub fn acceleration() -> f64 {
        0.6
    }
    pub fn yaw_rate() -> f64 {
        2.0
    }
    pub fn yaw_acceleration() -> f64 {
        6.0
    }
    pub fn lookahead() -> f64 {
        0.25
    }
    pub fn stop_speed() -> f64 {
        0.01
    }
    pub fn exit() -> f64 {
        0.5
    }
    pub fn laps() -> u32 {
        1
    }
    pub fn close() -> f64 {
        0.3
    }
    pub fn offset_max() -> f64 {
        1.2
    }
    pub fn route_tolerance() -> f64 {
        0.1
    }
    pub fn route_end() -> f64 {
        0.05
    }
    pub fn x() -> String {
        "x".into()
    }
    pub fn y() -> String {
        "y".into()
    }
}

/// JSON Schema of scenario files, or of robot files.
pub fn schema(robot: bool) -> String {
    let schema = if robot {
        schemars::schema_for!(Platform)
    } else {
        schemars::schema_for!(Scenario)
    };
    serde_json::to_string_pretty(&schema).expect("a schema is plain data")
}
