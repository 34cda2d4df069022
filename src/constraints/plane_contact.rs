//! Height of a point above a plane: C = n.(p - a) - h, the contact of a muscle vertex with a bone.

use nalgebra::{Point3, Vector3};

use super::{Constraint, Scalar};

/// Height of a particle above the plane through `origin` [m] with unit `normal`, minus `thickness`
/// [m]. Contact holds where C >= 0, so only negative values are corrected. The gradient is the
/// normal everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneContact {
    /// The particle.
    pub points: [u32; 1],
    /// A point of the plane [m].
    pub origin: Point3<f64>,
    /// Unit normal, away from the bone.
    pub normal: Vector3<f64>,
    /// Least height [m].
    pub thickness: f64,
}

impl Constraint<1> for PlaneContact {
    const NAME: &'static str = "plane contact";

    #[inline]
    fn points(&self) -> [u32; 1] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 1]) -> S {
        (x[0] - self.origin.map(S::of)).dot(&self.normal.map(S::of)) - S::of(self.thickness)
    }

    #[inline]
    fn value_and_gradient(&self, x: &[Point3<f64>; 1]) -> Option<(f64, [Vector3<f64>; 1])> {
        Some((
            (x[0] - self.origin).dot(&self.normal) - self.thickness,
            [self.normal],
        ))
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<1> for PlaneContact {
    const DEGREE: i32 = 1;
    const PARAMETERS: &'static [super::Parameter] = &[
        super::Parameter::Coordinate(0),
        super::Parameter::Coordinate(1),
        super::Parameter::Coordinate(2),
        super::Parameter::Direction(0),
        super::Parameter::Direction(1),
        super::Parameter::Direction(2),
        super::Parameter::Length,
    ];

    fn from_parameters(points: [u32; 1], p: &[f64]) -> Self {
        Self {
            points,
            origin: Point3::new(p[0], p[1], p[2]),
            normal: Vector3::new(p[3], p[4], p[5]),
            thickness: p[6],
        }
    }
}
