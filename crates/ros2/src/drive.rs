//! The drives of ros2_control: the parameters of `diff_drive_controller` and `mecanum_drive_controller` by their
//! own names, the limits on commands, the wheel rates, and the odometry that they reckon.
//!
//! Formulas and defaults are those of the releases since Jazzy; the older `has_…_limits` are understood.

use std::collections::{BTreeMap, VecDeque};

use appell_model::scalar::Scalar;
use appell_sim::ros::odometry::{Estimate, Reckon, Uncertainty};
use serde::Deserialize;

/// A value of a parameter file.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(untagged)]
enum Value {
    Bool(bool),
    Number(f64),
    Text(String),
    List(Vec<Value>),
    Table(BTreeMap<String, Value>),
    Nothing(()),
}

/// Limits of a velocity, its rate and the rate of that; those that are not set do not hold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    velocity: Option<[f64; 2]>,
    /// Lowest and highest rate of a positive velocity, then of a negative one.
    acceleration: Option<[[f64; 2]; 2]>,
    jerk: Option<[f64; 2]>,
}

impl Limits {
    /// The velocity nearest to `v` that may follow `before`, which followed `earlier`, after `dt` s.
    pub fn hold(&self, v: f64, before: f64, earlier: f64, dt: f64) -> f64 {
        let mut v = v;
        if let Some([low, high]) = self.jerk {
            let (change, last) = (v - before, before - earlier);
            // A change that only gets smaller is not held: that would swing.
            if (change - last) * change > 0.0 {
                let bend = (change - last).clamp(low * dt * dt, high * dt * dt);
                v = before + last + bend;
            }
        }
        if let Some([[brakes, speeds_up], [backs_up, brakes_back]]) = self.acceleration {
            let (low, high) = match before {
                v if v > 0.0 => (brakes, speeds_up),
                v if v < 0.0 => (backs_up, brakes_back),
                _ => (backs_up, speeds_up),
            };
            v = before + (v - before).clamp(low * dt, high * dt);
        }
        if let Some([low, high]) = self.velocity {
            v = v.clamp(low, high);
        }
        v
    }
}

/// How a drive turns twists into wheel rates, and wheel angles into a pose.
#[derive(Clone, Debug, PartialEq)]
pub enum Kinematics {
    /// `diff_drive_controller`.
    Differential {
        /// Wheels of the left and of the right side.
        wheels: [Vec<String>; 2],
        /// Distance between the sides, multiplied, m.
        separation: f64,
        /// Radius of the left and of the right wheels, multiplied, m.
        radius: [f64; 2],
    },
    /// `mecanum_drive_controller`.
    Mecanum {
        /// Front left, front right, rear right, rear left.
        wheels: [String; 4],
        /// Radius of the wheels, m.
        radius: f64,
        /// Half the wheelbase and half the track, together, m.
        reach: f64,
        /// Place and heading of the base in the frame of the wheels' center.
        offset: [f64; 3],
    },
}

/// A drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Name of the controller in its file.
    pub name: String,
    /// What it does with wheels.
    pub kinematics: Kinematics,
    /// Limits of the velocity forward, to the left, and about the vertical.
    pub limits: [Limits; 3],
    /// A command older than this is none, s; none is too old if 0.
    pub timeout: f64,
    /// Readings that the twist of the odometry is the mean of.
    pub window: usize,
    /// Whether odometry is sent as a transform, too.
    pub enable_odom_tf: bool,
    /// Frames.
    pub frames: [String; 2],
    /// Variances of pose and twist, where the file gives some.
    pub covariance: [Option<[f64; 6]>; 2],
}

/// Parameters of one controller, read one by one; what nobody asked for is told.
struct Parameters<'a> {
    table: &'a BTreeMap<String, Value>,
    name: &'a str,
}

