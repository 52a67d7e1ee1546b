//! What must hold whatever the numbers: energy, frames, mirrors, time reversal, parity of scalars.

use crate::common::{Differential, Method, SLEIGH, integrate, motor};
use appell_model::drive::{DcMotor, Drive};
use appell_model::dual::Dual;
use appell_model::dynamics::{Dynamics, Held};
use appell_model::ground::Ground;
use appell_model::integrate::{Exponential, RungeKutta4};
use appell_model::lanes::{AnyLanes, Lanes4, dispatch, narrow};
use appell_model::planar::vec2;
use appell_model::platform::{Body, Platform, YAW};
use appell_model::rolling::Rolling;
use appell_model::scalar::Scalar;
use appell_model::wheel::{Rim, Steering, Wheel, contact_velocity};

fn driven() -> Differential {
    Differential {
        drive: motor(1e-3),
        viscous: 1e-3,
        dry: 0.02,
        ..SLEIGH
    }
}

fn ledger(system: &Rolling<f64>, x: &[f64], u: &[f64], start: f64) -> (f64, f64) {
    let layout = system.platform().layout();
    let mut y = vec![0.0; layout.output()];
    system.output(x, u, &[1.0, 1.0], &mut y);
    let at = layout.ledger();
    let stored = y[3] + y[4] + y[5];
    let spent = x[at] - x[at + 1] - x[at + 2] - x[at + 3];
    let throughput = x[at].abs() + x[at + 1] + x[at + 3] + stored.abs();
    (stored - start - spent, throughput)
}

/// Energy in = stored + heat: 1e-10 of the throughput adaptively; 1e-6 at 1 ms with friction events.
#[test]
fn invariant_energy_ledger() {
    let robot = driven();
    let system = robot.rolling(Ground::plane(9.81, 0.1, 0.5));
    let layout = system.platform().layout().clone();
    let x0 = robot.state([0.0, 0.0, 0.2], [0.3, 0.4]);
    let mut u = vec![0.0; layout.input()];
    let (start, _) = ledger(&system, &x0, &u, 0.0);
    (u[0], u[1]) = (7.0, 9.0);
    for (method, tolerance) in [
        (Method::Adaptive(1e-12), 1e-10),
        (Method::Exponential(1e-3), 1e-6),
        (Method::Rk4(1e-4), 1e-6),
    ] {
        // Drives, coasts against friction until it stops, and drives off again.
        let (x, _) = integrate(&system, &x0, &u, 2.0, method);
        let off = vec![0.0; layout.input()];
        let (x, _) = integrate(&system, &x, &off, 3.0, method);
        let back: Vec<f64> = u.iter().map(|value| -value).collect();
        let (x, _) = integrate(&system, &x, &back, 1.0, method);
        let (residual, throughput) = ledger(&system, &x, &back, start);
        assert!(
            residual.abs() <= tolerance * throughput,
            "{method:?}: {:e} of {throughput}",
            residual / throughput
        );
    }
}

/// Turning and shifting the world turns and shifts the trajectory.
#[test]
fn invariant_frame_change() {
    let (turn, shift) = (0.9, [3.0, -2.0]);
    let run = |downhill: f64, pose: [f64; 3]| {
        let system = SLEIGH.rolling(Ground::plane(9.81, 0.1, downhill));
        let u = vec![0.0; system.sizes().input];
        integrate(
            &system,
            &SLEIGH.state(pose, [0.3, 0.5]),
            &u,
            2.0,
            Method::Rk4(1e-3),
        )
        .0
    };
    let a = run(0.3, [0.0, 0.0, 0.1]);
    let b = run(0.3 + turn, [shift[0], shift[1], 0.1 + turn]);
    let (sin, cos) = Scalar::sin_cos(turn);
    let moved = vec2(a[0], a[1]).rotated(cos, sin);
    // Roundings of positions of metres over 2000 steps.
    assert!((b[0] - shift[0] - moved.x).abs() < 1e-12);
    assert!((b[1] - shift[1] - moved.y).abs() < 1e-12);
    assert!((b[YAW] - turn - a[YAW]).abs() < 1e-12);
}

