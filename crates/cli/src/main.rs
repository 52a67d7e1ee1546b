//! `appell`: a workbench for the motion of wheeled mobile robots.
//!
//! A thin front: it parses arguments, calls `appell-sim` and prints what came of it.

mod arguments;
mod batch;
mod beside;
mod check;
mod compare;
mod import;
mod inverse;
mod live;
mod measure;
mod new;
mod obstacle;
mod plot;
mod plugin;
mod replay;
mod ros;
mod run;
mod sensitivity;
mod studio;
mod terminal;
mod umbmark;
mod uneven;

use std::process::ExitCode;

use arguments::{Arguments, Command};
use clap::{CommandFactory, Parser};

/// Exit codes, as `appell --help` states them.
pub mod exit {
    /// The task was passed, or there was none.
    pub const PASSED: u8 = 0;
    /// A task failed.
    pub const FAILED: u8 = 1;
    /// The input is wrong.
    pub const BAD_INPUT: u8 = 2;
    /// The output could not be written.
    pub const OUTPUT: u8 = 4;
    /// A defect of the program.
    pub const INTERNAL: u8 = 70;
}

fn main() -> ExitCode {
    terminal::survive_closed_pipes();
    let arguments = Arguments::parse();
    terminal::set_color(arguments.color);
    let code = match arguments.command {
        Command::Run(options) => run::run(&options),
        Command::Batch(options) => batch::batch(&options),
        Command::Check(options) => check::check(&options),
        Command::Sensitivity(options) => sensitivity::sensitivity(&options),
        Command::Studio(options) => studio::studio(&options),
        Command::Replay(options) => replay::replay(&options),
        Command::Ros { arguments } => ros::ros(&arguments),
        Command::Plot(options) => plot::plot(&options),
        Command::Compare(options) => compare::compare(&options),
        Command::Inverse(options) => inverse::inverse(&options),
        Command::Umbmark(options) => umbmark::umbmark(&options),
        Command::Measure(options) => measure::measure(&options),
        Command::Uneven(options) => uneven::uneven(&options),
        Command::Obstacle(options) => obstacle::obstacle(&options),
        Command::Import(options) => import::import(&options),
        Command::New(options) => new::new(&options),
        Command::Plugin(command) => plugin::plugin(&command),
        Command::Schema(options) => {
            terminal::print(&appell_sim::scenario::schema(options.robot));
            exit::PASSED
        }
        Command::Completions { shell } => {
            let mut command = Arguments::command();
            clap_complete::generate(shell, &mut command, "appell", &mut std::io::stdout());
            exit::PASSED
        }
    };
    ExitCode::from(code)
}
