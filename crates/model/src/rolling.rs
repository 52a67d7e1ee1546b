//! Level `rolling`: dynamics of a platform whose wheels roll without slip. `[eq:reduced-dynamics]`
//!
//! Gibbs–Appell equations in the velocity coordinates v of [`crate::platform`]:
//! SᵀMS v̇ + ω G v + (terms of turning wheel planes) = SᵀF, with dry friction as a mode.
//! Base frame of the robot for forces and rows, world frame for the pose.

pub(crate) mod axle;
mod compiled;
mod contact;
mod friction;
mod inverse;

use crate::drive::Drive;
use crate::dynamics::{CORE_INPUT, Core, Dynamics, Nodes, Sizes, Work};
use crate::ground::Ground;
use crate::lanewise;
use crate::lanewise::Lanewise;
use crate::planar::{Vec2, vec2};
use crate::platform::{
    BODY_OUTPUTS, MAX_WHEELS, Platform, Reduced, WHEEL_OUTPUTS, WheelOutput, YAW,
};
use crate::scalar::{Mask, Scalar};
use crate::solve::{Condition, Mobility, Row, Square, dot, invert, product, zero_row};
use crate::support::Support;
use crate::wheel::{Wheel, WheelFrame};

use axle::{Action, Axle, Supply};
use compiled::Shape;

pub use inverse::Demand;

/// A platform on a ground, ready to be integrated.
#[derive(Clone, Debug)]
pub struct Rolling<T: Scalar> {
    platform: Platform<T>,
    ground: Ground<T>,
    /// What does not change, where the geometry does not.
    constant: Option<Box<Constant<T>>>,
    /// The same with sizes known to the compiler, for the commonest platforms.
    shape: Option<Shape<T>>,
    axles: Vec<Axle<T>>,
    /// Whether any wheel has dry friction or a brake.
    any_rubs: bool,
    /// Whether gravity has no part along the ground.
    is_level: bool,
    /// Whether the ground is level and the only friction is viscous.
    is_smooth: bool,
    /// Whether a step needs the stages of its core alone: of a shape with motors, without dry friction.
    is_gathered: bool,
    /// Whether its two driven wheels are alike, left and right: then the core has sums and differences.
    is_paired: bool,
    /// Whether a step may leave out the energy ledger and the angles of driven wheels.
    is_bare: bool,
    /// The contacts that carry it, where three or more span a plane.
    support: Option<Support<T>>,
}

/// What follows from a geometry that does not change.
#[derive(Clone, Debug)]
struct Constant<T> {
    reduced: Reduced<T>,
    /// Inverse of the reduced mass matrix.
    inverse: Square<T>,
    /// Which side forces give the wheels together a force and moment.
    sideways: [[T; 3]; 3],
}

/// What acts on the platform at an instant.
struct Forces<T: Scalar> {
    /// Generalised force minus quadratic terms, over v.
    total: Row<T>,
    /// Each wheel.
    actions: [Action<T>; MAX_WHEELS],
    /// φ̈ at v̇ = 0.
    convective: [T; MAX_WHEELS],
    velocity: Vec2<T>,
    yaw_rate: T,
    gravity: Vec2<T>,
}

impl<T: Scalar> Lanewise for Rolling<T> {
    type One = Rolling<f64>;

    fn fits(&self, one: &Rolling<f64>) -> bool {
        self.platform.fits(&one.platform)
            && self.ground.fits(&one.ground)
            && self.shape.fits(&one.shape)
            && self.is_paired == one.is_paired
            && self.support.fits(&one.support)
    }

    fn put(&mut self, lane: usize, one: &Rolling<f64>) {
        self.platform.put(lane, &one.platform);
        self.ground.put(lane, &one.ground);
        self.shape.put(lane, &one.shape);
        self.axles.put(lane, &one.axles);
        self.support.put(lane, &one.support);
        if let (Some(constant), Some(one)) = (&mut self.constant, &one.constant) {
            constant.put(lane, one);
        }
    }
}

lanewise!(Constant {} state { reduced, inverse, sideways });

