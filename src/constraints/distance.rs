//! Distance of two points: C = |p1 - p2| - d.

use nalgebra::{Matrix3, Point3, Vector3};

use super::kernel::MOST_NUMBERS;
use super::lanes::{dot, neg, scale, sub};
use super::stencil::Blocks;
use super::{Constraint, Kernel, Lane, LaneConstraint, Scalar, Several, safe_norm};

/// Keeps two particles `rest` [m] apart: C = |p1 - p2| - d \[mueller2007\], gradient (u, -u) with
/// u = (p1 - p2) / |p1 - p2|. Undefined where both points coincide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// The two particles.
    pub points: [u32; 2],
    /// Rest length [m].
    pub rest: f64,
}

impl Constraint<2> for Distance {
    const NAME: &'static str = "distance";

    #[inline]
    fn points(&self) -> [u32; 2] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 2]) -> S {
        let d = x[0] - x[1];
        d.dot(&d).sqrt() - S::of(self.rest)
    }

    #[inline(always)]
    fn value_and_gradient(&self, x: &[Point3<f64>; 2]) -> Option<(f64, [Vector3<f64>; 2])> {
        let points = [x[0].coords.into(), x[1].coords.into()];
        let Several {
            value,
            gradient: [u, v],
            usual,
            ..
        } = Self::in_lanes::<f64>((), self.numbers(), &points);
        if usual {
            Some((value, [u.into(), v.into()]))
        } else {
            self.unusual(x)
        }
    }

    fn kernel() -> Kernel<Self, 2> {
        Kernel::in_lanes().with_hessian(Self::hessian)
    }
}

impl LaneConstraint<2> for Distance {
    const UNIT: bool = true;
    const NUMBERS: usize = 1;

    #[inline(always)]
    fn numbers(&self) -> [f64; MOST_NUMBERS] {
        [self.rest, 0.0, 0.0]
    }

    #[inline(always)]
    fn in_lanes<N: Lane>(
        machine: N::Machine,
        [rest, ..]: [N; MOST_NUMBERS],
        x: &[[N; 3]; 2],
    ) -> Several<N, 2> {
        beyond(rest, machine, x)
    }
}

/// C and its gradient for several rest lengths [m], one per lane.
#[inline(always)]
fn beyond<N: Lane>(rest: N, machine: N::Machine, x: &[[N; 3]; 2]) -> Several<N, 2> {
    let d = sub(x[0], x[1]);
    let squared = dot(d, d);
    // Squares of components beyond these bounds lose digits or overflow.
    let usual = N::splat(machine, 1e-280).lt(squared) & squared.lt(N::splat(machine, 1e280));
    let length = squared.sqrt();
    let u = scale(d, N::splat(machine, 1.0) / length);
    let value = length - rest;
    Several {
        value,
        gradient: [u, neg(u)],
        branch: value,
        usual,
    }
}

impl Distance {
    /// Second derivative [N/m] of the energy of a spring of `stiffness` k [N/m]: the block of one
    /// point with itself is k (u u^T + (1 - d/l) (1 - u u^T)), the block of both points its
    /// negative. Across the spring only its tension acts. With `convex`, a negative tension counts
    /// as zero there.
    pub(super) fn hessian(
        &self,
        x: &[Point3<f64>; 2],
        stiffness: f64,
        convex: bool,
    ) -> Option<Blocks<2>> {
        let d = x[0] - x[1];
        let length = d.norm();
        if length == 0.0 {
            return None;
        }
        let unit = d / length;
        let tension = 1.0 - self.rest / length;
        let across = if convex { tension.max(0.0) } else { tension };
        let along = unit * unit.transpose();
        let block = (along + (Matrix3::identity() - along) * across) * stiffness;
        Some([[block, -block], [-block, block]])
    }

    /// For points that coincide, are very close together, are very far apart, or are not numbers.
    #[cold]
    fn unusual(&self, x: &[Point3<f64>; 2]) -> Option<(f64, [Vector3<f64>; 2])> {
        let d = x[0] - x[1];
        let length = safe_norm(&d);
        if length == 0.0 {
            return None;
        }
        let u = d / length;
        Some((length - self.rest, [u, -u]))
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<2> for Distance {
    const DEGREE: i32 = 1;
    const PARAMETERS: &'static [super::Parameter] = &[super::Parameter::Length];

    fn from_parameters(points: [u32; 2], parameters: &[f64]) -> Self {
        Self {
            points,
            rest: parameters[0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constraints::quadratic;

    #[test]
    fn the_second_derivative_that_is_written_out_is_that_of_the_value() {
        for (rest, to) in [
            (1.0, [0.3, -0.9, 1.2]),
            (2.0, [0.4, 0.1, 0.2]),
            (0.1, [0.05, 0.05, 0.05]),
        ] {
            let spring = Distance {
                points: [0, 1],
                rest,
            };
            let x = [Point3::new(0.2, 0.1, -0.3), Point3::from(to)];
            for convex in [false, true] {
                let own = spring.hessian(&x, 3.0, convex).expect("a direction");
                let general = quadratic::hessian(&spring, &x, 3.0, convex).expect("a direction");
                for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    assert!(
                        (own[i][j] - general[i][j]).norm() <= 1e-12 * general[i][j].norm(),
                        "{rest} {convex}"
                    );
                    assert!(general[i][j].norm() > 1.0);
                }
            }
        }
    }
}
