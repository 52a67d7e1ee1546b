//! What single precision costs: every shipped scenario that it can run, beside double precision.

use std::path::Path;

use appell_sim::record::{Memory, Recording};
use appell_sim::run::{NarrowRun, Run, Summary};
use appell_sim::scenario::load;

/// Rows and summary of a scenario in double and in single precision.
fn both(name: &str) -> [(Recording, Summary); 2] {
    let file = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../scenarios")
        .join(name);
    let loaded = load(&file, &[]).unwrap_or_else(|error| panic!("{error}"));
    let [mut wide, mut narrow] = [Memory::new(), Memory::new()];
    let mut run = Run::new(&loaded, 0).unwrap_or_else(|error| panic!("{error}"));
    let double = run.execute(&mut wide, &mut |_| {}).expect("runs");
    let run = NarrowRun::new(&loaded, 0).unwrap_or_else(|error| panic!("{error}"));
    let single = run.execute(&mut narrow, &mut |_| {}).expect("runs");
    [
        (wide.into_recording(), double),
        (narrow.into_recording(), single),
    ]
}

/// Largest distance of a robot from itself, m, and of its heading, rad, while both runs last.
fn distance(a: &Recording, b: &Recording) -> [f64; 2] {
    let rows = a.times.len().min(b.times.len());
    let column = |path: &str| {
        let found = a.header.signals.iter().position(|s| s.path == path);
        found.expect("a pose has all of its signals")
    };
    let mut most = [0.0_f64; 2];
    for signal in &a.header.signals {
        let Some(robot) = signal.path.strip_suffix(".pose.x") else {
            continue;
        };
        let [x, y, yaw] = ["x", "y", "yaw"].map(|of| column(&format!("{robot}.pose.{of}")));
        for row in 0..rows {
            let off = |k: usize| a.columns[k][row] - b.columns[k][row];
            most[0] = most[0].max((off(x) * off(x) + off(y) * off(y)).sqrt());
            most[1] = most[1].max(off(yaw).abs());
        }
    }
    most
}

/// A number has 24 bits: up to 6e-8 of a position is lost in each of thousands of steps, mostly by chance in
/// either direction, and control brings the rest back. What is commanded without feedback keeps it: the
/// sleigh, the circle, the house's path. The bits are the same everywhere, so the limits are tight.
#[test]
fn peer_single_precision_beside_double() {
    // Scenario, and what is allowed: a quarter more than measured, rounded up.
    let cases = [
        ("slalom.toml", 4e-5, 7e-5),
        ("homing.toml", 6e-5, 9e-5),
        ("circle.toml", 8e-4, 4e-3),
        ("gate.toml", 4e-5, 1e-5),
        ("gate-oblique.toml", 8e-5, 2e-4),
        ("eight.toml", 2e-5, 2e-5),
        ("eight-two-laps.toml", 4e-5, 5e-5),
        ("homing-behind-beacons.toml", 7e-5, 7e-5),
        ("coast.toml", 9e-6, 1e-7),
        ("parked.toml", 1e-7, 1e-7),
        ("slope.toml", 2e-4, 2e-4),
        ("sleigh.toml", 2e-3, 5e-5),
        ("two-robots.toml", 2e-3, 7e-5),
        ("laws.toml", 2e-4, 4e-4),
        ("route-omni.toml", 5e-5, 1e-7),
        ("slalom-omni.toml", 4e-5, 4e-5),
        ("slalom-fifteen.toml", 6e-5, 1e-4),
        ("tricycle.toml", 4e-4, 2e-4),
        ("car.toml", 2e-4, 2e-4),
        ("trailer.toml", 7e-4, 5e-4),
        ("motion.toml", 2e-4, 3e-4),
        ("motions.toml", 5e-6, 3e-6),
        ("house.toml", 2e-5, 2e-6),
        ("house-path.toml", 6e-4, 1e-7),
        ("noisy.toml", 3e-4, 2e-4),
        ("robust.toml", 1e-4, 2e-4),
        ("compare.toml", 4e-5, 6e-5),
        ("ros.toml", 1e-7, 1e-7),
    ];
    let mut beyond = Vec::new();
    for (name, position, angle) in cases {
        let [(wide, double), (narrow, single)] = both(name);
        let [away, turned] = distance(&wide, &narrow);
        println!("{name:30} {away:9.1e} m {turned:9.1e} rad");
        if away > position || turned > angle {
            beyond.push(format!("{name}: {away:e} m, {turned:e} rad"));
        }
        assert_eq!(double.verdict, single.verdict, "{name}");
        // It is the other run: numbers of seven digits are never all right.
        assert_ne!(wide.columns, narrow.columns, "{name}");
        assert!(single.robots[0].integrator.ends_with(", single precision"));
    }
    assert!(beyond.is_empty(), "{}", beyond.join("\n"));
}
