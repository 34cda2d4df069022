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
mod ready;
mod joint;
pub(crate) mod joint_weights;
pub(crate) mod lattice;
mod lone;
pub(crate) mod measures;
pub(crate) mod plan;
pub(crate) mod run;
pub(crate) mod scenario;
pub(crate) mod skin;
pub(crate) mod springs;
mod start;
mod step_control;
mod steer;
mod together;

pub use attachments::component;
pub use audit::{
    Audit, AuditSummary, AuditedPair, AuditedSurface, CrossingCounts, FrameAudit, PairSummary,
};
pub use contact_comparison::compare_contact;
pub use lattice::{LatticeMeasures, LatticeRun};
pub use measures::{VOLUME_HELD, strain_at_vertices};
pub use plan::{LeftOut, Planned};
pub use skin::{SkinMeasures, SkinPart, SkinRun};
pub use springs::{SpringsModel, SpringsModelError, SpringsRun};

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use nalgebra::Isometry3;
use rayon::prelude::*;

pub use assets::Assets;
pub use body::Body;
pub(crate) use body::Stepper;
pub use fault::{Fault, LoadError};
pub use measures::Measures;
pub use plan::Plan;
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
use crate::contact::{Contacts, Obstacle, PartedPair, PosedObstacle, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::state::{DecodeError, Reader, State, Writer};

/// Greatest depth of a vertex below a bone's surface at the end of a frame without another contact
/// query, relative to the contact thickness.
const SETTLED: f64 = 2e-4;

/// A progress is asked after this time whether to stop.
const ASKED_EVERY: Duration = Duration::from_millis(20);

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
            .map(|(m, start)| Body::new(&scene, &assets, m, &plan.muscles[m], &placed, start))
            .collect::<Result<Vec<_>, _>>()?;
        let mut notes = Vec::new();
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

    /// Computes frames on `threads` threads of its own, or on those of the caller if the system
    /// provides none. Results do not depend on the number of threads.
    pub fn set_threads(&mut self, threads: usize) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        self.pool = pool.build().ok();
    }

    /// Computes the next frame.
    pub fn step_frame(&mut self) {
        self.frame_unless(Stop(None));
    }

    /// Computes the next frame, unless the progress stops it: it is asked many times a second.
    /// Then everything is as before the frame. In a pool of threads the progress is not asked.
    pub fn step_frame_with(&mut self, progress: &dyn Progress) -> Stepped {
        // A thread of a pool that waits for others of it could wait for ever.
        if rayon::current_thread_index().is_some() {
            self.step_frame();
            return Stepped::Done;
        }
        let asked = AtomicBool::new(false);
        let (held, dropped) = mpsc::channel::<()>();
        let done = thread::scope(|scope| {
            let worker = thread::Builder::new().spawn_scoped(scope, || {
                // Dropped at the end, after a panic as well.
                let _held = held;
                self.frame_unless(Stop(Some(&asked)))
            });
            let worker = worker.ok()?;
            while dropped.recv_timeout(ASKED_EVERY) == Err(RecvTimeoutError::Timeout) {
                if progress.is_stopped() {
                    asked.store(true, Ordering::Relaxed);
                }
            }
            Some(worker.join())
        });
        match done {
            Some(Ok(true)) => Stepped::Done,
            Some(Ok(false)) => Stepped::Interrupted,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            // The system has no thread left.
            None => {
                self.step_frame();
                Stepped::Done
            }
        }
    }

    fn frame_unless(&mut self, stop: Stop<'_>) -> bool {
        match self.pool.take() {
            Some(pool) => {
                let done = pool.install(|| self.compute_frame(stop));
                self.pool = Some(pool);
                done
            }
            None => self.compute_frame(stop),
        }
    }

    /// Computes a frame with steps so short that no surface jumps. Returns false if it was stopped,
    /// and then all is as before it.
    fn compute_frame(&mut self, stop: Stop<'_>) -> bool {
        // Bodies can have been changed since the last frame.
        self.gather();
        let can_jump = self.bodies.iter().any(Body::can_jump);
        self.watch_lone();
        let start = (can_jump || stop.can_come() || !self.lone.is_empty()).then(|| {
            let mut start = Writer::default();
            self.save(&mut start);
            start.bytes
        });
        self.control.begin_frame();
        let (mut first, had_refined) = (None, self.control.has_refined());
        loop {
            let is_last_try = !can_jump || self.control.is_shortest();
            self.try_frame(is_last_try, stop);
            if stop.is_asked() {
                self.undo(start.as_deref());
                return false;
            }
            let jumped = self.bodies.iter().find_map(|body| {
                let vertex = body.jump?;
                Some(format!("{}: vertex {vertex}", body.name))
            });
            if let Some(jumped) = jumped.filter(|_| !is_last_try) {
                if self.control.shorten() {
                    first = Some(jumped);
                }
            } else if !can_jump || !self.control.refines(self.residual()) {
                let crossed = self.crossed_alone();
                if crossed.is_empty() {
                    break;
                }
                self.keep_apart(&crossed, start.as_deref());
                continue;
            }
            let control = self.control;
            self.undo(start.as_deref());
            self.control = control;
        }
        if self.bodies.iter().all(|body| body.jump.is_none()) {
            self.control.note_calm(self.residual());
        }
        let (frame, most) = (self.frame, self.control.most());
        if let Some(vertex) = first {
            self.notes.push(format!(
                "{vertex} jumped in frame {frame}: this frame and others in which a vertex jumps \
                 take up to {most} times as many steps"
            ));
        }
        if self.control.has_refined() && !had_refined {
            let why = if self.scene.adapts_steps {
                "the scene names no `substeps`: a residual is above the tolerance"
            } else {
                "a volume is off its target"
            };
            self.notes.push(format!(
                "{why} with {} steps in frame {frame}: this frame and others like it take up to {most} \
                 times as many",
                self.substeps
            ));
        }
        self.watch_reach();
        self.gather();
        true
    }

    /// Goes back to a saved start of the frame.
    fn undo(&mut self, start: Option<&[u8]>) {
        let restored = self.restore(&mut Reader::new(start.unwrap_or(&[])));
        debug_assert!(restored.is_ok());
        self.gather();
    }

    /// The greatest residual of muscles that sweep, relative to the tolerance: that of the volumes that
    /// are kept exactly, and of the elastic constraints if the scene has no number of steps.
    fn residual(&self) -> f64 {
        let tolerance = self.scene.solver.tolerance();
        let of = |body: &Body| {
            let volume = body.volume_residual() / VOLUME_HELD;
            if !self.scene.adapts_steps {
                return volume;
            }
            let elastic = measures::elastic_residual(body) / (tolerance * body.edge_length);
            max_or_nan([volume, elastic])
        };
        let swept = self.bodies.iter().filter(|body| body.can_jump());
        max_or_nan(swept.map(of))
    }

    /// Computes the steps of the next frame; a jump ends them, and stops the body in the last try.
    fn try_frame(&mut self, is_last_try: bool, stop: Stop<'_>) {
        let substeps = self.control.steps(self.substeps);
        for body in &mut self.bodies {
            body.jump = None;
            let (parts, whole) = if self.scene.solver.has_classic_stiffness() {
                (substeps / self.substeps, self.substeps)
            } else {
                (1, substeps)
            };
            body.system.divide(parts);
            let settings = body::settings(&self.scene, body.length, whole);
            let own = &mut body.system.settings;
            own.velocity_factor = settings.velocity_factor;
            own.force_factor = settings.force_factor;
        }
        let of_frame = FrameSteps {
            steps: (0..substeps).map(|s| self.placed_in(s, substeps)).collect(),
            dt: body::time_step(&self.scene, substeps),
            frame: self.frame + 1,
            thickness: self.scene.effects.contact.map_or(0.0, |c| c.thickness),
            is_last_try,
            stop,
        };
        let mut bodies: Vec<Option<&mut Body>> = self.bodies.iter_mut().map(Some).collect();
        let of_group = |group: &together::Group| -> Vec<&mut Body> {
            let members = group.members.iter();
            members.filter_map(|&b| bodies[b].take()).collect()
        };
        let bodies: Vec<Vec<&mut Body>> = self.groups.iter().map(of_group).collect();
        let groups = &mut self.groups;
        // From within the pool, threads that wait cost less than from outside.
        rayon::scope(|_| {
            groups
                .par_iter_mut()
                .zip(bodies)
                .for_each(|(group, mut bodies)| group.compute(&mut bodies, &of_frame));
        });
        for group in &mut self.groups {
            self.certificate.add(&group.take_certificate());
        }
        self.frame = of_frame.frame;
        self.placed = of_frame.steps.into_iter().next_back().unwrap_or_default();
    }

    /// The obstacles in a step of the next frame, which has `steps`.
    fn placed_in(&self, step: u32, steps: u32) -> Vec<PosedObstacle> {
        let at = |s: u32| self.frame as f64 + f64::from(s) / f64::from(steps);
        let poses = |bone: usize| (self.pose(bone, at(step)), self.pose(bone, at(step + 1)));
        self.placed
            .iter()
            .enumerate()
            .map(|(o, placed)| {
                let (before, now) = poses(carrier(&self.scene, o));
                PosedObstacle {
                    before,
                    now,
                    ..placed.clone()
                }
            })
            .collect()
    }

    /// Extends the contact of a muscle that leaves the box of the plan.
    fn watch_reach(&mut self) {
        let Some(contact) = self.scene.effects.contact else {
            return;
        };
        for body in &mut self.bodies {
            if body.rest.triangles.is_empty() {
                continue;
            }
            let mut obstacles = body
                .system
                .contacts
                .as_ref()
                .map_or(Vec::new(), |c| c.obstacles().to_vec());
            let bounds =
                Aabb::of_points(&body.system.particles.position).inflate(0.02 * body.length);
            let newly_reached: Vec<usize> = (0..self.placed.len())
                .filter(|o| !obstacles.contains(o))
                .filter(|&o| {
                    let placed = &self.placed[o];
                    placed
                        .obstacle
                        .bounding_box()
                        .transformed(&placed.now)
                        .intersects(&bounds)
                })
                .collect();
            if newly_reached.is_empty() {
                continue;
            }
            for &o in &newly_reached {
                self.notes.push(format!(
                    "{}: left the box that the plan foresaw at frame {} and came near {}; contact with it runs from there",
                    body.name, self.frame, self.placed[o].name
                ));
            }
            obstacles.extend(newly_reached);
            obstacles.sort_unstable();
            let particles = &body.system.particles;
            body.system.contacts = Some(Contacts::new(
                &body.rest,
                particles,
                &self.placed,
                obstacles,
                contact.thickness,
                contact.friction,
            ));
        }
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
        self.bodies
            .iter()
            .map(|body| Measures::of(body, self.frame, &self.scene, &posed))
            .collect()
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
            pool: _,
            freed: _,
        } = self;
        to.put(frame);
        to.list(notes);
        certificate.save(to);
        control.save(to);
        bodies.iter().for_each(|body| body.save(to));
        groups.iter().for_each(|group| group.save(to));
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let frame: usize = from.take()?;
        self.notes = from.take()?;
        self.certificate.restore(from)?;
        self.control.restore(from)?;
        match frame.checked_sub(1) {
            None => self.placed = place(&self.scene, &self.surfaces),
            Some(before) => {
                self.frame = before;
                let steps = self.control.steps(self.substeps);
                self.placed = self.placed_in(steps.saturating_sub(1), steps);
            }
        }
        self.frame = frame;
        let contact = self.scene.effects.contact;
        self.bodies
            .iter_mut()
            .try_for_each(|body| body.restore(from, &self.placed, contact, frame))?;
        self.gather();
        self.groups
            .iter_mut()
            .try_for_each(|group| group.restore(from))
    }
}

