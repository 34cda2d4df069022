//! Contact of spring systems. Detection uses a hierarchy of boxes, edges against triangles, and
//! points inside; the response is by impulses.
//!
//! A step of [`Bodies`] computes forces, velocities, impulses, positions, in this order (errata
//! B05). The parts are in files of their own: hierarchy, voxels, edges, impulse.

pub(crate) mod bodies;
pub(crate) mod body;
pub(crate) mod edges;
mod finding;
pub(crate) mod hierarchy;
pub(crate) mod impulse;
pub(crate) mod voxels;

pub use bodies::{Bodies, StepContacts};
pub use body::{BodyError, CollidingBody, Drive};
pub use impulse::{Response, ResponseError};
