//! Memory that a process and the child it started both see, for messages that take less time than waking up.
//!
//! It holds one word, whose turn it is, and room for one request and one answer. A message is written before
//! the word is changed, with release, and read after it was seen, with acquire. Each goes one way, through
//! the memory or over the socket, and the word says which:
//!
//! | word | the child | its host |
//! | --- | --- | --- |
//! | `ASLEEP` | reads the socket | sends over it |
//! | `FREE` | waits for the word to change, awake | may ask here; the answer, if one was due, is here |
//! | `ASKED` | reads the request here | waits for the word to change, awake |
//! | `WAITED` | reads the request here, and answers over the socket | reads the socket |
//! | `LONG` | has answered over the socket, for want of room | reads the socket |
//!
//! A child that has answered here may have fallen asleep before the host looks: to a host that has asked,
//! `ASLEEP` says what `FREE` does.
//!
//! Who has waited for long enough turns `FREE` into `ASLEEP`, or `ASKED` into `WAITED`, by an exchange that
//! fails where the other side was faster, and goes on as if there were no such memory: with the time limits
//! of the socket, and its end when the other side ends. Any other value means the socket as well.
//!
//! The other side is not trusted. What it may change at any time are words that are read as atomics, once
//! each; what was copied is checked as if it had come over the socket.

// Foreign calls make and end the mapping, and a slice of atomics stands for it.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::{AcqRel, Acquire, Relaxed, Release};
use std::time::{Duration, Instant};

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

use crate::wire::{self, HEAD, Tag};

/// Whose turn it is. A new mapping is all zeros, so that the child that knows nothing of it sleeps.
const ASLEEP: u64 = 0;
const FREE: u64 = 1;
const ASKED: u64 = 2;
const WAITED: u64 = 3;
const LONG: u64 = 4;

/// Size of the mapping, in words: the word and the messages are on cache lines of their own.
const WORDS: usize = 8192;
const REQUEST: usize = 16;
const ANSWER: usize = WORDS / 2;
/// Longest message, bytes.
pub const ROOM: usize = 8 * (ANSWER - REQUEST);

/// Looks at the word before the clock is asked and others may have the processor.
const LOOKS: u32 = 32;
/// Most messages in a row for which nobody waits awake, once that has been in vain.
const REST_MAX: u32 = 1024;

/// One side's view of the mapping.
#[derive(Debug)]
pub struct Shared {
    start: NonNull<AtomicU64>,
    /// Longest time to wait awake.
    spin: Duration,
    /// Messages for which it will not wait awake, and for how many if it was in vain once more.
    rest: u32,
    next: u32,
}

// SAFETY: the mapping belongs to the process, not to a thread, and is only used through atomics.
unsafe impl Send for Shared {}

/// Where the child finds the mapping, as long as this lives.
#[derive(Debug)]
pub struct Place {
    path: PathBuf,
    #[cfg(any(target_os = "linux", target_os = "android"))]
    _file: std::os::fd::OwnedFd,
    #[cfg(not(any(target_os = "linux", target_os = "android")))]
    _folder: crate::folder::Folder,
}

impl Place {
    /// From the root.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Shared {
    /// Makes a mapping, and a place where the child finds it.
    pub fn new(spin: Duration) -> io::Result<(Shared, Place)> {
        let (file, place) = file()?;
        Ok((Shared::map(file, spin)?, place))
    }

    /// Maps what the host made.
    pub fn open(path: &Path, spin: Duration) -> io::Result<Shared> {
        let file = File::options().read(true).write(true).open(path)?;
        if file.metadata()?.len() != 8 * WORDS as u64 {
            return Err(io::ErrorKind::InvalidData.into());
        }
        Shared::map(file, spin)
    }

    fn map(file: impl AsFd, spin: Duration) -> io::Result<Shared> {
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: the system chooses where; nothing else in this process refers to that memory.
        let start = unsafe {
            mmap(
                std::ptr::null_mut(),
                8 * WORDS,
                access,
                MapFlags::SHARED,
                file,
                0,
            )?
        };
        let start = NonNull::new(start.cast()).ok_or(io::ErrorKind::InvalidData)?;
        Ok(Shared {
            start,
            spin,
            rest: 0,
            next: 1,
        })
    }

