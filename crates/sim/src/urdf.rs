//! Robots from URDF: joints, inertias and shapes of wheels to a robot file.
//!
//! A URDF says where wheels are, not what drives them, nor that a ball rolls under the tail. What is taken:
//!
//! - a `continuous` joint with a horizontal axis, whose link is a cylinder or a sphere, is a wheel;
//! - a `revolute` joint with a vertical axis above a wheel steers it, a `continuous` one lets it swivel;
//! - what stands on the ground otherwise, as a ball or a slider, is stood in for by a caster without mass;
//! - all other links are the body.
//!
//! What is missing is asked for by name, and what cannot be is told. Meshes are not read, nor is any file
//! but the one that is named.

mod tree;

use std::collections::BTreeMap;

use appell_model::math::hypot;
use appell_model::scalar::Scalar;

use roxmltree::{Document, ParsingOptions};

use crate::scenario::{Body, Drive, Friction, Platform, Rim, SCHEMA, Steering, Tire, Wheel};
use tree::{Found, Link, Matrix, Reader, Tree, Vector, dot, sum, tree, turned};

/// Longest file, bytes.
pub const SIZE_MAX: u64 = 16 << 20;
/// Most nodes of its text.
const NODES_MAX: u32 = 1 << 20;
/// Most links.
const LINKS_MAX: usize = 10_000;
/// How far from upright an axis may be that counts as upright, or as level: its sine.
const TILT_MAX: f64 = 0.05;

/// What a URDF leaves open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answers {
    /// Joints of the wheels that are driven; those that the file has actuators for if left out.
    pub driven: Vec<String>,
    /// Largest torque of a driven wheel where its joint has no limit, N·m.
    pub torque_max: Option<f64>,
    /// Largest rate of a driven wheel where its joint has no limit, rad/s.
    pub rate_max: Option<f64>,
    /// Joints of wheels with rollers, and the angle from the rolling direction to the roller's axis, degrees.
    pub rollers: BTreeMap<String, f64>,
    /// Mass of the body where the file has none, kg.
    pub mass: Option<f64>,
    /// Radius of the disc that must not touch anything where the file has no shapes, m.
    pub collision_radius: Option<f64>,
}

/// A robot, and what is to be said of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The robot.
    pub platform: Platform,
    /// What was found implausible, each with its link or joint.
    pub warnings: Vec<String>,
    /// What was left out or assumed.
    pub remarks: Vec<String>,
}

/// A caster stands in for what slides on the ground otherwise: its trail and radius have no effect.
const STAND_IN: (f64, f64) = (0.01, 0.005);

