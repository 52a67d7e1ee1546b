//! Programs of this project that stand beside this one, each with what would make this one heavy.

use std::path::PathBuf;
use std::process::Command;

use crate::{exit, terminal};

/// A command of the program `name`, which lies beside this one or on the path.
pub fn program(name: &str) -> Command {
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let own = std::env::current_exe().ok();
    let beside = own
        .as_ref()
        .map(|own| own.with_file_name(&name))
        .filter(|path| path.is_file());
    let mut command = Command::new(beside.unwrap_or_else(|| PathBuf::from(&name)));
    // Libraries and FMUs of scenarios are served by this program.
    if let Some(own) = own {
        command.env("APPELL_EXECUTABLE", own);
    }
    command
}

/// Starts a command and waits for its end; `missing` is said where there is no such program.
pub fn finished(mut command: Command, missing: &str) -> u8 {
    match command.status() {
        Ok(status) => match status.code() {
            Some(code) => u8::try_from(code).unwrap_or(exit::INTERNAL),
            // Ended by a signal, as by Ctrl C.
            None => exit::PASSED,
        },
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            terminal::error(missing);
            exit::BAD_INPUT
        }
        Err(error) => {
            let name = command.get_program().to_string_lossy();
            terminal::error(&format!("{name}: cannot be started: {error}"));
            exit::INTERNAL
        }
    }
}
