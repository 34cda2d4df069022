//! The geometric muscle: a chain of frusta of constant volume on a frame of two bars.
//!
//! [`chain`] solves for the radii in closed form from the state at rest. [`frame`] places the bars
//! by the law of cosines. [`surface`] makes a mesh. [`GeometricMuscle`] has the range of lengths,
//! [`pose`] the shape at a length.

pub(crate) mod chain;
mod edit;
pub(crate) mod frame;
pub(crate) mod muscle;
pub mod pose;
pub(crate) mod surface;

pub use chain::{Chain, ChainError, ChainShape};
pub use muscle::GeometricMuscle;
