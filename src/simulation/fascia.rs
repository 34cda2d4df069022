//! Fascia of a muscle: which vertices lie on a bone at rest, and the planes over the bones below them
//! now.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use rayon::prelude::*;

use super::Simulation;
use super::plan::MusclePlan;
use super::ready::Rest;
use crate::constraints::PlaneContact;
use crate::constraints::fascia::{FASCIA, Fascia};
use crate::contact::PosedObstacle;
use crate::contact::rounded::{POINTS, around};
use crate::particles::Particles;
use crate::scene::Scene;

/// A vertex within this distance of a bone at rest lies on it, relative to the length of the muscle:
/// the thickness of the tissue between.
const ON_BONE: f64 = 0.015;

/// The same relative to the contact thickness, which contact keeps between both.
const OVER_CONTACT: f64 = 2.0;

/// The vertices of a muscle that fascia holds.
#[derive(Clone, Debug, Default)]
pub(super) struct Ties {
    /// Each at rest, with its stiffness [N/m].
    ties: Vec<(PlaneContact, f64)>,
    /// The bones below each in the present frame.
    below: Vec<Below>,
    /// Radius over which the plane below a vertex is a mean [m].
    radius: f64,
}

/// The mean of the planes below a vertex and points around it, as a sum for each bone or capsule that
/// is nearest to some of them: its normals and their products with points of the planes [m], in its frame.
/// Where another bone becomes the nearest, the mean changes gradually.
type Below = Vec<(usize, Vector3<f64>, f64)>;

/// The planes below `x` [m] and points around it at `radius` [m], of obstacles with their indices and
/// poses; `None` if none has a surface.
fn below(
    x: &Point3<f64>,
    radius: f64,
    obstacles: &[(usize, &PosedObstacle, Isometry3<f64>)],
) -> Option<Below> {
    let known = obstacles.iter().filter_map(|each| {
        let (_, placed, pose) = each;
        let found = placed.obstacle.closest(&pose.inverse_transform_point(x))?;
        Some((each, found))
    });
    let known: Vec<_> = known.collect();
    let least = known.iter().map(|(_, found)| found.distance);
    // No point of the mean is nearer to an obstacle beyond.
    let most = least.min_by(f64::total_cmp)? + 2.0 * radius;
    let mut sums = Below::new();
    for p in around(x, radius) {
        let each = known.iter().filter(|(_, known)| known.distance <= most);
        let each = each.filter_map(|((o, placed, pose), known)| {
            let local = pose.inverse_transform_point(&p);
            let found = placed.obstacle.closest_from(&local, &known.point)?;
            Some((*o, local, found))
        });
        let (o, local, found) = each.min_by(|a, b| a.2.distance.total_cmp(&b.2.distance))?;
        // The direction to a point outside does not jump at an edge of the bone.
        let away = Unit::try_new(local - found.point, f64::MIN_POSITIVE);
        let normal = away
            .filter(|_| found.distance > 0.0)
            .map_or(found.normal, Unit::into_inner)
            / POINTS as f64;
        let along = normal.dot(&found.point.coords);
        match sums.iter_mut().find(|(of, ..)| *of == o) {
            Some((_, sum, offset)) => {
                *sum += normal;
                *offset += along;
            }
            None => sums.push((o, normal, along)),
        }
    }
    Some(sums)
}

/// The plane of `below` in space with obstacles at `pose`: a point [m] and a normal that is at most one
/// long.
fn plane(below: &Below, pose: impl Fn(usize) -> Isometry3<f64>) -> (Point3<f64>, Vector3<f64>) {
    let (mut normal, mut offset) = (Vector3::zeros(), 0.0);
    for (obstacle, local, along) in below {
        let pose = pose(*obstacle);
        let turned = pose * local;
        normal += turned;
        offset += along + turned.dot(&pose.translation.vector);
    }
    let square = normal.norm_squared();
    if square == 0.0 {
        // Bones on opposite sides pull as much as each other.
        return (Point3::origin(), normal);
    }
    (Point3::from(normal * (offset / square)), normal)
}

