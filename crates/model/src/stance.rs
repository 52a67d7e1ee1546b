//! How a robot stands on uneven ground: height, roll and pitch of its chassis, loads of its wheels, and
//! what gravity makes of them. `[eq:stance]`
//!
//! Each wheel rests on the ground as a [`crate::terrain::Touch`] says, and gives under its load Nᵢ ≥ 0.
//! The chassis follows the ground as if it had no inertia of heave, roll and pitch: along its normal,
//! and about its forward and left axes, loads and weight balance. What is left of them acts in its
//! plane. Roll, pitch and yaw turn about x, y, z in that order; base frame for forces.

use crate::planar::{Vec2, vec2};
use crate::platform::{MAX_WHEELS, Platform, YAW};
use crate::scalar::{Mask, Scalar};
use crate::solve::MAX_DOF;
use crate::support::Support;
use crate::suspension::{Sprung, Suspension};
use crate::terrain::{Disc, Share, Terrain, Touch};
use crate::wheel::Steering;

/// Height of the base's origin over the map, m, roll and pitch, rad.
pub type Attitude<T> = [T; 3];

/// A robot on a terrain.
#[derive(Clone, Debug)]
pub struct Footing<T> {
    terrain: Terrain,
    gravity: T,
    /// Gravity along the map, where that is inclined, m/s².
    aside: Vec2<T>,
    mass: T,
    /// Center of mass, base frame, m.
    center: [T; 3],
    /// Of each wheel: load on level ground, N, and stiffness, N/m.
    level: [T; MAX_WHEELS],
    stiffness: [T; MAX_WHEELS],
    sprung: Option<Sprung<T>>,
    support: Support<T>,
}

/// How it stands at a pose.
#[derive(Clone, Copy, Debug)]
pub struct Stance<T: Scalar> {
    /// Height, roll and pitch.
    pub attitude: Attitude<T>,
    /// Load of each wheel at rest, along the normal of the ground beneath it, N.
    pub loads: [T; MAX_WHEELS],
    /// Wheels in the air.
    pub lifted: [T::Mask; MAX_WHEELS],
    /// Slope of the ground under each wheel against the plane of the chassis, base axes.
    pub gradients: [Vec2<T>; MAX_WHEELS],
    /// What gravity and ground do in the plane of the chassis: force, N, and moment about P, N·m.
    pub push: [T; 3],
    /// Moment of the ground on each steered wheel about the axis of its steering, N·m.
    pub twists: [T; MAX_WHEELS],
    /// Gravity normal to the chassis, m/s².
    pub gravity_normal: T,
    /// Forward and left axes of the chassis and its normal, in the world.
    pub axes: [[T; 3]; 3],
    /// Rates of x, y and yaw over forward and left velocity and turning rate of the chassis.
    pub rates: [[T; 3]; 3],
    /// Energy of height and of wheels that give, J.
    pub potential: T,
    /// Whether it can stand so.
    pub standing: Standing,
}

/// Whether a robot can stand where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It can.
    Stands,
    /// No attitude is at rest: it falls.
    Falls,
    /// A wheel stands before a wall.
    Blocked(usize),
}

/// Why a platform cannot stand on uneven ground.
#[derive(Clone, Debug, PartialEq)]
pub enum FootingError {
    /// The wheels carry no plane: fewer than three, or on one line, or the center of mass beside them.
    Unsupported,
    /// The axle of a trailer; its name.
    Trailer(String),
}

/// Share of its radius by which the mean wheel gives under its load on level ground.
pub const SAG: f64 = 0.01;
/// Tilt beyond which a robot has fallen, rad.
const FALLEN: f64 = 1.3;
/// Most iterations of Newton's method.
const TRIES: usize = 60;
/// Change of height, m, and angles, rad, that is none.
const CLOSE: f64 = 1e-15;
/// The same that is none where rounding lets it come no closer, for stiff wheels make much of little.
const ENOUGH: f64 = 1e-12;
/// The same at which it stands all the same: a tenth of what tires give.
const CLOSE_ENOUGH: f64 = 1e-4;
/// How often the place of a wheel on its spring is looked for: each time closer by the square.
const FOUND: usize = 2;
/// Share of its stiffness that a wheel in the air keeps in the search.
const TRACE: f64 = 1e-6;

