//! What changes lines: numbers, controllers, scenarios, branches, and taking back.

use appell_sim::change::is_changeable;
use appell_sim::crowd::is_crowd;
use appell_sim::scenario::{self, Controller, Law, Level, Loaded, Overrides, Robot, Scenario};
use serde::Serialize;
use serde_json::{Value, json};

use super::command::Refusal;
use super::line::{Kind, Line};
use super::{Native, Studio, Undo};

/// Laws of path following, as a scenario names them.
pub(super) const LAWS: [&str; 5] = ["samson", "pure-pursuit", "stanley", "kanayama", "lqr"];
/// Most lines beside each other.
const LINES_MAX: usize = 8;
/// Most steps back.
const UNDO_MAX: usize = 200;
/// What the controller is called that hands command.
pub const HAND: &str = "hand";

fn quoted(word: impl Serialize) -> String {
    serde_json::to_string(&word).expect("plain data")
}

fn level_name(level: Level) -> &'static str {
    match level {
        Level::Kinematic => "kinematic",
        Level::Rolling => "rolling",
        Level::Slip => "slip",
    }
}

impl Studio {
    /// The scenario with values at paths, read anew and checked.
    pub(super) fn reload(&self, scenario: &Scenario, set: &Overrides) -> Result<Loaded, Refusal> {
        let file = &self.active().loaded.file;
        let loaded = scenario::load_text(&scenario.to_toml(), file, set)?;
        if is_crowd(&loaded.scenario) {
            return Err(Refusal::new(
                "must have robots of count = 1 to be driven here",
                "",
            ));
        }
        Ok(Loaded {
            trust_native: self.native == Native::Here,
            ..loaded
        })
    }

    /// Puts another line in the place of the active one.
    pub(super) fn replace(&mut self, mut line: Line) {
        let place = self.place(self.active);
        let old = &mut self.lines[place.expect("the active line is there")];
        line.parent = old.parent.take();
        self.active = line.id;
        *old = line;
    }

    pub(super) fn remember(
        &mut self,
        what: String,
        before: Scenario,
        from: Option<u32>,
        gesture: Option<u64>,
    ) {
        self.redo.clear();
        self.saved = None;
        self.notice = None;
        if gesture.is_some() && gesture == self.gesture {
            if let Some(last) = self.undo.last_mut() {
                last.what = what;
            }
            return;
        }
        self.gesture = gesture;
        if self.undo.len() >= UNDO_MAX {
            self.undo.remove(0);
        }
        self.undo.push(Undo { what, before, from });
    }

    /// Drives another scenario to where the active line is. The line stays to be seen, unless the last change
    /// belongs to the same gesture.
    pub(super) fn drive_anew(
        &mut self,
        before: Scenario,
        after: Loaded,
        what: String,
        gesture: Option<u64>,
    ) -> Result<(), Refusal> {
        let goes_on = gesture.is_some() && gesture == self.gesture;
        let old = self.active();
        let (is_over, tick) = (old.is_over(), old.tick());
        // A line that has hardly begun need not stay.
        let replaces = goes_on || old.tick() <= 1;
        let name = match replaces {
            true => old.name.clone(),
            false => self.new_name(),
        };
        let mut line = self.begin(after, name, what.clone(), Kind::Driven)?;
        line.drive_to(if is_over { u64::MAX } else { tick });
        let from = self.active;
        if replaces {
            self.replace(line);
        } else {
            line.parent = Some((self.active().name.clone(), 0.0));
            self.add(line);
        }
        self.remember(what, before, (!replaces).then_some(from), gesture);
        self.renew_ghosts();
        Ok(())
    }

    /// Adds a line, which goes on from now on.
    fn add(&mut self, line: Line) {
        self.active = line.id;
        self.insert(line);
    }

    /// Puts a line beside the others, before those that run along; the oldest goes where there are too many.
    pub(super) fn insert(&mut self, line: Line) {
        let ghosts = self
            .lines
            .iter()
            .position(|line| matches!(line.kind, Kind::Ghost(_)));
        let place = ghosts.unwrap_or(self.lines.len());
        self.lines.insert(place, line);
        let driven = |line: &Line| !matches!(line.kind, Kind::Ghost(_));
        while self.lines.iter().filter(|line| driven(line)).count() > LINES_MAX {
            let (active, newest) = (self.active, self.next_id - 1);
            let oldest = self
                .lines
                .iter()
                .position(|line| driven(line) && line.id != active && line.id != newest);
            self.lines.remove(oldest.expect("there are several"));
        }
    }

