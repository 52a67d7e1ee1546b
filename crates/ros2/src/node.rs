//! A node of ROS 2 over RTPS: topics, services, and the loop that lets the simulation keep step with the clock
//! or with whoever commands it.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use appell_sim::ros::Service as Quality;
use appell_sim::ros::message::{Clock, JointState, Message, Pose, Time, Twist, TwistStamped, kind};
use appell_sim::scenario::Loaded;
use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantBuilder};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Context, Gid, MessageInfo, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher,
    QosProfile, Subscription,
};
use serde::{Deserialize, Serialize};

use crate::foxglove::{Shown, View};
use crate::service::{Done, Flag, Nothing, Service, SetPose, SwitchController};
use crate::simulator::{Settings, Simulator, offered, placed};

/// How long the loop rests between two looks at what has come.
const GLANCE: Duration = Duration::from_micros(500);
/// How long those in lock-step may take to know us, once we know them.
const GREETING: Duration = Duration::from_secs(1);
/// Most messages that are taken from one topic at a look.
const LOOK_MAX: usize = 256;
/// Type of the topic `controller`.
const WORDS: &str = "std_msgs/msg/String";
/// Complaints of one kind that are told.
const COMPLAINTS_MAX: u32 = 5;

/// How a node behaves.
#[derive(Clone, Debug)]
pub struct Options {
    /// Domain, as ROS_DOMAIN_ID.
    pub domain: u16,
    /// Name of the node.
    pub name: String,
    /// Namespace before all relative names; empty for none.
    pub namespace: String,
    /// Address whose network others may be on; none for this machine alone.
    pub network: Option<IpAddr>,
    /// Seconds of the simulation per second; as fast as can be if infinite.
    pub pace: f64,
    /// Whether each tick waits for its command.
    pub lock_step: bool,
    /// Length of the run, s of the simulation.
    pub duration: f64,
    /// Messages of `/clock` per second of the simulation.
    pub clock_rate: f64,
    /// Whether it begins at rest.
    pub paused: bool,
    /// Where those who look on by Foxglove are listened for; none for nowhere.
    pub foxglove: Option<SocketAddr>,
}

/// What std_msgs/String says.
#[derive(Clone, Debug, Deserialize, Serialize)]
struct Words {
    data: String,
}

/// Who writes what. The library brings readers and writers of a topic together whatever their types are, and
/// the bytes of one type may well pass for another.
struct Writers {
    participant: DomainParticipant,
    /// Types of those that were heard.
    known: Vec<(Gid, String)>,
}

impl Writers {
    /// Whether a message is from a writer of this type.
    fn writes(&mut self, from: &MessageInfo, kind: &str) -> bool {
        let gid = from.publisher_gid();
        if !self.known.iter().any(|(known, _)| *known == gid) {
            let found = self
                .participant
                .discovered_writers()
                .into_iter()
                .find(|writer| Gid::from(writer.writer_proxy.remote_writer_guid) == gid);
            let Some(writer) = found else {
                return false;
            };
            if self.known.len() >= LOOK_MAX {
                self.known.clear();
            }
            self.known
                .push((gid, writer.publication_topic_data.type_name));
        }
        let own = type_name(kind).dds_msg_type();
        self.known
            .iter()
            .any(|(known, kind)| *known == gid && *kind == own)
    }
}

/// What one robot hears and is asked.
struct Ears {
    twist: Subscription<Twist>,
    stamped: Subscription<TwistStamped>,
    joints: Subscription<JointState>,
    swap: Subscription<Words>,
    set_pose: Service<SetPose, Nothing>,
    switch: Service<SwitchController, Done>,
    /// Twists that wait for their tick, in lock-step.
    waiting: std::collections::VecDeque<([f64; 3], Option<f64>)>,
}

/// The node.
pub struct Front {
    simulator: Simulator,
    options: Options,
    publishers: Vec<Publisher<Message>>,
    clock: Publisher<Message>,
    ears: Vec<Ears>,
    reset: Service<Nothing, Nothing>,
    pause: Service<Flag, Done>,
    step: Service<Nothing, Done>,
    is_paused: bool,
    /// Ticks that were asked for while it rests.
    steps: u32,
    view: Option<View>,
    complaints: std::collections::BTreeMap<&'static str, u32>,
    /// Since when all whom lock-step needs are there.
    met: Option<Instant>,
    writers: Writers,
    node: Node,
}

