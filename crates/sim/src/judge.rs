//! Judge of the beacon tasks of the chapter on tasks, one sample at a time.
//!
//! World frame, SI units. The trajectory between two samples is the straight segment between them.
//! The judge passes at the first sample at which the trajectory so far fulfills the goal, and fails
//! at the first touched beacon, left arena, or mistake that nothing later can mend. The time limit
//! is the caller's.

mod geometry;
mod glance;

use crate::layout::{Assignment, Beacon, Goal, Layout, RouteGoal};
use appell_model::scalar::{Mask, Scalar};
use serde::{Deserialize, Serialize};

pub(crate) use geometry::{
    Crossing, Line, between, difference, distance, dot, segment_distance, wall_distance,
};
use geometry::{leave_fraction, lift, touch_fraction, turn, value, within};
pub(crate) use glance::{Glance, Rings, Watch};

/// Where a task stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// Not decided yet.
    Running,
    /// The goal is reached; final.
    Passed,
    /// The goal cannot be reached any more; final.
    Failed,
}

/// Something worth telling that happened on the way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskEvent {
    /// Time, s.
    pub t: f64,
    /// Position of the axle midpoint, world frame, m.
    pub position: [f64; 2],
    /// What happened, such as `b1 passed on its left, 0.486 m`.
    pub text: String,
}

/// Where a robot is seen: time, s, and axle midpoint, world frame, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sample<S> {
    pub t: S,
    pub position: [S; 2],
}

impl<S: Scalar> Sample<S> {
    /// That of one lane.
    pub fn single(self, lane: usize) -> Sample<S::Single> {
        let [x, y] = self.position;
        Sample {
            t: self.t.single(lane),
            position: [x.single(lane), y.single(lane)],
        }
    }

    fn towards(self, next: Sample<S>, fraction: S) -> Sample<S> {
        let t = self.t + fraction * (next.t - self.t);
        Sample {
            t,
            position: between(self.position, next.position, fraction),
        }
    }
}

/// A goal with what has been achieved of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Task<S> {
    Free,
    Homing {
        beacon: usize,
        distance: f64,
        speed: f64,
        hold: f64,
        /// Begin of the present stop.
        stop: Option<Sample<S>>,
    },
    Gate {
        /// The chord; offsets on it run from b₁ to b₂ in negative direction.
        line: Line,
        length: f64,
        /// Smallest distances at which b₁ and b₂ are passed.
        reach: [f64; 2],
        direction: i8,
        exit: f64,
        /// Valid crossing: whether forward, distance from b₁.
        crossing: Option<(bool, S)>,
    },
    Eight {
        pair: [usize; 2],
        laps: u32,
        close: f64,
        /// Angle turned round each beacon, without the closing segment.
        turned: [S; 2],
        /// Windings of the closed polygon.
        windings: [f64; 2],
        laps_done: u32,
        gap: S,
    },
    Slalom {
        chain: Vec<usize>,
        lines: Vec<Line>,
        offset_max: f64,
        /// Side of the first passage, 0 while open.
        first_side: i8,
        offsets: Vec<S>,
    },
    Route {
        points: Vec<[f64; 2]>,
        /// Distance of neighboring points, m.
        ds: f64,
        tolerance: f64,
        end: f64,
        /// Way along the path, m.
        progress: S,
        /// Largest distance from the path so far, and its time.
        farthest: (S, S),
    },
}

fn side_name(left: bool) -> &'static str {
    if left { "left" } else { "right" }
}

fn place(p: [f64; 2]) -> String {
    format!("({:.3}, {:.3}) m", p[0], p[1])
}

/// The lines normal to the local directions of a slalom chain, through its beacons.
pub(crate) fn slalom_lines(layout: &Layout, chain: &[usize]) -> Vec<Line> {
    let center = |k: usize| layout.beacons[chain[k]].position;
    let last = chain.len() - 1;
    let line = |k: usize| {
        Line::across(
            center(k),
            center(k.saturating_sub(1)),
            center((k + 1).min(last)),
        )
    };
    (0..chain.len()).map(line).collect()
}

/// The line through a gate, forward in direction +1, and the distance of its beacons, m.
///
/// Distances from b₁ towards b₂ are the negative offsets on this line.
pub(crate) fn gate_line(layout: &Layout, pair: [usize; 2]) -> (Line, f64) {
    let [a, b] = pair.map(|i| layout.beacons[i].position);
    let chord = Line::across(a, a, b).normal;
    (
        Line {
            origin: a,
            normal: [-chord[1], chord[0]],
        },
        distance(a, b),
    )
}

