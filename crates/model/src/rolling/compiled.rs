//! Platforms of constant geometry, multiplied out, with sizes that the compiler knows: no loop of a
//! step is left to run time. `[eq:constant-geometry]`

mod paired;
mod parts;
mod shapes;

use super::axle::{Axle, Supply};
use super::{Constant, Rolling, is_zero};
use crate::drive::{Drive, Winding};
use crate::dynamics::{CORE_INPUT, Core, Nodes, product};
use crate::lanewise;
use crate::planar::{Vec2, vec2};
use crate::platform::{LEDGER, MAX_WHEELS, POSE, WheelOutput, YAW, renew_angle};
use crate::scalar::{Mask, Scalar};
use crate::solve::{Mobility, Row, Square, times, zero_row};

use paired::Pair;
use parts::{Bill, Feed, Follower};

pub(super) use paired::{core_enter, core_leave};
pub(super) use shapes::{Shape, core_rates, core_rest, derivative, gather, motion, output};

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
    /// The motors whose currents are states, as they are and multiplied out.
    windings: [Winding<T>; M],
    feeds: [Feed<T, U>; M],
    /// Deceleration per velocity by viscous friction.
    drag: [[T; U]; U],
    /// What that comes to where two wheels are alike.
    pair: Option<Pair<T>>,
    /// The wheels that take part, as indices.
    wheels: [usize; W],
    /// The casters that follow, and which wheels they are.
    followers: [Follower<T, U>; K],
    casters: [usize; K],
    /// What forces and energies follow from.
    bulk: Bulk<T, U, W>,
}

/// The robot as one body, and where the ground acts on it; base axes.
#[derive(Clone, Debug)]
struct Bulk<T, const U: usize, const W: usize> {
    /// M.
    inertia: [[T; U]; U],
    mass: T,
    /// Mass times center of mass, kg·m, of all.
    first: Vec2<T>,
    /// Moment of inertia about P, kg·m².
    second: T,
    /// Center of mass, m, and what a force moves the zero-moment point by, m/N, of what the contacts carry.
    center: Vec2<T>,
    lift: T,
    weight: T,
    contacts: [Contact<T>; W],
    /// ½ L of each motor, H.
    coils: [T; W],
}

/// Where and how the ground acts on a wheel.
#[derive(Clone, Copy, Debug)]
struct Contact<T> {
    point: Vec2<T>,
    /// Directions of the force that the drive raises, and of the side force.
    direction: Vec2<T>,
    left: Vec2<T>,
    per_lever: T,
    spin_inertia: T,
    /// Side force for a force and moment that all wheels together must give.
    side: [T; 3],
}

impl<T: Scalar, const U: usize, const W: usize> Bulk<T, U, W> {
    fn new(
        rolling: &Rolling<T>,
        wheels: &[usize; W],
        mass: &Square<T>,
        sideways: &[[T; 3]; 3],
    ) -> Self {
        let platform = &rolling.platform;
        let body = platform.body();
        let x = vec![T::zero(); platform.layout().state()];
        let mut whole = body.mass;
        let mut first = body.center_of_mass * body.mass;
        let mut second = body.center_of_mass.dot(body.center_of_mass) * body.mass;
        second += body.inertia_com;
        let mut height = body.com_height * body.mass;
        let contacts = wheels.map(|i| {
            let wheel = &platform.wheels()[i];
            let frame = platform.wheel_frame(i, &x);
            let rolling = platform.rolling_row(i, &frame);
            whole += wheel.mass;
            first = first + frame.contact * wheel.mass;
            second += frame.contact.dot(frame.contact) * wheel.mass + wheel.inertia_vertical;
            height = wheel.mass.mul_add(wheel.radius, height);
            let side = super::contact::side_row(&frame);
            let share = |b: usize| {
                let of = |a: usize| side[a] * sideways[a][b];
                of(0) + of(1) + of(2)
            };
            let shared = wheel.is_plain();
            Contact {
                point: frame.contact,
                direction: rolling.direction,
                left: frame.left,
                per_lever: T::one() / rolling.lever,
                spin_inertia: wheel.spin_inertia,
                side: [0, 1, 2].map(|b| if shared { share(b) } else { T::zero() }),
            }
        });
        let weight = whole * rolling.ground.gravity_normal;
        Bulk {
            inertia: core::array::from_fn(|a| core::array::from_fn(|b| mass[a][b])),
            mass: whole,
            first,
            second,
            center: first * (T::one() / whole),
            lift: height / whole / weight,
            weight,
            contacts,
            coils: wheels.map(|i| match &platform.wheels()[i].drive {
                Drive::DcMotor(motor) => T::from(0.5) * motor.inductance,
                _ => T::zero(),
            }),
        }
    }
}

