//! The node against an independent implementation of DDS in another process: the Python package cyclonedds, with
//! the names of ROS 2. Where it is not installed these tests say so, and are none.
#![cfg(unix)]

use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

const TESTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");

fn has_peer(test: &str) -> bool {
    let found = python().args(["-c", "import cyclonedds"]).output();
    let found = found.is_ok_and(|found| found.status.success());
    if !found {
        let told = format!("{test} tests nothing: Python lacks the module cyclonedds\n");
        // What is printed otherwise is not shown of a test that passes.
        std::io::stderr()
            .write_all(told.as_bytes())
            .expect("written");
    }
    found
}

fn python() -> Command {
    Command::new(std::env::var_os("APPELL_PYTHON").unwrap_or_else(|| "python3".into()))
}

/// A domain of its own for each test of each process, so that nobody else is met there.
fn domain(test: u32) -> String {
    (100 + (std::process::id() * 4 + test) % 120).to_string()
}

/// The node, which ends with the test, and of which one runs at a time: all are in a hurry.
struct Node {
    child: Child,
    _turn: std::sync::MutexGuard<'static, ()>,
}

static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());

impl Node {
    fn start(domain: &str, more: &[&str]) -> Node {
        Node::of("ros.toml", domain, more)
    }

    fn of(scenario: &str, domain: &str, more: &[&str]) -> Node {
        let turn = TURN
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        let scenario = format!("{}/../../scenarios/{scenario}", env!("CARGO_MANIFEST_DIR"));
        let child = Command::new(env!("CARGO_BIN_EXE_appell-ros"))
            .args([&scenario, "--domain", domain])
            .args(more)
            .stdout(Stdio::null())
            .spawn();
        Node {
            child: child.expect("the node starts"),
            _turn: turn,
        }
    }

