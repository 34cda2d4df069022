//! Reader of PLY: the header, and the records of its elements in text and binary.

use nalgebra::Point3;

use super::Encoding;
use crate::io::MeshFile;
use crate::io::cursor::{Cursor, beyond_double, count, finite, integer, number};
use crate::io::error::{Place, Problem, ReadError};
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

/// A number of a file, before it is known what it should be.
#[derive(Clone, Copy)]
enum Number {
    Whole(i64),
    Real(f64),
    /// A number of text that a double does not hold, and what it became: an infinity or 0.
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

/// A number of binary data, which has as many bytes as its type.
fn decode(kind: Kind, bytes: &[u8], big: bool) -> Number {
    match kind {
        Kind::I8 => Number::Whole(i64::from(i8::from_le_bytes(ordered(bytes, big)))),
        Kind::U8 => Number::Whole(i64::from(u8::from_le_bytes(ordered(bytes, big)))),
        Kind::I16 => Number::Whole(i64::from(i16::from_le_bytes(ordered(bytes, big)))),
        Kind::U16 => Number::Whole(i64::from(u16::from_le_bytes(ordered(bytes, big)))),
        Kind::I32 => Number::Whole(i64::from(i32::from_le_bytes(ordered(bytes, big)))),
        Kind::U32 => Number::Whole(i64::from(u32::from_le_bytes(ordered(bytes, big)))),
        Kind::I64 => Number::Whole(i64::from_le_bytes(ordered(bytes, big))),
        // A count or an index of more than 63 bits is out of range whatever it is exactly.
        Kind::U64 => Number::Whole(i64::try_from(u64::from_le_bytes(ordered(bytes, big))).unwrap_or(i64::MAX)),
        Kind::F32 => Number::Real(f64::from(f32::from_le_bytes(ordered(bytes, big)))),
        Kind::F64 => Number::Real(f64::from_le_bytes(ordered(bytes, big))),
    }
}

/// Bytes in little-endian order; other numbers of bytes than `N` are excluded by the caller.
fn ordered<const N: usize>(bytes: &[u8], big: bool) -> [u8; N] {
    let mut bytes: [u8; N] = bytes.try_into().unwrap_or([0; N]);
    if big {
        bytes.reverse();
    }
    bytes
}

/// What an element has: one number, or a list of them.
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
        self.properties.iter().position(|p| names.contains(&p.name.as_slice()))
    }

    /// The size of a record of binary data, where all have the same.
    fn bytes_without_lists(&self) -> Option<usize> {
        self.properties.iter().map(|p| if p.length.is_none() { Some(p.kind.bytes()) } else { None }).sum()
    }
}

/// Reads a PLY file: `x y z` of `vertex`, the lists `vertex_indices` or `vertex_index` of `face`, and `vertex1 vertex2` of
/// `edge`, each of which is a line of its own.
///
/// # Errors
/// A malformed header, counts that the file cannot hold, a number that is none, an index out of range.
pub(in crate::io) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut cursor = Cursor::new(name, bytes);
    let (encoding, elements) = header(&mut cursor)?;
    cursor.binary = encoding != Encoding::Text;
    let mut body = Body { cursor, encoding, surface: Surface::default() };
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

fn header(cursor: &mut Cursor<'_>) -> Result<(Encoding, Vec<Element>), ReadError> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    // The first line is "ply": the format was detected by it.
    cursor.token();
    cursor.next_line();
    loop {
        let Some(line) = cursor.text_line()? else {
            return Err(cursor.fail(Problem::Truncated { what: "the header" }, b""));
        };
        let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
        let expected = |what| cursor.fail(Problem::Expected { what }, line);
        match words.as_slice() {
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"format", kind, _version] => {
                encoding = Some(match *kind {
                    b"ascii" => Encoding::Text,
                    b"binary_little_endian" => Encoding::Little,
                    b"binary_big_endian" => Encoding::Big,
                    _ => return Err(expected("ascii, binary_little_endian or binary_big_endian")),
                });
            }
            [b"element", name, number] => {
                let count = count(number, "'element NAME COUNT'").map_err(|problem| cursor.fail(problem, line))?;
                elements.push(Element { name: name.to_vec(), count, properties: Vec::new() });
            }
            [b"property", kind @ .., name] => {
                let (length, kind) = match kind {
                    [b"list", length, kind] => (Some(Kind::parse(length)), Kind::parse(kind)),
                    [kind] => (None, Kind::parse(kind)),
                    _ => return Err(expected("'property TYPE NAME' or 'property list TYPE TYPE NAME'")),
                };
                let (Some(kind), false) = (kind, length == Some(None)) else {
                    return Err(expected("a type such as uchar, int, float or double"));
                };
                let Some(element) = elements.last_mut() else { return Err(expected("'element' before 'property'")) };
                element.properties.push(Property { name: name.to_vec(), kind, length: length.flatten() });
            }
            [b"end_header"] => {
                return encoding.map(|e| (e, elements)).ok_or_else(|| expected("'format' before 'end_header'"));
            }
            _ => return Err(expected("format, comment, element, property or end_header")),
        }
    }
}