/// Swapping left and right mirrors the motion bit for bit.
#[test]
fn invariant_mirror() {
    let robot = driven();
    let system = robot.rolling(Ground::flat(9.81));
    let layout = system.platform().layout().clone();
    let run = |left: f64, right: f64, yaw_rate: f64| {
        let mut u = vec![0.0; layout.input()];
        (u[0], u[1]) = (left, right);
        integrate(
            &system,
            &robot.state([0.0; 3], [0.2, yaw_rate]),
            &u,
            2.0,
            Method::Rk4(1e-3),
        )
        .0
    };
    let (a, b) = (run(5.0, 9.0, 0.3), run(9.0, 5.0, -0.3));
    assert_eq!(a[0], b[0]);
    assert_eq!(a[1], -b[1]);
    assert_eq!(a[YAW], -b[YAW]);
}

/// A torque-free run, reversed, comes back.
#[test]
fn invariant_time_reversal() {
    let system = SLEIGH.rolling(Ground::flat(9.81));
    let u = vec![0.0; system.sizes().input];
    let x0 = SLEIGH.state([0.0, 0.0, 0.3], [0.5, 2.0]);
    let (mut x, _) = integrate(&system, &x0, &u, 2.0, Method::Rk4(1e-3));
    let at = system.platform().layout().velocity();
    x[at] = -x[at];
    x[at + 1] = -x[at + 1];
    let (back, _) = integrate(&system, &x, &u, 2.0, Method::Rk4(1e-3));
    // Against the stable direction errors grow by e^{2 k t} ≈ 150: RK4's 1e-12 stays below 1e-10.
    for k in 0..3 {
        assert!(
            (back[k] - x0[k]).abs() < 1e-10,
            "{k}: {:e}",
            back[k] - x0[k]
        );
    }
}

fn lift<T: Scalar>(platform: &Platform<f64>) -> Rolling<T> {
    let platform = platform.map(&mut |_, value| T::from(value));
    let plane = Ground::plane(9.81, 0.1, 0.5);
    let ground = Ground {
        gravity: vec2(T::from(plane.gravity.x), T::from(plane.gravity.y)),
        gravity_normal: T::from(plane.gravity_normal),
    };
    Rolling::new(platform, ground)
}

fn steps<T: Scalar>(system: &Rolling<T>, x0: &[T], u: &[T], count: usize) -> Vec<T> {
    let sizes = system.sizes();
    let (mut x, mut mode) = (x0.to_vec(), vec![T::one(); sizes.mode]);
    let mut rk4 = RungeKutta4::new(sizes.state, sizes.input);
    for k in 0..count {
        rk4.step(system, &Held(u), k as f64 * 5e-4, 5e-4, &mut x, &mut mode);
    }
    x
}

/// Lane i of a lane run, and the value of a dual run, equal the scalar run bit for bit, through
/// friction that stops one lane and not another.
#[test]
fn invariant_scalars_agree() {
    let robot = driven();
    let platform = robot.platform();
    let scalar: Rolling<f64> = lift(&platform);
    let size = scalar.sizes();
    let starts: Vec<Vec<f64>> = (0..4)
        .map(|k| robot.state([0.0, 0.0, 0.1 * k as f64], [0.05 * k as f64, 0.2]))
        .collect();
    let mut u = vec![0.0; size.input];
    (u[0], u[1]) = (0.2, -0.1);
    let runs: Vec<Vec<f64>> = starts
        .iter()
        .map(|x0| steps(&scalar, x0, &u, 3000))
        .collect();
    let at = platform.layout().velocity();
    assert!(runs.iter().any(|x| x[at] == 0.0) || runs.iter().any(|x| x[at] != 0.0));

    let lanes: Rolling<Lanes4> = lift(&platform);
    let x0: Vec<Lanes4> = (0..size.state)
        .map(|k| Lanes4::from_lanes(|i| starts[i][k]))
        .collect();
    let held: Vec<Lanes4> = u.iter().map(|&value| Lanes4::from(value)).collect();
    let x = steps(&lanes, &x0, &held, 3000);
    for (i, run) in runs.iter().enumerate() {
        for k in 0..size.state {
            assert_eq!(
                x[k].lane(i).to_bits(),
                run[k].to_bits(),
                "lane {i}, state {k}"
            );
        }
    }

    let duals: Rolling<Dual<f64, 1>> = lift(&platform);
    let x0: Vec<_> = starts[1]
        .iter()
        .map(|&value| Dual::<f64, 1>::from(value))
        .collect();
    let held: Vec<_> = u.iter().map(|&value| Dual::<f64, 1>::from(value)).collect();
    let x = steps(&duals, &x0, &held, 3000);
    for k in 0..size.state {
        assert_eq!(x[k].value.to_bits(), runs[1][k].to_bits(), "state {k}");
    }
}

