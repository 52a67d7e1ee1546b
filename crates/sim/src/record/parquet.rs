//! Parquet: one file of `f64` columns, `t` and the paths, for DuckDB, Polars and pandas.
//!
//! Key-value metadata hold `appell.header`, `appell.scenario.toml`, `appell.units`,
//! `appell.events` and `appell.summary`, JSON but for the scenario. Rows are written in groups, so
//! memory stays bounded; the index comes last, so a file whose writer was killed cannot be read.

use std::collections::BTreeMap;
use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use parquet::basic::{Compression, Encoding, Repetition, Type as PhysicalType, ZstdLevel};
use parquet::column::reader::ColumnReader;
use parquet::data_type::DoubleType;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};

use super::outlet::{Outlet, Sink};
use super::{
    Closing, Event, Header, RecordError, Recorder, Recording, Stage, check_begin, check_event,
    check_row,
};
use crate::signal::Signal;

/// Values gathered before a row group is written: 8 MiB.
const GROUP_VALUES: usize = 1 << 20;

/// Values read at once.
const BATCH: usize = 1 << 13;

/// Writes a Parquet file.
pub struct Parquet<W: Sink = File> {
    outlet: Outlet<W>,
    stage: Stage,
    /// Writes to memory; the outlet takes it from there, so that a full disk loses nothing.
    writer: Option<SerializedFileWriter<Vec<u8>>>,
    /// The open row group: the times, then each signal.
    columns: Vec<Vec<f64>>,
    events: Vec<Event>,
}

impl Parquet {
    /// A recorder that writes `path`.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        Ok(Self::over(Outlet::create(path)?))
    }
}

impl<W: Sink> Parquet<W> {
    /// A recorder that writes to `sink`, called `name` in messages.
    pub fn new(sink: W, name: &Path) -> Self {
        Self::over(Outlet::new(sink, name))
    }

    /// The sink, with what it has taken so far.
    pub fn into_sink(self) -> W {
        self.outlet.sink
    }

    fn over(outlet: Outlet<W>) -> Self {
        Self {
            outlet,
            stage: Stage::Created,
            writer: None,
            columns: Vec::new(),
            events: Vec::new(),
        }
    }

    /// Runs `work` on the writer and takes over the bytes it wrote.
    fn with_writer(
        &mut self,
        work: impl FnOnce(&mut SerializedFileWriter<Vec<u8>>, &[Vec<f64>]) -> Result<(), ParquetError>,
    ) -> Result<(), RecordError> {
        let Some(writer) = &mut self.writer else {
            return Err(self.outlet.refused("begin must come first".to_owned()));
        };
        let done = work(writer, &self.columns).and_then(|()| Ok(writer.flush()?));
        done.map_err(|error| RecordError::refused(&self.outlet.path, error.to_string()))?;
        self.outlet.pending.append(writer.inner_mut());
        Ok(())
    }

    fn close_group(&mut self) -> Result<(), RecordError> {
        if self.columns.first().is_none_or(Vec::is_empty) {
            return Ok(());
        }
        self.with_writer(write_group)?;
        self.columns.iter_mut().for_each(Vec::clear);
        Ok(())
    }
}

impl<W: Sink> Recorder for Parquet<W> {
    fn begin(&mut self, header: &Header) -> Result<(), RecordError> {
        check_begin(self.stage, header).map_err(|reason| self.outlet.refused(reason))?;
        let refused = |error: ParquetError| self.outlet.refused(error.to_string());
        let schema = schema(&header.signals).map_err(refused)?;
        let properties = Arc::new(properties(header).map_err(refused)?);
        let writer = SerializedFileWriter::new(Vec::new(), schema, properties).map_err(refused)?;
        self.writer = Some(writer);
        self.columns = vec![Vec::new(); header.signals.len() + 1];
        self.stage = Stage::Open;
        self.with_writer(|_, _| Ok(()))?;
        self.outlet.drain()
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        let signals = self.columns.len().saturating_sub(1);
        check_row(self.stage, t, row, signals).map_err(|reason| self.outlet.refused(reason))?;
        if self.columns[0].len() * self.columns.len() >= GROUP_VALUES {
            self.close_group()?;
        }
        self.outlet.drain()?;
        for (column, value) in self.columns.iter_mut().zip(std::iter::once(&t).chain(row)) {
            column.push(*value);
        }
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        check_event(self.stage, event).map_err(|reason| self.outlet.refused(reason))?;
        self.events.push(event.clone());
        Ok(())
    }

    fn finish(&mut self, summary: Closing<'_>) -> Result<(), RecordError> {
        if self.stage == Stage::Open {
            self.close_group()?;
            let events = json(&self.events);
            self.with_writer(|writer, _| {
                writer.append_key_value_metadata(pair("appell.events", events));
                writer.append_key_value_metadata(pair("appell.summary", json(&summary())));
                writer.finish().map(drop)
            })?;
            self.stage = Stage::Finished;
        }
        self.outlet.close()
    }
}

