//! Arbitrary archives as FMUs, and arbitrary XML as what they say of themselves. No code is loaded.
//!
//! Whatever the archive: nothing is written beside the folder it is unpacked into, and that goes with all
//! that is in it.

#![no_main]

use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use appell_fuzz::{check_descriptor, check_fault};
use appell_plugin::Fault;
use appell_plugin::fuzz::{description, descriptor, unpack, unpacked};
use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use serde_json::Value;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Most bytes that an archive unpacks to.
const UNPACKED_MAX: u64 = 1 << 28;

#[derive(Arbitrary, Debug)]
enum Made<'a> {
    Archive(&'a [u8]),
    Packed {
        entries: Vec<Entry<'a>>,
        /// Bytes that are other in the end: where, and how.
        flips: Vec<(u16, u8)>,
    },
    Text(&'a str),
    Model(Model<'a>),
}

#[derive(Arbitrary, Debug)]
struct Entry<'a> {
    name: Vec<Part<'a>>,
    kind: Kind<'a>,
}

/// A part of a path.
#[derive(Arbitrary, Debug)]
enum Part<'a> {
    Plain(u8),
    Up,
    Root,
    Back,
    /// So many folders, one in the other.
    Deep(u16),
    Free(&'a str),
}

#[derive(Arbitrary, Debug)]
enum Kind<'a> {
    Folder,
    File(&'a [u8]),
    Zeros(u32),
    Link(&'a str),
    Model(Model<'a>),
}

/// A description with most of what it must have.
#[derive(Arbitrary, Debug)]
struct Model<'a> {
    is_three: bool,
    version: Option<&'a str>,
    name: &'a str,
    declared: Number<'a>,
    variables: Vec<Variable<'a>>,
    /// Bytes that are other in the end.
    flips: Vec<(u16, u8)>,
}

#[derive(Arbitrary, Debug)]
struct Variable<'a> {
    name: Name<'a>,
    reference: Number<'a>,
    causality: u8,
    kind: u8,
    start: Option<Number<'a>>,
    min: Option<Number<'a>>,
    max: Option<Number<'a>>,
    is_array: bool,
    is_declared: bool,
}

#[derive(Arbitrary, Debug)]
enum Name<'a> {
    Known(u8),
    Free(&'a str),
}

#[derive(Arbitrary, Debug)]
enum Number<'a> {
    Whole(u32),
    Real(f64),
    Free(&'a str),
}

impl Number<'_> {
    fn text(&self) -> String {
        match self {
            Number::Whole(number) => number.to_string(),
            Number::Real(number) => number.to_string(),
            Number::Free(text) => escaped(text),
        }
    }
}

fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for c in text.chars() {
        let _ = match c {
            '"' | '&' | '<' | '\t' | '\n' | '\r' => write!(escaped, "&#{};", c as u32),
            _ => write!(escaped, "{c}"),
        };
    }
    escaped
}

