//! Many robots of one kind in one world. They do not meet, so each is a trial of its own: they move
//! in lanes and on all cores, under one clock and into one recording.

use std::collections::VecDeque;

use appell_model::lanes::{AnyLanes, dispatch};
use appell_model::math::wrap_angle;
use appell_model::scalar::{Mask, Scalar};
use rayon::prelude::*;

use crate::batch::{Crew, drawn};
use crate::build::Values;
use crate::drawing::drawing;
use crate::layout::Assignment;
use crate::meter::Meter;
use crate::plan::{Path, SpeedLimits};
use crate::record::{Event, Header, RecordError, Recorder};
use crate::run::{Account, Outcome, Plans, RobotSummary, Summary, assemble, fingerprint, refuse};
use crate::scenario::{self, Diagnostic, Diagnostics, Loaded, Robot, Scenario, Template};
use crate::signal::Signal;
use crate::world::{Listener, Parts, SimError, World};

/// Signals that a recording has of each robot of a count.
pub const MOTION: [&str; 7] = [
    "pose.x",
    "pose.y",
    "pose.yaw",
    "twist.forward",
    "twist.left",
    "twist.yaw_rate",
    "clearance",
];

/// Length of time that is run at once, s: what a killed run may lose.
const WINDOW: f64 = 0.25;
/// Numbers of rows that are put together at once.
const WINDOW_NUMBERS: usize = 1 << 18;

/// Robots by count, ready to run.
pub struct Crowd {
    /// What recordings of it begin with.
    pub header: Header,
    /// Each robot by itself, named.
    scenario: Scenario,
    flocks: Vec<Box<dyn Flock>>,
    /// Column at which each robot begins, by its place.
    columns: Vec<usize>,
    pool: rayon::ThreadPool,
    /// Ticks between two rows.
    period: u64,
}

/// How a figure is spread over robots.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Name of the metric.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// 5 %, 50 % and 95 % of the robots have at most these.
    pub quantiles: [f64; 3],
}

/// How the metrics of some robots are spread; those that the first of them has.
pub fn spreads(robots: &[&RobotSummary]) -> Vec<Spread> {
    let metrics = robots.first().map_or(&[][..], |robot| &robot.metrics);
    metrics
        .iter()
        .map(|metric| {
            let of = |robot: &&RobotSummary| {
                let mut own = robot.metrics.iter();
                own.find(|own| own.name == metric.name).map(|own| own.value)
            };
            let mut values: Vec<f64> = robots.iter().filter_map(of).collect();
            values.sort_by(f64::total_cmp);
            // Nearest ranks: each is the figure of a robot.
            let last = (values.len() - 1) as f64;
            let rank = |share: f64| values[(last * share).round() as usize];
            Spread {
                name: metric.name.clone(),
                unit: metric.unit.clone(),
                quantiles: [0.05, 0.5, 0.95].map(rank),
            }
        })
        .collect()
}

/// A robot of a crowd, before it is put with others.
struct Member {
    /// Its place among all robots.
    place: usize,
    /// Its name there.
    name: String,
    trial: u64,
    /// A scenario of it alone, by its name in the file.
    loaded: Loaded,
    integrators: Vec<String>,
    parts: Parts<f64>,
    /// What is drawn of it beside the robot.
    path: Option<Path>,
    assignment: Option<Assignment>,
    /// How long it is expected to take, s; zero without a path.
    expected: f64,
    /// Whether all its signals are recorded.
    is_whole: bool,
}

/// Whether a scenario has robots by count.
pub fn is_crowd(scenario: &Scenario) -> bool {
    scenario.robot.iter().any(|robot| robot.count > 1)
}

