//! The press: a muscle-like body and a plate that moves onto it.

use nalgebra::Point3;

use super::box_surface;
use crate::mesh::{TriangleMesh, isosurface, refine};

/// Half of length, thickness and width of the muscle [m].
const HALF: [f64; 3] = [0.1, 0.02, 0.03];
/// Between an ellipsoid (2) and a box (infinity).
const EXPONENT: f64 = 2.5;
const EDGE: f64 = 0.004;
/// Size of the plate [m].
const PLATE: [f64; 3] = [0.7, 0.02, 0.4];

/// A rounded body, 200 mm along x, 40 mm thick along y, 60 mm wide along z, centred at the origin.
pub(super) fn muscle() -> TriangleMesh {
    let margin = 2.0 * EDGE;
    let corner = Point3::from(HALF.map(|h| h + margin));
    let surface = isosurface(muscle_field, -corner, corner, EDGE);
    // A surface made by isosurface is closed and oriented; the tests of this file verify it.
    refine(&surface, EDGE).map_or(surface, |refined| refined.mesh)
}

/// Zero on the surface, with a gradient of about 1 across the thickness.
fn muscle_field(p: Point3<f64>) -> f64 {
    let sum: f64 = (0..3)
        .map(|k| libm::pow(p[k].abs() / HALF[k], EXPONENT))
        .sum();
    HALF[1] * (libm::pow(sum, 1.0 / EXPONENT) - 1.0)
}

/// A box centred at the origin, with its large faces normal to y and edges of 10 mm. At a tenth of
/// its thickness the muscle covers ten times its area, which stays between the plates.
pub(super) fn plate() -> TriangleMesh {
    box_surface(PLATE, 0.01)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;

    #[test]
    fn muscle_is_even_and_of_the_stated_size() {
        let m = muscle();
        assert!(m.vertices.len() >= 1500, "{}", m.vertices.len());
        let size = m.bounding_box().extents();
        for (k, half) in HALF.iter().enumerate() {
            assert!((size[k] - 2.0 * half).abs() < 1e-3, "{size:?}");
        }
        assert!(m.bounding_box().center().coords.norm() < 5e-4);
        let angle = m
            .smallest_angles()
            .into_iter()
            .fold(f64::INFINITY, f64::min)
            .to_degrees();
        let lengths = Topology::new(&m).edge_lengths(&m);
        let (shortest, longest) = lengths
            .iter()
            .fold((f64::INFINITY, 0.0f64), |(s, l), &e| (s.min(e), l.max(e)));
        println!(
            "{} vertices, edges {:.2}..{:.2} mm, angle {angle:.1}",
            m.vertices.len(),
            1e3 * shortest,
            1e3 * longest
        );
        assert!(angle > 20.0 && shortest > 0.3 * EDGE && longest < 1.6 * EDGE);
    }

    #[test]
    fn plate_is_flat() {
        let m = plate();
        let b = m.bounding_box();
        assert!((b.extents() - nalgebra::Vector3::from(PLATE)).norm() < 1e-15);
        assert!((m.volume() - PLATE.iter().product::<f64>()).abs() < 1e-15);
        let on_face = m.vertices.iter().filter(|p| p.y == b.max.y).count();
        assert_eq!(on_face, 71 * 41);
    }
}
