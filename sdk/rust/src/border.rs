// SPDX-License-Identifier: MIT OR Apache-2.0
//! The border to Appell: what the functions that [`controller!`](crate::controller) makes do.
//!
//! No panic passes it, and all that is unsafe stands here. Pointers are those of `appell_plugin.h`.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

use crate::{Descriptor, Now, Remember};

/// Version of the interface.
pub const ABI: u32 = 1;

/// A struct of numbers, in the order of its fields.
pub trait Numbers: Sized {
    /// How many.
    const COUNT: usize;

    /// Asks for one after the other.
    fn read(next: impl FnMut() -> f64) -> Self;

    /// Gives one after the other.
    fn write(&self, put: impl FnMut(f64));
}

/// A controller; implemented by [`controller!`](crate::controller).
pub trait Controller: 'static {
    /// What a step reads.
    type Inputs: Numbers;
    /// What a step writes.
    type Outputs: Numbers;
    /// What can be set.
    type Parameters: Numbers;
    /// What lasts from step to step.
    type Memory: Remember;

    /// What it is.
    const DESCRIPTOR: Descriptor;

    /// The memory of a new member.
    ///
    /// # Errors
    /// It cannot work here.
    fn start(context: &str, parameters: &Self::Parameters) -> Result<Self::Memory, String>;

    /// A step.
    ///
    /// # Errors
    /// It cannot go on.
    fn step(
        now: &Now<Self::Outputs>,
        inputs: &Self::Inputs,
        parameters: &Self::Parameters,
        memory: &mut Self::Memory,
    ) -> Result<Self::Outputs, String>;
}

/// One life of a controller.
struct Member<C: Controller> {
    parameters: C::Parameters,
    memory: C::Memory,
    /// What the controller before it wrote last, until the first step.
    before: Option<C::Outputs>,
    /// Why the last call failed.
    reason: CString,
}

impl<C: Controller> Member<C> {
    /// 0, or 1 with a reason.
    #[inline]
    fn attempt(&mut self, act: impl FnOnce(&mut Self) -> Result<(), String>) -> i32 {
        match guarded(|| act(self)) {
            Ok(()) => 0,
            Err(reason) => {
                self.reason = text(reason);
                1
            }
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.before.is_some().to_bytes(&mut bytes);
        if let Some(before) = &self.before {
            before.write(|value| value.to_bytes(&mut bytes));
        }
        self.memory.to_bytes(&mut bytes);
        bytes
    }

    fn remember(&mut self, mut bytes: &[u8]) -> Option<()> {
        let before = match bool::from_bytes(&mut bytes)? {
            true => {
                // Missing numbers cannot be told to `read`: they are counted first.
                let (own, rest) = bytes.split_at_checked(8 * C::Outputs::COUNT)?;
                bytes = rest;
                let mut own = own;
                Some(C::Outputs::read(|| {
                    f64::from_bytes(&mut own).expect("as many as were counted")
                }))
            }
            false => None,
        };
        let memory = C::Memory::from_bytes(&mut bytes)?;
        if !bytes.is_empty() {
            return None;
        }
        (self.before, self.memory) = (before, memory);
        Some(())
    }
}

thread_local! {
    /// Why no member was made, or where a module panicked.
    static REASON: RefCell<CString> = RefCell::default();
    /// What the host of a module writes and reads.
    static ROOM: RefCell<Vec<u64>> = const { RefCell::new(Vec::new()) };
}

/// What it does, or why it panicked: to unwind into foreign code is not defined.
#[inline]
fn guarded<R>(act: impl FnOnce() -> Result<R, String>) -> Result<R, String> {
    catch_unwind(AssertUnwindSafe(act)).unwrap_or_else(|panic| Err(panicked(&*panic)))
}

#[cold]
fn panicked(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    format!("panicked: {}", text.unwrap_or("with no text"))
}

/// Keeps what a panic says: in a module it ends in a trap, which says nothing.
#[cfg(target_family = "wasm")]
fn keep_panics() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        std::panic::set_hook(Box::new(|panic| REASON.set(text(panic.to_string()))));
    });
}

/// A text that ends where C ends it.
fn text(text: String) -> CString {
    let bytes: Vec<u8> = text
        .bytes()
        .map(|b| if b == 0 { b' ' } else { b })
        .collect();
    CString::new(bytes).expect("zeros were replaced")
}

/// Reads numbers that lie one after the other.
///
/// # Safety
/// As many numbers as it has lie there, if it has any.
#[inline]
unsafe fn read<N: Numbers>(from: *const f64) -> N {
    let mut k = 0;
    N::read(|| {
        // SAFETY: asked for `COUNT` times, which the caller promises.
        let value = unsafe { from.add(k).read() };
        k += 1;
        value
    })
}

/// The description, as a text of C.
pub fn describe<C: Controller>() -> CString {
    text(C::DESCRIPTOR.json())
}

/// A new member, or none.
///
/// # Safety
/// As many parameters as described, and a text that ends with zero, or none.
pub unsafe fn create<C: Controller>(parameters: *const f64, context: *const c_char) -> *mut c_void {
    #[cfg(target_family = "wasm")]
    keep_panics();
    let made = guarded(|| {
        // SAFETY: as demanded above.
        let parameters: C::Parameters = unsafe { read(parameters) };
        let context = match context.is_null() {
            true => c"",
            // SAFETY: as demanded above.
            false => unsafe { CStr::from_ptr(context) },
        };
        let context = context
            .to_str()
            .map_err(|_| "the context must be UTF-8".to_owned())?;
        let memory = C::start(context, &parameters)?;
        Ok(Member::<C> {
            parameters,
            memory,
            before: None,
            reason: CString::default(),
        })
    });
    match made {
        Ok(member) => Box::into_raw(Box::new(member)).cast(),
        Err(reason) => {
            REASON.set(text(reason));
            ptr::null_mut()
        }
    }
}

