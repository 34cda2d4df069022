//! Points bound to the volume inside a closed surface, by mean-value coordinates \[ju2005\].
//!
//! Each point is a fixed weighted mean of all vertices. The weight of a vertex depends on the solid
//! angle of its triangles and on its distance. A bound point follows every affine motion exactly
//! and moves smoothly with every vertex. A point on the surface follows its triangle alone, so a
//! fibre end on an area that a bone holds moves with that bone.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::mesh::TriangleMesh;

/// A point lies on a triangle if its three angles, seen from the point, add up to a full turn
/// within this tolerance [rad]. The distance to the triangle is then below this share of its size,
/// and weights by solid angle would lose half of all digits.
const ON_TRIANGLE: f64 = 1e-7;

/// Polylines bound to the volume inside a surface.
#[derive(Clone, Debug)]
pub struct BoundVolume {
    /// Weights of all vertices for each point of each line; they add up to 1.
    weights: Vec<Vec<f64>>,
    /// Number of points of each line.
    counts: Vec<usize>,
}

impl BoundVolume {
    /// Binds the points of `lines` [m] to a closed surface.
    pub fn new(surface: &TriangleMesh, lines: &[Vec<Point3<f64>>]) -> Self {
        let points: Vec<&Point3<f64>> = lines.iter().flatten().collect();
        let weights = points.par_iter().map(|p| weights(surface, p)).collect();
        Self {
            weights,
            counts: lines.iter().map(Vec::len).collect(),
        }
    }

    /// The lines for vertices of the surface at `x` [m]; the number of vertices is constant.
    pub fn at(&self, x: &[Point3<f64>]) -> Vec<Vec<Point3<f64>>> {
        // Relative to a point of the surface, so that a position far from the origin loses no
        // digits.
        let about = x.first().copied().unwrap_or_else(Point3::origin);
        let place = |weights: &Vec<f64>| {
            let sum: Vector3<f64> = weights.iter().zip(x).map(|(w, v)| (v - about) * *w).sum();
            about + sum
        };
        let points: Vec<Point3<f64>> = self.weights.par_iter().map(place).collect();
        let mut rest = points.as_slice();
        let take = |n: &usize| {
            let (line, others) = rest.split_at(*n);
            rest = others;
            line.to_vec()
        };
        self.counts.iter().map(take).collect()
    }
}

/// The mean-value coordinates of a point, one per vertex.
fn weights(surface: &TriangleMesh, p: &Point3<f64>) -> Vec<f64> {
    let mut weights = vec![0.0; surface.vertices.len()];
    for t in &surface.triangles {
        let corners = t.map(|v| surface.vertices[v as usize] - p);
        match share(&corners) {
            Share::Away(share) => (0..3).for_each(|k| weights[t[k] as usize] += share[k]),
            Share::On(share) => {
                weights.fill(0.0);
                (0..3).for_each(|k| weights[t[k] as usize] = share[k]);
                break;
            }
        }
    }
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}

/// Contribution of a triangle to the weights of its corners.
enum Share {
    /// The point is off the triangle.
    Away([f64; 3]),
    /// The point is on the triangle.
    On([f64; 3]),
}

