//! Bonds between muscles: which run, with which stiffness, and their notes.

use super::plan::Plan;
use super::{Body, Simulation};
use crate::contact::meeting::BondSpec;
use crate::scene::{Bonding, Interface, Scene};
use crate::solvers::stiffness;

/// Greatest distance of a bonded vertex from the other muscle at rest, relative to the contact
/// thickness.
const WITHIN: f64 = 2.0;

/// The bond of an interface between two bodies of a simulation.
pub(super) struct Bonded {
    /// Index of the interface in the scene.
    pub interface: usize,
    /// The bodies.
    pub bodies: [usize; 2],
}

/// Greatest distance of a bonded vertex from the other muscle at rest [m].
pub(super) fn within(scene: &Scene, bonding: &Bonding) -> f64 {
    let thickness = scene.effects.contact.map_or(0.0, |c| c.thickness);
    bonding.within.unwrap_or(WITHIN * thickness)
}

/// The reason why a bond does not run; `None` if it does.
pub(super) fn left_out(scene: &Scene, plan: &Plan, interface: &Interface) -> Option<&'static str> {
    let bonding = interface.bond.as_ref()?;
    let Some(contact) = scene.effects.contact else {
        return Some("muscles step together with [effects.contact] alone");
    };
    if !contact.between.muscles {
        return Some("`effects.contact.between` does not name muscles");
    }
    let [a, b] = interface.between;
    let meets = |a: usize, b: usize| plan.muscles[a].partners.contains(&b);
    if !(meets(a, b) || meets(b, a)) {
        return Some("the boxes that the muscles sweep never meet");
    }
    let is_soft = |m: &usize| scene.muscles[*m].material.stretch == 0.0;
    if bonding.stiffness.is_none() && interface.between.iter().any(is_soft) {
        return Some("its stiffness is that of `stretch`, which is zero for one of the muscles");
    }
    None
}

impl Simulation {
    /// The bonds that run.
    pub(super) fn bonded(&self) -> Vec<Bonded> {
        let scene = &self.scene;
        let body_of = |m: usize| {
            let name = &scene.muscles[m].name;
            self.bodies.iter().position(|body| body.name == *name)
        };
        let mut all = Vec::new();
        for (k, interface) in scene.interfaces.iter().enumerate() {
            let runs = interface.bond.is_some() && left_out(scene, &self.plan, interface).is_none();
            let [a, b] = interface.between;
            if let (true, Some(a), Some(b)) = (runs, body_of(a), body_of(b)) {
                all.push(Bonded {
                    interface: k,
                    bodies: [a, b],
                });
            }
        }
        all
    }

    /// The bond as the meeting of two of its `members` needs it.
    pub(super) fn bond_spec(&self, bonded: &Bonded, members: [usize; 2]) -> Option<BondSpec> {
        let bonding = self.scene.interfaces[bonded.interface].bond?;
        let [a, b] = bonded.bodies.map(|b| &self.bodies[b]);
        let stretch = |body: &Body| {
            let mut muscles = self.scene.muscles.iter();
            let muscle = muscles.find(|muscle| muscle.name == body.name);
            muscle.map_or(0.0, |muscle| muscle.material.stretch)
        };
        let edge = a.edge_length.max(b.edge_length);
        let usual = stiffness::bond([stretch(a), stretch(b)], edge);
        Some(BondSpec {
            members,
            within: within(&self.scene, &bonding),
            stiffness: bonding.stiffness.unwrap_or(usual),
        })
    }

    /// Notes each bond that has no spring.
    pub(super) fn note_bonds(&mut self) {
        for group in &self.groups {
            for &(interface, count) in group.bonds() {
                let Interface { between, bond } = &self.scene.interfaces[interface];
                if let (Some(bonding), 0) = (bond, count) {
                    let [a, b] = between.map(|m| &self.scene.muscles[m].name);
                    let within = 1e3 * within(&self.scene, bonding);
                    self.notes.push(format!(
                        "{a}: no vertex is within {within} mm of {b} at rest, or the reverse; they slide, although their interface is bonded"
                    ));
                }
            }
        }
    }
}
