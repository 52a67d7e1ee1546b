//! Levels that go one trial at a time, as the plant sees them, behind a table of functions: wheels that
//! slip, also on springs, and all levels on uneven ground. Lanes have none of them, and what no one makes is not compiled.

use std::any::Any;
use std::sync::Arc;

use appell_model::dynamics::Dynamics;
use appell_model::following::{Following, Planar};
use appell_model::ground::Ground;
use appell_model::integrate::observe;
use appell_model::kinematic::Kinematic;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::Platform;
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::slip::{Implicit, Loads, Patch, SLIP_OUTPUTS, Slip, SlipError};
use appell_model::stance::{Footing, FootingError, Standing};
use appell_model::suspension::Suspension;
use appell_model::terrain::Terrain;
use appell_model::tire::Tire;

use super::{Method, Numerics, PlantError, fastest, method, senses, undetermined, wheel_rates};
use crate::scenario::Level;

/// The signals of a slipping wheel's contact, in the order of the model's outputs, with their units.
pub(super) const SIGNALS: [(&str, &str); SLIP_OUTPUTS] = [
    ("slip.along", "m/s"),
    ("slip.across", "m/s"),
    ("slip.ratio", "1"),
    ("slip.angle", "rad"),
    ("friction_use", "1"),
    ("slip.power", "W"),
];

/// The motion that a state is to have.
pub(super) struct Motion<'a, T> {
    /// Of the base's origin, base axes, m/s.
    pub velocity: Vec2<T>,
    /// rad/s
    pub yaw_rate: T,
    /// Of the steered wheels, rad/s.
    pub steering: &'a [T],
    /// Of each wheel, rad/s; `None` where they roll.
    pub spin: Option<&'a [T]>,
}

