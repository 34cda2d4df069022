//! What can go wrong while a mesh file is read, with the place in the file.

use std::fmt;

/// The most bytes of a file that an error message quotes.
const QUOTED_BYTES: usize = 64;

/// The formats that can be read, for messages.
pub(super) const READABLE: &str = "OBJ, PLY, STL and legacy VTK polydata can be read";

/// Why a mesh file was not read; its text is one line, `path:line: message (found '...')`.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system gave no bytes.
    #[error("{file}: cannot be read: {source}")]
    Io {
        /// The file, as it was named by the caller.
        file: String,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The bytes are no mesh that can be used.
    #[error("{file}:{place} {problem}{}", Found(.found))]
    Content {
        /// The file, as it was named by the caller.
        file: String,
        /// Where in the file.
        place: Place,
        /// What is wrong, or what was expected.
        problem: Problem,
        /// What stands there, at most 64 bytes of the file, made printable; empty where nothing does.
        found: String,
    },
}

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    Whole,
    /// A line of text, counted from 1.
    Line(usize),
    /// Bytes from the beginning, for binary data.
    Offset(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Whole => Ok(()),
            Place::Line(line) => write!(f, "{line}:"),
            Place::Offset(offset) => write!(f, " offset {offset:#x}:"),
        }
    }
}

/// What is wrong in a mesh file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Problem {
    /// The file has no bytes.
    #[error("the file is empty")]
    Empty,
    /// The file is larger than the reader accepts.
    #[error("the file has {bytes} bytes, more than the limit of {limit}")]
    TooLarge {
        /// Size of the file [bytes].
        bytes: u64,
        /// The limit [bytes].
        limit: u64,
    },
    /// The text is UTF-16.
    #[error("the text is UTF-16; save it as UTF-8")]
    Utf16,
    /// The first bytes belong to no format that can be read.
    #[error("unknown format; {READABLE}")]
    UnknownFormat,
    /// The format or the variant of it is known, but not read.
    #[error("{what}: format not supported yet; {READABLE}")]
    Unsupported {
        /// The format or variant.
        what: &'static str,
    },
    /// Something else should stand here.
    #[error("expected {what}")]
    Expected {
        /// What should stand here.
        what: &'static str,
    },
    /// A number is missing.
    #[error("too few numbers: {got} of {wanted}")]
    TooFewNumbers {
        /// How many were found.
        got: usize,
        /// How many are needed.
        wanted: usize,
    },
    /// A number is written with a comma.
    #[error("not a number; decimal comma? Write a point")]
    DecimalComma,
    /// A coordinate is NaN or infinite, or too large for a double.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// Index of the vertex, from 0.
        vertex: usize,
    },
    /// A zero where indices start at 1.
    #[error("vertex index 0, but OBJ counts from 1")]
    ZeroIndex,
    /// A vertex that does not exist.
    #[error("vertex index {index} is out of range: there are {count} vertices{}", if *.from_one { ", counted from 1" } else { "" })]
    IndexOutOfRange {
        /// The index as written.
        index: i64,
        /// Number of vertices.
        count: usize,
        /// Whether the format counts from 1.
        from_one: bool,
    },
    /// A face of fewer than three corners, or a line of fewer than two.
    #[error("too few corners: {got}, at least {wanted} are needed")]
    TooFewCorners {
        /// How many were found.
        got: usize,
        /// How many are needed.
        wanted: usize,
    },
    /// A count that the file cannot hold.
    #[error("{declared} items are declared, but the file has room for at most {possible}")]
    CountExceedsFile {
        /// The count as declared.
        declared: u64,
        /// The most that the rest of the file can hold.
        possible: u64,
    },
    /// The bytes end too early.
    #[error("the file ends too early, in {what}")]
    Truncated {
        /// What was being read.
        what: &'static str,
    },
    /// Two counts of the file contradict each other.
    #[error("{what} does not fit: {declared} declared, {used} used")]
    SizeMismatch {
        /// What was counted.
        what: &'static str,
        /// The declared count.
        declared: u64,
        /// The count found.
        used: u64,
    },
    /// A NUL byte in a text.
    #[error("a NUL byte in a text file; is it binary?")]
    NulByte,
    /// There is no vertex.
    #[error("the file has no vertices")]
    NoVertices,
    /// There is no face and no line.
    #[error("the file has {vertices} vertices, but no faces and no lines")]
    NoFaces {
        /// Number of vertices.
        vertices: usize,
    },
}

/// Shows what was found, or nothing.
struct Found<'a>(&'a str);

impl fmt::Display for Found<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() { Ok(()) } else { write!(f, " (found '{}')", self.0) }
    }
}

/// The first bytes of something, printable on one line.
pub(super) fn quote(bytes: &[u8]) -> String {
    let shown = &bytes[..bytes.len().min(QUOTED_BYTES)];
    let mut text = String::new();
    for c in String::from_utf8_lossy(shown).chars() {
        // A control character would break the line or move the cursor of a terminal.
        if c.is_control() { text.extend(c.escape_default()) } else { text.push(c) }
    }
    if shown.len() < bytes.len() {
        text.push('…');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_one_line_with_the_place() {
        let error = ReadError::Content {
            file: "a.obj".into(),
            place: Place::Line(7),
            problem: Problem::TooFewNumbers { got: 2, wanted: 3 },
            found: quote(b"v 1 2\x1b\n"),
        };
        assert_eq!(error.to_string(), "a.obj:7: too few numbers: 2 of 3 (found 'v 1 2\\u{1b}\\n')");
        let error = ReadError::Content {
            file: "a.stl".into(),
            place: Place::Offset(80),
            problem: Problem::CountExceedsFile { declared: 9, possible: 1 },
            found: String::new(),
        };
        let text = "a.stl: offset 0x50: 9 items are declared, but the file has room for at most 1";
        assert_eq!(error.to_string(), text);
    }

    #[test]
    fn a_quote_is_short_and_never_splits_the_message() {
        let text = quote(&[0xff; 500]);
        assert_eq!(text.chars().count(), QUOTED_BYTES + 1);
        assert_eq!(quote("é\u{7}".as_bytes()), "é\\u{7}");
    }
}
