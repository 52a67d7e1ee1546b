//! The blog's very command, from a publisher of ROS 1 through a master of ROS 1: Debian's packages. Where they are not
//! installed this says so, and is no test.
#![cfg(unix)]
// The platform's own functions are good enough to judge by.
#![allow(clippy::disallowed_methods)]

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use appell_sim::record::Recording;

/// A process and all that it started, which end with the test.
struct Running(Child);

impl Running {
    fn start(command: &mut Command) -> Running {
        use std::os::unix::process::CommandExt;
        Running(command.process_group(0).spawn().expect("it starts"))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let group = format!("-{}", self.0.id());
        let _ = Command::new("kill").args(["-INT", "--", &group]).status();
        let deadline = Instant::now() + Duration::from_secs(5);
        while self.0.try_wait().is_ok_and(|status| status.is_none()) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = Command::new("kill")
            .args(["-KILL", "--", &group])
            .stderr(Stdio::null())
            .status();
        let _ = self.0.wait();
    }
}

/// Debian's programs run in Debian's Python, whatever other is first on the path.
fn ros(program: &str, master: &str) -> Command {
    let mut command = Command::new("/usr/bin/python3");
    command
        .arg(format!("/usr/bin/{program}"))
        .env("ROS_MASTER_URI", master)
        .env("ROS_HOSTNAME", "localhost")
        .env("PATH", "/usr/bin:/bin")
        .stderr(Stdio::null());
    command
}

/// The rates of left and right in joint states that are echoed, until `enough` says so; when each came.
fn rates(
    master: &str,
    patience: Duration,
    mut enough: impl FnMut(f64, f64, Duration) -> bool,
) -> Result<(), String> {
    let mut echo = ros("rostopic", master);
    echo.args(["echo", "-p", "/joint_states"])
        .stdout(Stdio::piped());
    let begun = Instant::now();
    let mut echo = Running::start(&mut echo);
    let out = echo.0.stdout.take().expect("piped");
    let (send, lines) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for line in BufReader::new(out).lines().map_while(Result::ok) {
            if send.send(line).is_err() {
                return;
            }
        }
    });
    let mut columns = Vec::new();
    let mut last = String::new();
    while let Some(left) = patience.checked_sub(begun.elapsed()) {
        let Ok(line) = lines.recv_timeout(left) else {
            break;
        };
        let cells: Vec<&str> = line.split(',').collect();
        if line.starts_with('%') {
            columns = ["field.velocity0", "field.velocity1"]
                .map(|name| {
                    cells
                        .iter()
                        .position(|cell| *cell == name)
                        .expect("a column")
                })
                .to_vec();
            continue;
        }
        let number = |k: usize| cells[columns[k]].parse::<f64>().expect("a number");
        if enough(number(0), number(1), begun.elapsed()) {
            return Ok(());
        }
        last = format!("{} {}", number(0), number(1));
    }
    Err(format!("the last rates were {last}"))
}

#[test]
fn peer_the_very_command_of_the_blog() {
    let has = |file: &str| std::path::Path::new(file).exists();
    if !has("/usr/bin/roscore") || !has("/usr/bin/rostopic") {
        let told =
            "peer_the_very_command_of_the_blog tests nothing: there is no roscore of Debian\n";
        // What is printed otherwise is not shown of a test that passes.
        std::io::stderr()
            .write_all(told.as_bytes())
            .expect("written");
        return;
    }
    let port = 20_000 + std::process::id() % 20_000;
    let master = format!("http://localhost:{port}");
    let mut core = ros("roscore", &master);
    let _core = Running::start(core.args(["-p", &port.to_string()]).stdout(Stdio::null()));
    let deadline = Instant::now() + Duration::from_secs(30);
    while std::net::TcpStream::connect(("localhost", port as u16)).is_err() {
        assert!(Instant::now() < deadline, "the master does not come up");
        std::thread::sleep(Duration::from_millis(100));
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("blog");
    let scenario = format!("{}/../../scenarios/ros.toml", env!("CARGO_MANIFEST_DIR"));
    let mut node = Command::new(env!("CARGO_BIN_EXE_appell-ros"));
    let node = node
        .args([&scenario, "--ros1", &master, "--out"])
        .arg(&folder)
        .stdout(Stdio::null());
    let node = Running::start(node);

    let still = rates(&master, Duration::from_secs(30), |left, right, _| {
        (left, right) == (0.0, 0.0)
    });
    still.expect("at rest before the first command");
    let mut publisher = ros("rostopic", &master);
    let blog = "{linear: {x: 0.2, y: 0.0, z: 0.0}, angular: {x: 0.0, y: 0.0, z: 1.0}}";
    let publisher = publisher.args(["pub", "/cmd_vel", "geometry_msgs/Twist", blog, "-r", "15"]);
    let publisher = Running::start(publisher.stdout(Stdio::null()));
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
    let mut held = 0;
    let turned = rates(&master, Duration::from_secs(30), |left, right, _| {
        held += u32::from(near(left, 2.5) && near(right, 7.5));
        // 6.6 s of it: the whole circle.
        held >= 330
    });
    turned.expect("2.5 and 7.5 rad/s");
    // The publisher goes, and the robot stops: within half a second, and what it takes to listen.
    drop(publisher);
    let stopped = rates(&master, Duration::from_secs(10), |left, right, _| {
        (left, right) == (0.0, 0.0)
    });
    stopped.expect("it stops");
    // What it leaves: the circle of 0.2 m about (2, 2), and its picture.
    drop(node);
    let recording = Recording::read(&folder.join("recording.mcap")).expect("a recording");
    let column = |path: &str| recording.column(path).expect("recorded");
    let [x, y, rate] = ["pose.x", "pose.y", "wheel.right.spin_rate"]
        .map(|path| column(&format!("robot.bubble.{path}")));
    let off = |k: usize| (f64::hypot(x[k] - 2.0, y[k] - 2.0) - 0.2).abs();
    assert!((0..x.len()).all(|k| off(k) < 1e-6));
    let driven = rate.iter().filter(|rate| near(**rate, 7.5)).count();
    assert!(driven >= 330 && rate.last() == Some(&0.0), "{driven}");
    let picture = std::fs::read(folder.join("trajectory.png")).expect("a picture");
    assert!(picture.starts_with(b"\x89PNG") && folder.join("report.html").exists());
}
