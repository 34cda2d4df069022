//! A scene: bodies, motions of the bones, and effects. All values are checked and in SI units. A
//! [`Scene`] contains muscles; [`content`] has the other kinds.
//!
//! [`mod@parse`] documents the TOML layout, [`overrides`] the changes from the command line.
//! [`builtin`] contains the built-in scenes.

pub mod builtin;
pub mod content;
pub mod error;
mod guess;
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
mod shapes_known;
mod spelling;
pub mod study;
mod tree;
pub mod units;

pub use crate::constraints::Order;
pub use content::Content;
pub use error::{Problem, SceneError};
pub use guess::likely_units;
pub use origin::Origin;
pub use parse::{Surroundings, parse, parse_content, parse_with};
pub use paths::environment;
pub use shapes_known::{FIBRE_SHAPES, SHAPES, SKIN_SHAPES};
pub use study::StudyFile;

use std::path::PathBuf;

use crate::mesh::repair;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

/// Greatest share of a muscle's vertices that a simulated scene may fix: with more, little is left
/// to deform.
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
    /// Rigid bodies with prescribed motions.
    pub bones: Vec<Bone>,
    /// Covers of joints that muscles must not penetrate.
    pub capsules: Vec<Capsule>,
    /// Deformable bodies.
    pub muscles: Vec<Muscle>,
    /// Greatest share of a muscle's vertices that may be fixed; [`MOST_HELD`] for scenes from text.
    pub most_held: f64,
    /// Effects. An effect that is `None` allocates nothing and runs nothing.
    pub effects: Effects,
    /// Solver of the motion.
    pub solver: Solver,
    /// The accuracy that the user requests: solver and settings are then chosen automatically.
    pub accuracy: Option<Accuracy>,
    /// Origin of the scene's text, for errors found in its meshes.
    pub origin: Origin,
}

/// A requested accuracy: the greatest root mean square error of the vertices of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Accuracy {
    /// Absolute error \[m\].
    Length(f64),
    /// Error relative to the length of the shortest muscle.
    Share(f64),
}

impl Accuracy {
    /// The error \[m\] for a muscle of length `muscle` \[m\].
    pub fn length(self, muscle: f64) -> f64 {
        match self {
            Self::Length(length) => length,
            Self::Share(share) => share * muscle,
        }
    }
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
}

/// A rigid body with a prescribed motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// Name, unique among bones and capsules.
    pub name: String,
    /// Surface of the bone.
    pub surface: Source,
    /// Repair of the surface, lengths in metres; `None` for none.
    pub repair: Option<repair::Options>,
    /// Motion; empty for a bone at rest.
    pub motion: Motion,
}

/// Key frames of a rigid motion, interpolated as a screw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Keys sorted by frame; the pose is constant before the first and after the last.
    pub keys: Vec<Key>,
    /// The joint of the rotation, if centre and axis are given.
    pub joint: Option<Joint>,
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
}

impl Joint {
    /// The pose of a bone rotated by an angle \[rad\] from its pose in the file.
    pub fn pose(&self, angle: f64) -> Isometry3<f64> {
        motion::turned(&self.axis, angle, &self.centre.coords)
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
    pub repair: Option<repair::Options>,
    /// Target edge length \[m\]; `None` keeps the mesh unchanged.
    pub edge_length: Option<f64>,
    /// Material constants.
    pub material: Material,
    /// Attachments to bones.
    pub attachments: Vec<Attachment>,
    /// Polylines along the fibres.
    pub fibres: Option<Source>,
    /// Constant forces on chosen vertices.
    pub forces: Vec<Force>,
    /// Displacement of chosen vertices at the start.
    pub displacements: Vec<Displacement>,
}

/// Material constants of a surface muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Source of the mass.
    pub mass: Mass,
    /// In-plane stiffness of the surface [N/m]; zero leaves the effect out.
    pub stretch: f64,
    /// Bending stiffness of the surface [N m]; zero leaves the effect out.
    pub bending: f64,
    /// Bulk modulus \[Pa\]; `None` is incompressible.
    pub bulk: Option<f64>,
}

/// Source of the vertex masses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mass {
    /// Density of the enclosed volume [kg/m^3]; the mass is distributed to the vertices by area.
    Density(f64),
    /// The same mass for each vertex \[kg\].
    PerVertex(f64),
}

/// An attachment of a muscle to a bone.
#[derive(Clone, Debug, PartialEq)]
pub struct Attachment {
    /// Index of the bone.
    pub bone: usize,
    /// Attached vertices.
    pub area: Area,
    /// Greatest share of the muscle's vertices, nearest first (0..1).
    pub limit: f64,
}

