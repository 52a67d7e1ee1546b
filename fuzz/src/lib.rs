//! Rules that more than one target holds plug-ins to.

use std::collections::BTreeSet;

use appell_plugin::{Descriptor, Fault};

/// Most ports of a kind.
const PORTS_MAX: usize = 1024;
/// More than the longest fault, characters.
const FAULT_MAX: usize = 1000;

/// A fault must have words, on a line that any terminal can show.
pub fn check_fault(fault: &Fault) {
    let told = fault.to_string();
    assert!(
        !fault.field.is_empty() && !fault.problem.trim().is_empty(),
        "{told:?}"
    );
    assert!(!told.contains(char::is_control), "{told:?}");
    assert!(told.chars().count() <= FAULT_MAX, "{told:?}");
}

/// What is accepted of a description must keep its rules, and be read again as it was written.
pub fn check_descriptor(descriptor: &Descriptor) {
    let Descriptor {
        inputs,
        outputs,
        parameters,
        ..
    } = descriptor;
    assert!(!outputs.is_empty());
    check_names(inputs.iter().map(|port| port.name.as_str()));
    check_names(outputs.iter().map(|port| port.name.as_str()));
    check_names(parameters.iter().map(|parameter| parameter.name.as_str()));
    for output in outputs {
        check_limits(output.min, output.max);
    }
    for parameter in parameters {
        check_limits(parameter.min, parameter.max);
        assert!(parameter.default.is_finite());
        assert!(parameter.min.is_none_or(|min| min <= parameter.default));
        assert!(parameter.max.is_none_or(|max| parameter.default <= max));
    }
    let written = serde_json::to_value(descriptor).expect("a descriptor is JSON");
    let again = appell_plugin::fuzz::descriptor(written).expect("it was accepted before");
    assert_eq!(again, *descriptor);
}

fn check_names<'a>(names: impl Iterator<Item = &'a str>) {
    let mut seen = BTreeSet::new();
    for name in names {
        assert!(!name.is_empty() && name.is_ascii() && !name.contains(['/', '\\', ' ']));
        assert!(seen.insert(name), "{name:?} twice");
    }
    assert!(seen.len() <= PORTS_MAX);
}

fn check_limits(min: Option<f64>, max: Option<f64>) {
    assert!(!min.is_some_and(f64::is_nan) && !max.is_some_and(f64::is_nan));
    if let (Some(min), Some(max)) = (min, max) {
        assert!(min <= max);
    }
}
