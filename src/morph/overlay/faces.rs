//! The faces between the edges of two maps, by traversal of their boundaries.
//!
//! Around a vertex edges have the order of its triangles. Around a crossing the two edges
//! alternate, in the order of their directions. The traversal of a face leaves each vertex by the
//! edge before the one of arrival.

use std::collections::HashMap;

use super::OverlaidMap;
use super::walk::{Exactly, Ground};
use crate::morph::sphere::turn;

/// Crossings of edges, with their order along the edges.
pub(super) struct Crossings {
    /// Edge of the first map and of the second.
    pub pairs: Vec<[u32; 2]>,
    /// Crossings of each edge of each map, in order from its first end.
    pub along: [Vec<Vec<u32>>; 2],
}

impl Crossings {
    /// Numbers the crossings; both maps must have the same ones.
    pub fn new(overlaid: &[OverlaidMap; 2]) -> Result<Self, Exactly> {
        let mut numbers = HashMap::new();
        let mut pairs = Vec::new();
        let mut first = Vec::with_capacity(overlaid[0].crossed.len());
        for (e, crossed) in overlaid[0].crossed.iter().enumerate() {
            let mut along = Vec::with_capacity(crossed.len());
            for &f in crossed {
                along.push(pairs.len() as u32);
                numbers.insert([e as u32, f], pairs.len() as u32);
                pairs.push([e as u32, f]);
            }
            first.push(along);
        }
        let number = |f: usize, e: &u32| numbers.get(&[*e, f as u32]).copied().ok_or(Exactly);
        let each = overlaid[1].crossed.iter().enumerate();
        let second: Result<Vec<Vec<u32>>, Exactly> = each
            .map(|(f, crossed)| crossed.iter().map(|e| number(f, e)).collect())
            .collect();
        let second = second?;
        let seen: usize = second.iter().map(Vec::len).sum();
        if seen == pairs.len() && numbers.len() == pairs.len() {
            Ok(Self {
                pairs,
                along: [first, second],
            })
        } else {
            Err(Exactly)
        }
    }
}

/// Half edges of the merged surface, each with its start and end.
struct Halves {
    ends: Vec<[u32; 2]>,
    /// Half edges that start at each merged vertex, counter-clockwise.
    around: Vec<Vec<u32>>,
}

/// Triangles of the merged surface.
pub(super) fn triangles(
    grounds: &[Ground<'_>; 2],
    overlaid: &[OverlaidMap; 2],
    crossings: &Crossings,
) -> Result<Vec<[u32; 3]>, Exactly> {
    let halves = halves(grounds, crossings);
    let mut next = vec![u32::MAX; halves.ends.len()];
    for ring in &halves.around {
        for (i, &h) in ring.iter().enumerate() {
            // After arrival by the opposite of h, the traversal leaves by the half edge before h.
            let before = ring[if i == 0 { ring.len() - 1 } else { i - 1 }];
            next[(h ^ 1) as usize] = before;
        }
    }
    let mut seen = vec![false; next.len()];
    let mut triangles = Vec::new();
    let mut faces = 0usize;
    for start in 0..next.len() {
        if seen[start] {
            continue;
        }
        let (mut corners, mut at) = (Vec::with_capacity(6), start);
        while !seen[at] {
            seen[at] = true;
            corners.push(halves.ends[at][0]);
            at = next[at] as usize;
        }
        // A face lies in one triangle of each map: it is convex with three to six corners.
        if at != start || !(3..=6).contains(&corners.len()) {
            return Err(Exactly);
        }
        faces += 1;
        triangles.extend((1..corners.len() - 1).map(|k| [corners[0], corners[k], corners[k + 1]]));
    }
    let vertices = overlaid[0].on.len() + overlaid[1].on.len() + crossings.pairs.len();
    // V - E + F = 2, or the crossings are inconsistent.
    if vertices + faces == halves.ends.len() / 2 + 2 {
        Ok(triangles)
    } else {
        Err(Exactly)
    }
}

/// The parts of edges between vertices and crossings: half edges 2 k and 2 k + 1 are the two
/// directions of one part.
fn halves(grounds: &[Ground<'_>; 2], crossings: &Crossings) -> Halves {
    let counts = [
        grounds[0].map.points().len() as u32,
        grounds[1].map.points().len() as u32,
    ];
    let base = counts[0] + counts[1];
    let shift = [0, counts[0]];
    let mut ends = Vec::new();
    // For each map and edge the half edges at its two ends, and for each crossing those that start
    // there.
    let mut leaving: [Vec<[u32; 2]>; 2] = [Vec::new(), Vec::new()];
    let mut at_crossing = vec![[[0u32; 2]; 2]; crossings.pairs.len()];
    for side in 0..2 {
        for (e, &[a, b]) in grounds[side].topology.edges.iter().enumerate() {
            let first = ends.len() as u32;
            let mut from = a + shift[side];
            for (k, &x) in crossings.along[side][e].iter().enumerate() {
                ends.extend([[from, base + x], [base + x, from]]);
                let back = first + 2 * k as u32 + 1;
                at_crossing[x as usize][side] = [back + 1, back];
                from = base + x;
            }
            ends.extend([[from, b + shift[side]], [b + shift[side], from]]);
            leaving[side].push([first, ends.len() as u32 - 1]);
        }
    }
    let mut around = Vec::with_capacity(base as usize + crossings.pairs.len());
    for side in 0..2 {
        around.extend((0..counts[side]).map(|v| around_vertex(&grounds[side], v, &leaving[side])));
    }
    for (x, &[e, f]) in crossings.pairs.iter().enumerate() {
        let [[on, back], [other, other_back]] = at_crossing[x];
        let p = grounds[0].topology.edges[e as usize].map(|v| &grounds[0].map.points()[v as usize]);
        let q = grounds[1].topology.edges[f as usize];
        // The second edge goes to the left of the first if its far end lies there.
        let left = turn(p[0], p[1], &grounds[1].map.points()[q[1] as usize]) > 0.0;
        around.push(if left {
            vec![on, other, back, other_back]
        } else {
            vec![on, other_back, back, other]
        });
    }
    Halves { ends, around }
}

/// Half edges that start at a vertex, counter-clockwise.
fn around_vertex(ground: &Ground<'_>, vertex: u32, leaving: &[[u32; 2]]) -> Vec<u32> {
    let (topology, triangles) = (&ground.topology, ground.map.triangles());
    let out =
        |edge: u32| leaving[edge as usize][usize::from(topology.edges[edge as usize][0] != vertex)];
    let fan = topology.triangles_of_vertex(vertex as usize);
    let (mut ring, mut at) = (Vec::with_capacity(fan.len()), fan[0]);
    for _ in fan {
        let k = triangles[at as usize]
            .iter()
            .position(|&v| v == vertex)
            .unwrap_or(0);
        // Counter-clockwise the outgoing side comes first; the triangle across the incoming side is
        // next.
        ring.push(out(topology.triangle_edges[at as usize][k]));
        at = topology.neighbours_of_triangle(at as usize)[(k + 2) % 3].unwrap_or(at);
    }
    ring
}
