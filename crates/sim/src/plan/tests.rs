//! Tests of the planner: shipped layouts and random ones, driven past the judge.

use super::*;
use crate::layout::Beacon;

fn layout(arena: [f64; 2], beacons: &[[f64; 2]], start: [f64; 3]) -> Layout {
    let beacon = |(i, p): (usize, &[f64; 2])| Beacon {
        name: format!("b{i}"),
        position: *p,
        radius: 0.05,
    };
    let beacons = beacons.iter().enumerate().map(beacon).collect();
    Layout {
        arena,
        beacons,
        collision_radius: 0.25,
        start,
    }
}

/// Plans, and checks what every path promises; the smallest clearance away from the start, m.
fn check(layout: &Layout, goal: &Goal) -> Result<f64, PlanError> {
    let path = plan(layout, goal)?;
    assert_eq!(path, plan(layout, goal)?, "planning is deterministic");
    let start = [layout.start[0], layout.start[1]];
    let planner = Planner {
        layout,
        goal,
        start,
    };
    assert!(planner.passes(&path, goal), "the judge passes the path");
    assert_eq!(path.points[0], start);
    let last = path.points.len() - 1;
    assert!(
        (path.length - path.ds * last as f64).abs() < 1e-9,
        "rounding only"
    );
    for pair in path.points.windows(2) {
        // Chords of the polygon that was resampled are shorter than its arcs.
        let step = distance(pair[0], pair[1]);
        assert!(
            step <= path.ds * (1.0 + 1e-9) && step >= 0.2 * path.ds,
            "step {step}"
        );
    }
    for pair in path.heading.windows(2) {
        assert!((pair[1] - pair[0]).abs() <= PI, "heading is unwrapped");
    }
    Ok(planner.clearance(&path))
}

fn comfortable(layout: &Layout, goal: &Goal, clearance: f64) {
    let found = check(layout, goal).expect("feasible");
    assert!(
        found >= clearance,
        "clearance {found:.3} m of {clearance} m"
    );
}

#[test]
fn reference_layouts_pass_with_clearance() {
    let homing = Goal::Homing {
        beacon: 0,
        distance: 0.45,
        speed: 0.01,
        hold: 1.0,
    };
    comfortable(
        &layout([6.0, 4.0], &[[4.5, 3.0]], [1.0, 1.0, 2.5]),
        &homing,
        0.5,
    );
    let gate = |direction, exit| Goal::Gate {
        pair: [0, 1],
        direction,
        exit,
    };
    let across = layout([6.0, 4.0], &[[3.0, 1.5], [3.0, 2.7]], [0.8, 0.8, 0.0]);
    comfortable(&across, &gate(0, 0.6), 0.15);
    let oblique = layout(
        [8.0, 6.0],
        &[[4.0, 2.5], [5.0, 3.2], [2.2, 4.6]],
        [1.0, 1.0, 1.57],
    );
    comfortable(&oblique, &gate(-1, 0.5), 0.15);
    comfortable(&oblique, &gate(1, 0.5), 0.15);
    let pair = layout([6.0, 4.0], &[[2.0, 2.0], [4.0, 2.0]], [3.0, 2.0, PI / 2.0]);
    for laps in 1..=3 {
        comfortable(
            &pair,
            &Goal::Eight {
                pair: [0, 1],
                laps,
                close: 0.3,
            },
            0.3,
        );
    }
    let slalom = |count, first_side| Goal::Slalom {
        chain: (0..count).collect(),
        first_side,
        offset_max: 1.2,
    };
    let row = [2.0, 3.2, 4.4, 5.6, 6.8].map(|x| [x, 2.0]);
    let five = layout([8.0, 4.0], &row, [0.8, 2.0, 0.0]);
    for side in [-1, 0, 1] {
        comfortable(&five, &slalom(5, side), 0.15);
    }
    let rise = [0.0, 0.2169, 0.3909, 0.4875, 0.4875, 0.3909, 0.2169, 0.0];
    let y = |k: usize| 3.0 + if k < 8 { rise[k] } else { -rise[k - 7] };
    let bow: Vec<_> = (0..15).map(|k| [2.0 + 1.15 * k as f64, y(k)]).collect();
    comfortable(
        &layout([20.0, 6.0], &bow, [0.8, 3.0, 0.0]),
        &slalom(15, 0),
        0.12,
    );
}

#[test]
fn start_within_the_goal_ring_stays() {
    let goal = Goal::Homing {
        beacon: 0,
        distance: 0.45,
        speed: 0.01,
        hold: 1.0,
    };
    let layout = layout([6.0, 4.0], &[[3.0, 2.0]], [3.4, 2.0, 1.0]);
    let path = plan(&layout, &goal).expect("already there");
    assert_eq!((path.length, path.points.len()), (0.0, 1));
    assert_eq!(path.at(1.0), ([3.4, 2.0], 1.0, 0.0));
}

