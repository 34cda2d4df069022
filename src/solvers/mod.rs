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
mod dense;
#[cfg(feature = "sparse")]
pub(crate) mod descent;
pub(crate) mod energy;
pub(crate) mod grip;
mod history;
mod parts;
#[cfg(feature = "sparse")]
pub(crate) mod newton;
pub(crate) mod press;
#[cfg(feature = "sparse")]
pub(crate) mod quasi_static;
#[cfg(feature = "sparse")]
pub(crate) mod sparse;
pub mod stiffness;
mod step;
#[cfg(feature = "sparse")]
mod tangent;
pub(crate) mod tension;
pub(crate) mod tracking;
#[cfg(feature = "sparse")]
pub(crate) mod viscosity;
#[cfg(feature = "sparse")]
pub(crate) mod unknowns;

#[cfg(feature = "sparse")]
pub use descent::{ContactFilter, DescentOutcome, DescentSettings, NoContact};
pub use energy::Energy;
#[cfg(feature = "sparse")]
pub use newton::Newton;
#[cfg(feature = "sparse")]
pub use quasi_static::QuasiStatic;
#[cfg(feature = "sparse")]
pub use sparse::FactorError;
#[cfg(feature = "sparse")]
pub use tangent::{Balance, Shift, Tangent};

pub use step::{Broken, DIVERGENCE, Held, StepSettings, System, effect_of_name};
