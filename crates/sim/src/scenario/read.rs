//! Reading: TOML text to [`Scenario`], with robot files put in, overrides applied, and every error
//! led back to file and line.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::{Table, Value};
use toml_edit::{Document, Item};

use super::{Diagnostic, Diagnostics, Platform, Scenario, check};

/// Largest file that is read, bytes: a scenario is written by hand.
const SIZE_MAX: u64 = 1 << 20;

/// Values given on the command line, as path and TOML text.
pub type Overrides = [(String, String)];

/// A scenario, checked, with what is needed to name its parts.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scenario; every robot has its platform.
    pub scenario: Scenario,
    /// The file it was read from.
    pub file: PathBuf,
    /// Folder that files named in it are relative to.
    pub folder: PathBuf,
    /// The scenario with robot files and overrides put in, as TOML: enough to run it again.
    pub resolved: String,
}

/// A text with its parsed form, for finding lines.
struct Source {
    file: PathBuf,
    text: String,
    document: Document<String>,
    /// Path at which its content stands in the scenario.
    prefix: String,
}

/// Reads, completes and checks a scenario file.
pub fn load(file: &Path, overrides: &Overrides) -> Result<Loaded, Diagnostics> {
    let text = read_text(file).map_err(one)?;
    load_text(&text, file, overrides)
}

/// The same from a text, as if it stood in `file`.
pub fn load_text(text: &str, file: &Path, overrides: &Overrides) -> Result<Loaded, Diagnostics> {
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    let (main, mut table) = parse(text, file, "").map_err(one)?;
    let mut sources = vec![main];
    let (files, overrides_of_values): (Vec<_>, Vec<_>) = overrides
        .iter()
        .cloned()
        .partition(|(path, _)| path.starts_with("robot.") && path.ends_with(".file"));
    // Another robot is put in before anything in it is changed.
    for (path, value) in &files {
        set(&mut table, path, value).map_err(one)?;
    }
    put_in_robots(&mut table, &folder, &mut sources).map_err(one)?;
    for (path, value) in &overrides_of_values {
        set(&mut table, path, value).map_err(one)?;
    }
    let scenario: Scenario = shape(&table, &sources, overrides).map_err(one)?;
    let problems = check(&scenario, &folder);
    if !problems.is_empty() {
        let located = problems
            .into_iter()
            .map(|(path, problem, hint)| locate(&sources, overrides, path, problem, hint));
        return Err(Diagnostics(located.collect()));
    }
    let resolved =
        toml::to_string_pretty(&scenario).expect("a scenario that was read can be written");
    Ok(Loaded {
        scenario,
        file: file.to_owned(),
        folder,
        resolved,
    })
}

/// Reads and checks a robot file alone.
pub fn load_robot(file: &Path) -> Result<Platform, Diagnostics> {
    let text = read_text(file).map_err(one)?;
    let (source, table) = parse(&text, file, "").map_err(one)?;
    let sources = [source];
    let platform: Platform = shape(&table, &sources, &[]).map_err(one)?;
    let problems = super::check::check_platform(&platform, "");
    if problems.is_empty() {
        return Ok(platform);
    }
    let located = problems
        .into_iter()
        .map(|(path, problem, hint)| locate(&sources, &[], path, problem, hint));
    Err(Diagnostics(located.collect()))
}

fn one(diagnostic: Diagnostic) -> Diagnostics {
    Diagnostics(vec![diagnostic])
}

fn plain(file: &Path, problem: String, hint: Option<&str>) -> Diagnostic {
    Diagnostic {
        file: file.to_owned(),
        at: None,
        path: String::new(),
        problem,
        hint: hint.map(str::to_owned),
    }
}

