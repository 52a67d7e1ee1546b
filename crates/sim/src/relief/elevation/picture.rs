//! Grayscale pictures: PNG and PGM.

use std::io::Cursor;
use std::path::Path;

use png::{BitDepth, ColorType, Transformations};

use super::{Elevation, ElevationError, counted, file_fault, upturn};

/// Shades of a picture.
pub(super) struct Picture {
    pub columns: usize,
    pub rows: usize,
    /// From 0 (black) to 1 (white), row by row from the top; NaN where the picture is not opaque.
    pub shades: Vec<f64>,
}

impl Picture {
    /// Refuses a picture that is not opaque everywhere.
    pub fn refuse_clear(&self, path: &Path) -> Result<(), ElevationError> {
        let Some(first) = self.shades.iter().position(|shade| shade.is_nan()) else {
            return Ok(());
        };
        let count = self.shades.iter().filter(|shade| shade.is_nan()).count();
        let (column, row) = (first % self.columns + 1, first / self.columns + 1);
        Err(file_fault(
            path,
            format_args!(
                "must be opaque, got {count} pixels that are not, the first in column {column} of \
                 row {row} from the top"
            ),
            "remove the alpha channel",
        ))
    }

    /// The ground of heights (m) that belong to shades; its lowest node stands at (0, 0).
    pub fn ground(self, spacing: [f64; 2], height: impl Fn(f64) -> f64) -> Elevation {
        let mut heights = self.shades;
        heights.iter_mut().for_each(|value| *value = height(*value));
        upturn(&mut heights, self.columns);
        Elevation {
            origin: [0.0; 2],
            spacing,
            columns: self.columns,
            rows: self.rows,
            heights,
        }
    }
}

/// The picture that bytes are, if they begin as one.
pub(super) fn decode(bytes: &[u8], path: &Path) -> Result<Option<Picture>, ElevationError> {
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        return png(bytes, path).map(Some);
    }
    match bytes {
        [b'P', kind @ (b'2' | b'5'), next, ..] if next.is_ascii_whitespace() || *next == b'#' => {
            pgm(bytes, *kind == b'2', path).map(Some)
        }
        _ => Ok(None),
    }
}

fn png(bytes: &[u8], path: &Path) -> Result<Picture, ElevationError> {
    let unreadable = |error| {
        file_fault(
            path,
            format_args!("cannot be read: {error}"),
            "is it whole?",
        )
    };
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    // Palettes, few bits and a transparent color become 8 or 16 bits a channel.
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(unreadable)?;
    let [columns, rows] = counted(path, header.width.into(), header.height.into())?;
    let mut reader = decoder.read_info().map_err(unreadable)?;
    if reader.info().animation_control.is_some() {
        let hint = "save one frame of it";
        return Err(file_fault(path, "must not be animated", hint));
    }
    let (color, depth) = reader.output_color_type();
    let (channels, has_alpha) = match color {
        ColorType::Grayscale => (1, false),
        ColorType::GrayscaleAlpha => (2, true),
        ColorType::Rgb | ColorType::Indexed => (3, false),
        ColorType::Rgba => (4, true),
    };
    let size = if depth == BitDepth::Sixteen { 2 } else { 1 };
    let mut values = vec![0; columns * rows * channels * size];
    if reader.output_buffer_size() != Some(values.len()) {
        return Err(file_fault(path, "must have 8 or 16 bits a channel", ""));
    }
    reader.next_frame(&mut values).map_err(unreadable)?;
    reader.finish().map_err(unreadable)?;

    let white = if size == 2 { 65535 } else { 255 };
    let mut shades = Vec::with_capacity(columns * rows);
    for (index, pixel) in values.chunks_exact(channels * size).enumerate() {
        let channel = |k: usize| match size {
            2 => u16::from_be_bytes([pixel[2 * k], pixel[2 * k + 1]]),
            _ => pixel[k].into(),
        };
        let colors = channels - usize::from(has_alpha);
        if let Some(k) = (1..colors).find(|&k| channel(k) != channel(0)) {
            let (column, row) = (index % columns + 1, index / columns + 1);
            return Err(file_fault(
                path,
                format_args!(
                    "must be gray, got red {} and {} {} in column {column} of row {row} from the \
                     top",
                    channel(0),
                    ["red", "green", "blue"][k],
                    channel(k)
                ),
                "convert it to grayscale; better with 16 bits than with 8",
            ));
        }
        let is_clear = has_alpha && channel(colors) != white;
        let shade = f64::from(channel(0)) / f64::from(white);
        shades.push(if is_clear { f64::NAN } else { shade });
    }
    Ok(Picture {
        columns,
        rows,
        shades,
    })
}

