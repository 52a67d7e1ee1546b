//! The thread that owns the studio: it lets time run, does what pages ask for, and publishes what there is to
//! see. Pages never hold it up: they look at histories between two steps, each at its own pace.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use serde_json::Value;
use tokio::sync::{oneshot, watch};

use crate::player::{Fresh, Player};
use crate::studio::{Command, Refusal, Studio};
use crate::talk::View;

/// Commands that wait.
const WAITING_MAX: usize = 256;

type Asked = (Ask, oneshot::Sender<Result<Value, Refusal>>);

enum Ask {
    Command(Box<Command>),
    /// The recording of a line, to be written to a file.
    Recording(u32, std::path::PathBuf),
}

/// What the network holds of the thread.
pub struct Driver {
    asked: Mutex<Option<Sender<Asked>>>,
    waiting: Arc<std::sync::atomic::AtomicUsize>,
    view: Arc<Mutex<View>>,
    pulse: watch::Receiver<u64>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Driver {
    /// Starts the thread.
    pub fn start(studio: Studio) -> Driver {
        let (send, asked) = channel();
        let (beat, pulse) = watch::channel(0);
        let shown = Arc::new(Mutex::new(View::of(&studio)));
        let waiting = Arc::default();
        let clock = Clock {
            player: Player::new(studio),
            asked,
            waiting: Arc::clone(&waiting),
            shown: shown.clone(),
            beat,
        };
        Driver {
            asked: Mutex::new(Some(send)),
            waiting,
            view: shown,
            pulse,
            thread: Mutex::new(Some(std::thread::spawn(move || clock.go_on()))),
        }
    }

    /// What there is to see.
    pub fn view(&self) -> View {
        self.view.lock().expect("nothing panics with it").clone()
    }

    /// Counts what was published.
    pub fn pulse(&self) -> watch::Receiver<u64> {
        self.pulse.clone()
    }

    /// Does a command, and waits for it.
    ///
    /// # Errors
    /// It cannot be done.
    pub async fn command(&self, command: Command) -> Result<Value, Refusal> {
        self.ask(Ask::Command(Box::new(command))).await
    }

    /// Writes the recording of a line to a file.
    ///
    /// # Errors
    /// There is no such line, or it cannot be written.
    pub async fn recording(&self, line: u32, file: std::path::PathBuf) -> Result<Value, Refusal> {
        self.ask(Ask::Recording(line, file)).await
    }

    async fn ask(&self, ask: Ask) -> Result<Value, Refusal> {
        use std::sync::atomic::Ordering::Relaxed;
        let gone = || Refusal::new("the studio has ended", "start it again");
        if self.waiting.fetch_add(1, Relaxed) >= WAITING_MAX {
            self.waiting.fetch_sub(1, Relaxed);
            return Err(Refusal::new(
                "too much was asked for at once",
                "wait a little",
            ));
        }
        let (send, answer) = oneshot::channel();
        {
            let asked = self.asked.lock().expect("nothing panics with it");
            asked
                .as_ref()
                .ok_or_else(gone)?
                .send((ask, send))
                .map_err(|_| gone())?;
        }
        answer.await.map_err(|_| gone())?
    }

    /// Ends the thread.
    pub fn stop(&self) {
        drop(self.asked.lock().expect("nothing panics with it").take());
        let thread = self.thread.lock().expect("nothing panics with it").take();
        if let Some(thread) = thread {
            let _ = thread.join();
        }
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.stop();
    }
}

struct Clock {
    player: Player,
    asked: Receiver<Asked>,
    waiting: Arc<std::sync::atomic::AtomicUsize>,
    shown: Arc<Mutex<View>>,
    beat: watch::Sender<u64>,
}

impl Clock {
    fn go_on(mut self) {
        loop {
            // Asked for since the last look; at rest, wait for it.
            let first = match self.asked.recv_timeout(self.player.rest()) {
                Ok(asked) => Some(asked),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return,
            };
            for (ask, answer) in first
                .into_iter()
                .chain(self.asked.try_iter())
                .collect::<Vec<_>>()
            {
                self.waiting
                    .fetch_sub(1, std::sync::atomic::Ordering::Relaxed);
                let result = match ask {
                    Ask::Command(command) => self.player.handle(*command),
                    Ask::Recording(line, file) => self.player.studio.write_recording(line, &file),
                };
                // Whoever asked may have gone.
                let _ = answer.send(result);
            }
            if let Some(fresh) = self.player.turn() {
                if fresh == Fresh::State {
                    let view = View::of(&self.player.studio);
                    *self.shown.lock().expect("nothing panics with it") = view;
                }
                self.beat.send_modify(|count| *count += 1);
            }
        }
    }
}
