//! Global planner: a reference path for the goal of a layout, for a disc robot that can turn on the
//! spot.
//!
//! World frame, SI units. Beacons are discs inflated by the robot's radius and a margin; the
//! shortest path among them runs on common tangents and arcs. A [`Rule`] counts the crossings the
//! goal asks for while the path is searched, so that a taut string for a slalom, a gate or a figure
//! eight is the shortest path in the product of tangent graph and count. Strings with several
//! margins are smoothed, walked before the [`Judge`], and the quickest with enough clearance is
//! kept.

mod search;

use crate::judge::{
    Judge, Line, Verdict, between, difference, distance, dot, gate_line, segment_distance,
    slalom_lines, wall_distance,
};
use crate::layout::{Goal, Layout};
use appell_model::math::single::{atan2, sin_cos};
use appell_model::scalar::Scalar;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

use search::Planner;

/// A smooth path sampled at equal arc lengths.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Path {
    /// Arc length between neighboring points, m.
    pub ds: f64,
    /// Points, world frame, m; only one if there is nothing to drive.
    pub points: Vec<[f64; 2]>,
    /// Direction of travel at each point, without jumps of 2π, rad.
    pub heading: Vec<f64>,
    /// Curvature at each point, positive to the left, 1/m.
    pub curvature: Vec<f64>,
    /// Length of the whole path, m.
    pub length: f64,
}

/// Why no path was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanError {
    /// What is wrong.
    pub reason: String,
    /// What to change.
    pub hint: String,
}

impl std::fmt::Display for PlanError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}\nhint: {}", self.reason, self.hint)
    }
}

impl std::error::Error for PlanError {}

/// What the robot that follows a path can do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedLimits<T = f64> {
    /// Largest speed, m/s.
    pub speed: T,
    /// Largest acceleration along the path, either way, m/s².
    pub acceleration: T,
    /// Largest acceleration across the path, m/s².
    pub lateral_acceleration: T,
    /// Largest yaw rate, rad/s.
    pub yaw_rate: T,
}

/// Limits by which candidates are compared.
const NOMINAL: SpeedLimits = SpeedLimits {
    speed: 1.0,
    acceleration: 0.8,
    lateral_acceleration: 0.8,
    yaw_rate: 1.8,
};
/// Margins round the inflated beacons that are tried, m.
const MARGINS: [f64; 7] = [0.35, 0.20, 0.14, 0.09, 0.06, 0.035, 0.012];
/// Lengths of the moving averages that are tried, m.
const WINDOWS: [f64; 4] = [0.40, 0.25, 0.15, 0.08];
/// Length of the moving average if none of the others passes, m.
const WINDOW_LAST: f64 = 0.03;
/// Arc length between path points, m.
pub(crate) const SPACING: f64 = 0.02;
/// Clearance that is enough to stop looking for more, m.
const COMFORT: f64 = 0.08;
/// Distance from the start within which clearance is the layout's affair, m.
const START_ZONE: f64 = 0.3;
/// Slack for contact between a tangent and a disc it just touches, m.
const GRAZE: f64 = 1e-7;
/// Angle between the corners of a polygonal arc, rad.
const ARC_STEP: f64 = 0.1;

/// Largest speed, m/s, that keeps the limits at points `ds`, m, apart with these curvatures, 1/m, from
/// rest to rest.
pub(crate) fn speed_profile<T: Scalar>(
    curvature: impl Iterator<Item = f64>,
    ds: f64,
    limits: &SpeedLimits<T>,
) -> Vec<T> {
    let bound = |curvature: f64| {
        let curvature = T::from(curvature.abs().max(1e-9));
        let across = (limits.lateral_acceleration / curvature).sqrt();
        limits.speed.min(limits.yaw_rate / curvature).min(across)
    };
    let mut speed: Vec<T> = curvature.map(bound).collect();
    let gain = T::from(2.0) * limits.acceleration * T::from(ds);
    let (first, last) = (0, speed.len() - 1);
    speed[first] = T::zero();
    speed[last] = T::zero();
    for k in 1..=last {
        speed[k] = speed[k].min((speed[k - 1] * speed[k - 1] + gain).sqrt());
    }
    for k in (0..last).rev() {
        speed[k] = speed[k].min((speed[k + 1] * speed[k + 1] + gain).sqrt());
    }
    speed
}

