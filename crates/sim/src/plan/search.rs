//! The search: candidates at several margins, smoothed, driven past the judge, and the best kept.

use super::*;

/// How much room to keep in a search.
#[derive(Clone, Copy, Debug)]
struct Room {
    /// Distance to keep from beacons where there is room, m.
    margin: f64,
    /// Whether to keep less in narrow gaps rather than to shun them.
    squeeze: bool,
}

/// A gate in the direction of its passage.
#[derive(Clone)]
struct Passage {
    line: Line,
    /// Where the chord is on the line.
    offsets: Range<f64>,
    /// Whether the passage is along the normal of the line.
    forward: bool,
    middle: [f64; 2],
    /// Unit vector of the passage.
    normal: [f64; 2],
    exit: f64,
}

impl Passage {
    fn new(layout: &Layout, pair: [usize; 2], forward: bool, exit: f64) -> Self {
        let (line, length) = gate_line(layout, pair);
        let sign = if forward { 1.0 } else { -1.0 };
        let normal = line.normal.map(|z| z * sign);
        let middle = ahead(line.origin, left_of(line.normal), -length / 2.0);
        Self {
            line,
            offsets: -length..0.0,
            forward,
            middle,
            normal,
            exit,
        }
    }

    /// Points that are clear of the gate, on the exit side.
    fn beyond(&self) -> Vec<Circle> {
        let at = |k: i32, extra: f64| {
            let aside = ahead(self.middle, left_of(self.normal), f64::from(k) * 0.3);
            Circle::point(ahead(aside, self.normal, self.exit + extra), true, false)
        };
        let row = |extra: f64| (-6..=6).map(move |k| at(k, extra));
        row(0.15).chain(row(0.06)).collect()
    }
}

/// The straight part of a passage.
struct Entry {
    /// Unit vector of travel.
    axis: [f64; 2],
    /// Length before the middle of the gate, or less if that is not free, m.
    before: f64,
    /// Radius of the arc that leads to it, 0 for a corner, m.
    radius: f64,
}

/// A path that passes the judge.
struct Candidate {
    path: Path,
    /// Nominal duration, s, raised where clearance or reserve lacks.
    cost: f64,
    /// Smallest clearance away from the start, m.
    clearance: f64,
    /// Whether it passes with something in reserve.
    strict: bool,
}

/// One task of planning.
pub(super) struct Planner<'a> {
    pub(super) layout: &'a Layout,
    pub(super) goal: &'a Goal,
    pub(super) start: [f64; 2],
}

/// A string for a goal, or the stage at which the search got stuck.
type Strings = Vec<Result<Vec<[f64; 2]>, usize>>;

impl<'a> Planner<'a> {
    /// Distance between axle midpoint and beacon at contact, m.
    fn reach(&self, beacon: usize) -> f64 {
        self.layout.collision_radius + self.layout.beacons[beacon].radius
    }

    fn center(&self, beacon: usize) -> [f64; 2] {
        self.layout.beacons[beacon].position
    }

    /// What the robot has to spare between two beacons, m.
    fn spare(&self, i: usize, j: usize) -> f64 {
        distance(self.center(i), self.center(j)) - self.reach(i) - self.reach(j)
    }

    /// Pairs of beacons between which the goal leads.
    fn gaps(&self) -> Vec<[usize; 2]> {
        match self.goal {
            Goal::Homing { .. } => vec![],
            Goal::Gate { pair, .. } | Goal::Eight { pair, .. } => vec![*pair],
            Goal::Slalom { chain, .. } => chain.windows(2).map(|w| [w[0], w[1]]).collect(),
        }
    }

    /// How much of what a gap of the goal spares may be margin of one of its beacons.
    fn share(&self) -> f64 {
        match self.goal {
            Goal::Gate { .. } => 0.499,
            Goal::Homing { .. } | Goal::Eight { .. } => 0.42,
            Goal::Slalom { .. } => 0.36,
        }
    }

