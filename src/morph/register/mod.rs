//! Laying one surface onto another by a motion: a start found by RANSAC, refined by iterated closest points.

pub mod fit;
pub mod icp;
pub mod ransac;

use nalgebra::{Point3, Vector3};

pub use fit::{Motion, fit};
pub use icp::{Icp, Registered};
pub use ransac::Ransac;

use crate::mesh::closest::SurfaceTree;
use crate::mesh::{MeshError, Topology, TriangleMesh};

/// Why surfaces cannot be registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RegisterError {
    /// Indices or coordinates are none.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Too little surface.
    #[error("{vertices} vertices and {triangles} triangles; at least 4 and 1 are needed")]
    TooFew {
        /// Number of vertices.
        vertices: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// A surface without size.
    #[error("all {vertices} vertices lie in one place")]
    NoSize {
        /// Number of vertices.
        vertices: usize,
    },
    /// Hardly any pair is left.
    #[error("{pairs} of {of} pairs are left in round {round}; at least 6 are needed: start nearer, or reject less")]
    Pairs {
        /// Pairs left.
        pairs: usize,
        /// Of how many.
        of: usize,
        /// The round, from 1.
        round: usize,
    },
    /// The pairs leave the motion open.
    #[error("{pairs} pairs of round {round} determine no motion: their points coincide")]
    Undetermined {
        /// Pairs.
        pairs: usize,
        /// The round, from 1.
        round: usize,
    },
    /// RANSAC found nothing that agrees.
    #[error(
        "no start found in {draws} draws: the best lays {inliers} of {of} points onto the other surface, {wanted} are wanted"
    )]
    NoStart {
        /// Draws made.
        draws: usize,
        /// Points that agreed at best.
        inliers: usize,
        /// Of how many.
        of: usize,
        /// How many are wanted.
        wanted: usize,
    },
}

/// A surface with what registration asks of it.
pub struct Surface<'a> {
    mesh: &'a TriangleMesh,
    tree: SurfaceTree,
    normals: Vec<Vector3<f64>>,
    size: f64,
    /// Sides of each triangle that belong to no other.
    open: Vec<[bool; 3]>,
}

impl<'a> Surface<'a> {
    /// Prepares a surface, open or closed.
    ///
    /// # Errors
    /// No valid mesh, or one with too little of it.
    pub fn new(mesh: &'a TriangleMesh) -> Result<Self, RegisterError> {
        TriangleMesh::new(mesh.vertices.clone(), mesh.triangles.clone())?;
        let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
        if vertices < 4 || triangles < 1 {
            return Err(RegisterError::TooFew { vertices, triangles });
        }
        let size = mesh.length();
        if !(size > 0.0) {
            return Err(RegisterError::NoSize { vertices });
        }
        let topology = Topology::new(mesh);
        let open = (0..triangles).map(|t| topology.neighbours_of_triangle(t).map(|n| n.is_none())).collect();
        let tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
        Ok(Self { mesh, tree, normals: mesh.vertex_normals(), size, open })
    }

    /// Vertices \[m\].
    pub fn points(&self) -> &[Point3<f64>] {
        &self.mesh.vertices
    }

    /// Unit normals of the vertices.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// Diagonal of the bounding box \[m\].
    pub fn size(&self) -> f64 {
        self.size
    }

    fn tree(&self) -> &SurfaceTree {
        &self.tree
    }

    fn normal(&self, triangle: u32) -> Vector3<f64> {
        let [a, b, c] = self.mesh.corners(triangle as usize);
        (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
    }

    /// Whether a place of a triangle lies on an open side of it: what is matched there is beyond the rim.
    fn is_on_rim(&self, triangle: u32, at: &Point3<f64>) -> bool {
        let corners = self.mesh.corners(triangle as usize);
        (0..3).any(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let along = b - a;
            // Rounding of the projection onto the side.
            self.open[triangle as usize][k] && along.cross(&(at - a)).norm() <= 1e-9 * along.norm_squared()
        })
    }
}
