//! Distance of two points across a direction: C = |e x u|, e = p1 - p2.

use nalgebra::{Matrix3, Point3, Vector3};

use super::stencil::Blocks;
use super::{Constraint, Kernel, Scalar, safe_norm};

/// Keeps an edge e = p1 - p2 along a direction u: C = |e x u|, which is the distance across u times the
/// length of u. With the stiffness T/d, an edge of rest length d resists a small turn as if it were under
/// the tension T, but pulls at nothing where it lies along u. Gradient for p1: u x n, with the unit vector
/// n along e x u. Undefined where the edge lies along u.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// The ends of the edge.
    pub points: [u32; 2],
    /// The direction, as long as the root of its share in the stiffness.
    pub along: Vector3<f64>,
}

impl Direction {
    fn turn(&mut self, along: &Vector3<f64>) {
        self.along = *along;
    }

    /// The energy is quadratic: k (u.u I - u u^T) also where the gradient of C is undefined.
    fn hessian(&self, _: &[Point3<f64>; 2], stiffness: f64, _: bool) -> Option<Blocks<2>> {
        let u = self.along;
        let block =
            (Matrix3::from_diagonal_element(u.norm_squared()) - u * u.transpose()) * stiffness;
        Some([[block, -block], [-block, block]])
    }
}

impl Constraint<2> for Direction {
    const NAME: &'static str = "direction";

    #[inline]
    fn points(&self) -> [u32; 2] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 2]) -> S {
        let across = (x[0] - x[1]).cross(&self.along.map(S::of));
        across.dot(&across).sqrt()
    }

    #[inline]
    fn value_and_gradient(&self, x: &[Point3<f64>; 2]) -> Option<(f64, [Vector3<f64>; 2])> {
        let across = (x[0] - x[1]).cross(&self.along);
        let value = safe_norm(&across);
        if value == 0.0 {
            return None;
        }
        let gradient = self.along.cross(&(across / value));
        Some((value, [gradient, -gradient]))
    }

    fn kernel() -> Kernel<Self, 2> {
        Kernel::one_by_one()
            .with_hessian(Self::hessian)
            .with_turning(Self::turn)
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<2> for Direction {
    const DEGREE: i32 = 1;
    const PARAMETERS: &'static [super::Parameter] = &[
        super::Parameter::Direction(0),
        super::Parameter::Direction(1),
        super::Parameter::Direction(2),
    ];

    fn from_parameters(points: [u32; 2], parameters: &[f64]) -> Self {
        let along = Vector3::new(parameters[0], parameters[1], parameters[2]);
        Self { points, along }
    }
}
