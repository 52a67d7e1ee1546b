//! An implicit method for slipping wheels: stiff contacts set no limit to its step.

use super::sprung::Ride;
use super::{Axes, Lie, Slip, is_zero};
use crate::planar::{Vec2, vec2};
use crate::platform::{LEDGER, MAX_WHEELS, YAW};
use crate::scalar::{Mask, Scalar};
use crate::solve::{MAX_DOF, Row, Square, zero_row};

/// The method of Alexander of order 2: two implicit steps of Euler, the second from where the first
/// points to. L-stable and stiffly accurate: what is at rest stays there. `[eq:slip-step]`
///
/// R. Alexander, *Diagonally implicit Runge–Kutta methods for stiff O.D.E.'s*, SIAM Journal on Numerical
/// Analysis 14(6), 1977.
#[derive(Clone, Debug)]
pub struct Implicit<T> {
    begin: Vec<T>,
    from: Vec<T>,
}

/// γ = 1 − 1/√2: the share of the step of each stage.
const SHARE: f64 = 0.292_893_218_813_452_4;
/// Most iterations of Newton's method; a dozen is much.
const TRIES: usize = 60;
/// After this many, steps are halved: two contacts that keep letting go of one another settle so.
const EAGER: usize = 12;
/// After this many, loads are kept as they are: a robot that tips has none that agree with its forces,
/// and wheels would lift in turns.
const FIRM: usize = 24;
/// Change of a velocity at which the iteration ends, relative to 1 m/s or the speed at hand: some
/// hundred times rounding.
const CLOSE: f64 = 2e-14;

/// What is left of a change when the iterations end without coming that close, and still is an end:
/// forces that are rounding times a stiffness move it for ever.
const ENOUGH: f64 = 1e-9;
/// How often a step is divided.
const FINER: usize = 2;

/// A contact as one iteration sees it.
#[derive(Clone, Copy)]
struct Touch<T> {
    /// Rows of slip velocity over the twist of the base.
    rows: [[T; 3]; 2],
    lever: T,
    slip: Vec2<T>,
    /// Force over the load at rest, and its slope over slip.
    grip: Vec2<T>,
    slope: [[T; 2]; 2],
    pull: Vec2<T>,
    end: Vec2<T>,
}

impl<T: Scalar> Touch<T> {
    /// A change of spin, rad/s, that goes with one of the motion of the base: where it would slip more the
    /// other way it goes no further than where it rolls. In sliding forces hardly change with slip, and a light
    /// wheel would be thrown to and fro for ever.
    #[inline(always)]
    fn caught(&self, change: Row<T>, turned: T) -> T {
        let mut rolls = self.slip.x;
        for axis in 0..3 {
            rolls = self.rows[0][axis].mul_add(change[axis], rolls);
        }
        let next = (-self.lever).mul_add(turned, rolls);
        let other = (next * self.slip.x).less(T::zero());
        let thrown = other.and(self.slip.x.abs().less(next.abs()));
        T::select(thrown, rolls / self.lever, turned)
    }
}

impl<T: Scalar> Implicit<T> {
    /// Order of the method.
    pub const ORDER: u32 = 2;

    /// Makes room for a system.
    pub fn new(system: &Slip<T>) -> Self {
        Implicit {
            begin: vec![T::zero(); system.state()],
            from: vec![T::zero(); system.state()],
        }
    }

    /// Advances x and mode by `count` steps of dt, s, under a held input. Where Newton's method does not
    /// find the end of a step it is made in eight, and where that fails in sixty-four; false if that
    /// fails, too.
    #[must_use = "a step may not have been found"]
    pub fn steps(
        &mut self,
        system: &Slip<T>,
        u: &[T],
        dt: f64,
        count: u64,
        x: &mut [T],
        mode: &mut [T],
    ) -> bool {
        (0..count).all(|_| self.step(system, u, dt, x, mode, 0))
    }

    fn step(
        &mut self,
        system: &Slip<T>,
        u: &[T],
        dt: f64,
        x: &mut [T],
        mode: &mut [T],
        depth: usize,
    ) -> bool {
        let mut room = Room {
            begin: &mut self.begin,
            from: &mut self.from,
        };
        if step(system, u, dt, x, mode, &mut room) {
            return true;
        }
        x.copy_from_slice(&self.begin);
        depth < FINER && (0..8).all(|_| self.step(system, u, 0.125 * dt, x, mode, depth + 1))
    }
}

struct Room<'a, T> {
    begin: &'a mut [T],
    from: &'a mut [T],
}

