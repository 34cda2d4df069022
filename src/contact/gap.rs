//! The gap between two disjoint convex parts of surfaces: a vertex and a triangle, or two edges.
//!
//! The gap comes with a unit normal that separates the parts: every point of the first one lies
//! higher along the normal than every point of the second one. The normal is tested with the
//! corners themselves, so that rounding in the closest points cannot make it wrong.

use nalgebra::{Point3, Vector3};

use super::nearest::{Feature, on_triangle, point_at};
use crate::mesh::closest::place_on_segment;

/// Rounding of a difference of heights, relative to the greatest coordinate. A gap below it has no
/// certain sign.
///
/// A height is a difference of two corners (a rounding of twice the greatest coordinate in each
/// component) times a unit vector (a product and two sums): at most 7 eps of the greatest
/// coordinate, and the difference of two heights at most 18 eps. The rest allows for corners that
/// are themselves places on a way, rounded (9 eps), and for normals that are not quite of length 1.
pub(crate) const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// The share of a distance that a separating normal must show. Below it, all normals are tried.
const SHARP: f64 = 0.999;

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
        Parts::VertexTriangle => -max2(max2(a, b), c),
        Parts::EdgeEdge => -max2(-a, 0.0) - max2(b, c),
    }
}

/// The greater of two numbers; NaN if one is NaN, which `f64::max` would hide.
#[inline]
pub(super) fn max2(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

/// The gap of a pair; `None` if no normal separates its parts by more than rounding, as for parts
/// that touch or cross, and for coordinates that are not finite.
///
/// Parts that are apart by more than 1000 eps of the greatest coordinate have a gap, and its height
/// is their distance but for a thousandth.
///
/// ```
/// use nalgebra::Point3;
/// use pliant::contact::{Parts, gap};
///
/// // A vertex 1 mm over a triangle.
/// let x = [[0.2, 0.2, 1e-3], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
/// let found = gap(Parts::VertexTriangle, &x).expect("they do not touch");
/// assert!((found.height - 1e-3).abs() <= 1e-12 && (found.normal.z - 1.0).abs() <= 1e-12);
/// ```
pub fn gap(parts: Parts, x: &[Point3<f64>; 4]) -> Option<Gap> {
    gap_above(parts, x, ROUNDING * largest(x))
}

/// The gap of a pair; `None` if it is not above `least` [m], which is at least rounding.
#[inline]
pub(super) fn gap_above(parts: Parts, x: &[Point3<f64>; 4], least: f64) -> Option<Gap> {
    let (weights, inner) = match parts {
        Parts::VertexTriangle => vertex_triangle(x),
        Parts::EdgeEdge => edge_edge(x),
    };
    let away = difference(x, &weights);
    from_closest(parts, x, (weights, inner), away, least)
}

/// What is known of a pair within a reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Within {
    /// The parts are farther apart.
    Farther,
    /// The parts are apart.
    Near(Gap),
    /// No normal separates the parts by more than rounding.
    Touching,
}

/// The same as [`gap`] for parts nearer than `reach` [m], and faster for others.
#[inline]
pub(super) fn gap_within(parts: Parts, x: &[Point3<f64>; 4], reach: f64) -> Within {
    let (weights, inner) = match parts {
        Parts::VertexTriangle => vertex_triangle(x),
        Parts::EdgeEdge => edge_edge(x),
    };
    let away = difference(x, &weights);
    if away.norm_squared() >= reach * reach {
        return Within::Farther;
    }
    let least = ROUNDING * largest(x);
    from_closest(parts, x, (weights, inner), away, least).map_or(Within::Touching, Within::Near)
}

/// The gap of a pair whose closest points differ by `away` [m].
#[inline]
fn from_closest(
    parts: Parts,
    x: &[Point3<f64>; 4],
    (weights, inner): ([f64; 4], bool),
    away: Vector3<f64>,
    least: f64,
) -> Option<Gap> {
    let squared = away.norm_squared();
    let distance = squared.sqrt();
    // No height exceeds the distance of two points of the parts, but for rounding.
    if distance < 0.5 * least {
        return None;
    }
    // A square below this one has lost digits.
    if squared > f64::MIN_POSITIVE / f64::EPSILON {
        let normal = away / distance;
        let height = height(parts, x, &normal);
        if height >= SHARP * distance {
            return (height > least).then_some(Gap {
                height,
                normal,
                weights,
                inner,
            });
        }
    }
    let best = by_features(parts, x, (weights, inner), SHARP * distance);
    (best.height > least).then_some(best)
}

/// Difference of two weighted means, the sum of the weights being zero.
#[inline]
pub fn difference(x: &[Point3<f64>; 4], weights: &[f64; 4]) -> Vector3<f64> {
    (x[1] - x[0]) * weights[1] + (x[2] - x[0]) * weights[2] + (x[3] - x[0]) * weights[3]
}

/// The greatest coordinate [m]. Coordinates that are not numbers are left out: heights show them.
#[inline]
pub(super) fn largest(x: &[Point3<f64>; 4]) -> f64 {
    let [a, b, c, d] = x.map(|p| p.coords.abs());
    a.sup(&b).sup(&c.sup(&d)).max()
}

fn vertex_triangle(x: &[Point3<f64>; 4]) -> ([f64; 4], bool) {
    let ([a, b, c], feature) = on_triangle(&x[0], &[x[1], x[2], x[3]]);
    ([1.0, -a, -b, -c], feature == Feature::Face)
}

