//! What a judge sees of the way between two samples, whatever the task is: in lanes, for many judges.

use appell_model::lanewise;
use appell_model::scalar::{Mask, Scalar};
use serde::{Deserialize, Serialize};

use super::Sample;
use super::geometry::{distance, segment_distance, wall_distance};
use crate::layout::Layout;

/// The straight way to a sample: what lies beside it, m.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Glance<S> {
    from: [S; 2],
    /// Where it ends.
    pub to: [S; 2],
    /// Its length.
    pub way: S,
    /// Smallest distance between the robot's disc and a beacon, and the index of that beacon.
    pub gap: S,
    pub beacon: S,
    /// Distance between the disc and the walls at the end.
    pub wall: S,
}

impl<S: Scalar> Glance<S> {
    /// A way in an arena without beacons, of a robot with a collision radius.
    #[inline(always)]
    pub fn of_walls(arena: [S; 2], radius: S, from: [S; 2], to: [S; 2]) -> Self {
        Glance {
            from,
            to,
            way: distance(from, to),
            gap: S::from(f64::INFINITY),
            beacon: S::zero(),
            wall: wall_distance(arena, to) - radius,
        }
    }

    /// Looks at a beacon, with the radii of robot and beacon.
    #[inline(always)]
    pub fn pass(&mut self, index: usize, center: [S; 2], radii: [S; 2]) {
        let gap = segment_distance(center, self.from, self.to) - radii[0] - radii[1];
        let nearer = gap.less(self.gap);
        self.gap = S::select(nearer, gap, self.gap);
        self.beacon = S::select(nearer, S::from(index as f64), self.beacon);
    }

    /// What is seen in one lane.
    #[inline(always)]
    pub fn single(&self, lane: usize) -> Glance<S::Single> {
        Glance {
            from: [self.from[0].single(lane), self.from[1].single(lane)],
            to: [self.to[0].single(lane), self.to[1].single(lane)],
            way: self.way.single(lane),
            gap: self.gap.single(lane),
            beacon: self.beacon.single(lane),
            wall: self.wall.single(lane),
        }
    }
}

/// What judges keep watching on the way, whatever the task is. Most samples are of no further importance, and
/// those that may be are found here: in lanes, for many judges.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Watch<S> {
    /// The last sample.
    pub last: Sample<S>,
    /// Way so far, m.
    pub way: S,
    /// Smallest distance between the disc and a beacon so far, m, its time, s, and the index of that beacon.
    pub gap: S,
    pub gap_time: S,
    pub beacon: S,
    /// Smallest distance between the disc and a wall so far, m, and its time, s.
    pub wall: S,
    pub wall_time: S,
    /// How far the robot can still go before anything can become of its task, m.
    pub calm: S,
}

impl<S: Scalar> Watch<S> {
    /// Before the first sample.
    pub fn new() -> Self {
        let [zero, most] = [S::zero(), S::from(S::LARGEST)];
        Watch {
            last: Sample {
                t: zero,
                position: [zero; 2],
            },
            way: zero,
            gap: most,
            gap_time: zero,
            beacon: zero,
            wall: most,
            wall_time: zero,
            calm: zero,
        }
    }

    /// Begins anew, in some lanes, where the robot is.
    pub fn begin(&mut self, [x, y]: [S; 2], of: S::Mask) {
        let new = Watch::new();
        self.last.position = [
            S::select(of, x, self.last.position[0]),
            S::select(of, y, self.last.position[1]),
        ];
        for (value, begin) in [
            (&mut self.last.t, new.last.t),
            (&mut self.way, new.way),
            (&mut self.gap, new.gap),
            (&mut self.gap_time, new.gap_time),
            (&mut self.beacon, new.beacon),
            (&mut self.wall, new.wall),
            (&mut self.wall_time, new.wall_time),
            (&mut self.calm, new.calm),
        ] {
            *value = S::select(of, begin, *value);
        }
    }

    /// Sees a sample, in some lanes; those of them that their judge must look at.
    #[inline(always)]
    pub fn pass(&mut self, t: S, speed: S, glance: &Glance<S>, of: S::Mask) -> S::Mask {
        let [x, y] = glance.to;
        let finite = x.is_finite().and(y.is_finite());
        let finite = finite.and(t.is_finite()).and(speed.is_finite());
        let seen = of.and(finite);
        self.way = S::select(seen, self.way + glance.way, self.way);
        let nearer = seen.and(glance.gap.less(self.gap));
        self.gap = S::select(nearer, glance.gap, self.gap);
        self.gap_time = S::select(nearer, t, self.gap_time);
        self.beacon = S::select(nearer, glance.beacon, self.beacon);
        let nearer = seen.and(glance.wall.less(self.wall));
        self.wall = S::select(nearer, glance.wall, self.wall);
        self.wall_time = S::select(nearer, t, self.wall_time);
        self.calm = S::select(seen, self.calm - glance.way, self.calm);
        let [east, north] = self.last.position;
        self.last.t = S::select(seen, t, self.last.t);
        self.last.position = [S::select(seen, x, east), S::select(seen, y, north)];
        let touches = glance.gap.less(S::zero()).or(glance.wall.less(S::zero()));
        let calm = S::zero().less(self.calm).and(touches.not());
        of.and(seen.and(calm).not())
    }

    /// What is watched in one lane.
    pub fn single(&self, lane: usize) -> Watch<S::Single> {
        Watch {
            last: self.last.single(lane),
            way: self.way.single(lane),
            gap: self.gap.single(lane),
            gap_time: self.gap_time.single(lane),
            beacon: self.beacon.single(lane),
            wall: self.wall.single(lane),
            wall_time: self.wall_time.single(lane),
            calm: self.calm.single(lane),
        }
    }
}

/// What stands around a robot, m.
pub(crate) struct Rings<T> {
    pub arena: [T; 2],
    /// Collision radius of the robot.
    pub radius: T,
    /// Place and radius of each beacon.
    pub beacons: Vec<[T; 3]>,
}

lanewise!(Rings {} state { arena, radius, beacons });

impl<T: Scalar> Rings<T> {
    pub fn new(layout: &Layout) -> Self {
        let beacons = layout.beacons.iter().map(|beacon| {
            let [x, y] = beacon.position;
            [x, y, beacon.radius].map(T::from)
        });
        Rings {
            arena: layout.arena.map(T::from),
            radius: T::from(layout.collision_radius),
            beacons: beacons.collect(),
        }
    }

    /// What is seen on a way.
    #[inline(always)]
    pub fn glance(&self, from: [T; 2], to: [T; 2]) -> Glance<T> {
        let mut glance = Glance::of_walls(self.arena, self.radius, from, to);
        for k in 0..self.beacons.len() {
            let [x, y, radius] = self.beacons[k];
            glance.pass(k, [x, y], [self.radius, radius]);
        }
        glance
    }
}
