//! Children that are threads, over the socket and through the memory.

use std::os::unix::net::UnixStream;
use std::thread::JoinHandle;

use super::*;
use crate::local::Local;
use crate::serve::{Server, converse};

/// Gives what it reads, less a quarter; fails at zero, with a long text at one.
#[derive(Debug)]
struct Echo;

impl Local for Echo {
    fn describe(&mut self) -> Result<Value, Fault> {
        let port = json!([{ "name": "x", "unit": "m" }]);
        Ok(json!({ "protocol": 1, "name": "echo", "inputs": port, "outputs": port }))
    }

    fn create(&mut self, _: u32, _: &[(String, f64)], _: &Value) -> Result<(), Fault> {
        Ok(())
    }

    fn destroy(&mut self, _: u32) {}

    fn step(&mut self, call: &Call<'_>, results: &mut [f64]) -> Result<(), String> {
        results[0] = call.input[0] - 0.25;
        match call.input[0] {
            0.0 => Err("is at zero".into()),
            1.0 => Err("x".repeat(ROOM + 1)),
            _ => Ok(()),
        }
    }

    fn save(&mut self, _: u32) -> Result<Vec<u8>, String> {
        Ok(vec![7])
    }

    fn restore(&mut self, _: u32, _: &[u8]) -> Result<(), String> {
        Ok(())
    }

    fn take_over(&mut self, _: u32, _: &[f64]) -> Result<(), String> {
        Ok(())
    }
}

/// A host, and the other end of its socket, whose child is no more than a name.
fn host(spin: Duration, answer: Duration) -> (Process, UnixStream) {
    let (ours, theirs) = UnixStream::pair().expect("sockets");
    let (shared, place) = Shared::new(spin).expect("memory");
    let child = Command::new("true").spawn().expect("a child");
    let limits = Limits {
        answer,
        spin,
        ..Limits::default()
    };
    let process = Process {
        child,
        stream: Some(ours),
        shared: Some(shared),
        place: Some(place),
        limits,
        message: Vec::new(),
        body: Vec::new(),
        kind: Kind::Library,
        number: 0,
        _folder: None,
    };
    (process, theirs)
}

/// A host whose child is a thread.
fn served(spin: Duration) -> (Process, JoinHandle<io::Result<()>>) {
    let (mut process, mut stream) = host(spin, Duration::from_secs(60));
    let child = std::thread::spawn(move || converse(&mut stream, Server::new(Box::new(Echo))));
    process.describe().expect("a description");
    (process, child)
}

fn step(process: &mut Process, x: f64) -> Result<f64, String> {
    let input = [x];
    let call = Call {
        member: 0,
        t: 0.0,
        dt: 0.01,
        input: &input,
    };
    let mut results = Vec::new();
    match process.step(&[call], 1, &mut results) {
        Ok(()) => Ok(results[0]),
        Err((_, fault)) => Err(fault.problem),
    }
}

/// Through the memory alone, with both sides falling asleep now and then, and over the socket.
#[test]
fn invariant_answers_are_the_same_whichever_way() {
    let told = |spin| {
        let (mut process, child) = served(spin);
        let mut answers = Vec::new();
        for k in 0..2000 {
            let x = match k % 97 {
                0 => 0.0,
                1 => 1.0,
                2 => f64::NAN,
                3 => f64::MIN_POSITIVE,
                _ => f64::from(k) / 7.0,
            };
            answers.push(step(&mut process, x).map(f64::to_bits));
            if k % 10 == 0 {
                answers.push(process.save(0).map(|_| 0).map_err(|fault| fault.problem));
            }
        }
        drop(process);
        child.join().expect("no panic").expect("an orderly end");
        answers
    };
    let over_the_socket = told(Duration::ZERO);
    assert!(over_the_socket.contains(&Err("is at zero".into())));
    for micros in [1, 50, 5_000_000] {
        assert!(
            told(Duration::from_micros(micros)) == over_the_socket,
            "{micros}"
        );
    }
}

/// What a child makes of a question in the memory, and of its end of the socket, and what is said of it by a
/// host that waits awake for a time.
fn told_of(
    [spin, limit]: [Duration; 2],
    act: impl FnOnce(&Shared, &mut UnixStream) + Send,
) -> String {
    let (mut process, mut stream) = host(spin, limit);
    let place = process.place.take().expect("a place");
    let mut child = Shared::open(place.path(), LONG).expect("memory");
    // It is awake, without a question.
    assert!(!child.answer(&[]));
    let problem = std::thread::scope(|scope| {
        scope.spawn(move || {
            assert!(child.is_asked());
            act(&child, &mut stream);
        });
        // What is wrong is noticed in the step, or in what comes after it.
        let stepped = step(&mut process, 2.0).map(|_| process.save(0));
        match stepped {
            Ok(saved) => saved.expect_err("a fault").problem,
            Err(problem) => problem,
        }
    });
    assert!(!process.is_alive() && process.shared.is_none());
    assert_eq!(step(&mut process, 2.0), Err("it failed before".into()));
    problem
}

const LONG: Duration = Duration::from_secs(60);
const SHORT: Duration = Duration::from_millis(50);
const BRIEF: Duration = Duration::from_micros(50);

fn message(kind: u16, number: u16, body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    wire::open(&mut bytes, wire::Tag { kind, number });
    bytes.extend_from_slice(body);
    wire::close(&mut bytes);
    bytes
}

#[test]
fn refusal_of_children_that_end_or_say_nothing() {
    for spin in [BRIEF, SHORT] {
        let ended = told_of([spin, LONG], |_, _| ());
        assert!(ended.starts_with("ended without an answer"), "{ended}");
    }
    // A host that waits awake keeps to the time limit as well.
    for spin in [BRIEF, LONG] {
        let silent = told_of([spin, SHORT], |_, stream| {
            let _ = stream.read_to_end(&mut Vec::new());
        });
        assert_eq!(silent, "gave no answer within 0.05 s");
    }
}

#[test]
fn refusal_of_children_that_lie_in_memory() {
    let told = |lie: &[u8]| {
        told_of([LONG, LONG], |child, _| {
            assert!(child.answer(lie));
        })
    };
    // It has answered nothing, another question, or nonsense.
    for lie in [&message(0, 0, &[]), &message(103, 7, &[]), &vec![255; 64]] {
        let told = told(lie);
        assert!(told.starts_with("answered with something else"), "{told}");
    }
    let mut longer = message(103, 1, &[]);
    longer[..4].copy_from_slice(&(ROOM as u32).to_le_bytes());
    let most = ROOM - wire::HEAD;
    let problem = format!("answered with {ROOM} bytes, more than {most}");
    assert_eq!(told(&longer), problem);
}

#[test]
fn refusal_of_a_second_answer() {
    let right = message(103, 1, &[0; 16]);
    let told = told_of([LONG, LONG], |child, stream| {
        stream.write_all(&right).expect("sent");
        assert!(child.answer(&right));
        let _ = stream.read_to_end(&mut Vec::new());
    });
    assert!(told.starts_with("answered with something else"), "{told}");
}
