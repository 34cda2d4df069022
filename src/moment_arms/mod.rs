//! Lengths and moment arms of the fibres of a scene's muscles as functions of a joint angle.
//!
//! The moment arm of a muscle about a joint is `r = -dL/dq` \[sherman2013\], with the length `L`
//! [m] of the muscle and the angle `q` \[rad\] of the joint. It is positive where tension turns the
//! joint towards greater angles. [`crate::fibres::harmonic`] finds the fibres in the muscle at
//! rest. [`crate::fibres::carry`] binds them to its volume. [`sweep`] carries them through the
//! motion. [`curve`] differentiates their lengths, and [`reference`] compares the result with
//! tables.

pub(crate) mod arms;
mod chords;
pub(crate) mod curve;
pub(crate) mod names;
mod poses;
pub(crate) mod reference;
pub(crate) mod sweep;

pub use arms::Arms;
pub use curve::{extremes, moment_arms};
pub use names::means;
pub use poses::{PoseSet, bundles};
pub use reference::{ReferenceError, Table};
pub use sweep::{
    CrossingMuscle, MuscleStepper, NO_JOINT, Sweep, SweepError, SweepRun, joint_of, joints,
};
