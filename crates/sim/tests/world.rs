//! Worlds repeat: runs, robots side by side, saved states; and what they do is physics.

use std::path::{Path, PathBuf};

use appell_sim::batch::Crew;
use appell_sim::crowd::{Crowd, is_crowd};
use appell_sim::record::{Memory, Recording};
use appell_sim::run::{Outcome, Run, Summary};
use appell_sim::scenario::{self, Loaded};

fn scenario_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../scenarios")
        .join(name)
}

fn load(name: &str, set: &[(&str, &str)]) -> Loaded {
    let overrides: Vec<(String, String)> = set
        .iter()
        .map(|(a, b)| ((*a).into(), (*b).into()))
        .collect();
    scenario::load(&scenario_file(name), &overrides).unwrap_or_else(|e| panic!("{e}"))
}

fn execute(loaded: &Loaded) -> (Recording, Summary) {
    let mut memory = Memory::new();
    if is_crowd(&loaded.scenario) {
        let mut crowd = Crowd::new(loaded, Crew::default()).unwrap_or_else(|e| panic!("{e}"));
        let summary = crowd.execute(&mut memory, &mut |_| {}).expect("runs");
        return (memory.into_recording(), summary);
    }
    let mut run = Run::new(loaded, 0).unwrap_or_else(|e| panic!("{e}"));
    let summary = run.execute(&mut memory, &mut |_| {}).expect("runs");
    (memory.into_recording(), summary)
}

fn bits(recording: &Recording) -> Vec<Vec<u64>> {
    recording
        .columns
        .iter()
        .map(|c| c.iter().map(|v| v.to_bits()).collect())
        .collect()
}

#[test]
fn invariant_a_run_repeats_to_the_bit() {
    let loaded = load("noisy.toml", &[]);
    let (a, b) = (execute(&loaded).0, execute(&loaded).0);
    assert_eq!(bits(&a), bits(&b));
    let other = load("noisy.toml", &[("seed", "99")]);
    assert_ne!(bits(&a), bits(&execute(&other).0), "the seed matters");
}

#[test]
fn invariant_a_second_robot_changes_no_bit_of_the_first() {
    let loaded = load("two-robots.toml", &[]);
    assert!(loaded.scenario.robot.len() >= 2);
    let mut alone = loaded.clone();
    alone.scenario.robot.truncate(1);
    let name = &loaded.scenario.robot[0].name;
    let (both, _) = execute(&loaded);
    let (one, _) = execute(&alone);
    let mut compared = 0;
    for (k, signal) in one.header.signals.iter().enumerate() {
        if !signal.path.starts_with(&format!("robot.{name}.")) {
            continue;
        }
        let other = both.column(&signal.path).expect("the same signal");
        // The run with both may last longer; the first rows must be the same.
        for (row, value) in one.columns[k].iter().enumerate().take(one.times.len() - 1) {
            assert_eq!(
                value.to_bits(),
                other[row].to_bits(),
                "{} row {row}",
                signal.path
            );
            compared += 1;
        }
    }
    assert!(compared > 1000);
}

/// Ticks between two saves.
const APART: u64 = 4;
/// Scenarios whose worlds are saved, with what is changed in them.
const SAVED: [(&str, &[(&str, &str)]); 5] = [
    ("slalom.toml", &[("robot.tri.level", "slip")]),
    ("noisy.toml", &[]),
    ("tricycle.toml", &[]),
    (
        "house.toml",
        &[("time.step", "0.001"), ("record.period", "0.01")],
    ),
    ("coast.toml", &[("time.integrator", "\"adaptive\"")]),
];

fn step(world: &mut appell_sim::world::World, recorder: &mut Memory, ticks: u64) {
    for _ in 0..ticks {
        world.step(recorder).expect("steps");
    }
}

fn recorder(run: &Run) -> Memory {
    let mut memory = Memory::new();
    appell_sim::record::Recorder::begin(&mut memory, &run.header).expect("opens");
    memory
}

