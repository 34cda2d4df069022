//! Closes small holes by the triangulation of least area \[barequet1995\].

use std::collections::BTreeSet;

use nalgebra::Point3;

use super::working::Working;
use super::{RepairStep, topology};
use crate::format::counted;
use crate::mesh::boundary::rims;
use crate::mesh::predicates::is_flat;
use crate::mesh::topology::Topology;

/// Closes every boundary loop of at most `longest` edges without a new vertex, unless an edge would
/// get a third triangle.
pub(super) fn close(working: &mut Working, longest: usize) {
    if longest < 3 {
        return;
    }
    let topology = topology(working);
    let (mut closed, mut around, mut added) = (0, Vec::new(), 0);
    // Chords of the covers; a second cover over the same chord would give an edge with four
    // triangles.
    let mut chords = BTreeSet::new();
    for rim in rims(&topology) {
        if !rim.closed || !(3..=longest).contains(&rim.vertices.len()) {
            continue;
        }
        let mut ring = rim.vertices;
        // The cover traverses the first edge of the loop against its triangle. If other triangles
        // have the opposite orientation, a later step reverses them.
        let Some(edge) = topology.find_edge(ring[0], ring[1]) else {
            continue;
        };
        let Some(&beside) = topology.triangles_of_edge(edge as usize).first() else {
            continue;
        };
        let corners = working.triangles[beside as usize];
        let along = (0..3).any(|k| corners[k] == ring[0] && corners[(k + 1) % 3] == ring[1]);
        if !along {
            ring.reverse();
        }
        let Some(cover) = cover(&ring, &working.vertices, &topology, &chords) else {
            continue;
        };
        // A loose triangle is no hole: its cover would be the same triangle reversed.
        if cover.len() == 1 && ring.iter().all(|v| corners.contains(v)) {
            continue;
        }
        chords.extend(
            cover
                .iter()
                .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)].map(|(u, v)| [u.min(v), u.max(v)])),
        );
        closed += 1;
        added += cover.len();
        around.extend(ring.iter().map(|v| working.vertex_origin[*v as usize]));
        working.triangle_origin.extend(cover.iter().map(|_| None));
        working.triangles.extend(cover);
    }
    let message = || {
        let (holes, triangles) = (
            counted(closed, "hole", "holes"),
            counted(added, "triangle", "triangles"),
        );
        format!("closed {holes} with {triangles}")
    };
    working.note(RepairStep::ClosedHoles, closed, message, around);
}

/// Vertices with more open edges are not searched for gaps, as the time is quadratic.
const MOST_OPEN: usize = 64;

/// Closes every gap of three edges between triangles that share its corners, before the triangles
/// are separated there. A missing triangle leaves such a gap if its neighbour has no other
/// neighbour. Acts only if loops of three edges are closed.
pub(super) fn close_gaps(working: &mut Working, longest: usize) {
    if longest < 3 {
        return;
    }
    let topology = topology(working);
    let mut open: Vec<Vec<(u32, u32)>> = vec![Vec::new(); working.vertices.len()];
    let mut edges = Vec::new();
    for e in topology.boundary_edges() {
        let ([a, b], [t]) = (
            topology.edges[e as usize],
            topology.triangles_of_edge(e as usize),
        ) else {
            continue;
        };
        edges.push(([a, b], *t));
        open[a as usize].push((b, *t));
        open[b as usize].push((a, *t));
    }
    open.iter_mut().for_each(|list| list.sort_unstable());
    let (mut used, mut added) = (BTreeSet::new(), Vec::new());
    for ([a, b], t) in edges {
        let counts = [a, b].map(|v| open[v as usize].len());
        let is_pinched = counts.iter().any(|count| *count > 2);
        if !is_pinched || counts.iter().any(|count| *count > MOST_OPEN) || used.contains(&[a, b]) {
            continue;
        }
        if let Some(c) = third_corner(&open, &used, [a, b], t) {
            used.extend([[a, b], [a, c], [b, c]].map(|[u, v]| [u.min(v), u.max(v)]));
            // Opposite to its neighbour along the first edge; if others have the opposite
            // orientation, a later step reverses them.
            let corners = working.triangles[t as usize];
            let along = (0..3).any(|k| corners[k] == a && corners[(k + 1) % 3] == b);
            added.push(if along { [b, a, c] } else { [a, b, c] });
        }
    }
    let around: Vec<u32> = added
        .iter()
        .flatten()
        .map(|v| working.vertex_origin[*v as usize])
        .collect();
    let count = added.len();
    working.triangle_origin.extend(added.iter().map(|_| None));
    working.triangles.extend(added);
    let message = || {
        format!(
            "closed {} between triangles that meet in corners",
            counted(count, "gap", "gaps")
        )
    };
    working.note(RepairStep::ClosedHoles, count, message, around);
}

