//! Muscles at the equilibrium of a frame.

use std::ops::Range;

use nalgebra::Vector3;

use super::{Balanced, BodyPart, SensitivityError, Settled, unsolved};
use crate::contact::{ContactPlane, PosedObstacle};
use crate::fibres::polyline::length;
use crate::mesh::measures::{area, volume};
use crate::progress::Progress;
use crate::scene::{Content, Scene, SolverQuestion};
use crate::simulation::frame::{FrameSteps, Stop};
use crate::simulation::joint::combined;
use crate::simulation::{Assets, Body, LoadError, Plan, Simulation, Stepped};
use crate::solvers::Tangent;
use crate::solvers::descent::DescentSettings;
use std::sync::atomic::AtomicU64;

/// Residual of the equilibrium, relative to the force of unit strain.
const TOLERANCE: f64 = 1e-5;

/// Newton's method to the equilibrium itself.
const NEWTON: DescentSettings = DescentSettings {
    tolerance: 1e-10,
    iterations: 60,
};

/// Muscles at equilibrium.
pub(super) struct SettledMuscles {
    /// The scene, whose bones move as given.
    scene: Scene,
    assets: Assets,
    run: Simulation,
    /// Residual of the equilibrium, relative to the force of unit strain.
    left: f64,
    parts: Vec<Part>,
}

/// Muscles that can meet.
struct Part {
    /// Each body with its vertices.
    bodies: Vec<(usize, Range<usize>)>,
    /// What touches.
    rows: Vec<ContactPlane>,
}

/// The same scene with equilibrium in every frame.
pub(super) fn at_rest(scene: &Scene) -> Scene {
    Scene {
        solver: SolverQuestion::Equilibrium.minimised(1, TOLERANCE),
        accuracy: None,
        mesh_error: false,
        adapts_steps: false,
        ..scene.clone()
    }
}

/// A simulation of a scene at rest, with the meshes `known` of a similar scene if they are the same.
fn resting(
    scene: &Scene,
    known: Option<(&Scene, &Assets)>,
) -> Result<(Simulation, Assets), LoadError> {
    let same = known.filter(|(other, _)| has_meshes_of(scene, other));
    let assets = match same {
        Some((_, assets)) => {
            assets.suit(scene)?;
            assets.clone()
        }
        None => Assets::load(scene)?,
    };
    let scene = at_rest(scene);
    let plan = Plan::new(&scene, &assets);
    Ok((Simulation::with(scene, assets.clone(), plan)?, assets))
}

/// True if two scenes differ in materials and effects only.
fn has_meshes_of(scene: &Scene, other: &Scene) -> bool {
    let mut alike = scene.clone();
    alike.effects.clone_from(&other.effects);
    let each = alike.muscles.iter_mut().zip(&other.muscles);
    each.for_each(|(muscle, other)| muscle.material.clone_from(&other.material));
    alike == *other
}

impl SettledMuscles {
    /// The parts of a scene where the muscles of this one are.
    fn here(&self, scene: &Scene) -> Result<Option<Vec<Balanced>>, SensitivityError> {
        let contact = |scene: &Scene| scene.effects.contact;
        // What lies on a bone would have to move with it, or with its thickness.
        let is_same = scene.bones == self.scene.bones
            && scene.capsules == self.scene.capsules
            && contact(scene) == contact(&self.scene);
        if !is_same {
            return Ok(None);
        }
        let (mut there, _) = resting(scene, Some((&self.scene, &self.assets)))?;
        let counts = there.bodies.iter().map(Body::count);
        if !counts.eq(self.run.bodies.iter().map(Body::count)) {
            return Ok(None);
        }
        there.continue_from(&self.run);
        let (frame, placed) = (self.run.frame(), &there.placed);
        let bodies = there.bodies.iter_mut();
        bodies.for_each(|body| body.prepare_still(frame, placed));
        let mut parts = Vec::new();
        for (g, part) in self.parts.iter().enumerate() {
            let mut bodies: Vec<Option<&mut Body>> = there.bodies.iter_mut().map(Some).collect();
            let mut own: Vec<&mut Body> = part
                .bodies
                .iter()
                .filter_map(|(b, _)| bodies[*b].take())
                .collect();
            let bonds = there.groups.get(g).and_then(|group| group.elastic_bonds());
            let energy = combined(&mut own, bonds);
            let mut x = Vec::new();
            for body in own {
                let first = x.len();
                x.extend_from_slice(&body.system.particles.position);
                for held in &body.system.held {
                    x[first + held.vertex as usize] = there.placed[held.bone].now * held.local;
                }
            }
            parts.push(Balanced { energy, x });
        }
        Ok(Some(parts))
    }
}

