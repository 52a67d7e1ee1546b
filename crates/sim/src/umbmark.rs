//! The bidirectional square-path test of odometry, and the calibration that it yields.
//!
//! J. Borenstein and L. Feng, *Measurement and correction of systematic odometry errors in mobile
//! robots*, IEEE Transactions on Robotics and Automation 12(6), 1996, 869–880 (UMBmark). A robot that
//! believes its wheels equal and its track known drives a square both ways round; where it stops
//! tells by how much it errs. World frame: x along the first side, y to the left of it.

use appell_model::dual::Dual;
use appell_model::kinematic::along_arc;
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::Platform;
use appell_model::scalar::Scalar;
use appell_model::wheel::Steering;
use serde::Serialize;

use crate::noise::Stream;

/// Errors of a differential drive's geometry, as ratios; 1 for none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Geometry<T> {
    /// E_d: diameter of the right wheel over that of the left; their mean is as it should be.
    pub diameters: T,
    /// E_b: track over what it should be.
    pub track: T,
}

/// Which way round the square.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sense {
    /// Turning right.
    Clockwise,
    /// Turning left.
    CounterClockwise,
}

/// The square that is driven, and with what.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    /// Length of a side, m.
    pub side: f64,
    /// Track as built, m.
    pub track: f64,
}

/// How the calibration is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Calibration {
    /// The paper's formulas, right to first order of the errors.
    Published,
    /// Least squares on the exact end points, by Newton's method with exact derivatives.
    Exact,
}

impl<T: Scalar> Geometry<T> {
    /// No error.
    pub fn perfect() -> Self {
        Geometry {
            diameters: T::one(),
            track: T::one(),
        }
    }

    /// Radii of the left and right wheel over what they should be.
    fn radii(&self) -> [T; 2] {
        let left = T::from(2.0) / (self.diameters + T::one());
        [left, left * self.diameters]
    }
}

/// Where a robot of geometry `built` that believes in `believed` ends: x, y, m, and yaw, rad, from
/// (0, 0, 0). `slips` are added to the angle of each wheel, as ways at its rim, m, in each of the four
/// sides and turns.
pub fn end_point<T: Scalar>(
    course: &Course,
    built: &Geometry<T>,
    believed: &Geometry<T>,
    sense: Sense,
    slips: &[[[f64; 2]; 2]; 4],
) -> [T; 3] {
    let sign = match sense {
        Sense::Clockwise => -1.0,
        Sense::CounterClockwise => 1.0,
    };
    let (real, thought) = (built.radii(), believed.radii());
    let track = T::from(course.track) * built.track;
    let quarter = T::from(sign * 0.25 * core::f64::consts::PI * course.track) * believed.track;
    let (mut at, mut yaw) = (Vec2::zero(), T::zero());
    for slip in slips {
        let straight = [T::from(course.side); 2];
        for (wanted, slip) in [straight, [-quarter, quarter]].into_iter().zip(slip) {
            // The wheels turn as the robot believes is right; the rims do what they are.
            let ways: [T; 2] =
                core::array::from_fn(|k| wanted[k] / thought[k] * real[k] + T::from(slip[k]));
            let forward = T::from(0.5) * (ways[0] + ways[1]);
            let turn = (ways[1] - ways[0]) / track;
            let (sin, cos) = yaw.sin_cos();
            let half = (T::from(0.5) * turn).sin_cos();
            let step = along_arc(vec2(forward, T::zero()), turn, half);
            at = at + step.rotated(cos, sin);
            yaw += turn;
        }
    }
    [at.x, at.y, yaw]
}

impl Course {
    /// Whether the end points of a robot of this geometry, whose wheels slip by `slip` (standard
    /// deviation, m), still tell by how much it errs; the option at fault, what it must be and what it
    /// is, if not. Bounds by trial: at all their corners the exact calibration converges.
    ///
    /// # Errors
    /// A side that bends by more than 0.15 rad, a track off by more than 8 %, or a slip of more than
    /// 0.2 % of a side.
    pub fn tells(&self, built: &Geometry<f64>, slip: f64) -> Result<(), String> {
        let within = |what: &str, value: f64, middle: f64, reach: f64| {
            if (value - middle).abs() <= reach {
                return Ok(());
            }
            let (low, high) = (middle - reach, middle + reach);
            Err(format!(
                "{what} must be in [{low:.5}, {high:.5}] for a side of {} m and a track of {} m, got {value}",
                self.side, self.track
            ))
        };
        let bend = 0.15 * self.track / self.side;
        within(
            "the ratio of diameters",
            built.diameters,
            1.0,
            bend.min(0.1),
        )?;
        within("the ratio of tracks", built.track, 1.0, 0.08)?;
        within("the slip, m,", slip, 0.001 * self.side, 0.001 * self.side)
    }
}

/// What a test found.
#[derive(Clone, Debug, Serialize)]
pub struct Round {
    /// What the robot believed.
    pub believed: Geometry<f64>,
    /// Mean return position of each sense (clockwise first), m.
    pub centers: [[f64; 2]; 2],
    /// E_max,syst: distance of the farther of them from the start, m.
    pub systematic: f64,
    /// Standard deviation of the return positions about their centers, m.
    pub scatter: f64,
    /// By how much the belief errs, as the calibration finds it.
    pub found: Geometry<f64>,
}

