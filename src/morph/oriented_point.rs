//! Points of surfaces with normals, compared by position and normal.

use nalgebra::{Point3, Vector3};

/// A point in units of a length that the caller chooses, and the normal there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedPoint {
    pub place: Point3<f64>,
    pub normal: Vector3<f64>,
}

impl OrientedPoint {
    /// Squared distance of two oriented points: that of the positions plus that of the normals, the
    /// latter up to 4.
    #[inline]
    pub fn square(&self, other: &Self) -> f64 {
        (self.place - other.place).norm_squared() + (self.normal - other.normal).norm_squared()
    }
}
