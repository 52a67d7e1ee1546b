//! The node against independent implementations of DDS in other processes: the Python package cyclonedds, and Fast
//! DDS of Debian, with the names of ROS 2. Where one is not installed its tests say so, and are none.
#![cfg(unix)]

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

const TESTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");

fn has_peer(test: &str) -> bool {
    let found = python().args(["-c", "import cyclonedds"]).output();
    let found = found.is_ok_and(|found| found.status.success());
    if !found {
        tell(&format!(
            "{test} tests nothing: Python lacks the module cyclonedds"
        ));
    }
    found
}

/// Says something that is shown even of a test that passes.
fn tell(words: &str) {
    let line = format!("{words}\n");
    std::io::stderr()
        .write_all(line.as_bytes())
        .expect("written");
}

/// The program that speaks by Fast DDS, compiled where it is missing or old; none where Fast DDS is.
fn fast_dds(test: &str) -> Option<PathBuf> {
    if !Path::new("/usr/include/fastdds").exists() {
        tell(&format!("{test} leaves out Fast DDS: it is not installed"));
        return None;
    }
    static COMPILED: std::sync::OnceLock<PathBuf> = std::sync::OnceLock::new();
    let program = COMPILED.get_or_init(|| {
        let source = Path::new(TESTS).join("fastdds.cpp");
        let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fastdds");
        let age = |file: &Path| file.metadata().and_then(|file| file.modified()).ok();
        if age(&program) < age(&source) {
            let compiled = Command::new("c++")
                .args(["-std=c++17", "-Wall", "-Wextra", "-o"])
                .args([&program, &source])
                .args(["-lfastrtps", "-lfastcdr"])
                .output()
                .expect("a compiler of C++");
            let told = String::from_utf8_lossy(&compiled.stderr);
            assert!(compiled.status.success(), "{told}");
        }
        program
    });
    Some(program.clone())
}

/// Runs a test again in a network of its own, where nobody else is and `lo` is all there is; whether it did. Where
/// that is not permitted it says so, and the test goes on on the loopback interface of the machine.
#[cfg(target_os = "linux")]
fn in_own_network(test: &str) -> bool {
    const WITHIN: &str = "APPELL_OWN_NETWORK";
    if std::env::var_os(WITHIN).is_some() {
        return false;
    }
    let unshared = |words: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(["--user", "--map-root-user", "--net", "--"]);
        command.args(words);
        command
    };
    let may = unshared(&["ip", "link", "set", "lo", "up"]).output();
    if !may.is_ok_and(|tried| tried.status.success()) {
        tell(&format!(
            "{test} is on the loopback interface of the machine: a network of its own is not permitted"
        ));
        return false;
    }
    let _turn = turn();
    let own = std::env::current_exe().expect("a test");
    let own = own.to_str().expect("a path in UTF-8");
    let script = "ip link set lo up && exec \"$@\"";
    let status = unshared(&[
        "sh",
        "-c",
        script,
        "sh",
        own,
        test,
        "--exact",
        "--nocapture",
    ])
    .env(WITHIN, "1")
    .status();
    assert!(status.expect("it starts").success(), "{test}");
    true
}

#[cfg(not(target_os = "linux"))]
fn in_own_network(_test: &str) -> bool {
    false
}

fn python() -> Command {
    Command::new(std::env::var_os("APPELL_PYTHON").unwrap_or_else(|| "python3".into()))
}

/// A domain of its own for each test of each process, so that nobody else is met there.
fn domain(test: u32) -> String {
    (100 + (std::process::id() * 4 + test) % 120).to_string()
}

/// The node, which ends with the test.
struct Node {
    child: Child,
}

/// A test's turn: all are in a hurry, and run one at a time.
fn turn() -> std::sync::MutexGuard<'static, ()> {
    static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());
    TURN.lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

impl Node {
    fn start(domain: &str, more: &[&str]) -> Node {
        Node::of("ros.toml", domain, more)
    }

