//! Where each quantity of a platform stands in the vectors of its state, input and output.

/// Where each quantity stands in the state, input and output vectors.
///
/// State: x, y, θ, cos θ, sin θ | v | currents | energy ledger | φ of each wheel, those that only
/// follow last | γ, cos γ, sin γ of each swivelling wheel. Input: command of each wheel | torque
/// (rolling) or rate (kinematic) of each steered wheel | brake in [0, 1] | external wrench
/// (F_x, F_y, M_z), base axes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Number of wheels.
    pub wheels: usize,
    /// Wheels that swivel, in the order of their states.
    pub swivels: Vec<usize>,
    /// Wheels steered by a motor, in the order of ζ.
    pub steered: Vec<usize>,
    /// Plain wheels turned by a motor, themselves or by a link: they must not slip along their axles.
    pub guides: Vec<usize>,
    /// Wheels with the state of a motor current.
    pub motors: Vec<usize>,
    /// Place of each wheel's φ among the spin angles: wheels that only follow come last.
    pub spin_places: Vec<usize>,
    /// Number of η.
    pub eta: usize,
    /// Whether every swivelling wheel is a caster without mass and loss, so that S is constant.
    pub constant: bool,
    /// Rank of the lateral rows of the fixed wheels.
    pub fixed_rank: usize,
    /// The fixed wheels whose lateral rows are independent, and whether two of them leave a turn.
    pub(crate) independent: (Vec<usize>, bool),
}

/// Index of yaw, cos yaw and sin yaw in the state.
pub const YAW: usize = 2;
/// First index after the pose.
pub(crate) const POSE: usize = 5;
/// Entries of the energy ledger: supplied, heat of windings, heat of gears, heat of friction, J.
pub const LEDGER: usize = 4;
/// Outputs of the whole robot: twist (3), kinetic, potential and magnetic energy, and last the
/// tip-over margin, m (level `rolling`), or the internal slip: the norm of the wheel rates less those
/// of rolling, rad/s (level `kinematic`).
pub const BODY_OUTPUTS: usize = 7;
/// Outputs of each wheel, see [`WheelOutput`].
pub const WHEEL_OUTPUTS: usize = 7;

/// The outputs of a wheel, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum WheelOutput {
    /// Spin rate φ̇, rad/s.
    SpinRate,
    /// Steering rate γ̇, rad/s.
    SteeringRate,
    /// Torque of the drive at the axle, N·m.
    Torque,
    /// Current of the motor, A.
    Current,
    /// Force of the ground along the wheel's rolling direction or roller axis, N.
    Longitudinal,
    /// Force of the ground along the axle, N.
    Lateral,
    /// Normal load, N.
    Load,
}

impl Layout {
    /// Number of velocity coordinates.
    #[inline(always)]
    pub fn dof(&self) -> usize {
        self.eta + self.steered.len()
    }
    /// Index of the first velocity coordinate.
    #[inline(always)]
    pub fn velocity(&self) -> usize {
        POSE
    }
    /// Index of the first motor current.
    #[inline(always)]
    pub fn current(&self) -> usize {
        self.velocity() + self.dof()
    }
    /// Index of the first entry of the energy ledger.
    #[inline(always)]
    pub fn ledger(&self) -> usize {
        self.current() + self.motors.len()
    }
    /// Index of φ of wheel i.
    #[inline(always)]
    pub fn spin(&self, i: usize) -> usize {
        self.ledger() + LEDGER + self.spin_places[i]
    }
    /// Index of γ of the k-th swivelling wheel (cos γ and sin γ follow).
    #[inline(always)]
    pub fn swivel(&self, k: usize) -> usize {
        self.ledger() + LEDGER + self.wheels + 3 * k
    }
    /// Length of the state.
    #[inline(always)]
    pub fn state(&self) -> usize {
        self.swivel(self.swivels.len())
    }
    /// Index of the first steering command in the input.
    #[inline(always)]
    pub fn steering_input(&self) -> usize {
        self.wheels
    }
    /// Index of the brake command in the input.
    #[inline(always)]
    pub fn brake_input(&self) -> usize {
        self.wheels + self.steered.len()
    }
    /// Index of the first component of the external wrench in the input.
    #[inline(always)]
    pub fn wrench_input(&self) -> usize {
        self.brake_input() + 1
    }
    /// Length of the input.
    #[inline(always)]
    pub fn input(&self) -> usize {
        self.wrench_input() + 3
    }
    /// Index of an output of wheel i.
    #[inline(always)]
    pub fn wheel_output(&self, i: usize, what: WheelOutput) -> usize {
        BODY_OUTPUTS + WHEEL_OUTPUTS * i + what as usize
    }
    /// Length of the output.
    #[inline(always)]
    pub fn output(&self) -> usize {
        BODY_OUTPUTS + WHEEL_OUTPUTS * self.wheels
    }
}