impl Crowd {
    /// Builds the robots of a checked scenario.
    ///
    /// # Errors
    /// What was drawn for a robot makes none, or there are no threads.
    pub fn new(loaded: &Loaded, crew: Crew) -> Result<Crowd, Diagnostics> {
        let scenario = &loaded.scenario;
        let plans = Plans::default();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(crew.threads)
            .build()
            .map_err(|error| {
                let problem = format!("no threads: {error}");
                refuse(loaded, String::new(), problem, "ask for fewer".into())
            })?;
        let mut flocks = Vec::new();
        let mut alone = Scenario {
            robot: Vec::new(),
            batch: None,
            ..scenario.clone()
        };
        let (mut paths, mut assignments, mut integrators) = (Vec::new(), Vec::new(), Vec::new());
        for robot in &scenario.robot {
            let single = Robot {
                count: 1,
                vary: Vec::new(),
                ..robot.clone()
            };
            let mold = Loaded {
                scenario: Scenario {
                    robot: vec![single],
                    batch: None,
                    ..scenario.clone()
                },
                ..loaded.clone()
            };
            let template = Template::of(&mold);
            let built: Vec<Result<Member, Diagnostics>> = pool.install(|| {
                let trials = (0..robot.count).into_par_iter();
                trials
                    .map(|trial| build(loaded, &mold, &template, robot, trial, &plans))
                    .collect()
            });
            let mut members = VecDeque::new();
            // The first of those that cannot be built, whichever thread found it.
            for member in built {
                let mut member = member?;
                member.place = alone.robot.len();
                paths.push(member.path.take());
                assignments.push(member.assignment.take());
                integrators.extend(member.integrators.clone());
                alone.robot.push(Robot {
                    name: member.name.clone(),
                    ..member.loaded.scenario.robot[0].clone()
                });
                members.push_back(member);
            }
            // Those that take equally long share lanes, which would wait for the last of them.
            let sooner = |a: &Member, b: &Member| a.expected.total_cmp(&b.expected);
            members.make_contiguous().sort_by(sooner);
            while !members.is_empty() {
                let maker = Gather {
                    members: &mut members,
                    plans: &plans,
                };
                flocks.push(dispatch(crew.lanes, maker));
            }
        }
        // Recorded in the order of the scenario, however they move.
        let mut own: Vec<(usize, Vec<Signal>)> =
            flocks.iter().flat_map(|flock| flock.signals()).collect();
        own.sort_by_key(|(place, _)| *place);
        let mut columns = Vec::new();
        let mut signals = Vec::new();
        for (_, own) in own {
            columns.push(signals.len());
            signals.extend(own);
        }
        let step = scenario.time.step;
        let header = Header {
            scenario: scenario.name.clone(),
            scenario_text: loaded.resolved.clone(),
            hash: fingerprint(loaded),
            seed: scenario.seed,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            step,
            period: scenario.record.period,
            signals,
            extra: drawing(
                &alone,
                &paths,
                &assignments,
                &integrators,
                plans.relief(loaded)?.as_deref(),
            ),
        };
        Ok(Crowd {
            header,
            scenario: alone,
            flocks,
            columns,
            pool,
            period: (scenario.record.period / step).round().max(1.0) as u64,
        })
    }

    /// Number of robots.
    pub fn count(&self) -> usize {
        self.scenario.robot.len()
    }

