//! Rules of controllers and tasks.

use std::collections::BTreeSet;
use std::path::Path;

use super::super::*;
use super::{Checker, number, sensor_name};

/// All controllers of a robot.
pub(super) fn check_controllers(
    c: &mut Checker,
    robot: &Robot,
    driven: &[&str],
    scenario: &Scenario,
    folder: &Path,
) {
    let base = format!("robot.{}", robot.name);
    let names = robot.standby.iter().map(|standby| standby.name.as_str());
    c.unique(&format!("{base}.standby"), "name", names);
    if robot.standby.len() > STANDBY_MAX {
        c.refuse(
            format!("{base}.standby"),
            format!("must be at most {STANDBY_MAX}, got {}", robot.standby.len()),
            "",
        );
    }
    if robot.controller.is_none() && !robot.standby.is_empty() {
        c.refuse(
            format!("{base}.standby"),
            "must stand by for a controller, got none",
            "add [robot.controller]",
        );
    }
    for standby in &robot.standby {
        let path = format!("{base}.standby.{}.name", standby.name);
        c.name(path.clone(), &standby.name);
        if standby.name == FIRST {
            c.refuse(
                path,
                format!("must be another than \"{FIRST}\""),
                "that is the name of the robot's first controller",
            );
        }
    }
    check_models(c, robot, &base, scenario, folder);
    for (name, controller) in robot.controllers() {
        let base = match name {
            FIRST => format!("{base}.controller"),
            _ => format!("{base}.standby.{name}.controller"),
        };
        let turns = robot.controllers().map(|(name, own)| match own {
            Controller::Plugin(plugin) => (name, plugin.fallback.as_deref()),
            _ => (name, None),
        });
        let place = Place {
            robot,
            base,
            name,
            turns: turns.collect(),
        };
        check_controller(c, &place, controller, driven, scenario, folder);
    }
}

/// Changes of controllers.
pub(super) fn check_swaps(c: &mut Checker, scenario: &Scenario) {
    for (k, swap) in scenario.swap.iter().enumerate() {
        let path = |field: &str| format!("swap.{k}.{field}");
        let (step, end) = (scenario.time.step, scenario.time.duration);
        if !(0.0..=end).contains(&swap.at) {
            let rule = format!("in [0, {end}], the run's duration, s");
            c.require(false, path("at"), &rule, number(swap.at));
        } else if swap.at > 0.0 {
            c.period(path("at"), swap.at, step);
        }
        let named = |robot: &&Robot| robot.name == swap.robot;
        let Some(robot) = scenario.robot.iter().find(named) else {
            let known: Vec<&str> = scenario.robot.iter().map(|r| r.name.as_str()).collect();
            c.refuse(
                path("robot"),
                format!("must be the name of a robot, got {:?}", swap.robot),
                &format!("one of {}", known.join(", ")),
            );
            continue;
        };
        let controllers = robot.controllers().map(|(name, _)| name);
        let models = robot.models().filter(|_| !robot.model.is_empty());
        check_standby(c, path("to"), controllers.chain(models).collect(), &swap.to);
    }
    // Robots by count are each run by themselves, and many.
    let counted = scenario.robot.iter().find(|robot| robot.count > 1);
    let foreign = scenario.robot.iter().find(|robot| {
        let stands = !robot.standby.is_empty() || !robot.model.is_empty();
        stands || robot.plugins().next().is_some()
    });
    if let (Some(counted), Some(foreign)) = (counted, foreign) {
        c.refuse(
            format!("robot.{}.count", counted.name),
            format!(
                "must be 1 beside plug-ins and controllers that stand by, as of robot \"{}\", got {}",
                foreign.name, counted.count
            ),
            "run trials with `appell batch`, or let a built-in controller do it",
        );
    }
}

/// A name of one of those that take turns.
fn check_standby(c: &mut Checker, path: String, known: Vec<&str>, name: &str) {
    if !known.contains(&name) {
        c.refuse(
            path,
            format!("must be the name of one that stands by, got {name:?}"),
            &match known.is_empty() {
                true => "add [robot.controller] and [[robot.standby]]".to_owned(),
                false => format!("one of {}", known.join(", ")),
            },
        );
    }
}

