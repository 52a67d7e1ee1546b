//! TIFFs of one band whose values are heights in meters, with the tags of GeoTIFF or without.
//!
//! Plain TIFFs take their spacing from the scenario. Where GeoTIFF keys name a unit it must be the
//! meter; a file without keys is taken to be in meters.

use std::io::Cursor;
use std::path::Path;

use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError, TiffResult};

use super::{
    Elevation, ElevationError, HEIGHT_MAX, NODES_MAX, Reading, counted, file_fault, refuse_said,
    spacing, upturn,
};

/// Names and units of values, as GDAL writes them.
pub(super) const GDAL_METADATA: Tag = Tag::from_u16_exhaustive(42112);
/// Most pictures of one file: overviews halve, and none is smaller than a pixel.
const PICTURES_MAX: usize = 64;
/// What to do with heights in feet.
const FEET: &str = "convert it first: a foot is 0.3048 m";
/// What to do with coordinates that are not plane ones in meters.
const PROJECT: &str = "project it to meters first, for example gdalwarp -t_srs EPSG:32632 -r \
                       bilinear in.tif out.tif with the UTM zone of the place";

pub(super) fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]
        .iter()
        .any(|magic| bytes.starts_with(*magic))
}

/// A file being read.
struct File<'a> {
    path: &'a Path,
    /// Bytes of the file.
    length: u64,
    decoder: Decoder<Cursor<&'a [u8]>>,
}

/// The ground of a TIFF.
pub(super) fn decode(
    bytes: &[u8],
    path: &Path,
    reading: &Reading,
) -> Result<Elevation, ElevationError> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = NODES_MAX as usize * size_of::<f64>();
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    let mut file = File {
        path,
        length: bytes.len() as u64,
        decoder: Decoder::new(Cursor::new(bytes))
            .map_err(|error| unreadable(path, &error))?
            .with_limits(limits),
    };
    let size = file.decoder.dimensions();
    let (width, height) = size.map_err(|error| unreadable(path, &error))?;
    let [columns, rows] = counted(path, width.into(), height.into())?;
    file.refuse_strange()?;
    refuse_said(
        [
            ("low", reading.low.is_some()),
            ("high", reading.high.is_some()),
        ],
        "must not be given: a TIFF has heights in meters",
    )?;
    let (origin, spacing) = match file.grid(rows)? {
        Some((origin, spacing)) => {
            refuse_said(
                [
                    ("size", reading.size.is_some()),
                    ("resolution", reading.resolution.is_some()),
                ],
                "must not be given: the TIFF says its spacing itself",
            )?;
            (origin, spacing)
        }
        None => {
            let spacing = spacing(reading, columns, rows)?;
            ([0.0; 2], spacing)
        }
    };
    let mut elevation = Elevation {
        origin,
        spacing,
        columns,
        rows,
        heights: file.heights(columns)?,
    };
    if elevation.heights.len() != columns * rows {
        return Err(file_fault(path, "must have one value a pixel", ""));
    }
    upturn(&mut elevation.heights, columns);
    Ok(elevation)
}

fn unreadable(path: &Path, error: &TiffError) -> ElevationError {
    let problem = format_args!("cannot be read: {error}");
    let hint = "if it is whole, write it anew, for example with gdal_translate -co \
                COMPRESS=DEFLATE in.tif out.tif";
    file_fault(path, problem, hint)
}

