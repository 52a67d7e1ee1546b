//! The platform: a body on wheels, its coordinates, and its reduced equations.
//!
//! Base frame at the reference point P. The velocity coordinates are v = (η, ζ): η spans the twists
//! that the fixed wheels allow, (V_x, V_y, ω) = Σ η with a constant Σ, and ζ are the rates of the
//! steered wheels. Everything else follows from the constraints: γ̇ of a caster and φ̇ of every
//! wheel are rows over v. `[eq:constraints]` `[eq:reduced-dynamics]`

mod basis;
mod layout;

use crate::drive::{DcMotor, Drive};
use crate::lanewise::Lanewise;
use crate::planar::{Vec2, vec2};
use crate::scalar::{Mask, Scalar};
use crate::solve::{Condition, MAX_DOF, Mobility, Row, Square, add_outer, dot, zero_row};
use crate::wheel::{Rim, RollingRow, Steering, Wheel, WheelFrame};

use basis::{fixed_basis, rank_with};

pub(crate) use layout::POSE;
pub use layout::{BODY_OUTPUTS, LEDGER, Layout, WHEEL_OUTPUTS, WheelOutput, YAW};

/// Largest number of wheels of a platform.
pub const MAX_WHEELS: usize = 12;

/// The rigid body that carries the wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body<T> {
    /// Mass without the wheels, kg.
    pub mass: T,
    /// Yaw inertia about its own center of mass, kg·m².
    pub inertia_com: T,
    /// Center of mass in the base frame, m.
    pub center_of_mass: Vec2<T>,
    /// Height of the center of mass above the ground, m.
    pub com_height: T,
}

/// A body on wheels, checked.
#[derive(Clone, Debug)]
pub struct Platform<T> {
    body: Body<T>,
    wheels: Vec<Wheel<T>>,
    layout: Layout,
    /// Columns of Σ, as (x, y, yaw) rows over η.
    basis: [Row<T>; 3],
    /// How far behind P the axle of the fixed wheels stands, where an ideal linkage follows it, m.
    axle: T,
    /// Frames of the fixed wheels; of the others, at the angle zero.
    frames: Vec<WheelFrame<T>>,
    /// (cos δ, sin δ) of each rim; (1, 0) for plain ones.
    rims: Vec<Vec2<T>>,
}

/// Why a set of wheels is no platform.
#[derive(Clone, Debug, PartialEq)]
pub enum PlatformError {
    /// There are no wheels, or more than [`MAX_WHEELS`].
    WheelCount(usize),
    /// More steered wheels than velocity coordinates can hold.
    SteeredCount(usize),
    /// The lateral constraints of the fixed wheels leave no motion.
    Locked,
    /// Rollers along the wheel plane resist nothing (|δ| = π/2); the wheel's name.
    RollerAngle(String),
    /// A roller rim on a caster; the wheel's name.
    RollersOnCaster(String),
    /// A caster without trail does not swivel; the wheel's name.
    NoTrail(String),
    /// A linked wheel must follow a wheel that a motor steers; its name.
    NoLead(String),
    /// An ideal linkage needs fixed wheels on one axle, both wheels off it, and a wheel without mass,
    /// loss and drive; its name.
    NotGuided(String),
}

/// The reduced equations at an instant: rows over v of all dependent rates, mass matrix, and the
/// terms that are quadratic in v. `[eq:reduced-dynamics]`
#[derive(Clone, Copy, Debug)]
pub struct Reduced<T> {
    /// φ̇_i = spin[i] · v.
    pub spin: [Row<T>; MAX_WHEELS],
    /// γ̇_i = swivel[i] · v (zero for wheels that do not swivel).
    pub swivel: [Row<T>; MAX_WHEELS],
    /// Reduced mass matrix SᵀMS.
    pub mass: Square<T>,
    /// G = Σ m_k J_kᵀ Ω J_k, antisymmetric: the quadratic terms are ω G v. `[eq:constant-geometry]`
    pub gyro: Square<T>,
    /// Σ m_k J_k: (rows for x and y) the map from v to momentum, which gravity acts through.
    pub momentum: [Row<T>; 2],
}

/// Accelerations of one wheel at v̇ = 0, from the turning of its plane.
#[derive(Clone, Copy, Debug)]
pub struct Convective<T> {
    /// Of the contact point without ω Ω v_k, base axes, m/s².
    pub contact: Vec2<T>,
    /// γ̈, rad/s².
    pub swivel: T,
    /// φ̈, rad/s².
    pub spin: T,
}

