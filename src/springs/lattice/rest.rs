//! Simulation of a lattice to rest.

use super::{Lattice, LatticeError, Number};

/// Criterion of rest of a lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatticeRestSettings {
    /// Greatest move of a point in a step at rest \[m\].
    pub threshold: f64,
    /// Number of successive steps below the threshold: an oscillation pauses at each turn.
    pub quiet: u64,
    /// Greatest number of steps.
    pub limit: u64,
}

/// Result of a run to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatticeSettled {
    /// Number of steps up to the last one with a move at or above the threshold; later steps only
    /// confirm the rest.
    pub steps: u64,
    /// True if the lattice stayed below the threshold long enough.
    pub at_rest: bool,
    /// Largest move of a point in the last step \[m\].
    pub last_move: f64,
}

impl<F: Number> Lattice<F> {
    /// Makes steps until no point moves as far as the threshold for the given number of steps, or
    /// until the limit.
    ///
    /// # Errors
    /// [`LatticeError::Value`] for a threshold that is not positive, [`LatticeError::Diverged`] if
    /// the lattice diverges.
    pub fn until_rest(
        &mut self,
        rest: &LatticeRestSettings,
    ) -> Result<LatticeSettled, LatticeError> {
        super::value("the threshold of rest", rest.threshold, false)?;
        let (mut step, mut last, mut last_move) = (0, 0, 0.0);
        while step < rest.limit {
            // The end must not fall on the first step of a pair.
            let pair = rest.limit - step >= 2 && step + 1 - last < rest.quiet;
            let moves = if pair {
                self.measured_pair()?.map(Some)
            } else {
                [Some(self.measured_step()?), None]
            };
            for moved in moves.into_iter().flatten() {
                (step, last_move) = (step + 1, moved);
                if moved >= rest.threshold {
                    last = step;
                } else if step - last >= rest.quiet {
                    return Ok(LatticeSettled {
                        steps: last,
                        at_rest: true,
                        last_move,
                    });
                }
            }
        }
        Ok(LatticeSettled {
            steps: last,
            at_rest: false,
            last_move,
        })
    }
}
