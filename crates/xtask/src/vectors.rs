//! Reference vectors (`appell-vector/1`) through the shipped general model.
//!
//! No equation of motion stands here: a vector's parameters become a [`Platform`], its columns are
//! looked up in the state and output vectors, and `appell-model` does the rest.

mod contact;
mod named;
mod points;
mod signal;

use std::collections::BTreeMap;
use std::path::Path;

use appell_model::drive::{DcMotor, Drive};
use appell_model::dynamics::{Dynamics, Input};
use appell_model::ground::Ground;
use appell_model::integrate::{Adaptive, Exponential, RungeKutta4};
use appell_model::kinematic::Kinematic;
use appell_model::planar::vec2;
use appell_model::platform::{Body, Layout, Platform, WheelOutput, YAW};
use appell_model::pose_error::PoseError;
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::slip::{Loads, Slip};
use appell_model::tire::{Contact, Tire};
use appell_model::wheel::{Rim, Steering, Wheel};
use appell_model::wheel_legged::WheelLegged;
use serde::Deserialize;
use serde_json::{Map, Value};

pub use points::{points, strategies};
pub use signal::Signal;

/// A trajectory vector as its file gives it.
#[derive(Clone, Debug, Deserialize)]
pub struct Vector {
    /// Schema of the file.
    pub schema: String,
    /// `trajectory` or `pointwise`.
    pub kind: String,
    /// Name of the model.
    pub model: String,
    /// Parameters, SI.
    pub params: Map<String, Value>,
    /// Initial value of every state column.
    #[serde(default)]
    pub x0: BTreeMap<String, f64>,
    /// Signals of the inputs.
    #[serde(default)]
    pub inputs: BTreeMap<String, Signal>,
    /// Names of the states.
    #[serde(default)]
    pub state_columns: Vec<String>,
    /// Names of what a pointwise vector is given.
    #[serde(default)]
    pub input_columns: Vec<String>,
    /// Names of the outputs.
    #[serde(default)]
    pub output_columns: Vec<String>,
    /// Sample times, s.
    #[serde(default)]
    pub t: Vec<f64>,
    /// One row per sample time, which only tests read; of a pointwise vector one row per point,
    /// inputs first.
    #[serde(default)]
    pub data: Vec<Vec<Value>>,
    /// Pass tolerance.
    pub tolerance: Option<Tolerance>,
}

/// `abs + rel · max|column|`.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Tolerance {
    /// Absolute part, in the column's unit.
    pub abs: f64,
    /// Part relative to the largest value of the column.
    pub rel: f64,
}

/// How to integrate.
#[derive(Clone, Copy, Debug)]
pub enum Method {
    /// Tsitouras' pair at this relative tolerance; the absolute one is a tenth of it.
    Adaptive(f64),
    /// Runge–Kutta 4 with steps of at most this length, s.
    RungeKutta4(f64),
    /// Exponential midpoint with steps of at most this length, s.
    Exponential(f64),
}

/// How a column of a vector follows from an instant.
#[derive(Clone, Debug)]
enum Column {
    /// Σ factor · value.
    Sum(Vec<(Place, f64)>),
    /// First or second component of two columns turned by the heading.
    Turned(Box<[Column; 2]>, usize),
    /// √(a² + b²).
    Norm(Box<[Column; 2]>),
}

/// Where a value stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    State(usize),
    Rate(usize),
    Output(usize),
}

/// State, its rate and the outputs at an instant.
struct Instant<'a, T> {
    x: &'a [T],
    dx: &'a [T],
    y: &'a [T],
}

impl Column {
    fn one(place: Place) -> Column {
        Column::Sum(vec![(place, 1.0)])
    }