    fn of(scenario: &str, domain: &str, more: &[&str]) -> Node {
        let scenario = format!("{}/../../scenarios/{scenario}", env!("CARGO_MANIFEST_DIR"));
        let child = Command::new(env!("CARGO_BIN_EXE_appell-ros"))
            .args([&scenario, "--domain", domain])
            .args(more)
            .stdout(Stdio::piped())
            .spawn();
        Node {
            child: child.expect("the node starts"),
        }
    }

    /// What stands after these words in a line that it prints. It is read no further.
    fn says(&mut self, words: &str) -> String {
        let out = self.child.stdout.take().expect("piped");
        let lines = BufReader::new(out).lines().map_while(Result::ok);
        let found = { lines }.find_map(|line| Some(line.strip_prefix(words)?.to_owned()));
        found.unwrap_or_else(|| panic!("the node does not say {words:?}"))
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
    answered(python().arg(Path::new(TESTS).join(script)).args(arguments))
}

fn answered(command: &mut Command) -> Output {
    let output = command.output().expect("it starts");
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(output.status.success(), "{command:?}: {out}{err}");
    output
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn numbers(value: &Value) -> Vec<f64> {
    let numbers = value.as_array().expect("numbers").iter();
    numbers.map(number).collect()
}

fn near(got: &[f64], want: &[f64]) -> bool {
    got.len() == want.len() && got.iter().zip(want).all(|(g, w)| (g - w).abs() < 1e-9)
}

/// A minute by the clock, with Cyclone DDS and with Fast DDS at once: commands in at 15 Hz, odometry out at 50 Hz
/// without a loss.
#[test]
fn peer_the_circle_of_the_blog_over_dds() {
    const NAME: &str = "peer_the_circle_of_the_blog_over_dds";
    if !has_peer(NAME) || in_own_network(NAME) {
        return;
    }
    const TIMEOUT: &str = "0.8";
    let _turn = turn();
    let fast_dds = fast_dds(NAME);
    std::thread::scope(|scope| {
        let drives = |test: u32, mut command: Command, words: &[&str]| {
            let domain = domain(test);
            let mut node = Node::of("ros.toml", &domain, &["--cmd-vel-timeout", TIMEOUT]);
            command.args(words).args([&domain, "60", TIMEOUT]);
            scope.spawn(move || {
                let output = answered(&mut command);
                assert!(node.is_alive());
                circled(&serde_json::from_slice(&output.stdout).expect("JSON"));
            })
        };
        let mut cyclone_dds = python();
        cyclone_dds.arg(Path::new(TESTS).join("drive.py"));
        drives(0, cyclone_dds, &[]);
        if let Some(program) = fast_dds {
            drives(1, Command::new(program), &["drive"]);
        }
    });
}

/// What a peer has heard of a minute on the circle: every odometry, the right rates, and the stop at the end.
fn circled(told: &Value) {
    let stamps: Vec<i64> = { told["stamps"].as_array().expect("stamps").iter() }
        .map(|stamp| stamp.as_i64().expect("a time"))
        .collect();
    assert!(stamps.len() >= 2990, "{}", stamps.len());
    for pair in stamps.windows(2) {
        assert_eq!(pair[1] - pair[0], 20_000_000, "{pair:?}");
    }
    for (wheel, rate) in [("left", 2.5), ("right", 7.5)] {
        let got = numbers(&told[wheel]);
        assert!(near(&got, &[rate; 2]), "{wheel}: {got:?}");
    }
    assert!(number(&told["spread"]) < 1e-6, "{}", told["spread"]);
    assert_eq!(number(&told["still"]), 0.0);
    let after = number(&told["stopped_after"]);
    assert!((0.6..1.2).contains(&after), "{after}");
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
    let _turn = turn();
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
    let _turn = turn();
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
    let _turn = turn();
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
    let _turn = turn();
    let domain = domain(0);
    let _node = Node::of("two-robots.toml", &domain, &[]);
    let told: Value = serde_json::from_slice(&peer("two.py", &[&domain]).stdout).expect("JSON");
    assert_eq!(
        (&told["p3dx"][0], &told["p3dx"][1]),
        (&"p3dx/odom".into(), &"p3dx/base_link".into())
    );
    assert_eq!(told["p3dx"][2], 0.0);
    assert_eq!(told["tri"][0], "tri/odom");
    let tri = |k: usize| number(&told["tri"][k]);
    assert!(tri(2) >= 0.3 && tri(3).abs() < 1e-6, "{}", told["tri"]);
    assert!((tri(4) - 0.2).abs() < 1e-3, "{}", told["tri"]);
}

/// A viewer of another maker looks on by the published protocol, after one that sends what no viewer should.
#[test]
fn peer_live_view_for_foxglove() {
    if !has_peer("peer_live_view_for_foxglove") {
        return;
    }
    let _turn = turn();
    let domain = domain(1);
    let mut node = Node::start(&domain, &["--foxglove=127.0.0.1:0"]);
    let address = node.says("shown to Foxglove at ");
    for protocol in ["foxglove.sdk.v1", "foxglove.websocket.v1"] {
        let output = peer("foxglove.py", &[&address, protocol, &domain]);
        let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        for (topic, kind) in [
            ("/odom", "nav_msgs/msg/Odometry"),
            ("/tf", "tf2_msgs/msg/TFMessage"),
            ("/clock", "rosgraph_msgs/msg/Clock"),
            ("/cmd_vel_out", "geometry_msgs/msg/TwistStamped"),
        ] {
            assert_eq!(told["topics"][topic], kind, "{topic}");
        }
        let odom = &told["odom"];
        assert_eq!(odom["frames"], serde_json::json!(["odom", "base_link"]));
        assert!(near(&numbers(&odom["twist"]), &[0.2, 0.0, 1.0]), "{odom}");
        assert!(
            near(&numbers(&told["rates"]), &[2.5, 7.5]),
            "{}",
            told["rates"]
        );
        let stamps = numbers(&odom["stamps"]);
        assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] == 2e7));
        assert_eq!(
            told["tf"][1],
            serde_json::json!(["base_link", "left", 0.04])
        );
        assert_eq!(told["fixed"][0], serde_json::json!(["world", "odom", 2.0]));
    }
    assert!(node.is_alive());
}