impl<T: Scalar> Footing<T> {
    /// Joins a platform and a terrain under a gravity, m/s².
    ///
    /// # Errors
    /// Wheels that carry no plane.
    pub fn new(platform: &Platform<T>, terrain: Terrain, gravity: T) -> Result<Self, FootingError> {
        let wheels = platform.wheels();
        if let Some(wheel) = wheels.iter().find(|wheel| wheel.is_towed()) {
            return Err(FootingError::Trailer(wheel.name.clone()));
        }
        let (mass, first, up) = platform.balance();
        let per = T::one() / mass;
        let (flat, up) = (first * per, up * per);
        let contacts: Vec<_> = wheels.iter().map(|w| (w.mount, w.stiffness)).collect();
        let support = Support::new(&contacts).ok_or(FootingError::Unsupported)?;
        let level = support.loads(mass * gravity, flat);
        let least = (0..wheels.len()).map(|i| level[i].lane(0));
        if gravity.lane(0) > 0.0 && least.fold(f64::MAX, f64::min) <= 0.0 {
            return Err(FootingError::Unsupported);
        }
        // All give alike: what each carries is its share of one stiffness.
        let mut stiffness = [T::zero(); MAX_WHEELS];
        let share = T::from(1.0 / wheels.len() as f64);
        let mut sag = T::zero();
        for wheel in wheels {
            sag = (T::from(SAG) * share).mul_add(wheel.radius, sag);
        }
        // Where nothing weighs anything, as if it did.
        let weighs = T::zero().less(gravity);
        let weight = mass * T::select(weighs, gravity, T::one());
        for (i, wheel) in wheels.iter().enumerate() {
            stiffness[i] = wheel.stiffness * weight * share / sag;
        }
        Ok(Footing {
            terrain,
            gravity,
            aside: Vec2::zero(),
            mass,
            center: [flat.x, flat.y, up],
            level,
            stiffness,
            sprung: None,
            support,
        })
    }

    /// The same on a map that is inclined: gravity along it, m/s², world axes.
    pub fn inclined(mut self, gravity: Vec2<T>) -> Self {
        self.aside = gravity;
        self
    }

    /// The same on springs, which give in place of the tires.
    pub fn on_springs(mut self, platform: &Platform<T>, suspension: &Suspension<T>) -> Self {
        let count = platform.wheels().len();
        self.stiffness[..count].copy_from_slice(&suspension.stiffness);
        self.sprung = Some(Sprung::new(platform, suspension));
        self
    }

    /// Stiffness of wheel i or its spring, N/m.
    pub(crate) fn stiffness(&self, i: usize) -> T {
        self.stiffness[i]
    }

    /// How far tire or spring of wheel i gives under a load, N, from that on level ground, m.
    pub(crate) fn travel(&self, i: usize, load: T) -> T {
        (load.max(T::zero()) - self.level[i]) / self.stiffness[i]
    }

    /// What its springs carry, where it has any.
    pub fn sprung(&self) -> Option<&Sprung<T>> {
        self.sprung.as_ref()
    }

    /// The ground.
    pub fn terrain(&self) -> &Terrain {
        &self.terrain
    }

    /// Loads along the normal of the chassis that a force F of the ground in its plane, N, adds to those
    /// at rest: dNᵢ = bᵢ · F, without lifted wheels.
    pub fn transfer(&self, stance: &Stance<T>) -> [Vec2<T>; MAX_WHEELS] {
        let weight = self.mass * stance.gravity_normal;
        let center = vec2(self.center[0], self.center[1]);
        let (_, shift) = self
            .support
            .affine(weight, center, self.center[2], &stance.lifted);
        shift
    }

    /// Tip-over margin, m, under a force of the ground in the plane of the chassis, N; zero without
    /// weight. At rest the zero-moment point is the center of the loads; what accelerates the robot acts at
    /// the height of its center of mass. `[eq:tip-over]`
    pub fn margin(&self, platform: &Platform<T>, stance: &Stance<T>, force: Vec2<T>) -> T {
        let (mut sum, mut moment) = (T::zero(), Vec2::zero());
        for (wheel, &load) in platform.wheels().iter().zip(&stance.loads) {
            sum += load;
            moment = moment + wheel.mount * load;
        }
        let bears = T::zero().less(sum);
        let sum = T::select(bears, sum, T::one());
        let beyond = force + vec2(stance.push[0], stance.push[1]);
        let at = moment * (T::one() / sum);
        let point = Support::zero_moment_point(sum, at, self.center[2], beyond);
        T::select(bears, self.support.margin(point), T::zero())
    }

