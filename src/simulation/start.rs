//! The shapes at the start of a simulation: without overlap with bones and between muscles.

use std::sync::Arc;

use rayon::prelude::*;

use super::assets::Assets;
use super::attachments::{Attached, Freed};
use super::body::attach;
use super::fault::{Fault, LoadError};
use super::plan::{MusclePlan, Plan};
use super::ready::{Among, Rest};
use crate::contact::apart::{Gaps, PartedPair};
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
        let (mut attached, mut freed) = (Vec::new(), Vec::new());
        for (m, asset) in assets.muscles.iter().enumerate() {
            let read = assets.ready.rest(&asset.mesh);
            let (held, free) = attach(scene, m, &read, assets, placed)?;
            attached.push(held);
            freed.extend(free);
        }
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
            let parted = parted.1.as_ref().map_err(|error| {
                let muscle = scene.muscles.iter().position(|m| m.name == error.pair[0]);
                let key = format!("muscle.{}", muscle.unwrap_or(0));
                let part = format!("muscle `{}`", error.pair[0]);
                LoadError::new(scene, &key, part, Fault::Inseparable(error.clone()))
            })?;
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

/// The shape at rest: that of the plan, or as read without its overlap with bones. If the removal
/// moves a vertex far, it does not come to rest: such a muscle is as read, and parted from the bones
/// later, when its side of each is known.
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
    let clear = assets
        .ready
        .clear(&read, placed, &plan.obstacles, contact.thickness);
    // Capsules have no triangles that could be crossed.
    let is_bone = |o: &usize| *o < scene.bones.len();
    let is_parted = clear.done.moved <= clear.done.farthest(contact.thickness);
    if !is_parted && plan.obstacles.iter().all(is_bone) && read.topology().is_closed() {
        return (read, Untangled::default());
    }
    (clear.rest.clone(), clear.done)
}
