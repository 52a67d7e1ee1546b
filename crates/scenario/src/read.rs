//! Reading: TOML text to [`Scenario`], with robot files put in, overrides applied, and every error
//! led back to file and line.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::{DeserializeOwned, Unexpected};
use toml::{Table, Value};
use toml_edit::{Document, Item, TableLike};

use crate::{Diagnostic, Diagnostics, Platform, Scenario};

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
    /// Whether libraries that it names may be loaded into this process; for whoever runs it to say.
    pub trust_native: bool,
}

/// A text with its parsed form, for finding lines.
struct Source {
    file: PathBuf,
    text: String,
    document: Document<String>,
    /// Path at which its content stands in the scenario.
    prefix: String,
}

/// Path, problem and hint of each rule that is broken.
pub type Problems = Vec<(String, String, Option<String>)>;

/// A scenario as it was written, with robot files and overrides put in: of the right shape, and not
/// yet checked.
pub struct Draft {
    /// The scenario.
    pub scenario: Scenario,
    /// Folder that files named in it are relative to.
    pub folder: PathBuf,
    file: PathBuf,
    sources: Vec<Source>,
    overrides: Vec<(String, String)>,
}

impl Draft {
    /// Reads and completes a scenario file.
    pub fn read(file: &Path, overrides: &Overrides) -> Result<Draft, Diagnostics> {
        let text = read_text(file).map_err(one)?;
        Draft::read_text(&text, file, overrides)
    }

    /// The same from a text, as if it stood in `file`.
    pub fn read_text(text: &str, file: &Path, overrides: &Overrides) -> Result<Draft, Diagnostics> {
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        let (sources, table) = put_together(text, file, &folder, overrides)?;
        Ok(Draft {
            scenario: shape(&table, &sources, overrides).map_err(one)?,
            folder,
            file: file.to_owned(),
            sources,
            overrides: overrides.to_vec(),
        })
    }

    /// The scenario, if no rule is broken; else every problem with its place.
    pub fn judged(self, problems: Problems) -> Result<Loaded, Diagnostics> {
        located(&self.sources, &self.overrides, problems)?;
        Ok(Loaded {
            resolved: self.scenario.to_toml(),
            trust_native: false,
            scenario: self.scenario,
            file: self.file,
            folder: self.folder,
        })
    }
}

/// A robot file as it was written, not yet checked.
pub struct RobotDraft {
    /// The robot.
    pub platform: Platform,
    source: Source,
}

impl RobotDraft {
    /// Reads a robot file alone.
    pub fn read(file: &Path) -> Result<RobotDraft, Diagnostics> {
        let text = read_text(file).map_err(one)?;
        let (source, table) = parse(&text, file, "").map_err(one)?;
        let sources = [source];
        let platform = shape(&table, &sources, &[]).map_err(one)?;
        let [source] = sources;
        Ok(RobotDraft { platform, source })
    }

    /// The robot, if no rule is broken; else every problem with its place.
    pub fn judged(self, problems: Problems) -> Result<Platform, Diagnostics> {
        located(&[self.source], &[], problems)?;
        Ok(self.platform)
    }
}

/// Refuses where there are problems, each led back to its line.
fn located(
    sources: &[Source],
    overrides: &Overrides,
    problems: Problems,
) -> Result<(), Diagnostics> {
    if problems.is_empty() {
        return Ok(());
    }
    let located = problems
        .into_iter()
        .map(|(path, problem, hint)| locate(sources, overrides, path, problem, hint));
    Err(Diagnostics(located.collect()))
}

/// The tables of a scenario and of its robot files, under overrides.
fn put_together(
    text: &str,
    file: &Path,
    folder: &Path,
    overrides: &Overrides,
) -> Result<(Vec<Source>, Table), Diagnostics> {
    let (main, mut table) = parse(text, file, "").map_err(one)?;
    if table.contains_key("wheel") && !is_scenario(&table) {
        return Err(one(plain(
            file,
            "must be a scenario, got a robot file".into(),
            Some("name it in the [[robot]] table of a scenario: file = \"…\""),
        )));
    }
    let mut sources = vec![main];
    let (files, overrides_of_values): (Vec<_>, Vec<_>) = overrides
        .iter()
        .cloned()
        .partition(|(path, _)| path.starts_with("robot.") && path.ends_with(".file"));
    // Another robot is put in before anything in it is changed.
    for (path, value) in &files {
        set(&mut table, path, value).map_err(one)?;
    }
    put_in_robots(&mut table, folder, &mut sources, overrides).map_err(one)?;
    for (path, value) in &overrides_of_values {
        set(&mut table, path, value).map_err(one)?;
    }
    Ok((sources, table))
}

