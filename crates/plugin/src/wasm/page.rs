//! What runs modules in a page: the browser's own WebAssembly, by a few functions that the page provides.
//!
//! A browser counts no instructions and limits no memory, so modules are rewritten to do so themselves
//! ([`super::metered`]).

// What the page provides cannot be called without it.
#![allow(unsafe_code)]

use std::marker::PhantomData;

use wasmparser::{FuncType, ValType};

use super::metered::{FUEL, Metered, OUT_OF_FUEL, OUT_OF_MEMORY, OUT_OF_TABLE, metered, tank};
use super::{IMPOSSIBLE, Trap, out_of_fuel, out_of_memory, out_of_table, uncompiled};
use crate::Limits;
use crate::contract::Fault;

/// Longest text on what went wrong, bytes.
const TOLD_MAX: usize = 1 << 10;

// `page/src/demo/modules.ts` is the other side. Numbers of instances and functions are the page's; texts and
// numbers lie in the memory of the studio.
#[link(wasm_import_module = "modules")]
unsafe extern "C" {
    /// Makes an instance, whose fuel is in a global of this name: its number, or -1.
    fn open(module: *const u8, length: usize, fuel: *const u8, fuel_length: usize) -> i32;
    /// Forgets an instance.
    fn close(instance: i32);
    /// Number of a function that it exports, or -1.
    fn function(instance: i32, name: *const u8, length: usize) -> i32;
    /// Calls a function: whether it returned, and with what.
    fn call(
        instance: i32,
        function: i32,
        arguments: *const f64,
        count: usize,
        fuel: i64,
        result: *mut f64,
    ) -> bool;
    /// What its fuel is now.
    fn fuel_left(instance: i32) -> i64;
    /// Bytes of its memory, or -1 where it exports none.
    fn size(instance: i32) -> f64;
    /// Copies out of its memory, and into it.
    fn read(instance: i32, from: usize, to: *mut u8, length: usize);
    fn write(instance: i32, to: usize, from: *const u8, length: usize);
    /// Puts the text on what went wrong last, cut to a length, and gives how long it is.
    fn told(to: *mut u8, length: usize) -> usize;
}

/// What went wrong last.
fn told_last() -> String {
    let mut text = vec![0; TOLD_MAX];
    // SAFETY: the page writes at most so many bytes there.
    let length = unsafe { told(text.as_mut_ptr(), text.len()) };
    text.truncate(length);
    String::from_utf8_lossy(&text).into_owned()
}

/// An instance of a module.
pub(super) struct Instance {
    number: i32,
    functions: std::collections::BTreeMap<String, FuncType>,
    /// Most memory, MiB.
    memory: u64,
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: nothing else has the number.
        unsafe { close(self.number) };
    }
}

/// A function of an instance, with its arguments and result.
pub(super) struct Function<A, R>(i32, PhantomData<fn(A) -> R>);

impl<A, R> Clone for Function<A, R> {
    fn clone(&self) -> Self {
        Function(self.0, PhantomData)
    }
}

/// Numbers that a function takes.
pub(super) trait Arguments {
    fn types() -> Vec<ValType>;
    fn numbers(self) -> Vec<f64>;
}

/// What a function gives.
pub(super) trait Results {
    fn types() -> Vec<ValType>;
    fn of(number: f64) -> Self;
}

/// A number that the interface knows.
trait Number {
    const TYPE: ValType;
    fn number(self) -> f64;
}

impl Number for i32 {
    const TYPE: ValType = ValType::I32;
    fn number(self) -> f64 {
        self.into()
    }
}

impl Number for f64 {
    const TYPE: ValType = ValType::F64;
    fn number(self) -> f64 {
        self
    }
}

macro_rules! arguments {
    ($($name:ident)*) => {
        impl<$($name: Number),*> Arguments for ($($name,)*) {
            fn types() -> Vec<ValType> {
                vec![$($name::TYPE),*]
            }
            #[allow(non_snake_case)]
            fn numbers(self) -> Vec<f64> {
                let ($($name,)*) = self;
                vec![$($name.number()),*]
            }
        }
    };
}

arguments!();
arguments!(A B);
arguments!(A B C);
arguments!(A B C D E);
arguments!(A B C D E F);

