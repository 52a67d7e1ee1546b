//! A thousand random platforms against the full equations: all velocities kept, wheels and fork masses
//! one by one, constraints by multipliers. Nothing of the reduced equations is used on that side.

// Components and coordinates are named by their indices.
#![allow(clippy::needless_range_loop)]

use appell_model::drive::Drive;
use appell_model::dual::Dual;
use appell_model::dynamics::Dynamics;
use appell_model::ground::Ground;
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform, PlatformError, WheelOutput, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::wheel::{Rim, Steering, Wheel};

/// Equally distributed numbers, the same everywhere (64-bit linear congruence).
struct Random(u64);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * ((self.0 >> 11) as f64 / (1_u64 << 53) as f64)
    }

    fn below(&mut self, count: u32) -> u32 {
        self.between(0.0, f64::from(count)) as u32
    }
}

/// Two to six wheels; fixed ones mostly share an axle, as on robots that move.
fn platform(random: &mut Random) -> Result<Platform<f64>, PlatformError> {
    let count = 2 + random.below(5);
    let axle = random.between(-3.0, 3.0);
    let (sin, cos) = Scalar::sin_cos(axle);
    let mut lead: Option<usize> = None;
    let wheels = (0..count).map(|k| {
        let place = [random.between(-0.5, 0.5), random.between(-0.4, 0.4)];
        let (steering, rim, mount) = match random.below(8) {
            // On the axle through the origin: offset along n only.
            0 | 1 => (
                Steering::Fixed { angle: axle },
                Rim::Plain,
                [-sin * place[0], cos * place[0]],
            ),
            // Anywhere: a second axle locks a robot, or leaves it one circle.
            2 => (
                Steering::Fixed {
                    angle: random.between(-3.0, 3.0),
                },
                Rim::Plain,
                place,
            ),
            3 => {
                let side = if random.below(2) == 0 { 1.0 } else { -1.0 };
                (
                    Steering::Free {
                        trail: side * random.between(0.02, 0.1),
                    },
                    Rim::Plain,
                    place,
                )
            }
            4 => {
                let steering = match lead {
                    Some(lead) if random.below(2) == 0 => Steering::Linked {
                        lead,
                        ratio: random.between(-1.5, 1.5),
                    },
                    _ => {
                        lead = Some(k as usize);
                        Steering::Driven
                    }
                };
                (steering, Rim::Plain, place)
            }
            _ => (
                Steering::Fixed {
                    angle: random.between(-3.0, 3.0),
                },
                Rim::Rollers {
                    angle: random.between(-1.2, 1.2),
                },
                place,
            ),
        };
        let light = random.below(3) == 0 && matches!(steering, Steering::Free { .. });
        let mut some = |low: f64, high: f64| {
            let value = random.between(low, high);
            if light { 0.0 } else { value }
        };
        Wheel {
            name: format!("w{k}"),
            mount: vec2(mount[0], mount[1]),
            steering,
            rim,
            mass: some(0.1, 1.0),
            inertia_vertical: some(1e-3, 5e-3),
            spin_inertia: some(1e-3, 1e-2),
            viscous: some(0.0, 0.1),
            pivot_viscous: some(0.0, 0.02),
            radius: random.between(0.05, 0.15),
            dry_friction: 0.0,
            friction_rounding: 0.0,
            stiffness: 1.0,
            brake: 0.0,
            drive: match steering {
                Steering::Free { .. } => Drive::None,
                _ => Drive::Torque {
                    torque_max: f64::INFINITY,
                },
            },
        }
    });
    let wheels: Vec<Wheel<f64>> = wheels.collect();
    let body = Body {
        mass: random.between(3.0, 20.0),
        inertia_com: random.between(0.1, 1.0),
        center_of_mass: vec2(random.between(-0.1, 0.1), random.between(-0.1, 0.1)),
        com_height: 0.2,
    };
    Platform::new(body, wheels)
}

/// A number with its rate of time.
type D = Dual<f64, 1>;

fn d(value: f64, rate: f64) -> D {
    D {
        value,
        derivative: [rate],
    }
}

