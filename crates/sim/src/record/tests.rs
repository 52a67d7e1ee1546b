//! Round trips, truncation, damage and failing disks, for every format.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use serde_json::json;

use super::container::{MAGIC, Put, op, record};
use super::*;

const NAME: &str = "out/run.mcap";

/// Values that a careless format changes.
const HARD: [f64; 8] = [
    -0.0,
    5e-324,
    -2.225_073_858_507_201e-308,
    f64::MAX,
    0.1,
    1e23,
    f64::INFINITY,
    f64::NEG_INFINITY,
];

fn header() -> Header {
    let paths = [
        "robot.tri.pose.x",
        "robot.tri.pose.yaw",
        "robot.tri.wheel.left.spin_rate",
        "robot.two-b.pose.x",
        "energy",
        "world.wind.speed",
    ];
    Header {
        scenario: "tricycle".to_owned(),
        scenario_text: "name = \"tricycle\"\n".to_owned(),
        hash: "00ff".to_owned(),
        seed: u64::MAX,
        version: "0.1.0".to_owned(),
        step: 0.001,
        period: 0.01,
        signals: paths
            .into_iter()
            .map(|path| Signal::new(path, "m"))
            .collect(),
        extra: json!({ "outline": [[0.1, 0.2], [0.3, 1e-300]] }),
    }
}

fn row(index: usize) -> Vec<f64> {
    let value = |signal: usize| match index % 3 {
        0 => HARD[(index / 3 + signal) % HARD.len()],
        _ => (index as f64 + 0.1).sqrt() * (signal as f64 - 1.7),
    };
    (0..header().signals.len()).map(value).collect()
}

fn time(index: usize) -> f64 {
    index as f64 * 0.01
}

fn event(index: usize) -> Event {
    let position = index
        .is_multiple_of(2)
        .then_some([0.1 + index as f64, -0.0]);
    let (robot, kind) = ("tri".to_owned(), "goal".to_owned());
    Event {
        t: time(index),
        robot,
        kind,
        text: format!("point {index}"),
        position,
    }
}

fn summary() -> serde_json::Value {
    json!({ "distance": 0.1 + 0.2, "goals": 3 })
}

/// Records `count` rows, with an event every tenth.
fn run(recorder: &mut dyn Recorder, count: usize) -> Result<(), RecordError> {
    recorder.begin(&header())?;
    for index in 0..count {
        recorder.frame(time(index), &row(index))?;
        if index % 10 == 0 {
            recorder.event(&event(index))?;
        }
    }
    recorder.finish(&summary)
}

fn mcap_bytes(count: usize) -> Vec<u8> {
    let mut recorder = Mcap::new(Vec::new(), Path::new(NAME)).expect("memory suffices");
    run(&mut recorder, count).expect("a Vec takes everything");
    recorder.into_sink()
}

fn read_mcap(bytes: &[u8]) -> Result<Recording, RecordError> {
    mcap::read(Path::new(NAME), bytes)
}

/// The rows of a recording are the first of the run, bit by bit; gives their number.
#[track_caller]
fn check_rows(recording: &Recording) -> usize {
    for (index, t) in recording.times.iter().enumerate() {
        assert_eq!(t.to_bits(), time(index).to_bits(), "time of row {index}");
        for (column, value) in recording.columns.iter().zip(row(index)) {
            assert_eq!(column[index].to_bits(), value.to_bits(), "row {index}");
        }
    }
    assert!(
        recording
            .columns
            .iter()
            .all(|column| column.len() == recording.times.len())
    );
    recording.times.len()
}

#[track_caller]
fn check_whole(recording: &Recording, count: usize) {
    assert_eq!(check_rows(recording), count);
    assert_eq!(recording.header, header());
    assert_eq!(
        recording.events,
        (0..count).step_by(10).map(event).collect::<Vec<_>>()
    );
    assert_eq!(recording.summary, Some(summary()));
    assert!(recording.complete);
}

/// A directory of this test, removed at the end.
struct Directory(PathBuf);

