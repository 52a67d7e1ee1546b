//! A plug-in as a module of WebAssembly, run in this process and sealed off from it.
//!
//! A module has memory of its own and no imports but mathematics; it is counted in instructions, not
//! seconds, so that what is too long for one machine is so on all; and whatever is not a number has one
//! pattern of bits. The functions are those of `sdk/c/appell_plugin.h`, with addresses of 32 bits.

#[cfg_attr(target_family = "wasm", path = "wasm/page.rs")]
mod engine;
mod mathematics;
#[cfg(any(test, target_family = "wasm"))]
mod metered;

use serde_json::Value;

use crate::Limits;
use crate::contract::Fault;
use crate::local::{ABI, Local, Members, one_by_one};
use crate::wire::{BODY_MAX, Call};
use engine::{Arguments, Function, Instance, Results};

/// Largest module, bytes: what is larger takes too long to compile.
const FILE_MAX: usize = 1 << 24;
/// Longest text that it can give, bytes.
const TEXT_MAX: usize = 1 << 20;
/// Most entries of a table.
const TABLE_MAX: u32 = 1 << 16;

type Step = Function<(i32, f64, f64, i32, i32), i32>;
type StepMany = Function<(i32, i32, i32, f64, i32, i32), i32>;

/// A module and its members.
pub(crate) struct Wasm {
    instance: Instance,
    describe: Function<(), i32>,
    room: Function<i32, i32>,
    create: Function<(i32, i32), i32>,
    destroy: Function<i32, ()>,
    step: Step,
    step_many: Option<StepMany>,
    reason: Option<Function<i32, i32>>,
    save: Option<Function<(i32, i32, i32), i32>>,
    restore: Option<Function<(i32, i32, i32), i32>>,
    take_over: Option<Function<(i32, i32), i32>>,
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

/// Why a call did not return.
struct Trap {
    told: String,
    /// Whether it came to where it holds that nothing comes, as after a panic.
    is_unreachable: bool,
}

const IMPOSSIBLE: &str = "trapped: it panicked, aborted or ran into what it holds impossible";

fn out_of_fuel(fuel: u64) -> String {
    format!("used up its fuel of {fuel} instructions")
}

fn out_of_memory(most: u64) -> String {
    format!("asked for more memory than its {most} MiB")
}

fn out_of_table() -> String {
    format!("asked for a table of more than {TABLE_MAX} entries")
}

/// What cannot be a module.
fn unfit(problem: String) -> Fault {
    Fault::new("start", problem).hint("it must be a module of WebAssembly (not a component), with the functions of sdk/c/appell_plugin.h")
}

fn uncompiled(why: &str) -> Fault {
    unfit(format!("cannot be compiled: {why}"))
}

/// Refuses an import.
fn stranger(from: &str, name: &str) -> Fault {
    let problem = format!("must be mathematics, got {from}.{name}");
    Fault::new("start.imports", problem)
        .hint("modules reach nothing outside; compile it for wasm32-unknown-unknown, without WASI")
}

impl std::fmt::Debug for Wasm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Wasm")
            .field("members", &self.members)
            .field("is_dead", &self.is_dead)
            .finish_non_exhaustive()
    }
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

impl Wasm {
    /// Compiles a module and makes an instance of it.
    pub(crate) fn open(bytes: &[u8], limits: &Limits) -> Result<Wasm, Fault> {
        if bytes.len() > FILE_MAX {
            let problem = format!("must be a module of at most {FILE_MAX} bytes");
            return Err(unfit(problem));
        }
        // Texts would need another compiler; and a module is what begins so.
        if !bytes.starts_with(b"\0asm") {
            return Err(unfit("must begin as a module does, with \\0asm".into()));
        }
        let mut instance = Instance::open(bytes, limits)?;
        let fuel = limits.fuel_of_start;
        let failed = |trap: Trap| Fault::new("start", trap.told);
        if let Ok(Some(start)) = instance.function::<(), ()>("_initialize") {
            instance.call(fuel, &start, ()).map_err(failed)?;
        }
        if instance.size().is_none() {
            let problem = "must export its memory under the name memory";
            return Err(Fault::new("start", problem));
        }
        let abi: Function<(), i32> = export(&mut instance, "appell_abi")?;
        let version = instance.call(fuel, &abi, ()).map_err(failed)?;
        if version != ABI as i32 {
            let problem = format!("must be {ABI}, the version of the interface, got {version}");
            return Err(Fault::new("describe.abi", problem)
                .hint("compile it with the SDK of this version of Appell"));
        }
        Ok(Wasm {
            describe: export(&mut instance, "appell_describe")?,
            room: export(&mut instance, "appell_room")?,
            create: export(&mut instance, "appell_create")?,
            destroy: export(&mut instance, "appell_destroy")?,
            step: export(&mut instance, "appell_step")?,
            step_many: option(&mut instance, "appell_step_many")?,
            reason: option(&mut instance, "appell_reason")?,
            save: option(&mut instance, "appell_save")?,
            restore: option(&mut instance, "appell_restore")?,
            take_over: option(&mut instance, "appell_take_over")?,
            instance,
            fuel_of_start: limits.fuel_of_start,
            fuel: limits.fuel,
            place: (0, 0),
            members: Members::new(),
            is_dead: false,
        })
    }

