//! Platforms of constant geometry, multiplied out, with sizes that the compiler knows: no loop of a
//! step is left to run time. `[eq:constant-geometry]`

use super::axle::{Action, Axle, Supply};
use super::{Rolling, is_zero};
use crate::drive::Winding;
use crate::dynamics::{Dynamics, Sizes, Work};
use crate::planar::{Vec2, vec2};
use crate::platform::{LEDGER, MAX_WHEELS, POSE, Platform, Reduced, YAW, renew_angle, straighten};
use crate::scalar::{Mask, Scalar};
use crate::solve::{Mobility, Row, Square, times, zero_row};
use crate::wheel::Wheel;

/// The equations of a platform of constant geometry: U velocity coordinates, W wheels that take part
/// in the dynamics, of which all (M = W) or none (M = 0) have the state of a current, and K casters
/// that follow.
#[derive(Clone, Debug)]
pub(super) struct Compiled<T, const U: usize, const W: usize, const M: usize, const K: usize> {
    /// Rows of Σ: V_x, V_y, ω.
    twist: [[T; U]; 3],
    /// φ̇ of each wheel.
    spin: [[T; U]; W],
    /// M⁻¹ Sᵀ: acceleration per torque of each wheel.
    push: [[T; U]; W],
    /// M⁻¹ G.
    gyro: [[T; U]; U],
    /// M⁻¹ Σ m_k J_kᵀ: acceleration per gravity along x and y.
    weight: [[T; U]; 2],
    /// Acceleration per component of an external wrench.
    wrench: [[T; U]; 3],
    axles: [Axle<T>; W],
    /// The motors whose currents are states.
    windings: [Winding<T>; M],
    /// The wheels that take part, as indices.
    wheels: [usize; W],
    followers: [Follower<T>; K],
}

/// A caster that follows the motion, its divisions multiplied out.
#[derive(Clone, Copy, Debug)]
struct Follower<T> {
    pivot: Vec2<T>,
    per_trail: T,
    per_radius: T,
}

impl<T: Scalar> Follower<T> {
    fn new(wheel: &Wheel<T>) -> Self {
        Follower {
            pivot: wheel.mount,
            per_trail: T::one() / wheel.trail(),
            per_radius: T::one() / wheel.radius,
        }
    }

    /// γ̇ and φ̇: the contact lies behind the pivot along the wheel plane, so that it moves forward
    /// as the pivot does.
    #[inline(always)]
    fn rates(&self, cos: T, sin: T, velocity: Vec2<T>, yaw_rate: T) -> (T, T) {
        let forward = vec2(cos, sin);
        let pivot = velocity + self.pivot.perpendicular() * yaw_rate;
        let swivel = forward.perpendicular().dot(pivot);
        (
            swivel.mul_add(self.per_trail, -yaw_rate),
            forward.dot(pivot) * self.per_radius,
        )
    }
}

/// Powers of the energy ledger, W.
struct Bill<T> {
    supplied: T,
    windings: T,
    gears: T,
    friction: T,
}

impl<T: Scalar> Bill<T> {
    #[inline(always)]
    fn new() -> Self {
        let zero = T::zero();
        Bill {
            supplied: zero,
            windings: zero,
            gears: zero,
            friction: zero,
        }
    }

    #[inline(always)]
    fn add(&mut self, action: &Action<T>) {
        self.supplied += action.supplied;
        self.windings += action.windings;
        self.gears += action.gears;
        self.friction += action.rubbed;
    }

