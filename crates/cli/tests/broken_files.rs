//! Refusals: scenario and robot files broken in one place each, given to the program as people do.
//!
//! Each row breaks a shipped file. The program must end with exit code 2 within ten seconds and
//! name the file, the line where the text has one, the path, the rule and, where there is one, a
//! remedy.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// A shipped file, one edit in it, and what has to be said about it.
struct Row {
    name: &'static str,
    /// Shipped file, from the root of the repository.
    base: &'static str,
    /// What is replaced, and by what.
    edit: (&'static str, &'static str),
    /// Start of the line that has to be named; `None` for rules of the whole run.
    line: Option<&'static str>,
    /// Words that have to be said, path and rule among them.
    says: &'static [&'static str],
    /// Whether a `hint:` has to follow.
    hint: bool,
}

/// A row whose message has a line and a hint.
const fn row(
    name: &'static str,
    base: &'static str,
    edit: (&'static str, &'static str),
    line: &'static str,
    says: &'static [&'static str],
) -> Row {
    Row {
        name,
        base,
        edit,
        line: Some(line),
        says,
        hint: true,
    }
}

impl Row {
    /// The same where the rule itself is all the help there is.
    const fn bare(self) -> Row {
        Row {
            hint: false,
            ..self
        }
    }

    /// The same where the rule concerns the run as a whole, not a line.
    const fn whole(self) -> Row {
        Row { line: None, ..self }
    }
}

const CAR: &str = "scenarios/car.toml";
const TRICYCLE: &str = "scenarios/tricycle.toml";
const TRAILER: &str = "scenarios/trailer.toml";
const HOUSE: &str = "scenarios/house.toml";
const SLALOM: &str = "scenarios/slalom.toml";
const HOMING: &str = "scenarios/homing.toml";
const GATE: &str = "scenarios/gate.toml";
const CIRCLE: &str = "scenarios/circle.toml";
const TWO_ROBOTS: &str = "scenarios/two-robots.toml";
/// A robot on springs, and a scenario with it.
const SPRUNG: &str = "robots/buggy-tenth.toml";
const JUMP: &str = "scenarios/jump.toml";
const ROBOT: &str = "robots/three-wheeler.toml";

/// A beacon, to be multiplied.
const BEACON: &str = "[[arena.beacon]]\nname = \"b1\"\nposition = [2.0, 2.0]\n";

