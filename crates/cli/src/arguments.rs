//! What can be said on the command line.

use std::path::PathBuf;

use appell_model::wheel_legged::obstacle::Limits;
use appell_sim::uneven::Study;
use clap::{Args, Parser, Subcommand, ValueEnum};

/// A workbench for the motion of wheeled mobile robots.
///
/// One scenario file gives a world: an arena with beacons, robots at a level of model, controllers
/// and tasks. `appell run` drives it and writes a folder with a recording, a summary and a report.
#[derive(Parser)]
#[command(version, after_help = EXIT_CODES, max_term_width = 100)]
pub struct Arguments {
    /// When to use color: also off when NO_COLOR is set or the output is no terminal.
    #[arg(long, global = true, value_enum, default_value_t = Color::Auto)]
    pub color: Color,
    #[command(subcommand)]
    pub command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 task passed (or nothing to pass; of a batch: all trials were run, whatever came of them), 1 task failed or a limit broken, 2 bad input, \
4 output could not be written, 70 a defect of the program.\n\
First steps: appell run scenarios/slalom.toml";

/// When to use color.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// On a terminal only.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// The commands.
#[derive(Subcommand)]
pub enum Command {
    /// Run scenarios: record, judge, and write summary, pictures and report.
    Run(RunOptions),
    /// Drive a scenario by the commands in a bag of ROS 2, and compare its odometry with the recorded one.
    Replay(ReplayOptions),
    /// Drive a scenario's robots by cmd_vel, as a node of ROS 2 without an installation of it; `appell ros --help`
    /// tells its options.
    #[command(disable_help_flag = true)]
    Ros {
        /// Scenario file, and options of the node.
        #[arg(
            value_name = "SCENARIO",
            trailing_var_arg = true,
            allow_hyphen_values = true
        )]
        arguments: Vec<std::ffi::OsString>,
    },
    /// Look at a run in the browser while it goes on, and change it.
    Studio(StudioOptions),
    /// Check a scenario or robot file, and report on the robot's design.
    Check(CheckOptions),
    /// Run many trials of a scenario, and show how its figures are distributed.
    Batch(BatchOptions),
    /// Find how the figures of a run answer to numbers of its scenario: exact derivatives.
    Sensitivity(SensitivityOptions),
    /// Plot signals of a recording as SVG or PNG.
    Plot(PlotOptions),
    /// Run one scenario at several levels of model, side by side.
    Compare(CompareOptions),
    /// Find the torques, currents, voltages and contact forces that a trajectory demands.
    Inverse(InverseOptions),
    /// Test the odometry of a differential drive on a square, both ways round, and calibrate it.
    Umbmark(UmbmarkOptions),
    /// Measure robots: rated speed, stopping, steepest slope, speed on a slope.
    Measure(MeasureOptions),
    /// Compare how the pose error of a robot answers to sine, triangle and square forces of uneven ground.
    Uneven(UnevenOptions),
    /// Tell what a wheel-legged robot does about a step or a trench, let it cross, and draw the map of its
    /// strategies.
    Obstacle(ObstacleOptions),
    /// Make a robot file of a URDF.
    Import(ImportOptions),
    /// Write a starter scenario and robot into a new folder.
    New(NewOptions),
    /// Write, describe, list and test plug-ins: controllers of your own.
    #[command(subcommand)]
    Plugin(PluginCommand),
    /// Print the JSON Schema of scenario files, for editors.
    Schema(SchemaOptions),
    /// Print completions for a shell.
    Completions {
        /// The shell.
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
}

/// Changes to a scenario.
#[derive(Args, Clone, Default)]
pub struct Changes {
    /// Level of model of every robot: kinematic, rolling or slip.
    #[arg(long)]
    pub level: Option<String>,
    /// Drives of every robot at levels rolling and slip: as-built, torque or dc-motor.
    #[arg(long)]
    pub drive: Option<String>,
    /// Method of integration: auto, rk4, exponential or adaptive.
    #[arg(long)]
    pub integrator: Option<String>,
    /// Seed of all random numbers.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Set any value by its path, such as robot.tri.controller.speed=1.2; may be repeated.
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
}

/// Formats of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RecordFormat {
    /// Comma-separated values.
    Csv,
    /// Apache Parquet.
    Parquet,
    /// A bag of ROS 2.
    Ros2,
}

