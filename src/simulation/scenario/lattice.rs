//! A box of points on springs as a scenario.

use std::collections::HashSet;

use nalgebra::{Isometry3, Vector3};

use super::{
    BodyDescription, BodyState, Scenario, ScenarioError, ScenarioKind, SceneDescription, Stepped,
    at_rest,
};
use crate::mesh::measures::max_or_nan;
use crate::progress::Progress;
use crate::simulation::Plan;
use crate::simulation::lattice::LatticeRun;

impl LatticeRun {
    /// Greatest distance of a point from its position at the start, in the last frame [m].
    pub fn distance(&self) -> f64 {
        self.frames.last().map_or(0.0, |frame| frame.distance)
    }
}

impl Scenario for LatticeRun {
    fn kind(&self) -> ScenarioKind<'_> {
        ScenarioKind::Lattice(self)
    }

    fn name(&self) -> &str {
        &self.scene.name
    }

    fn frames(&self) -> usize {
        self.scene.frames
    }

    fn frame(&self) -> usize {
        LatticeRun::frame(self)
    }

    fn frame_rate(&self) -> f64 {
        self.scene.frame_rate
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn description(&self) -> SceneDescription {
        let vertices = self.surface.vertices.iter();
        let held = vertices.map(|p| f64::from(u8::from(p.z == 0.0))).collect();
        let (name, surface) = (&self.scene.name, self.surface.clone());
        SceneDescription {
            bodies: vec![BodyDescription::of_surface(
                name,
                surface,
                held,
                &mut HashSet::new(),
            )],
            bones: Vec::new(),
            up: Vector3::y(),
        }
    }

    fn poses(&self, _: usize) -> Vec<Isometry3<f64>> {
        Vec::new()
    }

    fn bodies(&self) -> Vec<BodyState> {
        vec![at_rest(self.surface_at())]
    }

    fn step(&mut self, _: &dyn Progress) -> Stepped {
        LatticeRun::step(self)
    }

    fn converged(&self) -> bool {
        // Only the end of a motion must be at rest, and only if there is time for it.
        true
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        let time_s = self.frames.iter().map(|f| f.time_s).sum::<f64>();
        let farthest = max_or_nan(self.frames.iter().map(|f| f.distance));
        vec![
            ("time_s", time_s),
            ("distance_from_start_max_m", farthest),
            ("distance_from_start_end_m", self.distance()),
        ]
    }

    fn severity(&self) -> f64 {
        self.distance()
    }

    fn severity_name(&self) -> &'static str {
        "furthest from the start"
    }

    fn continue_from(&mut self, other: &dyn Scenario) -> Result<(), ScenarioError> {
        match other.kind() {
            ScenarioKind::Lattice(other) if other.lattice.shape() == self.lattice.shape() => {
                LatticeRun::continue_from(self, other);
                Ok(())
            }
            ScenarioKind::Lattice(_) => Err(ScenarioError::NotSupported(
                "continue with another number of points",
            )),
            _ => Err(ScenarioError::NotSupported("continue from another kind")),
        }
    }
}
