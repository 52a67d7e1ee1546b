//! `appell import`: a robot file from a URDF.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use appell_sim::design::design;
use appell_sim::scenario;
use appell_sim::urdf::{self, Answers, Imported};

use crate::arguments::ImportOptions;
use crate::{exit, terminal};

/// Writes the robot file, and prints what is to be said of it.
pub fn import(options: &ImportOptions) -> u8 {
    let imported = answers(options).and_then(|answers| {
        let text = text(options)?;
        let at = |problem| format!("{}: {problem}", options.file.display());
        urdf::import(&text, &answers).map_err(at)
    });
    let imported = match imported {
        Ok(imported) => imported,
        Err(problem) => {
            terminal::error(&problem);
            return exit::BAD_INPUT;
        }
    };
    let out = match &options.out {
        Some(out) => out.clone(),
        None => {
            let name = options.file.file_stem().unwrap_or_default();
            Path::new(name).with_extension("toml")
        }
    };
    write(&imported, &out)
}

fn answers(options: &ImportOptions) -> Result<Answers, String> {
    for (option, value) in [
        ("torque-max", options.torque_max),
        ("rate-max", options.rate_max),
        ("mass", options.mass),
        ("collision-radius", options.collision_radius),
    ] {
        if let Some(value) = value
            && !(value > 0.0 && value.is_finite())
        {
            return Err(format!(
                "--{option}: must be a finite number > 0, got {value}"
            ));
        }
    }
    let mut rollers = BTreeMap::new();
    for given in &options.rollers {
        let parted = given.split_once('=');
        let parted = parted.and_then(|(joint, angle)| Some((joint, angle.parse::<f64>().ok()?)));
        match parted.filter(|(_, angle)| angle.is_finite()) {
            Some((joint, angle)) => rollers.insert(joint.to_owned(), angle),
            None => return Err(format!("--rollers: must be JOINT=ANGLE, got {given}")),
        };
    }
    Ok(Answers {
        driven: options.driven.clone(),
        torque_max: options.torque_max,
        rate_max: options.rate_max,
        rollers,
        mass: options.mass,
        collision_radius: options.collision_radius,
    })
}

/// The text of the file, which has to lie below one of the roots.
fn text(options: &ImportOptions) -> Result<String, String> {
    let file = &options.file;
    let shown = file.display();
    let unreadable = |error: std::io::Error| format!("{shown}: cannot be read: {error}");
    let real = file.canonicalize().map_err(unreadable)?;
    let own = match file.parent() {
        Some(parent) if parent != Path::new("") => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    let roots = match options.root.is_empty() {
        true => vec![own],
        false => options.root.clone(),
    };
    let mut is_inside = false;
    for root in &roots {
        let known = root.canonicalize();
        let known = known.map_err(|error| format!("--root {}: {error}", root.display()))?;
        is_inside |= real.starts_with(known);
    }
    if !is_inside {
        let roots: Vec<String> = roots
            .iter()
            .map(|root| root.display().to_string())
            .collect();
        return Err(format!(
            "{shown}: must lie below {}, got {}\n  hint: name its folder with --root",
            roots.join(" or "),
            real.display()
        ));
    }
    let mut text = String::new();
    let opened = std::fs::File::open(&real).map_err(unreadable)?;
    let mut limited = opened.take(urdf::SIZE_MAX + 1);
    limited.read_to_string(&mut text).map_err(unreadable)?;
    match text.len() as u64 > urdf::SIZE_MAX {
        true => Err(format!("{shown}: must be at most {} bytes", urdf::SIZE_MAX)),
        false => Ok(text),
    }
}

fn write(imported: &Imported, out: &Path) -> u8 {
    if let Err(error) = std::fs::write(out, imported.platform.to_toml()) {
        terminal::error(&format!("{}: cannot be written: {error}", out.display()));
        return exit::OUTPUT;
    }
    let mut lines = Vec::new();
    lines.extend(
        imported
            .warnings
            .iter()
            .map(|one| format!("implausible: {one}")),
    );
    let checked = scenario::load_robot(out);
    if let Ok(platform) = &checked {
        let report = design(platform, 9.81);
        lines.extend(
            report
                .warnings
                .iter()
                .map(|one| format!("implausible: {one}")),
        );
    }
    lines.extend(imported.remarks.iter().cloned());
    for line in lines {
        terminal::remark(&line);
    }
    match checked {
        Ok(platform) => {
            let driven = platform
                .wheel
                .iter()
                .filter(|wheel| wheel.drive != scenario::Drive::None);
            terminal::print(&format!(
                "{}: {} wheels, {} driven; {:.3} kg",
                out.display(),
                platform.wheel.len(),
                driven.count(),
                platform.body.mass + platform.wheel.iter().map(|wheel| wheel.mass).sum::<f64>()
            ));
            exit::PASSED
        }
        Err(diagnostics) => {
            terminal::error(&format!(
                "{diagnostics}\n  hint: the robot file was written; complete it by hand"
            ));
            exit::BAD_INPUT
        }
    }
}
