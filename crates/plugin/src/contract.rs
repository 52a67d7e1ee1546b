//! What a plug-in says of itself.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::wire::PROTOCOL;

/// Most ports, and most parameters, of a plug-in.
pub(crate) const PORTS_MAX: usize = 1024;
/// Longest path of what is wrong, characters: names in it may be as long as they like.
const FIELD_MAX: usize = 300;
/// Longest text on what is wrong, characters.
const PROBLEM_MAX: usize = 600;
/// Longest name of anything, bytes.
const NAME_MAX: usize = 200;

/// What went wrong at the border.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field}: {problem}")]
pub struct Fault {
    /// Where: `file`, `start`, `describe`, `parameters.NAME`, `step`, `outputs.NAME` and so on.
    pub field: String,
    /// What.
    pub problem: String,
    /// What would do, where that is known.
    pub hint: String,
}

impl Fault {
    /// What comes from outside is cut to a length that fits a line or two, and a terminal.
    pub(crate) fn new(field: impl Into<String>, problem: impl Into<String>) -> Self {
        let mut problem = short(&problem.into(), PROBLEM_MAX);
        if problem.trim().is_empty() {
            problem = "gave no reason".into();
        }
        Fault {
            field: short(&field.into(), FIELD_MAX),
            problem,
            hint: String::new(),
        }
    }

    pub(crate) fn hint(self, hint: impl Into<String>) -> Self {
        Fault {
            hint: hint.into(),
            ..self
        }
    }
}

/// The beginning of a text, of so many characters, on one line.
fn short(text: &str, length: usize) -> String {
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    let mut short: String = text.chars().take(length).map(plain).collect();
    if text.chars().nth(length).is_some() {
        short.push('…');
    }
    short
}

/// A plug-in as it describes itself.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Descriptor {
    /// Version of the messages that it speaks.
    pub protocol: u32,
    /// Name.
    pub name: String,
    /// Version, in its own counting.
    #[serde(default)]
    pub version: String,
    /// One line for people.
    #[serde(default)]
    pub about: String,
    /// What it reads, in the order of its inputs.
    pub inputs: Vec<Port>,
    /// What it writes, in the order of its outputs.
    pub outputs: Vec<Output>,
    /// What can be set.
    #[serde(default)]
    pub parameters: Vec<Parameter>,
}

/// A signal that is read, by its path below the robot.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Port {
    /// Path below the robot, such as `pose.x`.
    pub name: String,
    /// Unit, as `appell run` lists it.
    pub unit: String,
}

/// A signal that is written.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// Path below the robot, such as `command.forward`.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Least value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

/// A number that can be set.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Unit.
    #[serde(default)]
    pub unit: String,
    /// Value where none is given.
    pub default: f64,
    /// Least value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// One line for people.
    #[serde(default)]
    pub about: String,
}

impl Output {
    /// Least and largest value that is let through; those between them are as well, and no others.
    pub(crate) fn range(&self) -> [f64; 2] {
        let least = self.min.map_or(f64::MIN, |min| min.max(f64::MIN));
        let largest = self.max.map_or(f64::MAX, |max| max.min(f64::MAX));
        [least, largest]
    }

    /// Lets a value through, or says why not.
    #[cold]
    pub(crate) fn admit(&self, value: f64) -> Result<(), Fault> {
        let refuse = |problem: String| Err(Fault::new(format!("outputs.{}", self.name), problem));
        if !value.is_finite() {
            return refuse(format!("must be finite, got {value}"));
        }
        match range(self.min, self.max, value) {
            None => Ok(()),
            Some(limit) => refuse(format!("must be {limit} {}, got {value}", self.unit)),
        }
    }
}

/// The limit that a value breaks, in words.
fn range(min: Option<f64>, max: Option<f64>, value: f64) -> Option<String> {
    match (min, max) {
        (Some(min), _) if value < min => Some(format!("at least {min}")),
        (_, Some(max)) if value > max => Some(format!("at most {max}")),
        _ => None,
    }
}

impl Descriptor {
    /// Reads what a plug-in says of itself, and refuses what no host could make sense of.
    pub(crate) fn read(value: Value) -> Result<Descriptor, Fault> {
        // A description from another version may have other fields: the version comes first.
        if value["protocol"] != json!(PROTOCOL) {
            let got = &value["protocol"];
            let problem = format!("must be {PROTOCOL}, the version of the messages, got {got}");
            return Err(Fault::new("describe.protocol", problem)
                .hint("take an SDK that goes with this version of Appell"));
        }
        let descriptor: Descriptor = serde_json::from_value(value)
            .map_err(|error| Fault::new("describe", error.to_string()))?;
        descriptor.check()?;
        Ok(descriptor)
    }

