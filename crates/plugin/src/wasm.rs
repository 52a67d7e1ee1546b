//! A plug-in as a module of WebAssembly, run in this process and sealed off from it.
//!
//! A module has memory of its own and no imports but mathematics; it is counted in instructions, not
//! seconds, so that what is too long for one machine is so on all; and whatever is not a number has one
//! pattern of bits. The functions are those of `sdk/c/appell_plugin.h`, with addresses of 32 bits.

use std::sync::{Mutex, OnceLock, PoisonError};

use serde_json::Value;
use wasmtime::{
    Caller, Config, Engine, Instance, Linker, Memory, Module, OptLevel, ResourceLimiter, Store,
    Trap, TypedFunc,
};

use crate::Limits;
use crate::contract::Fault;
use crate::local::{ABI, Local, Members, one_by_one};
use crate::wire::{BODY_MAX, Call};

/// Largest module, bytes: what is larger takes too long to compile.
const FILE_MAX: usize = 1 << 24;
/// Most stack that it can use, bytes.
const STACK_MAX: usize = 1 << 19;
/// Longest text that it can give, bytes.
const TEXT_MAX: usize = 1 << 20;
/// Most entries of a table.
const TABLE_MAX: usize = 1 << 16;
/// Modules that are kept compiled.
const KEPT: usize = 16;

type Step = TypedFunc<(i32, f64, f64, i32, i32), i32>;
type StepMany = TypedFunc<(i32, i32, i32, f64, i32, i32), i32>;

/// A module and its members.
pub(crate) struct Wasm {
    store: Store<Room>,
    memory: Memory,
    describe: TypedFunc<(), i32>,
    room: TypedFunc<i32, i32>,
    create: TypedFunc<(i32, i32), i32>,
    destroy: TypedFunc<i32, ()>,
    step: Step,
    step_many: Option<StepMany>,
    reason: Option<TypedFunc<i32, i32>>,
    save: Option<TypedFunc<(i32, i32, i32), i32>>,
    restore: Option<TypedFunc<(i32, i32, i32), i32>>,
    take_over: Option<TypedFunc<(i32, i32), i32>>,
    /// Instructions until it has described itself, or made a member.
    fuel_of_start: u64,
    /// Instructions of a step.
    fuel: u64,
    /// Its place for what goes to and fro: address and size.
    place: (usize, usize),
    members: Members<i32>,
    /// Whether it trapped: what its memory holds then is anybody's guess.
    is_dead: bool,
}

impl std::fmt::Debug for Wasm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Wasm")
            .field("members", &self.members)
            .field("is_dead", &self.is_dead)
            .finish_non_exhaustive()
    }
}

/// How much a module may grow.
struct Room {
    memory: usize,
}

impl ResourceLimiter for Room {
    fn memory_growing(
        &mut self,
        _current: usize,
        desired: usize,
        _maximum: Option<usize>,
    ) -> wasmtime::Result<bool> {
        if desired <= self.memory {
            return Ok(true);
        }
        let most = self.memory >> 20;
        Err(wasmtime::Error::msg(format!(
            "asked for more memory than its {most} MiB"
        )))
    }

    fn table_growing(
        &mut self,
        _current: usize,
        desired: usize,
        _maximum: Option<usize>,
    ) -> wasmtime::Result<bool> {
        if desired <= TABLE_MAX {
            return Ok(true);
        }
        Err(wasmtime::Error::msg(format!(
            "asked for a table of more than {TABLE_MAX} entries"
        )))
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
    let refuse = |problem: String| {
        Fault::new("start", problem).hint("it must be a module of WebAssembly (not a component), with the functions of sdk/c/appell_plugin.h")
    };
    if bytes.len() > FILE_MAX {
        let problem = format!("must be a module of at most {FILE_MAX} bytes");
        return Err(refuse(problem));
    }
    // Texts would need another compiler; and a module is what begins so.
    if !bytes.starts_with(b"\0asm") {
        return Err(refuse("must begin as a module does, with \\0asm".into()));
    }
    let hash = crate::digest(bytes);
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, module)) = known.iter().find(|(of, _)| *of == hash) {
        return Ok(module.clone());
    }
    let module = Module::new(engine(), bytes)
        .map_err(|error| refuse(format!("cannot be compiled: {error:#}")))?;
    if known.len() >= KEPT {
        known.remove(0);
    }
    known.push((hash, module.clone()));
    Ok(module)
}

