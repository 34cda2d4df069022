//! The thesis's text format of spring systems: points, triangles of the surface, springs, fibres, attachment areas.
//!
//! Numbers have no unit. Indices start at 0, which the thesis does not state (errata M23). The rest
//! length of a spring is the distance of its ends in the file.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

use nalgebra::Point3;

use super::hooke::{Hooke, Springs};
use super::spring_set::PairError;
use crate::io::cursor::{Cursor, coordinate, count, integer, number};
use crate::io::{FilePlace, MAX_FILE_BYTES, ReadError, ReadProblem, write_whole};

/// Content of a file in the thesis's format.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SpringFile {
    /// Positions, in the unit of the file.
    pub position: Vec<Point3<f64>>,
    /// True for each point of the surface (`m`), false for an inner one (`i`).
    pub surface: Vec<bool>,
    /// Triangles of the surface.
    pub triangles: Vec<[u32; 3]>,
    /// Springs with their stiffness, in file order.
    pub springs: Vec<([u32; 2], f64)>,
    /// Segments of fibres.
    pub fibres: Vec<[u32; 2]>,
    /// Points of the origin area.
    pub origin: Vec<u32>,
    /// Points of the insertion area.
    pub insertion: Vec<u32>,
    /// Warnings about accepted contradictions.
    pub notes: Vec<String>,
}

impl SpringFile {
    /// The springs, at rest in the positions of the file.
    ///
    /// # Errors
    /// None for the result of [`read`]: a spring from a point to itself, a point out of range, a
    /// stiffness that is not finite.
    pub fn springs(&self) -> Result<Springs, PairError> {
        let count = self.position.len();
        let outside = self
            .springs
            .iter()
            .position(|(ends, _)| ends.iter().any(|&p| p as usize >= count));
        if let Some(spring) = outside {
            let [a, b] = self.springs[spring].0;
            return Err(PairError::OutOfRange {
                spring,
                point: a.max(b),
                count,
            });
        }
        let law = |&([a, b], stiffness): &([u32; 2], f64)| {
            let rest = (self.position[a as usize] - self.position[b as usize]).norm();
            ([a, b], Hooke { rest, stiffness })
        };
        Springs::new(count, self.springs.iter().map(law))
    }
}

/// Reads a file.
///
/// # Errors
/// A file that cannot be read or is too large, and content in another format, with line and column.
pub fn read(path: &Path) -> Result<SpringFile, ReadError> {
    let name = path.display().to_string();
    let io = |source| ReadError::Io {
        file: name.clone(),
        source,
    };
    let mut bytes = Vec::new();
    File::open(path)
        .map_err(io)?
        .take(MAX_FILE_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(io)?;
    read_bytes(&bytes, &name)
}

/// Reads the bytes of a file; `name` appears in messages.
///
/// # Errors
/// Content in another format, with line and column.
pub fn read_bytes(bytes: &[u8], name: &str) -> Result<SpringFile, ReadError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let whole = |problem| Cursor::new(name, bytes).fail_at(FilePlace::Whole, problem, b"");
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(whole(ReadProblem::TooLarge {
            bytes: bytes.len() as u64,
            limit: MAX_FILE_BYTES,
        }));
    }
    if bytes.trim_ascii().is_empty() {
        return Err(whole(ReadProblem::Empty));
    }
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(whole(ReadProblem::Utf16));
    }
    let mut reader = Reader {
        cursor: Cursor::new(name, bytes),
        file: SpringFile::default(),
    };
    reader.points()?;
    reader.file.triangles = reader.section("the triangles", |r, line| r.indices(line))?;
    reader.file.springs = reader.section("the springs", Reader::spring)?;
    reader.file.fibres = reader.section("the fibres", |r, line| r.indices(line))?;
    reader.file.origin = reader.section("the origin area", |r, line| {
        r.indices::<1>(line).map(|[i]| i)
    })?;
    reader.file.insertion = reader.section("the insertion area", |r, line| {
        r.indices::<1>(line).map(|[i]| i)
    })?;
    if let Some(line) = reader.next_line()? {
        return Err(reader.cursor.fail(
            ReadProblem::Expected {
                what: "the end of the file",
            },
            line,
        ));
    }
    Ok(reader.file)
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    file: SpringFile,
}

/// Least number of bytes of a line of each section, without its end: `0 0 0 m`, and one index.
const SHORTEST_POINT: u64 = 8;
const SHORTEST: u64 = 2;