/// Ends a member.
///
/// # Safety
/// The member was made by [`create`] and is not used again.
pub unsafe fn destroy<C: Controller>(member: *mut c_void) {
    if !member.is_null() {
        // SAFETY: as demanded above.
        let member = unsafe { Box::from_raw(member.cast::<Member<C>>()) };
        let _ = guarded(|| {
            drop(member);
            Ok(())
        });
    }
}

/// A step.
///
/// # Safety
/// The member was made by [`create`]; as many inputs and outputs as described.
#[inline]
pub unsafe fn step<C: Controller>(
    member: *mut c_void,
    t: f64,
    dt: f64,
    inputs: *const f64,
    outputs: *mut f64,
) -> i32 {
    // SAFETY: as demanded above; it is used by one thread at a time.
    let member = unsafe { &mut *member.cast::<Member<C>>() };
    member.attempt(|member| {
        // SAFETY: as demanded above.
        let inputs: C::Inputs = unsafe { read(inputs) };
        let before = member.before.take();
        let now = Now { t, dt, before };
        let made = C::step(&now, &inputs, &member.parameters, &mut member.memory)?;
        let mut k = 0;
        made.write(|value| {
            // SAFETY: `COUNT` numbers have room there.
            unsafe { outputs.add(k).write(value) };
            k += 1;
        });
        Ok(())
    })
}

/// Steps several members. The place of the first that failed, counted from 1, or 0.
///
/// # Safety
/// As for [`step`], for each; all lists have as many.
pub unsafe fn step_many<C: Controller>(
    count: i32,
    members: *const *mut c_void,
    t: *const f64,
    dt: f64,
    inputs: *const f64,
    outputs: *mut f64,
) -> i32 {
    for place in 0..count {
        let k = place as usize;
        // SAFETY: as demanded above; inputs and outputs stand one member after the other.
        let code = unsafe {
            let (inputs, outputs) = (
                inputs.add(k * C::Inputs::COUNT),
                outputs.add(k * C::Outputs::COUNT),
            );
            step::<C>(members.add(k).read(), t.add(k).read(), dt, inputs, outputs)
        };
        if code != 0 {
            return place + 1;
        }
    }
    0
}

/// Why the last call failed; of no member, why none was made, or in a module after a trap, where it panicked.
///
/// # Safety
/// The member was made by [`create`], or is none.
pub unsafe fn reason<C: Controller>(member: *mut c_void) -> *const c_char {
    match member.is_null() {
        true => REASON.with_borrow(|reason| reason.as_ptr()),
        // SAFETY: as demanded above.
        false => unsafe { (*member.cast::<Member<C>>()).reason.as_ptr() },
    }
}

/// How many bytes a member remembers; writes them if there is room for all.
///
/// # Safety
/// The member was made by [`create`]; there is as much room.
pub unsafe fn save<C: Controller>(member: *mut c_void, bytes: *mut u8, room: usize) -> usize {
    // SAFETY: as demanded above.
    let member = unsafe { &*member.cast::<Member<C>>() };
    let Ok(saved) = guarded(|| Ok(member.bytes())) else {
        return 0;
    };
    if saved.len() <= room {
        // SAFETY: as demanded above, and what was just allocated lies elsewhere.
        unsafe { ptr::copy_nonoverlapping(saved.as_ptr(), bytes, saved.len()) };
    }
    saved.len()
}

/// Gives a member the memory of another.
///
/// # Safety
/// The member was made by [`create`]; there are as many bytes.
pub unsafe fn restore<C: Controller>(member: *mut c_void, bytes: *const u8, length: usize) -> i32 {
    // SAFETY: as demanded above.
    let member = unsafe { &mut *member.cast::<Member<C>>() };
    let bytes = match length {
        0 => &[],
        // SAFETY: as demanded above.
        _ => unsafe { std::slice::from_raw_parts(bytes, length) },
    };
    member.attempt(|member| {
        let refused = || "these bytes are not of its memory".to_owned();
        member.remember(bytes).ok_or_else(refused)
    })
}

/// Tells a member what the one before it wrote last.
///
/// # Safety
/// The member was made by [`create`]; as many numbers as it has outputs.
pub unsafe fn take_over<C: Controller>(member: *mut c_void, outputs: *const f64) -> i32 {
    // SAFETY: as demanded above.
    let member = unsafe { &mut *member.cast::<Member<C>>() };
    member.attempt(|member| {
        // SAFETY: as demanded above.
        member.before = Some(unsafe { read(outputs) });
        Ok(())
    })
}

/// A place of at least this many bytes, aligned for numbers, which lasts until the next; none if there is
/// no memory left.
pub fn room(size: usize) -> *mut u8 {
    ROOM.with_borrow_mut(|room| match room.try_reserve(size.div_ceil(8)) {
        Ok(()) => room.as_mut_ptr().cast(),
        Err(_) => ptr::null_mut(),
    })
}
