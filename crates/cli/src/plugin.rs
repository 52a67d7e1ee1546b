//! `appell plugin`.

use std::path::{Path, PathBuf};

use appell_plugin::{Descriptor, Limits, Plugin, answers, conformance};

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
            files,
            steps,
            trust_native,
        } => test(files, *steps, *trust_native),
        PluginCommand::Serve { file } => match appell_plugin::serve(file) {
            Ok(()) => exit::PASSED,
            Err(error) => {
                terminal::error(&format!("{}: cannot be served: {error}", file.display()));
                exit::OUTPUT
            }
        },
    }
}

/// Files of the templates, by name; NAME stands for that of the controller.
const PYTHON: [(&str, &str); 1] = [("NAME.py", include_str!("../templates/controller.py"))];
const C: [(&str, &str); 2] = [
    ("NAME.c", include_str!("../templates/controller.c")),
    (
        "appell_plugin.h",
        include_str!("../../../sdk/c/appell_plugin.h"),
    ),
];
const RUST: [(&str, &str); 7] = [
    ("src/lib.rs", include_str!("../templates/rust/src/lib.rs")),
    ("Cargo.toml", include_str!("../templates/rust/Cargo.toml")),
    (
        "appell-sdk/Cargo.toml",
        include_str!("../../../sdk/rust/Cargo.toml"),
    ),
    (
        "appell-sdk/src/lib.rs",
        include_str!("../../../sdk/rust/src/lib.rs"),
    ),
    (
        "appell-sdk/src/border.rs",
        include_str!("../../../sdk/rust/src/border.rs"),
    ),
    (
        "appell-sdk/src/describe.rs",
        include_str!("../../../sdk/rust/src/describe.rs"),
    ),
    (
        "appell-sdk/src/remember.rs",
        include_str!("../../../sdk/rust/src/remember.rs"),
    ),
];
const ASSEMBLY_SCRIPT: [(&str, &str); 3] = [
    (
        "assembly/index.ts",
        include_str!("../templates/assemblyscript/assembly/index.ts"),
    ),
    (
        "asconfig.json",
        include_str!("../templates/assemblyscript/asconfig.json"),
    ),
    (
        "package.json",
        include_str!("../templates/assemblyscript/package.json"),
    ),
];

/// Files of a template, the file that is used, and the command that makes it.
type Template = (
    &'static [(&'static str, &'static str)],
    &'static str,
    Option<&'static str>,
);

fn template(language: Language) -> Template {
    match language {
        Language::Python => (&PYTHON, "NAME.py", None),
        Language::C => (
            &C,
            "NAME.so",
            Some("cc -shared -fPIC -O2 -ffp-contract=off -o PLACE/NAME.so PLACE/NAME.c -lm"),
        ),
        Language::Rust => (
            &RUST,
            "target/wasm32-unknown-unknown/release/controller.wasm",
            Some(
                "cargo build --release --target wasm32-unknown-unknown --manifest-path PLACE/Cargo.toml",
            ),
        ),
        Language::AssemblyScript => (
            &ASSEMBLY_SCRIPT,
            "build/NAME.wasm",
            Some("npm install --prefix PLACE && npm run build --prefix PLACE"),
        ),
    }
}

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
    let place = folder.display().to_string();
    let own = |text: &str| text.replace("NAME", &name).replace("PLACE", &place);
    let (template, used, command) = template(language);
    let used = own(used);
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
    // The SDK speaks of NAME where it means it.
    let is_own = |file: &str| !file.starts_with("appell");
    let written: Vec<(String, String)> = template
        .iter()
        .map(|(file, text)| match is_own(file) {
            true => (own(file), own(text)),
            false => ((*file).to_owned(), (*text).to_owned()),
        })
        .collect();
    let mut files: Vec<(&str, &str)> = written.iter().map(|(f, t)| (&**f, &**t)).collect();
    files.extend([("scenario.toml", text.as_str()), ("robot.toml", robot())]);
    let mut next: Vec<String> = command.map(own).into_iter().collect();
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

/// Python files and modules of a folder, and of those directly below it, that speak of Appell. Libraries are
/// left alone: to ask one means to run it.
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
        let mark = match path.extension().and_then(|extension| extension.to_str()) {
            Some("py") => "appell_plugin",
            Some("wasm") => "appell_describe",
            _ => return false,
        };
        let speaks = |bytes: Vec<u8>| {
            bytes
                .windows(mark.len())
                .any(|part| part == mark.as_bytes())
        };
        std::fs::read(path).is_ok_and(speaks)
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

fn test(files: &[PathBuf], steps: usize, is_trusted: bool) -> u8 {
    let limits = Limits {
        is_trusted,
        ..Limits::default()
    };
    let steps = steps.max(2);
    let mut code = exit::PASSED;
    let mut tell = |rule: &str, result: Result<&str, &str>| match result {
        Ok(text) => terminal::print(&format!("ok      {rule}: {text}")),
        Err(problem) => {
            code = exit::FAILED;
            terminal::print(&format!("FAILED  {rule}: {problem}"));
        }
    };
    let mut first: Option<(&PathBuf, Vec<Vec<f64>>)> = None;
    for file in files {
        if files.len() > 1 {
            terminal::print(&file.display().to_string());
        }
        let findings = match conformance(file, &limits, steps) {
            Ok(findings) => findings,
            Err(fault) => return refuse(file, &fault),
        };
        for finding in &findings {
            let result = finding.result.as_ref();
            tell(
                finding.rule,
                result.map(String::as_str).map_err(String::as_str),
            );
        }
        if files.len() == 1 {
            break;
        }
        match (answers(file, &limits, steps), &first) {
            (Err(fault), _) => tell("answers", Err(&fault.to_string())),
            (Ok(rows), None) => first = Some((file, rows)),
            (Ok(rows), Some((other, expected))) => {
                let rule = format!("the same answers as {}", other.display());
                match differs(expected, &rows) {
                    None => tell(&rule, Ok("bit for bit")),
                    Some(k) => {
                        let problem = format!(
                            "differ first at step {k}: {:?} where it was {:?}",
                            rows.get(k),
                            expected.get(k)
                        );
                        tell(&rule, Err(&problem));
                    }
                }
            }
        }
    }
    code
}

/// The first row that differs in any bit.
fn differs(a: &[Vec<f64>], b: &[Vec<f64>]) -> Option<usize> {
    let bits = |row: &[f64]| row.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    let differ = |(a, b): (&Vec<f64>, &Vec<f64>)| bits(a) != bits(b);
    let apart = a.iter().zip(b).position(differ);
    apart.or((a.len() != b.len()).then(|| a.len().min(b.len())))
}