    /// Refuses what no host could make sense of.
    fn check(&self) -> Result<(), Fault> {
        let refuse = |field: String, problem: String| Err(Fault::new(field, problem));
        let inputs = self.inputs.iter().map(|port| (&port.name, &port.unit));
        let outputs = self.outputs.iter().map(|port| (&port.name, &port.unit));
        let parameters = self.parameters.iter().map(|p| (&p.name, &p.unit));
        check_names("inputs", inputs)?;
        check_names("outputs", outputs)?;
        check_names("parameters", parameters)?;
        let limited = self
            .outputs
            .iter()
            .map(|o| ("outputs", &o.name, o.min, o.max));
        let set = self
            .parameters
            .iter()
            .map(|p| ("parameters", &p.name, p.min, p.max));
        for (list, name, min, max) in limited.chain(set) {
            let is_wrong = |bound: Option<f64>| bound.is_some_and(f64::is_nan);
            let crossed = matches!((min, max), (Some(min), Some(max)) if min > max);
            if is_wrong(min) || is_wrong(max) || crossed {
                let got = format!("limits must be numbers in their order, got {min:?} to {max:?}");
                return refuse(format!("describe.{list}.{name}"), got);
            }
        }
        for parameter in &self.parameters {
            let outside = range(parameter.min, parameter.max, parameter.default);
            if !parameter.default.is_finite() || outside.is_some() {
                return refuse(
                    format!("describe.parameters.{}", parameter.name),
                    format!(
                        "its default must be within its limits, got {}",
                        parameter.default
                    ),
                );
            }
        }
        if self.outputs.is_empty() {
            return refuse(
                "describe.outputs".into(),
                "must not be empty: it would do nothing".into(),
            );
        }
        Ok(())
    }

    /// The value of every parameter, in their order.
    pub(crate) fn complete(
        &self,
        given: &BTreeMap<String, f64>,
    ) -> Result<Vec<(String, f64)>, Fault> {
        let find = |name: &String| self.parameters.iter().find(|p| p.name == *name);
        for (name, &value) in given {
            let field = format!("parameters.{name}");
            let Some(parameter) = find(name) else {
                let known: Vec<&str> = self.parameters.iter().map(|p| p.name.as_str()).collect();
                let hint = match known.is_empty() {
                    true => "it has no parameters".to_owned(),
                    false => format!("it has: {}", known.join(", ")),
                };
                let problem = "must be a parameter of the plug-in".to_owned();
                return Err(Fault::new(field, problem).hint(hint));
            };
            if !value.is_finite() {
                return Err(Fault::new(field, format!("must be finite, got {value}")));
            }
            if let Some(limit) = range(parameter.min, parameter.max, value) {
                let problem = format!("must be {limit} {}, got {value}", parameter.unit);
                return Err(Fault::new(field, problem));
            }
        }
        let value = |p: &Parameter| given.get(&p.name).copied().unwrap_or(p.default);
        let named = |p: &Parameter| (p.name.clone(), value(p));
        Ok(self.parameters.iter().map(named).collect())
    }
}

/// Whether a text can name a port or a parameter.
pub(crate) fn is_name(text: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    !text.is_empty() && text.len() <= NAME_MAX && text.chars().all(is_plain)
}

fn check_names<'a>(
    list: &str,
    names: impl Iterator<Item = (&'a String, &'a String)>,
) -> Result<(), Fault> {
    let mut seen = BTreeSet::new();
    for (name, unit) in names {
        if !is_name(name) || unit.len() > NAME_MAX {
            let shown: String = name.chars().take(40).collect();
            let problem = format!("names must be letters, digits, '.', '_' and '-', got {shown:?}");
            return Err(Fault::new(format!("describe.{list}"), problem));
        }
        if !seen.insert(name) {
            let problem = format!("names must differ, got {name:?} twice");
            return Err(Fault::new(format!("describe.{list}"), problem));
        }
        if seen.len() > PORTS_MAX {
            let problem = format!("must be at most {PORTS_MAX}");
            return Err(Fault::new(format!("describe.{list}"), problem));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invariant_a_fault_is_a_line_of_some_length() {
        let told = Fault::new("place\u{9b}2J.\nname", "wrong\u{9b}2J").to_string();
        assert_eq!(told, "place 2J. name: wrong 2J");
        let silent = Fault::new("step", "\u{1} \n").to_string();
        assert_eq!(silent, "step: gave no reason");
        let long = Fault::new("x".repeat(1 << 16), "y".repeat(1 << 16)).to_string();
        assert!(long.chars().count() < 1000);
    }

    #[test]
    fn invariant_a_range_holds_what_is_admitted() {
        let infinite = [f64::NEG_INFINITY, f64::INFINITY, f64::NAN];
        let values = [f64::MIN, -2.0, -1.0, -0.0, 0.0, 1.0, 2.0, f64::MAX];
        let values = values.into_iter().chain(infinite);
        let limits = [None, Some(f64::NEG_INFINITY), Some(-1.0), Some(-0.0)];
        let limits = limits.into_iter().chain([Some(1.0), Some(f64::INFINITY)]);
        for (min, max) in limits
            .clone()
            .flat_map(|min| limits.clone().map(move |max| (min, max)))
        {
            let (name, unit) = ("forward".into(), "m/s".into());
            let output = Output {
                name,
                unit,
                min,
                max,
            };
            let [least, largest] = output.range();
            for value in values.clone() {
                let is_within = least <= value && value <= largest;
                assert_eq!(
                    is_within,
                    output.admit(value).is_ok(),
                    "{value} in {min:?} to {max:?}"
                );
            }
        }
    }
}