/// Mathematics that modules may import, with the same bits on every machine.
fn mathematics(linker: &mut Linker<Room>) -> wasmtime::Result<()> {
    type One = fn(f64) -> f64;
    type Two = fn(f64, f64) -> f64;
    let of_one: [(&str, One); 8] = [
        ("sin", libm::sin),
        ("cos", libm::cos),
        ("tan", libm::tan),
        ("asin", libm::asin),
        ("acos", libm::acos),
        ("atan", libm::atan),
        ("exp", libm::exp),
        ("log", libm::log),
    ];
    let of_two: [(&str, Two); 5] = [
        ("atan2", libm::atan2),
        ("pow", libm::pow),
        ("hypot", libm::hypot),
        ("fmod", libm::fmod),
        ("remainder", libm::remainder),
    ];
    for (name, function) in of_one {
        linker.func_wrap("env", name, move |_: Caller<'_, Room>, x: f64| {
            same(function(x))
        })?;
    }
    for (name, function) in of_two {
        linker.func_wrap("env", name, move |_: Caller<'_, Room>, x: f64, y: f64| {
            same(function(x, y))
        })?;
    }
    Ok(())
}

/// Writes numbers into the first bytes.
#[inline]
fn write(numbers: &[f64], bytes: &mut [u8]) {
    let rooms = bytes.as_chunks_mut().0;
    // A loop becomes a call of what copies memory, which for few numbers takes longer than they do.
    match (numbers, rooms) {
        ([a], [x, ..]) => *x = a.to_le_bytes(),
        ([a, b], [x, y, ..]) => [*x, *y] = [a, b].map(|number| number.to_le_bytes()),
        ([a, b, c], [x, y, z, ..]) => [*x, *y, *z] = [a, b, c].map(|number| number.to_le_bytes()),
        (numbers, rooms) => {
            for (room, number) in rooms.iter_mut().zip(numbers) {
                *room = number.to_le_bytes();
            }
        }
    }
}

/// Leaves no number in a place for numbers.
#[inline]
fn void(bytes: &mut [u8]) {
    bytes.as_chunks_mut().0.fill(f64::NAN.to_le_bytes());
}

/// One pattern of bits for all that is not a number.
fn same(x: f64) -> f64 {
    if x.is_nan() { f64::NAN } else { x }
}

impl Wasm {
    /// Compiles a module and makes an instance of it.
    pub(crate) fn open(bytes: &[u8], limits: &Limits) -> Result<Wasm, Fault> {
        let module = compiled(bytes)?;
        let fuel = limits.fuel_of_start;
        let failed = |error: wasmtime::Error| Fault::new("start", why(&error, fuel));
        let memory = usize::try_from(limits.memory.saturating_mul(1 << 20)).unwrap_or(usize::MAX);
        let mut store = Store::new(engine(), Room { memory });
        store.limiter(|room| room);
        store.set_fuel(fuel).map_err(failed)?;
        let mut linker = Linker::new(engine());
        mathematics(&mut linker).map_err(failed)?;
        for import in module.imports() {
            let (from, name) = (import.module(), import.name());
            let known = linker.get_by_import(&mut store, &import).is_some();
            if !known {
                let problem = format!("must be mathematics, got {from}.{name}");
                return Err(Fault::new("start.imports", problem)
                    .hint("modules reach nothing outside; compile it for wasm32-unknown-unknown, without WASI"));
            }
        }
        let instance = linker.instantiate(&mut store, &module).map_err(failed)?;
        if let Ok(start) = instance.get_typed_func::<(), ()>(&mut store, "_initialize") {
            start.call(&mut store, ()).map_err(failed)?;
        }
        let memory = instance
            .get_memory(&mut store, "memory")
            .ok_or_else(|| Fault::new("start", "must export its memory under the name memory"))?;
        let abi: TypedFunc<(), i32> = export(&instance, &mut store, "appell_abi")?;
        let version = abi.call(&mut store, ()).map_err(failed)?;
        if version != ABI as i32 {
            let problem = format!("must be {ABI}, the version of the interface, got {version}");
            return Err(Fault::new("describe.abi", problem)
                .hint("compile it with the SDK of this version of Appell"));
        }
        Ok(Wasm {
            memory,
            describe: export(&instance, &mut store, "appell_describe")?,
            room: export(&instance, &mut store, "appell_room")?,
            create: export(&instance, &mut store, "appell_create")?,
            destroy: export(&instance, &mut store, "appell_destroy")?,
            step: export(&instance, &mut store, "appell_step")?,
            step_many: option(&instance, &mut store, "appell_step_many")?,
            reason: option(&instance, &mut store, "appell_reason")?,
            save: option(&instance, &mut store, "appell_save")?,
            restore: option(&instance, &mut store, "appell_restore")?,
            take_over: option(&instance, &mut store, "appell_take_over")?,
            store,
            fuel_of_start: limits.fuel_of_start,
            fuel: limits.fuel,
            place: (0, 0),
            members: Members::new(),
            is_dead: false,
        })
    }

