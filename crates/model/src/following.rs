//! Levels `kinematic` and `rolling` on uneven ground. `[eq:following]`
//!
//! The motion in the plane of the chassis is that of the level on a floor, under what gravity and the
//! ground do in that plane; the chassis lies as [`crate::stance`] says. Rolling is measured along the
//! chassis. Three more states keep height, m, roll and pitch, rad: they repeat what follows from the
//! pose, and tell the next search where to begin.

use crate::dynamics::{Dynamics, Sizes};
use crate::kinematic::Kinematic;
use crate::planar::{Vec2, vec2};
use crate::platform::{BODY_OUTPUTS, MAX_WHEELS, Platform, WheelOutput, YAW};
use crate::rolling::Rolling;
use crate::scalar::Scalar;
use crate::solve::MAX_DOF;
use crate::stance::{Attitude, Footing, Stance, Standing};

/// A level of model in a plane.
pub trait Planar<T: Scalar>: Dynamics<T> {
    /// Whether forces move it, and energy is accounted for.
    const FORCES: bool;
    /// The platform.
    fn platform(&self) -> &Platform<T>;
}

impl<T: Scalar> Planar<T> for Kinematic<T> {
    const FORCES: bool = false;
    fn platform(&self) -> &Platform<T> {
        self.platform()
    }
}

impl<T: Scalar> Planar<T> for Rolling<T> {
    const FORCES: bool = true;
    fn platform(&self) -> &Platform<T> {
        self.platform()
    }
}

/// A level on uneven ground.
#[derive(Clone, Debug)]
pub struct Following<T: Scalar, S> {
    level: S,
    footing: Footing<T>,
}

/// Longest input: a command and a steering torque for each, a wrench, a brake.
const INPUTS: usize = MAX_WHEELS + MAX_DOF + 8;

impl<T: Scalar, S: Planar<T>> Following<T, S> {
    /// Joins a level on a floor without gravity along it, and a footing.
    pub fn new(level: S, footing: Footing<T>) -> Self {
        Following { level, footing }
    }

    /// The level in its plane.
    pub fn level(&self) -> &S {
        &self.level
    }

    /// What it stands on.
    pub fn footing(&self) -> &Footing<T> {
        &self.footing
    }

    /// Index of height, roll and pitch in the state, and length of the state without them.
    pub fn attitude(&self) -> usize {
        self.level.platform().layout().state()
    }

    /// A state of the level in its plane, with the attitude it has there.
    pub fn state(&self, x: &[T]) -> Vec<T> {
        let mut state = x.to_vec();
        state.extend(self.footing.guess(self.level.platform(), x));
        let stance = self.stand(&state);
        let at = self.attitude();
        state[at..].copy_from_slice(&stance.attitude);
        state
    }

    /// How it stands.
    pub fn stand(&self, x: &[T]) -> Stance<T> {
        let at = self.attitude();
        let near: Attitude<T> = [x[at], x[at + 1], x[at + 2]];
        self.footing.stand(self.level.platform(), x, near)
    }

    /// Renews height, roll and pitch in a state, and says whether it can stand so.
    pub fn rest(&self, x: &mut [T]) -> Standing {
        let stance = self.stand(x);
        let at = self.attitude();
        x[at..].copy_from_slice(&stance.attitude);
        stance.standing
    }

    /// The input with what gravity and the ground do.
    fn pushed(&self, x: &[T], u: &[T], stance: &Stance<T>) -> [T; INPUTS] {
        let mut input = [T::zero(); INPUTS];
        input[..u.len()].copy_from_slice(u);
        if S::FORCES {
            let platform = self.level.platform();
            let layout = platform.layout();
            let at = layout.wrench_input();
            for k in 0..3 {
                input[at + k] += stance.push[k];
            }
            let turns = stance.turns(platform, x);
            for k in 0..layout.steered.len() {
                input[layout.steering_input() + k] += turns[k];
            }
        }
        input
    }
}