/// Writes cosine and sine of the angle at `at` behind it.
#[inline(always)]
pub(crate) fn renew_angle<T: Scalar>(x: &mut [T], at: usize) {
    let (sin, cos) = x[at].sin_cos();
    x[at + 1] = cos;
    x[at + 2] = sin;
}

/// One step of Newton's method for 1/√(c² + s²), from one.
#[inline(always)]
pub(crate) fn straighten<T: Scalar>(x: &mut [T], at: usize) {
    let square = x[at].mul_add(x[at], x[at + 1] * x[at + 1]);
    let scale = T::from(-0.5).mul_add(square, T::from(1.5));
    x[at] *= scale;
    x[at + 1] *= scale;
}

fn nominal<T: Scalar>(value: T) -> f64 {
    value.lane(0)
}

// What is large and no part of the common step is a function of its own, entered by the widest
// instructions.
fused! {
    /// See [`Platform::reduce`].
    fn reduce<T: Scalar>(platform: &Platform<T>, x: &[T]) -> Reduced<T> {
        platform.reduced(x)
    }
}
fused! {
    /// See [`Platform::velocity_from_twist`].
    fn velocity_from_twist<T: Scalar>(
        platform: &Platform<T>,
        velocity: Vec2<T>,
        yaw_rate: T,
        steering: &[T],
    ) -> Row<T> {
        platform.closest_velocity(velocity, yaw_rate, steering)
    }
}

impl<T: Scalar> Platform<T> {
    /// Checks the wheels and finds the coordinates.
    pub fn new(body: Body<T>, wheels: Vec<Wheel<T>>) -> Result<Self, PlatformError> {
        if wheels.is_empty() || wheels.len() > MAX_WHEELS {
            return Err(PlatformError::WheelCount(wheels.len()));
        }
        for wheel in &wheels {
            if let Steering::Free { trail } = wheel.steering {
                if nominal(trail) == 0.0 {
                    return Err(PlatformError::NoTrail(wheel.name.clone()));
                }
                if !wheel.is_plain() {
                    return Err(PlatformError::RollersOnCaster(wheel.name.clone()));
                }
            }
            if let Rim::Rollers { angle } = wheel.rim
                && nominal(angle.sin_cos().1) < 1e-6
            {
                return Err(PlatformError::RollerAngle(wheel.name.clone()));
            }
        }
        let (basis, eta, independent) = fixed_basis(&wheels)?;
        // Two coordinates span the motion: the fixed axle stands where V_y = −x₀ ω.
        let axle = if eta == 2 { basis[1][1] } else { T::zero() };
        let select = |keep: &dyn Fn(&Wheel<T>) -> bool| -> Vec<usize> {
            (0..wheels.len()).filter(|&i| keep(&wheels[i])).collect()
        };
        let steered = select(&|w| matches!(w.steering, Steering::Driven));
        for wheel in &wheels {
            if let Steering::Linked { lead, .. } | Steering::Guided { lead } = wheel.steering
                && !steered.contains(&lead)
            {
                return Err(PlatformError::NoLead(wheel.name.clone()));
            }
            if let Steering::Guided { lead } = wheel.steering {
                // The fixed wheels roll ahead, and the lead does not stand on their axle.
                let ahead = eta == 2 && nominal(basis[1][0].abs()) < 1e-9;
                let reach = |x: T| nominal(x + basis[1][1]).abs();
                let reach = reach(wheels[lead].mount.x).min(reach(wheel.mount.x));
                if !ahead || reach < 1e-9 || !wheel.is_plain() || !is_idle(wheel) {
                    return Err(PlatformError::NotGuided(wheel.name.clone()));
                }
            }
        }
        let guides = select(&|w| {
            w.is_plain() && matches!(w.steering, Steering::Driven | Steering::Linked { .. })
        });
        if eta + steered.len() > MAX_DOF {
            return Err(PlatformError::SteeredCount(steered.len()));
        }
        let constant = wheels.iter().all(|w| !w.swivels() || is_follower(w));
        let follows = |i: &usize| constant && wheels[*i].swivels();
        let mut order: Vec<usize> = (0..wheels.len()).collect();
        order.sort_by_key(follows);
        let mut spin_places = vec![0; wheels.len()];
        for (place, &i) in order.iter().enumerate() {
            spin_places[i] = place;
        }
        let layout = Layout {
            wheels: wheels.len(),
            spin_places,
            swivels: select(&Wheel::swivels),
            steered,
            guides,
            motors: select(&|w| has_current(&w.drive)),
            eta,
            constant,
            fixed_rank: 3 - eta,
            independent,
        };
        let direction = |angle: T| {
            let (sin, cos) = angle.sin_cos();
            vec2(cos, sin)
        };
        let frames = wheels
            .iter()
            .map(|wheel| {
                let forward = match wheel.steering {
                    Steering::Fixed { angle } => direction(angle),
                    _ => vec2(T::one(), T::zero()),
                };
                wheel.frame(forward.x, forward.y)
            })
            .collect();
        let rims = wheels
            .iter()
            .map(|wheel| match wheel.rim {
                Rim::Plain => vec2(T::one(), T::zero()),
                Rim::Rollers { angle } => direction(angle),
            })
            .collect();
        Ok(Platform {
            body,
            wheels,
            layout,
            basis,
            axle,
            frames,
            rims,
        })
    }