impl<S: Scalar> Task<S> {
    fn new(layout: &Layout, goal: Option<&Goal>) -> Self {
        let Some(goal) = goal else { return Task::Free };
        match *goal {
            Goal::Homing {
                beacon,
                distance,
                speed,
                hold,
            } => Task::Homing {
                beacon,
                distance,
                speed,
                hold,
                stop: None,
            },
            Goal::Gate {
                pair,
                direction,
                exit,
            } => {
                let (line, length) = gate_line(layout, pair);
                let reach = pair.map(|i| layout.collision_radius + layout.beacons[i].radius);
                Task::Gate {
                    line,
                    length,
                    reach,
                    direction,
                    exit,
                    crossing: None,
                }
            }
            Goal::Eight { pair, laps, close } => {
                let (turned, windings) = ([S::zero(); 2], [0.0; 2]);
                Task::Eight {
                    pair,
                    laps,
                    close,
                    turned,
                    windings,
                    laps_done: 0,
                    gap: S::zero(),
                }
            }
            Goal::Slalom {
                ref chain,
                first_side,
                offset_max,
            } => Task::Slalom {
                chain: chain.clone(),
                lines: slalom_lines(layout, chain),
                offset_max,
                first_side,
                offsets: Vec::with_capacity(chain.len()),
            },
        }
    }

    fn route(goal: &RouteGoal) -> Self {
        Task::Route {
            points: goal.path.points.clone(),
            ds: goal.path.ds,
            tolerance: goal.tolerance,
            end: goal.end,
            progress: S::zero(),
            farthest: (S::zero(), S::zero()),
        }
    }
}

/// How much nearer than it is a robot is taken to be to where its task goes on, m: more than rounding
/// makes of its ways in single precision.
const MARGIN: f64 = 1e-3;

/// Incremental judge of one attempt; its whole state can be cloned, saved and restored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judge<S = f64> {
    arena: [f64; 2],
    beacons: Vec<Beacon>,
    collision_radius: f64,
    task: Task<S>,
    first: Option<Sample<S>>,
    /// What is watched whatever the task is; in a world its lanes are what is true.
    pub(crate) watch: Watch<S>,
    verdict: Verdict,
    /// Where the robot was when the verdict fell; on contact before it.
    decided: Option<[S; 2]>,
    reason: String,
    events: Vec<TaskEvent>,
}

impl<S: Scalar> Judge<S> {
    /// A judge before the first sample; without a goal it only watches for contact.
    ///
    /// # Panics
    /// If the goal refers to beacons that do not exist; see [`Goal::fault`].
    pub fn new(layout: &Layout, goal: Option<&Goal>) -> Self {
        Self::watching(layout, Task::new(layout, goal))
    }

    /// A judge of what a robot has to do.
    ///
    /// # Panics
    /// As [`Judge::new`].
    pub fn of(layout: &Layout, assignment: &Assignment) -> Self {
        match assignment {
            Assignment::Beacons(goal) => Self::new(layout, Some(goal)),
            Assignment::Route(goal) => Self::watching(layout, Task::route(goal)),
        }
    }

    fn watching(layout: &Layout, task: Task<S>) -> Self {
        Self {
            arena: layout.arena,
            beacons: layout.beacons.clone(),
            collision_radius: layout.collision_radius,
            task,
            first: None,
            watch: Watch::new(),
            verdict: Verdict::Running,
            decided: None,
            reason: String::new(),
            events: Vec::new(),
        }
    }

    /// Takes the next sample: time, s; axle midpoint, world frame, m; forward speed, m/s.
    ///
    /// Times must increase. After the verdict is final samples are ignored. Allocates only when
    /// something happens.
    pub fn observe(&mut self, t: S, position: [S; 2], speed: S) -> Verdict {
        if self.verdict != Verdict::Running {
            return self.verdict;
        }
        let every = S::Mask::splat(true);
        if self.first.is_none() {
            self.watch.begin(position, every);
        }
        let previous = self.watch.last;
        let arena = lift(self.arena);
        let radius = S::from(self.collision_radius);
        let mut glance = Glance::of_walls(arena, radius, previous.position, position);
        for (index, beacon) in self.beacons.iter().enumerate() {
            let center = lift(beacon.position);
            glance.pass(index, center, [radius, S::from(beacon.radius)]);
        }
        if self.watch.pass(t, speed, &glance, every).any() {
            self.decide(previous, t, speed, &glance);
        }
        self.verdict
    }

