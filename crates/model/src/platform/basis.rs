//! The twists that fixed wheels allow, and the rank of what wheels forbid, on nominal values.

use super::{PlatformError, nominal};
use crate::scalar::Scalar;
use crate::solve::{Row, zero_row};
use crate::wheel::{Steering, Wheel};

/// Σ: a basis of the twists that the lateral rows of the fixed wheels allow, its size, and the wheels
/// that it is made of, with whether two of them leave a turn.
#[allow(clippy::type_complexity)]
pub(super) fn fixed_basis<T: Scalar>(
    wheels: &[Wheel<T>],
) -> Result<([Row<T>; 3], usize, (Vec<usize>, bool)), PlatformError> {
    let mut rows: Vec<[T; 3]> = Vec::new();
    let (mut made_of, mut turns) = (Vec::new(), false);
    for (i, wheel) in wheels.iter().enumerate() {
        let Steering::Fixed { angle } = wheel.steering else {
            continue;
        };
        if !wheel.is_plain() {
            continue;
        }
        let (sin, cos) = angle.sin_cos();
        let frame = wheel.frame(cos, sin);
        let row = [
            frame.left.x,
            frame.left.y,
            frame.left.dot(frame.contact.perpendicular()),
        ];
        // Which rows are independent is a matter of configuration: decided on the nominal values.
        if rank_with(&rows, &row) > rows.len() {
            rows.push(row);
            made_of.push(i);
        }
    }
    let zero = zero_row::<T>();
    let mut basis = [zero, zero, zero];
    let columns: Vec<[T; 3]> = match rows.as_slice() {
        [] => {
            let (o, l) = (T::zero(), T::one());
            vec![[l, o, o], [o, l, o], [o, o, l]]
        }
        [[x, y, k]] => vec![[*y, -*x, T::zero()], [-(*x * *k), -(*y * *k), T::one()]],
        [a, b] => {
            let c = cross3(a, b);
            let planar = (c[0] * c[0] + c[1] * c[1]).sqrt();
            // Straight motion at 1 m/s, or a turn at 1 rad/s about the common center.
            turns = nominal(c[2].abs()) > 1e-9 * nominal(planar);
            let unit = if turns { c[2] } else { planar.copysign(c[0]) };
            vec![[c[0] / unit, c[1] / unit, c[2] / unit]]
        }
        _ => return Err(PlatformError::Locked),
    };
    for (k, column) in columns.iter().enumerate() {
        for axis in 0..3 {
            basis[axis][k] = column[axis];
        }
    }
    Ok((basis, columns.len(), (made_of, turns)))
}

fn cross3<T: Scalar>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Rank of `rows` with one more row, by Gram–Schmidt on nominal values.
pub(super) fn rank_with<T: Scalar>(rows: &[[T; 3]], row: &[T; 3]) -> usize {
    // Two wheels on one axle may be a nanometre out of line in a file; that is no second constraint.
    const PARALLEL: f64 = 1e-9;
    let mut basis: Vec<[f64; 3]> = Vec::new();
    for candidate in rows.iter().chain([row]) {
        let mut rest = candidate.map(nominal);
        let size = norm3(&rest);
        for unit in &basis {
            let along: f64 = (0..3).map(|k| unit[k] * rest[k]).sum();
            for k in 0..3 {
                rest[k] -= along * unit[k];
            }
        }
        let left = norm3(&rest);
        if left > PARALLEL * size {
            basis.push(rest.map(|value| value / left));
        }
    }
    basis.len()
}

fn norm3(v: &[f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}
