//! Cubic splines.

/// A cubic spline with continuous second derivative, not-a-knot at both ends.
#[derive(Clone, Debug)]
pub(crate) struct Spline {
    t: Vec<f64>,
    values: Vec<f64>,
    /// Second derivative at each knot.
    bend: Vec<f64>,
}

impl Spline {
    /// Through at least four points of increasing times.
    pub fn new(t: &[f64], values: &[f64]) -> Spline {
        let n = t.len();
        let h = |k: usize| t[k + 1] - t[k];
        let slope = |k: usize| (values[k + 1] - values[k]) / h(k);
        // Rows of the tridiagonal system for the inner knots; not-a-knot gives the outer ones as
        // straight continuations: M₀ = M₁ − (h₀/h₁)(M₂ − M₁), and its mirror image.
        let inner = n - 2;
        let mut diagonal: Vec<f64> = (1..=inner).map(|k| 2.0 * (h(k - 1) + h(k))).collect();
        let mut lower: Vec<f64> = (1..=inner).map(|k| h(k - 1)).collect();
        let mut upper: Vec<f64> = (1..=inner).map(h).collect();
        let mut right: Vec<f64> = (1..=inner)
            .map(|k| 6.0 * (slope(k) - slope(k - 1)))
            .collect();
        let (first, last) = (h(0) / h(1), h(n - 2) / h(n - 3));
        diagonal[0] += h(0) * (1.0 + first);
        upper[0] -= h(0) * first;
        diagonal[inner - 1] += h(n - 2) * (1.0 + last);
        lower[inner - 1] -= h(n - 2) * last;
        for k in 1..inner {
            let factor = lower[k] / diagonal[k - 1];
            diagonal[k] -= factor * upper[k - 1];
            right[k] -= factor * right[k - 1];
        }
        let mut bend = vec![0.0; n];
        for k in (0..inner).rev() {
            let known = if k + 1 < inner {
                upper[k] * bend[k + 2]
            } else {
                0.0
            };
            bend[k + 1] = (right[k] - known) / diagonal[k];
        }
        bend[0] = bend[1] - first * (bend[2] - bend[1]);
        bend[n - 1] = bend[n - 2] + last * (bend[n - 2] - bend[n - 3]);
        Spline {
            t: t.to_vec(),
            values: values.to_vec(),
            bend,
        }
    }

    /// Value, first and second derivative.
    pub fn at(&self, t: f64) -> [f64; 3] {
        let next = self.t.partition_point(|&knot| knot <= t);
        let k = next.clamp(1, self.t.len() - 1) - 1;
        let h = self.t[k + 1] - self.t[k];
        let (left, right) = ((self.t[k + 1] - t) / h, (t - self.t[k]) / h);
        let (a, b) = (self.bend[k], self.bend[k + 1]);
        let (p, q) = (self.values[k], self.values[k + 1]);
        let cubic = |s: f64| (s * s * s - s) * h * h / 6.0;
        let steep = |s: f64| (3.0 * s * s - 1.0) * h / 6.0;
        [
            left * p + right * q + cubic(left) * a + cubic(right) * b,
            (q - p) / h - steep(left) * a + steep(right) * b,
            left * a + right * b,
        ]
    }

    /// Through at least three points that repeat: the last value is the first one.
    ///
    /// The influence of an end dies out by the factor 2 − √3 per knot: after 32 repeated knots on
    /// either side it is below rounding.
    pub fn periodic(t: &[f64], values: &[f64]) -> Spline {
        let cycle = t.len() - 1;
        let period = t[cycle] - t[0];
        let turns = 32_usize.div_ceil(cycle);
        let (mut times, mut repeated) = (Vec::new(), Vec::new());
        for turn in 0..=2 * turns {
            let shift = (turn as f64 - turns as f64) * period;
            times.extend(t[..cycle].iter().map(|time| time + shift));
            repeated.extend_from_slice(&values[..cycle]);
        }
        Spline::new(&times, &repeated)
    }
}
