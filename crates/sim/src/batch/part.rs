//! Parts of a batch on disk: Parquet files of [`super::PART`] rows, each written whole or not at all.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use bytes::Bytes;
use parquet::basic::LogicalType;
use parquet::basic::{Compression, Repetition, Type as PhysicalType, ZstdLevel};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};
use sha2::{Digest, Sha256};

use super::{BatchError, Column, Manifest, Row};
use crate::scenario::Precision;

/// Columns of text after the trial's number.
const TEXTS: [&str; 4] = ["variant", "verdict", "reason", "other"];

/// A hash of SHA-256.
pub(super) type Hash = [u8; 32];

/// Hash of a part's rows: what they hold, not how the file stores it.
pub(super) fn leaf(rows: &[Row]) -> Hash {
    let mut digest = Sha256::new();
    for row in rows {
        digest.update(row.trial.to_le_bytes());
        for text in [&row.variant, &row.verdict, &row.reason, &row.other] {
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
    hex(&root)
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The folder of a batch's parts.
///
/// A part is a file whose name holds the hash of its rows: a file that does not fit its name is
/// damaged, and two that fit theirs and differ are two results of one computation.
pub struct Store {
    folder: PathBuf,
    manifest: Manifest,
    /// Names of the files that claim to be a part.
    files: Mutex<BTreeMap<u64, BTreeSet<String>>>,
}

fn unwritable(path: &Path, problem: impl std::fmt::Display) -> BatchError {
    BatchError::Folder {
        path: path.to_owned(),
        problem: format!("cannot be written: {problem}"),
        hint: "choose another folder with --out, or make room; the batch goes on with what is missing",
    }
}

impl Store {
    const MANIFEST: &str = "batch.manifest";

    /// Opens the folder of a batch, or makes it.
    ///
    /// # Errors
    /// It holds another batch, or cannot be written.
    pub fn open(folder: &Path, manifest: &Manifest) -> Result<Store, BatchError> {
        let path = folder.join(Self::MANIFEST);
        let there = path.exists().then(|| Self::existing(folder)).transpose()?;
        if let Some(there) = there {
            there.agrees(manifest.precision)?;
            if there.manifest.hash != manifest.hash {
                return Err(BatchError::Folder {
                    path: folder.to_owned(),
                    problem:
                        "holds another batch: another scenario, other settings or another version"
                            .into(),
                    hint: "choose another folder with --out, or remove this one",
                });
            }
        }
        let trials = folder.join("trials");
        fs::create_dir_all(&trials).map_err(|error| unwritable(&trials, error))?;
        let text = serde_json::to_string_pretty(manifest).expect("a manifest is plain data");
        put(folder, &path, text.as_bytes())?;
        Ok(Self::listed(folder, manifest.clone()))
    }

    /// Whether its rows are of a precision: rows of two have other bits.
    ///
    /// # Errors
    /// They are of the other.
    pub(super) fn agrees(&self, precision: Precision) -> Result<(), BatchError> {
        if self.manifest.precision == precision {
            return Ok(());
        }
        Err(BatchError::Folder {
            path: self.folder.clone(),
            problem: format!(
                "must hold rows of precision {}, has those of {}",
                precision.name(),
                self.manifest.precision.name()
            ),
            hint: "ask for the same --precision, or choose another folder with --out",
        })
    }

    /// Opens the folder of a batch that was begun.
    ///
    /// # Errors
    /// It is none.
    pub fn existing(folder: &Path) -> Result<Store, BatchError> {
        let path = folder.join(Self::MANIFEST);
        let wrong = |problem: String| BatchError::Folder {
            path: path.clone(),
            problem,
            hint: "name a folder that `appell batch` has written",
        };
        let text =
            fs::read_to_string(&path).map_err(|error| wrong(format!("cannot be read: {error}")))?;
        let manifest = serde_json::from_str(&text)
            .map_err(|error| wrong(format!("must be the manifest of a batch: {error}")))?;
        Ok(Self::listed(folder, manifest))
    }

    fn listed(folder: &Path, manifest: Manifest) -> Store {
        let mut files: BTreeMap<u64, BTreeSet<String>> = BTreeMap::new();
        let entries = fs::read_dir(folder.join("trials"));
        for entry in entries.into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let part = name
                .strip_prefix("part-")
                .and_then(|rest| rest.split_once('-'));
            if let Some((number, rest)) = part
                && let Ok(number) = number.parse()
                && rest.ends_with(".parquet")
            {
                files.entry(number).or_default().insert(name);
            }
        }
        Store {
            folder: folder.to_owned(),
            manifest,
            files: Mutex::new(files),
        }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What the rows belong to.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Files that claim to be a part.
    fn files(&self, part: u64) -> BTreeSet<String> {
        let files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files.get(&part).cloned().unwrap_or_default()
    }

    fn name(part: u64, rows: &[Row]) -> String {
        let hash = hex(&leaf(rows)[..8]);
        format!("part-{part:07}-{hash}.parquet")
    }

    /// Writes a part, under a name that it takes when it is whole.
    ///
    /// # Errors
    /// Another result of the same part is there, or writing failed.
    pub fn write(&self, part: u64, rows: &[Row]) -> Result<(), BatchError> {
        match self.read(part)? {
            Some(there) if leaf(&there) == leaf(rows) => return Ok(()),
            Some(_) => return Err(self.differs(part)),
            None => {}
        }
        let name = Self::name(part, rows);
        let trials = self.folder.join("trials");
        for damaged in self.files(part) {
            let damaged = trials.join(damaged);
            fs::remove_file(&damaged).map_err(|error| unwritable(&damaged, error))?;
        }
        let path = trials.join(&name);
        let bytes = encode(&self.manifest, rows).map_err(|e| unwritable(&path, e))?;
        put(&self.folder, &path, &bytes)?;
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files.insert(part, BTreeSet::from([name]));
        Ok(())
    }

    fn differs(&self, part: u64) -> BatchError {
        BatchError::Folder {
            path: self.folder.clone(),
            problem: format!(
                "holds another result of part {part}: two runs of the same trials differ"
            ),
            hint: "one of both machines computes wrongly; run the part again on a third",
        }
    }

    /// The rows of a part, if it is there whole.
    ///
    /// # Errors
    /// It is there twice, with different rows.
    pub fn read(&self, part: u64) -> Result<Option<Vec<Row>>, BatchError> {
        let mut found: Option<Vec<Row>> = None;
        for name in self.files(part) {
            let Some(rows) = self.whole(part, &name) else {
                continue;
            };
            if found.is_some() {
                return Err(self.differs(part));
            }
            found = Some(rows);
        }
        Ok(found)
    }

    fn whole(&self, part: u64, name: &str) -> Option<Vec<Row>> {
        let bytes = fs::read(self.folder.join("trials").join(name)).ok()?;
        // The crate is not made for damaged files; a part that cannot be read is run again.
        let decoded = AssertUnwindSafe(|| decode(&self.manifest.columns, bytes));
        let rows = catch_unwind(decoded).ok()?.ok()?;
        let place = |row: u64| {
            let (variant, trial) = self.manifest.place(row);
            (self.manifest.variants[variant].as_str(), trial)
        };
        let own = rows.iter().map(|row| (row.variant.as_str(), row.trial));
        let fits =
            own.eq(self.manifest.rows_of(part).map(place)) && name == Self::name(part, &rows);
        fits.then_some(rows)
    }
}

/// Writes a file as a draft in `folder`, and then lets it take its place.
fn put(folder: &Path, path: &Path, bytes: &[u8]) -> Result<(), BatchError> {
    use std::io::Write;
    // Two processes may write the same part at once.
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let draft = folder.join(format!(".{name}.{}", std::process::id()));
    let save = || -> std::io::Result<()> {
        let mut file = fs::File::create(&draft)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&draft, path)
    };
    save().map_err(|error| unwritable(path, error))
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

fn encode(manifest: &Manifest, rows: &[Row]) -> Result<Vec<u8>, ParquetError> {
    let columns = &manifest.columns;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3)?))
        .set_key_value_metadata(Some(vec![KeyValue::new(
            "precision".into(),
            manifest.precision.name().to_owned(),
        )]))
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
        let text = |row: &Row| {
            [&row.variant, &row.verdict, &row.reason, &row.other][k]
                .as_str()
                .into()
        };
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
                variant: text(0, row)?,
                verdict: text(1, row)?,
                reason: text(2, row)?,
                other: text(3, row)?,
                values: numbers.collect::<Option<_>>().ok_or_else(damaged)?,
            })
        })
        .collect()
}
