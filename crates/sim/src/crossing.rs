//! A wheel-legged robot crosses a step or a trench: quasi-static, from the side.
//!
//! x forward from the edge of the obstacle, z up from the ground before it, m. Two leg systems of two
//! wheels each are hinged in their middles to the ends of a body; a part of the body tilts fore and aft
//! and shifts the center of mass. Wheels are discs that touch the ground's profile; the legs are held
//! at their angles, and the weight lets each hinge down until the first of its wheels touches. Angles
//! are from the horizontal, front up positive, rad. Nothing accelerates; times follow from the speed
//! and from the rates of the joints. Feng and Guo (2015), Figs 2 to 4; the paper gives the wheels and
//! their pitch, all other lengths and masses are assumptions.

mod posture;

use appell_model::scalar::Scalar;
use appell_model::wheel_legged::obstacle::{Decision, Limits, Obstacle, Strategy, decide};
use serde::Serialize;
use serde_json::{Value, json};

use posture::Posture;

/// What the robot is made of. SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Build {
    /// Wheels and reach.
    pub limits: Limits,
    /// Distance between the hinges, m.
    pub hinges: f64,
    /// Distance between left and right contacts, m.
    pub track: f64,
    /// Mass of the body without the part that tilts, with its center between the hinges, kg.
    pub body_mass: f64,
    /// Mass of each leg system with its wheels, with its center in the hinge, kg.
    pub leg_mass: f64,
    /// Mass of the part that tilts, kg.
    pub tilting_mass: f64,
    /// Distance of that mass from its joint, which is between the hinges, m.
    pub tilting_arm: f64,
    /// Largest tilt against the body's normal, rad.
    pub tilt_max: f64,
    /// Largest angle of a leg system, rad.
    pub leg_max: f64,
    /// Largest pitch of the body, rad.
    pub pitch_max: f64,
    /// Distance from the ends of the support that the center of mass is to keep, m, as far as the
    /// tilting part can shift it.
    pub margin_wanted: f64,
    /// Rate of all joints, rad/s.
    pub joint_rate: f64,
    /// Speed on wheels, m/s.
    pub speed: f64,
}

impl Build {
    /// The paper's wheels; the rest assumed.
    pub const ASSUMED: Build = Build {
        limits: Limits::PUBLISHED,
        hinges: 0.6,
        track: 0.5,
        body_mass: 16.0,
        leg_mass: 6.0,
        tilting_mass: 12.0,
        tilting_arm: 0.25,
        tilt_max: 0.9,
        leg_max: 1.4,
        pitch_max: 0.6,
        margin_wanted: 0.2,
        joint_rate: 0.5,
        speed: 0.1,
    };
}

/// The ground from the side: levels between edges.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// From, to, level, m.
    levels: Vec<[f64; 3]>,
}

/// Where a wheel stands: height of its center and place of its contact, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    /// Height of the center.
    pub center: f64,
    /// x of the contact.
    pub contact: f64,
}

impl Profile {
    /// The profile of an obstacle that begins at x = 0.
    pub fn of(obstacle: &Obstacle) -> Profile {
        let far = 1e9;
        let levels = match *obstacle {
            Obstacle::Step { height } => vec![[-far, 0.0, 0.0], [0.0, far, height]],
            Obstacle::Trench { width, depth } => {
                vec![[-far, 0.0, 0.0], [0.0, width, -depth], [width, far, 0.0]]
            }
        };
        Profile { levels }
    }

    /// The lowest place of a disc of this radius, m, over x. `[eq:wheel-envelope]`
    pub fn stand(&self, x: f64, radius: f64) -> Stand {
        let mut best = Stand {
            center: f64::NEG_INFINITY,
            contact: x,
        };
        for [from, to, level] in &self.levels {
            let nearest = x.clamp(*from, *to);
            let off = x - nearest;
            if off.abs() < radius {
                let center = level + (radius * radius - off * off).sqrt();
                if center > best.center {
                    best = Stand {
                        center,
                        contact: nearest,
                    };
                }
            }
        }
        best
    }

    /// Where the obstacle ends, m.
    fn end(&self) -> f64 {
        self.levels[self.levels.len() - 1][0]
    }
}

