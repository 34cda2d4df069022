//! Volume of a tetrahedron: C = (p2 - p1) . ((p3 - p1) x (p4 - p1)) / 6 - V0.

use nalgebra::{Point3, Vector3};

use super::{Constraint, Scalar};

/// Keeps the signed volume of a tetrahedron at `rest` [m^3]. Value and gradient contain the same
/// factor 1/6 (errata A06, A07). The gradient is defined everywhere. It is zero where all four
/// points are on one line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TetrahedronVolume {
    /// The four particles. The volume is positive if p2, p3, p4 are in counter-clockwise order seen
    /// from the side opposite to p1.
    pub points: [u32; 4],
    /// Rest volume [m^3].
    pub rest: f64,
}

impl Constraint<4> for TetrahedronVolume {
    const NAME: &'static str = "tetrahedron volume";

    #[inline]
    fn points(&self) -> [u32; 4] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 4]) -> S {
        let [a, b, c] = [x[1] - x[0], x[2] - x[0], x[3] - x[0]];
        a.dot(&b.cross(&c)) / S::of(6.0) - S::of(self.rest)
    }

    #[inline]
    fn value_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let [a, b, c] = [x[1] - x[0], x[2] - x[0], x[3] - x[0]];
        let bc = b.cross(&c);
        let g2 = bc / 6.0;
        let g3 = c.cross(&a) / 6.0;
        let g4 = a.cross(&b) / 6.0;
        Some((a.dot(&bc) / 6.0 - self.rest, [-(g2 + g3 + g4), g2, g3, g4]))
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<4> for TetrahedronVolume {
    const DEGREE: i32 = 3;
    const PARAMETERS: &'static [super::Parameter] = &[super::Parameter::Volume];

    fn from_parameters(points: [u32; 4], parameters: &[f64]) -> Self {
        Self {
            points,
            rest: parameters[0],
        }
    }
}