    fn is_alive(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn peer(script: &str, arguments: &[&str]) -> Output {
    let output = python()
        .arg(Path::new(TESTS).join(script))
        .args(arguments)
        .output()
        .expect("Python");
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(output.status.success(), "{script}: {out}{err}");
    output
}

/// A minute of the simulation: commands in at 15 Hz, odometry out at 50 Hz without a loss.
#[test]
fn peer_the_circle_of_the_blog_over_dds() {
    if !has_peer("peer_the_circle_of_the_blog_over_dds") {
        return;
    }
    let domain = domain(0);
    let mut node = Node::start(&domain, &["--pace", "3", "--cmd-vel-timeout", "2.4"]);
    let output = peer("drive.py", &[&domain, "60", "2.4"]);
    assert!(node.is_alive());
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let stamps: Vec<i64> = { told["stamps"].as_array().expect("stamps").iter() }
        .map(|stamp| stamp.as_i64().expect("a time"))
        .collect();
    assert!(stamps.len() >= 2990, "{}", stamps.len());
    for pair in stamps.windows(2) {
        assert_eq!(pair[1] - pair[0], 20_000_000, "{pair:?}");
    }
    let number = |value: &Value| value.as_f64().expect("a number");
    for (wheel, rate) in [("left", 2.5), ("right", 7.5)] {
        for end in 0..2 {
            assert!(
                (number(&told[wheel][end]) - rate).abs() < 1e-9,
                "{wheel}: {}",
                told[wheel]
            );
        }
    }
    assert!(number(&told["spread"]) < 1e-6, "{}", told["spread"]);
    assert_eq!(number(&told["still"]), 0.0);
    let after = number(&told["stopped_after"]);
    assert!((2.2..2.7).contains(&after), "{after}");
    assert_eq!(told["frames"]["base_link"], "odom");
    assert_eq!(told["frames"]["left"], "base_link");
    assert_eq!(told["fixed"][0][0], "world");
    assert_eq!(number(&told["fixed"][0][2]), 2.0);
}

/// Two runs in lock-step with a controller in another process hear the same, bit for bit.
#[test]
fn invariant_lock_step_repeats() {
    if !has_peer("invariant_lock_step_repeats") {
        return;
    }
    let domain = domain(1);
    let told = || {
        let _node = Node::start(
            &domain,
            &[
                "--lock-step",
                "--rate",
                "50",
                "--set",
                "robot.bubble.level=\"rolling\"",
            ],
        );
        String::from_utf8(peer("lockstep.py", &[&domain, "500"]).stdout).expect("text")
    };
    let first = told();
    assert!(first.starts_with("50"), "{first}");
    assert_eq!(first, told());
}

#[test]
fn invariant_hostile_peers_do_not_stop_the_node() {
    if !has_peer("invariant_hostile_peers_do_not_stop_the_node") {
        return;
    }
    let domain = domain(2);
    let seconds = std::env::var("APPELL_HOSTILE_SECONDS").unwrap_or_else(|_| "8".to_owned());
    let mut node = Node::start(&domain, &[]);
    peer("hostile.py", &[&domain, &seconds, "1"]);
    assert!(node.is_alive());
}

/// Every socket of the node stays on the loopback interface, unless it is told otherwise.
#[cfg(target_os = "linux")]
#[test]
fn invariant_loopback_alone() {
    let domain_id = domain(3);
    let _node = Node::start(&domain_id, &[]);
    let port = 7400 + 250 * domain_id.parse::<u16>().expect("a number") + 10;
    let bound = || {
        let listed = Command::new("ss")
            .args(["-H", "-u", "-l", "-n"])
            .output()
            .expect("ss");
        let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
        let of = |line: &&str| {
            let place = line.split_whitespace().nth(3).unwrap_or_default();
            let own = place
                .rsplit(':')
                .next()
                .and_then(|port| port.parse::<u16>().ok());
            own.is_some_and(|own| (port - 10..port + 10).contains(&own))
        };
        listed
            .lines()
            .filter(of)
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(10);
    loop {
        let lines = bound();
        let done = !lines.is_empty()
            && lines
                .iter()
                .all(|line| line.contains("%lo:") || line.contains("127.0.0.1:"));
        if done {
            return;
        }
        assert!(std::time::Instant::now() < deadline, "{lines:#?}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}

/// Of two robots each has its topics and frames below its name; a twist with a stamp is none without.
#[test]
fn peer_two_robots_below_their_names() {
    if !has_peer("peer_two_robots_below_their_names") {
        return;
    }
    let domain = domain(0);
    let _node = Node::of("two-robots.toml", &domain, &[]);
    let told: Value = serde_json::from_slice(&peer("two.py", &[&domain]).stdout).expect("JSON");
    assert_eq!(
        (&told["p3dx"][0], &told["p3dx"][1]),
        (&"p3dx/odom".into(), &"p3dx/base_link".into())
    );
    assert_eq!(told["p3dx"][2], 0.0);
    assert_eq!(told["tri"][0], "tri/odom");
    let number = |k: usize| told["tri"][k].as_f64().expect("a number");
    assert!(
        number(2) >= 0.3 && number(3).abs() < 1e-6,
        "{}",
        told["tri"]
    );
    assert!((number(4) - 0.2).abs() < 1e-3, "{}", told["tri"]);
}

/// What services ask and answer on the wire.
mod asked {
    use serde::{Deserialize, Serialize};

    #[derive(Clone, Debug, Default, Deserialize, Serialize)]
    pub struct Nothing {
        pub structure_needs_at_least_one_member: u8,
    }
    #[derive(Clone, Debug, Deserialize, Serialize)]
    pub struct Flag {
        pub data: bool,
    }
    #[derive(Clone, Debug, Deserialize, Serialize)]
    pub struct Done {
        pub success: bool,
        pub message: String,
    }
    #[derive(Clone, Debug, Deserialize, Serialize)]
    pub struct SetPose {
        pub header: appell_sim::ros::message::Header,
        pub pose: appell_sim::ros::message::PoseWithCovariance,
    }
    impl ros2_client::Message for Nothing {}
    impl ros2_client::Message for Flag {}
    impl ros2_client::Message for Done {}
    impl ros2_client::Message for SetPose {}
}

/// Services, asked by a node of the same library.
#[test]
fn known_answer_services() {
    use appell_sim::ros::message::Odometry;
    use asked::{Done, Flag, Nothing, SetPose};
    use ros2_client::{
        Context, ContextOptions, MessageTypeName, Name, NodeName, NodeOptions, QosProfile,
        ServiceMapping, ServiceTypeName, Subscription,
    };
    use std::time::{Duration, Instant};

    let domain = domain(3);
    let _node = Node::start(&domain, &["--paused"]);
    let options = ContextOptions::new().domain_id(domain.parse().expect("a number"));
    let context = Context::with_options(options).expect("a context");
    let name = NodeName::new("/", "asks").expect("a name");
    let mut node = context.new_node(name, NodeOptions::new()).expect("a node");
    let spinner = node.spinner().expect("a spinner");
    std::thread::spawn(move || futures::executor::block_on(spinner.spin()));
    let qos = QosProfile::publisher_default();
    macro_rules! client {
        ($asks:ty, $answers:ty, $space:literal, $name:literal, $package:literal, $kind:literal) => {
            node.create_client::<$asks, $answers>(
                ServiceMapping::Enhanced,
                &Name::new($space, $name).expect("a name"),
                &ServiceTypeName::new($package, $kind),
                qos.clone(),
                qos.clone(),
            )
            .expect("a client")
        };
    }
    let pause = client!(Flag, Done, "/appell", "pause", "std_srvs", "SetBool");
    let step = client!(Nothing, Done, "/appell", "step", "std_srvs", "Trigger");
    let reset = client!(Nothing, Nothing, "/appell", "reset", "std_srvs", "Empty");
    let set_pose = client!(
        SetPose,
        Nothing,
        "/",
        "set_pose",
        "robot_localization",
        "SetPose"
    );
    let topic = node
        .create_topic(
            &Name::new("/", "ground_truth").expect("a name"),
            MessageTypeName::new("nav_msgs", "Odometry"),
            &qos,
        )
        .expect("a topic");
    let truth: Subscription<Odometry> = node.create_subscription(&topic, None).expect("heard");
    let deadline = Instant::now() + Duration::from_secs(60);
    macro_rules! ask {
        ($client:expr, $request:expr) => {{
            futures::executor::block_on($client.wait_for_service(&node));
            $client.send_request($request).expect("sent");
            loop {
                if let Ok(Some((_, answer))) = $client.receive_response() {
                    break answer;
                }
                assert!(Instant::now() < deadline, "no answer");
                std::thread::sleep(Duration::from_millis(2));
            }
        }};
    }
    // The last of what was said, after it has had time to come.
    let last = || {
        std::thread::sleep(Duration::from_millis(300));
        let mut last = None;
        while let Ok(Some((message, _))) = truth.take() {
            last = Some(message);
        }
        last
    };
    // At rest it says a row for each second tick that it is asked for: the first, and the third.
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(last(), None);
    for _ in 0..3 {
        assert!(ask!(step, Nothing::default()).success);
        std::thread::sleep(Duration::from_millis(50));
    }
    let third = last().expect("stepped");
    assert_eq!(third.header.stamp.nanosec, 20_000_000);
    // Let go it goes on, and cannot be stepped.
    assert!(ask!(pause, Flag { data: false }).success);
    assert!(!ask!(step, Nothing::default()).success);
    let gone = last().expect("it goes on");
    assert!(gone.header.stamp.seconds() > 0.1, "{gone:?}");
    // Put elsewhere it is there, and time goes on.
    let mut pose = SetPose {
        header: Default::default(),
        pose: Default::default(),
    };
    (pose.pose.pose.position.x, pose.pose.pose.position.y) = (1.0, 3.0);
    ask!(set_pose, pose);
    let placed = last().expect("it goes on");
    let place = placed.pose.pose.position;
    assert_eq!((place.x, place.y), (1.0, 3.0));
    assert!(placed.header.stamp > gone.header.stamp);
    // Begun anew, time does, too.
    assert!(ask!(pause, Flag { data: true }).success);
    ask!(reset, Nothing::default());
    assert!(ask!(step, Nothing::default()).success);
    let anew = last().expect("stepped");
    assert_eq!(anew.header.stamp.seconds(), 0.0);
}