impl Model<'_> {
    fn text(&self) -> String {
        let (version, token, real) = match self.is_three {
            true => ("3.0", "instantiationToken", "Float64"),
            false => ("2.0", "guid", "Real"),
        };
        let version = self.version.unwrap_or(version);
        let declared = self.declared.text();
        let types = match self.is_three {
            true => format!("<Float64Type name=\"T\" unit=\"rad\" min=\"{declared}\"/>"),
            false => {
                format!(
                    "<SimpleType name=\"T\"><Real unit=\"rad\" min=\"{declared}\"/></SimpleType>"
                )
            }
        };
        let mut text = format!(
            "<fmiModelDescription fmiVersion=\"{}\" modelName=\"{}\" {token}=\"g\">\
             <CoSimulation modelIdentifier=\"M\"/><TypeDefinitions>{types}</TypeDefinitions>\
             <ModelVariables>",
            escaped(version),
            escaped(self.name),
        );
        for variable in &self.variables {
            let causality = ["input", "output", "parameter", "local"];
            let kinds = [real, real, "Integer", "Float32"];
            let kind = kinds[usize::from(variable.kind % 4)];
            let name = match &variable.name {
                Name::Known(number) => format!("signal.{number}"),
                Name::Free(text) => escaped(text),
            };
            let outer = format!(
                "name=\"{name}\" valueReference=\"{}\" causality=\"{}\"",
                variable.reference.text(),
                causality[usize::from(variable.causality % 4)]
            );
            let mut inner = String::new();
            let values = [
                ("start", &variable.start),
                ("min", &variable.min),
                ("max", &variable.max),
            ];
            for (name, value) in values {
                if let Some(value) = value {
                    let _ = write!(inner, " {name}=\"{}\"", value.text());
                }
            }
            if variable.is_declared {
                inner.push_str(" declaredType=\"T\"");
            }
            let array = match variable.is_array {
                true => "<Dimension start=\"2\"/>",
                false => "",
            };
            let _ = match self.is_three {
                true => write!(text, "<{kind} {outer}{inner}>{array}</{kind}>"),
                false => {
                    write!(
                        text,
                        "<ScalarVariable {outer}><{kind}{inner}/>{array}</ScalarVariable>"
                    )
                }
            };
        }
        text.push_str("</ModelVariables></fmiModelDescription>");
        let mut bytes = text.into_bytes();
        flip(&mut bytes, &self.flips);
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

fn flip(bytes: &mut [u8], flips: &[(u16, u8)]) {
    for (place, with) in flips {
        let length = bytes.len().max(1);
        if let Some(byte) = bytes.get_mut(usize::from(*place) % length) {
            *byte ^= with;
        }
    }
}

fn name(parts: &[Part<'_>]) -> String {
    let mut name = String::new();
    for (k, part) in parts.iter().enumerate() {
        if k > 0 {
            name.push('/');
        }
        match part {
            Part::Plain(number) => name.push_str(&format!("part{number}")),
            Part::Up => name.push_str(".."),
            Part::Root => name.push('/'),
            Part::Back => name.push('\\'),
            Part::Deep(count) => name.push_str(&"d/".repeat(usize::from(count % 4096))),
            Part::Free(text) => name.push_str(text),
        }
    }
    name
}

/// An archive, where what packs it allows.
fn pack(entries: &[Entry<'_>]) -> Option<Vec<u8>> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default();
    for entry in entries {
        let mut name = name(&entry.name);
        match &entry.kind {
            Kind::Folder => writer.add_directory(name, options).ok()?,
            Kind::Link(to) => writer.add_symlink(name, *to, options).ok()?,
            Kind::File(bytes) => {
                writer.start_file(name, options).ok()?;
                writer.write_all(bytes).ok()?;
            }
            Kind::Zeros(count) => {
                writer.start_file(name, options).ok()?;
                writer
                    .write_all(&vec![0; *count as usize % (1 << 20)])
                    .ok()?;
            }
            Kind::Model(model) => {
                name.clear();
                writer.start_file("modelDescription.xml", options).ok()?;
                writer.write_all(model.text().as_bytes()).ok()?;
            }
        }
    }
    Some(writer.finish().ok()?.into_inner())
}

/// The outermost folder that is written to, and the one that temporary folders are in, deep below it.
fn places() -> &'static (PathBuf, PathBuf) {
    static PLACES: OnceLock<(PathBuf, PathBuf)> = OnceLock::new();
    PLACES.get_or_init(|| {
        let name = format!("appell-fuzz-{}", std::process::id());
        let outer = std::env::temp_dir().join(name);
        let inner = outer.join("a/b/c");
        std::fs::create_dir_all(&inner).expect("a folder can be made");
        // SAFETY: nothing else runs yet.
        unsafe { std::env::set_var("TMPDIR", &inner) };
        (outer, inner)
    })
}

/// Number and bytes of what is in a folder.
fn content(folder: &Path) -> (usize, u64) {
    let (mut count, mut size) = (0, 0);
    for entry in std::fs::read_dir(folder).expect("it can be read") {
        let entry = entry.expect("an entry");
        let about = entry.metadata().expect("what it is");
        assert!(!about.is_symlink());
        count += 1;
        if about.is_dir() {
            let inner = content(&entry.path());
            count += inner.0;
            size += inner.1;
        } else {
            size += about.len();
        }
    }
    (count, size)
}

fn check_archive(bytes: &[u8]) {
    let (outer, inner) = places();
    let file = inner.join("made.fmu");
    std::fs::write(&file, bytes).expect("it can be written");
    match unpack(&file) {
        Ok(folder) => {
            let path = folder.path().to_owned();
            assert!(path.starts_with(inner));
            let (_, size) = content(&path);
            assert!(size <= UNPACKED_MAX);
            check_description(unpacked(&path));
            drop(folder);
        }
        Err(fault) => check_fault(&fault),
    }
    // Three folders, one in the other, and the archive.
    assert_eq!(content(outer), (4, bytes.len() as u64));
}

fn check_description(described: Result<Value, Fault>) {
    match described.and_then(descriptor) {
        Ok(descriptor) => check_descriptor(&descriptor),
        Err(fault) => check_fault(&fault),
    }
}

fuzz_target!(
    init: {
        places();
    },
    |made: Made<'_>| {
        match made {
            Made::Archive(bytes) => check_archive(bytes),
            Made::Packed { entries, flips } => {
                if let Some(mut bytes) = pack(&entries) {
                    flip(&mut bytes, &flips);
                    check_archive(&bytes);
                }
            }
            Made::Text(text) => check_description(description(text)),
            Made::Model(model) => check_description(description(&model.text())),
        }
    }
);
