//! Search for the near pairs of two surfaces: vertices and triangles, edges and edges.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::gap::{Gap, Parts, Within, gap_within};
use super::surface::Surface;

/// Number of pairs of triangles that a thread searches at once.
const CHUNK: usize = 1024;

/// The corners and edges that a triangle owns: each vertex and each edge of a surface belongs to
/// one of its triangles, so that a search over pairs of triangles finds each pair once.
#[derive(Clone, Debug)]
pub(super) struct Owned(Vec<u8>);

impl Owned {
    pub fn new(triangles: &[[u32; 3]]) -> Self {
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
        Self(triangles.iter().map(of).collect())
    }

    fn corner(&self, triangle: u32, k: usize) -> bool {
        self.0[triangle as usize] >> k & 1 == 1
    }

    fn edge(&self, triangle: u32, k: usize) -> bool {
        self.0[triangle as usize] >> (3 + k) & 1 == 1
    }
}

/// A surface of the search: its hierarchy, and its place in the world.
pub(super) struct Side<'a> {
    pub surface: &'a Surface,
    pub owned: &'a Owned,
    /// The pose of a rigid surface; `None` for positions in the world.
    pub pose: Option<&'a Isometry3<f64>>,
}

/// A near pair. Its corners are vertices of the two surfaces; `first` tells which part belongs to
/// the first surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearPair {
    pub parts: Parts,
    pub corners: [u32; 4],
    /// True if the first part belongs to the first surface of the search.
    pub in_order: bool,
    /// The gap; `None` for parts that touch.
    pub gap: Option<Gap>,
}

/// Every pair of parts of two surfaces nearer than `reach` [m]; of a surface with itself if `other`
/// is `None`, without the pairs that share a vertex. The boxes of soft surfaces are wider by half of
/// the reach. The order does not depend on the number of threads.
pub(super) fn near_pairs(one: &Side<'_>, other: Option<&Side<'_>>, reach: f64) -> Vec<NearPair> {
    let meeting = match other {
        None => one.surface.own_pairs(),
        Some(other) => one
            .surface
            .pairs_with(other.surface, other.pose, 0.5 * reach),
    };
    let chunks: Vec<Vec<NearPair>> = meeting
        .par_chunks(CHUNK)
        .map(|triangles| {
            let mut found = Vec::new();
            for &pair in triangles {
                let sides = [one, other.unwrap_or(one)];
                search(pair, sides, other.is_none(), reach, &mut found);
            }
            found
        })
        .collect();
    chunks.concat()
}

/// The near pairs of a triangle of the first side and one of the other side.
fn search(
    [t, u]: [u32; 2],
    [one, other]: [&Side<'_>; 2],
    itself: bool,
    reach: f64,
    found: &mut Vec<NearPair>,
) {
    let p = one.surface.corners(t);
    let mine = one.surface.triangles()[t as usize];
    let q = other.surface.corners(u);
    let q = other.pose.map_or(q, |pose| q.map(|q| pose * q));
    let theirs = other.surface.triangles()[u as usize];
    let mut add = |parts, corners: [u32; 4], x: [Point3<f64>; 4], in_order| {
        if (itself && is_joined(parts, &corners)) || is_farther(parts, &x, reach) {
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
            in_order,
            gap,
        });
    };
    for k in 0..3 {
        if one.owned.corner(t, k) {
            let [a, b, c] = theirs;
            add(
                Parts::VertexTriangle,
                [mine[k], a, b, c],
                [p[k], q[0], q[1], q[2]],
                true,
            );
        }
        if other.owned.corner(u, k) {
            let [a, b, c] = mine;
            add(
                Parts::VertexTriangle,
                [theirs[k], a, b, c],
                [q[k], p[0], p[1], p[2]],
                false,
            );
        }
    }
    for k in (0..3).filter(|&k| one.owned.edge(t, k)) {
        let l = (k + 1) % 3;
        for m in (0..3).filter(|&m| other.owned.edge(u, m)) {
            let n = (m + 1) % 3;
            let corners = [mine[k], mine[l], theirs[m], theirs[n]];
            add(Parts::EdgeEdge, corners, [p[k], p[l], q[m], q[n]], true);
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

/// True if the parts share a vertex.
fn is_joined(parts: Parts, corners: &[u32; 4]) -> bool {
    let (one, other) = corners.split_at(parts.first());
    one.iter().any(|v| other.contains(v))
}