/// Options of `run`.
#[derive(Args)]
pub struct RunOptions {
    /// Scenario files.
    #[arg(required = true, value_name = "SCENARIO")]
    pub scenarios: Vec<PathBuf>,
    #[command(flatten)]
    pub changes: Changes,
    /// Output folder; of several scenarios each gets a folder in it [default: runs/NAME].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Record in another format, too: csv, parquet, or ros2 for a bag of ROS 2 in the folder `ros2`; may be
    /// repeated.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub record: Vec<RecordFormat>,
    /// Record to CSV, too.
    #[arg(long)]
    pub csv: bool,
    /// Record to Parquet, too.
    #[arg(long)]
    pub parquet: bool,
    /// Print the summary as JSON instead of a table; of several scenarios one line each.
    #[arg(long)]
    pub json: bool,
    /// Write no report and no pictures.
    #[arg(long)]
    pub no_report: bool,
    /// Write no recording.
    #[arg(long)]
    pub no_recording: bool,
    /// Load libraries that the scenario names as plug-ins into this process: faster, and nothing limits
    /// them.
    #[arg(long)]
    pub trust_native: bool,
    /// Precision of the numbers: f32 gives the bits of a trial of a batch in that precision.
    #[arg(long, value_enum, default_value = "f64", conflicts_with_all = ["watch", "pace"])]
    pub precision: Precision,
    /// Run in step with the clock, and replace a plug-in when its file changes; a line `ROBOT NAME` on the
    /// standard input lets the controller or model of that name take over.
    #[arg(long)]
    pub watch: bool,
    /// Seconds of simulated time per second [default: as fast as can be; with --watch 1].
    #[arg(long, value_name = "RATE", value_parser = pace)]
    pub pace: Option<f64>,
}

/// Options of `replay`.
#[derive(Args)]
pub struct ReplayOptions {
    /// Bag of ROS 2: its folder, or the MCAP file in it.
    pub bag: PathBuf,
    /// Scenario file with the robot.
    pub scenario: PathBuf,
    #[command(flatten)]
    pub changes: Changes,
    /// Robot, of several [default: the first].
    #[arg(long)]
    pub robot: Option<String>,
    /// Topic of the commands, if there are several.
    #[arg(long, value_name = "TOPIC")]
    pub cmd_vel: Option<String>,
    /// Topic of the odometry, if there are several.
    #[arg(long, value_name = "TOPIC")]
    pub odom: Option<String>,
    /// A command older than this no longer counts, s.
    #[arg(
        long = "cmd-vel-timeout",
        value_name = "SECONDS",
        default_value_t = 0.5
    )]
    pub timeout: f64,
    /// Output folder [default: runs/NAME-replay].
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Print JSON instead of sentences.
    #[arg(long)]
    pub json: bool,
    /// Write no report and no pictures.
    #[arg(long)]
    pub no_report: bool,
}

/// Options of `studio`.
#[derive(Args)]
pub struct StudioOptions {
    /// A scenario, the recording of a run, or the folder of a batch.
    #[arg(
        value_name = "SCENARIO|RECORDING|BATCH",
        default_value = "scenarios/slalom.toml"
    )]
    pub file: PathBuf,
    #[command(flatten)]
    pub changes: Changes,
    /// Print the address only.
    #[arg(long)]
    pub no_browser: bool,
    /// Port on this machine [default: any that is free].
    #[arg(long)]
    pub port: Option<u16>,
    /// Folder with panels of the project [default: panels, beside the scenario or its folder].
    #[arg(long, value_name = "DIR")]
    pub panels: Option<PathBuf>,
    /// Run plug-ins that are libraries, FMUs or programs, each in a process of its own.
    #[arg(long)]
    pub allow_native: bool,
    /// Load plug-ins that are libraries into the process of the studio.
    #[arg(long)]
    pub trust_native: bool,
}

/// A pace above zero.
fn pace(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(pace) if pace.is_finite() && pace >= 1e-3 => Ok(pace),
        _ => Err("must be a number of at least 0.001".into()),
    }
}