/// Energy in = stored + heat, also while the driver holds the voltage back to limit the current.
#[test]
fn invariant_energy_ledger_at_the_current_limit() {
    let Drive::DcMotor(free) = motor(1e-3) else {
        unreachable!("a motor is a motor");
    };
    let robot = Differential {
        drive: Drive::DcMotor(DcMotor {
            current_max: 2.0,
            ..free
        }),
        viscous: 1e-3,
        ..SLEIGH
    };
    let system = robot.rolling(Ground::flat(9.81));
    let mut u = vec![0.0; system.sizes().input];
    (u[0], u[1]) = (20.0, 12.0);
    let x0 = robot.state([0.0; 3], [0.0; 2]);
    // The limit begins and ends within a step, where the methods are of low order; the exponential one
    // takes the voltage at the limit as of the middle of the step.
    for (method, tolerance) in [(Method::Rk4(1e-4), 1e-6), (Method::Exponential(1e-4), 1e-5)] {
        let (x, _) = integrate(&system, &x0, &u, 1.0, method);
        let (residual, throughput) = ledger(&system, &x, &u, 0.0);
        assert!(
            residual.abs() < tolerance * throughput,
            "{method:?}: {residual:e} of {throughput}"
        );
    }
}

/// Robots with motors side by side: the second is held back by its current limit, and where they are
/// `disturbed` the third is pushed and the fourth stands on a slope.
#[derive(Clone, Copy)]
struct Neighbors {
    disturbed: bool,
    is_exponential: bool,
    has_caster: bool,
    /// One of them, on all lanes.
    only: Option<usize>,
}

impl AnyLanes for Neighbors {
    type Output = Vec<Vec<u64>>;

    fn run<T: Scalar<Single = f64>>(self) -> Vec<Vec<u64>> {
        let of = |values: [f64; 4]| T::from_lanes(|lane| values[self.only.unwrap_or(lane) % 4]);
        let zero = T::zero();
        let wheel = |name: &str, side: f64| Wheel {
            name: name.into(),
            mount: vec2(T::from(0.01), T::from(side)),
            radius: of([0.05, 0.051, 0.052, 0.053]),
            steering: Steering::Fixed { angle: zero },
            rim: Rim::Plain,
            mass: T::from(0.3),
            inertia_vertical: zero,
            spin_inertia: T::from(1e-3),
            viscous: of([1e-3, 0.0, 2e-3, 1e-3]),
            pivot_viscous: zero,
            dry_friction: zero,
            friction_rounding: zero,
            stiffness: T::one(),
            brake: zero,
            drive: Drive::DcMotor(DcMotor {
                resistance: T::from(1.2),
                inductance: T::from(1.2e-3),
                torque_constant: T::from(0.05),
                back_emf_constant: T::from(0.05),
                gear_ratio: T::from(20.0),
                gear_efficiency: T::from(0.8),
                voltage_max: T::from(24.0),
                current_max: of([100.0, 0.5, 100.0, 100.0]),
            }),
        };
        let mut wheels = vec![wheel("left", 0.15), wheel("right", -0.16)];
        if self.has_caster {
            wheels.push(Wheel {
                steering: Steering::Free {
                    trail: T::from(0.03),
                },
                mass: zero,
                spin_inertia: zero,
                viscous: zero,
                drive: Drive::None,
                ..wheel("caster", -0.05)
            });
        }
        let body = Body {
            mass: of([9.0, 9.1, 9.2, 9.3]),
            inertia_com: T::from(0.1),
            center_of_mass: vec2(T::from(0.05), T::from(0.01)),
            com_height: T::from(0.1),
        };
        let platform = Platform::new(body, wheels).expect("a platform");
        let strength = T::from(f64::from(u8::from(self.disturbed)));
        let ground = Ground {
            gravity: vec2(
                of([0.0, 0.0, 0.0, 0.7]) * strength,
                of([0.0, 0.0, 0.0, -0.4]) * strength,
            ),
            gravity_normal: T::from(9.7),
        };
        let system = Rolling::new(platform, ground);
        let (sizes, layout) = (system.sizes(), system.platform().layout().clone());
        let mut x = vec![zero; sizes.state];
        system.platform().renew_angles(&mut x);
        let mut u = vec![zero; sizes.input];
        (u[0], u[1]) = (of([6.0, 7.0, 5.0, 6.0]), of([5.0, -4.0, 30.0, 5.0]));
        for (k, push) in [3.0, -1.0, 0.2].into_iter().enumerate() {
            u[layout.wrench_input() + k] = of([0.0, 0.0, push, 0.0]) * strength;
        }
        let mut mode = vec![T::one(); sizes.mode];
        if self.is_exponential {
            let mut method = Exponential::new(&system, 1e-3).expect("motors are linear");
            method.steps(&system, &Held(&u), 0.0, 1e-3, 500, &mut x, &mut mode);
        } else {
            let mut method = RungeKutta4::new(sizes.state, sizes.input);
            method.steps(&system, &Held(&u), 0.0, 1e-3, 500, &mut x, &mut mode);
        }
        let bits = |lane: usize| x.iter().map(|value| value.lane(lane).to_bits()).collect();
        (0..T::LANES.min(4)).map(bits).collect()
    }
}

