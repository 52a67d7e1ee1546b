//! The rules of a scenario: what its types cannot say.

use std::collections::BTreeSet;
use std::path::Path;

use super::*;

/// Path, problem and hint of each rule that is broken.
pub type Problems = Vec<(String, String, Option<String>)>;

struct Checker {
    problems: Problems,
}

impl Checker {
    fn refuse(&mut self, path: impl Into<String>, problem: impl Into<String>, hint: &str) {
        let hint = (!hint.is_empty()).then(|| hint.to_owned());
        self.problems.push((path.into(), problem.into(), hint));
    }

    fn require(&mut self, good: bool, path: String, rule: &str, got: impl std::fmt::Display) {
        if !good {
            self.refuse(path, format!("must be {rule}, got {got}"), "");
        }
    }

    fn positive(&mut self, path: String, value: f64) {
        self.require(
            value > 0.0 && value.is_finite(),
            path,
            "a finite number > 0",
            number(value),
        );
    }

    fn not_negative(&mut self, path: String, value: f64) {
        self.require(
            value >= 0.0 && value.is_finite(),
            path,
            "a finite number >= 0",
            number(value),
        );
    }

    fn finite(&mut self, path: String, value: f64) {
        self.require(value.is_finite(), path, "finite", value);
    }

    fn share(&mut self, path: String, value: f64) {
        self.require(value > 0.0 && value <= 1.0, path, "in (0, 1]", value);
    }

    fn schema(&mut self, path: String, schema: u32) {
        if schema != SCHEMA {
            self.refuse(
                path,
                format!("must be {SCHEMA}, got {schema}"),
                "this program reads no other version of the format",
            );
        }
    }

    fn name(&mut self, path: String, name: &str) {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.is_empty() || name.len() > 64 || !name.chars().all(plain) {
            self.refuse(
                path,
                format!("must be 1 to 64 letters, digits, - or _, got {name:?}"),
                "paths such as robot.NAME.pose.x are made of it",
            );
        }
    }

    /// Names of a list's entries, by which paths address them; `field` is the key of the name.
    fn unique<'a>(&mut self, list: &str, field: &str, names: impl Iterator<Item = &'a str>) {
        let mut seen = BTreeSet::new();
        for (index, name) in names.enumerate() {
            if !seen.insert(name) {
                self.refuse(
                    format!("{list}.{index}.{field}"),
                    format!("must differ from the others, got \"{name}\" twice"),
                    "paths address entries by their names",
                );
            }
        }
    }

    /// A period: positive and a multiple of the step.
    fn period(&mut self, path: String, period: f64, step: f64) {
        if !(period > 0.0 && period.is_finite()) {
            self.positive(path, period);
            return;
        }
        if period / step >= TICKS_MAX {
            let (limit, got) = (number(TICKS_MAX), number(period));
            self.refuse(
                path,
                format!("must be less than {limit} steps of {step} s, got {got}"),
                "choose a shorter time, or a longer time.step",
            );
        } else if ticks(period, step).is_none() {
            let near = (period / step).round().max(1.0) * step;
            self.refuse(
                path,
                format!(
                    "must be a multiple of time.step = {step} s, got {}",
                    number(period)
                ),
                &format!("{} would do", (near * 1e9).round() / 1e9),
            );
        }
    }
}

/// A number as people write it, with an exponent where the digits would be many.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-5..1e16).contains(&value.abs()) {
        value.to_string()
    } else {
        format!("{value:?}")
    }
}

/// Steps of a run are counted up to here.
const TICKS_MAX: f64 = 1e12;

/// Number of steps in a period, if it is whole.
pub fn ticks(period: f64, step: f64) -> Option<u64> {
    let count = (period / step).round();
    // A decimal such as 0.01/0.001 is off by some ulps; a millionth of a step is not meant.
    let whole = (period - count * step).abs() <= 1e-9 * period && (1.0..TICKS_MAX).contains(&count);
    whole.then_some(count as u64)
}

