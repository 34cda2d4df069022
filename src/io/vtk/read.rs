//! Reader of legacy VTK: the sections of a file, and its numbers in text and binary.

use nalgebra::Point3;

use super::grid::{CellTypes, add_cells};
use crate::io::MeshFile;
use crate::io::cursor::{Cursor, count, finite, integer, number};
use crate::io::error::{A_NUMBER, FilePlace, ReadError, ReadProblem};
use crate::io::surface::Surface;

/// The type of a number.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Bit,
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
    Text,
}

impl Kind {
    fn parse(word: &[u8]) -> Option<Self> {
        Some(match word.to_ascii_lowercase().as_slice() {
            b"bit" => Kind::Bit,
            b"unsigned_char" => Kind::Unsigned(1),
            b"char" | b"signed_char" => Kind::Signed(1),
            b"unsigned_short" => Kind::Unsigned(2),
            b"short" => Kind::Signed(2),
            b"unsigned_int" => Kind::Unsigned(4),
            // VTK writes its own index type as 32 bits, independent of its size in memory.
            b"int" | b"vtkidtype" => Kind::Signed(4),
            b"unsigned_long" | b"vtktypeuint64" => Kind::Unsigned(8),
            b"long" | b"vtktypeint64" => Kind::Signed(8),
            b"float" => Kind::Float,
            b"double" => Kind::Double,
            b"string" => Kind::Text,
            _ => return None,
        })
    }

    fn bits(self) -> u64 {
        match self {
            Kind::Bit | Kind::Text => 1,
            Kind::Signed(n) | Kind::Unsigned(n) => 8 * n as u64,
            Kind::Float => 32,
            Kind::Double => 64,
        }
    }
}

/// Reads legacy VTK: `POINTS`, `POLYGONS`, `TRIANGLE_STRIPS` and `LINES` of polydata, `CELLS` of an unstructured grid.
///
/// Attributes of points and cells are the last sections of a file and contain no surface: reading
/// ends at their start.
///
/// # Errors
/// Another data set, a cell that is no part of a surface, a section of inconsistent size, an
/// invalid number, an index out of range.
pub(in crate::io) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut reader = Reader {
        cursor: Cursor::new(name, bytes),
        surface: Surface::default(),
    };
    if reader.header()? {
        reader.grid()?;
    } else {
        reader.polydata()?;
    }
    reader.surface.finish(&reader.cursor)
}

pub(super) struct Reader<'a> {
    pub(super) cursor: Cursor<'a>,
    pub(super) surface: Surface,
}

/// Integers of a section, with the means to locate one of them for an error.
pub(super) struct Numbers<'a> {
    pub(super) values: Vec<i64>,
    start: Cursor<'a>,
    kind: Kind,
}

/// The cells of a section: the indices of all cells, and the start and end of each.
pub(super) struct Cells<'a> {
    pub(super) numbers: Numbers<'a>,
    pub(super) ranges: Vec<(usize, usize)>,
}

impl<'a> Numbers<'a> {
    /// The cursor at a number.
    fn locate(&self, i: usize) -> Cursor<'a> {
        let mut cursor = self.start;
        if cursor.binary {
            cursor.mark_at(cursor.position() + i * self.kind.bits() as usize / 8);
        } else {
            cursor.skip_tokens(i + 1);
        }
        cursor
    }

    pub(super) fn fail(&self, i: usize, problem: ReadProblem) -> ReadError {
        let found = self.values.get(i).map(i64::to_string).unwrap_or_default();
        self.locate(i).fail(problem, found.as_bytes())
    }
}

impl Cells<'_> {
    /// Place of a cell; this reads the section again.
    pub(super) fn place(&self, (start, _): (usize, usize)) -> FilePlace {
        self.numbers.locate(start).place()
    }

    /// The indices of a cell, checked.
    pub(super) fn corners(
        &self,
        surface: &Surface,
        (start, end): (usize, usize),
        corners: &mut Vec<u32>,
    ) -> Result<(), ReadError> {
        corners.clear();
        corners.reserve_exact(end - start);
        for i in start..end {
            let index = surface.index(self.numbers.values[i]);
            corners.push(index.map_err(|problem| self.numbers.fail(i, problem))?);
        }
        Ok(())
    }
}

