//! Directions in which contact blocks vertices.

use nalgebra::Vector3;

use crate::particles::Slot;

/// Vertices, each with the normal of a plane that it must not cross.
pub struct ActiveNormals(pub(super) Vec<(u32, Vector3<f64>)>);

impl ActiveNormals {
    /// Removes the components that would push vertices into a bone from a displacement field; the
    /// displacement will be `sign` times a positive multiple of the field.
    pub fn restrict(&self, field: &mut [Slot], sign: f64) {
        // The second pass undoes conflicts between the planes of two bones; vertices with a
        // conflict after it stay in place.
        for pass in 0..3 {
            for (v, normal) in &self.0 {
                let Slot([x, y, z, _]) = &mut field[*v as usize];
                let mut d = Vector3::new(*x, *y, *z);
                bar(&mut d, sign, normal, pass == 2);
                (*x, *y, *z) = (d.x, d.y, d.z);
            }
        }
    }
}

/// Removes the component of `d` against `normal`; with `still`, removes all of `d` if such a
/// component remains.
fn bar(d: &mut Vector3<f64>, sign: f64, normal: &Vector3<f64>, still: bool) {
    let along = sign * d.dot(normal);
    if along < 0.0 {
        if still && along < -1e-9 * d.norm() {
            *d = Vector3::zeros();
        } else {
            *d -= normal * (sign * along);
        }
    }
}
