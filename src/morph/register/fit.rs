//! The best-fitting similarity between points, and the number of draws of RANSAC.

use nalgebra::{Isometry3, Matrix3, Point3, Similarity3, Translation3, Vector3};

use super::super::align::rotation_of;

/// Degrees of freedom of a registration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FitMotion {
    /// Rotation and translation.
    #[default]
    Rigid,
    /// Rotation, translation and scale.
    Similarity,
}

/// The motion with the least weighted sum of squared distances from `from` to `to` \[umeyama1991\];
/// `None` where none is defined: all points coincide, or all weights are 0.
pub fn fit(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    weights: &[f64],
    motion: FitMotion,
) -> Option<Similarity3<f64>> {
    let total: f64 = weights.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let middle = |points: &[Point3<f64>]| {
        points
            .iter()
            .zip(weights)
            .map(|(p, w)| p.coords * *w)
            .sum::<Vector3<f64>>()
            / total
    };
    let (a, b) = (middle(from), middle(to));
    let (mut product, mut square, mut other) = (Matrix3::zeros(), 0.0, 0.0);
    for ((p, q), w) in from.iter().zip(to).zip(weights) {
        let (p, q) = (p.coords - a, q.coords - b);
        product += q * p.transpose() * *w;
        square += p.norm_squared() * w;
        other += q.norm_squared() * w;
    }
    if !(square > 0.0 && other > 0.0) {
        return None;
    }
    let rotation = rotation_of(&product);
    let scale = match motion {
        FitMotion::Rigid => 1.0,
        FitMotion::Similarity => {
            (rotation.to_rotation_matrix().matrix().transpose() * product).trace() / square
        }
    };
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let shift = b - rotation * a * scale;
    Some(Similarity3::from_isometry(
        Isometry3::from_parts(Translation3::from(shift), rotation),
        scale,
    ))
}

/// Number of draws of `count` points, with a share `good` of good points, such that at least one
/// draw has only good points with probability `sure`: ln(1 - z)/ln(1 - w^N).
///
/// The printed log(1 - z) E(k) is negative (M9).
pub fn draws_needed(good: f64, count: u32, sure: f64) -> f64 {
    (1.0 - sure).ln() / (-good.powi(count as i32)).ln_1p()
}
