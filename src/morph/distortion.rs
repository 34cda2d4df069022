//! Distortion of triangles by a map.

use nalgebra::Point3;

use crate::mesh::measures::{max_or_nan, median, triangle_areas};

/// Distortion of the triangles by a map between two sets of positions; triangles without area in
/// either set are left out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Ratio of the greater to the smaller stretch, 1 for a similarity: median over triangles.
    pub conformal_median: f64,
    /// Greatest ratio of the stretches.
    pub conformal_max: f64,
    /// Ratio of the relative areas after and before, or its inverse if greater: median over
    /// triangles.
    pub area_median: f64,
    /// Greatest ratio of the relative areas.
    pub area_max: f64,
    /// Number of triangles without area before or after.
    pub without_area: usize,
}

impl Distortion {
    /// Measures the affine maps of all triangles.
    pub fn of(before: &[Point3<f64>], after: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let (mut shapes, mut sizes) = (Vec::new(), Vec::new());
        for (t, share) in triangles.iter().zip(area_shares(before, after, triangles)) {
            if let (Some(shape), true) = (
                stretches_apart(before, after, t),
                share > 0.0 && share.is_finite(),
            ) {
                shapes.push(shape);
                sizes.push(share.max(share.recip()));
            }
        }
        Self {
            without_area: triangles.len() - shapes.len(),
            conformal_max: max_or_nan(shapes.iter().copied()),
            area_max: max_or_nan(sizes.iter().copied()),
            conformal_median: median(shapes).unwrap_or(1.0),
            area_median: median(sizes).unwrap_or(1.0),
        }
    }
}

/// Ratio of each triangle's share of the total area after and before.
pub fn area_shares(
    before: &[Point3<f64>],
    after: &[Point3<f64>],
    triangles: &[[u32; 3]],
) -> Vec<f64> {
    let [old, new] = [before, after].map(|x| triangle_areas(x, triangles));
    let whole = old.iter().sum::<f64>() / new.iter().sum::<f64>();
    old.iter().zip(&new).map(|(a, b)| b / a * whole).collect()
}

/// Ratio of the greater to the smaller singular value of a triangle's affine map, from the first
/// fundamental forms E before and F after. The squared singular values are the eigenvalues of E^-1
/// F. `None` without area.
fn stretches_apart(before: &[Point3<f64>], after: &[Point3<f64>], t: &[u32; 3]) -> Option<f64> {
    let form = |x: &[Point3<f64>]| {
        let [a, b, c] = t.map(|v| x[v as usize]);
        let (u, v) = (b - a, c - a);
        (
            u.norm_squared(),
            u.dot(&v),
            v.norm_squared(),
            u.cross(&v).norm_squared(),
        )
    };
    let ((e, f, g, area), (p, q, r, other)) = (form(before), form(after));
    let root = (area * other).sqrt();
    if !(root > 0.0) {
        return None;
    }
    // Half the trace over the root of the determinant of E^-1 F is cosh of the logarithm of the
    // ratio.
    let half = (0.5 * (p * g - 2.0 * q * f + r * e) / root).max(1.0);
    Some(half + (half * half - 1.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn what_is_stretched_by_three_is_distorted_by_three() {
        let flat: Vec<Point3<f64>> = [[0.0, 0.0], [1.0, 0.2], [0.3, 1.1], [1.2, 1.4]]
            .map(|[x, y]| Point3::new(x, y, 0.0))
            .to_vec();
        let triangles = [[0, 1, 2], [1, 3, 2]];
        let stretched: Vec<Point3<f64>> = flat
            .iter()
            .map(|p| Point3::new(3.0 * p.x, p.y, 5.0))
            .collect();
        let found = Distortion::of(&flat, &stretched, &triangles);
        assert!(
            (found.conformal_median - 3.0).abs() < 1e-12
                && (found.conformal_max - 3.0).abs() < 1e-12
        );
        assert!((found.area_max - 1.0).abs() < 1e-12, "all by the same");
        let ball = icosphere(1.0, 2);
        let twice: Vec<Point3<f64>> = ball.vertices.iter().map(|p| p * 2.0).collect();
        let same = Distortion::of(&ball.vertices, &twice, &ball.triangles);
        assert!((same.conformal_max - 1.0).abs() < 1e-7 && (same.area_max - 1.0).abs() < 1e-12);
    }

    #[test]
    fn triangles_without_area_are_counted() {
        let x = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [2.0, 0.0, 0.0],
        ]
        .map(Point3::from);
        let found = Distortion::of(&x, &x, &[[0, 1, 2], [0, 1, 3]]);
        assert_eq!((found.without_area, found.conformal_max), (1, 1.0));
        let none = Distortion::of(&x, &x, &[[0, 1, 3]]);
        assert_eq!((none.conformal_median, none.area_median), (1.0, 1.0));
    }
}
