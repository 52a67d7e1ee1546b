//! What a wheel-legged robot does about a step or a trench.
//!
//! Feng and Guo (2015), section 1.2. The condition of 1.2.1 is cut off in print and read as "no
//! change of posture up to the wheel radius". All limits belong to the milder strategy.

use core::fmt;

/// Lengths that decide, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Wheel radius R: what a wheel takes by itself.
    pub wheel_radius: f64,
    /// Pitch S₁ between the two wheels of a leg system: what it bridges.
    pub wheel_pitch: f64,
    /// The largest step or depth that the legs manage.
    pub height_max: f64,
}

impl Limits {
    /// The robot of the paper: wheels of 100 mm, 230 mm apart, obstacles up to 250 mm.
    pub const PUBLISHED: Limits = Limits {
        wheel_radius: 0.1,
        wheel_pitch: 0.23,
        height_max: 0.25,
    };

    /// Outer length S₂ of a leg system, m: the pitch and a radius at both ends.
    pub fn outer_length(&self) -> f64 {
        self.wheel_pitch + 2.0 * self.wheel_radius
    }
}

/// What stands or opens in the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Obstacle {
    /// A step up.
    Step {
        /// Its height H, m, ≥ 0.
        height: f64,
    },
    /// A trench across the way.
    Trench {
        /// Its width s along the way, m, ≥ 0.
        width: f64,
        /// Its depth h, m, ≥ 0.
        depth: f64,
    },
}

/// How the robot meets an obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strategy {
    /// Drives on without a change of posture.
    Direct,
    /// Lifts the leg systems onto the step one after the other, Fig. 2.
    ClimbStep,
    /// Drives across, the leg systems held level, Fig. 3.
    BridgeTrench,
    /// Goes down into the trench and climbs out of it, Fig. 4.
    DescendClimb,
    /// Turns away.
    Turn,
}

impl Strategy {
    /// All of them, the mildest first.
    pub const ALL: [Strategy; 5] = [
        Strategy::Direct,
        Strategy::ClimbStep,
        Strategy::BridgeTrench,
        Strategy::DescendClimb,
        Strategy::Turn,
    ];

    /// Its key in files and tables.
    pub fn key(self) -> &'static str {
        match self {
            Strategy::Direct => "direct",
            Strategy::ClimbStep => "climb_step",
            Strategy::BridgeTrench => "bridge_trench",
            Strategy::DescendClimb => "descend_climb",
            Strategy::Turn => "turn",
        }
    }
}

/// The comparison that decided: a length of the obstacle and the limit it was held against, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// A step of this height is no higher than the wheel radius.
    LowStep(f64, f64),
    /// A step of this height is above the wheel radius and no higher than the legs reach.
    StepInReach(f64, f64),
    /// A step of this height is above what the legs reach.
    HighStep(f64, f64),
    /// A trench of this depth is no deeper than the wheel radius.
    ShallowTrench(f64, f64),
    /// A trench of this width is no wider than the wheel pitch; its depth does not matter.
    NarrowTrench(f64, f64),
    /// A trench of this depth is too wide to bridge and no deeper than the legs reach.
    TrenchInReach(f64, f64),
    /// A trench of this depth is too wide to bridge and deeper than the legs reach.
    DeepTrench(f64, f64),
}

/// What to do, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// What to do.
    pub strategy: Strategy,
    /// The comparison that decided.
    pub reason: Reason,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Reason::LowStep(height, limit) => write!(
                f,
                "its height of {height} m is not above the wheel radius of {limit} m"
            ),
            Reason::StepInReach(height, limit) => write!(
                f,
                "its height of {height} m is above the wheel radius, and not above the {limit} m that the legs climb"
            ),
            Reason::HighStep(height, limit) => write!(
                f,
                "its height of {height} m is above the {limit} m that the legs climb"
            ),
            Reason::ShallowTrench(depth, limit) => write!(
                f,
                "its depth of {depth} m is not above the wheel radius of {limit} m"
            ),
            Reason::NarrowTrench(width, limit) => write!(
                f,
                "its width of {width} m is not above the wheel pitch of {limit} m; how deep it is does not matter"
            ),
            Reason::TrenchInReach(depth, limit) => write!(
                f,
                "it is wider than the wheel pitch, and its depth of {depth} m is not above the {limit} m that the legs climb"
            ),
            Reason::DeepTrench(depth, limit) => write!(
                f,
                "it is wider than the wheel pitch, and its depth of {depth} m is above the {limit} m that the legs climb"
            ),
        }
    }
}

/// Chooses the strategy for an obstacle. `[eq:obstacle-strategy]`
pub fn decide(obstacle: &Obstacle, limits: &Limits) -> Decision {
    let (radius, reach) = (limits.wheel_radius, limits.height_max);
    let (strategy, reason) = match *obstacle {
        Obstacle::Step { height } if height <= radius => {
            (Strategy::Direct, Reason::LowStep(height, radius))
        }
        Obstacle::Step { height } if height <= reach => {
            (Strategy::ClimbStep, Reason::StepInReach(height, reach))
        }
        Obstacle::Step { height } => (Strategy::Turn, Reason::HighStep(height, reach)),
        Obstacle::Trench { depth, .. } if depth <= radius => {
            (Strategy::Direct, Reason::ShallowTrench(depth, radius))
        }
        Obstacle::Trench { width, .. } if width <= limits.wheel_pitch => (
            Strategy::BridgeTrench,
            Reason::NarrowTrench(width, limits.wheel_pitch),
        ),
        Obstacle::Trench { depth, .. } if depth <= reach => {
            (Strategy::DescendClimb, Reason::TrenchInReach(depth, reach))
        }
        Obstacle::Trench { depth, .. } => (Strategy::Turn, Reason::DeepTrench(depth, reach)),
    };
    Decision { strategy, reason }
}
