//! Amplitudes of a signal by frequency, for a picture.

use appell_model::scalar::Scalar;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

/// Most rows that are looked at: the newest.
pub const ROWS_MAX: usize = 1 << 20;

/// Amplitudes of the frequencies k / (n·period), k = 1 … n/2, of n values at equal intervals, without their mean
/// and under a Hann window: a sine of whole periods has its own amplitude at its frequency. Of fewer than four
/// values there are none.
pub fn amplitudes(planner: &mut FftPlanner<f64>, values: &[f64]) -> Vec<f64> {
    let n = values.len();
    if n < 4 {
        return Vec::new();
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    let window = |k: usize| {
        let angle = core::f64::consts::TAU * k as f64 / n as f64;
        0.5 - 0.5 * <f64 as Scalar>::sin_cos(angle).1
    };
    let weighed = values.iter().enumerate();
    let mut line: Vec<Complex<f64>> = weighed
        .map(|(k, value)| Complex::new((value - mean) * window(k), 0.0))
        .collect();
    planner.plan_fft_forward(n).process(&mut line);
    // The window lets half of each amplitude through, and half lies at the negative frequency.
    let scale = 4.0 / n as f64;
    line[1..=n / 2]
        .iter()
        .map(|value| scale * <f64 as Scalar>::sqrt(value.norm_sqr()))
        .collect()
}

/// At most so many bands of equal width, each with its largest amplitude.
pub fn thinned(amplitudes: &[f64], most: usize) -> Vec<f64> {
    let count = amplitudes.len().min(most.max(1));
    let edge = |k: usize| k * amplitudes.len() / count;
    (0..count)
        .map(|k| {
            amplitudes[edge(k)..edge(k + 1)]
                .iter()
                .fold(0.0, |a: f64, b| a.max(*b))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two sines on a large mean are found where they are, with their amplitudes, for any number of rows.
    #[test]
    fn closed_form_of_sines() {
        let mut planner = FftPlanner::new();
        for n in [1000_usize, 1009, 4096] {
            let of = |cycles: f64, k: usize| {
                <f64 as Scalar>::sin_cos(core::f64::consts::TAU * cycles * k as f64 / n as f64).0
            };
            let values: Vec<f64> = (0..n)
                .map(|k| 70.0 + 3.0 * of(20.0, k) - 0.5 * of(111.0, k))
                .collect();
            let found = amplitudes(&mut planner, &values);
            assert_eq!(found.len(), n / 2);
            assert!((found[19] - 3.0).abs() < 1e-9, "{}", found[19]);
            assert!((found[110] - 0.5).abs() < 1e-9, "{}", found[110]);
            assert!(found[60] < 1e-9 && found[0] < 1e-9);
            let coarse = thinned(&found, 50);
            assert_eq!(coarse.len(), 50);
            let highest = coarse.iter().fold(0.0, |a: f64, b| a.max(*b));
            assert!((highest - 3.0).abs() < 1e-9);
        }
        assert!(amplitudes(&mut planner, &[1.0; 3]).is_empty());
        assert!(thinned(&[], 10).is_empty());
    }
}
