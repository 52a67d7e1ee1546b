//! Vectors of models whose states, inputs and outputs are called what the vectors call them.

use appell_model::pose_error::PoseError;
use appell_model::wheel_legged::{RearSteering, WheelLegged};

use super::{Column, Model, Place, Problem, Refusal, Vector, number, number_or, wrong};

pub(super) fn pose_error(vector: &Vector) -> Result<Problem, Refusal> {
    let p = &vector.params;
    let model = Model::PoseError(PoseError {
        mass: number(p, "mass")?,
        inertia: number(p, "J")?,
        lever: number(p, "d")?,
        ahead: number_or(p, "p", 0.0),
    });
    problem(
        vector,
        model,
        &["x_e", "y_e", "theta_e", "dv", "dw"],
        &["v", "omega", "v1", "omega1", "F1", "F2"],
        &["v_total", "omega_total"],
    )
}

pub(super) fn wheel_legged(vector: &Vector) -> Result<Problem, Refusal> {
    let p = &vector.params;
    let model = Model::WheelLegged(WheelLegged {
        front: number(p, "l1")?,
        rear: number(p, "l2")?,
        rear_steering: RearSteering::Exact,
    });
    problem(
        vector,
        model,
        &["x_O2", "y_O2", "theta"],
        &["V_B", "alpha", "beta"],
        &["x_B", "y_B", "V_x", "V_y", "omega", "V_A"],
    )
}

/// The names in the order of the model's vectors.
fn problem(
    vector: &Vector,
    model: Model,
    states: &[&str],
    inputs: &[&str],
    outputs: &[&str],
) -> Result<Problem, Refusal> {
    let find = |names: &[&str], name: &str| names.iter().position(|n| *n == name);
    let mut driven = Vec::new();
    for (name, signal) in &vector.inputs {
        let index = find(inputs, name).ok_or_else(|| wrong(format!("input {name}: unknown")))?;
        driven.push((index, signal.clone()));
    }
    let names = vector.state_columns.iter().chain(&vector.output_columns);
    let columns: Result<Vec<Column>, Refusal> = names
        .map(|name| {
            let state = find(states, name).map(Place::State);
            let place = state.or(find(outputs, name).map(Place::Output));
            let place = place.ok_or_else(|| wrong(format!("column {name}: unknown")))?;
            Ok(Column::one(place))
        })
        .collect();
    let start = |name: &&str| vector.x0.get(*name).copied().unwrap_or(0.0);
    Ok(Problem {
        model,
        x0: states.iter().map(start).collect(),
        inputs: driven,
        constant_inputs: Vec::new(),
        columns: columns?,
    })
}