/// Options of `check`.
#[derive(Args)]
pub struct CheckOptions {
    /// Scenario or robot file.
    pub file: PathBuf,
    /// Print each robot's equations of motion, too: its own numbers, as text or as LaTeX.
    #[arg(long, value_enum, value_name = "FORM", num_args = 0..=1, default_missing_value = "text")]
    pub equations: Option<Form>,
    #[command(flatten)]
    pub changes: Changes,
}

/// How equations are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Form {
    /// Aligned numbers.
    Text,
    /// LaTeX.
    Latex,
}

/// Options of `plot`.
#[derive(Args)]
pub struct PlotOptions {
    /// Recording: .mcap, .csv or .parquet.
    pub recording: PathBuf,
    /// Signals, or ends of their paths; one plot for each group of a unit. Without any: a list.
    pub signals: Vec<String>,
    /// Output file, .svg or .png.
    #[arg(long, short, default_value = "plot.svg")]
    pub out: PathBuf,
    /// Start of the time axis, s, within the recording.
    #[arg(long)]
    pub from: Option<f64>,
    /// End of the time axis, s, within the recording.
    #[arg(long)]
    pub to: Option<f64>,
}

/// Options of `compare`.
#[derive(Args)]
pub struct CompareOptions {
    /// Scenario file.
    pub scenario: PathBuf,
    /// Levels, separated by commas: kinematic, rolling, slip.
    #[arg(long, value_delimiter = ',', default_value = "kinematic,rolling")]
    pub levels: Vec<String>,
    /// Distance, m, beyond which one level has left another.
    #[arg(long, default_value_t = 0.01)]
    pub beyond: f64,
    /// Also drive at level slip with all tires 1, 2, 4, … times as stiff, up to this: how fast the distance
    /// from rolling falls.
    #[arg(long, value_name = "FACTOR")]
    pub stiffen: Option<f64>,
    /// Drives at levels rolling and slip, separated by commas [default: torque, and dc-motor where the robots
    /// have motors].
    #[arg(long, value_delimiter = ',')]
    pub drives: Option<Vec<String>>,
    /// Method of integration: auto, rk4, exponential or adaptive.
    #[arg(long)]
    pub integrator: Option<String>,
    /// Seed of all random numbers.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Set any value by its path; may be repeated.
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Output folder [default: runs/NAME-compare].
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Options of `inverse`.
#[derive(Args)]
pub struct InverseOptions {
    /// Scenario file: robot, ground, and the task whose path is driven without --of.
    pub scenario: PathBuf,
    #[command(flatten)]
    pub changes: Changes,
    /// Trajectory: a recording of the robot, or a CSV with columns t, x, y, yaw (s, m, m, rad).
    #[arg(long, value_name = "FILE")]
    pub of: Option<PathBuf>,
    /// The trajectory is that of the point this far ahead of the axle, m, which leads the robot
    /// without side slip from its heading at the start; the CSV needs no yaw.
    #[arg(
        long,
        value_name = "METRES",
        requires = "of",
        allow_negative_numbers = true
    )]
    pub ahead: Option<f64>,
    /// Robot, of several [default: the first].
    #[arg(long)]
    pub robot: Option<String>,
    /// Table of all signals.
    #[arg(long, short, default_value = "inverse.csv")]
    pub out: PathBuf,
}

/// How the draws of a batch lie together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Sampling {
    /// Each by itself.
    Random,
    /// One draw of each value in each of as many equally likely intervals as there are trials.
    LatinHypercube,
    /// Points of Sobol's sequence.
    Sobol,
}

impl From<Sampling> for appell_sim::scenario::Sampling {
    fn from(sampling: Sampling) -> Self {
        match sampling {
            Sampling::Random => Self::Random,
            Sampling::LatinHypercube => Self::LatinHypercube,
            Sampling::Sobol => Self::Sobol,
        }
    }
}

/// Precision of the numbers that a run is computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Precision {
    /// Double: sixteen digits.
    F64,
    /// Single: seven digits, for speed.
    F32,
}

impl From<Precision> for appell_sim::scenario::Precision {
    fn from(precision: Precision) -> Self {
        match precision {
            Precision::F64 => Self::F64,
            Precision::F32 => Self::F32,
        }
    }
}

