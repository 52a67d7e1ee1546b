//! Tests of batches.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::figures::Success;
use super::{Batch, Crew, PART, Shard, Store, draw, figures, merge, sum_up};
use crate::scenario::{Draw, Precision, Sampling, Vary};

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../scenarios")
        .join(name)
}

fn scratch(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("appell-batch-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

/// A short batch: the house with other noise, cut to its first leg.
fn batch(trials: u64) -> Batch {
    let set = |path: &str, value: &str| (path.to_owned(), value.to_owned());
    let overrides = [
        set("time.duration", "2.0"),
        set("robot.restored.servo.angle_feedback", "4.0"),
    ];
    let vary = [
        draw::parse("robot.real.wheel_noise.0.std=uniform(0.001, 0.01)").expect("a draw"),
        draw::parse("robot.restored.servo.rate_feedback = grid(0.0, 0.01, 0.02)").expect("a draw"),
    ];
    Batch::new(
        &shipped("house-seeds.toml"),
        &overrides,
        Some(trials),
        &vary,
        None,
    )
    .unwrap_or_else(|error| panic!("{error}"))
}

fn crew(threads: usize) -> Crew {
    Crew {
        threads,
        ..Crew::default()
    }
}

/// Runs a shard in a folder.
fn shard(batch: &Batch, folder: &Path, shard: Shard, crew: Crew) -> Store {
    let store = Store::open(folder, batch.manifest()).unwrap_or_else(|error| panic!("{error}"));
    batch
        .execute(&store, shard, crew, &|_| {})
        .unwrap_or_else(|error| panic!("{error}"));
    store
}

fn root(store: &Store) -> String {
    let (summary, _) = sum_up(store).unwrap_or_else(|error| panic!("{error}"));
    summary.root
}

fn parts(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder.join("trials")).expect("parts");
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    files
}

#[test]
fn invariant_rows_do_not_depend_on_threads_breaks_or_shards() {
    let batch = batch(2 * PART + 20);
    let mut roots = BTreeSet::new();
    for threads in [1, 2, 3] {
        let folder = scratch(&format!("threads-{threads}"));
        roots.insert(root(&shard(&batch, &folder, Shard::WHOLE, crew(threads))));
        // A part that is gone, and one that is damaged, are run again; the others are not.
        let files = parts(&folder);
        let age = |file: &PathBuf| {
            std::fs::metadata(file)
                .and_then(|m| m.modified())
                .expect("a part")
        };
        let untouched = age(&files[2]);
        std::fs::remove_file(&files[0]).expect("removed");
        let bytes = std::fs::read(&files[1]).expect("a part");
        std::fs::write(&files[1], &bytes[..bytes.len() / 2]).expect("damaged");
        roots.insert(root(&shard(&batch, &folder, Shard::WHOLE, crew(threads))));
        assert_eq!((files.clone(), untouched), (parts(&folder), age(&files[2])));
        std::fs::remove_dir_all(&folder).expect("removed");
    }
    for count in [2, 3, 10] {
        let folders: Vec<PathBuf> = (1..=count)
            .map(|index| {
                let folder = scratch(&format!("shard-{index}-{count}"));
                shard(&batch, &folder, Shard { index, count }, crew(2));
                folder
            })
            .collect();
        let out = scratch(&format!("merged-{count}"));
        // A shard alone is no batch.
        assert!(sum_up(&Store::existing(&folders[0]).expect("a shard")).is_err());
        let merged = merge(&folders, &out).unwrap_or_else(|error| panic!("{error}"));
        roots.insert(root(&merged));
        for folder in folders.iter().chain([&out]) {
            std::fs::remove_dir_all(folder).expect("removed");
        }
    }
    assert_eq!(roots.len(), 1);
}

#[test]
fn refusal_of_attempts_that_differ() {
    let batch = batch(30);
    let (one, two) = (scratch("one"), scratch("two"));
    let first = shard(&batch, &one, Shard::WHOLE, crew(1));
    let second = Store::open(&two, batch.manifest()).expect("a folder");
    let mut rows = first.read(0).expect("reads").expect("rows");
    rows[7].values[2] += 1e-12;
    second.write(0, &rows).expect("written");
    let out = scratch("out");
    let problem = merge(&[one.clone(), two.clone()], &out)
        .err()
        .expect("a refusal");
    assert!(
        problem.to_string().contains("another result of part 0"),
        "{problem}"
    );
    // Another batch does not go on in its folder, and is not merged.
    let other = self::batch(31);
    let problem = Store::open(&one, other.manifest())
        .err()
        .expect("a refusal");
    assert!(problem.to_string().contains("another batch"), "{problem}");
    for folder in [&one, &two, &out] {
        std::fs::remove_dir_all(folder).expect("removed");
    }
}

#[test]
fn invariant_a_trial_alone_is_that_of_the_batch() {
    let folder = scratch("alone");
    let batch = batch(40);
    let store = shard(&batch, &folder, Shard::WHOLE, crew(2));
    let rows = store.read(0).expect("reads").expect("rows");
    for trial in [0, 17, 39] {
        let (alone, row) = (batch.trial(0, trial), &rows[trial as usize]);
        assert_eq!(alone.verdict, row.verdict);
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&alone.values), bits(&row.values));
    }
    // Grids count through their values; draws are within their limits.
    for (trial, row) in rows.iter().enumerate() {
        assert!((0.001..0.01).contains(&row.values[0]));
        assert_eq!(row.values[1], [0.0, 0.01, 0.02][trial % 3]);
    }
    // More noise, more error: by ranks, and nearly always.
    let (summary, _) = sum_up(&store).expect("sums up");
    let influence = summary.variants[0].influences.iter().find(|influence| {
        influence.drawn.ends_with("std")
            && influence.figure.ends_with("front-left.rate_command, std")
    });
    assert!(influence.expect("an influence").correlation > 0.9);
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// Variants meet the same draws and the same noise, so that one which changes nothing differs by
/// nothing, trial by trial.
#[test]
fn invariant_variants_share_their_draws() {
    let text = std::fs::read_to_string(shipped("house-seeds.toml")).expect("a scenario");
    let variants = "[batch]\nvary = [{ path = \"robot.real.wheel_noise.0.std\", draw = { kind = \"uniform\", low = 0.001, high = 0.01 } }]\n\
        variant = [{ name = \"as-is\", set = {} }, { name = \"same\", set = { \"robot.restored.servo.angle_feedback\" = 5.0 } }, \
        { name = \"lazy\", set = { \"robot.restored.servo.angle_feedback\" = 1.0 } }]\n";
    let folder = scratch("variants");
    std::fs::create_dir_all(folder.join("scenarios")).expect("a folder");
    let robots = shipped("../robots");
    let text = text
        .replace("[batch]\ntrials = 10000\nmark = \"house.toml\"", variants)
        .replace("../robots", &robots.to_string_lossy())
        .replace("duration = 20.0", "duration = 2.0");
    let file = folder.join("scenarios/variants.toml");
    std::fs::write(&file, text).expect("written");
    let batch =
        Batch::new(&file, &[], Some(100), &[], None).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(batch.manifest().rows(), 300);
    let store = shard(&batch, &folder, Shard::WHOLE, crew(2));
    let (summary, trials) = sum_up(&store).expect("sums up");
    let [_, same, lazy] = &summary.variants[..] else {
        panic!("three variants");
    };
    assert!(
        same.paired
            .iter()
            .all(|pair| pair.mean == 0.0 && pair.error == 0.0)
    );
    let yaw = |pair: &&super::Paired| pair.figure == "ideal less restored: sensor.note.x, std";
    let pair = lazy.paired.iter().find(yaw).expect("a figure");
    assert!(pair.mean > 10.0 * pair.error, "{pair:?}");
    let bits = |variant: usize| -> Vec<u64> {
        let values = trials[variant].values[0].iter();
        values.map(|value| value.to_bits()).collect()
    };
    assert_eq!(bits(0).len(), 100);
    assert_eq!(bits(0), bits(2));
    let last = store.read(1).expect("a part").expect("its rows");
    let last = last.last().expect("a row");
    assert_eq!((last.trial, last.variant.as_str()), (99, "lazy"));
    std::fs::remove_dir_all(&folder).expect("removed");
}