/// Scenarios.
const SCENARIOS: &[Row] = &[
    // Keys and types.
    row("missing-key", SLALOM, ("duration = 50.0", ""), "[time]", &["time.duration: is missing"]),
    row("missing-schema", SLALOM, ("schema = 1\n", ""), "", &["slalom.toml: schema: is missing"]).whole(),
    row("missing-start", SLALOM, ("pose = [0.8, 2.0, 0.0]\n", ""), "[[robot]]", &["robot.tri.pose: is missing"]),
    row("missing-kind", SLALOM, ("kind = \"flat\"\n", ""), "[terrain]", &["terrain.kind: is missing"]),
    row("mistyped-number", SLALOM, ("duration = 50.0", "duration = \"50 s\""), "duration", &["time.duration: must be a number, got string \"50 s\""]).bare(),
    row("mistyped-in-kind", SLALOM, ("speed = 0.9", "speed = \"fast\""), "speed", &["robot.tri.controller.speed: must be a number, got string \"fast\""]).bare(),
    row("mistyped-string", SLALOM, ("name = \"slalom\"", "name = 5"), "name", &["name: must be a string, got integer 5"]).bare(),
    row("number-for-word", SLALOM, ("level = \"rolling\"", "level = 5"), "level", &["robot.tri.level: must be a word in quotes, got integer 5"]).bare(),
    row("mistyped-signal", CIRCLE, ("to_time = 2.0, to = 1.0", "to_time = \"late\", to = 1.0"), "signal = { kind = \"ramp\", from_time = 0.0, to_time = \"late\"", &["robot.bubble.controller.channel.yaw_rate.signal.to_time: must be a number, got string \"late\""]).bare(),
    row("mistyped-list", SLALOM, ("size = [8.0, 4.0]", "size = 8.0"), "size", &["arena.size: must be", "got floating point 8.0"]).bare(),
    row("short-list", SLALOM, ("size = [8.0, 4.0]", "size = [8.0]"), "size", &["arena.size: must be a list of length 2, got length 1"]).bare(),
    row("unknown-key", SLALOM, ("friction = 0.7", "friction = 0.7\ncolor = \"red\""), "color", &["terrain.color: unknown key", "known here:"]),
    row("misspelled-key", SLALOM, ("duration = 50.0", "durration = 50.0"), "durration", &["time.durration: unknown key", "did you mean duration?"]),
    row("misspelled-key-in-kind", SLALOM, ("lateral_acceleration", "lateral_acceleraton"), "lateral_acceleraton", &["robot.tri.controller.lateral_acceleraton: unknown key", "did you mean lateral_acceleration?"]),
    row("misspelled-table", SLALOM, ("[terrain]", "[terain]"), "[terain]", &["terain: unknown key", "did you mean terrain?"]),
    row("unknown-kind", SLALOM, ("kind = \"flat\"", "kind = \"flatt\""), "kind = \"flatt\"", &["terrain.kind: must be one of flat, plane, uneven, got \"flatt\"", "did you mean \"flat\"?"]),
    row("unknown-word", SLALOM, ("level = \"rolling\"", "level = \"roling\""), "level", &["robot.tri.level: must be one of kinematic, rolling, slip, got \"roling\"", "did you mean \"rolling\"?"]),
    row("unknown-task", SLALOM, ("[robot.task]\nkind = \"slalom\"", "[robot.task]\nkind = \"parking\""), "kind = \"parking\"", &["robot.tri.task.kind: must be one of homing, gate, eight, slalom, route, got \"parking\""]).bare(),
    row("wrong-schema", SLALOM, ("schema = 1", "schema = 2"), "schema", &["schema: must be 1, got 2"]),
    row("huge-integer", SLALOM, ("seed = 1 ", "seed = 99999999999999999999 "), "seed", &["not valid TOML", "99999999999999999999", "whole numbers within"]),
    row("negative-seed", SLALOM, ("seed = 1 ", "seed = -1 "), "seed", &["seed: must be a whole number that is not negative, got integer -1"]).bare(),
    row("empty-name", SLALOM, ("name = \"slalom\"", "name = \"\""), "name", &["name: must be 1 to 64 letters, digits, - or _, got \"\""]),
    row("name-of-path", SLALOM, ("name = \"slalom\"", "name = \"../../etc\""), "name", &["name: must be 1 to 64 letters", "\"../../etc\""]),
    row("not-toml", SLALOM, ("[arena]", "[arena"), "[arena", &["not valid TOML"]),
    row("key-twice", SLALOM, ("seed = 1 ", "schema = 1 "), "schema = 1  ", &["not valid TOML: duplicate key"]),
    // Time.
    row("zero-step", SLALOM, ("step = 0.001", "step = 0.0"), "step", &["time.step: must be a finite number > 0, got 0"]).bare(),
    row("infinite-step", SLALOM, ("step = 0.001", "step = inf"), "step", &["time.step: must be a finite number > 0, got inf"]).bare(),
    row("negative-duration", SLALOM, ("duration = 50.0", "duration = -50.0"), "duration", &["time.duration: must be a finite number > 0, got -50"]).bare(),
    row("endless-duration", SLALOM, ("duration = 50.0", "duration = 1e300"), "duration", &["time.duration: must be", "less than 1000000000000 steps of 0.001 s, got 1e300"]),
    row("period-off-step", SLALOM, ("period = 0.01 ", "period = 0.0105 "), "period", &["robot.tri.controller.period: must be a multiple of time.step = 0.001 s, got 0.0105", "would do"]),
    row("zero-tolerance", SLALOM, ("integrator = \"auto\"", "tolerance = 0.0"), "tolerance", &["time.tolerance: must be in [1e-13, 0.01], got 0"]).bare(),
    // Arena.
    row("no-beacon", HOMING, ("[[arena.beacon]]\nname = \"dock\"\nposition = [4.5, 3.0]", "beacon = []"), "beacon", &["arena.beacon: must be 1 to 15 beacons, got 0"]),
    row("beacon-twice", SLALOM, ("name = \"b3\"", "name = \"b2\"  # again"), "name = \"b2\"  # again", &["arena.beacon.2.name: must differ from the others, got \"b2\" twice"]),
    row("beacon-outside", SLALOM, ("position = [6.8, 2.0]", "position = [6.8, 4.2]"), "position = [6.8, 4.2]", &["arena.beacon.b5.position: must be inside the arena", "[6.8, 4.2]"]),
    row("beacon-nowhere", SLALOM, ("position = [6.8, 2.0]", "position = [nan, 2.0]"), "position = [nan", &["arena.beacon.b5.position: must be inside the arena", "NaN"]),
    row("inline-beacons", HOMING, ("[[arena.beacon]]\nname = \"dock\"\nposition = [4.5, 3.0]", "beacon = [\n  { name = \"dock\", position = [4.5, 30.0] },\n]"), "  { name", &["arena.beacon.dock.position: must be inside the arena"]),
    row("flat-arena", SLALOM, ("size = [8.0, 4.0]", "size = [8.0, 0.0]"), "size", &["arena.size: must be a height in (0, 10000] m, got 0"]).bare(),
    row("upright-slope", SLALOM, ("kind = \"flat\"", "kind = \"plane\"\nslope_deg = 90.0"), "slope_deg", &["terrain.slope_deg: must be in [0, 60], got 90"]),
    // Robots.
    row("robot-twice", TWO_ROBOTS, ("name = \"tri\"", "name = \"p3dx\"  # again"), "name = \"p3dx\"  # again", &["robot.1.name: must differ from the others, got \"p3dx\" twice"]).bare(),
    row("start-outside", SLALOM, ("pose = [0.8, 2.0, 0.0]", "pose = [0.1, 2.0, 0.0]"), "pose", &["robot.tri.pose: must keep the robot's disc of 0.25 m inside the arena", "[0.1, 2.0, 0.0]"]),
    row("start-nowhere", SLALOM, ("pose = [0.8, 2.0, 0.0]", "pose = [0.8, nan, 0.0]"), "pose", &["robot.tri.pose: must be finite, got NaN"]).bare(),
    row("dangling-file", SLALOM, ("three-wheeler.toml", "four-wheeler.toml"), "file", &["robot.tri.file: \"../robots/four-wheeler.toml\" cannot be read", "No such file"]),
    row("folder-as-file", SLALOM, ("../robots/three-wheeler.toml", "../robots"), "file", &["robot.tri.file: \"../robots\" cannot be read: is a directory"]),
    row("scenario-as-robot", SLALOM, ("../robots/three-wheeler.toml", "homing.toml"), "file", &["robot.tri.file: must be a robot file, got a scenario: \"homing.toml\""]),
    row("file-and-platform", SLALOM, ("[robot.controller]", "[robot.platform]\nname = \"other\"\n\n[robot.controller]"), "file", &["robot.tri.file: must not stand beside an inline platform", "keep one"]),
    row("neither-file-nor-platform", SLALOM, ("file = \"../robots/three-wheeler.toml\"\n", ""), "[[robot]]", &["robot.tri.platform: is missing", "name a robot file"]),
    row("motors-of-none", "scenarios/coast.toml", ("level = \"rolling\"", "drive = \"dc-motor\""), "drive", &["robot.cart.drive: must be another"]),
    // Routes, trailers, batches.
    row("route-without-end", TRICYCLE, ("kind = \"line\"\nlength = 4.5 ", "kind = \"line\"\nlength = 0.0 "), "length = 0.0", &["robot.agv.task.path.piece.0.length: must be a finite number > 0, got 0.0"]).bare(),
    row("route-of-other-kind", TRICYCLE, ("kind = \"pieces\"", "kind = \"zigzag\""), "kind = \"zigzag\"", &["robot.agv.task.path.kind: must be one of pieces, polyline, spline, file, got \"zigzag\""]).bare(),
    row("piece-without-end", TRICYCLE, ("kind = \"clothoid\"\nlength = 1.0                   # m\nto = 0.8 ", "kind = \"clothoid\"\nlength = 1.0                   # m\nt = 0.8 "), "t = 0.8", &["robot.agv.task.path.piece.1.t: unknown key", "did you mean to?"]),
    row("polyline-without-radius", TRAILER, (", radius = 1.2 }", " }"), "path = {", &["robot.tug.task.path.radius: is missing"]),
    row("route-of-one-way", TRAILER, ("tolerance = 0.25", "end = 15.0\ntolerance = 0.25"), "end", &["robot.tug.task.end: must be at most half of the route's"]).bare(),
    row("route-backwards", TRAILER, ("pose = [2.0, 1.2, 0.0]", "pose = [2.0, 1.2, 3.1]"), "path = {", &["robot.tug.task.path: must begin within 90 degrees of the robot's heading"]),
    row("route-too-sharp", TRAILER, ("radius = 1.2", "radius = 0.02"), "path = {", &["robot.tug.task.path: must have no curve tighter than", "got 0.020 m at", "widen the curve"]),
    row("route-corner-too-wide", TRAILER, ("radius = 1.2", "radius = 3.0"), "path = {", &["robot.tug.task.path.radius: must leave the edge from (8.5, 1.2) to (8.5, 5.6) its 4.400 m", "would do there"]),
    row("route-leaves", TRAILER, ("[8.5, 5.6], [2.0, 5.6]]", "[8.5, 6.9], [2.0, 6.9]]"), "path = {", &["robot.tug.task.path: must keep the robot's disc of 0.95 m inside the arena", "leaves it at"]),
    row("route-through-beacon", TRAILER, ("position = [4.0, 3.4]", "position = [4.0, 1.5]"), "path = {", &["robot.tug.task.path: must keep 1.100 m from the center of beacon \"rack\"", "got 0.300 m"]),
    row("route-from-afar", TRAILER, ("pose = [2.0, 1.2, 0.0]", "pose = [2.0, 1.6, 0.0]"), "path = {", &["robot.tug.task.path: must begin within tolerance = 0.25 m of the robot's start, got 0.400 m"]),
    row("route-open-laps", TRAILER, ("tolerance = 0.25", "laps = 2\ntolerance = 0.25"), "laps", &["robot.tug.task.laps: must be 1 for a path that does not close, got 2"]),
    row("route-dangling", CAR, ("car-track.csv\", closed", "no-track.csv\", closed"), "path = {", &["robot.car.task.path.file: \"", "no-track.csv\" cannot be read"]),
    row("route-column", CAR, ("closed = true }", "closed = true, x = \"east\" }"), "path = {", &["robot.car.task.path.file: must have a column \"east\", got x, y"]),
    row("sideways-on-two-wheels", "scenarios/laws.toml", ("law = \"samson\"", "heading = \"hold\""), "heading", &["robot.samson.controller.heading: must be \"steer\"", "degree of mobility is 2"]),
    row("car-on-the-spot", CAR, ("kind = \"route\"\nlaw", "kind = \"homing\"\nlaw"), "kind = \"homing\"", &["robot.car.controller.kind: must be \"route\" for a robot that cannot turn on the spot"]),
    row("motion-radii", "scenarios/motion.toml", ("straight_radius = 5.0", "straight_radius = 1e-4"), "[[robot.sensor]]", &["robot.bubble.sensor.motion.spot_radius: must be less than straight_radius"]).bare(),
    row("no-trials", "scenarios/house-seeds.toml", ("trials = 10000", "trials = 0"), "trials", &["batch.trials: must be in [1, 100000000], got 0"]).bare(),
    row("draw-upside-down", "scenarios/house-seeds.toml", ("trials = 10000", "vary = [{ path = \"seed\", draw = { kind = \"uniform\", low = 2.0, high = 1.0 } }]"), "vary", &["batch.vary.0.draw.high: must be at least low = 2, got 1"]).bare(),
    // Steering, noise, statistics.
    row("odometry-of-steered", CAR, ("[robot.controller]", "[[robot.sensor]]\nkind = \"odometry\"\nperiod = 0.01\n\n[robot.controller]"), "[[robot.sensor]]", &["robot.car.sensor.odometry: must be of another kind"]),
    row("skid-steer-turns", CAR, ("car-tenth.toml", "husky-a200.toml"), "[[robot]]", &["robot.car.level: must be one whose wheels may slip", "ideal rolling has no solution that turns", "slip"]),
    row("noise-on-no-wheel", HOUSE, ("{ wheel = \"front-left\", file", "{ wheel = \"front\", file"), "    { wheel = \"front\"", &["robot.real.wheel_noise.front.wheel: must name a driven wheel, got \"front\"", "front-left"]),
    row("noise-of-no-column", HOUSE, ("column = \"n1\"", "column = \"n9\""), "    { wheel = \"front-left\"", &["robot.real.wheel_noise.front-left.file: must have a column \"n9\""]),
    row("noise-half-named", HOUSE, (", column = \"n1\"", ""), "    { wheel = \"front-left\"", &["robot.real.wheel_noise.front-left.column: is missing"]),
    row("statistics-of-nobody", HOUSE, ("minus = \"real\"", "minus = \"unreal\""), "minus = \"unreal\"", &["statistics.difference.ideal less real.minus: must name a robot, got \"unreal\""]),
    row("statistics-of-nothing", HOUSE, ("\"twist.forward\"", "\"twist.up\""), "signals", &["statistics.signals: must be signals of robot \"ideal\", got \"twist.up\""]).whole(),
    row("stairs-down", HOUSE, ("at = [0.0, 4.0, 8.0", "at = [0.0, 9.0, 8.0"), "signal = ", &["robot.ideal.controller.channel.forward.signal.at: must be increasing times"]),
    row("feedback-of-forces", HOUSE, ("level = \"kinematic\"\npose = [0.8, 1.4, 0.0]\nsensor = [{ kind = \"odometry\", name = \"note\", method = \"unrotated\", period = 0.05 }]\nwheel_noise", "level = \"rolling\"\npose = [0.8, 1.4, 0.0]\nsensor = [{ kind = \"odometry\", name = \"note\", method = \"unrotated\", period = 0.05 }]\nservo = { angle_feedback = 5.0 }\nwheel_noise"), "servo = ", &["robot.real.servo.angle_feedback: must be 0 but at level \"kinematic\""]),
    // Controllers, tasks, sensors, signals.
    row("unknown-beacon", SLALOM, ("\"b4\", \"b5\"]", "\"b4\", \"b6\"]"), "chain", &["robot.tri.task.chain: must name a beacon of the arena, got \"b6\"", "there are: b1, b2, b3, b4, b5"]),
    row("gate-of-one", GATE, ("beacons = [\"b1\", \"b2\"]", "beacons = [\"b1\", \"b1\"]"), "beacons", &["robot.p3dx.task.beacons: must be two different beacons, got \"b1\" twice"]),
    row("chain-of-one", SLALOM, ("[\"b1\", \"b2\", \"b3\", \"b4\", \"b5\"]", "[\"b1\"]"), "chain", &["robot.tri.task.chain: must name at least two beacons, got 1"]),
    row("chain-with-repeat", SLALOM, ("\"b4\", \"b5\"]", "\"b4\", \"b1\"]"), "chain", &["robot.tri.task.chain: must name each beacon once, got \"b1\" twice"]).bare(),
    row("controller-of-another-task", SLALOM, ("[robot.controller]\nkind = \"slalom\"", "[robot.controller]\nkind = \"gate\""), "kind = \"gate\"", &["robot.tri.controller.kind: must go with a task of the same kind, got \"gate\" with slalom"]),
    row("pose-without-sensor", SLALOM, ("speed = 0.9 ", "pose = \"odometry\" "), "pose = \"odometry\"", &["robot.tri.controller.pose: must name a sensor that the robot has, got one of kind \"odometry\"", "[[robot.sensor]]"]),
    row("slow-follower", SLALOM, ("period = 0.01 ", "period = 0.5 "), "period", &["robot.tri.controller.period: must be at most 0.1 s, got 0.5"]).bare(),
    row("sensor-period", SLALOM, ("[robot.task]", "[[robot.sensor]]\nkind = \"pose\"\nperiod = 0.0\n\n[robot.task]"), "period = 0.0\n", &["robot.tri.sensor.pose.period: must be a finite number > 0, got 0"]).bare(),
    row("sensor-twice", SLALOM, ("[robot.task]", "[[robot.sensor]]\nkind = \"pose\"\nperiod = 0.01\n\n[[robot.sensor]]\nperiod = 0.01\nkind = \"pose\"\n\n[robot.task]"), "kind = \"pose\"\n\n[robot.task]", &["robot.tri.sensor.1.kind: must differ from the others, got \"pose\" twice"]).bare(),
    row("channel-of-no-wheel", CIRCLE, ("to = \"yaw_rate\"", "to = \"wheel.middle\""), "to = \"wheel.middle\"", &["robot.bubble.controller.channel.wheel.middle.to: must be a channel of the robot, got \"wheel.middle\"", "wheel.left, wheel.right"]),
    row("misspelled-channel", CIRCLE, ("to = \"yaw_rate\"", "to = \"yawrate\""), "to = \"yawrate\"", &["must be a channel of the robot, got \"yawrate\"", "yaw_rate"]),
    row("ramp-backwards", CIRCLE, ("from_time = 0.0", "from_time = 3.0"), "signal", &["robot.bubble.controller.channel.forward.signal.to_time: must be later than from_time = 3, got 2"]).bare(),
    row("table-missing", CIRCLE, ("{ kind = \"ramp\", from_time = 0.0, to_time = 2.0, to = 1.0 }", "{ kind = \"table\", file = \"none.csv\", column = \"rate\" }"), "signal = { kind = \"table\"", &["robot.bubble.controller.channel.yaw_rate.signal.file", "none.csv\" cannot be read"]),
    row("table-with-text", CIRCLE, ("{ kind = \"ramp\", from_time = 0.0, to_time = 2.0, to = 1.0 }", "{ kind = \"table\", file = \"text.csv\", column = \"rate\" }"), "signal = { kind = \"table\"", &["yaw_rate.signal.file", "line 3 column 2: must be a finite number, got \"fast\""]),
    row("table-backwards", CIRCLE, ("{ kind = \"ramp\", from_time = 0.0, to_time = 2.0, to = 1.0 }", "{ kind = \"table\", file = \"backwards.csv\", column = \"rate\" }"), "signal = { kind = \"table\"", &["yaw_rate.signal.file", "line 4: times must increase, got 0.5"]),
    row("table-without-column", CIRCLE, ("{ kind = \"ramp\", from_time = 0.0, to_time = 2.0, to = 1.0 }", "{ kind = \"table\", file = \"text.csv\", column = \"speed\" }"), "signal = { kind = \"table\"", &["yaw_rate.signal.file", "must have a column \"speed\", got time, rate"]),
    // The run as a whole.
    row("unstable-method", "scenarios/eight.toml", ("duration = 60.0", "integrator = \"rk4\"\nduration = 60.0"), "", &["time.integrator: must be another: Runge–Kutta 4 is unstable"]).whole(),
    row("gap-too-narrow", GATE, ("position = [3.0, 1.5]", "position = [3.0, 2.4]"), "", &["robot.p3dx.task: cannot be solved"]).whole(),
];

