//! Where the edges of one surface cross the triangles of another.

use nalgebra::Point3;

use super::hierarchy::Hierarchy;
use crate::mesh::predicates::{is_flat, near_one, segment_meets, side, turn};
use crate::mesh::topology::Topology;

/// Roundings of a product of two differences of coordinates, relative to the lengths; a generous count.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// A point that an edge and a triangle share, as weights of their points: each sum to 1, none is negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Weights of the ends of the edge.
    pub edge: [f64; 2],
    /// Weights of the corners of the triangle.
    pub triangle: [f64; 3],
}

/// Where an edge crosses a triangle; whether it does is decided exactly \[shewchuk1997\]. `None` also for a triangle without
/// area: the edges of its neighbours meet what it meets.
///
/// An edge that lies in the plane of the triangle crosses it where the middle of what they share is. Where it almost does,
/// rounding says where along it, but both sides name the same point.
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

/// Sizes over their sum; `None` where all are zero.
fn shares<const N: usize>(of: [f64; N]) -> Option<[f64; N]> {
    let sum: f64 = of.iter().sum();
    (sum > 0.0).then(|| of.map(|v| v / sum))
}

/// How far the ends of an edge are within a side of a triangle, seen along an axis [m2], positive inside; what is less than
/// `doubt` may be rounding.
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

/// The sides opposite to each corner, along the axis that shows most of the triangle.
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

/// Where along an edge it crosses: as its heights over the plane say, but within the sides. An edge that is nearly parallel to
/// the plane has heights that are mostly rounding, one that is nearly parallel to a side is within it by rounding only, and
/// such a side has no say. Without heights it is the middle of what is within.
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
    // Where they share one point only, the two ends of what is shared may cross by rounding.
    let middle = 0.5 * (from + to);
    by_heights.map_or(middle, |share| {
        share.max(from.min(middle)).min(to.max(middle))
    })
}

/// Which triangle tests each edge: the first that has it, so that an edge which several share is looked at once (errata B12).
#[derive(Clone, Debug, Default)]
pub struct EdgeOwners {
    /// For each triangle, whether it owns the side from corner k to corner k + 1.
    owned: Vec<[bool; 3]>,
}

impl EdgeOwners {
    /// Of triangles over `vertex_count` points.
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

    /// The sides that a triangle owns, by their first corner.
    pub fn of(&self, triangle: u32) -> impl Iterator<Item = usize> {
        let owned = self.owned[triangle as usize];
        (0..3).filter(move |&k| owned[k])
    }
}

/// A surface with what finds its crossings.
#[derive(Clone, Copy)]
pub struct Sheet<'a> {
    /// Positions [m].
    pub x: &'a [Point3<f64>],
    /// Triangles.
    pub triangles: &'a [[u32; 3]],
    /// Boxes that were refitted to these positions.
    pub hierarchy: &'a Hierarchy,
    /// Which triangle tests each edge.
    pub owners: &'a EdgeOwners,
}

/// Which of two surfaces has the edge of a crossing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The first.
    OfFirst,
    /// The second.
    OfSecond,
}

/// An edge of one surface that crosses a triangle of the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Which surface has the edge.
    pub which: Edge,
    /// The ends of the edge.
    pub edge: [u32; 2],
    /// The triangle that owns the edge, and which of its sides the edge is.
    pub side: (u32, usize),
    /// The triangle of the other surface.
    pub triangle: u32,
    /// Where they cross.
    pub at: Crossing,
}

/// Visits each edge of one surface with each triangle of the other that it crosses, both ways (errata B07): the edges of
/// either surface alone miss a tip that pierces a large triangle.
pub fn crossings(first: Sheet<'_>, second: Sheet<'_>, mut visit: impl FnMut(Found)) {
    first.hierarchy.pairs(second.hierarchy, |s, t| {
        crossings_of([s, t], first, second, &mut visit)
    });
}

/// As [`crossings`], of one triangle of each, such as those that [`super::Voxels::pairs`] names. Sides that a triangle does not
/// own are left to its neighbours, which have the same point.
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
