//! `appell plugin`.

use std::path::{Path, PathBuf};

use appell_plugin::{Descriptor, Limits, Plugin, conformance};

use crate::arguments::{Language, PluginCommand};
use crate::new::{name, robot, scenario};
use crate::{exit, terminal};

/// Writes, describes, lists or tests plug-ins.
pub fn plugin(command: &PluginCommand) -> u8 {
    match command {
        PluginCommand::New { folder, language } => new(folder, *language),
        PluginCommand::Describe { file, json } => describe(file, *json),
        PluginCommand::List { folder } => list(folder),
        PluginCommand::Test {
            file,
            steps,
            trust_native,
        } => test(file, *steps, *trust_native),
        PluginCommand::Serve { file } => match appell_plugin::serve(file) {
            Ok(()) => exit::PASSED,
            Err(error) => {
                terminal::error(&format!("{}: cannot be served: {error}", file.display()));
                exit::OUTPUT
            }
        },
    }
}

const PYTHON: &str = include_str!("../templates/controller.py");
const C: &str = include_str!("../templates/controller.c");
const HEADER: &str = include_str!("../../../sdk/c/appell_plugin.h");

/// What the starter scenario has in place of its controller.
const CONTROLLER: &str = r#"[robot.controller]
kind = "plugin"
file = "FILE"
period = 0.02                  # s
parameters = { speed = 0.6 }   # see `appell plugin describe FILE`
on_failure = "stop"            # or "end", or leave it out and name a fallback

"#;

fn new(folder: &Path, language: Language) -> u8 {
    let name = name(folder);
    let (suffix, used) = match language {
        Language::Python => ("py", "py"),
        Language::C => ("c", "so"),
    };
    let (source, used) = (format!("{name}.{suffix}"), format!("{name}.{used}"));
    let text = scenario(
        &name,
        "a controller of your own drives to a beacon and stops beside it",
    );
    let (Some(begin), Some(end)) = (text.find("[robot.controller]"), text.find("[robot.task]"))
    else {
        unreachable!("the starter scenario has a controller and a task");
    };
    let text = [
        &text[..begin],
        &CONTROLLER.replace("FILE", &used),
        &text[end..],
    ]
    .concat();
    let place = folder.display();
    let mut files = vec![("scenario.toml", text.as_str()), ("robot.toml", robot())];
    let own = C.replace("NAME", &name);
    let mut next = Vec::new();
    match language {
        Language::Python => files.insert(0, (&source, PYTHON)),
        Language::C => {
            files.insert(0, ("appell_plugin.h", HEADER));
            files.insert(0, (&source, &own));
            next.push(format!(
                "cc -shared -fPIC -O2 -ffp-contract=off -o {place}/{used} {place}/{source} -lm"
            ));
        }
    }
    next.push(format!("appell plugin test {place}/{used}"));
    crate::new::write(folder, &files, &next)
}

fn describe(file: &Path, json: bool) -> u8 {
    match Plugin::open(file, Limits::default()) {
        Ok(plugin) if json => {
            let text = serde_json::to_string_pretty(plugin.descriptor());
            terminal::print(&text.expect("a description is plain data"));
            exit::PASSED
        }
        Ok(plugin) => {
            terminal::print(&table(plugin.descriptor(), plugin.hash()));
            exit::PASSED
        }
        Err(fault) => refuse(file, &fault),
    }
}

fn refuse(file: &Path, fault: &appell_plugin::Fault) -> u8 {
    let hint = match fault.hint.is_empty() {
        true => String::new(),
        false => format!("\n  hint: {}", fault.hint),
    };
    terminal::error(&format!("{}: {fault}{hint}", file.display()));
    exit::BAD_INPUT
}

fn table(descriptor: &Descriptor, hash: &str) -> String {
    let mut text = format!("{} {}\n", descriptor.name, descriptor.version);
    if !descriptor.about.is_empty() {
        text.push_str(&format!("  {}\n", descriptor.about));
    }
    text.push_str(&format!("  sha256 {hash}\n"));
    let mut row = |kind: &str, name: &str, unit: &str, rest: String| {
        let line = format!("  {kind:10} {name:28} {unit:6} {rest}");
        text.push_str(line.trim_end());
        text.push('\n');
    };
    for port in &descriptor.inputs {
        row("reads", &port.name, &port.unit, String::new());
    }
    for port in &descriptor.outputs {
        row("writes", &port.name, &port.unit, range(port.min, port.max));
    }
    for parameter in &descriptor.parameters {
        let range = range(parameter.min, parameter.max);
        let rest = format!("{} {range} {}", parameter.default, parameter.about);
        row("parameter", &parameter.name, &parameter.unit, rest);
    }
    text
}

fn range(min: Option<f64>, max: Option<f64>) -> String {
    match (min, max) {
        (None, None) => String::new(),
        (Some(min), None) => format!("at least {min}"),
        (None, Some(max)) => format!("at most {max}"),
        (Some(min), Some(max)) => format!("in [{min}, {max}]"),
    }
}

/// Python files of a folder and of those directly below it that speak of the module.
fn list(folder: &Path) -> u8 {
    let files = |folder: &Path| -> std::io::Result<Vec<PathBuf>> {
        let entries = std::fs::read_dir(folder)?;
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        Ok(paths)
    };
    let here = match files(folder) {
        Ok(here) => here,
        Err(error) => {
            terminal::error(&format!("{}: cannot be read: {error}", folder.display()));
            return exit::BAD_INPUT;
        }
    };
    let below = here.iter().filter(|path| path.is_dir());
    let below: Vec<PathBuf> = below
        .flat_map(|path| files(path).unwrap_or_default())
        .collect();
    let is_plugin = |path: &&PathBuf| {
        path.extension().is_some_and(|extension| extension == "py")
            && std::fs::read_to_string(path).is_ok_and(|text| text.contains("appell_plugin"))
    };
    let mut found = 0;
    for path in here.iter().chain(&below).filter(is_plugin) {
        found += 1;
        let line = match Plugin::open(path, Limits::default()) {
            Ok(plugin) => {
                let Descriptor { name, about, .. } = plugin.descriptor();
                format!("{:40} {name}: {about}", path.display().to_string())
            }
            Err(fault) => format!("{:40} {fault}", path.display().to_string()),
        };
        terminal::print(&line);
    }
    if found == 0 {
        terminal::print("no plug-ins here; `appell plugin new NAME` writes one");
    }
    exit::PASSED
}

fn test(file: &Path, steps: usize, is_trusted: bool) -> u8 {
    let limits = Limits {
        is_trusted,
        ..Limits::default()
    };
    let findings = match conformance(file, &limits, steps.max(2)) {
        Ok(findings) => findings,
        Err(fault) => return refuse(file, &fault),
    };
    let mut code = exit::PASSED;
    for finding in findings {
        let line = match &finding.result {
            Ok(text) => format!("ok      {}: {text}", finding.rule),
            Err(problem) => {
                code = exit::FAILED;
                format!("FAILED  {}: {problem}", finding.rule)
            }
        };
        terminal::print(&line);
    }
    code
}
