//! Signed dihedral angle of two triangles that share an edge: C = theta - theta0.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::angle::atan2;
use super::{Constraint, Parameter, Scalar};

/// A triangle with area below this share of its longest edge squared has no usable normal. The rule is relative, so
/// it does not change with the unit of length.
const FLAT: f64 = 1.0 / (1u64 << 40) as f64;

/// Keeps the signed angle between two triangles at `rest` [rad].
///
/// Points are p1, p2 (shared edge) and p3, p4 (wing tips), the triangles (p1, p2, p3) and (p2, p1, p4). With
/// e = p2 - p1, N1 = e x (p3 - p1), N2 = (p4 - p1) x e: theta = atan2((N1 x N2).e/|e|, N1.N2), 0 where flat, positive
/// for a ridge seen from the side of the normals. The gradient is the closed form g3 = -|e| N1/|N1|^2,
/// g4 = -|e| N2/|N2|^2 \[bridson2003, tamstorf2013\], which has no singularity at 0 or pi. Undefined where a triangle
/// has no area or the edge no length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bending {
    /// p1, p2 (edge), p3, p4 (wing tips).
    pub points: [u32; 4],
    /// Rest angle [rad].
    pub rest: f64,
    /// C when the hinge was last visited [rad]: of the angles that differ by whole turns the one next to it is meant,
    /// so that a hinge that was folded through itself is led back the way it came.
    pub last: f64,
}

impl Bending {
    /// A hinge at its rest angle [rad].
    pub fn new(points: [u32; 4], rest: f64) -> Self {
        Self { points, rest, last: 0.0 }
    }
}

/// The number that differs from `angle` by whole turns and is nearest to `last`; in (-pi, pi] for `last` = 0.
#[inline(always)]
fn unwrap<S: Scalar>(angle: S, last: f64) -> S {
    let off = angle.real() - last;
    // The usual case, without a division and a rounding.
    if off > -PI && off <= PI {
        return angle;
    }
    let turns = ((off + PI) / TAU).ceil() - 1.0;
    if turns == 0.0 { angle } else { angle - S::of(turns * TAU) }
}

/// Signed angle between the triangles of a hinge [rad], 0 where flat.
pub fn dihedral<S: Scalar>(x: &[Point3<S>; 4]) -> S {
    let e = x[1] - x[0];
    let n1 = e.cross(&(x[2] - x[0]));
    let n2 = (x[3] - x[0]).cross(&e);
    let length = e.dot(&e).sqrt();
    (n1.cross(&n2).dot(&e) / length).atan2(n1.dot(&n2))
}

impl Constraint<4> for Bending {
    const NAME: &'static str = "bending";
    const DEGREE: i32 = 0;
    const PARAMETERS: &'static [Parameter] = &[Parameter::Angle];

    fn from_parameters(points: [u32; 4], parameters: &[f64]) -> Self {
        Self::new(points, parameters[0])
    }

    #[inline]
    fn points(&self) -> [u32; 4] {
        self.points
    }

    #[inline]
    fn remember(&mut self, value: f64) {
        self.last = value;
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 4]) -> S {
        unwrap(dihedral(x) - S::of(self.rest), self.last)
    }

    // By force: returned through memory its numbers cost more than they take to compute.
    #[inline(always)]
    fn value_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let e = x[1] - x[0];
        let a = x[2] - x[0];
        let b = x[3] - x[0];
        let n1 = e.cross(&a);
        let n2 = b.cross(&e);
        let ee = e.norm_squared();
        let (q1, q2) = (n1.norm_squared(), n2.norm_squared());
        let thin = |longest: f64| 4.0 * FLAT * FLAT * longest * longest;
        let longest1 = ee.max(a.norm_squared()).max((x[2] - x[1]).norm_squared());
        let longest2 = ee.max(b.norm_squared()).max((x[3] - x[1]).norm_squared());
        if !(ee > 0.0 && q1 > thin(longest1) && q2 > thin(longest2)) {
            return None;
        }
        let length = ee.sqrt();
        // N1 x N2 = -(N1.b) e: the same angle as in `value` with one product less.
        let theta = atan2(-n1.dot(&b) * length, n1.dot(&n2));
        let g3 = n1 * (-length / q1);
        let g4 = n2 * (-length / q2);
        let per_ee = 1.0 / ee;
        let t3 = a.dot(&e) * per_ee;
        let t4 = b.dot(&e) * per_ee;
        let g2 = -(g3 * t3) - g4 * t4;
        let g1 = -(g3 * (1.0 - t3)) - g4 * (1.0 - t4);
        Some((unwrap(theta - self.rest, self.last), [g1, g2, g3, g4]))
    }
}
