//! The functions of FMI 2.0.

use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::path::Path;
use std::ptr::{NonNull, null_mut};

use libloading::Library;

use super::{Failure, Identity, Instance, Interface, check, check_size, function, keep_message};
use crate::contract::Fault;

type Status = c_int;
type Boolean = c_int;
type Component = *mut c_void;
type State = *mut c_void;
type Message = *const c_char;

const TRUE: Boolean = 1;
const FALSE: Boolean = 0;
/// Kind of an instance for co-simulation.
const CO_SIMULATION: c_int = 1;

type Instantiate = unsafe extern "C" fn(
    Message,
    c_int,
    Message,
    Message,
    *const Callbacks,
    Boolean,
    Boolean,
) -> Component;
type SetupExperiment = unsafe extern "C" fn(Component, Boolean, f64, f64, Boolean, f64) -> Status;
type Plain = unsafe extern "C" fn(Component) -> Status;
type SetReal = unsafe extern "C" fn(Component, *const c_uint, usize, *const f64) -> Status;
type GetReal = unsafe extern "C" fn(Component, *const c_uint, usize, *mut f64) -> Status;
type DoStep = unsafe extern "C" fn(Component, f64, f64, Boolean) -> Status;
type Free = unsafe extern "C" fn(Component);
type OneState = unsafe extern "C" fn(Component, State) -> Status;
type OutState = unsafe extern "C" fn(Component, *mut State) -> Status;
type StateSize = unsafe extern "C" fn(Component, State, *mut usize) -> Status;
type ReadState = unsafe extern "C" fn(Component, State, *mut u8, usize) -> Status;
type WriteState = unsafe extern "C" fn(Component, *const u8, usize, *mut State) -> Status;

/// What an FMU may call.
#[repr(C)]
#[derive(Debug)]
struct Callbacks {
    logger: unsafe extern "C" fn(*mut c_void, Message, Status, Message, Message),
    allocate_memory: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    free_memory: unsafe extern "C" fn(*mut c_void),
    /// None: no step goes on behind the caller's back.
    step_finished: Option<unsafe extern "C" fn(*mut c_void, Status)>,
    /// A pointer that is none, as a number: so all threads may share it.
    environment: usize,
}

/// Lasts longer than any instance.
static CALLBACKS: Callbacks = Callbacks {
    logger,
    allocate_memory: calloc,
    free_memory: free,
    step_finished: None,
    environment: 0,
};

// SAFETY: both are as the C library declares them.
unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(memory: *mut c_void);
}

/// Keeps a message, without the numbers that go into it.
///
/// In C it takes more arguments, as `printf` does, which cannot be written here. Callers pass the five that
/// are named where any function has them, and clean up behind themselves the rest, which is not looked at:
/// so it is in all calling conventions of the platforms that FMI has names for (System V and Windows on
/// x86-64; AAPCS64, and Apple's, on ARM). Of 32-bit Windows, it is that of C, `cdecl`, too.
///
/// # Safety
/// The message is none, or ends with zero.
unsafe extern "C" fn logger(
    _: *mut c_void,
    _: Message,
    status: Status,
    _: Message,
    message: Message,
) {
    // SAFETY: as demanded above.
    unsafe { keep_message(status, message) };
}

/// The functions of a library.
#[derive(Debug)]
pub(super) struct Functions {
    instantiate: Instantiate,
    setup_experiment: SetupExperiment,
    enter: Plain,
    exit: Plain,
    set: SetReal,
    get: GetReal,
    step: DoStep,
    terminate: Plain,
    free: Free,
    states: Option<States>,
}

/// Those for states, where it offers them.
#[derive(Debug)]
struct States {
    get: OutState,
    set: OneState,
    free: OutState,
    size: StateSize,
    serialize: ReadState,
    deserialize: WriteState,
}

impl Functions {
    /// Finds them.
    ///
    /// # Errors
    /// One is missing.
    pub(super) fn find(library: &Library, can_save: bool) -> Result<Functions, Fault> {
        // SAFETY: the types are those of the standard, which the version in the description stands for.
        unsafe {
            let states = || -> Result<States, Fault> {
                Ok(States {
                    get: function(library, "fmi2GetFMUstate")?,
                    set: function(library, "fmi2SetFMUstate")?,
                    free: function(library, "fmi2FreeFMUstate")?,
                    size: function(library, "fmi2SerializedFMUstateSize")?,
                    serialize: function(library, "fmi2SerializeFMUstate")?,
                    deserialize: function(library, "fmi2DeSerializeFMUstate")?,
                })
            };
            Ok(Functions {
                instantiate: function(library, "fmi2Instantiate")?,
                setup_experiment: function(library, "fmi2SetupExperiment")?,
                enter: function(library, "fmi2EnterInitializationMode")?,
                exit: function(library, "fmi2ExitInitializationMode")?,
                set: function(library, "fmi2SetReal")?,
                get: function(library, "fmi2GetReal")?,
                step: function(library, "fmi2DoStep")?,
                terminate: function(library, "fmi2Terminate")?,
                free: function(library, "fmi2FreeInstance")?,
                states: can_save.then(states).transpose()?,
            })
        }
    }

    fn states(&self) -> Result<&States, Failure> {
        let states = self.states.as_ref();
        states.ok_or_else(|| Failure::new("the FMU does not offer its state"))
    }
}

