//! Rules of a robot file.

use super::super::*;
use super::{Checker, number};

pub(super) fn platform_rules(c: &mut Checker, platform: &Platform, prefix: &str) {
    let path = |field: &str| {
        if prefix.is_empty() {
            field.to_owned()
        } else {
            format!("{prefix}.{field}")
        }
    };
    let before = c.problems.len();
    c.schema(path("schema"), platform.schema);
    c.name(path("name"), &platform.name);
    c.positive(path("collision_radius"), platform.collision_radius);
    c.positive(path("body.mass"), platform.body.mass);
    c.positive(path("body.inertia_com"), platform.body.inertia_com);
    for value in platform.body.center_of_mass {
        c.finite(path("body.center_of_mass"), value);
    }
    c.not_negative(path("body.center_of_mass"), platform.body.center_of_mass[2]);
    if platform.footprint.len() == 1 || platform.footprint.len() == 2 {
        c.refuse(
            path("footprint"),
            "must have at least three corners",
            "leave it out for a circle",
        );
    }
    for corner in platform.footprint.iter().flatten() {
        c.finite(path("footprint"), *corner);
    }
    let names = platform.wheel.iter().map(|w| w.name.as_str());
    c.unique(&path("wheel"), "name", names);
    for wheel in &platform.wheel {
        wheel_rules(c, wheel, &path(&format!("wheel.{}", wheel.name)));
    }
    suspension_rules(c, platform, &path);
    if let Some(trailer) = &platform.trailer {
        trailer_rules(c, trailer, platform, &path("trailer"));
    }
    if c.problems.len() > before {
        return;
    }
    match crate::build::geometry(platform) {
        Err(error) => {
            let (field, problem, hint) = crate::build::explain(&error);
            c.refuse(path(&field), problem, hint);
        }
        Ok(built) if built.degrees().0 == 0 => c.refuse(
            path("wheel"),
            "must leave a way to roll: the steered wheels' axles and those of the others have no common center, got no motion",
            "link the steered wheels (steering kind \"linked\" or \"guided\"), or let some swivel",
        ),
        Ok(_) => {}
    }
}

/// Springs under all wheels or none, and the inertias that they need.
fn suspension_rules(c: &mut Checker, platform: &Platform, path: &dyn Fn(&str) -> String) {
    let body = &platform.body;
    let inertias = [
        ("body.roll_inertia_com", body.roll_inertia_com),
        ("body.pitch_inertia_com", body.pitch_inertia_com),
    ];
    for (field, inertia) in inertias {
        if let Some(inertia) = inertia {
            c.positive(path(field), inertia);
        }
    }
    let Some(sprung) = platform.wheel.iter().find(|w| w.suspension.is_some()) else {
        return;
    };
    for wheel in platform.wheel.iter().filter(|w| w.suspension.is_none()) {
        c.refuse(
            path(&format!("wheel.{}.suspension", wheel.name)),
            format!("must be given, for wheel {} has one", sprung.name),
            "either all wheels of a robot are on springs or none is; a hard one has a large stiffness",
        );
    }
    for (field, inertia) in inertias {
        if inertia.is_none() {
            c.refuse(
                path(field),
                "must be given for a robot with a suspension",
                "of a box of width b and height h, rolling: m (b² + h²) / 12; pitching with its length in place of b",
            );
        }
    }
    if platform.trailer.is_some() {
        c.refuse(
            path("trailer"),
            "must be left out with a suspension: level \"slip\", which has springs, knows no trailer",
            "leave out wheel.suspension",
        );
    }
    if let (Some(roll), Some(pitch)) = (body.roll_inertia_com, body.pitch_inertia_com) {
        let yaw = body.inertia_com;
        for (field, one, others) in [
            ("body.roll_inertia_com", roll, pitch + yaw),
            ("body.pitch_inertia_com", pitch, roll + yaw),
            ("body.inertia_com", yaw, roll + pitch),
        ] {
            c.require(
                // Rounded figures of a flat body may miss it by as much.
                one <= others * 1.01,
                path(field),
                "at most the sum of the two other inertias of the body, as of every rigid body",
                number(one),
            );
        }
    }
}