/// Spearman's correlation by the formula for ranks without ties, 1 − 6 Σd²/(n(n² − 1)).
#[test]
fn closed_form_rank_correlation() {
    let (a, b) = ([1.0, 2.0, 3.0, 4.0, 5.0], [0.1, 0.9, 0.2, 7.0, 8.0]);
    let found = figures::correlation(&a, &b).expect("both vary");
    assert!((found - (1.0 - 6.0 * 2.0 / 120.0)).abs() < 1e-15);
    assert_eq!(figures::correlation(&a, &[2.0; 5]), None);
    let tied = figures::correlation(&[0.0, 0.0, 1.0, 1.0], &[3.0, 3.0, 9.0, 9.0]);
    assert_eq!(tied, Some(1.0));
}

#[test]
fn closed_form_draws_have_their_moments() {
    let vary = [
        "a=normal(2, 0.5)",
        "b=uniform(-1, 3)",
        "c=log-uniform(0.01, 100)",
        "d=choice(1, 2, 4)",
    ]
    .map(|text| draw::parse(text).expect("a draw"));
    for sampling in [Sampling::Random, Sampling::LatinHypercube, Sampling::Sobol] {
        check_moments(&vary, sampling);
    }
}

fn check_moments(vary: &[Vary], sampling: Sampling) {
    let count = 20_000;
    let plan = crate::scenario::Batch {
        trials: count,
        sampling,
        vary: vary.to_vec(),
        ..Default::default()
    };
    let mut sums = [[0.0; 2]; 4];
    for trial in 0..count {
        for (k, (_, value)) in draw::values(&plan, 7, trial).into_iter().enumerate() {
            let value = if k == 2 {
                appell_model::scalar::Scalar::ln(value)
            } else {
                value
            };
            sums[k][0] += value;
            sums[k][1] += value * value;
        }
    }
    // Mean and variance by their formulas; four standard errors of 20 000 draws, of a variance at most
    // √(2/n) = 1 % for a normal.
    let wide = 4.0 * std::f64::consts::LN_10;
    for (k, (mean, variance)) in [
        (2.0, 0.25),
        (1.0, 16.0 / 12.0),
        (0.0, wide * wide / 12.0),
        (7.0 / 3.0, 14.0 / 9.0),
    ]
    .into_iter()
    .enumerate()
    {
        let n = count as f64;
        let (got, square) = (sums[k][0] / n, sums[k][1] / n);
        let error = 4.0 * (variance / n).sqrt();
        assert!((got - mean).abs() < error, "{k}: {got}");
        assert!(
            (square - got * got - variance).abs() < 0.05 * variance,
            "{k}"
        );
    }
}

