//! Level `slip`: wheels and body move each for themselves, joined by contact laws. `[eq:slip]`
//!
//! Velocity coordinates: the twist (V_x, V_y, ω) of the base and the rates of the steered wheels; the
//! spin rate of each wheel is a state of its own. Casters that follow carry load and draw no force.
//! Masses of casters count at their pivots. Base axes for forces, world frame for the pose.

mod implicit;
mod patch;
mod sprung;
mod uneven;

use crate::drive::Drive;
use crate::dynamics::{Dynamics, Sizes};
use crate::ground::Ground;
use crate::planar::{Vec2, vec2};
use crate::platform::{BODY_OUTPUTS, Layout, MAX_WHEELS, Platform, WheelOutput, YAW};
use crate::rolling::axle::{Action, Axle};
use crate::scalar::{Mask, Scalar};
use crate::solve::{MAX_DOF, Row, Square, invert, product, zero_row};
use crate::stance::Footing;
use crate::support::Support;
use crate::tire::Tire;
use crate::wheel::{Steering, WheelFrame};

pub use implicit::Implicit;
pub use patch::Patch;
use uneven::Lie;

/// Outputs of each wheel at this level, after those of the layout; [`SlipOutput`].
pub const SLIP_OUTPUTS: usize = 6;

/// The outputs of a wheel's contact, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum SlipOutput {
    /// Slip velocity along the rolling direction (or roller axis), m/s.
    Along,
    /// Slip velocity along the axle, m/s.
    Across,
    /// Slip ratio −s_x/|r φ̇|, positive when driving.
    Ratio,
    /// Slip angle, rad: of the contact's way against the wheel plane, positive to the right.
    Angle,
    /// Force over what friction could give at this load.
    Use,
    /// Power that slip turns into heat, W.
    Power,
}

/// Rolling speed below which slip ratios are taken against this, m/s.
const SLOWEST: f64 = 1e-3;

/// How normal loads follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loads {
    /// From weight alone.
    Static,
    /// From weight and the forces that accelerate the robot.
    Dynamic,
}

/// Why a platform has no slip level.
#[derive(Clone, Debug, PartialEq)]
pub enum SlipError {
    /// The axle of a trailer; its name.
    Trailer(String),
    /// More than five steered wheels.
    SteeredCount(usize),
}

/// A platform whose wheels may slip, ready to be integrated.
#[derive(Clone, Debug)]
pub struct Slip<T: Scalar> {
    platform: Platform<T>,
    ground: Ground<T>,
    tires: Vec<Tire<T>>,
    patches: Vec<Patch<T>>,
    footing: Option<Footing<T>>,
    axles: Vec<Axle<T>>,
    support: Option<Support<T>>,
    /// Loads without lifted wheels: Nᵢ = aᵢ + bᵢ · F.
    loads: ([T; MAX_WHEELS], [Vec2<T>; MAX_WHEELS]),
    mode: Loads,
    mass: T,
    /// Mass times center of mass, kg·m, and its height, m.
    first: Vec2<T>,
    height: T,
    weight: T,
    /// Spin inertia of each wheel, kg·m².
    spin_inertia: [T; MAX_WHEELS],
    /// Mass matrix over the velocity coordinates, and its inverse.
    inertia: Square<T>,
    inverse: Square<T>,
}

/// The contacts at an instant or at the end of a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contacts<T> {
    /// Slip velocity of each, contact axes, m/s.
    slip: [Vec2<T>; MAX_WHEELS],
    /// Force per load, contact axes.
    grip: [Vec2<T>; MAX_WHEELS],
    /// Normal load, N.
    load: [T; MAX_WHEELS],
    /// What its own force leaves of the load of each.
    eased: [T; MAX_WHEELS],
}

/// The axes in which a contact slips and draws.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axes<T> {
    /// Slip velocity is these times the velocity of the contact in the plane of the chassis; the force
    /// that the chassis feels is their sum times the contact's: on even ground directions, base frame.
    along: Vec2<T>,
    across: Vec2<T>,
    /// Lever arm of the first, m.
    lever: T,
    /// By how much of itself each force per load relieves the contact; zero on even ground.
    ease: Vec2<T>,
}

