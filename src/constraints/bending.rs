//! Signed dihedral angle of two triangles that share an edge: C = theta - theta0, steeper beyond a limit.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::angle::{atan2, atan2_in_lanes};
use super::kernel::{MOST_NUMBERS, Periodic};
use super::lanes::{cross, dot, neg, scale, sub};
use super::{Constraint, Kernel, Lane, LaneConstraint, Scalar, Several};

/// A triangle whose area is below this share of its longest edge squared has no usable normal. The
/// rule is relative: it does not change with the unit of length.
const FLAT: f64 = 1.0 / (1u64 << 40) as f64;

/// Keeps the signed angle between two triangles at `rest` [rad].
///
/// Points are p1, p2 (shared edge) and p3, p4 (wing tips), the triangles (p1, p2, p3) and (p2, p1,
/// p4). With e = p2 - p1, N1 = e x (p3 - p1), N2 = (p4 - p1) x e the angle is theta = atan2((N1 x
/// N2).e/|e|, N1.N2). It is 0 where flat and positive for a ridge seen from the side of the
/// normals. The gradient is the closed form g3 = -|e| N1/|N1|^2, g4 = -|e| N2/|N2|^2 \[bridson2003,
/// tamstorf2013\]. It has no singularity at 0 or pi. It is undefined where a triangle has no area
/// or the edge has no length.
///
/// With a `limit` L the hinge stiffens: beyond it |C|^2 = (theta - theta0)^2 + s^2 (|theta| - L)^2 with
/// s = 30. So the energy k C^2 / 2 is that of two springs, of which the second one is 900 times as stiff and
/// begins at the limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bending {
    /// p1, p2 (edge), p3, p4 (wing tips).
    pub points: [u32; 4],
    /// Rest angle [rad].
    pub rest: f64,
    /// theta - theta0 at the last visit of the hinge [rad]. Angles that differ by whole turns are equivalent;
    /// the one nearest to this value counts. Therefore a hinge that was folded through itself
    /// unfolds along the same path.
    pub last: f64,
    /// The limit [rad], at least |theta0|; infinite for none.
    pub limit: f64,
}

/// s^2: the stiffness of a hinge beyond its limit, relative to that before it.
const STIFFER: f64 = 900.0;

impl Bending {
    /// A hinge at its rest angle [rad].
    pub fn new(points: [u32; 4], rest: f64) -> Self {
        Self {
            points,
            rest,
            last: 0.0,
            limit: f64::INFINITY,
        }
    }

    /// The same with a limit [rad]. A hinge that is sharper at rest may stay so.
    #[must_use]
    pub fn with_limit(self, limit: f64) -> Self {
        let sharp = self.rest.abs();
        let limit = if limit > sharp { limit } else { sharp };
        Self { limit, ..self }
    }

    /// C of an angle relative to that at rest [rad], and dC/dtheta.
    fn stiffened<S: Scalar>(&self, turned: S) -> (S, f64) {
        let angle = turned + S::of(self.rest);
        let beyond = if angle.real() > self.limit {
            angle - S::of(self.limit)
        } else if angle.real() < -self.limit {
            angle + S::of(self.limit)
        } else {
            return (turned, 1.0);
        };
        let size = (turned * turned + beyond * beyond * S::of(STIFFER)).sqrt();
        let value = if turned.real() < 0.0 { -size } else { size };
        let slope = (turned.real() + STIFFER * beyond.real()) / value.real();
        (value, slope)
    }

    /// The angle relative to that at rest that has this C [rad].
    fn turned(&self, value: f64) -> f64 {
        // In the direction of C.
        let most = self.limit - self.rest * value.signum();
        if value.abs() <= most {
            return value;
        }
        let all = 1.0 + STIFFER;
        let root = (all * value * value - STIFFER * most * most).sqrt();
        ((STIFFER * most + root) / all).copysign(value)
    }
}

/// The number that differs from `angle` by whole turns and is nearest to `last`. It is in (-pi, pi]
/// for `last` = 0.
fn unwrap<S: Scalar>(angle: S, last: f64) -> S {
    let off = angle.real() - last;
    if off > -PI && off <= PI {
        return angle;
    }
    let turns = ((off + PI) / TAU).ceil() - 1.0;
    if turns == 0.0 {
        angle
    } else {
        angle - S::of(turns * TAU)
    }
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

    #[inline]
    fn points(&self) -> [u32; 4] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; 4]) -> S {
        self.stiffened(unwrap(dihedral(x) - S::of(self.rest), self.last))
            .0
    }

    // Always inlined: returning these numbers through memory would take longer than computing them.
    #[inline(always)]
    fn value_and_gradient(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        let points = [x[0], x[1], x[2], x[3]].map(|p| p.coords.into());
        let Several {
            value,
            gradient,
            usual,
            ..
        } = Self::in_lanes::<f64>((), self.numbers(), &points);
        let [a, b, c, d] = gradient;
        if usual {
            Some((value, [a.into(), b.into(), c.into(), d.into()]))
        } else {
            self.unusual(x)
        }
    }

    fn kernel() -> Kernel<Self, 4> {
        Kernel::periodic_in_lanes()
    }
}

