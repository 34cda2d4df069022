//! The simulation of a scene, frame by frame, with the effects of its plan.

pub(crate) mod assets;
pub(crate) mod attachments;
pub(crate) mod audit;
pub(crate) mod body;
mod bonds;
mod carriage;
pub mod checkpoint;
mod contact_comparison;
mod contraction;
mod course;
mod effects;
mod fascia;
pub(crate) mod equilibrium;
pub(crate) mod tracked;
mod fault;
mod fibres;
mod finer_mesh;
mod frame;
mod ready;
mod refinement;
mod sensitivity;
mod joint;
mod jump;
pub(crate) mod joint_weights;
pub(crate) mod lattice;
mod lone;
pub(crate) mod measures;
pub(crate) mod plan;
pub(crate) mod run;
pub(crate) mod scenario;
pub(crate) mod skin;
pub(crate) mod spring_bodies;
pub(crate) mod springs;
mod start;
mod step_control;
mod steer;
mod together;

pub use attachments::component;
pub use audit::{Audit, AuditSummary, AuditedSurface, CrossingCounts, PairSummary};
pub use contact_comparison::compare_contact;
pub use lattice::{LatticeMeasures, LatticeRun};
pub use measures::{VOLUME_HELD, strain_at_vertices};
pub use plan::{LeftOut, Planned};
pub use refinement::Attained;
pub use sensitivity::{ByRuns, Sensitivities, SensitivityError, UncertainMeasure, sensitivities};
pub use sensitivity::{Combination, FitTarget, Fitted, FittedValue, fit};
pub use sensitivity::{Unloaded, unload};
pub use skin::{SkinMeasures, SkinPart, SkinRun};
pub use spring_bodies::SpringBodiesRun;
pub use springs::{SpringsModel, SpringsModelError, SpringsRun};

use std::sync::Arc;

use nalgebra::Isometry3;
use rayon::prelude::*;

pub use assets::Assets;
pub use body::Body;
pub(crate) use body::Stepper;
pub use fault::{Fault, LoadError};
use finer_mesh::FinerMesh;
pub use measures::Measures;
pub use plan::Plan;
use refinement::{Refinement, Target};
pub use run::{Ended, Observer, run};
pub(crate) use scenario::BodyState;
pub use scenario::{
    BodyDescription, FrameState, GeometricRun, Scenario, ScenarioError, ScenarioKind,
    SceneDescription, Stepped, scenario, scenario_with,
};
use start::Start;
use step_control::StepControl;

use crate::contact::broad_phase::BroadPhase;
use crate::contact::capsule::Capsule;
use crate::contact::meeting::Certificate;
use crate::contact::{Obstacle, PartedPair, PosedObstacle, Surface};
use crate::mesh::TriangleMesh;
use crate::scene::{Accuracy, Scene};
use crate::state::{DecodeError, Reader, State, Writer};

/// A simulation of muscles.
pub struct Simulation {
    /// The scene.
    pub scene: Scene,
    /// The effects that run.
    pub plan: Plan,
    /// Muscles.
    pub bodies: Vec<Body>,
    /// Pairs of muscles, or of a muscle and a bone, that overlapped before the start.
    pub parted: Vec<PartedPair>,
    /// Bone meshes in their own frame.
    pub bones: Vec<TriangleMesh>,
    /// Notes from reading and from the run.
    pub notes: Vec<String>,
    surfaces: Vec<Arc<Surface>>,
    placed: Vec<PosedObstacle>,
    freed: Vec<attachments::Freed>,
    /// Bodies that step together; made before the first frame.
    groups: Vec<together::Group>,
    /// Minima without a neighbour, before the present frame.
    lone: Vec<lone::Lone>,
    certificate: Certificate,
    frame: usize,
    substeps: u32,
    /// Number of steps of the frames, beside that of the scene.
    control: StepControl,
    /// Steps of vertices so far, with those of tries that were undone, and the most that there may be.
    work: u64,
    most_work: u64,
    /// The runs of a requested accuracy, of which it shows one.
    refinement: Option<Box<Refinement>>,
    /// The same scene on a finer mesh, which tells the error of the mesh.
    finer: Option<Box<FinerMesh>>,
    /// Where frames are computed; `None`: in the pool of the caller.
    pool: Option<rayon::ThreadPool>,
}

