//! Uneven ground of scenario files: what a run on it does, and what is refused.

use std::path::{Path, PathBuf};

use crate::record::{Memory, Recording};
use crate::run::{Outcome, Run, Summary};
use crate::scenario::{Diagnostics, Loaded, load_text};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios")
}

/// A robot that drives straight ahead from (1, 2) at 0.4 m/s, on these features.
fn scenario(robot: &str, level: &str, duration: f64, relief: &str) -> Result<Loaded, Diagnostics> {
    let text = format!(
        "schema = 1\nname = \"test\"\n[time]\nduration = {duration:?}\n[arena]\nsize = [6.0, 4.0]\n\
         [[arena.beacon]]\nname = \"b\"\nposition = [5.5, 3.5]\n\
         [terrain]\nkind = \"uneven\"\nfriction = 0.8\n{relief}\n\
         [[robot]]\nname = \"it\"\nfile = \"../robots/{robot}.toml\"\nlevel = \"{level}\"\npose = [1.0, 2.0, 0.0]\n\
         [robot.controller]\nkind = \"signals\"\n\
         channel = [{{ to = \"forward\", signal = {{ kind = \"step\", at = 100.0, before = 0.4, after = 0.0 }} }}]\n"
    );
    load_text(&text, &folder().join("test.toml"), &[])
}

fn run(loaded: &Loaded) -> (Recording, Summary) {
    let mut run = Run::new(loaded, 0).unwrap_or_else(|error| panic!("{error}"));
    let mut memory = Memory::new();
    let summary = run
        .execute(&mut memory, &mut |_| {})
        .unwrap_or_else(|error| panic!("{error}"));
    (memory.into_recording(), summary)
}

fn last(recording: &Recording, signal: &str) -> f64 {
    let column = recording.column(&format!("robot.it.{signal}"));
    *column.expect("recorded").last().expect("rows")
}

fn refused(loaded: Result<Loaded, Diagnostics>) -> String {
    let built = loaded.and_then(|loaded| Run::new(&loaded, 0).map(|_| ()));
    built.expect_err("refused").to_string()
}

/// At every level a ramp lifts the robot by its rise, and pitches it by its slope on the way.
#[test]
fn known_answer_a_ramp_at_every_level() {
    let ramp = "relief = [{ kind = \"ramp\", at = [1.5, 0.0], rise = 0.1, length = 0.8 }]";
    for level in ["kinematic", "rolling", "slip"] {
        let loaded = scenario("youbot-base", level, 6.0, ramp).expect("a scenario");
        let (recording, summary) = run(&loaded);
        assert_eq!(summary.robots[0].verdict, Outcome::Stopped);
        assert!(last(&recording, "pose.x") > 2.8, "{level}");
        assert!((last(&recording, "pose.z") - 0.1).abs() < 1e-3, "{level}");
        let pitch = recording.column("robot.it.pose.pitch").expect("recorded");
        let steepest = pitch.iter().copied().fold(0.0, f64::min);
        // tan⁻¹(0.1/0.8), less where not all wheels are on it, more where front wheels are higher.
        assert!((steepest + 0.124).abs() < 0.01, "{level}: {steepest}");
    }
}

/// What ends a run on uneven ground says why.
#[test]
fn known_answer_walls_and_falls_end_a_run() {
    let wall = "relief = [{ kind = \"step\", at = [2.0, 0.0], rise = 0.3 }]";
    let loaded = scenario("summit-xl", "slip", 6.0, wall).expect("a scenario");
    let (recording, summary) = run(&loaded);
    let end = last(&recording, "pose.x");
    // Its front wheels, 0.229 m ahead, touch by their radius of 0.127 m.
    assert!((end - (2.0 - 0.229 - 0.127)).abs() < 0.01, "{end}");
    let text = summary.error.unwrap_or_default();
    assert!(text.contains("stands before a wall"), "{text}");

    // A cliff beside the left wheels.
    let cliff = "relief = [{ kind = \"ramp\", at = [1.3, 0.0], heading_deg = 0.0, rise = -8.0, length = 2.0 }]";
    let loaded = scenario("pioneer-3dx", "rolling", 8.0, cliff).expect("a scenario");
    let (_, summary) = run(&loaded);
    let text = summary.error.unwrap_or_default();
    assert!(text.contains("tips over"), "{text}");
}

