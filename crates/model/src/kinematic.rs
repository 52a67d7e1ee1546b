//! Level `kinematic`: the rates of the driven wheels command the twist. `[eq:kinematic]`
//!
//! Driven wheels turn as commanded. The twist is the one whose wheel rates are closest to theirs
//! (least squares), and exactly theirs where the commands agree with one another; what is left is
//! the internal slip. Base frame; rates in rad/s.

use crate::drive::Drive;
use crate::dynamics::{Dynamics, Sizes};
use crate::lanewise;
use crate::planar::Vec2;
use crate::platform::{BODY_OUTPUTS, LEDGER, MAX_WHEELS, Platform, WheelOutput, YAW};
use crate::scalar::Scalar;
use crate::solve::{
    MAX_DOF, Mobility, Row, Square, add_outer, dot, invert, invert_known, product, zero_row,
};

/// A platform whose wheels turn as commanded.
#[derive(Clone, Debug)]
pub struct Kinematic<T: Scalar> {
    platform: Platform<T>,
    /// Wheels whose rates are commanded.
    driven: Vec<usize>,
    /// Spin rows and inverse normal matrix, where the geometry does not change.
    constant: Option<Constant<T>>,
}

/// What follows from a geometry that does not change.
#[derive(Clone, Debug)]
struct Constant<T> {
    rows: [Row<T>; MAX_WHEELS],
    inverse: Square<T>,
}

lanewise!(Kinematic { platform } state { constant });
lanewise!(Constant {} state { rows, inverse });

impl<T: Scalar> Kinematic<T> {
    /// Takes the wheels with a drive as those whose rates are commanded. `None` if they do not
    /// determine the motion.
    pub fn new(platform: Platform<T>) -> Option<Self> {
        let driven: Vec<usize> = (0..platform.wheels().len())
            .filter(|&i| !matches!(platform.wheels()[i].drive, Drive::None))
            .collect();
        let mut kinematic = Kinematic {
            platform,
            driven,
            constant: None,
        };
        let straight = vec![T::zero(); kinematic.platform.layout().state()];
        let mut x = straight;
        x[YAW + 1] = T::one();
        for k in 0..kinematic.platform.layout().swivels.len() {
            let at = kinematic.platform.layout().swivel(k);
            x[at + 1] = T::one();
        }
        let (rows, normal) = kinematic.normal(&x);
        if !is_regular(kinematic.platform.layout().eta, &normal) {
            return None;
        }
        if kinematic.platform.layout().constant {
            let n = kinematic.platform.layout().dof();
            kinematic.constant = Some(Constant {
                inverse: invert(n, &normal),
                rows,
            });
        }
        Some(kinematic)
    }

    /// The platform.
    pub fn platform(&self) -> &Platform<T> {
        &self.platform
    }

    /// Rows of the commanded rates, and the normal matrix of the least-squares problem.
    fn normal(&self, x: &[T]) -> ([Row<T>; MAX_WHEELS], Square<T>) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let mut rows = [zero_row(); MAX_WHEELS];
        let mut normal = [zero_row(); MAX_DOF];
        for &i in &self.driven {
            let frame = self.platform.wheel_frame(i, x);
            rows[i] = self.platform.spin_row(i, &frame);
            add_outer(n, &mut normal, T::one(), &rows[i], &rows[i]);
        }
        // Constraints may be added to the sum of squares without moving its constrained minimum; they
        // make the matrix regular.
        for &i in &layout.guides {
            let row = self.platform.lateral_row(&self.platform.wheel_frame(i, x));
            add_outer(n, &mut normal, T::one(), &row, &row);
        }
        for k in layout.eta..n {
            normal[k][k] += T::one();
        }
        (rows, normal)
    }

    /// Velocity coordinates for commanded wheel rates (rad/s) and steering rates (rad/s).
    #[inline(always)]
    pub fn velocity(&self, x: &[T], u: &[T]) -> Row<T> {
        let layout = self.platform.layout();
        let n = layout.dof();
        let varying;
        let (rows, inverse) = match &self.constant {
            Some(Constant { rows, inverse }) => (rows, inverse),
            None => {
                let (rows, normal) = self.normal(x);
                // A steered wheel across the way of the driven ones leaves a direction unknown.
                let mut trace = T::zero();
                for k in 0..n {
                    trace += normal[k][k];
                }
                varying = (rows, invert_known(n, &normal, trace * T::from(T::ROUNDING)));
                (&varying.0, &varying.1)
            }
        };
        let mut right = zero_row();
        for &i in &self.driven {
            let command = self.rate(i, u);
            for k in 0..n {
                right[k] = rows[i][k].mul_add(command, right[k]);
            }
        }
        for k in 0..layout.steered.len() {
            right[layout.eta + k] += u[layout.steering_input() + k];
        }
        let mut v = product(n, inverse, &right);
        if !layout.steered.is_empty() {
            self.platform
                .guide(x, &mut Mobility::new(n, inverse), &mut v);
        }
        v
    }

    /// φ̇ of wheel i: as commanded, or as it rolls.
    #[inline(always)]
    fn spin(&self, i: usize, x: &[T], u: &[T], v: &Row<T>) -> T {
        if matches!(self.platform.wheels()[i].drive, Drive::None) {
            let frame = self.platform.wheel_frame(i, x);
            dot(
                self.platform.layout().dof(),
                &self.platform.spin_row(i, &frame),
                v,
            )
        } else {
            self.rate(i, u)
        }
    }

    /// Commanded rate of wheel i within the limit of its drive, rad/s.
    #[inline(always)]
    fn rate(&self, i: usize, u: &[T]) -> T {
        match &self.platform.wheels()[i].drive {
            Drive::Rate { rate_max } => u[i].max(-*rate_max).min(*rate_max),
            Drive::None | Drive::Torque { .. } | Drive::DcMotor(_) => u[i],
        }
    }
}

