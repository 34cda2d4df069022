//! The mesh under construction by a reader: corners are checked, polygons split.

use nalgebra::{Point3, Vector3};

use super::MeshFile;
use super::cursor::{self, Cursor, beyond_double};
use super::error::{FilePlace, ReadError, ReadProblem};
use super::warning::{Warning, Warnings};
use crate::mesh::TriangleMesh;

/// Greatest number of corners of a polygon. The fan of a polygon makes one vertex a neighbour of
/// all others, and loops around a vertex take long. Caps of pipes and terrains have thousands of
/// corners.
pub(super) const MAX_CORNERS: usize = 100_000;

/// Greatest departure of a polygon from flat and convex, relative to its extent: six decimals of a
/// metre in a millimetre.
const FLATNESS: f64 = 1e-3;

/// Vertices, triangles and lines read so far.
#[derive(Default)]
pub(super) struct Surface {
    pub(super) vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    lines: Vec<Vec<u32>>,
    warnings: Warnings,
    /// Polygons with corners that are not read yet.
    ahead: Vec<Ahead>,
}

/// A polygon that is tested when all vertices are known: its triangles and its place.
struct Ahead {
    first: u32,
    end: u32,
    place: FilePlace,
}

/// Gives the place of the current item. The call can be a search, so it happens only for a first
/// warning.
type At<'a> = &'a dyn Fn() -> FilePlace;

impl Surface {
    /// Checks an index that starts at 0.
    pub(super) fn index(&self, index: i64) -> Result<u32, ReadProblem> {
        let count = self.vertices.len();
        match u32::try_from(index) {
            Ok(i) if (i as usize) < count => Ok(i),
            _ => Err(ReadProblem::IndexOutOfRange {
                index,
                count,
                from_one: false,
            }),
        }
    }

    /// A coordinate in a text, of the vertex after the last one.
    pub(super) fn coordinate(&mut self, token: &[u8], at: At<'_>) -> Result<f64, ReadProblem> {
        let value = cursor::coordinate(token, self.vertices.len())?;
        if beyond_double(token, value) {
            self.underflow(at);
        }
        Ok(value)
    }

    /// Counts a coordinate of text that underflowed to 0.
    pub(super) fn underflow(&mut self, at: At<'_>) {
        self.warnings.note(Warning::Underflow, at);
    }

    /// Adds a polygon as a fan around its first corner.
    pub(super) fn polygon(&mut self, corners: &[u32], at: At<'_>) -> Result<(), ReadProblem> {
        let (got, limit) = (corners.len(), MAX_CORNERS);
        let [first, rest @ ..] = corners else {
            return Err(ReadProblem::TooFewCorners { got, expected: 3 });
        };
        if rest.len() < 2 {
            return Err(ReadProblem::TooFewCorners { got, expected: 3 });
        }
        if got > limit {
            return Err(ReadProblem::TooManyCorners { got, limit });
        }
        let start = self.triangles.len();
        for pair in rest.windows(2) {
            self.triangle([*first, pair[0], pair[1]], at);
        }
        if got > 3 {
            self.look_at_fan(start, at);
        }
        Ok(())
    }

    /// Warns of a fan of triangles from `start` that is not flat or not convex, now or when its
    /// vertices are known.
    fn look_at_fan(&mut self, start: usize, at: At<'_>) {
        let fan = self.triangles.get(start..).unwrap_or_default();
        match flat_and_convex(&self.vertices, fan) {
            Some(true) => {}
            Some(false) => self.warnings.note(Warning::NotFlatOrConvex, at),
            // A file of at most 2 GiB has fewer triangles than 32 bits count.
            None => self.ahead.push(Ahead {
                first: start as u32,
                end: self.triangles.len() as u32,
                place: at(),
            }),
        }
    }

    /// Adds a triangle strip; every second triangle is reversed, so that all face the same side.
    pub(super) fn strip(&mut self, corners: &[u32], at: At<'_>) -> Result<(), ReadProblem> {
        if corners.len() < 3 {
            return Err(ReadProblem::TooFewCorners {
                got: corners.len(),
                expected: 3,
            });
        }
        for (i, three) in corners.windows(3).enumerate() {
            let (a, b) = if i % 2 == 0 {
                (three[0], three[1])
            } else {
                (three[1], three[0])
            };
            self.triangle([a, b, three[2]], at);
        }
        Ok(())
    }