#[test]
fn impossible_layouts_are_explained() {
    let gate = Goal::Gate {
        pair: [0, 1],
        direction: 0,
        exit: 0.5,
    };
    let narrow = layout([6.0, 4.0], &[[3.0, 1.8], [3.0, 2.3]], [1.0, 2.0, 0.0]);
    let error = plan(&narrow, &gate).expect_err("too narrow");
    assert_eq!(
        error.reason,
        "the gap between b0 and b1 is 0.400 m, the robot needs 0.500 m"
    );
    let touching = layout([6.0, 4.0], &[[3.0, 1.0], [3.0, 2.3]], [2.8, 1.0, 0.0]);
    let error = plan(&touching, &gate).expect_err("touches");
    assert!(
        error.reason.starts_with("the start is 0.20 m from b0"),
        "{error}"
    );
    let goal = Goal::Homing {
        beacon: 0,
        distance: 0.45,
        speed: 0.01,
        hold: 1.0,
    };
    let fence: Vec<_> = [[5.0, 1.0]]
        .into_iter()
        .chain((0..8).map(|k| [3.0, 0.25 + 0.5 * f64::from(k)]))
        .collect();
    let error = plan(&layout([6.0, 4.0], &fence, [1.0, 2.0, 0.0]), &goal).expect_err("fenced in");
    assert!(
        error.reason.starts_with("no free way leads to b0"),
        "{error}"
    );
    let missing = Goal::Eight {
        pair: [0, 7],
        laps: 1,
        close: 0.3,
    };
    assert!(plan(&narrow, &missing).is_err());
}

#[test]
fn closed_form_speed_profile() {
    let line = Path::smoothed(&[[0.0, 0.0], [4.0, 0.0]], 0.2).expect("has length");
    let limits = SpeedLimits {
        speed: 1.0,
        acceleration: 0.5,
        lateral_acceleration: 1.0,
        yaw_rate: 1.0,
    };
    let speed = line.speed_profile(&limits);
    let (middle, half) = (speed.len() / 2, speed.len() / 8);
    assert_eq!(
        (speed[0], speed[middle], speed[speed.len() - 1]),
        (0.0, 1.0, 0.0)
    );
    // v² = 2 a s at s = 0.5 m.
    assert!(
        (speed[half] - (half as f64 * line.ds).sqrt()).abs() < 1e-9,
        "rounding only"
    );
    // A ramp of 1 m at each end in 2 s, 2 m at 1 m/s between.
    assert!((line.duration(&limits) - 6.0).abs() < 1e-6, "rounding only");
    let circle: Vec<_> = (0..=200)
        .map(|k| {
            let (sin, cos) = sin_cos(TAU * f64::from(k) / 200.0);
            [0.5 * cos, 0.5 * sin]
        })
        .collect();
    let circle = Path::smoothed(&circle, 0.1).expect("has length");
    let speed = circle.speed_profile(&limits);
    // |κ| v = v / 0.5 m ≤ 1 rad/s; smoothing shrinks the radius by less than 1 %.
    assert!((speed[speed.len() / 2] - 0.5).abs() < 0.01);
}

/// A small congruential generator with the constants of Knuth's MMIX.
struct Random(u64);

impl Random {
    /// Uniform in [low, high).
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in 0 .. count.
    fn below(&mut self, count: usize) -> usize {
        self.between(0.0, count as f64) as usize
    }

    fn side(&mut self) -> i8 {
        [-1, 0, 1][self.below(3)]
    }

    fn direction(&mut self) -> [f64; 2] {
        let (sin, cos) = sin_cos(self.between(-PI, PI));
        [cos, sin]
    }

    /// A place at least `wall` from the walls and `apart` from the others.
    fn place(
        &mut self,
        arena: [f64; 2],
        wall: f64,
        others: &[[f64; 2]],
        apart: f64,
    ) -> Option<[f64; 2]> {
        (0..60)
            .map(|_| arena.map(|side| self.between(wall, side - wall)))
            .find(|p| others.iter().all(|other| distance(*p, *other) >= apart))
    }

    /// Adds up to `most` beacons in the way and puts the robot somewhere.
    fn finish(
        &mut self,
        arena: [f64; 2],
        mut beacons: Vec<[f64; 2]>,
        most: usize,
    ) -> Option<Layout> {
        for _ in 0..self.below(most + 1) {
            beacons.extend(self.place(arena, 0.3, &beacons, 0.85));
        }
        let [x, y] = self.place(arena, 0.28, &beacons, 0.34)?;
        Some(layout(arena, &beacons, [x, y, self.between(-PI, PI)]))
    }
}