/// Whether the computation of a frame is to end.
#[derive(Clone, Copy, Debug)]
struct Stop<'a>(Option<&'a AtomicBool>);

impl Stop<'_> {
    /// False if nobody can ask for a stop.
    fn can_come(self) -> bool {
        self.0.is_some()
    }

    fn is_asked(self) -> bool {
        self.0.is_some_and(|asked| asked.load(Ordering::Relaxed))
    }
}

/// The steps of a frame.
struct FrameSteps<'a> {
    /// The obstacles in each step.
    steps: Vec<Vec<PosedObstacle>>,
    /// Length of a step [s].
    dt: f64,
    /// Number of the frame.
    frame: usize,
    /// Contact thickness [m].
    thickness: f64,
    /// True if the frame is not repeated with shorter steps.
    is_last_try: bool,
    /// Ends the frame early.
    stop: Stop<'a>,
}

fn step_body(body: &mut Body, of: &FrameSteps<'_>) {
    if let Some(equilibrium) = body.equilibrium_mut() {
        equilibrium.begin_frame();
    }
    for (step, placed) in of.steps.iter().enumerate() {
        body.prepare(of, step);
        if let Err(broken) = body.step(placed, of) {
            body.stop(of.frame, broken);
        }
        if body.stops_or_jumps(of, step) || of.stop.is_asked() {
            return;
        }
    }
    body.stop_if_torn(of);
    if body.stopped.is_some() {
        return;
    }
    // An equilibrium ends with contact and volume satisfied.
    let at_rest = !matches!(body.method, Stepper::Sweeps);
    if let Some(last) = of.steps.last().filter(|_| !at_rest) {
        body.system.settle(last, SETTLED * of.thickness);
    }
    body.good.clone_from(&body.system.particles);
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
