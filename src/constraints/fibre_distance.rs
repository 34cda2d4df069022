//! Distance of two points along contracting fibres: C = |p1 - p2| - d (1 - a s).

use nalgebra::{Point3, Vector3};

use super::distance::Distance;
use super::kernel::MOST_NUMBERS;
use super::stencil::Blocks;
use super::{Constraint, Kernel, Lane, LaneConstraint, Scalar, Several};

/// Keeps two particles at a distance that shortens with the fibres: C = |p1 - p2| - d (1 - a s), with
/// the rest length d [m] without shortening, the share a = (u.v)^2 for an edge along u and a fibre along
/// v, and the shortening s of the fibres. A line element along u of a body with the strain -s v v^T has,
/// to first order, the strain -s (u.v)^2. The gradient is that of [`Distance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FibreDistance {
    edge: Distance,
    /// Rest length without shortening [m].
    rest: f64,
    along: f64,
}

impl FibreDistance {
    /// An edge at its rest length without shortening, with its share `along` (0..1) of a shortening.
    pub fn new(edge: Distance, along: f64) -> Self {
        Self {
            edge,
            rest: edge.rest,
            along,
        }
    }

    /// Rest length without shortening [m].
    pub fn rest(&self) -> f64 {
        self.rest
    }

    /// Share of the shortening along the edge.
    pub fn along(&self) -> f64 {
        self.along
    }

    /// The same edge after a shortening of the fibres, relative to their length at rest.
    #[must_use]
    pub fn shortened(mut self, shortening: f64) -> Self {
        self.shorten(shortening);
        self
    }

    fn shorten(&mut self, shortening: f64) {
        self.edge.rest = self.rest * (1.0 - self.along * shortening);
    }

    fn hessian(&self, x: &[Point3<f64>; 2], stiffness: f64, convex: bool) -> Option<Blocks<2>> {
        self.edge.hessian(x, stiffness, convex)
    }
}

impl Constraint<2> for FibreDistance {
    const NAME: &'static str = "fibre distance";

    #[inline]
    fn points(&self) -> [u32; 2] {
        self.edge.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 2]) -> S {
        self.edge.value(x)
    }

    #[inline(always)]
    fn value_and_gradient(&self, x: &[Point3<f64>; 2]) -> Option<(f64, [Vector3<f64>; 2])> {
        self.edge.value_and_gradient(x)
    }

    fn kernel() -> Kernel<Self, 2> {
        Kernel::in_lanes()
            .with_hessian(Self::hessian)
            .with_shortening(Self::shorten)
    }
}

impl LaneConstraint<2> for FibreDistance {
    const UNIT: bool = true;
    const NUMBERS: usize = Distance::NUMBERS;

    #[inline(always)]
    fn numbers(&self) -> [f64; MOST_NUMBERS] {
        self.edge.numbers()
    }

    #[inline(always)]
    fn in_lanes<N: Lane>(
        machine: N::Machine,
        numbers: [N; MOST_NUMBERS],
        x: &[[N; 3]; 2],
    ) -> Several<N, 2> {
        Distance::in_lanes(machine, numbers, x)
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<2> for FibreDistance {
    const DEGREE: i32 = 1;
    const PARAMETERS: &'static [super::Parameter] = &[super::Parameter::Length];

    fn from_parameters(points: [u32; 2], parameters: &[f64]) -> Self {
        let rest = parameters[0];
        Self::new(Distance { points, rest }, SHARE).shortened(SHORTENED)
    }
}

/// Share and shortening of the conformance suite.
#[cfg(any(test, feature = "testing"))]
const SHARE: f64 = 0.75;
#[cfg(any(test, feature = "testing"))]
const SHORTENED: f64 = 0.25;

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Unit};

    /// The rest lengths follow a body that contracts along its fibres, to second order in the
    /// shortening.
    #[test]
    fn a_body_that_contracts_along_its_fibres_leaves_no_edge_strained() {
        let fibre = Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5));
        let x = [Point3::new(0.1, 0.2, 0.3), Point3::new(0.5, -0.1, 0.9)];
        let cosine: f64 = (x[0] - x[1]).normalize().dot(&fibre);
        let along = cosine * cosine;
        let rest = (x[0] - x[1]).norm();
        let edge = Distance {
            points: [0, 1],
            rest,
        };
        for shortening in [1e-2, 1e-3, 1e-4] {
            let strain = Matrix3::identity() - fibre.into_inner() * fibre.transpose() * shortening;
            let now = x.map(|x| Point3::from(strain * x.coords));
            let off = FibreDistance::new(edge, along)
                .shortened(shortening)
                .value(&now);
            assert!(off.abs() <= rest * shortening * shortening, "{off}");
            // Control: an edge that takes no part is strained to first order.
            let off = FibreDistance::new(edge, 0.0)
                .shortened(shortening)
                .value(&now);
            assert!(off.abs() > 0.1 * rest * shortening, "{off}");
        }
    }

    #[test]
    fn a_shortening_replaces_the_one_before() {
        let edge = Distance {
            points: [0, 1],
            rest: 2.0,
        };
        let made = FibreDistance::new(edge, 0.5);
        assert_eq!(made.shortened(0.4).shortened(0.0), made);
        assert_eq!(made.shortened(0.5).edge.rest, 1.5);
    }
}
