//! The archive that an FMU is, and the folder that it is unpacked into.
//!
//! Whoever made the archive chose its names and sizes: none is believed. Nothing is written outside of the
//! folder, or over a file that is there already, and what is written is counted while it is.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use zip::ZipArchive;

use crate::contract::Fault;
use crate::folder::Folder;

/// Most entries of an archive.
const ENTRIES_MAX: usize = 10_000;
/// Most parts of a name: every folder is a file to the system, and open while what is in it is removed.
const DEPTH_MAX: usize = 64;
/// Most bytes that an archive unpacks to.
const UNPACKED_MAX: u64 = 1 << 28;

/// Unpacks the archive of a file into a folder of its own.
///
/// # Errors
/// It is no archive, would write elsewhere, or is larger than it may be.
pub(crate) fn unpack(file: &Path) -> Result<Folder, Fault> {
    unpack_within(file, UNPACKED_MAX)
}

fn unpack_within(file: &Path, limit: u64) -> Result<Folder, Fault> {
    let failed = |error: io::Error| refused(format!("cannot be unpacked: {error}"));
    let opened = File::open(file).map_err(failed)?;
    let mut archive =
        ZipArchive::new(opened).map_err(|error| refused(format!("must be a ZIP: {error}")))?;
    if archive.len() > ENTRIES_MAX {
        let problem = format!(
            "must have at most {ENTRIES_MAX} files, has {}",
            archive.len()
        );
        return Err(refused(problem));
    }
    let folder = Folder::new().map_err(failed)?;
    let mut left = limit;
    for k in 0..archive.len() {
        let mut entry = archive
            .by_index(k)
            .map_err(|error| refused(format!("cannot be unpacked: {error}")))?;
        let unreadable = |_| refused("must have names in UTF-8".into());
        let name = entry.name().map_err(unreadable)?.to_string();
        let about = |problem: String| refused(format!("{name:?}: {problem}"));
        if entry.is_symlink() {
            return Err(about("must be a file or a folder, is a link".into()));
        }
        let inner = entry.enclosed_name().filter(|_| is_inner(&name));
        let Some(inner) = inner else {
            let rule = "must stay in the archive: neither \"..\" nor a root may be in its path";
            return Err(about(rule.into()));
        };
        if inner.components().count() > DEPTH_MAX {
            let rule = format!("must be at most {DEPTH_MAX} folders deep");
            return Err(refused(rule));
        }
        let path = folder.path().join(inner);
        let failed = |error: io::Error| about(format!("cannot be unpacked: {error}"));
        if entry.is_dir() {
            std::fs::create_dir_all(&path).map_err(failed)?;
            continue;
        }
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(failed)?;
        }
        // A name that comes twice is refused: one of the two would be lost.
        let mut to = File::create_new(&path).map_err(failed)?;
        let written = io::copy(&mut (&mut entry).take(left + 1), &mut to).map_err(failed)?;
        left = left.checked_sub(written).ok_or_else(|| {
            let limit = limit >> 20;
            refused(format!("must unpack to at most {limit} MiB, is larger"))
        })?;
    }
    Ok(folder)
}

/// Whether a name stays below where it is put, on every system.
fn is_inner(name: &str) -> bool {
    let mut parts = name.split(['/', '\\']);
    let is_relative = !name.starts_with(['/', '\\']) && name.as_bytes().get(1) != Some(&b':');
    is_relative && parts.all(|part| part != "..")
}