    /// An attitude to begin the search for that of a state with: the plane that is nearest to the
    /// ground under the wheels.
    pub fn guess(&self, platform: &Platform<T>, x: &[T]) -> Attitude<T> {
        let mut normal = [[T::zero(); 3]; 3];
        let mut right = [T::zero(); 3];
        for wheel in platform.wheels() {
            let arm = wheel.mount.rotated(x[YAW + 1], x[YAW + 2]);
            let place = vec2((x[0] + arm.x).lane(0), (x[1] + arm.y).lane(0));
            let height = T::from(self.terrain.height(place));
            let row = [T::one(), wheel.mount.x, wheel.mount.y];
            for a in 0..3 {
                right[a] = row[a].mul_add(height, right[a]);
                for b in 0..3 {
                    normal[a][b] = row[a].mul_add(row[b], normal[a][b]);
                }
            }
        }
        let [height, ahead, aside] = solve3(&normal, right);
        let run = ahead.mul_add(ahead, T::one()).sqrt();
        [height, aside.atan2(run), (-ahead).atan2(T::one())]
    }

    /// How a platform stands at a state, found from an attitude near by.
    pub fn stand(&self, platform: &Platform<T>, x: &[T], near: Attitude<T>) -> Stance<T> {
        let mut attitude = near;
        let mut found = false;
        let mut before = f64::MAX;
        let mut look = self.look(platform, x, attitude);
        for _ in 0..TRIES {
            if look.stance.standing != Standing::Stands {
                return look.stance;
            }
            let change = solve3(&look.change, look.force);
            if change.iter().any(|step| !step.lane(0).is_finite()) {
                break;
            }
            let largest = change.map(|step| step.abs().lane(0));
            let largest = largest.into_iter().fold(0.0, f64::max);
            found = largest <= CLOSE || (largest <= ENOUGH && 2.0 * largest > before);
            if found {
                break;
            }
            for k in 0..3 {
                let most = T::from(if k == 0 { 1.0 } else { 0.2 });
                attitude[k] += change[k].max(-most).min(most);
            }
            before = largest;
            look = self.look(platform, x, attitude);
        }
        // Where the ground under a wheel changes from place to place it may find no end, and be close.
        found |= before <= CLOSE_ENOUGH;
        let tilt = attitude[1].abs().max(attitude[2].abs());
        let upright = tilt.less_equal(T::from(FALLEN)).all();
        look.stance.attitude = attitude;
        if !(found && upright) && look.stance.standing == Standing::Stands {
            look.stance.standing = Standing::Falls;
        }
        look.stance
    }

