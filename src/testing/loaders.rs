//! Promise of readers for any bytes: a valid mesh, or a helpful error (P45). Fuzz targets and tests
//! share this module.

use std::ffi::OsString;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::io::{FORMATS, FilePlace, MeshFile, ReadError, read_bytes};
use crate::mesh::TriangleMesh;
use crate::scene::content::Content;
use crate::scene::{SceneError, Surroundings, parse_content};

/// Greatest number of bytes of a file that an error may quote.
const LONGEST_TOKEN: usize = 64;

/// Greatest length of the text of an error [bytes]: problem, a token of 64 bytes of which each can
/// become `\u{1b}`, advice.
const LONGEST_TEXT: usize = 2000;

/// A reader with the name and first bytes of its files.
#[derive(Clone, Debug)]
pub struct Loader {
    /// Name of the fuzz target, of its dictionary and of the folder of its crashes.
    pub name: &'static str,
    /// Name of a file of the format.
    pub file: String,
    /// First bytes of files of the format; other bytes get the last of these as a prefix, so that
    /// they reach this reader.
    pub starts: &'static [&'static [u8]],
}

/// Every reader of [`FORMATS`], and `any`, which leaves the format to the content.
pub fn loaders() -> Vec<Loader> {
    let mut all: Vec<Loader> = Vec::new();
    for spec in &FORMATS {
        if all.iter().all(|loader| loader.name != spec.target) {
            all.push(Loader {
                name: spec.target,
                file: format!("a.{}", spec.ending),
                starts: spec.starts,
            });
        }
    }
    all.push(Loader {
        name: "any",
        file: "a".to_owned(),
        starts: &[b""],
    });
    all
}

/// Kinds of broken promises.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Breach {
    /// The reader panicked.
    #[error("panicked: {message}")]
    Panicked {
        /// Message of the panic.
        message: String,
    },
    /// The mesh has an invalid index, coordinate or line.
    #[error("accepted what is no mesh: {detail}")]
    Invalid {
        /// The defect.
        detail: String,
    },
    /// The text of the error is not one printable line with a code, or its place does not exist.
    #[error("{expected}, but the error is {text:?}")]
    Unhelpful {
        /// Description of the required text.
        expected: &'static str,
        /// The text.
        text: String,
    },
    /// A written file has another content when read.
    #[error("{writer}: {detail}")]
    Changed {
        /// Name of the writer.
        writer: &'static str,
        /// The difference.
        detail: String,
    },
    /// No check has that name.
    #[error("no reader is called {name}")]
    Unknown {
        /// The name.
        name: String,
    },
}

/// Results that keep the promise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadOutcome {
    /// A valid mesh or scene.
    Accepted,
    /// A helpful error.
    Refused,
}

/// Runs the check of a fuzz target by name: a reader of [`LOADERS`], `blocks`, `scene`, `springs`,
/// `pvd`, `opensim`, `write`, `repair` or `state`.
///
/// # Errors
/// The first broken promise.
pub fn check_target(name: &str, bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    match name {
        "blocks" => super::blocks::check_blocks(bytes),
        "scene" => check_scene(bytes),
        "write" => super::round_trip::check_round_trip(bytes),
        "repair" => super::mending::check_repair(bytes),
        "state" => super::restoring::check_state(bytes),
        "springs" => super::spring_files::check_spring_file(bytes),
        "opensim" => super::models::check_model(bytes),
        "pvd" => super::collections::check_collection(bytes),
        _ => match loaders().iter().find(|loader| loader.name == name) {
            Some(loader) => check_loader(loader, bytes),
            None => Err(Breach::Unknown {
                name: name.to_owned(),
            }),
        },
    }
}

/// Checks a reader with bytes, after adding the first bytes of its format.
///
/// # Errors
/// The first broken promise.
pub fn check_loader(loader: &Loader, bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let read = |bytes: &[u8]| check_reader(bytes, |bytes| read_bytes(bytes, &loader.file));
    if let (Some(start), false) = (
        loader.starts.last(),
        loader.starts.iter().any(|start| bytes.starts_with(start)),
    ) {
        return read(&[start, bytes].concat());
    }
    let outcome = read(bytes)?;
    match sized_stl(bytes) {
        Some(sized) if loader.name == "stl" && outcome == LoadOutcome::Refused => read(&sized),
        _ => Ok(outcome),
    }
}

