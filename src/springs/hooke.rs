//! The linear spring.

use super::spring_set::{Law, SpringSet};
use crate::constraints::spring::SpringLaw;

/// Hooke's law: the tension is `stiffness (length - rest)`; the force on point i is `k (|x_ij| - l)
/// x_ij/|x_ij|` with `x_ij = x_j - x_i`.
///
/// With rest length 0 the force is `k x_ij`, which needs no direction (errata B03). Two coincident
/// points of a spring with a positive rest length have no direction: the force is then zero (errata
/// M1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hooke {
    /// Rest length [m].
    pub rest: f64,
    /// Stiffness [N/m]; a formula can give negative values, see [`super::stiffness`].
    pub stiffness: f64,
}

/// Linear springs.
pub type Springs = SpringSet<Hooke>;

impl Law for Hooke {
    const NAME: &'static str = "springs";

    fn parameters(&self) -> [f64; 3] {
        [self.rest, self.stiffness, 0.0]
    }

    fn is_valid(&self) -> bool {
        self.rest >= 0.0 && self.rest.is_finite() && self.stiffness.is_finite()
    }
}

impl SpringLaw for Hooke {
    fn energy(&self, length: f64) -> f64 {
        let stretch = length - self.rest;
        0.5 * self.stiffness * stretch * stretch
    }

    fn tension(&self, length: f64) -> f64 {
        self.stiffness * (length - self.rest)
    }

    fn tension_per_length(&self, length: f64) -> f64 {
        if self.rest == 0.0 {
            self.stiffness
        } else if length > 0.0 {
            self.stiffness * (length - self.rest) / length
        } else {
            0.0
        }
    }

    fn slope(&self, _: f64) -> f64 {
        self.stiffness
    }
}