    /// Calls one of its functions with so much fuel.
    #[inline]
    fn call<A: wasmtime::WasmParams, R: wasmtime::WasmResults>(
        &mut self,
        fuel: u64,
        function: &TypedFunc<A, R>,
        arguments: A,
    ) -> Result<R, String> {
        if self.is_dead {
            return Err("it trapped before".into());
        }
        let called = self
            .store
            .set_fuel(fuel)
            .and_then(|()| function.call(&mut self.store, arguments));
        called.map_err(|error| self.die(&error, fuel))
    }

    #[cold]
    fn die(&mut self, error: &wasmtime::Error, fuel: u64) -> String {
        let told = why(error, fuel);
        // A panic in Rust leaves its text behind.
        let panic = match error.downcast_ref() {
            Some(Trap::UnreachableCodeReached) => self.reason(0),
            _ => None,
        };
        self.is_dead = true;
        panic
            .filter(|text| text.starts_with("panicked"))
            .unwrap_or(told)
    }

    /// The address of a place of at least so many bytes in its memory.
    #[inline]
    fn place(&mut self, size: usize) -> Result<usize, String> {
        if size > self.place.1 {
            self.ask(size)?;
        }
        Ok(self.place.0)
    }

    #[cold]
    fn ask(&mut self, size: usize) -> Result<(), String> {
        let wanted = i32::try_from(size).map_err(|_| format!("has no room for {size} bytes"))?;
        let room = self.room.clone();
        let at = self.call(self.fuel_of_start, &room, wanted)? as u32 as usize;
        let end = at.checked_add(size);
        let is_inside = end.is_some_and(|end| end <= self.memory.data_size(&self.store));
        if at == 0 || !at.is_multiple_of(8) || !is_inside {
            return Err(format!(
                "appell_room must give an address of {size} bytes in its memory that 8 divides, got {at}"
            ));
        }
        self.place = (at, size);
        Ok(())
    }

    /// Writes numbers at an address within its place.
    fn put(&mut self, at: usize, numbers: &[f64]) {
        write(numbers, &mut self.memory.data_mut(&mut self.store)[at..]);
    }

    /// Reads numbers at an address within its place.
    #[inline]
    fn get(&self, at: usize, numbers: &mut [f64]) {
        let bytes = &self.memory.data(&self.store)[at..at + 8 * numbers.len()];
        for (bytes, number) in bytes.as_chunks().0.iter().zip(numbers) {
            *number = f64::from_le_bytes(*bytes);
        }
    }

    /// A text at an address; none at 0.
    fn text(&self, at: i32) -> Result<Option<String>, String> {
        if at == 0 {
            return Ok(None);
        }
        let data = self.memory.data(&self.store);
        let rest = data.get(at as u32 as usize..).unwrap_or_default();
        let rest = &rest[..rest.len().min(TEXT_MAX)];
        match rest.iter().position(|&byte| byte == 0) {
            Some(end) => Ok(Some(String::from_utf8_lossy(&rest[..end]).into_owned())),
            None => Err(format!(
                "a text must end with zero within {TEXT_MAX} bytes of its memory"
            )),
        }
    }

    /// Why the last call failed, in its own words.
    fn reason(&mut self, member: i32) -> Option<String> {
        let reason = self.reason.clone()?;
        self.store.set_fuel(self.fuel).ok()?;
        let Ok(at) = reason.call(&mut self.store, member) else {
            self.is_dead = true;
            return None;
        };
        let text = self.text(at).ok()?;
        text.filter(|text| !text.is_empty())
    }