impl<T: Scalar, S: Planar<T>> Dynamics<T> for Following<T, S> {
    fn sizes(&self) -> Sizes {
        let level = self.level.sizes();
        Sizes {
            state: level.state + 3,
            output: level.output + 3,
            ..level
        }
    }

    fn derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        let at = self.attitude();
        let stance = self.stand(x);
        let input = self.pushed(x, u, &stance);
        self.level
            .derivative(&x[..at], &input[..u.len()], mode, &mut dx[..at]);
        let (cos, sin) = (x[YAW + 1], x[YAW + 2]);
        let velocity = vec2(dx[0], dx[1]).rotated(cos, -sin);
        let yaw_rate = dx[YAW];
        [dx[0], dx[1], dx[YAW]] = stance.pose_rates(velocity, yaw_rate);
        dx[YAW + 1] = -(sin * dx[YAW]);
        dx[YAW + 2] = cos * dx[YAW];
        dx[at..].fill(T::zero());
        if S::FORCES {
            // Its push is no supply: it comes from energy of height.
            let mut power = stance.push[0].mul_add(
                velocity.x,
                stance.push[1].mul_add(velocity.y, stance.push[2] * yaw_rate),
            );
            let layout = self.level.platform().layout();
            let turns = stance.turns(self.level.platform(), x);
            for k in 0..layout.steered.len() {
                power = turns[k].mul_add(x[layout.velocity() + layout.eta + k], power);
            }
            dx[layout.ledger()] -= power;
        }
    }

    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        let at = self.attitude();
        let end = self.level.sizes().output;
        let stance = self.stand(x);
        let input = self.pushed(x, u, &stance);
        self.level
            .output(&x[..at], &input[..u.len()], mode, &mut y[..end]);
        y[end..].copy_from_slice(&stance.attitude);
        if !S::FORCES {
            return;
        }
        y[4] = stance.potential;
        let platform = self.level.platform();
        let layout = platform.layout();
        let mut force = Vec2::zero();
        for i in 0..layout.wheels {
            let frame = platform.wheel_frame(i, x);
            let along = platform.rolling_row(i, &frame).direction;
            force = force
                + along * y[layout.wheel_output(i, WheelOutput::Longitudinal)]
                + frame.left * y[layout.wheel_output(i, WheelOutput::Lateral)];
        }
        // At rest the ground gives −push; what it gives beyond shifts the loads.
        let beyond = force + vec2(stance.push[0], stance.push[1]);
        let shift = self.footing.transfer(&stance);
        for i in 0..layout.wheels {
            let load = stance.loads[i] + shift[i].dot(beyond);
            y[layout.wheel_output(i, WheelOutput::Load)] =
                T::select(stance.lifted[i], T::zero(), load);
        }
        y[BODY_OUTPUTS - 1] = self.footing.margin(platform, &stance, force);
    }

    fn motion(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        let end = self.level.sizes().output;
        self.level
            .motion(&x[..self.attitude()], u, mode, &mut y[..end]);
    }

    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        if S::FORCES {
            let stance = self.stand(x);
            let input = self.pushed(x, u, &stance);
            self.level
                .decide(&x[..self.attitude()], &input[..u.len()], mode);
        }
    }

    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        let at = self.attitude();
        self.level.platform().renew_angles(x);
        let stance = self.stand(x);
        x[at..].copy_from_slice(&stance.attitude);
        let input = self.pushed(x, u, &stance);
        self.level.settle(&mut x[..at], &input[..u.len()], mode);
    }

    fn straighten(&self, stage: &mut [T]) {
        self.level.straighten(&mut stage[..self.attitude()]);
    }

    fn guards(&self, x: &[T], u: &[T], mode: &[T], g: &mut [T]) {
        let stance = self.stand(x);
        let input = self.pushed(x, u, &stance);
        self.level
            .guards(&x[..self.attitude()], &input[..u.len()], mode, g);
    }

    fn linear_part(&self, mode: &[T], matrix: &mut [T]) -> Option<core::ops::Range<usize>> {
        self.level.linear_part(mode, matrix)
    }

    fn is_derived(&self, index: usize) -> bool {
        index >= self.attitude() || self.level.is_derived(index)
    }
}
