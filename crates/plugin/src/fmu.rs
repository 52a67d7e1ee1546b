//! An FMU for co-simulation, of FMI 2.0 or 3.0, as a plug-in.
//!
//! An FMU is an archive with a description and, for each platform, a shared library. It is foreign code that
//! others exported, and is served from a process of its own always: see [`crate::serve()`].
//!
//! A step from `t` of length `dt` sets the inputs to what they are at `t`, lets the FMU go to `t + dt`, and
//! gets the outputs that it has there. So an output answers an input within the same step, as that of any
//! other controller, but what it says is meant for the end of the step.
//!
//! An FMU keeps its own time, and cannot skip any. It begins with the first step of a member, at the time of
//! that step; then every step has to begin where the one before ended. A member that takes over after others
//! did begins anew.
//!
//! What it remembers can be saved where it offers its state as bytes.

// An FMU is foreign code: what it does cannot be checked, only what it returns.
#![allow(unsafe_code)]

pub(crate) mod archive;
pub(crate) mod description;
mod three;
mod two;

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::fmt::Debug;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::{Mutex, PoisonError};

use libloading::Library;
use serde_json::Value;

use crate::contract::Fault;
use crate::folder::Folder;
use crate::local::Local;
use crate::wire::{BODY_MAX, Call};
use description::{Description, Version};

/// Longest message of an FMU that is kept, characters.
const MESSAGE_MAX: usize = 400;
/// How far from the end of the last step the next may begin, in lengths of it: time is added up with
/// rounding.
const GAP: f64 = 1e-6;

/// An FMU and its members.
#[derive(Debug)]
pub(crate) struct Fmu {
    description: Description,
    interface: Box<dyn Interface>,
    members: Vec<(u32, Member)>,
    /// Whether it said that nothing of it can be used any more.
    is_lost: bool,
    /// Where it is unpacked; dropped last.
    folder: Folder,
}

/// One instance of an FMU and how far it is.
#[derive(Debug)]
struct Member {
    /// None once it failed.
    instance: Option<Instance>,
    parameters: Vec<f64>,
    /// None until the first step.
    clock: Option<Clock>,
}

/// Where a member is in time.
#[derive(Clone, Copy, Debug)]
struct Clock {
    /// End of its last step, s.
    end: f64,
    /// Length of its first step, s; 0 before that.
    dt: f64,
}

/// What the library made, and `free` takes: while there is one, it can be used.
#[derive(Debug)]
struct Instance(NonNull<c_void>);

// SAFETY: an FMU is served by one thread, which makes, uses and frees its instances.
unsafe impl Send for Instance {}

/// What instances are made of.
struct Identity<'a> {
    name: &'a CStr,
    token: &'a CStr,
    resources: &'a Path,
}

/// A call that failed.
#[derive(Debug)]
struct Failure {
    text: String,
    /// Whether no instance of the FMU may be used any more.
    is_fatal: bool,
}

/// The functions of one version of FMI.
///
/// As many numbers are set and got as there are references.
trait Interface: Debug + Send {
    /// Makes an instance.
    fn instantiate(&self, identity: &Identity<'_>) -> Option<Instance>;

    /// Begins to initialize at `t`, s.
    fn enter(&self, instance: &Instance, t: f64) -> Result<(), Failure>;

    /// Ends to initialize.
    fn exit(&self, instance: &Instance) -> Result<(), Failure>;

    /// Sets numbers.
    fn set(&self, instance: &Instance, references: &[u32], values: &[f64]) -> Result<(), Failure>;

    /// Gets numbers.
    fn get(
        &self,
        instance: &Instance,
        references: &[u32],
        values: &mut [f64],
    ) -> Result<(), Failure>;

    /// Goes from `t` to `t + dt`, s.
    fn step(&self, instance: &Instance, t: f64, dt: f64) -> Result<(), Failure>;

    /// Its state as bytes.
    fn save(&self, instance: &Instance) -> Result<Vec<u8>, Failure>;

    /// Gives it a state back.
    fn restore(&self, instance: &Instance, bytes: &[u8]) -> Result<(), Failure>;

    /// Ends its simulation.
    fn terminate(&self, instance: &Instance);

    /// Ends it.
    fn free(&self, instance: Instance);
}

impl Failure {
    fn new(text: impl Into<String>) -> Self {
        Failure {
            text: text.into(),
            is_fatal: false,
        }
    }
}

impl Fmu {
    /// Unpacks the FMU of a file and loads its library.
    pub(crate) fn open(file: &Path) -> Result<Fmu, Fault> {
        let folder = archive::unpack(file)?;
        let description = Description::open(folder.path())?;
        let binary = binary(folder.path(), &description)?;
        // An FMU may rely on its being there, with or without something in it.
        std::fs::create_dir_all(folder.path().join("resources"))
            .map_err(|error| Fault::new("file", format!("cannot be unpacked: {error}")))?;
        // SAFETY: its initializers run, as those of any library; it is loaded in a process of its own.
        let library =
            unsafe { Library::new(&binary) }.map_err(|error| failed(&error, folder.path()))?;
        // It stays until the process ends: some run threads, or an interpreter, that outlive an instance.
        let library = ManuallyDrop::new(library);
        let can_save = description.can_save;
        let interface: Box<dyn Interface> = match description.version {
            Version::Two => Box::new(two::Functions::find(&library, can_save)?),
            Version::Three => Box::new(three::Functions::find(&library, can_save)?),
        };
        Ok(Fmu {
            description,
            interface,
            members: Vec::new(),
            is_lost: false,
            folder,
        })
    }