/// Checks a scenario; empty if all is well.
pub fn check(scenario: &Scenario, folder: &Path) -> Problems {
    let mut c = Checker {
        problems: Vec::new(),
    };
    c.schema("schema".into(), scenario.schema);
    c.name("name".into(), &scenario.name);
    let step = scenario.time.step;
    c.positive("time.step".into(), step);
    c.positive("time.duration".into(), scenario.time.duration);
    c.require(
        scenario.time.tolerance >= 1e-13 && scenario.time.tolerance <= 1e-2,
        "time.tolerance".into(),
        "in [1e-13, 0.01]",
        number(scenario.time.tolerance),
    );
    if !c.problems.is_empty() {
        return c.problems;
    }
    c.period("time.duration".into(), scenario.time.duration, step);
    c.period("record.period".into(), scenario.record.period, step);
    check_arena(&mut c, &scenario.arena);
    check_terrain(&mut c, &scenario.terrain);
    if scenario.robot.is_empty() {
        c.refuse(
            "robot",
            "must have at least one entry",
            "add a [[robot]] table",
        );
    }
    c.unique(
        "robot",
        "name",
        scenario.robot.iter().map(|r| r.name.as_str()),
    );
    for robot in &scenario.robot {
        check_robot(&mut c, robot, scenario, folder);
    }
    if let Some(statistics) = &scenario.statistics {
        check_statistics(&mut c, scenario, statistics);
    }
    c.problems
}

/// Checks a platform alone, with paths below `prefix`.
pub fn check_platform(platform: &Platform, prefix: &str) -> Problems {
    let mut c = Checker {
        problems: Vec::new(),
    };
    platform_rules(&mut c, platform, prefix);
    c.problems
}

fn check_arena(c: &mut Checker, arena: &Arena) {
    for (k, axis) in ["width", "height"].iter().enumerate() {
        c.require(
            arena.size[k] > 0.0 && arena.size[k] <= 1e4,
            "arena.size".into(),
            &format!("a {axis} in (0, 10000] m"),
            number(arena.size[k]),
        );
    }
    let count = arena.beacon.len();
    if !(1..=15).contains(&count) {
        c.refuse(
            "arena.beacon",
            format!("must be 1 to 15 beacons, got {count}"),
            "each is a [[arena.beacon]] table with name and position",
        );
    }
    let names = arena.beacon.iter().map(|b| b.name.as_str());
    c.unique("arena.beacon", "name", names);
    for beacon in &arena.beacon {
        let path = |field: &str| format!("arena.beacon.{}.{field}", beacon.name);
        c.name(path("name"), &beacon.name);
        c.positive(path("radius"), beacon.radius);
        let inside = (0..2).all(|k| (0.0..=arena.size[k]).contains(&beacon.position[k]));
        if !inside {
            c.refuse(
                path("position"),
                format!(
                    "must be inside the arena [0, {}] x [0, {}], got {:?}",
                    arena.size[0], arena.size[1], beacon.position
                ),
                "positions are measured from the arena's lower left corner",
            );
        }
    }
}

fn check_terrain(c: &mut Checker, terrain: &Terrain) {
    let (gravity, friction) = match terrain {
        Terrain::Flat { gravity, friction } => (gravity, friction),
        Terrain::Plane {
            slope_deg,
            downhill_heading_deg,
            gravity,
            friction,
        } => {
            if !(0.0..=60.0).contains(slope_deg) {
                c.refuse(
                    "terrain.slope_deg",
                    format!("must be in [0, 60], got {}", number(*slope_deg)),
                    "for another direction turn terrain.downhill_heading_deg",
                );
            }
            c.finite("terrain.downhill_heading_deg".into(), *downhill_heading_deg);
            (gravity, friction)
        }
    };
    c.not_negative("terrain.gravity".into(), *gravity);
    if let Some(friction) = friction {
        c.positive("terrain.friction".into(), *friction);
    }
}