/// A scenario whose text is read once and whose numbers are set many times.
#[derive(Clone, Debug)]
pub struct Template {
    table: Table,
    file: PathBuf,
    folder: PathBuf,
}

impl Template {
    /// Reads a scenario file with its robot files, under overrides; it must be right by itself.
    pub fn read(file: &Path, overrides: &Overrides) -> Result<Template, Diagnostics> {
        let text = read_text(file).map_err(one)?;
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        let (_, mut table) = put_together(&text, file, &folder, overrides)?;
        // A trial asks for no other trials.
        table.remove("batch");
        Ok(Template {
            table,
            file: file.to_owned(),
            folder,
        })
    }

    /// A template of a scenario that was read.
    pub fn of(loaded: &Loaded) -> Template {
        let table = Table::try_from(&loaded.scenario).expect("a scenario is plain data");
        Template {
            table,
            file: loaded.file.clone(),
            folder: loaded.folder.clone(),
        }
    }

    /// All numbers, by the paths at which [`Template::with`] sets them.
    pub fn numbers(&self) -> Vec<(String, f64)> {
        let mut found = Vec::new();
        for (key, value) in &self.table {
            collect_numbers(value, key.clone(), &mut found);
        }
        found
    }

    /// The scenario with numbers at paths, not checked and without its text.
    ///
    /// # Errors
    /// There is no such path, or it takes no such number.
    pub fn with(&self, numbers: &[(String, f64)]) -> Result<Loaded, Diagnostic> {
        let mut table = self.table.clone();
        for (path, number) in numbers {
            let text = number_text(*number);
            let value = match text.parse::<i64>() {
                Ok(whole) => Value::Integer(whole),
                Err(_) => Value::Float(*number),
            };
            set_value(&mut table, path, &value)?;
        }
        let scenario = Scenario::deserialize(Value::Table(table)).map_err(|error| Diagnostic {
            path: numbers
                .first()
                .map_or_else(String::new, |(path, _)| path.clone()),
            ..plain(&self.file, error.message().trim().to_owned(), None)
        })?;
        Ok(Loaded {
            scenario,
            file: self.file.clone(),
            folder: self.folder.clone(),
            resolved: String::new(),
            trust_native: false,
        })
    }
}

/// Numbers at and below a path.
fn collect_numbers(value: &Value, path: String, found: &mut Vec<(String, f64)>) {
    match value {
        Value::Integer(whole) => found.push((path, *whole as f64)),
        Value::Float(number) => found.push((path, *number)),
        Value::Table(table) => {
            for (key, value) in table {
                collect_numbers(value, format!("{path}.{key}"), found);
            }
        }
        Value::Array(items) => {
            let names: Vec<String> = items.iter().map(entry_name).collect();
            for (k, item) in items.iter().enumerate() {
                // What has no name of its own is addressed by its place.
                let alike = names.iter().filter(|name| **name == names[k]).count();
                let name = match alike {
                    1 if item.is_table() && names[k] != "?" => names[k].clone(),
                    _ => k.to_string(),
                };
                collect_numbers(item, format!("{path}.{name}"), found);
            }
        }
        Value::String(_) | Value::Boolean(_) | Value::Datetime(_) => {}
    }
}

/// A number as an override: keys of whole numbers take no fraction; the others take a whole number,
/// too.
pub fn number_text(number: f64) -> String {
    let is_whole = number == number.round() && number.abs() < 1e15;
    match is_whole {
        true => format!("{number:.0}"),
        false => format!("{number:?}"),
    }
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

/// Whether a table has what only scenarios have.
fn is_scenario(table: &Table) -> bool {
    table.contains_key("robot") || table.contains_key("arena")
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
        let offset = error.utf8_error().valid_up_to();
        let byte = error.as_bytes()[offset];
        Diagnostic {
            at: Some(line_column(error.as_bytes(), offset)),
            ..plain(
                file,
                format!("must be UTF-8 text, got the byte {byte:#04x}"),
                Some("save the file with the encoding UTF-8"),
            )
        }
    })
}