/// The robot at an instant.
#[derive(Clone, Debug, Serialize)]
pub struct Frame {
    /// Time, s.
    pub t: f64,
    /// Hinges, front and rear: x, z, m.
    pub hinges: [[f64; 2]; 2],
    /// Angles of the leg systems, front and rear, rad.
    pub legs: [f64; 2],
    /// Pitch of the body, rad.
    pub pitch: f64,
    /// Tilt of the part that tilts against the body's normal, forward positive, rad.
    pub tilt: f64,
    /// Centers of the wheels, from the front to the rear: x, z, m.
    pub wheels: [[f64; 2]; 4],
    /// Which of them touch.
    pub touches: [bool; 4],
    /// Center of mass: x, z, m.
    pub center: [f64; 2],
    /// Ends of the support: x of the rearmost and the foremost contact, m.
    pub support: [f64; 2],
    /// Least distance of the center of mass from an edge of the support polygon, m.
    pub margin: f64,
    /// What the robot does.
    pub deed: &'static str,
}

/// How a crossing went.
#[derive(Clone, Debug)]
pub struct Crossing {
    /// What was decided.
    pub decision: Decision,
    /// The motion, as far as it went.
    pub frames: Vec<Frame>,
    /// Why it went no further; nothing if the robot is across.
    pub refusal: Option<String>,
}

/// A wheel is said to touch within this height, m: a tenth of what the legs' grid resolves.
const TOUCH: f64 = 4e-4;
/// A hinge is said to be at a place within this distance, m.
const ARRIVED: f64 = 1e-5;
/// A leg system that turns by less than this between frames, rad, is at rest.
const STILL: f64 = 1e-6;
/// A hinge that rises or falls by more than this between frames lost or met the ground at once, m: four
/// times what the steepest posture of a path allows.
const JUMP: f64 = 0.04;
/// The most frames: a thousandfold of what obstacles within reach need would be a defect.
const FRAMES_MAX: usize = 20_000;

/// Lets the robot cross an obstacle.
pub fn cross(obstacle: &Obstacle, build: &Build) -> Crossing {
    let decision = decide(obstacle, &build.limits);
    let profile = Profile::of(obstacle);
    let refused = |refusal: String, frames| Crossing {
        decision,
        frames,
        refusal: Some(refusal),
    };
    if decision.strategy == Strategy::Turn {
        return refused("turns away".into(), Vec::new());
    }
    let begin = -build.hinges - 1.2 * build.limits.outer_length();
    let end = profile.end() + build.hinges + 1.2 * build.limits.outer_length();
    let Some(path) = posture::plan(&profile, build, decision.strategy, begin, end) else {
        return refused(
            "finds no sequence of postures that leads across".into(),
            Vec::new(),
        );
    };
    let mut walk = Walk {
        profile: &profile,
        build,
        path: &path,
        front: (end_of(&path, begin + build.hinges), begin + build.hinges),
        rear: (0, begin),
        frames: Vec::new(),
    };
    let refusal = walk.go().err();
    Crossing {
        decision,
        frames: walk.frames,
        refusal,
    }
}

/// The last posture of a path that is not beyond x.
fn end_of(path: &[Posture], x: f64) -> usize {
    path.partition_point(|posture| posture.x <= x).max(1) - 1
}

/// The motion along the path of postures, which is the same for both leg systems.
struct Walk<'a> {
    profile: &'a Profile,
    build: &'a Build,
    path: &'a [Posture],
    /// Of each leg system the last posture it took, and the x of its hinge.
    front: (usize, f64),
    rear: (usize, f64),
    frames: Vec<Frame>,
}

/// Which hinge stays where it is.
#[derive(Clone, Copy, PartialEq)]
enum Fixed {
    Front,
    Rear,
}

