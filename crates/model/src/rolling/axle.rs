//! What happens at one axle: drive, friction, and what they cost. `[eq:motor]`

use super::is_zero;
use crate::drive::{Drive, Winding};
use crate::lanewise;
use crate::lanewise::Lanewise;
use crate::scalar::{Mask, Scalar};
use crate::wheel::Wheel;

/// What turns and resists one wheel.
#[derive(Clone, Debug)]
pub(crate) struct Axle<T> {
    pub(crate) supply: Supply<T>,
    pub(crate) viscous: T,
    pub(crate) dry_friction: T,
    pub(crate) brake: T,
    /// Whether there is dry friction or a brake that can hold the wheel.
    pub(crate) rubs: bool,
    /// Rate over which friction that cannot hold it is rounded off, rad/s.
    pub(crate) rounding: Option<T>,
}

/// What gives an axle its torque.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Supply<T> {
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
pub(crate) struct Action<T: Scalar> {
    /// Spin rate φ̇, rad/s; zero where the wheel sticks.
    pub(crate) rate: T,
    /// Torque of the drive at the axle, N·m.
    pub(crate) torque: T,
    /// Torque of viscous and kinetic dry friction, N·m.
    pub(crate) lost: T,
    /// Largest torque of dry friction, N·m.
    pub(crate) bound: T,
    /// Whether dry friction holds the wheel.
    pub(crate) stuck: T::Mask,
    /// Current, A, and its rate, A/s.
    pub(crate) current: T,
    pub(crate) current_rate: T,
    /// Power: supplied, heat of the winding, heat of the gears, heat of friction, W.
    pub(crate) supplied: T,
    pub(crate) windings: T,
    pub(crate) gears: T,
    pub(crate) rubbed: T,
}

/// A drive at the end of an implicit step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turned<T> {
    /// Torque at the axle, N·m, and how it falls with the rate, N·m·s/rad.
    pub(crate) torque: T,
    pub(crate) damping: T,
    /// Current, A.
    pub(crate) current: T,
    /// Power: supplied, heat of the winding, heat of the gears, W.
    pub(crate) supplied: T,
    pub(crate) windings: T,
    pub(crate) gears: T,
}

lanewise!(Axle {} state { supply, viscous, dry_friction, brake, rounding });

impl<T: Scalar> Lanewise for Supply<T> {
    type One = Supply<f64>;

    /// As the drive does that it follows from.
    fn fits(&self, _one: &Supply<f64>) -> bool {
        true
    }

    fn put(&mut self, lane: usize, one: &Supply<f64>) {
        match (self, one) {
            (Supply::Torque(a), Supply::Torque(b)) => a.put(lane, b),
            (Supply::Motor(a, _), Supply::Motor(b, _))
            | (Supply::Resistor(a), Supply::Resistor(b)) => a.put(lane, b),
            _ => {}
        }
    }
}

impl<T: Scalar> Axle<T> {
    pub(crate) fn new(wheel: &Wheel<T>, current: Option<usize>) -> Self {
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
    pub(crate) fn bound(&self, brake: T) -> T {
        self.brake.mul_add(brake, self.dry_friction)
    }

    /// Whether a bound of dry friction holds the wheel in this mode.
    #[inline(always)]
    pub(crate) fn sticks(&self, mode: T, bound: T) -> T::Mask {
        is_zero(mode).and(T::zero().less(bound))
    }

    /// What happens for a command, a brake command, a mode, a spin rate and a current.
    #[inline(always)]
    pub(crate) fn act(&self, command: T, brake: T, mode: T, rate: T, current: T) -> Action<T> {
        let mut action = self.resist(brake, mode, rate);
        self.drive(&mut action, command, current);
        action
    }

    /// Index of the current among the states, if it is one.
    #[inline(always)]
    pub(crate) fn current(&self) -> Option<usize> {
        match self.supply {
            Supply::Motor(_, at) => Some(at),
            _ => None,
        }
    }

    /// Torque that holds the wheel or brakes it, N·m: zero where friction is rounded off.
    #[inline(always)]
    pub(crate) fn held(&self, brake: T) -> T {
        if self.rubs {
            self.bound(brake)
        } else {
            T::zero()
        }
    }

    /// Torque of the friction that depends on the rate, and its derivative, N·m·s/rad.
    #[inline(always)]
    pub(crate) fn glide(&self, brake: T, rate: T) -> (T, T) {
        let viscous = self.viscous * rate;
        match self.rounding {
            Some(rounding) => {
                let (bound, bend) = (self.bound(brake), (rate / rounding).tanh());
                let slope = bound * (T::one() - bend * bend) / rounding;
                (bound.mul_add(bend, viscous), self.viscous + slope)
            }
            None => (viscous, self.viscous),
        }
    }

    /// The drive at the end of an implicit step of `step` s, for the rate at the end and the current at
    /// its start.
    #[inline(always)]
    pub(crate) fn at_end(&self, command: T, rate: T, start: T, step: T) -> Turned<T> {
        let zero = T::zero();
        let mut action = Action {
            rate,
            ..Action::none()
        };
        let mut damping = zero;
        match &self.supply {
            Supply::None => {}
            Supply::Torque(limit) => {
                action.torque = command.max(-*limit).min(*limit);
                action.supplied = action.torque * rate;
            }
            Supply::Motor(winding, _) | Supply::Resistor(winding) => {
                let emf = winding.emf * rate;
                let voltage = winding.terminal_voltage(command, emf);
                let (current, conductance) = if let Supply::Motor(..) = self.supply {
                    // L (i − i₀)/h = U − R i − E.
                    let gain = step * winding.slope;
                    let share = T::one() / gain.mul_add(winding.resistance, T::one());
                    (gain.mul_add(voltage - emf, start) * share, gain * share)
                } else {
                    (winding.steady_current(voltage, emf), winding.conductance)
                };
                action.spend(winding, voltage, current, emf);
                // Where the driver limits the current, the voltage follows the back-EMF.
                let asked = command.max(-winding.voltage_max).min(winding.voltage_max);
                let limited = zero.less((asked - voltage).abs());
                let free = winding.torque * winding.emf * conductance;
                damping = T::select(limited, zero, free);
            }
        }
        Turned {
            torque: action.torque,
            damping,
            current: action.current,
            supplied: action.supplied,
            windings: action.windings,
            gears: action.gears,
        }
    }

    /// Adds what the drive does.
    #[inline(always)]
    pub(crate) fn drive(&self, action: &mut Action<T>, command: T, current: T) {
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

    /// Friction alone.
    #[inline(always)]
    pub(crate) fn resist(&self, brake: T, mode: T, rate: T) -> Action<T> {
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
    pub(crate) fn none() -> Self {
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
    pub(crate) fn drive(&mut self, winding: &Winding<T>, command: T, current: T) {
        let emf = winding.emf * self.rate;
        let voltage = winding.terminal_voltage(command, emf);
        self.current_rate = winding.current_rate(voltage, current, emf);
        self.spend(winding, voltage, current, emf);
    }

    /// Torque and powers of a motor at a current.
    #[inline(always)]
    pub(crate) fn spend(&mut self, winding: &Winding<T>, voltage: T, current: T, emf: T) {
        self.current = current;
        self.torque = winding.torque * current;
        self.supplied = voltage * current;
        self.windings = winding.resistance * current * current;
        self.gears = emf.mul_add(current, -(self.torque * self.rate));
    }
}