fn quality(service: Quality) -> QosProfile {
    let profile = QosProfile::publisher_default()
        // A reader that sleeps holds nobody up.
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth: 10 });
    match service {
        Quality::Reliable => profile,
        Quality::Sensor => profile
            .reliability_best_effort()
            .history(History::KeepLast { depth: 5 }),
        Quality::Kept => profile
            .durability(Durability::TransientLocal)
            .history(History::KeepLast { depth: 1 }),
        Quality::Clock => profile
            .reliability_best_effort()
            .history(History::KeepLast { depth: 1 }),
    }
}

/// The topics as a live view shows them, below a namespace.
pub fn shown(simulator: &Simulator, namespace: &str) -> Vec<Shown> {
    let topics = simulator.topics().iter().map(|topic| Shown {
        name: placed(&offered(topic), namespace),
        kind: topic.kind,
        is_kept: topic.service == Quality::Kept,
    });
    topics.collect()
}

fn type_name(kind: &str) -> MessageTypeName {
    let (package, name) = kind.split_once("/msg/").unwrap_or(("", kind));
    MessageTypeName::new(package, name)
}

fn planar(pose: &Pose) -> [f64; 3] {
    use appell_model::scalar::Scalar;
    let q = pose.orientation;
    let (sin, cos) = (
        2.0 * (q.w * q.z + q.x * q.y),
        1.0 - 2.0 * (q.y * q.y + q.z * q.z),
    );
    [pose.position.x, pose.position.y, Scalar::atan2(sin, cos)]
}

fn twist_of(twist: &Twist) -> [f64; 3] {
    [twist.linear.x, twist.linear.y, twist.angular.z]
}