    fn at<T: Scalar>(&self, now: &Instant<'_, T>) -> T {
        match self {
            Column::Sum(terms) => {
                let mut sum = T::zero();
                for (place, factor) in terms {
                    let value = match *place {
                        Place::State(index) => now.x[index],
                        Place::Rate(index) => now.dx[index],
                        Place::Output(index) => now.y[index],
                    };
                    sum = value.mul_add(T::from(*factor), sum);
                }
                sum
            }
            Column::Turned(pair, axis) => {
                let (sin, cos) = now.x[YAW].sin_cos();
                let turned = vec2(pair[0].at(now), pair[1].at(now)).rotated(cos, sin);
                if *axis == 0 { turned.x } else { turned.y }
            }
            Column::Norm(pair) => {
                let (a, b) = (pair[0].at(now), pair[1].at(now));
                a.mul_add(a, b * b).sqrt()
            }
        }
    }
}

/// The model that a vector is about.
enum Model {
    Robot {
        platform: Box<Platform<f64>>,
        ground: Ground<f64>,
        kinematic: bool,
    },
    PoseError(PoseError<f64>),
    /// Wheels that slip, each with its contact law.
    Slip {
        platform: Box<Platform<f64>>,
        tires: Vec<Tire<f64>>,
        ground: Ground<f64>,
        loads: Loads,
    },
    Contact(Contact<f64>),
    WheelLegged(WheelLegged<f64>),
}

/// A vector made ready: a model, its initial state, and where its columns stand.
struct Problem {
    model: Model,
    x0: Vec<f64>,
    /// Index in the input vector and signal.
    inputs: Vec<(usize, Signal)>,
    constant_inputs: Vec<(usize, f64)>,
    columns: Vec<Column>,
}

struct Inputs<'a> {
    problem: &'a Problem,
    /// End of the smooth stretch: signals are right-continuous, so at its end their left limit counts.
    end: f64,
}

impl<T: Scalar> Input<T> for Inputs<'_> {
    fn at(&self, t: f64, u: &mut [T]) {
        let inside = if t >= self.end {
            self.end - 1e-12 * self.end.abs().max(1e-3)
        } else {
            t
        };
        u.fill(T::zero());
        for &(index, value) in &self.problem.constant_inputs {
            u[index] = T::from(value);
        }
        for (index, signal) in &self.problem.inputs {
            // Only a signal that jumps here is asked for its left limit.
            let mut breaks = Vec::new();
            signal.breaks(self.end, &mut breaks);
            let jumps = breaks.iter().any(|b| (b - self.end).abs() < 1e-12);
            u[*index] = T::from(signal.at(if jumps { inside } else { t }));
        }
    }
}

/// Why a vector cannot be run.
#[derive(Debug)]
pub enum Refusal {
    /// Its schema, kind or model is not one of this version's.
    Foreign(String),
    /// It is of a known model, but something in it is wrong.
    Wrong(String),
}

fn wrong(text: impl Into<String>) -> Refusal {
    Refusal::Wrong(text.into())
}

/// Runs a vector in the scalar T; rows of states and outputs at its sample times.
pub fn run<T: Scalar>(vector: &Vector, method: Method) -> Result<Vec<Vec<T>>, Refusal> {
    let problem = prepare(vector)?;
    match &problem.model {
        Model::PoseError(model) => {
            let model = PoseError {
                mass: T::from(model.mass),
                inertia: T::from(model.inertia),
                lever: T::from(model.lever),
                ahead: T::from(model.ahead),
            };
            integrate(vector, &problem, &model, method)
        }
        Model::Contact(contact) => {
            let contact = Contact {
                tire: contact.tire.map(&mut T::from),
                load: T::from(contact.load),
                rolling: T::from(contact.rolling),
            };
            integrate(vector, &problem, &contact, method)
        }
        Model::Slip {
            platform,
            tires,
            ground,
            loads,
        } => {
            let platform = platform.map(&mut |_, value| T::from(value));
            let tires = tires.iter().map(|tire| tire.map(&mut T::from)).collect();
            let system = Slip::new(platform, tires, lift(ground), *loads);
            let system = system.map_err(|e| wrong(format!("{e:?}")))?;
            integrate(vector, &problem, &system, method)
        }
        Model::WheelLegged(model) => {
            let model = WheelLegged {
                front: T::from(model.front),
                rear: T::from(model.rear),
                rear_steering: model.rear_steering,
            };
            integrate(vector, &problem, &model, method)
        }
        Model::Robot {
            platform,
            ground,
            kinematic,
        } => {
            let platform = platform.map(&mut |_, value| T::from(value));
            let ground = lift(ground);
            if *kinematic {
                let system = Kinematic::new(platform)
                    .ok_or_else(|| wrong("wheels do not determine the motion"))?;
                integrate(vector, &problem, &system, method)
            } else {
                integrate(vector, &problem, &Rolling::new(platform, ground), method)
            }
        }
    }
}

