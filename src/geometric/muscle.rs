//! A geometric muscle: a chain on its frame, with the range of its lengths.

use super::chain::{Chain, ChainError, ChainShape};
use super::frame::{Frame, FrameError};

/// Relative reduction of a greatest length at which rounding makes a radius negative.
const ROUNDED: f64 = 1e-12;

/// A muscle on its frame, with its range of lengths.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometricMuscle {
    /// The chain.
    pub chain: Chain,
    /// The bars; `None` without a frame.
    pub frame: Option<Frame>,
    /// Shortest and longest length \[m\]: the intersection of the given range and the ranges of the
    /// frame and of the radii.
    pub range: [f64; 2],
}

/// Error of [`GeometricMuscle::new`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeometricError {
    /// The chain is invalid, or cannot take its shortest or longest length.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// The frame has no place for the chain at rest.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

impl GeometricMuscle {
    /// Creates the muscle at rest, with `insert` nodes between each two of `shape`. `parts` are the
    /// shortest and the longest length relative to the length at rest. A muscle without a positive
    /// growth multiplier has its length at rest alone.
    ///
    /// # Errors
    /// An invalid shape, a frame without a place for it, or an end of the range that it cannot take.
    pub fn new(
        shape: &ChainShape,
        insert: usize,
        frame: Option<Frame>,
        parts: [f64; 2],
    ) -> Result<Self, GeometricError> {
        // Errors of a shape name its nodes as given, so the check precedes the insertion.
        Chain::new(shape.clone())?;
        let chain = Chain::new(shape.refined(insert))?;
        if let Some(frame) = &frame {
            frame.place(chain.length())?;
        }
        let mut range = parts.map(|part| part * chain.length());
        if let Some([least, most]) = frame.map(|f| f.range()) {
            range = [range[0].max(least), range[1].min(most)];
        }
        range[1] = range[1].min(chain.longest());
        if shape.growth.iter().all(|growth| *growth == 0.0) {
            range = [chain.length(); 2];
        }
        let mut ends = chain.clone();
        if let Err(ChainError::TooLong { .. }) = ends.set_length(range[1]) {
            range[1] = (range[1] * (1.0 - ROUNDED)).max(chain.length());
        }
        for end in range {
            ends.set_length(end)?;
        }
        Ok(Self {
            chain,
            frame,
            range,
        })
    }

    /// The length in a frame of a cycle of `count` frames: from rest to the longest, to the shortest
    /// and back \[m\].
    pub fn length_at(&self, frame: usize, count: usize) -> f64 {
        let ([least, most], rest) = (self.range, self.chain.rest().length);
        let (k, count) = ((frame % count.max(1)) as f64, count.max(1) as f64);
        let s = libm::sin(2.0 * std::f64::consts::PI * k / count);
        let length = if s >= 0.0 {
            rest + s * (most - rest)
        } else {
            rest + s * (rest - least)
        };
        length.clamp(least, most)
    }
}
