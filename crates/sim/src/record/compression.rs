//! Compression of chunks: zstd, or none in a browser, for which its library is not made.

#[cfg(not(target_family = "wasm"))]
pub use zstd::{
    bulk::{Compressor, Decompressor},
    zstd_safe::compress_bound,
};

#[cfg(target_family = "wasm")]
pub use none::{Compressor, Decompressor, compress_bound};

/// How chunks that are written say that they are compressed.
#[cfg(not(target_family = "wasm"))]
pub const NAME: &[u8] = b"zstd";
#[cfg(target_family = "wasm")]
pub const NAME: &[u8] = b"";

/// What leaves bytes as they are, in the words of zstd.
#[cfg(target_family = "wasm")]
mod none {
    use std::io::{Error, Result};
    use std::marker::PhantomData;

    pub struct Compressor<'a>(PhantomData<&'a ()>);

    impl Compressor<'_> {
        pub fn new(_level: i32) -> Result<Self> {
            Ok(Compressor(PhantomData))
        }

        pub fn compress(&mut self, bytes: &[u8]) -> Result<Vec<u8>> {
            Ok(bytes.to_vec())
        }

        pub fn compress_to_buffer(&mut self, bytes: &[u8], into: &mut Vec<u8>) -> Result<usize> {
            into.extend_from_slice(bytes);
            Ok(bytes.len())
        }
    }

    pub fn compress_bound(size: usize) -> usize {
        size
    }

    pub struct Decompressor<'a>(PhantomData<&'a ()>);

    impl Decompressor<'_> {
        pub fn new() -> Result<Self> {
            Ok(Decompressor(PhantomData))
        }

        pub fn decompress(&mut self, _bytes: &[u8], _size: usize) -> Result<Vec<u8>> {
            Err(Error::other("zstd is not read in a browser"))
        }

        pub fn decompress_to_buffer(&mut self, bytes: &[u8], _into: &mut Vec<u8>) -> Result<usize> {
            self.decompress(bytes, 0).map(|bytes| bytes.len())
        }
    }
}
