//! Slipping wheels under a chassis on springs: heave, roll and pitch within the implicit step, and their
//! equations at an instant. `[eq:suspension]`
//!
//! Springs leave nothing to transfer: what each wheel bears follows from height, roll and pitch and how
//! they change, and what accelerates the robot turns the chassis first.

use super::Slip;
use super::uneven::Lie;
use crate::planar::{Vec2, vec2};
use crate::platform::{MAX_WHEELS, YAW};
use crate::scalar::Scalar;
use crate::solve::{Row, Square};
use crate::stance::{Footing, Rows, Survey, axes, dot3, moves, solve3};
use crate::suspension::Sprung;

/// How often the wheels that bear are asked for within an iteration.
const TRIES: usize = 8;

/// A step of heave, roll and pitch, from its start to where it leads.
pub(super) struct Ride<'a, T: Scalar> {
    footing: &'a Footing<T>,
    sprung: &'a Sprung<T>,
    survey: Survey<T>,
    per_step: T,
    /// Velocities at its start, in the plane and out of it.
    from: ([T; 3], [T; 3]),
    /// Of each contact: what it would bear at the predicted end if nothing moved, N; what that falls by with
    /// the velocity at which it leaves the ground, N·s/m; whether it touches.
    still: [T; MAX_WHEELS],
    gain: [T; MAX_WHEELS],
    touches: [bool; MAX_WHEELS],
    rows: [Rows<T>; MAX_WHEELS],
}

/// What bears a robot on springs at a state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spring<T> {
    survey: Survey<T>,
    /// What each contact bears, N.
    borne: [T; MAX_WHEELS],
    /// Force along the normal of the chassis, and moments about its forward and left axes.
    raised: [T; 3],
}

/// What a step of heave, roll and pitch does to the motion in the plane.
pub(super) struct Answer<T> {
    /// Force in the plane beyond that of the contacts: inertia that it shares, quadratic terms.
    pub(super) force: [T; 3],
    /// By how much the forces in the plane fall with the velocities there.
    pub(super) change: [[T; 3]; 3],
}

impl<'a, T: Scalar> Ride<'a, T> {
    /// A step of length `step` from the state `from`, whose end lies as predicted by the velocities in x;
    /// `None` without springs.
    pub(super) fn new(
        system: &'a Slip<T>,
        step: T,
        from: &[T],
        x: &[T],
        lie: Option<&Lie<T>>,
    ) -> Option<Self> {
        let (footing, sprung) = system.springs()?;
        let survey = lie?.spring?.survey;
        let wheels = system.layout().wheels;
        let (plane, heave) = system.motion(x);
        let mut still = [T::zero(); MAX_WHEELS];
        let mut gain = [T::zero(); MAX_WHEELS];
        let mut touches = [false; MAX_WHEELS];
        let mut rows = [Rows::none(); MAX_WHEELS];
        for i in 0..wheels {
            let contact = &survey.contacts[i];
            let whole = contact.whole();
            rows[i] = whole;
            touches[i] = contact.load.lane(0) > 0.0;
            let stiff = footing.stiffness(i) * step;
            gain[i] = stiff + sprung.damping(i);
            // It lies as the velocities before led it there.
            still[i] = stiff.mul_add(whole.leaves(&plane, &heave), contact.load);
        }
        Some(Ride {
            footing,
            sprung,
            survey,
            per_step: T::one() / step,
            from: system.motion(from),
            still,
            gain,
            touches,
            rows,
        })
    }

    /// Heave, roll and pitch at the end of the step for the velocities in x, which gets theirs, and how the
    /// robot lies then.
    pub(super) fn answer(&self, system: &Slip<T>, x: &mut [T]) -> (Lie<T>, Answer<T>) {
        let wheels = system.layout().wheels;
        let (plane, before) = system.motion(x);
        let (quadratic, bent) = system.quadratic(self.sprung, x);
        let moved = [0, 1, 2].map(|k| self.per_step * (plane[k] - self.from.0[k]));
        let swayed = self.sprung.sway(moved);
        let own = self
            .sprung
            .own()
            .map(|row| row.map(|part| part * self.per_step));
        let mut free = [T::zero(); 3];
        for k in 0..3 {
            free[k] = self.survey.weight[k] + bent[k] - swayed[k] + dot3(own[k], self.from.1);
        }
        let mut loads = self.loads(&plane, &before);
        let mut bears = self.bearing(&loads);
        let (mut matrix, mut heave) = self.solve(own, free, &plane, &bears[..wheels]);
        for _ in 0..TRIES {
            loads = self.loads(&plane, &heave);
            let bearing = self.bearing(&loads);
            if bearing == bears {
                break;
            }
            bears = bearing;
            (matrix, heave) = self.solve(own, free, &plane, &bears[..wheels]);
        }
        let lifted = bears.map(|bears| !bears);
        for i in (0..wheels).filter(|&i| lifted[i]) {
            loads[i] = T::zero();
        }
        let at = system.attitude() + 3;
        x[at..at + 3].copy_from_slice(&heave);
        let lie = Lie::on_springs(self.footing, system, x, self.survey, &loads, &lifted);
        let rates = [0, 1, 2].map(|k| self.per_step * (heave[k] - self.from.1[k]));
        let dragged = self.sprung.drag(rates);
        let answer = Answer {
            force: [0, 1, 2].map(|k| quadratic[k] - dragged[k]),
            change: self.change(&matrix, &bears[..wheels]),
        };
        (lie, answer)
    }

