//! Rough ground: an isotropic random field whose sections have the spectrum of ISO 8608.
//!
//! Along any straight line the field of plane waves h = Σ aᵢ cos(2π kᵢ (x cos θᵢ + y sin θᵢ) + φᵢ)
//! has, in the mean over seeds, the one-sided displacement spectrum
//!
//! G(n) = C n⁻², C = Gd(n₀) n₀², n₀ = 0.1 cycles/m, for n from 1/longest to N = 1/shortest,
//!
//! and nothing above N. `[eq:roughness]` The line sees a wave of wave number k (cycles/m), at an
//! angle θ to it, with the frequency n = k |cos θ|, whose density over uniform θ is
//! 2/(π √(k² − n²)) for n < k. Waves with the variance S(k) dk between k and k + dk thus give
//!
//! G(n) = (2/π) ∫ₙᴺ S(k) / √(k² − n²) dk,
//!
//! Abel's equation, solved for C n⁻² by
//!
//! S(k) = C (arccos(k/N)/k² + 1/(k √(N² − k²))),
//!
//! since the terms give C/n² − C/(n N) and C/(n N). What has a larger wave number than k has the
//! variance C arccos(k/N)/k. (For N → ∞, S = π C/(2 k²): a density over the plane of k as k⁻³.)
//!
//! Only waves with k ≥ n contribute to G(n). So leaving out those longer than `longest` changes
//! nothing within the band; and what is left gives below it, as waves seen aslant,
//! G(n) = C (1 − √(1 − n²/m²))/n² for m = 1/longest and N → ∞: from all of the law's value at m
//! down to its half. An isotropic field cannot do without. Its variance in the whole is
//! C arccos(m/N)/m.

use std::f64::consts::{PI, TAU};

use appell_model::scalar::Scalar;

/// Reference spatial frequency n₀, cycles/m.
const REFERENCE: f64 = 0.1;
/// (√5 − 1)/2: directions that many half turns apart stay evenly spread, however many they are.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Spectral densities Gd(n₀) of the classes A to H of ISO 8608, geometric means, m³.
pub const CLASS_PSD: [f64; 8] = [
    16e-6, 64e-6, 256e-6, 1024e-6, 4096e-6, 16384e-6, 65536e-6, 262_144e-6,
];

/// A plane wave a cos(p x + q y + φ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// a, m.
    pub amplitude: f64,
    /// Angular wave numbers [p, q], rad/m.
    pub turns: [f64; 2],
    /// φ, rad.
    pub phase: f64,
}

/// A rough ground. `[eq:roughness]`
#[derive(Clone, Debug, PartialEq)]
pub struct Roughness {
    /// Its waves.
    pub waves: Vec<Wave>,
}

impl Roughness {
    /// A ground with Gd(n₀) of `class_psd` (m³) and waves of lengths from `shortest` to `longest`
    /// (m), 0 < `shortest` < `longest`; `random` gives the same number in [0, 1) whenever it is asked
    /// with the same argument.
    ///
    /// The waves share out the octaves evenly; twelve and more an octave leave single waves
    /// inconspicuous.
    pub fn new(
        class_psd: f64,
        shortest: f64,
        longest: f64,
        count: usize,
        random: impl Fn(u64) -> f64,
    ) -> Self {
        let scale = class_psd * REFERENCE * REFERENCE;
        let [least, most] = [1.0 / longest, 1.0 / shortest];
        // Variance of all waves of wave numbers above k.
        let beyond = |k: f64| {
            let across = ((most - k) * (most + k)).max(0.0).sqrt();
            scale * Scalar::atan2(across, k) / k
        };
        let octaves = Scalar::ln(most / least);
        let edge = |wave: usize| match wave {
            0 => least,
            _ if wave == count => most,
            _ => least * Scalar::exp(octaves * wave as f64 / count as f64),
        };
        let turn = random(0);
        let wave = |index: usize| {
            let draw = |which: u64| random(1 + 2 * index as u64 + which);
            let (mut low, mut high) = (edge(index), edge(index + 1));
            let [above, below] = [beyond(low), beyond(high)];
            // The wave has the variance of its interval, and stands in it where its share of that
            // variance is uniform: so the mean over seeds is the law, whatever the intervals.
            let variance = above - below;
            let wanted = above - draw(0) * variance;
            for _ in 0..64 {
                let middle = 0.5 * (low + high);
                if beyond(middle) > wanted {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            let number = TAU * 0.5 * (low + high);
            // Each direction is uniform over seeds; those of one seed are spread evenly.
            let direction = PI * (turn + GOLDEN * index as f64);
            let (sin, cos) = Scalar::sin_cos(direction);
            Wave {
                amplitude: Scalar::sqrt(2.0 * variance),
                turns: [number * cos, number * sin],
                phase: TAU * draw(1),
            }
        };
        Roughness {
            waves: (0..count).map(wave).collect(),
        }
    }

    /// Heights (m) at the nodes `origin` + (i, j) · `spacing` (m), that of (i, j) at
    /// j · `columns` + i.
    ///
    /// Costs two products a wave and node, and no sine: a wave's is that of its column and row.
    pub fn sample(
        &self,
        origin: [f64; 2],
        spacing: [f64; 2],
        columns: usize,
        rows: usize,
    ) -> Vec<f64> {
        const ROWS: usize = 8;
        let mut heights = vec![0.0; columns * rows];
        if heights.is_empty() {
            return heights;
        }
        // Of each wave, the cosines and sines over the columns, times its amplitude.
        let of_column = |wave: &Wave, i: usize| {
            let x = origin[0] + i as f64 * spacing[0];
            let (sin, cos) = Scalar::sin_cos(wave.turns[0] * x);
            (wave.amplitude * cos, wave.amplitude * sin)
        };
        let of_columns: Vec<[Vec<f64>; 2]> = self
            .waves
            .iter()
            .map(|wave| (0..columns).map(|i| of_column(wave, i)).unzip().into())
            .collect();
        // A few rows at a time stay near the processor while all waves pass over them.
        for (block, rows) in heights.chunks_mut(columns * ROWS).enumerate() {
            for (wave, [cosines, sines]) in self.waves.iter().zip(&of_columns) {
                for (j, row) in rows.chunks_exact_mut(columns).enumerate() {
                    let y = origin[1] + (block * ROWS + j) as f64 * spacing[1];
                    let (sin, cos) = Scalar::sin_cos(wave.turns[1] * y + wave.phase);
                    for ((height, c), s) in row.iter_mut().zip(cosines).zip(sines) {
                        *height += c * cos - s * sin;
                    }
                }
            }
        }
        heights
    }
}

#[cfg(test)]
mod tests;
