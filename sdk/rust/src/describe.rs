// SPDX-License-Identifier: MIT OR Apache-2.0
//! What a controller says of itself, and its JSON.

use std::fmt::Write;

/// Version of the description.
const PROTOCOL: u32 = 1;

/// A controller as it describes itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descriptor {
    /// Name.
    pub name: &'static str,
    /// Version, in its own counting.
    pub version: &'static str,
    /// One line for people.
    pub about: &'static str,
    /// What it reads.
    pub inputs: &'static [Port],
    /// What it writes.
    pub outputs: &'static [Output],
    /// What can be set.
    pub parameters: &'static [Parameter],
}

/// A signal that is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Port {
    /// Path below the robot, such as `pose.x`.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
}

/// A signal that is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Path below the robot, such as `command.forward`.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Least value; infinite where there is no limit.
    pub min: f64,
    /// Largest value; infinite where there is no limit.
    pub max: f64,
}

/// A number that can be set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Value where none is given.
    pub default: f64,
    /// Least value; infinite where there is no limit.
    pub min: f64,
    /// Largest value; infinite where there is no limit.
    pub max: f64,
    /// One line for people.
    pub about: &'static str,
}

impl Output {
    /// One without limits.
    pub const fn new(name: &'static str, unit: &'static str) -> Self {
        let (min, max) = (f64::NEG_INFINITY, f64::INFINITY);
        Output {
            name,
            unit,
            min,
            max,
        }
    }
}

impl Parameter {
    /// One without limits and unit.
    pub const fn new(name: &'static str, default: f64) -> Self {
        let (min, max) = (f64::NEG_INFINITY, f64::INFINITY);
        Parameter {
            name,
            unit: "",
            default,
            min,
            max,
            about: "",
        }
    }
}

impl Descriptor {
    /// As JSON.
    pub fn json(&self) -> String {
        let inputs = self.inputs.iter().map(|port| {
            let mut object = Object::new();
            object.text("name", port.name).text("unit", port.unit);
            object.end()
        });
        let outputs = self.outputs.iter().map(|port| {
            let mut object = Object::new();
            object.text("name", port.name).text("unit", port.unit);
            object.limit("min", port.min).limit("max", port.max);
            object.end()
        });
        let parameters = self.parameters.iter().map(|parameter| {
            let mut object = Object::new();
            object.text("name", parameter.name);
            object.text("unit", parameter.unit);
            object.value("default", &number(parameter.default));
            object.limit("min", parameter.min);
            object.limit("max", parameter.max);
            object.text("about", parameter.about);
            object.end()
        });
        let mut object = Object::new();
        object.value("protocol", &PROTOCOL.to_string());
        object.text("name", self.name);
        object.text("version", self.version);
        object.text("about", self.about);
        object.value("inputs", &list(inputs));
        object.value("outputs", &list(outputs));
        object.value("parameters", &list(parameters));
        object.end()
    }
}

/// An object of JSON while it is written.
struct Object(String);

impl Object {
    fn new() -> Self {
        Object(String::from("{"))
    }

    fn value(&mut self, key: &str, json: &str) -> &mut Self {
        if self.0.len() > 1 {
            self.0.push_str(", ");
        }
        self.0.push_str(&quoted(key));
        self.0.push_str(": ");
        self.0.push_str(json);
        self
    }

    fn text(&mut self, key: &str, text: &str) -> &mut Self {
        self.value(key, &quoted(text))
    }

    /// JSON has no infinities: no limit is no key.
    fn limit(&mut self, key: &str, limit: f64) -> &mut Self {
        match limit.is_infinite() {
            true => self,
            false => self.value(key, &number(limit)),
        }
    }

    fn end(mut self) -> String {
        self.0.push('}');
        self.0
    }
}

fn list(items: impl Iterator<Item = String>) -> String {
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}

/// What is not finite becomes `null`, which Appell refuses by the name of the field.
fn number(value: f64) -> String {
    match value.is_finite() {
        true => format!("{value:?}"),
        false => "null".into(),
    }
}

fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => {
                write!(quoted, "\\u{:04x}", u32::from(c)).expect("a text takes all");
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_texts_are_escaped() {
        assert_eq!(quoted("a\"b\\c\n\0π"), r#""a\"b\\c\u000a\u0000π""#);
    }

    #[test]
    fn closed_form_numbers_are_those_of_json() {
        let numbers = [0.0, -0.5, 1e300, 1e-7, f64::NAN].map(number);
        assert_eq!(numbers, ["0.0", "-0.5", "1e300", "1e-7", "null"]);
    }

    #[test]
    fn closed_form_limits_that_are_infinite_are_left_out() {
        const OUTPUTS: &[Output] = &[Output {
            max: 1.0,
            ..Output::new("brake", "1")
        }];
        const PARAMETERS: &[Parameter] = &[Parameter::new("gain", 2.0)];
        let descriptor = Descriptor {
            name: "a",
            version: "",
            about: "",
            inputs: &[],
            outputs: OUTPUTS,
            parameters: PARAMETERS,
        };
        let expected = concat!(
            r#"{"protocol": 1, "name": "a", "version": "", "about": "", "inputs": [], "#,
            r#""outputs": [{"name": "brake", "unit": "1", "max": 1.0}], "#,
            r#""parameters": [{"name": "gain", "unit": "", "default": 2.0, "about": ""}]}"#,
        );
        assert_eq!(descriptor.json(), expected);
    }
}