/// A world saved at 1000 ticks: each state, restored in another process, gives the next one bit for
/// bit, and so by induction the whole run.
#[test]
fn invariant_saved_worlds_go_on_to_the_bit() {
    for (number, (name, set)) in SAVED.into_iter().enumerate() {
        let loaded = load(name, set);
        let mut run = Run::new(&loaded, 0).expect("valid");
        let mut memory = recorder(&run);
        let mut states = Vec::new();
        for _ in 0..=1000 {
            states.push(run.world.save());
            step(&mut run.world, &mut memory, APART);
        }
        let file =
            std::env::temp_dir().join(format!("appell-states-{number}-{}", std::process::id()));
        std::fs::write(&file, serde_json::to_vec(&states).expect("plain data")).expect("written");
        let child = std::process::Command::new(std::env::current_exe().expect("this test"))
            .args(["--exact", "restored_in_another_process", "--nocapture"])
            .env("APPELL_STATES", &file)
            .env("APPELL_SCENARIO", number.to_string())
            .output()
            .expect("runs");
        let text = String::from_utf8_lossy(&child.stdout).into_owned()
            + &String::from_utf8_lossy(&child.stderr);
        std::fs::remove_file(&file).expect("removed");
        assert!(
            child.status.success() && text.contains("1000 states went on"),
            "{name}: {text}"
        );
        let mut other = Run::new(&load("slalom.toml", &[]), 0).expect("valid").world;
        assert!(
            other.restore(&states[0]).is_err(),
            "a foreign state is refused"
        );
    }
}

/// The other process of the test above; by itself it has nothing to restore.
#[test]
fn restored_in_another_process() {
    let (Ok(file), Ok(number)) = (
        std::env::var("APPELL_STATES"),
        std::env::var("APPELL_SCENARIO"),
    ) else {
        return;
    };
    let states: Vec<Vec<u8>> =
        serde_json::from_slice(&std::fs::read(file).expect("read")).expect("states");
    let (name, set) = SAVED[number.parse::<usize>().expect("a number")];
    let loaded = load(name, set);
    for pair in states.windows(2) {
        let mut run = Run::new(&loaded, 0).expect("valid");
        let mut memory = recorder(&run);
        run.world.restore(&pair[0]).expect("fits");
        step(&mut run.world, &mut memory, APART);
        assert!(
            run.world.save() == pair[1],
            "from tick {}",
            run.world.tick()
        );
    }
    println!("{} states went on", states.len() - 1);
}

/// Every shipped scenario does what it says at every level that it can run at.
#[test]
fn invariant_shipped_scenarios_pass() {
    let mut count = 0;
    for entry in std::fs::read_dir(scenario_file(""))
        .expect("scenarios")
        .flatten()
    {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !name.ends_with(".toml") {
            continue;
        }
        let loaded = load(&name, &[]);
        let tasks = loaded
            .scenario
            .robot
            .iter()
            .filter(|r| r.task.is_some())
            .count();
        let mut levels = vec![vec![]];
        if tasks > 0 {
            levels[0].push(("robot.*.level".to_owned(), "\"kinematic\"".to_owned()));
            for drive in appell_sim::compare::drives(&loaded.scenario) {
                levels.push(vec![
                    ("robot.*.level".to_owned(), "\"rolling\"".to_owned()),
                    ("robot.*.drive".to_owned(), format!("\"{drive}\"")),
                ]);
            }
            // A trailer is not known there, and wheels with noise on their commands are for rates.
            let robots = &loaded.scenario.robot;
            let towing = |r: &scenario::Robot| {
                r.platform
                    .as_ref()
                    .is_some_and(|file| file.trailer.is_some())
            };
            if !robots.iter().any(towing) {
                levels.push(vec![("robot.*.level".to_owned(), "\"slip\"".to_owned())]);
            }
        }
        for set in levels {
            let loaded = scenario::load(&scenario_file(&name), &set);
            let (_, summary) = execute(&loaded.unwrap_or_else(|e| panic!("{e}")));
            let wanted = if tasks == 0 {
                Outcome::Stopped
            } else {
                Outcome::Passed
            };
            assert_eq!(
                summary.verdict, wanted,
                "{name} {set:?}: {}",
                summary.reason
            );
            assert!(summary.error.is_none(), "{name}: {:?}", summary.error);
            count += 1;
        }
    }
    assert!(count >= 24, "{count} runs");
}