/// The same ground in another scalar.
fn lift<T: Scalar>(ground: &Ground<f64>) -> Ground<T> {
    Ground {
        gravity: vec2(T::from(ground.gravity.x), T::from(ground.gravity.y)),
        gravity_normal: T::from(ground.gravity_normal),
    }
}

fn integrate<T: Scalar, S: Dynamics<T>>(
    vector: &Vector,
    problem: &Problem,
    system: &S,
    method: Method,
) -> Result<Vec<Vec<T>>, Refusal> {
    let sizes = system.sizes();
    let mut x: Vec<T> = problem.x0.iter().map(|&value| T::from(value)).collect();
    let mut mode = vec![T::one(); sizes.mode];
    let mut u = vec![T::zero(); sizes.input];
    let mut y = vec![T::zero(); sizes.output];
    let mut dx = vec![T::zero(); sizes.state];
    let end = vector.t.last().copied().unwrap_or(0.0);
    let mut stops = vector.t.clone();
    for (_, signal) in &problem.inputs {
        signal.breaks(end, &mut stops);
    }
    let first = vector.t.first().copied().unwrap_or(0.0);
    stops.retain(|&t| t >= first && t <= end);
    stops.sort_by(f64::total_cmp);
    stops.dedup_by(|a, b| (*a - *b).abs() < 1e-12);

    let mut adaptive = Adaptive::new(system, 0.0, 0.0);
    let mut rk4 = RungeKutta4::new(sizes.state, sizes.input);
    let mut exponential = None;
    if let Method::Adaptive(tolerance) = method {
        adaptive.relative = tolerance;
        adaptive.absolute = 0.1 * tolerance;
    }
    system.settle(&mut x, &u, &mut mode);
    let mut rows = Vec::with_capacity(vector.t.len());
    let mut samples = vector.t.iter().peekable();
    for (k, &t) in stops.iter().enumerate() {
        while samples
            .peek()
            .is_some_and(|&&sample| (sample - t).abs() < 1e-12)
        {
            samples.next();
            let after = Inputs {
                problem,
                end: f64::INFINITY,
            };
            after.at(t, &mut u);
            let mut now = mode.clone();
            system.decide(&x, &u, &mut now);
            system.output(&x, &u, &now, &mut y);
            system.derivative(&x, &u, &now, &mut dx);
            let now = Instant {
                x: &x,
                dx: &dx,
                y: &y,
            };
            rows.push(problem.columns.iter().map(|c| c.at(&now)).collect());
        }
        let Some(&next) = stops.get(k + 1) else {
            break;
        };
        let input = Inputs { problem, end: next };
        match method {
            Method::Adaptive(_) => {
                adaptive
                    .advance(system, &input, t, next, &mut x, &mut mode, None)
                    .map_err(|stalled| wrong(format!("integration stalled: {stalled:?}")))?;
            }
            Method::RungeKutta4(step) | Method::Exponential(step) => {
                let count = ((next - t) / step - 1e-9).ceil().max(1.0) as usize;
                let dt = (next - t) / count as f64;
                for i in 0..count {
                    let at = t + i as f64 * dt;
                    if let Method::RungeKutta4(_) = method {
                        rk4.step(system, &input, at, dt, &mut x, &mut mode);
                    } else {
                        if exponential.is_none() {
                            exponential = Exponential::new(system, dt);
                        }
                        let method = exponential
                            .as_mut()
                            .ok_or_else(|| wrong("no constant linear part"))?;
                        method.step(system, &input, at, dt, &mut x, &mut mode);
                    }
                }
            }
        }
    }
    Ok(rows)
}

