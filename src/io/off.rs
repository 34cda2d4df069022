//! OFF, the object file format of Geomview, as text: `OFF`, optionally with colours, normals and
//! texture coordinates.

use nalgebra::Point3;

use super::MeshFile;
use super::cursor::{Cursor, count, integer};
use super::error::{ReadError, ReadProblem};
use super::surface::Surface;

/// Properties from the keyword at the start.
struct Keyword {
    /// Number of bytes of the keyword.
    length: usize,
    /// True if vertices do not have three coordinates.
    other_dimension: bool,
}

/// Finds `[ST][C][N][4][n]OFF` at the start of a word; counts can follow without a space.
fn keyword(word: &[u8]) -> Option<Keyword> {
    let mut rest = word;
    let mut strip = |prefix: &[u8]| match rest.strip_prefix(prefix) {
        Some(tail) => {
            rest = tail;
            true
        }
        None => false,
    };
    strip(b"ST");
    strip(b"C");
    strip(b"N");
    let four = strip(b"4");
    let any = strip(b"n");
    let is_off = strip(b"OFF");
    let counts = rest.iter().all(u8::is_ascii_digit);
    (is_off && counts).then_some(Keyword {
        length: word.len() - rest.len(),
        other_dimension: four || any,
    })
}

/// A line without its comment.
fn content(line: &[u8]) -> &[u8] {
    let end = line.iter().position(|&b| b == b'#').unwrap_or(line.len());
    line[..end].trim_ascii()
}

fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty())
}

/// The first word outside comments.
fn first_word(bytes: &[u8]) -> Option<&[u8]> {
    let mut cursor = Cursor::new("", bytes);
    while let Some(line) = cursor.next_line() {
        if let Some(word) = words(content(line)).next() {
            return Some(word);
        }
    }
    None
}

/// True if the first word is the keyword of OFF.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    first_word(bytes).is_some_and(|word| keyword(word).is_some())
}

/// True if the content can be OFF without its keyword.
pub(super) fn begins_with_a_count(bytes: &[u8]) -> bool {
    first_word(bytes).is_some_and(|word| word.iter().all(u8::is_ascii_digit))
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    surface: Surface,
}

/// Reads OFF: three coordinates per vertex and the corners of each face; the rest of a line is
/// skipped.
///
/// # Errors
/// Binary OFF and other dimensions, counts beyond the size of the file, a malformed number, an
/// index out of range.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut reader = Reader {
        cursor: Cursor::new(name, bytes),
        surface: Surface::default(),
    };
    let (vertices, faces) = reader.counts()?;
    for _ in 0..vertices {
        reader.vertex()?;
    }
    for _ in 0..faces {
        reader.face()?;
    }
    reader.surface.finish(&reader.cursor)
}

