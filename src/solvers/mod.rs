//! Solvers: a step of position-based dynamics, equilibrium, and the meaning of stiffness in each.
//!
//! * XPBD with small steps: material stiffness, independent of sweeps; see [`stiffness`] \[macklin2016, macklin2019\].
//! * Classic PBD: stiffness 0..1, for comparison with \[mueller2007\].
//! * [`quasi_static`]: equilibrium by L-BFGS over a constant matrix with one factorisation
//!   \[liu2017\].
//! * [`newton`]: equilibrium by Newton's method, the reference for the others.
//!
//! *Limitations.* The first two are local: an error of the whole muscle decreases slowly with
//! sweeps. Both have numerical damping: fast vibration loses amplitude with each step. The others
//! have no time.

#[cfg(feature = "sparse")]
mod active;
#[cfg(feature = "sparse")]
pub mod descent;
pub mod energy;
pub mod grip;
mod history;
#[cfg(feature = "sparse")]
pub mod newton;
pub mod press;
#[cfg(feature = "sparse")]
pub mod quasi_static;
#[cfg(feature = "sparse")]
pub mod sparse;
pub mod stiffness;
mod step;
pub mod tension;
pub mod tracking;
#[cfg(feature = "sparse")]
mod unknowns;

pub use step::{Broken, Clock, DIVERGENCE, Held, Settings, System, effect_of_name};
