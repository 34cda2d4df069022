//! Contact between muscles and bones: vertices stay out of bones, and bone points out of muscles.
//!
//! Each near bone gives a vertex its own contact plane. The closest point of a vertex is computed
//! again before the vertex can have moved, relative to the bone, farther than its last distance.
//! Nothing can tunnel, and distant vertices cost nothing.

#[cfg(feature = "contact")]
pub mod broad_phase;
pub mod capsule;
mod faces;
mod nearest;
#[cfg(feature = "contact")]
pub mod penetration_response;
mod plane;
#[cfg(feature = "contact")]
mod response;
#[cfg(not(feature = "contact"))]
#[path = "absent.rs"]
mod response;
pub mod smooth;
#[cfg(feature = "contact")]
pub mod surface;
#[cfg(feature = "contact")]
mod triangles;
#[cfg(feature = "contact")]
pub mod untangle;
#[cfg(feature = "contact")]
mod vertices;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

pub use faces::OnTriangle;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub(crate) use faces::pseudo_normal;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub(crate) use nearest::on_triangle;
pub use plane::ContactPlane;
#[cfg(feature = "contact")]
pub use response::Counts;
pub use response::{ActiveNormals, Contacts};
#[cfg(feature = "contact")]
pub use surface::Surface;

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
