//! A plug-in as a child process, spoken to over its standard input and output.

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::contract::Fault;
use crate::folder::Folder;
#[cfg(unix)]
use crate::shared::{Place, ROOM, Shared};
use crate::wire::{self, Call, kind};

/// What a plug-in may take.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Longest time until it has described itself, or made a member.
    pub start: Duration,
    /// Longest time for an answer of a process.
    pub answer: Duration,
    /// Most memory that it can address, MiB.
    pub memory: u64,
    /// Most instructions, about, until a module has described itself, or made a member.
    pub fuel_of_start: u64,
    /// Most instructions, about, of a module's step.
    pub fuel: u64,
    /// Whether a library is loaded into this process, where nothing limits it.
    pub is_trusted: bool,
    /// Longest time for which this process and one that serves a library or an FMU wait awake for each
    /// other's messages, which then pass through memory that both see; none, and all go over the socket.
    pub spin: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            start: Duration::from_secs(10),
            answer: Duration::from_secs(1),
            memory: 4096,
            fuel_of_start: 500_000_000,
            fuel: 100_000_000,
            is_trusted: false,
            spin: Duration::from_micros(50),
        }
    }
}

/// A child process that answers.
#[derive(Debug)]
pub struct Process {
    child: Child,
    /// Both directions; `None` once it is no longer spoken to.
    #[cfg(unix)]
    stream: Option<std::os::unix::net::UnixStream>,
    /// Where steps go while the child is awake, and for as long as it needs to find it, the place.
    #[cfg(unix)]
    shared: Option<Shared>,
    #[cfg(unix)]
    place: Option<Place>,
    limits: Limits,
    message: Vec<u8>,
    body: Vec<u8>,
    kind: Kind,
    /// Of the last request.
    number: u16,
    /// Where an FMU is unpacked: it goes even if the child was ended before it could see to that.
    _folder: Option<Folder>,
}

/// What a file is, by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Python,
    Library,
    Module,
    Fmu,
    Program,
}

impl Kind {
    pub(crate) fn of(file: &Path) -> Kind {
        let extension = file.extension().and_then(|extension| extension.to_str());
        match extension {
            Some("py") => Kind::Python,
            Some("so" | "dylib" | "dll") => Kind::Library,
            Some("wasm") => Kind::Module,
            Some("fmu") => Kind::Fmu,
            _ => Kind::Program,
        }
    }
}

/// The program `appell`, which loads libraries and FMUs in processes of their own.
fn server() -> Result<PathBuf, Fault> {
    if let Some(named) = std::env::var_os("APPELL_EXECUTABLE") {
        return Ok(named.into());
    }
    let own = std::env::current_exe().ok();
    let is_appell = |path: &PathBuf| path.file_stem().is_some_and(|stem| stem == "appell");
    own.filter(is_appell).ok_or_else(|| {
        Fault::new(
            "start",
            "libraries and FMUs are loaded by the program appell, which is not known",
        )
        .hint("name it in APPELL_EXECUTABLE")
    })
}

/// Why an exchange failed.
enum Break {
    /// It took too long, or said what is no message: the child is of no more use.
    Lost(String),
    /// It is about to end, or has ended.
    Ended,
    /// It answered that it cannot.
    Refused(String),
}

/// Memory to share with a child that Appell provides, unless there is but one processor to be awake on, or
/// the system has none to give: then all goes over the socket.
#[cfg(unix)]
fn memory(kind: Kind, limits: &Limits) -> Option<(Shared, Place)> {
    let is_ours = match kind {
        Kind::Library | Kind::Fmu => true,
        Kind::Python | Kind::Module | Kind::Program => false,
    };
    let has_room = std::thread::available_parallelism().is_ok_and(|count| count.get() > 1);
    let is_wanted = is_ours && has_room && !limits.spin.is_zero();
    is_wanted.then(|| Shared::new(limits.spin).ok()).flatten()
}