fused! {
    /// One step; false if it was not found.
    fn step<T: Scalar>(
        system: &Slip<T>,
        u: &[T],
        dt: f64,
        x: &mut [T],
        mode: &mut [T],
        room: &mut Room<'_, T>,
    ) -> bool {
        let stage = T::from(SHARE * dt);
        room.begin.copy_from_slice(x);
        room.from.copy_from_slice(x);
        let lie = system.lie_ahead(stage, room.from, x, None);
        if !system.euler(u, stage, room.from, x, mode, lie.as_ref()) {
            return false;
        }
        let ahead = T::from((1.0 - SHARE) / SHARE);
        for k in 0..x.len() {
            room.from[k] = ahead.mul_add(x[k] - room.begin[k], room.begin[k]);
        }
        let before = lie.as_ref().map(|lie| &lie.stance);
        let lie = system.lie_ahead(stage, room.from, x, before);
        let found = system.euler(u, stage, room.from, x, mode, lie.as_ref());
        system.platform.renew_angles(x);
        found
    }
}

impl<T: Scalar> Slip<T> {
    /// The implicit step of Euler of length `step` from the state `from`; x holds a guess and then the
    /// end, if the result is true. Newton's method on the velocities of base and wheels together: currents and deflections
    /// follow from these, loads from the last iteration.
    #[inline(always)]
    fn euler(
        &self,
        u: &[T],
        step: T,
        from: &[T],
        x: &mut [T],
        mode: &mut [T],
        lie: Option<&Lie<T>>,
    ) -> bool {
        let layout = self.layout();
        let (n, at, wheels) = (layout.dof(), layout.velocity(), layout.wheels);
        let per_step = T::one() / step;
        let brake = u[layout.brake_input()];
        let mut found = false;
        let mut loads = [T::zero(); MAX_WHEELS];
        let ride = Ride::new(self, step, from, x, lie);
        let mut ridden = None;
        for attempt in 0..TRIES {
            let answer = ride.as_ref().map(|ride| {
                let (lie, answer) = ride.answer(self, x);
                ridden = Some(lie);
                answer
            });
            let lie = ridden.as_ref().or(lie);
            self.turn(step, from, x, lie);
            let mut touches = [None; MAX_WHEELS];
            let mut pulls = [Vec2::zero(); MAX_WHEELS];
            for i in 0..wheels {
                if !self.follows(i) {
                    let touch = self.touch(i, step, from, x, lie);
                    pulls[i] = touch.pull;
                    touches[i] = Some(touch);
                }
            }
            if attempt < FIRM {
                loads = self.carry(x, &pulls, lie);
            }
            let mut v = zero_row();
            v[..n].copy_from_slice(&x[at..at + n]);
            let mut right = self.free_force(x, u, &v, lie);
            let mut matrix: Square<T> = [zero_row(); MAX_DOF];
            for a in 0..n {
                for b in 0..n {
                    matrix[a][b] = self.inertia[a][b] * per_step;
                    right[a] = (-matrix[a][b]).mul_add(v[b] - from[at + b], right[a]);
                }
            }
            if let Some(answer) = answer {
                for a in 0..3 {
                    right[a] += answer.force[a];
                    for b in 0..3 {
                        matrix[a][b] += answer.change[a][b];
                    }
                }
            }
            for k in 0..layout.steered.len() {
                matrix[3 + k][3 + k] += self.platform.wheels()[layout.steered[k]].pivot_viscous;
            }
            // Each wheel's spin follows from the motion of the base: φ̇ += own + rows · dv.
            let mut own = [T::zero(); MAX_WHEELS];
            let mut spins = [[T::zero(); 3]; MAX_WHEELS];
            for i in 0..wheels {
                let Some(touch) = &touches[i] else { continue };
                let load = loads[i];
                let force = touch.grip * load;
                let hard = touch.slope.map(|row| row.map(|entry| entry * load));
                let lever = touch.lever;
                let rate = x[self.rate(i)];
                let start = self.axles[i].current().map_or(T::zero(), |at| from[at]);
                let drive = self.axles[i].at_end(u[i], rate, start, step);
                let inertia = self.spin_inertia[i] * per_step;
                let (lost, rubbing) = self.axles[i].glide(brake, rate);
                let stiff = inertia + drive.damping + rubbing;
                // Falling friction may pull harder than the wheel resists; not to be followed.
                let whole = (-(lever * lever * hard[0][0])).max(T::zero()) + stiff;
                let mut rest =
                    drive.torque - lost - lever * force.x - inertia * (rate - from[self.rate(i)]);
                let bound = self.axles[i].held(brake);
                let pushed = whole.mul_add(rate, rest);
                let sticks = pushed.abs().less_equal(bound).and(T::zero().less(bound));
                rest -= T::select(T::zero().less(bound), bound.copysign(pushed), T::zero());
                mode[i] = T::select(sticks, T::zero(), T::one().copysign(pushed));
                let gain = T::select(sticks, T::zero(), T::one() / whole);
                own[i] = T::select(sticks, -rate, rest * gain);
                for axis in 0..3 {
                    let drawn =
                        hard[0][0].mul_add(touch.rows[0][axis], hard[0][1] * touch.rows[1][axis]);
                    spins[i][axis] = -(gain * lever * drawn);
                }
                // Force of the contact: f + K (rows dv − lever dφ̇).
                for axis in 0..3 {
                    let push =
                        |f: [T; 2]| touch.rows[0][axis].mul_add(f[0], touch.rows[1][axis] * f[1]);
                    let turned = lever * own[i];
                    right[axis] +=
                        push([force.x - hard[0][0] * turned, force.y - hard[1][0] * turned]);
                    for b in 0..3 {
                        let first = touch.rows[0][b] - lever * spins[i][b];
                        let second = touch.rows[1][b];
                        let change = [
                            hard[0][0].mul_add(first, hard[0][1] * second),
                            hard[1][0].mul_add(first, hard[1][1] * second),
                        ];
                        matrix[axis][b] += -push(change);
                    }
                }
            }
            let change = eliminate(n, matrix, right);
            let scale = if attempt < EAGER {
                T::one()
            } else {
                T::from(0.5)
            };
            let (mut most, mut speed) = (T::zero(), T::one());
            for k in 0..n {
                x[at + k] = scale.mul_add(change[k], x[at + k]);
                most = most.max(change[k].abs());
                speed = speed.max(x[at + k].abs());
            }
            for i in 0..wheels {
                let Some(touch) = &touches[i] else { continue };
                let mut turned = own[i];
                for axis in 0..3 {
                    turned = spins[i][axis].mul_add(change[axis], turned);
                }
                turned = touch.caught(change, turned);
                let rate = self.rate(i);
                let stuck = is_zero(mode[i]).and(T::zero().less(self.axles[i].held(brake)));
                let moved = scale.mul_add(turned, x[rate]);
                x[rate] = T::select(stuck, T::zero(), moved);
                let radius = touch.lever.abs();
                most = most.max((radius * turned).abs());
                speed = speed.max((radius * x[rate]).abs());
            }
            found = most.less_equal(speed * T::from(ENOUGH)).all();
            if most.less_equal(speed * T::from(CLOSE)).all() || !most.is_finite().all() {
                break;
            }
        }
        self.finish(u, step, from, x, &loads, ridden.as_ref().or(lie));
        found
    }

