//! Similarity of places on two bodies without named features.
//!
//! The first body is rotated. Then the optimal transport map between normal distributions with both
//! covariances takes it to the second body: A^-1/2 (A^1/2 B A^1/2)^1/2 A^-1/2 \[gelbrich1990\]. A
//! long body thus fills a longer and thicker one from end to end, and a body in the right pose is
//! not rotated. Each place is then matched with the nearest one that faces the same direction. This
//! happens from both sides, since matches from one side alone can leave out much of the other.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::align::rotation_of;
use super::locate::Locator;
use super::oriented_point::OrientedPoint;
use super::pose::axes;
use super::sphere::SphereMap;
use super::sphere::centre::bounding_sphere;
use crate::mesh::TriangleMesh;

/// Number of sample vertices of each body.
const SAMPLES: usize = 500;
/// Radius of a body in units where two perpendicular unit normals are 1.4 apart. With a smaller
/// value, normals alone match the ends of a long body with its middle. With a greater value, the
/// other side of a thin body is as near as this side.
const EXTENT: f64 = 8.0;
/// Number of rotations about the longest axis that are tried.
const AROUND: usize = 8;
/// Least ratio of the extents of a body: flat bodies get a thickness.
const FLAT: f64 = 1e-3;

/// A vertex of the first body with its match on the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    pub vertices: [u32; 2],
    /// Share of the area of the body whose vertex started the match.
    pub weight: f64,
}

/// Two bodies with sample vertices.
pub struct ShapeSimilarity<'a> {
    meshes: [&'a TriangleMesh; 2],
    middles: [Point3<f64>; 2],
    spreads: [Matrix3<f64>; 2],
    normals: [Vec<Vector3<f64>>; 2],
    /// Sample vertices with their shares of the area of all sample vertices.
    samples: [Vec<(u32, f64)>; 2],
    /// Scale of positions relative to normals \[1/m\].
    scale: f64,
}