fn number(params: &Map<String, Value>, key: &str) -> Result<f64, Refusal> {
    params
        .get(key)
        .and_then(Value::as_f64)
        .ok_or_else(|| wrong(format!("parameter {key}: a number is missing")))
}

/// The inclined plane of a vector.
fn plane(params: &Map<String, Value>) -> Ground<f64> {
    Ground::plane(
        number_or(params, "g", 9.81),
        number_or(params, "slope", 0.0),
        number_or(params, "downhill_heading", 0.0),
    )
}

fn number_or(params: &Map<String, Value>, key: &str, default: f64) -> f64 {
    params.get(key).and_then(Value::as_f64).unwrap_or(default)
}

fn plain_wheel(name: &str, x: f64, y: f64, radius: f64) -> Wheel<f64> {
    Wheel {
        name: name.to_owned(),
        mount: vec2(x, y),
        radius,
        steering: Steering::Fixed { angle: 0.0 },
        rim: Rim::Plain,
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 0.0,
        viscous: 0.0,
        pivot_viscous: 0.0,
        dry_friction: 0.0,
        friction_rounding: 0.0,
        stiffness: 1.0,
        brake: 0.0,
        drive: Drive::Torque {
            torque_max: f64::INFINITY,
        },
    }
}

fn prepare(vector: &Vector) -> Result<Problem, Refusal> {
    match vector.model.as_str() {
        "pose_error" => return named::pose_error(vector),
        "wheel_legged_kinematic" => return named::wheel_legged(vector),
        "slip" => return contact::slip(vector),
        "lugre" => return contact::lugre(vector),
        _ => {}
    }
    let p = &vector.params;
    let ground = plane(p);
    let (body, wheels, kinematic, names) = match vector.model.as_str() {
        "diff_kinematic" | "diff_dynamic" | "diff_incline" | "diff_motor" => differential(vector)?,
        "general_rolling" | "mecanum_dynamic" => listed_wheels(vector)?,
        "pioneer2dx" => pioneer(vector)?,
        other => return Err(Refusal::Foreign(format!("model {other}"))),
    };
    let platform = Platform::new(body, wheels).map_err(|e| wrong(format!("{e:?}")))?;
    let layout = platform.layout().clone();

    let mut inputs = Vec::new();
    for (name, signal) in &vector.inputs {
        let index = input_index(name, &names, &layout)
            .ok_or_else(|| wrong(format!("input {name}: unknown")))?;
        inputs.push((index, signal.clone()));
    }
    let mut constant_inputs = Vec::new();
    if let Some(wrench) = p.get("wrench").and_then(Value::as_array) {
        for (k, value) in wrench.iter().enumerate().take(3) {
            constant_inputs.push((layout.wrench_input() + k, value.as_f64().unwrap_or(0.0)));
        }
    }
    let mut x0 = vec![0.0; layout.state()];
    let get = |name: &str| vector.x0.get(name).copied();
    let first_of = |names: &[&str]| names.iter().find_map(|n| get(n)).unwrap_or(0.0);
    let heading = first_of(&["phi", "theta", "beta"]);
    x0[0] = first_of(&["x", "x_A"]);
    x0[1] = first_of(&["y", "y_A"]);
    x0[YAW] = heading;
    let radius = platform.wheels()[0].radius;
    let rolled = get("alpha_d").map(|rate| rate * radius);
    let velocity = vec2(
        get("V").or(get("V_x")).or(rolled).unwrap_or(0.0),
        get("V_y").unwrap_or(0.0),
    );
    let yaw_rate = first_of(&["omega", "beta_d"]);
    let steering: Vec<f64> = layout
        .steered
        .iter()
        .map(|i| get(&format!("gamma_dot_{}", i + 1)).unwrap_or(0.0))
        .collect();
    let v = platform.velocity_from_twist(velocity, yaw_rate, &steering);
    let at = layout.velocity();
    x0[at..at + layout.dof()].copy_from_slice(&v[..layout.dof()]);

    if let Some(mean) = get("alpha") {
        // The mean angle of both wheels, which have turned apart as the heading has.
        for i in 0..2 {
            let apart = -platform.wheels()[i].mount.y / radius * heading;
            x0[layout.spin(i)] = mean + apart;
        }
    }
    let mut columns = Vec::new();
    for name in vector.state_columns.iter().chain(&vector.output_columns) {
        let column = find_column(name, &names, &platform)
            .ok_or_else(|| wrong(format!("column {name}: unknown")))?;
        if let (Column::Sum(terms), Some(&value)) = (&column, vector.x0.get(name))
            && let [(Place::State(index), factor)] = terms[..]
        {
            // Velocities were set from the twist as a whole.
            if !(at..at + layout.eta).contains(&index) {
                x0[index] = value / factor;
            }
        }
        columns.push(column);
    }
    Ok(Problem {
        model: Model::Robot {
            platform: Box::new(platform),
            ground,
            kinematic,
        },
        x0,
        inputs,
        constant_inputs,
        columns,
    })
}

