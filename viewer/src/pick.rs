//! Picking of a vertex or a handle under the pointer.

use nalgebra::{Point2, Point3, Unit, Vector3};

use super::camera::Camera;
use super::snapshot::Shot;

/// Greatest distance of a picked handle, relative to the height of the window.
const NEAR: f64 = 0.02;

/// A picked object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Picked {
    /// A vertex of a body: the body and the vertex.
    Vertex(usize, usize),
    /// A handle.
    Handle(usize),
}

/// The object at a screen position: a near handle, otherwise the corner nearest to the intersection
/// with the front surface; of bodies with `is_shown`.
pub fn pick(
    shot: &Shot,
    camera: &Camera,
    at: Point2<f64>,
    is_shown: impl Fn(usize) -> bool,
) -> Option<Picked> {
    let away = |p: &Point3<f64>| camera.project(p).map(|seen| (seen - at).norm());
    let handles = shot
        .handles
        .iter()
        .enumerate()
        .filter_map(|(h, handle)| Some((h, away(&handle.at)?)));
    if let Some((handle, _)) = handles
        .filter(|(_, d)| *d <= NEAR)
        .min_by(|a, b| a.1.total_cmp(&b.1))
    {
        return Some(Picked::Handle(handle));
    }
    if let Some((body, vertex)) = corner(shot, camera, at, &is_shown) {
        return Some(Picked::Vertex(body, vertex));
    }
    // Bodies without a surface are picked by their projected vertices.
    let bodies = shot.bodies.iter().zip(&shot.stage.bodies).enumerate();
    let bare = bodies.filter(|(b, (_, stage))| is_shown(*b) && stage.triangles.is_empty());
    let each = bare.flat_map(|(b, (body, _))| {
        body.positions
            .iter()
            .enumerate()
            .map(move |(v, p)| (b, v, p))
    });
    let seen = each
        .filter_map(|(b, v, p)| Some((b, v, away(p)?)))
        .filter(|(.., d)| *d <= NEAR);
    seen.min_by(|a, b| a.2.total_cmp(&b.2))
        .map(|(b, v, _)| Picked::Vertex(b, v))
}

/// The body and the corner nearest to the intersection of the line of sight with the front surface.
fn corner(
    shot: &Shot,
    camera: &Camera,
    at: Point2<f64>,
    is_shown: impl Fn(usize) -> bool,
) -> Option<(usize, usize)> {
    let (eye, along) = camera.ray(at);
    let mut nearest: Option<(f64, usize, usize)> = None;
    for (b, (body, stage)) in shot
        .bodies
        .iter()
        .zip(&shot.stage.bodies)
        .enumerate()
        .filter(|(b, _)| is_shown(*b))
    {
        let x = |v: u32| body.positions[v as usize];
        for corners in &stage.triangles {
            let Some(distance) = hit(&eye, &along, &corners.map(x)) else {
                continue;
            };
            if nearest.is_none_or(|(known, ..)| distance < known) {
                let place = eye + along.as_ref() * distance;
                let off = |v: &u32| (x(*v) - place).norm();
                let corner = corners.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
                nearest = corner.map(|v| (distance, b, *v as usize));
            }
        }
    }
    nearest.map(|(_, body, vertex)| (body, vertex))
}