/// A column of a Jacobian in the plane, times the velocity of its coordinate.
#[derive(Clone, Copy)]
struct Part {
    /// Which velocity: V_x, V_y, ω, then γ̇ and φ̇ of each wheel.
    coordinate: usize,
    at: [D; 2],
}

/// What the full equations leave: of the constraints at the level of velocities and of accelerations,
/// of the dynamics, and of the power; each relative to its own terms.
fn residuals(platform: &Platform<f64>, random: &mut Random) -> [f64; 4] {
    let layout = platform.layout().clone();
    let ground = Ground::plane(9.81, 0.1, 0.7);
    let system = Rolling::new(platform.clone(), ground);
    let sizes = system.sizes();
    let mode = vec![1.0; sizes.mode];
    let mut u: Vec<f64> = (0..sizes.input)
        .map(|_| random.between(-1.0, 1.0))
        .collect();
    u[layout.brake_input()] = 0.0;
    let mut x = vec![0.0; sizes.state];
    x[YAW] = random.between(-3.0, 3.0);
    for k in 0..layout.swivels.len() {
        x[layout.swivel(k)] = random.between(-3.0, 3.0);
    }
    for k in 0..layout.dof() {
        x[layout.velocity() + k] = random.between(-1.0, 1.0);
    }
    // Steered wheels allow what they allow.
    let mut now = mode.clone();
    system.settle(&mut x, &u, &mut now);
    let (mut dx, mut y) = (vec![0.0; sizes.state], vec![0.0; sizes.output]);
    system.derivative(&x, &u, &mode, &mut dx);
    system.output(&x, &u, &mode, &mut y);

    // The same outputs with their rates along the motion.
    let lifted: Rolling<D> = Rolling::new(
        platform.map(&mut |_, value| D::from(value)),
        Ground {
            gravity: vec2(D::from(ground.gravity.x), D::from(ground.gravity.y)),
            gravity_normal: D::from(ground.gravity_normal),
        },
    );
    let along: Vec<D> = x
        .iter()
        .zip(&dx)
        .map(|(&value, &rate)| d(value, rate))
        .collect();
    let held: Vec<D> = u.iter().map(|&value| D::from(value)).collect();
    let senses = vec![D::from(1.0); sizes.mode];
    let mut moving = vec![D::from(0.0); sizes.output];
    lifted.output(&along, &held, &senses, &mut moving);

    // All velocities with their rates.
    let wheels = platform.wheels();
    let n = 3 + 2 * wheels.len();
    let mut nu = vec![D::from(0.0); n];
    nu[..3].copy_from_slice(&moving[..3]);
    for i in 0..wheels.len() {
        nu[3 + 2 * i] = moving[layout.wheel_output(i, WheelOutput::SteeringRate)];
        nu[4 + 2 * i] = moving[layout.wheel_output(i, WheelOutput::SpinRate)];
    }
    let turn = nu[2];
    let gravity = ground.gravity.rotated(x[YAW + 1], -x[YAW + 2]);

    // Generalised forces, and what inertia demands: Σ m Jᵀ (d(Jν)/dt + ω Ω J ν).
    let mut balance = vec![0.0; n];
    let mut scale: f64 = 1e-3;
    let add = |parts: &[Part], mass: f64, balance: &mut Vec<f64>, scale: &mut f64| {
        let mut velocity = [D::from(0.0); 2];
        for part in parts {
            for axis in 0..2 {
                velocity[axis] += part.at[axis] * nu[part.coordinate];
            }
        }
        let acceleration = [
            velocity[0].derivative[0] - turn.value * velocity[1].value - gravity.x,
            velocity[1].derivative[0] + turn.value * velocity[0].value - gravity.y,
        ];
        for part in parts {
            for axis in 0..2 {
                let term = mass * part.at[axis].value * acceleration[axis];
                balance[part.coordinate] += term;
                *scale = scale.max(term.abs());
            }
        }
    };
    let one = || D::from(1.0);
    let zero = || D::from(0.0);
    let carried = |at: [D; 2]| {
        vec![
            Part {
                coordinate: 0,
                at: [one(), zero()],
            },
            Part {
                coordinate: 1,
                at: [zero(), one()],
            },
            Part {
                coordinate: 2,
                at: [-at[1], at[0]],
            },
        ]
    };
    let body = platform.body();
    let center = [
        D::from(body.center_of_mass.x),
        D::from(body.center_of_mass.y),
    ];
    add(&carried(center), body.mass, &mut balance, &mut scale);
    balance[2] += body.inertia_com * turn.derivative[0];
    let wrench = &u[layout.wrench_input()..layout.wrench_input() + 3];
    for (k, force) in wrench.iter().enumerate() {
        balance[k] -= force;
    }

    let mut slips: [f64; 2] = [0.0; 2];
    let mut power = wrench[0] * nu[0].value + wrench[1] * nu[1].value + wrench[2] * turn.value;
    let mut powers = power.abs();
    for (i, wheel) in wheels.iter().enumerate() {
        let (steer, spin) = (3 + 2 * i, 4 + 2 * i);
        let (sin, cos) = match wheel.steering {
            Steering::Fixed { angle } => D::from(angle).sin_cos(),
            _ => {
                let k = layout
                    .swivels
                    .iter()
                    .position(|&s| s == i)
                    .expect("it swivels");
                d(x[layout.swivel(k)], dx[layout.swivel(k)]).sin_cos()
            }
        };
        let trail = match wheel.steering {
            Steering::Free { trail } => trail,
            _ => 0.0,
        };
        let back = D::from(-trail);
        let contact = [
            D::from(wheel.mount.x) + back * cos,
            D::from(wheel.mount.y) + back * sin,
        ];
        let mut parts = carried(contact);
        // ∂r/∂γ = −d n.
        parts.push(Part {
            coordinate: steer,
            at: [-(back * sin), back * cos],
        });
        add(&parts, wheel.mass, &mut balance, &mut scale);
        let swing = wheel.inertia_vertical * (turn.derivative[0] + nu[steer].derivative[0]);
        balance[2] += swing;
        balance[steer] += swing + wheel.pivot_viscous * nu[steer].value;
        let torque = match wheel.drive {
            Drive::None => 0.0,
            _ => u[i],
        };
        let net = torque - wheel.viscous * nu[spin].value;
        balance[spin] += wheel.spin_inertia * nu[spin].derivative[0] - net;
        power += net * nu[spin].value - wheel.pivot_viscous * nu[steer].value * nu[steer].value;
        powers += (net * nu[spin].value).abs();
        if let Some(k) = layout.steered.iter().position(|&s| s == i) {
            let command = u[layout.steering_input() + k];
            balance[steer] -= command;
            power += command * nu[steer].value;
            powers += (command * nu[steer].value).abs();
        }

        // Constraints, and the forces that keep them.
        let force = |what| y[layout.wheel_output(i, what)];
        let mut constrain = |direction: [D; 2], lever: f64, force: f64| {
            let mut slip = -(D::from(lever) * nu[spin]);
            balance[spin] += lever * force;
            for part in &parts {
                let along = part.at[0] * direction[0] + part.at[1] * direction[1];
                slip += along * nu[part.coordinate];
                balance[part.coordinate] -= along.value * force;
            }
            scale = scale.max(force.abs());
            slips[0] = slips[0].max(slip.value.abs());
            slips[1] = slips[1].max(slip.derivative[0].abs());
        };
        match wheel.rim {
            Rim::Plain => {
                constrain([cos, sin], wheel.radius, force(WheelOutput::Longitudinal));
                constrain([-sin, cos], 0.0, force(WheelOutput::Lateral));
            }
            Rim::Rollers { angle } => {
                let (s, c) = Scalar::sin_cos(angle);
                let (s, c) = (D::from(s), D::from(c));
                let axis = [cos * c - sin * s, sin * c + cos * s];
                let lever = wheel.radius * c.value;
                constrain(axis, lever, force(WheelOutput::Longitudinal));
            }
        }
    }
    for (i, wheel) in wheels.iter().enumerate() {
        // A wheel that is fixed has no velocity of its own about the vertical, and no equation.
        if matches!(wheel.steering, Steering::Fixed { .. }) {
            balance[3 + 2 * i] = 0.0;
        }
        // What a link takes, its lead has to give.
        if let Steering::Linked { lead, ratio } = wheel.steering {
            balance[3 + 2 * lead] += ratio * balance[3 + 2 * i];
            balance[3 + 2 * i] = 0.0;
        }
    }
    let worst = balance
        .iter()
        .fold(0.0_f64, |worst, value| worst.max(value.abs()));
    let stored = moving[3].derivative[0] + moving[4].derivative[0];
    [
        slips[0],
        slips[1],
        worst / scale,
        (power - stored).abs() / (powers + stored.abs() + 1e-3),
    ]
}

