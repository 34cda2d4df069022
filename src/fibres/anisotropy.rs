//! Stiffness of an edge by its angle to the nearest fibre: `1 - A |u.v|^power`.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Factor 0..1 for each edge: 1 - A |u.v|^power with unit vectors u along the edge and v along the nearest fibre
/// segment (erratum A12: without the absolute value half of all edges would get more than 1). Edges without length
/// and muscles without fibres keep 1.
pub fn factors(
    vertices: &[Point3<f64>],
    edges: &[[u32; 2]],
    fibres: &[Vec<Point3<f64>>],
    strength: f64,
    power: f64,
) -> Vec<f64> {
    let segments: Vec<[Point3<f64>; 2]> =
        fibres.iter().flat_map(|line| line.windows(2).map(|s| [s[0], s[1]])).filter(|[a, b]| a != b).collect();
    edges
        .par_iter()
        .map(|&[a, b]| {
            let (a, b) = (vertices[a as usize], vertices[b as usize]);
            let middle = nalgebra::center(&a, &b);
            let Some(v) = nearest_direction(&middle, &segments) else { return 1.0 };
            let Some(u) = (b - a).try_normalize(0.0) else { return 1.0 };
            factor(&u, &v, strength, power)
        })
        .collect()
}

/// The factor for unit directions `u` and `v`.
pub fn factor(u: &Vector3<f64>, v: &Vector3<f64>, strength: f64, power: f64) -> f64 {
    (1.0 - strength * u.dot(v).abs().min(1.0).powf(power)).clamp(0.0, 1.0)
}

fn nearest_direction(p: &Point3<f64>, segments: &[[Point3<f64>; 2]]) -> Option<Vector3<f64>> {
    let mut best: Option<(f64, Vector3<f64>)> = None;
    for [a, b] in segments {
        let along = b - a;
        let t = ((p - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        let squared = (a + along * t - p).norm_squared();
        if best.is_none_or(|(d, _)| squared < d) {
            best = Some((squared, along));
        }
    }
    best.and_then(|(_, along)| along.try_normalize(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    #[test]
    fn random_edges_have_mean_one_half_and_stay_in_range() {
        let mut draw = Draw::new(7);
        let v = Vector3::z();
        let mut sum = 0.0;
        let mut printed_form_exceeds = 0;
        for _ in 0..100_000 {
            let u = draw.direction();
            let k = factor(&u, &v, 1.0, 1.0);
            assert!((0.0..=1.0).contains(&k));
            sum += k;
            printed_form_exceeds += usize::from(1.0 - u.dot(&v) > 1.0);
        }
        assert!((sum / 1e5 - 0.5).abs() <= 0.005);
        // What the source prints gives half of all edges more than full stiffness.
        assert!(printed_form_exceeds > 49_000);
    }

    #[test]
    fn the_direction_is_that_of_the_nearest_fibre() {
        let p = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let fibres = vec![vec![p(0.0, 0.0), p(1.0, 0.0)], vec![p(0.0, 5.0), p(0.0, 6.0)]];
        let vertices = [p(0.0, 0.1), p(1.0, 0.1), p(0.1, 5.0), p(1.1, 5.0)];
        let k = factors(&vertices, &[[0, 1], [2, 3]], &fibres, 0.5, 1.0);
        assert!((k[0] - 0.5).abs() <= 1e-12 && (k[1] - 1.0).abs() <= 1e-12);
    }
}
