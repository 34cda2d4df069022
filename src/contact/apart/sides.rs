//! The side of a thin body on which a surface lies.
//!
//! Vertices of a surface outside a body that only edges through the body join to the rest are on
//! the wrong side of it. The nearest way out would leave them there.

use std::collections::VecDeque;

use nalgebra::Vector3;

use super::crossing::Piercing;
use super::solid::Solid;
use crate::mesh::union_find::UnionFind;

/// For each vertex of a surface that must leave a body on a given side, the direction of that side;
/// `None` for a vertex that leaves it on the nearest one.
pub(super) type Sides = Vec<Option<Vector3<f64>>>;

/// A part with at least this share of a surface is on its own side.
const OWN: f64 = 0.25;
/// Number of sweeps that average directions over neighbours.
const SMOOTHING: usize = 20;

/// The vertices of `a` on a wrong side of the other surface, with those inside it between them and
/// the rest. `inside` is true for vertices of `a` in the other surface; `piercings` are its edges
/// through it.
pub(super) fn lost(a: &Solid, inside: &[bool], piercings: &[Piercing]) -> Vec<bool> {
    let count = a.x().len();
    let mut pierced = vec![false; a.topology.edges.len()];
    piercings
        .iter()
        .for_each(|p| pierced[p.edge as usize] = true);
    let mut sets = UnionFind::new(count);
    for (edge, &[u, v]) in a.topology.edges.iter().enumerate() {
        if !pierced[edge] && !inside[u as usize] && !inside[v as usize] {
            sets.join(u, v);
        }
    }
    let roots: Vec<usize> = (0..count as u32).map(|v| sets.root(v) as usize).collect();
    let mut sizes = vec![0usize; count];
    (0..count)
        .filter(|&v| !inside[v])
        .for_each(|v| sizes[roots[v]] += 1);
    let largest = sizes.iter().copied().max().unwrap_or(0) as f64;
    let own = largest.min(OWN * count as f64);
    let mut lost: Vec<bool> = (0..count)
        .map(|v| !inside[v] && (sizes[roots[v]] as f64) < own)
        .collect();
    let mut open: Vec<u32> = (0..count as u32).filter(|&v| lost[v as usize]).collect();
    let (starts, neighbours) = a.topology.vertex_neighbours();
    while let Some(v) = open.pop() {
        let around = starts[v as usize] as usize..starts[v as usize + 1] as usize;
        for &w in &neighbours[around] {
            if inside[w as usize] && !lost[w as usize] {
                lost[w as usize] = true;
                open.push(w);
            }
        }
    }
    lost
}

/// The direction of the side of `b` on which the rest of `a` lies, for the vertices with `lost`:
/// from the first triangles of `b` on the edges from the rest, and from neighbours.
pub(super) fn directions(
    a: &Solid,
    b: &Solid,
    lost: &[bool],
    piercings: &[Piercing],
    sides: &mut Sides,
) {
    let mut sum: Vec<Vector3<f64>> = vec![Vector3::zeros(); lost.len()];
    for group in piercings.chunk_by(|p, q| p.edge == q.edge) {
        let [u, v] = a.topology.edges[group[0].edge as usize];
        let ends = (lost[u as usize], lost[v as usize]);
        let (to, first) = match (ends, group) {
            ((false, true), [first, ..]) => (v, first),
            ((true, false), [.., last]) => (u, last),
            _ => continue,
        };
        let [p, q, r] = b.corners(first.triangle);
        let normal = (q - p).cross(&(r - p)).try_normalize(0.0);
        sum[to as usize] += normal.unwrap_or_default();
    }
    let mut queue = VecDeque::new();
    for v in (0..lost.len()).filter(|&v| lost[v]) {
        if let Some(direction) = sum[v].try_normalize(1e-6) {
            sides[v] = Some(direction);
            queue.push_back(v as u32);
        }
    }
    let (starts, neighbours) = a.topology.vertex_neighbours();
    while let Some(v) = queue.pop_front() {
        let around = &neighbours[starts[v as usize] as usize..starts[v as usize + 1] as usize];
        for &w in around {
            if lost[w as usize] && sides[w as usize].is_none() {
                sides[w as usize] = sides[v as usize];
                queue.push_back(w);
            }
        }
    }
}

/// Gives the vertices of `a` where both of its walls are in another surface one direction to leave
/// it: the mean of the nearest ways out `exits` (`None` outside) over their neighbours. Their own
/// walls would send them to opposite sides.
pub(super) fn common(a: &Solid, exits: &[Option<Vector3<f64>>], sides: &mut Sides) {
    let mut within = vec![false; exits.len()];
    for pair in &a.opposite {
        let [v, w] = pair.map(|v| v as usize);
        if exits[v].is_some() && exits[w].is_some() {
            (within[v], within[w]) = (true, true);
        }
    }
    let fixed: Vec<bool> = (0..exits.len()).map(|v| sides[v].is_some()).collect();
    let mut now: Vec<Vector3<f64>> = (0..exits.len())
        .map(|v| {
            sides[v]
                .or(exits[v])
                .filter(|_| within[v])
                .unwrap_or_default()
        })
        .collect();
    let (starts, neighbours) = &a.neighbours;
    for _ in 0..SMOOTHING {
        let before = now.clone();
        for v in (0..exits.len()).filter(|&v| within[v] && !fixed[v]) {
            let around = &neighbours[starts[v] as usize..starts[v + 1] as usize];
            let sum = around
                .iter()
                .fold(before[v], |sum, &w| sum + before[w as usize]);
            now[v] = sum / (1.0 + around.len() as f64);
        }
    }
    for v in (0..exits.len()).filter(|&v| within[v] && !fixed[v]) {
        sides[v] = now[v].try_normalize(1e-3);
    }
}
