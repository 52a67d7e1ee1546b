//! Errata of Feng and Guo's paper on uneven ground: for each slip of physics the published form fails
//! a named check, and the shipped model passes it.

use appell_model::dual::Dual;
use appell_model::dynamics::{Dynamics, Input};
use appell_model::integrate::Adaptive;
use appell_model::planar::vec2;
use appell_model::pose_error::PoseError;
use appell_model::pose_error::excitation::Waveform;
use appell_model::support::Support;
use appell_model::wheel_legged::{RearSteering, WheelLegged};

use crate::errata::judge_within;

/// Mass, kg; yaw inertia, kg·m²; lever, m; l₂, m.
const MASS: f64 = 40.0;
const INERTIA: f64 = 3.0;
const LEVER: f64 = 0.25;
const REAR: f64 = 0.35;
/// Amplitudes along and across, N, and period, s.
const FORCE: [f64; 2] = [8.0, 3.0];
const PERIOD: f64 = 2.37;

fn model(ahead: f64) -> PoseError<f64> {
    PoseError {
        mass: MASS,
        inertia: INERTIA,
        lever: LEVER,
        ahead,
    }
}

/// (12) for the pose of the center of mass. Check: robot and target are two wheel-legged robots, and
/// the rate of the pose of one's center of mass in the other's frame follows by differentiating it.
#[test]
fn known_answer_error_of_the_center_of_mass() {
    type Moving = Dual<f64, 1>;
    let legged = WheelLegged {
        front: 0.3,
        rear: REAR,
        rear_steering: RearSteering::Neglected,
    };
    let (own, other) = ([0.5, 0.2, 0.0], [0.7, -0.3, 0.0]);
    let (at, target) = ([0.4, -0.2, 0.3], [1.9, 1.1, 1.2]);
    let moving = |pose: [f64; 3], u: &[f64; 3]| {
        let mut rates = [0.0; 3];
        legged.derivative(&pose, u, &[], &mut rates);
        [0, 1, 2].map(|k| Moving {
            value: pose[k],
            derivative: [rates[k]],
        })
    };
    let truth = PoseError::of(moving(at, &own), moving(target, &other));
    let error = truth.map(|component| component.value);
    let turn = |u: &[f64; 3]| legged.twist(u[0], u[1], u[2]).1;
    let rates = |ahead: f64| {
        let mut dx = [0.0; 5];
        let x = [error[0], error[1], error[2], 0.0, 0.0];
        let u = [own[0], turn(&own), other[0], turn(&other), 0.0, 0.0];
        model(ahead).derivative(&x, &u, &[], &mut dx);
        dx
    };
    judge_within(
        // A handful of operations on numbers near one.
        1e-14,
        |form: &dyn Fn(()) -> [f64; 5]| {
            let found = form(());
            (0..3).fold(0.0, |worst: f64, k| {
                worst.max((found[k] - truth[k].derivative[0]).abs())
            })
        },
        |()| rates(0.0),
        |()| rates(REAR),
    );
    // About the axle midpoint the usual form is right: of poses l₂ behind it holds without p.
    let axle = |pose: [Moving; 3]| {
        let (sin, cos) = appell_model::scalar::Scalar::sin_cos(pose[2]);
        let back = Moving::from(REAR);
        [pose[0] - back * cos, pose[1] - back * sin, pose[2]]
    };
    let truth = PoseError::of(axle(moving(at, &own)), axle(moving(target, &other)));
    let (mut dx, values) = ([0.0; 5], truth.map(|component| component.value));
    let x = [values[0], values[1], values[2], 0.0, 0.0];
    let u = [own[0], turn(&own), other[0], turn(&other), 0.0, 0.0];
    model(0.0).derivative(&x, &u, &[], &mut dx);
    for k in 0..3 {
        assert!((dx[k] - truth[k].derivative[0]).abs() < 1e-14);
    }
}

/// Forces of one wave along and across, by a robot that would rest.
struct Waves(Waveform, f64);

impl Input<f64> for Waves {
    fn at(&self, t: f64, u: &mut [f64]) {
        let wave = self.0.piece(t / PERIOD, self.1 / PERIOD);
        u.copy_from_slice(&[0.2, 0.1, 0.0, 0.0, FORCE[0] * wave, FORCE[1] * wave]);
    }
}

/// The state of the shipped model after a time, s, from rest of Δv and Δω.
fn pushed(wave: Waveform, time: f64) -> Vec<f64> {
    let system = model(0.0);
    let mut method = Adaptive::new(&system, 1e-12, 1e-13);
    let mut x = vec![3.0, 1.5, 0.4, 0.0, 0.0];
    let mut t = 0.0;
    while t < time - 1e-12 {
        // Quarters of the period, where waves kink and jump.
        let next = ((t / PERIOD * 4.0 + 1e-9).floor() + 1.0) * 0.25 * PERIOD;
        let next = next.min(time);
        let input = Waves(wave, 0.5 * (t + next));
        method
            .advance(&system, &input, t, next, &mut x, &mut [], None)
            .expect("smooth");
        t = next;
    }
    x
}