    /// A new line from an instant of the active one on, with what was done until then.
    pub(super) fn branch(&mut self, at: f64, what: String) -> Result<(), Refusal> {
        let line = self.active();
        let document = line.document()?;
        let (step, end) = (document.scenario.time.step, line.tick());
        let limit = end as f64 * step;
        if !(0.0..=limit + step).contains(&at) {
            return Err(Refusal::new(
                format!("at: must be in [0, {limit}], what the line has driven, s, got {at}"),
                "",
            ));
        }
        let tick = (at / step).round() as u64;
        let is_past = |t: f64| (t / step).round() as u64 <= tick;
        let mut scenario = document.scenario.clone();
        let (swaps, changes) = &self.planned;
        scenario
            .swap
            .retain(|swap| is_past(swap.at) || swaps.contains(swap));
        scenario
            .change
            .retain(|change| is_past(change.at) || changes.contains(change));
        let parent = Some((line.name.clone(), at));
        let loaded = self.reload(&scenario, &[])?;
        let name = self.new_name();
        let mut branch = self.begin(loaded, name, what, Kind::Driven)?;
        branch.drive_to(tick);
        branch.parent = parent;
        self.add(branch);
        self.renew_ghosts();
        Ok(())
    }

    /// Leaves out the branch that was just made from a line: the change that it was for failed.
    fn retract(&mut self, from: u32) {
        let made = self.active;
        self.active = from;
        self.lines.retain(|line| line.id != made);
        self.next_name -= 1;
        self.renew_ghosts();
    }

    /// Whether a change at this instant is one of the past.
    fn is_past(&self, at: Option<f64>) -> bool {
        let line = self.active();
        let step = line.loaded.scenario.time.step;
        at.is_some_and(|at| {
            ((at / step).round() as u64) < line.last_tick() || line.session.is_none()
        })
    }

    pub(super) fn change(
        &mut self,
        path: &str,
        value: f64,
        at: Option<f64>,
        gesture: Option<u64>,
    ) -> Result<(), Refusal> {
        if !value.is_finite() {
            return Err(Refusal {
                path: path.to_owned(),
                problem: format!("must be finite, got {value}"),
                hint: String::new(),
            });
        }
        // Not read anew: of many robots that takes longer than what is done.
        let before = self.active().scenario();
        if !is_changeable(path) {
            let set = [(path.to_owned(), scenario::number_text(value))];
            let edited = self.reload(&before, &set)?;
            let what = format!("{path} = {value}");
            return self.drive_anew(before, edited, what, gesture);
        }
        let goes_on = gesture.is_some() && gesture == self.gesture;
        let what = format!("{path} = {value}");
        let is_past = self.is_past(at) && !goes_on;
        if !is_past && (self.active().is_over() || self.active().session.is_none()) {
            // What is over is driven again with the number from the beginning.
            let mut scenario = before.clone();
            scenario.change.retain(|change| change.path != path);
            let set = [(path.to_owned(), scenario::number_text(value))];
            let edited = self.reload(&scenario, &set)?;
            return self.drive_anew(before, edited, what, gesture);
        }
        let from = self.active;
        if let (true, Some(at)) = (is_past, at) {
            self.branch(at, what.clone())?;
        }
        let session = self.active_mut().session.as_mut().expect("it goes on");
        if let Err(error) = session.run.change(path, value) {
            if is_past {
                self.retract(from);
            }
            return Err(Refusal {
                path: path.to_owned(),
                ..Refusal::from(error)
            });
        }
        for line in &mut self.lines {
            if matches!(line.kind, Kind::Ghost(_))
                && let Some(session) = &mut line.session
                && !session.is_over()
            {
                // One of another level may not have the number.
                let _ = session.run.change(path, value);
            }
        }
        self.remember(what, before, is_past.then_some(from), gesture);
        Ok(())
    }

    pub(super) fn swap(&mut self, robot: &str, to: &str, at: Option<f64>) -> Result<(), Refusal> {
        let before = self.active().scenario();
        let from = self.active;
        let is_past = self.is_past(at);
        let what = format!("{robot}: {to} takes over");
        if let (true, Some(at)) = (is_past, at) {
            self.branch(at, what.clone())?;
        } else if self.active().is_over() {
            return Err(Refusal::new(
                "the run is over",
                "go back in time and change the controller there",
            ));
        }
        let session = self.active_mut().session.as_mut().expect("it goes on");
        let swapped = session.run.swap(robot, to);
        if let Err(error) = swapped {
            if is_past {
                self.retract(from);
            }
            return Err(Refusal::new(error.to_string(), ""));
        }
        self.remember(what, before, is_past.then_some(from), None);
        self.renew_ghosts();
        Ok(())
    }

