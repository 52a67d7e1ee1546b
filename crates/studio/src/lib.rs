//! The interactive front of Appell: a server on loopback that owns the run, and the page that shows it.
//!
//! [`studio`] is what happens to a run, [`player`] how time passes for it, [`history`] what was driven; [`talk`] and
//! [`wire`] are how pages see it. [`driver`] is the thread that it has of its own, [`web`] its server, [`panels`]
//! the views that a project brings along: a page that has all of it beside itself has none of these three. The
//! page is in `page/`.

#[cfg(not(target_family = "wasm"))]
pub mod driver;
pub mod history;
#[cfg(not(target_family = "wasm"))]
pub mod panels;
pub mod player;
mod spectrum;
pub mod studio;
pub mod talk;
#[cfg(not(target_family = "wasm"))]
pub mod web;
pub mod wire;
