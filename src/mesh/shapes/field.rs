//! Signed distances [m] of simple bodies, negative inside, and smooth combinations of them.

use nalgebra::Point3;

use crate::mesh::closest::closest_on_triangle;

/// A point given in millimetres.
pub(super) fn mm(x: f64, y: f64, z: f64) -> Point3<f64> {
    Point3::new(1e-3 * x, 1e-3 * y, 1e-3 * z)
}

pub(super) fn sphere(p: &Point3<f64>, center: &Point3<f64>, radius: f64) -> f64 {
    (p - center).norm() - radius
}

/// A segment with a radius that changes linearly along it.
pub(super) fn capsule(
    p: &Point3<f64>,
    [a, b]: &[Point3<f64>; 2],
    [radius_a, radius_b]: [f64; 2],
) -> f64 {
    let along = b - a;
    let t = ((p - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (p - (a + along * t)).norm() - (radius_a + (radius_b - radius_a) * t)
}

/// A triangle with a radius around it.
pub(super) fn plate(p: &Point3<f64>, corners: &[Point3<f64>; 3], radius: f64) -> f64 {
    (p - closest_on_triangle(p, corners)).norm() - radius
}

/// The smaller of two, rounded where they differ by less than `blend` [m]; never above the smaller.
pub(super) fn join(a: f64, b: f64, blend: f64) -> f64 {
    let overlap = (blend - (a - b).abs()).max(0.0) / blend;
    a.min(b) - 0.25 * blend * overlap * overlap
}

/// The larger of two, rounded where they differ by less than `blend` [m]; never below the larger.
pub(super) fn meet(a: f64, b: f64, blend: f64) -> f64 {
    -join(-a, -b, blend)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn distances() {
        let p = mm(3.0, 4.0, 0.0);
        assert!((sphere(&p, &Point3::origin(), 1e-3) - 4e-3).abs() < 1e-15);
        let segment = [mm(0.0, -10.0, 0.0), mm(0.0, 10.0, 0.0)];
        assert!((capsule(&p, &segment, [1e-3, 2e-3]) - 1.3e-3).abs() < 1e-15);
        let corners = [mm(0.0, 0.0, 1.0), mm(9.0, 0.0, 1.0), mm(0.0, 9.0, 1.0)];
        assert!((plate(&p, &corners, 0.4e-3) - 0.6e-3).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn joins_bound_and_blend(a in -1.0f64..1.0, b in -1.0f64..1.0, blend in 0.01f64..0.5) {
            let j = join(a, b, blend);
            prop_assert!(j <= a.min(b) && j >= a.min(b) - 0.25 * blend);
            prop_assert_eq!(j, join(b, a, blend));
            prop_assert!((a - b).abs() < blend || j == a.min(b));
            prop_assert!(meet(a, b, blend) >= a.max(b));
        }
    }
}
