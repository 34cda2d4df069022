//! Intersection test of a triangle and an axis-aligned box.

use nalgebra::{Point3, Vector3};

use crate::mesh::measures::max_or_nan;

/// Upper bound of the rounding error of a product of two coordinate differences, relative to the
/// lengths.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// True if triangle `t` possibly intersects the box about `centre` with half sides `half` [m], by
/// separating axes \[ericson2005\].
///
/// False is certain: cases within rounding return true.
pub(crate) fn may_meet(t: &[Point3<f64>; 3], centre: &Point3<f64>, half: &Vector3<f64>) -> bool {
    let v = t.map(|p| p - centre);
    let apart = |axis: &Vector3<f64>, doubt: f64| {
        let along = v.map(|v| v.dot(axis));
        let radius = half.dot(&axis.abs()) + doubt;
        let (low, high) = (
            along[0].min(along[1]).min(along[2]),
            along[0].max(along[1]).max(along[2]),
        );
        low > radius || high < -radius
    };
    if (0..3).any(|k| apart(&Vector3::ith(k, 1.0), 0.0)) {
        return false;
    }
    let reach = max_or_nan(v.iter().map(Vector3::norm));
    let sides: [Vector3<f64>; 3] = std::array::from_fn(|k| v[(k + 1) % 3] - v[k]);
    // The normal of a sliver is rounding error; the lengths of its sides bound it.
    let doubt = ROUNDING * reach * sides[0].norm() * sides[2].norm();
    if apart(&sides[0].cross(&sides[1]), doubt) {
        return false;
    }
    sides.iter().all(|side| {
        let doubt = ROUNDING * reach * side.norm();
        (0..3).all(|k| !apart(&side.cross(&Vector3::ith(k, 1.0)), doubt))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::nearest::{on_triangle, point_at};
    use crate::testing::Draw;

    /// True if some point of a lattice on the triangle lies in the box.
    fn sampled(t: &[Point3<f64>; 3], centre: &Point3<f64>, half: &Vector3<f64>) -> bool {
        let parts = 60;
        (0..=parts).any(|i| {
            (0..=parts - i).any(|j| {
                let (u, v) = (
                    f64::from(i) / f64::from(parts),
                    f64::from(j) / f64::from(parts),
                );
                let d = point_at(t, &[1.0 - u - v, u, v]) - centre;
                (0..3).all(|k| d[k].abs() <= half[k])
            })
        })
    }

    #[test]
    fn a_no_is_certain_and_a_yes_is_near() {
        let mut draw = Draw::new(71);
        let mut seen = [0; 2];
        for _ in 0..3000 {
            let flat = if draw.index(3) == 0 { 1e-13 } else { 1.0 };
            let mut t: [Point3<f64>; 3] = std::array::from_fn(|k| draw.shape(3)[k]);
            t[2] = t[0] + (t[1] - t[0]) * 0.4 + (t[2] - t[0]) * flat;
            let centre = Point3::from(draw.direction() * draw.between(0.0, 1.5));
            let half = Vector3::from_fn(|_, _| draw.between(0.01, 0.5));
            let found = may_meet(&t, &centre, &half);
            seen[usize::from(found)] += 1;
            if found {
                // The nearest point to the centre is no farther than the corners.
                let nearest = point_at(&t, &on_triangle(&centre, &t).0);
                assert!((nearest - centre).norm() <= half.norm() * (1.0 + 1e-12));
            } else {
                assert!(
                    !sampled(&t, &centre, &half),
                    "seed {}: {t:?} {centre} {half}",
                    draw.seed
                );
            }
        }
        assert!(seen[0] > 100 && seen[1] > 100, "{seen:?}");
    }

    #[test]
    fn a_triangle_past_an_edge_of_the_box_misses_it() {
        // Only a product of two edges separates these; bounds and plane do not.
        let half = Vector3::repeat(1.0);
        let t = |by: f64| {
            [
                Point3::new(by, 0.0, -3.0),
                Point3::new(0.0, by, 3.0),
                Point3::new(by + 3.0, by + 3.0, 0.0),
            ]
        };
        assert!(!may_meet(&t(2.5), &Point3::origin(), &half));
        assert!(may_meet(&t(1.5), &Point3::origin(), &half));
    }
}
