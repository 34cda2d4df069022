//! Places of surfaces, told apart by where they lie and by which way they face.

use nalgebra::{Point3, Vector3};

/// A place over a length that the user chooses, and the normal there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    pub place: Point3<f64>,
    pub normal: Vector3<f64>,
}

impl Spot {
    /// Square of how far apart two are: that of the places, and of the normals, up to 4.
    #[inline]
    pub fn square(&self, other: &Self) -> f64 {
        (self.place - other.place).norm_squared() + (self.normal - other.normal).norm_squared()
    }
}
