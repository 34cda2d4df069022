//! Triangle meshes: topology, measures, health and repair, refinement, generated shapes.

pub(crate) mod boundary;
pub(crate) mod closest;
pub(crate) mod coincident;
pub(crate) mod crossings;
pub(crate) mod cut;
pub(crate) mod health;
pub(crate) mod inside;
pub(crate) mod isosurface;
pub mod measures;
pub(crate) mod nesting;
pub(crate) mod order;
pub(crate) mod orientation;
pub(crate) mod overlap;
pub(crate) mod predicates;
pub(crate) mod refine;
pub(crate) mod repair;
pub(crate) mod quarters;
pub mod shapes;
pub(crate) mod sum;
pub(crate) mod topology;
pub(crate) mod tube;
pub(crate) mod union_find;
pub(crate) mod winding;

pub use closest::{SurfaceTree, closest_on_triangle};
pub use cut::{Cut, cut, filled};
pub use health::{Finding, FindingKind, FindingPlace, Repair};
pub use inside::Inside;
pub use orientation::Orientation;
pub use repair::{
    Deviation, LONGEST_RIM, RepairChange, RepairOptions, RepairStep, deviation, repair,
};

use nalgebra::Point3;

pub use health::Health;
pub use isosurface::isosurface;
pub use measures::Aabb;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub(crate) use refine::refine_patch;
pub use refine::{RefineError, refine};
pub use topology::Topology;
pub use tube::{lengthened, rim_pose, stump};

/// A triangle mesh: vertex positions [m] and triangles of vertex indices, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions [m], shape `[vertex_count]`.
    pub vertices: Vec<Point3<f64>>,
    /// Vertex indices of each triangle, shape `[triangle_count]`.
    pub triangles: Vec<[u32; 3]>,
}

/// Error of [`TriangleMesh::new`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} names vertex {index}, but there are {count} vertices")]
    IndexOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// The invalid index.
        index: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A triangle refers to the same vertex twice.
    #[error("triangle {triangle} names vertex {index} twice")]
    RepeatedCorner {
        /// Index of the triangle.
        triangle: usize,
        /// The repeated index.
        index: u32,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NonFinite {
        /// Index of the vertex.
        vertex: usize,
    },
}

impl TriangleMesh {
    /// Checks every index and coordinate and creates the mesh.
    ///
    /// # Errors
    /// An index out of range, a triangle with a repeated corner, a coordinate that is not finite.
    pub fn new(vertices: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        let count = vertices.len();
        if let Some(vertex) = vertices
            .iter()
            .position(|v| !v.coords.iter().all(|c| c.is_finite()))
        {
            return Err(MeshError::NonFinite { vertex });
        }
        for (triangle, &[a, b, c]) in triangles.iter().enumerate() {
            for index in [a, b, c] {
                if index as usize >= count {
                    return Err(MeshError::IndexOutOfRange {
                        triangle,
                        index,
                        count,
                    });
                }
            }
            if a == b || a == c || b == c {
                let index = if a == b || a == c { a } else { b };
                return Err(MeshError::RepeatedCorner { triangle, index });
            }
        }
        Ok(Self {
            vertices,
            triangles,
        })
    }

    /// The corner positions of a triangle [m].
    pub fn corners(&self, triangle: usize) -> [Point3<f64>; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize])
    }
}
