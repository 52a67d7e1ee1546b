//! Layout of a beacon task: the arena, its beacons, the start, and the goal.
//!
//! World frame: x to the right, y up, the arena is [0, W] × [0, H]. The robot is a disc round its
//! axle midpoint. The goals are those of the chapter on tasks.

use serde::{Deserialize, Serialize};

use crate::plan::Path;

/// A cylindrical beacon standing in the arena.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beacon {
    /// Name shown in messages, such as `b1`.
    pub name: String,
    /// Center, world frame, m.
    pub position: [f64; 2],
    /// Radius, m.
    pub radius: f64,
}

/// An arena with beacons, and the disc robot that starts in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Layout {
    /// Width and height of the arena, m; a corner is at the origin.
    pub arena: [f64; 2],
    /// All beacons; goals refer to them by index.
    pub beacons: Vec<Beacon>,
    /// Radius of the robot's disc round its axle midpoint, m.
    pub collision_radius: f64,
    /// Start pose x, y, yaw: m, m, rad.
    pub start: [f64; 3],
}

/// What the robot has to do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Goal {
    /// Stop near a beacon and stay there.
    Homing {
        /// Index of the beacon.
        beacon: usize,
        /// Largest distance between axle midpoint and beacon center, m.
        distance: f64,
        /// Largest speed that counts as stopped, m/s.
        speed: f64,
        /// Time to stay stopped, s.
        hold: f64,
    },
    /// Drive once between two beacons.
    Gate {
        /// Indices of the beacons b₁, b₂.
        pair: [usize; 2],
        /// +1: towards Ω(b₂ − b₁), that is with b₁ on the left; −1: the other way; 0: either.
        direction: i8,
        /// Distance to drive beyond the line through the beacons, m.
        exit: f64,
    },
    /// Drive figure eights round two beacons and come back to the start.
    Eight {
        /// Indices of the beacons.
        pair: [usize; 2],
        /// Number of eights.
        laps: u32,
        /// Largest distance between start and end, m.
        close: f64,
    },
    /// Pass a chain of beacons on alternating sides.
    Slalom {
        /// Indices of the beacons in order of passage.
        chain: Vec<usize>,
        /// +1: the first beacon is passed by a robot to its left; −1: to its right; 0: either.
        first_side: i8,
        /// Largest distance from a beacon at its passage, m.
        offset_max: f64,
    },
}

/// A path to be followed to its end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RouteGoal {
    /// The path.
    pub path: Path,
    /// Largest distance from it, m.
    pub tolerance: f64,
    /// Distance to its end at which it is done, m.
    pub end: f64,
}

/// What a robot has to do: a way among beacons that it finds, or a path that it is given.
#[derive(Clone, Debug, PartialEq)]
pub enum Assignment {
    /// A goal among the beacons.
    Beacons(Goal),
    /// A route.
    Route(RouteGoal),
}

impl Goal {
    /// Index of every beacon the goal refers to.
    pub fn beacons(&self) -> &[usize] {
        match self {
            Goal::Homing { beacon, .. } => std::slice::from_ref(beacon),
            Goal::Gate { pair, .. } | Goal::Eight { pair, .. } => pair,
            Goal::Slalom { chain, .. } => chain,
        }
    }

    /// Says why the goal makes no sense in `layout`, if so.
    ///
    /// A goal that passes is safe to hand to [`crate::judge::Judge::new`].
    pub fn fault(&self, layout: &Layout) -> Option<String> {
        let named = self.beacons();
        let count = layout.beacons.len();
        if let Some(index) = named.iter().find(|&&index| index >= count) {
            return Some(format!("beacon index must be below {count}, got {index}"));
        }
        let position = |i: usize| layout.beacons[i].position;
        let same = |i: usize, j: usize| position(i) == position(j);
        match self {
            Goal::Homing { .. } => None,
            Goal::Gate { pair, .. } | Goal::Eight { pair, .. } if same(pair[0], pair[1]) => {
                Some("the two beacons of the pair must be apart, got the same place".into())
            }
            Goal::Gate { .. } => None,
            Goal::Eight { laps, .. } => {
                (*laps == 0).then(|| "number of laps must be at least 1, got 0".into())
            }
            Goal::Slalom { chain, .. } => {
                let last = chain.len().saturating_sub(1);
                let neighbors = |k: usize| (chain[k.saturating_sub(1)], chain[(k + 1).min(last)]);
                if chain.len() < 2 {
                    return Some(format!(
                        "a slalom chain must have at least 2 beacons, got {}",
                        chain.len()
                    ));
                }
                (0..chain.len())
                    .map(neighbors)
                    .find(|&(i, j)| same(i, j))
                    .map(|(i, j)| {
                        let beacons = &layout.beacons;
                        format!(
                            "{} and {} must be apart to give the slalom a direction",
                            beacons[i].name, beacons[j].name
                        )
                    })
            }
        }
    }
}