impl<'a> Reader<'a> {
    /// The next line that is not blank.
    fn next_line(&mut self) -> Result<Option<&'a [u8]>, ReadError> {
        while let Some(line) = self.cursor.text_line()? {
            if !line.trim_ascii().is_empty() {
                return Ok(Some(line.trim_ascii()));
            }
        }
        Ok(None)
    }

    fn line(&mut self, what: &'static str) -> Result<&'a [u8], ReadError> {
        match self.next_line()? {
            Some(line) => Ok(line),
            None => Err(self.cursor.fail(ReadProblem::Truncated { what }, b"")),
        }
    }

    /// The words of a line; an error for another number of words.
    fn words<const N: usize>(&self, line: &'a [u8]) -> Result<[&'a [u8]; N], ReadError> {
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        let mut found = [&line[..0]; N];
        for (got, place) in found.iter_mut().enumerate() {
            *place = words.next().ok_or_else(|| {
                self.cursor
                    .fail(ReadProblem::TooFewNumbers { got, expected: N }, line)
            })?;
        }
        match words.next() {
            Some(word) => Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "the end of the line",
                },
                word,
            )),
            None => Ok(found),
        }
    }

    fn size(&self, word: &[u8], shortest: u64) -> Result<u64, ReadError> {
        let declared = count(word, "a count").map_err(|problem| self.cursor.fail(problem, word))?;
        let possible = (self.cursor.rest().len() as u64 + 1) / shortest;
        if declared > possible {
            return Err(self
                .cursor
                .fail(ReadProblem::CountExceedsFile { declared, possible }, word));
        }
        Ok(declared)
    }

    fn points(&mut self) -> Result<(), ReadError> {
        let line = self.line("the numbers of points")?;
        let [points, declared] = self.words(line)?;
        let size = self.size(points, SHORTEST_POINT)?;
        let declared =
            count(declared, "a count").map_err(|problem| self.cursor.fail(problem, declared))?;
        if size == 0 {
            return Err(self.cursor.fail(ReadProblem::NoVertices, points));
        }
        for vertex in 0..size as usize {
            let line = self.line("the points")?;
            let words: [&[u8]; 4] = self.words(line)?;
            let mut position = Point3::origin();
            for k in 0..3 {
                position[k] = coordinate(words[k], vertex)
                    .map_err(|problem| self.cursor.fail(problem, words[k]))?;
            }
            let surface = match words[3] {
                b"m" => true,
                b"i" => false,
                word => {
                    return Err(self.cursor.fail(
                        ReadProblem::Expected {
                            what: "m (surface point) or i (inner point)",
                        },
                        word,
                    ));
                }
            };
            self.file.position.push(position);
            self.file.surface.push(surface);
        }
        let marked = self.file.surface.iter().filter(|s| **s).count() as u64;
        if marked != declared {
            let note = format!(
                "{declared} surface points are declared, but {marked} are marked so: the marks count"
            );
            self.file.notes.push(note);
        }
        Ok(())
    }

    fn section<T>(
        &mut self,
        what: &'static str,
        item: impl Fn(&Self, &'a [u8]) -> Result<T, ReadError>,
    ) -> Result<Vec<T>, ReadError> {
        let line = self.line(what)?;
        let [declared] = self.words(line)?;
        let size = self.size(declared, SHORTEST)?;
        let mut items = Vec::new();
        for _ in 0..size {
            let line = self.line(what)?;
            items.push(item(self, line)?);
        }
        Ok(items)
    }

    fn index(&self, word: &[u8]) -> Result<u32, ReadError> {
        let count = self.file.position.len();
        let index = integer(word).map_err(|problem| self.cursor.fail(problem, word))?;
        match u32::try_from(index) {
            Ok(small) if (small as usize) < count => Ok(small),
            _ => Err(self.cursor.fail(
                ReadProblem::IndexOutOfRange {
                    index,
                    count,
                    from_one: false,
                },
                word,
            )),
        }
    }

    /// Distinct indices of points.
    fn indices<const N: usize>(&self, line: &'a [u8]) -> Result<[u32; N], ReadError> {
        let words: [&[u8]; N] = self.words(line)?;
        let mut found = [0; N];
        for k in 0..N {
            found[k] = self.index(words[k])?;
            if found[..k].contains(&found[k]) {
                return Err(self.cursor.fail(
                    ReadProblem::Expected {
                        what: "different points",
                    },
                    words[k],
                ));
            }
        }
        Ok(found)
    }

    fn spring(&self, line: &'a [u8]) -> Result<([u32; 2], f64), ReadError> {
        let [a, b, word]: [&[u8]; 3] = self.words(line)?;
        let ends = [self.index(a)?, self.index(b)?];
        if ends[0] == ends[1] {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "different points",
                },
                b,
            ));
        }
        let stiffness = number(word).map_err(|problem| self.cursor.fail(problem, word))?;
        if !(stiffness > 0.0 && stiffness.is_finite()) {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "a positive stiffness",
                },
                word,
            ));
        }
        Ok((ends, stiffness))
    }
}

/// Writes a file; [`read`] gives the same content without the warnings.
///
/// # Errors
/// Errors of the operating system.
pub fn write(path: &Path, file: &SpringFile) -> io::Result<()> {
    write_whole(path, |w| write_to(w, file))
}

/// Writes the text of a file.
///
/// # Errors
/// Errors of the writer.
pub fn write_to(w: &mut impl Write, file: &SpringFile) -> io::Result<()> {
    writeln!(
        w,
        "{} {}",
        file.position.len(),
        file.surface.iter().filter(|s| **s).count()
    )?;
    for (p, surface) in file.position.iter().zip(&file.surface) {
        writeln!(
            w,
            "{:?} {:?} {:?} {}",
            p.x,
            p.y,
            p.z,
            if *surface { 'm' } else { 'i' }
        )?;
    }
    writeln!(w, "{}", file.triangles.len())?;
    for [a, b, c] in &file.triangles {
        writeln!(w, "{a} {b} {c}")?;
    }
    writeln!(w, "{}", file.springs.len())?;
    for ([a, b], stiffness) in &file.springs {
        writeln!(w, "{a} {b} {stiffness:?}")?;
    }
    writeln!(w, "{}", file.fibres.len())?;
    for [a, b] in &file.fibres {
        writeln!(w, "{a} {b}")?;
    }
    for area in [&file.origin, &file.insertion] {
        writeln!(w, "{}", area.len())?;
        for i in area {
            writeln!(w, "{i}")?;
        }
    }
    Ok(())
}
