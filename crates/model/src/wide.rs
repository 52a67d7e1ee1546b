//! The choice of the instruction set: work that is compiled for each, and done by the widest at hand.

#[cfg(target_arch = "x86_64")]
use crate::scalar::Registers;
use crate::scalar::Scalar;

/// Work on numbers of one kind, `#[inline(always)]` with all that it calls: what stays a call is
/// compiled without the instruction set that the work was entered with.
pub trait Job: Sized {
    /// What comes of it.
    type Output;
    /// Does it.
    fn run(self) -> Self::Output;
    /// Does it on a processor without vectors, where less is worth compiling.
    #[inline(always)]
    fn plain(self) -> Self::Output {
        self.run()
    }
}

/// Whether the processor has these registers.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn has(registers: Registers) -> bool {
    let fused =
        std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
    match registers {
        Registers::Unasked | Registers::Any => true,
        Registers::Avx2 => fused,
        Registers::Avx512 => {
            fused
                && std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512dq")
                && std::arch::is_x86_feature_detected!("avx512vl")
                && std::arch::is_x86_feature_detected!("avx512bw")
        }
    }
}

/// Whether more than the instructions of any processor is at hand for numbers of this kind.
#[inline(always)]
pub(crate) fn is_at_hand<T: Scalar>() -> bool {
    #[cfg(target_arch = "x86_64")]
    return match T::REGISTERS {
        Registers::Unasked => false,
        Registers::Any => has(Registers::Avx2),
        // There are no such numbers elsewhere.
        Registers::Avx2 | Registers::Avx512 => true,
    };
    #[cfg(not(target_arch = "x86_64"))]
    true
}

/// Puts the stack of the function that it is inlined into on cache lines.
///
/// The compiler aligns what it has no register for only where it knows from the start that something
/// on the stack must be aligned; else each such vector straddles two lines, in a store and a load.
#[inline(always)]
pub fn align_stack() {
    #[repr(align(64))]
    struct Line(#[allow(dead_code)] u8);
    let mut line = Line(0);
    core::hint::black_box(&mut line);
}

/// Does a job by the instructions that its numbers are made for. The bits are the same by all of
/// them: every operation rounds by IEEE 754, and `mul_add` is fused everywhere.
#[inline(always)]
pub fn widest<T: Scalar, J: Job>(job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn fused<J: Job>(job: J) -> J::Output {
            align_stack();
            job.run()
        }
        #[target_feature(enable = "avx2,fma,avx512f,avx512dq,avx512vl,avx512bw")]
        fn wide<J: Job>(job: J) -> J::Output {
            align_stack();
            job.run()
        }
        // What a constant leaves out is not compiled at all.
        // SAFETY: numbers in registers exist only where the processor has those, and plain ones go
        // this way only where it has them, too.
        #[allow(unsafe_code)]
        unsafe {
            if const { matches!(T::REGISTERS, Registers::Avx512) } {
                wide(job)
            } else if const { matches!(T::REGISTERS, Registers::Avx2) } {
                fused(job)
            } else if const { matches!(T::REGISTERS, Registers::Unasked) } {
                job.run()
            } else if has(Registers::Avx2) {
                fused(job)
            } else {
                job.plain()
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    job.plain()
}
