//! Time integrators, one file each.
//!
//! Orders and stability limits are measured by `tests/suite/springs/integrators.rs`.

mod adaptive;
mod bdf2;
mod explicit_euler;
mod implicit;
mod implicit_euler;
mod rk4;
mod semi_implicit_euler;
mod verlet;

pub use adaptive::{Adaptive, Attempt};
pub use bdf2::Bdf2;
pub use explicit_euler::ExplicitEuler;
pub use implicit_euler::ImplicitEuler;
pub use rk4::Rk4;
pub use semi_implicit_euler::SemiImplicitEuler;
pub use verlet::Verlet;

use super::stability::Mode;
use super::system::SpringSystem;

/// Why a step was not made.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The step gave a number that is not finite: the step is longer than the stability limit, or forces are too large.
    #[error("point {point} is nowhere after a step of {dt} s")]
    NotFinite {
        /// The point.
        point: usize,
        /// The step [s].
        dt: f64,
    },
    /// The equations of an implicit step were not solved.
    #[error(
        "the equations of an implicit step of {dt} s were not solved in {iterations} iterations; take a shorter step"
    )]
    NotSolved {
        /// The step [s].
        dt: f64,
        /// Iterations of Newton's method.
        iterations: usize,
    },
    /// The step has shrunk to its least length and still is too long.
    #[error("even a step of {dt} s is not stable")]
    TooLong {
        /// The step [s].
        dt: f64,
    },
}

/// A way to advance a system in time.
pub trait Integrator: Send {
    /// Its name, as the command takes it.
    fn name(&self) -> &'static str;

    /// Order of convergence of positions in the step, without damping.
    fn order(&self) -> u32;

    /// Advances the system by `dt` [s]. Pinned points stay.
    ///
    /// # Errors
    /// Numbers that are not finite, equations that are not solved; the system is then as the failed step left it.
    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError>;

    /// The longest stable step [s] of one mode of motion; 0 for none, infinity where every step is stable.
    fn limit(&self, mode: Mode) -> f64;

    /// Forgets earlier steps: to be called where positions or velocities were changed from outside.
    fn restart(&mut self) {}

    /// A copy with all it remembers, to go back to.
    fn fork(&self) -> Box<dyn Integrator>;
}

/// The integrators by name, in the order in which help lists them.
pub const INTEGRATORS: [&str; 6] = [
    "verlet",
    "semi-implicit",
    "explicit",
    "rk4",
    "bdf2",
    "implicit",
];

/// The integrator of a name of [`INTEGRATORS`].
pub fn by_name(name: &str) -> Option<Box<dyn Integrator>> {
    Some(match name {
        "verlet" => Box::new(Verlet::default()),
        "semi-implicit" => Box::new(SemiImplicitEuler::default()),
        "explicit" => Box::new(ExplicitEuler),
        "rk4" => Box::new(Rk4),
        "bdf2" => Box::new(Bdf2::default()),
        "implicit" => Box::new(ImplicitEuler::default()),
        _ => return None,
    })
}

/// Refuses what is not finite.
fn finite(system: &SpringSystem, dt: f64) -> Result<(), StepError> {
    system
        .first_non_finite()
        .map_or(Ok(()), |point| Err(StepError::NotFinite { point, dt }))
}
