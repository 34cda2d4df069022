//! Muscles at the equilibrium of a frame.

use std::ops::Range;

use nalgebra::Vector3;

use super::{Balanced, SensitivityError, Settled, unsolved};
use crate::contact::ContactPlane;
use crate::fibres::polyline::length;
use crate::mesh::measures::{area, volume};
use crate::progress::Progress;
use crate::scene::{Content, Scene, SolverQuestion};
use crate::simulation::joint::combined;
use crate::simulation::{Body, Simulation, Stepped};
use crate::solvers::Response;

/// Residual of the equilibrium, relative to the force of unit strain.
const TOLERANCE: f64 = 1e-5;

/// Muscles at equilibrium.
pub(super) struct SettledMuscles {
    run: Simulation,
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
fn at_rest(scene: &Scene) -> Scene {
    Scene {
        solver: SolverQuestion::Equilibrium.minimised(1, TOLERANCE),
        accuracy: None,
        adapts_steps: false,
        ..scene.clone()
    }
}

impl SettledMuscles {
    /// The parts of a scene where the muscles of this one are.
    fn here(&self, scene: &Scene) -> Result<Option<Vec<Balanced>>, SensitivityError> {
        let mut there = Simulation::new(at_rest(scene))?;
        let count = |run: &Simulation| run.bodies.iter().map(Body::count).collect::<Vec<_>>();
        let poses = |run: &Simulation| {
            let frame = self.run.frame() as f64;
            let bones = 0..run.bones.len();
            bones.map(|bone| run.pose(bone, frame)).collect::<Vec<_>>()
        };
        // What lies on a bone would have to move with it.
        if count(&there) != count(&self.run) || poses(&there) != poses(&self.run) {
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

impl Settled for SettledMuscles {
    fn settle(
        content: &Content,
        frame: usize,
        progress: &dyn Progress,
    ) -> Result<Self, SensitivityError> {
        let Content::Muscles(scene) = content else {
            return Err(SensitivityError::NotSupported(content.kind()));
        };
        let step = |run: &mut Simulation| match run.step_frame_with(progress) {
            Stepped::Done => Ok(()),
            Stepped::Interrupted => Err(SensitivityError::Interrupted),
            Stepped::Failed(reason) => Err(SensitivityError::Failed(reason)),
        };
        let mut moving = Simulation::new(Scene {
            accuracy: None,
            ..(**scene).clone()
        })?;
        while moving.frame() + 1 < frame {
            let (done, stage) = (moving.frame(), "running to the frame");
            if progress.report(stage, done, frame).is_break() {
                return Err(SensitivityError::Interrupted);
            }
            step(&mut moving)?;
        }
        let mut run = Simulation::new(at_rest(scene))?;
        run.continue_from(&moving);
        progress.begin("equilibrium");
        step(&mut run)?;
        if let Some(body) = run.bodies.iter().find(|body| body.stopped.is_some()) {
            let message = format!("{} stopped before frame {frame}", body.name);
            return Err(SensitivityError::Failed(message));
        }
        let mut parts = Vec::new();
        let still: Vec<_> = run.placed.clone();
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
        Ok(Self { run, parts })
    }

    fn responses(&self) -> Result<Vec<Response>, SensitivityError> {
        let mut responses = Vec::new();
        for (part, Balanced { energy, x }) in self.parts.iter().zip(self.own()?) {
            let mut mass = Vec::new();
            for (b, _) in &part.bodies {
                mass.extend_from_slice(&self.run.bodies[*b].system.particles.inverse_mass);
            }
            responses.push(Response::new(energy, &x, &mass, &part.rows).map_err(unsolved)?);
        }
        Ok(responses)
    }

    fn similar(&self, content: &Content) -> Result<Option<Vec<Balanced>>, SensitivityError> {
        match content {
            Content::Muscles(scene) => self.here(scene),
            _ => Ok(None),
        }
    }

    fn own(&self) -> Result<Vec<Balanced>, SensitivityError> {
        let found = self.here(&self.run.scene)?;
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

    fn bodies(&self) -> Vec<(String, usize, Range<usize>, Vec<[u32; 3]>)> {
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
