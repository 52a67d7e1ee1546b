//! The rows as protobuf messages: one message per topic, nested as the paths of the signals.
//!
//! `robot.tri.pose.x` is field `pose.x` on topic `/robot/tri`; every other path, and the time `t`,
//! is on topic `/world`. All fields are `double` and always written, so a message has a constant
//! length: its bytes are laid out once, and each row only copies eight bytes per signal into them.
//! Names that protobuf does not allow are changed; the channel's metadata keep the paths.

use std::collections::{HashMap, HashSet};

use crate::signal::Signal;

/// Deepest nesting of a path, segments.
const DEPTH_MAX: usize = 32;

/// Package of all messages.
const PACKAGE: &str = "appell";

/// The messages of a row. Column 0 is the time, column `i + 1` is signal `i`.
#[derive(Debug)]
pub(super) struct Layout {
    /// One group per topic; `/world` is the first.
    pub(super) groups: Vec<Group>,
}

/// The message of one topic.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) topic: String,
    /// Full name of the message type.
    pub(super) type_name: String,
    /// A serialized `google.protobuf.FileDescriptorSet`.
    pub(super) descriptor: Vec<u8>,
    /// The message with all values 0.
    pub(super) template: Vec<u8>,
    /// Byte offset in the template, and column, of each value; offsets ascend.
    pub(super) fields: Vec<(usize, usize)>,
}

impl Layout {
    /// Lays out the signals; a reason when a path is nested too deeply or there are too many topics.
    pub(super) fn new(signals: &[Signal]) -> Result<Self, String> {
        let mut trees = vec![Tree::new("/world")];
        trees[0].insert(["t"].into_iter(), 0);
        let mut topics: HashMap<&str, usize> = HashMap::new();
        for (index, Signal { path, .. }) in signals.iter().enumerate() {
            if path.split('.').count() > DEPTH_MAX {
                return Err(format!(
                    "{path:.80}: a path must have at most {DEPTH_MAX} segments"
                ));
            }
            let robot = path
                .strip_prefix("robot.")
                .and_then(|rest| rest.split_once('.'));
            let (tree, rest) = match robot {
                Some((robot, rest)) => {
                    let tree = *topics.entry(robot).or_insert_with(|| {
                        trees.push(Tree::new(&format!("/robot/{robot}")));
                        trees.len() - 1
                    });
                    (tree, rest)
                }
                None => (0, path.strip_prefix("world.").unwrap_or(path)),
            };
            trees[tree].insert(rest.split('.'), index + 1);
        }
        // Channel identifiers are u16, from 1 on; one is for the events.
        if trees.len() > usize::from(u16::MAX) - 2 {
            return Err(format!(
                "at most 65533 robots fit in a file, got {}",
                trees.len() - 1
            ));
        }
        let groups = trees
            .iter()
            .enumerate()
            .map(|(index, tree)| tree.group(index))
            .collect();
        Ok(Self { groups })
    }
}

impl Group {
    /// Copies the values of a message into `row`; false when it is not of this layout.
    pub(super) fn decode(&self, message: &[u8], row: &mut [f64]) -> bool {
        if message.len() != self.template.len() {
            return false;
        }
        let mut tags = 0;
        for &(offset, column) in &self.fields {
            if message[tags..offset] != self.template[tags..offset] {
                return false;
            }
            tags = offset + 8;
            let mut value = [0; 8];
            value.copy_from_slice(&message[offset..tags]);
            row[column] = f64::from_le_bytes(value);
        }
        message[tags..] == self.template[tags..]
    }
}

/// The nested fields of one topic; node 0 is the message itself.
struct Tree<'a> {
    topic: String,
    nodes: Vec<Node<'a>>,
    /// Messages by their parent and segment.
    messages: HashMap<(usize, &'a str), usize>,
}

/// A field: a value when it has a column, else a message.
struct Node<'a> {
    segment: &'a str,
    column: Option<usize>,
    children: Vec<usize>,
}

impl<'a> Tree<'a> {
    fn new(topic: &str) -> Self {
        let root = Node {
            segment: "",
            column: None,
            children: Vec::new(),
        };
        Self {
            topic: topic.to_owned(),
            nodes: vec![root],
            messages: HashMap::new(),
        }
    }

    fn insert(&mut self, segments: impl Iterator<Item = &'a str>, column: usize) {
        let mut segments = segments.peekable();
        let mut parent = 0;
        while let Some(segment) = segments.next() {
            let next = self.nodes.len();
            if segments.peek().is_none() {
                self.push(parent, segment, Some(column));
            } else if let Some(&message) = self.messages.get(&(parent, segment)) {
                parent = message;
            } else {
                self.messages.insert((parent, segment), next);
                self.push(parent, segment, None);
                parent = next;
            }
        }
    }

    fn push(&mut self, parent: usize, segment: &'a str, column: Option<usize>) {
        let node = self.nodes.len();
        self.nodes[parent].children.push(node);
        self.nodes.push(Node {
            segment,
            column,
            children: Vec::new(),
        });
    }

