//! What is done to lines, without network or clock: each is a scenario that repeats it bit for bit.

use std::path::{Path, PathBuf};

use appell_sim::record::{Memory, Recording};
use appell_sim::run::{Outcome, Run};
use appell_sim::scenario;
use appell_studio::studio::{Command, Line, Native, Studio};
use serde_json::{Value, json};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn open(name: &str) -> Studio {
    let file = root().join(format!("scenarios/{name}.toml"));
    Studio::open(&file, &[], Native::Refused).unwrap_or_else(|error| panic!("{error}"))
}

fn say(studio: &mut Studio, command: Value) -> Result<Value, String> {
    let command: Command = serde_json::from_value(command).expect("a command");
    studio.handle(command).map_err(|error| error.to_string())
}

fn told(studio: &mut Studio, command: Value) -> Value {
    say(studio, command.clone()).unwrap_or_else(|error| panic!("{command}: {error}"))
}

fn drive(studio: &mut Studio, ticks: u64) {
    for _ in 0..ticks {
        if !studio.advance(1) {
            return;
        }
    }
}

/// The line has the rows that a run of its scenario has, as far as it has come.
fn assert_repeats(line: &Line) {
    let loaded = line.document().unwrap_or_else(|error| panic!("{error}"));
    let mut memory = Memory::new();
    let mut run = Run::new(&loaded, 0).unwrap_or_else(|error| panic!("{error}"));
    run.execute(&mut memory, &mut |_| {}).expect("runs");
    let recording: Recording = memory.into_recording();
    let history = line.history.lock().expect("nobody panicked");
    assert!(history.rows() > 10);
    for k in 0..history.rows() {
        assert_eq!(history.times[k].to_bits(), recording.times[k].to_bits());
        for (column, signal) in recording.columns.iter().zip(&recording.header.signals) {
            let own = history.column(&signal.path).expect("recorded");
            let here = history.value(k, own);
            assert_eq!(
                here.to_bits(),
                column[k].to_bits(),
                "{} row {k}",
                signal.path
            );
        }
    }
    for ((_, here), there) in history.events.iter().zip(&recording.events) {
        assert_eq!(here, there);
    }
}

#[test]
fn invariant_what_is_done_repeats_bit_for_bit() {
    let mut studio = open("slalom");
    let speed = "robot.tri.controller.speed";
    drive(&mut studio, 1500);
    told(
        &mut studio,
        json!({"do": "change", "path": speed, "value": 0.6, "gesture": 1}),
    );
    drive(&mut studio, 33);
    told(
        &mut studio,
        json!({"do": "change", "path": speed, "value": 0.7, "gesture": 1}),
    );
    drive(&mut studio, 900);
    told(
        &mut studio,
        json!({"do": "engage", "robot": "tri", "with": "stanley"}),
    );
    drive(&mut studio, 700);
    told(
        &mut studio,
        json!({"do": "engage", "robot": "tri", "with": "hand"}),
    );
    let forward = "robot.tri.standby.hand.controller.channel.forward.signal.value";
    for (ticks, value) in [(101, 0.4), (507, -0.2), (303, 0.0)] {
        drive(&mut studio, ticks);
        told(
            &mut studio,
            json!({"do": "change", "path": forward, "value": value}),
        );
    }
    drive(&mut studio, 500);
    assert_repeats(studio.active());
    // A branch in the past keeps what was done before it alone.
    told(&mut studio, json!({"do": "branch", "at": 2.0}));
    drive(&mut studio, 1000);
    assert_repeats(studio.active());
    assert_eq!(studio.active().parent, Some(("A".to_owned(), 2.0)));
    assert_eq!(studio.state()["changes"].as_array().map(Vec::len), Some(2));
    // A change in the past makes one, too.
    told(
        &mut studio,
        json!({"do": "change", "path": speed, "value": 1.1, "at": 1.0}),
    );
    drive(&mut studio, 1000);
    assert_repeats(studio.active());
    // Another arena from the beginning, driven to the same instant.
    let rows = studio.active().rows();
    told(
        &mut studio,
        json!({"do": "edit", "set": [["arena.beacon.b5.position", "[6.8, 2.2]"]]}),
    );
    assert_eq!(studio.active().rows(), rows);
    assert_repeats(studio.active());
}

