//! `Block`: anything with ports that advances in time. The border of run time.

use std::any::Any;

use appell_model::lanewise::Lanewise;
use appell_model::scalar::{Mask, Scalar};
use appell_model::wide::{Job, widest};

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
    /// The lanes in which it happened, a bit each.
    pub lanes: u32,
    /// What follows.
    pub then: Recovery,
}

/// What follows when a block could not go on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Recovery {
    /// The trial ends.
    End,
    /// The block has written zeros, and goes on doing so.
    Stop,
    /// The robot's controller, or of a model the model, of this place takes over.
    Swap(usize),
}

/// The instant at which a step begins, in each lane.
#[derive(Clone, Copy, Debug)]
pub struct Now<'a, T> {
    /// Ticks since the start of the lane's trial.
    pub ticks: &'a [u64],
    /// Time, s.
    pub t: T,
    /// Length of the step, s.
    pub dt: f64,
}

/// Anything with ports that advances in time: sensor, controller, servo or plant; of one trial, or of
/// several in lanes.
///
/// Values of ports are in SI units, in the order of [`Block::inputs`] and [`Block::outputs`].
pub trait Block<T: Scalar = f64>: Send {
    /// Signals it reads.
    fn inputs(&self) -> &[Port];
    /// Signals it writes.
    fn outputs(&self) -> &[Port];
    /// Advances by a step with `input` held; writes all of `output`. A plant writes its outputs in
    /// [`Block::observe`] instead. What fails in some lanes is done in the others.
    fn step(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) -> Result<(), BlockError>;
    /// Prepares to take over from a block that wrote `before` to its outputs last, and reads `input`.
    /// Where it cannot, the other goes on.
    fn take_over(&mut self, _input: &[T], _before: &[T]) -> Result<(), BlockError> {
        Ok(())
    }
    /// SHA-256 of what it was loaded from, where that is a file.
    fn origin(&self) -> Option<&str> {
        None
    }
    /// Is told that nobody reads energies and the angles of driven wheels: a plant may leave them out.
    fn leave_out(&mut self) {}
    /// What its steps take, where that is measured.
    fn cost(&self) -> Option<Cost> {
        None
    }
    /// Writes the outputs of the present state; for plants, whose state moves between readings.
    fn observe(&mut self, _input: &[T], _detail: Detail, _output: &mut [T]) {}
    /// Appends the state as bytes, for saving and branching; nothing for a block without one.
    fn save(&self, _bytes: &mut Vec<u8>) {}
    /// Takes the state back; the number of bytes used, or `None` if they do not fit.
    fn restore(&mut self, _bytes: &[u8]) -> Option<usize> {
        Some(0)
    }
    /// Itself, for [`Block::take`] of another.
    fn any(&self) -> &dyn Any;
    /// Whether a block of plain numbers is the like of this one, but for its numbers.
    fn fits(&self, one: &dyn Any) -> bool;
    /// Takes such a block, which fits, into a lane.
    fn take(&mut self, lane: usize, one: &dyn Any);
}

/// What steps take, by the clock: nothing that a run depends on, or that is recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Steps that were measured.
    pub steps: u64,
    /// Time of all of them, s.
    pub total: f64,
    /// Longest of them, s.
    pub longest: f64,
}

/// What a block does, apart from its wiring: pure work on numbers in lanes.
///
/// `act` is `#[inline(always)]`, so that it is compiled for the instructions that its numbers are
/// made for, and free of closures that are called (see [`appell_model::wide`]).
pub trait Kernel<T: Scalar>: Lanewise<One: 'static> + Send + 'static {
    /// Advances by a step; see [`Block::step`].
    fn act(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]);
    /// See [`Block::take_over`].
    fn take_over(&mut self, _input: &[T], _before: &[T]) {}
    /// See [`Block::save`].
    fn save(&self, _bytes: &mut Vec<u8>) {}
    /// See [`Block::restore`].
    fn restore(&mut self, _bytes: &[u8]) -> Option<usize> {
        Some(0)
    }
}

/// A kernel with its ports.
pub struct Wired<K> {
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    kernel: K,
}

impl<K> Wired<K> {
    /// A kernel that reads and writes these signals.
    pub fn new(inputs: Vec<Port>, outputs: Vec<Port>, kernel: K) -> Self {
        Wired {
            inputs,
            outputs,
            kernel,
        }
    }
}

struct Act<'a, 'b, T, K> {
    kernel: &'a mut K,
    now: &'a Now<'b, T>,
    input: &'a [T],
    output: &'a mut [T],
}

impl<T: Scalar, K: Kernel<T>> Job for Act<'_, '_, T, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.kernel.act(self.now, self.input, self.output);
    }
}

impl<T: Scalar, K: Kernel<T>> Block<T> for Wired<K> {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    fn step(&mut self, now: &Now<'_, T>, input: &[T], output: &mut [T]) -> Result<(), BlockError> {
        widest::<T, _>(Act {
            kernel: &mut self.kernel,
            now,
            input,
            output,
        });
        Ok(())
    }

    fn take_over(&mut self, input: &[T], before: &[T]) -> Result<(), BlockError> {
        self.kernel.take_over(input, before);
        Ok(())
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        self.kernel.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        self.kernel.restore(bytes)
    }

    fn any(&self) -> &dyn Any {
        self
    }

    fn fits(&self, one: &dyn Any) -> bool {
        one.downcast_ref::<Wired<K::One>>().is_some_and(|one| {
            self.inputs == one.inputs
                && self.outputs == one.outputs
                && self.kernel.fits(&one.kernel)
        })
    }

    fn take(&mut self, lane: usize, one: &dyn Any) {
        if let Some(one) = one.downcast_ref::<Wired<K::One>>() {
            self.kernel.put(lane, &one.kernel);
        }
    }
}

/// The lanes in which all of some numbers are finite.
pub(crate) fn finite_lanes<T: Scalar>(numbers: &[T]) -> T::Mask {
    struct Finite<'a, T>(&'a [T]);

    impl<T: Scalar> Job for Finite<'_, T> {
        type Output = T::Mask;

        #[inline(always)]
        fn run(self) -> T::Mask {
            let mut finite = T::Mask::splat(true);
            for k in 0..self.0.len() {
                finite = finite.and(self.0[k].is_finite());
            }
            finite
        }
    }

    widest::<T, _>(Finite(numbers))
}

/// Appends numbers to saved bytes, bit for bit.
pub fn save_numbers<T: Scalar>(numbers: &[T], bytes: &mut Vec<u8>) {
    for number in numbers {
        for lane in 0..T::LANES {
            bytes.extend_from_slice(&number.lane(lane).to_bits().to_le_bytes());
        }
    }
}

/// Reads as many numbers as `numbers` holds; the bytes used.
pub fn restore_numbers<T: Scalar>(numbers: &mut [T], bytes: &[u8]) -> Option<usize> {
    let size = 8 * T::LANES * numbers.len();
    let mut words = bytes.get(..size)?.chunks_exact(8).map(|chunk| {
        let word = chunk.try_into().expect("chunks of eight bytes");
        f64::from_bits(u64::from_le_bytes(word))
    });
    for number in numbers.iter_mut() {
        *number = T::from_lanes(|_| words.next().unwrap_or(0.0));
    }
    Some(size)
}