    /// The same platform with wheels that may slip: its velocity coordinates are the twist of the base
    /// (V_x, V_y, ω) and the rates of the steered wheels, and no wheel forbids any.
    pub fn released(mut self) -> Self {
        let (zero, one) = (T::zero(), T::one());
        self.basis = [zero_row(), zero_row(), zero_row()];
        for axis in 0..3 {
            for (k, entry) in self.basis[axis].iter_mut().enumerate().take(3) {
                *entry = if k == axis { one } else { zero };
            }
        }
        self.layout.eta = 3;
        self.layout.guides.clear();
        self
    }

    /// Degrees of mobility δ_m and steerability δ_s at angles of the steered wheels that are nothing
    /// special. `[eq:mobility]`
    ///
    /// G. Campion, G. Bastin, B. d'Andréa-Novel, *Structural properties and classification of
    /// kinematic and dynamic models of wheeled mobile robots*, IEEE Transactions on Robotics and
    /// Automation 12(1), 1996.
    pub fn degrees(&self) -> (usize, usize) {
        let layout = &self.layout;
        let mut x = vec![T::zero(); layout.state()];
        for (k, &i) in layout.swivels.iter().enumerate() {
            if layout.steered.contains(&i) {
                x[layout.swivel(k)] = T::from(0.3 + 0.17 * k as f64);
            }
        }
        self.renew_angles(&mut x);
        let mut rows: Vec<[T; 3]> = Vec::new();
        for &i in &layout.guides {
            let row = self.lateral_row(&self.wheel_frame(i, &x));
            let row = [row[0], row[1], row[2]];
            if rank_with(&rows, &row) > rows.len() {
                rows.push(row);
            }
        }
        let steerability = layout.steered.len().min(rows.len());
        (layout.eta - rows.len(), steerability)
    }

    /// The body.
    pub fn body(&self) -> &Body<T> {
        &self.body
    }

    /// The wheels.
    pub fn wheels(&self) -> &[Wheel<T>] {
        &self.wheels
    }

    /// The order of states, inputs and outputs.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Mass with wheels, kg.
    pub fn total_mass(&self) -> T {
        let mut mass = self.body.mass;
        for wheel in &self.wheels {
            mass += wheel.mass;
        }
        mass
    }

    /// Mass of the whole, kg, its moments along the base's axes, kg·m, and that of its height, kg·m, with
    /// wheels at their mounts.
    pub fn balance(&self) -> (T, Vec2<T>, T) {
        let mut mass = self.body.mass;
        let mut first = self.body.center_of_mass * self.body.mass;
        let mut up = self.body.com_height * self.body.mass;
        for wheel in &self.wheels {
            mass += wheel.mass;
            first = first + wheel.mount * wheel.mass;
            up = wheel.mass.mul_add(wheel.radius, up);
        }
        (mass, first, up)
    }