struct Body<'a> {
    cursor: Cursor<'a>,
    encoding: Encoding,
    surface: Surface,
}

impl<'a> Body<'a> {
    /// Refuses a count before anything is read or reserved for it.
    fn check_room(&self, element: &Element) -> Result<(), ReadError> {
        let smallest: usize = element
            .properties
            .iter()
            .map(|p| if self.encoding == Encoding::Text { 2 } else { p.length.unwrap_or(p.kind).bytes() })
            .sum();
        // The last number of a text needs no space behind it; an element without properties takes no room at all.
        let possible = ((self.cursor.rest().len() + 1) / smallest.max(1)) as u64;
        if smallest > 0 && element.count > possible {
            let problem = Problem::CountExceedsFile { declared: element.count, possible };
            return Err(self.cursor.fail(problem, &element.name));
        }
        Ok(())
    }

    fn vertices(&mut self, element: &Element) -> Result<(), ReadError> {
        let axes = [b"x", b"y", b"z"].map(|axis| element.position(&[axis.as_slice()]));
        let [Some(x), Some(y), Some(z)] = axes else {
            return Err(self.cursor.fail(Problem::Expected { what: "properties x, y and z of 'vertex'" }, b""));
        };
        if [x, y, z].iter().any(|&i| element.properties[i].length.is_some()) {
            return Err(self.cursor.fail(Problem::Expected { what: "numbers x, y and z, not lists" }, b""));
        }
        self.records(element, |surface, record, place| {
            let vertex = surface.vertices.len();
            let mut position = Point3::origin();
            for (axis, property) in [x, y, z].into_iter().enumerate() {
                let value = record.first(property).ok_or(Problem::TooFewNumbers { got: axis, wanted: 3 })?;
                position[axis] = match value {
                    Number::Beyond(0.0) => {
                        surface.underflow(&|| place);
                        value.real()
                    }
                    Number::Beyond(_) => return Err(Problem::Overflow { vertex }),
                    _ => finite(value.real(), vertex)?,
                };
            }
            surface.vertices.push(position);
            Ok(())
        })
    }

