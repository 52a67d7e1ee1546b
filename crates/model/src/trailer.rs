//! A trailer on a hitch, as the mechanics of its robot see it.
//!
//! A body that swivels about a hitch behind the robot and rolls on one axle moves as the fork of a
//! caster does, with the distance from hitch to axle as its trail. In the plane its mass m, with the
//! center at a distance a before the axle and d − a behind the hitch, is the same as three parts: a
//! point mass m a/d at the hitch, a point mass m (d − a)/d on the axle, and what is left of its
//! inertia, I − m a (d − a). The first belongs to the robot's body, the others to a caster. So a
//! trailer needs no equations of its own. `[eq:trailer]`

use crate::drive::Drive;
use crate::planar::Vec2;
use crate::platform::Body;
use crate::scalar::Scalar;
use crate::wheel::{Rim, Steering, Wheel};

/// A trailer with two wheels on one axle; its center of mass lies on its middle line.
#[derive(Clone, Debug, PartialEq)]
pub struct Trailer<T> {
    /// Name of its axle among the wheels.
    pub name: String,
    /// Place of the hitch on the robot, base frame, m.
    pub hitch: Vec2<T>,
    /// Height of the hitch, m.
    pub hitch_height: T,
    /// Distance d from the hitch back to the axle, m.
    pub length: T,
    /// Half of the distance between its wheels, m.
    pub half_track: T,
    /// Mass without the wheels, kg.
    pub mass: T,
    /// Distance a of the center of mass before the axle, m.
    pub ahead: T,
    /// Yaw inertia about its own center of mass, without the wheels, kg·m².
    pub inertia_com: T,
    /// Radius of its wheels, m.
    pub radius: T,
    /// Mass of each wheel, kg.
    pub wheel_mass: T,
    /// Spin inertia of each wheel, kg·m².
    pub spin_inertia: T,
    /// Viscous coefficient of the axle of each wheel, N·m·s/rad, as far as it resists the way ahead.
    pub viscous: T,
    /// Viscous coefficient of the hitch, N·m·s/rad.
    pub hitch_viscous: T,
}

impl<T: Scalar> Trailer<T> {
    /// Share of the mass that rests on the hitch, kg.
    pub fn hitch_mass(&self) -> T {
        self.mass * self.ahead / self.length
    }

    /// Hangs the trailer on a body with these wheels: adds what the hitch carries to the body, and
    /// the axle to the wheels. Its spin angle and forces are those of both wheels together.
    pub fn attach(&self, body: &mut Body<T>, wheels: &mut Vec<Wheel<T>>) {
        let two = T::from(2.0);
        let carried = self.hitch_mass();
        let mass = body.mass + carried;
        let center = (body.center_of_mass * body.mass + self.hitch * carried) * (T::one() / mass);
        let apart = self.hitch - body.center_of_mass;
        body.inertia_com += body.mass * carried / mass * apart.dot(apart);
        body.com_height = (body.com_height * body.mass + self.hitch_height * carried) / mass;
        body.center_of_mass = center;
        body.mass = mass;

        // Wheels on both ends of the axle also turn with the trailer, and spin as it does.
        let aside = self.half_track * self.half_track;
        let spinning = self.spin_inertia / (self.radius * self.radius);
        let left = self.inertia_com - self.mass * self.ahead * (self.length - self.ahead);
        wheels.push(Wheel {
            name: self.name.clone(),
            mount: self.hitch,
            radius: self.radius,
            steering: Steering::Free { trail: self.length },
            rim: Rim::Plain,
            mass: self.mass - carried + two * self.wheel_mass,
            inertia_vertical: left + two * (self.wheel_mass + spinning) * aside,
            spin_inertia: two * self.spin_inertia,
            viscous: two * self.viscous,
            pivot_viscous: self.hitch_viscous,
            dry_friction: T::zero(),
            friction_rounding: T::zero(),
            brake: T::zero(),
            stiffness: T::zero(),
            drive: Drive::None,
        });
    }
}
