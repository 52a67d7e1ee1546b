//! Inverse dynamics: from a motion to the torques and contact forces that it needs.

use super::Rolling;
use super::axle::Supply;
use crate::platform::MAX_WHEELS;
use crate::scalar::Scalar;
use crate::solve::{MAX_DOF, Row, add_outer, dot, product, solve_semidefinite, zero_row};

/// What a motion demands: the answer of inverse dynamics, per wheel.
#[derive(Clone, Copy, Debug)]
pub struct Demand<T> {
    /// Torque of each drive at its axle, N·m.
    pub torque: [T; MAX_WHEELS],
    /// Torque of each steering motor, N·m.
    pub steering: [T; MAX_WHEELS],
    /// Force of the ground along the rolling direction or roller axis, N.
    pub longitudinal: [T; MAX_WHEELS],
    /// Force of the ground along the axle, N.
    pub lateral: [T; MAX_WHEELS],
    /// Normal load, N; zero where [`Rolling::support`] is `None`.
    pub load: [T; MAX_WHEELS],
    /// Tip-over margin, m.
    pub tip_margin: T,
    /// Largest generalised force that no drive can give; zero but for rounding where the motion can
    /// be driven.
    pub residual: T,
}

impl<T: Scalar> Rolling<T> {
    /// The torques that give the accelerations `v_rate`: inverse dynamics. `[eq:inverse-dynamics]`
    ///
    /// Of more drives than directions, the smallest torques that do it. What the motion needs of
    /// windings and losses beside is in [`Demand`]; commands in `u` are not read, brake and external
    /// wrench are.
    pub fn inverse(&self, x: &[T], u: &[T], mode: &[T], v_rate: &[T]) -> Demand<T> {
        let layout = self.platform.layout();
        let n = layout.dof();
        let mut u: Vec<T> = u.to_vec();
        for command in &mut u[..layout.brake_input()] {
            *command = T::zero();
        }
        let reduced = self.reduced(x);
        let mut forces = self.forces(x, &u, mode, &reduced);
        let mut wanted = zero_row();
        wanted[..n].copy_from_slice(&v_rate[..n]);
        let mut needed = product(n, &reduced.mass, &wanted);
        for k in 0..n {
            needed[k] -= forces.total[k];
        }
        let mut columns: Vec<Row<T>> = Vec::new();
        let driven: Vec<usize> = (0..layout.wheels)
            .filter(|&i| !matches!(self.axles[i].supply, Supply::None))
            .collect();
        for &i in &driven {
            let torque = forces.actions[i].torque;
            for k in 0..n {
                needed[k] = reduced.spin[i][k].mul_add(torque, needed[k]);
            }
            columns.push(reduced.spin[i]);
        }
        for k in layout.eta..n {
            let mut own = zero_row();
            own[k] = T::one();
            columns.push(own);
        }
        for &i in &layout.guides {
            let frame = self.platform.wheel_frame(i, x);
            columns.push(self.platform.lateral_row(&frame));
        }
        // Least norm: z = Cᵀ (C Cᵀ)⁻¹ needed.
        let mut normal = [zero_row(); MAX_DOF];
        for column in &columns {
            add_outer(n, &mut normal, T::one(), column, column);
        }
        let mut trace = T::zero();
        for k in 0..n {
            trace += normal[k][k];
        }
        let z = solve_semidefinite(n, normal, needed, trace * T::from(T::ROUNDING));
        let mut residual = needed;
        let mut efforts = Vec::with_capacity(columns.len());
        for column in &columns {
            let effort = dot(n, column, &z);
            for k in 0..n {
                residual[k] = (-effort).mul_add(column[k], residual[k]);
            }
            efforts.push(effort);
        }
        let mut demand = Demand {
            torque: [T::zero(); MAX_WHEELS],
            steering: [T::zero(); MAX_WHEELS],
            longitudinal: [T::zero(); MAX_WHEELS],
            lateral: [T::zero(); MAX_WHEELS],
            load: [T::zero(); MAX_WHEELS],
            tip_margin: T::zero(),
            residual: T::zero(),
        };
        for k in 0..n {
            demand.residual = demand.residual.max(residual[k].abs());
        }
        for (&i, &effort) in driven.iter().zip(&efforts) {
            demand.torque[i] = effort;
            forces.actions[i].torque = effort;
        }
        for (k, &i) in layout.steered.iter().enumerate() {
            demand.steering[i] = efforts[driven.len() + k];
        }
        let (longitudinal, lateral) = self.contact_forces(x, &u, &reduced, &forces, &wanted);
        (demand.load, demand.tip_margin) = self.carry(x, &longitudinal, &lateral);
        demand.longitudinal = longitudinal;
        demand.lateral = lateral;
        demand
    }
}
