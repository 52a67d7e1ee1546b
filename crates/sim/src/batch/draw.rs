//! Draws of varied values.

use appell_model::scalar::Scalar;

use crate::noise::Stream;
use crate::scenario::{Batch, Draw, Sampling, Vary};

/// Values of a trial, with their paths.
pub(super) fn values(plan: &Batch, seed: u64, trial: u64) -> Vec<(String, f64)> {
    // Grids together count through all combinations.
    let mut place = trial;
    let mut dimension = 0;
    plan.vary
        .iter()
        .map(|vary| {
            let key = format!("vary.{}", vary.path);
            let stream = Stream::new(seed, trial, &key);
            let is_grid = matches!(vary.draw, Draw::Grid { .. });
            let even = match plan.sampling {
                _ if is_grid => None,
                Sampling::Random => None,
                Sampling::LatinHypercube => {
                    let square = Stream::new(seed, 0, &format!("{key}.square"));
                    let cell = shuffled(trial, plan.trials, &square);
                    let within = stream.uniforms(0)[0];
                    Some((cell as f64 + within) / plan.trials as f64)
                }
                Sampling::Sobol => {
                    let shift = Stream::new(seed, 0, &format!("{key}.shift")).uniforms(0)[0];
                    dimension += 1;
                    Some(sobol(dimension - 1, trial, shift))
                }
            };
            let uniform = || even.unwrap_or_else(|| stream.uniforms(0)[0]);
            let value = match &vary.draw {
                Draw::Normal { mean, std } => {
                    let deviate = even.map_or_else(|| stream.normals(0)[0], quantile);
                    mean + std * deviate
                }
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

/// The place of one of `count` in a random order: a keyed permutation, so that a trial finds its own
/// without the others (Feistel's network, walked until it falls within the range).
fn shuffled(index: u64, count: u64, key: &Stream) -> u64 {
    let half = (64 - (count - 1).leading_zeros()).div_ceil(2).max(1);
    let mask = (1_u64 << half) - 1;
    let mut value = index;
    loop {
        let (mut left, mut right) = (value >> half, value & mask);
        for round in 0..6 {
            let mixed = key.uniforms((right << 3) | round)[0].to_bits() >> 8;
            (left, right) = (right, (left ^ mixed) & mask);
        }
        value = (left << half) | right;
        if value < count {
            return value;
        }
    }
}

/// Largest number of values that Sobol's sequence serves.
pub(super) const SOBOL_MAX: usize = 21;

/// Primitive polynomials (degree, inner coefficients) and first direction numbers of the dimensions
/// after the first (S. Joe, F. Y. Kuo, *Constructing Sobol sequences with better two-dimensional
/// projections*, SIAM J. Sci. Comput. 30, 2008).
const SOBOL: [(usize, u32, &[u32]); SOBOL_MAX - 1] = [
    (1, 0, &[1]),
    (2, 1, &[1, 3]),
    (3, 1, &[1, 3, 1]),
    (3, 2, &[1, 1, 1]),
    (4, 1, &[1, 1, 3, 3]),
    (4, 4, &[1, 3, 5, 13]),
    (5, 2, &[1, 1, 5, 5, 17]),
    (5, 4, &[1, 1, 5, 5, 5]),
    (5, 7, &[1, 1, 7, 11, 19]),
    (5, 11, &[1, 1, 5, 1, 1]),
    (5, 13, &[1, 1, 1, 3, 11]),
    (5, 14, &[1, 3, 5, 5, 31]),
    (6, 1, &[1, 3, 3, 9, 7, 49]),
    (6, 13, &[1, 1, 1, 15, 21, 21]),
    (6, 16, &[1, 3, 1, 13, 27, 49]),
    (6, 19, &[1, 1, 1, 15, 7, 5]),
    (6, 22, &[1, 3, 1, 15, 13, 25]),
    (6, 25, &[1, 1, 5, 5, 19, 61]),
    (7, 1, &[1, 3, 7, 11, 23, 15, 103]),
    (7, 4, &[1, 3, 7, 13, 13, 15, 69]),
];

/// A point of Sobol's sequence in one dimension, in (0, 1), with its digits changed by a shift.
fn sobol(dimension: usize, index: u64, shift: f64) -> f64 {
    const BITS: usize = 32;
    let mut directions = [0_u32; BITS];
    if dimension == 0 {
        for (k, direction) in directions.iter_mut().enumerate() {
            *direction = 1 << (BITS - 1 - k);
        }
    } else {
        let (degree, inner, first) = SOBOL[dimension - 1];
        for k in 0..BITS {
            directions[k] = if k < degree {
                first[k] << (BITS - 1 - k)
            } else {
                let mut next = directions[k - degree] ^ (directions[k - degree] >> degree);
                for j in 1..degree {
                    if (inner >> (degree - 1 - j)) & 1 == 1 {
                        next ^= directions[k - j];
                    }
                }
                next
            };
        }
    }
    let mut bits = (shift * 4_294_967_296.0) as u32;
    for (k, direction) in directions.iter().enumerate() {
        if (index >> k) & 1 == 1 {
            bits ^= direction;
        }
    }
    (f64::from(bits) + 0.5) / 4_294_967_296.0
}

/// The standard normal deviate below which a share of all lies, by rational approximations (P. J.
/// Acklam) good to 1.2e-9 of the deviate: far below what any number of trials can tell.
fn quantile(share: f64) -> f64 {
    const CENTER: [f64; 6] = [
        -39.696_830_286_653_76,
        220.946_098_424_520_5,
        -275.928_510_446_968_7,
        138.357_751_867_269,
        -30.664_798_066_147_16,
        2.506_628_277_459_239,
    ];
    const CENTER_BELOW: [f64; 6] = [
        -54.476_098_798_224_06,
        161.585_836_858_040_9,
        -155.698_979_859_886_6,
        66.801_311_887_719_72,
        -13.280_681_552_885_72,
        1.0,
    ];
    const TAIL: [f64; 6] = [
        -0.007_784_894_002_430_293,
        -0.322_396_458_041_136_5,
        -2.400_758_277_161_838,
        -2.549_732_539_343_734,
        4.374_664_141_464_968,
        2.938_163_982_698_783,
    ];
    const TAIL_BELOW: [f64; 5] = [
        0.007_784_695_709_041_462,
        0.322_467_129_070_039_8,
        2.445_134_137_142_996,
        3.754_408_661_907_416,
        1.0,
    ];
    let polynomial = |terms: &[f64], x: f64| terms.iter().fold(0.0, |sum, term| sum * x + term);
    let tail = |share: f64| {
        let q = (-2.0 * Scalar::ln(share)).sqrt();
        polynomial(&TAIL, q) / polynomial(&TAIL_BELOW, q)
    };
    if share < 0.024_25 {
        tail(share)
    } else if share > 1.0 - 0.024_25 {
        -tail(1.0 - share)
    } else {
        let q = share - 0.5;
        q * polynomial(&CENTER, q * q) / polynomial(&CENTER_BELOW, q * q)
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the first 2ᵏ points, one falls into each of 2ᵏ intervals of each dimension; and of the first
    /// two dimensions together one into each box of a grid, whichever way it is cut.
    #[test]
    fn invariant_sobol_points_are_even() {
        for dimension in 0..SOBOL_MAX {
            let mut cells: Vec<u64> = (0..1024)
                .map(|k| (sobol(dimension, k, 0.3) * 1024.0) as u64)
                .collect();
            cells.sort_unstable();
            assert_eq!(cells, (0..1024).collect::<Vec<_>>(), "{dimension}");
        }
        for split in 0..=8 {
            let (wide, high) = (1 << split, 1 << (8 - split));
            let mut boxes: Vec<u64> = (0..256)
                .map(|k| {
                    let (x, y) = (sobol(0, k, 0.6), sobol(1, k, 0.1));
                    (x * wide as f64) as u64 * high + (y * high as f64) as u64
                })
                .collect();
            boxes.sort_unstable();
            assert_eq!(boxes, (0..256).collect::<Vec<_>>(), "{split}");
        }
    }

    #[test]
    fn invariant_latin_squares_visit_every_cell_once() {
        for count in [1, 2, 3, 17, 1000] {
            let key = Stream::new(5, 0, "key");
            let mut places: Vec<u64> = (0..count).map(|k| shuffled(k, count, &key)).collect();
            assert!(count < 17 || places != (0..count).collect::<Vec<_>>());
            places.sort_unstable();
            assert_eq!(places, (0..count).collect::<Vec<_>>());
        }
    }

    /// Tabulated quantiles of the normal distribution.
    #[test]
    fn known_answer_quantiles() {
        for (share, deviate) in [
            (0.5, 0.0),
            (0.975, 1.959_963_984_540_054),
            (0.9, 1.281_551_565_544_600_4),
            (0.001, -3.090_232_306_167_813_5),
        ] {
            let got = quantile(share);
            assert!((got - deviate).abs() < 1e-8, "{share}: {got}");
        }
    }
}
