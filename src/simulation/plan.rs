//! The plan of a simulation: the effects that run, with their elements and costs, and those that do
//! not run, with the reasons.

mod staged;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};
use serde::Serialize;

use super::assets::{Assets, MuscleAsset};
use super::bonds;
use super::contraction::ACTIVATION;
use super::effects::{EffectModel, MODELS, Scope};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;
use crate::scene::effects::EFFECTS;
use crate::scene::{EffectSpec, Scene};

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
    /// The keys of the effects that run on it, in the order in which they are built.
    pub effects: Vec<&'static str>,
    /// Obstacles within reach: bones by index, then capsules.
    pub obstacles: Vec<usize>,
    /// The other muscles that it can meet, by index.
    pub partners: Vec<usize>,
    /// Vertices that the user fixed in space, besides the attached ones; empty in a new plan.
    pub fixed: Vec<u32>,
    /// The rest shape of a muscle that continues another run, see
    /// [`super::Simulation::continue_from`]. It replaces the shape as read without overlap; `None`
    /// in a new plan.
    pub rest: Option<Arc<TriangleMesh>>,
}

impl MusclePlan {
    /// Whether the effect with a key runs on the muscle.
    #[must_use]
    pub fn runs(&self, effect: &str) -> bool {
        self.effects.contains(&effect)
    }
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

impl Plan {
    /// Makes the plan of each muscle and effect.
    pub fn new(scene: &Scene, assets: &Assets) -> Self {
        let mut plan = Self::default();
        for m in 0..scene.muscles.len() {
            plan.add_muscle(scene, assets, m);
        }
        for spec in &EFFECTS {
            if let Some(model) = EffectModel::of(spec).filter(|m| m.scope == Scope::Scene) {
                let mut planner = Planner::of_scene(scene, assets, &mut plan);
                planner.decide(spec, model);
            }
        }
        plan.leave_friction(scene);
        plan.add_bonds(scene, assets);
        plan
    }

    fn leave(&mut self, muscle: &str, effect: &str, why: impl Into<String>) {
        self.left_out.push(LeftOut {
            muscle: muscle.into(),
            effect: effect.into(),
            why: why.into(),
        });
    }

    fn add_muscle(&mut self, scene: &Scene, assets: &Assets, m: usize) {
        let mut planner = Planner::of_muscle(scene, assets, m, self);
        for spec in &EFFECTS {
            if let Some(model) = EffectModel::of(spec).filter(|m| m.scope == Scope::Muscle) {
                planner.decide(spec, model);
            }
        }
        planner.decide_activation();
        let decided = planner.decided;
        self.muscles.push(decided);
    }

    /// The bonds between muscles; the elements are the vertices in reach of the other's box.
    fn add_bonds(&mut self, scene: &Scene, assets: &Assets) {
        for interface in &scene.interfaces {
            let Some(bonding) = &interface.bond else {
                continue;
            };
            let [name, other] = interface.between.map(|m| scene.muscles[m].name.as_str());
            let effect = format!("bond with {other}");
            if let Some(why) = bonds::left_out(scene, self, interface) {
                self.leave(name, &effect, why);
                continue;
            }
            let within = bonds::within(scene, bonding);
            let [a, b] = interface.between.map(|m| &assets.muscles[m].mesh);
            let elements = near(a, b, within) + near(b, a, within);
            let sweeps = sub_steps(scene) * f64::from(scene.solver.iterations());
            self.run.push(Planned {
                muscle: name.to_owned(),
                effect,
                elements,
                bytes: elements * BOND,
                ms_per_frame: elements as f64 * NS_OF_BOND * sweeps * 1e-6,
            });
        }
    }

    fn leave_friction(&mut self, scene: &Scene) {
        let minimises = scene.solver.minimisation().is_some();
        if minimises && scene.effects.contact.is_some_and(|c| c.friction > 0.0) {
            self.leave(
                "",
                "friction",
                "a minimum of energy knows none; `solver.xpbd` has it",
            );
        }
    }
}

/// Decides which effects run on one muscle, or on the scene as a whole.
pub(super) struct Planner<'a> {
    pub scene: &'a Scene,
    pub assets: &'a Assets,
    /// Edges of the muscle.
    pub edges: usize,
    /// Pairs of triangles of the muscle that share an edge.
    pub hinges: usize,
    /// The muscle; the first one where the scene as a whole is planned.
    m: usize,
    /// Name of the muscle; empty for the scene as a whole.
    name: &'a str,
    decided: MusclePlan,
    plan: &'a mut Plan,
}

impl<'a> Planner<'a> {
    fn of_scene(scene: &'a Scene, assets: &'a Assets, plan: &'a mut Plan) -> Self {
        Self {
            scene,
            assets,
            edges: 0,
            hinges: 0,
            m: 0,
            name: "",
            decided: MusclePlan::default(),
            plan,
        }
    }

    fn of_muscle(scene: &'a Scene, assets: &'a Assets, m: usize, plan: &'a mut Plan) -> Self {
        let asset = &assets.muscles[m];
        let rest = assets.ready.rest(&asset.mesh);
        let topology = rest.topology();
        Self {
            edges: topology.edges.len() + asset.edges.len(),
            hinges: topology.hinges.len(),
            m,
            name: &scene.muscles[m].name,
            ..Self::of_scene(scene, assets, plan)
        }
    }

    fn decide(&mut self, spec: &EffectSpec, model: &EffectModel) {
        let material = &self.scene.muscles[self.m].material;
        let constant = spec.material.as_ref().and_then(|c| c.value(material));
        if !spec.is_on(&self.scene.effects) {
            self.leave(spec.key, format!("the scene has no [effects.{}]", spec.key));
        } else if self.scene.solver.share(spec.key).or(constant) == Some(0.0) {
            self.leave(spec.key, "its stiffness is zero");
        } else {
            (model.plan)(self);
        }
    }

