//! Reader of PLY: the header, and the records of its elements in text and binary.

use nalgebra::Point3;

use super::PlyEncoding;
use crate::io::MeshFile;
use crate::io::cursor::{Cursor, beyond_double, count, finite, integer, number};
use crate::io::error::{FilePlace, ReadError, ReadProblem};
use crate::io::surface::Surface;

/// The type of a number.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    fn parse(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Kind::I8,
            b"uchar" | b"uint8" => Kind::U8,
            b"short" | b"int16" => Kind::I16,
            b"ushort" | b"uint16" => Kind::U16,
            b"int" | b"int32" => Kind::I32,
            b"uint" | b"uint32" => Kind::U32,
            b"int64" => Kind::I64,
            b"uint64" => Kind::U64,
            b"float" | b"float32" => Kind::F32,
            b"double" | b"float64" => Kind::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::I32 | Kind::U32 | Kind::F32 => 4,
            Kind::I64 | Kind::U64 | Kind::F64 => 8,
        }
    }
}

/// A number of a file before its use is known.
#[derive(Clone, Copy)]
enum Number {
    Whole(i64),
    Real(f64),
    /// A number of text outside the range of a double, and its value: an infinity or 0.
    Beyond(f64),
}

impl Number {
    fn real(self) -> f64 {
        match self {
            Number::Whole(i) => i as f64,
            Number::Real(x) | Number::Beyond(x) => x,
        }
    }
}

/// A number of binary data with the size of its type.
fn decode(kind: Kind, bytes: &[u8], big: bool) -> Number {
    match kind {
        Kind::I8 => Number::Whole(i64::from(i8::from_le_bytes(ordered(bytes, big)))),
        Kind::U8 => Number::Whole(i64::from(u8::from_le_bytes(ordered(bytes, big)))),
        Kind::I16 => Number::Whole(i64::from(i16::from_le_bytes(ordered(bytes, big)))),
        Kind::U16 => Number::Whole(i64::from(u16::from_le_bytes(ordered(bytes, big)))),
        Kind::I32 => Number::Whole(i64::from(i32::from_le_bytes(ordered(bytes, big)))),
        Kind::U32 => Number::Whole(i64::from(u32::from_le_bytes(ordered(bytes, big)))),
        Kind::I64 => Number::Whole(i64::from_le_bytes(ordered(bytes, big))),
        // A count or an index of more than 63 bits is out of range in any case.
        Kind::U64 => Number::Whole(
            i64::try_from(u64::from_le_bytes(ordered(bytes, big))).unwrap_or(i64::MAX),
        ),
        Kind::F32 => Number::Real(f64::from(f32::from_le_bytes(ordered(bytes, big)))),
        Kind::F64 => Number::Real(f64::from_le_bytes(ordered(bytes, big))),
    }
}

/// Bytes in little-endian order; the caller excludes lengths other than `N`.
fn ordered<const N: usize>(bytes: &[u8], big: bool) -> [u8; N] {
    let mut bytes: [u8; N] = bytes.try_into().unwrap_or([0; N]);
    if big {
        bytes.reverse();
    }
    bytes
}

/// A property of an element: one number, or a list of numbers.
#[derive(Clone)]
struct Property {
    name: Vec<u8>,
    kind: Kind,
    length: Option<Kind>,
}

struct Element {
    name: Vec<u8>,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    fn position(&self, names: &[&[u8]]) -> Option<usize> {
        self.properties
            .iter()
            .position(|p| names.contains(&p.name.as_slice()))
    }

    /// The size of a binary record, if all records have the same.
    fn bytes_without_lists(&self) -> Option<usize> {
        self.properties
            .iter()
            .map(|p| {
                if p.length.is_none() {
                    Some(p.kind.bytes())
                } else {
                    None
                }
            })
            .sum()
    }
}