impl Ties {
    /// The vertices that lie on a bone at rest; none if the plan leaves fascia out.
    pub(super) fn new(
        scene: &Scene,
        plan: &MusclePlan,
        rest: &Rest,
        particles: &Particles,
        placed: &[PosedObstacle],
    ) -> Self {
        let Some(stiffness) = scene.effects.fascia.filter(|_| plan.runs(FASCIA)) else {
            return Self::default();
        };
        let thickness = scene.effects.contact.map_or(0.0, |c| c.thickness);
        let within = (ON_BONE * rest.mesh.length()).max(OVER_CONTACT * thickness);
        let areas = rest.mesh.vertex_areas();
        let near: Vec<_> = plan
            .obstacles
            .iter()
            .map(|&o| rest.near(&placed[o].obstacle, &placed[o].now))
            .collect();
        let mut ties = Vec::new();
        for (v, area) in areas.into_iter().enumerate() {
            let distances = near
                .iter()
                .filter_map(|near| Some(near.closest[v]?.distance));
            let Some(height) = distances.min_by(f64::total_cmp) else {
                continue;
            };
            if height <= within && particles.inverse_mass[v] > 0.0 {
                let tie = PlaneContact {
                    points: [v as u32],
                    origin: rest.mesh.vertices[v],
                    normal: Vector3::z(),
                    thickness: 0.0,
                };
                ties.push((tie, stiffness * area));
            }
        }
        let mut all = Self {
            ties,
            below: Vec::new(),
            radius: within,
        };
        all.look(&rest.mesh.vertices, &plan.obstacles, placed, |p| p.now);
        // Heights at rest are those over the mean planes, which later ones are compared with.
        let planes = all.planes(placed);
        for (tie, (origin, normal)) in all.ties.iter_mut().zip(planes) {
            let height = (tie.0.origin - origin).dot(&normal);
            tie.0.thickness = height.max(0.0);
        }
        all
    }

    /// Whether no vertex lies on a bone.
    pub(super) fn is_empty(&self) -> bool {
        self.ties.is_empty()
    }

    /// The part of the muscle; `None` without a vertex that lies on a bone.
    pub(super) fn part(&self) -> Option<Fascia> {
        let (ties, stiffness) = self.ties.iter().copied().unzip();
        (!self.ties.is_empty()).then(|| Fascia::new(ties, stiffness))
    }

    /// Begins a frame at positions `x` [m]: finds the bone below each vertex among `obstacles`, at their
    /// poses before the first step.
    pub(super) fn begin_frame(
        &mut self,
        x: &[Point3<f64>],
        obstacles: &[usize],
        first: &[PosedObstacle],
    ) {
        self.look(x, obstacles, first, |placed| placed.before);
    }

    fn look(
        &mut self,
        x: &[Point3<f64>],
        obstacles: &[usize],
        placed: &[PosedObstacle],
        pose: impl Fn(&PosedObstacle) -> Isometry3<f64>,
    ) {
        let near: Vec<(usize, &PosedObstacle, Isometry3<f64>)> = obstacles
            .iter()
            .map(|&o| (o, &placed[o], pose(&placed[o])))
            .collect();
        let of =
            |(tie, _): &(PlaneContact, f64)| below(&x[tie.points[0] as usize], self.radius, &near);
        // All or none: an obstacle has a surface wherever the vertex is.
        let found: Option<Vec<Below>> = self.ties.par_iter().map(of).collect();
        self.below = found.unwrap_or_default();
    }

    /// The planes in space, with bones at their poses in `placed`; empty without fascia.
    pub(super) fn planes(&self, placed: &[PosedObstacle]) -> Vec<(Point3<f64>, Vector3<f64>)> {
        let each = self.below.iter();
        each.map(|below| plane(below, |o| placed[o].now)).collect()
    }
}

