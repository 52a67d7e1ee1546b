//! The plant: a platform at a level of model, with an integrator, as a [`Block`].

mod alone;
mod ports;

use std::any::Any;

use appell_model::dynamics::{Dynamics, Held};
use appell_model::ground::Ground;
use appell_model::integrate::{
    Adaptive, Exponential, RungeKutta4, Stalled, observe, spectral_radius,
};
use appell_model::kinematic::Kinematic;
use appell_model::lanewise::Lanewise;
use appell_model::math::hypot;
use appell_model::planar::vec2;
use appell_model::platform::{LEDGER, Layout, Platform};
use appell_model::rolling::Rolling;
use appell_model::scalar::{Mask, Scalar};

use crate::block::{
    Block, BlockError, Detail, Now, Port, Recovery, finite_lanes, restore_numbers, save_numbers,
};
use crate::scenario::{Integrator, Level};

pub use alone::Contacts;
use alone::{Alone, Motion, on_footing, sliding, underivable};
use ports::{Outputs, inputs};
pub use ports::{command_signal, steering_signal};

/// A platform that moves.
pub struct Plant<T: Scalar = f64> {
    name: String,
    system: System<T>,
    method: Method<T>,
    inputs: Vec<Port>,
    outputs: Outputs,
    x: Vec<T>,
    u: Vec<T>,
    mode: Vec<T>,
    y: Vec<T>,
    /// Where each command, and the brake, stand in the model's input.
    commands: Vec<usize>,
    brake: usize,
    /// Step of the physics, s.
    step: f64,
    /// Mechanical and magnetic energy at the start, J: where the ledger begins.
    energy_start: T,
}

/// A level of model.
enum System<T: Scalar> {
    Kinematic(Box<Kinematic<T>>),
    Rolling(Box<Rolling<T>>),
    Alone(Box<dyn Alone<T>>),
}

/// A way to integrate.
enum Method<T: Scalar> {
    RungeKutta4(RungeKutta4<T>),
    Exponential(Box<Exponential<T>>),
    Adaptive(Box<Adaptive<T>>),
    /// The level's own.
    Own,
}

/// Why a plant cannot be built; problem and hint.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantError {
    /// Which setting is at fault: `time.integrator`, `level`, …
    pub field: &'static str,
    /// What is wrong.
    pub problem: String,
    /// What would do.
    pub hint: String,
}

/// How a plant is integrated.
#[derive(Clone, Copy, Debug)]
pub struct Numerics {
    /// Method asked for.
    pub integrator: Integrator,
    /// Step of the physics, s.
    pub step: f64,
    /// Relative tolerance of the adaptive method.
    pub tolerance: f64,
    /// Whether wheels that are alike may be stepped by sum and difference.
    pub pairs: bool,
}

/// How a plant is stepped, which its numbers decide.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chosen {
    /// Method.
    pub integrator: Integrator,
    /// Whether its driven wheels are stepped by sum and difference.
    pub is_paired: bool,
}

/// Start of a plant.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a, T> {
    /// Pose x, y, yaw: m, m, rad.
    pub pose: [T; 3],
    /// Forward speed, m/s, and yaw rate, rad/s.
    pub twist: [T; 2],
    /// Angles of swivelling wheels, rad.
    pub angles: &'a [f64],
}

