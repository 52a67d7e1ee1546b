//! `appell studio`: finds the studio, which is a program of its own, and starts it.

use std::path::PathBuf;
use std::process::Command;

use crate::arguments::StudioOptions;
use crate::{exit, terminal};

/// Starts the studio and waits for its end.
pub fn studio(options: &StudioOptions) -> u8 {
    let overrides = match options.changes.overrides() {
        Ok(overrides) => overrides,
        Err(problem) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    let name = format!("appell-studio{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe()
        .ok()
        .map(|own| own.with_file_name(&name))
        .filter(|path| path.is_file());
    let mut command = Command::new(beside.unwrap_or_else(|| PathBuf::from(&name)));
    command.arg(&options.file);
    // Libraries and FMUs of the scenario are served by this program.
    if let Ok(own) = std::env::current_exe() {
        command.env("APPELL_EXECUTABLE", own);
    }
    for (path, value) in overrides {
        command.arg("--set").arg(format!("{path}={value}"));
    }
    if let Some(port) = options.port {
        command.arg("--port").arg(port.to_string());
    }
    if let Some(folder) = &options.panels {
        command.arg("--panels").arg(folder);
    }
    if options.no_browser {
        command.arg("--no-browser");
    }
    if options.trust_native {
        command.arg("--trust-native");
    }
    match command.status() {
        Ok(status) => match status.code() {
            Some(code) => u8::try_from(code).unwrap_or(exit::INTERNAL),
            // Ended by a signal, as by Ctrl C.
            None => exit::PASSED,
        },
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            terminal::error(
                "the studio is not there: neither beside this program nor on the path\n  \
                 hint: `cargo xtask studio` in the project's folder builds it; that needs Node 20.19 or later, \
                 which this program does not",
            );
            exit::BAD_INPUT
        }
        Err(error) => {
            terminal::error(&format!("{name}: cannot be started: {error}"));
            exit::INTERNAL
        }
    }
}
