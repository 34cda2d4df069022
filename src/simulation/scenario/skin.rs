//! Skin over implants or over a ball as a scenario, and its areas.

use std::collections::HashSet;

use nalgebra::{Isometry3, Translation3, Vector3};

use super::{
    BodyDescription, BodyState, Scenario, ScenarioKind, SceneDescription, Stepped, at_rest, unused,
};
use crate::mesh::measures::max_or_nan;
use crate::mesh::{TriangleMesh, shapes};
use crate::progress::Progress;
use crate::scene::content::Support;
use crate::simulation::Plan;
use crate::simulation::skin::{SkinMeasures, SkinPart, SkinRun};
use crate::skin::{Areas, Interval};

/// Frame rate of pictures of equilibria [1/s]. Equilibria have no frame rate of their own.
const RATE: f64 = 4.0;

/// Subdivisions of the icosahedron that shows a ball.
const BALL_LEVELS: u32 = 3;

impl SkinMeasures {
    /// Volume of all implants [m^3].
    pub fn volume(&self) -> f64 {
        // The sum of an empty list is minus zero.
        self.shells.iter().map(|(volume, _)| volume).sum::<f64>() + 0.0
    }
}

impl SkinPart {
    /// Areas in a frame. Before the first computed frame, the areas before.
    pub fn areas_at(&self, frame: usize) -> Areas {
        if let Some(found) = self.measures_at(frame) {
            return found.areas;
        }
        let layers = &self.ready.layers;
        let areas = Areas::of(layers, &layers.rest);
        // No implant is in: nothing is retracted and nothing has grown.
        let none = Interval {
            low: areas.before,
            high: areas.before,
        };
        Areas {
            retracted: none,
            grown: none,
            ..areas
        }
    }
}

impl SkinRun {
    /// Total areas of all parts in a frame.
    pub fn areas_at(&self, frame: usize) -> Areas {
        self.parts.iter().map(|part| part.areas_at(frame)).sum()
    }

    /// The last frame of each part that has frames.
    fn last(&self) -> impl Iterator<Item = &SkinMeasures> {
        self.parts.iter().filter_map(|part| part.frames.last())
    }
}

impl Scenario for SkinRun {
    fn kind(&self) -> ScenarioKind<'_> {
        ScenarioKind::Skin(self)
    }

    fn name(&self) -> &str {
        &self.scene.name
    }

    fn frames(&self) -> usize {
        self.scene.frames
    }

    fn frame(&self) -> usize {
        SkinRun::frame(self)
    }

    fn frame_rate(&self) -> f64 {
        RATE
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn description(&self) -> SceneDescription {
        let mut used = HashSet::new();
        let mut held = vec![1.0; self.whole.vertices.len()];
        for part in &self.parts {
            for (region, vertex) in part.vertices() {
                held[vertex] = f64::from(u8::from(part.ready.layers.held[region]));
            }
        }
        let (name, whole) = (&self.scene.skin.name, self.whole.clone());
        let skin = BodyDescription::of_surface(name, whole, held, &mut used);
        let mut bodies = vec![skin];
        for part in &self.parts {
            for ((k, shell), at) in part.members.iter().zip(&part.shells).zip(part.shells_at()) {
                let rest = TriangleMesh {
                    vertices: at.to_vec(),
                    ..shell.clone()
                };
                let name = self.name_of(*k);
                // Only the skin is stretched; a pocket has no edges with rest lengths.
                bodies.push(BodyDescription {
                    edges: Vec::new(),
                    ..BodyDescription::of_surface(name, rest, Vec::new(), &mut used)
                });
            }
        }
        let mut bones = Vec::new();
        for (obstacle, mesh) in self.scene.obstacles.iter().zip(&self.obstacles) {
            let file = unused(&format!("obstacle_{}", obstacle.name), &mut used);
            bones.push((file, mesh.clone()));
        }
        if let Support::Ball(ball) = &self.scene.under {
            let mesh = shapes::icosphere(ball.radius, BALL_LEVELS);
            bones.push((unused("ball", &mut used), mesh));
        }
        SceneDescription {
            bodies,
            bones,
            up: Vector3::y(),
        }
    }

    fn poses(&self, frame: usize) -> Vec<Isometry3<f64>> {
        let mut bones = vec![Isometry3::identity(); self.obstacles.len()];
        if let (Support::Ball(ball), [part]) = (&self.scene.under, self.parts.as_slice()) {
            bones.push(Translation3::from(self.ball_at(ball, part, frame).centre.coords).into());
        }
        bones
    }

    fn bodies(&self) -> Vec<BodyState> {
        let mut bodies = vec![at_rest(self.skin_at())];
        for part in &self.parts {
            bodies.extend(part.shells_at().map(|shell| at_rest(shell.to_vec())));
        }
        bodies
    }

    fn step(&mut self, progress: &dyn Progress) -> Stepped {
        SkinRun::step(self, progress)
    }

    fn converged(&self) -> bool {
        SkinRun::converged(self)
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        let areas = self.areas_at(self.frame());
        let volume: f64 = self.last().map(SkinMeasures::volume).sum();
        let last = |of: fn(&SkinMeasures) -> f64| max_or_nan(self.last().map(of));
        let mut all = vec![
            ("time_s", self.parts.iter().map(SkinPart::time_s).sum()),
            ("area_before_m2", areas.before),
        ];
        all.extend(named(&areas));
        all.extend([
            ("implant_volume_m3", volume),
            ("volume_difference_m3", areas.volume_difference),
            ("stretch_max", areas.stretch_max),
            ("pressure_pa", last(|f| f.progress.pressure)),
            ("penetration_m", last(|f| f.progress.depth)),
        ]);
        all
    }

    fn severity(&self) -> f64 {
        max_or_nan(self.last().map(|f| f.areas.stretch_max))
    }

    fn severity_name(&self) -> &'static str {
        "greatest stretch"
    }
}

/// The areas over an implant, by the names of their measures.
pub(in crate::simulation) fn named(areas: &Areas) -> [(&'static str, f64); 6] {
    [
        ("area_deformed_m2", areas.deformed),
        ("area_gain_m2", areas.gain()),
        ("area_retracted_low_m2", areas.retracted.low),
        ("area_retracted_high_m2", areas.retracted.high),
        ("area_grown_low_m2", areas.grown.low),
        ("area_grown_high_m2", areas.grown.high),
    ]
}