impl<T: Scalar> Rolling<T> {
    /// Joins a platform and a ground.
    pub fn new(platform: Platform<T>, ground: Ground<T>) -> Self {
        let layout = platform.layout().clone();
        let axle = |(i, wheel): (usize, &Wheel<T>)| {
            let slot = layout.motors.iter().position(|&m| m == i);
            Axle::new(wheel, slot.map(|m| layout.current() + m))
        };
        let axles: Vec<Axle<T>> = platform.wheels().iter().enumerate().map(axle).collect();
        let constant = layout.constant.then(|| {
            let reduced = platform.reduce(&vec![T::zero(); layout.state()]);
            Box::new(Constant {
                inverse: invert(layout.dof(), &reduced.mass),
                reduced,
                sideways: contact::side_forces(&platform),
            })
        });
        // A caster's contact moves by its trail; for the loads it stands under its pivot.
        let contacts: Vec<_> = platform
            .wheels()
            .iter()
            .map(|wheel| (wheel.mount, wheel.stiffness))
            .collect();
        let support = Support::new(&contacts);
        let is_level = is_zero(ground.gravity.x)
            .and(is_zero(ground.gravity.y))
            .all();
        let is_dry = |axle: &Axle<T>| axle.rubs || axle.rounding.is_some();
        let mut rolling = Rolling {
            platform,
            ground,
            constant: None,
            shape: None,
            any_rubs: axles.iter().any(|axle| axle.rubs),
            is_level,
            is_smooth: is_level && !axles.iter().any(is_dry),
            is_gathered: !axles.iter().any(is_dry),
            is_paired: false,
            is_bare: false,
            axles,
            support,
        };
        rolling.shape = constant
            .as_ref()
            .and_then(|constant| Shape::new(&rolling, constant));
        let core = |shape: &Shape<T>| shape.core(false);
        rolling.is_gathered &= rolling.shape.as_ref().and_then(core).is_some();
        let pairs = rolling.shape.as_ref().is_some_and(Shape::pairs);
        rolling.is_paired = rolling.is_gathered && pairs;
        rolling.constant = constant;
        rolling
    }

    /// Leaves it to a step whether it keeps the energy ledger and the angles of driven wheels, which
    /// nothing else follows from: where nobody reads them they are half of its work. What they hold then
    /// means nothing; all other states keep their bits.
    pub fn leave_out(&mut self) {
        self.is_bare = true;
    }

    /// Steps driven wheels one by one, even where they are alike.
    pub fn part(&mut self) {
        self.is_paired = false;
    }

    /// The platform.
    pub fn platform(&self) -> &Platform<T> {
        &self.platform
    }

    /// The contacts that carry it, where three or more span a plane.
    pub fn support(&self) -> Option<&Support<T>> {
        self.support.as_ref()
    }

    /// The ground.
    pub fn ground(&self) -> &Ground<T> {
        &self.ground
    }

    /// Reduced mass matrix, G and rows at a state; for reports.
    pub fn reduced(&self, x: &[T]) -> Reduced<T> {
        match &self.constant {
            Some(constant) => constant.reduced,
            None => self.platform.reduce(x),
        }
    }

    /// The reduced equations at a state: those that do not change, or new ones, kept in `room`.
    #[inline(always)]
    fn reduced_in<'a>(&'a self, x: &[T], room: &'a mut Option<Reduced<T>>) -> &'a Reduced<T> {
        match &self.constant {
            Some(constant) => &constant.reduced,
            None => room.insert(self.platform.reduce(x)),
        }
    }

    /// Whether nothing acts under this input but drives and viscous friction, on level ground.
    #[inline(always)]
    fn is_plain(&self, u: &[T]) -> bool {
        let at = self.platform.layout().wrench_input();
        self.is_smooth && is_still(&u[at..at + 3])
    }

    /// Largest friction torque of wheel i, N·m.
    #[inline(always)]
    fn bound(&self, i: usize, u: &[T]) -> T {
        self.axles[i].bound(u[self.platform.layout().brake_input()])
    }

