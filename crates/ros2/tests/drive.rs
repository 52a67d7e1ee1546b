//! The drives of ros2_control: what their files say, and that their formulas are those published.
// The platform's own functions are what ros2_control calls.
#![allow(clippy::disallowed_methods)]

use std::collections::VecDeque;
use std::path::Path;

use appell_ros2::drive::{Drive, read};
use appell_ros2::simulator::{Settings, Simulator};
use appell_sim::ros::message::{Message, Odometry};
use appell_sim::scenario::{self, Loaded};

const DIFFERENTIAL: &str = "
controller_manager:
  ros__parameters:
    update_rate: 100
    base:
      type: diff_drive_controller/DiffDriveController
base:
  ros__parameters:
    left_wheel_names: [left]
    right_wheel_names: [right]
    wheel_separation: 0.2
    wheel_separation_multiplier: 1.05
    wheel_radius: 0.04
    left_wheel_radius_multiplier: 0.99
    right_wheel_radius_multiplier: 1.01
    cmd_vel_timeout: 0.25
    velocity_rolling_window_size: 7
    linear.x.max_velocity: 0.5
    linear:
      x:
        max_acceleration: 1.0
        max_deceleration: -2.0
    angular:
      z:
        max_velocity: 1.5
        max_acceleration: .nan
        max_jerk: 20.0
";

const MECANUM: &str = "
/robot:
  base:
    ros__parameters:
      front_left_wheel_command_joint_name: fl
      front_right_wheel_command_joint_name: fr
      rear_right_wheel_command_joint_name: rr
      rear_left_wheel_command_joint_name: rl
      reference_timeout: 0.3
      kinematics:
        base_frame_offset: {x: 0.1, y: -0.05, theta: 0.3}
        wheels_radius: 0.05
        sum_of_robot_center_projection_on_X_Y_axis: 0.4
";

fn one(text: &str) -> Drive {
    read(text).expect("a drive").remove(0)
}

fn loaded(name: &str, overrides: &[(&str, &str)]) -> Loaded {
    let file = format!("{}/../../scenarios/{name}", env!("CARGO_MANIFEST_DIR"));
    let overrides: Vec<(String, String)> = overrides
        .iter()
        .map(|(p, v)| ((*p).to_owned(), (*v).to_owned()))
        .collect();
    scenario::load(Path::new(&file), &overrides).unwrap_or_else(|error| panic!("{error}"))
}

fn settings(drives: Vec<(String, Drive)>) -> Settings {
    Settings {
        rate: 100.0,
        publish_rate: 100.0,
        timeout: 0.5,
        drives,
        keeps_controllers: false,
    }
}

#[test]
fn known_answer_parameters_by_their_names() {
    let drive = one(DIFFERENTIAL);
    assert_eq!(
        (drive.name.as_str(), drive.timeout, drive.window),
        ("base", 0.25, 7)
    );
    assert_eq!(drive.wheels(), ["left", "right"]);
    let rates = drive.rates([0.2, 0.0, 1.0]);
    let (left, right) = ((0.2 - 0.105) / (0.04 * 0.99), (0.2 + 0.105) / (0.04 * 1.01));
    assert!(
        (rates[0] - left).abs() < 1e-12 && (rates[1] - right).abs() < 1e-12,
        "{rates:?}"
    );
    let mecanum = one(MECANUM);
    assert_eq!(
        (mecanum.name.as_str(), mecanum.timeout),
        ("/robot/base", 0.3)
    );
    assert_eq!(mecanum.wheels(), ["fl", "fr", "rr", "rl"]);
}