fn random_homing(random: &mut Random) -> Option<(Layout, Goal)> {
    let arena = [random.between(4.0, 9.0), random.between(3.5, 7.0)];
    let home = random.place(arena, 0.6, &[], 0.0)?;
    let layout = random.finish(arena, vec![home], 6)?;
    let distance = random.between(0.36, 0.7);
    Some((
        layout,
        Goal::Homing {
            beacon: 0,
            distance,
            speed: 0.01,
            hold: 1.0,
        },
    ))
}

fn random_gate(random: &mut Random) -> Option<(Layout, Goal)> {
    let arena = [random.between(5.0, 9.0), random.between(4.0, 7.0)];
    let middle = random.place(arena, 1.45, &[], 0.0)?;
    let (along, half) = (random.direction(), random.between(0.34, 0.75));
    let beacons = vec![ahead(middle, along, -half), ahead(middle, along, half)];
    let layout = random.finish(arena, beacons, 3)?;
    let (direction, exit) = (random.side(), random.between(0.3, 0.8));
    Some((
        layout,
        Goal::Gate {
            pair: [0, 1],
            direction,
            exit,
        },
    ))
}

fn random_eight(random: &mut Random) -> Option<(Layout, Goal)> {
    let arena = [random.between(5.0, 8.0), random.between(4.0, 7.0)];
    let first = random.place(arena, 0.8, &[], 0.0)?;
    let second = random.place(arena, 0.8, &[first], 0.9)?;
    let mut layout = random.finish(arena, vec![first, second], 2)?;
    let middle = between(first, second, 0.5);
    let start = middle.map(|z| z + random.between(-0.4, 0.4));
    let free = layout
        .beacons
        .iter()
        .all(|b| distance(b.position, start) > 0.34);
    if free && random.below(2) == 0 {
        layout.start[..2].copy_from_slice(&start);
    }
    let laps = 1 + random.below(3) as u32;
    Some((
        layout,
        Goal::Eight {
            pair: [0, 1],
            laps,
            close: 0.3,
        },
    ))
}

/// A straight, bent or zigzag chain; now and then the robot starts beside it.
fn random_slalom(random: &mut Random) -> Option<(Layout, Goal)> {
    let (count, kind) = (3 + random.below(13), random.below(3));
    let first = random.direction();
    let (spacing, bend) = (random.between(0.8, 1.5), random.between(-0.25, 0.25));
    let mut chain = vec![[0.0, 0.0]];
    for k in 1..count {
        let angle = bend * [0.0, k as f64, if k.is_multiple_of(2) { 1.5 } else { -1.5 }][kind];
        let (sin, cos) = sin_cos(angle);
        let along = [0, 1].map(|i| cos * first[i] + sin * left_of(first)[i]);
        chain.push(ahead(chain[k - 1], along, spacing));
    }
    let (back, aside) = (random.between(0.5, 1.5), random.between(-0.8, 0.8));
    let back = if random.below(5) == 0 { back } else { -back };
    let start = ahead(ahead([0.0, 0.0], first, back), left_of(first), aside);
    let crowded = |k: usize| chain[..k].iter().any(|p| distance(*p, chain[k]) < 0.79);
    if (0..count).any(crowded) || chain.iter().any(|p| distance(*p, start) < 0.34) {
        return None;
    }
    let room = random.between(0.95, 1.6);
    let low = [0, 1].map(|i| {
        chain
            .iter()
            .map(|p| p[i])
            .fold(start[i] + room - 0.3, f64::min)
            - room
    });
    let high = [0, 1].map(|i| {
        chain
            .iter()
            .map(|p| p[i])
            .fold(start[i] - room + 0.3, f64::max)
            + room
    });
    let beacons: Vec<_> = chain.iter().map(|p| difference(*p, low)).collect();
    let [x, y] = difference(start, low);
    let layout = layout(
        difference(high, low),
        &beacons,
        [x, y, random.between(-PI, PI)],
    );
    let (first_side, offset_max) = (random.side(), random.between(0.8, 1.4));
    Some((
        layout,
        Goal::Slalom {
            chain: (0..count).collect(),
            first_side,
            offset_max,
        },
    ))
}

/// All of 300 feasible layouts pass, nearly all with 4 cm to spare.
fn all_pass(make: fn(&mut Random) -> Option<(Layout, Goal)>) {
    let mut random = Random(7);
    let mut tight = 0;
    for (layout, goal) in std::iter::repeat_with(|| make(&mut random))
        .flatten()
        .take(300)
    {
        match check(&layout, &goal) {
            Ok(clearance) => tight += u32::from(clearance < 0.04),
            Err(error) => panic!("{error}\n{layout:?}\n{goal:?}"),
        }
    }
    assert!(tight <= 6, "{tight} of 300 have less than 4 cm");
}

#[test]
fn random_homing_layouts_pass() {
    all_pass(random_homing);
}

#[test]
fn random_gates_pass() {
    all_pass(random_gate);
}

#[test]
fn random_eights_pass() {
    all_pass(random_eight);
}

#[test]
fn random_slaloms_pass() {
    all_pass(random_slalom);
}
