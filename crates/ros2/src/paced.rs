//! The loop of nodes that hear twists and speak, and know no services: in step with the clock.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use appell_sim::ros::message::{Clock, Message, Time};

use crate::foxglove::View;
use crate::simulator::Simulator;

/// How long the loop rests between two looks at what has come.
const GLANCE: Duration = Duration::from_micros(500);
/// Commands that wait for the simulation.
pub const WAITING_MAX: usize = 256;
/// Complaints that are told.
const COMPLAINTS_MAX: u32 = 5;

/// A twist (forward, left, yaw rate) with the time of its stamp if it has one, or why there is none; and the robot
/// that it is for.
pub type Heard = (usize, Result<([f64; 3], Option<f64>), String>);

/// Sends what is said in a tick: messages with the places of their topics.
pub type Publish<'a> = dyn FnMut(&[(usize, Message)]) + 'a;

/// Lets a simulation run at a pace, until `duration` or until it is told to stop. What is said in a tick is given to
/// `publish` by the places of the topics, and who looks on sees it.
///
/// # Errors
/// The run has ended before, for the reason that is given.
pub fn run(
    simulator: &mut Simulator,
    (pace, duration): (f64, f64),
    commands: &Receiver<Heard>,
    view: Option<&View>,
    stop: &AtomicBool,
    publish: &mut Publish<'_>,
) -> Result<(), String> {
    let begun = Instant::now();
    let (mut said, mut complaints) = (Vec::new(), 0);
    while !stop.load(Ordering::Relaxed) && simulator.now() < duration {
        while let Ok((robot, heard)) = commands.try_recv() {
            let taken = heard.and_then(|(twist, stamp)| simulator.command(robot, twist, stamp));
            if let Err(problem) = taken
                && complaints < COMPLAINTS_MAX
            {
                complaints += 1;
                eprintln!("cmd_vel: refused: {problem}");
            }
        }
        let due = begun + Duration::from_secs_f64(simulator.now() / pace);
        let left = due.saturating_duration_since(Instant::now());
        if !left.is_zero() {
            std::thread::sleep(left.min(GLANCE));
            continue;
        }
        let clock = Time::of(simulator.now());
        said.clear();
        let advanced = simulator.advance(&mut said);
        // The clock ticks with the simulation, not with its rows.
        said.retain(|(topic, _)| *topic != 0);
        said.push((0, Message::Clock(Clock { clock })));
        if let Some(view) = view {
            view.tell(clock);
            for (topic, message) in &said {
                view.say(*topic, clock, message);
            }
        }
        publish(&said);
        advanced?;
    }
    Ok(())
}