#[test]
fn refusal_of_draws() {
    for text in [
        "a",
        "a=normal",
        "a=normal(1)",
        "a=normal(1, -1)",
        "a=uniform(2, 1)",
        "a=log-uniform(0, 1)",
        "a=choice(x)",
        "a=weird(1)",
        "a=normal(nan, 1)",
    ] {
        assert!(draw::parse(text).is_err(), "{text}");
    }
    assert!(draw::refuse(&Draw::Grid { values: vec![] }).is_some());
}

/// E. B. Wilson's interval, worked by hand: 8 of 10 gives 0.4902 to 0.9433.
#[test]
fn closed_form_confidence_of_success() {
    let success = Success::of(8, 10);
    assert!((success.low - 0.4902).abs() < 5e-5 && (success.high - 0.9433).abs() < 5e-5);
    let none = Success::of(0, 10);
    assert!(none.low == 0.0 && (none.high - 0.2775).abs() < 5e-5);
}

/// A small batch on every machine alike: homing by noisy odometry, with other masses and motors.
fn quick(trials: u64) -> Batch {
    quick_in(Precision::F64, trials)
}

fn quick_in(precision: Precision, trials: u64) -> Batch {
    let set = |path: &str, value: &str| (path.to_owned(), value.to_owned());
    let overrides = [
        set("batch.precision", precision.name()),
        set("time.duration", "0.6"),
        set("robot.tri.sensor", ODOMETRY),
        set("robot.tri.controller.pose", "odometry"),
    ];
    let vary = [
        draw::parse("robot.tri.platform.body.mass=normal(9, 0.5)").expect("a draw"),
        draw::parse("robot.tri.platform.wheel.left.drive.torque_constant=uniform(0.048, 0.052)")
            .expect("a draw"),
    ];
    Batch::new(
        &shipped("homing.toml"),
        &overrides,
        Some(trials),
        &vary,
        None,
    )
    .unwrap_or_else(|error| panic!("{error}"))
}

