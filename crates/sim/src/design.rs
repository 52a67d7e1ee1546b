//! The design report of a robot: what its file implies, and what in it is implausible.

use appell_model::drive::Drive;
use appell_model::math::hypot;
use appell_model::math::single::atan2;
use appell_model::planar::vec2;
use appell_model::platform::Platform;
use appell_model::solve::{dot, invert, product};
use appell_model::support::Support;
use appell_model::suspension::{Sprung, Suspension};
use appell_model::wheel::Steering;

use std::f64::consts::PI;

use crate::build::{self, DriveModel};
use crate::scenario::{self, Platform as File};

/// One line of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What it is.
    pub name: String,
    /// Its value, with unit.
    pub value: String,
    /// How it was found.
    pub note: String,
}

/// What a robot file implies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Design {
    /// Properties, in order.
    pub findings: Vec<Finding>,
    /// Implausible numbers, each with its path.
    pub warnings: Vec<String>,
}

/// Why a robot cannot turn under ideal rolling, if it cannot: skid-steered ones.
pub fn goes_straight_only(platform: &Platform<f64>) -> Option<&'static str> {
    let mut first = appell_model::solve::zero_row();
    first[0] = 1.0;
    let (_, turn) = platform.twist(&first);
    (platform.layout().eta == 1 && turn.abs() < 1e-9).then_some(
        "the axles of its fixed wheels have no common center: ideal rolling goes straight; level \"slip\" turns it",
    )
}

