//! MCAP: a recording that explains itself to Foxglove, PlotJuggler and any MCAP reader, and that
//! stays readable when its writer is killed.
//!
//! ```text
//! magic, header
//! metadata "appell"           header as JSON, scenario as TOML, checksum
//! schema and channel          of each topic: /world, /robot/<name>, /events
//! chunk, message indexes      every 0.25 s of simulated time, zstd
//! …
//! metadata "appell.summary"   summary as JSON, checksum
//! data end, summary section, footer, magic
//! ```
//!
//! A chunk reaches the file by one write, so what a kill cuts off is at most the last chunk.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs::File;
use std::path::Path;

use super::compression::{self, Compressor, Decompressor};
use super::container::{FOOTER, MAGIC, PREFIX, Put, Take, op, record};
use super::outlet::{Outlet, Sink};
use super::protobuf::Layout;
use super::{
    Closing, Event, Header, RecordError, Recorder, Recording, Stage, check_begin, check_event,
    check_row,
};
use crate::signal::Signal;

/// Longest simulated time of a chunk, ns.
const CHUNK_DURATION: u64 = 250_000_000;

/// A chunk closes before it grows beyond this many bytes.
const CHUNK_BYTES: usize = 4 << 20;

/// Largest chunk that is read, bytes after decompression.
const CHUNK_BYTES_MAX: u64 = 64 << 20;

/// Largest ratio of all chunks, after decompression, to the file; recordings stay far below.
const EXPANSION_MAX: u64 = 1024;

/// Fast: the low bits of most floats do not compress; level 1 takes twice the time and saves 10 %.
const COMPRESSION_LEVEL: i32 = -7;

const HEADER_NAME: &str = "appell";
const SUMMARY_NAME: &str = "appell.summary";
const EVENTS_TOPIC: &str = "/events";
const EVENT_SCHEMA: &str = r#"{"type":"object","properties":{"t":{"type":"number"},"robot":{"type":"string"},"kind":{"type":"string"},"text":{"type":"string"},"position":{"type":["array","null"],"items":{"type":["number","null"]}}}}"#;

/// Writes an MCAP file.
pub struct Mcap<W: Sink = File> {
    outlet: Outlet<W>,
    stage: Stage,
    compressor: Compressor<'static>,
    row: RowTemplate,
    chunk: Chunk,
    extent: Extent,
    summary: SummarySection,
}

/// The message records of one row, with places for what differs from row to row.
#[derive(Default)]
struct RowTemplate {
    bytes: Vec<u8>,
    /// Place of each message record; its sequence number and times are at fixed distances.
    messages: Vec<usize>,
    /// Place of the time, then of each signal.
    values: Vec<usize>,
    sequence: u32,
}

/// The open chunk.
#[derive(Default)]
struct Chunk {
    records: Vec<u8>,
    compressed: Vec<u8>,
    /// Earliest and latest time, ns.
    span: Option<(u64, u64)>,
    /// Time and place of each row and of each event.
    rows: Vec<(u64, u64)>,
    events: Vec<(u64, u64)>,
}

/// The data section so far.
#[derive(Default)]
struct Extent {
    length: u64,
    checksum: crc32fast::Hasher,
}

/// What the end of the file repeats and counts.
#[derive(Default)]
struct SummarySection {
    schemas: Vec<u8>,
    channels: Vec<u8>,
    chunk_indexes: Vec<u8>,
    metadata_indexes: Vec<u8>,
    chunks: u32,
    rows: u64,
    events: u64,
    span: Option<(u64, u64)>,
}

impl Mcap {
    /// A recorder that writes `path`.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        Self::over(Outlet::create(path)?)
    }
}

impl<W: Sink> Mcap<W> {
    /// A recorder that writes to `sink`, called `name` in messages.
    ///
    /// # Errors
    /// There is no memory for the compressor.
    pub fn new(sink: W, name: &Path) -> Result<Self, RecordError> {
        Self::over(Outlet::new(sink, name))
    }

    /// The sink, with what it has taken so far.
    pub fn into_sink(self) -> W {
        self.outlet.sink
    }

