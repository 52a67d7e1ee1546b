//! What judges see of a world.

use appell_model::math::hypot;
use appell_model::scalar::Scalar;
use appell_model::wide::Job;

use super::LANES_MAX;
use crate::layout::{Beacon, Layout};

/// Place of each beacon and sum of its radius and the robot's, m.
pub(super) fn rings<T: Scalar>(layout: &Layout) -> Vec<[T; 3]> {
    let ring = |beacon: &Beacon| {
        let [x, y] = beacon.position;
        [x, y, beacon.radius + layout.collision_radius].map(T::from)
    };
    layout.beacons.iter().map(ring).collect()
}

/// What a judge sees: the distance between the robot's disc and the nearest beacon, m, negative inside;
/// and of each lane position, m, and speed, m/s.
pub(super) struct Look<'a, T> {
    pub(super) beacons: &'a [[T; 3]],
    /// x, y, forward and left speed.
    pub(super) motion: [T; 4],
}

impl<T: Scalar> Job for Look<'_, T> {
    type Output = (T, [[T::Single; 3]; LANES_MAX]);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let [x, y, forward, left] = self.motion;
        let mut nearest = T::from(f64::MAX);
        for k in 0..self.beacons.len() {
            let [east, north, radius] = self.beacons[k];
            nearest = nearest.min(hypot(x - east, y - north) - radius);
        }
        let speed = crate::plant::speed(forward, left);
        let mut seen = [[T::Single::zero(); 3]; LANES_MAX];
        for lane in 0..T::LANES {
            seen[lane] = [x.single(lane), y.single(lane), speed.single(lane)];
        }
        (nearest, seen)
    }
}
