//! Heights from files: pictures, TIFFs and maps made here, whole and broken.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType};
use tiff::encoder::colortype::{Gray8, Gray16, Gray32Float, Gray64Float, GrayI16, RGB8};
use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffValue, colortype};
use tiff::tags::Tag;

use super::{Elevation, ElevationError, Reading, decode, read};

/// A folder of files, gone with its value.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let folder = format!("appell-elevation-{}-{name}", std::process::id());
        let path = std::env::temp_dir().join(folder);
        std::fs::create_dir_all(&path).expect("room for a folder");
        Folder(path)
    }

    fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, bytes).expect("room for a file");
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Black is −1 m, white 2 m, and pixels are 0.5 m apart.
const READING: Reading = Reading {
    size: None,
    resolution: Some(0.5),
    low: Some(-1.0),
    high: Some(2.0),
    origin: None,
};
/// Nothing said.
const SILENT: Reading = Reading {
    size: None,
    resolution: None,
    low: None,
    high: None,
    origin: None,
};

fn png(size: [u32; 2], color: ColorType, depth: BitDepth, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == ColorType::Indexed {
        encoder.set_palette(&[0, 0, 0, 51, 51, 51, 255, 255, 255][..]);
    }
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(pixels).expect("pixels");
    drop(writer);
    bytes
}

/// A TIFF with more tags.
struct Picture<'a> {
    size: [u32; 2],
    compression: Compression,
    tags: &'a [(Tag, &'a dyn WriteTag)],
}

/// A value that a tag can have.
trait WriteTag {
    fn write(&self, tag: Tag, directory: &mut Directory<'_, '_>);
}

type Directory<'a, 'b> =
    tiff::encoder::DirectoryEncoder<'a, &'b mut Cursor<Vec<u8>>, tiff::encoder::TiffKindStandard>;

impl<V: TiffValue + Clone> WriteTag for V {
    fn write(&self, tag: Tag, directory: &mut Directory<'_, '_>) {
        directory.write_tag(tag, self.clone()).expect("a tag");
    }
}

impl Picture<'_> {
    fn bytes<C: colortype::ColorType>(&self, values: &[C::Inner]) -> Vec<u8>
    where
        [C::Inner]: TiffValue,
    {
        let mut bytes = Cursor::new(Vec::new());
        let encoder = TiffEncoder::new(&mut bytes).expect("a file");
        let mut encoder = encoder.with_compression(self.compression);
        let [width, height] = self.size;
        let mut image = encoder.new_image::<C>(width, height).expect("a picture");
        for (tag, value) in self.tags {
            value.write(*tag, image.encoder());
        }
        image.write_data(values).expect("values");
        bytes.into_inner()
    }
}

/// Three by two, 2 m by 3 m apart, upper left corner at (100, 50), in meters.
const SCALE: [f64; 3] = [2.0, 3.0, 0.0];
const TIE: [f64; 6] = [0.0, 0.0, 0.0, 100.0, 50.0, 0.0];
/// Projected, pixels are areas, in meters.
const KEYS: [u16; 16] = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3076, 0, 1, 9001];

fn geotiff(tags: &[(Tag, &dyn WriteTag)], values: &[f32]) -> Vec<u8> {
    let size = [3, 2];
    let compression = Compression::Uncompressed;
    let picture = Picture {
        size,
        compression,
        tags,
    };
    picture.bytes::<Gray32Float>(values)
}

