//! The simulation as a node drives it: tick by tick, with what was commanded, saying messages. It knows of no
//! network and no clock, so that the same commands at the same ticks give the same messages.

use std::path::Path;

use appell_sim::change::Session;
use appell_sim::record::{Closing, Event, Header, RecordError, Recorder};
use appell_sim::ros::message::{Message, kind};
use appell_sim::ros::{Speaker, Topic};
use appell_sim::run::Run;
use appell_sim::scenario::{self, Channel, Controller, FIRST, Loaded, Signal, Standby};

use crate::drive::{Drive, Odometer};
use crate::tape::Tape;

/// What a scenario's own controllers are called beside the commands from outside.
pub const OWN: &str = "scenario";
/// Velocities beyond these are clamped, m/s and rad/s: what no robot on wheels does.
const FASTEST: [f64; 3] = [100.0, 100.0, 1000.0];
/// Longest run, s.
const LONGEST: f64 = 1e6;
const CHANNELS: [&str; 3] = ["forward", "left", "yaw_rate"];

/// What a node calls a topic that it offers: what a robot was told is no news, others say it.
pub fn offered(topic: &Topic) -> String {
    match topic.kind {
        kind::TWIST => format!("{}_out_unstamped", topic.name),
        kind::TWIST_STAMPED => topic.name.replace("_stamped", "_out"),
        _ => topic.name.clone(),
    }
}

/// A topic below a namespace; those that all robots share stay at the top.
pub fn placed(topic: &str, namespace: &str) -> String {
    match (topic, namespace.trim_matches('/')) {
        ("/clock" | "/tf" | "/tf_static", _) | (_, "") => topic.to_owned(),
        (topic, space) => format!("/{space}{topic}"),
    }
}

/// How the simulation is driven.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Ticks of control per second of the simulation.
    pub rate: f64,
    /// Rows that are said per second of the simulation.
    pub publish_rate: f64,
    /// A command older than this is none, s; none is too old if 0. A drive has its own.
    pub timeout: f64,
    /// Drives of ros2_control, by the names of robots.
    pub drives: Vec<(String, Drive)>,
    /// Whether the scenario's own controllers and tasks stay, to be swapped in.
    pub keeps_controllers: bool,
}

/// Where a robot's wheels are told to turn.
enum Command {
    Twist([f64; 3]),
    /// Rates of the driven wheels, rad/s.
    Rates(Vec<f64>),
}

/// A robot that is commanded from outside.
struct Puppet {
    name: String,
    drive: Option<Drive>,
    /// The time of the last command, and what it was.
    command: Option<(f64, Command)>,
    /// The last two twists after their limits.
    before: [[f64; 3]; 2],
    /// The twist in force.
    held: [f64; 3],
}

/// A world that is driven from outside.
pub struct Simulator {
    loaded: Loaded,
    settings: Settings,
    session: Session,
    speaker: Speaker,
    puppets: Vec<Puppet>,
    /// Steps of the physics in a tick of control, and control ticks since the begin.
    ticks: u64,
    tick: u64,
    /// Control ticks before the present session.
    earlier: u64,
    tape: Option<Tape>,
}

/// Collects what is said.
struct Listener<'a> {
    speaker: &'a mut Speaker,
    said: &'a mut Vec<(usize, Message)>,
    tape: Option<&'a mut Tape>,
    offset: f64,
}

impl Recorder for Listener<'_> {
    fn begin(&mut self, _header: &Header) -> Result<(), RecordError> {
        Ok(())
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        let Listener {
            speaker,
            said,
            tape,
            offset,
        } = self;
        if let Some(tape) = tape {
            tape.frame(t + *offset, row)?;
        }
        let told =
            speaker.say::<std::convert::Infallible>(t + *offset, row, &mut |topic, message| {
                said.push((topic, message));
                Ok(())
            });
        told.map_or_else(|never| match never {}, |()| Ok(()))
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        let event = Event {
            t: event.t + self.offset,
            ..event.clone()
        };
        self.tape.as_mut().map_or(Ok(()), |tape| tape.event(&event))
    }

    fn finish(&mut self, _summary: Closing<'_>) -> Result<(), RecordError> {
        Ok(())
    }
}

/// Ticks of the physics in a period.
fn whole(option: &str, rate: f64, step: f64) -> Result<u64, String> {
    if !(rate > 0.0 && rate.is_finite()) {
        return Err(format!("{option}: must be a finite number > 0, got {rate}"));
    }
    let ticks = 1.0 / rate / step;
    match (ticks - ticks.round()).abs() < 1e-6 * ticks && ticks.round() >= 1.0 {
        true => Ok(ticks.round() as u64),
        false => Err(format!(
            "{option}: its period must be a multiple of time.step = {step} s, got {rate} Hz"
        )),
    }
}