impl Front {
    /// Opens the node, at the begin of the simulation.
    ///
    /// # Errors
    /// The scenario cannot be run so, or the network cannot be used.
    pub fn open(loaded: &Loaded, settings: &Settings, options: Options) -> Result<Front, String> {
        let simulator = Simulator::new(loaded, settings)?;
        let net = |error: &dyn std::fmt::Debug| format!("the network cannot be used: {error:?}");
        let before = sockets();
        let address = options.network.unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST));
        let participant = DomainParticipantBuilder::new(options.domain)
            .with_only_networks([address])
            .build()
            .map_err(|error| net(&error))?;
        let writers = Writers {
            participant: participant.clone(),
            known: Vec::new(),
        };
        let context = Context::from_domain_participant(participant).map_err(|error| net(&error))?;
        let space = match options.namespace.trim_matches('/') {
            "" => "/".to_owned(),
            words => format!("/{words}"),
        };
        let name = NodeName::new(&space, &options.name)
            .map_err(|error| format!("--namespace, --name: {error:?}"))?;
        let node_options = NodeOptions::new().enable_rosout(true);
        let mut node = context
            .new_node(name, node_options)
            .map_err(|error| net(&error))?;
        let spinner = node.spinner().map_err(|error| net(&error))?;
        std::thread::spawn(move || futures::executor::block_on(spinner.spin()));

        let named = |topic: &str| {
            Name::parse(&placed(topic, &options.namespace))
                .map_err(|error| format!("{topic}: is no name in ROS: {error:?}"))
        };
        let mut offer = |topic: &str, kind: &str, service| -> Result<Publisher<Message>, String> {
            let qos = quality(service);
            let topic = node
                .create_topic(&named(topic)?, type_name(kind), &qos)
                .map_err(|error| net(&error))?;
            node.create_publisher(&topic, Some(qos))
                .map_err(|error| net(&error))
        };
        let mut publishers = Vec::new();
        for topic in simulator.topics() {
            if topic.kind != kind::CLOCK {
                publishers.push(offer(&offered(topic), topic.kind, topic.service)?);
            }
        }
        let clock = offer("/clock", kind::CLOCK, Quality::Clock)?;

        let heard = QosProfile::publisher_default().history(match options.lock_step {
            true => History::KeepAll,
            false => History::KeepLast { depth: 10 },
        });
        // Whoever sends at best effort is heard, too, unless every command counts.
        let heard = match options.lock_step {
            true => heard,
            false => heard.reliability_best_effort(),
        };
        let alone = simulator.robots().count() == 1;
        let mut ears = Vec::new();
        let robots: Vec<String> = simulator.robots().map(str::to_owned).collect();
        for robot in robots {
            let own = |topic: &str| match alone {
                true => format!("/{topic}"),
                false => format!("/{robot}/{topic}"),
            };
            let hear = |topic: &str, kind: &str| {
                let name = named(&own(topic))?;
                node.create_topic(&name, type_name(kind), &heard)
                    .map_err(|error| net(&error))
            };
            let twist = hear("cmd_vel", kind::TWIST)?;
            let stamped = hear("cmd_vel", kind::TWIST_STAMPED)?;
            let joints = hear("joint_command", kind::JOINT_STATE)?;
            let swap = hear("controller", WORDS)?;
            ears.push(Ears {
                twist: node
                    .create_subscription(&twist, None)
                    .map_err(|e| net(&e))?,
                stamped: node
                    .create_subscription(&stamped, None)
                    .map_err(|e| net(&e))?,
                joints: node
                    .create_subscription(&joints, None)
                    .map_err(|e| net(&e))?,
                swap: node.create_subscription(&swap, None).map_err(|e| net(&e))?,
                set_pose: Service::offer(
                    &mut node,
                    &named(&own("set_pose"))?,
                    ("robot_localization", "SetPose"),
                )?,
                switch: Service::offer(
                    &mut node,
                    &named(&own("controller_manager/switch_controller"))?,
                    ("controller_manager_msgs", "SwitchController"),
                )?,
                waiting: std::collections::VecDeque::new(),
            });
        }
        let service = |name: &str| named(&format!("/{}/{name}", options.name));
        let reset = Service::offer(&mut node, &service("reset")?, ("std_srvs", "Empty"))?;
        let pause = Service::offer(&mut node, &service("pause")?, ("std_srvs", "SetBool"))?;
        let step = Service::offer(&mut node, &service("step")?, ("std_srvs", "Trigger"))?;
        if options.network.is_none() {
            confine(&before)?;
        }
        let view = match options.foxglove {
            None => None,
            Some(address) => Some(View::open(address, shown(&simulator, &options.namespace))?),
        };
        Ok(Front {
            simulator,
            is_paused: options.paused,
            options,
            publishers,
            clock,
            ears,
            reset,
            pause,
            step,
            steps: 0,
            view,
            complaints: std::collections::BTreeMap::new(),
            met: None,
            writers,
            node,
        })
    }

    /// Runs until the end, or until it is told to stop.
    ///
    /// # Errors
    /// The run has ended before, for the reason that is given.
    pub fn run(&mut self, stop: &Arc<AtomicBool>) -> Result<(), String> {
        let mut agreed = (self.simulator.now(), Instant::now());
        let mut clock_due = 0.0_f64;
        let mut said = Vec::new();
        while !stop.load(Ordering::Relaxed) && self.simulator.now() < self.options.duration {
            let (before, was_paused) = (self.simulator.now(), self.is_paused);
            self.listen();
            if self.simulator.now() != before || was_paused != self.is_paused {
                agreed = (self.simulator.now(), Instant::now());
                clock_due = clock_due.min(self.simulator.now());
            }
            let may_go = !self.is_paused || self.steps > 0;
            if !may_go || !self.is_commanded() {
                std::thread::sleep(GLANCE);
                continue;
            }
            // In lock-step whoever commands keeps the time.
            if self.options.pace.is_finite() && !self.is_paused {
                let due = agreed.1
                    + Duration::from_secs_f64(
                        (self.simulator.now() - agreed.0) / self.options.pace,
                    );
                let left = due.saturating_duration_since(Instant::now());
                if !left.is_zero() {
                    std::thread::sleep(left.min(GLANCE));
                    continue;
                }
                if Instant::now() - due > Duration::from_millis(200) {
                    // What cannot be kept up with is not made up for.
                    agreed = (self.simulator.now(), Instant::now());
                }
            }
            self.steps = self.steps.saturating_sub(1);
            if self.options.lock_step {
                self.take_commands();
            }
            let now = self.simulator.now();
            if now >= clock_due - 1e-9 {
                let stamp = Clock {
                    clock: Time::of(now),
                };
                let _ = self.clock.publish(Message::Clock(stamp));
                if let Some(view) = &self.view {
                    view.tell(stamp.clock);
                    view.say(0, stamp.clock, &Message::Clock(stamp));
                }
                clock_due = f64::max(clock_due + 1.0 / self.options.clock_rate, now);
            }
            said.clear();
            let advanced = self.simulator.advance(&mut said);
            for (topic, message) in said.drain(..) {
                // The clock has a pace of its own; a full window loses what is old anyway.
                if topic > 0 {
                    if let Some(view) = &self.view {
                        view.say(topic, Time::of(now), &message);
                    }
                    let _ = self.publishers[topic - 1].publish(message);
                }
            }
            advanced?;
        }
        Ok(())
    }

    /// The live view, if there is one.
    pub fn view(&self) -> Option<&View> {
        self.view.as_ref()
    }

    /// The simulation.
    pub fn simulator(&self) -> &Simulator {
        &self.simulator
    }

    /// The simulation, to be recorded.
    pub fn simulator_mut(&mut self) -> &mut Simulator {
        &mut self.simulator
    }

    /// Whether the next tick has what it waits for. The first has nothing to answer, but somebody to hear it.
    fn is_commanded(&mut self) -> bool {
        if !self.options.lock_step {
            return true;
        }
        if self.simulator.now() > 0.0 {
            return self.ears.iter().all(|ears| !ears.waiting.is_empty());
        }
        let odometries = self
            .simulator
            .topics()
            .iter()
            .enumerate()
            .filter_map(|(k, topic)| {
                let is_odometry = topic.name.ends_with("/odom") && topic.kind == kind::ODOMETRY;
                is_odometry.then(|| &self.publishers[k - 1])
            });
        let is_heard = { odometries }.all(|one| one.get_subscription_count(&self.node) > 0);
        let are_there = self.ears.iter().all(|ears| {
            let twists = ears.twist.get_publisher_count(&self.node);
            twists + ears.stamped.get_publisher_count(&self.node) > 0
        });
        self.met = match (is_heard && are_there, self.met) {
            (false, _) => None,
            (true, None) => Some(Instant::now()),
            (true, since) => since,
        };
        self.met.is_some_and(|since| since.elapsed() > GREETING)
    }

    fn take_commands(&mut self) {
        for robot in 0..self.ears.len() {
            if let Some((twist, stamp)) = self.ears[robot].waiting.pop_front() {
                self.command(robot, twist, stamp);
            }
        }
    }

    fn command(&mut self, robot: usize, twist: [f64; 3], stamp: Option<f64>) {
        if let Err(problem) = self.simulator.command(robot, twist, stamp) {
            self.complain("cmd_vel", &problem);
        }
    }

    /// Tells what was refused, a few times.
    fn complain(&mut self, what: &'static str, problem: &str) {
        let count = self.complaints.entry(what).or_default();
        *count += 1;
        if *count <= COMPLAINTS_MAX {
            let more = match *count == COMPLAINTS_MAX {
                true => "; no more of these are told",
                false => "",
            };
            eprintln!("{what}: refused: {problem}{more}");
        }
    }

    /// Does what has come.
    fn listen(&mut self) {
        for robot in 0..self.ears.len() {
            for _ in 0..LOOK_MAX {
                match self.ears[robot].twist.take() {
                    Ok(None) => break,
                    Ok(Some((twist, from))) if self.writers.writes(&from, kind::TWIST) => {
                        self.hear(robot, twist_of(&twist), None);
                    }
                    Ok(Some(_)) => {}
                    Err(problem) => self.complain("cmd_vel", &format!("{problem:?}")),
                }
            }
            for _ in 0..LOOK_MAX {
                match self.ears[robot].stamped.take() {
                    Ok(None) => break,
                    Ok(Some((m, from))) if self.writers.writes(&from, kind::TWIST_STAMPED) => {
                        self.hear(robot, twist_of(&m.twist), Some(m.header.stamp.seconds()));
                    }
                    // A plain twist is too short for one with a stamp, and was heard above.
                    Ok(Some(_)) | Err(_) => {}
                }
            }
            for _ in 0..LOOK_MAX {
                match self.ears[robot].joints.take() {
                    Ok(None) => break,
                    Ok(Some((_, from))) if !self.writers.writes(&from, kind::JOINT_STATE) => {}
                    Ok(Some((joints, _))) => {
                        let told = self.simulator.turn(robot, &joints.name, &joints.velocity);
                        if let Err(problem) = told {
                            self.complain("joint_command", &problem);
                        }
                    }
                    Err(problem) => self.complain("joint_command", &format!("{problem:?}")),
                }
            }
            for _ in 0..LOOK_MAX {
                match self.ears[robot].swap.take() {
                    Ok(None) => break,
                    Ok(Some((_, from))) if !self.writers.writes(&from, WORDS) => {}
                    Ok(Some((to, _))) => {
                        if let Err(problem) = self.simulator.swap(robot, &to.data) {
                            self.complain("controller", &problem);
                        }
                    }
                    Err(problem) => self.complain("controller", &format!("{problem:?}")),
                }
            }
            while let Some((asker, request)) = self.ears[robot].set_pose.asked() {
                let pose = planar(&request.pose.pose);
                if let Err(problem) = self.simulator.place(robot, pose) {
                    self.complain("set_pose", &problem);
                }
                self.ears[robot].set_pose.answer(&asker, Nothing::default());
            }
            while let Some((asker, request)) = self.ears[robot].switch.asked() {
                let switched = { request.to() }.and_then(|to| self.simulator.swap(robot, to));
                self.ears[robot].switch.answer(&asker, switched.into());
            }
        }
        while let Some((asker, _)) = self.reset.asked() {
            if let Err(problem) = self.simulator.reset() {
                self.complain("reset", &problem);
            }
            for ears in &mut self.ears {
                ears.waiting.clear();
            }
            self.reset.answer(&asker, Nothing::default());
        }
        while let Some((asker, request)) = self.pause.asked() {
            self.is_paused = request.data;
            self.pause.answer(&asker, Ok(()).into());
        }
        while let Some((asker, _)) = self.step.asked() {
            let result = match self.is_paused {
                true => {
                    self.steps += 1;
                    Ok(())
                }
                false => Err("must be paused to be stepped".to_owned()),
            };
            self.step.answer(&asker, result.into());
        }
    }

    fn hear(&mut self, robot: usize, twist: [f64; 3], stamp: Option<f64>) {
        match self.options.lock_step {
            true => self.ears[robot].waiting.push_back((twist, stamp)),
            false => self.command(robot, twist, stamp),
        }
    }
}

