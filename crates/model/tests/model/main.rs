//! Tests of the models, in one binary: the integrators are large, and are compiled once.

mod closed_form;
mod common;
mod commonroad;
mod errata;
mod errata_more;
mod errata_uneven;
mod invariants;
mod inverse;
mod order;
mod random_platforms;
mod single_track;
mod slip;
mod suspension;
mod terrain;
mod terrain_slip;
mod trailer;
mod wheel_legged;
