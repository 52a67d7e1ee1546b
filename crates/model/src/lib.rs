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

/// A function compiled twice: for fused multiply-add in hardware, where the processor has it, and
/// for any processor. The bits are the same, for `mul_add` is fused everywhere.
macro_rules! fused {
    ($(#[$meta:meta])* pub fn $name:ident $(<$($generic:ident: $bound:path),*>)?
        ($($arg:ident: $ty:ty),* $(,)?) $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        pub fn $name $(<$($generic: $bound),*>)? ($($arg: $ty),*) $(-> $result)? {
            #[inline(always)]
            fn plain $(<$($generic: $bound),*>)? ($($arg: $ty),*) $(-> $result)? $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn quick $(<$($generic: $bound),*>)? ($($arg: $ty),*) $(-> $result)? {
                    plain($($arg),*)
                }
                if std::arch::is_x86_feature_detected!("avx2")
                    && std::arch::is_x86_feature_detected!("fma")
                {
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
pub mod ground;
pub mod integrate;
pub mod kinematic;
pub mod lanes;
pub mod math;
pub mod planar;
pub mod platform;
pub mod pose_error;
pub mod rolling;
pub mod scalar;
pub mod solve;
pub mod support;
pub mod trailer;
pub mod wheel;
