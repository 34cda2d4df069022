//! Until nothing moves.

use super::{Lattice, LatticeError, Number};

/// When a lattice counts as at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Largest move of a point in a step \[m\], below which it rests.
    pub threshold: f64,
    /// Steps in a row that must stay below: what swings stands still for a moment at each turn.
    pub quiet: u64,
    /// Steps, at most.
    pub limit: u64,
}

/// How a lattice came to rest, or did not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settled {
    /// Steps up to the last one whose largest move was not below the threshold: what came after only proved it.
    pub steps: u64,
    /// Whether it stayed below as long as it had to.
    pub at_rest: bool,
    /// Largest move of a point in the last step \[m\].
    pub last_move: f64,
}

impl<F: Number> Lattice<F> {
    /// Steps until no point moves as far as the threshold, for as many steps as asked, or until the limit.
    ///
    /// # Errors
    /// [`LatticeError::Value`] for a threshold that is not positive, [`LatticeError::Diverged`] if the lattice explodes.
    pub fn until_rest(&mut self, rest: &Rest) -> Result<Settled, LatticeError> {
        super::value("the threshold of rest", rest.threshold, false)?;
        let (mut step, mut last, mut last_move) = (0, 0, 0.0);
        while step < rest.limit {
            // The first step of a pair must not be the one at which this ends.
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
                    return Ok(Settled {
                        steps: last,
                        at_rest: true,
                        last_move,
                    });
                }
            }
        }
        Ok(Settled {
            steps: last,
            at_rest: false,
            last_move,
        })
    }
}
