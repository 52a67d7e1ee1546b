//! Doors for the fuzzers in `fuzz` to what is private, with no rules of their own.

use std::io::{self, Read, Write};
use std::path::Path;

use serde_json::Value;

use crate::contract::{Descriptor, Fault};
use crate::fmu::archive;
use crate::fmu::description::Description;
use crate::serve::{self, Server};

pub use crate::folder::Folder;
pub use crate::local::Local;

/// Reads what a plug-in says of itself.
///
/// # Errors
/// It is refused.
pub fn descriptor(value: Value) -> Result<Descriptor, Fault> {
    Descriptor::read(value)
}

/// Answers the requests of a stream.
///
/// # Errors
/// The stream breaks off, or what it holds is no request.
pub fn converse(stream: &mut (impl Read + Write), local: Box<dyn Local>) -> io::Result<()> {
    serve::converse(stream, Server::new(local))
}

/// Unpacks an FMU.
///
/// # Errors
/// It is refused.
pub fn unpack(file: &Path) -> Result<Folder, Fault> {
    archive::unpack(file)
}

/// What an FMU that is unpacked says of itself.
///
/// # Errors
/// It is refused.
pub fn unpacked(folder: &Path) -> Result<Value, Fault> {
    Description::open(folder).map(|description| description.described())
}

/// What an FMU with this description says of itself.
///
/// # Errors
/// It is refused.
pub fn description(text: &str) -> Result<Value, Fault> {
    Description::read(text).map(|description| description.described())
}
