//! The displayed state of a session: one frame, created by its thread and immutable.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

use super::panel::Control;
use pliant::fibres::BoundLines;
use pliant::mesh::TriangleMesh;
use pliant::scene::Scene;

/// Material of a body, which decides on its colour without a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tissue {
    /// A muscle.
    Muscle,
    /// Skin.
    Skin,
    /// An implant.
    Implant,
    /// A bone or another obstacle without a pose.
    Bone,
    /// Any other body.
    Plain,
}

/// Data that are constant while surfaces keep their triangles.
#[derive(Clone, Debug, Default)]
pub struct Stage {
    /// Deformable bodies.
    pub bodies: Vec<StageBody>,
    /// Name and surface of each bone, in its own frame [m].
    pub bones: Vec<(String, TriangleMesh)>,
}

/// Constant data of a body.
#[derive(Clone, Debug)]
pub struct StageBody {
    /// Name of the body.
    pub name: String,
    /// Material of the body.
    pub tissue: Tissue,
    /// Triangles; empty for a body of edges alone.
    pub triangles: Vec<[u32; 3]>,
    /// Edges.
    pub edges: Vec<[u32; 2]>,
    /// Fixed vertices.
    pub held: Vec<u32>,
    /// Fibres bound to the body.
    pub fibres: BoundLines,
}

/// One moment of a session.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Serial number, increased by one for each snapshot.
    pub serial: u64,
    /// The number of the last answered command, as returned by [`super::Session::send`].
    pub answered: u64,
    /// True if frames follow automatically.
    pub running: bool,
    /// Rate of frames.
    pub speed: super::Speed,
    /// Number of the last rejected command, and the reason.
    pub refused: Option<(u64, String)>,
    /// The reason why the subject cannot continue until a reset.
    pub failed: Option<String>,
    /// Time of the last frame [ms].
    pub frame_ms: f64,
    /// Frames per second over the last moments; 0 before two frames.
    pub frames_per_second: f64,
    /// Visible state.
    pub view: Shot,
}

impl std::ops::Deref for Snapshot {
    type Target = Shot;

    fn deref(&self) -> &Shot {
        &self.view
    }
}

/// Visible state of a subject at one moment.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The last computed frame; 0 is the start.
    pub frame: usize,
    /// The last frame of the scene; a session can continue after it.
    pub last_frame: usize,
    /// Constant data of the bodies; replaced when surfaces get other triangles.
    pub stage: Arc<Stage>,
    /// The scene of muscles with the changes so far; `None` for other subjects.
    pub scene: Option<Arc<Scene>>,
    /// Controls.
    pub controls: Arc<Vec<Control>>,
    /// Deformable bodies, in the order of the stage.
    pub bodies: Vec<BodyShot>,
    /// Bones, in the order of the stage.
    pub bones: Vec<BoneShot>,
    /// Points that the user can move.
    pub handles: Vec<Handle>,
    /// Values for plots.
    pub readings: Vec<Reading>,
    /// Measures of the selected vertex.
    pub probe: Option<Probe>,
    /// Time of each effect in the last frame [ms].
    pub effects: Vec<(&'static str, f64)>,
    /// Notes from reading and from the run.
    pub notes: Vec<String>,
}

/// A body at one moment. Lists have an entry for each vertex, or are empty if the body has no such
/// field.
#[derive(Clone, Debug, Default)]
pub struct BodyShot {
    /// Positions [m].
    pub positions: Vec<Point3<f64>>,
    /// Mean absolute strain of the edges at each vertex.
    pub stretch: Vec<f64>,
    /// Depth in the bones [m], 0 outside.
    pub depth: Vec<f64>,
    /// Speed [m/s].
    pub speed: Vec<f64>,
    /// Volume over its target, minus 1; 0 without a volume constraint.
    pub volume_error: f64,
    /// Vertices in contact with an obstacle.
    pub touching: Vec<u32>,
    /// Vertices that the user fixed.
    pub fixed: Vec<u32>,
    /// The dragged vertex and its target [m].
    pub dragged: Option<(u32, Point3<f64>)>,
    /// Frame and cause of a stop.
    pub stopped: Option<(usize, String)>,
}

/// A bone at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneShot {
    /// Maps bone coordinates [m] to world coordinates [m].
    pub pose: Isometry3<f64>,
    /// The angle about its joint [rad], in -pi..pi; `None` without a joint.
    pub angle: Option<f64>,
    /// Source of the motion.
    pub steering: Steering,
}

/// Source of a bone's motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Steering {
    /// The motion of the scene.
    #[default]
    Motion,
    /// The user.
    Hand,
    /// Return from the user's pose to the motion of the scene.
    Return,
}

/// A point that the user can move: an implant, a node.
#[derive(Clone, Debug, PartialEq)]
pub struct Handle {
    /// Name of the moved object.
    pub name: String,
    /// Position [m].
    pub at: Point3<f64>,
}

/// A value at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Name of the quantity: readings of one name share a plot.
    pub name: &'static str,
    /// Name of the body; empty for a single body.
    pub of: String,
    /// Unit; empty for none.
    pub unit: &'static str,
    /// Value in that unit.
    pub value: f64,
}

/// Measures of one vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Index of the body.
    pub body: usize,
    /// Index of the vertex.
    pub vertex: usize,
    /// Name, value and unit of each measure.
    pub values: Vec<(&'static str, f64, &'static str)>,
}