/// Robot files: each is refused by itself, and in a scenario that names it.
const ROBOTS: &[Row] = &[
    row(
        "springs-under-some",
        SPRUNG,
        (
            "width = 0.03\nsteering = { kind = \"guided\", by = \"front-left\" }\nsuspension = { stiffness = 300.0, damping = 12.0 }",
            "width = 0.03\nsteering = { kind = \"guided\", by = \"front-left\" }",
        ),
        "[[wheel]]\nname = \"front-right\"",
        &["wheel.front-right.suspension: must be given, for wheel rear-left has one"],
    ),
    row(
        "springs-without-inertia",
        SPRUNG,
        ("pitch_inertia_com = 0.030", "#"),
        "[body]",
        &["body.pitch_inertia_com: must be given for a robot with a suspension"],
    ),
    row(
        "inertias-of-no-body",
        SPRUNG,
        ("roll_inertia_com = 0.006 ", "roll_inertia_com = 0.9 "),
        "roll_inertia_com = 0.9",
        &["body.roll_inertia_com: must be at most the sum of the two other inertias"],
    )
    .bare(),
    row(
        "damping-negative",
        SPRUNG,
        (
            "by = \"front-left\" }\nsuspension = { stiffness = 300.0, damping = 12.0 }",
            "by = \"front-left\" }\nsuspension = { stiffness = 300.0, damping = -2.0 }",
        ),
        "suspension = { stiffness = 300.0, damping = -2.0 }",
        &["wheel.front-right.suspension.damping: must be a finite number >= 0, got -2"],
    )
    .bare(),
    row(
        "radius-nan",
        ROBOT,
        ("radius = 0.1\n", "radius = nan\n"),
        "radius = nan",
        &["wheel.left.radius: must be a finite number > 0, got NaN"],
    )
    .bare(),
    row(
        "radius-inf",
        ROBOT,
        ("radius = 0.1\n", "radius = +inf\n"),
        "radius = +inf",
        &["wheel.left.radius: must be a finite number > 0, got inf"],
    )
    .bare(),
    row(
        "radius-minus-inf",
        ROBOT,
        ("radius = 0.1\n", "radius = -inf\n"),
        "radius = -inf",
        &["wheel.left.radius: must be a finite number > 0, got -inf"],
    )
    .bare(),
    row(
        "radius-zero",
        ROBOT,
        ("radius = 0.1\n", "radius = 0\n"),
        "radius = 0\n",
        &["wheel.left.radius: must be a finite number > 0, got 0"],
    )
    .bare(),
    row(
        "radius-negative",
        ROBOT,
        ("radius = 0.1\n", "radius = -0.08\n"),
        "radius = -0.08",
        &["wheel.left.radius: must be a finite number > 0, got -0.08"],
    )
    .bare(),
    row(
        "radius-beyond-range",
        ROBOT,
        ("radius = 0.1\n", "radius = 1e400\n"),
        "radius = 1e400",
        &["not valid TOML", "1e400", "numbers lie within"],
    ),
    row(
        "mass-zero",
        ROBOT,
        ("mass = 9.0", "mass = 0.0"),
        "mass = 0.0",
        &["body.mass: must be a finite number > 0, got 0"],
    )
    .bare(),
    row(
        "mass-negative",
        ROBOT,
        ("mass = 9.0", "mass = -9.0"),
        "mass = -9.0",
        &["body.mass: must be a finite number > 0, got -9"],
    )
    .bare(),
    row(
        "wheel-mass-negative",
        ROBOT,
        ("mass = 0.5\n", "mass = -0.5\n"),
        "mass = -0.5",
        &["wheel.left.mass: must be a finite number >= 0, got -0.5"],
    )
    .bare(),
    row(
        "buried-center-of-mass",
        ROBOT,
        ("0.0, 0.12]", "0.0, -0.12]"),
        "center_of_mass",
        &["body.center_of_mass: must be"],
    )
    .bare(),
    row(
        "robot-without-body",
        ROBOT,
        ("[body]", "[[body]]"),
        "[[body]]",
        &["body"],
    )
    .bare(),
    row(
        "robot-without-mount",
        ROBOT,
        ("mount = [0.0, 0.2]\n", ""),
        "[[wheel]]",
        &["wheel.left.mount: is missing"],
    ),
    row(
        "wheel-twice",
        ROBOT,
        ("name = \"right\"", "name = \"left\"  # again"),
        "name = \"left\"  # again",
        &["wheel.1.name: must differ from the others, got \"left\" twice"],
    )
    .bare(),
    row(
        "no-resistance",
        ROBOT,
        ("resistance = 1.2\n", ""),
        "[wheel.drive]",
        &["wheel.left.drive.resistance: is missing"],
    ),
    row(
        "mistyped-resistance",
        ROBOT,
        ("resistance = 1.2\n", "resistance = true\n"),
        "resistance = true",
        &["wheel.left.drive.resistance: must be a number, got boolean true"],
    )
    .bare(),
    row(
        "generous-gear",
        ROBOT,
        ("gear_efficiency = 1.0\n", "gear_efficiency = 1.5\n"),
        "gear_efficiency = 1.5",
        &["wheel.left.drive.gear_efficiency: must be in (0, 1], got 1.5"],
    )
    .bare(),
    row(
        "unknown-drive",
        ROBOT,
        ("kind = \"dc-motor\"", "kind = \"dcmotor\""),
        "kind = \"dcmotor\"",
        &[
            "wheel.left.drive.kind: must be one of none, torque, dc-motor, got \"dcmotor\"",
            "did you mean \"dc-motor\"?",
        ],
    ),
    row(
        "caster-without-trail",
        ROBOT,
        ("trail = 0.03", "trail = 0.0"),
        "steering",
        &["wheel.caster.steering.trail: must be finite and not 0, got 0"],
    ),
    row(
        "rollers-along",
        ROBOT,
        (
            "radius = 0.1\n",
            "radius = 0.1\nrim = { kind = \"rollers\", angle_deg = 90.0 }\n",
        ),
        "rim",
        &[
            "wheel.left.rim.angle_deg: must be between -85 and 85",
            "got 90",
        ],
    ),
    row(
        "locked-wheels",
        ROBOT,
        (
            "steering = { kind = \"free\", trail = 0.03 }",
            "steering = { kind = \"fixed\", angle_deg = 90.0 }\n\n[[wheel]]\nname = \"tail\"\nmount = [-0.16, 0.1]\nradius = 0.03",
        ),
        "",
        &["wheel: must leave a way to roll"],
    )
    .whole(),
    row(
        "rollers-on-caster",
        ROBOT,
        (
            "radius = 0.03\n",
            "radius = 0.03\nrim = { kind = \"rollers\", angle_deg = 45.0 }\n",
        ),
        "rim",
        &["wheel.caster.rim: must be plain on a wheel that swivels freely"],
    ),
    row(
        "thin-footprint",
        ROBOT,
        (
            "footprint = [\n",
            "footprint = [[0.0, 0.0], [1.0, 0.0]]\nremark = [\n",
        ),
        "remark",
        &["remark: unknown key"],
    ),
];

