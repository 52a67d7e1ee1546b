//! The node over Zenoh against the Python package eclipse-zenoh, with the keys and what stands beside messages of
//! rmw_zenoh. Where it is not installed this says so, and is no test.
#![cfg(all(unix, feature = "zenoh"))]

use std::io::Write;
use std::process::{Child, Command, Stdio};

use serde_json::Value;

struct Node(Child);

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn peer_the_circle_of_the_blog_over_zenoh() {
    let python = std::env::var_os("APPELL_PYTHON").unwrap_or_else(|| "python3".into());
    let found = Command::new(&python).args(["-c", "import zenoh"]).output();
    if !found.is_ok_and(|found| found.status.success()) {
        let told =
            "peer_the_circle_of_the_blog_over_zenoh tests nothing: Python lacks the module zenoh\n";
        std::io::stderr()
            .write_all(told.as_bytes())
            .expect("written");
        return;
    }
    let port = 20_000 + std::process::id() % 20_000;
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let root = env!("CARGO_MANIFEST_DIR");
    let node = Command::new(env!("CARGO_BIN_EXE_appell-ros"))
        .arg(format!("{root}/../../scenarios/ros.toml"))
        .args(["--domain", "7", "--namespace", "fleet"])
        .arg(format!("--zenoh={endpoint}"))
        .stdout(Stdio::null())
        .spawn();
    // It begins before there is anybody to reach.
    let mut node = Node(node.expect("it starts"));
    let output = Command::new(&python)
        .arg(format!("{root}/tests/zenoh_peer.py"))
        .args([&endpoint, "60"])
        .output()
        .expect("Python");
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(output.status.success(), "{out}{err}");
    assert!(node.0.try_wait().expect("a child").is_none());
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let stamps: Vec<i64> = { told["stamps"].as_array().expect("stamps").iter() }
        .map(|stamp| stamp.as_i64().expect("a time"))
        .collect();
    assert!(stamps.len() >= 2990, "{}", stamps.len());
    for pair in stamps.windows(2) {
        assert_eq!(pair[1] - pair[0], 20_000_000, "{pair:?}");
    }
    let number = |value: &Value| value.as_f64().expect("a number");
    for (wheel, rate) in [(0, 2.5), (1, 7.5)] {
        let got = number(&told["rates"][wheel]);
        assert!((got - rate).abs() < 1e-9, "{wheel}: {got}");
    }
    assert_eq!(told["after"], serde_json::json!([0.0, 0.0]));
    assert_eq!(told["fixed"], serde_json::json!(["world", "odom", 2.0]));
    assert_eq!(told["frames"]["base_link"], "odom");
}
