//! `appell umbmark`: the bidirectional square-path test and its calibration.

use appell_sim::build::{self, DriveModel};
use appell_sim::scenario;
use appell_sim::umbmark::{self, Calibration, Course, Geometry, Round, Slip};

use crate::arguments::UmbmarkOptions;
use crate::{exit, terminal};

/// Tests and calibrates the odometry of a differential drive.
pub fn umbmark(options: &UmbmarkOptions) -> u8 {
    match rounds(options) {
        Ok((course, built, rounds)) => {
            if options.json {
                let text = serde_json::to_string_pretty(&serde_json::json!({
                    "side": course.side,
                    "track": course.track,
                    "built": built,
                    "rounds": rounds,
                }));
                terminal::print(&text.expect("rounds are plain data"));
            } else {
                terminal::print(&text(options, &course, &built, &rounds));
            }
            exit::PASSED
        }
        Err(problem) => {
            terminal::error(&problem);
            exit::BAD_INPUT
        }
    }
}

type Tested = (Course, Geometry<f64>, Vec<Round>);

fn rounds(options: &UmbmarkOptions) -> Result<Tested, String> {
    let within = |option: &str, value: f64, low: f64, high: f64| {
        if value >= low && value <= high {
            Ok(())
        } else {
            Err(format!(
                "--{option} must be in [{low}, {high}], got {value}"
            ))
        }
    };
    within("side", options.side, 0.01, 1e4)?;
    within("runs", options.runs as f64, 1.0, 1e5)?;
    within("rounds", options.rounds as f64, 1.0, 100.0)?;
    let drives = (options.runs * options.rounds as u64) as f64;
    within("runs times --rounds", drives, 1.0, 1e6)?;
    let robot = scenario::load_robot(&options.robot).map_err(|error| error.to_string())?;
    let platform = build::platform(&robot, DriveModel::Rate, 9.81).expect("a checked platform");
    let track = umbmark::track(&platform)
        .map_err(|problem| format!("{}: wheel: {problem}", options.robot.display()))?;
    let course = Course {
        side: options.side,
        track,
    };
    let built = Geometry {
        diameters: options.diameter_ratio,
        track: options.track_ratio,
    };
    course.tells(&built, options.slip).map_err(|problem| {
        format!("{problem}\n  hint: beyond that the end points no longer tell the errors apart; a shorter --side bends less")
    })?;
    let calibration = if options.published {
        Calibration::Published
    } else {
        Calibration::Exact
    };
    let slip = Slip {
        std: options.slip,
        seed: options.seed,
    };
    // The last one shows what the corrections achieved.
    let tests = options.rounds + 1;
    let rounds = umbmark::test(&course, &built, calibration, tests, options.runs, slip);
    Ok((course, built, rounds))
}

fn text(
    options: &UmbmarkOptions,
    course: &Course,
    built: &Geometry<f64>,
    rounds: &[Round],
) -> String {
    let mut text = format!(
        "square of {} m, track {} m, {} {} each way\nbuilt with E_d {} (right wheel over left), E_b {} (track)\n\n",
        course.side,
        course.track,
        options.runs,
        if options.runs == 1 { "run" } else { "runs" },
        built.diameters,
        built.track
    );
    text.push_str(&format!(
        "{:11} {:>11} {:>11} {:>22} {:>22} {:>12} {:>10}\n",
        "belief", "E_d", "E_b", "stops at, cw, mm", "ccw, mm", "E_max,syst", "scatter"
    ));
    // Micrometers, without the sign of a zero.
    let place = |p: [f64; 2]| {
        let [x, y] = p.map(|v| (1e6 * v).round() / 1e3 + 0.0);
        format!("({x:.3}, {y:.3})")
    };
    for (k, round) in rounds.iter().enumerate() {
        let belief = match k {
            0 => "nominal".to_owned(),
            k => format!("corrected {k}"),
        };
        text.push_str(&format!(
            "{belief:11} {:>11.7} {:>11.7} {:>22} {:>22} {:>9.3} mm {:>7.3} mm\n",
            round.believed.diameters,
            round.believed.track,
            place(round.centers[0]),
            place(round.centers[1]),
            1e3 * round.systematic,
            1e3 * round.scatter
        ));
    }
    let (first, last) = (rounds[0].systematic, rounds[rounds.len() - 1].systematic);
    if first < 1e-12 {
        text.push_str("\nnothing to correct: the robot is as it believes");
    } else if last < 1e-12 * first.max(1.0) {
        text.push_str("\nthe corrections leave no systematic error but rounding");
    } else if last > first {
        text.push_str("\nthe corrections do not help: the wheels slip more than the geometry errs");
    } else {
        text.push_str(&format!(
            "\nthe corrections make the systematic error {} times smaller",
            terminal::number(first / last)
        ));
    }
    text
}
