//! Errors of mesh readers, with the place in the file.

use std::fmt;

use super::Format;
use super::formats::readable;

/// Greatest number of bytes of a file that an error message quotes.
const QUOTED_BYTES: usize = 64;

/// The text of [`ReadProblem::Expected`] for a word that is no number.
pub(super) const A_NUMBER: &str = "a number";

/// Error of a mesh reader; its text is one line, `path:line: message (found '...')`.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system could not read the file.
    #[error("{file}: cannot be read: {source}")]
    Io {
        /// The file name as given by the caller.
        file: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The content is no usable mesh.
    #[error("{file}:{place} {problem}{}{}", Within(.within), Found(.found))]
    Content {
        /// The file name as given by the caller.
        file: Box<str>,
        /// Place in the file.
        place: FilePlace,
        /// Column in a line of text, in characters from 1, if known.
        column: Option<u32>,
        /// The format of the content if the file name has that of another one.
        read_as: Option<Format>,
        /// The problem.
        problem: ReadProblem,
        /// The part of the file, such as an array of VTK XML, if the place alone is not enough;
        /// otherwise empty.
        within: Box<str>,
        /// The bytes found there, at most 64, in printable form; empty if there are none.
        found: Box<str>,
    },
}

impl ReadError {
    /// Code, place with column, problem and help, on one line:
    /// `file:line:column: error[E011]: what (found '...'); help`, or `file: offset 0xNN: error[...` in binary data.
    pub fn terse(&self) -> String {
        match self {
            ReadError::Io { file, source } => {
                format!(
                    "{file}: error[{}]: cannot be read: {source}; {}",
                    self.code(),
                    self.help()
                )
            }
            ReadError::Content {
                file,
                place,
                column,
                read_as,
                problem,
                within,
                found,
            } => {
                let at = placed(file, place, *column);
                let read_as = ReadAs(*read_as);
                let (within, found) = (Within(within), Found(found));
                format!(
                    "{at} error[{}]: {problem}{within}{found}{read_as}; {}",
                    self.code(),
                    self.help()
                )
            }
        }
    }

    /// The code of the problem, as in `docs/formats.md`.
    pub fn code(&self) -> &'static str {
        match self {
            ReadError::Io { .. } => "E060",
            ReadError::Content { problem, .. } => problem.code(),
        }
    }

    /// The problem without its place and the bytes found there, for a message that shows both.
    pub fn message(&self) -> String {
        match self {
            ReadError::Io { .. } => self.to_string(),
            ReadError::Content {
                problem,
                within,
                read_as,
                ..
            } => {
                format!("{problem}{}{}", Within(within), ReadAs(*read_as))
            }
        }
    }

    /// Advice for the user.
    pub fn help(&self) -> &'static str {
        match self {
            ReadError::Io { .. } => "check the path and whether you may read it",
            ReadError::Content { problem, .. } => problem.help(),
        }
    }

    /// Records that the file name has the extension of another format.
    pub(super) fn with_format(mut self, format: Format) -> Self {
        if let ReadError::Content { read_as, .. } = &mut self {
            *read_as = Some(format);
        }
        self
    }

    /// Names the part of the file with the error.
    pub(super) fn within(mut self, part: String) -> Self {
        if let ReadError::Content { within, .. } = &mut self {
            *within = part.into();
        }
        self
    }
}

/// A place in a file; earlier places come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FilePlace {
    /// The file as a whole.
    Whole,
    /// A line of text, counted from 1.
    Line(usize),
    /// Offset in bytes, for binary data.
    Offset(usize),
}

impl fmt::Display for FilePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FilePlace::Whole => Ok(()),
            FilePlace::Line(line) => write!(f, "{line}:"),
            FilePlace::Offset(offset) => write!(f, " offset {offset:#x}:"),
        }
    }
}

/// The file and a place in it, the start of every message: `file:line:column:` or
/// `file: offset 0xNN:`.
pub(super) fn placed(file: &str, place: &FilePlace, column: Option<u32>) -> String {
    let column = column.map_or_else(String::new, |column| format!("{column}:"));
    format!("{file}:{place}{column}")
}