/// Options of `sensitivity`.
#[derive(Args)]
pub struct SensitivityOptions {
    /// Scenario file.
    pub scenario: PathBuf,
    /// Number of the scenario to derive by, such as robot.tri.platform.body.mass; several may follow.
    #[arg(long, value_name = "PATH", num_args = 1.., required_unless_present = "list")]
    pub to: Vec<String>,
    /// List the numbers there are.
    #[arg(long, conflicts_with = "to")]
    pub list: bool,
    /// Show central differences beside the derivatives.
    #[arg(long)]
    pub check: bool,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub changes: Changes,
}

/// Options of `batch`.
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct BatchOptions {
    #[command(subcommand)]
    pub command: Option<BatchCommand>,
    /// Scenario file; its table [batch] holds the same settings.
    #[arg(value_name = "SCENARIO", required = true)]
    pub scenario: Option<PathBuf>,
    #[command(flatten)]
    pub changes: Changes,
    /// Number of trials [default: that of the file, or 1000].
    #[arg(long)]
    pub trials: Option<u64>,
    /// Draw a value anew for each trial, such as robot.tri.platform.body.mass=normal(9, 0.5); kinds
    /// are normal(mean, std), uniform(low, high), log-uniform(low, high), choice(…) and grid(…); may
    /// be repeated.
    #[arg(long, value_name = "PATH=KIND(…)")]
    pub vary: Vec<String>,
    /// How the draws of all trials lie together [default: random, or as in the file].
    #[arg(long, value_enum)]
    pub sampling: Option<Sampling>,
    /// Precision of the numbers: f64, or f32 with seven digits and twice as many trials side by side
    /// [default: f64, or as in the file].
    #[arg(long, value_enum)]
    pub precision: Option<Precision>,
    /// Threads; all cores if left out. The result does not depend on it.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1024))]
    pub threads: Option<u64>,
    /// Trials that a thread runs side by side: 1, 4 or 8, of single precision 1, 8 or 16; as many as the
    /// processor's registers hold if left out. The rows are the same.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=8))]
    pub lanes: Option<u8>,
    /// Run one share of the batch only, such as 3/16; `appell batch merge` joins the folders.
    #[arg(long, value_name = "I/N")]
    pub shard: Option<String>,
    /// Output folder [default: runs/NAME-batch]. A batch that was broken off goes on where it was.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Print the summary as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Write no report.
    #[arg(long)]
    pub no_report: bool,
}

/// What to do with batches that were run.
#[derive(Subcommand)]
pub enum BatchCommand {
    /// Join the folders of shards into one batch, and sum it up.
    Merge(MergeOptions),
}

/// Options of `batch merge`.
#[derive(Args)]
pub struct MergeOptions {
    /// Folders of the shards.
    #[arg(required = true, value_name = "DIR")]
    pub folders: Vec<PathBuf>,
    /// Output folder.
    #[arg(long)]
    pub out: PathBuf,
    /// Print the summary as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Write no report.
    #[arg(long)]
    pub no_report: bool,
}

