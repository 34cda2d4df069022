//! The responses to penetration, applied once to the same vertices.

use std::collections::BTreeSet;
use std::time::Instant;

use nalgebra::{Isometry3, Point3};

use super::{Query, ROUNDING, size};
use crate::contact::escape_field::EscapeField;
use crate::contact::nearest::point_at;
use crate::contact::penetration_response::{Length, PenetrationResponse};
use crate::contact::{Obstacle, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;

/// Boxes of the vector field along each axis.
const FIELD_BOXES: usize = 48;
/// Length of a constant displacement [m].
const CONSTANT: Length = Length::Constant(1e-3);
/// Passes over all vertices, of which the fastest counts.
const PASSES: usize = 3;

/// A bone that has moved since the last frame.
pub struct MovedBone {
    surface: Surface,
    field: EscapeField,
    now: Isometry3<f64>,
    /// The motion in the frame of the bone, `before^-1 now`.
    motion: Isometry3<f64>,
    rounding: f64,
}

impl MovedBone {
    /// A bone with its poses in the last frame and in this one.
    pub fn new(mesh: &TriangleMesh, before: &Isometry3<f64>, now: &Isometry3<f64>) -> Self {
        Self {
            surface: Surface::new(mesh),
            field: EscapeField::new(mesh, FIELD_BOXES),
            now: *now,
            motion: before.inverse() * now,
            rounding: ROUNDING * size(&mesh.bounding_box()),
        }
    }

    /// The surface in the frame of the bone.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Depth of a point in the frame of the bone [m]; negative outside.
    fn depth(&self, point: &Point3<f64>) -> f64 {
        self.surface
            .closest(point)
            .map_or(f64::NEG_INFINITY, |c| -c.distance)
    }

    fn is_inside(&self, point: &Point3<f64>) -> bool {
        !(self.depth(point) <= self.rounding)
    }

    /// True if a vertex that was outside at `before` is at `end` on the other side: the straight
    /// path between them passes through the bone, and the outward directions at its ends oppose
    /// each other.
    fn is_beyond(&self, before: &Point3<f64>, end: &Point3<f64>) -> bool {
        let path = end - before;
        let length = path.norm();
        if length <= self.rounding || self.is_inside(before) || self.is_inside(end) {
            return false;
        }
        let Some((triangle, weights)) = self.surface.first_hit(before, &path) else {
            return false;
        };
        let corners = self.surface.triangles()[triangle as usize];
        let entry = point_at(
            &corners.map(|v| self.surface.positions()[v as usize]),
            &weights,
        );
        let [out, beyond] = [before, end].map(|p| self.surface.closest(p));
        (entry - before).norm() < length - self.rounding
            && out
                .zip(beyond)
                .is_some_and(|(a, b)| a.normal.dot(&b.normal) < 0.0)
    }
}

/// What a response makes of the vertices inside bones, applied once to each.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ResponseRow {
    /// The response.
    pub response: &'static str,
    /// Number of vertices inside before; a vertex inside two bones counts twice.
    pub inside_before: usize,
    /// Number of them still inside the same bone.
    pub inside: usize,
    /// Number of them deeper than before.
    pub deeper: usize,
    /// Number of them that were in no other bone and are in one now.
    pub in_another_bone: usize,
    /// Number of them on the other side of the bone. The side of a vertex that was inside the bone
    /// one frame before is unknown; it does not count.
    pub wrong_side: usize,
    /// Number of them on the place of another.
    pub coincident: usize,
    /// Greatest remaining depth [m].
    pub depth_max_m: f64,
    /// Greatest motion by the response [m].
    pub motion_max_m: f64,
    /// Mean motion [m].
    pub motion_mean_m: f64,
    /// Root mean square of the motions [m].
    pub motion_rms_m: f64,
    /// Time of a vertex [s], without the preparation of the bone.
    pub time_s: f64,
    /// This time relative to that of the fastest response.
    pub time_ratio: f64,
}

/// A response for a bone.
type Choose = for<'a> fn(&'a MovedBone) -> PenetrationResponse<'a>;

