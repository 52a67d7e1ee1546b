//! Platforms of constant geometry, multiplied out, with sizes that the compiler knows: no loop of a
//! step is left to run time. `[eq:constant-geometry]`

use super::axle::{Axle, Supply};
use super::{Rolling, is_zero};
use crate::drive::Winding;
use crate::dynamics::{Dynamics, Sizes, Work};
use crate::planar::{Vec2, vec2};
use crate::platform::{LEDGER, MAX_WHEELS, POSE, Platform, Reduced, YAW, straighten};
use crate::scalar::{Mask, Scalar};
use crate::solve::{Mobility, Row, Square, product, zero_row};

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
    /// The wheels that take part, and those that follow, as indices.
    wheels: [usize; W],
    casters: [usize; K],
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
        let casters: [usize; K] = following.try_into().ok()?;
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
        let through = |row: &Row<T>| short(&product(U, inverse, row));
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
            casters,
        }))
    }

    const CURRENTS: usize = POSE + U;
    const LEDGER: usize = Self::CURRENTS + M;
    const SPINS: usize = Self::LEDGER + LEDGER;
    const SWIVELS: usize = Self::SPINS + W + K;

    /// The terms of [`Rolling::forces`], in the order of the data. Loops, not closures: a closure is
    /// a function of its own, compiled without the instruction set that the step was entered with.
    #[inline(always)]
    fn derivative(&self, rolling: &Rolling<T>, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        let at = POSE;
        let layout = rolling.platform.layout();
        let mut v = [T::zero(); U];
        for k in 0..U {
            v[k] = x[at + k];
        }
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let velocity = vec2(along(&self.twist[0], &v), along(&self.twist[1], &v));
        let yaw_rate = along(&self.twist[2], &v);
        let brake = u[layout.brake_input()];
        let mut v_rate = [T::zero(); U];
        for k in 0..U {
            v_rate[k] = -yaw_rate * along(&self.gyro[k], &v);
        }
        // Level ground and hands off are the rule: what they leave out is not computed.
        if !rolling.is_level {
            let gravity = rolling.ground.gravity.rotated(cos, -sin);
            for k in 0..U {
                let weight = self.weight[0][k].mul_add(gravity.x, self.weight[1][k] * gravity.y);
                v_rate[k] += weight;
            }
        }
        let at_wrench = layout.wrench_input();
        let outside = [u[at_wrench], u[at_wrench + 1], u[at_wrench + 2]];
        let alone = is_zero(outside[0])
            .and(is_zero(outside[1]))
            .and(is_zero(outside[2]));
        let pulled = alone.not().any();
        if pulled {
            for k in 0..U {
                v_rate[k] = self.wrench[0][k].mul_add(
                    outside[0],
                    self.wrench[1][k]
                        .mul_add(outside[1], self.wrench[2][k].mul_add(outside[2], v_rate[k])),
                );
            }
        }
        // Plain products: their sum over two wheels is the same whichever comes first, so that a
        // mirrored robot moves as its mirror image to the last bit.
        let mut pushed = [T::zero(); U];
        let (mut supplied, mut windings) = (T::zero(), T::zero());
        let (mut gears, mut friction) = (T::zero(), T::zero());
        let mut sticking = false;
        for w in 0..W {
            let i = self.wheels[w];
            let rate = along(&self.spin[w], &v);
            let axle = &self.axles[w];
            let action = if M == 0 {
                axle.act(u[i], brake, mode[i], rate, T::zero())
            } else {
                let mut action = axle.resist(brake, mode[i], rate);
                action.drive(&self.windings[w], u[i], x[Self::CURRENTS + w]);
                action
            };
            sticking |= action.stuck.any();
            dx[Self::SPINS + w] = action.rate;
            if M > 0 {
                dx[Self::CURRENTS + w] = action.current_rate;
            }
            let net = action.torque - action.lost;
            for k in 0..U {
                pushed[k] += self.push[w][k] * net;
            }
            supplied += action.supplied;
            windings += action.windings;
            gears += action.gears;
            friction += action.rubbed;
        }
        for k in 0..U {
            v_rate[k] += pushed[k];
        }
        if sticking {
            self.hold(rolling, u, mode, &mut v_rate);
        }
        for k in 0..U {
            dx[at + k] = v_rate[k];
        }
        rolling.pose_rates(x, velocity, yaw_rate, dx);
        for k in 0..K {
            let (i, at) = (self.casters[k], Self::SWIVELS + 3 * k);
            let frame = rolling.platform.wheels()[i].frame(x[at + 1], x[at + 2]);
            let rate = rolling.platform.caster_rate(i, &frame, velocity, yaw_rate);
            dx[at] = rate;
            dx[at + 1] = -(x[at + 2] * rate);
            dx[at + 2] = x[at + 1] * rate;
            dx[Self::SPINS + W + k] = rolling.platform.spin_rate(i, &frame, velocity, yaw_rate);
        }
        if pulled {
            supplied += outside[0].mul_add(
                velocity.x,
                outside[1].mul_add(velocity.y, outside[2] * yaw_rate),
            );
        }
        dx[Self::LEDGER] = supplied;
        dx[Self::LEDGER + 1] = windings;
        dx[Self::LEDGER + 2] = gears;
        dx[Self::LEDGER + 3] = friction;
    }

    /// Keeps the sticking wheels at rest.
    #[inline(never)]
    fn hold(&self, rolling: &Rolling<T>, u: &[T], mode: &[T], v_rate: &mut [T; U]) {
        let Some((reduced, inverse)) = &rolling.constant else {
            return;
        };
        let mut stuck = [T::Mask::splat(false); MAX_WHEELS];
        for i in self.wheels {
            let axle = &rolling.axles[i];
            let brake = u[rolling.platform.layout().brake_input()];
            stuck[i] = axle.sticks(mode[i], axle.bound(brake));
        }
        let mut mobility = Mobility::new(U, inverse);
        let still = [T::zero(); MAX_WHEELS];
        rolling.hold(reduced, &stuck, &still, &mut mobility, v_rate);
    }
}