    /// The same platform with every number passed through `value`, called with its path
    /// (`body.mass`, `wheel.left.radius`): the one place where lanes and dual numbers come in.
    pub fn map<U: Scalar>(&self, value: &mut dyn FnMut(&str, T) -> U) -> Platform<U> {
        let body = Body {
            mass: value("body.mass", self.body.mass),
            inertia_com: value("body.inertia_com", self.body.inertia_com),
            center_of_mass: vec2(
                value("body.center_of_mass.x", self.body.center_of_mass.x),
                value("body.center_of_mass.y", self.body.center_of_mass.y),
            ),
            com_height: value("body.center_of_mass.z", self.body.com_height),
        };
        let wheels = self.wheels.iter().map(|w| map_wheel(w, value)).collect();
        Platform::new(body, wheels).expect("a checked platform stays one in another scalar")
    }

    /// Twist (V_x, V_y, ω) of P in base axes for velocity coordinates v.
    #[inline(always)]
    pub fn twist(&self, v: &[T]) -> (Vec2<T>, T) {
        let eta = self.layout.eta;
        (
            vec2(dot(eta, &self.basis[0], v), dot(eta, &self.basis[1], v)),
            dot(eta, &self.basis[2], v),
        )
    }

    /// Velocity coordinates for a twist and steering rates: the closest that the fixed wheels allow.
    pub fn velocity_from_twist(&self, velocity: Vec2<T>, yaw_rate: T, steering: &[T]) -> Row<T> {
        velocity_from_twist(self, velocity, yaw_rate, steering)
    }

    #[inline(always)]
    fn closest_velocity(&self, velocity: Vec2<T>, yaw_rate: T, steering: &[T]) -> Row<T> {
        let eta = self.layout.eta;
        let mut normal = [[T::zero(); 3]; 3];
        let mut right = [T::zero(); 3];
        let twist = [velocity.x, velocity.y, yaw_rate];
        for i in 0..eta {
            for k in 0..3 {
                right[i] = self.basis[k][i].mul_add(twist[k], right[i]);
                for j in 0..eta {
                    normal[i][j] = self.basis[k][i].mul_add(self.basis[k][j], normal[i][j]);
                }
            }
        }
        let solved = crate::solve::solve_semidefinite(eta, normal, right, T::from(T::ROUNDING));
        let mut v = zero_row();
        v[..eta].copy_from_slice(&solved[..eta]);
        v[eta..eta + steering.len()].copy_from_slice(steering);
        v
    }

    /// Brings the cosines and sines of a stage back to length one, as far as lengths near one go.
    #[inline(always)]
    pub fn straighten(&self, stage: &mut [T]) {
        straighten(stage, YAW + 1);
        for k in 0..self.layout.swivels.len() {
            straighten(stage, self.layout.swivel(k) + 1);
        }
    }

    /// Renews what the state carries beside its angles: the angles of linkages, then all cosines and
    /// sines.
    #[inline(always)]
    pub fn renew_angles(&self, x: &mut [T]) {
        renew_angle(x, YAW);
        for k in 0..self.layout.swivels.len() {
            let (i, at) = (self.layout.swivels[k], self.layout.swivel(k));
            match self.wheels[i].steering {
                Steering::Linked { lead, ratio } => {
                    x[at] = ratio * x[self.layout.swivel(self.swivel_index(lead))];
                }
                Steering::Guided { lead } => {
                    let angle = x[self.layout.swivel(self.swivel_index(lead))];
                    let (sin, cos) = angle.sin_cos();
                    let [across, along, apart] = self.guidance(i, lead);
                    let reach = along.mul_add(cos, apart * sin);
                    // Of the two senses of the wheel plane the one that points ahead when straight.
                    let sense = T::one().copysign(along);
                    x[at] = (across * sin * sense).atan2(reach * sense);
                }
                Steering::Fixed { .. } | Steering::Driven | Steering::Free { .. } => {}
            }
            renew_angle(x, at);
        }
    }

    /// Whether a state is the cosine or sine of another one.
    pub fn repeats_angle(&self, index: usize) -> bool {
        let angles = (0..self.layout.swivels.len()).map(|k| self.layout.swivel(k));
        core::iter::once(YAW)
            .chain(angles)
            .any(|at| index == at + 1 || index == at + 2)
    }

    /// Frame of wheel i for a state x.
    #[inline(always)]
    pub fn wheel_frame(&self, i: usize, x: &[T]) -> WheelFrame<T> {
        let wheel = &self.wheels[i];
        match wheel.steering {
            Steering::Fixed { .. } => self.frames[i],
            _ => {
                let k = self.swivel_index(i);
                let at = self.layout.swivel(k);
                wheel.frame(x[at + 1], x[at + 2])
            }
        }
    }

