//! Parts of a batch on disk: Parquet files of [`super::PART`] rows, each written whole or not at all.

use std::fs;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use parquet::basic::LogicalType;
use parquet::basic::{Compression, Repetition, Type as PhysicalType, ZstdLevel};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};
use sha2::{Digest, Sha256};

use super::{BatchError, Column, Row};

/// Columns of text after the trial's number.
const TEXTS: [&str; 3] = ["verdict", "reason", "other"];

/// A hash of SHA-256.
pub(super) type Hash = [u8; 32];

/// Hash of a part's rows: what they hold, not how the file stores it.
pub(super) fn leaf(rows: &[Row]) -> Hash {
    let mut digest = Sha256::new();
    for row in rows {
        digest.update(row.trial.to_le_bytes());
        for text in [&row.verdict, &row.reason, &row.other] {
            digest.update((text.len() as u64).to_le_bytes());
            digest.update(text.as_bytes());
        }
        for value in &row.values {
            digest.update(value.to_bits().to_le_bytes());
        }
    }
    digest.finalize().into()
}

/// Root of the hash tree (Merkle) over the parts' hashes, as text.
pub(super) fn root(leaves: &[Hash]) -> String {
    let mut level = leaves.to_vec();
    while level.len() > 1 {
        level = level
            .chunks(2)
            .map(|pair| {
                let mut digest = Sha256::new();
                pair.iter().for_each(|hash| digest.update(hash));
                digest.finalize().into()
            })
            .collect();
    }
    let root = level.first().copied().unwrap_or_default();
    root.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The folder of a batch's parts.
pub(super) struct Store {
    folder: PathBuf,
    columns: Vec<Column>,
}

impl Store {
    /// Opens the folder of a batch, or makes it.
    pub(super) fn open(folder: &Path, hash: &str, columns: &[Column]) -> Result<Store, BatchError> {
        let fail = |path: &Path, error: std::io::Error| BatchError::Folder {
            path: path.to_owned(),
            problem: format!("cannot be written: {error}"),
            hint: "choose another folder with --out, or make room",
        };
        let trials = folder.join("trials");
        let manifest = folder.join("batch.hash");
        if let Ok(stored) = fs::read_to_string(&manifest)
            && stored.trim() != hash
        {
            return Err(BatchError::Folder {
                path: folder.to_owned(),
                problem: "holds another batch: another scenario, other settings or another version"
                    .into(),
                hint: "choose another folder with --out, or remove this one",
            });
        }
        fs::create_dir_all(&trials).map_err(|error| fail(&trials, error))?;
        fs::write(&manifest, format!("{hash}\n")).map_err(|error| fail(&manifest, error))?;
        Ok(Store {
            folder: trials,
            columns: columns.to_vec(),
        })
    }

    /// The file of a part.
    pub(super) fn path(&self, part: u64) -> PathBuf {
        self.folder.join(format!("part-{part:06}.parquet"))
    }

    /// Writes a part: to a file beside it, which then takes its name.
    pub(super) fn write(&self, part: u64, rows: &[Row]) -> Result<(), BatchError> {
        let path = self.path(part);
        let fail = |problem: String| BatchError::Folder {
            path: path.clone(),
            problem: format!("cannot be written: {problem}"),
            hint: "make room, and run the batch again: it goes on with what is missing",
        };
        let bytes = encode(&self.columns, rows).map_err(|error| fail(error.to_string()))?;
        let draft = path.with_extension("draft");
        let save = || -> std::io::Result<()> {
            use std::io::Write;
            let mut file = fs::File::create(&draft)?;
            file.write_all(&bytes)?;
            file.sync_all()?;
            fs::rename(&draft, &path)
        };
        save().map_err(|error| fail(error.to_string()))
    }

    /// The rows of a part that is there whole.
    pub(super) fn read(&self, part: u64, trials: Range<u64>) -> Option<Vec<Row>> {
        let bytes = fs::read(self.path(part)).ok()?;
        // The crate is not made for damaged files; a part that cannot be read is run again.
        let rows = catch_unwind(AssertUnwindSafe(|| decode(&self.columns, bytes))).ok()?;
        rows.ok()
            .filter(|rows| rows.iter().map(|row| row.trial).eq(trials))
    }
}

fn schema(columns: &[Column]) -> Result<TypePtr, ParquetError> {
    let field = |name: &str, kind: PhysicalType, logical: Option<LogicalType>| {
        let field = Type::primitive_type_builder(name, kind)
            .with_repetition(Repetition::REQUIRED)
            .with_logical_type(logical)
            .build()?;
        Ok::<_, ParquetError>(Arc::new(field))
    };
    let mut fields = vec![field("trial", PhysicalType::INT64, None)?];
    for name in TEXTS {
        let text = Some(LogicalType::String);
        fields.push(field(name, PhysicalType::BYTE_ARRAY, text)?);
    }
    for column in columns {
        fields.push(field(&column.name, PhysicalType::DOUBLE, None)?);
    }
    Ok(Arc::new(
        Type::group_type_builder("trials")
            .with_fields(fields)
            .build()?,
    ))
}

fn encode(columns: &[Column], rows: &[Row]) -> Result<Vec<u8>, ParquetError> {
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3)?))
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema(columns)?, Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    let short = || ParquetError::General("fewer columns than the schema has".into());
    let mut column = group.next_column()?.ok_or_else(short)?;
    let trials: Vec<i64> = rows.iter().map(|row| row.trial as i64).collect();
    column
        .typed::<Int64Type>()
        .write_batch(&trials, None, None)?;
    column.close()?;
    for k in 0..TEXTS.len() {
        let mut column = group.next_column()?.ok_or_else(short)?;
        let text = |row: &Row| [&row.verdict, &row.reason, &row.other][k].as_str().into();
        let texts: Vec<ByteArray> = rows.iter().map(text).collect();
        column
            .typed::<ByteArrayType>()
            .write_batch(&texts, None, None)?;
        column.close()?;
    }
    for k in 0..columns.len() {
        let mut column = group.next_column()?.ok_or_else(short)?;
        let values: Vec<f64> = rows.iter().map(|row| row.values[k]).collect();
        column
            .typed::<DoubleType>()
            .write_batch(&values, None, None)?;
        column.close()?;
    }
    group.close()?;
    writer.into_inner()
}

