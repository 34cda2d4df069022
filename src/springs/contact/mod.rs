//! Contact of spring systems. Detection uses a hierarchy of boxes, edges against triangles, and
//! points inside; the response is by impulses.
//!
//! A step of [`Bodies`] computes forces, velocities, impulses, positions, in this order (errata
//! B05). Each part is also usable alone: [`Hierarchy`], [`Voxels`], [`edges`], [`impulse`].

pub mod bodies;
pub mod body;
pub mod edges;
mod finding;
pub mod hierarchy;
pub mod impulse;
pub mod voxels;

pub use bodies::{Bodies, StepContacts};
pub use body::{Body, BodyError, Drive};
pub use hierarchy::Hierarchy;
pub use impulse::{Response, ResponseError};
pub use voxels::Voxels;
