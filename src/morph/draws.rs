//! Seeded random numbers, equal on every machine (SplitMix64).

use nalgebra::{Quaternion, UnitQuaternion};

use crate::random;

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub(super) struct Draws(u64);

impl Draws {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f64 {
        random::unit(&mut self.0)
    }

    /// Uniform among 0..count, which is at least 1.
    pub fn index(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count - 1)
    }

    /// Uniform over all rotations: a random direction in four dimensions.
    pub fn rotation(&mut self) -> UnitQuaternion<f64> {
        loop {
            let mut number = || 2.0 * self.unit() - 1.0;
            let q = Quaternion::new(number(), number(), number(), number());
            let square = q.norm_squared();
            if square > 0.01 && square <= 1.0 {
                return UnitQuaternion::new_normalize(q);
            }
        }
    }
}
