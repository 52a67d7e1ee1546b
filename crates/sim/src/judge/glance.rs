//! What a judge sees of the way between two samples, whatever the task is: in lanes, for many judges.

use appell_model::lanewise;
use appell_model::scalar::Scalar;

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
