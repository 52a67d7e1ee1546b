//! Signals of time, as vectors write them.

use appell_model::scalar::Scalar;
use serde::Deserialize;

/// A signal of time.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Signal {
    /// c
    Const {
        /// Value.
        value: f64,
    },
    /// c + A sin(ωt + p)
    Sine {
        /// Amplitude.
        amplitude: f64,
        /// Angular frequency, rad/s.
        omega: f64,
        /// Phase, rad.
        #[serde(default)]
        phase: f64,
        /// Offset.
        #[serde(default)]
        offset: f64,
    },
    /// ±A about the offset, + first.
    Square {
        /// Amplitude.
        amplitude: f64,
        /// Period, s.
        period: f64,
        /// Offset.
        #[serde(default)]
        offset: f64,
    },
    /// Triangle about the offset, rising first.
    Triangle {
        /// Amplitude.
        amplitude: f64,
        /// Period, s.
        period: f64,
        /// Offset.
        #[serde(default)]
        offset: f64,
    },
    /// Steps, right-continuous.
    PiecewiseConst {
        /// Times of the steps, s.
        t: Vec<f64>,
        /// Values from those times on.
        v: Vec<f64>,
    },
    /// Straight lines between nodes, held outside.
    PiecewiseLinear {
        /// Times of the nodes, s.
        t: Vec<f64>,
        /// Values at the nodes.
        v: Vec<f64>,
    },
    /// Σ c_k t^k
    Poly {
        /// Coefficients, constant first.
        coef: Vec<f64>,
    },
    /// Sum of signals.
    Sum {
        /// Terms.
        terms: Vec<Signal>,
    },
}

impl Signal {
    /// Value at time t, s.
    pub fn at(&self, t: f64) -> f64 {
        use std::f64::consts::{FRAC_2_PI, TAU};
        match self {
            Signal::Const { value } => *value,
            Signal::Sine {
                amplitude,
                omega,
                phase,
                offset,
            } => offset + amplitude * Scalar::sin_cos(omega * t + phase).0,
            Signal::Square {
                amplitude,
                period,
                offset,
            } => {
                let cycles = t / period;
                let first = cycles - cycles.floor() < 0.5;
                offset + if first { *amplitude } else { -amplitude }
            }
            Signal::Triangle {
                amplitude,
                period,
                offset,
            } => {
                let sine = Scalar::sin_cos(TAU * t / period).0;
                let cosine = (1.0 - sine * sine).max(0.0).sqrt();
                offset + amplitude * FRAC_2_PI * Scalar::atan2(sine, cosine)
            }
            Signal::PiecewiseConst { t: times, v } => {
                let index = times.partition_point(|&at| at <= t).max(1) - 1;
                v[index]
            }
            Signal::PiecewiseLinear { t: times, v } => {
                let next = times.partition_point(|&at| at <= t);
                if next == 0 {
                    v[0]
                } else if next == times.len() {
                    v[next - 1]
                } else {
                    let share = (t - times[next - 1]) / (times[next] - times[next - 1]);
                    v[next - 1] + share * (v[next] - v[next - 1])
                }
            }
            Signal::Poly { coef } => coef.iter().rev().fold(0.0, |sum, c| sum * t + c),
            Signal::Sum { terms } => terms.iter().map(|term| term.at(t)).sum(),
        }
    }

    /// Times up to `end` at which the signal jumps or kinks.
    pub(super) fn breaks(&self, end: f64, times: &mut Vec<f64>) {
        match self {
            Signal::Const { .. } | Signal::Sine { .. } | Signal::Poly { .. } => {}
            Signal::Square { period, .. } => grid(0.5 * period, 0.0, end, times),
            Signal::Triangle { period, .. } => grid(0.5 * period, 0.25 * period, end, times),
            Signal::PiecewiseConst { t, .. } | Signal::PiecewiseLinear { t, .. } => {
                times.extend_from_slice(t)
            }
            Signal::Sum { terms } => terms.iter().for_each(|term| term.breaks(end, times)),
        }
    }
}

fn grid(period: f64, first: f64, end: f64, times: &mut Vec<f64>) {
    let count = ((end - first) / period).floor().max(0.0) as usize;
    times.extend((0..=count.min(1_000_000)).map(|k| first + k as f64 * period));
}
