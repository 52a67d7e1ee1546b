//! The other side of a process: a library that answers messages.

use std::path::Path;

use crate::contract::Fault;
#[cfg(unix)]
use crate::shared::Shared;

/// Loads a library and answers for it, on the socket that the standard input is, until that ends.
///
/// # Errors
/// The standard input is no socket, or cannot be spoken to.
#[cfg(unix)]
pub fn serve(file: &Path) -> std::io::Result<()> {
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;

    let mut stream = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    let server = crate::local::load(file).and_then(Server::new);
    converse(&mut stream, server)
}

/// Answers until the requests end.
#[cfg(unix)]
pub(crate) fn converse(
    stream: &mut (impl std::io::Read + std::io::Write),
    mut server: Result<Server, Fault>,
) -> std::io::Result<()> {
    use crate::wire::{self, kind};

    let (mut body, mut answer) = (Vec::new(), Vec::new());
    let mut shared: Option<Shared> = None;
    loop {
        let asked = match &mut shared {
            Some(shared) => shared.is_asked().then_some(shared),
            None => None,
        };
        let request = match asked {
            Some(shared) => shared.take(&mut body)?,
            None => {
                let Some((length, request)) = wire::read_head(stream)? else {
                    return Ok(());
                };
                if length > REQUEST_MAX {
                    return Err(std::io::ErrorKind::InvalidData.into());
                }
                body.resize(length, 0);
                stream.read_exact(&mut body)?;
                request
            }
        };
        let answered_as = |kind: u16| wire::Tag { kind, ..request };
        let kind = request.kind;
        if kind == kind::DESCRIBE {
            shared = memory(&body);
        }
        wire::open(&mut answer, answered_as(kind.wrapping_add(kind::ANSWER)));
        let answered = match &mut server {
            Ok(server) => server.answer(kind, &body, &mut answer),
            Err(fault) => Err(fault.to_string()),
        };
        if let Err(problem) = answered {
            wire::open(&mut answer, answered_as(kind::REFUSED));
            answer.extend_from_slice(problem.as_bytes());
        }
        wire::close(&mut answer);
        let is_told = shared.as_ref().is_some_and(|shared| shared.answer(&answer));
        if !is_told {
            stream.write_all(&answer)?;
        }
    }
}

/// The memory that the host offers; without it all goes over the stream.
#[cfg(unix)]
fn memory(body: &[u8]) -> Option<Shared> {
    let request: serde_json::Value = serde_json::from_slice(body).ok()?;
    let offer = &request["shared"];
    let spin = std::time::Duration::try_from_secs_f64(offer["spin"].as_f64()?).ok()?;
    Shared::open(Path::new(offer["file"].as_str()?), spin).ok()
}

/// Says that it cannot.
///
/// # Errors
/// Always.
#[cfg(not(unix))]
pub fn serve(_file: &Path) -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}

/// Longest body of a request, bytes: what a member remembers, and whose it is.
#[cfg(unix)]
const REQUEST_MAX: usize = crate::wire::BODY_MAX + 4;

/// A plug-in in this process that answers.
#[cfg(unix)]
#[derive(Debug)]
pub(crate) struct Server {
    local: Box<dyn crate::local::Local>,
    described: serde_json::Value,
    /// Names of the parameters, and numbers of inputs and outputs.
    parameters: Vec<String>,
    widths: [usize; 2],
    values: [Vec<f64>; 2],
}

#[cfg(unix)]
impl Server {
    pub(crate) fn new(mut local: Box<dyn crate::local::Local>) -> Result<Server, Fault> {
        let described = local.describe()?;
        let descriptor = crate::Descriptor::read(described.clone())?;
        Ok(Server {
            local,
            described,
            parameters: descriptor.parameters.into_iter().map(|p| p.name).collect(),
            widths: [descriptor.inputs.len(), descriptor.outputs.len()],
            values: [Vec::new(), Vec::new()],
        })
    }