impl Periodic<4> for Bending {
    fn branch(&self) -> f64 {
        self.last
    }

    #[inline]
    fn set_branch(&mut self, branch: f64) {
        self.last = branch;
    }

    #[inline]
    fn branch_of(&self, value: f64) -> f64 {
        self.turned(value)
    }
}

impl LaneConstraint<4> for Bending {
    const NUMBERS: usize = 3;

    #[inline(always)]
    fn numbers(&self) -> [f64; MOST_NUMBERS] {
        [self.last, self.rest, self.limit]
    }

    #[inline(always)]
    fn in_lanes<N: Lane>(
        machine: N::Machine,
        [last, rest, limit]: [N; MOST_NUMBERS],
        x: &[[N; 3]; 4],
    ) -> Several<N, 4> {
        let of = |value| N::splat(machine, value);
        let e = sub(x[1], x[0]);
        let a = sub(x[2], x[0]);
        let b = sub(x[3], x[0]);
        let n1 = cross(e, a);
        let n2 = cross(b, e);
        let ee = dot(e, e);
        let (q1, q2) = (dot(n1, n1), dot(n2, n2));
        // The square of the third edge is at most twice the sum of the other two. An area that is
        // large enough for this bound is therefore large enough for `is_solid`.
        let (s1, s2) = (ee + dot(a, a), ee + dot(b, b));
        let flat = of(17.0 * FLAT * FLAT);
        let solid = of(0.0).lt(ee) & (flat * s1 * s1).lt(q1) & (flat * s2 * s2).lt(q2);
        let length = ee.sqrt();
        // N1 x N2 = -(N1.b) e: the same angle as in `value` with one product fewer.
        let (theta, angular) = atan2_in_lanes(machine, -dot(n1, b) * length, dot(n1, n2));
        let turned = theta - rest;
        let off = turned - last;
        let unwrapped = of(-PI).lt(off) & off.le(of(PI));
        let zero = of(0.0);
        let (is_over, is_under) = (limit.lt(theta), theta.lt(-limit));
        let is_beyond = is_over | is_under;
        let (mut slope, mut value) = (of(1.0), turned);
        // Rare, and a root and a quotient more.
        if N::bits(is_beyond) != 0 {
            let over = N::select(is_over, theta - limit, zero);
            let beyond = N::select(is_under, theta + limit, over);
            let size = (value * value + beyond * beyond * of(STIFFER)).sqrt();
            let stiff = size.copysign(value);
            let steeper = (value + of(STIFFER) * beyond) / stiff;
            slope = N::select(is_beyond, steeper, slope);
            value = N::select(is_beyond, stiff, value);
        }
        // One division instead of three.
        let all = of(1.0) / (q1 * q2 * ee);
        let (one, per_ee) = (of(1.0), q1 * q2 * all);
        let le = length * ee;
        let in_range = of(1e-280).lt(q1 * q2 * ee) & (q1 * q2 * ee).lt(of(1e280));
        let g3 = scale(n1, -(le * q2) * all * slope);
        let g4 = scale(n2, -(le * q1) * all * slope);
        let t3 = dot(a, e) * per_ee;
        let t4 = dot(b, e) * per_ee;
        let g2 = sub(neg(scale(g3, t3)), scale(g4, t4));
        let g1 = sub(neg(scale(g3, one - t3)), scale(g4, one - t4));
        Several {
            value,
            gradient: [g1, g2, g3, g4],
            branch: turned,
            usual: solid & angular & unwrapped & in_range,
        }
    }
}

/// Whether both triangles have enough area for a normal.
fn is_solid(x: &[Point3<f64>; 4]) -> bool {
    let (e, a, b) = (x[1] - x[0], x[2] - x[0], x[3] - x[0]);
    let ee = e.norm_squared();
    let (q1, q2) = (e.cross(&a).norm_squared(), b.cross(&e).norm_squared());
    let thin = |longest: f64| 4.0 * FLAT * FLAT * longest * longest;
    let longest1 = ee.max(a.norm_squared()).max((x[2] - x[1]).norm_squared());
    let longest2 = ee.max(b.norm_squared()).max((x[3] - x[1]).norm_squared());
    ee > 0.0 && q1 > thin(longest1) && q2 > thin(longest2)
}