/// A platform at a level, with its method.
pub(super) trait Alone<T: Scalar>: Send {
    fn level(&self) -> Level;
    fn platform(&self) -> &Platform<T>;
    /// Whether contacts carry a plane, over whose edges the robot could tip.
    fn tips(&self) -> bool;
    /// State and modes for a state of the layout, with angles, spin and currents, and a motion.
    fn state(&self, x: &[T], motion: &Motion<'_, T>) -> (Vec<T>, Vec<T>);
    /// Index of height, roll and pitch in the state, on uneven ground.
    fn attitude(&self) -> Option<usize>;
    /// Length of the output.
    fn outputs(&self) -> usize;
    /// Where the outputs of contacts begin, where wheels slip.
    fn contacts(&self) -> Option<usize>;
    /// Where those of springs begin, if there are some.
    fn travel(&self) -> Option<usize> {
        None
    }
    /// Renews height, roll and pitch, or says what keeps it from standing.
    fn rest(&self, x: &mut [T]) -> Result<(), String>;
    /// Advances by steps of the physics, or says what is in the way.
    fn steps(
        &mut self,
        u: &[T],
        dt: f64,
        count: u64,
        x: &mut [T],
        mode: &mut [T],
    ) -> Result<(), String>;
    fn observe(&self, motion_only: bool, x: &[T], u: &[T], mode: &[T], y: &mut [T]);
    fn integrator(&self) -> String;
    /// The length that an adaptive method would take next, s; zero for others.
    fn next_step(&self) -> f64;
    fn set_next_step(&mut self, step: f64);
}

/// What wheels meet: the law of each, and what the ground does to it.
#[derive(Clone, Debug)]
pub struct Contacts<T> {
    /// Contact law of each wheel, for level `slip`.
    pub tires: Vec<Tire<T>>,
    /// Patches of the ground.
    pub patches: Vec<Patch<T>>,
    /// Heights of the ground, where it is uneven.
    pub relief: Option<Arc<Terrain>>,
    /// What the wheels carry the body on, if not stiffly.
    pub springs: Option<Suspension<T>>,
}

/// Joins a platform, contacts and an even ground at level `slip`.
pub(super) fn sliding<T: Scalar>(
    platform: Platform<T>,
    contacts: Contacts<T>,
    ground: Ground<T>,
) -> Result<Box<dyn Alone<T>>, PlantError> {
    Ok(Box::new(Skidding::new(platform, contacts, ground)?))
}

/// What numbers with derivatives cannot stand on.
pub(super) fn underivable<T>(contacts: &Contacts<T>) -> PlantError {
    let (field, problem) = if contacts.relief.is_some() {
        (
            "terrain.kind",
            "must be \"flat\" or \"plane\" here: derivatives know no uneven ground",
        )
    } else {
        (
            "level",
            "must be another here: derivatives know no suspension",
        )
    };
    PlantError {
        field,
        problem: problem.into(),
        hint: "change numbers by hand, or vary them in a batch".into(),
    }
}

/// Joins a platform and contacts with a footing: an uneven ground at any level, springs under slipping
/// wheels on any ground; `None` for numbers that are not plain.
pub(super) fn on_footing<T: Scalar>(
    platform: &Platform<T>,
    contacts: &Contacts<T>,
    ground: &Ground<T>,
    level: Level,
    numerics: Numerics,
    angles: &[f64],
) -> Option<Result<Box<dyn Alone<T>>, PlantError>> {
    let (platform, contacts): (&dyn Any, &dyn Any) = (platform, contacts);
    let made = stood(
        platform.downcast_ref()?,
        contacts.downcast_ref()?,
        Ground {
            gravity: vec2(ground.gravity.x.lane(0), ground.gravity.y.lane(0)),
            gravity_normal: ground.gravity_normal.lane(0),
        },
        level,
        numerics,
        angles,
    );
    let same = |made: Box<dyn Alone<f64>>| -> Box<dyn Any> { Box::new(made) };
    match made.map(same) {
        Ok(made) => Some(Ok(*made.downcast().ok()?)),
        Err(error) => Some(Err(error)),
    }
}

fn stood(
    platform: &Platform<f64>,
    contacts: &Contacts<f64>,
    ground: Ground<f64>,
    level: Level,
    numerics: Numerics,
    angles: &[f64],
) -> Result<Box<dyn Alone<f64>>, PlantError> {
    let what = if contacts.relief.is_some() {
        "uneven ground"
    } else {
        "a suspension"
    };
    let relief = contacts.relief.as_deref().cloned().unwrap_or_default();
    let footing = Footing::new(platform, relief, ground.gravity_normal);
    let mut footing = footing.map_err(|error| PlantError {
        field: "platform",
        problem: match error {
            FootingError::Unsupported => format!("must have three or more wheels that carry it, with the center of mass between them: on {what} it has no height otherwise"),
            FootingError::Trailer(_) => format!("must have no trailer: {what} knows none"),
        },
        hint: if contacts.relief.is_some() {
            "add a caster to its file, or let terrain.kind be \"flat\" or \"plane\"".into()
        } else {
            "add a caster to its file, or leave out wheel.suspension".into()
        },
    })?;
    footing = footing.inclined(ground.gravity);
    if let Some(springs) = &contacts.springs {
        footing = footing.on_springs(platform, springs);
    }
    let (platform, ground) = (platform.clone(), Ground::flat(ground.gravity_normal));
    match level {
        Level::Kinematic => {
            let flat = Kinematic::new(platform).ok_or_else(undetermined)?;
            let radius = fastest(&flat, flat.platform(), angles);
            Ok(Box::new(Follower::new(flat, footing, radius, numerics)?))
        }
        Level::Rolling => {
            let flat = Rolling::new(platform, ground);
            let radius = fastest(&flat, flat.platform(), angles);
            Ok(Box::new(Follower::new(flat, footing, radius, numerics)?))
        }
        Level::Slip => {
            let mut skidding = Skidding::new(platform, contacts.clone(), ground)?;
            skidding.system = skidding.system.on(footing);
            skidding.method = Implicit::new(&skidding.system);
            Ok(Box::new(skidding))
        }
    }
}

/// What keeps a robot from standing, if anything does.
fn fate<T: Scalar>(standing: Standing, platform: &Platform<T>) -> Result<(), String> {
    match standing {
        Standing::Stands => Ok(()),
        Standing::Falls => {
            Err("it tips over: no position of its wheels on this ground carries it".into())
        }
        Standing::Blocked(i) => Err(format!(
            "wheel {} stands before a wall that is higher than its hub",
            platform.wheels()[i].name
        )),
    }
}

/// The slip level and the method that its stiffness asks for.
struct Skidding<T: Scalar> {
    system: Slip<T>,
    method: Implicit<T>,
}

impl<T: Scalar> Skidding<T> {
    fn new(
        platform: Platform<T>,
        contacts: Contacts<T>,
        ground: Ground<T>,
    ) -> Result<Self, PlantError> {
        let system = Slip::new(platform, contacts.tires, ground, Loads::Dynamic);
        let system = system.map_err(|error| PlantError {
            field: "level",
            problem: match error {
                SlipError::Trailer(_) => {
                    "must be another with a trailer: level \"slip\" knows none".into()
                }
                SlipError::SteeredCount(count) => {
                    format!(
                        "must be another with {count} steered wheels: level \"slip\" knows five"
                    )
                }
            },
            hint: "use level \"rolling\"".into(),
        })?;
        let system = system.on_patches(contacts.patches);
        let method = Implicit::new(&system);
        Ok(Skidding { system, method })
    }
}

impl<T: Scalar> Alone<T> for Skidding<T> {
    fn level(&self) -> Level {
        Level::Slip
    }

