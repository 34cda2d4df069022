//! Contact of spring systems. Detection is that of [`crate::contact::Surface`]: pairs of triangles
//! for edges that cross them, and points inside; the response is by impulses.
//!
//! A step of [`Bodies`] computes forces, velocities, impulses, positions, in this order (errata
//! B05). The parts are in files of their own: edges, impulse. The hierarchy and the voxels of the thesis are
//! comparators for tests and benches.

pub(crate) mod bodies;
pub(crate) mod body;
pub(crate) mod edges;
mod finding;
#[cfg(any(test, feature = "testing"))]
pub(crate) mod hierarchy;
pub(crate) mod impulse;
#[cfg(any(test, feature = "testing"))]
pub(crate) mod voxels;

pub use bodies::{Bodies, StepContacts};
pub use body::{BodyError, CollidingBody, Drive};
pub(crate) use impulse::{ContactPart, impulse};
pub use impulse::{Response, ResponseError};