    /// What is there at an attitude: weight, ground, and where each wheel touches it.
    pub(crate) fn survey(
        &self,
        platform: &Platform<T>,
        x: &[T],
        attitude: Attitude<T>,
    ) -> Survey<T> {
        let axes = axes(x, attitude);
        let [forward, left, normal] = axes;
        let place = |r: [T; 3]| {
            [0, 1, 2].map(|k| r[0].mul_add(forward[k], r[1].mul_add(left[k], r[2] * normal[k])))
        };
        let weight = self.mass * self.gravity;
        let center = place(self.center);
        let along = self.aside * self.mass;
        let down = [along.x, along.y, -weight];
        let height = weight * (attitude[0] + center[2]);
        let mut survey = Survey {
            attitude,
            axes,
            weight: [
                dot3(normal, down),
                dot3(forward, cross(center, down)),
                dot3(left, cross(center, down)),
            ],
            push: [
                dot3(forward, down),
                dot3(left, down),
                dot3(normal, cross(center, down)),
            ],
            gravity_normal: self
                .gravity
                .mul_add(normal[2], -self.aside.dot(vec2(normal[0], normal[1]))),
            potential: height - along.dot(vec2(x[0] + center[0], x[1] + center[1])),
            contacts: [Contact::none(); MAX_WHEELS],
            standing: Standing::Stands,
        };
        let aside = [-x[YAW + 2], x[YAW + 1], T::zero()];
        for (i, wheel) in platform.wheels().iter().enumerate() {
            let frame = platform.wheel_frame(i, x);
            let at_rest = place([wheel.mount.x, wheel.mount.y, wheel.radius]);
            let ahead = [0, 1, 2].map(|k| {
                frame
                    .forward
                    .x
                    .mul_add(forward[k], frame.forward.y * left[k])
            });
            let mut hub = at_rest;
            let disc = |hub: &[T; 3]| Disc {
                center: [
                    (x[0] + hub[0]).lane(0),
                    (x[1] + hub[1]).lane(0),
                    (attitude[0] + hub[2]).lane(0),
                ],
                forward: ahead.map(|a| a.lane(0)),
                up: normal.map(|a| a.lane(0)),
                radius: wheel.radius.lane(0),
            };
            let within = SAG * wheel.radius.lane(0);
            let (mut first, mut second) = self.terrain.touches(&disc(&hub), within);
            // Springs give more than tires: the wheel touches from where they have brought it.
            let mut travel = T::zero();
            if self.sprung.is_some() {
                for _ in 0..FOUND {
                    let slope = vec2(T::from(first.gradient.x), T::from(first.gradient.y));
                    let out = normal[2] - slope.dot(vec2(normal[0], normal[1]));
                    travel += T::from(first.depth) / out;
                    if (self.stiffness[i] * travel).lane(0) <= -self.level[i].lane(0) {
                        break;
                    }
                    hub = [0, 1, 2].map(|k| travel.mul_add(normal[k], at_rest[k]));
                    (first, second) = self.terrain.touches(&disc(&hub), within);
                }
            }
            if first.is_wall && survey.standing == Standing::Stands {
                survey.standing = Standing::Blocked(i);
            }
            let meet = |touch: &Touch| {
                // The point of the rim that touches, from P.
                let s = T::from(touch.ahead);
                let below = ((wheel.radius - s) * (wheel.radius + s)).sqrt();
                let arm = [0, 1, 2].map(|k| s.mul_add(ahead[k], hub[k]) - below * normal[k]);
                let gradient = vec2(T::from(touch.gradient.x), T::from(touch.gradient.y));
                // N (−∇h, 1): what the ground does there.
                let pushed = [-gradient.x, -gradient.y, T::one()];
                // How deep is known for plain numbers; to first order for those with derivatives.
                let moved = [
                    x[0] + arm[0] - T::from((x[0] + arm[0]).lane(0)),
                    x[1] + arm[1] - T::from((x[1] + arm[1]).lane(0)),
                    attitude[0] + arm[2] - T::from((attitude[0] + arm[2]).lane(0)),
                ];
                let moment = cross(arm, pushed);
                let [within_x, within_y, out] = axes.map(|axis| dot3(axis, pushed));
                let rows = Rows {
                    out: [out, dot3(forward, moment), dot3(left, moment)],
                    within: [within_x, within_y, dot3(normal, moment)],
                    turned: [T::one(), dot3(forward, moment), dot3(aside, moment)],
                    twist: s * dot3(cross(normal, ahead), pushed),
                };
                let depth = T::from(touch.depth) - dot3(moved, pushed);
                match self.sprung {
                    None => (rows, depth),
                    // Force and way along the normal of the chassis.
                    Some(_) => (rows.scaled(T::one() / out), depth / out + travel),
                }
            };
            let (rows, depth) = meet(&first);
            let load = self.stiffness[i].mul_add(depth, self.level[i]);
            survey.contacts[i] = match second {
                None => Contact {
                    load,
                    parts: [rows, Rows::none()],
                    share: T::zero(),
                    rate: T::zero(),
                },
                Some((touch, Share { share, rate })) => {
                    let (other, own) = meet(&touch);
                    // Plain numbers know the share; those with derivatives to first order.
                    let over = own - depth;
                    let share = T::from(rate).mul_add(over - T::from(over.lane(0)), T::from(share));
                    Contact {
                        load,
                        parts: [rows, other],
                        share,
                        rate: T::from(rate),
                    }
                }
            };
        }
        survey
    }

