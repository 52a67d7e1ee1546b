//! The functions of FMI 3.0.

use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::path::MAIN_SEPARATOR;
use std::ptr::{NonNull, null, null_mut};

use libloading::Library;

use super::{
    Failure, Identity, Instance, Interface, check, check_size, function, keep_message, message,
};
use crate::contract::Fault;

type Status = c_int;
type Made = *mut c_void;
type State = *mut c_void;
type Message = *const c_char;
type LogMessage = unsafe extern "C" fn(*mut c_void, Status, Message, Message);

type Instantiate = unsafe extern "C" fn(
    Message,
    Message,
    Message,
    bool,
    bool,
    bool,
    bool,
    *const c_uint,
    usize,
    *mut c_void,
    LogMessage,
    Option<unsafe extern "C" fn()>,
) -> Made;
type Enter = unsafe extern "C" fn(Made, bool, f64, f64, bool, f64) -> Status;
type Plain = unsafe extern "C" fn(Made) -> Status;
type SetFloat64 = unsafe extern "C" fn(Made, *const c_uint, usize, *const f64, usize) -> Status;
type GetFloat64 = unsafe extern "C" fn(Made, *const c_uint, usize, *mut f64, usize) -> Status;
/// What it writes as truth values are bytes here: a Rust `bool` may not be other than 0 or 1.
type DoStep =
    unsafe extern "C" fn(Made, f64, f64, bool, *mut u8, *mut u8, *mut u8, *mut f64) -> Status;
type Free = unsafe extern "C" fn(Made);
type OneState = unsafe extern "C" fn(Made, State) -> Status;
type OutState = unsafe extern "C" fn(Made, *mut State) -> Status;
type StateSize = unsafe extern "C" fn(Made, State, *mut usize) -> Status;
type ReadState = unsafe extern "C" fn(Made, State, *mut u8, usize) -> Status;
type WriteState = unsafe extern "C" fn(Made, *const u8, usize, *mut State) -> Status;

/// Keeps a message.
///
/// # Safety
/// The message is none, or ends with zero.
unsafe extern "C" fn log_message(_: *mut c_void, status: Status, _: Message, message: Message) {
    // SAFETY: as demanded above.
    unsafe { keep_message(status, message) };
}

