//! Attached vertices of a muscle, with their bones.

use super::Simulation;
use crate::contact::{Obstacle, Projection};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::median;
use crate::mesh::topology::{NONE, Topology};
use crate::scene::Scene;

/// A vertex attached to a bone.
pub type Attached = (u32, usize);

/// Component `index` of `patch`, by descending area; the whole patch for `None`.
pub fn component(patch: &TriangleMesh, index: Option<usize>) -> Option<TriangleMesh> {
    let Some(index) = index else {
        return Some(patch.clone());
    };
    let topology = Topology::new(patch);
    let components = topology.components();
    let mut areas = vec![(0.0, Vec::new()); components.count];
    for (t, area) in crate::mesh::measures::triangle_areas(&patch.vertices, &patch.triangles)
        .iter()
        .enumerate()
    {
        let label = components.labels[patch.triangles[t][0] as usize];
        if label != NONE {
            areas[label as usize].0 += area;
            areas[label as usize].1.push(patch.triangles[t]);
        }
    }
    areas.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (_, triangles) = areas.into_iter().nth(index)?;
    Some(TriangleMesh {
        vertices: patch.vertices.clone(),
        triangles,
    })
}

/// Vertices of an attachment that the motion would carry into another bone. They are free.
#[derive(Clone, Copy, Debug)]
pub(super) struct Freed {
    pub muscle: usize,
    /// The bone of the attachment, and the one that is in the way.
    pub bones: [usize; 2],
    /// The frame in which one of them enters it.
    pub frame: usize,
    /// Number of vertices that are free, and of those that the bone holds.
    pub free: usize,
    pub held: usize,
}

impl Freed {
    /// Share of the attachment that is free.
    fn share(&self) -> f64 {
        self.free as f64 / (self.free + self.held) as f64
    }

    /// What a reader of the results has to know.
    pub fn note(&self, scene: &Scene) -> String {
        let [held, other] = self.bones.map(|bone| scene.bones[bone].name.as_str());
        format!(
            "{}: {} of {} vertices near {held} are free: the motion would carry them into {other}, one in \
             frame {}",
            scene.muscles[self.muscle].name,
            self.free,
            self.free + self.held,
            self.frame
        )
    }
}