fn check_robot(c: &mut Checker, robot: &Robot, scenario: &Scenario, folder: &Path) {
    let base = format!("robot.{}", robot.name);
    let path = |field: &str| format!("{base}.{field}");
    c.name(path("name"), &robot.name);
    for value in robot.pose {
        c.finite(path("pose"), value);
    }
    for value in robot.twist {
        c.finite(path("twist"), value);
    }
    let step = scenario.time.step;
    match &robot.platform {
        None => c.refuse(
            path("platform"),
            "is missing",
            "name a robot file with `file = \"…\"`, or write the platform inline",
        ),
        Some(platform) => {
            platform_rules(c, platform, &path("platform"));
            let radius = platform.collision_radius;
            let size = scenario.arena.size;
            let inside =
                (0..2).all(|k| robot.pose[k] >= radius && robot.pose[k] <= size[k] - radius);
            if !inside && robot.pose.iter().all(|v| v.is_finite()) {
                c.refuse(
                    path("pose"),
                    format!(
                        "must keep the robot's disc of {radius} m inside the arena [0, {}] x [0, {}], got {:?}",
                        size[0], size[1], robot.pose
                    ),
                    "move the start or enlarge arena.size",
                );
            }
            let driven: Vec<&str> = platform
                .wheel
                .iter()
                .filter(|w| w.drive != Drive::None)
                .map(|w| w.name.as_str())
                .collect();
            let motors = platform
                .wheel
                .iter()
                .all(|w| !matches!(w.drive, Drive::Torque { .. }));
            if robot.drive == DriveChoice::DcMotor && (!motors || driven.is_empty()) {
                c.refuse(
                    path("drive"),
                    "must be another: the platform has no DC motor on each driven wheel",
                    "use \"torque\", or give the wheels drives of kind \"dc-motor\"",
                );
            }
            let steered = platform
                .wheel
                .iter()
                .any(|w| matches!(w.steering, Steering::Steered { .. }));
            if steered
                && let Some(Controller::Signals { channel, .. }) = &robot.controller
                && let Some(channel) = channel.iter().find(|c| c.to.starts_with("wheel."))
            {
                c.refuse(
                    format!("{base}.controller.channel.{}.to", channel.to),
                    "must not command a single wheel of a robot with steered wheels",
                    "command forward and yaw_rate; the servo steers",
                );
            }
            for sensor in &robot.sensor {
                if let Sensor::Odometry {
                    radius_scale,
                    track_scale,
                    ..
                } = sensor
                    && *radius_scale > 0.0
                    && *track_scale > 0.0
                    && let Ok(built) =
                        crate::build::platform(platform, crate::build::DriveModel::AsBuilt, 9.81)
                    && crate::sensor::believed(&built, *radius_scale, *track_scale).is_err()
                {
                    c.refuse(
                        format!("{base}.sensor.{}.track_scale", sensor_name(sensor)),
                        "must leave the wheels as they are believed a way to roll",
                        "the axles of the fixed wheels no longer meet on that track; use 1",
                    );
                }
            }
            if steered
                && let Some(sensor) = robot
                    .sensor
                    .iter()
                    .find(|s| matches!(s, Sensor::Odometry { .. }))
            {
                c.refuse(
                    format!("{base}.sensor.{}", sensor_name(sensor)),
                    "must be of another kind: odometry does not know steering angles",
                    "use a sensor of kind \"pose\"",
                );
            }
            check_mobility(c, robot, platform);
            check_controller(c, robot, &driven, scenario, folder);
        }
    }
    for sensor in &robot.sensor {
        check_sensor(c, sensor, &base, step);
    }
    let mut seen = BTreeSet::new();
    for (index, sensor) in robot.sensor.iter().enumerate() {
        let name = sensor_name(sensor);
        if !seen.insert(name) {
            let field = match sensor {
                Sensor::Odometry { .. } => "name",
                _ => "kind",
            };
            c.refuse(
                format!("{base}.sensor.{index}.{field}"),
                format!("must differ from the others, got \"{name}\" twice"),
                "paths address entries by their names",
            );
        }
    }
    check_wheel_noise(c, robot, folder);
    if let Some(period) = robot.servo.period {
        c.period(path("servo.period"), period, step);
    }
    if let Some(bandwidth) = robot.servo.bandwidth {
        c.positive(path("servo.bandwidth"), bandwidth);
    }
    c.positive(path("servo.integral_time"), robot.servo.integral_time);
    if let Some(task) = &robot.task {
        check_task(c, task, &path("task"), &scenario.arena);
    }
}