impl Parameters<'_> {
    fn find(&self, path: &str) -> Option<&Value> {
        // Names may be nested, or joined by dots.
        if let Some(value) = self.table.get(path) {
            return Some(value);
        }
        let mut table = self.table;
        let mut words = path.split('.').peekable();
        while let Some(word) = words.next() {
            let value = table.get(word)?;
            match (value, words.peek()) {
                (_, None) => return Some(value),
                (Value::Table(inner), Some(_)) => table = inner,
                _ => return None,
            }
        }
        None
    }

    fn wrong(&self, path: &str, rule: &str, got: impl std::fmt::Debug) -> String {
        format!("{}.{path}: must be {rule}, got {got:?}", self.name)
    }

    /// A number; one that is not a number is as good as none, as in ros2_control.
    fn number(&self, path: &str) -> Result<Option<f64>, String> {
        match self.find(path) {
            None => Ok(None),
            Some(Value::Number(value)) if value.is_nan() => Ok(None),
            Some(Value::Number(value)) if value.is_finite() => Ok(Some(*value)),
            Some(other) => Err(self.wrong(path, "a finite number", other)),
        }
    }

    fn positive(&self, path: &str, default: Option<f64>) -> Result<f64, String> {
        match self.number(path)?.or(default) {
            Some(value) if value > 0.0 => Ok(value),
            Some(value) => Err(self.wrong(path, "> 0", value)),
            None => Err(format!("{}.{path}: is missing", self.name)),
        }
    }

    fn flag(&self, path: &str, default: bool) -> Result<bool, String> {
        match self.find(path) {
            None => Ok(default),
            Some(Value::Bool(value)) => Ok(*value),
            Some(other) => Err(self.wrong(path, "true or false", other)),
        }
    }

    fn text(&self, path: &str, default: &str) -> Result<String, String> {
        match self.find(path) {
            None => Ok(default.to_owned()),
            Some(Value::Text(value)) => Ok(value.clone()),
            Some(other) => Err(self.wrong(path, "a text", other)),
        }
    }

    fn texts(&self, path: &str) -> Result<Vec<String>, String> {
        let Some(Value::List(list)) = self.find(path) else {
            return Err(format!(
                "{}.{path}: must be a list of joints, and is missing",
                self.name
            ));
        };
        let text = |value: &Value| match value {
            Value::Text(text) => Ok(text.clone()),
            other => Err(self.wrong(path, "a list of texts", other)),
        };
        list.iter().map(text).collect()
    }

    fn diagonal(&self, path: &str) -> Result<Option<[f64; 6]>, String> {
        let Some(Value::List(list)) = self.find(path) else {
            return Ok(None);
        };
        let numbers: Vec<f64> = list
            .iter()
            .filter_map(|value| match value {
                Value::Number(value) if *value >= 0.0 && value.is_finite() => Some(*value),
                _ => None,
            })
            .collect();
        let diagonal = <[f64; 6]>::try_from(numbers.as_slice());
        let diagonal = diagonal.map_err(|_| self.wrong(path, "six finite numbers >= 0", list))?;
        // Zeros are the default of the controllers, and true of no robot.
        Ok(diagonal
            .iter()
            .any(|value| *value > 0.0)
            .then_some(diagonal))
    }

    fn limits(&self, axis: &str) -> Result<Limits, String> {
        let of = |what: &str| self.number(&format!("{axis}.{what}"));
        let holds = |what: &str| self.flag(&format!("{axis}.has_{what}_limits"), true);
        let pair = |low: Option<f64>, high: Option<f64>, what: &str| match high {
            None => Ok(None),
            Some(high) => match low.unwrap_or(-high) {
                low if low <= high => Ok(Some([low, high])),
                low => Err(self.wrong(&format!("{axis}.min_{what}"), &format!("<= {high}"), low)),
            },
        };
        let mut limits = Limits::default();
        if holds("velocity")? {
            limits.velocity = pair(of("min_velocity")?, of("max_velocity")?, "velocity")?;
        }
        if holds("acceleration")?
            && let Some(speeds_up) = of("max_acceleration")?
        {
            let backs_up = of("max_acceleration_reverse")?.unwrap_or(-speeds_up);
            let brakes = of("max_deceleration")?
                .or(of("min_acceleration")?)
                .unwrap_or(backs_up);
            let brakes_back = of("max_deceleration_reverse")?.unwrap_or(-brakes);
            if brakes > speeds_up || backs_up > brakes_back {
                let got = [[brakes, speeds_up], [backs_up, brakes_back]];
                return Err(self.wrong(
                    &format!("{axis}.max_deceleration"),
                    "below the acceleration",
                    got,
                ));
            }
            limits.acceleration = Some([[brakes, speeds_up], [backs_up, brakes_back]]);
        }
        if holds("jerk")? {
            limits.jerk = pair(of("min_jerk")?, of("max_jerk")?, "jerk")?;
        }
        Ok(limits)
    }

    fn drive(&self) -> Result<Drive, String> {
        let is_mecanum = self.find("kinematics.wheels_radius").is_some();
        let kinematics = match is_mecanum {
            true => {
                let wheel = |place: &str| {
                    let path = format!("{place}_wheel_command_joint_name");
                    match self.text(&path, "")? {
                        name if name.is_empty() => Err(format!("{}.{path}: is missing", self.name)),
                        name => Ok(name),
                    }
                };
                let offset = |axis: &str| {
                    self.number(&format!("kinematics.base_frame_offset.{axis}"))
                        .map(|value| value.unwrap_or(0.0))
                };
                Kinematics::Mecanum {
                    wheels: [
                        wheel("front_left")?,
                        wheel("front_right")?,
                        wheel("rear_right")?,
                        wheel("rear_left")?,
                    ],
                    radius: self.positive("kinematics.wheels_radius", None)?,
                    reach: self.positive(
                        "kinematics.sum_of_robot_center_projection_on_X_Y_axis",
                        None,
                    )?,
                    offset: [offset("x")?, offset("y")?, offset("theta")?],
                }
            }
            false => {
                let [left, right] = [
                    self.texts("left_wheel_names")?,
                    self.texts("right_wheel_names")?,
                ];
                if left.is_empty() || left.len() != right.len() {
                    return Err(format!(
                        "{}.right_wheel_names: must be as many as on the left, 1 or more, got {} and {}",
                        self.name,
                        left.len(),
                        right.len()
                    ));
                }
                let radius = self.positive("wheel_radius", None)?;
                Kinematics::Differential {
                    wheels: [left, right],
                    separation: self.positive("wheel_separation", None)?
                        * self.positive("wheel_separation_multiplier", Some(1.0))?,
                    radius: [
                        radius * self.positive("left_wheel_radius_multiplier", Some(1.0))?,
                        radius * self.positive("right_wheel_radius_multiplier", Some(1.0))?,
                    ],
                }
            }
        };
        if self.flag("open_loop", false)? {
            return Err(self.wrong(
                "open_loop",
                "false: odometry is summed from wheels here",
                true,
            ));
        }
        let (timeout, default) = match is_mecanum {
            true => ("reference_timeout", 0.0),
            false => ("cmd_vel_timeout", 0.5),
        };
        let age = self.number(timeout)?.unwrap_or(default);
        if age < 0.0 {
            return Err(self.wrong(timeout, ">= 0 s", age));
        }
        let window = match self.number("velocity_rolling_window_size")? {
            None => 10.0,
            Some(size) if (1.0..=1e4).contains(&size) && size.fract() == 0.0 => size,
            Some(size) => {
                return Err(self.wrong(
                    "velocity_rolling_window_size",
                    "a whole number in [1, 10000]",
                    size,
                ));
            }
        };
        Ok(Drive {
            name: self.name.to_owned(),
            kinematics,
            limits: [
                self.limits("linear.x")?,
                self.limits("linear.y")?,
                self.limits("angular.z")?,
            ],
            timeout: age,
            window: if is_mecanum { 1 } else { window as usize },
            enable_odom_tf: self.flag("enable_odom_tf", true)?,
            frames: [
                self.text("odom_frame_id", "odom")?,
                self.text("base_frame_id", "base_link")?,
            ],
            covariance: [
                self.diagonal("pose_covariance_diagonal")?,
                self.diagonal("twist_covariance_diagonal")?,
            ],
        })
    }
}