const ODOMETRY: &str =
    "[{ kind = \"odometry\", period = 0.01, resolution = 2048, angle_std = 0.002 }]";

/// The root of [`quick`], on every machine.
const QUICK_ROOT: &str = "1b40813046f4ebbc858c9df2d8f3332a00806f4fae1ca1f821105f2286a4921f";

/// The same in single precision.
const NARROW_ROOT: &str = "f1946095b56bc9c5267783247d01106b2a9141b7773ff4ff7546c058445a3f91";

/// The matrix of threads, lanes and shards; `crates/cli/tests/robust.rs` adds the build profiles.
#[test]
fn golden_one_root_for_threads_lanes_and_shards() {
    check_matrix(Precision::F64, QUICK_ROOT);
}

#[test]
fn golden_one_root_in_single_precision() {
    check_matrix(Precision::F32, NARROW_ROOT);
}

fn check_matrix(precision: Precision, expected: &str) {
    let name = precision.name();
    let batch = quick_in(precision, 4 * PART - 30);
    let mut roots = BTreeSet::new();
    for threads in [1, 2, 3, 7] {
        for lanes in [1, 4, 8] {
            let folder = scratch(&format!("matrix-{name}-{threads}-{lanes}"));
            let store = shard(&batch, &folder, Shard::WHOLE, Crew { threads, lanes });
            roots.insert(root(&store));
            std::fs::remove_dir_all(&folder).expect("removed");
        }
    }
    for (count, lanes) in [(10, 8), (97, 4)] {
        let folders: Vec<PathBuf> = (1..=count)
            .map(|index| {
                let folder = scratch(&format!("matrix-{name}-shard-{index}-{count}"));
                let crew = Crew { threads: 2, lanes };
                shard(&batch, &folder, Shard { index, count }, crew);
                folder
            })
            .collect();
        let out = scratch(&format!("matrix-{name}-merged-{count}"));
        let merged = merge(&folders, &out).unwrap_or_else(|error| panic!("{error}"));
        roots.insert(root(&merged));
        for folder in folders.iter().chain([&out]) {
            std::fs::remove_dir_all(folder).expect("removed");
        }
    }
    assert_eq!(roots, BTreeSet::from([expected.to_owned()]));
}