    fn group(&self, index: usize) -> Group {
        // Robots may differ in what a type name cannot show (`a-b`, `a_b`), so all but /world are
        // told apart by their place.
        let name = if index == 0 {
            "World".to_owned()
        } else {
            let robot = self.topic.rsplit('/').next().unwrap_or_default();
            format!("{}Robot{index}", capitalized(&identifier(robot)))
        };
        let type_name = format!("{PACKAGE}.{name}");
        let mut file = Vec::new();
        text(&mut file, 1, &format!("{PACKAGE}/{name}.proto"));
        text(&mut file, 2, PACKAGE);
        bytes(
            &mut file,
            4,
            &self.descriptor(0, &name, &format!(".{type_name}")),
        );
        text(&mut file, 12, "proto3");
        let mut descriptor = Vec::new();
        bytes(&mut descriptor, 1, &file);
        let (template, fields) = self.template(0);
        Group {
            topic: self.topic.clone(),
            type_name,
            descriptor,
            template,
            fields,
        }
    }

    /// The bytes of a message and the places of its values.
    fn template(&self, node: usize) -> (Vec<u8>, Vec<(usize, usize)>) {
        let mut template = Vec::new();
        let mut fields = Vec::new();
        for (index, &child) in self.nodes[node].children.iter().enumerate() {
            if let Some(column) = self.nodes[child].column {
                tag(&mut template, number(index), FIXED64);
                fields.push((template.len(), column));
                template.extend_from_slice(&[0; 8]);
            } else {
                let (inner, places) = self.template(child);
                bytes(&mut template, number(index), &inner);
                let start = template.len() - inner.len();
                fields.extend(
                    places
                        .into_iter()
                        .map(|(offset, column)| (start + offset, column)),
                );
            }
        }
        (template, fields)
    }

    /// The `DescriptorProto` of a message; `path` is its full name with a leading dot.
    fn descriptor(&self, node: usize, name: &str, path: &str) -> Vec<u8> {
        const TYPE_DOUBLE: u64 = 1;
        const TYPE_MESSAGE: u64 = 11;
        const LABEL_OPTIONAL: u64 = 1;
        let mut descriptor = Vec::new();
        text(&mut descriptor, 1, name);
        // Fields and nested types share one scope.
        let mut scope = HashSet::new();
        let mut nested = Vec::new();
        for (index, &child) in self.nodes[node].children.iter().enumerate() {
            let field_name = unique(&mut scope, identifier(self.nodes[child].segment), child);
            let mut field = Vec::new();
            text(&mut field, 1, &field_name);
            varint_field(&mut field, 3, number(index));
            varint_field(&mut field, 4, LABEL_OPTIONAL);
            if self.nodes[child].column.is_some() {
                varint_field(&mut field, 5, TYPE_DOUBLE);
            } else {
                let type_name = unique(&mut scope, capitalized(&field_name), child);
                let type_path = format!("{path}.{type_name}");
                varint_field(&mut field, 5, TYPE_MESSAGE);
                text(&mut field, 6, &type_path);
                nested.push(self.descriptor(child, &type_name, &type_path));
            }
            bytes(&mut descriptor, 2, &field);
        }
        for message in nested {
            bytes(&mut descriptor, 3, &message);
        }
        descriptor
    }
}

/// A name that is new in `scope`; `node` tells apart those that would be equal.
fn unique(scope: &mut HashSet<String>, mut name: String, node: usize) -> String {
    if scope.contains(&name) {
        name = format!("{name}_{node}");
    }
    while scope.contains(&name) {
        name.push('_');
    }
    scope.insert(name.clone());
    name
}

/// The segment with all that protobuf does not allow in a name replaced by `_`.
fn identifier(segment: &str) -> String {
    let allowed = |letter: char| {
        if letter.is_ascii_alphanumeric() {
            letter
        } else {
            '_'
        }
    };
    let name: String = segment.chars().map(allowed).collect();
    if name.starts_with(|letter: char| letter.is_ascii_alphabetic()) {
        name
    } else {
        format!("f_{name}")
    }
}

/// `spin_rate` as `SpinRate`.
fn capitalized(name: &str) -> String {
    let word = |word: &str| {
        let mut letters = word.chars();
        letters
            .next()
            .map(|first| first.to_ascii_uppercase())
            .into_iter()
            .chain(letters)
            .collect()
    };
    name.split('_').map(word).collect::<Vec<String>>().concat()
}

/// Number of the field at `index`; protobuf keeps 19000 to 19999 for itself.
fn number(index: usize) -> u64 {
    let number = index as u64 + 1;
    if number < 19_000 {
        number
    } else {
        number + 1000
    }
}

const VARINT: u64 = 0;
const FIXED64: u64 = 1;
const LENGTH_DELIMITED: u64 = 2;

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn tag(out: &mut Vec<u8>, number: u64, wire_type: u64) {
    varint(out, number << 3 | wire_type);
}

fn varint_field(out: &mut Vec<u8>, number: u64, value: u64) {
    tag(out, number, VARINT);
    varint(out, value);
}

fn bytes(out: &mut Vec<u8>, number: u64, value: &[u8]) {
    tag(out, number, LENGTH_DELIMITED);
    varint(out, value.len() as u64);
    out.extend_from_slice(value);
}

fn text(out: &mut Vec<u8>, number: u64, value: &str) {
    bytes(out, number, value.as_bytes());
}