impl<T: Scalar> Slip<T> {
    /// Joins a platform, a contact law for each of its wheels (of casters unused), and a ground.
    ///
    /// # Errors
    /// A trailer, or more than five steered wheels.
    pub fn new(
        platform: Platform<T>,
        tires: Vec<Tire<T>>,
        ground: Ground<T>,
        mode: Loads,
    ) -> Result<Self, SlipError> {
        assert_eq!(platform.wheels().len(), tires.len(), "a law for each wheel");
        if let Some(wheel) = platform.wheels().iter().find(|wheel| wheel.is_towed()) {
            return Err(SlipError::Trailer(wheel.name.clone()));
        }
        let steered = platform.layout().steered.len();
        if 3 + steered > MAX_DOF {
            return Err(SlipError::SteeredCount(steered));
        }
        let platform = platform.released();
        let layout = platform.layout();
        let axle = |(i, wheel)| {
            let slot = layout.motors.iter().position(|&m| m == i);
            Axle::new(wheel, slot.map(|m| layout.current() + m))
        };
        let axles = platform.wheels().iter().enumerate().map(axle).collect();
        let contacts: Vec<_> = platform
            .wheels()
            .iter()
            .map(|wheel| (wheel.mount, wheel.stiffness))
            .collect();
        let support = Support::new(&contacts);

        let body = platform.body();
        let n = layout.dof();
        let (mass, first, moment_up) = platform.balance();
        let mut second = body.center_of_mass.dot(body.center_of_mass) * body.mass;
        second += body.inertia_com;
        let mut inertia = [zero_row::<T>(); MAX_DOF];
        for (i, wheel) in platform.wheels().iter().enumerate() {
            second += wheel.mount.dot(wheel.mount) * wheel.mass + wheel.inertia_vertical;
            // Steered wheels turn with the base and against it.
            let swivel = match wheel.steering {
                Steering::Driven | Steering::Linked { .. } => {
                    platform.swivel_row(i, &platform.wheels()[i].frame(T::one(), T::zero()))
                }
                _ => continue,
            };
            for a in 3..n {
                let turned = wheel.inertia_vertical * swivel[a];
                inertia[2][a] += turned;
                inertia[a][2] += turned;
                for b in 3..n {
                    inertia[a][b] = turned.mul_add(swivel[b], inertia[a][b]);
                }
            }
        }
        inertia[0][0] = mass;
        inertia[1][1] = mass;
        inertia[2][2] = second;
        (inertia[0][2], inertia[2][0]) = (-first.y, -first.y);
        (inertia[1][2], inertia[2][1]) = (first.x, first.x);
        for a in 3..n {
            // A steered wheel without inertia of its own turns as if it had hardly any.
            let own = inertia[a][a];
            let least = second * T::from(1e-6);
            inertia[a][a] = own.max(least);
        }
        // So does a wheel without spin inertia.
        let mut spin_inertia = [T::zero(); MAX_WHEELS];
        for (i, wheel) in platform.wheels().iter().enumerate() {
            let least = mass * wheel.radius * wheel.radius * T::from(1e-6);
            spin_inertia[i] = wheel.spin_inertia.max(least);
        }
        let height = moment_up / mass;
        let weight = mass * ground.gravity_normal;
        let count = platform.wheels().len();
        let none = [T::Mask::splat(false); MAX_WHEELS];
        let loads = match &support {
            Some(support) => support.affine(weight, first * (T::one() / mass), height, &none),
            // Contacts that carry no plane share the weight.
            None => {
                let mut equal = [T::zero(); MAX_WHEELS];
                equal[..count].fill(weight * T::from(1.0 / count as f64));
                (equal, [Vec2::zero(); MAX_WHEELS])
            }
        };
        Ok(Slip {
            inverse: invert(n, &inertia),
            inertia,
            spin_inertia,
            ground,
            tires,
            patches: Vec::new(),
            footing: None,
            axles,
            support,
            loads,
            mode,
            mass,
            first,
            height,
            weight,
            platform,
        })
    }

    /// The same on a ground with these patches; of those that overlap the last counts.
    pub fn on_patches(mut self, patches: Vec<Patch<T>>) -> Self {
        self.patches = patches;
        self
    }

    /// The contact law of wheel i where it stands.
    #[inline(always)]
    fn tire(&self, i: usize, x: &[T], contact: Vec2<T>) -> Tire<T> {
        let tire = self.tires[i];
        if self.patches.is_empty() {
            return tire;
        }
        let place = vec2(x[0], x[1]) + contact.rotated(x[YAW + 1], x[YAW + 2]);
        let mut friction = tire.kinetic();
        for patch in &self.patches {
            friction = T::select(patch.holds(place), patch.friction, friction);
        }
        tire.on_friction(friction)
    }