/// Command lines: words after `check scenarios/slalom.toml`, and what has to be said.
const SETS: &[(&[&str], &[&str])] = &[
    (
        &["--set", "time.step"],
        &["--set time.step: must be PATH=VALUE, got no ="],
    ),
    (
        &["--set", "robot.tree.pose=[1.0, 1.0, 0.0]"],
        &[
            "--set: robot.tree.pose: there is no robot named \"tree\"",
            "there are: tri",
        ],
    ),
    (
        &["--set", "arena.beacon.b9.radius=0.1"],
        &[
            "--set: arena.beacon.b9.radius: there is no beacon named \"b9\"",
            "b1, b2",
        ],
    ),
    (
        &["--set", "time.stp=0.1"],
        &["--set: time.stp: unknown key", "did you mean step?"],
    ),
    (
        &["--set", "time.step=fast"],
        &["--set: time.step: must be a number, got string \"fast\""],
    ),
    (
        &["--set", "time.step=-1"],
        &["--set: time.step: must be a finite number > 0, got -1"],
    ),
    (
        &["--set", "time.step.size=1"],
        &["--set: time.step.size: step is a value, not a table"],
    ),
    (
        &["--set", "robot.tri.controller.speed=true"],
        &["--set: robot.tri.controller.speed: must be a number, got boolean true"],
    ),
    (
        &["--set", "robot.tri.platform.wheel.left.radius=0"],
        &["--set: robot.tri.platform.wheel.left.radius: must be a finite number > 0, got 0"],
    ),
    (
        &["--set", "robot.tri.task={ kind = \"gate\" }"],
        &["--set: robot.tri.task.beacons: is missing"],
    ),
    (
        &["--set", "robot.tri.file=none.toml"],
        &["--set: robot.tri.file: \"none.toml\" cannot be read"],
    ),
    (&["--set", "=5"], &["--set: must be names joined by dots"]),
    (&["--set", "robot=5"], &["--set: robot: must be"]),
    (&["--set", "robot.tri=5"], &["--set: robot.tri"]),
    (
        &["--set", "arena.size.2=5"],
        &["--set: arena.size.2", "size is a list of 2 values"],
    ),
    (
        &["--set", "a.a.a.a.a.a.a.a.a.a.a.a=1"],
        &["--set: a: unknown key"],
    ),
    (
        &["--level", "flying"],
        &["--set: robot.tri.level: must be one of kinematic, rolling, slip, got \"flying\""],
    ),
];

