//! Draws of varied values.

use appell_model::scalar::Scalar;

use crate::noise::Stream;
use crate::scenario::{Draw, Vary};

/// Values of a trial, with their paths.
pub(super) fn values(vary: &[Vary], seed: u64, trial: u64) -> Vec<(String, f64)> {
    // Grids together count through all combinations.
    let mut place = trial;
    vary.iter()
        .map(|vary| {
            let stream = || Stream::new(seed, trial, &format!("vary.{}", vary.path));
            let uniform = || stream().uniforms(0)[0];
            let value = match &vary.draw {
                Draw::Normal { mean, std } => mean + std * stream().normals(0)[0],
                Draw::Uniform { low, high } => low + uniform() * (high - low),
                Draw::LogUniform { low, high } => {
                    let [low, high] = [*low, *high].map(Scalar::ln);
                    Scalar::exp(low + uniform() * (high - low))
                }
                Draw::Choice { values } => {
                    let k = (uniform() * values.len() as f64) as usize;
                    values[k.min(values.len() - 1)]
                }
                Draw::Grid { values } => {
                    let count = values.len() as u64;
                    let k = place % count;
                    place /= count;
                    values[k as usize]
                }
            };
            (vary.path.clone(), value)
        })
        .collect()
}

/// Reads `PATH=KIND(NUMBER, …)`, such as `robot.tri.platform.body.mass=normal(9, 0.5)`.
///
/// # Errors
/// What must be otherwise.
pub fn parse(text: &str) -> Result<Vary, String> {
    let rule = "must be PATH=KIND(NUMBERS), such as robot.tri.platform.body.mass=normal(9, 0.5); \
                kinds: normal, uniform, log-uniform, choice, grid";
    let wrong = || format!("{rule}; got \"{text}\"");
    let (path, draw) = text.split_once('=').ok_or_else(wrong)?;
    let (kind, rest) = draw.trim().split_once('(').ok_or_else(wrong)?;
    let inside = rest.trim_end().strip_suffix(')').ok_or_else(wrong)?;
    let numbers: Result<Vec<f64>, _> = inside
        .split(',')
        .map(|number| number.trim().parse::<f64>())
        .collect();
    let values = numbers.map_err(|_| wrong())?;
    let draw = match (kind.trim(), values.as_slice()) {
        ("normal", &[mean, std]) => Draw::Normal { mean, std },
        ("uniform", &[low, high]) => Draw::Uniform { low, high },
        ("log-uniform", &[low, high]) => Draw::LogUniform { low, high },
        ("choice", _) => Draw::Choice { values },
        ("grid", _) => Draw::Grid { values },
        _ => return Err(wrong()),
    };
    let vary = Vary {
        path: path.trim().to_owned(),
        draw,
    };
    match refuse(&vary.draw) {
        Some((_, problem)) => Err(format!("{problem}, in \"{text}\"")),
        None => Ok(vary),
    }
}

/// What is wrong with a draw, if anything is: its field, and what it must be.
pub fn refuse(draw: &Draw) -> Option<(&'static str, String)> {
    let numbers: &[f64] = match draw {
        Draw::Normal { mean, std } => &[*mean, *std],
        Draw::Uniform { low, high } | Draw::LogUniform { low, high } => &[*low, *high],
        Draw::Choice { values } | Draw::Grid { values } => values,
    };
    if let Some(number) = numbers.iter().find(|number| !number.is_finite()) {
        return Some(("kind", format!("must have finite numbers, got {number}")));
    }
    match draw {
        Draw::Normal { std, .. } if *std < 0.0 => {
            Some(("std", format!("must be a finite number >= 0, got {std}")))
        }
        Draw::LogUniform { low, .. } if *low <= 0.0 => {
            Some(("low", format!("must be a finite number > 0, got {low}")))
        }
        Draw::Uniform { low, high } | Draw::LogUniform { low, high } if high < low => {
            Some(("high", format!("must be at least low = {low}, got {high}")))
        }
        Draw::Choice { values } | Draw::Grid { values } if values.is_empty() => {
            Some(("values", "must have at least one entry".into()))
        }
        _ => None,
    }
}
