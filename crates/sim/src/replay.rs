//! Replay: a scenario driven by the commands that a bag of ROS 2 holds, and how far its odometry then parts
//! from the recorded one.

use std::path::Path;

use appell_model::math::{hypot, wrap_angle};
use appell_model::scalar::Scalar;
use serde::Serialize;

use crate::record::RecordError;
use crate::record::rosbag::{Spoken, read};
use crate::ros::message::{Odometry, Twist, TwistStamped, from_cdr, kind};
use crate::scenario::{Channel, Controller, Robot, Scenario, Signal};

/// What to take from a bag, and whom it is for.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Topic of the commands; the only one of its type if left out.
    pub commands: Option<String>,
    /// Topic of the odometry; likewise.
    pub odometry: Option<String>,
    /// Name of the robot; the first one if left out.
    pub robot: Option<String>,
    /// A command older than this is none, s.
    pub timeout: f64,
}

/// Pose at a time: s, m, m, rad.
pub type Stamped = (f64, [f64; 3]);

/// What a bag tells of one robot. Times are seconds since its first message of either kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// Forward, left, yaw rate: m/s, m/s, rad/s.
    pub commands: Vec<(f64, [f64; 3])>,
    /// Poses, from the first on.
    pub odometry: Vec<Stamped>,
    /// Topics that they are from.
    pub topics: [String; 2],
}

/// How far two odometries are apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Time compared, s.
    pub duration: f64,
    /// Poses compared.
    pub poses: usize,
    /// Way that the recorded robot believes to have gone, m.
    pub distance: f64,
    /// Root mean square of the distance between the positions, m.
    pub position_rms: f64,
    /// Largest distance, m.
    pub position_max: f64,
    /// Time of the largest distance, s.
    pub position_max_at: f64,
    /// Distance at the end, m.
    pub position_end: f64,
    /// Root mean square of the difference of the headings, rad.
    pub yaw_rms: f64,
    /// Largest difference of the headings, rad.
    pub yaw_max: f64,
    /// Difference at the end, simulated less recorded, rad.
    pub yaw_end: f64,
}

/// The topic called `wanted`, or the only one of these types.
fn choose<'a>(
    spoken: &'a [Spoken],
    kinds: &[&str],
    wanted: Option<&String>,
    option: &str,
) -> Result<&'a Spoken, String> {
    let fit: Vec<&Spoken> = spoken
        .iter()
        .filter(|topic| kinds.contains(&topic.kind.as_str()) && !topic.messages.is_empty())
        .collect();
    let names = || {
        fit.iter()
            .map(|topic| topic.topic.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    };
    if let Some(name) = wanted {
        return fit
            .iter()
            .find(|topic| topic.topic == *name)
            .copied()
            .ok_or_else(|| {
                format!(
                    "{option}: must be a topic of {}, got {name}\n  hint: there are: {}",
                    kinds.join(" or "),
                    names()
                )
            });
    }
    match fit.as_slice() {
        [] => Err(format!(
            "must have messages of {}, got none",
            kinds.join(" or ")
        )),
        [only] => Ok(only),
        // Of one command in two types the plain one counts.
        [first, second]
            if second.topic == format!("{}_stamped", first.topic) && first.kind == kind::TWIST =>
        {
            Ok(first)
        }
        _ => Err(format!(
            "must have one topic of {}, got {}\n  hint: choose one with {option}",
            kinds.join(" or "),
            names()
        )),
    }
}

