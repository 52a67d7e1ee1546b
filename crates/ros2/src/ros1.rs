//! A node of ROS 1: registered with a master by XML-RPC, messages over TCPROS. A small part of both, which is what
//! drives a robot by `rostopic pub` and shows it to `rostopic echo`, rviz and rosbag.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use appell_sim::ros::message::{
    Header, Message, PoseWithCovariance, Quaternion, Time, TwistWithCovariance, Vector3, kind,
};
use roxmltree::{Document, Node as Element};

use crate::foxglove::View;
use crate::paced::{self, Heard, WAITING_MAX};
use crate::simulator::{Simulator, offered};

/// Longest request, header or message that is taken, bytes.
const SIZE_MAX: usize = 1 << 20;
/// How long others may be silent while they are asked.
const PATIENCE: Duration = Duration::from_secs(5);
/// Most connections at a time.
const CONNECTIONS_MAX: usize = 64;

/// Type and checksum in ROS 1, by the name in ROS 2; those that have one.
const TYPES: [(&str, &str, &str); 7] = [
    (
        kind::TWIST,
        "geometry_msgs/Twist",
        "9f195f881246fdfa2798d1d3eebca84a",
    ),
    (
        kind::TWIST_STAMPED,
        "geometry_msgs/TwistStamped",
        "98d34b0043a2093cf9d9345ab6eef12e",
    ),
    (
        kind::ODOMETRY,
        "nav_msgs/Odometry",
        "cd5e73d190d741a2f92e81eda573aca7",
    ),
    (
        kind::TRANSFORMS,
        "tf2_msgs/TFMessage",
        "94810edda583a504dfda3829e70d7eec",
    ),
    (
        kind::JOINT_STATE,
        "sensor_msgs/JointState",
        "3066dcd76a6cfaef579bd0f34173e9fd",
    ),
    (
        kind::IMU,
        "sensor_msgs/Imu",
        "6a62c6daae103f4ff57a132d6f95cec2",
    ),
    (
        kind::CLOCK,
        "rosgraph_msgs/Clock",
        "a9c97c1d230cfc112e270351a944ee47",
    ),
];

fn known(kind: &str) -> Option<(&'static str, &'static str)> {
    let found = TYPES.iter().find(|(known, ..)| *known == kind);
    found.map(|(_, name, sum)| (*name, *sum))
}

/// A value of XML-RPC.
#[derive(Clone, Debug, PartialEq)]
enum Value {
    Int(i64),
    Text(String),
    List(Vec<Value>),
}

impl Value {
    fn text(text: &str) -> Value {
        Value::Text(text.to_owned())
    }

    fn write(&self, to: &mut String) {
        to.push_str("<value>");
        match self {
            Value::Int(value) => to.push_str(&format!("<int>{value}</int>")),
            Value::Text(text) => {
                let text = text.replace('&', "&amp;").replace('<', "&lt;");
                to.push_str(&format!("<string>{text}</string>"));
            }
            Value::List(values) => {
                to.push_str("<array><data>");
                values.iter().for_each(|value| value.write(to));
                to.push_str("</data></array>");
            }
        }
        to.push_str("</value>");
    }

    fn read(value: Element<'_, '_>) -> Value {
        let Some(inner) = value.children().find(Element::is_element) else {
            return Value::text(value.text().unwrap_or_default());
        };
        let words = inner.text().unwrap_or_default();
        match inner.tag_name().name() {
            "int" | "i4" | "boolean" => Value::Int(words.trim().parse().unwrap_or(0)),
            "array" => {
                let data = inner.children().find(|node| node.has_tag_name("data"));
                let values = data.into_iter().flat_map(|data| data.children());
                let values = values.filter(|node| node.has_tag_name("value"));
                Value::List(values.map(Value::read).collect())
            }
            _ => Value::text(words),
        }
    }

    fn as_text(&self) -> &str {
        match self {
            Value::Text(text) => text,
            _ => "",
        }
    }

    fn as_list(&self) -> &[Value] {
        match self {
            Value::List(values) => values,
            _ => &[],
        }
    }
}