#[test]
fn closed_form_limits_hold() {
    let [linear, _, angular] = one(DIFFERENTIAL).limits;
    // Speeds up by 1 m/s², brakes by 2 m/s², ends at 0.5 m/s.
    assert_eq!(linear.hold(1.0, 0.0, 0.0, 0.1), 0.1);
    assert_eq!(linear.hold(0.0, 0.4, 0.4, 0.1), 0.4 - 0.2);
    assert_eq!(linear.hold(9.0, 0.45, 0.4, 0.1), 0.5);
    assert_eq!(linear.hold(-1.0, -0.2, -0.2, 0.1), -0.30000000000000004);
    // A jerk of 20 rad/s³ over 0.1 s is 0.2 rad/s more than the last change. It goes on so
    // even where it shall turn back, as in ros2_control; a change that only gets smaller is not held.
    assert!((angular.hold(1.4, 0.0, 0.0, 0.1) - 0.2).abs() < 1e-15);
    assert!((angular.hold(1.4, 0.2, 0.0, 0.1) - 0.6).abs() < 1e-15);
    assert!((angular.hold(0.0, 0.6, 0.2, 0.1) - 0.8).abs() < 1e-15);
    assert_eq!(angular.hold(0.7, 0.6, 0.2, 0.1), 0.7);
    // What has no limit, or one that is no number, is not held.
    let free =
        one(&DIFFERENTIAL.replace("max_acceleration: 1.0", "max_acceleration: .nan")).limits[0];
    assert_eq!(free.hold(0.4, 0.0, 0.0, 0.1), 0.4);
    let off = DIFFERENTIAL.replace(
        "max_deceleration",
        "has_acceleration_limits: false\n        max_deceleration",
    );
    assert_eq!(one(&off).limits[0].hold(0.4, 0.0, 0.0, 0.1), 0.4);
}

#[test]
fn closed_form_rates_and_way_of_mecanum_undo_each_other() {
    let drive = one(MECANUM);
    let gain = drive.gain();
    for twist in [
        [0.3, 0.0, 0.0],
        [0.0, 0.2, 0.0],
        [0.0, 0.0, 1.0],
        [0.3, -0.2, 0.7],
    ] {
        let rates = drive.rates(twist);
        for axis in 0..3 {
            let back: f64 = gain[axis].iter().zip(&rates).map(|(g, r)| g * r).sum();
            assert!(
                (back - twist[axis]).abs() < 1e-12,
                "{twist:?} {axis}: {back}"
            );
        }
    }
    // Without an offset a wheel rolls as the sum of its parts says.
    let plain = one(&MECANUM.replace("x: 0.1, y: -0.05, theta: 0.3", "x: 0, y: 0, theta: 0"));
    let rates = plain.rates([0.1, 0.2, 0.5]);
    let want = [-0.3, 0.5, 0.1, 0.1].map(|v: f64| v / 0.05);
    assert!(
        rates
            .iter()
            .zip(want)
            .all(|(got, want)| (got - want).abs() < 1e-12),
        "{rates:?}"
    );
}

#[test]
fn refusal_files_that_are_no_drive() {
    let cases = [
        ("a: [", ""),
        ("a: {ros__parameters: {b: 1}}", "got none"),
        (
            &DIFFERENTIAL.replace("wheel_radius: 0.04", "wheel_radius: 0.0"),
            "base.wheel_radius: must be > 0",
        ),
        (
            &DIFFERENTIAL.replace("wheel_radius: 0.04", "wheel_radius: .inf"),
            "base.wheel_radius: must be a finite",
        ),
        (
            &DIFFERENTIAL.replace("    wheel_separation: 0.2\n", ""),
            "base.wheel_separation: is missing",
        ),
        (
            &DIFFERENTIAL.replace("[right]", "[]"),
            "as many as on the left",
        ),
        (&DIFFERENTIAL.replace("[right]", "[1]"), "list of texts"),
        (
            &DIFFERENTIAL.replace("max_deceleration: -2.0", "max_deceleration: 3.0"),
            "below the acceleration",
        ),
        (
            &DIFFERENTIAL.replace("window_size: 7", "window_size: 0"),
            "whole number",
        ),
        (
            &MECANUM.replace("      rear_left_wheel_command_joint_name: rl\n", ""),
            "rear_left",
        ),
    ];
    for (text, words) in cases {
        let error = read(text).expect_err(words);
        assert!(error.contains(words), "{words}: {error}");
    }
    // Its wheels have to be the robot's.
    let drive = one(&DIFFERENTIAL.replace("[right]", "[rechts]"));
    let refused = Simulator::new(
        &loaded("ros.toml", &[]),
        &settings(vec![("bubble".into(), drive)]),
    );
    let error = refused.err().expect("refused");
    assert!(
        error.contains("rechts") && error.contains("left, right"),
        "{error}"
    );
}