/// The Husky turns on the spot as the book's closed form says: its track is 1 + (a/b)² times as wide.
#[test]
fn closed_form_effective_track_of_the_husky() {
    let center = "robot.husky.platform.body.center_of_mass";
    for friction in ["0.3", "0.9"] {
        let changes = [(center, "[0.0, 0.0, 0.2]"), ("terrain.friction", friction)];
        let (recording, _) = execute(&load("spot.toml", &changes));
        let last = |signal: &str| {
            let column = recording.column(&format!("robot.husky.{signal}"));
            *column.expect("recorded").last().expect("rows")
        };
        let ideal = 0.1651 * last("wheel.front-right.spin_rate") / 0.2854;
        let wider = ideal / last("twist.yaw_rate");
        let expected = 1.0 + (0.256 * 0.256) / (0.2854 * 0.2854);
        assert!((wider - expected).abs() < 1e-3, "{wider} {expected}");
    }
}

#[test]
fn invariant_a_parked_robot_keeps_its_pose_to_the_bit() {
    let (recording, _) = execute(&load("parked.toml", &[]));
    for axis in ["x", "y", "yaw"] {
        let signal = recording
            .header
            .signals
            .iter()
            .find(|s| s.path.ends_with(&format!("pose.{axis}")))
            .expect("a pose");
        let column = recording.column(&signal.path).expect("recorded");
        assert!(
            column.iter().all(|v| v.to_bits() == column[0].to_bits()),
            "{}",
            signal.path
        );
    }
}

/// The ledger of every shipped scenario with the integrator that it asks for, beside the adaptive one.
#[test]
fn invariant_energy_ledger_of_the_slalom() {
    for (integrator, tolerance) in [("auto", 1e-6), ("adaptive", 1e-10)] {
        let set = [("time.integrator", integrator), ("time.tolerance", "1e-11")];
        let (_, summary) = execute(&load("slalom.toml", &set));
        let metric = |name: &str| {
            summary.robots[0]
                .metrics
                .iter()
                .find(|m| m.name == name)
                .expect("a metric")
                .value
        };
        let (residual, supplied) = (metric("energy ledger residual"), metric("energy supplied"));
        assert!(
            residual.abs() <= tolerance * supplied,
            "{integrator}: {residual:e} of {supplied} J"
        );
    }
}

#[test]
fn closed_form_blog_circle() {
    // Twist (0.2 m/s, 1 rad/s) on a track of 0.2 m and wheels of 0.04 m: 2.5 and 7.5 rad/s.
    let (recording, _) = execute(&load("circle.toml", &[("robot.*.level", "\"kinematic\"")]));
    let last = |end: &str| {
        let signal = recording
            .header
            .signals
            .iter()
            .find(|s| s.path.ends_with(end))
            .expect("a signal");
        *recording
            .column(&signal.path)
            .expect("recorded")
            .last()
            .expect("rows")
    };
    assert!((last("wheel.left.spin_rate") - 2.5).abs() < 1e-12);
    assert!((last("wheel.right.spin_rate") - 7.5).abs() < 1e-12);
}

/// A servo that saturates lets its integral go again: a jump of the command is reached in the end.
#[test]
fn invariant_servo_does_not_wind_up() {
    let set = [
        ("robot.*.servo.period", "0.066"),
        (
            "robot.*.controller.channel.forward.signal",
            "{ kind = \"constant\", value = 0.2 }",
        ),
        (
            "robot.*.controller.channel.yaw_rate.signal",
            "{ kind = \"constant\", value = 1.0 }",
        ),
    ];
    let (recording, _) = execute(&load("circle.toml", &set));
    let end = |end: &str| {
        let signal = recording
            .header
            .signals
            .iter()
            .find(|s| s.path.ends_with(end))
            .expect("a signal");
        *recording
            .column(&signal.path)
            .expect("recorded")
            .last()
            .expect("rows")
    };
    // The integral removes the error; a percent is left after the time of the scenario.
    assert!(
        (end("twist.forward") - 0.2).abs() < 2e-3,
        "{}",
        end("twist.forward")
    );
    assert!(
        (end("twist.yaw_rate") - 1.0).abs() < 1e-2,
        "{}",
        end("twist.yaw_rate")
    );
}