/// Parameters of a call or an answer.
fn parameters(text: &str) -> Option<(String, Vec<Value>)> {
    let document = Document::parse(text).ok()?;
    let root = document.root_element();
    let method = root.children().find(|node| node.has_tag_name("methodName"));
    let method = method.and_then(|node| node.text()).unwrap_or_default();
    let params = root.children().find(|node| node.has_tag_name("params"))?;
    let values = params
        .children()
        .filter(|node| node.has_tag_name("param"))
        .filter_map(|param| {
            let value = param.children().find(|node| node.has_tag_name("value"))?;
            Some(Value::read(value))
        });
    Some((method.trim().to_owned(), values.collect()))
}

/// Reads an HTTP message's body.
fn body(stream: &mut TcpStream) -> Option<String> {
    let mut bytes = Vec::new();
    let mut byte = [0];
    while !bytes.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte).ok()?;
        bytes.push(byte[0]);
        if bytes.len() > 1 << 16 {
            return None;
        }
    }
    let head = String::from_utf8_lossy(&bytes).to_ascii_lowercase();
    let length = head
        .lines()
        .find_map(|line| line.strip_prefix("content-length:"));
    let length: usize = length?
        .trim()
        .parse()
        .ok()
        .filter(|length| *length <= SIZE_MAX)?;
    if head.contains("expect: 100-continue") {
        stream.write_all(b"HTTP/1.1 100 Continue\r\n\r\n").ok()?;
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body).ok()?;
    String::from_utf8(body).ok()
}

fn connect(place: &str) -> std::io::Result<TcpStream> {
    let mut last = std::io::Error::other("has no address");
    for address in place.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => {
                stream.set_read_timeout(Some(PATIENCE))?;
                stream.set_write_timeout(Some(PATIENCE))?;
                stream.set_nodelay(true)?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Calls a method at an address such as `http://localhost:11311/`; what is answered after code and message.
fn call(uri: &str, method: &str, arguments: &[Value]) -> Result<Value, String> {
    let place = uri.trim_start_matches("http://").trim_end_matches('/');
    let told = |problem: &dyn std::fmt::Display| format!("{uri}: {method}: {problem}");
    let mut text =
        format!("<?xml version=\"1.0\"?><methodCall><methodName>{method}</methodName><params>");
    for argument in arguments {
        text.push_str("<param>");
        argument.write(&mut text);
        text.push_str("</param>");
    }
    text.push_str("</params></methodCall>");
    let mut stream = connect(place).map_err(|error| told(&error))?;
    let request = format!(
        "POST /RPC2 HTTP/1.1\r\nHost: {place}\r\nContent-Type: text/xml\r\nContent-Length: {}\r\nConnection: \
         close\r\n\r\n{text}",
        text.len()
    );
    stream
        .write_all(request.as_bytes())
        .map_err(|error| told(&error))?;
    let answer = body(&mut stream).ok_or_else(|| told(&"gives no answer"))?;
    let (_, values) = parameters(&answer).ok_or_else(|| told(&"answers what is no XML-RPC"))?;
    match values.first().map(Value::as_list) {
        Some([Value::Int(1), _, value]) => Ok(value.clone()),
        Some([_, problem, ..]) => Err(told(&problem.as_text())),
        _ => Err(told(&"answers otherwise than ROS does")),
    }
}

/// A block with its length before it.
fn block(stream: &mut TcpStream) -> Option<Vec<u8>> {
    let mut length = [0; 4];
    stream.read_exact(&mut length).ok()?;
    let length = u32::from_le_bytes(length) as usize;
    if length > SIZE_MAX {
        return None;
    }
    let mut bytes = vec![0; length];
    stream.read_exact(&mut bytes).ok()?;
    Some(bytes)
}

/// The fields of a connection's header.
fn fields(bytes: &[u8]) -> Option<BTreeMap<String, String>> {
    let mut fields = BTreeMap::new();
    let mut rest = bytes;
    while !rest.is_empty() {
        let (length, more) = rest.split_first_chunk::<4>()?;
        let (field, more) = more.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        let (key, value) = std::str::from_utf8(field).ok()?.split_once('=')?;
        fields.insert(key.to_owned(), value.to_owned());
        rest = more;
    }
    Some(fields)
}

fn header_of(fields: &[(&str, &str)]) -> Vec<u8> {
    let mut inner = Vec::new();
    for (key, value) in fields {
        inner.extend(((key.len() + value.len() + 1) as u32).to_le_bytes());
        inner.extend(format!("{key}={value}").bytes());
    }
    let mut bytes = (inner.len() as u32).to_le_bytes().to_vec();
    bytes.extend(inner);
    bytes
}

/// The wire of ROS 1: CDR's fields without its gaps, texts without their zero, headers with a count.
#[derive(Default)]
struct Wire(Vec<u8>);

impl Wire {
    fn u32(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }
    fn f64s<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        values
            .into_iter()
            .for_each(|value| self.0.extend(value.to_le_bytes()));
    }
    fn list(&mut self, values: &[f64]) {
        self.u32(values.len() as u32);
        self.f64s(values);
    }
    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32);
        self.0.extend(text.bytes());
    }
    fn time(&mut self, time: Time) {
        self.u32(time.sec as u32);
        self.u32(time.nanosec);
    }
    fn header(&mut self, header: &Header, count: u32) {
        self.u32(count);
        self.time(header.stamp);
        self.text(&header.frame_id);
    }
    fn vector(&mut self, v: Vector3) {
        self.f64s(&[v.x, v.y, v.z]);
    }
    fn turn(&mut self, q: Quaternion) {
        self.f64s(&[q.x, q.y, q.z, q.w]);
    }
    fn pose(&mut self, p: &PoseWithCovariance) {
        self.vector(p.pose.position);
        self.turn(p.pose.orientation);
        self.f64s(p.covariance.iter().flatten());
    }
    fn twist(&mut self, t: &TwistWithCovariance) {
        self.vector(t.twist.linear);
        self.vector(t.twist.angular);
        self.f64s(t.covariance.iter().flatten());
    }
}