/// Makes a robot of a URDF's text.
///
/// # Errors
/// It is no URDF, is no wheeled robot, or leaves open what `answers` do not say; each with its line or name.
pub fn import(text: &str, answers: &Answers) -> Result<Imported, String> {
    let options = ParsingOptions {
        allow_dtd: false,
        nodes_limit: NODES_MAX,
        ..ParsingOptions::default()
    };
    let document =
        Document::parse_with_options(text, options).map_err(|error| error.to_string())?;
    let tree = tree(&Reader {
        document: &document,
    })?;
    let mut warnings = Vec::new();
    let mut remarks = Vec::new();
    for link in &tree.links {
        implausible(link, &mut warnings);
    }
    let wheels = tree.wheels();
    if wheels.is_empty() {
        return Err(
            "must have a wheel: a joint of type continuous with a level axis, whose link is a cylinder or sphere"
                .to_owned(),
        );
    }
    let lowest = |wheel: &Found| wheel.center[2] - wheel.radius;
    let ground = wheels.iter().map(lowest).fold(f64::INFINITY, f64::min);
    let smallest = wheels
        .iter()
        .map(|wheel| wheel.radius)
        .fold(f64::INFINITY, f64::min);
    for wheel in &wheels {
        let above = lowest(wheel) - ground;
        if above > 0.01 * wheel.radius {
            warnings.push(format!(
                "joint {}: the wheel ends {above:.4} m above the ground of the others; it is put on it",
                tree.joints[wheel.joint].name
            ));
        }
    }

    let mut missing = Vec::new();
    for name in answers.driven.iter().chain(answers.rollers.keys()) {
        if !wheels
            .iter()
            .any(|wheel| tree.joints[wheel.joint].name == name)
        {
            let known: Vec<&str> = wheels
                .iter()
                .map(|wheel| tree.joints[wheel.joint].name)
                .collect();
            return Err(format!(
                "must be a wheel's joint, got {name}\n  hint: there are: {}",
                known.join(", ")
            ));
        }
    }
    let is_driven = |name: &str| match answers.driven.is_empty() {
        true => tree.actuated.contains(&name),
        false => answers.driven.iter().any(|driven| driven == name),
    };
    if !wheels
        .iter()
        .any(|wheel| is_driven(tree.joints[wheel.joint].name))
    {
        let names: Vec<&str> = wheels
            .iter()
            .map(|wheel| tree.joints[wheel.joint].name)
            .collect();
        missing.push(format!(
            "which of {} are driven: --driven JOINT,JOINT",
            names.join(", ")
        ));
    }

    let on_wheels: Vec<usize> = wheels.iter().map(|wheel| wheel.joint).collect();
    let mut made = Vec::new();
    for wheel in &wheels {
        made.push(made_wheel(
            &tree,
            wheel,
            &on_wheels,
            answers,
            &is_driven,
            &mut missing,
            &mut remarks,
        ));
    }

    // The body: all that hangs on no wheel.
    let (mut mass, mut moment) = (0.0, [0.0; 3]);
    let of_body = || (0..tree.links.len()).filter(|&k| !tree.hangs_on(k, &on_wheels));
    for k in of_body() {
        if let Some(inertial) = &tree.links[k].inertial {
            let center = tree.frames[k].at(inertial.frame.place);
            mass += inertial.mass;
            moment = sum(moment, center.map(|part| part * inertial.mass));
        } else if !tree.links[k].shapes.is_empty() || tree.links[k].has_mesh {
            remarks.push(format!(
                "link {}: has no inertial; counted without mass",
                tree.links[k].name
            ));
        }
        if tree.links[k].has_mesh {
            remarks.push(format!(
                "link {}: has a mesh, which is not read; the outline lacks it",
                tree.links[k].name
            ));
        }
    }
    let center = moment.map(|part| if mass > 0.0 { part / mass } else { 0.0 });
    let mut inertia = 0.0;
    for k in of_body() {
        if let Some(inertial) = &tree.links[k].inertial {
            let frame = tree.frames[k].then(&inertial.frame);
            let [dx, dy, _] = [0, 1, 2].map(|axis| frame.place[axis] - center[axis]);
            inertia += about(frame.turn, inertial.inertia, [0.0, 0.0, 1.0]);
            inertia += inertial.mass * (dx * dx + dy * dy);
        }
    }
    let stand_ins = stand_ins(&tree, &wheels, &on_wheels, ground, smallest, &mut remarks);
    made.extend(stand_ins);

    let footprint = outline(&tree, of_body());
    let mut reach = { footprint.iter() }.fold(0.0, |most, [x, y]| f64::max(most, hypot(*x, *y)));
    for wheel in &wheels {
        let (x, y) = (wheel.center[0].abs(), wheel.center[1].abs());
        reach = f64::max(reach, hypot(x + wheel.radius, y + 0.5 * wheel.width));
    }
    if let Some(radius) = answers.collision_radius {
        reach = radius;
    } else if footprint.is_empty() {
        missing.push(
            "how far it reaches, for no link of its body has a shape: --collision-radius M".into(),
        );
    }
    if let Some(given) = answers.mass {
        // What mass there is keeps its place.
        inertia *= if mass > 0.0 { given / mass } else { 1.0 };
        mass = given;
    }
    if mass <= 0.0 {
        missing.push("the mass of its body, for no link has one: --mass KG".into());
    }
    if inertia <= 0.0 && mass > 0.0 {
        inertia = mass * 0.25 * reach * reach;
        remarks.push(format!(
            "the body has no inertia about the vertical; {inertia:.4} kg·m² of half its reach is assumed"
        ));
    }
    if !missing.is_empty() {
        return Err(format!("leaves open:\n  {}", missing.join("\n  ")));
    }
    let platform = Platform {
        schema: SCHEMA,
        name: plain(tree.name),
        description: format!("Made from the URDF of {}.", tree.name),
        collision_radius: rounded(reach * (1.0 + 1e-9)),
        footprint: footprint
            .into_iter()
            .map(|point| point.map(rounded))
            .collect(),
        body: Body {
            mass: rounded(mass),
            inertia_com: rounded(inertia),
            center_of_mass: [center[0], center[1], center[2] - ground].map(rounded),
            roll_inertia_com: None,
            pitch_inertia_com: None,
        },
        wheel: made,
        trailer: None,
    };
    Ok(Imported {
        platform,
        warnings,
        remarks,
    })
}

