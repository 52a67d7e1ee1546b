//! A path as a follower reads it, one in each lane.

use std::sync::Arc;

use appell_model::lanes::LANES_MAX;
use appell_model::lanewise::Lanewise;
use appell_model::scalar::Scalar;

use crate::plan::{Path, SpeedLimits, speed_profile};

/// A path, its points side by side in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Arc length between neighboring points, m.
    ds: f64,
    length: f64,
    /// x, y, heading and curvature of each point but the last, and those of the next: what is read together stands
    /// together.
    rows: Arc<[[f64; 8]]>,
}

impl Track {
    /// The points of a path.
    pub fn new(path: &Path) -> Self {
        let point = |k: usize| {
            let [x, y] = path.points[k];
            [x, y, path.heading[k], path.curvature[k]]
        };
        let last = path.points.len() - 1;
        let row = |k: usize| {
            let mut row = [0.0; 8];
            row[..4].copy_from_slice(&point(k));
            row[4..].copy_from_slice(&point(last.min(k + 1)));
            row
        };
        Track {
            ds: path.ds,
            length: path.length,
            rows: (0..last.max(1)).map(row).collect(),
        }
    }

    /// Squared largest speed at each point that keeps the limits, from rest to rest, m²/s²: speed, m/s,
    /// acceleration along and across the path, m/s², and yaw rate, rad/s.
    pub fn squared_limits<T: Scalar>(&self, limits: &SpeedLimits<T>) -> Vec<T> {
        let last = self.rows[self.rows.len() - 1][7];
        let curvature = self.rows.iter().map(|row| row[3]).chain([last]);
        let speed = speed_profile(curvature, self.ds, limits).into_iter();
        speed.map(|v| v * v).collect()
    }
}

/// The paths of all lanes, with their speed limits.
#[derive(Clone, Debug)]
pub struct Tracks<T: Scalar> {
    rows: Vec<Arc<[[f64; 8]]>>,
    /// Squared speed limit at each point, m²/s².
    limits: Vec<Arc<Vec<T::Single>>>,
    ds: T,
    /// Length of the path, m.
    pub length: T,
    /// Index of the last point.
    last: T,
}

/// A point of a path.
#[derive(Clone, Copy, Debug)]
pub struct Point<T> {
    /// x and y, m.
    pub place: [T; 2],
    /// Direction of the path, rad.
    pub heading: T,
    /// Curvature, positive to the left, 1/m.
    pub curvature: T,
}

impl<T: Scalar> Tracks<T> {
    /// The same path in all lanes.
    pub fn new(path: &Track, limits: Arc<Vec<T::Single>>) -> Self {
        Tracks {
            ds: T::from(path.ds),
            length: T::from(path.length),
            last: T::from(path.rows.len() as f64),
            rows: vec![path.rows.clone(); T::LANES],
            limits: vec![limits; T::LANES],
        }
    }

    /// How many points lie before arc length s, m, with the fraction of the next step.
    #[inline(always)]
    fn steps(&self, s: T) -> T {
        let positive = T::zero().less(self.ds);
        let ds = T::select(positive, self.ds, T::one());
        let steps = (s / ds).max(T::zero()).min(self.last);
        T::select(positive, steps, T::zero())
    }

    /// The number of the point before each lane's place, and how far it lies behind, in steps.
    #[inline(always)]
    fn before(&self, steps: T) -> (T, T) {
        let whole = steps.floor().min(self.last - T::one()).max(T::zero());
        (whole, steps - whole)
    }

    /// The point at arc length `s`, m, which is clamped to the path.
    #[inline(always)]
    pub fn at(&self, s: T) -> Point<T> {
        let (whole, fraction) = self.before(self.steps(s));
        // A point and the next.
        let mut rows = [&[0.0; 8]; LANES_MAX];
        for lane in 0..T::LANES {
            let path = &self.rows[lane];
            rows[lane] = &path[index(whole, lane).min(path.len() - 1)];
        }
        let columns = T::columns(&rows);
        let mut mixed = [T::zero(); 4];
        for of in 0..4 {
            let (from, to) = (columns[of], columns[4 + of]);
            mixed[of] = from + fraction * (to - from);
        }
        let [x, y, heading, curvature] = mixed;
        Point {
            place: [x, y],
            heading,
            curvature,
        }
    }

    /// Speed limit at arc length s, m/s, under an acceleration, m/s²: between points the lowest of
    /// what can be reached from the one before, be braked from to the one after, and is allowed at
    /// either.
    #[inline(always)]
    pub fn limit(&self, s: T, acceleration: T) -> T {
        let (whole, share) = self.before(self.steps(s));
        let limit = |lane: usize, ahead: usize| {
            let limits = &self.limits[lane];
            limits[index(whole, lane).min(limits.len() - 2) + ahead]
        };
        let before = T::from_singles(|lane| limit(lane, 0));
        let after = T::from_singles(|lane| limit(lane, 1));
        let gain = T::from(2.0) * acceleration * self.ds;
        let reached = before + share * gain;
        let braked = after + (T::one() - share) * gain;
        reached.min(braked).min(before.max(after)).sqrt()
    }
}

/// A whole number of a lane, below 2³². A cast would ask for NaN and for bounds, lane after lane.
#[inline(always)]
fn index<T: Scalar>(whole: T, lane: usize) -> usize {
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    (whole.lane(lane) + TWO_52).to_bits() as u32 as usize
}

impl<T: Scalar> Lanewise for Tracks<T> {
    type One = Tracks<f64>;

    fn fits(&self, _one: &Tracks<f64>) -> bool {
        true
    }

    fn put(&mut self, lane: usize, one: &Tracks<f64>) {
        self.rows[lane] = one.rows[0].clone();
        let limits: &dyn std::any::Any = &one.limits[0];
        self.limits[lane] = match limits.downcast_ref::<Arc<Vec<T::Single>>>() {
            Some(same) => same.clone(),
            None => Arc::new(one.limits[0].iter().map(|&v| T::Single::from(v)).collect()),
        };
        self.ds.put(lane, &one.ds);
        self.length.put(lane, &one.length);
        self.last.put(lane, &one.last);
    }
}