    /// Writes the body of an answer.
    fn answer(&mut self, kind: u16, body: &[u8], answer: &mut Vec<u8>) -> Result<(), String> {
        use crate::wire::kind;

        let member = || {
            let bytes = body.first_chunk().ok_or("a request is too short")?;
            Ok::<u32, String>(u32::from_le_bytes(*bytes))
        };
        match kind {
            kind::DESCRIBE => answer.extend_from_slice(self.described.to_string().as_bytes()),
            kind::CREATE => {
                let request: serde_json::Value =
                    serde_json::from_slice(body).map_err(|error| error.to_string())?;
                let value = |name: &String| {
                    let value = request["parameters"][name].as_f64();
                    (name.clone(), value.unwrap_or(f64::NAN))
                };
                let parameters: Vec<(String, f64)> = self.parameters.iter().map(value).collect();
                let member = request["member"].as_u64().unwrap_or_default() as u32;
                self.local
                    .create(member, &parameters, &request["context"])
                    .map_err(|fault| fault.problem)?;
            }
            kind::STEP => self.step(body, answer)?,
            kind::DESTROY => self.local.destroy(member()?),
            kind::SAVE => answer.extend(self.local.save(member()?)?),
            kind::RESTORE => self.local.restore(member()?, &body[4..])?,
            kind::TAKE_OVER => {
                let member = member()?;
                let outputs = numbers(body.get(8..).unwrap_or_default());
                if outputs.len() != self.widths[1] {
                    return Err("a request is too short".into());
                }
                self.local.take_over(member, &outputs)?;
            }
            _ => return Err(format!("requests of kind {kind} are unknown")),
        }
        Ok(())
    }

    fn step(&mut self, body: &[u8], answer: &mut Vec<u8>) -> Result<(), String> {
        let [inputs, outputs] = self.widths;
        let [input, output] = &mut self.values;
        let (_, calls) = body
            .split_first_chunk::<4>()
            .ok_or("a request is too short")?;
        let calls = calls.chunks_exact(24 + 8 * inputs);
        if !calls.remainder().is_empty() {
            return Err("a request is too short".into());
        }
        for call in calls {
            let member = u32::from_le_bytes([call[0], call[1], call[2], call[3]]);
            input.clear();
            input.extend(each(&call[8..]));
            output.resize(outputs, f64::NAN);
            let step = crate::wire::Call {
                member,
                t: input[0],
                dt: input[1],
                input: &input[2..],
            };
            match self.local.step(&step, output) {
                Ok(()) => {
                    answer.extend_from_slice(&[0; 8]);
                    let bytes = output.iter().flat_map(|value| value.to_le_bytes());
                    answer.extend(bytes);
                }
                Err(problem) => {
                    answer.extend_from_slice(&1_u32.to_le_bytes());
                    answer.extend_from_slice(&(problem.len() as u32).to_le_bytes());
                    answer.extend_from_slice(problem.as_bytes());
                }
            }
        }
        Ok(())
    }
}

#[cfg(unix)]
fn each(bytes: &[u8]) -> impl Iterator<Item = f64> {
    let chunks = bytes.as_chunks::<8>().0.iter();
    chunks.map(|bytes| f64::from_le_bytes(*bytes))
}

#[cfg(unix)]
fn numbers(bytes: &[u8]) -> Vec<f64> {
    each(bytes).collect()
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::{self, Write};

    use super::*;

    /// The head of a request, of which no more comes.
    struct Head<'a>(&'a [u8]);

    impl io::Read for Head<'_> {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            self.0.read(bytes)
        }
    }

    impl Write for Head<'_> {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn refusal_of_requests_that_are_too_long() {
        let told = |length: usize| {
            let mut bytes = [0, 0, 0, 0, 5, 0, 1, 0];
            bytes[..4].copy_from_slice(&(length as u32).to_le_bytes());
            let missing = Err(Fault::new("file", "is none"));
            let failed = converse(&mut Head(&bytes), missing).expect_err("a failure");
            failed.kind()
        };
        assert_eq!(told(REQUEST_MAX), io::ErrorKind::UnexpectedEof);
        assert_eq!(told(REQUEST_MAX + 1), io::ErrorKind::InvalidData);
    }
}
