//! Plug-ins: controllers and models in other languages, in processes of their own or sealed off in this one.
//!
//! A plug-in says what it reads, what it writes and what can be set ([`Descriptor`]). Of one plug-in there
//! can be several *members*, each with parameters and a memory of its own: one for each robot, or trial,
//! that it drives. [`Plugin`] is the border: whatever the foreign side does, what comes through it is of
//! the right length, finite and within the limits that were stated, or it is a [`Fault`].
//!
//! This crate knows nothing of robots. A module of WebAssembly runs in this process, which it cannot reach
//! out of. Any other plug-in runs in a child process and talks over its standard input and output; the
//! messages are those of [`wire`], which the book documents for other languages. A library with a C interface
//! is served by a child as well, or loaded into this process where it is trusted. An FMU is always served by
//! a child. Steps of these children pass through memory that both sides see, while both are awake.

mod conformance;
mod contract;
#[cfg(any(unix, windows))]
mod fmu;
#[cfg_attr(not(unix), allow(dead_code, unused_mut))]
mod folder;
#[cfg(all(feature = "fuzz", unix))]
#[doc(hidden)]
pub mod fuzz;
// In a page nothing is hosted, and so nothing has members.
#[cfg_attr(target_family = "wasm", allow(dead_code))]
mod local;
#[cfg(any(unix, windows))]
mod native;
// Where there are no sockets, none is started; what a file is, and what it may take, is the same there.
#[cfg_attr(not(unix), allow(dead_code, unused_imports, unused_mut))]
mod process;
#[cfg_attr(not(unix), allow(unused_imports))]
mod serve;
#[cfg(unix)]
mod shared;
#[cfg(feature = "wasm")]
mod wasm;
pub mod wire;

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

pub use conformance::{Finding, answers, conformance};
pub use contract::{Descriptor, Fault, Output, Parameter, Port};
pub use process::Limits;
pub use serve::serve;

use local::Local;
#[cfg(any(unix, windows))]
use native::Native;
use process::{Kind, Process};

/// Largest file of a plug-in, bytes.
const FILE_MAX: u64 = 1 << 28;

/// A plug-in that runs.
#[derive(Debug)]
pub struct Plugin {
    host: Host,
    descriptor: Descriptor,
    /// Least and largest number that passes, of each output.
    ranges: Vec<[f64; 2]>,
    hash: String,
    next: u32,
    /// Room for what comes back.
    results: Vec<f64>,
}

/// Where it runs.
#[derive(Debug)]
enum Host {
    Process(Box<Process>),
    Local(Box<dyn Local>),
}

impl Plugin {
    /// Starts the plug-in of a file and asks it what it is.
    ///
    /// # Errors
    /// The file cannot be read or started, or what it says of itself is refused.
    pub fn open(file: &Path, limits: Limits) -> Result<Plugin, Fault> {
        let unreadable = |error| Fault::new("file", format!("cannot be read: {error}"));
        let about = std::fs::metadata(file).map_err(unreadable)?;
        // A pipe or a device would be read for ever.
        if !about.is_file() || about.len() > FILE_MAX {
            let problem = format!("must be a regular file of at most {FILE_MAX} bytes");
            return Err(Fault::new("file", problem));
        }
        let bytes = std::fs::read(file).map_err(unreadable)?;
        let (host, described) = if limits.is_trusted && Kind::of(file) == Kind::Library {
            let mut library = library(file)?;
            let described = library.describe()?;
            (Host::Local(library), described)
        } else if Kind::of(file) == Kind::Module {
            let mut module = module(&bytes, &limits)?;
            let described = module.describe()?;
            (Host::Local(module), described)
        } else {
            let mut process = Process::start(file, limits)?;
            let described = process.describe()?;
            (Host::Process(Box::new(process)), described)
        };
        let descriptor = Descriptor::read(described)?;
        Ok(Plugin {
            host,
            ranges: descriptor.outputs.iter().map(Output::range).collect(),
            descriptor,
            hash: digest(&bytes),
            next: 0,
            results: Vec::new(),
        })
    }

    /// What it says of itself.
    pub fn descriptor(&self) -> &Descriptor {
        &self.descriptor
    }

    /// SHA-256 of its file, in hexadecimal.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// Whether it can still be spoken to.
    pub fn is_alive(&self) -> bool {
        match &self.host {
            Host::Process(process) => process.is_alive(),
            Host::Local(local) => local.is_alive(),
        }
    }

    /// Makes a member with these parameters, of those it has, in a place that `context` tells of.
    ///
    /// # Errors
    /// A parameter is unknown or out of its limits, or the plug-in refuses.
    pub fn create(
        &mut self,
        parameters: &BTreeMap<String, f64>,
        context: &Value,
    ) -> Result<u32, Fault> {
        let parameters = self.descriptor.complete(parameters)?;
        let member = self.next;
        match &mut self.host {
            Host::Process(process) => process.create(member, &parameters, context)?,
            Host::Local(local) => local.create(member, &parameters, context)?,
        }
        self.next += 1;
        Ok(member)
    }

    /// Ends a member. What cannot be ended is gone already.
    pub fn destroy(&mut self, member: u32) {
        match &mut self.host {
            Host::Process(process) => drop(process.destroy(member)),
            Host::Local(local) => local.destroy(member),
        }
    }