#[test]
fn invariant_undo_drives_what_was_before() {
    let mut studio = open("slalom");
    drive(&mut studio, 1000);
    let before = studio.active().document().expect("a scenario").resolved;
    for gesture in [7, 7, 8] {
        let path = "robot.tri.platform.body.mass";
        let value = 10.0 + f64::from(gesture);
        told(
            &mut studio,
            json!({"do": "change", "path": path, "value": value, "gesture": gesture}),
        );
        drive(&mut studio, 100);
    }
    let after = studio.active().document().expect("a scenario").resolved;
    let rows = studio.active().rows();
    told(&mut studio, json!({"do": "undo"}));
    told(&mut studio, json!({"do": "undo"}));
    assert!(say(&mut studio, json!({"do": "undo"})).is_err());
    assert_eq!(
        studio.active().document().expect("a scenario").resolved,
        before
    );
    assert_eq!(studio.active().rows(), rows, "it stands where it stood");
    assert_repeats(studio.active());
    told(&mut studio, json!({"do": "redo"}));
    told(&mut studio, json!({"do": "redo"}));
    assert_eq!(
        studio.active().document().expect("a scenario").resolved,
        after
    );
    assert_repeats(studio.active());
    // Undoing a branch goes back to the line it came from.
    told(&mut studio, json!({"do": "branch", "at": 0.5}));
    assert_eq!(studio.active().name, "B");
    told(&mut studio, json!({"do": "undo"}));
    assert_eq!(studio.active().name, "A");
    assert_eq!(studio.lines().len(), 1);
}

#[test]
fn invariant_ghosts_change_nothing() {
    let mut studio = open("slalom");
    told(
        &mut studio,
        json!({"do": "ghost", "level": "kinematic", "on": true}),
    );
    drive(&mut studio, 500);
    told(
        &mut studio,
        json!({"do": "change", "path": "robot.tri.controller.speed", "value": 0.5}),
    );
    drive(&mut studio, 60_000);
    assert!(studio.active().is_over());
    assert_repeats(studio.active());
    let ghost = &studio.lines()[1];
    assert!(ghost.is_over());
    assert_repeats(ghost);
}

#[test]
fn refusal_of_commands() {
    let mut studio = open("slalom");
    drive(&mut studio, 300);
    let before = studio.active().document().expect("a scenario").resolved;
    for (command, words) in [
        (json!({"do": "speed", "factor": 1000.0}), "0.01"),
        (
            json!({"do": "change", "path": "robot.tri.controller.speed", "value": -1.0}),
            "must be",
        ),
        (
            json!({"do": "change", "path": "robot.tri.controller.speed", "value": -1.0, "at": 0.1}),
            "must be",
        ),
        (
            json!({"do": "change", "path": "robot.tri.no.such", "value": 1.0}),
            "no",
        ),
        (
            json!({"do": "swap", "robot": "tri", "to": "nobody"}),
            "nobody",
        ),
        (
            json!({"do": "engage", "robot": "tri", "with": "magic"}),
            "law",
        ),
        (json!({"do": "branch", "at": 1e9}), "at"),
        (json!({"do": "branch", "at": -1.0}), "at"),
        (json!({"do": "activate", "line": 99}), "99"),
        (
            json!({"do": "edit", "set": [["arena.beacon.b1.position", "[nan, 2.0]"]]}),
            "arena",
        ),
        (
            json!({"do": "edit", "set": [["robot.tri.count", "5"]]}),
            "count",
        ),
        (json!({"do": "open", "name": "../robots/jackal"}), "one of"),
        (json!({"do": "open", "name": "/etc/passwd"}), "one of"),
        (json!({"do": "save", "name": "../evil"}), "letters"),
        (json!({"do": "save", "name": "a/b"}), "letters"),
        (json!({"do": "save", "name": ""}), "letters"),
        (json!({"do": "save", "name": "slalom"}), "already"),
    ] {
        let refused = say(&mut studio, command.clone()).expect_err(&command.to_string());
        assert!(refused.contains(words), "{command}: {refused}");
    }
    assert_eq!(studio.lines().len(), 1);
    assert_eq!(
        studio.active().document().expect("a scenario").resolved,
        before
    );
    // Numbers that are none are not even JSON.
    for text in [
        r#"{"do": "change", "path": "a", "value": NaN}"#,
        r#"{"do": "change", "path": "a", "value": 1e999}"#,
        r#"{"do": "change", "path": "a", "value": null}"#,
    ] {
        assert!(serde_json::from_str::<Command>(text).is_err(), "{text}");
    }
}