/// The name under which a sensor's signals stand: its kind, unless it has a name of its own.
fn sensor_name(sensor: &Sensor) -> &str {
    match sensor {
        Sensor::Odometry { name, .. } => name,
        other => sensor_kind(other),
    }
}

fn sensor_kind(sensor: &Sensor) -> &'static str {
    match sensor {
        Sensor::Pose { .. } => "pose",
        Sensor::Encoder { .. } => "encoder",
        Sensor::Odometry { .. } => "odometry",
        Sensor::RangeBearing { .. } => "range-bearing",
    }
}

fn check_sensor(c: &mut Checker, sensor: &Sensor, base: &str, step: f64) {
    let path = |field: &str| format!("{base}.sensor.{}.{field}", sensor_name(sensor));
    match sensor {
        Sensor::Pose {
            period,
            position_std,
            yaw_std,
        } => {
            c.period(path("period"), *period, step);
            c.not_negative(path("position_std"), *position_std);
            c.not_negative(path("yaw_std"), *yaw_std);
        }
        Sensor::Encoder {
            period, angle_std, ..
        } => {
            c.period(path("period"), *period, step);
            c.not_negative(path("angle_std"), *angle_std);
        }
        Sensor::Odometry {
            period,
            name,
            angle_std,
            radius_scale,
            track_scale,
            ..
        } => {
            c.period(path("period"), *period, step);
            c.not_negative(path("angle_std"), *angle_std);
            c.name(path("name"), name);
            c.positive(path("radius_scale"), *radius_scale);
            c.positive(path("track_scale"), *track_scale);
        }
        Sensor::RangeBearing {
            period,
            range_max,
            view_deg,
            range_std,
            bearing_std,
        } => {
            c.period(path("period"), *period, step);
            c.positive(path("range_max"), *range_max);
            c.require(
                *view_deg > 0.0 && *view_deg <= 360.0,
                path("view_deg"),
                "in (0, 360]",
                view_deg,
            );
            c.not_negative(path("range_std"), *range_std);
            c.not_negative(path("bearing_std"), *bearing_std);
        }
    }
}