fn write_group(
    writer: &mut SerializedFileWriter<Vec<u8>>,
    columns: &[Vec<f64>],
) -> Result<(), ParquetError> {
    let mut group = writer.next_row_group()?;
    for values in columns {
        let mut column = group
            .next_column()?
            .ok_or_else(|| ParquetError::General("fewer columns than signals".to_owned()))?;
        column
            .typed::<DoubleType>()
            .write_batch(values, None, None)?;
        column.close()?;
    }
    group.close().map(drop)
}

fn schema(signals: &[Signal]) -> Result<TypePtr, ParquetError> {
    let names = std::iter::once("t").chain(signals.iter().map(|signal| signal.path.as_str()));
    let fields = names
        .map(|name| {
            let field = Type::primitive_type_builder(name, PhysicalType::DOUBLE)
                .with_repetition(Repetition::REQUIRED)
                .build()?;
            Ok(Arc::new(field))
        })
        .collect::<Result<Vec<_>, ParquetError>>()?;
    Ok(Arc::new(
        Type::group_type_builder("appell")
            .with_fields(fields)
            .build()?,
    ))
}

fn properties(header: &Header) -> Result<WriterProperties, ParquetError> {
    let described = Header {
        scenario_text: String::new(),
        ..header.clone()
    };
    let units: BTreeMap<&str, &str> = header
        .signals
        .iter()
        .map(|signal| (&*signal.path, &*signal.unit))
        .collect();
    Ok(WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_dictionary_enabled(false)
        .set_encoding(Encoding::BYTE_STREAM_SPLIT)
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_key_value_metadata(Some(vec![
            pair("appell.header", json(&described)),
            pair("appell.scenario.toml", header.scenario_text.clone()),
            pair("appell.units", json(&units)),
        ]))
        .build())
}

fn pair(key: &str, value: String) -> KeyValue {
    KeyValue::new(key.to_owned(), value)
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("recorded types have text keys and no failing serializer")
}

/// Reads a recording from the bytes of a file.
pub(super) fn read(path: &Path, bytes: Vec<u8>) -> Result<Recording, RecordError> {
    // The crate is not made for hostile files; a panic inside it means a damaged file.
    catch_unwind(AssertUnwindSafe(|| recording(bytes)))
        .unwrap_or_else(|_| Err("damaged Parquet file".to_owned()))
        .map_err(|reason| RecordError::corrupt(path, reason))
}

fn recording(bytes: Vec<u8>) -> Result<Recording, String> {
    let reader =
        SerializedFileReader::new(Bytes::from(bytes)).map_err(|error| error.to_string())?;
    let pairs: BTreeMap<&str, &str> = reader
        .metadata()
        .file_metadata()
        .key_value_metadata()
        .into_iter()
        .flatten()
        .filter_map(|pair| Some((pair.key.as_str(), pair.value.as_deref()?)))
        .collect();
    let value = |key: &str| {
        pairs
            .get(key)
            .copied()
            .ok_or(format!("metadata must hold {key}"))
    };
    let mut header: Header = parse(value("appell.header")?)?;
    value("appell.scenario.toml")?.clone_into(&mut header.scenario_text);
    let (events, summary) = (
        parse(value("appell.events")?)?,
        parse(value("appell.summary")?)?,
    );
    check_columns(&reader, &header)?;
    let mut columns =
        columns(&reader, header.signals.len() + 1).map_err(|error| error.to_string())?;
    if columns
        .iter()
        .any(|column| column.len() != columns[0].len())
    {
        return Err("columns must have equal lengths".to_owned());
    }
    let times = columns.remove(0);
    Ok(Recording {
        header,
        times,
        columns,
        events,
        summary: Some(summary),
        complete: true,
    })
}

/// The columns of the file must be those of the header.
fn check_columns(reader: &SerializedFileReader<Bytes>, header: &Header) -> Result<(), String> {
    let descriptor = reader.metadata().file_metadata().schema_descr();
    let stored = descriptor.columns().iter().map(|column| column.name());
    if stored.eq(std::iter::once("t").chain(header.signals.iter().map(|signal| &*signal.path))) {
        Ok(())
    } else {
        Err("columns must be those of the header".to_owned())
    }
}

fn columns(
    reader: &SerializedFileReader<Bytes>,
    width: usize,
) -> Result<Vec<Vec<f64>>, ParquetError> {
    let mut columns = vec![Vec::new(); width];
    for index in 0..reader.num_row_groups() {
        let group = reader.get_row_group(index)?;
        for (place, column) in columns.iter_mut().enumerate() {
            let ColumnReader::DoubleColumnReader(mut values) = group.get_column_reader(place)?
            else {
                return Err(ParquetError::General("columns must be f64".to_owned()));
            };
            while values.read_records(BATCH, None, None, column)?.0 > 0 {}
        }
    }
    Ok(columns)
}

fn parse<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_str(text).map_err(|error| error.to_string())
}
