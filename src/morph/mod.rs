//! Morphing: correspondence of closed surfaces, and intermediate shapes.
//!
//! Surfaces are mapped to the unit sphere ([`sphere`]). The maps are rotated and deformed until
//! similar parts coincide ([`pose`], [`align`]), and get common vertices ([`overlay`]); [`between`]
//! does all of this. [`blend`] computes intermediate shapes.

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