/// Reads what a bag tells of one robot.
///
/// # Errors
/// The bag cannot be read, lacks such messages or has several topics of them, or a number is not finite.
pub fn recorded(bag: &Path, choice: &Choice) -> Result<Recorded, String> {
    let twists = [kind::TWIST, kind::TWIST_STAMPED];
    let all = [kind::TWIST, kind::TWIST_STAMPED, kind::ODOMETRY];
    let told = |error: RecordError| match error.hint() {
        None => error.to_string(),
        Some(hint) => format!("{error}\n  hint: {hint}"),
    };
    let spoken = read(bag, &all).map_err(told)?;
    let at = |problem: String| format!("{}: {problem}", bag.display());
    let commands = choose(&spoken, &twists, choice.commands.as_ref(), "--cmd-vel").map_err(at)?;
    let odometries: Vec<Spoken> = match &choice.odometry {
        // The truth of a simulator is no odometry, though of its type.
        None => spoken
            .iter()
            .filter(|t| !t.topic.ends_with("/ground_truth"))
            .cloned()
            .collect(),
        Some(_) => spoken.clone(),
    };
    let odometry = choose(
        &odometries,
        &[kind::ODOMETRY],
        choice.odometry.as_ref(),
        "--odom",
    )
    .map_err(at)?;
    let first = |topic: &Spoken| topic.messages.first().map_or(u64::MAX, |(time, _)| *time);
    let zero = first(commands).min(first(odometry));
    let seconds = |time: u64| (time - zero) as f64 * 1e-9;
    let wrong = |topic: &Spoken, time: u64, problem: &str| {
        at(format!(
            "{}: the message at {} s {problem}",
            topic.topic,
            seconds(time)
        ))
    };
    let mut twists = Vec::new();
    for (time, bytes) in &commands.messages {
        let twist: Result<Twist, String> = match commands.kind.as_str() {
            kind::TWIST => from_cdr(bytes),
            _ => from_cdr::<TwistStamped>(bytes).map(|stamped| stamped.twist),
        };
        let twist = twist.map_err(|problem| wrong(commands, *time, &problem))?;
        let command = [twist.linear.x, twist.linear.y, twist.angular.z];
        if !command.iter().all(|part| part.is_finite()) {
            return Err(wrong(
                commands,
                *time,
                &format!("must be finite, got {command:?}"),
            ));
        }
        twists.push((seconds(*time), command));
    }
    let mut poses = Vec::new();
    for (time, bytes) in &odometry.messages {
        let message: Odometry =
            from_cdr(bytes).map_err(|problem| wrong(odometry, *time, &problem))?;
        let pose = planar(&message);
        if !pose.iter().all(|part| part.is_finite()) {
            return Err(wrong(
                odometry,
                *time,
                &format!("must be finite, got {pose:?}"),
            ));
        }
        poses.push((seconds(*time), pose));
    }
    Ok(Recorded {
        commands: twists,
        odometry: poses,
        topics: [commands.topic.clone(), odometry.topic.clone()],
    })
}

fn planar(message: &Odometry) -> [f64; 3] {
    let (position, q) = (message.pose.pose.position, message.pose.pose.orientation);
    let (sin, cos) = (
        2.0 * (q.w * q.z + q.x * q.y),
        1.0 - 2.0 * (q.y * q.y + q.z * q.z),
    );
    [position.x, position.y, Scalar::atan2(sin, cos)]
}

/// The robot that is driven.
///
/// # Errors
/// There is none of that name.
pub fn robot_of<'a>(scenario: &'a Scenario, choice: &Choice) -> Result<&'a Robot, String> {
    let mut robots = scenario.robot.iter();
    match &choice.robot {
        None => Ok(&scenario.robot[0]),
        Some(name) => robots.find(|robot| robot.name == *name).ok_or_else(|| {
            let known: Vec<&str> = scenario
                .robot
                .iter()
                .map(|robot| robot.name.as_str())
                .collect();
            format!(
                "--robot: must be a robot of the scenario, got {name}\n  hint: there are: {}",
                known.join(", ")
            )
        }),
    }
}

/// The scenario with one robot alone, without a task, that does as the bag says, for as long as it lasts.
pub fn driven(scenario: &Scenario, robot: &Robot, recorded: &Recorded, timeout: f64) -> Scenario {
    let mut scenario = scenario.clone();
    let mut robot = robot.clone();
    // Each value until the next, or until it is too old to count; before the first there is none.
    let mut stairs = vec![(0.0, [0.0; 3])];
    for (k, &(t, command)) in recorded.commands.iter().enumerate() {
        match stairs.last_mut() {
            Some(last) if last.0 >= t => last.1 = command,
            _ => stairs.push((t, command)),
        }
        let next = recorded
            .commands
            .get(k + 1)
            .map_or(f64::INFINITY, |(t, _)| *t);
        if t + timeout < next {
            stairs.push((t + timeout, [0.0; 3]));
        }
    }
    let at: Vec<f64> = stairs.iter().map(|(t, _)| *t).collect();
    let channel = |(axis, to): (usize, &str)| Channel {
        to: to.to_owned(),
        signal: Signal::Stairs {
            at: at.clone(),
            values: stairs.iter().map(|(_, command)| command[axis]).collect(),
        },
    };
    let channels = ["forward", "left", "yaw_rate"];
    // A command counts from its own time on, while the wheels' loop stays as it was.
    let before = robot.controller.as_ref().map(Controller::period);
    robot.servo.period = robot.servo.period.or(before).or(Some(0.01));
    robot.controller = Some(Controller::Signals {
        period: scenario.time.step,
        channel: channels.into_iter().enumerate().map(channel).collect(),
    });
    robot.standby.clear();
    robot.model.clear();
    robot.task = None;
    let last = |times: Option<&(f64, [f64; 3])>| times.map_or(0.0, |(t, _)| *t);
    let end = last(recorded.odometry.last()).max(last(recorded.commands.last()));
    let step = scenario.time.step;
    scenario.time.duration = ((end / step).ceil() * step).max(step);
    scenario.name = format!("{}-replay", scenario.name);
    scenario.robot = vec![robot];
    scenario.swap.clear();
    scenario.change.clear();
    scenario.statistics = None;
    scenario.batch = None;
    scenario
}