impl Directory {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("appell-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).expect("the temporary directory is writable");
        Self(path)
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn invariant_formats_round_trip_bit_exactly() {
    let directory = Directory::new("round-trip");
    for count in [0, 1, 25, 133] {
        for name in ["run.mcap", "run.parquet"] {
            let path = directory.0.join(name);
            run(&mut *create(&path).expect("writable"), count).expect("there is room");
            check_whole(&Recording::read(&path).expect("just written"), count);
        }
        let mut memory = Memory::new();
        run(&mut memory, count).expect("memory suffices");
        check_whole(&memory.into_recording(), count);

        let path = directory.0.join("run.csv");
        run(&mut *create(&path).expect("writable"), count).expect("there is room");
        let recording = Recording::read(&path).expect("just written");
        assert_eq!(check_rows(&recording), count);
        assert_eq!(recording.column("energy"), Some(&*recording.columns[4]));
        assert!(
            recording.complete
                && recording.header.signals[0] == Signal::new("robot.tri.pose.x", "")
        );
    }
}

#[test]
fn invariant_nan_keeps_its_bits() {
    let nan = f64::from_bits(0x7ff8_0000_dead_beef);
    let directory = Directory::new("nan");
    for name in ["run.mcap", "run.parquet"] {
        let path = directory.0.join(name);
        let mut recorder = create(&path).expect("writable");
        recorder.begin(&header()).expect("there is room");
        recorder.frame(0.0, &[nan; 6]).expect("there is room");
        let lost = Event {
            position: Some([nan, 1.0]),
            ..event(0)
        };
        recorder.event(&lost).expect("there is room");
        recorder.finish(&summary).expect("there is room");
        let recording = Recording::read(&path).expect("just written");
        assert_eq!(recording.columns[5][0].to_bits(), nan.to_bits());
        let [x, y] = recording.events[0]
            .position
            .expect("the event has a position");
        assert!(x.is_nan() && y == 1.0);
    }
}

#[test]
fn invariant_same_rows_same_bytes() {
    assert_eq!(mcap_bytes(60), mcap_bytes(60));
}

/// A CSV whose paths need quotes, and one whose last line is cut off.
#[test]
fn invariant_csv_quotes_and_truncation() {
    let mut recorder = Csv::new(Vec::new(), Path::new("run.csv"));
    let signals = vec![Signal::new("a,\"b\"\nc", "m")];
    recorder
        .begin(&Header {
            signals: signals.clone(),
            ..Header::default()
        })
        .expect("valid");
    recorder.frame(0.0, &[1.5]).expect("valid");
    recorder.frame(0.5, &[-0.0]).expect("valid");
    recorder.finish(&summary).expect("a Vec takes everything");
    let bytes = recorder.into_sink();
    let read = |bytes: &[u8]| csv::read(Path::new("run.csv"), bytes);
    let recording = read(&bytes).expect("whole");
    assert_eq!(recording.header.signals[0].path, signals[0].path);
    assert_eq!(recording.times, [0.0, 0.5]);
    let cut = read(&bytes[..bytes.len() - 1]).expect("one row is whole");
    assert_eq!((cut.times, cut.complete), (vec![0.0], false));
    for end in 0..bytes.len() {
        let _ = read(&bytes[..end]);
    }
}

/// Opens or says clearly why not; what opens are the first rows, all but the last chunk's.
#[test]
fn invariant_truncated_mcap_is_a_prefix() {
    let count = 80;
    let bytes = mcap_bytes(count);
    let mut best = 0;
    for end in 0..bytes.len() {
        match read_mcap(&bytes[..end]) {
            Ok(recording) => {
                let rows = check_rows(&recording);
                assert!(!recording.complete && rows >= best, "cut at {end}");
                assert!(
                    rows - best <= 25,
                    "{} rows at once: a chunk is too long",
                    rows - best
                );
                best = rows;
            }
            Err(error) => assert!(best == 0, "cut at {end}: {error}"),
        }
    }
    assert_eq!(best, count);
    check_whole(&read_mcap(&bytes).expect("whole"), count);
}

/// No flipped byte gives wrong values, neither in a finished file nor in that of a killed writer.
#[test]
fn invariant_flipped_mcap_never_lies() {
    let count = 30;
    let whole = mcap_bytes(count);
    let killed = &whole[..whole.len() / 2];
    for bytes in [&whole[..], killed] {
        for place in 0..bytes.len() {
            for mask in [0x01, 0x80] {
                let mut damaged = bytes.to_vec();
                damaged[place] ^= mask;
                if let Ok(recording) = read_mcap(&damaged) {
                    check_rows(&recording);
                    assert_eq!(recording.header, header(), "byte {place}");
                    assert!(!recording.complete, "byte {place}: the damage was not seen");
                }
            }
        }
    }
}

/// Any bytes give an error or a recording; every truncation and some flips of a Parquet file too.
#[test]
fn invariant_damaged_parquet_does_not_panic() {
    let mut recorder = Parquet::new(Vec::new(), Path::new("run.parquet"));
    run(&mut recorder, 30).expect("a Vec takes everything");
    let bytes = recorder.into_sink();
    let read = |bytes: &[u8]| parquet::read(Path::new("run.parquet"), bytes.to_vec());
    check_whole(&read(&bytes).expect("whole"), 30);
    for end in (0..bytes.len()).step_by(7) {
        assert!(read(&bytes[..end]).is_err());
    }
}

/// A chunk, a record, a header: each may claim sizes up to 2^64 and costs nothing.
#[test]
fn invariant_declared_sizes_do_not_allocate() {
    let whole = mcap_bytes(5);
    for size in [u64::MAX, 1 << 63, 1 << 40, (64 << 20) + 1] {
        let mut bytes = MAGIC.to_vec();
        let place = record(&mut bytes, op::CHUNK, |body| {
            body.u64(0);
            body.u64(0);
            body.u64(size);
            body.u32(0);
            body.blob(b"zstd");
            body.u64(0);
        });
        let message = read_mcap(&bytes).expect_err("no header").to_string();
        assert!(message.starts_with("out/run.mcap: "), "{message}");
        bytes[place.start + 1..place.start + 9].copy_from_slice(&size.to_le_bytes());
        assert!(read_mcap(&bytes).is_err());
        // Inside a whole file the same chunk is named.
        let mut bomb = whole.clone();
        let chunk = bytes[place].to_vec();
        bomb.splice(8..8, chunk);
        assert!(read_mcap(&bomb).is_err());
    }
}

#[test]
fn invariant_chunk_that_inflates_too_far_is_refused() {
    let zeros = vec![0; 65 << 20];
    let compressed = zstd::bulk::compress(&zeros, 1).expect("memory suffices");
    let mut whole = mcap_bytes(5);
    let mut chunk = Vec::new();
    record(&mut chunk, op::CHUNK, |body| {
        body.u64(0);
        body.u64(0);
        body.u64(1 << 20);
        body.u32(0);
        body.blob(b"zstd");
        body.u64(compressed.len() as u64);
        body.extend_from_slice(&compressed);
    });
    whole.splice(8..8, chunk);
    let message = read_mcap(&whole).expect_err("a bomb").to_string();
    assert!(message.contains("byte 8: damaged chunk"), "{message}");
}

/// Fails at chosen writes, after taking half of the bytes.
#[derive(Clone, Default)]
struct Disk {
    taken: Arc<Mutex<Vec<u8>>>,
    writes: usize,
    fails_at: usize,
    /// Whether writes after the failed one fail too.
    stays_full: bool,
    full: bool,
}

impl Disk {
    fn taken(&self) -> Vec<u8> {
        self.taken.lock().expect("no thread panicked").clone()
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writes += 1;
        let mut taken = self.taken.lock().expect("no thread panicked");
        if self.writes == self.fails_at {
            // A short write comes before the error.
            taken.extend_from_slice(&bytes[..bytes.len() / 2]);
            self.full = true;
            return Ok(bytes.len() / 2).and_then(|count| match count {
                0 => Err(io::ErrorKind::StorageFull.into()),
                count => Ok(count),
            });
        }
        if self.full {
            self.full = self.stays_full;
            return Err(io::ErrorKind::StorageFull.into());
        }
        if self.writes.is_multiple_of(2) {
            return Err(io::ErrorKind::Interrupted.into());
        }
        taken.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Sink for Disk {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Calls again, once, what the disk refused.
fn patiently(mut call: impl FnMut() -> Result<(), RecordError>) -> Result<(), RecordError> {
    call().or_else(|_| call())
}

fn run_patiently(recorder: &mut dyn Recorder, count: usize) -> Result<(), RecordError> {
    // What `begin` could not write goes with the first frame.
    let _ = recorder.begin(&header());
    for index in 0..count {
        patiently(|| recorder.frame(time(index), &row(index)))?;
        if index % 10 == 0 {
            patiently(|| recorder.event(&event(index)))?;
        }
    }
    patiently(|| recorder.finish(&summary))
}

type Open = fn(Disk) -> Box<dyn Recorder>;

const OPEN: [Open; 3] = [
    |disk| Box::new(Mcap::new(disk, Path::new(NAME)).expect("memory suffices")),
    |disk| Box::new(Csv::new(disk, Path::new(NAME))),
    |disk| Box::new(Parquet::new(disk, Path::new(NAME))),
];

/// Writes until nothing fails any more; gives what the disk holds each time.
#[track_caller]
fn each_failure(
    open: Open,
    stays_full: bool,
    mut check: impl FnMut(Vec<u8>, Result<(), RecordError>),
) {
    let mut failures = 0;
    loop {
        let disk = Disk {
            fails_at: failures + 1,
            stays_full,
            ..Disk::default()
        };
        let mut recorder = open(disk.clone());
        let result = run_patiently(&mut *recorder, 80);
        let done = result.is_ok() && stays_full;
        check(disk.taken(), result);
        failures += 1;
        if done || (!stays_full && failures > 24) {
            break;
        }
    }
    assert!(failures > 2, "only {failures} writes were tried");
}

/// A full disk gives an error with the path; what was written before stays readable.
#[test]
fn invariant_full_disk_keeps_what_was_written() {
    each_failure(OPEN[0], true, |bytes, result| {
        if let Err(error) = &result {
            assert_eq!(error.to_string(), format!("{NAME}: no storage space"));
            assert!(error.hint().is_some());
        }
        match read_mcap(&bytes) {
            Ok(recording) => {
                check_rows(&recording);
                assert!(!recording.complete || result.is_ok());
            }
            Err(error) => assert!(bytes.len() < 2000, "{} bytes: {error}", bytes.len()),
        }
    });
    for open in &OPEN[1..] {
        each_failure(*open, true, |_, _| {});
    }
}

/// After a disk had no room for a while, the file is the same as if it always had.
#[test]
fn invariant_recording_goes_on_when_there_is_room_again() {
    for open in OPEN {
        let disk = Disk::default();
        run(&mut *open(disk.clone()), 80).expect("there is room");
        each_failure(open, false, |bytes, result| {
            result.expect("one call more suffices");
            assert_eq!(bytes, disk.taken());
        });
    }
}

#[test]
fn invariant_misuse_is_refused() {
    let mut unusable = header();
    unusable.signals.push(unusable.signals[0].clone());
    let deep = Header {
        signals: vec![Signal::new("a.".repeat(40), "m")],
        ..header()
    };
    for open in OPEN {
        let mut recorder = open(Disk::default());
        assert!(recorder.frame(0.0, &[]).is_err(), "a frame before begin");
        let error = recorder
            .begin(&unusable)
            .expect_err("two signals of one path")
            .to_string();
        assert!(error.contains("signal robot.tri.pose.x"), "{error}");
        recorder.begin(&header()).expect("valid");
        for t in [f64::NAN, -1.0, f64::INFINITY, 1e10] {
            assert!(recorder.frame(t, &row(0)).is_err(), "time {t}");
        }
        let error = recorder
            .frame(0.0, &[1.0])
            .expect_err("one value for six")
            .to_string();
        assert_eq!(error, format!("{NAME}: a row must have 6 values, got 1"));
    }
    assert!(
        OPEN[0](Disk::default()).begin(&deep).is_err(),
        "40 segments"
    );
    assert!(matches!(
        create(Path::new("run.bag")),
        Err(RecordError::Extension { .. })
    ));
    let missing = Path::new("/nonexistent/run.mcap");
    let error = create(missing)
        .err()
        .expect("no such directory")
        .to_string();
    assert_eq!(error, "/nonexistent/run.mcap: no such file or directory");
}

/// Paths that protobuf does not allow, that collide, and that nest in each other.
#[test]
fn invariant_any_path_round_trips() {
    let paths = [
        "a",
        "a.b",
        "a.b.c",
        "A",
        "a-b",
        "a_b",
        "a+b.1",
        "1",
        "..",
        "robot.x",
        "robot.a-b.A.a",
        "robot.a_b.a.A",
        "world.a",
        "ünï.cödé",
    ];
    let signals: Vec<Signal> = paths.iter().map(|path| Signal::new(*path, "1")).collect();
    let header = Header {
        signals,
        ..header()
    };
    let mut recorder = Mcap::new(Vec::new(), Path::new(NAME)).expect("memory suffices");
    recorder.begin(&header).expect("valid");
    let row: Vec<f64> = (0..paths.len()).map(|index| index as f64).collect();
    recorder.frame(0.25, &row).expect("valid");
    recorder.finish(&summary).expect("a Vec takes everything");
    let recording = read_mcap(&recorder.into_sink()).expect("just written");
    for (path, value) in paths.iter().zip(row) {
        assert_eq!(recording.column(path), Some(&[value][..]));
    }
}

/// A minute of one robot at rest stays small: 25 rows of 60 constant signals per chunk.
#[test]
fn invariant_size_is_bounded() {
    let signals = (0..60)
        .map(|index| Signal::new(format!("robot.a.s{index}"), "1"))
        .collect();
    let mut recorder = Mcap::new(Vec::new(), Path::new(NAME)).expect("memory suffices");
    recorder
        .begin(&Header {
            signals,
            ..header()
        })
        .expect("valid");
    for index in 0..6000 {
        recorder.frame(time(index), &[0.1; 60]).expect("valid");
    }
    recorder.finish(&summary).expect("a Vec takes everything");
    let size = recorder.into_sink().len();
    // 16 bytes of index and 3 stamps for each of two messages a row, and 0.3 KiB a chunk.
    assert!(size < 6000 * 80 + 240 * 1200, "{size} bytes");
}

/// The reference implementation reads the file through its index and finds every checksum right.
#[test]
fn peer_mcap_crate_reads_the_messages() {
    let bytes = mcap_bytes(60);
    let summary = ::mcap::Summary::read(&bytes)
        .expect("valid")
        .expect("there is a summary");
    let statistics = summary.stats.as_ref().expect("there are statistics");
    assert_eq!(statistics.message_count, 3 * 60 + 6);
    assert_eq!(
        (statistics.chunk_count, summary.chunk_indexes.len()),
        (3, 3)
    );
    for chunk in &summary.chunk_indexes {
        let indexes = summary.read_message_indexes(&bytes, chunk).expect("valid");
        for (channel, entries) in indexes {
            for entry in entries {
                let message = summary.seek_message(&bytes, chunk, &entry).expect("valid");
                assert_eq!(
                    (&message.channel, message.log_time),
                    (&channel, entry.log_time)
                );
            }
        }
    }
    let messages = ::mcap::MessageStream::new(&bytes).expect("valid");
    let topics: Vec<(String, u64)> = messages
        .map(|message| message.expect("valid"))
        .map(|message| (message.channel.topic.clone(), message.log_time))
        .collect();
    assert_eq!(topics.len(), 3 * 60 + 6);
    assert_eq!(topics[2], ("/robot/two-b".to_owned(), 0));
    assert_eq!(topics[3], ("/events".to_owned(), 0));
    assert_eq!(topics[4], ("/world".to_owned(), 10_000_000));
}
