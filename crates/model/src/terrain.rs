//! Uneven ground: heights over a level map, and what a wheel meets on them. `[eq:terrain]`
//!
//! World frame: x and y on the map, z up. Heights of all features add. Plain numbers, for how a wheel
//! lies on an edge is a search.

mod grid;

use crate::planar::{Vec2, vec2};
use crate::scalar::Scalar;

pub use grid::Grid;

/// A feature of the ground; its heights are added to those of the others.
#[derive(Clone, Debug)]
pub enum Relief {
    /// A plane through the origin that rises along a direction.
    Slope {
        /// Unit vector uphill.
        uphill: Vec2<f64>,
        /// Rise over run.
        grade: f64,
    },
    /// Ground that is higher by `rise` beyond a line, over a ramp or at once.
    Ramp {
        /// A point of the line where it begins, m.
        at: Vec2<f64>,
        /// Unit vector across that line.
        along: Vec2<f64>,
        /// How much higher the ground is beyond, m.
        rise: f64,
        /// Length of the ramp on the map, m; 0 for a step.
        length: f64,
    },
    /// A rectangle that stands out of the ground, or is sunk into it.
    Block {
        /// Its middle, m.
        at: Vec2<f64>,
        /// Unit vector along its length.
        along: Vec2<f64>,
        /// Half of its length and width, m.
        half: [f64; 2],
        /// Height, m.
        rise: f64,
    },
    /// Corrugation: a wave along a direction, the same across it.
    Wave {
        /// Where it begins, m.
        at: Vec2<f64>,
        /// Unit vector along it.
        along: Vec2<f64>,
        /// Its form.
        form: Form,
        /// Amplitude, m.
        amplitude: f64,
        /// Period, m.
        period: f64,
        /// Phase where it begins, rad.
        phase: f64,
        /// How far it goes on, m.
        length: f64,
    },
    /// Heights at the nodes of a grid.
    Grid(Grid),
}

/// Form of a wave, with zero mean and a zero at its start, where it rises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// sin
    Sine,
    /// Straight between its peaks.
    Triangle,
    /// High, then low.
    Square,
}

/// The rim of a wheel: a circle in space, world frame.
#[derive(Clone, Copy, Debug)]
pub struct Disc {
    /// Center, m.
    pub center: [f64; 3],
    /// Unit vector ahead.
    pub forward: [f64; 3],
    /// Unit vector to its upper side, across `forward`.
    pub up: [f64; 3],
    /// Radius, m.
    pub radius: f64,
}

/// Where a disc is deepest in the ground, or nearest to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Height of the ground over that point of the rim, m.
    pub depth: f64,
    /// How far ahead of the lowest point of the rim it is, along `forward`, m.
    pub ahead: f64,
    /// Slope of the ground there; on an edge, that of the plane which the rim touches.
    pub gradient: Vec2<f64>,
    /// Whether the foremost or rearmost point of the rim is in the ground: it stands before a wall.
    pub is_wall: bool,
}

/// Heights over a map.
#[derive(Clone, Debug, Default)]
pub struct Terrain {
    features: Vec<Relief>,
}

/// Places at which a wheel is tried along its heading, besides all edges, to each side.
const TRIES: i32 = 10;
/// Most edges that are looked at under one wheel.
const EDGES: usize = 48;
/// Most places at which the rim is probed.
const PROBES: usize = 2 * TRIES as usize + 1 + 2 * EDGES;
/// Distance from an edge at which a wheel on it is taken, m: beyond rounding, below what matters.
const BESIDE: f64 = 1e-9;
/// Share of the radius up to which a contact ahead is looked for.
const FACE: f64 = 0.995;

impl Terrain {
    /// Ground of these features.
    pub fn new(features: Vec<Relief>) -> Self {
        Terrain { features }
    }

    /// Height above the map, m.
    pub fn height(&self, point: Vec2<f64>) -> f64 {
        self.features.iter().map(|f| f.height(point).0).sum()
    }

    /// Height, m, and its gradient.
    pub fn surface(&self, point: Vec2<f64>) -> (f64, Vec2<f64>) {
        let mut sum = (0.0, Vec2::zero());
        for feature in &self.features {
            let (height, gradient) = feature.height(point);
            sum = (sum.0 + height, sum.1 + gradient);
        }
        sum
    }

    /// Where a disc touches: of the points Q(s) = C + s f − √(r² − s²) n of its lower half that one with
    /// the largest h(Q) − Q_z. `[eq:envelope]`
    pub fn touch(&self, disc: &Disc) -> Touch {
        self.touches(disc, 0.0).0
    }

