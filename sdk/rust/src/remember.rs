// SPDX-License-Identifier: MIT OR Apache-2.0
//! Memory as bytes, little-endian, the same on every machine.

/// What can be saved and restored.
///
/// Numbers, `bool`, arrays, tuples of up to four, `Option`, `Vec` and `String` can; a struct of them can by
/// [`remember!`](crate::remember).
pub trait Remember: Sized {
    /// Appends its bytes.
    fn to_bytes(&self, bytes: &mut Vec<u8>);

    /// Takes as many bytes as it appended; none if they are not of its making.
    fn from_bytes(bytes: &mut &[u8]) -> Option<Self>;
}

/// Makes a struct [`Remember`], by its fields.
///
/// ```
/// #[derive(Clone, Debug)]
/// struct Filter {
///     mean: f64,
///     count: u64,
/// }
///
/// appell_sdk::remember!(Filter { mean, count });
/// ```
#[macro_export]
macro_rules! remember {
    ($struct:ident { $($field:ident),* $(,)? }) => {
        impl $crate::Remember for $struct {
            #[allow(unused_variables)]
            fn to_bytes(&self, bytes: &mut ::std::vec::Vec<u8>) {
                $($crate::Remember::to_bytes(&self.$field, bytes);)*
            }

            #[allow(unused_variables)]
            fn from_bytes(bytes: &mut &[u8]) -> ::core::option::Option<Self> {
                ::core::option::Option::Some(Self {
                    $($field: $crate::Remember::from_bytes(bytes)?),*
                })
            }
        }
    };
}

macro_rules! numbers {
    ($($type:ty)*) => {$(
        impl Remember for $type {
            fn to_bytes(&self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }

            fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
                let (own, rest) = bytes.split_first_chunk()?;
                *bytes = rest;
                Some(Self::from_le_bytes(*own))
            }
        }
    )*};
}

numbers! { f32 f64 u8 u16 u32 u64 i8 i16 i32 i64 }

/// As `u64`: a module and a library have different words.
impl Remember for usize {
    fn to_bytes(&self, bytes: &mut Vec<u8>) {
        (*self as u64).to_bytes(bytes);
    }

    fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
        usize::try_from(u64::from_bytes(bytes)?).ok()
    }
}

impl Remember for bool {
    fn to_bytes(&self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(*self));
    }

    fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
        match u8::from_bytes(bytes)? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

impl<T: Remember> Remember for Option<T> {
    fn to_bytes(&self, bytes: &mut Vec<u8>) {
        self.is_some().to_bytes(bytes);
        if let Some(value) = self {
            value.to_bytes(bytes);
        }
    }

    fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
        match bool::from_bytes(bytes)? {
            true => Some(Some(T::from_bytes(bytes)?)),
            false => Some(None),
        }
    }
}

impl<T: Remember> Remember for Vec<T> {
    fn to_bytes(&self, bytes: &mut Vec<u8>) {
        self.len().to_bytes(bytes);
        self.iter().for_each(|value| value.to_bytes(bytes));
    }

    fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
        let length = usize::from_bytes(bytes)?;
        // The length is not trusted with an allocation: bytes that are missing end it.
        (0..length).map(|_| T::from_bytes(bytes)).collect()
    }
}

impl Remember for String {
    fn to_bytes(&self, bytes: &mut Vec<u8>) {
        self.len().to_bytes(bytes);
        bytes.extend_from_slice(self.as_bytes());
    }

    fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
        String::from_utf8(Vec::from_bytes(bytes)?).ok()
    }
}

impl<T: Remember, const N: usize> Remember for [T; N] {
    fn to_bytes(&self, bytes: &mut Vec<u8>) {
        self.iter().for_each(|value| value.to_bytes(bytes));
    }

    fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
        let values: Option<Vec<T>> = (0..N).map(|_| T::from_bytes(bytes)).collect();
        values?.try_into().ok()
    }
}

macro_rules! tuples {
    ($(($($type:ident $at:tt)*))*) => {$(
        impl<$($type: Remember),*> Remember for ($($type,)*) {
            #[allow(unused_variables)]
            fn to_bytes(&self, bytes: &mut Vec<u8>) {
                $(self.$at.to_bytes(bytes);)*
            }

            #[allow(unused_variables)]
            fn from_bytes(bytes: &mut &[u8]) -> Option<Self> {
                Some(($($type::from_bytes(bytes)?,)*))
            }
        }
    )*};
}

tuples! { () (A 0) (A 0 B 1) (A 0 B 1 C 2) (A 0 B 1 C 2 D 3) }

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Debug;

    fn comes_back<T: Remember + PartialEq + Debug>(value: T, length: usize) {
        let mut bytes = Vec::new();
        value.to_bytes(&mut bytes);
        assert_eq!(bytes.len(), length, "{value:?}");
        let mut rest = bytes.as_slice();
        assert_eq!(T::from_bytes(&mut rest).as_ref(), Some(&value));
        assert!(rest.is_empty());
        let short = bytes.len().saturating_sub(1);
        if length > 0 {
            assert_eq!(T::from_bytes(&mut &bytes[..short]), None, "{value:?}");
        }
    }

    #[test]
    fn invariant_what_is_saved_comes_back() {
        comes_back(-0.1, 8);
        comes_back([1.0, f64::INFINITY, -0.0], 24);
        comes_back((7_u64, -7_i64, true, 3_usize), 25);
        comes_back((), 0);
        comes_back(None::<f64>, 1);
        comes_back(Some((2.0, 3_u8)), 10);
        comes_back(vec![[1.0, 2.0], [3.0, 4.0]], 40);
        comes_back(String::from("west → east"), 8 + 13);
    }

    #[test]
    fn closed_form_bytes_are_little_endian() {
        let mut bytes = Vec::new();
        (1_u64, 1.0).to_bytes(&mut bytes);
        assert_eq!(
            bytes,
            [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f]
        );
    }

    #[test]
    fn invariant_foreign_bytes_are_refused() {
        assert_eq!(bool::from_bytes(&mut &[2][..]), None);
        assert_eq!(Vec::<u64>::from_bytes(&mut &[0xff; 16][..]), None);
    }
}
