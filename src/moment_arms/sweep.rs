//! A joint turned through a range of angles while the muscles over it follow, and their fibres with them.

mod scenario;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use crate::contact::smooth::SmoothDistance;
use crate::contact::{Obstacle, Placed};
use crate::fibres::attachment::{AreaSource, Attachment, AttachmentError};
use crate::fibres::carry::BoundVolume;
use crate::fibres::harmonic::{self, DecompositionError, decompose};
use crate::fibres::polyline::length;
use crate::fibres::quality::{self, Quality};
use crate::mesh::Topology;
use crate::mesh::measures::greatest;
use crate::moment_arms::shares::{Distances, distances, shares};
use crate::scene::{Area, Joint, Key, Minimisation, Motion, Scene, Solver};
use crate::simulation::tracked::{self, Parts, Tracked};
use crate::simulation::{Body, LoadError, Simulation, audit};
use crate::solvers::Broken;
use crate::solvers::descent::Settings;
use crate::solvers::sparse::FactorError;

/// Most values of the angle in one sweep.
pub const MOST_VALUES: usize = 10_000;
/// Widest turn \[rad\]: beyond half a turn no joint goes.
pub const WIDEST: f64 = std::f64::consts::PI;

/// How the correction of a spread turn is solved for.
const CORRECTION: Minimisation = Minimisation {
    substeps: 1,
    iterations: 100,
    tolerance: 1e-8,
};

/// Stiffness with which a muscle tracks the spread turn, as a share of that with which its edges resist strain at rest:
/// neither is known better than the other, and nothing is fitted.
const TRACKING: f64 = 1.0;

/// Distance between samples of the distance to a bone, over the bone's median edge: finer than its triangles it is not known,
/// and coarser its edges would be rounded by more than a tenth of a contact thickness.
const FINENESS: f64 = 0.5;

/// The same of a capsule, over its diameter: it departs from the distance by a thousandth of that.
const ROUND: f64 = 0.04;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Name of the joint, or of a bone that turns about one.
    pub joint: String,
    /// Axis to turn about instead of the joint's.
    pub axis: Option<Unit<Vector3<f64>>>,
    /// First angle \[rad\]; 0 is where the meshes are.
    pub from: f64,
    /// Last angle \[rad\].
    pub to: f64,
    /// Angle between two values \[rad\]; made a little smaller where the range is no multiple of it.
    pub step: f64,
    /// Frames from one value to the next.
    pub frames: u32,
    /// Fibres of each muscle.
    pub fibres: harmonic::Options,
    /// What moves the muscles.
    pub by: By,
}

/// What moves the muscles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum By {
    /// Every vertex turns about the joint by a share of its angle, which spreads over the muscle from 0 where it is held
    /// by what rests to 1 where it is held by what turns ([`super::shares`]); from there tone, bones and volume bring it to
    /// rest. There is one such shape for every angle, and it moves smoothly.
    #[default]
    Spread,
    /// The scene's solver.
    Scene,
}

/// Why there is no sweep.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The range is empty or too wide, or the step is.
    #[error("{0}")]
    Range(String),
    /// No bone has it.
    #[error("the scene has no joint `{name}`; {known}")]
    NoJoint {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// Nothing crosses the joint.
    #[error(
        "no muscle is held on both sides of the joint `{0}`: one end on a bone that turns, the other on one that rests"
    )]
    NothingCrosses(String),
    /// A muscle that encloses nothing.
    #[error(
        "muscle `{0}` is not closed, so it has no inside for fibres; `repair = true` and `close_holes` mend it"
    )]
    Open(String),
    /// Areas are of no use.
    #[error("muscle `{muscle}`: {error}")]
    Areas {
        /// Its name.
        muscle: String,
        /// Why.
        error: AttachmentError,
    },
    /// The correction cannot be solved for.
    #[error("muscle `{muscle}`: {error}")]
    Factor {
        /// Its name.
        muscle: String,
        /// Why.
        error: FactorError,
    },
    /// No fibres were found.
    #[error("muscle `{muscle}`: {error}")]
    Fibres {
        /// Its name.
        muscle: String,
        /// Why.
        error: DecompositionError,
    },
    /// The scene cannot run.
    #[error(transparent)]
    Load(#[from] LoadError),
}

