//! A sweep: a joint turns through a range of angles, and the muscles over it and their fibres
//! follow.

mod motion;
mod scenario;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::chords;
use crate::contact::smooth::SmoothDistance;
use crate::contact::{Obstacle, PosedObstacle};
use crate::fibres::attachment::{AreaSource, Attachment, AttachmentError};
use crate::fibres::carry::BoundVolume;
use crate::fibres::harmonic::{self, DecompositionError, decompose};
use crate::fibres::polyline::length;
use crate::fibres::quality::{self, Quality};
use crate::mesh::Topology;
use crate::mesh::measures::max_or_nan;
use crate::rigid::screw_part;
use crate::scene::{AreaSpec, Joint, Minimisation, Scene, Solver};
use crate::simulation::Stepper;
use crate::simulation::joint_weights::{Distances, distances, joint_weights};
use crate::simulation::tracked::{self, Tracked, TrackedParts};
use crate::simulation::{Body, LoadError, Simulation, audit};
use crate::solvers::Broken;
use crate::solvers::descent::DescentSettings;
use crate::solvers::sparse::FactorError;
use motion::{Course, joint};
pub use motion::{NO_JOINT, joint as joint_of, joints};

/// Greatest number of angles of a sweep.
pub const MOST_VALUES: usize = 10_000;
/// Greatest range of a sweep \[rad\]: no joint turns by more than half a turn.
pub const WIDEST: f64 = std::f64::consts::PI;

/// Solver settings for the correction of the interpolated rotation.
const CORRECTION: Minimisation = Minimisation {
    substeps: 1,
    iterations: 100,
    tolerance: 1e-8,
};

/// Stiffness with which a muscle tracks the interpolated rotation, relative to the stiffness of its
/// edges at rest. Neither is known better than the other; the value is not fitted.
const TRACKING: f64 = 1.0;

/// Spacing of samples of the distance to a bone, relative to the bone's median edge. The triangles
/// give no finer distance; a coarser grid would round its edges by more than a tenth of a contact
/// thickness.
const FINENESS: f64 = 0.5;

/// Spacing of samples for a capsule, relative to its diameter: the sampled distance differs from
/// the exact one by a thousandth of the diameter.
const ROUND: f64 = 0.04;

/// Parameters of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Name of the joint, or of a bone that turns about one.
    pub joint: String,
    /// Axis of rotation instead of the joint's.
    pub axis: Option<Unit<Vector3<f64>>>,
    /// First angle \[rad\]; at 0 the meshes are as given.
    pub from: f64,
    /// Last angle \[rad\].
    pub to: f64,
    /// Angle between two values \[rad\]; reduced slightly where the range is no multiple of it.
    pub step: f64,
    /// Number of frames from one value to the next.
    pub frames: u32,
    /// Settings of the fibres of each muscle.
    pub fibres: harmonic::HarmonicOptions,
    /// Stepper that moves the muscles.
    pub by: MuscleStepper,
}

impl Sweep {
    /// The angles at equal distances \[rad\].
    ///
    /// # Errors
    /// An empty or too wide range, a step that makes too few or too many.
    pub fn angles(&self) -> Result<Vec<f64>, SweepError> {
        let Self { from, to, step, .. } = *self;
        let refuse = |text: String| Err(SweepError::Range(text));
        let degrees = |angle: f64| crate::format::number(angle.to_degrees());
        if !(from < to) {
            return refuse(format!(
                "from {} to {} degrees is no range; the first angle must be below the last",
                degrees(from),
                degrees(to)
            ));
        }
        if !(from >= -WIDEST && to <= WIDEST) {
            return refuse(
                "a joint turns by at most 180 degrees either way; choose the first and the last angle within that"
                    .to_owned(),
            );
        }
        if !(step > 0.0) || (to - from) / step > MOST_VALUES as f64 {
            return refuse(format!(
                "a step of {} degrees makes no or too many values; choose another step",
                degrees(step)
            ));
        }
        // Ignores rounding where the range is a multiple of the step.
        let count = ((to - from) / step - 1e-9).ceil().max(1.0) as usize;
        if count < 2 {
            return refuse(
                "a moment arm needs at least 3 values of the angle; choose a smaller step"
                    .to_owned(),
            );
        }
        Ok((0..=count)
            // The last one has no rounding: a path can end there.
            .map(|k| match k == count {
                true => to,
                false => from + (to - from) * (k as f64 / count as f64),
            })
            .collect())
    }
}