    /// Runs to the end, into `recorder`; `progress` is told the time now and then. A robot that has
    /// its verdict stays where it is.
    ///
    /// # Errors
    /// The recording cannot be written. What breaks a single robot off is in its summary.
    pub fn execute(
        &mut self,
        recorder: &mut dyn Recorder,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Summary, SimError> {
        recorder.begin(&self.header)?;
        let step = self.header.step;
        let period = self.period;
        let count = ((WINDOW / step) as u64 / period).max(1);
        let width = self.header.signals.len();
        // Rows are put together side by side, as many as a cache holds.
        let block = (WINDOW_NUMBERS / width).clamp(1, count as usize);
        let mut window = vec![0.0; block * width];
        let mut begin = 0;
        loop {
            let until = begin + count * period;
            let flocks = &mut self.flocks;
            self.pool.install(|| {
                flocks
                    .par_iter_mut()
                    .with_max_len(1)
                    .for_each(|flock| flock.advance(begin, until));
            });
            let is_busy = flocks.iter().any(|flock| flock.is_busy());
            let end = match is_busy {
                true => until,
                false => flocks.iter().map(|flock| flock.end()).max().unwrap_or(0),
            };
            let mut events: Vec<(usize, Event)> = flocks
                .iter_mut()
                .flat_map(|flock| flock.take_events())
                .collect();
            events.sort_by(|(a, x), (b, y)| x.t.total_cmp(&y.t).then(a.cmp(b)));
            let mut events = events.into_iter().map(|(_, event)| event).peekable();
            let kept: Vec<Kept<'_>> = flocks.iter().map(|flock| flock.kept()).collect();
            let columns = &self.columns;
            let is_due = |k: &u64| begin + k * period < end + u64::from(!is_busy);
            let due = (0..count).take_while(is_due).count();
            for first in (0..due).step_by(block) {
                let rows = &mut window[..block.min(due - first) * width];
                self.pool.install(|| {
                    let rows = rows.par_chunks_mut(width).enumerate();
                    rows.for_each(|(k, row)| {
                        kept.iter()
                            .for_each(|kept| kept.row(first + k, columns, row));
                    });
                });
                for (k, row) in rows.chunks_exact(width).enumerate() {
                    let t = (begin + (first + k) as u64 * period) as f64 * step;
                    while let Some(event) = events.next_if(|event| event.t <= t) {
                        recorder.event(&event)?;
                    }
                    recorder.frame(t, row)?;
                }
            }
            for event in events {
                recorder.event(&event)?;
            }
            if !is_busy {
                if !end.is_multiple_of(period) {
                    let row = &mut window[..width];
                    kept.iter()
                        .for_each(|kept| kept.row(usize::MAX, columns, row));
                    recorder.frame(end as f64 * step, row)?;
                }
                let summary = self.summary(end as f64 * step);
                recorder.finish(&|| serde_json::to_value(&summary).expect("plain data"))?;
                return Ok(summary);
            }
            begin = until;
            progress(begin as f64 * step);
        }
    }

    fn summary(&mut self, duration: f64) -> Summary {
        let flocks = &mut self.flocks;
        let mut told: Vec<(usize, RobotSummary, Option<String>)> = self.pool.install(|| {
            let told = flocks
                .par_iter_mut()
                .flat_map_iter(|flock| flock.summaries());
            told.collect()
        });
        told.sort_by_key(|(place, ..)| *place);
        let error = told.iter().find_map(|(.., error)| error.clone());
        let robots: Vec<RobotSummary> = told.into_iter().map(|(_, robot, _)| robot).collect();
        Summary::of(&self.scenario, &self.header.hash, duration, robots, error)
    }
}

/// How long a robot is about to take, s: along its path, after it has turned on the spot.
fn expected(robot: &Robot, path: Option<&Path>) -> f64 {
    let tuning = robot.controllers().find_map(|(_, one)| one.follower());
    let (Some(path), Some(tuning)) = (path, tuning) else {
        return 0.0;
    };
    let limits = SpeedLimits {
        speed: tuning.speed,
        acceleration: tuning.acceleration,
        lateral_acceleration: tuning.lateral_acceleration,
        yaw_rate: tuning.yaw_rate,
    };
    let turn = wrap_angle(path.heading[0] - robot.pose[2]).abs();
    path.duration(&limits) + turn / tuning.yaw_rate
}

/// Builds a robot; its place among all is still to be said.
fn build(
    loaded: &Loaded,
    mold: &Loaded,
    template: &Template,
    robot: &Robot,
    trial: u64,
    plans: &Plans,
) -> Result<Member, Diagnostics> {
    let name = match robot.count {
        1 => robot.name.clone(),
        _ => format!("{}-{trial}", robot.name),
    };
    let own = individual(loaded, mold, template, robot, trial, &name)?;
    let assembly = assemble(&own, trial, plans, &Values::new(&[]))?;
    let path = assembly.paths.into_iter().next().flatten();
    let expected = expected(&own.scenario.robot[0], path.as_deref());
    Ok(Member {
        place: 0,
        name,
        trial,
        loaded: own,
        integrators: assembly.integrators,
        parts: assembly.parts,
        path: path.map(|path| Path::clone(&path)),
        assignment: assembly.assignments.into_iter().next().flatten(),
        expected,
        is_whole: robot.count == 1,
    })
}

/// A robot of a count with what is drawn for it.
fn individual(
    loaded: &Loaded,
    mold: &Loaded,
    template: &Template,
    robot: &Robot,
    trial: u64,
    name: &str,
) -> Result<Loaded, Diagnostics> {
    if robot.vary.is_empty() {
        return Ok(mold.clone());
    }
    let numbers = drawn(&robot.name, &robot.vary, loaded.scenario.seed, trial);
    let own = template.with(&numbers).map_err(|problem| {
        Diagnostics(vec![Diagnostic {
            file: loaded.file.clone(),
            path: format!("robot.{}.vary: {}", robot.name, problem.path),
            ..problem
        }])
    })?;
    let problems = scenario::check(&own.scenario, &own.folder);
    if problems.is_empty() {
        return Ok(own);
    }
    let told = problems
        .into_iter()
        .map(|(path, problem, hint)| Diagnostic {
            file: loaded.file.clone(),
            at: None,
            path,
            problem: format!("{problem}, drawn for robot {name}"),
            hint: hint.or(Some("draw it from a narrower range".into())),
        });
    Err(Diagnostics(told.collect()))
}

/// Some robots of one kind that move side by side.
trait Flock: Send {
    /// What is recorded of each, by its place.
    fn signals(&self) -> Vec<(usize, Vec<Signal>)>;
    /// Goes on from one tick to another, and keeps the rows between.
    fn advance(&mut self, begin: u64, until: u64);
    /// Whether any robot goes on.
    fn is_busy(&self) -> bool;
    /// The last tick of any robot.
    fn end(&self) -> u64;
    /// Events since they were taken last, with the place of their robot.
    fn take_events(&mut self) -> Vec<(usize, Event)>;
    /// What it wrote down of the stretch that it went last.
    fn kept(&self) -> Kept<'_>;
    /// What became of each, by its place, and what broke it off.
    fn summaries(&mut self) -> Vec<(usize, RobotSummary, Option<String>)>;
}

/// Rows of a flock.
struct Kept<'a> {
    /// Places of its robots among all.
    places: &'a [usize],
    /// Its rows, one after the other, and the last that there is.
    rows: &'a [f64],
    last: &'a [f64],
}