/// The repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn shipped(file: &str) -> String {
    fs::read_to_string(root().join(file)).expect("the file is shipped")
}

/// A folder of this row's own with the shipped files, as in the repository.
fn workshop(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("broken_files")
        .join(name);
    for part in ["scenarios", "robots"] {
        fs::create_dir_all(folder.join(part)).expect("the target folder can be written");
        for entry in fs::read_dir(root().join(part)).expect("the folder is shipped") {
            let entry = entry.expect("the folder can be listed");
            fs::copy(entry.path(), folder.join(part).join(entry.file_name()))
                .expect("the target folder can be written");
        }
    }
    folder
}

/// Runs the program in a folder; exit code and standard error. Fails after ten seconds.
fn appell(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_appell"))
        .args(arguments)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program is built");
    let mut stderr = child.stderr.take().expect("standard error is piped");
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        let mut bytes = Vec::new();
        stderr.read_to_end(&mut bytes).expect("a pipe can be read");
        sender.send(String::from_utf8_lossy(&bytes).into_owned())
    });
    let Ok(text) = receiver.recv_timeout(Duration::from_secs(10)) else {
        child.kill().expect("the program still runs");
        child.wait().expect("the program was started");
        return (None, format!("{arguments:?} took more than 10 s"));
    };
    (child.wait().expect("the program was started").code(), text)
}

