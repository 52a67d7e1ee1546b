// SPDX-License-Identifier: MIT OR Apache-2.0
//! Controllers for Appell in Rust: one function over named numbers.
//!
//! ```
//! use appell_sdk::{Now, controller};
//!
//! controller! {
//!     name: "circle",
//!     inputs: { yaw_rate: "twist.yaw_rate" in "rad/s" },
//!     outputs: {
//!         forward: "command.forward" in "m/s" [-1.0, 1.0],
//!         yaw_rate: "command.yaw_rate" in "rad/s",
//!     },
//!     parameters: { speed: 0.5 in "m/s" [0.0, 1.0] "along the circle", radius: 1.0 in "m" },
//!     memory: { forward: f64 = 0.0 },
//!     step: step,
//! }
//!
//! fn step(
//!     now: &Now<Outputs>,
//!     _inputs: &Inputs,
//!     parameters: &Parameters,
//!     memory: &mut Memory,
//! ) -> Result<Outputs, String> {
//!     if let Some(before) = now.before {
//!         memory.forward = before.forward;
//!     }
//!     let change = parameters.speed - memory.forward;
//!     memory.forward += change.clamp(-0.5 * now.dt, 0.5 * now.dt);
//!     Ok(Outputs {
//!         forward: memory.forward,
//!         yaw_rate: memory.forward / parameters.radius,
//!     })
//! }
//! # fn main() {}
//! ```
//!
//! In a crate with `crate-type = ["cdylib"]` the same source makes
//!
//! ```sh
//! cargo build --release --target wasm32-unknown-unknown   # a module of WebAssembly
//! cargo build --release                                   # a library for this machine
//! ```
//!
//! Units are SI, frames those of REP-103. A crate holds one controller, for the functions that Appell calls
//! have fixed names.
//!
//! # Bits
//!
//! `+ - * /` and `sqrt` have the same bits everywhere, and so has all that is compiled into a module. In a
//! native library `f64::sin` and its like are those of the machine: where their last bits matter, take the
//! crate `libm`.
//!
//! # Failure
//!
//! A step that gives `Err` is a fault with that text. A panic in a native library is caught and is a fault,
//! too; in a module it is a trap, and ends the module, and `appell_reason` of no member says where it was.
//! Outputs beyond their limits, or not finite, are refused by Appell.

pub mod border;
mod describe;
mod remember;

pub use describe::{Descriptor, Output, Parameter, Port};
pub use remember::Remember;

/// The instant of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Now<Outputs> {
    /// Time, s.
    pub t: f64,
    /// Length of the step, s.
    pub dt: f64,
    /// What the controller before this one wrote last, at the first step after it took over from that one.
    pub before: Option<Outputs>,
}

