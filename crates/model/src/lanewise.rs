//! Putting plain values into lanes: how a trial enters a batch.

use crate::drive::{DcMotor, Drive};
use crate::ground::Ground;
use crate::planar::Vec2;
use crate::platform::Body;
use crate::scalar::Scalar;
use crate::wheel::{Rim, Steering, Wheel, WheelFrame};

/// Something with a value per lane, and its plain form with a single one.
///
/// Lanes share one structure and differ in their numbers. What decides on structure, here or where
/// equations are set up, asks whether a number is zero; so numbers of one place must be zero in all
/// lanes or in none.
pub trait Lanewise {
    /// The same with plain numbers.
    type One;
    /// Whether the plain form has this structure.
    fn fits(&self, one: &Self::One) -> bool;
    /// Puts the plain form into a lane; it must fit.
    fn put(&mut self, lane: usize, one: &Self::One);
}

impl<T: Scalar> Lanewise for T {
    type One = f64;

    fn fits(&self, one: &f64) -> bool {
        (self.lane(0) == 0.0) == (*one == 0.0)
    }

    fn put(&mut self, lane: usize, one: &f64) {
        let before = *self;
        *self = T::from_lanes(|i| if i == lane { *one } else { before.lane(i) });
    }
}

/// What is the same in all lanes.
macro_rules! shared {
    ($($type:ty),*) => {
        $(impl Lanewise for $type {
            type One = $type;

            fn fits(&self, one: &$type) -> bool {
                self == one
            }

            fn put(&mut self, _lane: usize, _one: &$type) {}
        })*
    };
}

shared!(bool, u32, u64, usize, String);

/// A choice that is the same in all lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alike<A>(pub A);

impl<A: PartialEq> Lanewise for Alike<A> {
    type One = Alike<A>;

    fn fits(&self, one: &Alike<A>) -> bool {
        self == one
    }

    fn put(&mut self, _lane: usize, _one: &Alike<A>) {}
}

impl<A: Lanewise> Lanewise for Vec<A> {
    type One = Vec<A::One>;

    fn fits(&self, one: &Self::One) -> bool {
        self.len() == one.len() && self.iter().zip(one).all(|(a, b)| a.fits(b))
    }

    fn put(&mut self, lane: usize, one: &Self::One) {
        for (a, b) in self.iter_mut().zip(one) {
            a.put(lane, b);
        }
    }
}

impl<A: Lanewise, const N: usize> Lanewise for [A; N] {
    type One = [A::One; N];

    fn fits(&self, one: &Self::One) -> bool {
        self.iter().zip(one).all(|(a, b)| a.fits(b))
    }

    fn put(&mut self, lane: usize, one: &Self::One) {
        for (a, b) in self.iter_mut().zip(one) {
            a.put(lane, b);
        }
    }
}

impl<A: Lanewise> Lanewise for Option<A> {
    type One = Option<A::One>;

    fn fits(&self, one: &Self::One) -> bool {
        match (self, one) {
            (Some(a), Some(b)) => a.fits(b),
            (None, None) => true,
            _ => false,
        }
    }

    fn put(&mut self, lane: usize, one: &Self::One) {
        if let (Some(a), Some(b)) = (self, one) {
            a.put(lane, b);
        }
    }
}

/// A structure whose fields are [`Lanewise`], each by itself; those of its state, which change within
/// a trial or follow from the others, fit whatever their numbers.
#[macro_export]
macro_rules! lanewise {
    (
        $name:ident $([$($size:ident),*])? { $($field:ident),* $(,)? }
        $(state { $($state:ident),* $(,)? })?
    ) => {
        impl<T: $crate::scalar::Scalar $($(, const $size: usize)*)?> $crate::lanewise::Lanewise
            for $name<T $($(, $size)*)?>
        {
            type One = $name<f64 $($(, $size)*)?>;

            fn fits(&self, one: &Self::One) -> bool {
                let _ = one;
                true $(&& $crate::lanewise::Lanewise::fits(&self.$field, &one.$field))*
            }

            fn put(&mut self, lane: usize, one: &Self::One) {
                $($crate::lanewise::Lanewise::put(&mut self.$field, lane, &one.$field);)*
                $($($crate::lanewise::Lanewise::put(&mut self.$state, lane, &one.$state);)*)?
            }
        }
    };
}