/// What is wrong with a refusal; empty if nothing.
fn faults(answer: &(Option<i32>, String), says: &[&str]) -> String {
    let (code, text) = answer;
    let mut faults = String::new();
    if *code != Some(2) {
        faults.push_str(&format!("  exit code must be 2, got {code:?}\n"));
    }
    for word in says {
        if !text.contains(word) {
            faults.push_str(&format!("  must say {word:?}\n"));
        }
    }
    for word in ["panicked", "defect"] {
        if text.contains(word) {
            faults.push_str(&format!("  must not say {word:?}\n"));
        }
    }
    if faults.is_empty() {
        return faults;
    }
    format!(
        "{faults}  got: {}\n",
        text.trim_end().replace('\n', "\n       ")
    )
}

/// Number of the line of `text` in which `start` begins, from 1.
fn line_of(text: &str, start: &str) -> usize {
    let offset = if text.starts_with(start) {
        0
    } else {
        1 + text
            .find(&format!("\n{start}"))
            .expect("the row names a line of its text")
    };
    1 + text[..offset].matches('\n').count()
}

/// Makes a row's broken file and asks `command` about it, or about a scenario that names it.
fn check_row(row: &Row, command: &str, asked: &str) -> String {
    let folder = workshop(&format!("{}-{command}", row.name));
    let text = shipped(row.base).replacen(row.edit.0, row.edit.1, 1);
    assert_ne!(text, shipped(row.base), "{}: nothing was edited", row.name);
    fs::write(folder.join(row.base), &text).expect("the target folder can be written");
    fs::write(
        folder.join("scenarios/text.csv"),
        "time,rate\n0,1\n1,fast\n",
    )
    .expect("the same");
    fs::write(
        folder.join("scenarios/backwards.csv"),
        "time,rate\n0,1\n1,2\n0.5,3\n",
    )
    .expect("the same");
    let mut says = row.says.to_vec();
    let name = Path::new(row.base)
        .file_name()
        .and_then(|name| name.to_str())
        .expect("it has a name");
    let place = row.line.map_or(name.to_owned(), |start| {
        format!("{name}:{}:", line_of(&text, start))
    });
    if row.line.is_some() || asked == row.base {
        says.push(&place);
    }
    if row.hint {
        says.push("\n  hint: ");
    }
    let faults = faults(&appell(&folder, &[command, asked]), &says);
    let _ = fs::remove_dir_all(&folder);
    if faults.is_empty() {
        faults
    } else {
        format!("{} ({command} {asked}):\n{faults}", row.name)
    }
}

