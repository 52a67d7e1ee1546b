//! A plug-in as a library with a C interface, loaded into this process.
//!
//! The interface is that of `sdk/c/appell_plugin.h`.

// A library is foreign code: what it does cannot be checked, only what it returns.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char, c_void};
use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use libloading::Library;
use serde_json::Value;

use crate::contract::Fault;
use crate::local::{ABI, Local, Members};
use crate::wire::{BODY_MAX, Call};

type Abi = unsafe extern "C" fn() -> u32;
type Describe = unsafe extern "C" fn() -> *const c_char;
type Create = unsafe extern "C" fn(*const f64, *const c_char) -> *mut c_void;
type Destroy = unsafe extern "C" fn(*mut c_void);
type Step = unsafe extern "C" fn(*mut c_void, f64, f64, *const f64, *mut f64) -> i32;
type Reason = unsafe extern "C" fn(*mut c_void) -> *const c_char;
type Save = unsafe extern "C" fn(*mut c_void, *mut u8, usize) -> usize;
type Restore = unsafe extern "C" fn(*mut c_void, *const u8, usize) -> i32;
type TakeOver = unsafe extern "C" fn(*mut c_void, *const f64) -> i32;

/// A library and its members.
#[derive(Debug)]
pub struct Native {
    describe: Describe,
    create: Create,
    destroy: Destroy,
    step: Step,
    reason: Option<Reason>,
    save: Option<Save>,
    restore: Option<Restore>,
    take_over: Option<TakeOver>,
    members: Members<Member>,
    /// Keeps the functions where they are; dropped last.
    _library: Library,
}

/// What the library made.
#[derive(Clone, Copy, Debug)]
struct Member(*mut c_void);

// SAFETY: the interface demands that a member may be used by any thread, one at a time, and `Native` is
// used by one at a time.
unsafe impl Send for Member {}

impl Native {
    /// Loads a library under its own name, as one process does once.
    pub(crate) fn open(file: &Path) -> Result<Native, Fault> {
        Native::load(file)
    }

    /// Loads a copy of a library: one that was built anew would be taken for the one that is loaded.
    pub(crate) fn open_copy(file: &Path) -> Result<Native, Fault> {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("appell-{}-{count}.plugin", std::process::id());
        let copy = std::env::temp_dir().join(name);
        let _ = std::fs::remove_file(&copy);
        // Never into a file, or behind a link, that somebody else put there.
        let copied = File::open(file).and_then(|mut from| {
            let mut to = File::options().write(true).create_new(true).open(&copy)?;
            std::io::copy(&mut from, &mut to)
        });
        let native = match copied {
            Ok(_) => Native::load(&copy),
            Err(error) => Err(failed(&error)),
        };
        let _ = std::fs::remove_file(&copy);
        native
    }

    fn load(file: &Path) -> Result<Native, Fault> {
        // SAFETY: its initializers run, as those of any library; who names it trusts it, or lets it run in a
        // process of its own.
        let library = unsafe { Library::new(file) }.map_err(|error| failed(&error))?;
        // SAFETY: the types are those of the header, which the version number stands for.
        unsafe {
            let abi = *library
                .get::<Abi>(b"appell_abi\0")
                .map_err(|error| failed(&error))?;
            let version = abi();
            if version != ABI {
                let problem =
                    format!("must be {ABI}, the version of the C interface, got {version}");
                return Err(Fault::new("describe.abi", problem)
                    .hint("compile it with the header of this version of Appell"));
            }
            Ok(Native {
                describe: *library
                    .get(b"appell_describe\0")
                    .map_err(|error| failed(&error))?,
                create: *library
                    .get(b"appell_create\0")
                    .map_err(|error| failed(&error))?,
                destroy: *library
                    .get(b"appell_destroy\0")
                    .map_err(|error| failed(&error))?,
                step: *library
                    .get(b"appell_step\0")
                    .map_err(|error| failed(&error))?,
                reason: library.get(b"appell_reason\0").ok().map(|found| *found),
                save: library.get(b"appell_save\0").ok().map(|found| *found),
                restore: library.get(b"appell_restore\0").ok().map(|found| *found),
                take_over: library.get(b"appell_take_over\0").ok().map(|found| *found),
                members: Members::new(),
                _library: library,
            })
        }
    }

    #[inline]
    fn member(&mut self, member: u32) -> Result<*mut c_void, String> {
        self.members.find(member).map(|member| member.0)
    }

