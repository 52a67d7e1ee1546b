//! What a page may ask for, and why it is not done.

use appell_sim::scenario::{Diagnostics, Level};
use serde::{Deserialize, Serialize};

/// Why something was not done.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refusal {
    /// Path of the value, or empty.
    pub path: String,
    /// What is wrong, and what would be right.
    pub problem: String,
    /// A remedy, or empty.
    pub hint: String,
}

impl Refusal {
    /// One without a path.
    pub fn new(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Refusal {
            path: String::new(),
            problem: problem.into(),
            hint: hint.into(),
        }
    }
}

impl From<Diagnostics> for Refusal {
    fn from(diagnostics: Diagnostics) -> Self {
        let first = diagnostics.0.into_iter().next().expect("never empty");
        Refusal {
            path: first.path,
            problem: first.problem,
            hint: first.hint.unwrap_or_default(),
        }
    }
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.path.is_empty() {
            write!(f, "{}: ", self.path)?;
        }
        write!(f, "{}", self.problem)?;
        if !self.hint.is_empty() {
            write!(f, "\n  hint: {}", self.hint)?;
        }
        Ok(())
    }
}

/// What a page asks for. `at` is the instant it looks at, s: before the end of the line a change makes a branch.
/// Changes with one `gesture` are undone together.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Command {
    /// Lets time run.
    Play {},
    /// Holds time.
    Pause {},
    /// Goes on to the next row and holds.
    Step {},
    /// Seconds of the run per second; 0 for as fast as can be.
    Speed {
        /// The factor.
        factor: f64,
    },
    /// Drives the line again from its beginning.
    Restart {},
    /// Sets a number by its path.
    Change {
        /// Path.
        path: String,
        /// Value.
        value: f64,
        /// Instant, s.
        at: Option<f64>,
        /// Gesture.
        gesture: Option<u64>,
    },
    /// Lets another controller or model take over.
    Swap {
        /// Name of the robot.
        robot: String,
        /// Name of what takes over.
        to: String,
        /// Instant, s.
        at: Option<f64>,
    },
    /// Sets values from the beginning, by path, as TOML.
    Edit {
        /// Paths and values.
        set: Vec<(String, String)>,
        /// Gesture.
        gesture: Option<u64>,
    },
    /// Puts a beacon into the arena.
    AddBeacon {
        /// Its place, m.
        position: [f64; 2],
    },
    /// Takes a beacon out of the arena.
    RemoveBeacon {
        /// Its name.
        name: String,
    },
    /// Lets a built-in law, or hands, take over, which the scenario has not named yet.
    Engage {
        /// Name of the robot.
        robot: String,
        /// A law of path following, or `hand`.
        with: String,
        /// Instant, s.
        at: Option<f64>,
    },
    /// Lets a plug-in beside the scenario stand by.
    Load {
        /// Name of the robot.
        robot: String,
        /// Its file.
        file: String,
    },
    /// Takes a plug-in anew from its file, as a version of its own.
    Reload {
        /// Name of the robot.
        robot: String,
        /// Its name among the controllers.
        name: String,
        /// Instant, s.
        at: Option<f64>,
    },
    /// Leaves out a controller that stands by.
    Unload {
        /// Name of the robot.
        robot: String,
        /// Its name.
        name: String,
    },
    /// A new line from an instant of this one on.
    Branch {
        /// The instant, s.
        at: f64,
    },
    /// Takes the last change back.
    Undo {},
    /// Makes it again.
    Redo {},
    /// Lets the same scenario run along at another level, or no longer.
    Ghost {
        /// The level.
        level: Level,
        /// Whether it runs along.
        on: bool,
    },
    /// Goes on with another line.
    Activate {
        /// Its number.
        line: u32,
    },
    /// Leaves a line out.
    Drop {
        /// Its number.
        line: u32,
    },
    /// Drives with the platform of another robot file, from the beginning.
    Platform {
        /// Name of the robot.
        robot: String,
        /// Name of the file in the folder of robots, without extension.
        file: String,
    },
    /// Gives a robot another task, from the beginning: a kind of task among the beacons that stand, or the task
    /// of another scenario of the folder, with its arena.
    Task {
        /// Name of the robot.
        robot: String,
        /// Kind of the task.
        kind: Option<String>,
        /// Name of a scenario that has it.
        of: Option<String>,
    },
    /// Shows a recording beside the lines that there are.
    Beside {
        /// Its name among those that are found.
        recording: String,
    },
    /// Drives a trial of the batch that is open again.
    Trial {
        /// Name of its variant; empty where there are none.
        #[serde(default)]
        variant: String,
        /// Its number.
        trial: u64,
    },
    /// Writes the scenario of the line beside the one that was opened.
    Save {
        /// Name of the file, without extension.
        name: String,
        /// Whether it may replace another.
        #[serde(default)]
        replace: bool,
    },
    /// Opens another scenario of the folder.
    Open {
        /// Its name in the list of scenarios.
        name: String,
    },
}