/// Every shipped kind of robot, level, drive, sensor, law and task: trials that share a world in
/// lanes have the bits of those that are run alone.
#[test]
fn invariant_lanes_have_the_bits_of_single_runs() {
    let noisy = "[{ kind = \"pose\", period = 0.02, position_std = 0.01, yaw_std = 0.005 }]";
    let beacons =
        "[{ kind = \"range-bearing\", period = 0.05, range_max = 2.5, range_std = 0.01 }]";
    let inertial = "[{ kind = \"imu\", period = 0.02, gyro_noise_density = 0.01, accel_noise_density = 0.02 }]";
    let cases: &[(&str, &[(&str, &str)])] = &[
        ("slalom.toml", &[]),
        ("slalom.toml", &[("robot.tri.level", "kinematic")]),
        ("slalom.toml", &[("robot.tri.drive", "torque")]),
        (
            "slalom.toml",
            &[("time.integrator", "rk4"), ("time.step", "0.0005")],
        ),
        ("slalom.toml", &[("time.integrator", "adaptive")]),
        ("slalom-omni.toml", &[]),
        ("noisy.toml", &[]),
        ("gate.toml", &[("robot.*.sensor", beacons)]),
        ("eight.toml", &[("robot.*.sensor", noisy)]),
        ("slope.toml", &[("robot.*.sensor", inertial)]),
        ("slope.toml", &[]),
        ("coast.toml", &[]),
        ("parked.toml", &[]),
        ("sleigh.toml", &[]),
        ("two-robots.toml", &[]),
        ("laws.toml", &[]),
        ("route-omni.toml", &[]),
        ("tricycle.toml", &[]),
        ("car.toml", &[]),
        ("trailer.toml", &[]),
        ("motion.toml", &[]),
        ("house.toml", &[]),
    ];
    for (name, set) in cases {
        check_lanes(name, set, Precision::F64);
        if !set.contains(&("time.integrator", "adaptive")) {
            check_lanes(name, set, Precision::F32);
        }
    }
}