/// Kinds of errors in a mesh file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadProblem {
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
    /// The first bytes belong to no readable format.
    #[error("unknown format; {}", readable())]
    UnknownFormat,
    /// The format or its variant is known, but not supported.
    #[error("{what}: format not supported yet; {}", readable())]
    Unsupported {
        /// The format or variant.
        what: &'static str,
    },
    /// Another item is expected here.
    #[error("expected {what}")]
    Expected {
        /// The expected item.
        what: &'static str,
    },
    /// The file contains no surface, or none with straight edges.
    #[error("expected {what}")]
    NoSurface {
        /// The readable content.
        what: &'static str,
    },
    /// A number is missing.
    #[error("too few numbers: {got} of {expected}")]
    TooFewNumbers {
        /// Number found.
        got: usize,
        /// Number needed.
        expected: usize,
    },
    /// A number has a decimal comma.
    #[error("not a number; decimal comma? Write a point")]
    DecimalComma,
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// Index of the vertex, from 0.
        vertex: usize,
    },
    /// A coordinate is too large for a double.
    #[error("vertex {vertex} has a coordinate that is too large for a double")]
    Overflow {
        /// Index of the vertex, from 0.
        vertex: usize,
    },
    /// A zero where indices start at 1.
    #[error("vertex index 0, but OBJ counts from 1")]
    ZeroIndex,
    /// An index of a vertex that does not exist.
    #[error("vertex index {index} is out of range: there are {count} vertices{}", if *.from_one { ", counted from 1" } else { "" })]
    IndexOutOfRange {
        /// The index as written.
        index: i64,
        /// Number of vertices.
        count: usize,
        /// True if the format counts from 1.
        from_one: bool,
    },
    /// A negative index before the first vertex.
    #[error("vertex index {index} is out of range: {count} vertices stand before it")]
    BeforeFirst {
        /// The index as written.
        index: i64,
        /// Number of vertices before it.
        count: usize,
    },
    /// An integer beyond signed 64 bits.
    #[error("a whole number of more than 63 bits")]
    IntegerTooLarge,
    /// An invalid corner of OBJ.
    #[error("expected a corner such as 1, 1/2, 1//3 or 1/2/3")]
    BadCorner,
    /// A polygon has too many corners for a useful fan.
    #[error("too many corners: {got}, at most {limit} are read")]
    TooManyCorners {
        /// Number found.
        got: usize,
        /// The limit.
        limit: usize,
    },
    /// A face has fewer than three corners, or a line fewer than two.
    #[error("too few corners: {got}, at least {expected} are needed")]
    TooFewCorners {
        /// Number found.
        got: usize,
        /// Number needed.
        expected: usize,
    },
    /// A count exceeds the size of the file.
    #[error("{declared} items are declared, but the file has room for at most {possible}")]
    CountExceedsFile {
        /// The count as declared.
        declared: u64,
        /// Greatest count that fits into the rest of the file.
        possible: u64,
    },
    /// The file ends too early.
    #[error("the file ends too early, in {what}")]
    Truncated {
        /// The item being read.
        what: &'static str,
    },
    /// Two counts of the file contradict each other.
    #[error("{what} does not fit: {declared} declared, {used} used")]
    SizeMismatch {
        /// The counted items.
        what: &'static str,
        /// The declared count.
        declared: u64,
        /// The count found.
        used: u64,
    },
    /// A line of text is too long.
    #[error("the line has {bytes} bytes, more than the limit of {limit}")]
    LineTooLong {
        /// Length of the line [bytes].
        bytes: usize,
        /// The limit [bytes].
        limit: usize,
    },
    /// The file ends after a backslash that continues a line.
    #[error("the file ends too early, in a line that ends in a backslash")]
    UnfinishedLine,
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

impl ReadProblem {
    /// The code, equal for all problems of one kind.
    pub fn code(&self) -> &'static str {
        match self {
            ReadProblem::Empty => "E001",
            ReadProblem::NoVertices => "E002",
            ReadProblem::UnknownFormat => "E003",
            ReadProblem::Utf16 => "E005",
            ReadProblem::NulByte => "E006",
            ReadProblem::LineTooLong { .. } => "E007",
            ReadProblem::UnfinishedLine => "E008",
            ReadProblem::TooFewNumbers { .. } => "E010",
            ReadProblem::DecimalComma => "E011",
            ReadProblem::Expected { what } if *what == A_NUMBER => "E011",
            ReadProblem::NotFinite { .. } => "E012",
            ReadProblem::Overflow { .. } => "E013",
            ReadProblem::IndexOutOfRange { .. } => "E020",
            ReadProblem::ZeroIndex => "E021",
            ReadProblem::BeforeFirst { .. } => "E022",
            ReadProblem::IntegerTooLarge => "E023",
            ReadProblem::TooFewCorners { .. } => "E024",
            ReadProblem::BadCorner => "E025",
            ReadProblem::TooManyCorners { .. } => "E026",
            ReadProblem::CountExceedsFile { .. } => "E040",
            ReadProblem::Truncated { .. } => "E041",
            ReadProblem::Expected { .. } | ReadProblem::NoSurface { .. } => "E042",
            ReadProblem::SizeMismatch { .. } => "E043",
            ReadProblem::TooLarge { .. } => "E044",
            ReadProblem::Unsupported { .. } => "E045",
            ReadProblem::NoFaces { .. } => "E046",
        }
    }

    /// Advice for the user.
    pub fn help(&self) -> &'static str {
        match self {
            ReadProblem::Empty
            | ReadProblem::TooFewNumbers { .. }
            | ReadProblem::CountExceedsFile { .. }
            | ReadProblem::Truncated { .. }
            | ReadProblem::UnfinishedLine
            | ReadProblem::SizeMismatch { .. } => {
                "the file is cut off or damaged: copy or export it again"
            }
            ReadProblem::NoSurface { .. } => {
                "extract its surface where it was made, and read that; it is not guessed here"
            }
            ReadProblem::Expected { .. } => {
                "the file is cut off, damaged or of another dialect: export it again"
            }
            ReadProblem::DecimalComma => "export the file with the decimal point of the C locale",
            ReadProblem::NotFinite { .. }
            | ReadProblem::Overflow { .. }
            | ReadProblem::ZeroIndex
            | ReadProblem::BeforeFirst { .. }
            | ReadProblem::IntegerTooLarge
            | ReadProblem::IndexOutOfRange { .. }
            | ReadProblem::TooFewCorners { .. }
            | ReadProblem::BadCorner
            | ReadProblem::NulByte => "correct it there, or export the file again",
            ReadProblem::NoVertices | ReadProblem::NoFaces { .. } => {
                "export the surface with its triangles"
            }
            ReadProblem::TooManyCorners { .. } => "split the polygon where it was made",
            ReadProblem::LineTooLong { .. } => {
                "one statement of a mesh needs no such line: is the file damaged, or another kind of file?"
            }
            ReadProblem::TooLarge { .. } => "simplify the mesh first",
            ReadProblem::Utf16 => "save the text as UTF-8",
            ReadProblem::UnknownFormat | ReadProblem::Unsupported { .. } => {
                "convert it to one of the formats that can be read"
            }
        }
    }
}