    /// Adds a polyline.
    pub(super) fn line(&mut self, corners: &[u32]) -> Result<(), ReadProblem> {
        if corners.len() < 2 {
            return Err(ReadProblem::TooFewCorners {
                got: corners.len(),
                expected: 2,
            });
        }
        self.lines.push(corners.to_vec());
        Ok(())
    }

    /// A triangle with a repeated vertex encloses nothing and its edges cancel, so its removal
    /// opens no surface. It is counted as a warning.
    fn triangle(&mut self, corners: [u32; 3], at: At<'_>) {
        let [a, b, c] = corners;
        if a == b || b == c || c == a {
            self.warnings.note(Warning::RepeatedCorner, at);
        } else {
            self.triangles.push(corners);
        }
    }

    /// The finished mesh.
    pub(super) fn finish(mut self, cursor: &Cursor<'_>) -> Result<MeshFile, ReadError> {
        let vertices = self.vertices.len();
        if vertices == 0 {
            return Err(cursor.fail_at(FilePlace::Whole, ReadProblem::NoVertices, b""));
        }
        if self.triangles.is_empty() && self.lines.is_empty() {
            return Err(cursor.fail_at(FilePlace::Whole, ReadProblem::NoFaces { vertices }, b""));
        }
        for Ahead { first, end, place } in std::mem::take(&mut self.ahead) {
            let fan = self
                .triangles
                .get(first as usize..end as usize)
                .unwrap_or_default();
            if flat_and_convex(&self.vertices, fan) == Some(false) {
                self.warnings.note_late(Warning::NotFlatOrConvex, place);
            }
        }
        let mesh = TriangleMesh {
            vertices: self.vertices,
            triangles: self.triangles,
        };
        Ok(MeshFile {
            mesh,
            lines: self.lines,
            format: None,
            warnings: self.warnings,
        })
    }
}