    /// What each contact would bear at these velocities, N.
    fn loads(&self, plane: &[T; 3], heave: &[T; 3]) -> [T; MAX_WHEELS] {
        let mut loads = [T::zero(); MAX_WHEELS];
        for (i, rows) in self.rows.iter().enumerate() {
            loads[i] = (-self.gain[i]).mul_add(rows.leaves(plane, heave), self.still[i]);
        }
        loads
    }

    /// Which of them bear something.
    fn bearing(&self, loads: &[T; MAX_WHEELS]) -> [bool; MAX_WHEELS] {
        let mut bears = self.touches;
        for (bears, load) in bears.iter_mut().zip(loads) {
            *bears &= load.lane(0) > 0.0;
        }
        bears
    }

    /// Heave, roll and pitch where these contacts bear, and the matrix they follow from.
    fn solve(
        &self,
        own: [[T; 3]; 3],
        free: [T; 3],
        plane: &[T; 3],
        bears: &[bool],
    ) -> ([[T; 3]; 3], [T; 3]) {
        let (mut matrix, mut right) = (own, free);
        for i in (0..bears.len()).filter(|&i| bears[i]) {
            let Rows { out, within, .. } = &self.rows[i];
            let load = (-self.gain[i]).mul_add(dot3(*within, *plane), self.still[i]);
            for a in 0..3 {
                right[a] = load.mul_add(out[a], right[a]);
                for b in 0..3 {
                    matrix[a][b] = (self.gain[i] * out[a]).mul_add(out[b], matrix[a][b]);
                }
            }
        }
        (matrix, solve3(&matrix, right))
    }

    /// W − (B/h + D)ᵀ (A/h + G)⁻¹ (B/h + D): what the forces in the plane fall by where heave, roll and
    /// pitch follow.
    fn change(&self, matrix: &[[T; 3]; 3], bears: &[bool]) -> [[T; 3]; 3] {
        let mut change = [[T::zero(); 3]; 3];
        // Rows over the motion in the plane.
        let mut both = self
            .sprung
            .shared()
            .map(|row| row.map(|part| part * self.per_step));
        for i in (0..bears.len()).filter(|&i| bears[i]) {
            let Rows { out, within, .. } = &self.rows[i];
            for a in 0..3 {
                let stiff = self.gain[i] * within[a];
                for b in 0..3 {
                    change[a][b] = stiff.mul_add(within[b], change[a][b]);
                    both[a][b] = stiff.mul_add(out[b], both[a][b]);
                }
            }
        }
        let follows = both.map(|row| solve3(matrix, row));
        for a in 0..3 {
            for b in 0..3 {
                change[a][b] -= dot3(both[a], follows[b]);
            }
        }
        change
    }
}

impl<T: Scalar> Slip<T> {
    /// What carries the chassis, where it is on springs.
    #[inline(always)]
    pub(super) fn springs(&self) -> Option<(&Footing<T>, &Sprung<T>)> {
        let footing = self.footing.as_ref()?;
        Some((footing, footing.sprung()?))
    }

    /// Velocities in the plane of the chassis, and of heave, roll and pitch on springs.
    #[inline(always)]
    pub(super) fn motion(&self, x: &[T]) -> ([T; 3], [T; 3]) {
        let (at, up) = (self.layout().velocity(), self.attitude() + 3);
        ([x[at], x[at + 1], x[at + 2]], [x[up], x[up + 1], x[up + 2]])
    }

    /// Quadratic terms beyond those in the plane, and of heave, roll and pitch.
    fn quadratic(&self, sprung: &Sprung<T>, x: &[T]) -> ([T; 3], [T; 3]) {
        let layout = self.layout();
        let at = layout.velocity();
        let turned = crate::solve::dot(layout.dof(), &self.inertia[2], &x[at..at + layout.dof()]);
        let (plane, heave) = self.motion(x);
        sprung.quadratic(vec2(plane[0], plane[1]), plane[2], heave, turned)
    }