    fn words(&self) -> &[AtomicU64] {
        // SAFETY: the mapping is that long, on a page's border, and lives as long as this; the other side
        // changes it, which atomics allow, and cannot shorten it (see `file`).
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), WORDS) }
    }

    fn turn(&self) -> &AtomicU64 {
        &self.words()[0]
    }

    /// Waits awake for the word to change.
    fn wait(&self, from: u64, limit: Duration) -> bool {
        let start = Instant::now();
        loop {
            for _ in 0..LOOKS {
                if self.turn().load(Acquire) != from {
                    return true;
                }
                std::hint::spin_loop();
            }
            if start.elapsed() >= limit {
                return false;
            }
            // The other side may need this very processor.
            std::thread::yield_now();
        }
    }

    fn is_willing(&mut self) -> bool {
        let is_willing = self.rest == 0;
        self.rest = self.rest.saturating_sub(1);
        is_willing
    }

    /// Waits awake the less often, the more often it has been in vain.
    fn learn(&mut self, is_in_vain: bool) {
        self.next = match is_in_vain {
            true => {
                self.rest = self.next;
                REST_MAX.min(2 * self.next)
            }
            false => 1,
        };
    }

    fn put(&self, area: usize, message: &[u8]) {
        let (whole, rest) = message.as_chunks::<8>();
        let mut last = [0; 8];
        last[..rest.len()].copy_from_slice(rest);
        let all = whole.iter().chain((!rest.is_empty()).then_some(&last));
        for (word, bytes) in self.words()[area..].iter().zip(all) {
            word.store(u64::from_le_bytes(*bytes), Relaxed);
        }
    }

    /// Copies as many bytes as `body` has, from behind the head.
    fn copy(&self, area: usize, body: &mut [u8]) {
        let words = &self.words()[area + 1..];
        for (bytes, word) in body.chunks_mut(8).zip(words) {
            bytes.copy_from_slice(&word.load(Relaxed).to_le_bytes()[..bytes.len()]);
        }
    }

    fn head(&self, area: usize) -> (usize, Tag) {
        wire::head(self.words()[area].load(Relaxed).to_le_bytes())
    }
}

/// The host's side.
impl Shared {
    /// Asks, where the child is awake; else the message goes over the socket.
    pub fn ask(&mut self, message: &[u8]) -> bool {
        let is_here = message.len() <= ROOM && self.turn().load(Acquire) == FREE;
        if is_here && self.is_willing() {
            self.put(REQUEST, message);
            let asked = self.turn().compare_exchange(FREE, ASKED, AcqRel, Relaxed);
            return asked.is_ok();
        }
        false
    }

    /// Tells a child that is awake that a message comes over the socket.
    pub fn call(&self) {
        let _ = self.turn().compare_exchange(FREE, ASLEEP, AcqRel, Relaxed);
    }

    /// Whether what was asked has been answered here; else the answer comes over the socket, if at all.
    pub fn is_answered(&mut self, end: Instant) -> bool {
        let left = end.saturating_duration_since(Instant::now());
        let has_changed = self.wait(ASKED, self.spin.min(left));
        self.learn(!has_changed);
        let waited = self.turn().compare_exchange(ASKED, WAITED, AcqRel, Acquire);
        matches!(waited, Err(FREE | ASLEEP))
    }

    /// Length of the answer's body, which may be any, and what the answer is.
    pub fn answer_head(&self) -> (usize, Tag) {
        self.head(ANSWER)
    }

    /// Copies the body of the answer.
    pub fn answer_body(&self, body: &mut [u8]) {
        self.copy(ANSWER, body);
    }
}