fn report(faults: Vec<String>) {
    let faults: Vec<String> = faults
        .into_iter()
        .filter(|fault| !fault.is_empty())
        .collect();
    assert!(
        faults.is_empty(),
        "{} refusals are poor:\n{}",
        faults.len(),
        faults.join("\n")
    );
}

#[test]
fn refusal_of_scenarios() {
    report(
        SCENARIOS
            .iter()
            .map(|row| check_row(row, "check", row.base))
            .collect(),
    );
}

#[test]
fn refusal_of_scenarios_by_run() {
    report(
        SCENARIOS
            .iter()
            .step_by(7)
            .map(|row| check_row(row, "run", row.base))
            .collect(),
    );
}

#[test]
fn refusal_of_robots() {
    report(
        ROBOTS
            .iter()
            .map(|row| check_row(row, "check", row.base))
            .collect(),
    );
}

#[test]
fn refusal_of_robots_in_scenarios() {
    report(
        ROBOTS
            .iter()
            .map(|row| check_row(row, "run", if row.base == SPRUNG { JUMP } else { SLALOM }))
            .collect(),
    );
}

#[test]
fn refusal_of_command_lines() {
    let folder = root();
    let faulty = SETS.iter().map(|(arguments, says)| {
        let all = [&["check", SLALOM], *arguments].concat();
        let faults = faults(&appell(&folder, &all), says);
        if faults.is_empty() {
            faults
        } else {
            format!("{arguments:?}:\n{faults}")
        }
    });
    report(faulty.collect());
}

