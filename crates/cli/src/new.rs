//! `appell new`: a scenario and a robot to start from.

use std::path::Path;

use crate::arguments::NewOptions;
use crate::{exit, terminal};

const ROBOT: &str = include_str!("../../../robots/three-wheeler.toml");
const SCENARIO: &str = include_str!("../../../scenarios/homing.toml");

/// Writes the two files into a new folder.
pub fn new(options: &NewOptions) -> u8 {
    let folder = &options.folder;
    let text = scenario(&name(folder), "drive to a beacon and stop beside it");
    let files = [("scenario.toml", text.as_str()), ("robot.toml", ROBOT)];
    write(folder, &files, &[])
}

/// What is made in a folder is named as the folder is.
pub fn name(folder: &Path) -> String {
    let name = folder.file_name().map(|name| {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        name.to_string_lossy().chars().map(plain).collect()
    });
    name.unwrap_or_else(|| "scenario".into())
}

/// The starter robot.
pub fn robot() -> &'static str {
    ROBOT
}

/// The starter scenario, with a line on what it is about.
pub fn scenario(name: &str, about: &str) -> String {
    let head = format!("# A scenario to start from: {about}.\n#\n#   appell run scenario.toml\n");
    SCENARIO
        .replace("name = \"homing\"", &format!("name = \"{name}\""))
        .replace("../robots/three-wheeler.toml", "robot.toml")
        .lines()
        .skip_while(|line| line.starts_with('#'))
        .fold(head, |text, line| text + line + "\n")
}

/// Writes files into a new folder, and tells how to go on: by `first`, then with a run.
pub fn write(folder: &Path, files: &[(&str, &str)], first: &[String]) -> u8 {
    if folder.exists() {
        terminal::error(&format!(
            "{}: exists already\n  hint: give the path of a folder that does not exist yet",
            folder.display()
        ));
        return exit::BAD_INPUT;
    }
    let written = std::fs::create_dir_all(folder).and_then(|()| {
        let mut files = files.iter();
        files.try_for_each(|(name, text)| {
            let file = folder.join(name);
            std::fs::create_dir_all(file.parent().unwrap_or(folder))?;
            std::fs::write(file, text)
        })
    });
    if let Err(error) = written {
        terminal::error(&format!("{}: cannot be written: {error}", folder.display()));
        return exit::OUTPUT;
    }
    let names: Vec<String> = files
        .iter()
        .map(|(name, _)| format!("{}/{name}", folder.display()))
        .collect();
    let run = format!("appell run {}/scenario.toml", folder.display());
    let next: Vec<&str> = first
        .iter()
        .map(String::as_str)
        .chain([run.as_str()])
        .collect();
    terminal::print(&format!(
        "written: {}\nnext: {}",
        names.join(", "),
        next.join("\n      ")
    ));
    exit::PASSED
}