/// What a neighbor in the lanes goes through changes no bit of a robot, whatever the registers, and
/// though steps are then made in another way.
#[test]
fn invariant_neighbors_change_no_bit() {
    let choices = [false, true];
    let all = choices.iter().flat_map(|a| choices.map(|b| (*a, b)));
    for (is_exponential, has_caster) in all {
        let neighbors = |disturbed: bool, only: Option<usize>| Neighbors {
            disturbed,
            is_exponential,
            has_caster,
            only,
        };
        for disturbed in choices {
            let alone: Vec<Vec<u64>> = (0..4)
                .map(|k| dispatch(1, neighbors(disturbed, Some(k))).remove(0))
                .collect();
            for lanes in [4, 8] {
                let together = dispatch(lanes, neighbors(disturbed, None));
                let count = together.len();
                assert_eq!(together, alone[..count], "{lanes} lanes");
            }
            let portable = neighbors(disturbed, None).run::<Lanes4>();
            assert_eq!(portable, alone, "portable lanes");
        }
        // The first two are not pushed either way.
        for k in 0..2 {
            let of = |disturbed: bool| dispatch(1, neighbors(disturbed, Some(k)));
            assert_eq!(of(false), of(true), "robot {k}");
        }
    }
}

/// Lanes of single precision have one run's bits, whatever the registers, and stay beside those of double
/// precision: within 1e-4 of each number, or of one, after 500 steps (1.3e-5 in a current).
#[test]
fn invariant_narrow_lanes_have_the_same_bits_and_four_digits() {
    let choices = [false, true];
    let all = choices.iter().flat_map(|a| choices.map(|b| (*a, b)));
    for (is_exponential, has_caster) in all {
        let neighbors = |only: Option<usize>| Neighbors {
            disturbed: true,
            is_exponential,
            has_caster,
            only,
        };
        let alone: Vec<Vec<u64>> = (0..4)
            .map(|k| narrow::dispatch(1, neighbors(Some(k))).remove(0))
            .collect();
        for lanes in [8, 16] {
            let together = narrow::dispatch(lanes, neighbors(None));
            assert_eq!(together, alone, "{lanes} lanes");
        }
        for (robot, narrow) in alone.iter().enumerate() {
            let wide = dispatch(1, neighbors(Some(robot))).remove(0);
            for (k, (a, b)) in narrow.iter().zip(&wide).enumerate() {
                let (a, b) = (f64::from_bits(*a), f64::from_bits(*b));
                assert!(
                    (a - b).abs() < 1e-4 * b.abs().max(1.0),
                    "robot {robot}, state {k}: {a} for {b}"
                );
            }
        }
    }
}

