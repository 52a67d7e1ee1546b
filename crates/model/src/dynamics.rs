//! The border of mathematics: a continuous system with modes, and its inputs.

use crate::scalar::Scalar;

/// Sizes of the vectors of a system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Length of the state x.
    pub state: usize,
    /// Length of the input u.
    pub input: usize,
    /// Length of the output y.
    pub output: usize,
    /// Length of the discrete mode.
    pub mode: usize,
    /// Number of guard functions.
    pub guards: usize,
}

/// A continuous system with modes: ẋ = f(t, x, u; mode), y = g(t, x, u; mode). Pure and total.
///
/// The mode holds what is discrete: here, for each wheel with dry friction, the sense in which it
/// turns (−1, +1) or 0 when it rests. A step of an integrator is `decide`, then `derivative` at
/// constant mode, then `settle`.
pub trait Dynamics<T: Scalar>: Send + Sync {
    /// Index of the first state of the linear part, where the compiler knows the sizes.
    const STIFF: usize = 0;
    /// Two ranges of states beyond which nothing has a part in the derivative: a stage needs no more.
    const READ: [(usize, usize); 2] = [(0, usize::MAX), (0, 0)];
    /// Sizes of all vectors.
    fn sizes(&self) -> Sizes;
    /// Rate of the state.
    fn derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]);
    /// Outputs at an instant.
    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]);
    /// The outputs that are motion: twist, spin and steering rates. The others keep their values.
    #[inline(always)]
    fn motion(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        self.output(x, u, mode, y);
    }
    /// Chooses the mode for a step that begins here: what rests and would be pushed harder than
    /// its friction holds, lets go.
    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]);
    /// Ends a step: what turned over within it comes to rest, and redundant states are renewed.
    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]);
    /// Brings pairs of cosine and sine in a stage of low order back to length one.
    #[inline(always)]
    fn straighten(&self, _stage: &mut [T]) {}
    /// Functions that are positive while the mode holds; an adaptive step ends where one vanishes.
    fn guards(&self, x: &[T], u: &[T], mode: &[T], g: &mut [T]);
    /// The linear part of the stiff states, if the system has one: fills `matrix` (row-major,
    /// k × k) of ż = A z + … for the consecutive states z = x[range], and returns that range.
    fn linear_part(&self, _mode: &[T], _matrix: &mut [T]) -> Option<core::ops::Range<usize>> {
        None
    }
    /// Does a job under the input `u` on this system, or on a twin of it whose sizes the compiler
    /// knows, and which leaves out what that input does not move. Same bits.
    #[inline(always)]
    fn specialised<J: Work<T>>(&self, _u: &[T], job: J) -> J::Output
    where
        Self: Sized,
    {
        job.run::<0, 0, _>(self)
    }
    /// The part of the state that a step under a held input needs stages for, where all others are
    /// gathered afterwards by [`Dynamics::gather`].
    #[inline(always)]
    fn core(&self) -> Option<Core> {
        None
    }
    /// Whether the core has sums and differences for the states of its two wheels, which are alike.
    #[inline(always)]
    fn is_paired(&self) -> bool {
        false
    }
    /// Writes what a held input comes to for the core: what its rates and [`Dynamics::gather`] take in
    /// place of the input.
    #[inline(always)]
    fn core_input(&self, _u: &[T], _held: &mut [T; CORE_INPUT]) {}
    /// Writes the summed states of the core, of a state, into a stage.
    #[inline(always)]
    fn core_enter(&self, core: Core, x: &[T], stage: &mut [T]) {
        for k in core.summed.0..core.summed.1 {
            stage[k] = x[k];
        }
    }
    /// Writes them back.
    #[inline(always)]
    fn core_leave(&self, core: Core, stage: &[T], x: &mut [T]) {
        for k in core.summed.0..core.summed.1 {
            x[k] = stage[k];
        }
    }
    /// Rates of the summed states of the core, and of all angles: heading, wheels, casters. Gives the
    /// lanes in which a limit was met.
    #[inline(always)]
    fn core_rates(&self, _x: &[T], _held: &[T], _rates: &mut [T]) -> T::Mask {
        unreachable!("there is no core")
    }
    /// The same for the angles, and of the rates of the summed states what is not linear in these,
    /// but for a constant.
    #[inline(always)]
    fn core_rest(&self, _x: &[T], _held: &[T], _rest: &mut [T]) -> T::Mask {
        unreachable!("there is no core")
    }
    /// Rates of the wheels' angles alone.
    #[inline(always)]
    fn core_spins(&self, _x: &[T], _rates: &mut [T]) {
        unreachable!("there is no core")
    }
    /// Adds to the states beyond the core what their rates come to over a step, and renews the
    /// redundant ones: what [`Dynamics::settle`] does where there is no core. `limited` are the lanes
    /// in which a limit was met.
    #[inline(always)]
    fn gather(&self, _nodes: &Nodes<'_, T>, _held: &[T], _limited: T::Mask, _x: &mut [T]) {
        unreachable!("there is no core")
    }
    /// States for which a tolerance makes no sense because they repeat others or only keep books.
    fn is_derived(&self, _index: usize) -> bool {
        false
    }
}