/// Makes a function a controller: its types, its description, and all functions that Appell calls.
///
/// The sections come in this order.
///
/// | | |
/// | --- | --- |
/// | `name`, `version`, `about` | texts; the last two may be left out |
/// | `inputs` | `field: "signal" in "unit"` |
/// | `outputs` | `field: "signal" in "unit" [least, largest]`; limits may be left out, or infinite |
/// | `parameters` | `field: default in "unit" [least, largest] "about"`; only the default, a literal, is needed. The section may be left out |
/// | `memory` | `field: Type = first value`: what lasts from step to step, of types that are [`Remember`]. May be left out |
/// | `start` | `fn(context: &str, parameters: &Parameters) -> Result<Memory, String>`, where the first values depend on either; the context is JSON. May be left out |
/// | `step` | `fn(&Now<Outputs>, &Inputs, &Parameters, &mut Memory) -> Result<Outputs, String>` |
///
/// It makes the structs `Inputs`, `Outputs`, `Parameters` and `Memory` with these fields. `Parameters` and
/// `Memory` have their defaults, so that a step can be tested like any other function.
#[macro_export]
macro_rules! controller {
    (
        name: $name:expr,
        $(version: $version:expr,)?
        $(about: $about:expr,)?
        inputs: { $($inputs:tt)* },
        outputs: { $($outputs:tt)* },
        $(parameters: { $($parameters:tt)* },)?
        $(memory: { $($memory:tt)* },)?
        $(start: $start:path,)?
        step: $step:path $(,)?
    ) => {
        $crate::__inputs! { $($inputs)* }
        $crate::__outputs! { $($outputs)* }
        $crate::__parameters! { $($($parameters)*)? }
        $crate::__memory! { $($($memory)*)? }

        const _: () = {
            struct Controller;

            impl $crate::border::Controller for Controller {
                type Inputs = Inputs;
                type Outputs = Outputs;
                type Parameters = Parameters;
                type Memory = Memory;

                const DESCRIPTOR: $crate::Descriptor = $crate::Descriptor {
                    name: $name,
                    version: concat!($($version)?),
                    about: concat!($($about)?),
                    inputs: Inputs::PORTS,
                    outputs: Outputs::PORTS,
                    parameters: Parameters::LIST,
                };

                fn start(
                    context: &str,
                    parameters: &Parameters,
                ) -> ::core::result::Result<Memory, ::std::string::String> {
                    $crate::__start!(context, parameters $(, $start)?)
                }

                #[inline]
                fn step(
                    now: &$crate::Now<Outputs>,
                    inputs: &Inputs,
                    parameters: &Parameters,
                    memory: &mut Memory,
                ) -> ::core::result::Result<Outputs, ::std::string::String> {
                    $step(now, inputs, parameters, memory)
                }
            }

            $crate::__functions! { Controller }
        };
    };
}

