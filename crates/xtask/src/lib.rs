//! Chores of the project, as functions that its tests can call.

pub mod vectors;
