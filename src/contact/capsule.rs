//! A sphere swept along a segment: the cover of a joint.

use nalgebra::{Point3, Vector3};

use super::{Obstacle, Projection};
use crate::mesh::closest::place_on_segment;
use crate::mesh::measures::Aabb;

/// All points within `radius` [m] of the segment between `ends` [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// End points [m].
    pub ends: [Point3<f64>; 2],
    /// Radius [m].
    pub radius: f64,
}

impl Obstacle for Capsule {
    fn closest(&self, point: &Point3<f64>) -> Option<Projection> {
        let along = self.ends[1] - self.ends[0];
        let axis = self.ends[0] + along * place_on_segment(point, &self.ends[0], &self.ends[1]);
        let out = point - axis;
        let height = out.norm();
        // On the axis every direction is valid; this one does not depend on rounding.
        let normal = if height > 0.0 {
            out / height
        } else {
            Vector3::x()
        };
        Some(Projection {
            distance: height - self.radius,
            normal,
            point: axis + normal * self.radius,
        })
    }

    fn bounding_box(&self) -> Aabb {
        Aabb::of_points(&self.ends).inflate(self.radius)
    }

    fn contact_samples(&self) -> &[Point3<f64>] {
        &[]
    }

    fn bytes(&self) -> usize {
        std::mem::size_of::<Self>()
    }
}
