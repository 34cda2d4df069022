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
use crate::simulation::fault::{Fault, LoadError, all_of};
use crate::simulation::ready::Rest;
use crate::solvers::Held;

pub(in crate::simulation) fn attach(
    scene: &Scene,
    m: usize,
    rest: &Rest,
    assets: &Assets,
    placed: &[PosedObstacle],
) -> Result<(Vec<Attached>, Vec<Freed>), LoadError> {
    let mesh = &rest.mesh;
    let all = 0..scene.muscles[m].attachments.len();
    let found = all_of(all.map(|a| attach_at(scene, (m, a), rest, assets, placed)))?;
    let (choices, freed): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    let attached = attachments::join(&choices);
    let count = mesh.vertices.len();
    // Parts with short edges have many vertices and little of the surface, parts with long ones few and
    // much.
    let areas = mesh.vertex_areas();
    let held: f64 = attached.iter().map(|&(v, _)| areas[v as usize]).sum();
    let too_many = attached.len() as f64 > scene.most_held * count as f64;
    let too_large = held > scene.most_held * areas.iter().sum::<f64>();
    // A few points (the tetrahedron scenes) may be fixed deliberately.
    if too_many && too_large && count > 100 {
        let fault = Fault::TooManyAttached {
            held: attached.len(),
            count,
        };
        return Err(LoadError::new(
            scene,
            &format!("muscle.{m}.attachment"),
            format!("muscle `{}`", scene.muscles[m].name),
            fault,
        ));
    }
    Ok((attached, freed.into_iter().flatten().collect()))
}

/// The bone of an attachment, its vertices, and what of it is not held.
type Found = ((usize, Vec<u32>), Option<Freed>);

/// The vertices of attachment `a` of muscle `m`.
fn attach_at(
    scene: &Scene,
    (m, a): (usize, usize),
    rest: &Rest,
    assets: &Assets,
    placed: &[PosedObstacle],
) -> Result<Found, LoadError> {
    let (muscle, mesh) = (&scene.muscles[m], &rest.mesh);
    let (attachment, patch) = (&muscle.attachments[a], &assets.patches[m][a]);
    let edge = mesh.median_edge_length(&rest.topology()).unwrap_or(0.0);
    let bone = attachment.bone;
    let unfit = |key: &str, fault| {
        let (of, to) = (&muscle.name, &placed[bone].name);
        let part = format!("attachment of muscle `{of}` to `{to}`");
        LoadError::new(
            scene,
            &format!("muscle.{m}.attachment.{a}.{key}"),
            part,
            fault,
        )
    };
    let (is_solid, within) = match &attachment.area {
        AreaSpec::Vertices(list) => {
            check_indices(list, mesh.vertices.len(), muscle.edge_length.is_some())
                .map_err(|(at, fault)| unfit(&format!("vertices.{at}"), fault))?;
            return Ok(((bone, list.clone()), None));
        }
        AreaSpec::Near(within) => (true, *within),
        AreaSpec::Patch { within, .. } => (false, *within),
    };
    let obstacle = match patch {
        Some(patch) => assets.ready.surface(patch) as Arc<dyn Obstacle>,
        None => placed[bone].obstacle.clone(),
    };
    let near = rest.near(&obstacle, &placed[bone].now);
    let course = Course::new(scene, bone, placed, edge);
    let mut carried = Vec::new();
    let most = (within, attachment.limit);
    let found = attachments::among(&near.closest, is_solid, most, |v| {
        course.stays_out(&mesh.vertices[v as usize], &mut carried)
    });
    let area = area_key(patch.is_some());
    let freed = carried.first().map(|&(other, frame)| Freed {
        muscle: m,
        bones: [bone, other],
        frame,
        free: carried.len(),
        held: found.len(),
    });
    if let (true, Some(freed)) = (found.is_empty(), &freed) {
        let (bone, frame) = (placed[freed.bones[1]].name.clone(), freed.frame);
        return Err(unfit(area, Fault::CarriedInto { bone, frame }));
    }
    if found.is_empty() {
        let everyone = (within, 1.0);
        let near_enough = attachments::among(&near.closest, is_solid, everyone, |_| true).len();
        if near_enough > 0 {
            let fault = Fault::LimitedToNothing {
                near: near_enough,
                count: mesh.vertices.len(),
                percent: (1e5 * attachment.limit).round() / 1e3,
            };
            return Err(unfit("limit", fault));
        }
        let distances = near.closest.iter().flatten().map(|c| c.distance.abs());
        let nearest_mm = distances.fold(f64::INFINITY, f64::min) * 1e3;
        return Err(unfit(area, Fault::NothingAttached { nearest_mm }));
    }
    Ok(((bone, found), freed))
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
            .for_each(|&v| particles.position[v as usize] += displacement.vector);
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
        all.extend(force.vertices.iter().map(|&v| (v, force.vector)));
    }
    Ok(all)
}