#[test]
fn peer_full_equations_of_random_platforms() {
    let mut random = Random(20_261_122);
    let (mut mobile, mut locked) = (0, 0);
    let mut worst = [0.0_f64; 4];
    while mobile + locked < 1000 {
        match platform(&mut random) {
            Ok(platform) => {
                let layout = platform.layout();
                if layout.steered.len() < layout.guides.len() && layout.guides.len() >= layout.eta {
                    // A link that leaves no direction but near its singular angles, where rounding
                    // decides: no robot.
                    continue;
                }
                mobile += 1;
                let found = residuals(&platform, &mut random);
                // m/s; m/s²; forces relative to the largest; power relative to its terms. Found: 9e-15,
                // 2e-14, 9e-13 and 2e-13; rounding, with some reserve for unlucky geometries.
                for (k, bound) in [1e-12, 1e-11, 1e-10, 1e-11].into_iter().enumerate() {
                    worst[k] = worst[k].max(found[k]);
                    assert!(
                        found[k] <= bound,
                        "residual {k} is {:e} of {:#?}",
                        found[k],
                        platform.wheels()
                    );
                }
            }
            Err(PlatformError::Locked) => locked += 1,
            Err(other) => panic!("no such platform is built: {other:?}"),
        }
    }
    println!("{mobile} mobile, {locked} locked, worst {worst:?}");
    assert!(mobile >= 500, "{mobile} of 1000 are mobile");
    assert!(locked > 0, "some lock, and are refused for it");
}