/// A recording is looked at as it is, and driven on from any instant of it.
#[test]
fn invariant_a_recording_is_opened_and_branched() {
    let folder = std::env::temp_dir().join(format!("appell-studio-test-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let mut studio = open("slalom");
    drive(&mut studio, 60_000);
    let file = folder.join("run.mcap");
    studio.active().write_recording(&file).expect("writes");
    let mut again =
        Studio::open(&file, &[], Native::Refused).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(again.active().rows(), studio.active().rows());
    assert!(say(&mut again, json!({"do": "play"})).is_err());
    told(&mut again, json!({"do": "branch", "at": 3.0}));
    drive(&mut again, 1000);
    assert_repeats(again.active());
    // A saved scenario takes the place of a link, and does not follow it.
    let scenario = folder.join("own.toml");
    std::fs::write(
        &scenario,
        &scenario::load(&root().join("scenarios/slalom.toml"), &[])
            .expect("loads")
            .resolved,
    )
    .expect("writes");
    let mut own =
        Studio::open(&scenario, &[], Native::Refused).unwrap_or_else(|error| panic!("{error}"));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/etc/hostname", folder.join("link.toml")).expect("a link");
        assert!(
            say(
                &mut own,
                json!({"do": "save", "name": "link", "replace": true})
            )
            .is_err()
        );
        assert!(!own.scenarios().contains(&"link".to_owned()));
    }
    told(&mut own, json!({"do": "save", "name": "mine"}));
    assert!(say(&mut own, json!({"do": "save", "name": "mine"})).is_err());
    told(
        &mut own,
        json!({"do": "save", "name": "mine", "replace": true}),
    );
    scenario::load(&folder.join("mine.toml"), &[]).unwrap_or_else(|error| panic!("{error}"));
    std::fs::remove_dir_all(&folder).expect("removes");
}

/// A trial of a batch that is opened from its folder has the figures that the batch has of it.
#[test]
fn peer_replayed_trials_have_the_figures_of_the_batch() {
    use appell_sim::batch::{Batch, Crew, Shard, Store, parse};
    let folder = std::env::temp_dir().join(format!("appell-studio-batch-{}", std::process::id()));
    let file = root().join("scenarios/noisy.toml");
    let vary = parse("robot.burger.platform.body.mass=uniform(0.8, 1.2)").expect("a draw");
    let batch = Batch::new(&file, &[], Some(5), &[vary], None).expect("a batch");
    let store = Store::open(&folder, batch.manifest()).expect("a folder");
    let text = &batch.manifest().text;
    std::fs::write(folder.join("scenario.toml"), text).expect("writes");
    batch
        .execute(&store, Shard::WHOLE, Crew::default(), &|_| {})
        .expect("runs");
    let mut studio =
        Studio::open(&folder, &[], Native::Refused).unwrap_or_else(|error| panic!("{error}"));
    let entries = std::fs::read_dir(folder.join("trials")).expect("a folder");
    let rows = entries
        .map(|entry| entry.expect("an entry").path())
        .find(|file| file.extension().is_some_and(|end| end == "parquet"))
        .expect("rows");
    let by_rows = Studio::open(&rows, &[], Native::Refused).expect("its rows name a batch");
    assert_eq!(by_rows.batch(), studio.batch());
    let figures: Value = serde_json::from_str(&studio.batch().expect("is open")).expect("JSON");
    let columns = figures["columns"].as_array().expect("columns");
    let column = |name: &str| {
        columns
            .iter()
            .position(|one| one["name"] == name)
            .expect(name)
    };
    assert_eq!(figures["variants"][0]["count"], 5);
    for trial in [3, 1] {
        told(&mut studio, json!({"do": "trial", "trial": trial}));
        let state = studio.state();
        let line = state["lines"]
            .as_array()
            .expect("lines")
            .last()
            .expect("one");
        assert_eq!(line["name"], format!("trial {trial}"));
        assert_eq!(line["verdict"], "passed");
        let metrics = line["metrics"][0]["metrics"].as_array().expect("metrics");
        for name in ["time", "path length", "settle time"] {
            let value =
                metrics.iter().find(|one| one["name"] == name).expect(name)["value"].as_f64();
            let stored = figures["variants"][0]["values"][column(name)][trial as usize].as_f64();
            assert_eq!(value, stored, "{name} of trial {trial}");
        }
    }
    let refused = say(&mut studio, json!({"do": "trial", "trial": 5}));
    assert!(refused.expect_err("there are five").contains("5 trials"));
    // A scenario of it has the same noise, and what was drawn for it; from the command line, too.
    assert_repeats(studio.active());
    told(&mut studio, json!({"do": "save", "name": "mine"}));
    let saved = scenario::load(&folder.join("mine.toml"), &[]).expect("loads");
    assert_eq!((saved.scenario.trial, &saved.scenario.batch), (1, &None));
    let mut memory = Memory::new();
    let mut run = Run::new(&saved, 0).expect("builds");
    run.execute(&mut memory, &mut |_| {}).expect("runs");
    let (repeated, line) = (memory.into_recording(), studio.active());
    let history = line.history.lock().expect("nobody panicked");
    assert_eq!(repeated.times, history.times);
    for (signal, column) in repeated.header.signals.iter().zip(&repeated.columns) {
        let own = history.column(&signal.path).expect("recorded");
        let same = |(k, value): (usize, &f64)| value.to_bits() == history.value(k, own).to_bits();
        assert!(column.iter().enumerate().all(same), "{}", signal.path);
    }
    drop(history);
    let refused = Batch::new(&folder.join("mine.toml"), &[], Some(5), &[], None).err();
    assert!(refused.is_some_and(|error| error.to_string().contains("left out")));
    std::fs::remove_dir_all(&folder).expect("removes");
}

/// A plug-in is loaded, takes over, is taken anew and left out while a line goes on; what was kept repeats it.
#[test]
fn golden_plugins_come_and_go() {
    let folder = std::env::temp_dir().join(format!("appell-studio-plugins-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("robots")).expect("a folder");
    std::fs::create_dir_all(folder.join("scenarios")).expect("a folder");
    let copy = |from: &str, to: &str| {
        std::fs::copy(root().join(from), folder.join(to)).expect("copies");
    };
    copy("scenarios/slalom.toml", "scenarios/slalom.toml");
    copy("robots/three-wheeler.toml", "robots/three-wheeler.toml");
    copy("examples/plugins/slalom.py", "scenarios/slalom.py");
    let mut studio = Studio::open(&folder.join("scenarios/slalom.toml"), &[], Native::Refused)
        .unwrap_or_else(|error| panic!("{error}"));
    drive(&mut studio, 500);
    let files = studio.state()["plugins"]["files"].clone();
    assert_eq!(files[0]["file"], "slalom.py");
    assert_eq!(files[0]["host"], "python");
    assert_eq!(files[0]["hash"].as_str().map(str::len), Some(64));
    for (command, word) in [
        (
            json!({"do": "load", "robot": "tri", "file": "../robots/x.py"}),
            "beside",
        ),
        (
            json!({"do": "load", "robot": "nobody", "file": "slalom.py"}),
            "no robot",
        ),
        (
            json!({"do": "reload", "robot": "tri", "name": "controller"}),
            "plug-in",
        ),
        (
            json!({"do": "unload", "robot": "tri", "name": "controller"}),
            "drives",
        ),
        (
            json!({"do": "unload", "robot": "tri", "name": "nobody"}),
            "stands by",
        ),
    ] {
        let refusal = say(&mut studio, command.clone()).expect_err("is refused");
        assert!(refusal.contains(word), "{command}: {refusal}");
    }
    // What runs on this machine itself is for whoever started the studio to allow, not for a page.
    for name in ["rogue.so", "rogue.fmu"] {
        std::fs::write(folder.join("scenarios").join(name), "nothing").expect("writes");
        let load = json!({"do": "load", "robot": "tri", "file": name});
        let refusal = say(&mut studio, load.clone()).expect_err("is refused");
        assert!(refusal.contains("--allow-native"), "{name}: {refusal}");
        let file = folder.join("scenarios/slalom.toml");
        let mut other = Studio::open(&file, &[], Native::Apart).expect("it opens");
        let refusal = say(&mut other, load).expect_err("it is no library");
        assert!(!refusal.contains("--allow-native"), "{name}: {refusal}");
        std::fs::remove_file(folder.join("scenarios").join(name)).expect("it was there");
    }
    // One that cannot be opened leaves everything as it was.
    std::fs::write(folder.join("scenarios/broken.py"), "no python at all").expect("writes");
    let rows = studio.active().rows();
    assert!(
        say(
            &mut studio,
            json!({"do": "load", "robot": "tri", "file": "broken.py"})
        )
        .is_err()
    );
    assert_eq!(studio.active().rows(), rows);
    told(
        &mut studio,
        json!({"do": "load", "robot": "tri", "file": "slalom.py"}),
    );
    told(
        &mut studio,
        json!({"do": "swap", "robot": "tri", "to": "slalom"}),
    );
    drive(&mut studio, 500);
    assert_eq!(studio.state()["robots"][0]["driving"], "slalom");
    told(
        &mut studio,
        json!({"do": "reload", "robot": "tri", "name": "slalom"}),
    );
    assert_eq!(studio.state()["robots"][0]["driving"], "slalom-v1");
    assert!(folder.join("scenarios/slalom-v1.py").exists());
    drive(&mut studio, 500);
    assert_repeats(studio.active());
    // What an old change names stays; what nothing names goes.
    let unload = |name: &str| json!({"do": "unload", "robot": "tri", "name": name});
    assert!(say(&mut studio, unload("slalom")).is_err());
    told(
        &mut studio,
        json!({"do": "reload", "robot": "tri", "name": "slalom"}),
    );
    let names = |studio: &Studio| studio.state()["plugins"]["named"].to_string();
    assert!(names(&studio).contains("slalom-v2"));
    told(&mut studio, unload("slalom-v2"));
    assert!(!names(&studio).contains("slalom-v2"));
    assert_repeats(studio.active());
    std::fs::remove_dir_all(&folder).expect("removes");
}

/// Robots and tasks are chosen from what is found; each line repeats, and what does not fit is refused with words.
#[test]
fn invariant_what_is_found_is_chosen() {
    let mut studio = open("slalom");
    let found = studio.state()["found"].clone();
    let lists = |list: &str, name: &str| {
        let names = found[list].as_array().expect("a list");
        names.iter().any(|one| one == name)
    };
    assert!(lists("platforms", "pioneer-3dx"));
    assert!(lists("tasks", "gate"));
    drive(&mut studio, 500);
    told(
        &mut studio,
        json!({"do": "platform", "robot": "tri", "file": "turtlebot3-burger"}),
    );
    let platform = studio.state()["robots"][0]["platform"].clone();
    assert!(
        platform.as_str().is_some_and(|name| name.contains("urger")),
        "{platform}"
    );
    drive(&mut studio, 500);
    assert_repeats(studio.active());
    for kind in ["gate", "eight", "homing", "slalom"] {
        told(
            &mut studio,
            json!({"do": "task", "robot": "tri", "kind": kind}),
        );
        assert_eq!(studio.state()["robots"][0]["task"], kind);
    }
    told(
        &mut studio,
        json!({"do": "task", "robot": "tri", "of": "gate"}),
    );
    assert_eq!(studio.state()["beacons"].as_array().map(Vec::len), Some(2));
    drive(&mut studio, 60_000);
    assert_repeats(studio.active());
    let summary = studio.active().summary().expect("is over");
    assert_eq!(summary.verdict, Outcome::Passed);
    told(&mut studio, json!({"do": "undo"}));
    assert_eq!(studio.state()["robots"][0]["task"], "slalom");
    for (command, word) in [
        (
            json!({"do": "platform", "robot": "tri", "file": "../scenarios/slalom"}),
            "one of",
        ),
        (
            json!({"do": "platform", "robot": "nobody", "file": "jackal"}),
            "no robot",
        ),
        (
            json!({"do": "task", "robot": "tri", "kind": "route"}),
            "beacons enough",
        ),
        (
            json!({"do": "task", "robot": "tri", "of": "/etc/passwd"}),
            "one of",
        ),
        (
            json!({"do": "task", "robot": "tri", "of": "parked"}),
            "no robot with a task",
        ),
        (json!({"do": "task", "robot": "tri"}), "a kind of task"),
        (json!({"do": "beside", "recording": "../x"}), "one of"),
    ] {
        let refusal = say(&mut studio, command.clone()).expect_err("is refused");
        assert!(refusal.contains(word), "{command}: {refusal}");
    }
}

/// Recordings of other runs are laid beside a line, and are what they were.
#[test]
fn invariant_a_recording_is_laid_beside() {
    let folder = std::env::temp_dir().join(format!("appell-studio-beside-{}", std::process::id()));
    let mut studio = open("slalom");
    drive(&mut studio, 60_000);
    for run in ["one", "two"] {
        std::fs::create_dir_all(folder.join(run)).expect("a folder");
        let file = folder.join(run).join("recording.mcap");
        studio.active().write_recording(&file).expect("writes");
    }
    let file = folder.join("one/recording.mcap");
    let mut again =
        Studio::open(&file, &[], Native::Refused).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(again.state()["found"]["recordings"], json!(["one", "two"]));
    told(&mut again, json!({"do": "beside", "recording": "two"}));
    assert_eq!(again.lines().len(), 2);
    assert_eq!(
        again.active().name,
        "A",
        "the line that goes on is the same"
    );
    let beside = &again.lines()[1];
    assert_eq!(beside.name, "two");
    assert_eq!(beside.rows(), studio.active().rows());
    told(&mut again, json!({"do": "branch", "at": 1.0}));
    let two = again.lines().iter().find(|line| line.name == "two");
    let two = two.expect("stays").id;
    told(&mut again, json!({"do": "activate", "line": two}));
    std::fs::remove_dir_all(&folder).expect("removes");
}