/// The third corner of a gap at the edge `[a, b]` of triangle `t`. `open` lists the other end and
/// the triangle of each boundary edge of a vertex; `used` are edges of gaps closed before.
fn third_corner(
    open: &[Vec<(u32, u32)>],
    used: &BTreeSet<[u32; 2]>,
    [a, b]: [u32; 2],
    t: u32,
) -> Option<u32> {
    let around_b = &open[b as usize];
    for &(c, s) in &open[a as usize] {
        let Ok(at) = around_b.binary_search_by_key(&c, |(other, _)| *other) else {
            continue;
        };
        let all = [t, s, around_b[at].1];
        // Three edges of one triangle are that triangle, not a gap.
        let apart = all[0] != all[1] && all[1] != all[2] && all[2] != all[0];
        let unused = [[a, c], [b, c]]
            .iter()
            .all(|[u, v]| !used.contains(&[*u.min(v), *u.max(v)]));
        if c != b && apart && unused {
            return Some(c);
        }
    }
    None
}

/// Cost of a part of a cover: first the number of triangles without area, then the area.
type Cost = (u32, f64);

/// The triangles of least total area over a closed walk; `None` if every choice gives an edge a
/// third triangle.
fn cover(
    ring: &[u32],
    points: &[Point3<f64>],
    topology: &Topology,
    chords: &BTreeSet<[u32; 2]>,
) -> Option<Vec<[u32; 3]>> {
    let n = ring.len();
    // A chord that is already an edge would get more than two triangles.
    let is_edge = |u: u32, v: u32| {
        topology.find_edge(u, v).is_some() || chords.contains(&[u.min(v), u.max(v)])
    };
    let mut best: Vec<Option<(Cost, usize)>> = vec![None; n * n];
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let is_side = i == 0 && j == n - 1;
            if is_side || !is_edge(ring[i], ring[j]) {
                best[i * n + j] = cheapest(ring, points, &best, [i, j]);
            }
        }
    }
    let mut cover = Vec::new();
    let mut open = vec![(0, n - 1)];
    while let Some((i, j)) = open.pop() {
        if j - i < 2 {
            continue;
        }
        let (_, m) = best[i * n + j]?;
        // The ring has the direction of its triangles, the cover the opposite one.
        cover.push([ring[i], ring[j], ring[m]]);
        open.extend([(i, m), (m, j)]);
    }
    Some(cover)
}

/// The least cost of a cover of the ring from place `i` to `j`, with the third corner of the
/// triangle at the chord between them; `best` has these of the shorter chords.
fn cheapest(
    ring: &[u32],
    points: &[Point3<f64>],
    best: &[Option<(Cost, usize)>],
    [i, j]: [usize; 2],
) -> Option<(Cost, usize)> {
    let cost = |i: usize, j: usize| -> Option<Cost> {
        if j - i == 1 {
            Some((0, 0.0))
        } else {
            best[i * ring.len() + j].map(|(cost, _)| cost)
        }
    };
    let mut found = None;
    for m in i + 1..j {
        let (Some(left), Some(right)) = (cost(i, m), cost(m, j)) else {
            continue;
        };
        let corners = [i, m, j].map(|k| points[ring[k] as usize]);
        let area = 0.5
            * (corners[1] - corners[0])
                .cross(&(corners[2] - corners[0]))
                .norm();
        let flat = u32::from(is_flat(&corners));
        let total = (left.0 + right.0 + flat, left.1 + right.1 + area);
        let better = |(known, _): (Cost, usize)| {
            total.0 < known.0 || (total.0 == known.0 && total.1 < known.1)
        };
        if found.is_none_or(better) {
            found = Some((total, m));
        }
    }
    found
}
