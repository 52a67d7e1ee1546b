//! Drives: what turns an axle, and what it costs. `[eq:motor]`
//!
//! The command is a spin rate (rad/s), a torque at the wheel axle (N·m) or a terminal voltage (V).

use crate::scalar::Scalar;

/// A drive of one axle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive<T> {
    /// No drive: the wheel turns freely.
    None,
    /// The wheel turns at the commanded rate (kinematic level).
    Rate {
        /// Largest spin rate, rad/s.
        rate_max: T,
    },
    /// The commanded torque acts on the axle.
    Torque {
        /// Largest torque, N·m.
        torque_max: T,
    },
    /// A DC motor behind a gearbox.
    DcMotor(DcMotor<T>),
}

/// A brushed (or ideally commutated) DC motor with a gearbox of constant efficiency.
///
/// L İ = U − R I − K_e n φ̇, τ = η n K_M I at the axle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DcMotor<T> {
    /// Armature resistance R, Ω.
    pub resistance: T,
    /// Armature inductance L, H.
    pub inductance: T,
    /// Torque constant K_M, N·m/A.
    pub torque_constant: T,
    /// Back-EMF constant K_e, V·s/rad.
    pub back_emf_constant: T,
    /// Gear ratio n, motor turns per wheel turn.
    pub gear_ratio: T,
    /// Efficiency η of the gearbox, constant-ratio model.
    pub gear_efficiency: T,
    /// Largest voltage of the supply, V.
    pub voltage_max: T,
    /// Largest current that the driver lets through, A.
    pub current_max: T,
}

impl<T: Scalar> DcMotor<T> {
    /// The constants that a step needs, multiplied out.
    pub fn winding(&self) -> Winding<T> {
        Winding {
            torque: self.torque_per_current(),
            emf: self.back_emf(T::one()),
            resistance: self.resistance,
            conductance: T::one() / self.resistance,
            slope: T::one() / self.inductance,
            window: self.resistance * self.current_max,
            voltage_max: self.voltage_max,
        }
    }

    /// Torque at the axle per ampere, N·m/A.
    #[inline(always)]
    pub fn torque_per_current(&self) -> T {
        self.gear_efficiency * self.gear_ratio * self.torque_constant
    }

    /// Back-EMF at an axle rate (rad/s), V.
    #[inline(always)]
    pub fn back_emf(&self, spin_rate: T) -> T {
        self.back_emf_constant * self.gear_ratio * spin_rate
    }

    /// Largest torque at the axle, at stall, N·m.
    pub fn stall_torque(&self) -> T {
        self.torque_per_current() * (self.voltage_max / self.resistance).min(self.current_max)
    }

    /// Spin rate of the axle without load, rad/s.
    pub fn no_load_rate(&self) -> T {
        self.voltage_max / (self.back_emf_constant * self.gear_ratio)
    }
}

/// A motor as a step sees it: constants that do not change within a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Winding<T> {
    /// η n K_M: torque at the axle per current, N·m/A.
    pub torque: T,
    /// n K_e: back-EMF per rate of the axle, V·s/rad.
    pub emf: T,
    /// R, Ω.
    pub resistance: T,
    /// 1/R, S.
    pub conductance: T,
    /// 1/L, 1/H.
    pub slope: T,
    /// R I_max: how far the voltage may part from the back-EMF, V.
    pub window: T,
    /// Largest voltage, V.
    pub voltage_max: T,
}

crate::lanewise!(Winding {} state { torque, emf, resistance, conductance, slope, window, voltage_max });

impl<T: Scalar> Winding<T> {
    /// The command within the supply, V.
    #[inline(always)]
    pub fn supplied_voltage(&self, command: T) -> T {
        command.max(-self.voltage_max).min(self.voltage_max)
    }

    /// Voltage at the terminals, V: the command within the window E ± R I_max of the current limit
    /// and within the supply.
    ///
    /// In that window L İ ≤ R (I_max − I), so that |I| never exceeds the limit once within it.
    #[inline(always)]
    pub fn terminal_voltage(&self, command: T, emf: T) -> T {
        // The supply's limits on each end of the window, and not last, keep the chain of a step short.
        let command = self.supplied_voltage(command);
        let lowest = (emf - self.window).min(self.voltage_max);
        let highest = (emf + self.window).max(-self.voltage_max);
        command.max(lowest).min(highest)
    }

    /// Rate of the current, A/s: L İ = U − R I − E.
    #[inline(always)]
    pub fn current_rate(&self, voltage: T, current: T, emf: T) -> T {
        (-self.resistance).mul_add(current, voltage - emf) * self.slope
    }

    /// Current without inductance, A: R I = U − E.
    #[inline(always)]
    pub fn steady_current(&self, voltage: T, emf: T) -> T {
        (voltage - emf) * self.conductance
    }
}