impl<T: Scalar> Plant<T> {
    /// Joins a platform with the contacts of its wheels to a ground, a level and an integrator.
    pub fn new(
        name: &str,
        platform: Platform<T>,
        contacts: Contacts<T>,
        ground: Ground<T>,
        level: Level,
        numerics: Numerics,
        start: Start<'_, T>,
    ) -> Result<Self, PlantError> {
        let layout = platform.layout().clone();
        let angles: Vec<T> = start.angles.iter().map(|&angle| T::from(angle)).collect();
        let mut x = crate::build::rest_state(&platform, start.pose, &angles);
        let forward = vec2(start.twist[0], T::zero());
        let v = platform.velocity_from_twist(forward, start.twist[1], &[]);
        if level == Level::Rolling {
            let at = layout.velocity();
            x[at..at + layout.dof()].copy_from_slice(&v[..layout.dof()]);
        }
        let u = vec![T::zero(); layout.input()];
        // Wheels with friction start as their rates say: at rest they stick until pushed.
        let mut mode = senses(&wheel_rates(&platform, &x, &v));
        let driven: Vec<usize> = (0..layout.wheels)
            .filter(|&i| command_signal(&platform.wheels()[i].drive).is_some())
            .collect();
        let is_overdriven = driven.len() > layout.eta;
        let mut commands = driven;
        commands.extend((0..layout.steered.len()).map(|k| layout.steering_input() + k));
        let prefix = format!("robot.{name}");
        // Lanes and single precision know neither slip nor uneven ground; what they get instead fits
        // none of it.
        let alone = if const { T::LANES > 1 || T::IS_NARROW } {
            None
        } else if contacts.relief.is_some() || (level == Level::Slip && contacts.springs.is_some())
        {
            let angles = start.angles;
            let made = on_footing(&platform, &contacts, &ground, level, numerics, angles);
            Some(made.ok_or_else(|| underivable(&contacts))??)
        } else if level == Level::Slip {
            Some(sliding(platform.clone(), contacts, ground)?)
        } else {
            None
        };
        let inputs = inputs(&prefix, &platform, level);
        let (system, method) = if let Some(system) = alone {
            let at_rest = crate::build::rest_state(system.platform(), start.pose, &angles);
            let motion = Motion {
                velocity: forward,
                yaw_rate: start.twist[1],
                steering: &[],
                spin: None,
            };
            (x, mode) = system.state(&at_rest, &motion);
            system.rest(&mut x).map_err(|problem| PlantError {
                field: "pose",
                problem: format!("must be where the robot can stand: {problem}"),
                hint: "start it elsewhere".into(),
            })?;
            (System::Alone(system), Method::Own)
        } else {
            // What the method is chosen by: the nominal robot.
            let nominal = platform.map(&mut |_, number: T| number.lane(0));
            if level == Level::Kinematic {
                let system = Kinematic::new(platform).ok_or_else(undetermined)?;
                let twin = Kinematic::new(nominal).expect("as the one on lanes");
                let radius = fastest(&twin, twin.platform(), start.angles);
                let method = method(&system, radius, numerics)?;
                (System::Kinematic(Box::new(system)), method)
            } else {
                let mut system = Rolling::new(platform, ground);
                if !numerics.pairs {
                    system.part();
                }
                let own: &dyn Any = &system;
                let radius = match own.downcast_ref::<Rolling<f64>>() {
                    Some(own) => fastest(own, own.platform(), start.angles),
                    None => {
                        let gravity = vec2(ground.gravity.x.lane(0), ground.gravity.y.lane(0));
                        let gravity_normal = ground.gravity_normal.lane(0);
                        let even = Ground {
                            gravity,
                            gravity_normal,
                        };
                        let twin = Rolling::new(nominal, even);
                        fastest(&twin, twin.platform(), start.angles)
                    }
                };
                let method = method(&system, radius, numerics)?;
                (System::Rolling(Box::new(system)), method)
            }
        };
        let y = vec![T::zero(); system.outputs()];
        let outputs = Outputs::new(&prefix, &system, is_overdriven);
        let mut plant = Plant {
            name: prefix,
            system,
            method,
            inputs,
            outputs,
            x,
            u,
            mode,
            y,
            commands,
            brake: layout.brake_input(),
            step: numerics.step,
            energy_start: T::zero(),
        };
        plant.energy_start = plant.energy();
        Ok(plant)
    }

    /// The outputs that are always up to date.
    pub(crate) fn motion_ports(&self) -> &[Port] {
        self.outputs.motion()
    }

    fn layout(&self) -> &Layout {
        self.system.platform().layout()
    }

    /// The outputs of the model into y.
    #[inline(always)]
    fn look(&mut self, motion_only: bool) {
        let (x, u, mode, y) = (&self.x, &self.u, &self.mode, &mut self.y);
        match &self.system {
            System::Rolling(s) => observe(s.as_ref(), motion_only, x, u, mode, y),
            System::Kinematic(s) => observe(s.as_ref(), motion_only, x, u, mode, y),
            System::Alone(s) => s.observe(motion_only, x, u, mode, y),
        }
    }

