//! The plan of a simulation: the effects that run, with their elements and costs, and those that do
//! not run, with the reasons.

mod staged;

use std::sync::Arc;

use nalgebra::Isometry3;
use serde::Serialize;

use super::assets::Assets;
use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;
use crate::scene::{Scene, Solver};

/// An effect that will run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Planned {
    /// Name of the muscle.
    pub muscle: String,
    /// Name of the effect.
    pub effect: String,
    /// Number of constraints, vertices or pairs.
    pub elements: usize,
    /// Estimated heap memory [bytes].
    pub bytes: usize,
    /// Estimated time [ms per frame], one thread.
    pub ms_per_frame: f64,
}

/// An effect that allocates nothing and runs nothing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// Name of the muscle; empty for all muscles.
    pub muscle: String,
    /// Name of the effect.
    pub effect: String,
    /// The reason.
    pub why: String,
}

/// The effects on one muscle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MusclePlan {
    /// True if edges resist stretching.
    pub stretch: bool,
    /// True if hinges resist bending.
    pub bending: bool,
    /// True with a volume constraint.
    pub volume: bool,
    /// True if the stiffness depends on the fibre direction.
    pub anisotropy: bool,
    /// Obstacles within reach: bones by index, then capsules.
    pub obstacles: Vec<usize>,
    /// Vertices that the user fixed in space, besides the attached ones; empty in a new plan.
    pub fixed: Vec<u32>,
    /// The rest shape of a muscle that continues another run, see
    /// [`super::Simulation::continue_from`]. It replaces the shape as read without overlap; `None`
    /// in a new plan.
    pub rest: Option<Arc<TriangleMesh>>,
}

/// The plan of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Effects that run.
    pub run: Vec<Planned>,
    /// Effects that do not run.
    pub left_out: Vec<LeftOut>,
    /// Plan of each muscle, in the scene's order.
    pub muscles: Vec<MusclePlan>,
}

/// Time per step of an edge, a hinge, a vertex of the enclosed volume, and a vertex within reach of
/// an obstacle [ns], as measured on the built-in hip with two cores; for estimates only.
const NS: [(&str, f64); 4] = [
    ("stretch", 16.0),
    ("bending", 58.0),
    ("volume", 60.0),
    ("contact", 49.0),
];

fn nanoseconds(effect: &str) -> f64 {
    NS.iter()
        .find(|(name, _)| *name == effect)
        .map_or(0.0, |(_, ns)| *ns)
}

impl Plan {
    /// Makes the plan of each muscle and effect.
    pub fn new(scene: &Scene, assets: &Assets) -> Self {
        let mut plan = Self::default();
        for m in 0..scene.muscles.len() {
            plan.add_muscle(scene, assets, m);
        }
        plan.add_global(scene);
        plan
    }

    fn run(&mut self, scene: &Scene, muscle: &str, effect: &str, elements: usize, bytes: usize) {
        let sweeps = match scene.solver {
            // The number of evaluations of an equilibrium that starts at the previous one.
            Solver::QuasiStatic(s) | Solver::ImplicitEuler(s) => {
                f64::from(s.substeps) * f64::from(s.iterations.min(20))
            }
            _ => f64::from(scene.solver.substeps()) * f64::from(scene.solver.iterations()),
        };
        let ms_per_frame = elements as f64 * nanoseconds(effect) * sweeps * 1e-6;
        let (muscle, effect) = (muscle.to_string(), effect.to_string());
        self.run.push(Planned {
            muscle,
            effect,
            elements,
            bytes,
            ms_per_frame,
        });
    }

    fn leave(&mut self, muscle: &str, effect: &str, why: impl Into<String>) {
        self.left_out.push(LeftOut {
            muscle: muscle.into(),
            effect: effect.into(),
            why: why.into(),
        });
    }

