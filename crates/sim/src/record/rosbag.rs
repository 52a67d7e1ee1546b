//! Bags of ROS 2: a folder with an MCAP file of the profile `ros2` (CDR messages, `ros2msg` definitions) and
//! the `metadata.yaml` that `ros2 bag` wants beside it.
//!
//! A bag is for other programs: it holds what a robot would have said, not every signal. Its version is 5,
//! which every `ros2 bag` since Humble reads.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};

use super::compression::{self, Compressor, Decompressor};
use super::container::{MAGIC, Put, Take, op, record};
use super::outlet::Outlet;
use super::{
    Closing, Event, Header, RecordError, Recorder, Stage, check_begin, check_event, check_row,
};
use crate::ros::message::{Message, definition};
use crate::ros::{Service, Speaker, Topic};
use crate::scenario::Scenario;

/// Longest simulated time of a chunk, ns.
const CHUNK_DURATION: u64 = 1_000_000_000;

/// A chunk closes before it grows beyond this many bytes.
const CHUNK_BYTES: usize = 4 << 20;

/// Largest chunk that is read, and most of a whole bag, bytes after decompression.
const CHUNK_BYTES_MAX: u64 = 1 << 30;
const BAG_BYTES_MAX: u64 = 8 << 30;

const COMPRESSION_LEVEL: i32 = 1;

/// The file of a bag.
const FILE: &str = "ros2_0.mcap";

/// Writes a bag.
pub struct Rosbag {
    outlet: Outlet<File>,
    folder: PathBuf,
    scenario: Scenario,
    stage: Stage,
    speaker: Option<Speaker>,
    compressor: Compressor<'static>,
    chunk: Vec<u8>,
    /// Time and place of the chunk's messages, topic by topic.
    index: Vec<Vec<(u64, u64)>>,
    span: Option<(u64, u64)>,
    written: u64,
    checksum: crc32fast::Hasher,
    chunks: u32,
    chunk_indexes: Vec<u8>,
    /// Messages of each topic.
    counts: Vec<u64>,
    whole: Option<(u64, u64)>,
}

impl Rosbag {
    /// A bag in `folder`, which is made if it is not there, of a run of this scenario.
    ///
    /// # Errors
    /// The folder or the file cannot be made.
    pub fn create(folder: &Path, scenario: &Scenario) -> Result<Self, RecordError> {
        std::fs::create_dir_all(folder).map_err(|source| RecordError::io(folder, source))?;
        let metadata = folder.join("metadata.yaml");
        // What an earlier run left would tell of another file.
        if metadata.exists() {
            std::fs::remove_file(&metadata).map_err(|source| RecordError::io(&metadata, source))?;
        }
        let outlet = Outlet::create(&folder.join(FILE))?;
        let compressor = Compressor::new(COMPRESSION_LEVEL)
            .map_err(|source| RecordError::io(&outlet.path, source))?;
        Ok(Rosbag {
            outlet,
            folder: folder.to_owned(),
            scenario: scenario.clone(),
            stage: Stage::Created,
            speaker: None,
            compressor,
            chunk: Vec::new(),
            index: Vec::new(),
            span: None,
            written: 0,
            checksum: crc32fast::Hasher::new(),
            chunks: 0,
            chunk_indexes: Vec::new(),
            counts: Vec::new(),
            whole: None,
        })
    }

    fn append(&mut self, bytes: &[u8]) {
        self.outlet.pending.extend_from_slice(bytes);
        self.checksum.update(bytes);
        self.written += bytes.len() as u64;
    }

    fn topics(&self) -> &[Topic] {
        self.speaker.as_ref().map_or(&[], Speaker::topics)
    }

    /// Schemas and channels: each topic has its own of both.
    fn channels(&self) -> Vec<u8> {
        let mut records = Vec::new();
        for (id, topic) in (1_u16..).zip(self.topics()) {
            record(&mut records, op::SCHEMA, |body| {
                body.u16(id);
                body.blob(topic.kind.as_bytes());
                body.blob(b"ros2msg");
                body.blob(definition(topic.kind).as_bytes());
            });
            record(&mut records, op::CHANNEL, |body| {
                body.u16(id);
                body.u16(id);
                body.blob(topic.name.as_bytes());
                body.blob(b"cdr");
                body.map([("offered_qos_profiles", quality(topic.service).as_str())]);
            });
        }
        records
    }

