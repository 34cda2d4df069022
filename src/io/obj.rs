//! Wavefront OBJ: `v`, `f` and `l`; other statements contain no surface and are skipped.

use std::io::{self, Write};
use std::path::Path;

use nalgebra::Point3;

use super::MeshFile;
use super::cursor::{Cursor, MAX_LINE_BYTES, integer};
use super::error::{FilePlace, ReadError, ReadProblem};
use super::part::{check_mesh, write_whole};
use super::surface::Surface;
use crate::mesh::TriangleMesh;

/// First words of the lines of an OBJ file.
const KEYWORDS: [&[u8]; 13] = [
    b"v", b"vn", b"vt", b"vp", b"f", b"l", b"p", b"o", b"g", b"s", b"mtllib", b"usemtl", b"call",
];

/// True if the first line that is no comment begins with a keyword of OBJ.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let mut cursor = Cursor::new("", bytes);
    while let Some(line) = cursor.next_line() {
        match words(line).next() {
            None => {}
            Some(word) if word.starts_with(b"#") => {}
            Some(word) => return KEYWORDS.contains(&word),
        }
    }
    false
}

/// Reads an OBJ file; indices count from 1, or backwards from the last vertex if negative.
///
/// A positive index can refer to a later vertex; colours and weights after the coordinates are
/// skipped.
///
/// # Errors
/// A malformed number, an index out of range, a face of fewer than three corners, a file without faces and lines.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let (cursor, surface) = (Cursor::new(name, bytes), Surface::default());
    let mut reader = Reader {
        cursor,
        surface,
        place: FilePlace::Whole,
        pending: Vec::new(),
    };
    let mut joined = Vec::new();
    while let Some(first) = reader.cursor.text_line()? {
        reader.place = reader.cursor.place();
        let line = match first.trim_ascii_end().strip_suffix(b"\\") {
            None => first,
            Some(begin) => {
                joined.clear();
                joined.extend_from_slice(begin);
                continue_line(&mut reader.cursor, first, &mut joined)?;
                &joined
            }
        };
        reader
            .statement(line)
            .map_err(|(problem, found)| reader.cursor.fail_at(reader.place, problem, found))?;
    }
    reader.check_pending()?;
    reader.surface.finish(&reader.cursor)
}

/// Writes a mesh and polylines through `NAME.part`; each number is the shortest text that gives the
/// same double.
///
/// # Errors
/// A coordinate that is not finite, an index out of range, a polyline of fewer than two vertices,
/// and errors of the operating system.
pub fn write(path: &Path, mesh: &TriangleMesh, lines: &[Vec<u32>]) -> io::Result<()> {
    check_mesh(mesh, lines)?;
    write_whole(path, |w| {
        for v in &mesh.vertices {
            writeln!(w, "v {:?} {:?} {:?}", v.x, v.y, v.z)?;
        }
        for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|i| u64::from(i) + 1)) {
            writeln!(w, "f {a} {b} {c}")?;
        }
        for line in lines {
            write!(w, "l")?;
            line.iter()
                .try_for_each(|&i| write!(w, " {}", u64::from(i) + 1))?;
            writeln!(w)?;
        }
        Ok(())
    })
}

/// Appends the lines that continue a line after a backslash.
fn continue_line<'a>(
    cursor: &mut Cursor<'a>,
    first: &'a [u8],
    joined: &mut Vec<u8>,
) -> Result<(), ReadError> {
    let (mut last, start) = (first, cursor.place());
    loop {
        let place = cursor.place();
        let Some(next) = cursor.text_line()? else {
            let backslash = &last[last.trim_ascii_end().len() - 1..];
            return Err(cursor.fail_at(place, ReadProblem::UnfinishedLine, &backslash[..1]));
        };
        let (bytes, limit) = (joined.len() + next.len() + 1, MAX_LINE_BYTES);
        if bytes > limit {
            return Err(cursor.fail_at(start, ReadProblem::LineTooLong { bytes, limit }, first));
        }
        joined.push(b' ');
        match next.trim_ascii_end().strip_suffix(b"\\") {
            Some(more) => joined.extend_from_slice(more),
            None => {
                joined.extend_from_slice(next);
                return Ok(());
            }
        }
        last = next;
    }
}

fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty())
}

/// The problem of a statement, and the words to quote.
type Complaint<'w> = (ReadProblem, &'w [u8]);

struct Reader<'a> {
    cursor: Cursor<'a>,
    surface: Surface,
    /// Start of the current statement.
    place: FilePlace,
    /// Indices of vertices that follow later in the file, with the place.
    pending: Vec<(FilePlace, i64)>,
}