lanewise!(Vec2 { x, y });
lanewise!(Body {
    mass,
    inertia_com,
    center_of_mass,
    com_height
});
lanewise!(Ground {
    gravity,
    gravity_normal
});
lanewise!(DcMotor {
    resistance,
    inductance,
    torque_constant,
    back_emf_constant,
    gear_ratio,
    gear_efficiency,
    voltage_max,
    current_max,
});
lanewise!(Wheel {
    name,
    mount,
    radius,
    steering,
    rim,
    mass,
    inertia_vertical,
    spin_inertia,
    viscous,
    pivot_viscous,
    dry_friction,
    friction_rounding,
    brake,
    stiffness,
    drive,
});

lanewise!(WheelFrame {} state { forward, left, contact });

impl<T: Scalar> Lanewise for Drive<T> {
    type One = Drive<f64>;

    fn fits(&self, one: &Drive<f64>) -> bool {
        match (self, one) {
            (Drive::None, Drive::None) => true,
            (Drive::Rate { rate_max: a }, Drive::Rate { rate_max: b })
            | (Drive::Torque { torque_max: a }, Drive::Torque { torque_max: b }) => a.fits(b),
            (Drive::DcMotor(a), Drive::DcMotor(b)) => a.fits(b),
            _ => false,
        }
    }

    fn put(&mut self, lane: usize, one: &Drive<f64>) {
        match (self, one) {
            (Drive::Rate { rate_max: a }, Drive::Rate { rate_max: b })
            | (Drive::Torque { torque_max: a }, Drive::Torque { torque_max: b }) => a.put(lane, b),
            (Drive::DcMotor(a), Drive::DcMotor(b)) => a.put(lane, b),
            _ => {}
        }
    }
}

impl<T: Scalar> Lanewise for Steering<T> {
    type One = Steering<f64>;

    fn fits(&self, one: &Steering<f64>) -> bool {
        match (self, one) {
            (Steering::Driven, Steering::Driven) => true,
            (Steering::Fixed { angle: a }, Steering::Fixed { angle: b })
            | (Steering::Free { trail: a }, Steering::Free { trail: b }) => a.fits(b),
            (Steering::Linked { lead: a, ratio: p }, Steering::Linked { lead: b, ratio: q }) => {
                a == b && p.fits(q)
            }
            (Steering::Guided { lead: a }, Steering::Guided { lead: b }) => a == b,
            _ => false,
        }
    }

    fn put(&mut self, lane: usize, one: &Steering<f64>) {
        match (self, one) {
            (Steering::Fixed { angle: a }, Steering::Fixed { angle: b })
            | (Steering::Free { trail: a }, Steering::Free { trail: b })
            | (Steering::Linked { ratio: a, .. }, Steering::Linked { ratio: b, .. }) => {
                a.put(lane, b);
            }
            _ => {}
        }
    }
}

impl<T: Scalar> Lanewise for Rim<T> {
    type One = Rim<f64>;

    fn fits(&self, one: &Rim<f64>) -> bool {
        match (self, one) {
            (Rim::Plain, Rim::Plain) => true,
            (Rim::Rollers { angle: a }, Rim::Rollers { angle: b }) => a.fits(b),
            _ => false,
        }
    }

    fn put(&mut self, lane: usize, one: &Rim<f64>) {
        if let (Rim::Rollers { angle: a }, Rim::Rollers { angle: b }) = (self, one) {
            a.put(lane, b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Lanes4;
    use crate::planar::vec2;

    #[test]
    fn invariant_a_value_enters_its_lane_alone() {
        let mut drive: Drive<Lanes4> = Drive::Torque {
            torque_max: Lanes4::from(2.0),
        };
        drive.put(2, &Drive::Torque { torque_max: 5.0 });
        let expected = Lanes4::from_lanes(|i| if i == 2 { 5.0 } else { 2.0 });
        assert_eq!(
            drive,
            Drive::Torque {
                torque_max: expected
            }
        );
    }

    #[test]
    fn refusal_of_another_structure() {
        let pair = vec2(Lanes4::from(1.0), Lanes4::zero());
        assert!(pair.fits(&vec2(2.0, 0.0)));
        assert!(!pair.fits(&vec2(2.0, 1.0)));
        assert!(!Drive::<Lanes4>::None.fits(&Drive::Torque { torque_max: 1.0 }));
        assert!(!vec![Lanes4::one()].fits(&vec![1.0, 2.0]));
    }
}