    fn space(&self, room: Room) -> Space {
        let [width, height] = self.layout.arena;
        let inset = self.layout.collision_radius;
        let wall = (0.4 * room.margin).min(0.08);
        let from_start = |d: f64| inset + wall.min((d - inset - 1e-6).max(0.0));
        let [x, y] = self.start;
        Space {
            low: [from_start(x), from_start(y)],
            high: [
                width - from_start(width - x),
                height - from_start(height - y),
            ],
            circles: (0..self.layout.beacons.len())
                .map(|i| Circle::beacon(self.center(i), self.reach(i) + self.margin(i, room, wall)))
                .collect(),
        }
    }

    /// Margin round one beacon: what is asked for, or less where start, goal or gaps need it.
    fn margin(&self, beacon: usize, room: Room, wall: f64) -> f64 {
        let mut margin = room
            .margin
            .min(distance(self.start, self.center(beacon)) - self.reach(beacon) - 1e-6);
        for pair in self.gaps().iter().filter(|pair| pair.contains(&beacon)) {
            margin = margin.min(self.share() * self.spare(pair[0], pair[1]));
        }
        match *self.goal {
            Goal::Homing {
                beacon: home,
                distance: radius,
                ..
            } if home == beacon => {
                margin = margin.min(0.4 * (radius - self.reach(home)));
            }
            Goal::Slalom {
                ref chain,
                offset_max,
                ..
            } if chain.contains(&beacon) => {
                margin = margin.min(0.4 * (offset_max - self.reach(beacon)));
            }
            Goal::Homing { .. } | Goal::Gate { .. } | Goal::Eight { .. } | Goal::Slalom { .. } => {}
        }
        if room.squeeze {
            let between_beacons = (0..self.layout.beacons.len())
                .filter(|&other| other != beacon)
                .map(|other| 0.49 * self.spare(beacon, other));
            let [x, y] = self.center(beacon);
            let [width, height] = self.layout.arena;
            let to_wall =
                |d: f64| d - self.reach(beacon) - self.layout.collision_radius - wall - 0.005;
            let gaps = between_beacons.chain([x, y, width - x, height - y].map(to_wall));
            margin = gaps.filter(|gap| *gap > 0.0).fold(margin, f64::min);
        }
        margin.max(0.0)
    }

    /// Everything a string from `from` to any of the points or guides `to` may lie against.
    fn network(&self, room: Room, from: [f64; 2], to: Vec<Circle>, via: Vec<Circle>) -> Network {
        let mut space = self.space(room);
        let free = |circle: &Circle| circle.anchor.is_some_and(|at| space.clear_of_all(at, at));
        let to: Vec<Circle> = to.into_iter().filter(free).collect();
        let via: Vec<Circle> = via.into_iter().filter(free).collect();
        space.circles.extend(via);
        let start = space.circles.len();
        space.circles.push(Circle::point(from, false, true));
        space.circles.extend(to);
        let targets = (start + 1..space.circles.len()).collect();
        Network {
            graph: Graph::new(&space),
            start,
            targets,
        }
    }

    fn string(
        &self,
        room: Room,
        rule: &Rule,
        from: [f64; 2],
        to: Vec<Circle>,
    ) -> Result<Vec<[f64; 2]>, usize> {
        self.network(room, from, to, vec![]).shortest(rule)
    }

    fn strings(&self, room: Room, fallback: bool) -> Strings {
        match *self.goal {
            Goal::Homing {
                beacon, distance, ..
            } => vec![self.homing(room, beacon, distance)],
            Goal::Gate {
                pair,
                direction,
                exit,
            } => {
                let directions: &[bool] = match direction {
                    0 => &[true, false],
                    d if d > 0 => &[true],
                    _ => &[false],
                };
                let each = |&forward| {
                    self.gate(
                        room,
                        &Passage::new(self.layout, pair, forward, exit),
                        fallback,
                    )
                };
                directions.iter().flat_map(each).collect()
            }
            Goal::Eight { pair, laps, .. } => self.eight(room, pair, laps),
            Goal::Slalom {
                ref chain,
                first_side,
                offset_max,
            } => {
                let sides: &[bool] = match first_side {
                    0 => &[true, false],
                    side if side > 0 => &[true],
                    _ => &[false],
                };
                let each = |&left_first: &bool| {
                    let lines = slalom_lines(self.layout, chain);
                    let reach = chain.iter().map(|&i| self.reach(i)).collect();
                    let task = Rule::Slalom {
                        lines,
                        reach,
                        offset_max,
                        left_first,
                    };
                    self.slalom(room, &task, fallback)
                };
                sides.iter().map(each).collect()
            }
        }
    }

