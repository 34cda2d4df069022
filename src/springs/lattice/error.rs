//! Errors of a lattice, with advice.

use thiserror::Error;

/// The reason why a lattice cannot be built or advanced.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum LatticeError {
    /// A side has no points, or there are too many points.
    #[error("a lattice of {} x {} x {} points: give each side at least 1 point, and at most {most} points in all", .points[0], .points[1], .points[2])]
    Points {
        /// Numbers along x, y, z.
        points: [usize; 3],
        /// Greatest total number of points.
        most: usize,
    },
    /// A spacing, mass or stiffness is not positive and finite, or a damping or diagonal factor is
    /// negative.
    #[error("{name} is {value:e}: give a finite number {}", if *.zero_allowed { "of at least 0" } else { "above 0" })]
    Value {
        /// Name of the value.
        name: &'static str,
        /// The value.
        value: f64,
        /// True if zero is allowed.
        zero_allowed: bool,
    },
    /// The time step is above the stability limit.
    #[error(
        "a time step of {time_step:e} with mass {mass:e} and damping {damping:e} makes the lattice explode (largest stiffness \
         {stiffness:e}): give a step below {limit:e}, or more mass"
    )]
    Unstable {
        /// The given time step.
        time_step: f64,
        /// The step above which the system is unstable.
        limit: f64,
        /// Mass m.
        mass: f64,
        /// Damping c.
        damping: f64,
        /// Greatest eigenvalue of the stiffness matrix.
        stiffness: f64,
    },
    /// A position is NaN or infinite.
    #[error(
        "the lattice exploded at step {step}: give a smaller time step, more mass or weaker forces"
    )]
    Diverged {
        /// Number of steps since the construction.
        step: u64,
    },
}

/// Checks that a number is finite and positive, or not negative.
pub(super) fn value(
    name: &'static str,
    value: f64,
    zero_allowed: bool,
) -> Result<(), LatticeError> {
    let good = value.is_finite() && (value > 0.0 || zero_allowed && value == 0.0);
    if good {
        Ok(())
    } else {
        Err(LatticeError::Value {
            name,
            value,
            zero_allowed,
        })
    }
}