/// Weights of the closest points of two segments \[ericson2005\].
fn edge_edge(x: &[Point3<f64>; 4]) -> ([f64; 4], bool) {
    let (d, e, r) = (x[1] - x[0], x[3] - x[2], x[0] - x[2]);
    let (dd, ee, de) = (d.norm_squared(), e.norm_squared(), d.dot(&e));
    let (dr, er) = (d.dot(&r), e.dot(&r));
    let determinant = dd * ee - de * de;
    if !(determinant > 1e-12 * dd * ee) {
        return nearest_end(x);
    }
    let mut u = ((de * er - dr * ee) / determinant).clamp(0.0, 1.0);
    let mut w = (de * u + er) / ee;
    // The closest point of the line lies beyond an end of the second edge.
    if !(w > 0.0 && w < 1.0) {
        w = if w > 0.5 { 1.0 } else { 0.0 };
        u = ((de * w - dr) / dd).clamp(0.0, 1.0);
    }
    let inner = u > 0.0 && u < 1.0 && w > 0.0 && w < 1.0;
    ([1.0 - u, u, w - 1.0, -w], inner)
}

/// The same for parallel edges and for edges without length: one of the closest points is an end.
#[cold]
fn nearest_end(x: &[Point3<f64>; 4]) -> ([f64; 4], bool) {
    let mut best = (f64::INFINITY, [1.0, 0.0, -1.0, 0.0]);
    for end in 0..4 {
        let weights = end_weights(x, end);
        let squared = difference(x, &weights).norm_squared();
        if squared < best.0 {
            best = (squared, weights);
        }
    }
    (best.1, false)
}

/// Weights of an end of one edge and of the point of the other edge nearest to it.
fn end_weights(x: &[Point3<f64>; 4], end: usize) -> [f64; 4] {
    if end < 2 {
        let w = place_on_segment(&x[end], &x[2], &x[3]);
        let mut weights = [0.0, 0.0, w - 1.0, -w];
        weights[end] = 1.0;
        weights
    } else {
        let u = place_on_segment(&x[end], &x[0], &x[1]);
        let mut weights = [1.0 - u, u, 0.0, 0.0];
        weights[end] = -1.0;
        weights
    }
}

/// The best of the normals that any two features of the parts define, with the nearest of their
/// points. The difference of two points that nearly touch is mostly rounding; each of these normals
/// is perpendicular to the edges that it belongs to. The first one above `enough` [m] is taken.
#[cold]
fn by_features(
    parts: Parts,
    x: &[Point3<f64>; 4],
    (weights, inner): ([f64; 4], bool),
    enough: f64,
) -> Gap {
    let mut best = Gap {
        height: f64::NEG_INFINITY,
        normal: Vector3::zeros(),
        weights,
        inner,
    };
    let (d, e) = match parts {
        Parts::VertexTriangle => (x[2] - x[1], x[3] - x[1]),
        Parts::EdgeEdge => (x[1] - x[0], x[3] - x[2]),
    };
    if let Some(normal) = across(d.cross(&e), &d, &e) {
        best.turn(parts, x, normal);
        best.turn(parts, x, -normal);
        if best.height >= enough {
            return best;
        }
    }
    // Pairs of a vertex and an edge.
    let pairs = match parts {
        Parts::VertexTriangle => [(0, 1, 2), (0, 2, 3), (0, 3, 1)].as_slice(),
        Parts::EdgeEdge => [(0, 2, 3), (1, 2, 3), (2, 0, 1), (3, 0, 1)].as_slice(),
    };
    // Not a number if the triangle has no area.
    let mut squared = difference(x, &weights).norm_squared();
    for &(vertex, from, to) in pairs {
        let side = if vertex < parts.first() { 1.0 } else { -1.0 };
        let (edge, w) = (
            x[to] - x[from],
            place_on_segment(&x[vertex], &x[from], &x[to]),
        );
        let mut weights = [0.0; 4];
        weights[vertex] = side;
        (weights[from], weights[to]) = (side * (w - 1.0), -side * w);
        let found = difference(x, &weights).norm_squared();
        if !(found >= squared) {
            (squared, best.weights, best.inner) = (found, weights, false);
        }
        for near in [from, to] {
            let away = (x[vertex] - x[near]) * side;
            let normals = [unit(&away), across(away, &edge, &edge)];
            for normal in normals.into_iter().flatten() {
                best.turn(parts, x, normal);
            }
        }
    }
    best
}

impl Gap {
    /// Takes another normal if the gap is higher along it.
    fn turn(&mut self, parts: Parts, x: &[Point3<f64>; 4], normal: Vector3<f64>) {
        let height = height(parts, x, &normal);
        if height > self.height {
            (self.height, self.normal) = (height, normal);
        }
    }
}

/// The unit vector along the part of `v` that is perpendicular to two edges, to rounding even if
/// that part is small or the edges are nearly parallel.
fn across(v: Vector3<f64>, first: &Vector3<f64>, second: &Vector3<f64>) -> Option<Vector3<f64>> {
    let mut v = unit(&v)?;
    let a = unit(first).unwrap_or_default();
    let b = unit(&(second - a * a.dot(second))).filter(|_| second != first);
    let b = b.unwrap_or_default();
    for _ in 0..3 {
        v = unit(&(v - a * a.dot(&v) - b * b.dot(&v)))?;
    }
    Some(v)
}

/// The unit vector along `v`, whose squares may be too small or too large for a number.
fn unit(v: &Vector3<f64>) -> Option<Vector3<f64>> {
    let scale = v.amax();
    (scale > 0.0 && scale < f64::INFINITY)
        .then(|| (v / scale).try_normalize(0.0))
        .flatten()
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