impl<'a> ShapeSimilarity<'a> {
    pub fn new(meshes: [&'a TriangleMesh; 2]) -> Self {
        let middles = meshes.map(|m| m.surface_centroid().unwrap_or_default());
        let radius = bounding_sphere(&meshes[1].vertices).1;
        Self {
            meshes,
            middles,
            spreads: [0, 1].map(|k: usize| spread(meshes[k], &middles[k])),
            normals: meshes.map(TriangleMesh::vertex_normals),
            samples: meshes.map(samples),
            scale: if radius > 0.0 { EXTENT / radius } else { 0.0 },
        }
    }

    /// Rotations of the first body that align its principal axes with those of the second, in both
    /// directions, and about the longest axis.
    pub fn by_axes(&self) -> impl Iterator<Item = UnitQuaternion<f64>> {
        let [from, to] = self.meshes.map(axes);
        (0..2 * AROUND).map(move |k| {
            let end = if k < AROUND { 1.0 } else { -1.0 };
            let signs = Matrix3::from_diagonal(&Vector3::new(end, end, 1.0));
            let angle = std::f64::consts::TAU * (k % AROUND) as f64 / AROUND as f64;
            let about = UnitQuaternion::from_scaled_axis(to.column(0).into_owned() * angle);
            about * rotation_of(&(to * signs * from.transpose()))
        })
    }

    /// The linear map from the first body to the second after a rotation, relative to their
    /// centres.
    pub fn pose(&self, turn: &UnitQuaternion<f64>) -> Matrix3<f64> {
        let turn = turn.to_rotation_matrix().into_inner();
        let from = turn * self.spreads[0] * turn.transpose();
        let (root, back) = (
            by_values(&from, f64::sqrt),
            by_values(&from, |l| 1.0 / l.sqrt()),
        );
        back * by_values(&(root * self.spreads[1] * root), f64::sqrt) * back * turn
    }

    /// Matches from both sides, and the mean of their squared distances.
    pub fn matches(&self, pose: &Matrix3<f64>) -> (Vec<Match>, f64) {
        let oriented_points = self.oriented_points(pose);
        let (mut all, mut sum) = (Vec::new(), 0.0);
        for side in 0..2 {
            let nearest = |&(v, weight): &(u32, f64)| {
                let own = oriented_points[side][v as usize];
                let (mut least, mut there) = (f64::INFINITY, 0);
                for (w, oriented_point) in (0..).zip(&oriented_points[1 - side]) {
                    let square = own.square(oriented_point);
                    if square < least {
                        (least, there) = (square, w);
                    }
                }
                (
                    Match {
                        vertices: if side == 0 { [v, there] } else { [there, v] },
                        weight,
                    },
                    least,
                )
            };
            let found: Vec<(Match, f64)> = self.samples[side].par_iter().map(nearest).collect();
            sum += found
                .iter()
                .map(|(m, square)| m.weight * square)
                .sum::<f64>();
            all.extend(found.into_iter().map(|(m, _)| m));
        }
        (all, 0.5 * sum)
    }

    /// Mean squared distance between points of the transformed first body and the points of the
    /// second with the same direction on the sphere \[m^2\].
    pub fn apart(&self, maps: [&SphereMap; 2], pose: &Matrix3<f64>) -> f64 {
        let locator = Locator::new(maps[1]);
        let one = |&(v, weight): &(u32, f64)| {
            let found = locator.locate(&maps[0].points()[v as usize].coords)?;
            let there = found.of(maps[1].triangles(), &self.meshes[1].vertices);
            Some(
                weight
                    * (self.posed(&self.meshes[0].vertices[v as usize], pose) - there)
                        .norm_squared(),
            )
        };
        self.samples[0].iter().filter_map(one).sum()
    }

    fn posed(&self, p: &Point3<f64>, pose: &Matrix3<f64>) -> Point3<f64> {
        self.middles[1] + pose * (p - self.middles[0])
    }

    fn oriented_points(&self, pose: &Matrix3<f64>) -> [Vec<OrientedPoint>; 2] {
        let of_normals = pose
            .try_inverse()
            .unwrap_or_else(Matrix3::identity)
            .transpose();
        let place = |p: Point3<f64>| Point3::from((p - self.middles[1]) * self.scale);
        let first = self.meshes[0]
            .vertices
            .iter()
            .zip(&self.normals[0])
            .map(|(p, n)| OrientedPoint {
                place: place(self.posed(p, pose)),
                normal: (of_normals * n).try_normalize(0.0).unwrap_or_default(),
            });
        let second = self.meshes[1].vertices.iter().zip(&self.normals[1]);
        [
            first.collect(),
            second
                .map(|(p, n)| OrientedPoint {
                    place: place(*p),
                    normal: *n,
                })
                .collect(),
        ]
    }
}

/// Covariance of a surface about its centre \[m^2\].
fn spread(mesh: &TriangleMesh, middle: &Point3<f64>) -> Matrix3<f64> {
    let (mut sum, mut total) = (Matrix3::zeros(), 0.0);
    for (p, area) in mesh.vertices.iter().zip(mesh.vertex_areas()) {
        sum += (p - middle) * (p - middle).transpose() * area;
        total += area;
    }
    if total > 0.0 {
        sum / total
    } else {
        Matrix3::identity()
    }
}

/// Sample vertices at equal index steps, with their shares of the area of all sample vertices.
fn samples(mesh: &TriangleMesh) -> Vec<(u32, f64)> {
    let (count, areas) = (mesh.vertices.len(), mesh.vertex_areas());
    let every = (count / SAMPLES).max(1);
    let total: f64 = areas.iter().step_by(every).sum();
    let share = |area: f64| if total > 0.0 { area / total } else { 0.0 };
    (0..count as u32)
        .zip(&areas)
        .step_by(every)
        .map(|(v, area)| (v, share(*area)))
        .collect()
}

/// A function of the eigenvalues of a symmetric matrix; eigenvalues are at least [`FLAT`] squared
/// times the greatest.
fn by_values(matrix: &Matrix3<f64>, of: impl Fn(f64) -> f64) -> Matrix3<f64> {
    let eigen = matrix.symmetric_eigen();
    let most = eigen.eigenvalues.max();
    if !(most > 0.0) {
        return Matrix3::identity();
    }
    let values = eigen.eigenvalues.map(|l| of(l.max(FLAT * FLAT * most)));
    eigen.eigenvectors * Matrix3::from_diagonal(&values) * eigen.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn a_body_is_laid_over_one_of_another_length_without_a_turn() {
        let ball = icosphere(1.0, 3);
        let long = |by: [f64; 3]| {
            let by = Vector3::from(by);
            let vertices = ball
                .vertices
                .iter()
                .map(|p| Point3::from(p.coords.component_mul(&by)))
                .collect();
            TriangleMesh {
                vertices,
                ..ball.clone()
            }
        };
        let (first, second) = (long([6.0, 1.0, 0.7]), long([9.0, 0.5, 1.4]));
        let shape_similarity = ShapeSimilarity::new([&first, &second]);
        let pose = shape_similarity.pose(&UnitQuaternion::identity());
        let spread_after = pose * shape_similarity.spreads[0] * pose.transpose();
        assert!(
            (spread_after - shape_similarity.spreads[1]).norm()
                <= 1e-12 * shape_similarity.spreads[1].norm(),
            "{spread_after}"
        );
        assert!(
            (pose - pose.transpose()).norm() <= 1e-12 * pose.norm(),
            "no turn in it: {pose}"
        );
        // After a rotation the body is mapped in the opposite direction.
        let over = UnitQuaternion::from_scaled_axis(Vector3::z() * std::f64::consts::PI);
        assert!((shape_similarity.pose(&over) + pose).column(0).norm() < 1e-9 * pose.norm());
        let flat = TriangleMesh {
            vertices: vec![Point3::origin(); ball.vertices.len()],
            ..ball.clone()
        };
        assert_eq!(
            ShapeSimilarity::new([&flat, &ball])
                .matches(&Matrix3::identity())
                .0
                .len(),
            2 * 642
        );
    }

    #[test]
    fn a_vertex_is_most_like_itself() {
        let ball = icosphere(1.0, 3);
        let shape_similarity = ShapeSimilarity::new([&ball, &ball]);
        let (found, square) = shape_similarity.matches(&Matrix3::identity());
        // Places are relative to the centre, which has a rounding error.
        assert!(square <= 1e-28 && found.iter().all(|m| m.vertices[0] == m.vertices[1]));
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.4, 0.0));
        let (found, square) = shape_similarity.matches(&turn.to_rotation_matrix().into_inner());
        assert!(square > 1e-3 && found.iter().any(|m| m.vertices[0] != m.vertices[1]));
    }
}