    /// To the middle of the ring between contact and the goal distance.
    fn homing(&self, room: Room, beacon: usize, radius: f64) -> Result<Vec<[f64; 2]>, usize> {
        let ring = (self.reach(beacon) + radius) / 2.0;
        let ring = ring.min(self.reach(beacon) + 0.4);
        let at = |k: usize| {
            let (sin, cos) = sin_cos(TAU * k as f64 / 36.0);
            ahead(self.center(beacon), [cos, sin], ring)
        };
        let towards = difference(self.start, self.center(beacon));
        let direct = ahead(
            self.center(beacon),
            towards,
            ring / dot(towards, towards).sqrt(),
        );
        let to = (0..36)
            .map(at)
            .chain([direct])
            .map(|p| Circle::point(p, true, false))
            .collect();
        self.string(room, &Rule::Free, self.start, to)
    }

    /// Straight through the middle if possible, tilted or anyhow as a fallback.
    fn gate(&self, room: Room, passage: &Passage, fallback: bool) -> Strings {
        if !fallback {
            // A late entry suits a start close before the gate.
            let entries = [
                (0.5, 0.8),
                (0.25, 0.8),
                (0.0, 0.8),
                (0.0, 0.35),
                (0.0, 0.15),
            ];
            let each = |(radius, before)| {
                let entry = Entry {
                    axis: passage.normal,
                    before,
                    radius,
                };
                self.gate_straight(room, passage, &entry)
            };
            return entries.map(each).into();
        }
        let tilted = [0.35, -0.35, 0.7, -0.7].map(|angle| {
            let (sin, cos) = sin_cos(angle);
            let (normal, left) = (passage.normal, left_of(passage.normal));
            let axis = [0, 1].map(|i| cos * normal[i] + sin * left[i]);
            self.gate_straight(
                room,
                passage,
                &Entry {
                    axis,
                    before: 0.8,
                    radius: 0.0,
                },
            )
        });
        let Passage { line, offsets, .. } = passage.clone();
        let through = Rule::Through {
            line,
            offsets,
            forward: passage.forward,
        };
        let anyhow = self.string(room, &through, self.start, passage.beyond());
        tilted.into_iter().chain([anyhow]).collect()
    }

    /// Straight through the middle of the gate.
    fn gate_straight(
        &self,
        room: Room,
        passage: &Passage,
        entry: &Entry,
    ) -> Result<Vec<[f64; 2]>, usize> {
        let Entry {
            axis,
            before,
            radius,
        } = *entry;
        let space = self.space(room);
        let slant = dot(axis, passage.normal);
        let on_axis = |x: f64| ahead(passage.middle, axis, x);
        let clear = |x: &f64| space.clear_of_all(passage.middle, on_axis(*x));
        let whole = [0.3, 0.15, 0.06].map(|extra| (passage.exit + extra) / slant);
        let whole = whole.into_iter().find(clear);
        let out = whole
            .or_else(|| [0.6, 0.4, 0.25, 0.1, 0.0].into_iter().find(clear))
            .ok_or(0_usize)?;
        let before = [1.0, 0.65, 0.4, 0.2, 0.02].map(|share| -before * share);
        let before = before.into_iter().find(clear).ok_or(0_usize)?;
        let (entry, leave) = (on_axis(before), on_axis(out));
        let Passage { line, offsets, .. } = passage.clone();
        let shut = Rule::Shut { line, offsets };
        let to = if radius > 0.0 {
            [true, false]
                .map(|left| Circle::guide(entry, axis, radius, left))
                .into()
        } else {
            vec![Circle::point(entry, true, false)]
        };
        let mut points = self.string(room, &shut, self.start, to)?;
        points.push(leave);
        if whole.is_none() {
            points.extend(self.string(room, &shut, leave, passage.beyond())?);
        }
        Ok(points)
    }

