//! Numbers that change while a run goes on: at a time that the scenario says, or by hand.
//!
//! The world is wired anew with the number, and takes the state of the old one over: robots go on from where
//! they are, as fast as they are. A change by hand is written down ([`Run::repetition`]), and a run of that
//! scenario has the same signals, bit for bit.

use std::sync::Arc;

use crate::block::Cost;
use crate::build::Values;
use crate::record::{Event, Recorder};
use crate::run::{Plans, Run, assemble, refuse};
use crate::scenario::{Change, Diagnostics, Loaded, Swap, Template, check};
use crate::world::{SimError, World};

/// What a run's world is wired anew from.
pub(crate) struct Rewiring {
    template: Template,
    loaded: Loaded,
    trial: u64,
    plans: Arc<Plans>,
    /// All changes, in the order in which they are made; those before `next` were.
    changes: Vec<Change>,
    next: usize,
}

/// Parts of a robot whose numbers may change while it drives.
const PARTS: [&str; 6] = [
    "controller",
    "standby",
    "servo",
    "sensor",
    "wheel_noise",
    "platform",
];

/// What of them stays: when blocks run, and what judges and plans go by.
const STAYS: [&str; 7] = [
    "period",
    "collision_radius",
    "footprint",
    "count",
    "at",
    "schema",
    "seed",
];

/// Whether a number at this path may change while a run goes on.
pub fn is_changeable(path: &str) -> bool {
    let parts: Vec<&str> = path.split('.').collect();
    match parts.as_slice() {
        ["robot", _, part, rest @ ..] => {
            PARTS.contains(part)
                && !rest.is_empty()
                && !rest.iter().any(|word| STAYS.contains(word))
        }
        ["terrain", rest @ ..] => !rest.is_empty(),
        _ => false,
    }
}

impl Rewiring {
    /// For a scenario without its changes, and the changes.
    pub(crate) fn new(
        loaded: &Loaded,
        changes: Vec<Change>,
        trial: u64,
        plans: &Arc<Plans>,
    ) -> Result<Self, Diagnostics> {
        let rewiring = Rewiring {
            template: Template::of(loaded),
            loaded: loaded.clone(),
            trial,
            plans: plans.clone(),
            changes,
            next: 0,
        };
        let time = &loaded.scenario.time;
        let mut before = 0.0;
        for (k, change) in rewiring.changes.iter().enumerate() {
            let place = |field: &str| format!("change.{k}.{field}");
            let no = |field: &str, problem: String, hint: &str| {
                Err(refuse(loaded, place(field), problem, hint.to_owned()))
            };
            if !(before..=time.duration).contains(&change.at) {
                return no(
                    "at",
                    format!(
                        "must be in [{before}, {}], after the change before it and within the run, s, got {}",
                        time.duration, change.at
                    ),
                    "put changes in the order of their times",
                );
            }
            let ticks = change.at / time.step;
            if (ticks - ticks.round()).abs() > 1e-6 * ticks.max(1.0) {
                return no(
                    "at",
                    format!(
                        "must be a multiple of time.step = {} s, got {}",
                        time.step, change.at
                    ),
                    "",
                );
            }
            before = change.at;
            rewiring.with(k + 1, &place("path"))?;
        }
        Ok(rewiring)
    }