fn trailer_rules(c: &mut Checker, trailer: &Trailer, platform: &Platform, base: &str) {
    let path = |field: &str| format!("{base}.{field}");
    for value in trailer.hitch {
        c.finite(path("hitch"), value);
    }
    c.require(
        trailer.angle_deg.abs() <= 90.0,
        path("angle_deg"),
        "in [-90, 90]: beyond, the trailer stands in its robot",
        number(trailer.angle_deg),
    );
    if (1..3).contains(&trailer.footprint.len()) {
        c.refuse(
            path("footprint"),
            "must have at least three corners",
            "leave it out to draw bar and wheels only",
        );
    }
    c.finite(path("ahead"), trailer.ahead);
    for (field, value) in [
        ("length", trailer.length),
        ("track", trailer.track),
        ("mass", trailer.mass),
        ("inertia_com", trailer.inertia_com),
        ("radius", trailer.radius),
        ("width", trailer.width),
    ] {
        c.positive(path(field), value);
    }
    for (field, value) in [
        ("hitch_height", trailer.hitch_height),
        ("wheel_mass", trailer.wheel_mass),
        ("spin_inertia", trailer.spin_inertia),
        ("friction.viscous", trailer.friction.viscous),
        ("friction.dry", trailer.friction.dry),
        ("friction.rolling", trailer.friction.rolling),
        ("friction.pivot_viscous", trailer.friction.pivot_viscous),
    ] {
        c.not_negative(path(field), value);
    }
    if trailer.ahead.abs() >= trailer.length {
        c.refuse(
            path("ahead"),
            format!(
                "must be within {} m of the axle, its distance from the hitch, got {}",
                number(trailer.length),
                number(trailer.ahead)
            ),
            "it is the distance of the center of mass before the axle",
        );
    }
    let lifted = -trailer.mass * trailer.ahead / trailer.length;
    if lifted >= platform.body.mass {
        c.refuse(
            path("ahead"),
            format!(
                "must leave weight on the hitch's robot: a trailer that pulls its hitch up with {lifted:.3} kg lifts a body of {} kg",
                number(platform.body.mass)
            ),
            "move the load ahead of the axle: ahead > 0",
        );
    }
    for corner in trailer.footprint.iter().flatten() {
        c.finite(path("footprint"), *corner);
    }
    if platform.wheel.iter().any(|wheel| wheel.name == TRAILER) {
        c.refuse(
            path("hitch"),
            format!("must not stand beside a wheel of the name \"{TRAILER}\""),
            "the trailer's axle has this name; rename the wheel",
        );
    }
}

fn tire_rules(c: &mut Checker, tire: &Tire, base: &str) {
    let positive = match *tire {
        Tire::Coulomb {
            friction,
            stribeck,
            rounding,
            ..
        } => [
            ("friction", friction),
            ("stribeck", stribeck),
            ("rounding", rounding),
        ],
        Tire::Lugre {
            friction,
            stribeck,
            stiffness,
            ..
        } => [
            ("friction", friction),
            ("stribeck", stribeck),
            ("stiffness", stiffness),
        ],
        Tire::Brush {
            friction,
            stiffness,
            relaxation,
            ..
        }
        | Tire::MagicFormula {
            friction,
            stiffness,
            relaxation,
            ..
        }
        | Tire::Linear {
            friction,
            stiffness,
            relaxation,
            ..
        } => [
            ("friction", friction),
            ("stiffness", stiffness),
            ("relaxation", relaxation),
        ],
    };
    for (field, value) in positive {
        // Beyond, a contact is no tire, and its numbers lose their digits.
        let (low, high) = match field {
            "friction" => (1e-4, 100.0),
            "stiffness" => (1e-3, 1e6),
            "relaxation" | "rounding" | "stribeck" => (1e-5, 100.0),
            _ => unreachable!("named above"),
        };
        c.require(
            (low..=high).contains(&value),
            format!("{base}.{field}"),
            &format!("in [{low}, {high}]"),
            number(value),
        );
    }
    match *tire {
        Tire::Coulomb {
            breakaway: Some(breakaway),
            friction,
            ..
        }
        | Tire::Lugre {
            breakaway: Some(breakaway),
            friction,
            ..
        } => c.require(
            breakaway.is_finite() && breakaway >= friction,
            format!("{base}.breakaway"),
            &format!("at least friction = {}", number(friction)),
            number(breakaway),
        ),
        _ => {}
    }
    match *tire {
        Tire::Coulomb { .. } => {}
        Tire::Lugre {
            damping, viscous, ..
        } => {
            c.not_negative(format!("{base}.damping"), damping);
            c.not_negative(format!("{base}.viscous"), viscous);
        }
        Tire::Brush { damping, .. }
        | Tire::MagicFormula { damping, .. }
        | Tire::Linear { damping, .. } => c.not_negative(format!("{base}.damping"), damping),
    }
    if let Tire::MagicFormula {
        shape, curvature, ..
    } = *tire
    {
        c.require(
            (1.0..=2.0).contains(&shape),
            format!("{base}.shape"),
            "in [1, 2]",
            number(shape),
        );
        c.require(
            curvature.is_finite() && curvature <= 1.0,
            format!("{base}.curvature"),
            "at most 1",
            number(curvature),
        );
    }
}