impl Path {
    /// Position, heading and curvature at arc length `s`, m; held beyond the ends.
    pub fn at(&self, s: f64) -> ([f64; 2], f64, f64) {
        let last = self.points.len() - 1;
        let steps = if self.ds > 0.0 {
            (s / self.ds).clamp(0.0, last as f64)
        } else {
            0.0
        };
        let k = (steps.floor() as usize).min(last.saturating_sub(1));
        let (next, fraction) = ((k + 1).min(last), steps - k as f64);
        let mix = |values: &[f64]| values[k] + fraction * (values[next] - values[k]);
        (
            between(self.points[k], self.points[next], fraction),
            mix(&self.heading),
            mix(&self.curvature),
        )
    }

    /// Largest speed at each point that keeps the limits, from rest to rest, m/s.
    pub fn speed_profile(&self, limits: &SpeedLimits) -> Vec<f64> {
        speed_profile(self.curvature.iter().copied(), self.ds, limits)
    }

    /// Time to follow the path within the limits, s.
    pub(crate) fn duration(&self, limits: &SpeedLimits) -> f64 {
        let speed = self.speed_profile(limits);
        speed
            .windows(2)
            .map(|pair| 2.0 * self.ds / (pair[0] + pair[1]).max(1e-3))
            .sum()
    }

    fn standing(start: [f64; 3]) -> Self {
        let points = vec![[start[0], start[1]]];
        Self {
            ds: 0.0,
            points,
            heading: vec![start[2]],
            curvature: vec![0.0],
            length: 0.0,
        }
    }

    /// The polygon with its corners rounded by a moving average applied twice.
    fn smoothed(polygon: &[[f64; 2]], window: f64) -> Option<Self> {
        let (points, ds) = resampled(polygon)?;
        let half = (window / ds / 2.0).round() as usize;
        let (points, ds) = resampled(&averaged(&averaged(&points, half), half))?;
        let last = points.len() - 1;
        let mut heading: Vec<f64> = Vec::with_capacity(points.len());
        for k in 0..=last {
            let along = difference(points[(k + 1).min(last)], points[k.saturating_sub(1)]);
            let angle = atan2(along[1], along[0]);
            let previous = heading.last().copied().unwrap_or(angle);
            heading.push(previous + wrapped(angle - previous));
        }
        let curvature = (0..=last)
            .map(|k| {
                let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
                (heading[after] - heading[before]) / ((after - before) as f64 * ds)
            })
            .collect();
        Some(Self {
            ds,
            points,
            heading,
            curvature,
            length: ds * last as f64,
        })
    }
}

/// The angle in [−π, π), rad.
fn wrapped(angle: f64) -> f64 {
    angle - TAU * ((angle + PI) / TAU).floor()
}

/// Points at equal arc lengths on a polygon and their distance; none if it has no length.
fn resampled(polygon: &[[f64; 2]]) -> Option<(Vec<[f64; 2]>, f64)> {
    let length: f64 = polygon
        .windows(2)
        .map(|pair| distance(pair[0], pair[1]))
        .sum();
    if length < 1e-6 {
        return None;
    }
    let count = (length / SPACING).ceil().max(2.0);
    let ds = length / count;
    let mut points = vec![polygon[0]];
    let mut passed = 0.0;
    for pair in polygon.windows(2) {
        let step = distance(pair[0], pair[1]);
        while (points.len() as f64) < count && points.len() as f64 * ds <= passed + step {
            let rest = points.len() as f64 * ds - passed;
            points.push(between(pair[0], pair[1], rest / step));
        }
        passed += step;
    }
    points.push(*polygon.last()?);
    Some((points, ds))
}

