//! Laying one surface onto another: by a motion, from a start found by RANSAC and refined by iterated closest points, and by
//! bending.

pub mod fit;
pub mod icp;
pub mod nonrigid;
mod outliers;
pub mod ransac;
pub mod whole;

use nalgebra::{Point3, Vector3};

pub use fit::{Motion, fit};
pub use icp::{Icp, Registered};
pub use nonrigid::{Bent, NonRigid};
pub use ransac::{InitialAlignment, Ransac};
pub use whole::{Settings, SurfaceRegistration, register_surfaces};

use crate::mesh::closest::{SurfaceTree, TriangleProjection};
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
    #[error(
        "{pairs} of {of} pairs are left in round {round}; at least 6 are needed: start nearer, or reject less"
    )]
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
    /// The system of the bending could not be solved.
    #[error(transparent)]
    Factor(#[from] crate::solvers::sparse::FactorError),
    /// Somebody asked to stop.
    #[error("stopped")]
    Stopped,
}

/// Cosine of the angle between the normals of a triangle and of its corners up to which a surface counts as smooth: 25 degrees.
const SMOOTH: f64 = 0.906;

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
            return Err(RegisterError::TooFew {
                vertices,
                triangles,
            });
        }
        let size = mesh.length();
        if !(size > 0.0) {
            return Err(RegisterError::NoSize { vertices });
        }
        let topology = Topology::new(mesh);
        let normals = outliers::normals(mesh, &topology, &outliers::outliers(mesh, &topology));
        let open = (0..triangles)
            .map(|t| topology.neighbours_of_triangle(t).map(|n| n.is_none()))
            .collect();
        let tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
        Ok(Self {
            mesh,
            tree,
            normals,
            size,
            open,
        })
    }

    /// Vertices \[m\].
    pub fn points(&self) -> &[Point3<f64>] {
        &self.mesh.vertices
    }

    /// The mesh.
    pub fn mesh(&self) -> &'a TriangleMesh {
        self.mesh
    }

    /// Unit normals of the vertices, zero for outliers.
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
        (b - a)
            .cross(&(c - a))
            .try_normalize(0.0)
            .unwrap_or_default()
    }

    /// A place of a triangle and its normal on the smooth surface that the triangles stand for, where it is smooth.
    ///
    /// With p_i the corners, n_i their normals and w_i the weights of y in the triangle, y + 1/2 sum w_i ((p_i - y) . n_i) n_i is on
    /// the surface to second order: a triangle lies below a surface of curvature k by k/2 sum w_i |y - p_i|^2. Without that, two
    /// samples of one round body differ by the depth of their triangles, and the one that moves shrinks.
    fn curved(&self, near: &TriangleProjection) -> (Point3<f64>, Vector3<f64>) {
        let flat = self.normal(near.triangle);
        let names = self.mesh.triangles[near.triangle as usize];
        let (corners, normals) = (
            self.mesh.corners(near.triangle as usize),
            names.map(|v| self.normals[v as usize]),
        );
        // At edges and outliers vertex normals say nothing about the surface between.
        if normals.iter().any(|n| n.dot(&flat) < SMOOTH) {
            return (near.point, flat);
        }
        let y = near.point;
        let part = |k: usize| {
            let (q, r) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
            (q - y).cross(&(r - y)).norm()
        };
        let parts = [0, 1, 2].map(part);
        let whole: f64 = parts.iter().sum();
        let (mut lift, mut normal) = (Vector3::zeros(), Vector3::zeros());
        for k in 0..3 {
            lift += normals[k] * (0.5 * parts[k] / whole * (corners[k] - y).dot(&normals[k]));
            normal += normals[k] * parts[k];
        }
        (y + lift, normal.try_normalize(0.0).unwrap_or(flat))
    }

    /// Whether a place of a triangle lies on an open side of it: what is matched there is beyond the rim.
    fn is_on_rim(&self, triangle: u32, at: &Point3<f64>) -> bool {
        let corners = self.mesh.corners(triangle as usize);
        (0..3).any(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let along = b - a;
            // Rounding of the projection onto the side.
            self.open[triangle as usize][k]
                && along.cross(&(at - a)).norm() <= 1e-9 * along.norm_squared()
        })
    }
}
