//! Routes: paths that people give, as lines, arcs and clothoids or as points.

use std::path::Path as FilePath;

use appell_model::math::single::{atan2, sin_cos};

use crate::controller::read_columns;
use crate::plan::{Path, SPACING};
use crate::scenario::{Piece, Route};
use crate::spline::Spline;

/// Why a route is no path.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// The field of the route, as a path below it.
    pub field: String,
    /// What must be otherwise.
    pub problem: String,
    /// What to do.
    pub hint: String,
}

impl Fault {
    /// Path of the field in the scenario, below the path of the task.
    pub fn path(&self, task: &str) -> String {
        match self.field.as_str() {
            "laps" => format!("{task}.laps"),
            "" => format!("{task}.path"),
            field => format!("{task}.path.{field}"),
        }
    }
}

fn fault(field: impl Into<String>, problem: impl Into<String>, hint: &str) -> Fault {
    Fault {
        field: field.into(),
        problem: problem.into(),
        hint: hint.into(),
    }
}

/// A stretch whose curvature changes in proportion to the way: line, arc or clothoid.
#[derive(Clone, Copy, Debug)]
struct Bend {
    /// Length, m.
    length: f64,
    /// Curvature at its ends, 1/m.
    ends: [f64; 2],
}

/// Longest path, m.
const LENGTH_MAX: f64 = 2e4;
/// Sharpest curvature, 1/m: a radius of 1 mm.
const CURVATURE_MAX: f64 = 1e3;
/// Largest turn between neighboring points, rad.
const TURN_MAX: f64 = 0.05;
/// Points of a path at the most.
const POINTS_MAX: f64 = 2e6;
/// Nodes and weights of the Gauss–Legendre rule of order 10 on [−1, 1].
const GAUSS: [(f64, f64); 5] = [
    (0.0, 0.568_888_888_888_888_9),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// Integral of `f` from `a` to `b`.
fn integral(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    GAUSS
        .iter()
        .map(|(node, weight)| weight * f(middle + half * node))
        .sum::<f64>()
        * half
}

/// The path of a route, for a robot that starts at a pose (m, m, rad); files are looked for in
/// `folder`.
///
/// # Errors
/// The route makes no path: which field, what it must be, and what to do.
pub fn path(route: &Route, laps: u32, pose: [f64; 3], folder: &FilePath) -> Result<Path, Fault> {
    let once = match route {
        Route::Pieces { start, piece } => bent(start.unwrap_or(pose), &bends(piece)?)?,
        Route::Polyline {
            points,
            radius,
            closed,
        } => {
            let (start, bends) = rounded(points, *radius, *closed)?;
            bent(start, &bends)?
        }
        Route::Spline { points, closed } => through(points, *closed, "points")?,
        Route::File { file, x, y, closed } => {
            let columns = read_columns(&folder.join(file), &[x, y]).map_err(|problem| {
                fault(
                    "file",
                    problem,
                    "a CSV with a header row that names the columns",
                )
            })?;
            let points: Vec<[f64; 2]> = (0..columns[0].len())
                .map(|k| [columns[0][k], columns[1][k]])
                .collect();
            through(&points, *closed, "file")?
        }
    };
    repeated(once, laps)
}

/// The path driven several times.
fn repeated(once: Path, laps: u32) -> Result<Path, Fault> {
    if laps <= 1 {
        return Ok(once);
    }
    let last = once.points.len() - 1;
    let ends = [once.points[0], once.points[last]];
    let gap = appell_model::math::hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]);
    let turned = once.heading[last] - once.heading[0];
    let turns = (turned / std::f64::consts::TAU).round() * std::f64::consts::TAU;
    if gap > 1e-3 || (turned - turns).abs() > 1e-3 {
        return Err(fault(
            "laps",
            format!("must be 1 for a path that does not close, got {laps}"),
            "the end of the path must be its start, with the same heading; or add closed = true",
        ));
    }
    if once.points.len() as f64 * f64::from(laps) > POINTS_MAX {
        return Err(fault(
            "laps",
            format!(
                "must make a path of at most {POINTS_MAX} points, got {laps} times {}",
                once.points.len()
            ),
            "ask for fewer laps",
        ));
    }
    let mut path = once.clone();
    for lap in 1..laps {
        path.points.extend_from_slice(&once.points[1..]);
        path.curvature.extend_from_slice(&once.curvature[1..]);
        let shift = f64::from(lap) * turns;
        path.heading
            .extend(once.heading[1..].iter().map(|heading| heading + shift));
    }
    path.length = once.length * f64::from(laps);
    Ok(path)
}

