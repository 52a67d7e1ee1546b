//! The messages between Appell and a plug-in in another process, version 1.
//!
//! Over a pipe goes one request at a time, and for each one answer. A message is a head of eight bytes, the
//! length of the body as `u32`, the kind as `u16` and the number of the request as `u16`, which its answer
//! repeats; and the body. Whole numbers and `f64` are little-endian; texts are UTF-8; what is marked JSON is
//! one object.
//!
//! | kind | request | body | answer |
//! | --- | --- | --- | --- |
//! | 1 | describe | JSON `protocol` | JSON: a [`Descriptor`](crate::Descriptor) |
//! | 2 | create | JSON `member`, `parameters` (name to value), `context` | nothing |
//! | 3 | step | `u32` count; then for each member `u32` member, `u32` zero, `f64` t, `f64` dt, `f64` per input | for each member `u32` 0, `u32` zero, `f64` per output; or `u32` 1, `u32` length, text |
//! | 4 | destroy | `u32` member | nothing |
//! | 5 | save | `u32` member | bytes of its own making |
//! | 6 | restore | `u32` member, those bytes | nothing |
//! | 7 | take over | `u32` member, `u32` zero, `f64` per output | nothing |
//!
//! The answer has the kind of its request plus 100, or kind 200 with a text that says why not. A plug-in ends
//! when its input does.
//!
//! A description's request may offer memory, as `shared` with `file` and `spin`, s, to a child that Appell
//! itself provides; others pass it over. Steps then go through either.

use std::io;

/// Version of the messages.
pub const PROTOCOL: u32 = 1;

/// Longest body of a message, bytes: more is refused before it is read.
pub const BODY_MAX: usize = 1 << 24;

/// Kinds of requests.
pub mod kind {
    /// What are you?
    pub const DESCRIBE: u16 = 1;
    /// Make a member.
    pub const CREATE: u16 = 2;
    /// Make a step.
    pub const STEP: u16 = 3;
    /// End a member.
    pub const DESTROY: u16 = 4;
    /// What does a member remember?
    pub const SAVE: u16 = 5;
    /// Remember this.
    pub const RESTORE: u16 = 6;
    /// Take over from another.
    pub const TAKE_OVER: u16 = 7;
    /// What an answer's kind is more than its request's.
    pub const ANSWER: u16 = 100;
    /// The answer that it cannot be done.
    pub const REFUSED: u16 = 200;
}

/// One member's part of a step.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a> {
    /// The member.
    pub member: u32,
    /// Time, s.
    pub t: f64,
    /// Length of the step, s.
    pub dt: f64,
    /// Its inputs.
    pub input: &'a [f64],
}

/// What a message is: its kind, and the number of its request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tag {
    /// Kind.
    pub kind: u16,
    /// Number.
    pub number: u16,
}

/// Begins a message in `bytes`, whose body is written behind; [`close`] ends it.
pub fn open(bytes: &mut Vec<u8>, tag: Tag) {
    bytes.clear();
    bytes.extend_from_slice(&[0; 4]);
    bytes.extend_from_slice(&tag.kind.to_le_bytes());
    bytes.extend_from_slice(&tag.number.to_le_bytes());
}

/// Writes the length of the body into the head.
pub fn close(bytes: &mut [u8]) {
    let length = (bytes.len() - HEAD) as u32;
    bytes[..4].copy_from_slice(&length.to_le_bytes());
}

/// Length of a head, bytes.
pub const HEAD: usize = 8;

/// Length of the body, and what the message is.
pub fn head(bytes: [u8; HEAD]) -> (usize, Tag) {
    let [a, b, c, d, e, f, g, h] = bytes;
    let tag = Tag {
        kind: u16::from_le_bytes([e, f]),
        number: u16::from_le_bytes([g, h]),
    };
    (u32::from_le_bytes([a, b, c, d]) as usize, tag)
}

/// Writes the body of a step.
pub fn put_step(bytes: &mut Vec<u8>, calls: &[Call<'_>]) {
    bytes.extend_from_slice(&(calls.len() as u32).to_le_bytes());
    for call in calls {
        bytes.extend_from_slice(&call.member.to_le_bytes());
        bytes.extend_from_slice(&[0; 4]);
        for number in [call.t, call.dt].iter().chain(call.input) {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
    }
}

/// Reads the answer to a step of `count` members with `width` outputs each into `results`.
///
/// # Errors
/// A member failed: its place and what it says; or the answer has another shape.
pub fn take_step(
    mut body: &[u8],
    count: usize,
    width: usize,
    results: &mut Vec<f64>,
) -> Result<(), (usize, String)> {
    let malformed = |k: usize, problem: &str| (k, format!("answered with {problem}"));
    for k in 0..count {
        let short = || malformed(k, "too few bytes");
        let (head, rest) = body.split_first_chunk::<HEAD>().ok_or_else(short)?;
        let [a, b, c, d, ..] = *head;
        let status = u32::from_le_bytes([a, b, c, d]);
        let length = u32::from_le_bytes([head[4], head[5], head[6], head[7]]) as usize;
        match status {
            0 => {
                let numbers = rest.get(..8 * width).ok_or_else(short)?;
                let values = numbers.as_chunks::<8>().0.iter();
                results.extend(values.map(|bytes| f64::from_le_bytes(*bytes)));
                body = &rest[8 * width..];
            }
            1 => {
                let text = rest.get(..length).ok_or_else(short)?;
                return Err((k, String::from_utf8_lossy(text).into_owned()));
            }
            _ => return Err(malformed(k, "neither outputs nor a reason")),
        }
    }
    if !body.is_empty() {
        return Err(malformed(0, "too many bytes"));
    }
    Ok(())
}

/// Reads a head; `None` at the end of the stream.
///
/// # Errors
/// The stream breaks off within it, or cannot be read.
pub fn read_head(read: &mut dyn io::Read) -> io::Result<Option<(usize, Tag)>> {
    let mut bytes = [0; HEAD];
    let mut got = 0;
    while got < HEAD {
        match read.read(&mut bytes[got..]) {
            Ok(0) if got == 0 => return Ok(None),
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => got += n,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(Some(head(bytes)))
}
