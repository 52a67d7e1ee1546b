//! Arbitrary bytes as the answers of a child, and as requests to the side that serves.
//!
//! Neither may panic, or take more memory than what was sent accounts for.

#![no_main]

use std::collections::BTreeMap;
use std::io::{self, Read, Write};

use appell_plugin::Fault;
use appell_plugin::fuzz::{Local, converse};
use appell_plugin::wire::{self, Call, Tag, kind};
use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use serde_json::{Value, json};

/// Inputs, and outputs, of the plug-in that is served.
const WIDTHS: [usize; 2] = [2, 1];

#[derive(Arbitrary, Debug)]
enum Sent<'a> {
    Head(&'a [u8]),
    Step {
        body: &'a [u8],
        count: u16,
        width: u16,
    },
    Requests(&'a [u8]),
    Formed(Vec<Request<'a>>),
}

#[derive(Arbitrary, Debug)]
struct Request<'a> {
    number: u16,
    body: Body<'a>,
}

/// Members out of few are there sometimes.
#[derive(Arbitrary, Debug)]
enum Body<'a> {
    Free {
        kind: u16,
        bytes: &'a [u8],
    },
    Text {
        kind: u8,
        bytes: &'a [u8],
    },
    Create {
        member: u8,
        gain: Option<f64>,
    },
    Step(Vec<(u8, [f64; 4])>),
    About {
        kind: u8,
        member: u8,
        rest: &'a [u8],
    },
}

/// A plug-in in memory, which holds what reaches it to what is promised.
#[derive(Debug, Default)]
struct Stub(BTreeMap<u32, Vec<u8>>);

impl Stub {
    fn member(&mut self, member: u32) -> Result<&mut Vec<u8>, String> {
        let known = self.0.get_mut(&member);
        known.ok_or_else(|| format!("has no member {member}"))
    }
}

impl Local for Stub {
    fn describe(&mut self) -> Result<Value, Fault> {
        Ok(json!({
            "protocol": 1,
            "name": "stub",
            "inputs": [{ "name": "a", "unit": "m" }, { "name": "b", "unit": "m" }],
            "outputs": [{ "name": "c", "unit": "m" }],
            "parameters": [{ "name": "gain", "default": 1 }],
        }))
    }

    fn create(
        &mut self,
        member: u32,
        parameters: &[(String, f64)],
        _context: &Value,
    ) -> Result<(), Fault> {
        assert_eq!(parameters.len(), 1);
        assert_eq!(parameters[0].0, "gain");
        self.0.insert(member, Vec::new());
        Ok(())
    }

    fn destroy(&mut self, member: u32) {
        self.0.remove(&member);
    }

    fn step(&mut self, call: &Call<'_>, results: &mut [f64]) -> Result<(), String> {
        assert_eq!([call.input.len(), results.len()], WIDTHS);
        self.member(call.member)?;
        results[0] = call.input[0] + call.input[1] * call.dt;
        Ok(())
    }

    fn save(&mut self, member: u32) -> Result<Vec<u8>, String> {
        self.member(member).cloned()
    }

    fn restore(&mut self, member: u32, bytes: &[u8]) -> Result<(), String> {
        *self.member(member)? = bytes.to_vec();
        Ok(())
    }

    fn take_over(&mut self, member: u32, outputs: &[f64]) -> Result<(), String> {
        assert_eq!(outputs.len(), WIDTHS[1]);
        self.member(member).map(drop)
    }
}

/// Requests that are read, and answers that are written.
struct Pipe<'a> {
    requests: &'a [u8],
    answers: Vec<u8>,
}

impl Read for Pipe<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.requests.read(bytes)
    }
}

impl Write for Pipe<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.answers.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The messages in a stream that are whole.
fn messages(mut bytes: &[u8]) -> Vec<(Tag, &[u8])> {
    let mut all = Vec::new();
    while let Ok(Some((length, tag))) = wire::read_head(&mut bytes) {
        let Some((body, rest)) = bytes.split_at_checked(length) else {
            break;
        };
        all.push((tag, body));
        bytes = rest;
    }
    all
}