    fn over(outlet: Outlet<W>) -> Result<Self, RecordError> {
        let compressor = Compressor::new(COMPRESSION_LEVEL)
            .map_err(|source| RecordError::io(&outlet.path, source))?;
        Ok(Self {
            outlet,
            stage: Stage::Created,
            compressor,
            row: RowTemplate::default(),
            chunk: Chunk::default(),
            extent: Extent::default(),
            summary: SummarySection::default(),
        })
    }

    /// Appends a record to the data section; gives its place and length in the file.
    fn append(&mut self, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) -> (u64, u64) {
        let place = record(&mut self.outlet.pending, opcode, body);
        self.extent.extend(&self.outlet.pending[place])
    }

    /// Appends metadata with the checksum of its pairs, which are in the order of their keys.
    fn append_metadata(&mut self, name: &str, pairs: &[(&str, &str)]) {
        let checksum = checksum(pairs.iter().copied());
        let sealed = std::iter::once(("crc32", checksum.as_str())).chain(pairs.iter().copied());
        let (offset, length) = self.append(op::METADATA, |body| {
            body.blob(name.as_bytes());
            body.map(sealed);
        });
        record(
            &mut self.summary.metadata_indexes,
            op::METADATA_INDEX,
            |body| {
                body.u64(offset);
                body.u64(length);
                body.blob(name.as_bytes());
            },
        );
    }

    /// Writes schemas and channels, and lays out the row.
    fn append_channels(&mut self, layout: &Layout, signals: &[Signal]) {
        let SummarySection {
            schemas, channels, ..
        } = &mut self.summary;
        for (id, group) in (1..).zip(&layout.groups) {
            let units = group
                .fields
                .iter()
                .map(|&(_, column)| match column.checked_sub(1) {
                    Some(index) => (signals[index].path.as_str(), signals[index].unit.as_str()),
                    None => ("t", "s"),
                });
            schema(schemas, id, &group.type_name, "protobuf", &group.descriptor);
            channel(channels, id, &group.topic, "protobuf", units);
        }
        let events = event_channel(layout.groups.len());
        schema(
            schemas,
            events,
            "appell.Event",
            "jsonschema",
            EVENT_SCHEMA.as_bytes(),
        );
        channel(channels, events, EVENTS_TOPIC, "json", []);
        for records in [&*schemas, &*channels] {
            self.outlet.pending.extend_from_slice(records);
            self.extent.extend(records);
        }
        self.row = RowTemplate::new(layout, signals.len());
    }

    /// Closes the chunk when a message of `length` bytes at `time` would not fit into it, and
    /// writes what is pending.
    fn make_room(&mut self, time: u64, length: usize) -> Result<(), RecordError> {
        let long = |(start, _)| time.saturating_sub(start) >= CHUNK_DURATION;
        let full = self.chunk.records.len() + length > CHUNK_BYTES;
        if full || self.chunk.span.is_some_and(long) {
            self.close_chunk()?;
        }
        self.outlet.drain()
    }

    /// Compresses the open chunk and appends it with its indexes.
    fn close_chunk(&mut self) -> Result<(), RecordError> {
        let Some((start, end)) = self.chunk.span else {
            return Ok(());
        };
        let chunk = &mut self.chunk;
        chunk.compressed.clear();
        chunk
            .compressed
            .reserve(compression::compress_bound(chunk.records.len()));
        self.compressor
            .compress_to_buffer(&chunk.records, &mut chunk.compressed)
            .map_err(|source| RecordError::io(&self.outlet.path, source))?;
        let chunk = std::mem::take(&mut self.chunk);
        let (offset, length) = self.append(op::CHUNK, |body| {
            body.u64(start);
            body.u64(end);
            body.u64(chunk.records.len() as u64);
            body.u32(crc32fast::hash(&chunk.records));
            body.blob(compression::NAME);
            body.u64(chunk.compressed.len() as u64);
            body.extend_from_slice(&chunk.compressed);
        });
        let index_offsets = self.append_indexes(&chunk);
        let index_length = self.extent.length - offset - length;
        record(&mut self.summary.chunk_indexes, op::CHUNK_INDEX, |body| {
            body.u64(start);
            body.u64(end);
            body.u64(offset);
            body.u64(length);
            body.blob(&index_offsets);
            body.u64(index_length);
            body.blob(compression::NAME);
            body.u64(chunk.compressed.len() as u64);
            body.u64(chunk.records.len() as u64);
        });
        self.summary.count(&chunk);
        self.chunk = chunk;
        self.chunk.clear();
        Ok(())
    }

