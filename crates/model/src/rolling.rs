//! Level `rolling`: dynamics of a platform whose wheels roll without slip. `[eq:reduced-dynamics]`
//!
//! Gibbs–Appell equations in the velocity coordinates v of [`crate::platform`]:
//! SᵀMS v̇ + ω G v + (terms of turning wheel planes) = SᵀF, with dry friction as a mode.
//! Base frame of the robot for forces and rows, world frame for the pose.

use crate::drive::Drive;
use crate::dynamics::{Dynamics, Sizes};
use crate::ground::Ground;
use crate::planar::{Vec2, vec2};
use crate::platform::{
    BODY_OUTPUTS, LEDGER, MAX_WHEELS, Platform, Reduced, WHEEL_OUTPUTS, WheelOutput, YAW,
    has_current,
};
use crate::scalar::{Mask, Scalar};
use crate::solve::{
    Condition, Mobility, Row, Square, dot, invert, product, solve_semidefinite, zero_row,
};
use crate::wheel::{Steering, WheelFrame};

/// A platform on a ground, ready to be integrated.
#[derive(Clone, Debug)]
pub struct Rolling<T: Scalar> {
    platform: Platform<T>,
    ground: Ground<T>,
    /// Reduced equations and inverse mass matrix, for platforms whose geometry does not change.
    constant: Option<(Reduced<T>, Square<T>)>,
    /// The same for two driven wheels on an axle, with its sizes known to the compiler: no loop of
    /// a step of the commonest robot is left to run time.
    axle: Option<Box<Compiled<T, 2, 2>>>,
    /// Per wheel: index of the current in the state.
    current: [Option<usize>; MAX_WHEELS],
    /// Wheels with any dry friction or brake.
    rubs: [bool; MAX_WHEELS],
    any_rubs: bool,
    /// Static loads on level ground times cos of the slope, N, shared by compliance.
    contacts: Option<Contacts<T>>,
}

/// Geometry of the contacts for normal loads.
#[derive(Clone, Copy, Debug)]
struct Contacts<T> {
    /// Inverse of the 3 × 3 matrix Σ (1, x, y)(1, x, y)ᵀ, about the base's origin.
    inverse: [[T; 3]; 3],
}

/// The equations of a platform of constant geometry, multiplied out: U velocity coordinates and W
/// wheels that take part in the dynamics. `[eq:constant-geometry]`
#[derive(Clone, Debug)]
struct Compiled<T, const U: usize, const W: usize> {
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
    /// The wheels, as indices.
    wheels: [usize; W],
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

impl<T: Scalar, const U: usize, const W: usize> Compiled<T, U, W> {
    /// `None` if the platform has other sizes.
    fn new(platform: &Platform<T>, reduced: &Reduced<T>, inverse: &Square<T>) -> Option<Self> {
        let layout = platform.layout();
        let dynamic: Vec<usize> = (0..layout.wheels)
            .filter(|&i| platform.is_dynamic(i))
            .collect();
        let wheels: [usize; W] = dynamic.try_into().ok()?;
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
        Some(Compiled {
            twist: [short(&origin[0]), short(&origin[1]), short(&yaw)],
            spin: wheels.map(|i| short(&reduced.spin[i])),
            push: wheels.map(|i| through(&reduced.spin[i])),
            gyro,
            weight: [through(&reduced.momentum[0]), through(&reduced.momentum[1])],
            wrench: [through(&origin[0]), through(&origin[1]), through(&yaw)],
            wheels,
        })
    }
}

/// What acts on the platform at an instant.
struct Forces<T: Scalar> {
    /// Generalised force minus quadratic terms, over v.
    total: Row<T>,
    /// Spin rates φ̇, rad/s; zero where the wheel sticks.
    rate: [T; MAX_WHEELS],
    /// Drive torques at the axles, N·m.
    torque: [T; MAX_WHEELS],
    /// Bounds of dry friction, N·m.
    bound: [T; MAX_WHEELS],
    /// Wheels held by dry friction.
    stuck: [T::Mask; MAX_WHEELS],
    /// φ̈ at v̇ = 0.
    convective: [T; MAX_WHEELS],
    velocity: Vec2<T>,
    yaw_rate: T,
    gravity: Vec2<T>,
}

impl<T: Scalar> Rolling<T> {
    /// Joins a platform and a ground.
    pub fn new(platform: Platform<T>, ground: Ground<T>) -> Self {
        let layout = platform.layout().clone();
        let mut current = [None; MAX_WHEELS];
        let mut rubs = [false; MAX_WHEELS];
        for (i, wheel) in platform.wheels().iter().enumerate() {
            if has_current(&wheel.drive) {
                let slot = layout.motors.iter().position(|&m| m == i);
                current[i] = slot.map(|m| layout.current() + m);
            }
            rubs[i] = wheel.dry_friction.lane(0) > 0.0 || wheel.brake.lane(0) > 0.0;
        }
        let constant = layout.constant.then(|| {
            let reduced = platform.reduce(&vec![T::zero(); layout.state()]);
            (reduced, invert(layout.dof(), &reduced.mass))
        });
        let contacts = (layout.wheels >= 3)
            .then(|| Contacts::new(&platform))
            .flatten();
        let axle = constant
            .as_ref()
            .and_then(|(reduced, inverse)| Compiled::new(&platform, reduced, inverse))
            .map(Box::new);
        Rolling {
            platform,
            ground,
            constant,
            axle,
            current,
            rubs,
            any_rubs: rubs.contains(&true),
            contacts,
        }
    }

