//! Stretch of a spherical triangle relative to the surface, with the derivatives for Newton's
//! method.
//!
//! The energy is that of \[sander2001\]: a / (8 A^2) times the sum of d_k l_k over the corners k.
//! Here a is the area of the triangle on the surface, A that on the sphere, d_k the dot product of
//! the two edges at corner k on the sphere and l_k the squared length of the opposite edge on the
//! surface. The energy grows without bound as a spherical triangle closes, most where much surface
//! has little room. Room thus goes where the surface is, and long bodies do not collapse into two
//! clusters, as in conformal maps.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

/// A triangle (v, a, b) on the surface, \[m^2\].
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// Squared lengths of the edges opposite v, a and b.
    pub squares: [f64; 3],
    /// Area.
    pub area: f64,
}

impl Patch {
    /// Creates a patch from three points of the surface; `least` \[m^2\] prevents triangles without
    /// area from vanishing on the sphere.
    pub fn new(v: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>, least: f64) -> Self {
        let squares = [
            (a - b).norm_squared() + least,
            (b - v).norm_squared() + least,
            (v - a).norm_squared() + least,
        ];
        Self {
            squares,
            area: 0.5 * (a - v).cross(&(b - v)).norm() + least,
        }
    }
}

/// Energy, gradient and Hessian in two directions perpendicular to the vertex.
#[derive(Clone, Copy, Debug)]
pub struct Stretch {
    pub energy: f64,
    pub gradient: Vector2<f64>,
    pub hessian: Matrix2<f64>,
}

/// Energy of the triangles between `v` and its `ring`, for Newton's method in the directions `frame`.
pub fn stretch(
    v: &Point3<f64>,
    ring: &[Point3<f64>],
    patches: &[Patch],
    frame: &[Vector3<f64>; 2],
) -> Stretch {
    let mut sum = Stretch {
        energy: 0.0,
        gradient: Vector2::zeros(),
        hessian: Matrix2::zeros(),
    };
    for (i, patch) in patches.iter().enumerate() {
        let (a, b) = (&ring[i], &ring[if i + 1 == ring.len() { 0 } else { i + 1 }]);
        let [lv, la, lb] = patch.squares;
        let (va, vb, ab) = (a - v, b - v, b - a);
        let w = va.cross(&vb);
        let q = w.norm_squared();
        let n = lv * va.dot(&vb) - la * va.dot(&ab) + lb * vb.dot(&ab);
        let across = w.cross(&ab);
        let of_n = (va + vb) * -lv + ab * (la - lb);
        // All terms below are in the two directions only.
        let dn = Vector2::new(of_n.dot(&frame[0]), of_n.dot(&frame[1]));
        let dq = 2.0 * Vector2::new(across.dot(&frame[0]), across.dot(&frame[1]));
        let along = Vector2::new(ab.dot(&frame[0]), ab.dot(&frame[1]));
        let ddq = 2.0 * (Matrix2::identity() * ab.norm_squared() - along * along.transpose());
        let (mixed, squared) = (dn * dq.transpose(), dq * dq.transpose());
        // The constant 1/8 and half of the area do not affect the minimiser.
        sum.energy += patch.area * n / q;
        sum.gradient += (dn - dq * (n / q)) * (patch.area / q);
        let bent =
            Matrix2::identity() * (2.0 * lv) - (mixed + mixed.transpose()) / q - ddq * (n / q)
                + squared * (2.0 * n / (q * q));
        sum.hessian += bent * (patch.area / q);
    }
    sum
}

/// The energy alone.
pub fn energy(v: &Point3<f64>, ring: &[Point3<f64>], patches: &[Patch]) -> f64 {
    let mut sum = 0.0;
    for (i, patch) in patches.iter().enumerate() {
        let (a, b) = (&ring[i], &ring[if i + 1 == ring.len() { 0 } else { i + 1 }]);
        let [lv, la, lb] = patch.squares;
        let (va, vb, ab) = (a - v, b - v, b - a);
        let n = lv * va.dot(&vb) - la * va.dot(&ab) + lb * vb.dot(&ab);
        sum += patch.area * n / va.cross(&vb).norm_squared();
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A vertex with a ring of five on the sphere, and their triangles on a surface.
    fn star() -> (Point3<f64>, Vec<Point3<f64>>, Vec<Patch>) {
        let on = |x: f64, y: f64| Point3::from(Vector3::new(x, y, 1.0).normalize());
        let ring = [
            (0.3, 0.05),
            (0.1, 0.2),
            (-0.25, 0.1),
            (-0.2, -0.2),
            (0.15, -0.3),
        ]
        .map(|(x, y)| on(x, y));
        let place = |p: &Point3<f64>| Point3::new(p.x * 2.0, p.y * 0.7, p.x * p.y);
        let v = on(0.02, 0.01);
        let patches = (0..5).map(|i| {
            Patch::new(
                &place(&v),
                &place(&ring[i]),
                &place(&ring[(i + 1) % 5]),
                1e-6,
            )
        });
        (v, ring.to_vec(), patches.collect())
    }

    #[test]
    fn derivatives_are_those_of_the_energy() {
        let (v, ring, patches) = star();
        let frame = [Vector3::x(), Vector3::y()];
        let exact = stretch(&v, &ring, &patches, &frame);
        assert!((exact.energy - energy(&v, &ring, &patches)).abs() < 1e-14 * exact.energy);
        let h = 1e-5;
        let at = |d: Vector2<f64>| {
            stretch(
                &(v + frame[0] * d.x + frame[1] * d.y),
                &ring,
                &patches,
                &frame,
            )
        };
        for k in 0..2 {
            let step = Vector2::ith(k, h);
            let (high, low) = (at(step), at(-step));
            let slope = (high.energy - low.energy) / (2.0 * h);
            assert!(
                (slope - exact.gradient[k]).abs() < 1e-6 * exact.gradient.norm(),
                "{slope} {}",
                exact.gradient
            );
            let bend = (high.gradient - low.gradient) / (2.0 * h);
            assert!((bend - exact.hessian.column(k)).norm() < 1e-6 * exact.hessian.norm());
        }
        assert!(exact.gradient.norm() > 0.0 && exact.hessian.determinant() > 0.0);
    }

    #[test]
    fn a_triangle_that_closes_costs_without_bound() {
        let (v, ring, patches) = star();
        let edge = ring[0] + (ring[1] - ring[0]) * 0.5;
        let near = |t: f64| energy(&(edge + (v - edge) * t), &ring, &patches);
        assert!(near(1e-3) > 1e4 * near(1.0) && near(1e-6) > 1e5 * near(1e-3));
    }
}