/// Odometry as `diff_drive_controller` sums it, in its own words: from the wheels' angles.
struct Published {
    x: f64,
    y: f64,
    heading: f64,
    before: Option<[f64; 2]>,
    linear: VecDeque<f64>,
    angular: VecDeque<f64>,
}

impl Published {
    fn update(&mut self, angles: [f64; 2], dt: f64) {
        let way = [angles[0] * 0.04 * 0.99, angles[1] * 0.04 * 1.01];
        let Some(before) = self.before.replace(way) else {
            return;
        };
        let (l, r) = ((way[0] - before[0]) / dt, (way[1] - before[1]) / dt);
        let (linear, angular) = ((l + r) * 0.5, (r - l) / (0.2 * 1.05));
        if (angular * dt).abs() < 1e-6 {
            let direction = self.heading + angular * 0.5 * dt;
            self.x += linear * direction.cos() * dt;
            self.y += linear * direction.sin() * dt;
            self.heading += angular * dt;
        } else {
            let old = self.heading;
            let radius = linear / angular;
            self.heading += angular * dt;
            self.x += radius * (self.heading.sin() - old.sin());
            self.y += -radius * (self.heading.cos() - old.cos());
        }
        for (recent, now) in [(&mut self.linear, linear), (&mut self.angular, angular)] {
            recent.push_back(now);
            if recent.len() > 7 {
                recent.pop_front();
            }
        }
    }
}

fn mean(recent: &VecDeque<f64>) -> f64 {
    recent.iter().sum::<f64>() / recent.len() as f64
}

#[test]
fn peer_odometry_of_recorded_wheel_motion_is_that_of_ros2_control() {
    let drives = vec![("bubble".to_owned(), one(DIFFERENTIAL))];
    let mut simulator =
        Simulator::new(&loaded("ros.toml", &[]), &settings(drives)).expect("a simulation");
    let mut published = Published {
        x: 0.0,
        y: 0.0,
        heading: 0.0,
        before: None,
        linear: VecDeque::new(),
        angular: VecDeque::new(),
    };
    let mut worst: f64 = 0.0;
    let mut compared = 0;
    for tick in 0..2000_u32 {
        let t = f64::from(tick) * 0.01;
        // Straight on, curves, back, and on the spot.
        let twist = match tick / 400 {
            0 => [0.4, 0.0, 0.0],
            1 => [0.3, 0.0, (2.0 * t).sin()],
            2 => [-0.2, 0.0, 0.8],
            3 => [0.0, 0.0, -1.4],
            _ => [0.5, 0.0, 1e-7],
        };
        simulator.command(0, twist, None).expect("taken");
        let mut said = Vec::new();
        simulator.advance(&mut said).expect("goes on");
        let mut odometry: Option<Odometry> = None;
        for (_, message) in said {
            match message {
                Message::JointState(joints) => {
                    published.update([joints.position[0], joints.position[1]], 0.01);
                }
                Message::Odometry(one) if one.header.frame_id == "odom" => odometry = Some(*one),
                _ => {}
            }
        }
        let odometry = odometry.expect("every tick");
        if tick == 0 {
            continue;
        }
        let (p, q) = (odometry.pose.pose.position, odometry.pose.pose.orientation);
        let (z, w) = (0.5 * published.heading).sin_cos();
        for (got, want) in [
            (p.x, published.x),
            (p.y, published.y),
            (q.z, z),
            (q.w, w),
            (odometry.twist.twist.linear.x, mean(&published.linear)),
            (odometry.twist.twist.angular.z, mean(&published.angular)),
        ] {
            worst = worst.max((got - want).abs());
            compared += 1;
        }
    }
    assert!(worst < 1e-12, "{worst} over {compared} numbers");
    assert!(published.x.abs() + published.y.abs() > 0.5 && published.heading.abs() > 1.0);
}

