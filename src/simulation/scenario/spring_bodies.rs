//! Bodies of springs as a scenario.

use std::collections::HashSet;

use nalgebra::{Isometry3, Vector3};

use super::{
    BodyDescription, BodyState, Scenario, ScenarioKind, SceneDescription, Stepped, unused,
};
use crate::progress::Progress;
use crate::simulation::Plan;
use crate::simulation::spring_bodies::SpringBodiesRun;

impl Scenario for SpringBodiesRun {
    fn kind(&self) -> ScenarioKind<'_> {
        ScenarioKind::SpringBodies(self)
    }

    fn name(&self) -> &str {
        &self.scene.name
    }

    fn frames(&self) -> usize {
        self.scene.frames
    }

    fn frame(&self) -> usize {
        SpringBodiesRun::frame(self)
    }

    fn frame_rate(&self) -> f64 {
        self.scene.frame_rate
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn description(&self) -> SceneDescription {
        let mut used = HashSet::new();
        let bodies = self.surfaces().into_iter().map(|(name, surface, held)| {
            BodyDescription::of_surface(name, surface.clone(), held, &mut used)
        });
        let bodies = bodies.collect();
        let bones = self.rigid_bodies().into_iter();
        SceneDescription {
            bodies,
            bones: bones
                .map(|(name, mesh)| (unused(name, &mut used), mesh.clone()))
                .collect(),
            up: Vector3::y(),
        }
    }

    fn poses(&self, frame: usize) -> Vec<Isometry3<f64>> {
        self.poses_at(frame)
    }

    fn bodies(&self) -> Vec<BodyState> {
        self.states()
    }

    fn step(&mut self, _: &dyn Progress) -> Stepped {
        SpringBodiesRun::step(self)
    }

    fn converged(&self) -> bool {
        // A motion in time has no end that must be at rest.
        true
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        self.measured()
    }

    fn limits(&self) -> Vec<(&'static str, f64)> {
        vec![("crossings", 0.0)]
    }

    fn severity(&self) -> f64 {
        let volume = self
            .measured()
            .into_iter()
            .find(|(name, _)| *name == "volume_change");
        volume.map_or(0.0, |(_, value)| value)
    }

    fn severity_name(&self) -> &'static str {
        "greatest change of a volume"
    }
}
