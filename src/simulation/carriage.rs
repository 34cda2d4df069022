//! How bones carry a muscle along: damping acts on velocities relative to it.
//!
//! Soft tissue between and around bones damps what moves relative to them. A damping relative to space
//! would slow down a muscle that moves with its bones as well, and could not be strong enough to end the
//! swing of a muscle within a period.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use super::attachments::Attached;
use super::carrier;
use super::joint_weights::{Distances, joint_weights, nearest};
use super::plan::MusclePlan;
use super::ready::{Near, Rest};
use crate::contact::PosedObstacle;
use crate::scene::{Motion, Scene};

/// The shares with which the vertices of a muscle go along with moving bones.
#[derive(Clone, Debug, Default)]
pub(super) struct Carriage {
    /// A bone of each motion, with the share of each vertex.
    groups: Vec<(usize, Vec<f64>)>,
}

impl Carriage {
    /// The shares of conduction, see [`joint_weights`], between the bones to which a muscle is attached
    /// or which it can meet. None where nothing is damped or no bone moves: then damping is relative to
    /// space. Classic PBD damps velocities in space, as its source does.
    pub(super) fn new(
        scene: &Scene,
        plan: &MusclePlan,
        rest: &Rest,
        attached: &[Attached],
        placed: &[PosedObstacle],
    ) -> Self {
        let (solver, effects) = (&scene.solver, &scene.effects);
        let is_damped = effects.damps() && solver.has_inertia() && !solver.has_classic_stiffness();
        if !is_damped || rest.mesh.triangles.is_empty() {
            return Self::default();
        }
        let mut around: Vec<usize> = attached.iter().map(|&(_, bone)| bone).collect();
        around.extend(&plan.obstacles);
        around.sort_unstable();
        around.dedup();
        let near = around.iter().map(|&o| {
            let bone = carrier(scene, o);
            Neighbour {
                bone,
                motion: &scene.bones[bone].motion,
                near: rest.near(&placed[o].obstacle, &placed[o].now),
            }
        });
        let near: Vec<Neighbour<'_>> = near.collect();
        let mut groups: Vec<(usize, Vec<f64>)> = Vec::new();
        for Neighbour { bone, motion, .. } in near.iter().filter(|n| moves(n.motion)) {
            if groups
                .iter()
                .any(|(b, _)| scene.bones[*b].motion == **motion)
            {
                continue;
            }
            let goes: Vec<bool> = scene.bones.iter().map(|b| b.motion == **motion).collect();
            // Without memory for the shares, damping is relative to space.
            let Some(shares) = shares(rest, &near, attached, &goes) else {
                return Self::default();
            };
            groups.push((*bone, shares));
        }
        // Of several motions, those of each vertex have a sum of at most 1.
        for v in 0..rest.mesh.vertices.len() {
            let sum: f64 = groups.iter().map(|(_, shares)| shares[v]).sum();
            if sum > 1.0 {
                groups.iter_mut().for_each(|(_, shares)| shares[v] /= sum);
            }
        }
        Self { groups }
    }

    /// Sets by how far the bones carry each vertex at `x` [m] in a step; empty if none moves.
    pub(super) fn carry(
        &self,
        x: &[Point3<f64>],
        placed: &[PosedObstacle],
        to: &mut Vec<Vector3<f64>>,
    ) {
        to.clear();
        for (bone, shares) in &self.groups {
            let PosedObstacle { before, now, .. } = &placed[*bone];
            if before == now {
                continue;
            }
            let motion: Isometry3<f64> = now * before.inverse();
            to.resize(x.len(), Vector3::zeros());
            for ((to, x), share) in to.iter_mut().zip(x).zip(shares) {
                *to += (motion * x - x) * *share;
            }
        }
    }
}

/// A bone or capsule near a muscle.
struct Neighbour<'a> {
    bone: usize,
    motion: &'a Motion,
    near: Arc<Near>,
}