/// Options of `measure`.
#[derive(Args)]
pub struct MeasureOptions {
    /// Robot files.
    #[arg(required = true)]
    pub robots: Vec<PathBuf>,
    /// Coefficient of friction between wheels and ground.
    #[arg(long, default_value_t = 0.8)]
    pub friction: f64,
    /// Slope on which the speed is measured, degrees.
    #[arg(long, default_value_t = 5.0)]
    pub slope: f64,
    /// Print the measures as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Options of `umbmark`.
#[derive(Args)]
pub struct UmbmarkOptions {
    /// Robot file.
    pub robot: PathBuf,
    /// Side of the square, m.
    #[arg(long, default_value_t = 4.0)]
    pub side: f64,
    /// Diameter of the right wheel over that of the left, as built: E_d.
    #[arg(long, default_value_t = 1.002)]
    pub diameter_ratio: f64,
    /// Track as built over what the robot file says: E_b.
    #[arg(long, default_value_t = 1.01)]
    pub track_ratio: f64,
    /// Runs each way round.
    #[arg(long, default_value_t = 5)]
    pub runs: u64,
    /// Standard deviation of the way that each wheel slips on a side or in a turn, m.
    #[arg(long, default_value_t = 0.0)]
    pub slip: f64,
    /// Corrections.
    #[arg(long, default_value_t = 2)]
    pub rounds: usize,
    /// Calibrate by the published first-order formulas instead of the exact end points.
    #[arg(long)]
    pub published: bool,
    /// Seed of the slip.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
}

/// Options of `uneven`.
#[derive(Args)]
pub struct UnevenOptions {
    /// Amplitude of the force along the motion, N.
    #[arg(long, default_value_t = Study::DEFAULT.along)]
    pub along: f64,
    /// Amplitude of the force across the motion, N.
    #[arg(long, default_value_t = Study::DEFAULT.across)]
    pub across: f64,
    /// Period of the forces, s.
    #[arg(long, default_value_t = Study::DEFAULT.period)]
    pub period: f64,
    /// Phase of the forces at the start, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub phase_deg: f64,
    /// Dry friction that the forces have to overcome, as a share of their amplitudes.
    #[arg(long, default_value_t = Study::DEFAULT.friction)]
    pub friction: f64,
    /// Period at which the forces are sampled, and held between, s; 0 for continuous forces.
    #[arg(long, default_value_t = Study::DEFAULT.sampling)]
    pub sampling: f64,
    /// What is equal among the waves.
    #[arg(long, value_enum, default_value_t = Alike::Amplitude)]
    pub alike: Alike,
    /// Mass, kg.
    #[arg(long, default_value_t = Study::DEFAULT.mass)]
    pub mass: f64,
    /// Yaw inertia about the vertical through the axle midpoint, kg·m².
    #[arg(long, default_value_t = Study::DEFAULT.inertia)]
    pub inertia: f64,
    /// Lever arm of the force across, m.
    #[arg(long, default_value_t = Study::DEFAULT.lever, allow_negative_numbers = true)]
    pub lever: f64,
    /// Speed that the robot wants, m/s.
    #[arg(long, default_value_t = Study::DEFAULT.speed, allow_negative_numbers = true)]
    pub speed: f64,
    /// Yaw rate that the robot wants, rad/s.
    #[arg(long, default_value_t = Study::DEFAULT.yaw_rate, allow_negative_numbers = true)]
    pub yaw_rate: f64,
    /// Pose error at the start: m, m, rad.
    #[arg(long, num_args = 3, value_names = ["X", "Y", "THETA"], default_values_t = Study::DEFAULT.start, allow_negative_numbers = true)]
    pub start: Vec<f64>,
    /// Length of the runs, s.
    #[arg(long, default_value_t = Study::DEFAULT.duration)]
    pub duration: f64,
    /// Output folder.
    #[arg(long, default_value = "runs/uneven")]
    pub out: PathBuf,
    /// Print JSON instead of tables.
    #[arg(long)]
    pub json: bool,
}

/// What is equal among the waves, apart from their period.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Alike {
    /// The amplitude.
    Amplitude,
    /// The effective value: that of the sine.
    Effective,
}

impl From<Alike> for appell_sim::uneven::Alike {
    fn from(alike: Alike) -> Self {
        match alike {
            Alike::Amplitude => Self::Amplitude,
            Alike::Effective => Self::Effective,
        }
    }
}

/// Options of `obstacle`.
#[derive(Args)]
pub struct ObstacleOptions {
    /// A step up of this height, m.
    #[arg(
        long,
        value_name = "HEIGHT",
        conflicts_with = "trench",
        allow_negative_numbers = true
    )]
    pub step: Option<f64>,
    /// A trench of this width and depth, m.
    #[arg(long, num_args = 2, value_names = ["WIDTH", "DEPTH"], allow_negative_numbers = true)]
    pub trench: Option<Vec<f64>>,
    /// Wheel radius R, m.
    #[arg(long, default_value_t = Limits::PUBLISHED.wheel_radius, allow_negative_numbers = true)]
    pub wheel_radius: f64,
    /// Pitch S₁ of the two wheels of a leg system, m.
    #[arg(long, default_value_t = Limits::PUBLISHED.wheel_pitch, allow_negative_numbers = true)]
    pub wheel_pitch: f64,
    /// Largest step or depth that the legs manage, m.
    #[arg(long, default_value_t = Limits::PUBLISHED.height_max, allow_negative_numbers = true)]
    pub height_max: f64,
    /// Output folder.
    #[arg(long, default_value = "runs/obstacle")]
    pub out: PathBuf,
    /// Print JSON instead of a sentence.
    #[arg(long)]
    pub json: bool,
}

