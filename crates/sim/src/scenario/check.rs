//! The rules of a scenario: what its types cannot say.

mod control;
mod noise;
mod platform;
mod relief;

use std::collections::BTreeSet;
use std::path::Path;

use super::*;

use control::{check_controllers, check_swaps, check_task};
use noise::{check_statistics, check_wheel_noise};
use platform::platform_rules;
use relief::check_relief;

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

/// A number as people write it, with an exponent where the digits would be many; put into words only where
/// something is told, for most numbers are as they should be.
fn number(value: f64) -> Number {
    Number(value)
}

struct Number(f64);

impl std::fmt::Display for Number {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Number(value) = *self;
        if value == 0.0 || (1e-5..1e16).contains(&value.abs()) {
            write!(f, "{value}")
        } else {
            write!(f, "{value:?}")
        }
    }
}

/// Trials of a batch at the most.
pub const TRIALS_MAX: u64 = 100_000_000;
/// Robots by count at the most, all together: a recording holds 65536 signals.
pub const COUNT_MAX: u64 = 9_000;
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
    c.require(
        scenario.trial < TRIALS_MAX,
        "trial".into(),
        &format!("in [0, {})", TRIALS_MAX),
        scenario.trial,
    );
    let has_more = scenario.batch.is_some() || scenario.robot.iter().any(|robot| robot.count > 1);
    if scenario.trial > 0 && has_more {
        c.refuse(
            "trial",
            format!(
                "must be left out beside [batch] or robots by count, got {}",
                scenario.trial
            ),
            "they have the trials from 0 on",
        );
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
    let all: u64 = scenario
        .robot
        .iter()
        .fold(0, |sum, robot| sum.saturating_add(robot.count));
    if all > COUNT_MAX {
        c.refuse(
            "robot",
            format!("must be at most {COUNT_MAX} in all, got {all}"),
            "take a lower count, or run trials with `appell batch`",
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
    check_swaps(&mut c, scenario);
    if let Some(statistics) = &scenario.statistics {
        check_statistics(&mut c, scenario, statistics);
    }
    if let Some(batch) = &scenario.batch {
        c.require(
            (1..=TRIALS_MAX).contains(&batch.trials),
            "batch.trials".into(),
            &format!("in [1, {TRIALS_MAX}]"),
            batch.trials,
        );
        let names = batch.variant.iter().map(|variant| variant.name.as_str());
        c.unique("batch.variant", "name", names);
        for variant in &batch.variant {
            let path = format!("batch.variant.{}.name", variant.name);
            c.name(path, &variant.name);
        }
        for (k, vary) in batch.vary.iter().enumerate() {
            if let Some((field, problem)) = crate::batch::refuse(&vary.draw) {
                c.refuse(format!("batch.vary.{k}.draw.{field}"), problem, "");
            }
        }
        c.unique(
            "batch.vary",
            "path",
            batch.vary.iter().map(|vary| vary.path.as_str()),
        );
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

fn check_friction(c: &mut Checker, path: String, value: f64) {
    if !(1e-4..=100.0).contains(&value) {
        c.refuse(
            path,
            format!("must be in [0.0001, 100], got {}", number(value)),
            "rubber on dry concrete has 0.8, on ice 0.1",
        );
    }
}

fn check_terrain(c: &mut Checker, terrain: &Terrain) {
    for (k, patch) in terrain.patches().iter().enumerate() {
        let path = |field: &str| format!("terrain.patch.{k}.{field}");
        for value in patch.low {
            c.finite(path("low"), value);
        }
        for axis in 0..2 {
            c.require(
                patch.high[axis].is_finite() && patch.high[axis] > patch.low[axis],
                path("high"),
                "above low on both axes",
                format!("{:?}", patch.high),
            );
        }
        check_friction(c, path("friction"), patch.friction);
    }
    if let Terrain::Plane {
        slope_deg,
        downhill_heading_deg,
        ..
    } = terrain
    {
        check_slope(c, "terrain", *slope_deg, *downhill_heading_deg);
    }
    check_relief(c, terrain.relief());
    c.not_negative("terrain.gravity".into(), terrain.gravity());
    if let Some(friction) = terrain.friction() {
        check_friction(c, "terrain.friction".into(), friction);
    }
}

fn check_slope(c: &mut Checker, base: &str, slope_deg: f64, downhill_heading_deg: f64) {
    if !(0.0..=60.0).contains(&slope_deg) {
        c.refuse(
            format!("{base}.slope_deg"),
            format!("must be in [0, 60], got {}", number(slope_deg)),
            &format!("for another direction turn {base}.downhill_heading_deg"),
        );
    }
    c.finite(format!("{base}.downhill_heading_deg"), downhill_heading_deg);
}

/// The rules of robots by count.
fn check_count(c: &mut Checker, robot: &Robot, scenario: &Scenario) {
    let path = |field: &str| format!("robot.{}.{field}", robot.name);
    c.require(
        (1..=COUNT_MAX).contains(&robot.count),
        path("count"),
        &format!("in [1, {COUNT_MAX}]"),
        robot.count,
    );
    if robot.count == 1 && !robot.vary.is_empty() {
        c.refuse(
            path("vary"),
            "must be left out for a single robot",
            "give it a count, or vary trials with [[batch.vary]]",
        );
    }
    if robot.count > 1 && scenario.statistics.is_some() {
        c.refuse(
            path("count"),
            format!("must be 1 beside [statistics], got {}", robot.count),
            "statistics compare single robots",
        );
    }
    for other in &scenario.robot {
        let place = other
            .name
            .strip_prefix(&robot.name)
            .and_then(|rest| rest.strip_prefix('-')?.parse().ok());
        if place.is_some_and(|k: u64| robot.count > 1 && k < robot.count) {
            c.refuse(
                path("name"),
                format!(
                    "must not make the name of another robot, got \"{}\" and a count of {}",
                    robot.name, robot.count
                ),
                &format!("robots of a count are called {0}-0, {0}-1, …", robot.name),
            );
        }
    }
    for (k, vary) in robot.vary.iter().enumerate() {
        if let Some((field, problem)) = crate::batch::refuse(&vary.draw) {
            c.refuse(path(&format!("vary.{k}.draw.{field}")), problem, "");
        }
        let of_its_own = ["name", "count", "vary", "file"];
        let first = vary.path.split('.').next().unwrap_or("");
        if of_its_own.contains(&first) {
            c.refuse(
                path(&format!("vary.{k}.path")),
                format!("must be a number of the robot, got \"{}\"", vary.path),
                "for instance platform.body.mass, or pose.0 for x at the start",
            );
        }
    }
    c.unique(
        &path("vary"),
        "path",
        robot.vary.iter().map(|vary| vary.path.as_str()),
    );
}

fn check_robot(c: &mut Checker, robot: &Robot, scenario: &Scenario, folder: &Path) {
    let base = format!("robot.{}", robot.name);
    let path = |field: &str| format!("{base}.{field}");
    c.name(path("name"), &robot.name);
    check_count(c, robot, scenario);
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
            for (name, controller) in robot.controllers() {
                if steered
                    && let Controller::Signals { channel, .. } = controller
                    && let Some(channel) = channel.iter().find(|c| c.to.starts_with("wheel."))
                {
                    let place = match name {
                        FIRST => "controller".to_owned(),
                        _ => format!("standby.{name}.controller"),
                    };
                    c.refuse(
                        format!("{base}.{place}.channel.{}.to", channel.to),
                        "must not command a single wheel of a robot with steered wheels",
                        "command forward and yaw_rate; the servo steers",
                    );
                }
            }
            for sensor in &robot.sensor {
                if let Sensor::Odometry {
                    radius_scale,
                    track_scale,
                    ..
                } = sensor
                    && *radius_scale > 0.0
                    && *track_scale > 0.0
                    && let Ok(built) = crate::build::geometry(platform)
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
            check_controllers(c, robot, &driven, scenario, folder);
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
        check_task(c, task, robot, &scenario.arena, folder);
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
        Sensor::Motion { .. } => "motion",
        Sensor::RangeBearing { .. } => "range-bearing",
        Sensor::Imu { .. } => "imu",
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
        Sensor::Motion {
            period,
            straight_radius,
            spot_radius,
        } => {
            c.period(path("period"), *period, step);
            c.positive(path("straight_radius"), *straight_radius);
            c.not_negative(path("spot_radius"), *spot_radius);
            c.require(
                spot_radius < straight_radius,
                path("spot_radius"),
                &format!("less than straight_radius = {}", number(*straight_radius)),
                number(*spot_radius),
            );
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
        Sensor::Imu {
            period,
            gyro_noise_density,
            accel_noise_density,
        } => {
            c.period(path("period"), *period, step);
            c.not_negative(path("gyro_noise_density"), *gyro_noise_density);
            c.not_negative(path("accel_noise_density"), *accel_noise_density);
        }
    }
}

/// What a set of wheels cannot do however it is controlled.
fn check_mobility(c: &mut Checker, robot: &Robot, file: &Platform) {
    let Ok(platform) = crate::build::geometry(file) else {
        return;
    };
    let turns = |(_, controller): (&str, &Controller)| match controller {
        Controller::Signals { channel, .. } => channel.iter().any(|c| c.to == "yaw_rate"),
        _ => true,
    };
    let skids = crate::design::goes_straight_only(&platform).is_some();
    if robot.controllers().any(turns) && skids && robot.level != Level::Slip {
        c.refuse(
            format!("robot.{}.level", robot.name),
            "must be one whose wheels may slip: this robot steers by skidding, and ideal rolling has no solution that turns",
            "use level \"slip\"; or give a wheel a steering, casters or rollers, or command its wheels straight ahead",
        );
    }
    let standing = robot.model.iter().any(|m| m.level == Some(Level::Slip));
    if file.trailer.is_some() && (robot.level == Level::Slip || standing) {
        c.refuse(
            format!("robot.{}.level", robot.name),
            "must be another with a trailer: level \"slip\" knows none",
            "use level \"rolling\", or leave the trailer out",
        );
    }
}
