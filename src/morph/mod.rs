//! Morphing: correspondence of closed surfaces, and intermediate shapes.
//!
//! Surfaces are mapped to the unit sphere ([`sphere`]). The maps are rotated and deformed until
//! similar parts coincide ([`pose`], [`align`]), and get common vertices ([`overlay`]); [`between`]
//! does all of this. [`blend`] computes intermediate shapes.

pub(crate) mod align;
pub mod blend;
pub(crate) mod correspondence;
pub(crate) mod distortion;
pub(crate) mod locate;
mod oriented_point;
pub(crate) mod overlay;
pub(crate) mod pose;
pub mod register;
mod shape_similarity;
pub(crate) mod sphere;
mod volume;
mod warp;

pub use correspondence::{
    CorrespondenceError, CorrespondenceMethod, CorrespondenceSettings, Shared,
};
pub use distortion::area_shares;
pub use pose::axes;

pub use align::AlignError;
pub use correspondence::Correspondence;
pub use distortion::Distortion;
pub use sphere::{Relaxation, SphereError, flipped};
pub use volume::by_volume;
