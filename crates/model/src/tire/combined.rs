//! The magic formula in combined slip: pure slip on each axis, weighted by the slip on the other.
//!
//! H. B. Pacejka, *Tire and Vehicle Dynamics*, chapter 4, as the handbook's PAC2002 writes it and
//! M. Althoff, G. Würsching, *CommonRoad: Vehicle Models*, version 2020a, section 9.3 takes it: no
//! camber, no turn slip, all scaling factors one, slip stiffness in proportion to load. Numbers of
//! equations are those of PAC2002. Contact axes as in [`crate::tire`]; the two axes differ, and plysteer
//! and conicity are in it, so that a force need not be opposed to slip. `[eq:combined-slip]`

use super::bend;
use crate::planar::{Vec2, vec2};
use crate::scalar::Scalar;

/// A tire in combined slip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Combined<T> {
    /// Force along the rolling direction over κ, weighted by α.
    pub along: Axis<T>,
    /// Force along the axle over α, weighted by κ.
    pub across: Axis<T>,
    /// Force along the axle that κ induces.
    pub induced: Induced<T>,
    /// Which text the shifts are read from.
    pub reading: Reading,
}

/// What is made of two terms on which the published text and its program disagree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// The text: S_V adds to the force (18, 30), and κ = −s wherever it occurs.
    Text,
    /// The program: S_V N, a force, adds to the angle within the sine, and s stands for κ where it weighs
    /// and induces force along the axle. The derivatives published with it are of this kind.
    Program,
}

/// One axis: force per load over its own slip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis<T> {
    /// μ, p_D1: the peak.
    pub friction: T,
    /// Slip stiffness per load, p_K1; negative for α, which the force is opposed to.
    pub stiffness: T,
    /// Shape factor, p_C1.
    pub shape: T,
    /// Curvature factor, p_E1.
    pub curvature: T,
    /// S_H: what is added to the slip.
    pub slip_shift: T,
    /// S_V per load: what is added to the force.
    pub force_shift: T,
    /// Loss by slip on the other axis.
    pub weight: Weight<T>,
}

/// Loss of force on one axis by slip on the other: a cosine in place of the sine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight<T> {
    /// r_B1: slope in the slip of the other axis.
    pub stiffness: T,
    /// r_B2: how the axis' own slip takes that slope away.
    pub decline: T,
    /// r_B3: own slip at which it is steepest.
    pub decline_shift: T,
    /// r_C1.
    pub shape: T,
    /// r_E1.
    pub curvature: T,
    /// r_H1: what is added to the slip of the other axis.
    pub slip_shift: T,
}

/// Force along the axle induced by κ: μ r_V1 sin(r_V5 atan(r_V6 κ))/√(1 + (r_V4 α)²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Induced<T> {
    /// r_V1, over the friction along the axle.
    pub share: T,
    /// r_V4.
    pub decline: T,
    /// r_V5.
    pub shape: T,
    /// r_V6.
    pub stiffness: T,
}

/// cos(atan x).
#[inline(always)]
fn declined<T: Scalar>(x: T) -> T {
    T::one() / x.mul_add(x, T::one()).sqrt()
}

impl<T: Scalar> Axis<T> {
    /// Force per load in pure slip, equations (18) and (30), of the tire under `load`, N.
    #[inline(always)]
    fn pure(&self, slip: T, load: T, reading: Reading) -> T {
        let steepness = self.stiffness / (self.shape * self.friction);
        let angle = bend(steepness * (slip + self.slip_shift), self.curvature).atan();
        let (inside, outside) = match reading {
            Reading::Text => (T::zero(), self.force_shift),
            Reading::Program => (self.force_shift * load, T::zero()),
        };
        let (sin, _) = self.shape.mul_add(angle, inside).sin_cos();
        self.friction.mul_add(sin, outside)
    }
}

impl<T: Scalar> Weight<T> {
    /// The share that is left at the axis' own slip and that of the other, equations (59) and (68);
    /// cos(atan x) is 1/√(1 + x²).
    #[inline(always)]
    fn at(&self, own: T, other: T) -> T {
        let steepness = self.stiffness * declined(self.decline * (own - self.decline_shift));
        let cosine = |slip: T| {
            let angle = bend(steepness * slip, self.curvature).atan();
            (self.shape * angle).sin_cos().1
        };
        cosine(other + self.slip_shift) / cosine(self.slip_shift)
    }
}

impl<T: Scalar> Induced<T> {
    /// Force per load, equations (75) and (76), with μ along the axle.
    #[inline(always)]
    fn at(&self, friction: T, ratio: T, angle: T) -> T {
        let (sin, _) = (self.shape * (self.stiffness * ratio).atan()).sin_cos();
        friction * self.share * declined(self.decline * angle) * sin
    }
}

impl<T: Scalar> Combined<T> {
    /// Force of the ground, N, contact axes, for the longitudinal slip s = 1 − r φ̇/u with the speed u
    /// along the rolling direction, positive in braking; the slip angle α, rad, of the contact's way
    /// against the wheel plane, positive to the left; and the load, N.
    #[inline(always)]
    pub fn force(&self, slip: T, angle: T, load: T) -> Vec2<T> {
        let ratio = -slip;
        let weighing = match self.reading {
            Reading::Text => ratio,
            Reading::Program => slip,
        };
        let along = self.along.pure(ratio, load, self.reading);
        let across = self.across.pure(angle, load, self.reading);
        let induced = self.induced.at(self.across.friction, weighing, angle);
        let left = self.across.weight.at(angle, weighing);
        vec2(
            along * self.along.weight.at(weighing, angle),
            across.mul_add(left, induced),
        ) * load
    }
}
