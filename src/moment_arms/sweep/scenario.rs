//! The sweep of a joint as a scenario: each frame turns the joint further.

use nalgebra::Isometry3;

use super::{CrossingMuscle, SweepRun};
use crate::mesh::measures::max_or_nan;
use crate::progress::Progress;
use crate::simulation::{BodyState, Plan, Scenario, SceneDescription, Stepped};

impl Scenario for SweepRun {
    fn name(&self) -> &str {
        self.simulation.name()
    }

    fn frames(&self) -> usize {
        self.course.frames.len() - 1
    }

    fn frame(&self) -> usize {
        self.simulation.frame()
    }

    fn frame_rate(&self) -> f64 {
        self.simulation.frame_rate()
    }

    fn plan(&self) -> &Plan {
        self.simulation.plan()
    }

    fn description(&self) -> SceneDescription {
        self.simulation.description()
    }

    fn poses(&self, frame: usize) -> Vec<Isometry3<f64>> {
        self.simulation.poses(frame)
    }

    fn bodies(&self) -> Vec<BodyState> {
        Scenario::bodies(&self.simulation)
    }

    fn step(&mut self, progress: &dyn Progress) -> Stepped {
        self.aim();
        let stepped = self.simulation.step(progress);
        self.record_reached();
        stepped
    }

    fn is_finished(&self) -> bool {
        let stopped = self.simulation.bodies.iter().all(|b| b.stopped.is_some());
        self.done == self.angles.len() || stopped
    }

    fn converged(&self) -> bool {
        self.muscles.iter().all(|muscle| muscle.unconverged == 0)
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        let most = |of: fn(&CrossingMuscle) -> f64| max_or_nan(self.muscles.iter().map(of));
        vec![
            ("volume_error", most(|m| m.volume_error)),
            ("penetration_m", most(|m| m.vertex_depth)),
            ("fibre_penetration_m", most(|m| m.depth)),
        ]
    }

    fn severity(&self) -> f64 {
        self.simulation.severity()
    }

    fn severity_name(&self) -> &'static str {
        self.simulation.severity_name()
    }
}