fn made_wheel(
    tree: &Tree,
    wheel: &Found,
    on_wheels: &[usize],
    answers: &Answers,
    is_driven: &dyn Fn(&str) -> bool,
    missing: &mut Vec<String>,
    remarks: &mut Vec<String>,
) -> Wheel {
    let joint = &tree.joints[wheel.joint];
    // All that turns with it.
    let (mut mass, mut spin, mut vertical) = (0.0, 0.0, 0.0);
    let axis = tree.axis(wheel.joint);
    for k in (0..tree.links.len()).filter(|&k| tree.ancestors(k).any(|above| above == wheel.joint))
    {
        if let Some(inertial) = &tree.links[k].inertial {
            let frame = tree.frames[k].then(&inertial.frame);
            mass += inertial.mass;
            spin += about(frame.turn, inertial.inertia, axis);
            vertical += about(frame.turn, inertial.inertia, [0.0, 0.0, 1.0]);
        }
    }
    debug_assert!(on_wheels.contains(&wheel.joint), "a wheel's own joint");
    if mass <= 0.0 || spin <= 0.0 {
        remarks.push(format!("joint {}: its wheel has no inertia", joint.name));
    }
    // To the left of its rolling direction lies its axis.
    let along = |axis: Vector| {
        let sign = if axis[1] < 0.0 || (axis[1].abs() < TILT_MAX && axis[0] > 0.0) {
            -1.0
        } else {
            1.0
        };
        let angle: f64 = Scalar::atan2(-axis[0] * sign, axis[1] * sign);
        let degrees = angle.to_degrees();
        if degrees.abs() < 1e-6 {
            0.0
        } else {
            rounded(degrees)
        }
    };
    if axis[1] < -TILT_MAX {
        remarks.push(format!(
            "joint {}: turns backwards in the file, its axis points to the right; here all wheels roll forward at \
             positive rates",
            joint.name
        ));
    }
    let mut mount = [wheel.center[0], wheel.center[1]];
    let steering = match wheel.steered_by {
        None => Steering::Fixed {
            angle_deg: along(axis),
        },
        Some(above) => {
            let pivot = tree.frames[tree.joints[above].child].place;
            let trail = hypot(pivot[0] - mount[0], pivot[1] - mount[1]);
            mount = [pivot[0], pivot[1]];
            match tree.joints[above].kind {
                "revolute" => {
                    let [lower, upper, effort, velocity] = tree.joints[above].limits;
                    if trail > 0.01 * wheel.radius {
                        remarks.push(format!(
                            "joint {}: stands {trail:.4} m beside the wheel's contact; a steered wheel turns above it",
                            tree.joints[above].name
                        ));
                    }
                    let most = f64::min(
                        upper.unwrap_or(std::f64::consts::FRAC_PI_2).abs(),
                        lower.unwrap_or(-std::f64::consts::FRAC_PI_2).abs(),
                    );
                    Steering::Steered {
                        angle_deg: 0.0,
                        angle_max_deg: rounded(most.to_degrees()),
                        rate_max: velocity.filter(|v| *v > 0.0).unwrap_or(4.0),
                        torque_max: effort.filter(|v| *v > 0.0),
                        bandwidth: 20.0,
                    }
                }
                _ => Steering::Free {
                    trail: rounded(f64::max(trail, 1e-4)),
                    angle_deg: {
                        let back: f64 =
                            Scalar::atan2(pivot[1] - wheel.center[1], pivot[0] - wheel.center[0]);
                        if trail > 1e-6 {
                            rounded(back.to_degrees())
                        } else {
                            0.0
                        }
                    },
                },
            }
        }
    };
    let free = matches!(steering, Steering::Free { .. });
    let drive = match is_driven(joint.name) && !free {
        false => Drive::None,
        true => {
            let mut ask = |limit: Option<f64>, answer: Option<f64>, what: &str| {
                let value = answer.or(limit.filter(|value| *value > 0.0));
                if value.is_none() {
                    missing.push(format!("joint {}: {what}", joint.name));
                }
                value.unwrap_or(1.0)
            };
            Drive::Torque {
                torque_max: ask(
                    joint.limits[2],
                    answers.torque_max,
                    "the largest torque of its drive: --torque-max N·m",
                ),
                rate_max: ask(
                    joint.limits[3],
                    answers.rate_max,
                    "the largest rate of its drive: --rate-max RAD/S",
                ),
            }
        }
    };
    Wheel {
        name: plain(joint.name),
        mount: mount.map(rounded),
        radius: rounded(wheel.radius),
        width: rounded(wheel.width),
        steering,
        rim: match answers.rollers.get(joint.name) {
            None => Rim::Plain,
            Some(&angle_deg) => Rim::Rollers { angle_deg },
        },
        mass: rounded(mass),
        spin_inertia: rounded(spin),
        vertical_inertia: rounded(vertical),
        friction: Friction::default(),
        brake_torque: 0.0,
        drive,
        tire: Tire::default(),
        suspension: None,
    }
}