    /// All eights from the start: round either beacon first, in either sense.
    fn eight(&self, room: Room, pair: [usize; 2], laps: u32) -> Strings {
        let (line, length) = gate_line(self.layout, pair);
        let below = line.distance(self.start) < 0.0;
        let end = Circle::point(self.start, true, false);
        let network = self.network(room, self.start, vec![end], vec![]);
        let each = |(flip, order): (bool, usize)| {
            // Parts: 0 beside the first beacon, 1 between, 2 beside the second.
            let cycle = [(0, flip), (1, !flip), (2, flip), (1, !flip)];
            let first = usize::from(below != flip) + order;
            let count = 4 * laps as usize;
            let word = (0..count).map(|k| cycle[(first + k) % 4]).collect();
            network.shortest(&Rule::Eight {
                line: line.clone(),
                length,
                word,
            })
        };
        [(false, 0), (false, 2), (true, 0), (true, 2)]
            .map(each)
            .into()
    }

    /// To a point beyond the last beacon; as a fallback also by way of points beside the beacons.
    fn slalom(&self, room: Room, task: &Rule, fallback: bool) -> Result<Vec<[f64; 2]>, usize> {
        let Rule::Slalom {
            lines,
            reach,
            offset_max,
            left_first,
        } = task
        else {
            return Err(0);
        };
        let last = lines.len() - 1;
        // A point beside beacon k, on the side of its passage, at a share of the allowed offsets.
        let beside = |k: usize, share: f64, along: f64| {
            let side = if *left_first == k.is_multiple_of(2) {
                1.0
            } else {
                -1.0
            };
            let aside = side * (reach[k] + share * (offset_max - reach[k]));
            let line = &lines[k];
            ahead(
                ahead(line.origin, left_of(line.normal), aside),
                line.normal,
                along,
            )
        };
        let space = self.space(room);
        let row =
            |along: f64| (0..12).map(move |k| beside(last, 0.04 + 0.08 * f64::from(k), along));
        let free = |p: &[f64; 2]| space.clear_of_all(*p, *p);
        let along = [0.35, 0.2, 0.1, 0.05]
            .into_iter()
            .find(|&along| row(along).any(|p| free(&p)));
        let to = row(along.unwrap_or(0.02))
            .map(|p| Circle::point(p, true, false))
            .collect();
        // Before and behind each line, to turn back in a dead end.
        let around = |k: usize| {
            let places = [-0.07, 0.07].map(|along| [0.06, 0.3, 0.8].map(|share| (share, along)));
            let point = move |(share, along)| Circle::point(beside(k, share, along), true, true);
            places.into_iter().flatten().map(point)
        };
        let via = if fallback {
            (0..=last).flat_map(around).collect()
        } else {
            vec![]
        };
        self.network(room, self.start, to, via).shortest(task)
    }

    // ------------------------------------------------------------------------------- selection

    /// The goal with something in reserve for tracking errors.
    fn stricter(&self) -> Goal {
        let mut goal = self.goal.clone();
        match &mut goal {
            Goal::Homing {
                beacon, distance, ..
            } => {
                *distance -= 0.03_f64.min(0.3 * (*distance - self.reach(*beacon)));
            }
            Goal::Gate { exit, .. } => *exit += 0.04,
            Goal::Eight { close, .. } => *close = close.min(0.1),
            Goal::Slalom { offset_max, .. } => *offset_max -= 0.02,
        }
        goal
    }

    pub(super) fn passes(&self, path: &Path, goal: &Goal) -> bool {
        let mut judge = Judge::new(self.layout, Some(goal));
        let mut verdict = Verdict::Running;
        for (k, p) in path.points.iter().enumerate() {
            verdict = judge.observe(k as f64, *p, 1.0 + NOMINAL.speed);
            if verdict != Verdict::Running {
                break;
            }
        }
        if let (Goal::Homing { hold, .. }, Some(&end)) = (goal, path.points.last()) {
            let t = path.points.len() as f64;
            judge.observe(t, end, 0.0);
            verdict = judge.observe(t + hold + 1.0, end, 0.0);
        }
        verdict == Verdict::Passed
    }