    /// Where it is unpacked.
    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Makes an instance with its parameters set.
    fn instantiate(&mut self, member: u32, parameters: &[f64]) -> Result<Instance, Failure> {
        if self.is_lost {
            return Err(Failure::new("its FMU failed for good before"));
        }
        let has_one = || self.members.iter().any(|(_, m)| m.instance.is_some());
        if self.description.is_single && has_one() {
            return Err(Failure::new(
                "it can be instantiated only once in a process (canBeInstantiatedOnlyOncePerProcess), and has a member already",
            ));
        }
        forget_message();
        let text = |text: String| CString::new(text).expect("XML has no zero byte");
        let name = text(format!("{}-{member}", self.description.descriptor.name));
        let token = text(self.description.token.clone());
        let identity = Identity {
            name: &name,
            token: &token,
            resources: &self.folder.path().join("resources"),
        };
        let made = self.interface.instantiate(&identity);
        let Some(instance) = made else {
            let text = format!("made no instance{}", message());
            return Err(Failure::new(text));
        };
        let set = self
            .interface
            .set(&instance, &self.description.parameters, parameters);
        match set {
            Ok(()) => Ok(instance),
            Err(failure) => {
                self.abandon(instance, &failure);
                Err(failure)
            }
        }
    }

    /// Ends an instance after a failure.
    fn abandon(&mut self, instance: Instance, failure: &Failure) {
        match failure.is_fatal {
            // Nothing may be called any more, not even what would free it.
            true => self.is_lost = true,
            false => self.interface.free(instance),
        }
    }

    fn find(&mut self, member: u32) -> Result<usize, String> {
        let known = |(known, _): &(u32, Member)| *known == member;
        let place = self.members.iter().position(known);
        place.ok_or_else(|| format!("has no member {member}"))
    }

    /// Does something with the instance of a member, which ends if that fails.
    fn with<R>(
        &mut self,
        place: usize,
        action: impl FnOnce(&Description, &dyn Interface, &Instance) -> Result<R, Failure>,
    ) -> Result<R, String> {
        let Some(instance) = &self.members[place].1.instance else {
            return Err("it failed before".into());
        };
        if self.is_lost {
            return Err("its FMU failed for good before".into());
        }
        forget_message();
        action(&self.description, &*self.interface, instance).map_err(|failure| {
            let (_, member) = &mut self.members[place];
            if let Some(instance) = member.instance.take() {
                self.abandon(instance, &failure);
            }
            failure.text
        })
    }

    /// Ends what a member has, and makes it anew, as it was before its first step.
    fn renew(&mut self, place: usize) -> Result<(), String> {
        self.end(place);
        let number = self.members[place].0;
        let parameters = self.members[place].1.parameters.clone();
        let made = self.instantiate(number, &parameters);
        self.members[place].1.instance = Some(made.map_err(|failure| failure.text)?);
        Ok(())
    }

    /// Ends what a member has.
    fn end(&mut self, place: usize) {
        let (_, member) = &mut self.members[place];
        let has_begun = member.clock.take().is_some();
        if let Some(instance) = member.instance.take()
            && !self.is_lost
        {
            if has_begun {
                self.interface.terminate(&instance);
            }
            self.interface.free(instance);
        }
    }

    /// Begins the simulation of a member at `t`, with inputs if there are any yet.
    fn begin(&mut self, place: usize, t: f64, input: Option<&[f64]>) -> Result<(), String> {
        self.with(place, |description, interface, instance| {
            interface.enter(instance, t)?;
            if let Some(input) = input {
                interface.set(instance, &description.inputs, input)?;
            }
            interface.exit(instance)
        })?;
        self.members[place].1.clock = Some(Clock { end: t, dt: 0.0 });
        Ok(())
    }

