//! The gap between two disjoint convex parts of surfaces: a vertex and a triangle, or two edges.
//!
//! The gap comes with a unit normal that separates the parts: every point of the first one lies
//! higher along the normal than every point of the second one. The normal is tested with the
//! corners themselves, so that rounding in the closest points cannot make it wrong.

use nalgebra::{Point3, Vector3};

use super::nearest::{on_triangle, point_at};

/// Rounding of a difference of heights, relative to the greatest coordinate. A gap below it has no
/// certain sign.
pub(crate) const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// The parts of a pair: the first ones of its four corners are the first part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Parts {
    /// Corner 0 against the triangle of corners 1 to 3.
    VertexTriangle,
    /// The edge of corners 0 and 1 against the edge of corners 2 and 3.
    EdgeEdge,
}

impl Parts {
    /// Number of corners of the first part.
    #[inline]
    pub fn first(self) -> usize {
        match self {
            Self::VertexTriangle => 1,
            Self::EdgeEdge => 2,
        }
    }
}

/// A pair of disjoint parts, seen along a separating normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Least height of the first part over the second one along the normal [m], at most the
    /// distance of the parts.
    pub height: f64,
    /// Unit normal, from the second part to the first one.
    pub normal: Vector3<f64>,
    /// Weights of the corners in the difference of the closest points; those of the second part
    /// are negative, and the sum is zero.
    pub weights: [f64; 4],
    /// True if the closest points lie inside of both edges, or of the triangle.
    pub inner: bool,
}

/// Heights along `normal`: the least of the first part less the greatest of the second one [m].
#[inline]
pub fn height(parts: Parts, x: &[Point3<f64>; 4], normal: &Vector3<f64>) -> f64 {
    // Heights over one of the corners: a translation changes less.
    let [a, b, c] = [x[1], x[2], x[3]].map(|p| (p - x[0]).dot(normal));
    match parts {
        Parts::VertexTriangle => -max3(a, b, c),
        Parts::EdgeEdge => a.min(0.0) - max2(b, c),
    }
}

/// The greater of two numbers; NaN if one is NaN, which `f64::max` would hide.
#[inline]
fn max2(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

#[inline]
fn max3(a: f64, b: f64, c: f64) -> f64 {
    max2(max2(a, b), c)
}

/// The gap of a pair; `None` if no normal separates its parts by more than rounding, as for parts
/// that touch.
pub fn gap(parts: Parts, x: &[Point3<f64>; 4]) -> Option<Gap> {
    let (weights, inner) = match parts {
        Parts::VertexTriangle => vertex_triangle(x),
        Parts::EdgeEdge => edge_edge(x),
    };
    let away = difference(x, &weights);
    let distance = away.norm();
    let least = ROUNDING * largest(x);
    let mut best = Gap {
        height: f64::NEG_INFINITY,
        normal: away / distance,
        weights,
        inner,
    };
    if distance > 0.0 {
        best.height = height(parts, x, &best.normal);
    }
    // Nearly touching parts: the difference of the closest points is mostly rounding, and the
    // normal of the triangle or of both edges is better.
    if !(best.height >= 0.999 * distance) || !(distance > 1e-6 * size(x)) {
        if let Some(normal) = common_normal(parts, x) {
            let heights = [normal, -normal].map(|normal| (height(parts, x, &normal), normal));
            for (height, normal) in heights {
                if height > best.height || best.height.is_nan() {
                    (best.height, best.normal) = (height, normal);
                }
            }
        }
    }
    (best.height > least).then_some(best)
}

/// Difference of two weighted means, the sum of the weights being zero.
#[inline]
pub fn difference(x: &[Point3<f64>; 4], weights: &[f64; 4]) -> Vector3<f64> {
    (x[1] - x[0]) * weights[1] + (x[2] - x[0]) * weights[2] + (x[3] - x[0]) * weights[3]
}

/// The greatest coordinate [m].
fn largest(x: &[Point3<f64>; 4]) -> f64 {
    x.iter().fold(0.0, |most, p| max2(most, p.coords.amax()))
}

/// The extent of the corners [m].
fn size(x: &[Point3<f64>; 4]) -> f64 {
    max3(
        (x[1] - x[0]).norm(),
        (x[2] - x[0]).norm(),
        (x[3] - x[0]).norm(),
    )
}

fn vertex_triangle(x: &[Point3<f64>; 4]) -> ([f64; 4], bool) {
    let ([a, b, c], feature) = on_triangle(&x[0], &[x[1], x[2], x[3]]);
    (
        [1.0, -a, -b, -c],
        matches!(feature, super::nearest::Feature::Face),
    )
}

/// Weights of the closest points of two segments. Either the closest points lie inside of both, or
/// one of them is an end, so that the nearest end decides where the first case gives nothing.
fn edge_edge(x: &[Point3<f64>; 4]) -> ([f64; 4], bool) {
    let (d, e, r) = (x[1] - x[0], x[3] - x[2], x[0] - x[2]);
    let (dd, ee, de) = (d.norm_squared(), e.norm_squared(), d.dot(&e));
    let determinant = dd * ee - de * de;
    if determinant > 1e-12 * dd * ee {
        let (dr, er) = (d.dot(&r), e.dot(&r));
        let (u, w) = (
            (de * er - ee * dr) / determinant,
            (dd * er - de * dr) / determinant,
        );
        if u > 0.0 && u < 1.0 && w > 0.0 && w < 1.0 {
            return ([1.0 - u, u, w - 1.0, -w], true);
        }
    }
    let mut best = (f64::INFINITY, [1.0, 0.0, -1.0, 0.0]);
    let mut consider = |weights: [f64; 4]| {
        let squared = difference(x, &weights).norm_squared();
        if squared < best.0 {
            best = (squared, weights);
        }
    };
    for (end, weights) in [(x[0], [1.0, 0.0]), (x[1], [0.0, 1.0])] {
        let w = along(&end, &x[2], &e, ee);
        consider([weights[0], weights[1], w - 1.0, -w]);
    }
    for (end, weights) in [(x[2], [-1.0, 0.0]), (x[3], [0.0, -1.0])] {
        let u = along(&end, &x[0], &d, dd);
        consider([1.0 - u, u, weights[0], weights[1]]);
    }
    (best.1, false)
}

/// Place of the point of a segment nearest to `p`, from 0 to 1.
fn along(p: &Point3<f64>, from: &Point3<f64>, d: &Vector3<f64>, squared: f64) -> f64 {
    if squared > 0.0 {
        ((p - from).dot(d) / squared).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// The normal of the triangle, or of both edges.
fn common_normal(parts: Parts, x: &[Point3<f64>; 4]) -> Option<Vector3<f64>> {
    let normal = match parts {
        Parts::VertexTriangle => (x[2] - x[1]).cross(&(x[3] - x[1])),
        Parts::EdgeEdge => (x[1] - x[0]).cross(&(x[3] - x[2])),
    };
    normal.try_normalize(0.0)
}

/// The closest point of the second part [m].
pub fn lower(parts: Parts, x: &[Point3<f64>; 4], weights: &[f64; 4]) -> Point3<f64> {
    match parts {
        Parts::VertexTriangle => point_at(
            &[x[1], x[2], x[3]],
            &[-weights[1], -weights[2], -weights[3]],
        ),
        Parts::EdgeEdge => x[2] + (x[3] - x[2]) * -weights[3],
    }
}
