//! What decides for a robot: its controllers, and those that take over.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{DriveChoice, Level, Robot, defaults};

/// What decides.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Controller {
    /// Drives to a beacon and stops beside it.
    Homing(Follower),
    /// Drives between two beacons.
    Gate(Follower),
    /// Drives figure eights round two beacons.
    Eight(Follower),
    /// Passes a chain of beacons on alternating sides.
    Slalom(Follower),
    /// Follows the path of a route.
    Route(Follower),
    /// Open loop: a signal of time for each channel.
    Signals {
        /// Period, s.
        #[serde(default = "defaults::control_period")]
        period: f64,
        /// Channels; those not named stay at zero.
        channel: Vec<Channel>,
    },
    /// A plug-in: a controller of your own.
    Plugin(Plugin),
}

impl Controller {
    /// Its kind, as the file names it.
    pub fn kind(&self) -> &'static str {
        match self {
            Controller::Homing(_) => "homing",
            Controller::Gate(_) => "gate",
            Controller::Eight(_) => "eight",
            Controller::Slalom(_) => "slalom",
            Controller::Route(_) => "route",
            Controller::Signals { .. } => "signals",
            Controller::Plugin(_) => "plugin",
        }
    }

    /// What it follows its path with, if it follows one.
    pub fn follower(&self) -> Option<&Follower> {
        match self {
            Controller::Homing(follower)
            | Controller::Gate(follower)
            | Controller::Eight(follower)
            | Controller::Slalom(follower)
            | Controller::Route(follower) => Some(follower),
            Controller::Signals { .. } | Controller::Plugin(_) => None,
        }
    }

    /// Its period, s.
    pub fn period(&self) -> f64 {
        match self {
            Controller::Signals { period, .. } => *period,
            Controller::Plugin(plugin) => plugin.period,
            Controller::Homing(follower)
            | Controller::Gate(follower)
            | Controller::Eight(follower)
            | Controller::Slalom(follower)
            | Controller::Route(follower) => follower.period,
        }
    }
}

/// What the first controller of a robot is called among those that stand by.
pub const FIRST: &str = "controller";

/// Most controllers of a robot that stand by.
pub const STANDBY_MAX: usize = 60;

impl Robot {
    /// Its controllers by name: the first one, then those that stand by.
    pub fn controllers(&self) -> impl Iterator<Item = (&str, &Controller)> {
        let first = self.controller.iter().map(|controller| (FIRST, controller));
        let standby = self
            .standby
            .iter()
            .map(|s| (s.name.as_str(), &s.controller));
        first.chain(standby)
    }
}

impl Robot {
    /// Names of its models: the first one, then those that stand by.
    pub fn models(&self) -> impl Iterator<Item = &str> {
        let standby = self.model.iter().map(|model| model.name.as_str());
        std::iter::once(FIRST_MODEL).chain(standby)
    }

    /// Its plug-ins by name, of controllers and of models.
    pub fn plugins(&self) -> impl Iterator<Item = (&str, &Plugin)> {
        let controllers = self
            .controllers()
            .filter_map(|(name, controller)| match controller {
                Controller::Plugin(plugin) => Some((name, plugin)),
                _ => None,
            });
        let models = self.model.iter().filter_map(|model| {
            let plugin = model.plugin.as_ref()?;
            Some((model.name.as_str(), plugin))
        });
        controllers.chain(models)
    }
}

/// A follower of the path of the robot's task: planned among the beacons, or given as a route.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Follower {
    /// Period, s.
    #[serde(default = "defaults::control_period")]
    pub period: f64,
    /// Where it takes its pose from.
    #[serde(default)]
    pub pose: PoseSource,
    /// Largest speed, m/s.
    #[serde(default = "defaults::speed")]
    pub speed: f64,
    /// Largest acceleration along the path, m/s².
    #[serde(default = "defaults::acceleration")]
    pub acceleration: f64,
    /// Largest acceleration across the path, m/s².
    #[serde(default = "defaults::acceleration")]
    pub lateral_acceleration: f64,
    /// Largest yaw rate, rad/s.
    #[serde(default = "defaults::yaw_rate")]
    pub yaw_rate: f64,
    /// Largest change of the yaw rate, rad/s².
    #[serde(default = "defaults::yaw_acceleration")]
    pub yaw_acceleration: f64,
    /// Distance over which an offset from the path is driven out, m: what each law's gains are made
    /// of.
    #[serde(default = "defaults::lookahead")]
    pub lookahead: f64,
    /// The law by which it keeps to the path.
    #[serde(default)]
    pub law: Law,
    /// Whether it steers by turning, or moves sideways as omnidirectional robots can.
    #[serde(default)]
    pub heading: Heading,
}

/// Laws of path following.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// Curvature of the path, corrected by offset and heading error (Samson 1995).
    #[default]
    Samson,
    /// The arc through a point of the path one lookahead on (Coulter 1992).
    PurePursuit,
    /// Steers as a front wheel one lookahead before the robot's origin would (Hoffmann et al. 2007).
    Stanley,
    /// Tracks a reference that moves along the path in time (Kanayama et al. 1990).
    Kanayama,
    /// The gains that minimize offset, heading error and correction about the path's curvature
    /// (linear-quadratic regulator).
    Lqr,
}

/// How a follower uses the heading.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Heading {
    /// Drives where it points, and steers by turning.
    #[default]
    Steer,
    /// Moves sideways back to the path, while it points along it.
    Along,
    /// Moves along the path without turning: keeps the heading of its start.
    Hold,
}

/// Where a controller takes its pose from.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseSource {
    /// The true pose.
    #[default]
    Truth,
    /// The pose sensor.
    PoseSensor,
    /// The wheel odometry.
    Odometry,
}

