//! Measures of each single fibre.

use super::polyline::{length, resample};
use crate::mesh::measures::median;
use nalgebra::{Point3, Vector3};

/// Cosine of the angle between two directions of a fibre that turns back: 120 degrees.
const BACK: f64 = -0.5;

/// A straight tendon, from the end of a fibre to a patch.
pub type Tendon = [Point3<f64>; 2];

/// Measures of one fibre.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FibreMeasures {
    /// Length without tendons [m].
    pub length_m: f64,
    /// Distance between the ends [m].
    pub chord_m: f64,
    /// Mean angle to the line of action along the fibre [rad].
    pub pennation_rad: f64,
    /// Length of the tendon at the origin [m]; 0 without one.
    pub tendon_origin_m: f64,
    /// Length of the tendon at the insertion [m]; 0 without one.
    pub tendon_insertion_m: f64,
}

/// Vector from the mean of all origins to the mean of all insertions, times the number of fibres
/// [m].
pub fn action(fibres: &[Vec<Point3<f64>>]) -> Vector3<f64> {
    let at = |p: Option<&Point3<f64>>| p.map_or_else(Vector3::zeros, |p| p.coords);
    fibres.iter().map(|f| at(f.last()) - at(f.first())).sum()
}

/// Integral of the angle to the line of action along a fibre [rad m].
pub fn turned(fibre: &[Point3<f64>], action: &Vector3<f64>) -> f64 {
    let angle = |along: Vector3<f64>| {
        along.norm() * libm::atan2(along.cross(action).norm(), along.dot(action))
    };
    fibre.windows(2).map(|s| angle(s[1] - s[0])).sum()
}

/// Angles between the last 0.5 % of a line, at either end, and its direction from 6 to 10 % before
/// that end [rad]: a hook where a fibre meets its area. `None` for a line without length.
pub fn end_tilts(line: &[Point3<f64>]) -> Option<[f64; 2]> {
    // As many points as make the smallest share two of their distances.
    let points = resample(line, 401);
    let between = |a: usize, b: usize| points.get(b).zip(points.get(a)).map(|(b, a)| b - a);
    let angle = |a: Vector3<f64>, b: Vector3<f64>| libm::atan2(a.cross(&b).norm(), a.dot(&b));
    let tilts = [
        angle(between(0, 2)?, between(24, 40)?),
        angle(between(398, 400)?, between(360, 376)?),
    ];
    (length(line) > 0.0).then_some(tilts)
}

/// Above this median angle at their ends, lines end in hooks [degrees].
pub const HOOK_DEG: f64 = 30.0;

/// Median of the angles of [`end_tilts`] over both ends of all lines [rad]; NaN without lines.
pub fn median_tilt(lines: &[Vec<Point3<f64>>]) -> f64 {
    let tilts = lines.iter().filter_map(|line| end_tilts(line));
    median(tilts.flatten().collect()).unwrap_or(f64::NAN)
}

/// True if a fibre turns back: two of its directions, over twentieths of its length without the
/// first and the last, are more than 120 degrees apart.
pub fn turns_back(line: &[Point3<f64>]) -> bool {
    let points = resample(line, 21);
    let steps: Vec<Vector3<f64>> = points.windows(2).map(|s| s[1] - s[0]).collect();
    let inner = steps
        .get(1..steps.len().saturating_sub(1))
        .unwrap_or_default();
    inner.iter().enumerate().any(|(k, a)| {
        inner[k + 1..]
            .iter()
            .any(|b| a.dot(b) < BACK * a.norm() * b.norm())
    })
}

/// Measures each fibre. `tendons` holds one tendon per fibre or none; `along` is the line of action,
/// or `None` for that of the fibres.
pub fn measure_fibres(
    fibres: &[Vec<Point3<f64>>],
    tendons: &[Vec<Tendon>; 2],
    along: Option<Vector3<f64>>,
) -> Vec<FibreMeasures> {
    let action = along.unwrap_or_else(|| action(fibres));
    let tendon = |end: usize, k: usize| tendons[end].get(k).map_or(0.0, |[a, b]| (b - a).norm());
    let one = |(k, fibre): (usize, &Vec<Point3<f64>>)| {
        let length_m = length(fibre);
        let ends = fibre.first().zip(fibre.last());
        FibreMeasures {
            length_m,
            chord_m: ends.map_or(0.0, |(a, b)| (b - a).norm()),
            pennation_rad: if length_m > 0.0 {
                turned(fibre, &action) / length_m
            } else {
                0.0
            },
            tendon_origin_m: tendon(0, k),
            tendon_insertion_m: tendon(1, k),
        }
    };
    fibres.iter().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_and_a_straight_fibre() {
        let p = |x: f64, y: f64| Point3::new(x, y, 0.0);
        // Up, along and down again: half of its length at a right angle to the line of action.
        let fibres = vec![
            vec![p(0.0, 0.0), p(0.0, 1.0), p(2.0, 1.0), p(2.0, 0.0)],
            vec![p(0.0, 3.0), p(2.0, 3.0)],
        ];
        let tendons = [
            vec![[p(0.0, 0.0), p(-0.5, 0.0)], [p(0.0, 3.0), p(-3.0, 7.0)]],
            Vec::new(),
        ];
        let found = measure_fibres(&fibres, &tendons, None);
        let quarter = std::f64::consts::FRAC_PI_4;
        let expected = [[4.0, 2.0, quarter, 0.5, 0.0], [2.0, 2.0, 0.0, 5.0, 0.0]];
        for (e, expected) in found.iter().zip(expected) {
            let numbers = [
                e.length_m,
                e.chord_m,
                e.pennation_rad,
                e.tendon_origin_m,
                e.tendon_insertion_m,
            ];
            // A few roundings of a size of 5.
            assert!(
                numbers
                    .iter()
                    .zip(expected)
                    .all(|(a, b)| (a - b).abs() <= 40.0 * f64::EPSILON),
                "{e:?}"
            );
        }
    }
}