/// Suffixes by which a vector's columns call the wheels: `l`, `r`, or 1, 2, …
type Suffixes = Vec<String>;
type Parts = (Body<f64>, Vec<Wheel<f64>>, bool, Suffixes);

fn differential(vector: &Vector) -> Result<Parts, Refusal> {
    let p = &vector.params;
    let half = 0.5 * number(p, "track")?;
    let radius = number(p, "wheel_radius")?;
    let kinematic = vector.model == "diff_kinematic";
    let drive = match vector.model.as_str() {
        "diff_kinematic" => Drive::Rate {
            rate_max: f64::INFINITY,
        },
        "diff_motor" => Drive::DcMotor(DcMotor {
            resistance: number(p, "R")?,
            inductance: number(p, "L")?,
            torque_constant: number(p, "K_M")?,
            back_emf_constant: number(p, "K_e")?,
            gear_ratio: number(p, "gear")?,
            gear_efficiency: number_or(p, "gear_efficiency", 1.0),
            voltage_max: f64::INFINITY,
            current_max: f64::INFINITY,
        }),
        _ => Drive::Torque {
            torque_max: f64::INFINITY,
        },
    };
    let mass = if kinematic { 1.0 } else { number(p, "mass")? };
    let behind = number_or(p, "com_offset", 0.0);
    let about_axle = if kinematic {
        1.0
    } else {
        number(p, "inertia_axle")?
    };
    let body = Body {
        mass,
        inertia_com: about_axle - mass * behind * behind,
        center_of_mass: vec2(-behind, 0.0),
        com_height: 0.0,
    };
    let wheel = |name, side: f64| Wheel {
        spin_inertia: number_or(p, "wheel_inertia", 0.0),
        drive,
        ..plain_wheel(name, 0.0, side, radius)
    };
    let wheels = vec![wheel("left", half), wheel("right", -half)];
    Ok((body, wheels, kinematic, vec!["l".into(), "r".into()]))
}