    /// What acts at an attitude, and how that changes with it, with those wheels in the air that a rest
    /// near by would have there.
    fn look(&self, platform: &Platform<T>, x: &[T], attitude: Attitude<T>) -> Look<T> {
        let survey = self.survey(platform, x, attitude);
        let count = platform.wheels().len();
        let weight = survey.weight.map(|part| part.lane(0));
        match self.lift(&survey.contacts[..count], weight) {
            Some(lifted) => {
                let mut loads = [T::zero(); MAX_WHEELS];
                for i in (0..count).filter(|&i| !lifted[i]) {
                    loads[i] = survey.contacts[i].load;
                }
                self.bear(platform, x, &survey, &loads, &lifted)
            }
            None => {
                let none = [T::zero(); MAX_WHEELS];
                let mut look = self.bear(platform, x, &survey, &none, &[true; MAX_WHEELS]);
                if look.stance.standing == Standing::Stands {
                    look.stance.standing = Standing::Falls;
                }
                look
            }
        }
    }

    /// What acts where contacts bear these loads, N, of those that touch.
    pub(crate) fn bear(
        &self,
        platform: &Platform<T>,
        x: &[T],
        survey: &Survey<T>,
        loads: &[T; MAX_WHEELS],
        lifted: &[bool; MAX_WHEELS],
    ) -> Look<T> {
        let [forward, left, normal] = survey.axes;
        let mut force = survey.weight;
        // Over changes of height, roll and pitch; over heave, roll and pitch of the chassis; over its
        // motion in its plane.
        let mut change = [[T::zero(); 3]; 3];
        let mut heave = [[T::zero(); 3]; 3];
        let mut drawn = [[T::zero(); 3]; 3];
        let mut stance = Stance {
            attitude: survey.attitude,
            loads: [T::zero(); MAX_WHEELS],
            lifted: [T::Mask::splat(true); MAX_WHEELS],
            gradients: [Vec2::zero(); MAX_WHEELS],
            twists: [T::zero(); MAX_WHEELS],
            push: survey.push,
            gravity_normal: survey.gravity_normal,
            axes: survey.axes,
            rates: [[T::zero(); 3]; 3],
            potential: survey.potential,
            standing: survey.standing,
        };
        for (i, wheel) in platform.wheels().iter().enumerate() {
            let contact = &survey.contacts[i];
            let load = loads[i];
            // A wheel in the air keeps a trace of stiffness: two wheels alone would have none to roll by.
            let kept = if lifted[i] { TRACE } else { 1.0 };
            let stiffness = self.stiffness[i] * T::from(kept);
            stance.lifted[i] = T::Mask::splat(lifted[i]);
            let whole = contact.whole();
            let [within, out] = [whole.within, whole.out];
            for a in 0..3 {
                force[a] = load.mul_add(out[a], force[a]);
                stance.push[a] = load.mul_add(within[a], stance.push[a]);
            }
            let [first, second] = &contact.parts;
            // As the load grows with the depth of the first, and as it passes to the second.
            let passed = load * contact.rate;
            for a in 0..3 {
                let stiff = stiffness * out[a];
                let turns = passed * (second.out[a] - first.out[a]);
                let add = |matrix: &mut [[T; 3]; 3], one: &[T; 3], two: &[T; 3]| {
                    for b in 0..3 {
                        let grown = stiff.mul_add(one[b], matrix[a][b]);
                        matrix[a][b] = turns.mul_add(two[b] - one[b], grown);
                    }
                };
                add(&mut change, &first.turned, &second.turned);
                add(&mut heave, &first.out, &second.out);
                add(&mut drawn, &first.within, &second.within);
            }
            stance.gradients[i] = vec2(within[0], within[1]) * (-T::one() / out[0]);
            let across = within[0].mul_add(within[0], within[1] * within[1]);
            stance.loads[i] = load * out[0].mul_add(out[0], across).sqrt();
            let spring = match &self.sprung {
                Some(_) => contact.load.max(T::zero()),
                None => load,
            };
            stance.potential += T::from(0.5) * spring * spring / self.stiffness[i];
            // About the axis of its steering, which it touches the ground ahead of.
            let twist = load * whole.twist;
            match wheel.steering {
                // A caster that the ground turns takes the base with it.
                Steering::Free { .. } => {
                    let frame = platform.wheel_frame(i, x);
                    for (k, unit) in [vec2(T::one(), T::zero()), vec2(T::zero(), T::one())]
                        .into_iter()
                        .enumerate()
                    {
                        let rate = platform.caster_rate(i, &frame, unit, T::zero());
                        stance.push[k] = twist.mul_add(rate, stance.push[k]);
                    }
                    let rate = platform.caster_rate(i, &frame, Vec2::zero(), T::one());
                    stance.push[2] = twist.mul_add(rate, stance.push[2]);
                }
                _ => stance.twists[i] = twist,
            }
        }
        let (sin_roll, cos_roll) = survey.attitude[1].sin_cos();
        let (_, cos_pitch) = survey.attitude[2].sin_cos();
        // As it moves in its plane it heaves, rolls and pitches so that its wheels stay on the ground.
        let unit = |k: usize| [0, 1, 2].map(|a| T::from(f64::from(u8::from(a == k))));
        for k in 0..3 {
            let [rise, _, pitching] = solve3(&heave, drawn.map(|row| -row[k]));
            let [ahead, aside, turning] = unit(k);
            for a in 0..2 {
                stance.rates[a][k] =
                    ahead.mul_add(forward[a], aside.mul_add(left[a], rise * normal[a]));
            }
            stance.rates[2][k] = pitching.mul_add(sin_roll, turning * cos_roll) / cos_pitch;
        }
        Look {
            stance,
            force,
            change,
        }
    }