/// Largest curvature at which the base's origin can be driven by what the steered wheels allow, 1/m;
/// infinite for a robot that can turn on the spot, 0 for one whose linkages let it go straight only.
pub fn sharpest_curve(file: &File) -> f64 {
    const SLACK: f64 = 1e-6;
    let is_bound = |wheel: &scenario::Wheel| {
        use scenario::Steering;
        matches!(
            wheel.steering,
            Steering::Steered { .. } | Steering::Linked { .. }
        )
    };
    if !file.wheel.iter().any(is_bound) {
        return f64::INFINITY;
    }
    // Either end of a wheel may lead.
    let folded = |angle: f64| (angle - PI * (angle / PI).round()).abs();
    // Angle of a wheel that goes this way; none at a standstill, where any will do.
    let angle = |velocity: [f64; 2]| {
        let moves = hypot(velocity[0], velocity[1]) > 1e-9;
        moves.then(|| atan2(velocity[1], velocity[0]))
    };
    let rolls = |velocity: &dyn Fn([f64; 2]) -> [f64; 2]| {
        file.wheel.iter().all(|wheel| match &wheel.steering {
            scenario::Steering::Steered { angle_max_deg, .. } => angle(velocity(wheel.mount))
                .is_none_or(|angle| folded(angle) <= angle_max_deg.to_radians() + SLACK),
            scenario::Steering::Linked { to, ratio } => {
                let lead = file.wheel.iter().find(|other| other.name == *to);
                let lead = lead.and_then(|lead| angle(velocity(lead.mount)));
                let (Some(own), Some(lead)) = (angle(velocity(wheel.mount)), lead) else {
                    return true;
                };
                let lead = lead - PI * (lead / PI).round();
                folded(own - ratio * lead) <= SLACK
            }
            _ => true,
        })
    };
    // Both ways, as the wheels may stand unlike on both sides.
    let allowed = |curvature: f64| {
        [curvature, -curvature]
            .into_iter()
            .all(|k| rolls(&|[x, y]| [1.0 - k * y, k * x]))
    };
    let on_the_spot = rolls(&|[x, y]| [-y, x]);
    // From 1 km to 1 mm of radius; then halving between the last that is allowed and the next.
    let (mut low, mut high) = (0.0, 1e-3);
    while allowed(high) {
        if high > 1e3 {
            return if on_the_spot { f64::INFINITY } else { high };
        }
        (low, high) = (high, 1.03 * high);
    }
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if allowed(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Derives the report for a gravity in m/s².
///
/// # Panics
/// If the file has not been checked.
pub fn design(file: &File, gravity: f64) -> Design {
    let platform = build::platform(file, DriveModel::AsBuilt, gravity)
        .expect("a checked platform can be built");
    let layout = platform.layout();
    let wheels = platform.wheels();
    let n = layout.dof();
    let mut report = Design::default();
    let mut add = |name: &str, value: String, note: &str| {
        report.findings.push(Finding {
            name: name.into(),
            value,
            note: note.into(),
        });
    };
    let (mobility, steerability) = platform.degrees();
    add(
        "degree of mobility δm",
        mobility.to_string(),
        &format!(
            "type ({mobility}, {steerability}) of Campion, Bastin and d'Andréa-Novel; steerability δs = {steerability}"
        ),
    );
    if let Some(reason) = goes_straight_only(&platform) {
        add("turning", "none".into(), reason);
    }
    let lateral = wheels
        .iter()
        .filter(|w| w.is_plain() && matches!(w.steering, Steering::Fixed { .. }))
        .count();
    add(
        "fixed lateral constraints",
        format!("{lateral}, rank {}", layout.fixed_rank),
        &format!("{} redundant", lateral - layout.fixed_rank),
    );
    let mass = platform.total_mass();
    let towed: f64 = file
        .trailer
        .iter()
        .map(|t| t.mass + 2.0 * t.wheel_mass)
        .sum();
    add(
        "mass",
        format!("{mass:.4} kg"),
        if file.trailer.is_some() {
            "with wheels and trailer"
        } else {
            "with wheels"
        },
    );
    if let Some(trailer) = &file.trailer {
        add(
            "mass of the trailer",
            format!("{towed:.4} kg"),
            "with wheels",
        );
        add(
            "static load on the hitch",
            format!(
                "{:.2} N",
                build::trailer::<f64>(trailer).hitch_mass() * gravity
            ),
            "level ground",
        );
    }
    let center = center_of_mass(file, mass - towed);
    add(
        "center of mass",
        format!("({:.4}, {:.4}, {:.4}) m", center[0], center[1], center[2]),
        if file.trailer.is_some() {
            "without the trailer; x forward, y left, z up"
        } else {
            "whole robot; x forward, y left, z up"
        },
    );
    for (wheel, load) in wheels.iter().zip(build::static_loads(&platform, gravity)) {
        add(
            &format!("static load, {}", wheel.name),
            format!("{load:.2} N"),
            "level ground",
        );
    }

    if let Some(springs) = build::springs(file, "", &build::Values::new(&[])) {
        swings(&springs, &platform, center, &mut add);
    }

    // Straight motion and turning, seen through the reduced equations.
    let x = build::rest_state(&platform, [0.0; 3], &[]);
    let reduced = platform.reduce(&x);
    let inverse = invert(n, &reduced.mass);
    let unit = |forward: f64, yaw: f64| platform.velocity_from_twist(vec2(forward, 0.0), yaw, &[]);
    let mut speed = f64::INFINITY;
    let mut turn = f64::INFINITY;
    let (mut push, mut hold) = (0.0, 0.0);
    let mut damping = [0.0; 2];
    for (i, wheel) in wheels.iter().enumerate() {
        let row = platform.spin_row(i, &platform.wheel_frame(i, &x));
        let [ahead, about] = [unit(1.0, 0.0), unit(0.0, 1.0)].map(|v| dot(n, &row, &v));
        hold += (wheel.dry_friction + wheel.brake) * ahead.abs();
        let (rate, torque, drag) = match &wheel.drive {
            Drive::None | Drive::Rate { .. } => {
                damping[0] += wheel.viscous * ahead * ahead;
                damping[1] += wheel.viscous * about * about;
                continue;
            }
            Drive::Torque { torque_max } => (f64::INFINITY, *torque_max, 0.0),
            Drive::DcMotor(motor) => {
                let drag = motor.torque_per_current() * motor.back_emf(1.0) / motor.resistance;
                (motor.no_load_rate(), motor.stall_torque(), drag)
            }
        };
        speed = speed.min(rate / ahead.abs().max(1e-12));
        turn = turn.min(rate / about.abs().max(1e-12));
        push += torque * ahead.abs();
        damping[0] += (drag + wheel.viscous) * ahead * ahead;
        damping[1] += (drag + wheel.viscous) * about * about;
        if let Drive::DcMotor(motor) = &wheel.drive
            && motor.inductance > 0.0
        {
            add(
                &format!("electrical time constant, {}", wheel.name),
                time(motor.inductance / motor.resistance),
                "L/R",
            );
        }
    }
    if speed.is_finite() {
        add("top speed", format!("{speed:.3} m/s"), "straight, no load");
        // Steered wheels turn a robot by their angles.
        if layout.steered.is_empty() && turn < 1e6 {
            add(
                "top yaw rate",
                format!("{turn:.3} rad/s"),
                "on the spot, no load",
            );
        }
    }
    if layout.steered.is_empty() {
        let motions = [
            ("forward at 1 m/s", [1.0, 0.0, 0.0]),
            ("to the left at 1 m/s", [0.0, 1.0, 0.0]),
            ("turning left at 1 rad/s", [0.0, 0.0, 1.0]),
        ];
        let driven: Vec<usize> = (0..wheels.len())
            .filter(|&i| !matches!(wheels[i].drive, Drive::None))
            .collect();
        for (name, twist) in motions {
            let v = platform.velocity_from_twist(vec2(twist[0], twist[1]), twist[2], &[]);
            let (got, turning) = platform.twist(&v);
            let off = hypot(got.x - twist[0], got.y - twist[1]).max((turning - twist[2]).abs());
            if off > 1e-9 || driven.is_empty() {
                continue;
            }
            let rates = platform.rates_from_twist(&x, twist);
            // Rounding is no rate.
            let text = |&i: &usize| format!("{:.3}", (rates[i] * 1e9).round() / 1e9 + 0.0);
            let texts: Vec<String> = driven.iter().map(text).collect();
            let names: Vec<&str> = driven.iter().map(|&i| wheels[i].name.as_str()).collect();
            let note = format!("rad/s of {}", names.join(", "));
            add(name, texts.join(", "), &note);
        }
    }
    for (k, (name, v)) in [("speed", unit(1.0, 0.0)), ("yaw rate", unit(0.0, 1.0))]
        .into_iter()
        .enumerate()
    {
        let inertia = dot(n, &v, &product(n, &reduced.mass, &v));
        let exists = dot(n, &v, &v) > 0.0;
        if damping[k] > 0.0 && exists {
            add(
                &format!("time constant of {name}"),
                time(inertia / damping[k]),
                "drives and viscous losses, held voltage",
            );
        }
    }
    let stiffest = (0..wheels.len())
        .map(|i| {
            let row = platform.spin_row(i, &platform.wheel_frame(i, &x));
            dot(n, &row, &product(n, &inverse, &row))
        })
        .fold(0.0, f64::max);
    if stiffest > 0.0 {
        add(
            "inertia felt at the lightest axle",
            format!("{:.3e} kg·m²", 1.0 / stiffest),
            "",
        );
    }
    let weight = mass * gravity;
    if weight > 0.0 {
        let resisting: f64 = wheels.iter().map(|w| w.dry_friction / w.radius).sum();
        if push > 0.0 {
            add(
                "steepest slope it can climb",
                slope((push - resisting) / weight),
                "largest drive torque, wheels do not slip",
            );
        }
        add(
            "steepest slope it can hold",
            slope(hold / weight),
            "without power: dry friction and brakes, wheels do not slip",
        );
    }
    let contacts: Vec<_> = wheels
        .iter()
        .map(|wheel| (wheel.mount, wheel.stiffness))
        .collect();
    let hull: Vec<[f64; 2]> = Support::new(&contacts).map_or(Vec::new(), |support| {
        let corners = support.polygon();
        corners.iter().map(|corner| [corner.x, corner.y]).collect()
    });
    // What stands on the robot's own wheels: with what a trailer rests on the hitch.
    let (standing, standing_mass) = match &file.trailer {
        None => (center, mass),
        Some(trailer) => {
            let hitch = build::trailer::<f64>(trailer).hitch_mass();
            let own = mass - towed;
            let at = [trailer.hitch[0], trailer.hitch[1], trailer.hitch_height];
            let both = [0, 1, 2].map(|k| (center[k] * own + at[k] * hitch) / (own + hitch));
            (both, own + hitch)
        }
    };
    let mut inside = hull.len() >= 3;
    for (name, direction) in [
        ("forward", [1.0, 0.0]),
        ("backward", [-1.0, 0.0]),
        ("left", [0.0, 1.0]),
        ("right", [0.0, -1.0]),
    ] {
        let Some(distance) = reach(&hull, [standing[0], standing[1]], direction) else {
            inside = false;
            continue;
        };
        // What hangs on the hitch pulls down the slope, too.
        let angle = atan2(distance * standing_mass, standing[2] * mass).to_degrees();
        add(
            &format!("tips over {name} at"),
            format!("{angle:.1}°"),
            "slope towards that side, at rest",
        );
    }
    if !inside {
        report.warnings.push(
            match &file.trailer {
                None => "body.center_of_mass: lies outside the polygon of the wheels' contacts, so the robot falls over; move it or add a caster",
                Some(_) => "trailer.ahead: what rests on the hitch moves the center of mass outside the polygon of the wheels' contacts, so the robot falls over; move the load or the hitch",
            }
            .into(),
        );
    }
    plausible(file, &mut report.warnings);
    report
}

/// The equations of motion of a robot, M v̇ + ω G v = Σ sᵢ τᵢ − losses + weight: numbers at the
/// angles at which its casters and steered wheels start. `[eq:reduced-dynamics]`
#[derive(Clone, Debug, PartialEq)]
pub struct Equations {
    /// What each velocity coordinate moves: the twist (m/s, m/s, rad/s) and steering rate of a unit.
    pub coordinates: Vec<[f64; 3]>,
    /// Reduced mass matrix M.
    pub mass: Vec<Vec<f64>>,
    /// Matrix G of the quadratic terms.
    pub gyro: Vec<Vec<f64>>,
    /// The wheels, with the rows sᵢ of φ̇ᵢ = sᵢ · v; the input map of the driven ones.
    pub wheels: Vec<(String, bool, Vec<f64>)>,
    /// The wheels that a motor steers; their steering rates are the last coordinates.
    pub steered: Vec<String>,
    /// The wheels turned by motors and links, with the rows lᵢ of the conditions lᵢ · v = 0.
    pub conditions: Vec<(String, Vec<f64>)>,
}

/// Derives the equations for a gravity in m/s².
///
/// # Panics
/// If the file has not been checked.
pub fn equations(file: &File, gravity: f64) -> Equations {
    let platform = build::platform(file, DriveModel::AsBuilt, gravity)
        .expect("a checked platform can be built");
    let layout = platform.layout();
    let n = layout.dof();
    let x = build::rest_state(&platform, [0.0; 3], &build::start_angles(file));
    let reduced = platform.reduce(&x);
    let block = |matrix: &appell_model::solve::Square<f64>| -> Vec<Vec<f64>> {
        matrix[..n].iter().map(|row| row[..n].to_vec()).collect()
    };
    let coordinates = (0..n).map(|k| {
        let mut unit = appell_model::solve::zero_row();
        unit[k] = 1.0;
        let (velocity, yaw_rate) = platform.twist(&unit);
        [velocity.x, velocity.y, yaw_rate]
    });
    let wheels = platform.wheels().iter().enumerate().map(|(i, wheel)| {
        let row = platform.spin_row(i, &platform.wheel_frame(i, &x));
        let driven = !matches!(wheel.drive, Drive::None);
        (wheel.name.clone(), driven, row[..n].to_vec())
    });
    Equations {
        coordinates: coordinates.collect(),
        mass: block(&reduced.mass),
        gyro: block(&reduced.gyro),
        wheels: wheels.collect(),
        steered: layout
            .steered
            .iter()
            .map(|&i| platform.wheels()[i].name.clone())
            .collect(),
        conditions: layout
            .guides
            .iter()
            .map(|&i| {
                let row = platform.lateral_row(&platform.wheel_frame(i, &x));
                (platform.wheels()[i].name.clone(), row[..n].to_vec())
            })
            .collect(),
    }
}

impl Equations {
    /// Names of the velocity coordinates: V, ω where a coordinate is a component of the twist, and
    /// what `steering` makes of the name of a steered wheel.
    fn names(
        &self,
        forward: &str,
        left: &str,
        turn: &str,
        steering: &dyn Fn(&str) -> String,
    ) -> Vec<String> {
        let eta = self.coordinates.len() - self.steered.len();
        let name = |(k, twist): (usize, &[f64; 3])| {
            if k >= eta {
                return steering(&self.steered[k - eta]);
            }
            let pure = |axis: usize| (0..3).all(|a| (twist[a] == 0.0) != (a == axis));
            match [0, 1, 2].map(pure) {
                [true, ..] => forward.to_owned(),
                [_, true, _] => left.to_owned(),
                [.., true] => turn.to_owned(),
                _ => format!("v_{}", k + 1),
            }
        };
        self.coordinates.iter().enumerate().map(name).collect()
    }

    /// As aligned text.
    pub fn text(&self) -> String {
        let row = |values: &[f64]| -> String {
            values
                .iter()
                .map(|value| format!("{:>12}", rounded(*value)))
                .collect()
        };
        let mut out =
            String::from("  equations of motion: M v' + ω G v = Σ s τ − losses + weight\n");
        let names = self.names("V_x", "V_y", "ω", &|wheel| format!("γ' {wheel}"));
        out += &format!("    v = ({})\n", names.join(", "));
        for (name, matrix) in [("M", &self.mass), ("G", &self.gyro)] {
            for (k, values) in matrix.iter().enumerate() {
                let name = if k == 0 { name } else { "" };
                out += &format!("    {name:16}{}\n", row(values));
            }
        }
        for (name, driven, values) in &self.wheels {
            let role = if *driven { "driven" } else { "free" };
            let label = format!("s {name}");
            out += &format!("    {label:16}{}  {role}\n", row(values));
        }
        for (name, values) in &self.conditions {
            let label = format!("l {name}");
            out += &format!("    {label:16}{}  l v = 0\n", row(values));
        }
        if !self.conditions.is_empty() {
            out += "    at the angles of the start; M, G, s and l turn with the wheels, which adds terms in γ'\n";
        }
        out
    }

    /// As LaTeX, without delimiters.
    pub fn latex(&self) -> String {
        let number = |value: &f64| rounded(*value);
        let matrix = |rows: &[Vec<f64>]| {
            let lines: Vec<String> = rows
                .iter()
                .map(|row| row.iter().map(number).collect::<Vec<_>>().join(" & "))
                .collect();
            format!(
                "\\begin{{pmatrix}} {} \\end{{pmatrix}}",
                lines.join(r" \\ ")
            )
        };
        let driven: Vec<_> = self
            .wheels
            .iter()
            .filter(|(_, driven, _)| *driven)
            .collect();
        let inputs: Vec<Vec<f64>> = (0..self.mass.len())
            .map(|k| driven.iter().map(|(_, _, row)| row[k]).collect())
            .collect();
        let text = |name: &str| format!(r"\mathrm{{{}}}", name.replace('_', r"\_"));
        let names = self.names("V_x", "V_y", r"\omega", &|wheel| {
            format!(r"\dot\gamma_{{{}}}", text(wheel))
        });
        let rates: Vec<String> = names
            .iter()
            .map(|name| match name.strip_prefix(r"\dot\gamma") {
                Some(of) => format!(r"\ddot\gamma{of}"),
                None => format!(r"\dot {name}"),
            })
            .collect();
        let torques: Vec<String> = driven
            .iter()
            .map(|(name, ..)| format!(r"\tau_{{{}}}", text(name)))
            .collect();
        let column = |entries: &[String]| {
            format!(
                "\\begin{{pmatrix}} {} \\end{{pmatrix}}",
                entries.join(r" \\ ")
            )
        };
        let mut out = format!(
            "{} {} + \\omega {} {} = {} {} + \\dots",
            matrix(&self.mass),
            column(&rates),
            matrix(&self.gyro),
            column(&names),
            matrix(&inputs),
            column(&torques)
        );
        if !self.conditions.is_empty() {
            let rows: Vec<Vec<f64>> = self.conditions.iter().map(|(_, row)| row.clone()).collect();
            out += &format!(", \\quad {} {} = 0", matrix(&rows), column(&names));
        }
        out
    }
}

/// Six decimals, without the sign of a zero.
fn rounded(value: f64) -> String {
    let text = format!("{value:.6}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| c == '0' || c == '.') => digits.to_owned(),
        _ => text,
    }
}

/// Seconds in a readable unit.
fn time(seconds: f64) -> String {
    if seconds < 0.1 {
        format!("{:.3} ms", 1e3 * seconds)
    } else {
        format!("{seconds:.3} s")
    }
}

/// Slope angle from its sine; more than 1 climbs anything.
fn slope(sine: f64) -> String {
    if sine >= 1.0 {
        "any".into()
    } else if sine <= 0.0 {
        "none".into()
    } else {
        let angle = atan2(sine, (1.0 - sine * sine).sqrt()).to_degrees();
        format!("{angle:.1}°")
    }
}

/// Center of mass of the whole robot, m; wheels at their mounts, at the height of their radius.
fn center_of_mass(file: &File, mass: f64) -> [f64; 3] {
    let mut sum = file.body.center_of_mass.map(|c| c * file.body.mass);
    for wheel in &file.wheel {
        for (axis, at) in [wheel.mount[0], wheel.mount[1], wheel.radius]
            .into_iter()
            .enumerate()
        {
            sum[axis] += wheel.mass * at;
        }
    }
    sum.map(|s| s / mass)
}

/// Numbers that no rigid body of this size has.
fn plausible(file: &File, warnings: &mut Vec<String>) {
    let corners = file.footprint.iter();
    let half_diagonal = corners
        .map(|corner| {
            hypot(
                corner[0] - file.body.center_of_mass[0],
                corner[1] - file.body.center_of_mass[1],
            )
        })
        .fold(0.0, f64::max);
    let reach = if half_diagonal > 0.0 {
        half_diagonal
    } else {
        file.collision_radius
    };
    let gyration = (file.body.inertia_com / file.body.mass).sqrt();
    if gyration > reach {
        warnings.push(format!(
            "body.inertia_com: a gyration radius of {gyration:.3} m needs mass beyond the body's reach of {reach:.3} m; expected at most {:.3e} kg·m²",
            file.body.mass * reach * reach
        ));
    }
    for wheel in &file.wheel {
        let path = format!("wheel.{}", wheel.name);
        let hoop = wheel.mass * wheel.radius * wheel.radius;
        if wheel.spin_inertia > hoop * (1.0 + 1e-9) {
            warnings.push(format!(
                "{path}.spin_inertia: {:.3e} kg·m² is above m r² = {hoop:.3e}, that of a hoop; the rotor belongs into drive.rotor_inertia",
                wheel.spin_inertia
            ));
        }
        if wheel.vertical_inertia > 0.0
            && wheel.spin_inertia > 2.0 * wheel.vertical_inertia * (1.0 + 1e-9)
        {
            warnings.push(format!(
                "{path}.vertical_inertia: {:.3e} kg·m² breaks the triangle inequality, spin inertia must be at most twice it",
                wheel.vertical_inertia
            ));
        }
    }
}

/// How a robot on springs heaves, rolls and pitches, each for itself.
fn swings(
    springs: &Suspension<f64>,
    platform: &Platform<f64>,
    center: [f64; 3],
    add: &mut dyn FnMut(&str, String, &str),
) {
    let [roll, pitch] = Sprung::new(platform, springs).inertias();
    // How far each wheel moves with them: over 1, x and y from the center of mass.
    let motions = [
        ("heave", platform.total_mass(), [1.0, 0.0, 0.0]),
        ("roll", roll, [0.0, 0.0, 1.0]),
        ("pitch", pitch, [0.0, 1.0, 0.0]),
    ];
    for (name, inertia, over) in motions {
        let (mut stiffness, mut damping) = (0.0, 0.0);
        for (i, wheel) in platform.wheels().iter().enumerate() {
            let (x, y) = (wheel.mount.x - center[0], wheel.mount.y - center[1]);
            let lever = over[0] + over[1] * x + over[2] * y;
            let square = lever * lever;
            stiffness += springs.stiffness[i] * square;
            damping += springs.damping[i] * square;
        }
        let rate = (stiffness / inertia).sqrt();
        let ratio = damping / (2.0 * inertia * rate);
        add(
            &format!("{name} on its springs"),
            format!(
                "{:.2} Hz, damping ratio {ratio:.2}",
                rate / std::f64::consts::TAU
            ),
            "level slip; each motion alone",
        );
    }
}

/// Distance from a point within the hull to its edge along a direction, m; `None` outside.
fn reach(hull: &[[f64; 2]], from: [f64; 2], direction: [f64; 2]) -> Option<f64> {
    if hull.len() < 3 {
        return None;
    }
    let mut nearest = f64::INFINITY;
    for k in 0..hull.len() {
        let (a, b) = (hull[k], hull[(k + 1) % hull.len()]);
        let edge = [b[0] - a[0], b[1] - a[1]];
        let inward = edge[0] * (from[1] - a[1]) - edge[1] * (from[0] - a[0]);
        if inward < 0.0 {
            return None;
        }
        let approach = edge[1] * direction[0] - edge[0] * direction[1];
        if approach > 0.0 {
            nearest = nearest.min(inward / approach);
        }
    }
    nearest.is_finite().then_some(nearest)
}
