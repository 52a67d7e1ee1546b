//! Forces of the ground on the wheels, and the outputs that rest on them. `[eq:multipliers]`

use super::friction::holding_torques;
use super::{Forces, Rolling};
use crate::planar::{Vec2, vec2};
use crate::platform::{MAX_WHEELS, Platform, Reduced};
use crate::scalar::{Mask, Scalar};
use crate::solve::{Row, dot, solve_semidefinite};
use crate::support::Support;
use crate::wheel::{Steering, WheelFrame};

impl<T: Scalar> Rolling<T> {
    /// Force of the ground on each wheel along its rolling direction (or roller axis) and along its
    /// axle, N, at accelerations v̇. `[eq:multipliers]`
    #[inline(always)]
    pub(super) fn contact_forces(
        &self,
        x: &[T],
        u: &[T],
        reduced: &Reduced<T>,
        forces: &Forces<T>,
        v_rate: &Row<T>,
    ) -> ([T; MAX_WHEELS], [T; MAX_WHEELS]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let v = &x[layout.velocity()..layout.velocity() + n];
        let sticking = (0..layout.wheels).any(|i| forces.actions[i].stuck.any());
        let held = if sticking {
            holding_torques(self, x, reduced, forces)
        } else {
            [T::zero(); MAX_WHEELS]
        };
        let (linear, angular) = self.platform.twist(v_rate);
        let (velocity, yaw_rate) = (forces.velocity, forces.yaw_rate);

        let mut longitudinal = [T::zero(); MAX_WHEELS];
        let mut lateral = [T::zero(); MAX_WHEELS];
        // Force and moment about P that the ground must give to all wheels together.
        let body = self.platform.body();
        let mut force = Vec2::zero();
        let mut moment = body.inertia_com * angular;
        let motion = Motion {
            linear,
            angular,
            velocity,
            yaw_rate,
            gravity: forces.gravity,
        };
        let needed = motion.needed_at(body.center_of_mass) * body.mass;
        force = force + needed;
        moment += body.center_of_mass.cross(needed);
        let wrench = &u[layout.wrench_input()..layout.wrench_input() + 3];
        force = force - vec2(wrench[0], wrench[1]);
        moment -= wrench[2];

        let mut side = [[T::zero(); 3]; MAX_WHEELS];
        let mut shared = [false; MAX_WHEELS];
        for i in 0..layout.wheels {
            if !self.platform.is_dynamic(i) {
                // Without mass and loss it passes no force on.
                continue;
            }
            let wheel = &self.platform.wheels()[i];
            let frame = self.platform.wheel_frame(i, x);
            let rolling = self.platform.rolling_row(i, &frame);
            let mut steering_rate = T::zero();
            let mut steering_accel = T::zero();
            let mut spin_accel = dot(n, &reduced.spin[i], v_rate);
            if wheel.swivels() {
                let swivel = &reduced.swivel[i];
                steering_rate = dot(n, swivel, v);
                let convective =
                    self.platform
                        .convective(i, &frame, velocity, yaw_rate, steering_rate);
                steering_accel = dot(n, swivel, v_rate) + convective.swivel;
                spin_accel += convective.spin;
            }
            // The wheel's mass: V + ωΩr − dγ̇n, of which `needed_at` holds the part without γ̇.
            let trail = wheel.trail();
            let swept = frame.left * (-(trail * steering_rate));
            let needed = (motion.needed_at(frame.contact)
                + swept.perpendicular() * yaw_rate
                + frame.forward * (trail * steering_rate * (yaw_rate + steering_rate))
                - frame.left * (trail * steering_accel))
                * wheel.mass;
            force = force + needed;
            moment += frame.contact.cross(needed);
            let turning = wheel.inertia_vertical * (angular + steering_accel);
            moment += turning;

            let action = &forces.actions[i];
            let net = action.torque + held[i] - action.lost;
            longitudinal[i] = (net - wheel.spin_inertia * spin_accel) / rolling.lever;
            let along = rolling.direction * longitudinal[i];
            force = force - along;
            moment -= frame.contact.cross(along);
            match wheel.steering {
                Steering::Free { trail } => {
                    // The pivot's own equation gives the side force of a caster.
                    let pivot = turning + wheel.pivot_viscous * steering_rate
                        - trail * frame.left.dot(needed);
                    lateral[i] = -pivot / trail;
                    let across = frame.left * lateral[i];
                    force = force - across;
                    moment -= frame.contact.cross(across);
                }
                _ if wheel.is_plain() => {
                    shared[i] = true;
                    side[i] = side_row(&frame);
                }
                _ => {}
            }
        }
        // The rest falls to the side forces of fixed and steered wheels: the smallest that do it.
        let needed = [force.x, force.y, moment];
        let z = match &self.constant {
            Some(constant) => {
                let shares = &constant.sideways;
                [0, 1, 2].map(|a| {
                    let turned = shares[a][2] * needed[2];
                    shares[a][0].mul_add(needed[0], shares[a][1].mul_add(needed[1], turned))
                })
            }
            None => least_side_forces(&side[..layout.wheels], needed),
        };
        for i in 0..layout.wheels {
            if shared[i] {
                lateral[i] = side[i][0].mul_add(z[0], side[i][1].mul_add(z[1], side[i][2] * z[2]));
            }
        }
        (longitudinal, lateral)
    }

