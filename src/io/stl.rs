//! STL, text and binary.

use std::hash::{BuildHasher, RandomState};
use std::io::{self, Write};
use std::path::Path;

use nalgebra::Point3;

use super::cursor::{Cursor, finite};
use super::error::{ReadError, ReadProblem};
use super::part::{check_mesh, invalid, write_whole};
use super::surface::Surface;
use super::{Encoding, MeshFile};
use crate::mesh::TriangleMesh;

const HEADER_BYTES: usize = 84;
const FACET_BYTES: usize = 50;

/// The number of triangles that a binary file declares.
fn declared(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(80..HEADER_BYTES)?;
    Some(u64::from(u32::from_le_bytes(count.try_into().ok()?)))
}

/// True if the size of the file matches a binary STL with the declared number of triangles.
pub(super) fn has_binary_size(bytes: &[u8]) -> bool {
    declared(bytes)
        .is_some_and(|n| HEADER_BYTES as u64 + FACET_BYTES as u64 * n == bytes.len() as u64)
}

/// Writes a mesh through `NAME.part`.
///
/// The format stores corners instead of vertices. Unused vertices are lost. Vertices at one
/// position become one vertex when the file is read again; 0 and -0 are the same position. Binary
/// files contain singles, not doubles.
///
/// # Errors
/// A coordinate that is not finite, in binary also as a single; an index out of range; more
/// triangles than 32 bits count; and errors of the operating system.
pub fn write(path: &Path, mesh: &TriangleMesh, encoding: Encoding) -> io::Result<()> {
    check_mesh(mesh, &[])?;
    let count = u32::try_from(mesh.triangles.len())
        .map_err(|_| invalid("more triangles than STL can count"))?;
    if encoding == Encoding::Binary
        && let Some(i) = mesh
            .vertices
            .iter()
            .position(|v| v.iter().any(|&c| !(c as f32).is_finite()))
    {
        return Err(invalid(format!(
            "vertex {i} has a coordinate that is too large for binary STL"
        )));
    }
    write_whole(path, |w| {
        match encoding {
            Encoding::Text => writeln!(w, "solid pliant")?,
            Encoding::Binary => {
                w.write_all(&[b' '; 80])?;
                w.write_all(&count.to_le_bytes())?;
            }
        }
        for triangle in &mesh.triangles {
            let corners = triangle.map(|i| mesh.vertices[i as usize]);
            let across = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            // A triangle without area has no normal; the format requires zeros then.
            let normal = across
                .try_normalize(0.0)
                .filter(|n| n.iter().all(|c| c.is_finite()))
                .unwrap_or_default();
            if encoding == Encoding::Binary {
                let numbers = normal.iter().chain(corners.iter().flat_map(|c| c.iter()));
                numbers
                    .copied()
                    .try_for_each(|c| w.write_all(&(c as f32).to_le_bytes()))?;
                w.write_all(&[0; 2])?;
                continue;
            }
            writeln!(
                w,
                " facet normal {:?} {:?} {:?}\n  outer loop",
                normal.x, normal.y, normal.z
            )?;
            for corner in corners {
                writeln!(w, "   vertex {:?} {:?} {:?}", corner.x, corner.y, corner.z)?;
            }
            writeln!(w, "  endloop\n endfacet")?;
        }
        if encoding == Encoding::Text {
            writeln!(w, "endsolid pliant")
        } else {
            Ok(())
        }
    })
}

/// A surface whose equal corners are merged.
///
/// The table contains indices of vertices and is at most half full. Two random numbers decide where
/// the search for a vertex begins, so that no file can make all searches begin at one slot.
struct Corners {
    surface: Surface,
    slots: Vec<u32>,
    random: [u64; 2],
}

/// A slot without a vertex; a file of at most 2 GiB has fewer vertices.
const FREE: u32 = u32::MAX;

impl Default for Corners {
    fn default() -> Self {
        let random = [0u8, 1].map(|i| RandomState::new().hash_one(i));
        Self {
            surface: Surface::default(),
            slots: vec![FREE; 1024],
            random,
        }
    }
}

impl Corners {
    /// The vertex of a corner; -0 becomes 0, since the sign of zero varies between facets.
    fn vertex(&mut self, position: [f64; 3]) -> u32 {
        let position = Point3::from(position.map(|c| c + 0.0));
        if self.surface.vertices.len() * 2 >= self.slots.len() {
            self.grow();
        }
        let slot = self.slot(&position);
        let next = self.surface.vertices.len() as u32;
        if self.slots[slot] != FREE {
            return self.slots[slot];
        }
        self.slots[slot] = next;
        self.surface.vertices.push(position);
        next
    }