impl File<'_> {
    fn fail(&self, problem: impl std::fmt::Display, hint: &str) -> ElevationError {
        file_fault(self.path, problem, hint)
    }

    /// The value of a tag as something; its default where the tag is not there.
    fn value<V: Default>(
        &mut self,
        tag: Tag,
        into: impl Fn(Value) -> TiffResult<V>,
    ) -> Result<V, ElevationError> {
        let entry = self.decoder.image_ifd().find_entry(tag);
        // More values than bytes would ask for room before they are missed.
        if entry.is_some_and(|entry| entry.count() > self.length) {
            let problem = format_args!("cannot be read: tag {} ends too late", tag.to_u16());
            return Err(self.fail(problem, "is it whole?"));
        }
        let found = self.decoder.find_tag(tag);
        found
            .and_then(|value| value.map_or_else(|| Ok(V::default()), into))
            .map_err(|error| unreadable(self.path, &error))
    }

    /// The numbers of a tag; none where it is not there.
    fn numbers(&mut self, tag: Tag) -> Result<Vec<f64>, ElevationError> {
        self.value(tag, Value::into_f64_vec)
    }

    /// The whole numbers of a tag; none where it is not there.
    fn words(&mut self, tag: Tag) -> Result<Vec<u16>, ElevationError> {
        self.value(tag, Value::into_u16_vec)
    }

    /// The text of a tag; none where it is not there.
    fn text(&mut self, tag: Tag) -> Result<String, ElevationError> {
        self.value(tag, Value::into_string)
    }

    /// Refuses files whose values are no heights, or not in their places.
    fn refuse_strange(&mut self) -> Result<(), ElevationError> {
        let color = self.decoder.colortype();
        let color = color.map_err(|error| unreadable(self.path, &error))?;
        let ColorType::Gray(_) = color else {
            let hint = "cut it out, for example with gdal_translate -b 1 in.tif out.tif";
            return Err(self.fail(format_args!("must have one band, got {color:?}"), hint));
        };
        if self.words(Tag::PhotometricInterpretation)? != [1] {
            let hint = "write it anew, for example with gdal_translate in.tif out.tif";
            return Err(self.fail("must have values whose least is black", hint));
        }
        if !matches!(self.words(Tag::Orientation)?[..], [] | [1]) {
            let hint = "write it anew with its first row at the top";
            return Err(self.fail("must have its first pixel at the top left", hint));
        }
        let notes = self.text(GDAL_METADATA)?;
        if ["scale", "offset"]
            .iter()
            .any(|role| notes.contains(&format!("role=\"{role}\"")))
        {
            let hint = "apply them, with gdal_translate -unscale -ot Float32 in.tif out.tif";
            return Err(self.fail("must have heights without a scale or an offset", hint));
        }
        // What follows may be coarser copies; a mask would hide heights, a page be another ground.
        let mut next = self.decoder.image_ifd().directory().next();
        for _ in 0..PICTURES_MAX {
            let Some(pointer) = next else { return Ok(()) };
            let directory = self.decoder.read_directory(pointer);
            let directory = directory.map_err(|error| unreadable(self.path, &error))?;
            let mut tags = self.decoder.read_directory_tags(&directory);
            let kind = tags.find_tag_unsigned(Tag::NewSubfileType);
            let kind: Option<u32> = kind.map_err(|error| unreadable(self.path, &error))?;
            // Bit 0 marks a coarser copy, bit 2 a mask.
            match kind.unwrap_or(0) & 0b101 {
                0b001 => {}
                0b000 => {
                    let hint =
                        "take one page, for example with gdal_translate GTIFF_DIR:1:in.tif out.tif";
                    return Err(self.fail("must have one page", hint));
                }
                _ => {
                    let hint =
                        "fill the gaps, for example with gdal_fillnodata, and leave the mask out";
                    return Err(self.fail("must have no mask", hint));
                }
            }
            next = directory.next();
        }
        Err(self.fail(format_args!("must have at most {PICTURES_MAX} copies"), ""))
    }

    /// Place of the node with the lowest x and y, and spacing, m; none in a plain TIFF.
    fn grid(&mut self, rows: usize) -> Result<Option<Grid>, ElevationError> {
        let scale = self.numbers(Tag::ModelPixelScaleTag)?;
        let tie = self.numbers(Tag::ModelTiepointTag)?;
        let matrix = self.numbers(Tag::ModelTransformationTag)?;
        let is_center = self.is_center()?;
        // Steps along columns and rows, and the model's place of the raster's (0, 0).
        let (step, zero) = match (&scale[..], &tie[..], &matrix[..]) {
            ([], [], []) => return Ok(None),
            (&[right, down, ..], &[i, j, _, x, y, _], []) => {
                ([right, -down], [x - i * right, y + j * down])
            }
            (_, _, &[a, b, _, x, d, e, _, y, ..]) if b == 0.0 && d == 0.0 => ([a, e], [x, y]),
            (_, _, [_, ..]) => {
                let hint = "straighten it, for example with gdalwarp in.tif out.tif";
                return Err(self.fail("must not be rotated or sheared", hint));
            }
            _ => {
                let hint = "write it anew, for example with gdalwarp in.tif out.tif";
                let problem = format_args!(
                    "must have a pixel scale and one tie point, got {} and {} numbers of them",
                    scale.len(),
                    tie.len()
                );
                return Err(self.fail(problem, hint));
            }
        };
        let [right, down] = [step[0], -step[1]];
        if !(right > 0.0 && right.is_finite() && down > 0.0 && down.is_finite()) {
            let hint =
                "write it anew with north at the top, for example with gdalwarp in.tif out.tif";
            let problem = format_args!(
                "must have steps > 0 to the right and down, got {right:?} and {down:?}"
            );
            return Err(self.fail(problem, hint));
        }
        // A pixel is the area from its upper left corner on, or a point there.
        let center = if is_center { 0.0 } else { 0.5 };
        Ok(Some((
            [
                zero[0] + center * right,
                zero[1] - ((rows - 1) as f64 + center) * down,
            ],
            [right, down],
        )))
    }

    /// Whether raster coordinates count from the centers of pixels, by the GeoTIFF keys, which must
    /// agree to meters.
    fn is_center(&mut self) -> Result<bool, ElevationError> {
        let keys = self.words(Tag::GeoKeyDirectoryTag)?;
        let mut is_center = false;
        // A header of four words, then four a key: its number, where its value is, count, value.
        for key in keys.chunks_exact(4).skip(1) {
            match *key {
                // Model: 2 is geographic, 3 geocentric.
                [1024, 0, _, model @ (2 | 3)] => {
                    let kind = if model == 2 {
                        "degrees"
                    } else {
                        "a geocentric system"
                    };
                    let problem = format_args!("must have plane coordinates in meters, got {kind}");
                    return Err(self.fail(problem, PROJECT));
                }
                [1025, 0, _, raster] => is_center = raster == 2,
                // Units along the ground, then of height: 9001 is the meter.
                [3076, 0, _, unit] if unit != 9001 => {
                    let problem = format_args!(
                        "must have coordinates in meters, got those of unit EPSG:{unit}"
                    );
                    return Err(self.fail(problem, PROJECT));
                }
                [4099, 0, _, unit] if unit != 9001 => {
                    let problem =
                        format_args!("must have heights in meters, got those of unit EPSG:{unit}");
                    return Err(self.fail(problem, FEET));
                }
                _ => {}
            }
        }
        Ok(is_center)
    }

    /// Heights, m, row by row from the top.
    fn heights(&mut self, columns: usize) -> Result<Vec<f64>, ElevationError> {
        let text = self.text(Tag::GdalNodata)?;
        let text = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
        let nodata: Option<f64> = match text {
            "" => None,
            text => Some(text.parse().map_err(|_| {
                self.fail(
                    format_args!("must have a number for no data, got \"{text}\""),
                    "",
                )
            })?),
        };
        let values = self.decoder.read_image();
        let values = values.map_err(|error| unreadable(self.path, &error))?;
        let (heights, nodata): (Vec<f64>, _) = match values {
            DecodingResult::F64(values) => (values, nodata),
            // The text may have more digits than single precision.
            DecodingResult::F32(values) => (
                values.into_iter().map(f64::from).collect(),
                nodata.map(|value| f64::from(value as f32)),
            ),
            DecodingResult::I16(values) => (values.into_iter().map(f64::from).collect(), nodata),
            DecodingResult::U16(values) => (values.into_iter().map(f64::from).collect(), nodata),
            _ => {
                let hint = "convert it, for example with gdal_translate -ot Float32 in.tif out.tif";
                let problem = "must have values of type Float32, Float64, Int16 or UInt16";
                return Err(self.fail(problem, hint));
            }
        };
        let place = |at: usize| {
            let (column, row) = (at % columns + 1, at / columns + 1);
            format!("in column {column} of row {row} from the top")
        };
        let is_gap = |height: &&f64| height.is_nan() || Some(**height) == nodata;
        if let Some(first) = heights.iter().position(|height| is_gap(&height)) {
            let problem = format_args!(
                "must have a height everywhere, got none in {} of {} pixels, the first {}",
                heights.iter().filter(is_gap).count(),
                heights.len(),
                place(first)
            );
            let hint = "fill the gaps, for example with gdal_fillnodata, or cut them off with \
                        gdalwarp -te";
            return Err(self.fail(problem, hint));
        }
        if let Some(at) = heights.iter().position(|height| height.abs() > HEIGHT_MAX) {
            let hint = "if that number stands for no data, fill the gaps, for example with \
                        gdal_fillnodata";
            let problem = format_args!(
                "must have heights from -{HEIGHT_MAX} m to {HEIGHT_MAX} m, got {:?} {}",
                heights[at],
                place(at)
            );
            return Err(self.fail(problem, hint));
        }
        Ok(heights)
    }
}

/// Place of the node with the lowest x and y, and spacing, m.
type Grid = ([f64; 2], [f64; 2]);