lanewise!(Compiled[U, W, M, K] {} state {
    twist,
    spin,
    push,
    gyro,
    weight,
    wrench,
    axles,
    windings,
    feeds,
    drag,
    pair,
    followers,
    bulk
});
lanewise!(Bulk[U, W] {} state {
    inertia,
    mass,
    first,
    second,
    center,
    lift,
    weight,
    contacts,
    coils
});
lanewise!(Contact {} state { point, direction, left, per_lever, spin_inertia, side });

/// Where a core's input holds the voltages over L, or of a pair those of sum and difference, with sum and
/// difference before them; and the external wrench.
const RISE: usize = 4;
const SUMS: usize = 2;
const WRENCH: usize = 8;

/// The external wrench of a core's input, where there is one.
#[inline(always)]
fn pushed_by<T: Scalar, const PLAIN: bool>(held: &[T]) -> Option<[T; 3]> {
    if PLAIN {
        return None;
    }
    acting([held[WRENCH], held[WRENCH + 1], held[WRENCH + 2]])
}

/// A wrench, where there is one.
#[inline(always)]
fn acting<T: Scalar>(outside: [T; 3]) -> Option<[T; 3]> {
    let alone = is_zero(outside[0])
        .and(is_zero(outside[1]))
        .and(is_zero(outside[2]));
    alone.not().any().then_some(outside)
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
    fn new(rolling: &Rolling<T>, constant: &Constant<T>) -> Option<Box<Self>> {
        let Rolling {
            platform, axles, ..
        } = rolling;
        let Constant {
            reduced,
            inverse,
            sideways,
        } = constant;
        let layout = platform.layout();
        let (dynamic, following): (Vec<usize>, Vec<usize>) =
            (0..layout.wheels).partition(|&i| platform.is_dynamic(i));
        let wheels: [usize; W] = dynamic.try_into().ok()?;
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
        // So it is with a basis of fewer than two fixed axles; the multiplied-out step relies on it.
        let yaw = platform.yaw_row();
        for (k, &entry) in yaw.iter().enumerate().take(U) {
            let is_last = if k == U - 1 { T::one() } else { T::zero() };
            if entry != is_last {
                return None;
            }
        }
        let short = |row: &Row<T>| -> [T; U] { core::array::from_fn(|k| row[k]) };
        let through = |row: &Row<T>| short(&times(U, inverse, row));
        let followers: Vec<Follower<T, U>> = following
            .iter()
            .map(|&i| {
                let wheel = &platform.wheels()[i];
                Follower {
                    pivot: platform.point_rows(wheel.mount).map(|row| short(&row)),
                    per_trail: T::one() / wheel.trail(),
                    per_radius: T::one() / wheel.radius,
                }
            })
            .collect();
        let followers: [Follower<T, U>; K] = followers.try_into().ok()?;
        let origin = platform.point_rows(Vec2::zero());
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
        let casters: [usize; K] = following.try_into().ok()?;
        let spin = wheels.map(|i| short(&reduced.spin[i]));
        let push = wheels.map(|i| through(&reduced.spin[i]));
        let mut drag = [[T::zero(); U]; U];
        for w in 0..W {
            for (k, row) in drag.iter_mut().enumerate() {
                for (j, entry) in row.iter_mut().enumerate() {
                    *entry += push[w][k] * axles[wheels[w]].viscous * spin[w][j];
                }
            }
        }
        let mut compiled = Box::new(Compiled {
            pair: None,
            twist: [short(&origin[0]), short(&origin[1]), short(&yaw)],
            feeds: core::array::from_fn(|w| Feed::new(&windings[w], &push[w])),
            spin,
            push,
            drag,
            gyro,
            weight: [through(&reduced.momentum[0]), through(&reduced.momentum[1])],
            wrench: [through(&origin[0]), through(&origin[1]), through(&yaw)],
            axles: wheels.map(|i| axles[i].clone()),
            windings,
            bulk: Bulk::new(rolling, &wheels, &reduced.mass, sideways),
            wheels,
            followers,
            casters,
        });
        compiled.pair = Pair::new(&compiled, platform);
        Some(compiled)
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
    fn wrench(&self, rolling: &Rolling<T>, u: &[T]) -> Option<[T; 3]> {
        let at = rolling.platform.layout().wrench_input();
        acting([u[at], u[at + 1], u[at + 2]])
    }

    /// See [`Dynamics::core_input`].
    #[inline(always)]
    fn core_input(
        &self,
        rolling: &Rolling<T>,
        is_paired: bool,
        u: &[T],
        held: &mut [T; CORE_INPUT],
    ) {
        for w in 0..M {
            let winding = &self.windings[w];
            held[w] = winding.supplied_voltage(u[self.wheels[w]]);
            held[RISE + w] = winding.slope * held[w];
        }
        if is_paired {
            let both = [held[0] + held[1], held[1] - held[0]];
            for k in 0..2 {
                held[SUMS + k] = both[k];
                held[RISE + k] = self.windings[0].slope * both[k];
            }
        }
        let at = rolling.platform.layout().wrench_input();
        for axis in 0..3 {
            held[WRENCH + axis] = u[at + axis];
        }
    }

    /// Adds the accelerations by gravity and the external wrench.
    #[inline(always)]
    fn lean<const PLAIN: bool>(
        &self,
        rolling: &Rolling<T>,
        x: &[T],
        wrench: &Option<[T; 3]>,
        v_rate: &mut [T; U],
    ) {
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
    }

    /// Accelerations by quadratic terms, gravity and the external wrench.
    #[inline(always)]
    fn drift(
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
        self.lean::<false>(rolling, x, wrench, &mut v_rate);
        v_rate
    }

    /// The terms of [`Rolling::forces`], in the order of the data. Loops, not closures: a closure is
    /// a function of its own, compiled without the instruction set that the step was entered with.
    #[inline(always)]
    fn derivative(&self, rolling: &Rolling<T>, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        let (v, velocity, yaw_rate) = self.motion(x);
        let brake = u[rolling.platform.layout().brake_input()];
        let wrench = self.wrench(rolling, u);
        let mut v_rate = self.drift(rolling, x, &v, yaw_rate, &wrench);
        // Plain products: their sum over two wheels is the same whichever comes first, so that a
        // mirrored robot moves as its mirror image to the last bit.
        let mut pushed = [T::zero(); U];
        let mut bill = Bill::new();
        let mut sticking = false;
        for w in 0..W {
            let i = self.wheels[w];
            let rate = along(&self.spin[w], &v);
            let axle = &self.axles[w];
            let mut action = axle.resist(brake, mode[i], rate);
            if M == 0 {
                axle.drive(&mut action, u[i], T::zero());
            } else {
                action.drive(&self.windings[w], u[i], x[Self::CURRENTS + w]);
            }
            sticking |= action.stuck.any();
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
        self.follow(x, &v, yaw_rate, dx);
        bill.close(&wrench, velocity, yaw_rate, &mut dx[Self::LEDGER..]);
    }

    /// Rates of the casters that follow.
    #[inline(always)]
    fn follow(&self, x: &[T], v: &[T; U], yaw_rate: T, dx: &mut [T]) {
        for k in 0..K {
            let at = Self::SWIVELS + 3 * k;
            let (cos, sin) = (x[at + 1], x[at + 2]);
            let (swivel, spin) = self.followers[k].rates(cos, sin, v, yaw_rate);
            dx[at] = swivel;
            dx[at + 1] = -(sin * swivel);
            dx[at + 2] = cos * swivel;
            dx[Self::SPINS + W + k] = spin;
        }
    }

    /// What the stages of a step are for where all wheels have motors and no dry friction: the
    /// velocities and currents, and for the forces and casters that turn with the robot the cosines
    /// and sines.
    const CORE: Core = Core {
        summed: (POSE, POSE + U + M),
        spins: (Self::SPINS, Self::SPINS + M),
        angles: (YAW, Self::SWIVELS),
        swivels: K,
        turns: true,
    };

    /// The same where wheels are alike; on level ground the heading is no part of it.
    const fn paired_core(is_plain: bool) -> Core {
        Core {
            spins: (Self::SPINS, Self::SPINS),
            turns: !is_plain,
            ..Self::CORE
        }
    }

    /// The velocity coordinates of a state; the last is the yaw rate, see `new`.
    #[inline(always)]
    fn velocities(x: &[T]) -> [T; U] {
        let mut v = [T::zero(); U];
        for k in 0..U {
            v[k] = x[POSE + k];
        }
        v
    }

    /// See [`Dynamics::core_spins`].
    #[inline(always)]
    fn core_spins(&self, x: &[T], rates: &mut [T]) {
        let v = Self::velocities(x);
        for w in 0..M {
            rates[Self::SPINS + w] = along(&self.spin[w], &v);
        }
    }

    /// Rates of the angles of heading, wheels and casters.
    #[inline(always)]
    fn angle_rates(&self, x: &[T], rates: &mut [T]) {
        let v = Self::velocities(x);
        rates[YAW] = v[U - 1];
        self.core_spins(x, rates);
        for k in 0..K {
            let at = Self::SWIVELS + 3 * k;
            let (swivel, _) = self.followers[k].rates(x[at + 1], x[at + 2], &v, v[U - 1]);
            rates[at] = swivel;
        }
    }

    /// What voltage and back-EMF do to the currents, A/s, at given rates of the wheels: for all within
    /// the window of the limit, and what the limit takes from the others; and which these are.
    #[inline(always)]
    fn feed(&self, held: &[T], rates: &[T]) -> ([T; M], [T; M], T::Mask) {
        let [mut driven, mut taken] = [[T::zero(); M]; 2];
        let mut over = [T::Mask::splat(false); M];
        let mut limited = T::Mask::splat(false);
        for w in 0..M {
            let feed = &self.feeds[w];
            driven[w] = (-feed.emf).mul_add(rates[Self::SPINS + w], held[RISE + w]);
            over[w] = feed.window.less(driven[w].abs());
            limited = limited.or(over[w]);
        }
        if limited.any() {
            for w in 0..M {
                let winding = &self.windings[w];
                let command = held[w];
                let limit = winding.terminal_voltage(command, winding.emf * rates[Self::SPINS + w]);
                let missing = winding.slope * (limit - command);
                taken[w] = T::select(over[w], missing, T::zero());
                driven[w] = T::select(over[w], driven[w] + missing, driven[w]);
            }
        }
        (driven, taken, limited)
    }

    /// Adds the accelerations by what is quadratic in the velocities, and by viscous friction.
    #[inline(always)]
    fn slow<const VISCOUS: bool>(&self, v: &[T; U], v_rate: &mut [T; U]) {
        let yaw_rate = v[U - 1];
        for k in 0..U {
            for j in 0..U {
                let slowing = if VISCOUS {
                    self.gyro[k][j].mul_add(yaw_rate, self.drag[k][j])
                } else {
                    self.gyro[k][j] * yaw_rate
                };
                v_rate[k] = (-slowing).mul_add(v[j], v_rate[k]);
            }
        }
    }

    /// See [`Dynamics::core_rates`]; the equations of [`Self::derivative`], linear terms multiplied out.
    ///
    /// On level ground with hands off, which is the rule, a PLAIN one has the same bits.
    #[inline(always)]
    fn core_rates<const PLAIN: bool>(
        &self,
        rolling: &Rolling<T>,
        x: &[T],
        held: &[T],
        rates: &mut [T],
    ) -> T::Mask {
        self.angle_rates(x, rates);
        let (driven, _, limited) = self.feed(held, rates);
        // Plain products: their sum over two wheels is the same whichever comes first, so that a
        // mirrored robot moves as its mirror image to the last bit.
        let mut v_rate = [T::zero(); U];
        for w in 0..M {
            let feed = &self.feeds[w];
            let current = x[Self::CURRENTS + w];
            rates[Self::CURRENTS + w] = (-feed.decay).mul_add(current, driven[w]);
            for k in 0..U {
                let push = feed.push[k] * current;
                v_rate[k] = if w == 0 { push } else { v_rate[k] + push };
            }
        }
        self.slow::<true>(&Self::velocities(x), &mut v_rate);
        let wrench = pushed_by::<T, PLAIN>(held);
        self.lean::<PLAIN>(rolling, x, &wrench, &mut v_rate);
        for k in 0..U {
            rates[POSE + k] = v_rate[k];
        }
        limited
    }

    /// See [`Dynamics::core_rest`].
    #[inline(always)]
    fn core_rest<const PLAIN: bool>(
        &self,
        rolling: &Rolling<T>,
        x: &[T],
        held: &[T],
        rest: &mut [T],
    ) -> T::Mask {
        self.angle_rates(x, rest);
        let (_, taken, limited) = self.feed(held, rest);
        for w in 0..M {
            rest[Self::CURRENTS + w] = taken[w];
        }
        let mut v_rate = [T::zero(); U];
        self.slow::<false>(&Self::velocities(x), &mut v_rate);
        self.lean::<PLAIN>(rolling, x, &None, &mut v_rate);
        for k in 0..U {
            rest[POSE + k] = v_rate[k];
        }
        limited
    }

    /// See [`Dynamics::gather`].
    #[inline(always)]
    fn gather<const PLAIN: bool>(
        &self,
        nodes: &Nodes<'_, T>,
        held: &[T],
        limited: T::Mask,
        x: &mut [T],
    ) {
        let weight = nodes.weight;
        let mut v = [[T::zero(); U]; 3];
        for node in 0..3 {
            v[node] = Self::velocities(nodes.states[node]);
        }
        // Short loops: one that is too long to be unrolled leaves all states in memory.
        let mut rate = [[T::zero(); 3]; M];
        let mut current = [[T::zero(); 3]; M];
        for w in 0..M {
            rate[w] = nodes.rate(Self::SPINS + w);
            current[w] = nodes.state(Self::CURRENTS + w);
        }
        let mut bill = Bill::new();
        for w in 0..M {
            let winding = &self.windings[w];
            bill.supplied += held[w] * nodes.sum(current[w]);
            bill.windings += winding.resistance * product(current[w], current[w]);
        }
        for w in 0..M {
            let winding = &self.windings[w];
            bill.gears += (winding.emf - winding.torque) * product(rate[w], current[w]);
            bill.friction += self.axles[w].viscous * product(rate[w], rate[w]);
        }
        for w in 0..M {
            let at = Self::SPINS + w;
            x[at] = weight.mul_add(nodes.sum(rate[w]), x[at]);
        }
        if limited.any() {
            let mut missing = T::zero();
            for w in 0..M {
                let winding = &self.windings[w];
                let command = held[w];
                let mut voltage = [T::zero(); 3];
                for node in 0..3 {
                    let share = if node == 1 { nodes.share } else { T::one() };
                    let emf = winding.emf * (rate[w][node] / share);
                    let limit = winding.terminal_voltage(command, emf);
                    voltage[node] = share * (limit - command);
                }
                missing += product(voltage, current[w]);
            }
            bill.supplied += T::select(limited, missing, T::zero());
        }
        if let Some(outside) = pushed_by::<T, PLAIN>(held) {
            for axis in 0..3 {
                let mut moved = [T::zero(); 3];
                for node in 0..3 {
                    moved[node] = along(&self.twist[axis], &v[node]);
                }
                bill.supplied = outside[axis].mul_add(nodes.sum(moved), bill.supplied);
            }
        }
        let powers = [bill.supplied, bill.windings, bill.gears, bill.friction];
        for k in 0..LEDGER {
            let at = Self::LEDGER + k;
            x[at] = weight.mul_add(powers[k], x[at]);
        }

        let turned = weight * nodes.sum(nodes.state(POSE + U - 1));
        self.follow_nodes(nodes, turned, x);

        // The last velocity coordinate turns P about a point of the robot: exactly a part of a circle.
        let (cos, sin) = (nodes.state(YAW + 1), nodes.state(YAW + 2));
        let mut way = Vec2::zero();
        for k in 0..U - 1 {
            let speed = nodes.state(POSE + k);
            let travel = vec2(self.twist[0][k], self.twist[1][k])
                .rotated(product(cos, speed), product(sin, speed));
            way = if k == 0 { travel } else { way + travel };
        }
        let arm = vec2(self.twist[1][U - 1], -self.twist[0][U - 1]);
        let (before_cos, before_sin) = (x[YAW + 1], x[YAW + 2]);
        x[YAW] += turned;
        renew_angle(x, YAW);
        for k in 0..K {
            renew_angle(x, Self::SWIVELS + 3 * k);
        }
        let swung = arm.rotated(x[YAW + 1] - before_cos, x[YAW + 2] - before_sin);
        x[0] += weight.mul_add(way.x, swung.x);
        x[1] += weight.mul_add(way.y, swung.y);
    }

    /// Turns the casters over a step in which the robot turns by an angle, rad.
    #[inline(always)]
    fn follow_nodes(&self, nodes: &Nodes<'_, T>, turned: T, x: &mut [T]) {
        let weight = nodes.weight;
        let mut v = [[T::zero(); U]; 3];
        for node in 0..3 {
            v[node] = Self::velocities(nodes.states[node]);
        }
        for k in 0..K {
            let follower = &self.followers[k];
            let at = Self::SWIVELS + 3 * k;
            let (cos, sin) = (nodes.state(at + 1), nodes.state(at + 2));
            // Both are products of a direction and a velocity.
            let (mut across, mut forward) = follower.speeds(cos[0], sin[0], &v[0]);
            for node in 1..3 {
                let more = follower.speeds(cos[node], sin[node], &v[node]);
                across += more.0;
                forward += more.1;
            }
            x[at] += (weight * follower.per_trail).mul_add(across, -turned);
            let at = Self::SPINS + W + k;
            x[at] = (weight * follower.per_radius).mul_add(forward, x[at]);
        }
    }

    /// As [`Rolling::any_motion`], where no wheel can stick.
    #[inline(always)]
    fn motion_output(&self, rolling: &Rolling<T>, x: &[T], y: &mut [T]) {
        let layout = rolling.platform.layout();
        let (v, velocity, yaw_rate) = self.motion(x);
        y[0] = velocity.x;
        y[1] = velocity.y;
        y[2] = yaw_rate;
        for w in 0..W {
            let i = self.wheels[w];
            y[layout.wheel_output(i, WheelOutput::SpinRate)] = along(&self.spin[w], &v);
            y[layout.wheel_output(i, WheelOutput::SteeringRate)] = T::zero();
        }
        for k in 0..K {
            let at = Self::SWIVELS + 3 * k;
            let (swivel, spin) = self.followers[k].rates(x[at + 1], x[at + 2], &v, yaw_rate);
            let i = self.casters[k];
            y[layout.wheel_output(i, WheelOutput::SpinRate)] = spin;
            y[layout.wheel_output(i, WheelOutput::SteeringRate)] = swivel;
        }
    }

    /// As [`Rolling::any_output`], where no wheel can stick.
    #[inline(always)]
    fn output(&self, rolling: &Rolling<T>, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        self.motion_output(rolling, x, y);
        let layout = rolling.platform.layout();
        let bulk = &self.bulk;
        let (v, velocity, yaw_rate) = self.motion(x);
        let brake = u[layout.brake_input()];
        let wrench = self.wrench(rolling, u);
        let mut v_rate = self.drift(rolling, x, &v, yaw_rate, &wrench);
        let mut torques = [T::zero(); W];
        let mut magnetic = T::zero();
        let mut pushed = [T::zero(); U];
        for w in 0..W {
            let i = self.wheels[w];
            let axle = &self.axles[w];
            let mut action = axle.resist(brake, mode[i], along(&self.spin[w], &v));
            if M == 0 {
                axle.drive(&mut action, u[i], T::zero());
            } else {
                action.drive(&self.windings[w], u[i], x[Self::CURRENTS + w]);
            }
            torques[w] = action.torque - action.lost;
            for k in 0..U {
                pushed[k] += self.push[w][k] * torques[w];
            }
            magnetic += bulk.coils[w] * action.current * action.current;
            y[layout.wheel_output(i, WheelOutput::Torque)] = action.torque;
            y[layout.wheel_output(i, WheelOutput::Current)] = action.current;
        }
        for k in 0..U {
            v_rate[k] += pushed[k];
        }
        let linear = vec2(
            along(&self.twist[0], &v_rate),
            along(&self.twist[1], &v_rate),
        );
        let angular = along(&self.twist[2], &v_rate);

        // What the ground must give to all: force, and moment about P.
        let gravity = rolling.ground.gravity.rotated(x[YAW + 1], -x[YAW + 2]);
        let felt = linear + velocity.perpendicular() * yaw_rate - gravity;
        let mut force = felt * bulk.mass + bulk.first.perpendicular() * angular
            - bulk.first * (yaw_rate * yaw_rate);
        let mut moment = bulk.second.mul_add(angular, bulk.first.cross(felt));
        if let Some(outside) = wrench {
            force = force - vec2(outside[0], outside[1]);
            moment -= outside[2];
        }
        let mut drawn = Vec2::zero();
        for w in 0..W {
            let contact = &bulk.contacts[w];
            let spun = contact.spin_inertia * along(&self.spin[w], &v_rate);
            let longitudinal = (torques[w] - spun) * contact.per_lever;
            y[layout.wheel_output(self.wheels[w], WheelOutput::Longitudinal)] = longitudinal;
            let pull = contact.direction * longitudinal;
            drawn = drawn + pull;
            moment -= contact.point.cross(pull);
        }
        force = force - drawn;
        for w in 0..W {
            let contact = &bulk.contacts[w];
            let turned = contact.side[2] * moment;
            let lateral =
                contact.side[0].mul_add(force.x, contact.side[1].mul_add(force.y, turned));
            y[layout.wheel_output(self.wheels[w], WheelOutput::Lateral)] = lateral;
            drawn = drawn + contact.left * lateral;
        }

        let mut kinetic = T::zero();
        for k in 0..U {
            kinetic = v[k].mul_add(along(&bulk.inertia[k], &v), kinetic);
        }
        y[3] = T::from(0.5) * kinetic;
        let first = bulk.first.rotated(x[YAW + 1], x[YAW + 2]);
        y[4] = -rolling
            .ground
            .gravity
            .dot(vec2(x[0], x[1]) * bulk.mass + first);
        y[5] = magnetic;
        let support = rolling.support.as_ref();
        let point = bulk.center - drawn * bulk.lift;
        y[6] = support.map_or(T::zero(), |support| support.margin(point));
        let loads = support.map_or([T::zero(); MAX_WHEELS], |s| s.loads(bulk.weight, point));
        for i in 0..layout.wheels {
            y[layout.wheel_output(i, WheelOutput::Load)] = loads[i];
        }
        for i in self.casters {
            // It passes no force on.
            for what in [
                WheelOutput::Torque,
                WheelOutput::Current,
                WheelOutput::Longitudinal,
                WheelOutput::Lateral,
            ] {
                y[layout.wheel_output(i, what)] = T::zero();
            }
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

#[cfg(test)]
mod tests;