/// The derivative of the end state to the mass, by dual numbers and by central differences.
#[test]
fn invariant_dual_equals_difference() {
    let robot = Differential {
        drive: motor(1e-3),
        ..SLEIGH
    };
    let end = |mass: f64| {
        let robot = Differential { mass, ..robot };
        let system = robot.rolling(Ground::flat(9.81));
        let mut u = vec![0.0; system.sizes().input];
        (u[0], u[1]) = (6.0, 8.0);
        integrate(
            &system,
            &robot.state([0.0; 3], [0.2, 0.1]),
            &u,
            1.0,
            Method::Rk4(1e-3),
        )
        .0
    };
    let h = 1e-4;
    let (up, down) = (end(robot.mass + h), end(robot.mass - h));
    let platform = robot.platform().map(&mut |path, value| {
        if path == "body.mass" {
            Dual::<f64, 1>::variable(value, 0)
        } else {
            Dual::from(value)
        }
    });
    let flat = Ground {
        gravity: vec2(Dual::from(0.0), Dual::from(0.0)),
        gravity_normal: Dual::from(9.81),
    };
    let system = Rolling::new(platform, flat);
    let mut u = vec![Dual::from(0.0); system.sizes().input];
    (u[0], u[1]) = (Dual::from(6.0), Dual::from(8.0));
    let mut x: Vec<_> = robot
        .state([0.0; 3], [0.2, 0.1])
        .into_iter()
        .map(Dual::<f64, 1>::from)
        .collect();
    let mut mode = vec![Dual::from(1.0); 2];
    let mut rk4 = RungeKutta4::new(x.len(), u.len());
    for k in 0..1000 {
        rk4.step(&system, &Held(&u), k as f64 * 1e-3, 1e-3, &mut x, &mut mode);
    }
    for k in 0..3 {
        let difference = (up[k] - down[k]) / (2.0 * h);
        // Central differences: h² truncation and ε/h rounding, both about 1e-9 here.
        assert!((x[k].derivative[0] - difference).abs() < 1e-8, "state {k}");
    }
}

/// Ideal rolling: the contact velocity vanishes along what the rims resist.
#[test]
fn invariant_contacts_do_not_slip() {
    let platform = SLEIGH.platform();
    let layout = platform.layout();
    let x = SLEIGH.state([0.0, 0.0, 0.4], [0.7, -1.3]);
    let v = &x[layout.velocity()..layout.velocity() + layout.dof()];
    let (velocity, yaw_rate) = platform.twist(v);
    for (i, wheel) in platform.wheels().iter().enumerate() {
        let frame = platform.wheel_frame(i, &x);
        let rate = appell_model::solve::dot(layout.dof(), &platform.spin_row(i, &frame), v);
        let slip = contact_velocity(wheel, &frame, velocity, yaw_rate, 0.0, rate);
        assert!(slip.dot(frame.forward).abs() < 1e-15 && slip.dot(frame.left).abs() < 1e-15);
    }
    assert!(matches!(platform.wheels()[0].drive, Drive::Torque { .. }));
}

/// Motors with a limit of current that is met, on a robot with one caster or none.
fn alike(caster: bool) -> Platform<f64> {
    let mut robot = Differential {
        viscous: 2e-3,
        drive: motor(2e-3),
        ..SLEIGH
    };
    if let Drive::DcMotor(motor) = &mut robot.drive {
        motor.current_max = 6.0;
        motor.gear_efficiency = 0.8;
    }
    let platform = robot.platform();
    let mut wheels = platform.wheels().to_vec();
    if caster {
        let follower = Wheel {
            name: "caster".into(),
            mount: vec2(-0.2, 0.03),
            steering: Steering::Free { trail: 0.03 },
            spin_inertia: 0.0,
            viscous: 0.0,
            drive: Drive::None,
            ..wheels[0].clone()
        };
        wheels.push(follower);
    }
    Platform::new(*platform.body(), wheels).expect("a platform")
}