    /// Makes a step of `dt`, s, from `t`, s, of one member: writes its outputs, in their order.
    ///
    /// # Errors
    /// It fails, takes too long, ends, or gives what its own limits exclude; `output` is not touched.
    pub fn step(
        &mut self,
        member: u32,
        t: f64,
        dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), Fault> {
        debug_assert_eq!(input.len(), self.descriptor.inputs.len());
        let call = wire::Call {
            member,
            t,
            dt,
            input,
        };
        let Host::Local(local) = &mut self.host else {
            return self.step_many(&[call], output).map_err(|(_, fault)| fault);
        };
        self.results.resize(output.len(), f64::NAN);
        local
            .step(&call, &mut self.results)
            .map_err(|problem| Fault::new("step", problem))?;
        self.admit().map_err(|(_, fault)| fault)?;
        output.copy_from_slice(&self.results);
        Ok(())
    }

    /// Makes a step of several members at once; `output` holds theirs one after the other. The same
    /// as one by one.
    ///
    /// # Errors
    /// The first call that failed, by its place, and why; `output` is not touched.
    pub fn step_many(
        &mut self,
        calls: &[wire::Call<'_>],
        output: &mut [f64],
    ) -> Result<(), (usize, Fault)> {
        let width = self.descriptor.outputs.len();
        match &mut self.host {
            Host::Process(process) => {
                self.results.clear();
                process.step(calls, width, &mut self.results)?;
            }
            Host::Local(local) => {
                self.results.resize(calls.len() * width, f64::NAN);
                local
                    .step_many(calls, width, &mut self.results)
                    .map_err(|(k, problem)| (k, Fault::new("step", problem)))?;
            }
        }
        self.admit()?;
        output.copy_from_slice(&self.results);
        Ok(())
    }

    /// Lets results through, or says which member's does not pass, and why.
    #[inline]
    fn admit(&self) -> Result<(), (usize, Fault)> {
        let mut all_pass = true;
        for values in self.results.chunks_exact(self.ranges.len()) {
            for (&[least, largest], &value) in self.ranges.iter().zip(values) {
                // Without a branch; and what is not a number does not pass.
                all_pass &= (least <= value) & (value <= largest);
            }
        }
        match all_pass {
            true => Ok(()),
            false => self.refuse(),
        }
    }

    /// Says which member's result does not pass, and why.
    #[cold]
    fn refuse(&self) -> Result<(), (usize, Fault)> {
        let ports = &self.descriptor.outputs;
        for (k, values) in self.results.chunks_exact(ports.len()).enumerate() {
            for (port, &value) in ports.iter().zip(values) {
                port.admit(value).map_err(|fault| (k, fault))?;
            }
        }
        Ok(())
    }

    /// What a member remembers, as bytes of its own making.
    ///
    /// # Errors
    /// It fails.
    pub fn save(&mut self, member: u32) -> Result<Vec<u8>, Fault> {
        match &mut self.host {
            Host::Process(process) => process.save(member),
            Host::Local(local) => told("save", local.save(member)),
        }
    }

    /// Gives a member back what one of its kind remembered.
    ///
    /// # Errors
    /// It does not take it.
    pub fn restore(&mut self, member: u32, bytes: &[u8]) -> Result<(), Fault> {
        match &mut self.host {
            Host::Process(process) => process.restore(member, bytes),
            Host::Local(local) => told("restore", local.restore(member, bytes)),
        }
    }

    /// Tells a member, which is about to take over from another block, what that one wrote last.
    ///
    /// # Errors
    /// It does not take it.
    pub fn take_over(&mut self, member: u32, outputs: &[f64]) -> Result<(), Fault> {
        match &mut self.host {
            Host::Process(process) => process.take_over(member, outputs),
            Host::Local(local) => told("take_over", local.take_over(member, outputs)),
        }
    }
}

/// Loads a library into this process.
#[cfg(any(unix, windows))]
fn library(file: &Path) -> Result<Box<dyn Local>, Fault> {
    Ok(Box::new(Native::open_copy(file)?))
}

/// Says that there are no libraries here.
#[cfg(not(any(unix, windows)))]
fn library(_file: &Path) -> Result<Box<dyn Local>, Fault> {
    Err(Fault::new("start", "this system loads no libraries"))
}

/// Makes an instance of a module.
#[cfg(feature = "wasm")]
fn module(bytes: &[u8], limits: &Limits) -> Result<Box<dyn Local>, Fault> {
    Ok(Box::new(wasm::Wasm::open(bytes, limits)?))
}

/// Says what is missing.
#[cfg(not(feature = "wasm"))]
fn module(_bytes: &[u8], _limits: &Limits) -> Result<Box<dyn Local>, Fault> {
    let problem = "needs the host for WebAssembly, without which this program was built";
    Err(Fault::new("start", problem).hint(
        "build it with --features wasm: cargo build --release --features wasm, once some minutes more",
    ))
}

/// What a plug-in in this process says of a call that failed.
fn told<R>(field: &str, result: Result<R, String>) -> Result<R, Fault> {
    result.map_err(|problem| Fault::new(field, problem))
}

/// SHA-256 of bytes, in hexadecimal.
pub fn digest(bytes: &[u8]) -> String {
    use sha2::Digest;
    let digest = sha2::Sha256::digest(bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}