    /// The platform.
    pub fn platform(&self) -> &Platform<T> {
        &self.platform
    }

    /// The ground.
    pub fn ground(&self) -> &Ground<T> {
        &self.ground
    }

    /// Reduced mass matrix, G and rows at a state; for reports.
    pub fn reduced(&self, x: &[T]) -> Reduced<T> {
        match &self.constant {
            Some((reduced, _)) => *reduced,
            None => self.platform.reduce(x),
        }
    }

    /// The part of the outputs that is motion: twist, spin and steering rates.
    pub fn motion(&self, x: &[T], mode: &[T], y: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let v = &x[layout.velocity()..layout.velocity() + n];
        let (velocity, yaw_rate) = self.platform.twist(v);
        y[0] = velocity.x;
        y[1] = velocity.y;
        y[2] = yaw_rate;
        for i in 0..layout.wheels {
            let (spin, swivel) = match &self.constant {
                Some((reduced, _)) if self.platform.is_dynamic(i) => {
                    (reduced.spin[i], reduced.swivel[i])
                }
                _ => {
                    let frame = self.platform.wheel_frame(i, x);
                    let spin = self.platform.spin_row(i, &frame);
                    (spin, self.platform.swivel_row(i, &frame))
                }
            };
            let rate = dot(n, &spin, v);
            let rests = if self.rubs[i] {
                is_zero(mode[i])
            } else {
                T::Mask::splat(false)
            };
            y[layout.wheel_output(i, WheelOutput::SpinRate)] = T::select(rests, T::zero(), rate);
            y[layout.wheel_output(i, WheelOutput::SteeringRate)] = dot(n, &swivel, v);
        }
    }

    /// Largest friction torque that holds or brakes wheel i, N·m, at a brake command in [0, 1].
    #[inline(always)]
    fn bound(&self, i: usize, u: &[T]) -> T {
        let wheel = &self.platform.wheels()[i];
        wheel
            .brake
            .mul_add(u[self.platform.layout().brake_input()], wheel.dry_friction)
    }