    /// Decides on a sample that its [`Watch`] has seen, and that may be of importance.
    pub(crate) fn decide(&mut self, previous: Sample<S>, t: S, speed: S, glance: &Glance<S>) {
        let position = glance.to;
        let now = Sample { t, position };
        let mut seen = now;
        if ![t, position[0], position[1], speed]
            .iter()
            .all(|z| value(*z).is_finite())
        {
            seen = previous;
            self.fail(previous, "motion is not finite".into());
        } else {
            let first = *self.first.get_or_insert(now);
            if value(glance.gap) < 0.0 || value(glance.wall) < 0.0 {
                seen = previous;
                self.touch(previous, now, value(glance.wall) < 0.0);
            }
            if self.verdict == Verdict::Running {
                seen = now;
                self.advance(first, previous, now, speed);
            }
        }
        if self.verdict == Verdict::Running {
            self.watch.calm = S::from(self.calm(position) - MARGIN);
        } else {
            self.decided = Some(seen.position);
        }
    }

    /// How far the robot can go from here before anything can become of its task, m.
    fn calm(&self, here: [S; 2]) -> f64 {
        match &self.task {
            Task::Homing {
                beacon,
                distance: reach,
                stop: None,
                ..
            } => value(distance(here, lift(self.beacons[*beacon].position))) - reach,
            Task::Gate {
                line,
                crossing: None,
                ..
            } => value(line.distance(here)).abs(),
            Task::Slalom { lines, offsets, .. } => match lines.get(offsets.len()) {
                Some(next) => value(next.distance(here)).abs(),
                None => S::LARGEST,
            },
            Task::Free => S::LARGEST,
            // Held in time, or summed up along the way.
            Task::Homing { .. } | Task::Gate { .. } | Task::Eight { .. } | Task::Route { .. } => {
                0.0
            }
        }
    }

    /// Where the robot was seen last, or when the verdict fell.
    fn here(&self) -> [S; 2] {
        self.decided.unwrap_or(self.watch.last.position)
    }

    /// Fails at what is touched first: a beacon, or where the robot leaves the arena, a wall.
    #[cold]
    fn touch(&mut self, previous: Sample<S>, now: Sample<S>, leaves: bool) {
        let (p, q) = (previous.position, now.position);
        let mut contact: Option<(S, Option<usize>)> = None;
        let mut consider = |fraction: S, what: Option<usize>| {
            if contact.is_none_or(|(earliest, _)| value(fraction) < value(earliest)) {
                contact = Some((fraction, what));
            }
        };
        for (index, beacon) in self.beacons.iter().enumerate() {
            let center = lift(beacon.position);
            let near = segment_distance(center, p, q);
            let gap = near - S::from(self.collision_radius) - S::from(beacon.radius);
            if value(gap) < 0.0 {
                let radius = self.collision_radius + beacon.radius;
                consider(touch_fraction(center, radius, p, q), Some(index));
            }
        }
        if leaves {
            let fraction = leave_fraction(self.arena, self.collision_radius, p, q);
            consider(fraction, None);
        }
        if let Some((fraction, beacon)) = contact {
            let text = match beacon {
                Some(index) => format!("touched {}", self.beacons[index].name),
                None => "left the arena".into(),
            };
            self.fail(previous.towards(now, fraction), text);
        }
    }

    /// Follows the task over one segment without contact.
    fn advance(&mut self, first: Sample<S>, previous: Sample<S>, now: Sample<S>, speed: S) {
        match self.task {
            Task::Free => {}
            Task::Homing { .. } => self.advance_homing(first, now, speed),
            Task::Gate { .. } => self.advance_gate(previous, now),
            Task::Eight { .. } => self.advance_eight(first, previous, now),
            Task::Slalom { .. } => self.advance_slalom(previous, now),
            Task::Route { .. } => self.advance_route(previous, now),
        }
    }