/// A channel of the signals controller.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// `wheel.<name>`: command of that drive (rad/s, N·m or V); `brake`: 0 to 1; or
    /// `forward` (m/s), `left` (m/s), `yaw_rate` (rad/s) through the servo.
    pub to: String,
    /// The signal.
    pub signal: Signal,
}

/// A signal of time.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Signal {
    /// What is commanded from outside, by a program that holds the world; 0 until it does, and in runs
    /// and batches.
    External {},
    /// The same value always.
    Constant {
        /// Value.
        value: f64,
    },
    /// One value before an instant, another from it on.
    Step {
        /// Instant, s.
        at: f64,
        /// Value before.
        #[serde(default)]
        before: f64,
        /// Value from then on.
        after: f64,
    },
    /// From one value to another between two instants.
    Ramp {
        /// Start, s.
        from_time: f64,
        /// End, s.
        to_time: f64,
        /// Value until the start.
        #[serde(default)]
        from: f64,
        /// Value from the end on.
        to: f64,
    },
    /// offset + amplitude · sin(2π t / period + phase).
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// Period, s.
        period: f64,
        /// Phase, degrees.
        #[serde(default)]
        phase_deg: f64,
        /// Offset.
        #[serde(default)]
        offset: f64,
    },
    /// offset + amplitude in the first half of each period, offset − amplitude in the second.
    Square {
        /// Amplitude.
        amplitude: f64,
        /// Period, s.
        period: f64,
        /// Phase, degrees.
        #[serde(default)]
        phase_deg: f64,
        /// Offset.
        #[serde(default)]
        offset: f64,
    },
    /// Triangle from offset, rising first.
    Triangle {
        /// Amplitude.
        amplitude: f64,
        /// Period, s.
        period: f64,
        /// Phase, degrees.
        #[serde(default)]
        phase_deg: f64,
        /// Offset.
        #[serde(default)]
        offset: f64,
    },
    /// Rises from offset − amplitude to offset + amplitude in each period.
    Sawtooth {
        /// Amplitude.
        amplitude: f64,
        /// Period, s.
        period: f64,
        /// Phase, degrees.
        #[serde(default)]
        phase_deg: f64,
        /// Offset.
        #[serde(default)]
        offset: f64,
    },
    /// Steps up and down: each value from its time until the next; the first one before, too.
    Stairs {
        /// Times, s, increasing.
        at: Vec<f64>,
        /// Values, one for each time.
        values: Vec<f64>,
    },
    /// Columns of a CSV file, relative to the scenario file: straight lines between its rows, held
    /// outside.
    Table {
        /// The file; its first column is time, s.
        file: String,
        /// Name of the column.
        column: String,
    },
}

/// A controller that stands by.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Standby {
    /// Name, unique in the robot; `controller` is that of the first one.
    pub name: String,
    /// The controller.
    pub controller: Controller,
}

/// What the first model of a robot is called among those that stand by.
pub const FIRST_MODEL: &str = "model";

/// A model that stands by: another level of the same robot, or a model of your own.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Name, unique among the robot's models and controllers; `model` is that of the first one.
    pub name: String,
    /// Level of the model; the robot's if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<Level>,
    /// Drives at level `rolling`; the robot's if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drive: Option<DriveChoice>,
    /// A model of your own instead: it reads commands, and writes pose and twist.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plugin: Option<Plugin>,
}

/// A change of controllers, or of models, at a time. The robot goes on; the new one is told what the old one wrote last.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Swap {
    /// Time, s.
    pub at: f64,
    /// Name of the robot.
    pub robot: String,
    /// Name of the one that takes over: of a controller or model that stands by, or `controller` or
    /// `model` for the first one.
    pub to: String,
}

/// A number of the scenario that is another from a time on, as if somebody had turned a knob. The robots go
/// on from where they are, as fast as they are.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Change {
    /// Time, s.
    pub at: f64,
    /// Path of the number, such as `robot.tri.controller.speed`: of a controller, servo, sensor, body, wheel
    /// or the ground. What a task asks for, and the periods of blocks, stay.
    pub path: String,
    /// The value from then on.
    pub value: f64,
}

/// A controller or model of your own, in a file: a plug-in.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Plugin {
    /// File, relative to the scenario file: a module of WebAssembly (`.wasm`), a Python file (`.py`), a
    /// library with the C interface (`.so`, `.dylib`, `.dll`), an FMU for co-simulation (`.fmu`), or a program
    /// that speaks Appell's messages.
    pub file: String,
    /// Period, s.
    #[serde(default = "defaults::control_period")]
    pub period: f64,
    /// Signals below the robot that its ports stand for, by the port's name, where it calls them otherwise: `{ u =
    /// "pose.x", y = "command.forward" }`, as FMUs do. What has no unit there takes the signal's.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub ports: BTreeMap<String, String>,
    /// Its parameters by name; those not named have its defaults.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
    /// Longest time that a step of a process may take, s of the clock on the wall.
    #[serde(default = "defaults::time_limit")]
    pub time_limit: f64,
    /// Most instructions, about, that a step of a module may take: the same on every machine.
    #[serde(default = "defaults::fuel")]
    pub fuel: u64,
    /// Most memory that it can address, MiB.
    #[serde(default = "defaults::memory")]
    pub memory: u64,
    /// What happens when it fails.
    #[serde(default)]
    pub on_failure: OnFailure,
    /// Name of the one that takes over when it fails, instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fallback: Option<String>,
}

/// What happens when a plug-in fails.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnFailure {
    /// Its commands become zero, so that the robot stops; the run goes on.
    #[default]
    Stop,
    /// The run ends.
    End,
}