/// A [`Rolling`] whose sizes the compiler knows.
struct Twin<'a, T: Scalar, const U: usize, const W: usize, const M: usize, const K: usize> {
    rolling: &'a Rolling<T>,
    compiled: &'a Compiled<T, U, W, M, K>,
}

impl<T: Scalar, const U: usize, const W: usize, const M: usize, const K: usize> Dynamics<T>
    for Twin<'_, T, U, W, M, K>
{
    const STIFF: usize = POSE;

    fn sizes(&self) -> Sizes {
        self.rolling.sizes()
    }
    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        self.compiled.derivative(self.rolling, x, u, mode, dx);
    }
    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        self.rolling.output(x, u, mode, y);
    }
    #[inline(always)]
    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        self.rolling.decide(x, u, mode);
    }
    #[inline(always)]
    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        self.rolling.settle(x, u, mode);
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
            #[inline(never)]
            pub(super) fn derivative(
                &self,
                rolling: &Rolling<T>,
                x: &[T],
                u: &[T],
                mode: &[T],
                dx: &mut [T],
            ) {
                match self {
                    $(Shape::$name(compiled) => compiled.derivative(rolling, x, u, mode, dx),)*
                }
            }

            /// Works on the twin of `rolling`.
            #[inline(always)]
            pub(super) fn work<J: Work<T>>(&self, rolling: &Rolling<T>, job: J) -> J::Output {
                match self {
                    $(Shape::$name(compiled) => job.run::<
                        { POSE + $u + $m + LEDGER + $w + $k + 3 * $k },
                        { $u + $m },
                        _,
                    >(&Twin { rolling, compiled }),)*
                }
            }
        }
    };
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