    /// Adds a controller that stands by, if it does not yet, and lets it take over.
    pub(super) fn engage(
        &mut self,
        robot: &str,
        with: &str,
        at: Option<f64>,
    ) -> Result<(), Refusal> {
        let document = self.active().document()?;
        let own = document.scenario.robot.iter().find(|own| own.name == robot);
        let Some(own) = own else {
            return Err(Refusal::new(format!("there is no robot {robot:?}"), ""));
        };
        if own.controllers().all(|(name, _)| name != with) {
            let controller = match with {
                HAND => hand(own),
                law => follower(own, law)?,
            };
            self.stand_by(robot, with, controller)?;
        }
        self.swap(robot, with, at)
    }

    /// Undoes, or does again.
    pub(super) fn step_back(&mut self, again: bool) -> Result<(), Refusal> {
        let from = if again {
            &mut self.redo
        } else {
            &mut self.undo
        };
        let Some(step) = from.pop() else {
            let what = if again { "redo" } else { "undo" };
            return Err(Refusal::new(format!("there is nothing to {what}"), ""));
        };
        self.gesture = None;
        let now = Undo {
            what: step.what.clone(),
            before: self.active().scenario(),
            from: None,
        };
        let left = self.active;
        match step.from.filter(|id| self.place(*id).is_some()) {
            // Undoing a branch is to go back to where it came from.
            Some(id) if !again => {
                self.active = id;
                self.lines.retain(|line| line.id != left);
                self.is_playing = false;
            }
            _ => {
                let old = self.active();
                let (is_over, tick) = (old.is_over(), old.tick());
                let name = old.name.clone();
                let before = self.reload(&step.before, &[])?;
                let mut line = self.begin(before, name, step.what, Kind::Driven)?;
                line.drive_to(if is_over { u64::MAX } else { tick });
                self.replace(line);
            }
        }
        if again {
            &mut self.undo
        } else {
            &mut self.redo
        }
        .push(now);
        self.saved = None;
        self.renew_ghosts();
        Ok(())
    }

    pub(super) fn add_ghost(&mut self, level: Level) -> Result<(), Refusal> {
        let active = self.active();
        let set = [("robot.*.level".to_owned(), quoted(level))];
        let loaded = self.reload(&active.document()?.scenario, &set)?;
        let (is_over, tick) = (active.is_over(), active.tick());
        let name = level_name(level).to_owned();
        let what = "runs along".to_owned();
        let mut ghost = self.begin(loaded, name, what, Kind::Ghost(level))?;
        ghost.drive_to(if is_over { u64::MAX } else { tick });
        self.lines.retain(|line| line.kind != Kind::Ghost(level));
        self.lines.push(ghost);
        Ok(())
    }

    /// Ghosts of the active line as it is now; those that cannot be built are left out, with a notice.
    pub(super) fn renew_ghosts(&mut self) {
        for level in self.ghosts.clone() {
            if let Err(refusal) = self.add_ghost(level) {
                self.lines.retain(|line| line.kind != Kind::Ghost(level));
                self.notice = Some(format!(
                    "{} does not run along: {refusal}",
                    level_name(level)
                ));
            }
        }
    }
}

/// A controller that hands command: channels that stay where they are put.
fn hand(robot: &Robot) -> Controller {
    let moves_sideways = robot.platform.as_ref().is_some_and(|platform| {
        let rollers = platform
            .wheel
            .iter()
            .filter(|wheel| !matches!(wheel.rim, scenario::Rim::Plain));
        rollers.count() >= 3
    });
    let channels = ["forward", "yaw_rate", "left"];
    let count = if moves_sideways { 3 } else { 2 };
    let channel: Vec<Value> = channels[..count]
        .iter()
        .map(|to| json!({"to": to, "signal": {"kind": "constant", "value": 0.0}}))
        .collect();
    let text = json!({"kind": "signals", "channel": channel});
    serde_json::from_value(text).expect("a controller")
}

/// The robot's own follower, with another law.
fn follower(robot: &Robot, law: &str) -> Result<Controller, Refusal> {
    let Ok(law) = serde_json::from_value::<Law>(json!(law)) else {
        return Err(Refusal::new(
            format!("must be a law of path following, or hand, got {law:?}"),
            LAWS.join(", "),
        ));
    };
    let mut own = robot.controllers().map(|(_, controller)| controller);
    let Some(controller) = own.find(|controller| controller.follower().is_some()) else {
        return Err(Refusal::new(
            format!(
                "robot {} must have a controller that follows a path",
                robot.name
            ),
            "",
        ));
    };
    let mut controller = controller.clone();
    match &mut controller {
        Controller::Homing(follower)
        | Controller::Gate(follower)
        | Controller::Eight(follower)
        | Controller::Slalom(follower)
        | Controller::Route(follower) => follower.law = law,
        Controller::Signals { .. } | Controller::Plugin(_) => {}
    }
    Ok(controller)
}
