//! Wheels that slip on uneven ground: what the ground does to a robot that lies on it, and to each of
//! its contacts. `[eq:slip-uneven]`

use super::sprung::Spring;
use super::{Axes, Slip};
use crate::planar::{Vec2, vec2};
use crate::platform::{MAX_WHEELS, YAW};
use crate::scalar::Scalar;
use crate::solve::Row;
use crate::stance::{Footing, Stance, Standing};
use crate::support::Support;

/// Least by which the load at rest is divided: a contact that its own force presses bears twice that load
/// at most. Where a wheel wedges itself against an edge, rigid bodies know no bound; this one is chosen.
const WEDGED: f64 = 0.5;

/// How a robot lies on uneven ground.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lie<T: Scalar> {
    pub(super) stance: Stance<T>,
    /// Loads before contacts ease themselves: Nᵢ = aᵢ + bᵢ · F.
    pub(super) loads: ([T; MAX_WHEELS], [Vec2<T>; MAX_WHEELS]),
    /// What each carries beyond its share on a plane, N.
    pub(super) beyond: [T; MAX_WHEELS],
    /// What bears it on springs.
    pub(super) spring: Option<Spring<T>>,
}

impl<T: Scalar> Lie<T> {
    fn new(stance: Stance<T>, system: &Slip<T>, support: &Support<T>) -> Self {
        let weight = system.mass * stance.gravity_normal;
        let center = system.first * (T::one() / system.mass);
        let (mut still, shift) = support.affine(weight, center, system.height, &stance.lifted);
        let mut beyond = [T::zero(); MAX_WHEELS];
        let push = vec2(stance.push[0], stance.push[1]);
        for i in 0..system.layout().wheels {
            // At rest F = −push, and each carries what the stance says.
            let at_rest = shift[i].dot(push) + stance.loads[i];
            beyond[i] = T::select(stance.lifted[i], T::zero(), at_rest - still[i]);
            still[i] = T::select(stance.lifted[i], T::zero(), at_rest);
        }
        Lie {
            stance,
            loads: (still, shift),
            beyond,
            spring: None,
        }
    }

    /// Slope of the ground under wheel i against the plane of the chassis, base axes.
    #[inline(always)]
    pub(super) fn slope(&self, i: usize) -> Vec2<T> {
        self.stance.gradients[i]
    }

    /// The loads without wheels that forces have lifted: what those carried beyond their share goes to
    /// the others.
    pub(super) fn without(
        &self,
        system: &Slip<T>,
        support: &Support<T>,
        lifted: &[T::Mask; MAX_WHEELS],
    ) -> ([T; MAX_WHEELS], [Vec2<T>; MAX_WHEELS]) {
        let mut weight = system.mass * self.stance.gravity_normal;
        let mut first = system.first * self.stance.gravity_normal;
        let wheels = system.platform.wheels();
        for (i, wheel) in wheels.iter().enumerate() {
            let moved = T::select(lifted[i], self.beyond[i], T::zero());
            weight += moved;
            first = first + wheel.mount * moved;
        }
        let center = first * (T::one() / weight);
        let (mut still, mut shift) = support.affine(weight, center, system.height, lifted);
        for i in 0..wheels.len() {
            still[i] = T::select(lifted[i], T::zero(), still[i] + self.beyond[i]);
            shift[i] = vec2(
                T::select(lifted[i], T::zero(), shift[i].x),
                T::select(lifted[i], T::zero(), shift[i].y),
            );
        }
        (still, shift)
    }

    /// Adds what gravity and the ground do in the plane of the chassis.
    pub(super) fn push(&self, system: &Slip<T>, x: &[T], force: &mut Row<T>) {
        for k in 0..3 {
            force[k] += self.stance.push[k];
        }
        let turns = self.stance.turns(&system.platform, x);
        for k in 0..system.layout().steered.len() {
            force[3 + k] += turns[k];
        }
    }
}

impl<T: Scalar> Axes<T> {
    /// The same where the ground is inclined against the plane of the chassis by a slope, base axes: the
    /// first stays over its direction, the second lies across it in the ground. Velocities in the
    /// ground follow from those in the plane, since the contact stays on the ground; forces the other way,
    /// by their power. `[eq:contact-tilt]`
    pub(super) fn tilted(self, slope: Vec2<T>, plain: bool) -> Self {
        let aside = self.along.perpendicular();
        let (ahead, across) = (slope.dot(self.along), slope.dot(aside));
        let length = ahead.mul_add(ahead, T::one()).sqrt();
        let whole = slope.dot(slope).mul_add(T::one(), T::one()).sqrt();
        let per = T::one() / length;
        let tilted = Axes {
            along: self.along * length + aside * (ahead * across * per),
            across: Vec2::zero(),
            lever: self.lever,
            ease: vec2(whole * ahead * per, T::zero()),
        };
        if !plain {
            return tilted;
        }
        Axes {
            across: self.across * (whole * per),
            ease: vec2(tilted.ease.x, across * per),
            ..tilted
        }
    }

