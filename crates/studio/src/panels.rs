//! Views that a project brings along: modules of JavaScript in a folder `panels`, listed and read for pages.
//!
//! They run in the browser, in a frame of their own (see `frame.html`); nothing of them runs here.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::Serialize;

use crate::studio::is_plain;

/// Longest module, bytes.
pub const SOURCE_MAX: u64 = 1 << 20;
/// Most modules of a folder.
const COUNT_MAX: usize = 64;

/// A module of a folder.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Panel {
    /// Name of its file, without extension.
    pub name: String,
    /// Differs when the file was written anew.
    pub version: String,
}

/// Where modules lie.
pub struct Panels {
    folders: Vec<PathBuf>,
}

impl Panels {
    /// A folder of its own.
    pub fn of(folder: &Path) -> Panels {
        Panels {
            folders: vec![folder.to_owned()],
        }
    }

    /// The folder `panels` beside a scenario, or else beside the folder that it is in.
    pub fn beside(scenario: &Path) -> Panels {
        let home = match scenario.parent() {
            Some(home) if !home.as_os_str().is_empty() => home,
            _ => Path::new("."),
        };
        Panels {
            folders: vec![home.join("panels"), home.join("../panels")],
        }
    }

    /// The first folder that is there, and is one itself: no link leads out of the project.
    fn folder(&self) -> Option<&Path> {
        let is_folder =
            |folder: &&PathBuf| std::fs::symlink_metadata(folder).is_ok_and(|about| about.is_dir());
        self.folders.iter().find(is_folder).map(PathBuf::as_path)
    }

    /// The modules that are there now, by name.
    pub fn list(&self) -> Vec<Panel> {
        let entries = self.folder().and_then(|it| std::fs::read_dir(it).ok());
        let mut found: Vec<Panel> = entries
            .into_iter()
            .flatten()
            .filter_map(|entry| {
                let entry = entry.ok()?;
                let about = entry.metadata().ok()?;
                let name = entry.file_name().into_string().ok()?;
                let name = name.strip_suffix(".js")?;
                let is_module = about.is_file() && about.len() <= SOURCE_MAX && is_plain(name);
                let written = about.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
                is_module.then(|| Panel {
                    name: name.to_owned(),
                    version: format!("{:x}-{:x}", written.as_nanos(), about.len()),
                })
            })
            .collect();
        found.sort();
        found.truncate(COUNT_MAX);
        found
    }

    /// The text of a module; nothing if there is none of this name.
    pub fn read(&self, name: &str) -> Option<String> {
        if !is_plain(name) {
            return None;
        }
        let file = self.folder()?.join(format!("{name}.js"));
        // Metadata of the link, not of where it leads.
        if !std::fs::symlink_metadata(&file).ok()?.is_file() {
            return None;
        }
        let mut text = String::new();
        let mut open = std::fs::File::open(&file).ok()?.take(SOURCE_MAX + 1);
        open.read_to_string(&mut text).ok()?;
        (text.len() as u64 <= SOURCE_MAX).then_some(text)
    }
}