    #[inline(always)]
    fn forces(&self, x: &[T], u: &[T], mode: &[T], reduced: &Reduced<T>) -> Forces<T> {
        let layout = self.platform.layout();
        let n = layout.dof();
        let v = &x[layout.velocity()..layout.velocity() + n];
        let (velocity, yaw_rate) = self.platform.twist(v);
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let gravity = self.ground.gravity.rotated(cos, -sin);
        let mut forces = Forces {
            total: zero_row(),
            actions: [Action::none(); MAX_WHEELS],
            convective: [T::zero(); MAX_WHEELS],
            velocity,
            yaw_rate,
            gravity,
        };
        let wrench = &u[layout.wrench_input()..layout.wrench_input() + 3];
        let origin = self.platform.point_rows(Vec2::zero());
        let yaw = self.platform.yaw_row();
        let brake = u[layout.brake_input()];
        for k in 0..n {
            // Quadratic terms, gravity at the centers of mass, external wrench at P.
            let gyro = dot(n, &reduced.gyro[k], v) * yaw_rate;
            let weight =
                reduced.momentum[0][k].mul_add(gravity.x, reduced.momentum[1][k] * gravity.y);
            let outside = origin[0][k].mul_add(
                wrench[0],
                origin[1][k].mul_add(wrench[1], yaw[k] * wrench[2]),
            );
            forces.total[k] = weight + outside - gyro;
        }
        for i in 0..layout.wheels {
            if !self.platform.is_dynamic(i) {
                continue;
            }
            let rate = dot(n, &reduced.spin[i], v);
            let current = match self.axles[i].supply {
                Supply::Motor(_, at) => x[at],
                _ => T::zero(),
            };
            let action = self.axles[i].act(u[i], brake, mode[i], rate, current);
            forces.actions[i] = action;
            let net = action.torque - action.lost;
            for k in 0..n {
                forces.total[k] = reduced.spin[i][k].mul_add(net, forces.total[k]);
            }
        }
        if self.constant.is_none() {
            self.add_turning(x, u, reduced, &mut forces);
        }
        forces
    }

