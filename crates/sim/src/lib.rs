//! Scenarios, worlds, controllers, tasks and recordings.
//!
//! The way of the data: [`scenario`] (what people write) → [`build`] → [`world`] (what runs) →
//! [`record`] (what remains) → [`report`] (what people see). [`run`] ties them together.

// Kernels name their indices: in what runs on lanes an iterator is a function of its own, compiled
// without the instruction set that it was entered with.
#![allow(clippy::needless_range_loop, clippy::manual_memcpy)]

pub mod batch;
pub mod block;
pub mod build;
pub mod change;
pub mod compare;
pub mod controller;
pub mod crossing;
pub mod crowd;
mod decide;
pub mod design;
mod drawing;
pub mod env;
mod foreign;
pub mod inverse;
pub mod judge;
pub mod layout;
pub mod live;
pub mod measures;
mod meter;
pub mod noise;
pub mod obstacle;
pub mod plan;
pub mod plant;
pub mod record;
mod relief;
pub mod replay;
pub mod report;
pub mod ros;
pub mod route;
pub mod run;
pub mod scenario;
#[cfg(not(target_family = "wasm"))]
pub mod sensitivity;
pub mod sensor;
pub mod servo;
pub mod signal;
mod spline;
pub mod umbmark;
pub mod uneven;
pub mod urdf;
pub mod world;