/// The bends of the pieces.
fn bends(pieces: &[Piece]) -> Result<Vec<Bend>, Fault> {
    let positive = |k: usize, field: &str, value: f64| {
        if value > 0.0 && value.is_finite() {
            return Ok(());
        }
        Err(fault(
            format!("piece.{k}.{field}"),
            format!("must be a finite number > 0, got {value:?}"),
            "",
        ))
    };
    let finite = |k: usize, field: &str, value: f64| {
        if value.is_finite() {
            return Ok(());
        }
        Err(fault(
            format!("piece.{k}.{field}"),
            format!("must be finite, got {value}"),
            "",
        ))
    };
    let mut bends: Vec<Bend> = Vec::with_capacity(pieces.len());
    for (k, piece) in pieces.iter().enumerate() {
        let bend = match *piece {
            Piece::Line { length } => {
                positive(k, "length", length)?;
                Bend {
                    length,
                    ends: [0.0; 2],
                }
            }
            Piece::Arc { radius, angle_deg } => {
                positive(k, "radius", radius)?;
                finite(k, "angle_deg", angle_deg)?;
                if angle_deg == 0.0 {
                    let problem =
                        "must be another angle than 0: positive to the left, negative to the right";
                    return Err(fault(format!("piece.{k}.angle_deg"), problem, ""));
                }
                Bend {
                    length: radius * angle_deg.abs().to_radians(),
                    ends: [1.0_f64.copysign(angle_deg) / radius; 2],
                }
            }
            Piece::Clothoid { length, from, to } => {
                positive(k, "length", length)?;
                finite(k, "to", to)?;
                finite(k, "from", from.unwrap_or(0.0))?;
                let before = bends.last().map_or(0.0, |bend| bend.ends[1]);
                Bend {
                    length,
                    ends: [from.unwrap_or(before), to],
                }
            }
        };
        bends.push(bend);
    }
    if bends.is_empty() {
        return Err(fault(
            "piece",
            "must have at least one entry",
            "for example { kind = \"line\", length = 2.0 }",
        ));
    }
    Ok(bends)
}

/// Number of equal intervals of a path, and their length.
fn spacing(length: f64, curvature: f64) -> Result<(usize, f64), Fault> {
    let count = (length / SPACING.min(TURN_MAX / curvature.max(1e-9))).ceil();
    if length.is_nan() || length > LENGTH_MAX {
        let problem = format!("must be at most {LENGTH_MAX} m long, got {length:.1} m");
        return Err(fault("", problem, ""));
    }
    if curvature.is_nan() || curvature > CURVATURE_MAX || count > POINTS_MAX {
        let problem = format!(
            "must have no curve tighter than {:.0} mm, got a radius of {:.3e} m",
            1e3 / CURVATURE_MAX,
            1.0 / curvature
        );
        return Err(fault("", problem, "widen the curve"));
    }
    let count = count.max(2.0);
    Ok((count as usize, length / count))
}