/// Moving average over `2 half + 1` points; the ends are continued point-symmetrically and stay.
fn averaged(points: &[[f64; 2]], half: usize) -> Vec<[f64; 2]> {
    let last = points.len() - 1;
    let half = half.min(last);
    let mirrored = |end: [f64; 2], p: [f64; 2]| [2.0 * end[0] - p[0], 2.0 * end[1] - p[1]];
    let before = (1..=half).rev().map(|i| mirrored(points[0], points[i]));
    let after = (1..=half).map(|i| mirrored(points[last], points[last - i]));
    let padded: Vec<[f64; 2]> = before.chain(points.iter().copied()).chain(after).collect();
    let width = 2 * half + 1;
    let mut sum = [0.0; 2];
    let mut average = Vec::with_capacity(points.len());
    for (k, p) in padded.iter().enumerate() {
        sum = [sum[0] + p[0], sum[1] + p[1]];
        if k >= width {
            sum = difference(sum, padded[k - width]);
        }
        if k + 1 >= width {
            average.push([sum[0] / width as f64, sum[1] / width as f64]);
        }
    }
    // The means of the symmetric ends are the ends but for rounding.
    average[0] = points[0];
    average[last] = points[last];
    average
}

fn left_of(v: [f64; 2]) -> [f64; 2] {
    [-v[1], v[0]]
}

/// The point `p + a u`.
fn ahead(p: [f64; 2], u: [f64; 2], a: f64) -> [f64; 2] {
    [p[0] + a * u[0], p[1] + a * u[1]]
}

// ------------------------------------------------------------------------------- crossing rules

/// What a path may cross, and what it must cross in order; each crossing asked for is a stage.
enum Rule {
    Free,
    /// Never between these offsets of the line.
    Shut {
        line: Line,
        offsets: Range<f64>,
    },
    /// Exactly once between these offsets, in this direction.
    Through {
        line: Line,
        offsets: Range<f64>,
        forward: bool,
    },
    /// The parts of the line (before the first beacon, between, after the second) in order.
    Eight {
        line: Line,
        length: f64,
        word: Vec<(usize, bool)>,
    },
    /// Each line forward, on alternating sides.
    Slalom {
        lines: Vec<Line>,
        reach: Vec<f64>,
        offset_max: f64,
        left_first: bool,
    },
}

impl Rule {
    /// Number of crossings asked for.
    fn stages(&self) -> usize {
        match self {
            Rule::Free | Rule::Shut { .. } => 0,
            Rule::Through { .. } => 1,
            Rule::Eight { word, .. } => word.len(),
            Rule::Slalom { lines, .. } => lines.len(),
        }
    }

    /// The stage after the segment from `p` to `q`; none if it is forbidden.
    fn advance(&self, stage: usize, p: [f64; 2], q: [f64; 2]) -> Option<usize> {
        match self {
            Rule::Free => Some(stage),
            Rule::Shut { line, offsets } => match line.crossing(p, q) {
                Some(z) if offsets.contains(&z.offset) => None,
                Some(_) | None => Some(stage),
            },
            Rule::Through {
                line,
                offsets,
                forward,
            } => match line.crossing(p, q) {
                Some(z) if offsets.contains(&z.offset) => {
                    (stage == 0 && z.forward == *forward).then_some(1)
                }
                Some(_) | None => Some(stage),
            },
            Rule::Eight { line, length, word } => match line.crossing(p, q) {
                Some(z) => {
                    let part = usize::from(z.offset < 0.0) + usize::from(z.offset < -length);
                    (word.get(stage) == Some(&(part, z.forward))).then_some(stage + 1)
                }
                None => Some(stage),
            },
            Rule::Slalom { .. } => self.advance_slalom(stage, p, q),
        }
    }

    fn advance_slalom(&self, mut stage: usize, p: [f64; 2], q: [f64; 2]) -> Option<usize> {
        let Rule::Slalom {
            lines,
            reach,
            offset_max,
            left_first,
        } = self
        else {
            return None;
        };
        let mut after = -1.0;
        while let Some(line) = lines.get(stage) {
            let Some(z) = line
                .crossing(p, q)
                .filter(|z| z.forward && z.fraction > after)
            else {
                break;
            };
            let wanted_left = *left_first == stage.is_multiple_of(2);
            let aside = z.offset.abs();
            // The last centimeters of the allowed range are left to tracking errors.
            let slack = 0.03_f64.min((offset_max - reach[stage]) / 4.0);
            if aside < reach[stage] || aside > offset_max + slack {
                break;
            }
            if (z.offset > 0.0) != wanted_left || aside > offset_max - slack {
                return None;
            }
            stage += 1;
            after = z.fraction;
        }
        Some(stage)
    }
}