    /// Slip velocity at a velocity of the contact in the plane, m/s, and a spin rate, rad/s.
    #[inline(always)]
    pub(super) fn slip(&self, carried: Vec2<T>, rate: T) -> Vec2<T> {
        vec2(
            self.along.dot(carried) - self.lever * rate,
            self.across.dot(carried),
        )
    }

    /// The force that the chassis feels in its plane from one of the contact.
    #[inline(always)]
    pub(super) fn felt(&self, force: Vec2<T>) -> Vec2<T> {
        self.along * force.x + self.across * force.y
    }

    /// What is left of the load at rest where a force per load acts: one that points uphill carries, one
    /// that points downhill presses.
    #[inline(always)]
    pub(super) fn eased(&self, grip: Vec2<T>) -> T {
        T::one() / self.bearing(grip)
    }

    #[inline(always)]
    fn bearing(&self, grip: Vec2<T>) -> T {
        (T::one() + self.ease.dot(grip)).max(T::from(WEDGED))
    }

    /// Force over the load at rest, and its slope over slip.
    #[inline(always)]
    pub(super) fn eased_slope(&self, grip: Vec2<T>, slope: &[[T; 2]; 2]) -> (Vec2<T>, [[T; 2]; 2]) {
        let eased = self.eased(grip);
        let free = T::from(WEDGED).less(T::one() + self.ease.dot(grip));
        let own = grip * T::select(free, eased * eased, T::zero());
        let mut change = [[T::zero(); 2]; 2];
        for column in 0..2 {
            let turned = self.ease.dot(vec2(slope[0][column], slope[1][column]));
            change[0][column] = (-own.x).mul_add(turned, eased * slope[0][column]);
            change[1][column] = (-own.y).mul_add(turned, eased * slope[1][column]);
        }
        (grip * eased, change)
    }
}

impl<T: Scalar> Slip<T> {
    /// The same on uneven ground; its own is to have no gravity along it.
    ///
    /// # Panics
    /// Never for a footing of this platform, which has contacts that carry a plane.
    pub fn on(mut self, footing: Footing<T>) -> Self {
        assert!(self.support.is_some(), "a footing has a support");
        self.footing = Some(footing);
        self
    }

    /// What it stands on, where that is uneven.
    pub fn footing(&self) -> Option<&Footing<T>> {
        self.footing.as_ref()
    }

    /// How it stands at a state, on uneven ground.
    pub fn stance(&self, x: &[T]) -> Option<Stance<T>> {
        let at = self.attitude();
        let footing = self.footing.as_ref()?;
        Some(footing.stand(&self.platform, x, [x[at], x[at + 1], x[at + 2]]))
    }

    /// Renews height, roll and pitch in a state, and says whether it can stand so; on springs, whose motion
    /// they are, says whether it is upright and no wall stands before a wheel.
    pub fn stand(&self, x: &mut [T]) -> Standing {
        if let Some(lie) = self.ride(x) {
            return lie.stance.upright();
        }
        self.settle_down(x)
    }

    /// Renews height, roll and pitch in a state by those at rest.
    pub(super) fn settle_down(&self, x: &mut [T]) -> Standing {
        let Some(stance) = self.stance(x) else {
            return Standing::Stands;
        };
        let at = self.attitude();
        x[at..at + 3].copy_from_slice(&stance.attitude);
        stance.standing
    }

    pub(super) fn lie(&self, x: &[T]) -> Option<Lie<T>> {
        if self.springs().is_some() {
            return self.ride(x);
        }
        let support = self.support.as_ref()?;
        Some(Lie::new(self.stance(x)?, self, support))
    }

    /// How it lies at the end of a step from the state `from`, by the velocities in x and the rates of a
    /// stance near by, found where there is none: off by what the square of the step makes of accelerations.
    pub(super) fn lie_ahead(
        &self,
        step: T,
        from: &[T],
        x: &mut [T],
        before: Option<&Stance<T>>,
    ) -> Option<Lie<T>> {
        if self.springs().is_some() {
            self.led(step, from, x);
            return self.ride(x);
        }
        let found;
        let before = match before {
            Some(before) => before,
            None => {
                found = self.stance(x)?;
                &found
            }
        };
        let at = self.layout().velocity();
        let [x_rate, y_rate, yaw_rate] = before.pose_rates(vec2(x[at], x[at + 1]), x[at + 2]);
        x[0] = step.mul_add(x_rate, from[0]);
        x[1] = step.mul_add(y_rate, from[1]);
        x[YAW] = step.mul_add(yaw_rate, from[YAW]);
        self.platform.renew_angles(x);
        let near = self.attitude();
        x[near..].copy_from_slice(&before.attitude);
        self.lie(x)
    }
}
