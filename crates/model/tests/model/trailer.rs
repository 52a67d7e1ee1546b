//! A trailer on a hitch against its own mechanics: two bodies joined at a point.

use crate::common::{Method, SLEIGH, integrate};
use appell_model::drive::Drive;
use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::math::hypot;
use appell_model::math::single::{atan2, sin_cos};
use appell_model::planar::{Vec2, vec2};
use appell_model::platform::{Body, Platform, WheelOutput, YAW};
use appell_model::rolling::Rolling;
use appell_model::solve::dot;
use appell_model::trailer::Trailer;
use appell_model::wheel::Steering;

const TRAILER: Trailer<f64> = Trailer {
    name: String::new(),
    hitch: Vec2 { x: -0.25, y: 0.04 },
    hitch_height: 0.2,
    length: 0.9,
    half_track: 0.3,
    mass: 14.0,
    ahead: 0.2,
    inertia_com: 0.8,
    radius: 0.1,
    wheel_mass: 0.7,
    spin_inertia: 0.003,
    viscous: 0.0,
    hitch_viscous: 0.0,
};

/// A differential drive that tows it.
fn platform(trailer: &Trailer<f64>) -> Platform<f64> {
    let mut body = *SLEIGH.platform().body();
    let mut wheels = SLEIGH.platform().wheels().to_vec();
    trailer.attach(&mut body, &mut wheels);
    Platform::new(body, wheels).expect("a robot with a trailer")
}

fn state(platform: &Platform<f64>, yaw: f64, angle: f64, twist: [f64; 2]) -> Vec<f64> {
    let layout = platform.layout();
    let mut x = vec![0.0; layout.state()];
    x[YAW] = yaw;
    x[layout.swivel(0)] = angle;
    platform.renew_angles(&mut x);
    let at = layout.velocity();
    (x[at], x[at + 1]) = (twist[0], twist[1]);
    x
}

/// Kinetic energy of two bodies and four wheels, each from its own velocity.
fn kinetic(tractor: &Body<f64>, trailer: &Trailer<f64>, angle: f64, twist: [f64; 2]) -> f64 {
    let [speed, turn] = twist;
    let at = |r: Vec2<f64>| vec2(speed, 0.0) + r.perpendicular() * turn;
    let own = at(tractor.center_of_mass);
    let mut sum = 0.5 * tractor.mass * own.dot(own) + 0.5 * tractor.inertia_com * turn * turn;
    for side in [1.0, -1.0] {
        let rate = (speed - side * SLEIGH.half_track * turn) / SLEIGH.radius;
        sum += 0.5 * SLEIGH.spin_inertia * rate * rate;
    }
    // The axle of the trailer does not move sideways: that sets its yaw rate.
    let (sin, cos) = sin_cos(angle);
    let (forward, left) = (vec2(cos, sin), vec2(-sin, cos));
    let hitch = at(trailer.hitch);
    let turning = left.dot(hitch) / trailer.length;
    let along = forward.dot(hitch);
    let center = vec2(along, turning * trailer.ahead);
    sum += 0.5 * trailer.mass * center.dot(center) + 0.5 * trailer.inertia_com * turning * turning;
    for side in [1.0, -1.0] {
        let speed = along - side * trailer.half_track * turning;
        let rate = speed / trailer.radius;
        sum += 0.5 * trailer.wheel_mass * speed * speed;
        sum += 0.5 * trailer.spin_inertia * rate * rate;
    }
    sum
}

/// The kinetic energy as a function of angle and velocities, with the constraints, is all that the
/// equations of motion on level ground are made of.
#[test]
fn invariant_kinetic_energy_is_that_of_two_bodies() {
    let tractor = *SLEIGH.platform().body();
    let platform = platform(&TRAILER);
    for k in 0..200 {
        let angle = -3.0 + 0.03 * f64::from(k);
        let twist = [1.3 - 0.017 * f64::from(k), 0.9 * sin_cos(f64::from(k)).0];
        let x = state(&platform, 0.3, angle, twist);
        let reduced = platform.reduce(&x);
        let v = [twist[0], twist[1]];
        let mut full = appell_model::solve::zero_row();
        full[..2].copy_from_slice(&v);
        let product = appell_model::solve::product(2, &reduced.mass, &full);
        let ours = 0.5 * dot(2, &product, &full);
        let theirs = kinetic(&tractor, &TRAILER, angle, twist);
        // Sums of a few terms of the size of the whole.
        assert!(
            (ours - theirs).abs() < 1e-14 * theirs.max(1.0),
            "{angle}: {ours} {theirs}"
        );
    }
}

/// Without drives and losses it keeps its energy while it swings.
#[test]
fn invariant_energy_of_a_swinging_trailer() {
    let system = Rolling::new(platform(&TRAILER), Ground::flat(9.81));
    let x = state(system.platform(), 0.0, 1.2, [1.0, 0.5]);
    let u = vec![0.0; system.sizes().input];
    let energy = |x: &[f64]| {
        let mut y = vec![0.0; system.sizes().output];
        system.output(x, &u, &[1.0; 3], &mut y);
        y[3]
    };
    let (end, _) = integrate(&system, &x, &u, 10.0, Method::Adaptive(1e-12));
    // The tolerance of the integrator, over ten seconds.
    assert!((energy(&end) / energy(&x) - 1.0).abs() < 1e-10);
}