// -------------------------------------------------------------------------------- tangent graph

/// A circle a string may lie against; a point if it has no radius.
#[derive(Clone, Debug)]
struct Circle {
    center: [f64; 2],
    radius: f64,
    /// Whether a string may not enter.
    solid: bool,
    /// Senses of travel: counter-clockwise +1, clockwise −1.
    senses: &'static [f64],
    /// A terminal of the search on the circle.
    anchor: Option<[f64; 2]>,
    enters: bool,
    leaves: bool,
}

const BOTH: &[f64] = &[1.0, -1.0];
const LEFT: &[f64] = &[1.0];
const RIGHT: &[f64] = &[-1.0];

impl Circle {
    fn beacon(center: [f64; 2], radius: f64) -> Self {
        Self {
            center,
            radius,
            solid: true,
            senses: BOTH,
            anchor: None,
            enters: true,
            leaves: true,
        }
    }

    fn point(at: [f64; 2], enters: bool, leaves: bool) -> Self {
        let anchor = Some(at);
        Self {
            center: at,
            radius: 0.0,
            solid: false,
            senses: LEFT,
            anchor,
            enters,
            leaves,
        }
    }

    /// A circle on which a string arrives at `at` in direction `along`, turning left or right.
    fn guide(at: [f64; 2], along: [f64; 2], radius: f64, left: bool) -> Self {
        let sense = if left { 1.0 } else { -1.0 };
        Self {
            center: ahead(at, left_of(along), sense * radius),
            radius,
            solid: false,
            senses: if left { LEFT } else { RIGHT },
            anchor: Some(at),
            enters: true,
            leaves: false,
        }
    }
}

struct Edge {
    to: usize,
    length: f64,
    /// Corners between the ends.
    bends: Range<usize>,
}

struct Node {
    position: [f64; 2],
    edges: Vec<Edge>,
}

/// Free space: the inset arena without the solid circles.
struct Space {
    low: [f64; 2],
    high: [f64; 2],
    circles: Vec<Circle>,
}

impl Space {
    fn inside(&self, p: [f64; 2]) -> bool {
        (0..2).all(|axis| self.low[axis] - 1e-9 <= p[axis] && p[axis] <= self.high[axis] + 1e-9)
    }

    /// Whether the segment is inside and off all solid circles but two.
    fn clear(&self, p: [f64; 2], q: [f64; 2], but: [usize; 2]) -> bool {
        let off = |(index, circle): (usize, &Circle)| {
            !circle.solid
                || but.contains(&index)
                || segment_distance(circle.center, p, q) >= circle.radius - GRAZE
        };
        self.inside(p) && self.inside(q) && self.circles.iter().enumerate().all(off)
    }

    fn clear_of_all(&self, p: [f64; 2], q: [f64; 2]) -> bool {
        self.clear(p, q, [usize::MAX; 2])
    }
}

/// Tangents between all circles, and the arcs that join them.
struct Graph {
    nodes: Vec<Node>,
    bends: Vec<[f64; 2]>,
    /// Node of the anchor of each circle.
    anchors: Vec<Option<usize>>,
}

/// Points where the common tangent leaves circle `a` and meets circle `b`, in these senses.
fn tangent(a: &Circle, a_sense: f64, b: &Circle, b_sense: f64) -> Option<([f64; 2], [f64; 2])> {
    let across = difference(b.center, a.center);
    let square = dot(across, across);
    let (from, to) = (a_sense * a.radius, b_sense * b.radius);
    let shift = to - from;
    let rest = square - shift * shift;
    if square < 1e-12 || rest < 0.0 {
        return None;
    }
    let along = rest.sqrt();
    let left = left_of(across);
    let unit = [0, 1].map(|i| (along * across[i] - shift * left[i]) / square);
    let left = left_of(unit);
    Some((ahead(a.center, left, -from), ahead(b.center, left, -to)))
}