/// The share of each vertex in the motion of the bones for which `goes` is true.
fn shares(
    rest: &Rest,
    near: &[Neighbour<'_>],
    attached: &[Attached],
    goes: &[bool],
) -> Option<Vec<f64>> {
    let to = |n: &Neighbour<'_>, v: usize| Some((n.near.closest[v]?.distance, goes[n.bone]));
    let vertices = 0..rest.mesh.vertices.len();
    let distances: Vec<Distances> = vertices
        .map(|v| nearest(near.iter().filter_map(|n| to(n, v))))
        .collect();
    let held = attached.iter().map(|&(v, b)| (v, f64::from(goes[b])));
    let held: Vec<(u32, f64)> = held.collect();
    joint_weights(&rest.mesh, &rest.topology(), &distances, &held).ok()
}

/// True if a motion has two poses.
fn moves(motion: &Motion) -> bool {
    motion
        .keys
        .windows(2)
        .any(|pair| pair[0].pose != pair[1].pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::measures::max_or_nan;
    use crate::scene::builtin::load;
    use crate::simulation::Simulation;

    const FRAMES: usize = 40;

    /// The press, whose plates and muscle go along together at a steady speed.
    fn carried(more: &[&str]) -> Simulation {
        let mut changes = vec![
            format!("frames={FRAMES}"),
            "muscle.0.edge_length='24 mm'".to_owned(),
            "effects.damping.rate='100 1/s'".to_owned(),
            "effects.gravity=off".to_owned(),
        ];
        // 60 mm in 40 frames.
        changes.push("bone.0.motion.keys.1.translation=['150 mm', '32 mm', '0 mm']".to_owned());
        changes.push("bone.1.motion.keys.1.translation=['150 mm', '-32 mm', '0 mm']".to_owned());
        changes.extend(more.iter().map(|&c| c.to_owned()));
        Simulation::new(load("press", &changes).expect("a scene")).expect("meshes")
    }

    /// By how far vertices fall behind the plates after all frames [m].
    fn behind(mut run: Simulation) -> f64 {
        (0..FRAMES).for_each(|_| run.step_frame());
        let body = &run.bodies[0];
        let pairs = body
            .system
            .particles
            .position
            .iter()
            .zip(&body.rest.vertices);
        max_or_nan(pairs.map(|(x, rest)| (x.x - rest.x - 0.06).abs()))
    }

    #[test]
    fn damping_does_not_slow_down_what_goes_along_with_its_bones() {
        let found = behind(carried(&[]));
        assert!(found <= 1e-3, "{found}");
        // Control: relative to space.
        let mut run = carried(&[]);
        run.bodies[0].carriage = Carriage::default();
        let control = behind(run);
        assert!(control > 3.0 * found && control > 3e-3, "{control} {found}");
    }

    /// RMS of the differences of velocities along edges [m/s] after the sudden start of the plates.
    fn unevenness(more: &[&str]) -> f64 {
        let mut run = carried(more);
        (0..6).for_each(|_| run.step_frame());
        let body = &run.bodies[0];
        let v = &body.system.particles.velocity;
        let each = body.edges.iter().map(|e| {
            let [a, b] = e.points.map(|p| v[p as usize]);
            (a - b).norm_squared()
        });
        (each.sum::<f64>() / body.edges.len() as f64).sqrt()
    }

    #[test]
    fn dampers_between_neighbours_even_out_velocities_and_slow_down_nothing() {
        let dampers = &["effects.damping.retardation='20 ms'"];
        let behind = behind(carried(dampers));
        assert!(behind <= 1e-3, "{behind}");
        let (found, control) = (unevenness(dampers), unevenness(&[]));
        assert!(found <= 0.5 * control, "{found} {control}");
        // Classic PBD has no stiffness that dampers could follow.
        let classic = carried(&[dampers[0], "solver=pbd"]);
        assert!(classic.bodies[0].viscosity.is_none());
    }

    #[test]
    fn shares_of_several_motions_have_a_sum_of_at_most_one() {
        let turned = "bone.1.motion.keys.1.translation=['90 mm', '-32 mm', '0 mm']";
        let run = carried(&[turned]);
        let groups = &run.bodies[0].carriage.groups;
        assert_eq!(groups.len(), 2);
        for v in 0..run.bodies[0].rest.vertices.len() {
            let sum: f64 = groups.iter().map(|(_, shares)| shares[v]).sum();
            assert!((sum - 1.0).abs() <= 1e-9, "{sum}");
        }
    }
}