/// The bytes of a PGM after its kind.
struct Tokens<'a>(&'a [u8]);

impl Tokens<'_> {
    /// The next number; comments reach to the end of their line.
    fn number(&mut self) -> Result<u32, &'static str> {
        loop {
            match self.0 {
                [b'#', ..] => {
                    let end = self.0.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
                    self.0 = &self.0[end.unwrap_or(self.0.len())..];
                }
                [byte, rest @ ..] if byte.is_ascii_whitespace() => self.0 = rest,
                _ => break,
            }
        }
        let digits = self.0.iter().take_while(|byte| byte.is_ascii_digit());
        let (digits, rest) = self.0.split_at(digits.count());
        self.0 = rest;
        let text = std::str::from_utf8(digits).unwrap_or_default();
        match text.parse() {
            Ok(number) => Ok(number),
            Err(_) if rest.is_empty() => Err("it ends too early"),
            Err(_) => Err("a number is missing or too large"),
        }
    }
}

fn pgm(bytes: &[u8], is_plain: bool, path: &Path) -> Result<Picture, ElevationError> {
    let fail = |problem: &str| {
        file_fault(
            path,
            format_args!("cannot be read: {problem}"),
            "is it whole?",
        )
    };
    let mut tokens = Tokens(&bytes[2..]);
    let mut number = || tokens.number().map_err(fail);
    let [columns, rows] = counted(path, number()?.into(), number()?.into())?;
    let white = number()?;
    if !(1..=65535).contains(&white) {
        return Err(file_fault(
            path,
            format_args!("must have white from 1 to 65535, got {white}"),
            "",
        ));
    }
    let count = columns * rows;
    let size = match (is_plain, white > 255) {
        (true, _) => 2,
        (false, is_wide) => 1 + usize::from(is_wide),
    };
    // Each pixel takes that many bytes: no room is made for what is not there.
    if tokens.0.len() < count * size {
        return Err(fail("it ends too early"));
    }
    let mut shades = Vec::with_capacity(count);
    let mut push = |value: u32| {
        shades.push(f64::from(value) / f64::from(white));
        if value > white {
            return Err(fail("a pixel is whiter than white"));
        }
        Ok(())
    };
    let rest = if is_plain {
        for _ in 0..count {
            push(tokens.number().map_err(fail)?)?;
        }
        tokens.0
    } else {
        // One white space stands before the pixels.
        let [space, pixels @ ..] = tokens.0 else {
            return Err(fail("it ends too early"));
        };
        if !space.is_ascii_whitespace() {
            return Err(fail("a number is missing or too large"));
        }
        let Some((pixels, rest)) = pixels.split_at_checked(count * size) else {
            return Err(fail("it ends too early"));
        };
        for pixel in pixels.chunks_exact(size) {
            push(
                pixel
                    .iter()
                    .fold(0, |value, byte| value << 8 | u32::from(*byte)),
            )?;
        }
        rest
    };
    if !rest.iter().all(u8::is_ascii_whitespace) {
        return Err(fail("more follows after the picture"));
    }
    Ok(Picture {
        columns,
        rows,
        shades,
    })
}
