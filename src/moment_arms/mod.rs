//! Lengths and moment arms of the fibres of a scene's muscles over the angle of a joint.
//!
//! A muscle's moment arm about a joint is `r = -dL/dq` \[sherman2013\], with its length `L` [m] and the joint's angle `q`
//! \[rad\]: positive where pulling turns the joint towards greater angles. Fibres are found in the muscle at rest
//! ([`crate::fibres::harmonic`]), bound to its volume ([`crate::fibres::carry`]), and carried through the motion
//! ([`sweep`]); their lengths over the angle are derived in [`curve`], and compared with tables in [`reference`].

pub mod arms;
pub mod curve;
pub mod names;
pub mod reference;
pub mod shares;
pub mod sweep;
