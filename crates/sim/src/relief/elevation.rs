//! Heights of the ground from files: grayscale pictures, GeoTIFFs and maps of the ROS map server.
//!
//! Every pixel is a node: its height holds at its center, and what lies between is interpolated.
//! The top row of a picture has the largest y. A picture's `size` reaches from the first node to
//! the last, so that n pixels have n − 1 intervals, as height maps in Gazebo and MuJoCo.

use std::io::Read;
use std::path::Path;

mod geotiff;
mod map;
mod picture;

/// Most nodes of a grid: 4096 by 4096.
const NODES_MAX: u64 = 1 << 24;
/// Most bytes of a file: a grid of 8 bytes a node, with its overviews and to spare.
const BYTES_MAX: u64 = 1 << 28;
/// Spacings of nodes, m.
const SPACING: [f64; 2] = [1e-6, 1e6];
/// Farthest coordinate, m: larger than that of any map projection.
const COORDINATE_MAX: f64 = 1e8;
/// Largest height either way, m: more than any mountain has, and less than the numbers −32768 and
/// −3.4e38 that stand for missing heights.
const HEIGHT_MAX: f64 = 2.5e4;

/// Heights on a regular grid: node (i, j) stands at `origin` + (i, j) · `spacing`.
#[derive(Clone, Debug, PartialEq)]
pub struct Elevation {
    /// Place of node (0, 0), which has the lowest x and y, m.
    pub origin: [f64; 2],
    /// Distance of neighboring nodes along x and y, m.
    pub spacing: [f64; 2],
    /// Nodes along x, at least 2.
    pub columns: usize,
    /// Nodes along y, at least 2.
    pub rows: usize,
    /// Height of node (i, j) at j · `columns` + i, m.
    pub heights: Vec<f64>,
}

/// What the values of a file mean, as a scenario says it.
///
/// A picture (PNG, PGM) needs `low`, `high`, and one of `size` and `resolution`. A map says its
/// resolution itself, and needs `low` and `high`. A TIFF has heights in meters, and says its spacing
/// itself unless it is a plain one. What a file says itself must not be said again.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Extent from the first node to the last along x and y, m.
    pub size: Option<[f64; 2]>,
    /// Distance of neighboring nodes along both axes, m.
    pub resolution: Option<f64>,
    /// Height of black in a picture, and of free and unknown cells in a map, m.
    pub low: Option<f64>,
    /// Height of white in a picture, and of occupied cells in a map, m.
    pub high: Option<f64>,
    /// Place of the node with the lowest x and y, m. Without it a georeferenced file stands where it
    /// says, and a picture has that node at (0, 0), the corner of the arena.
    pub origin: Option<[f64; 2]>,
}

/// Why a file gives no heights.
#[derive(Clone, Debug, PartialEq)]
pub struct ElevationError {
    /// The field of the scenario that is concerned: `file`, or one of [`Reading`].
    pub field: &'static str,
    /// What must be otherwise.
    pub problem: String,
    /// What to do.
    pub hint: String,
}

fn fault(
    field: &'static str,
    problem: impl Into<String>,
    hint: impl Into<String>,
) -> ElevationError {
    ElevationError {
        field,
        problem: problem.into(),
        hint: hint.into(),
    }
}

/// A fault of the file itself.
fn file_fault(
    path: &Path,
    problem: impl std::fmt::Display,
    hint: impl Into<String>,
) -> ElevationError {
    fault("file", format!("\"{}\" {problem}", path.display()), hint)
}

/// Reads the heights of a file; its first bytes tell the format, the ending only that of a map
/// (`.yaml`, `.yml`).
///
/// # Errors
/// The file cannot be read, is of no known format, has no height somewhere, is too large (16 777 216
/// nodes) or too small (2 by 2), or does not go with `reading`: which field, what it must be, and
/// what to do.
pub fn read(path: &Path, reading: &Reading) -> Result<Elevation, ElevationError> {
    let bytes = contents(path, "the path is relative to the scenario file")?;
    decode(&bytes, path, reading)
}

/// The heights that the bytes of a file are.
fn decode(bytes: &[u8], path: &Path, reading: &Reading) -> Result<Elevation, ElevationError> {
    let is_map = path.extension().is_some_and(|ending| {
        ["yaml", "yml"]
            .iter()
            .any(|map| ending.eq_ignore_ascii_case(map))
    });
    let elevation = if let Some(picture) = picture::decode(bytes, path)? {
        let [low, high] = heights(reading)?;
        picture.refuse_clear(path)?;
        let spacing = spacing(reading, picture.columns, picture.rows)?;
        picture.ground(spacing, |shade| low + (high - low) * shade)
    } else if geotiff::is_tiff(bytes) {
        geotiff::decode(bytes, path, reading)?
    } else if is_map {
        map::decode(bytes, path, reading)?
    } else {
        return Err(file_fault(
            path,
            "must be a PNG, PGM or TIFF, or a map's YAML",
            "convert it, for example with gdal_translate in.asc out.tif",
        ));
    };
    placed(elevation, path, reading)
}

