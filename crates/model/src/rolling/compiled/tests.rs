//! The compiled equations against the general ones.

use super::*;
use crate::drive::DcMotor;
use crate::dynamics::Dynamics;
use crate::ground::Ground;
use crate::platform::{Body, Platform};
use crate::wheel::{Rim, Steering, Wheel};

fn wheel(mount: [f64; 2], rim: Rim<f64>, drive: Drive<f64>) -> Wheel<f64> {
    Wheel {
        name: format!("{mount:?}"),
        mount: vec2(mount[0], mount[1]),
        radius: 0.05,
        steering: Steering::Fixed { angle: 0.1 },
        rim,
        mass: 0.3,
        inertia_vertical: 2e-4,
        spin_inertia: 1e-3,
        viscous: 2e-3,
        pivot_viscous: 0.0,
        dry_friction: 0.02,
        friction_rounding: 0.1,
        brake: 0.0,
        stiffness: 1.0,
        drive,
    }
}

fn motor() -> Drive<f64> {
    Drive::DcMotor(DcMotor {
        resistance: 1.2,
        inductance: 1.2e-3,
        torque_constant: 0.05,
        back_emf_constant: 0.05,
        gear_ratio: 20.0,
        gear_efficiency: 0.8,
        voltage_max: 24.0,
        current_max: 10.0,
    })
}

fn caster() -> Wheel<f64> {
    Wheel {
        steering: Steering::Free { trail: 0.03 },
        mass: 0.0,
        inertia_vertical: 0.0,
        spin_inertia: 0.0,
        viscous: 0.0,
        dry_friction: 0.0,
        friction_rounding: 0.0,
        ..wheel([-0.2, 0.02], Rim::Plain, Drive::None)
    }
}

fn axle(drive: Drive<f64>) -> Vec<Wheel<f64>> {
    let mut wheels = [0.15, -0.16].map(|y| wheel([0.0, y], Rim::Plain, drive));
    for wheel in &mut wheels {
        wheel.steering = Steering::Fixed { angle: 0.0 };
    }
    wheels.to_vec()
}

/// The compiled outputs are those of the general equations, on a slope, under a wrench.
#[test]
fn peer_general_outputs() {
    let mecanum = [(0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15)].map(|(x, y)| {
        let angle = -0.7 * f64::signum(x * y);
        wheel([x, y], Rim::Rollers { angle }, motor())
    });
    let torque = Drive::Torque { torque_max: 5.0 };
    let robots = [
        axle(motor()),
        [axle(motor()), vec![caster()]].concat(),
        [axle(torque), vec![caster()]].concat(),
        mecanum.to_vec(),
    ];
    for wheels in robots {
        let body = Body {
            mass: 9.0,
            inertia_com: 0.1,
            center_of_mass: vec2(-0.05, 0.01),
            com_height: 0.1,
        };
        let ground = Ground {
            gravity: vec2(-0.7, 0.4),
            gravity_normal: 9.7,
        };
        let platform = Platform::new(body, wheels).expect("a platform");
        let rolling = Rolling::new(platform, ground);
        assert!(rolling.shape.is_some());
        let sizes = rolling.sizes();
        let x: Vec<f64> = (0..sizes.state)
            .map(|k| 0.3 + 0.2 * ((3 * k) % 7) as f64)
            .collect();
        let u: Vec<f64> = (0..sizes.input).map(|k| 2.0 - 0.7 * k as f64).collect();
        let mode = vec![1.0; sizes.mode];
        let [mut quick, mut general] = [(); 2].map(|()| vec![f64::NAN; sizes.output]);
        rolling.output(&x, &u, &mode, &mut quick);
        rolling.any_output(&x, &u, &mode, &mut general);
        for (k, (a, b)) in quick.iter().zip(&general).enumerate() {
            // Some twenty operations on forces of some 100 N.
            assert!((a - b).abs() < 1e-12 * (100.0 + b.abs()), "{k}: {a} {b}");
        }
    }
}
