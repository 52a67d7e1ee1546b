//! Equations of motion of wheeled mobile robots, written once and generic in the scalar.
//!
//! The same text runs on `f64`, on SIMD [`lanes`] and on [`dual`] numbers. Nothing here reads a
//! file, knows a clock, draws a random number or fails inside an equation: a [`platform::Platform`]
//! is checked when it is built, and after that every function is total.
//!
//! Units are SI throughout (m, kg, s, rad, N, N·m, V, A); frames follow REP-103: x forward, y left,
//! z up, yaw counter-clockwise. Labels such as `[eq:contact-velocity]` name equations of the book.

// Equations name their indices, and in the loops of a step an iterator is a function of its own,
// compiled without the instruction set that the step was entered with: it costs up to tenfold.
#![allow(clippy::needless_range_loop, clippy::manual_memcpy)]

/// A function compiled for each set of registers that its numbers may live in, see [`wide`]. The
/// bits are the same by all, for `mul_add` is fused everywhere.
macro_rules! fused {
    ($(#[$meta:meta])* $vis:vis fn $name:ident <$scalar:ident: Scalar $(, $generic:ident: $bound:path)*>
        ($($arg:ident: $ty:ty),* $(,)?) $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        $vis fn $name <$scalar: Scalar $(, $generic: $bound)*> ($($arg: $ty),*) $(-> $result)? {
            #[inline(always)]
            fn plain <$scalar: Scalar $(, $generic: $bound)*> ($($arg: $ty),*) $(-> $result)? $body
            #[cfg(target_arch = "x86_64")]
            {
                #[inline(never)]
                #[target_feature(enable = "avx2,fma")]
                fn quick <$scalar: Scalar $(, $generic: $bound)*> ($($arg: $ty),*) $(-> $result)? {
                    $crate::wide::align_stack();
                    plain($($arg),*)
                }
                #[inline(never)]
                #[target_feature(enable = "avx2,fma,avx512f,avx512dq,avx512vl,avx512bw")]
                fn wide <$scalar: Scalar $(, $generic: $bound)*> ($($arg: $ty),*) $(-> $result)? {
                    $crate::wide::align_stack();
                    plain($($arg),*)
                }
                use $crate::scalar::Registers;
                // What a constant leaves out is not compiled at all.
                // SAFETY: numbers in registers exist only where the processor has those, and plain
                // ones go this way only where it has them, too.
                #[allow(unsafe_code)]
                unsafe {
                    if const { matches!(<$scalar as Scalar>::REGISTERS, Registers::Avx512) } {
                        wide($($arg),*)
                    } else if const { matches!(<$scalar as Scalar>::REGISTERS, Registers::Avx2) } {
                        quick($($arg),*)
                    } else if const { matches!(<$scalar as Scalar>::REGISTERS, Registers::Unasked) } {
                        plain($($arg),*)
                    } else if $crate::wide::has(Registers::Avx2) {
                        quick($($arg),*)
                    } else {
                        plain($($arg),*)
                    }
                }
            }
            #[cfg(not(target_arch = "x86_64"))]
            plain($($arg),*)
        }
    };
    ($(#[$meta:meta])* $vis:vis fn $name:ident
        ($($arg:ident: $ty:ty),* $(,)?) $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        $vis fn $name ($($arg: $ty),*) $(-> $result)? {
            #[inline(always)]
            fn plain ($($arg: $ty),*) $(-> $result)? $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn quick ($($arg: $ty),*) $(-> $result)? {
                    plain($($arg),*)
                }
                if $crate::wide::has($crate::scalar::Registers::Avx2) {
                    // SAFETY: the features that `quick` is compiled for were found here.
                    #[allow(unsafe_code)]
                    return unsafe { quick($($arg),*) };
                }
            }
            plain($($arg),*)
        }
    };
}

pub mod drive;
pub mod dual;
pub mod dynamics;
pub mod following;
pub mod ground;
pub mod integrate;
pub mod kinematic;
pub mod lanes;
pub mod lanewise;
pub mod math;
pub mod planar;
pub mod platform;
pub mod pose_error;
pub mod rolling;
pub mod scalar;
pub mod single_track;
pub mod slip;
pub mod solve;
pub mod stance;
pub mod support;
pub mod suspension;
pub mod terrain;
pub mod tire;
pub mod trailer;
pub mod wheel;
pub mod wheel_legged;
pub mod wide;