    /// Appends the message indexes of a chunk; gives the map from channel to place.
    fn append_indexes(&mut self, chunk: &Chunk) -> Vec<u8> {
        let places: Vec<usize> = self.row.messages.clone();
        let rows = places.iter().map(|&place| (&chunk.rows, place as u64));
        let all = rows.chain([(&chunk.events, 0)]);
        let mut offsets = Vec::new();
        for (id, (entries, place)) in (1..).zip(all) {
            if entries.is_empty() {
                continue;
            }
            let (offset, _) = self.append(op::MESSAGE_INDEX, |body| {
                body.u16(id);
                body.u32(16 * entries.len() as u32);
                for &(time, start) in entries {
                    body.u64(time);
                    body.u64(start + place);
                }
            });
            offsets.u16(id);
            offsets.u64(offset);
        }
        offsets
    }

    /// Appends the end of the data section, the summary section and the footer.
    fn append_end(&mut self) {
        let data_checksum = self.extent.checksum.clone().finalize();
        self.append(op::DATA_END, |body| body.u32(data_checksum));
        let start = self.extent.length;
        let section = self.summary.encode(start, self.row.messages.len());
        self.outlet.pending.extend_from_slice(&section);
        self.outlet.pending.extend_from_slice(MAGIC);
    }
}

impl<W: Sink> Recorder for Mcap<W> {
    fn begin(&mut self, header: &Header) -> Result<(), RecordError> {
        check_begin(self.stage, header).map_err(|reason| self.outlet.refused(reason))?;
        let layout = Layout::new(&header.signals).map_err(|reason| self.outlet.refused(reason))?;
        let described = Header {
            scenario_text: String::new(),
            ..header.clone()
        };
        let json = json(&described);
        self.stage = Stage::Open;
        self.outlet.pending.extend_from_slice(MAGIC);
        self.extent.extend(MAGIC);
        self.append(op::HEADER, |body| {
            body.blob(b"");
            body.blob(format!("appell {}", header.version).as_bytes());
        });
        let pairs = [
            ("header", json.as_str()),
            ("scenario.toml", &header.scenario_text),
        ];
        self.append_metadata(HEADER_NAME, &pairs);
        self.append_channels(&layout, &header.signals);
        self.outlet.drain()
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        let signals = self.row.values.len().saturating_sub(1);
        check_row(self.stage, t, row, signals).map_err(|reason| self.outlet.refused(reason))?;
        let time = nanoseconds(t);
        self.make_room(time, self.row.bytes.len())?;
        let start = self.chunk.records.len();
        self.row.append(&mut self.chunk.records, time, t, row);
        self.chunk.rows.push((time, start as u64));
        self.chunk.span = Some(widened(self.chunk.span, (time, time)));
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        check_event(self.stage, event).map_err(|reason| self.outlet.refused(reason))?;
        let time = nanoseconds(event.t);
        let json = json(event);
        self.make_room(time, json.len())?;
        let id = event_channel(self.row.messages.len());
        let sequence = (self.summary.events + self.chunk.events.len() as u64) as u32;
        let place = record(&mut self.chunk.records, op::MESSAGE, |body| {
            body.u16(id);
            body.u32(sequence);
            body.u64(time);
            body.u64(time);
            body.extend_from_slice(json.as_bytes());
        });
        self.chunk.events.push((time, place.start as u64));
        self.chunk.span = Some(widened(self.chunk.span, (time, time)));
        Ok(())
    }

    fn finish(&mut self, summary: Closing<'_>) -> Result<(), RecordError> {
        match self.stage {
            Stage::Created => return Err(self.outlet.refused("begin must come first".to_owned())),
            Stage::Open => {
                self.close_chunk()?;
                self.append_metadata(SUMMARY_NAME, &[("summary", &json(&summary()))]);
                self.append_end();
                self.stage = Stage::Finished;
            }
            Stage::Finished => {}
        }
        self.outlet.close()
    }
}