    /// Terms of wheel planes that turn: inertia of swivelling wheels, pivot losses, steering motors.
    #[inline(always)]
    fn add_turning(&self, x: &[T], u: &[T], reduced: &Reduced<T>, forces: &mut Forces<T>) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let v = &x[layout.velocity()..layout.velocity() + n];
        let yaw = self.platform.yaw_row();
        for (k, _) in layout.steered.iter().enumerate() {
            forces.total[layout.eta + k] += u[layout.steering_input() + k];
        }
        for &i in &layout.swivels {
            let wheel = &self.platform.wheels()[i];
            let frame = self.platform.wheel_frame(i, x);
            let swivel = &reduced.swivel[i];
            let steering_rate = dot(n, swivel, v);
            let convective = self.platform.convective(
                i,
                &frame,
                forces.velocity,
                forces.yaw_rate,
                steering_rate,
            );
            forces.convective[i] = convective.spin;
            let rows = self.platform.carrier_rows(i, &frame, swivel);
            let inertia = convective.contact * wheel.mass;
            let turning = wheel.inertia_vertical * convective.swivel;
            let spinning = wheel.spin_inertia * convective.spin;
            let pivot = wheel.pivot_viscous * steering_rate;
            for k in 0..n {
                let carried = rows[0][k].mul_add(inertia.x, rows[1][k] * inertia.y);
                let turned = (yaw[k] + swivel[k]).mul_add(turning, reduced.spin[i][k] * spinning);
                forces.total[k] -= carried + turned + swivel[k] * pivot;
            }
        }
    }

    /// Inverse of the reduced mass matrix.
    #[inline(always)]
    fn inverse_mass(&self, reduced: &Reduced<T>) -> Square<T> {
        match &self.constant {
            Some(constant) => constant.inverse,
            None => crate::solve::inverse(self.platform.layout().dof(), &reduced.mass),
        }
    }

    /// The accelerations v̇. Where no wheel is steered and none sticks nothing narrows them.
    #[inline(always)]
    fn acceleration(&self, x: &[T], reduced: &Reduced<T>, forces: &Forces<T>) -> Row<T> {
        let layout = self.platform.layout();
        let mut sticking = !layout.steered.is_empty();
        for i in 0..layout.wheels {
            sticking |= forces.actions[i].stuck.any();
        }
        if sticking {
            let (mut v_rate, mut mobility) = steered_acceleration(self, x, reduced, forces);
            friction::hold(
                self,
                reduced,
                &forces.stuck(),
                &forces.convective,
                &mut mobility,
                &mut v_rate,
            );
            return v_rate;
        }
        match &self.constant {
            // By reference: the matrix of many lanes is too large to be copied each time.
            Some(constant) => product(layout.dof(), &constant.inverse, &forces.total),
            None => product(layout.dof(), &self.inverse_mass(reduced), &forces.total),
        }
    }

    /// The accelerations under the conditions of steered wheels only, with the mobility they leave.
    #[inline(always)]
    fn steered_acceleration(
        &self,
        x: &[T],
        reduced: &Reduced<T>,
        forces: &Forces<T>,
    ) -> (Row<T>, Mobility<T>) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let inverse = self.inverse_mass(reduced);
        let mut v_rate = product(n, &inverse, &forces.total);
        let mut mobility = Mobility::new(n, &inverse);
        let v = &x[layout.velocity()..layout.velocity() + n];
        for &i in &layout.guides {
            let frame = self.platform.wheel_frame(i, x);
            let steering_rate = dot(n, &reduced.swivel[i], v);
            let condition = Condition {
                row: self.platform.lateral_row(&frame),
                value: self.lateral_drift(i, steering_rate, &frame, forces),
                active: T::Mask::splat(true),
            };
            mobility.impose(&condition, &mut v_rate);
        }
        (v_rate, mobility)
    }

    /// The derivative of any platform.
    #[inline(always)]
    fn any_derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let mut room = None;
        let reduced = self.reduced_in(x, &mut room);
        let forces = self.forces(x, u, mode, reduced);
        let v_rate = self.acceleration(x, reduced, &forces);
        let (velocity, yaw_rate) = (forces.velocity, forces.yaw_rate);
        self.pose_rates(x, velocity, yaw_rate, dx);
        dx[layout.velocity()..layout.velocity() + n].copy_from_slice(&v_rate[..n]);

        let v = &x[layout.velocity()..layout.velocity() + n];
        let mut supplied = T::zero();
        let mut windings = T::zero();
        let mut gears = T::zero();
        let mut friction = T::zero();
        for (k, &i) in layout.swivels.iter().enumerate() {
            let frame = self.platform.wheel_frame(i, x);
            let swivel = self.platform.swivel_row(i, &frame);
            let rate = dot(n, &swivel, v);
            let at = layout.swivel(k);
            dx[at] = rate;
            dx[at + 1] = -(x[at + 2] * rate);
            dx[at + 2] = x[at + 1] * rate;
            let pivot = self.platform.wheels()[i].pivot_viscous;
            friction = (pivot * rate).mul_add(rate, friction);
            if !self.platform.is_dynamic(i) {
                let spin = self.platform.spin_row(i, &frame);
                dx[layout.spin(i)] = dot(n, &spin, v);
            }
        }
        for k in 0..layout.steered.len() {
            supplied = u[layout.steering_input() + k].mul_add(v[layout.eta + k], supplied);
        }
        for i in 0..layout.wheels {
            if !self.platform.is_dynamic(i) {
                continue;
            }
            let action = &forces.actions[i];
            dx[layout.spin(i)] = action.rate;
            if let Supply::Motor(_, at) = self.axles[i].supply {
                dx[at] = action.current_rate;
            }
            supplied += action.supplied;
            windings += action.windings;
            gears += action.gears;
            friction += action.rubbed;
        }
        let wrench = &u[layout.wrench_input()..layout.wrench_input() + 3];
        supplied += wrench[0].mul_add(
            velocity.x,
            wrench[1].mul_add(velocity.y, wrench[2] * yaw_rate),
        );
        let ledger = layout.ledger();
        dx[ledger] = supplied;
        dx[ledger + 1] = windings;
        dx[ledger + 2] = gears;
        dx[ledger + 3] = friction;
    }

    /// The motion of any platform.
    #[inline(always)]
    fn any_motion(&self, x: &[T], mode: &[T], y: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let v = &x[layout.velocity()..layout.velocity() + n];
        let (velocity, yaw_rate) = self.platform.twist(v);
        y[0] = velocity.x;
        y[1] = velocity.y;
        y[2] = yaw_rate;
        for i in 0..layout.wheels {
            let (rate, swivel) = match &self.constant {
                Some(constant) if self.platform.is_dynamic(i) => {
                    (dot(n, &constant.reduced.spin[i], v), T::zero())
                }
                Some(_) => self.follow(i, x, velocity, yaw_rate),
                None => {
                    let frame = self.platform.wheel_frame(i, x);
                    let spin = dot(n, &self.platform.spin_row(i, &frame), v);
                    (spin, dot(n, &self.platform.swivel_row(i, &frame), v))
                }
            };
            let rests = if self.axles[i].rubs {
                is_zero(mode[i])
            } else {
                T::Mask::splat(false)
            };
            y[layout.wheel_output(i, WheelOutput::SpinRate)] = T::select(rests, T::zero(), rate);
            y[layout.wheel_output(i, WheelOutput::SteeringRate)] = swivel;
        }
    }

    /// The outputs of any platform.
    #[inline(always)]
    fn any_output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let mut room = None;
        let reduced = self.reduced_in(x, &mut room);
        let forces = self.forces(x, u, mode, reduced);
        let v_rate = self.acceleration(x, reduced, &forces);
        let (longitudinal, lateral) = self.contact_forces(x, u, reduced, &forces, &v_rate);
        let v = &x[layout.velocity()..layout.velocity() + n];
        y[0] = forces.velocity.x;
        y[1] = forces.velocity.y;
        y[2] = forces.yaw_rate;
        y[3] = T::from(0.5) * dot(n, &product(n, &reduced.mass, v), v);
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let body = self.platform.body();
        let mut moment = body.center_of_mass * body.mass;
        let mut magnetic = T::zero();
        for i in 0..layout.wheels {
            let wheel = &self.platform.wheels()[i];
            let frame = self.platform.wheel_frame(i, x);
            moment = moment + frame.contact * wheel.mass;
            let Action {
                torque, current, ..
            } = forces.actions[i];
            if let Drive::DcMotor(motor) = &wheel.drive {
                magnetic += T::from(0.5) * motor.inductance * current * current;
            }
            let (rate, swivel) = if self.platform.is_dynamic(i) {
                (forces.actions[i].rate, dot(n, &reduced.swivel[i], v))
            } else {
                self.follow(i, x, forces.velocity, forces.yaw_rate)
            };
            let mut set = |what: WheelOutput, value: T| y[layout.wheel_output(i, what)] = value;
            set(WheelOutput::SpinRate, rate);
            set(WheelOutput::SteeringRate, swivel);
            set(WheelOutput::Torque, torque);
            set(WheelOutput::Current, current);
            set(WheelOutput::Longitudinal, longitudinal[i]);
            set(WheelOutput::Lateral, lateral[i]);
        }
        let mass = self.platform.total_mass();
        let center = vec2(x[0], x[1]) * mass + moment.rotated(cos, sin);
        y[4] = -self.ground.gravity.dot(center);
        y[5] = magnetic;
        let (loads, margin) = self.carry(x, &longitudinal, &lateral);
        y[6] = margin;
        for i in 0..layout.wheels {
            y[layout.wheel_output(i, WheelOutput::Load)] = loads[i];
        }
        debug_assert_eq!(y.len(), BODY_OUTPUTS + WHEEL_OUTPUTS * layout.wheels);
    }

    /// φ̇ and γ̇ of a caster that only follows.
    #[inline(always)]
    fn follow(&self, i: usize, x: &[T], velocity: Vec2<T>, yaw_rate: T) -> (T, T) {
        let frame = self.platform.wheel_frame(i, x);
        (
            self.platform.spin_rate(i, &frame, velocity, yaw_rate),
            self.platform.caster_rate(i, &frame, velocity, yaw_rate),
        )
    }

    /// Rates of the pose and of the heading's cosine and sine.
    #[inline(always)]
    fn pose_rates(&self, x: &[T], velocity: Vec2<T>, yaw_rate: T, dx: &mut [T]) {
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let travel = velocity.rotated(cos, sin);
        dx[0] = travel.x;
        dx[1] = travel.y;
        dx[YAW] = yaw_rate;
        dx[YAW + 1] = -(sin * yaw_rate);
        dx[YAW + 2] = cos * yaw_rate;
    }

    /// Right-hand side of the lateral constraint of a steered wheel: n · V̇_c = γ̇ e · V_c.
    #[inline(always)]
    fn lateral_drift(
        &self,
        i: usize,
        steering_rate: T,
        frame: &WheelFrame<T>,
        forces: &Forces<T>,
    ) -> T {
        let mount = self.platform.wheels()[i].mount;
        let carried = forces.velocity + mount.perpendicular() * forces.yaw_rate;
        steering_rate * frame.forward.dot(carried)
    }

    /// See [`Dynamics::decide`]; for wheels with dry friction.
    #[inline(always)]
    fn stick_or_slide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        let layout = self.platform.layout();
        let mut room = None;
        let reduced = self.reduced_in(x, &mut room);
        let at = layout.velocity();
        let n = layout.dof();
        let mut resting = T::Mask::splat(false);
        for i in 0..layout.wheels {
            if self.axles[i].rubs {
                // Nothing holds a wheel without friction, and one with friction may rest unseen:
                // a brake closes on a wheel that stands still.
                let rate = dot(n, &reduced.spin[i], &x[at..at + n]);
                let bounded = T::zero().less(self.bound(i, u));
                let rests = bounded.and(is_zero(mode[i]).or(is_zero(rate)));
                let turning = T::select(is_zero(mode[i]), T::one().copysign(rate), mode[i]);
                mode[i] = T::select(rests, T::zero(), turning);
                resting = resting.or(rests);
            }
        }
        if resting.any() {
            friction::release(self, x, u, mode, reduced);
        }
    }

    /// See [`Dynamics::settle`]; for wheels with dry friction, and steered ones.
    #[inline(always)]
    fn come_to_rest(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let steered = !layout.steered.is_empty();
        let mut room = None;
        let reduced = self.reduced_in(x, &mut room);
        let at = layout.velocity();
        let mut held = T::Mask::splat(false);
        let mut caught = T::Mask::splat(false);
        for i in 0..layout.wheels {
            if !self.axles[i].rubs {
                continue;
            }
            let rate = dot(n, &reduced.spin[i], &x[at..at + n]);
            let bound = self.bound(i, u);
            let rested = is_zero(mode[i]);
            let rests = rested.or((rate * mode[i]).less_equal(T::zero()));
            let sticks = rests.and(T::zero().less(bound));
            mode[i] = T::select(sticks, T::zero(), T::one().copysign(rate));
            held = held.or(sticks);
            caught = caught.or(sticks.and(rested.not()));
        }
        if self.constant.is_none() && caught.any() {
            // A wheel that turning wheel planes carry through rest is not held by its friction, and
            // must not stop the robot.
            friction::release(self, x, u, mode, reduced);
        }
        if !steered && !held.any() {
            return;
        }
        friction::project(self, x, u, mode, reduced);
    }
}