/// Vertices within `within` [m] of a surface (inside counts as 0 if it is solid) for which `holds` is true,
/// nearest first, at most the share `limit` of all. `closest` has the closest point of the surface to
/// each vertex.
pub fn among(
    closest: &[Option<Projection>],
    solid: bool,
    (within, limit): (f64, f64),
    mut holds: impl FnMut(u32) -> bool,
) -> Vec<u32> {
    let mut found: Vec<(f64, u32)> = closest
        .iter()
        .enumerate()
        .filter_map(|(v, closest)| {
            let distance = closest.as_ref()?.distance;
            let distance = if solid {
                distance.max(0.0)
            } else {
                distance.abs()
            };
            (distance <= within).then_some((distance, v as u32))
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let most = (limit * closest.len() as f64) as usize;
    let held = found.into_iter().map(|(_, v)| v);
    held.filter(|&v| holds(v)).take(most).collect()
}

/// Merges the vertices of several attachments. A vertex of two attachments belongs to the first.
pub fn join(choices: &[(usize, Vec<u32>)]) -> Vec<Attached> {
    let mut all: Vec<Attached> = Vec::new();
    let mut taken = std::collections::BTreeSet::new();
    for (bone, vertices) in choices {
        all.extend(
            vertices
                .iter()
                .filter(|v| taken.insert(**v))
                .map(|&v| (v, *bone)),
        );
    }
    all.sort_unstable();
    all
}

/// Number of frames at which the motion of bones is looked at.
const LOOKED_AT: usize = 1000;

impl Simulation {
    /// The edges of a body whose two ends different bones hold: their number, the greatest length
    /// that the motion of the bones gives one of them, relative to that at rest, and the two bones
    /// there. No constraint can shorten such an edge. `None` without one.
    pub fn held_apart(&self, body: usize) -> Option<(usize, f64, [usize; 2])> {
        let body = &self.bodies[body];
        let mut bone = vec![None; body.rest.vertices.len()];
        for &(vertex, of) in &body.attached {
            bone[vertex as usize] = Some(of);
        }
        let between = body.edges.iter().filter_map(|edge| {
            let [a, b] = edge.points.map(|v| bone[v as usize]);
            let bones = [a?, b?];
            (bones[0] != bones[1]).then_some((edge, bones))
        });
        let between: Vec<_> = between.collect();
        let frames = self.scene.frames;
        let looked_at = (0..frames).step_by(frames / LOOKED_AT + 1).chain([frames]);
        let mut most: Option<(f64, [usize; 2])> = None;
        for frame in looked_at {
            let moved: Vec<_> = (0..self.bones.len())
                .map(|b| self.pose(b, frame as f64) * self.pose(b, 0.0).inverse())
                .collect();
            for &(edge, bones) in &between {
                let [a, b] =
                    [0, 1].map(|k| moved[bones[k]] * body.rest.vertices[edge.points[k] as usize]);
                let length = (a - b).norm() / edge.rest;
                if most.is_none_or(|(most, _)| !(length <= most)) {
                    most = Some((length, bones));
                }
            }
        }
        most.map(|(length, bones)| (between.len(), length, bones))
    }

    /// The attachment of a body of which the motion frees most, as it would be carried into another
    /// bone: the share that is free, the bone that should hold it, and the other one. `None` if all is held.
    pub fn most_freed(&self, body: usize) -> Option<(f64, [usize; 2])> {
        let of = self.freed.iter().filter(|freed| freed.muscle == body);
        let worst = of.max_by(|a, b| a.share().total_cmp(&b.share()))?;
        Some((worst.share(), worst.bones))
    }

    /// The attachment of a body that is held across a joint: another bone is nearer, and it moves against the
    /// bone that holds. A bone carries what it holds like a part of itself, and a tendon over the joint would
    /// not turn with it. Of several, the one farthest from its bone: the median distance of its vertices
    /// relative to the body's length, the bone that holds it, and the nearer one. `None` without one.
    pub fn held_across(&self, body: usize) -> Option<(f64, [usize; 2])> {
        let body = &self.bodies[body];
        let away = |bone: usize, holds: usize| {
            let back = self.pose(bone, 0.0).inverse();
            let held = body.attached.iter().filter(|(_, of)| *of == holds);
            let to = |v: u32| {
                self.surface(bone)
                    .closest(&(back * body.rest.vertices[v as usize]))
            };
            let distances = held.filter_map(|(v, _)| Some(to(*v)?.distance.max(0.0)));
            median(distances.collect())
        };
        let mut most: Option<(f64, [usize; 2])> = None;
        for bone in 0..self.bones.len() {
            let Some(own) = away(bone, bone) else {
                continue;
            };
            let share = own / body.length;
            if most.is_some_and(|(most, _)| share <= most) {
                continue;
            }
            let others =
                (0..self.bones.len()).filter(|&b| b != bone && self.moves_against(b, bone));
            let nearer = others.filter_map(|b| Some((b, away(b, bone)?)));
            let nearest = nearer.min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((other, _)) = nearest.filter(|(_, distance)| *distance < own) {
                most = Some((share, [bone, other]));
            }
        }
        most
    }

    /// Whether two bones move against each other.
    fn moves_against(&self, one: usize, other: usize) -> bool {
        let between = |frame: usize| {
            let [one, other] = [one, other].map(|b| self.pose(b, frame as f64));
            one.inverse() * other
        };
        let start = between(0);
        let frames = self.scene.frames;
        let mut looked_at = (0..frames).step_by(frames / LOOKED_AT + 1).chain([frames]);
        looked_at.any(|frame| {
            let turned = between(frame).rotation.angle_to(&start.rotation);
            let moved = (between(frame).translation.vector - start.translation.vector).norm();
            turned > STILL || moved > STILL * self.bones[one].length()
        })
    }
}

/// Bones that turn less than this against each other, in radians and relative to their length, do not.
const STILL: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{Obstacle, Surface};
    use crate::mesh::shapes::icosphere;
    use nalgebra::Point3;

    #[test]
    fn limit_takes_the_nearest() {
        let surface = Surface::new(&icosphere(1.0, 3));
        let x: Vec<Point3<f64>> = (0..20)
            .map(|k| Point3::new(1.0 + 0.01 * f64::from(k), 0.0, 0.0))
            .collect();
        let closest: Vec<Option<Projection>> = x.iter().map(|p| surface.closest(p)).collect();
        let nearest = |within, limit| among(&closest, true, (within, limit), |_| true);
        assert_eq!(nearest(0.055, 1.0), [0, 1, 2, 3, 4, 5]);
        assert_eq!(nearest(0.5, 0.1), [0, 1]);
        // The limit counts what holds.
        let odd = |v: u32| v % 2 == 1;
        assert_eq!(among(&closest, true, (0.5, 0.1), odd), [1, 3]);
    }

    #[test]
    fn components_by_falling_area() {
        let mut patch = icosphere(1.0, 1);
        let small = icosphere(0.1, 1);
        let offset = patch.vertices.len() as u32;
        patch.vertices.extend(
            small
                .vertices
                .iter()
                .map(|v| v + nalgebra::Vector3::new(5.0, 0.0, 0.0)),
        );
        patch
            .triangles
            .splice(0..0, small.triangles.iter().map(|t| t.map(|v| v + offset)));
        let area = |n| component(&patch, Some(n)).map(|m| m.area());
        assert!(area(0).unwrap_or(0.0) > 10.0);
        assert!(area(1).unwrap_or(9.0) < 0.2);
        assert_eq!(component(&patch, Some(2)), None);
    }

    #[test]
    fn a_vertex_has_one_holder() {
        assert_eq!(
            join(&[(0, vec![3, 1]), (1, vec![1, 2])]),
            [(1, 0), (2, 1), (3, 0)]
        );
    }
}
