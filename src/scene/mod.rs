//! A scene: what is there, how the bones move, which effects it calls for. Everything in SI units, checked. A [`Scene`] holds
//! muscles; [`content`] has the other kinds.
//!
//! [`mod@parse`] documents the TOML layout, [`overrides`] the changes from the command line, [`builtin`] has the scenes
//! that need no file.

pub mod builtin;
pub mod content;
pub mod effects;
mod encode;
pub mod error;
mod guess;
pub mod keys;
pub mod motion;
mod origin;
pub mod overrides;
pub mod parse;
mod parse_effects;
mod parse_lattice;
mod parse_muscle;
mod parse_skin;
mod paths;
mod reader;
mod schema;
pub mod solvers;
mod spelling;
pub mod study;
mod tree;
pub mod units;

pub use crate::constraints::Order;
pub use content::Content;
pub use effects::{Anisotropy, ContactEffect, EffectSpec, Effects, Mass, Material, Volume};
pub use error::{Problem, SceneError};
pub use guess::likely_units;
pub use origin::Origin;
pub use parse::{Surroundings, parse, parse_content, parse_with};
pub use paths::{Variables, no_variables};
pub use solvers::{Minimisation, Pbd, Question, Solver, SolverSpec, Xpbd};
pub use study::StudyFile;

use std::path::PathBuf;

use crate::mesh::repair;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

/// Share of a muscle's vertices that may be held in a scene that runs: of more, little is left that could deform.
pub const MOST_HELD: f64 = 0.10;

/// A checked scene of muscles and bones: SI units, every path resolved, every name found.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Name, used for the folder of results.
    pub name: String,
    /// Number of frames after the start; frame 0 is the start.
    pub frames: usize,
    /// Frames a second [1/s].
    pub frame_rate: f64,
    /// Rigid bodies that move as prescribed.
    pub bones: Vec<Bone>,
    /// Optional covers of joints that muscles are kept out of.
    pub capsules: Vec<Capsule>,
    /// Bodies that deform.
    pub muscles: Vec<Muscle>,
    /// Share of a muscle's vertices that may be held; [`MOST_HELD`] in what is read.
    pub most_held: f64,
    /// What acts. An effect that is `None` allocates nothing and runs nothing.
    pub effects: Effects,
    /// How the motion is computed.
    pub solver: Solver,
    /// The error that the user allows: solver and settings are then chosen.
    pub accuracy: Option<Accuracy>,
    /// Where it was read from, for errors that only its meshes show.
    pub origin: Origin,
}

/// An error that the user allows: root mean square of the vertices of the worst frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Accuracy {
    /// \[m\].
    Length(f64),
    /// As a share of the shortest muscle's length.
    Share(f64),
}

impl Accuracy {
    /// The error \[m\] for a muscle so long \[m\].
    pub fn length(self, muscle: f64) -> f64 {
        match self {
            Self::Length(length) => length,
            Self::Share(share) => share * muscle,
        }
    }
}

/// Where a surface comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A mesh file.
    File {
        /// Resolved path.
        path: PathBuf,
        /// Length of the file's unit \[m\].
        scale: f64,
    },
    /// A shape made by code, by its name in [`shapes::SCENE_NAMES`](crate::mesh::shapes::SCENE_NAMES).
    Shape(String),
}

/// A rigid body that moves as prescribed.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// Unique among bones and capsules.
    pub name: String,
    /// Its surface.
    pub surface: Source,
    /// What is repaired before it is used, lengths in metres; `None` takes it as it is.
    pub repair: Option<repair::Options>,
    /// Its motion; empty for a bone at rest.
    pub motion: Motion,
}

/// Key frames of a rigid motion, interpolated as a screw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Sorted by frame; before the first and after the last the pose is held.
    pub keys: Vec<Key>,
    /// The joint about which it turns, where centre and axis are given.
    pub joint: Option<Joint>,
}

/// Where a bone turns, and about what.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name; several bones may name the same.
    pub name: Option<String>,
    /// A point that stays \[m\].
    pub centre: Point3<f64>,
    /// Positive angles turn about it by the right hand.
    pub axis: Unit<Vector3<f64>>,
}

impl Joint {
    /// The pose of a bone that is turned by an angle \[rad\] from where its file has it.
    pub fn pose(&self, angle: f64) -> Isometry3<f64> {
        motion::turned(&self.axis, angle, &self.centre.coords)
    }
}

/// One pose at one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Frame number, may be fractional.
    pub frame: f64,
    /// Pose that maps the bone's file coordinates \[m\] to the world \[m\].
    pub pose: Isometry3<f64>,
}

/// A sphere swept along a segment that covers a joint, carried by a bone.
#[derive(Clone, Debug, PartialEq)]
pub struct Capsule {
    /// Unique among bones and capsules.
    pub name: String,
    /// Index of the bone that carries it.
    pub bone: usize,
    /// End points in the bone's file coordinates \[m\].
    pub segment: [Point3<f64>; 2],
    /// Radius \[m\].
    pub radius: f64,
}

/// A body that deforms.
#[derive(Clone, Debug, PartialEq)]
pub struct Muscle {
    /// Unique among muscles.
    pub name: String,
    /// Its surface.
    pub surface: Source,
    /// What is repaired before it is used, lengths in metres; `None` takes it as it is.
    pub repair: Option<repair::Options>,
    /// Wanted edge length \[m\]; `None` keeps the mesh as it is.
    pub edge_length: Option<f64>,
    /// Material constants.
    pub material: Material,
    /// Where it is held by bones.
    pub attachments: Vec<Attachment>,
    /// Polylines that run along its fibres.
    pub fibres: Option<Source>,
    /// Constant forces on chosen vertices.
    pub forces: Vec<Force>,
    /// Displacement of chosen vertices at the start.
    pub displacements: Vec<Displacement>,
}

/// Where and to which bone a muscle is held.
#[derive(Clone, Debug, PartialEq)]
pub struct Attachment {
    /// Index of the bone.
    pub bone: usize,
    /// Which vertices.
    pub area: Area,
    /// At most this share of the muscle's vertices, nearest first (0..1).
    pub limit: f64,
}

/// Which vertices of a muscle an attachment takes.
#[derive(Clone, Debug, PartialEq)]
pub enum Area {
    /// All vertices at most so far from the bone's surface \[m\].
    Near(f64),
    /// All vertices at most `within` \[m\] from a patch.
    Patch {
        /// The patch's file.
        source: Source,
        /// One component of the patch, by falling area; `None` takes all.
        component: Option<usize>,
        /// Largest distance \[m\].
        within: f64,
    },
    /// Indices into the muscle's vertices, in the file's order.
    Vertices(Vec<u32>),
}

/// A constant force on each of some vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// Indices into the muscle's vertices.
    pub vertices: Vec<u32>,
    /// Force on each \[N\].
    pub force: Vector3<f64>,
}

/// A displacement of each of some vertices at the start.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    /// Indices into the muscle's vertices.
    pub vertices: Vec<u32>,
    /// Displacement \[m\].
    pub by: Vector3<f64>,
}