/// The compared responses.
const RESPONSES: [(&str, Choose); 9] = [
    ("nearest vertex", |_| PenetrationResponse::NearestVertex),
    ("mean of three vertices", |_| {
        PenetrationResponse::MeanOfVertices(3)
    }),
    ("nearest point", |_| PenetrationResponse::NearestPoint),
    ("normal of a triangle, 1 mm", |_| {
        PenetrationResponse::FaceNormal(CONSTANT)
    }),
    ("normal of a triangle, all of the depth", |_| {
        PenetrationResponse::FaceNormal(Length::Share(1.0))
    }),
    ("mean normal, 1 mm", |_| {
        PenetrationResponse::MeanNormal(CONSTANT)
    }),
    ("mean normal, all of the depth", |_| {
        PenetrationResponse::MeanNormal(Length::Share(1.0))
    }),
    ("motion of the bone", |bone| {
        PenetrationResponse::BoneMotion(bone.motion)
    }),
    ("vector field", |bone| {
        PenetrationResponse::VectorField(&bone.field)
    }),
];

/// Applies each response once to the vertices inside bones.
pub fn compare_responses(bones: &[MovedBone], queries: &[Query]) -> Vec<ResponseRow> {
    let inside: Vec<&Query> = queries.iter().filter(|q| q.inside).collect();
    let mut rows: Vec<ResponseRow> = RESPONSES
        .iter()
        .map(|(name, choose)| row(name, choose, bones, &inside))
        .collect();
    let fastest = rows
        .iter()
        .map(|row| row.time_s)
        .fold(f64::INFINITY, f64::min);
    for row in &mut rows {
        row.time_ratio = if fastest > 0.0 {
            row.time_s / fastest
        } else {
            1.0
        };
    }
    rows
}

/// Number of vertices inside a bone that were outside of it one frame before, so that their side is
/// known.
pub fn known_sides(bones: &[MovedBone], queries: &[Query]) -> usize {
    let is_known = |q: &&Query| q.inside && !bones[q.bone].is_inside(&q.before);
    queries.iter().filter(is_known).count()
}

fn row(
    response: &'static str,
    choose: &Choose,
    bones: &[MovedBone],
    inside: &[&Query],
) -> ResponseRow {
    let chosen: Vec<PenetrationResponse<'_>> = bones.iter().map(choose).collect();
    let mut ends = Vec::new();
    let mut time_s = f64::INFINITY;
    for _ in 0..PASSES {
        let begin = Instant::now();
        let place = |q: &&Query| chosen[q.bone].place(&bones[q.bone].surface, &q.point);
        ends = inside.iter().map(place).collect();
        time_s = time_s.min(begin.elapsed().as_secs_f64() / inside.len().max(1) as f64);
    }
    let mut row = ResponseRow {
        response,
        inside_before: inside.len(),
        inside: 0,
        deeper: 0,
        in_another_bone: 0,
        wrong_side: 0,
        coincident: 0,
        depth_max_m: 0.0,
        motion_max_m: 0.0,
        motion_mean_m: 0.0,
        motion_rms_m: 0.0,
        time_s,
        time_ratio: 1.0,
    };
    row.measure(bones, inside, &ends);
    row
}

impl ResponseRow {
    fn measure(&mut self, bones: &[MovedBone], inside: &[&Query], ends: &[Point3<f64>]) {
        let mut depths = Vec::with_capacity(ends.len());
        let mut places = BTreeSet::new();
        for (q, end) in inside.iter().zip(ends) {
            let bone = &bones[q.bone];
            let depth = bone.depth(end);
            self.inside += usize::from(!(depth <= bone.rounding));
            self.deeper += usize::from(!(depth <= -q.distance + bone.rounding));
            self.wrong_side += usize::from(bone.is_beyond(&q.before, end));
            self.in_another_bone += usize::from(enters_another(bones, q, end));
            places.insert((q.bone, end.coords.data.0[0].map(f64::to_bits)));
            depths.push(depth.max(0.0));
        }
        let motions: Vec<f64> = inside
            .iter()
            .zip(ends)
            .map(|(q, e)| (e - q.point).norm())
            .collect();
        let count = motions.len().max(1) as f64;
        self.coincident = ends.len() - places.len();
        self.depth_max_m = max_or_nan(depths);
        self.motion_mean_m = motions.iter().sum::<f64>() / count;
        self.motion_rms_m = (motions.iter().map(|m| m * m).sum::<f64>() / count).sqrt();
        self.motion_max_m = max_or_nan(motions);
    }
}