/// A muscle that crosses the joint, and what is known of it so far.
#[derive(Debug)]
pub struct Crossing {
    /// Its name.
    pub name: String,
    /// Fibres at rest, from the bones that rest to those that turn [m].
    pub fibres: Vec<Vec<Point3<f64>>>,
    /// How good they are at rest.
    pub quality: Quality,
    /// Volume over mean length of the fibres at rest [m2].
    pub physiological_area: f64,
    /// For each value of the angle the length of each fibre [m].
    pub lengths: Vec<Vec<f64>>,
    /// For each value of the angle the mean over the fibres of the straight line between their ends [m].
    pub chords: Vec<f64>,
    /// Points of fibres between their ends that were deeper than [`audit::DEPTH`] in a bone, over all values.
    pub points_in_bone: usize,
    /// Greatest depth of such a point [m].
    pub depth: f64,
    /// Greatest depth of a free vertex in a bone [m].
    pub vertex_depth: f64,
    /// Greatest departure of the volume from that at rest, as a share of it.
    pub volume_error: f64,
    /// Values at which forces, volume or depth were not within their tolerances.
    pub unconverged: usize,
    /// The frame at which it was stopped, and why.
    pub stopped: Option<(usize, Broken)>,
    /// Angle of each vertex over that of the joint; empty where the scene's solver moves it.
    shares: Vec<f64>,
    bound: BoundVolume,
    now: Vec<Vec<Point3<f64>>>,
}

impl Crossing {
    /// The fibres at the last value [m].
    pub fn now(&self) -> &[Vec<Point3<f64>>] {
        &self.now
    }
}

/// A sweep that runs.
pub struct Running {
    /// The scene, with the sweep as motion.
    pub simulation: Simulation,
    /// Muscles that cross the joint, as `simulation.bodies`.
    pub muscles: Vec<Crossing>,
    /// Muscles that do not cross the joint.
    pub left_out: Vec<String>,
    /// All values of the angle \[rad\].
    pub angles: Vec<f64>,
    /// Angle between two values \[rad\].
    pub step: f64,
    /// The joint's centre [m] and axis.
    pub joint: Joint,
    frames: usize,
    first: usize,
    done: usize,
}

impl Running {
    /// Makes a scene ready: its joint turns from where the meshes are to the first angle, rests, and turns on.
    ///
    /// # Errors
    /// A range that is none, no such joint, nothing that crosses it, no fibres, or a scene that cannot run.
    pub fn new(mut scene: Scene, sweep: &Sweep) -> Result<Self, SweepError> {
        let angles = angles(sweep)?;
        let (mut joint, turning) = joint(&scene, &sweep.joint)?;
        if let Some(axis) = sweep.axis {
            joint.axis = axis;
        }
        let step = (sweep.to - sweep.from) / (angles.len() - 1) as f64;
        let frames = sweep.frames.max(1) as usize;
        let first = prepare(&mut scene, &turning, &joint, &angles, step, frames);
        let crosses = |m: usize, scene: &Scene| {
            let attachments = &scene.muscles[m].attachments;
            attachments.iter().any(|a| turning[a.bone])
                && attachments.iter().any(|a| !turning[a.bone])
        };
        let crossing: Vec<bool> = (0..scene.muscles.len())
            .map(|m| crosses(m, &scene))
            .collect();
        if !crossing.contains(&true) {
            return Err(SweepError::NothingCrosses(sweep.joint.clone()));
        }
        if sweep.by == By::Spread {
            // One step a frame; the muscles that cross the joint have a solver of their own.
            scene.solver = Solver::QuasiStatic(CORRECTION);
            hold_all(&mut scene);
        }
        let mut simulation = Simulation::new(scene)?;
        let names = |wanted: bool| {
            let named = crossing
                .iter()
                .zip(&simulation.scene.muscles)
                .filter(move |(c, _)| **c == wanted);
            named.map(|(_, m)| m.name.clone()).collect::<Vec<_>>()
        };
        let left_out = names(false);
        let mut keep = crossing.iter();
        simulation.bodies.retain(|_| keep.next() == Some(&true));
        let muscles = simulation
            .bodies
            .iter()
            .map(|body| cross(body, &turning, sweep.fibres));
        let mut muscles = muscles.collect::<Result<Vec<_>, _>>()?;
        if sweep.by == By::Spread {
            let near = near_bones(&simulation, &turning);
            let placed = simulation.placed().to_vec();
            let bones = smooth_bones(&simulation);
            for ((muscle, body), near) in muscles.iter_mut().zip(&mut simulation.bodies).zip(near) {
                muscle.shares = track(body, (&near, &bones), &placed, &turning)?;
            }
        }
        let mut running = Self {
            simulation,
            muscles,
            left_out,
            angles,
            step,
            joint,
            frames,
            first,
            done: 0,
        };
        // A sweep that begins where the meshes are reaches its first value without a frame.
        running.record_reached();
        Ok(running)
    }

    /// Values that are done.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Records the value of the angle that the last frame has reached, if it has.
    fn record_reached(&mut self) {
        if self.simulation.frame() == self.first + self.done * self.frames {
            self.record();
            self.done += 1;
        }
    }

