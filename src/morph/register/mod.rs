//! Registration of one surface to another: a motion from a RANSAC start, refined by iterated
//! closest points, and an optional deformation.

pub(crate) mod fit;
pub(crate) mod icp;
pub(crate) mod nonrigid;
mod outliers;
pub(crate) mod ransac;
pub(crate) mod whole;

pub use icp::Select;
pub use whole::RegistrationResidual;

use nalgebra::{Point3, Vector3};

pub use fit::{FitMotion, fit};
pub use icp::Icp;
pub(crate) use icp::Registered;
pub(crate) use nonrigid::Bent;
pub use nonrigid::NonRigid;
pub use ransac::Ransac;
pub use whole::{RegistrationSettings, SurfaceRegistration, register_surfaces};

use crate::mesh::closest::{SurfaceTree, TriangleProjection};
use crate::mesh::{MeshError, Topology, TriangleMesh};

/// Error of a registration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RegisterError {
    /// Indices or coordinates are invalid.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The surface has too few vertices or triangles.
    #[error("{vertices} vertices and {triangles} triangles; at least 4 and 1 are needed")]
    TooFew {
        /// Number of vertices.
        vertices: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// All vertices of the surface coincide.
    #[error("all {vertices} vertices lie in one place")]
    NoSize {
        /// Number of vertices.
        vertices: usize,
    },
    /// Too few pairs remain.
    #[error(
        "{pairs} of {of} pairs are left in round {round}; at least 6 are needed: start nearer, or reject less"
    )]
    Pairs {
        /// Number of remaining pairs.
        pairs: usize,
        /// Number of all pairs.
        of: usize,
        /// The round, from 1.
        round: usize,
    },
    /// The pairs do not determine the motion.
    #[error("{pairs} pairs of round {round} determine no motion: their points coincide")]
    Undetermined {
        /// Number of pairs.
        pairs: usize,
        /// The round, from 1.
        round: usize,
    },
    /// RANSAC found no motion with enough agreement.
    #[error(
        "no start found in {draws} draws: the best lays {inliers} of {of} points onto the other surface, {required} are required"
    )]
    NoStart {
        /// Number of draws.
        draws: usize,
        /// Greatest number of agreeing points.
        inliers: usize,
        /// Number of tested points.
        of: usize,
        /// Required number of agreeing points.
        required: usize,
    },
    /// The linear system of the deformation has no solution.
    #[error(transparent)]
    Factor(#[from] crate::solvers::sparse::FactorError),
    /// The caller stopped the registration.
    #[error("stopped")]
    Stopped,
}

/// Least cosine of the angle between the normals of a triangle and of its corners on a smooth
/// surface: 25 degrees.
const SMOOTH: f64 = 0.906;

/// A surface prepared for registration.
pub struct RegistrationSurface<'a> {
    mesh: &'a TriangleMesh,
    tree: SurfaceTree,
    normals: Vec<Vector3<f64>>,
    size: f64,
    /// Boundary edges of each triangle.
    open: Vec<[bool; 3]>,
}

impl<'a> RegistrationSurface<'a> {
    /// Prepares a surface, open or closed.
    ///
    /// # Errors
    /// An invalid mesh, or one with too few vertices or triangles.
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

    /// A point of a triangle with its normal, on the smooth surface that the triangles approximate,
    /// where it is smooth.
    ///
    /// With p_i the corners, n_i their normals and w_i the weights of y in the triangle, y + 1/2
    /// sum w_i ((p_i - y) . n_i) n_i is on the surface to second order: a triangle lies below a
    /// surface of curvature k by k/2 sum w_i |y - p_i|^2. Without this correction two samples of
    /// one round body differ by the depth of their triangles, and the moving one shrinks.
    fn curved(&self, near: &TriangleProjection) -> (Point3<f64>, Vector3<f64>) {
        let names = self.mesh.triangles[near.triangle as usize];
        let corners = self.mesh.corners(near.triangle as usize);
        curved(
            &near.point,
            &corners,
            &names.map(|v| self.normals[v as usize]),
        )
    }

    /// True if a point of a triangle lies on a boundary edge: a match there is beyond the boundary.
    fn is_on_rim(&self, triangle: u32, at: &Point3<f64>) -> bool {
        self.is_on_moved_rim(triangle, &self.mesh.corners(triangle as usize), at)
    }

    /// The same with the triangle's corners where they are now.
    fn is_on_moved_rim(&self, triangle: u32, corners: &[Point3<f64>; 3], at: &Point3<f64>) -> bool {
        (0..3).any(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let along = b - a;
            // Tolerance for the rounding of the projection onto the edge.
            self.open[triangle as usize][k]
                && along.cross(&(at - a)).norm() <= 1e-9 * along.norm_squared()
        })
    }
}

/// The same for a point of a triangle with these corners and normals at them.
fn curved(
    y: &Point3<f64>,
    corners: &[Point3<f64>; 3],
    normals: &[Vector3<f64>; 3],
) -> (Point3<f64>, Vector3<f64>) {
    let [a, b, c] = corners;
    let flat = (b - a)
        .cross(&(c - a))
        .try_normalize(0.0)
        .unwrap_or_default();
    // At edges and outliers vertex normals do not describe the surface in between.
    if normals.iter().any(|n| n.dot(&flat) < SMOOTH) {
        return (*y, flat);
    }
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
