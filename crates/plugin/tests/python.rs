//! A plug-in in Python, through the module in `sdk/python`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use appell_plugin::{Limits, Plugin, wire::Call};
use serde_json::json;

/// A file in a folder of its own.
fn file(name: &str, text: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("appell-plugin-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = folder.join(format!("{name}.py"));
    std::fs::write(&file, text).expect("a file");
    file
}

fn open(name: &str, text: &str) -> Result<Plugin, appell_plugin::Fault> {
    Plugin::open(&file(name, text), Limits::default())
}

const SUM: &str = r#"
from appell_plugin import controller

@controller(
    inputs={"pose.x": "m", "pose.y": "m"},
    outputs={"command.forward": ("m/s", -10.0, 10.0)},
    parameters={"gain": (2.0, "1/s", 0.0, 5.0)},
)
def total(now, inputs, parameters, memory):
    """Sums what it sees."""
    memory["sum"] = memory.get("sum", 0.0) + inputs["pose.x"] * parameters["gain"]
    print("seen", inputs["pose.y"])
    if now.before is not None:
        memory["sum"] += now.before["command.forward"]
    return {"command.forward": memory["sum"] + now.dt + 1.0 / inputs["pose.y"]}
"#;

#[test]
fn known_answer_steps_of_two_members() {
    let mut plugin = open("sum", SUM).expect("a plug-in");
    assert_eq!(plugin.descriptor().name, "total");
    assert_eq!(plugin.descriptor().about, "Sums what it sees.");
    let gain = BTreeMap::from([("gain".to_owned(), 3.0)]);
    let first = plugin.create(&gain, &json!({})).expect("a member");
    let second = plugin
        .create(&BTreeMap::new(), &json!({}))
        .expect("a member");
    let mut out = [0.0; 2];
    plugin
        .step(first, 0.0, 0.5, &[1.0, 1.0], &mut out[..1])
        .expect("a step");
    assert_eq!(out[0], 4.5);
    let call = |member, input| Call {
        member,
        t: 0.5,
        dt: 0.5,
        input,
    };
    let calls = [call(first, &[0.1, 1.0]), call(second, &[1.0, 2.0])];
    plugin.step_many(&calls, &mut out).expect("steps");
    assert_eq!(out, [3.0 + 0.1 * 3.0 + 0.5 + 1.0, 2.0 + 0.5 + 0.5]);
    // What one remembers another can go on from.
    let memory = plugin.save(first).expect("bytes");
    plugin.restore(second, &memory).expect("taken");
    plugin.take_over(second, &[0.25]).expect("taken");
    plugin
        .step(second, 1.0, 0.5, &[0.0, 1.0], &mut out[..1])
        .expect("a step");
    assert_eq!(out[0], 3.0 + 0.1 * 3.0 + 0.25 + 0.5 + 1.0);
    plugin.destroy(first);
    assert!(
        plugin
            .step(first, 1.0, 0.5, &[0.0, 1.0], &mut out[..1])
            .is_err()
    );
    assert!(plugin.is_alive());
}

#[test]
fn refusal_of_what_a_step_gives() {
    let mut plugin = open("limits", SUM).expect("a plug-in");
    let member = plugin
        .create(&BTreeMap::new(), &json!({}))
        .expect("a member");
    let mut out = [7.0];
    let mut step = |input: [f64; 2]| {
        let fault = plugin.step(member, 0.0, 0.0, &input, &mut out);
        (fault.expect_err("a fault").to_string(), out[0])
    };
    let (text, left) = step([0.0, 0.0]);
    assert_eq!(
        text,
        "step: ZeroDivisionError: float division by zero (limits.py, line 15)"
    );
    assert_eq!(left, 7.0);
    let (text, _) = step([5.0, 1.0]);
    assert_eq!(
        text,
        "outputs.command.forward: must be at most 10 m/s, got 11"
    );
    let (text, _) = step([f64::NAN, 1.0]);
    assert_eq!(text, "outputs.command.forward: must be finite, got NaN");
    for (name, value, expected) in [
        ("gain", 6.0, "parameters.gain: must be at most 5 1/s, got 6"),
        (
            "gian",
            1.0,
            "parameters.gian: must be a parameter of the plug-in",
        ),
    ] {
        let fault = plugin.create(&BTreeMap::from([(name.to_owned(), value)]), &json!({}));
        assert_eq!(fault.expect_err("a fault").to_string(), expected);
    }
}

#[test]
fn refusal_of_files_that_are_no_controllers() {
    for (name, text, expected) in [
        (
            "empty",
            "",
            "describe: ValueError: the file must have one function marked @controller, got none",
        ),
        ("syntax", "def", "describe: SyntaxError: invalid syntax"),
        (
            "raises",
            "1 / 0",
            "describe: ZeroDivisionError: division by zero (raises.py, line 1)",
        ),
        (
            "exits",
            "import sys; sys.exit(3)",
            "describe: ended without an answer (exit status: 3)",
        ),
        (
            "import",
            "import nothing_of_that_name",
            "describe: ModuleNotFoundError: No module named 'nothing_of_that_name' (import.py, line 1)",
        ),
    ] {
        let fault = open(name, text).expect_err("a fault").to_string();
        assert!(fault.starts_with(expected), "{name}: {fault}");
    }
}
