//! A node of ROS 2 over Zenoh, as rmw_zenoh does it: a topic is a key made of domain, name, type and the type's hash;
//! a message carries its number, its time and whose it is beside it; and tokens tell who is there. Topics alone:
//! there are no services.

use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::SystemTime;

use appell_sim::ros::Service as Quality;
use appell_sim::ros::message::{Message, Twist, TwistStamped, from_cdr, kind};
use sha2::{Digest, Sha256};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::{Config, Session, Wait};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, CacheConfig};

use crate::foxglove::View;
use crate::paced::{self, Heard, WAITING_MAX};
use crate::simulator::{Simulator, offered, placed};
use crate::type_hash::type_hash;

/// Longest message that is taken, bytes.
const SIZE_MAX: usize = 1 << 16;

/// Who a node is.
pub struct Identity<'a> {
    /// Domain, as ROS_DOMAIN_ID.
    pub domain: u16,
    /// Namespace before all relative names; empty for none.
    pub namespace: &'a str,
    /// Name of the node.
    pub name: &'a str,
}

/// A topic that is offered.
struct Offered {
    publisher: AdvancedPublisher<'static>,
    /// Whose messages they are, and how many there were.
    gid: [u8; 16],
    count: i64,
    _token: LivelinessToken,
}

/// A node.
pub struct Node {
    offered: Vec<Offered>,
    commands: Receiver<Heard>,
    _heard: Vec<(Subscriber<()>, LivelinessToken)>,
    _token: LivelinessToken,
    _session: Session,
}

fn told(error: zenoh::Error) -> String {
    format!("--zenoh: {error}")
}

/// A name within a token, which has no empty parts.
fn mangled(name: &str) -> String {
    match name {
        "" => "%".to_owned(),
        name => name.replace('/', "%"),
    }
}

/// `nav_msgs/msg/Odometry` as `nav_msgs::msg::dds_::Odometry_`.
fn dds_type(kind: &str) -> String {
    format!("{}_", kind.replace("/msg/", "::msg::dds_::"))
}

/// What a token says of quality: reliability, durability, and depth, where they are not the usual.
fn quality(quality: Quality) -> &'static str {
    match quality {
        Quality::Reliable => "::,10:,:,:,,",
        Quality::Sensor => "2::,5:,:,:,,",
        Quality::Kept => ":1:,1:,:,:,,",
        Quality::Clock => "2::,1:,:,:,,",
    }
}

fn twist(bytes: &[u8]) -> Result<([f64; 3], Option<f64>), String> {
    let twist: Twist = from_cdr(bytes)?;
    Ok(([twist.linear.x, twist.linear.y, twist.angular.z], None))
}

fn stamped(bytes: &[u8]) -> Result<([f64; 3], Option<f64>), String> {
    let TwistStamped { header, twist } = from_cdr(bytes)?;
    let parts = [twist.linear.x, twist.linear.y, twist.angular.z];
    Ok((parts, Some(header.stamp.seconds())))
}

