//! From what a file says to what runs: scenario types to platforms, blocks and worlds.

use std::cell::RefCell;
use std::fmt;
use std::sync::Arc;

use appell_model::drive::{DcMotor, Drive};
use appell_model::ground::Ground;
use appell_model::integrate::observe;
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform, PlatformError, WheelOutput, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::slip::Patch;
use appell_model::suspension::Suspension;
use appell_model::tire::{Curve, Friction, Tire};
use appell_model::trailer::Trailer;
use appell_model::wheel::{Rim, Steering, Wheel};

use crate::layout::{Assignment, Beacon, Goal, Layout, RouteGoal};
use crate::plant::{Chosen, Contacts};
use crate::route::Fault;
use crate::scenario::{self, Direction, DriveChoice, Level, Robot, Scenario, Side, Task, Terrain};

/// Which drives a platform is built with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriveModel {
    /// Those of the file.
    AsBuilt,
    /// Ideal rate sources (level `kinematic`).
    Rate,
    /// Ideal torque sources.
    Torque,
}

/// The drives that a robot's level and choice ask for.
pub fn drive_model(robot: &Robot) -> DriveModel {
    match (robot.level, robot.drive) {
        (Level::Kinematic, _) => DriveModel::Rate,
        (Level::Rolling | Level::Slip, DriveChoice::Torque) => DriveModel::Torque,
        (Level::Rolling | Level::Slip, DriveChoice::AsBuilt | DriveChoice::DcMotor) => {
            DriveModel::AsBuilt
        }
    }
}

/// Numbers of a scenario on their way into equations: each as it stands, but for those that carry
/// derivatives.
pub struct Values<'a, T> {
    seeds: &'a [(String, T)],
    /// What was asked for, where that is listed.
    asked: Option<RefCell<Vec<(String, f64)>>>,
    chosen: &'a [Chosen],
}

impl<'a, T: Scalar> Values<'a, T> {
    /// Numbers as they stand, but for these, by path.
    pub fn new(seeds: &'a [(String, T)]) -> Self {
        Values {
            seeds,
            asked: None,
            chosen: &[],
        }
    }

    /// Numbers as they stand, for robots that are stepped like this, whatever would be chosen for them.
    pub(crate) fn stepped_by(chosen: &'a [Chosen]) -> Self {
        Values {
            seeds: &[],
            asked: None,
            chosen,
        }
    }

    /// How a robot is to be stepped, by its place, where that is settled.
    pub(crate) fn chosen(&self, robot: usize) -> Option<Chosen> {
        self.chosen.get(robot).copied()
    }

    /// Numbers as they stand, all of which are listed.
    pub fn listing() -> Self {
        Values {
            seeds: &[],
            asked: Some(RefCell::default()),
            chosen: &[],
        }
    }

    /// The number at a path of the scenario.
    pub fn at(&self, path: fmt::Arguments<'_>, value: f64) -> T {
        if let Some(asked) = &self.asked {
            asked.borrow_mut().push((path.to_string(), value));
        }
        if self.seeds.is_empty() {
            return T::from(value);
        }
        let path = path.to_string();
        let seed = self.seeds.iter().find(|(known, _)| *known == path);
        seed.map_or(T::from(value), |(_, number)| *number)
    }

    /// Paths and numbers that were asked for, in order.
    pub fn asked(&self) -> Vec<(String, f64)> {
        self.asked
            .as_ref()
            .map_or_else(Vec::new, |asked| asked.borrow().clone())
    }
}

/// Gravity and slope; of uneven ground the level map.
pub fn ground(terrain: &Terrain) -> Ground<f64> {
    ground_of(terrain, &Values::new(&[]))
}

/// The same with numbers that may carry derivatives.
pub fn ground_of<T: Scalar>(terrain: &Terrain, values: &Values<'_, T>) -> Ground<T> {
    let at = |key: &str, value: f64| values.at(format_args!("terrain.{key}"), value);
    match terrain {
        Terrain::Flat { gravity, .. } | Terrain::Uneven { gravity, .. } => {
            Ground::flat(at("gravity", *gravity))
        }
        Terrain::Plane {
            slope_deg,
            downhill_heading_deg,
            gravity,
            ..
        } => Ground::plane(
            at("gravity", *gravity),
            radians(at("slope_deg", *slope_deg)),
            radians(at("downhill_heading_deg", *downhill_heading_deg)),
        ),
    }
}