    /// Adds what the wrench supplies and writes the rates of the ledger.
    #[inline(always)]
    fn close(&mut self, wrench: &Option<[T; 3]>, velocity: Vec2<T>, yaw_rate: T, rates: &mut [T]) {
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

/// Sum of products of two short rows.
#[inline(always)]
fn along<T: Scalar, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    let mut sum = a[0] * b[0];
    for k in 1..N {
        sum = a[k].mul_add(b[k], sum);
    }
    sum
}

impl<T: Scalar, const U: usize, const W: usize, const M: usize, const K: usize>
    Compiled<T, U, W, M, K>
{
    /// `None` if the platform has other sizes.
    fn new(
        platform: &Platform<T>,
        axles: &[Axle<T>],
        reduced: &Reduced<T>,
        inverse: &Square<T>,
    ) -> Option<Box<Self>> {
        let layout = platform.layout();
        let (dynamic, following): (Vec<usize>, Vec<usize>) =
            (0..layout.wheels).partition(|&i| platform.is_dynamic(i));
        let wheels: [usize; W] = dynamic.try_into().ok()?;
        let followers: Vec<Follower<T>> = following
            .iter()
            .map(|&i| Follower::new(&platform.wheels()[i]))
            .collect();
        let followers: [Follower<T>; K] = followers.try_into().ok()?;
        let motors: Vec<Winding<T>> = wheels
            .iter()
            .filter_map(|&i| match axles[i].supply {
                Supply::Motor(winding, _) => Some(winding),
                _ => None,
            })
            .collect();
        // All or none: then the currents stand in the order of the wheels.
        let windings: [Winding<T>; M] = motors.try_into().ok()?;
        if layout.dof() != U || !layout.steered.is_empty() {
            return None;
        }
        let short = |row: &Row<T>| -> [T; U] { core::array::from_fn(|k| row[k]) };
        let through = |row: &Row<T>| short(&times(U, inverse, row));
        let origin = platform.point_rows(Vec2::zero());
        let yaw = platform.yaw_row();
        let mut gyro = [[T::zero(); U]; U];
        for column in 0..U {
            let mut of_column = zero_row();
            for (k, value) in of_column.iter_mut().enumerate().take(U) {
                *value = reduced.gyro[k][column];
            }
            for (k, row) in gyro.iter_mut().enumerate() {
                row[column] = through(&of_column)[k];
            }
        }
        Some(Box::new(Compiled {
            twist: [short(&origin[0]), short(&origin[1]), short(&yaw)],
            spin: wheels.map(|i| short(&reduced.spin[i])),
            push: wheels.map(|i| through(&reduced.spin[i])),
            gyro,
            weight: [through(&reduced.momentum[0]), through(&reduced.momentum[1])],
            wrench: [through(&origin[0]), through(&origin[1]), through(&yaw)],
            axles: wheels.map(|i| axles[i].clone()),
            windings,
            wheels,
            followers,
        }))
    }

    const CURRENTS: usize = POSE + U;
    const LEDGER: usize = Self::CURRENTS + M;
    const SPINS: usize = Self::LEDGER + LEDGER;
    const SWIVELS: usize = Self::SPINS + W + K;

    /// Velocity coordinates, velocity and yaw rate.
    #[inline(always)]
    fn motion(&self, x: &[T]) -> ([T; U], Vec2<T>, T) {
        let mut v = [T::zero(); U];
        for k in 0..U {
            v[k] = x[POSE + k];
        }
        let velocity = vec2(along(&self.twist[0], &v), along(&self.twist[1], &v));
        (v, velocity, along(&self.twist[2], &v))
    }

    /// The external wrench, where there is one.
    #[inline(always)]
    fn wrench<const PLAIN: bool>(&self, rolling: &Rolling<T>, u: &[T]) -> Option<[T; 3]> {
        if PLAIN {
            return None;
        }
        let at = rolling.platform.layout().wrench_input();
        let outside = [u[at], u[at + 1], u[at + 2]];
        let alone = is_zero(outside[0])
            .and(is_zero(outside[1]))
            .and(is_zero(outside[2]));
        alone.not().any().then_some(outside)
    }

    /// Accelerations by quadratic terms, gravity and the external wrench.
    #[inline(always)]
    fn drift<const PLAIN: bool>(
        &self,
        rolling: &Rolling<T>,
        x: &[T],
        v: &[T; U],
        yaw_rate: T,
        wrench: &Option<[T; 3]>,
    ) -> [T; U] {
        let mut v_rate = [T::zero(); U];
        for k in 0..U {
            v_rate[k] = -yaw_rate * along(&self.gyro[k], v);
        }
        if !PLAIN && !rolling.is_level {
            let gravity = rolling.ground.gravity.rotated(x[YAW + 1], -x[YAW + 2]);
            for k in 0..U {
                let weight = self.weight[0][k].mul_add(gravity.x, self.weight[1][k] * gravity.y);
                v_rate[k] += weight;
            }
        }
        if let Some(outside) = wrench {
            for k in 0..U {
                v_rate[k] = self.wrench[0][k].mul_add(
                    outside[0],
                    self.wrench[1][k]
                        .mul_add(outside[1], self.wrench[2][k].mul_add(outside[2], v_rate[k])),
                );
            }
        }
        v_rate
    }

    /// The terms of [`Rolling::forces`], in the order of the data. Loops, not closures: a closure is
    /// a function of its own, compiled without the instruction set that the step was entered with.
    ///
    /// On level ground, with hands off and without dry friction, which is the rule, a PLAIN one has
    /// the same bits and no branches.
    #[inline(always)]
    fn derivative<const PLAIN: bool>(
        &self,
        rolling: &Rolling<T>,
        x: &[T],
        u: &[T],
        mode: &[T],
        dx: &mut [T],
    ) {
        let (v, velocity, yaw_rate) = self.motion(x);
        let brake = u[rolling.platform.layout().brake_input()];
        let wrench = self.wrench::<PLAIN>(rolling, u);
        let mut v_rate = self.drift::<PLAIN>(rolling, x, &v, yaw_rate, &wrench);
        // Plain products: their sum over two wheels is the same whichever comes first, so that a
        // mirrored robot moves as its mirror image to the last bit.
        let mut pushed = [T::zero(); U];
        let mut bill = Bill::new();
        let mut sticking = false;
        for w in 0..W {
            let i = self.wheels[w];
            let rate = along(&self.spin[w], &v);
            let axle = &self.axles[w];
            let mut action = if PLAIN {
                axle.roll(rate)
            } else {
                axle.resist(brake, mode[i], rate)
            };
            if M == 0 {
                axle.drive(&mut action, u[i], T::zero());
            } else {
                action.drive(&self.windings[w], u[i], x[Self::CURRENTS + w]);
            }
            if !PLAIN {
                sticking |= action.stuck.any();
            }
            dx[Self::SPINS + w] = action.rate;
            if M > 0 {
                dx[Self::CURRENTS + w] = action.current_rate;
            }
            let net = action.torque - action.lost;
            for k in 0..U {
                pushed[k] += self.push[w][k] * net;
            }
            bill.add(&action);
        }
        for k in 0..U {
            v_rate[k] += pushed[k];
        }
        if sticking {
            self.hold(rolling, u, mode, &mut v_rate);
        }
        for k in 0..U {
            dx[POSE + k] = v_rate[k];
        }
        rolling.pose_rates(x, velocity, yaw_rate, dx);
        self.follow(x, velocity, yaw_rate, dx);
        bill.close(&wrench, velocity, yaw_rate, &mut dx[Self::LEDGER..]);
    }

    /// Rates of the casters that follow.
    #[inline(always)]
    fn follow(&self, x: &[T], velocity: Vec2<T>, yaw_rate: T, dx: &mut [T]) {
        for k in 0..K {
            let at = Self::SWIVELS + 3 * k;
            let (cos, sin) = (x[at + 1], x[at + 2]);
            let (swivel, spin) = self.followers[k].rates(cos, sin, velocity, yaw_rate);
            dx[at] = swivel;
            dx[at + 1] = -(sin * swivel);
            dx[at + 2] = cos * swivel;
            dx[Self::SPINS + W + k] = spin;
        }
    }

    /// Keeps the sticking wheels at rest.
    #[inline(never)]
    fn hold(&self, rolling: &Rolling<T>, u: &[T], mode: &[T], v_rate: &mut [T; U]) {
        let Some(constant) = &rolling.constant else {
            return;
        };
        let mut stuck = [T::Mask::splat(false); MAX_WHEELS];
        for i in self.wheels {
            let axle = &rolling.axles[i];
            let brake = u[rolling.platform.layout().brake_input()];
            stuck[i] = axle.sticks(mode[i], axle.bound(brake));
        }
        let mut mobility = Mobility::new(U, &constant.inverse);
        let still = [T::zero(); MAX_WHEELS];
        super::friction::hold(
            rolling,
            &constant.reduced,
            &stuck,
            &still,
            &mut mobility,
            v_rate,
        );
    }
}

/// A [`Rolling`] whose sizes the compiler knows, PLAIN as for [`Compiled::derivative`].
struct Twin<
    'a,
    T: Scalar,
    const U: usize,
    const W: usize,
    const M: usize,
    const K: usize,
    const PLAIN: bool,
> {
    rolling: &'a Rolling<T>,
    compiled: &'a Compiled<T, U, W, M, K>,
}

impl<T: Scalar, const U: usize, const W: usize, const M: usize, const K: usize, const PLAIN: bool>
    Dynamics<T> for Twin<'_, T, U, W, M, K, PLAIN>
{
    const STIFF: usize = POSE;
    // Heading, velocities and currents; the angles of the casters.
    const READ: [(usize, usize); 2] = [
        (0, POSE + U + M),
        (Compiled::<T, U, W, M, K>::SWIVELS, usize::MAX),
    ];

    fn sizes(&self) -> Sizes {
        self.rolling.sizes()
    }
    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        self.compiled
            .derivative::<PLAIN>(self.rolling, x, u, mode, dx);
    }
    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        self.rolling.output(x, u, mode, y);
    }
    #[inline(always)]
    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        if !PLAIN {
            self.rolling.decide(x, u, mode);
        }
    }
    #[inline(always)]
    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        renew_angle(x, YAW);
        for k in 0..K {
            renew_angle(x, Compiled::<T, U, W, M, K>::SWIVELS + 3 * k);
        }
        if !PLAIN && self.rolling.any_rubs {
            super::come_to_rest(self.rolling, x, u, mode);
        }
    }
    #[inline(always)]
    fn straighten(&self, stage: &mut [T]) {
        straighten(stage, YAW + 1);
        for k in 0..K {
            straighten(stage, Compiled::<T, U, W, M, K>::SWIVELS + 3 * k + 1);
        }
    }
    fn guards(&self, x: &[T], u: &[T], mode: &[T], g: &mut [T]) {
        self.rolling.guards(x, u, mode, g);
    }
    fn linear_part(&self, mode: &[T], matrix: &mut [T]) -> Option<core::ops::Range<usize>> {
        self.rolling.linear_part(mode, matrix)
    }
    fn is_derived(&self, index: usize) -> bool {
        self.rolling.is_derived(index)
    }
}