impl Graph {
    fn new(space: &Space) -> Self {
        let mut graph = Self {
            nodes: Vec::new(),
            bends: Vec::new(),
            anchors: Vec::new(),
        };
        // Nodes on each circle in each sense, by angle.
        let mut rings: Vec<[Vec<(f64, usize)>; 2]> = vec![[vec![], vec![]]; space.circles.len()];
        for (circle, ring) in space.circles.iter().zip(&mut rings) {
            let node = circle.anchor.map(|at| {
                let node = graph.add(at);
                ring[sense_index(circle.senses[0])].push((angle_on(circle, at), node));
                node
            });
            graph.anchors.push(node);
        }
        for (i, a) in space.circles.iter().enumerate().filter(|(_, a)| a.leaves) {
            for (j, b) in space
                .circles
                .iter()
                .enumerate()
                .filter(|(j, b)| b.enters && *j != i)
            {
                for (&from, &to) in a
                    .senses
                    .iter()
                    .flat_map(|f| b.senses.iter().map(move |t| (f, t)))
                {
                    let Some((p, q)) = tangent(a, from, b, to) else {
                        continue;
                    };
                    if space.clear(p, q, [i, j]) {
                        let start = graph.node_on(a, p, &mut rings[i][sense_index(from)], i);
                        let end = graph.node_on(b, q, &mut rings[j][sense_index(to)], j);
                        graph.connect(start, end, distance(p, q), 0..0);
                    }
                }
            }
        }
        for (index, ring) in rings.iter_mut().enumerate() {
            if space.circles[index].radius > 0.0 {
                for (ring, sense) in ring.iter_mut().zip(BOTH) {
                    graph.add_arcs(space, index, *sense, ring);
                }
            }
        }
        graph
    }

    fn add(&mut self, position: [f64; 2]) -> usize {
        self.nodes.push(Node {
            position,
            edges: Vec::new(),
        });
        self.nodes.len() - 1
    }

    fn node_on(
        &mut self,
        circle: &Circle,
        at: [f64; 2],
        ring: &mut Vec<(f64, usize)>,
        index: usize,
    ) -> usize {
        if let (true, Some(anchor)) = (circle.radius == 0.0, self.anchors[index]) {
            return anchor;
        }
        let node = self.add(at);
        ring.push((angle_on(circle, at), node));
        node
    }

    fn connect(&mut self, from: usize, to: usize, length: f64, bends: Range<usize>) {
        self.nodes[from].edges.push(Edge { to, length, bends });
    }

    /// Joins neighboring nodes of a circle by arcs in the given sense, where nothing is in the way.
    fn add_arcs(&mut self, space: &Space, index: usize, sense: f64, ring: &mut [(f64, usize)]) {
        let circle = &space.circles[index];
        ring.sort_by(|a, b| a.0.total_cmp(&b.0));
        if sense < 0.0 {
            ring.reverse();
        }
        let count = if ring.len() > 1 { ring.len() } else { 0 };
        for k in 0..count {
            let ((a, from), (b, to)) = (ring[k], ring[(k + 1) % count]);
            let mut angle = sense * (b - a);
            if angle < 0.0 {
                angle += TAU;
            }
            if angle < 1e-9 {
                // The order of nodes in one place is arbitrary.
                self.connect(to, from, 0.0, 0..0);
            }
            let steps = (angle / ARC_STEP).ceil().max(1.0);
            let begin = self.bends.len();
            let mut previous = self.nodes[from].position;
            let mut free = space.clear(previous, previous, [index; 2]);
            for step in 1..=steps as usize {
                let (sin, cos) = sin_cos(a + sense * angle * step as f64 / steps);
                let here = ahead(circle.center, [cos, sin], circle.radius);
                free = free && space.clear(previous, here, [index; 2]);
                self.bends.push(here);
                previous = here;
            }
            self.bends.pop();
            if free {
                let bends = begin..self.bends.len();
                self.connect(from, to, circle.radius * angle, bends);
            } else {
                self.bends.truncate(begin);
            }
        }
    }

