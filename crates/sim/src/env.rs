//! An environment for learning: many trials of a scenario side by side, commanded from outside.
//!
//! The conventions are those of Gymnasium's vector environments: observations and actions are
//! contiguous arrays, environment after environment; an environment that ended (by a verdict:
//! `terminated`, by its time: `truncated`) begins anew at the step after, whose action counts for
//! nothing and whose reward is 0. Each environment has its own seed, and counts its episodes: what
//! happens in it depends on them and on its actions alone, not on its neighbors.

use std::path::Path;

use appell_model::lanes::{AnyLanes, dispatch};
use appell_model::scalar::Scalar;
use rayon::prelude::*;

use crate::build::Values;
use crate::judge::Verdict;
use crate::record::{Event, RecordError};
use crate::run::{Plans, assemble};
use crate::scenario::{self, Diagnostic, Diagnostics, Loaded, Overrides};
use crate::signal::Signal;
use crate::world::{Listener, Parts, World};

/// What an environment is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Number of environments.
    pub count: usize,
    /// Paths of the signals that are observed.
    pub observe: Vec<String>,
    /// Time between two actions, s.
    pub interval: f64,
    /// Most environments that share registers; see [`appell_model::lanes::widest`].
    pub lanes: usize,
}

/// Environments side by side.
pub struct BatchEnv {
    actions: Vec<Signal>,
    observations: Vec<Signal>,
    groups: Vec<Box<dyn Group>>,
    count: usize,
    width: usize,
}

/// What a step gives, environment after environment; the caller's own arrays, which are filled.
pub struct Step<'a> {
    /// Observations, `count` × number of observed signals.
    pub observations: &'a mut [f64],
    /// 1 where the task was passed at this step, −1 where it failed, else 0.
    pub rewards: &'a mut [f64],
    /// Where the task has its verdict.
    pub terminated: &'a mut [bool],
    /// Where time is up, or the state is no longer finite.
    pub truncated: &'a mut [bool],
}

/// Environments that share a world.
trait Group: Send {
    fn reset(&mut self, seeds: &[u64], observations: &mut [f64]);
    fn step(&mut self, actions: &[f64], step: Step<'_>);
}

impl BatchEnv {
    /// Environments of a scenario, of which the channels with the signal `external` are the actions.
    ///
    /// # Errors
    /// The scenario is wrong, has no such channels, or no such signals to observe.
    pub fn new(
        file: &Path,
        overrides: &Overrides,
        settings: &Settings,
    ) -> Result<BatchEnv, Diagnostics> {
        let loaded = scenario::load(file, overrides)?;
        for robot in &loaded.scenario.robot {
            let stands = !robot.standby.is_empty() || !robot.model.is_empty();
            if stands || robot.plugins().next().is_some() {
                return Err(crate::run::refuse(
                    &loaded,
                    format!("robot.{}.controller", robot.name),
                    "must be built in, with none that stands by, where episodes repeat".into(),
                    "command it from outside, by channels of kind \"external\"".into(),
                ));
            }
        }
        let assembly = assemble::<f64>(&loaded, 0, &Plans::default(), &Values::new(&[]))?;
        let actions = assembly.outsides;
        // Not every model runs in lanes: an adaptive step is as long as one trial alone lets it be.
        let likeness = Likeness {
            loaded: &loaded,
            parts: &assembly.parts,
        };
        let lanes = match dispatch(settings.lanes, likeness) {
            true => settings.lanes,
            false => 1,
        };
        let world = World::wire(assembly.parts);
        let refuse = |path: &str, problem: String, hint: String| {
            Diagnostics(vec![Diagnostic {
                file: loaded.file.clone(),
                at: None,
                path: path.to_owned(),
                problem,
                hint: Some(hint),
            }])
        };
        if actions.is_empty() {
            return Err(refuse(
                "robot.controller.channel",
                "must have a channel with a signal of kind \"external\", got none".into(),
                "actions are what comes from outside".into(),
            ));
        }
        let mut observed = Vec::new();
        for path in &settings.observe {
            let Some(column) = world.column(path) else {
                let known: Vec<&str> = world.signals().iter().map(|s| s.path.as_str()).collect();
                let problem = format!("must be signals of the scenario, got \"{path}\"");
                return Err(refuse(
                    "observe",
                    problem,
                    format!("there are: {}", known.join(", ")),
                ));
            };
            observed.push(column);
        }
        let interval = (settings.interval / loaded.scenario.time.step).round();
        let cycle = world.cycle();
        let exact = (interval * loaded.scenario.time.step - settings.interval).abs()
            <= 1e-9 * settings.interval;
        if !exact || interval < 1.0 || !(interval as u64).is_multiple_of(cycle) {
            let whole = cycle as f64 * loaded.scenario.time.step;
            return Err(refuse(
                "interval",
                format!(
                    "must be a multiple of {whole} s, after which everything falls due together, got {} s",
                    settings.interval
                ),
                "periods of sensors, controller, judge and recording count".into(),
            ));
        }
        if settings.count == 0 {
            return Err(refuse(
                "count",
                "must be at least 1, got 0".into(),
                "give the number of environments".into(),
            ));
        }
        let maker = Maker {
            loaded: &loaded,
            actions: &actions,
            observed: &observed,
            interval: interval as u64,
            count: settings.count,
        };
        Ok(BatchEnv {
            groups: dispatch(lanes, maker),
            observations: observed
                .iter()
                .map(|&column| world.signals()[column].clone())
                .collect(),
            count: settings.count,
            width: dispatch(lanes, Width),
            actions,
        })
    }