    /// Which wheels lift where their contacts, as they are at an attitude, and a weight with its moments
    /// about the forward and left axes come to rest; `None` where they do not.
    ///
    /// Contacts push and do not pull, so the energy over small heave, roll and pitch of the chassis is
    /// convex, of second degree in pieces: each step of Newton's method goes as far along its direction as the
    /// energy falls, and the steps end in the piece that holds the least.
    fn lift(&self, contacts: &[Contact<T>], weight: [f64; 3]) -> Option<[bool; MAX_WHEELS]> {
        let count = contacts.len();
        let mut rows = [[0.0; 3]; MAX_WHEELS];
        let (mut loads, mut stiffness) = ([0.0; MAX_WHEELS], [0.0; MAX_WHEELS]);
        for (i, contact) in contacts.iter().enumerate() {
            rows[i] = contact.whole().out.map(|entry| entry.lane(0));
            loads[i] = contact.load.lane(0);
            stiffness[i] = self.stiffness[i].lane(0);
        }
        let mut lifted = [false; MAX_WHEELS];
        for i in 0..count {
            lifted[i] = loads[i] < 0.0;
        }
        for _ in 0..TRIES {
            let mut force = weight;
            let mut stiff = [[0.0; 3]; 3];
            for i in 0..count {
                let kept = if lifted[i] { TRACE } else { 1.0 };
                for a in 0..3 {
                    force[a] += if lifted[i] {
                        0.0
                    } else {
                        loads[i] * rows[i][a]
                    };
                    for b in 0..3 {
                        stiff[a][b] += kept * stiffness[i] * rows[i][a] * rows[i][b];
                    }
                }
            }
            let change = solve3(&stiff, force);
            // What each load falls by over the whole step; the slope of the energy along it.
            let mut falls = [0.0; MAX_WHEELS];
            let (mut slope, mut growth) = (-dot3(weight, change), 0.0);
            let mut bends = [(f64::INFINITY, 0); MAX_WHEELS];
            for i in 0..count {
                falls[i] = stiffness[i] * dot3(rows[i], change);
                let along = falls[i] / stiffness[i];
                if !lifted[i] {
                    slope -= loads[i] * along;
                    growth += falls[i] * along;
                }
                // Where it leaves the ground, or comes to it.
                if (lifted[i] && falls[i] < 0.0) || (!lifted[i] && falls[i] > 0.0) {
                    bends[i] = ((loads[i] / falls[i]).max(0.0), i);
                }
            }
            let bends = &mut bends[..count];
            bends.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (mut whole, mut way) = (lifted, 0.0);
            let mut is_last = true;
            for &(bend, i) in bends.iter() {
                let end = way - slope / growth;
                if slope >= 0.0 || (growth > 0.0 && end <= bend) {
                    break;
                }
                if !bend.is_finite() {
                    // It falls for ever.
                    return None;
                }
                slope += growth * (bend - way);
                way = bend;
                let own = falls[i] * falls[i] / stiffness[i];
                growth += if whole[i] { own } else { -own };
                whole[i] = !whole[i];
                is_last = false;
            }
            if is_last {
                let bearing = lifted[..count].iter().filter(|&&lifted| !lifted).count();
                // On two wheels it balances, for no time.
                return (bearing >= 3).then_some(lifted);
            }
            if slope < 0.0 {
                way -= slope / growth;
            }
            for i in 0..count {
                loads[i] -= way * falls[i];
                lifted[i] = whole[i];
            }
        }
        None
    }
}