impl Reader<'_> {
    fn statement<'w>(&mut self, line: &'w [u8]) -> Result<(), Complaint<'w>> {
        let mut words = words(line);
        match words.next() {
            Some(b"v") => self.vertex(words, line),
            Some(b"f") => {
                let corners = self.corners(words)?;
                self.surface
                    .polygon(&corners, &|| self.place)
                    .map_err(|problem| (problem, line))
            }
            Some(b"l") => {
                let corners = self.corners(words)?;
                self.surface
                    .line(&corners)
                    .map_err(|problem| (problem, line))
            }
            _ => Ok(()),
        }
    }

    fn vertex<'w>(
        &mut self,
        mut words: impl Iterator<Item = &'w [u8]>,
        line: &'w [u8],
    ) -> Result<(), Complaint<'w>> {
        let mut position = Point3::origin();
        for got in 0..3 {
            let Some(word) = words.next().filter(|word| !word.starts_with(b"#")) else {
                return Err((ReadProblem::TooFewNumbers { got, expected: 3 }, line));
            };
            position[got] = self
                .surface
                .coordinate(word, &|| self.place)
                .map_err(|problem| (problem, word))?;
        }
        self.surface.vertices.push(position);
        Ok(())
    }

    fn corners<'w>(
        &mut self,
        words: impl Iterator<Item = &'w [u8]>,
    ) -> Result<Vec<u32>, Complaint<'w>> {
        words
            .take_while(|word| !word.starts_with(b"#"))
            .map(|word| self.corner(word).map_err(|problem| (problem, word)))
            .collect()
    }

    /// A corner is `v`, `v/t`, `v//n` or `v/t/n`; only `v` is used.
    fn corner(&mut self, word: &[u8]) -> Result<u32, ReadProblem> {
        let mut parts = word.split(|&b| b == b'/');
        let index = integer(parts.next().unwrap_or_default()).map_err(|problem| match problem {
            ReadProblem::IntegerTooLarge => problem,
            _ => ReadProblem::BadCorner,
        })?;
        let (texture, normal, more) = (parts.next(), parts.next(), parts.next());
        let is_index = |part: Option<&[u8]>| part.is_some_and(|part| integer(part).is_ok());
        // Exporters write `1/2/` and `1//` for a missing normal; `1/` is a truncated corner.
        let complete = match (texture, normal) {
            (None, _) | (Some(b""), Some(b"")) => true,
            (Some(b""), normal) => is_index(normal),
            (texture, None | Some(b"")) => is_index(texture),
            (texture, normal) => is_index(texture) && is_index(normal),
        };
        if !complete || more.is_some() {
            return Err(ReadProblem::BadCorner);
        }
        let count = self.surface.vertices.len();
        let out_of_range = ReadProblem::IndexOutOfRange {
            index,
            count,
            from_one: true,
        };
        match index {
            0 => Err(ReadProblem::ZeroIndex),
            1.. => {
                let from_zero = u32::try_from(index - 1).map_err(|_| out_of_range)?;
                // Of several future indices the largest decides; the first of equal ones represents
                // the others.
                if from_zero as usize >= count
                    && self
                        .pending
                        .last()
                        .is_none_or(|&(_, largest)| index > largest)
                {
                    self.pending.push((self.place, index));
                }
                Ok(from_zero)
            }
            _ => {
                let from_zero = i64::try_from(count).ok().and_then(|n| n.checked_add(index));
                from_zero
                    .and_then(|i| u32::try_from(i).ok())
                    .ok_or(ReadProblem::BeforeFirst { index, count })
            }
        }
    }

    fn check_pending(&self) -> Result<(), ReadError> {
        let count = self.surface.vertices.len();
        match self
            .pending
            .iter()
            .find(|&&(_, index)| index > count as i64)
        {
            None => Ok(()),
            Some(&(place, index)) => {
                let problem = ReadProblem::IndexOutOfRange {
                    index,
                    count,
                    from_one: true,
                };
                Err(self
                    .cursor
                    .fail_at(place, problem, index.to_string().as_bytes()))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Warning;

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

    fn error(tail: &str) -> String {
        read(format!("{TRIANGLE}{tail}").as_bytes(), "a.obj")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn faces_lines_negative_and_forward_indices() {
        let text = "f 4 1 2 # forward\nv 0 0 0 1 0 0\nv 1 0 0\r\nv 0 1 0\rv 0 0 1\nf -4/1/ -3//2 \\\n -2/1/1 -1\nl 1/1 2\n";
        let file = read(text.as_bytes(), "").unwrap();
        assert_eq!(file.mesh.triangles, [[3, 0, 1], [0, 1, 2], [0, 2, 3]]);
        assert_eq!(file.lines, [[0, 1]]);
        assert_eq!(file.mesh.vertices.len(), 4);
    }

    #[test]
    fn errors_name_the_line() {
        let count = "there are 3 vertices, counted from 1";
        assert_eq!(
            error("f 0 1 2"),
            "a.obj:4: vertex index 0, but OBJ counts from 1 (found '0')"
        );
        assert_eq!(
            error("\nf 1 2"),
            "a.obj:5: too few corners: 2, at least 3 are needed (found 'f 1 2')"
        );
        assert_eq!(
            error("f 1 2 99"),
            format!("a.obj:4: vertex index 99 is out of range: {count} (found '99')")
        );
        assert_eq!(
            error("f 1 2 4"),
            format!("a.obj:4: vertex index 4 is out of range: {count} (found '4')")
        );
        assert_eq!(
            error("f -4 1 2"),
            "a.obj:4: vertex index -4 is out of range: 3 vertices stand before it (found '-4')"
        );
        assert!(error("f 99999999999 1 2").contains("out of range"));
        assert!(error("f 99999999999999999999 1 2").contains("63 bits"));
        assert!(error("f -9223372036854775808 1 2").contains("out of range"));
        assert!(error("f 1/1/1/1 2 3").contains("expected a corner"));
        assert!(error("f 1/x 2 3").contains("expected a corner"));
        for corner in ["1/", "1//2/", "1/ /", "//1", "1///", "x", "1.0", "//", "/"] {
            let text = error(&format!("f {corner} 2 3"));
            assert!(
                text.starts_with("a.obj:4: expected a corner such as "),
                "{text}"
            );
        }
        assert!(error("l 1").contains("too few corners: 1, at least 2"));
        assert_eq!(
            error("v 1 2"),
            "a.obj:4: too few numbers: 2 of 3 (found 'v 1 2')"
        );
        assert_eq!(
            error("v 1,5 2 3"),
            "a.obj:4: not a number; decimal comma? Write a point (found '1,5')"
        );
        assert_eq!(
            error("v nan 0 0"),
            "a.obj:4: vertex 3 has a coordinate that is not finite (found 'nan')"
        );
        assert_eq!(
            error("v 1e400 0 0"),
            "a.obj:4: vertex 3 has a coordinate that is too large for a double (found '1e400')"
        );
        let unfinished = "the file ends too early, in a line that ends in a backslash (found '\\')";
        assert_eq!(error("f 1 2 \\"), format!("a.obj:4: {unfinished}"));
        assert_eq!(error("f 1 \\\n2 \\ \n"), format!("a.obj:5: {unfinished}"));
        assert!(error("g \0").contains("NUL byte"));
    }

    #[test]
    fn every_truncation_is_an_error_or_a_mesh() {
        let text = format!("{TRIANGLE}v 1 1 1\nf 1 2 3\nf 2 4 3 1\nl 1 2 3 4\n");
        for length in 0..text.len() {
            let file = crate::io::read_bytes(&text.as_bytes()[..length], "a.obj");
            if let Ok(MeshFile { mesh, .. }) = file {
                crate::mesh::TriangleMesh::new(mesh.vertices, mesh.triangles).unwrap();
            }
        }
    }

    #[test]
    fn a_repeated_corner_is_left_out_and_counted() {
        let file = read(format!("{TRIANGLE}f 1 1 2\nf 1 2 3").as_bytes(), "").unwrap();
        assert_eq!(
            (
                file.mesh.triangles.len(),
                file.warnings.count(Warning::RepeatedCorner)
            ),
            (1, 1)
        );
    }

    #[test]
    fn an_empty_normal_is_none() {
        let file = read(
            format!("{TRIANGLE}f 1// 2// 3//\nf 1/1/ 2/1/ 3//1").as_bytes(),
            "",
        )
        .unwrap();
        assert_eq!(file.mesh.triangles, [[0, 1, 2]; 2]);
        assert!(file.warnings.is_empty());
    }

    #[test]
    fn lines_are_at_most_a_mebibyte_also_when_joined() {
        let long =
            |begin: &str, more: usize| format!("{TRIANGLE}{begin}{}\nf 1 2 3\n", " ".repeat(more));
        assert!(read(long("#", (1 << 20) - 1).as_bytes(), "").is_ok());
        let error = |text: String| read(text.as_bytes(), "a").unwrap_err().terse();
        let expected = "a:4:1: error[E007]: the line has 1048577 bytes, more than the limit of 1048576 (found '#";
        assert!(
            error(long("#", 1 << 20)).starts_with(expected),
            "{}",
            error(long("#", 1 << 20))
        );
        let joined = error(format!(
            "{TRIANGLE}f 1 2{}",
            " \\\n 3 3 3 3".repeat(1 << 18)
        ));
        assert!(joined.contains("error[E007]"), "{joined}");
    }

    #[test]
    fn what_is_accepted_is_counted_with_its_first_line() {
        let text = "v 0 0 0\nv 1 0 -1e-400\nv 1 1 0.5\nf 1 2 3 4\nv 0 1 0e-400\nf -4 -3 -2 \\\n -1\nf 1 2 2 3\nf 1 3 2\n";
        let file = read(text.as_bytes(), "").unwrap();
        let lines: Vec<String> = file.warnings.iter().map(|w| w.terse("a")).collect();
        let fan = "are not flat or not convex: their split is a fan around the first corner";
        let expected = [
            "a:2: warning[W001]: 1 coordinate too small for a double became 0".to_owned(),
            format!("a:4: warning[W002]: 2 polygons {fan}"),
            "a:8: warning[W003]: 1 triangle that names a vertex twice was left out".to_owned(),
        ];
        assert_eq!(lines, expected);
        assert_eq!(
            (file.mesh.triangles.len(), file.mesh.vertices[1].z.to_bits()),
            (6, (-0.0f64).to_bits())
        );
    }
}