/// True if the motion of a vertex to `end` takes it into another bone.
fn enters_another(bones: &[MovedBone], q: &Query, end: &Point3<f64>) -> bool {
    let now = bones[q.bone].now;
    bones.iter().enumerate().any(|(other, bone)| {
        let [from, to] = [q.point, *end].map(|p| bone.now.inverse() * (now * p));
        other != q.bone && bone.is_inside(&to) && !bone.is_inside(&from)
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::contact::comparison::queries;
    use crate::mesh::shapes::box_surface;

    /// A plate 10 mm thick that has moved by `motion` [m] along its normal.
    fn plate(motion: f64) -> (TriangleMesh, MovedBone) {
        let mesh = box_surface([0.2, 0.2, 0.01], 0.02);
        let before = Isometry3::translation(0.0, 0.0, -motion);
        let bone = MovedBone::new(&mesh, &before, &Isometry3::identity());
        (mesh, bone)
    }

    /// Vertices at rest at the height `z` [m] over the plate.
    fn rows_at(z: f64, motion: f64) -> Vec<ResponseRow> {
        let (mesh, bone) = plate(motion);
        let points = (0..20).map(|k| Point3::new(-0.05 + 0.005 * f64::from(k), 0.013, z));
        let moved = points.map(|p| (p, p + Vector3::z() * motion));
        let queries = queries(0, &mesh, &bone.surface, moved);
        assert_eq!(queries.iter().filter(|q| q.inside).count(), 20);
        compare_responses(&[bone], &queries)
    }

    fn of<'a>(rows: &'a [ResponseRow], name: &str) -> &'a ResponseRow {
        rows.iter().find(|row| row.response == name).expect("a row")
    }

    #[test]
    fn a_vertex_past_the_middle_of_a_plate_leaves_it_on_the_wrong_side() {
        // The plate ends at 5 mm; the vertices are 7 mm below its upper side.
        let rows = rows_at(-0.002, 0.01);
        for name in ["nearest point", "normal of a triangle, all of the depth"] {
            let row = of(&rows, name);
            assert_eq!((row.wrong_side, row.inside), (20, 0), "{name}");
            assert!((row.motion_max_m - 0.003).abs() <= 1e-12);
        }
        let carried = of(&rows, "motion of the bone");
        assert_eq!((carried.wrong_side, carried.inside), (0, 0));
        assert!((carried.motion_rms_m - 0.01).abs() <= 1e-12);
        let pushed = of(&rows, "normal of a triangle, 1 mm");
        assert_eq!((pushed.wrong_side, pushed.inside), (0, 20));
        assert!((pushed.depth_max_m - 0.002).abs() <= 1e-12);
    }

    #[test]
    fn control_a_vertex_before_the_middle_leaves_on_its_own_side() {
        let rows = rows_at(0.002, 0.01);
        for row in &rows {
            assert_eq!(row.wrong_side, 0, "{}", row.response);
            assert!(row.time_ratio >= 1.0 && row.inside_before == 20);
        }
        assert_eq!(of(&rows, "vector field").inside, 0);
        // A bone that did not move carries nothing out.
        let still = rows_at(0.002, 0.0);
        assert_eq!(of(&still, "motion of the bone").inside, 20);
        assert_eq!(of(&still, "nearest point").inside, 0);
    }

    #[test]
    fn a_response_can_push_into_another_bone() {
        let (mesh, bone) = plate(0.01);
        // A second plate just above the first one.
        let above = Isometry3::translation(0.0, 0.0, 0.0101);
        let other = MovedBone::new(&mesh, &above, &above);
        let p = Point3::new(0.013, 0.013, 0.004);
        let queries = queries(0, &mesh, &bone.surface, [(p, p + Vector3::z() * 0.01)]);
        let rows = compare_responses(&[bone, other], &queries);
        assert_eq!(of(&rows, "motion of the bone").in_another_bone, 1);
        assert_eq!(of(&rows, "nearest point").in_another_bone, 0);
    }
}