    /// Refuses a step that the FMU could not make.
    fn check(&self, clock: Clock, call: &Call<'_>) -> Result<(), String> {
        let Call { t, dt, .. } = *call;
        if dt.is_nan() || dt <= 0.0 {
            return Err(format!("needs steps longer than 0 s, got {dt}"));
        }
        let is_other = clock.dt != 0.0 && (dt - clock.dt).abs() > GAP * clock.dt;
        if is_other && !self.description.has_free_steps {
            return Err(format!(
                "needs steps of one length (canHandleVariableCommunicationStepSize is not true): began with {} s, got {dt} s",
                clock.dt
            ));
        }
        if (t - clock.end).abs() > GAP * dt {
            return Err(format!(
                "keeps its own time, which is {} s: cannot step from {t} s",
                clock.end
            ));
        }
        Ok(())
    }
}

impl Local for Fmu {
    fn describe(&mut self) -> Result<Value, Fault> {
        Ok(self.description.described())
    }

    fn create(
        &mut self,
        member: u32,
        parameters: &[(String, f64)],
        _context: &Value,
    ) -> Result<(), Fault> {
        let parameters: Vec<f64> = parameters.iter().map(|(_, value)| *value).collect();
        let made = self.instantiate(member, &parameters);
        let instance = made.map_err(|failure| Fault::new("create", failure.text))?;
        let member = (
            member,
            Member {
                instance: Some(instance),
                parameters,
                clock: None,
            },
        );
        self.members.push(member);
        Ok(())
    }

    fn destroy(&mut self, member: u32) {
        if let Ok(place) = self.find(member) {
            self.end(place);
            self.members.swap_remove(place);
        }
    }

    fn step(&mut self, call: &Call<'_>, results: &mut [f64]) -> Result<(), String> {
        let place = self.find(call.member)?;
        let clock = self.members[place].1.clock;
        let new = Clock {
            end: call.t,
            dt: 0.0,
        };
        self.check(clock.unwrap_or(new), call)?;
        if clock.is_none() {
            self.begin(place, call.t, Some(call.input))?;
        }
        self.with(place, |description, interface, instance| {
            interface.set(instance, &description.inputs, call.input)?;
            interface.step(instance, call.t, call.dt)?;
            results.fill(f64::NAN);
            interface.get(instance, &description.outputs, results)
        })?;
        let first = clock.map_or(0.0, |clock| clock.dt);
        self.members[place].1.clock = Some(Clock {
            end: call.t + call.dt,
            dt: if first == 0.0 { call.dt } else { first },
        });
        Ok(())
    }

    fn save(&mut self, member: u32) -> Result<Vec<u8>, String> {
        let place = self.find(member)?;
        if !self.description.can_save {
            return Err(
                "cannot be saved: the FMU does not offer its state (canGetAndSetFMUState and canSerializeFMUState)"
                    .into(),
            );
        }
        let Some(clock) = self.members[place].1.clock else {
            return Ok(Vec::new());
        };
        let state = self.with(place, |_, interface, instance| interface.save(instance))?;
        let mut bytes = clock.end.to_le_bytes().to_vec();
        bytes.extend_from_slice(&clock.dt.to_le_bytes());
        bytes.extend(state);
        Ok(bytes)
    }

    fn restore(&mut self, member: u32, bytes: &[u8]) -> Result<(), String> {
        let place = self.find(member)?;
        let is_new = self.members[place].1.clock.is_none();
        let has_failed = self.members[place].1.instance.is_none();
        if has_failed || bytes.is_empty() && !is_new {
            self.renew(place)?;
        }
        if bytes.is_empty() {
            return Ok(());
        }
        let short = "what it remembers is too short";
        let (end, rest) = bytes.split_first_chunk::<8>().ok_or(short)?;
        let (dt, state) = rest.split_first_chunk::<8>().ok_or(short)?;
        let (end, dt) = (f64::from_le_bytes(*end), f64::from_le_bytes(*dt));
        if !self.description.can_save {
            return Err("has no memory to restore".into());
        }
        // A state belongs into an instance that has begun.
        if self.members[place].1.clock.is_none() {
            self.begin(place, end, None)?;
        }
        self.with(place, |_, interface, instance| {
            interface.restore(instance, state)
        })?;
        self.members[place].1.clock = Some(Clock { end, dt });
        Ok(())
    }