    /// Steps members in one call, if their steps are of one length. Whether they are.
    fn step_all(
        &mut self,
        step_many: &StepMany,
        calls: &[Call<'_>],
        width: usize,
        results: &mut [f64],
    ) -> Result<bool, (usize, String)> {
        let count = calls.len();
        let read = calls[0].input.len();
        let first = |problem: String| (0, problem);
        let size = 8 * count * (1 + read + width) + 4 * count;
        let times = self.place(size).map_err(first)?;
        let inputs = times + 8 * count;
        let outputs = inputs + 8 * count * read;
        let members = outputs + 8 * count * width;
        let room = &mut self.memory.data_mut(&mut self.store)[times..times + size];
        let (t, rest) = room.split_at_mut(8 * count);
        let (mut read_by, rest) = rest.split_at_mut(8 * count * read);
        let (written, addresses) = rest.split_at_mut(8 * count * width);
        void(written);
        let t = t.as_chunks_mut().0.iter_mut();
        let addresses = addresses.as_chunks_mut().0.iter_mut();
        let (dt, mut place) = (calls[0].dt, 0);
        for (k, ((call, t), address)) in calls.iter().zip(t).zip(addresses).enumerate() {
            if call.dt != dt {
                return Ok(false);
            }
            let made;
            let next = self.members.next(call.member, place);
            (place, made) = next.map_err(|problem| (k, problem))?;
            *address = made.to_le_bytes();
            *t = call.t.to_le_bytes();
            let own;
            (own, read_by) = read_by.split_at_mut(8 * read);
            write(call.input, own);
        }
        let fuel = self.fuel.saturating_mul(count as u64);
        let arguments = (
            count as i32,
            members as i32,
            times as i32,
            dt,
            inputs as i32,
            outputs as i32,
        );
        match self.call(fuel, step_many, arguments).map_err(first)? {
            0 => {
                self.get(outputs, results);
                Ok(true)
            }
            place => {
                let k = (place as usize).saturating_sub(1).min(count - 1);
                let member = self.members.find(calls[k].member).unwrap_or_default();
                let told = self.told(member, place);
                told.map(|()| true).map_err(|problem| (k, problem))
            }
        }
    }

    fn told(&mut self, member: i32, code: i32) -> Result<(), String> {
        match code {
            0 => Ok(()),
            code => Err(self
                .reason(member)
                .unwrap_or_else(|| format!("gave {code}"))),
        }
    }
}

/// Why a call failed; the same on every machine.
fn why(error: &wasmtime::Error, fuel: u64) -> String {
    match error.downcast_ref::<Trap>() {
        Some(Trap::OutOfFuel) => format!("used up its fuel of {fuel} instructions"),
        Some(Trap::StackOverflow) => format!("used up its stack of {STACK_MAX} bytes"),
        Some(Trap::UnreachableCodeReached) => {
            "trapped: it panicked, aborted or ran into what it holds impossible".into()
        }
        Some(trap) => format!("trapped: {trap}").replace("wasm trap: ", ""),
        None => error.root_cause().to_string(),
    }
}

/// A function that must be there.
fn export<A: wasmtime::WasmParams, R: wasmtime::WasmResults>(
    instance: &Instance,
    store: &mut Store<Room>,
    name: &str,
) -> Result<TypedFunc<A, R>, Fault> {
    option(instance, store, name)?.ok_or_else(|| {
        Fault::new("start", format!("must export the function {name}"))
            .hint("see sdk/c/appell_plugin.h")
    })
}

/// A function that may be left out, but has one type.
fn option<A: wasmtime::WasmParams, R: wasmtime::WasmResults>(
    instance: &Instance,
    store: &mut Store<Room>,
    name: &str,
) -> Result<Option<TypedFunc<A, R>>, Fault> {
    let Some(function) = instance.get_func(&mut *store, name) else {
        return Ok(None);
    };
    match function.typed(&*store) {
        Ok(typed) => Ok(Some(typed)),
        Err(error) => {
            let problem = format!("must have the type of the interface: {error:#}");
            Err(Fault::new(format!("start.{name}"), problem))
        }
    }
}

impl Local for Wasm {
    fn describe(&mut self) -> Result<Value, Fault> {
        let refuse = |problem: String| Fault::new("describe", problem);
        let describe = self.describe.clone();
        let at = self
            .call(self.fuel_of_start, &describe, ())
            .map_err(refuse)?;
        let text = self.text(at).map_err(refuse)?;
        let text = text.ok_or_else(|| refuse("must be a text, got none".into()))?;
        serde_json::from_str(&text).map_err(|error| refuse(format!("must be JSON: {error}")))
    }