fn georeferenced(keys: &[u16], more: &[(Tag, &dyn WriteTag)]) -> Vec<u8> {
    let (scale, tie) = (&SCALE[..], &TIE[..]);
    let mut tags: Vec<(Tag, &dyn WriteTag)> = vec![
        (Tag::ModelPixelScaleTag, &scale),
        (Tag::ModelTiepointTag, &tie),
        (Tag::GeoKeyDirectoryTag, &keys),
    ];
    tags.extend(more);
    geotiff(&tags, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
}

#[track_caller]
fn refused(found: Result<Elevation, ElevationError>, field: &str, words: &str) {
    let error = found.expect_err("this must be refused");
    assert_eq!(error.field, field, "{error:?}");
    assert!(error.problem.contains(words), "{error:?}");
}

#[test]
fn known_answer_png_of_every_kind() {
    let folder = Folder::new("kinds");
    // Black, 20 % and white above white, black, 20 %.
    let expected = vec![2.0, -1.0, -0.4, -1.0, -0.4, 2.0];
    let gray = [0, 51, 255, 255, 0, 51];
    let wide: Vec<u8> = gray.iter().flat_map(|value| [*value, *value]).collect();
    let rgb: Vec<u8> = gray.iter().flat_map(|value| [*value; 3]).collect();
    let opaque: Vec<u8> = gray.iter().flat_map(|value| [*value, 255]).collect();
    let both: Vec<u8> = gray.iter().flat_map(|v| [*v, *v, *v, 255]).collect();
    let few = [0b0000_0011, 0b1111_0000, 0b1111_0000, 0b0011_0000];
    let eight = BitDepth::Eight;
    for (color, depth, pixels) in [
        (ColorType::Grayscale, eight, &gray[..]),
        (ColorType::Grayscale, BitDepth::Sixteen, &wide),
        (ColorType::Grayscale, BitDepth::Four, &few),
        (ColorType::GrayscaleAlpha, eight, &opaque),
        (ColorType::Rgb, eight, &rgb),
        (ColorType::Rgba, eight, &both),
        (ColorType::Indexed, eight, &[0, 1, 2, 2, 0, 1]),
    ] {
        let path = folder.file("a.png", png([3, 2], color, depth, pixels));
        let found = read(&path, &READING).expect("a picture");
        assert_eq!([found.columns, found.rows], [3, 2]);
        assert_eq!(found.spacing, [0.5, 0.5]);
        assert_eq!(found.origin, [0.0, 0.0]);
        for (height, expected) in found.heights.iter().zip(&expected) {
            // Products and sums of numbers of this size.
            assert!((height - expected).abs() < 1e-15, "{color:?} {found:?}");
        }
    }
}

#[test]
fn known_answer_size_reaches_from_first_to_last_node() {
    let folder = Folder::new("size");
    let pixels = [0; 15];
    let bytes = png([5, 3], ColorType::Grayscale, BitDepth::Eight, &pixels);
    let path = folder.file("a.png", bytes);
    let reading = Reading {
        size: Some([8.0, 1.0]),
        resolution: None,
        origin: Some([10.0, -3.0]),
        ..READING
    };
    let found = read(&path, &reading).expect("a picture");
    assert_eq!(found.spacing, [2.0, 0.5]);
    assert_eq!(found.origin, [10.0, -3.0]);
}

#[test]
fn known_answer_pgm() {
    let folder = Folder::new("pgm");
    let plain = "P2 # made by hand\n3 2\n# white\n4\n0 2 4\n4 0 2\n";
    // Of two bytes a pixel, the first is worth 256.
    let wide: Vec<u8> = [0, 512, 1024, 1024, 0, 512].map(u16::to_be_bytes).concat();
    let wide = [&b"P5\n3 2\n1024\n"[..], &wide].concat();
    let raw = b"P5 3 2 4\n\x00\x02\x04\x04\x00\x02";
    for bytes in [plain.as_bytes(), raw, &wide] {
        let path = folder.file("a.pgm", bytes);
        let found = read(&path, &READING).expect("a picture");
        // Rows turn over: the lower row of the file, white, black, half, comes first.
        assert_eq!(found.heights, [2.0, -1.0, 0.5, -1.0, 0.5, 2.0]);
    }
}

#[test]
fn known_answer_geotiff_area_and_point() {
    let folder = Folder::new("geo");
    let path = folder.file("a.tif", georeferenced(&KEYS, &[]));
    let found = read(&path, &SILENT).expect("a TIFF");
    assert_eq!(found.heights, [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
    assert_eq!(found.spacing, [2.0, 3.0]);
    // Centers: half a pixel right of the corner, one and a half below it.
    assert_eq!(found.origin, [101.0, 45.5]);
    let mut keys = KEYS;
    keys[11] = 2;
    let path = folder.file("b.tif", georeferenced(&keys, &[]));
    let found = read(&path, &SILENT).expect("a TIFF");
    assert_eq!(found.origin, [100.0, 47.0]);
    let reading = Reading {
        origin: Some([0.0, 1.0]),
        ..SILENT
    };
    assert_eq!(read(&path, &reading).expect("a TIFF").origin, [0.0, 1.0]);
}

#[test]
fn known_answer_geotiff_of_a_matrix() {
    let folder = Folder::new("matrix");
    let mut matrix = [0.0; 16];
    (matrix[0], matrix[3], matrix[5], matrix[7], matrix[15]) = (2.0, 100.0, -3.0, 50.0, 1.0);
    let file = |matrix: &[f64]| {
        let tags: [(Tag, &dyn WriteTag); 1] = [(Tag::ModelTransformationTag, &matrix)];
        folder.file("a.tif", geotiff(&tags, &[0.0; 6]))
    };
    let found = read(&file(&matrix), &SILENT).expect("a TIFF");
    assert_eq!((found.origin, found.spacing), ([101.0, 45.5], [2.0, 3.0]));
    matrix[1] = 0.1;
    refused(read(&file(&matrix), &SILENT), "file", "must not be rotated");
    (matrix[1], matrix[5]) = (0.0, 3.0);
    refused(read(&file(&matrix), &SILENT), "file", "steps > 0");
    matrix[5] = f64::NAN;
    refused(read(&file(&matrix), &SILENT), "file", "steps > 0");
}

#[test]
fn known_answer_plain_tiff_of_every_type() {
    let folder = Folder::new("types");
    let reading = Reading {
        low: None,
        high: None,
        ..READING
    };
    for compression in [
        Compression::Uncompressed,
        Compression::Lzw,
        Compression::Deflate(DeflateLevel::Fast),
        Compression::Packbits,
    ] {
        let size = [2, 3];
        let tags = &[];
        let picture = Picture {
            size,
            compression,
            tags,
        };
        for bytes in [
            picture.bytes::<Gray32Float>(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            picture.bytes::<Gray64Float>(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            picture.bytes::<GrayI16>(&[1, 2, 3, 4, 5, 6]),
            picture.bytes::<Gray16>(&[1, 2, 3, 4, 5, 6]),
        ] {
            let found = read(&folder.file("a.tif", bytes), &reading).expect("a TIFF");
            assert_eq!(found.heights, [5.0, 6.0, 3.0, 4.0, 1.0, 2.0]);
            assert_eq!(found.spacing, [0.5, 0.5]);
        }
    }
}

#[test]
fn refusal_of_tiffs_that_are_no_heights() {
    let folder = Folder::new("strange");
    let file = |bytes: Vec<u8>| folder.file("a.tif", bytes);
    let keys = |model, unit| {
        let mut keys = KEYS;
        (keys[7], keys[15]) = (model, unit);
        georeferenced(&keys, &[])
    };
    refused(read(&file(keys(2, 9001)), &SILENT), "file", "got degrees");
    refused(read(&file(keys(1, 9002)), &SILENT), "file", "EPSG:9002");
    let vertical: Vec<u16> = [&KEYS[..], &[4099, 0, 1, 9003]].concat();
    let found = read(&file(georeferenced(&vertical, &[])), &SILENT);
    refused(found, "file", "heights in meters");
    let with = |tag, value: &dyn WriteTag| georeferenced(&KEYS, &[(tag, value)]);
    let bytes = with(Tag::GdalNodata, &"2");
    refused(
        read(&file(bytes), &SILENT),
        "file",
        "none in 1 of 6 pixels, the first in column 2 of row 1",
    );
    let bytes = with(Tag::GdalNodata, &"-9999");
    assert!(read(&file(bytes), &SILENT).is_ok());
    let bytes = with(Tag::GdalNodata, &"none");
    refused(read(&file(bytes), &SILENT), "file", "a number for no data");
    let bytes = with(Tag::Orientation, &3_u16);
    refused(read(&file(bytes), &SILENT), "file", "top left");
    let bytes = with(
        super::geotiff::GDAL_METADATA,
        &"<Item role=\"scale\">0.1</Item>",
    );
    refused(read(&file(bytes), &SILENT), "file", "scale");
    for (value, words) in [
        (f32::NAN, "none in 1 of 6"),
        (f32::MIN, "heights from"),
        (f32::INFINITY, "heights from"),
    ] {
        let bytes = geotiff(&[], &[0.0, 0.0, 0.0, 0.0, value, 0.0]);
        let reading = Reading {
            resolution: Some(1.0),
            ..SILENT
        };
        refused(read(&file(bytes), &reading), "file", words);
    }
    // A number with more digits than single precision has.
    let text: &dyn WriteTag = &"-3.40282346600000016e+38";
    let bytes = geotiff(&[(Tag::GdalNodata, text)], &[f32::MIN; 6]);
    refused(
        read(&file(bytes), &SILENT),
        "size",
        "must be given, or resolution",
    );
    let bytes = geotiff(&[(Tag::GdalNodata, text)], &[f32::MIN; 6]);
    let reading = Reading {
        resolution: Some(1.0),
        ..SILENT
    };
    refused(read(&file(bytes), &reading), "file", "none in 6 of 6");
    let tie: &[f64] = &[TIE, TIE].concat();
    let scale = &SCALE[..];
    let tags: [(Tag, &dyn WriteTag); 2] = [
        (Tag::ModelPixelScaleTag, &scale),
        (Tag::ModelTiepointTag, &tie),
    ];
    refused(
        read(&file(geotiff(&tags, &[0.0; 6])), &SILENT),
        "file",
        "one tie point, got 3 and 12",
    );
    let picture = Picture {
        size: [2, 2],
        compression: Compression::Uncompressed,
        tags: &[],
    };
    refused(
        read(&file(picture.bytes::<RGB8>(&[0; 12])), &reading),
        "file",
        "must have one band",
    );
    refused(
        read(&file(picture.bytes::<Gray8>(&[0; 4])), &reading),
        "file",
        "values of type",
    );
}

#[test]
fn refusal_of_pages_and_masks() {
    let folder = Folder::new("pages");
    for (kind, words) in [
        (0_u32, Some("one page")),
        (4, Some("no mask")),
        (5, Some("no mask")),
        (1, None),
    ] {
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).expect("a file");
        encoder
            .write_image::<Gray16>(2, 2, &[1; 4])
            .expect("a page");
        let mut second = encoder.new_image::<Gray16>(2, 2).expect("a page");
        second
            .encoder()
            .write_tag(Tag::NewSubfileType, kind)
            .expect("a tag");
        second.write_data(&[2; 4]).expect("values");
        let path = folder.file("a.tif", bytes.into_inner());
        let reading = Reading {
            resolution: Some(1.0),
            ..SILENT
        };
        let found = read(&path, &reading);
        match words {
            Some(words) => refused(found, "file", words),
            None => assert_eq!(found.expect("a TIFF").heights, [1.0; 4]),
        }
    }
}

#[test]
fn refusal_of_what_the_file_says_itself() {
    let folder = Folder::new("said");
    let path = folder.file("a.tif", georeferenced(&KEYS, &[]));
    for (field, reading) in [
        (
            "size",
            Reading {
                size: Some([1.0; 2]),
                ..SILENT
            },
        ),
        (
            "resolution",
            Reading {
                resolution: Some(1.0),
                ..SILENT
            },
        ),
        (
            "low",
            Reading {
                low: Some(1.0),
                ..SILENT
            },
        ),
        (
            "high",
            Reading {
                high: Some(1.0),
                ..SILENT
            },
        ),
    ] {
        refused(read(&path, &reading), field, "must not be given");
    }
}

#[test]
fn refusal_of_readings() {
    let folder = Folder::new("readings");
    let bytes = png([3, 2], ColorType::Grayscale, BitDepth::Eight, &[0; 6]);
    let path = folder.file("a.png", bytes);
    let size = Some([1.0, f64::NAN]);
    for (field, words, reading) in [
        (
            "low",
            "must be given",
            Reading {
                low: None,
                ..READING
            },
        ),
        (
            "high",
            "must be from",
            Reading {
                high: Some(f64::INFINITY),
                ..READING
            },
        ),
        (
            "low",
            "must be from",
            Reading {
                low: Some(f64::NAN),
                ..READING
            },
        ),
        (
            "size",
            "must be given",
            Reading {
                resolution: None,
                ..READING
            },
        ),
        ("resolution", "beside size", Reading { size, ..READING }),
        (
            "size",
            "got [1.0, NaN]",
            Reading {
                size,
                resolution: None,
                ..READING
            },
        ),
        (
            "resolution",
            "got 0.0",
            Reading {
                resolution: Some(0.0),
                ..READING
            },
        ),
        (
            "resolution",
            "got -1.0",
            Reading {
                resolution: Some(-1.0),
                ..READING
            },
        ),
        (
            "origin",
            "must be within",
            Reading {
                origin: Some([f64::NAN, 0.0]),
                ..READING
            },
        ),
    ] {
        refused(read(&path, &reading), field, words);
    }
}

#[test]
fn refusal_of_broken_pictures() {
    let folder = Folder::new("broken");
    let gray = png([3, 2], ColorType::Grayscale, BitDepth::Eight, &[7; 6]);
    for length in [8, 20, 40, gray.len() - 1] {
        let path = folder.file("a.png", &gray[..length]);
        refused(read(&path, &READING), "file", "cannot be read");
    }
    let color = png(
        [3, 2],
        ColorType::Rgb,
        BitDepth::Eight,
        &[9, 9, 9, 1, 1, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    );
    refused(
        read(&folder.file("a.png", color), &READING),
        "file",
        "got red 1 and blue 2 in column 2 of row 1",
    );
    let clear = png(
        [2, 2],
        ColorType::GrayscaleAlpha,
        BitDepth::Eight,
        &[9, 255, 9, 255, 9, 254, 9, 0],
    );
    refused(
        read(&folder.file("a.png", clear), &READING),
        "file",
        "got 2 pixels that are not, the first in column 1 of row 2",
    );
    let narrow = png([1, 2], ColorType::Grayscale, BitDepth::Eight, &[0; 2]);
    refused(
        read(&folder.file("a.png", narrow), &READING),
        "file",
        "2 by 2 pixels, got 1 by 2",
    );
    for (text, words) in [
        ("P2 0 0 1\n", "at least 2 by 2"),
        ("P5 65535 65535 255\n", "at most 16777216 pixels"),
        ("P5 4294967296 2 255\n", "too large"),
        ("P5 4000 4000 255\nab", "ends too early"),
        ("P2 2 2 9 1 2 3 ", "ends too early"),
        ("P2 2 2 9 1 2 3 x ", "missing"),
        ("P2 2 2 9 1 2 3 10", "whiter than white"),
        ("P2 2 2 0 1 2 3 4", "white from 1 to 65535"),
        ("P2 2 2 9 1 2 3 4 5", "more follows"),
        ("P5 2 2 9\n\0\0\0", "ends too early"),
        ("P5 2 2 9\n\0\0\0\0\0", "more follows"),
        ("P6 2 2 9\n", "must be a PNG, PGM or TIFF"),
        ("", "must be a PNG, PGM or TIFF"),
    ] {
        refused(read(&folder.file("a.pgm", text), &READING), "file", words);
    }
    let tiff = georeferenced(&KEYS, &[]);
    for length in [4, 8, 30, tiff.len() - 1] {
        let path = folder.file("a.tif", &tiff[..length]);
        refused(read(&path, &SILENT), "file", "cannot be read");
    }
    refused(
        read(Path::new("/nowhere/a.png"), &READING),
        "file",
        "cannot be read",
    );
    refused(read(&folder.0, &READING), "file", "must be a file");
}

#[test]
fn refusal_of_headers_that_promise_too_much() {
    let folder = Folder::new("bombs");
    let mut gray = png([3, 2], ColorType::Grayscale, BitDepth::Eight, &[7; 6]);
    gray[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
    let sum = crc32(&gray[12..29]);
    gray[29..33].copy_from_slice(&sum.to_be_bytes());
    let found = read(&folder.file("a.png", gray), &READING);
    refused(found, "file", "at most 16777216 pixels, got 16384 by 16384");
    // A TIFF of 40000 by 40000 pixels in four bytes of them.
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).expect("a file");
    let mut directory = encoder.image_directory().expect("a directory");
    let offset = directory.write_data(&[0_u8; 4][..]).expect("data") as u32;
    for (tag, value) in [
        (Tag::ImageWidth, 40_000),
        (Tag::ImageLength, 40_000),
        (Tag::BitsPerSample, 16),
        (Tag::PhotometricInterpretation, 1),
        (Tag::StripOffsets, offset),
        (Tag::StripByteCounts, 4),
        (Tag::RowsPerStrip, 40_000),
    ] {
        directory.write_tag(tag, value).expect("a tag");
    }
    directory.finish().expect("a directory");
    let path = folder.file("a.tif", bytes.into_inner());
    refused(
        read(&path, &SILENT),
        "file",
        "at most 16777216 pixels, got 40000 by 40000",
    );
}

/// The checksum of PNG, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| {
            (sum >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(sum & 1))
        })
    })
}