    /// Kinetic, potential and magnetic energy together, J.
    fn energy(&mut self) -> T {
        self.look(false);
        self.y[3] + self.y[4] + self.y[5]
    }

    /// How it is stepped; levels with a method of their own need no choice.
    pub(crate) fn chosen(&self) -> Chosen {
        Chosen {
            integrator: match &self.method {
                Method::RungeKutta4(_) => Integrator::Rk4,
                Method::Exponential(_) => Integrator::Exponential,
                Method::Adaptive(_) => Integrator::Adaptive,
                Method::Own => Integrator::Auto,
            },
            is_paired: matches!(&self.system, System::Rolling(system) if system.is_paired()),
        }
    }

    /// The integrator that was chosen, in words.
    pub fn integrator(&self) -> String {
        match &self.system {
            System::Alone(system) => system.integrator(),
            _ => self.method.name(),
        }
    }
}

/// Why a platform cannot be commanded by the rates of its wheels.
fn undetermined() -> PlantError {
    PlantError {
        field: "level",
        problem: "must be another: the driven wheels do not determine the motion".into(),
        hint: "use level \"rolling\", or drive more wheels".into(),
    }
}

/// Modes of wheels that turn at these rates: the sense, or rest.
fn senses<T: Scalar>(rates: &[T]) -> Vec<T> {
    let sense = |rate: &T| {
        let rests = rate.abs().less_equal(T::zero());
        T::select(rests, T::zero(), T::one().copysign(*rate))
    };
    rates.iter().map(sense).collect()
}

fn wheel_rates<T: Scalar>(platform: &Platform<T>, x: &[T], v: &[T]) -> Vec<T> {
    let n = platform.layout().dof();
    (0..platform.layout().wheels)
        .map(|i| {
            let frame = platform.wheel_frame(i, x);
            appell_model::solve::dot(n, &platform.spin_row(i, &frame), v)
        })
        .collect()
}

/// Rate of the fastest mode of a robot, 1/s, at rest and with its wheels turned.
fn fastest<S: Dynamics<f64>>(system: &S, platform: &Platform<f64>, angles: &[f64]) -> f64 {
    let layout = platform.layout();
    let mut states = vec![crate::build::rest_state(platform, [0.0; 3], angles)];
    // A wheel that stands straight may hide what it resists once it is turned.
    if !layout.constant {
        for turn in [0.5, 1.2] {
            let turned: Vec<f64> = angles.iter().map(|angle| angle + turn).collect();
            states.push(crate::build::rest_state(platform, [0.0; 3], &turned));
        }
    }
    let u = vec![0.0; layout.input()];
    // Wheels taken as turning: friction that sticks is no stiffness.
    let turning = vec![1.0; layout.wheels];
    let radii = states
        .iter()
        .map(|x| spectral_radius(system, x, &u, &turning));
    radii.fold(0.0, f64::max)
}

/// The method for a system whose fastest mode has a rate, 1/s.
fn method<T: Scalar, S: Dynamics<T>>(
    system: &S,
    radius: f64,
    numerics: Numerics,
) -> Result<Method<T>, PlantError> {
    let Numerics {
        integrator,
        step,
        tolerance,
        ..
    } = numerics;
    let sizes = system.sizes();
    let rk4 = || Method::RungeKutta4(RungeKutta4::new(sizes.state, sizes.input));
    let exponential = || {
        let made = Exponential::new(system, step);
        made.map(|method| Method::Exponential(Box::new(method)))
    };
    let adaptive = || {
        // A step that all lanes shared would depend on their neighbors: they are not for it.
        if const { T::LANES > 1 || T::IS_NARROW } {
            return rk4();
        }
        let mut adaptive = Adaptive::new(system, tolerance, 0.1 * tolerance);
        adaptive.step_max = step.max(0.01);
        Method::Adaptive(Box::new(adaptive))
    };
    let stiff = radius * step;
    match integrator {
        // At h|λ| = 0.3 the classical method is off by 2e-5 of the fast part in each step; beyond, the
        // exponential one, which is exact there, is the better. Where the geometry changes there is
        // none, and RK4 serves as far as it is stable with some reserve.
        Integrator::Auto if stiff <= 0.3 => Ok(rk4()),
        Integrator::Auto => match exponential() {
            Some(exponential) => Ok(exponential),
            None if stiff <= 2.0 => Ok(rk4()),
            None => Ok(adaptive()),
        },
        Integrator::Exponential => exponential().ok_or_else(|| PlantError {
            field: "time.integrator",
            problem: "must be another: the geometry of the wheels changes, so the equations have no constant linear part".into(),
            hint: "use \"auto\" or \"adaptive\"".into(),
        }),
        Integrator::Rk4 if stiff > RungeKutta4::<f64>::STABLE => Err(PlantError {
            field: "time.integrator",
            problem: format!(
                "must be another: Runge–Kutta 4 is unstable where step times fastest rate exceeds {}, got {step} s x {radius:.4e} 1/s = {stiff:.2}",
                RungeKutta4::<f64>::STABLE
            ),
            hint: format!(
                "use \"auto\", or a time.step of at most {:.1e}",
                RungeKutta4::<f64>::STABLE / radius
            ),
        }),
        Integrator::Rk4 => Ok(rk4()),
        Integrator::Adaptive => Ok(adaptive()),
    }
}

