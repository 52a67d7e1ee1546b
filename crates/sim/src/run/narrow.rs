//! Runs in single precision.

use std::sync::Arc;

use appell_model::lanes::AnyLanes;
use appell_model::lanes::narrow;
use appell_model::scalar::Scalar;

use super::{Account, Assembly, PROGRESS_TICKS, Plans, Run, Summary, assemble, refuse};
use crate::build::Values;
use crate::meter::Meter;
use crate::plant::Chosen;
use crate::record::{Event, RecordError, Recorder};
use crate::scenario::{Diagnostics, Loaded, Precision};
use crate::world::{Listener, Parts, SimError, World};

/// A run in single precision: the bits of a trial of a batch in that precision.
///
/// What is set up is set up in double precision, and then rounded; from there on all of the loop,
/// sensors, controllers, dynamics, judges and figures, has numbers of seven digits.
pub struct NarrowRun {
    /// The run in double precision, of which only the description is used.
    run: Run,
    loaded: Loaded,
    trial: u64,
    plans: Arc<Plans>,
}

/// A world of lanes that are made for trials like one, whose robots are stepped like this; none where
/// they do not fit it.
pub(crate) fn world<T: Scalar<Single = f64>>(
    loaded: &Loaded,
    trial: u64,
    plans: &Plans,
    chosen: &[Chosen],
    parts: &Parts<f64>,
) -> Option<World<T>> {
    let wide = assemble::<T>(loaded, trial, plans, &Values::stepped_by(chosen)).ok()?;
    let world = World::wire(wide.parts);
    world.fits(parts).then_some(world)
}

impl NarrowRun {
    /// Builds the world of a checked scenario, for a trial of its seed.
    ///
    /// # Errors
    /// It makes no world, or has something that single precision does not know.
    pub fn new(loaded: &Loaded, trial: u64) -> Result<NarrowRun, Diagnostics> {
        NarrowRun::planned(loaded, trial, &Arc::default(), "precision")
    }

    /// The same with ways that are known already, where a key of the scenario, or an option, asks for
    /// it.
    pub(crate) fn planned(
        loaded: &Loaded,
        trial: u64,
        plans: &Arc<Plans>,
        asked_by: &str,
    ) -> Result<NarrowRun, Diagnostics> {
        let (run, _) = Run::made(loaded, trial, plans, Precision::F32)?;
        let made = NarrowRun {
            run,
            loaded: loaded.clone(),
            trial,
            plans: plans.clone(),
        };
        let is_possible = loaded.scenario.change.is_empty() && narrow::dispatch(1, Fits(&made));
        if !is_possible {
            return Err(refuse(
                loaded,
                asked_by.into(),
                "must be \"f64\" here: single precision knows neither level \"slip\", uneven ground, \
                 adaptive steps, changes of numbers, nor controllers and models that take turns"
                    .into(),
                "leave it out, or the rest".into(),
            ));
        }
        Ok(made)
    }

    /// The scenario that is run.
    pub fn scenario(&self) -> &crate::scenario::Scenario {
        &self.run.scenario
    }

    fn parts(&self) -> Result<Assembly<f64>, Diagnostics> {
        assemble(&self.loaded, self.trial, &self.plans, &Values::new(&[]))
    }

    /// Steps to the end, into `recorder`; `progress` is told the time now and then.
    ///
    /// # Errors
    /// The recording could not be written.
    pub fn execute(
        &self,
        recorder: &mut dyn Recorder,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Summary, SimError> {
        narrow::dispatch(
            1,
            Execute {
                of: self,
                recorder,
                progress,
            },
        )
    }

    /// A world with the trial in it.
    fn world<T: Scalar<Single = f64>>(&self) -> Option<World<T>> {
        let one = self.parts().ok()?;
        let (loaded, trial) = (&self.loaded, self.trial);
        let mut world = world(loaded, trial, &self.plans, &one.chosen, &one.parts)?;
        world.put(0, one.parts);
        Some(world)
    }
}

/// Whether a trial finds its place.
struct Fits<'a>(&'a NarrowRun);

impl AnyLanes for Fits<'_> {
    type Output = bool;

    fn run<T: Scalar<Single = f64>>(self) -> bool {
        self.0.world::<T>().is_some()
    }
}

struct Execute<'a> {
    of: &'a NarrowRun,
    recorder: &'a mut dyn Recorder,
    progress: &'a mut dyn FnMut(f64),
}

impl AnyLanes for Execute<'_> {
    type Output = Result<Summary, SimError>;

    fn run<T: Scalar<Single = f64>>(self) -> Self::Output {
        let Execute {
            of,
            recorder,
            progress,
        } = self;
        let run = &of.run;
        let mut world = of.world::<T>().expect("it fitted before");
        let mut meter = Meter::new(&run.scenario, world.signals());
        recorder.begin(&run.header)?;
        let mut listener = Rows {
            meter: &mut meter,
            recorder,
            row: vec![0.0; world.signals().len()],
        };
        let mut shown = 0;
        while world.go(PROGRESS_TICKS, &mut listener)? {
            if world.tick() - shown >= PROGRESS_TICKS {
                shown = world.tick();
                progress(world.time(0));
            }
        }
        let error = world.take_error(0);
        let account = Account {
            scenario: &run.scenario,
            integrators: &run.integrators,
            hash: &run.header.hash,
        };
        let summary = account.summary(&world, &meter, 0, error.as_ref());
        recorder.finish(&|| serde_json::to_value(&summary).expect("plain data"))?;
        Ok(summary)
    }
}

/// Measures a run, and hands its rows on in double precision.
struct Rows<'a, T> {
    meter: &'a mut Meter<T>,
    recorder: &'a mut dyn Recorder,
    row: Vec<f64>,
}

impl<T: Scalar> Listener<T> for Rows<'_, T> {
    fn frame(&mut self, t: T, row: &[T], of: T::Mask) -> Result<(), RecordError> {
        self.meter.add(t, row, of);
        for (value, number) in self.row.iter_mut().zip(row) {
            *value = number.lane(0);
        }
        self.recorder.frame(t.lane(0), &self.row)
    }

    fn event(&mut self, _lane: usize, event: &Event) -> Result<(), RecordError> {
        self.recorder.event(event)
    }
}
