//! The sizes of platforms that are compiled, and how one of them is found and entered.

use super::{Compiled, core_enter, core_leave};
use crate::dynamics::{CORE_INPUT, Core, Dynamics, Nodes, Sizes, Work};
use crate::lanewise::Lanewise;
use crate::platform::{LEDGER, POSE, YAW, renew_angle, straighten};
use crate::rolling::{Constant, Rolling};
use crate::scalar::Scalar;

/// A [`Rolling`] whose sizes the compiler knows, PLAIN as for [`Compiled::core_rates`], PAIRED where its
/// wheels are alike, BARE as for [`Compiled::paired_gather`].
struct Twin<
    'a,
    T: Scalar,
    const U: usize,
    const W: usize,
    const M: usize,
    const K: usize,
    const PLAIN: bool,
    const PAIRED: bool,
    const BARE: bool,
> {
    rolling: &'a Rolling<T>,
    compiled: &'a Compiled<T, U, W, M, K>,
}

impl<
    T: Scalar,
    const U: usize,
    const W: usize,
    const M: usize,
    const K: usize,
    const PLAIN: bool,
    const PAIRED: bool,
    const BARE: bool,
> Dynamics<T> for Twin<'_, T, U, W, M, K, PLAIN, PAIRED, BARE>
{
    const STIFF: usize = POSE;
    // Heading, velocities and currents; the angles of the casters.
    const READ: [(usize, usize); 2] = [
        (0, POSE + U + M),
        (Compiled::<T, U, W, M, K>::SWIVELS, usize::MAX),
    ];

    fn sizes(&self) -> Sizes {
        self.rolling.sizes()
    }
    #[inline(always)]
    fn derivative(&self, x: &[T], u: &[T], mode: &[T], dx: &mut [T]) {
        if PLAIN {
            // Not asked for: a core has its own rates.
            self.rolling.derivative(x, u, mode, dx);
        } else {
            self.compiled.derivative(self.rolling, x, u, mode, dx);
        }
    }
    fn output(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        self.rolling.output(x, u, mode, y);
    }
    #[inline(always)]
    fn decide(&self, x: &[T], u: &[T], mode: &mut [T]) {
        if !PLAIN {
            self.rolling.decide(x, u, mode);
        }
    }
    #[inline(always)]
    fn settle(&self, x: &mut [T], u: &[T], mode: &mut [T]) {
        renew_angle(x, YAW);
        for k in 0..K {
            renew_angle(x, Compiled::<T, U, W, M, K>::SWIVELS + 3 * k);
        }
        if !PLAIN && self.rolling.any_rubs {
            crate::rolling::come_to_rest(self.rolling, x, u, mode);
        }
    }
    #[inline(always)]
    fn core(&self) -> Option<Core> {
        if M > 0 && (PLAIN || self.rolling.is_gathered) {
            if PAIRED {
                Some(Compiled::<T, U, W, M, K>::paired_core(PLAIN))
            } else {
                Some(Compiled::<T, U, W, M, K>::CORE)
            }
        } else {
            None
        }
    }
    #[inline(always)]
    fn is_paired(&self) -> bool {
        PAIRED
    }
    #[inline(always)]
    fn core_input(&self, u: &[T], held: &mut [T; CORE_INPUT]) {
        self.compiled.core_input(self.rolling, PAIRED, u, held);
    }
    #[inline(always)]
    fn core_enter(&self, core: Core, x: &[T], stage: &mut [T]) {
        core_enter(PAIRED, core, x, stage);
    }
    #[inline(always)]
    fn core_leave(&self, core: Core, stage: &[T], x: &mut [T]) {
        core_leave(PAIRED, core, stage, x);
    }
    #[inline(always)]
    fn core_rates(&self, x: &[T], held: &[T], rates: &mut [T]) -> T::Mask {
        if PAIRED {
            self.compiled
                .paired_rates::<PLAIN>(self.rolling, x, held, rates)
        } else {
            self.compiled
                .core_rates::<PLAIN>(self.rolling, x, held, rates)
        }
    }
    #[inline(always)]
    fn core_rest(&self, x: &[T], held: &[T], rest: &mut [T]) -> T::Mask {
        if PAIRED {
            self.compiled
                .paired_rest::<PLAIN>(self.rolling, x, held, rest)
        } else {
            self.compiled
                .core_rest::<PLAIN>(self.rolling, x, held, rest)
        }
    }
    #[inline(always)]
    fn core_spins(&self, x: &[T], rates: &mut [T]) {
        self.compiled.core_spins(x, rates);
    }
    #[inline(always)]
    fn gather(&self, nodes: &Nodes<'_, T>, held: &[T], limited: T::Mask, x: &mut [T]) {
        if PAIRED {
            self.compiled
                .paired_gather::<PLAIN, BARE>(nodes, held, limited, x);
        } else {
            self.compiled.gather::<PLAIN>(nodes, held, limited, x);
        }
    }
    #[inline(always)]
    fn straighten(&self, stage: &mut [T]) {
        straighten(stage, YAW + 1);
        for k in 0..K {
            straighten(stage, Compiled::<T, U, W, M, K>::SWIVELS + 3 * k + 1);
        }
    }
    fn guards(&self, x: &[T], u: &[T], mode: &[T], g: &mut [T]) {
        self.rolling.guards(x, u, mode, g);
    }
    fn linear_part(&self, mode: &[T], matrix: &mut [T]) -> Option<core::ops::Range<usize>> {
        self.rolling.linear_part(mode, matrix)
    }
    fn is_derived(&self, index: usize) -> bool {
        self.rolling.is_derived(index)
    }
}

