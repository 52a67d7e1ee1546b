//! `appell run --watch`: a run in step with the clock, whose controllers change while it goes on.

use std::io::BufRead;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use appell_sim::live::{Source, Successor, Workshop, version, version_file};
use appell_sim::run::Run;

use crate::terminal;

/// How often files are looked at.
const LOOK: Duration = Duration::from_millis(50);
/// Longest time between two looks at what came, s.
const BREATH: f64 = 0.005;

/// A new version of a plug-in, or why there is none.
struct News {
    source: Source,
    name: String,
    result: Result<Box<Successor>, String>,
}

/// What comes while a run goes on.
pub struct Live {
    /// Seconds of simulated time per second.
    pace: f64,
    start: Instant,
    news: Option<Receiver<News>>,
    words: Option<Receiver<String>>,
    /// Changes that were told.
    told: usize,
    robots: Vec<String>,
    watch: Option<(Arc<AtomicBool>, JoinHandle<()>)>,
}

impl Drop for Live {
    fn drop(&mut self) {
        // What it has opened ends in order.
        if let Some((stop, watch)) = self.watch.take() {
            stop.store(true, Ordering::Relaxed);
            let _ = watch.join();
        }
    }
}

impl Live {
    /// Keeps a pace and, with a workshop, watches its files, versions of which are kept in `folder`, and
    /// listens to the standard input.
    pub fn new(pace: f64, workshop: Option<Workshop>, home: &Path, folder: &Path) -> Self {
        let watched = workshop.map(|workshop| {
            let (send, news) = channel();
            let stop = Arc::new(AtomicBool::new(false));
            let files = Watch::new(workshop, home, folder, send, stop.clone());
            let watch = (stop, std::thread::spawn(move || files.go_on()));
            let (send, words) = channel();
            std::thread::spawn(move || {
                let lines = std::io::stdin().lock().lines();
                // Ends with the input, or with the run.
                for line in lines.map_while(Result::ok) {
                    if send.send(line).is_err() {
                        return;
                    }
                }
            });
            ((news, words), watch)
        });
        let (listened, watch) = watched.unzip();
        let (news, words) = listened.unzip();
        Live {
            pace,
            start: Instant::now(),
            news,
            words,
            told: 0,
            robots: Vec::new(),
            watch,
        }
    }

    /// Ticks between two looks.
    pub fn ticks(&self, run: &Run) -> u64 {
        let ahead = self.pace * BREATH / run.scenario().time.step;
        (ahead as u64).clamp(1, 1024)
    }

    /// Does what came, and waits for the clock.
    pub fn between(&mut self, run: &mut Run) {
        if self.robots.is_empty() {
            self.robots = run
                .scenario()
                .robot
                .iter()
                .map(|r| r.name.clone())
                .collect();
            // Building the world is not part of the run.
            let gone = run.world.now() / self.pace;
            let now = Instant::now();
            let begun = now.checked_sub(Duration::from_secs_f64(gone));
            self.start = begun.unwrap_or(now);
        }
        if let Some(news) = &self.news {
            for News {
                source,
                name,
                result,
            } in news.try_iter()
            {
                let installed = result.and_then(|successor| {
                    run.install(*successor).map_err(|error| error.to_string())
                });
                if let Err(problem) = installed {
                    run.refuse(&source, &name, &problem);
                }
            }
        }
        if let Some(words) = &self.words {
            for line in words.try_iter() {
                let words: Vec<&str> = line.split_whitespace().collect();
                let changed = match (&words[..], &self.robots[..]) {
                    ([], _) => Ok(()),
                    ([to], [only]) => run.swap(only, to),
                    ([robot, to], _) => run.swap(robot, to),
                    _ => {
                        terminal::warning(
                            "say ROBOT NAME, to let that controller or model take over",
                        );
                        Ok(())
                    }
                };
                if let Err(error) = changed {
                    terminal::warning(&error.to_string());
                }
            }
        }
        self.tell(run);
        let due = self.start + Duration::from_secs_f64(run.world.now() / self.pace);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }

    /// Says what was changed, where somebody watches.
    fn tell(&mut self, run: &Run) {
        if self.news.is_none() {
            return;
        }
        for swap in &run.world.swapped()[self.told..] {
            let told = match &swap.refused {
                None => format!("{} took over from {}", swap.to, swap.from),
                Some(problem) => {
                    format!("{} was refused, {} goes on: {problem}", swap.to, swap.from)
                }
            };
            terminal::remark(&format!("{:8.3} s  {}: {told}", swap.t, swap.robot));
        }
        self.told = run.world.swapped().len();
    }
}