    /// Number of environments.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Names and units of an action.
    pub fn actions(&self) -> &[Signal] {
        &self.actions
    }

    /// Names and units of an observation.
    pub fn observations(&self) -> &[Signal] {
        &self.observations
    }

    /// Begins a first episode in every environment, each with its seed.
    ///
    /// # Panics
    /// If the arrays have other lengths than [`BatchEnv::count`] says.
    pub fn reset(&mut self, seeds: &[u64], observations: &mut [f64]) {
        let seen = self.observations.len();
        assert_eq!(seeds.len(), self.count, "a seed for each environment");
        assert_eq!(observations.len(), self.count * seen, "observations");
        self.groups
            .par_iter_mut()
            .zip(seeds.par_chunks(self.width))
            .zip(observations.par_chunks_mut((self.width * seen).max(1)))
            .for_each(|((group, seeds), observations)| group.reset(seeds, observations));
    }

    /// Holds the actions, environment after environment, for an interval.
    ///
    /// # Panics
    /// If the arrays have other lengths than [`BatchEnv::count`] says.
    pub fn step(&mut self, actions: &[f64], step: Step<'_>) {
        let (seen, told) = (self.observations.len(), self.actions.len());
        assert_eq!(actions.len(), self.count * told, "actions");
        assert_eq!(step.observations.len(), self.count * seen, "observations");
        assert_eq!(step.rewards.len(), self.count, "rewards");
        assert_eq!(step.terminated.len(), self.count, "terminated");
        assert_eq!(step.truncated.len(), self.count, "truncated");
        let width = self.width;
        self.groups
            .par_iter_mut()
            .zip(actions.par_chunks(width * told))
            .zip(step.observations.par_chunks_mut((width * seen).max(1)))
            .zip(step.rewards.par_chunks_mut(width))
            .zip(step.terminated.par_chunks_mut(width))
            .zip(step.truncated.par_chunks_mut(width))
            .for_each(
                |(((((group, actions), observations), rewards), terminated), truncated)| {
                    let step = Step {
                        observations,
                        rewards,
                        terminated,
                        truncated,
                    };
                    group.step(actions, step);
                },
            );
    }
}

/// Number of lanes.
struct Width;

impl AnyLanes for Width {
    type Output = usize;

    fn run<T: Scalar<Single = f64>>(self) -> usize {
        T::LANES
    }
}

/// Whether a world in lanes is the like of one of a single trial.
struct Likeness<'a> {
    loaded: &'a Loaded,
    parts: &'a Parts<f64>,
}

impl AnyLanes for Likeness<'_> {
    type Output = bool;

    fn run<T: Scalar<Single = f64>>(self) -> bool {
        let wide = assemble::<T>(self.loaded, 0, &Plans::default(), &Values::new(&[]));
        wide.is_ok_and(|wide| World::wire(wide.parts).fits(self.parts))
    }
}

