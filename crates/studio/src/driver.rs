//! The thread that owns the studio: it lets time run, does what pages ask for, and publishes what there is to
//! see. Pages never hold it up: they look at histories between two steps, each at its own pace.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde_json::Value;
use tokio::sync::{oneshot, watch};

use crate::history::History;
use crate::studio::{Command, Refusal, Studio};

/// Longest piece of driving between two looks at what was asked for.
const BREATH: Duration = Duration::from_millis(8);
/// Shortest time between two pictures.
pub const FRAME: Duration = Duration::from_millis(16);
/// Steps driven at once while time runs.
const TICKS: u64 = 20;
/// Commands that wait.
const WAITING_MAX: usize = 256;

/// What pages see of a line.
#[derive(Clone)]
pub struct Seen {
    /// Number.
    pub id: u32,
    /// What it is drawn from, as JSON.
    pub scene: Arc<str>,
    /// What it has driven.
    pub history: Arc<Mutex<History>>,
}

/// What pages see.
#[derive(Clone)]
pub struct View {
    /// Lines.
    pub lines: Vec<Seen>,
    /// What else there is, as JSON.
    pub state: Arc<str>,
    /// The figures of a batch, as JSON.
    pub batch: Option<Arc<str>>,
}

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

fn view(studio: &Studio) -> View {
    let seen = studio.lines().iter().map(|line| Seen {
        id: line.id,
        scene: line.scene.clone(),
        history: line.history.clone(),
    });
    View {
        lines: seen.collect(),
        state: studio.state().to_string().into(),
        batch: studio.batch(),
    }
}

impl Driver {
    /// Starts the thread.
    pub fn start(studio: Studio) -> Driver {
        let (send, asked) = channel();
        let (beat, pulse) = watch::channel(0);
        let shown = Arc::new(Mutex::new(view(&studio)));
        let waiting = Arc::default();
        let clock = Clock {
            studio,
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
    studio: Studio,
    asked: Receiver<Asked>,
    waiting: Arc<std::sync::atomic::AtomicUsize>,
    shown: Arc<Mutex<View>>,
    beat: watch::Sender<u64>,
}

impl Clock {
    fn go_on(mut self) {
        // Time of the run and of the clock at which they agreed last.
        let mut agreed: Option<(f64, Instant)> = None;
        let mut published = Instant::now();
        let (mut is_new, mut is_changed) = (false, false);
        loop {
            // Asked for since the last look; at rest, wait for it.
            let wait = match (self.studio.is_playing, is_new || is_changed) {
                (true, _) => Duration::from_millis(1),
                (false, true) => FRAME,
                (false, false) => Duration::from_secs(3600),
            };
            let first = match self.asked.recv_timeout(wait) {
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
                    Ask::Command(command) => self.studio.handle(*command),
                    Ask::Recording(line, file) => self.write_recording(line, &file),
                };
                is_changed = true;
                agreed = None;
                // Whoever asked may have gone.
                let _ = answer.send(result);
            }
            if self.studio.is_playing {
                let events = self.events();
                is_new |= self.drive(&mut agreed);
                // What happened, and an end, are told at once.
                is_changed |= self.events() != events || !self.studio.is_playing;
            } else {
                agreed = None;
            }
            if (is_new || is_changed) && published.elapsed() >= FRAME {
                if is_changed {
                    *self.shown.lock().expect("nothing panics with it") = view(&self.studio);
                }
                self.beat.send_modify(|count| *count += 1);
                published = Instant::now();
                (is_new, is_changed) = (false, false);
            }
        }
    }

    fn events(&self) -> usize {
        let history = self.studio.active().history.lock();
        history.expect("nothing panics with it").events.len()
    }

    /// Lets the run go on to where the clock is, for a breath at most.
    fn drive(&mut self, agreed: &mut Option<(f64, Instant)>) -> bool {
        let begun = Instant::now();
        let rows = self.studio.active().rows();
        let time = self.studio.active().now();
        let (from, since) = *agreed.get_or_insert((time, begun));
        let step = self.studio.active().step();
        while begun.elapsed() < BREATH {
            let ticks = match self.studio.speed {
                None => TICKS,
                Some(speed) => {
                    let due = from + since.elapsed().as_secs_f64() * speed;
                    let behind = (due - self.studio.active().now()) / step;
                    if behind < 1.0 {
                        break;
                    }
                    (behind as u64).min(TICKS)
                }
            };
            if !self.studio.advance(ticks) {
                break;
            }
        }
        if begun.elapsed() >= BREATH {
            // What cannot be kept up with is not made up for.
            *agreed = None;
        }
        self.studio.active().rows() != rows
    }

    fn write_recording(&self, line: u32, file: &std::path::Path) -> Result<Value, Refusal> {
        let line = self.studio.lines().iter().find(|one| one.id == line);
        let line = line.ok_or_else(|| Refusal::new("there is no such line", ""))?;
        line.write_recording(file)
            .map(|()| Value::Null)
            .map_err(|error| Refusal::new(error.to_string(), ""))
    }
}
