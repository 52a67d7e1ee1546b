//! Studies through the program: the wheel-legged robot, slip towards rolling; files, answers, refusals.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn scratch(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("appell-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn appell(arguments: &[&str], out: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_appell"));
    command.args(arguments).arg("--out").arg(out);
    command.output().expect("starts")
}

fn json(output: &Output) -> Value {
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// All six columns in the order of the impulses, the pictures beside them.
#[test]
fn known_answer_order_of_waves() {
    let out = scratch("uneven");
    let answer = json(&appell(&["uneven", "--json"], &out));
    for (column, order) in answer["orders"].as_object().expect("a table") {
        assert_eq!(order, "impulses", "{column}");
        let of = |wave: &str| {
            answer["deviations"][wave][column]
                .as_f64()
                .expect("a number")
        };
        assert!(
            of("square") > of("sine") && of("sine") > of("triangle"),
            "{column}"
        );
    }
    for name in ["figures.svg", "figures.png", "orders.svg", "orders.png"] {
        assert!(
            out.join(name).metadata().is_ok_and(|m| m.len() > 1000),
            "{name}"
        );
    }
    let again = scratch("uneven-again");
    appell(&["uneven", "--json"], &again);
    let bytes = |folder: &Path| std::fs::read(folder.join("orders.svg")).expect("written");
    assert!(
        bytes(&out) == bytes(&again),
        "the same study gives the same bytes"
    );
}

/// The three obstacles of the book are crossed, each with a page that needs nothing else.
#[test]
fn known_answer_crossings() {
    for (arguments, strategy) in [
        (
            ["obstacle", "--json", "--step", "0.15"].as_slice(),
            "climb_step",
        ),
        (
            &["obstacle", "--json", "--trench", "0.2", "0.3"],
            "bridge_trench",
        ),
        (
            &["obstacle", "--json", "--trench", "0.3", "0.2"],
            "descend_climb",
        ),
    ] {
        let out = scratch(strategy);
        let answer = json(&appell(arguments, &out));
        assert_eq!(answer["strategy"], strategy);
        assert_eq!(answer["crossed"], true, "{answer}");
        let page = std::fs::read_to_string(out.join("crossing.html")).expect("written");
        assert!(
            page.contains("id=\"play\"") && !page.contains("src=") && !page.contains("import ")
        );
        for name in [
            "crossing.svg",
            "crossing.png",
            "strategies.svg",
            "strategies.png",
        ] {
            assert!(
                out.join(name).metadata().is_ok_and(|m| m.len() > 1000),
                "{name}"
            );
        }
    }
}

/// To turn away is an answer; to be stopped on the way is a failure with its place.
#[test]
fn refusal_of_crossings() {
    let out = scratch("turned");
    let turned = appell(&["obstacle", "--step", "0.3"], &out);
    assert_eq!(turned.status.code(), Some(0));
    assert!(!out.join("crossing.html").exists());
    let stopped = appell(
        &["obstacle", "--trench", "0.6", "0.25"],
        &scratch("stopped"),
    );
    assert_eq!(stopped.status.code(), Some(1));
    let text = String::from_utf8_lossy(&stopped.stdout);
    assert!(
        text.contains("not crossed") && text.contains("front hinge at"),
        "{text}"
    );
}

/// What is wrong is named with its option, its rule and its value.
#[test]
fn refusal_of_bad_options() {
    for (arguments, words) in [
        (["uneven", "--mass", "0"].as_slice(), "--mass: must be in"),
        (&["uneven", "--period", "nan"], "--period: must be in"),
        (
            &["uneven", "--friction", "1.5"],
            "--friction: must be in [0, 1], got 1.5",
        ),
        (
            &["uneven", "--sampling", "1e-9"],
            "hint: 0 is for continuous forces",
        ),
        (
            &["obstacle", "--step", "150"],
            "hint: lengths are in meters",
        ),
        (&["obstacle", "--trench", "0.2", "nan"], "--trench, depth"),
        (&["obstacle", "--wheel-pitch", "0.1"], "would overlap"),
    ] {
        let out = scratch("refused");
        let output = appell(arguments, &out);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(text.contains(words), "{arguments:?}: {text}");
        assert!(!out.exists());
    }
}

/// Ever stiffer tires come to rolling by the first power, in closed loop; a robot on springs leaves the ground.
#[test]
fn order_slip_towards_rolling() {
    let out = scratch("stiffen");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let scenario = |name: &str| root.join("scenarios").join(name).display().to_string();
    let eight = scenario("eight.toml");
    let mut words = vec!["compare", &eight, "--levels", "rolling,slip", "--drives"];
    words.extend(["torque", "--stiffen", "8"]);
    let output = appell(&words, &out);
    let text = String::from_utf8_lossy(&output.stdout);
    let order = text.lines().find_map(|line| {
        line.strip_prefix("the distance falls by order ")?
            .parse::<f64>()
            .ok()
    });
    assert!(order.is_some_and(|o| (0.95..1.05).contains(&o)), "{text}");
    assert!(out.join("convergence.svg").is_file());
    words[6] = "--stiffen=nan";
    words.truncate(7);
    let output = appell(&words, &out);
    assert_eq!(output.status.code(), Some(2));
    let jump = scenario("jump.toml");
    let output = appell(&["run", &jump, "--record", "csv", "--no-report"], &out);
    assert!(output.status.success());
    let rows = std::fs::read_to_string(out.join("recording.csv")).expect("written");
    let mut rows = rows.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().expect("a header");
    let loads: Vec<usize> = (0..header.len())
        .filter(|&k| header[k].ends_with(".load"))
        .collect();
    let flew = rows.filter(|row| loads.iter().all(|&k| row[k].parse() == Ok(0.0)));
    assert_eq!(loads.len(), 4);
    assert!(flew.count() >= 3, "it leaves the ground at the crest");
}