/// Reads a PLY file: `x y z` of `vertex`, the lists `vertex_indices` or `vertex_index` of `face`,
/// and `vertex1 vertex2` of `edge`; each edge is a separate line.
///
/// # Errors
/// A malformed header, counts beyond the size of the file, an invalid number, an index out of
/// range.
pub(in crate::io) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut cursor = Cursor::new(name, bytes);
    let (encoding, elements) = header(&mut cursor)?;
    cursor.binary = encoding != PlyEncoding::Text;
    let mut body = Body {
        cursor,
        encoding,
        surface: Surface::default(),
    };
    for element in &elements {
        body.check_room(element)?;
        match element.name.as_slice() {
            b"vertex" => body.vertices(element)?,
            b"face" => body.faces(element)?,
            b"edge" => body.edges(element)?,
            _ => body.records(element, |_, _, _| Ok(()))?,
        }
    }
    body.surface.finish(&body.cursor)
}

fn header(cursor: &mut Cursor<'_>) -> Result<(PlyEncoding, Vec<Element>), ReadError> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    // The first line is "ply"; the detection of the format checked it.
    cursor.token();
    cursor.next_line();
    loop {
        let Some(line) = cursor.text_line()? else {
            return Err(cursor.fail(ReadProblem::Truncated { what: "the header" }, b""));
        };
        let words: Vec<&[u8]> = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty())
            .collect();
        let expected = |what| cursor.fail(ReadProblem::Expected { what }, line);
        match words.as_slice() {
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"format", kind, _version] => {
                encoding = Some(match *kind {
                    b"ascii" => PlyEncoding::Text,
                    b"binary_little_endian" => PlyEncoding::Little,
                    b"binary_big_endian" => PlyEncoding::Big,
                    _ => return Err(expected("ascii, binary_little_endian or binary_big_endian")),
                });
            }
            [b"element", name, number] => {
                let count = count(number, "'element NAME COUNT'")
                    .map_err(|problem| cursor.fail(problem, line))?;
                elements.push(Element {
                    name: name.to_vec(),
                    count,
                    properties: Vec::new(),
                });
            }
            [b"property", kind @ .., name] => {
                let (length, kind) = match kind {
                    [b"list", length, kind] => (Some(Kind::parse(length)), Kind::parse(kind)),
                    [kind] => (None, Kind::parse(kind)),
                    _ => {
                        return Err(expected(
                            "'property TYPE NAME' or 'property list TYPE TYPE NAME'",
                        ));
                    }
                };
                let (Some(kind), false) = (kind, length == Some(None)) else {
                    return Err(expected("a type such as uchar, int, float or double"));
                };
                let Some(element) = elements.last_mut() else {
                    return Err(expected("'element' before 'property'"));
                };
                element.properties.push(Property {
                    name: name.to_vec(),
                    kind,
                    length: length.flatten(),
                });
            }
            [b"end_header"] => {
                return encoding
                    .map(|e| (e, elements))
                    .ok_or_else(|| expected("'format' before 'end_header'"));
            }
            _ => return Err(expected("format, comment, element, property or end_header")),
        }
    }
}

struct Body<'a> {
    cursor: Cursor<'a>,
    encoding: PlyEncoding,
    surface: Surface,
}

impl<'a> Body<'a> {
    /// Rejects a count before anything is read or reserved for it.
    fn check_room(&self, element: &Element) -> Result<(), ReadError> {
        let smallest: usize = element
            .properties
            .iter()
            .map(|p| {
                if self.encoding == PlyEncoding::Text {
                    2
                } else {
                    p.length.unwrap_or(p.kind).bytes()
                }
            })
            .sum();
        // The last number of a text needs no following space; an element without properties has
        // size 0.
        let possible = ((self.cursor.rest().len() + 1) / smallest.max(1)) as u64;
        if smallest > 0 && element.count > possible {
            let problem = ReadProblem::CountExceedsFile {
                declared: element.count,
                possible,
            };
            return Err(self.cursor.fail(problem, &element.name));
        }
        Ok(())
    }