/// The child's side.
impl Shared {
    /// Whether the next request is here; else it comes over the socket.
    pub fn is_asked(&mut self) -> bool {
        if self.is_willing() {
            let has_changed = self.wait(FREE, self.spin);
            self.learn(!has_changed);
        }
        let slept = self.turn().compare_exchange(FREE, ASLEEP, AcqRel, Acquire);
        matches!(slept, Err(ASKED | WAITED))
    }

    /// Copies the request.
    ///
    /// # Errors
    /// It is longer than its room: something in this process wrote to it.
    pub fn take(&self, body: &mut Vec<u8>) -> io::Result<Tag> {
        let (length, tag) = self.head(REQUEST);
        if length > ROOM - HEAD {
            return Err(io::ErrorKind::InvalidData.into());
        }
        body.resize(length, 0);
        self.copy(REQUEST, body);
        Ok(tag)
    }

    /// Answers, where the host waits for it here; else the message goes over the socket.
    pub fn answer(&self, message: &[u8]) -> bool {
        if message.len() > ROOM {
            self.turn().store(LONG, Release);
            return false;
        }
        if self.turn().load(Acquire) == ASKED {
            self.put(ANSWER, message);
            let answered = self.turn().compare_exchange(ASKED, FREE, AcqRel, Relaxed);
            if answered.is_ok() {
                return true;
            }
        }
        self.turn().store(FREE, Release);
        false
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: made by `map` with this length, and nothing refers to it any more.
        let _ = unsafe { munmap(self.start.as_ptr().cast(), 8 * WORDS) };
    }
}

/// A file without a name, which nobody can shorten: touching what is gone would end the process.
#[cfg(any(target_os = "linux", target_os = "android"))]
fn file() -> io::Result<(std::os::fd::OwnedFd, Place)> {
    use std::os::fd::AsRawFd;

    use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, ftruncate, memfd_create};

    let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
    let file = memfd_create("appell-step", flags)?;
    ftruncate(&file, 8 * WORDS as u64)?;
    fcntl_add_seals(&file, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
    let path = format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd());
    let other = file.try_clone()?;
    let place = Place {
        path: path.into(),
        _file: file,
    };
    Ok((other, place))
}

