//! Tests of the judges on trajectories made by hand.

use super::*;

fn layout(beacons: &[[f64; 2]], start: [f64; 2]) -> Layout {
    let beacon = |(i, p): (usize, &[f64; 2])| Beacon {
        name: format!("b{i}"),
        position: *p,
        radius: 0.05,
    };
    let beacons = beacons.iter().enumerate().map(beacon).collect();
    Layout {
        arena: [6.0, 4.0],
        beacons,
        collision_radius: 0.25,
        start: [start[0], start[1], 0.0],
    }
}

/// Drives the polygon at 0.1 s per corner and returns the judge.
fn drive(layout: &Layout, goal: Option<&Goal>, corners: &[[f64; 2]]) -> Judge {
    let mut judge = Judge::new(layout, goal);
    for (k, p) in corners.iter().enumerate() {
        judge.observe(0.1 * k as f64, *p, 1.0);
    }
    judge
}

fn check(
    layout: &Layout,
    goal: &Goal,
    corners: &[[f64; 2]],
    verdict: Verdict,
    reason: &str,
) -> Judge {
    let judge = drive(layout, Some(goal), corners);
    assert_eq!(judge.verdict(), verdict, "{}", judge.reason());
    assert!(judge.reason().contains(reason), "{}", judge.reason());
    judge
}

fn metric(judge: &Judge, name: &str) -> f64 {
    let found = judge.metrics().into_iter().find(|m| m.0 == name);
    found.expect("metric exists").1
}

#[test]
fn closed_form_touch_is_interpolated() {
    // Contact at x = 3 − 0.3 on a segment from 2 to 4 within 0.1 s.
    let judge = drive(
        &layout(&[[3.0, 2.0]], [1.0, 2.0]),
        None,
        &[[2.0, 2.0], [4.0, 2.0]],
    );
    assert_eq!(
        judge.reason(),
        "touched b0 at t = 0.035 s, at (2.700, 2.000) m"
    );
}

#[test]
fn closed_form_wall_is_interpolated() {
    let judge = drive(&layout(&[], [1.0, 2.0]), None, &[[1.0, 2.0], [1.0, 4.5]]);
    assert_eq!(
        judge.reason(),
        "left the arena at t = 0.070 s, at (1.000, 3.750) m"
    );
}

#[test]
fn free_drive_never_ends_and_measures() {
    let judge = drive(
        &layout(&[[3.0, 3.0]], [1.0, 2.0]),
        None,
        &[[1.0, 2.0], [5.0, 2.0]],
    );
    assert_eq!(judge.verdict(), Verdict::Running);
    assert!(
        (metric(&judge, "beacon clearance") - 0.7).abs() < 1e-12,
        "rounding only"
    );
    assert!(
        (metric(&judge, "path length") - 4.0).abs() < 1e-12,
        "rounding only"
    );
}

#[test]
fn homing_counts_only_an_unbroken_stop() {
    let layout = layout(&[[3.0, 2.0]], [2.0, 2.0]);
    let goal = Goal::Homing {
        beacon: 0,
        distance: 0.45,
        speed: 0.01,
        hold: 1.0,
    };
    let mut judge = Judge::new(&layout, Some(&goal));
    let mut verdict = Verdict::Running;
    for k in 0..200 {
        let t = 0.01 * f64::from(k);
        let speed = if k == 50 { 0.02 } else { 0.0 };
        verdict = judge.observe(t, [2.6, 2.0], speed);
        if verdict != Verdict::Running {
            assert_eq!(k, 151, "stop from sample 51, held for 1 s");
            break;
        }
    }
    assert_eq!(verdict, Verdict::Passed);
    assert_eq!(judge.take_events().len(), 1);
}

#[test]
fn gate_needs_one_crossing_in_its_direction() {
    // b0 below, b1 above: +1 goes towards −x.
    let layout = layout(&[[3.0, 1.5], [3.0, 2.7]], [1.0, 2.1]);
    let gate = |direction| Goal::Gate {
        pair: [0, 1],
        direction,
        exit: 0.6,
    };
    let through = [[1.0, 2.1], [2.9, 2.1], [3.5, 2.1], [3.7, 2.1]];
    let judge = check(
        &layout,
        &gate(-1),
        &through,
        Verdict::Passed,
        "0.000 m off its middle",
    );
    assert_eq!(metric(&judge, "path length"), 2.7);
    check(&layout, &gate(0), &through, Verdict::Passed, "");
    check(
        &layout,
        &gate(1),
        &through,
        Verdict::Failed,
        "wrong direction",
    );
    check(
        &layout,
        &gate(-1),
        &through[..3],
        Verdict::Running,
        "had to be 0.6 m",
    );
    let back = [[1.0, 2.1], [3.5, 2.1], [2.0, 2.1]];
    check(&layout, &gate(-1), &back, Verdict::Failed, "second time");
    let past = [[1.0, 3.5], [5.0, 3.5]];
    check(&layout, &gate(-1), &past, Verdict::Running, "not crossed");
}

