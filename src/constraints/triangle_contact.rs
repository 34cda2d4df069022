//! Height of a fixed point above a moving triangle: C = n.(a - sum b_i p_i) - h, the contact of a
//! bone vertex with a muscle.

use nalgebra::{Point3, Vector3};

use super::{Constraint, Scalar};

/// Height of the bone vertex `origin` [m] above the point of a triangle with barycentric `weights`,
/// along the unit `normal` out of the muscle, minus `thickness` [m]. Contact holds where C >= 0.
/// The gradient is -b_i n everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleContact {
    /// The corners.
    pub points: [u32; 3],
    /// The bone vertex [m].
    pub origin: Point3<f64>,
    /// Unit normal, out of the muscle.
    pub normal: Vector3<f64>,
    /// Barycentric weights with sum 1.
    pub weights: [f64; 3],
    /// Least height [m].
    pub thickness: f64,
}

impl Constraint<3> for TriangleContact {
    const NAME: &'static str = "triangle contact";

    #[inline]
    fn points(&self) -> [u32; 3] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 3]) -> S {
        // Differences to the first corner: a translation changes no bit.
        let offset =
            (x[1] - x[0]) * S::of(self.weights[1]) + (x[2] - x[0]) * S::of(self.weights[2]);
        let height = self.origin.map(S::of) - x[0] - offset;
        height.dot(&self.normal.map(S::of)) - S::of(self.thickness)
    }

    #[inline]
    fn value_and_gradient(&self, x: &[Point3<f64>; 3]) -> Option<(f64, [Vector3<f64>; 3])> {
        Some((self.value(x), self.weights.map(|w| self.normal * -w)))
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<3> for TriangleContact {
    const DEGREE: i32 = 1;
    const PARAMETERS: &'static [super::Parameter] = &[
        super::Parameter::Coordinate(0),
        super::Parameter::Coordinate(1),
        super::Parameter::Coordinate(2),
        super::Parameter::Direction(0),
        super::Parameter::Direction(1),
        super::Parameter::Direction(2),
        super::Parameter::Weight,
        super::Parameter::Weight,
        super::Parameter::Weight,
        super::Parameter::Length,
    ];

    fn from_parameters(points: [u32; 3], p: &[f64]) -> Self {
        Self {
            points,
            origin: Point3::new(p[0], p[1], p[2]),
            normal: Vector3::new(p[3], p[4], p[5]),
            weights: [p[6], p[7], p[8]],
            thickness: p[9],
        }
    }
}