/// The vertices of an attachment.
#[derive(Clone, Debug, PartialEq)]
pub enum Area {
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

/// A constant force on each vertex of a list.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// Vertex indices.
    pub vertices: Vec<u32>,
    /// Force on each vertex \[N\].
    pub force: Vector3<f64>,
}

/// A displacement of each vertex of a list at the start.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    /// Vertex indices.
    pub vertices: Vec<u32>,
    /// Displacement \[m\].
    pub by: Vector3<f64>,
}

/// Effects of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    /// Edges resist a change of length (material constant `stretch`).
    pub stretch: bool,
    /// Neighbouring triangles resist a change of their angle (material constant `bending`).
    pub bending: bool,
    /// The enclosed volume is constrained (material constant `bulk`).
    pub volume: Option<Volume>,
    /// The stiffness is smaller along fibres.
    pub anisotropy: Option<Anisotropy>,
    /// Contact keeps muscles out of bones and bones out of muscles.
    pub contact: Option<ContactEffect>,
    /// Acceleration [m/s^2].
    pub gravity: Option<Vector3<f64>>,
    /// Rate at which velocities decay [1/s].
    pub damping: Option<f64>,
}

/// Keeps the enclosed volume at `pressure` times its start value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Pressure factor, 0.5 to 2.
    pub pressure: f64,
}

/// Scales the stiffness of an edge by `1 - strength |u.v|^power`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anisotropy {
    /// A in 0..1.
    pub strength: f64,
    /// Exponent, at least 1.
    pub power: f64,
}

/// Contact with Coulomb friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactEffect {
    /// Distance between muscle and bone \[m\].
    pub thickness: f64,
    /// Coefficient of Coulomb friction.
    pub friction: f64,
}

/// Solver of the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solver {
    /// Extended position-based dynamics with small steps and material stiffness.
    Xpbd(Xpbd),
    /// Classic position-based dynamics with stiffness 0..1, for comparison.
    Pbd(Pbd),
    /// Equilibrium in every frame, without mass and velocity.
    QuasiStatic(Minimisation),
    /// Implicit Euler steps, each solved as the minimum of energy and inertia.
    ImplicitEuler(Minimisation),
}

impl Solver {
    /// Number of steps per frame.
    pub fn substeps(&self) -> u32 {
        match self {
            Self::Xpbd(s) => s.substeps,
            Self::Pbd(s) => s.substeps,
            Self::QuasiStatic(s) | Self::ImplicitEuler(s) => s.substeps,
        }
    }

    /// Greatest number of sweeps or iterations per step.
    pub fn iterations(&self) -> u32 {
        match self {
            Self::Xpbd(s) => s.iterations,
            Self::Pbd(s) => s.iterations,
            Self::QuasiStatic(s) | Self::ImplicitEuler(s) => s.iterations,
        }
    }

    /// Greatest relative residual of a converged frame.
    pub fn tolerance(&self) -> f64 {
        match self {
            Self::Xpbd(s) => s.tolerance,
            Self::Pbd(s) => s.tolerance,
            Self::QuasiStatic(s) | Self::ImplicitEuler(s) => s.tolerance,
        }
    }

    /// Order of a sweep; the default for a solver without sweeps.
    pub fn order(&self) -> Order {
        match self {
            Self::Xpbd(s) => s.order,
            Self::Pbd(s) => s.order,
            Self::QuasiStatic(_) | Self::ImplicitEuler(_) => Order::default(),
        }
    }
}

/// Settings of the solvers that minimise an energy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Minimisation {
    /// Number of steps per frame; the bones move in between.
    pub substeps: u32,
    /// Greatest number of iterations per step.
    pub iterations: u32,
    /// Greatest residual force of a converged frame, relative to the force of unit strain.
    pub tolerance: f64,
}

/// Settings of small-step XPBD.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Xpbd {
    /// Number of steps per frame.
    pub substeps: u32,
    /// Number of sweeps per step.
    pub iterations: u32,
    /// Order of a sweep.
    pub order: Order,
    /// Greatest relative residual of a converged frame.
    pub tolerance: f64,
}

/// Settings of classic PBD.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pbd {
    /// Number of steps per frame.
    pub substeps: u32,
    /// Number of sweeps per step.
    pub iterations: u32,
    /// Stiffness of edges, 0..1.
    pub stretch: f64,
    /// Stiffness of hinges, 0..1.
    pub bending: f64,
    /// Stiffness of the volume, 0..1.
    pub volume: f64,
    /// Factor on velocities per frame, 0..1.
    pub velocity_damping: f64,
    /// Order of a sweep.
    pub order: Order,
    /// Greatest relative residual of a converged frame.
    pub tolerance: f64,
}
