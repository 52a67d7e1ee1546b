//! Two driven wheels that are alike, left and right of the middle: forward speed goes with the sum of
//! their currents and yaw rate with the difference, which halves the products of a step.
//!
//! In the core of a state the sum stands in place of the first current and the difference, second less
//! first, in place of the second; with v and ω the axles turn at ρ v ∓ τ ω. `[eq:paired]`

use super::{Compiled, RISE, SUMS, pushed_by};
use crate::drive::Winding;
use crate::dynamics::{Core, Nodes, product};
use crate::lanewise;
use crate::planar::{Vec2, vec2};
use crate::platform::{LEDGER, POSE, Platform, YAW, renew_angle};
use crate::rolling::Rolling;
use crate::scalar::{Mask, Scalar};
use crate::wheel::Wheel;

/// What the equations come to over sum and difference.
#[derive(Clone, Debug)]
pub(super) struct Pair<T> {
    winding: Winding<T>,
    /// ρ and τ: rates of the axles per forward speed and yaw rate.
    roll: T,
    turn: T,
    /// Forward acceleration per sum of the currents, angular per difference.
    push: [T; 2],
    /// Of quadratic terms: v̇ per −ω², ω̇ per −ω v.
    gyro: [T; 2],
    /// Decelerations by viscous friction.
    drag: [T; 2],
    /// Decay of currents, 1/s, and back-EMF over L of sum and difference.
    decay: T,
    emf: [T; 2],
    /// Twice what a current may change by beside its decay before its driver limits it, A/s.
    window: T,
    /// Power lost in gears and by friction, per product of speed and current, and of speeds.
    gears: [T; 2],
    friction: [T; 2],
}

lanewise!(Pair {} state {
    winding, roll, turn, push, gyro, drag, decay, emf, window, gears, friction
});

impl<T: Scalar> Pair<T> {
    /// Of a shape; `None` where its wheels are not alike, or not left and right of the middle.
    ///
    /// What is given decides, not what follows from it: rounding must not part two robots, nor two
    /// precisions. Whole values are compared: lanes that are alike in all, and derivatives as well.
    pub(super) fn new<const U: usize, const W: usize, const M: usize, const K: usize>(
        of: &Compiled<T, U, W, M, K>,
        platform: &Platform<T>,
    ) -> Option<Self> {
        if U != 2 || W != 2 || M != 2 {
            return None;
        }
        let (zero, one) = (T::zero(), T::one());
        let [first, second] = [0, 1].map(|w| &platform.wheels()[of.wheels[w]]);
        let (place, other) = (first.mount, second.mount);
        let is_middle = of.twist[0][..] == [one, zero]
            && of.twist[1][..] == [zero, zero]
            && of.twist[2][..] == [zero, one]
            && platform.body().center_of_mass.y == zero
            && place.x == other.x
            && place.y == -other.y;
        // All but name and place.
        let twin = Wheel {
            name: first.name.clone(),
            mount: place,
            ..second.clone()
        };
        let [left, right] = [&of.spin[0], &of.spin[1]];
        if !is_middle || *first != twin || left[0] != right[0] || left[1] != -right[1] {
            return None;
        }
        let (winding, feed, axle) = (of.windings[0], &of.feeds[1], &of.axles[1]);
        let (roll, turn) = (right[0], right[1]);
        let two = T::from(2.0);
        let lost = winding.emf - winding.torque;
        Some(Pair {
            winding,
            roll,
            turn,
            push: [feed.push[0], feed.push[1]],
            gyro: [of.gyro[0][1], of.gyro[1][0]],
            drag: [of.drag[0][0], of.drag[1][1]],
            decay: feed.decay,
            emf: [two * feed.emf * roll, two * feed.emf * turn],
            window: two * feed.window,
            gears: [lost * roll, lost * turn],
            friction: [roll, turn].map(|share| two * axle.viscous * share * share),
        })
    }

