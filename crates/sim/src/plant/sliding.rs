//! Level `slip` as the plant sees it, behind a table of functions: lanes have none, and what no one
//! makes is not compiled.

use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::integrate::observe;
use appell_model::planar::Vec2;
use appell_model::platform::Platform;
use appell_model::scalar::Scalar;
use appell_model::slip::{Implicit, Loads, Patch, SLIP_OUTPUTS, Slip, SlipError};
use appell_model::tire::Tire;

/// The signals of a wheel's contact, in the order of the model's outputs, with their units.
pub(super) const SIGNALS: [(&str, &str); SLIP_OUTPUTS] = [
    ("slip.along", "m/s"),
    ("slip.across", "m/s"),
    ("slip.ratio", "1"),
    ("slip.angle", "rad"),
    ("friction_use", "1"),
    ("slip.power", "W"),
];

/// A platform whose wheels slip, with its method.
pub(super) trait Sliding<T: Scalar>: Send {
    fn platform(&self) -> &Platform<T>;
    fn tips(&self) -> bool;
    /// A state of the layout as one of this level that rolls without slip at a twist, base axes.
    fn state(&self, x: &[T], velocity: Vec2<T>, yaw_rate: T) -> Vec<T>;
    /// Index of the spin rate of wheel i.
    fn rate(&self, i: usize) -> usize;
    /// Whether wheel i draws no force.
    fn follows(&self, i: usize) -> bool;
    /// Length of the output, and where the contacts' outputs begin.
    fn outputs(&self) -> (usize, usize);
    /// False where a step was not found.
    fn steps(&mut self, u: &[T], dt: f64, count: u64, x: &mut [T], mode: &mut [T]) -> bool;
    fn observe(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]);
}

/// The model and the method that its stiffness asks for.
struct Skidding<T: Scalar> {
    system: Slip<T>,
    method: Implicit<T>,
}

/// Where wheels slip: the law of each, and what the ground does to it.
#[derive(Clone, Debug)]
pub struct Contacts<T> {
    /// Contact law of each wheel.
    pub tires: Vec<Tire<T>>,
    /// Patches of the ground.
    pub patches: Vec<Patch<T>>,
}

/// Joins a platform, contacts and a ground.
pub(super) fn sliding<T: Scalar>(
    platform: Platform<T>,
    contacts: Contacts<T>,
    ground: Ground<T>,
) -> Result<Box<dyn Sliding<T>>, SlipError> {
    let system = Slip::new(platform, contacts.tires, ground, Loads::Dynamic)?;
    let system = system.on_patches(contacts.patches);
    let method = Implicit::new(&system);
    Ok(Box::new(Skidding { system, method }))
}

impl<T: Scalar> Sliding<T> for Skidding<T> {
    fn platform(&self) -> &Platform<T> {
        self.system.platform()
    }

    fn tips(&self) -> bool {
        self.system.support().is_some()
    }

    fn state(&self, x: &[T], velocity: Vec2<T>, yaw_rate: T) -> Vec<T> {
        self.system.rolling_state(x, velocity, yaw_rate)
    }

    fn rate(&self, i: usize) -> usize {
        self.system.rate(i)
    }

    fn follows(&self, i: usize) -> bool {
        self.system.follows(i)
    }

    fn outputs(&self) -> (usize, usize) {
        (self.system.sizes().output, self.system.layout().output())
    }

    fn steps(&mut self, u: &[T], dt: f64, count: u64, x: &mut [T], mode: &mut [T]) -> bool {
        self.method.steps(&self.system, u, dt, count, x, mode)
    }

    fn observe(&self, x: &[T], u: &[T], mode: &[T], y: &mut [T]) {
        observe(&self.system, false, x, u, mode, y);
    }
}
