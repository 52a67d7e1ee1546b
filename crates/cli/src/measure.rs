//! `appell measure`: what robots do, by the measures of ISO 18646-1.

use appell_sim::measures::{Measures, Test, measure as of_robot};

use crate::arguments::MeasureOptions;
use crate::{exit, terminal};

/// Measures robots and prints a table.
pub fn measure(options: &MeasureOptions) -> u8 {
    let within = |option: &str, value: f64, low: f64, high: f64| {
        let good = value >= low && value <= high;
        if !good {
            terminal::error(&format!(
                "--{option}: must be in [{low}, {high}], got {value}"
            ));
        }
        good
    };
    if !within("friction", options.friction, 0.01, 10.0)
        || !within("slope", options.slope, 0.0, 60.0)
    {
        return exit::BAD_INPUT;
    }
    let test = Test {
        friction: options.friction,
        slope_deg: options.slope,
    };
    let mut all = Vec::new();
    let count = options.robots.len();
    let mut progress = terminal::Progress::new("measure", count as f64, "robots/s");
    for (k, robot) in options.robots.iter().enumerate() {
        progress.at(k as f64);
        match of_robot(robot, test) {
            Ok(measures) => all.push(measures),
            Err(problem) => {
                progress.done();
                terminal::error(&problem);
                return exit::BAD_INPUT;
            }
        }
    }
    progress.done();
    if options.json {
        let text = serde_json::to_string_pretty(&all);
        terminal::print(&text.expect("measures are plain data"));
    } else {
        terminal::print(&table(&all, test));
    }
    exit::PASSED
}

fn table(all: &[Measures], test: Test) -> String {
    let mut text = format!(
        "friction {}; after ISO 18646-1\n\n{:22} {:8} {:>14} {:>16} {:>11} {:>14} {:>12} {:>16} {:>9}\n",
        test.friction,
        "robot",
        "level",
        "rated, m/s",
        "stops within, m",
        "time, s",
        "steepest, °",
        "limited by",
        format!("on {}°, m/s", test.slope_deg),
        "sill, mm"
    );
    for one in all {
        text.push_str(&format!(
            "{:22} {:8} {:>14.3} {:>16.3} {:>11.2} {:>14.1} {:>12} {:>16} {:>9}\n",
            one.robot,
            one.level,
            one.rated_speed,
            one.stopping_distance,
            one.stopping_time,
            one.slope_max_deg,
            one.limit,
            one.slope_speed
                .map_or("too steep".into(), |v| format!("{v:.3}")),
            one.sill
                .map_or("–".into(), |rise| format!("{:.0}", 1000.0 * rise)),
        ));
    }
    text.trim_end().to_owned()
}