    fn faces(&mut self, element: &Element) -> Result<(), ReadError> {
        let Some(property) = element.position(&[b"vertex_indices", b"vertex_index"]) else {
            return Err(self.cursor.fail(Problem::Expected { what: "a list vertex_indices of 'face'" }, b""));
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

    /// Edges are lines of two vertices; an element of that name with other properties is skipped.
    fn edges(&mut self, element: &Element) -> Result<(), ReadError> {
        let ends = [b"vertex1", b"vertex2"].map(|end| element.position(&[end.as_slice()]));
        let [Some(first), Some(second)] = ends else { return self.records(element, |_, _, _| Ok(())) };
        self.records(element, |surface, record, _| {
            let mut corners = [0; 2];
            for (got, property) in [first, second].into_iter().enumerate() {
                let value = record.first(property).ok_or(Problem::TooFewNumbers { got, wanted: 2 })?;
                corners[got] = surface.index(whole_index(value)?)?;
            }
            surface.line(&corners)
        })
    }

    /// Reads each record of an element and hands it to `each`.
    fn records(
        &mut self,
        element: &Element,
        mut each: impl FnMut(&mut Surface, &Record<'_>, Place) -> Result<(), Problem>,
    ) -> Result<(), ReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        let mut record = Record::new(element, self.encoding);
        let stride = element.bytes_without_lists();
        for _ in 0..element.count {
            let quoted = if self.encoding == Encoding::Text {
                self.text_record(element, &mut record)?
            } else {
                let start = self.cursor.position();
                match stride {
                    // All parts of such a record stand where those of the first do.
                    Some(stride) if !record.parts.is_empty() && self.cursor.rest().len() >= stride => {
                        record.bytes = self.cursor.take(stride, "the elements")?;
                    }
                    _ => self.binary_record(element, &mut record)?,
                }
                self.cursor.mark_at(start);
                b""
            };
            let place = self.cursor.place();
            each(&mut self.surface, &record, place).map_err(|problem| self.cursor.fail(problem, quoted))?;
        }
        Ok(())
    }

    /// Reads a record of text, which is a line; returns the line.
    fn text_record(&mut self, element: &Element, record: &mut Record<'a>) -> Result<&'a [u8], ReadError> {
        record.clear();
        let cursor = &mut self.cursor;
        let line = loop {
            match cursor.text_line()? {
                None => return Err(cursor.fail(Problem::Truncated { what: "the elements" }, b"")),
                Some(line) if line.iter().all(u8::is_ascii_whitespace) => {}
                Some(line) => break line,
            }
        };
        let here = *cursor;
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let mut got = 0;
        let mut next = |kind: Kind| {
            let Some(word) = words.next() else {
                return Err(here.fail(Problem::TooFewNumbers { got, wanted: got + 1 }, line));
            };
            got += 1;
            let value = match kind {
                Kind::F32 | Kind::F64 => {
                    number(word).map(|x| if beyond_double(word, x) { Number::Beyond(x) } else { Number::Real(x) })
                }
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
    fn binary_record(&mut self, element: &Element, record: &mut Record<'a>) -> Result<(), ReadError> {
        record.clear();
        let (start, bytes) = (self.cursor.position(), self.cursor.rest());
        for property in &element.properties {
            let length = match property.length {
                None => 1,
                Some(kind) => {
                    let length = decode(kind, self.cursor.take(kind.bytes(), "the elements")?, record.big);
                    whole_length(length).map_err(|problem| self.cursor.fail(problem, b""))?
                }
            };
            let size = property.kind.bytes();
            let room = (self.cursor.rest().len() / size) as u64;
            if length > room {
                let problem = Problem::CountExceedsFile { declared: length, possible: room };
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

fn whole_index(index: Number) -> Result<i64, Problem> {
    match index {
        Number::Whole(index) => Ok(index),
        _ => Err(Problem::Expected { what: "whole numbers as vertex indices" }),
    }
}

fn whole_length(length: Number) -> Result<u64, Problem> {
    match length {
        Number::Whole(n) if n >= 0 => Ok(n as u64),
        _ => Err(Problem::Expected { what: "a whole number of list items" }),
    }
}

/// The numbers of one element: of text read already, of binary data only when they are asked for.
struct Record<'a> {
    text: Vec<Number>,
    bytes: &'a [u8],
    /// Where those of each property begin and end, in `text` or in `bytes`.
    parts: Vec<(usize, usize)>,
    kinds: Vec<Kind>,
    is_text: bool,
    big: bool,
}

impl Record<'_> {
    fn new(element: &Element, encoding: Encoding) -> Self {
        let (is_text, big) = (encoding == Encoding::Text, encoding == Encoding::Big);
        let kinds = element.properties.iter().map(|p| p.kind).collect();
        Self { text: Vec::new(), bytes: b"", parts: Vec::new(), kinds, is_text, big }
    }

    fn clear(&mut self) {
        self.text.clear();
        self.parts.clear();
    }

    /// The numbers of a property: those of text, or the bytes of binary data with the size of each.
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
        text.iter().copied().chain(bytes.chunks_exact(kind.bytes()).map(move |b| decode(kind, b, self.big)))
    }

    fn first(&self, i: usize) -> Option<Number> {
        self.property(i).next()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{Format, Warning, read_bytes};

    const LIST: &str = "property list uchar int vertex_indices\n";

    fn head(encoding: &str, vertices: &str, faces: &str) -> String {
        let axes = "property float x\nproperty double y\nproperty short z\nproperty list uchar char odd\n";
        format!(
            "ply\nformat {encoding} 1.0\ncomment c\nelement vertex {vertices}\n{axes}element face {faces}\n{LIST}end_header\n"
        )
    }

    const VERTICES: [(f32, f64, i16); 4] = [(0., 0., 0), (1., 0.1, 0), (0., 1., -3), (1., 1., 0)];
    const FACES: [&[i32]; 2] = [&[0, 1, 2], &[0, 1, 3, 2]];

    fn text() -> String {
        let mut text = head("ascii", "4", "2");
        for (x, y, z) in VERTICES {
            text += &format!("{x} {y} {z} 2 1 -1\n");
        }
        text + "3 0 1 2\n\n4 0 1 3 2"
    }

    fn binary(big: bool) -> Vec<u8> {
        let encoding = if big { "binary_big_endian" } else { "binary_little_endian" };
        let mut bytes = head(encoding, "4", "2").into_bytes();
        let mut push = |little: &[u8]| {
            let mut number = little.to_vec();
            if big {
                number.reverse();
            }
            bytes.extend(number);
        };
        for (x, y, z) in VERTICES {
            push(&x.to_le_bytes());
            push(&y.to_le_bytes());
            push(&z.to_le_bytes());
            push(&[1]);
            push(&[0x0a]);
        }
        for face in FACES {
            push(&[face.len() as u8]);
            face.iter().for_each(|i| push(&i.to_le_bytes()));
        }
        bytes
    }

    #[test]
    fn text_and_both_byte_orders_are_the_same_mesh() {
        let file = read_bytes(text().as_bytes(), "a.ply").unwrap();
        assert_eq!(file.mesh.triangles, [[0, 1, 2], [0, 1, 3], [0, 3, 2]]);
        assert_eq!(file.mesh.vertices[2], Point3::new(0., 1., -3.));
        let little = read_bytes(&binary(false), "").unwrap();
        assert_eq!((&file.mesh, file.format), (&little.mesh, Some(Format::Ply)));
        // The square is bent; only the place of the warning differs.
        let bent = Warning::NotFlatOrConvex;
        assert_eq!((file.warnings.count(bent), little.warnings.count(bent)), (1, 1));
        assert_eq!(little.mesh, read_bytes(&binary(true), "").unwrap().mesh);
        let crlf = text().replace('\n', "\r\n");
        assert_eq!(file, read_bytes(crlf.as_bytes(), "").unwrap());
    }

    /// Records without lists are taken as a whole; each type is read in both byte orders.
    #[test]
    fn every_type_of_number_is_read() {
        let head = |encoding: &str, x: &str| {
            format!(
                "ply\nformat {encoding} 1.0\nelement vertex 3\nproperty uchar r\nproperty {x} x\nproperty double y\n\
                 property float z\nelement face 1\nproperty list uchar uchar vertex_index\nend_header\n"
            )
        };
        let one: [(&str, &[u8]); 10] = [
            ("char", &[0xff]),
            ("uchar", &[0xff]),
            ("short", &[0xfe, 0xff]),
            ("ushort", &[0xfe, 0xff]),
            ("int", &[0xfe, 0xff, 0xff, 0xff]),
            ("uint", &[0xfe, 0xff, 0xff, 0xff]),
            ("int64", &[0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff]),
            ("uint64", &[0xfe, 0xff, 0, 0, 0, 0, 0, 0]),
            ("float", &[0, 0, 0x20, 0xc0]),
            ("double", &[0, 0, 0, 0, 0, 0, 4, 0xc0]),
        ];
        let values = [-1., 255., -2., 65534., -2., 4294967294., -2., 65534., -2.5, -2.5];
        for ((kind, little), value) in one.into_iter().zip(values) {
            for (encoding, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
                let ordered = |bytes: &[u8]| -> Vec<u8> {
                    if big { bytes.iter().rev().copied().collect() } else { bytes.to_vec() }
                };
                let mut bytes = head(encoding, kind).into_bytes();
                for i in 0..3u8 {
                    bytes.push(9);
                    bytes.extend(ordered(little));
                    bytes.extend(ordered(&f64::from(i).to_le_bytes()));
                    bytes.extend(ordered(&f32::from(i * i).to_le_bytes()));
                }
                bytes.extend([3, 0, 1, 2]);
                let file = read_bytes(&bytes, "").unwrap();
                assert_eq!(file.mesh.vertices[2], Point3::new(value, 2., 4.), "{kind} {encoding}");
                for length in 0..bytes.len() {
                    let error = read_bytes(&bytes[..length], "").unwrap_err().code();
                    assert!(["E001", "E002", "E003", "E040", "E041", "E042"].contains(&error), "{length}: {error}");
                }
            }
        }
    }

    #[test]
    fn edges_are_lines() {
        let head = "element edge 2\nproperty uchar red\nproperty int vertex1\nproperty ushort vertex2\nend_header";
        let with_edges = |edges: &str| format!("{}\n{edges}", text().replace("end_header", head));
        let file = read_bytes(with_edges("7 0 1\n7 3 2\n").as_bytes(), "a").unwrap();
        assert_eq!(file.lines, [[0, 1], [3, 2]]);
        let error = |edges: &str| read_bytes(with_edges(edges).as_bytes(), "a").unwrap_err().to_string();
        assert!(
            error("7 0 1\n7 3 4\n").contains("a:24: vertex index 4 is out of range"),
            "{}",
            error("7 0 1\n7 3 4\n")
        );
        let other = with_edges("7 0 1\n7 3 4\n").replace("vertex2", "other");
        assert!(read_bytes(other.as_bytes(), "a").unwrap().lines.is_empty());
        let real = with_edges("7 0 1\n7 3 2\n").replace("ushort", "float");
        assert!(read_bytes(real.as_bytes(), "a").unwrap_err().to_string().contains("whole numbers as vertex indices"));
    }

    #[test]
    fn every_truncation_is_an_error() {
        for whole in [text().into_bytes(), binary(false), binary(true)] {
            for length in 0..whole.len() {
                // The last number of a text may lose digits and still be one; here it is a single digit.
                read_bytes(&whole[..length], "a.ply").unwrap_err();
            }
        }
    }

    #[test]
    fn counts_that_the_file_cannot_hold_are_refused() {
        let big = "1000000000000000000";
        for encoding in ["ascii", "binary_little_endian"] {
            let error = read_bytes(head(encoding, big, "1").as_bytes(), "a").unwrap_err().to_string();
            assert!(error.contains("1000000000000000000 items are declared"), "{error}");
        }
        let empty = format!("ply\nformat ascii 1.0\nelement nothing {big}\nend_header\n");
        assert_eq!(read_bytes(empty.as_bytes(), "a").unwrap_err().to_string(), "a: the file has no vertices");
        let mut long = binary(false);
        let list = long.len() - 17;
        long[list] = 255;
        let error = read_bytes(&long, "a").unwrap_err().to_string();
        assert!(error.contains("offset") && error.contains("255 items are declared"), "{error}");
    }

    #[test]
    fn errors_name_the_line() {
        let error =
            |from: &str, to: &str| read_bytes(text().replace(from, to).as_bytes(), "a").unwrap_err().to_string();
        assert_eq!(
            error("3 0 1 2", "3 0 1 4"),
            "a:16: vertex index 4 is out of range: there are 4 vertices (found '3 0 1 4')"
        );
        assert_eq!(error("3 0 1 2", "3 0 1"), "a:16: too few numbers: 3 of 4 (found '3 0 1')");
        assert_eq!(error("3 0 1 2", "2 0 1"), "a:16: too few corners: 2, at least 3 are needed (found '2 0 1')");
        assert!(error("3 0 1 2", "3 0 1 -1").contains("a:16: vertex index -1 is out of range"));
        assert!(error("3 0 1 2", "-3 0 1 2").contains("a:16: expected a whole number of list items"));
        assert_eq!(error("1 0.1 0", "1 0,1 0"), "a:13: not a number; decimal comma? Write a point (found '0,1')");
        assert!(
            error("1 0.1 0", "1 -1e400 0").contains("a:13: vertex 1 has a coordinate that is too large for a double")
        );
        assert!(error("1 0.1 0", "1 nan 0").contains("a:13: vertex 1 has a coordinate that is not finite"));
        assert!(error("float x", "half x").contains("a:5: expected a type such as"));
        assert!(error("ascii", "utf8").contains("a:2: expected ascii, binary_little_endian"));
        assert!(error("format ascii 1.0", "comment").contains("expected 'format' before 'end_header'"));
        assert!(error("element vertex 4", "").contains("a:5: expected 'element' before 'property'"));
        assert!(error("comment c", "hello").contains("a:3: expected format, comment, element"));
        assert!(error("property float x", "property float u").contains("properties x, y and z"));
        assert!(error("vertex_indices", "indices").contains("a list vertex_indices"));
        assert!(
            error("property float x", "property list uchar float x").contains("expected numbers x, y and z, not lists")
        );
    }

    #[test]
    fn coordinates_too_small_for_a_double_are_counted() {
        let file = read_bytes(text().replace("1 0.1 0", "-1e-400 1e-999 0").as_bytes(), "a").unwrap();
        let lines: Vec<String> = file.warnings.iter().map(|w| w.terse("a")).collect();
        assert_eq!(lines[0], "a:13: warning[W001]: 2 coordinates too small for a double became 0");
        let vertex = file.mesh.vertices[1];
        assert_eq!([vertex.x, vertex.y].map(f64::to_bits), [-0.0f64, 0.0].map(f64::to_bits));
    }
}
