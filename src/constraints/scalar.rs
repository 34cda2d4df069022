//! The scalar types of a constraint's value.

use std::ops::{Div, Neg};

use nalgebra::{ClosedAddAssign, ClosedMulAssign, ClosedSubAssign};
use num_traits::{One, Zero};

/// A real number, or a number with derivatives (see `testing::Dual`).
pub trait Scalar:
    nalgebra::Scalar
    + Copy
    + Zero
    + One
    + ClosedAddAssign
    + ClosedSubAssign
    + ClosedMulAssign
    + Neg<Output = Self>
    + Div<Output = Self>
{
    /// The constant `value`.
    fn of(value: f64) -> Self;
    /// The value without derivatives.
    fn real(self) -> f64;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Angle of the point `(x, self)` in (-pi, pi].
    fn atan2(self, x: Self) -> Self;
}

impl Scalar for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn real(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn atan2(self, x: Self) -> Self {
        libm::atan2(self, x)
    }
}
