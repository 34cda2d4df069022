//! Responses of the first source to a vertex inside a bone \[cervenka2019\].
//!
//! This module serves comparisons: the contact of this crate acts before a vertex is inside. Each
//! response sees one vertex, so none keeps the triangles between vertices out of the bone, and none
//! knows the side from which a vertex came.

use nalgebra::{Isometry3, Point3, Vector3};

use super::escape_field::EscapeField;
use super::nearest::area_normal;
use super::{OnTriangle, Projection, Surface};

/// Displacement of a vertex along a normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// A constant displacement [m].
    Constant(f64),
    /// A share of the depth.
    Share(f64),
}

/// The new position of a vertex inside a bone.
#[derive(Clone, Copy, Debug)]
pub enum PenetrationResponse<'a> {
    /// Immediate: the nearest vertex of the bone. The vertex ends on the surface, but all vertices
    /// near it end on the same point.
    NearestVertex,
    /// Immediate: the mean of this number of nearest vertices, weighted by inverse distances. The
    /// vertex ends on the surface only if these are the corners of one triangle.
    MeanOfVertices(usize),
    /// Immediate: the nearest point of the surface. This is the shortest displacement to the
    /// surface.
    NearestPoint,
    /// Eventual: along the normal of the nearest triangle. In a notch narrower than a right angle
    /// the vertex can end deeper.
    FaceNormal(Length),
    /// Eventual: along the mean normal of all triangles about the nearest point within the depth of
    /// the vertex.
    MeanNormal(Length),
    /// The motion of the bone since the last frame, applied to the vertex. In the frame of the bone
    /// it is `before^-1 now`, of the poses `before` and `now`. A vertex that the bone swallowed
    /// while the vertex was at rest returns to its last place beside the bone. A vertex that
    /// entered the bone by a motion of its own can stay inside.
    BoneMotion(Isometry3<f64>),
    /// Along a field of directions inside the bone, up to the surface. The directions of vertices
    /// close to each other agree, and the path is longer than that to the nearest point.
    VectorField(&'a EscapeField),
}

impl PenetrationResponse<'_> {
    /// The new position of a point [m]; unchanged for a point outside or an empty surface.
    pub fn place(&self, surface: &Surface, point: &Point3<f64>) -> Point3<f64> {
        let Some(on) = surface
            .nearest(point, f64::MAX)
            .filter(|on| on.closest.distance < 0.0)
        else {
            return *point;
        };
        match self {
            Self::NearestVertex => mean_of_vertices(surface.positions(), point, 1),
            Self::MeanOfVertices(count) => mean_of_vertices(surface.positions(), point, *count),
            Self::NearestPoint => on.closest.point,
            Self::FaceNormal(length) => point + face_normal(surface, &on) * length.of(&on.closest),
            Self::MeanNormal(length) => point + mean_normal(surface, &on) * length.of(&on.closest),
            Self::BoneMotion(motion) => motion * point,
            Self::VectorField(field) => field.follow(surface, point),
        }
    }
}

impl Length {
    fn of(self, closest: &Projection) -> f64 {
        match self {
            Self::Constant(length) => length,
            Self::Share(share) => -share * closest.distance,
        }
    }
}

/// Mean of the `count` points nearest to `point`, weighted by inverse distances.
fn mean_of_vertices(points: &[Point3<f64>], point: &Point3<f64>, count: usize) -> Point3<f64> {
    let mut near: Vec<(f64, usize)> = Vec::with_capacity(count + 1);
    for (index, p) in points.iter().enumerate() {
        let square = (p - point).norm_squared();
        let at = near.partition_point(|(s, _)| *s <= square);
        if at < count {
            near.insert(at, (square, index));
            near.truncate(count);
        }
    }
    // As multiples of the least distance, so that a distance of zero leaves only its own point.
    let least = near.first().map_or(0.0, |(square, _)| square.sqrt());
    let weight = |square: f64| {
        if square > 0.0 {
            least / square.sqrt()
        } else {
            1.0
        }
    };
    let total: f64 = near.iter().map(|(square, _)| weight(*square)).sum();
    near.iter().fold(*point, |sum, (square, index)| {
        sum + (points[*index] - point) * (weight(*square) / total)
    })
}