    /// Angles that the contacts depend on, at the end of a step, from the velocities in x.
    #[inline(always)]
    fn turn(&self, step: T, from: &[T], x: &mut [T], lie: Option<&Lie<T>>) {
        let layout = self.layout();
        let at = layout.velocity();
        x[YAW] = step.mul_add(self.turning(x, lie), from[YAW]);
        for k in 0..layout.swivels.len() {
            if !self.follows(layout.swivels[k]) {
                let rate = self.swivel_rate(
                    layout.swivels[k],
                    x,
                    Vec2::zero(),
                    T::zero(),
                    &x[at..at + layout.dof()],
                );
                let angle = layout.swivel(k);
                x[angle] = step.mul_add(rate, from[angle]);
            }
        }
        self.platform.renew_angles(x);
    }

    #[inline(always)]
    fn touch(&self, i: usize, step: T, from: &[T], x: &[T], lie: Option<&Lie<T>>) -> Touch<T> {
        let at = self.layout().velocity();
        let frame = self.platform.wheel_frame(i, x);
        let axes = self.axes(i, &frame, lie);
        let Axes {
            along,
            across,
            lever,
            ..
        } = axes;
        let row = |d: Vec2<T>| [d.x, d.y, frame.contact.cross(d)];
        let rows = [row(along), row(across)];
        let carried =
            |row: &[T; 3]| row[0].mul_add(x[at], row[1].mul_add(x[at + 1], row[2] * x[at + 2]));
        let rate = x[self.rate(i)];
        let slip = vec2(carried(&rows[0]) - lever * rate, carried(&rows[1]));
        let z = self.deflection(i);
        let rolling = (lever * rate).abs();
        let tire = self.tire(i, x, frame.contact);
        let answer = tire.respond(slip, vec2(from[z], from[z + 1]), rolling, step);
        let (grip, slope) = match lie {
            None => (answer.force, answer.slope),
            Some(_) => axes.eased_slope(answer.force, &answer.slope),
        };
        Touch {
            rows,
            lever,
            slip,
            grip,
            slope,
            pull: axes.felt(grip),
            end: answer.deflection,
        }
    }