/// Noise of the test: what the wheels slip.
#[derive(Clone, Copy, Debug)]
pub struct Slip {
    /// Standard deviation of the way that a wheel slips on a side or in a turn, m.
    pub std: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// Tests a robot `runs` times in each sense, corrects its belief, and again, `rounds` times.
pub fn test(
    course: &Course,
    built: &Geometry<f64>,
    calibration: Calibration,
    rounds: usize,
    runs: u64,
    slip: Slip,
) -> Vec<Round> {
    let mut believed = Geometry::perfect();
    (0..rounds)
        .map(|round| {
            let round = one_round(course, built, &believed, calibration, runs, slip, round);
            believed = Geometry {
                diameters: believed.diameters * round.found.diameters,
                track: believed.track * round.found.track,
            };
            round
        })
        .collect()
}

fn one_round(
    course: &Course,
    built: &Geometry<f64>,
    believed: &Geometry<f64>,
    calibration: Calibration,
    runs: u64,
    slip: Slip,
    round: usize,
) -> Round {
    let mut ends: [Vec<[f64; 2]>; 2] = [Vec::new(), Vec::new()];
    for (sense, ends) in [Sense::Clockwise, Sense::CounterClockwise]
        .into_iter()
        .zip(&mut ends)
    {
        for run in 0..runs {
            let path = format!("umbmark.{round}.{sense:?}");
            let stream = Stream::new(slip.seed, run, &path);
            let slips = core::array::from_fn(|leg| {
                core::array::from_fn(|part| {
                    let [left, right] = stream.normals((2 * leg + part) as u64);
                    [slip.std * left, slip.std * right]
                })
            });
            let [x, y, _] = end_point(course, built, believed, sense, &slips);
            ends.push([x, y]);
        }
    }
    let centers = [0, 1].map(|k: usize| {
        [0, 1].map(|axis: usize| ends[k].iter().map(|end| end[axis]).sum::<f64>() / runs as f64)
    });
    let far = |k: usize| crate::plant::speed(centers[k][0], centers[k][1]);
    let mut square = 0.0;
    for k in 0..2 {
        for end in &ends[k] {
            let away = crate::plant::speed(end[0] - centers[k][0], end[1] - centers[k][1]);
            square += away * away;
        }
    }
    Round {
        believed: *believed,
        centers,
        systematic: far(0).max(far(1)),
        scatter: (square / (2 * runs) as f64).sqrt(),
        found: match calibration {
            Calibration::Published => published(course, &centers),
            Calibration::Exact => exact(course, believed, &centers),
        },
    }
}

/// The paper's formulas: turns that are wrong by α and sides that bend by β.
fn published(course: &Course, centers: &[[f64; 2]; 2]) -> Geometry<f64> {
    let [clockwise, counter] = [centers[0][0], centers[1][0]];
    let alpha = (clockwise + counter) / (-4.0 * course.side);
    let beta = (clockwise - counter) / (-4.0 * course.side);
    let quarter = core::f64::consts::FRAC_PI_2;
    // R ± b/2, times 2 sin(β/2): no radius to become infinite.
    let bend = 2.0 * Scalar::sin_cos(0.5 * beta).0;
    Geometry {
        diameters: (course.side + 0.5 * course.track * bend)
            / (course.side - 0.5 * course.track * bend),
        track: quarter / (quarter - alpha),
    }
}

/// The errors whose exact end points fit the measured ones best: Gauss–Newton, which from the
/// published formulas on is at rest after a few steps.
fn exact(course: &Course, believed: &Geometry<f64>, centers: &[[f64; 2]; 2]) -> Geometry<f64> {
    const STEPS: usize = 40;
    // The largest step, and how far a robot's geometry can be off at all.
    const REACH: f64 = 0.03;
    const FARTHEST: (f64, f64) = (0.5, 2.0);
    let start = published(course, centers);
    let sane = |value: f64| {
        if value.is_finite() {
            value.clamp(0.8, 1.25)
        } else {
            1.0
        }
    };
    let mut found = Geometry {
        diameters: sane(start.diameters),
        track: sane(start.track),
    };
    let lift = |g: &Geometry<f64>| Geometry {
        diameters: Dual::<f64, 2>::from(g.diameters),
        track: Dual::from(g.track),
    };
    for _ in 0..STEPS {
        let built = Geometry {
            diameters: Dual::<f64, 2>::variable(believed.diameters * found.diameters, 0),
            track: Dual::variable(believed.track * found.track, 1),
        };
        let mut normal = [[0.0; 2]; 2];
        let mut right = [0.0; 2];
        for (sense, center) in [Sense::Clockwise, Sense::CounterClockwise]
            .into_iter()
            .zip(centers)
        {
            let end = end_point(course, &built, &lift(believed), sense, &Default::default());
            for axis in 0..2 {
                let slopes = end[axis].derivative;
                let left = center[axis] - end[axis].value;
                for a in 0..2 {
                    right[a] += slopes[a] * left;
                    for b in 0..2 {
                        normal[a][b] += slopes[a] * slopes[b];
                    }
                }
            }
        }
        let determinant = normal[0][0] * normal[1][1] - normal[0][1] * normal[1][0];
        let step = [
            (normal[1][1] * right[0] - normal[0][1] * right[1]) / determinant,
            (normal[0][0] * right[1] - normal[1][0] * right[0]) / determinant,
        ];
        if !(step[0].is_finite() && step[1].is_finite()) {
            break;
        }
        let moved = |value: f64, step: f64, believed: f64| {
            let next = value * believed + step.clamp(-REACH, REACH);
            next.clamp(FARTHEST.0, FARTHEST.1) / believed
        };
        found.diameters = moved(found.diameters, step[0], believed.diameters);
        found.track = moved(found.track, step[1], believed.track);
    }
    found
}

/// Track of a differential drive, m; why not, if the platform is none.
pub fn track(platform: &Platform<f64>) -> Result<f64, String> {
    let driven: Vec<_> = platform
        .wheels()
        .iter()
        .filter(|wheel| crate::plant::command_signal(&wheel.drive).is_some())
        .collect();
    let ahead = |wheel: &&appell_model::wheel::Wheel<f64>| {
        wheel.is_plain() && wheel.steering == Steering::Fixed { angle: 0.0 }
    };
    let refuse = |what: String| Err(format!("must be a differential drive, got {what}"));
    let layout = platform.layout();
    match driven.as_slice() {
        _ if !layout.steered.is_empty() => refuse("steered wheels".into()),
        _ if layout.eta != 2 => refuse("wheels that do not leave it two directions".into()),
        [a, b] if !ahead(a) || !ahead(b) || a.mount.x != b.mount.x || a.mount.y == b.mount.y => {
            refuse("driven wheels that do not roll ahead on one axle".into())
        }
        [a, b] if a.radius != b.radius => refuse("driven wheels of different radii".into()),
        [a, b] => Ok((a.mount.y - b.mount.y).abs()),
        other => refuse(format!("{} driven wheels", other.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COURSE: Course = Course {
        side: 4.0,
        track: 0.34,
    };
    const BUILT: Geometry<f64> = Geometry {
        diameters: 1.002,
        track: 1.01,
    };
    const NO_SLIP: Slip = Slip { std: 0.0, seed: 1 };

    /// End points of the exact arcs, found independently.
    #[test]
    fn known_answer_end_points() {
        let expected = [
            (
                Sense::Clockwise,
                [-0.293_593_216_207_813_7, -0.337_811_004_158_222_5],
            ),
            (
                Sense::CounterClockwise,
                [0.062_941_974_638_043_88, -0.060_079_919_930_093_57],
            ),
        ];
        for (sense, [x, y]) in expected {
            let end = end_point(
                &COURSE,
                &BUILT,
                &Geometry::perfect(),
                sense,
                &Default::default(),
            );
            // Eight rotations of sides of 4 m.
            assert!(
                (end[0] - x).abs() < 1e-12 && (end[1] - y).abs() < 1e-12,
                "{end:?}"
            );
        }
    }

    /// What the published formulas make of these end points, to the digits that are known.
    #[test]
    fn known_answer_published_formulas() {
        let rounds = test(&COURSE, &BUILT, Calibration::Published, 1, 1, NO_SLIP);
        assert!((rounds[0].found.track - 1.00926).abs() < 5e-6, "{rounds:?}");
        assert!(
            (rounds[0].found.diameters - 1.001_896).abs() < 5e-7,
            "{rounds:?}"
        );
    }

    /// Two corrections find the geometry; one by the published formulas makes the error ten times
    /// smaller, as the paper says.
    #[test]
    fn invariant_calibration_finds_the_geometry() {
        let rounds = test(&COURSE, &BUILT, Calibration::Exact, 3, 1, NO_SLIP);
        let last = rounds[2].believed;
        assert!((last.diameters - BUILT.diameters).abs() < 1e-6, "{last:?}");
        assert!((last.track - BUILT.track).abs() < 1e-6, "{last:?}");
        assert!(rounds[2].systematic < 1e-6);
        let rounds = test(&COURSE, &BUILT, Calibration::Published, 3, 1, NO_SLIP);
        assert!(rounds[1].systematic < 0.1 * rounds[0].systematic);
        assert!(rounds[2].systematic < 0.1 * rounds[1].systematic);
    }

    /// With wheels that slip, five runs each way still make the systematic error ten times smaller.
    #[test]
    fn invariant_calibration_stands_noise() {
        let slip = Slip {
            std: 0.0005,
            seed: 7,
        };
        let rounds = test(&COURSE, &BUILT, Calibration::Exact, 3, 5, slip);
        assert!(rounds[0].scatter > 1e-3);
        assert!(
            rounds[2].systematic < 0.1 * rounds[0].systematic,
            "{rounds:?}"
        );
    }
}
