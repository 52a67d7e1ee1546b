//! What is common to the hosts that run a plug-in in the process they are in.

use std::fmt::Debug;

use serde_json::Value;

use crate::contract::Fault;
use crate::wire::Call;

/// Version of the interface in C and of modules.
pub(crate) const ABI: u32 = 1;

/// A host whose plug-in runs in this process: beside the simulation, or in a child that serves it.
///
/// Members are made under numbers that the caller chooses. A text for an error is what the plug-in says.
pub trait Local: Debug + Send {
    /// What the plug-in says of itself.
    fn describe(&mut self) -> Result<Value, Fault>;

    /// Makes a member; parameters are complete and in the order of the description.
    fn create(
        &mut self,
        member: u32,
        parameters: &[(String, f64)],
        context: &Value,
    ) -> Result<(), Fault>;

    /// Ends a member.
    fn destroy(&mut self, member: u32);

    /// Steps one member; its outputs are written to `results`, which is as long as they are. What it leaves
    /// out is no number then: nothing is taken from the step before.
    fn step(&mut self, call: &Call<'_>, results: &mut [f64]) -> Result<(), String>;

    /// Steps several members, with `width` outputs each; the place of the first that failed, and why.
    fn step_many(
        &mut self,
        calls: &[Call<'_>],
        width: usize,
        results: &mut [f64],
    ) -> Result<(), (usize, String)> {
        one_by_one(self, calls, width, results)
    }

    /// What a member remembers.
    fn save(&mut self, member: u32) -> Result<Vec<u8>, String>;

    /// Gives a member back what one of its kind remembered.
    fn restore(&mut self, member: u32, bytes: &[u8]) -> Result<(), String>;

    /// Tells a member what another block wrote last to its outputs.
    fn take_over(&mut self, member: u32, outputs: &[f64]) -> Result<(), String>;

    /// Whether it can still be spoken to.
    fn is_alive(&self) -> bool {
        true
    }
}

/// Steps members one after the other; see [`Local::step_many`].
pub(crate) fn one_by_one<L: Local + ?Sized>(
    local: &mut L,
    calls: &[Call<'_>],
    width: usize,
    results: &mut [f64],
) -> Result<(), (usize, String)> {
    let each = calls.iter().zip(results.chunks_exact_mut(width));
    for (k, (call, results)) in each.enumerate() {
        local.step(call, results).map_err(|problem| (k, problem))?;
    }
    Ok(())
}

/// Members by their numbers, which only grow.
#[derive(Debug)]
pub(crate) struct Members<M> {
    list: Vec<(u32, M)>,
    /// Where one was found last: those that step together stand side by side.
    last: usize,
}

impl<M: Copy> Members<M> {
    pub(crate) fn new() -> Self {
        Members {
            list: Vec::new(),
            last: 0,
        }
    }

    pub(crate) fn add(&mut self, member: u32, made: M) {
        self.list.push((member, made));
    }

    pub(crate) fn remove(&mut self, member: u32) -> Option<M> {
        let at = self.list.binary_search_by_key(&member, |one| one.0).ok()?;
        Some(self.list.remove(at).1)
    }

    pub(crate) fn numbers(&self) -> Vec<u32> {
        self.list.iter().map(|(member, _)| *member).collect()
    }

    /// What was made for a number.
    #[inline]
    pub(crate) fn find(&mut self, member: u32) -> Result<M, String> {
        let (place, made) = self.next(member, self.last)?;
        self.last = place;
        Ok(made)
    }

    /// Where one stands, and what was made for it: at a place, behind it, or wherever it is.
    #[inline]
    pub(crate) fn next(&self, member: u32, place: usize) -> Result<(usize, M), String> {
        let is_there = |at: &usize| self.list.get(*at).is_some_and(|one| one.0 == member);
        let near = [place, place + 1].into_iter().find(is_there);
        match near.or_else(|| self.search(member)) {
            Some(at) => Ok((at, self.list[at].1)),
            None => Err(format!("has no member {member}")),
        }
    }

    #[cold]
    fn search(&self, member: u32) -> Option<usize> {
        self.list.binary_search_by_key(&member, |one| one.0).ok()
    }
}

/// Loads what is served from a process of its own.
#[cfg(any(unix, windows))]
pub(crate) fn load(file: &std::path::Path) -> Result<Box<dyn Local>, Fault> {
    use crate::fmu::Fmu;
    use crate::native::Native;
    use crate::process::Kind;

    if Kind::of(file) != Kind::Fmu {
        return Ok(Box::new(Native::open(file)?));
    }
    let file = std::path::absolute(file)
        .map_err(|error| Fault::new("file", format!("cannot be found: {error}")))?;
    let fmu = Fmu::open(&file)?;
    // What some write beside themselves goes with the folder.
    std::env::set_current_dir(fmu.folder())
        .map_err(|error| Fault::new("start", format!("cannot be entered: {error}")))?;
    Ok(Box::new(fmu))
}
