//! Interactive changes of a running simulation: other numbers, a dragged vertex, a bone moved by
//! hand.

use nalgebra::{Isometry3, Point3};

use super::ready::same_pose;
use super::{Body, Simulation, Stepper};
use crate::contact::{Contacts, PosedObstacle};
use crate::scene::{ContactEffect, Key, Motion};
use crate::solvers::System;
use crate::solvers::grip::{DRAG, Grip};
use crate::state::{Reader, Writer};

impl Simulation {
    /// Continues from the state of `other`, made from the same meshes with other numbers: frame,
    /// poses, positions and velocities, and contact state where it is still valid; otherwise
    /// contact is queried again. Stopped muscles resume.
    ///
    /// A muscle with another number of vertices stays at its start.
    pub fn continue_from(&mut self, other: &Self) {
        self.frame = other.frame;
        self.control = other.control.taken_over(&self.control);
        self.notes.clone_from(&other.notes);
        for (placed, there) in self.placed.iter_mut().zip(&other.placed) {
            (placed.before, placed.now) = (there.before, there.now);
        }
        let (contact, same) = (self.scene.effects.contact, self.has_obstacles_of(other));
        for (body, there) in self.bodies.iter_mut().zip(&other.bodies) {
            if body.system.particles.len() == there.system.particles.len() {
                body.continue_from(there, &self.placed, contact, same);
                body.shorten(self.frame as f64, 1.0, &self.placed);
            }
        }
        self.leave_finer_mesh();
        if let Some(mut runs) = self.refinement.take() {
            runs.begin_at(self);
            self.refinement = Some(runs);
        }
    }

    /// A finer mesh does not follow what is changed by hand.
    fn leave_finer_mesh(&mut self) {
        if self.finer.take().is_some() && self.frame > 0 {
            let frame = self.frame;
            self.notes.push(format!(
                "changed by hand after frame {frame}: the error of the mesh is not told"
            ));
        }
    }

    /// What moves by hand has no run beside it that tells its error.
    fn leave_accuracy(&mut self) {
        self.leave_finer_mesh();
        if let Some(runs) = self.refinement.take() {
            runs.leave(self);
            let frame = self.frame;
            self.notes.push(format!(
                "moved by hand after frame {frame}: from there on no accuracy is kept"
            ));
        }
    }

    /// True if the obstacles are those of `other`; takes over their poses.
    fn has_obstacles_of(&self, other: &Self) -> bool {
        let shape =
            |capsule: &crate::scene::Capsule| (capsule.bone, capsule.segment, capsule.radius);
        let capsules = self.scene.capsules.iter().map(shape);
        let same = |(a, b): (&PosedObstacle, &PosedObstacle)| {
            a.obstacle.contact_samples() == b.obstacle.contact_samples()
        };
        if !capsules.eq(other.scene.capsules.iter().map(shape))
            || self.placed.len() != other.placed.len()
            || !self.placed.iter().zip(&other.placed).all(same)
        {
            return false;
        }
        let bones = other.placed.iter().take(self.scene.bones.len());
        bones
            .enumerate()
            .all(|(b, placed)| same_pose(&self.pose(b, self.frame as f64), &placed.now))
    }

    /// Moves a bone from its pose to `pose` in the next frame; the bone stays there.
    pub fn move_bone(&mut self, bone: usize, pose: Isometry3<f64>) {
        self.leave_accuracy();
        let key = |frame: usize, pose| Key {
            frame: frame as f64,
            pose,
        };
        let keys = vec![
            key(self.frame, self.pose(bone, self.frame as f64)),
            key(self.frame + 1, pose),
        ];
        let joint = self.scene.bones[bone].motion.joint.take();
        self.scene.bones[bone].motion = Motion {
            keys,
            joint,
            linear: true,
        };
    }

