//! `appell-ros`: a scenario as a node of ROS 2. `appell ros` starts it.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use appell_ros2::drive;
use appell_ros2::foxglove::View;
use appell_ros2::node::{Front, Options, shown};
use appell_ros2::ros1;
use appell_ros2::simulator::{Settings, Simulator};
#[cfg(feature = "zenoh")]
use appell_ros2::zenoh;
use appell_sim::scenario::{self, Loaded};
use clap::Parser;

/// Drive a scenario's robots by cmd_vel, as a node of ROS 2 without an installation of it.
#[derive(Parser)]
#[command(name = "appell-ros", version, max_term_width = 100)]
struct Arguments {
    /// Scenario file.
    scenario: PathBuf,
    /// Set any value by its path, such as robot.tri.pose.0=1.2; may be repeated.
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Domain [default: that of ROS_DOMAIN_ID, or 0].
    #[arg(long)]
    domain: Option<u16>,
    /// Namespace of the robots' topics.
    #[arg(long, default_value = "")]
    namespace: String,
    /// Name of the node.
    #[arg(long, default_value = "appell")]
    name: String,
    /// Speak to the network of this address of the machine, instead of to this machine alone.
    #[arg(long, value_name = "ADDRESS")]
    network: Option<IpAddr>,
    /// Speak ROS 1 instead, with the master at this address, such as http://localhost:11311.
    #[arg(long, value_name = "MASTER", conflicts_with_all = ["lock_step", "namespace", "paused", "domain"])]
    ros1: Option<String>,
    /// Speak over Zenoh instead, as rmw_zenoh does, by the router at this endpoint [default: tcp/127.0.0.1:7447].
    #[cfg(feature = "zenoh")]
    #[arg(
        long,
        value_name = "ENDPOINT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "tcp/127.0.0.1:7447",
        conflicts_with_all = ["ros1", "lock_step", "network", "paused"]
    )]
    zenoh: Option<String>,
    /// Show what is said to Foxglove, by a WebSocket at this address [default: 127.0.0.1:8765].
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:8765")]
    foxglove: Option<SocketAddr>,
    /// Seconds of simulated time per second; 0 for as fast as can be.
    #[arg(long, default_value_t = 1.0)]
    pace: f64,
    /// Wait for a command of each robot at every tick of control.
    #[arg(long)]
    lock_step: bool,
    /// Ticks of control per second of simulated time.
    #[arg(long, value_name = "HZ", default_value_t = 100.0)]
    rate: f64,
    /// Messages of each topic per second of simulated time; in lock-step, and by default 50, --rate at most.
    #[arg(long, value_name = "HZ")]
    publish_rate: Option<f64>,
    /// Messages of /clock per second of simulated time, --rate at most [default: --rate].
    #[arg(long, value_name = "HZ")]
    clock_rate: Option<f64>,
    /// A command older than this stops the robot, s; 0 for never. A drive of --drive has its own.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.5)]
    cmd_vel_timeout: f64,
    /// Parameters of diff_drive_controller or mecanum_drive_controller: YAML of ros2_control. ROBOT may be left out
    /// where there is one.
    #[arg(long, value_name = "ROBOT=FILE")]
    drive: Vec<String>,
    /// Keep the scenario's controllers and tasks, to be swapped in by the topic `controller`.
    #[arg(long)]
    keep_controllers: bool,
    /// Begin at rest; the service `pause` lets it go.
    #[arg(long)]
    paused: bool,
    /// Length of the run, s of simulated time [default: no end].
    #[arg(long, value_name = "SECONDS")]
    duration: Option<f64>,
    /// Record into this folder, with a report and a picture of the way at the end.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Load libraries that the scenario names as plug-ins into this process.
    #[arg(long)]
    trust_native: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err((code, problem)) => {
            eprintln!("error: {problem}");
            ExitCode::from(code)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), (u8, String)> {
    let bad = |problem: String| (2, problem);
    let mut overrides = Vec::new();
    for set in &arguments.set {
        let Some((path, value)) = set.split_once('=') else {
            return Err(bad(format!("--set {set}: must be PATH=VALUE, got no =")));
        };
        overrides.push((path.trim().to_owned(), value.trim().to_owned()));
    }
    let loaded = scenario::load(&arguments.scenario, &overrides);
    let loaded = Loaded {
        trust_native: arguments.trust_native,
        ..loaded.map_err(|diagnostics| bad(diagnostics.to_string()))?
    };
    for (option, value) in [
        ("--pace", Some(arguments.pace)),
        ("--cmd-vel-timeout", Some(arguments.cmd_vel_timeout)),
        ("--duration", arguments.duration),
        ("--clock-rate", arguments.clock_rate),
    ] {
        if let Some(value) = value
            && !(value >= 0.0 && value.is_finite())
        {
            return Err(bad(format!(
                "{option}: must be a finite number >= 0, got {value}"
            )));
        }
    }
    let domain = match (arguments.domain, std::env::var("ROS_DOMAIN_ID")) {
        (Some(domain), _) => domain,
        (None, Ok(text)) => text.parse().map_err(|_| {
            bad(format!(
                "ROS_DOMAIN_ID: must be a number in [0, 232], got {text:?}"
            ))
        })?,
        (None, Err(_)) => 0,
    };
    if domain > 232 {
        return Err(bad(format!("--domain: must be in [0, 232], got {domain}")));
    }
    let mut drives = Vec::new();
    for given in &arguments.drive {
        let (robot, file) = match given.split_once('=') {
            Some((robot, file)) => (robot.to_owned(), file),
            None if loaded.scenario.robot.len() == 1 => {
                (loaded.scenario.robot[0].name.clone(), given.as_str())
            }
            None => {
                return Err(bad(format!(
                    "--drive {given}: must be ROBOT=FILE, of several robots"
                )));
            }
        };
        let text = std::fs::read_to_string(file)
            .map_err(|error| bad(format!("{file}: cannot be read: {error}")))?;
        let read = drive::read(&text).map_err(|problem| bad(format!("{file}: {problem}")))?;
        match <[drive::Drive; 1]>::try_from(read) {
            Ok([drive]) => drives.push((robot, drive)),
            Err(several) => {
                let names: Vec<String> = several.into_iter().map(|drive| drive.name).collect();
                return Err(bad(format!(
                    "{file}: must have one drive, got {}: {}",
                    names.len(),
                    names.join(", ")
                )));
            }
        }
    }
    let publish_rate = match (arguments.lock_step, arguments.publish_rate) {
        (true, _) => arguments.rate,
        (false, Some(rate)) => rate,
        (false, None) => f64::min(50.0, arguments.rate),
    };
    let settings = Settings {
        rate: arguments.rate,
        publish_rate,
        timeout: arguments.cmd_vel_timeout,
        drives,
        keeps_controllers: arguments.keep_controllers,
    };
    let options = Options {
        domain,
        name: arguments.name.clone(),
        namespace: arguments.namespace.clone(),
        network: arguments.network,
        pace: if arguments.pace > 0.0 && !arguments.lock_step {
            arguments.pace
        } else {
            f64::INFINITY
        },
        lock_step: arguments.lock_step,
        duration: arguments.duration.unwrap_or(f64::INFINITY),
        clock_rate: arguments
            .clock_rate
            .filter(|rate| *rate > 0.0)
            .unwrap_or(arguments.rate),
        paused: arguments.paused,
        foxglove: arguments.foxglove,
    };
    let stop = Arc::new(AtomicBool::new(false));
    let told = stop.clone();
    let handled = ctrlc::set_handler(move || told.store(true, Ordering::Relaxed));
    handled.map_err(|error| (70, error.to_string()))?;
    if let Some(master) = &arguments.ros1 {
        let mut simulator = Simulator::new(&loaded, &settings).map_err(bad)?;
        let host = arguments
            .network
            .map_or("localhost".to_owned(), |address| address.to_string());
        let mut node = ros1::Node::open(master, &host, &arguments.name, &simulator).map_err(bad)?;
        let view = prepared(&mut simulator, arguments)?;
        println!("listening for cmd_vel by {master}");
        announce(view.as_ref());
        let pace = (options.pace, options.duration);
        let done = node.run(&mut simulator, pace, view.as_ref(), &stop);
        drop(node);
        return ended(done, &mut simulator);
    }
    #[cfg(feature = "zenoh")]
    if let Some(endpoint) = &arguments.zenoh {
        let mut simulator = Simulator::new(&loaded, &settings).map_err(bad)?;
        let identity = zenoh::Identity {
            domain,
            namespace: &arguments.namespace,
            name: &arguments.name,
        };
        let mut node = zenoh::Node::open(endpoint, &identity, &simulator).map_err(bad)?;
        let view = prepared(&mut simulator, arguments)?;
        println!("listening for cmd_vel by {endpoint} in domain {domain}");
        announce(view.as_ref());
        let pace = (options.pace, options.duration);
        let done = node.run(&mut simulator, pace, view.as_ref(), &stop);
        drop(node);
        return ended(done, &mut simulator);
    }
    let mut front = Front::open(&loaded, &settings, options).map_err(bad)?;
    let robots: Vec<&str> = front.simulator().robots().collect();
    println!(
        "listening for cmd_vel of {} in domain {domain}",
        robots.join(", ")
    );
    announce(front.view());
    if let Some(folder) = &arguments.out {
        let recorded = front.simulator_mut().record(folder);
        recorded.map_err(|problem| (4, problem))?;
    }
    let done = front.run(&stop);
    ended(done, front.simulator_mut())
}

/// Begins to record, and opens the live view, where they are asked for.
fn prepared(
    simulator: &mut Simulator,
    arguments: &Arguments,
) -> Result<Option<View>, (u8, String)> {
    if let Some(folder) = &arguments.out {
        simulator.record(folder).map_err(|problem| (4, problem))?;
    }
    let view = arguments
        .foxglove
        .map(|address| View::open(address, shown(simulator, &arguments.namespace)));
    view.transpose().map_err(|problem| (2, problem))
}

/// Completes what is recorded, however the run has ended.
fn ended(done: Result<(), String>, simulator: &mut Simulator) -> Result<(), (u8, String)> {
    let closed = simulator.close();
    done.map_err(|problem| (1, problem))?;
    closed.map_err(|problem| (4, problem))
}

fn announce(view: Option<&View>) {
    if let Some(view) = view {
        println!("shown to Foxglove at ws://{}", view.address());
    }
}