// What is no part of the common step is a function of its own, so that the step stays small; and each
// is entered by the widest instructions anew.
fused! {
    /// See [`Rolling::any_derivative`].
    fn any_derivative<T: Scalar>(
        rolling: &Rolling<T>,
        x: &[T],
        u: &[T],
        mode: &[T],
        dx: &mut [T],
    ) {
        rolling.any_derivative(x, u, mode, dx);
    }
}
fused! {
    /// See [`Rolling::any_output`].
    fn any_output<T: Scalar>(rolling: &Rolling<T>, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        rolling.any_output(x, u, mode, y);
    }
}
fused! {
    /// Whether nothing but zeros is in any lane.
    fn is_still<T: Scalar>(wrench: &[T]) -> bool {
        let mut still = T::Mask::splat(true);
        for k in 0..wrench.len() {
            still = still.and(is_zero(wrench[k]));
        }
        still.all()
    }
}
fused! {
    /// See [`Rolling::steered_acceleration`].
    fn steered_acceleration<T: Scalar>(
        rolling: &Rolling<T>,
        x: &[T],
        reduced: &Reduced<T>,
        forces: &Forces<T>,
    ) -> (Row<T>, Mobility<T>) {
        rolling.steered_acceleration(x, reduced, forces)
    }
}
fused! {
    /// See [`Rolling::stick_or_slide`].
    fn stick_or_slide<T: Scalar>(rolling: &Rolling<T>, x: &[T], u: &[T], mode: &mut [T]) {
        rolling.stick_or_slide(x, u, mode);
    }
}
fused! {
    /// See [`Rolling::come_to_rest`].
    fn come_to_rest<T: Scalar>(rolling: &Rolling<T>, x: &mut [T], u: &[T], mode: &mut [T]) {
        rolling.come_to_rest(x, u, mode);
    }
}