/// The tables of the mecanum note (figures 16 and 17, recomputed to 15 digits): mean and standard
/// deviation of wheel rates, twist and pose, ideal less real and ideal less restored.
#[test]
fn known_answer_house_tables() {
    const REAL: [[f64; 2]; 10] = [
        [-0.001_092_581_255_443_44, 0.004_806_478_491_954_947],
        [-0.002_833_902_606_545_517, 0.005_013_373_672_570_987],
        [-0.002_645_545_757_535_575, 0.004_945_741_678_452_779],
        [-0.004_218_574_653_487_931, 0.005_056_261_560_229_572],
        [-0.000_269_765_106_825_312_2, 0.000_257_997_148_040_654_6],
        [8.566_363_042_885_195e-5, 0.000_296_207_971_044_274],
        [1.402_437_126_247_404_1e-5, 0.000_865_798_496_574_000_4],
        [-0.002_673_387_652_941_951_5, 0.001_597_506_899_413_506_6],
        [0.000_887_652_910_537_159_7, 0.000_466_375_461_934_461_43],
        [0.000_271_017_215_892_020_65, 0.000_185_236_516_383_894_7],
    ];
    const RESTORED: [[f64; 2]; 10] = [
        [-3.974_620_354_072_348e-6, 0.005_189_552_879_916_816],
        [-3.439_976_978_213_072_6e-5, 0.005_386_528_274_095_631],
        [-2.555_136_326_964_492_5e-5, 0.005_275_780_370_467_808],
        [-3.113_502_792_823_995e-5, 0.005_394_870_136_118_127],
        [-2.376_519_533_351_503e-6, 0.000_272_330_806_148_340_6],
        [1.314_245_098_319_314_7e-6, 0.000_319_751_587_053_575_4],
        [2.070_123_730_786_079_4e-6, 0.000_929_509_125_726_311_8],
        [-5.347_072_239_418_385e-5, 2.153_368_908_751_211_4e-5],
        [1.686_828_077_168_749e-5, 2.104_174_805_802_577_2e-5],
        [2.390_872_933_877_646e-6, 6.361_469_236_024_894e-5],
    ];
    let mut run = Run::new(&load("house.toml", &[]), 0).expect("valid");
    let summary = run.execute(&mut Memory::new(), &mut |_| {}).expect("runs");
    for (table, expected) in summary.statistics.iter().zip([REAL, RESTORED]) {
        assert_eq!(table.samples, 401);
        for (row, [mean, std]) in table.rows.iter().zip(expected) {
            // Sums of 401 rounded terms of up to a meter.
            assert!(
                (row.mean.expect("a number") - mean).abs() < 1e-12,
                "{row:?}"
            );
            assert!((row.std.expect("a number") - std).abs() < 1e-12, "{row:?}");
        }
    }
    // The note's ratios, as printed.
    let ratios = summary.statistics[2].rows.iter();
    let printed = [
        [49.997_223, 74.186_401],
        [52.622_607, 22.164_293],
        [113.354_922, 2.911_851],
    ];
    for (row, [mean, std]) in ratios.zip(printed) {
        assert!((row.mean.expect("a number") - mean).abs() < 5e-7, "{row:?}");
        assert!((row.std.expect("a number") - std).abs() < 5e-7, "{row:?}");
    }
}

/// A car under a constant twist drives a circle of radius v / ω, whatever its level of model, once
/// its wheels have turned; and a steering motor keeps its limit of rate.
#[test]
fn invariant_steered_robots_drive_the_circle() {
    for level in ["kinematic", "rolling"] {
        for file in ["car-tenth", "tricycle-agv"] {
            let path = |field: &str| format!("robot.r.{field}");
            let text = format!(
                "schema = 1\nname = \"circle\"\n[time]\nduration = 20.0\n\
                 [arena]\nsize = [10.0, 6.0]\n[[arena.beacon]]\nname = \"b\"\nposition = [0.0, 0.0]\n\
                 [[robot]]\nname = \"r\"\nfile = \"../robots/{file}.toml\"\nlevel = \"{level}\"\n\
                 pose = [5.0, 2.0, 0.0]\n[robot.controller]\nkind = \"signals\"\n\
                 [[robot.controller.channel]]\nto = \"forward\"\n\
                 signal = {{ kind = \"constant\", value = 0.3 }}\n\
                 [[robot.controller.channel]]\nto = \"yaw_rate\"\n\
                 signal = {{ kind = \"constant\", value = 0.25 }}\n"
            );
            let loaded = scenario::load_text(&text, &scenario_file("circle"), &[]);
            let loaded = loaded.unwrap_or_else(|e| panic!("{e}"));
            let mut run = Run::new(&loaded, 0).expect("valid");
            let mut memory = recorder(&run);
            while run.world.step(&mut memory).expect("steps") {}
            let recording = memory.into_recording();
            let column = |signal: &str| recording.column(&path(signal)).expect("recorded");
            let (forward, turn) = (column("twist.forward"), column("twist.yaw_rate"));
            let last = forward.len() - 1;
            // The tracking error of wheel-rate loops with losses, at most a hundredth.
            let radius = forward[last] / turn[last];
            assert!(
                (radius / 1.2 - 1.0).abs() < 0.01,
                "{file} {level}: {radius}"
            );
            let (wheel, limit) = match file {
                "car-tenth" => ("front-left", 6.0),
                _ => ("front", 3.0),
            };
            let rates = column(&format!("wheel.{wheel}.steering_rate"));
            let fastest = rates.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            // At level `rolling` a motor's loop runs over by a little.
            assert!(fastest <= 1.1 * limit, "{file} {level}: {fastest}");
        }
    }
}