/// The scenario with commands from outside in the place of controllers.
fn opened(loaded: &Loaded, settings: &Settings, ticks: u64, row: u64) -> Result<Loaded, String> {
    let mut scenario = loaded.scenario.clone();
    let step = scenario.time.step;
    let period = ticks as f64 * step;
    scenario.time.duration = LONGEST;
    scenario.record.period = row as f64 * step;
    scenario.statistics = None;
    scenario.batch = None;
    if !settings.keeps_controllers {
        scenario.swap.clear();
    }
    for robot in &mut scenario.robot {
        let own = robot.controller.take();
        // The wheels' loop stays as fast as it was.
        let before = own.as_ref().map(Controller::period);
        robot.servo.period = robot.servo.period.or(before).or(Some(period));
        robot.controller = Some(Controller::Signals {
            period,
            channel: CHANNELS
                .map(|to| Channel {
                    to: to.to_owned(),
                    signal: Signal::External {},
                })
                .to_vec(),
        });
        if settings.keeps_controllers {
            if let Some(controller) = own {
                robot.standby.push(Standby {
                    name: OWN.to_owned(),
                    controller,
                });
            }
        } else {
            robot.standby.clear();
            robot.task = None;
        }
    }
    let opened = scenario::load_text(&scenario.to_toml(), &loaded.file, &Vec::new());
    let opened = opened.map_err(|diagnostics| diagnostics.to_string())?;
    Ok(Loaded {
        trust_native: loaded.trust_native,
        ..opened
    })
}

impl Simulator {
    /// A simulation of a scenario at its begin.
    ///
    /// # Errors
    /// The scenario cannot be run, or a setting does not fit it.
    pub fn new(loaded: &Loaded, settings: &Settings) -> Result<Self, String> {
        let step = loaded.scenario.time.step;
        let ticks = whole("--rate", settings.rate, step)?;
        let row = whole("--publish-rate", settings.publish_rate, step)?;
        let loaded = opened(loaded, settings, ticks, row)?;
        for (robot, drive) in &settings.drives {
            if !loaded
                .scenario
                .robot
                .iter()
                .any(|known| known.name == *robot)
            {
                return Err(format!(
                    "{}: must be for a robot of the scenario, got {robot}",
                    drive.name
                ));
            }
        }
        let (session, speaker) = begun(&loaded, settings)?;
        let puppets = loaded.scenario.robot.iter().map(|robot| {
            let drive = settings.drives.iter().find(|(name, _)| *name == robot.name);
            Puppet {
                name: robot.name.clone(),
                drive: drive.map(|(_, drive)| drive.clone()),
                command: None,
                before: [[0.0; 3]; 2],
                held: [0.0; 3],
            }
        });
        Ok(Simulator {
            puppets: puppets.collect(),
            loaded,
            settings: settings.clone(),
            session,
            speaker,
            ticks,
            tick: 0,
            earlier: 0,
            tape: None,
        })
    }

    /// Records from here on into a folder, which [`Simulator::close`] completes.
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub fn record(&mut self, folder: &Path) -> Result<(), String> {
        self.tape = Some(Tape::open(folder, &self.session.run.header)?);
        Ok(())
    }

    /// Completes the recording, if there is one: its summary counts from the last reset or placing of a robot on.
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub fn close(&mut self) -> Result<(), String> {
        match self.tape.take() {
            Some(tape) => tape.close(&self.session.summary()),
            None => Ok(()),
        }
    }

    /// What it says, by place.
    pub fn topics(&self) -> &[Topic] {
        self.speaker.topics()
    }

    /// Names of the robots.
    pub fn robots(&self) -> impl Iterator<Item = &str> {
        self.puppets.iter().map(|puppet| puppet.name.as_str())
    }

    /// Time, s.
    pub fn now(&self) -> f64 {
        self.at(self.tick)
    }

    fn at(&self, tick: u64) -> f64 {
        (tick * self.ticks) as f64 * self.loaded.scenario.time.step
    }

    /// Length of a tick of control, s.
    pub fn period(&self) -> f64 {
        self.at(1)
    }

