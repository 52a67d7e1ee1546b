//! A studio whose time passes as the clock does, and what is worth telling of it.

use std::time::{Duration, Instant};

use serde_json::Value;

use crate::studio::{Command, Refusal, Studio};

/// Longest piece of driving between two looks at what was asked for.
const BREATH: Duration = Duration::from_millis(8);
/// Shortest time between two pictures.
pub const FRAME: Duration = Duration::from_millis(16);
/// How often what steps of plug-ins take is told while time runs.
const COSTS: Duration = Duration::from_millis(500);
/// How often files are looked for that can be chosen.
const FILES: Duration = Duration::from_millis(500);
/// Steps driven at once while time runs.
const TICKS: u64 = 20;

/// What has become new.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fresh {
    /// Rows.
    Rows,
    /// More than rows.
    State,
}

/// A studio, and how it keeps up with the clock.
pub struct Player {
    /// What is played.
    pub studio: Studio,
    /// Time of the run and of the clock at which they agreed last.
    agreed: Option<(f64, Instant)>,
    published: Instant,
    /// When more than rows were told last.
    told: Instant,
    /// Files that could be chosen at the last look, and when that was.
    files: Value,
    looked: Instant,
    is_new: bool,
    is_changed: bool,
}

impl Player {
    /// Plays a studio, of which all is new.
    pub fn new(studio: Studio) -> Player {
        Player {
            files: studio.files(),
            looked: Instant::now(),
            studio,
            agreed: None,
            published: Instant::now(),
            told: Instant::now(),
            is_new: false,
            is_changed: false,
        }
    }

    /// Does what a page asks for.
    ///
    /// # Errors
    /// It cannot be done.
    pub fn handle(&mut self, command: Command) -> Result<Value, Refusal> {
        self.is_changed = true;
        self.agreed = None;
        self.studio.handle(command)
    }

    /// How long nothing has to be done, unless something is asked for.
    pub fn rest(&self) -> Duration {
        match (self.studio.is_playing, self.is_new || self.is_changed) {
            (true, _) => Duration::from_millis(1),
            (false, true) => FRAME,
            (false, false) => FILES.saturating_sub(self.looked.elapsed()),
        }
    }

    /// Lets the run go on, if time runs, and says what has become new, as often as pictures are worth it.
    pub fn turn(&mut self) -> Option<Fresh> {
        if self.studio.is_playing {
            let events = self.events();
            self.is_new |= self.drive();
            // What happened, and an end, are told at once.
            self.is_changed |= self.events() != events || !self.studio.is_playing;
            self.is_changed |= self.told.elapsed() >= COSTS && self.studio.has_costs();
        } else {
            self.agreed = None;
        }
        if self.looked.elapsed() >= FILES {
            self.looked = Instant::now();
            let files = self.studio.files();
            self.is_changed |= files != self.files;
            self.files = files;
        }
        if self.published.elapsed() < FRAME {
            return None;
        }
        let fresh = match (self.is_changed, self.is_new) {
            (true, _) => Fresh::State,
            (false, true) => Fresh::Rows,
            (false, false) => return None,
        };
        self.published = Instant::now();
        if fresh == Fresh::State {
            self.told = self.published;
        }
        (self.is_new, self.is_changed) = (false, false);
        Some(fresh)
    }

    fn events(&self) -> usize {
        let history = self.studio.active().history.lock();
        history.expect("nothing panics with it").events.len()
    }

    /// Lets the run go on to where the clock is, for a breath at most; whether there are new rows.
    fn drive(&mut self) -> bool {
        let begun = Instant::now();
        let studio = &mut self.studio;
        let rows = studio.active().rows();
        let (from, since) = *self.agreed.get_or_insert((studio.active().now(), begun));
        let step = studio.active().step();
        while begun.elapsed() < BREATH {
            let ticks = match studio.speed {
                None => TICKS,
                Some(speed) => {
                    let due = from + since.elapsed().as_secs_f64() * speed;
                    let behind = (due - studio.active().now()) / step;
                    if behind < 1.0 {
                        break;
                    }
                    (behind as u64).min(TICKS)
                }
            };
            if !studio.advance(ticks) {
                break;
            }
        }
        if begun.elapsed() >= BREATH {
            // What cannot be kept up with is not made up for.
            self.agreed = None;
        }
        studio.active().rows() != rows
    }
}
