//! What a window shows of whatever runs: a frame of it, made by its thread and never changed again.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

use super::panel::Control;
use pliant::fibres::binding::BoundLines;
use pliant::mesh::TriangleMesh;
use pliant::scene::Scene;

/// What a body is made of: how it is drawn where no field colours it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tissue {
    /// A muscle.
    Muscle,
    /// Skin.
    Skin,
    /// An implant.
    Implant,
    /// A bone or another obstacle that is not at a pose.
    Bone,
    /// A body of no tissue in particular.
    Plain,
}

/// What stays the same as long as surfaces keep their triangles.
#[derive(Clone, Debug, Default)]
pub struct Stage {
    /// What deforms.
    pub bodies: Vec<StageBody>,
    /// Name and surface of each bone, in its own frame [m].
    pub bones: Vec<(String, TriangleMesh)>,
}

/// What stays the same of a body.
#[derive(Clone, Debug)]
pub struct StageBody {
    /// Its name.
    pub name: String,
    /// What it is made of.
    pub tissue: Tissue,
    /// Its triangles; none for a body of edges alone.
    pub triangles: Vec<[u32; 3]>,
    /// Its edges.
    pub edges: Vec<[u32; 2]>,
    /// The vertices that something holds.
    pub held: Vec<u32>,
    /// Fibres that follow it.
    pub fibres: BoundLines,
}

/// One moment of a session.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Rises by one from each to the next.
    pub serial: u64,
    /// Commands that were answered so far: the number that [`super::Session::send`] gave to the last of them.
    pub answered: u64,
    /// Whether frames follow by themselves.
    pub running: bool,
    /// How fast they follow.
    pub speed: super::Speed,
    /// Why the last command that was refused was, with its number.
    pub refused: Option<(u64, String)>,
    /// Why it cannot go on, until it is reset.
    pub failed: Option<String>,
    /// Time of the last frame [ms].
    pub frame_ms: f64,
    /// Frames a second, over those of the last moments; 0 before two frames.
    pub frames_per_second: f64,
    /// What is seen.
    pub view: Shot,
}

impl std::ops::Deref for Snapshot {
    type Target = Shot;

    fn deref(&self) -> &Shot {
        &self.view
    }
}

/// What is seen of a subject at one moment.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The last frame that was computed; 0 is the start.
    pub frame: usize,
    /// The frame at which the scene ends; a session may go beyond it.
    pub last_frame: usize,
    /// What belongs to the numbers below: another one when surfaces get other triangles.
    pub stage: Arc<Stage>,
    /// The scene of muscles with the changes so far; `None` of anything else.
    pub scene: Option<Arc<Scene>>,
    /// What can be changed.
    pub controls: Arc<Vec<Control>>,
    /// What deforms, as on the stage.
    pub bodies: Vec<BodyShot>,
    /// Bones, as on the stage.
    pub bones: Vec<BoneShot>,
    /// Points that can be moved.
    pub handles: Vec<Handle>,
    /// Numbers worth a plot.
    pub readings: Vec<Reading>,
    /// The vertex that was asked for.
    pub probe: Option<Probe>,
    /// Time of each effect in the last frame [ms].
    pub effects: Vec<(&'static str, f64)>,
    /// Notes of reading and of running, for people.
    pub notes: Vec<String>,
}

/// A body at one moment. Lists have an entry for each vertex, or none where the body has no such field.
#[derive(Clone, Debug, Default)]
pub struct BodyShot {
    /// Positions [m].
    pub positions: Vec<Point3<f64>>,
    /// Mean absolute strain of the edges that meet there.
    pub stretch: Vec<f64>,
    /// Depth in the bones [m], 0 outside.
    pub depth: Vec<f64>,
    /// Speed [m/s].
    pub speed: Vec<f64>,
    /// Volume over its target, less 1; 0 where no volume is kept.
    pub volume_error: f64,
    /// Vertices that touch an obstacle.
    pub touching: Vec<u32>,
    /// Vertices that somebody fixed.
    pub fixed: Vec<u32>,
    /// The vertex that is dragged, and where to [m].
    pub dragged: Option<(u32, Point3<f64>)>,
    /// The frame at which it was stopped, and why.
    pub stopped: Option<(usize, String)>,
}

/// A bone at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneShot {
    /// Maps its own frame [m] to the world [m].
    pub pose: Isometry3<f64>,
    /// The angle about its joint [rad], in -pi..pi; `None` without a joint.
    pub angle: Option<f64>,
    /// What moves it.
    pub steering: Steering,
}

/// What moves a bone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Steering {
    /// The scene's motion.
    #[default]
    Motion,
    /// The hand.
    Hand,
    /// It is on its way from where the hand left it to where its motion is.
    Return,
}

/// A point that can be moved: an implant, a node.
#[derive(Clone, Debug, PartialEq)]
pub struct Handle {
    /// What it moves.
    pub name: String,
    /// Where it is [m].
    pub at: Point3<f64>,
}

/// A number of one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// What it is: those of one name share a plot.
    pub name: &'static str,
    /// Of which body; empty where there is but one.
    pub of: String,
    /// Its unit; empty for none.
    pub unit: &'static str,
    /// The number, in that unit.
    pub value: f64,
}

/// What is known of one vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Which body.
    pub body: usize,
    /// Which vertex.
    pub vertex: usize,
    /// Name, value and unit of each number.
    pub values: Vec<(&'static str, f64, &'static str)>,
}