/// Stepper that moves the muscles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MuscleStepper {
    /// Every vertex turns about the joint by a share of its angle. The share varies over the muscle
    /// from 0 at the attachment to resting bones to 1 at the attachment to turning bones
    /// ([`super::joint_weights`]). From this shape, tone, bones and volume bring the muscle to rest. Each
    /// angle has exactly one such shape, and the shape depends smoothly on the angle.
    #[default]
    Spread,
    /// The scene's solver.
    Scene,
}

/// Error of [`SweepRun::new`].
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The range is empty or too wide, or the step is invalid.
    #[error("{0}")]
    Range(String),
    /// No bone has the joint.
    #[error("the scene has no joint `{name}`; {known}")]
    NoJoint {
        /// The requested name.
        name: String,
        /// The names in the scene.
        known: String,
    },
    /// No muscle crosses the joint.
    #[error(
        "no muscle is held on both sides of the joint `{0}`: one end on a bone that turns, the other on one that rests"
    )]
    NothingCrosses(String),
    /// No model moves the bones.
    #[error("no model of OpenSim moves the bones of the scene")]
    NoModel,
    /// A muscle is not closed.
    #[error(
        "muscle `{0}` is not closed, so it has no inside for fibres; `repair = true` and `close_holes` mend it"
    )]
    Open(String),
    /// The attachment areas cannot be used.
    #[error("muscle `{muscle}`: {error}")]
    Areas {
        /// Name of the muscle.
        muscle: String,
        /// The cause.
        error: AttachmentError,
    },
    /// The matrix of the correction cannot be factorised.
    #[error("muscle `{muscle}`: {error}")]
    Factor {
        /// Name of the muscle.
        muscle: String,
        /// The cause.
        error: FactorError,
    },
    /// The decomposition found no fibres.
    #[error("muscle `{muscle}`: {error}")]
    Fibres {
        /// Name of the muscle.
        muscle: String,
        /// The cause.
        error: DecompositionError,
    },
    /// The scene cannot run.
    #[error(transparent)]
    Load(#[from] LoadError),
}

/// A muscle that crosses the joint, with its measures so far.
#[derive(Debug)]
pub struct CrossingMuscle {
    /// Name of the muscle.
    pub name: String,
    /// Fibres at rest, from the resting to the turning bones [m].
    pub fibres: Vec<Vec<Point3<f64>>>,
    /// Quality of the fibres at rest.
    pub quality: Quality,
    /// Physiological cross-sectional area: volume over mean fibre length at rest [m2].
    pub physiological_area: f64,
    /// Length of each fibre at each angle [m], as `lengths[angle][fibre]`.
    pub lengths: Vec<Vec<f64>>,
    /// Mean over the fibres of the distance between their ends, at each angle [m].
    pub chords: Vec<f64>,
    /// Share of the straight lines between the ends of fibres that no bone blocks, at each angle.
    pub clear: Vec<f64>,
    /// Number of inner fibre points deeper than [`audit::DEPTH`] in a bone, over all angles.
    pub points_in_bone: usize,
    /// Greatest depth of such a point [m].
    pub depth: f64,
    /// Greatest depth of a free vertex in a bone [m].
    pub vertex_depth: f64,
    /// Greatest relative departure of the volume from that at rest.
    pub volume_error: f64,
    /// Number of angles at which forces, volume or depth exceeded their tolerances.
    pub unconverged: usize,
    /// The frame at which the simulation of the muscle stopped, and the cause.
    pub stopped: Option<(usize, Broken)>,
    /// Share of each vertex in each joint's displacement; empty where the scene's solver moves the
    /// muscle.
    joint_weights: Vec<Vec<f64>>,
    bound: BoundVolume,
    now: Vec<Vec<Point3<f64>>>,
}

impl CrossingMuscle {
    /// The fibres at the last angle [m].
    pub fn now(&self) -> &[Vec<Point3<f64>>] {
        &self.now
    }
}

/// A sweep in progress.
pub struct SweepRun {
    /// The scene; its motion is the sweep.
    pub simulation: Simulation,
    /// Muscles that cross the joint, in the order of `simulation.bodies`.
    pub muscles: Vec<CrossingMuscle>,
    /// Muscles that do not cross the joint.
    pub left_out: Vec<String>,
    /// All values of the angle \[rad\]; of a run through poses, their indices.
    pub angles: Vec<f64>,
    /// Angle between two values \[rad\].
    pub step: f64,
    /// Centre [m] and axis of the joint.
    pub joint: Joint,
    course: Course,
    done: usize,
}