/// Normalised error squared of the odometry that the node sends, over a thousand runs with noisy encoders.
#[test]
fn invariant_covariance_of_noisy_runs() {
    const TRIALS: u32 = 1000;
    let of = |trials: std::ops::Range<u32>| -> Vec<f64> { trials.map(noisy).collect() };
    let all = std::thread::scope(|scope| {
        let half = scope.spawn(|| of(0..TRIALS / 2));
        let other = of(TRIALS / 2..TRIALS);
        [half.join().expect("no panic"), other].concat()
    });
    // 95 % of sums of squares of unit normals: three of each run.
    let mean = all.iter().sum::<f64>() / f64::from(TRIALS);
    let bound = 1.96 * (2.0 * 3.0 / f64::from(TRIALS)).sqrt();
    assert!((mean - 3.0).abs() < bound, "{mean} must be in 3 ± {bound}");
    // And one run in twenty is beyond what one in twenty is beyond.
    let beyond = all
        .iter()
        .filter(|squared| **squared > 7.814_727_903)
        .count() as f64;
    let bound = 1.96 * (0.05 * 0.95 / f64::from(TRIALS)).sqrt();
    let share = beyond / f64::from(TRIALS);
    assert!(
        (share - 0.05).abs() < bound,
        "{share} must be in 0.05 ± {bound}"
    );
}

/// eᵀ P⁻¹ e at the end of a run with noise of this seed.
fn noisy(seed: u32) -> f64 {
    let seed = seed.to_string();
    let sensor = "[{ kind = \"encoder\", period = 0.02, angle_std = 0.02 }]";
    let overrides = [("seed", seed.as_str()), ("robot.bubble.sensor", sensor)];
    let plain = DIFFERENTIAL
        .replace(
            "wheel_separation_multiplier: 1.05",
            "wheel_separation_multiplier: 1.0",
        )
        .replace("multiplier: 0.99", "multiplier: 1.0")
        .replace("multiplier: 1.01", "multiplier: 1.0");
    let mut at = settings(vec![("bubble".to_owned(), one(&plain))]);
    (at.rate, at.publish_rate) = (50.0, 50.0);
    let mut simulator = Simulator::new(&loaded("ros.toml", &overrides), &at).expect("a simulation");
    let (mut belief, mut truth) = (None, None);
    for tick in 0..200_u32 {
        let turn = if tick / 40 % 2 == 0 { 1.2 } else { -0.9 };
        simulator.command(0, [0.4, 0.0, turn], None).expect("taken");
        let mut said = Vec::new();
        simulator.advance(&mut said).expect("goes on");
        for (_, message) in said {
            if let Message::Odometry(one) = message {
                match one.header.frame_id.as_str() {
                    "odom" => belief = Some(one),
                    _ => truth = Some(one),
                }
            }
        }
    }
    let (belief, truth) = (belief.expect("said"), truth.expect("said"));
    let yaw = |o: &Odometry| 2.0 * o.pose.pose.orientation.z.atan2(o.pose.pose.orientation.w);
    let e = [
        belief.pose.pose.position.x - (truth.pose.pose.position.x - 2.0),
        belief.pose.pose.position.y - (truth.pose.pose.position.y - 1.8),
        yaw(&belief) - yaw(&truth),
    ];
    let c = belief.pose.covariance;
    let p = [0, 1, 5].map(|i: usize| [0, 1, 5].map(|j: usize| c[i][j]));
    squared(e, p)
}

/// eᵀ P⁻¹ e.
fn squared(e: [f64; 3], p: [[f64; 3]; 3]) -> f64 {
    let minor = |i: usize, j: usize| {
        let r: Vec<usize> = (0..3).filter(|k| *k != i).collect();
        let c: Vec<usize> = (0..3).filter(|k| *k != j).collect();
        let sign = if (i + j).is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * (p[r[0]][c[0]] * p[r[1]][c[1]] - p[r[0]][c[1]] * p[r[1]][c[0]])
    };
    let determinant: f64 = (0..3).map(|j| p[0][j] * minor(0, j)).sum();
    let mut sum = 0.0;
    for i in 0..3 {
        for j in 0..3 {
            sum += e[i] * minor(j, i) / determinant * e[j];
        }
    }
    sum
}