fn wheel_rules(c: &mut Checker, wheel: &Wheel, base: &str) {
    let path = |field: &str| format!("{base}.{field}");
    c.name(path("name"), &wheel.name);
    for value in wheel.mount {
        c.finite(path("mount"), value);
    }
    c.positive(path("radius"), wheel.radius);
    c.positive(path("width"), wheel.width);
    for (field, value) in [
        ("mass", wheel.mass),
        ("spin_inertia", wheel.spin_inertia),
        ("vertical_inertia", wheel.vertical_inertia),
        ("friction.viscous", wheel.friction.viscous),
        ("friction.dry", wheel.friction.dry),
        ("friction.rolling", wheel.friction.rolling),
        ("friction.pivot_viscous", wheel.friction.pivot_viscous),
        ("brake_torque", wheel.brake_torque),
    ] {
        c.not_negative(path(field), value);
    }
    tire_rules(c, &wheel.tire, &path("tire"));
    if let Some(suspension) = &wheel.suspension {
        c.positive(path("suspension.stiffness"), suspension.stiffness);
        c.not_negative(path("suspension.damping"), suspension.damping);
    }
    match &wheel.steering {
        &Steering::Fixed { angle_deg } => c.finite(path("steering.angle_deg"), angle_deg),
        Steering::Steered {
            angle_deg,
            angle_max_deg,
            rate_max,
            torque_max,
            bandwidth,
        } => {
            c.require(
                *angle_max_deg > 0.0 && *angle_max_deg <= 180.0,
                path("steering.angle_max_deg"),
                "in (0, 180]",
                number(*angle_max_deg),
            );
            c.require(
                angle_deg.abs() <= *angle_max_deg,
                path("steering.angle_deg"),
                &format!("within ± angle_max_deg = {}", number(*angle_max_deg)),
                number(*angle_deg),
            );
            c.positive(path("steering.rate_max"), *rate_max);
            c.positive(path("steering.bandwidth"), *bandwidth);
            if let Some(torque) = torque_max {
                c.positive(path("steering.torque_max"), *torque);
            }
            if wheel.vertical_inertia <= 0.0 {
                c.refuse(
                    path("vertical_inertia"),
                    format!(
                        "must be > 0 on a steered wheel, got {}",
                        wheel.vertical_inertia
                    ),
                    "the steering motor turns it; m (3 r² + w²) / 12 of a solid cylinder will do",
                );
            }
        }
        Steering::Linked { ratio, .. } => c.require(
            *ratio != 0.0 && ratio.abs() <= 10.0,
            path("steering.ratio"),
            "in [-10, 10] and not 0",
            number(*ratio),
        ),
        Steering::Guided { .. } => {}
        &Steering::Free { trail, angle_deg } => {
            c.finite(path("steering.angle_deg"), angle_deg);
            if !(trail.is_finite() && trail != 0.0) {
                c.refuse(
                    path("steering.trail"),
                    format!("must be finite and not 0, got {trail}"),
                    "a caster swivels because its contact trails the pivot",
                );
            }
        }
    }
    if let Rim::Rollers { angle_deg } = wheel.rim {
        let good = angle_deg.abs() < 85.0;
        if !good {
            c.refuse(
                path("rim.angle_deg"),
                format!("must be between -85 and 85, got {}", number(angle_deg)),
                "45 for mecanum wheels, 0 for omni wheels; near 90 a rim has no grip",
            );
        }
    }
    match &wheel.drive {
        Drive::None => {}
        Drive::Torque {
            torque_max,
            rate_max,
        } => {
            c.positive(path("drive.torque_max"), *torque_max);
            c.positive(path("drive.rate_max"), *rate_max);
        }
        Drive::DcMotor {
            resistance,
            inductance,
            torque_constant,
            back_emf_constant,
            gear_ratio,
            gear_efficiency,
            rotor_inertia,
            voltage_max,
            current_max,
        } => {
            c.positive(path("drive.resistance"), *resistance);
            c.not_negative(path("drive.inductance"), *inductance);
            c.positive(path("drive.torque_constant"), *torque_constant);
            if let Some(constant) = back_emf_constant {
                c.positive(path("drive.back_emf_constant"), *constant);
            }
            c.positive(path("drive.gear_ratio"), *gear_ratio);
            c.share(path("drive.gear_efficiency"), *gear_efficiency);
            c.not_negative(path("drive.rotor_inertia"), *rotor_inertia);
            c.positive(path("drive.voltage_max"), *voltage_max);
            if let Some(current) = current_max {
                c.positive(path("drive.current_max"), *current);
            }
        }
    }
}