impl Bending {
    /// C and its gradient for a hinge that is nearly degenerate, has turned by more than half a
    /// turn, or has extreme numbers; `None` where the gradient is undefined.
    #[cold]
    fn unusual(&self, x: &[Point3<f64>; 4]) -> Option<(f64, [Vector3<f64>; 4])> {
        if !is_solid(x) {
            return None;
        }
        let (e, a, b) = (x[1] - x[0], x[2] - x[0], x[3] - x[0]);
        let (n1, n2) = (e.cross(&a), b.cross(&e));
        let ee = e.norm_squared();
        let theta = atan2(-n1.dot(&b) * ee.sqrt(), n1.dot(&n2));
        let (value, slope) = self.stiffened(unwrap(theta - self.rest, self.last));
        let g3 = n1 * (-ee.sqrt() / n1.norm_squared() * slope);
        let g4 = n2 * (-ee.sqrt() / n2.norm_squared() * slope);
        let (t3, t4) = (a.dot(&e) / ee, b.dot(&e) / ee);
        let g1 = -g3 * (1.0 - t3) - g4 * (1.0 - t4);
        let g2 = -g3 * t3 - g4 * t4;
        Some((value, [g1, g2, g3, g4]))
    }
}

#[cfg(any(test, feature = "testing"))]
impl super::Spec<4> for Bending {
    const DEGREE: i32 = 0;
    const PARAMETERS: &'static [super::Parameter] = &[super::Parameter::Angle];

    fn from_parameters(points: [u32; 4], parameters: &[f64]) -> Self {
        // Without a limit, where the second derivative of C jumps.
        Self::new(points, parameters[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hinge with its wings at an angle, flat for 0.
    fn at(angle: f64) -> [Point3<f64>; 4] {
        let tip = Point3::new(0.5, libm::cos(angle), libm::sin(angle));
        let wing = Point3::new(0.5, -1.0, 0.0);
        [Point3::origin(), Point3::new(1.0, 0.0, 0.0), wing, tip]
    }

    fn value(hinge: &Bending, angle: f64) -> f64 {
        hinge.value_and_gradient(&at(angle)).expect("areas").0
    }

    const HINGES: [(f64, f64); 4] = [(0.0, 0.9), (0.3, 0.9), (-0.4, 0.5), (0.7, 0.5)];

    #[test]
    fn beyond_the_limit_the_energy_is_that_of_two_springs() {
        for (rest, limit) in HINGES {
            let plain = Bending::new([0, 1, 2, 3], rest);
            let hinge = plain.with_limit(limit);
            for k in -24..=24 {
                let angle = 0.1 * f64::from(k);
                let (c, turned) = (value(&hinge, angle), value(&plain, angle));
                let beyond = (angle.abs() - limit.max(rest.abs())).max(0.0);
                let both = turned * turned + 900.0 * beyond * beyond;
                let case = format!("{rest} {limit} {angle}: {c} {turned}");
                assert!((c * c - both).abs() <= 1e-12 * both.max(1.0), "{case}");
                assert!(c * turned >= 0.0, "{case}");
                assert!((hinge.turned(c) - turned).abs() <= 1e-12, "{case}");
                assert!(beyond > 0.0 || c == turned, "{case}");
            }
        }
    }

    #[test]
    fn the_gradient_beyond_the_limit_is_that_of_the_value() {
        let step = 1e-6;
        let mut steepest = 0.0_f64;
        for (rest, limit) in HINGES {
            let hinge = Bending::new([0, 1, 2, 3], rest).with_limit(limit);
            // No angle is within a step of a limit.
            for angle in (-24..=24).map(|k| 0.1 * f64::from(k) + 0.03) {
                let x = at(angle);
                let (c, gradient) = hinge.value_and_gradient(&x).expect("areas");
                assert!((c - hinge.value(&x)).abs() <= 1e-12 * c.abs().max(1.0));
                for (p, k) in (0..4).flat_map(|p| (0..3).map(move |k| (p, k))) {
                    let moved = |by: f64| {
                        let mut x = x;
                        x[p][k] += by;
                        hinge.value(&x)
                    };
                    let slope = (moved(step) - moved(-step)) / (2.0 * step);
                    let off = (slope - gradient[p][k]).abs();
                    // Rounding of C over the step, and the third derivative.
                    assert!(off <= 1e-7, "{rest} {limit} {angle} {p} {k}: {off}");
                    steepest = steepest.max(slope.abs());
                }
            }
        }
        assert!(steepest > 20.0, "control: some hinge is beyond its limit");
    }

    #[test]
    fn the_rare_form_has_the_numbers_of_the_usual_one() {
        for (rest, limit) in HINGES {
            let hinge = Bending::new([0, 1, 2, 3], rest).with_limit(limit);
            for angle in (-24..=24).map(|k| 0.1 * f64::from(k) + 0.03) {
                // A skew hinge of unequal wings.
                let mut x = at(angle);
                x[2].x -= 0.7;
                x[3] = Point3::from(x[3].coords * 1.6);
                let (c, usual) = hinge.value_and_gradient(&x).expect("areas");
                let (value, rare) = hinge.unusual(&x).expect("areas");
                assert!((value - c).abs() <= 1e-12 * c.abs().max(1.0), "{value} {c}");
                for (one, other) in usual.iter().zip(rare) {
                    let off = (one - other).norm();
                    assert!(off <= 1e-12 * one.norm().max(1.0), "{one} {other}");
                }
            }
        }
    }
}
