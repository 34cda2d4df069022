//! Mass-spring systems: forces between points, masses and stiffness from meshes, time integrators
//! with their stability limits, damping, equilibrium.
//!
//! A [`system::SpringSystem`] contains positions, velocities, masses and a list of
//! [`force::Force`]s, each in its own file; an [`integrators::Integrator`] advances it. Forces are
//! gathered by point over sorted neighbours, and sums use fixed trees: results do not depend on the
//! order of the springs or on the number of threads.

pub(crate) mod anchors;
pub(crate) mod angular;
pub(crate) mod buckling;
pub(crate) mod cloth_patterns;
#[cfg(feature = "contact")]
pub mod contact;
pub mod damping;
pub(crate) mod force;
pub mod format;
pub(crate) mod hooke;
pub mod integrators;
pub mod lattice;
pub(crate) mod layers;
pub(crate) mod mass;
mod neighbours;
pub(crate) mod spring_set;
pub mod patterns;
pub(crate) mod rest;
pub(crate) mod stability;
pub(crate) mod stiffness;
pub(crate) mod system;
pub(crate) mod volume;

pub use hooke::{Hooke, Springs};
pub use rest::{RestEnd, RestSettings, Settled, StepRecord, settle};
pub use stability::{Mode, Stiffest, limit, stiffest};

pub use force::Force;
pub use neighbours::Neighbours;
pub use system::{SpringSystem, SystemError};
