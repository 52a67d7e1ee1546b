//! A named quantity of a run: what one column of a recording holds.

use serde::{Deserialize, Serialize};

/// Name and unit of one recorded quantity.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Signal {
    /// Dotted path, most significant segment first: `robot.tri.wheel.left.spin_rate`.
    pub path: String,
    /// Unit as written in SI (`rad/s`); `1` for pure numbers, empty when unknown.
    pub unit: String,
}

impl Signal {
    /// A signal called `path`, measured in `unit`.
    pub fn new(path: impl Into<String>, unit: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            unit: unit.into(),
        }
    }
}