/// Drawn round a circle it ends at the angle that geometry gives, and its axle is pushed to the side
/// as much as its centripetal acceleration needs about the hitch.
#[test]
fn closed_form_steady_circle() {
    let trailer = Trailer {
        hitch: vec2(-0.25, 0.0),
        hitch_viscous: 0.0,
        ..TRAILER
    };
    let system = Rolling::new(platform(&trailer), Ground::flat(9.81));
    let (speed, turn) = (1.0, 0.5);
    // The adaptive method holds the twist if the torques balance: a heavy flywheel holds it better.
    let platform = system.platform();
    let radius = speed / turn;
    let to_hitch = hypot(radius, trailer.hitch.x);
    let axle = (to_hitch * to_hitch - trailer.length * trailer.length).sqrt();
    let angle = -(atan2(-trailer.hitch.x, radius) + atan2(trailer.length, axle));
    let x = state(platform, 0.0, angle, [speed, turn]);
    let layout = platform.layout();
    let frame = platform.wheel_frame(2, &x);
    let velocity = vec2(speed, 0.0);
    // At this angle it does not swivel.
    let rate = platform.caster_rate(2, &frame, velocity, turn);
    assert!(rate.abs() < 1e-14, "{rate}");
    // From another angle it comes there, whatever the dynamics: with the twist held, by kinematics.
    let mut other: f64 = 0.4;
    for _ in 0..200_000 {
        let (sin, cos) = sin_cos(other);
        let frame = platform.wheels()[2].frame(cos, sin);
        other += 1e-4 * platform.caster_rate(2, &frame, velocity, turn);
    }
    // Euler's method finds a fixed point exactly; it decays by e^(−v t / d), 20 s at 1 m/s.
    assert!((other - angle).abs() < 1e-8, "{other} {angle}");

    // Torques that hold the twist: those for which v̇ = 0, from two unit torques.
    let mut u = vec![0.0; layout.input()];
    let acceleration = |u: &[f64]| {
        let mut dx = vec![0.0; layout.state()];
        system.derivative(&x, u, &[1.0; 3], &mut dx);
        let at = layout.velocity();
        [dx[at], dx[at + 1]]
    };
    let base = acceleration(&u);
    let columns = [0, 1].map(|k| {
        let mut unit = u.clone();
        unit[k] = 1.0;
        let a = acceleration(&unit);
        [a[0] - base[0], a[1] - base[1]]
    });
    let determinant = columns[0][0] * columns[1][1] - columns[0][1] * columns[1][0];
    u[0] = (-base[0] * columns[1][1] + base[1] * columns[1][0]) / determinant;
    u[1] = (-base[1] * columns[0][0] + base[0] * columns[0][1]) / determinant;
    let mut y = vec![0.0; layout.output()];
    system.output(&x, &u, &[1.0; 3], &mut y);
    let side = y[layout.wheel_output(2, WheelOutput::Lateral)];
    // About the hitch: −d F = (r_c − r_h) × m a_c over body and wheels, a = −ω² (r − O).
    let (forward, hitch) = (frame.forward, trailer.hitch);
    let center = vec2(0.0, radius);
    let mut moment = 0.0;
    for (mass, behind) in [
        (trailer.mass, trailer.length - trailer.ahead),
        (2.0 * trailer.wheel_mass, trailer.length),
    ] {
        let at = hitch - forward * behind;
        let needed = (at - center) * (-turn * turn * mass);
        moment += (at - hitch).cross(needed);
    }
    assert!(
        (side + moment / trailer.length).abs() < 1e-12,
        "{side} {moment}"
    );
    // Two wheels carry no plane: no load is known, nor is that of the trailer.
    assert_eq!(y[layout.wheel_output(2, WheelOutput::Load)], 0.0);
}

/// What rests on the hitch loads the robot's own wheels, the rest the trailer's axle, whatever its
/// angle.
#[test]
fn closed_form_loads_at_rest() {
    let mut body = *SLEIGH.platform().body();
    body.center_of_mass = vec2(0.05, 0.0);
    let mut wheels = SLEIGH.platform().wheels().to_vec();
    let mut front = wheels[0].clone();
    (front.mount, front.drive) = (vec2(0.3, 0.0), Drive::None);
    front.steering = Steering::Free { trail: 0.02 };
    wheels.push(front);
    let trailer = Trailer {
        hitch: vec2(-0.25, 0.0),
        ..TRAILER
    };
    trailer.attach(&mut body, &mut wheels);
    let platform = Platform::new(body, wheels).expect("a robot with a trailer");
    let layout = platform.layout().clone();
    let system = Rolling::new(platform, Ground::flat(9.81));
    for angle in [0.0, 1.3] {
        let mut x = vec![0.0; layout.state()];
        x[layout.swivel(1)] = angle;
        system.platform().renew_angles(&mut x);
        let mut y = vec![0.0; layout.output()];
        system.output(&x, &vec![0.0; layout.input()], &[1.0; 4], &mut y);
        let load = |i: usize| y[layout.wheel_output(i, WheelOutput::Load)] / 9.81;
        let hitch = trailer.mass * trailer.ahead / trailer.length;
        let behind = trailer.mass - hitch + 2.0 * trailer.wheel_mass;
        // Moments about the axle of the driven wheels: 0.3 m to the front wheel.
        let nose = (SLEIGH.mass * 0.05 - hitch * 0.25) / 0.3;
        for (got, wanted) in [
            (load(0), 0.5 * (SLEIGH.mass + hitch - nose)),
            (load(1), 0.5 * (SLEIGH.mass + hitch - nose)),
            (load(2), nose),
            (load(3), behind),
        ] {
            // Sums of a few loads of up to 15 kg.
            assert!((got - wanted).abs() < 1e-13, "{got} {wanted}");
        }
    }
}