impl Kept<'_> {
    /// Writes a row, or the last one there is, into that of all robots, of which each begins at a column.
    fn row(&self, k: usize, columns: &[usize], row: &mut [f64]) {
        let kept = self.rows.chunks_exact(self.last.len()).nth(k);
        let kept = kept.unwrap_or(self.last);
        let width = kept.len() / self.places.len();
        for (&place, own) in self.places.iter().zip(kept.chunks_exact(width)) {
            let at = columns[place];
            row[at..at + width].copy_from_slice(own);
        }
    }
}

/// A flock in lanes.
struct Lanes<T: Scalar> {
    world: World<T>,
    notes: Notes<T>,
    members: Vec<Known>,
    /// Places of them.
    places: Vec<usize>,
}

/// What is left to know of a member that moves.
struct Known {
    place: usize,
    name: String,
    loaded: Loaded,
    integrators: Vec<String>,
}

/// What a flock writes down.
struct Notes<T: Scalar> {
    meter: Meter<T>,
    /// Recorded columns of the world.
    columns: Vec<usize>,
    /// The last row of each lane, one after the other, and those of this window.
    last: Vec<f64>,
    rows: Vec<f64>,
    /// Whether a row is due.
    is_due: bool,
    events: Vec<(usize, Event)>,
}

impl<T: Scalar> Listener<T> for Notes<T> {
    fn frame(&mut self, t: T, row: &[T], of: T::Mask) -> Result<(), RecordError> {
        self.meter.add(t, row, of);
        let width = self.columns.len();
        for lane in 0..self.last.len() / width {
            if of.lane(lane) {
                for (k, &column) in self.columns.iter().enumerate() {
                    self.last[lane * width + k] = row[column].lane(lane);
                }
            }
        }
        if self.is_due {
            self.rows.extend_from_slice(&self.last);
        }
        Ok(())
    }

    fn event(&mut self, lane: usize, event: &Event) -> Result<(), RecordError> {
        self.events.push((lane, event.clone()));
        Ok(())
    }
}

/// Takes the first of some members, and those beside it that fit, into lanes.
struct Gather<'a> {
    members: &'a mut VecDeque<Member>,
    plans: &'a Plans,
}

impl AnyLanes for Gather<'_> {
    type Output = Box<dyn Flock>;

    fn run<T: Scalar<Single = f64>>(self) -> Box<dyn Flock> {
        let first = &self.members[0];
        let wide = assemble::<T>(&first.loaded, first.trial, self.plans, &Values::new(&[]));
        let world = wide.ok().map(|wide| World::wire(wide.parts));
        match world.filter(|world| T::LANES == 1 || world.fits(&first.parts)) {
            Some(world) => Box::new(Lanes::take(world, self.members)),
            // What lanes are not made for moves by itself.
            None => Box::new(Lanes::<f64>::take_first(self.members, self.plans)),
        }
    }
}