/// Casters for what stands on the ground without rolling.
fn stand_ins(
    tree: &Tree,
    wheels: &[Found],
    on_wheels: &[usize],
    ground: f64,
    radius: f64,
    remarks: &mut Vec<String>,
) -> Vec<Wheel> {
    let mut made = Vec::new();
    for (k, link) in tree.links.iter().enumerate() {
        let carries = wheels.iter().any(|wheel| {
            wheel
                .steered_by
                .is_some_and(|joint| tree.joints[joint].child == k)
        });
        if k == tree.root || carries || tree.hangs_on(k, on_wheels) {
            continue;
        }
        let bottom = link.shapes.iter().filter_map(|(frame, shape)| {
            let frame = tree.frames[k].then(frame);
            let points = shape.points();
            let low = points
                .iter()
                .map(|point| frame.at(*point)[2])
                .fold(f64::INFINITY, f64::min);
            (low < ground + 0.1 * radius).then_some(frame.place)
        });
        let Some(place) = { bottom }.next() else {
            continue;
        };
        remarks.push(format!(
            "link {}: stands on the ground without rolling; stood in for by a free caster without mass and losses",
            link.name
        ));
        let (trail, radius) = STAND_IN;
        made.push(Wheel {
            name: plain(link.name),
            mount: [place[0], place[1]].map(rounded),
            radius,
            width: radius,
            steering: Steering::Free {
                trail,
                angle_deg: 0.0,
            },
            rim: Rim::Plain,
            mass: 0.0,
            spin_inertia: 0.0,
            vertical_inertia: 0.0,
            friction: Friction::default(),
            brake_torque: 0.0,
            drive: Drive::None,
            tire: Tire::default(),
            suspension: None,
        });
    }
    made
}

/// An inertia about an axis through its own center of mass; `turn` is that of its frame.
fn about(turn: Matrix, inertia: Matrix, axis: Vector) -> f64 {
    // The axis in the frame of the inertia.
    let own = [0, 1, 2].map(|k| dot([0, 1, 2].map(|i| turn[i][k]), axis));
    dot(own, turned(inertia, own))
}

