//! Maps of closed surfaces without handles to the unit sphere.
//!
//! [`SphereMap::robust`] is the one to take: it works for bodies of any length. [`relaxation`] is the method of the source,
//! corrected, with its limits. Either way every spherical triangle of a [`SphereMap`] is turned outward, by an exact predicate
//! on the numbers as stored, and together they cover the sphere once: so each place of the sphere belongs to one place of the
//! surface.

pub mod centre;
mod error;
pub(super) mod kernel;
mod progressive;
pub mod relaxation;
mod removal;
pub(super) mod rings;
mod stretch;
mod surface;

use nalgebra::{Point3, UnitQuaternion};

pub use error::SphereError;
pub use surface::{check, flipped, solid_angle, turn};

use crate::mesh::TriangleMesh;

/// How far from the unit sphere a point of a map may be: a few roundings of a normalisation, many times over.
const ROUND: f64 = 1e-12;

/// A surface spread over the unit sphere without folds.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereMap {
    points: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl SphereMap {
    /// Maps a surface by taking vertices out and putting them back, see the module; some 10 microseconds a vertex.
    ///
    /// # Errors
    /// A surface that is open, not manifold, not oriented, in pieces or with handles; and where doubles leave no room for a
    /// vertex.
    pub fn robust(mesh: &TriangleMesh) -> Result<Self, SphereError> {
        check(mesh)?;
        Self::of_positions(progressive::map(mesh)?, mesh.triangles.clone())
    }

    /// Takes positions from elsewhere.
    ///
    /// # Errors
    /// As [`Self::robust`], points that are not on the unit sphere, triangles that are not turned outward, and a map that
    /// covers the sphere more than once.
    pub fn new(points: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self, SphereError> {
        let mesh = TriangleMesh {
            vertices: points,
            triangles,
        };
        check(&mesh)?;
        Self::of_positions(mesh.vertices, mesh.triangles)
    }

    /// The same over a surface that was checked.
    fn of_positions(
        points: Vec<Point3<f64>>,
        triangles: Vec<[u32; 3]>,
    ) -> Result<Self, SphereError> {
        let off = |p: &Point3<f64>| !((p.coords.norm() - 1.0).abs() <= ROUND);
        if let Some(vertex) = points.iter().position(off) {
            return Err(SphereError::Radius {
                vertex: vertex as u32,
                radius: points[vertex].coords.norm(),
            });
        }
        let flipped = flipped(&points, &triangles);
        if let Some(&triangle) = flipped.first() {
            return Err(SphereError::NotPositive {
                flipped: flipped.len(),
                triangle,
            });
        }
        // All triangles turned outward cover the sphere a whole number of times.
        let times = solid_angle(&points, &triangles) / (4.0 * std::f64::consts::PI);
        if !((times - 1.0).abs() < 0.5) {
            return Err(SphereError::Covers { times });
        }
        Ok(Self { points, triangles })
    }

    /// Places of the vertices on the unit sphere.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// The triangles, as in the surface.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The map turned.
    ///
    /// # Errors
    /// Where rounding turns a thin triangle over.
    pub fn turned(&self, by: &UnitQuaternion<f64>) -> Result<Self, SphereError> {
        let matrix = by.to_rotation_matrix();
        let turn = |p: &Point3<f64>| Point3::from((matrix * p.coords).normalize());
        Self::of_positions(
            self.points.iter().map(turn).collect(),
            self.triangles.clone(),
        )
    }
}