/// The same scenario gives the same bits, at every level.
#[test]
fn invariant_same_bits_again() {
    let rough = "[[terrain.relief]]\nkind = \"roughness\"\nclass = \"C\"\nsize = [6.0, 4.0]\nshortest = 0.4\n";
    for level in ["kinematic", "rolling", "slip"] {
        let loaded = scenario("summit-xl", level, 1.0, rough).expect("a scenario");
        let (one, _) = run(&loaded);
        let (two, _) = run(&loaded);
        let bits = |recording: &Recording| {
            let z = recording.column("robot.it.pose.z").expect("recorded");
            z.iter().map(|z| z.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(bits(&one), bits(&two));
        // It is rough.
        let z = one.column("robot.it.pose.z").expect("recorded");
        assert!(z.iter().any(|z| (z - z0(&one)).abs() > 1e-3));
    }
}

fn z0(recording: &Recording) -> f64 {
    recording.column("robot.it.pose.z").expect("recorded")[0]
}

/// Heights of a picture lie where the file says.
#[test]
fn known_answer_a_picture_under_the_wheels() {
    let name = format!("appell-relief-{}.pgm", std::process::id());
    let file = std::env::temp_dir().join(&name);
    // 25 by 17 pixels, 0.25 m apart: a plateau of white from x = 2 on.
    let row = |_| (0..25_u8).map(|x| if x >= 8 { 255 } else { 0 });
    let pixels: Vec<u8> = (0..17).flat_map(row).collect();
    let mut bytes = b"P5 25 17 255\n".to_vec();
    bytes.extend(pixels);
    std::fs::write(&file, bytes).expect("a file");
    let map = format!(
        "relief = [{{ kind = \"map\", file = {file:?}, resolution = 0.25, low = 0.0, high = 0.08 }}]"
    );
    let loaded = scenario("youbot-base", "kinematic", 5.0, &map).expect("a scenario");
    let (recording, _) = run(&loaded);
    std::fs::remove_file(&file).expect("it was there");
    assert!((last(&recording, "pose.z") - 0.08).abs() < 1e-3);
    assert!(z0(&recording).abs() < 1e-3);
}

#[test]
fn refusal_of_bad_relief() {
    let refuse = |robot: &str, level: &str, relief: &str, words: &[&str]| {
        let text = refused(scenario(robot, level, 1.0, relief));
        for word in words {
            assert!(text.contains(word), "{word}: {text}");
        }
    };
    refuse(
        "youbot-base",
        "slip",
        "relief = [{ kind = \"wave\", form = \"sine\", at = [0.0, 0.0], amplitude = 0.1, period = 0.0, length = 1.0 }]",
        &["terrain.relief.0.period", "at least 0.001"],
    );
    refuse(
        "youbot-base",
        "slip",
        "relief = [{ kind = \"step\", at = [0.0, 0.0], rise = nan }]",
        &["terrain.relief.0.rise", "NaN"],
    );
    refuse(
        "youbot-base",
        "slip",
        "relief = [{ kind = \"map\", file = \"no.png\" }]",
        &["terrain.relief.0.file", "no.png"],
    );
    refuse(
        "youbot-base",
        "slip",
        "relief = [{ kind = \"roughness\", class = \"A\", shortest = 0.001, size = [1000.0, 1000.0] }]",
        &["terrain.relief.0.size", "nodes"],
    );
    refuse(
        "youbot-base",
        "slip",
        "relief = [{ kind = \"cliff\" }]",
        &["terrain.relief", "must be one of slope, step", "cliff"],
    );
    refuse("tow-tractor", "rolling", "", &["trailer"]);
    // It would start inside a wall.
    refuse(
        "youbot-base",
        "rolling",
        "relief = [{ kind = \"step\", at = [1.25, 0.0], rise = 0.5 }]",
        &["robot.it.pose", "wall"],
    );
}
