//! The geometric muscle: a chain of frusta of constant volume on a frame of two bars.
//!
//! [`chain`] solves for the radii in closed form from the state at rest. [`frame`] places the bars
//! by the law of cosines. [`surface`] makes a mesh. [`file`](mod@file) reads a muscle from a file.

pub(crate) mod chain;
#[cfg(feature = "scene")]
pub mod file;
pub(crate) mod frame;
#[cfg(feature = "scene")]
pub mod pose;
pub(crate) mod surface;

pub use chain::{Chain, ChainError, ChainShape};