    fn close_chunk(&mut self) -> Result<(), RecordError> {
        let Some((start, end)) = self.span.take() else {
            return Ok(());
        };
        let compressed = self.compressor.compress(&self.chunk);
        let compressed = compressed.map_err(|source| RecordError::io(&self.outlet.path, source))?;
        let offset = self.written;
        let mut bytes = Vec::new();
        record(&mut bytes, op::CHUNK, |body| {
            body.u64(start);
            body.u64(end);
            body.u64(self.chunk.len() as u64);
            body.u32(crc32fast::hash(&self.chunk));
            body.blob(compression::NAME);
            body.u64(compressed.len() as u64);
            body.extend_from_slice(&compressed);
        });
        let length = bytes.len() as u64;
        let mut offsets = Vec::new();
        for (id, entries) in (1_u16..).zip(&mut self.index) {
            if entries.is_empty() {
                continue;
            }
            let place = record(&mut bytes, op::MESSAGE_INDEX, |body| {
                body.u16(id);
                body.u32(16 * entries.len() as u32);
                for (time, place) in entries.drain(..) {
                    body.u64(time);
                    body.u64(place);
                }
            });
            offsets.u16(id);
            offsets.u64(offset + place.start as u64);
        }
        let indexes = bytes.len() as u64 - length;
        record(&mut self.chunk_indexes, op::CHUNK_INDEX, |body| {
            body.u64(start);
            body.u64(end);
            body.u64(offset);
            body.u64(length);
            body.blob(&offsets);
            body.u64(indexes);
            body.blob(compression::NAME);
            body.u64(compressed.len() as u64);
            body.u64(self.chunk.len() as u64);
        });
        self.append(&bytes);
        self.chunks += 1;
        self.chunk.clear();
        self.outlet.drain()
    }

    fn say(&mut self, time: u64, topic: usize, message: &Message) {
        let place = record(&mut self.chunk, op::MESSAGE, |body| {
            body.u16(topic as u16 + 1);
            body.u32(self.counts[topic] as u32);
            body.u64(time);
            body.u64(time);
            body.extend_from_slice(&message.to_cdr());
        });
        self.index[topic].push((time, place.start as u64));
        self.counts[topic] += 1;
        let widen = |span: Option<(u64, u64)>| {
            span.map_or((time, time), |(first, last)| {
                (first.min(time), last.max(time))
            })
        };
        self.span = Some(widen(self.span));
        self.whole = Some(widen(self.whole));
    }

    /// The end of the data section, the summary section and the footer.
    fn append_end(&mut self) {
        let checksum = self.checksum.clone().finalize();
        let mut end = Vec::new();
        record(&mut end, op::DATA_END, |body| body.u32(checksum));
        self.append(&end);
        let start = self.written;
        let mut section = self.channels();
        let (first, last) = self.whole.unwrap_or_default();
        record(&mut section, op::STATISTICS, |body| {
            body.u64(self.counts.iter().sum());
            body.u16(self.counts.len() as u16);
            body.u32(self.counts.len() as u32);
            body.u32(0);
            body.u32(0);
            body.u32(self.chunks);
            body.u64(first);
            body.u64(last);
            let mut counts = Vec::new();
            for (id, count) in (1_u16..).zip(&self.counts) {
                counts.u16(id);
                counts.u64(*count);
            }
            body.blob(&counts);
        });
        section.extend_from_slice(&self.chunk_indexes);
        let footer = record(&mut section, op::FOOTER, |body| {
            body.u64(start);
            body.u64(0);
            body.u32(0);
        });
        let checksum = crc32fast::hash(&section[..footer.end - 4]);
        section[footer.end - 4..].copy_from_slice(&checksum.to_le_bytes());
        self.append(&section);
        self.append(MAGIC);
    }

    /// `metadata.yaml`.
    fn metadata(&self) -> String {
        let (first, last) = self.whole.unwrap_or_default();
        let count: u64 = self.counts.iter().sum();
        let span = format!("nanoseconds: {}", last - first);
        let mut text = format!(
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    {span}\n  \
             starting_time:\n    nanoseconds_since_epoch: {first}\n  message_count: {count}\n  \
             topics_with_message_count:\n"
        );
        for (topic, count) in self.topics().iter().zip(&self.counts) {
            let quality = quality(topic.service).replace('\n', "\\n");
            let _ = write!(
                text,
                "    - topic_metadata:\n        name: {}\n        type: {}\n        \
                 serialization_format: cdr\n        offered_qos_profiles: \"{quality}\"\n      \
                 message_count: {count}\n",
                topic.name, topic.kind
            );
        }
        let _ = write!(
            text,
            "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {FILE}\n  files:\n    \
             - path: {FILE}\n      starting_time:\n        nanoseconds_since_epoch: {first}\n      \
             duration:\n        {span}\n      message_count: {count}\n"
        );
        text
    }
}

