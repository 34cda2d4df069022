//! Deformation of one map onto another without a fold: local rotations from nearby targets, from
//! large to small radii.
//!
//! A single rotation cannot align the maps of two bodies: around a long body the map can be rotated
//! more at one station than at another, and thick ends take room from the middle. Here each point
//! has its own rotation, the one with the least sum of squares over the targets nearby. The weights
//! vanish at a radius, and the radius shrinks.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::sphere::kernel::{kernel, middle, sees};
use super::sphere::rings::Rings;
use super::sphere::{SphereMap, flipped};
use crate::mesh::measures::max_or_nan;

/// First and last radius of the neighbourhood, as chords of the unit sphere.
const RADII: [f64; 2] = [2.0, 0.5];
/// Number of steps from the first to the last radius.
const STEPS: usize = 6;
/// Regularisation of a rotation: a rotation costs the displacement of all points nearby plus this
/// multiple of it. Points move more easily than they rotate about themselves.
const HELD: f64 = 1.0;
/// Targets farther away than this have decreasing weights: bodies differ, and some matches are
/// wrong \[rad\].
const DOUBT: f64 = 0.3;
/// Greatest displacement relative to the radius; at twice this value points could pass each other.
const SHARE: f64 = 0.35;
/// Greatest number of halvings of a step that folds the map.
const HALVINGS: usize = 6;
/// Greatest number of passes over folded triangles.
const MENDS: usize = 20;

/// Target of a vertex of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    pub vertex: u32,
    pub to: Point3<f64>,
    pub weight: f64,
}

/// Deforms a map towards the targets of its vertices; `None` if that needs a fold.
pub fn warped(map: &SphereMap, targets: &[Target]) -> Option<SphereMap> {
    let rings = Rings::new(map.points().len(), map.triangles())?;
    let mut points = map.points().to_vec();
    for step in 0..STEPS {
        let radius = RADII[0] * libm::pow(RADII[1] / RADII[0], step as f64 / (STEPS - 1) as f64);
        let turns = turns(&points, targets, radius);
        let mut share = (SHARE * radius / max_or_nan(turns.iter().map(|t| t.norm()))).min(1.0);
        for _ in 0..HALVINGS {
            let turned = |(p, t): (&Point3<f64>, &Vector3<f64>)| {
                Point3::from((UnitQuaternion::from_scaled_axis(t * share) * p.coords).normalize())
            };
            let mut next: Vec<Point3<f64>> = points.iter().zip(&turns).map(turned).collect();
            if mended(&mut next, map.triangles(), &rings) {
                points = next;
                break;
            }
            share *= 0.5;
        }
    }
    SphereMap::new(points, map.triangles().to_vec()).ok()
}

/// The rotation vector that takes one unit vector to another, about the axis perpendicular to both
/// \[rad\].
fn between(from: &Vector3<f64>, to: &Vector3<f64>) -> Vector3<f64> {
    let axis = from.cross(to);
    let sine = axis.norm();
    if sine > 0.0 {
        axis * (libm::atan2(sine, from.dot(to)) / sine)
    } else {
        Vector3::zeros()
    }
}

/// The rotation of each point: the w with the least sum of k |w x q - r x q|^2 over the targets
/// nearby, where r takes q to its target and k is the weight.
fn turns(points: &[Point3<f64>], targets: &[Target], radius: f64) -> Vec<Vector3<f64>> {
    let springs_to_targets: Vec<(Vector3<f64>, Vector3<f64>, f64)> = targets
        .iter()
        .map(|target| {
            let from = points[target.vertex as usize].coords;
            let by = between(&from, &target.to.coords);
            (
                from,
                by,
                target.weight / (1.0 + by.norm_squared() / (DOUBT * DOUBT)),
            )
        })
        .collect();
    let at = |p: &Point3<f64>| {
        let (mut matrix, mut sum, mut total) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        for (q, by, weight) in &springs_to_targets {
            let near = 1.0 - (q - p.coords).norm_squared() / (radius * radius);
            if near > 0.0 {
                let k = near * near * weight;
                total += k;
                matrix -= q * q.transpose() * k;
                sum += by * k;
            }
        }
        matrix += Matrix3::identity() * (total * (1.0 + HELD));
        // Without targets there is no rotation.
        matrix
            .try_inverse()
            .map_or_else(Vector3::zeros, |inverse| inverse * sum)
    };
    points.par_iter().map(at).collect()
}

/// Moves vertices of reversed triangles to positions that see their rings. Returns true if no
/// reversed triangle remains.
fn mended(points: &mut [Point3<f64>], triangles: &[[u32; 3]], rings: &Rings) -> bool {
    let mut ring = Vec::new();
    for _ in 0..MENDS {
        let bad = flipped(points, triangles);
        if bad.is_empty() {
            return true;
        }
        for v in bad.iter().flat_map(|&t| triangles[t as usize]) {
            ring.clear();
            ring.extend(rings.of(v).iter().map(|&w| points[w as usize]));
            if sees(&points[v as usize], &ring) {
                continue;
            }
            let sum: Vector3<f64> = ring.iter().map(|p| p.coords).sum();
            let Some(near) = sum.try_normalize(0.0).map(Point3::from) else {
                continue;
            };
            // Where the ring itself is folded, its centroid opens it for the next pass.
            points[v as usize] = middle(&kernel(&near, &ring)).unwrap_or(near);
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    /// Targets of all vertices of a ball; returns the root mean square distances before and after.
    fn drawn_by(by: impl Fn(&Point3<f64>) -> Point3<f64>) -> (f64, f64, SphereMap) {
        let ball = icosphere(1.0, 4);
        let map = SphereMap::new(ball.vertices.clone(), ball.triangles).expect("a map");
        let target = |(v, p): (u32, &Point3<f64>)| Target {
            vertex: v,
            to: by(p),
            weight: 1.0,
        };
        let targets: Vec<Target> = (0..).zip(map.points()).map(target).collect();
        let left = |map: &SphereMap| {
            let square = |w: &Target| (map.points()[w.vertex as usize] - w.to).norm_squared();
            (targets.iter().map(square).sum::<f64>() / targets.len() as f64).sqrt()
        };
        let after = warped(&map, &targets).expect("drawn");
        (left(&map), left(&after), after)
    }

    #[test]
    fn a_twist_about_an_axis_is_undone() {
        let twisted =
            |p: &Point3<f64>| UnitQuaternion::from_scaled_axis(Vector3::z() * (0.6 * p.z)) * p;
        let (before, after, map) = drawn_by(twisted);
        assert!(before > 0.2 && after < 0.15 * before, "{before} {after}");
        assert!(flipped(map.points(), map.triangles()).is_empty());
    }

    #[test]
    fn a_map_that_lies_well_stays_and_a_fold_is_not_made() {
        let (before, after, _) = drawn_by(|p| *p);
        assert!(before == 0.0 && after <= 1e-15, "{after}");
        // All targets on one side of a mirror plane: half of the sphere would fold.
        let (before, after, map) = drawn_by(|p| Point3::new(p.x.abs(), p.y, p.z));
        assert!(
            after < before && flipped(map.points(), map.triangles()).is_empty(),
            "{before} {after}"
        );
    }
}
