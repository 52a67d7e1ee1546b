//! What an FMU says of itself: its `modelDescription.xml`, of FMI 2 or 3.
//!
//! Real numbers go through, one by one: inputs, outputs, and parameters. What is of another type, or an
//! array, is left out: an input or a parameter keeps the value it starts with, an output is not seen. So is
//! what has a name that no path can have, such as `der(x)`. What is left out of inputs and outputs is told
//! behind the description.

use std::collections::BTreeMap;

use roxmltree::{Document, Node, ParsingOptions};
use serde_json::Value;

use crate::contract::{Descriptor, Fault, Output, PORTS_MAX, Parameter, Port, is_name};
use crate::wire::PROTOCOL;

/// Its name in the archive.
pub(super) const FILE: &str = "modelDescription.xml";
/// Longest description, bytes.
const SIZE_MAX: u64 = 1 << 26;
/// Most nodes of a description.
const NODES_MAX: u32 = 1 << 22;
/// How many of those that are left out are named.
const NAMED_MAX: usize = 8;

/// Version of the standard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Version {
    /// FMI 2.
    Two,
    /// FMI 3.
    Three,
}

/// What of a description matters here.
#[derive(Debug)]
pub(crate) struct Description {
    /// Version of the standard.
    pub(super) version: Version,
    /// What the binary checks to be its own.
    pub(super) token: String,
    /// Name of the binary.
    pub(super) identifier: String,
    /// Whether steps may differ in length.
    pub(super) has_free_steps: bool,
    /// Whether there can be one member only.
    pub(super) is_single: bool,
    /// Whether its state can be had as bytes.
    pub(super) can_save: bool,
    /// What it is to a host.
    pub(super) descriptor: Descriptor,
    /// References of the inputs, in their order.
    pub(super) inputs: Vec<u32>,
    /// References of the outputs, in their order.
    pub(super) outputs: Vec<u32>,
    /// References of the parameters, in their order.
    pub(super) parameters: Vec<u32>,
}

impl Description {
    /// Reads the description in a folder.
    ///
    /// # Errors
    /// It is missing or cannot be read.
    pub(crate) fn open(folder: &std::path::Path) -> Result<Description, Fault> {
        let path = folder.join(FILE);
        let length = std::fs::metadata(&path).map_or(0, |about| about.len());
        if length > SIZE_MAX {
            return Err(wrong("", format!("must have at most {SIZE_MAX} bytes")));
        }
        let text = std::fs::read_to_string(&path).map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => {
                Fault::new("file", format!("must have a file {FILE}, has none"))
            }
            _ => wrong("", format!("cannot be read: {error}")),
        })?;
        Description::read(&text)
    }

    /// Reads a description.
    ///
    /// # Errors
    /// It is of an unknown version, of another kind than co-simulation, or breaks the standard.
    pub(crate) fn read(text: &str) -> Result<Description, Fault> {
        let options = ParsingOptions {
            nodes_limit: NODES_MAX,
            ..ParsingOptions::default()
        };
        // Some begin with a mark of the order of bytes.
        let text = text.trim_start_matches('\u{feff}');
        let document = Document::parse_with_options(text, options)
            .map_err(|error| wrong("", format!("must be XML: {error}")))?;
        let root = document.root_element();
        let version = version(root)?;
        let Some(simulation) = child(root, "CoSimulation") else {
            let has = ["ModelExchange", "ScheduledExecution"];
            let has: Vec<&str> = has
                .into_iter()
                .filter(|name| child(root, name).is_some())
                .collect();
            let has = match has.is_empty() {
                true => "no interface".to_owned(),
                false => has.join(" and ") + " only",
            };
            let problem = format!("must be there, the FMU has {has}");
            return Err(wrong("CoSimulation", problem)
                .hint("export it for co-simulation: then it brings its own solver"));
        };
        let is = |name: &str| flag(simulation, name);
        let identifier = needed(simulation, "modelIdentifier")?;
        // It becomes the name of a file.
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if identifier.is_empty() || !identifier.chars().all(is_plain) {
            let rule = format!("must be letters, digits and '_', got {identifier:?}");
            return Err(wrong("CoSimulation.modelIdentifier", rule));
        }
        let (token, save) = match version {
            Version::Two => ("guid", ["canGetAndSetFMUstate", "canSerializeFMUstate"]),
            Version::Three => (
                "instantiationToken",
                ["canGetAndSetFMUState", "canSerializeFMUState"],
            ),
        };
        let variables = Variables::read(root, version)?;
        let mut about = text_or_empty(root, "description");
        if let Some(note) = note(&variables.left_out) {
            let space = if about.is_empty() { "" } else { " " };
            about = format!("{about}{space}({note})");
        }
        Ok(Description {
            version,
            token: needed(root, token)?.to_owned(),
            identifier: identifier.to_owned(),
            has_free_steps: is("canHandleVariableCommunicationStepSize")?,
            is_single: is("canBeInstantiatedOnlyOncePerProcess")?,
            can_save: is(save[0])? && is(save[1])?,
            descriptor: Descriptor {
                protocol: PROTOCOL,
                name: needed(root, "modelName")?.to_owned(),
                version: text_or_empty(root, "version"),
                about,
                inputs: variables.inputs,
                outputs: variables.outputs,
                parameters: variables.parameters,
            },
            inputs: variables.references[0].clone(),
            outputs: variables.references[1].clone(),
            parameters: variables.references[2].clone(),
        })
    }

    /// What it is to a host, as a message.
    pub(crate) fn described(&self) -> Value {
        serde_json::to_value(&self.descriptor).expect("texts and finite numbers are JSON")
    }
}

