//! What can go wrong while a mesh file is read, with the place in the file.

use std::fmt;

use super::Format;
use super::formats::readable;

/// The most bytes of a file that an error message quotes.
const QUOTED_BYTES: usize = 64;

/// What [`Problem::Expected`] says where a text holds something that is no number.
pub(super) const A_NUMBER: &str = "a number";

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
    #[error("{file}:{place} {problem}{}{}", Within(.within), Found(.found))]
    Content {
        /// The file, as it was named by the caller.
        file: Box<str>,
        /// Where in the file.
        place: Place,
        /// The column in a line of text, counted from 1 in characters, where the item is known to stand there.
        column: Option<u32>,
        /// The format that the content has, where the name of the file says another one.
        read_as: Option<Format>,
        /// What is wrong, or what was expected.
        problem: Problem,
        /// The part of the file, such as an array of VTK XML, where the place alone does not tell; else empty.
        within: Box<str>,
        /// What stands there, at most 64 bytes of the file, made printable; empty where nothing does.
        found: Box<str>,
    },
}

impl ReadError {
    /// The code, the place with its column, what is wrong and what to do about it, on one line:
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

    /// What is wrong, without the place and what was found there: for a message that shows both.
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

    /// What to do about it.
    pub fn help(&self) -> &'static str {
        match self {
            ReadError::Io { .. } => "check the path and whether you may read it",
            ReadError::Content { problem, .. } => problem.help(),
        }
    }

    /// Notes that the name of the file says another format than the content has.
    pub(super) fn with_format(mut self, format: Format) -> Self {
        if let ReadError::Content { read_as, .. } = &mut self {
            *read_as = Some(format);
        }
        self
    }

    /// Names the part of the file that the error is in.
    pub(super) fn within(mut self, part: String) -> Self {
        if let ReadError::Content { within, .. } = &mut self {
            *within = part.into();
        }
        self
    }
}

/// A place in a file; earlier places come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
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

/// The file and a place in it, as every message begins: `file:line:column:` or `file: offset 0xNN:`.
pub(super) fn placed(file: &str, place: &Place, column: Option<u32>) -> String {
    let column = column.map_or_else(String::new, |column| format!("{column}:"));
    format!("{file}:{place}{column}")
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
    #[error("unknown format; {}", readable())]
    UnknownFormat,
    /// The format or the variant of it is known, but not read.
    #[error("{what}: format not supported yet; {}", readable())]
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
    /// What the file holds is no surface, or none with straight edges.
    #[error("expected {what}")]
    NoSurface {
        /// What can be read.
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
    /// An index that counts backwards and reaches further than to the first vertex.
    #[error("vertex index {index} is out of range: {count} vertices stand before it")]
    BeforeFirst {
        /// The index as written.
        index: i64,
        /// Number of vertices before it.
        count: usize,
    },
    /// A whole number that 64 bits with a sign do not hold.
    #[error("a whole number of more than 63 bits")]
    IntegerTooLarge,
    /// A corner of OBJ that is none.
    #[error("expected a corner such as 1, 1/2, 1//3 or 1/2/3")]
    BadCorner,
    /// A polygon of so many corners that its fan would be of no use.
    #[error("too many corners: {got}, at most {limit} are read")]
    TooManyCorners {
        /// How many were found.
        got: usize,
        /// The limit.
        limit: usize,
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
    /// A line of text too long to be one.
    #[error("the line has {bytes} bytes, more than the limit of {limit}")]
    LineTooLong {
        /// Length of the line [bytes].
        bytes: usize,
        /// The limit [bytes].
        limit: usize,
    },
    /// The file ends where a backslash says that the line goes on.
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

impl Problem {
    /// The code, the same for each problem of one kind.
    pub fn code(&self) -> &'static str {
        match self {
            Problem::Empty => "E001",
            Problem::NoVertices => "E002",
            Problem::UnknownFormat => "E003",
            Problem::Utf16 => "E005",
            Problem::NulByte => "E006",
            Problem::LineTooLong { .. } => "E007",
            Problem::UnfinishedLine => "E008",
            Problem::TooFewNumbers { .. } => "E010",
            Problem::DecimalComma => "E011",
            Problem::Expected { what } if *what == A_NUMBER => "E011",
            Problem::NotFinite { .. } => "E012",
            Problem::Overflow { .. } => "E013",
            Problem::IndexOutOfRange { .. } => "E020",
            Problem::ZeroIndex => "E021",
            Problem::BeforeFirst { .. } => "E022",
            Problem::IntegerTooLarge => "E023",
            Problem::TooFewCorners { .. } => "E024",
            Problem::BadCorner => "E025",
            Problem::TooManyCorners { .. } => "E026",
            Problem::CountExceedsFile { .. } => "E040",
            Problem::Truncated { .. } => "E041",
            Problem::Expected { .. } | Problem::NoSurface { .. } => "E042",
            Problem::SizeMismatch { .. } => "E043",
            Problem::TooLarge { .. } => "E044",
            Problem::Unsupported { .. } => "E045",
            Problem::NoFaces { .. } => "E046",
        }
    }

    /// What to do about it.
    pub fn help(&self) -> &'static str {
        match self {
            Problem::Empty
            | Problem::TooFewNumbers { .. }
            | Problem::CountExceedsFile { .. }
            | Problem::Truncated { .. }
            | Problem::UnfinishedLine
            | Problem::SizeMismatch { .. } => {
                "the file is cut off or damaged: copy or export it again"
            }
            Problem::NoSurface { .. } => {
                "extract its surface where it was made, and read that; it is not guessed here"
            }
            Problem::Expected { .. } => {
                "the file is cut off, damaged or of another dialect: export it again"
            }
            Problem::DecimalComma => "export the file with the decimal point of the C locale",
            Problem::NotFinite { .. }
            | Problem::Overflow { .. }
            | Problem::ZeroIndex
            | Problem::BeforeFirst { .. }
            | Problem::IntegerTooLarge
            | Problem::IndexOutOfRange { .. }
            | Problem::TooFewCorners { .. }
            | Problem::BadCorner
            | Problem::NulByte => "correct it there, or export the file again",
            Problem::NoVertices | Problem::NoFaces { .. } => {
                "export the surface with its triangles"
            }
            Problem::TooManyCorners { .. } => "split the polygon where it was made",
            Problem::LineTooLong { .. } => {
                "one statement of a mesh needs no such line: is the file damaged, or another kind of file?"
            }
            Problem::TooLarge { .. } => "simplify the mesh first",
            Problem::Utf16 => "save the text as UTF-8",
            Problem::UnknownFormat | Problem::Unsupported { .. } => {
                "convert it to one of the formats that can be read"
            }
        }
    }
}

/// Shows what was found, or nothing.
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

/// Shows the part of the file, or nothing.
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

/// Says what the content is, where the name says something else.
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

/// The first bytes of something, printable on one line.
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
            place: Place::Line(7),
            column: Some(3),
            read_as: None,
            problem: Problem::TooFewNumbers { got: 2, wanted: 3 },
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
            place: Place::Offset(80),
            column: None,
            read_as: Some(Format::Obj),
            problem: Problem::CountExceedsFile {
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
            place: Place::Line(7),
            column: Some(3),
            read_as: None,
            problem: Problem::DecimalComma,
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
        // The operating system knows no format and no part of a file.
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
