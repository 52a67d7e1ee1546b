//! Waves of equal period and amplitude, as forces of uneven ground.
//!
//! Time counts in cycles of the wave: t/T plus the phase over 2π. Every wave but the sawtooth starts
//! from phase 0 upward and is odd there.

use crate::scalar::Scalar;

/// A wave of amplitude 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waveform {
    /// No force at all.
    None,
    /// sin 2πc.
    Sine,
    /// (2/π) arcsin sin 2πc: straight lines through 0, 1, 0, −1, 0.
    Triangle,
    /// The sign of the sine: +1 on the first half, −1 on the second.
    Square,
    /// From −1 straight to +1 in a whole period, then a jump: what generators of signals call a
    /// sawtooth and offer beside sine and square.
    Sawtooth,
}

/// Cycles closer to a jump than this are on its right.
const SNAP: f64 = 1e-9;

impl Waveform {
    /// Value at `cycles`; at a jump that to its right.
    pub fn at(self, cycles: f64) -> f64 {
        let whole = (cycles + SNAP).floor();
        let c = (cycles - whole).max(0.0);
        match self {
            Waveform::None => 0.0,
            Waveform::Sine => Scalar::sin_cos(core::f64::consts::TAU * c).0,
            Waveform::Triangle if c < 0.25 => 4.0 * c,
            Waveform::Triangle if c < 0.75 => 2.0 - 4.0 * c,
            Waveform::Triangle => 4.0 * c - 4.0,
            Waveform::Square if c < 0.5 - SNAP => 1.0,
            Waveform::Square => -1.0,
            Waveform::Sawtooth => 2.0 * c - 1.0,
        }
    }

    /// Value at `cycles` of the smooth piece that holds at `inside`: at a jump the limit from there.
    pub fn piece(self, cycles: f64, inside: f64) -> f64 {
        match self {
            Waveform::None | Waveform::Sine | Waveform::Triangle => self.at(cycles),
            Waveform::Square => self.at(inside),
            Waveform::Sawtooth => 2.0 * (cycles - inside.floor()) - 1.0,
        }
    }

    /// Where in a cycle it jumps or kinks.
    pub fn breaks(self) -> &'static [f64] {
        match self {
            Waveform::None | Waveform::Sine => &[],
            Waveform::Triangle => &[0.25, 0.75],
            Waveform::Square => &[0.0, 0.5],
            Waveform::Sawtooth => &[0.0],
        }
    }

    /// Root of the mean of its square.
    pub fn effective(self) -> f64 {
        match self {
            Waveform::None => 0.0,
            Waveform::Sine => 0.5_f64.sqrt(),
            Waveform::Triangle | Waveform::Sawtooth => (1.0_f64 / 3.0).sqrt(),
            Waveform::Square => 1.0,
        }
    }

    /// Impulse of the first half of a cycle over amplitude and period: 1/π, 1/4, 1/2, and of the
    /// sawtooth −1/4. `[eq:impulses]`
    pub fn impulse(self) -> f64 {
        match self {
            Waveform::None => 0.0,
            Waveform::Sine => core::f64::consts::FRAC_1_PI,
            Waveform::Triangle => 0.25,
            Waveform::Square => 0.5,
            Waveform::Sawtooth => -0.25,
        }
    }
}