impl RowTemplate {
    fn new(layout: &Layout, signals: usize) -> Self {
        let mut row = Self {
            values: vec![0; signals + 1],
            ..Self::default()
        };
        for (id, group) in (1..).zip(&layout.groups) {
            let place = record(&mut row.bytes, op::MESSAGE, |body| {
                body.u16(id);
                body.u32(0);
                body.u64(0);
                body.u64(0);
                body.extend_from_slice(&group.template);
            });
            row.messages.push(place.start);
            let message = place.end - group.template.len();
            for &(offset, column) in &group.fields {
                row.values[column] = message + offset;
            }
        }
        row
    }

    /// Appends the messages of a row.
    fn append(&mut self, records: &mut Vec<u8>, time: u64, t: f64, row: &[f64]) {
        let start = records.len();
        records.extend_from_slice(&self.bytes);
        let bytes = &mut records[start..];
        let mut stamp = [0; 20];
        stamp[..4].copy_from_slice(&self.sequence.to_le_bytes());
        stamp[4..12].copy_from_slice(&time.to_le_bytes());
        stamp[12..].copy_from_slice(&time.to_le_bytes());
        for place in &self.messages {
            let place = place + PREFIX + 2;
            bytes[place..place + 20].copy_from_slice(&stamp);
        }
        for (&place, value) in self.values.iter().zip(std::iter::once(&t).chain(row)) {
            bytes[place..place + 8].copy_from_slice(&value.to_le_bytes());
        }
        self.sequence = self.sequence.wrapping_add(1);
    }
}

impl Chunk {
    /// Empties the chunk and keeps its memory.
    fn clear(&mut self) {
        self.records.clear();
        self.rows.clear();
        self.events.clear();
        self.span = None;
    }
}

impl Extent {
    /// Counts bytes that follow; gives their place and length in the file.
    fn extend(&mut self, bytes: &[u8]) -> (u64, u64) {
        let place = (self.length, bytes.len() as u64);
        self.checksum.update(bytes);
        self.length += place.1;
        place
    }
}

impl SummarySection {
    fn count(&mut self, chunk: &Chunk) {
        self.chunks += 1;
        self.rows += chunk.rows.len() as u64;
        self.events += chunk.events.len() as u64;
        if let Some(span) = chunk.span {
            self.span = Some(widened(self.span, span));
        }
    }

    /// The section, which is at `start` in the file, and the footer.
    fn encode(&self, start: u64, groups: usize) -> Vec<u8> {
        let mut statistics = Vec::new();
        record(&mut statistics, op::STATISTICS, |body| {
            self.statistics(body, groups)
        });
        let parts = [
            (op::SCHEMA, &self.schemas),
            (op::CHANNEL, &self.channels),
            (op::STATISTICS, &statistics),
            (op::CHUNK_INDEX, &self.chunk_indexes),
            (op::METADATA_INDEX, &self.metadata_indexes),
        ];
        let mut section = Vec::new();
        let mut offsets = Vec::new();
        for (opcode, records) in parts.into_iter().filter(|(_, records)| !records.is_empty()) {
            record(&mut offsets, op::SUMMARY_OFFSET, |body| {
                body.push(opcode);
                body.u64(start + section.len() as u64);
                body.u64(records.len() as u64);
            });
            section.extend_from_slice(records);
        }
        let offsets_start = start + section.len() as u64;
        section.extend_from_slice(&offsets);
        let footer = record(&mut section, op::FOOTER, |body| {
            body.u64(start);
            body.u64(offsets_start);
            body.u32(0);
        });
        let checksum = crc32fast::hash(&section[..footer.end - 4]);
        section[footer.end - 4..].copy_from_slice(&checksum.to_le_bytes());
        section
    }

    fn statistics(&self, body: &mut Vec<u8>, groups: usize) {
        let (start, end) = self.span.unwrap_or_default();
        body.u64(self.rows * groups as u64 + self.events);
        body.u16(event_channel(groups));
        body.u32(u32::from(event_channel(groups)));
        body.u32(0);
        body.u32(2);
        body.u32(self.chunks);
        body.u64(start);
        body.u64(end);
        let mut counts = Vec::new();
        for id in 1..=event_channel(groups) {
            let events = id == event_channel(groups);
            counts.u16(id);
            counts.u64(if events { self.events } else { self.rows });
        }
        body.blob(&counts);
    }
}

