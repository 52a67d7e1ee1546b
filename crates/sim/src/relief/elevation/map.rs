//! Maps of the ROS map server: a YAML file that names a picture of occupancy.
//!
//! Dark is occupied, unless `negate` is 1. In the modes `trinary` (the default) and `scale`, cells
//! with an occupancy above `occupied_thresh` get the height `high`, and those below `free_thresh`
//! get `low`. In between a cell is unknown in `trinary` and gets `low`, as if it were free; in
//! `scale` its height is in proportion. In `raw` a pixel is a number, whatever `negate` says, and
//! its height in proportion to it from 0 (`low`) to the largest (`high`). Cells that are not opaque
//! are unknown in `scale`, and refused else. The place of a cell's height is its center, half a cell
//! from the corner that `origin` names. Other keys are passed over, as the map server does.

use std::collections::BTreeMap;
use std::path::Path;

use saphyr_parser::{Event, Parser};

use super::{
    Elevation, ElevationError, Reading, SPACING, contents, file_fault, heights, picture,
    refuse_said,
};

/// Most bytes of the YAML file.
const TEXT_MAX: usize = 1 << 16;

/// How occupancy becomes height.
#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Trinary,
    Scale,
    Raw,
}

/// A value with its line, from 1.
struct Entry {
    line: usize,
    value: Value,
}

enum Value {
    One(String),
    Many(Vec<String>),
    /// Nested: nothing that a map server reads.
    Other,
}

/// The entries of a map's file.
struct Fields<'a> {
    path: &'a Path,
    entries: BTreeMap<String, Entry>,
}

impl Fields<'_> {
    fn fail(&self, key: &str, rule: &str) -> ElevationError {
        let problem = match self.entries.get(key) {
            None => format!("must have {key}: {rule}"),
            Some(Entry { line, value }) => {
                let got = match value {
                    Value::One(text) => format!("\"{text}\""),
                    Value::Many(items) => format!("[{}]", items.join(", ")),
                    Value::Other => "something nested".into(),
                };
                format!("line {line}: {key} must be {rule}, got {got}")
            }
        };
        let hint = "a map has image, resolution, origin, negate, occupied_thresh and free_thresh";
        file_fault(self.path, problem, hint)
    }

    fn text(&self, key: &str) -> Option<&str> {
        match self.entries.get(key) {
            Some(Entry {
                value: Value::One(text),
                ..
            }) => Some(text),
            _ => None,
        }
    }

    /// A finite number in a range.
    fn number(&self, key: &str, range: [f64; 2], rule: &str) -> Result<f64, ElevationError> {
        self.text(key)
            .and_then(number)
            .filter(|value| (range[0]..=range[1]).contains(value))
            .ok_or_else(|| self.fail(key, rule))
    }
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

/// The ground of a map.
pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    reading: &Reading,
) -> Result<Elevation, ElevationError> {
    let fields = Fields {
        path,
        entries: entries(bytes, path)?,
    };
    let image = fields.text("image").filter(|image| !image.is_empty());
    let image = image.ok_or_else(|| fields.fail("image", "the path of a picture"))?;
    let [least, most] = SPACING;
    let rule = format!("a number from {least} to {most}, m");
    let resolution = fields.number("resolution", SPACING, &rule)?;
    let origin = corner(&fields)?;
    let is_negated = match fields.text("negate") {
        Some("0" | "false" | "False" | "no") => false,
        Some("1" | "true" | "True" | "yes") => true,
        _ => return Err(fields.fail("negate", "0 or 1")),
    };
    let fraction = |key| fields.number(key, [0.0, 1.0], "a number from 0 to 1");
    let [free, occupied] = [fraction("free_thresh")?, fraction("occupied_thresh")?];
    if free >= occupied {
        return Err(fields.fail("free_thresh", "below occupied_thresh"));
    }
    let mode = match (fields.entries.contains_key("mode"), fields.text("mode")) {
        (false, _) | (_, Some("trinary")) => Mode::Trinary,
        (_, Some("scale")) => Mode::Scale,
        (_, Some("raw")) => Mode::Raw,
        _ => return Err(fields.fail("mode", "trinary, scale or raw")),
    };
    refuse_said(
        [
            ("size", reading.size.is_some()),
            ("resolution", reading.resolution.is_some()),
        ],
        "must not be given: the map says its resolution itself",
    )?;
    let [low, high] = heights(reading)?;

    let file = path.parent().unwrap_or(Path::new("")).join(image);
    let hint = "the path is relative to the map's YAML file";
    let Some(picture) = picture::decode(&contents(&file, hint)?, &file)? else {
        let hint = "convert the map's picture, and change image in its YAML file";
        return Err(file_fault(&file, "must be a PGM or PNG", hint));
    };
    if mode != Mode::Scale {
        picture.refuse_clear(&file)?;
    }
    let height = |shade: f64| {
        let occupancy = if is_negated { shade } else { 1.0 - shade };
        // A cell that is not opaque is NaN, and neither above a threshold nor below one.
        let fraction = match mode {
            Mode::Raw => shade,
            Mode::Trinary | Mode::Scale if occupancy > occupied => 1.0,
            Mode::Scale if occupancy >= free => (occupancy - free) / (occupied - free),
            Mode::Trinary | Mode::Scale => 0.0,
        };
        low + (high - low) * fraction
    };
    let mut elevation = picture.ground([resolution; 2], height);
    elevation.origin = origin.map(|corner| corner + 0.5 * resolution);
    Ok(elevation)
}