/// Models that stand by.
fn check_models(c: &mut Checker, robot: &Robot, base: &str, scenario: &Scenario, folder: &Path) {
    if robot.model.is_empty() {
        return;
    }
    if robot
        .standby
        .iter()
        .any(|standby| standby.name == FIRST_MODEL)
    {
        c.refuse(
            format!("{base}.standby.{FIRST_MODEL}.name"),
            format!("must be another than \"{FIRST_MODEL}\" beside models that stand by"),
            "that is the name of the robot's first model",
        );
    }
    let names = robot.model.iter().map(|model| model.name.as_str());
    c.unique(&format!("{base}.model"), "name", names);
    if robot.model.len() > STANDBY_MAX {
        let problem = format!("must be at most {STANDBY_MAX}, got {}", robot.model.len());
        c.refuse(format!("{base}.model"), problem, "");
    }
    if !robot.wheel_noise.is_empty() {
        c.refuse(
            format!("{base}.wheel_noise"),
            "must not stand beside models that take turns: each has commands of its own",
            "leave the models out, or the noise",
        );
    }
    let fallback = |plugin: &'_ Option<Plugin>| -> Option<String> {
        plugin.as_ref().and_then(|plugin| plugin.fallback.clone())
    };
    let turns: Vec<(String, Option<String>)> = std::iter::once((FIRST_MODEL.to_owned(), None))
        .chain(
            robot
                .model
                .iter()
                .map(|m| (m.name.clone(), fallback(&m.plugin))),
        )
        .collect();
    for model in &robot.model {
        let base = format!("{base}.model.{}", model.name);
        c.name(format!("{base}.name"), &model.name);
        let mut controllers = robot.controllers().map(|(name, _)| name);
        if model.name == FIRST_MODEL || controllers.any(|name| name == model.name) {
            c.refuse(
                format!("{base}.name"),
                format!("must be another, got {:?}", model.name),
                "\"model\" is the name of the first model, and a change may name a controller, too",
            );
        }
        let Some(plugin) = &model.plugin else {
            continue;
        };
        if model.level.is_some() || model.drive.is_some() {
            c.refuse(
                format!("{base}.plugin"),
                "must not stand beside level and drive",
                "a model is either a level of this robot, or a plug-in",
            );
        }
        let place = Place {
            robot,
            base: format!("{base}.plugin"),
            name: &model.name,
            turns: turns
                .iter()
                .map(|(name, to)| (name.as_str(), to.as_deref()))
                .collect(),
        };
        check_plugin(c, &place, plugin, scenario.time.step, folder);
    }
}

/// Most instructions of a step of a plug-in.
const FUEL_MAX: u64 = 1_000_000_000_000;
/// Longest step of a plug-in, s, and most memory, MiB.
const TIME_LIMIT_MAX: f64 = 3600.0;
const MEMORY_MAX: u64 = 1 << 20;

/// A controller's, or a model's, robot, path and name, and those that take turns with it, each with the one that
/// takes over when it fails.
struct Place<'a> {
    robot: &'a Robot,
    base: String,
    name: &'a str,
    turns: Vec<(&'a str, Option<&'a str>)>,
}