impl Simulation {
    /// Prepares a scene: reads its meshes, makes the plan, creates the effects of the plan.
    ///
    /// # Errors
    /// A mesh that cannot be read or used, or an impossible attachment.
    pub fn new(scene: Scene) -> Result<Self, LoadError> {
        let assets = Assets::load(&scene)?;
        let plan = Plan::new(&scene, &assets);
        Self::with(scene, assets, plan)
    }

    /// The same as [`Self::new`], with given meshes and plan.
    ///
    /// # Errors
    /// An impossible attachment.
    pub fn with(scene: Scene, assets: Assets, plan: Plan) -> Result<Self, LoadError> {
        if scene.mesh_error {
            return Self::with_finer_mesh(scene, assets, plan);
        }
        let Some(accuracy) = scene.accuracy else {
            return Self::alone(scene, assets, plan);
        };
        let usual = scene.solver.usual_steps(scene.adapts_steps);
        let scene = Scene {
            accuracy: None,
            adapts_steps: false,
            solver: scene.solver.of_any_steps(),
            ..scene
        };
        let run = || Self::alone(scene.clone(), assets.clone(), plan.clone());
        let mut front = run()?;
        let lengths = front.bodies.iter().map(|body| body.length);
        let target = match accuracy {
            Accuracy::Length(length) => Target::Error(length),
            Accuracy::Share(share) => Target::Error(share * lengths.fold(f64::INFINITY, f64::min)),
            Accuracy::OfMotion(share) => Target::ShareOfMotion(share, Box::new(run()?)),
        };
        front.refinement = Some(Box::new(Refinement::new(run()?, run()?, usual, target)));
        front.scene.accuracy = Some(accuracy);
        Ok(front)
    }

    /// A simulation with a run on a finer mesh beside it.
    fn with_finer_mesh(scene: Scene, assets: Assets, plan: Plan) -> Result<Self, LoadError> {
        let scene = Scene {
            mesh_error: false,
            ..scene
        };
        // A wrong scene is refused with the numbers of its own mesh.
        let mut front = Self::with(scene.clone(), assets.clone(), plan)?;
        let finer = FinerMesh::new(&scene, &assets)?;
        front.scene.mesh_error = true;
        front.notes.push(format!(
            "the error of the mesh is that against a second run with triangles a quarter as large: {} vertices",
            finer.vertices()
        ));
        front.finer = Some(Box::new(finer));
        Ok(front)
    }

    /// A simulation without a requested accuracy.
    fn alone(scene: Scene, assets: Assets, plan: Plan) -> Result<Self, LoadError> {
        let surfaces: Vec<Arc<Surface>> = assets
            .bones
            .par_iter()
            .map(|mesh| assets.ready.surface(mesh))
            .collect();
        let mut placed = place(&scene, &surfaces);
        for (placed, capsule) in placed[scene.bones.len()..].iter_mut().zip(&scene.capsules) {
            placed.obstacle = assets.ready.capsule(capsule.segment, capsule.radius);
        }
        let start = Start::new(&scene, &assets, &plan, &placed, &surfaces)?;
        let bodies = (0..scene.muscles.len())
            .zip(start.muscles)
            .map(|(m, start)| Body::new(&scene, &assets, m, &plan.muscles[m], &placed, start));
        let bodies = fault::all_of(bodies)?;
        let mut notes = scene
            .opensim
            .as_ref()
            .map_or(Vec::new(), |drive| drive.notes.clone());
        for (bone, found) in scene.bones.iter().zip(&assets.bone_notes) {
            notes.extend(found.iter().map(|n| format!("{}: {n}", bone.name)));
        }
        for (muscle, asset) in scene.muscles.iter().zip(&assets.muscles) {
            notes.extend(asset.notes.iter().map(|n| format!("{}: {n}", muscle.name)));
        }
        notes.extend(start.freed.iter().map(|freed| freed.note(&scene)));
        let substeps = scene.solver.substeps();
        let mut simulation = Self {
            plan,
            bodies,
            parted: start.pairs,
            bones: assets.bones,
            notes,
            surfaces,
            placed,
            freed: start.freed,
            groups: Vec::new(),
            lone: Vec::new(),
            certificate: Certificate::default(),
            frame: 0,
            substeps,
            control: StepControl::new(&scene),
            work: 0,
            most_work: u64::MAX,
            refinement: None,
            finer: None,
            pool: None,
            scene,
        };
        simulation.gather();
        simulation.note_bonds();
        simulation.note_fascia();
        Ok(simulation)
    }