    /// The same; and of the peaks beyond a valley that are less deep by no more than `within`, m, that
    /// one which stands out most over its valley, or over what is too little, with the share of it
    /// in what both stand out together: 0 to ½.
    pub fn touches(&self, disc: &Disc, within: f64) -> (Touch, Option<(Touch, Share)>) {
        let rim = Rim::new(self, disc);
        let is_inside = |s: f64| {
            let [x, y, z] = [0, 1, 2].map(|k| disc.center[k] + s * disc.forward[k]);
            self.height(vec2(x, y)) > z
        };
        let is_wall = is_inside(disc.radius) || is_inside(-disc.radius);
        // Edges cut the way into smooth stretches.
        let mut edges = Edges::new(disc, rim.reach);
        for feature in &self.features {
            feature.edges(&mut edges);
        }
        let edges = edges.sorted();
        let mut probes = [Probe::NONE; PROBES];
        let mut count = 0;
        let mut offer = |place: f64, edge: Option<Vec2<f64>>| {
            probes[count] = Probe {
                place,
                depth: rim.depth(place),
                edge,
            };
            count += 1;
        };
        let mut next = 0;
        for k in -TRIES..=TRIES {
            let place = rim.reach * f64::from(k) / f64::from(TRIES);
            while next < edges.len() && edges[next].place <= place {
                let edge = &edges[next];
                offer((edge.place - BESIDE).max(-rim.reach), Some(edge.normal));
                offer((edge.place + BESIDE).min(rim.reach), Some(edge.normal));
                next += 1;
            }
            offer(place, None);
        }
        let probes = &probes[..count];
        let is_peak = |k: usize| {
            let before = k == 0 || probes[k].depth > probes[k - 1].depth;
            before && (k + 1 == count || probes[k].depth >= probes[k + 1].depth)
        };
        // Of equal ones the nearest to the middle, that flat ground has no side.
        let is_better = |a: &Probe, b: &Probe| {
            a.depth > b.depth || (a.depth == b.depth && a.place.abs() < b.place.abs())
        };
        let mut best = 0;
        for k in 1..count {
            if is_better(&probes[k], &probes[best]) {
                best = k;
            }
        }
        let mut first = rim.refined(&probes[best], edges, is_wall);
        let mut second: Option<(Touch, f64)> = None;
        // What lies deep enough to have a part, were it refined.
        let slack = within + rim.reach / f64::from(TRIES * TRIES);
        let others = (0..count).filter(|&k| k != best && is_peak(k));
        for k in others.filter(|&k| probes[k].depth > probes[best].depth - slack) {
            let between = if k < best { k..best } else { best..k };
            let valley = probes[between].iter().map(|probe| probe.depth);
            let valley = valley.fold(f64::INFINITY, f64::min);
            let touch = rim.refined(&probes[k], edges, is_wall);
            if second.is_none_or(|(other, _)| touch.depth > other.depth) {
                second = Some((touch, valley));
            }
        }
        let Some((mut other, valley)) = second else {
            return (first, None);
        };
        if other.depth > first.depth {
            (first, other) = (other, first);
        }
        let floor = valley.max(first.depth - within);
        let (own, out) = (first.depth - floor, other.depth - floor);
        if !(out > 0.0 && own > 0.0) {
            return (first, None);
        }
        let sum = own + out;
        let share = Share {
            share: out / sum,
            rate: own / (sum * sum),
        };
        (first, Some((other, share)))
    }
}

/// What a second peak has of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// Its share, 0 to ½.
    pub share: f64,
    /// How fast that grows with its depth over that of the first, 1/m.
    pub rate: f64,
}

/// A place on a rim.
#[derive(Clone, Copy)]
struct Probe {
    /// How far ahead, m.
    place: f64,
    depth: f64,
    /// The edge beside which it is: unit vector across it.
    edge: Option<Vec2<f64>>,
}

impl Probe {
    const NONE: Probe = Probe {
        place: 0.0,
        depth: 0.0,
        edge: None,
    };
}

/// The lower half of a rim over a terrain.
struct Rim<'a> {
    terrain: &'a Terrain,
    disc: &'a Disc,
    /// How far ahead and behind contacts are looked for, m.
    reach: f64,
}

impl<'a> Rim<'a> {
    fn new(terrain: &'a Terrain, disc: &'a Disc) -> Self {
        let reach = FACE * disc.radius;
        Rim {
            terrain,
            disc,
            reach,
        }
    }

    fn arc(&self, s: f64) -> f64 {
        Scalar::sqrt((self.disc.radius - s) * (self.disc.radius + s))
    }