    /// γ of a wheel that swivels, rad.
    pub fn steering_angle(&self, i: usize, x: &[T]) -> T {
        x[self.layout.swivel(self.swivel_index(i))]
    }

    /// Direction and lever arm of the force along which the rim of wheel i resists.
    /// `[eq:constraints]`
    #[inline(always)]
    pub fn rolling_row(&self, i: usize, frame: &WheelFrame<T>) -> RollingRow<T> {
        let rim = self.rims[i];
        RollingRow {
            direction: frame.forward * rim.x + frame.left * rim.y,
            lever: self.wheels[i].radius * rim.x,
        }
    }

    #[inline(always)]
    fn steered_index(&self, i: usize) -> usize {
        let mut k = 0;
        while self.layout.steered[k] != i {
            k += 1;
        }
        k
    }

    /// Of a guided wheel: its distance ahead of the fixed axle, that of its lead, and how far the
    /// lead stands to its left, m.
    #[inline(always)]
    fn guidance(&self, i: usize, lead: usize) -> [T; 3] {
        let behind = self.axle;
        let (own, lead) = (self.wheels[i].mount, self.wheels[lead].mount);
        [own.x + behind, lead.x + behind, lead.y - own.y]
    }

    fn swivel_index(&self, i: usize) -> usize {
        let mut k = 0;
        while self.layout.swivels[k] != i {
            k += 1;
        }
        k
    }

    /// Rows over v of the velocity of a point carried by the base at `r`.
    #[inline(always)]
    pub fn point_rows(&self, r: Vec2<T>) -> [Row<T>; 2] {
        let mut rows = [zero_row(), zero_row()];
        for k in 0..self.layout.eta {
            rows[0][k] = (-r.y).mul_add(self.basis[2][k], self.basis[0][k]);
            rows[1][k] = r.x.mul_add(self.basis[2][k], self.basis[1][k]);
        }
        rows
    }

    /// Row over v of the yaw rate.
    #[inline(always)]
    pub fn yaw_row(&self) -> Row<T> {
        self.basis[2]
    }

    /// γ̇ of a caster for a twist of the base: its contact must not move along its axle.
    #[inline(always)]
    pub fn caster_rate(
        &self,
        i: usize,
        frame: &WheelFrame<T>,
        velocity: Vec2<T>,
        yaw_rate: T,
    ) -> T {
        let wheel = &self.wheels[i];
        let pivot = velocity + wheel.mount.perpendicular() * yaw_rate;
        frame.left.dot(pivot) / wheel.trail() - yaw_rate
    }

    /// φ̇ of wheel i for a twist of the base: its rim must not slip along what it resists.
    /// `[eq:constraints]`
    #[inline(always)]
    pub fn spin_rate(&self, i: usize, frame: &WheelFrame<T>, velocity: Vec2<T>, yaw_rate: T) -> T {
        let rolling = self.rolling_row(i, frame);
        let contact = velocity + frame.contact.perpendicular() * yaw_rate;
        rolling.direction.dot(contact) / rolling.lever
    }

    /// The k-th column of Σ as a twist.
    #[inline(always)]
    fn basis_twist(&self, k: usize) -> (Vec2<T>, T) {
        (vec2(self.basis[0][k], self.basis[1][k]), self.basis[2][k])
    }

    /// Row over v of γ̇ of wheel i.
    #[inline(always)]
    pub fn swivel_row(&self, i: usize, frame: &WheelFrame<T>) -> Row<T> {
        let mut row = zero_row();
        match self.wheels[i].steering {
            Steering::Fixed { .. } => {}
            Steering::Driven => row[self.layout.eta + self.steered_index(i)] = T::one(),
            Steering::Linked { lead, ratio } => {
                row[self.layout.eta + self.steered_index(lead)] = ratio;
            }
            Steering::Guided { lead } => {
                // tan γ = x s / (x_l c + Δy s) for the lead's angle with cosine c and sine s, in axes
                // with their origin on the fixed wheels' axle.
                let [across, along, apart] = self.guidance(i, lead);
                // The frame of the lead is not at hand; that of the wheel itself gives its angle.
                let (own_cos, own_sin) = (frame.forward.x, frame.forward.y);
                let cos = across.mul_add(own_cos, -(apart * own_sin));
                let sin = along * own_sin;
                let size = cos.mul_add(cos, sin * sin);
                let reach = along.mul_add(cos, apart * sin);
                let ahead = across * sin;
                let slope = across * along * size / reach.mul_add(reach, ahead * ahead);
                row[self.layout.eta + self.steered_index(lead)] = slope;
            }
            Steering::Free { .. } => {
                for k in 0..self.layout.eta {
                    let (velocity, yaw_rate) = self.basis_twist(k);
                    row[k] = self.caster_rate(i, frame, velocity, yaw_rate);
                }
            }
        }
        row
    }

