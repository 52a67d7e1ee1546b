//! Messages to bytes and back, definitions, and the covariance of what is summed.

use appell_sim::noise::Stream;
use appell_sim::ros::message::{
    Detections, Header, Odometry, Time, Transforms, Twist, TwistStamped, definition, from_cdr,
    kind, to_cdr,
};
use appell_sim::ros::odometry::{Uncertainty, moved, way};

#[test]
fn known_answer_a_twist_is_encapsulation_and_six_floats() {
    let mut twist = Twist::default();
    (twist.linear.x, twist.angular.z) = (0.2, 1.0);
    let bytes = to_cdr(&twist);
    assert_eq!(bytes.len(), 4 + 48);
    assert_eq!(bytes[..4], [0, 1, 0, 0]);
    assert_eq!(bytes[4..12], 0.2_f64.to_le_bytes());
    assert_eq!(bytes[44..52], 1.0_f64.to_le_bytes());
    assert_eq!(from_cdr::<Twist>(&bytes), Ok(twist));
}

#[test]
fn known_answer_floats_stand_at_multiples_of_eight() {
    // Stamp 8, length of the text 4, "odom" and its zero 5: the floats follow at 24.
    let stamped = TwistStamped {
        header: Header {
            stamp: Time::of(1.5),
            frame_id: "odom".to_owned(),
        },
        twist: Twist::default(),
    };
    let bytes = to_cdr(&stamped);
    assert_eq!(bytes.len(), 4 + 24 + 48);
    assert_eq!(bytes[4..12], [1, 0, 0, 0, 0, 101, 205, 29]);
    assert_eq!(bytes[12..16], 5_u32.to_le_bytes());
    assert_eq!(from_cdr::<TwistStamped>(&bytes), Ok(stamped));
}

#[test]
fn refusal_bytes_that_are_no_message() {
    let good = to_cdr(&Odometry::default());
    for cut in 0..good.len() {
        assert!(from_cdr::<Odometry>(&good[..cut]).is_err(), "{cut}");
    }
    assert!(from_cdr::<Twist>(&[0, 2, 0, 0]).is_err());
    // Whatever stands there, it is refused or taken, never a fault, nor much memory.
    let mut state = 1_u64;
    for length in (0..400).cycle().take(40_000) {
        let bytes: Vec<u8> = (0..length)
            .map(|k| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                match k {
                    0 | 2 | 3 => 0,
                    1 => 1,
                    _ => (state >> 56) as u8,
                }
            })
            .collect();
        let _ = from_cdr::<Odometry>(&bytes);
        let _ = from_cdr::<Transforms>(&bytes);
        let _ = from_cdr::<Detections>(&bytes);
        let _ = from_cdr::<TwistStamped>(&bytes);
    }
}

#[test]
fn invariant_a_definition_tells_every_type_once() {
    for kind in [
        kind::CLOCK,
        kind::ODOMETRY,
        kind::TRANSFORMS,
        kind::JOINT_STATE,
        kind::IMU,
        kind::DETECTIONS,
        kind::TWIST,
        kind::TWIST_STAMPED,
    ] {
        let text = definition(kind);
        let mut told: Vec<&str> = text
            .lines()
            .filter_map(|l| l.strip_prefix("MSG: "))
            .collect();
        let count = told.len();
        told.sort_unstable();
        told.dedup();
        assert_eq!(told.len(), count, "{kind}");
        let named = text.lines().filter(|line| !line.starts_with("MSG: "));
        for part in named.filter_map(|line| line.split([' ', '[']).next()) {
            assert!(
                !part.contains('/') || told.contains(&part),
                "{kind}: {part}"
            );
        }
    }
}

#[test]
fn closed_form_way_and_moved_undo_each_other() {
    for turn in [0.0, 1e-9, 1e-4, 0.3, -1.7, 3.0] {
        let from = [1.0, -2.0, 2.5];
        let ahead = [0.4, -0.1, turn];
        let back = way(from, moved(from, ahead));
        for (got, want) in back.into_iter().zip(ahead) {
            assert!((got - want).abs() < 1e-9, "{back:?} {ahead:?}");
        }
    }
    // A quarter of a circle of 1 m.
    let quarter = std::f64::consts::FRAC_PI_2;
    let end = moved([0.0; 3], [quarter, 0.0, quarter]);
    assert!(
        (end[0] - 1.0).abs() < 1e-12 && (end[1] - 1.0).abs() < 1e-12,
        "{end:?}"
    );
}

