//! Dual numbers with a bound on their rounding error: the independent oracle of every gradient.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use num_traits::{One, Zero};

use crate::constraints::Scalar;

/// A value and a first-order bound on its rounding error, in units of `f64::EPSILON` (running error analysis).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedNumber {
    /// The value.
    pub value: f64,
    /// Sum of the absolute values of rounded terms.
    pub error: f64,
}

impl TrackedNumber {
    fn exact(value: f64) -> Self {
        Self { value, error: 0.0 }
    }
    fn rounded(value: f64, inherited: f64) -> Self {
        Self {
            value,
            error: inherited + value.abs(),
        }
    }
    fn plus(self, o: Self) -> Self {
        Self::rounded(self.value + o.value, self.error + o.error)
    }
    fn times(self, o: Self) -> Self {
        Self::rounded(
            self.value * o.value,
            self.error * o.value.abs() + o.error * self.value.abs(),
        )
    }
    fn over(self, o: Self) -> Self {
        let q = self.value / o.value;
        Self::rounded(q, (self.error + o.error * q.abs()) / o.value.abs())
    }
    fn negated(self) -> Self {
        Self {
            value: -self.value,
            error: self.error,
        }
    }
}

/// A value and its derivative in one direction, both with a bound on the rounding error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual {
    /// The value.
    pub real: TrackedNumber,
    /// Derivative.
    pub slope: TrackedNumber,
}

impl Dual {
    /// The variable itself: slope 1.
    pub fn variable(value: f64) -> Self {
        Self {
            real: TrackedNumber::exact(value),
            slope: TrackedNumber::exact(1.0),
        }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self {
            real: self.real.plus(o.real),
            slope: self.slope.plus(o.slope),
        }
    }
}
impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self {
            real: self.real.negated(),
            slope: self.slope.negated(),
        }
    }
}
impl Sub for Dual {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}
impl Mul for Dual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self {
            real: self.real.times(o.real),
            slope: self.slope.times(o.real).plus(self.real.times(o.slope)),
        }
    }
}
impl Div for Dual {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let q = self.real.over(o.real);
        Self {
            real: q,
            slope: self.slope.plus(q.times(o.slope).negated()).over(o.real),
        }
    }
}
impl AddAssign for Dual {
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}
impl SubAssign for Dual {
    fn sub_assign(&mut self, o: Self) {
        *self = *self - o;
    }
}
impl MulAssign for Dual {
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}
impl Zero for Dual {
    fn zero() -> Self {
        Self::of(0.0)
    }
    fn is_zero(&self) -> bool {
        self.real.value == 0.0 && self.slope.value == 0.0
    }
}
impl One for Dual {
    fn one() -> Self {
        Self::of(1.0)
    }
}

impl Scalar for Dual {
    fn of(value: f64) -> Self {
        Self {
            real: TrackedNumber::exact(value),
            slope: TrackedNumber::exact(0.0),
        }
    }
    fn real(self) -> f64 {
        self.real.value
    }
    fn sqrt(self) -> Self {
        let root = self.real.value.sqrt();
        let real = TrackedNumber::rounded(root, self.real.error / (2.0 * root));
        Self {
            real,
            slope: self.slope.over(real.plus(real)),
        }
    }
    fn atan2(self, x: Self) -> Self {
        let y = self;
        let square = x.real.times(x.real).plus(y.real.times(y.real));
        let inherited =
            (x.real.value.abs() * y.real.error + y.real.value.abs() * x.real.error) / square.value;
        let real = TrackedNumber::rounded(libm::atan2(y.real.value, x.real.value), inherited);
        let slope = x
            .real
            .times(y.slope)
            .plus(y.real.times(x.slope).negated())
            .over(square);
        Self { real, slope }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_known_functions() {
        let x = Dual::variable(0.7);
        let root = (x * x * x).sqrt();
        assert!((root.slope.value - 1.5 * 0.7_f64.sqrt()).abs() <= 1e-15);
        let quotient = Dual::of(1.0) / x;
        assert!((quotient.slope.value + 1.0 / 0.49).abs() <= 1e-14);
        let angle = x.atan2(Dual::of(2.0));
        assert!((angle.slope.value - 2.0 / (4.0 + 0.49)).abs() <= 1e-15);
    }

    #[test]
    fn cancellation_is_seen_in_the_bound() {
        let x = Dual::variable(1.0);
        let lost = (x + Dual::of(1e12)) - Dual::of(1e12);
        assert!(lost.real.error >= 1e12);
    }
}