fn read_text(file: &Path) -> Result<String, Diagnostic> {
    let mut bytes = Vec::new();
    let opened = File::open(file).and_then(|open| {
        if open.metadata()?.is_dir() {
            return Err(std::io::Error::other("is a directory"));
        }
        open.take(SIZE_MAX + 1).read_to_end(&mut bytes)
    });
    if let Err(error) = opened {
        return Err(plain(
            file,
            format!("cannot be read: {error}"),
            Some("give the path of a TOML file; `appell new NAME` writes one to start from"),
        ));
    }
    if bytes.len() as u64 > SIZE_MAX {
        return Err(plain(
            file,
            format!("must be at most {SIZE_MAX} bytes, got more"),
            Some("long tables belong into a CSV file, named by a signal of kind \"table\""),
        ));
    }
    String::from_utf8(bytes).map_err(|error| {
        plain(
            file,
            format!(
                "must be UTF-8 text, got another byte at offset {}",
                error.utf8_error().valid_up_to()
            ),
            None,
        )
    })
}

fn parse(text: &str, file: &Path, prefix: &str) -> Result<(Source, Table), Diagnostic> {
    let syntax = |message: &str, span: Option<std::ops::Range<usize>>| Diagnostic {
        file: file.to_owned(),
        at: span.map(|span| line_column(text, span.start)),
        path: String::new(),
        problem: format!("not valid TOML: {}", message.trim()),
        hint: Some(
            "strings stand in quotes, tables in [brackets], lists of tables in [[double brackets]]"
                .into(),
        ),
    };
    let document =
        Document::parse(text.to_owned()).map_err(|error| syntax(error.message(), error.span()))?;
    let table: Table =
        toml::from_str(text).map_err(|error| syntax(error.message(), error.span()))?;
    let source = Source {
        file: file.to_owned(),
        text: text.to_owned(),
        document,
        prefix: prefix.to_owned(),
    };
    Ok((source, table))
}

/// Puts each robot's file in as its platform.
fn put_in_robots(
    table: &mut Table,
    folder: &Path,
    sources: &mut Vec<Source>,
) -> Result<(), Diagnostic> {
    let Some(Value::Array(robots)) = table.get_mut("robot") else {
        return Ok(());
    };
    for (index, robot) in robots.iter_mut().enumerate() {
        let Value::Table(robot) = robot else { continue };
        let name = robot
            .get("name")
            .and_then(Value::as_str)
            .map_or_else(|| index.to_string(), str::to_owned);
        let path = format!("robot.{name}.file");
        let Some(file) = robot.get("file").and_then(Value::as_str) else {
            continue;
        };
        let fail = |problem: String, hint: &str| {
            locate(sources, &[], path.clone(), problem, Some(hint.to_owned()))
        };
        if robot.contains_key("platform") {
            return Err(fail(
                "must not stand beside an inline platform".into(),
                "keep one of the two",
            ));
        }
        let full = folder.join(file);
        let text = match read_text(&full) {
            Ok(text) => text,
            Err(error) => {
                return Err(fail(
                    format!("\"{file}\" {}", error.problem),
                    "the path is relative to the scenario file",
                ));
            }
        };
        let (source, platform) = parse(&text, &full, &format!("robot.{name}.platform"))?;
        sources.push(source);
        robot.remove("file");
        robot.insert("platform".into(), Value::Table(platform));
    }
    Ok(())
}

