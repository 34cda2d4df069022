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
    /// The bone or capsule below each in the present frame, with a point [m] and the normal of the
    /// plane in its frame.
    below: Vec<Below>,
}

#[derive(Clone, Copy, Debug)]
struct Below {
    obstacle: usize,
    point: Point3<f64>,
    normal: Vector3<f64>,
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
                    thickness: height.max(0.0),
                };
                ties.push((tie, stiffness * area));
            }
        }
        let mut all = Self {
            ties,
            below: Vec::new(),
        };
        all.look(&rest.mesh.vertices, &plan.obstacles, placed, |p| p.now);
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
        pose: impl Fn(&PosedObstacle) -> Isometry3<f64> + Sync,
    ) {
        let of = |(tie, _): &(PlaneContact, f64)| {
            let from = &x[tie.points[0] as usize];
            let each = obstacles.iter().filter_map(|&obstacle| {
                let placed = &placed[obstacle];
                let local = pose(placed).inverse_transform_point(from);
                let found = placed.obstacle.closest(&local)?;
                // The direction to a vertex outside does not jump at an edge of the bone.
                let away = Unit::try_new(local - found.point, f64::MIN_POSITIVE);
                let normal = away
                    .filter(|_| found.distance > 0.0)
                    .map_or(found.normal, Unit::into_inner);
                let point = found.point;
                Some((
                    found.distance,
                    Below {
                        obstacle,
                        point,
                        normal,
                    },
                ))
            });
            let nearest = each.min_by(|a, b| a.0.total_cmp(&b.0));
            nearest.map(|(_, below)| below)
        };
        // All or none: an obstacle has a surface wherever the vertex is.
        let found: Option<Vec<Below>> = self.ties.par_iter().map(of).collect();
        self.below = found.unwrap_or_default();
    }

    /// The planes in space, with bones at their poses in `placed`; empty without fascia.
    pub(super) fn planes(&self, placed: &[PosedObstacle]) -> Vec<(Point3<f64>, Vector3<f64>)> {
        let of = |below: &Below| {
            let pose = &placed[below.obstacle].now;
            (pose * below.point, pose * below.normal)
        };
        self.below.iter().map(of).collect()
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
