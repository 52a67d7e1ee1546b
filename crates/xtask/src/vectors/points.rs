//! Pointwise vectors: wheel rates, normal loads, inverse dynamics, strategies on obstacles.

use std::collections::BTreeMap;
use std::path::Path;

use appell_model::ground::Ground;
use appell_model::planar::vec2;
use appell_model::platform::{Platform, YAW};
use appell_model::rolling::Rolling;
use appell_model::support::Support;
use appell_model::wheel_legged::obstacle::{Limits, Obstacle, decide};
use serde_json::Value;

use super::{Refusal, Vector, csv, listed_wheels, number, number_or, pioneer, wrong};

/// The outputs of a pointwise vector, row by row.
pub fn points(vector: &Vector) -> Result<Vec<Vec<f64>>, Refusal> {
    match vector.model.as_str() {
        "mecanum_kinematic" => mecanum_points(vector),
        "brush" => super::contact::brush_points(vector),
        "normal_load" => load_points(vector),
        "pioneer2dx_inverse" => inverse_points(vector),
        other => Err(Refusal::Foreign(format!("model {other}"))),
    }
}

/// The strategies for the obstacles of a pointwise vector, row by row. Its lengths are in mm.
pub fn strategies(vector: &Vector) -> Result<Vec<Vec<String>>, Refusal> {
    let p = &vector.params;
    let meters = |millimeters: f64| millimeters / 1000.0;
    let limits = Limits {
        wheel_radius: meters(number(p, "R")?),
        wheel_pitch: meters(number(p, "S1")?),
        height_max: meters(number(p, "H_max")?),
    };
    if vector.output_columns != ["strategy"] {
        return Err(wrong(format!(
            "columns {:?}: unknown",
            vector.output_columns
        )));
    }
    let one = |row: &Vec<Value>| {
        let given = given(vector, row);
        let obstacle = if given("type")? == 0.0 {
            Obstacle::Step {
                height: meters(given("H")?),
            }
        } else {
            Obstacle::Trench {
                width: meters(given("s")?),
                depth: meters(given("h")?),
            }
        };
        Ok(vec![decide(&obstacle, &limits).strategy.key().to_owned()])
    };
    vector.data.iter().map(one).collect()
}

/// Writes the answers to a vector whose answers are words; whether all are as the vector has them.
pub(super) fn answer_in_words(stem: &str, vector: &Vector, out: &Path) -> std::io::Result<bool> {
    let rows = match strategies(vector) {
        Ok(rows) => rows,
        Err(refusal) => {
            println!("WRONG        {stem:28} {refusal:?}");
            return Ok(false);
        }
    };
    std::fs::write(out.join(format!("{stem}.csv")), csv(vector, &rows))?;
    let given = vector.input_columns.len();
    let same = |(row, data): (&Vec<String>, &Vec<Value>)| {
        let wanted = data
            .iter()
            .skip(given)
            .map(|value| value.as_str().unwrap_or_default());
        row.iter().map(String::as_str).eq(wanted)
    };
    let right = rows
        .iter()
        .zip(&vector.data)
        .filter(|pair| same(*pair))
        .count();
    let verdict = if right == rows.len() { "ok" } else { "OFF" };
    println!(
        "{verdict:12} {stem:28} {right} of {} answers agree",
        rows.len()
    );
    Ok(right == rows.len())
}

/// The inputs of a row by name.
fn given<'a>(vector: &'a Vector, row: &'a [Value]) -> impl Fn(&str) -> Result<f64, Refusal> + 'a {
    |name: &str| {
        let k = vector.input_columns.iter().position(|n| n == name);
        k.and_then(|k| row.get(k).and_then(Value::as_f64))
            .ok_or_else(|| wrong(format!("input {name}: a number is missing")))
    }
}

