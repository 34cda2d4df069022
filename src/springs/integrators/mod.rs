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

pub use adaptive::Adaptive;
pub use bdf2::Bdf2;
pub use explicit_euler::ExplicitEuler;
pub use implicit_euler::ImplicitEuler;
pub use rk4::Rk4;
pub use semi_implicit_euler::SemiImplicitEuler;
pub use verlet::Verlet;

use super::stability::Mode;
use super::system::SpringSystem;

/// Error of a step.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The step gave a number that is not finite: the step exceeds the stability limit, or forces
    /// are too large.
    #[error("point {point} is nowhere after a step of {dt} s")]
    NotFinite {
        /// Index of the point.
        point: usize,
        /// The step [s].
        dt: f64,
    },
    /// The equations of an implicit step have no solution.
    #[error(
        "the equations of an implicit step of {dt} s were not solved in {iterations} iterations; take a shorter step"
    )]
    NotSolved {
        /// The step [s].
        dt: f64,
        /// Iterations of Newton's method.
        iterations: usize,
    },
    /// A graphics card no longer answers.
    #[error("the graphics device no longer answers")]
    DeviceLost,
    /// The step is unstable at its least length.
    #[error("even a step of {dt} s is not stable")]
    TooLong {
        /// The step [s].
        dt: f64,
    },
}

/// A method that advances a system in time.
pub trait Integrator: Send {
    /// Name, as used by the command.
    fn name(&self) -> &'static str;

    /// Order of convergence of positions with respect to the step, without damping.
    fn order(&self) -> u32;

    /// Advances the system by `dt` [s]. Pinned points stay.
    ///
    /// # Errors
    /// Numbers that are not finite, or equations without a solution; the system is then in the
    /// state of the failed step.
    fn step(&mut self, system: &mut SpringSystem, dt: f64) -> Result<(), StepError>;

    /// The longest stable step [s] of one mode of motion; 0 for none, infinity where every step is stable.
    fn limit(&self, mode: Mode) -> f64;

    /// Discards earlier steps; to be called after external changes of positions or velocities.
    fn restart(&mut self) {}

    /// A copy with its history, to return to.
    fn fork(&self) -> Box<dyn Integrator>;
}

/// The integrators by name, in the order of the help text.
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

/// Rejects numbers that are not finite.
fn finite(system: &SpringSystem, dt: f64) -> Result<(), StepError> {
    system
        .first_non_finite()
        .map_or(Ok(()), |point| Err(StepError::NotFinite { point, dt }))
}
