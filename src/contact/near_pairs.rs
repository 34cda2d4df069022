//! Search for the near pairs of two patches: vertices and triangles, edges and edges.

use nalgebra::Point3;

use super::gap::{Gap, Parts, Within, gap_within};
use crate::mesh::measures::Aabb;

/// The corners and edges that each triangle owns: every vertex and every edge of a surface belongs
/// to one of its triangles, so that a search over pairs of triangles finds each pair once. Bit k is
/// set for corner k, bit 3 + k for the edge that begins there.
pub(super) fn owned(triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut vertices = std::collections::HashSet::new();
    let mut edges = std::collections::HashSet::new();
    let of = |&[a, b, c]: &[u32; 3]| {
        let mut bits = 0;
        for (k, v) in [a, b, c].into_iter().enumerate() {
            bits |= u8::from(vertices.insert(v)) << k;
        }
        for (k, [v, w]) in [[a, b], [b, c], [c, a]].into_iter().enumerate() {
            bits |= u8::from(edges.insert([v.min(w), v.max(w)])) << (3 + k);
        }
        bits
    };
    triangles.iter().map(of).collect()
}

/// A triangle of a search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    /// Numbers of its corners.
    pub corners: [u32; 3],
    /// What it owns, see [`owned`].
    pub owned: u8,
    /// Its corners [m].
    pub x: [Point3<f64>; 3],
    bounds: Aabb,
}

impl Facet {
    pub fn new(corners: [u32; 3], owned: u8, x: [Point3<f64>; 3]) -> Self {
        Self {
            corners,
            owned,
            bounds: Aabb::of_points(&x),
            x,
        }
    }

    fn owns(&self, bit: usize) -> bool {
        self.owned >> bit & 1 == 1
    }
}

/// A near pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearPair {
    pub parts: Parts,
    pub corners: [u32; 4],
    /// The gap; `None` for parts that touch.
    pub gap: Option<Gap>,
}

/// The pairs of parts of two patches that a search finds.
pub(super) struct NearPairs {
    pub pairs: Vec<NearPair>,
    /// All other pairs are at least this far apart [m].
    pub reach: f64,
}

/// Every pair of parts of two patches nearer than `reach` [m], without the pairs that share a
/// vertex; of a patch with itself if `other` is `None`.
pub(super) fn near_pairs(one: &[Facet], other: Option<&[Facet]>, reach: f64) -> NearPairs {
    let (mut pairs, mut least) = (Vec::new(), f64::INFINITY);
    // Most triangles of two patches are far from the other patch as a whole.
    let mut near = |of: &[Facet], from: &[Facet]| -> Vec<Facet> {
        let bounds = from.iter().fold(Aabb::EMPTY, |all, f| all.union(&f.bounds));
        let is_near = |facet: &&Facet| {
            let apart = facet.bounds.distance(&bounds);
            least = if apart > reach {
                least.min(apart)
            } else {
                least
            };
            !(apart > reach)
        };
        of.iter().filter(is_near).copied().collect()
    };
    let (mine, theirs) = match other {
        Some(other) => (near(one, other), near(other, one)),
        None => (one.to_vec(), Vec::new()),
    };
    for (t, facet) in mine.iter().enumerate() {
        let others = if other.is_some() {
            &theirs
        } else {
            &mine[t + 1..]
        };
        for other in others {
            let apart = facet.bounds.distance(&other.bounds);
            if apart > reach {
                least = least.min(apart);
            } else {
                least = reach;
                search(facet, other, reach, &mut pairs);
            }
        }
    }
    NearPairs {
        pairs,
        reach: least.max(reach),
    }
}

/// The near pairs of two triangles.
fn search(one: &Facet, other: &Facet, reach: f64, found: &mut Vec<NearPair>) {
    let mut add = |parts: Parts, corners: [u32; 4], x: [Point3<f64>; 4]| {
        let (mine, theirs) = corners.split_at(parts.first());
        if mine.iter().any(|v| theirs.contains(v)) || is_farther(parts, &x, reach) {
            return;
        }
        let gap = match gap_within(parts, &x, reach) {
            Within::Farther => return,
            Within::Near(gap) => Some(gap),
            Within::Touching => None,
        };
        found.push(NearPair {
            parts,
            corners,
            gap,
        });
    };
    for (vertex, triangle) in [(one, other), (other, one)] {
        let ([a, b, c], [p, q, r]) = (triangle.corners, triangle.x);
        for k in (0..3).filter(|&k| vertex.owns(k)) {
            let corners = [vertex.corners[k], a, b, c];
            add(Parts::VertexTriangle, corners, [vertex.x[k], p, q, r]);
        }
    }
    for k in (0..3).filter(|&k| one.owns(3 + k)) {
        let l = (k + 1) % 3;
        for m in (0..3).filter(|&m| other.owns(3 + m)) {
            let n = (m + 1) % 3;
            // The order of the parts does not depend on the order of the search.
            let (mut corners, mut x) = (
                [
                    one.corners[k],
                    one.corners[l],
                    other.corners[m],
                    other.corners[n],
                ],
                [one.x[k], one.x[l], other.x[m], other.x[n]],
            );
            if corners[0].min(corners[1]) > corners[2].min(corners[3]) {
                corners.rotate_left(2);
                x.rotate_left(2);
            }
            add(Parts::EdgeEdge, corners, x);
        }
    }
}

/// True if the boxes of the parts are farther apart than `reach` along an axis.
fn is_farther(parts: Parts, x: &[Point3<f64>; 4], reach: f64) -> bool {
    let (one, other) = x.split_at(parts.first());
    (0..3).any(|k| {
        let low = |part: &[Point3<f64>]| part.iter().fold(f64::INFINITY, |low, p| low.min(p[k]));
        let high = |part: &[Point3<f64>]| {
            part.iter()
                .fold(f64::NEG_INFINITY, |high, p| high.max(p[k]))
        };
        low(one) - high(other) > reach || low(other) - high(one) > reach
    })
}
