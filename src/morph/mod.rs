//! Morphing: correspondence of closed surfaces, and intermediate shapes.
//!
//! Surfaces are mapped to the unit sphere ([`sphere`]). The maps are rotated and deformed until
//! similar parts coincide ([`pose`], [`align`]), and get common vertices ([`overlay`]); [`between`]
//! does all of this. [`blend`] computes intermediate shapes.

pub mod align;
pub mod blend;
pub(crate) mod correspondence;
pub(crate) mod distortion;
pub(crate) mod locate;
mod oriented_point;
pub(crate) mod overlay;
pub(crate) mod pose;
pub mod register;
mod shape_similarity;
pub mod sphere;
mod warp;

pub use correspondence::{
    Alike, CorrespondenceError, CorrespondenceMethod, CorrespondenceSettings, CorrespondenceTimes,
    Shared,
};
pub use distortion::area_shares;
pub use locate::{Located, Locator};
pub use overlay::{OverlayError, OverlayOrigin, arcs_cross};
pub use pose::{Start, axes};

pub use correspondence::Correspondence;
pub use distortion::Distortion;
pub use overlay::Overlay;
pub use sphere::{SphereError, SphereMap};