/// A quality of service as bags of version 5 write it: numbers of the middleware's enumerations.
fn quality(service: Service) -> String {
    let (depth, reliability, durability) = match service {
        Service::Reliable => (10, 1, 2),
        Service::Sensor => (5, 2, 2),
        Service::Kept => (1, 1, 1),
        Service::Clock => (1, 2, 2),
    };
    let forever = "    sec: 9223372036\n    nsec: 854775807\n";
    format!(
        "- history: 1\n  depth: {depth}\n  reliability: {reliability}\n  durability: {durability}\n  \
         deadline:\n{forever}  lifespan:\n{forever}  liveliness: 1\n  liveliness_lease_duration:\n{forever}  \
         avoid_ros_namespace_conventions: false"
    )
}

impl Recorder for Rosbag {
    fn begin(&mut self, header: &Header) -> Result<(), RecordError> {
        check_begin(self.stage, header).map_err(|reason| self.outlet.refused(reason))?;
        let speaker = Speaker::new(&self.scenario, &header.signals);
        let speaker = speaker.map_err(|reason| self.outlet.refused(reason))?;
        self.counts = vec![0; speaker.topics().len()];
        self.index = vec![Vec::new(); speaker.topics().len()];
        self.speaker = Some(speaker);
        self.stage = Stage::Open;
        self.append(MAGIC);
        let mut bytes = Vec::new();
        record(&mut bytes, op::HEADER, |body| {
            body.blob(b"ros2");
            body.blob(format!("appell {}", header.version).as_bytes());
        });
        bytes.extend(self.channels());
        self.append(&bytes);
        self.outlet.drain()
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        let mut speaker = self.speaker.take();
        let said = match &mut speaker {
            None => check_row(self.stage, t, row, row.len()),
            Some(speaker) => check_row(self.stage, t, row, row.len()).and_then(|()| {
                let time = (t * 1e9).round() as u64;
                speaker.say(t, row, &mut |topic, message| {
                    self.say(time, topic, &message);
                    Ok(())
                })
            }),
        };
        self.speaker = speaker;
        said.map_err(|reason| self.outlet.refused(reason))?;
        let long = |(start, end): (u64, u64)| end - start >= CHUNK_DURATION;
        match self.chunk.len() > CHUNK_BYTES || self.span.is_some_and(long) {
            true => self.close_chunk(),
            false => Ok(()),
        }
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        // Bags hold what robots say, and no robot says this.
        check_event(self.stage, event).map_err(|reason| self.outlet.refused(reason))
    }

    fn finish(&mut self, _summary: Closing<'_>) -> Result<(), RecordError> {
        match self.stage {
            Stage::Created => return Err(self.outlet.refused("begin must come first".to_owned())),
            Stage::Open => {
                self.close_chunk()?;
                self.append_end();
                self.stage = Stage::Finished;
            }
            Stage::Finished => {}
        }
        self.outlet.close()?;
        let path = self.folder.join("metadata.yaml");
        std::fs::write(&path, self.metadata()).map_err(|source| RecordError::io(&path, source))
    }
}

/// The messages of one topic, in the order of their times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spoken {
    /// Name of the topic.
    pub topic: String,
    /// Type, such as `geometry_msgs/msg/Twist`.
    pub kind: String,
    /// Time at which each was recorded, ns, and its bytes: encapsulation and CDR.
    pub messages: Vec<(u64, Vec<u8>)>,
}

/// Reads a bag: a folder with `metadata.yaml`, or the MCAP file itself. Gives the topics of these types.
///
/// # Errors
/// It cannot be read, is stored otherwise than in MCAP, or is damaged.
pub fn read(path: &Path, kinds: &[&str]) -> Result<Vec<Spoken>, RecordError> {
    let files = match path.is_dir() {
        false => vec![path.to_owned()],
        true => {
            let entries =
                std::fs::read_dir(path).map_err(|source| RecordError::io(path, source))?;
            let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
            let stored = |file: &PathBuf, as_: &str| file.extension().is_some_and(|e| e == as_);
            if files.iter().any(|file| stored(file, "db3")) {
                return Err(RecordError::refused(
                    path,
                    "a bag must be stored in MCAP, got SQLite: `ros2 bag convert`, or rosbags-convert of the \
                     Python package rosbags, makes one of the other",
                ));
            }
            files.retain(|file| stored(file, "mcap"));
            files.sort();
            files
        }
    };
    if files.is_empty() {
        return Err(RecordError::refused(
            path,
            "a bag must have a file in MCAP, got none",
        ));
    }
    let mut spoken: BTreeMap<String, Spoken> = BTreeMap::new();
    for file in files {
        let bytes = std::fs::read(&file).map_err(|source| RecordError::io(&file, source))?;
        let mut reader = Reader {
            kinds,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            allowance: BAG_BYTES_MAX,
            spoken: &mut spoken,
        };
        let Some(records) = bytes.strip_prefix(MAGIC) else {
            return Err(RecordError::corrupt(
                &file,
                "does not start with the mark of an MCAP file",
            ));
        };
        let read = reader.records(records, true);
        read.map_err(|reason| RecordError::corrupt(&file, reason))?;
    }
    let mut spoken: Vec<Spoken> = spoken.into_values().collect();
    for topic in &mut spoken {
        topic.messages.sort_by_key(|(time, _)| *time);
    }
    Ok(spoken)
}