    /// Tells the muscles where the joint's angle of the next frame alone would carry them.
    fn aim(&mut self) {
        let angle = self.angle(self.simulation.frame() + 1);
        for (muscle, body) in self.muscles.iter().zip(&mut self.simulation.bodies) {
            let turned = |(x, share): (&Point3<f64>, &f64)| self.joint.pose(angle * share) * x;
            if let Some(tracked) = &mut body.tracked {
                tracked.aim(
                    body.rest
                        .vertices
                        .iter()
                        .zip(&muscle.shares)
                        .map(turned)
                        .collect(),
                );
            }
        }
    }

    /// The joint's angle at a frame \[rad\].
    fn angle(&self, frame: usize) -> f64 {
        match frame.checked_sub(self.first) {
            None => self.angles[0] * frame as f64 / self.first as f64,
            Some(after) => (self.angles[0] + self.step / self.frames as f64 * after as f64)
                .min(self.angles[self.angles.len() - 1]),
        }
    }

    /// Carries the fibres to where the muscles are, and measures.
    fn record(&mut self) {
        let simulation = &self.simulation;
        let measures = simulation.measure();
        let bones: Vec<audit::Bone<'_>> = (simulation.bones.iter().enumerate())
            .map(|(b, mesh)| audit::Bone::new(mesh, simulation.surface(b)))
            .collect();
        let frame = simulation.frame() as f64;
        let posed: Vec<(&audit::Bone<'_>, Isometry3<f64>)> = bones
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
            let chords = muscle.now.iter().map(|f| (f[f.len() - 1] - f[0]).norm());
            muscle
                .chords
                .push(chords.sum::<f64>() / muscle.now.len() as f64);
            let between = muscle.now.iter().flat_map(|f| &f[1..f.len() - 1]).copied();
            let inside = audit::examine(&between.collect::<Vec<_>>(), &[], &|_| true, &posed);
            muscle.points_in_bone += inside.vertices_inside;
            muscle.depth = greatest([muscle.depth, inside.depth]);
            muscle.vertex_depth = greatest([muscle.vertex_depth, measures.penetration_m]);
            muscle.unconverged += usize::from(!measures.converged);
            muscle.volume_error = greatest([muscle.volume_error, measures.volume_error.abs()]);
        }
    }
}

/// The values, evenly apart.
fn angles(sweep: &Sweep) -> Result<Vec<f64>, SweepError> {
    let Sweep { from, to, step, .. } = *sweep;
    let refuse = |text: String| Err(SweepError::Range(text));
    let degrees = |angle: f64| crate::format::number(angle.to_degrees());
    if !(from < to) {
        return refuse(format!(
            "from {} to {} degrees is no range; --from must be below --to",
            degrees(from),
            degrees(to)
        ));
    }
    if !(from >= -WIDEST && to <= WIDEST) {
        return refuse(
            "a joint turns by at most 180 degrees either way; choose --from and --to within that"
                .to_owned(),
        );
    }
    if !(step > 0.0) || (to - from) / step > MOST_VALUES as f64 {
        return refuse(format!(
            "a step of {} degrees makes no or too many values; choose another --step",
            degrees(step)
        ));
    }
    // A range that is a multiple of the step but for rounding has as many.
    let count = ((to - from) / step - 1e-9).ceil().max(1.0) as usize;
    if count < 2 {
        return refuse(
            "a moment arm needs at least 3 values of the angle; choose a smaller --step".to_owned(),
        );
    }
    Ok((0..=count)
        .map(|k| from + (to - from) * (k as f64 / count as f64))
        .collect())
}

/// The joint of that name, or of a bone of that name, and which bones turn about it.
fn joint(scene: &Scene, name: &str) -> Result<(Joint, Vec<bool>), SweepError> {
    let joints = scene.bones.iter().map(|b| b.motion.joint.as_ref());
    let named = joints
        .clone()
        .flatten()
        .find(|j| j.name.as_deref() == Some(name));
    if let Some(found) = named {
        let turning = joints
            .map(|j| j.is_some_and(|j| j.name.as_deref() == Some(name)))
            .collect();
        return Ok((found.clone(), turning));
    }
    let of_bone = scene
        .bones
        .iter()
        .position(|b| b.name == name && b.motion.joint.is_some());
    if let Some((b, found)) = of_bone.and_then(|b| Some((b, scene.bones[b].motion.joint.clone()?)))
    {
        return Ok((found, (0..scene.bones.len()).map(|k| k == b).collect()));
    }
    let mut known: Vec<String> = Vec::new();
    for bone in &scene.bones {
        if let Some(joint) = &bone.motion.joint {
            let text = joint.name.as_ref().unwrap_or(&bone.name);
            if !known.contains(text) {
                known.push(text.clone());
            }
        }
    }
    let known = match known.is_empty() {
        true => "no bone has a motion with `centre` and `axis`, which make a joint".to_owned(),
        false => format!("known: {}", known.join(", ")),
    };
    Err(SweepError::NoJoint {
        name: name.to_owned(),
        known,
    })
}

