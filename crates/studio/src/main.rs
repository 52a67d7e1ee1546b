//! `appell-studio`: opens a scenario or a recording in the browser. `appell studio` starts it.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use appell_studio::driver::Driver;
use appell_studio::panels::Panels;
use appell_studio::studio::{Native, Studio};
use appell_studio::web;
use clap::Parser;

/// Look at a run while it goes on, and change it.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    /// A scenario, the recording of a run (`.mcap`, `.parquet`), or the folder of a batch (or its rows).
    file: PathBuf,
    /// Print the address only.
    #[arg(long)]
    no_browser: bool,
    /// Port on loopback [default: any that is free].
    #[arg(long, default_value_t = 0, hide_default_value = true)]
    port: u16,
    /// Set any value by its path, such as robot.tri.controller.speed=1.2; may be repeated.
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Folder with panels of the project [default: panels, beside the scenario or its folder].
    #[arg(long, value_name = "DIR")]
    panels: Option<PathBuf>,
    /// Run plug-ins that are libraries, FMUs or programs, each in a process of its own.
    #[arg(long)]
    allow_native: bool,
    /// Load plug-ins that are libraries into this process.
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
    let mut overrides = Vec::new();
    for set in &arguments.set {
        let Some((path, value)) = set.split_once('=') else {
            return Err((2, format!("--set {set}: must be PATH=VALUE, got no =")));
        };
        overrides.push((path.trim().to_owned(), value.trim().to_owned()));
    }
    let native = match (arguments.trust_native, arguments.allow_native) {
        (true, _) => Native::Here,
        (false, true) => Native::Apart,
        (false, false) => Native::Refused,
    };
    let studio = Studio::open(&arguments.file, &overrides, native)
        .map_err(|refusal| (2, format!("{}: {refusal}", arguments.file.display())))?;
    let output = |error: std::io::Error| (4, error.to_string());
    let token = web::token().map_err(|error| (4, error.to_string()))?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(output)?;
    runtime.block_on(async {
        let listener = web::listen(arguments.port).await.map_err(|error| {
            let port = arguments.port;
            (4, format!("port {port} of this machine: {error}\n  hint: leave --port out for any that is free"))
        })?;
        let address = listener.local_addr().map_err(output)?;
        let address = format!("http://{address}/{token}/");
        println!("{address}");
        eprintln!("Open this address; Ctrl C ends the studio.");
        if !arguments.no_browser {
            browse(&address);
        }
        let panels = match &arguments.panels {
            Some(folder) => Panels::of(folder),
            None => Panels::beside(&arguments.file),
        };
        let driver = Arc::new(Driver::start(studio));
        tokio::select! {
            () = web::serve(listener, driver.clone(), panels, token) => {}
            _ = tokio::signal::ctrl_c() => {}
        }
        driver.stop();
        Ok(())
    })
}

/// Opens the address as the desktop does; without a desktop the address is printed anyway.
fn browse(address: &str) {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ => "xdg-open",
    };
    let quiet = std::process::Stdio::null;
    let started = std::process::Command::new(program)
        .arg(address)
        .stdin(quiet())
        .stdout(quiet())
        .stderr(quiet())
        .spawn();
    if started.is_err() {
        eprintln!("No browser could be opened from here.");
    }
}
