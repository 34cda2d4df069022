//! A geometric muscle as a scenario: each frame has the length of the scene and its closed-form
//! radii.

use std::collections::HashSet;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    BodyDescription, BodyState, LeftOut, Plan, Planned, Scenario, ScenarioError, ScenarioKind,
    SceneDescription, Stepped, at_rest,
};
use crate::constraints::distance::Distance;
use crate::geometric::pose::Pose;
use crate::geometric::{ChainError, GeometricMuscle};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;
use crate::progress::Progress;
use crate::scene::content::GeometricScene;
use crate::state::{Reader, Writer};

/// Time of a vertex of the surface [ns], for estimates only.
const NS_OF_VERTEX: f64 = 50.0;

/// A geometric muscle over the frames of its scene.
pub struct GeometricRun {
    /// The scene.
    pub scene: GeometricScene,
    /// The muscle at its present length.
    pub muscle: GeometricMuscle,
    /// Surface, bars and measures at the present length.
    pub pose: Pose,
    plan: Plan,
    frame: usize,
    /// Greatest absolute volume error of all frames so far.
    volume_error: f64,
}

impl GeometricRun {
    /// The muscle in frame 0.
    pub fn new(scene: GeometricScene) -> Self {
        let muscle = scene.muscle.clone();
        let pose = Pose::of(&muscle);
        let mut run = Self {
            plan: plan(&scene, &pose),
            scene,
            muscle,
            pose,
            frame: 0,
            volume_error: 0.0,
        };
        // A muscle can take every length in its range; otherwise it stays at rest.
        let _ = run.take_length();
        run
    }

    /// Takes the length of the present frame.
    fn take_length(&mut self) -> Result<(), ChainError> {
        let length = self.scene.length_in(self.frame);
        self.muscle.chain.set_length(length)?;
        self.pose = Pose::of(&self.muscle);
        self.volume_error = max_or_nan([self.volume_error, self.pose.volume_error.abs()]);
        Ok(())
    }

    fn change_of_length(&self) -> f64 {
        self.pose.length / self.scene.shape.length - 1.0
    }
}

fn plan(scene: &GeometricScene, pose: &Pose) -> Plan {
    let vertices = pose.mesh.vertices.len();
    let mut plan = Plan::default();
    let mut run = |effect: &str, elements: usize, ms_per_frame: f64| {
        plan.run.push(Planned {
            muscle: scene.name.clone(),
            effect: effect.to_owned(),
            elements,
            bytes: elements * 24,
            ms_per_frame,
        });
    };
    let ms = vertices as f64 * NS_OF_VERTEX * 1e-6;
    run("constant volume of frusta", scene.shape.radii.len(), 0.0);
    run("surface of revolution", vertices, ms);
    if scene.frame.is_some() {
        run("frame of two bars", 2, 0.0);
    }
    for effect in ["stretch", "contact", "gravity"] {
        plan.left_out.push(LeftOut {
            muscle: String::new(),
            effect: effect.to_owned(),
            why: "a geometric muscle has no forces; its shape depends on its length alone"
                .to_owned(),
        });
    }
    plan
}

/// The bars as a body of edges.
fn bars(points: &[Point3<f64>], used: &mut HashSet<String>) -> BodyDescription {
    let count = points.len() as u32;
    let mut edges = Vec::new();
    for k in 1..count {
        let rest = (points[k as usize] - points[k as usize - 1]).norm();
        if rest > 0.0 {
            edges.push(Distance {
                points: [k - 1, k],
                rest,
            });
        }
    }
    let rest = TriangleMesh {
        vertices: points.to_vec(),
        triangles: Vec::new(),
    };
    BodyDescription {
        edges,
        lines: vec![(0..count).collect()],
        ..BodyDescription::of_surface("bars", rest, Vec::new(), used)
    }
}