    /// Why the last call failed, in its own words.
    fn reason(&self, made: *mut c_void) -> Option<String> {
        // SAFETY: the interface gives a text that ends with zero, or none, and takes no member for none.
        let reason = self.reason.and_then(|reason| unsafe { text(reason(made)) });
        reason.filter(|text| !text.is_empty())
    }
}

impl Local for Native {
    fn describe(&mut self) -> Result<Value, Fault> {
        // SAFETY: the interface gives a text that ends with zero, or none.
        let text = unsafe { text((self.describe)()) };
        let text = text.ok_or_else(|| Fault::new("describe", "must be a text, got none"))?;
        serde_json::from_str(&text)
            .map_err(|error| Fault::new("describe", format!("must be JSON: {error}")))
    }

    fn create(
        &mut self,
        member: u32,
        parameters: &[(String, f64)],
        context: &Value,
    ) -> Result<(), Fault> {
        let values: Vec<f64> = parameters.iter().map(|(_, value)| *value).collect();
        let context = CString::new(context.to_string()).expect("JSON has no zero byte");
        // SAFETY: as many parameters as it described, and a text that ends with zero.
        let made = unsafe { (self.create)(values.as_ptr(), context.as_ptr()) };
        if made.is_null() {
            let reason = self.reason(made).unwrap_or_else(|| "made no member".into());
            return Err(Fault::new("create", reason));
        }
        self.members.add(member, Member(made));
        Ok(())
    }

    fn destroy(&mut self, member: u32) {
        if let Some(Member(made)) = self.members.remove(member) {
            // SAFETY: made by `create`, and no longer known.
            unsafe { (self.destroy)(made) };
        }
    }

    #[inline]
    fn step(&mut self, call: &Call<'_>, results: &mut [f64]) -> Result<(), String> {
        let made = self.member(call.member)?;
        results.fill(f64::NAN);
        let (input, output) = (call.input.as_ptr(), results.as_mut_ptr());
        // SAFETY: as many inputs and outputs as it described.
        match unsafe { (self.step)(made, call.t, call.dt, input, output) } {
            0 => Ok(()),
            code => Err(self.reason(made).unwrap_or_else(|| format!("gave {code}"))),
        }
    }

    fn save(&mut self, member: u32) -> Result<Vec<u8>, String> {
        let made = self.member(member)?;
        let Some(save) = self.save else {
            return Ok(Vec::new());
        };
        // SAFETY: without room it only tells the length, then it writes no more than there is room.
        unsafe {
            let length = save(made, std::ptr::null_mut(), 0);
            if length > BODY_MAX {
                return Err(format!("remembers {length} bytes, more than {BODY_MAX}"));
            }
            let mut bytes = vec![0; length];
            if save(made, bytes.as_mut_ptr(), length) != length {
                return Err("remembers more than it said".into());
            }
            Ok(bytes)
        }
    }

    fn restore(&mut self, member: u32, bytes: &[u8]) -> Result<(), String> {
        let made = self.member(member)?;
        let Some(restore) = self.restore else {
            return match bytes.is_empty() {
                true => Ok(()),
                false => Err("has no memory to restore".into()),
            };
        };
        // SAFETY: a pointer to as many bytes.
        match unsafe { restore(made, bytes.as_ptr(), bytes.len()) } {
            0 => Ok(()),
            code => Err(self.reason(made).unwrap_or_else(|| format!("gave {code}"))),
        }
    }

    fn take_over(&mut self, member: u32, outputs: &[f64]) -> Result<(), String> {
        let made = self.member(member)?;
        let Some(take_over) = self.take_over else {
            return Ok(());
        };
        // SAFETY: as many values as it has outputs.
        match unsafe { take_over(made, outputs.as_ptr()) } {
            0 => Ok(()),
            code => Err(self.reason(made).unwrap_or_else(|| format!("gave {code}"))),
        }
    }
}

impl Drop for Native {
    fn drop(&mut self) {
        for member in self.members.numbers() {
            self.destroy(member);
        }
    }
}

fn failed(error: &dyn std::fmt::Display) -> Fault {
    Fault::new("start", format!("cannot be loaded: {error}")).hint(
        "it must be a shared library for this machine, with the functions of sdk/c/appell_plugin.h",
    )
}

/// Copies a text.
///
/// # Safety
/// The pointer is none, or to bytes that end with zero.
unsafe fn text(pointer: *const c_char) -> Option<String> {
    if pointer.is_null() {
        return None;
    }
    // SAFETY: as demanded above.
    let bytes = unsafe { CStr::from_ptr(pointer) };
    Some(bytes.to_string_lossy().into_owned())
}