impl Walk<'_> {
    fn go(&mut self) -> Result<(), String> {
        self.settle(Fixed::Rear)?;
        let last = self.path.len() - 1;
        while self.front.0 < last {
            if self.frames.len() >= FRAMES_MAX {
                return Err("finds no end of its postures".into());
            }
            let (front, rear) = (self.next(self.front), self.next(self.rear));
            if front <= ARRIVED {
                self.front.0 += 1;
                self.settle(Fixed::Front)?;
            } else if rear <= ARRIVED {
                self.rear.0 += 1;
                self.settle(Fixed::Rear)?;
            } else {
                self.front.1 += front.min(rear);
                self.settle(Fixed::Front)?;
            }
        }
        Ok(())
    }

    /// How far a hinge is from its next posture, m; nothing or less if only the angle is left.
    fn next(&self, (index, x): (usize, f64)) -> f64 {
        self.path
            .get(index + 1)
            .map_or(f64::INFINITY, |next| next.x - x)
    }

    /// Angle of a leg system whose hinge is on the way to its next posture.
    fn angle(&self, index: usize, x: f64) -> f64 {
        let here = self.path[index];
        match self.path.get(index + 1) {
            Some(next) if next.x > here.x => {
                let share = ((x - here.x) / (next.x - here.x)).clamp(0.0, 1.0);
                here.angle + share * (next.angle - here.angle)
            }
            _ => here.angle,
        }
    }

    /// Angle of a leg system on its way, rad, and height of its hinge, m.
    fn leg(&self, (index, x): (usize, f64)) -> (f64, f64) {
        let angle = self.angle(index, x);
        (angle, posture::hinge(self.profile, self.build, x, angle))
    }

    /// Finds the pitch, rad, at which both leg systems stand, and moves the hinge that is not fixed.
    fn level(&mut self, fixed: Fixed) -> f64 {
        let length = self.build.hinges;
        let (ahead, behind) = (self.front.1, self.rear.1);
        let places = |pitch: f64| {
            let along = length * Scalar::sin_cos(pitch).1;
            match fixed {
                Fixed::Front => (ahead, ahead - along),
                Fixed::Rear => (behind + along, behind),
            }
        };
        let (mut low, mut high) = (-1.2, 1.2);
        for _ in 0..60 {
            let pitch = 0.5 * (low + high);
            let (front, rear) = places(pitch);
            let gap = self.leg((self.front.0, front)).1 - self.leg((self.rear.0, rear)).1;
            if gap > length * Scalar::sin_cos(pitch).0 {
                low = pitch;
            } else {
                high = pitch;
            }
        }
        let pitch = 0.5 * (low + high);
        (self.front.1, self.rear.1) = places(pitch);
        pitch
    }

    /// Takes the postures that the hinges have passed; whether there were any.
    fn advance(&mut self) -> bool {
        let mut taken = false;
        for leg in [&mut self.front, &mut self.rear] {
            while let Some(next) = self.path.get(leg.0 + 1)
                && next.x > self.path[leg.0].x
                && next.x <= leg.1 + 1e-9
            {
                leg.0 += 1;
                taken = true;
            }
        }
        taken
    }

    /// Finds pitch and heights, adds a frame, and refuses what the robot cannot bear.
    fn settle(&mut self, fixed: Fixed) -> Result<(), String> {
        let mut pitch = self.level(fixed);
        // A hinge that passed its next posture has taken it, and the legs stand otherwise.
        while self.advance() {
            pitch = self.level(fixed);
        }
        let (legs, heights): (Vec<f64>, Vec<f64>) = [self.front, self.rear]
            .map(|leg| self.leg(leg))
            .into_iter()
            .unzip();
        let frame = self.frame([self.front.1, self.rear.1], heights, legs, pitch);
        let refusal = self.objection(&frame);
        self.frames.push(frame);
        refusal.map_or(Ok(()), Err)
    }

    /// The robot with its hinges and legs there: contacts, tilt, center of mass and time.
    fn frame(&self, x: [f64; 2], z: Vec<f64>, legs: Vec<f64>, pitch: f64) -> Frame {
        let build = self.build;
        let hinges = [[x[0], z[0]], [x[1], z[1]]];
        let (mut wheels, mut touches) = ([[0.0; 2]; 4], [false; 4]);
        let mut support = [f64::INFINITY, f64::NEG_INFINITY];
        for k in 0..4 {
            let hinge = hinges[k / 2];
            let (sin, cos) = Scalar::sin_cos(legs[k / 2]);
            let arm = if k % 2 == 0 { 0.5 } else { -0.5 } * build.limits.wheel_pitch;
            wheels[k] = [hinge[0] + arm * cos, hinge[1] + arm * sin];
            let stand = self.profile.stand(wheels[k][0], build.limits.wheel_radius);
            touches[k] = wheels[k][1] - stand.center < TOUCH;
            if touches[k] {
                support = [support[0].min(stand.contact), support[1].max(stand.contact)];
            }
        }
        let total = build.body_mass + build.tilting_mass + 2.0 * build.leg_mass;
        let middle = [0.5 * (x[0] + x[1]), 0.5 * (z[0] + z[1])];
        let last = self.frames.last();
        let turning = last.map_or(0.0, |last| {
            (legs[0] - last.legs[0])
                .abs()
                .max((legs[1] - last.legs[1]).abs())
        });
        let driven = last.map_or(0.0, |last| {
            let way = |k: usize| (x[k] - last.hinges[k][0]).abs();
            way(0).max(way(1))
        });
        let least = (turning / build.joint_rate).max(driven / build.speed);
        // Back to upright as time allows, unless the center of mass would come too near to an end of
        // the support.
        let leant = last.map_or(0.0, |last| last.tilt - last.pitch);
        let back = (build.joint_rate * least).min(leant.abs());
        let shift = build.tilting_mass * build.tilting_arm / total;
        let place = middle[0] + shift * Scalar::sin_cos(leant - back.copysign(leant)).0;
        let keep = build.margin_wanted.min(0.5 * (support[1] - support[0]));
        let wanted = (place.clamp(support[0] + keep, support[1] - keep) - middle[0]) / shift;
        let sine = wanted.clamp(-0.99, 0.99);
        let lean = Scalar::atan2(sine, (1.0 - sine * sine).sqrt());
        let tilt = (lean + pitch).clamp(-build.tilt_max, build.tilt_max);
        let (sin, cos) = Scalar::sin_cos(tilt - pitch);
        let center = [middle[0] + shift * sin, middle[1] + shift * cos];
        let margin = (center[0] - support[0])
            .min(support[1] - center[0])
            .min(0.5 * build.track);
        let t = last.map_or(0.0, |last| {
            last.t + least.max((tilt - last.tilt).abs() / build.joint_rate)
        });
        let deed = match last {
            None => "stands before the obstacle",
            Some(last) if legs[0] > last.legs[0] + STILL => "swings the front legs up",
            Some(last) if legs[0] < last.legs[0] - STILL => "swings the front legs down",
            Some(last) if legs[1] > last.legs[1] + STILL => "swings the rear legs up",
            Some(last) if legs[1] < last.legs[1] - STILL => "swings the rear legs down",
            Some(_) => "drives",
        };
        Frame {
            t,
            hinges,
            legs: [legs[0], legs[1]],
            pitch,
            tilt,
            wheels,
            touches,
            center,
            support,
            margin,
            deed,
        }
    }

    fn objection(&self, frame: &Frame) -> Option<String> {
        let build = self.build;
        let at = frame.hinges[0][0];
        if let Some(last) = self.frames.last() {
            let fell = (0..2).any(|k| (frame.hinges[k][1] - last.hinges[k][1]).abs() > JUMP);
            if fell {
                return Some(format!(
                    "runs into a wall or off an edge with its front hinge at {at:.3} m"
                ));
            }
        }
        if frame.margin < 0.0 {
            let way = if frame.center[0] < frame.support[0] {
                "backward"
            } else {
                "forward"
            };
            return Some(format!(
                "tips over {way} with its front hinge at {at:.3} m: the center of mass is {:.3} m off the support",
                -frame.margin
            ));
        }
        if frame.pitch.abs() > build.pitch_max {
            return Some(format!(
                "pitches by {:.1}° with its front hinge at {at:.3} m; the limit is {:.1}°",
                frame.pitch.to_degrees(),
                build.pitch_max.to_degrees()
            ));
        }
        None
    }
}

