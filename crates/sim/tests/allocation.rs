//! The step loop allocates nothing: neither blocks, nor judges, nor the building of rows.

use std::path::Path;

use appell_sim::record::Nothing;
use appell_sim::run::Run;
use appell_sim::scenario;

/// Two seconds of each scenario, from the first step, with all sensors, controllers and rows. A
/// judge writes text when something happens, so nothing happens in these two seconds.
#[test]
fn invariant_steps_allocate_nothing() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
    let by = |integrator: &'static str| ("time.integrator", integrator);
    let ways = [
        by("\"auto\""),
        by("\"rk4\""),
        by("\"adaptive\""),
        ("robot.*.level", "\"slip\""),
    ];
    for name in ["slalom.toml", "noisy.toml", "two-robots.toml", "coast.toml"] {
        for (path, way) in ways {
            let set = [(path.to_owned(), way.to_owned())];
            let loaded = scenario::load(&root.join(name), &set).unwrap_or_else(|e| panic!("{e}"));
            // Too fast a motor for RK4 is refused, and tried with the other two.
            let Ok(mut run) = Run::new(&loaded, 0) else {
                assert_eq!(way, "\"rk4\"", "{name}");
                continue;
            };
            let counted = allocation_counter::measure(|| {
                for _ in 0..2000 {
                    run.world.step(&mut Nothing).expect("steps");
                }
            });
            assert_eq!(counted.count_total, 0, "{name} with {way}");
        }
    }
}