    /// How it lies on its springs at a state.
    pub(super) fn ride(&self, x: &[T]) -> Option<Lie<T>> {
        let (footing, sprung) = self.springs()?;
        let at = self.attitude();
        let survey = footing.survey(&self.platform, x, [x[at], x[at + 1], x[at + 2]]);
        let (plane, heave) = self.motion(x);
        let mut loads = [T::zero(); MAX_WHEELS];
        let mut lifted = [true; MAX_WHEELS];
        for i in 0..self.layout().wheels {
            let contact = &survey.contacts[i];
            let leaves = contact.whole().leaves(&plane, &heave);
            let load = (-sprung.damping(i)).mul_add(leaves, contact.load);
            lifted[i] = contact.load.lane(0) <= 0.0 || load.lane(0) <= 0.0;
            if !lifted[i] {
                loads[i] = load;
            }
        }
        Some(Lie::on_springs(footing, self, x, survey, &loads, &lifted))
    }

    /// The state to which its velocities lead it in a step from the state `from`: pose and attitude.
    pub(super) fn led(&self, step: T, from: &[T], x: &mut [T]) {
        let at = self.attitude();
        let frame = axes(x, [x[at], x[at + 1], x[at + 2]]);
        let (plane, heave) = self.motion(x);
        let (way, lies) = moves(&frame, vec2(plane[0], plane[1]), plane[2], heave);
        for k in 0..3 {
            let pose = [0, 1, YAW][k];
            x[pose] = step.mul_add(way[k], from[pose]);
            x[at + k] = step.mul_add(lies[k], from[at + k]);
        }
        self.platform.renew_angles(x);
    }

    /// Rates of all velocities under a force in the plane and one of the contacts' loads on springs: those of
    /// the plane's coordinates, and of heave, roll and pitch.
    pub(super) fn accelerate(
        &self,
        x: &[T],
        force: &Row<T>,
        lie: Option<&Lie<T>>,
    ) -> Option<(Row<T>, [T; 3])> {
        let (_, sprung) = self.springs()?;
        let spring = lie?.spring?;
        let (quadratic, bent) = self.quadratic(sprung, x);
        let raised = [0, 1, 2].map(|k| spring.raised[k] + bent[k]);
        let free = sprung.drag(sprung.release(raised));
        let mut right = *force;
        let mut matrix: Square<T> = self.inertia;
        let freed = sprung.freed();
        for a in 0..3 {
            right[a] += quadratic[a] - free[a];
            for b in 0..3 {
                matrix[a][b] -= freed[a][b];
            }
        }
        let rates = super::implicit::eliminate(self.layout().dof(), matrix, right);
        let swayed = sprung.sway([rates[0], rates[1], rates[2]]);
        let heave = sprung.release([0, 1, 2].map(|k| raised[k] - swayed[k]));
        Some((rates, heave))
    }

    /// What springs and dampers lose at a state that lies so, W: what contacts bear beyond the springs, as
    /// the wheels move to the chassis.
    pub(super) fn damped(&self, x: &[T], lie: Option<&Lie<T>>) -> T {
        let mut lost = T::zero();
        let Some(spring) = lie.and_then(|lie| lie.spring.as_ref()) else {
            return lost;
        };
        let (plane, heave) = self.motion(x);
        for i in 0..self.layout().wheels {
            let contact = &spring.survey.contacts[i];
            let leaves = contact.whole().leaves(&plane, &heave);
            let stored = contact.load.max(T::zero());
            lost = (stored - spring.borne[i]).mul_add(leaves, lost);
        }
        lost
    }

    /// The way of each wheel towards the body, m.
    pub(super) fn travelled(&self, lie: &Lie<T>, ways: &mut [T]) {
        if let (Some((footing, _)), Some(spring)) = (self.springs(), &lie.spring) {
            for i in 0..self.layout().wheels {
                ways[i] = footing.travel(i, spring.survey.contacts[i].load);
            }
        }
    }

    /// Energy of motion beyond that in the plane, J.
    pub(super) fn swung(&self, x: &[T]) -> T {
        let Some((_, sprung)) = self.springs() else {
            return T::zero();
        };
        let (plane, heave) = self.motion(x);
        sprung.kinetic(vec2(plane[0], plane[1]), plane[2], heave)
    }
}

impl<T: Scalar> Lie<T> {
    /// How it lies where contacts bear these loads on springs.
    fn on_springs(
        footing: &Footing<T>,
        system: &Slip<T>,
        x: &[T],
        survey: Survey<T>,
        loads: &[T; MAX_WHEELS],
        lifted: &[bool; MAX_WHEELS],
    ) -> Self {
        let look = footing.bear(&system.platform, x, &survey, loads, lifted);
        Lie {
            loads: (look.stance.loads, [Vec2::zero(); MAX_WHEELS]),
            stance: look.stance,
            beyond: [T::zero(); MAX_WHEELS],
            spring: Some(Spring {
                survey,
                borne: *loads,
                raised: look.force,
            }),
        }
    }

    /// Rates of x, y and yaw, and of height, roll and pitch on springs, at a state.
    pub(super) fn moves(&self, system: &Slip<T>, x: &[T]) -> Option<([T; 3], [T; 3])> {
        self.spring.as_ref()?;
        let (plane, heave) = system.motion(x);
        let velocity = vec2(plane[0], plane[1]);
        Some(self.stance.moves(velocity, plane[2], heave))
    }
}