    /// The last computed frame; 0 is the start.
    pub fn frame(&self) -> usize {
        self.frame
    }

    /// The pose of a bone at a frame.
    pub fn pose(&self, bone: usize, frame: f64) -> Isometry3<f64> {
        self.scene.bones[bone].motion.pose(frame)
    }

    /// The surface of a bone.
    pub fn surface(&self, bone: usize) -> &Surface {
        &self.surfaces[bone]
    }

    /// All obstacles at their present poses, bones first.
    pub fn placed(&self) -> &[PosedObstacle] {
        &self.placed
    }

    /// Sets another method of contact search with bones, for comparison with the default hierarchy;
    /// capsules have no triangles. Distances agree up to rounding, and so do results.
    pub fn set_broad_phase(&mut self, method: &BroadPhase) {
        for (placed, mesh) in self.placed.iter_mut().zip(&self.bones) {
            placed.obstacle = method.obstacle(mesh);
        }
    }

    /// Counts that certify that nothing crossed, over all frames so far.
    pub fn certificate(&self) -> Certificate {
        self.certificate
    }

    /// The work of all frames since it was made: the number of steps times that of vertices, with those that
    /// were undone. A trial of a minimisation counts as 30 steps, and the pairs of surfaces and rows of
    /// contact that are read count as well. Unlike a time it is the same on any machine.
    pub fn work(&self) -> u64 {
        self.work
    }

    /// Sets the most work of all frames: one in which it is spent is undone and counts as interrupted.
    pub fn limit_work(&mut self, most: u64) {
        self.most_work = most;
    }

    /// Computes frames on `threads` threads of its own, or on those of the caller if the system
    /// provides none. Results do not depend on the number of threads.
    pub fn set_threads(&mut self, threads: usize) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        self.pool = pool.build().ok();
    }

    /// Measures of every muscle at the last frame, with the independent audit.
    pub fn measure(&self) -> Vec<Measures> {
        let bones: Vec<audit::AuditedBone<'_>> = self
            .bones
            .iter()
            .zip(&self.surfaces)
            .map(|(mesh, surface)| audit::AuditedBone::new(mesh, surface))
            .collect();
        let posed: Vec<_> = bones
            .iter()
            .enumerate()
            .map(|(b, bone)| (bone, self.pose(b, self.frame as f64)))
            .collect();
        let of = |(b, body)| {
            let mut measures = Measures::of(body, self.frame, &self.scene, &posed);
            if let Some(refinement) = &self.refinement {
                measures.error_m = refinement.error(b);
                measures.converged = body.stopped.is_none() && refinement.is_kept();
            }
            measures
        };
        self.bodies.iter().enumerate().map(of).collect()
    }

    /// What a requested accuracy cost so far, and whether it was kept; `None` without one.
    pub fn attained(&self) -> Option<&Attained> {
        self.refinement.as_ref().map(|runs| runs.attained())
    }

    /// The estimated error by the mesh, RMS over all vertices in the worst frame so far [m]: NaN if a muscle
    /// stopped on the finer mesh, `None` if the scene does not ask for it.
    pub fn mesh_error(&self) -> Option<f64> {
        self.finer.as_ref().map(|finer| finer.all())
    }

    /// The same of one muscle.
    pub fn mesh_error_of(&self, muscle: usize) -> Option<f64> {
        self.finer.as_ref().map(|finer| finer.of_muscle(muscle))
    }

    /// Sets the tolerance of equilibria in later frames.
    fn set_tolerance(&mut self, tolerance: f64) {
        let own = self.bodies.iter_mut().filter_map(Body::equilibrium_mut);
        own.for_each(|equilibrium| equilibrium.set_tolerance(tolerance));
        for group in &mut self.groups {
            group.set_tolerance(tolerance);
        }
    }
}

