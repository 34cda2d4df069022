//! Contact between muscles and bones: vertices stay out of bones, and bone points out of muscles.
//!
//! Each near bone gives a vertex its own contact plane. The closest point of a vertex is computed
//! again before the vertex can have moved, relative to the bone, farther than its last distance.
//! Nothing can tunnel, and distant vertices cost nothing.
//!
//! ```
//! use std::sync::Arc;
//!
//! use nalgebra::{Isometry3, Point3, Vector3};
//! use pliant::mesh::shapes::box_surface;
//! use pliant::solvers::StepSettings;
//! use pliant::{Contacts, Particles, PosedObstacle, Surface, System, TriangleMesh};
//!
//! // A bone with its top at z = 0, at rest.
//! let at = Isometry3::translation(0.0, 0.0, -0.5);
//! let obstacle = Arc::new(Surface::new(&box_surface([1.0, 1.0, 1.0], 0.5)));
//! let bone = PosedObstacle { name: "bone".into(), obstacle, before: at, now: at };
//! let placed = [bone];
//!
//! // A triangle 5 cm above it that falls at 2 m/s. It keeps 1 mm from the bone and slides without friction.
//! let corners = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]].map(|[x, y]| Point3::new(x, y, 0.05));
//! let mesh = TriangleMesh::new(corners.to_vec(), vec![[0, 1, 2]])?;
//! let mut particles = Particles::at_rest(mesh.vertices.clone(), vec![1.0; 3]);
//! particles.velocity.fill(Vector3::new(0.0, 0.0, -2.0));
//! let settings = StepSettings {
//!     iterations: 1,
//!     gravity: Vector3::zeros(),
//!     velocity_factor: 1.0,
//!     force_factor: 1.0,
//!     speed_limit: 10.0,
//! };
//! let mut system = System::new(particles, settings);
//! let contacts = Contacts::new(&mesh, &system.particles, &placed, vec![0], 1e-3, 0.0);
//! system.contacts = Some(contacts);
//! for _ in 0..10 {
//!     system.step(&placed, 0.01)?;
//! }
//! assert!(system.particles.position.iter().all(|p| p.z > 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod active_normals;
#[cfg(feature = "contact")]
pub(crate) mod apart;
#[cfg(feature = "contact")]
pub(crate) mod broad_phase;
pub(crate) mod capsule;
pub(crate) mod ccd;
#[cfg(feature = "contact")]
pub(crate) mod comparison;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub(crate) mod edges;
#[cfg(feature = "contact")]
pub(crate) mod escape_field;
mod faces;
pub(crate) mod gap;
#[cfg(feature = "contact")]
pub(crate) mod meeting;
#[cfg(feature = "contact")]
mod motion_bound;
#[cfg(feature = "contact")]
mod near_pairs;
mod nearest;
#[cfg(feature = "contact")]
mod patches;
#[cfg(feature = "contact")]
pub(crate) mod penetration_response;
mod plane;
#[cfg(feature = "contact")]
pub(crate) mod response;
#[cfg(not(feature = "contact"))]
#[path = "absent.rs"]
pub(crate) mod response;
pub(crate) mod rounded;
pub(crate) mod smooth;
#[cfg(feature = "contact")]
pub(crate) mod surface;
#[cfg(feature = "contact")]
mod triangles;
mod truncation;
#[cfg(feature = "contact")]
pub(crate) mod untangle;
#[cfg(feature = "contact")]
mod vertex_plane;
#[cfg(feature = "contact")]
mod vertices;

#[cfg(feature = "contact")]
pub use apart::{
    Gaps, Inseparable, Moved, Parted, PartedPair, RigidBody, SoftBody, overlaps, part,
};
#[cfg(feature = "contact")]
pub use untangle::untangle;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

pub use ccd::{Impact, time_of_impact};
pub(crate) use faces::OnTriangle;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub(crate) use faces::pseudo_normal;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub(crate) use gap::difference;
pub use gap::{Gap, Parts, gap};
#[cfg(feature = "contact")]
pub use meeting::Certificate;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub(crate) use nearest::on_triangle;
pub use plane::ContactPlane;
pub use response::Contacts;
#[cfg(feature = "contact")]
pub(crate) use response::Counts;
#[cfg(feature = "contact")]
pub use surface::Surface;
pub use truncation::{Truncation, truncate};

use crate::mesh::measures::Aabb;

/// The point of an obstacle's surface nearest to a query point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Signed distance [m], negative inside.
    pub distance: f64,
    /// Unit direction of increasing distance.
    pub normal: Vector3<f64>,
    /// The nearest point of the surface [m].
    pub point: Point3<f64>,
}

/// A rigid body that muscles must not penetrate, in its own frame.
///
/// A mesh is one as a `Surface`. Any shape with a signed distance can be one:
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use pliant::{Aabb, Obstacle, Projection};
///
/// /// Everything below z = 0, on 2 m by 2 m and 1 m deep.
/// struct Floor;
///
/// impl Obstacle for Floor {
///     fn closest(&self, point: &Point3<f64>) -> Option<Projection> {
///         let on_floor = Point3::new(point.x, point.y, 0.0);
///         Some(Projection { distance: point.z, normal: Vector3::z(), point: on_floor })
///     }
///     fn bounding_box(&self) -> Aabb {
///         Aabb { min: Point3::new(-1.0, -1.0, -1.0), max: Point3::new(1.0, 1.0, 0.0) }
///     }
///     fn contact_samples(&self) -> &[Point3<f64>] {
///         &[]
///     }
///     fn bytes(&self) -> usize {
///         0
///     }
/// }
///
/// let found = Floor.closest(&Point3::new(0.5, 0.0, -0.1));
/// assert_eq!(found.map(|found| found.distance), Some(-0.1));
/// ```
pub trait Obstacle: Send + Sync {
    /// The nearest point of the surface; `None` for an obstacle without surface.
    fn closest(&self, point: &Point3<f64>) -> Option<Projection>;
    /// The same as [`Self::closest`]; faster if `known`, a point of the surface [m], is near the
    /// closest point.
    fn closest_from(&self, point: &Point3<f64>, known: &Point3<f64>) -> Option<Projection> {
        let _ = known;
        self.closest(point)
    }
    /// A lower bound on the distance of an outer point [m], and a point of the surface as a hint
    /// for the next call [m]. Faster than the distance itself if `known`, a point of the surface,
    /// is near the closest point.
    fn clearance(&self, point: &Point3<f64>, known: &Point3<f64>) -> (f64, Point3<f64>) {
        self.closest_from(point, known)
            .map_or((f64::MAX, *known), |found| (found.distance, found.point))
    }
    /// Bounds of the surface [m].
    fn bounding_box(&self) -> Aabb;
    /// Points that must stay out of a muscle's triangles [m]; empty for a smooth obstacle.
    fn contact_samples(&self) -> &[Point3<f64>];
    /// Heap memory held [bytes].
    fn bytes(&self) -> usize;
}

/// An obstacle with its poses at the beginning and the end of a step.
#[derive(Clone)]
pub struct PosedObstacle {
    /// Name of the bone or capsule.
    pub name: String,
    /// The obstacle.
    pub obstacle: Arc<dyn Obstacle>,
    /// Pose at the beginning of the step.
    pub before: Isometry3<f64>,
    /// Pose at the end of the step.
    pub now: Isometry3<f64>,
}

impl PosedObstacle {
    /// The same obstacle, standing still where the step ends.
    #[must_use]
    pub fn still(&self) -> Self {
        Self {
            before: self.now,
            ..self.clone()
        }
    }
}