/// The variables that go through.
#[derive(Debug, Default)]
struct Variables {
    inputs: Vec<Port>,
    outputs: Vec<Output>,
    parameters: Vec<Parameter>,
    /// Of inputs, outputs and parameters.
    references: [Vec<u32>; 3],
    /// Inputs and outputs that do not, and why.
    left_out: Vec<String>,
}

/// One real number, with what its type says of it where it does not itself.
struct Real<'a> {
    own: Node<'a, 'a>,
    declared: Option<Node<'a, 'a>>,
}

impl<'a> Real<'a> {
    fn text(&self, name: &str) -> Option<&'a str> {
        let declared = || self.declared.and_then(|node| node.attribute(name));
        self.own.attribute(name).or_else(declared)
    }

    /// A limit; one at infinity is none.
    fn limit(&self, variable: &str, name: &str) -> Result<Option<f64>, Fault> {
        let limit = self.text(name).map(|text| number(variable, name, text));
        Ok(limit.transpose()?.filter(|limit| limit.is_finite()))
    }
}

impl Variables {
    fn read(root: Node<'_, '_>, version: Version) -> Result<Variables, Fault> {
        let types = types(root, version);
        let mut variables = Variables::default();
        let Some(list) = child(root, "ModelVariables") else {
            return Err(wrong("ModelVariables", "must be there"));
        };
        for node in list.children().filter(Node::is_element) {
            let causality = node.attribute("causality").unwrap_or("local");
            if !["input", "output", "parameter"].contains(&causality) {
                continue;
            }
            let name = needed(node, "name")?;
            // FMI 2 has the type within, FMI 3 is named by it.
            let typed = match version {
                Version::Two => node.children().find(|inner| {
                    let kinds = ["Real", "Integer", "Boolean", "String", "Enumeration"];
                    kinds.contains(&inner.tag_name().name())
                }),
                Version::Three => Some(node),
            };
            let Some(own) = typed else {
                return Err(wrong(name, "must have a type"));
            };
            let kind = own.tag_name().name();
            let is_array = child(node, "Dimension").is_some();
            let is_many = variables.parameters.len() >= PORTS_MAX;
            let why = match kind {
                _ if is_array => format!("an array of {kind}"),
                "Real" | "Float64" if !is_name(name) => "its name is no path".into(),
                "Real" | "Float64" => {
                    let declared = own.attribute("declaredType");
                    let real = Real {
                        own,
                        declared: declared.and_then(|declared| types.get(declared).copied()),
                    };
                    if causality != "parameter" || !is_many {
                        variables.take(node, causality, name, &real)?;
                    }
                    continue;
                }
                _ => kind.to_owned(),
            };
            if causality != "parameter" {
                variables
                    .left_out
                    .push(format!("{causality} {name}: {why}"));
            }
        }
        Ok(variables)
    }