    fn take_over(&mut self, member: u32, _outputs: &[f64]) -> Result<(), String> {
        let place = self.find(member)?;
        match self.members[place].1.clock {
            None => Ok(()),
            // It did not see the time between.
            Some(_) => self.renew(place),
        }
    }
}

impl Drop for Fmu {
    fn drop(&mut self) {
        for place in 0..self.members.len() {
            self.end(place);
        }
    }
}

/// The library for this platform.
fn binary(folder: &Path, description: &Description) -> Result<PathBuf, Fault> {
    let platform = platform(description.version);
    let suffix = std::env::consts::DLL_SUFFIX;
    let name = format!("{}{suffix}", description.identifier);
    let file = folder.join("binaries").join(&platform).join(&name);
    if file.is_file() {
        return Ok(file);
    }
    let all = std::fs::read_dir(folder.join("binaries"));
    let all = all.into_iter().flatten().flatten();
    let mut has: Vec<String> = all
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    has.sort();
    let has = match has.is_empty() {
        true => "none for any platform".to_owned(),
        false => format!("those for {}", has.join(", ")),
    };
    let problem =
        format!("must have a binary for this platform, binaries/{platform}/{name}, has {has}");
    Err(Fault::new("file", problem).hint("export it anew for this platform"))
}

/// Why a library cannot be loaded, without the folder, which is another each time.
fn failed(error: &libloading::Error, folder: &Path) -> Fault {
    let reason = std::error::Error::source(error).map_or(error.to_string(), ToString::to_string);
    let reason = reason.replace(&format!("{}/", folder.display()), "");
    // Those that run Python code take for granted that whoever loads them is Python.
    let cure = match reason.contains("undefined symbol: _Py")
        || reason.contains("undefined symbol: Py")
    {
        true => {
            ". It needs Python in its process: name its library, as in LD_PRELOAD=libpython3.11.so"
        }
        false => "",
    };
    Fault::new("start", format!("cannot be loaded: {reason}{cure}"))
        .hint("it needs the libraries of the system that its exporter used")
}

/// A function of a library.
///
/// # Safety
/// `F` is its type.
unsafe fn function<F: Copy>(library: &Library, name: &str) -> Result<F, Fault> {
    // SAFETY: as demanded above.
    let found = unsafe { library.get::<F>(name) };
    let missing = |_| Fault::new("start", format!("must have the function {name}, has none"));
    found.map(|found| *found).map_err(missing)
}

/// What a version calls this platform.
fn platform(version: Version) -> String {
    let arch = std::env::consts::ARCH;
    let system = match std::env::consts::OS {
        "macos" => "darwin",
        other => other,
    };
    let bits = match (version, arch, system) {
        (Version::Two, "x86_64", "linux" | "windows") => "64",
        (Version::Two, "x86", "linux" | "windows") => "32",
        (Version::Two, _, "darwin") => "64",
        // What FMI 2 had no name for is named as in FMI 3.
        _ => return format!("{arch}-{system}"),
    };
    let system = if system == "windows" { "win" } else { system };
    format!("{system}{bits}")
}

/// The worst that an FMU said since the last call, and how bad it was.
///
/// One for all members, as they are called one after the other; what an FMU gives back to tell its instances
/// apart would have to be believed.
static MESSAGE: Mutex<(c_int, String)> = Mutex::new((0, String::new()));

fn forget_message() {
    let mut kept = MESSAGE.lock().unwrap_or_else(PoisonError::into_inner);
    kept.0 = 0;
    kept.1.clear();
}

/// Keeps a message of an FMU. Most need to be told to say anything in order to say what went wrong: what
/// they say when all is well is passed over.
///
/// # Safety
/// The pointer is none, or to bytes that end with zero.
unsafe fn keep_message(status: c_int, pointer: *const c_char) {
    let mut kept = MESSAGE.lock().unwrap_or_else(PoisonError::into_inner);
    if pointer.is_null() || status < 1 || status < kept.0 {
        return;
    }
    // SAFETY: as demanded above.
    let text = unsafe { CStr::from_ptr(pointer) }.to_string_lossy();
    *kept = (status, text.trim().chars().take(MESSAGE_MAX).collect());
}

/// The worst that an FMU said, as the end of a sentence.
fn message() -> String {
    let (_, kept) = &*MESSAGE.lock().unwrap_or_else(PoisonError::into_inner);
    match kept.is_empty() {
        true => String::new(),
        false => format!(": {kept}"),
    }
}

/// What a function returned: 0 and 1, with a warning, are well. Both versions count alike.
fn check(function: &str, status: c_int) -> Result<(), Failure> {
    let name = match status {
        0 | 1 => return Ok(()),
        2 => "discard",
        3 => "error",
        4 => "fatal",
        5 => "pending",
        _ => "an unknown status",
    };
    Err(Failure {
        text: format!("{function} gave {name} ({status}){}", message()),
        // What is pending still runs.
        is_fatal: !matches!(status, 2 | 3),
    })
}

/// Refuses a state that is no memory to be sent.
fn check_size(size: usize) -> Result<(), Failure> {
    match size > BODY_MAX - 64 {
        true => Err(Failure::new(format!(
            "remembers {size} bytes, more than {BODY_MAX}"
        ))),
        false => Ok(()),
    }
}