/// The sizes that are compiled, by name: U, W, M, K and the length of the state.
macro_rules! shapes {
    ($($name:ident: $u:literal, $w:literal, $m:literal, $k:literal;)*) => {
        /// A platform of one of the compiled sizes.
        #[derive(Clone, Debug)]
        pub(in crate::rolling) enum Shape<T> {
            $(#[doc(hidden)] $name(Box<Compiled<T, $u, $w, $m, $k>>),)*
        }

        impl<T: Scalar> Lanewise for Shape<T> {
            type One = Shape<f64>;

            fn fits(&self, one: &Shape<f64>) -> bool {
                match (self, one) {
                    $((Shape::$name(_), Shape::$name(_)) => true,)*
                    _ => false,
                }
            }

            fn put(&mut self, lane: usize, one: &Shape<f64>) {
                match (self, one) {
                    $((Shape::$name(a), Shape::$name(b)) => a.put(lane, b),)*
                    _ => {}
                }
            }
        }

        impl<T: Scalar> Shape<T> {
            /// `None` for all other sizes.
            pub(in crate::rolling) fn new(rolling: &Rolling<T>, constant: &Constant<T>) -> Option<Self> {
                $(if let Some(compiled) = Compiled::new(rolling, constant) {
                    return Some(Shape::$name(compiled));
                })*
                None
            }

            /// See [`Dynamics::core`], where all wheels have motors.
            pub(in crate::rolling) fn core(&self, is_paired: bool) -> Option<Core> {
                match self {
                    $(Shape::$name(_) => match ($m, is_paired) {
                        (0, _) => None,
                        (_, false) => Some(Compiled::<T, $u, $w, $m, $k>::CORE),
                        (_, true) => Some(Compiled::<T, $u, $w, $m, $k>::paired_core(false)),
                    },)*
                }
            }

            /// Whether its two driven wheels are alike.
            pub(in crate::rolling) fn pairs(&self) -> bool {
                match self {
                    $(Shape::$name(compiled) => compiled.pair.is_some(),)*
                }
            }

            #[inline(always)]
            pub(in crate::rolling) fn core_input(
                &self,
                rolling: &Rolling<T>,
                u: &[T],
                held: &mut [T; CORE_INPUT],
            ) {
                match self {
                    $(Shape::$name(compiled) => {
                        compiled.core_input(rolling, rolling.is_paired, u, held);
                    })*
                }
            }

            #[inline(always)]
            fn core_rates(&self, rolling: &Rolling<T>, x: &[T], held: &[T], rates: &mut [T]) -> T::Mask {
                match self {
                    $(Shape::$name(compiled) => if const { $w == 2 && $m == 2 } && rolling.is_paired {
                        compiled.paired_rates::<false>(rolling, x, held, rates)
                    } else {
                        compiled.core_rates::<false>(rolling, x, held, rates)
                    })*
                }
            }

            #[inline(always)]
            fn core_rest(&self, rolling: &Rolling<T>, x: &[T], held: &[T], rest: &mut [T]) -> T::Mask {
                match self {
                    $(Shape::$name(compiled) => if const { $w == 2 && $m == 2 } && rolling.is_paired {
                        compiled.paired_rest::<false>(rolling, x, held, rest)
                    } else {
                        compiled.core_rest::<false>(rolling, x, held, rest)
                    })*
                }
            }

            #[inline(always)]
            pub(in crate::rolling) fn core_spins(&self, x: &[T], rates: &mut [T]) {
                match self {
                    $(Shape::$name(compiled) => compiled.core_spins(x, rates),)*
                }
            }

            #[inline(always)]
            fn gather(
                &self,
                rolling: &Rolling<T>,
                nodes: &Nodes<'_, T>,
                held: &[T],
                limited: T::Mask,
                x: &mut [T],
            ) {
                match self {
                    $(Shape::$name(compiled) => if const { $w == 2 && $m == 2 } && rolling.is_paired {
                        compiled.paired_gather::<false, false>(nodes, held, limited, x)
                    } else {
                        compiled.gather::<false>(nodes, held, limited, x)
                    })*
                }
            }

            /// The motion, as for [`Self::output`].
            #[inline(always)]
            fn motion(&self, rolling: &Rolling<T>, x: &[T], y: &mut [T]) {
                match self {
                    $(Shape::$name(compiled) => compiled.motion_output(rolling, x, y),)*
                }
            }

            /// The outputs, of a platform without dry friction that can hold a wheel.
            #[inline(always)]
            fn output(&self, rolling: &Rolling<T>, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
                match self {
                    $(Shape::$name(compiled) => compiled.output(rolling, x, u, mode, y),)*
                }
            }

            /// The derivative, where the caller does not know the sizes.
            #[inline(always)]
            fn derivative(
                &self,
                rolling: &Rolling<T>,
                x: &[T],
                u: &[T],
                mode: &[T],
                dx: &mut [T],
            ) {
                match self {
                    $(Shape::$name(compiled) => {
                        compiled.derivative(rolling, x, u, mode, dx)
                    })*
                }
            }

            /// Works on the twin of `rolling` under an input.
            #[inline(always)]
            pub(in crate::rolling) fn work<J: Work<T>>(
                &self,
                rolling: &Rolling<T>,
                u: &[T],
                job: J,
            ) -> J::Output {
                let plain = rolling.is_plain(u);
                match self {
                    // A twin for motors is worth its size twice, one for torques once; of many lanes
                    // those with motors alone, for each takes seconds to compile. What a constant
                    // leaves out is not compiled at all.
                    $(Shape::$name(compiled) => if const { $w == 2 && $m == 2 }
                        && plain
                        && rolling.is_paired
                        && rolling.is_bare
                    {
                        let twin = Twin::<_, $u, $w, $m, $k, true, true, true> { rolling, compiled };
                        job.run::<{ POSE + $u + $m + LEDGER + $w + 4 * $k }, { $u + $m }, _>(&twin)
                    } else if const { $w == 2 && $m == 2 } && plain && rolling.is_paired {
                        let twin = Twin::<_, $u, $w, $m, $k, true, true, false> { rolling, compiled };
                        job.run::<{ POSE + $u + $m + LEDGER + $w + 4 * $k }, { $u + $m }, _>(&twin)
                    } else if $m > 0 && plain {
                        let twin = Twin::<_, $u, $w, $m, $k, true, false, false> { rolling, compiled };
                        job.run::<{ POSE + $u + $m + LEDGER + $w + 4 * $k }, { $u + $m }, _>(&twin)
                    } else if const { T::LANES > 1 || ($m == 0 && J::FOR_MOTORS) } {
                        job.run::<0, 0, _>(rolling)
                    } else if const { $w == 2 && $m == 2 } && rolling.is_paired {
                        let twin = Twin::<_, $u, $w, $m, $k, false, true, false> { rolling, compiled };
                        job.run::<{ POSE + $u + $m + LEDGER + $w + 4 * $k }, { $u + $m }, _>(&twin)
                    } else {
                        let twin = Twin::<_, $u, $w, $m, $k, false, false, false> { rolling, compiled };
                        job.run::<{ POSE + $u + $m + LEDGER + $w + 4 * $k }, { $u + $m }, _>(&twin)
                    },)*
                }
            }
        }
    };
}

fused! {
    /// See [`Shape::derivative`].
    pub(in crate::rolling) fn derivative<T: Scalar>(
        shape: &Shape<T>,
        rolling: &Rolling<T>,
        x: &[T],
        u: &[T],
        mode: &[T],
        dx: &mut [T],
    ) {
        shape.derivative(rolling, x, u, mode, dx);
    }
}

fused! {
    /// See [`Dynamics::core_rates`].
    pub(in crate::rolling) fn core_rates<T: Scalar>(
        shape: &Shape<T>,
        rolling: &Rolling<T>,
        x: &[T],
        held: &[T],
        rates: &mut [T],
    ) -> T::Mask {
        shape.core_rates(rolling, x, held, rates)
    }
}

fused! {
    /// See [`Dynamics::core_rest`].
    pub(in crate::rolling) fn core_rest<T: Scalar>(
        shape: &Shape<T>,
        rolling: &Rolling<T>,
        x: &[T],
        held: &[T],
        rest: &mut [T],
    ) -> T::Mask {
        shape.core_rest(rolling, x, held, rest)
    }
}

fused! {
    /// See [`Dynamics::gather`].
    pub(in crate::rolling) fn gather<T: Scalar>(
        shape: &Shape<T>,
        rolling: &Rolling<T>,
        nodes: &Nodes<'_, T>,
        held: &[T],
        limited: T::Mask,
        x: &mut [T],
    ) {
        shape.gather(rolling, nodes, held, limited, x);
    }
}

fused! {
    /// See [`Shape::motion`].
    pub(in crate::rolling) fn motion<T: Scalar>(
        shape: &Shape<T>,
        rolling: &Rolling<T>,
        x: &[T],
        y: &mut [T],
    ) {
        shape.motion(rolling, x, y);
    }
}

fused! {
    /// See [`Shape::output`].
    pub(in crate::rolling) fn output<T: Scalar>(
        shape: &Shape<T>,
        rolling: &Rolling<T>,
        x: &[T],
        u: &[T],
        mode: &[T],
        y: &mut [T],
    ) {
        shape.output(rolling, x, u, mode, y);
    }
}

// Two driven wheels on an axle with up to two casters, as torque or motor drives; four mecanum wheels
// with motors.
shapes! {
    Axle: 2, 2, 0, 0;
    AxleCaster: 2, 2, 0, 1;
    AxleCasters: 2, 2, 0, 2;
    Motors: 2, 2, 2, 0;
    MotorsCaster: 2, 2, 2, 1;
    MotorsCasters: 2, 2, 2, 2;
    Mecanum: 3, 4, 4, 0;
}