/// Writes the sweep into the scene's motions; the frame of the first value.
fn prepare(
    scene: &mut Scene,
    turning: &[bool],
    joint: &Joint,
    angles: &[f64],
    step: f64,
    frames: usize,
) -> usize {
    let mut keys = vec![Key {
        frame: 0.0,
        pose: Isometry3::identity(),
    }];
    let mut frame = 0usize;
    let from = angles[0];
    if from != 0.0 {
        let count = (from.abs() / step).ceil().max(1.0);
        for k in 1..=count as usize {
            frame += frames;
            keys.push(Key {
                frame: frame as f64,
                pose: joint.pose(from * k as f64 / count),
            });
        }
    }
    let first = frame;
    for &angle in &angles[1..] {
        frame += frames;
        keys.push(Key {
            frame: frame as f64,
            pose: joint.pose(angle),
        });
    }
    for (bone, turns) in scene.bones.iter_mut().zip(turning) {
        let keys = if *turns { keys.clone() } else { Vec::new() };
        bone.motion = Motion {
            keys,
            joint: bone.motion.joint.take(),
        };
    }
    scene.frames = frame;
    first
}

/// Holds muscles by the whole of the patches that a scene names: limits are there to leave enough that deforms, but here
/// fibres begin where a muscle is held, and a part of the true origin has other moment arms.
fn hold_all(scene: &mut Scene) {
    scene.most_held = 1.0;
    let all = scene.muscles.iter_mut().flat_map(|m| &mut m.attachments);
    all.filter(|a| matches!(a.area, Area::Patch { .. }))
        .for_each(|a| a.limit = 1.0);
}

/// How far all vertices of all muscles are from bones that rest and that turn, where the meshes are.
fn near_bones(simulation: &Simulation, turning: &[bool]) -> Vec<Vec<Distances>> {
    let bone = |b: usize| (simulation.surface(b) as &dyn Obstacle, turning[b]);
    let bones: Vec<_> = (0..simulation.bones.len()).map(bone).collect();
    simulation
        .bodies
        .iter()
        .map(|body| distances(&body.rest, &bones))
        .collect()
}

/// Smoothed distances to all obstacles; none where a scene has no contact.
fn smooth_bones(simulation: &Simulation) -> Vec<Arc<SmoothDistance>> {
    let Some(contact) = simulation.scene.effects.contact else {
        return Vec::new();
    };
    let of = |(o, placed): (usize, &Placed)| {
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

/// Makes a muscle track a prescribed shape; the share of the joint's angle of each vertex.
fn track(
    body: &mut Body,
    (near, bones): (&[Distances], &[Arc<SmoothDistance>]),
    placed: &[Placed],
    turning: &[bool],
) -> Result<Vec<f64>, SweepError> {
    let settings = Settings {
        tolerance: CORRECTION.tolerance,
        iterations: CORRECTION.iterations,
    };
    let failed = |error| SweepError::Factor {
        muscle: body.name.clone(),
        error,
    };
    let parts = Parts {
        edges: &body.edges,
        stiffness: vec![1.0; body.edges.len()],
        tracking: TRACKING,
        bones,
    };
    let made = Tracked::new(parts, &body.system, placed, settings).map_err(failed)?;
    let held: Vec<(u32, f64)> = body
        .attached
        .iter()
        .map(|&(v, b)| (v, if turning[b] { 1.0 } else { 0.0 }))
        .collect();
    let shares = shares(&body.rest, &Topology::new(&body.rest), near, &held).map_err(failed)?;
    body.tracked = Some(made);
    body.equilibrium = None;
    Ok(shares)
}

/// Fibres of a muscle from where it is held by what rests to where by what turns.
fn cross(
    body: &Body,
    turning: &[bool],
    options: harmonic::Options,
) -> Result<Crossing, SweepError> {
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
    Ok(Crossing {
        name: muscle,
        physiological_area: body.rest.volume() / quality.length_mean_m,
        quality,
        lengths: Vec::new(),
        chords: Vec::new(),
        points_in_bone: 0,
        depth: 0.0,
        vertex_depth: 0.0,
        volume_error: 0.0,
        unconverged: 0,
        stopped: None,
        shares: Vec::new(),
        bound: BoundVolume::new(&body.rest, &found.fibres),
        now: found.fibres.clone(),
        fibres: found.fibres,
    })
}