impl<T: Scalar> Forces<T> {
    /// Wheels held by dry friction.
    fn stuck(&self) -> [T::Mask; MAX_WHEELS] {
        self.actions.map(|action| action.stuck)
    }
}

#[inline(always)]
fn is_zero<T: Scalar>(value: T) -> T::Mask {
    value.abs().less_equal(T::zero())
}

impl<T: Scalar> Dynamics<T> for Rolling<T> {
    fn sizes(&self) -> Sizes {
        let layout = self.platform.layout();
        Sizes {
            state: layout.state(),
            input: layout.input(),
            output: layout.output(),
            mode: layout.wheels,
            guards: layout.wheels,
        }
    }

    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        match &self.shape {
            Some(shape) => compiled::derivative(shape, self, x, u, mode, dx),
            None => any_derivative(self, x, u, mode, dx),
        }
    }

    #[inline(always)]
    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        match &self.shape {
            // What sticks needs the general search for the forces that hold it.
            Some(shape) if !self.any_rubs => compiled::output(shape, self, x, u, mode, y),
            _ => any_output(self, x, u, mode, y),
        }
    }

    #[inline(always)]
    fn motion(&self, x: &[T], _u: &[T], mode: &[T], y: &mut [T]) {
        match &self.shape {
            Some(shape) if !self.any_rubs => compiled::motion(shape, self, x, y),
            _ => self.any_motion(x, mode, y),
        }
    }

    #[inline(always)]
    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        if self.any_rubs {
            stick_or_slide(self, x, u, mode);
        }
    }

    #[inline(always)]
    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        self.platform.renew_angles(x);
        if self.any_rubs || !self.platform.layout().steered.is_empty() {
            come_to_rest(self, x, u, mode);
        }
    }

    #[inline(always)]
    fn core(&self) -> Option<Core> {
        let shape = self.shape.as_ref().filter(|_| self.is_gathered)?;
        shape.core(self.is_paired)
    }

    #[inline(always)]
    fn is_paired(&self) -> bool {
        self.is_paired
    }

    #[inline(always)]
    fn core_enter(&self, core: Core, x: &[T], stage: &mut [T]) {
        compiled::core_enter(self.is_paired, core, x, stage);
    }

    #[inline(always)]
    fn core_leave(&self, core: Core, stage: &[T], x: &mut [T]) {
        compiled::core_leave(self.is_paired, core, stage, x);
    }

    #[inline(always)]
    fn core_input(&self, u: &[T], held: &mut [T; CORE_INPUT]) {
        let shape = self.shape.as_ref().expect("a core is of a shape");
        shape.core_input(self, u, held);
    }

    #[inline(always)]
    fn core_rates(&self, x: &[T], held: &[T], rates: &mut [T]) -> T::Mask {
        let shape = self.shape.as_ref().expect("a core is of a shape");
        compiled::core_rates(shape, self, x, held, rates)
    }

    #[inline(always)]
    fn core_rest(&self, x: &[T], held: &[T], rest: &mut [T]) -> T::Mask {
        let shape = self.shape.as_ref().expect("a core is of a shape");
        compiled::core_rest(shape, self, x, held, rest)
    }

    #[inline(always)]
    fn core_spins(&self, x: &[T], rates: &mut [T]) {
        let shape = self.shape.as_ref().expect("a core is of a shape");
        shape.core_spins(x, rates);
    }

    #[inline(always)]
    fn gather(&self, nodes: &Nodes<'_, T>, held: &[T], limited: T::Mask, x: &mut [T]) {
        let shape = self.shape.as_ref().expect("a core is of a shape");
        compiled::gather(shape, self, nodes, held, limited, x);
    }

    #[inline(always)]
    fn straighten(&self, stage: &mut [T]) {
        self.platform.straighten(stage);
    }

    fn guards(&self, x: &[T], u: &[T], mode: &[T], g: &mut [T]) {
        let layout = self.platform.layout();
        let reduced = self.reduced(x);
        let forces = self.forces(x, u, mode, &reduced);
        let any = (0..layout.wheels).any(|i| forces.actions[i].stuck.any());
        let held = if any {
            friction::holding_torques(self, x, &reduced, &forces)
        } else {
            [T::zero(); MAX_WHEELS]
        };
        for i in 0..layout.wheels {
            let slack = forces.actions[i].bound - held[i].abs();
            let turning = T::select(
                T::zero().less(forces.actions[i].bound),
                forces.actions[i].rate * mode[i],
                T::one(),
            );
            g[i] = T::select(forces.actions[i].stuck, slack, turning);
        }
    }

    fn linear_part(&self, mode: &[T], matrix: &mut [T]) -> Option<core::ops::Range<usize>> {
        // At constant geometry ż = A z + … for z = (v, currents): the derivative without its
        // quadratic, gravity and dry-friction terms, column by column.
        let Constant {
            reduced, inverse, ..
        } = self.constant.as_deref()?;
        let layout = self.platform.layout();
        let n = layout.dof();
        let size = n + layout.motors.len();
        let mut mobility = Mobility::new(n, inverse);
        let mut unused = zero_row();
        for i in 0..layout.wheels {
            if self.axles[i].rubs {
                let condition = Condition {
                    row: reduced.spin[i],
                    value: T::zero(),
                    active: is_zero(mode[i]),
                };
                mobility.impose(&condition, &mut unused);
            }
        }
        for entry in matrix[..size * size].iter_mut() {
            *entry = T::zero();
        }
        for i in 0..layout.wheels {
            if !self.platform.is_dynamic(i) {
                continue;
            }
            let spin = &reduced.spin[i];
            let response = product(n, mobility.matrix(), spin);
            let mut damping = self.axles[i].viscous;
            match &self.axles[i].supply {
                Supply::None | Supply::Torque(_) => {}
                Supply::Motor(winding, at) => {
                    let slot = at - layout.velocity();
                    for k in 0..n {
                        matrix[k * size + slot] += response[k] * winding.torque;
                        matrix[slot * size + k] -= spin[k] * winding.emf * winding.slope;
                    }
                    matrix[slot * size + slot] -= winding.resistance * winding.slope;
                }
                Supply::Resistor(winding) => {
                    damping += winding.torque * winding.emf * winding.conductance;
                }
            }
            for a in 0..n {
                for b in 0..n {
                    matrix[a * size + b] -= response[a] * damping * spin[b];
                }
            }
        }
        Some(layout.velocity()..layout.velocity() + size)
    }

    #[inline(always)]
    fn specialised<J: Work<T>>(&self, u: &[T], job: J) -> J::Output {
        match &self.shape {
            Some(shape) if T::TWINS => shape.work(self, u, job),
            _ => job.run::<0, 0, _>(self),
        }
    }

    fn is_derived(&self, index: usize) -> bool {
        self.platform.repeats_angle(index)
    }
}