/// Nanoseconds of a time that the recorder has checked.
fn nanoseconds(t: f64) -> u64 {
    (t * 1e9).round() as u64
}

/// Channel of the events; those of the groups are before it, from 1 on.
fn event_channel(groups: usize) -> u16 {
    u16::try_from(groups + 1).expect("Layout::new bounds the groups")
}

fn widened(span: Option<(u64, u64)>, (start, end): (u64, u64)) -> (u64, u64) {
    span.map_or((start, end), |(first, last)| {
        (first.min(start), last.max(end))
    })
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("recorded types have text keys and no failing serializer")
}

fn schema(out: &mut Vec<u8>, id: u16, name: &str, encoding: &str, data: &[u8]) {
    record(out, op::SCHEMA, |body| {
        body.u16(id);
        body.blob(name.as_bytes());
        body.blob(encoding.as_bytes());
        body.blob(data);
    });
}

/// A channel whose schema has the same number.
fn channel<'a>(
    out: &mut Vec<u8>,
    id: u16,
    topic: &str,
    encoding: &str,
    metadata: impl IntoIterator<Item = (&'a str, &'a str)>,
) {
    record(out, op::CHANNEL, |body| {
        body.u16(id);
        body.u16(id);
        body.blob(topic.as_bytes());
        body.blob(encoding.as_bytes());
        body.map(metadata);
    });
}

/// Checksum of the pairs of a metadata record, hexadecimal: MCAP itself has none for them.
fn checksum<'a>(pairs: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut hasher = crc32fast::Hasher::new();
    for (key, value) in pairs {
        hasher.update(key.as_bytes());
        hasher.update(b"=");
        hasher.update(value.as_bytes());
        hasher.update(b"\n");
    }
    format!("{:08x}", hasher.finalize())
}

/// Reads a recording from the bytes of a file.
///
/// A file with its footer must be intact; of one without, all rows before the first damage are
/// taken. Never takes a chunk whose checksum is wrong.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Recording, RecordError> {
    let corrupt = |reason: String| RecordError::corrupt(path, reason);
    if !bytes.starts_with(MAGIC) {
        let start = if MAGIC.starts_with(bytes) {
            "ends before"
        } else {
            "does not start with"
        };
        return Err(corrupt(format!(
            "the file {start} the mark of an MCAP file"
        )));
    }
    let mut reader = Reader::new(bytes.len() as u64).map_err(corrupt)?;
    let outcome = reader.data_section(bytes);
    let finished = summary_checksum(bytes);
    let complete = match (finished, outcome) {
        (None, _) => false,
        (Some(true), Ok(())) => true,
        (Some(false), Ok(())) => return Err(corrupt("summary section: wrong checksum".to_owned())),
        (Some(_), Err(damage)) => return Err(corrupt(damage)),
    };
    if reader.layout.is_none() {
        return Err(corrupt("the file ends before its appell header".to_owned()));
    }
    reader.recording.complete = complete;
    Ok(reader.recording)
}

/// Whether the checksum before the footer is right; nothing when the file has no footer.
fn summary_checksum(bytes: &[u8]) -> Option<bool> {
    let body = bytes.strip_suffix(MAGIC)?;
    let footer_start = body.len().checked_sub(FOOTER)?;
    let (opcode, mut footer) = Take(&body[footer_start..]).record()?;
    if opcode != op::FOOTER {
        return None;
    }
    let start = footer.u64()?;
    footer.u64()?;
    let stored = footer.u32()?;
    footer.end()?;
    let range = usize::try_from(start)
        .ok()
        .and_then(|start| body.get(start..body.len() - 4));
    let absent = stored == 0;
    Some(absent || range.is_some_and(|range| crc32fast::hash(range) == stored))
}

/// Builds a recording from records.
struct Reader {
    recording: Recording,
    layout: Option<Layout>,
    channels: HashMap<u16, Topic>,
    topics: HashSet<String>,
    /// Time and values of the row whose messages are being read.
    row: Vec<f64>,
    /// Groups of that row that were read.
    seen: Vec<bool>,
    seen_count: usize,
    sequence: Option<u32>,
    decompressor: Decompressor<'static>,
    /// Bytes that may still come out of chunks.
    allowance: u64,
}

/// What the messages of a channel are.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Topic {
    Group(usize),
    Events,
}

