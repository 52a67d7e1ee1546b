//! The studio without a server: a module that a worker runs beside the page, and that speaks as the socket does.
//!
//! It is compiled for WASI, of which the worker gives it files in memory and a clock. Bytes go to and fro by one
//! place in its memory; the names of what is exported, their arguments and what they give are those that
//! `page/src/demo/worker.ts` expects, and no others are made.

// Names that a foreign side calls cannot be had without it.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::collections::VecDeque;
use std::path::Path;

use appell_studio::player::{Fresh, Player};
use appell_studio::studio::{Native, Refusal, Studio};
use appell_studio::talk::{self, Message, Obstructed, Said, Told, View};
use serde::Deserialize;

/// A studio with the one page that looks at it.
struct Demo {
    player: Player,
    view: View,
    told: Told,
    waiting: VecDeque<Message>,
}

/// What is asked for besides what the socket carries.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Asked {
    Crossing(Obstructed),
    /// The recording of a line, by the extension of a format.
    Recording {
        line: u32,
        format: String,
    },
}

impl Demo {
    fn open(file: &str) -> Result<Demo, Refusal> {
        let studio = Studio::open(Path::new(file), &[], Native::Refused)?;
        let view = View::of(&studio);
        let mut told = Told::default();
        Ok(Demo {
            waiting: told.news(&view).into(),
            player: Player::new(studio),
            view,
            told,
        })
    }

    fn hear(&mut self, text: &str) {
        let answer = match Said::read(text) {
            Ok(Said::Series { series, asked }) => talk::series(series, &asked, &self.view),
            Ok(Said::Command { id, command }) => talk::answer(id, self.player.handle(*command)),
            Err(refusal) => refusal,
        };
        self.waiting.push_back(answer);
    }

    fn turn(&mut self) {
        let Some(fresh) = self.player.turn() else {
            return;
        };
        if fresh == Fresh::State {
            self.view = View::of(&self.player.studio);
        }
        self.waiting.extend(self.told.news(&self.view));
    }

    fn find(&self, text: &str) -> Result<Vec<u8>, Refusal> {
        let asked = serde_json::from_str(text);
        match asked.map_err(|error| Refusal::new(error.to_string(), ""))? {
            Asked::Crossing(obstructed) => Ok(obstructed.crossed()?.to_string().into()),
            Asked::Recording { line, format } => {
                let file = format!("/recording.{format}");
                self.player.studio.write_recording(line, file.as_ref())?;
                let bytes = std::fs::read(&file);
                let _ = std::fs::remove_file(&file);
                bytes.map_err(|error| Refusal::new(error.to_string(), ""))
            }
        }
    }
}

thread_local! {
    static ROOM: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
    static DEMO: RefCell<Option<Demo>> = const { RefCell::new(None) };
}

/// What came in: the first bytes of the room.
fn taken() -> String {
    ROOM.with_borrow(|room| String::from_utf8_lossy(room).into_owned())
}

/// Leaves bytes to be fetched from the room.
fn left(bytes: Vec<u8>) {
    ROOM.set(bytes);
}

/// Does something with the studio that is open.
fn with<R>(work: impl FnOnce(&mut Demo) -> R) -> R {
    DEMO.with_borrow_mut(|demo| work(demo.as_mut().expect("the worker opens it first")))
}

/// Leaves what was found, or why nothing was: 0 or 1.
fn outcome(found: Result<Vec<u8>, Refusal>) -> u32 {
    let is_refused = found.is_err();
    left(found.unwrap_or_else(|refusal| serde_json::to_vec(&refusal).expect("texts are JSON")));
    is_refused.into()
}

/// The address of room for so many bytes.
#[unsafe(no_mangle)]
pub extern "C" fn appell_room(length: usize) -> *mut u8 {
    ROOM.with_borrow_mut(|room| {
        room.resize(length, 0);
        room.as_mut_ptr()
    })
}

/// The address of the bytes that were left, and how many they are.
#[unsafe(no_mangle)]
pub extern "C" fn appell_place() -> *const u8 {
    ROOM.with_borrow(|room| room.as_ptr())
}

/// How many bytes were left.
#[unsafe(no_mangle)]
pub extern "C" fn appell_length() -> usize {
    ROOM.with_borrow(Vec::len)
}

/// Opens the scenario whose path is in the room. 0, or 1 and leaves a refusal.
#[unsafe(no_mangle)]
pub extern "C" fn appell_open() -> u32 {
    outcome(Demo::open(&taken()).map(|demo| {
        DEMO.set(Some(demo));
        Vec::new()
    }))
}

/// Takes the text in the room as the socket would.
#[unsafe(no_mangle)]
pub extern "C" fn appell_hear() {
    let text = taken();
    with(|demo| demo.hear(&text));
}

/// Lets time pass. Milliseconds until it should again, unless something is heard.
#[unsafe(no_mangle)]
pub extern "C" fn appell_turn() -> u32 {
    with(|demo| {
        demo.turn();
        demo.player.rest().as_millis() as u32
    })
}

/// Leaves the next message to the page. 0 where there is none, 1 for a text, 2 for a frame.
#[unsafe(no_mangle)]
pub extern "C" fn appell_next() -> u32 {
    match with(|demo| demo.waiting.pop_front()) {
        None => 0,
        Some(Message::Text(text)) => {
            left(text.into_bytes());
            1
        }
        Some(Message::Binary(bytes)) => {
            left(bytes);
            2
        }
    }
}

/// Finds what the room asks for, as JSON. 0 and leaves it, or 1 and leaves a refusal.
#[unsafe(no_mangle)]
pub extern "C" fn appell_find() -> u32 {
    let text = taken();
    outcome(with(|demo| demo.find(&text)))
}