    /// As [`Compiled::feed`], of sum and difference at forward speed and yaw rate.
    #[inline(always)]
    fn feed(&self, held: &[T], v: T, yaw_rate: T) -> ([T; 2], [T; 2], T::Mask) {
        let mut driven = [
            (-self.emf[0]).mul_add(v, held[RISE]),
            (-self.emf[1]).mul_add(yaw_rate, held[RISE + 1]),
        ];
        let mut taken = [T::zero(); 2];
        // The larger of both, twice.
        let limited = self.window.less(driven[0].abs() + driven[1].abs());
        if limited.any() {
            let mut missing = [T::zero(); 2];
            for w in 0..2 {
                let aside = if w == 0 { -driven[1] } else { driven[1] };
                let over = self.window.less((driven[0] + aside).abs());
                let emf = self.winding.emf * self.rate(w, v, yaw_rate);
                let limit = self.winding.terminal_voltage(held[w], emf);
                let lacks = self.winding.slope * (limit - held[w]);
                missing[w] = T::select(over, lacks, T::zero());
            }
            taken = [missing[0] + missing[1], missing[1] - missing[0]];
            for k in 0..2 {
                driven[k] = T::select(limited, driven[k] + taken[k], driven[k]);
            }
        }
        (driven, taken, limited)
    }

    /// Rate of an axle, rad/s.
    #[inline(always)]
    fn rate(&self, wheel: usize, v: T, yaw_rate: T) -> T {
        let aside = self.turn * yaw_rate;
        self.roll
            .mul_add(v, if wheel == 0 { -aside } else { aside })
    }
}