/// The note of motion by twist: its three regimes, and the point about which the robot turns.
#[test]
fn known_answer_rotation_center_and_regimes() {
    let (recording, _) = execute(&load("motion.toml", &[]));
    let column = |signal: &str| {
        let path = format!("robot.bubble.sensor.motion.{signal}");
        recording.column(&path).expect("recorded")
    };
    let row = |t: f64| recording.times.partition_point(|&at| at < t - 1e-9);
    let (regime, radius) = (column("regime"), column("radius"));
    // 5 s at 0.2 m/s from (0.5, 0.8) to (1.5, 0.8), then about (1.5, 0.8 + 0.2/0.4).
    for (t, kind, expected) in [
        (0.5, 0.0, 0.0),
        (3.0, 1.0, 5.0),
        (8.0, 2.0, 0.5),
        (14.0, 3.0, 0.0),
        (18.0, 2.0, -0.8),
        (23.0, 0.0, -0.8),
    ] {
        let k = row(t);
        assert_eq!(regime[k], kind, "{t}");
        assert!((radius[k] - expected).abs() < 1e-9, "{t}: {}", radius[k]);
    }
    let k = row(8.0);
    let (x, y) = (column("center.x")[k], column("center.y")[k]);
    assert!((x - 1.5).abs() < 1e-9 && (y - 1.3).abs() < 1e-9, "{x} {y}");
}

/// Parts of an odometry's error add up to it, and those whose cause is taken away are nothing.
#[test]
fn invariant_causes_of_odometry_errors() {
    let off = [
        ("robot.bubble.sensor.arc.radius_scale", "1.0"),
        ("robot.bubble.sensor.arc.track_scale", "1.0"),
        ("robot.bubble.sensor.euler.resolution", "0"),
    ];
    for set in [&off[..0], &off[..]] {
        let (recording, _) = execute(&load("motion.toml", set));
        let column = |signal: String| {
            let path = format!("robot.bubble.{signal}");
            recording.column(&path).expect("recorded").to_vec()
        };
        for name in ["arc", "euler"] {
            let part =
                |cause: &str, axis: &str| column(format!("sensor.{name}.error.{cause}.{axis}"));
            for axis in ["x", "y", "yaw"] {
                let parts = ["slip", "method", "geometry", "encoder"].map(|c| part(c, axis));
                let (believed, truth) = (
                    column(format!("sensor.{name}.{axis}")),
                    column(format!("pose.{axis}")),
                );
                // Read when the odometry is due, every tenth row.
                for k in (0..recording.times.len()).step_by(10) {
                    let sum: f64 = parts.iter().map(|part| part[k]).sum();
                    assert!(
                        (sum - (believed[k] - truth[k])).abs() < 1e-12,
                        "{name} {axis} {k}"
                    );
                }
            }
            let last = |cause: &str| *part(cause, "distance").last().expect("rows");
            // Wheels that roll along arcs tell all, as the commands change between periods.
            assert!(last("slip") < 1e-9, "{name}: {}", last("slip"));
            assert_eq!(last("method") == 0.0, name == "arc");
            assert_eq!(last("geometry") == 0.0, name == "arc" && !set.is_empty());
            assert_eq!(last("encoder") == 0.0, name == "euler" && !set.is_empty());
        }
    }
}