/// The next frame of a run.
pub(super) fn step(run: &mut Simulation, progress: &dyn Progress) -> Result<(), SensitivityError> {
    match run.step_frame_with(progress) {
        Stepped::Done => Ok(()),
        Stepped::Interrupted => Err(SensitivityError::Interrupted),
        Stepped::Failed(reason) => Err(SensitivityError::Failed(reason)),
    }
}

impl SettledMuscles {
    /// A run after one more frame.
    fn at_end(
        (scene, assets): (&Scene, Assets),
        mut run: Simulation,
        progress: &dyn Progress,
    ) -> Result<Self, SensitivityError> {
        step(&mut run, progress)?;
        if let Some(body) = run.bodies.iter().find(|body| body.stopped.is_some()) {
            let message = format!("{} stopped in frame {}", body.name, run.frame());
            return Err(SensitivityError::Failed(message));
        }
        let still: Vec<PosedObstacle> = run.placed.iter().map(PosedObstacle::still).collect();
        let done = AtomicU64::new(0);
        let of = FrameSteps {
            steps: Vec::new(),
            dt: 1.0,
            frame: run.frame(),
            thickness: scene.effects.contact.map_or(0.0, |c| c.thickness),
            is_last_try: true,
            stop: Stop::never(&done),
        };
        let mut left = 0.0;
        for group in &mut run.groups {
            let mut bodies: Vec<Option<&mut Body>> = run.bodies.iter_mut().map(Some).collect();
            let members = group.members.clone();
            let members = members.iter().filter_map(|&b| bodies[b].take());
            let mut bodies: Vec<&mut Body> = members.collect();
            let outcome = group
                .refine(&mut bodies, &still, &of, NEWTON)
                .map_err(unsolved)?;
            // Not `f64::max`, which would hide a NaN.
            if !(outcome.residual <= left) {
                left = outcome.residual;
            }
        }
        let mut parts = Vec::new();
        for group in &mut run.groups {
            let mut bodies = Vec::new();
            let mut first = 0;
            for &b in &group.members {
                let count = run.bodies[b].count();
                bodies.push((b, first..first + count));
                first += count;
            }
            let rows = group.touching(&run.bodies, &bodies, &still);
            parts.push(Part { bodies, rows });
        }
        Ok(Self {
            scene: scene.clone(),
            assets,
            run,
            left,
            parts,
        })
    }
}

impl Settled for SettledMuscles {
    fn settle(
        content: &Content,
        frame: usize,
        progress: &dyn Progress,
    ) -> Result<Self, SensitivityError> {
        let Content::Muscles(scene) = content else {
            return Err(SensitivityError::NotSupported(content.kind()));
        };
        let mut moving = Simulation::new(Scene {
            accuracy: None,
            mesh_error: false,
            ..(**scene).clone()
        })?;
        while moving.frame() + 1 < frame {
            let (done, stage) = (moving.frame(), format!("frame {}", moving.frame()));
            if progress.report(&stage, done, frame).is_break() {
                return Err(SensitivityError::Interrupted);
            }
            step(&mut moving, progress)?;
        }
        let (mut run, assets) = resting(scene, None)?;
        run.continue_from(&moving);
        progress.begin("equilibrium");
        Self::at_end((scene, assets), run, progress)
    }

    fn tangents(&self) -> Result<Vec<Tangent>, SensitivityError> {
        let mut tangents = Vec::new();
        for (part, Balanced { energy, x }) in self.parts.iter().zip(self.own()?) {
            let mut mass = Vec::new();
            for (b, _) in &part.bodies {
                mass.extend_from_slice(&self.run.bodies[*b].system.particles.inverse_mass);
            }
            tangents.push(Tangent::new(energy, &x, &mass, &part.rows).map_err(unsolved)?);
        }
        Ok(tangents)
    }