fn listed_wheels(vector: &Vector) -> Result<Parts, Refusal> {
    let p = &vector.params;
    let com = vec2(number_or(p, "com_x", 0.0), number_or(p, "com_y", 0.0));
    let body = if vector.model == "slip" {
        Body {
            mass: number(p, "mass")?,
            inertia_com: number(p, "inertia_com")?,
            center_of_mass: com,
            com_height: number_or(p, "com_height", 0.0),
        }
    } else if vector.model == "mecanum_dynamic" {
        let mass = number(p, "mass")?;
        Body {
            mass,
            inertia_com: number(p, "inertia_P")? - mass * com.dot(com),
            center_of_mass: com,
            com_height: 0.0,
        }
    } else {
        Body {
            mass: number(p, "body_mass")?,
            inertia_com: number(p, "body_inertia_com")?,
            center_of_mass: com,
            com_height: 0.0,
        }
    };
    let listed = p
        .get("wheels")
        .and_then(Value::as_array)
        .ok_or_else(|| wrong("parameter wheels: a list is missing"))?;
    let mut wheels = Vec::new();
    let mut names = Vec::new();
    for (i, entry) in listed.iter().enumerate() {
        let w = entry
            .as_object()
            .ok_or_else(|| wrong(format!("wheel {}: not a table", i + 1)))?;
        let rollers = vector.model != "slip" || w.contains_key("delta");
        let usual = if rollers { "swedish" } else { "fixed" };
        let kind = w.get("kind").and_then(Value::as_str).unwrap_or(usual);
        let angle = number_or(w, "angle", 0.0);
        let steering = match kind {
            "fixed" | "swedish" => Steering::Fixed { angle },
            "steered" => Steering::Driven,
            "caster" => Steering::Free {
                trail: number(w, "trail")?,
            },
            other => return Err(wrong(format!("wheel {}: unknown kind {other}", i + 1))),
        };
        let rim = match kind {
            "swedish" => Rim::Rollers {
                angle: number(w, "delta")?,
            },
            _ => Rim::Plain,
        };
        wheels.push(Wheel {
            steering,
            rim,
            mass: number_or(w, "mass", 0.0),
            inertia_vertical: number_or(w, "inertia_vertical", 0.0),
            spin_inertia: number_or(w, "inertia", 0.0),
            viscous: number_or(w, "viscous", 0.0),
            pivot_viscous: number_or(w, "pivot_viscous", 0.0),
            dry_friction: number_or(w, "load", 0.0) * number_or(w, "rolling_arm", 0.0),
            friction_rounding: number_or(p, "roll_eps", 0.0),
            stiffness: number_or(w, "stiffness", 1.0),
            ..plain_wheel(
                &format!("w{}", i + 1),
                number(w, "x")?,
                number(w, "y")?,
                number(w, "radius")?,
            )
        });
        names.push((i + 1).to_string());
    }
    Ok((body, wheels, false, names))
}

/// Two wheels and a frame behind their axle; wheel 1 is the right one.
fn pioneer(vector: &Vector) -> Result<Parts, Refusal> {
    let p = &vector.params;
    let body = Body {
        mass: number(p, "m4")?,
        inertia_com: number(p, "I_z4")?,
        center_of_mass: vec2(-number(p, "l2")?, 0.0),
        com_height: 0.0,
    };
    let half = number(p, "l1")?;
    let mut wheels = Vec::new();
    for (name, side) in [("1", -half), ("2", half)] {
        wheels.push(Wheel {
            mass: number(p, "m1")?,
            inertia_vertical: number(p, "I_x1")?,
            spin_inertia: number(p, "I_z1")?,
            dry_friction: number(p, &format!("N{name}"))? * number(p, &format!("f{name}"))?,
            friction_rounding: number_or(p, "roll_eps", 0.0),
            stiffness: 1.0,
            ..plain_wheel(name, 0.0, side, number(p, "r")?)
        });
    }
    Ok((body, wheels, false, vec!["1".into(), "2".into()]))
}

fn wheel_of<'a>(name: &'a str, names: &Suffixes) -> Option<(&'a str, usize)> {
    let (stem, suffix) = name.rsplit_once('_')?;
    Some((stem, names.iter().position(|n| n == suffix)?))
}

fn input_index(name: &str, names: &Suffixes, layout: &Layout) -> Option<usize> {
    match name {
        // The lecture's torques, of the right and the left wheel.
        "M1" => return Some(0),
        "M2" => return Some(1),
        _ => {}
    }
    let (stem, i) = wheel_of(name, names)?;
    match stem {
        "tau" | "u" | "w" => Some(i),
        "tau_steer" => {
            let k = layout.steered.iter().position(|&s| s == i)?;
            Some(layout.steering_input() + k)
        }
        _ => None,
    }
}