    /// The platform, its wheels released from rolling.
    pub fn platform(&self) -> &Platform<T> {
        &self.platform
    }

    /// The order of the states that it shares with other levels; see [`Self::rate`].
    pub fn layout(&self) -> &Layout {
        self.platform.layout()
    }

    /// The contacts that carry it, where three or more span a plane.
    pub fn support(&self) -> Option<&Support<T>> {
        self.support.as_ref()
    }

    /// The ground.
    pub fn ground(&self) -> &Ground<T> {
        &self.ground
    }

    /// Index of the spin rate of wheel i in the state.
    #[inline(always)]
    pub fn rate(&self, i: usize) -> usize {
        self.layout().state() + i
    }

    /// Index of the deflection (two entries) of the contact of wheel i in the state.
    #[inline(always)]
    pub fn deflection(&self, i: usize) -> usize {
        self.layout().state() + self.layout().wheels + 2 * i
    }

    /// Index of height, roll and pitch in the state, on uneven ground or springs; with springs the velocities
    /// of heave, roll and pitch follow, chassis axes.
    #[inline(always)]
    pub fn attitude(&self) -> usize {
        self.deflection(self.layout().wheels)
    }

    /// Length of the state.
    #[inline(always)]
    pub fn state(&self) -> usize {
        let more = match &self.footing {
            None => 0,
            Some(footing) if footing.sprung().is_none() => 3,
            Some(_) => 6,
        };
        self.attitude() + more
    }

    /// Index of an output of the contact of wheel i.
    #[inline(always)]
    pub fn slip_output(&self, i: usize, what: SlipOutput) -> usize {
        self.layout().output() + SLIP_OUTPUTS * i + what as usize
    }

    /// Index of the first output of springs, on which the robot may stand: the way of each wheel towards the
    /// body, m, from where the robot stands level.
    pub fn travel(&self) -> Option<usize> {
        self.springs()?;
        Some(self.layout().output() + SLIP_OUTPUTS * self.layout().wheels)
    }

    /// A state of this level that rolls without slip: a state of the platform's layout at a twist, base
    /// axes, with the spin rates that go with it and no deflection.
    pub fn rolling_state(&self, x: &[T], velocity: Vec2<T>, yaw_rate: T) -> Vec<T> {
        let layout = self.layout();
        let mut state = vec![T::zero(); self.state()];
        state[..layout.state()].copy_from_slice(&x[..layout.state()]);
        let at = layout.velocity();
        state[at] = velocity.x;
        state[at + 1] = velocity.y;
        state[at + 2] = yaw_rate;
        for i in 0..layout.wheels {
            let frame = self.platform.wheel_frame(i, &state);
            state[self.rate(i)] = self.platform.spin_rate(i, &frame, velocity, yaw_rate);
        }
        if let Some(footing) = &self.footing {
            let at = self.attitude();
            let guess = footing.guess(&self.platform, &state);
            state[at..at + 3].copy_from_slice(&guess);
            self.settle_down(&mut state);
        }
        state
    }

    /// Whether wheel i follows the base as a caster does, and draws no force.
    #[inline(always)]
    pub fn follows(&self, i: usize) -> bool {
        matches!(self.platform.wheels()[i].steering, Steering::Free { .. })
    }

    /// The axes of a contact: a rim with rollers has no second.
    #[inline(always)]
    fn axes(&self, i: usize, frame: &WheelFrame<T>, lie: Option<&Lie<T>>) -> Axes<T> {
        let row = self.platform.rolling_row(i, frame);
        let plain = self.platform.wheels()[i].is_plain();
        let flat = Axes {
            along: row.direction,
            across: if plain { frame.left } else { Vec2::zero() },
            lever: row.lever,
            ease: Vec2::zero(),
        };
        match lie {
            None => flat,
            Some(lie) => flat.tilted(lie.slope(i), plain),
        }
    }

    /// Rate of a follower's swivel, rad/s.
    #[inline(always)]
    fn swivel_rate(&self, i: usize, x: &[T], velocity: Vec2<T>, yaw_rate: T, v: &[T]) -> T {
        let frame = self.platform.wheel_frame(i, x);
        if self.follows(i) {
            self.platform.caster_rate(i, &frame, velocity, yaw_rate)
        } else {
            let row = self.platform.swivel_row(i, &frame);
            crate::solve::dot(self.layout().dof(), &row, v)
        }
    }