    /// Shortest path from the anchor `from` to any of the anchors `to` that obeys the rule.
    ///
    /// Otherwise the last stage that was reached.
    fn shortest(&self, rule: &Rule, from: usize, to: &[usize]) -> Result<Vec<[f64; 2]>, usize> {
        let layers = rule.stages() + 1;
        let targets: Vec<usize> = to.iter().filter_map(|&i| self.anchors[i]).collect();
        let mut best = vec![f64::INFINITY; self.nodes.len() * layers];
        let mut before: Vec<Option<(usize, usize)>> = vec![None; best.len()];
        let mut queue = BinaryHeap::new();
        let start = self.anchors[from].expect("terminals have anchors") * layers;
        best[start] = 0.0;
        queue.push(Reverse((0_u64, start)));
        let mut reached = 0;
        while let Some(Reverse((bits, state))) = queue.pop() {
            let length = f64::from_bits(bits);
            if length > best[state] {
                continue;
            }
            let (node, stage) = (state / layers, state % layers);
            reached = reached.max(stage);
            if stage + 1 == layers && targets.contains(&node) {
                return Ok(self.traced(&before, state, layers));
            }
            for (index, edge) in self.nodes[node].edges.iter().enumerate() {
                let Some(stage) = self.advance(rule, stage, node, edge) else {
                    continue;
                };
                let next = edge.to * layers + stage;
                if length + edge.length < best[next] {
                    best[next] = length + edge.length;
                    before[next] = Some((state, index));
                    // Bits of positive numbers are ordered as the numbers are.
                    queue.push(Reverse((best[next].to_bits(), next)));
                }
            }
        }
        Err(reached)
    }

    fn advance(&self, rule: &Rule, mut stage: usize, from: usize, edge: &Edge) -> Option<usize> {
        let mut previous = self.nodes[from].position;
        for &bend in &self.bends[edge.bends.clone()] {
            stage = rule.advance(stage, previous, bend)?;
            previous = bend;
        }
        rule.advance(stage, previous, self.nodes[edge.to].position)
    }

    fn traced(
        &self,
        before: &[Option<(usize, usize)>],
        end: usize,
        layers: usize,
    ) -> Vec<[f64; 2]> {
        let mut state = end;
        let mut points = vec![self.nodes[end / layers].position];
        while let Some((previous, edge)) = before[state] {
            let node = &self.nodes[previous / layers];
            points.extend(self.bends[node.edges[edge].bends.clone()].iter().rev());
            points.push(node.position);
            state = previous;
        }
        points.reverse();
        points.dedup_by(|a, b| distance(*a, *b) < 1e-9);
        points
    }
}

/// A graph with the terminals of a search.
struct Network {
    graph: Graph,
    start: usize,
    targets: Vec<usize>,
}

impl Network {
    fn shortest(&self, rule: &Rule) -> Result<Vec<[f64; 2]>, usize> {
        self.graph.shortest(rule, self.start, &self.targets)
    }
}

fn sense_index(sense: f64) -> usize {
    usize::from(sense < 0.0)
}

fn angle_on(circle: &Circle, at: [f64; 2]) -> f64 {
    let arm = difference(at, circle.center);
    atan2(arm[1], arm[0])
}

/// A path from the start of the layout that reaches the goal if the robot follows it.
///
/// Deterministic. The path begins with the direction of travel, not with the start yaw: the robot
/// turns on the spot first. For homing from within the goal distance it is a single point.
///
/// # Errors
/// If no path passes the judge: what is too narrow or out of reach.
pub fn plan(layout: &Layout, goal: &Goal) -> Result<Path, PlanError> {
    if let Some(reason) = goal.fault(layout) {
        return Err(PlanError {
            reason,
            hint: "correct the goal of the layout".into(),
        });
    }
    let start = [layout.start[0], layout.start[1]];
    let planner = Planner {
        layout,
        goal,
        start,
    };
    if let Some(error) = planner.obstacle() {
        return Err(error);
    }
    if let Goal::Homing {
        beacon,
        distance: radius,
        ..
    } = *goal
        && distance(start, layout.beacons[beacon].position) <= radius
    {
        return Ok(Path::standing(layout.start));
    }
    planner.search().map_err(|stage| planner.blocked(stage))
}

#[cfg(test)]
mod tests;
