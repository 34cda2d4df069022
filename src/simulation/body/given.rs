//! Boundary conditions at the vertices of a muscle: attachments, forces, displacements.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::contact::{Obstacle, PosedObstacle};
use crate::mesh::TriangleMesh;
use crate::particles::Particles;
use crate::scene::{AreaSpec, Scene};
use crate::simulation::assets::Assets;
use crate::simulation::attachments::{self, Attached, Freed};
use crate::simulation::course::Course;
use crate::simulation::fault::{Fault, LoadError};
use crate::simulation::ready::Rest;
use crate::solvers::Held;

pub(in crate::simulation) fn attach(
    scene: &Scene,
    m: usize,
    rest: &Rest,
    assets: &Assets,
    placed: &[PosedObstacle],
) -> Result<(Vec<Attached>, Vec<Freed>), LoadError> {
    let (muscle, mesh) = (&scene.muscles[m], &rest.mesh);
    let (mut choices, mut freed) = (Vec::new(), Vec::new());
    let edge = mesh.median_edge_length(&rest.topology()).unwrap_or(0.0);
    for (a, (attachment, patch)) in muscle
        .attachments
        .iter()
        .zip(&assets.patches[m])
        .enumerate()
    {
        let bone = attachment.bone;
        let part = || {
            format!(
                "attachment of muscle `{}` to `{}`",
                muscle.name, placed[bone].name
            )
        };
        let key = format!("muscle.{m}.attachment.{a}");
        let obstacle = match patch {
            Some(patch) => assets.ready.surface(patch) as Arc<dyn Obstacle>,
            None => placed[bone].obstacle.clone(),
        };
        let near = || rest.near(&obstacle, &placed[bone].now);
        let course = Course::new(scene, bone, placed, edge);
        let mut carried = Vec::new();
        let found = match (&attachment.area, patch) {
            (AreaSpec::Vertices(list), _) => {
                check_indices(list, mesh.vertices.len(), muscle.edge_length.is_some()).map_err(
                    |(at, fault)| {
                        LoadError::new(scene, &format!("{key}.vertices.{at}"), part(), fault)
                    },
                )?;
                list.clone()
            }
            (AreaSpec::Near(within), _) => {
                let most = (*within, attachment.limit);
                attachments::among(&near().closest, true, most, |v| {
                    course.stays_out(&mesh.vertices[v as usize], &mut carried)
                })
            }
            (AreaSpec::Patch { within, .. }, Some(_)) => {
                let most = (*within, attachment.limit);
                attachments::among(&near().closest, false, most, |v| {
                    course.stays_out(&mesh.vertices[v as usize], &mut carried)
                })
            }
            (AreaSpec::Patch { .. }, None) => Vec::new(),
        };
        if let Some(&(other, frame)) = carried.first() {
            if found.is_empty() {
                let (bone, area) = (placed[other].name.clone(), area_key(patch.is_some()));
                let fault = Fault::CarriedInto { bone, frame };
                return Err(LoadError::new(
                    scene,
                    &format!("{key}.{area}"),
                    part(),
                    fault,
                ));
            }
            freed.push(Freed {
                muscle: m,
                bones: [bone, other],
                frame,
                free: carried.len(),
                held: found.len(),
            });
        }
        if found.is_empty() {
            let near = near();
            let distances = near.closest.iter().flatten().map(|c| c.distance.abs());
            let nearest_mm = distances.fold(f64::INFINITY, f64::min) * 1e3;
            let area = area_key(patch.is_some());
            let fault = Fault::NothingAttached { nearest_mm };
            return Err(LoadError::new(
                scene,
                &format!("{key}.{area}"),
                part(),
                fault,
            ));
        }
        choices.push((bone, found));
    }
    let attached = attachments::join(&choices);
    let count = mesh.vertices.len();
    // A few points (the tetrahedron scenes) may be fixed deliberately.
    if attached.len() as f64 > scene.most_held * count as f64 && count > 100 {
        let fault = Fault::TooManyAttached {
            held: attached.len(),
            count,
        };
        return Err(LoadError::new(
            scene,
            &format!("muscle.{m}.attachment"),
            format!("muscle `{}`", muscle.name),
            fault,
        ));
    }
    Ok((attached, freed))
}

/// The key with the distance of an attachment.
fn area_key(has_patch: bool) -> &'static str {
    if has_patch { "within" } else { "near" }
}

/// Rejects an index outside of the mesh, with its position in the list.
fn check_indices(list: &[u32], count: usize, refined: bool) -> Result<(), (usize, Fault)> {
    match list.iter().position(|&v| v as usize >= count) {
        Some(at) => Err((
            at,
            Fault::NoSuchVertex {
                index: list[at],
                count,
                refined,
            },
        )),
        None => Ok(()),
    }
}

pub(super) fn hold(
    attached: &[Attached],
    mesh: &TriangleMesh,
    placed: &[PosedObstacle],
) -> Vec<Held> {
    let local = |v: u32, bone: usize| placed[bone].now.inverse() * mesh.vertices[v as usize];
    attached
        .iter()
        .map(|&(vertex, bone)| Held {
            vertex,
            bone,
            local: local(vertex, bone),
        })
        .collect()
}

pub(super) fn displace(
    scene: &Scene,
    m: usize,
    particles: &mut Particles,
) -> Result<(), LoadError> {
    let (muscle, count) = (&scene.muscles[m], particles.len());
    for (d, displacement) in muscle.displacements.iter().enumerate() {
        check_indices(&displacement.vertices, count, muscle.edge_length.is_some()).map_err(
            |(at, fault)| {
                let key = format!("muscle.{m}.displace.{d}.vertices.{at}");
                LoadError::new(
                    scene,
                    &key,
                    format!("displacement of muscle `{}`", muscle.name),
                    fault,
                )
            },
        )?;
        displacement
            .vertices
            .iter()
            .for_each(|&v| particles.position[v as usize] += displacement.by);
    }
    Ok(())
}

pub(super) fn forces(
    scene: &Scene,
    m: usize,
    count: usize,
) -> Result<Vec<(u32, Vector3<f64>)>, LoadError> {
    let muscle = &scene.muscles[m];
    let mut all = Vec::new();
    for (f, force) in muscle.forces.iter().enumerate() {
        check_indices(&force.vertices, count, muscle.edge_length.is_some()).map_err(
            |(at, fault)| {
                let key = format!("muscle.{m}.force.{f}.vertices.{at}");
                LoadError::new(
                    scene,
                    &key,
                    format!("force on muscle `{}`", muscle.name),
                    fault,
                )
            },
        )?;
        all.extend(force.vertices.iter().map(|&v| (v, force.force)));
    }
    Ok(all)
}