    /// Goes back to before a frame, with bones at `poses` before and after it.
    pub(super) fn stand_still(&mut self, frame: usize, poses: &[Isometry3<f64>]) {
        self.frame = frame - 1;
        for (bone, &pose) in self.scene.bones.iter_mut().zip(poses) {
            let frames = [self.frame, frame];
            let key = |frame: usize| Key {
                frame: frame as f64,
                pose,
            };
            bone.motion = Motion {
                keys: frames.map(key).to_vec(),
                joint: None,
                linear: true,
            };
        }
    }

    /// Drags a vertex of a muscle to a position [m] with a spring of `stiffness` [N/m], which
    /// replaces an earlier one; see [`Grip`].
    pub fn drag(&mut self, muscle: usize, vertex: u32, to: Point3<f64>, stiffness: f64) {
        self.leave_accuracy();
        self.let_go(muscle);
        let (body, grip) = (&mut self.bodies[muscle], Grip::new(vertex, to, stiffness));
        match body.equilibrium_mut() {
            Some(equilibrium) => {
                let potential = Box::new(grip.potential());
                equilibrium.energy_mut().elastic.push(potential);
            }
            None => body.system.elastic.push(Box::new(grip)),
        }
    }

    /// Releases the dragged vertex of a muscle.
    pub fn let_go(&mut self, muscle: usize) {
        let body = &mut self.bodies[muscle];
        body.system.elastic.retain(|part| part.name() != DRAG);
        if let Some(equilibrium) = body.equilibrium_mut() {
            equilibrium
                .energy_mut()
                .elastic
                .retain(|part| part.name() != DRAG);
        }
    }
}

impl Body {
    /// `same` is true if the obstacles are the same.
    fn continue_from(
        &mut self,
        other: &Self,
        placed: &[PosedObstacle],
        contact: Option<ContactEffect>,
        same: bool,
    ) {
        let (system, there) = (&mut self.system, &other.system);
        system
            .particles
            .position
            .clone_from(&there.particles.position);
        system
            .particles
            .velocity
            .clone_from(&there.particles.velocity);
        system.speed_cuts = there.speed_cuts;
        self.contraction.continue_from(&other.contraction);
        // Angles are known up to full turns only: the state of hinges is kept if the hinges are the
        // same.
        for part in &mut system.elastic {
            let (name, count) = (part.name(), part.len());
            let Some(before) = there
                .elastic
                .iter()
                .find(|p| p.name() == name && p.len() == count)
            else {
                continue;
            };
            let mut kept = Writer::default();
            before.save(&mut kept);
            // The kind and number are the same, so the state fits.
            let _ = part.restore(&mut Reader::new(&kept.bytes));
        }
        if let Stepper::Minimum(equilibrium) = &mut self.method {
            equilibrium
                .energy_mut()
                .remember(&system.particles.position);
        }
        if let (Some(contact), false) = (contact, self.rest.triangles.is_empty()) {
            let near = |system: &System| system.contacts.as_ref().map(|c| c.obstacles().to_vec());
            let mut obstacles = [near(system), near(there)]
                .into_iter()
                .flatten()
                .flatten()
                .collect::<Vec<_>>();
            obstacles.sort_unstable();
            obstacles.dedup();
            if !obstacles.is_empty() {
                let ContactEffect {
                    thickness,
                    friction,
                    ..
                } = contact;
                // The remains of an interrupted step are not used.
                let is_known = |known: &&Contacts| {
                    same && other.stopped.is_none() && known.obstacles() == obstacles
                };
                let contacts = match there.contacts.as_ref().filter(is_known) {
                    Some(known) => known.with(&system.particles, placed, (thickness, friction)),
                    None => Contacts::new(
                        &self.rest,
                        &system.particles,
                        placed,
                        obstacles,
                        thickness,
                        friction,
                    ),
                };
                system.contacts = Some(contacts);
            }
        }
        self.untangled = other.untangled;
        self.good.clone_from(&self.system.particles);
    }
}
