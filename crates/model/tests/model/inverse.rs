//! Inverse dynamics: forward of inverse returns the motion.

use crate::common::{Differential, SLEIGH};
use appell_model::drive::Drive;
use appell_model::dynamics::Input;
use appell_model::ground::Ground;
use appell_model::integrate::Adaptive;
use appell_model::kinematic::Kinematic;
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::solve::{MAX_DOF, Row};
use appell_model::wheel::{Rim, Steering, Wheel};

fn wheel(name: &str, mount: [f64; 2], steering: Steering<f64>, rim: Rim<f64>) -> Wheel<f64> {
    let like = SLEIGH.platform().wheels()[0].clone();
    Wheel {
        name: name.into(),
        mount: vec2(mount[0], mount[1]),
        steering,
        rim,
        mass: 0.4,
        inertia_vertical: 0.002,
        viscous: 0.03,
        dry_friction: 0.02,
        ..like
    }
}

/// Rollers at `angle`, the wheel's plane turned by `plane`, rad.
fn rollers(name: &str, mount: [f64; 2], plane: f64, angle: f64) -> Wheel<f64> {
    wheel(
        name,
        mount,
        Steering::Fixed { angle: plane },
        Rim::Rollers { angle },
    )
}

fn body() -> Body<f64> {
    Body {
        mass: 12.0,
        inertia_com: 0.5,
        center_of_mass: vec2(0.03, -0.02),
        com_height: 0.15,
    }
}

/// Five robots of three kinds of wheels, all with losses.
fn robots() -> Vec<(&'static str, Platform<f64>)> {
    use std::f64::consts::{FRAC_PI_4, FRAC_PI_6, TAU};
    let lossy = Differential {
        viscous: 0.05,
        dry: 0.03,
        ..SLEIGH
    };
    let mut with_caster = lossy.platform().wheels().to_vec();
    with_caster.push(Wheel {
        drive: Drive::None,
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 0.0,
        viscous: 0.0,
        dry_friction: 0.0,
        ..wheel(
            "caster",
            [-0.2, 0.0],
            Steering::Free { trail: 0.03 },
            Rim::Plain,
        )
    });
    let omni = (0..3).map(|k| {
        let at = TAU * f64::from(k) / 3.0;
        let (sin, cos) = Scalar::sin_cos(at);
        rollers(&k.to_string(), [0.2 * cos, 0.2 * sin], at + TAU / 4.0, 0.0)
    });
    let textbook = [
        (0.25, 0.2, -1.0),
        (0.25, -0.2, 1.0),
        (-0.25, 0.2, 1.0),
        (-0.25, -0.2, -1.0),
    ];
    let mecanum = textbook.map(|(x, y, side)| rollers("m", [x, y], 0.0, side * FRAC_PI_4));
    // Any place and any angle: nothing about the textbook's square is used.
    let odd = [
        rollers("a", [0.31, 0.12], 0.2, -FRAC_PI_6),
        rollers("b", [0.22, -0.25], -0.1, 0.9),
        rollers("c", [-0.18, 0.3], 0.4, 0.6),
        rollers("d", [-0.35, -0.21], 0.0, -1.0),
    ];
    let build = |wheels| Platform::new(body(), wheels).expect("a platform");
    vec![
        ("differential", lossy.platform()),
        ("with a caster", build(with_caster)),
        ("omni", build(omni.collect())),
        ("mecanum", build(mecanum.to_vec())),
        ("odd mecanum", build(odd.to_vec())),
    ]
}

/// A motion whose wheels keep their sense: v̄ + small waves, and its rate.
fn motion(platform: &Platform<f64>, t: f64) -> (Row<f64>, Row<f64>) {
    let (s1, c1) = Scalar::sin_cos(0.7 * t);
    let (s2, c2) = Scalar::sin_cos(1.3 * t + 0.4);
    let twist = |forward: f64, left: f64, turn: f64| {
        platform.velocity_from_twist(vec2(forward, left), turn, &[])
    };
    (
        twist(0.6 + 0.05 * s1, 0.02 * s2, 0.1 + 0.05 * c2),
        twist(0.035 * c1, 0.026 * c2, -0.065 * s2),
    )
}

/// The torques of inverse dynamics as an input of time.
struct Torques<'a>(&'a Rolling<f64>);