/// Open sockets of this process, by descriptor.
#[cfg(target_os = "linux")]
fn sockets() -> Vec<i32> {
    let entries = std::fs::read_dir("/proc/self/fd");
    let entries = entries.into_iter().flatten().flatten();
    let socket = |entry: std::fs::DirEntry| {
        let target = std::fs::read_link(entry.path()).ok()?;
        target.to_str()?.starts_with("socket:").then_some(())?;
        entry.file_name().to_str()?.parse().ok()
    };
    entries.filter_map(socket).collect()
}

/// Binds the sockets that were opened since to the loopback interface: the library advertises loopback alone, but
/// listens at every address.
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
fn confine(before: &[i32]) -> Result<(), String> {
    use std::os::fd::BorrowedFd;
    for descriptor in sockets().into_iter().filter(|one| !before.contains(one)) {
        // SAFETY: the descriptor is open: it was listed just now, and the participant that owns it lives on in
        // the caller. It is borrowed for this call alone.
        let borrowed = unsafe { BorrowedFd::borrow_raw(descriptor) };
        let socket = socket2::SockRef::from(&borrowed);
        if socket
            .domain()
            .is_ok_and(|domain| domain == socket2::Domain::UNIX)
        {
            continue;
        }
        socket
            .bind_device(Some(b"lo"))
            .map_err(|error| format!("the node cannot be kept to this machine: {error}"))?;
    }
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn sockets() -> Vec<i32> {
    Vec::new()
}

#[cfg(not(target_os = "linux"))]
fn confine(_before: &[i32]) -> Result<(), String> {
    Err(
        "--network: must be given on this system, where the node cannot be kept to this machine: it listens at \
         every address\n  hint: --network 127.0.0.1 announces it on this machine alone; a firewall has to do the rest"
            .to_owned(),
    )
}
