//! `cargo xtask demo`: the studio as a folder of files that any web server can give, with the core as a module of
//! WebAssembly beside the page.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use appell_sim::scenario::{self, Controller, Scenario};

use crate::studio::{page, run};

/// What the core is compiled for: WebAssembly with a clock and files, which the page provides.
pub const TARGET: &str = "wasm32-wasip1";
/// Folders of the project that the page has in memory, and what of them.
const FOLDERS: [&str; 2] = ["scenarios", "robots"];
const EXTENSIONS: [&str; 2] = ["toml", "csv"];

/// A plug-in that the page has beside the scenarios, and what it is compiled for.
const MODULE: &str = "pursuit";
const MODULE_TARGET: &str = "wasm32-unknown-unknown";

/// Where the demo is put, unless it is said.
pub fn default_folder(root: &Path) -> PathBuf {
    root.join("target/studio-demo")
}

/// Builds the demo into a folder, which is emptied first.
///
/// # Errors
/// Something that it takes is missing, or does not compile.
pub fn build(root: &Path, out: &Path) -> Result<(), String> {
    let node = page(root)?;
    for target in [TARGET, MODULE_TARGET] {
        if !crate::checks::has_target(root, target) {
            run(root, "rustup", &["target", "add", target])?;
        }
    }
    let compile = format!("build --package appell-demo --profile demo --target {TARGET}");
    run(root, "cargo", &compile.split(' ').collect::<Vec<_>>())?;
    let example = root.join("examples/plugins").join(MODULE);
    run(
        &example,
        "cargo",
        &["build", "--release", "--target", MODULE_TARGET],
    )?;
    let out = std::path::absolute(out).map_err(|error| error.to_string())?;
    let to = out.to_string_lossy();
    let pack = [
        "vite",
        "build",
        "--mode",
        "demo",
        "--outDir",
        &to,
        "--emptyOutDir",
    ];
    run(&node, "npx", &pack)?;
    let failed = |file: &Path, error: std::io::Error| format!("{}: {error}", file.display());
    let put = |name: &str, bytes: &[u8]| {
        let file = out.join(name);
        std::fs::write(&file, bytes).map_err(|error| failed(&file, error))
    };
    let read = |file: &Path| std::fs::read(file).map_err(|error| failed(file, error));
    let module = read(&root.join(format!("target/{TARGET}/demo/appell_demo.wasm")))?;
    put("appell.wasm", &module)?;
    let plugin = format!("scenarios/{MODULE}.wasm");
    let folder = out.join("scenarios");
    std::fs::create_dir_all(&folder).map_err(|error| failed(&folder, error))?;
    let built = format!("target/{MODULE_TARGET}/release/{MODULE}.wasm");
    put(&plugin, &read(&example.join(built))?)?;
    let files = project(root)?;
    let project = serde_json::json!({"texts": files, "modules": [plugin]});
    put("project.json", project.to_string().as_bytes())?;
    println!(
        "\nThe demo is in {}: {} scenarios and robots, a module of {:.1} MB.\n\
         Any web server can give it, such as: python3 -m http.server --directory {0}",
        out.canonicalize().unwrap_or(out).display(),
        files.keys().filter(|name| name.ends_with(".toml")).count(),
        module.len() as f64 / 1e6,
    );
    Ok(())
}

/// Whether a scenario needs nothing but what is in a page: no programs, and robots one by one.
fn is_for_pages(scenario: &Scenario) -> bool {
    let is_own = |controller: &Controller| matches!(controller, Controller::Plugin(_));
    scenario.robot.iter().all(|robot| {
        robot.count == 1
            && robot.model.is_empty()
            && !robot
                .controllers()
                .any(|(_, controller)| is_own(controller))
    })
}

/// Texts of the project by their paths.
fn project(root: &Path) -> Result<BTreeMap<String, String>, String> {
    let mut files = BTreeMap::new();
    for folder in FOLDERS {
        let failed = |error: std::io::Error| format!("{folder}: {error}");
        for entry in std::fs::read_dir(root.join(folder)).map_err(failed)? {
            let file = entry.map_err(failed)?.path();
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            let extension = file.extension().unwrap_or_default().to_string_lossy();
            if !EXTENSIONS.contains(&&*extension) {
                continue;
            }
            if folder == "scenarios" && extension == "toml" {
                let loaded = scenario::load(&file, &Vec::new())
                    .map_err(|diagnostics| format!("{}: {diagnostics}", file.display()))?;
                if !is_for_pages(&loaded.scenario) {
                    continue;
                }
            }
            let text = std::fs::read_to_string(&file).map_err(failed)?;
            files.insert(format!("{folder}/{name}"), text);
        }
    }
    Ok(files)
}