    /// Drive torque, terminal voltage and current of wheel i.
    #[inline(always)]
    fn drive(&self, i: usize, x: &[T], command: T, rate: T) -> (T, T, T) {
        match &self.platform.wheels()[i].drive {
            Drive::None | Drive::Rate { .. } => (T::zero(), T::zero(), T::zero()),
            Drive::Torque { torque_max } => (
                command.max(-*torque_max).min(*torque_max),
                T::zero(),
                T::zero(),
            ),
            Drive::DcMotor(motor) => {
                let voltage = motor.terminal_voltage(command, rate);
                let current = match self.current[i] {
                    Some(at) => x[at],
                    None => (voltage - motor.back_emf(rate)) / motor.resistance,
                };
                (motor.torque_per_current() * current, voltage, current)
            }
        }
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
            rate: [T::zero(); MAX_WHEELS],
            torque: [T::zero(); MAX_WHEELS],
            bound: [T::zero(); MAX_WHEELS],
            stuck: [T::Mask::splat(false); MAX_WHEELS],
            convective: [T::zero(); MAX_WHEELS],
            velocity,
            yaw_rate,
            gravity,
        };
        let wrench = &u[layout.wrench_input()..layout.wrench_input() + 3];
        let origin = self.platform.point_rows(Vec2::zero());
        let yaw = self.platform.yaw_row();
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
            let wheel = &self.platform.wheels()[i];
            let rate = dot(n, &reduced.spin[i], v);
            let mut resisting = T::zero();
            forces.rate[i] = rate;
            if self.rubs[i] {
                let bound = self.bound(i, u);
                let stuck = is_zero(mode[i]).and(T::zero().less(bound));
                forces.bound[i] = bound;
                forces.stuck[i] = stuck;
                forces.rate[i] = T::select(stuck, T::zero(), rate);
                resisting = bound * mode[i];
            }
            let (torque, _, _) = self.drive(i, x, u[i], forces.rate[i]);
            forces.torque[i] = torque;
            let net = torque - wheel.viscous.mul_add(forces.rate[i], resisting);
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
            Some((_, inverse)) => *inverse,
            None => invert(self.platform.layout().dof(), &reduced.mass),
        }
    }

    /// The accelerations v̇. Where no wheel is steered and none sticks nothing narrows them.
    #[inline(always)]
    fn acceleration(&self, x: &[T], reduced: &Reduced<T>, forces: &Forces<T>) -> Row<T> {
        let layout = self.platform.layout();
        let mut sticking = !layout.steered.is_empty();
        for i in 0..layout.wheels {
            sticking |= self.rubs[i] && forces.stuck[i].any();
        }
        if sticking {
            let (mut v_rate, mut mobility) = self.steered_acceleration(x, reduced, forces);
            self.hold(
                reduced,
                &forces.stuck,
                &forces.convective,
                &mut mobility,
                &mut v_rate,
            );
            return v_rate;
        }
        product(layout.dof(), &self.inverse_mass(reduced), &forces.total)
    }

    /// The accelerations under the conditions of steered wheels only, with the mobility they leave.
    #[inline(never)]
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
        for (k, &i) in layout.steered.iter().enumerate() {
            if !self.platform.wheels()[i].is_plain() {
                continue;
            }
            let frame = self.platform.wheel_frame(i, x);
            let condition = Condition {
                row: self.platform.lateral_row(&frame),
                value: self.lateral_drift(k, i, x, &frame, forces),
                active: T::Mask::splat(true),
            };
            mobility.impose(&condition, &mut v_rate);
        }
        (v_rate, mobility)
    }

    /// Narrows accelerations to those that leave the sticking wheels at rest. `[eq:stick]`
    #[inline(never)]
    fn hold(
        &self,
        reduced: &Reduced<T>,
        stuck: &[T::Mask; MAX_WHEELS],
        convective: &[T; MAX_WHEELS],
        mobility: &mut Mobility<T>,
        v_rate: &mut [T],
    ) {
        let layout = self.platform.layout();
        let mut moving = T::Mask::splat(false);
        for i in 0..layout.wheels {
            if !self.rubs[i] || !stuck[i].any() {
                continue;
            }
            let condition = Condition {
                row: reduced.spin[i],
                value: -convective[i],
                active: stuck[i],
            };
            moving = moving.or(is_zero(convective[i]).not());
            mobility.impose(&condition, v_rate);
        }
        // Held in every direction: at rest to the last bit, whatever the rounding.
        let rest = mobility.is_locked().and(moving.not());
        if layout.steered.is_empty() && rest.any() {
            for rate in v_rate.iter_mut().take(layout.dof()) {
                *rate = T::select(rest, T::zero(), *rate);
            }
        }
    }

    /// The derivative of a platform whose equations are multiplied out: the same terms as
    /// [`Self::forces`], in the order of the data.
    #[inline(always)]
    fn flow<const U: usize, const W: usize>(
        &self,
        compiled: &Compiled<T, U, W>,
        x: &[T],
        u: &[T],
        mode: &[T],
        dx: &mut [T],
    ) {
        let layout = self.platform.layout();
        let at = layout.velocity();
        // Loops, not closures: a closure is a function of its own, compiled without the instruction
        // set that the step was entered with.
        let mut v = [T::zero(); U];
        for k in 0..U {
            v[k] = x[at + k];
        }
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let velocity = vec2(along(&compiled.twist[0], &v), along(&compiled.twist[1], &v));
        let yaw_rate = along(&compiled.twist[2], &v);
        let gravity = self.ground.gravity.rotated(cos, -sin);
        let mut outside = [T::zero(); 3];
        for k in 0..3 {
            outside[k] = u[layout.wrench_input() + k];
        }
        let mut v_rate = [T::zero(); U];
        for k in 0..U {
            let weight =
                compiled.weight[0][k].mul_add(gravity.x, compiled.weight[1][k] * gravity.y);
            let wrench = compiled.wrench[0][k].mul_add(
                outside[0],
                compiled.wrench[1][k].mul_add(outside[1], compiled.wrench[2][k] * outside[2]),
            );
            v_rate[k] = (-yaw_rate).mul_add(along(&compiled.gyro[k], &v), weight + wrench);
        }
        // Plain products: their sum over two wheels is the same whichever comes first, so that a
        // mirrored robot moves as its mirror image to the last bit.
        let mut pushed = [T::zero(); U];
        let (mut supplied, mut windings) = (T::zero(), T::zero());
        let (mut gears, mut friction) = (T::zero(), T::zero());
        let mut sticking = false;
        let mut stuck = [T::Mask::splat(false); MAX_WHEELS];
        for w in 0..W {
            let i = compiled.wheels[w];
            let wheel = &self.platform.wheels()[i];
            let mut rate = along(&compiled.spin[w], &v);
            let mut lost = T::zero();
            if self.rubs[i] {
                let bound = self.bound(i, u);
                stuck[i] = is_zero(mode[i]).and(T::zero().less(bound));
                sticking |= stuck[i].any();
                rate = T::select(stuck[i], T::zero(), rate);
                lost = bound * mode[i];
            }
            lost = wheel.viscous.mul_add(rate, lost);
            dx[layout.spin(i)] = rate;
            let (torque, voltage, current) = self.drive(i, x, u[i], rate);
            let net = torque - lost;
            for k in 0..U {
                pushed[k] += compiled.push[w][k] * net;
            }
            friction = lost.mul_add(rate, friction);
            let shaft = torque * rate;
            match &wheel.drive {
                Drive::None | Drive::Rate { .. } => {}
                Drive::Torque { .. } => supplied += shaft,
                Drive::DcMotor(motor) => {
                    supplied = voltage.mul_add(current, supplied);
                    windings = (motor.resistance * current).mul_add(current, windings);
                    gears += motor.back_emf(rate).mul_add(current, -shaft);
                    if let Some(at) = self.current[i] {
                        dx[at] = motor.current_rate(voltage, current, rate);
                    }
                }
            }
        }
        for k in 0..U {
            v_rate[k] += pushed[k];
        }
        if sticking && let Some((reduced, inverse)) = &self.constant {
            let mut mobility = Mobility::new(U, inverse);
            let still = [T::zero(); MAX_WHEELS];
            self.hold(reduced, &stuck, &still, &mut mobility, &mut v_rate);
        }
        for k in 0..U {
            dx[at + k] = v_rate[k];
        }
        self.pose_rates(x, velocity, yaw_rate, dx);
        for k in 0..layout.swivels.len() {
            self.follow(k, layout.swivels[k], x, velocity, yaw_rate, dx);
        }
        supplied += outside[0].mul_add(
            velocity.x,
            outside[1].mul_add(velocity.y, outside[2] * yaw_rate),
        );
        let ledger = layout.ledger();
        dx[ledger] = supplied;
        dx[ledger + 1] = windings;
        dx[ledger + 2] = gears;
        dx[ledger + 3] = friction;
    }

    /// The derivative of any platform.
    #[inline(never)]
    fn any_derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let varying;
        let reduced = match &self.constant {
            Some((reduced, _)) => reduced,
            None => {
                varying = self.platform.reduce(x);
                &varying
            }
        };
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
            let wheel = &self.platform.wheels()[i];
            let rate = forces.rate[i];
            dx[layout.spin(i)] = rate;
            let lost = wheel.viscous.mul_add(rate, forces.bound[i] * mode[i]);
            friction = lost.mul_add(rate, friction);
            let shaft = forces.torque[i] * rate;
            match &wheel.drive {
                Drive::None | Drive::Rate { .. } => {}
                Drive::Torque { .. } => supplied += shaft,
                Drive::DcMotor(motor) => {
                    let (_, voltage, current) = self.drive(i, x, u[i], rate);
                    let emf = motor.back_emf(rate);
                    supplied = voltage.mul_add(current, supplied);
                    windings = (motor.resistance * current).mul_add(current, windings);
                    gears += emf.mul_add(current, -shaft);
                    if let Some(at) = self.current[i] {
                        dx[at] = motor.current_rate(voltage, current, rate);
                    }
                }
            }
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

    /// Rates of a caster that only follows the motion.
    #[inline(always)]
    fn follow(&self, k: usize, i: usize, x: &[T], velocity: Vec2<T>, yaw_rate: T, dx: &mut [T]) {
        let at = self.platform.layout().swivel(k);
        let frame = self.platform.wheels()[i].frame(x[at + 1], x[at + 2]);
        let rate = self.platform.caster_rate(i, &frame, velocity, yaw_rate);
        dx[at] = rate;
        dx[at + 1] = -(x[at + 2] * rate);
        dx[at + 2] = x[at + 1] * rate;
        dx[self.platform.layout().spin(i)] = self.platform.spin_rate(i, &frame, velocity, yaw_rate);
    }

    /// Takes from the velocities what steered and sticking wheels forbid, at the least cost of
    /// energy, which goes to the ledger as heat.
    #[inline(never)]
    fn project(&self, x: &mut [T], u: &[T], mode: &[T], reduced: &Reduced<T>) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let at = layout.velocity();
        let inverse = self.inverse_mass(reduced);
        let mut v = zero_row();
        v[..n].copy_from_slice(&x[at..at + n]);
        let energy = |v: &Row<T>| T::from(0.5) * dot(n, &product(n, &reduced.mass, v), v);
        let before = energy(&v);
        let mut mobility = Mobility::new(n, &inverse);
        for &i in &layout.steered {
            if self.platform.wheels()[i].is_plain() {
                let frame = self.platform.wheel_frame(i, x);
                let condition = Condition {
                    row: self.platform.lateral_row(&frame),
                    value: T::zero(),
                    active: T::Mask::splat(true),
                };
                mobility.impose(&condition, &mut v);
            }
        }
        for i in 0..layout.wheels {
            if self.rubs[i] {
                let bound = self.bound(i, u);
                let condition = Condition {
                    row: reduced.spin[i],
                    value: T::zero(),
                    active: is_zero(mode[i]).and(T::zero().less(bound)),
                };
                mobility.impose(&condition, &mut v);
            }
        }
        let locked = mobility.is_locked();
        for k in 0..n {
            x[at + k] = T::select(locked, T::zero(), v[k]);
            v[k] = x[at + k];
        }
        x[layout.ledger() + LEDGER - 1] += before - energy(&v);
    }

    /// Right-hand side of the lateral constraint of a steered wheel: n · V̇_c = γ̇ e · V_c.
    #[inline(always)]
    fn lateral_drift(
        &self,
        k: usize,
        i: usize,
        x: &[T],
        frame: &WheelFrame<T>,
        forces: &Forces<T>,
    ) -> T {
        let layout = self.platform.layout();
        let steering_rate = x[layout.velocity() + layout.eta + k];
        let mount = self.platform.wheels()[i].mount;
        let carried = forces.velocity + mount.perpendicular() * forces.yaw_rate;
        steering_rate * frame.forward.dot(carried)
    }

    /// Torques that hold the sticking wheels at rest, N·m; zero for the others. `[eq:stick]`
    #[inline(never)]
    fn holding_torques(
        &self,
        x: &[T],
        reduced: &Reduced<T>,
        forces: &Forces<T>,
    ) -> [T; MAX_WHEELS] {
        // Where more wheels stick than there are directions to hold, the share of each is not
        // determined; this much of the diagonal, against rounding, picks the smallest torques.
        const RIDGE: f64 = 1e-11;
        let layout = self.platform.layout();
        let (n, wheels) = (layout.dof(), layout.wheels);
        let (free, mobility) = self.steered_acceleration(x, reduced, forces);
        let mut matrix = [[T::zero(); MAX_WHEELS]; MAX_WHEELS];
        let mut right = [T::zero(); MAX_WHEELS];
        for i in 0..wheels {
            let held = forces.stuck[i];
            let response = product(n, mobility.matrix(), &reduced.spin[i]);
            for j in 0..wheels {
                let entry = dot(n, &reduced.spin[j], &response);
                matrix[j][i] = T::select(held.and(forces.stuck[j]), entry, T::zero());
            }
            let own = matrix[i][i] * T::from(1.0 + RIDGE);
            matrix[i][i] = T::select(held, own, T::one());
            let pushed = dot(n, &reduced.spin[i], &free) + forces.convective[i];
            right[i] = T::select(held, -pushed, T::zero());
        }
        solve_semidefinite(wheels, matrix, right, T::zero())
    }

    /// Lets go of the resting wheels that are pushed harder than their friction holds. `[eq:stick]`
    #[inline(never)]
    fn release(&self, x: &[T], u: &[T], mode: &mut [T], reduced: &Reduced<T>) {
        let layout = self.platform.layout();
        for _ in 0..layout.wheels {
            let forces = self.forces(x, u, mode, reduced);
            let held = self.holding_torques(x, reduced, &forces);
            // The one that is asked for most beyond its bound lets go, and the rest is asked again.
            let mut worst = T::zero();
            for i in 0..layout.wheels {
                let excess = held[i].abs() - forces.bound[i];
                worst = worst.max(T::select(forces.stuck[i], excess, T::zero()));
            }
            let any = T::zero().less(worst);
            if !any.any() {
                return;
            }
            for i in 0..layout.wheels {
                let excess = held[i].abs() - forces.bound[i];
                let lets_go = forces.stuck[i].and(any).and(worst.less_equal(excess));
                mode[i] = T::select(lets_go, -T::one().copysign(held[i]), mode[i]);
            }
        }
    }

    /// Force of the ground on each wheel along its rolling direction (or roller axis) and along its
    /// axle, N, and the accelerations it rests on. `[eq:multipliers]`
    #[inline(never)]
    fn contact_forces(
        &self,
        x: &[T],
        u: &[T],
        mode: &[T],
        reduced: &Reduced<T>,
        forces: &Forces<T>,
    ) -> ([T; MAX_WHEELS], [T; MAX_WHEELS]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let v = &x[layout.velocity()..layout.velocity() + n];
        let v_rate = self.acceleration(x, reduced, forces);
        let sticking = (0..layout.wheels).any(|i| forces.stuck[i].any());
        let held = if sticking {
            self.holding_torques(x, reduced, forces)
        } else {
            [T::zero(); MAX_WHEELS]
        };
        let (linear, angular) = self.platform.twist(&v_rate);
        let (velocity, yaw_rate) = (forces.velocity, forces.yaw_rate);

        let mut longitudinal = [T::zero(); MAX_WHEELS];
        let mut lateral = [T::zero(); MAX_WHEELS];
        // Force and moment about P that the ground must give to all wheels together.
        let body = self.platform.body();
        let mut force = Vec2::zero();
        let mut moment = body.inertia_com * angular;
        let inertial = |at: Vec2<T>| {
            // V̇ + ω̇ Ω r + ω Ω (V + ω Ω r) − g: what a mass that turns with the base needs.
            let carried = velocity + at.perpendicular() * yaw_rate;
            linear + at.perpendicular() * angular + carried.perpendicular() * yaw_rate
                - forces.gravity
        };
        let needed = inertial(body.center_of_mass) * body.mass;
        force = force + needed;
        moment += body.center_of_mass.cross(needed);
        let wrench = &u[layout.wrench_input()..layout.wrench_input() + 3];
        force = force - vec2(wrench[0], wrench[1]);
        moment -= wrench[2];

        let mut side = [[T::zero(); 3]; MAX_WHEELS];
        let mut shared = [false; MAX_WHEELS];
        for i in 0..layout.wheels {
            let wheel = &self.platform.wheels()[i];
            let frame = self.platform.wheel_frame(i, x);
            let rolling = wheel.rolling_row(&frame);
            let swivel = self.platform.swivel_row(i, &frame);
            let steering_rate = dot(n, &swivel, v);
            let convective = self
                .platform
                .convective(i, &frame, velocity, yaw_rate, steering_rate);
            let steering_accel = dot(n, &swivel, &v_rate) + convective.swivel;
            let spin = self.platform.spin_row(i, &frame);
            let spin_accel = dot(n, &spin, &v_rate) + convective.spin;
            // The wheel's mass: V + ωΩr − dγ̇n, of which `inertial` holds the part without γ̇.
            let trail = wheel.trail();
            let swept = frame.left * (-(trail * steering_rate));
            let needed = (inertial(frame.contact)
                + swept.perpendicular() * yaw_rate
                + frame.forward * (trail * steering_rate * (yaw_rate + steering_rate))
                - frame.left * (trail * steering_accel))
                * wheel.mass;
            force = force + needed;
            moment += frame.contact.cross(needed);
            let turning = wheel.inertia_vertical * (angular + steering_accel);
            moment += turning;

            let resisting = wheel
                .viscous
                .mul_add(forces.rate[i], forces.bound[i] * mode[i]);
            let net = forces.torque[i] + held[i] - resisting;
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
                Steering::Fixed { .. } | Steering::Driven if wheel.is_plain() => {
                    shared[i] = true;
                    side[i] = [frame.left.x, frame.left.y, frame.contact.cross(frame.left)];
                }
                Steering::Fixed { .. } | Steering::Driven => {}
            }
        }
        // The rest falls to the side forces of fixed and steered wheels: the smallest that do it.
        let mut normal = [[T::zero(); 3]; 3];
        for row in &side[..layout.wheels] {
            for a in 0..3 {
                for b in 0..3 {
                    normal[a][b] = row[a].mul_add(row[b], normal[a][b]);
                }
            }
        }
        let trace = normal[0][0] + normal[1][1] + normal[2][2];
        let z = solve_semidefinite(
            3,
            normal,
            [force.x, force.y, moment],
            trace * T::from(1e-12) + T::from(f64::MIN_POSITIVE),
        );
        for i in 0..layout.wheels {
            if shared[i] {
                lateral[i] = side[i][0].mul_add(z[0], side[i][1].mul_add(z[1], side[i][2] * z[2]));
            }
        }
        (longitudinal, lateral)
    }
}

