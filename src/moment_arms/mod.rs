//! Lengths and moment arms of the fibres of a scene's muscles as functions of a joint angle.
//!
//! The moment arm of a muscle about a joint is `r = -dL/dq` \[sherman2013\], with the length `L`
//! [m] of the muscle and the angle `q` \[rad\] of the joint. It is positive where tension turns the
//! joint towards greater angles. [`crate::fibres::harmonic`] finds the fibres in the muscle at
//! rest. [`crate::fibres::carry`] binds them to its volume. [`sweep`] carries them through the
//! motion. [`curve`] differentiates their lengths, and [`reference`] compares the result with
//! tables.

pub mod arms;
pub mod curve;
pub mod names;
pub mod reference;
pub mod shares;
pub mod sweep;
