#![allow(missing_docs)]
use appell_model::drive::*;
use appell_model::dynamics::{Dynamics, Held};
use appell_model::ground::Ground;
use appell_model::integrate::{Exponential, RungeKutta4};
use appell_model::planar::*;
use appell_model::platform::Body;
use appell_model::platform::Platform;
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::wheel::*;
use std::time::Instant;
fn lift<T: Scalar>(casters: usize) -> Rolling<T> {
    let f = |v: f64| T::from(v);
    let w = |name: &str, y: f64| Wheel {
        name: name.into(),
        mount: vec2(f(0.0), f(y)),
        radius: f(0.05),
        steering: Steering::Fixed { angle: f(0.0) },
        rim: Rim::Plain,
        mass: f(0.3),
        inertia_vertical: f(2e-4),
        spin_inertia: f(1e-3),
        viscous: f(1e-3),
        pivot_viscous: f(0.0),
        dry_friction: f(0.0),
        friction_rounding: f(0.0),
        brake: f(0.0),
        stiffness: f(1.0),
        drive: Drive::DcMotor(DcMotor {
            resistance: f(1.2),
            inductance: f(1.2e-3),
            torque_constant: f(0.05),
            back_emf_constant: f(0.05),
            gear_ratio: f(20.0),
            gear_efficiency: f(0.8),
            voltage_max: f(24.0),
            current_max: f(10.0),
        }),
    };
    let mut wheels = vec![w("l", 0.15), w("r", -0.15)];
    if casters > 0 {
        let mut c = w("c", 0.0);
        c.mount = vec2(f(-0.2), f(0.0));
        c.steering = Steering::Free { trail: f(0.03) };
        c.mass = f(0.0);
        c.inertia_vertical = f(0.0);
        c.spin_inertia = f(0.0);
        c.viscous = f(0.0);
        c.drive = Drive::None;
        wheels.push(c);
    }
    let p = Platform::new(
        Body {
            mass: f(9.0),
            inertia_com: f(0.1),
            center_of_mass: vec2(f(0.05), f(0.0)),
            com_height: f(0.1),
        },
        wheels,
    )
    .unwrap();
    Rolling::new(p, Ground::flat(f(9.81)))
}
fn run<T: Scalar>(name: &str, casters: usize) {
    let s = lift::<T>(casters);
    let z = s.sizes();
    let mut x = vec![T::zero(); z.state];
    x[3] = T::one();
    let mut u = vec![T::zero(); z.input];
    u[0] = T::from(6.0);
    u[1] = T::from(5.0);
    let mut mode = vec![T::one(); z.mode];
    let mut m = RungeKutta4::new(z.state, z.input);
    let mut e = Exponential::new(&s, 0.001).unwrap();
    let (mut b1, mut b2) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..40 {
        let n = 2000;
        let t = Instant::now();
        m.steps(&s, &Held(&u), 0.0, 0.001, n, &mut x, &mut mode);
        b1 = b1.min(t.elapsed().as_secs_f64() / n as f64);
        let t = Instant::now();
        e.steps(&s, &Held(&u), 0.0, 0.001, n, &mut x, &mut mode);
        b2 = b2.min(t.elapsed().as_secs_f64() / n as f64);
    }
    println!(
        "{name} casters {casters}: rk4 {:.1} ns/step, {:.2} ns per robot = {:.0} M/s; etd {:.1}, {:.2} = {:.0} M/s",
        b1 * 1e9,
        b1 * 1e9 / T::LANES as f64,
        1e-6 / b1 * T::LANES as f64,
        b2 * 1e9,
        b2 * 1e9 / T::LANES as f64,
        1e-6 / b2 * T::LANES as f64
    );
}
struct Try(usize);
impl appell_model::lanes::AnyLanes for Try {
    type Output = ();
    fn run<T: Scalar>(self) {
        run::<T>(&format!("x{}", T::LANES), self.0);
    }
}
fn main() {
    for c in [0, 1] {
        for l in [1, 4, 8] {
            appell_model::lanes::dispatch(l, Try(c));
        }
    }
}
