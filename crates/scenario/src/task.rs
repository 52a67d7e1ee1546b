//! Tasks: what a robot has to do.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::defaults;

/// What a robot has to do.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Task {
    /// Come to rest near a beacon.
    Homing {
        /// Name of the beacon.
        beacon: String,
        /// Largest distance between the base's origin and the beacon's center, m.
        distance: f64,
        /// Speed below which it counts as stopped, m/s.
        #[serde(default = "defaults::stop_speed")]
        speed: f64,
        /// Time for which it must stay, s.
        #[serde(default = "defaults::one")]
        hold: f64,
    },
    /// Drive between two beacons, once.
    Gate {
        /// Names of the beacons b₁, b₂.
        beacons: [String; 2],
        /// Which way through.
        #[serde(default)]
        direction: Direction,
        /// Distance to drive clear of the gate, m.
        #[serde(default = "defaults::exit")]
        exit: f64,
    },
    /// Drive figure eights round two beacons, back to the start.
    Eight {
        /// Names of the beacons.
        beacons: [String; 2],
        /// Number of eights.
        #[serde(default = "defaults::laps")]
        laps: u32,
        /// Largest gap between end and start, m.
        #[serde(default = "defaults::close")]
        close: f64,
    },
    /// Pass a chain of beacons on alternating sides.
    Slalom {
        /// Names of the beacons, in order.
        chain: Vec<String>,
        /// Side on which the robot passes the first: it drives with the beacon on its other hand.
        #[serde(default)]
        first_side: Side,
        /// Largest distance at which a beacon counts as passed, m.
        #[serde(default = "defaults::offset_max")]
        offset_max: f64,
    },
    /// Follow a path to its end, and never leave it by much.
    Route {
        /// The path of the base's origin.
        path: Route,
        /// Largest distance from the path, m.
        #[serde(default = "defaults::route_tolerance")]
        tolerance: f64,
        /// Distance to the end of the path at which the route is done, m.
        #[serde(default = "defaults::route_end")]
        end: f64,
        /// How often to drive it; more than once needs a closed path.
        #[serde(default = "defaults::laps")]
        laps: u32,
    },
}

impl Task {
    /// Its kind, as the file names it.
    pub fn kind(&self) -> &'static str {
        match self {
            Task::Homing { .. } => "homing",
            Task::Gate { .. } => "gate",
            Task::Eight { .. } => "eight",
            Task::Slalom { .. } => "slalom",
            Task::Route { .. } => "route",
        }
    }
}

/// A path in the arena.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Route {
    /// Lines, arcs and clothoids, each going on where the one before ends.
    Pieces {
        /// Where it starts: x m, y m, heading rad; the robot's start pose if left out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        start: Option<[f64; 3]>,
        /// The pieces.
        piece: Vec<Piece>,
    },
    /// Straight lines from corner to corner, which are rounded by arcs.
    Polyline {
        /// Corners, m.
        points: Vec<[f64; 2]>,
        /// Radius of the arcs, m.
        radius: f64,
        /// Whether it goes back to the first corner; it then begins halfway to the second.
        #[serde(default)]
        closed: bool,
    },
    /// A smooth curve (cubic spline) through points.
    Spline {
        /// Points, m; at least four, or three of a closed one.
        points: Vec<[f64; 2]>,
        /// Whether it goes back to the first point.
        #[serde(default)]
        closed: bool,
    },
    /// A smooth curve through the points of a CSV file, relative to the scenario file.
    File {
        /// The file; a header row names its columns.
        file: String,
        /// Name of the column of x, m.
        #[serde(default = "defaults::x")]
        x: String,
        /// Name of the column of y, m.
        #[serde(default = "defaults::y")]
        y: String,
        /// Whether it goes back to the first point.
        #[serde(default)]
        closed: bool,
    },
}

/// A piece of a route.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Piece {
    /// Straight on.
    Line {
        /// Length, m.
        length: f64,
    },
    /// Part of a circle.
    Arc {
        /// Radius, m.
        radius: f64,
        /// Angle, degrees: positive to the left.
        angle_deg: f64,
    },
    /// A curve whose curvature changes in proportion to the way, as of roads.
    Clothoid {
        /// Length, m.
        length: f64,
        /// Curvature at its start, 1/m, positive to the left; that at the end of the piece before if
        /// left out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from: Option<f64>,
        /// Curvature at its end, 1/m.
        to: f64,
    },
}

/// Which way through a gate b₁, b₂.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// Either way.
    #[default]
    Any,
    /// With b₁ on the left hand.
    FirstLeft,
    /// With b₁ on the right hand.
    FirstRight,
}

/// The side of a beacon on which a robot passes, seen along the chain.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// The first passage decides.
    #[default]
    Any,
    /// The robot passes on the left of the beacon.
    Left,
    /// The robot passes on the right of the beacon.
    Right,
}
