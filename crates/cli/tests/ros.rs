//! Bags of ROS 2 through the program: what another reader finds in them, and what a replay makes of them.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn appell(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_appell"));
    command
        .args(arguments)
        .output()
        .expect("the program starts")
}

fn text(output: &Output) -> String {
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    format!("{out}{err}")
}

/// A folder that is not there yet.
fn fresh(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("ros")
        .join(name);
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn word(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

fn scenario(name: &str) -> String {
    format!("{ROOT}/scenarios/{name}")
}

/// Runs a scenario into a folder with a bag.
fn recorded(scenario_file: &str, folder: &Path, more: &[&str]) {
    let file = scenario(scenario_file);
    let mut arguments = vec![
        "run",
        &file,
        "--no-report",
        "--record",
        "ros2",
        "--out",
        word(folder),
    ];
    arguments.extend(more);
    let output = appell(&arguments);
    assert!(output.status.success(), "{}", text(&output));
}

fn replayed(bag: &Path, scenario_file: &str, folder: &Path, more: &[&str]) -> Value {
    let file = scenario(scenario_file);
    let mut arguments = vec![
        "replay",
        word(bag),
        &file,
        "--no-report",
        "--json",
        "--out",
        word(folder),
    ];
    arguments.extend(more);
    let output = appell(&arguments);
    assert!(output.status.success(), "{}", text(&output));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Every field of every message, by the Python package rosbags. Where that is not installed this says so, and
/// is no test.
#[test]
fn peer_rosbags_reads_every_field() {
    let python = std::env::var_os("APPELL_PYTHON").unwrap_or_else(|| "python3".into());
    let found = Command::new(&python)
        .args(["-c", "import rosbags"])
        .output();
    if !found.is_ok_and(|found| found.status.success()) {
        let told =
            "peer_rosbags_reads_every_field tests nothing: Python lacks the module rosbags\n";
        // What is printed otherwise is not shown of a test that passes.
        std::io::stderr()
            .write_all(told.as_bytes())
            .expect("written");
        return;
    }
    let folder = fresh("noisy");
    recorded("noisy.toml", &folder, &["--record", "csv"]);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bag.py");
    let checked = Command::new(&python)
        .args([script, word(&folder.join("ros2"))])
        .args([word(&folder.join("recording.csv")), "burger"])
        .output()
        .expect("Python");
    assert!(checked.status.success(), "{}", text(&checked));
}

#[test]
fn invariant_a_bag_has_the_same_bytes_again() {
    let [first, second] = ["first", "second"].map(fresh);
    recorded("two-robots.toml", &first, &[]);
    recorded("two-robots.toml", &second, &[]);
    for file in ["ros2/ros2_0.mcap", "ros2/metadata.yaml"] {
        let [a, b] = [&first, &second].map(|folder| std::fs::read(folder.join(file)).expect(file));
        assert!(a == b, "{file}");
    }
    // A run without a bag leaves none of an earlier one.
    let file = scenario("two-robots.toml");
    let output = appell(&["run", &file, "--no-report", "--out", word(&first)]);
    assert!(output.status.success(), "{}", text(&output));
    assert!(!first.join("ros2/metadata.yaml").exists());
}

/// The noise of a replay is that of the run, so that nothing is left between the two.
#[test]
fn closed_form_a_replay_is_the_run_again() {
    let folder = fresh("again");
    recorded("noisy.toml", &folder, &[]);
    let bag = folder.join("ros2");
    let same = replayed(&bag, "noisy.toml", &fresh("again-replay"), &[]);
    assert!(
        same["position_max"].as_f64().expect("a number") < 1e-9,
        "{same}"
    );
    assert!(same["yaw_max"].as_f64().expect("a number") < 1e-9, "{same}");
    assert!(same["distance"].as_f64().expect("a number") > 1.0, "{same}");
    // Believing its track a tenth wider it turns less, which is to be seen.
    let wider = ["--set", "robot.burger.sensor.odometry.track_scale=1.1"];
    let other = replayed(&bag, "noisy.toml", &fresh("wider-replay"), &wider);
    assert!(
        other["yaw_max"].as_f64().expect("a number") > 0.05,
        "{other}"
    );
}

#[test]
fn refusal_bags_that_cannot_be_replayed() {
    let folder = fresh("refused");
    recorded("two-robots.toml", &folder, &[]);
    let bag = folder.join("ros2");
    let file = scenario("two-robots.toml");
    let refused = |bag: &Path, more: &[&str], words: &[&str]| {
        let mut arguments = vec!["replay", word(bag), &file];
        arguments.extend(more);
        let output = appell(&arguments);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        for word in words {
            assert!(text(&output).contains(word), "{word}: {}", text(&output));
        }
    };
    // Two robots drove: whose commands?
    refused(&bag, &[], &["/p3dx/cmd_vel", "/tri/cmd_vel", "--cmd-vel"]);
    refused(
        &bag,
        &["--cmd-vel", "/none"],
        &["--cmd-vel", "/none", "/tri/cmd_vel"],
    );
    refused(&bag, &["--robot", "none"], &["--robot", "p3dx, tri"]);
    refused(&folder.join("nowhere.mcap"), &[], &["nowhere.mcap"]);
    let damaged = folder.join("damaged.mcap");
    let mut bytes = std::fs::read(bag.join("ros2_0.mcap")).expect("a bag");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xff;
    std::fs::write(&damaged, &bytes).expect("written");
    refused(&damaged, &[], &["damaged.mcap"]);
    let sqlite = folder.join("sqlite");
    std::fs::create_dir_all(&sqlite).expect("a folder");
    std::fs::write(sqlite.join("bag_0.db3"), b"SQLite format 3").expect("written");
    refused(&sqlite, &[], &["SQLite", "ros2 bag convert"]);
}

fn imported(name: &str, more: &[&str]) -> (Output, PathBuf) {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("ros-import");
    std::fs::create_dir_all(&folder).expect("a folder");
    let out = folder.join(format!("{name}.toml"));
    let _ = std::fs::remove_file(&out);
    let file = format!("{}/tests/urdf/{name}.urdf", env!("CARGO_MANIFEST_DIR"));
    let mut arguments = vec!["import", &file, "--out", word(&out)];
    arguments.extend(more);
    (appell(&arguments), out)
}

/// Wheels and body of a robot file: mount and radius of each wheel by its name, its mass and inertias, and the
/// body's mass.
fn shape(file: &Path) -> (Vec<(String, Vec<f64>)>, f64) {
    let text = std::fs::read_to_string(file).expect("a robot file");
    let robot: toml::Table = text.parse().expect("TOML");
    let number = |value: &toml::Value| match value {
        toml::Value::Integer(whole) => *whole as f64,
        other => other.as_float().expect("a number"),
    };
    let wheels = robot["wheel"]
        .as_array()
        .expect("wheels")
        .iter()
        .map(|wheel| {
            let mut numbers: Vec<f64> = wheel["mount"]
                .as_array()
                .expect("a place")
                .iter()
                .map(number)
                .collect();
            for key in ["radius", "mass", "spin_inertia", "vertical_inertia"] {
                numbers.push(wheel.get(key).map_or(0.0, number));
            }
            (wheel["name"].as_str().expect("a name").to_owned(), numbers)
        });
    (wheels.collect(), number(&robot["body"]["mass"]))
}

/// The robot files of the project are from the same sources, by hand.
#[test]
fn peer_shapes_of_three_robots() {
    let cases: [(&str, &str, &[&str], &[&str]); 3] = [
        (
            "burger",
            "turtlebot3-burger",
            &["--driven", "left,right"],
            &[
                "link ball: a gyration radius of 0.447",
                "link scanner: a gyration radius",
                "caster",
            ],
        ),
        (
            "husky",
            "husky-a200",
            &["--torque-max", "20", "--rate-max", "6.06"],
            &[],
        ),
        (
            "jackal",
            "jackal",
            &[
                "--driven",
                "front-left,front-right,rear-left,rear-right",
                "--torque-max",
                "10",
                "--rate-max",
                "20.4",
            ],
            &[],
        ),
    ];
    for (name, known, more, told) in cases {
        let (output, made) = imported(name, more);
        assert!(output.status.success(), "{name}: {}", text(&output));
        for words in told {
            assert!(
                text(&output).contains(words),
                "{name}: {words}: {}",
                text(&output)
            );
        }
        let (wheels, mass) = shape(&made);
        let (expected, expected_mass) = shape(Path::new(&format!("{ROOT}/robots/{known}.toml")));
        assert!(
            (mass - expected_mass).abs() < 1e-9,
            "{name}: {mass} {expected_mass}"
        );
        assert_eq!(wheels.len(), expected.len(), "{name}");
        for (wheel, numbers) in expected {
            let got = &wheels
                .iter()
                .find(|(found, _)| *found == wheel)
                .expect(&wheel)
                .1;
            for (k, (got, want)) in got.iter().zip(&numbers).enumerate() {
                // The vertical inertias of the robot files are rounded, or assumed.
                let tolerance = if k == 5 { 0.02 * want } else { 1e-9 };
                assert!(
                    (got - want).abs() <= tolerance,
                    "{name} {wheel} {k}: {got} {want}"
                );
            }
        }
        let checked = appell(&["check", word(&made)]);
        assert!(checked.status.success(), "{name}: {}", text(&checked));
    }
}

#[test]
fn refusal_what_a_urdf_leaves_open_is_asked_for_by_name() {
    let (output, made) = imported("jackal", &[]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(!made.exists());
    for words in ["front-left, front-right, rear-left, rear-right", "--driven"] {
        assert!(text(&output).contains(words), "{words}: {}", text(&output));
    }
    let (output, _) = imported("husky", &["--torque-max", "20"]);
    for words in ["joint front-left", "joint rear-right", "--rate-max"] {
        assert!(text(&output).contains(words), "{words}: {}", text(&output));
    }
    assert!(!text(&output).contains("--torque-max"), "{}", text(&output));
    let (output, _) = imported("burger", &["--driven", "left,middle"]);
    assert!(text(&output).contains("got middle"), "{}", text(&output));
    let (output, _) = imported("burger", &["--driven", "left", "--torque-max", "NaN"]);
    assert!(text(&output).contains("finite"), "{}", text(&output));
}

#[test]
fn refusal_files_that_are_no_urdf() {
    let folder = fresh("no-urdf");
    std::fs::create_dir_all(&folder).expect("a folder");
    let link = |name: &str| format!("<link name=\"{name}\"/>");
    let joint = |name: &str, from: &str, to: &str| {
        format!(
            "<joint name=\"{name}\" type=\"fixed\"><parent link=\"{from}\"/><child link=\"{to}\"/></joint>"
        )
    };
    let robot = |inside: &str| format!("<robot name=\"r\">\n{inside}\n</robot>");
    let cases = [
        ("text", "no markup".to_owned(), ""),
        (
            "entity",
            "<!DOCTYPE r [<!ENTITY x SYSTEM \"/etc/passwd\">]><robot>&x;</robot>".to_owned(),
            "DTD",
        ),
        ("other", "<sdf/>".to_owned(), "must be the element robot"),
        ("empty", robot(""), "must have 1 to"),
        ("macro", robot("<link name=\"${prefix}base\"/>"), "xacro"),
        ("twice", robot(&(link("a") + "\n" + &link("a"))), "line 3"),
        (
            "two",
            robot(&(link("a") + &link("b"))),
            "one link that is no child, got 2: a, b",
        ),
        (
            "ring",
            robot(
                &(link("a")
                    + &link("b")
                    + &link("c")
                    + &joint("j", "b", "c")
                    + &joint("k", "c", "b")),
            ),
            "a ring",
        ),
        (
            "nowhere",
            robot(&(link("a") + &joint("j", "a", "b"))),
            "got \"b\"",
        ),
        (
            "nan",
            robot("<link name=\"a\"><inertial><mass value=\"NaN\"/></inertial></link>"),
            "must be 1 finite numbers, got \"NaN\"",
        ),
        ("wheelless", robot(&link("a")), "must have a wheel"),
    ];
    for (name, content, words) in cases {
        let file = folder.join(format!("{name}.urdf"));
        std::fs::write(&file, content).expect("written");
        let out = folder.join("out.toml");
        let output = appell(&["import", word(&file), "--out", word(&out)]);
        assert_eq!(output.status.code(), Some(2), "{name}: {}", text(&output));
        assert!(text(&output).contains(words), "{name}: {}", text(&output));
        assert!(!out.exists(), "{name}");
    }
    // A link out of the folder is not followed.
    #[cfg(unix)]
    {
        let outside = format!("{}/tests/urdf/burger.urdf", env!("CARGO_MANIFEST_DIR"));
        let inside = folder.join("inside.urdf");
        std::os::unix::fs::symlink(&outside, &inside).expect("a link");
        let refused = appell(&["import", word(&inside), "--driven", "left,right"]);
        assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
        assert!(text(&refused).contains("--root"), "{}", text(&refused));
    }
}