    /// Normal loads, N, for forces per load, base axes.
    #[inline(always)]
    fn carry(
        &self,
        x: &[T],
        pull: &[Vec2<T>; MAX_WHEELS],
        lie: Option<&Lie<T>>,
    ) -> [T; MAX_WHEELS] {
        let wheels = self.layout().wheels;
        let (mut lifted, at_rest) = match lie {
            None => ([T::Mask::splat(false); MAX_WHEELS], &self.loads),
            Some(lie) => (lie.stance.lifted, &lie.loads),
        };
        let (mut still, mut shift) = (&at_rest.0, &at_rest.1);
        let mut changed;
        let mut tries = 0;
        loop {
            // F = Σ Nᵢ κᵢ with Nᵢ = aᵢ + bᵢ · F: two equations for F.
            let mut force = self.held(x, lie);
            if self.mode == Loads::Dynamic {
                let (mut free, mut one) =
                    (Vec2::zero(), [[T::one(), T::zero()], [T::zero(), T::one()]]);
                for i in 0..wheels {
                    free = free + pull[i] * still[i];
                    one[0][0] = (-pull[i].x).mul_add(shift[i].x, one[0][0]);
                    one[0][1] = (-pull[i].x).mul_add(shift[i].y, one[0][1]);
                    one[1][0] = (-pull[i].y).mul_add(shift[i].x, one[1][0]);
                    one[1][1] = (-pull[i].y).mul_add(shift[i].y, one[1][1]);
                }
                let determinant = one[0][0] * one[1][1] - one[0][1] * one[1][0];
                let bounded = T::from(1e-3).less(determinant);
                let scale = T::one() / T::select(bounded, determinant, T::one());
                force = vec2(
                    one[1][1] * free.x - one[0][1] * free.y,
                    one[0][0] * free.y - one[1][0] * free.x,
                ) * scale;
                if !bounded.all() {
                    // Load transfer feeds itself: it grows from that at rest until a wheel lifts.
                    let grown = self.feed(free, pull, (still, shift));
                    force = vec2(
                        T::select(bounded, force.x, grown.x),
                        T::select(bounded, force.y, grown.y),
                    );
                }
            }
            // The wheel that would pull hardest lifts off, and the others are asked again.
            let mut loads = [T::zero(); MAX_WHEELS];
            let mut worst = T::zero();
            for i in 0..wheels {
                let load = shift[i].dot(force) + still[i];
                loads[i] = T::select(lifted[i], T::zero(), load);
                worst = worst.min(loads[i]);
            }
            let pulls = worst.less(T::zero());
            for i in 0..wheels {
                lifted[i] = lifted[i].or(pulls.and(loads[i].less_equal(worst)));
                loads[i] = loads[i].max(T::zero());
            }
            tries += 1;
            let support = match &self.support {
                Some(support) if pulls.any() && tries < wheels => support,
                _ => return loads,
            };
            let center = self.first * (T::one() / self.mass);
            changed = match lie {
                None => support.affine(self.weight, center, self.height, &lifted),
                Some(lie) => lie.without(self, support, &lifted),
            };
            (still, shift) = (&changed.0, &changed.1);
        }
    }

    /// The force of all contacts that keeps the robot at rest, N, base axes.
    #[inline(always)]
    fn held(&self, x: &[T], lie: Option<&Lie<T>>) -> Vec2<T> {
        match lie {
            None => self.ground.gravity.rotated(x[YAW + 1], -x[YAW + 2]) * -self.mass,
            Some(lie) => vec2(-lie.stance.push[0], -lie.stance.push[1]),
        }
    }

    /// The force of all contacts, N, where it feeds itself through the loads: grown from the force
    /// without load transfer, `free`, until a load is below zero.
    #[inline(never)]
    fn feed(
        &self,
        free: Vec2<T>,
        pull: &[Vec2<T>; MAX_WHEELS],
        (still, shift): (&[T; MAX_WHEELS], &[Vec2<T>; MAX_WHEELS]),
    ) -> Vec2<T> {
        let mut force = free;
        for _ in 0..64 {
            let mut next = free;
            let mut over = T::Mask::splat(false);
            for i in 0..self.layout().wheels {
                let moved = shift[i].dot(force);
                over = over.or((moved + still[i]).less(T::zero()));
                next = next + pull[i] * moved;
            }
            force = vec2(
                T::select(over, force.x, next.x),
                T::select(over, force.y, next.y),
            );
        }
        force
    }