    /// Row over v of φ̇ of wheel i.
    #[inline(always)]
    pub fn spin_row(&self, i: usize, frame: &WheelFrame<T>) -> Row<T> {
        let mut row = zero_row();
        for k in 0..self.layout.eta {
            let (velocity, yaw_rate) = self.basis_twist(k);
            row[k] = self.spin_rate(i, frame, velocity, yaw_rate);
        }
        row
    }

    /// Row over v of the velocity of a steered wheel's contact along its axle, which must vanish.
    #[inline(always)]
    pub fn lateral_row(&self, frame: &WheelFrame<T>) -> Row<T> {
        let contact = self.point_rows(frame.contact);
        let mut row = zero_row();
        for k in 0..self.layout.eta {
            row[k] = frame
                .left
                .x
                .mul_add(contact[0][k], frame.left.y * contact[1][k]);
        }
        row
    }

    /// Takes from the velocities `v` what motor-steered wheels forbid, by the least change in the
    /// sense of `mobility`.
    #[inline(always)]
    pub fn guide(&self, x: &[T], mobility: &mut Mobility<T>, v: &mut [T]) {
        for &i in &self.layout.guides {
            let condition = Condition {
                row: self.lateral_row(&self.wheel_frame(i, x)),
                value: T::zero(),
                active: T::Mask::splat(true),
            };
            mobility.impose(&condition, v);
        }
    }

    /// Whether wheel i takes part in the dynamics, and not only follows the motion.
    #[inline(always)]
    pub fn is_dynamic(&self, i: usize) -> bool {
        !(self.layout.constant && self.wheels[i].swivels())
    }

    /// Spin rates φ̇ for a twist (V_x, V_y, ω) that the wheels allow. `[eq:kinematic]`
    pub fn rates_from_twist(&self, x: &[T], twist: [T; 3]) -> Vec<T> {
        let velocity = vec2(twist[0], twist[1]);
        (0..self.wheels.len())
            .map(|i| self.spin_rate(i, &self.wheel_frame(i, x), velocity, twist[2]))
            .collect()
    }

    /// The twist (V_x, V_y, ω) that fits spin rates of all wheels best, and what is left: the norm
    /// of the rates less those of that twist, rad/s, a measure of slip. Steering rates are taken as
    /// zero. `[eq:kinematic]`
    pub fn twist_from_rates(&self, x: &[T], rates: &[T]) -> ([T; 3], T) {
        let n = self.layout.eta;
        let rows: Vec<Row<T>> = (0..self.wheels.len())
            .map(|i| self.spin_row(i, &self.wheel_frame(i, x)))
            .collect();
        let mut normal = [zero_row(); MAX_DOF];
        let mut right = zero_row();
        let mut trace = T::zero();
        for (row, &rate) in rows.iter().zip(rates) {
            add_outer(n, &mut normal, T::one(), row, row);
            for k in 0..n {
                right[k] = row[k].mul_add(rate, right[k]);
                trace = row[k].mul_add(row[k], trace);
            }
        }
        let v = crate::solve::solve_semidefinite(n, normal, right, trace * T::from(T::ROUNDING));
        let mut fitted = zero_row();
        fitted[..n].copy_from_slice(&v[..n]);
        let mut square = T::zero();
        for (row, &rate) in rows.iter().zip(rates) {
            let left = dot(n, row, &fitted) - rate;
            square = left.mul_add(left, square);
        }
        let (velocity, yaw_rate) = self.twist(&fitted);
        ([velocity.x, velocity.y, yaw_rate], square.sqrt())
    }

    /// The reduced equations for the steering angles in the state x. `[eq:reduced-dynamics]`
    pub fn reduce(&self, x: &[T]) -> Reduced<T> {
        reduce(self, x)
    }