const MAP: &str = "\
image: a.pgm
resolution: 0.05
origin: [-1.0, 2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.25
";
/// Black, nearly white and gray above white, light gray and dark gray.
const CELLS: &str = "P2 3 2 255\n0 254 128\n255 205 60\n";
/// Walls are 2 m high.
const WALLS: Reading = Reading {
    low: Some(0.0),
    high: Some(2.0),
    ..SILENT
};

#[test]
fn known_answer_map_of_every_mode() {
    let folder = Folder::new("map");
    folder.file("a.pgm", CELLS);
    let heights = |more: &str| {
        let path = folder.file("map.yaml", format!("{MAP}{more}"));
        read(&path, &WALLS).expect("a map")
    };
    let found = heights("");
    assert_eq!(found.heights, [0.0, 0.0, 2.0, 2.0, 0.0, 0.0]);
    assert_eq!(found.spacing, [0.05, 0.05]);
    // The center of the lower left cell.
    assert_eq!(found.origin, [-0.975, 2.025]);
    assert_eq!(heights("mode: trinary\n").heights, found.heights);
    let scaled = heights("mode: scale\n").heights;
    let middle = 2.0 * (1.0 - 128.0 / 255.0 - 0.25) / 0.4;
    assert_eq!(scaled, [0.0, 0.0, 2.0, 2.0, 0.0, middle]);
    let raw = heights("mode: raw\n").heights;
    let expected = [255.0, 205.0, 60.0, 0.0, 254.0, 128.0].map(|value| 2.0 * (value / 255.0));
    assert_eq!(raw, expected);
    let path = folder.file("map.yaml", MAP.replace("negate: 0", "negate: 1"));
    let negated = read(&path, &WALLS).expect("a map").heights;
    assert_eq!(negated, [2.0, 2.0, 0.0, 0.0, 2.0, 0.0]);
    // Written otherwise, with a key that no map server knows, and its picture elsewhere.
    let text = "---\n{resolution: 5e-2, negate: false, occupied_thresh: 0.65, free_thresh: 0.25,\n \
                image: \"../a.pgm\", other: {a: [1, {b: 2}]}, origin: [-1, 2, 0]}\n";
    std::fs::create_dir_all(folder.0.join("below")).expect("a folder");
    let path = folder.file("below/map.yml", text);
    assert_eq!(read(&path, &WALLS).expect("a map"), found);
}

#[test]
fn known_answer_clear_cells_are_unknown_in_scale() {
    let folder = Folder::new("clear");
    let pixels = [0, 255, 0, 0, 255, 255, 0, 255];
    let bytes = png([2, 2], ColorType::GrayscaleAlpha, BitDepth::Eight, &pixels);
    folder.file("a.pgm", bytes);
    let path = folder.file("map.yaml", format!("{MAP}mode: scale\n"));
    let found = read(&path, &WALLS).expect("a map");
    assert_eq!(found.heights, [0.0, 2.0, 2.0, 0.0]);
    refused(
        read(&folder.file("map.yaml", MAP), &WALLS),
        "file",
        "must be opaque",
    );
}

#[test]
fn refusal_of_maps() {
    let folder = Folder::new("maps");
    folder.file("a.pgm", CELLS);
    for (from, to, words) in [
        ("image: a.pgm", "", "must have image"),
        ("image: a.pgm", "image:", "image must be the path"),
        ("image: a.pgm", "image: b.pgm", "b.pgm\" cannot be read"),
        ("image: a.pgm", "image: map.yaml", "must be a PGM or PNG"),
        ("0.05", "0", "line 2: resolution must be a number from"),
        ("0.05", ".nan", "got \".nan\""),
        ("0.05", "nan", "got \"nan\""),
        ("0.05", "[1]", "got [1]"),
        (
            "2.0, 0.0]",
            "2.0, 0.1]",
            "line 3: origin must be turned by a yaw of 0, got [-1.0, 2.0, 0.1]",
        ),
        ("2.0, 0.0]", "2.0]", "origin must be [x, y, yaw]"),
        ("2.0, 0.0]", "inf, 0.0]", "origin must be [x, y, yaw]"),
        ("2.0, 0.0]", "1e300, 0.0]", "must lie within"),
        ("2.0, 0.0]", "2.0, 0.0", "line"),
        ("negate: 0", "negate: 2", "negate must be 0 or 1"),
        ("negate: 0", "", "must have negate"),
        ("0.65", "1.5", "from 0 to 1"),
        ("0.65", "0.2", "free_thresh must be below occupied_thresh"),
        (
            "negate: 0",
            "negate: 0\nmode: best",
            "trinary, scale or raw",
        ),
        (
            "negate: 0",
            "negate: 0\nmode: [raw]",
            "trinary, scale or raw",
        ),
        (
            "negate: 0",
            "negate: 0\nnegate: 0",
            "line 5: negate must not be given twice",
        ),
        ("negate: 0", "a: &a [b]\nnegate: *a", "got something nested"),
        ("image: a.pgm", "- image", "line"),
    ] {
        let path = folder.file("map.yaml", MAP.replacen(from, to, 1));
        refused(read(&path, &WALLS), "file", words);
    }
    let path = folder.file("map.yaml", "- a\n- b\n");
    refused(
        read(&path, &WALLS),
        "file",
        "line 1: must be lines of key: value",
    );
    let path = folder.file("map.yaml", b"image: \xff");
    refused(read(&path, &WALLS), "file", "UTF-8");
    let path = folder.file("map.yaml", "a: b\n".repeat(20_000));
    refused(read(&path, &WALLS), "file", "at most 65536 bytes");
    let path = folder.file("map.yaml", "a: ".to_owned() + &"[".repeat(60_000));
    assert!(read(&path, &WALLS).is_err());
    let path = folder.file("map.yaml", MAP);
    refused(read(&path, &SILENT), "low", "must be given");
    let reading = Reading {
        resolution: Some(1.0),
        ..WALLS
    };
    refused(read(&path, &reading), "resolution", "must not be given");
}

#[test]
fn invariant_broken_bytes_give_heights_or_an_error() {
    let folder = Folder::new("mutants");
    folder.file("a.pgm", CELLS);
    let deflated = Picture {
        size: [40, 30],
        compression: Compression::Deflate(DeflateLevel::Fast),
        tags: &[],
    };
    let values: Vec<f32> = (0..1200).map(|k| k as f32).collect();
    let wide = png([3, 2], ColorType::Grayscale, BitDepth::Sixteen, &[7; 12]);
    let reading = Reading {
        resolution: Some(1.0),
        ..SILENT
    };
    let sources = [
        ("a.png", wide, READING),
        ("b.pgm", CELLS.into(), READING),
        ("c.tif", georeferenced(&KEYS, &[]), SILENT),
        ("d.tif", deflated.bytes::<Gray32Float>(&values), reading),
        ("e.yaml", MAP.into(), WALLS),
    ];
    let mut state = 1_u64;
    let mut next = move |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 33) as usize % below
    };
    let (mut fine, mut broken) = (0, 0);
    for (name, bytes, reading) in &sources {
        for _ in 0..2000 {
            let mut bytes = bytes.clone();
            for _ in 0..=next(4) {
                let at = next(bytes.len());
                match next(4) {
                    0 => bytes[at] = next(256) as u8,
                    1 => bytes[at] ^= 1 << next(8),
                    2 => bytes.truncate(at.max(1)),
                    _ => bytes.insert(at, next(256) as u8),
                }
            }
            match decode(&bytes, &folder.0.join(name), reading) {
                Ok(found) => {
                    assert_eq!(found.heights.len(), found.columns * found.rows);
                    assert!(found.heights.iter().all(|height| height.is_finite()));
                    fine += 1;
                }
                Err(error) => {
                    assert!(!error.problem.is_empty());
                    broken += 1;
                }
            }
        }
    }
    assert!(fine > 250 && broken > 2500, "{fine} {broken}");
}