/// The bytes of a file.
fn contents(path: &Path, hint: &str) -> Result<Vec<u8>, ElevationError> {
    let fail = |problem: String| file_fault(path, problem, hint);
    let unreadable = |error| fail(format!("cannot be read: {error}"));
    let file = std::fs::File::open(path).map_err(unreadable)?;
    if !file.metadata().map_err(unreadable)?.is_file() {
        return Err(fail("must be a file".into()));
    }
    let mut bytes = Vec::new();
    file.take(BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    if bytes.len() as u64 > BYTES_MAX {
        return Err(file_fault(
            path,
            format_args!("must be at most {BYTES_MAX} bytes, got more"),
            "cut it, or make it coarser",
        ));
    }
    Ok(bytes)
}

/// Columns and rows of a grid, if it can be one.
fn counted(path: &Path, columns: u64, rows: u64) -> Result<[usize; 2], ElevationError> {
    if columns < 2 || rows < 2 {
        return Err(file_fault(
            path,
            format_args!("must be at least 2 by 2 pixels, got {columns} by {rows}"),
            "",
        ));
    }
    if columns.checked_mul(rows).is_none_or(|all| all > NODES_MAX) {
        return Err(file_fault(
            path,
            format_args!("must be at most {NODES_MAX} pixels, got {columns} by {rows}"),
            "cut it, or make it coarser",
        ));
    }
    Ok([columns as usize, rows as usize])
}

/// Heights of the lowest and of the highest shade, m.
fn heights(reading: &Reading) -> Result<[f64; 2], ElevationError> {
    let bound = |field, value: Option<f64>| {
        let problem = match value {
            Some(value) if value.abs() <= HEIGHT_MAX => return Ok(value),
            Some(value) => format!("must be from -{HEIGHT_MAX} to {HEIGHT_MAX}, got {value:?}"),
            None => "must be given: a picture has shades, and no heights".into(),
        };
        let hint = "low and high are the heights of black and white, m; in a map, of free and \
                    occupied cells";
        Err(fault(field, problem, hint))
    };
    Ok([bound("low", reading.low)?, bound("high", reading.high)?])
}

/// Distance of the nodes of a file that does not say it, m.
fn spacing(reading: &Reading, columns: usize, rows: usize) -> Result<[f64; 2], ElevationError> {
    let within = |field, values: [f64; 2], spacing: [f64; 2]| {
        let [least, most] = SPACING;
        if spacing.iter().all(|s| (least..=most).contains(s)) {
            return Ok(spacing);
        }
        let got = match field {
            "size" => format!("{values:?}"),
            _ => format!("{:?}", values[0]),
        };
        Err(fault(
            field,
            format!("must set pixels {least} m to {most} m apart, got {got}"),
            "",
        ))
    };
    match (reading.size, reading.resolution) {
        (Some(size), None) => within(
            "size",
            size,
            [size[0] / (columns - 1) as f64, size[1] / (rows - 1) as f64],
        ),
        (None, Some(resolution)) => within("resolution", [resolution; 2], [resolution; 2]),
        (Some(_), Some(_)) => Err(fault(
            "resolution",
            "must not stand beside size",
            "keep one of the two",
        )),
        (None, None) => Err(fault(
            "size",
            "must be given, or resolution: the file does not say how large the ground is",
            "size = [x, y] reaches from the first pixel to the last, m; resolution is m a pixel",
        )),
    }
}

/// Refuses what the file says itself.
fn refuse_said(fields: [(&'static str, bool); 2], problem: &str) -> Result<(), ElevationError> {
    match fields.into_iter().find(|(_, is_said)| *is_said) {
        Some((field, _)) => Err(fault(field, problem, "leave it out")),
        None => Ok(()),
    }
}

/// The ground where the scenario wants it, if that can be.
fn placed(
    mut elevation: Elevation,
    path: &Path,
    reading: &Reading,
) -> Result<Elevation, ElevationError> {
    let is_near = |place: &[f64; 2]| place.iter().all(|x| x.abs() <= COORDINATE_MAX);
    if let Some(origin) = reading.origin {
        if !is_near(&origin) {
            return Err(fault(
                "origin",
                format!("must be within {COORDINATE_MAX} m, got {origin:?}"),
                "",
            ));
        }
        elevation.origin = origin;
    }
    let [least, most] = SPACING;
    if !elevation.spacing.iter().all(|s| (least..=most).contains(s)) {
        return Err(file_fault(
            path,
            format_args!(
                "must have pixels {least} m to {most} m apart, got {:?}",
                elevation.spacing
            ),
            "",
        ));
    }
    if !is_near(&elevation.origin) {
        return Err(file_fault(
            path,
            format_args!(
                "must lie within {COORDINATE_MAX} m, got {:?}",
                elevation.origin
            ),
            "origin = [x, y] puts it elsewhere",
        ));
    }
    Ok(elevation)
}

/// Turns rows from the top into rows from the bottom.
fn upturn(values: &mut [f64], columns: usize) {
    let rows = values.len() / columns;
    for row in 0..rows / 2 {
        let (lower, upper) = values.split_at_mut((rows - 1 - row) * columns);
        lower[row * columns..][..columns].swap_with_slice(&mut upper[..columns]);
    }
}

#[cfg(test)]
mod tests;