    fn advance_homing(&mut self, first: Sample<S>, now: Sample<S>, speed_now: S) {
        let Task::Homing {
            beacon,
            distance: reach,
            speed,
            hold,
            ref mut stop,
        } = self.task
        else {
            return;
        };
        let away = distance(now.position, lift(self.beacons[beacon].position));
        if value(away) > reach || value(speed_now).abs() > speed {
            *stop = None;
            return;
        }
        let begin = *stop.get_or_insert(now);
        // The tolerance on time is the scorer's.
        if value(now.t) > value(first.t) && value(now.t) - value(begin.t) >= hold - 1e-9 {
            let name = &self.beacons[beacon].name;
            let text = format!("stopped at {name}, {:.3} m from its center", value(away));
            let stay = format!("{text}, and stayed for {hold} s");
            self.pass(begin, text, stay);
        }
    }

    fn advance_gate(&mut self, previous: Sample<S>, now: Sample<S>) {
        let Task::Gate {
            line,
            length,
            reach,
            direction,
            crossing,
            ..
        } = &mut self.task
        else {
            return;
        };
        if let Some(new) = line.crossing(previous.position, now.position) {
            let place = -new.offset;
            let along = value(place);
            let valid = reach[0] <= along && along <= *length - reach[1];
            let at = previous.towards(now, new.fraction);
            if valid && crossing.is_some() {
                return self.fail(at, "crossed the gate a second time".into());
            }
            if valid {
                *crossing = Some((new.forward, place));
                if *direction != 0 && new.forward != (*direction > 0) {
                    return self.fail(at, "crossed the gate in the wrong direction".into());
                }
                let text = format!(
                    "gate crossed, {:.3} m off its middle",
                    (along - *length / 2.0).abs()
                );
                self.tell(at, text);
            }
        }
        self.leave_gate(now);
    }

    /// Passes once the robot is clear of the gate that it crossed.
    fn leave_gate(&mut self, now: Sample<S>) {
        let Task::Gate {
            line,
            length,
            exit,
            crossing: Some((forward, place)),
            ..
        } = &self.task
        else {
            return;
        };
        let beyond = value(line.distance(now.position));
        let side = if *forward { beyond } else { -beyond };
        if side >= *exit {
            let error = (value(*place) - *length / 2.0).abs();
            let text = format!("clear of the gate by {side:.3} m");
            let reason = format!(
                "crossed the gate {error:.3} m off its middle and drove {side:.3} m beyond"
            );
            self.pass(now, text, reason);
        }
    }

    fn advance_eight(&mut self, first: Sample<S>, previous: Sample<S>, now: Sample<S>) {
        let Task::Eight {
            pair,
            laps,
            close,
            ref mut turned,
            ref mut windings,
            ref mut laps_done,
            gap: ref mut opening,
        } = self.task
        else {
            return;
        };
        let mut clear = true;
        for (k, index) in pair.into_iter().enumerate() {
            let beacon = &self.beacons[index];
            let center = lift(beacon.position);
            let closing = turn(center, now.position, first.position);
            turned[k] += turn(center, previous.position, now.position);
            windings[k] = (value(turned[k] + closing) / std::f64::consts::TAU).round();
            clear &= value(segment_distance(center, now.position, first.position))
                >= self.collision_radius + beacon.radius;
        }
        *opening = distance(now.position, first.position);
        let gap = value(*opening);
        let opposite = windings[0] == -windings[1];
        if opposite && windings[0].abs() == f64::from(laps) && gap <= close && clear {
            let text = format!("lap {laps} closed, gap {gap:.3} m");
            let reason = match laps {
                1 => format!("drove the figure eight and closed it to {gap:.3} m"),
                _ => format!("drove {laps} figure eights and closed them to {gap:.3} m"),
            };
            return self.pass(now, text, reason);
        }
        let next = *laps_done + 1;
        if opposite && next < laps && windings[0].abs() == f64::from(next) {
            *laps_done = next;
            self.tell(now, format!("lap {next} closed"));
        }
    }