impl<T: Scalar, const U: usize, const W: usize, const M: usize, const K: usize>
    Compiled<T, U, W, M, K>
{
    /// As [`Self::core_rates`], where wheels are alike.
    #[inline(always)]
    pub(super) fn paired_rates<const PLAIN: bool>(
        &self,
        rolling: &Rolling<T>,
        x: &[T],
        held: &[T],
        rates: &mut [T],
    ) -> T::Mask {
        let Some(pair) = &self.pair else {
            return T::Mask::splat(false);
        };
        let (forward, yaw_rate) = (x[POSE], x[POSE + 1]);
        let (driven, _, limited) = pair.feed(held, forward, yaw_rate);
        let mut v_rate = [T::zero(); U];
        for k in 0..2 {
            let current = x[POSE + 2 + k];
            rates[POSE + 2 + k] = (-pair.decay).mul_add(current, driven[k]);
            v_rate[k] = pair.push[k] * current;
        }
        v_rate[0] = (-pair.drag[0]).mul_add(forward, v_rate[0]);
        v_rate[0] = (-pair.gyro[0] * yaw_rate).mul_add(yaw_rate, v_rate[0]);
        let slowing = pair.gyro[1].mul_add(forward, pair.drag[1]);
        v_rate[1] = (-slowing).mul_add(yaw_rate, v_rate[1]);
        let wrench = pushed_by::<T, PLAIN>(held);
        self.lean::<PLAIN>(rolling, x, &wrench, &mut v_rate);
        for k in 0..2 {
            rates[POSE + k] = v_rate[k];
        }
        self.paired_angles(x, rates);
        limited
    }

    /// As [`Self::core_rest`], where wheels are alike.
    #[inline(always)]
    pub(super) fn paired_rest<const PLAIN: bool>(
        &self,
        rolling: &Rolling<T>,
        x: &[T],
        held: &[T],
        rest: &mut [T],
    ) -> T::Mask {
        let Some(pair) = &self.pair else {
            return T::Mask::splat(false);
        };
        let (forward, yaw_rate) = (x[POSE], x[POSE + 1]);
        let (_, taken, limited) = pair.feed(held, forward, yaw_rate);
        let mut v_rate = [T::zero(); U];
        v_rate[0] = -pair.gyro[0] * yaw_rate * yaw_rate;
        v_rate[1] = -pair.gyro[1] * forward * yaw_rate;
        self.lean::<PLAIN>(rolling, x, &None, &mut v_rate);
        for k in 0..2 {
            rest[POSE + k] = v_rate[k];
            rest[POSE + 2 + k] = taken[k];
        }
        self.paired_angles(x, rest);
        limited
    }

    /// Rates of the angles of heading and casters.
    #[inline(always)]
    fn paired_angles(&self, x: &[T], rates: &mut [T]) {
        let v = Self::velocities(x);
        rates[YAW] = v[U - 1];
        for k in 0..K {
            let at = Self::SWIVELS + 3 * k;
            let (swivel, _) = self.followers[k].rates(x[at + 1], x[at + 2], &v, v[U - 1]);
            rates[at] = swivel;
        }
    }

    /// What nothing else follows from: the angles of the driven wheels, and the energy ledger.
    #[inline(always)]
    fn paired_books<const PLAIN: bool>(
        &self,
        nodes: &Nodes<'_, T>,
        held: &[T],
        limited: T::Mask,
        turned: T,
        x: &mut [T],
    ) {
        let Some(pair) = &self.pair else {
            return;
        };
        let winding = &pair.winding;
        let weight = nodes.weight;
        let (forward, yaw_rate) = (nodes.state(POSE), nodes.state(POSE + 1));
        let (sum, difference) = (nodes.state(POSE + 2), nodes.state(POSE + 3));
        let rolled = pair.roll * (weight * nodes.sum(forward));
        let aside = pair.turn * turned;
        x[Self::SPINS] += rolled - aside;
        x[Self::SPINS + 1] += rolled + aside;

        // Supply and windings in halves: I₁ U₁ + I₂ U₂ is half of the products of sums and differences.
        let half = T::from(0.5) * weight;
        let supplied = held[SUMS + 1].mul_add(nodes.sum(difference), held[SUMS] * nodes.sum(sum));
        let heat = product(sum, sum) + product(difference, difference);
        let windings = winding.resistance * heat;
        let gears = pair.gears[1].mul_add(
            product(yaw_rate, difference),
            pair.gears[0] * product(forward, sum),
        );
        let friction = pair.friction[1].mul_add(
            product(yaw_rate, yaw_rate),
            pair.friction[0] * product(forward, forward),
        );
        let mut outside = T::zero();
        if limited.any() {
            let mut missing = T::zero();
            for w in 0..2 {
                let [mut voltage, mut current] = [[T::zero(); 3]; 2];
                for node in 0..3 {
                    let share = if node == 1 { nodes.share } else { T::one() };
                    let rate = pair.rate(w, forward[node], yaw_rate[node]);
                    let limit = winding.terminal_voltage(held[w], winding.emf * (rate / share));
                    voltage[node] = share * (limit - held[w]);
                    current[node] = if w == 0 {
                        sum[node] - difference[node]
                    } else {
                        sum[node] + difference[node]
                    };
                }
                missing += T::from(0.5) * product(voltage, current);
            }
            outside = T::select(limited, missing, T::zero());
        }
        let wrench = pushed_by::<T, PLAIN>(held);
        if let Some(wrench) = wrench {
            // P moves along the axle's plane alone.
            let pushed = wrench[0] * nodes.sum(forward);
            outside += wrench[2].mul_add(nodes.sum(yaw_rate), pushed);
        }
        x[Self::LEDGER] = half.mul_add(supplied, x[Self::LEDGER]);
        if !PLAIN || limited.any() {
            x[Self::LEDGER] = weight.mul_add(outside, x[Self::LEDGER]);
        }
        x[Self::LEDGER + 1] = half.mul_add(windings, x[Self::LEDGER + 1]);
        x[Self::LEDGER + 2] = weight.mul_add(gears, x[Self::LEDGER + 2]);
        x[Self::LEDGER + 3] = weight.mul_add(friction, x[Self::LEDGER + 3]);
        const { assert!(LEDGER == 4) };
    }

    /// As [`Self::gather`], where wheels are alike; BARE without what nothing else follows from.
    #[inline(always)]
    pub(super) fn paired_gather<const PLAIN: bool, const BARE: bool>(
        &self,
        nodes: &Nodes<'_, T>,
        held: &[T],
        limited: T::Mask,
        x: &mut [T],
    ) {
        let weight = nodes.weight;
        let (forward, yaw_rate) = (nodes.state(POSE), nodes.state(POSE + 1));
        let turned = weight * nodes.sum(yaw_rate);
        if !BARE {
            self.paired_books::<PLAIN>(nodes, held, limited, turned, x);
        }

        self.follow_nodes(nodes, turned, x);
        let before = vec2(x[YAW + 1], x[YAW + 2]);
        x[YAW] += turned;
        renew_angle(x, YAW);
        for k in 0..K {
            renew_angle(x, Self::SWIVELS + 3 * k);
        }
        let after = vec2(x[YAW + 1], x[YAW + 2]);
        let way = if nodes.is_simpson {
            simpson_way(nodes, forward, yaw_rate, turned, before, after)
        } else {
            gauss_way(nodes, forward, yaw_rate, turned, before, after)
        };
        x[0] = weight.mul_add(way.x, x[0]);
        x[1] = weight.mul_add(way.y, x[1]);
    }
}

