//! Contact of spring systems that may touch: what meets is found by a hierarchy of boxes, by edges against triangles and
//! by points inside, and answered by impulses.
//!
//! A step of [`Bodies`] is forces, velocities, impulses, positions, in this order (errata B05). Each part also stands for
//! itself: [`Hierarchy`], [`Voxels`], [`edges`], [`impulse`].

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