#[test]
fn eight_needs_opposite_windings() {
    let layout = layout(&[[2.0, 2.0], [4.0, 2.0]], [3.0, 2.0]);
    let goal = |laps| Goal::Eight {
        pair: [0, 1],
        laps,
        close: 0.3,
    };
    let first = [[3.0, 2.0], [2.0, 1.0], [1.0, 2.0], [2.0, 3.0], [3.0, 2.0]];
    let second = [[4.0, 1.0], [5.0, 2.0], [4.0, 3.0], [3.0, 2.0]];
    let eight: Vec<_> = first.iter().chain(&second).copied().collect();
    let judge = check(&layout, &goal(1), &eight, Verdict::Passed, "closed it");
    assert_eq!(
        metric(&judge, "first winding"),
        -metric(&judge, "second winding")
    );
    check(
        &layout,
        &goal(2),
        &eight,
        Verdict::Running,
        "had to be 2 times",
    );
    check(
        &layout,
        &goal(1),
        &first,
        Verdict::Running,
        "in opposite directions",
    );
    let mut twice = eight.clone();
    twice.extend(&eight[1..]);
    let mut judge = check(
        &layout,
        &goal(2),
        &twice,
        Verdict::Passed,
        "2 figure eights",
    );
    let events = judge.take_events();
    assert_eq!(
        events.iter().filter(|e| e.text.starts_with("lap")).count(),
        2
    );
}

#[test]
fn slalom_needs_alternating_sides() {
    let layout = layout(&[[2.0, 2.0], [3.2, 2.0], [4.4, 2.0]], [1.0, 2.0]);
    let goal = |first_side| Goal::Slalom {
        chain: vec![0, 1, 2],
        first_side,
        offset_max: 1.2,
    };
    let wave = [[1.0, 2.0], [2.0, 2.5], [3.2, 1.5], [4.4, 2.5], [5.0, 2.5]];
    let judge = check(&layout, &goal(1), &wave, Verdict::Passed, "all 3 beacons");
    let offsets: Vec<f64> = judge
        .metrics()
        .into_iter()
        .filter(|m| m.0 == "offset")
        .map(|m| m.1)
        .collect();
    assert_eq!(offsets, [0.5, -0.5, 0.5]);
    check(&layout, &goal(0), &wave, Verdict::Passed, "");
    check(
        &layout,
        &goal(-1),
        &wave,
        Verdict::Failed,
        "passed b0 on its left, had to pass on its right",
    );
    check(
        &layout,
        &goal(1),
        &wave[..3],
        Verdict::Running,
        "passed 2 of 3 beacons, b2 was not passed",
    );
    // Too far aside does not count, whatever the side.
    let wide = [[1.0, 0.5], [5.5, 0.5]];
    check(
        &layout,
        &goal(1),
        &wide,
        Verdict::Running,
        "b0 was not passed",
    );
}

#[test]
fn non_finite_motion_fails() {
    let judge = drive(
        &layout(&[], [1.0, 2.0]),
        None,
        &[[1.0, 2.0], [f64::NAN, 2.0]],
    );
    assert_eq!(judge.verdict(), Verdict::Failed);
}

/// Random ways through all tasks: a judge that is woken where something can happen decides as one that looks
/// at every sample does.
#[test]
fn invariant_a_judge_that_is_woken_misses_nothing() {
    let layout = layout(&[[2.0, 2.0], [3.2, 2.0], [4.4, 2.0]], [0.6, 2.0]);
    let pair = [0, 1];
    let chain = vec![0, 1, 2];
    let goals = [
        Goal::Homing {
            beacon: 1,
            distance: 0.6,
            speed: 0.01,
            hold: 0.3,
        },
        Goal::Gate {
            pair,
            direction: 0,
            exit: 0.4,
        },
        Goal::Eight {
            pair,
            laps: 1,
            close: 0.5,
        },
        Goal::Slalom {
            chain,
            first_side: 0,
            offset_max: 1.5,
        },
    ];
    for (kind, goal) in goals.iter().enumerate() {
        let mut events = 0;
        let mut decided = [0; 3];
        for way in 0..400 {
            let stream = crate::noise::Stream::new(kind as u64, way, "way");
            let mut woken = Judge::<f64>::new(&layout, Some(goal));
            let mut eager = woken.clone();
            let [mut x, mut y, mut heading] = [0.6, 2.0, 0.0];
            for k in 0..600 {
                let [bend, share] = stream.normals(k);
                // Some stop for half a second, where they are.
                let step = match (k + 7 * way) % 200 {
                    ..50 => 0.0,
                    _ => 0.03 * share.abs(),
                };
                heading += 0.15 * bend + 0.02;
                let (sin, cos) = Scalar::sin_cos(heading);
                (x, y) = (x + step * cos, y + step * sin);
                let (t, speed) = (0.01 * k as f64, 100.0 * step);
                eager.watch.calm = 0.0;
                eager.observe(t, [x, y], speed);
                woken.observe(t, [x, y], speed);
                events += eager.events.len();
                assert_eq!(woken.take_events(), eager.take_events());
                assert_eq!(woken.verdict(), eager.verdict());
            }
            assert_eq!(woken.reason(), eager.reason());
            assert_eq!(woken.metrics(), eager.metrics());
            decided[woken.verdict() as usize] += 1;
        }
        // Else nothing would be shown.
        assert!(events > 20, "task {kind}: {events} events");
        assert!(decided[Verdict::Failed as usize] > 20, "{decided:?}");
    }
}