    #[inline(always)]
    fn reduced(&self, x: &[T]) -> Reduced<T> {
        let n = self.layout.dof();
        let mut reduced = Reduced {
            spin: [zero_row(); MAX_WHEELS],
            swivel: [zero_row(); MAX_WHEELS],
            mass: [zero_row(); MAX_DOF],
            gyro: [zero_row(); MAX_DOF],
            momentum: [zero_row(), zero_row()],
        };
        let yaw = self.yaw_row();
        add_outer(n, &mut reduced.mass, self.body.inertia_com, &yaw, &yaw);
        let body = self.point_rows(self.body.center_of_mass);
        reduced.add_mass(n, self.body.mass, &body);
        for i in 0..self.wheels.len() {
            if !self.is_dynamic(i) {
                continue;
            }
            let wheel = &self.wheels[i];
            let frame = self.wheel_frame(i, x);
            let spin = self.spin_row(i, &frame);
            let swivel = self.swivel_row(i, &frame);
            let rows = self.carrier_rows(i, &frame, &swivel);
            let mut turning = yaw;
            for k in 0..n {
                turning[k] += swivel[k];
            }
            reduced.add_mass(n, wheel.mass, &rows);
            add_outer(
                n,
                &mut reduced.mass,
                wheel.inertia_vertical,
                &turning,
                &turning,
            );
            add_outer(n, &mut reduced.mass, wheel.spin_inertia, &spin, &spin);
            reduced.spin[i] = spin;
            reduced.swivel[i] = swivel;
        }
        reduced
    }

    /// Rows over v of the velocity of wheel i's mass: V + ω Ω r − d γ̇ n.
    #[inline(always)]
    pub fn carrier_rows(&self, i: usize, frame: &WheelFrame<T>, swivel: &Row<T>) -> [Row<T>; 2] {
        let trail = self.wheels[i].trail();
        let mut rows = self.point_rows(frame.contact);
        for k in 0..self.layout.dof() {
            rows[0][k] = (-(trail * frame.left.x)).mul_add(swivel[k], rows[0][k]);
            rows[1][k] = (-(trail * frame.left.y)).mul_add(swivel[k], rows[1][k]);
        }
        rows
    }

    /// Accelerations of wheel i at v̇ = 0: from Ȧν, with the plane turning at γ̇.
    #[inline(always)]
    pub fn convective(
        &self,
        i: usize,
        frame: &WheelFrame<T>,
        velocity: Vec2<T>,
        yaw_rate: T,
        steering_rate: T,
    ) -> Convective<T> {
        let wheel = &self.wheels[i];
        let rolling = self.rolling_row(i, frame);
        let trail = wheel.trail();
        let carried = velocity + frame.contact.perpendicular() * yaw_rate;
        let swivel = match wheel.steering {
            Steering::Free { trail } => -(steering_rate * frame.forward.dot(carried)) / trail,
            // A guided wheel has no inertia that its angular acceleration could matter to.
            _ => T::zero(),
        };
        let turned = rolling.direction.perpendicular().dot(carried) * steering_rate;
        let swept = yaw_rate * trail * steering_rate * rolling.direction.dot(frame.forward);
        Convective {
            contact: frame.forward * (trail * steering_rate * (yaw_rate + steering_rate))
                - frame.left * (trail * swivel),
            swivel,
            spin: (turned + swept) / rolling.lever,
        }
    }
}

impl<T: Scalar> Reduced<T> {
    /// Adds a point mass with the velocity rows `rows` to mass matrix, G and momentum.
    #[inline(always)]
    fn add_mass(&mut self, n: usize, mass: T, rows: &[Row<T>; 2]) {
        add_outer(n, &mut self.mass, mass, &rows[0], &rows[0]);
        add_outer(n, &mut self.mass, mass, &rows[1], &rows[1]);
        // J_kᵀ Ω J_k with Ω J_k = (−row_y, row_x).
        add_outer(n, &mut self.gyro, -mass, &rows[0], &rows[1]);
        add_outer(n, &mut self.gyro, mass, &rows[1], &rows[0]);
        for axis in 0..2 {
            for k in 0..n {
                self.momentum[axis][k] = mass.mul_add(rows[axis][k], self.momentum[axis][k]);
            }
        }
    }
}

impl<T: Scalar> Lanewise for Platform<T> {
    type One = Platform<f64>;

