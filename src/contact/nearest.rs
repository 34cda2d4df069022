//! The nearest point of a triangle.

use nalgebra::{Point3, Vector3};

/// The part of a triangle that contains a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Feature {
    /// Corner 0, 1 or 2.
    Corner(usize),
    /// Side from corner k to corner k + 1.
    Side(usize),
    /// The inside.
    Face,
}

/// Barycentric weights of the nearest point of triangle `t`, and the feature that contains it
/// \[ericson2005\].
pub(crate) fn on_triangle(p: &Point3<f64>, t: &[Point3<f64>; 3]) -> ([f64; 3], Feature) {
    let [a, b, c] = t;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ([1.0, 0.0, 0.0], Feature::Corner(0));
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return ([0.0, 1.0, 0.0], Feature::Corner(1));
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return ([1.0 - v, v, 0.0], Feature::Side(0));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return ([0.0, 0.0, 1.0], Feature::Corner(2));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return ([1.0 - w, 0.0, w], Feature::Side(2));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return ([0.0, 1.0 - w, w], Feature::Side(1));
    }
    let denominator = va + vb + vc;
    let (v, w) = (vb / denominator, vc / denominator);
    ([1.0 - v - w, v, w], Feature::Face)
}

/// The point with barycentric `weights`.
pub(super) fn point_at(t: &[Point3<f64>; 3], weights: &[f64; 3]) -> Point3<f64> {
    t[0] + (t[1] - t[0]) * weights[1] + (t[2] - t[0]) * weights[2]
}

/// Twice the area of a triangle times its unit normal.
pub(super) fn area_normal(t: &[Point3<f64>; 3]) -> Vector3<f64> {
    (t[1] - t[0]).cross(&(t[2] - t[0]))
}

/// Inner angle at corner `k` [rad].
pub(super) fn angle_at(t: &[Point3<f64>; 3], k: usize) -> f64 {
    let (u, v) = (t[(k + 1) % 3] - t[k], t[(k + 2) % 3] - t[k]);
    libm::atan2(u.cross(&v).norm(), u.dot(&v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    #[test]
    fn no_point_of_the_triangle_is_nearer() {
        let mut draw = Draw::new(11);
        for _ in 0..2000 {
            let t: [Point3<f64>; 3] = std::array::from_fn(|k| draw.shape(3)[k]);
            let p = Point3::from(draw.direction() * draw.between(0.0, 3.0));
            let (weights, _) = on_triangle(&p, &t);
            assert!(weights.iter().all(|w| (-1e-12..=1.0 + 1e-12).contains(w)));
            let nearest = (point_at(&t, &weights) - p).norm();
            for _ in 0..50 {
                let (u, v) = (draw.between(0.0, 1.0), draw.between(0.0, 1.0));
                let (u, v) = if u + v > 1.0 {
                    (1.0 - u, 1.0 - v)
                } else {
                    (u, v)
                };
                let other = (point_at(&t, &[1.0 - u - v, u, v]) - p).norm();
                assert!(nearest <= other + 1e-12);
            }
        }
    }
}