    fn decide_activation(&mut self) {
        if self.scene.muscles[self.m].activation.is_empty() {
            return;
        }
        if !self.runs("stretch") {
            self.leave(
                ACTIVATION,
                "it shortens what stretch holds, which is left out",
            );
        } else if self.mesh().triangles.is_empty() {
            self.leave(ACTIVATION, "the body has no triangles");
        } else {
            self.run(ACTIVATION, self.edges, 0);
        }
    }

    /// The mesh of the muscle.
    pub fn mesh(&self) -> &'a TriangleMesh {
        &self.assets.muscles[self.m].mesh
    }

    /// The meshes of the muscle.
    pub fn asset(&self) -> &'a MuscleAsset {
        &self.assets.muscles[self.m]
    }

    /// Whether the muscle has fibres.
    pub fn has_fibres(&self) -> bool {
        self.scene.muscles[self.m].has_fibres(self.asset())
    }

    /// Whether the muscle is closed and not inside out.
    pub fn encloses_a_volume(&self) -> bool {
        let mesh = self.mesh();
        let is_closed = self.assets.ready.rest(mesh).topology().is_closed();
        is_closed && mesh.volume() > 0.0
    }

    /// Whether two bones hold the muscle.
    pub fn is_held_by_two_bones(&self) -> bool {
        let attachments = &self.scene.muscles[self.m].attachments;
        let mut bones = attachments.iter().map(|attachment| attachment.bone);
        let first = bones.next();
        bones.any(|bone| Some(bone) != first)
    }

    /// Whether an effect was decided to run.
    pub fn runs(&self, effect: &str) -> bool {
        self.decided.runs(effect)
    }

    /// Whether a bone or capsule is within reach, as planned so far.
    pub fn has_obstacles(&self) -> bool {
        !self.decided.obstacles.is_empty()
    }

    /// The box that the muscle is expected to stay in, see [`reach`].
    pub fn reach(&self) -> Option<Aabb> {
        reach(self.scene, self.mesh(), self.m)
    }

    /// The box that another muscle is expected to stay in.
    pub fn reach_of(&self, other: usize) -> Option<Aabb> {
        reach(self.scene, &self.assets.muscles[other].mesh, other)
    }

    /// The index of the muscle.
    pub fn index(&self) -> usize {
        self.m
    }

    /// The effect with a key does not run.
    pub fn leave(&mut self, effect: &str, why: impl Into<String>) {
        self.plan.leave(self.name, effect, why);
    }

    /// The effect with a key runs on some elements.
    pub fn run(&mut self, effect: &'static str, elements: usize, bytes: usize) {
        let sweeps = match self.scene.solver.minimisation() {
            // The number of evaluations of an equilibrium that starts at the previous one.
            Some(s) => f64::from(s.substeps) * f64::from(s.iterations.min(20)),
            None => {
                f64::from(self.scene.solver.substeps()) * f64::from(self.scene.solver.iterations())
            }
        };
        let ms_per_frame = elements as f64 * nanoseconds(effect) * sweeps * 1e-6;
        self.decided.effects.push(effect);
        self.add(effect, elements, bytes, ms_per_frame);
    }

    /// The muscle reaches obstacle `o`; the effect is contact with it.
    pub fn reaches(&mut self, o: usize, effect: &str, elements: usize, bytes: usize) {
        // By vertices: the cost of a bone's points is proportional to those of the
        // muscle.
        let vertices = self.mesh().vertices.len() as f64;
        let ms_per_frame = vertices * nanoseconds("contact") * sub_steps(self.scene) * 1e-6;
        self.decided.obstacles.push(o);
        self.add(effect, elements, bytes, ms_per_frame);
    }

    /// The muscle can meet another muscle, or itself.
    pub fn meets(&mut self, other: Option<usize>, effect: &str) {
        let vertices = self.mesh().vertices.len();
        let theirs = other.map_or(0, |other| self.assets.muscles[other].mesh.vertices.len());
        let elements = vertices + theirs;
        let ms_per_frame = elements as f64 * nanoseconds("contact") * sub_steps(self.scene) * 1e-6;
        self.decided.partners.extend(other);
        self.add(effect, elements, elements * MET, ms_per_frame);
    }

    fn add(&mut self, effect: &str, elements: usize, bytes: usize, ms_per_frame: f64) {
        self.plan.run.push(Planned {
            muscle: self.name.to_owned(),
            effect: effect.to_owned(),
            elements,
            bytes,
            ms_per_frame,
        });
    }
}

/// Number of vertices of a mesh within a distance of the box of another one.
fn near(mesh: &TriangleMesh, other: &TriangleMesh, within: f64) -> usize {
    let reach = other.bounding_box().inflate(within);
    let is_near = |x: &&Point3<f64>| reach.intersects(&Aabb::of_points([*x]));
    mesh.vertices.iter().filter(is_near).count()
}

/// Memory of a bond [bytes], and its time in a sweep [ns].
const BOND: usize = 120;
const NS_OF_BOND: f64 = 60.0;

/// Memory of a vertex that can meet others, with its near pairs [bytes].
const MET: usize = 640;

/// Time of an element of an effect in a sweep or step [ns].
fn nanoseconds(effect: &str) -> f64 {
    MODELS
        .iter()
        .find(|model| model.key == effect)
        .map_or(0.0, |model| model.nanoseconds)
}

fn sub_steps(scene: &Scene) -> f64 {
    f64::from(scene.solver.substeps())
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

/// The box of a bone over all frames.
pub(super) fn swept(scene: &Scene, bone: usize, bounds: &Aabb) -> Aabb {
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
