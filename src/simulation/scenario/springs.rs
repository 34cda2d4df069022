//! A spring system on its way to rest as a scenario.

use std::collections::HashSet;

use nalgebra::{Isometry3, Vector3};

use super::{
    BodyDescription, BodyState, FrameState, Scenario, ScenarioKind, SceneDescription, Stepped,
};
use crate::constraints::distance::Distance;
use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::simulation::Plan;
use crate::simulation::springs::SpringsRun;
use crate::springs::RestEnd;

impl Scenario for SpringsRun {
    fn kind(&self) -> ScenarioKind<'_> {
        ScenarioKind::Springs(self)
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn frames(&self) -> usize {
        self.frames
    }

    fn frame(&self) -> usize {
        self.last.step
    }

    fn frame_rate(&self) -> f64 {
        self.frame_rate
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn description(&self) -> SceneDescription {
        let rest = TriangleMesh {
            vertices: self.rest_positions().into_owned(),
            triangles: self.triangles.clone(),
        };
        let held = self.held().into_iter();
        let held = held.map(|held| f64::from(u8::from(held))).collect();
        let mut edges = Vec::new();
        for (&points, &rest) in self.lines.iter().zip(&self.rest_lengths) {
            if rest > 0.0 {
                edges.push(Distance { points, rest });
            }
        }
        let body = BodyDescription {
            edges,
            lines: self.lines.iter().map(|ends| ends.to_vec()).collect(),
            ..BodyDescription::of_surface(&self.name, rest, held, &mut HashSet::new())
        };
        SceneDescription {
            bodies: vec![body],
            bones: Vec::new(),
            up: Vector3::y(),
        }
    }

    fn poses(&self, _: usize) -> Vec<Isometry3<f64>> {
        Vec::new()
    }

    fn bodies(&self) -> Vec<BodyState> {
        vec![(
            self.positions().into_owned(),
            self.velocities().into_owned(),
        )]
    }

    fn state(&self) -> FrameState {
        FrameState {
            frame: self.frame(),
            time: self.time,
            bodies: self.bodies(),
            bones: Vec::new(),
        }
    }

    fn step(&mut self, _: &dyn Progress) -> Stepped {
        SpringsRun::step(self)
    }

    fn is_finished(&self) -> bool {
        self.end.is_some() || self.frame() >= self.frames
    }

    fn converged(&self) -> bool {
        self.end == Some(RestEnd::Rest)
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("steps", self.last.step as f64),
            ("simulated_s", self.time),
            ("residual_force_n", self.last.residual),
            ("kinetic_energy_j", self.last.energy.kinetic),
            ("spring_energy_j", self.last.energy.stored),
        ]
    }

    fn limits(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("residual_force_n", self.rest.force),
            ("kinetic_energy_j", self.rest.energy),
        ]
    }

    fn severity(&self) -> f64 {
        self.last.residual
    }

    fn severity_name(&self) -> &'static str {
        "greatest force"
    }
}