impl Input<f64> for Torques<'_> {
    fn at(&self, t: f64, u: &mut [f64]) {
        let platform = self.0.platform();
        let layout = platform.layout();
        let (v, v_rate) = motion(platform, t);
        let mut x = vec![0.0; layout.state()];
        platform.renew_angles(&mut x);
        x[layout.velocity()..][..layout.dof()].copy_from_slice(&v[..layout.dof()]);
        u.fill(0.0);
        let mode = senses(platform, &v);
        let demand = self.0.inverse(&x, u, &mode, &v_rate);
        assert!(demand.residual < 1e-12, "every direction is driven");
        u[..layout.wheels].copy_from_slice(&demand.torque[..layout.wheels]);
    }
}

fn senses(platform: &Platform<f64>, v: &Row<f64>) -> Vec<f64> {
    rates(platform, v)
        .iter()
        .map(|rate| rate.signum())
        .collect()
}

fn rates(platform: &Platform<f64>, v: &Row<f64>) -> Vec<f64> {
    let x = vec![0.0; platform.layout().state()];
    let mut x = x;
    platform.renew_angles(&mut x);
    let (velocity, yaw_rate) = platform.twist(v);
    platform.rates_from_twist(&x, [velocity.x, velocity.y, yaw_rate])
}

/// The rates of the same motion, for the kinematic level.
struct Rates<'a>(&'a Platform<f64>);

impl Input<f64> for Rates<'_> {
    fn at(&self, t: f64, u: &mut [f64]) {
        let (v, _) = motion(self.0, t);
        u.fill(0.0);
        let rates = rates(self.0, &v);
        u[..rates.len()].copy_from_slice(&rates);
    }
}

/// Sixty seconds under the torques found: velocities as prescribed, and the pose that the kinematic
/// level reaches with the prescribed wheel rates, each within 1e-9.
#[test]
fn invariant_forward_of_inverse_returns_the_motion() {
    for (name, platform) in robots() {
        let layout = platform.layout().clone();
        let system = Rolling::new(platform.clone(), Ground::flat(9.81));
        let wheels = platform.wheels().to_vec();
        let rated = wheels.into_iter().map(|wheel| Wheel {
            drive: match wheel.drive {
                Drive::None => Drive::None,
                _ => Drive::Rate {
                    rate_max: f64::INFINITY,
                },
            },
            ..wheel
        });
        let twin = Platform::new(*platform.body(), rated.collect()).expect("the same wheels");
        let kinematic = Kinematic::new(twin.clone()).expect("driven in every direction");

        let (start, _) = motion(&platform, 0.0);
        let mut x = vec![0.0; layout.state()];
        platform.renew_angles(&mut x);
        let mut truth = x.clone();
        x[layout.velocity()..][..layout.dof()].copy_from_slice(&start[..layout.dof()]);
        let mut mode = senses(&platform, &start);
        let mut adaptive = Adaptive::new(&system, 1e-12, 1e-13);
        adaptive
            .advance(
                &system,
                &Torques(&system),
                0.0,
                60.0,
                &mut x,
                &mut mode,
                None,
            )
            .expect("a smooth motion");
        let mut still = vec![1.0; layout.wheels];
        let mut adaptive = Adaptive::new(&kinematic, 1e-12, 1e-13);
        adaptive
            .advance(
                &kinematic,
                &Rates(&twin),
                0.0,
                60.0,
                &mut truth,
                &mut still,
                None,
            )
            .expect("a smooth motion");

        let (end, _) = motion(&platform, 60.0);
        for k in 0..layout.dof() {
            let off = (x[layout.velocity() + k] - end[k]).abs();
            assert!(off < 1e-9, "{name}: v[{k}] off by {off:e}");
        }
        for k in [0, 1, YAW] {
            let off = (x[k] - truth[k]).abs();
            assert!(off < 1e-9, "{name}: pose[{k}] off by {off:e}");
        }
    }
}

/// Of more drives than directions the smallest torques are taken: no change of the torques that
/// leaves the motion alone makes their squares smaller, for they have no part of such a change.
#[test]
fn invariant_redundant_torques_are_least() {
    let (_, platform) = robots().remove(4);
    let layout = platform.layout().clone();
    let system = Rolling::new(platform.clone(), Ground::flat(9.81));
    let (v, v_rate) = motion(&platform, 1.0);
    let mut x = vec![0.0; layout.state()];
    platform.renew_angles(&mut x);
    x[layout.velocity()..][..layout.dof()].copy_from_slice(&v[..layout.dof()]);
    let u = vec![0.0; layout.input()];
    let torque = system
        .inverse(&x, &u, &senses(&platform, &v), &v_rate)
        .torque;
    // A change of four torques that pushes nowhere: the cofactors of the 4 × 3 input map.
    let rows: Vec<[f64; 3]> = (0..4)
        .map(|i| {
            let row = platform.spin_row(i, &platform.wheel_frame(i, &x));
            [row[0], row[1], row[2]]
        })
        .collect();
    let minor = |skip: usize| {
        let r: Vec<&[f64; 3]> = (0..4).filter(|&i| i != skip).map(|i| &rows[i]).collect();
        r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1])
            - r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0])
            + r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0])
    };
    let idle = [minor(0), -minor(1), minor(2), -minor(3)];
    let size: f64 = idle.iter().map(|z| z * z).sum::<f64>().sqrt();
    let part: f64 = (0..4).map(|i| torque[i] * idle[i] / size).sum();
    assert!(
        part.abs() < 1e-12,
        "{part:e} N·m of the torques push nowhere"
    );
    assert!(MAX_DOF >= layout.dof());
}