    fn advance_slalom(&mut self, previous: Sample<S>, now: Sample<S>) {
        // One segment may cross several lines; their order along it counts.
        let mut after = -1.0;
        loop {
            let Task::Slalom {
                chain,
                lines,
                offset_max,
                first_side,
                offsets,
            } = &mut self.task
            else {
                return;
            };
            let Some(&index) = chain.get(offsets.len()) else {
                return;
            };
            let beacon = &self.beacons[index];
            let reach = self.collision_radius + beacon.radius;
            let counts = |z: &Crossing<S>| {
                let away = value(z.offset).abs();
                z.forward && value(z.fraction) > after && reach <= away && away <= *offset_max
            };
            let crossing = lines[offsets.len()].crossing(previous.position, now.position);
            let Some(crossing) = crossing.filter(counts) else {
                return;
            };
            let left = value(crossing.offset) > 0.0;
            if *first_side == 0 {
                *first_side = if left { 1 } else { -1 };
            }
            let at = previous.towards(now, crossing.fraction);
            let (name, side) = (&beacon.name, side_name(left));
            let wanted_left = (*first_side > 0) == offsets.len().is_multiple_of(2);
            if left != wanted_left {
                let wanted = side_name(wanted_left);
                let text = format!("passed {name} on its {side}, had to pass on its {wanted}");
                return self.fail(at, text);
            }
            offsets.push(crossing.offset);
            after = value(crossing.fraction);
            let away = value(crossing.offset).abs();
            let text = format!("{name} passed on its {side}, {away:.3} m");
            if offsets.len() == chain.len() {
                let reason = format!("passed all {} beacons on alternating sides", chain.len());
                return self.pass(at, text, reason);
            }
            self.tell(at, text);
        }
    }

    fn advance_route(&mut self, previous: Sample<S>, now: Sample<S>) {
        let Task::Route {
            ref points,
            ds,
            tolerance,
            end,
            ref mut progress,
            ref mut farthest,
        } = self.task
        else {
            return;
        };
        // The nearest point of the stretch that the robot can have reached: a path that crosses
        // itself has others.
        let begun = value(*progress);
        let reach = begun + 3.0 * (value(distance(previous.position, now.position)) + ds);
        let last = points.len() - 1;
        let mut nearest = S::from(f64::INFINITY);
        for k in ((begun / ds) as usize).min(last - 1)..last {
            let from = k as f64 * ds;
            if from > reach {
                break;
            }
            let (p, q) = (lift(points[k]), lift(points[k + 1]));
            let along = difference(q, p);
            let share = within(dot(difference(now.position, p), along) / dot(along, along));
            let away = distance(now.position, between(p, q, share));
            if value(away) < value(nearest) {
                nearest = away;
                *progress = progress.max(S::from(from) + share * S::from(ds));
            }
        }
        let (here, finish) = (value(*progress), lift(points[last]));
        let to_end = value(distance(now.position, finish));
        let whole = last as f64 * ds;
        if value(nearest) > value(farthest.0) {
            *farthest = (nearest, now.t);
        }
        let nearest = value(nearest);
        if nearest > tolerance {
            let text = format!("left the route by {nearest:.3} m after {here:.3} m of it");
            return self.fail(now, text);
        }
        if whole - here <= end && to_end <= end {
            let most = value(farthest.0);
            let text = format!("end of the route, {to_end:.3} m from its last point");
            let reason =
                format!("followed the route of {whole:.3} m, at most {most:.3} m beside it");
            self.pass(now, text, reason);
        }
    }

    fn tell(&mut self, at: Sample<S>, text: String) {
        self.events.push(TaskEvent {
            t: value(at.t),
            position: at.position.map(value),
            text,
        });
    }

    fn fail(&mut self, at: Sample<S>, text: String) {
        self.verdict = Verdict::Failed;
        let (t, position) = (value(at.t), at.position.map(value));
        self.reason = format!("{text} at t = {t:.3} s, at {}", place(position));
        self.tell(at, text);
    }

    fn pass(&mut self, at: Sample<S>, text: String, reason: String) {
        self.verdict = Verdict::Passed;
        self.reason = format!("{reason}, at t = {:.3} s", value(at.t));
        self.tell(at, text);
    }

    /// Distance to a beacon, m.
    fn away(&self, beacon: usize) -> S {
        distance(self.here(), lift(self.beacons[beacon].position))
    }

    /// The verdict so far.
    pub fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// Why the task passed or failed, or what is missing while it runs; one sentence.
    pub fn reason(&self) -> String {
        match self.verdict {
            Verdict::Running => self.timeout_reason(),
            Verdict::Passed | Verdict::Failed => self.reason.clone(),
        }
    }

    /// Whether there are events to be handed over.
    pub(crate) fn has_events(&self) -> bool {
        !self.events.is_empty()
    }

    /// Hands over the events since the last call, oldest first.
    pub fn take_events(&mut self) -> Vec<TaskEvent> {
        std::mem::take(&mut self.events)
    }