/// The platform seen in a mirror along its x-axis.
fn mirrored(platform: &Platform<f64>) -> Platform<f64> {
    let turned = |wheel: &Wheel<f64>| Wheel {
        mount: vec2(wheel.mount.x, -wheel.mount.y),
        steering: match wheel.steering {
            Steering::Fixed { angle } => Steering::Fixed { angle: -angle },
            other => other,
        },
        rim: match wheel.rim {
            Rim::Plain => Rim::Plain,
            Rim::Rollers { angle } => Rim::Rollers { angle: -angle },
        },
        ..wheel.clone()
    };
    let center = platform.body().center_of_mass;
    let body = Body {
        center_of_mass: vec2(center.x, -center.y),
        ..*platform.body()
    };
    Platform::new(body, platform.wheels().iter().map(turned).collect()).expect("as mobile")
}

/// Where a platform is, how it moves and what acts on it.
struct Situation {
    yaw: f64,
    downhill: f64,
    twist: [f64; 3],
    angles: Vec<f64>,
    steering: Vec<f64>,
    torques: Vec<f64>,
    wrench: [f64; 3],
}

impl Situation {
    fn mirrored(&self) -> Situation {
        let turned = |all: &[f64]| all.iter().map(|value| -value).collect();
        let [x, y, turn] = self.wrench;
        Situation {
            yaw: -self.yaw,
            downhill: -self.downhill,
            twist: [self.twist[0], -self.twist[1], -self.twist[2]],
            angles: turned(&self.angles),
            steering: turned(&self.steering),
            torques: self.torques.clone(),
            wrench: [x, -y, -turn],
        }
    }