    /// Smallest distance to anything but the goal's home beacon, away from the start, m.
    pub(super) fn clearance(&self, path: &Path) -> f64 {
        let home = match self.goal {
            Goal::Homing { beacon, .. } => Some(*beacon),
            Goal::Gate { .. } | Goal::Eight { .. } | Goal::Slalom { .. } => None,
        };
        let gap = |p: [f64; 2]| {
            let beacons = (0..self.layout.beacons.len()).filter(|i| Some(*i) != home);
            let wall = wall_distance(self.layout.arena, p) - self.layout.collision_radius;
            beacons
                .map(|i| distance(p, self.center(i)) - self.reach(i))
                .fold(wall, f64::min)
        };
        let away = |p: &&[f64; 2]| distance(**p, self.start) > START_ZONE;
        path.points
            .iter()
            .filter(away)
            .map(|p| gap(*p))
            .fold(1.0, f64::min)
    }

    /// Whether the path passes, and passes with something in reserve.
    fn passes_strictly(&self, path: &Path) -> Option<bool> {
        let strict = self.passes(path, &self.stricter());
        // A narrower slalom ignores wide passages on the wrong side.
        let implied = strict && !matches!(self.goal, Goal::Slalom { .. });
        (implied || self.passes(path, self.goal)).then_some(strict)
    }

    /// The path as a candidate, if it passes and costs less than `most`.
    fn candidate(&self, path: Path, most: f64) -> Option<Candidate> {
        let turn = wrapped(path.heading[0] - self.layout.start[2]).abs() / NOMINAL.yaw_rate;
        let duration = path.duration(&NOMINAL) + turn;
        if duration >= most {
            return None;
        }
        let clearance = self.clearance(&path);
        let lack = (COMFORT - clearance).max(0.0) / COMFORT;
        if clearance < 0.0 || duration * (1.0 + 4.0 * lack) >= most {
            return None;
        }
        let strict = self.passes_strictly(&path)?;
        let cost = duration * (1.0 + 4.0 * lack + if strict { 0.0 } else { 1.0 });
        (cost < most).then_some(Candidate {
            path,
            cost,
            clearance,
            strict,
        })
    }

    /// The best candidate over all margins; smaller ones are tried until one keeps its margin.
    pub(super) fn search(&self) -> Result<Path, usize> {
        let mut best: Option<Candidate> = None;
        let mut stuck = 0;
        let widest = usize::from(!matches!(self.goal, Goal::Eight { .. }));
        for fallback in [false, true] {
            for &margin in &MARGINS[widest..] {
                for squeeze in [false, true] {
                    if squeeze && best.as_ref().is_some_and(|best| best.strict) {
                        continue;
                    }
                    for string in self.strings(Room { margin, squeeze }, fallback) {
                        match string {
                            Ok(string) => self.consider(&string, &mut best),
                            Err(stage) => stuck = stuck.max(stage),
                        }
                    }
                }
                let enough = (0.9 * margin).min(self.comfort());
                let late = margin < 0.1;
                if best
                    .as_ref()
                    .is_some_and(|best| (best.strict || late) && best.clearance >= enough)
                {
                    break;
                }
            }
            if best.is_some() {
                break;
            }
        }
        best.map(|best| best.path).ok_or(stuck)
    }

    /// The clearance at which to stop looking for more, or what the narrowest gap leaves, m.
    fn comfort(&self) -> f64 {
        let gaps = self.gaps();
        let spare = gaps
            .iter()
            .map(|pair| 0.9 * self.share() * self.spare(pair[0], pair[1]));
        spare.fold(COMFORT, f64::min)
    }

    /// Smooths a string in several ways and keeps the best.
    fn consider(&self, string: &[[f64; 2]], best: &mut Option<Candidate>) {
        for window in WINDOWS.into_iter().chain([WINDOW_LAST]) {
            if window == WINDOW_LAST && best.is_some() {
                break;
            }
            let most = best.as_ref().map_or(f64::INFINITY, |best| best.cost);
            let path = Path::smoothed(string, window);
            if let Some(better) = path.and_then(|path| self.candidate(path, most)) {
                *best = Some(better);
            }
        }
    }

    // ------------------------------------------------------------------------------- diagnosis

    fn name(&self, beacon: usize) -> &str {
        &self.layout.beacons[beacon].name
    }