/// Asks each row for values by name and gives the outputs by name.
pub(super) fn each_point(
    vector: &Vector,
    answer: &dyn Fn(&Given<'_>) -> Result<Named, Refusal>,
) -> Result<Vec<Vec<f64>>, Refusal> {
    let one = |row: &Vec<Value>| {
        let named = answer(&given(vector, row))?;
        vector
            .output_columns
            .iter()
            .map(|name| {
                let found = named.get(name.as_str()).copied();
                found.ok_or_else(|| wrong(format!("column {name}: unknown")))
            })
            .collect()
    };
    vector.data.iter().map(one).collect()
}

/// Values of a point by name, those given and those answered.
pub(super) type Given<'a> = dyn Fn(&str) -> Result<f64, Refusal> + 'a;
pub(super) type Named = BTreeMap<String, f64>;

fn mecanum_points(vector: &Vector) -> Result<Vec<Vec<f64>>, Refusal> {
    // Kinematics knows no masses: any body will do.
    let mut massive = vector.clone();
    for (key, value) in [("body_mass", 1.0), ("body_inertia_com", 1.0)] {
        massive.params.insert(key.into(), value.into());
    }
    let (body, wheels, _, names) = listed_wheels(&massive)?;
    let platform = Platform::new(body, wheels).map_err(|e| wrong(format!("{e:?}")))?;
    let x = vec![0.0; platform.layout().state()];
    each_point(vector, &|given| {
        let twist = [given("V_x")?, given("V_y")?, given("omega")?];
        let rates = platform.rates_from_twist(&x, twist);
        let measured: Result<Vec<f64>, Refusal> = names
            .iter()
            .map(|name| given(&format!("meas_{name}")))
            .collect();
        let (fitted, residual) = platform.twist_from_rates(&x, &measured?);
        let mut named = Named::new();
        for (name, rate) in names.iter().zip(rates) {
            named.insert(format!("phi_dot_{name}"), rate);
        }
        for (name, value) in ["V_x_ls", "V_y_ls", "omega_ls"].iter().zip(fitted) {
            named.insert((*name).into(), value);
        }
        named.insert("residual_norm".into(), residual);
        Ok(named)
    })
}

fn load_points(vector: &Vector) -> Result<Vec<Vec<f64>>, Refusal> {
    let p = &vector.params;
    let listed = p.get("wheels").and_then(Value::as_array);
    let mut contacts = Vec::new();
    for wheel in listed.ok_or_else(|| wrong("parameter wheels: a list is missing"))? {
        let wheel = wheel
            .as_object()
            .ok_or_else(|| wrong("wheel: not a table"))?;
        let place = vec2(number(wheel, "x")?, number(wheel, "y")?);
        contacts.push((place, number_or(wheel, "stiffness", 1.0)));
    }
    let support = Support::new(&contacts).ok_or_else(|| wrong("wheels: carry no plane"))?;
    let (mass, height) = (number(p, "mass")?, number(p, "com_height")?);
    let center = vec2(number(p, "com_x")?, number(p, "com_y")?);
    let gravity = number(p, "g")?;
    each_point(vector, &|given| {
        let ground = Ground::plane(gravity, given("slope")?, given("downhill_heading_body")?);
        let needed = vec2(given("a_x")?, given("a_y")?) - ground.gravity;
        let weight = mass * ground.gravity_normal;
        let point = Support::zero_moment_point(weight, center, height, needed * mass);
        let mut named: Named = support
            .loads(weight, point)
            .iter()
            .take(contacts.len())
            .enumerate()
            .map(|(k, load)| (format!("N_{}", k + 1), *load))
            .collect();
        named.insert("zmp_x".into(), point.x);
        named.insert("zmp_y".into(), point.y);
        named.insert("tip_margin".into(), support.margin(point));
        Ok(named)
    })
}

fn inverse_points(vector: &Vector) -> Result<Vec<Vec<f64>>, Refusal> {
    let (body, wheels, _, _) = pioneer(vector)?;
    let platform = Platform::new(body, wheels).map_err(|e| wrong(format!("{e:?}")))?;
    let layout = platform.layout().clone();
    let radius = platform.wheels()[0].radius;
    let system = Rolling::new(platform, Ground::flat(9.81));
    each_point(vector, &|given| {
        let platform = system.platform();
        let mut x = vec![0.0; layout.state()];
        x[YAW] = given("beta")?;
        platform.renew_angles(&mut x);
        let along = |forward: f64, turn: f64| {
            platform.velocity_from_twist(vec2(radius * forward, 0.0), turn, &[])
        };
        let v = along(given("alpha_d")?, given("beta_d")?);
        let v_rate = along(given("alpha_dd")?, given("beta_dd")?);
        let at = layout.velocity();
        x[at..at + layout.dof()].copy_from_slice(&v[..layout.dof()]);
        let u = vec![0.0; layout.input()];
        let twist = [radius * given("alpha_d")?, 0.0, given("beta_d")?];
        let rates = platform.rates_from_twist(&x, twist);
        let mode: Vec<f64> = rates.iter().map(|rate| rate.signum()).collect();
        let demand = system.inverse(&x, &u, &mode, &v_rate);
        let along = demand.longitudinal[0] + demand.longitudinal[1];
        let across = demand.lateral[0] + demand.lateral[1];
        let world = vec2(along, across).rotated(x[YAW + 1], x[YAW + 2]);
        let named = [
            ("M1", demand.torque[0]),
            ("M2", demand.torque[1]),
            ("lambda1", world.x),
            ("lambda2", world.y),
            ("T_o", along),
            ("T_p", across),
            ("T_A", appell_model::math::hypot(along, across)),
            ("F_long_1", demand.longitudinal[0]),
            ("F_long_2", demand.longitudinal[1]),
        ];
        Ok(named.map(|(name, value)| (name.to_owned(), value)).into())
    })
}