    /// Calls one of its functions with so much fuel.
    #[inline]
    fn call<A: Arguments, R: Results>(
        &mut self,
        fuel: u64,
        function: &Function<A, R>,
        arguments: A,
    ) -> Result<R, String> {
        if self.is_dead {
            return Err("it trapped before".into());
        }
        let called = self.instance.call(fuel, function, arguments);
        called.map_err(|trap| self.die(trap))
    }

    #[cold]
    fn die(&mut self, trap: Trap) -> String {
        // A panic in Rust leaves its text behind.
        let panic = match trap.is_unreachable {
            true => self.reason(0),
            false => None,
        };
        self.is_dead = true;
        panic
            .filter(|text| text.starts_with("panicked"))
            .unwrap_or(trap.told)
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
        let is_inside = end.is_some_and(|end| Some(end) <= self.instance.size());
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
        self.instance
            .fill(at, 8 * numbers.len(), |room| write(numbers, room));
    }

    /// Reads numbers at an address within its place.
    #[inline]
    fn get(&self, at: usize, numbers: &mut [f64]) {
        self.instance.look(at, 8 * numbers.len(), |bytes| {
            for (bytes, number) in bytes.as_chunks().0.iter().zip(numbers) {
                *number = f64::from_le_bytes(*bytes);
            }
        });
    }

    /// A text at an address; none at 0.
    fn text(&self, at: i32) -> Result<Option<String>, String> {
        if at == 0 {
            return Ok(None);
        }
        let at = at as u32 as usize;
        let size = self.instance.size().unwrap_or_default();
        let rest = size.saturating_sub(at).min(TEXT_MAX);
        let text = self.instance.look(at.min(size), rest, |bytes| {
            let end = bytes.iter().position(|&byte| byte == 0)?;
            Some(String::from_utf8_lossy(&bytes[..end]).into_owned())
        });
        let endless = || format!("a text must end with zero within {TEXT_MAX} bytes of its memory");
        text.map(Some).ok_or_else(endless)
    }

    /// Why the last call failed, in its own words.
    fn reason(&mut self, member: i32) -> Option<String> {
        let reason = self.reason.as_ref()?;
        let Ok(at) = self.instance.call(self.fuel, reason, member) else {
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
        let dt = calls[0].dt;
        if calls.iter().any(|call| call.dt != dt) {
            return Ok(false);
        }
        let made = &self.members;
        self.instance.fill(times, size, |room| {
            let (t, rest) = room.split_at_mut(8 * count);
            let (mut read_by, rest) = rest.split_at_mut(8 * count * read);
            let (written, addresses) = rest.split_at_mut(8 * count * width);
            void(written);
            let t = t.as_chunks_mut().0.iter_mut();
            let addresses = addresses.as_chunks_mut().0.iter_mut();
            let mut place = 0;
            for (k, ((call, t), address)) in calls.iter().zip(t).zip(addresses).enumerate() {
                let member;
                let next = made.next(call.member, place);
                (place, member) = next.map_err(|problem| (k, problem))?;
                *address = member.to_le_bytes();
                *t = call.t.to_le_bytes();
                let own;
                (own, read_by) = read_by.split_at_mut(8 * read);
                write(call.input, own);
            }
            Ok(())
        })?;
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

/// A function that must be there.
fn export<A: Arguments, R: Results>(
    instance: &mut Instance,
    name: &str,
) -> Result<Function<A, R>, Fault> {
    option(instance, name)?.ok_or_else(|| {
        Fault::new("start", format!("must export the function {name}"))
            .hint("see sdk/c/appell_plugin.h")
    })
}

/// A function that may be left out, but has one type.
fn option<A: Arguments, R: Results>(
    instance: &mut Instance,
    name: &str,
) -> Result<Option<Function<A, R>>, Fault> {
    instance.function(name).map_err(|error| {
        let problem = format!("must have the type of the interface: {error}");
        Fault::new(format!("start.{name}"), problem)
    })
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
        self.instance.fill(at, words + text.len() + 1, |room| {
            let (numbers, rest) = room.split_at_mut(words);
            write(&values, numbers);
            let (own, end) = rest.split_at_mut(text.len());
            own.copy_from_slice(text.as_bytes());
            end[0] = 0;
        });
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
        let size = 8 * (call.input.len() + results.len());
        let inputs = self.place(size)?;
        let outputs = inputs + 8 * call.input.len();
        self.instance.fill(inputs, size, |room| {
            let (read, written) = room.split_at_mut(outputs - inputs);
            write(call.input, read);
            void(written);
        });
        // A clone of the function would count references in every step.
        if self.is_dead {
            return Err("it trapped before".into());
        }
        let arguments = (member, call.t, call.dt, inputs as i32, outputs as i32);
        match self.instance.call(self.fuel, &self.step, arguments) {
            Ok(0) => {
                self.get(outputs, results);
                Ok(())
            }
            Ok(code) => self.told(member, code),
            Err(trap) => Err(self.die(trap)),
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
        Ok(self.instance.look(at, size, <[u8]>::to_vec))
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
        self.instance
            .fill(at, bytes.len(), |room| room.copy_from_slice(bytes));
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