    /// The scenario after its first `count` changes, the last of which is named `place` in errors.
    fn with(&self, count: usize, place: &str) -> Result<Loaded, Diagnostics> {
        let Some(last) = self.changes[..count].last() else {
            return Ok(self.loaded.clone());
        };
        let refused = |problem: String, hint: &str| {
            Err(refuse(
                &self.loaded,
                place.to_owned(),
                problem,
                hint.to_owned(),
            ))
        };
        if !is_changeable(&last.path) {
            return refused(
                format!(
                    "must be a number that can change while robots drive, got {:?}",
                    last.path
                ),
                "those of controllers, servos, sensors, bodies, wheels and the ground can, but for their periods",
            );
        }
        if !last.value.is_finite() {
            return refused(format!("must be finite, got {}", last.value), "");
        }
        let numbers: Vec<(String, f64)> = self.changes[..count]
            .iter()
            .map(|change| (change.path.clone(), change.value))
            .collect();
        let loaded = match self.template.with(&numbers) {
            Ok(loaded) => loaded,
            Err(error) => {
                let path = match error.path.is_empty() {
                    true => last.path.clone(),
                    false => error.path,
                };
                return refused(
                    format!("{path}: {}", error.problem),
                    error.hint.as_deref().unwrap_or(""),
                );
            }
        };
        let problems = check(&loaded.scenario, &self.loaded.folder);
        if let Some((path, problem, hint)) = problems.into_iter().next() {
            return refused(format!("{path}: {problem}"), hint.as_deref().unwrap_or(""));
        }
        Ok(Loaded {
            trust_native: self.loaded.trust_native,
            ..loaded
        })
    }

    /// The world of the scenario after its first `count` changes, in the state of another.
    fn world(
        &self,
        count: usize,
        swaps: &[Swap],
        old: &World,
        place: &str,
    ) -> Result<World, Diagnostics> {
        let mut loaded = self.with(count, place)?;
        loaded.scenario.swap = swaps.to_vec();
        let assembly = assemble(&loaded, self.trial, &self.plans, &Values::new(&[]))?;
        let mut world = World::wire(assembly.parts);
        let fits = world.signals() == old.signals() && world.restore(&old.save()).is_ok();
        match fits {
            true => Ok(world),
            false => Err(refuse(
                &self.loaded,
                place.to_owned(),
                "must leave the robot's signals and blocks as they are".to_owned(),
                "begin the run with it instead".to_owned(),
            )),
        }
    }

    /// The value at a path after the first `count` changes.
    fn value(&self, count: usize, path: &str) -> Option<f64> {
        let changed = self.changes[..count].iter().rev();
        let found = { changed }.find(|change| change.path == path);
        let first = || {
            let mut numbers = self.template.numbers().into_iter();
            numbers.find(|(known, _)| known == path)
        };
        found.map_or_else(
            || first().map(|(_, value)| value),
            |change| Some(change.value),
        )
    }
}

impl Run {
    /// Sets a number by its path, from this instant on.
    ///
    /// # Errors
    /// There is no such number, it cannot change while robots drive, or the scenario would be refused with it.
    pub fn change(&mut self, path: &str, value: f64) -> Result<(), Diagnostics> {
        let step = self.scenario().time.step;
        let at = (self.world.tick() as f64 * step).min(self.scenario().time.duration);
        let place = self.rewiring.next;
        let before = self.rewiring.changes.clone();
        // A knob that is turned at one instant has its last value.
        let is_same = |change: &Change| change.at == at && change.path == path;
        let turned = self.rewiring.changes[..place].iter().position(is_same);
        if let Some(turned) = turned {
            self.rewiring.changes.remove(turned);
        }
        let place = self.rewiring.next - usize::from(turned.is_some());
        let change = Change {
            at,
            path: path.to_owned(),
            value,
        };
        self.rewiring.changes.insert(place, change);
        match self.rewire(place, path) {
            Ok(event) => {
                self.rewiring.next = place + 1;
                self.script.touch();
                // Of a knob that is turned at one instant the last event counts, too.
                if turned.is_some() {
                    self.world.forget(&event);
                }
                self.world.announce(event);
                Ok(())
            }
            Err(error) => {
                self.rewiring.changes = before;
                Err(error)
            }
        }
    }