/// Unit normal of a point's triangle; the direction of the distance if the triangle has no area.
fn face_normal(surface: &Surface, on: &OnTriangle) -> Vector3<f64> {
    normal_of(surface, on.triangle).unwrap_or(on.closest.normal)
}

fn normal_of(surface: &Surface, triangle: u32) -> Option<Vector3<f64>> {
    let t = surface.triangles()[triangle as usize].map(|v| surface.positions()[v as usize]);
    area_normal(&t).try_normalize(0.0)
}

fn mean_normal(surface: &Surface, on: &OnTriangle) -> Vector3<f64> {
    let mut around = Vec::new();
    surface.within(&on.closest.point, on.closest.distance.abs(), &mut around);
    let sum: Vector3<f64> = around.iter().filter_map(|&t| normal_of(surface, t)).sum();
    // Normals that cancel define no direction.
    sum.try_normalize(1e-6)
        .unwrap_or_else(|| face_normal(surface, on))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::mesh::TriangleMesh;
    use crate::mesh::shapes::{box_surface, icosphere};
    use crate::testing::Draw;

    const ALL: [PenetrationResponse<'static>; 7] = [
        PenetrationResponse::NearestVertex,
        PenetrationResponse::MeanOfVertices(3),
        PenetrationResponse::NearestPoint,
        PenetrationResponse::FaceNormal(Length::Constant(0.01)),
        PenetrationResponse::FaceNormal(Length::Share(1.0)),
        PenetrationResponse::MeanNormal(Length::Constant(0.01)),
        PenetrationResponse::MeanNormal(Length::Share(1.0)),
    ];

    fn distance(surface: &Surface, p: &Point3<f64>) -> f64 {
        surface
            .nearest(p, f64::MAX)
            .expect("a surface")
            .closest
            .distance
    }

    fn drawn(surface: &Surface, count: usize, seed: u64) -> Vec<Point3<f64>> {
        let mut draw = Draw::new(seed);
        let mut points = Vec::new();
        while points.len() < count {
            let p = Point3::from(draw.direction() * draw.between(0.0, 1.0));
            points.extend((distance(surface, &p) < -1e-3).then_some(p));
        }
        points
    }

    #[test]
    fn what_is_outside_stays() {
        let surface = Surface::new(&icosphere(1.0, 1));
        let p = Point3::new(1.5, 0.2, 0.1);
        ALL.iter()
            .for_each(|remedy| assert_eq!(remedy.place(&surface, &p), p, "{remedy:?}"));
    }

    #[test]
    fn immediate_remedies_end_on_the_surface_and_the_nearest_point_is_the_shortest_way() {
        let surface = Surface::new(&box_surface([1.0, 0.8, 0.6], 0.2));
        let mut inside = 0;
        for p in drawn(&surface, 300, 81) {
            let depth = -distance(&surface, &p);
            for remedy in [
                PenetrationResponse::NearestVertex,
                PenetrationResponse::NearestPoint,
            ] {
                let end = remedy.place(&surface, &p);
                assert!(distance(&surface, &end).abs() <= 1e-12, "{remedy:?} of {p}");
                assert!((end - p).norm() >= depth * (1.0 - 1e-12));
            }
            let shortest = (PenetrationResponse::NearestPoint.place(&surface, &p) - p).norm();
            assert!((shortest - depth).abs() <= 1e-12);
            inside += usize::from(
                distance(
                    &surface,
                    &PenetrationResponse::MeanOfVertices(3).place(&surface, &p),
                ) < -1e-3,
            );
        }
        assert!(
            inside > 10,
            "the mean of three vertices of two faces lies inside: {inside}"
        );
    }

    #[test]
    fn the_nearest_vertex_is_the_same_for_many() {
        let mesh = box_surface([1.0, 1.0, 1.0], 0.5);
        let surface = Surface::new(&mesh);
        let ends = |remedy: PenetrationResponse<'_>| {
            let place = |p: Point3<f64>| remedy.place(&surface, &p);
            let all = drawn(&surface, 500, 82)
                .into_iter()
                .map(place)
                .map(|p| [p.x, p.y, p.z].map(f64::to_bits));
            all.collect::<BTreeSet<_>>().len()
        };
        assert!(ends(PenetrationResponse::NearestVertex) <= mesh.vertices.len());
        assert_eq!(
            ends(PenetrationResponse::NearestPoint),
            500,
            "control: nothing is many-to-one"
        );
        // A triangle near one vertex then has no area.
        let t = [[0.4, 0.4, 0.45], [0.45, 0.4, 0.4], [0.4, 0.45, 0.4]].map(Point3::from);
        let area = |remedy: PenetrationResponse<'_>| {
            area_normal(&t.map(|p| remedy.place(&surface, &p))).norm()
        };
        assert_eq!(area(PenetrationResponse::NearestVertex), 0.0);
        assert!(area(PenetrationResponse::NearestPoint) > 1e-4);
    }

    #[test]
    fn eventual_remedies_need_as_many_pushes_as_steps_are_deep() {
        // Under the middle of a face of a convex body the normal leads directly out.
        let surface = Surface::new(&box_surface([2.0, 2.0, 2.0], 1.0));
        let start = Point3::new(0.11, -0.07, 0.7);
        for (length, pushes, left) in [
            (Length::Share(1.0), 1, 0.0),
            (Length::Share(0.5), 3, 0.0375),
            (Length::Constant(0.08), 3, 0.06),
            (Length::Constant(0.08), 4, -0.02),
        ] {
            for remedy in [
                PenetrationResponse::FaceNormal(length),
                PenetrationResponse::MeanNormal(length),
            ] {
                let end = (0..pushes).fold(start, |p, _| remedy.place(&surface, &p));
                let depth = -distance(&surface, &end);
                assert!(
                    (depth - left).abs() <= 1e-12,
                    "{remedy:?} leaves {depth} for {left}"
                );
            }
        }
    }

    /// A cylinder along z with a wedge of `angle` [rad] cut from its side to the axis.
    fn notched(angle: f64) -> TriangleMesh {
        let parts = 12;
        let around =
            |i: u32| angle + (std::f64::consts::TAU - angle) * f64::from(i) / f64::from(parts);
        let mut vertices = Vec::new();
        for z in [-1.0, 1.0] {
            vertices.push(Point3::new(0.0, 0.0, z));
            vertices.extend(
                (0..=parts).map(|i| Point3::new(libm::cos(around(i)), libm::sin(around(i)), z)),
            );
        }
        let count = parts + 2;
        let mut triangles = Vec::new();
        for a in 0..count {
            let b = (a + 1) % count;
            triangles.extend([[a, b, b + count], [a, b + count, a + count]]);
        }
        (1..count - 1)
            .for_each(|a| triangles.extend([[count, count + a, count + a + 1], [0, a + 1, a]]));
        TriangleMesh {
            vertices,
            triangles,
        }
    }

    #[test]
    fn in_a_notch_the_normal_of_a_face_leads_deeper_and_the_mean_does_not() {
        let angle = 0.5;
        let surface = Surface::new(&notched(angle));
        // Behind the edge, on the bisecting plane of the notch: both faces are equally near.
        let behind = std::f64::consts::PI + 0.5 * angle;
        let p = Point3::new(0.1 * libm::cos(behind), 0.1 * libm::sin(behind), 0.05);
        assert!(
            (distance(&surface, &p) + 0.1).abs() <= 1e-12,
            "the edge is nearest"
        );
        let after =
            |remedy: PenetrationResponse<'_>| -distance(&surface, &remedy.place(&surface, &p));
        // |p + n d|^2 = d^2 (2 + 2 cos) with the angle between the normal of a face and the
        // direction of p.
        let expected = 0.1 * (2.0 - 2.0 * libm::sin(0.5 * angle)).sqrt();
        let deeper = after(PenetrationResponse::FaceNormal(Length::Share(1.0)));
        assert!(
            (deeper - expected).abs() <= 1e-12 && deeper > 0.12,
            "{deeper} for {expected}"
        );
        assert!(after(PenetrationResponse::MeanNormal(Length::Share(1.0))) < 0.1);
        assert!(after(PenetrationResponse::NearestPoint).abs() <= 1e-12);
    }

    #[test]
    fn the_motion_of_the_bone_returns_a_swallowed_vertex_to_its_place_beside_the_bone() {
        let surface = Surface::new(&box_surface([1.0, 0.8, 0.6], 0.2));
        let before = Isometry3::new(Vector3::new(0.3, -2.0, 1.0), Vector3::new(0.1, 0.2, 0.3));
        let now =
            before * Isometry3::new(Vector3::new(0.1, 0.02, 0.0), Vector3::new(0.0, 0.1, 0.0));
        // A vertex at rest, in front of the side that moves towards it.
        let vertex = before * Point3::new(0.55, 0.1, 0.05);
        let [was, is] = [before, now].map(|pose| pose.inverse() * vertex);
        assert!(distance(&surface, &was) > 0.04 && distance(&surface, &is) < -0.03);
        let motion = before.inverse() * now;
        let end = PenetrationResponse::BoneMotion(motion).place(&surface, &is);
        assert!((end - was).norm() <= 1e-12, "{end} is not {was}");
        // Controls: no motion leaves the vertex inside, and the reverse motion takes it deeper.
        let still = PenetrationResponse::BoneMotion(Isometry3::identity()).place(&surface, &is);
        assert_eq!(still, is);
        let back = PenetrationResponse::BoneMotion(motion.inverse()).place(&surface, &is);
        assert!(distance(&surface, &back) < distance(&surface, &is) - 0.05);
        // Limit: a vertex that was inside before stays inside.
        let held = now.inverse() * (before * Point3::new(0.2, 0.1, 0.05));
        let end = PenetrationResponse::BoneMotion(motion).place(&surface, &held);
        assert!(distance(&surface, &end) < -0.1);
    }

    #[test]
    fn the_field_leads_out_of_convex_bodies_and_of_a_notch() {
        for (mesh, seed) in [
            (box_surface([1.0, 0.8, 0.6], 0.2), 83),
            (icosphere(0.5, 3), 84),
            (notched(0.5), 85),
        ] {
            let surface = Surface::new(&mesh);
            let field = EscapeField::new(&mesh, 24);
            for p in drawn(&surface, 100, seed) {
                let depth = -distance(&surface, &p);
                let end = PenetrationResponse::VectorField(&field).place(&surface, &p);
                assert!(distance(&surface, &end).abs() <= 1e-12, "{p} ends at {end}");
                assert!((end - p).norm() >= depth * (1.0 - 1e-9));
            }
        }
    }

    #[test]
    fn a_field_without_source_leads_nowhere_and_neighbours_leave_on_one_side() {
        let mesh = box_surface([1.0, 0.8, 0.6], 0.2);
        let surface = Surface::new(&mesh);
        let p = Point3::new(0.2, 0.1, 0.05);
        let flat = EscapeField::new(&mesh, 24).without_source();
        let end = PenetrationResponse::VectorField(&flat).place(&surface, &p);
        assert_eq!(end, p, "control: a field of zeros has no direction");
        let far = EscapeField::new(&box_surface([0.1, 0.1, 0.1], 0.1), 24);
        let end = PenetrationResponse::VectorField(&far).place(&surface, &p);
        assert_eq!(
            end, p,
            "control: the field of another bone ends before this place"
        );
    }
}
