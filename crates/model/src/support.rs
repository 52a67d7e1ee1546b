//! Normal loads, zero-moment point and tip-over margin of a rigid body on point contacts.

use crate::planar::{Vec2, vec2};
use crate::platform::MAX_WHEELS;
use crate::scalar::{Mask, Scalar};
use crate::solve::{MAX_DOF, invert, invert_known};

/// Contacts that carry a body, base axes.
///
/// The load of each is k (p₀ + p₁ x + p₂ y): the share of equally compliant contacts where four or
/// more leave it undetermined, and with three what equilibrium demands. A negative load means that
/// the contact would have to pull.
#[derive(Clone, Debug)]
pub struct Support<T> {
    points: Vec<Vec2<T>>,
    stiffness: Vec<T>,
    /// Inverse of the 3 × 3 matrix Σ k (1, x, y)(1, x, y)ᵀ, about the base's origin.
    inverse: [[T; 3]; 3],
    /// Corners of the support polygon, counter-clockwise, as indices.
    corners: Vec<usize>,
    /// Unit vectors along the edges that begin at each corner.
    edges: Vec<Vec2<T>>,
}

crate::lanewise!(Support { corners } state { points, stiffness, inverse, edges });

impl<T: Scalar> Support<T> {
    /// Contacts by place, m, and relative stiffness, of which 0 carries nothing; `None` for fewer than
    /// three, for more than [`MAX_WHEELS`], and for contacts on one line, which carry no plane.
    pub fn new(contacts: &[(Vec2<T>, T)]) -> Option<Self> {
        if contacts.len() < 3 || contacts.len() > MAX_WHEELS {
            return None;
        }
        let mut sums = [[T::zero(); MAX_DOF]; MAX_DOF];
        for (point, stiffness) in contacts {
            let row = [T::one(), point.x, point.y];
            for a in 0..3 {
                for b in 0..3 {
                    sums[a][b] = (*stiffness * row[a]).mul_add(row[b], sums[a][b]);
                }
            }
        }
        let points: Vec<Vec2<T>> = contacts.iter().map(|(point, _)| *point).collect();
        let carries = |k: &usize| contacts[*k].1.lane(0) > 0.0;
        let corners = hull(&points, (0..points.len()).filter(carries).collect());
        let nominal = |k: usize| [points[k].x.lane(0), points[k].y.lane(0)];
        let (mut area, mut size) = (0.0, 0.0_f64);
        for (k, &corner) in corners.iter().enumerate() {
            let (p, q) = (nominal(corner), nominal(corners[(k + 1) % corners.len()]));
            area += 0.5 * (p[0] * q[1] - p[1] * q[0]);
            size = size.max((q[0] - p[0]) * (q[0] - p[0]) + (q[1] - p[1]) * (q[1] - p[1]));
        }
        if corners.len() < 3 || area <= 1e-6 * size {
            return None;
        }
        let full = invert(3, &sums);
        let mut inverse = [[T::zero(); 3]; 3];
        for a in 0..3 {
            inverse[a].copy_from_slice(&full[a][..3]);
        }
        let edges = (0..corners.len())
            .map(|k| {
                let edge = points[corners[(k + 1) % corners.len()]] - points[corners[k]];
                edge * (T::one() / edge.dot(edge).sqrt())
            })
            .collect();
        Some(Support {
            edges,
            stiffness: contacts.iter().map(|(_, stiffness)| *stiffness).collect(),
            points,
            inverse,
            corners,
        })
    }

    /// Corners of the support polygon, counter-clockwise, m.
    pub fn polygon(&self) -> Vec<Vec2<T>> {
        self.corners.iter().map(|&k| self.points[k]).collect()
    }

    /// The zero-moment point, m, of a body of normal weight `weight`, N, with its center of mass at
    /// `center`, m, and `height`, m, on which the ground acts with the tangential force `force`, N.
    /// `[eq:zero-moment-point]`
    #[inline(always)]
    pub fn zero_moment_point(weight: T, center: Vec2<T>, height: T, force: Vec2<T>) -> Vec2<T> {
        center - force * (height / weight)
    }

    /// Loads, N, whose sum is `weight`, N, and whose center is `point`, m. `[eq:normal-loads]`
    #[inline(always)]
    pub fn loads(&self, weight: T, point: Vec2<T>) -> [T; MAX_WHEELS] {
        let totals = [weight, weight * point.x, weight * point.y];
        let mut plane = [T::zero(); 3];
        for a in 0..3 {
            for b in 0..3 {
                plane[a] = self.inverse[a][b].mul_add(totals[b], plane[a]);
            }
        }
        let mut loads = [T::zero(); MAX_WHEELS];
        for k in 0..self.points.len() {
            let point = self.points[k];
            let share = plane[0] + plane[1].mul_add(point.x, plane[2] * point.y);
            loads[k] = self.stiffness[k] * share;
        }
        loads
    }