/// The sizes that are compiled, by name: U, W, M, K and the length of the state.
macro_rules! shapes {
    ($($name:ident: $u:literal, $w:literal, $m:literal, $k:literal;)*) => {
        /// A platform of one of the compiled sizes.
        #[derive(Clone, Debug)]
        pub(super) enum Shape<T> {
            $(#[doc(hidden)] $name(Box<Compiled<T, $u, $w, $m, $k>>),)*
        }

        impl<T: Scalar> Shape<T> {
            /// `None` for all other sizes.
            pub(super) fn new(
                platform: &Platform<T>,
                axles: &[Axle<T>],
                reduced: &Reduced<T>,
                inverse: &Square<T>,
            ) -> Option<Self> {
                $(if let Some(compiled) = Compiled::new(platform, axles, reduced, inverse) {
                    return Some(Shape::$name(compiled));
                })*
                None
            }

            /// The derivative, where the caller does not know the sizes.
            #[inline(always)]
            fn derivative(
                &self,
                rolling: &Rolling<T>,
                x: &[T],
                u: &[T],
                mode: &[T],
                dx: &mut [T],
            ) {
                match self {
                    $(Shape::$name(compiled) => {
                        compiled.derivative::<false>(rolling, x, u, mode, dx)
                    })*
                }
            }

            /// Works on the twin of `rolling` under an input.
            #[inline(always)]
            pub(super) fn work<J: Work<T>>(
                &self,
                rolling: &Rolling<T>,
                u: &[T],
                job: J,
            ) -> J::Output {
                let plain = rolling.is_plain(u);
                match self {
                    // A twin for motors is worth its size twice, one for torques once; of many lanes
                    // those with motors alone, for each takes seconds to compile. What a constant
                    // leaves out is not compiled at all.
                    $(Shape::$name(compiled) => if $m > 0 && plain {
                        let twin = Twin::<_, $u, $w, $m, $k, true> { rolling, compiled };
                        job.run::<{ POSE + $u + $m + LEDGER + $w + 4 * $k }, { $u + $m }, _>(&twin)
                    } else if const { T::LANES > 1 || ($m == 0 && J::FOR_MOTORS) } {
                        job.run::<0, 0, _>(rolling)
                    } else {
                        let twin = Twin::<_, $u, $w, $m, $k, false> { rolling, compiled };
                        job.run::<{ POSE + $u + $m + LEDGER + $w + 4 * $k }, { $u + $m }, _>(&twin)
                    },)*
                }
            }
        }
    };
}

fused! {
    /// See [`Shape::derivative`].
    pub(super) fn derivative<T: Scalar>(
        shape: &Shape<T>,
        rolling: &Rolling<T>,
        x: &[T],
        u: &[T],
        mode: &[T],
        dx: &mut [T],
    ) {
        shape.derivative(rolling, x, u, mode, dx);
    }
}

// Two driven wheels on an axle with up to two casters, as torque or motor drives.
shapes! {
    Axle: 2, 2, 0, 0;
    AxleCaster: 2, 2, 0, 1;
    AxleCasters: 2, 2, 0, 2;
    Motors: 2, 2, 2, 0;
    MotorsCaster: 2, 2, 2, 1;
    MotorsCasters: 2, 2, 2, 2;
}
