//! `appell new`: a scenario and a robot to start from.

use crate::arguments::NewOptions;
use crate::{exit, terminal};

const ROBOT: &str = include_str!("../../../robots/three-wheeler.toml");
const SCENARIO: &str = include_str!("../../../scenarios/homing.toml");

/// Writes the two files into a new folder.
pub fn new(options: &NewOptions) -> u8 {
    let folder = &options.folder;
    let name: String = folder
        .file_name()
        .map(|name| {
            name.to_string_lossy()
                .chars()
                .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
                .collect()
        })
        .unwrap_or_else(|| "scenario".into());
    if folder.exists() {
        terminal::error(&format!(
            "{}: exists already\n  hint: give the path of a folder that does not exist yet",
            folder.display()
        ));
        return exit::BAD_INPUT;
    }
    let scenario = SCENARIO
        .replace("name = \"homing\"", &format!("name = \"{name}\""))
        .replace("../robots/three-wheeler.toml", "robot.toml")
        .lines()
        .skip_while(|line| line.starts_with('#'))
        .fold(String::from("# A scenario to start from: drive to a beacon and stop beside it.\n#\n#   appell run scenario.toml\n"), |text, line| text + line + "\n");
    let written = std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(folder.join("robot.toml"), ROBOT))
        .and_then(|()| std::fs::write(folder.join("scenario.toml"), scenario));
    match written {
        Ok(()) => {
            terminal::print(&format!(
                "written: {0}/scenario.toml, {0}/robot.toml\nnext: appell run {0}/scenario.toml",
                folder.display()
            ));
            exit::PASSED
        }
        Err(error) => {
            terminal::error(&format!("{}: cannot be written: {error}", folder.display()));
            exit::OUTPUT
        }
    }
}