/// Binary STL with the number of triangles that matches its size; most mutated files would fail at
/// that alone.
fn sized_stl(bytes: &[u8]) -> Option<Vec<u8>> {
    let count = bytes.len().checked_sub(84)? / 50;
    let mut sized = bytes[..84 + 50 * count].to_vec();
    sized[80..84].copy_from_slice(&u32::try_from(count).ok()?.to_le_bytes());
    Some(sized)
}

/// Checks any reader with bytes.
///
/// # Errors
/// The first promise that is broken.
pub fn check_reader(
    bytes: &[u8],
    read: impl FnOnce(&[u8]) -> Result<MeshFile, ReadError>,
) -> Result<LoadOutcome, Breach> {
    match caught(|| read(bytes))? {
        Ok(file) => check_mesh(file),
        Err(error) => check_error(&error, bytes),
    }
}

/// Runs a function that must not panic.
pub(super) fn caught<T>(deed: impl FnOnce() -> T) -> Result<T, Breach> {
    catch_unwind(AssertUnwindSafe(deed)).map_err(|payload| {
        let text = payload.downcast_ref::<String>().cloned();
        let text = text.or_else(|| payload.downcast_ref::<&str>().map(|&s| s.to_owned()));
        Breach::Panicked {
            message: text.unwrap_or_default(),
        }
    })
}

fn check_mesh(file: MeshFile) -> Result<LoadOutcome, Breach> {
    let count = file.mesh.vertices.len();
    let invalid = |detail: String| Err(Breach::Invalid { detail });
    if file.mesh.triangles.is_empty() && file.lines.is_empty() {
        return invalid("neither a triangle nor a line".into());
    }
    if let Some(line) = file
        .lines
        .iter()
        .find(|l| l.len() < 2 || l.iter().any(|&i| i as usize >= count))
    {
        return invalid(format!("line {line:?} of {count} vertices"));
    }
    match TriangleMesh::new(file.mesh.vertices, file.mesh.triangles) {
        Ok(_) => Ok(LoadOutcome::Accepted),
        Err(error) => invalid(error.to_string()),
    }
}