/// A file in a folder that goes once the child has it open: then only who searches for it can shorten it.
#[cfg(not(any(target_os = "linux", target_os = "android")))]
fn file() -> io::Result<(File, Place)> {
    let folder = crate::folder::Folder::new()?;
    let path = folder.path().join("step");
    let mut options = File::options();
    options.read(true).write(true).create_new(true);
    let file = options.open(&path)?;
    file.set_len(8 * WORDS as u64)?;
    let place = Place {
        path,
        _folder: folder,
    };
    Ok((file, place))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both sides, who wait for as long as said.
    fn pair(spin: Duration) -> (Shared, Shared) {
        let (host, place) = Shared::new(spin).expect("memory");
        let child = Shared::open(place.path(), spin).expect("the same memory");
        (host, child)
    }

    fn message(number: u16, body: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        wire::open(&mut bytes, Tag { kind: 3, number });
        bytes.extend_from_slice(body);
        wire::close(&mut bytes);
        bytes
    }

    fn answer(host: &Shared) -> (u16, Vec<u8>) {
        let (length, tag) = host.answer_head();
        let mut body = vec![0; length];
        host.answer_body(&mut body);
        (tag.number, body)
    }

    /// When to have waited for long enough.
    fn later() -> Instant {
        Instant::now() + Duration::from_secs(60)
    }

    #[test]
    fn invariant_messages_pass_as_they_are() {
        let (mut host, mut child) = pair(Duration::from_secs(60));
        let mut body = Vec::new();
        assert!(!host.ask(&message(0, &[])), "the child sleeps at first");
        assert!(!child.answer(&message(0, &[])), "nothing was asked");
        for length in (0..40).chain([ROOM - HEAD - 1, ROOM - HEAD]) {
            let sent: Vec<u8> = (0..length).map(|k| (7 * k + 3) as u8).collect();
            let number = length as u16;
            assert!(host.ask(&message(number, &sent)) && child.is_asked());
            assert_eq!(child.take(&mut body).expect("a request").number, number);
            assert_eq!(body, sent);
            body.reverse();
            assert!(child.answer(&message(number, &body)) && host.is_answered(later()));
            assert_eq!(answer(&host), (number, body.clone()));
        }
        assert!(!host.ask(&message(0, &vec![0; ROOM - HEAD + 1])));
    }

    /// Every order in which the sides can fall asleep, or look too late.
    #[test]
    fn invariant_a_message_goes_one_way() {
        let (mut host, mut child) = pair(Duration::ZERO);
        let mut body = Vec::new();
        let wake = |child: &Shared| assert!(!child.answer(&message(0, &[])));
        // The child falls asleep before it is asked.
        wake(&child);
        assert!(!child.is_asked() && !host.ask(&message(1, &[])));
        // It is told of a message over the socket before it falls asleep.
        wake(&child);
        host.call();
        assert!(!child.is_asked());
        // The host has waited for long enough before the child looks, or before it answers.
        for has_seen in [false, true] {
            (host.rest, child.rest) = (0, 0);
            wake(&child);
            assert!(host.ask(&message(2, &[])) && (!has_seen || child.is_asked()));
            assert!(!host.is_answered(later()));
            assert!(has_seen || child.is_asked());
            child.take(&mut body).expect("a request");
            assert!(!child.answer(&message(2, &[])));
        }
        // The child has answered, and fallen asleep, before the host looks.
        host.rest = 0;
        assert!(host.ask(&message(3, &[])) && child.is_asked());
        assert!(child.answer(&message(3, &[5])) && !child.is_asked());
        assert!(host.is_answered(later()) && !host.ask(&message(4, &[])));
        assert_eq!(answer(&host), (3, vec![5]));
        // The answer has no room, whether the host still waits or not.
        for has_waited in [false, true] {
            host.rest = 0;
            wake(&child);
            assert!(host.ask(&message(5, &[])) && child.is_asked());
            assert!(!has_waited || !host.is_answered(later()));
            assert!(!child.answer(&vec![0; ROOM + 1]));
            assert!(has_waited || !host.is_answered(later()));
            assert!(!child.is_asked() && !host.ask(&message(6, &[])));
        }
    }

    #[test]
    fn invariant_waiting_in_vain_ends() {
        let (mut host, mut child) = pair(Duration::ZERO);
        let waits = |child: &mut Shared| {
            child.turn().store(FREE, Release);
            let rest = child.rest;
            assert!(!child.is_asked());
            rest == 0
        };
        let count = (0..100_000).filter(|_| waits(&mut child)).count();
        assert!(count < 120, "{count}");
        // What comes in time makes up for it.
        (child.rest, child.spin) = (0, Duration::from_secs(60));
        child.turn().store(FREE, Release);
        assert!(host.ask(&message(1, &[])) && child.is_asked());
        assert_eq!((child.rest, child.next), (0, 1));
    }

    #[test]
    fn refusal_of_memory_that_is_none() {
        let spin = Duration::ZERO;
        let (_, mut child) = pair(spin);
        // Whatever the word says, both sides go to the socket.
        for word in [5, u64::MAX] {
            child.turn().store(word, Release);
            assert!(!child.is_asked() && !child.ask(&message(1, &[])));
            assert!(!child.is_answered(later()));
        }
        child.words()[REQUEST].store(u64::from(u32::MAX), Relaxed);
        assert!(child.take(&mut Vec::new()).is_err());
        let (_, place) = Shared::new(spin).expect("memory");
        let path = place.path().to_owned();
        drop(place);
        assert!(Shared::open(&path, spin).is_err(), "it is gone");
        assert!(Shared::open(Path::new(file!()), spin).is_err());
        assert!(Shared::open(Path::new("/dev/null"), spin).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn refusal_of_shortening() {
        let (_host, place) = Shared::new(Duration::ZERO).expect("memory");
        let file = File::options().write(true).open(place.path());
        assert!(file.expect("the same file").set_len(8).is_err());
    }
}