/// Services, asked in the way of Cyclone DDS and in that of Fast DDS, while both are there.
#[test]
fn peer_services_in_both_ways() {
    const NAME: &str = "peer_services_in_both_ways";
    if !has_peer(NAME) {
        return;
    }
    let _turn = turn();
    let domain = domain(2);
    let mut node = Node::of("slalom.toml", &domain, &["--keep-controllers", "--paused"]);
    let told = peer("services.py", &[&domain]).stdout;
    assert_eq!(told, b"all asked\n");
    if let Some(program) = fast_dds(NAME) {
        let told = answered(Command::new(program).args(["services", &domain])).stdout;
        assert_eq!(told, b"all asked\n");
    }
    assert!(node.is_alive());
}

/// Rates of wheels by their names; what names none, or is no number, does not count.
#[test]
fn peer_rates_of_wheels() {
    if !has_peer("peer_rates_of_wheels") {
        return;
    }
    let _turn = turn();
    let domain = domain(0);
    let _node = Node::start(&domain, &[]);
    let told: Value =
        serde_json::from_slice(&peer("wire.py", &[&domain, "joints"]).stdout).expect("JSON");
    assert!(near(&numbers(&told["truth"]), &[0.2, 0.0, 1.0]), "{told}");
    assert!(near(&numbers(&told["odom"]), &[0.2, 0.0, 1.0]), "{told}");
    assert!(near(&[number(&told["rates"]["left"])], &[2.5]), "{told}");
    assert!(near(&numbers(&told["after"]), &[0.0; 3]), "{told}");
}