impl SweepRun {
    /// Prepares a scene: its joint turns from the given pose to the first angle, rests, and turns
    /// on.
    ///
    /// # Errors
    /// An invalid range, an unknown joint, no muscle over the joint, no fibres, or a scene that
    /// cannot run.
    pub fn new(scene: Scene, sweep: &Sweep) -> Result<Self, SweepError> {
        let angles = sweep.angles()?;
        let (mut joint, turning) = joint(&scene, &sweep.joint)?;
        if let Some(axis) = sweep.axis {
            joint.axis = axis;
        }
        let step = (sweep.to - sweep.from) / (angles.len() - 1) as f64;
        let frames = sweep.frames.max(1) as usize;
        let joints = motion::moved(&scene, (&joint, &turning), &angles)?;
        let course = Course::of_joint(&joints, turning, (&angles, step), frames);
        let fibres = (sweep.fibres, sweep.by);
        let (simulation, muscles, left_out) = started(scene, &sweep.joint, &course, fibres)?;
        Ok(Self::begin(
            simulation,
            muscles,
            left_out,
            (angles, step, joint),
            course,
        ))
    }

    /// Prepares a scene that a model of OpenSim moves: it passes through poses, each with the values
    /// of all coordinates of the model \[rad or m\]. Every vertex takes part in the displacement of
    /// each joint by a share, as with [`MuscleStepper::Spread`].
    ///
    /// # Errors
    /// A scene without a model, no muscle over its joints, no fibres, or a scene that cannot run.
    pub fn through(
        scene: Scene,
        poses: &[Vec<f64>],
        fibres: harmonic::HarmonicOptions,
    ) -> Result<Self, SweepError> {
        let Some(drive) = scene.opensim.clone() else {
            return Err(SweepError::NoModel);
        };
        let course = Course::of_poses(&drive, poses);
        let joint = course.shown(drive.place(0));
        let fibres = (fibres, MuscleStepper::Spread);
        let name = drive.joint_name(0).to_owned();
        let (simulation, muscles, left_out) = started(scene, &name, &course, fibres)?;
        let indices = (0..poses.len()).map(|k| k as f64).collect();
        Ok(Self::begin(
            simulation,
            muscles,
            left_out,
            (indices, 1.0, joint),
            course,
        ))
    }

    fn begin(
        simulation: Simulation,
        muscles: Vec<CrossingMuscle>,
        left_out: Vec<String>,
        (angles, step, joint): (Vec<f64>, f64, Joint),
        course: Course,
    ) -> Self {
        let mut running = Self {
            simulation,
            muscles,
            left_out,
            angles,
            step,
            joint,
            course,
            done: 0,
        };
        // A sweep that begins where the meshes are reaches its first value without a frame.
        running.record_reached();
        running
    }

    /// Number of values that are computed.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Displacement of the first joint at a value [m].
    pub fn displacement(&self, value: usize) -> Isometry3<f64> {
        self.course.frames[self.course.values[value]][0]
    }

    /// Records the value of the angle that the last frame has reached, if it has.
    fn record_reached(&mut self) {
        if self.course.values.get(self.done) == Some(&self.simulation.frame()) {
            self.record();
            self.done += 1;
        }
    }

    /// Sets the shapes that the muscles track in the next frame.
    fn aim(&mut self) {
        let frame = (self.simulation.frame() + 1).min(self.course.frames.len() - 1);
        let displacements = &self.course.frames[frame];
        for (muscle, body) in self.muscles.iter().zip(&mut self.simulation.bodies) {
            if let Stepper::Tracked(tracked) = &mut body.method {
                let mut shape = body.rest.vertices.clone();
                // The joint farthest from the resting bodies moves first.
                for (by, shares) in displacements.iter().zip(&muscle.joint_weights).rev() {
                    shape
                        .iter_mut()
                        .zip(shares)
                        .for_each(|(x, share)| *x = screw_part(by, *share) * *x);
                }
                tracked.aim(shape);
            }
        }
    }