    /// What is still missing, to be told when time is over; one sentence.
    pub fn timeout_reason(&self) -> String {
        match &self.task {
            Task::Free => "no goal was set".into(),
            Task::Homing {
                beacon,
                distance,
                speed,
                hold,
                stop,
            } => {
                let name = &self.beacons[*beacon].name;
                let away = value(self.away(*beacon));
                match stop {
                    Some(begin) => format!(
                        "stopped at {name} at t = {:.3} s, but had to stay for {hold} s",
                        value(begin.t)
                    ),
                    None if away <= *distance => {
                        format!("came to {name}, but did not slow down to {speed} m/s")
                    }
                    None => {
                        format!("ended {away:.3} m from {name}, had to stop within {distance} m")
                    }
                }
            }
            Task::Gate {
                line,
                crossing,
                exit,
                ..
            } => match crossing {
                Some((forward, _)) => {
                    let beyond = value(line.distance(self.here()));
                    let side = if *forward { beyond } else { -beyond };
                    format!("crossed the gate, but was {side:.3} m beyond it, had to be {exit} m")
                }
                None => "the gate was not crossed".into(),
            },
            Task::Eight {
                laps,
                windings,
                close,
                gap,
                ..
            } => {
                let [a, b] = windings;
                if a == &-b && a.abs() == f64::from(*laps) {
                    format!(
                        "drove round both beacons, but ended {:.3} m from the start, had to be within {close} m and without a beacon between",
                        value(*gap)
                    )
                } else {
                    format!(
                        "drove {a} and {b} times round the beacons, had to be {laps} times in opposite directions"
                    )
                }
            }
            Task::Slalom { chain, offsets, .. } => match chain.get(offsets.len()) {
                Some(&next) => format!(
                    "passed {} of {} beacons, {} was not passed",
                    offsets.len(),
                    chain.len(),
                    self.beacons[next].name
                ),
                None => "all beacons were passed".into(),
            },
            Task::Route {
                points,
                ds,
                progress,
                ..
            } => {
                let whole = (points.len() - 1) as f64 * ds;
                let here = value(*progress);
                format!("had followed {here:.3} m of the route's {whole:.3} m")
            }
        }
    }

    /// What was measured: name, value, unit (empty for a number without one).
    ///
    /// Clearances are between the robot's disc and what it must not touch. The slalom has one
    /// `offset` for each passage, in order, positive to the left.
    pub fn metrics(&self) -> Vec<(&'static str, S, &'static str)> {
        let mut metrics = Vec::new();
        if self.first.is_some() {
            let watch = &self.watch;
            if !self.beacons.is_empty() {
                metrics.push(("beacon clearance", watch.gap, "m"));
                metrics.push(("beacon clearance time", watch.gap_time, "s"));
                metrics.push(("beacon clearance index", watch.beacon, ""));
            }
            metrics.push(("wall clearance", watch.wall, "m"));
            metrics.push(("wall clearance time", watch.wall_time, "s"));
        }
        metrics.push(("path length", self.watch.way, "m"));
        match &self.task {
            Task::Free => {}
            Task::Homing { beacon, stop, .. } => {
                if let Some(begin) = stop {
                    metrics.push(("settle time", begin.t, "s"));
                }
                metrics.push(("distance to beacon", self.away(*beacon), "m"));
            }
            Task::Gate {
                line,
                length,
                crossing,
                ..
            } => {
                if let Some((_, along)) = crossing {
                    let error = (*along - S::from(length / 2.0)).abs();
                    metrics.push(("center error", error, "m"));
                }
                metrics.push(("distance from gate", line.distance(self.here()), "m"));
            }
            Task::Eight { windings, gap, .. } => {
                metrics.push(("first winding", S::from(windings[0]), ""));
                metrics.push(("second winding", S::from(windings[1]), ""));
                metrics.push(("closing gap", *gap, "m"));
            }
            Task::Slalom { offsets, .. } => {
                metrics.push(("beacons passed", S::from(offsets.len() as f64), ""));
                metrics.extend(offsets.iter().map(|offset| ("offset", *offset, "m")));
            }
            Task::Route {
                progress, farthest, ..
            } => {
                metrics.push(("route followed", *progress, "m"));
                metrics.push(("largest distance from route", farthest.0, "m"));
                metrics.push(("largest distance from route time", farthest.1, "s"));
            }
        }
        metrics
    }
}

#[cfg(test)]
mod tests;