/// The distance of the intersection of a ray with a triangle, from either side.
fn hit(eye: &Point3<f64>, along: &Unit<Vector3<f64>>, [a, b, c]: &[Point3<f64>; 3]) -> Option<f64> {
    let (u, v) = (b - a, c - a);
    let cross = along.cross(&v);
    let volume = u.dot(&cross);
    // Not `==`: a NaN gives no intersection.
    if !(volume.abs() > 0.0) {
        return None;
    }
    let from = eye - a;
    let s = from.dot(&cross) / volume;
    let over = from.cross(&u);
    let t = along.dot(&over) / volume;
    let distance = v.dot(&over) / volume;
    (s >= 0.0 && t >= 0.0 && s + t <= 1.0 && distance > 0.0).then_some(distance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::{BodyShot, Handle, Stage, StageBody, Tissue};
    use pliant::mesh::measures::Aabb;
    use std::sync::Arc;

    /// Two triangles one behind the other, and a bare edge beside them.
    fn shot() -> Shot {
        let at = |z: f64| {
            [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
                .map(|(x, y)| Point3::new(x, y, z))
                .to_vec()
        };
        let bodies = [
            at(0.0),
            at(1.0),
            vec![Point3::new(2.0, 0.0, 0.0), Point3::new(2.0, 1.0, 0.0)],
        ];
        let stage = |triangles: Vec<[u32; 3]>| StageBody {
            name: String::new(),
            tissue: Tissue::Plain,
            triangles,
            edges: vec![[0, 1]],
            held: Vec::new(),
            fibres: pliant::fibres::BoundLines::default(),
        };
        let stages = vec![
            stage(vec![[0, 1, 2]]),
            stage(vec![[0, 2, 1]]),
            stage(Vec::new()),
        ];
        Shot {
            frame: 0,
            last_frame: 0,
            stage: Arc::new(Stage {
                bodies: stages,
                bones: Vec::new(),
            }),
            scene: None,
            controls: Arc::default(),
            bodies: bodies
                .map(|positions| BodyShot {
                    positions,
                    ..BodyShot::default()
                })
                .into(),
            bones: Vec::new(),
            handles: vec![Handle {
                name: "node".to_owned(),
                at: Point3::new(-1.0, 0.5, 0.0),
            }],
            readings: Vec::new(),
            probe: None,
            effects: Vec::new(),
            notes: Vec::new(),
        }
    }

    fn from(direction: Vector3<f64>) -> Camera {
        let bounds = Aabb {
            min: Point3::new(-1.0, 0.0, 0.0),
            max: Point3::new(2.0, 1.0, 1.0),
        };
        Camera::fit(&bounds, direction, Vector3::y())
    }

    #[test]
    fn what_is_in_front_is_picked_at_its_nearest_corner() {
        let shot = shot();
        for (camera, front, back) in [(from(Vector3::z()), 1, 0), (from(-Vector3::z()), 0, 1)] {
            for (vertex, place) in shot.bodies[front].positions.iter().enumerate() {
                let inside = place + (Point3::new(1.0 / 3.0, 1.0 / 3.0, place.z) - place) * 0.2;
                let at = camera.project(&inside).expect("seen");
                assert_eq!(
                    pick(&shot, &camera, at, |_| true),
                    Some(Picked::Vertex(front, vertex))
                );
                let hidden = pick(&shot, &camera, at, |b| b != front);
                assert!(
                    hidden.is_none() || matches!(hidden, Some(Picked::Vertex(b, _)) if b == back),
                    "{hidden:?}"
                );
            }
            let aside = camera.project(&Point3::new(0.9, 0.9, 0.5)).expect("seen");
            assert_eq!(pick(&shot, &camera, aside, |_| true), None);
        }
    }

    #[test]
    fn handles_come_first_and_bare_edges_are_picked_at_their_ends() {
        let (shot, camera) = (shot(), from(Vector3::new(0.2, 0.1, 1.0)));
        let near = |p: Point3<f64>| {
            camera.project(&p).expect("seen") + nalgebra::Vector2::new(0.004, -0.003)
        };
        assert_eq!(
            pick(&shot, &camera, near(shot.handles[0].at), |_| true),
            Some(Picked::Handle(0))
        );
        assert_eq!(
            pick(&shot, &camera, near(Point3::new(2.0, 1.0, 0.0)), |_| true),
            Some(Picked::Vertex(2, 1))
        );
        assert_eq!(
            pick(&shot, &camera, near(Point3::new(2.0, 0.5, 0.0)), |_| true),
            None
        );
    }

    #[test]
    fn what_is_no_number_is_met_nowhere() {
        let (mut shot, camera) = (shot(), from(Vector3::z()));
        shot.handles.clear();
        for body in &mut shot.bodies {
            body.positions.iter_mut().for_each(|p| p.x = f64::NAN);
        }
        assert_eq!(pick(&shot, &camera, Point2::new(0.0, 0.0), |_| true), None);
    }
}
