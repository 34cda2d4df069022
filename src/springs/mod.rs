//! Mass-spring systems: forces between points, masses and stiffness from meshes, time integrators
//! with their stability limits, damping, equilibrium.
//!
//! A [`system::SpringSystem`] contains positions, velocities, masses and a list of
//! [`force::Force`]s, each in its own file; an [`integrators::Integrator`] advances it. Forces are
//! gathered by point over sorted neighbours, and sums use fixed trees: results do not depend on the
//! order of the springs or on the number of threads.

pub mod anchors;
pub mod angular;
pub mod buckling;
#[cfg(feature = "contact")]
pub mod contact;
pub mod damping;
pub mod force;
pub mod format;
pub mod hooke;
pub mod integrators;
pub mod lattice;
pub mod layers;
pub mod mass;
mod neighbours;
pub mod pairs;
pub mod patterns;
pub mod rest;
pub mod stability;
pub mod stiffness;
pub mod system;
pub mod volume;

pub use force::Force;
pub use neighbours::Neighbours;
pub use system::{Energy, SpringSystem, SystemError};