/// Files that are no edit of a shipped one: name, content, and what has to be said.
#[test]
fn refusal_of_other_files() {
    let folder = workshop("other");
    let deep_array = format!("a = {}", "[".repeat(500_000));
    let closed_array = format!("a = {}{}", "[".repeat(200_000), "]".repeat(200_000));
    let deep_key = format!("[{}a]\n", "a.".repeat(200_000));
    let deep_table = format!("a = {}", "{a=".repeat(150_000));
    let sixteen = shipped(HOMING)
        + &(1..=15)
            .map(|k| BEACON.replace("b1", &format!("b{k}")))
            .collect::<String>();
    let shipped_slalom = shipped(SLALOM);
    let (head, _) = shipped_slalom
        .split_once("[[robot]]")
        .expect("it has a robot");
    let binary: Vec<u8> = (0..=255).cycle().take(100_000).collect();
    let rows: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("empty.toml", Vec::new(), &["is missing", "hint: "]),
        (
            "blank.toml",
            b"\n\n# nothing\n".to_vec(),
            &["is missing", "hint: "],
        ),
        (
            "invalid-utf8.toml",
            b"schema = 1\nname = \"\xff\xfe\"\n".to_vec(),
            &[
                "invalid-utf8.toml:2:9: must be UTF-8 text, got the byte 0xff",
                "hint: ",
            ],
        ),
        ("binary.toml", binary, &["must be UTF-8 text"]),
        (
            "zeros.toml",
            vec![0; 4096],
            &["zeros.toml:1:", "not valid TOML"],
        ),
        (
            "prose.toml",
            b"Dear robot, please drive.\n".to_vec(),
            &["prose.toml:1:", "not valid TOML", "hint: "],
        ),
        (
            "deep-array.toml",
            deep_array.into_bytes(),
            &["not valid TOML"],
        ),
        (
            "closed-array.toml",
            closed_array.into_bytes(),
            &["not valid TOML"],
        ),
        ("deep-key.toml", deep_key.into_bytes(), &["not valid TOML"]),
        (
            "deep-table.toml",
            deep_table.into_bytes(),
            &["not valid TOML"],
        ),
        (
            "sixteen-beacons.toml",
            sixteen.into_bytes(),
            &["arena.beacon: must be 1 to 15 beacons, got 16", "hint: "],
        ),
        (
            "no-robots.toml",
            format!("robot = []\n{head}").into_bytes(),
            &[
                "no-robots.toml:1:1: robot: must have at least one entry",
                "hint: ",
            ],
        ),
        (
            "without-robots.toml",
            head.as_bytes().to_vec(),
            &["without-robots.toml: robot: is missing", "hint: "],
        ),
        (
            "list.csv",
            b"time,rate\n0,1\n".to_vec(),
            &["list.csv:1:", "not valid TOML"],
        ),
        (
            "mebibyte.toml",
            vec![b'#'; (1 << 20) + 1],
            &["must be at most 1048576 bytes, got more", "hint: "],
        ),
    ];
    let mut all = Vec::new();
    for (name, content, says) in &rows {
        let path = format!("scenarios/{name}");
        fs::write(folder.join(&path), content).expect("the target folder can be written");
        for command in ["check", "run"] {
            let says = [&[*name], *says].concat();
            let faults = faults(&appell(&folder, &[command, &path]), &says);
            all.push(if faults.is_empty() {
                faults
            } else {
                format!("{command} {path}:\n{faults}")
            });
        }
    }
    for (arguments, says) in [
        (
            ["run", ROBOT],
            &[
                "three-wheeler.toml",
                "must be a scenario, got a robot file",
                "hint: ",
            ][..],
        ),
        (
            ["check", "scenarios"],
            &["scenarios: cannot be read: is a directory", "hint: "],
        ),
        (
            ["run", "robots"],
            &["robots: cannot be read: is a directory", "hint: "],
        ),
        (
            ["check", "scenarios/none.toml"],
            &["none.toml: cannot be read: No such file", "hint: "],
        ),
        (["run", ""], &["a value is required"]),
    ] {
        let faults = faults(&appell(&folder, &arguments), says);
        all.push(if faults.is_empty() {
            faults
        } else {
            format!("{arguments:?}:\n{faults}")
        });
    }
    let _ = fs::remove_dir_all(&folder);
    report(all);
}

/// A gibibyte, the first 64 MiB of it brackets and the rest a hole of zeros.
#[test]
fn refusal_of_a_gibibyte() {
    let folder = workshop("gibibyte");
    let mut file =
        File::create(folder.join("brackets.toml")).expect("the target folder can be written");
    for _ in 0..64 {
        file.write_all(&[b'['; 1 << 20]).expect("64 MiB of room");
    }
    file.set_len(1 << 30)
        .expect("the file system has sparse files");
    drop(file);
    let says = [
        "brackets.toml: must be at most 1048576 bytes, got more",
        "\n  hint: ",
    ];
    let all = ["check", "run"]
        .map(|command| faults(&appell(&folder, &[command, "brackets.toml"]), &says));
    fs::remove_dir_all(&folder).expect("the gibibyte can be removed");
    report(all.to_vec());
}

/// What is shipped is valid.
#[test]
fn shipped_files_pass() {
    let mut count = 0;
    for part in ["scenarios", "robots"] {
        for entry in fs::read_dir(root().join(part)).expect("the folder is shipped") {
            let path = entry.expect("the folder can be listed").path();
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            let (code, text) = appell(&root(), &["check", &path.to_string_lossy()]);
            assert_eq!(code, Some(0), "{}: {text}", path.display());
            count += 1;
        }
    }
    assert!(
        count >= 20,
        "four robots and sixteen scenarios are shipped, got {count} files"
    );
}