impl Scenario for GeometricRun {
    fn kind(&self) -> ScenarioKind<'_> {
        ScenarioKind::Geometric(self)
    }

    fn name(&self) -> &str {
        &self.scene.name
    }

    fn frames(&self) -> usize {
        self.scene.frames
    }

    fn frame(&self) -> usize {
        self.frame
    }

    fn frame_rate(&self) -> f64 {
        self.scene.frame_rate
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn description(&self) -> SceneDescription {
        let mut used = HashSet::new();
        let rest = Pose::of(&self.scene.muscle);
        let muscle = BodyDescription::of_surface("muscle", rest.mesh, Vec::new(), &mut used);
        let mut bodies = vec![muscle];
        if !rest.bars.is_empty() {
            bodies.push(bars(&rest.bars, &mut used));
        }
        SceneDescription {
            bodies,
            bones: Vec::new(),
            up: Vector3::y(),
        }
    }

    fn poses(&self, _: usize) -> Vec<Isometry3<f64>> {
        Vec::new()
    }

    fn bodies(&self) -> Vec<BodyState> {
        let mut bodies = vec![at_rest(self.pose.mesh.vertices.clone())];
        if !self.pose.bars.is_empty() {
            bodies.push(at_rest(self.pose.bars.clone()));
        }
        bodies
    }

    fn step(&mut self, _: &dyn Progress) -> Stepped {
        self.frame += 1;
        match self.take_length() {
            Ok(()) => Stepped::Done,
            Err(error) => Stepped::Failed(format!("frame {}: {error}", self.frame)),
        }
    }

    fn converged(&self) -> bool {
        // A closed form needs no iterations.
        true
    }

    fn measures(&self) -> Vec<(&'static str, f64)> {
        let mut measures = vec![
            ("length_m", self.pose.length),
            ("radius_max_m", self.pose.radius),
            ("volume_error", self.volume_error),
        ];
        if let Some(angle) = self.pose.joint_angle {
            measures.push(("joint_angle_deg", angle.to_degrees()));
        }
        measures
    }

    fn limits(&self) -> Vec<(&'static str, f64)> {
        vec![("volume_error", VOLUME_HELD)]
    }

    fn severity(&self) -> f64 {
        self.change_of_length().abs()
    }

    fn severity_name(&self) -> &'static str {
        "greatest change of length"
    }

    fn save_state(&self) -> Result<Vec<u8>, ScenarioError> {
        let mut writer = Writer::default();
        writer.put(&self.frame);
        writer.put(&self.volume_error);
        Ok(writer.bytes)
    }

    fn restore_state(&mut self, bytes: &[u8]) -> Result<(), ScenarioError> {
        let mut reader = Reader::new(bytes);
        self.frame = reader.take()?;
        self.volume_error = reader.take()?;
        let is_taken = self.take_length().is_ok();
        reader.check(is_taken, "a frame without a length")?;
        Ok(reader.end()?)
    }

    fn continue_from(&mut self, other: &dyn Scenario) -> Result<(), ScenarioError> {
        let ScenarioKind::Geometric(other) = other.kind() else {
            return Err(ScenarioError::NotSupported("continue from another kind"));
        };
        self.frame = other.frame;
        self.take_length()
            .map_err(|_| ScenarioError::NotSupported("continue at this length"))
    }
}

/// Greatest relative change of the volume.
const VOLUME_HELD: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use crate::scene::{Content, Surroundings, parse_content};
    use crate::simulation::scenario;

    const FILE: &str = "frames = 8\nunit = \"cm\"\nradii = [1.0, 2.0, 1.0]\ngrow_mults = [0.0, 1.0, 0.0]\nlength = 20\nframe = [1, 18, 5, 2]\n";

    fn content(text: &str) -> Content {
        let around = Surroundings::of(std::path::Path::new("."));
        parse_content(text, "arm.toml", &around).expect("a scene")
    }

    #[test]
    fn a_run_takes_the_whole_range_and_ends_at_rest_and_a_saved_state_continues_it() {
        let content = content(FILE);
        let mut run = scenario(&content).expect("a run");
        let start = run.bodies();
        let mut lengths = Vec::new();
        let mut saved = Vec::new();
        while !run.is_finished() {
            assert_eq!(run.step(&Silent), Stepped::Done);
            lengths.push(run.measures()[0].1);
            if run.frame() == 3 {
                saved = run.save_state().expect("a state");
            }
        }
        assert!((lengths[1] - 0.23).abs() <= 1e-15 && (lengths[5] - 0.13).abs() <= 1e-15);
        assert_eq!(run.bodies(), start, "the bits of the start");
        let mut second = scenario(&content).expect("a run");
        second.restore_state(&saved).expect("a state");
        assert_eq!((second.frame(), second.measures()[0].1), (3, lengths[2]));
        assert_eq!(second.step(&Silent), Stepped::Done);
        assert_eq!(second.measures()[0].1, lengths[3]);
        assert!(second.restore_state(&saved[1..]).is_err(), "control");
    }

    #[test]
    fn triangles_are_the_same_at_every_length_and_a_fixed_length_stays() {
        // The middle radius is 0 at the longest length.
        let thin = FILE.replace("2.0, 1.0]", "0.5, 1.0]");
        let thin = thin.replace("frame = [1, 18, 5, 2]\n", "");
        let mut run = scenario(&content(&format!("{thin}max_part = 9\n"))).expect("a run");
        let counts = |run: &dyn Scenario| -> Vec<usize> {
            run.bodies().iter().map(|(x, _)| x.len()).collect()
        };
        let start = counts(run.as_ref());
        while !run.is_finished() {
            assert_eq!(run.step(&Silent), Stepped::Done);
            assert_eq!(counts(run.as_ref()), start);
        }
        let mut fixed = scenario(&content(&format!("{FILE}fixed_length = 21\n"))).expect("a run");
        for _ in 0..3 {
            assert!((fixed.measures()[0].1 - 0.21).abs() <= 1e-15);
            assert_eq!(fixed.step(&Silent), Stepped::Done);
        }
    }
}