fn decode(columns: &[Column], bytes: Vec<u8>) -> Result<Vec<Row>, ParquetError> {
    let damaged = || ParquetError::General("other columns than a part has".into());
    let reader = SerializedFileReader::new(Bytes::from(bytes))?;
    let stored = reader.metadata().file_metadata().schema_descr();
    let names = std::iter::once("trial")
        .chain(TEXTS)
        .chain(columns.iter().map(|column| column.name.as_str()));
    if !stored
        .columns()
        .iter()
        .map(|column| column.name())
        .eq(names)
    {
        return Err(damaged());
    }
    let count = super::PART as usize + 1;
    let group = reader.get_row_group(0)?;
    let mut trials = Vec::new();
    let ColumnReader::Int64ColumnReader(mut column) = group.get_column_reader(0)? else {
        return Err(damaged());
    };
    column.read_records(count, None, None, &mut trials)?;
    let mut texts = vec![Vec::new(); TEXTS.len()];
    for (k, texts) in texts.iter_mut().enumerate() {
        let ColumnReader::ByteArrayColumnReader(mut column) = group.get_column_reader(1 + k)?
        else {
            return Err(damaged());
        };
        column.read_records(count, None, None, texts)?;
    }
    let mut values = vec![Vec::new(); columns.len()];
    for (k, values) in values.iter_mut().enumerate() {
        let place = 1 + TEXTS.len() + k;
        let ColumnReader::DoubleColumnReader(mut column) = group.get_column_reader(place)? else {
            return Err(damaged());
        };
        column.read_records(count, None, None, values)?;
    }
    let text = |k: usize, row: usize| -> Result<String, ParquetError> {
        let bytes: &ByteArray = texts[k].get(row).ok_or_else(damaged)?;
        Ok(bytes.as_utf8()?.to_owned())
    };
    (0..trials.len())
        .map(|row| {
            let numbers = values.iter().map(|column| column.get(row).copied());
            Ok(Row {
                trial: trials[row] as u64,
                verdict: text(0, row)?,
                reason: text(1, row)?,
                other: text(2, row)?,
                values: numbers.collect::<Option<_>>().ok_or_else(damaged)?,
            })
        })
        .collect()
}