    fn take(
        &mut self,
        node: Node<'_, '_>,
        causality: &str,
        name: &str,
        real: &Real<'_>,
    ) -> Result<(), Fault> {
        let reference = needed(node, "valueReference")?;
        let reference = reference.trim().parse().map_err(|_| {
            let rule = format!("must be a whole number of 32 bits, got {reference:?}");
            wrong(&format!("{name}.valueReference"), rule)
        })?;
        let name = name.to_owned();
        let unit = real.text("unit").unwrap_or_default().to_owned();
        match causality {
            "input" => {
                self.inputs.push(Port { name, unit });
                self.references[0].push(reference);
            }
            "output" => {
                let min = real.limit(&name, "min")?;
                let max = real.limit(&name, "max")?;
                self.outputs.push(Output {
                    name,
                    unit,
                    min,
                    max,
                });
                self.references[1].push(reference);
            }
            _ => {
                let start = real
                    .text("start")
                    .map(|text| number(&name, "start", text))
                    .transpose()?;
                // One without a value is worked out by the FMU, and not to be set.
                let Some(default) = start.filter(|start| start.is_finite()) else {
                    return Ok(());
                };
                let min = real.limit(&name, "min")?;
                let max = real.limit(&name, "max")?;
                self.parameters.push(Parameter {
                    name,
                    unit,
                    default,
                    min,
                    max,
                    about: text_or_empty(node, "description"),
                });
                self.references[2].push(reference);
            }
        }
        Ok(())
    }
}

/// The declared types of real numbers, by their names.
fn types<'a>(root: Node<'a, 'a>, version: Version) -> BTreeMap<&'a str, Node<'a, 'a>> {
    let all = child(root, "TypeDefinitions").into_iter();
    let all = all.flat_map(|list| list.children());
    let real = all.filter_map(|node| {
        let inner = match version {
            Version::Two => child(node, "Real"),
            Version::Three => Some(node).filter(|node| node.has_tag_name("Float64Type")),
        };
        Some((node.attribute("name")?, inner?))
    });
    real.collect()
}

/// What the description adds on what is left out.
fn note(left_out: &[String]) -> Option<String> {
    let more = left_out.len().saturating_sub(NAMED_MAX);
    let named = left_out.get(..NAMED_MAX).unwrap_or(left_out).join(", ");
    match (left_out.is_empty(), more) {
        (true, _) => None,
        (false, 0) => Some(format!("left out: {named}")),
        (false, more) => Some(format!("left out: {named}, and {more} more")),
    }
}

fn version(root: Node<'_, '_>) -> Result<Version, Fault> {
    if !root.has_tag_name("fmiModelDescription") {
        let got = root.tag_name().name();
        return Err(wrong("", format!("must be fmiModelDescription, got {got}")));
    }
    let text = needed(root, "fmiVersion")?;
    let is_minor = |rest: &str| !rest.is_empty() && rest.chars().all(|c| c.is_ascii_digit());
    match text.trim().split_once('.') {
        // Some tools write the third number of a version that mends, too.
        Some(("2", rest)) if rest.split('.').all(is_minor) => Ok(Version::Two),
        Some(("3", rest)) if is_minor(rest) => Ok(Version::Three),
        _ => Err(wrong(
            "fmiVersion",
            format!("must be 2.x or 3.x, the versions of FMI that are known, got {text:?}"),
        )),
    }
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|child| child.has_tag_name(name))
}

fn needed<'a>(node: Node<'a, 'a>, name: &str) -> Result<&'a str, Fault> {
    node.attribute(name).ok_or_else(|| {
        let of = node.attribute("name").unwrap_or(node.tag_name().name());
        wrong(&format!("{of}.{name}"), "must be there")
    })
}

