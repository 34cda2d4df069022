//! Alternative methods of contact search, for comparison with this crate's hierarchy
//! \[cervenka2019\].
//!
//! Methods that find the nearest triangle are exact: every skipped triangle is provably farther
//! away. The bit grid has no triangles and an error of up to a box; it is separate. A new method is
//! a file of its own and an entry in [`WAYS`].

pub(crate) mod bit_grid;
pub(in crate::contact) mod boxes;
pub(crate) mod brute_force;
pub(crate) mod octree;
pub(crate) mod overlap;
pub(crate) mod voxels;

use std::sync::Arc;

use nalgebra::Point3;

pub use bit_grid::{BitGrid, Fill};
pub use brute_force::BruteForce;
pub use voxels::Voxels;

use super::faces::Faces;
use super::nearest::{on_triangle, point_at};
use super::{Obstacle, OnTriangle, Projection};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;

/// A search structure over the triangles of a mesh at rest, for the nearest triangle.
pub trait NearestTriangle: Send + Sync {
    /// The triangle of `mesh`, the mesh of this structure, nearest to `point` and within `reach`
    /// [m]; any of several equally near.
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32>;
    /// Heap memory besides the mesh [bytes].
    fn bytes(&self) -> usize;
}

/// A method with the sizes that the first source compares.
pub struct BroadPhase {
    /// Name of the method.
    pub name: &'static str,
    /// Values of the parameter: boxes along an axis, or triangles in a cell; zero for a method
    /// without parameter.
    pub sizes: &'static [usize],
    /// The best of these sizes for bones of about ten thousand triangles.
    pub usual: usize,
    /// Builds the structure of a mesh.
    pub sort: fn(&TriangleMesh, usize) -> Box<dyn NearestTriangle>,
}

impl BroadPhase {
    /// The surface of `mesh` as an obstacle with this method and the usual size.
    pub fn obstacle(&self, mesh: &TriangleMesh) -> Arc<dyn Obstacle> {
        Arc::new(Searched::new(mesh, (self.sort)(mesh, self.usual)))
    }
}

/// All methods.
pub const METHODS: &[BroadPhase] = &[brute_force::METHOD, voxels::METHOD, octree::METHOD];

/// A surface at rest with any method for the nearest triangle; signs are those of
/// [`super::Surface`].
pub struct Searched {
    faces: Faces,
    search: Box<dyn NearestTriangle>,
}

impl Searched {
    /// A copy of `mesh` with its search structure `way`.
    pub fn new(mesh: &TriangleMesh, search: Box<dyn NearestTriangle>) -> Self {
        Self {
            faces: Faces::new(mesh),
            search,
        }
    }

    /// The nearest point of the surface within `reach` [m].
    pub fn nearest(&self, point: &Point3<f64>, reach: f64) -> Option<OnTriangle> {
        let triangle = self.search.nearest(&self.faces.mesh, point, reach)?;
        Some(self.faces.on(point, triangle, &self.faces.mesh.vertices))
    }
}

impl Obstacle for Searched {
    fn closest(&self, point: &Point3<f64>) -> Option<Projection> {
        self.nearest(point, f64::INFINITY).map(|on| on.closest)
    }

    fn closest_from(&self, point: &Point3<f64>, known: &Point3<f64>) -> Option<Projection> {
        // Slightly larger, since the nearest point itself can have given the bound.
        let reach = (point - known).norm() * (1.0 + 1e-9);
        self.nearest(point, reach)
            .map(|on| on.closest)
            .or_else(|| self.closest(point))
    }

    fn bounding_box(&self) -> Aabb {
        self.faces.mesh.bounding_box()
    }

    fn contact_samples(&self) -> &[Point3<f64>] {
        &self.faces.contact_samples
    }

    fn bytes(&self) -> usize {
        self.search.bytes() + self.faces.bytes()
    }
}

/// The nearest triangle so far.
struct Best {
    /// Distance to the triangle [m]; at first the reach of the search.
    distance: f64,
    triangle: Option<u32>,
}

impl Best {
    fn within(reach: f64) -> Self {
        Self {
            distance: reach,
            triangle: None,
        }
    }

    /// Tests one triangle.
    fn look_at(&mut self, mesh: &TriangleMesh, point: &Point3<f64>, triangle: u32) {
        let t = mesh.corners(triangle as usize);
        let distance = (point_at(&t, &on_triangle(point, &t).0) - point).norm();
        if distance < self.distance || (self.triangle.is_none() && distance <= self.distance) {
            *self = Self {
                distance,
                triangle: Some(triangle),
            };
        }
    }
}