    /// All that follows from the velocities at the end of a step.
    #[inline(always)]
    fn finish(
        &self,
        u: &[T],
        step: T,
        from: &[T],
        x: &mut [T],
        loads: &[T; MAX_WHEELS],
        lie: Option<&Lie<T>>,
    ) {
        let layout = self.layout();
        let at = layout.velocity();
        self.turn(step, from, x, lie);
        let (velocity, yaw_rate) = (vec2(x[at], x[at + 1]), x[at + 2]);
        // A caster has no part in the motion; its angle is found by repetition, each time some
        // hundredfold closer.
        for _ in 0..6 {
            for (k, &i) in layout.swivels.iter().enumerate() {
                if self.follows(i) {
                    let v: Row<T> = zero_row();
                    let rate = self.swivel_rate(i, x, velocity, yaw_rate, &v);
                    let angle = layout.swivel(k);
                    x[angle] = step.mul_add(rate, from[angle]);
                    crate::platform::renew_angle(x, angle);
                }
            }
        }
        let travel = self.way(x, lie);
        x[0] = step.mul_add(travel[0], from[0]);
        x[1] = step.mul_add(travel[1], from[1]);
        if let Some((_, lies)) = lie.and_then(|lie| lie.moves(self, x)) {
            let at = self.attitude();
            for k in 0..3 {
                x[at + k] = step.mul_add(lies[k], from[at + k]);
            }
        }
        let mut touches = [None; MAX_WHEELS];
        for i in 0..layout.wheels {
            let spin = layout.spin(i);
            x[spin] = step.mul_add(self.spin(i, x, velocity, yaw_rate), from[spin]);
            if !self.follows(i) {
                touches[i] = Some(self.touch(i, step, from, x, lie));
            }
        }
        let brake = u[layout.brake_input()];
        let (mut supplied, mut friction) = self.outer_power(u, &x[at..at + layout.dof()]);
        let (mut windings, mut gears) = (T::zero(), T::zero());
        for i in 0..layout.wheels {
            let Some(touch) = &touches[i] else { continue };
            let rate = x[self.rate(i)];
            let z = self.deflection(i);
            (x[z], x[z + 1]) = (touch.end.x, touch.end.y);
            let start = self.axles[i].current().map_or(T::zero(), |at| from[at]);
            let drive = self.axles[i].at_end(u[i], rate, start, step);
            if let Some(at) = self.axles[i].current() {
                x[at] = drive.current;
            }
            let (lost, _) = self.axles[i].glide(brake, rate);
            let rubbed = self.axles[i].held(brake).mul_add(rate.abs(), lost * rate);
            supplied += drive.supplied;
            windings += drive.windings;
            gears += drive.gears;
            friction += rubbed - (touch.grip * loads[i]).dot(touch.slip);
        }
        friction += self.damped(x, lie);
        let ledger = layout.ledger();
        let powers: [T; LEDGER] = [supplied, windings, gears, friction];
        for (k, power) in powers.into_iter().enumerate() {
            x[ledger + k] = step.mul_add(power, from[ledger + k]);
        }
    }
}

/// Solves a system whose diagonal the masses carry, by Gauss without pivoting.
#[inline(always)]
pub(super) fn eliminate<T: Scalar>(n: usize, mut a: Square<T>, mut b: Row<T>) -> Row<T> {
    for k in 0..n {
        let pivot = T::one() / a[k][k];
        for i in k + 1..n {
            let factor = a[i][k] * pivot;
            for j in k + 1..n {
                a[i][j] = (-factor).mul_add(a[k][j], a[i][j]);
            }
            b[i] = (-factor).mul_add(b[k], b[i]);
        }
    }
    for k in (0..n).rev() {
        let mut sum = b[k];
        for j in k + 1..n {
            sum = (-a[k][j]).mul_add(b[j], sum);
        }
        b[k] = sum / a[k][k];
    }
    b
}