/// A message on the wire, with its length before it.
fn wired(message: &Message, count: u32) -> Vec<u8> {
    let mut wire = Wire::default();
    match message {
        Message::Clock(clock) => wire.time(clock.clock),
        Message::Odometry(odometry) => {
            wire.header(&odometry.header, count);
            wire.text(&odometry.child_frame_id);
            wire.pose(&odometry.pose);
            wire.twist(&odometry.twist);
        }
        Message::Transforms(transforms) => {
            wire.u32(transforms.transforms.len() as u32);
            for one in &transforms.transforms {
                wire.header(&one.header, count);
                wire.text(&one.child_frame_id);
                wire.vector(one.transform.translation);
                wire.turn(one.transform.rotation);
            }
        }
        Message::JointState(joints) => {
            wire.header(&joints.header, count);
            wire.u32(joints.name.len() as u32);
            joints.name.iter().for_each(|name| wire.text(name));
            wire.list(&joints.position);
            wire.list(&joints.velocity);
            wire.list(&joints.effort);
        }
        Message::Imu(imu) => {
            wire.header(&imu.header, count);
            wire.turn(imu.orientation);
            wire.f64s(&imu.orientation_covariance);
            wire.vector(imu.angular_velocity);
            wire.f64s(&imu.angular_velocity_covariance);
            wire.vector(imu.linear_acceleration);
            wire.f64s(&imu.linear_acceleration_covariance);
        }
        Message::Twist(twist) => {
            wire.vector(twist.linear);
            wire.vector(twist.angular);
        }
        Message::TwistStamped(stamped) => {
            wire.header(&stamped.header, count);
            wire.vector(stamped.twist.linear);
            wire.vector(stamped.twist.angular);
        }
        // It has a type of its own in ROS 1, which is not offered.
        Message::Detections(_) => {}
    }
    let mut bytes = (wire.0.len() as u32).to_le_bytes().to_vec();
    bytes.extend(wire.0);
    bytes
}

/// Forward, left and yaw rate of geometry_msgs/Twist on the wire.
fn twist_of(bytes: &[u8]) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> = bytes
        .chunks_exact(8)
        .map(|chunk| f64::from_le_bytes(chunk.try_into().expect("eight bytes")))
        .collect();
    match (bytes.len(), numbers.as_slice()) {
        (48, [x, y, _, _, _, turn]) => Ok([*x, *y, *turn]),
        (length, _) => Err(format!("a twist must be 48 bytes, got {length}")),
    }
}

/// A topic that is offered.
struct Offered {
    name: String,
    kind: &'static str,
    sum: &'static str,
    /// Who listens, and what was said last where that is kept.
    listeners: Vec<SyncSender<Arc<Vec<u8>>>>,
    kept: Option<Arc<Vec<u8>>>,
    is_kept: bool,
}

