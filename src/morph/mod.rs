//! Morphing: which place of one closed surface belongs to which of another, and shapes in between.
//!
//! Surfaces are spread over the unit sphere ([`sphere`]).

pub mod align;
pub mod blend;
mod draws;
pub mod locate;
pub mod overlay;
pub mod register;
pub mod sphere;

pub use overlay::Overlay;
pub use sphere::{SphereError, SphereMap};
