//! Methods to find the nearest triangle that are compared with the crate's own hierarchy \[cervenka2019\].
//!
//! Whatever finds the nearest triangle is exact: what a way leaves out is proven to be further away. The grid of bits has
//! no triangles and is off by up to a box; it stands apart. A new way is a file of its own and a line in [`METHODS`].

pub mod bit_grid;
mod boxes;
pub mod brute_force;
pub mod octree;
pub(crate) mod overlap;
pub mod voxels;

use std::sync::Arc;

use nalgebra::Point3;

pub use bit_grid::{BitGrid, Fill};
pub use brute_force::BruteForce;
pub use octree::Octree;
pub use voxels::Voxels;

use super::faces::Faces;
use super::nearest::{on_triangle, point_at};
use super::{Obstacle, OnTriangle, Projection};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;

/// Triangles of a mesh at rest, sorted so that the nearest is found.
pub trait NearestTriangle: Send + Sync {
    /// The triangle of `mesh`, the one that was sorted, that is nearest to `point` and at most `reach` [m] from it; of
    /// several equally near any.
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32>;
    /// Heap memory held beside the mesh [bytes].
    fn bytes(&self) -> usize;
}

/// A method and the sizes with which the first source compared it.
pub struct Method {
    /// Its name.
    pub name: &'static str,
    /// What is to be chosen: boxes along an axis, triangles in a cell; zero where nothing is.
    pub sizes: &'static [usize],
    /// The size that is best of them for bones of some ten thousand triangles.
    pub usual: usize,
    /// Sorts a mesh.
    pub sort: fn(&TriangleMesh, usize) -> Box<dyn NearestTriangle>,
}

impl Method {
    /// The surface of `mesh` as an obstacle that this method searches, at the usual size.
    pub fn obstacle(&self, mesh: &TriangleMesh) -> Arc<dyn Obstacle> {
        Arc::new(Searched::new(mesh, (self.sort)(mesh, self.usual)))
    }
}

/// Every method.
pub const METHODS: &[Method] = &[brute_force::METHOD, voxels::METHOD, octree::METHOD];

/// A surface at rest whose nearest triangle is found by any method; signs as those of [`super::Surface`].
pub struct Searched {
    faces: Faces,
    search: Box<dyn NearestTriangle>,
}

impl Searched {
    /// A copy of `mesh` with the method in which it was sorted.
    pub fn new(mesh: &TriangleMesh, search: Box<dyn NearestTriangle>) -> Self {
        Self {
            faces: Faces::new(mesh),
            search,
        }
    }

    /// The nearest place of the surface, at most `reach` [m] away.
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
        // A little more, for what is nearest may itself have given the bound.
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
    /// Its distance [m], at first the reach of the search.
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

    /// Looks at one triangle.
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