fn refused(problem: String) -> Fault {
    Fault::new("file", problem)
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::path::PathBuf;

    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    use super::*;

    type Writer = ZipWriter<File>;

    /// An archive in a folder of its own, which lasts as long as that.
    fn archive(fill: impl FnOnce(&mut Writer, SimpleFileOptions)) -> (Folder, PathBuf) {
        let folder = Folder::new().expect("a folder");
        let file = folder.path().join("made.fmu");
        let mut writer = ZipWriter::new(File::create(&file).expect("a file"));
        let options = SimpleFileOptions::default();
        fill(&mut writer, options);
        writer.finish().expect("an archive");
        (folder, file)
    }

    fn put(writer: &mut Writer, options: SimpleFileOptions, name: &str, bytes: &[u8]) {
        writer.start_file(name, options).expect("an entry");
        writer.write_all(bytes).expect("bytes");
    }

    /// What it refuses.
    fn refusal(fill: impl FnOnce(&mut Writer, SimpleFileOptions)) -> String {
        let (_folder, file) = archive(fill);
        let fault = unpack_within(&file, 1 << 20).expect_err("a refusal");
        fault.to_string()
    }

    #[test]
    fn known_answer_of_what_is_unpacked() {
        let (_kept, file) = archive(|writer, options| {
            writer.add_directory("binaries", options).expect("a folder");
            put(writer, options, "binaries/linux64/a.so", b"code");
            put(writer, options, "top.xml", b"<top/>");
        });
        let folder = unpack(&file).expect("unpacked");
        let read = |name: &str| std::fs::read(folder.path().join(name)).expect("a file");
        assert_eq!(read("binaries/linux64/a.so"), b"code");
        assert_eq!(read("top.xml"), b"<top/>");
    }

    #[test]
    fn refusal_of_names_that_lead_out() {
        for name in [
            "../evil",
            "a/../../evil",
            "/etc/evil",
            "a/../b",
            "..\\evil",
            "C:\\evil",
        ] {
            let told = refusal(|writer, options| put(writer, options, name, b"!"));
            assert!(told.contains("must stay in the archive"), "{name}: {told}");
        }
    }

    #[test]
    fn refusal_of_folders_without_end() {
        let told = refusal(|writer, options| {
            put(writer, options, &"d/".repeat(1900), b"");
        });
        assert_eq!(told, "file: must be at most 64 folders deep");
        let (_kept, file) = archive(|writer, options| {
            put(writer, options, &format!("{}x", "d/".repeat(63)), b"!");
        });
        let path = unpack(&file).expect("unpacked").path().to_owned();
        assert!(!path.exists(), "a folder goes with what is in it");
    }

    #[test]
    fn refusal_of_links() {
        let told = refusal(|writer, options| {
            writer
                .add_symlink("resources", "/etc", options)
                .expect("a link");
        });
        assert_eq!(
            told,
            "file: \"resources\": must be a file or a folder, is a link"
        );
    }

    #[test]
    fn refusal_of_bombs() {
        let told = refusal(|writer, options| put(writer, options, "a", &vec![0; (1 << 20) + 1]));
        assert_eq!(told, "file: must unpack to at most 1 MiB, is larger");
        let told = refusal(|writer, options| {
            for k in 0..9 {
                put(writer, options, &format!("{k}"), &vec![0; 1 << 17]);
            }
        });
        assert_eq!(told, "file: must unpack to at most 1 MiB, is larger");
        let told = refusal(|writer, options| {
            for k in 0..=ENTRIES_MAX {
                put(writer, options, &format!("{k}"), b"");
            }
        });
        assert_eq!(told, "file: must have at most 10000 files, has 10001");
    }

    #[test]
    fn refusal_of_what_is_no_archive() {
        let folder = Folder::new().expect("a folder");
        let file = folder.path().join("text.fmu");
        std::fs::write(&file, "text").expect("written");
        let told = unpack(&file).expect_err("a refusal").to_string();
        assert!(told.starts_with("file: must be a ZIP: "), "{told}");
    }

    /// A size in the header that is too small must not let more through than is counted.
    #[test]
    fn refusal_of_a_size_that_is_a_lie() {
        let (_folder, file) = archive(|writer, options| {
            put(writer, options, "a", &vec![0; 3 << 20]);
        });
        let mut bytes = std::fs::read(&file).expect("bytes");
        let truth = (3_u32 << 20).to_le_bytes();
        let places: Vec<usize> = (0..bytes.len() - 4)
            .filter(|&k| bytes[k..k + 4] == truth)
            .collect();
        assert!(!places.is_empty());
        for place in places {
            bytes[place..place + 4].copy_from_slice(&16_u32.to_le_bytes());
        }
        std::fs::write(&file, bytes).expect("written");
        assert!(unpack_within(&file, 1 << 20).is_err());
    }
}
