//! A wheel is data: a mount, a radius, a way of steering, a rim and a trail.
//!
//! Base frame of the robot. The wheel plane has the direction e at the steering angle γ, the axle
//! the direction n = Ωe (left). The contact point is r = p − d e, with p the mount (for a steered
//! wheel or caster, the pivot) and d the trail. Every kind of wheel is a choice of [`Steering`] and
//! [`Rim`]; no code asks for a kind of robot.

use crate::drive::Drive;
use crate::planar::{Vec2, vec2};
use crate::scalar::Scalar;

/// How the wheel plane turns about the vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Steering<T> {
    /// The wheel plane keeps its angle γ against the base's x-axis, rad.
    Fixed {
        /// Angle of the wheel plane, rad.
        angle: T,
    },
    /// A steering motor turns the wheel plane about the pivot above the contact.
    Driven,
    /// A linkage turns the wheel plane by the angle of a steered wheel times a ratio.
    Linked {
        /// Index of the steered wheel.
        lead: usize,
        /// Ratio of the angles: 1 for a synchro drive, −1 for opposite ends.
        ratio: T,
    },
    /// An ideal linkage keeps the wheel's axle through the center about which the robot turns, set
    /// by a steered wheel and the axle of the fixed ones (Ackermann); the wheel only follows.
    Guided {
        /// Index of the steered wheel.
        lead: usize,
    },
    /// The wheel swivels freely: a caster, with its contact trailing the pivot.
    Free {
        /// Distance d from the pivot to the contact, against e, m; not zero.
        trail: T,
    },
}

/// What the rim resists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rim<T> {
    /// A tire: resists motion of the contact along e and along n.
    Plain,
    /// Rollers (omni, mecanum): resists only along the axis of the roller in contact, e turned by δ.
    Rollers {
        /// Angle δ from e to the roller axis, rad, |δ| < π/2.
        angle: T,
    },
}

/// A wheel with its inertia and losses.
#[derive(Clone, Debug, PartialEq)]
pub struct Wheel<T> {
    /// Name, unique within the robot.
    pub name: String,
    /// Mount p in the base frame, m.
    pub mount: Vec2<T>,
    /// Radius r, m.
    pub radius: T,
    /// Turning about the vertical.
    pub steering: Steering<T>,
    /// Rim.
    pub rim: Rim<T>,
    /// Mass at the contact point, kg.
    pub mass: T,
    /// Inertia about the vertical through the contact, kg·m².
    pub inertia_vertical: T,
    /// Spin inertia J about the axle, with the rotor reflected through the gear, kg·m².
    pub spin_inertia: T,
    /// Viscous coefficient of the axle, N·m·s/rad.
    pub viscous: T,
    /// Viscous coefficient of the pivot, N·m·s/rad.
    pub pivot_viscous: T,
    /// Bound of the dry friction torque without brake (bearing, gear, rolling resistance), N·m.
    pub dry_friction: T,
    /// Rate over which dry friction is rounded off as tanh(φ̇ / this), rad/s; 0 for friction that
    /// holds a wheel at rest. A rounded wheel creeps: for comparison with models that do so.
    pub friction_rounding: T,
    /// What the brake adds to the bound at full command, N·m.
    pub brake: T,
    /// Stiffness of its contact relative to the others', by which they share the normal load; 0 for
    /// a contact that carries no part of the body (the axle of a trailer).
    pub stiffness: T,
    /// What drives the axle.
    pub drive: Drive<T>,
}

/// Directions of a wheel at an instant, base frame.
#[derive(Clone, Copy, Debug)]
pub struct WheelFrame<T> {
    /// Rolling direction e.
    pub forward: Vec2<T>,
    /// Axle direction n = Ωe.
    pub left: Vec2<T>,
    /// Contact point r, m.
    pub contact: Vec2<T>,
}

/// What a rim resists at an instant: the first row of its constraint.
#[derive(Clone, Copy, Debug)]
pub struct RollingRow<T> {
    /// Direction of the force that ground and rim exchange, base frame: e, or the roller axis.
    pub direction: Vec2<T>,
    /// r for a plain rim, r cos δ for rollers: the lever arm of that force about the axle, m.
    pub lever: T,
}

impl<T: Scalar> Wheel<T> {
    /// Trail d, m; zero but for casters.
    #[inline(always)]
    pub fn trail(&self) -> T {
        match self.steering {
            Steering::Free { trail } => trail,
            _ => T::zero(),
        }
    }

    /// Directions and contact point for the cosine and sine of the steering angle.
    #[inline(always)]
    pub fn frame(&self, cos: T, sin: T) -> WheelFrame<T> {
        let forward = vec2(cos, sin);
        WheelFrame {
            forward,
            left: forward.perpendicular(),
            contact: self.mount - forward * self.trail(),
        }
    }

    /// Whether the rim resists along the axle, too.
    pub fn is_plain(&self) -> bool {
        matches!(self.rim, Rim::Plain)
    }

    /// Whether its contact carries no part of the body: the axle of a trailer.
    pub fn is_towed(&self) -> bool {
        self.stiffness.lane(0) == 0.0
    }

    /// Whether the wheel plane turns, so that the wheel has a steering angle as a state.
    pub fn swivels(&self) -> bool {
        !matches!(self.steering, Steering::Fixed { .. })
    }
}

/// Velocity of the contact point over the ground, base frame, m/s. `[eq:contact-velocity]`
///
/// v_c = v + ω Ω r − d γ̇ n − r φ̇ e, with the contact r = p − d e; zero along the directions that the
/// rim resists means ideal rolling.
#[inline(always)]
pub fn contact_velocity<T: Scalar>(
    wheel: &Wheel<T>,
    frame: &WheelFrame<T>,
    velocity: Vec2<T>,
    yaw_rate: T,
    steering_rate: T,
    spin_rate: T,
) -> Vec2<T> {
    velocity + frame.contact.perpendicular() * yaw_rate
        - frame.left * (wheel.trail() * steering_rate)
        - frame.forward * (wheel.radius * spin_rate)
}