    fn add_muscle(&mut self, scene: &Scene, assets: &Assets, m: usize) {
        let (muscle, asset) = (&scene.muscles[m], &assets.muscles[m]);
        let name = muscle.name.as_str();
        let rest = assets.ready.rest(&asset.mesh);
        let topology = rest.topology();
        let edges = topology.edges.len() + asset.edges.len();
        let hinges = topology.hinges.len();
        let mut decided = MusclePlan::default();
        let (stretch, bending, volume) = stiffness(scene, muscle);
        match (scene.effects.stretch, stretch) {
            (false, _) => self.leave(name, "stretch", "the scene has no [effects.stretch]"),
            (true, 0.0) => self.leave(name, "stretch", "its stiffness is zero"),
            (true, _) => {
                decided.stretch = true;
                self.run(scene, name, "stretch", edges, edges * 52);
            }
        }
        match (scene.effects.bending, bending) {
            (false, _) => self.leave(name, "bending", "the scene has no [effects.bending]"),
            (true, 0.0) => self.leave(name, "bending", "its stiffness is zero"),
            (true, _) if hinges == 0 => {
                self.leave(name, "bending", "no two triangles share an edge")
            }
            (true, _) => {
                decided.bending = true;
                self.run(scene, name, "bending", hinges, hinges * 60);
            }
        }
        match scene.effects.volume {
            None => self.leave(name, "volume", "the scene has no [effects.volume]"),
            Some(_) if volume == 0.0 => self.leave(name, "volume", "its stiffness is zero"),
            Some(_) if asset.mesh.triangles.is_empty() => {
                self.leave(
                    name,
                    "volume",
                    "the body has no triangles that could enclose one",
                );
            }
            Some(_) => {
                decided.volume = true;
                let n = asset.mesh.vertices.len();
                self.run(
                    scene,
                    name,
                    "volume",
                    n,
                    n * 52 + asset.mesh.triangles.len() * 36,
                );
            }
        }
        self.add_anisotropy(scene, name, asset.fibres.len(), &mut decided, edges);
        self.add_contact(scene, assets, m, &mut decided);
        self.muscles.push(decided);
    }

    fn add_anisotropy(
        &mut self,
        scene: &Scene,
        name: &str,
        fibres: usize,
        decided: &mut MusclePlan,
        edges: usize,
    ) {
        match scene.effects.anisotropy {
            None => self.leave(name, "anisotropy", "the scene has no [effects.anisotropy]"),
            Some(a) if a.strength == 0.0 => self.leave(name, "anisotropy", "its strength is zero"),
            Some(_) if fibres == 0 => self.leave(name, "anisotropy", "the muscle has no fibres"),
            Some(_) if !decided.stretch => {
                self.leave(name, "anisotropy", "it scales stretch, which is left out")
            }
            Some(_) => {
                decided.anisotropy = true;
                // The effect is part of the edge stiffness: no memory and no time of its own.
                self.run(scene, name, "anisotropy", edges, 0);
            }
        }
    }

    fn add_contact(&mut self, scene: &Scene, assets: &Assets, m: usize, decided: &mut MusclePlan) {
        let name = scene.muscles[m].name.as_str();
        if scene.effects.contact.is_none() {
            return self.leave(name, "contact", "the scene has no [effects.contact]");
        }
        let mesh = &assets.muscles[m].mesh;
        if mesh.triangles.is_empty() {
            return self.leave(name, "contact", "the body has no triangles");
        }
        if scene.bones.is_empty() {
            return self.leave(name, "contact", "the scene has no bones");
        }
        let reach = reach(scene, mesh, m);
        let n = mesh.vertices.len();
        for o in 0..scene.bones.len() + scene.capsules.len() {
            let (other, bone, bounds) = obstacle(scene, assets, o);
            let effect = format!("contact with {other}");
            let swept = swept(scene, bone, &bounds);
            if reach.is_none_or(|r| r.intersects(&swept)) {
                decided.obstacles.push(o);
                let elements = if o < scene.bones.len() {
                    n + assets.bones[o].vertices.len()
                } else {
                    n
                };
                self.run(scene, name, &effect, elements, n * 96 + elements * 8);
                if let Some(last) = self.run.last_mut() {
                    // By vertices: the cost of a bone's points is proportional to those of the
                    // muscle.
                    last.ms_per_frame = n as f64 * nanoseconds("contact") * sub_steps(scene) * 1e-6;
                }
            } else {
                self.leave(
                    name,
                    &effect,
                    "the boxes that muscle and bone sweep never meet",
                );
            }
        }
    }