    /// Takes a twist (forward, left, yaw rate) that a robot was told, at the time of its stamp or now.
    ///
    /// # Errors
    /// It is not finite, or its stamp is too old; it does not count.
    pub fn command(
        &mut self,
        robot: usize,
        twist: [f64; 3],
        stamp: Option<f64>,
    ) -> Result<(), String> {
        if !twist.iter().all(|part| part.is_finite()) {
            return Err(format!("a command must be finite, got {twist:?}"));
        }
        let now = self.now();
        let puppet = &mut self.puppets[robot];
        let timeout = puppet
            .drive
            .as_ref()
            .map_or(self.settings.timeout, |drive| drive.timeout);
        // A stamp of zero, or of a time to come, is none.
        let at = stamp.filter(|t| *t > 0.0 && *t <= now).unwrap_or(now);
        if timeout > 0.0 && now - at > timeout {
            return Err(format!(
                "a command must be at most {timeout} s old, got {} s",
                now - at
            ));
        }
        let clamped = [0, 1, 2].map(|k| twist[k].clamp(-FASTEST[k], FASTEST[k]));
        puppet.command = Some((at, Command::Twist(clamped)));
        Ok(())
    }

    /// Takes rates of wheels by their names, rad/s; driven wheels that are not named stand still.
    ///
    /// # Errors
    /// A rate is not finite, or a name is none of a driven wheel; nothing counts then.
    pub fn turn(&mut self, robot: usize, names: &[String], rates: &[f64]) -> Result<(), String> {
        let (wheels, _) = self.speaker.driven(robot);
        let mut wanted = vec![0.0; wheels.len()];
        if names.len() != rates.len() {
            return Err(format!(
                "must have a velocity for each of {} names, got {}",
                names.len(),
                rates.len()
            ));
        }
        for (name, rate) in names.iter().zip(rates) {
            let place = wheels.iter().position(|wheel| wheel == name);
            let place = place.ok_or_else(|| {
                format!(
                    "must be a driven wheel, got {name:?}; there are: {}",
                    wheels.join(", ")
                )
            })?;
            if !rate.is_finite() {
                return Err(format!("{name}: must be finite, got {rate}"));
            }
            wanted[place] = rate.clamp(-1e4, 1e4);
        }
        let now = self.now();
        self.puppets[robot].command = Some((now, Command::Rates(wanted)));
        Ok(())
    }

    /// Lets another controller of a robot drive; [`FIRST`] are the commands from outside.
    ///
    /// # Errors
    /// There is none of that name.
    pub fn swap(&mut self, robot: usize, to: &str) -> Result<(), String> {
        let name = self.puppets[robot].name.clone();
        let to = if to == "external" { FIRST } else { to };
        self.session
            .run
            .swap(&name, to)
            .map_err(|error| error.to_string())
    }

    /// Begins anew, at time 0.
    ///
    /// # Errors
    /// The scenario cannot be run any more: a file of it has changed.
    pub fn reset(&mut self) -> Result<(), String> {
        let loaded = self.loaded.clone();
        self.begin(loaded)?;
        self.tick = 0;
        self.earlier = 0;
        self.tape.as_mut().map_or(Ok(()), Tape::rewind)
    }

    /// Puts a robot somewhere, at rest, and goes on from there; the others stay where they are, at rest, too.
    ///
    /// # Errors
    /// A number is not finite, or the scenario cannot begin there.
    pub fn place(&mut self, robot: usize, pose: [f64; 3]) -> Result<(), String> {
        if !pose.iter().all(|part| part.is_finite()) {
            return Err(format!("a pose must be finite, got {pose:?}"));
        }
        let mut scenario = self.loaded.scenario.clone();
        let world = &self.session.run.world;
        for (k, other) in scenario.robot.iter_mut().enumerate() {
            other.twist = [0.0; 2];
            let column = |axis: &str| {
                let path = format!("robot.{}.pose.{axis}", other.name);
                world
                    .column(&path)
                    .map_or(0.0, |column| world.row()[column])
            };
            other.pose = if k == robot {
                pose
            } else {
                ["x", "y", "yaw"].map(column)
            };
        }
        let loaded = scenario::load_text(&scenario.to_toml(), &self.loaded.file, &Vec::new());
        let loaded = loaded.map_err(|diagnostics| diagnostics.to_string())?;
        let trust_native = self.loaded.trust_native;
        self.begin(Loaded {
            trust_native,
            ..loaded
        })?;
        self.earlier = self.tick;
        Ok(())
    }

    fn begin(&mut self, loaded: Loaded) -> Result<(), String> {
        (self.session, self.speaker) = begun(&loaded, &self.settings)?;
        for puppet in &mut self.puppets {
            puppet.command = None;
            puppet.before = [[0.0; 3]; 2];
            puppet.held = [0.0; 3];
        }
        Ok(())
    }