impl Reader {
    fn new(file_length: u64) -> Result<Self, String> {
        let decompressor = Decompressor::new().map_err(|error| error.to_string())?;
        Ok(Self {
            recording: Recording::default(),
            layout: None,
            channels: HashMap::new(),
            topics: HashSet::new(),
            row: Vec::new(),
            seen: Vec::new(),
            seen_count: 0,
            sequence: None,
            decompressor,
            allowance: CHUNK_BYTES_MAX + EXPANSION_MAX.saturating_mul(file_length),
        })
    }

    /// Reads up to the end of the data section; says what and where the first damage is.
    fn data_section(&mut self, bytes: &[u8]) -> Result<(), String> {
        let mut rest = Take(&bytes[MAGIC.len()..]);
        loop {
            let offset = bytes.len() - rest.0.len();
            let at = |reason: String| format!("byte {offset}: {reason}");
            let (opcode, body) = rest
                .record()
                .ok_or_else(|| at("a record is cut off".to_owned()))?;
            match opcode {
                op::DATA_END => return data_end(body, &bytes[..offset]).map_err(at),
                op::CHUNK => self.chunk(body).map_err(at)?,
                opcode => self.data_record(opcode, body).map_err(at)?,
            }
        }
    }

    /// Reads a record of the data section other than a chunk.
    fn data_record(&mut self, opcode: u8, body: Take) -> Result<(), String> {
        let name = match opcode {
            op::HEADER => "header",
            op::SCHEMA => "schema",
            op::CHANNEL => "channel",
            op::MESSAGE_INDEX => "message index",
            op::METADATA => "metadata",
            other => return Err(format!("unexpected record {other:#04x}")),
        };
        let damaged = || format!("damaged {name}");
        match opcode {
            op::HEADER => file_header(body).ok_or_else(damaged),
            op::SCHEMA => schema_record(body).ok_or_else(damaged),
            op::MESSAGE_INDEX => message_index(body).ok_or_else(damaged),
            op::CHANNEL => self.channel(body).ok_or_else(damaged),
            _ => self.metadata(body).ok_or_else(damaged)?,
        }
    }

    fn chunk(&mut self, mut body: Take) -> Result<(), String> {
        let (size, checksum, compression, data) = chunk_fields(&mut body).ok_or("damaged chunk")?;
        if size > CHUNK_BYTES_MAX.min(self.allowance) {
            return Err(format!(
                "a chunk must be at most {CHUNK_BYTES_MAX} bytes, got {size}"
            ));
        }
        self.allowance -= size;
        let records = match compression {
            "" => data.to_vec(),
            "zstd" => {
                let mut records = Vec::with_capacity(size as usize);
                self.decompressor
                    .decompress_to_buffer(data, &mut records)
                    .map_err(|error| format!("damaged chunk: {error}"))?;
                records
            }
            other => return Err(format!("compression must be zstd or none, got {other:.20}")),
        };
        if records.len() as u64 != size || crc32fast::hash(&records) != checksum {
            return Err("chunk with a wrong checksum".to_owned());
        }
        let mut rest = Take(&records);
        while !rest.0.is_empty() {
            let (opcode, body) = rest.record().ok_or("chunk with a record cut off")?;
            if opcode == op::MESSAGE {
                self.message(body)?;
            } else {
                self.data_record(opcode, body)?;
            }
        }
        Ok(())
    }

    fn channel(&mut self, mut body: Take) -> Option<()> {
        let layout = self.layout.as_ref()?;
        let id = body.u16()?;
        body.u16()?;
        let name = body.text()?;
        body.text()?;
        body.map()?;
        body.end()?;
        let topic = if name == EVENTS_TOPIC {
            Topic::Events
        } else {
            Topic::Group(layout.groups.iter().position(|group| group.topic == name)?)
        };
        match self.channels.get(&id) {
            // Other programs repeat channels.
            Some(known) => (*known == topic).then_some(()),
            None => {
                self.channels.insert(id, topic);
                self.topics.insert(name.to_owned()).then_some(())
            }
        }
    }