impl Lanes<f64> {
    fn take_first(members: &mut VecDeque<Member>, plans: &Plans) -> Self {
        let first = &members[0];
        let own = assemble::<f64>(&first.loaded, first.trial, plans, &Values::new(&[]));
        let world = World::wire(own.expect("it was assembled before").parts);
        Lanes::take(world, members)
    }
}

impl<T: Scalar<Single = f64>> Lanes<T> {
    /// Fills the lanes of a world of the first member with members that fit.
    fn take(mut world: World<T>, members: &mut VecDeque<Member>) -> Self {
        let first = &members[0];
        let picked = |signal: &Signal| {
            let own = format!("robot.{}.", first.loaded.scenario.robot[0].name);
            let short = signal.path.strip_prefix(&own);
            first.is_whole || short.is_some_and(|short| MOTION.contains(&short))
        };
        let signals = world.signals();
        let columns: Vec<usize> = (0..signals.len())
            .filter(|&k| picked(&signals[k]))
            .collect();
        let meter = Meter::new(&first.loaded.scenario, signals);
        let mut known = Vec::new();
        while known.len() < T::LANES {
            let fits = |next: &Member| T::LANES == 1 || world.fits(&next.parts);
            if !members.front().is_some_and(fits) {
                break;
            }
            let member = members.pop_front().expect("it was looked at");
            world.put(known.len(), member.parts);
            known.push(Known {
                place: member.place,
                name: member.name,
                loaded: member.loaded,
                integrators: member.integrators,
            });
        }
        for lane in known.len()..T::LANES {
            world.clear(lane);
        }
        Lanes {
            notes: Notes {
                meter,
                last: vec![0.0; columns.len() * known.len()],
                columns,
                rows: Vec::new(),
                is_due: false,
                events: Vec::new(),
            },
            world,
            places: known.iter().map(|member| member.place).collect(),
            members: known,
        }
    }
}

impl<T: Scalar> Flock for Lanes<T> {
    fn signals(&self) -> Vec<(usize, Vec<Signal>)> {
        let of = |member: &Known| {
            let own = format!("robot.{}.", member.loaded.scenario.robot[0].name);
            let signals = self.notes.columns.iter().map(|&column| {
                let signal = &self.world.signals()[column];
                let short = signal.path.strip_prefix(&own).unwrap_or(&signal.path);
                let path = format!("robot.{}.{short}", member.name);
                Signal::new(path, &signal.unit)
            });
            (member.place, signals.collect())
        };
        self.members.iter().map(of).collect()
    }

    fn advance(&mut self, begin: u64, until: u64) {
        self.notes.rows.clear();
        let period = self.world.period();
        while self.world.tick() < until && self.is_busy() {
            let tick = self.world.tick();
            self.notes.is_due = tick.is_multiple_of(period) && tick >= begin;
            self.world
                .go(until - tick, &mut self.notes)
                .expect("nothing is written that could fail");
        }
    }

    fn is_busy(&self) -> bool {
        (0..self.members.len()).any(|lane| self.world.runs(lane))
    }

    fn end(&self) -> u64 {
        let ages = (0..self.members.len()).map(|lane| self.world.age(lane));
        ages.max().unwrap_or(0)
    }

    fn take_events(&mut self) -> Vec<(usize, Event)> {
        let members = &self.members;
        let named = |(lane, event): (usize, Event)| {
            let Known { place, name, .. } = &members[lane];
            let robot = name.clone();
            (*place, Event { robot, ..event })
        };
        self.notes.events.drain(..).map(named).collect()
    }

    fn kept(&self) -> Kept<'_> {
        Kept {
            places: &self.places,
            rows: &self.notes.rows,
            last: &self.notes.last,
        }
    }

    fn summaries(&mut self) -> Vec<(usize, RobotSummary, Option<String>)> {
        let Lanes {
            world,
            notes,
            members,
            ..
        } = self;
        let mut told = Vec::new();
        for (lane, member) in members.iter().enumerate() {
            let error = world.take_error(lane);
            let account = Account {
                scenario: &member.loaded.scenario,
                integrators: &member.integrators,
                hash: "",
            };
            let mut summary = account.summary(world, &notes.meter, lane, error.as_ref());
            let mut robot = summary.robots.remove(0);
            robot.name.clone_from(&member.name);
            let error = error.map(|error| format!("{}: {error}", member.name));
            if let Some(error) = &error {
                robot.verdict = Outcome::Stopped;
                robot.reason.clone_from(error);
            }
            told.push((member.place, robot, error));
        }
        told
    }
}