/// Reads the drives of a parameter file.
///
/// # Errors
/// It is no such file, has no drive, or a parameter breaks its rule.
pub fn read(text: &str) -> Result<Vec<Drive>, String> {
    // As ROS reads them: `.nan` is a number that is none, and `y` is an axis.
    let options = serde_saphyr::options! {
        non_finite_float_policy: serde_saphyr::options::NonFiniteFloatPolicy::PassThrough,
        strict_booleans: true,
    };
    let file: BTreeMap<String, Value> =
        serde_saphyr::from_str_with_options(text, options).map_err(|error| error.to_string())?;
    let mut drives = Vec::new();
    // Nodes stand at the top, or below a namespace.
    let mut open: Vec<(String, &Value)> = file.iter().map(|(name, v)| (name.clone(), v)).collect();
    open.reverse();
    while let Some((name, value)) = open.pop() {
        let Value::Table(table) = value else {
            continue;
        };
        match table.get("ros__parameters") {
            Some(Value::Table(own)) => {
                let parameters = Parameters {
                    table: own,
                    name: &name,
                };
                let is_drive = [
                    "wheel_separation",
                    "wheel_radius",
                    "kinematics.wheels_radius",
                ];
                if is_drive.iter().any(|path| parameters.find(path).is_some()) {
                    drives.push(parameters.drive()?);
                }
            }
            _ => open.extend(
                table
                    .iter()
                    .rev()
                    .map(|(inner, v)| (format!("{name}/{inner}"), v)),
            ),
        }
    }
    match drives.is_empty() {
        true => Err("must have a controller with wheel_separation and wheel_radius, or kinematics.wheels_radius, \
                     below ros__parameters; got none"
            .to_owned()),
        false => Ok(drives),
    }
}