    fn metadata(&mut self, mut body: Take) -> Option<Result<(), String>> {
        let name = body.text()?;
        let mut pairs: BTreeMap<&str, &str> = body.map()?.into_iter().collect();
        body.end()?;
        let ours = [HEADER_NAME, SUMMARY_NAME].contains(&name);
        let stored = pairs.remove("crc32");
        if ours && stored != Some(&checksum(pairs.iter().map(|(key, value)| (*key, *value)))) {
            return Some(Err(format!("metadata {name} with a wrong checksum")));
        }
        Some(match name {
            HEADER_NAME => self.header(pairs.get("header")?, pairs.get("scenario.toml")?),
            SUMMARY_NAME => {
                self.recording.summary = Some(serde_json::from_str(pairs.get("summary")?).ok()?);
                Ok(())
            }
            _ => Ok(()),
        })
    }

    fn header(&mut self, json: &str, scenario: &str) -> Result<(), String> {
        if self.layout.is_some() {
            return Err("two appell headers: a file must hold one recording".to_owned());
        }
        let mut header: Header =
            serde_json::from_str(json).map_err(|error| format!("appell header: {error}"))?;
        scenario.clone_into(&mut header.scenario_text);
        super::check_signals(&header.signals)?;
        let layout = Layout::new(&header.signals)?;
        self.recording.columns = vec![Vec::new(); header.signals.len()];
        self.row = vec![0.0; header.signals.len() + 1];
        self.seen = vec![false; layout.groups.len()];
        self.recording.header = header;
        self.layout = Some(layout);
        Ok(())
    }

    fn message(&mut self, mut body: Take) -> Result<(), String> {
        let (topic, sequence) = self
            .message_fields(&mut body)
            .ok_or("message of no channel")?;
        let Topic::Group(group) = topic else {
            let event =
                serde_json::from_slice(body.0).map_err(|error| format!("event: {error}"))?;
            self.recording.events.push(event);
            return Ok(());
        };
        let layout = self
            .layout
            .as_ref()
            .ok_or("message before the appell header")?;
        if !layout.groups[group].decode(body.0, &mut self.row) {
            return Err("message that does not fit its signals".to_owned());
        }
        let follows = if self.seen_count == 0 {
            self.sequence
                .is_none_or(|last| sequence == last.wrapping_add(1))
        } else {
            !self.seen[group] && self.sequence == Some(sequence)
        };
        if !follows {
            return Err(format!("message {sequence} does not follow the one before"));
        }
        self.sequence = Some(sequence);
        self.seen[group] = true;
        self.seen_count += 1;
        if self.seen_count == self.seen.len() {
            self.end_row();
        }
        Ok(())
    }

    fn message_fields(&self, body: &mut Take) -> Option<(Topic, u32)> {
        let id = body.u16()?;
        let sequence = body.u32()?;
        body.bytes(16)?;
        Some((*self.channels.get(&id)?, sequence))
    }

    fn end_row(&mut self) {
        self.recording.times.push(self.row[0]);
        for (column, value) in self.recording.columns.iter_mut().zip(&self.row[1..]) {
            column.push(*value);
        }
        self.seen.fill(false);
        self.seen_count = 0;
    }
}

fn data_end(mut body: Take, data: &[u8]) -> Result<(), String> {
    let stored = body
        .u32()
        .filter(|_| body.end().is_some())
        .ok_or("damaged data end")?;
    if stored == 0 || crc32fast::hash(data) == stored {
        Ok(())
    } else {
        Err("data section with a wrong checksum".to_owned())
    }
}

fn file_header(mut body: Take) -> Option<()> {
    body.text()?;
    body.text()?;
    body.end()
}

fn schema_record(mut body: Take) -> Option<()> {
    body.u16()?;
    body.text()?;
    body.text()?;
    body.blob()?;
    body.end()
}

fn message_index(mut body: Take) -> Option<()> {
    body.u16()?;
    body.blob()?;
    body.end()
}

/// Size and checksum after decompression, compression, and the compressed bytes.
fn chunk_fields<'a>(body: &mut Take<'a>) -> Option<(u64, u32, &'a str, &'a [u8])> {
    body.bytes(16)?;
    let size = body.u64()?;
    let checksum = body.u32()?;
    let compression = body.text()?;
    let length = body.u64()?;
    let data = body.bytes(usize::try_from(length).ok()?)?;
    body.end()?;
    Some((size, checksum, compression, data))
}