impl<T: Scalar> System<T> {
    fn platform(&self) -> &Platform<T> {
        match self {
            System::Kinematic(system) => system.platform(),
            System::Rolling(system) => system.platform(),
            System::Alone(system) => system.platform(),
        }
    }

    /// Length of the output.
    fn outputs(&self) -> usize {
        match self {
            System::Alone(system) => system.outputs(),
            _ => self.platform().layout().output(),
        }
    }

    /// Whether there are forces, and with them energy.
    fn has_forces(&self) -> bool {
        match self {
            System::Kinematic(_) => false,
            System::Rolling(_) => true,
            System::Alone(system) => system.level() != Level::Kinematic,
        }
    }

    /// Index of height, roll and pitch in the state, on uneven ground.
    fn attitude(&self) -> Option<usize> {
        match self {
            System::Alone(system) => system.attitude(),
            _ => None,
        }
    }

    /// Whether contacts carry a plane, over whose edges the robot could tip.
    fn tips(&self) -> bool {
        match self {
            System::Kinematic(_) => false,
            System::Rolling(system) => system.support().is_some(),
            System::Alone(system) => system.tips(),
        }
    }
}

impl<T: Scalar> Method<T> {
    /// Advances by steps of a length, s, under a held input, or says what is in the way.
    #[inline(always)]
    fn steps<S: Dynamics<T>>(
        &mut self,
        system: &S,
        u: &[T],
        (step, count): (f64, u64),
        x: &mut [T],
        mode: &mut [T],
    ) -> Result<(), String> {
        let held = Held(u);
        match self {
            Method::RungeKutta4(m) => m.steps(system, &held, 0.0, step, count, x, mode),
            Method::Exponential(m) => m.steps(system, &held, 0.0, step, count, x, mode),
            Method::Adaptive(_) if const { T::LANES > 1 || T::IS_NARROW } => {
                unreachable!("not for lanes")
            }
            Method::Adaptive(m) => return advance(m, system, &held, (step, count), x, mode),
            Method::Own => unreachable!("of levels that go alone"),
        }
        Ok(())
    }

    /// Its name.
    fn name(&self) -> String {
        match self {
            Method::RungeKutta4(_) => "Runge–Kutta 4".into(),
            Method::Exponential(_) => "exponential midpoint".into(),
            Method::Adaptive(adaptive) => {
                format!("Tsitouras 5(4), tolerance {:e}", adaptive.relative)
            }
            Method::Own => unreachable!("of levels that go alone"),
        }
    }

    /// The length that an adaptive method would take next, s; zero for others.
    fn next_step(&self) -> f64 {
        match self {
            Method::Adaptive(adaptive) => adaptive.next_step(),
            _ => 0.0,
        }
    }

    fn set_next_step(&mut self, step: f64) {
        if let Method::Adaptive(adaptive) = self {
            adaptive.set_next_step(step);
        }
    }
}

