//! Trials side by side in lanes: what ends leaves its lane to the next.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use appell_model::lanes::AnyLanes;
use appell_model::scalar::Scalar;

use super::{Batch, Manifest, PART, Row};
use crate::build::Values;
use crate::meter::Meter;
use crate::plant::Chosen;
use crate::record::{Event, RecordError};
use crate::run::{Account, Plans, assemble, world};
use crate::scenario::{Diagnostics, Loaded};
use crate::world::{Listener, Parts, World};

/// Rows that wait for a thread.
pub(super) struct Queue<'a> {
    pub manifest: &'a Manifest,
    /// Parts to be run, in order; all but the last of a batch are equally long.
    pub parts: &'a [u64],
    pub next: AtomicU64,
    /// Whether there is no use in going on.
    pub broken: AtomicBool,
}

impl Queue<'_> {
    fn take(&self) -> Option<u64> {
        if self.broken.load(Ordering::Relaxed) {
            return None;
        }
        let at = self.next.fetch_add(1, Ordering::Relaxed);
        let part = self.parts.get(usize::try_from(at / PART).ok()?)?;
        self.manifest.rows_of(*part).nth((at % PART) as usize)
    }
}

/// What a thread does: it runs rows until there are no more, and hands each over.
pub(super) struct Worker<'a> {
    pub batch: &'a Batch,
    pub queue: &'a Queue<'a>,
    pub plans: &'a Plans,
    pub hand_over: &'a dyn Fn(u64, Row),
}

/// A trial, built and ready for a lane.
struct Ready {
    row: u64,
    variant: usize,
    trial: u64,
    loaded: Loaded,
    integrators: Vec<String>,
    chosen: Vec<Chosen>,
    parts: Parts<f64>,
}

/// A trial in its lane.
struct Seat {
    row: u64,
    trial: u64,
    loaded: Loaded,
    integrators: Vec<String>,
}

/// A world of several trials of one variant.
struct Side<T: Scalar> {
    variant: usize,
    world: World<T>,
    meter: Meter<T>,
    seats: Vec<Option<Seat>>,
    /// How many of them are taken.
    taken: usize,
    cycle: u64,
}

impl<T: Scalar> Listener<T> for Meter<T> {
    fn frame(&mut self, t: T, row: &[T], of: T::Mask) -> Result<(), RecordError> {
        self.add(t, row, of);
        Ok(())
    }

    fn event(&mut self, _lane: usize, _event: &Event) -> Result<(), RecordError> {
        Ok(())
    }
}

impl AnyLanes for Worker<'_> {
    type Output = ();

    fn run<T: Scalar<Single = f64>>(self) {
        let mut side: Option<Side<T>> = None;
        // What the lanes at hand are not made for.
        let mut waiting: Option<Ready> = None;
        loop {
            if let Some(side) = &mut side {
                self.fill(side, &mut waiting);
                if side.is_busy() {
                    self.advance(side);
                    continue;
                }
            }
            let Some(next) = waiting.take().or_else(|| self.next()) else {
                return;
            };
            side = self.open(next);
        }
    }
}