/// Wheels that are alike are stepped by sum and difference, others one by one, and both come to what the
/// method with error control says, which knows neither.
#[test]
fn peer_alike_wheels_with_error_control() {
    for caster in [false, true] {
        for (ground, tolerance) in [
            (Ground::flat(9.81), 2e-8),
            (Ground::plane(9.81, 0.1, 0.5), 2e-8),
        ] {
            let platform = alike(caster);
            let mut wheels = platform.wheels().to_vec();
            wheels[1].viscous *= 1.0 + 4.0 * f64::EPSILON;
            let unlike = Platform::new(*platform.body(), wheels).expect("a platform");
            let paired = Rolling::new(platform, ground);
            let apart = Rolling::new(unlike, ground);
            assert!(paired.is_paired() && !apart.is_paired());
            let mut u = vec![0.0; paired.sizes().input];
            (u[0], u[1]) = (9.0, 6.5);
            let mut x = vec![0.0; paired.sizes().state];
            x[YAW] = 0.4;
            paired.platform().renew_angles(&mut x);
            let (truth, _) = integrate(&paired, &x, &u, 1.5, Method::Adaptive(1e-13));
            for method in [Method::Rk4(5e-4), Method::Exponential(5e-4)] {
                let (together, _) = integrate(&paired, &x, &u, 1.5, method);
                let (one_by_one, _) = integrate(&apart, &x, &u, 1.5, method);
                let limit = match method {
                    // The limit of current is met at first: there its order is one less.
                    Method::Exponential(_) => 1e-4,
                    _ => 1e-5,
                };
                let scale = truth
                    .iter()
                    .fold(1.0_f64, |most, value| most.max(value.abs()));
                for k in 0..x.len() {
                    assert!(
                        (together[k] - one_by_one[k]).abs() < tolerance * scale,
                        "{caster} {method:?} {k}: {} and {}",
                        together[k],
                        one_by_one[k]
                    );
                    assert!(
                        (together[k] - truth[k]).abs() < limit * scale,
                        "{caster} {method:?} {k}: {} and {}",
                        together[k],
                        truth[k]
                    );
                }
            }
        }
    }
}

/// Energies and angles of wheels are left out where nobody reads them; the rest keeps its bits, in
/// every lane.
#[test]
fn invariant_what_is_left_out_changes_no_other_bit() {
    struct Left {
        exponential: bool,
        caster: bool,
    }

    impl AnyLanes for Left {
        type Output = ();

        fn run<T: Scalar<Single = f64>>(self) {
            let platform = alike(self.caster).map(&mut |_, number: f64| T::from(number));
            let whole = Rolling::new(platform, Ground::flat(T::from(9.81)));
            let mut bare = whole.clone();
            bare.leave_out();
            let sizes = whole.sizes();
            let mut u = vec![T::zero(); sizes.input];
            (u[0], u[1]) = (T::from(9.0), T::from_lanes(|lane| 6.5 + 0.1 * lane as f64));
            let start = {
                let mut x = vec![T::zero(); sizes.state];
                whole.platform().renew_angles(&mut x);
                x
            };
            let run = |system: &Rolling<T>| {
                let (mut x, mut mode) = (start.clone(), vec![T::one(); sizes.mode]);
                let held = Held(&u[..]);
                if self.exponential {
                    let mut method = Exponential::new(system, 1e-3).expect("motors are linear");
                    method.steps(system, &held, 0.0, 1e-3, 800, &mut x, &mut mode);
                } else {
                    let mut method = RungeKutta4::new(sizes.state, sizes.input);
                    method.steps(system, &held, 0.0, 1e-3, 800, &mut x, &mut mode);
                }
                x
            };
            let (kept, left) = (run(&whole), run(&bare));
            let at = whole.platform().layout().ledger();
            for k in (0..at).chain(at + 6..sizes.state) {
                assert_eq!(kept[k], left[k], "state {k} of {}", T::LANES);
            }
            // Not by chance: it is left out where there are twins.
            if T::LANES > 1 {
                assert!(left[at..at + 6].iter().all(|value| *value == T::zero()));
                assert!(kept[at..at + 6].iter().all(|value| *value != T::zero()));
            }
        }
    }

    for exponential in [false, true] {
        for caster in [false, true] {
            for lanes in [1, 4, 8] {
                let left = || Left {
                    exponential,
                    caster,
                };
                dispatch(lanes, left());
                narrow::dispatch(2 * lanes, left());
            }
        }
    }
}