/// Sets one value by path; entries of named lists are addressed by name.
fn set(table: &mut Table, path: &str, text: &str) -> Result<(), Diagnostic> {
    let refuse = |problem: String, hint: &str| Diagnostic {
        file: PathBuf::from("--set"),
        at: None,
        path: path.to_owned(),
        problem,
        hint: Some(hint.to_owned()),
    };
    let value = toml::from_str::<Table>(&format!("value = {text}"))
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_owned()));
    let segments: Vec<&str> = path.split('.').collect();
    let (last, way) = segments
        .split_last()
        .expect("split yields at least one part");
    let mut tables: Vec<&mut Table> = vec![table];
    let mut at = 0;
    while at < way.len() {
        let key = way[at];
        let mut next = Vec::new();
        for current in tables {
            let entry = current
                .entry(key)
                .or_insert_with(|| Value::Table(Table::new()));
            match entry {
                Value::Table(inner) => next.push(inner),
                Value::Array(items) => {
                    let wanted = way.get(at + 1).copied().unwrap_or(last);
                    let names: Vec<String> = items.iter().map(entry_name).collect();
                    for (index, item) in items.iter_mut().enumerate() {
                        let chosen =
                            wanted == "*" || names[index] == wanted || wanted.parse() == Ok(index);
                        if let (true, Value::Table(inner)) = (chosen, item) {
                            next.push(inner);
                        }
                    }
                    if next.is_empty() {
                        return Err(refuse(
                            format!("there is no {key} named \"{wanted}\""),
                            &format!("there are: {}; * means all", names.join(", ")),
                        ));
                    }
                }
                _ => {
                    return Err(refuse(
                        format!("{key} is a value, not a table"),
                        "leave out what follows it",
                    ));
                }
            }
        }
        // A list takes its entry's name as well.
        tables = next;
        at += if LISTS.contains(&key) { 2 } else { 1 };
    }
    for table in tables {
        table.insert((*last).to_owned(), value.clone());
    }
    Ok(())
}

/// Lists of the format whose entries are addressed by name.
const LISTS: [&str; 5] = ["robot", "beacon", "wheel", "sensor", "channel"];

/// By what an entry of a list is addressed.
fn entry_name(value: &Value) -> String {
    ["name", "kind", "to"]
        .iter()
        .find_map(|key| value.get(key).and_then(Value::as_str))
        .unwrap_or("?")
        .to_owned()
}

/// Gives the table the shape of T, or says where it has another.
fn shape<T: DeserializeOwned>(
    table: &Table,
    sources: &[Source],
    overrides: &Overrides,
) -> Result<T, Diagnostic> {
    let value = Value::Table(table.clone());
    serde_path_to_error::deserialize(value.clone()).map_err(|error| {
        let mut path = String::new();
        let mut current = Some(&value);
        for segment in error.path().iter() {
            use serde_path_to_error::Segment;
            let name = match segment {
                Segment::Map { key } => {
                    current = current.and_then(|value| value.get(key));
                    key.clone()
                }
                Segment::Seq { index } => {
                    current = current.and_then(|value| value.get(index));
                    match current.map(entry_name) {
                        Some(name) if name != "?" => name,
                        _ => index.to_string(),
                    }
                }
                Segment::Enum { variant } => variant.clone(),
                Segment::Unknown => continue,
            };
            if !path.is_empty() {
                path.push('.');
            }
            path.push_str(&name);
        }
        let message = error.inner().message().trim().to_owned();
        let (problem, hint, key) = explain(&message);
        if let Some(key) = key
            && !path.ends_with(&key)
        {
            if !path.is_empty() {
                path.push('.');
            }
            path.push_str(&key);
        }
        locate(sources, overrides, path, problem, hint)
    })
}

/// Turns serde's message into problem, hint and the key it speaks of.
fn explain(message: &str) -> (String, Option<String>, Option<String>) {
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    if let Some(unknown) = quoted.first()
        && message.starts_with("unknown field")
    {
        let known = &quoted[1..];
        let hint = nearest(unknown, known).map_or_else(
            || format!("known here: {}", known.join(", ")),
            |near| format!("did you mean {near}? known here: {}", known.join(", ")),
        );
        return (
            "unknown key".into(),
            Some(hint),
            Some((*unknown).to_owned()),
        );
    }
    if let Some(unknown) = quoted.first()
        && message.starts_with("unknown variant")
    {
        let known = &quoted[1..];
        let hint = nearest(unknown, known).map(|near| format!("did you mean \"{near}\"?"));
        return (
            format!("must be one of {}, got \"{unknown}\"", known.join(", ")),
            hint,
            None,
        );
    }
    if let Some(missing) = quoted.first()
        && message.starts_with("missing field")
    {
        return (
            "is missing".into(),
            Some(format!(
                "add `{missing} = …`; `appell schema` lists all keys with their units"
            )),
            Some((*missing).to_owned()),
        );
    }
    let problem = message
        .strip_prefix("invalid type: ")
        .or_else(|| message.strip_prefix("invalid value: "))
        .and_then(|rest| rest.split_once(", expected "))
        .map(|(got, expected)| {
            let expected = match expected {
                "f64" => "a number",
                "u32" | "u64" => "a whole number that is not negative",
                other => other,
            };
            format!("must be {expected}, got {got}")
        });
    (problem.unwrap_or_else(|| message.to_owned()), None, None)
}

fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    known
        .iter()
        .map(|candidate| (strsim::damerau_levenshtein(word, candidate), *candidate))
        .min()
        .filter(|(distance, candidate)| *distance <= 1 + candidate.len() / 3)
        .map(|(_, candidate)| candidate)
}

/// A diagnostic at the line where `path`, or the nearest table above it, stands.
fn locate(
    sources: &[Source],
    overrides: &Overrides,
    path: String,
    problem: String,
    hint: Option<String>,
) -> Diagnostic {
    let overridden = overrides
        .iter()
        .any(|(set, _)| !path.is_empty() && concerns(set, &path));
    if overridden {
        return Diagnostic {
            file: PathBuf::from("--set"),
            at: None,
            path,
            problem,
            hint,
        };
    }
    let source = sources
        .iter()
        .rev()
        .find(|source| {
            !source.prefix.is_empty() && path.starts_with(&format!("{}.", source.prefix))
        })
        .unwrap_or(&sources[0]);
    let inner = path
        .strip_prefix(&source.prefix)
        .map_or(path.as_str(), |rest| rest.trim_start_matches('.'));
    let span = find_span(source.document.as_item(), inner);
    Diagnostic {
        file: source.file.clone(),
        at: Some(line_column(&source.text, span.unwrap_or(0))),
        path,
        problem,
        hint,
    }
}

/// Whether a path set on the command line is the one at fault, or leads to it.
fn concerns(set: &str, path: &str) -> bool {
    let (set, path): (Vec<_>, Vec<_>) = (set.split('.').collect(), path.split('.').collect());
    set.len() >= path.len() && set.iter().zip(&path).all(|(a, b)| *a == "*" || a == b)
}

/// Byte offset of the deepest item of `path` that the document has.
fn find_span(root: &Item, path: &str) -> Option<usize> {
    let mut item = root;
    let mut found = None;
    let mut segments = path.split('.').peekable();
    while let Some(segment) = segments.next() {
        let next = match item {
            Item::ArrayOfTables(tables) => {
                let named = tables.iter().enumerate().find(|(index, table)| {
                    let name = ["name", "kind", "to"]
                        .iter()
                        .find_map(|key| table.get(key).and_then(Item::as_str));
                    name == Some(segment) || segment.parse() == Ok(*index)
                });
                let Some((_, table)) = named else { break };
                found = table.span().map(|span| span.start).or(found);
                // A table is no item: go on with its next key at once.
                let Some(key) = segments.next() else { break };
                let Some((name, value)) = table.get_key_value(key) else {
                    break;
                };
                found = name.span().map(|span| span.start).or(found);
                Some(value)
            }
            _ => {
                let entry = item
                    .as_table_like()
                    .and_then(|table| table.get_key_value(segment));
                if let Some((name, _)) = &entry {
                    found = name.span().map(|span| span.start).or(found);
                }
                entry.map(|(_, value)| value)
            }
        };
        let Some(next) = next else { break };
        found = next
            .span()
            .map(|span| span.start)
            .filter(|_| found.is_none())
            .or(found);
        item = next;
    }
    found
}

/// Line and column, from 1, of a byte offset.
fn line_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text.as_bytes()[..offset.min(text.len())];
    let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
    let column = 1 + before
        .iter()
        .rev()
        .take_while(|&&byte| byte != b'\n')
        .count();
    (line, column)
}