fn check_lanes(name: &str, set: &[(&str, &str)], precision: Precision) {
    let mut overrides: Vec<(String, String)> = set
        .iter()
        .map(|(path, value)| ((*path).to_owned(), (*value).to_owned()))
        .collect();
    overrides.push(("time.duration".into(), "2.5".into()));
    overrides.push(("batch.precision".into(), precision.name().into()));
    // Every other trial has another mass: the robots part.
    let vary = [draw::parse("robot.*.platform.body.mass=grid(6, 9)").expect("a draw")];
    let batch = Batch::new(&shipped(name), &overrides, Some(11), &vary, None)
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    for lanes in [4, 8] {
        let folder = scratch(&format!("lanes-{}-{lanes}", precision.name()));
        let crew = Crew { threads: 1, lanes };
        let store = shard(&batch, &folder, Shard::WHOLE, crew);
        for row in store.read(0).expect("reads").expect("rows") {
            let variant = batch.manifest().variant(&row.variant);
            let alone = batch.trial(variant, row.trial);
            let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(alone.reason, row.reason, "{name} {set:?} {lanes}");
            assert_eq!(alone.verdict, row.verdict, "{name} {set:?}");
            for (k, column) in batch.manifest().columns.iter().enumerate() {
                assert!(
                    bits(&alone.values[k..=k]) == bits(&row.values[k..=k]),
                    "{name} {set:?}, {lanes} lanes, trial {}: {} is {} and {}",
                    row.trial,
                    column.name,
                    alone.values[k],
                    row.values[k]
                );
            }
            assert_eq!(alone.other, row.other);
        }
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}

/// A robot whose wheels are alike has a step of its own: it must be the same beside others, the first of
/// them or not, and also beside wheels that are alike in single precision alone.
#[test]
fn invariant_alike_and_unlike_wheels_share_a_batch() {
    let drawn = ["0.0484, 0.05, 0.05000000000001", "0.05000000000001, 0.05"];
    for (drawn, precision) in drawn
        .into_iter()
        .flat_map(|drawn| [(drawn, Precision::F64), (drawn, Precision::F32)])
    {
        let vary = format!("robot.tri.platform.wheel.left.drive.torque_constant=grid({drawn})");
        let vary = [draw::parse(&vary).expect("a draw")];
        let overrides = [
            ("time.duration".to_owned(), "1.0".to_owned()),
            ("batch.precision".to_owned(), precision.name().to_owned()),
        ];
        let batch = Batch::new(&shipped("homing.toml"), &overrides, Some(20), &vary, None)
            .unwrap_or_else(|error| panic!("{error}"));
        let folder = scratch(&format!("alike-{}", precision.name()));
        let store = shard(&batch, &folder, Shard::WHOLE, crew(1));
        for row in store.read(0).expect("reads").expect("rows") {
            let alone = batch.trial(0, row.trial);
            let bits =
                |row: &super::Row| row.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_ne!(row.verdict, "invalid");
            assert_eq!(
                (alone.verdict.as_str(), bits(&alone)),
                (row.verdict.as_str(), bits(&row))
            );
        }
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}

#[test]
fn refusal_of_what_single_precision_does_not_know() {
    let narrow = ("batch.precision", "f32");
    let cases: [&[(&str, &str)]; 4] = [
        &[("level", "slip")],
        &[("time.integrator", "adaptive")],
        &[("swap", "")],
        &[("hills", "")],
    ];
    for case in cases {
        let (file, set) = match case[0] {
            ("level", _) => ("ice.toml", None),
            ("swap", _) => ("swap.toml", None),
            ("hills", _) => ("hills.toml", None),
            set => ("slalom.toml", Some(set)),
        };
        let set = set.into_iter().chain([narrow]);
        let overrides: Vec<(String, String)> = set
            .map(|(path, value)| (path.into(), value.into()))
            .collect();
        let problem = Batch::new(&shipped(file), &overrides, Some(3), &[], None)
            .err()
            .unwrap_or_else(|| panic!("{file} is taken"));
        let problem = problem.to_string();
        assert!(
            problem.contains("batch.precision: must be \"f64\" here"),
            "{file}: {problem}"
        );
    }
    // A word that is none.
    let overrides = [("batch.precision".to_owned(), "f16".to_owned())];
    let problem = Batch::new(&shipped("slalom.toml"), &overrides, Some(3), &[], None);
    let problem = problem.err().expect("a refusal").to_string();
    assert!(
        problem.contains("f16") && problem.contains("f64"),
        "{problem}"
    );
}

/// A batch goes on, and is merged, in its own precision alone.
#[test]
fn refusal_of_rows_of_another_precision() {
    let (double, single) = (quick(30), quick_in(Precision::F32, 30));
    let (one, two, out) = (
        scratch("double"),
        scratch("single"),
        scratch("both-precisions"),
    );
    let first = shard(&double, &one, Shard::WHOLE, crew(1));
    let second = shard(&single, &two, Shard::WHOLE, crew(1));
    assert_ne!(root(&first), root(&second));
    let (summary, _) = sum_up(&second).expect("sums up");
    assert_eq!(summary.precision, Precision::F32);
    let refusals = [
        Store::open(&one, single.manifest()).err(),
        Store::open(&two, double.manifest()).err(),
        merge(&[one.clone(), two.clone()], &out).err(),
    ];
    for (refusal, word) in refusals.into_iter().zip(["f32", "f64", "f64"]) {
        let problem = refusal.expect("a refusal").to_string();
        let wanted = format!("must hold rows of precision {word}");
        assert!(problem.contains(&wanted), "{problem}");
    }
    for folder in [&one, &two, &out] {
        let _ = std::fs::remove_dir_all(folder);
    }
}

/// A step of a world in lanes allocates nothing; a judge writes text when something happens, so nothing
/// happens here.
#[test]
fn invariant_steps_of_lanes_allocate_nothing() {
    struct Count<'a>(&'a Batch);

    impl appell_model::lanes::AnyLanes for Count<'_> {
        type Output = u64;

        fn run<T: appell_model::scalar::Scalar<Single = f64>>(self) -> u64 {
            super::lanes::allocations::<T>(self.0, 500)
        }
    }

    let batch = quick(30);
    for lanes in [1, 4, 8] {
        assert_eq!(appell_model::lanes::dispatch(lanes, Count(&batch)), 0);
    }
    for lanes in [1, 8, 16] {
        assert_eq!(
            appell_model::lanes::narrow::dispatch(lanes, Count(&batch)),
            0
        );
    }
}