    /// The contacts at an instant.
    #[inline(always)]
    fn contacts(&self, x: &[T], lie: Option<&Lie<T>>) -> Contacts<T> {
        let layout = self.layout();
        let at = layout.velocity();
        let (velocity, yaw_rate) = (vec2(x[at], x[at + 1]), x[at + 2]);
        let mut contacts = Contacts {
            slip: [Vec2::zero(); MAX_WHEELS],
            grip: [Vec2::zero(); MAX_WHEELS],
            load: [T::zero(); MAX_WHEELS],
            eased: [T::one(); MAX_WHEELS],
        };
        let mut pull = [Vec2::zero(); MAX_WHEELS];
        for i in 0..layout.wheels {
            if self.follows(i) {
                continue;
            }
            let frame = self.platform.wheel_frame(i, x);
            let axes = self.axes(i, &frame, lie);
            let carried = velocity + frame.contact.perpendicular() * yaw_rate;
            let rate = x[self.rate(i)];
            let slip = axes.slip(carried, rate);
            let z = self.deflection(i);
            let rolling = (axes.lever * rate).abs();
            let tire = self.tire(i, x, frame.contact);
            let grip = tire.force(slip, vec2(x[z], x[z + 1]), rolling);
            contacts.slip[i] = slip;
            contacts.grip[i] = grip;
            contacts.eased[i] = axes.eased(grip);
            pull[i] = axes.felt(grip) * contacts.eased[i];
        }
        contacts.load = self.carry(x, &pull, lie);
        if lie.is_some() {
            for i in 0..layout.wheels {
                contacts.load[i] *= contacts.eased[i];
            }
        }
        contacts
    }

    /// What drive and friction do at the axle of wheel i.
    #[inline(always)]
    fn act(&self, i: usize, x: &[T], u: &[T], mode: &[T]) -> Action<T> {
        let rate = x[self.rate(i)];
        let current = match self.axles[i].current() {
            Some(at) => x[at],
            None => T::zero(),
        };
        let brake = u[self.layout().brake_input()];
        self.axles[i].act(u[i], brake, mode[i], rate, current)
    }

    /// Generalised force on the velocity coordinates without the contacts': quadratic terms, gravity,
    /// external wrench, steering motors.
    #[inline(always)]
    fn free_force(&self, x: &[T], u: &[T], v: &[T], lie: Option<&Lie<T>>) -> Row<T> {
        let layout = self.layout();
        let (velocity, yaw_rate) = (vec2(v[0], v[1]), v[2]);
        let gravity = self.ground.gravity.rotated(x[YAW + 1], -x[YAW + 2]);
        let at = layout.wrench_input();
        let mut force = zero_row();
        // m (g − ω Ω V) + ω² m c, and its moment about P.
        let felt = gravity - velocity.perpendicular() * yaw_rate;
        let linear = felt * self.mass + self.first * (yaw_rate * yaw_rate) + vec2(u[at], u[at + 1]);
        force[0] = linear.x;
        force[1] = linear.y;
        force[2] = self.first.cross(felt) + u[at + 2];
        for k in 0..layout.steered.len() {
            let pivot = self.platform.wheels()[layout.steered[k]].pivot_viscous;
            force[3 + k] = u[layout.steering_input() + k] - pivot * v[3 + k];
        }
        if let Some(lie) = lie {
            lie.push(self, x, &mut force);
        }
        force
    }

    /// Power that enters by drives of steering and the external wrench, and what pivots lose, W.
    #[inline(always)]
    fn outer_power(&self, u: &[T], v: &[T]) -> (T, T) {
        let layout = self.layout();
        let at = layout.wrench_input();
        let mut supplied = u[at].mul_add(v[0], u[at + 1].mul_add(v[1], u[at + 2] * v[2]));
        let mut lost = T::zero();
        for k in 0..layout.steered.len() {
            let pivot = self.platform.wheels()[layout.steered[k]].pivot_viscous;
            supplied = u[layout.steering_input() + k].mul_add(v[3 + k], supplied);
            lost = (pivot * v[3 + k]).mul_add(v[3 + k], lost);
        }
        (supplied, lost)
    }