impl<'a> Reader<'a> {
    /// The next line that contains more than a comment.
    fn line(&mut self, what: &'static str) -> Result<&'a [u8], ReadError> {
        loop {
            match self.cursor.text_line()? {
                None => return Err(self.cursor.fail(ReadProblem::Truncated { what }, b"")),
                Some(line) if content(line).is_empty() => {}
                Some(line) => return Ok(content(line)),
            }
        }
    }

    /// The numbers of vertices and faces, after the keyword or on the next line.
    fn counts(&mut self) -> Result<(u64, u64), ReadError> {
        let mut line = self.line("the header")?;
        let first = words(line).next().unwrap_or_default();
        if let Some(keyword) = keyword(first) {
            let behind = line[keyword.length..].trim_ascii();
            if keyword.other_dimension {
                return Err(self.cursor.fail(
                    ReadProblem::Unsupported {
                        what: "OFF of another dimension than 3",
                    },
                    first,
                ));
            }
            if behind.starts_with(b"BINARY") {
                return Err(self
                    .cursor
                    .fail(ReadProblem::Unsupported { what: "binary OFF" }, behind));
            }
            line = if behind.is_empty() {
                self.line("the header")?
            } else {
                behind
            };
        }
        let mut words = words(line);
        let mut next = || {
            let word = words.next().unwrap_or_default();
            count(word, "the numbers of vertices and faces")
                .map_err(|problem| self.cursor.fail(problem, word))
        };
        let (vertices, faces) = (next()?, next()?);
        // A vertex takes at least six bytes, a face two; the last line needs no end.
        let room = self.cursor.rest().len() as u64 + 1;
        for (declared, possible) in [(vertices, room / 6), (faces, room / 2)] {
            if declared > possible {
                return Err(self
                    .cursor
                    .fail(ReadProblem::CountExceedsFile { declared, possible }, line));
            }
        }
        Ok((vertices, faces))
    }

    fn vertex(&mut self) -> Result<(), ReadError> {
        let line = self.line("the vertices")?;
        let mut words = words(line);
        let mut position = Point3::origin();
        for got in 0..3 {
            let Some(word) = words.next() else {
                return Err(self
                    .cursor
                    .fail(ReadProblem::TooFewNumbers { got, expected: 3 }, line));
            };
            let value = self.surface.coordinate(word, &|| self.cursor.place());
            position[got] = value.map_err(|problem| self.cursor.fail(problem, word))?;
        }
        self.surface.vertices.push(position);
        Ok(())
    }

    fn face(&mut self) -> Result<(), ReadError> {
        let line = self.line("the faces")?;
        let mut words = words(line);
        let first = words.next().unwrap_or_default();
        let count = count(first, "the number of corners of a face")
            .map_err(|problem| self.cursor.fail(problem, first))?;
        // A count beyond the range exceeds the line.
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        let mut corners = Vec::with_capacity(count.min(line.len() / 2));
        for word in words.by_ref().take(count) {
            let index = integer(word).and_then(|index| self.surface.index(index));
            corners.push(index.map_err(|problem| self.cursor.fail(problem, word))?);
        }
        if corners.len() < count {
            let problem = ReadProblem::TooFewNumbers {
                got: corners.len(),
                expected: count,
            };
            return Err(self.cursor.fail(problem, line));
        }
        match count {
            // Faces of one or two corners are points and edges, which other programs write beside a
            // surface.
            1 => Ok(()),
            2 => self.surface.line(&corners),
            _ => self.surface.polygon(&corners, &|| self.cursor.place()),
        }
        .map_err(|problem| self.cursor.fail(problem, line))
    }
}

#[cfg(test)]
mod tests {
    use crate::io::read_bytes;

    const TAIL: &str =
        "0 0 0\n1 0 0 # a corner\n\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n4 0 1 2 3\n2 0 2\n1 0\n";

    #[test]
    fn keywords_counts_colours_and_comments() {
        let plain = read_bytes(format!("OFF\n4 4 0\n{TAIL}").as_bytes(), "a.off").unwrap();
        assert_eq!(plain.mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
        assert_eq!(plain.lines, [[0, 2]]);
        for head in [
            "# hi\nOFF 4 4 0\n",
            "\t OFF4 4 0 # or nah\n",
            "STCNOFF\r\n# x\r\n4 4\r\n",
            "COFF\n\n4 4 0\n",
        ] {
            assert_eq!(
                read_bytes(format!("{head}{TAIL}").as_bytes(), "a").unwrap(),
                plain,
                "{head:?}"
            );
        }
        // Without the keyword only the file name decides on the format.
        assert_eq!(
            read_bytes(format!("4 4 0\n{TAIL}").as_bytes(), "a.off").unwrap(),
            plain
        );
        let extra = TAIL.replace(" 0\n", " 0 0.1 0.2 0.3 1\n");
        assert_eq!(
            read_bytes(format!("NOFF\n4 4 0\n{extra}").as_bytes(), "a")
                .unwrap()
                .mesh,
            plain.mesh
        );
    }

    #[test]
    fn errors_name_line_and_column() {
        let error = |text: &str| read_bytes(text.as_bytes(), "a").unwrap_err().terse();
        let last = |line: &str| error(&format!("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n{line}\n"));
        assert!(
            last("3 0 1 3").starts_with("a:6:7: error[E020]: vertex index 3"),
            "{}",
            last("3 0 1 3")
        );
        assert!(
            last("3 0 1").starts_with("a:6:1: error[E010]: too few numbers: 2 of 3"),
            "{}",
            last("3 0 1")
        );
        assert!(last("x 0 1").starts_with("a:6:1: error[E042]: expected the number of corners"));
        assert!(last("0").contains("too few corners"));
        assert!(last("").contains("E041"));
        assert!(error("OFF\n9 9").contains("a:2:1: error[E040]: 9 items are declared"));
        assert!(error("OFF BINARY\n").contains("binary OFF"));
        assert!(error("4OFF\n1 1 1\n").contains("another dimension"));
        assert!(error("OFF\n-1 2\n").contains("expected the numbers of vertices"));
        assert!(error("OFF\n1 1\n0 0,5 0\n").contains("a:3:3: error[E011]"));
        assert!(error("OFF\n1 0\n0 0\0 0\n").contains("E006"));
    }
}
