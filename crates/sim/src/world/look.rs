//! What judges see of a world.

use appell_model::lanes::LANES_MAX;
use appell_model::math::hypot;
use appell_model::scalar::Scalar;
use appell_model::wide::Job;

use crate::judge::{Glance, Rings};

/// A look at a robot: the distance between its disc and the nearest beacon now, m, negative inside; and of
/// each lane what its judge is told, and the speed, m/s.
pub(super) struct Look<'a, T> {
    pub(super) rings: &'a Rings<T>,
    /// Where the judges saw it last.
    pub(super) before: [T; 2],
    /// x, y, forward and left speed.
    pub(super) motion: [T; 4],
}

impl<T: Scalar> Job for Look<'_, T> {
    type Output = (T, [(Glance<T::Single>, T::Single); LANES_MAX]);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let [x, y, forward, left] = self.motion;
        let mut nearest = T::from(T::LARGEST);
        for k in 0..self.rings.beacons.len() {
            let [east, north, radius] = self.rings.beacons[k];
            let away = hypot(x - east, y - north);
            nearest = nearest.min(away - (radius + self.rings.radius));
        }
        let glance = self.rings.glance(self.before, [x, y]);
        let speed = crate::plant::speed(forward, left);
        let mut seen = [(glance.single(0), speed.single(0)); LANES_MAX];
        for lane in 1..T::LANES {
            seen[lane] = (glance.single(lane), speed.single(lane));
        }
        (nearest, seen)
    }
}