/// What a unit of force at a contact does, and how the contact moves with the chassis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows<T> {
    /// Along the normal of the chassis, and about its forward and left axes.
    pub(crate) out: [T; 3],
    /// In the plane of the chassis: forward, to the left, and about its normal.
    pub(crate) within: [T; 3],
    /// How much deeper it is for less height, roll and pitch.
    turned: [T; 3],
    /// Its moment about the axis of the wheel's steering.
    twist: T,
}

/// What is there at an attitude.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Survey<T> {
    attitude: Attitude<T>,
    axes: [[T; 3]; 3],
    /// Force of the weight along the normal of the chassis, N, and its moments about the forward and left
    /// axes, N·m.
    pub(crate) weight: [T; 3],
    /// Its force in the plane of the chassis and moment about the normal.
    push: [T; 3],
    gravity_normal: T,
    /// Energy of height, J.
    potential: T,
    pub(crate) contacts: [Contact<T>; MAX_WHEELS],
    standing: Standing,
}

/// A wheel on the ground, at an attitude.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact<T> {
    /// What tire or spring bears, N; below zero it would pull.
    pub(crate) load: T,
    /// Where it touches: on one place, or shared by two.
    parts: [Rows<T>; 2],
    /// Share of the second, and how fast that grows with its depth over that of the first, 1/m.
    share: T,
    rate: T,
}

impl<T: Scalar> Rows<T> {
    /// How fast the contact leaves the ground at velocities in the plane of the chassis and out of it, m/s.
    #[inline(always)]
    pub(crate) fn leaves(&self, plane: &[T; 3], heave: &[T; 3]) -> T {
        dot3(self.out, *heave) + dot3(self.within, *plane)
    }

    fn scaled(self, by: T) -> Self {
        Rows {
            out: self.out.map(|part| part * by),
            within: self.within.map(|part| part * by),
            turned: self.turned.map(|part| part * by),
            twist: self.twist * by,
        }
    }

    pub(crate) fn none() -> Self {
        let none = [T::zero(); 3];
        Rows {
            out: none,
            within: none,
            turned: none,
            twist: T::zero(),
        }
    }
}

impl<T: Scalar> Contact<T> {
    fn none() -> Self {
        Contact {
            load: T::zero(),
            parts: [Rows::none(); 2],
            share: T::zero(),
            rate: T::zero(),
        }
    }

    /// What a unit of its load does.
    pub(crate) fn whole(&self) -> Rows<T> {
        let [first, second] = &self.parts;
        let mix = |a: T, b: T| self.share.mul_add(b - a, a);
        let mixed = |a: &[T; 3], b: &[T; 3]| [0, 1, 2].map(|k| mix(a[k], b[k]));
        match self.share.lane(0) > 0.0 {
            false => *first,
            true => Rows {
                out: mixed(&first.out, &second.out),
                within: mixed(&first.within, &second.within),
                turned: mixed(&first.turned, &second.turned),
                twist: mix(first.twist, second.twist),
            },
        }
    }
}

impl<T: Scalar> Stance<T> {
    /// Whether it stands before a wall, or lies over; a robot on springs may be in the air.
    pub(crate) fn upright(&self) -> Standing {
        let tilt = self.attitude[1].abs().max(self.attitude[2].abs());
        match self.standing {
            Standing::Blocked(i) => Standing::Blocked(i),
            _ if tilt.less_equal(T::from(FALLEN)).all() => Standing::Stands,
            _ => Standing::Falls,
        }
    }