    /// Outputs, and the accelerations (V̇_x, V̇_y, ω̇).
    fn of(&self, platform: &Platform<f64>) -> (Vec<f64>, [f64; 3]) {
        let layout = platform.layout().clone();
        let system = Rolling::new(platform.clone(), Ground::plane(9.81, 0.1, self.downhill));
        let sizes = system.sizes();
        let (mut x, mut u) = (vec![0.0; sizes.state], vec![0.0; sizes.input]);
        x[YAW] = self.yaw;
        for k in 0..layout.swivels.len() {
            x[layout.swivel(k)] = self.angles[k];
        }
        let steered = layout.steered.len();
        let [forward, left, turn] = self.twist;
        let v = platform.velocity_from_twist(vec2(forward, left), turn, &self.steering[..steered]);
        x[layout.velocity()..][..layout.dof()].copy_from_slice(&v[..layout.dof()]);
        u[..layout.wheels].copy_from_slice(&self.torques[..layout.wheels]);
        for k in 0..steered {
            u[layout.steering_input() + k] = self.steering[k];
        }
        u[layout.wrench_input()..].copy_from_slice(&self.wrench);
        let mut mode = vec![1.0; sizes.mode];
        system.settle(&mut x, &u, &mut mode);
        let (mut dx, mut y) = (vec![0.0; sizes.state], vec![0.0; sizes.output]);
        system.derivative(&x, &u, &mode, &mut dx);
        system.output(&x, &u, &mode, &mut y);
        let (linear, angular) = platform.twist(&dx[layout.velocity()..]);
        (y, [linear.x, linear.y, angular])
    }
}

/// Where a robot stands and how the slope lies to it is all that counts; and a robot in a mirror
/// does what its image does. Forces, accelerations, twist and rates, relative to the largest.
#[test]
fn invariant_frames_and_mirrors_of_random_platforms() {
    let mut random = Random(42);
    let mut mobile = 0;
    let mut worst = 0.0_f64;
    while mobile < 1000 {
        let Ok(platform) = platform(&mut random) else {
            continue;
        };
        mobile += 1;
        let mut some =
            |count: usize| -> Vec<f64> { (0..count).map(|_| random.between(-1.0, 1.0)).collect() };
        let numbers = some(8);
        let here = Situation {
            yaw: 3.0 * numbers[0],
            downhill: 3.0 * numbers[1],
            twist: [numbers[2], numbers[3], numbers[4]],
            wrench: [numbers[5], numbers[6], numbers[7]],
            angles: some(6),
            steering: some(6),
            torques: some(6),
        };
        let turned = Situation {
            yaw: here.yaw + 0.7,
            downhill: here.downhill + 0.7,
            angles: here.angles.clone(),
            steering: here.steering.clone(),
            torques: here.torques.clone(),
            ..here
        };
        let (y, rates) = here.of(&platform);
        let images = [
            (turned.of(&platform), 1.0),
            (here.mirrored().of(&mirrored(&platform)), -1.0),
        ];
        let scale = y.iter().chain(&rates).fold(1.0_f64, |a, b| a.max(b.abs()));
        for ((image, image_rates), sign) in images {
            let layout = platform.layout();
            let mut pairs = vec![
                (rates[0], image_rates[0]),
                (rates[1], sign * image_rates[1]),
                (rates[2], sign * image_rates[2]),
                (y[0], image[0]),
                (y[1], sign * image[1]),
                (y[2], sign * image[2]),
                (y[3], image[3]),
                (y[6], image[6]),
            ];
            for i in 0..layout.wheels {
                for (what, sign) in [
                    (WheelOutput::SpinRate, 1.0),
                    (WheelOutput::SteeringRate, sign),
                    (WheelOutput::Torque, 1.0),
                    (WheelOutput::Longitudinal, 1.0),
                    (WheelOutput::Lateral, sign),
                    (WheelOutput::Load, 1.0),
                ] {
                    let at = layout.wheel_output(i, what);
                    pairs.push((y[at], sign * image[at]));
                }
            }
            for (value, image) in pairs {
                worst = worst.max((value - image).abs() / scale);
            }
        }
    }
    println!("worst {worst:e}");
    // Found: 2e-13; rounding, through inverses of ill-conditioned mass matrices.
    assert!(worst < 1e-11, "{worst:e}");
}
