//! The records of MCAP (<https://mcap.dev/spec>), written to and taken from byte slices.
//!
//! Written here rather than taken from the crate `mcap` 0.26: its reader slices a damaged
//! attachment out of bounds, and its writer knows no zstd level below 1 and writes a chunk in
//! pieces. That crate reads our files in the tests.

use std::ops::Range;

pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Opcodes.
pub(super) mod op {
    pub(in super::super) const HEADER: u8 = 0x01;
    pub(in super::super) const FOOTER: u8 = 0x02;
    pub(in super::super) const SCHEMA: u8 = 0x03;
    pub(in super::super) const CHANNEL: u8 = 0x04;
    pub(in super::super) const MESSAGE: u8 = 0x05;
    pub(in super::super) const CHUNK: u8 = 0x06;
    pub(in super::super) const MESSAGE_INDEX: u8 = 0x07;
    pub(in super::super) const CHUNK_INDEX: u8 = 0x08;
    pub(in super::super) const STATISTICS: u8 = 0x0b;
    pub(in super::super) const METADATA: u8 = 0x0c;
    pub(in super::super) const METADATA_INDEX: u8 = 0x0d;
    pub(in super::super) const SUMMARY_OFFSET: u8 = 0x0e;
    pub(in super::super) const DATA_END: u8 = 0x0f;
}

/// Bytes before the body of a record: opcode and length.
pub(super) const PREFIX: usize = 9;

/// Bytes of a footer record.
pub(super) const FOOTER: usize = PREFIX + 20;

/// Appends a record whose body `body` writes; gives its place.
pub(super) fn record(
    out: &mut Vec<u8>,
    opcode: u8,
    body: impl FnOnce(&mut Vec<u8>),
) -> Range<usize> {
    let start = out.len();
    out.push(opcode);
    out.extend_from_slice(&[0; 8]);
    body(out);
    let length = (out.len() - start - PREFIX) as u64;
    out[start + 1..start + PREFIX].copy_from_slice(&length.to_le_bytes());
    start..out.len()
}

/// Fields of a record's body.
pub(super) trait Put {
    fn u16(&mut self, value: u16);
    fn u32(&mut self, value: u32);
    fn u64(&mut self, value: u64);
    /// Bytes after their length.
    fn blob(&mut self, value: &[u8]);
    /// A map from text to text.
    fn map<'a>(&mut self, pairs: impl IntoIterator<Item = (&'a str, &'a str)>);
}

impl Put for Vec<u8> {
    fn u16(&mut self, value: u16) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn blob(&mut self, value: &[u8]) {
        self.u32(value.len() as u32);
        self.extend_from_slice(value);
    }

    fn map<'a>(&mut self, pairs: impl IntoIterator<Item = (&'a str, &'a str)>) {
        let start = self.len();
        self.u32(0);
        for (key, value) in pairs {
            self.blob(key.as_bytes());
            self.blob(value.as_bytes());
        }
        let length = (self.len() - start - 4) as u32;
        self[start..start + 4].copy_from_slice(&length.to_le_bytes());
    }
}

/// Bytes not yet taken; each method takes from the front, or gives nothing when they are too few.
#[derive(Clone, Copy)]
pub(super) struct Take<'a>(pub(super) &'a [u8]);

impl<'a> Take<'a> {
    pub(super) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(count)?;
        self.0 = tail;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, tail) = self.0.split_first_chunk()?;
        self.0 = tail;
        Some(*head)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes after their 32-bit length.
    pub(super) fn blob(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.bytes(length as usize)
    }

    pub(super) fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.blob()?).ok()
    }

    /// The pairs of a map from text to text.
    pub(super) fn map(&mut self) -> Option<Vec<(&'a str, &'a str)>> {
        let mut inner = Take(self.blob()?);
        let mut pairs = Vec::new();
        while !inner.0.is_empty() {
            pairs.push((inner.text()?, inner.text()?));
        }
        Some(pairs)
    }

    /// Opcode and body of a record.
    pub(super) fn record(&mut self) -> Option<(u8, Take<'a>)> {
        let mut rest = *self;
        let [opcode] = rest.array()?;
        let length = usize::try_from(rest.u64()?).ok()?;
        let body = Take(rest.bytes(length)?);
        *self = rest;
        Some((opcode, body))
    }

    /// Nothing is left.
    pub(super) fn end(&self) -> Option<()> {
        self.0.is_empty().then_some(())
    }
}