impl Process {
    /// Starts the program of a file: with Python where it ends in `.py`, with Appell itself where it is a
    /// library or an FMU, else by itself.
    pub(crate) fn start(file: &Path, limits: Limits) -> Result<Process, Fault> {
        // A path without a folder would be looked for among the installed programs.
        let path = std::path::absolute(file)
            .map_err(|error| Fault::new("file", format!("cannot be found: {error}")))?;
        let kind = Kind::of(file);
        #[cfg(unix)]
        if kind == Kind::Program {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(&path).map(|about| about.permissions().mode());
            if mode.is_ok_and(|mode| mode & 0o111 == 0) {
                return Err(Fault::new("start", "must be a program that may be executed")
                    .hint("chmod +x makes it one; names of Python files end in .py, of libraries in .so"));
            }
        }
        let mut words = match kind {
            Kind::Python => {
                let python = std::env::var_os("APPELL_PYTHON").unwrap_or_else(|| "python3".into());
                vec![python, "-m".into(), "appell_plugin".into()]
            }
            Kind::Library | Kind::Fmu => {
                vec![server()?.into_os_string(), "plugin".into(), "serve".into()]
            }
            Kind::Module | Kind::Program => Vec::new(),
        };
        words.push(path.into_os_string());
        Process::spawn(&words, limits, kind)
    }

    #[cfg(not(unix))]
    fn spawn(_: &[std::ffi::OsString], _: Limits, _: Kind) -> Result<Process, Fault> {
        let problem = "plug-ins in processes of their own need sockets that this system lacks";
        Err(Fault::new("start", problem).hint("run it on Linux or macOS"))
    }

