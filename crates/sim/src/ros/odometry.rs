//! What a robot believes of its way, and how far it may be wrong: pose and twist from wheels, with the
//! covariance that the noise of their readings has left.
//!
//! A reading of a wheel's angle is wrong by a noise of its own, so that the ways between readings are not
//! independent: what one has too much the next has too little. The covariance is carried on together with
//! that of the last readings' noise, which makes it exact to first order. What no reading tells, as slip and
//! a wrong radius, is not in it.

use appell_model::kinematic::along_arc;
use appell_model::math::wrap_angle;
use appell_model::planar::vec2;
use appell_model::scalar::Scalar;

/// Pose and twist with covariances of x, y, yaw.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// x, y, yaw: m, m, rad.
    pub pose: [f64; 3],
    /// Covariance of the pose.
    pub pose_covariance: [[f64; 3]; 3],
    /// Forward, left, yaw rate: m/s, m/s, rad/s.
    pub twist: [f64; 3],
    /// Covariance of the twist.
    pub twist_covariance: [[f64; 3]; 3],
}

/// A law that sums wheel angles to a pose, in the place of the sum along arcs.
pub trait Reckon: Send {
    /// Names of the wheels whose angles it reads.
    fn wheels(&self) -> Vec<String>;
    /// Takes the angles, rad, `dt` s after the last; the first are what others are counted from.
    fn read(&mut self, angles: &[f64], dt: f64) -> Estimate;
}

/// The uncertainty of a pose that is summed from wheel angles.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Way (forward, left, turn) per angle of each wheel.
    gain: [Vec<f64>; 3],
    /// Variance of a reading, rad².
    variance: f64,
    /// Variance of the last reading.
    last: f64,
    /// Covariance of the pose.
    pose: [[f64; 3]; 3],
    /// Covariance of the pose with the last reading's noise of each wheel.
    cross: [Vec<f64>; 3],
}

impl Uncertainty {
    /// For a robot that stands where it believes to. The first reading has the variance `first`, later ones
    /// `variance`, rad².
    pub fn new(gain: [Vec<f64>; 3], first: f64, variance: f64) -> Self {
        let cross = gain.clone().map(|row| vec![0.0; row.len()]);
        Uncertainty {
            gain,
            variance,
            last: first,
            pose: [[0.0; 3]; 3],
            cross,
        }
    }

    /// Takes a way over, from a yaw on: `moved` is forward, left and turn in the frame at its start.
    pub fn advance(&mut self, yaw: f64, moved: [f64; 3]) {
        let half = 0.5 * moved[2];
        let arc = along_arc(vec2(moved[0], moved[1]), moved[2], Scalar::sin_cos(half));
        let (sin, cos) = Scalar::sin_cos(yaw);
        let step = arc.rotated(cos, sin);
        let (sin, cos) = Scalar::sin_cos(yaw + half);
        let wheels = self.gain[0].len();
        // How the pose after it answers to the pose before it, and to each wheel.
        let a = [[1.0, 0.0, -step.y], [0.0, 1.0, step.x], [0.0, 0.0, 1.0]];
        let mut b = [const { Vec::new() }; 3];
        for k in 0..wheels {
            let (forward, left, turn) = (self.gain[0][k], self.gain[1][k], self.gain[2][k]);
            b[0].push(cos * forward - sin * left - 0.5 * step.y * turn);
            b[1].push(sin * forward + cos * left + 0.5 * step.x * turn);
            b[2].push(turn);
        }
        // With e' = A e + B (n' − n): both readings' noise, less what e and n have in common.
        let mut after = [[0.0; 3]; 3];
        let mut common = [[0.0; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                for k in 0..3 {
                    for l in 0..3 {
                        after[i][j] += a[i][k] * self.pose[k][l] * a[j][l];
                    }
                }
                for w in 0..wheels {
                    after[i][j] += b[i][w] * b[j][w] * (self.last + self.variance);
                    for k in 0..3 {
                        common[i][j] += a[i][k] * self.cross[k][w] * b[j][w];
                    }
                }
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                self.pose[i][j] = after[i][j] - common[i][j] - common[j][i];
            }
        }
        for (cross, b) in self.cross.iter_mut().zip(&b) {
            for (cross, b) in cross.iter_mut().zip(b) {
                *cross = b * self.variance;
            }
        }
        self.last = self.variance;
    }

    /// Covariance of the pose.
    pub fn pose(&self) -> [[f64; 3]; 3] {
        self.pose
    }

    /// Covariance of a twist from two readings that are `dt` apart.
    pub fn twist(&self, dt: f64) -> [[f64; 3]; 3] {
        let product = |i: usize, j: usize| -> f64 {
            self.gain[i]
                .iter()
                .zip(&self.gain[j])
                .map(|(a, b)| a * b)
                .sum()
        };
        let scale = 2.0 * self.variance / (dt * dt);
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| scale * product(i, j)))
    }
}

/// The way between two poses, in the frame of the first: forward, left and turn of the arc that joins them.
pub fn way(from: [f64; 3], to: [f64; 3]) -> [f64; 3] {
    let turn = wrap_angle(to[2] - from[2]);
    let (sin, cos) = Scalar::sin_cos(from[2]);
    let (x, y) = (to[0] - from[0], to[1] - from[1]);
    let (x, y) = (cos * x + sin * y, cos * y - sin * x);
    // The chord of an arc is shorter than it by sinc of half the turn, and points half the turn on.
    let half = 0.5 * turn;
    let (sin, cos) = Scalar::sin_cos(half);
    let longer = match half.abs() < 1e-8 {
        true => 1.0,
        false => half / sin,
    };
    [
        longer * (cos * x + sin * y),
        longer * (cos * y - sin * x),
        turn,
    ]
}

/// Sums ways to a pose, along arcs.
pub fn moved(pose: [f64; 3], way: [f64; 3]) -> [f64; 3] {
    let half = Scalar::sin_cos(0.5 * way[2]);
    let (sin, cos) = Scalar::sin_cos(pose[2]);
    let step = along_arc(vec2(way[0], way[1]), way[2], half).rotated(cos, sin);
    [pose[0] + step.x, pose[1] + step.y, pose[2] + way[2]]
}
