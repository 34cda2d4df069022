//! Points of surfaces with their normals.

use nalgebra::{Point3, Vector3};

/// A point, scaled by a length of the caller, and the normal there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedPoint {
    pub place: Point3<f64>,
    pub normal: Vector3<f64>,
}

impl OrientedPoint {
    /// Squared distance of two: that of the points, plus that of the normals, which is at most 4.
    #[inline]
    pub fn square(&self, other: &Self) -> f64 {
        (self.place - other.place).norm_squared() + (self.normal - other.normal).norm_squared()
    }
}
