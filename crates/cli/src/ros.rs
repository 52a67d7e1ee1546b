//! `appell ros`: finds the node of ROS, which is a program of its own, and starts it.

use std::ffi::OsString;

use crate::beside;

/// Starts the node with these arguments and waits for its end.
pub fn ros(arguments: &[OsString]) -> u8 {
    let mut command = beside::program("appell-ros");
    command.args(arguments);
    beside::finished(
        command,
        "the node of ROS is not there: neither beside this program nor on the path\n  \
         hint: `cargo build --release --package appell-ros2` in the project's folder builds it",
    )
}