impl<'a> Reader<'a> {
    /// Reads the header. Returns true for an unstructured grid and false for polydata.
    fn header(&mut self) -> Result<bool, ReadError> {
        let first = self.cursor.next_line().unwrap_or_default();
        let version = first
            .trim_ascii()
            .rsplit(u8::is_ascii_whitespace)
            .next()
            .unwrap_or_default();
        match number(version) {
            Ok(v) if (1.0..6.0).contains(&v) => {}
            _ => {
                return Err(self.cursor.fail(
                    ReadProblem::Expected {
                        what: "a version from 1.0 to 5.1",
                    },
                    first,
                ));
            }
        }
        // The title can be any text.
        self.cursor.next_line();
        let encoding = self.word("ASCII or BINARY")?;
        let binary = match encoding.to_ascii_uppercase().as_slice() {
            b"ASCII" => false,
            b"BINARY" => true,
            _ => {
                return Err(self.cursor.fail(
                    ReadProblem::Expected {
                        what: "ASCII or BINARY",
                    },
                    encoding,
                ));
            }
        };
        let word = self.word("DATASET POLYDATA")?;
        if !word.eq_ignore_ascii_case(b"DATASET") {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "DATASET POLYDATA",
                },
                word,
            ));
        }
        let kind = self.word("POLYDATA or UNSTRUCTURED_GRID")?;
        let grid = kind.eq_ignore_ascii_case(b"UNSTRUCTURED_GRID");
        if !grid && !kind.eq_ignore_ascii_case(b"POLYDATA") {
            let what = "POLYDATA or UNSTRUCTURED_GRID: other data sets hold no surface";
            return Err(self.cursor.fail(ReadProblem::NoSurface { what }, kind));
        }
        self.cursor.binary = binary;
        Ok(grid)
    }

    fn polydata(&mut self) -> Result<(), ReadError> {
        while let Some(word) = self.cursor.token() {
            match word.to_ascii_uppercase().as_slice() {
                b"POLYGONS" => self.add(|surface, corners, at| surface.polygon(corners, at))?,
                b"TRIANGLE_STRIPS" => {
                    self.add(|surface, corners, at| surface.strip(corners, at))?
                }
                b"LINES" => self.add(|surface, corners, _| surface.line(corners))?,
                b"VERTICES" => self.add(|_, _, _| Ok(()))?,
                b"POINT_DATA" | b"CELL_DATA" => break,
                section => {
                    let what = "POINTS, POLYGONS, LINES, TRIANGLE_STRIPS, VERTICES, POINT_DATA or CELL_DATA";
                    self.common_section(section, word, what)?;
                }
            }
        }
        Ok(())
    }

    fn grid(&mut self) -> Result<(), ReadError> {
        let mut cells = None;
        while let Some(word) = self.cursor.token() {
            match word.to_ascii_uppercase().as_slice() {
                b"CELLS" => cells = Some(self.cells()?),
                b"CELL_TYPES" => {
                    let Some(cells) = cells.take() else {
                        return Err(self.cursor.fail(
                            ReadProblem::Expected {
                                what: "CELLS before CELL_TYPES",
                            },
                            word,
                        ));
                    };
                    let count = self.count("the number of cells")?;
                    self.end_of_line()?;
                    let types = self.numbers(count, Kind::Signed(4))?;
                    add_cells(&mut self.surface, &cells, &CellTypes(types))?;
                }
                b"POINT_DATA" | b"CELL_DATA" => break,
                section => {
                    self.common_section(
                        section,
                        word,
                        "POINTS, CELLS, CELL_TYPES, POINT_DATA or CELL_DATA",
                    )?;
                }
            }
        }
        match cells {
            // Cells without types have no meaning.
            Some(_) => Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "CELL_TYPES behind CELLS",
                },
                b"",
            )),
            None => Ok(()),
        }
    }

    /// A section that both data sets can have.
    fn common_section(
        &mut self,
        section: &[u8],
        word: &[u8],
        what: &'static str,
    ) -> Result<(), ReadError> {
        match section {
            b"POINTS" => self.points(),
            b"METADATA" => {
                self.skip_metadata();
                Ok(())
            }
            b"FIELD" => self.skip_field(),
            _ => Err(self.cursor.fail(ReadProblem::Expected { what }, word)),
        }
    }

    fn word(&mut self, what: &'static str) -> Result<&'a [u8], ReadError> {
        match self.cursor.token() {
            Some(word) => Ok(word),
            None => Err(self.cursor.fail(ReadProblem::Expected { what }, b"")),
        }
    }

    fn count(&mut self, what: &'static str) -> Result<u64, ReadError> {
        let word = self.word(what)?;
        count(word, what).map_err(|problem| self.cursor.fail(problem, word))
    }

    /// A type, and the end of its line if binary numbers follow.
    fn kind(&mut self) -> Result<Kind, ReadError> {
        let word = self.word("a type such as float, double or int")?;
        let Some(kind) = Kind::parse(word) else {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "a type such as float, double or int",
                },
                word,
            ));
        };
        self.end_of_line()?;
        Ok(kind)
    }

    /// Binary numbers begin directly after one line feed; their first bytes can look like white
    /// space.
    fn end_of_line(&mut self) -> Result<(), ReadError> {
        while self.cursor.binary {
            match self
                .cursor
                .take(1, "the end of a line before binary numbers")?
            {
                b"\n" => break,
                b" " | b"\t" | b"\r" => {}
                other => {
                    return Err(self.cursor.fail(
                        ReadProblem::Expected {
                            what: "the end of the line",
                        },
                        other,
                    ));
                }
            }
        }
        Ok(())
    }

    /// Rejects a count of numbers before anything is read or reserved for it.
    fn check_room(&self, count: u64, kind: Kind) -> Result<usize, ReadError> {
        let rest = self.cursor.rest().len() as u64;
        let possible = if self.cursor.binary {
            rest.saturating_mul(8) / kind.bits()
        } else {
            rest.div_ceil(2)
        };
        match usize::try_from(count) {
            Ok(n) if count <= possible => Ok(n),
            _ => Err(self.cursor.fail(
                ReadProblem::CountExceedsFile {
                    declared: count,
                    possible,
                },
                b"",
            )),
        }
    }

    fn points(&mut self) -> Result<(), ReadError> {
        let count = self.count("the number of points")?;
        let kind = self.kind()?;
        let total = self.check_room(count.saturating_mul(3), kind)?;
        let mut position = [0.0; 3];
        for i in 0..total {
            position[i % 3] = self.coordinate(kind)?;
            if i % 3 == 2 {
                self.surface.vertices.push(Point3::from(position));
            }
        }
        Ok(())
    }

    /// A coordinate of the vertex after the last one.
    fn coordinate(&mut self, kind: Kind) -> Result<f64, ReadError> {
        if !self.cursor.binary {
            let word = self.word(A_NUMBER)?;
            let value = self.surface.coordinate(word, &|| self.cursor.place());
            return value.map_err(|problem| self.cursor.fail(problem, word));
        }
        let value = match kind {
            Kind::Float => f64::from(f32::from_bits(self.big_endian(4)? as u32)),
            Kind::Double => f64::from_bits(self.big_endian(8)?),
            _ => self.whole(kind)? as f64,
        };
        finite(value, self.surface.vertices.len())
            .map_err(|problem| self.cursor.fail(problem, value.to_string().as_bytes()))
    }

    fn whole(&mut self, kind: Kind) -> Result<i64, ReadError> {
        if !self.cursor.binary {
            let word = self.word("a whole number")?;
            return integer(word).map_err(|problem| self.cursor.fail(problem, word));
        }
        match kind {
            Kind::Signed(bytes) => {
                let shift = 64 - 8 * bytes;
                Ok((self.big_endian(bytes)? << shift) as i64 >> shift)
            }
            // A number that needs 64 bits is no index and no count of this file.
            Kind::Unsigned(bytes) => Ok(i64::try_from(self.big_endian(bytes)?).unwrap_or(i64::MAX)),
            _ => Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "numbers of another type here",
                },
                b"",
            )),
        }
    }

    fn big_endian(&mut self, count: usize) -> Result<u64, ReadError> {
        let bytes = self.cursor.take(count, "binary numbers")?;
        Ok(match *bytes {
            [a, b, c, d] => u64::from(u32::from_be_bytes([a, b, c, d])),
            _ => bytes.iter().fold(0, |word, &b| word << 8 | u64::from(b)),
        })
    }

    fn numbers(&mut self, count: u64, kind: Kind) -> Result<Numbers<'a>, ReadError> {
        let count = self.check_room(count, kind)?;
        let start = self.cursor;
        // `collect` would not know the length and would use up to three times the memory.
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(self.whole(kind)?);
        }
        Ok(Numbers {
            values,
            start,
            kind,
        })
    }

    /// Reads a section of cells and passes each to `add`.
    fn add(
        &mut self,
        add: impl Fn(&mut Surface, &[u32], &dyn Fn() -> FilePlace) -> Result<(), ReadProblem>,
    ) -> Result<(), ReadError> {
        let cells = self.cells()?;
        let mut corners = Vec::new();
        for &(start, end) in &cells.ranges {
            cells.corners(&self.surface, (start, end), &mut corners)?;
            let at = || cells.place((start, end));
            add(&mut self.surface, &corners, &at)
                .map_err(|problem| cells.numbers.fail(start.max(1) - 1, problem))?;
        }
        Ok(())
    }

    /// Reads a section of cells; the content decides between the two layouts.
    fn cells(&mut self) -> Result<Cells<'a>, ReadError> {
        let first = self.count("the number of cells")?;
        let second = self.count("the size of the cells")?;
        if self
            .cursor
            .peek()
            .is_some_and(|word| word.eq_ignore_ascii_case(b"OFFSETS"))
        {
            self.cells_with_offsets(first, second)
        } else {
            self.cells_with_counts(first, second)
        }
    }

    /// Up to version 4.2: `count i j ...` for each cell, preceded by the number of all these
    /// numbers.
    fn cells_with_counts(&mut self, cells: u64, size: u64) -> Result<Cells<'a>, ReadError> {
        if size > 0 {
            self.end_of_line()?;
        }
        let numbers = self.numbers(size, Kind::Signed(4))?;
        let mut next = 0;
        let mut ranges = Vec::with_capacity(
            numbers
                .values
                .len()
                .min(usize::try_from(cells).unwrap_or(usize::MAX)),
        );
        for _ in 0..cells {
            let length = numbers
                .values
                .get(next)
                .and_then(|&n| usize::try_from(n).ok());
            let end = length
                .and_then(|n| (next + 1).checked_add(n))
                .filter(|&end| end <= numbers.values.len());
            let Some(end) = end else {
                let problem = ReadProblem::Expected {
                    what: "the number of corners of a cell, within the declared size",
                };
                return Err(numbers.fail(next, problem));
            };
            ranges.push((next + 1, end));
            next = end;
        }
        if next != numbers.values.len() {
            let problem = ReadProblem::SizeMismatch {
                what: "the size of the cells",
                declared: size,
                used: next as u64,
            };
            return Err(numbers.fail(next, problem));
        }
        Ok(Cells { numbers, ranges })
    }

    /// From version 5: the start of each cell, one number more than cells, and the indices of all
    /// cells.
    fn cells_with_offsets(&mut self, offsets: u64, size: u64) -> Result<Cells<'a>, ReadError> {
        self.cursor.token();
        let kind = self.kind()?;
        let offsets = self.numbers(offsets, kind)?;
        let word = self.word("CONNECTIVITY")?;
        if !word.eq_ignore_ascii_case(b"CONNECTIVITY") {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "CONNECTIVITY",
                },
                word,
            ));
        }
        let kind = self.kind()?;
        let numbers = self.numbers(size, kind)?;
        let mut start = 0;
        let mut ranges = Vec::with_capacity(offsets.values.len().max(1) - 1);
        for (i, &offset) in offsets.values.iter().enumerate() {
            let end = usize::try_from(offset)
                .ok()
                .filter(|&end| end >= start && end <= numbers.values.len());
            let Some(end) = end.filter(|&end| i > 0 || end == 0) else {
                let problem = ReadProblem::Expected {
                    what: "offsets that begin at 0, rise and stay within the size",
                };
                return Err(offsets.fail(i, problem));
            };
            if i > 0 {
                ranges.push((start, end));
            }
            start = end;
        }
        if start != numbers.values.len() {
            let problem = ReadProblem::SizeMismatch {
                what: "the size of the cells",
                declared: size,
                used: start as u64,
            };
            return Err(numbers.fail(start, problem));
        }
        Ok(Cells { numbers, ranges })
    }

    /// Metadata end with an empty line.
    fn skip_metadata(&mut self) {
        self.cursor.next_line();
        while self
            .cursor
            .next_line()
            .is_some_and(|line| !line.trim_ascii().is_empty())
        {}
    }

    fn skip_field(&mut self) -> Result<(), ReadError> {
        self.word("the name of the field")?;
        for _ in 0..self.count("the number of arrays")? {
            let mut name = self.word("the name of an array")?;
            while name.eq_ignore_ascii_case(b"METADATA") {
                self.skip_metadata();
                name = self.word("the name of an array")?;
            }
            let components = self.count("the number of components")?;
            let tuples = self.count("the number of tuples")?;
            let kind = self.kind()?;
            let count = self.check_room(components.saturating_mul(tuples), kind)?;
            if kind == Kind::Text && self.cursor.binary {
                self.skip_strings(count)?;
            } else if self.cursor.binary {
                let bytes = (count as u64).saturating_mul(kind.bits()).div_ceil(8);
                self.cursor.take(
                    usize::try_from(bytes).unwrap_or(usize::MAX),
                    "a field array",
                )?;
            } else if kind == Kind::Text {
                // Each string is on its own line; the rest of this line comes first.
                self.cursor.skip_lines(count + 1);
            } else {
                self.cursor.skip_tokens(count);
            }
        }
        Ok(())
    }

    /// Binary strings: a big-endian length of 1, 2, 4 or 8 bytes; greater values of its first two
    /// bits mean fewer bytes.
    fn skip_strings(&mut self, count: usize) -> Result<(), ReadError> {
        for _ in 0..count {
            let first = self.cursor.rest().first().copied().unwrap_or_default();
            let bytes = 8usize >> (first >> 6);
            let length = self.big_endian(bytes)? & (u64::MAX >> (66 - 8 * bytes));
            self.cursor
                .take(usize::try_from(length).unwrap_or(usize::MAX), "a string")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