    fn create(
        &mut self,
        member: u32,
        parameters: &[(String, f64)],
        context: &Value,
    ) -> Result<(), Fault> {
        let refuse = |problem: String| Fault::new("create", problem);
        let values: Vec<f64> = parameters.iter().map(|(_, value)| *value).collect();
        let text = context.to_string();
        let words = 8 * values.len();
        let at = self.place(words + text.len() + 1).map_err(refuse)?;
        self.put(at, &values);
        let memory = &mut self.memory.data_mut(&mut self.store)[at + words..];
        memory[..text.len()].copy_from_slice(text.as_bytes());
        memory[text.len()] = 0;
        let create = self.create.clone();
        let arguments = (at as i32, (at + words) as i32);
        let made = self
            .call(self.fuel_of_start, &create, arguments)
            .map_err(refuse)?;
        if made == 0 {
            let reason = self.reason(0).unwrap_or_else(|| "made no member".into());
            return Err(refuse(reason));
        }
        self.members.add(member, made);
        Ok(())
    }

    fn destroy(&mut self, member: u32) {
        if let Some(made) = self.members.remove(member) {
            let destroy = self.destroy.clone();
            // One that cannot even end is not used again.
            let _ = self.call(self.fuel, &destroy, made);
        }
    }

    fn step(&mut self, call: &Call<'_>, results: &mut [f64]) -> Result<(), String> {
        let member = self.members.find(call.member)?;
        let inputs = self.place(8 * (call.input.len() + results.len()))?;
        let outputs = inputs + 8 * call.input.len();
        let room = &mut self.memory.data_mut(&mut self.store)[inputs..];
        let (read, written) = room.split_at_mut(outputs - inputs);
        write(call.input, read);
        void(&mut written[..8 * results.len()]);
        // A clone of the function would count references in every step.
        if self.is_dead {
            return Err("it trapped before".into());
        }
        let arguments = (member, call.t, call.dt, inputs as i32, outputs as i32);
        let called = self
            .store
            .set_fuel(self.fuel)
            .and_then(|()| self.step.call(&mut self.store, arguments));
        match called {
            Ok(0) => {
                self.get(outputs, results);
                Ok(())
            }
            Ok(code) => self.told(member, code),
            Err(error) => Err(self.die(&error, self.fuel)),
        }
    }

    fn step_many(
        &mut self,
        calls: &[Call<'_>],
        width: usize,
        results: &mut [f64],
    ) -> Result<(), (usize, String)> {
        let is_many = calls.len() > 1 && calls.len() < 1 << 20;
        // Taken rather than cloned, which counts references.
        let Some(step_many) = self.step_many.take_if(|_| is_many) else {
            return one_by_one(self, calls, width, results);
        };
        let stepped = self.step_all(&step_many, calls, width, results);
        self.step_many = Some(step_many);
        match stepped? {
            true => Ok(()),
            false => one_by_one(self, calls, width, results),
        }
    }

    fn save(&mut self, member: u32) -> Result<Vec<u8>, String> {
        let made = self.members.find(member)?;
        let Some(save) = self.save.clone() else {
            return Ok(Vec::new());
        };
        let length = self.call(self.fuel, &save, (made, 0, 0))?;
        let size = length as u32 as usize;
        if size > BODY_MAX {
            return Err(format!("remembers {size} bytes, more than {BODY_MAX}"));
        }
        let at = self.place(size.max(8))?;
        if self.call(self.fuel, &save, (made, at as i32, length))? != length {
            return Err("remembers more than it said".into());
        }
        Ok(self.memory.data(&self.store)[at..at + size].to_vec())
    }

    fn restore(&mut self, member: u32, bytes: &[u8]) -> Result<(), String> {
        let made = self.members.find(member)?;
        let Some(restore) = self.restore.clone() else {
            return match bytes.is_empty() {
                true => Ok(()),
                false => Err("has no memory to restore".into()),
            };
        };
        let at = self.place(bytes.len().max(8))?;
        self.memory.data_mut(&mut self.store)[at..at + bytes.len()].copy_from_slice(bytes);
        let code = self.call(self.fuel, &restore, (made, at as i32, bytes.len() as i32))?;
        self.told(made, code)
    }

    fn take_over(&mut self, member: u32, outputs: &[f64]) -> Result<(), String> {
        let made = self.members.find(member)?;
        let Some(take_over) = self.take_over.clone() else {
            return Ok(());
        };
        let at = self.place(8 * outputs.len())?;
        self.put(at, outputs);
        let code = self.call(self.fuel, &take_over, (made, at as i32))?;
        self.told(made, code)
    }

    fn is_alive(&self) -> bool {
        !self.is_dead
    }
}
