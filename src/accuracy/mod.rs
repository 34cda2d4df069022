//! The cost of accuracy: a reference for a scene, runs of many solvers and settings against it, and
//! the cheapest that reach a given accuracy.
//!
//! Two errors are separate. The **solver error** is the distance to the solution of the same
//! discrete energy and the same problem: the motion for solvers with time steps, the equilibrium
//! for the others. The **model error** of a solver of the other problem is the distance between
//! both references. Errors from the mesh or the material are not measured here.

pub mod candidates;
pub mod choice;
pub mod distance;
pub mod model;
pub mod pilot;
pub mod reference;
mod search;
pub mod skin;
pub mod study;
pub mod trajectory;

pub use candidates::{Candidate, Question};
pub use choice::Recommended;
pub use distance::Distance;
pub use pilot::{Chosen, choose};
pub use reference::Reference;
pub use study::{Options, Row, Status, Study, StudyError, measure};
pub use trajectory::Trajectory;
