//! What makes ground uneven, as a scenario file says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A feature of uneven ground; its heights are added to those of the others.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Relief {
    /// A plane through the origin.
    Slope {
        /// Slope, degrees.
        slope_deg: f64,
        /// Heading of the downhill direction on the map, degrees.
        #[serde(default)]
        downhill_heading_deg: f64,
    },
    /// Ground that is higher beyond a line.
    Step {
        /// A point of the line, m.
        at: [f64; 2],
        /// Heading across the line, degrees.
        #[serde(default)]
        heading_deg: f64,
        /// How much higher the ground is beyond, m; below zero it is lower.
        rise: f64,
    },
    /// Ground that rises evenly beyond a line.
    Ramp {
        /// A point of the line where it begins, m.
        at: [f64; 2],
        /// Heading of the ramp, degrees.
        #[serde(default)]
        heading_deg: f64,
        /// How much higher the ground is beyond it, m; below zero it is lower.
        rise: f64,
        /// Length on the map, m.
        length: f64,
    },
    /// A box on the ground, or a pit.
    Block {
        /// Its middle, m.
        at: [f64; 2],
        /// Heading of its length, degrees.
        #[serde(default)]
        heading_deg: f64,
        /// Length along the heading, m.
        length: f64,
        /// Width across it, m.
        width: f64,
        /// Height, m; below zero it is a pit.
        rise: f64,
    },
    /// Corrugation: waves along a heading, the same across it.
    Wave {
        /// Form of a wave.
        form: Form,
        /// A point of the line where they begin, m.
        at: [f64; 2],
        /// Heading along which they follow one another, degrees.
        #[serde(default)]
        heading_deg: f64,
        /// Height of a crest over the middle, m.
        amplitude: f64,
        /// Length of a wave on the map, m.
        period: f64,
        /// Phase where they begin, degrees: at 0 the ground rises there from the middle.
        #[serde(default)]
        phase_deg: f64,
        /// How far they go on, m.
        length: f64,
    },
    /// Heights from a picture (PNG, PGM), a GeoTIFF, or the YAML file of a ROS map.
    Map {
        /// The file, beside the scenario.
        file: String,
        /// Extent from the first pixel to the last along x and y, m; for pictures, in place of
        /// `resolution`.
        #[serde(default)]
        size: Option<[f64; 2]>,
        /// Distance of pixels, m; for pictures, in place of `size`.
        #[serde(default)]
        resolution: Option<f64>,
        /// Height of black in a picture, and of free and unknown cells in a map, m.
        #[serde(default)]
        low: Option<f64>,
        /// Height of white in a picture, and of occupied cells in a map, m.
        #[serde(default)]
        high: Option<f64>,
        /// Place of the pixel with the lowest x and y, m. Without it a georeferenced file stands where
        /// it says, and a picture has that pixel at the origin, the corner of the arena.
        #[serde(default)]
        origin: Option<[f64; 2]>,
    },
    /// Random roughness with the spectrum of ISO 8608.
    Roughness {
        /// Class of the road.
        class: Class,
        /// Shortest wave, m.
        #[serde(default = "defaults::shortest")]
        shortest: f64,
        /// Longest wave, m.
        #[serde(default = "defaults::longest")]
        longest: f64,
        /// Corner of the rough area with the smallest coordinates, m.
        #[serde(default)]
        origin: [f64; 2],
        /// Its extent along x and y, m.
        size: [f64; 2],
        /// Seed of its random numbers: the ground is the same in all trials, unless they vary it.
        #[serde(default)]
        seed: u64,
    },
}

/// Form of a wave.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// Smooth.
    Sine,
    /// Straight between its crests.
    Triangle,
    /// High, then low.
    Square,
}

/// Class of a road after ISO 8608, by its spectral density at 0.1 cycles per metre: from A, a new
/// motorway, each has four times as much as the one before.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
pub enum Class {
    /// 16e-6 m³.
    A,
    /// 64e-6 m³.
    B,
    /// 256e-6 m³.
    C,
    /// 1024e-6 m³.
    D,
    /// 4096e-6 m³.
    E,
    /// 16384e-6 m³.
    F,
    /// 65536e-6 m³.
    G,
    /// 262144e-6 m³.
    H,
}

mod defaults {
    pub fn shortest() -> f64 {
        0.2
    }
    pub fn longest() -> f64 {
        20.0
    }
}
