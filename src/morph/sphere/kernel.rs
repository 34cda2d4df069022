//! The kernel of a spherical polygon: the points that see the whole polygon.

use nalgebra::{Point3, Vector3};

use super::surface::turn;

/// Below this value a determinant of three unit vectors can have the wrong sign: about 24 roundings
/// of terms up to 1.
const CERTAIN: f64 = 1e-14;

/// True if all triangles of a fan from `at` to a ring are oriented outward, exactly.
pub fn sees(at: &Point3<f64>, ring: &[Point3<f64>]) -> bool {
    (0..ring.len()).all(|i| {
        let (a, b) = (&ring[i], &ring[if i + 1 == ring.len() { 0 } else { i + 1 }]);
        a.coords.cross(&b.coords).dot(&at.coords) > CERTAIN || turn(a, b, at) > 0.0
    })
}

/// Height of the cone that contains the kernel, relative to its half side. The cone is slightly
/// smaller than the hemisphere: two sides of a hemisphere would meet a plane in opposite rays
/// without a connection.
const HEIGHT: f64 = 0.05;

/// Corners of the kernel of a ring within nearly the hemisphere about `near`, as unit vectors in
/// order.
pub fn kernel(near: &Point3<f64>, ring: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let axis = near.coords;
    let aside = Vector3::ith(axis.iamin(), 1.0);
    let u = axis.cross(&aside).normalize();
    let v = axis.cross(&u);
    let mut corners = [u, v, -u, -v].map(|side| axis * HEIGHT + side).to_vec();
    let mut next = Vec::with_capacity(ring.len() + 4);
    for i in 0..ring.len() {
        let normal = ring[i].coords.cross(&ring[(i + 1) % ring.len()].coords);
        next.clear();
        for k in 0..corners.len() {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            let (above, following) = (normal.dot(&a), normal.dot(&b));
            if above >= 0.0 {
                next.push(a);
            }
            if (above > 0.0 && following < 0.0) || (above < 0.0 && following > 0.0) {
                next.extend((a * following.abs() + b * above.abs()).try_normalize(0.0));
            }
        }
        std::mem::swap(&mut corners, &mut next);
    }
    corners
}

/// Centroid of a convex spherical polygon, weighted by the area of its chords.
pub fn middle(corners: &[Vector3<f64>]) -> Option<Point3<f64>> {
    let first = corners.first()?;
    let mut sum = Vector3::zeros();
    for pair in corners[1..].windows(2) {
        let area = (pair[0] - first).cross(&(pair[1] - first)).norm();
        sum += (first + pair[0] + pair[1]) * area;
    }
    let sum = sum
        .try_normalize(0.0)
        .or_else(|| corners.iter().sum::<Vector3<f64>>().try_normalize(0.0));
    sum.map(Point3::from)
}
