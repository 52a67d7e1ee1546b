//! Friction over slip velocity as two cubic arcs: up to a peak, and down to sliding.

use super::secant;
use crate::scalar::Scalar;

/// Friction that rises to a peak and falls to sliding: μ = μ_s (3 t − t³)/2 up to t = |s|/v_s = 1, then
/// μ = (μ_s + μ_c)/2 − (μ_s − μ_c)(3 t − t³)/4 with t from −1 at v_s to 1 at v_c, then μ_c. The slip
/// velocities v_s, v_c go with the rolling speed, or not: dry friction of a hard wheel.
///
/// D. Zimmer, *PlanarMechanics*, a library in Modelica: `SlipBasedWheelJoint` and
/// `DryFrictionWheelJoint`, without the 10⁻⁴ m/s that keep them from dividing by zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arcs<T> {
    /// μ_s, at the peak.
    pub breakaway: T,
    /// μ_c, in sliding.
    pub kinetic: T,
    /// v_s.
    pub peak: Onset<T>,
    /// v_c: beyond the peak.
    pub sliding: Onset<T>,
}

/// A slip velocity that goes with the rolling speed: max(q |r φ̇|, v_min).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Onset<T> {
    /// q, normalised slip.
    pub slip: T,
    /// v_min, m/s.
    pub speed_min: T,
}

impl<T: Scalar> Onset<T> {
    /// The slip velocity, m/s, at a rolling speed |r φ̇|, m/s.
    #[inline(always)]
    pub fn at(&self, rolling: T) -> T {
        (self.slip * rolling).max(self.speed_min)
    }

    fn map<U: Scalar>(&self, number: &mut dyn FnMut(T) -> U) -> Onset<U> {
        Onset {
            slip: number(self.slip),
            speed_min: number(self.speed_min),
        }
    }
}

impl<T: Scalar> Arcs<T> {
    /// μ/|s|, s/m, and dμ/d|s|, s/m, at a slip velocity and a rolling speed |r φ̇|, m/s.
    #[inline(always)]
    pub fn chord(&self, speed: T, rolling: T) -> (T, T) {
        let (peak, sliding) = (self.peak.at(rolling), self.sliding.at(rolling));
        let (half, two) = (T::from(0.5), T::from(2.0));
        let width = sliding - peak;
        let (up, up_slope) = arc(speed / peak);
        let (down, down_slope) = arc((two * speed - peak - sliding) / width);
        let falls = peak.less(speed);
        let fall = half * (self.breakaway - self.kinetic);
        let fallen = fall.mul_add(-down, half * (self.breakaway + self.kinetic));
        let friction = T::select(falls, fallen, self.breakaway * up);
        let rises = self.breakaway * up_slope / peak;
        let start = T::from(1.5) * self.breakaway / peak;
        (
            secant(friction, speed, start),
            T::select(falls, -(fall * down_slope * two / width), rises),
        )
    }

    /// The same in another scalar.
    pub(super) fn map<U: Scalar>(&self, number: &mut dyn FnMut(T) -> U) -> Arcs<U> {
        Arcs {
            breakaway: number(self.breakaway),
            kinetic: number(self.kinetic),
            peak: self.peak.map(number),
            sliding: self.sliding.map(number),
        }
    }
}

/// (3 t − t³)/2, level at −1 and 1 and beyond, and its slope.
#[inline(always)]
fn arc<T: Scalar>(t: T) -> (T, T) {
    let t = t.min(T::one()).max(-T::one());
    let square = t * t;
    (
        T::from(0.5) * t * (T::from(3.0) - square),
        T::from(1.5) * (T::one() - square),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planar::{Vec2, vec2};
    use crate::tire::Tire;

    fn onset(slip: f64, speed_min: f64) -> Onset<f64> {
        Onset { slip, speed_min }
    }

    /// The arcs of the two wheel joints of `PlanarMechanics`, by its formulas: zero, half of each arc
    /// (11/16 of the peak; the mean of both coefficients), peak and sliding, and level ends.
    #[test]
    fn known_answer_cubic_arcs() {
        let force = |peak: Onset<f64>, sliding: Onset<f64>, speed: f64, rolling: f64| {
            let arcs = Arcs {
                breakaway: 0.8,
                kinetic: 0.5,
                peak,
                sliding,
            };
            let tire = Tire::Cubic { arcs };
            let s = vec2(0.6, -0.8) * speed;
            let grip = tire.respond(s, Vec2::zero(), rolling, 1e-3);
            // A few roundings of numbers below 1: the force is opposed to slip.
            assert!((grip.force.x * 0.8 + grip.force.y * 0.6).abs() < 1e-15);
            -grip.force.x / 0.6
        };
        // Dry friction: the rolling speed is of no account.
        let (peak, slide) = (onset(0.0, 0.1), onset(0.0, 0.3));
        // Slip: the same speeds at 2 m/s; below 0.2 m/s the smallest.
        let (peak_slip, slide_slip) = (onset(0.05, 0.01), onset(0.15, 0.03));
        for (share, expected) in [
            (1e-200, 0.0),
            (0.5, 0.8 * 11.0 / 16.0),
            (1.0, 0.8),
            // A quarter into the fall, t = −1/2: (μ_s + μ_c)/2 + (μ_s − μ_c)/2 · 11/16.
            (1.5, 0.65 + 0.15 * 11.0 / 16.0),
            (2.0, 0.65),
            (3.0, 0.5),
            (40.0, 0.5),
        ] {
            for (found, of) in [
                (force(peak, slide, 0.1 * share, 7.0), "dry"),
                (force(peak_slip, slide_slip, 0.1 * share, 2.0), "slip"),
                (force(peak_slip, slide_slip, 0.01 * share, 0.1), "slow"),
            ] {
                // A few roundings of numbers below 1.
                assert!((found - expected).abs() < 1e-14, "{of} {share} {found}");
            }
        }
    }
}