    /// What makes the goal impossible from the outset, if anything.
    pub(super) fn obstacle(&self) -> Option<PlanError> {
        let error = |reason: String, hint: &str| {
            Some(PlanError {
                reason,
                hint: hint.into(),
            })
        };
        let radius = self.layout.collision_radius;
        let touching = |i: &usize| distance(self.start, self.center(*i)) < self.reach(*i);
        if let Some(i) = (0..self.layout.beacons.len()).find(touching) {
            let away = distance(self.start, self.center(i));
            let need = self.reach(i);
            let name = self.name(i);
            let reason =
                format!("the start is {away:.2} m from {name}, the robot needs {need:.2} m");
            return error(reason, "move the start or the beacon");
        }
        let wall = wall_distance(self.layout.arena, self.start);
        if wall < radius {
            let reason =
                format!("the start is {wall:.2} m from a wall, the robot needs {radius:.2} m");
            return error(reason, "move the start into the arena");
        }
        match *self.goal {
            Goal::Homing {
                beacon, distance, ..
            } if distance < self.reach(beacon) => {
                let (name, need) = (self.name(beacon), self.reach(beacon));
                let reason = format!(
                    "the goal distance {distance:.2} m to {name} is less than at contact, {need:.2} m"
                );
                return error(reason, "increase the goal distance");
            }
            Goal::Slalom {
                ref chain,
                offset_max,
                ..
            } => {
                if let Some(&i) = chain.iter().find(|&&i| offset_max < self.reach(i)) {
                    let (name, need) = (self.name(i), self.reach(i));
                    let reason = format!(
                        "the largest offset {offset_max:.2} m is less than at contact with {name}, {need:.2} m"
                    );
                    return error(reason, "increase the largest offset");
                }
            }
            Goal::Homing { .. } | Goal::Gate { .. } | Goal::Eight { .. } => {}
        }
        let gaps = self.gaps();
        let narrow = gaps
            .iter()
            .find(|pair| self.spare(pair[0], pair[1]) < 0.0)?;
        error(
            self.gap_text(*narrow),
            "move the beacons apart or use a smaller robot",
        )
    }

    fn gap_text(&self, [i, j]: [usize; 2]) -> String {
        self.gap_between(self.name(i), self.name(j), self.spare(i, j))
    }

    fn gap_between(&self, a: &str, b: &str, spare: f64) -> String {
        let need = 2.0 * self.layout.collision_radius;
        let gap = need + spare;
        format!("the gap between {a} and {b} is {gap:.3} m, the robot needs {need:.3} m")
    }

    /// The widest of the gaps that are too narrow, between beacons or beside a wall.
    fn narrowest(&self) -> Option<String> {
        let count = self.layout.beacons.len();
        let pairs = (0..count).flat_map(|i| (0..i).map(move |j| [j, i]));
        let pairs = pairs.map(|pair| (self.spare(pair[0], pair[1]), pair[0], Some(pair[1])));
        let to_wall = |i| wall_distance(self.layout.arena, self.center(i)) - self.reach(i);
        let walls = (0..count).map(|i| (to_wall(i) - self.layout.collision_radius, i, None));
        let narrow = pairs.chain(walls).filter(|gap| gap.0 < 0.0);
        let (spare, i, other) = narrow.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let other = other.map_or("a wall", |j| self.name(j));
        Some(self.gap_between(self.name(i), other, spare))
    }

    /// What probably blocked the way, after all candidates failed at `stage`.
    pub(super) fn blocked(&self, stage: usize) -> PlanError {
        let what = match self.goal {
            Goal::Homing { beacon, .. } => format!("no free way leads to {}", self.name(*beacon)),
            Goal::Gate { pair, .. } => {
                format!(
                    "no free way leads through the gate {}, {}",
                    self.name(pair[0]),
                    self.name(pair[1])
                )
            }
            Goal::Eight { pair, .. } => {
                format!(
                    "no free way leads round {} and {}",
                    self.name(pair[0]),
                    self.name(pair[1])
                )
            }
            Goal::Slalom { chain, .. } => match chain.get(stage) {
                Some(&next) => format!(
                    "{} cannot be passed on the side it has to be",
                    self.name(next)
                ),
                None => format!(
                    "no free way leads past {}",
                    self.name(chain[chain.len() - 1])
                ),
            },
        };
        let reason = match self.narrowest() {
            Some(gap) => format!("{what}; perhaps because {gap}"),
            None => what,
        };
        PlanError {
            reason,
            hint: "make room: move beacons apart or away from the walls".into(),
        }
    }
}
