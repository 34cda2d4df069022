//! Morphing: correspondence of closed surfaces, and intermediate shapes.
//!
//! Surfaces are mapped to the unit sphere ([`sphere`]). The maps are rotated and deformed until
//! similar parts coincide ([`pose`], [`align`]), and get common vertices ([`overlay`]); [`between`]
//! does all of this. [`blend`] computes intermediate shapes.

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