fn parse(text: &str, file: &Path, prefix: &str) -> Result<(Source, Table), Diagnostic> {
    let syntax = |message: &str, span: Option<std::ops::Range<usize>>| {
        let (message, hint) = explain_syntax(message.trim());
        let word = span.clone().and_then(|span| text.get(span)).unwrap_or("");
        let got = if (1..=40).contains(&word.trim().len()) && !word.contains('\n') {
            format!(": {}", word.trim())
        } else {
            String::new()
        };
        Diagnostic {
            at: span.map(|span| line_column(text.as_bytes(), span.start)),
            ..plain(file, format!("not valid TOML: {message}{got}"), Some(hint))
        }
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

/// What a TOML parser says, with a remedy.
fn explain_syntax(message: &str) -> (&str, &'static str) {
    let hint = if message.contains("overflow") {
        "numbers lie within 1.8e308, whole numbers within 9.2e18"
    } else if message.contains("duplicate key") {
        "each key stands once in its table"
    } else if message.contains("recurse") {
        "no key of these files is nested that deeply"
    } else {
        "strings stand in quotes, tables in [brackets], lists of tables in [[double brackets]]"
    };
    (message, hint)
}

/// Puts each robot's file in as its platform.
fn put_in_robots(
    table: &mut Table,
    folder: &Path,
    sources: &mut Vec<Source>,
    overrides: &Overrides,
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
            locate(
                sources,
                overrides,
                path.clone(),
                problem,
                Some(hint.to_owned()),
            )
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
        if is_scenario(&platform) {
            return Err(fail(
                format!("must be a robot file, got a scenario: \"{file}\""),
                "robot files have a [body] and [[wheel]] tables",
            ));
        }
        sources.push(source);
        robot.remove("file");
        robot.insert("platform".into(), Value::Table(platform));
    }
    Ok(())
}

/// Sets one value, as TOML text, by path.
fn set(table: &mut Table, path: &str, text: &str) -> Result<(), Diagnostic> {
    let value = toml::from_str::<Table>(&format!("value = {text}"))
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_owned()));
    set_value(table, path, &value)
}