    fn platform(&self) -> &Platform<T> {
        self.system.platform()
    }

    fn tips(&self) -> bool {
        self.system.support().is_some()
    }

    fn state(&self, x: &[T], motion: &Motion<'_, T>) -> (Vec<T>, Vec<T>) {
        let layout = self.system.layout();
        let mut state = self
            .system
            .rolling_state(x, motion.velocity, motion.yaw_rate);
        for (k, &rate) in motion.steering.iter().enumerate() {
            state[layout.velocity() + layout.eta + k] = rate;
        }
        for (i, &rate) in motion.spin.unwrap_or_default().iter().enumerate() {
            state[self.system.rate(i)] = rate;
        }
        let rates: Vec<T> = (0..layout.wheels)
            .map(|i| state[self.system.rate(i)])
            .collect();
        (state, senses(&rates))
    }

    fn attitude(&self) -> Option<usize> {
        self.system.footing().map(|_| self.system.attitude())
    }

    fn outputs(&self) -> usize {
        self.system.sizes().output
    }

    fn contacts(&self) -> Option<usize> {
        Some(self.system.layout().output())
    }

    fn travel(&self) -> Option<usize> {
        self.system.travel()
    }

    fn rest(&self, x: &mut [T]) -> Result<(), String> {
        fate(self.system.stand(x), self.system.platform())
    }

    fn steps(
        &mut self,
        u: &[T],
        dt: f64,
        count: u64,
        x: &mut [T],
        mode: &mut [T],
    ) -> Result<(), String> {
        for _ in 0..count {
            let found = self.method.steps(&self.system, u, dt, 1, x, mode);
            self.rest(x)?;
            if !found {
                return Err("the forces of the contacts were not found within a step: take a smaller time.step, or softer tires".into());
            }
        }
        Ok(())
    }

    fn observe(&self, _motion_only: bool, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        observe(&self.system, false, x, u, mode, y);
    }

    fn integrator(&self) -> String {
        "implicit of order 2".into()
    }

    fn next_step(&self) -> f64 {
        0.0
    }

    fn set_next_step(&mut self, _step: f64) {}
}

/// A level that rolls, on uneven ground.
struct Follower<S> {
    system: Following<f64, S>,
    method: Method<f64>,
}

impl<S: Planar<f64>> Follower<S> {
    /// The method is chosen by the rate of the fastest mode on even ground, 1/s.
    fn new(
        flat: S,
        footing: Footing<f64>,
        radius: f64,
        numerics: Numerics,
    ) -> Result<Self, PlantError> {
        let system = Following::new(flat, footing);
        let method = method(&system, radius, numerics)?;
        Ok(Follower { system, method })
    }
}

impl<S: Planar<f64>> Alone<f64> for Follower<S> {
    fn level(&self) -> Level {
        if S::FORCES {
            Level::Rolling
        } else {
            Level::Kinematic
        }
    }

    fn platform(&self) -> &Platform<f64> {
        self.system.level().platform()
    }

    fn tips(&self) -> bool {
        S::FORCES
    }

    fn state(&self, x: &[f64], motion: &Motion<'_, f64>) -> (Vec<f64>, Vec<f64>) {
        let platform = self.platform();
        let layout = platform.layout();
        let v = platform.velocity_from_twist(motion.velocity, motion.yaw_rate, motion.steering);
        let mut state = x.to_vec();
        if S::FORCES {
            let at = layout.velocity();
            state[at..at + layout.dof()].copy_from_slice(&v[..layout.dof()]);
        }
        let mode = senses(&wheel_rates(platform, &state, &v));
        (self.system.state(&state), mode)
    }

    fn attitude(&self) -> Option<usize> {
        Some(self.system.attitude())
    }

    fn outputs(&self) -> usize {
        self.system.sizes().output
    }

    fn contacts(&self) -> Option<usize> {
        None
    }

    fn rest(&self, x: &mut [f64]) -> Result<(), String> {
        fate(self.system.rest(x), self.system.level().platform())
    }

    fn steps(
        &mut self,
        u: &[f64],
        dt: f64,
        count: u64,
        x: &mut [f64],
        mode: &mut [f64],
    ) -> Result<(), String> {
        for _ in 0..count {
            self.method.steps(&self.system, u, (dt, 1), x, mode)?;
            self.rest(x)?;
        }
        Ok(())
    }

    fn observe(&self, motion_only: bool, x: &[f64], u: &[f64], mode: &[f64], y: &mut [f64]) {
        observe(&self.system, motion_only, x, u, mode, y);
    }

    fn integrator(&self) -> String {
        self.method.name()
    }

    fn next_step(&self) -> f64 {
        self.method.next_step()
    }

    fn set_next_step(&mut self, step: f64) {
        self.method.set_next_step(step);
    }
}
