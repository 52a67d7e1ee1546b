//! Equations of motion of wheeled mobile robots, written once and generic in the scalar.
//!
//! The same text runs on `f64`, on SIMD [`lanes`] and on [`dual`] numbers. Nothing here reads a
//! file, knows a clock, draws a random number or fails inside an equation: a [`platform::Platform`]
//! is checked when it is built, and after that every function is total.
//!
//! Units are SI throughout (m, kg, s, rad, N, N·m, V, A); frames follow REP-103: x forward, y left,
//! z up, yaw counter-clockwise. Labels such as `[eq:contact-velocity]` name equations of the book.

// Equations name their indices, and in the loops of a step an iterator is a function of its own,
// compiled without the instruction set that the step was entered with: it costs up to tenfold.
#![allow(clippy::needless_range_loop, clippy::manual_memcpy)]

pub mod drive;
pub mod dual;
pub mod dynamics;
pub mod ground;
pub mod integrate;
pub mod kinematic;
pub mod lanes;
pub mod math;
pub mod planar;
pub mod platform;
pub mod rolling;
pub mod scalar;
pub mod solve;
pub mod wheel;
