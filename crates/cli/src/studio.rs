//! `appell studio`: finds the studio, which is a program of its own, and starts it.

use crate::arguments::StudioOptions;
use crate::{beside, exit, terminal};

/// Starts the studio and waits for its end.
pub fn studio(options: &StudioOptions) -> u8 {
    let overrides = match options.changes.overrides() {
        Ok(overrides) => overrides,
        Err(problem) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    let mut command = beside::program("appell-studio");
    command.arg(&options.file);
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
    if options.allow_native {
        command.arg("--allow-native");
    }
    if options.trust_native {
        command.arg("--trust-native");
    }
    beside::finished(
        command,
        "the studio is not there: neither beside this program nor on the path\n  \
         hint: `cargo xtask studio` in the project's folder builds it; that needs Node 20.19 or later, \
         which this program does not",
    )
}