    /// Normal loads, N, under these contact forces, and the tip-over margin, m; zeros where the
    /// contacts carry no plane. A trailer pulls at the height of the center of mass.
    #[inline(always)]
    pub(super) fn carry(
        &self,
        x: &[T],
        longitudinal: &[T; MAX_WHEELS],
        lateral: &[T; MAX_WHEELS],
    ) -> ([T; MAX_WHEELS], T) {
        let Some(support) = &self.support else {
            return ([T::zero(); MAX_WHEELS], T::zero());
        };
        let body = self.platform.body();
        let mut mass = body.mass;
        let mut moment = body.center_of_mass * body.mass;
        let mut height = body.com_height * body.mass;
        let mut force = Vec2::zero();
        for i in 0..self.platform.layout().wheels {
            let wheel = &self.platform.wheels()[i];
            if !self.platform.is_dynamic(i) || wheel.is_towed() {
                continue;
            }
            let frame = self.platform.wheel_frame(i, x);
            mass += wheel.mass;
            moment = moment + frame.contact * wheel.mass;
            height = wheel.mass.mul_add(wheel.radius, height);
            let rolling = self.platform.rolling_row(i, &frame);
            force = force + rolling.direction * longitudinal[i] + frame.left * lateral[i];
        }
        let weight = mass * self.ground.gravity_normal;
        let center = moment * (T::one() / mass);
        let point = Support::zero_moment_point(weight, center, height / mass, force);
        let mut loads = support.loads(weight, point);
        for i in 0..self.platform.layout().wheels {
            let wheel = &self.platform.wheels()[i];
            if wheel.is_towed() {
                // The axle of a trailer carries its own share, whatever the body does.
                loads[i] = wheel.mass * self.ground.gravity_normal;
            }
        }
        (loads, support.margin(point))
    }
}

/// Force and moment about P of a unit side force on a wheel.
#[inline(always)]
pub(super) fn side_row<T: Scalar>(frame: &WheelFrame<T>) -> [T; 3] {
    [frame.left.x, frame.left.y, frame.contact.cross(frame.left)]
}

/// z for which the side forces sideᵢ · z have these force and moment and are the smallest.
#[inline(always)]
fn least_side_forces<T: Scalar>(side: &[[T; 3]], needed: [T; 3]) -> [T; 3] {
    let mut normal = [[T::zero(); 3]; 3];
    for row in side {
        for a in 0..3 {
            for b in 0..3 {
                normal[a][b] = row[a].mul_add(row[b], normal[a][b]);
            }
        }
    }
    let trace = normal[0][0] + normal[1][1] + normal[2][2];
    let floor = trace * T::from(T::ROUNDING) + T::from(T::LEAST);
    solve_semidefinite(3, normal, needed, floor)
}

/// The matrix of [`least_side_forces`] of a platform whose geometry does not change.
pub(super) fn side_forces<T: Scalar>(platform: &Platform<T>) -> [[T; 3]; 3] {
    let x = vec![T::zero(); platform.layout().state()];
    let side: Vec<[T; 3]> = platform
        .wheels()
        .iter()
        .enumerate()
        .filter(|(_, wheel)| !wheel.swivels() && wheel.is_plain())
        .map(|(i, _)| side_row(&platform.wheel_frame(i, &x)))
        .collect();
    let (zero, one) = (T::zero(), T::one());
    let columns = [[one, zero, zero], [zero, one, zero], [zero, zero, one]]
        .map(|unit| least_side_forces(&side, unit));
    core::array::from_fn(|a| core::array::from_fn(|b| columns[b][a]))
}

/// Motion of the base and the gravity that it feels, base axes.
struct Motion<T> {
    linear: Vec2<T>,
    angular: T,
    velocity: Vec2<T>,
    yaw_rate: T,
    gravity: Vec2<T>,
}

impl<T: Scalar> Motion<T> {
    /// V̇ + ω̇ Ω r + ω Ω (V + ω Ω r) − g: the force per mass that a point of the base at r needs.
    #[inline(always)]
    fn needed_at(&self, r: Vec2<T>) -> Vec2<T> {
        let carried = self.velocity + r.perpendicular() * self.yaw_rate;
        self.linear + r.perpendicular() * self.angular + carried.perpendicular() * self.yaw_rate
            - self.gravity
    }
}