    fn fits(&self, one: &Platform<f64>) -> bool {
        self.layout == one.layout && self.body.fits(&one.body) && self.wheels.fits(&one.wheels)
    }

    fn put(&mut self, lane: usize, one: &Platform<f64>) {
        self.body.put(lane, &one.body);
        self.wheels.put(lane, &one.wheels);
        self.basis.put(lane, &one.basis);
        self.axle.put(lane, &one.axle);
        self.frames.put(lane, &one.frames);
        self.rims.put(lane, &one.rims);
    }
}

crate::lanewise!(Reduced {} state { spin, swivel, mass, gyro, momentum });

/// Whether the drive has a current as a state: a winding without inductance has none.
pub fn has_current<T: Scalar>(drive: &Drive<T>) -> bool {
    match drive {
        Drive::None | Drive::Rate { .. } | Drive::Torque { .. } => false,
        Drive::DcMotor(motor) => nominal(motor.inductance) != 0.0,
    }
}

/// A caster that neither weighs nor loses anything follows the motion without a part in it.
fn is_follower<T: Scalar>(wheel: &Wheel<T>) -> bool {
    matches!(wheel.steering, Steering::Free { .. }) && is_idle(wheel)
}

/// Whether the wheel has neither drive nor mass nor loss.
fn is_idle<T: Scalar>(wheel: &Wheel<T>) -> bool {
    matches!(wheel.drive, Drive::None)
        && [
            wheel.mass,
            wheel.inertia_vertical,
            wheel.spin_inertia,
            wheel.viscous,
            wheel.pivot_viscous,
            wheel.dry_friction,
            wheel.brake,
        ]
        .iter()
        .all(|&value| nominal(value) == 0.0)
}

fn map_wheel<T: Scalar, U: Scalar>(
    wheel: &Wheel<T>,
    value: &mut dyn FnMut(&str, T) -> U,
) -> Wheel<U> {
    let mut at = |field: &str, number: T| value(&format!("wheel.{}.{field}", wheel.name), number);
    Wheel {
        name: wheel.name.clone(),
        mount: vec2(at("mount.x", wheel.mount.x), at("mount.y", wheel.mount.y)),
        radius: at("radius", wheel.radius),
        steering: match wheel.steering {
            Steering::Fixed { angle } => Steering::Fixed {
                angle: at("steering.angle", angle),
            },
            Steering::Driven => Steering::Driven,
            Steering::Linked { lead, ratio } => Steering::Linked {
                lead,
                ratio: at("steering.ratio", ratio),
            },
            Steering::Guided { lead } => Steering::Guided { lead },
            Steering::Free { trail } => Steering::Free {
                trail: at("trail", trail),
            },
        },
        rim: match wheel.rim {
            Rim::Plain => Rim::Plain,
            Rim::Rollers { angle } => Rim::Rollers {
                angle: at("rim.angle", angle),
            },
        },
        mass: at("mass", wheel.mass),
        inertia_vertical: at("inertia_vertical", wheel.inertia_vertical),
        spin_inertia: at("spin_inertia", wheel.spin_inertia),
        viscous: at("viscous", wheel.viscous),
        pivot_viscous: at("pivot_viscous", wheel.pivot_viscous),
        dry_friction: at("dry_friction", wheel.dry_friction),
        friction_rounding: at("friction_rounding", wheel.friction_rounding),
        brake: at("brake", wheel.brake),
        stiffness: at("stiffness", wheel.stiffness),
        drive: match wheel.drive {
            Drive::None => Drive::None,
            Drive::Rate { rate_max } => Drive::Rate {
                rate_max: at("drive.rate_max", rate_max),
            },
            Drive::Torque { torque_max } => Drive::Torque {
                torque_max: at("drive.torque_max", torque_max),
            },
            Drive::DcMotor(m) => Drive::DcMotor(DcMotor {
                resistance: at("drive.resistance", m.resistance),
                inductance: at("drive.inductance", m.inductance),
                torque_constant: at("drive.torque_constant", m.torque_constant),
                back_emf_constant: at("drive.back_emf_constant", m.back_emf_constant),
                gear_ratio: at("drive.gear_ratio", m.gear_ratio),
                gear_efficiency: at("drive.gear_efficiency", m.gear_efficiency),
                voltage_max: at("drive.voltage_max", m.voltage_max),
                current_max: at("drive.current_max", m.current_max),
            }),
        },
    }
}