    #[cfg(unix)]
    fn spawn(words: &[std::ffi::OsString], limits: Limits, kind: Kind) -> Result<Process, Fault> {
        use std::os::fd::{AsFd, OwnedFd};
        use std::os::unix::net::UnixStream;

        let failed = |error: io::Error| Fault::new("start", format!("cannot be started: {error}"));
        // A pair of sockets rather than pipes: they know time limits.
        let (ours, theirs) = UnixStream::pair().map_err(failed)?;
        let output = match kind {
            // It answers where it is asked, so that what its code prints is no message.
            Kind::Library | Kind::Fmu => {
                io::stderr().as_fd().try_clone_to_owned().map_err(failed)?
            }
            Kind::Python | Kind::Module | Kind::Program => {
                OwnedFd::from(theirs.try_clone().map_err(failed)?)
            }
        };
        let mut command = Command::new("/bin/sh");
        command
            // Where the system allows less than is asked for, its own limit stands.
            .args(["-c", "ulimit -Sv \"$0\" 2>/dev/null; exec \"$@\""])
            .arg((limits.memory << 10).to_string())
            .args(words)
            // Sets and dictionaries in the same order each time, and no traces beside the file.
            .env("PYTHONHASHSEED", "0")
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::from(output))
            .stderr(Stdio::inherit());
        // A checkout has the module of its own version beside it.
        if let Some(module) = std::env::var_os("APPELL_PYTHON_PATH") {
            let known = std::env::var_os("PYTHONPATH").unwrap_or_default();
            let known: Vec<PathBuf> = std::env::split_paths(&known).collect();
            let all = std::iter::once(PathBuf::from(module)).chain(known);
            if let Ok(paths) = std::env::join_paths(all) {
                command.env("PYTHONPATH", paths);
            }
        }
        let folder = (kind == Kind::Fmu).then(Folder::new);
        let folder = folder.transpose().map_err(failed)?;
        if let Some(folder) = &folder {
            command.env("TMPDIR", folder.path());
        }
        let child = command.spawn().map_err(failed)?;
        let (shared, place) = memory(kind, &limits).unzip();
        Ok(Process {
            child,
            stream: Some(ours),
            shared,
            place,
            limits,
            message: Vec::new(),
            body: Vec::new(),
            kind,
            number: 0,
            _folder: folder,
        })
    }

    pub(crate) fn describe(&mut self) -> Result<Value, Fault> {
        let limit = self.limits.start;
        let mut request = json!({ "protocol": wire::PROTOCOL });
        #[cfg(unix)]
        if let Some(path) = self.place.as_ref().and_then(|place| place.path().to_str()) {
            let spin = self.limits.spin.as_secs_f64();
            request["shared"] = json!({ "file": path, "spin": spin });
        }
        self.open(kind::DESCRIBE);
        self.put_json(&request);
        let hint = match self.kind {
            Kind::Python => {
                "see what Python says above; if it lacks the module: pip install ./sdk/python, in the Python that APPELL_PYTHON names, or python3"
            }
            Kind::Library => {
                "it must be a shared library for this machine, with the functions of sdk/c/appell_plugin.h"
            }
            Kind::Fmu => {
                "it must be an FMU for co-simulation, of FMI 2.0 or 3.0, with a binary for this machine"
            }
            Kind::Module | Kind::Program => {
                "it must be a program that speaks Appell's messages, and may be executed"
            }
        };
        let described = self.exchange(kind::DESCRIBE, limit);
        // The child has it open by now, or never will.
        #[cfg(unix)]
        {
            self.place = None;
        }
        described.map_err(|lost| Fault::new("describe", lost.text()).hint(hint))?;
        serde_json::from_slice(&self.body)
            .map_err(|error| Fault::new("describe", format!("must be JSON: {error}")))
    }

    pub(crate) fn create(
        &mut self,
        member: u32,
        parameters: &[(String, f64)],
        context: &Value,
    ) -> Result<(), Fault> {
        let limit = self.limits.start;
        let parameters: serde_json::Map<String, Value> = parameters
            .iter()
            .map(|(name, value)| (name.clone(), json!(value)))
            .collect();
        let request = json!({ "member": member, "parameters": parameters, "context": context });
        self.open(kind::CREATE);
        self.put_json(&request);
        self.exchange(kind::CREATE, limit)
            .map_err(|lost| Fault::new("create", lost.text()))
    }

    /// Steps members; outputs of `width` each are appended to `results`.
    pub(crate) fn step(
        &mut self,
        calls: &[Call<'_>],
        width: usize,
        results: &mut Vec<f64>,
    ) -> Result<(), (usize, Fault)> {
        self.open(kind::STEP);
        wire::put_step(&mut self.message, calls);
        let limit = self.limits.answer;
        self.exchange(kind::STEP, limit)
            .map_err(|lost| (0, Fault::new("step", lost.text())))?;
        wire::take_step(&self.body, calls.len(), width, results)
            .map_err(|(k, problem)| (k, Fault::new("step", problem)))
    }

    pub(crate) fn destroy(&mut self, member: u32) -> Result<(), Fault> {
        self.about(kind::DESTROY, "destroy", member, &[])
    }

    pub(crate) fn save(&mut self, member: u32) -> Result<Vec<u8>, Fault> {
        self.about(kind::SAVE, "save", member, &[])?;
        Ok(self.body.clone())
    }

    pub(crate) fn restore(&mut self, member: u32, bytes: &[u8]) -> Result<(), Fault> {
        self.about(kind::RESTORE, "restore", member, bytes)
    }

    pub(crate) fn take_over(&mut self, member: u32, outputs: &[f64]) -> Result<(), Fault> {
        let mut bytes = vec![0; 4];
        for output in outputs {
            bytes.extend_from_slice(&output.to_le_bytes());
        }
        self.about(kind::TAKE_OVER, "take_over", member, &bytes)
    }

    /// A request about one member.
    fn about(&mut self, kind: u16, field: &str, member: u32, rest: &[u8]) -> Result<(), Fault> {
        self.open(kind);
        self.message.extend_from_slice(&member.to_le_bytes());
        self.message.extend_from_slice(rest);
        let limit = self.limits.answer;
        self.exchange(kind, limit)
            .map_err(|lost| Fault::new(field, lost.text()))
    }

    pub(crate) fn is_alive(&self) -> bool {
        #[cfg(unix)]
        return self.stream.is_some();
        #[cfg(not(unix))]
        false
    }

    fn open(&mut self, kind: u16) {
        self.number = self.number.wrapping_add(1);
        let number = self.number;
        wire::open(&mut self.message, wire::Tag { kind, number });
    }

    fn put_json(&mut self, value: &Value) {
        serde_json::to_writer(&mut self.message, value).expect("memory takes what is written");
    }

    /// Sends the message and takes the answer into the body.
    fn exchange(&mut self, kind: u16, limit: Duration) -> Result<(), Break> {
        wire::close(&mut self.message);
        let answered = self.converse(kind, limit);
        let problem = match answered {
            Ok(()) | Err(Break::Refused(_)) => return answered,
            Err(Break::Lost(problem)) => problem,
            Err(Break::Ended) => {
                let status = self.status();
                let status = status.map_or(String::new(), |status| format!(" ({status})"));
                format!("ended without an answer{status}")
            }
        };
        // Whatever it may still say would answer another question.
        #[cfg(unix)]
        {
            (self.stream, self.shared) = (None, None);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        Err(Break::Lost(problem))
    }

    /// How one that closed its end ended: it may need a moment for that.
    fn status(&mut self) -> Option<ExitStatus> {
        let end = Instant::now() + Duration::from_millis(500);
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Some(status),
                Ok(None) if Instant::now() < end => std::thread::sleep(Duration::from_millis(1)),
                _ => return None,
            }
        }
    }

    #[cfg(not(unix))]
    fn converse(&mut self, _: u16, _: Duration) -> Result<(), Break> {
        Err(Break::Lost("it was never started".into()))
    }

    #[cfg(unix)]
    fn converse(&mut self, kind: u16, limit: Duration) -> Result<(), Break> {
        let Some(stream) = &self.stream else {
            return Err(Break::Lost("it failed before".into()));
        };
        let end = Instant::now() + limit;
        let mut timed = Timed { stream, end, limit };
        let lost = |error: io::Error| match error.kind() {
            io::ErrorKind::TimedOut => {
                Break::Lost(format!("gave no answer within {} s", limit.as_secs_f64()))
            }
            io::ErrorKind::UnexpectedEof
            | io::ErrorKind::BrokenPipe
            | io::ErrorKind::ConnectionReset => Break::Ended,
            _ => Break::Lost(format!("cannot be spoken to: {error}")),
        };
        let (shared, message) = (&mut self.shared, &self.message);
        let is_step = kind == wire::kind::STEP && !limit.is_zero();
        let mut shared = shared.as_mut();
        let is_asked = is_step && shared.as_mut().is_some_and(|shared| shared.ask(message));
        if !is_asked {
            if let Some(shared) = &shared {
                shared.call();
            }
            timed.write_all(message).map_err(lost)?;
        }
        // What was asked over the socket is answered there.
        let shared = shared.filter(|_| is_asked);
        let shared = shared.and_then(|shared| shared.is_answered(end).then_some(shared));
        let head = match &shared {
            Some(shared) => Some(shared.answer_head()),
            None => wire::read_head(&mut timed).map_err(lost)?,
        };
        let Some((length, answer)) = head else {
            return Err(Break::Ended);
        };
        let is_answer = [kind + wire::kind::ANSWER, wire::kind::REFUSED].contains(&answer.kind);
        if !is_answer || answer.number != self.number {
            return Err(Break::Lost(format!(
                "answered with something else than an answer: kind {}, {length} bytes. What it prints must not go to its standard output",
                answer.kind
            )));
        }
        let most = match shared {
            Some(_) => ROOM - wire::HEAD,
            None => wire::BODY_MAX,
        };
        if length > most {
            return Err(Break::Lost(format!(
                "answered with {length} bytes, more than {most}"
            )));
        }
        self.body.resize(length, 0);
        match shared {
            Some(shared) => shared.answer_body(&mut self.body),
            None => timed.read_exact(&mut self.body).map_err(lost)?,
        }
        if answer.kind == wire::kind::REFUSED {
            let text = String::from_utf8_lossy(&self.body).into_owned();
            return Err(Break::Refused(text));
        }
        Ok(())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        #[cfg(unix)]
        {
            if let Some(shared) = &self.shared {
                shared.call();
            }
            self.stream = None;
        }
        // It ends with its input; one that does not is ended.
        for _ in 0..50 {
            if matches!(self.child.try_wait(), Ok(Some(_)) | Err(_)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Break {
    fn text(self) -> String {
        match self {
            Break::Lost(text) | Break::Refused(text) => text,
            Break::Ended => "ended without an answer".into(),
        }
    }
}

/// A stream with a time by which all must be done, however slowly it drips.
#[cfg(unix)]
struct Timed<'a> {
    stream: &'a std::os::unix::net::UnixStream,
    end: Instant,
    limit: Duration,
}

#[cfg(unix)]
impl Timed<'_> {
    fn left(&self) -> io::Result<Duration> {
        let left = self.end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        Ok(left.min(self.limit))
    }

    /// A time limit shows as an operation that would block.
    fn timed<R>(result: io::Result<R>) -> io::Result<R> {
        result.map_err(|error| match error.kind() {
            io::ErrorKind::WouldBlock => io::ErrorKind::TimedOut.into(),
            _ => error,
        })
    }
}

#[cfg(unix)]
impl Read for Timed<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        let mut stream = self.stream;
        Self::timed(stream.read(bytes))
    }
}

#[cfg(unix)]
impl Write for Timed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        let mut stream = self.stream;
        Self::timed(stream.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(all(test, unix))]
mod tests;
