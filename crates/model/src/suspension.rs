//! Springs and dampers between wheels and chassis: heave, roll and pitch as motions of their own.
//! `[eq:suspension]`
//!
//! A wheel slides along the normal of the chassis on a spring and a damper, and follows the ground at
//! once: only the chassis has inertia there. It moves as a rigid body in space by Newton's and Euler's equations about
//! P, whose velocity (V_x, V_y, w) and turning rate (p, q, ω) are taken along the axes of the chassis:
//! in its plane as at every level, and heave w, roll rate p and pitch rate q besides. The ground's
//! forces along it act in the plane z = 0 of the base.

use crate::planar::Vec2;
use crate::platform::{MAX_WHEELS, Platform};
use crate::scalar::Scalar;
use crate::stance::{cross, dot3, solve3};

/// What stands between the wheels and the chassis of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Suspension<T> {
    /// Of the spring of each wheel, N/m.
    pub stiffness: Vec<T>,
    /// Of the damper of each wheel, N·s/m.
    pub damping: Vec<T>,
    /// Inertia of the body about its forward axis through its own center of mass, kg·m².
    pub roll_inertia: T,
    /// About its left axis.
    pub pitch_inertia: T,
}

/// A chassis on springs: inertia of all motions in space.
#[derive(Clone, Debug)]
pub struct Sprung<T> {
    damping: [T; MAX_WHEELS],
    mass: T,
    /// Center of mass, base frame, m.
    center: [T; 3],
    /// Inertia over heave, roll and pitch, and its inverse.
    own: [[T; 3]; 3],
    inverse: [[T; 3]; 3],
    /// Inertia that the motion in the plane (rows) shares with these (columns).
    shared: [[T; 3]; 3],
}

impl<T: Scalar> Sprung<T> {
    /// Joins a platform and its springs. Wheels count as points at their hubs.
    pub fn new(platform: &Platform<T>, suspension: &Suspension<T>) -> Self {
        let count = platform.wheels().len();
        assert_eq!(count, suspension.damping.len(), "a damper for each wheel");
        let (mass, first, up) = platform.balance();
        let center = [first.x / mass, first.y / mass, up / mass];
        // About P: of the body, and of each wheel.
        let (mut roll, mut pitch, mut product) = (
            suspension.roll_inertia,
            suspension.pitch_inertia,
            [T::zero(); 3],
        );
        let body = platform.body();
        let mut add = |m: T, [x, y, z]: [T; 3]| {
            roll += m * y.mul_add(y, z * z);
            pitch += m * x.mul_add(x, z * z);
            // x y, x z, y z
            product[0] += m * x * y;
            product[1] += m * x * z;
            product[2] += m * y * z;
        };
        let at = body.center_of_mass;
        add(body.mass, [at.x, at.y, body.com_height]);
        for wheel in platform.wheels() {
            add(wheel.mass, [wheel.mount.x, wheel.mount.y, wheel.radius]);
        }
        let zero = T::zero();
        let own = [
            [mass, first.y, -first.x],
            [first.y, roll, -product[0]],
            [-first.x, -product[0], pitch],
        ];
        let shared = [
            [zero, zero, up],
            [zero, -up, zero],
            [zero, -product[1], -product[2]],
        ];
        let mut inverse = [[zero; 3]; 3];
        for k in 0..3 {
            let mut unit = [zero; 3];
            unit[k] = T::one();
            inverse[k] = solve3(&own, unit);
        }
        let mut damping = [zero; MAX_WHEELS];
        damping[..count].copy_from_slice(&suspension.damping);
        Sprung {
            damping,
            mass,
            center,
            own,
            inverse,
            shared,
        }
    }

    /// Roll and pitch inertia about the center of mass of the whole robot, kg·m².
    pub fn inertias(&self) -> [T; 2] {
        let [x, y, z] = self.center.map(|at| at * at);
        [
            self.own[1][1] - self.mass * (y + z),
            self.own[2][2] - self.mass * (x + z),
        ]
    }

    /// Damping of wheel i, N·s/m.
    #[inline(always)]
    pub fn damping(&self, i: usize) -> T {
        self.damping[i]
    }