impl<T: Scalar> Block<T> for Plant<T> {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    fn outputs(&self) -> &[Port] {
        self.outputs.ports()
    }

    fn step(&mut self, now: &Now<'_, T>, input: &[T], _output: &mut [T]) -> Result<(), BlockError> {
        self.take_input(input);
        let (x, mode, u) = (&mut self.x, &mut self.mode, &self.u);
        // Always in steps of the physics, however far the way is: the bits do not depend on it.
        let step = self.step;
        let count = (now.dt / step).round() as u64;
        let went = match &mut self.system {
            System::Alone(s) => s.steps(u, step, count, x, mode),
            System::Kinematic(s) => self.method.steps(s.as_ref(), u, (step, count), x, mode),
            System::Rolling(s) => self.method.steps(s.as_ref(), u, (step, count), x, mode),
        };
        if let Err(problem) = went
            && finite_lanes(x).all()
        {
            return Err(BlockError {
                block: self.name.clone(),
                problem,
                lanes: u32::MAX,
                then: Recovery::End,
            });
        }
        let finite = finite_lanes(x);
        if finite.all() {
            return Ok(());
        }
        Err(BlockError {
            block: self.name.clone(),
            problem: "the state is no longer finite".into(),
            lanes: (0..T::LANES).fold(0, |bits, lane| {
                bits | (u32::from(!finite.lane(lane)) << lane)
            }),
            then: Recovery::End,
        })
    }

    fn take_over(&mut self, input: &[T], before: &[T]) -> Result<(), BlockError> {
        self.take_input(input);
        let names = |field: &str| format!("{}.{field}", self.name);
        let last = |field: &str| {
            let path = names(field);
            let k = self
                .outputs
                .ports()
                .iter()
                .position(|port| port.path == path);
            k.map_or(T::zero(), |k| before[k])
        };
        let platform = self.system.platform();
        let layout = platform.layout();
        let wheels = platform.wheels();
        let of_wheel = |i: usize, field: &str| last(&format!("wheel.{}.{field}", wheels[i].name));
        let angles = layout
            .swivels
            .iter()
            .map(|&i| of_wheel(i, "steering_angle"));
        let angles: Vec<T> = angles.collect();
        let pose = ["pose.x", "pose.y", "pose.yaw"].map(last);
        let mut x = crate::build::rest_state(platform, pose, &angles);
        for i in 0..layout.wheels {
            x[layout.spin(i)] = of_wheel(i, "spin_angle");
        }
        let velocity = vec2(last("twist.forward"), last("twist.left"));
        if self.system.has_forces() {
            for (k, &i) in layout.motors.iter().enumerate() {
                x[layout.current() + k] = of_wheel(i, "current");
            }
        }
        let rates = layout.steered.iter().map(|&i| of_wheel(i, "steering_rate"));
        let rates: Vec<T> = rates.collect();
        let yaw_rate = last("twist.yaw_rate");
        match &self.system {
            System::Kinematic(_) => {}
            System::Rolling(_) => {
                let v = platform.velocity_from_twist(velocity, yaw_rate, &rates);
                let at = layout.velocity();
                x[at..at + layout.dof()].copy_from_slice(&v[..layout.dof()]);
                self.mode = senses(&wheel_rates(platform, &x, &v));
            }
            System::Alone(system) => {
                let spin: Vec<T> = (0..layout.wheels)
                    .map(|i| of_wheel(i, "spin_rate"))
                    .collect();
                let motion = Motion {
                    velocity,
                    yaw_rate,
                    steering: &rates,
                    spin: Some(&spin),
                };
                (x, self.mode) = system.state(&x, &motion);
            }
        }
        self.x = x;
        // Its books begin anew.
        self.energy_start = self.energy();
        Ok(())
    }

    fn observe(&mut self, input: &[T], detail: Detail, output: &mut [T]) {
        self.take_input(input);
        self.look(detail == Detail::Motion);
        self.outputs.show(detail, &self.x, &self.y, output);
        if let (Detail::Everything, Some(at)) = (detail, self.outputs.residual()) {
            let &[supplied, windings, gears, friction] =
                &self.x[self.layout().ledger()..][..LEDGER]
            else {
                unreachable!("the ledger has four entries");
            };
            // What the ledger does not explain: zero but for the integrator.
            let stored = self.y[3] + self.y[4] + self.y[5] - self.energy_start;
            output[at] = stored - (supplied - windings - gears - friction);
        }
    }

