//! `appell obstacle`: what a wheel-legged robot does about a step or a trench.

use appell_model::wheel_legged::obstacle::{Limits, Obstacle, decide};
use appell_sim::crossing::{self, Build, Crossing};
use appell_sim::obstacle::{length, limits, map, sentence};
use appell_sim::report::{self, Press};
use serde_json::{Value, json};

use crate::arguments::ObstacleOptions;
use crate::{exit, terminal};

/// Decides, draws the map of all decisions, and lets the robot cross.
pub fn obstacle(options: &ObstacleOptions) -> u8 {
    let (limits, obstacle) = match given(options) {
        Ok(given) => given,
        Err(problem) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    let build = Build {
        limits,
        ..Build::ASSUMED
    };
    let crossing = obstacle.as_ref().map(|obstacle| {
        let crossing = crossing::cross(obstacle, &build);
        if options.json {
            terminal::print(&format!("{:#}", answer(&crossing)));
        } else {
            let decision = decide(obstacle, &limits);
            terminal::print(&format!(
                "{}\n{}",
                sentence(obstacle, &decision),
                outcome(&crossing)
            ));
        }
        crossing
    });
    let drawn = Press::new().and_then(|press| {
        let svg = press.strategies(&map(&limits, obstacle.as_ref()))?;
        let mut files = vec![("strategies.png".to_owned(), report::png(&svg, 2.0)?)];
        files.push(("strategies.svg".to_owned(), svg.into_bytes()));
        if let (Some(obstacle), Some(crossing)) = (&obstacle, &crossing)
            && !crossing.frames.is_empty()
        {
            let data = crossing::drawing(obstacle, &build, crossing);
            let strip = press.strip(&data)?;
            files.push(("crossing.png".to_owned(), report::png(&strip, 2.0)?));
            files.push(("crossing.svg".to_owned(), strip.into_bytes()));
            files.push((
                "crossing.html".to_owned(),
                press.crossing(&data)?.into_bytes(),
            ));
        }
        Ok(files)
    });
    match drawn {
        Ok(files) => match terminal::write_folder(&options.out, &files, options.json) {
            // To turn away is a decision; to be stopped on the way is a failure.
            exit::PASSED if crossing.is_some_and(|crossing| crossing.is_stopped()) => exit::FAILED,
            code => code,
        },
        Err(error) => {
            terminal::error(&error.to_string());
            exit::INTERNAL
        }
    }
}

fn answer(crossing: &Crossing) -> Value {
    let [margin, pitch, leg] = crossing.extremes();
    let duration = crossing.frames.last().map(|frame| frame.t);
    json!({
        "strategy": crossing.decision.strategy.key(),
        "reason": crossing.decision.reason.to_string(),
        "crossed": crossing.refusal.is_none(),
        "refusal": crossing.refusal,
        "duration": duration,
        "margin_min": duration.map(|_| margin),
        "pitch_max": duration.map(|_| pitch),
        "leg_max": duration.map(|_| leg),
    })
}

/// How the crossing went, as a sentence without its stop.
fn outcome(crossing: &Crossing) -> String {
    if let Some(refusal) = &crossing.refusal {
        return format!("not crossed: the robot {refusal}");
    }
    let [margin, pitch, leg] = crossing.extremes();
    let duration = crossing.frames.last().map_or(0.0, |frame| frame.t);
    format!(
        "crossed in {duration:.1} s: legs up to {:.1}°, body up to {:.1}°, center of mass at least {margin:.3} m inside the support",
        leg.to_degrees(),
        pitch.to_degrees()
    )
}

fn given(options: &ObstacleOptions) -> Result<(Limits, Option<Obstacle>), String> {
    let limits = limits(
        options.wheel_radius,
        options.wheel_pitch,
        options.height_max,
    )?;
    let obstacle = match (options.step, options.trench.as_deref()) {
        (Some(height), _) => Some(Obstacle::Step {
            height: length("--step", height)?,
        }),
        (None, Some([width, depth])) => Some(Obstacle::Trench {
            width: length("--trench, width", *width)?,
            depth: length("--trench, depth", *depth)?,
        }),
        (None, _) => None,
    };
    Ok((limits, obstacle))
}