/// The path of bends that begin at a pose. `[eq:clothoid]`
fn bent(start: [f64; 3], bends: &[Bend]) -> Result<Path, Fault> {
    if !start.iter().all(|value| value.is_finite()) {
        return Err(fault("start", format!("must be finite, got {start:?}"), ""));
    }
    let length: f64 = bends.iter().map(|bend| bend.length).sum();
    let sharpest = bends
        .iter()
        .flat_map(|bend| bend.ends)
        .fold(0.0_f64, |most, curvature| most.max(curvature.abs()));
    let (count, ds) = spacing(length, sharpest)?;
    let mut path = Path {
        ds,
        points: Vec::with_capacity(count + 1),
        heading: Vec::with_capacity(count + 1),
        curvature: Vec::with_capacity(count + 1),
        length,
    };
    // Pose at the length `from` of bend `k`, up to which the path has been walked.
    let ([mut x, mut y, mut yaw], mut k, mut from, mut passed) = (start, 0, 0.0, 0.0);
    for index in 0..=count {
        let s = index as f64 * ds;
        loop {
            let Bend { length, ends } = bends[k];
            let slope = (ends[1] - ends[0]) / length;
            // The last bend also takes what rounding leaves over.
            let ends_here = k + 1 < bends.len() && passed + length <= s;
            let to = if ends_here { length } else { s - passed };
            let heading = |at: f64| {
                let way = at - from;
                yaw + way * (ends[0] + slope * (from + 0.5 * way))
            };
            let step = [
                integral(from, to, |at| sin_cos(heading(at)).1),
                integral(from, to, |at| sin_cos(heading(at)).0),
            ];
            let next = heading(to);
            (x, y, yaw) = (x + step[0], y + step[1], next);
            if !ends_here {
                from = to;
                path.points.push([x, y]);
                path.heading.push(yaw);
                path.curvature.push(ends[0] + slope * to);
                break;
            }
            (k, from, passed) = (k + 1, 0.0, passed + length);
        }
    }
    Ok(path)
}

/// Start and bends of a polygon whose corners are rounded by arcs.
fn rounded(
    corners: &[[f64; 2]],
    radius: f64,
    closed: bool,
) -> Result<([f64; 3], Vec<Bend>), Fault> {
    distinct(corners, closed, "points")?;
    let least = if closed { 3 } else { 2 };
    if corners.len() < least {
        return Err(fault(
            "points",
            format!("must be at least {least} corners, got {}", corners.len()),
            "",
        ));
    }
    if !(radius > 0.0 && radius.is_finite()) {
        return Err(fault(
            "radius",
            format!("must be a finite number > 0, got {radius:?}"),
            "corners are rounded by arcs",
        ));
    }
    // A closed one begins in the middle of its first edge.
    let mut points = corners.to_vec();
    if closed {
        let middle = [0, 1].map(|axis| 0.5 * (corners[0][axis] + corners[1][axis]));
        points.rotate_left(1);
        points.insert(0, middle);
        points.push(middle);
    }
    let edges: Vec<[f64; 2]> = points
        .windows(2)
        .map(|pair| [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]])
        .collect();
    let lengths: Vec<f64> = edges
        .iter()
        .map(|edge| appell_model::math::hypot(edge[0], edge[1]))
        .collect();
    // Turn at the end of each edge but the last, and what the arc takes of the edges.
    let turns: Vec<f64> = edges
        .windows(2)
        .map(|pair| {
            let cross = pair[0][0] * pair[1][1] - pair[0][1] * pair[1][0];
            atan2(cross, pair[0][0] * pair[1][0] + pair[0][1] * pair[1][1])
        })
        .collect();
    let share = |turn: f64| {
        let (sin, cos) = sin_cos(0.5 * turn.abs());
        sin / cos.max(1e-9)
    };
    let mut bends = Vec::new();
    let mut taken = 0.0;
    for (k, &length) in lengths.iter().enumerate() {
        let turn = turns.get(k).copied().unwrap_or(0.0);
        let cut = radius * share(turn);
        let straight = length - taken - cut;
        if straight < -1e-9 {
            let shares = share(turn) + if k > 0 { share(turns[k - 1]) } else { 0.0 };
            let [a, b] = [points[k], points[k + 1]];
            return Err(fault(
                "radius",
                format!(
                    "must leave the edge from ({}, {}) to ({}, {}) its {length:.3} m, got {radius}",
                    a[0], a[1], b[0], b[1]
                ),
                &match (length / shares * 1e3).floor() / 1e3 {
                    0.0 => "the path turns back there: put the corners apart".to_owned(),
                    fits => format!("{fits:.3} would do there, or corners farther apart"),
                },
            ));
        }
        if straight > 0.0 {
            bends.push(Bend {
                length: straight,
                ends: [0.0; 2],
            });
        }
        if turn != 0.0 {
            bends.push(Bend {
                length: radius * turn.abs(),
                ends: [1.0_f64.copysign(turn) / radius; 2],
            });
        }
        taken = cut;
    }
    let yaw = atan2(edges[0][1], edges[0][0]);
    Ok(([points[0][0], points[0][1], yaw], bends))
}

