//! `cargo xtask test`: everything that must hold before a change is good, on a fresh machine too.

use std::path::Path;
use std::process::Command;

/// A step: what it is called, and the command.
struct Step {
    name: &'static str,
    program: &'static str,
    arguments: Vec<&'static str>,
}

fn step(name: &'static str, program: &'static str, arguments: &[&'static str]) -> Step {
    Step {
        name,
        program,
        arguments: arguments.to_vec(),
    }
}

/// Runs all checks in order; stops at the first that fails.
pub fn run(root: &Path) -> Result<(), String> {
    provide(root)?;
    let steps = [
        step("format", "cargo", &["fmt", "--all", "--check"]),
        step(
            "lints",
            "cargo",
            &[
                "clippy",
                "--release",
                "--workspace",
                "--features",
                "appell/wasm",
                "--all-targets",
                "--",
                "-D",
                "warnings",
            ],
        ),
        step(
            "licenses and sources",
            "cargo",
            &["deny", "check", "bans", "licenses", "sources"],
        ),
        step(
            "types of the page's modules",
            "npx",
            &[
                "--yes",
                "--package",
                "typescript@5.9",
                "tsc",
                "--project",
                "crates/sim/web",
            ],
        ),
        // Debug and release must give the same bits: the tests compare the two binaries. The first is the
        // program without its features.
        step("debug build", "cargo", &["build", "--package", "appell"]),
        step(
            "release build",
            "cargo",
            &[
                "build",
                "--release",
                "--package",
                "appell",
                "--features",
                "wasm",
            ],
        ),
        step(
            "tests",
            "cargo",
            &[
                "test",
                "--release",
                "--workspace",
                "--features",
                "appell/wasm",
            ],
        ),
        step(
            "tests of the SDK in Rust",
            "cargo",
            &["test", "--manifest-path", "sdk/rust/Cargo.toml"],
        ),
    ];
    for step in steps {
        println!(
            "\n== {}: {} {}",
            step.name,
            step.program,
            step.arguments.join(" ")
        );
        let status = Command::new(step.program)
            .args(&step.arguments)
            .current_dir(root)
            .status();
        match status {
            Ok(status) if status.success() => {}
            Ok(status) => return Err(format!("{}: {status}", step.name)),
            Err(error) => {
                return Err(format!(
                    "{}: {} cannot be started: {error}",
                    step.name, step.program
                ));
            }
        }
    }
    crate::studio::check(root)?;
    println!("\nall checks passed");
    Ok(())
}

/// Whether the toolchain compiles for a target.
pub(crate) fn has_target(root: &Path, target: &str) -> bool {
    let output = Command::new("rustup")
        .args(["target", "list", "--installed"])
        .current_dir(root)
        .output();
    output.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).contains(target))
}

/// Installs what the checks need and the machine lacks. Nothing is skipped in silence: what cannot
/// be had is an error that says how to get it.
fn provide(root: &Path) -> Result<(), String> {
    let works = |program: &str, arguments: &[&str]| {
        let output = Command::new(program)
            .args(arguments)
            .current_dir(root)
            .output();
        output.is_ok_and(|output| output.status.success())
    };
    let need =
        |what: &str, present: bool, program: &str, arguments: &[&str]| -> Result<(), String> {
            if present {
                return Ok(());
            }
            println!("== installing {what}: {program} {}", arguments.join(" "));
            let done = Command::new(program)
                .args(arguments)
                .current_dir(root)
                .status();
            if done.is_ok_and(|status| status.success()) {
                Ok(())
            } else {
                Err(format!(
                    "{what} is missing; install it and run the checks again"
                ))
            }
        };
    need(
        "rustfmt and clippy",
        works("cargo", &["fmt", "--version"]) && works("cargo", &["clippy", "--version"]),
        "rustup",
        &["component", "add", "rustfmt", "clippy"],
    )?;
    need(
        "cargo-deny",
        works("cargo", &["deny", "--version"]),
        "cargo",
        &["install", "cargo-deny", "--locked"],
    )?;
    // What the plug-ins of the tests are compiled with.
    need(
        "the target wasm32-unknown-unknown",
        has_target(root, "wasm32-unknown-unknown"),
        "rustup",
        &["target", "add", "wasm32-unknown-unknown"],
    )?;
    need(
        "the target wasm32-wasip1, which the demo of the studio is compiled for",
        has_target(root, crate::demo::TARGET),
        "rustup",
        &["target", "add", crate::demo::TARGET],
    )?;
    need(
        "clang and lld",
        works("clang", &["--version"]) && works("wasm-ld", &["--version"]),
        "sh",
        &["-c", "apt-get update && apt-get install --yes clang lld"],
    )?;
    need(
        "pythonfmu, which makes FMUs",
        works("python3", &["-c", "import pythonfmu"]),
        "sh",
        &[
            "-c",
            "python3 -m pip install pythonfmu || python3 -m pip install --break-system-packages pythonfmu",
        ],
    )?;
    need(
        "rosbags, which reads bags of ROS 2, cyclonedds, which speaks with its nodes, and websockets",
        works("python3", &["-c", "import rosbags, cyclonedds, websockets"]),
        "sh",
        &[
            "-c",
            "python3 -m pip install rosbags cyclonedds websockets \
             || python3 -m pip install --break-system-packages rosbags cyclonedds websockets",
        ],
    )?;
    need(
        "a master of ROS 1",
        works(
            "test",
            &["-x", "/usr/bin/roscore", "-a", "-x", "/usr/bin/rostopic"],
        ),
        "sh",
        &[
            "-c",
            "apt-get update && apt-get install --yes --no-install-recommends python3-roslaunch python3-rostopic \
             python3-geometry-msgs python3-sensor-msgs",
        ],
    )?;
    need(
        "Fast DDS",
        works(
            "test",
            &[
                "-e",
                "/usr/include/fastdds",
                "-a",
                "-e",
                "/usr/include/fastcdr",
            ],
        ),
        "sh",
        &[
            "-c",
            "apt-get update && apt-get install --yes --no-install-recommends libfastrtps-dev g++",
        ],
    )?;
    need(
        "npx (Node)",
        works("npx", &["--version"]),
        "sh",
        &["-c", "apt-get update && apt-get install --yes nodejs npm"],
    )
}