    /// The point at a place.
    fn at(&self, s: f64) -> [f64; 3] {
        let Disc {
            center,
            forward,
            up,
            ..
        } = self.disc;
        let below = self.arc(s);
        [0, 1, 2].map(|k| center[k] + s * forward[k] - below * up[k])
    }

    /// Rate of that point with the place.
    fn along(&self, s: f64) -> [f64; 3] {
        let turn = s / self.arc(s);
        [0, 1, 2].map(|k| self.disc.forward[k] + turn * self.disc.up[k])
    }

    fn depth(&self, s: f64) -> f64 {
        let [x, y, z] = self.at(s);
        self.terrain.height(vec2(x, y)) - z
    }

    /// Rate of depth with the place.
    fn rises(&self, s: f64) -> f64 {
        let [x, y, _] = self.at(s);
        let [along_x, along_y, along_z] = self.along(s);
        let (_, gradient) = self.terrain.surface(vec2(x, y));
        gradient.dot(vec2(along_x, along_y)) - along_z
    }

    /// The peak beside a probe that is deeper than its neighbors.
    fn refined(&self, probe: &Probe, edges: &[Edge], is_wall: bool) -> Touch {
        let (mut place, mut on) = (probe.place, probe.edge);
        let span = self.reach / f64::from(TRIES);
        let mut low = (place - span).max(-self.reach);
        let mut high = (place + span).min(self.reach);
        for edge in edges {
            if edge.place <= place {
                low = low.max(edge.place + BESIDE);
            } else {
                high = high.min(edge.place - BESIDE);
            }
        }
        let own = self.rises(place);
        let (from, to) = if own > 0.0 {
            (place, high)
        } else {
            (low, place)
        };
        if own != 0.0 && from < to && self.rises(from) > 0.0 && self.rises(to) < 0.0 {
            place = root(&|s| self.rises(s), from, to);
            on = None;
        }
        let [x, y, z] = self.at(place);
        let (height, ground) = self.terrain.surface(vec2(x, y));
        let gradient = match on {
            None => ground,
            // The plane that the rim and the edge share.
            Some(normal) => {
                let edge = normal.perpendicular();
                let beside = edge * edge.dot(ground);
                let [x, y, z] = self.along(place);
                let way = vec2(x, y);
                beside + normal * ((z - way.dot(beside)) / way.dot(normal))
            }
        };
        Touch {
            depth: height - z,
            ahead: place,
            gradient,
            is_wall,
        }
    }
}

impl Disc {
    /// An upright wheel that stands on the map at a point, with its plane along a heading (unit vector).
    pub fn upright(at: Vec2<f64>, heading: Vec2<f64>, radius: f64) -> Self {
        Disc {
            center: [at.x, at.y, radius],
            forward: [heading.x, heading.y, 0.0],
            up: [0.0, 0.0, 1.0],
            radius,
        }
    }
}

/// Where a falling function vanishes between two places, by false position (Illinois).
fn root(f: &dyn Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let (mut at_low, mut at_high) = (f(low), f(high));
    let mut side = 0;
    let mut place = low;
    for _ in 0..60 {
        let before = place;
        place = (at_low * high - at_high * low) / (at_low - at_high);
        let value = f(place);
        if value == 0.0 || (place - before).abs() <= 1e-15 || high - low <= 1e-15 {
            break;
        }
        if value > 0.0 {
            (low, at_low) = (place, value);
            if side == 1 {
                at_high *= 0.5;
            }
            side = 1;
        } else {
            (high, at_high) = (place, value);
            if side == -1 {
                at_low *= 0.5;
            }
            side = -1;
        }
    }
    place
}

/// An edge across the way of a wheel.
#[derive(Clone, Copy)]
struct Edge {
    /// How far ahead, m.
    place: f64,
    /// Unit vector across it.
    normal: Vec2<f64>,
}

/// Edges under a disc, within reach.
struct Edges {
    disc: Disc,
    reach: f64,
    edges: [Edge; EDGES],
    count: usize,
}

impl Edges {
    fn new(disc: &Disc, reach: f64) -> Self {
        let none = Edge {
            place: 0.0,
            normal: Vec2::zero(),
        };
        Edges {
            disc: *disc,
            reach,
            edges: [none; EDGES],
            count: 0,
        }
    }

    /// The middle of the disc on the map.
    fn center(&self) -> Vec2<f64> {
        vec2(self.disc.center[0], self.disc.center[1])
    }