/// An angle in degrees as radians.
fn radians<T: Scalar>(degrees: T) -> T {
    // As `f64::to_radians`, to the last bit.
    degrees * T::from(std::f64::consts::PI / 180.0)
}

/// What the wheels of a file meet on a terrain, whose heights were built where it is uneven; their
/// numbers stand under `path` in the scenario.
pub fn contacts<T: Scalar>(
    file: &scenario::Platform,
    terrain: &Terrain,
    relief: Option<Arc<appell_model::terrain::Terrain>>,
    path: &str,
    values: &Values<'_, T>,
) -> Contacts<T> {
    Contacts {
        tires: tires(file, terrain, path, values),
        patches: patches(terrain, values),
        relief,
        springs: springs(file, path, values),
    }
}

/// The springs of a file, if its wheels have some; their numbers stand under `path` in the scenario.
pub fn springs<T: Scalar>(
    file: &scenario::Platform,
    path: &str,
    values: &Values<'_, T>,
) -> Option<Suspension<T>> {
    let at = |key: fmt::Arguments<'_>, value: f64| values.at(format_args!("{path}.{key}"), value);
    let body = &file.body;
    let mut springs = Suspension {
        stiffness: Vec::new(),
        damping: Vec::new(),
        roll_inertia: at(
            format_args!("body.roll_inertia_com"),
            body.roll_inertia_com?,
        ),
        pitch_inertia: at(
            format_args!("body.pitch_inertia_com"),
            body.pitch_inertia_com?,
        ),
    };
    for wheel in &file.wheel {
        let suspension = wheel.suspension?;
        let at = |key: &str, value: f64| {
            at(format_args!("wheel.{}.suspension.{key}", wheel.name), value)
        };
        springs
            .stiffness
            .push(at("stiffness", suspension.stiffness));
        springs.damping.push(at("damping", suspension.damping));
    }
    Some(springs)
}

/// The contact law of each wheel of a file, on a ground with a friction coefficient of its own or the
/// tires'. The numbers of the wheels stand under `path` in the scenario.
fn tires<T: Scalar>(
    file: &scenario::Platform,
    terrain: &Terrain,
    path: &str,
    values: &Values<'_, T>,
) -> Vec<Tire<T>> {
    let ground = terrain
        .friction()
        .map(|friction| values.at(format_args!("terrain.friction"), friction));
    let own = file.wheel.iter().map(|wheel| {
        let at = |key: &str, value: f64| {
            values.at(
                format_args!("{path}.wheel.{}.tire.{key}", wheel.name),
                value,
            )
        };
        tire(&wheel.tire, &at)
    });
    let trailer = file
        .trailer
        .iter()
        .map(|_| tire(&scenario::Tire::default(), &|_, v| T::from(v)));
    own.chain(trailer)
        .map(|tire| ground.map_or(tire, |friction| tire.on_friction(friction)))
        .collect()
}

/// The patches of a terrain.
fn patches<T: Scalar>(terrain: &Terrain, values: &Values<'_, T>) -> Vec<Patch<T>> {
    let corner = |at: [f64; 2]| vec2(T::from(at[0]), T::from(at[1]));
    let patches = terrain.patches().iter().enumerate();
    let patch = |(k, patch): (usize, &scenario::Patch)| Patch {
        low: corner(patch.low),
        high: corner(patch.high),
        friction: values.at(format_args!("terrain.patch.{k}.friction"), patch.friction),
    };
    patches.map(patch).collect()
}