/// 1 / cos of half an angle: to its sixth power, for angles that are turned by within a step.
#[inline(always)]
fn half_secant<T: Scalar>(angle: T) -> T {
    let square = angle * angle;
    let last = T::from(61.0 / 46_080.0).mul_add(square, T::from(5.0 / 384.0));
    let next = last.mul_add(square, T::from(0.125));
    next.mul_add(square, T::one())
}

/// Integral of speed along the heading over a step, over the weight of an outer node, by Simpson's rule.
///
/// The direction in the middle follows from those at the ends: (c₀ + c₁) / (2 cos ½Δ) is the cosine of the
/// mean of their angles, from which the angle in the middle is h (ω₀ − ω₁) / 8 away.
#[inline(always)]
fn simpson_way<T: Scalar>(
    nodes: &Nodes<'_, T>,
    speed: [T; 3],
    yaw_rate: [T; 3],
    turned: T,
    before: Vec2<T>,
    after: Vec2<T>,
) -> Vec2<T> {
    let ends = before + after;
    // Of the step a weight is a sixth.
    let aside = T::from(0.75) * nodes.weight * (yaw_rate[0] - yaw_rate[2]);
    // The speed in the middle is given twice, and so is the direction.
    let middle = half_secant(turned) * speed[1];
    let cos = (-aside).mul_add(ends.y, ends.x);
    let sin = aside.mul_add(ends.x, ends.y);
    vec2(
        middle.mul_add(cos, product_of_ends(speed, before.x, after.x)),
        middle.mul_add(sin, product_of_ends(speed, before.y, after.y)),
    )
}

#[inline(always)]
fn product_of_ends<T: Scalar>(speed: [T; 3], before: T, after: T) -> T {
    speed[2].mul_add(after, speed[0] * before)
}

/// The same by Gauss's rule with three nodes, seen from the direction in the middle of the step: what
/// goes along it and across it.
#[inline(always)]
fn gauss_way<T: Scalar>(
    nodes: &Nodes<'_, T>,
    speed: [T; 3],
    yaw_rate: [T; 3],
    turned: T,
    before: Vec2<T>,
    after: Vec2<T>,
) -> Vec2<T> {
    let ends = before + after;
    // With h = 3.6 weights, and nodes √0.6 h apart: the angle in the middle is h² ω̇ / 8 short of the
    // mean of those at the ends, and the outer nodes are 0.4 of that short.
    let aside = T::from(0.125 * 3.6 / 0.774_596_669_241_483_4) * nodes.weight;
    let aside = aside * (yaw_rate[0] - yaw_rate[2]);
    let (both, apart) = (speed[0] + speed[2], speed[2] - speed[0]);
    // 1 − δ²/2 + δ⁴/24 with δ = √0.6 Δ/2.
    let square = turned * turned;
    let cos = T::from(0.000_937_5).mul_add(square, T::from(-0.075));
    let cos = cos.mul_add(square, T::one());
    let middle = nodes.share * speed[1];
    let along = both.mul_add(cos, middle);
    let off = T::from(0.387_298_334_620_741_7) * turned;
    let across = aside.mul_add(T::from(0.4).mul_add(both, middle), off * apart);
    let scale = T::from(0.5) * half_secant(turned);
    vec2(scale * along, scale * across).rotated(ends.x, ends.y)
}

/// See [`crate::dynamics::Dynamics::core_enter`].
#[inline(always)]
pub(in crate::rolling) fn core_enter<T: Scalar>(
    is_paired: bool,
    core: Core,
    x: &[T],
    stage: &mut [T],
) {
    let (from, to) = core.summed;
    for k in from..to {
        stage[k] = x[k];
    }
    if is_paired {
        stage[from + 2] = x[from + 2] + x[from + 3];
        stage[from + 3] = x[from + 3] - x[from + 2];
    }
}

/// See [`crate::dynamics::Dynamics::core_leave`].
#[inline(always)]
pub(in crate::rolling) fn core_leave<T: Scalar>(
    is_paired: bool,
    core: Core,
    stage: &[T],
    x: &mut [T],
) {
    let (from, to) = core.summed;
    for k in from..to {
        x[k] = stage[k];
    }
    if is_paired {
        let half = T::from(0.5);
        x[from + 2] = half * (stage[from + 2] - stage[from + 3]);
        x[from + 3] = half * (stage[from + 2] + stage[from + 3]);
    }
}