/// What no body can have, and what this one hardly has.
fn implausible(link: &Link, warnings: &mut Vec<String>) {
    let Some(inertial) = &link.inertial else {
        return;
    };
    let name = link.name;
    let m = inertial.inertia;
    if inertial.mass == 0.0 {
        if m.iter().flatten().any(|value| *value != 0.0) {
            warnings.push(format!("link {name}: has inertia without mass"));
        }
        return;
    }
    let [xx, yy, zz] = [m[0][0], m[1][1], m[2][2]];
    if xx <= 0.0 || yy <= 0.0 || zz <= 0.0 {
        warnings.push(format!(
            "link {name}: moments of inertia must be > 0, got {xx}, {yy}, {zz}"
        ));
        return;
    }
    let minor = |i: usize, j: usize| m[i][i] * m[j][j] - m[i][j] * m[i][j];
    let determinant = xx * minor(1, 2) - m[0][1] * (m[0][1] * zz - m[1][2] * m[0][2])
        + m[0][2] * (m[0][1] * m[1][2] - yy * m[0][2]);
    if minor(0, 1) <= 0.0 || minor(0, 2) <= 0.0 || minor(1, 2) <= 0.0 || determinant <= 0.0 {
        warnings.push(format!(
            "link {name}: its inertia is not positive about every axis"
        ));
    }
    for (axis, own, others) in [("x", xx, yy + zz), ("y", yy, xx + zz), ("z", zz, xx + yy)] {
        if own > others * (1.0 + 1e-6) {
            warnings.push(format!(
                "link {name}: the moment of inertia about {axis} is above the sum of the others, {own:.3e} > \
                 {others:.3e} kg·m², which no body has"
            ));
        }
    }
    let points = || {
        let shapes = link.shapes.iter();
        shapes.flat_map(|(frame, shape)| shape.points().into_iter().map(|p| frame.at(p)))
    };
    let center = inertial.frame.place;
    let far = |p: Vector| {
        let d = sum(p, center.map(|part| -part));
        dot(d, d).sqrt()
    };
    let reach = points().map(far).fold(0.0, f64::max);
    let gyration = (xx.max(yy).max(zz) / inertial.mass).sqrt();
    if reach > 0.0 && gyration > reach * (1.0 + 1e-6) {
        warnings.push(format!(
            "link {name}: a gyration radius of {gyration:.4} m needs mass beyond its own reach of {reach:.4} m"
        ));
    }
    let low = [0, 1, 2].map(|k| points().map(|p| p[k]).fold(f64::INFINITY, f64::min));
    let high = [0, 1, 2].map(|k| points().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max));
    let slack = 0.02 * reach;
    if reach > 0.0 && (0..3).any(|k| center[k] < low[k] - slack || center[k] > high[k] + slack) {
        warnings.push(format!(
            "link {name}: its center of mass lies outside its shape"
        ));
    }
}

/// Convex outline of links from above, counter-clockwise; empty where there are no shapes.
fn outline(tree: &Tree, links: impl Iterator<Item = usize>) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = Vec::new();
    for k in links {
        for (frame, shape) in &tree.links[k].shapes {
            let frame = tree.frames[k].then(frame);
            points.extend(shape.points().into_iter().map(|p| {
                let p = frame.at(p);
                // Corners that differ by rounding are one.
                [p[0], p[1]].map(|v| (v * 1e6).round() / 1e6 + 0.0)
            }));
        }
    }
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return Vec::new();
    }
    let mut hull: Vec<[f64; 2]> = Vec::new();
    for half in [points.clone(), points.into_iter().rev().collect()] {
        let begin = hull.len();
        for p in half {
            while hull.len() >= begin + 2 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                let left = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
                if left > 1e-12 {
                    break;
                }
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    }
    if hull.len() < 3 { Vec::new() } else { hull }
}

/// A name that paths can have.
fn plain(name: &str) -> String {
    let letter = |c: char| match c.is_ascii_alphanumeric() || c == '-' || c == '_' {
        true => c,
        false => '-',
    };
    name.chars().map(letter).collect()
}

/// To nine digits: what a sum leaves beyond is not in the file.
fn rounded(value: f64) -> f64 {
    let text = format!("{value:.9e}");
    let near: f64 = text.parse().unwrap_or(value);
    if near.abs() < 1e-12 { 0.0 } else { near }
}