impl Drive {
    /// Its wheels, in the order of their rates.
    pub fn wheels(&self) -> Vec<String> {
        match &self.kinematics {
            Kinematics::Differential { wheels, .. } => wheels.concat(),
            Kinematics::Mecanum { wheels, .. } => wheels.to_vec(),
        }
    }

    /// Wheel rates of a twist (forward, left, yaw rate), rad/s.
    pub fn rates(&self, [forward, left, turn]: [f64; 3]) -> Vec<f64> {
        match &self.kinematics {
            Kinematics::Differential {
                wheels,
                separation,
                radius,
            } => {
                let aside = 0.5 * turn * separation;
                let each = [(forward - aside) / radius[0], (forward + aside) / radius[1]];
                let of = |side: usize| std::iter::repeat_n(each[side], wheels[side].len());
                of(0).chain(of(1)).collect()
            }
            Kinematics::Mecanum {
                radius,
                reach,
                offset: [x, y, theta],
                ..
            } => {
                // The twist of the wheels' center.
                let (sin, cos) = Scalar::sin_cos(*theta);
                let (vx, vy) = (cos * forward - sin * left, sin * forward + cos * left);
                let (vx, vy) = (vx + y * turn, vy - x * turn);
                let around = reach * turn;
                [
                    vx - vy - around,
                    vx + vy + around,
                    vx - vy + around,
                    vx + vy - around,
                ]
                .map(|speed| speed / radius)
                .to_vec()
            }
        }
    }

    /// Way (forward, left, turn) per angle of each wheel.
    pub fn gain(&self) -> [Vec<f64>; 3] {
        match &self.kinematics {
            Kinematics::Differential {
                wheels,
                separation,
                radius,
            } => {
                let n = wheels[0].len();
                let [l, r] = radius.map(|radius| radius / n as f64);
                let both = |l: f64, r: f64| [vec![l; n], vec![r; n]].concat();
                [
                    both(0.5 * l, 0.5 * r),
                    vec![0.0; 2 * n],
                    both(-l / separation, r / separation),
                ]
            }
            Kinematics::Mecanum {
                radius,
                reach,
                offset: [x, y, theta],
                ..
            } => {
                let quarter = 0.25 * radius;
                let turn = [-1.0, 1.0, 1.0, -1.0].map(|sign| sign * quarter / reach);
                let (sin, cos) = Scalar::sin_cos(*theta);
                let mut gain = [const { Vec::new() }; 3];
                for (k, sign) in [-1.0, 1.0, -1.0, 1.0].into_iter().enumerate() {
                    let (vx, vy) = (quarter - y * turn[k], sign * quarter + x * turn[k]);
                    gain[0].push(cos * vx + sin * vy);
                    gain[1].push(cos * vy - sin * vx);
                    gain[2].push(turn[k]);
                }
                gain
            }
        }
    }
}