    /// The slot that contains a vertex, or the free slot for it.
    fn slot(&self, position: &Point3<f64>) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = self.hash(position) as usize & mask;
        // Numbers other than NaN and -0 are equal exactly if their bits are.
        while self.slots[slot] != FREE
            && self.surface.vertices[self.slots[slot] as usize] != *position
        {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn hash(&self, position: &Point3<f64>) -> u64 {
        let mix = |a: u64, b: u64| {
            let product = u128::from(a) * u128::from(b);
            product as u64 ^ (product >> 64) as u64
        };
        let [first, second] = self.random;
        let plane = mix(position.x.to_bits() ^ first, position.y.to_bits() ^ second);
        mix(plane ^ second, position.z.to_bits() ^ first)
    }

    fn grow(&mut self) {
        self.slots = vec![FREE; 4 * self.slots.len()];
        for i in 0..self.surface.vertices.len() {
            let slot = self.slot(&self.surface.vertices[i]);
            self.slots[slot] = i as u32;
        }
    }
}

/// Reads binary STL; normals and attributes are skipped.
///
/// # Errors
/// A size that contradicts the declared count, or a coordinate that is not finite.
pub(super) fn read_binary(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut cursor = Cursor::new(name, bytes);
    cursor.binary = true;
    cursor.take(80, "the header of a binary STL")?;
    let count = u64::from(u32::from_le_bytes(array(
        cursor.take(4, "the count of a binary STL")?,
    )));
    let possible = (cursor.rest().len() / FACET_BYTES) as u64;
    if count > possible {
        return Err(cursor.fail(
            ReadProblem::CountExceedsFile {
                declared: count,
                possible,
            },
            b"",
        ));
    }
    if !has_binary_size(bytes) {
        let problem = ReadProblem::SizeMismatch {
            what: "the number of triangles",
            declared: count,
            used: possible,
        };
        return Err(cursor.fail(problem, b""));
    }
    let mut corners = Corners::default();
    for _ in 0..count {
        let facet = cursor.take(FACET_BYTES, "a triangle")?;
        let start = cursor.position() - FACET_BYTES;
        let mut triangle = [0; 3];
        for (k, corner) in triangle.iter_mut().enumerate() {
            let mut position = [0.0; 3];
            for (axis, value) in position.iter_mut().enumerate() {
                let at = 12 + 12 * k + 4 * axis;
                let found = f32::from_le_bytes(array(&facet[at..at + 4]));
                *value = finite(f64::from(found), corners.surface.vertices.len()).map_err(
                    |problem| {
                        cursor.mark_at(start + at);
                        cursor.fail(problem, found.to_string().as_bytes())
                    },
                )?;
            }
            *corner = corners.vertex(position);
        }
        corners
            .surface
            .polygon(&triangle, &|| cursor.place())
            .map_err(|problem| cursor.fail(problem, b""))?;
    }
    corners.surface.finish(&cursor)
}

/// Copies bytes into an array; missing bytes are zero, which the callers exclude by the length.
fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.try_into().unwrap_or([0; N])
}

/// Reads STL text; normals and names are skipped, and further solids are parts of the same surface.
///
/// # Errors
/// A malformed number, a loop of fewer than three corners, or a solid without end.
pub(super) fn read_text(bytes: &[u8], name: &str) -> Result<MeshFile, ReadError> {
    let mut cursor = Cursor::new(name, bytes);
    let mut corners = Corners::default();
    let mut open_loop: Option<Vec<u32>> = None;
    let mut in_solid = false;
    while let Some(line) = cursor.text_line()? {
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        let Some(word) = words.next() else { continue };
        match word.to_ascii_lowercase().as_slice() {
            b"solid" => in_solid = true,
            b"endsolid" => in_solid = false,
            b"facet" | b"endfacet" => {}
            b"outer" => open_loop = Some(Vec::new()),
            b"vertex" => {
                let Some(open) = &mut open_loop else {
                    return Err(cursor.fail(
                        ReadProblem::Expected {
                            what: "'outer loop' before a vertex",
                        },
                        line,
                    ));
                };
                let mut position = [0.0; 3];
                for (got, value) in position.iter_mut().enumerate() {
                    let Some(word) = words.next() else {
                        return Err(
                            cursor.fail(ReadProblem::TooFewNumbers { got, expected: 3 }, line)
                        );
                    };
                    *value = corners
                        .surface
                        .coordinate(word, &|| cursor.place())
                        .map_err(|problem| cursor.fail(problem, word))?;
                }
                open.push(corners.vertex(position));
            }
            b"endloop" => {
                let closed = open_loop.take().unwrap_or_default();
                corners
                    .surface
                    .polygon(&closed, &|| cursor.place())
                    .map_err(|problem| cursor.fail(problem, line))?;
            }
            _ => {
                let what = "solid, facet, outer loop, vertex, endloop, endfacet or endsolid";
                return Err(cursor.fail(ReadProblem::Expected { what }, line));
            }
        }
    }
    if in_solid || open_loop.is_some() {
        return Err(cursor.fail(
            ReadProblem::Truncated {
                what: "a solid without 'endsolid'",
            },
            b"",
        ));
    }
    corners.surface.finish(&cursor)
}