fn tire<T: Scalar>(file: &scenario::Tire, at: At<'_, T>) -> Tire<T> {
    let rubbing = |friction: f64, breakaway: Option<f64>, stribeck: f64| {
        let kinetic = at("friction", friction);
        Friction {
            kinetic,
            breakaway: breakaway.map_or(kinetic, |value| at("breakaway", value)),
            stribeck: at("stribeck", stribeck),
        }
    };
    let slip = |curve, relaxation: f64, damping: f64| Tire::Slip {
        curve,
        relaxation: at("relaxation", relaxation),
        damping: at("damping", damping),
    };
    match *file {
        scenario::Tire::Coulomb {
            friction,
            breakaway,
            stribeck,
            rounding,
        } => Tire::Coulomb {
            friction: rubbing(friction, breakaway, stribeck),
            rounding: at("rounding", rounding),
        },
        scenario::Tire::Lugre {
            friction,
            breakaway,
            stribeck,
            stiffness,
            damping,
            viscous,
        } => Tire::Lugre {
            friction: rubbing(friction, breakaway, stribeck),
            stiffness: at("stiffness", stiffness),
            damping: at("damping", damping),
            viscous: at("viscous", viscous),
        },
        scenario::Tire::Brush {
            friction,
            stiffness,
            relaxation,
            damping,
        } => {
            let curve = Curve::Brush {
                friction: at("friction", friction),
                stiffness: at("stiffness", stiffness),
            };
            slip(curve, relaxation, damping)
        }
        scenario::Tire::MagicFormula {
            friction,
            stiffness,
            shape,
            curvature,
            relaxation,
            damping,
        } => {
            let curve = Curve::Magic {
                friction: at("friction", friction),
                stiffness: at("stiffness", stiffness),
                shape: at("shape", shape),
                curvature: at("curvature", curvature),
            };
            slip(curve, relaxation, damping)
        }
        scenario::Tire::Linear {
            friction,
            stiffness,
            relaxation,
            damping,
        } => {
            let curve = Curve::Linear {
                friction: at("friction", friction),
                stiffness: at("stiffness", stiffness),
            };
            slip(curve, relaxation, damping)
        }
    }
}

/// The platform of a file, with rolling resistance turned into torques by the static loads under a
/// gravity normal to the ground, m/s².
pub fn platform(
    file: &scenario::Platform,
    drives: DriveModel,
    gravity_normal: f64,
) -> Result<Platform<f64>, PlatformError> {
    platform_of(file, drives, gravity_normal, "", &Values::new(&[]))
}

/// The same without rolling resistance, which takes the loads: enough for questions of geometry.
pub fn geometry(file: &scenario::Platform) -> Result<Platform<f64>, PlatformError> {
    let (free, _) = free_platform(file, DriveModel::AsBuilt, "", &Values::new(&[]))?;
    Ok(free)
}

/// The platform of a file with numbers that may carry derivatives; they stand under `path` in the scenario.
pub fn platform_of<T: Scalar>(
    file: &scenario::Platform,
    drives: DriveModel,
    gravity_normal: T,
    path: &str,
    values: &Values<'_, T>,
) -> Result<Platform<T>, PlatformError> {
    let (free, losses) = free_platform(file, drives, path, values)?;
    if losses.iter().all(|loss| *loss == T::zero()) {
        return Ok(free);
    }
    let mut wheels = free.wheels().to_vec();
    for (i, load) in static_loads(&free, gravity_normal).into_iter().enumerate() {
        let rolls = losses[i] * load.max(T::zero()) * wheels[i].radius;
        wheels[i].dry_friction += rolls;
    }
    Platform::new(*free.body(), wheels)
}

/// A platform without rolling resistance, and the coefficient of each wheel.
fn free_platform<T: Scalar>(
    file: &scenario::Platform,
    drives: DriveModel,
    path: &str,
    values: &Values<'_, T>,
) -> Result<(Platform<T>, Vec<T>), PlatformError> {
    let at = |key: &str, value: f64| values.at(format_args!("{path}.{key}"), value);
    let mut body = Body {
        mass: at("body.mass", file.body.mass),
        inertia_com: at("body.inertia_com", file.body.inertia_com),
        center_of_mass: vec2(
            T::from(file.body.center_of_mass[0]),
            T::from(file.body.center_of_mass[1]),
        ),
        com_height: T::from(file.body.center_of_mass[2]),
    };
    let mut losses: Vec<T> = Vec::new();
    let mut wheels: Vec<Wheel<T>> = Vec::new();
    for file_wheel in &file.wheel {
        let path = format!("{path}.wheel.{}", file_wheel.name);
        let at = |key: &str, value: f64| values.at(format_args!("{path}.{key}"), value);
        wheels.push(wheel(file_wheel, file, drives, &at));
        losses.push(at("friction.rolling", file_wheel.friction.rolling));
    }
    if let Some(file) = &file.trailer {
        trailer::<T>(file).attach(&mut body, &mut wheels);
        // Of both wheels.
        wheels[losses.len()].dry_friction = T::from(2.0 * file.friction.dry);
        losses.push(T::from(file.friction.rolling));
    }
    Ok((Platform::new(body, wheels)?, losses))
}

