//! Vectors of contacts: slipping wheels, one LuGre contact, the brush law.

use appell_model::planar::vec2;
use appell_model::platform::{Platform, WheelOutput, YAW};
use appell_model::slip::{Loads, Slip, SlipOutput};
use appell_model::tire::{Contact, Curve, Friction, Tire};
use serde_json::Value;

use super::points::{Named, each_point};
use super::{
    Column, Model, Place, Problem, Refusal, Vector, input_index, listed_wheels, number, number_or,
    plane, wheel_of, wrong,
};

/// A platform on slipping wheels (regularised Coulomb friction, μ by wheel).
pub(super) fn slip(vector: &Vector) -> Result<Problem, Refusal> {
    let p = &vector.params;
    let (body, wheels, _, names) = listed_wheels(vector)?;
    let listed = p.get("wheels").and_then(Value::as_array);
    let tires: Result<Vec<Tire<f64>>, Refusal> = listed
        .into_iter()
        .flatten()
        .filter_map(Value::as_object)
        .map(|wheel| {
            Ok(Tire::Coulomb {
                friction: Friction::plain(number(wheel, "mu")?),
                rounding: number(p, "v_eps")?,
            })
        })
        .collect();
    let loads = match p.get("load_mode").and_then(Value::as_str) {
        Some("static") => Loads::Static,
        Some("dynamic") => Loads::Dynamic,
        other => return Err(wrong(format!("parameter load_mode: unknown {other:?}"))),
    };
    let (tires, ground) = (tires?, plane(p));
    let platform = Platform::new(body, wheels).map_err(|e| wrong(format!("{e:?}")))?;
    let system = Slip::new(platform.clone(), tires.clone(), ground, loads);
    let system = system.map_err(|e| wrong(format!("{e:?}")))?;
    let layout = system.layout();
    let mut inputs = Vec::new();
    for (name, signal) in &vector.inputs {
        let index = input_index(name, &names, layout)
            .ok_or_else(|| wrong(format!("input {name}: unknown")))?;
        inputs.push((index, signal.clone()));
    }
    let place = |name: &str| {
        let at = layout.velocity();
        let state = |index| Some(Place::State(index));
        match name {
            "x" => return state(0),
            "y" => return state(1),
            "theta" => return state(YAW),
            "V_x" => return state(at),
            "V_y" => return state(at + 1),
            "omega" => return state(at + 2),
            _ => {}
        }
        let (stem, i) = wheel_of(name, &names)?;
        let wheel = |what| Some(Place::Output(layout.wheel_output(i, what)));
        let contact = |what| Some(Place::Output(system.slip_output(i, what)));
        match stem {
            "phi_dot" => state(system.rate(i)),
            "phi" => state(layout.spin(i)),
            "N" => wheel(WheelOutput::Load),
            "F_long" | "F_roller" | "F_x" => wheel(WheelOutput::Longitudinal),
            "F_lat" | "F_y" => wheel(WheelOutput::Lateral),
            "slip_x" | "slip_a" | "slip" => contact(SlipOutput::Along),
            "slip_y" => contact(SlipOutput::Across),
            _ => None,
        }
    };
    let mut x0 = vec![0.0; system.state()];
    let mut columns = Vec::new();
    for name in vector.state_columns.iter().chain(&vector.output_columns) {
        let place = place(name).ok_or_else(|| wrong(format!("column {name}: unknown")))?;
        if let (Place::State(index), Some(&value)) = (place, vector.x0.get(name)) {
            x0[index] = value;
        }
        columns.push(Column::one(place));
    }
    Ok(Problem {
        model: Model::Slip {
            platform: Box::new(platform),
            tires,
            ground,
            loads,
        },
        x0,
        inputs,
        constant_inputs: Vec::new(),
        columns,
    })
}

/// One LuGre contact whose slip velocity is given.
pub(super) fn lugre(vector: &Vector) -> Result<Problem, Refusal> {
    let p = &vector.params;
    let tire = Tire::Lugre {
        friction: Friction {
            kinetic: number(p, "mu_c")?,
            breakaway: number(p, "mu_s")?,
            stribeck: number(p, "v_s")?,
        },
        stiffness: number(p, "sigma0")?,
        damping: number(p, "sigma1")?,
        viscous: number_or(p, "sigma2", 0.0),
    };
    let columns: Result<Vec<Column>, Refusal> = vector
        .state_columns
        .iter()
        .chain(&vector.output_columns)
        .map(|name| match name.as_str() {
            "z" => Ok(Column::one(Place::State(0))),
            "F" => Ok(Column::one(Place::Output(0))),
            _ => Err(wrong(format!("column {name}: unknown"))),
        })
        .collect();
    let mut inputs = Vec::new();
    for (name, signal) in &vector.inputs {
        if name != "v_r" {
            return Err(wrong(format!("input {name}: unknown")));
        }
        inputs.push((0, signal.clone()));
    }
    Ok(Problem {
        model: Model::Contact(Contact {
            tire,
            load: number(p, "N")?,
            rolling: 0.0,
        }),
        x0: vec![vector.x0.get("z").copied().unwrap_or(0.0)],
        inputs,
        constant_inputs: Vec::new(),
        columns: columns?,
    })
}

/// The brush law at points.
pub(super) fn brush_points(vector: &Vector) -> Result<Vec<Vec<f64>>, Refusal> {
    each_point(vector, &|given| {
        let load = given("N")?;
        let curve = Curve::Brush {
            friction: given("mu")?,
            stiffness: given("C_slip")? / load,
        };
        let slip = vec2(given("s_x")?, given("s_y")?);
        let force = curve.force(slip) * load;
        let slides = curve.sliding() <= appell_model::math::hypot(slip.x, slip.y);
        let named = [
            ("F_x", force.x),
            ("F_y", force.y),
            ("full_sliding", f64::from(u8::from(slides))),
        ];
        Ok(Named::from(
            named.map(|(name, value)| (name.to_owned(), value)),
        ))
    })
}