/// The torques that a recorded motion demands are those that drove it: a steered wheel, and a cart
/// that swings behind.
#[test]
fn invariant_inverse_of_a_recording_gives_its_torques() {
    use appell_sim::{build, inverse};
    for (file, robot) in [("tricycle.toml", "agv"), ("trailer.toml", "tug")] {
        let loaded = load(file, &[]);
        let (recording, _) = execute(&loaded);
        let column = |signal: &str| {
            let path = format!("robot.{robot}.{signal}");
            recording.column(&path).expect("recorded")
        };
        let times = &recording.times;
        let [x, y, yaw] = ["pose.x", "pose.y", "pose.yaw"].map(column);
        let motions = inverse::sampled(times, x, y, yaw).expect("rows");
        let platform = loaded.scenario.robot[0]
            .platform
            .as_ref()
            .expect("a platform");
        let platform =
            build::platform(platform, build::DriveModel::AsBuilt, 9.81).expect("checked");
        let ground = build::ground(&loaded.scenario.terrain);
        let demanded = inverse::demanded(&platform, ground, None, &motions);
        for signal in [
            "wheel.front.torque",
            "wheel.front.force.lateral",
            "wheel.front.steering_angle",
        ] {
            let found = demanded
                .columns
                .iter()
                .find(|(known, _)| known.path == signal);
            let (found, recorded) = (&found.expect("a column").1, column(signal));
            // Not the start and the end, where the splines of the poses have the kink of rest.
            let inside = times.iter().position(|&t| t > 1.0).expect("rows")..times.len() - 100;
            let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
            // Commands step every 10 ms and the motors' torques with them, of which a row shows one
            // moment: means over 0.2 s have it out.
            let mean =
                |values: &[f64], k: usize| values[k - 10..=k + 10].iter().sum::<f64>() / 21.0;
            let apart = square(&mut inside.clone().map(|k| mean(found, k) - mean(recorded, k)));
            let size = square(&mut inside.clone().map(|k| mean(recorded, k)));
            let share = (apart / size).sqrt();
            assert!(share < 0.03, "{file} {signal}: {share}");
        }
    }
}

/// An inertial unit on a circle feels the pull to its center, on a slope that of gravity, and noise as dense as it
/// is told.
#[test]
fn closed_form_inertial_unit() {
    let unit = |noise: &str| format!("[{{ kind = \"imu\", period = 0.01{noise} }}]");
    let column = |recording: &Recording, robot: &str, what: &str| {
        let path = format!("robot.{robot}.sensor.imu.{what}");
        recording.column(&path).expect("recorded").to_vec()
    };
    // As motion.toml drives: 0.2 m/s about a point 0.5 m to the left at 8 s.
    let (recording, _) = execute(&load("motion.toml", &[("robot.bubble.sensor", &unit(""))]));
    let k = recording.times.partition_point(|&at| at < 8.0 - 1e-9);
    for (what, expected) in [
        ("yaw_rate", 0.4),
        ("forward", 0.0),
        ("left", 0.2 * 0.4),
        ("up", 9.81),
    ] {
        let got = column(&recording, "bubble", what)[k];
        assert!((got - expected).abs() < 1e-9, "{what}: {got}");
    }
    // Parked on 10°, its nose uphill: what it feels points up, ahead and above.
    let noise = ", gyro_noise_density = 0.002, accel_noise_density = 0.03";
    let (recording, _) = execute(&load(
        "parked.toml",
        &[
            ("robot.cart.sensor", &unit(noise)),
            ("time.duration", "40.0"),
        ],
    ));
    let (sin, cos) = (0.17364817766693033, 0.984807753012208);
    for (what, mean, density) in [
        ("yaw_rate", 0.0, 0.002),
        ("forward", 9.81 * sin, 0.03),
        ("left", 0.0, 0.03),
        ("up", 9.81 * cos, 0.03),
    ] {
        let values = column(&recording, "cart", what);
        let n = values.len() as f64;
        assert!(n >= 4000.0, "{n}");
        let std = density / 0.1;
        let average = values.iter().sum::<f64>() / n;
        assert!(
            (average - mean).abs() < 3.0 * std / n.sqrt(),
            "{what}: {average} must be {mean}"
        );
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
        let share = variance / (std * std);
        assert!(
            (share - 1.0).abs() < 3.0 * (2.0 / n).sqrt(),
            "{what}: {share}"
        );
    }
}