/// Length of what an input comes to for a core.
pub const CORE_INPUT: usize = 12;

/// Where the core of a state lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Core {
    /// The states that stages are summed for, as a range [from, to).
    pub summed: (usize, usize),
    /// The angles of the wheels of which rates are given, likewise.
    pub spins: (usize, usize),
    /// The angles whose cosine and sine, which stand behind them, are read by the rates: the first one
    /// apart, and those from an index on.
    pub angles: (usize, usize),
    /// How many the latter are.
    pub swivels: usize,
    /// Whether the rates read the first one.
    pub turns: bool,
}

impl Core {
    /// Which of the angles are read, by their indices.
    #[inline(always)]
    pub fn read(&self) -> core::ops::RangeInclusive<usize> {
        usize::from(!self.turns)..=self.swivels
    }

    /// Index of an angle, of which there are 1 + [`Core::swivels`].
    #[inline(always)]
    pub fn angle(&self, index: usize) -> usize {
        if index == 0 {
            self.angles.0
        } else {
            self.angles.1 + 3 * (index - 1)
        }
    }
}

/// The core at three nodes of a symmetric quadrature over a step: where f is a product of two states
/// its integral is `weight` (f(first) + f(middle) + f(last)), and where it is one state `weight`
/// (first + `share` middle + last), for the state in the middle is given `share` times as large.
pub struct Nodes<'a, T> {
    /// States at the first node, at the middle one times `share`, and at the last.
    pub states: [&'a [T]; 3],
    /// Rates of the wheels' angles, likewise.
    pub rates: [&'a [T]; 3],
    /// Whether `share` is two, of Simpson's rule: then no product is needed.
    pub is_simpson: bool,
    /// Root of the ratio of the weights of the middle node and an outer one.
    pub share: T,
    /// Weight of an outer node, s.
    pub weight: T,
}

impl<T: Scalar> Nodes<'_, T> {
    /// A state at each of them.
    #[inline(always)]
    pub fn state(&self, index: usize) -> [T; 3] {
        let [first, middle, last] = self.states;
        [first[index], middle[index], last[index]]
    }

    /// The rate of an angle at each of them.
    #[inline(always)]
    pub fn rate(&self, index: usize) -> [T; 3] {
        let [first, middle, last] = self.rates;
        [first[index], middle[index], last[index]]
    }

    /// Integral of what is linear in the states, over `weight`.
    #[inline(always)]
    pub fn sum(&self, a: [T; 3]) -> T {
        let outer = a[0] + a[2];
        if self.is_simpson {
            outer + (a[1] + a[1])
        } else {
            self.share.mul_add(a[1], outer)
        }
    }
}

/// Integral of a product over `weight` of [`Nodes`].
#[inline(always)]
pub fn product<T: Scalar>(a: [T; 3], b: [T; 3]) -> T {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// What is done with a system whose type the caller does not know.
pub trait Work<T: Scalar> {
    /// What comes of it.
    type Output;
    /// Whether it is work of its own for platforms with motors alone.
    const FOR_MOTORS: bool = false;
    /// Does it. N is the length of the state and Z that of the linear part, or both are 0 where
    /// only run time knows them.
    fn run<const N: usize, const Z: usize, S: Dynamics<T>>(self, system: &S) -> Self::Output;
}

/// An input as a function of time.
pub trait Input<T: Scalar> {
    /// Its value, if it is the same at all times.
    #[inline(always)]
    fn held(&self) -> Option<&[T]> {
        None
    }
    /// Writes the input at `t`, s, into `u`.
    fn at(&self, t: f64, u: &mut [T]);
}

/// An input that is held.
pub struct Held<'a, T>(pub &'a [T]);

impl<T: Scalar> Input<T> for Held<'_, T> {
    #[inline(always)]
    fn held(&self) -> Option<&[T]> {
        Some(self.0)
    }
    #[inline(always)]
    fn at(&self, _t: f64, u: &mut [T]) {
        for k in 0..self.0.len() {
            u[k] = self.0[k];
        }
    }
}
