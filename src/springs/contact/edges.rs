//! Intersections of the edges of one surface with the triangles of another.

use nalgebra::Point3;

use crate::mesh::predicates::{is_flat, near_one, segment_meets, side, turn};
use crate::mesh::topology::Topology;

/// Upper bound of the rounding error of a product of two coordinate differences, relative to the
/// lengths.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// A common point of an edge and a triangle, as weights of their points: each set is non-negative
/// with sum 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Weights of the ends of the edge.
    pub edge: [f64; 2],
    /// Weights of the corners of the triangle.
    pub triangle: [f64; 3],
}

/// The intersection of an edge and a triangle; its existence is exact \[shewchuk1997\]. `None` also
/// for a triangle without area: the edges of its neighbours have the same intersections.
///
/// An edge in the plane of the triangle crosses it at the midpoint of their common part. For an
/// almost parallel edge rounding decides on the position, but both sides give the same point.
pub fn crossing([p, q]: [Point3<f64>; 2], [a, b, c]: [Point3<f64>; 3]) -> Option<Crossing> {
    let [p, q, a, b, c] = near_one([p, q, a, b, c]);
    let triangle = [a, b, c];
    if is_flat(&triangle) || !segment_meets(&p, &q, &triangle) {
        return None;
    }
    let sides = sides(&p, &q, &triangle)?;
    let [above, below] = [&p, &q].map(|end| side(&triangle, end).abs());
    let heights = above + below;
    let at = place(&sides, (heights > 0.0).then(|| above / heights));
    let corners = shares(sides.map(|s| s.at(at).max(0.0)))?;
    Some(Crossing {
        edge: [1.0 - at, at],
        triangle: corners,
    })
}

/// Magnitudes over their sum; `None` if all are zero.
fn shares<const N: usize>(of: [f64; N]) -> Option<[f64; N]> {
    let sum: f64 = of.iter().sum();
    (sum > 0.0).then(|| of.map(|v| v / sum))
}

/// Signed distances of the ends of an edge from a side of a triangle, seen along an axis [m2],
/// positive inside; values below `doubt` can be rounding error.
#[derive(Clone, Copy)]
struct Within {
    p: f64,
    q: f64,
    doubt: f64,
}

impl Within {
    fn at(&self, share: f64) -> f64 {
        self.p * (1.0 - share) + self.q * share
    }
}

/// The sides opposite each corner, along the axis with the largest projected area.
fn sides(p: &Point3<f64>, q: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> Option<[Within; 3]> {
    let axis = (0..3).max_by(|&i, &j| turn(i, a, b, c).abs().total_cmp(&turn(j, a, b, c).abs()))?;
    let sign = turn(axis, a, b, c).signum();
    Some([(b, c), (c, a), (a, b)].map(|(u, v)| {
        let [at_p, at_q] = [p, q].map(|end| turn(axis, u, v, end) * sign);
        Within {
            p: at_p,
            q: at_q,
            doubt: ROUNDING * (v - u).norm() * (p - u).norm().max((q - u).norm()),
        }
    }))
}

/// Position of the intersection along an edge: from its heights over the plane, limited by the
/// sides. An edge nearly parallel to the plane has heights that are mostly rounding error. An edge
/// nearly parallel to a side is within it by rounding only, so such a side is ignored. Without
/// heights the result is the midpoint of the part within.
fn place(sides: &[Within; 3], by_heights: Option<f64>) -> f64 {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for s in sides {
        if by_heights.map_or(s.p.min(s.q), |share| s.at(share)) < -s.doubt {
            let share = (s.p / (s.p - s.q)).clamp(0.0, 1.0);
            if s.p < s.q {
                from = from.max(share)
            } else {
                to = to.min(share)
            }
        }
    }
    // If they share only one point, the two ends of the common part can be reversed by rounding.
    let middle = 0.5 * (from + to);
    by_heights.map_or(middle, |share| {
        share.max(from.min(middle)).min(to.max(middle))
    })
}

/// The triangle that tests each edge: the first one with the edge, so that a shared edge is tested
/// once (errata B12).
#[derive(Clone, Debug, Default)]
pub struct EdgeOwners {
    /// For each triangle, true if it owns the side from corner k to corner k + 1.
    owned: Vec<[bool; 3]>,
}

impl EdgeOwners {
    /// Creates the table for triangles over `vertex_count` points.
    pub fn new(vertex_count: usize, triangles: &[[u32; 3]]) -> Self {
        let topology = Topology::of_triangles(vertex_count, triangles);
        let first = |e: u32| topology.triangles_of_edge(e as usize).first().copied();
        let owned = |(t, edges): (usize, &[u32; 3])| edges.map(|e| first(e) == Some(t as u32));
        Self {
            owned: topology
                .triangle_edges
                .iter()
                .enumerate()
                .map(owned)
                .collect(),
        }
    }

    /// The sides of a triangle that it owns, by their first corner.
    pub fn of(&self, triangle: u32) -> impl Iterator<Item = usize> {
        let owned = self.owned[triangle as usize];
        (0..3).filter(move |&k| owned[k])
    }
}

/// A surface with the data to find its intersections.
#[derive(Clone, Copy)]
pub struct Sheet<'a> {
    /// Positions [m].
    pub x: &'a [Point3<f64>],
    /// Triangles.
    pub triangles: &'a [[u32; 3]],
    /// The triangle that tests each edge.
    pub owners: &'a EdgeOwners,
}

/// The surface with the edge of an intersection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The first surface.
    OfFirst,
    /// The second surface.
    OfSecond,
}

/// An edge of one surface that crosses a triangle of the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The surface with the edge.
    pub which: Edge,
    /// The ends of the edge.
    pub edge: [u32; 2],
    /// The triangle that owns the edge, and the index of its side.
    pub side: (u32, usize),
    /// The triangle of the other surface.
    pub triangle: u32,
    /// The intersection.
    pub at: Crossing,
}

/// Visits the edges of a triangle of one surface that cross a triangle of the other, in both
/// directions (errata B07): the edges of one surface alone miss a tip that pierces a large
/// triangle. Sides that a triangle does not own are tested by its neighbours, which have the same
/// points.
pub fn crossings_of(
    [s, t]: [u32; 2],
    first: Sheet<'_>,
    second: Sheet<'_>,
    mut visit: impl FnMut(Found),
) {
    for (which, of, s, other, t) in [
        (Edge::OfFirst, first, s, second, t),
        (Edge::OfSecond, second, t, first, s),
    ] {
        let (from, corners) = (of.triangles[s as usize], other.triangles[t as usize]);
        for k in of.owners.of(s) {
            let edge = [from[k], from[(k + 1) % 3]];
            let at = crossing(
                edge.map(|v| of.x[v as usize]),
                corners.map(|v| other.x[v as usize]),
            );
            at.into_iter().for_each(|at| {
                visit(Found {
                    which,
                    edge,
                    side: (s, k),
                    triangle: t,
                    at,
                })
            });
        }
    }
}