    fn vertices(&mut self, element: &Element) -> Result<(), ReadError> {
        let axes = [b"x", b"y", b"z"].map(|axis| element.position(&[axis.as_slice()]));
        let [Some(x), Some(y), Some(z)] = axes else {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "properties x, y and z of 'vertex'",
                },
                b"",
            ));
        };
        if [x, y, z]
            .iter()
            .any(|&i| element.properties[i].length.is_some())
        {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "numbers x, y and z, not lists",
                },
                b"",
            ));
        }
        self.records(element, |surface, record, place| {
            let vertex = surface.vertices.len();
            let mut position = Point3::origin();
            for (axis, property) in [x, y, z].into_iter().enumerate() {
                let value = record.first(property).ok_or(ReadProblem::TooFewNumbers {
                    got: axis,
                    expected: 3,
                })?;
                position[axis] = match value {
                    Number::Beyond(0.0) => {
                        surface.underflow(&|| place);
                        value.real()
                    }
                    Number::Beyond(_) => return Err(ReadProblem::Overflow { vertex }),
                    _ => finite(value.real(), vertex)?,
                };
            }
            surface.vertices.push(position);
            Ok(())
        })
    }

    fn faces(&mut self, element: &Element) -> Result<(), ReadError> {
        let Some(property) = element.position(&[b"vertex_indices", b"vertex_index"]) else {
            return Err(self.cursor.fail(
                ReadProblem::Expected {
                    what: "a list vertex_indices of 'face'",
                },
                b"",
            ));
        };
        let mut corners = Vec::new();
        self.records(element, |surface, record, place| {
            corners.clear();
            corners.reserve_exact(record.length(property));
            for value in record.property(property) {
                corners.push(surface.index(whole_index(value)?)?);
            }
            surface.polygon(&corners, &|| place)
        })
    }

    /// Edges become lines of two vertices; an element of that name with other properties is
    /// skipped.
    fn edges(&mut self, element: &Element) -> Result<(), ReadError> {
        let ends = [b"vertex1", b"vertex2"].map(|end| element.position(&[end.as_slice()]));
        let [Some(first), Some(second)] = ends else {
            return self.records(element, |_, _, _| Ok(()));
        };
        self.records(element, |surface, record, _| {
            let mut corners = [0; 2];
            for (got, property) in [first, second].into_iter().enumerate() {
                let value = record
                    .first(property)
                    .ok_or(ReadProblem::TooFewNumbers { got, expected: 2 })?;
                corners[got] = surface.index(whole_index(value)?)?;
            }
            surface.line(&corners)
        })
    }

    /// Reads each record of an element and passes it to `each`.
    fn records(
        &mut self,
        element: &Element,
        mut each: impl FnMut(&mut Surface, &Record<'_>, FilePlace) -> Result<(), ReadProblem>,
    ) -> Result<(), ReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        let mut record = Record::new(element, self.encoding);
        let stride = element.bytes_without_lists();
        for _ in 0..element.count {
            let quoted = if self.encoding == PlyEncoding::Text {
                self.text_record(element, &mut record)?
            } else {
                let start = self.cursor.position();
                match stride {
                    // All parts of such a record have the same offsets as in the first.
                    Some(stride)
                        if !record.parts.is_empty() && self.cursor.rest().len() >= stride =>
                    {
                        record.bytes = self.cursor.take(stride, "the elements")?;
                    }
                    _ => self.binary_record(element, &mut record)?,
                }
                self.cursor.mark_at(start);
                b""
            };
            let place = self.cursor.place();
            each(&mut self.surface, &record, place)
                .map_err(|problem| self.cursor.fail(problem, quoted))?;
        }
        Ok(())
    }

    /// Reads a record of text, which is one line. Returns the line.
    fn text_record(
        &mut self,
        element: &Element,
        record: &mut Record<'a>,
    ) -> Result<&'a [u8], ReadError> {
        record.clear();
        let cursor = &mut self.cursor;
        let line = loop {
            match cursor.text_line()? {
                None => {
                    return Err(cursor.fail(
                        ReadProblem::Truncated {
                            what: "the elements",
                        },
                        b"",
                    ));
                }
                Some(line) if line.iter().all(u8::is_ascii_whitespace) => {}
                Some(line) => break line,
            }
        };
        let here = *cursor;
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        let mut got = 0;
        let mut next = |kind: Kind| {
            let Some(word) = words.next() else {
                return Err(here.fail(
                    ReadProblem::TooFewNumbers {
                        got,
                        expected: got + 1,
                    },
                    line,
                ));
            };
            got += 1;
            let value = match kind {
                Kind::F32 | Kind::F64 => number(word).map(|x| {
                    if beyond_double(word, x) {
                        Number::Beyond(x)
                    } else {
                        Number::Real(x)
                    }
                }),
                _ => integer(word).map(Number::Whole),
            };
            value.map_err(|problem| here.fail(problem, word))
        };
        for property in &element.properties {
            let length = property.length.map_or(Ok(Number::Whole(1)), &mut next)?;
            let length = whole_length(length).map_err(|problem| here.fail(problem, line))?;
            let start = record.text.len();
            for _ in 0..length {
                record.text.push(next(property.kind)?);
            }
            record.parts.push((start, record.text.len()));
        }
        Ok(line)
    }

    /// Finds the parts of a record of binary data.
    fn binary_record(
        &mut self,
        element: &Element,
        record: &mut Record<'a>,
    ) -> Result<(), ReadError> {
        record.clear();
        let (start, bytes) = (self.cursor.position(), self.cursor.rest());
        for property in &element.properties {
            let length = match property.length {
                None => 1,
                Some(kind) => {
                    let length = decode(
                        kind,
                        self.cursor.take(kind.bytes(), "the elements")?,
                        record.big,
                    );
                    whole_length(length).map_err(|problem| self.cursor.fail(problem, b""))?
                }
            };
            let size = property.kind.bytes();
            let room = (self.cursor.rest().len() / size) as u64;
            if length > room {
                let problem = ReadProblem::CountExceedsFile {
                    declared: length,
                    possible: room,
                };
                return Err(self.cursor.fail(problem, &property.name));
            }
            let begin = self.cursor.position() - start;
            self.cursor.take(length as usize * size, "the elements")?;
            record.parts.push((begin, self.cursor.position() - start));
        }
        record.bytes = &bytes[..self.cursor.position() - start];
        Ok(())
    }
}