/// Serves requests: each that is whole has its answer.
fn serve(requests: &[u8]) -> io::Result<()> {
    let mut pipe = Pipe {
        requests,
        answers: Vec::new(),
    };
    let served = converse(&mut pipe, Box::new(Stub::default()));
    let (asked, answered) = (messages(requests), messages(&pipe.answers));
    assert_eq!(asked.len(), answered.len());
    for ((request, asked), (answer, answered)) in asked.into_iter().zip(answered) {
        assert_eq!(answer.number, request.number);
        if answer.kind == kind::REFUSED {
            assert!(!answered.is_empty(), "a refusal has words");
            continue;
        }
        assert_eq!(answer.kind, request.kind + kind::ANSWER);
        if request.kind == kind::STEP {
            let count = (asked.len() - 4) / (24 + 8 * WIDTHS[0]);
            take(answered, count, WIDTHS[1]);
        }
    }
    served
}

/// Reads the answer to a step: no more than what it holds.
fn take(body: &[u8], count: usize, width: usize) {
    let mut results = Vec::new();
    match wire::take_step(body, count, width, &mut results) {
        Ok(()) => assert_eq!(results.len(), count * width),
        Err((k, problem)) => assert!(k < count.max(1) && problem.len() <= 4 * body.len() + 40),
    }
    assert!(8 * results.len() <= body.len());
}

fn put(stream: &mut Vec<u8>, request: &Request<'_>) {
    let mut message = Vec::new();
    let mut open = |kind: u16| {
        let number = request.number;
        wire::open(&mut message, Tag { kind, number });
    };
    match &request.body {
        Body::Free { kind, bytes } => {
            open(*kind);
            message.extend_from_slice(bytes);
        }
        Body::Text { kind, bytes } => {
            open(u16::from(kind % 9));
            message.extend_from_slice(bytes);
        }
        Body::Create { member, gain } => {
            open(kind::CREATE);
            let parameters = json!({ "gain": gain });
            let body = json!({ "member": member % 4, "parameters": parameters, "context": {} });
            message.extend_from_slice(body.to_string().as_bytes());
        }
        Body::Step(calls) => {
            open(kind::STEP);
            let call = |(member, numbers): &(u8, [f64; 4])| (u32::from(member % 4), *numbers);
            let calls: Vec<(u32, [f64; 4])> = calls.iter().map(call).collect();
            let calls: Vec<Call<'_>> = calls
                .iter()
                .map(|(member, numbers)| Call {
                    member: *member,
                    t: numbers[0],
                    dt: numbers[1],
                    input: &numbers[2..],
                })
                .collect();
            wire::put_step(&mut message, &calls);
        }
        Body::About { kind, member, rest } => {
            open(kind::DESTROY + u16::from(kind % 4));
            message.extend_from_slice(&u32::from(member % 4).to_le_bytes());
            message.extend_from_slice(rest);
        }
    }
    wire::close(&mut message);
    stream.extend_from_slice(&message);
}

fuzz_target!(|sent: Sent<'_>| {
    match sent {
        Sent::Head(mut bytes) => {
            let length = bytes.len();
            match wire::read_head(&mut bytes) {
                Ok(None) => assert_eq!(length, 0),
                Ok(Some(_)) => assert_eq!(bytes.len(), length - wire::HEAD),
                Err(_) => assert!(length < wire::HEAD),
            }
        }
        Sent::Step { body, count, width } => take(body, count.into(), width.into()),
        Sent::Requests(bytes) => drop(serve(bytes)),
        Sent::Formed(requests) => {
            let mut stream = Vec::new();
            for request in &requests {
                put(&mut stream, request);
            }
            serve(&stream).expect("requests that are whole are all answered");
        }
    }
});