/// Displacement, in the axes at its start, of a platform that goes `way` (along its own axes) while
/// it turns by `turn`, both at constant rates: the chord of an arc. `[eq:odometry]`
///
/// The last argument is sine and cosine of turn / 2: the caller has the means to find them fast.
#[inline(always)]
pub fn along_arc<T: Scalar>(way: Vec2<T>, turn: T, (sin, cos): (T, T)) -> Vec2<T> {
    // The displacement is turned by half the turn, and shorter by sinc of it. Below this angle the
    // quotient equals 1 − h²/6 to the last bit.
    let half = T::from(0.5) * turn;
    let small = half.abs().less(T::from(1e-4));
    let series = (half * half).mul_add(T::from(-1.0 / 6.0), T::one());
    let chord = T::select(small, series, sin / T::select(small, T::one(), half));
    (way * chord).rotated(cos, sin)
}

/// Whether the leading block is safely invertible, on nominal values.
fn is_regular<T: Scalar>(n: usize, matrix: &Square<T>) -> bool {
    let mut a = [[0.0; MAX_DOF]; MAX_DOF];
    for i in 0..n {
        for j in 0..n {
            a[i][j] = matrix[i][j].lane(0);
        }
    }
    let trace: f64 = (0..n).map(|k| a[k][k]).sum();
    for k in 0..n {
        if a[k][k] <= 1e-12 * trace {
            return false;
        }
        for i in k + 1..n {
            let factor = a[i][k] / a[k][k];
            for j in k..n {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    true
}

impl<T: Scalar> Dynamics<T> for Kinematic<T> {
    fn sizes(&self) -> Sizes {
        let layout = self.platform.layout();
        Sizes {
            state: layout.state(),
            input: layout.input(),
            output: layout.output(),
            mode: layout.wheels,
            guards: 0,
        }
    }

    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], _mode: &[T], dx: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let v = self.velocity(x, u);
        let (velocity, yaw_rate) = self.platform.twist(&v);
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let travel = velocity.rotated(cos, sin);
        dx[0] = travel.x;
        dx[1] = travel.y;
        dx[YAW] = yaw_rate;
        dx[YAW + 1] = -(sin * yaw_rate);
        dx[YAW + 2] = cos * yaw_rate;
        for (k, &i) in layout.swivels.iter().enumerate() {
            let frame = self.platform.wheel_frame(i, x);
            let rate = dot(n, &self.platform.swivel_row(i, &frame), &v);
            let at = layout.swivel(k);
            dx[at] = rate;
            dx[at + 1] = -(x[at + 2] * rate);
            dx[at + 2] = x[at + 1] * rate;
        }
        for i in 0..layout.wheels {
            dx[layout.spin(i)] = self.spin(i, x, u, &v);
        }
        // Wheels that turn as commanded have no momentum and use no energy.
        for rate in &mut dx[layout.velocity()..layout.ledger() + LEDGER] {
            *rate = T::zero();
        }
    }

    #[inline(always)]
    fn output(&self, x: &[T], u: &[T], _mode: &[T], y: &mut [T]) {
        let layout = self.platform.layout();
        let n = layout.dof();
        for value in y.iter_mut() {
            *value = T::zero();
        }
        let v = self.velocity(x, u);
        let (velocity, yaw_rate) = self.platform.twist(&v);
        y[0] = velocity.x;
        y[1] = velocity.y;
        y[2] = yaw_rate;
        let mut square = T::zero();
        for i in 0..layout.wheels {
            let frame = self.platform.wheel_frame(i, x);
            let rate = self.spin(i, x, u, &v);
            let left = rate - dot(n, &self.platform.spin_row(i, &frame), &v);
            square = left.mul_add(left, square);
            y[layout.wheel_output(i, WheelOutput::SpinRate)] = rate;
            y[layout.wheel_output(i, WheelOutput::SteeringRate)] =
                dot(n, &self.platform.swivel_row(i, &frame), &v);
        }
        y[BODY_OUTPUTS - 1] = square.sqrt();
    }

    fn decide(&self, _x: &[T], _u: &[T], _mode: &mut [T]) {}

    #[inline(always)]
    fn settle(&self, x: &mut [T], _u: &[T], _mode: &mut [T]) {
        self.platform.renew_angles(x);
    }

    fn guards(&self, _x: &[T], _u: &[T], _mode: &[T], _g: &mut [T]) {}

    fn is_derived(&self, index: usize) -> bool {
        self.platform.repeats_angle(index)
    }
}
