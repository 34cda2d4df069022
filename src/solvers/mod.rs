//! Position-based solvers: a step that all of them share, and what stiffness means in each.
//!
//! * XPBD with small steps: material stiffness, independent of sweeps; see [`stiffness`] \[macklin2016, macklin2019\].
//! * Classic PBD: stiffness 0..1, kept to be compared with \[mueller2007\].
//!
//! *Limitations.* Both are local: an error that spreads over the whole muscle falls slowly with sweeps. Both damp:
//! fast vibration loses amplitude with the step.

pub mod stiffness;
mod step;

pub use step::{Broken, Clock, Held, Settings, System};
