//! Batches: what is drawn anew for each of many trials of a scenario.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::defaults;

/// Many trials of the scenario, each with random numbers of its own: `appell batch`.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Batch {
    /// Number of trials.
    #[serde(default = "defaults::trials")]
    pub trials: u64,
    /// How the draws of all trials lie together.
    #[serde(default)]
    pub sampling: Sampling,
    /// Precision of the numbers that a trial is computed with.
    #[serde(default, skip_serializing_if = "Precision::is_double")]
    pub precision: Precision,
    /// Values of the scenario that are drawn for each trial.
    #[serde(default)]
    pub vary: Vec<Vary>,
    /// Variants to be compared: each runs all trials, with the same noise and the same draws. The
    /// first is what the others are compared with.
    #[serde(default)]
    pub variant: Vec<Variant>,
    /// Scenario file, relative to this one, whose figures are marked in the distributions: a
    /// published run, say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark: Option<String>,
}

impl Default for Batch {
    fn default() -> Self {
        Batch {
            trials: defaults::trials(),
            sampling: Sampling::default(),
            precision: Precision::default(),
            vary: Vec::new(),
            variant: Vec::new(),
            mark: None,
        }
    }
}

/// Precision of the numbers that a run is computed with.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Double: sixteen digits.
    #[default]
    F64,
    /// Single: seven digits, and twice as many trials side by side. Not for level `slip`, uneven
    /// ground, adaptive steps, and controllers or models that take turns.
    F32,
}

impl Precision {
    /// Whether it is double precision.
    pub fn is_double(&self) -> bool {
        *self == Precision::F64
    }

    /// Its name in a file.
    pub fn name(&self) -> &'static str {
        match *self {
            Precision::F64 => "f64",
            Precision::F32 => "f32",
        }
    }
}

/// How the draws of all trials lie together. Noise within trials is always random.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// Each by itself.
    #[default]
    Random,
    /// Of each varied value, one draw in each of as many equally likely intervals as there are trials.
    LatinHypercube,
    /// Points of Sobol's sequence, shifted at random: the most even for the first 2, 4, 8, … trials; up
    /// to 21 varied values.
    Sobol,
}

/// A variant of the scenario.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    /// Name, unique among the variants.
    pub name: String,
    /// Values by their paths, as of `--set`: numbers, words, truth values or lists.
    #[schemars(with = "std::collections::BTreeMap<String, serde_json::Value>")]
    pub set: toml::Table,
}

/// A value of the scenario that is drawn for each trial.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Vary {
    /// Path of the value, as of `--set`.
    pub path: String,
    /// How it is drawn.
    pub draw: Draw,
}

/// Ways of drawing a value. The draw is keyed by seed, trial and path: one more varied value changes
/// no other, but for grids, which count together.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Draw {
    /// Normal.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        std: f64,
    },
    /// Uniform in an interval.
    Uniform {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// Uniform in the logarithm.
    LogUniform {
        /// Lower end, above 0.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// One of several values, each as likely.
    Choice {
        /// Values.
        values: Vec<f64>,
    },
    /// Each of several values in turn; several grids make all combinations, the first one fastest.
    Grid {
        /// Values.
        values: Vec<f64>,
    },
}