    /// Rates of all that follows from the velocities: pose, angles of wheels.
    #[inline(always)]
    fn follow(&self, x: &[T], dx: &mut [T], lie: Option<&Lie<T>>) {
        let layout = self.layout();
        let at = layout.velocity();
        let (velocity, yaw_rate) = (vec2(x[at], x[at + 1]), x[at + 2]);
        let turn = self.turning(x, lie);
        [dx[0], dx[1]] = self.way(x, lie);
        dx[YAW] = turn;
        dx[YAW + 1] = -(x[YAW + 2] * turn);
        dx[YAW + 2] = x[YAW + 1] * turn;
        for i in 0..layout.wheels {
            dx[layout.spin(i)] = self.spin(i, x, velocity, yaw_rate);
        }
        for (k, &i) in layout.swivels.iter().enumerate() {
            let rate = self.swivel_rate(i, x, velocity, yaw_rate, &x[at..at + layout.dof()]);
            let at = layout.swivel(k);
            dx[at] = rate;
            dx[at + 1] = -(x[at + 2] * rate);
            dx[at + 2] = x[at + 1] * rate;
        }
    }

    /// Rates of x and y on the map, m/s.
    #[inline(always)]
    fn way(&self, x: &[T], lie: Option<&Lie<T>>) -> [T; 2] {
        let at = self.layout().velocity();
        let velocity = vec2(x[at], x[at + 1]);
        match lie {
            None => {
                let travel = velocity.rotated(x[YAW + 1], x[YAW + 2]);
                [travel.x, travel.y]
            }
            Some(lie) => {
                let rates = match lie.moves(self, x) {
                    Some((rates, _)) => rates,
                    None => lie.stance.pose_rates(velocity, x[at + 2]),
                };
                [rates[0], rates[1]]
            }
        }
    }

    /// Rate of yaw on the map, rad/s.
    #[inline(always)]
    fn turning(&self, x: &[T], lie: Option<&Lie<T>>) -> T {
        let at = self.layout().velocity();
        match lie {
            None => x[at + 2],
            Some(lie) => match lie.moves(self, x) {
                Some((rates, _)) => rates[2],
                None => lie.stance.pose_rates(vec2(x[at], x[at + 1]), x[at + 2])[2],
            },
        }
    }

    /// φ̇ of wheel i: its own, or as a caster rolls.
    #[inline(always)]
    fn spin(&self, i: usize, x: &[T], velocity: Vec2<T>, yaw_rate: T) -> T {
        if self.follows(i) {
            let frame = self.platform.wheel_frame(i, x);
            self.platform.spin_rate(i, &frame, velocity, yaw_rate)
        } else {
            x[self.rate(i)]
        }
    }

    /// Torque that would turn wheel i if dry friction did not hold it, N·m.
    #[inline(always)]
    fn pushed(&self, i: usize, x: &[T], u: &[T], contacts: &Contacts<T>) -> T {
        let free = self.act(i, x, u, &[T::zero(); MAX_WHEELS]);
        let frame = self.platform.wheel_frame(i, x);
        let lever = self.platform.rolling_row(i, &frame).lever;
        free.torque - lever * contacts.grip[i].x * contacts.load[i]
    }
}

#[inline(always)]
fn is_zero<T: Scalar>(value: T) -> T::Mask {
    value.abs().less_equal(T::zero())
}

impl<T: Scalar> Dynamics<T> for Slip<T> {
    fn sizes(&self) -> Sizes {
        let layout = self.layout();
        Sizes {
            state: self.state(),
            input: layout.input(),
            output: layout.output()
                + SLIP_OUTPUTS * layout.wheels
                + self.travel().map_or(0, |_| layout.wheels),
            mode: layout.wheels,
            guards: layout.wheels,
        }
    }