/// Noise on commands: of wheels that are driven, each once, from a distribution or a file; and the
/// feedback that answers it.
fn check_wheel_noise(c: &mut Checker, robot: &Robot, folder: &Path) {
    let base = format!("robot.{}.wheel_noise", robot.name);
    let names = robot.wheel_noise.iter().map(|noise| noise.wheel.as_str());
    c.unique(&base, "wheel", names);
    let wheels: &[Wheel] = robot.platform.as_ref().map_or(&[], |p| &p.wheel);
    let driven: Vec<&str> = wheels
        .iter()
        .filter(|wheel| wheel.drive != Drive::None)
        .map(|wheel| wheel.name.as_str())
        .collect();
    if !robot.wheel_noise.is_empty() && robot.controller.is_none() {
        c.refuse(
            base.clone(),
            "must go with a controller, whose commands it is added to, got none",
            "add [robot.controller]",
        );
    }
    for noise in &robot.wheel_noise {
        let path = |field: &str| format!("{base}.{}.{field}", noise.wheel);
        if !driven.contains(&noise.wheel.as_str()) {
            c.refuse(
                path("wheel"),
                format!("must name a driven wheel, got \"{}\"", noise.wheel),
                &format!("there are: {}", driven.join(", ")),
            );
        }
        c.finite(path("mean"), noise.mean);
        c.not_negative(path("std"), noise.std);
        match (&noise.file, &noise.column) {
            (None, None) => {}
            (Some(file), Some(column)) => {
                if noise.mean != 0.0 || noise.std != 0.0 {
                    c.refuse(
                        path("file"),
                        "must stand alone, got a mean or a standard deviation beside it",
                        "take the noise from the file or from a distribution",
                    );
                }
                if let Err(problem) = crate::controller::read_table(&folder.join(file), column) {
                    c.refuse(
                        path("file"),
                        problem,
                        "a CSV with a header row; its first column is time in s",
                    );
                }
            }
            (file, _) => {
                let missing = if file.is_some() { "column" } else { "file" };
                c.refuse(
                    path(missing),
                    "is missing",
                    "noise from a file needs both `file` and `column`",
                );
            }
        }
    }
    for (field, value) in [
        ("rate_feedback", robot.servo.rate_feedback),
        ("angle_feedback", robot.servo.angle_feedback),
    ] {
        let path = format!("robot.{}.servo.{field}", robot.name);
        c.not_negative(path.clone(), value);
        if value > 0.0 && robot.level != Level::Kinematic {
            c.refuse(
                path,
                "must be 0 but at level \"kinematic\"",
                "at other levels bandwidth and integral_time make the loop",
            );
        }
    }
    let own = match &robot.controller {
        Some(Controller::Signals { period, .. }) => *period,
        Some(
            Controller::Homing(follower)
            | Controller::Gate(follower)
            | Controller::Eight(follower)
            | Controller::Slalom(follower),
        ) => follower.period,
        None => 0.0,
    };
    let period = robot.servo.period.unwrap_or(own);
    let (rate, angle) = (robot.servo.rate_feedback, robot.servo.angle_feedback);
    // The loop e' = −K_P e − K_I T Σ e decays for K_P < 1 and K_I T < 2 (1 − K_P).
    if rate.max(angle) > 0.0 && (rate >= 1.0 || angle * period >= 2.0 * (1.0 - rate)) {
        c.refuse(
            format!("robot.{}.servo.angle_feedback", robot.name),
            format!(
                "must be less than 2 (1 - rate_feedback) / period, and rate_feedback less than 1, got {} and {} at {period} s",
                number(angle),
                number(rate)
            ),
            "beyond that the wheels swing up",
        );
    }
}

/// Statistics: differences of robots that there are, in signals that both have.
fn check_statistics(c: &mut Checker, scenario: &Scenario, statistics: &Statistics) {
    let robots: Vec<&str> = scenario.robot.iter().map(|r| r.name.as_str()).collect();
    c.require(
        statistics.decimals <= 15,
        "statistics.decimals".into(),
        "at most 15",
        statistics.decimals,
    );
    for (list, length) in [
        ("signals", statistics.signals.len()),
        ("difference", statistics.difference.len()),
    ] {
        if length == 0 {
            c.refuse(
                format!("statistics.{list}"),
                "must have at least one entry",
                "a table has signals as rows and is a difference of two robots",
            );
        }
    }
    let names: Vec<&str> = statistics
        .difference
        .iter()
        .map(|difference| difference.name.as_str())
        .collect();
    c.unique("statistics.difference", "name", names.iter().copied());
    let ratios = statistics.ratio.iter().map(|ratio| ratio.name.as_str());
    c.unique("statistics.ratio", "name", ratios.clone());
    for name in names.iter().copied().chain(ratios) {
        let plain = !name.trim().is_empty() && !name.chars().any(char::is_control);
        c.require(
            plain && name.chars().count() <= 80,
            "statistics".into(),
            "given names of 1 to 80 printable characters",
            format!("{name:?}"),
        );
    }
    let mut known = |path: String, name: &str, all: &[&str], what: &str| {
        if !all.contains(&name) {
            c.refuse(
                path,
                format!("must name a {what}, got \"{name}\""),
                &format!("there are: {}", all.join(", ")),
            );
        }
    };
    for difference in &statistics.difference {
        let path = |field: &str| format!("statistics.difference.{}.{field}", difference.name);
        known(path("of"), &difference.of, &robots, "robot");
        known(path("minus"), &difference.minus, &robots, "robot");
    }
    let signals: Vec<&str> = statistics.signals.iter().map(String::as_str).collect();
    for ratio in &statistics.ratio {
        let path = |field: &str| format!("statistics.ratio.{}.{field}", ratio.name);
        known(path("of"), &ratio.of, &names, "difference");
        known(path("by"), &ratio.by, &names, "difference");
        for signal in &ratio.signals {
            known(path("signals"), signal, &signals, "signal of the tables");
        }
    }
}