#[test]
fn invariant_commands_that_are_none_do_not_count() {
    let mut simulator =
        Simulator::new(&loaded("ros.toml", &[]), &settings(Vec::new())).expect("a simulation");
    let mut said = Vec::new();
    simulator.command(0, [0.2, 0.0, 1.0], None).expect("taken");
    for wrong in [
        [f64::NAN, 0.0, 0.0],
        [0.0, f64::INFINITY, 0.0],
        [0.0, 0.0, -f64::NAN],
    ] {
        assert!(simulator.command(0, wrong, None).is_err());
    }
    simulator.advance(&mut said).expect("goes on");
    assert_eq!(simulator.held(0), [0.2, 0.0, 1.0]);
    // Beyond all sense it is clamped.
    simulator
        .command(0, [1e300, 0.0, -1e300], None)
        .expect("taken");
    simulator.advance(&mut said).expect("goes on");
    assert_eq!(simulator.held(0), [100.0, 0.0, -1000.0]);
    // The last command holds for half a second, and no longer.
    simulator.command(0, [0.1, 0.0, 0.0], None).expect("taken");
    for tick in 0..100 {
        simulator.advance(&mut said).expect("goes on");
        let want = if tick <= 50 { 0.1 } else { 0.0 };
        assert_eq!(simulator.held(0)[0], want, "{tick}");
    }
    // A stamp that is too old is refused; one to come, or none, is now.
    assert!(simulator.command(0, [0.1, 0.0, 0.0], Some(0.2)).is_err());
    assert!(simulator.command(0, [0.1, 0.0, 0.0], Some(1e9)).is_ok());
    assert!(simulator.turn(0, &["left".into()], &[f64::NAN]).is_err());
    assert!(simulator.turn(0, &["slider".into()], &[1.0]).is_err());
    assert!(simulator.turn(0, &["left".into()], &[]).is_err());
}

/// The blog's numbers, from commands of wheels and of a twist alike.
#[test]
fn closed_form_the_circle_of_the_blog() {
    for by_wheels in [false, true] {
        let mut simulator =
            Simulator::new(&loaded("ros.toml", &[]), &settings(Vec::new())).expect("a simulation");
        let names = ["left".to_owned(), "right".to_owned()];
        let mut last = Vec::new();
        for _ in 0..629 {
            match by_wheels {
                false => simulator.command(0, [0.2, 0.0, 1.0], None).expect("taken"),
                true => simulator.turn(0, &names, &[2.5, 7.5]).expect("taken"),
            }
            last.clear();
            simulator.advance(&mut last).expect("goes on");
        }
        let mut seen = 0;
        for (_, message) in &last {
            match message {
                Message::JointState(joints) => {
                    assert!(
                        (joints.velocity[0] - 2.5).abs() < 1e-12,
                        "{:?}",
                        joints.velocity
                    );
                    assert!(
                        (joints.velocity[1] - 7.5).abs() < 1e-12,
                        "{:?}",
                        joints.velocity
                    );
                    seen += 1;
                }
                Message::Odometry(one) if one.header.frame_id == "world" => {
                    let p = one.pose.pose.position;
                    let radius = ((p.x - 2.0) * (p.x - 2.0) + (p.y - 2.0) * (p.y - 2.0)).sqrt();
                    assert!((radius - 0.2).abs() < 1e-9, "{p:?}");
                    seen += 1;
                }
                _ => {}
            }
        }
        assert_eq!(seen, 2);
        // Put elsewhere it is there, at rest, and time goes on; begun anew it is where it was.
        simulator.place(0, [1.0, 1.0, 0.5]).expect("placed");
        let mut said = Vec::new();
        simulator.advance(&mut said).expect("goes on");
        assert!((simulator.now() - 6.3).abs() < 1e-9, "{}", simulator.now());
        let truth = said.iter().find_map(|(_, message)| match message {
            Message::Odometry(one) if one.header.frame_id == "world" => Some(one),
            _ => None,
        });
        let truth = truth.expect("said");
        assert_eq!(
            (truth.pose.pose.position.x, truth.header.stamp.seconds()),
            (1.0, 6.29)
        );
        simulator.reset().expect("begun anew");
        assert_eq!(simulator.now(), 0.0);
    }
}
