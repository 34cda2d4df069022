//! The mesh that a reader is building: corners are checked, polygons split.

use nalgebra::Point3;

use super::MeshFile;
use super::cursor::Cursor;
use super::error::{Place, Problem, ReadError};
use crate::mesh::TriangleMesh;

/// Vertices, triangles and lines read so far.
#[derive(Default)]
pub(super) struct Surface {
    pub(super) vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    lines: Vec<Vec<u32>>,
    degenerate: usize,
}

impl Surface {
    /// Checks an index that counts from 0.
    pub(super) fn index(&self, index: i64) -> Result<u32, Problem> {
        let count = self.vertices.len();
        match u32::try_from(index) {
            Ok(i) if (i as usize) < count => Ok(i),
            _ => Err(Problem::IndexOutOfRange { index, count, from_one: false }),
        }
    }

    /// Adds a polygon as a fan around its first corner.
    pub(super) fn polygon(&mut self, corners: &[u32]) -> Result<(), Problem> {
        let [first, rest @ ..] = corners else { return Err(Problem::TooFewCorners { got: 0, wanted: 3 }) };
        if rest.len() < 2 {
            return Err(Problem::TooFewCorners { got: corners.len(), wanted: 3 });
        }
        for pair in rest.windows(2) {
            self.triangle([*first, pair[0], pair[1]]);
        }
        Ok(())
    }

    /// Adds a triangle strip; every second triangle is turned round, so that all face the same side.
    pub(super) fn strip(&mut self, corners: &[u32]) -> Result<(), Problem> {
        if corners.len() < 3 {
            return Err(Problem::TooFewCorners { got: corners.len(), wanted: 3 });
        }
        for (i, three) in corners.windows(3).enumerate() {
            let (a, b) = if i % 2 == 0 { (three[0], three[1]) } else { (three[1], three[0]) };
            self.triangle([a, b, three[2]]);
        }
        Ok(())
    }

    /// Adds a polyline.
    pub(super) fn line(&mut self, corners: &[u32]) -> Result<(), Problem> {
        if corners.len() < 2 {
            return Err(Problem::TooFewCorners { got: corners.len(), wanted: 2 });
        }
        self.lines.push(corners.to_vec());
        Ok(())
    }

    /// A triangle that names a vertex twice encloses nothing and its edges cancel, so that leaving it out opens no
    /// surface; it is counted, never hidden.
    fn triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners;
        if a == b || b == c || c == a { self.degenerate += 1 } else { self.triangles.push(corners) }
    }

    /// The finished mesh.
    pub(super) fn finish(self, cursor: &Cursor<'_>) -> Result<MeshFile, ReadError> {
        let vertices = self.vertices.len();
        if vertices == 0 {
            return Err(cursor.fail_at(Place::Whole, Problem::NoVertices, b""));
        }
        if self.triangles.is_empty() && self.lines.is_empty() {
            return Err(cursor.fail_at(Place::Whole, Problem::NoFaces { vertices }, b""));
        }
        let mesh = TriangleMesh { vertices: self.vertices, triangles: self.triangles };
        Ok(MeshFile { mesh, lines: self.lines, degenerate: self.degenerate })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_and_strips_keep_their_side() {
        let mut surface = Surface::default();
        surface.polygon(&[5, 6, 7, 8]).unwrap();
        surface.strip(&[0, 1, 2, 3]).unwrap();
        assert_eq!(surface.triangles, [[5, 6, 7], [5, 7, 8], [0, 1, 2], [2, 1, 3]]);
        assert_eq!(surface.polygon(&[1, 2]), Err(Problem::TooFewCorners { got: 2, wanted: 3 }));
        assert_eq!(surface.line(&[1]), Err(Problem::TooFewCorners { got: 1, wanted: 2 }));
    }

    #[test]
    fn a_repeated_corner_is_counted() {
        let mut surface = Surface::default();
        surface.polygon(&[0, 1, 1, 2]).unwrap();
        assert_eq!((surface.triangles.len(), surface.degenerate), (1, 1));
    }
}