/// What a set of wheels cannot do however it is controlled.
fn check_mobility(c: &mut Checker, robot: &Robot, file: &Platform) {
    let Ok(platform) = crate::build::platform(file, crate::build::DriveModel::AsBuilt, 9.81) else {
        return;
    };
    let turns = match &robot.controller {
        None => false,
        Some(Controller::Signals { channel, .. }) => channel.iter().any(|c| c.to == "yaw_rate"),
        Some(_) => true,
    };
    if turns && crate::design::goes_straight_only(&platform).is_some() {
        c.refuse(
            format!("robot.{}.level", robot.name),
            "must be one whose wheels may slip: this robot steers by skidding, and ideal rolling has no solution that turns",
            "level \"slip\" will have one, which this version does not know yet; give a wheel a steering, casters or rollers, or command its wheels straight ahead",
        );
    }
}

fn check_controller(
    c: &mut Checker,
    robot: &Robot,
    driven: &[&str],
    scenario: &Scenario,
    folder: &Path,
) {
    let base = format!("robot.{}.controller", robot.name);
    let path = |field: &str| format!("{base}.{field}");
    let Some(controller) = &robot.controller else {
        return;
    };
    let (kind, follower) = match controller {
        Controller::Homing(follower) => ("homing", follower),
        Controller::Gate(follower) => ("gate", follower),
        Controller::Eight(follower) => ("eight", follower),
        Controller::Slalom(follower) => ("slalom", follower),
        Controller::Signals { period, channel } => {
            c.period(path("period"), *period, scenario.time.step);
            let names = channel.iter().map(|ch| ch.to.as_str());
            c.unique(&path("channel"), "to", names);
            for channel in channel {
                check_channel(c, channel, &base, robot, driven, folder);
            }
            return;
        }
    };
    let task = robot.task.as_ref().map(task_kind);
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
    base: &str,
    robot: &Robot,
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
    if let Some(Controller::Signals { channel: all, .. }) = &robot.controller
        && twisted(&channel.to)
        && all.iter().any(|other| other.to.starts_with("wheel."))
    {
        c.refuse(
            path("to"),
            "must not stand beside channels of wheels",
            "command either the twist or the wheels",
        );
    }
    let mut numbers = Vec::new();
    match &channel.signal {
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

fn task_kind(task: &Task) -> &'static str {
    match task {
        Task::Homing { .. } => "homing",
        Task::Gate { .. } => "gate",
        Task::Eight { .. } => "eight",
        Task::Slalom { .. } => "slalom",
    }
}

fn check_task(c: &mut Checker, task: &Task, base: &str, arena: &Arena) {
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

fn platform_rules(c: &mut Checker, platform: &Platform, prefix: &str) {
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
    if c.problems.len() > before {
        return;
    }
    match crate::build::platform(platform, crate::build::DriveModel::AsBuilt, 9.81) {
        Err(error) => {
            let (field, problem, hint) = crate::build::explain(&error);
            c.refuse(path(&field), problem, hint);
        }
        Ok(built) if crate::design::degrees(&built).0 == 0 => c.refuse(
            path("wheel"),
            "must leave a way to roll: the steered wheels' axles and those of the others have no common center, got no motion",
            "link the steered wheels (steering kind \"linked\" or \"guided\"), or let some swivel",
        ),
        Ok(_) => {}
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