/// What the threads of a node share.
struct Shared {
    id: String,
    api: String,
    host: String,
    port: u16,
    offered: Mutex<Vec<Offered>>,
    /// Topics that are heard, the robot of each, and the publishers it is connected to.
    heard: Mutex<Vec<(String, usize, Vec<String>)>>,
    commands: Mutex<SyncSender<Heard>>,
    connections: Mutex<usize>,
}

/// A node of ROS 1.
pub struct Node {
    shared: Arc<Shared>,
    master: String,
    commands: Receiver<Heard>,
}

impl Node {
    /// Registers a node for a simulation with the master. Others reach it at `host`, which is the only address
    /// at which it listens.
    ///
    /// # Errors
    /// The master cannot be reached or refuses, or no port is free.
    pub fn open(
        master: &str,
        host: &str,
        name: &str,
        simulator: &Simulator,
    ) -> Result<Node, String> {
        let listen = |what: &str| {
            TcpListener::bind((host, 0)).map_err(|error| format!("{host}: {what}: {error}"))
        };
        let (calls, data) = (listen("XML-RPC")?, listen("TCPROS")?);
        let port = |listener: &TcpListener| {
            listener
                .local_addr()
                .map(|address| address.port())
                .map_err(|error| error.to_string())
        };
        let (send, commands) = sync_channel(WAITING_MAX);
        let offers = simulator.topics().iter().map(|topic| {
            let (kind, sum) = known(topic.kind).unwrap_or(("", ""));
            Offered {
                is_kept: topic.service == appell_sim::ros::Service::Kept,
                name: offered(topic),
                kind,
                sum,
                listeners: Vec::new(),
                kept: None,
            }
        });
        let alone = simulator.robots().count() == 1;
        let heard = simulator.robots().enumerate().map(|(robot, name)| {
            let topic = if alone {
                "/cmd_vel".to_owned()
            } else {
                format!("/{name}/cmd_vel")
            };
            (topic, robot, Vec::new())
        });
        let shared = Arc::new(Shared {
            id: format!("/{name}"),
            api: format!("http://{host}:{}/", port(&calls)?),
            host: host.to_owned(),
            port: port(&data)?,
            offered: Mutex::new(offers.collect()),
            heard: Mutex::new(heard.collect()),
            commands: Mutex::new(send),
            connections: Mutex::new(0),
        });
        let own = shared.clone();
        std::thread::spawn(move || accept(&calls, &own, answer));
        let own = shared.clone();
        std::thread::spawn(move || accept(&data, &own, publish));
        let node = Node {
            shared,
            master: master.to_owned(),
            commands,
        };
        for (topic, kind) in node.offers() {
            node.ask("registerPublisher", &topic, &[Value::text(&kind)])?;
        }
        for topic in node.hears() {
            let twist = [Value::text("geometry_msgs/Twist")];
            let publishers = node.ask("registerSubscriber", &topic, &twist)?;
            update(&node.shared, &topic, publishers.as_list());
        }
        Ok(node)
    }

    fn offers(&self) -> Vec<(String, String)> {
        let offered = self.shared.offered.lock().expect("nothing panics with it");
        let known = offered.iter().filter(|topic| !topic.kind.is_empty());
        known
            .map(|topic| (topic.name.clone(), topic.kind.to_owned()))
            .collect()
    }

    fn hears(&self) -> Vec<String> {
        let heard = self.shared.heard.lock().expect("nothing panics with it");
        heard.iter().map(|(topic, ..)| topic.clone()).collect()
    }

    fn ask(&self, method: &str, topic: &str, more: &[Value]) -> Result<Value, String> {
        let mut arguments = vec![Value::text(&self.shared.id), Value::text(topic)];
        arguments.extend_from_slice(more);
        arguments.push(Value::text(&self.shared.api));
        call(&self.master, method, &arguments)
    }