    fn leave_out(&mut self) {
        if let System::Rolling(system) = &mut self.system {
            system.leave_out();
        }
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        save_numbers(&self.x, bytes);
        save_numbers(&self.u, bytes);
        save_numbers(&self.mode, bytes);
        let step = match &self.system {
            System::Alone(system) => system.next_step(),
            _ => self.method.next_step(),
        };
        save_numbers(&[T::from(step), self.energy_start], bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Option<usize> {
        let mut used = restore_numbers(&mut self.x, bytes)?;
        used += restore_numbers(&mut self.u, &bytes[used..])?;
        used += restore_numbers(&mut self.mode, &bytes[used..])?;
        let mut rest = [T::zero(); 2];
        used += restore_numbers(&mut rest, &bytes[used..])?;
        match &mut self.system {
            System::Alone(system) => system.set_next_step(rest[0].lane(0)),
            _ => self.method.set_next_step(rest[0].lane(0)),
        }
        self.energy_start = rest[1];
        Some(used)
    }

    fn any(&self) -> &dyn Any {
        self
    }

    fn fits(&self, one: &dyn Any) -> bool {
        let Some(one) = one.downcast_ref::<Plant<f64>>() else {
            return false;
        };
        let system = match (&self.system, &one.system) {
            (System::Kinematic(a), System::Kinematic(b)) => a.fits(b),
            (System::Rolling(a), System::Rolling(b)) => a.fits(b),
            _ => false,
        };
        // An adaptive step is as long as one trial alone lets it be.
        let method = match (&self.method, &one.method) {
            (Method::RungeKutta4(_), Method::RungeKutta4(_)) => true,
            (Method::Exponential(a), Method::Exponential(b)) => a.fits(b),
            _ => false,
        };
        let ports = self.inputs == one.inputs && self.outputs.ports() == one.outputs.ports();
        system && method && ports && self.step == one.step
    }

    fn take(&mut self, lane: usize, one: &dyn Any) {
        let Some(one) = one.downcast_ref::<Plant<f64>>() else {
            return;
        };
        match (&mut self.system, &one.system) {
            (System::Rolling(a), System::Rolling(b)) => a.put(lane, b),
            (System::Kinematic(a), System::Kinematic(b)) => a.put(lane, b),
            _ => {}
        }
        match (&mut self.method, &one.method) {
            (Method::Exponential(a), Method::Exponential(b)) => a.put(lane, b),
            (Method::Adaptive(a), Method::Adaptive(b)) => a.set_next_step(b.next_step()),
            _ => {}
        }
        self.x.put(lane, &one.x);
        self.mode.put(lane, &one.mode);
        self.energy_start.put(lane, &one.energy_start);
    }
}

impl<T: Scalar> Plant<T> {
    /// Ports to the model's input vector: the commands in order, then the brake.
    fn take_input(&mut self, input: &[T]) {
        for (k, &at) in self.commands.iter().enumerate() {
            self.u[at] = input[k];
        }
        let brake = input[self.commands.len()];
        self.u[self.brake] = brake.max(T::zero()).min(T::one());
    }
}

fn advance<T: Scalar, S: Dynamics<T>>(
    method: &mut Adaptive<T>,
    system: &S,
    input: &Held<'_, T>,
    (step, count): (f64, u64),
    x: &mut [T],
    mode: &mut [T],
) -> Result<(), String> {
    for _ in 0..count {
        // Time within the step: small numbers keep event times exact however long the run.
        let result = method.advance(system, input, 0.0, step, x, mode, None);
        result.map_err(|stalled| match stalled {
            Stalled::StepTooSmall(_) => "the adaptive step vanished".to_owned(),
            Stalled::NotFinite(_) => "the state is no longer finite".to_owned(),
        })?;
    }
    Ok(())
}

/// Speed over ground of a twist, m/s.
#[inline(always)]
pub fn speed<T: Scalar>(forward: T, left: T) -> T {
    hypot(forward, left)
}
