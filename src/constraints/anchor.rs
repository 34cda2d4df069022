//! Distance of a point from a fixed position: C = |p - a|.

use nalgebra::{Point3, Vector3};

use super::{Constraint, Scalar, safe_norm};

/// Attracts a particle to `target` [m]: C = |p - a|, gradient (p - a)/|p - a|. Undefined at the
/// target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// The particle.
    pub points: [u32; 1],
    /// Fixed position [m].
    pub target: Point3<f64>,
}

impl Constraint<1> for Anchor {
    const NAME: &'static str = "anchor";

    #[inline]
    fn points(&self) -> [u32; 1] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 1]) -> S {
        let d = x[0] - self.target.map(S::of);
        d.dot(&d).sqrt()
    }

    #[inline]
    fn value_and_gradient(&self, x: &[Point3<f64>; 1]) -> Option<(f64, [Vector3<f64>; 1])> {
        let d = x[0] - self.target;
        let length = safe_norm(&d);
        if length == 0.0 {
            None
        } else {
            Some((length, [d / length]))
        }
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<1> for Anchor {
    const DEGREE: i32 = 1;
    const PARAMETERS: &'static [super::Parameter] = &[
        super::Parameter::Coordinate(0),
        super::Parameter::Coordinate(1),
        super::Parameter::Coordinate(2),
    ];

    fn from_parameters(points: [u32; 1], parameters: &[f64]) -> Self {
        Self {
            points,
            target: Point3::new(parameters[0], parameters[1], parameters[2]),
        }
    }
}