/// Options of `import`.
#[derive(Args)]
pub struct ImportOptions {
    /// URDF, plain: `xacro FILE` writes macros out.
    pub file: PathBuf,
    /// Robot file to write [default: the URDF's name with .toml, in this folder].
    #[arg(long, short)]
    pub out: Option<PathBuf>,
    /// Folder below which the file has to lie, after links are followed; may be repeated [default: the file's own].
    #[arg(long, value_name = "DIR")]
    pub root: Vec<PathBuf>,
    /// Joints of the wheels that are driven [default: those with a transmission or a command interface].
    #[arg(long, value_name = "JOINT", value_delimiter = ',')]
    pub driven: Vec<String>,
    /// Largest torque of a driven wheel, N·m [default: the limit of its joint].
    #[arg(long, value_name = "TORQUE")]
    pub torque_max: Option<f64>,
    /// Largest rate of a driven wheel, rad/s [default: the limit of its joint].
    #[arg(long, value_name = "RATE")]
    pub rate_max: Option<f64>,
    /// Wheels with rollers, and the angle from the rolling direction to the roller's axis, degrees.
    #[arg(long, value_name = "JOINT=ANGLE", value_delimiter = ',')]
    pub rollers: Vec<String>,
    /// Mass of the body, kg [default: that of its links].
    #[arg(long)]
    pub mass: Option<f64>,
    /// Radius of the disc that must not touch anything, m [default: that of the outline].
    #[arg(long, value_name = "RADIUS")]
    pub collision_radius: Option<f64>,
}

/// Options of `new`.
#[derive(Args)]
pub struct NewOptions {
    /// Folder to make.
    pub folder: PathBuf,
}

/// What can be done with plug-ins.
#[derive(Subcommand)]
pub enum PluginCommand {
    /// Write a controller and a scenario that runs it into a new folder.
    New {
        /// Folder to make; its name is the controller's.
        folder: PathBuf,
        /// Language of the controller.
        #[arg(long, value_enum, default_value_t = Language::Python)]
        language: Language,
    },
    /// Start a plug-in and print what it reads, writes and takes for parameters.
    Describe {
        /// File of the plug-in.
        file: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// List the plug-ins in a folder and in those directly below it.
    List {
        /// The folder.
        #[arg(default_value = ".")]
        folder: PathBuf,
    },
    /// Test plug-ins: ports, repeatability, memory, limits, speed; of several, whether they give the same.
    Test {
        /// Files of plug-ins.
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
        /// Steps of each test.
        #[arg(long, default_value_t = 200)]
        steps: usize,
        /// Load a library into this process instead of one of its own.
        #[arg(long)]
        trust_native: bool,
    },
    /// Answer messages for a library: what appell starts in a process of its own.
    #[command(hide = true)]
    Serve {
        /// File of the library.
        file: PathBuf,
    },
}

/// Languages that a controller can be started in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Language {
    /// A function in a file, with the module of `sdk/python`.
    Python,
    /// A shared library, with the header of `sdk/c`.
    C,
    /// A module of WebAssembly, or a shared library, from the crate of `sdk/rust`.
    Rust,
    /// A module of WebAssembly.
    #[value(name = "assemblyscript")]
    AssemblyScript,
}

/// Options of `schema`.
#[derive(Args)]
pub struct SchemaOptions {
    /// The schema of robot files instead.
    #[arg(long)]
    pub robot: bool,
}

impl Changes {
    /// The changes as paths and TOML values.
    pub fn overrides(&self) -> Result<Vec<(String, String)>, String> {
        let mut overrides = Vec::new();
        let quoted = |word: &String| format!("{word:?}");
        if let Some(level) = &self.level {
            overrides.push(("robot.*.level".into(), quoted(level)));
        }
        if let Some(drive) = &self.drive {
            overrides.push(("robot.*.drive".into(), quoted(drive)));
        }
        if let Some(integrator) = &self.integrator {
            overrides.push(("time.integrator".into(), quoted(integrator)));
        }
        if let Some(seed) = self.seed {
            overrides.push(("seed".into(), seed.to_string()));
        }
        for set in &self.set {
            let (path, value) = set
                .split_once('=')
                .ok_or_else(|| format!("--set {set}: must be PATH=VALUE, got no ="))?;
            overrides.push((path.trim().to_owned(), value.trim().to_owned()));
        }
        Ok(overrides)
    }
}
