//! Small dense algebra on the stack, generic in the scalar.

use crate::scalar::{Mask, Scalar};

/// Largest number of velocity coordinates of a platform: three of the body and the steered wheels.
pub const MAX_DOF: usize = 8;

/// A vector over the velocity coordinates; entries past the platform's own are zero.
pub type Row<T> = [T; MAX_DOF];
/// A square matrix over the velocity coordinates.
pub type Square<T> = [[T; MAX_DOF]; MAX_DOF];

/// A row of zeros.
#[inline(always)]
pub fn zero_row<T: Scalar>() -> Row<T> {
    [T::zero(); MAX_DOF]
}

/// Scalar product of the first `n` entries.
#[inline(always)]
pub fn dot<T: Scalar>(n: usize, a: &Row<T>, b: &[T]) -> T {
    let mut sum = T::zero();
    for k in 0..n {
        sum = a[k].mul_add(b[k], sum);
    }
    sum
}

/// The product of the leading n × n block with a vector.
#[inline(always)]
pub fn product<T: Scalar>(n: usize, matrix: &Square<T>, vector: &[T]) -> Row<T> {
    let mut result = zero_row();
    for i in 0..n {
        result[i] = dot(n, &matrix[i], vector);
    }
    result
}

/// Adds w · a bᵀ to the leading n × n block.
#[inline(always)]
pub fn add_outer<T: Scalar>(n: usize, matrix: &mut Square<T>, weight: T, a: &Row<T>, b: &Row<T>) {
    for i in 0..n {
        let left = weight * a[i];
        for j in 0..n {
            matrix[i][j] = left.mul_add(b[j], matrix[i][j]);
        }
    }
}

fused! {
    /// Inverse of a symmetric positive definite matrix of size n, by Gauss–Jordan without pivoting
    /// (stable for such matrices).
    pub fn invert<T: Scalar>(n: usize, matrix: &Square<T>) -> Square<T> {
        inverse(n, matrix)
    }
}

fused! {
    /// [`product`] outside a step.
    pub fn times<T: Scalar>(n: usize, matrix: &Square<T>, row: &Row<T>) -> Row<T> {
        product(n, matrix, row)
    }
}

/// [`invert`] within a step.
#[inline(always)]
pub(crate) fn inverse<T: Scalar>(n: usize, matrix: &Square<T>) -> Square<T> {
    invert_known(n, matrix, T::zero())
}

/// Inverse of a symmetric positive semidefinite matrix of size n on the directions that it knows: a
/// pivot below `floor` marks one that it does not, which maps to zero.
#[inline(always)]
pub fn invert_known<T: Scalar>(n: usize, matrix: &Square<T>, floor: T) -> Square<T> {
    let mut a = *matrix;
    let mut known = [T::Mask::splat(true); MAX_DOF];
    for k in 0..n {
        known[k] = a[k][k].less_equal(floor).not();
        let pivot = T::one() / T::select(known[k], a[k][k], T::one());
        a[k][k] = T::one();
        for j in 0..n {
            a[k][j] = T::select(known[k], a[k][j] * pivot, T::zero());
        }
        for i in 0..n {
            if i != k {
                let factor = T::select(known[k], a[i][k], T::zero());
                a[i][k] = T::zero();
                for j in 0..n {
                    a[i][j] = (-factor).mul_add(a[k][j], a[i][j]);
                }
            }
        }
    }
    // Symmetric by theory; made so to the last bit.
    for i in 0..n {
        for j in 0..n {
            let both = known[i].and(known[j]);
            a[i][j] = T::select(both, a[i.min(j)][i.max(j)], T::zero());
        }
    }
    a
}

/// Solves a symmetric positive semidefinite system of size n ≤ N by LDLᵀ; a pivot below `floor`
/// marks a redundant row, whose unknown is set to zero.
#[inline(always)]
pub fn solve_semidefinite<T: Scalar, const N: usize>(
    n: usize,
    mut a: [[T; N]; N],
    mut b: [T; N],
    floor: T,
) -> [T; N] {
    let mut inverse = [T::zero(); N];
    for k in 0..n {
        let regular = floor.less(a[k][k]);
        inverse[k] = T::select(
            regular,
            T::one() / T::select(regular, a[k][k], T::one()),
            T::zero(),
        );
        for i in k + 1..n {
            let factor = a[i][k] * inverse[k];
            for j in k + 1..n {
                a[i][j] = (-factor).mul_add(a[k][j], a[i][j]);
            }
            b[i] = (-factor).mul_add(b[k], b[i]);
        }
    }
    for k in (0..n).rev() {
        let mut sum = b[k];
        for j in k + 1..n {
            sum = (-a[k][j]).mul_add(b[j], sum);
        }
        b[k] = sum * inverse[k];
    }
    b
}

/// A linear condition on the acceleration: row · v̇ = value, where `active`.
#[derive(Clone, Copy, Debug)]
pub struct Condition<T: Scalar> {
    /// Coefficients over the velocity coordinates.
    pub row: Row<T>,
    /// Right-hand side.
    pub value: T,
    /// Lanes on which the condition holds.
    pub active: T::Mask,
}

/// Relative size of sᵀPs below which a condition repeats earlier ones: above round-off (1e-16)
/// times the condition number of sensible mass matrices (1e5), far below any real direction.
const REDUNDANT: f64 = 1e-10;

/// A mobility matrix that is narrowed condition by condition.
///
/// Each condition takes the direction w = P s out of P: P ← P − w wᵀ/(sᵀ w), and moves the
/// acceleration by a multiple of w, so that earlier conditions stay met. `[eq:stick]`
#[derive(Clone, Copy, Debug)]
pub struct Mobility<T: Scalar> {
    n: usize,
    matrix: Square<T>,
    free: Square<T>,
    rank: T,
}

impl<T: Scalar> Mobility<T> {
    /// Starts from the inverse of a mass matrix of size n.
    #[inline(always)]
    pub fn new(n: usize, inverse_mass: &Square<T>) -> Self {
        Mobility {
            n,
            matrix: *inverse_mass,
            free: *inverse_mass,
            rank: T::zero(),
        }
    }

    /// Moves `vector` by a multiple of P s so that s · vector = value, and narrows P.
    #[inline(always)]
    pub fn impose(&mut self, condition: &Condition<T>, vector: &mut [T]) {
        let n = self.n;
        let direction = product(n, &self.matrix, &condition.row);
        let size = dot(n, &condition.row, &direction);
        let full = dot(n, &condition.row, &product(n, &self.free, &condition.row));
        let active = condition.active.and((full * T::from(REDUNDANT)).less(size));
        let gain = T::one() / T::select(active, size, T::one());
        let shift = (condition.value - dot(n, &condition.row, vector)) * gain;
        for i in 0..n {
            vector[i] = T::select(active, direction[i].mul_add(shift, vector[i]), vector[i]);
            for j in 0..n {
                let narrowed = self.matrix[i][j] - direction[i] * direction[j] * gain;
                self.matrix[i][j] = T::select(active, narrowed, self.matrix[i][j]);
            }
        }
        self.rank += T::select(active, T::one(), T::zero());
    }

    /// The matrix P as narrowed so far.
    #[inline(always)]
    pub fn matrix(&self) -> &Square<T> {
        &self.matrix
    }

    /// Lanes on which no direction is left.
    #[inline(always)]
    pub fn is_locked(&self) -> T::Mask {
        T::from(self.n as f64 - 0.5).less(self.rank)
    }
}