struct Reader<'a> {
    kinds: &'a [&'a str],
    schemas: BTreeMap<u16, String>,
    /// Topic of each channel that is wanted.
    channels: BTreeMap<u16, String>,
    allowance: u64,
    spoken: &'a mut BTreeMap<String, Spoken>,
}

impl Reader<'_> {
    /// Reads records up to the end of the data, which a bag whose writer was killed does not have.
    fn records(&mut self, bytes: &[u8], is_file: bool) -> Result<(), String> {
        let mut rest = Take(bytes);
        while let Some((opcode, body)) = rest.record() {
            let damaged = |what: &str| format!("damaged {what}");
            match opcode {
                op::DATA_END if is_file => return Ok(()),
                op::SCHEMA => self.schema(body).ok_or_else(|| damaged("schema"))?,
                op::CHANNEL => self.channel(body).ok_or_else(|| damaged("channel"))??,
                op::MESSAGE => self.message(body).ok_or_else(|| damaged("message"))?,
                op::CHUNK if is_file => self.chunk(body)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn schema(&mut self, mut body: Take) -> Option<()> {
        let id = body.u16()?;
        let name = body.text()?.to_owned();
        self.schemas.insert(id, name);
        Some(())
    }

    fn channel(&mut self, mut body: Take) -> Option<Result<(), String>> {
        let (id, schema) = (body.u16()?, body.u16()?);
        let topic = body.text()?;
        let encoding = body.text()?;
        let Some(kind) = self.schemas.get(&schema) else {
            return Some(Ok(()));
        };
        if !self.kinds.contains(&kind.as_str()) {
            return Some(Ok(()));
        }
        if encoding != "cdr" {
            return Some(Err(format!(
                "topic {topic}: messages must be CDR, got {encoding:.20}"
            )));
        }
        self.channels.insert(id, topic.to_owned());
        self.spoken
            .entry(topic.to_owned())
            .or_insert_with(|| Spoken {
                topic: topic.to_owned(),
                kind: kind.clone(),
                messages: Vec::new(),
            });
        Some(Ok(()))
    }

    fn message(&mut self, mut body: Take) -> Option<()> {
        let id = body.u16()?;
        body.u32()?;
        let time = body.u64()?;
        body.u64()?;
        if let Some(topic) = self.channels.get(&id) {
            let spoken = self.spoken.get_mut(topic)?;
            spoken.messages.push((time, body.0.to_vec()));
        }
        Some(())
    }

    fn chunk(&mut self, mut body: Take) -> Result<(), String> {
        let mut fields = || -> Option<_> {
            body.bytes(16)?;
            let size = body.u64()?;
            let checksum = body.u32()?;
            let compression = body.text()?;
            let length = usize::try_from(body.u64()?).ok()?;
            Some((size, checksum, compression, body.bytes(length)?))
        };
        let (size, checksum, compression, data) = fields().ok_or("damaged chunk")?;
        if size > CHUNK_BYTES_MAX.min(self.allowance) {
            return Err(format!(
                "a chunk must be at most {CHUNK_BYTES_MAX} bytes, got {size}"
            ));
        }
        self.allowance -= size;
        let records = match compression {
            "" => data.to_vec(),
            "zstd" => Decompressor::new()
                .and_then(|mut decompressor| decompressor.decompress(data, size as usize))
                .map_err(|error| format!("damaged chunk: {error}"))?,
            other => {
                return Err(format!(
                    "compression must be zstd or none, got {other:.20}: `ros2 bag convert` changes it"
                ));
            }
        };
        let intact = checksum == 0 || crc32fast::hash(&records) == checksum;
        if records.len() as u64 != size || !intact {
            return Err("chunk with a wrong checksum".to_owned());
        }
        self.records(&records, false)
    }
}
