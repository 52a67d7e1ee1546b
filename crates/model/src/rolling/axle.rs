//! What happens at one axle: drive, friction, and what they cost. `[eq:motor]`

use super::is_zero;
use crate::drive::{Drive, Winding};
use crate::scalar::{Mask, Scalar};
use crate::wheel::Wheel;

/// What turns and resists one wheel.
#[derive(Clone, Debug)]
pub(super) struct Axle<T> {
    pub(super) supply: Supply<T>,
    pub(super) viscous: T,
    pub(super) dry_friction: T,
    pub(super) brake: T,
    /// Whether there is dry friction or a brake that can hold the wheel.
    pub(super) rubs: bool,
    /// Rate over which friction that cannot hold it is rounded off, rad/s.
    pub(super) rounding: Option<T>,
}

/// What gives an axle its torque.
#[derive(Clone, Copy, Debug)]
pub(super) enum Supply<T> {
    /// Nothing.
    None,
    /// A torque, N·m, within this limit.
    Torque(T),
    /// A motor whose current is the state of this index.
    Motor(Winding<T>, usize),
    /// A motor without inductance.
    Resistor(Winding<T>),
}

/// What happens at one axle at an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Action<T: Scalar> {
    /// Spin rate φ̇, rad/s; zero where the wheel sticks.
    pub(super) rate: T,
    /// Torque of the drive at the axle, N·m.
    pub(super) torque: T,
    /// Torque of viscous and kinetic dry friction, N·m.
    pub(super) lost: T,
    /// Largest torque of dry friction, N·m.
    pub(super) bound: T,
    /// Whether dry friction holds the wheel.
    pub(super) stuck: T::Mask,
    /// Current, A, and its rate, A/s.
    pub(super) current: T,
    pub(super) current_rate: T,
    /// Power: supplied, heat of the winding, heat of the gears, heat of friction, W.
    pub(super) supplied: T,
    pub(super) windings: T,
    pub(super) gears: T,
    pub(super) rubbed: T,
}

impl<T: Scalar> Axle<T> {
    pub(super) fn new(wheel: &Wheel<T>, current: Option<usize>) -> Self {
        let rounded = wheel.friction_rounding.lane(0) > 0.0;
        Axle {
            supply: match &wheel.drive {
                Drive::None | Drive::Rate { .. } => Supply::None,
                Drive::Torque { torque_max } => Supply::Torque(*torque_max),
                Drive::DcMotor(motor) => match current {
                    Some(at) => Supply::Motor(motor.winding(), at),
                    None => Supply::Resistor(motor.winding()),
                },
            },
            viscous: wheel.viscous,
            dry_friction: wheel.dry_friction,
            brake: wheel.brake,
            rubs: !rounded && (wheel.dry_friction.lane(0) > 0.0 || wheel.brake.lane(0) > 0.0),
            rounding: rounded.then_some(wheel.friction_rounding),
        }
    }

    /// Largest friction torque that holds or brakes the wheel, N·m, at a brake command in [0, 1].
    #[inline(always)]
    pub(super) fn bound(&self, brake: T) -> T {
        self.brake.mul_add(brake, self.dry_friction)
    }

    /// Whether a bound of dry friction holds the wheel in this mode.
    #[inline(always)]
    pub(super) fn sticks(&self, mode: T, bound: T) -> T::Mask {
        is_zero(mode).and(T::zero().less(bound))
    }

    /// What happens for a command, a brake command, a mode, a spin rate and a current.
    #[inline(always)]
    pub(super) fn act(&self, command: T, brake: T, mode: T, rate: T, current: T) -> Action<T> {
        let mut action = self.resist(brake, mode, rate);
        self.drive(&mut action, command, current);
        action
    }

    /// Adds what the drive does.
    #[inline(always)]
    pub(super) fn drive(&self, action: &mut Action<T>, command: T, current: T) {
        match &self.supply {
            Supply::None => {}
            Supply::Torque(limit) => {
                action.torque = command.max(-*limit).min(*limit);
                action.supplied = action.torque * action.rate;
            }
            Supply::Motor(winding, _) => action.drive(winding, command, current),
            Supply::Resistor(winding) => {
                let emf = winding.emf * action.rate;
                let voltage = winding.terminal_voltage(command, emf);
                action.spend(winding, voltage, winding.steady_current(voltage, emf), emf);
            }
        }
    }

    /// Viscous friction alone, as of a wheel without any other.
    #[inline(always)]
    pub(super) fn roll(&self, rate: T) -> Action<T> {
        let mut action = Action {
            rate,
            ..Action::none()
        };
        action.slow(self.viscous);
        action
    }

    /// Friction alone.
    #[inline(always)]
    pub(super) fn resist(&self, brake: T, mode: T, rate: T) -> Action<T> {
        let mut action = Action {
            rate,
            ..Action::none()
        };
        if self.rubs {
            action.bound = self.bound(brake);
            action.stuck = self.sticks(mode, action.bound);
            action.rate = T::select(action.stuck, T::zero(), rate);
            action.lost = action.bound * mode;
        } else if let Some(rounding) = self.rounding {
            action.lost = self.bound(brake) * (rate / rounding).tanh();
        }
        action.slow(self.viscous);
        action
    }
}

impl<T: Scalar> Action<T> {
    #[inline(always)]
    pub(super) fn none() -> Self {
        let zero = T::zero();
        Action {
            rate: zero,
            torque: zero,
            lost: zero,
            bound: zero,
            stuck: T::Mask::splat(false),
            current: zero,
            current_rate: zero,
            supplied: zero,
            windings: zero,
            gears: zero,
            rubbed: zero,
        }
    }

    /// Adds viscous friction and counts the heat of all friction.
    #[inline(always)]
    fn slow(&mut self, viscous: T) {
        self.lost = viscous.mul_add(self.rate, self.lost);
        self.rubbed = self.lost * self.rate;
    }

    /// A motor whose current is a state.
    #[inline(always)]
    pub(super) fn drive(&mut self, winding: &Winding<T>, command: T, current: T) {
        let emf = winding.emf * self.rate;
        let voltage = winding.terminal_voltage(command, emf);
        self.current_rate = winding.current_rate(voltage, current, emf);
        self.spend(winding, voltage, current, emf);
    }

    /// Torque and powers of a motor at a current.
    #[inline(always)]
    fn spend(&mut self, winding: &Winding<T>, voltage: T, current: T, emf: T) {
        self.current = current;
        self.torque = winding.torque * current;
        self.supplied = voltage * current;
        self.windings = winding.resistance * current * current;
        self.gears = emf.mul_add(current, -(self.torque * self.rate));
    }
}