/// Place of the lower left corner of the map, m.
fn corner(fields: &Fields<'_>) -> Result<[f64; 2], ElevationError> {
    let rule = "[x, y, yaw] in m, m, rad";
    let items: Option<Vec<f64>> = match fields.entries.get("origin").map(|entry| &entry.value) {
        Some(Value::Many(items)) => items.iter().map(|item| number(item)).collect(),
        _ => None,
    };
    match items.as_deref() {
        Some(&[x, y, 0.0]) => Ok([x, y]),
        Some(&[_, _, _]) => Err(fields.fail("origin", "turned by a yaw of 0")),
        _ => Err(fields.fail("origin", rule)),
    }
}

/// What stands at the top level.
fn entries(bytes: &[u8], path: &Path) -> Result<BTreeMap<String, Entry>, ElevationError> {
    let hint = "a map is a list of lines as resolution: 0.05";
    let fail = |problem: String| file_fault(path, problem, hint);
    if bytes.len() > TEXT_MAX {
        return Err(fail(format!("must be at most {TEXT_MAX} bytes, got more")));
    }
    let text = std::str::from_utf8(bytes)
        .map_err(|error| fail(format!("must be text in UTF-8: {error}")))?;
    let mut parser = Parser::new_from_str(text);
    let mut next = || match parser.next_event() {
        Some(Ok((event, span))) => Ok((event, span.start.line())),
        Some(Err(error)) => {
            let line = error.marker().line();
            Err(fail(format!("line {line}: {}", error.info())))
        }
        None => Ok((Event::StreamEnd, 0)),
    };
    loop {
        match next()? {
            (Event::StreamStart | Event::DocumentStart(_), _) => {}
            (Event::MappingStart(..), _) => break,
            (_, line) => return Err(fail(format!("line {line}: must be lines of key: value"))),
        }
    }
    let mut entries = BTreeMap::new();
    loop {
        let (key, line) = match next()? {
            (Event::Scalar(key, ..), line) => (key.into_owned(), line),
            (Event::MappingEnd, _) => return Ok(entries),
            (_, line) => return Err(fail(format!("line {line}: a key must be a word"))),
        };
        let mut items = Vec::new();
        let (mut depth, mut deepest, mut is_plain) = (0_usize, 0, true);
        loop {
            match next()?.0 {
                Event::Scalar(text, ..) => items.push(text.into_owned()),
                Event::SequenceStart(..) => depth += 1,
                Event::MappingStart(..) => {
                    depth += 1;
                    is_plain = false;
                }
                Event::SequenceEnd | Event::MappingEnd if depth > 0 => depth -= 1,
                Event::Alias(_) => is_plain = false,
                _ => return Err(fail(format!("line {line}: {key} must have a value"))),
            }
            deepest = deepest.max(depth);
            if depth == 0 {
                break;
            }
        }
        let value = match (is_plain, deepest) {
            (true, 0) => Value::One(items.pop().unwrap_or_default()),
            (true, 1) => Value::Many(items),
            _ => Value::Other,
        };
        if entries.contains_key(&key) {
            return Err(fail(format!("line {line}: {key} must not be given twice")));
        }
        entries.insert(key, Entry { line, value });
    }
}
