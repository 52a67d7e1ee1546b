//! The interactive front of Appell: a server on loopback that owns the run, and the page that shows it.
//!
//! [`studio`] is what happens to a run, [`driver`] the thread that lets time pass, [`history`] what was driven,
//! [`wire`] and [`web`] how pages see it, [`panels`] the views that a project brings along. The page is in `page/`.

pub mod driver;
pub mod history;
pub mod panels;
mod spectrum;
pub mod studio;
pub mod web;
pub mod wire;
