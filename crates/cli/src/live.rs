//! `appell run --watch`: a run in step with the clock, whose controllers change while it goes on.

use std::io::BufRead;
use std::path::{Component, Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
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
    /// Seconds of simulated time per second; none for as fast as can be.
    pace: Option<f64>,
    start: Instant,
    news: Option<Receiver<News>>,
    words: Option<Receiver<String>>,
    /// Changes that were told.
    told: usize,
    robots: Vec<String>,
}

impl Live {
    /// Keeps a pace and, with a workshop, watches its files, versions of which are kept in `folder`, and
    /// listens to the standard input.
    pub fn new(pace: Option<f64>, workshop: Option<Workshop>, home: &Path, folder: &Path) -> Self {
        let watched = workshop.map(|workshop| {
            let (send, news) = channel();
            let watch = Watch::new(workshop, home, folder, send);
            std::thread::spawn(move || watch.go_on());
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
            (news, words)
        });
        let (news, words) = watched.unzip();
        Live {
            pace,
            start: Instant::now(),
            news,
            words,
            told: 0,
            robots: Vec::new(),
        }
    }

    /// Ticks between two looks.
    pub fn ticks(&self, run: &Run) -> u64 {
        let ahead = self.pace.unwrap_or(1.0) * BREATH / run.scenario().time.step;
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
            self.start = Instant::now()
                - Duration::from_secs_f64(run.world.now() / self.pace.unwrap_or(f64::INFINITY));
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
                        terminal::warning("say ROBOT CONTROLLER, to let that controller take over");
                        Ok(())
                    }
                };
                if let Err(error) = changed {
                    terminal::warning(&error.to_string());
                }
            }
        }
        self.tell(run);
        if let Some(pace) = self.pace {
            let due = self.start + Duration::from_secs_f64(run.world.now() / pace);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
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
}

fn seen(file: &Path) -> Option<(SystemTime, u64)> {
    let about = std::fs::metadata(file).ok()?;
    Some((about.modified().ok()?, about.len()))
}

impl Watch {
    fn new(workshop: Workshop, home: &Path, folder: &Path, send: Sender<News>) -> Self {
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
        }
    }

    fn go_on(mut self) {
        loop {
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
    file.versions += 1;
    let name = version(&file.source.name, file.versions);
    // Beside the first version's copy; what lies elsewhere has its versions in the folder itself.
    let own = Path::new(&file.source.file);
    let is_below = own
        .components()
        .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    let own = match (is_below, own.file_name()) {
        (false, Some(name)) => Path::new(name),
        _ => own,
    };
    let own = version_file(own, file.versions);
    let to = folder.join(&own);
    // What is run is what is kept: the copy, whatever becomes of the file.
    let copied = std::fs::create_dir_all(to.parent().unwrap_or(folder))
        .and_then(|()| std::fs::write(&to, &bytes))
        .and_then(|()| std::fs::set_permissions(&to, std::fs::metadata(&file.from)?.permissions()));
    let result = match copied {
        Ok(()) => workshop
            .open(&file.source, &name, &own.to_string_lossy(), folder)
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