    /// Carries the fibres along with the muscles and measures them.
    fn record(&mut self) {
        let simulation = &self.simulation;
        let measures = simulation.measure();
        let bones: Vec<audit::AuditedBone<'_>> = (simulation.bones.iter().enumerate())
            .map(|(b, mesh)| audit::AuditedBone::new(mesh, simulation.surface(b)))
            .collect();
        let frame = simulation.frame() as f64;
        let posed: Vec<(&audit::AuditedBone<'_>, Isometry3<f64>)> = bones
            .iter()
            .enumerate()
            .map(|(b, bone)| (bone, simulation.pose(b, frame)))
            .collect();
        for ((muscle, body), measures) in self
            .muscles
            .iter_mut()
            .zip(&simulation.bodies)
            .zip(measures)
        {
            muscle.stopped = body.stopped.clone();
            if muscle.stopped.is_some() {
                continue;
            }
            muscle.now = muscle.bound.at(&body.system.particles.position);
            muscle
                .lengths
                .push(muscle.now.iter().map(|f| length(f)).collect());
            muscle.chords.push(chords::mean_length(&muscle.now));
            let bones = (0..simulation.bones.len())
                .map(|b| (simulation.surface(b), simulation.pose(b, frame)));
            muscle.clear.push(chords::share_clear(&muscle.now, bones));
            let between = muscle.now.iter().flat_map(|f| &f[1..f.len() - 1]).copied();
            let inside = audit::examine(&between.collect::<Vec<_>>(), &[], &|_| true, &posed);
            muscle.points_in_bone += inside.vertices_inside;
            muscle.depth = max_or_nan([muscle.depth, inside.depth]);
            muscle.vertex_depth = max_or_nan([muscle.vertex_depth, measures.penetration_m]);
            muscle.unconverged += usize::from(!measures.converged);
            muscle.volume_error = max_or_nan([muscle.volume_error, measures.volume_error.abs()]);
        }
    }
}

/// A scene that follows a course, with the muscles that cross a joint of it and the names of the
/// others.
fn started(
    mut scene: Scene,
    joint: &str,
    course: &Course,
    (fibres, by): (harmonic::HarmonicOptions, MuscleStepper),
) -> Result<(Simulation, Vec<CrossingMuscle>, Vec<String>), SweepError> {
    course.write(&mut scene);
    let crosses = |m: usize, beyond: &[bool]| {
        let attachments = &scene.muscles[m].attachments;
        attachments.iter().any(|a| beyond[a.bone]) && attachments.iter().any(|a| !beyond[a.bone])
    };
    // The first joint that each muscle crosses.
    let crossed: Vec<Option<usize>> = (0..scene.muscles.len())
        .map(|m| course.beyond.iter().position(|beyond| crosses(m, beyond)))
        .collect();
    if crossed.iter().all(Option::is_none) {
        return Err(SweepError::NothingCrosses(joint.to_owned()));
    }
    // A moment arm is that of the passive muscle, and the frames of a sweep are not those of the scene.
    scene.effects.tone = None;
    for muscle in &mut scene.muscles {
        muscle.activation.clear();
        muscle.fibre_count = None;
    }
    if by == MuscleStepper::Spread {
        // One step per frame; the muscles over the joint have their own solver.
        scene.solver = Solver::QuasiStatic(CORRECTION);
        hold_all(&mut scene);
    }
    let mut simulation = Simulation::new(scene)?;
    let all = simulation.scene.muscles.iter().zip(&crossed);
    let left_out = all
        .filter(|(_, c)| c.is_none())
        .map(|(m, _)| m.name.clone());
    let left_out = left_out.collect();
    let mut keep = crossed.iter();
    simulation
        .bodies
        .retain(|_| keep.next().is_some_and(Option::is_some));
    let over = simulation.bodies.iter().zip(crossed.iter().flatten());
    let muscles = over.map(|(body, joint)| cross(body, &course.beyond[*joint], fibres));
    let mut muscles = muscles.collect::<Result<Vec<_>, _>>()?;
    if by == MuscleStepper::Spread {
        let placed = simulation.placed().to_vec();
        let bones = smooth_bones(&simulation);
        let near = course
            .moves
            .iter()
            .map(|moves| near_bones(&simulation, moves));
        let near: Vec<Vec<Vec<Distances>>> = near.collect();
        for (m, (muscle, body)) in muscles.iter_mut().zip(&mut simulation.bodies).enumerate() {
            let joints = course.moves.iter().zip(&near);
            let weights = joints.map(|(moves, near)| weights(body, &near[m], moves));
            muscle.joint_weights = weights.collect::<Result<_, _>>()?;
            track(body, &bones, &placed)?;
        }
    }
    Ok((simulation, muscles, left_out))
}

/// Attaches muscles by the whole of the patches that a scene names. Limits of a scene leave enough
/// of a muscle free to deform; here fibres begin at the attachment, and a part of the true origin
/// has other moment arms.
fn hold_all(scene: &mut Scene) {
    scene.most_held = 1.0;
    let all = scene.muscles.iter_mut().flat_map(|m| &mut m.attachments);
    all.filter(|a| matches!(a.area, AreaSpec::Patch { .. }))
        .for_each(|a| a.limit = 1.0);
}

/// Distances of all vertices of all muscles from resting and from turning bones, in the given pose.
fn near_bones(simulation: &Simulation, turning: &[bool]) -> Vec<Vec<Distances>> {
    let bone = |b: usize| (simulation.surface(b) as &dyn Obstacle, turning[b]);
    let bones: Vec<_> = (0..simulation.bones.len()).map(bone).collect();
    simulation
        .bodies
        .iter()
        .map(|body| distances(&body.rest, &bones))
        .collect()
}

/// Smoothed distances to all obstacles; empty for a scene without contact.
fn smooth_bones(simulation: &Simulation) -> Vec<Arc<SmoothDistance>> {
    let Some(contact) = simulation.scene.effects.contact else {
        return Vec::new();
    };
    let of = |(o, placed): (usize, &PosedObstacle)| {
        let edge = simulation
            .bones
            .get(o)
            .and_then(|mesh| mesh.median_edge_length(&Topology::new(mesh)));
        let thinnest = placed.obstacle.bounding_box().extents().amin();
        let spacing = edge.map_or(ROUND * thinnest, |edge| FINENESS * edge);
        Arc::new(SmoothDistance::new(
            &*placed.obstacle,
            spacing,
            tracked::REACH * contact.thickness,
        ))
    };
    simulation.placed().iter().enumerate().map(of).collect()
}

/// Makes a muscle track a prescribed shape.
fn track(
    body: &mut Body,
    bones: &[Arc<SmoothDistance>],
    placed: &[PosedObstacle],
) -> Result<(), SweepError> {
    let settings = DescentSettings {
        tolerance: CORRECTION.tolerance,
        iterations: CORRECTION.iterations,
    };
    let parts = TrackedParts {
        edges: &body.edges,
        stiffness: vec![1.0; body.edges.len()],
        tracking: TRACKING,
        bones,
    };
    let made = Tracked::new(parts, &body.system, placed, settings);
    let made = made.map_err(|error| SweepError::Factor {
        muscle: body.name.clone(),
        error,
    })?;
    body.method = Stepper::Tracked(Box::new(made));
    Ok(())
}

/// Share of each vertex of a muscle in the displacement of a joint.
fn weights(body: &Body, near: &[Distances], moves: &[bool]) -> Result<Vec<f64>, SweepError> {
    let share = |bone: usize| if moves[bone] { 1.0 } else { 0.0 };
    let held: Vec<(u32, f64)> = body.attached.iter().map(|&(v, b)| (v, share(b))).collect();
    // A muscle that does not cross the joint follows it, or rests, as a whole.
    if let Some(&(_, one)) = held.first()
        && held.iter().all(|(_, share)| *share == one)
    {
        return Ok(vec![one; body.rest.vertices.len()]);
    }
    joint_weights(&body.rest, &Topology::new(&body.rest), near, &held).map_err(|error| {
        SweepError::Factor {
            muscle: body.name.clone(),
            error,
        }
    })
}

/// Fibres of a muscle from its attachment to resting bones to its attachment to turning bones.
fn cross(
    body: &Body,
    turning: &[bool],
    options: harmonic::HarmonicOptions,
) -> Result<CrossingMuscle, SweepError> {
    let muscle = body.name.clone();
    if body.rest.triangles.is_empty() || !Topology::new(&body.rest).is_closed() {
        return Err(SweepError::Open(muscle));
    }
    let held = |on: bool| {
        body.attached
            .iter()
            .filter(move |a| turning[a.1] == on)
            .map(|a| a.0)
            .collect::<Vec<u32>>()
    };
    let [origin, insertion] = [held(false), held(true)];
    let areas = Attachment::new(
        &body.rest,
        AreaSource::Vertices(&origin),
        AreaSource::Vertices(&insertion),
    );
    let areas = areas.map_err(|error| SweepError::Areas {
        muscle: muscle.clone(),
        error,
    })?;
    let found = decompose(&body.rest, &areas, options);
    let found = found.map_err(|error| SweepError::Fibres {
        muscle: muscle.clone(),
        error,
    })?;
    let jacobian = found.jacobian(&body.rest, &areas);
    let quality = quality::measure(&body.rest, &found.closed, &areas, &found.fibres, jacobian);
    Ok(CrossingMuscle {
        name: muscle,
        physiological_area: body.rest.volume() / quality.length_mean_m,
        quality,
        lengths: Vec::new(),
        chords: Vec::new(),
        clear: Vec::new(),
        points_in_bone: 0,
        depth: 0.0,
        vertex_depth: 0.0,
        volume_error: 0.0,
        unconverged: 0,
        stopped: None,
        joint_weights: Vec::new(),
        bound: BoundVolume::new(&body.rest, &found.fibres),
        now: found.fibres.clone(),
        fibres: found.fibres,
    })
}
