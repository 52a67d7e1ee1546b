//! Dry friction as a mode: wheels that stick, what holds them, and when they let go. `[eq:stick]`

use super::{Forces, Rolling, is_zero};
use crate::platform::{LEDGER, MAX_WHEELS, Reduced};
use crate::scalar::{Mask, Scalar};
use crate::solve::{Condition, Mobility, Row, dot, product, solve_semidefinite, zero_row};

impl<T: Scalar> Rolling<T> {
    /// Narrows accelerations to those that leave the sticking wheels at rest. `[eq:stick]`
    #[inline(always)]
    pub(super) fn hold(
        &self,
        reduced: &Reduced<T>,
        stuck: &[T::Mask; MAX_WHEELS],
        convective: &[T; MAX_WHEELS],
        mobility: &mut Mobility<T>,
        v_rate: &mut [T],
    ) {
        let layout = self.platform.layout();
        let mut moving = T::Mask::splat(false);
        for i in 0..layout.wheels {
            if !self.axles[i].rubs || !stuck[i].any() {
                continue;
            }
            let condition = Condition {
                row: reduced.spin[i],
                value: -convective[i],
                active: stuck[i],
            };
            moving = moving.or(is_zero(convective[i]).not());
            mobility.impose(&condition, v_rate);
        }
        // Held in every direction: at rest to the last bit, whatever the rounding.
        let rest = mobility.is_locked().and(moving.not());
        if layout.steered.is_empty() && rest.any() {
            for rate in v_rate.iter_mut().take(layout.dof()) {
                *rate = T::select(rest, T::zero(), *rate);
            }
        }
    }

    /// Takes from the velocities what steered and sticking wheels forbid, at the least cost of
    /// energy, which goes to the ledger as heat.
    #[inline(always)]
    pub(super) fn project(&self, x: &mut [T], u: &[T], mode: &[T], reduced: &Reduced<T>) {
        let layout = self.platform.layout();
        let n = layout.dof();
        let at = layout.velocity();
        let inverse = self.inverse_mass(reduced);
        let mut v = zero_row();
        v[..n].copy_from_slice(&x[at..at + n]);
        let energy = |v: &Row<T>| T::from(0.5) * dot(n, &product(n, &reduced.mass, v), v);
        let before = energy(&v);
        let mut mobility = Mobility::new(n, &inverse);
        self.platform.guide(x, &mut mobility, &mut v);
        for i in 0..layout.wheels {
            if self.axles[i].rubs {
                let bound = self.bound(i, u);
                let condition = Condition {
                    row: reduced.spin[i],
                    value: T::zero(),
                    active: is_zero(mode[i]).and(T::zero().less(bound)),
                };
                mobility.impose(&condition, &mut v);
            }
        }
        let locked = mobility.is_locked();
        for k in 0..n {
            x[at + k] = T::select(locked, T::zero(), v[k]);
            v[k] = x[at + k];
        }
        x[layout.ledger() + LEDGER - 1] += before - energy(&v);
    }

    /// Torques that hold the sticking wheels at rest, N·m; zero for the others. `[eq:stick]`
    #[inline(always)]
    pub(super) fn holding_torques(
        &self,
        x: &[T],
        reduced: &Reduced<T>,
        forces: &Forces<T>,
    ) -> [T; MAX_WHEELS] {
        // Where more wheels stick than there are directions to hold, the share of each is not
        // determined; this much of the diagonal, against rounding, picks the smallest torques.
        let ridge = if T::IS_NARROW { 1e-5 } else { 1e-11 };
        let layout = self.platform.layout();
        let (n, wheels) = (layout.dof(), layout.wheels);
        let (free, mobility) = super::steered_acceleration(self, x, reduced, forces);
        let mut matrix = [[T::zero(); MAX_WHEELS]; MAX_WHEELS];
        let mut right = [T::zero(); MAX_WHEELS];
        for i in 0..wheels {
            let held = forces.actions[i].stuck;
            let response = product(n, mobility.matrix(), &reduced.spin[i]);
            for j in 0..wheels {
                let entry = dot(n, &reduced.spin[j], &response);
                matrix[j][i] = T::select(held.and(forces.actions[j].stuck), entry, T::zero());
            }
            let own = matrix[i][i] * T::from(1.0 + ridge);
            matrix[i][i] = T::select(held, own, T::one());
            let pushed = dot(n, &reduced.spin[i], &free) + forces.convective[i];
            right[i] = T::select(held, -pushed, T::zero());
        }
        solve_semidefinite(wheels, matrix, right, T::zero())
    }

    /// Lets go of the resting wheels that are pushed harder than their friction holds. `[eq:stick]`
    #[inline(always)]
    pub(super) fn release(&self, x: &[T], u: &[T], mode: &mut [T], reduced: &Reduced<T>) {
        let layout = self.platform.layout();
        for _ in 0..layout.wheels {
            let forces = self.forces(x, u, mode, reduced);
            let held = holding_torques(self, x, reduced, &forces);
            // The one that is asked for most beyond its bound lets go, and the rest is asked again.
            let mut worst = T::zero();
            for i in 0..layout.wheels {
                let excess = held[i].abs() - forces.actions[i].bound;
                worst = worst.max(T::select(forces.actions[i].stuck, excess, T::zero()));
            }
            let any = T::zero().less(worst);
            if !any.any() {
                return;
            }
            for i in 0..layout.wheels {
                let excess = held[i].abs() - forces.actions[i].bound;
                let lets_go = forces.actions[i]
                    .stuck
                    .and(any)
                    .and(worst.less_equal(excess));
                mode[i] = T::select(lets_go, -T::one().copysign(held[i]), mode[i]);
            }
        }
    }
}

fused! {
    /// See [`Rolling::holding_torques`].
    pub(super) fn holding_torques<T: Scalar>(
        rolling: &Rolling<T>,
        x: &[T],
        reduced: &Reduced<T>,
        forces: &Forces<T>,
    ) -> [T; MAX_WHEELS] {
        rolling.holding_torques(x, reduced, forces)
    }
}
fused! {
    /// See [`Rolling::hold`].
    pub(super) fn hold<T: Scalar>(
        rolling: &Rolling<T>,
        reduced: &Reduced<T>,
        stuck: &[T::Mask; MAX_WHEELS],
        convective: &[T; MAX_WHEELS],
        mobility: &mut Mobility<T>,
        v_rate: &mut [T],
    ) {
        rolling.hold(reduced, stuck, convective, mobility, v_rate);
    }
}
fused! {
    /// See [`Rolling::release`].
    pub(super) fn release<T: Scalar>(
        rolling: &Rolling<T>,
        x: &[T],
        u: &[T],
        mode: &mut [T],
        reduced: &Reduced<T>,
    ) {
        rolling.release(x, u, mode, reduced);
    }
}
fused! {
    /// See [`Rolling::project`].
    pub(super) fn project<T: Scalar>(
        rolling: &Rolling<T>,
        x: &mut [T],
        u: &[T],
        mode: &[T],
        reduced: &Reduced<T>,
    ) {
        rolling.project(x, u, mode, reduced);
    }
}
