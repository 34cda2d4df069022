//! The cost of accuracy: a reference for a scene, runs of many solvers and settings against it, and
//! the cheapest that reach a given accuracy.
//!
//! Two errors are separate. The **solver error** is the distance to the solution of the same
//! discrete energy and the same problem: the motion for solvers with time steps, the equilibrium
//! for the others. The **model error** of a solver of the other problem is the distance between
//! both references. Errors from the mesh or the material are not measured here.

pub(crate) mod candidates;
pub(crate) mod choice;
pub(crate) mod distance;
pub(crate) mod reference;
pub(crate) mod skin;
pub(crate) mod study;
pub(crate) mod trajectory;

pub use candidates::HIERARCHY;
pub use skin::{SkinRow, SkinStudy, SkinStudyError, measure_skin, method_name};

pub use distance::FrameDistance;
pub use reference::Reference;
pub use study::{Status, Study, StudyError, StudyOptions, StudyRow, measure};