fn whole_index(index: Number) -> Result<i64, ReadProblem> {
    match index {
        Number::Whole(index) => Ok(index),
        _ => Err(ReadProblem::Expected {
            what: "whole numbers as vertex indices",
        }),
    }
}

fn whole_length(length: Number) -> Result<u64, ReadProblem> {
    match length {
        Number::Whole(n) if n >= 0 => Ok(n as u64),
        _ => Err(ReadProblem::Expected {
            what: "a whole number of list items",
        }),
    }
}

/// The numbers of one element: text is already read, binary data are decoded on demand.
struct Record<'a> {
    text: Vec<Number>,
    bytes: &'a [u8],
    /// Start and end of the numbers of each property, in `text` or in `bytes`.
    parts: Vec<(usize, usize)>,
    kinds: Vec<Kind>,
    is_text: bool,
    big: bool,
}

impl Record<'_> {
    fn new(element: &Element, encoding: PlyEncoding) -> Self {
        let (is_text, big) = (encoding == PlyEncoding::Text, encoding == PlyEncoding::Big);
        let kinds = element.properties.iter().map(|p| p.kind).collect();
        Self {
            text: Vec::new(),
            bytes: b"",
            parts: Vec::new(),
            kinds,
            is_text,
            big,
        }
    }

    fn clear(&mut self) {
        self.text.clear();
        self.parts.clear();
    }

    /// The numbers of a property: numbers of text, or the bytes of binary data with their type.
    fn part(&self, i: usize) -> (&[Number], &[u8], Kind) {
        let (start, end) = self.parts.get(i).copied().unwrap_or_default();
        let kind = self.kinds.get(i).copied().unwrap_or(Kind::U8);
        if self.is_text {
            (self.text.get(start..end).unwrap_or_default(), b"", kind)
        } else {
            (&[], self.bytes.get(start..end).unwrap_or_default(), kind)
        }
    }

    fn length(&self, i: usize) -> usize {
        let (text, bytes, kind) = self.part(i);
        text.len() + bytes.len() / kind.bytes()
    }

    fn property(&self, i: usize) -> impl Iterator<Item = Number> {
        let (text, bytes, kind) = self.part(i);
        text.iter().copied().chain(
            bytes
                .chunks_exact(kind.bytes())
                .map(move |b| decode(kind, b, self.big)),
        )
    }

    fn first(&self, i: usize) -> Option<Number> {
        self.property(i).next()
    }
}

#[cfg(test)]
mod tests;