/// Normal loads at rest on level ground, N; equal shares where the contacts carry no plane.
pub fn static_loads<T: Scalar>(platform: &Platform<T>, gravity_normal: T) -> Vec<T> {
    let layout = platform.layout().clone();
    let rolling = Rolling::new(platform.clone(), Ground::flat(gravity_normal));
    let x = rest_state(platform, [T::zero(); 3], &[]);
    let mut y = vec![T::zero(); layout.output()];
    observe(
        &rolling,
        false,
        &x,
        &vec![T::zero(); layout.input()],
        &vec![T::one(); layout.wheels],
        &mut y,
    );
    let loads: Vec<T> = (0..layout.wheels)
        .map(|i| y[layout.wheel_output(i, WheelOutput::Load)])
        .collect();
    if loads.iter().any(|load| load.lane(0) != 0.0) {
        loads
    } else {
        let share = platform.total_mass() * gravity_normal / T::from(layout.wheels as f64);
        vec![share; layout.wheels]
    }
}

/// A state at rest at a pose, with the given angles (rad) of the swivelling wheels.
pub fn rest_state<T: Scalar>(platform: &Platform<T>, pose: [T; 3], angles: &[T]) -> Vec<T> {
    let layout = platform.layout();
    let mut x = vec![T::zero(); layout.state()];
    x[0] = pose[0];
    x[1] = pose[1];
    x[YAW] = pose[2];
    for (k, &angle) in angles.iter().enumerate().take(layout.swivels.len()) {
        x[layout.swivel(k)] = angle;
    }
    platform.renew_angles(&mut x);
    x
}

/// Start angles of the swivelling wheels, rad, in the order of their states; linkages find their own.
pub fn start_angles(file: &scenario::Platform) -> Vec<f64> {
    let angle = |wheel: &scenario::Wheel| match wheel.steering {
        scenario::Steering::Fixed { .. } => None,
        scenario::Steering::Free { angle_deg, .. }
        | scenario::Steering::Steered { angle_deg, .. } => Some(angle_deg.to_radians()),
        scenario::Steering::Linked { .. } | scenario::Steering::Guided { .. } => Some(0.0),
    };
    let trailer = file.trailer.iter().map(|t| t.angle_deg.to_radians());
    file.wheel.iter().filter_map(angle).chain(trailer).collect()
}

/// A number of a wheel, by its key and its value.
type At<'a, T> = &'a dyn Fn(&str, f64) -> T;

