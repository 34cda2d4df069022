//! A scene: bodies, motions of the bones, and effects. All values are checked and in SI units. A
//! [`Scene`] contains muscles; [`content`] has the other kinds.
//!
//! [`mod@parse`] documents the TOML layout, [`overrides`] the changes from the command line.
//! [`builtin`] contains the built-in scenes.

mod builder;
pub mod builtin;
pub(crate) mod content;
pub(crate) mod effects;
mod encode;
pub(crate) mod error;
mod guess;
mod interface;
mod interval;
pub(crate) mod keys;
mod limits;
pub(crate) mod motion;
mod opensim;
mod origin;
pub(crate) mod overrides;
pub(crate) mod parse;
mod parse_effects;
mod parse_lattice;
mod parse_muscle;
mod parse_skin;
mod paths;
mod reader;
mod schema;
pub(crate) mod solvers;
pub(crate) mod study;
mod tree;
mod twist;
pub mod units;

pub use builder::SceneBuilder;
pub use content::OF_MUSCLES;
pub use content::{
    FillCourse, ImplantFill, LatticeScene, Measure, PRECISIONS, RestCourse, SkinScene, SkinSurface,
    SpringBodiesScene, SpringBodySpec, SpringsDamping, Support,
};
pub use effects::EFFECTS;
pub use keys::{KeySpec, KeyValue, Slider};
pub use solvers::SOLVERS;
pub use study::{Combine, StudyChange};

pub use crate::constraints::SweepOrder;
pub use content::Content;
pub use effects::{
    Anisotropy, ContactEffect, ContactPartners, EffectSpec, Effects, Mass, Material, Volume,
};
pub use error::SceneError;
pub(crate) use error::SceneProblem;
pub use guess::likely_units;
pub use interface::{Bonding, Interface};
pub use interval::{Uncertain, uncertain_quantity};
pub use limits::Limits;
pub(crate) use origin::SceneOrigin;
pub use parse::{Surroundings, parse, parse_content, parse_with};
pub use paths::{Variables, no_variables};
pub use solvers::{Minimisation, Pbd, Solver, SolverQuestion, SolverSpec, Xpbd};
pub use study::StudyFile;

/// Every key of a scene, by its kind: the name of the kind, and a scene with a remark beside each key.
pub const LAYOUTS: [(&str, &str); 5] = [
    ("muscles", include_str!("layout.toml")),
    ("skin", include_str!("layout-skin.toml")),
    ("lattice", include_str!("layout-lattice.toml")),
    ("geometric muscle", include_str!("layout-geometric.toml")),
    (
        "bodies of springs",
        include_str!("layout-spring-bodies.toml"),
    ),
];
pub(crate) use twist::smooth_step;

use std::path::PathBuf;
use std::sync::Arc;

use crate::mesh::{TriangleMesh, repair};
use crate::opensim::ModelDrive;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

/// Greatest share of a muscle's vertices and of its area that a simulated scene may fix: with more,
/// little is left to deform.
pub const MOST_HELD: f64 = 0.10;

/// A checked scene of muscles and bones: SI units, every path resolved, every name found.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Name, also of the results folder.
    pub name: String,
    /// Number of frames after the start; frame 0 is the start.
    pub frames: usize,
    /// Frames a second [1/s].
    pub frame_rate: f64,
    /// The direction that is up in pictures, of length 1.
    pub up: Vector3<f64>,
    /// Rigid bodies with prescribed motions.
    pub bones: Vec<BoneSpec>,
    /// The model of OpenSim that moves bones, if there is one.
    pub opensim: Option<Arc<ModelDrive>>,
    /// Covers of joints that muscles must not penetrate.
    pub capsules: Vec<Capsule>,
    /// Deformable bodies.
    pub muscles: Vec<Muscle>,
    /// How pairs of muscles hold each other; a pair without an entry slides.
    pub interfaces: Vec<Interface>,
    /// Greatest share of a muscle's vertices and area that may be fixed; [`MOST_HELD`] for scenes from text.
    pub most_held: f64,
    /// Effects. An effect that is `None` allocates nothing and runs nothing.
    pub effects: Effects,
    /// Solver of the motion.
    pub solver: Solver,
    /// True if the scene names no number of steps for XPBD: a frame with a residual above the
    /// tolerance is then repeated with more steps.
    pub adapts_steps: bool,
    /// The accuracy that the user requests: solver and settings are then chosen automatically.
    pub accuracy: Option<Accuracy>,
    /// True for a second run on a finer mesh, which tells the error of the mesh.
    pub mesh_error: bool,
    /// Limits of the quality of the motion; they judge a run and do not change it.
    pub limits: Limits,
    /// Origin of the scene's text, for errors found in its meshes.
    pub origin: SceneOrigin,
}

/// A requested accuracy: the greatest root mean square error of the vertices of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Accuracy {
    /// Absolute error \[m\].
    Length(f64),
    /// Error relative to the length of the shortest muscle.
    Share(f64),
    /// Error relative to the motion: to the root mean square distance of all vertices from their places at the
    /// start, in the frame where it is greatest.
    OfMotion(f64),
}

/// Source of a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A mesh file.
    File {
        /// Resolved path.
        path: PathBuf,
        /// Length of the file's unit \[m\].
        scale: f64,
    },
    /// A generated shape, by its name in [`SHAPES`].
    Shape(String),
    /// A mesh from memory.
    Given {
        /// The name that stands in the scene.
        name: String,
        /// Its vertices and triangles.
        mesh: Arc<TriangleMesh>,
        /// Length of the mesh's unit \[m\].
        scale: f64,
    },
}