impl Arguments for i32 {
    fn types() -> Vec<ValType> {
        vec![ValType::I32]
    }
    fn numbers(self) -> Vec<f64> {
        vec![self.into()]
    }
}

impl Results for () {
    fn types() -> Vec<ValType> {
        Vec::new()
    }
    fn of(_: f64) {}
}

impl Results for i32 {
    fn types() -> Vec<ValType> {
        vec![ValType::I32]
    }
    fn of(number: f64) -> i32 {
        number as i32
    }
}

impl Instance {
    /// Compiles a module and makes an instance of it.
    pub(super) fn open(bytes: &[u8], limits: &Limits) -> Result<Instance, Fault> {
        let Metered { bytes, functions } = metered(bytes, limits.memory, limits.fuel_of_start)?;
        // SAFETY: the page reads these bytes, and keeps none of them.
        let number = unsafe { open(bytes.as_ptr(), bytes.len(), FUEL.as_ptr(), FUEL.len()) };
        if number < 0 {
            return Err(uncompiled(&told_last()));
        }
        Ok(Instance {
            number,
            functions,
            memory: limits.memory,
        })
    }

    /// A function that it exports; or why it is not of this type.
    pub(super) fn function<A: Arguments, R: Results>(
        &mut self,
        name: &str,
    ) -> Result<Option<Function<A, R>>, String> {
        let Some(known) = self.functions.get(name) else {
            return Ok(None);
        };
        let (takes, gives) = (A::types(), R::types());
        if *known.params() != takes || *known.results() != gives {
            return Err(format!(
                "takes {:?} and gives {:?}",
                known.params(),
                known.results()
            ));
        }
        // SAFETY: the page reads the name.
        let function = unsafe { function(self.number, name.as_ptr(), name.len()) };
        Ok((function >= 0).then_some(Function(function, PhantomData)))
    }

    /// Calls one of its functions with so much fuel.
    pub(super) fn call<A: Arguments, R: Results>(
        &mut self,
        fuel: u64,
        function: &Function<A, R>,
        arguments: A,
    ) -> Result<R, Trap> {
        let numbers = arguments.numbers();
        let (place, count, mut result) = (numbers.as_ptr(), numbers.len(), 0.0);
        // SAFETY: the page reads so many numbers, and writes one.
        let has_returned = unsafe {
            call(
                self.number,
                function.0,
                place,
                count,
                tank(fuel),
                &mut result,
            )
        };
        match has_returned {
            true => Ok(R::of(result)),
            false => Err(self.trap(fuel)),
        }
    }

    fn trap(&self, fuel: u64) -> Trap {
        let trap = |told: String| Trap {
            told,
            is_unreachable: false,
        };
        // SAFETY: the instance is there.
        match unsafe { fuel_left(self.number) } {
            OUT_OF_FUEL => trap(out_of_fuel(fuel)),
            OUT_OF_MEMORY => trap(out_of_memory(self.memory)),
            OUT_OF_TABLE => trap(out_of_table()),
            _ => match told_last() {
                told if told.contains("unreachable") => Trap {
                    told: IMPOSSIBLE.into(),
                    is_unreachable: true,
                },
                told => trap(format!("trapped: {told}")),
            },
        }
    }

    /// Bytes of its memory; none where it exports none.
    pub(super) fn size(&self) -> Option<usize> {
        // SAFETY: the instance is there.
        let size = unsafe { size(self.number) };
        (size >= 0.0).then_some(size as usize)
    }

    /// Lets a place in its memory be written. All of it must be: what stood there is not shown.
    pub(super) fn fill<R>(
        &mut self,
        at: usize,
        length: usize,
        fill: impl FnOnce(&mut [u8]) -> R,
    ) -> R {
        let mut bytes = vec![0; length];
        let filled = fill(&mut bytes);
        // SAFETY: the page reads these bytes, and its own memory is checked by the browser.
        unsafe { write(self.number, at, bytes.as_ptr(), length) };
        filled
    }

    /// Lets a place in its memory be read.
    pub(super) fn look<R>(&self, at: usize, length: usize, look: impl FnOnce(&[u8]) -> R) -> R {
        let mut bytes = vec![0; length];
        // SAFETY: the page writes so many bytes.
        unsafe { read(self.number, at, bytes.as_mut_ptr(), length) };
        look(&bytes)
    }
}
