//! The shapes at the start of a simulation: without overlap with bones and between muscles.

use std::sync::Arc;

use rayon::prelude::*;

use super::assets::Assets;
use super::attachments::{Attached, Freed};
use super::body::attach;
use super::fault::{Fault, LoadError, all_of};
use super::plan::{MusclePlan, Plan};
use super::ready::{Among, Rest};
use crate::contact::apart::{Gaps, Inseparable, PartedPair};
use crate::contact::untangle::Untangled;
use crate::contact::{PosedObstacle, Surface};
use crate::scene::Scene;

/// Gap between two muscles that were parted, relative to the contact thickness.
const BETWEEN: f64 = 0.1;

/// The shapes of all muscles at the start.
pub(super) struct Start {
    /// Each muscle's attached vertices and shape, with the measures of the removal of overlap.
    pub muscles: Vec<(Vec<Attached>, Arc<Rest>, Untangled)>,
    /// The pairs that overlapped.
    pub pairs: Vec<PartedPair>,
    /// What of the attachments is not held.
    pub freed: Vec<Freed>,
}

impl Start {
    /// Moves the muscles of `scene` out of the bones and apart from each other; `placed` are all
    /// obstacles at frame 0 and `surfaces` the bones among them.
    ///
    /// # Errors
    /// An attachment with no vertices, too many, or vertices that do not exist; two surfaces that
    /// cannot be parted.
    pub fn new(
        scene: &Scene,
        assets: &Assets,
        plan: &Plan,
        placed: &[PosedObstacle],
        surfaces: &[Arc<Surface>],
    ) -> Result<Self, LoadError> {
        let held = assets.muscles.iter().enumerate().map(|(m, asset)| {
            let read = assets.ready.rest(&asset.mesh);
            attach(scene, m, &read, assets, placed)
        });
        let (attached, freed): (Vec<_>, Vec<_>) = all_of(held)?.into_iter().unzip();
        let freed = freed.into_iter().flatten().collect();
        let bones: Vec<_> = surfaces
            .iter()
            .cloned()
            .zip(placed)
            .filter(|_| scene.effects.contact.is_some_and(|c| c.between.bones))
            .map(|(s, p)| (p.name.clone(), s, p.now))
            .collect();
        let rests = assets.muscles.par_iter().zip(&plan.muscles);
        let mut muscles: Vec<(Arc<Rest>, Untangled)> = rests
            .map(|(asset, plan)| at_rest(scene, assets, plan, placed, &asset.mesh))
            .collect();
        let given = plan.muscles.iter().any(|muscle| muscle.rest.is_some());
        let Some(contact) = scene.effects.contact.filter(|_| !given) else {
            return Ok(Self::of(attached, muscles, Vec::new(), freed));
        };
        // The order in which a scene lists them changes nothing.
        let mut all: Vec<usize> = (0..muscles.len()).collect();
        all.sort_by(|&a, &b| scene.muscles[a].name.cmp(&scene.muscles[b].name));
        // Muscles that do not meet are parted from bones alone.
        let sets = match contact.between.muscles {
            true => vec![all],
            false => all.into_iter().map(|m| vec![m]).collect(),
        };
        let mut pairs = Vec::new();
        for set in sets {
            let read = |&m: &usize| assets.ready.rest(&assets.muscles[m].mesh);
            let among = Among {
                names: set.iter().map(|&m| scene.muscles[m].name.clone()).collect(),
                read: set.iter().map(read).collect(),
                clear: set.iter().map(|&m| muscles[m].0.clone()).collect(),
                attached: set.iter().map(|&m| attached[m].clone()).collect(),
                bones: bones.clone(),
                gaps: Gaps {
                    to_bones: contact.thickness,
                    between: BETWEEN * contact.thickness,
                },
            };
            let parted = assets.ready.parted(among);
            let left = parted.1.as_ref().err().into_iter().flatten();
            all_of(left.map(|error| Err::<(), _>(inseparable(scene, error))))?;
            let Ok(parted) = &parted.1 else { continue };
            for (&m, (to, moved)) in set.iter().zip(&parted.muscles) {
                let (rest, untangled) = &mut muscles[m];
                if !Arc::ptr_eq(rest, to) {
                    *rest = to.clone();
                    untangled.moved = moved.max;
                    untangled.volume_change = moved.volume_change;
                }
            }
            pairs.extend(parted.pairs.iter().cloned());
        }
        Ok(Self::of(attached, muscles, pairs, freed))
    }

    fn of(
        attached: Vec<Vec<Attached>>,
        rests: Vec<(Arc<Rest>, Untangled)>,
        pairs: Vec<PartedPair>,
        freed: Vec<Freed>,
    ) -> Self {
        let muscles = attached.into_iter().zip(rests);
        Self {
            muscles: muscles
                .map(|(attached, (rest, done))| (attached, rest, done))
                .collect(),
            pairs,
            freed,
        }
    }
}

/// The error for two surfaces that cannot be parted.
fn inseparable(scene: &Scene, error: &Inseparable) -> LoadError {
    let muscle = scene.muscles.iter().position(|m| m.name == error.pair[0]);
    let key = format!("muscle.{}", muscle.unwrap_or(0));
    let part = format!("muscle `{}`", error.pair[0]);
    LoadError::new(scene, &key, part, Fault::Inseparable(error.clone()))
}

/// The shape at rest: that of the plan, or as read. A closed muscle is parted from bones later, when
/// its side of each is known; others leave the bones and capsules here, on the nearest side.
fn at_rest(
    scene: &Scene,
    assets: &Assets,
    plan: &MusclePlan,
    placed: &[PosedObstacle],
    read: &crate::mesh::TriangleMesh,
) -> (Arc<Rest>, Untangled) {
    let read = assets.ready.rest(read);
    if let Some(mesh) = &plan.rest {
        return (assets.ready.rest(mesh), Untangled::default());
    }
    let Some(contact) = scene.effects.contact.filter(|_| !plan.obstacles.is_empty()) else {
        return (read, Untangled::default());
    };
    // Capsules have no triangles that could be crossed; an open surface has no inside.
    let is_bone = |o: &usize| *o < scene.bones.len();
    if plan.obstacles.iter().all(is_bone) && read.topology().is_closed() {
        return (read, Untangled::default());
    }
    let clear = assets
        .ready
        .clear(&read, placed, &plan.obstacles, contact.thickness);
    (clear.rest.clone(), clear.done)
}