    /// Takes the world over into one with the change at `place`; what happened.
    fn rewire(&mut self, place: usize, named: &str) -> Result<Event, Diagnostics> {
        if self.script.has_joined() {
            return Err(refuse(
                &self.rewiring.loaded,
                named.to_owned(),
                "cannot change after a plug-in was replaced while it ran".to_owned(),
                "run the scenario that was kept, and change it there".to_owned(),
            ));
        }
        let change = &self.rewiring.changes[place];
        let old = self.rewiring.value(place, &change.path);
        let robot = match change.path.split('.').collect::<Vec<_>>()[..] {
            ["robot", name, ..] => name.to_owned(),
            _ => String::new(),
        };
        let short = change
            .path
            .strip_prefix(&format!("robot.{robot}."))
            .unwrap_or(&change.path);
        let from = old.map_or(String::new(), |old| format!("{old} → "));
        let event = Event {
            t: self.world.now(),
            text: format!("{short}: {from}{}", change.value),
            kind: "change".to_owned(),
            position: self.world.place(&robot),
            robot,
        };
        let swaps = self.script.swaps();
        let mut world = self.rewiring.world(place + 1, swaps, &self.world, named)?;
        world.inherit(&mut self.world);
        self.world = world;
        Ok(event)
    }

    /// Makes the changes that are due; the ticks until the next.
    pub(crate) fn change_due(&mut self) -> Result<u64, SimError> {
        loop {
            let place = self.rewiring.next;
            let Some(change) = self.rewiring.changes.get(place) else {
                return Ok(u64::MAX);
            };
            let tick = (change.at / self.scenario().time.step).round() as u64;
            if tick > self.world.tick() {
                return Ok(tick - self.world.tick());
            }
            let path = change.path.clone();
            let event = self.rewire(place, &path).map_err(|error| {
                let problem = error.0.into_iter().next();
                SimError::Change {
                    path,
                    problem: problem.map_or_else(String::new, |one| one.problem),
                    t: self.world.now(),
                }
            })?;
            self.world.announce(event);
            self.rewiring.next = place + 1;
        }
    }

    /// Names of a robot's controllers, and which of them drives, or takes over at the next step.
    pub fn controllers(&self, robot: usize) -> (&[String], usize) {
        self.world.deciding(robot)
    }

    /// What steps of one of a robot's controllers take, where that is measured: of plug-ins.
    pub fn cost(&self, robot: usize, controller: usize) -> Option<Cost> {
        self.world.cost(robot, controller)
    }

    /// All changes of numbers, planned ones, too.
    pub fn changes(&self) -> &[Change] {
        &self.rewiring.changes
    }
}

/// A run that is made piece by piece, by whoever holds it.
pub struct Session {
    /// The run; what is changed in it counts from the next piece on.
    pub run: Run,
    meter: crate::meter::Meter<f64>,
    error: Option<SimError>,
    is_over: bool,
}

impl Session {
    /// Begins to measure a run that has not begun.
    pub fn new(run: Run) -> Self {
        Session {
            meter: run.meter(),
            run,
            error: None,
            is_over: false,
        }
    }

    /// Goes on for at most so many steps, into a recorder that was opened with [`Run::header`]. True while
    /// there is more to do.
    ///
    /// # Errors
    /// The recorder failed. What else goes wrong ends the run, and stands in its summary.
    pub fn advance(&mut self, ticks: u64, recorder: &mut dyn Recorder) -> Result<bool, SimError> {
        let end = self.run.world.tick() + ticks;
        while !self.is_over && self.run.world.tick() < end {
            let limit = end - self.run.world.tick();
            match self.run.advance(limit, &mut self.meter, recorder) {
                Ok(goes_on) => self.is_over = !goes_on,
                Err(error @ SimError::Record(_)) => return Err(error),
                Err(error) => {
                    self.error = Some(error);
                    self.is_over = true;
                }
            }
        }
        Ok(!self.is_over)
    }

    /// Whether the run has ended.
    pub fn is_over(&self) -> bool {
        self.is_over
    }

    /// What became of it so far.
    pub fn summary(&self) -> crate::run::Summary {
        self.run.summary(&self.meter, self.error.as_ref())
    }
}