/// The lecture's point H ahead of the axle, led along the line y_H = 0: the heading follows the
/// tractrix tan(θ/2) = tan(θ₀/2) e^{−s/l}.
struct Led<'a> {
    system: &'a Rolling<f64>,
    ahead: f64,
    heading: f64,
}

impl Led<'_> {
    /// Way of H, its rate and its acceleration.
    fn way(t: f64) -> [f64; 3] {
        let (sin, cos) = Scalar::sin_cos(0.5 * t);
        [0.3 * t + 0.1 * sin, 0.3 + 0.05 * cos, -0.025 * sin]
    }

    fn heading(&self, t: f64) -> f64 {
        let half = Scalar::sin_cos(0.5 * self.heading);
        let tan = half.0 / half.1 * Scalar::exp(-Self::way(t)[0] / self.ahead);
        2.0 * Scalar::atan2(tan, 1.0)
    }

    /// V, ω and their rates.
    fn motion(&self, t: f64) -> [f64; 4] {
        let [_, rate, growth] = Self::way(t);
        let (sin, cos) = Scalar::sin_cos(self.heading(t));
        let turn = -rate * sin / self.ahead;
        [
            rate * cos,
            turn,
            growth * cos - rate * sin * turn,
            -(growth * sin + rate * cos * turn) / self.ahead,
        ]
    }
}

impl Input<f64> for Led<'_> {
    fn at(&self, t: f64, u: &mut [f64]) {
        let platform = self.system.platform();
        let layout = platform.layout();
        let [speed, turn, speed_rate, turn_rate] = self.motion(t);
        let mut x = vec![0.0; layout.state()];
        platform.renew_angles(&mut x);
        let v = platform.velocity_from_twist(vec2(speed, 0.0), turn, &[]);
        let v_rate = platform.velocity_from_twist(vec2(speed_rate, 0.0), turn_rate, &[]);
        x[layout.velocity()..][..layout.dof()].copy_from_slice(&v[..layout.dof()]);
        u.fill(0.0);
        let mode = vec![1.0; layout.wheels];
        let demand = self.system.inverse(&x, u, &mode, &v_rate);
        u[..layout.wheels].copy_from_slice(&demand.torque[..layout.wheels]);
    }
}

/// Sixty seconds under the torques found for a path of H: H is where it was to be, within 1e-9.
#[test]
fn invariant_forward_of_inverse_leads_point_h() {
    let lossy = Differential {
        viscous: 0.05,
        ..SLEIGH
    };
    let system = Rolling::new(lossy.platform(), Ground::flat(9.81));
    let led = Led {
        system: &system,
        ahead: 0.2,
        heading: 1.0,
    };
    let layout = system.platform().layout().clone();
    let [speed, turn, ..] = led.motion(0.0);
    let mut x = vec![0.0; layout.state()];
    let (sin, cos) = Scalar::sin_cos(1.0);
    (x[0], x[1], x[YAW]) = (-0.2 * cos, -0.2 * sin, 1.0);
    system.platform().renew_angles(&mut x);
    let v = system
        .platform()
        .velocity_from_twist(vec2(speed, 0.0), turn, &[]);
    x[layout.velocity()..][..layout.dof()].copy_from_slice(&v[..layout.dof()]);
    let mut mode = vec![1.0; layout.wheels];
    let mut adaptive = Adaptive::new(&system, 1e-12, 1e-13);
    adaptive
        .advance(&system, &led, 0.0, 60.0, &mut x, &mut mode, None)
        .expect("a smooth motion");
    let h = [x[0] + 0.2 * x[YAW + 1], x[1] + 0.2 * x[YAW + 2]];
    assert!((h[0] - Led::way(60.0)[0]).abs() < 1e-9, "{h:?}");
    assert!(h[1].abs() < 1e-9, "{h:?}");
    assert!((x[YAW] - led.heading(60.0)).abs() < 1e-9);
}