fn check_plugin<'a>(
    c: &mut Checker,
    place: &Place<'a>,
    plugin: &'a Plugin,
    step: f64,
    folder: &Path,
) {
    let path = |field: &str| format!("{}.{field}", place.base);
    c.period(path("period"), plugin.period, step);
    let (limit, memory) = (plugin.time_limit, plugin.memory);
    c.require(
        limit > 0.0 && limit <= TIME_LIMIT_MAX,
        path("time_limit"),
        &format!("in (0, {TIME_LIMIT_MAX}] s"),
        number(limit),
    );
    c.require(
        (16..=MEMORY_MAX).contains(&memory),
        path("memory"),
        &format!("in [16, {MEMORY_MAX}] MiB"),
        memory,
    );
    c.require(
        (1000..=FUEL_MAX).contains(&plugin.fuel),
        path("fuel"),
        &format!("in [1000, {FUEL_MAX}] instructions"),
        plugin.fuel,
    );
    for (name, &value) in &plugin.parameters {
        c.finite(path(&format!("parameters.{name}")), value);
    }
    if !folder.join(&plugin.file).is_file() {
        c.refuse(
            path("file"),
            format!("must be a file, got {:?}", plugin.file),
            "paths are relative to the scenario file; `appell plugin new NAME` writes one",
        );
    }
    if let Some(fallback) = &plugin.fallback {
        let known = place.turns.iter().map(|(name, _)| *name);
        check_standby(c, path("fallback"), known.collect(), fallback);
        // Along the chain of those that take over from each other.
        let mut chain = vec![place.name];
        let mut next = Some(fallback.as_str());
        while let Some(name) = next {
            if chain.contains(&name) {
                chain.push(name);
                c.refuse(
                    path("fallback"),
                    format!("must not lead back, got {}", chain.join(" -> ")),
                    "let a controller that is built in be the last",
                );
                break;
            }
            chain.push(name);
            let of_name = |(own, _): &&(&str, Option<&'a str>)| *own == name;
            next = place.turns.iter().find(of_name).and_then(|(_, to)| *to);
        }
        if plugin.on_failure != OnFailure::Stop {
            c.refuse(
                path("on_failure"),
                "must be left out beside a fallback",
                "the fallback takes over",
            );
        }
    }
}

fn check_controller(
    c: &mut Checker,
    place: &Place<'_>,
    controller: &Controller,
    driven: &[&str],
    scenario: &Scenario,
    folder: &Path,
) {
    let Place { robot, base, .. } = place;
    let path = |field: &str| format!("{base}.{field}");
    if let Controller::Plugin(plugin) = controller {
        check_plugin(c, place, plugin, scenario.time.step, folder);
    }
    if let Controller::Signals { period, channel } = controller {
        c.period(path("period"), *period, scenario.time.step);
        let names = channel.iter().map(|ch| ch.to.as_str());
        c.unique(&path("channel"), "to", names);
        for one in channel {
            check_channel(c, one, channel, place, driven, folder);
        }
    }
    let Some(follower) = controller.follower() else {
        return;
    };
    let kind = controller.kind();
    let task = robot.task.as_ref().map(Task::kind);
    if task != Some(kind) {
        c.refuse(
            path("kind"),
            format!(
                "must go with a task of the same kind, got \"{kind}\" with {}",
                task.unwrap_or("no task")
            ),
            &format!("add [robot.task] with kind = \"{kind}\", or choose another controller"),
        );
    }
    if driven.is_empty() {
        c.refuse(
            path("kind"),
            "must have a driven wheel to command, got none",
            "give a wheel a drive",
        );
    }
    c.period(path("period"), follower.period, scenario.time.step);
    c.require(
        follower.period <= 0.1,
        path("period"),
        "at most 0.1 s",
        follower.period,
    );
    for (field, value) in [
        ("speed", follower.speed),
        ("acceleration", follower.acceleration),
        ("lateral_acceleration", follower.lateral_acceleration),
        ("yaw_rate", follower.yaw_rate),
        ("yaw_acceleration", follower.yaw_acceleration),
        ("lookahead", follower.lookahead),
    ] {
        c.positive(path(field), value);
    }
    if let Some(platform) = &robot.platform
        && let Ok(built) = crate::build::geometry(platform)
    {
        let (mobility, _) = built.degrees();
        if follower.heading != Heading::Steer && mobility < 3 {
            c.refuse(
                path("heading"),
                format!("must be \"steer\" for a robot that cannot move sideways: its degree of mobility is {mobility}, not 3"),
                "give all its wheels rollers, or let them swivel",
            );
        }
        if kind != "route" && crate::design::sharpest_curve(platform).is_finite() {
            c.refuse(
                path("kind"),
                format!("must be \"route\" for a robot that cannot turn on the spot, got \"{kind}\""),
                "the planner among beacons lets robots turn on the spot; give such a robot a task of kind \"route\"",
            );
        }
    }
    let needed = match follower.pose {
        PoseSource::Truth => None,
        PoseSource::PoseSensor => Some("pose"),
        PoseSource::Odometry => Some("odometry"),
    };
    if let Some(needed) = needed
        && !robot.sensor.iter().any(|s| sensor_name(s) == needed)
    {
        c.refuse(
            path("pose"),
            format!("must name a sensor that the robot has, got one of kind \"{needed}\""),
            &format!("add [[robot.sensor]] with kind = \"{needed}\", and no name of its own"),
        );
    }
}

fn check_channel(
    c: &mut Checker,
    channel: &Channel,
    all: &[Channel],
    Place { base, .. }: &Place<'_>,
    driven: &[&str],
    folder: &Path,
) {
    let path = |field: &str| format!("{base}.channel.{}.{field}", channel.to);
    let known = ["forward", "left", "yaw_rate", "brake"].contains(&channel.to.as_str());
    let wheel = channel
        .to
        .strip_prefix("wheel.")
        .filter(|w| driven.contains(w));
    if !known && wheel.is_none() {
        let wheels: Vec<String> = driven.iter().map(|w| format!("wheel.{w}")).collect();
        c.refuse(
            path("to"),
            format!("must be a channel of the robot, got \"{}\"", channel.to),
            &format!(
                "one of forward, left, yaw_rate, brake, {}",
                wheels.join(", ")
            ),
        );
    }
    let twisted = |to: &str| ["forward", "left", "yaw_rate"].contains(&to);
    if twisted(&channel.to) && all.iter().any(|other| other.to.starts_with("wheel.")) {
        c.refuse(
            path("to"),
            "must not stand beside channels of wheels",
            "command either the twist or the wheels",
        );
    }
    let mut numbers = Vec::new();
    match &channel.signal {
        Signal::External {} => {}
        Signal::Constant { value } => numbers.push(("value", *value)),
        Signal::Step { at, before, after } => {
            numbers.extend([("at", *at), ("before", *before), ("after", *after)]);
        }
        Signal::Ramp {
            from_time,
            to_time,
            from,
            to,
        } => {
            numbers.extend([
                ("from_time", *from_time),
                ("to_time", *to_time),
                ("from", *from),
                ("to", *to),
            ]);
            c.require(
                to_time > from_time,
                path("signal.to_time"),
                &format!("later than from_time = {}", number(*from_time)),
                number(*to_time),
            );
        }
        Signal::Sine {
            amplitude,
            period,
            phase_deg,
            offset,
        }
        | Signal::Square {
            amplitude,
            period,
            phase_deg,
            offset,
        }
        | Signal::Triangle {
            amplitude,
            period,
            phase_deg,
            offset,
        }
        | Signal::Sawtooth {
            amplitude,
            period,
            phase_deg,
            offset,
        } => {
            numbers.extend([
                ("amplitude", *amplitude),
                ("phase_deg", *phase_deg),
                ("offset", *offset),
            ]);
            c.positive(path("signal.period"), *period);
        }
        Signal::Stairs { at, values } => {
            let rising = at.windows(2).all(|pair| pair[0] < pair[1]);
            if at.is_empty() || at.len() != values.len() || !rising {
                c.refuse(
                    path("signal.at"),
                    format!(
                        "must be increasing times, one for each value, got {at:?} for {values:?}"
                    ),
                    "for example at = [0.0, 4.0], values = [0.1, 0.0]",
                );
            }
            numbers.extend(at.iter().map(|time| ("at", *time)));
            numbers.extend(values.iter().map(|value| ("values", *value)));
        }
        Signal::Table { file, column } => {
            if let Err(problem) = crate::controller::read_table(&folder.join(file), column) {
                c.refuse(
                    path("signal.file"),
                    problem,
                    "a CSV with a header row; its first column is time in s",
                );
            }
        }
    }
    for (field, value) in numbers {
        c.finite(path(&format!("signal.{field}")), value);
    }
}

pub(super) fn check_task(
    c: &mut Checker,
    task: &Task,
    robot: &Robot,
    arena: &Arena,
    folder: &Path,
) {
    let base = format!("robot.{}.task", robot.name);
    let path = |field: &str| format!("{base}.{field}");
    let names: Vec<&str> = arena.beacon.iter().map(|b| b.name.as_str()).collect();
    let known = |c: &mut Checker, field: &str, name: &str| {
        if !names.contains(&name) {
            c.refuse(
                path(field),
                format!("must name a beacon of the arena, got \"{name}\""),
                &format!("there are: {}", names.join(", ")),
            );
        }
    };
    match task {
        Task::Homing {
            beacon,
            distance,
            speed,
            hold,
        } => {
            known(c, "beacon", beacon);
            c.positive(path("distance"), *distance);
            c.positive(path("speed"), *speed);
            c.not_negative(path("hold"), *hold);
        }
        Task::Gate { beacons, exit, .. } => {
            two(c, beacons, &path("beacons"));
            beacons.iter().for_each(|b| known(c, "beacons", b));
            c.positive(path("exit"), *exit);
        }
        Task::Eight {
            beacons,
            laps,
            close,
        } => {
            two(c, beacons, &path("beacons"));
            beacons.iter().for_each(|b| known(c, "beacons", b));
            c.require(
                (1..=1000).contains(laps),
                path("laps"),
                "in [1, 1000]",
                laps,
            );
            c.positive(path("close"), *close);
        }
        Task::Slalom {
            chain, offset_max, ..
        } => {
            if chain.len() < 2 {
                c.refuse(
                    path("chain"),
                    format!("must name at least two beacons, got {}", chain.len()),
                    "a slalom passes its beacons on alternating sides",
                );
            }
            let mut passed = BTreeSet::new();
            for beacon in chain.iter().filter(|beacon| !passed.insert(*beacon)) {
                c.refuse(
                    path("chain"),
                    format!("must name each beacon once, got \"{beacon}\" twice"),
                    "give the place a second beacon, or shorten the chain",
                );
            }
            chain.iter().for_each(|b| known(c, "chain", b));
            c.positive(path("offset_max"), *offset_max);
        }
        Task::Route {
            path: route,
            tolerance,
            end,
            laps,
        } => {
            c.positive(path("tolerance"), *tolerance);
            c.positive(path("end"), *end);
            c.require(
                (1..=1000).contains(laps),
                path("laps"),
                "in [1, 1000]",
                laps,
            );
            match crate::route::path(route, *laps, robot.pose, folder) {
                Err(fault) => c.refuse(fault.path(&base), fault.problem, &fault.hint),
                Ok(way) => {
                    c.require(
                        *end <= 0.5 * way.length,
                        path("end"),
                        &format!("at most half of the route's {:.3} m", way.length),
                        number(*end),
                    );
                    check_route(c, &way, *tolerance, &path("path"), robot, arena);
                }
            }
        }
    }
}

/// Whether a robot can follow a path without leaving the arena, touching a beacon or turning more
/// sharply than its wheels steer.
fn check_route(
    c: &mut Checker,
    way: &crate::plan::Path,
    tolerance: f64,
    base: &str,
    robot: &Robot,
    arena: &Arena,
) {
    let Some(platform) = &robot.platform else {
        return;
    };
    let apart = |a: [f64; 2], b: [f64; 2]| appell_model::math::hypot(a[0] - b[0], a[1] - b[1]);
    let at = |k: usize| {
        let [x, y] = way.points[k];
        format!("({x:.2}, {y:.2}), {:.2} m along it", k as f64 * way.ds)
    };
    let gap = apart(way.points[0], [robot.pose[0], robot.pose[1]]);
    if gap > tolerance {
        c.refuse(
            base,
            format!(
                "must begin within tolerance = {} m of the robot's start, got {gap:.3} m from it",
                number(tolerance)
            ),
            "move robot.pose to the start of the path",
        );
    }
    let radius = platform.collision_radius;
    let inside = |p: &[f64; 2]| (0..2).all(|k| p[k] >= radius && p[k] <= arena.size[k] - radius);
    if let Some(k) = way.points.iter().position(|p| !inside(p)) {
        c.refuse(
            base,
            format!(
                "must keep the robot's disc of {radius} m inside the arena [0, {}] x [0, {}], got a path that leaves it at {}",
                arena.size[0], arena.size[1], at(k)
            ),
            "move the path or enlarge arena.size",
        );
    }
    for beacon in &arena.beacon {
        let room = radius + beacon.radius;
        let gap = |k: &usize| apart(way.points[*k], beacon.position);
        let nearest = (0..way.points.len()).min_by(|a, b| gap(a).total_cmp(&gap(b)));
        if let Some(k) = nearest.filter(|k| gap(k) < room) {
            c.refuse(
                base,
                format!(
                    "must keep {room:.3} m from the center of beacon \"{}\", got {:.3} m at {}",
                    beacon.name,
                    gap(&k),
                    at(k)
                ),
                "move the path or the beacon",
            );
        }
    }
    let mut followers = robot.controllers().filter_map(|(_, own)| own.follower());
    let steers = followers.any(|follower| follower.heading == Heading::Steer);
    let sharpest = crate::design::sharpest_curve(platform);
    let off = appell_model::math::wrap_angle(robot.pose[2] - way.heading[0]);
    if off.abs() > std::f64::consts::FRAC_PI_2 && sharpest.is_finite() && steers {
        c.refuse(
            base,
            format!(
                "must begin within 90 degrees of the robot's heading, for it cannot turn on the spot, got {:.0} degrees from it",
                off.to_degrees()
            ),
            "turn robot.pose, or reverse the path",
        );
    }
    if let Some(k) = way
        .curvature
        .iter()
        .position(|k| k.abs() > sharpest * (1.0 + 1e-6))
        && steers
    {
        c.refuse(
            base,
            format!(
                "must have no curve tighter than {:.3} m, the least radius that the steering of this robot allows, got {:.3} m at {}",
                1.0 / sharpest,
                1.0 / way.curvature[k].abs(),
                at(k)
            ),
            "widen the curve, or the steering's angle_max_deg",
        );
    }
}

fn two(c: &mut Checker, beacons: &[String; 2], path: &str) {
    if beacons[0] == beacons[1] {
        c.refuse(
            path,
            format!(
                "must be two different beacons, got \"{}\" twice",
                beacons[0]
            ),
            "the way leads between them",
        );
    }
}