    /// The twist that a robot is held to.
    pub fn held(&self, robot: usize) -> [f64; 3] {
        self.puppets[robot].held
    }

    /// Makes a tick of control under the commands in force, and adds what is said on the way.
    ///
    /// # Errors
    /// The run has ended, for the reason that is given.
    pub fn advance(&mut self, said: &mut Vec<(usize, Message)>) -> Result<(), String> {
        let (now, dt) = (self.now(), self.period());
        for robot in 0..self.puppets.len() {
            let held = self.hold(robot, now, dt);
            self.puppets[robot].held = held;
            for (axis, value) in CHANNELS.into_iter().zip(held) {
                let path = format!("robot.{}.command.{axis}", self.puppets[robot].name);
                self.session.run.command(&path, value);
            }
        }
        let mut listener = Listener {
            speaker: &mut self.speaker,
            said,
            tape: self.tape.as_mut(),
            offset: (self.earlier * self.ticks) as f64 * self.loaded.scenario.time.step,
        };
        let goes_on = self.session.advance(self.ticks, &mut listener);
        self.tick += 1;
        match goes_on {
            Ok(true) => Ok(()),
            Ok(false) => Err(self.session.summary().reason),
            Err(error) => Err(error.to_string()),
        }
    }

    /// The twist for a tick: the command, unless it is too old, within its limits, as the wheels can do it.
    fn hold(&mut self, robot: usize, now: f64, dt: f64) -> [f64; 3] {
        let (_, gain) = self.speaker.driven(robot);
        let twist_of = |rates: &[f64]| {
            [0, 1, 2].map(|axis: usize| {
                gain[axis]
                    .iter()
                    .zip(rates)
                    .map(|(gain, rate)| gain * rate)
                    .sum::<f64>()
            })
        };
        let puppet = &mut self.puppets[robot];
        let timeout = puppet
            .drive
            .as_ref()
            .map_or(self.settings.timeout, |drive| drive.timeout);
        // Times are whole ticks: half of one is far from any rounding.
        let fresh = |at: f64| timeout <= 0.0 || now - at <= timeout + 0.5 * dt * 1e-3;
        let wanted = match &puppet.command {
            Some((at, Command::Twist(twist))) if fresh(*at) => *twist,
            Some((at, Command::Rates(rates))) if fresh(*at) => return twist_of(rates),
            _ => [0.0; 3],
        };
        let Some(drive) = &puppet.drive else {
            return wanted;
        };
        let [earlier, last] = puppet.before;
        let limited = [0, 1, 2]
            .map(|axis| drive.limits[axis].hold(wanted[axis], last[axis], earlier[axis], dt));
        puppet.before = [last, limited];
        // What the drive tells its wheels, by its own numbers, is what the true wheels do.
        let rates = drive.rates(limited);
        let (wheels, _) = self.speaker.driven(robot);
        let names = drive.wheels();
        let of = |wheel: &String| {
            let place = names.iter().position(|name| name == wheel);
            place.map_or(0.0, |place| rates[place])
        };
        twist_of(&wheels.iter().map(of).collect::<Vec<_>>())
    }
}

/// A session at its begin, and who speaks for it.
fn begun(loaded: &Loaded, settings: &Settings) -> Result<(Session, Speaker), String> {
    let run = Run::new(loaded, 0).map_err(|diagnostics| diagnostics.to_string())?;
    let mut speaker = Speaker::new(&loaded.scenario, run.world.signals())?;
    for (k, robot) in loaded.scenario.robot.iter().enumerate() {
        let Some((_, drive)) = settings.drives.iter().find(|(name, _)| *name == robot.name) else {
            continue;
        };
        let (wheels, _) = speaker.driven(k);
        if wheels.is_empty() {
            return Err(format!(
                "robot.{}: must have wheels that alone tell its twist to be driven by {}",
                robot.name, drive.name
            ));
        }
        let names = drive.wheels();
        let told = |names: &[String]| names.join(", ");
        if names.iter().any(|name| !wheels.contains(name)) || names.len() != wheels.len() {
            return Err(format!(
                "{}: must name the driven wheels of robot {}, got {}\n  hint: they are called {}",
                drive.name,
                robot.name,
                told(&names),
                told(wheels)
            ));
        }
        speaker.call_frames(k, &drive.frames, drive.enable_odom_tf);
        let odometer = Odometer::new(drive, speaker.variance(k));
        let done = speaker.reckon_by(k, Box::new(odometer));
        done.map_err(|wheel| format!("{}: the robot has no wheel {wheel}", drive.name))?;
    }
    Ok((Session::new(run), speaker))
}
