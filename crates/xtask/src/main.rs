//! Chores of the project: `cargo xtask vectors DIR --out OUT`.

use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["vectors", folder, "--out", out] => {
            match xtask::vectors::run_folder(&PathBuf::from(folder), &PathBuf::from(out)) {
                Ok(true) => ExitCode::SUCCESS,
                Ok(false) => ExitCode::FAILURE,
                Err(error) => {
                    eprintln!("error: {folder}: {error}");
                    ExitCode::from(2)
                }
            }
        }
        _ => {
            eprintln!("usage: cargo xtask vectors DIR --out OUT");
            ExitCode::from(2)
        }
    }
}
