//! Chores of the project; see `USAGE`.

use std::path::PathBuf;
use std::process::ExitCode;

const USAGE: &str = "usage:
  cargo xtask test                     every check: format, lints, licenses, types, tests
  cargo xtask studio                   build the studio with its page (needs Node)
  cargo xtask demo [--out DIR]         build the studio as a folder of files for any web server (needs Node)
  cargo xtask vectors DIR --out OUT    run the reference vectors of a folder
  cargo xtask layouts DIR --out OUT    run the task layouts of a folder
  cargo xtask docs                     write the book's reference pages";

fn build_demo(out: &std::path::Path) -> Result<bool, String> {
    xtask::demo::build(&xtask::root(), out).map(|()| true)
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        ["test"] => xtask::checks::run(&xtask::root()).map(|()| true),
        ["studio"] => xtask::studio::build(&xtask::root()).map(|()| true),
        ["demo"] => build_demo(&xtask::demo::default_folder(&xtask::root())),
        ["demo", "--out", out] => build_demo(&PathBuf::from(out)),
        ["vectors", folder, "--out", out] => {
            let done = xtask::vectors::run_folder(&PathBuf::from(folder), &PathBuf::from(out));
            done.map_err(|error| format!("{folder}: {error}"))
        }
        ["layouts", folder, "--out", out] => {
            let done = xtask::layouts::run_folder(&PathBuf::from(folder), &PathBuf::from(out));
            done.map_err(|error| format!("{folder}: {error}"))
        }
        ["docs"] => xtask::docs::write(&xtask::root())
            .map(|()| true)
            .map_err(|error| error.to_string()),
        _ => Err(USAGE.into()),
    };
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}