#[cfg(test)]
mod tests {
    use crate::io::{Format, Warning, read_bytes};

    fn binary(header: &[u8], triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for triangle in triangles {
            bytes.extend([0; 12]);
            bytes.extend(triangle.iter().flatten().flat_map(|c| c.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    const TWO: [[[f32; 3]; 3]; 2] = [
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]],
        [[1., 0., 0.], [1., 1., 0.], [-0., 1., 0.]],
    ];

    fn text() -> String {
        let mut text = String::from("solid facet of something\n");
        for triangle in TWO {
            text += " facet normal 0 0 1\n  OUTER loop\n";
            for [x, y, z] in triangle {
                text += &format!("   vertex {x:?} {y:?} {z:?}\n");
            }
            text += "  endloop\n endfacet\n";
        }
        text + "endsolid\n"
    }

    #[test]
    fn binary_that_begins_with_solid_is_binary_and_equals_text() {
        let file = read_bytes(&binary(b"solid", &TWO), "a.stl").unwrap();
        assert_eq!(file.mesh.triangles, [[0, 1, 2], [1, 3, 2]]);
        let mut as_text = read_bytes(text().as_bytes(), "b").unwrap();
        assert_eq!(
            (file.format, as_text.format),
            (Some(Format::StlBinary), Some(Format::StlText))
        );
        as_text.format = file.format;
        assert_eq!(file, as_text);
    }

    #[test]
    fn corners_are_merged_however_many_there_are() {
        // Rows of numbers that differ in their last bits; a poor hash would map them to one slot.
        let point = |i: u32| {
            [
                f32::from_bits(0x3f80_0000 + i % 90),
                f32::from_bits(1 + i / 90),
                -0.0,
            ]
        };
        let facets: Vec<_> = (0..8000)
            .map(|i| [point(i), point(i + 1), point(i + 90)])
            .collect();
        let file = read_bytes(&binary(b"", &facets), "a.stl").unwrap();
        assert_eq!(
            (file.mesh.vertices.len(), file.mesh.triangles.len()),
            (8090, 8000)
        );
        let corner = |i: u32| file.mesh.vertices[i as usize].map(|c| c as f32);
        for (triangle, facet) in file.mesh.triangles.iter().zip(&facets) {
            assert_eq!(triangle.map(|i| <[f32; 3]>::from(corner(i))), *facet);
        }
    }

    #[test]
    fn every_truncation_is_an_error() {
        for whole in [
            binary(b"header", &TWO),
            text().trim_end().as_bytes().to_vec(),
        ] {
            for length in 0..whole.len() {
                read_bytes(&whole[..length], "a.stl").unwrap_err();
            }
        }
    }

    #[test]
    fn counts_and_numbers_are_checked() {
        let mut bytes = binary(b"header", &TWO);
        bytes[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
        let text = "a.stl: offset 0x50: 4294967295 items are declared, but the file has room for at most 2";
        assert_eq!(read_bytes(&bytes, "a.stl").unwrap_err().to_string(), text);
        let mut nan = TWO;
        nan[1][0][2] = f32::NAN;
        let error = read_bytes(&binary(b"", &nan), "a.stl")
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "a.stl: offset 0x9a: vertex 3 has a coordinate that is not finite (found 'NaN')"
        );
    }

    #[test]
    fn errors_in_text_name_the_line() {
        let error = |text: &str| {
            read_bytes(text.as_bytes(), "a.stl")
                .unwrap_err()
                .to_string()
        };
        let two = "solid\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\n";
        assert_eq!(
            error(two),
            "a.stl:5: too few corners: 2, at least 3 are needed (found 'endloop')"
        );
        assert!(error("solid\nvertex 0 0 0\n").contains("'outer loop' before a vertex"));
        assert!(error("solid\nouter loop\nvertex 0,5 0 0\n").contains("decimal comma"));
        assert!(error("solid\nouter loop\nvertex 0 inf 0\n").contains("not finite"));
        assert!(error("solid\nouter loop\nvertex 0 0\n").contains("2 of 3"));
        assert!(error("solid\nhello\n").contains("a.stl:2: expected solid, facet"));
        assert_eq!(
            error("solid\nendsolid\n"),
            "a.stl: the file has no vertices"
        );
    }

    #[test]
    fn a_facet_without_area_is_counted() {
        let flat = [TWO[0], [[0., 0., 0.], [1., 0., 0.], [1., 0., 0.]]];
        let file = read_bytes(&binary(b"", &flat), "a.stl").unwrap();
        assert_eq!(
            (
                file.mesh.triangles.len(),
                file.warnings.count(Warning::RepeatedCorner)
            ),
            (1, 1)
        );
    }
}
