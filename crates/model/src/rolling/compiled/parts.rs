//! Parts of a platform of constant geometry: what feeds it, what follows, and what a step is charged.

use super::along;
use crate::drive::Winding;
use crate::lanewise;
use crate::planar::{Vec2, vec2};
use crate::rolling::axle::Action;
use crate::scalar::Scalar;

lanewise!(Feed[U] {} state { slope, decay, emf, window, push });
lanewise!(Follower[U] {} state { pivot, per_trail, per_radius });

/// A motor whose current is a state, multiplied out over the velocity coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Feed<T, const U: usize> {
    /// 1/L, 1/H, and R/L, 1/s.
    pub(super) slope: T,
    pub(super) decay: T,
    /// Back-EMF over L, per rate of the axle.
    pub(super) emf: T,
    /// R I_max / L, A/s: what the current may change by beside its decay before the driver limits it.
    pub(super) window: T,
    /// Acceleration per current.
    pub(super) push: [T; U],
}

impl<T: Scalar, const U: usize> Feed<T, U> {
    pub(super) fn new(winding: &Winding<T>, push: &[T; U]) -> Self {
        Feed {
            slope: winding.slope,
            decay: winding.resistance * winding.slope,
            emf: winding.emf * winding.slope,
            window: winding.window * winding.slope,
            push: push.map(|push| push * winding.torque),
        }
    }
}

/// A caster that follows the motion, its divisions multiplied out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Follower<T, const U: usize> {
    /// Velocity of its pivot, rows over v.
    pub(super) pivot: [[T; U]; 2],
    pub(super) per_trail: T,
    pub(super) per_radius: T,
}

impl<T: Scalar, const U: usize> Follower<T, U> {
    /// Speeds of the pivot across and along the wheel plane: the contact lies behind the pivot along
    /// that plane, so that it moves forward as the pivot does.
    #[inline(always)]
    pub(super) fn speeds(&self, cos: T, sin: T, v: &[T; U]) -> (T, T) {
        let forward = vec2(cos, sin);
        let pivot = vec2(along(&self.pivot[0], v), along(&self.pivot[1], v));
        (forward.perpendicular().dot(pivot), forward.dot(pivot))
    }

    /// γ̇ and φ̇.
    #[inline(always)]
    pub(super) fn rates(&self, cos: T, sin: T, v: &[T; U], yaw_rate: T) -> (T, T) {
        let (across, forward) = self.speeds(cos, sin, v);
        (
            across.mul_add(self.per_trail, -yaw_rate),
            forward * self.per_radius,
        )
    }
}

/// Powers of the energy ledger, W.
pub(super) struct Bill<T> {
    pub(super) supplied: T,
    pub(super) windings: T,
    pub(super) gears: T,
    pub(super) friction: T,
}

impl<T: Scalar> Bill<T> {
    #[inline(always)]
    pub(super) fn new() -> Self {
        let zero = T::zero();
        Bill {
            supplied: zero,
            windings: zero,
            gears: zero,
            friction: zero,
        }
    }

    #[inline(always)]
    pub(super) fn add(&mut self, action: &Action<T>) {
        self.supplied += action.supplied;
        self.windings += action.windings;
        self.gears += action.gears;
        self.friction += action.rubbed;
    }

    /// Adds what the wrench supplies and writes the rates of the ledger.
    #[inline(always)]
    pub(super) fn close(
        &mut self,
        wrench: &Option<[T; 3]>,
        velocity: Vec2<T>,
        yaw_rate: T,
        rates: &mut [T],
    ) {
        if let Some(outside) = wrench {
            self.supplied += outside[0].mul_add(
                velocity.x,
                outside[1].mul_add(velocity.y, outside[2] * yaw_rate),
            );
        }
        rates[0] = self.supplied;
        rates[1] = self.windings;
        rates[2] = self.gears;
        rates[3] = self.friction;
    }
}