    fn left(&self) -> f64 {
        self.left
    }

    fn similar(&self, content: &Content) -> Result<Option<Vec<Balanced>>, SensitivityError> {
        match content {
            Content::Muscles(scene) => self.here(scene),
            _ => Ok(None),
        }
    }

    fn again(
        &self,
        content: &Content,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, SensitivityError> {
        let Content::Muscles(scene) = content else {
            return Ok(None);
        };
        let frame = self.run.frame();
        let (mut run, assets) = resting(scene, Some((&self.scene, &self.assets)))?;
        let count = |run: &Simulation| run.bodies.iter().map(Body::count).collect::<Vec<_>>();
        if count(&run) != count(&self.run) {
            return Ok(None);
        }
        let poses: Vec<_> = (0..run.bones.len())
            .map(|bone| run.pose(bone, frame as f64))
            .collect();
        run.continue_from(&self.run);
        // The same frame again, among bones that stand still.
        run.stand_still(frame, &poses);
        progress.begin("equilibrium");
        Self::at_end((scene, assets), run, progress).map(Some)
    }

    fn shift(&mut self, motions: &[Vec<Vector3<f64>>]) {
        for (part, motion) in self.parts.iter().zip(motions) {
            for (b, range) in &part.bodies {
                let particles = &mut self.run.bodies[*b].system.particles;
                let each = particles.position.iter_mut().zip(&motion[range.clone()]);
                each.for_each(|(x, by)| *x += by);
            }
        }
    }

    fn own(&self) -> Result<Vec<Balanced>, SensitivityError> {
        let found = self.here(&self.scene)?;
        found.ok_or_else(|| SensitivityError::Failed("the scene has changed".to_owned()))
    }

    fn measures(
        &self,
        parts: &[Balanced],
        pressures: &[Vec<f64>],
    ) -> Vec<(String, &'static str, f64)> {
        let mut all = Vec::new();
        for ((part, at), pressures) in self.parts.iter().zip(parts).zip(pressures) {
            let mut forces = vec![Vector3::zeros(); at.x.len()];
            at.energy.value_and_gradient(&at.x, &mut forces);
            let mut with_volume = pressures.iter();
            for (volume, pressure) in at.energy.volumes.iter().zip(pressures) {
                let (_, slopes) = volume.value_and_gradient(&at.x);
                let each = forces.iter_mut().zip(slopes);
                each.for_each(|(force, slope)| *force -= slope * *pressure);
            }
            for (b, range) in &part.bodies {
                let body = &self.run.bodies[*b];
                let (x, forces) = (&at.x[range.clone()], &forces[range.clone()]);
                let mut put = |of: String, name, value| all.push((of, name, value));
                let name = || body.name.clone();
                if !body.fibres.is_empty() {
                    let lines = body.fibres.at(x);
                    let sum: f64 = lines.iter().map(|line| length(line)).sum();
                    put(name(), "fibre_length_m", sum / lines.len() as f64);
                }
                if body.rest_volume > 0.0 {
                    put(name(), "area_m2", area(x, &body.rest.triangles));
                    put(name(), "volume_m3", volume(x, &body.rest.triangles));
                }
                if body.system.volume.is_some()
                    && let Some(pressure) = with_volume.next()
                {
                    put(name(), "pressure_pa", *pressure);
                }
                for (k, bone) in self.run.scene.bones.iter().enumerate() {
                    let held = body.system.held.iter().filter(|held| held.bone == k);
                    let held: Vec<u32> = held.map(|held| held.vertex).collect();
                    if !held.is_empty() {
                        let sum: Vector3<f64> = held.iter().map(|v| forces[*v as usize]).sum();
                        let of = format!("{} at {}", body.name, bone.name);
                        put(of, "force_n", sum.norm());
                    }
                }
            }
        }
        all
    }

    fn bodies(&self) -> Vec<BodyPart> {
        let mut all = Vec::new();
        for (k, part) in self.parts.iter().enumerate() {
            for (b, range) in &part.bodies {
                let body = &self.run.bodies[*b];
                let triangles = body.rest.triangles.clone();
                all.push((body.name.clone(), k, range.clone(), triangles));
            }
        }
        all
    }
}