fn find_column(name: &str, names: &Suffixes, platform: &Platform<f64>) -> Option<Column> {
    let layout = platform.layout();
    let state = |index| Some(Column::one(Place::State(index)));
    let output = |index| Some(Column::one(Place::Output(index)));
    let total = |what| {
        let places = (0..layout.wheels).map(|i| Place::Output(layout.wheel_output(i, what)));
        Column::Sum(places.map(|place| (place, 1.0)).collect())
    };
    let ground = || {
        Box::new([
            total(WheelOutput::Longitudinal),
            total(WheelOutput::Lateral),
        ])
    };
    let radius = platform.wheels()[0].radius;
    match name {
        "x" | "x_A" => return state(0),
        "y" | "y_A" => return state(1),
        "phi" | "theta" | "beta" => return state(YAW),
        "V" | "V_x" => return output(0),
        "V_y" => return output(1),
        "omega" | "beta_d" => return output(2),
        "E_kin" => return output(3),
        "E_pot" => return output(4),
        "E_mag" => return output(5),
        "work" | "W_elec" => return state(layout.ledger()),
        "W_joule" => return state(layout.ledger() + 1),
        "F_lat_sum" | "T_p" => return Some(total(WheelOutput::Lateral)),
        "T_o" => return Some(total(WheelOutput::Longitudinal)),
        "T_A" => return Some(Column::Norm(ground())),
        "lambda1" => return Some(Column::Turned(ground(), 0)),
        "lambda2" => return Some(Column::Turned(ground(), 1)),
        // The mean of both wheels' angles, and what it is by rolling.
        "alpha" => {
            let spins = [0, 1].map(|i| (Place::State(layout.spin(i)), 0.5));
            return Some(Column::Sum(spins.to_vec()));
        }
        "alpha_d" => return Some(Column::Sum(vec![(Place::Output(0), 1.0 / radius)])),
        "alpha_dd" | "beta_dd" => {
            let (velocity, yaw_rate) = match name {
                "alpha_dd" => (1.0 / radius, 0.0),
                _ => (0.0, 1.0),
            };
            // V and ω are linear in the velocity coordinates, whose rates these are.
            let places = (0..layout.dof()).map(|k| {
                let mut unit = [0.0; appell_model::solve::MAX_DOF];
                unit[k] = 1.0;
                let (along, turn) = platform.twist(&unit);
                let factor = velocity * along.x + yaw_rate * turn;
                (Place::Rate(layout.velocity() + k), factor)
            });
            return Some(Column::Sum(places.collect()));
        }
        _ => {}
    }
    let (stem, i) = wheel_of(name, names)?;
    let wheel = |what| output(layout.wheel_output(i, what));
    match stem {
        "q" | "phi" => state(layout.spin(i)),
        "gamma" => {
            let k = layout.swivels.iter().position(|&s| s == i)?;
            state(layout.swivel(k))
        }
        "phi_dot" => wheel(WheelOutput::SpinRate),
        "gamma_dot" => wheel(WheelOutput::SteeringRate),
        "tau" => {
            let Drive::DcMotor(motor) = &platform.wheels()[i].drive else {
                return wheel(WheelOutput::Torque);
            };
            let m = layout.motors.iter().position(|&m| m == i)?;
            let current = Place::State(layout.current() + m);
            Some(Column::Sum(vec![(current, motor.torque_per_current())]))
        }
        "I" => wheel(WheelOutput::Current),
        "F_long" | "F_roller" => wheel(WheelOutput::Longitudinal),
        "F_lat" => wheel(WheelOutput::Lateral),
        _ => None,
    }
}