    /// Lets the simulation run at a pace, until `duration` or until it is told to stop; who looks on sees all of it.
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
            shared, commands, ..
        } = self;
        let mut count = 0_u32;
        paced::run(simulator, pace, commands, view, stop, &mut |said| {
            let mut offered = shared.offered.lock().expect("nothing panics with it");
            for (topic, message) in said {
                let topic = &mut offered[*topic];
                if topic.kind.is_empty() || (topic.listeners.is_empty() && !topic.is_kept) {
                    continue;
                }
                let bytes = Arc::new(wired(message, count));
                // Who does not keep up loses messages, and holds nobody up.
                let keeps = |listener: &SyncSender<_>| {
                    let sent = listener.try_send(Arc::clone(&bytes));
                    !matches!(sent, Err(TrySendError::Disconnected(_)))
                };
                topic.listeners.retain(keeps);
                if topic.is_kept {
                    topic.kept = Some(bytes);
                }
            }
            count = count.wrapping_add(1);
        })
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        // A master that has gone needs no farewell.
        for (topic, _) in self.offers() {
            let _ = self.ask("unregisterPublisher", &topic, &[]);
        }
        for topic in self.hears() {
            let _ = self.ask("unregisterSubscriber", &topic, &[]);
        }
    }
}

/// Serves connections, each in a thread, and not too many.
fn accept(listener: &TcpListener, shared: &Arc<Shared>, serve: fn(&Arc<Shared>, TcpStream)) {
    for stream in listener.incoming().flatten() {
        let mut connections = shared.connections.lock().expect("nothing panics with it");
        if *connections >= CONNECTIONS_MAX {
            continue;
        }
        *connections += 1;
        drop(connections);
        let shared = shared.clone();
        std::thread::spawn(move || {
            let limited = stream.set_read_timeout(Some(PATIENCE));
            if limited
                .and_then(|()| stream.set_write_timeout(Some(PATIENCE)))
                .is_ok()
            {
                serve(&shared, stream);
            }
            *shared.connections.lock().expect("nothing panics with it") -= 1;
        });
    }
}

/// Answers a call.
fn answer(shared: &Arc<Shared>, mut stream: TcpStream) {
    let Some(text) = body(&mut stream) else {
        return;
    };
    let Some((method, arguments)) = parameters(&text) else {
        return;
    };
    let topic = arguments.get(1).map(Value::as_text).unwrap_or_default();
    let value = match method.as_str() {
        "publisherUpdate" => {
            let publishers = arguments.get(2).map(Value::as_list).unwrap_or_default();
            update(shared, topic, publishers);
            Some(Value::Int(0))
        }
        "requestTopic" => {
            let offered = shared.offered.lock().expect("nothing panics with it");
            let is_offered = offered
                .iter()
                .any(|one| one.name == topic && !one.kind.is_empty());
            is_offered.then(|| {
                let port = i64::from(shared.port);
                Value::List(vec![
                    Value::text("TCPROS"),
                    Value::text(&shared.host),
                    Value::Int(port),
                ])
            })
        }
        "getPid" => Some(Value::Int(i64::from(std::process::id()))),
        "getBusStats" | "getBusInfo" => Some(Value::List(Vec::new())),
        "getMasterUri" => Some(Value::text("")),
        "getSubscriptions" => {
            let heard = shared.heard.lock().expect("nothing panics with it");
            let pair = |topic: &String| {
                Value::List(vec![Value::text(topic), Value::text("geometry_msgs/Twist")])
            };
            Some(Value::List(
                heard.iter().map(|(topic, ..)| pair(topic)).collect(),
            ))
        }
        "getPublications" => {
            let offered = shared.offered.lock().expect("nothing panics with it");
            let pair =
                |one: &Offered| Value::List(vec![Value::text(&one.name), Value::text(one.kind)]);
            Some(Value::List(offered.iter().map(pair).collect()))
        }
        "paramUpdate" | "shutdown" => Some(Value::Int(0)),
        _ => None,
    };
    let answer = match value {
        Some(value) => Value::List(vec![Value::Int(1), Value::text(""), value]),
        None => Value::List(vec![
            Value::Int(-1),
            Value::text("is not known here"),
            Value::Int(0),
        ]),
    };
    let mut text = "<?xml version=\"1.0\"?><methodResponse><params><param>".to_owned();
    answer.write(&mut text);
    text.push_str("</param></params></methodResponse>");
    let head = "HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nConnection: close";
    let _ = write!(
        stream,
        "{head}\r\nContent-Length: {}\r\n\r\n{text}",
        text.len()
    );
}