/// A file of a plug-in, as it was seen last.
struct Watched {
    source: Source,
    from: PathBuf,
    /// When it was changed, and how long it is; and whether that was seen twice.
    seen: Option<(SystemTime, u64)>,
    is_read: bool,
    hash: String,
    /// Versions so far.
    versions: usize,
}

/// Watches files.
struct Watch {
    workshop: Workshop,
    folder: PathBuf,
    send: Sender<News>,
    files: Vec<Watched>,
    stop: Arc<AtomicBool>,
}

fn seen(file: &Path) -> Option<(SystemTime, u64)> {
    let about = std::fs::metadata(file).ok()?;
    Some((about.modified().ok()?, about.len()))
}

impl Watch {
    fn new(
        workshop: Workshop,
        home: &Path,
        folder: &Path,
        send: Sender<News>,
        stop: Arc<AtomicBool>,
    ) -> Self {
        let watched = |source: Source| {
            let from = home.join(&source.file);
            Watched {
                seen: seen(&from),
                hash: std::fs::read(&from)
                    .map(|bytes| appell_plugin::digest(&bytes))
                    .unwrap_or_default(),
                from,
                source,
                is_read: true,
                versions: 1,
            }
        };
        Watch {
            files: workshop.sources().into_iter().map(watched).collect(),
            workshop,
            folder: folder.to_owned(),
            send,
            stop,
        }
    }

    fn go_on(mut self) {
        while !self.stop.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
            for file in &mut self.files {
                let now = seen(&file.from);
                if now != file.seen {
                    // It may be half written: what lasts until the next look is read.
                    file.seen = now;
                    file.is_read = false;
                } else if now.is_some() && !file.is_read {
                    file.is_read = true;
                    let news = renewed(&self.workshop, file, &self.folder);
                    if let Some(news) = news
                        && self.send.send(news).is_err()
                    {
                        return;
                    }
                }
            }
        }
    }
}

/// The new version of a file, if it has other bytes than the last.
fn renewed(workshop: &Workshop, file: &mut Watched, folder: &Path) -> Option<News> {
    let bytes = std::fs::read(&file.from).ok()?;
    let hash = appell_plugin::digest(&bytes);
    if hash == file.hash {
        return None;
    }
    file.hash = hash;
    // Beside the first version's copy; what lies elsewhere has its versions in the folder itself, under the
    // robot's name, as has what several share.
    let source = &file.source;
    let own = Path::new(&source.file);
    let is_below = own
        .components()
        .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    let all = workshop.sources();
    let is_shared = all.iter().filter(|one| one.file == source.file).count() > 1;
    let mut own = match own.file_name() {
        Some(name) if !is_below => PathBuf::from(name),
        _ => own.to_owned(),
    };
    if is_shared || !is_below {
        let name = own.file_name().unwrap_or_default().to_string_lossy();
        let name = format!("{}-{}-{name}", source.robot, source.name);
        own = own.with_file_name(name);
    }
    let (name, kept) = loop {
        file.versions += 1;
        let name = version(&source.name, file.versions);
        let kept = version_file(&own, file.versions);
        if !workshop.is_taken(&source.robot, &name, &kept.to_string_lossy()) {
            break (name, kept);
        }
    };
    let to = folder.join(&kept);
    // What is run is what is kept: the copy, whatever becomes of the file. One of an earlier run may be one
    // that cannot be written, or that something holds.
    let _ = std::fs::remove_file(&to);
    let copied = std::fs::create_dir_all(to.parent().unwrap_or(folder))
        .and_then(|()| std::fs::write(&to, &bytes))
        .and_then(|()| std::fs::set_permissions(&to, std::fs::metadata(&file.from)?.permissions()));
    let result = match copied {
        Ok(()) => workshop
            .open(&file.source, &name, &kept.to_string_lossy(), folder)
            .map(Box::new)
            .map_err(|fault| fault.to_string()),
        Err(error) => Err(format!("{}: cannot be written: {error}", to.display())),
    };
    Some(News {
        source: file.source.clone(),
        name,
        result,
    })
}
