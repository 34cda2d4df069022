//! Maps of closed surfaces without handles to the unit sphere.
//!
//! [`SphereMap::robust`] is the standard method: it works for bodies of any length. [`relaxation`]
//! is the corrected method of the source, with its limits. In both cases every spherical triangle
//! of a [`SphereMap`] is oriented outward, by an exact predicate on the stored numbers, and the
//! triangles cover the sphere once. Each point of the sphere thus corresponds to one point of the
//! surface.

pub(crate) mod centre;
mod error;
pub(super) mod kernel;
mod progressive;
pub(crate) mod relaxation;
mod removal;
pub(super) mod rings;
mod stretch;
pub(crate) mod surface;

pub use relaxation::Relaxation;

use nalgebra::{Point3, UnitQuaternion};

pub use error::SphereError;
pub use surface::{check, flipped};
pub(crate) use surface::{solid_angle, turn};

use crate::mesh::TriangleMesh;

/// Tolerance of the distance of a map's point from the unit sphere: many times the rounding of a
/// normalisation.
const ROUND: f64 = 1e-12;

/// A surface mapped to the unit sphere without folds.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereMap {
    points: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl SphereMap {
    /// Maps a surface by removal and reinsertion of vertices, see the module; about 10 microseconds
    /// per vertex.
    ///
    /// # Errors
    /// A surface that is open, not manifold, not oriented, disconnected or with handles; or a
    /// vertex without a position in doubles.
    pub fn robust(mesh: &TriangleMesh) -> Result<Self, SphereError> {
        check(mesh)?;
        Self::of_positions(progressive::map(mesh)?, mesh.triangles.clone())
    }

    /// Creates a map from given positions.
    ///
    /// # Errors
    /// Those of [`Self::robust`], points that are not on the unit sphere, triangles that are not
    /// oriented outward, and a map that covers the sphere more than once.
    pub fn new(points: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self, SphereError> {
        let mesh = TriangleMesh {
            vertices: points,
            triangles,
        };
        check(&mesh)?;
        Self::of_positions(mesh.vertices, mesh.triangles)
    }

    /// Creates the map of a checked surface.
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
        // Outward triangles cover the sphere a whole number of times.
        let times = solid_angle(&points, &triangles) / (4.0 * std::f64::consts::PI);
        if !((times - 1.0).abs() < 0.5) {
            return Err(SphereError::Covers { times });
        }
        Ok(Self { points, triangles })
    }

    /// Positions of the vertices on the unit sphere.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// The triangles of the surface.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The rotated map.
    ///
    /// # Errors
    /// Rounding reverses a thin triangle.
    pub fn turned(&self, by: &UnitQuaternion<f64>) -> Result<Self, SphereError> {
        let matrix = by.to_rotation_matrix();
        let turn = |p: &Point3<f64>| Point3::from((matrix * p.coords).normalize());
        Self::of_positions(
            self.points.iter().map(turn).collect(),
            self.triangles.clone(),
        )
    }
}