/// The functions of a library.
#[derive(Debug)]
pub(super) struct Functions {
    instantiate: Instantiate,
    enter: Enter,
    exit: Plain,
    set: SetFloat64,
    get: GetFloat64,
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
                    get: function(library, "fmi3GetFMUState")?,
                    set: function(library, "fmi3SetFMUState")?,
                    free: function(library, "fmi3FreeFMUState")?,
                    size: function(library, "fmi3SerializedFMUStateSize")?,
                    serialize: function(library, "fmi3SerializeFMUState")?,
                    deserialize: function(library, "fmi3DeserializeFMUState")?,
                })
            };
            Ok(Functions {
                instantiate: function(library, "fmi3InstantiateCoSimulation")?,
                enter: function(library, "fmi3EnterInitializationMode")?,
                exit: function(library, "fmi3ExitInitializationMode")?,
                set: function(library, "fmi3SetFloat64")?,
                get: function(library, "fmi3GetFloat64")?,
                step: function(library, "fmi3DoStep")?,
                terminate: function(library, "fmi3Terminate")?,
                free: function(library, "fmi3FreeInstance")?,
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
        let resources = format!("{}{MAIN_SEPARATOR}", identity.resources.display());
        let resources = CString::new(resources).ok()?;
        let (is_visible, is_logging) = (false, true);
        let (uses_events, may_return_early) = (false, false);
        // SAFETY: texts that end with zero and last as long as the call; no variables between steps.
        let made = unsafe {
            (self.instantiate)(
                identity.name.as_ptr(),
                identity.token.as_ptr(),
                resources.as_ptr(),
                is_visible,
                is_logging,
                uses_events,
                may_return_early,
                null(),
                0,
                null_mut(),
                log_message,
                None,
            )
        };
        NonNull::new(made).map(Instance)
    }

    fn enter(&self, instance: &Instance, t: f64) -> Result<(), Failure> {
        // SAFETY: the instance is there; neither a tolerance nor an end is given.
        let status = unsafe { (self.enter)(instance.0.as_ptr(), false, 0.0, t, false, 0.0) };
        check("fmi3EnterInitializationMode", status)
    }

    fn exit(&self, instance: &Instance) -> Result<(), Failure> {
        // SAFETY: the instance is there.
        let status = unsafe { (self.exit)(instance.0.as_ptr()) };
        check("fmi3ExitInitializationMode", status)
    }

    fn set(&self, instance: &Instance, references: &[u32], values: &[f64]) -> Result<(), Failure> {
        if references.is_empty() {
            return Ok(());
        }
        let (made, list) = (instance.0.as_ptr(), references.as_ptr());
        let count = references.len().min(values.len());
        // SAFETY: the instance is there; no more numbers than there are references and values.
        let status = unsafe { (self.set)(made, list, count, values.as_ptr(), count) };
        check("fmi3SetFloat64", status)
    }

    fn get(
        &self,
        instance: &Instance,
        references: &[u32],
        values: &mut [f64],
    ) -> Result<(), Failure> {
        let (made, list) = (instance.0.as_ptr(), references.as_ptr());
        let count = references.len().min(values.len());
        // SAFETY: the instance is there; no more numbers than there are references and room.
        let status = unsafe { (self.get)(made, list, count, values.as_mut_ptr(), count) };
        check("fmi3GetFloat64", status)
    }

    fn step(&self, instance: &Instance, t: f64, dt: f64) -> Result<(), Failure> {
        // What can be saved can be brought back to an earlier time.
        let goes_on = self.states.is_none();
        let (mut has_event, mut wants_end, mut is_early) = (0, 0, 0);
        let mut reached = t;
        // SAFETY: the instance is there, and there is room for what it writes.
        let status = unsafe {
            (self.step)(
                instance.0.as_ptr(),
                t,
                dt,
                goes_on,
                &mut has_event,
                &mut wants_end,
                &mut is_early,
                &mut reached,
            )
        };
        check("fmi3DoStep", status)?;
        if wants_end != 0 {
            let text = format!(
                "the FMU asked to end the simulation at {reached} s{}",
                message()
            );
            return Err(Failure::new(text));
        }
        if is_early != 0 {
            let text = format!(
                "the FMU stopped at {reached} s, within a step from {t} s to {} s, which it was not allowed to",
                t + dt
            );
            return Err(Failure::new(text));
        }
        Ok(())
    }

    fn save(&self, instance: &Instance) -> Result<Vec<u8>, Failure> {
        let states = self.states()?;
        let made = instance.0.as_ptr();
        let mut state = null_mut();
        let mut bytes = Vec::new();
        // SAFETY: the instance is there, the state comes from it and is freed by it, and there is as much
        // room as it is told.
        unsafe {
            check("fmi3GetFMUState", (states.get)(made, &mut state))?;
            let mut size = 0;
            let sized = (states.size)(made, state, &mut size);
            let read = check("fmi3SerializedFMUStateSize", sized)
                .and_then(|()| check_size(size))
                .and_then(|()| {
                    bytes.resize(size, 0);
                    let status = (states.serialize)(made, state, bytes.as_mut_ptr(), size);
                    check("fmi3SerializeFMUState", status)
                });
            let is_fatal = read.as_ref().is_err_and(|failure| failure.is_fatal);
            if !is_fatal {
                check("fmi3FreeFMUState", (states.free)(made, &mut state))?;
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
            check("fmi3DeserializeFMUState", status)?;
            check("fmi3SetFMUState", (states.set)(made, state))?;
            check("fmi3FreeFMUState", (states.free)(made, &mut state))
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