    fn derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        let layout = self.layout();
        let n = layout.dof();
        let at = layout.velocity();
        let v = &x[at..at + n];
        let lie = self.lie(x);
        let lie = lie.as_ref();
        let contacts = self.contacts(x, lie);
        let mut force = self.free_force(x, u, v, lie);
        let (mut supplied, mut friction) = self.outer_power(u, v);
        let (mut windings, mut gears) = (T::zero(), T::zero());
        for i in 0..layout.wheels {
            let z = self.deflection(i);
            let rate = self.rate(i);
            (dx[rate], dx[z], dx[z + 1]) = (T::zero(), T::zero(), T::zero());
            if self.follows(i) {
                continue;
            }
            let frame = self.platform.wheel_frame(i, x);
            let axes = self.axes(i, &frame, lie);
            let lever = axes.lever;
            let draw = contacts.grip[i] * contacts.load[i];
            let pull = axes.felt(draw);
            force[0] += pull.x;
            force[1] += pull.y;
            force[2] += frame.contact.cross(pull);
            let action = self.act(i, x, u, mode);
            let net = action.torque - action.lost - lever * draw.x;
            dx[rate] = T::select(action.stuck, T::zero(), net / self.spin_inertia[i]);
            let slip = contacts.slip[i];
            let rolling = (lever * x[rate]).abs();
            let tire = self.tire(i, x, frame.contact);
            let moved = tire.rate(slip, vec2(x[z], x[z + 1]), rolling);
            (dx[z], dx[z + 1]) = (moved.x, moved.y);
            if let Some(at) = self.axles[i].current() {
                dx[at] = action.current_rate;
            }
            supplied += action.supplied;
            windings += action.windings;
            gears += action.gears;
            friction += action.rubbed - draw.dot(slip);
        }
        dx[self.attitude()..].fill(T::zero());
        let v_rate = match self.accelerate(x, &force, lie) {
            Some((rates, heave)) => {
                let up = self.attitude() + 3;
                dx[up..up + 3].copy_from_slice(&heave);
                rates
            }
            None => product(n, &self.inverse, &force),
        };
        dx[at..at + n].copy_from_slice(&v_rate[..n]);
        if let Some((_, lies)) = lie.and_then(|lie| lie.moves(self, x)) {
            let at = self.attitude();
            dx[at..at + 3].copy_from_slice(&lies);
        }
        friction += self.damped(x, lie);
        self.follow(x, dx, lie);
        let ledger = layout.ledger();
        dx[ledger..ledger + 4].copy_from_slice(&[supplied, windings, gears, friction]);
    }

    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        let layout = self.layout();
        let n = layout.dof();
        let at = layout.velocity();
        let v = &x[at..at + n];
        let (velocity, yaw_rate) = (vec2(v[0], v[1]), v[2]);
        let lie = self.lie(x);
        let lie = lie.as_ref();
        let contacts = self.contacts(x, lie);
        let half = T::from(0.5);
        let mut kinetic = crate::solve::dot(n, &product(n, &self.inertia, v), v);
        let mut magnetic = T::zero();
        let mut force = Vec2::zero();
        for i in 0..layout.wheels {
            let wheel = &self.platform.wheels()[i];
            let frame = self.platform.wheel_frame(i, x);
            let axes = self.axes(i, &frame, lie);
            let lever = axes.lever;
            let spin = self.spin(i, x, velocity, yaw_rate);
            let draw = contacts.grip[i] * contacts.load[i];
            force = force + axes.felt(draw);
            let mut action = Action::none();
            if !self.follows(i) {
                kinetic = (self.spin_inertia[i] * spin).mul_add(spin, kinetic);
                action = self.act(i, x, u, mode);
            }
            if let Drive::DcMotor(motor) = &wheel.drive {
                magnetic += half * motor.inductance * action.current * action.current;
            }
            let swivel = if wheel.swivels() {
                self.swivel_rate(i, x, velocity, yaw_rate, v)
            } else {
                T::zero()
            };
            let mut set = |what: WheelOutput, value: T| y[layout.wheel_output(i, what)] = value;
            set(WheelOutput::SpinRate, spin);
            set(WheelOutput::SteeringRate, swivel);
            set(WheelOutput::Torque, action.torque);
            set(WheelOutput::Current, action.current);
            set(WheelOutput::Longitudinal, draw.x);
            set(WheelOutput::Lateral, draw.y);
            set(WheelOutput::Load, contacts.load[i]);
            let slip = contacts.slip[i];
            let rolling = (lever * spin).abs().max(T::from(SLOWEST));
            let carried = velocity + frame.contact.perpendicular() * yaw_rate;
            let most = self.tire(i, x, frame.contact).friction(slip) * contacts.load[i];
            let bears = T::zero().less(most);
            let used = draw.dot(draw).sqrt() / T::select(bears, most, T::one());
            let ahead = frame.forward.dot(carried).abs().max(T::from(SLOWEST));
            let mut set = |what: SlipOutput, value: T| y[self.slip_output(i, what)] = value;
            set(SlipOutput::Along, slip.x);
            set(SlipOutput::Across, slip.y);
            set(SlipOutput::Ratio, -slip.x / rolling);
            set(SlipOutput::Angle, (-slip.y).atan2(ahead));
            set(SlipOutput::Use, T::select(bears, used, T::zero()));
            set(SlipOutput::Power, -draw.dot(slip));
        }
        y[0] = velocity.x;
        y[1] = velocity.y;
        y[2] = yaw_rate;
        y[3] = half.mul_add(kinetic, self.swung(x));
        let center = vec2(x[0], x[1]) * self.mass + self.first.rotated(x[YAW + 1], x[YAW + 2]);
        y[4] = -self.ground.gravity.dot(center);
        y[5] = magnetic;
        if let (Some(lie), Some(footing)) = (lie, &self.footing) {
            y[4] = lie.stance.potential;
            if let Some(at) = self.travel() {
                self.travelled(lie, &mut y[at..]);
            }
            // On springs the loads are those that the forces have made.
            let push = vec2(lie.stance.push[0], lie.stance.push[1]);
            let sprung = lie.spring.is_some();
            let force = if sprung { -push } else { force };
            let margin = footing.margin(&self.platform, &lie.stance, force);
            // They lie within the wheels that bear, and on their edge by rounding.
            y[BODY_OUTPUTS - 1] = if sprung {
                margin.max(T::zero())
            } else {
                margin
            };
            return;
        }
        y[BODY_OUTPUTS - 1] = match &self.support {
            Some(support) => {
                let center = self.first * (T::one() / self.mass);
                // Without weight nothing says where it would stand.
                let stands = T::zero().less(self.weight);
                let lift = self.height / T::select(stands, self.weight, T::one());
                let margin = support.margin(center - force * lift);
                T::select(stands, margin, T::zero())
            }
            None => T::zero(),
        };
    }

    /// What rests and is pushed harder than its friction holds turns; a wheel takes the sense in which
    /// it turns.
    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        let lie = self.lie(x);
        let contacts = self.contacts(x, lie.as_ref());
        let brake = u[self.layout().brake_input()];
        for i in 0..self.layout().wheels {
            if !self.axles[i].rubs || self.follows(i) {
                continue;
            }
            let rate = x[self.rate(i)];
            let pushed = self.pushed(i, x, u, &contacts);
            let bound = self.axles[i].bound(brake);
            let rests = is_zero(rate);
            let holds = rests.and(pushed.abs().less_equal(bound));
            let sense = T::one().copysign(T::select(rests, pushed, rate));
            mode[i] = T::select(holds, T::zero(), sense);
        }
    }

    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        self.platform.renew_angles(x);
        self.stand(x);
        let brake = u[self.layout().brake_input()];
        for i in 0..self.layout().wheels {
            if !self.axles[i].rubs || self.follows(i) {
                continue;
            }
            let rate = x[self.rate(i)];
            let bounded = T::zero().less(self.axles[i].bound(brake));
            let turned = (rate * mode[i]).less_equal(T::zero()).and(bounded);
            x[self.rate(i)] = T::select(turned, T::zero(), rate);
            mode[i] = T::select(turned, T::zero(), T::one().copysign(rate));
        }
    }

    fn straighten(&self, stage: &mut [T]) {
        self.platform.straighten(stage);
    }

    fn guards(&self, x: &[T], u: &[T], mode: &[T], g: &mut [T]) {
        let lie = self.lie(x);
        let contacts = self.contacts(x, lie.as_ref());
        let brake = u[self.layout().brake_input()];
        for i in 0..self.layout().wheels {
            let bound = self.axles[i].bound(brake);
            let rubs = self.axles[i].rubs && !self.follows(i);
            let slack = bound - self.pushed(i, x, u, &contacts).abs();
            let turning = x[self.rate(i)] * mode[i];
            let guard = T::select(is_zero(mode[i]), slack, turning);
            g[i] = if rubs { guard } else { T::one() };
        }
    }

    fn is_derived(&self, index: usize) -> bool {
        let follows = index >= self.attitude() && self.springs().is_none();
        follows || self.platform.repeats_angle(index)
    }
}
