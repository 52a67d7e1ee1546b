//! The program as a process: killed, out of room, compared with its other build, asked for help.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use appell_sim::record::Recording;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn scratch(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("appell-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    folder
}

fn appell() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_appell"));
    command.current_dir(root()).env("NO_COLOR", "1");
    command
}

/// `kill -9` at 100 moments spread over the run: each file opens and holds all but the last 0.25 s of
/// what had been simulated, and what it holds is what the undisturbed run recorded.
#[test]
fn invariant_killed_runs_leave_readable_recordings() {
    let folder = scratch("kill");
    let run = |out: &Path| {
        let mut command = appell();
        command
            .args([
                "run",
                "scenarios/sleigh.toml",
                "--set",
                "time.duration=300",
                "--set",
                "record.period=0.01",
                "--no-report",
                "--out",
            ])
            .arg(out)
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        command.spawn().expect("starts")
    };
    let whole = folder.join("whole");
    let start = Instant::now();
    assert!(run(&whole).wait().expect("ends").success());
    let length = start.elapsed();
    let truth = Recording::read(&whole.join("recording.mcap")).expect("reads");
    assert!(truth.complete);
    let (mut opened, mut rows) = (0, 0);
    for k in 0..100_u32 {
        let out = folder.join(format!("k{k}"));
        let mut child = run(&out);
        // Before its first words a recording is an empty file, and a busy machine takes its time.
        let begun = || std::fs::metadata(out.join("recording.mcap")).is_ok_and(|m| m.len() > 0);
        let patience = Instant::now();
        while !begun() && patience.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(2));
        }
        // A fixed, uneven spread over the undisturbed length.
        let share = f64::from((k * 37) % 100) / 100.0;
        std::thread::sleep(Duration::from_secs_f64(
            0.02 + 0.9 * share * length.as_secs_f64(),
        ));
        child.kill().expect("killed");
        child.wait().expect("gone");
        let recording =
            Recording::read(&out.join("recording.mcap")).unwrap_or_else(|e| panic!("run {k}: {e}"));
        let count = recording.times.len();
        for (column, reference) in recording.columns.iter().zip(&truth.columns) {
            for (a, b) in column.iter().zip(reference) {
                assert_eq!(a.to_bits(), b.to_bits(), "run {k}");
            }
        }
        // Chunks are whole quarters of a second: 25 rows, or all rows of a run that had ended, perhaps
        // without its summary.
        let all = recording.complete || count == truth.times.len();
        assert!(all || count.is_multiple_of(25), "run {k}: {count} rows");
        opened += 1;
        rows += count;
        std::fs::remove_dir_all(&out).expect("removed");
    }
    assert_eq!(opened, 100);
    assert!(rows > 0, "some were killed while recording");
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// A batch for a moment or two, in a folder.
fn batch(binary: &Path, out: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(binary);
    command.current_dir(root()).env("NO_COLOR", "1");
    command
        .args([
            "batch",
            "scenarios/homing.toml",
            "--set",
            "time.duration=1.5",
        ])
        .args(["--vary", "robot.tri.platform.body.mass=normal(9, 0.5)"])
        .arg("--no-report")
        .arg("--out")
        .arg(out)
        .args(more)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

fn root_of(folder: &Path) -> String {
    let text = std::fs::read_to_string(folder.join("batch.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    summary["root"].as_str().expect("a root").to_owned()
}

/// `kill -9` at 50 moments of one batch, which is resumed each time: the root is that of the batch that
/// was left alone.
#[test]
fn invariant_killed_batches_go_on_to_the_same_root() {
    let folder = scratch("kill-batch");
    let binary = Path::new(env!("CARGO_BIN_EXE_appell"));
    let (whole, broken) = (folder.join("whole"), folder.join("broken"));
    let trials = ["--trials", "6000"];
    assert!(
        batch(binary, &whole, &trials)
            .status()
            .expect("ends")
            .success()
    );
    let parts = |out: &Path| std::fs::read_dir(out.join("trials")).map_or(0, Iterator::count);
    let (mut killed, mut between) = (0, 0);
    for k in 0..50_u64 {
        let mut child = batch(binary, &broken, &trials).spawn().expect("starts");
        // Every other one at any moment from its start; those between after they have finished a
        // part, however long a busy machine takes for it.
        let (before, patience) = (parts(&broken), Instant::now());
        while k % 2 == 0
            && parts(&broken) == before
            && patience.elapsed() < Duration::from_secs(20)
            && child.try_wait().expect("a child").is_none()
        {
            std::thread::sleep(Duration::from_millis(2));
        }
        std::thread::sleep(Duration::from_millis((k * 37) % [20, 100][k as usize % 2]));
        let ended = child.try_wait().expect("a child").is_some();
        child.kill().expect("killed");
        child.wait().expect("gone");
        killed += usize::from(!ended);
        between += usize::from((1..24).contains(&parts(&broken)));
    }
    assert!(
        killed > 20 && between > 5,
        "{killed} killed, {between} midway"
    );
    assert!(
        batch(binary, &broken, &trials)
            .status()
            .expect("ends")
            .success()
    );
    assert_eq!(root_of(&whole), root_of(&broken));
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// A full disk and a folder that cannot be made: exit code 4, the path and a hint, no panic.
#[test]
fn invariant_unwritable_output_is_a_clear_error() {
    let folder = scratch("full");
    let file = folder.join("file");
    std::fs::write(&file, "not a folder").expect("written");
    let output = appell()
        .args(["run", "scenarios/slalom.toml", "--out"])
        .arg(file.join("below"))
        .output()
        .expect("runs");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(4), "{text}");
    assert!(
        text.contains("below") && text.contains("hint:") && !text.contains("panicked"),
        "{text}"
    );

    // A limit on the size of files stops the recording midway, as a full disk does.
    let out = folder.join("out");
    let script = format!(
        "trap '' XFSZ; ulimit -f 200; exec {:?} run scenarios/slalom.toml --no-report --out {:?}",
        env!("CARGO_BIN_EXE_appell"),
        out
    );
    let output = Command::new("bash")
        .current_dir(root())
        .args(["-c", &script])
        .output()
        .expect("runs");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(4), "{text}");
    assert!(
        text.contains("recording.mcap") && text.contains("hint:") && !text.contains("panicked"),
        "{text}"
    );
    let recording = Recording::read(&out.join("recording.mcap")).expect("what was recorded stays");
    assert!(
        recording.times.len() > 100,
        "{} rows",
        recording.times.len()
    );
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// The debug build records the same bytes as this one. `cargo xtask test` builds it beforehand.
#[test]
fn invariant_debug_and_release_record_the_same_bytes() {
    let this = PathBuf::from(env!("CARGO_BIN_EXE_appell"));
    let profile = this
        .parent()
        .and_then(Path::file_name)
        .expect("target/PROFILE/appell")
        .to_owned();
    let other = if profile == "debug" {
        "release"
    } else {
        "debug"
    };
    let other = this
        .parent()
        .and_then(Path::parent)
        .expect("target")
        .join(other)
        .join("appell");
    assert!(
        other.exists(),
        "{} is missing: run the tests by `cargo xtask test`",
        other.display()
    );
    let folder = scratch("profiles");
    for scenario in ["slalom", "noisy", "coast", "eight"] {
        let mut files = Vec::new();
        for (name, binary) in [("this", &this), ("other", &other)] {
            let out = folder.join(format!("{scenario}-{name}"));
            let status = Command::new(binary)
                .current_dir(root())
                .args([
                    "run",
                    &format!("scenarios/{scenario}.toml"),
                    "--no-report",
                    "--out",
                ])
                .arg(&out)
                .stdout(Stdio::null())
                .status()
                .expect("runs");
            assert!(status.success(), "{scenario}");
            files.push(std::fs::read(out.join("recording.mcap")).expect("recorded"));
        }
        assert!(files[0] == files[1], "{scenario}: debug and release differ");
    }
    let mut roots = Vec::new();
    for (name, binary) in [("this", &this), ("other", &other)] {
        for lanes in ["1", "4", "8"] {
            let out = folder.join(format!("batch-{name}-{lanes}"));
            let more = ["--trials", "300", "--lanes", lanes];
            assert!(batch(binary, &out, &more).status().expect("ends").success());
            roots.push(root_of(&out));
        }
    }
    roots.dedup();
    assert_eq!(roots.len(), 1, "debug and release batches differ");
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// Every scenario of the repository runs: those with a task pass it, the others go to their end.
#[test]
fn invariant_shipped_scenarios_pass() {
    let folder = scratch("shipped");
    let mut passed = 0;
    for entry in std::fs::read_dir(root().join("scenarios")).expect("shipped") {
        let path = entry.expect("listed").path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let output = appell()
            .args(["run", "--json", "--no-report", "--no-recording", "--out"])
            .arg(&folder)
            .arg(&path)
            .output()
            .expect("runs");
        let name = path.display();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{name}: {text}");
        let summary: serde_json::Value =
            serde_json::from_slice(&output.stdout).expect("JSON on standard output");
        for robot in summary["robots"].as_array().expect("robots") {
            let expected = if robot["task"] == "none" {
                "stopped"
            } else {
                "passed"
            };
            assert_eq!(robot["verdict"], expected, "{name}: {robot}");
            passed += usize::from(expected == "passed");
        }
    }
    assert!(passed >= 14, "{passed} tasks are passed");
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// What a command cannot do with its words is refused with the rule, and exit code 2.
#[test]
fn refusal_of_words() {
    let folder = scratch("words");
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    std::fs::write(folder.join("few.csv"), "t,x,y,yaw\n0,0,0,0\n1,1,0,0\n").expect("written");
    std::fs::write(folder.join("text.mcap"), "no recording").expect("written");
    let out = path("run");
    let recorded = appell()
        .args(["run", "scenarios/homing.toml", "--no-report", "--out", &out])
        .output()
        .expect("runs");
    assert!(recorded.status.success());
    let recording = path("run/recording.mcap");
    let plot = ["plot", &recording, "pose.x"];
    for (start, words, says) in [
        (
            &plot[..],
            &["--from", "900"][..],
            "must be a span within 0 s",
        ),
        (&plot[..], &["--from", "3", "--to", "1"], "got 3 s … 1 s"),
        (
            &plot[..],
            &["--out", "plot.pdf"],
            "must end in .svg or .png",
        ),
        (
            &["check", "robots/three-wheeler.toml"],
            &["--set", "body.mass=3"],
            "must be a scenario where values are set",
        ),
        (
            &["run", "scenarios/homing.toml", "scenarios/homing.toml"],
            &["--no-report", "--out", &out],
            "both would write to",
        ),
        (
            &["inverse", "scenarios/slalom.toml"],
            &["--robot", "bob"],
            "--robot: must be one of tri, got bob",
        ),
        (
            &["inverse", "scenarios/slalom.toml"],
            &["--of", &path("none.csv")],
            "cannot be read",
        ),
        (
            &["inverse", "scenarios/slalom.toml"],
            &["--of", &path("few.csv")],
            "must have at least 4 rows, got 2",
        ),
        (
            &["inverse", "scenarios/slalom.toml"],
            &["--of", &path("text.mcap")],
            "text.mcap",
        ),
        (
            &["inverse", "scenarios/gate.toml"],
            &["--of", &recording],
            "must hold the signal robot.",
        ),
        (
            &["inverse", "scenarios/slalom.toml"],
            &["--of", &path("few.csv"), "--ahead", "0"],
            "must be a point off the axle, got 0 m",
        ),
        (
            &["inverse", "scenarios/sleigh.toml"],
            &[],
            "must plan a path",
        ),
    ] {
        let output = appell().args(start).args(words).output().expect("runs");
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{start:?} {words:?}: {text}");
        assert!(text.contains(says), "{start:?} {words:?}: {text}");
    }
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// Exit codes, a report under 2 MB, and everything a run promises to write.
#[test]
fn invariant_a_run_writes_what_it_says() {
    let folder = scratch("files");
    let output = appell()
        .args(["run", "scenarios/slalom.toml", "--csv", "--json", "--out"])
        .arg(&folder)
        .output()
        .expect("runs");
    assert_eq!(output.status.code(), Some(0));
    let summary: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("JSON on standard output");
    assert_eq!(summary["verdict"], "passed");
    for file in [
        "recording.mcap",
        "recording.csv",
        "summary.json",
        "scenario.toml",
        "report.html",
        "trajectory.svg",
        "trajectory.png",
    ] {
        assert!(folder.join(file).exists(), "{file}");
    }
    let report = std::fs::read_to_string(folder.join("report.html")).expect("read");
    assert!(report.len() < 2_000_000 && report.contains("<svg"));
    assert!(
        !report.contains("http://") || report.contains("http://www.w3.org"),
        "works offline"
    );
    // The resolved scenario runs again to the same recording.
    let again = folder.join("again");
    let status = appell()
        .arg("run")
        .arg(folder.join("scenario.toml"))
        .args(["--no-report", "--out"])
        .arg(&again)
        .stdout(Stdio::null())
        .status()
        .expect("runs");
    assert!(status.success());
    let columns = |path: PathBuf| Recording::read(&path).expect("reads").columns;
    assert!(columns(folder.join("recording.mcap")) == columns(again.join("recording.mcap")));

    let failed = appell()
        .args([
            "run",
            "scenarios/slalom.toml",
            "--set",
            "time.duration=2",
            "--no-report",
            "--out",
        ])
        .arg(folder.join("f"))
        .output()
        .expect("runs");
    assert_eq!(failed.status.code(), Some(1));
    let wrong = appell()
        .args(["run", "scenarios/none.toml"])
        .output()
        .expect("runs");
    assert_eq!(wrong.status.code(), Some(2));
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// The other commands do what they say.
#[test]
fn invariant_commands_work() {
    let folder = scratch("commands");
    let run = |arguments: &[&str]| {
        let output = appell().args(arguments).output().expect("runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {text}");
        text
    };
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    assert!(run(&["check", "robots/three-wheeler.toml"]).contains("degree of mobility"));
    assert!(run(&["check", "scenarios/slope.toml"]).contains("valid scenario"));
    run(&["run", "scenarios/homing.toml", "--out", &path("run")]);
    assert!(run(&["plot", &path("run/recording.mcap")]).contains("twist.forward"));
    run(&[
        "plot",
        &path("run/recording.mcap"),
        "twist.forward",
        "voltage",
        "--out",
        &path("plot.png"),
    ]);
    run(&[
        "plot",
        &path("run/recording.mcap"),
        "pose.x",
        "--out",
        &path("plot.svg"),
    ]);
    assert!(
        run(&[
            "compare",
            "scenarios/compare.toml",
            "--out",
            &path("compare")
        ])
        .contains("kinematic")
    );
    let check = run(&["check", "robots/three-wheeler.toml", "--equations"]);
    assert!(check.contains("equations of motion"), "{check}");
    let latex = run(&["check", "robots/three-wheeler.toml", "--equations", "latex"]);
    assert!(
        latex.contains("\\begin{pmatrix} 12.000000 & 0.000000"),
        "{latex}"
    );
    let planned = run(&["inverse", "scenarios/slalom.toml", "-o", &path("a.csv")]);
    assert!(planned.contains("within all limits"), "{planned}");
    let recorded = run(&[
        "inverse",
        "scenarios/homing.toml",
        "--of",
        &path("run/recording.mcap"),
        "--out",
        &path("b.csv"),
    ]);
    assert!(recorded.contains("wheel.left.torque"), "{recorded}");
    run(&["new", &path("mine")]);
    run(&[
        "run",
        &path("mine/scenario.toml"),
        "--out",
        &path("mine/run"),
    ]);
    assert!(run(&["schema"]).contains("\"$schema\""));
    assert!(run(&["completions", "bash"]).contains("appell"));
    for help in [&["--help"][..], &["run", "--help"], &["check", "--help"]] {
        assert!(run(help).len() > 200);
    }
    std::fs::remove_dir_all(&folder).expect("removed");
}
