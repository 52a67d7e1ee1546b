//! Plane geometry of judging: lines that are crossed, distances, fractions of a segment. World frame,
//! m; decisions go by values, so that derivatives pass through.

use appell_model::scalar::Scalar;
use serde::{Deserialize, Serialize};

/// A directed line in the plane, through `origin`, crossed forward along `normal`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Line {
    pub origin: [f64; 2],
    pub normal: [f64; 2],
}

/// A segment crossing a [`Line`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing<S> {
    /// Fraction of the segment.
    pub fraction: S,
    /// Whether along the normal.
    pub forward: bool,
    /// Place on the line, from the origin along Ω·normal (to the left of the normal), m.
    pub offset: S,
}

impl Line {
    /// The line through `origin` whose normal points from `from` to `to`.
    pub fn across(origin: [f64; 2], from: [f64; 2], to: [f64; 2]) -> Self {
        let along = difference(to, from);
        let length = dot(along, along).sqrt();
        let normal = [along[0] / length, along[1] / length];
        Self { origin, normal }
    }

    /// Signed distance of a point, positive on the side the normal points to, m.
    #[inline(always)]
    pub fn distance<S: Scalar>(&self, p: [S; 2]) -> S {
        dot(difference(p, lift(self.origin)), lift(self.normal))
    }

    #[inline(always)]
    pub fn crossing<S: Scalar>(&self, p: [S; 2], q: [S; 2]) -> Option<Crossing<S>> {
        let (f, g) = (self.distance(p), self.distance(q));
        let forward = value(f) < 0.0;
        if forward == (value(g) < 0.0) {
            return None;
        }
        let fraction = f / (f - g);
        let left = lift([-self.normal[1], self.normal[0]]);
        let from = difference(between(p, q, fraction), lift(self.origin));
        Some(Crossing {
            fraction,
            forward,
            offset: dot(from, left),
        })
    }
}

/// What decisions are made by: the number without its derivatives.
#[inline(always)]
pub(super) fn value<S: Scalar>(number: S) -> f64 {
    number.lane(0)
}

/// A point without derivatives. `map` of an array would stay a call.
#[inline(always)]
pub(super) fn lift<S: Scalar>(point: [f64; 2]) -> [S; 2] {
    [S::from(point[0]), S::from(point[1])]
}

#[inline(always)]
pub(crate) fn dot<S: Scalar>(a: [S; 2], b: [S; 2]) -> S {
    a[0] * b[0] + a[1] * b[1]
}

#[inline(always)]
pub(crate) fn difference<S: Scalar>(a: [S; 2], b: [S; 2]) -> [S; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

#[inline(always)]
pub(crate) fn distance<S: Scalar>(a: [S; 2], b: [S; 2]) -> S {
    let d = difference(a, b);
    dot(d, d).sqrt()
}

/// The point at a fraction of the segment from `p` to `q`.
#[inline(always)]
pub(crate) fn between<S: Scalar>(p: [S; 2], q: [S; 2], fraction: S) -> [S; 2] {
    [
        p[0] + fraction * (q[0] - p[0]),
        p[1] + fraction * (q[1] - p[1]),
    ]
}

/// The nearest fraction of a segment, within it.
#[inline(always)]
pub(super) fn within<S: Scalar>(fraction: S) -> S {
    fraction.max(S::zero()).min(S::one())
}

/// Distance of point `c` to the segment from `p` to `q`, m.
#[inline(always)]
pub(crate) fn segment_distance<S: Scalar>(c: [S; 2], p: [S; 2], q: [S; 2]) -> S {
    let along = difference(q, p);
    let square = dot(along, along);
    let rests = square.less_equal(S::zero());
    let fraction = within(dot(difference(c, p), along) / square);
    let fraction = S::select(rests, S::zero(), fraction);
    distance(c, between(p, q, fraction))
}

/// Smallest distance to the walls from inside, m; negative outside.
#[inline(always)]
pub(crate) fn wall_distance<S: Scalar>([width, depth]: [S; 2], p: [S; 2]) -> S {
    p[0].min(width - p[0]).min(p[1].min(depth - p[1]))
}

/// Fraction of the segment at which it first comes within `radius` of `c`; 0 if it begins there.
pub(super) fn touch_fraction<S: Scalar>(c: [S; 2], radius: f64, p: [S; 2], q: [S; 2]) -> S {
    let (from, along) = (difference(p, c), difference(q, p));
    let (square, half) = (dot(along, along), dot(from, along));
    let excess = dot(from, from) - S::from(radius * radius);
    if value(excess) <= 0.0 || value(square) == 0.0 {
        return S::zero();
    }
    let root = (half * half - square * excess).max(S::zero()).sqrt();
    within((-half - root) / square)
}

/// Fraction of the segment, ending outside, at which it leaves the arena shrunk by `margin`.
pub(super) fn leave_fraction<S: Scalar>(arena: [f64; 2], margin: f64, p: [S; 2], q: [S; 2]) -> S {
    let mut fraction = S::one();
    for axis in 0..2 {
        let far = S::from(arena[axis]);
        for (a, b) in [(p[axis], q[axis]), (far - p[axis], far - q[axis])] {
            if value(b) < margin {
                let before = a - S::from(margin);
                let share = if value(before) <= 0.0 {
                    S::zero()
                } else {
                    before / (a - b)
                };
                fraction = fraction.min(share);
            }
        }
    }
    fraction
}

/// Angle from `a` to `b` seen from `c`, in (−π, π], rad.
pub(super) fn turn<S: Scalar>(c: [S; 2], a: [S; 2], b: [S; 2]) -> S {
    let (a, b) = (difference(a, c), difference(b, c));
    (a[0] * b[1] - a[1] * b[0]).atan2(dot(a, b))
}