/// The odometry of a drive.
pub struct Odometer {
    drive: Drive,
    gain: [Vec<f64>; 3],
    estimate: Estimate,
    uncertainty: Uncertainty,
    before: Vec<f64>,
    recent: VecDeque<[f64; 3]>,
}

impl Odometer {
    /// At rest at the origin. Readings have this variance, rad².
    pub fn new(drive: &Drive, variance: f64) -> Self {
        let gain = drive.gain();
        Odometer {
            uncertainty: Uncertainty::new(gain.clone(), variance, variance),
            gain,
            drive: drive.clone(),
            estimate: Estimate::default(),
            before: Vec::new(),
            recent: VecDeque::new(),
        }
    }
}

impl Reckon for Odometer {
    fn wheels(&self) -> Vec<String> {
        self.drive.wheels()
    }

    fn read(&mut self, angles: &[f64], dt: f64) -> Estimate {
        let before = std::mem::replace(&mut self.before, angles.to_vec());
        // Too short to tell a speed, as in ros2_control; and the first reading is what others are counted from.
        if before.is_empty() || dt < 1e-4 {
            return self.estimate;
        }
        let moved = [0, 1, 2].map(|axis: usize| {
            let parts = self.gain[axis].iter().zip(angles.iter().zip(&before));
            parts
                .map(|(gain, (now, last))| gain * (now - last))
                .sum::<f64>()
        });
        let [x, y, yaw] = self.estimate.pose;
        self.uncertainty.advance(yaw, moved);
        let [ahead, aside, turn] = moved;
        self.estimate.pose = match &self.drive.kinematics {
            Kinematics::Differential { .. } if turn.abs() < 1e-6 => {
                let (sin, cos) = Scalar::sin_cos(yaw + 0.5 * turn);
                [x + ahead * cos, y + ahead * sin, yaw + turn]
            }
            Kinematics::Differential { .. } => {
                let after = yaw + turn;
                let ((s0, c0), (s1, c1)) = (Scalar::sin_cos(yaw), Scalar::sin_cos(after));
                let radius = ahead / turn;
                [x + radius * (s1 - s0), y - radius * (c1 - c0), after]
            }
            Kinematics::Mecanum { .. } => {
                // It turns first, and then goes straight on.
                let after = yaw + turn;
                let (sin, cos) = Scalar::sin_cos(after);
                [
                    x + cos * ahead - sin * aside,
                    y + sin * ahead + cos * aside,
                    after,
                ]
            }
        };
        self.recent.push_back(moved.map(|part| part / dt));
        if self.recent.len() > self.drive.window {
            self.recent.pop_front();
        }
        let count = self.recent.len() as f64;
        self.estimate.twist =
            [0, 1, 2].map(|axis| self.recent.iter().map(|twist| twist[axis]).sum::<f64>() / count);
        let planar = |diagonal: [f64; 6]| {
            let mut covariance = [[0.0; 3]; 3];
            for (k, axis) in [0, 1, 5].into_iter().enumerate() {
                covariance[k][k] = diagonal[axis];
            }
            covariance
        };
        let [pose, twist] = self.drive.covariance;
        self.estimate.pose_covariance = pose.map_or_else(|| self.uncertainty.pose(), planar);
        // The mean of a window tells the way between its ends.
        let span = dt * count;
        self.estimate.twist_covariance = twist.map_or_else(|| self.uncertainty.twist(span), planar);
        self.estimate
    }
}