/// Poses as seen from the first.
fn from_first(poses: &[Stamped]) -> Vec<Stamped> {
    let Some(&(_, first)) = poses.first() else {
        return Vec::new();
    };
    let (sin, cos) = Scalar::sin_cos(first[2]);
    let seen = poses.iter().map(|&(t, pose)| {
        let (x, y) = (pose[0] - first[0], pose[1] - first[1]);
        (
            t,
            [
                cos * x + sin * y,
                cos * y - sin * x,
                wrap_angle(pose[2] - first[2]),
            ],
        )
    });
    seen.collect()
}

/// A pose between two others, on the straight line that joins them.
fn between(poses: &[Stamped], t: f64) -> [f64; 3] {
    let after = poses.partition_point(|(time, _)| *time < t);
    let (Some(&(t1, b)), Some(&(t0, a))) = (poses.get(after), poses.get(after.saturating_sub(1)))
    else {
        return poses.last().map_or([0.0; 3], |(_, pose)| *pose);
    };
    let share = if t1 > t0 { (t - t0) / (t1 - t0) } else { 0.0 };
    [
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * wrap_angle(b[2] - a[2]),
    ]
}

/// Recorded and simulated poses side by side, at the times of the recorded ones, each as seen from where it
/// began; and what is to be said of them.
///
/// # Errors
/// One of them is empty.
pub fn compare(
    recorded: &[Stamped],
    simulated: &[Stamped],
) -> Result<(Comparison, Vec<[f64; 7]>), String> {
    let (Some(&(begin, _)), Some(&(end, _))) = (recorded.first(), simulated.last()) else {
        return Err("must have poses to compare, got none".to_owned());
    };
    // Both begin at the first recorded pose, which may be later than the first command.
    let mut anchored = vec![(begin, between(simulated, begin))];
    anchored.extend(simulated.iter().filter(|(t, _)| *t > begin));
    let (recorded, simulated) = (from_first(recorded), from_first(&anchored));
    let mut rows = Vec::new();
    for &(t, a) in recorded.iter().filter(|(t, _)| *t <= end) {
        let b = between(&simulated, t);
        rows.push([t, a[0], a[1], a[2], b[0], b[1], b[2]]);
    }
    let apart: Vec<(f64, f64, f64)> = rows
        .iter()
        .map(|r| {
            (
                r[0],
                hypot(r[4] - r[1], r[5] - r[2]),
                wrap_angle(r[6] - r[3]),
            )
        })
        .collect();
    let mean = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
        (apart.iter().map(|one| of(one) * of(one)).sum::<f64>() / apart.len() as f64).sqrt()
    };
    let mut most = (0.0, 0.0);
    for &(t, distance, _) in &apart {
        if distance > most.1 {
            most = (t, distance);
        }
    }
    let last = apart.last().copied().unwrap_or_default();
    let ways = rows
        .windows(2)
        .map(|pair| hypot(pair[1][1] - pair[0][1], pair[1][2] - pair[0][2]));
    Ok((
        Comparison {
            duration: last.0 - begin,
            poses: rows.len(),
            distance: ways.sum(),
            position_rms: mean(&|one| one.1),
            position_max: most.1,
            position_max_at: most.0,
            position_end: last.1,
            yaw_rms: mean(&|one| one.2),
            yaw_max: apart
                .iter()
                .fold(0.0, |most, one| f64::max(most, one.2.abs())),
            yaw_end: last.2,
        },
        rows,
    ))
}
