//! `appell run`.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use appell_sim::batch::Crew;
use appell_sim::crowd::{Crowd, is_crowd};
use appell_sim::record::{self, Csv, Fan, Mcap, Memory, Parquet, RecordError, Recorder, Rosbag};
use appell_sim::report;
use appell_sim::run::{NarrowRun, Outcome, Run, Summary};
use appell_sim::scenario::{self, Format, Loaded, Robot, Scenario};
use appell_sim::world::SimError;

use crate::arguments::{Precision, RecordFormat, RunOptions};
use crate::live::Live;
use crate::{exit, terminal};

/// Most rows that a report is drawn from: 160 s at 100 Hz, thinned beyond.
pub const REPORT_ROWS: usize = 16_000;

/// Most robots that a report shows, evenly chosen.
pub const REPORT_ROBOTS: usize = 30;

/// Runs each scenario; the worst exit code of all.
pub fn run(options: &RunOptions) -> u8 {
    let overrides = match options.changes.overrides() {
        Ok(overrides) => overrides,
        Err(problem) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    if options.watch && options.scenarios.len() > 1 {
        terminal::error(&format!(
            "--watch: must have one scenario, got {}\n  hint: run them one by one",
            options.scenarios.len()
        ));
        return exit::BAD_INPUT;
    }
    let mut worst = exit::PASSED;
    let mut written: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    for file in &options.scenarios {
        let loaded = match scenario::load(file, &overrides) {
            Ok(loaded) => Loaded {
                trust_native: options.trust_native,
                ..loaded
            },
            Err(diagnostics) => {
                terminal::error(&diagnostics.to_string());
                worst = worst.max(exit::BAD_INPUT);
                continue;
            }
        };
        let name = &loaded.scenario.name;
        let folder = match (&options.out, options.scenarios.len()) {
            (Some(out), 1) => out.clone(),
            (Some(out), _) => out.join(name),
            (None, _) => Path::new("runs").join(name),
        };
        if let Some(other) = written.insert(folder.clone(), file) {
            terminal::error(&format!(
                "{}: name: must differ from that of {}, got \"{name}\": both would write to {}\n  \
                 hint: run them one by one with an --out of their own",
                file.display(),
                other.display(),
                folder.display()
            ));
            worst = worst.max(exit::BAD_INPUT);
            continue;
        }
        worst = worst.max(one(&loaded, &folder, options));
    }
    worst
}

/// Runs a world or a crowd into a recorder, with progress.
type Execute<'a> =
    dyn FnMut(&mut dyn Recorder, &mut dyn FnMut(f64)) -> Result<Summary, SimError> + 'a;

fn one(loaded: &Loaded, folder: &Path, options: &RunOptions) -> u8 {
    // To watch is to keep step with the clock.
    let pace = options.pace.or(options.watch.then_some(1.0));
    let is_narrow = options.precision == Precision::F32;
    let ran = if is_crowd(&loaded.scenario) {
        if is_narrow {
            terminal::error(&format!(
                "{}: must have robots of count = 1 to be run with --precision f32\n  \
                 hint: leave the option out, or --set robot.NAME.count=1",
                loaded.file.display()
            ));
            return exit::BAD_INPUT;
        }
        if pace.is_some() {
            terminal::error(&format!(
                "{}: must have robots of count = 1 to be run with --watch or --pace\n  \
                 hint: leave the option out, or --set robot.NAME.count=1",
                loaded.file.display()
            ));
            return exit::BAD_INPUT;
        }
        Crowd::new(loaded, Crew::default()).map(|mut crowd| {
            execute(
                &mut |recorder, progress| crowd.execute(recorder, progress),
                loaded,
                folder,
                options,
            )
        })
    } else if is_narrow {
        NarrowRun::new(loaded, 0).map(|run| {
            execute(
                &mut |recorder, progress| run.execute(recorder, progress),
                loaded,
                folder,
                options,
            )
        })
    } else {
        Run::with_workshop(loaded, 0).map(|(mut run, workshop)| {
            let workshop = options.watch.then_some(workshop);
            let mut live = pace.map(|pace| Live::new(pace, workshop, &loaded.folder, folder));
            let ran = execute(
                &mut |recorder, progress| match &mut live {
                    None => run.execute(recorder, progress),
                    Some(live) => {
                        let ticks = live.ticks(&run);
                        run.execute_with(recorder, ticks, &mut |run| {
                            live.between(run);
                            progress(run.world.now());
                        })
                    }
                },
                loaded,
                folder,
                options,
            )?;
            // What was done by hand is done by itself the next time.
            if let Some(scenario) = run.repetition() {
                let path = folder.join("scenario.toml");
                std::fs::write(&path, scenario.to_toml())
                    .map_err(|error| Failure::output(&path, error))?;
            }
            Ok(ran)
        })
    };
    let ran = match ran {
        Ok(ran) => ran,
        Err(diagnostics) => {
            terminal::error(&diagnostics.to_string());
            return exit::BAD_INPUT;
        }
    };
    match ran {
        Ok(summary) => {
            if options.json {
                let text = match options.scenarios.len() {
                    1 => serde_json::to_string_pretty(&summary),
                    _ => serde_json::to_string(&summary),
                };
                terminal::print(&text.expect("a summary is plain data"));
            } else {
                terminal::print(&format!(
                    "{}  {}: {}\n{}  {}",
                    terminal::verdict(summary.verdict),
                    summary.scenario,
                    summary.reason,
                    terminal::summary(&summary),
                    written(folder, options)
                ));
            }
            match summary.verdict {
                Outcome::Passed => exit::PASSED,
                Outcome::Failed => exit::FAILED,
                // Without a task there is nothing to fail but the run itself.
                Outcome::Stopped if summary.error.is_none() => exit::PASSED,
                Outcome::Stopped => exit::FAILED,
            }
        }
        Err(failure) => {
            terminal::error(&failure.text);
            failure.code
        }
    }
}

/// Runs a scenario into a folder, and prints nothing of it.
pub fn driven(loaded: &Loaded, folder: &Path, options: &RunOptions) -> Result<Summary, Failure> {
    let run = Run::new(loaded, 0);
    let mut run = run.map_err(|diagnostics| Failure {
        code: exit::BAD_INPUT,
        text: diagnostics.to_string(),
    })?;
    let summary = execute(
        &mut |recorder, progress| run.execute(recorder, progress),
        loaded,
        folder,
        options,
    )?;
    match &summary.error {
        None => Ok(summary),
        Some(error) => Err(Failure {
            code: exit::FAILED,
            text: error.clone(),
        }),
    }
}

fn written(folder: &Path, options: &RunOptions) -> String {
    if options.no_report {
        format!("written to {}", folder.display())
    } else {
        format!("report: {}", folder.join("report.html").display())
    }
}

/// Files of plug-ins that lie below the scenario's folder.
fn plugins(scenario: &Scenario) -> impl Iterator<Item = &Path> {
    let plugins = scenario.robot.iter().flat_map(Robot::plugins);
    let files = plugins.map(|(_, plugin)| Path::new(&plugin.file));
    files.filter(|file| {
        let mut parts = file.components();
        parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
    })
}

/// Why a run gave no summary.
pub struct Failure {
    /// Exit code.
    pub code: u8,
    /// What to print.
    pub text: String,
}

impl Failure {
    fn output(path: &Path, error: impl std::fmt::Display) -> Self {
        Failure {
            code: exit::OUTPUT,
            text: format!(
                "{}: cannot be written: {error}\n  hint: choose another folder with --out, or make room",
                path.display()
            ),
        }
    }
}

impl From<RecordError> for Failure {
    fn from(error: RecordError) -> Self {
        let hint = error.hint().unwrap_or(
            "what was recorded until then stays readable; choose another folder with --out",
        );
        let hint = format!("\n  hint: {hint}");
        Failure {
            code: exit::OUTPUT,
            text: format!("{error}{hint}"),
        }
    }
}

fn execute(
    run: &mut Execute<'_>,
    loaded: &Loaded,
    folder: &Path,
    options: &RunOptions,
) -> Result<Summary, Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::output(folder, error))?;
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|error| Failure::output(&path, error))
    };
    // What an earlier run left is not to be taken for this one's.
    record::clear(folder).map_err(|(path, error)| Failure::output(&path, error))?;
    write("scenario.toml", loaded.resolved.as_bytes())?;
    // With its plug-ins beside it the scenario can be run again from here.
    for file in plugins(&loaded.scenario) {
        let from = loaded.folder.join(file);
        let to = folder.join(file);
        // Run from its own folder a scenario has them where they belong.
        if let (Ok(from), Ok(to)) = (from.canonicalize(), to.canonicalize())
            && from == to
        {
            continue;
        }
        // A file of an earlier run may be one that cannot be written.
        let _ = std::fs::remove_file(&to);
        let copied = std::fs::create_dir_all(to.parent().unwrap_or(folder))
            .and_then(|()| std::fs::copy(&from, &to));
        copied.map_err(|error| Failure {
            text: format!("{}: cannot be written: {error}", to.display()),
            code: exit::OUTPUT,
        })?;
    }
    let formats = &loaded.scenario.record.formats;
    let mut files: Vec<Box<dyn Recorder>> = Vec::new();
    if !options.no_recording {
        files.push(Box::new(Mcap::create(&folder.join("recording.mcap"))?));
        let wanted = |asked: RecordFormat, format| {
            options.record.contains(&asked) || formats.contains(&format)
        };
        if options.csv || wanted(RecordFormat::Csv, Format::Csv) {
            files.push(Box::new(Csv::create(&folder.join("recording.csv"))?));
        }
        if options.parquet || wanted(RecordFormat::Parquet, Format::Parquet) {
            files.push(Box::new(Parquet::create(
                &folder.join("recording.parquet"),
            )?));
        }
        if wanted(RecordFormat::Ros2, Format::Ros2) {
            files.push(Box::new(Rosbag::create(
                &folder.join("ros2"),
                &loaded.scenario,
            )?));
        }
    }
    let memory = (!options.no_report).then(|| Memory::excerpt(REPORT_ROWS, REPORT_ROBOTS));
    let mut recorder = Fan { files, memory };
    let mut progress = terminal::Progress::new(
        &loaded.scenario.name,
        loaded.scenario.time.duration,
        "times real time",
    );
    let result = run(&mut recorder, &mut |t| progress.at(t));
    progress.done();
    let summary = result.map_err(|error| match error {
        SimError::Record(error) => Failure::from(error),
        other => Failure {
            code: exit::FAILED,
            text: other.to_string(),
        },
    })?;
    let text = serde_json::to_string_pretty(&summary).expect("a summary is plain data");
    write("summary.json", (text + "\n").as_bytes())?;
    if let Some(memory) = recorder.memory {
        let pages = report::pages(&memory.into_recording(), &summary);
        let pages = pages.map_err(|error| Failure {
            code: exit::INTERNAL,
            text: error.to_string(),
        })?;
        for (name, bytes) in pages {
            write(name, &bytes)?;
        }
    }
    Ok(summary)
}

/// The folder of a comparison.
pub fn folder_or(out: Option<&PathBuf>, name: &str) -> PathBuf {
    out.cloned().unwrap_or_else(|| Path::new("runs").join(name))
}
