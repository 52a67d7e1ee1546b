//! What runs modules on a machine: wasmtime, which counts their instructions, and gives whatever is not a number
//! one pattern of bits.

use std::sync::{Mutex, OnceLock, PoisonError};

use wasmtime::{
    Config, Engine, Linker, Memory, Module, OptLevel, ResourceLimiter, Store, Trap as Kind,
};

pub(super) use wasmtime::{TypedFunc as Function, WasmParams as Arguments, WasmResults as Results};

use super::mathematics::{OF_ONE, OF_TWO};
use super::{
    IMPOSSIBLE, TABLE_MAX, Trap, out_of_fuel, out_of_memory, out_of_table, stranger, uncompiled,
};
use crate::Limits;
use crate::contract::Fault;

/// Most stack that a module can use, bytes.
const STACK_MAX: usize = 1 << 19;
/// Modules that are kept compiled.
const KEPT: usize = 16;

/// An instance of a module.
pub(super) struct Instance {
    store: Store<Room>,
    instance: wasmtime::Instance,
    /// What it exports as its memory.
    memory: Option<Memory>,
}

/// How much a module may grow.
struct Room {
    /// Memory, MiB.
    memory: u64,
}

impl ResourceLimiter for Room {
    fn memory_growing(
        &mut self,
        _current: usize,
        desired: usize,
        _maximum: Option<usize>,
    ) -> wasmtime::Result<bool> {
        if desired as u64 <= self.memory.saturating_mul(1 << 20) {
            return Ok(true);
        }
        Err(wasmtime::Error::msg(out_of_memory(self.memory)))
    }

    fn table_growing(
        &mut self,
        _current: usize,
        desired: usize,
        _maximum: Option<usize>,
    ) -> wasmtime::Result<bool> {
        if desired <= TABLE_MAX as usize {
            return Ok(true);
        }
        Err(wasmtime::Error::msg(out_of_table()))
    }
}

/// The compiler, one for all.
fn engine() -> &'static Engine {
    static ENGINE: OnceLock<Engine> = OnceLock::new();
    ENGINE.get_or_init(|| {
        let mut config = Config::new();
        config
            .cranelift_opt_level(OptLevel::Speed)
            // The same bits everywhere.
            .cranelift_nan_canonicalization(true)
            .relaxed_simd_deterministic(true)
            .consume_fuel(true)
            .max_wasm_stack(STACK_MAX)
            .wasm_memory64(false)
            .wasm_multi_memory(false);
        Engine::new(&config).expect("these settings go together")
    })
}

/// Compiles a module, or finds it compiled.
fn compiled(bytes: &[u8]) -> Result<Module, Fault> {
    static KNOWN: Mutex<Vec<(String, Module)>> = Mutex::new(Vec::new());
    let hash = crate::digest(bytes);
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, module)) = known.iter().find(|(of, _)| *of == hash) {
        return Ok(module.clone());
    }
    let module = Module::new(engine(), bytes).map_err(|error| uncompiled(&format!("{error:#}")))?;
    if known.len() >= KEPT {
        known.remove(0);
    }
    known.push((hash, module.clone()));
    Ok(module)
}

fn mathematics(linker: &mut Linker<Room>) -> wasmtime::Result<()> {
    for &(name, function) in OF_ONE {
        linker.func_wrap("env", name, move |x: f64| function(x))?;
    }
    for &(name, function) in OF_TWO {
        linker.func_wrap("env", name, move |x: f64, y: f64| function(x, y))?;
    }
    Ok(())
}

impl Instance {
    /// Compiles a module and makes an instance of it.
    pub(super) fn open(bytes: &[u8], limits: &Limits) -> Result<Instance, Fault> {
        let module = compiled(bytes)?;
        let fuel = limits.fuel_of_start;
        let failed = |error: wasmtime::Error| Fault::new("start", trap(&error, fuel).told);
        let mut store = Store::new(
            engine(),
            Room {
                memory: limits.memory,
            },
        );
        store.limiter(|room| room);
        store.set_fuel(fuel).map_err(failed)?;
        let mut linker = Linker::new(engine());
        mathematics(&mut linker).map_err(failed)?;
        for import in module.imports() {
            if linker.get_by_import(&mut store, &import).is_none() {
                return Err(stranger(import.module(), import.name()));
            }
        }
        let instance = linker.instantiate(&mut store, &module).map_err(failed)?;
        let memory = instance.get_memory(&mut store, "memory");
        Ok(Instance {
            store,
            instance,
            memory,
        })
    }

    /// A function that it exports; or why it is not of this type.
    pub(super) fn function<A: Arguments, R: Results>(
        &mut self,
        name: &str,
    ) -> Result<Option<Function<A, R>>, String> {
        let Some(function) = self.instance.get_func(&mut self.store, name) else {
            return Ok(None);
        };
        let typed = function.typed(&self.store);
        typed.map(Some).map_err(|error| format!("{error:#}"))
    }

    /// Calls one of its functions with so much fuel.
    #[inline]
    pub(super) fn call<A: Arguments, R: Results>(
        &mut self,
        fuel: u64,
        function: &Function<A, R>,
        arguments: A,
    ) -> Result<R, Trap> {
        let called = self
            .store
            .set_fuel(fuel)
            .and_then(|()| function.call(&mut self.store, arguments));
        called.map_err(|error| trap(&error, fuel))
    }

    /// Bytes of its memory; none where it exports none.
    pub(super) fn size(&self) -> Option<usize> {
        self.memory.map(|memory| memory.data_size(&self.store))
    }

    /// Lets a place in its memory be written. All of it must be: what stood there is not shown everywhere.
    #[inline]
    pub(super) fn fill<R>(
        &mut self,
        at: usize,
        length: usize,
        write: impl FnOnce(&mut [u8]) -> R,
    ) -> R {
        let memory = self.memory.expect("what was opened has memory");
        write(&mut memory.data_mut(&mut self.store)[at..at + length])
    }

    /// Lets a place in its memory be read.
    #[inline]
    pub(super) fn look<R>(&self, at: usize, length: usize, read: impl FnOnce(&[u8]) -> R) -> R {
        let memory = self.memory.expect("what was opened has memory");
        read(&memory.data(&self.store)[at..at + length])
    }
}

/// Why a call failed; the same on every machine.
#[cold]
fn trap(error: &wasmtime::Error, fuel: u64) -> Trap {
    let kind = error.downcast_ref::<Kind>();
    let told = match kind {
        Some(Kind::OutOfFuel) => out_of_fuel(fuel),
        Some(Kind::StackOverflow) => format!("used up its stack of {STACK_MAX} bytes"),
        Some(Kind::UnreachableCodeReached) => IMPOSSIBLE.into(),
        Some(trap) => format!("trapped: {trap}").replace("wasm trap: ", ""),
        None => error.root_cause().to_string(),
    };
    Trap {
        told,
        is_unreachable: kind == Some(&Kind::UnreachableCodeReached),
    }
}