/// The weights of one triangle with corners relative to the point: the mean of all unit vectors
/// from the point to the triangle, as a linear combination of the corners.
fn share(corners: &[Vector3<f64>; 3]) -> Share {
    let distances = corners.map(|c| c.norm());
    if let Some(k) = (0..3).find(|&k| distances[k] == 0.0) {
        return Share::On(std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 }));
    }
    let u: [Vector3<f64>; 3] = std::array::from_fn(|k| corners[k] / distances[k]);
    let normals: [Vector3<f64>; 3] = std::array::from_fn(|k| u[(k + 1) % 3].cross(&u[(k + 2) % 3]));
    let angles: [f64; 3] = std::array::from_fn(|k| {
        libm::atan2(normals[k].norm(), u[(k + 1) % 3].dot(&u[(k + 2) % 3]))
    });
    if std::f64::consts::TAU - angles.iter().sum::<f64>() <= ON_TRIANGLE {
        let areas: [f64; 3] = std::array::from_fn(|k| {
            angles[k].sin() * distances[(k + 1) % 3] * distances[(k + 2) % 3]
        });
        return Share::On(areas);
    }
    let units = normals.map(|n| n.try_normalize(0.0).unwrap_or_else(Vector3::zeros));
    let mean: Vector3<f64> = units
        .iter()
        .zip(angles)
        .map(|(n, angle)| n * (0.5 * angle))
        .sum();
    // A triangle seen edge on has no solid angle: mean and volume vanish together.
    let size = u[0].dot(&normals[0]);
    let weight = |k: usize| {
        let height = units[k].dot(&u[k]);
        if size.abs() <= f64::EPSILON || height == 0.0 {
            0.0
        } else {
            units[k].dot(&mean) / (height * distances[k])
        }
    };
    Share::Away(std::array::from_fn(weight))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::measures::max_or_nan;
    use crate::mesh::shapes::icosphere;
    use crate::testing::Draw;

    fn points(mesh: &TriangleMesh) -> Vec<Point3<f64>> {
        let mut draw = Draw::new(7);
        let mut all: Vec<Point3<f64>> = (0..200)
            .map(|_| Point3::from(draw.direction() * draw.between(0.0, 0.0995)))
            .collect();
        // On a vertex, on an edge, on a triangle, and just below one.
        let [a, b, c] = mesh.corners(17);
        all.extend([a, a + (b - a) * 0.3, a + (b - a) * 0.3 + (c - a) * 0.5]);
        all.push(Point3::from(
            (a + (b - a) * 0.3 + (c - a) * 0.5).coords * (1.0 - 1e-9),
        ));
        all
    }

    #[test]
    fn affine_motions_are_followed_exactly() {
        let mesh = icosphere(0.1, 3);
        let line = points(&mesh);
        let bound = BoundVolume::new(&mesh, std::slice::from_ref(&line));
        let map = nalgebra::Matrix3::new(2.0, 0.5, 0.0, 0.0, 0.3, 0.1, -0.4, 0.0, 1.0);
        let by = Vector3::new(0.3, -0.2, 0.5);
        let moved: Vec<Point3<f64>> = mesh.vertices.iter().map(|v| map * v + by).collect();
        let errors = |other: f64| {
            let there = bound.at(&moved);
            max_or_nan(
                line.iter()
                    .zip(&there[0])
                    .map(|(a, b)| (map * a * other + by - b).norm()),
            )
        };
        // Weights by solid angle lose at most half of their digits as a point approaches its
        // triangle.
        assert!(errors(1.0) <= 1e-8 * 0.1, "{}", errors(1.0));
        assert!(
            errors(1.01) > 1e-4,
            "control: another motion is not followed"
        );
    }

    #[test]
    fn a_point_on_a_triangle_follows_it_alone() {
        let mesh = icosphere(0.1, 2);
        let [a, b, c] = mesh.corners(40);
        let on = a + (b - a) * 0.25 + (c - a) * 0.25;
        let bound = BoundVolume::new(&mesh, &[vec![on, Point3::from(on.coords * 0.5)]]);
        let mut moved = mesh.vertices.clone();
        let kept = mesh.triangles[40];
        (0..moved.len() as u32)
            .filter(|v| !kept.contains(v))
            .for_each(|v| moved[v as usize].coords *= 1.5);
        let there = &bound.at(&moved)[0];
        // A point of a triangle, up to rounding of the triangle's size.
        assert!((there[0] - on).norm() <= 64.0 * f64::EPSILON * 0.1);
        assert!(
            (there[1].coords - on.coords * 0.5).norm() > 1e-3,
            "control: what is inside follows all"
        );
    }

    #[test]
    fn neighbours_stay_neighbours() {
        let mesh = icosphere(0.1, 3);
        let line: Vec<Point3<f64>> = (0..2000)
            .map(|k| Point3::new(1e-4 * f64::from(k) - 0.0985, 1e-3, 2e-3))
            .collect();
        let bound = BoundVolume::new(&mesh, std::slice::from_ref(&line));
        let bend =
            |v: &Point3<f64>| Point3::new(v.x, v.y + 5.0 * v.x * v.x, v.z * (1.0 + 2.0 * v.x));
        let moved: Vec<Point3<f64>> = mesh.vertices.iter().map(bend).collect();
        let there = &bound.at(&moved)[0];
        let steps = there.windows(2).map(|s| (s[1] - s[0]).norm());
        // The bend stretches by at most the root of 1 + (10 x)^2, and by less than twice that between vertices.
        assert!(
            max_or_nan(steps.clone()) <= 3.0 * 1e-4,
            "{}",
            max_or_nan(steps)
        );
    }
}