/// Refuses points that are not finite, and neighbors in one place.
fn distinct(points: &[[f64; 2]], closed: bool, field: &str) -> Result<(), Fault> {
    let count = points.len();
    for (k, point) in points.iter().enumerate() {
        if !point.iter().all(|value| value.is_finite()) {
            return Err(fault(field, format!("must be finite, got {point:?}"), ""));
        }
        let next = points[(k + 1) % count];
        if (k + 1 < count || closed && count > 1)
            && appell_model::math::hypot(next[0] - point[0], next[1] - point[1]) < 1e-6
        {
            return Err(fault(
                field,
                format!("must differ from the next one, got {point:?} twice"),
                "a closed path goes back to its first point by itself",
            ));
        }
    }
    Ok(())
}

/// A smooth path through points: cubic splines of the length of the chords, walked at equal steps
/// of their own length.
fn through(points: &[[f64; 2]], closed: bool, field: &str) -> Result<Path, Fault> {
    let least = if closed { 3 } else { 4 };
    if points.len() < least {
        return Err(fault(
            field,
            format!("must be at least {least} points, got {}", points.len()),
            "fewer make a route of kind \"polyline\"",
        ));
    }
    if points.len() as f64 > POINTS_MAX {
        return Err(fault(
            field,
            format!("must be at most {POINTS_MAX} points, got {}", points.len()),
            "",
        ));
    }
    distinct(points, closed, field)?;
    let mut knots = points.to_vec();
    if closed {
        knots.push(points[0]);
    }
    let mut chords = vec![0.0];
    for pair in knots.windows(2) {
        let chord = appell_model::math::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        chords.push(chords[chords.len() - 1] + chord);
    }
    let curve = [0, 1].map(|axis| {
        let values: Vec<f64> = knots.iter().map(|knot| knot[axis]).collect();
        if closed {
            Spline::periodic(&chords, &values)
        } else {
            Spline::new(&chords, &values)
        }
    });
    let at = |u: f64| [curve[0].at(u), curve[1].at(u)];
    let speed = |u: f64| {
        let [x, y] = at(u);
        appell_model::math::hypot(x[1], y[1])
    };
    let bend = |u: f64| {
        let [x, y] = at(u);
        let speed = speed(u).max(1e-12);
        (x[1] * y[2] - y[1] * x[2]) / (speed * speed * speed)
    };
    // Lengths up to equal parts of each stretch between knots.
    const PARTS: usize = 8;
    let (mut table, mut length, mut sharpest) = (vec![(0.0, 0.0)], 0.0, bend(0.0).abs());
    for pair in chords.windows(2) {
        for part in 0..PARTS {
            let [from, to] =
                [part, part + 1].map(|p| pair[0] + (pair[1] - pair[0]) * p as f64 / PARTS as f64);
            length += integral(from, to, speed);
            sharpest = f64::max(sharpest, bend(to).abs());
            table.push((to, length));
        }
    }
    let (count, ds) = spacing(length, sharpest)?;
    let mut path = Path {
        ds,
        points: Vec::with_capacity(count + 1),
        heading: Vec::with_capacity(count + 1),
        curvature: Vec::with_capacity(count + 1),
        length,
    };
    let mut entry = 0;
    for index in 0..=count {
        let s = (index as f64 * ds).min(length);
        while entry + 2 < table.len() && table[entry + 1].1 <= s {
            entry += 1;
        }
        let ((from, before), (to, after)) = (table[entry], table[entry + 1]);
        // Newton's method on the length; it starts closer than a part.
        let mut u = from + (to - from) * (s - before) / (after - before);
        for _ in 0..4 {
            u -= (before + integral(from, u, speed) - s) / speed(u).max(1e-12);
        }
        let [x, y] = at(u);
        let angle = atan2(y[1], x[1]);
        let previous = path.heading.last().copied().unwrap_or(angle);
        path.points.push([x[0], y[0]]);
        path.heading
            .push(previous + appell_model::math::wrap_angle(angle - previous));
        path.curvature.push(bend(u));
    }
    Ok(path)
}

#[cfg(test)]
mod tests;