/// Largest deviation of each column from the vector's data, with its tolerance and name.
pub fn deviations(vector: &Vector, rows: &[Vec<f64>]) -> Vec<(String, f64, f64)> {
    let tolerance = vector
        .tolerance
        .expect("a trajectory vector has a tolerance");
    let names = vector.state_columns.iter().chain(&vector.output_columns);
    let given = vector.input_columns.len();
    names
        .enumerate()
        .map(|(k, name)| {
            let reference = |row: &Vec<Value>| row[given + k].as_f64().unwrap_or(f64::NAN);
            let mut error: f64 = 0.0;
            let mut largest: f64 = 0.0;
            for (row, data) in rows.iter().zip(&vector.data) {
                let off = (row[k] - reference(data)).abs();
                error = if off.is_nan() {
                    f64::INFINITY
                } else {
                    error.max(off)
                };
                largest = largest.max(reference(data).abs());
            }
            (name.clone(), error, tolerance.abs + tolerance.rel * largest)
        })
        .collect()
}

/// Runs every vector of a folder adaptively and writes `<stem>.csv` beside a summary on the terminal.
pub fn run_folder(folder: &Path, out: &Path) -> std::io::Result<bool> {
    std::fs::create_dir_all(out)?;
    let mut good = true;
    for (stem, text) in crate::json_files(folder)? {
        let parsed: Result<Vector, _> = serde_json::from_str(&text);
        let vector = match parsed {
            Ok(vector)
                if vector.schema == "appell-vector/1"
                    && ["trajectory", "pointwise"].contains(&vector.kind.as_str()) =>
            {
                vector
            }
            _ => {
                let value: Value = serde_json::from_str(&text).unwrap_or(Value::Null);
                let word = |key: &str| value[key].as_str().unwrap_or("-").to_owned();
                println!(
                    "passed over  {stem:28} {} {} {}",
                    word("schema"),
                    word("model"),
                    word("kind")
                );
                continue;
            }
        };
        if vector.model == "obstacle_strategy" {
            good &= points::answer_in_words(&stem, &vector, out)?;
            continue;
        }
        // A hundredth of the tightest tolerance in use (1e-9), so that the integration adds nothing.
        let rows = if vector.kind == "pointwise" {
            points(&vector)
        } else {
            run::<f64>(&vector, Method::Adaptive(1e-12))
        };
        match rows {
            Ok(rows) => {
                std::fs::write(out.join(format!("{stem}.csv")), csv(&vector, &rows))?;
                let columns = if vector.data.len() == rows.len() {
                    deviations(&vector, &rows)
                } else {
                    Vec::new()
                };
                let worst = columns
                    .into_iter()
                    .max_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)));
                match worst {
                    Some((name, error, tolerance)) => {
                        let verdict = if error <= tolerance { "ok" } else { "OFF" };
                        good &= error <= tolerance;
                        println!(
                            "{verdict:12} {stem:28} worst {name}: {error:.2e} of {tolerance:.2e}"
                        );
                    }
                    None => println!("written      {stem}"),
                }
            }
            Err(Refusal::Foreign(why)) => println!("passed over  {stem:28} {why}"),
            Err(Refusal::Wrong(why)) => {
                good = false;
                println!("WRONG        {stem:28} {why}");
            }
        }
    }
    Ok(good)
}

/// Times or given values first, then what was computed.
fn csv<C: std::fmt::Display>(vector: &Vector, rows: &[Vec<C>]) -> String {
    let times = ["t".to_owned()];
    let pointwise = vector.kind == "pointwise";
    let first: &[String] = if pointwise {
        &vector.input_columns
    } else {
        &times
    };
    let names = vector.state_columns.iter().chain(&vector.output_columns);
    let head: Vec<&str> = first.iter().chain(names).map(String::as_str).collect();
    let mut text = head.join(",") + "\n";
    for (k, row) in rows.iter().enumerate() {
        let given: Vec<f64> = if pointwise {
            let values = vector.data[k].iter().take(first.len());
            values.map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
        } else {
            vec![vector.t[k]]
        };
        let first = given.iter().map(f64::to_string);
        let cells: Vec<String> = first.chain(row.iter().map(C::to_string)).collect();
        text += &(cells.join(",") + "\n");
    }
    text
}
