//! `cargo xtask studio`: the page of the studio, then the program with the page inside; and their tests.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Least version of Node that builds the page.
const NODE: (u32, u32) = (20, 19);

pub(crate) fn run(folder: &Path, program: &str, arguments: &[&str]) -> Result<(), String> {
    println!("\n== {program} {}", arguments.join(" "));
    let status = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .status();
    match status {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{program} {}: {status}", arguments.join(" "))),
        Err(error) => Err(format!("{program} cannot be started: {error}")),
    }
}

/// The version of Node, if there is one.
fn node() -> Option<(u32, u32)> {
    let output = Command::new("node").arg("--version").output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let mut parts = text.trim().trim_start_matches('v').split('.');
    Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
}

/// The folder of the page, with what it is built from.
pub(crate) fn page(root: &Path) -> Result<PathBuf, String> {
    if node().is_none_or(|version| version < NODE) {
        let (major, minor) = NODE;
        return Err(format!(
            "building the page needs Node {major}.{minor} or later; install it and try again"
        ));
    }
    let page = root.join("crates/studio/page");
    run(&page, "npm", &["ci"])?;
    Ok(page)
}

/// Builds the page, and the studio and `appell` around it.
pub fn build(root: &Path) -> Result<(), String> {
    let page = page(root)?;
    run(&page, "npm", &["run", "build"])?;
    let arguments =
        "build --release --workspace --features appell/wasm --bin appell --bin appell-studio";
    run(root, "cargo", &arguments.split(' ').collect::<Vec<_>>())
}

/// Builds the page and tests it in a browser, where Node and Chromium are; says what it leaves out.
pub fn check(root: &Path) -> Result<(), String> {
    if node().is_none_or(|version| version < NODE) {
        let (major, minor) = NODE;
        println!(
            "\n== the page of the studio is not tested: Node {major}.{minor} or later is not there"
        );
        return Ok(());
    }
    build(root)?;
    let has_browser = Command::new("chromium").arg("--version").output();
    if !has_browser.is_ok_and(|output| output.status.success()) {
        println!("\n== the page of the studio is built, but not tested: there is no chromium");
        return Ok(());
    }
    crate::demo::build(root, &crate::demo::default_folder(root))?;
    run(&root.join("crates/studio/page"), "npm", &["test"])
}