fn text_or_empty(node: Node<'_, '_>, name: &str) -> String {
    node.attribute(name).unwrap_or_default().to_owned()
}

fn flag(node: Node<'_, '_>, name: &str) -> Result<bool, Fault> {
    match node.attribute(name).map(str::trim) {
        Some("true" | "1") => Ok(true),
        Some("false" | "0") | None => Ok(false),
        Some(other) => Err(wrong(
            &format!("{}.{name}", node.tag_name().name()),
            format!("must be true or false, got {other:?}"),
        )),
    }
}

fn number(variable: &str, name: &str, text: &str) -> Result<f64, Fault> {
    text.trim().parse().map_err(|_| {
        let rule = format!("must be a number, got {text:?}");
        wrong(&format!("{variable}.{name}"), rule)
    })
}

fn wrong(place: &str, problem: impl Into<String>) -> Fault {
    let dot = if place.is_empty() { "" } else { "." };
    Fault::new(format!("{FILE}{dot}{place}"), problem)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two(variables: &str) -> String {
        format!(
            r#"<fmiModelDescription fmiVersion="2.0" modelName="M" guid="g" description="Some.">
            <ModelExchange modelIdentifier="M_me"/><CoSimulation modelIdentifier="M_cs"/>
            <TypeDefinitions>
              <SimpleType name="Angle"><Real unit="rad" min="-3" max="3"/></SimpleType>
              <SimpleType name="Gear"><Integer min="1"/></SimpleType>
            </TypeDefinitions>
            <ModelVariables>{variables}</ModelVariables></fmiModelDescription>"#
        )
    }

    fn three(variables: &str) -> String {
        format!(
            r#"<fmiModelDescription fmiVersion="3.0" modelName="M" instantiationToken="g">
            <CoSimulation modelIdentifier="M"/>
            <TypeDefinitions><Float64Type name="Angle" unit="rad" min="-3" max="3"/></TypeDefinitions>
            <ModelVariables>{variables}</ModelVariables></fmiModelDescription>"#
        )
    }

    fn refusal(text: &str) -> String {
        Description::read(text).expect_err("a refusal").to_string()
    }

    #[test]
    fn known_answer_of_a_description_of_two() {
        let read = Description::read(&two(
            r#"<ScalarVariable name="a" valueReference="7" causality="input"><Real declaredType="Angle"/></ScalarVariable>
            <ScalarVariable name="gear" valueReference="7" causality="input"><Integer start="1" declaredType="Gear"/></ScalarVariable>
            <ScalarVariable name="der(a)" valueReference="9" causality="output"><Real/></ScalarVariable>
            <ScalarVariable name="b" valueReference="8" causality="output"><Real declaredType="Angle" max="2" min="-INF" unit="deg"/></ScalarVariable>
            <ScalarVariable name="x" valueReference="1"><Real start="3"/></ScalarVariable>
            <ScalarVariable name="w" valueReference="2" causality="calculatedParameter"><Real/></ScalarVariable>
            <ScalarVariable name="p" valueReference="3" causality="parameter" variability="tunable" description="One."><Real start=" 1.5e0 " declaredType="Angle"/></ScalarVariable>
            <ScalarVariable name="n" valueReference="3" causality="parameter"><Integer start="2"/></ScalarVariable>
            <ScalarVariable name="q[1]" valueReference="4" causality="parameter"><Real start="2"/></ScalarVariable>"#,
        ))
        .expect("a description");
        assert_eq!(
            (read.version, read.identifier.as_str()),
            (Version::Two, "M_cs")
        );
        assert!(!read.can_save && !read.is_single && !read.has_free_steps);
        assert_eq!(
            (read.inputs, read.outputs, read.parameters),
            (vec![7], vec![8], vec![3])
        );
        let descriptor = read.descriptor;
        assert_eq!(descriptor.inputs[0].unit, "rad");
        let output = &descriptor.outputs[0];
        assert_eq!(
            (output.unit.as_str(), output.min, output.max),
            ("deg", None, Some(2.0))
        );
        let parameter = &descriptor.parameters[0];
        assert_eq!((parameter.default, parameter.min), (1.5, Some(-3.0)));
        assert_eq!(
            descriptor.about,
            "Some. (left out: input gear: Integer, output der(a): its name is no path)"
        );
    }

    #[test]
    fn known_answer_of_a_description_of_three() {
        let read = Description::read(&three(
            r#"<Float64 name="time" valueReference="0" causality="independent"/>
            <Float64 name="a" valueReference="1" causality="input" start="0" declaredType="Angle"/>
            <Float64 name="v" valueReference="2" causality="output"><Dimension start="3"/></Float64>
            <Float32 name="f" valueReference="3" causality="output"/>
            <Float64 name="b" valueReference="4" causality="output"/>
            <UInt64 name="m" valueReference="5" causality="structuralParameter" start="3"/>
            <Float64 name="p" valueReference="6" causality="parameter" start="1 2"><Dimension start="2"/></Float64>"#,
        ))
        .expect("a description");
        assert_eq!(read.version, Version::Three);
        assert_eq!((read.inputs, read.outputs), (vec![1], vec![4]));
        assert!(read.parameters.is_empty());
        assert_eq!(
            read.descriptor.about,
            "(left out: output v: an array of Float64, output f: Float32)"
        );
    }

    #[test]
    fn known_answer_of_versions() {
        for (version, is_known) in [
            ("2.0", true),
            ("2.0.4", true),
            ("3.0", true),
            ("3.1", true),
            ("1.0", false),
            ("3.0-beta.2", false),
            ("4.0", false),
            ("20", false),
            ("", false),
        ] {
            let text = two("").replace("fmiVersion=\"2.0\"", &format!("fmiVersion=\"{version}\""));
            let text = text.replace("guid", "guid=\"g\" instantiationToken");
            assert_eq!(Description::read(&text).is_ok(), is_known, "{version}");
        }
    }

    #[test]
    fn refusal_of_what_breaks_the_standard() {
        let input = r#"<ScalarVariable name="u" valueReference="1" causality="input">"#;
        for (text, expected) in [
            (
                two("").replace("M_cs", "../../lib"),
                "modelDescription.xml.CoSimulation.modelIdentifier: must be letters, digits and '_', got \"../../lib\"",
            ),
            (
                two("").replace("guid=\"g\"", ""),
                "modelDescription.xml.fmiModelDescription.guid: must be there",
            ),
            (
                two(&format!("{input}</ScalarVariable>")),
                "modelDescription.xml.u: must have a type",
            ),
            (
                two(&format!(
                    "{}<Real/></ScalarVariable>",
                    input.replace("\"1\"", "\"-1\"")
                )),
                "modelDescription.xml.u.valueReference: must be a whole number of 32 bits, got \"-1\"",
            ),
            (
                two(&format!(
                    "{}<Real min=\"low\"/></ScalarVariable>",
                    input.replace("input", "output")
                )),
                "modelDescription.xml.u.min: must be a number, got \"low\"",
            ),
            (
                two("").replace(
                    "CoSimulation ",
                    "CoSimulation canSerializeFMUstate=\"yes\" canGetAndSetFMUstate=\"1\" ",
                ),
                "modelDescription.xml.CoSimulation.canSerializeFMUstate: must be true or false, got \"yes\"",
            ),
            (
                three("").replace("CoSimulation", "ScheduledExecution"),
                "modelDescription.xml.CoSimulation: must be there, the FMU has ScheduledExecution only",
            ),
            (
                "<other/>".into(),
                "modelDescription.xml: must be fmiModelDescription, got other",
            ),
        ] {
            assert_eq!(refusal(&text), expected);
        }
        // A text with a zero byte could not be handed to C.
        assert!(refusal(&two("").replace("\"g\"", "\"&#0;\"")).contains("must be XML"));
        let entities = r#"<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><x>&e;</x>"#;
        assert!(refusal(entities).starts_with("modelDescription.xml: must be XML: "));
    }
}
