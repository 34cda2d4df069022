//! Seeded random bits, equal on every machine (SplitMix64), for the library and its tests.

use nalgebra::{Quaternion, UnitQuaternion};

/// Uniform numbers in `0..1` from a seed.
///
/// ```
/// let mut next = pliant::random::units(7);
/// let first = next();
/// assert!((0.0..1.0).contains(&first) && first != next());
/// assert_eq!(first, pliant::random::units(7)());
/// ```
pub fn units(seed: u64) -> impl FnMut() -> f64 {
    let mut random = Random::new(seed);
    move || random.unit()
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `0..1`.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in `0..count`; `count` is at least 1.
    pub fn index(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count - 1)
    }

    /// Uniform over all rotations: a direction in four dimensions.
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