/// A rigid body with a prescribed motion.
#[derive(Clone, Debug, PartialEq)]
pub struct BoneSpec {
    /// Name, unique among bones and capsules.
    pub name: String,
    /// Surface of the bone.
    pub surface: Source,
    /// Repair of the surface, lengths in metres; `None` for none.
    pub repair: Option<repair::RepairOptions>,
    /// Target edge length \[m\]; `None` keeps the mesh unchanged.
    pub edge_length: Option<f64>,
    /// Motion; empty for a bone at rest.
    pub motion: Motion,
}

/// Key frames of a rigid motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Keys sorted by frame; the pose is constant before the first and after the last.
    pub keys: Vec<Key>,
    /// The joint of the rotation, if centre and axis are given.
    pub joint: Option<Joint>,
    /// Constant speed between two keys; otherwise the motion is smooth (see [`Motion::pose`]).
    pub linear: bool,
}

/// A joint of a bone: centre and axis of rotation.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name of the joint; several bones can have the same.
    pub name: Option<String>,
    /// Fixed point of the rotation \[m\].
    pub centre: Point3<f64>,
    /// Axis of rotation; positive angles follow the right-hand rule.
    pub axis: Unit<Vector3<f64>>,
    /// Poses at angles of the joint of a bone that glides instead of turning with it, such as a patella:
    /// `frame` is the angle \[rad\], ascending. Empty for a bone that turns.
    pub path: Vec<Key>,
}

impl Joint {
    /// The pose of the bone at an angle of the joint \[rad\], from its pose in the file: turned about
    /// the axis, or on its path. Between two keys of a path, pose, speed and acceleration are continuous;
    /// beyond its ends the pose is that of the end.
    pub fn pose(&self, angle: f64) -> Isometry3<f64> {
        if self.path.is_empty() {
            return crate::rigid::turned(&self.axis, angle, &self.centre.coords);
        }
        motion::along(self, angle)
    }

    /// The angle of the joint \[rad\] at which the bone has a pose: in -pi..pi, or on its path.
    pub fn angle_of(&self, pose: &Isometry3<f64>) -> f64 {
        motion::angle_of(self, pose)
    }

    /// The least and the greatest angle of its path \[rad\]; `None` without a path.
    pub fn path_range(&self) -> Option<[f64; 2]> {
        Some([self.path.first()?.frame, self.path.last()?.frame])
    }
}

/// One pose at one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Frame number, possibly fractional.
    pub frame: f64,
    /// Pose that maps the bone's file coordinates \[m\] to the world \[m\].
    pub pose: Isometry3<f64>,
}

/// A sphere swept along a segment that covers a joint, carried by a bone.
#[derive(Clone, Debug, PartialEq)]
pub struct Capsule {
    /// Name, unique among bones and capsules.
    pub name: String,
    /// Index of the bone that carries it.
    pub bone: usize,
    /// End points in the bone's file coordinates \[m\].
    pub segment: [Point3<f64>; 2],
    /// Radius \[m\].
    pub radius: f64,
}

/// A deformable body.
#[derive(Clone, Debug, PartialEq)]
pub struct Muscle {
    /// Name, unique among muscles.
    pub name: String,
    /// Surface of the muscle.
    pub surface: Source,
    /// Repair of the surface, lengths in metres; `None` for none.
    pub repair: Option<repair::RepairOptions>,
    /// Target edge length \[m\]; `None` keeps the mesh unchanged.
    pub edge_length: Option<f64>,
    /// Material constants.
    pub material: Material,
    /// Attachments to bones.
    pub attachments: Vec<AttachmentSpec>,
    /// Polylines along the fibres.
    pub fibres: Option<Source>,
    /// Number of fibres that are computed between the attachments; `None` for those of `fibres`.
    pub fibre_count: Option<u32>,
    /// Shortening of the fibres by activation, relative to their length at rest, by frame. It is smooth
    /// between two frames, and constant before the first and after the last one.
    pub activation: Vec<(f64, f64)>,
    /// Constant forces on chosen vertices.
    pub forces: Vec<AtVertices>,
    /// Displacement of chosen vertices at the start.
    pub displacements: Vec<AtVertices>,
}

/// An attachment of a muscle to a bone.
#[derive(Clone, Debug, PartialEq)]
pub struct AttachmentSpec {
    /// Index of the bone.
    pub bone: usize,
    /// Attached vertices.
    pub area: AreaSpec,
    /// Greatest share of the muscle's vertices, nearest first (0..1).
    pub limit: f64,
}

/// The vertices of an attachment.
#[derive(Clone, Debug, PartialEq)]
pub enum AreaSpec {
    /// All vertices within this distance of the bone's surface \[m\].
    Near(f64),
    /// All vertices within `within` \[m\] of a patch.
    Patch {
        /// File of the patch.
        source: Source,
        /// Component of the patch, by descending area; `None` takes all.
        component: Option<usize>,
        /// Greatest distance \[m\].
        within: f64,
    },
    /// Vertex indices, in the order of the file.
    Vertices(Vec<u32>),
}

/// A vector at each vertex of a list.
#[derive(Clone, Debug, PartialEq)]
pub struct AtVertices {
    /// Vertex indices, in the order of the file.
    pub vertices: Vec<u32>,
    /// Force \[N\] or displacement \[m\] of each vertex.
    pub vector: Vector3<f64>,
}
