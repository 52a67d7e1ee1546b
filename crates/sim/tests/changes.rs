//! Numbers that change while a run goes on: by hand, and again as the scenario that was written down.

use std::path::Path;

use appell_sim::change::Session;
use appell_sim::record::{Memory, Recorder, Recording};
use appell_sim::run::{Outcome, Run};
use appell_sim::scenario::{self, Loaded};

fn load(name: &str) -> Loaded {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../scenarios/{name}.toml"));
    scenario::load(&file, &[]).unwrap_or_else(|error| panic!("{error}"))
}

fn begin(loaded: &Loaded) -> (Session, Memory) {
    let run = Run::new(loaded, 0).unwrap_or_else(|error| panic!("{error}"));
    let mut memory = Memory::new();
    memory.begin(&run.header).expect("opens");
    (Session::new(run), memory)
}

fn finish(mut session: Session, mut memory: Memory) -> (Recording, Outcome) {
    while session.advance(10_000, &mut memory).expect("records") {}
    (memory.into_recording(), session.summary().verdict)
}

fn assert_same(one: &Recording, other: &Recording) {
    assert_eq!(one.times.len(), other.times.len());
    assert_eq!(one.events, other.events);
    for ((a, b), signal) in one
        .columns
        .iter()
        .zip(&other.columns)
        .zip(&one.header.signals)
    {
        for (k, (a, b)) in a.iter().zip(b).enumerate() {
            assert_eq!(a.to_bits(), b.to_bits(), "{} at row {k}", signal.path);
        }
    }
}

/// Knobs turned at several instants, one of them twice at the same; the pieces in which it ran do not matter.
#[test]
fn invariant_changes_by_hand_repeat_bit_for_bit() {
    let (mut session, mut memory) = begin(&load("slalom"));
    session.advance(2345, &mut memory).expect("records");
    session
        .run
        .change("robot.tri.controller.lookahead", 0.5)
        .expect("changes");
    session
        .run
        .change("robot.tri.controller.lookahead", 0.4)
        .expect("changes");
    session.advance(1, &mut memory).expect("records");
    session
        .run
        .change("robot.tri.platform.body.mass", 14.0)
        .expect("changes");
    session.advance(1111, &mut memory).expect("records");
    session
        .run
        .change("robot.tri.controller.speed", 0.6)
        .expect("changes");
    let text = session.run.repetition().expect("was changed").to_toml();
    let (by_hand, verdict) = finish(session, memory);
    assert_eq!(verdict, Outcome::Passed);
    let told: Vec<&str> = by_hand
        .events
        .iter()
        .filter(|event| event.kind == "change")
        .map(|event| event.text.as_str())
        .collect();
    assert_eq!(told.len(), 3, "{told:?}");
    assert!(told[0].ends_with("0.4"), "{told:?}");

    let file = load("slalom").file;
    let loaded = scenario::load_text(&text, &file, &[]).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(loaded.scenario.change.len(), 3);
    let (session, memory) = begin(&loaded);
    let (by_itself, _) = finish(session, memory);
    assert_same(&by_hand, &by_itself);

    // And as the command line runs it.
    let mut memory = Memory::new();
    let mut run = Run::new(&loaded, 0).unwrap_or_else(|error| panic!("{error}"));
    run.execute(&mut memory, &mut |_| {}).expect("runs");
    assert_same(&by_hand, &memory.into_recording());
}

/// A change to the value that is there already leaves every bit as it is.
#[test]
fn invariant_a_change_to_the_same_value_changes_nothing() {
    for (name, at) in [("slalom", 3001), ("noisy", 1003), ("ice", 777)] {
        let loaded = load(name);
        let (session, memory) = begin(&loaded);
        let (alone, _) = finish(session, memory);
        let (mut session, mut memory) = begin(&loaded);
        session.advance(at, &mut memory).expect("records");
        let numbers = appell_sim::scenario::Template::of(&loaded).numbers();
        let chosen = numbers
            .iter()
            .find(|(known, _)| known.ends_with("platform.body.mass"))
            .unwrap_or_else(|| panic!("{name} has no such number"));
        session.run.change(&chosen.0, chosen.1).expect("changes");
        let (changed, _) = finish(session, memory);
        let events = |recording: &Recording| {
            let events = recording.events.iter();
            events.filter(|event| event.kind != "change").count()
        };
        assert_eq!(events(&alone), events(&changed));
        let changed = Recording {
            events: alone.events.clone(),
            ..changed
        };
        assert_same(&alone, &changed);
    }
}

#[test]
fn refusal_of_changes() {
    let (mut session, mut memory) = begin(&load("slalom"));
    session.advance(100, &mut memory).expect("records");
    for (path, value, words) in [
        ("robot.tri.controller.speed", f64::NAN, "finite"),
        ("robot.tri.controller.speed", f64::INFINITY, "finite"),
        ("robot.tri.controller.speed", -1.0, "must be"),
        ("robot.tri.controller.spede", 1.0, "spede"),
        ("robot.tri.controller.period", 0.02, "while robots drive"),
        (
            "robot.tri.platform.collision_radius",
            0.1,
            "while robots drive",
        ),
        ("arena.beacon.b1.position.0", 1.0, "while robots drive"),
        ("robot.tri.platform.wheel.left.radius", 0.0, "must be"),
    ] {
        let refused = session.run.change(path, value);
        let text = refused.expect_err(path).to_string();
        assert!(text.contains(words), "{path}: {text}");
    }
    // What was refused left nothing behind.
    assert!(session.run.repetition().is_none());
    let (refused, _) = finish(session, memory);
    let (session, memory) = begin(&load("slalom"));
    assert_same(&finish(session, memory).0, &refused);

    let slalom = load("slalom");
    for (change, words) in [
        (
            "at = 99.0\npath = \"robot.tri.controller.speed\"\nvalue = 1.0",
            "change.0.at",
        ),
        (
            "at = 0.00015\npath = \"robot.tri.controller.speed\"\nvalue = 1.0",
            "multiple",
        ),
        (
            "at = 1.0\npath = \"arena.size.0\"\nvalue = 1.0",
            "change.0.path",
        ),
    ] {
        let text = format!("{}\n[[change]]\n{change}\n", slalom.resolved);
        let loaded =
            scenario::load_text(&text, &slalom.file, &[]).unwrap_or_else(|e| panic!("{e}"));
        let refused = Run::new(&loaded, 0).err().expect(words).to_string();
        assert!(refused.contains(words), "{refused}");
    }
}
