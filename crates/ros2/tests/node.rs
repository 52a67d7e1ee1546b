//! The node against an independent implementation of DDS in another process: the Python package cyclonedds, with
//! the names of ROS 2. Where it is not installed these tests say so, and are none.
#![cfg(unix)]

use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

const TESTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");

fn has_peer(test: &str) -> bool {
    let found = python().args(["-c", "import cyclonedds"]).output();
    let found = found.is_ok_and(|found| found.status.success());
    if !found {
        let told = format!("{test} tests nothing: Python lacks the module cyclonedds\n");
        // What is printed otherwise is not shown of a test that passes.
        std::io::stderr()
            .write_all(told.as_bytes())
            .expect("written");
    }
    found
}

fn python() -> Command {
    Command::new(std::env::var_os("APPELL_PYTHON").unwrap_or_else(|| "python3".into()))
}

/// A domain of its own for each test of each process, so that nobody else is met there.
fn domain(test: u32) -> String {
    (100 + (std::process::id() * 4 + test) % 120).to_string()
}

/// The node, which ends with the test, and of which one runs at a time: all are in a hurry.
struct Node {
    child: Child,
    _turn: std::sync::MutexGuard<'static, ()>,
}

static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());

impl Node {
    fn start(domain: &str, more: &[&str]) -> Node {
        let turn = TURN
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        let scenario = format!("{}/../../scenarios/ros.toml", env!("CARGO_MANIFEST_DIR"));
        let child = Command::new(env!("CARGO_BIN_EXE_appell-ros"))
            .args([&scenario, "--domain", domain])
            .args(more)
            .stdout(Stdio::null())
            .spawn();
        Node {
            child: child.expect("the node starts"),
            _turn: turn,
        }
    }

    fn is_alive(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn peer(script: &str, arguments: &[&str]) -> Output {
    let output = python()
        .arg(Path::new(TESTS).join(script))
        .args(arguments)
        .output()
        .expect("Python");
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(output.status.success(), "{script}: {out}{err}");
    output
}

/// A minute of the simulation: commands in at 15 Hz, odometry out at 50 Hz without a loss.
#[test]
fn peer_the_circle_of_the_blog_over_dds() {
    if !has_peer("peer_the_circle_of_the_blog_over_dds") {
        return;
    }
    let domain = domain(0);
    let mut node = Node::start(&domain, &["--pace", "3", "--cmd-vel-timeout", "2.4"]);
    let output = peer("drive.py", &[&domain, "60", "2.4"]);
    assert!(node.is_alive());
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let stamps: Vec<i64> = { told["stamps"].as_array().expect("stamps").iter() }
        .map(|stamp| stamp.as_i64().expect("a time"))
        .collect();
    assert!(stamps.len() >= 2990, "{}", stamps.len());
    for pair in stamps.windows(2) {
        assert_eq!(pair[1] - pair[0], 20_000_000, "{pair:?}");
    }
    let number = |value: &Value| value.as_f64().expect("a number");
    for (wheel, rate) in [("left", 2.5), ("right", 7.5)] {
        for end in 0..2 {
            assert!(
                (number(&told[wheel][end]) - rate).abs() < 1e-9,
                "{wheel}: {}",
                told[wheel]
            );
        }
    }
    assert!(number(&told["spread"]) < 1e-6, "{}", told["spread"]);
    assert_eq!(number(&told["still"]), 0.0);
    let after = number(&told["stopped_after"]);
    assert!((2.2..2.7).contains(&after), "{after}");
    assert_eq!(told["frames"]["base_link"], "odom");
    assert_eq!(told["frames"]["left"], "base_link");
    assert_eq!(told["fixed"][0][0], "world");
    assert_eq!(number(&told["fixed"][0][2]), 2.0);
}

/// Two runs in lock-step with a controller in another process hear the same, bit for bit.
#[test]
fn invariant_lock_step_repeats() {
    if !has_peer("invariant_lock_step_repeats") {
        return;
    }
    let domain = domain(1);
    let told = || {
        let _node = Node::start(
            &domain,
            &[
                "--lock-step",
                "--rate",
                "50",
                "--set",
                "robot.bubble.level=\"rolling\"",
            ],
        );
        String::from_utf8(peer("lockstep.py", &[&domain, "500"]).stdout).expect("text")
    };
    let first = told();
    assert!(first.starts_with("50"), "{first}");
    assert_eq!(first, told());
}

#[test]
fn invariant_hostile_peers_do_not_stop_the_node() {
    if !has_peer("invariant_hostile_peers_do_not_stop_the_node") {
        return;
    }
    let domain = domain(2);
    let seconds = std::env::var("APPELL_HOSTILE_SECONDS").unwrap_or_else(|_| "8".to_owned());
    let mut node = Node::start(&domain, &[]);
    peer("hostile.py", &[&domain, &seconds, "1"]);
    assert!(node.is_alive());
}

/// Every socket of the node stays on the loopback interface, unless it is told otherwise.
#[cfg(target_os = "linux")]
#[test]
fn invariant_loopback_alone() {
    let domain_id = domain(3);
    let _node = Node::start(&domain_id, &[]);
    let port = 7400 + 250 * domain_id.parse::<u16>().expect("a number") + 10;
    let bound = || {
        let listed = Command::new("ss")
            .args(["-H", "-u", "-l", "-n"])
            .output()
            .expect("ss");
        let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
        let of = |line: &&str| {
            let place = line.split_whitespace().nth(3).unwrap_or_default();
            let own = place
                .rsplit(':')
                .next()
                .and_then(|port| port.parse::<u16>().ok());
            own.is_some_and(|own| (port - 10..port + 10).contains(&own))
        };
        listed
            .lines()
            .filter(of)
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(10);
    loop {
        let lines = bound();
        let done = !lines.is_empty()
            && lines
                .iter()
                .all(|line| line.contains("%lo:") || line.contains("127.0.0.1:"));
        if done {
            return;
        }
        assert!(std::time::Instant::now() < deadline, "{lines:#?}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}