impl Interface for Functions {
    fn instantiate(&self, identity: &Identity<'_>) -> Option<Instance> {
        let resources = CString::new(address(identity.resources)).ok()?;
        // SAFETY: texts that end with zero and last as long as the call; callbacks that last for ever.
        let made = unsafe {
            (self.instantiate)(
                identity.name.as_ptr(),
                CO_SIMULATION,
                identity.token.as_ptr(),
                resources.as_ptr(),
                &CALLBACKS,
                FALSE,
                TRUE,
            )
        };
        NonNull::new(made).map(Instance)
    }

    fn enter(&self, instance: &Instance, t: f64) -> Result<(), Failure> {
        let made = instance.0.as_ptr();
        // SAFETY: the instance is there; neither a tolerance nor an end is given.
        let status = unsafe { (self.setup_experiment)(made, FALSE, 0.0, t, FALSE, 0.0) };
        check("fmi2SetupExperiment", status)?;
        // SAFETY: the instance is there.
        check("fmi2EnterInitializationMode", unsafe { (self.enter)(made) })
    }

    fn exit(&self, instance: &Instance) -> Result<(), Failure> {
        // SAFETY: the instance is there.
        let status = unsafe { (self.exit)(instance.0.as_ptr()) };
        check("fmi2ExitInitializationMode", status)
    }

    fn set(&self, instance: &Instance, references: &[u32], values: &[f64]) -> Result<(), Failure> {
        if references.is_empty() {
            return Ok(());
        }
        let (list, count) = (references.as_ptr(), references.len().min(values.len()));
        // SAFETY: the instance is there; no more numbers than there are references and values.
        let status = unsafe { (self.set)(instance.0.as_ptr(), list, count, values.as_ptr()) };
        check("fmi2SetReal", status)
    }

    fn get(
        &self,
        instance: &Instance,
        references: &[u32],
        values: &mut [f64],
    ) -> Result<(), Failure> {
        let (list, count) = (references.as_ptr(), references.len().min(values.len()));
        // SAFETY: the instance is there; no more numbers than there are references and room.
        let status = unsafe { (self.get)(instance.0.as_ptr(), list, count, values.as_mut_ptr()) };
        check("fmi2GetReal", status)
    }

    fn step(&self, instance: &Instance, t: f64, dt: f64) -> Result<(), Failure> {
        // What can be saved can be brought back to an earlier time.
        let goes_on = if self.states.is_some() { FALSE } else { TRUE };
        // SAFETY: the instance is there.
        let status = unsafe { (self.step)(instance.0.as_ptr(), t, dt, goes_on) };
        check("fmi2DoStep", status)
    }

    fn save(&self, instance: &Instance) -> Result<Vec<u8>, Failure> {
        let states = self.states()?;
        let made = instance.0.as_ptr();
        let mut state = null_mut();
        let mut bytes = Vec::new();
        // SAFETY: the instance is there, the state comes from it and is freed by it, and there is as much
        // room as it is told.
        unsafe {
            check("fmi2GetFMUstate", (states.get)(made, &mut state))?;
            let mut size = 0;
            let sized = (states.size)(made, state, &mut size);
            let read = check("fmi2SerializedFMUstateSize", sized)
                .and_then(|()| check_size(size))
                .and_then(|()| {
                    bytes.resize(size, 0);
                    let status = (states.serialize)(made, state, bytes.as_mut_ptr(), size);
                    check("fmi2SerializeFMUstate", status)
                });
            let is_fatal = read.as_ref().is_err_and(|failure| failure.is_fatal);
            if !is_fatal {
                check("fmi2FreeFMUstate", (states.free)(made, &mut state))?;
            }
            read?;
        }
        Ok(bytes)
    }

    fn restore(&self, instance: &Instance, bytes: &[u8]) -> Result<(), Failure> {
        let states = self.states()?;
        let made = instance.0.as_ptr();
        let mut state = null_mut();
        // SAFETY: the instance is there, the state comes from it and is freed by it.
        unsafe {
            let status = (states.deserialize)(made, bytes.as_ptr(), bytes.len(), &mut state);
            check("fmi2DeSerializeFMUstate", status)?;
            check("fmi2SetFMUstate", (states.set)(made, state))?;
            check("fmi2FreeFMUstate", (states.free)(made, &mut state))
        }
    }

    fn terminate(&self, instance: &Instance) {
        // SAFETY: the instance is there. It is freed whatever this gives.
        let _ = unsafe { (self.terminate)(instance.0.as_ptr()) };
    }

    fn free(&self, instance: Instance) {
        // SAFETY: the instance is there, and no longer after this.
        unsafe { (self.free)(instance.0.as_ptr()) };
    }
}

/// A folder as an address, in which all but plain letters are written as numbers.
fn address(folder: &Path) -> String {
    let path = folder.to_string_lossy();
    let path = path.strip_prefix('/').unwrap_or(&path);
    let mut address = String::from("file:///");
    for byte in path.bytes() {
        let is_plain = byte.is_ascii_alphanumeric() || b"/-._~:".contains(&byte);
        match (byte, is_plain) {
            (b'\\', _) => address.push('/'),
            (_, true) => address.push(char::from(byte)),
            (_, false) => address.push_str(&format!("%{byte:02X}")),
        }
    }
    address
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_answer_of_addresses() {
        assert_eq!(
            address(Path::new("/tmp/a b/ü_%/resources")),
            "file:///tmp/a%20b/%C3%BC_%25/resources"
        );
    }
}