struct Maker<'a> {
    loaded: &'a Loaded,
    actions: &'a [Signal],
    observed: &'a [usize],
    interval: u64,
    count: usize,
}

impl AnyLanes for Maker<'_> {
    type Output = Vec<Box<dyn Group>>;

    fn run<T: Scalar<Single = f64>>(self) -> Vec<Box<dyn Group>> {
        let group = |first: usize| -> Box<dyn Group> {
            let plans = Plans::default();
            let assembly = assemble::<T>(self.loaded, 0, &plans, &Values::new(&[]));
            let mut world = World::wire(assembly.expect("built once already").parts);
            world.leave_out(self.observed);
            let column = |signal: &Signal| world.column(&signal.path).expect("wired alike");
            Box::new(Side {
                actions: self.actions.iter().map(column).collect(),
                observed: self.observed.to_vec(),
                interval: self.interval,
                end: (self.loaded.scenario.time.duration / self.loaded.scenario.time.step).round()
                    as u64,
                seats: vec![
                    Seat {
                        seed: 0,
                        episode: 0,
                        ended: true,
                    };
                    T::LANES.min(self.count - first)
                ],
                loaded: self.loaded.clone(),
                plans,
                world,
            })
        };
        (0..self.count).step_by(T::LANES).map(group).collect()
    }
}

/// An environment in its lane.
#[derive(Clone, Copy)]
struct Seat {
    seed: u64,
    episode: u64,
    /// Whether its episode has ended, so that the next step begins another.
    ended: bool,
}

struct Side<T: Scalar> {
    world: World<T>,
    loaded: Loaded,
    plans: Plans,
    actions: Vec<usize>,
    observed: Vec<usize>,
    interval: u64,
    end: u64,
    seats: Vec<Seat>,
}

/// Listens to nothing.
struct Deaf;

impl<T: Scalar> Listener<T> for Deaf {
    fn frame(&mut self, _t: T, _row: &[T], _of: T::Mask) -> Result<(), RecordError> {
        Ok(())
    }

    fn event(&mut self, _lane: usize, _event: &Event) -> Result<(), RecordError> {
        Ok(())
    }
}

impl<T: Scalar<Single = f64>> Side<T> {
    /// Begins an episode in a lane.
    fn begin(&mut self, lane: usize) {
        let seat = &mut self.seats[lane];
        seat.ended = false;
        self.loaded.scenario.seed = seat.seed;
        let assembly = assemble::<f64>(&self.loaded, seat.episode, &self.plans, &Values::new(&[]));
        seat.episode += 1;
        self.world
            .put(lane, assembly.expect("built once already").parts);
    }

    fn observe(&self, lane: usize, observations: &mut [f64]) {
        let width = self.observed.len();
        for (k, &column) in self.observed.iter().enumerate() {
            observations[lane * width + k] = self.world.row()[column].lane(lane);
        }
    }
}

impl<T: Scalar<Single = f64>> Group for Side<T> {
    fn reset(&mut self, seeds: &[u64], observations: &mut [f64]) {
        for lane in 0..T::LANES {
            self.world.clear(lane);
        }
        // Nothing has been sensed at this tick.
        self.world.skip();
        for (lane, &seed) in seeds.iter().enumerate() {
            self.seats[lane] = Seat {
                seed,
                episode: 0,
                ended: false,
            };
            self.begin(lane);
        }
        self.world.sense();
        for lane in 0..self.seats.len() {
            self.observe(lane, observations);
        }
    }

