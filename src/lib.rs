#![doc = include_str!("../README.md")]
//!
//! # The crate
//!
//! The data flow one way: a [`scene`] is read and checked, a plan says which effects it calls for, a simulation
//! runs only those, and writers turn frames and measures into files. A module imports only what stands above it
//! in this list. The root names the types that a program uses first; each of them is also in its module.
#![cfg_attr(not(test), warn(clippy::unwrap_used))]
// A build with few features leaves parts without a caller.
#![cfg_attr(not(feature = "scene"), allow(dead_code))]

// In the order of permitted imports, not alphabetical: `reorder_modules` is off.
pub mod format;
pub mod progress;
pub mod mesh;
pub mod io;
pub mod state;
pub mod encode;
pub mod particles;
mod random;
pub mod simd;
pub mod rest;
pub mod constraints;
pub mod contact;
pub mod springs;
pub mod solvers;
#[cfg(feature = "sparse")]
pub mod morph;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub mod fibres;
#[cfg(all(feature = "contact", feature = "sparse"))]
pub mod skin;
#[cfg(feature = "scene")]
pub mod scene;
pub mod geometric;
#[cfg(feature = "scene")]
pub mod simulation;
#[cfg(feature = "scene")]
pub mod moment_arms;
#[cfg(feature = "scene")]
pub mod accuracy;
#[cfg(any(test, feature = "testing"))]
pub mod testing;

// The types that a program uses first.
pub use constraints::{
    Anchor, Batch, Bending, Constraint, Distance, EnclosedVolume, Order, PlaneContact, Potential,
    Project, Quadratic, Scalar, TetrahedronVolume, TriangleContact,
};
#[cfg(feature = "contact")]
pub use contact::Surface;
pub use contact::{ContactPlane, Contacts, Obstacle, PosedObstacle, Projection, capsule::Capsule};
#[cfg(all(feature = "contact", feature = "sparse"))]
pub use fibres::{
    attachment::{AreaSource, Attachment, AttachmentError},
    harmonic::{Decomposition, DecompositionError},
    quality::Quality,
};
pub use io::{MeshFile, ReadError, WriteError};
pub use mesh::{Aabb, Health, MeshError, Topology, TriangleMesh};
#[cfg(feature = "sparse")]
pub use morph::{Correspondence, Distortion, correspondence::CorrespondenceError};
pub use particles::Particles;
pub use progress::{Progress, Silent};
#[cfg(feature = "scene")]
pub use scene::{Content, Scene, SceneError};
#[cfg(feature = "scene")]
pub use simulation::{
    Fault, LoadError, Measures, Observer, Plan, Scenario, ScenarioError, Simulation,
};
#[cfg(all(feature = "contact", feature = "sparse"))]
pub use skin::{ImplantSpec, SkinError};
pub use solvers::{Broken, Held, System, energy::Energy};
#[cfg(feature = "sparse")]
pub use solvers::{newton::Newton, quasi_static::QuasiStatic};
pub use springs::{
    Force, Neighbours, SpringSystem, SystemError, integrators::Integrator, lattice::Lattice,
};

/// The digest of the library's sources and of its lock file, taken when the library was built: 32 hexadecimal digits.
///
/// Results of libraries with the same digest agree bit for bit on the same kind of machine. A change of a command's text
/// leaves the digest as it is; a change of the library or of a dependency changes it.
///
/// ```
/// assert_eq!(pliant::DIGEST.len(), 32);
/// ```
pub const DIGEST: &str = env!("PLIANT_DIGEST");