impl Simulation {
    /// Notes each muscle that fascia does not hold.
    pub(super) fn note_fascia(&mut self) {
        for (plan, body) in self.plan.muscles.iter().zip(&self.bodies) {
            if plan.runs(FASCIA) && body.ties.is_empty() {
                let name = &body.name;
                self.notes.push(format!(
                    "{name}: fascia holds no vertex: none lies on a bone at rest"
                ));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::contact::Surface;
    use crate::mesh::measures::max_or_nan;
    use crate::mesh::shapes::icosphere;

    /// A vertex that lies on nothing yet, and two balls of 0.1 m whose centres are 0.3 m apart, one of
    /// which turns and moves within the frame.
    fn drawn(radius: f64) -> (Ties, Vec<PosedObstacle>) {
        let ball = |x: f64, by: Vector3<f64>| {
            let before = Isometry3::translation(x, 0.0, 0.0);
            PosedObstacle {
                name: "ball".to_owned(),
                obstacle: Arc::new(Surface::new(&icosphere(0.1, 3))),
                before,
                now: Isometry3::new(before.translation.vector + by, by * 30.0),
            }
        };
        let tie = PlaneContact {
            points: [0],
            origin: Point3::origin(),
            normal: Vector3::z(),
            thickness: 0.0,
        };
        let ties = Ties {
            ties: vec![(tie, 1.0)],
            below: Vec::new(),
            radius,
        };
        let placed = vec![
            ball(-0.15, Vector3::zeros()),
            ball(0.15, Vector3::new(0.0, 0.002, 0.001)),
        ];
        (ties, placed)
    }

    /// The pull on a vertex with a stiffness of one at the start of a frame: height times normal.
    fn pull(radius: f64, x: Point3<f64>) -> Vector3<f64> {
        let (mut ties, placed) = drawn(radius);
        ties.begin_frame(&[x], &[0, 1], &placed);
        let (origin, normal) = plane(&ties.below[0], |o| placed[o].before);
        normal * (x - origin).dot(&normal)
    }

    #[test]
    fn the_pull_changes_gradually_from_one_bone_to_the_other() {
        let at = |k: i32| Point3::new(1e-3 * f64::from(k), 0.08, 0.01);
        let most = |radius: f64| {
            let each = (-60..60).map(|k| (pull(radius, at(k + 1)) - pull(radius, at(k))).norm());
            max_or_nan(each)
        };
        let height = pull(0.0, at(0)).norm();
        assert!(most(0.04) <= 0.3 * height, "{} {height}", most(0.04));
        assert!(
            most(0.0) >= 1.5 * height,
            "control: the nearest bone alone changes at once"
        );
    }

    #[test]
    fn far_from_the_other_bone_the_planes_are_those_of_one_and_move_with_it() {
        let (mut ties, placed) = drawn(0.01);
        let x = Point3::new(0.262, 0.01, -0.02);
        ties.begin_frame(&[x], &[0, 1], &placed);
        assert!(ties.below[0].iter().all(|(o, ..)| *o == 1));
        let carried = placed[1].now * placed[1].before.inverse();
        let height = |(origin, normal): (Point3<f64>, Vector3<f64>), x: Point3<f64>| {
            (x - origin).dot(&normal)
        };
        let before = height(plane(&ties.below[0], |o| placed[o].before), x);
        let now = height(ties.planes(&placed)[0], carried * x);
        assert!((now - before).abs() <= 1e-15, "{now} {before}");
        // The facets of the ball are up to 0.4 % of its radius below the sphere.
        let exact = (x - Point3::new(0.15, 0.0, 0.0)).norm() - 0.1;
        assert!((before - exact).abs() <= 1e-3, "{before} {exact}");
        // Control: a vertex that stays while the bone moves is at another height.
        let stays = height(ties.planes(&placed)[0], x);
        assert!((stays - before).abs() >= 1e-4);
    }
}
