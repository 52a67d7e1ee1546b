//! Judges in a world: what they see of it, and what comes of that.

use appell_model::lanewise::Lanewise;
use appell_model::math::hypot;
use appell_model::scalar::{Mask, Scalar};
use appell_model::wide::{Job, widest};

use super::slot::Due;
use super::{RobotBlocks, World, with};
use crate::judge::{Glance, Judge, Rings, Sample, Verdict, Watch};
use crate::layout::Layout;
use crate::record::Event;

/// What judges a robot.
pub(crate) struct Referee<T: Scalar> {
    pub robot: String,
    /// One for each lane; what they watch is in `watch`.
    judges: Vec<Judge<T::Single>>,
    watch: Watch<T>,
    /// Lanes in which the judge has not decided yet.
    open: T::Mask,
    rings: Rings<T>,
    pub has_task: bool,
    /// Its looks.
    pub(super) due: Due,
    /// Columns of x, y, forward and left speed.
    pub(super) watched: [usize; 4],
    /// Column of the clearance.
    clearance: usize,
}

impl<T: Scalar> Referee<T> {
    /// One that gives every lane the same judge.
    pub(super) fn new(
        robot: String,
        judge: Judge<T::Single>,
        layout: &Layout,
        has_task: bool,
        period: u64,
        watched: [usize; 4],
        clearance: usize,
    ) -> Self {
        Referee {
            robot,
            judges: vec![judge; T::LANES],
            watch: Watch::new(),
            open: T::Mask::splat(true),
            rings: Rings::new(layout),
            has_task,
            due: Due {
                period,
                next: period,
            },
            watched,
            clearance,
        }
    }

    /// Whether a robot of plain numbers has the like of it.
    pub(super) fn fits(&self, robot: &RobotBlocks<f64>) -> bool {
        self.robot == robot.name
            && self.has_task == robot.has_task
            && self.due.period == robot.judge_period
            && self.rings.beacons.len() == robot.layout.beacons.len()
    }

    /// What the judge of a lane has decided.
    pub(super) fn verdict(&self, lane: usize) -> Verdict {
        self.judges[lane].verdict()
    }

    /// The judge of a lane, with all that it has seen.
    pub(crate) fn judge(&self, lane: usize) -> Judge<T::Single> {
        let mut judge = self.judges[lane].clone();
        judge.watch = self.watch.single(lane);
        judge
    }

    /// Gives a lane a judge, and what stands round its robot.
    pub(super) fn appoint(&mut self, lane: usize, judge: Judge<T::Single>, layout: &Layout)
    where
        T: Scalar<Single = f64>,
    {
        self.rings.put(lane, &Rings::new(layout));
        self.open = with(self.open, lane, judge.verdict() == Verdict::Running);
        self.judges[lane] = judge;
    }
}

impl Referee<f64> {
    /// Goes on with a judge and what it has seen.
    pub(super) fn resume(&mut self, judge: Judge) {
        self.open = judge.verdict() == Verdict::Running;
        self.watch = judge.watch;
        self.judges[0] = judge;
    }
}

/// A look at a robot, for its judges in some lanes.
pub(super) struct Look<'a, T: Scalar> {
    pub(super) rings: &'a Rings<T>,
    pub(super) watch: &'a mut Watch<T>,
    /// Time, s.
    pub(super) t: T,
    /// x, y, forward and left speed.
    pub(super) motion: [T; 4],
    pub(super) of: T::Mask,
}

/// What is seen.
pub(super) struct Seen<T: Scalar> {
    /// Distance between the robot's disc and the nearest beacon now, m, negative inside.
    pub(super) nearest: T,
    pub(super) glance: Glance<T>,
    /// Speed over ground, m/s.
    pub(super) speed: T,
    /// The lanes whose judges must decide on it.
    pub(super) woken: T::Mask,
}

impl<T: Scalar> Job for Look<'_, T> {
    type Output = Seen<T>;

    #[inline(always)]
    fn run(self) -> Seen<T> {
        let [x, y, forward, left] = self.motion;
        let mut nearest = T::from(T::LARGEST);
        for k in 0..self.rings.beacons.len() {
            let [east, north, radius] = self.rings.beacons[k];
            let away = hypot(x - east, y - north);
            nearest = nearest.min(away - (radius + self.rings.radius));
        }
        let glance = self.rings.glance(self.watch.last.position, [x, y]);
        let speed = crate::plant::speed(forward, left);
        let woken = self.watch.pass(self.t, speed, &glance, self.of);
        Seen {
            nearest,
            glance,
            speed,
            woken,
        }
    }
}

impl<T: Scalar> World<T> {
    /// Lets the judges of some lanes look, whose trials begin.
    pub(super) fn begin_judging(&mut self, of: T::Mask) {
        for k in 0..self.referees.len() {
            let referee = &mut self.referees[k];
            let [x, y, ..] = referee.watched;
            referee.watch.begin([self.row[x], self.row[y]], of);
            self.look(k, of);
        }
    }

    /// Lets the judges of a robot look, in some lanes.
    pub(super) fn look(&mut self, robot: usize, of: T::Mask) {
        let t = self.times();
        let referee = &mut self.referees[robot];
        let [x, y, forward, left] = referee.watched;
        let before = referee.watch.last;
        let seen = widest::<T, _>(Look {
            rings: &referee.rings,
            watch: &mut referee.watch,
            t,
            motion: [self.row[x], self.row[y], self.row[forward], self.row[left]],
            of: of.and(referee.open),
        });
        self.row[referee.clearance] = seen.nearest;
        if seen.woken.any() {
            self.let_decide(robot, before, &seen);
        }
    }

    /// Lets those judges of a robot decide that something was seen for.
    fn let_decide(&mut self, robot: usize, before: Sample<T>, seen: &Seen<T>) {
        for lane in 0..T::LANES {
            if !seen.woken.lane(lane) {
                continue;
            }
            let t = <T::Single as From<f64>>::from(self.time(lane));
            let referee = &mut self.referees[robot];
            let judge = &mut referee.judges[lane];
            judge.watch = referee.watch.single(lane);
            let (speed, glance) = (seen.speed.single(lane), seen.glance.single(lane));
            judge.decide(before.single(lane), t, speed, &glance);
            let (calm, all) = (judge.watch.calm, referee.watch.calm);
            let kept = |i: usize| if i == lane { calm } else { all.single(i) };
            referee.watch.calm = T::from_singles(kept);
            if judge.verdict() != Verdict::Running {
                referee.open = with(referee.open, lane, false);
                self.has_decided = true;
            }
            if judge.has_events() {
                for event in judge.take_events() {
                    let event = Event {
                        t: event.t,
                        robot: referee.robot.clone(),
                        kind: "task".into(),
                        text: event.text,
                        position: Some(event.position),
                    };
                    self.events.push((lane, event));
                }
            }
        }
    }
}