/// The functions that Appell calls.
#[doc(hidden)]
#[macro_export]
macro_rules! __functions {
    ($controller:ident) => {
        use ::core::ffi::{c_char, c_void};
        use $crate::border;

        #[unsafe(no_mangle)]
        extern "C" fn appell_abi() -> u32 {
            border::ABI
        }

        #[unsafe(no_mangle)]
        extern "C" fn appell_describe() -> *const c_char {
            static TEXT: ::std::sync::OnceLock<::std::ffi::CString> = ::std::sync::OnceLock::new();
            TEXT.get_or_init(border::describe::<$controller>).as_ptr()
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_create(
            parameters: *const f64,
            context: *const c_char,
        ) -> *mut c_void {
            // SAFETY: what Appell promises is what the border demands, here and below.
            unsafe { border::create::<$controller>(parameters, context) }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_destroy(member: *mut c_void) {
            // SAFETY: as above.
            unsafe { border::destroy::<$controller>(member) }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_step(
            member: *mut c_void,
            t: f64,
            dt: f64,
            inputs: *const f64,
            outputs: *mut f64,
        ) -> i32 {
            // SAFETY: as above.
            unsafe { border::step::<$controller>(member, t, dt, inputs, outputs) }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_reason(member: *mut c_void) -> *const c_char {
            // SAFETY: as above.
            unsafe { border::reason::<$controller>(member) }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_save(
            member: *mut c_void,
            bytes: *mut u8,
            room: usize,
        ) -> usize {
            // SAFETY: as above.
            unsafe { border::save::<$controller>(member, bytes, room) }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_restore(
            member: *mut c_void,
            bytes: *const u8,
            length: usize,
        ) -> i32 {
            // SAFETY: as above.
            unsafe { border::restore::<$controller>(member, bytes, length) }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_take_over(member: *mut c_void, outputs: *const f64) -> i32 {
            // SAFETY: as above.
            unsafe { border::take_over::<$controller>(member, outputs) }
        }

        #[cfg(target_family = "wasm")]
        #[unsafe(no_mangle)]
        unsafe extern "C" fn appell_step_many(
            count: i32,
            members: *const *mut c_void,
            t: *const f64,
            dt: f64,
            inputs: *const f64,
            outputs: *mut f64,
        ) -> i32 {
            // SAFETY: as above.
            unsafe { border::step_many::<$controller>(count, members, t, dt, inputs, outputs) }
        }

        #[cfg(target_family = "wasm")]
        #[unsafe(no_mangle)]
        extern "C" fn appell_room(size: usize) -> *mut u8 {
            border::room(size)
        }
    };
}

/// A member's first memory.
#[doc(hidden)]
#[macro_export]
macro_rules! __start {
    ($context:ident, $parameters:ident) => {{
        let (_, _) = ($context, $parameters);
        ::core::result::Result::Ok(<Memory as ::core::default::Default>::default())
    }};
    ($context:ident, $parameters:ident, $start:path) => {
        $start($context, $parameters)
    };
}

/// The struct `Inputs`.
#[doc(hidden)]
#[macro_export]
macro_rules! __inputs {
    ($($(#[$meta:meta])* $field:ident : $path:literal in $unit:literal),* $(,)?) => {
        /// What a step reads.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct Inputs {
            $($(#[$meta])* #[doc = concat!("`", $path, "`, ", $unit)] pub $field: f64,)*
        }

        impl Inputs {
            /// Signals that are read.
            pub const PORTS: &'static [$crate::Port] =
                &[$($crate::Port { name: $path, unit: $unit }),*];
        }

        $crate::__numbers! { Inputs { $($field)* } }
    };
}

/// The struct `Outputs`.
#[doc(hidden)]
#[macro_export]
macro_rules! __outputs {
    ($(
        $(#[$meta:meta])*
        $field:ident : $path:literal in $unit:literal $([$min:expr, $max:expr])?
    ),* $(,)?) => {
        /// What a step writes.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct Outputs {
            $($(#[$meta])* #[doc = concat!("`", $path, "`, ", $unit)] pub $field: f64,)*
        }

        impl Outputs {
            /// Signals that are written.
            pub const PORTS: &'static [$crate::Output] = &[$($crate::Output {
                $(min: $min as f64, max: $max as f64,)?
                ..$crate::Output::new($path, $unit)
            }),*];
        }

        $crate::__numbers! { Outputs { $($field)* } }
    };
}

/// The struct `Parameters`.
#[doc(hidden)]
#[macro_export]
macro_rules! __parameters {
    ($(
        $(#[$meta:meta])*
        $field:ident : $default:literal $(in $unit:literal)? $([$min:expr, $max:expr])?
        $($about:literal)?
    ),* $(,)?) => {
        /// What a scenario can set.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Parameters {
            $($(#[$meta])* #[doc = concat!($("in ", $unit, ". ",)? $($about)?)] pub $field: f64,)*
        }

        impl Parameters {
            /// What can be set.
            pub const LIST: &'static [$crate::Parameter] = &[$($crate::Parameter {
                unit: concat!($($unit)?),
                $(min: $min as f64, max: $max as f64,)?
                about: concat!($($about)?),
                ..$crate::Parameter::new(stringify!($field), $default as f64)
            }),*];
        }

        impl ::core::default::Default for Parameters {
            fn default() -> Self {
                Self { $($field: $default as f64),* }
            }
        }

        $crate::__numbers! { Parameters { $($field)* } }
    };
}

/// The struct `Memory`.
#[doc(hidden)]
#[macro_export]
macro_rules! __memory {
    ($($(#[$meta:meta])* $field:ident : $type:ty = $first:expr),* $(,)?) => {
        /// What lasts from step to step.
        #[derive(Clone, Debug)]
        pub struct Memory {
            $($(#[$meta])* #[doc = concat!("First `", stringify!($first), "`.")] pub $field: $type,)*
        }

        impl ::core::default::Default for Memory {
            fn default() -> Self {
                Self { $($field: $first),* }
            }
        }

        $crate::remember! { Memory { $($field),* } }
    };
}

/// Reads and writes a struct of numbers in the order of its fields.
#[doc(hidden)]
#[macro_export]
macro_rules! __numbers {
    ($struct:ident { $($field:ident)* }) => {
        impl $crate::border::Numbers for $struct {
            const COUNT: usize = {
                let names: &[&str] = &[$(stringify!($field)),*];
                names.len()
            };

            #[inline]
            #[allow(unused_mut, unused_variables)]
            fn read(mut next: impl FnMut() -> f64) -> Self {
                Self { $($field: next()),* }
            }

            #[inline]
            #[allow(unused_mut, unused_variables)]
            fn write(&self, mut put: impl FnMut(f64)) {
                $(put(self.$field);)*
            }
        }
    };
}