/// Sends a topic's messages to one who listens.
fn publish(shared: &Arc<Shared>, mut stream: TcpStream) {
    let asked = block(&mut stream)
        .and_then(|bytes| fields(&bytes))
        .unwrap_or_default();
    let of = |key: &str| asked.get(key).map_or("", String::as_str);
    let (send, said) = sync_channel(WAITING_MAX);
    let found = {
        let mut offered = shared.offered.lock().expect("nothing panics with it");
        let found = offered
            .iter_mut()
            .find(|one| one.name == of("topic") && !one.kind.is_empty());
        found
            .filter(|one| [one.sum, "*"].contains(&of("md5sum")))
            .map(|one| {
                one.kept
                    .iter()
                    .for_each(|kept| drop(send.try_send(kept.clone())));
                one.listeners.push(send);
                (one.kind, one.sum, one.is_kept)
            })
    };
    let Some((kind, sum, is_kept)) = found else {
        let _ = stream.write_all(&header_of(&[("error", "no such topic of that type here")]));
        return;
    };
    let latching = if is_kept { "1" } else { "0" };
    let greeting = header_of(&[
        ("callerid", &shared.id),
        ("latching", latching),
        ("md5sum", sum),
        ("topic", of("topic")),
        ("type", kind),
    ]);
    if stream.write_all(&greeting).is_err() || stream.set_nodelay(true).is_err() {
        return;
    }
    while let Ok(bytes) = said.recv() {
        if stream.write_all(&bytes).is_err() {
            return;
        }
    }
}

/// Connects to publishers of a topic that are new.
fn update(shared: &Arc<Shared>, topic: &str, publishers: &[Value]) {
    let mut heard = shared.heard.lock().expect("nothing panics with it");
    let Some((_, robot, connected)) = heard.iter_mut().find(|(known, ..)| known == topic) else {
        return;
    };
    for publisher in publishers.iter().map(Value::as_text) {
        if connected.iter().any(|known| known == publisher) || connected.len() >= CONNECTIONS_MAX {
            continue;
        }
        connected.push(publisher.to_owned());
        let (shared, topic, publisher) = (shared.clone(), topic.to_owned(), publisher.to_owned());
        let robot = *robot;
        std::thread::spawn(move || {
            let send = shared
                .commands
                .lock()
                .expect("nothing panics with it")
                .clone();
            if let Err(problem) = listen(&shared, &topic, &publisher, robot, &send) {
                let _ = send.send((robot, Err(problem)));
            }
            let mut heard = shared.heard.lock().expect("nothing panics with it");
            if let Some((.., connected)) = heard.iter_mut().find(|(known, ..)| *known == topic) {
                connected.retain(|known| *known != publisher);
            }
        });
    }
}

/// Hears a publisher's messages until it goes.
fn listen(
    shared: &Shared,
    topic: &str,
    publisher: &str,
    robot: usize,
    send: &SyncSender<Heard>,
) -> Result<(), String> {
    let protocols = Value::List(vec![Value::List(vec![Value::text("TCPROS")])]);
    let arguments = [Value::text(&shared.id), Value::text(topic), protocols];
    let place = call(publisher, "requestTopic", &arguments)?;
    let [_, host, Value::Int(port)] = place.as_list() else {
        return Err(format!("{publisher}: offers no TCPROS"));
    };
    let told = |error: std::io::Error| format!("{publisher}: {error}");
    let mut stream = connect(&format!("{}:{port}", host.as_text())).map_err(told)?;
    let (kind, sum) = known(kind::TWIST).expect("a type of ROS 1");
    let greeting = header_of(&[
        ("callerid", &shared.id),
        ("topic", topic),
        ("type", kind),
        ("md5sum", sum),
        ("tcp_nodelay", "1"),
    ]);
    stream.write_all(&greeting).map_err(told)?;
    let answered = block(&mut stream).and_then(|bytes| fields(&bytes));
    let answered = answered.ok_or_else(|| format!("{publisher}: answers no header"))?;
    if let Some(error) = answered.get("error") {
        return Err(format!("{publisher}: {error}"));
    }
    if answered.get("md5sum").is_none_or(|theirs| theirs != sum) {
        return Err(format!("{publisher}: {topic}: must be {kind}"));
    }
    // It may be silent for as long as it likes.
    stream.set_read_timeout(None).map_err(told)?;
    while let Some(bytes) = block(&mut stream) {
        if send
            .send((robot, twist_of(&bytes).map(|twist| (twist, None))))
            .is_err()
        {
            break;
        }
    }
    Ok(())
}
