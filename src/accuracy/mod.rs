//! What accuracy costs: a reference for a scene, runs of many solvers and settings against it, and the cheapest of them
//! that reaches a given accuracy.
//!
//! Two errors are kept apart. The **solver error** is the distance to the solution of the same discrete energy and the
//! same question: of the motion for solvers that step in time, of the equilibrium for those that do not. The **model
//! error** of a solver that answers the other question is the distance between both references. Against finer meshes
//! or other materials nothing is measured here.

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