fn wheel<T: Scalar>(
    file: &scenario::Wheel,
    platform: &scenario::Platform,
    drives: DriveModel,
    at: At<'_, T>,
) -> Wheel<T> {
    // A name that there is not leads beyond the list, where the platform refuses it.
    let index = |name: &str| {
        let found = platform.wheel.iter().position(|w| w.name == name);
        found.unwrap_or(platform.wheel.len())
    };
    let (drive, rotor) = drive(&file.drive, drives, at);
    // Relative: over the mean of all springs.
    let springs = platform.wheel.iter().filter_map(|wheel| wheel.suspension);
    let mean = springs.map(|spring| spring.stiffness).sum::<f64>() / platform.wheel.len() as f64;
    Wheel {
        name: file.name.clone(),
        mount: vec2(T::from(file.mount[0]), T::from(file.mount[1])),
        radius: at("radius", file.radius),
        steering: match &file.steering {
            scenario::Steering::Fixed { angle_deg } => Steering::Fixed {
                angle: radians(at("steering.angle_deg", *angle_deg)),
            },
            scenario::Steering::Free { trail, .. } => Steering::Free {
                trail: at("steering.trail", *trail),
            },
            scenario::Steering::Steered { .. } => Steering::Driven,
            scenario::Steering::Linked { to, ratio } => Steering::Linked {
                lead: index(to),
                ratio: T::from(*ratio),
            },
            scenario::Steering::Guided { by } => Steering::Guided { lead: index(by) },
        },
        rim: match file.rim {
            scenario::Rim::Plain => Rim::Plain,
            scenario::Rim::Rollers { angle_deg } => Rim::Rollers {
                angle: radians(at("rim.angle_deg", angle_deg)),
            },
        },
        mass: at("mass", file.mass),
        inertia_vertical: at("vertical_inertia", file.vertical_inertia),
        spin_inertia: at("spin_inertia", file.spin_inertia) + rotor,
        viscous: at("friction.viscous", file.friction.viscous),
        pivot_viscous: at("friction.pivot_viscous", file.friction.pivot_viscous),
        dry_friction: at("friction.dry", file.friction.dry),
        friction_rounding: T::zero(),
        stiffness: match file.suspension {
            None => T::one(),
            Some(spring) => at("suspension.stiffness", spring.stiffness) / T::from(mean),
        },
        brake: at("brake_torque", file.brake_torque),
        drive,
    }
}

/// A trailer, as the model takes it.
pub fn trailer<T: Scalar>(file: &scenario::Trailer) -> Trailer<T> {
    Trailer {
        name: scenario::TRAILER.to_owned(),
        hitch: vec2(T::from(file.hitch[0]), T::from(file.hitch[1])),
        hitch_height: T::from(file.hitch_height),
        length: T::from(file.length),
        half_track: T::from(0.5 * file.track),
        mass: T::from(file.mass),
        ahead: T::from(file.ahead),
        inertia_com: T::from(file.inertia_com),
        radius: T::from(file.radius),
        wheel_mass: T::from(file.wheel_mass),
        spin_inertia: T::from(file.spin_inertia),
        viscous: T::from(file.friction.viscous),
        hitch_viscous: T::from(file.friction.pivot_viscous),
    }
}

/// The drive of a wheel and the rotor inertia as the axle feels it, kg·m².
fn drive<T: Scalar>(file: &scenario::Drive, drives: DriveModel, at: At<'_, T>) -> (Drive<T>, T) {
    let at = |key: &str, value: f64| at(&format!("drive.{key}"), value);
    let (built, rotor, rate_max, torque_max) = match file {
        scenario::Drive::None => return (Drive::None, T::zero()),
        scenario::Drive::Torque {
            torque_max,
            rate_max,
        } => {
            let torque_max = at("torque_max", *torque_max);
            (
                Drive::Torque { torque_max },
                T::zero(),
                at("rate_max", *rate_max),
                torque_max,
            )
        }
        scenario::Drive::DcMotor {
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
            let torque_constant = at("torque_constant", *torque_constant);
            let gear_ratio = at("gear_ratio", *gear_ratio);
            let motor = DcMotor {
                resistance: at("resistance", *resistance),
                inductance: at("inductance", *inductance),
                torque_constant,
                back_emf_constant: match back_emf_constant {
                    Some(constant) => at("back_emf_constant", *constant),
                    None => torque_constant,
                },
                gear_ratio,
                gear_efficiency: at("gear_efficiency", *gear_efficiency),
                voltage_max: at("voltage_max", *voltage_max),
                current_max: match current_max {
                    Some(current) => at("current_max", *current),
                    None => T::from(f64::MAX),
                },
            };
            let reflected = gear_ratio * gear_ratio * at("rotor_inertia", *rotor_inertia);
            let (rate, torque) = (motor.no_load_rate(), motor.stall_torque());
            (Drive::DcMotor(motor), reflected, rate, torque)
        }
    };
    let chosen = match drives {
        DriveModel::AsBuilt => built,
        DriveModel::Rate => Drive::Rate { rate_max },
        DriveModel::Torque => Drive::Torque { torque_max },
    };
    (chosen, rotor)
}