    fn step(&mut self, actions: &[f64], step: Step<'_>) {
        let width = self.actions.len();
        let mut begins = [false; 8];
        for lane in 0..self.seats.len() {
            begins[lane] = self.seats[lane].ended;
            // A wrong action is none.
            for k in 0..width {
                let action = actions[lane * width + k];
                let action = if action.is_finite() { action } else { 0.0 };
                self.world.write(lane, self.actions[k], action);
            }
        }
        let target = self.world.tick() + self.interval;
        while self.world.tick() < target {
            let limit = target - self.world.tick();
            let goes_on = self.world.go(limit, &mut Deaf);
            if !goes_on.expect("nothing is written that could fail") {
                self.world.skip_to(target);
            }
        }
        for lane in 0..self.seats.len() {
            let error = self.world.take_error(lane).is_some();
            let verdict = self.world.verdict(lane);
            let decided = verdict.is_some_and(|verdict| verdict != Verdict::Running);
            step.terminated[lane] = decided && !begins[lane];
            step.truncated[lane] =
                !begins[lane] && !decided && (error || self.world.age(lane) >= self.end);
            step.rewards[lane] = match verdict {
                Some(Verdict::Passed) if !begins[lane] => 1.0,
                Some(Verdict::Failed) if !begins[lane] => -1.0,
                _ => 0.0,
            };
            self.seats[lane].ended = step.terminated[lane] || step.truncated[lane];
            if self.seats[lane].ended {
                self.world.clear(lane);
            }
        }
        for lane in 0..self.seats.len() {
            if begins[lane] {
                self.world.clear(lane);
                self.begin(lane);
            }
        }
        self.world.sense();
        for lane in 0..self.seats.len() {
            self.observe(lane, step.observations);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Memory;
    use crate::run::Run;

    const SIGNALS: &str = r#"{ kind = "signals", channel = [
        { to = "forward", signal = { kind = "external" } },
        { to = "yaw_rate", signal = { kind = "external" } }] }"#;
    const ODOMETRY: &str = r#"[{ kind = "odometry", period = 0.01, angle_std = 0.01 }]"#;

    fn overrides(controller: &str) -> Vec<(String, String)> {
        [
            ("time.duration", "1.5"),
            ("robot.tri.pose", "[1.0, 1.0, 0.0]"),
            ("robot.tri.sensor", ODOMETRY),
            ("robot.tri.controller", controller),
        ]
        .map(|(path, value)| (path.to_owned(), value.to_owned()))
        .to_vec()
    }

