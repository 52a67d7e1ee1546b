//! A block in its place: what it reads, where it writes, when it is due, and with what it runs.

use appell_model::scalar::Scalar;

use super::changes::Roster;
use crate::block::{Block, BlockError, Detail, Now};

/// When something is due that repeats: a division at every tick costs more than the tick's logic.
#[derive(Clone, Copy, Debug)]
pub(super) struct Due {
    /// Ticks between two times.
    pub(super) period: u64,
    pub(super) next: u64,
}

impl Due {
    pub(super) fn every(period: u64) -> Self {
        Due { period, next: 0 }
    }

    /// Whether it is due at this tick; if so, it is next due a period later.
    pub(super) fn now(&mut self, tick: u64) -> bool {
        let due = tick == self.next;
        if due {
            self.next += self.period;
        }
        due
    }

    /// Goes to another tick, at which nothing has been done yet.
    pub(super) fn seek(&mut self, tick: u64) {
        self.next = tick.next_multiple_of(self.period);
    }
}

/// A block in its place: when it is due, what it reads and where it writes.
pub(super) struct Slot<T: Scalar> {
    pub(super) block: Box<dyn Block<T>>,
    pub(super) due: Due,
    pub(super) inputs: Vec<usize>,
    pub(super) outputs: std::ops::Range<usize>,
    pub(super) buffer: Vec<T>,
    /// Its robot, and the controllers and models of the robot with which it runs, a bit each.
    pub(super) robot: usize,
    pub(super) with: u64,
    pub(super) models: u64,
    /// Columns and values of its outputs, where another of the robot's blocks writes some of them.
    pub(super) shared: Option<Shared<T>>,
}

/// Outputs that do not stand side by side.
pub(super) struct Shared<T> {
    pub(super) columns: Vec<usize>,
    pub(super) values: Vec<T>,
}

impl<T: Scalar> Slot<T> {
    /// Writes the outputs of the present state.
    pub(super) fn observe(&mut self, detail: Detail, row: &mut [T]) {
        self.gather(row);
        match &mut self.shared {
            None => {
                let outputs = &mut row[self.outputs.clone()];
                self.block.observe(&self.buffer, detail, outputs);
            }
            Some(shared) => {
                for (value, &k) in shared.values.iter_mut().zip(&shared.columns) {
                    *value = row[k];
                }
                self.block.observe(&self.buffer, detail, &mut shared.values);
                for (value, &k) in shared.values.iter().zip(&shared.columns) {
                    row[k] = *value;
                }
            }
        }
    }

    /// Lets it decide.
    pub(super) fn step(&mut self, now: &Now<'_, T>, row: &mut [T]) -> Result<(), BlockError> {
        self.gather(row);
        match &mut self.shared {
            None => {
                let outputs = &mut row[self.outputs.clone()];
                self.block.step(now, &self.buffer, outputs)
            }
            Some(shared) => {
                for (value, &k) in shared.values.iter_mut().zip(&shared.columns) {
                    *value = row[k];
                }
                let stepped = self.block.step(now, &self.buffer, &mut shared.values);
                for (value, &k) in shared.values.iter().zip(&shared.columns) {
                    row[k] = *value;
                }
                stepped
            }
        }
    }

    /// Whether it runs with the present controller and model of its robot.
    pub(super) fn runs(&self, rosters: &[Roster]) -> bool {
        let is_of = |set: u64, one: usize| set == u64::MAX || set & (1 << one) != 0;
        let roster = &rosters[self.robot];
        is_of(self.with, roster.active) && is_of(self.models, roster.model)
    }

    /// Columns of its outputs.
    pub(super) fn columns(&self) -> impl Iterator<Item = usize> {
        let (beside, apart): (_, &[usize]) = match &self.shared {
            None => (self.outputs.clone(), &[]),
            Some(shared) => (0..0, &shared.columns),
        };
        beside.chain(apart.iter().copied())
    }

    pub(super) fn gather(&mut self, row: &[T]) {
        // Zipped iterators are calls here, and this is the heart of every tick.
        for (k, &index) in self.inputs.iter().enumerate() {
            self.buffer[k] = row[index];
        }
    }
}

/// Greatest common divisor.
pub(super) fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}