/// A platform on mecanum wheels goes to the left, ahead and about, below a namespace. Its drive takes the wheels for
/// smaller than they are, so that it goes farther than it believes.
#[test]
fn peer_mecanum_below_a_namespace() {
    const NAME: &str = "peer_mecanum_below_a_namespace";
    if !has_peer(NAME) {
        return;
    }
    let drive = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mecanum.yaml");
    let parameters = "base:
  ros__parameters:
    front_left_wheel_command_joint_name: front-left
    front_right_wheel_command_joint_name: front-right
    rear_right_wheel_command_joint_name: rear-right
    rear_left_wheel_command_joint_name: rear-left
    reference_timeout: 0.3
    kinematics:
      wheels_radius: 0.0475
      sum_of_robot_center_projection_on_X_Y_axis: 0.386
";
    std::fs::write(&drive, parameters).expect("written");
    let _turn = turn();
    let domain = domain(1);
    let _node = Node::start(
        &domain,
        &[
            "--set",
            "robot.bubble.file=\"../robots/youbot-base.toml\"",
            "--namespace",
            "fleet/a",
            "--drive",
            drive.to_str().expect("a path in UTF-8"),
        ],
    );
    let output = peer("wire.py", &[&domain, "mecanum", "/fleet/a"]);
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let twist = [0.1, 0.2, 0.3];
    assert!(near(&numbers(&told["odom"]), &twist), "{told}");
    let truth = twist.map(|part| part * 0.05 / 0.0475);
    assert!(near(&numbers(&told["truth"]), &truth), "{told}");
    // vx ∓ vy ∓ 0.386 ω, over the radius.
    for (wheel, rate) in [
        ("front-left", 0.1 - 0.2 - 0.386 * 0.3),
        ("front-right", 0.1 + 0.2 + 0.386 * 0.3),
        ("rear-left", 0.1 + 0.2 - 0.386 * 0.3),
        ("rear-right", 0.1 - 0.2 + 0.386 * 0.3),
    ] {
        let got = number(&told["rates"][wheel]);
        assert!(near(&[got], &[rate / 0.0475]), "{wheel}: {got}");
    }
    assert!(near(&numbers(&told["after"]), &[0.0; 3]), "{told}");
}

/// From another machine the node is heard if it was told of the network, and not otherwise.
#[cfg(target_os = "linux")]
#[test]
fn peer_on_another_machine() {
    const NAME: &str = "peer_on_another_machine";
    if !has_peer(NAME) || in_own_network(NAME) {
        return;
    }
    if std::env::var_os("APPELL_OWN_NETWORK").is_none() {
        tell(&format!("{NAME} tests nothing: there is no other machine"));
        return;
    }
    let _turn = turn();
    // The other machine is a network beside this one, with a cable between.
    let mut other = Command::new("unshare")
        .args(["--net", "--", "sh", "-c", "echo there; exec sleep 300"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("another network");
    let mut line = String::new();
    let out = other.stdout.take().expect("piped");
    BufReader::new(out).read_line(&mut line).expect("a line");
    let pid = other.id().to_string();
    let run = |words: &[&str]| answered(Command::new(words[0]).args(&words[1..]));
    let there = ["nsenter", "--net", "--target", pid.as_str()];
    let run_there = |words: &[&str]| run(&[&there, words].concat());
    run(&[
        "ip", "link", "add", "near", "type", "veth", "peer", "name", "far",
    ]);
    run(&["ip", "link", "set", "far", "netns", &pid]);
    run(&["ip", "address", "add", "10.77.0.1/24", "dev", "near"]);
    run(&["ip", "link", "set", "near", "up"]);
    run_there(&["ip", "address", "add", "10.77.0.2/24", "dev", "far"]);
    run_there(&["ip", "link", "set", "far", "up"]);
    run_there(&["ip", "link", "set", "lo", "up"]);
    let heard = |test: u32, more: &[&str], seconds: &str| {
        let domain = domain(test);
        let mut node = Node::of("ros.toml", &domain, more);
        let script = Path::new(TESTS).join("wire.py");
        let output = answered(
            Command::new(there[0])
                .args(&there[1..])
                .arg(python().get_program())
                .arg(&script)
                .args([&domain, "hear", seconds])
                .env("APPELL_INTERFACE", "far=10.77.0.1"),
        );
        assert!(node.is_alive());
        output.stdout == b"true\n"
    };
    let told = heard(0, &["--network", "10.77.0.1"], "30");
    let untold = heard(1, &[], "8");
    let _ = other.kill();
    let _ = other.wait();
    assert!((told, untold) == (true, false), "{told} {untold}");
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

    let _turn = turn();
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
