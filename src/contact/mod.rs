//! Muscles kept out of bones, and bones out of muscles.
//!
//! Every near bone gives a vertex a plane of its own; a vertex is looked up again before it can have moved further,
//! relative to the bone, than its last distance, so that nothing tunnels and far vertices cost nothing.

pub mod broad_phase;
pub mod capsule;
mod faces;
mod nearest;
pub mod penetration_response;
mod plane;
mod response;
pub mod smooth;
pub mod surface;
mod triangles;
pub mod untangle;
mod vertices;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

pub use faces::OnTriangle;
pub(crate) use faces::pseudo_normal;
pub(crate) use nearest::on_triangle;
pub use plane::ContactPlane;
pub use response::{ActiveNormals, Contacts, Counts};
pub use surface::Surface;

use crate::mesh::measures::Aabb;

/// The place of an obstacle's surface that is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Signed distance [m], negative inside.
    pub distance: f64,
    /// Unit direction in which the distance grows.
    pub normal: Vector3<f64>,
    /// The nearest point of the surface [m].
    pub point: Point3<f64>,
}

/// Something rigid that muscles are kept out of, in its own frame.
pub trait Obstacle: Send + Sync {
    /// The nearest place of the surface; `None` for an obstacle without surface.
    fn closest(&self, point: &Point3<f64>) -> Option<Projection>;
    /// As [`Self::closest`], faster where `known`, a point of the surface [m], is not far from the nearest.
    fn closest_from(&self, point: &Point3<f64>, known: &Point3<f64>) -> Option<Projection> {
        let _ = known;
        self.closest(point)
    }
    /// A lower bound on the distance of a point outside [m], and a point of the surface to begin from next time [m];
    /// faster than the distance itself where `known`, a point of the surface, is not far from the nearest.
    fn clearance(&self, point: &Point3<f64>, known: &Point3<f64>) -> (f64, Point3<f64>) {
        self.closest_from(point, known)
            .map_or((f64::MAX, *known), |found| (found.distance, found.point))
    }
    /// Bounds of the surface [m].
    fn bounding_box(&self) -> Aabb;
    /// Points that are kept out of a muscle's triangles; empty for a smooth obstacle [m].
    fn contact_samples(&self) -> &[Point3<f64>];
    /// Heap memory held [bytes].
    fn bytes(&self) -> usize;
}

/// An obstacle and where it is at the begin and at the end of a step.
#[derive(Clone)]
pub struct PosedObstacle {
    /// Name of the bone or capsule.
    pub name: String,
    /// The obstacle.
    pub obstacle: Arc<dyn Obstacle>,
    /// Pose at the begin of the step.
    pub before: Isometry3<f64>,
    /// Pose at the end of the step.
    pub now: Isometry3<f64>,
}
