//! Muscles that slide around bones as a scenario.

use std::collections::HashSet;

use nalgebra::Isometry3;

use super::{
    BodyDescription, BodyState, Scenario, ScenarioError, ScenarioKind, SceneDescription, Stepped,
    unused,
};
use crate::mesh::measures::max_or_nan;
use crate::progress::Progress;
use crate::simulation::{Body, Measures, Plan, Simulation};
use crate::state::{Reader, State, Writer};

impl Scenario for Simulation {
    fn kind(&self) -> ScenarioKind<'_> {
        ScenarioKind::Muscles(self)
    }

    fn name(&self) -> &str {
        &self.scene.name
    }

    fn frames(&self) -> usize {
        self.scene.frames
    }

    fn frame(&self) -> usize {
        Simulation::frame(self)
    }

    fn frame_rate(&self) -> f64 {
        self.scene.frame_rate
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn description(&self) -> SceneDescription {
        let mut used = HashSet::new();
        let bodies = self.bodies.iter().map(|body| describe(body, &mut used));
        let bodies = bodies.collect();
        let mut bones = Vec::new();
        for (bone, mesh) in self.scene.bones.iter().zip(&self.bones) {
            let file = unused(&format!("bone_{}", bone.name), &mut used);
            bones.push((file, mesh.clone()));
        }
        SceneDescription {
            bodies,
            bones,
            up: self.scene.up,
        }
    }

    fn poses(&self, frame: usize) -> Vec<Isometry3<f64>> {
        (0..self.bones.len())
            .map(|bone| self.pose(bone, frame as f64))
            .collect()
    }

    fn bodies(&self) -> Vec<BodyState> {
        self.bodies
            .iter()
            .map(|body| {
                let particles = &body.system.particles;
                (particles.position.clone(), particles.velocity.clone())
            })
            .collect()
    }

    fn step(&mut self, progress: &dyn Progress) -> Stepped {
        self.step_frame_with(progress)
    }

    fn is_finished(&self) -> bool {
        self.frame() >= self.frames() || self.bodies.iter().all(|body| body.stopped.is_some())
    }

    fn converged(&self) -> bool {
        self.measure().iter().all(|measures| measures.converged)
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        let all = self.measure();
        let most = |value: fn(&Measures) -> f64| max_or_nan(all.iter().map(value));
        vec![
            ("volume_error", most(|m| m.volume_error.abs())),
            ("penetration_m", most(|m| m.penetration_m)),
            ("edge_stretch_rms_end", most(|m| m.edge_stretch_rms)),
            (
                "distance_from_start_rms_m",
                most(|m| m.distance_from_start_rms_m),
            ),
            ("residual_m", most(|m| m.residual_m)),
        ]
    }

    fn severity(&self) -> f64 {
        max_or_nan(self.measure().iter().map(|m| m.edge_stretch_rms))
    }

    fn severity_name(&self) -> &'static str {
        "greatest edge stretch rms"
    }

    fn save_state(&self) -> Result<Vec<u8>, ScenarioError> {
        let mut writer = Writer::default();
        State::save(self, &mut writer);
        Ok(writer.bytes)
    }

    fn restore_state(&mut self, bytes: &[u8]) -> Result<(), ScenarioError> {
        let mut reader = Reader::new(bytes);
        State::restore(self, &mut reader)?;
        Ok(reader.end()?)
    }

    fn continue_from(&mut self, other: &dyn Scenario) -> Result<(), ScenarioError> {
        match other.kind() {
            ScenarioKind::Muscles(other) => {
                Simulation::continue_from(self, other);
                Ok(())
            }
            _ => Err(ScenarioError::NotSupported("continue from another kind")),
        }
    }
}

fn describe(body: &Body, used: &mut HashSet<String>) -> BodyDescription {
    let mut attached = vec![0.0; body.rest.vertices.len()];
    for &(vertex, _) in &body.attached {
        attached[vertex as usize] = 1.0;
    }
    let lines = if body.rest.triangles.is_empty() {
        body.edges.iter().map(|e| e.points.to_vec()).collect()
    } else {
        Vec::new()
    };
    BodyDescription {
        file: unused(&body.name, used),
        fibre_file: unused(&format!("{}_fibres", body.name), used),
        name: body.name.clone(),
        rest: body.rest.clone(),
        edges: body.edges.clone(),
        lines,
        fibres: body.fibres.clone(),
        attached,
    }
}
