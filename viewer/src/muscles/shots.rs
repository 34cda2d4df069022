//! The visible state of running muscles.

use std::collections::BTreeMap;

use super::Muscles;
use crate::snapshot::{BodyShot, BoneShot, Probe, Reading, Shot, Stage, StageBody, Tissue};
use pliant::mesh::measures::{max_or_nan, volume};
use pliant::simulation::{Body, Simulation, strain_at_vertices};

/// The constant data of a simulation.
pub(super) fn stage(simulation: &Simulation) -> Stage {
    let muscle = |body: &Body| StageBody {
        name: body.name.clone(),
        tissue: Tissue::Muscle,
        triangles: body.rest.triangles.clone(),
        edges: body.edges.iter().map(|e| e.points).collect(),
        held: body.attached.iter().map(|(v, _)| *v).collect(),
        fibres: body.fibres.clone(),
    };
    let names = simulation.scene.bones.iter().map(|b| b.name.clone());
    Stage {
        bodies: simulation.bodies.iter().map(muscle).collect(),
        bones: names.zip(simulation.bones.iter().cloned()).collect(),
    }
}

impl Muscles {
    pub(super) fn seen(&self) -> Shot {
        let simulation = &self.simulation;
        let mut bodies: Vec<BodyShot> = (0..simulation.bodies.len())
            .map(|m| body_shot(simulation, m))
            .collect();
        for (shot, drag) in bodies.iter_mut().zip(&self.drags) {
            shot.dragged = drag.map(|(vertex, to, _)| (vertex, to));
        }
        let frame = simulation.frame();
        let bone = |b: usize| {
            let pose = simulation.pose(b, frame as f64);
            let angle = self.scene.bones[b]
                .motion
                .joint
                .as_ref()
                .map(|joint| joint.angle_of(&pose));
            BoneShot {
                pose,
                angle,
                steering: self.steering[b],
            }
        };
        Shot {
            frame,
            last_frame: self.scene.frames,
            stage: self.stage.clone(),
            scene: Some(self.scene.clone()),
            controls: self.controls.clone(),
            readings: self.readings(&bodies),
            probe: self
                .probe
                .map(|(body, vertex)| self.probed(body, vertex, &bodies[body])),
            bodies,
            bones: (0..self.scene.bones.len()).map(bone).collect(),
            handles: Vec::new(),
            effects: self.effects.clone(),
            notes: simulation.notes.clone(),
        }
    }

    /// Volume error, stretch and depth of each muscle.
    fn readings(&self, bodies: &[BodyShot]) -> Vec<Reading> {
        let many = bodies.len() > 1;
        let mut all = Vec::new();
        let effects = &self.scene.effects;
        let pairs = self.simulation.bodies.iter().zip(bodies);
        for (k, (body, shot)) in pairs.enumerate() {
            let of = || {
                if many {
                    body.name.clone()
                } else {
                    String::new()
                }
            };
            let mut add = |name, unit, value| {
                all.push(Reading {
                    name,
                    of: of(),
                    unit,
                    value,
                })
            };
            if let Some(attained) = self.simulation.attained() {
                add("Estimated error", "mm", 1e3 * attained.muscles_m[k]);
            }
            if effects.volume.is_some() {
                add("Volume error", "", shot.volume_error.abs());
            }
            add(
                "Greatest stretch",
                "%",
                100.0 * max_or_nan(shot.stretch.iter().copied()),
            );
            if effects.contact.is_some() {
                add(
                    "Greatest depth",
                    "mm",
                    1e3 * max_or_nan(shot.depth.iter().copied()),
                );
            }
        }
        all
    }

    /// Measures of a vertex.
    fn probed(&self, body: usize, vertex: usize, shot: &BodyShot) -> Probe {
        let system = &self.simulation.bodies[body].system;
        let mut values = vec![
            ("stretch", 100.0 * shot.stretch[vertex], "%"),
            ("speed", 1e3 * shot.speed[vertex], "mm/s"),
            ("depth", 1e3 * shot.depth[vertex], "mm"),
        ];
        if self.simulation.bodies[body].equilibrium().is_none() {
            for (name, residual) in system.residuals_at(vertex as u32) {
                values.push((name, 1e3 * residual, "mm"));
            }
        }
        Probe {
            body,
            vertex,
            values,
        }
    }
}

fn body_shot(simulation: &Simulation, m: usize) -> BodyShot {
    let body = &simulation.bodies[m];
    let particles = &body.system.particles;
    let x = &particles.position;
    let volume_error = match body.target_volume {
        target if target > 0.0 => volume(x, &body.rest.triangles) / target - 1.0,
        _ => 0.0,
    };
    BodyShot {
        stretch: strain_at_vertices(&body.edges, x),
        depth: depths(simulation, body),
        speed: particles.velocity.iter().map(|v| v.norm()).collect(),
        touching: body
            .system
            .contacts
            .as_ref()
            .map_or_else(Vec::new, |contacts| contacts.touching(x)),
        positions: x.clone(),
        volume_error,
        fixed: simulation.plan.muscles[m].fixed.clone(),
        dragged: None,
        stopped: body
            .stopped
            .as_ref()
            .map(|(frame, broken)| (*frame, broken.to_string())),
    }
}

/// Depth of each free vertex in the obstacles of its muscle [m].
fn depths(simulation: &Simulation, body: &Body) -> Vec<f64> {
    let x = &body.system.particles.position;
    let mut depths = vec![0.0; x.len()];
    let Some(contacts) = &body.system.contacts else {
        return depths;
    };
    for &o in contacts.obstacles() {
        let Some(placed) = simulation.placed().get(o) else {
            continue;
        };
        let (bounds, back) = (placed.obstacle.bounding_box(), placed.now.inverse());
        for v in contacts.near(o).map(|v| v as usize) {
            let local = back * x[v];
            // A point outside the box is outside the bone.
            if !(0..3).all(|k| bounds.min[k] <= local[k] && local[k] <= bounds.max[k]) {
                continue;
            }
            if let Some(found) = placed
                .obstacle
                .closest(&local)
                .filter(|found| -found.distance > depths[v])
            {
                depths[v] = -found.distance;
            }
        }
    }
    depths
}

/// Time of each effect so far, over all muscles [s].
pub(super) fn seconds(simulation: &Simulation) -> BTreeMap<&'static str, f64> {
    let mut all = BTreeMap::new();
    for (name, (s, _)) in simulation
        .bodies
        .iter()
        .flat_map(|body| &body.system.clock.effects)
    {
        *all.entry(*name).or_insert(0.0) += s;
    }
    all
}