/// Displays the bytes found, or nothing.
struct Found<'a>(&'a str);

impl fmt::Display for Found<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            Ok(())
        } else {
            write!(f, " (found '{}')", self.0)
        }
    }
}

/// Displays the part of the file, or nothing.
struct Within<'a>(&'a str);

impl fmt::Display for Within<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            Ok(())
        } else {
            write!(f, ", in {}", self.0)
        }
    }
}

/// Displays the format of the content if the file name has that of another one.
struct ReadAs(Option<Format>);

impl fmt::Display for ReadAs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(format) => write!(
                f,
                "; the content is {}, whatever the name says",
                format.name()
            ),
            None => Ok(()),
        }
    }
}

/// The first bytes in printable form on one line.
pub(super) fn quote(bytes: &[u8]) -> String {
    let shown = &bytes[..bytes.len().min(QUOTED_BYTES)];
    let mut text = String::new();
    for c in String::from_utf8_lossy(shown).chars() {
        // A control character would break the line or move the cursor of a terminal.
        if c.is_control() {
            text.extend(c.escape_default())
        } else {
            text.push(c)
        }
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
            place: FilePlace::Line(7),
            column: Some(3),
            read_as: None,
            problem: ReadProblem::TooFewNumbers {
                got: 2,
                expected: 3,
            },
            within: "".into(),
            found: quote(b"v 1 2\x1b\n").into(),
        };
        assert_eq!(
            error.to_string(),
            "a.obj:7: too few numbers: 2 of 3 (found 'v 1 2\\u{1b}\\n')"
        );
        let terse = "a.obj:7:3: error[E010]: too few numbers: 2 of 3 (found 'v 1 2\\u{1b}\\n'); \
            the file is cut off or damaged: copy or export it again";
        assert_eq!(error.terse(), terse);
        let error = ReadError::Content {
            file: "a.stl".into(),
            place: FilePlace::Offset(80),
            column: None,
            read_as: Some(Format::Obj),
            problem: ReadProblem::CountExceedsFile {
                declared: 9,
                possible: 1,
            },
            within: "".into(),
            found: "".into(),
        };
        let text = "a.stl: offset 0x50: 9 items are declared, but the file has room for at most 1";
        assert_eq!(error.to_string(), text);
        assert!(
            error
                .terse()
                .starts_with("a.stl: offset 0x50: error[E040]: 9 items"),
            "{}",
            error.terse()
        );
        assert!(
            error
                .terse()
                .contains("; the content is OBJ, whatever the name says; the file is cut off")
        );
    }

    #[test]
    fn a_message_has_no_place_and_no_quote() {
        let content = ReadError::Content {
            file: "a.vtp".into(),
            place: FilePlace::Line(7),
            column: Some(3),
            read_as: None,
            problem: ReadProblem::DecimalComma,
            within: "".into(),
            found: "1,5".into(),
        };
        let content = content
            .within("the array of Points of piece 1".into())
            .with_format(Format::Vtp);
        let message = "not a number; decimal comma? Write a point, in the array of Points of piece 1; \
            the content is VTK XML, whatever the name says";
        assert_eq!(content.message(), message);
        let io = || ReadError::Io {
            file: "a.obj".into(),
            source: std::io::Error::other("no"),
        };
        assert_eq!(io().message(), "a.obj: cannot be read: no");
        let terse =
            "a.obj: error[E060]: cannot be read: no; check the path and whether you may read it";
        assert_eq!(io().terse(), terse);
        // An error of the operating system has no format and no part of a file.
        assert_eq!(
            io().with_format(Format::Obj).within("x".into()).terse(),
            terse
        );
    }

    #[test]
    fn a_quote_is_short_and_never_splits_the_message() {
        let text = quote(&[0xff; 500]);
        assert_eq!(text.chars().count(), QUOTED_BYTES + 1);
        assert_eq!(quote("é\u{7}".as_bytes()), "é\\u{7}");
    }
}
