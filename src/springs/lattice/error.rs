//! What is wrong with a lattice, and what to change.

use thiserror::Error;

/// Why a lattice cannot be built, or its run cannot go on.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum LatticeError {
    /// A side without points, or too many points.
    #[error("a lattice of {} x {} x {} points: give each side at least 1 point, and at most {most} points in all", .points[0], .points[1], .points[2])]
    Points {
        /// Along x, y, z.
        points: [usize; 3],
        /// The largest number of all points.
        most: usize,
    },
    /// A spacing, a mass or a stiffness that is not positive and finite, or a damping or diagonal factor below zero.
    #[error("{name} is {value:e}: give a finite number {}", if *.zero_allowed { "of at least 0" } else { "above 0" })]
    Value {
        /// What is wrong.
        name: &'static str,
        /// What was found.
        value: f64,
        /// Whether zero would do.
        zero_allowed: bool,
    },
    /// Steps that grow whatever is done.
    #[error(
        "a time step of {time_step:e} with mass {mass:e} and damping {damping:e} makes the lattice explode (largest stiffness \
         {stiffness:e}): give a step below {limit:e}, or more mass"
    )]
    Unstable {
        /// The step that was asked for.
        time_step: f64,
        /// The step above which the system is unstable.
        limit: f64,
        /// m.
        mass: f64,
        /// c.
        damping: f64,
        /// Largest eigenvalue of the stiffness matrix.
        stiffness: f64,
    },
    /// A position that is not a number or infinite.
    #[error(
        "the lattice exploded at step {step}: give a smaller time step, more mass or weaker forces"
    )]
    Diverged {
        /// Steps since the lattice was built.
        step: u64,
    },
}

/// A number that must be finite and positive, or not negative.
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
