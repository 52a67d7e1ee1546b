//! The postures of one leg system on its way across: a shortest path over places and angles.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use appell_model::scalar::Scalar;
use appell_model::wheel_legged::obstacle::Strategy;

use super::{Build, Profile};

/// A leg system: x of its hinge, m, and its angle, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posture {
    /// x of the hinge.
    pub x: f64,
    /// Angle, front up positive.
    pub angle: f64,
}

/// Step of places, m.
const STEP: f64 = 0.005;
/// Step of angles, rad: two degrees, by which a wheel moves 4 mm.
const TURN: f64 = 0.035;
/// Steepest way of a hinge: beyond it a wheel runs into a wall or off an edge.
const SLOPE_MAX: f64 = 2.0;
/// What a wheel in the air costs, in times of the move per meter of its height: legs lift late, lower
/// early, and go down into trenches.
const AIR: f64 = 200.0;

/// Height of the hinge of a leg system that is held at an angle, rad, and let down until the first of
/// its wheels touches, m.
pub fn hinge(profile: &Profile, build: &Build, x: f64, angle: f64) -> f64 {
    let (front, rear) = hinges(profile, build, x, angle);
    front.max(rear)
}

/// Heights of the hinge at which the front and the rear wheel touch.
fn hinges(profile: &Profile, build: &Build, x: f64, angle: f64) -> (f64, f64) {
    let (sin, cos) = Scalar::sin_cos(angle);
    let half = 0.5 * build.limits.wheel_pitch;
    let stand = |x: f64| profile.stand(x, build.limits.wheel_radius).center;
    (
        stand(x + half * cos) - half * sin,
        stand(x - half * cos) + half * sin,
    )
}

/// The way of least cost from level at `begin` to level at `end`, m, if there is one.
pub fn plan(
    profile: &Profile,
    build: &Build,
    strategy: Strategy,
    begin: f64,
    end: f64,
) -> Option<Vec<Posture>> {
    let places = ((end - begin) / STEP).ceil() as usize + 1;
    // Across a trench that a leg system bridges it is held level.
    let most = match strategy {
        Strategy::BridgeTrench => 0,
        _ => (build.leg_max / TURN).floor() as usize,
    };
    let angles = 2 * most + 1;
    // A wheel takes by itself what is no higher than its radius, however steeply it begins.
    let steepest = match strategy {
        Strategy::Direct => f64::INFINITY,
        _ => SLOPE_MAX,
    };
    let posture = |node: usize| Posture {
        x: begin + (node / angles) as f64 * STEP,
        angle: ((node % angles) as f64 - most as f64) * TURN,
    };
    let standing: Vec<(f64, f64)> = (0..places * angles)
        .map(|node| {
            let Posture { x, angle } = posture(node);
            let (front, rear) = hinges(profile, build, x, angle);
            (front.max(rear), (front - rear).abs())
        })
        .collect();
    let (start, goal) = (most, (places - 1) * angles + most);
    let mut cost = vec![f64::INFINITY; places * angles];
    let mut from = vec![usize::MAX; places * angles];
    let mut queue = BinaryHeap::new();
    cost[start] = 0.0;
    queue.push(Reverse((0_u64, start)));
    while let Some(Reverse((key, node))) = queue.pop() {
        if node == goal {
            break;
        }
        if key > ticks(cost[node]) {
            continue;
        }
        let (place, angle) = (node / angles, node % angles);
        for (ahead, turn) in [(1, 0), (1, 1), (1, -1), (0, 1), (0, -1_isize)] {
            let Some(next) = angle.checked_add_signed(turn).filter(|next| *next < angles) else {
                continue;
            };
            if place + ahead >= places {
                continue;
            }
            let next = (place + ahead) * angles + next;
            let (way, turned) = (ahead as f64 * STEP, turn.unsigned_abs() as f64 * TURN);
            let rise = (standing[next].0 - standing[node].0).abs();
            if rise > steepest * way + build.limits.wheel_pitch * turned + 1e-9 {
                continue;
            }
            let time = (way / build.speed).max(turned / build.joint_rate);
            // In the middle of a move both of its ends count.
            let air = 0.5 * (standing[node].1 + standing[next].1);
            // A turn costs a little by itself, so that none is made for nothing.
            let found = cost[node] + time * AIR.mul_add(air, 1.0) + 1e-3 * turned;
            if found < cost[next] {
                cost[next] = found;
                from[next] = node;
                queue.push(Reverse((ticks(found), next)));
            }
        }
    }
    if cost[goal].is_infinite() {
        return None;
    }
    let mut path = vec![posture(goal)];
    let mut node = goal;
    while node != start {
        node = from[node];
        path.push(posture(node));
    }
    path.reverse();
    Some(path)
}

/// A cost in whole millionths of a second, which have an order.
fn ticks(cost: f64) -> u64 {
    (cost * 1e6) as u64
}