    /// Adds the edge that is `apart` from the disc's center along its normal: where
    /// s f·n − √(r² − s²) u·n = apart.
    fn add(&mut self, normal: Vec2<f64>, apart: f64) {
        let Disc {
            forward,
            up,
            radius,
            ..
        } = self.disc;
        let (a, b) = (
            normal.dot(vec2(forward[0], forward[1])),
            normal.dot(vec2(up[0], up[1])),
        );
        let size = a * a + b * b;
        let rest = size * radius * radius - apart * apart;
        if rest < 0.0 || self.count == EDGES {
            return;
        }
        let place = (a * apart + b * Scalar::sqrt(rest).copysign(a)) / size;
        if place.abs() < self.reach {
            self.edges[self.count] = Edge { place, normal };
            self.count += 1;
        }
    }

    fn sorted(&mut self) -> &[Edge] {
        let edges = &mut self.edges[..self.count];
        edges.sort_by(|a, b| a.place.total_cmp(&b.place));
        edges
    }
}

impl Relief {
    /// Height, m, and its gradient.
    fn height(&self, point: Vec2<f64>) -> (f64, Vec2<f64>) {
        match self {
            Relief::Slope { uphill, grade } => (uphill.dot(point) * grade, *uphill * *grade),
            Relief::Ramp {
                at,
                along,
                rise,
                length,
            } => {
                let way = along.dot(point - *at);
                if way < 0.0 {
                    (0.0, Vec2::zero())
                } else if way >= *length {
                    (*rise, Vec2::zero())
                } else {
                    (rise * way / length, *along * (rise / length))
                }
            }
            Relief::Block {
                at,
                along,
                half,
                rise,
            } => {
                let from = point - *at;
                let inside = along.dot(from).abs() <= half[0] && along.cross(from).abs() <= half[1];
                (if inside { *rise } else { 0.0 }, Vec2::zero())
            }
            Relief::Wave {
                at,
                along,
                form,
                amplitude,
                period,
                phase,
                length,
            } => {
                let way = along.dot(point - *at);
                if way < 0.0 || way > *length {
                    return (0.0, Vec2::zero());
                }
                let turns = way / period + phase / core::f64::consts::TAU;
                let (value, rate) = form.at(turns);
                (amplitude * value, *along * (amplitude * rate / period))
            }
            Relief::Grid(grid) => grid.height(point),
        }
    }

    /// Edges of the feature under a disc.
    fn edges(&self, edges: &mut Edges) {
        let center = edges.center();
        match self {
            Relief::Slope { .. } | Relief::Grid(_) => {}
            Relief::Ramp {
                at, along, length, ..
            } => {
                let here = along.dot(center - *at);
                edges.add(*along, -here);
                if *length > 0.0 {
                    edges.add(*along, length - here);
                }
            }
            Relief::Block {
                at, along, half, ..
            } => {
                let from = center - *at;
                for (normal, half) in [(*along, half[0]), (along.perpendicular(), half[1])] {
                    let here = normal.dot(from);
                    edges.add(normal, -half - here);
                    edges.add(normal, half - here);
                }
            }
            Relief::Wave {
                at,
                along,
                form,
                period,
                phase,
                length,
                ..
            } => {
                let here = along.dot(center - *at);
                edges.add(*along, -here);
                edges.add(*along, length - here);
                let first = match form {
                    Form::Sine => return,
                    Form::Triangle => 0.25,
                    Form::Square => 0.0,
                };
                // Edges where turns = first + k / 2.
                let shift = phase / core::f64::consts::TAU;
                let spread = edges.disc.radius;
                let count = |way: f64| 2.0 * (way / period + shift - first);
                let mut k = count(here - spread).ceil();
                while k <= count(here + spread) && edges.count < EDGES {
                    let way = (first + 0.5 * k - shift) * period;
                    if (0.0..=*length).contains(&way) {
                        edges.add(*along, way - here);
                    }
                    k += 1.0;
                }
            }
        }
    }
}

impl Form {
    /// Value of amplitude 1 and its rate after a number of turns.
    pub fn at(self, turns: f64) -> (f64, f64) {
        let part = turns - turns.floor();
        match self {
            Form::Sine => {
                let (sin, cos) = Scalar::sin_cos(core::f64::consts::TAU * part);
                (sin, core::f64::consts::TAU * cos)
            }
            Form::Triangle if part < 0.25 => (4.0 * part, 4.0),
            Form::Triangle if part < 0.75 => (2.0 - 4.0 * part, -4.0),
            Form::Triangle => (4.0 * part - 4.0, 4.0),
            Form::Square => (if part < 0.5 { 1.0 } else { -1.0 }, 0.0),
        }
    }
}

/// A unit vector at an angle, rad.
pub fn heading(angle: f64) -> Vec2<f64> {
    let (sin, cos) = Scalar::sin_cos(angle);
    vec2(cos, sin)
}