    fn scenario() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/homing.toml")
    }

    const OBSERVE: [&str; 3] = [
        "robot.tri.pose.x",
        "robot.tri.pose.yaw",
        "robot.tri.sensor.odometry.x",
    ];

    fn make(count: usize, lanes: usize) -> BatchEnv {
        make_with(count, lanes, &overrides(SIGNALS))
    }

    fn make_with(count: usize, lanes: usize, overrides: &Overrides) -> BatchEnv {
        let settings = Settings {
            count,
            observe: OBSERVE.map(str::to_owned).to_vec(),
            interval: 0.1,
            lanes,
        };
        BatchEnv::new(&scenario(), overrides, &settings).unwrap_or_else(|error| panic!("{error}"))
    }

    /// All observations of steps with the same actions in every environment.
    fn drive(env: &mut BatchEnv, steps: usize) -> (Vec<Vec<f64>>, Vec<Vec<bool>>) {
        let count = env.count();
        let seeds: Vec<u64> = (0..count as u64).map(|k| 100 + k).collect();
        let mut observations = vec![0.0; 3 * count];
        env.reset(&seeds, &mut observations);
        let mut seen = vec![observations.clone()];
        let mut ends = Vec::new();
        let (mut rewards, mut terminated) = (vec![0.0; count], vec![false; count]);
        let mut truncated = vec![false; count];
        for _ in 0..steps {
            let actions = [0.4, 0.3].repeat(count);
            let step = Step {
                observations: &mut observations,
                rewards: &mut rewards,
                terminated: &mut terminated,
                truncated: &mut truncated,
            };
            env.step(&actions, step);
            seen.push(observations.clone());
            ends.push(truncated.clone());
            assert!(terminated.iter().all(|end| !end));
        }
        (seen, ends)
    }

    #[test]
    fn invariant_environments_do_not_depend_on_lanes_or_neighbors() {
        let (alone, ends) = drive(&mut make(11, 1), 20);
        for (count, lanes) in [(11, 4), (11, 8), (3, 8)] {
            let (seen, _) = drive(&mut make(count, lanes), 20);
            for (a, b) in alone.iter().zip(&seen) {
                for (a, b) in a.iter().zip(b) {
                    assert_eq!(a.to_bits(), b.to_bits());
                }
            }
        }
        // Noise differs between environments, and after 1.5 s, 15 steps, each begins anew.
        assert!(alone[5][2].to_bits() != alone[5][5].to_bits());
        assert!(ends[14].iter().all(|end| *end) && !ends[13][0] && !ends[15][0]);
        assert_eq!(alone[16][..2], alone[0][..2]);
        assert!(alone[17][0] > alone[16][0]);
        assert!(
            alone[3][2].to_bits() != alone[19][2].to_bits(),
            "other noise"
        );
    }

    /// Without a sensor that reads the wheels energies are found only where they are observed.
    #[test]
    fn invariant_what_is_observed_changes_nothing_else() {
        let mut set = overrides(SIGNALS);
        set.retain(|(path, _)| path != "robot.tri.sensor");
        let observed = |third: &str| {
            let settings = Settings {
                count: 5,
                observe: [OBSERVE[0], OBSERVE[1], third].map(str::to_owned).to_vec(),
                interval: 0.1,
                lanes: 8,
            };
            let env = BatchEnv::new(&scenario(), &set, &settings);
            drive(&mut env.unwrap_or_else(|error| panic!("{error}")), 12).0
        };
        let speed = observed("robot.tri.twist.forward");
        let energy = observed("robot.tri.energy.supplied");
        for (a, b) in speed.iter().zip(&energy) {
            for (a, b) in a.chunks(3).zip(b.chunks(3)) {
                assert_eq!(a[..2], b[..2]);
            }
        }
        assert!(energy[9][2] > 0.01);
    }

    #[test]
    fn invariant_an_adaptive_step_does_not_depend_on_lanes() {
        let mut set = overrides(SIGNALS);
        set.push(("time.integrator".into(), "adaptive".into()));
        let [(alone, _), (many, _)] = [1, 8].map(|lanes| drive(&mut make_with(3, lanes, &set), 6));
        assert_eq!(alone, many);
    }

    /// An environment is the run of its scenario with the same commands, its seed and its episode.
    #[test]
    fn invariant_an_environment_is_a_run() {
        let constant = SIGNALS
            .replacen(
                "{ kind = \"external\" }",
                "{ kind = \"constant\", value = 0.4 }",
                1,
            )
            .replacen(
                "{ kind = \"external\" }",
                "{ kind = \"constant\", value = 0.3 }",
                1,
            );
        let mut set = overrides(&constant);
        set.push(("seed".into(), "102".into()));
        let loaded = scenario::load(&scenario(), &set).unwrap_or_else(|e| panic!("{e}"));
        let mut run = Run::new(&loaded, 0).unwrap_or_else(|e| panic!("{e}"));
        let mut memory = Memory::bounded(100_000);
        run.execute(&mut memory, &mut |_| {}).expect("runs");
        let recording = memory.into_recording();
        let (seen, _) = drive(&mut make(5, 8), 14);
        for (k, path) in OBSERVE.iter().enumerate() {
            let column = recording
                .header
                .signals
                .iter()
                .position(|s| s.path == *path);
            let column = &recording.columns[column.expect("recorded")];
            for step in 1..=14 {
                let row = recording
                    .times
                    .iter()
                    .position(|t| (t - 0.1 * step as f64).abs() < 1e-9)
                    .expect("recorded");
                assert_eq!(
                    seen[step][3 * 2 + k].to_bits(),
                    column[row].to_bits(),
                    "{path}"
                );
            }
        }
    }

    #[test]
    fn refusal_of_settings() {
        let settings = Settings {
            count: 2,
            observe: vec!["robot.tri.pose.z".into()],
            interval: 0.1,
            lanes: 8,
        };
        let make = |settings: &Settings, controller: &str| {
            let made = BatchEnv::new(&scenario(), &overrides(controller), settings);
            made.err().expect("a refusal").to_string()
        };
        assert!(make(&settings, SIGNALS).contains("robot.tri.pose.z"));
        let odd = Settings {
            observe: Vec::new(),
            interval: 0.015,
            ..settings.clone()
        };
        assert!(make(&odd, SIGNALS).contains("multiple of 0.01 s"));
        let inside = r#"{ kind = "signals", channel = [] }"#;
        assert!(make(&odd, inside).contains("external"));
    }
}