/// True if the outline of a fan is flat and convex, and so has only one surface; `None` if a vertex
/// is not read yet.
///
/// Lengths are relative to the extent of the polygon. The corners must lie within [`FLATNESS`] of
/// the plane through the first corner across the mean normal. No turn at a corner and no triangle
/// of the fan may face the other side by more than that area. A polygon with only smaller areas has
/// no side and counts as flat.
fn flat_and_convex(vertices: &[Point3<f64>], fan: &[[u32; 3]]) -> Option<bool> {
    let Some(&[first, second, _]) = fan.first() else {
        return Some(true);
    };
    let outline: Vec<u32> = [first, second]
        .into_iter()
        .chain(fan.iter().map(|t| t[2]))
        .collect();
    let origin = vertices.get(first as usize)?;
    // A quarter of each, because the difference of two large numbers can be infinite.
    let from_first = |i: u32| Some(vertices.get(i as usize)?.coords * 0.25 - origin.coords * 0.25);
    let mut extent = 0.0f64;
    for &i in &outline {
        extent = extent.max(from_first(i)?.amax());
    }
    if extent == 0.0 {
        return Some(true);
    }
    let corner = |i: u32| from_first(i).unwrap_or_default() / extent;
    let areas: Vec<Vector3<f64>> = fan
        .iter()
        .map(|t| corner(t[1]).cross(&corner(t[2])))
        .collect();
    let largest = areas.iter().map(|a| a.norm()).fold(0.0, f64::max);
    if largest <= FLATNESS {
        return Some(true);
    }
    let Some(normal) = areas.iter().sum::<Vector3<f64>>().try_normalize(FLATNESS) else {
        return Some(false);
    };
    let corners: Vec<Vector3<f64>> = outline.into_iter().map(corner).collect();
    let flat = corners.iter().all(|c| c.dot(&normal).abs() <= FLATNESS);
    let turns = (0..corners.len()).map(|k| {
        let [a, b, c] = [k, k + 1, k + 2].map(|k| corners[k % corners.len()]);
        (b - a).cross(&(c - b))
    });
    let mut both = areas.iter().copied().chain(turns);
    Some(flat && both.all(|a| a.dot(&normal) >= -FLATNESS))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOWHERE: At<'_> = &|| FilePlace::Whole;

    #[test]
    fn polygons_and_strips_keep_their_side() {
        let mut surface = Surface::default();
        surface.polygon(&[5, 6, 7, 8], NOWHERE).unwrap();
        surface.strip(&[0, 1, 2, 3], NOWHERE).unwrap();
        assert_eq!(
            surface.triangles,
            [[5, 6, 7], [5, 7, 8], [0, 1, 2], [2, 1, 3]]
        );
        assert_eq!(
            surface.polygon(&[1, 2], NOWHERE),
            Err(ReadProblem::TooFewCorners {
                got: 2,
                expected: 3
            })
        );
        assert_eq!(
            surface.line(&[1]),
            Err(ReadProblem::TooFewCorners {
                got: 1,
                expected: 2
            })
        );
        assert_eq!(
            surface.strip(&[0, 1], NOWHERE),
            Err(ReadProblem::TooFewCorners {
                got: 2,
                expected: 3
            })
        );
        let many: Vec<u32> = (0..=MAX_CORNERS as u32).collect();
        assert!(surface.polygon(&many[1..], NOWHERE).is_ok());
        let (got, limit) = (MAX_CORNERS + 1, MAX_CORNERS);
        assert_eq!(
            surface.polygon(&many, NOWHERE),
            Err(ReadProblem::TooManyCorners { got, limit })
        );
    }

    #[test]
    fn a_repeated_corner_is_counted() {
        let mut surface = Surface::default();
        surface.polygon(&[0, 1, 1, 2], NOWHERE).unwrap();
        assert_eq!(
            (
                surface.triangles.len(),
                surface.warnings.count(Warning::RepeatedCorner)
            ),
            (1, 1)
        );
        // No triangle of this polygon remains.
        surface.polygon(&[0, 1, 0, 1], NOWHERE).unwrap();
        assert_eq!(
            (
                surface.triangles.len(),
                surface.warnings.count(Warning::RepeatedCorner)
            ),
            (1, 3)
        );
        assert_eq!(
            (
                surface.warnings.count(Warning::NotFlatOrConvex),
                surface.ahead.len()
            ),
            (0, 1)
        );
    }

    /// True if one polygon at a scale and position causes a warning.
    fn warned(corners: &[[f64; 3]], scale: f64, offset: f64) -> bool {
        let vertices: Vec<_> = corners
            .iter()
            .map(|c| Point3::from(c.map(|x| scale * (x + offset))))
            .collect();
        let all: Vec<u32> = (0..corners.len() as u32).collect();
        let (mut now, mut later) = (Surface::default(), Surface::default());
        later.polygon(&all, NOWHERE).unwrap();
        assert_eq!((later.ahead.len(), later.warnings.is_empty()), (1, true));
        (now.vertices, later.vertices) = (vertices.clone(), vertices);
        now.polygon(&all, NOWHERE).unwrap();
        let count = |surface: Surface| {
            surface
                .finish(&Cursor::new("", b""))
                .unwrap()
                .warnings
                .count(Warning::NotFlatOrConvex)
        };
        let (now, later) = (count(now), count(later));
        assert_eq!(now, later);
        now == 1
    }

    #[test]
    fn polygons_that_are_not_flat_or_not_convex_are_warned_of_at_any_size() {
        let fifth = |k: usize| {
            let angle = k as f64 * std::f64::consts::TAU / 5.0;
            [angle.cos(), angle.sin(), 0.0]
        };
        let bent = |z: f64| [[0., 0., 0.], [1., 0., 0.], [1., 1., z], [0., 1., 0.]];
        let good = [
            bent(0.0).to_vec(),
            bent(1e-3).to_vec(),
            (0..5).map(fifth).collect(),
            vec![[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [2., 1., 0.]],
            vec![[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [1., 0., 0.]],
        ];
        let bad = [
            bent(0.01).to_vec(),
            // A dart, from two of its corners; a bow tie; a five-pointed star.
            vec![[0., 0., 0.], [2., 1., 0.], [0., 2., 0.], [0.5, 1., 0.]],
            vec![[0.5, 1., 0.], [0., 0., 0.], [2., 1., 0.], [0., 2., 0.]],
            vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [1., 1., 0.]],
            (0..5).map(|k| fifth(2 * k % 5)).collect(),
        ];
        for (scale, offset) in [
            (1.0, 0.0),
            (1e-3, 7.0),
            (1e-300, 0.0),
            (4e307, -1.0),
            (1e307, 0.0),
        ] {
            for corners in &good {
                assert!(!warned(corners, scale, offset), "{corners:?} at {scale}");
            }
            for corners in &bad {
                assert!(warned(corners, scale, offset), "{corners:?} at {scale}");
            }
        }
        assert!(
            !warned(&[[1.0; 3]; 4], 1.0, 0.0),
            "a polygon at one point is not looked at"
        );
    }
}
