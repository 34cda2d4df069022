//! Single pairs of a vertex and a triangle, or of two edges: gaps, truncated steps, times of impact
//! (P27 to P29), by exact arithmetic and on public queries.

mod exact;
mod gaps;
mod impacts;
mod queries;
mod steps;

use nalgebra::{Point3, Vector3};
use pliant::contact::Parts;
use pliant::testing::Draw;

/// The corners of a pair [m].
type Corners = [Point3<f64>; 4];

const BOTH: [Parts; 2] = [Parts::VertexTriangle, Parts::EdgeEdge];

/// Vectors and points whose coordinates are integers up to `most`.
fn integers(draw: &mut Draw, most: i32) -> Vector3<f64> {
    Vector3::from_fn(|_, _| draw.index(2 * most as usize + 1) as f64 - f64::from(most))
}

/// The greatest coordinate [m].
fn largest(x: &Corners) -> f64 {
    x.iter().map(|p| p.coords.amax()).fold(0.0, f64::max)
}

/// Distance of the parts [m], as the least distance of all pairs of features that have one.
fn distance(parts: Parts, x: &Corners) -> f64 {
    let to_segment = |p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>| {
        let (d, r) = (b - a, p - a);
        let t = (r.dot(&d) / d.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (r - d * t).norm()
    };
    let [p, a, b, c] = x;
    match parts {
        Parts::VertexTriangle => {
            let n = (b - a).cross(&(c - a));
            let is_over = [(a, b), (b, c), (c, a)]
                .iter()
                .all(|(from, to)| (*to - *from).cross(&(p - *from)).dot(&n) >= 0.0);
            let height = if is_over && n.norm() > 0.0 {
                ((p - a).dot(&n) / n.norm()).abs()
            } else {
                f64::INFINITY
            };
            [
                to_segment(p, a, b),
                to_segment(p, b, c),
                to_segment(p, c, a),
            ]
            .into_iter()
            .fold(height, f64::min)
        }
        Parts::EdgeEdge => {
            let (d, e, r) = (a - p, c - b, b - p);
            let n = d.cross(&e);
            let (u, w) = (
                r.cross(&e).dot(&n) / n.norm_squared(),
                r.cross(&d).dot(&n) / n.norm_squared(),
            );
            let height = if (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&w) {
                (r.dot(&n) / n.norm()).abs()
            } else {
                f64::INFINITY
            };
            [
                to_segment(p, b, c),
                to_segment(a, b, c),
                to_segment(b, p, a),
                to_segment(c, p, a),
            ]
            .into_iter()
            .fold(height, f64::min)
        }
    }
}