impl Node {
    /// Opens a node for a simulation, by the router at `endpoint`, such as `tcp/127.0.0.1:7447`; it is tried again
    /// until it is there. The node itself listens on the loopback interface alone.
    ///
    /// # Errors
    /// The endpoint is none, a name is none, or no port is free.
    pub fn open(
        endpoint: &str,
        identity: &Identity,
        simulator: &Simulator,
    ) -> Result<Node, String> {
        let mut config = Config::default();
        let endpoint = serde_json::Value::from(endpoint).to_string();
        for (key, value) in [
            ("mode", "\"peer\""),
            ("connect/endpoints", &format!("[{endpoint}]")),
            ("listen/endpoints", "[\"tcp/127.0.0.1:0\"]"),
            ("scouting/multicast/enabled", "false"),
            // What is kept is asked for by time.
            ("timestamping/enabled", "true"),
        ] {
            config.insert_json5(key, value).map_err(told)?;
        }
        let session = zenoh::open(config).wait().map_err(told)?;
        let space = match identity.namespace.trim_matches('/') {
            "" => String::new(),
            words => format!("/{words}"),
        };
        let zid = session.zid();
        let domain = identity.domain;
        let mut entities = 0;
        // Who is there: the node, or what it has.
        let mut token = |what: &str, entity: &str| -> Result<(LivelinessToken, [u8; 16]), String> {
            let id = entities;
            entities += 1;
            let key = format!(
                "@ros2_lv/{domain}/{zid}/0/{id}/{what}/%/{}/{}{entity}",
                mangled(&space),
                identity.name
            );
            let declared = session.liveliness().declare_token(key.clone()).wait();
            let digest = Sha256::digest(key.as_bytes());
            let gid = digest[..16].try_into().expect("sixteen bytes");
            Ok((declared.map_err(told)?, gid))
        };
        let (node, _) = token("NN", "")?;
        let full = |name: &str| placed(name, identity.namespace);
        let key = |name: &str, kind: &str| {
            let name = name.trim_start_matches('/');
            format!("{domain}/{name}/{}/{}", dds_type(kind), type_hash(kind))
        };
        let entity = |name: &str, kind: &str, quality: &str| {
            let (name, hash) = (mangled(name), type_hash(kind));
            format!("/{name}/{}/{hash}/{quality}", dds_type(kind))
        };
        let mut all = Vec::new();
        for topic in simulator.topics() {
            let name = full(&offered(topic));
            let publisher = session.declare_publisher(key(&name, topic.kind)).advanced();
            let publisher = match topic.service {
                Quality::Kept => publisher
                    .cache(CacheConfig::default().max_samples(1))
                    .publisher_detection(),
                _ => publisher,
            };
            let (token, gid) = token("MP", &entity(&name, topic.kind, quality(topic.service)))?;
            all.push(Offered {
                publisher: publisher.wait().map_err(told)?,
                gid,
                count: 0,
                _token: token,
            });
        }
        let (send, commands) = sync_channel(WAITING_MAX);
        let alone = simulator.robots().count() == 1;
        let mut heard = Vec::new();
        for (robot, name) in simulator.robots().enumerate() {
            let topic = match alone {
                true => full("/cmd_vel"),
                false => full(&format!("/{name}/cmd_vel")),
            };
            for (kind, read) in [
                (kind::TWIST, twist as fn(&[u8]) -> _),
                (kind::TWIST_STAMPED, stamped),
            ] {
                let send: SyncSender<Heard> = send.clone();
                let subscriber = session
                    .declare_subscriber(key(&topic, kind))
                    .callback(move |sample| {
                        let payload = sample.payload();
                        let command = match payload.len() {
                            0..=SIZE_MAX => read(&payload.to_bytes()),
                            length => {
                                Err(format!("must be at most {SIZE_MAX} bytes, got {length}"))
                            }
                        };
                        // Who floods loses commands, and holds nobody up.
                        let _ = send.try_send((robot, command));
                    })
                    .wait()
                    .map_err(told)?;
                let (token, _) = token("MS", &entity(&topic, kind, "::,10:,:,:,,"))?;
                heard.push((subscriber, token));
            }
        }
        Ok(Node {
            offered: all,
            commands,
            _heard: heard,
            _token: node,
            _session: session,
        })
    }

    /// Lets the simulation run at a pace, until `duration` or until it is told to stop.
    ///
    /// # Errors
    /// The run has ended before, for the reason that is given.
    pub fn run(
        &mut self,
        simulator: &mut Simulator,
        pace: (f64, f64),
        view: Option<&View>,
        stop: &AtomicBool,
    ) -> Result<(), String> {
        let Node {
            offered, commands, ..
        } = self;
        paced::run(simulator, pace, commands, view, stop, &mut |said| {
            for (topic, message) in said {
                offered[*topic].say(message);
            }
        })
    }
}

impl Offered {
    fn say(&mut self, message: &Message) {
        self.count += 1;
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let now = since.map_or(0, |since| since.as_nanos() as i64);
        let mut beside = self.count.to_le_bytes().to_vec();
        beside.extend(now.to_le_bytes());
        // An array stands behind its length.
        beside.push(self.gid.len() as u8);
        beside.extend(self.gid);
        let put = self.publisher.put(message.to_cdr()).attachment(beside);
        // Who cannot be reached hears nothing.
        let _ = put.wait();
    }
}
