//! Morphing: which place of one closed surface belongs to which of another, and shapes in between.
//!
//! Surfaces are spread over the unit sphere ([`sphere`]), turned, and drawn or moved until like parts lie over each other ([`pose`],
//! [`align`]), and given common vertices ([`overlay`]); [`correspondence`] does all of it. Shapes in between are made by [`blend`].

pub mod align;
pub mod blend;
pub mod correspondence;
pub mod distortion;
pub mod locate;
mod oriented_point;
pub mod overlay;
pub mod pose;
pub mod register;
mod shape_similarity;
pub mod sphere;
mod warp;

pub use correspondence::Correspondence;
pub use distortion::Distortion;
pub use overlay::Overlay;
pub use sphere::{SphereError, SphereMap};
