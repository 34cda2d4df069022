//! Verified, fast deformation of soft tissue: muscles that slide around moving bones, skin over implants, lattices of
//! springs. Each result comes with an estimate of its error.
//!
//! # Where to begin
//!
//! | you have | begin with |
//! |---|---|
//! | points and constraints | [`Batch`], which projects many [`Constraint`]s; [`Particles`] |
//! | a constraint of your own | [`Constraint`], and the feature `testing` to check its gradient |
//! | a surface and a bone | [`System`], [`Obstacle`] |
//! | meshes and an idea of a motion | [`scene`], [`Simulation`] |
//! | a mesh of unknown quality | [`Health`], [`mesh`] |
//! | a muscle without fibres | [`Decomposition`], [`fibres`] |
//! | a joint and muscles over it | [`moment_arms`] |
//! | a model or a motion of OpenSim | [`opensim`] |
//! | skin and an implant | [`ImplantSpec`], [`skin`] |
//! | two bodies | [`Correspondence`], [`morph`] |
//! | mass and springs | [`SpringSystem`], [`Lattice`], [`springs`] |
//!
//! ```
//! use nalgebra::Point3;
//! use pliant::{Batch, Distance, Particles, Project, SweepOrder};
//!
//! // Three points on a line; the first is held. Both links are 1 m at rest, and the last point was pulled 0.5 m away.
//! let at = |x: f64| Point3::new(x, 0.0, 0.0);
//! let mut particles = Particles::at_rest(vec![at(0.0), at(1.0), at(2.5)], vec![0.0, 1.0, 1.0]);
//! let links = vec![
//!     Distance { points: [0, 1], rest: 1.0 },
//!     Distance { points: [1, 2], rest: 1.0 },
//! ];
//! let mut batch =
//!     Batch::<Distance, 2>::new(links, vec![0.0; 2], SweepOrder::FromLoadedEnd, 3, &[2]);
//! for _ in 0..60 {
//!     batch.begin_step();
//!     batch.project(&mut particles, 1.0 / 60.0);
//! }
//! assert!((particles.position[2].x - 2.0).abs() <= 1e-12);
//! ```
//!
//! # Units, errors, threads
//!
//! Lengths are in metres, masses in kilograms, angles in radians. Scene files write their units out. Each operation has an error
//! of its own with values. The library prints nothing, reads no environment and sets no global state. Long computations report
//! to [`Progress`], whose answer can stop them. The same inputs give the same bits on any number of threads.
//!
//! # Features
//!
//! `contact`, `sparse`, `scene` and `compression` are on by default; without them the crate has meshes, readers, constraints,
//! steps and springs. `gpu` runs lattices on graphics cards. `testing` has the conformance suite for constraints written
//! elsewhere.
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

/// Number of 64-bit numbers that one vector instruction takes on this machine, for the kernels of constraints and lattices.
///
/// ```
/// assert!([1, 2, 4, 8].contains(&pliant::lanes()));
/// ```
#[must_use]
pub fn lanes() -> usize {
    simd::SimdWidth::best().lanes()
}

/// The example of the README, which is compiled and run with the others.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