/// (14), (15): Δv = F₁ Δt/m and Δω = F₂ d Δt/J with the force of the instant. Check: momentum, the
/// closed integral A T (1 − cos 2πt/T)/2π of the sine.
#[test]
fn closed_form_momentum_of_varying_forces() {
    use appell_model::scalar::Scalar;
    let tau = core::f64::consts::TAU;
    let check = |form: &dyn Fn(f64) -> [f64; 2]| {
        [0.3, 0.9, 1.5, 2.0].iter().fold(0.0, |worst: f64, &t| {
            let cos = Scalar::sin_cos(tau * t / PERIOD).1;
            let impulse = PERIOD / tau * (1.0 - cos);
            let [dv, dw] = form(t);
            let along = MASS * dv - FORCE[0] * impulse;
            let turn = INERTIA * dw - LEVER * FORCE[1] * impulse;
            worst.max(along.abs()).max(turn.abs())
        })
    };
    let published = |t: f64| {
        let wave = Waveform::Sine.at(t / PERIOD);
        [
            FORCE[0] * wave * t / MASS,
            FORCE[1] * wave * LEVER * t / INERTIA,
        ]
    };
    let shipped = |t: f64| {
        let x = pushed(Waveform::Sine, t);
        [x[3], x[4]]
    };
    // N·s of eight, integrated within 1e-12.
    judge_within(1e-10, check, published, shipped);
}

/// Section 2.3 drops the vertical force "because it does no work". Check of the rule: the yaw momentum
/// J Δω̇ = F₂ d of a robot in straight motion, where F₂ does no work either. Check of its use: the loads
/// of the wheels carry weight and vertical force, and they bound the grip.
#[test]
fn known_answer_forces_without_work_count() {
    let yaw = |form: &dyn Fn(f64) -> f64| {
        let force = FORCE[1];
        (INERTIA * form(force) - force * LEVER).abs()
    };
    let side_speed = 0.0;
    let rates = |force: f64| {
        let mut dx = [0.0; 5];
        let x = [1.0, 0.0, 0.0, 0.0, 0.0];
        model(0.0).derivative(&x, &[0.2, 0.0, 0.0, 0.0, 0.0, force], &[], &mut dx);
        dx[4]
    };
    let published = |force: f64| match force * side_speed == 0.0 {
        true => rates(0.0),
        false => rates(force),
    };
    judge_within(1e-15, yaw, published, rates);

    let contacts = [[0.3, 0.2], [0.3, -0.2], [-0.3, 0.2], [-0.3, -0.2]];
    let contacts = contacts.map(|[x, y]| (vec2(x, y), 1.0));
    let support = Support::new(&contacts).expect("four contacts");
    let (weight, lift) = (MASS * 9.81, 60.0);
    let balance = |form: &dyn Fn(f64) -> f64| (form(lift) - (weight - lift)).abs();
    let carried =
        |normal: f64| -> f64 { support.loads(normal, vec2(0.0, 0.0)).iter().take(4).sum() };
    // Newtons of four hundred.
    judge_within(
        1e-12,
        balance,
        |_| carried(weight),
        |lift: f64| carried(weight - lift),
    );
}

/// The conclusion ranks the triangle (the abstract: square and triangle) above the sine. Check: the
/// impulse of half a period, A T/2, A T/π and A T/4, as the largest m Δv.
#[test]
fn closed_form_order_of_the_waves() {
    let waves = [Waveform::Square, Waveform::Sine, Waveform::Triangle];
    let impulses = waves.map(|wave| MASS * pushed(wave, 0.5 * PERIOD)[3]);
    for (wave, impulse) in waves.iter().zip(impulses) {
        let closed = FORCE[0] * PERIOD * wave.impulse();
        // N·s of ten, integrated within 1e-12.
        assert!((impulse - closed).abs() < 1e-10, "{wave:?} {impulse}");
    }
    // How far the next of a ranking exceeds the one before: nothing, if it is right.
    let check = |form: &dyn Fn(()) -> [usize; 3]| {
        let ranked = form(()).map(|k| impulses[k]);
        (ranked[1] - ranked[0]).max(ranked[2] - ranked[1]).max(0.0)
    };
    judge_within(0.0, check, |()| [2, 0, 1], |()| [0, 1, 2]);
    judge_within(0.0, check, |()| [0, 2, 1], |()| [0, 1, 2]);
    // And the error itself: its heading after five periods.
    let still = pushed(Waveform::None, 5.0 * PERIOD)[2];
    let turned = waves.map(|wave| (pushed(wave, 5.0 * PERIOD)[2] - still).abs());
    assert!(turned[0] > turned[1] && turned[1] > turned[2], "{turned:?}");
}