/// Straight on, only the first and the last reading count, however many there were between.
#[test]
fn closed_form_covariance_straight_on() {
    let (radius, track, variance) = (0.04, 0.2, 1e-6);
    let gain = [
        vec![radius / 2.0; 2],
        vec![0.0; 2],
        vec![-radius / track, radius / track],
    ];
    for count in [1, 2, 50] {
        let mut uncertainty = Uncertainty::new(gain.clone(), variance, variance);
        for _ in 0..count {
            uncertainty.advance(0.0, [1.0 / f64::from(count), 0.0, 0.0]);
        }
        let p = uncertainty.pose();
        let along = 2.0 * (radius / 2.0) * (radius / 2.0) * 2.0 * variance;
        let turned = 2.0 * (radius / track) * (radius / track) * 2.0 * variance;
        assert!((p[0][0] - along).abs() < 1e-12 * along.max(1e-9), "{p:?}");
        assert!((p[2][2] - turned).abs() < 1e-18, "{p:?}");
    }
}

/// Normalised error squared of sums over noisy readings: three degrees of freedom.
#[test]
fn invariant_the_covariance_is_what_noise_leaves() {
    let (radius, track, std) = (0.04, 0.2, 0.01);
    let gain = [
        vec![radius / 2.0; 2],
        vec![0.0; 2],
        vec![-radius / track, radius / track],
    ];
    let (trials, steps) = (1000, 60_u64);
    let mut total = 0.0;
    for trial in 0..trials {
        let noise = |wheel: usize, tick: u64| {
            let stream = Stream::new(5, trial, &format!("wheel.{wheel}"));
            std * stream.normals(tick)[0]
        };
        let ahead = |angles: [f64; 2]| {
            [0, 1, 2].map(|axis: usize| gain[axis][0] * angles[0] + gain[axis][1] * angles[1])
        };
        let (mut truth, mut belief) = ([0.0; 3], [0.0; 3]);
        let mut uncertainty = Uncertainty::new(gain.clone(), std * std, std * std);
        for tick in 0..steps {
            let turned = match tick / 20 {
                0 => [1.0, 2.0],
                1 => [2.0, 1.0],
                _ => [2.0, 2.0],
            };
            let read = [0, 1].map(|k| turned[k] + noise(k, tick + 1) - noise(k, tick));
            truth = moved(truth, ahead(turned));
            uncertainty.advance(belief[2], ahead(read));
            belief = moved(belief, ahead(read));
        }
        let e = [0, 1, 2].map(|k| belief[k] - truth[k]);
        total += squared(e, uncertainty.pose());
    }
    // 95 % of sums of 3000 squares of unit normals.
    let mean = total / trials as f64;
    let bound = 1.96 * (2.0 * 3.0 / trials as f64).sqrt();
    assert!((mean - 3.0).abs() < bound, "{mean} must be in 3 ± {bound}");
}

/// eᵀ P⁻¹ e.
fn squared(e: [f64; 3], p: [[f64; 3]; 3]) -> f64 {
    let minor = |i: usize, j: usize| {
        let rows: Vec<usize> = (0..3).filter(|k| *k != i).collect();
        let columns: Vec<usize> = (0..3).filter(|k| *k != j).collect();
        let sign = if (i + j).is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * (p[rows[0]][columns[0]] * p[rows[1]][columns[1]]
            - p[rows[0]][columns[1]] * p[rows[1]][columns[0]])
    };
    let determinant: f64 = (0..3).map(|j| p[0][j] * minor(0, j)).sum();
    let mut sum = 0.0;
    for i in 0..3 {
        for j in 0..3 {
            sum += e[i] * minor(j, i) / determinant * e[j];
        }
    }
    sum
}

#[test]
fn known_answer_times() {
    assert_eq!(Time::of(0.0), Time { sec: 0, nanosec: 0 });
    let time = Time::of(12.000_000_001);
    assert_eq!((time.sec, time.nanosec), (12, 1));
    assert_eq!(time.seconds(), 12.000_000_001);
}
