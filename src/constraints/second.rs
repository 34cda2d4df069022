//! Hyper-dual numbers with gradient and Hessian. They give the derivatives of a constraint for
//! Newton's method from its value alone.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use nalgebra::{Matrix3, Point3, Vector3};
use num_traits::{One, Zero};

use super::Scalar;
use super::angle::atan2;

/// A function's value, its gradient with respect to `K` points and its Hessian as 3 by 3 blocks.
///
/// Derivatives follow the chain rule. They differ from the analytic ones only by rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Second<const K: usize> {
    /// The value.
    pub value: f64,
    /// Derivative with respect to each point.
    pub gradient: [Vector3<f64>; K],
    /// Second derivative with respect to each pair of points.
    pub hessian: [[Matrix3<f64>; K]; K],
}

impl<const K: usize> Second<K> {
    /// The points as independent variables.
    pub fn variables(x: &[Point3<f64>; K]) -> [Point3<Self>; K] {
        std::array::from_fn(|k| {
            Point3::from(std::array::from_fn(|c| {
                let mut variable = Self::of(x[k][c]);
                variable.gradient[k][c] = 1.0;
                variable
            }))
        })
    }

    /// f(self), from f and its first two derivatives at the value.
    fn chain(mut self, [f, f1, f2]: [f64; 3]) -> Self {
        for i in 0..K {
            for j in 0..K {
                let outer = self.gradient[i] * self.gradient[j].transpose();
                self.hessian[i][j] = self.hessian[i][j] * f1 + outer * f2;
            }
        }
        self.gradient = self.gradient.map(|g| g * f1);
        Self { value: f, ..self }
    }

    /// f(a, b), from f, its gradient and its second derivatives (aa, ab, bb) at the values.
    fn chain_two(
        a: &Self,
        b: &Self,
        f: f64,
        [fa, fb]: [f64; 2],
        [faa, fab, fbb]: [f64; 3],
    ) -> Self {
        let mut result = Self::of(f);
        for i in 0..K {
            result.gradient[i] = a.gradient[i] * fa + b.gradient[i] * fb;
            for j in 0..K {
                let (ai, bi) = (a.gradient[i], b.gradient[i]);
                let (aj, bj) = (a.gradient[j].transpose(), b.gradient[j].transpose());
                result.hessian[i][j] = a.hessian[i][j] * fa
                    + b.hessian[i][j] * fb
                    + (ai * faa + bi * fab) * aj
                    + (ai * fab + bi * fbb) * bj;
            }
        }
        result
    }
}

impl<const K: usize> Add for Second<K> {
    type Output = Self;
    fn add(mut self, o: Self) -> Self {
        self += o;
        self
    }
}

impl<const K: usize> AddAssign for Second<K> {
    fn add_assign(&mut self, o: Self) {
        self.value += o.value;
        for i in 0..K {
            self.gradient[i] += o.gradient[i];
            (0..K).for_each(|j| self.hessian[i][j] += o.hessian[i][j]);
        }
    }
}

impl<const K: usize> Neg for Second<K> {
    type Output = Self;
    fn neg(self) -> Self {
        Self {
            value: -self.value,
            gradient: self.gradient.map(|g| -g),
            hessian: self.hessian.map(|r| r.map(|h| -h)),
        }
    }
}

impl<const K: usize> Sub for Second<K> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl<const K: usize> SubAssign for Second<K> {
    fn sub_assign(&mut self, o: Self) {
        *self += -o;
    }
}

impl<const K: usize> Mul for Second<K> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self::chain_two(
            &self,
            &o,
            self.value * o.value,
            [o.value, self.value],
            [0.0, 1.0, 0.0],
        )
    }
}

impl<const K: usize> MulAssign for Second<K> {
    fn mul_assign(&mut self, o: Self) {
        *self = *self * o;
    }
}

impl<const K: usize> Div for Second<K> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let (q, per) = (self.value / o.value, 1.0 / o.value);
        Self::chain_two(
            &self,
            &o,
            q,
            [per, -q * per],
            [0.0, -per * per, 2.0 * q * per * per],
        )
    }
}

impl<const K: usize> Zero for Second<K> {
    fn zero() -> Self {
        Self::of(0.0)
    }
    fn is_zero(&self) -> bool {
        *self == Self::zero()
    }
}

impl<const K: usize> One for Second<K> {
    fn one() -> Self {
        Self::of(1.0)
    }
}

impl<const K: usize> Scalar for Second<K> {
    fn of(value: f64) -> Self {
        Self {
            value,
            gradient: [Vector3::zeros(); K],
            hessian: [[Matrix3::zeros(); K]; K],
        }
    }
    fn real(self) -> f64 {
        self.value
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain([root, 0.5 / root, -0.25 / (root * self.value)])
    }
    fn atan2(self, x: Self) -> Self {
        let (a, b) = (self.value, x.value);
        let square = a * a + b * b;
        let (mixed, twice) = (
            (a * a - b * b) / (square * square),
            2.0 * a * b / (square * square),
        );
        Self::chain_two(
            &self,
            &x,
            atan2(a, b),
            [b / square, -a / square],
            [-twice, mixed, twice],
        )
    }
}
