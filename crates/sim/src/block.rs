//! `Block`: anything with ports that advances in time. The border of run time.

use crate::signal::Signal;

/// A port: a signal by path and unit, read or written by a block.
pub type Port = Signal;

/// How much of a plant's outputs a reader needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Pose, twist, wheel angles and rates: what sensors, controllers and judges read.
    Motion,
    /// Forces and energies as well: what is recorded.
    Everything,
}

/// Why a block could not go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{block}: {problem}")]
pub struct BlockError {
    /// Path of the block.
    pub block: String,
    /// What happened.
    pub problem: String,
}

/// Anything with ports that advances in time: sensor, controller, servo or plant.
///
/// Values of ports are `f64` in SI units, in the order of [`Block::inputs`] and [`Block::outputs`].
pub trait Block: Send {
    /// Signals it reads.
    fn inputs(&self) -> &[Port];
    /// Signals it writes.
    fn outputs(&self) -> &[Port];
    /// Advances from tick `tick` (time `t`, s) by `dt`, s, with `input` held; writes all of
    /// `output`. A plant writes its outputs in [`Block::observe`] instead.
    fn step(
        &mut self,
        tick: u64,
        t: f64,
        dt: f64,
        input: &[f64],
        output: &mut [f64],
    ) -> Result<(), BlockError>;
    /// Writes the outputs of the present state; for plants, whose state moves between readings.
    fn observe(&mut self, _input: &[f64], _detail: Detail, _output: &mut [f64]) {}
    /// Appends the state as bytes, for saving and branching; nothing for a block without one.
    fn save(&self, _bytes: &mut Vec<u8>) {}
    /// Takes the state back; the number of bytes used, or `None` if they do not fit.
    fn restore(&mut self, _bytes: &[u8]) -> Option<usize> {
        Some(0)
    }
}

/// Appends numbers to saved bytes, bit for bit.
pub fn save_numbers(numbers: &[f64], bytes: &mut Vec<u8>) {
    for number in numbers {
        bytes.extend_from_slice(&number.to_bits().to_le_bytes());
    }
}

/// Reads as many numbers as `numbers` holds; the bytes used.
pub fn restore_numbers(numbers: &mut [f64], bytes: &[u8]) -> Option<usize> {
    let size = 8 * numbers.len();
    let chunks = bytes.get(..size)?.chunks_exact(8);
    for (number, chunk) in numbers.iter_mut().zip(chunks) {
        *number = f64::from_bits(u64::from_le_bytes(chunk.try_into().ok()?));
    }
    Some(size)
}
