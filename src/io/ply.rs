//! PLY (Stanford polygon format): text and both byte orders.

use std::io::{self, Write};
use std::path::Path;

use nalgebra::Point3;

use super::MeshFile;
use super::cursor::{Cursor, beyond_double, count, finite, integer, number};
use super::error::{Place, Problem, ReadError};
use super::part::{check_mesh, write_whole};
use super::surface::Surface;
use crate::mesh::TriangleMesh;

/// How the numbers of a PLY file are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As text: the shortest that gives the same double again.
    Text,
    /// As little-endian binary numbers.
    Little,
    /// As big-endian binary numbers.
    Big,
}

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
}

/// Reads a PLY file: `x y z` of `vertex`, the lists `vertex_indices` or `vertex_index` of `face`, and `vertex1 vertex2` of
/// `edge`, each of which is a line of its own.
///
/// # Errors
/// A malformed header, counts that the file cannot hold, a number that is none, an index out of range.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
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

/// Writes a mesh with coordinates of type `double`, by way of `NAME.part`; polylines become edges, one for each two
/// vertices that follow one another.
///
/// # Errors
/// A coordinate that is not finite, an index out of range, a polyline of fewer than two vertices, and what the
/// operating system refuses.
pub fn write(path: &Path, mesh: &TriangleMesh, lines: &[Vec<u32>], encoding: Encoding) -> io::Result<()> {
    check_mesh(mesh, lines)?;
    let word = match encoding {
        Encoding::Text => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
    let edges: usize = lines.iter().map(|line| line.len() - 1).sum();
    write_whole(path, |w| {
        write!(
            w,
            "ply\nformat {word} 1.0\nelement vertex {vertices}\nproperty double x\nproperty double y\n\
             property double z\nelement face {triangles}\nproperty list uchar uint vertex_indices\n"
        )?;
        if edges > 0 {
            write!(w, "element edge {edges}\nproperty uint vertex1\nproperty uint vertex2\n")?;
        }
        writeln!(w, "end_header")?;
        for v in &mesh.vertices {
            match encoding {
                Encoding::Text => writeln!(w, "{:?} {:?} {:?}", v.x, v.y, v.z)?,
                Encoding::Little => v.iter().try_for_each(|c| w.write_all(&c.to_le_bytes()))?,
                Encoding::Big => v.iter().try_for_each(|c| w.write_all(&c.to_be_bytes()))?,
            }
        }
        for triangle in &mesh.triangles {
            w.write_all(if encoding == Encoding::Text { b"3 " } else { &[3] })?;
            write_indices(w, triangle, encoding)?;
        }
        lines.iter().flat_map(|line| line.windows(2)).try_for_each(|edge| write_indices(w, edge, encoding))
    })
}

/// The rest of a record, which is nothing but indices.
fn write_indices(w: &mut impl Write, indices: &[u32], encoding: Encoding) -> io::Result<()> {
    for (k, i) in indices.iter().enumerate() {
        match encoding {
            Encoding::Text if k == 0 => write!(w, "{i}")?,
            Encoding::Text => write!(w, " {i}")?,
            Encoding::Little => w.write_all(&i.to_le_bytes())?,
            Encoding::Big => w.write_all(&i.to_be_bytes())?,
        }
    }
    if encoding == Encoding::Text { writeln!(w) } else { Ok(()) }
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
            corners.reserve_exact(record.property(property).len());
            for value in record.property(property) {
                corners.push(surface.index(whole_index(*value)?)?);
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
        mut each: impl FnMut(&mut Surface, &Record, Place) -> Result<(), Problem>,
    ) -> Result<(), ReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        let mut record = Record::default();
        for _ in 0..element.count {
            record.clear();
            let quoted = if self.encoding == Encoding::Text {
                self.text_record(element, &mut record)?
            } else {
                let start = self.cursor.position();
                self.binary_record(element, &mut record)?;
                self.cursor.mark_at(start);
                b""
            };
            let place = self.cursor.place();
            each(&mut self.surface, &record, place).map_err(|problem| self.cursor.fail(problem, quoted))?;
        }
        Ok(())
    }

    /// Reads a record of text, which is a line; returns the line.
    fn text_record(&mut self, element: &Element, record: &mut Record) -> Result<&'a [u8], ReadError> {
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
            for _ in 0..length {
                record.values.push(next(property.kind)?);
            }
            record.ends.push(record.values.len());
        }
        Ok(line)
    }

    fn binary_record(&mut self, element: &Element, record: &mut Record) -> Result<(), ReadError> {
        for property in &element.properties {
            let length = match property.length {
                None => 1,
                Some(kind) => {
                    let length = self.binary_number(kind)?;
                    whole_length(length).map_err(|problem| self.cursor.fail(problem, b""))?
                }
            };
            let room = (self.cursor.rest().len() / property.kind.bytes()) as u64;
            if length > room {
                let problem = Problem::CountExceedsFile { declared: length, possible: room };
                return Err(self.cursor.fail(problem, &property.name));
            }
            // Growing by doubling would hold three times as much for a moment.
            record.values.reserve_exact(length as usize);
            for _ in 0..length {
                let value = self.binary_number(property.kind)?;
                record.values.push(value);
            }
            record.ends.push(record.values.len());
        }
        Ok(())
    }

    fn binary_number(&mut self, kind: Kind) -> Result<Number, ReadError> {
        let bytes = self.cursor.take(kind.bytes(), "the elements")?;
        // Wide enough for each kind, in the order of a little-endian machine.
        let mut wide = [0; 8];
        for (i, slot) in wide.iter_mut().take(bytes.len()).enumerate() {
            *slot = if self.encoding == Encoding::Big { bytes[bytes.len() - 1 - i] } else { bytes[i] };
        }
        let word = u64::from_le_bytes(wide);
        Ok(match kind {
            Kind::I8 => Number::Whole(i64::from(word as i8)),
            Kind::I16 => Number::Whole(i64::from(word as i16)),
            Kind::I32 => Number::Whole(i64::from(word as i32)),
            Kind::I64 => Number::Whole(word as i64),
            Kind::U8 | Kind::U16 | Kind::U32 => Number::Whole(word as i64),
            // A count or an index of more than 63 bits is out of range whatever it is exactly.
            Kind::U64 => Number::Whole(i64::try_from(word).unwrap_or(i64::MAX)),
            Kind::F32 => Number::Real(f64::from(f32::from_bits(word as u32))),
            Kind::F64 => Number::Real(f64::from_bits(word)),
        })
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

/// The numbers of one element, and where those of each property end.
#[derive(Default)]
struct Record {
    values: Vec<Number>,
    ends: Vec<usize>,
}

impl Record {
    fn clear(&mut self) {
        self.values.clear();
        self.ends.clear();
    }

    fn property(&self, i: usize) -> &[Number] {
        let start = if i == 0 { 0 } else { self.ends.get(i - 1).copied().unwrap_or(0) };
        let end = self.ends.get(i).copied().unwrap_or(start);
        self.values.get(start..end).unwrap_or_default()
    }

    fn first(&self, i: usize) -> Option<Number> {
        self.property(i).first().copied()
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
    }
}