/// Path, problem and hint for a set of wheels that is no platform.
pub fn explain(error: &PlatformError) -> (String, String, &'static str) {
    match error {
        PlatformError::WheelCount(count) => (
            "wheel".into(),
            format!("must be 1 to 12 wheels, got {count}"),
            "each is a [[wheel]] table",
        ),
        PlatformError::SteeredCount(count) => (
            "wheel".into(),
            format!("must have fewer steered wheels, got {count}"),
            "",
        ),
        PlatformError::Locked => (
            "wheel".into(),
            "must leave a way to roll: the fixed wheels' axles have no common center, got no motion".into(),
            "let some wheels swivel (steering kind \"free\") or give them rollers",
        ),
        PlatformError::RollerAngle(name) => (
            format!("wheel.{name}.rim.angle_deg"),
            "must be between -85 and 85".into(),
            "45 for mecanum wheels, 0 for omni wheels",
        ),
        PlatformError::RollersOnCaster(name) => (
            format!("wheel.{name}.rim"),
            "must be plain on a wheel that swivels freely, got rollers".into(),
            "leave the rim out, or give the wheel a steering of kind \"fixed\"",
        ),
        PlatformError::NoLead(name) => (
            format!("wheel.{name}.steering"),
            "must follow a wheel of steering kind \"steered\"".into(),
            "name such a wheel",
        ),
        PlatformError::NotGuided(name) => (
            format!("wheel.{name}.steering"),
            "must guide a plain wheel without mass, loss and drive, which stands, as the steered wheel does, ahead of or behind the one axle of fixed wheels".into(),
            "put mass and losses on the other wheels, or use steering kind \"linked\"",
        ),
        PlatformError::NoTrail(name) => (
            format!("wheel.{name}.steering.trail"),
            "must not be 0".into(),
            "a caster swivels because its contact trails the pivot",
        ),
    }
}

/// The arena as the planner and the judge see it.
pub fn layout(scenario: &Scenario, robot: &Robot) -> Layout {
    let platform = robot
        .platform
        .as_ref()
        .expect("a checked scenario has platforms");
    Layout {
        arena: scenario.arena.size,
        beacons: scenario
            .arena
            .beacon
            .iter()
            .map(|beacon| Beacon {
                name: beacon.name.clone(),
                position: beacon.position,
                radius: beacon.radius,
            })
            .collect(),
        collision_radius: platform.collision_radius,
        start: robot.pose,
    }
}

/// What a robot's task asks for, with beacons by index; files are looked for in `folder`.
///
/// # Errors
/// A route's file changed since it was checked.
pub fn assignment(
    scenario: &Scenario,
    robot: &Robot,
    task: &Task,
    folder: &std::path::Path,
) -> Result<Assignment, Fault> {
    let index = |name: &String| {
        let beacons = &scenario.arena.beacon;
        let found = beacons.iter().position(|b| b.name == *name);
        found.expect("a checked scenario names its own beacons")
    };
    Ok(Assignment::Beacons(match task {
        Task::Homing {
            beacon,
            distance,
            speed,
            hold,
        } => Goal::Homing {
            beacon: index(beacon),
            distance: *distance,
            speed: *speed,
            hold: *hold,
        },
        Task::Gate {
            beacons,
            direction,
            exit,
        } => Goal::Gate {
            pair: [index(&beacons[0]), index(&beacons[1])],
            direction: match direction {
                Direction::Any => 0,
                Direction::FirstLeft => 1,
                Direction::FirstRight => -1,
            },
            exit: *exit,
        },
        Task::Eight {
            beacons,
            laps,
            close,
        } => Goal::Eight {
            pair: [index(&beacons[0]), index(&beacons[1])],
            laps: *laps,
            close: *close,
        },
        Task::Slalom {
            chain,
            first_side,
            offset_max,
        } => Goal::Slalom {
            chain: chain.iter().map(index).collect(),
            first_side: match first_side {
                Side::Any => 0,
                Side::Left => 1,
                Side::Right => -1,
            },
            offset_max: *offset_max,
        },
        Task::Route {
            path,
            tolerance,
            end,
            laps,
        } => {
            return Ok(Assignment::Route(RouteGoal {
                path: crate::route::path(path, *laps, robot.pose, folder)?,
                tolerance: *tolerance,
                end: *end,
            }));
        }
    }))
}