#[inline(always)]
fn is_zero<T: Scalar>(value: T) -> T::Mask {
    value.abs().less_equal(T::zero())
}

impl<T: Scalar> Contacts<T> {
    fn new(platform: &Platform<T>) -> Option<Self> {
        let mut sums = [[T::zero(); 3]; 3];
        for wheel in platform.wheels() {
            // A caster's contact moves by its trail; for the loads it stands under its pivot.
            let row = [T::one(), wheel.mount.x, wheel.mount.y];
            for a in 0..3 {
                for b in 0..3 {
                    sums[a][b] = row[a].mul_add(row[b], sums[a][b]);
                }
            }
        }
        let minor = sums[1][1] * sums[2][2] - sums[1][2] * sums[2][1];
        // Contacts on one line carry no plane.
        let size = sums[1][1].lane(0) + sums[2][2].lane(0);
        let cross = [
            sums[0][0] * minor,
            sums[0][1] * (sums[0][1] * sums[2][2] - sums[1][2] * sums[0][2]),
            sums[0][2] * (sums[0][1] * sums[1][2] - sums[1][1] * sums[0][2]),
        ];
        let determinant = (cross[0] - cross[1] + cross[2]).lane(0);
        if determinant <= 1e-9 * size * size {
            return None;
        }
        let mut padded = [[T::zero(); crate::solve::MAX_DOF]; crate::solve::MAX_DOF];
        for a in 0..3 {
            padded[a][..3].copy_from_slice(&sums[a]);
        }
        let full = invert(3, &padded);
        let mut inverse = [[T::zero(); 3]; 3];
        for a in 0..3 {
            inverse[a].copy_from_slice(&full[a][..3]);
        }
        Some(Contacts { inverse })
    }

