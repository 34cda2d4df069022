#![doc = include_str!("../README.md")]
//!
//! # The crate
//!
//! Data flows in one direction. A [`scene`] is read and checked. A plan lists the effects that the
//! scene needs. A simulation runs only those effects. Writers turn frames and measures into files.
//! A module imports only modules that stand above it in this list.
//! The root names the types that a program uses first. Each of them is also in its module.
#![cfg_attr(not(test), warn(clippy::unwrap_used))]
// Only tests and benches use some functions, and only some features use others.
#![cfg_attr(
    not(all(feature = "scene", feature = "testing")),
    allow(dead_code, unused_imports)
)]

// In the order of permitted imports, not alphabetical: `reorder_modules` is off.
pub mod format;
pub mod progress;
pub mod mesh;
pub mod io;
pub mod state;
pub(crate) mod encode;
pub(crate) mod particles;
pub mod random;
pub(crate) mod simd;
pub(crate) mod rest;
pub(crate) mod rigid;
#[cfg(feature = "scene")]
pub(crate) mod spelling;
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
pub mod opensim;
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
    Anchor, Batch, Bending, Bond, Constraint, Distance, EnclosedVolume, PlaneContact, Potential,
    Project, Quadratic, Scalar, SweepOrder, TetrahedronVolume, TriangleContact,
};
#[cfg(feature = "contact")]
pub use contact::Surface;
pub use contact::{ContactPlane, Contacts, Obstacle, PosedObstacle, Projection};
pub use encode::text_of;
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
pub use simulation::{LoadError, Measures, Observer, Plan, Scenario, ScenarioError, Simulation};
#[cfg(all(feature = "contact", feature = "sparse"))]
pub use skin::{ImplantSpec, SkinError};
pub use solvers::{Broken, Held, System, energy::Energy};
#[cfg(feature = "sparse")]
pub use solvers::{newton::Newton, quasi_static::QuasiStatic};
pub use springs::{
    Force, Neighbours, SpringSystem, SystemError, integrators::Integrator, lattice::Lattice,
};

/// The digest of the library's sources and of its lock file, computed when the library is built: 32
/// hexadecimal digits.
///
/// Libraries with the same digest give the same bits on the same kind of machine. A change of a
/// command's text does not change the digest. A change of the library or of a dependency changes
/// it.
///
/// ```
/// assert_eq!(pliant::DIGEST.len(), 32);
/// ```
pub const DIGEST: &str = env!("PLIANT_DIGEST");