    /// Loads as an affine function of the tangential force F of the ground, base axes: Nᵢ = aᵢ + bᵢ · F,
    /// for a body of normal weight `weight`, N, with its center of mass at `center`, m, and `height`, m,
    /// without the contacts that are `lifted`. Where those left carry no plane, they carry what they can.
    /// `[eq:normal-loads]`
    #[inline(always)]
    pub fn affine(
        &self,
        weight: T,
        center: Vec2<T>,
        height: T,
        lifted: &[T::Mask; MAX_WHEELS],
    ) -> ([T; MAX_WHEELS], [Vec2<T>; MAX_WHEELS]) {
        let mut inverse = self.inverse;
        if (0..self.points.len()).any(|k| lifted[k].any()) {
            let mut sums = [[T::zero(); MAX_DOF]; MAX_DOF];
            let mut whole = T::zero();
            for k in 0..self.points.len() {
                let row = [T::one(), self.points[k].x, self.points[k].y];
                let stiffness = T::select(lifted[k], T::zero(), self.stiffness[k]);
                for a in 0..3 {
                    whole = (self.stiffness[k] * row[a]).mul_add(row[a], whole);
                    for b in 0..3 {
                        sums[a][b] = (stiffness * row[a]).mul_add(row[b], sums[a][b]);
                    }
                }
            }
            let rounding = if T::IS_NARROW { T::ROUNDING } else { 1e-9 };
            let left = invert_known(3, &sums, whole * T::from(rounding));
            for a in 0..3 {
                inverse[a].copy_from_slice(&left[a][..3]);
            }
        }
        let mut still = [T::zero(); MAX_WHEELS];
        let mut shift = [Vec2::zero(); MAX_WHEELS];
        for k in 0..self.points.len() {
            let stiffness = T::select(lifted[k], T::zero(), self.stiffness[k]);
            let row = [T::one(), self.points[k].x, self.points[k].y];
            let mut of = [T::zero(); 3];
            for b in 0..3 {
                for a in 0..3 {
                    of[b] = row[a].mul_add(inverse[a][b], of[b]);
                }
                of[b] *= stiffness;
            }
            still[k] = weight * of[2].mul_add(center.y, of[1].mul_add(center.x, of[0]));
            shift[k] = vec2(of[1], of[2]) * -height;
        }
        (still, shift)
    }

    /// Distance of a zero-moment point to the nearest edge of the support polygon, m; negative
    /// outside, where the body tips over that edge. `[eq:tip-over]`
    #[inline(always)]
    pub fn margin(&self, point: Vec2<T>) -> T {
        let mut margin = T::from(T::LARGEST);
        for k in 0..self.corners.len() {
            let from = self.points[self.corners[k]];
            margin = margin.min(self.edges[k].cross(point - from));
        }
        margin
    }
}

/// Corners of the convex hull of those points that `order` names, counter-clockwise, on nominal
/// values (monotone chains).
fn hull<T: Scalar>(points: &[Vec2<T>], mut order: Vec<usize>) -> Vec<usize> {
    let at = |k: usize| (points[k].x.lane(0), points[k].y.lane(0));
    order.sort_by(|&a, &b| {
        let ((ax, ay), (bx, by)) = (at(a), at(b));
        ax.total_cmp(&bx).then(ay.total_cmp(&by))
    });
    let left_turn = |a: usize, b: usize, c: usize| {
        let ((ax, ay), (bx, by), (cx, cy)) = (at(a), at(b), at(c));
        (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0.0
    };
    let mut corners: Vec<usize> = Vec::new();
    for backwards in [false, true] {
        let start = corners.len();
        let mut push = |k: usize| {
            while corners.len() >= start + 2
                && !left_turn(corners[corners.len() - 2], corners[corners.len() - 1], k)
            {
                corners.pop();
            }
            corners.push(k);
        };
        if backwards {
            order.iter().rev().for_each(|&k| push(k));
        } else {
            order.iter().for_each(|&k| push(k));
        }
        // The last corner of a chain is the first of the next.
        corners.pop();
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Support<f64> {
        let corner = |x, y| (vec2(x, y), 1.0);
        Support::new(&[
            corner(1.0, 1.0),
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(-1.0, 1.0),
            // Inside the polygon: it carries, and is no corner.
            corner(0.25, 0.0),
        ])
        .expect("a square")
    }

    #[test]
    fn known_answer_margin_of_a_square() {
        let support = square();
        assert!((support.margin(vec2(0.5, -0.25)) - 0.5).abs() < 1e-15);
        assert!((support.margin(vec2(1.25, 0.0)) + 0.25).abs() < 1e-15);
    }

    #[test]
    fn invariant_loads_balance_the_zero_moment_point() {
        let support = square();
        let at = Support::zero_moment_point(50.0, vec2(0.1, -0.2), 0.3, vec2(20.0, -5.0));
        let loads = support.loads(50.0, at);
        let mut sums = [0.0; 3];
        for (load, point) in loads.iter().zip(&support.points) {
            sums[0] += load;
            sums[1] += load * point.x;
            sums[2] += load * point.y;
        }
        // Three sums of five terms of up to 50 N: a few units in the last place.
        assert!((sums[0] - 50.0).abs() < 1e-13);
        assert!((sums[1] - 50.0 * at.x).abs() < 1e-13);
        assert!((sums[2] - 50.0 * at.y).abs() < 1e-13);
    }

    #[test]
    fn refusal_of_contacts_on_a_line() {
        let contact = |x: f64| (vec2(x, 2.0 * x), 1.0);
        assert!(Support::<f64>::new(&[contact(0.0), contact(1.0), contact(3.0)]).is_none());
        assert!(Support::<f64>::new(&[contact(0.0), contact(1.0)]).is_none());
    }
}
