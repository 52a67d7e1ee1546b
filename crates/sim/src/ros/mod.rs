//! What a run says in ROS: one mapping from rows of signals to standard messages, which recordings and nodes
//! share.
//!
//! Frames: `world` is the arena's; `odom` begins where the robot starts, as if it knew nothing else;
//! `base_link` is the robot's on the ground; each wheel has a frame of its own name. Of several robots, topics
//! and frames of each begin with its name.

pub mod message;
pub mod odometry;
mod robot;

use crate::scenario::Scenario;
use crate::signal::Signal;

use message::{Clock, Message, Time, Transforms, kind};
use odometry::Reckon;
use robot::Talk;

/// How a topic is offered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// Reliable, the last ten messages.
    Reliable,
    /// Best effort, the last five: what sensors give.
    Sensor,
    /// Reliable, and kept for those who come later.
    Kept,
    /// Best effort, the last one.
    Clock,
}

/// A topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Name, beginning with `/`.
    pub name: String,
    /// Type, such as `nav_msgs/msg/Odometry`.
    pub kind: &'static str,
    /// How it is offered.
    pub service: Service,
}

/// Turns rows of a world into messages.
pub struct Speaker {
    topics: Vec<Topic>,
    robots: Vec<Talk>,
    begun: bool,
}

/// Places of the topics that all robots share.
pub(crate) const CLOCK: usize = 0;
pub(crate) const TF: usize = 1;
const TF_STATIC: usize = 2;

impl Speaker {
    /// For rows of these signals, of a checked scenario.
    ///
    /// # Errors
    /// The scenario has robots by count.
    pub fn new(scenario: &Scenario, signals: &[Signal]) -> Result<Self, String> {
        if let Some(robot) = scenario.robot.iter().find(|robot| robot.count > 1) {
            return Err(format!(
                "robot.{}.count: must be 1 to speak in ROS, got {}",
                robot.name, robot.count
            ));
        }
        let shared = [
            ("/clock", kind::CLOCK, Service::Clock),
            ("/tf", kind::TRANSFORMS, Service::Reliable),
            ("/tf_static", kind::TRANSFORMS, Service::Kept),
        ];
        let mut topics: Vec<Topic> = shared
            .into_iter()
            .map(|(name, kind, service)| Topic {
                name: name.to_owned(),
                kind,
                service,
            })
            .collect();
        let alone = scenario.robot.len() == 1;
        let robots = scenario.robot.iter();
        let robots = robots
            .map(|robot| Talk::new(scenario, robot, alone, signals, &mut topics))
            .collect();
        Ok(Speaker {
            topics,
            robots,
            begun: false,
        })
    }

    /// The topics, by which messages are told apart.
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Variance of a reading of a robot's wheels, rad²: its encoder's, or none.
    pub fn variance(&self, robot: usize) -> f64 {
        self.robots[robot].variance()
    }

    /// Names of a robot's driven wheels, and the way (forward, left, turn) per angle of each; empty where wheels
    /// that steer tell no twist by themselves.
    pub fn driven(&self, robot: usize) -> (&[String], &[Vec<f64>; 3]) {
        let (names, gain) = self.robots[robot].driven();
        (names, gain)
    }

    /// Names the frames of a robot's odometry and base, and says whether its odometry is a transform, too.
    pub fn call_frames(&mut self, robot: usize, frames: &[String; 2], has_transform: bool) {
        self.robots[robot].call_frames(frames, has_transform);
    }

    /// Lets a robot sum its odometry by a law of its own.
    ///
    /// # Errors
    /// The robot has no wheel of the name that is given back.
    pub fn reckon_by(&mut self, robot: usize, law: Box<dyn Reckon>) -> Result<(), String> {
        self.robots[robot].reckon_by(law)
    }

    /// Says a row at time `t`, s: calls `say` with the place of the topic and the message.
    pub fn say<E>(
        &mut self,
        t: f64,
        row: &[f64],
        say: &mut dyn FnMut(usize, Message) -> Result<(), E>,
    ) -> Result<(), E> {
        let stamp = Time::of(t);
        say(CLOCK, Message::Clock(Clock { clock: stamp }))?;
        if !std::mem::replace(&mut self.begun, true) {
            let transforms = self.robots.iter().flat_map(|robot| robot.fixed(stamp));
            let transforms = transforms.collect();
            say(TF_STATIC, Message::Transforms(Transforms { transforms }))?;
        }
        let mut transforms = Vec::new();
        for robot in &mut self.robots {
            robot.say(t, row, &mut transforms, say)?;
        }
        say(TF, Message::Transforms(Transforms { transforms }))
    }
}