    /// Loads of equally compliant contacts for a total load and its moments Σ N x, Σ N y.
    /// `[eq:normal-loads]`
    fn loads(&self, platform: &Platform<T>, totals: [T; 3]) -> [T; MAX_WHEELS] {
        let mut plane = [T::zero(); 3];
        for a in 0..3 {
            for b in 0..3 {
                plane[a] = self.inverse[a][b].mul_add(totals[b], plane[a]);
            }
        }
        let mut loads = [T::zero(); MAX_WHEELS];
        for (i, wheel) in platform.wheels().iter().enumerate() {
            loads[i] = plane[0] + plane[1].mul_add(wheel.mount.x, plane[2] * wheel.mount.y);
        }
        loads
    }
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
        match &self.axle {
            Some(axle) => self.flow(axle, x, u, mode, dx),
            None => self.any_derivative(x, u, mode, dx),
        }
    }

    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let reduced = self.reduced(x);
        let forces = self.forces(x, u, mode, &reduced);
        let (longitudinal, lateral) = self.contact_forces(x, u, mode, &reduced, &forces);
        let v = &x[layout.velocity()..layout.velocity() + n];
        y[0] = forces.velocity.x;
        y[1] = forces.velocity.y;
        y[2] = forces.yaw_rate;
        y[3] = T::from(0.5) * dot(n, &product(n, &reduced.mass, v), v);
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let body = self.platform.body();
        let mut moment = body.center_of_mass * body.mass;
        let mut total = vec2(T::zero(), T::zero());
        let mut magnetic = T::zero();
        for i in 0..layout.wheels {
            let wheel = &self.platform.wheels()[i];
            let frame = self.platform.wheel_frame(i, x);
            moment = moment + frame.contact * wheel.mass;
            let (torque, _, current) = self.drive(i, x, u[i], forces.rate[i]);
            if let Drive::DcMotor(motor) = &wheel.drive {
                magnetic += T::from(0.5) * motor.inductance * current * current;
            }
            let rate = if self.platform.is_dynamic(i) {
                forces.rate[i]
            } else {
                dot(n, &self.platform.spin_row(i, &frame), v)
            };
            let mut set = |what: WheelOutput, value: T| y[layout.wheel_output(i, what)] = value;
            set(WheelOutput::SpinRate, rate);
            set(
                WheelOutput::SteeringRate,
                dot(n, &self.platform.swivel_row(i, &frame), v),
            );
            set(WheelOutput::Torque, torque);
            set(WheelOutput::Current, current);
            set(WheelOutput::Longitudinal, longitudinal[i]);
            set(WheelOutput::Lateral, lateral[i]);
            let rolling = wheel.rolling_row(&frame);
            total = total + rolling.direction * longitudinal[i] + frame.left * lateral[i];
        }
        let mass = self.platform.total_mass();
        let center = vec2(x[0], x[1]) * mass + moment.rotated(cos, sin);
        y[4] = -self.ground.gravity.dot(center);
        y[5] = magnetic;
        let loads = match &self.contacts {
            Some(contacts) => {
                let weight = mass * self.ground.gravity_normal;
                let normal = self.ground.gravity_normal;
                let mut height = body.com_height * body.mass;
                for wheel in self.platform.wheels() {
                    height = wheel.mass.mul_add(wheel.radius, height);
                }
                let height = height / mass;
                contacts.loads(
                    &self.platform,
                    [
                        weight,
                        moment.x * normal - height * total.x,
                        moment.y * normal - height * total.y,
                    ],
                )
            }
            None => [T::zero(); MAX_WHEELS],
        };
        for i in 0..layout.wheels {
            y[layout.wheel_output(i, WheelOutput::Load)] = loads[i];
        }
        debug_assert_eq!(y.len(), BODY_OUTPUTS + WHEEL_OUTPUTS * layout.wheels);
    }

    #[inline(always)]
    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        let layout = self.platform.layout();
        if !self.any_rubs {
            return;
        }
        let varying;
        let reduced = match &self.constant {
            Some((reduced, _)) => reduced,
            None => {
                varying = self.platform.reduce(x);
                &varying
            }
        };
        let at = layout.velocity();
        let n = layout.dof();
        let mut resting = T::Mask::splat(false);
        for i in 0..layout.wheels {
            if self.rubs[i] {
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
            self.release(x, u, mode, reduced);
        }
    }

    #[inline(always)]
    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        self.platform.renew_angles(x);
        let steered = !layout.steered.is_empty();
        if !steered && !self.any_rubs {
            return;
        }
        let varying;
        let reduced = match &self.constant {
            Some((reduced, _)) => reduced,
            None => {
                varying = self.platform.reduce(x);
                &varying
            }
        };
        let at = layout.velocity();
        let mut held = T::Mask::splat(false);
        for i in 0..layout.wheels {
            if !self.rubs[i] {
                continue;
            }
            let rate = dot(n, &reduced.spin[i], &x[at..at + n]);
            let bound = self.bound(i, u);
            let rests = is_zero(mode[i]).or((rate * mode[i]).less_equal(T::zero()));
            let sticks = rests.and(T::zero().less(bound));
            mode[i] = T::select(sticks, T::zero(), T::one().copysign(rate));
            held = held.or(sticks);
        }
        if !steered && !held.any() {
            return;
        }
        self.project(x, u, mode, reduced);
    }

    fn guards(&self, x: &[T], u: &[T], mode: &[T], g: &mut [T]) {
        let layout = self.platform.layout();
        let reduced = self.reduced(x);
        let forces = self.forces(x, u, mode, &reduced);
        let any = (0..layout.wheels).any(|i| forces.stuck[i].any());
        let held = if any {
            self.holding_torques(x, &reduced, &forces)
        } else {
            [T::zero(); MAX_WHEELS]
        };
        for i in 0..layout.wheels {
            let slack = forces.bound[i] - held[i].abs();
            let turning = T::select(
                T::zero().less(forces.bound[i]),
                forces.rate[i] * mode[i],
                T::one(),
            );
            g[i] = T::select(forces.stuck[i], slack, turning);
        }
    }

    fn linear_part(&self, mode: &[T], matrix: &mut [T]) -> Option<core::ops::Range<usize>> {
        // At constant geometry ż = A z + … for z = (v, currents): the derivative without its
        // quadratic, gravity and dry-friction terms, column by column.
        let (reduced, inverse) = self.constant.as_ref()?;
        let layout = self.platform.layout();
        let n = layout.dof();
        let size = n + layout.motors.len();
        let mut mobility = Mobility::new(n, inverse);
        let mut unused = zero_row();
        for i in 0..layout.wheels {
            if self.rubs[i] {
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
            let wheel = &self.platform.wheels()[i];
            let spin = &reduced.spin[i];
            let response = product(n, mobility.matrix(), spin);
            let mut damping = wheel.viscous;
            if let Drive::DcMotor(motor) = &wheel.drive {
                let emf = motor.back_emf(T::one());
                match self.current[i] {
                    Some(at) => {
                        let slot = at - layout.velocity();
                        for k in 0..n {
                            matrix[k * size + slot] += response[k] * motor.torque_per_current();
                            matrix[slot * size + k] -= spin[k] * emf / motor.inductance;
                        }
                        matrix[slot * size + slot] -= motor.resistance / motor.inductance;
                    }
                    None => damping += motor.torque_per_current() * emf / motor.resistance,
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

    fn is_derived(&self, index: usize) -> bool {
        self.platform.repeats_angle(index)
    }
}