    fn add_global(&mut self, scene: &Scene) {
        let count = self.muscles.len();
        match scene.effects.gravity {
            None => self.leave("", "gravity", "the scene has no [effects.gravity]"),
            Some(g) if g.norm() == 0.0 => self.leave("", "gravity", "its acceleration is zero"),
            Some(_) => self.run(scene, "", "gravity", count, 0),
        }
        let minimises = matches!(
            scene.solver,
            Solver::QuasiStatic(_) | Solver::ImplicitEuler(_)
        );
        if minimises && scene.effects.contact.is_some_and(|c| c.friction > 0.0) {
            self.leave(
                "",
                "friction",
                "a minimum of energy knows none; `solver.xpbd` has it",
            );
        }
        match scene.effects.damping {
            None => self.leave("", "damping", "the scene has no [effects.damping]"),
            Some(0.0) => self.leave("", "damping", "its rate is zero"),
            Some(_) if matches!(scene.solver, Solver::QuasiStatic(_)) => {
                self.leave("", "damping", "an equilibrium has no velocities");
            }
            Some(_) => self.run(scene, "", "damping", count, 0),
        }
    }
}

fn sub_steps(scene: &Scene) -> f64 {
    f64::from(scene.solver.substeps())
}

/// Stiffness of stretch, bending and volume for the scene's solver; only zero or non-zero matters
/// here.
fn stiffness(scene: &Scene, muscle: &crate::scene::Muscle) -> (f64, f64, f64) {
    match scene.solver {
        Solver::Xpbd(_) | Solver::QuasiStatic(_) | Solver::ImplicitEuler(_) => (
            muscle.material.stretch,
            muscle.material.bending,
            muscle.material.bulk.unwrap_or(1.0),
        ),
        Solver::Pbd(s) => (s.stretch, s.bending, s.volume),
    }
}

/// Name, carrying bone and local bounds of obstacle `o`: bones first, then capsules.
pub(super) fn obstacle(scene: &Scene, assets: &Assets, o: usize) -> (String, usize, Aabb) {
    match o.checked_sub(scene.bones.len()) {
        None => (
            scene.bones[o].name.clone(),
            o,
            assets.bones[o].bounding_box(),
        ),
        Some(c) => {
            let capsule = &scene.capsules[c];
            let bounds = Aabb::of_points(&capsule.segment).inflate(capsule.radius);
            (capsule.name.clone(), capsule.bone, bounds)
        }
    }
}

/// Poses of a bone at every frame.
fn poses(scene: &Scene, bone: usize) -> impl Iterator<Item = Isometry3<f64>> + '_ {
    (0..=scene.frames).map(move |f| scene.bones[bone].motion.pose(f as f64))
}

fn swept(scene: &Scene, bone: usize, bounds: &Aabb) -> Aabb {
    poses(scene, bone)
        .map(|p| bounds.transformed(&p))
        .reduce(|a, b| a.union(&b))
        .unwrap_or(*bounds)
}

/// A box that the muscle is expected to stay in: its start box, moved with each attached bone, with
/// a margin. `None` for a muscle without attachment. The run tests whether the muscle leaves the
/// box.
fn reach(scene: &Scene, mesh: &TriangleMesh, m: usize) -> Option<Aabb> {
    let muscle = &scene.muscles[m];
    let free = muscle.attachments.is_empty();
    if free && (scene.effects.gravity.is_some() || !muscle.forces.is_empty()) {
        return None;
    }
    let start = mesh.bounding_box();
    let mut all = start;
    for attachment in &muscle.attachments {
        let first = scene.bones[attachment.bone].motion.pose(0.0).inverse();
        for pose in poses(scene, attachment.bone) {
            all = all.union(&start.transformed(&(pose * first)));
        }
    }
    Some(all.inflate(0.1 * mesh.length()))
}
