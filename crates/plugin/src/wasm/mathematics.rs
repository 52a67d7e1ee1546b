//! Mathematics that modules may import, with the same bits everywhere.

// Names that a page finds for modules cannot be had without it.
#![cfg_attr(target_family = "wasm", allow(unsafe_code))]

/// Functions of one number by their names, and of two.
pub(super) type One = extern "C" fn(f64) -> f64;
pub(super) type Two = extern "C" fn(f64, f64) -> f64;

/// One pattern of bits for all that is not a number.
fn same(x: f64) -> f64 {
    if x.is_nan() { f64::NAN } else { x }
}

/// A list of functions. In a page they are exported as well: the page hands them to modules.
macro_rules! functions {
    ($list:ident: $kind:ty, $parameters:tt, $($name:ident)*) => {
        pub(super) const $list: &[(&str, $kind)] = &[$((stringify!($name), $name)),*];
        $(functions!(@ $name $parameters);)*
    };
    (@ $name:ident ($($x:ident)*)) => {
        #[cfg_attr(
            target_family = "wasm",
            unsafe(export_name = concat!("appell_math_", stringify!($name)))
        )]
        extern "C" fn $name($($x: f64),*) -> f64 {
            same(libm::$name($($x),*))
        }
    };
}

functions!(OF_ONE: One, (x), sin cos tan asin acos atan exp log);
functions!(OF_TWO: Two, (x y), atan2 pow hypot fmod remainder);