/// Sets one value by path; entries of named lists are addressed by name.
fn set_value(table: &mut Table, path: &str, value: &Value) -> Result<(), Diagnostic> {
    let refuse = |problem: String, hint: &str| Diagnostic {
        file: PathBuf::from("--set"),
        at: None,
        path: path.to_owned(),
        problem,
        hint: Some(hint.to_owned()),
    };
    let segments: Vec<&str> = path.split('.').collect();
    if segments.contains(&"") {
        return Err(refuse(
            format!("must be names joined by dots, got \"{path}\""),
            "for instance robot.tri.controller.speed=1.2",
        ));
    }
    let (last, way) = segments
        .split_last()
        .expect("split yields at least one part");
    let mut tables: Vec<&mut Table> = vec![table];
    let mut at = 0;
    let mut is_placed = false;
    while at < way.len() {
        let key = way[at];
        let mut next = Vec::new();
        let mut taken = 1;
        for current in tables {
            let entry = current
                .entry(key)
                .or_insert_with(|| Value::Table(Table::new()));
            match entry {
                Value::Table(inner) => next.push(inner),
                Value::Array(items) => {
                    let wanted = &segments[at + 1..];
                    let names: Vec<String> = items.iter().map(entry_name).collect();
                    if !items.iter().any(Value::is_table) {
                        let place = wanted[0].parse().ok().filter(|_| wanted.len() == 1);
                        let count = items.len();
                        let Some(item) = place.and_then(|k: usize| items.get_mut(k)) else {
                            return Err(refuse(
                                format!("{key} is a list of {count} values, not of tables"),
                                "give the whole list: [1.0, 2.0], or one by its place, from 0",
                            ));
                        };
                        *item = value.clone();
                        is_placed = true;
                        continue;
                    }
                    for (index, item) in items.iter_mut().enumerate() {
                        let chosen = match wanted[0] {
                            "*" => Some(1),
                            _ => naming(&names[index], index, wanted),
                        };
                        if let (Some(count), Value::Table(inner)) = (chosen, item) {
                            taken = 1 + count;
                            next.push(inner);
                        }
                    }
                    if next.is_empty() {
                        return Err(refuse(
                            format!("there is no {key} named \"{}\"", wanted[0]),
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
        tables = next;
        at += taken;
    }
    if !is_placed {
        for table in tables {
            table.insert((*last).to_owned(), value.clone());
        }
    }
    Ok(())
}

/// By what an entry of a list is addressed.
fn entry_name(value: &Value) -> String {
    ["name", "kind", "to", "wheel"]
        .iter()
        .find_map(|key| value.get(key).and_then(Value::as_str))
        .unwrap_or("?")
        .to_owned()
}

/// How many leading segments of a path address the entry; a name such as `wheel.left` has two.
fn naming(name: &str, index: usize, segments: &[&str]) -> Option<usize> {
    let parts: Vec<&str> = name.split('.').collect();
    if segments.starts_with(&parts) {
        return Some(parts.len());
    }
    let numbered = segments.first().is_some_and(|s| s.parse() == Ok(index));
    numbered.then_some(1)
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
        // Within a table of several kinds serde names the outermost only.
        let inner = current.and_then(|value| within(value));
        if let Some((_, place, _)) = &inner {
            path.push_str(place);
        }
        let current = inner.as_ref().map_or(current, |(value, ..)| Some(*value));
        // Of a word that is none, toml says "unit variant" whatever it is.
        let got = current.map_or_else(String::new, described);
        let message = inner.as_ref().map_or_else(
            || error.inner().message().trim(),
            |(.., message)| message.trim(),
        );
        let message = message.replace("unit variant", &got);
        let (problem, hint, key) = explain(&message);
        // A key that is unknown deep inside is found there.
        let found = current.and_then(|value| culprit(value, &message));
        let key = found.or(key);
        if let Some(key) = key
            && path.rsplit('.').next() != Some(&key)
        {
            if !path.is_empty() {
                path.push('.');
            }
            path.push_str(&key);
        }
        locate(sources, overrides, path, problem, hint)
    })
}

/// Where a table that is a task has a wrong route: the wrong value, its place below the task, and
/// what is wrong with it.
fn within(task: &Value) -> Option<(&Value, String, String)> {
    fn wrong<T: DeserializeOwned>(value: &Value) -> Option<String> {
        let read: Result<T, toml::de::Error> = value.clone().try_into();
        read.err().map(|error| error.message().to_owned())
    }
    let route = task.get("path").filter(|route| route.is_table())?;
    let pieces = route.get("piece").and_then(Value::as_array);
    for (k, piece) in pieces.into_iter().flatten().enumerate() {
        if let Some(message) = wrong::<crate::Piece>(piece) {
            return Some((piece, format!(".path.piece.{k}"), message));
        }
    }
    wrong::<crate::Route>(route).map(|message| (route, ".path".to_owned(), message))
}

/// The path, within a table, of the value a message speaks of: below a `kind`, serde names the
/// table only. None if the value itself is meant, or several could be.
fn culprit(value: &Value, message: &str) -> Option<String> {
    let quoted = message.split('`').nth(1);
    let only = |fits: &dyn Fn(&str, &Value) -> bool| {
        let mut fitting = Vec::new();
        descend(value, "", &mut |path, inner| {
            if fits(path, inner) {
                fitting.push(path.to_owned());
            }
        });
        fitting.pop().filter(|_| fitting.is_empty())
    };
    if message.starts_with("unknown variant") {
        return only(&|_, inner| inner.as_str() == quoted);
    }
    if message.starts_with("unknown field") {
        return only(&|path, _| path.rsplit('.').next() == quoted);
    }
    let got = ["invalid type: ", "invalid value: "]
        .iter()
        .find_map(|start| message.strip_prefix(start))
        .and_then(|rest| rest.split_once(", expected "))
        .map(|(got, _)| got)?;
    if described(value) == got {
        return None;
    }
    only(&|_, inner| described(inner) == got)
}

/// Calls `visit` with every value below `value` and its path.
fn descend(value: &Value, path: &str, visit: &mut impl FnMut(&str, &Value)) {
    let inner: Vec<(String, &Value)> = match value {
        Value::Table(table) => table.iter().map(|(key, v)| (key.clone(), v)).collect(),
        Value::Array(items) => {
            let names = items.iter().enumerate();
            let names = names.map(|(index, item)| match entry_name(item).as_str() {
                "?" => index.to_string(),
                name => name.to_owned(),
            });
            names.zip(items).collect()
        }
        Value::String(_)
        | Value::Integer(_)
        | Value::Float(_)
        | Value::Boolean(_)
        | Value::Datetime(_) => return,
    };
    for (key, value) in inner {
        let path = if path.is_empty() {
            key
        } else {
            format!("{path}.{key}")
        };
        visit(&path, value);
        descend(value, &path, visit);
    }
}

/// A value in the words of serde's messages.
fn described(value: &Value) -> String {
    let unexpected = match value {
        Value::String(text) => Unexpected::Str(text),
        Value::Integer(number) => Unexpected::Signed(*number),
        Value::Float(number) => Unexpected::Float(*number),
        Value::Boolean(truth) => Unexpected::Bool(*truth),
        Value::Array(_) => Unexpected::Seq,
        Value::Table(_) | Value::Datetime(_) => Unexpected::Map,
    };
    unexpected.to_string()
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
    let problem = ["invalid type: ", "invalid value: ", "invalid "]
        .iter()
        .find_map(|start| message.strip_prefix(start))
        .and_then(|rest| rest.split_once(", expected "))
        .map(|(got, expected)| {
            let (expected, got) = (expectation(expected), finding(got));
            format!("must be {expected}, got {got}")
        });
    (problem.unwrap_or_else(|| message.to_owned()), None, None)
}

/// What serde expects, in the words of the file.
fn expectation(words: &str) -> String {
    match words {
        "f64" => "a number".into(),
        "u32" | "u64" => "a whole number that is not negative".into(),
        "a sequence" => "a list".into(),
        "a map" => "a table".into(),
        "string only" | "string or map" | "variant identifier" | "variant of enum" => {
            "a word in quotes".into()
        }
        _ if words.contains("struct ") || words.contains("enum ") => "a table".into(),
        other => other.replace("an array of", "a list of"),
    }
}

/// What serde got, in the words of the file.
fn finding(words: &str) -> String {
    match words {
        "sequence" => "a list".into(),
        "map" => "a table".into(),
        text if text.starts_with("string ") => text.into(),
        other => other.replace('`', ""),
    }
}

fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    known
        .iter()
        .map(|candidate| (strsim::damerau_levenshtein(word, candidate), *candidate))
        .min()
        .filter(|(distance, candidate)| *distance <= 1 + candidate.len() / 3)
        .map(|(_, candidate)| candidate)
}

/// A diagnostic at the line where `path`, or the nearest table above it, stands; without a line if
/// the file has none of it.
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
        at: span.map(|span| line_column(source.text.as_bytes(), span)),
        path,
        problem,
        hint,
    }
}

/// Whether a path set on the command line is the one at fault, or one leads to the other.
fn concerns(set: &str, path: &str) -> bool {
    let (set, path): (Vec<_>, Vec<_>) = (set.split('.').collect(), path.split('.').collect());
    set.iter().zip(&path).all(|(a, b)| *a == "*" || a == b)
}

/// Byte offset of the deepest item of `path` that the document has.
fn find_span(root: &Item, path: &str) -> Option<usize> {
    let segments: Vec<&str> = path.split('.').collect();
    let mut rest = segments.as_slice();
    let mut table = root.as_table_like()?;
    let mut found = None;
    while let Some((key, behind)) = rest.split_first() {
        let Some((name, item)) = table.get_key_value(key) else {
            break;
        };
        let start = name.span().or_else(|| item.span());
        found = start.map(|span| span.start).or(found);
        rest = behind;
        let inner = match entries(item) {
            Some(entries) => entries.into_iter().enumerate().find_map(|(index, entry)| {
                let name = ["name", "kind", "to", "wheel"]
                    .iter()
                    .find_map(|key| entry.0.get(key).and_then(Item::as_str));
                let count = naming(name.unwrap_or("?"), index, rest)?;
                found = entry.1.or(found);
                rest = &rest[count..];
                Some(entry.0)
            }),
            None => item.as_table_like(),
        };
        let Some(inner) = inner else { break };
        table = inner;
    }
    found
}

/// The tables of a list with their byte offsets, in either notation; None if it is no list.
fn entries(item: &Item) -> Option<Vec<(&dyn TableLike, Option<usize>)>> {
    if let Some(tables) = item.as_array_of_tables() {
        let start = |table: &toml_edit::Table| table.span().map(|span| span.start);
        let entries = tables
            .iter()
            .map(|table| (table as &dyn TableLike, start(table)));
        return Some(entries.collect());
    }
    let start = |table: &toml_edit::InlineTable| table.span().map(|span| span.start);
    let entries = item
        .as_array()?
        .iter()
        .filter_map(toml_edit::Value::as_inline_table)
        .map(|table| (table as &dyn TableLike, start(table)));
    Some(entries.collect())
}

/// Line and column, from 1, of a byte offset.
fn line_column(text: &[u8], offset: usize) -> (usize, usize) {
    let before = &text[..offset.min(text.len())];
    let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
    // Bytes 10xxxxxx go on with a character that has begun.
    let column = 1 + before
        .iter()
        .rev()
        .take_while(|&&byte| byte != b'\n')
        .filter(|&&byte| byte & 0xc0 != 0x80)
        .count();
    (line, column)
}