pub(super) fn check_error(error: &ReadError, bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let text = error.terse();
    check_text(&text)?;
    let unhelpful = |expected| {
        Err(Breach::Unhelpful {
            expected,
            text: text.clone(),
        })
    };
    let ReadError::Content {
        place,
        column,
        found,
        ..
    } = error
    else {
        return unhelpful("bytes in memory can be read");
    };
    if quoted_bytes(found) > LONGEST_TOKEN {
        return unhelpful("a token of at most 64 bytes");
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match *place {
        FilePlace::Offset(offset) if offset > bytes.len() => unhelpful("an offset within the file"),
        FilePlace::Line(line) if !has_place(bytes, line, *column) => {
            unhelpful("a line and a column of the file")
        }
        _ => Ok(LoadOutcome::Refused),
    }
}

/// Checks for one printable line with a code, of limited length.
fn check_text(text: &str) -> Result<(), Breach> {
    let code = text
        .split_once("error[E")
        .and_then(|(_, rest)| rest.split_once(']'))
        .map_or("", |(code, _)| code);
    let expected = if code.len() != 3 || !code.bytes().all(|b| b.is_ascii_digit()) {
        "a code of three digits"
    } else if text.chars().any(char::is_control) {
        "one printable line"
    } else if text.len() > LONGEST_TEXT {
        "at most 2000 bytes"
    } else {
        return Ok(());
    };
    Err(Breach::Unhelpful {
        expected,
        text: text.to_owned(),
    })
}

/// Least number of bytes of a file that give a quotation: an escape or a replacement character
/// represents one byte.
fn quoted_bytes(found: &str) -> usize {
    let mut rest = found.strip_suffix('…').unwrap_or(found);
    let mut bytes = 0;
    while let Some(c) = rest.chars().next() {
        let escape = if c == '\\' {
            escape_length(&rest[1..])
        } else {
            None
        };
        bytes += if escape.is_some() || c == char::REPLACEMENT_CHARACTER {
            1
        } else {
            c.len_utf8()
        };
        rest = &rest[c.len_utf8() + escape.unwrap_or(0)..];
    }
    bytes
}

/// Length of an escape after its backslash; a backslash of the file itself is quoted unchanged.
fn escape_length(tail: &str) -> Option<usize> {
    if tail.starts_with(['n', 'r', 't']) {
        return Some(1);
    }
    let digits = tail.strip_prefix("u{")?;
    let length = digits.find('}')?;
    digits[..length]
        .bytes()
        .all(|b| b.is_ascii_hexdigit())
        .then_some(length + 3)
}

/// True if a text has the line, or would have it with one more line, and the column in it.
fn has_place(bytes: &[u8], line: usize, column: Option<u32>) -> bool {
    let mut lines = Vec::new();
    let mut start = 0;
    while start <= bytes.len() {
        let rest = &bytes[start..];
        let length = rest
            .iter()
            .position(|&b| b == b'\n' || b == b'\r')
            .unwrap_or(rest.len());
        lines.push(&rest[..length]);
        start += length
            + if rest[length..].starts_with(b"\r\n") {
                2
            } else {
                1
            };
    }
    let characters = |line: &[u8]| line.iter().filter(|&&b| b & 0xc0 != 0x80).count();
    let width = line
        .checked_sub(1)
        .and_then(|i| lines.get(i))
        .map(|line| characters(line));
    match (width, column) {
        (Some(width), Some(column)) => (1..=width + 1).contains(&(column as usize)),
        (Some(_), None) => true,
        (None, column) => line == lines.len() + 1 && column.is_none(),
    }
}

/// Checks the reader of scenes with a text; other bytes are converted to text.
///
/// Files are only tested for existence, and relative ones are searched in a folder that does not
/// exist.
///
/// # Errors
/// The first broken promise.
pub fn check_scene(bytes: &[u8]) -> Result<LoadOutcome, Breach> {
    let text = String::from_utf8_lossy(bytes);
    let folder = Path::new("no-such-folder");
    let nothing = |_: &str| -> Option<OsString> { None };
    let around = Surroundings {
        variable: &nothing,
        ..Surroundings::of(folder)
    };
    match caught(|| parse_content(&text, "s.toml", &around))? {
        Ok(Content::Muscles(scene))
            if scene.frames == 0 || !(scene.frame_rate > 0.0 && scene.frame_rate.is_finite()) =>
        {
            Err(Breach::Invalid {
                detail: format!("{} frames at {}", scene.frames, scene.frame_rate),
            })
        }
        Ok(_) => Ok(LoadOutcome::Accepted),
        Err(error) => caught(|| check_scene_error(&error))?,
    }
}

fn check_scene_error(error: &SceneError) -> Result<LoadOutcome, Breach> {
    let text = error.terse();
    check_text(&text)?;
    if error.place().is_none() {
        return Err(Breach::Unhelpful {
            expected: "a place",
            text,
        });
    }
    // A caret marks these bytes.
    match error.source_text().get(error.span()) {
        Some(_) => Ok(LoadOutcome::Refused),
        None => Err(Breach::Unhelpful {
            expected: "an error that can be shown",
            text,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_beyond_the_file_are_seen() {
        let text = "é 1\r\nv\r\n".as_bytes();
        assert!(
            has_place(text, 1, Some(4)) && has_place(text, 2, Some(2)) && has_place(text, 3, None)
        );
        assert!(has_place(text, 4, None), "behind the end");
        assert!(
            !has_place(text, 1, Some(5)) && !has_place(text, 5, None) && !has_place(text, 0, None)
        );
        assert!(!has_place(text, 1, Some(0)));
    }

    #[test]
    fn quotations_are_counted_in_bytes_of_the_file() {
        assert_eq!(quoted_bytes("é\\u{1b}\\nab\u{fffd}…"), 7);
        assert_eq!(quoted_bytes(&"x".repeat(65)), 65);
        assert_eq!(quoted_bytes("\\\\u{0}\\x\\u{1\\"), 9);
    }

    #[test]
    fn texts_that_do_not_help_are_seen() {
        assert_eq!(check_text("a: error[E011]: x"), Ok(()));
        for text in [
            "a: error[E11]: x",
            "a: x",
            "a: error[E011]: x\n",
            "a: error[EXYZ]: x",
        ] {
            assert!(check_text(text).is_err(), "{text}");
        }
        assert!(check_text(&format!("error[E011]{}", "x".repeat(2000))).is_err());
    }

    #[test]
    fn a_binary_stl_gets_the_count_of_its_size() {
        assert_eq!(sized_stl(&[0; 83]), None);
        let sized = sized_stl(&[9; 84 + 149]).unwrap();
        assert_eq!((sized.len(), &sized[80..84]), (184, &[2, 0, 0, 0][..]));
    }
}
