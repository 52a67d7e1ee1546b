//! The spectrum of rough ground: on paper, and as measured from sections.

use std::f64::consts::{PI, TAU};

use appell_model::scalar::Scalar;

use super::{CLASS_PSD, Roughness};

const LONGEST: f64 = 10.0;
const SHORTEST: f64 = 0.2;
const WAVES: usize = 96;
/// C of class C, m.
const SCALE: f64 = 256e-6 * 0.01;

/// SplitMix64 as a function of its counter.
fn random(seed: u64) -> impl Fn(u64) -> f64 {
    move |index| {
        let mut z = (seed << 32 | index).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn ground(seed: u64) -> Roughness {
    Roughness::new(CLASS_PSD[2], SHORTEST, LONGEST, WAVES, random(seed))
}

/// Height at a point, m, wave by wave.
fn height(ground: &Roughness, x: f64, y: f64) -> f64 {
    let of = |wave: &super::Wave| {
        let [p, q] = wave.turns;
        wave.amplitude * Scalar::sin_cos(p * x + q * y + wave.phase).1
    };
    ground.waves.iter().map(of).sum()
}

/// S(k) of the derivation, m².
fn radial(k: f64) -> f64 {
    let most = 1.0 / SHORTEST;
    let across = (most * most - k * k).sqrt();
    SCALE * (Scalar::atan2(across, k) / (k * k) + 1.0 / (k * across))
}

/// G(n) of a field of waves k ≥ `least`, by the trapezoidal rule in t with
/// k² = m² + (N² − m²) sin² t, m = max(n, `least`).
fn section(n: f64, least: f64) -> f64 {
    let most = 1.0 / SHORTEST;
    let from = n.max(least);
    let width = most * most - from * from;
    let steps = 4000;
    let h = 0.5 * PI / f64::from(steps);
    // The midpoint rule: the ends are singular in k, and no point of it.
    (0..steps)
        .map(|step| {
            let (sin, cos) = Scalar::sin_cos((f64::from(step) + 0.5) * h);
            let k = (from * from + width * sin * sin).sqrt();
            let slope = width * sin * cos / k;
            2.0 / PI * radial(k) / (k * k - n * n).sqrt() * slope * h
        })
        .sum()
}

#[test]
fn closed_form_waves_of_all_directions_give_sections_the_law() {
    let least = 1.0 / LONGEST;
    for n in [0.1, 0.15, 0.5, 1.0, 3.0, 4.9] {
        let law = SCALE / (n * n);
        let got = section(n, least);
        // The integrand is smooth and periodic in t: the rule converges to rounding.
        assert!((got / law - 1.0).abs() < 1e-9, "G({n}) = {got}, not {law}");
    }
    // Below the band, where N is as good as infinite: what is left are waves seen aslant.
    for n in [0.02, 0.05, 0.09] {
        let share = n / least;
        let law = SCALE / (n * n) * (1.0 - (1.0 - share * share).sqrt());
        let got = section(n, least);
        // Terms of (m/N)² = 4e-4 are left out of the formula.
        assert!((got / law - 1.0).abs() < 2e-3, "G({n}) = {got}, not {law}");
    }
}

#[test]
fn closed_form_variance() {
    let ground = ground(1);
    let variance: f64 = ground
        .waves
        .iter()
        .map(|w| 0.5 * w.amplitude * w.amplitude)
        .sum();
    let ratio = SHORTEST / LONGEST;
    let whole = SCALE * LONGEST * Scalar::atan2((1.0 - ratio * ratio).sqrt(), ratio);
    // Sums of 96 rounded numbers.
    assert!((variance / whole - 1.0).abs() < 1e-12);
    // What the law has in the band, and what comes from below it, by quadrature.
    let band = SCALE * (LONGEST - SHORTEST);
    let steps = 2000;
    let h = 1.0 / LONGEST / f64::from(steps);
    let below: f64 = (0..steps)
        .map(|step| section((f64::from(step) + 0.5) * h, 1.0 / LONGEST) * h)
        .sum();
    // G has a vertical tangent at the lower end of the band: the midpoint rule errs by about
    // steps^-1.5 there.
    assert!((variance / (band + below) - 1.0).abs() < 1e-4);
}

#[test]
fn invariant_waves_stay_in_their_band_and_look_everywhere() {
    let ground = ground(2);
    let mut quadrants = [0; 4];
    for wave in &ground.waves {
        let [p, q] = wave.turns;
        let length = TAU / appell_model::math::hypot(p, q);
        assert!((SHORTEST * (1.0 - 1e-12)..=LONGEST * (1.0 + 1e-12)).contains(&length));
        let angle = Scalar::atan2(q, p).rem_euclid(PI);
        quadrants[(angle / PI * 4.0) as usize % 4] += 1;
    }
    // 24 each: directions a golden part of a half turn apart are off by two at the most.
    assert!(
        quadrants.iter().all(|count| (22..=26).contains(count)),
        "{quadrants:?}"
    );
}

/// In-place transform of a power of two of complex numbers, decimation in time.
fn transform(values: &mut [[f64; 2]]) {
    let count = values.len();
    if count == 1 {
        return;
    }
    let mut even: Vec<_> = values.iter().copied().step_by(2).collect();
    let mut odd: Vec<_> = values.iter().copied().skip(1).step_by(2).collect();
    transform(&mut even);
    transform(&mut odd);
    for k in 0..count / 2 {
        let (sin, cos) = Scalar::sin_cos(-TAU * k as f64 / count as f64);
        let turned = [
            odd[k][0] * cos - odd[k][1] * sin,
            odd[k][0] * sin + odd[k][1] * cos,
        ];
        values[k] = [even[k][0] + turned[0], even[k][1] + turned[1]];
        values[k + count / 2] = [even[k][0] - turned[0], even[k][1] - turned[1]];
    }
}

/// Variance in bands of frequencies (cycles/m), by a periodogram with Hann's window, m².
fn bands(heights: &[f64], spacing: f64, edges: &[f64]) -> Vec<f64> {
    let count = heights.len();
    let mut values: Vec<[f64; 2]> = (0..count)
        .map(|k| {
            let (_, cos) = Scalar::sin_cos(TAU * k as f64 / count as f64);
            [heights[k] * 0.5 * (1.0 - cos), 0.0]
        })
        .collect();
    transform(&mut values);
    // The window's mean square is 3/8; two sides make one.
    let power = |k: usize| {
        let [re, im] = values[k];
        2.0 * (re * re + im * im) / (count as f64 * count as f64 * 0.375)
    };
    let bin = |frequency: f64| (frequency * count as f64 * spacing).round() as usize;
    edges
        .windows(2)
        .map(|pair| (bin(pair[0])..bin(pair[1])).map(power).sum())
        .collect()
}

#[test]
fn invariant_sections_have_the_law_in_every_direction() {
    // 51.2 m, bins of 1/51.2 cycles/m; waves of 0.2 m are just seen.
    let (count, spacing) = (512, 0.1);
    let edges = [0.2, 0.4, 0.8, 1.6, 3.2];
    let seeds = 120;
    let angles = [0.0, 0.4, 1.1, 2.5];
    for angle in angles {
        let (sin, cos) = Scalar::sin_cos(angle);
        let mut samples = vec![Vec::new(); edges.len() - 1];
        for seed in 0..seeds {
            let ground = ground(1000 + seed);
            let at = |k: usize| {
                let way = k as f64 * spacing;
                height(&ground, 3.0 + way * cos, -7.0 + way * sin)
            };
            let heights: Vec<f64> = (0..count).map(at).collect();
            for (sample, power) in samples.iter_mut().zip(bands(&heights, spacing, &edges)) {
                sample.push(power);
            }
        }
        for (k, sample) in samples.iter().enumerate() {
            // The edges as the bins have them: a bin reaches half its width to both sides.
            let width = 1.0 / (count as f64 * spacing);
            let [from, to] = [edges[k], edges[k + 1]].map(|n| ((n / width).round() - 0.5) * width);
            let law = SCALE * (1.0 / from - 1.0 / to);
            let mean = sample.iter().sum::<f64>() / sample.len() as f64;
            let spread: f64 = sample.iter().map(|x| (x - mean) * (x - mean)).sum();
            let error = (spread / (sample.len() * (sample.len() - 1)) as f64).sqrt();
            let bias = {
                // The window spreads a line over bins 0, ±1 by 2/3, 1/6, 1/6: 2 G″ width²/12 on
                // G, with G″ = 6 G/n², is at most (width/n)².
                (width / from) * (width / from)
            };
            // Four standard errors fail one honest check in 16 000; they are small enough to see a
            // law that is off by a third.
            assert!(error < 0.06 * law, "{error} of {law}");
            assert!(
                (mean - law).abs() < 4.0 * error + bias * law,
                "at {angle} rad, band {k}: {mean} ± {error}, not {law}"
            );
        }
    }
}

#[test]
fn invariant_samples_are_the_heights() {
    let ground = ground(4);
    let (origin, spacing) = ([-3.0, 5.0], [0.05, 0.04]);
    let heights = ground.sample(origin, spacing, 40, 30);
    assert_eq!(heights.len(), 1200);
    for j in 0..30 {
        for i in 0..40 {
            let x = origin[0] + i as f64 * spacing[0];
            let y = origin[1] + j as f64 * spacing[1];
            let height = height(&ground, x, y);
            // Angles of some 300 rad are rounded to 6e-14, times 0.1 m.
            assert!((heights[j * 40 + i] - height).abs() < 1e-13);
        }
    }
    assert!(ground.sample(origin, spacing, 0, 30).is_empty());
}

#[test]
fn invariant_same_seed_same_ground() {
    assert_eq!(ground(5), ground(5));
    let heights = |seed| ground(seed).sample([0.0; 2], [0.1; 2], 8, 8);
    assert_eq!(heights(5), heights(5));
    assert_ne!(heights(5), heights(6));
    // A rougher class is the same ground, higher: each class has twice the heights of the last.
    let rough: Roughness = Roughness::new(CLASS_PSD[3], SHORTEST, LONGEST, WAVES, random(5));
    for (one, two) in ground(5).waves.iter().zip(&rough.waves) {
        assert!((two.amplitude / one.amplitude - 2.0).abs() < 1e-12);
        assert_eq!(one.turns, two.turns);
    }
}