    /// Inertia over heave, roll and pitch.
    #[inline(always)]
    pub fn own(&self) -> &[[T; 3]; 3] {
        &self.own
    }

    /// Inertia that the motion in the plane (rows) shares with these (columns).
    #[inline(always)]
    pub fn shared(&self) -> &[[T; 3]; 3] {
        &self.shared
    }

    /// What rests of the inertia over the motion in the plane where heave, roll and pitch are free:
    /// M − B A⁻¹ Bᵀ; here B A⁻¹ Bᵀ.
    pub fn freed(&self) -> [[T; 3]; 3] {
        let by = self.shared.map(|row| self.release(row));
        let mut freed = [[T::zero(); 3]; 3];
        for a in 0..3 {
            for b in 0..3 {
                freed[a][b] = dot3(by[a], self.shared[b]);
            }
        }
        freed
    }

    /// A⁻¹ f: rates of heave, roll and pitch under forces along and about these alone.
    #[inline(always)]
    pub fn release(&self, force: [T; 3]) -> [T; 3] {
        self.inverse.map(|row| dot3(row, force))
    }

    /// B α: what rates of heave, roll and pitch take of the forces in the plane.
    #[inline(always)]
    pub fn drag(&self, rates: [T; 3]) -> [T; 3] {
        self.shared.map(|row| dot3(row, rates))
    }

    /// Bᵀ a: what rates of the motion in the plane take of the forces of heave, roll and pitch.
    #[inline(always)]
    pub fn sway(&self, rates: [T; 3]) -> [T; 3] {
        [0, 1, 2].map(|k| {
            let column = [self.shared[0][k], self.shared[1][k], self.shared[2][k]];
            dot3(column, rates)
        })
    }

    /// Quadratic terms, N and N·m: those in the plane beyond what [`crate::slip`] has without heave, roll and pitch, and
    /// those of these, at a twist whose moment of momentum about the normal, kg·m²/s, would be `turned` without them.
    pub fn quadratic(
        &self,
        velocity: Vec2<T>,
        yaw_rate: T,
        [rise, roll, pitch]: [T; 3],
        turned: T,
    ) -> ([T; 3], [T; 3]) {
        let speed = [velocity.x, velocity.y, rise];
        let turning = [roll, pitch, yaw_rate];
        let swept = cross(turning, self.center);
        let momentum = [0, 1, 2].map(|k| self.mass * (speed[k] + swept[k]));
        let heave = [rise, roll, pitch];
        let plane = [velocity.x, velocity.y, yaw_rate];
        let sway = self.sway(plane);
        let moment = [
            dot3(self.own[1], heave) + sway[1],
            dot3(self.own[2], heave) + sway[2],
            turned + dot3(self.shared[2], heave),
        ];
        let linear = cross(turning, momentum).map(|part| -part);
        let [about, across] = [cross(turning, moment), cross(speed, momentum)];
        let angular = [0, 1, 2].map(|k| -(about[k] + across[k]));
        // Those in the plane alone: m ω (V_y + ω c_x), …
        let flat = [
            self.mass * yaw_rate * yaw_rate.mul_add(self.center[0], velocity.y),
            self.mass * yaw_rate * yaw_rate.mul_add(self.center[1], -velocity.x),
            -(self.mass
                * yaw_rate
                * velocity
                    .x
                    .mul_add(self.center[0], velocity.y * self.center[1])),
        ];
        (
            [
                linear[0] - flat[0],
                linear[1] - flat[1],
                angular[2] - flat[2],
            ],
            [linear[2], angular[0], angular[1]],
        )
    }

    /// Energy of motion beyond that in the plane, J.
    pub fn kinetic(&self, velocity: Vec2<T>, yaw_rate: T, heave: [T; 3]) -> T {
        let plane = [velocity.x, velocity.y, yaw_rate];
        let own = dot3(heave, self.own.map(|row| dot3(row, heave)));
        own.mul_add(T::from(0.5), dot3(plane, self.drag(heave)))
    }
}