impl Crossing {
    /// Whether the robot set out and did not come across.
    pub fn is_stopped(&self) -> bool {
        self.refusal.is_some() && self.decision.strategy != Strategy::Turn
    }

    /// Least margin of the way, m, and largest pitch and leg angle, rad.
    pub fn extremes(&self) -> [f64; 3] {
        let mut found = [f64::INFINITY, 0.0, 0.0];
        for frame in &self.frames {
            found[0] = found[0].min(frame.margin);
            found[1] = found[1].max(frame.pitch.abs());
            found[2] = frame
                .legs
                .iter()
                .fold(found[2], |most, leg| most.max(leg.abs()));
        }
        found
    }
}

/// What the drawing needs.
pub fn drawing(obstacle: &Obstacle, build: &Build, crossing: &Crossing) -> Value {
    let profile = Profile::of(obstacle);
    let verdict = match &crossing.refusal {
        None => "crossed".to_owned(),
        Some(refusal) => format!("stopped: the robot {refusal}"),
    };
    json!({
        "title": format!("{}: {}", crate::obstacle::name(obstacle), crate::obstacle::words(crossing.decision.strategy)),
        "reason": format!("for {}", crossing.decision.reason),
        "verdict": verdict,
        "levels": profile.levels,
        "radius": build.limits.wheel_radius,
        "arm": build.tilting_arm,
        "frames": crossing.frames.iter().map(|frame| rounded(json!(frame))).collect::<Vec<_>>(),
    })
}

/// Numbers to a hundredth of a millimeter, which no picture shows.
fn rounded(value: Value) -> Value {
    match value {
        Value::Number(number) => number
            .as_f64()
            .map_or(Value::Null, |number| json!((number * 1e5).round() / 1e5)),
        Value::Array(list) => list.into_iter().map(rounded).collect(),
        Value::Object(map) => map.into_iter().map(|(k, v)| (k, rounded(v))).collect(),
        other => other,
    }
}

#[cfg(test)]
mod tests;
