//! Chores of the project, as functions that its tests can call.

pub mod checks;
pub mod demo;
pub mod docs;
pub mod layouts;
pub mod studio;
pub mod vectors;

use std::path::{Path, PathBuf};

/// The project's folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .components()
        .collect()
}

/// Stem and text of every JSON file of a folder, sorted.
pub fn json_files(folder: &Path) -> std::io::Result<Vec<(String, String)>> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)?
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "json"))
        .collect();
    files.sort();
    files
        .into_iter()
        .map(|path| {
            let stem = path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            Ok((stem, std::fs::read_to_string(&path)?))
        })
        .collect()
}
