//! Random numbers keyed by (seed, trial, signal): Philox4x32-10 counters and normal deviates.
//!
//! J. K. Salmon et al., *Parallel random numbers: as easy as 1, 2, 3*, SC11 (2011). A draw is a
//! function of its key and counter, so that one more sensor, or another order of evaluation,
//! changes no other number.

use appell_model::lanes::LANES_MAX;
use appell_model::lanewise::Lanewise;
use appell_model::scalar::Scalar;

/// A stream of normal deviates for one signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    key: [u32; 2],
}

impl Stream {
    /// The stream of a signal path within a trial of a seed.
    pub fn new(seed: u64, trial: u64, path: &str) -> Self {
        // FNV-1a over all three, then a finaliser that spreads it over 64 bits.
        let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
        let numbers = seed.to_le_bytes().into_iter().chain(trial.to_le_bytes());
        for byte in numbers.chain(path.bytes()) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        hash ^= hash >> 31;
        Stream {
            key: [hash as u32, (hash >> 32) as u32],
        }
    }

    /// Two independent uniform deviates in (0, 1), drawn at `counter`.
    pub fn uniforms(&self, counter: u64) -> [f64; 2] {
        let words = philox([counter as u32, (counter >> 32) as u32, 0, 0], self.key);
        [uniform(words[0], words[1]), uniform(words[2], words[3])]
    }

    /// Two independent standard normal deviates, drawn at `counter`.
    pub fn normals(&self, counter: u64) -> [f64; 2] {
        normal_pair(self.uniforms(counter))
    }
}

/// The streams of one signal in every lane.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Streams([[u32; 2]; LANES_MAX]);

impl Streams {
    /// The same stream in every lane.
    pub fn new(stream: Stream) -> Self {
        Streams([stream.key; LANES_MAX])
    }

    /// Two independent standard normal deviates, drawn at each lane's counter.
    #[inline(always)]
    pub fn normals<T: Scalar>(&self, counters: &[u64]) -> [T; 2] {
        let mut pairs = [[0.0; 2]; LANES_MAX];
        for lane in 0..T::LANES {
            let counter = counters[lane];
            let words = philox([counter as u32, (counter >> 32) as u32, 0, 0], self.0[lane]);
            pairs[lane] = [uniform(words[0], words[1]), uniform(words[2], words[3])];
        }
        normal_pair([
            T::from_lanes(|lane| pairs[lane][0]),
            T::from_lanes(|lane| pairs[lane][1]),
        ])
    }
}

impl Lanewise for Streams {
    type One = Streams;

    fn fits(&self, _one: &Streams) -> bool {
        true
    }

    fn put(&mut self, lane: usize, one: &Streams) {
        self.0[lane] = one.0[0];
    }
}

/// 53 bits of two words, shifted off zero by half a step.
#[inline(always)]
fn uniform(high: u32, low: u32) -> f64 {
    let bits = (u64::from(high) << 21) ^ u64::from(low >> 11);
    (bits as f64 + 0.5) / (1_u64 << 53) as f64
}

/// Two independent normal deviates from two uniform ones (Box–Muller).
#[inline(always)]
fn normal_pair<T: Scalar>([first, second]: [T; 2]) -> [T; 2] {
    let radius = (T::from(-2.0) * first.ln()).sqrt();
    let (sin, cos) = (T::from(std::f64::consts::TAU) * second).sin_cos();
    [radius * cos, radius * sin]
}

/// Philox4x32 with ten rounds.
#[inline(always)]
fn philox(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let first = 0xd251_1f53_u64 * u64::from(counter[0]);
        let second = 0xcd9e_8d57_u64 * u64::from(counter[2]);
        counter = [
            (second >> 32) as u32 ^ counter[1] ^ key[0],
            second as u32,
            (first >> 32) as u32 ^ counter[3] ^ key[1],
            first as u32,
        ];
        key[0] = key[0].wrapping_add(0x9e37_79b9);
        key[1] = key[1].wrapping_add(0xbb67_ae85);
    }
    counter
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known answers that its authors publish for Philox4x32-10.
    #[test]
    fn peer_philox_known_answers() {
        assert_eq!(
            philox([0; 4], [0; 2]),
            [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]
        );
        assert_eq!(
            philox([u32::MAX; 4], [u32::MAX; 2]),
            [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]
        );
        assert_eq!(
            philox(
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                [0xa409_3822, 0x299f_31d0]
            ),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    /// Mean and variance of 2·10⁵ deviates within five standard errors.
    #[test]
    fn invariant_moments_of_the_normals() {
        let stream = Stream::new(7, 0, "robot.a.sensor.pose.x");
        let count = 100_000;
        let (mut sum, mut square) = (0.0, 0.0);
        for k in 0..count {
            for value in stream.normals(k) {
                sum += value;
                square += value * value;
            }
        }
        let n = 2.0 * count as f64;
        assert!((sum / n).abs() < 5.0 / n.sqrt());
        assert!((square / n - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
    }

    #[test]
    fn invariant_streams_differ_by_every_part_of_the_key() {
        let base = Stream::new(1, 2, "a");
        for other in [
            Stream::new(2, 2, "a"),
            Stream::new(1, 3, "a"),
            Stream::new(1, 2, "b"),
        ] {
            assert_ne!(base.normals(0), other.normals(0));
        }
    }
}