/// The state for [`checkpoint`]: everything on which a later frame depends, without the clock.
impl State for Simulation {
    fn save(&self, to: &mut Writer) {
        let Self {
            scene: _,
            plan: _,
            bodies,
            parted: _,
            bones: _,
            notes,
            surfaces: _,
            placed: _,
            groups,
            // Made anew at the start of each frame.
            lone: _,
            certificate,
            frame,
            substeps: _,
            control,
            work: _,
            most_work: _,
            refinement,
            finer,
            pool: _,
            freed: _,
        } = self;
        // A checkpoint begins with its frame.
        to.put(frame);
        if let Some(refinement) = refinement {
            // What it shows is a frame of another run.
            refinement.save(to);
        } else {
            to.list(notes);
            certificate.save(to);
            control.save(to);
            bodies.iter().for_each(|body| body.save(to));
            groups.iter().for_each(|group| group.save(to));
        }
        if let Some(finer) = finer {
            finer.save(to);
        }
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        if let Some(mut refinement) = self.refinement.take() {
            let _: usize = from.take()?;
            let restored = refinement.restore(self, from);
            self.refinement = Some(refinement);
            restored?;
        } else {
            self.restore_shown(from)?;
            // Counted anew where the restored state is.
            self.lone.clear();
            self.gather();
            self.groups
                .iter_mut()
                .try_for_each(|group| group.restore(from))?;
        }
        self.finer
            .iter_mut()
            .try_for_each(|finer| finer.restore(from))
    }
}

impl Simulation {
    /// Restores what can be seen of a frame. No further frame can be computed then.
    fn restore_shown(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let frame: usize = from.take()?;
        self.notes = from.take()?;
        self.certificate.restore(from)?;
        self.control.restore(from)?;
        match frame.checked_sub(1) {
            None => self.placed = place(&self.scene, &self.surfaces),
            Some(before) => {
                self.frame = before;
                let steps = self.control.taken();
                self.placed = self.placed_in(steps.saturating_sub(1), steps);
            }
        }
        self.frame = frame;
        let contact = self.scene.effects.contact;
        self.bodies
            .iter_mut()
            .try_for_each(|body| body.restore(from, &self.placed, contact, frame))
    }
}

/// The bone that carries obstacle `o`: bones come first, then capsules.
fn carrier(scene: &Scene, o: usize) -> usize {
    o.checked_sub(scene.bones.len())
        .map_or(o, |c| scene.capsules[c].bone)
}

fn place(scene: &Scene, surfaces: &[Arc<Surface>]) -> Vec<PosedObstacle> {
    let bones = scene.bones.iter().zip(surfaces).map(|(bone, surface)| {
        let pose = bone.motion.pose(0.0);
        PosedObstacle {
            name: bone.name.clone(),
            obstacle: surface.clone() as Arc<dyn Obstacle>,
            before: pose,
            now: pose,
        }
    });
    let capsules = scene.capsules.iter().map(|capsule| {
        let pose = scene.bones[capsule.bone].motion.pose(0.0);
        let shape = Capsule {
            ends: capsule.segment,
            radius: capsule.radius,
        };
        PosedObstacle {
            name: capsule.name.clone(),
            obstacle: Arc::new(shape),
            before: pose,
            now: pose,
        }
    });
    bones.chain(capsules).collect()
}