    /// Rates of x, y and yaw at a twist in the plane of the chassis.
    #[inline(always)]
    pub fn pose_rates(&self, velocity: Vec2<T>, yaw_rate: T) -> [T; 3] {
        self.rates
            .map(|row| row[0].mul_add(velocity.x, row[1].mul_add(velocity.y, row[2] * yaw_rate)))
    }

    /// Rates of x, y and yaw, and of height, roll and pitch, at a twist in the plane of the chassis and
    /// velocities of heave, roll and pitch, chassis axes.
    #[inline(always)]
    pub fn moves(&self, velocity: Vec2<T>, yaw_rate: T, heave: [T; 3]) -> ([T; 3], [T; 3]) {
        moves(&self.axes, velocity, yaw_rate, heave)
    }

    /// Moment of the ground on each steering coordinate, N·m.
    pub fn turns(&self, platform: &Platform<T>, x: &[T]) -> [T; MAX_DOF] {
        let layout = platform.layout();
        let mut turns = [T::zero(); MAX_DOF];
        if layout.steered.is_empty() {
            return turns;
        }
        for (i, wheel) in platform.wheels().iter().enumerate() {
            if wheel.swivels() && !matches!(wheel.steering, Steering::Free { .. }) {
                let row = platform.swivel_row(i, &platform.wheel_frame(i, x));
                for k in 0..layout.steered.len() {
                    turns[k] = row[layout.eta + k].mul_add(self.twists[i], turns[k]);
                }
            }
        }
        turns
    }
}

/// What is known at an attitude.
pub(crate) struct Look<T: Scalar> {
    pub(crate) stance: Stance<T>,
    /// Force along the normal of the chassis, and moments about its forward and left axes.
    pub(crate) force: [T; 3],
    /// How much these fall with height, roll and pitch.
    change: [[T; 3]; 3],
}

/// Forward and left axes of a chassis and its normal, in the world.
pub(crate) fn axes<T: Scalar>(x: &[T], attitude: Attitude<T>) -> [[T; 3]; 3] {
    let (cos_yaw, sin_yaw) = (x[YAW + 1], x[YAW + 2]);
    let (sin_roll, cos_roll) = attitude[1].sin_cos();
    let (sin_pitch, cos_pitch) = attitude[2].sin_cos();
    let forward = [cos_yaw * cos_pitch, sin_yaw * cos_pitch, -sin_pitch];
    let left = [
        cos_yaw * sin_pitch * sin_roll - sin_yaw * cos_roll,
        sin_yaw * sin_pitch * sin_roll + cos_yaw * cos_roll,
        cos_pitch * sin_roll,
    ];
    [forward, left, cross(forward, left)]
}

/// Rates of x, y and yaw, and of height, roll and pitch, of a chassis with these axes.
#[inline(always)]
pub(crate) fn moves<T: Scalar>(
    [forward, left, normal]: &[[T; 3]; 3],
    velocity: Vec2<T>,
    yaw_rate: T,
    [rise, roll, pitch]: [T; 3],
) -> ([T; 3], [T; 3]) {
    let way = |k: usize| {
        velocity
            .x
            .mul_add(forward[k], velocity.y.mul_add(left[k], rise * normal[k]))
    };
    // What roll and pitch make of the axes' heights: cos² of the pitch is what both others share.
    let level = left[2].mul_add(left[2], normal[2] * normal[2]);
    let yaw = pitch.mul_add(left[2], yaw_rate * normal[2]) / level;
    let attitude = [
        way(2),
        (-forward[2]).mul_add(yaw, roll),
        pitch.mul_add(normal[2], -(yaw_rate * left[2])) / level.sqrt(),
    ];
    ([way(0), way(1), yaw], attitude)
}

pub(crate) fn cross<T: Scalar>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub(crate) fn dot3<T: Scalar>(a: [T; 3], b: [T; 3]) -> T {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Solves a system of three.
pub(crate) fn solve3<T: Scalar>(a: &[[T; 3]; 3], b: [T; 3]) -> [T; 3] {
    let columns = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])];
    let scale = T::one() / dot3(a[0], columns[0]);
    [0, 1, 2].map(|k| {
        let sum = columns[0][k].mul_add(b[0], columns[1][k].mul_add(b[1], columns[2][k] * b[2]));
        sum * scale
    })
}