impl Worker<'_> {
    /// The next trial that can be built; the others are handed over as they are.
    fn next(&self) -> Option<Ready> {
        loop {
            let row = self.queue.take()?;
            let (variant, trial) = self.batch.manifest.place(row);
            match self.build(row, variant, trial) {
                Ok(ready) => return Some(ready),
                Err(problem) => {
                    let told = self.batch.row((variant, trial), Err(problem));
                    (self.hand_over)(row, told);
                }
            }
        }
    }

    fn build(&self, row: u64, variant: usize, trial: u64) -> Result<Ready, Diagnostics> {
        let loaded = self.batch.sketch(variant, trial)?;
        let assembly = assemble(&loaded, trial, self.plans, &Values::new(&[]))?;
        Ok(Ready {
            row,
            variant,
            trial,
            loaded,
            integrators: assembly.integrators,
            chosen: assembly.chosen,
            parts: assembly.parts,
        })
    }

    /// A world for trials like this one, which runs in its first lane; none where lanes do not help,
    /// and the trial has been run.
    fn open<T: Scalar<Single = f64>>(&self, ready: Ready) -> Option<Side<T>> {
        let is_plain = T::LANES == 1 && !T::IS_NARROW;
        let world = if is_plain {
            let own = assemble::<T>(&ready.loaded, ready.trial, self.plans, &Values::new(&[]));
            own.ok().map(|own| World::wire(own.parts))
        } else {
            let Ready { loaded, trial, .. } = &ready;
            world(loaded, *trial, self.plans, &ready.chosen, &ready.parts)
        };
        let Some(world) = world else {
            self.run_alone(&ready);
            return None;
        };
        let mut side = Side {
            variant: ready.variant,
            meter: Meter::new(&ready.loaded.scenario, world.signals()),
            cycle: world.cycle(),
            world,
            seats: (0..T::LANES).map(|_| None).collect(),
            taken: 1,
        };
        for lane in 1..T::LANES {
            side.world.clear(lane);
        }
        // Set up in numbers of its own a trial would have other bits in single precision than set up
        // in double precision and rounded, as in all other lanes.
        side.seats[0] = Some(ready.seat(|parts| {
            if !is_plain {
                side.world.put(0, parts);
            }
        }));
        Some(side)
    }

    fn run_alone(&self, ready: &Ready) {
        let row = self.batch.trial(ready.variant, ready.trial);
        (self.hand_over)(ready.row, row);
    }

    /// Gives empty lanes their next trials, at a time at which trials can begin.
    fn fill<T: Scalar<Single = f64>>(&self, side: &mut Side<T>, waiting: &mut Option<Ready>) {
        let is_full = side.taken == T::LANES;
        if is_full || waiting.is_some() || !side.world.tick().is_multiple_of(side.cycle) {
            return;
        }
        for lane in 0..T::LANES {
            while side.seats[lane].is_none() {
                let Some(ready) = self.next() else { return };
                if ready.variant != side.variant {
                    *waiting = Some(ready);
                    return;
                }
                if !side.world.fits(&ready.parts) {
                    self.run_alone(&ready);
                    continue;
                }
                side.seats[lane] = Some(ready.seat(|parts| side.world.put(lane, parts)));
                side.taken += 1;
                side.meter.clear(lane);
            }
        }
    }

    /// Goes on until something is due, and hands over what ended.
    fn advance<T: Scalar>(&self, side: &mut Side<T>) {
        let Side { world, meter, .. } = side;
        let limit = side.cycle - world.tick() % side.cycle;
        world
            .go(limit, meter)
            .expect("nothing is written that could fail");
        if world.going() == side.taken {
            return;
        }
        for lane in 0..T::LANES {
            if world.runs(lane) {
                continue;
            }
            let Some(seat) = side.seats[lane].take() else {
                continue;
            };
            side.taken -= 1;
            let error = world.take_error(lane);
            let account = Account {
                scenario: &seat.loaded.scenario,
                integrators: &seat.integrators,
                hash: "",
            };
            let summary = account.summary(world, meter, lane, error.as_ref());
            let row = self.batch.row((side.variant, seat.trial), Ok(summary));
            (self.hand_over)(seat.row, row);
        }
        if !side.is_busy() {
            side.world.skip();
        }
    }
}

impl Ready {
    /// Its seat, for which `put` takes its blocks.
    fn seat(self, put: impl FnOnce(Parts<f64>)) -> Seat {
        put(self.parts);
        Seat {
            row: self.row,
            trial: self.trial,
            loaded: self.loaded,
            integrators: self.integrators,
        }
    }
}

impl<T: Scalar> Side<T> {
    fn is_busy(&self) -> bool {
        self.taken > 0
    }
}

/// What steps of a world with a trial in every lane allocate.
#[cfg(test)]
pub(super) fn allocations<T: Scalar<Single = f64>>(batch: &Batch, steps: u64) -> u64 {
    let plans = Plans::default();
    let built = |trial: u64| {
        let loaded = batch.scenario(0, trial).expect("a scenario");
        let values = Values::new(&[]);
        let parts = assemble::<f64>(&loaded, trial, &plans, &values).expect("blocks");
        (loaded, parts.parts)
    };
    let (loaded, _) = built(0);
    let parts = assemble::<T>(&loaded, 0, &plans, &Values::new(&[])).expect("blocks");
    let mut world = World::wire(parts.parts);
    let mut meter = Meter::new(&loaded.scenario, world.signals());
    for lane in 0..T::LANES {
        let (_, parts) = built(lane as u64);
        assert!(T::LANES == 1 || world.fits(&parts));
        world.put(lane, parts);
    }
    allocation_counter::measure(|| {
        while world.tick() < steps {
            world.go(1, &mut meter).expect("steps");
        }
    })
    .count_total
}
