//! Morphing: which place of one closed surface belongs to which of another, and shapes in between.
//!
//! Surfaces are spread over the unit sphere ([`sphere`]), turned, and drawn or moved until like parts lie over each other ([`pose`],
//! [`align`]), and given common vertices ([`overlay`]); [`between`] does all of it. Shapes in between are made by [`blend`].

pub mod align;
pub mod between;
pub mod blend;
pub mod distortion;
mod likeness;
pub mod locate;
pub mod overlay;
pub mod pose;
pub mod register;
pub mod sphere;
mod spot;
mod warp;

pub use between::Between;
pub use distortion::Distortion;
pub use overlay::Overlay;
pub use sphere::{SphereError, SphereMap};
