//! Robots and loops that several tests share.

use appell_model::drive::{DcMotor, Drive};
use appell_model::dynamics::{Dynamics, Held};
use appell_model::ground::Ground;
use appell_model::integrate::{Adaptive, Exponential, RungeKutta4};
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform, YAW};
use appell_model::rolling::Rolling;
use appell_model::wheel::{Rim, Steering, Wheel};

/// A differential drive in the symbols of the book's two-wheel equations.
#[derive(Clone, Copy)]
pub struct Differential {
    /// Mass of the whole, kg.
    pub mass: f64,
    /// Centre of mass ahead of the axle, m.
    pub ahead: f64,
    /// Yaw inertia about the centre of mass, kg·m².
    pub inertia_com: f64,
    /// Half the track, m.
    pub half_track: f64,
    /// Wheel radius, m.
    pub radius: f64,
    /// Spin inertia of each wheel, kg·m².
    pub spin_inertia: f64,
    /// Viscous coefficient of each axle, N·m·s/rad.
    pub viscous: f64,
    /// Dry friction of each axle, N·m.
    pub dry: f64,
    /// Brake of each axle, N·m.
    pub brake: f64,
    /// Drive of each axle.
    pub drive: Drive<f64>,
}

/// The robot of the sleigh in the validation chapter.
pub const SLEIGH: Differential = Differential {
    mass: 9.0,
    ahead: 0.05,
    inertia_com: 0.16,
    half_track: 0.1655,
    radius: 0.0975,
    spin_inertia: 0.004,
    viscous: 0.0,
    dry: 0.0,
    brake: 0.0,
    drive: Drive::Torque {
        torque_max: f64::INFINITY,
    },
};

/// A motor whose L/R is `time_constant`, s.
pub fn motor(time_constant: f64) -> Drive<f64> {
    Drive::DcMotor(DcMotor {
        resistance: 1.2,
        inductance: 1.2 * time_constant,
        torque_constant: 0.05,
        back_emf_constant: 0.05,
        gear_ratio: 20.0,
        gear_efficiency: 1.0,
        voltage_max: 24.0,
        current_max: f64::MAX,
    })
}

impl Differential {
    pub fn platform(&self) -> Platform<f64> {
        let wheel = |name: &str, side: f64| Wheel {
            name: name.into(),
            mount: vec2(0.0, side),
            radius: self.radius,
            steering: Steering::Fixed { angle: 0.0 },
            rim: Rim::Plain,
            mass: 0.0,
            inertia_vertical: 0.0,
            spin_inertia: self.spin_inertia,
            viscous: self.viscous,
            pivot_viscous: 0.0,
            dry_friction: self.dry,
            friction_rounding: 0.0,
            stiffness: 1.0,
            brake: self.brake,
            drive: self.drive,
        };
        let body = Body {
            mass: self.mass,
            inertia_com: self.inertia_com,
            center_of_mass: vec2(self.ahead, 0.0),
            com_height: 0.1,
        };
        Platform::new(
            body,
            vec![
                wheel("left", self.half_track),
                wheel("right", -self.half_track),
            ],
        )
        .expect("two wheels on an axle are a platform")
    }

    pub fn rolling(&self, ground: Ground<f64>) -> Rolling<f64> {
        Rolling::new(self.platform(), ground)
    }

    /// State at a pose with forward speed and yaw rate.
    pub fn state(&self, pose: [f64; 3], twist: [f64; 2]) -> Vec<f64> {
        let platform = self.platform();
        let layout = platform.layout();
        let mut x = vec![0.0; layout.state()];
        (x[0], x[1], x[YAW]) = (pose[0], pose[1], pose[2]);
        platform.renew_angles(&mut x);
        let at = layout.velocity();
        (x[at], x[at + 1]) = (twist[0], twist[1]);
        x
    }
}

/// How to integrate.
#[derive(Clone, Copy, Debug)]
pub enum Method {
    Rk4(f64),
    Exponential(f64),
    Adaptive(f64),
}

/// Integrates from 0 to `end` under a held input; returns state and mode.
pub fn integrate<S: Dynamics<f64>>(
    system: &S,
    x0: &[f64],
    u: &[f64],
    end: f64,
    method: Method,
) -> (Vec<f64>, Vec<f64>) {
    let sizes = system.sizes();
    let (mut x, mut mode) = (x0.to_vec(), vec![1.0; sizes.mode]);
    let held = Held(u);
    match method {
        Method::Rk4(step) => {
            let mut rk4 = RungeKutta4::new(sizes.state, sizes.input);
            for k in 0..(end / step).round() as usize {
                rk4.step(system, &held, k as f64 * step, step, &mut x, &mut mode);
            }
        }
        Method::Exponential(step) => {
            let mut method = Exponential::new(system, step).expect("a constant linear part");
            for k in 0..(end / step).round() as usize {
                method.step(system, &held, k as f64 * step, step, &mut x, &mut mode);
            }
        }
        Method::Adaptive(tolerance) => {
            let mut adaptive = Adaptive::new(system, tolerance, 0.1 * tolerance);
            adaptive
                .advance(system, &held, 0.0, end, &mut x, &mut mode, None)
                .expect("a smooth problem");
        }
    }
    (x, mode)
}

/// Observed order: least-squares slope of log error over log step.
#[allow(clippy::disallowed_methods)]
pub fn slope(steps: &[f64], errors: &[f64]) -> f64 {
    let n = steps.len() as f64;
    let (xs, ys): (Vec<f64>, Vec<f64>) = steps
        .iter()
        .zip(errors)
        .map(|(h, e)| (h.ln(), e.ln()))
        .unzip();
    let (mx, my) = (xs.iter().sum::<f64>() / n, ys.iter().sum::<f64>() / n);
    let top: f64 = xs.iter().zip(&ys).map(|(x, y)| (x - mx) * (y - my)).sum();
    top / xs.iter().map(|x| (x - mx) * (x - mx)).sum::<f64>()
}
