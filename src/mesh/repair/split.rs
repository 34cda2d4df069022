//! Separates surfaces along edges with more than two triangles and at vertices where they touch.

mod divide;

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::working::Working;
use super::{RepairStep, topology};
use crate::format::counted;
use crate::mesh::measures::triangle_areas;
use crate::mesh::orientation::Orientation;
use crate::mesh::predicates::is_flat;
use crate::mesh::topology::Topology;
use crate::mesh::union_find::UnionFind;

/// Gives each edge at most two triangles and each vertex one fan.
///
/// Triangles around an edge that face each other across the inside of a body stay together. A sheet
/// that hangs on a closed surface, or divides it, is separated as a whole.
pub(super) fn split(working: &mut Working) {
    let before = topology(working);
    let edges = before.non_manifold_edges();
    let patches = Orientation::new(&before, &working.triangles);
    let sheets = sheets(working, &before, &edges, &patches);
    // The orientation that the triangles will have within their patch.
    let turned = |(t, turn): (&[u32; 3], &bool)| if *turn { [t[1], t[0], t[2]] } else { *t };
    let oriented: Vec<[u32; 3]> = working
        .triangles
        .iter()
        .zip(&patches.turn)
        .map(turned)
        .collect();
    let groups: Vec<Vec<Vec<u32>>> = edges
        .iter()
        .map(|&e| {
            groups(
                before.edges[e as usize],
                before.triangles_of_edge(e as usize),
                &sheets,
                &oriented,
                &working.vertices,
            )
        })
        .collect();
    let mut corners = Corners::new(working.triangles.len());
    for e in 0..before.edges.len() {
        if let [s, t] = *before.triangles_of_edge(e) {
            corners.join_along(&working.triangles, before.edges[e], s, t);
        }
    }
    for (e, groups) in edges.iter().zip(&groups) {
        for group in groups {
            if let [s, t] = group[..] {
                corners.join_along(&working.triangles, before.edges[*e as usize], s, t);
            }
        }
    }
    let mut copied = corners.give_vertices(working, &before);
    let edges: Vec<[u32; 2]> = edges.iter().map(|e| before.edges[*e as usize]).collect();
    copied.extend(divide::divide(working, &edges, &groups));
    let (count, edges) = (copied.len(), edges.len());
    let message = || {
        let added = counted(count, "vertex", "vertices");
        let at = if edges == 0 {
            String::new()
        } else {
            format!(
                ", {} with more than two triangles",
                counted(edges, "edge", "edges")
            )
        };
        format!("added {added} where surfaces touch{at}")
    };
    working.note(RepairStep::SplitVertices, count, message, copied);
}

/// The triangles of patches that are separated before the rest is paired: those with their own
/// boundary on edges with an odd number of triangles, otherwise the smallest of such patches, until
/// no such edge has a patch to spare.
fn sheets(
    working: &Working,
    topology: &Topology,
    edges: &[u32],
    patches: &Orientation,
) -> Vec<bool> {
    let mut taken = vec![false; working.triangles.len()];
    if edges.is_empty() {
        return taken;
    }
    let mut rim = vec![false; patches.count];
    let mut area = vec![0.0; patches.count];
    for (t, part) in triangle_areas(&working.vertices, &working.triangles)
        .into_iter()
        .enumerate()
    {
        area[patches.patches[t] as usize] += part;
    }
    for e in topology.boundary_edges() {
        topology
            .triangles_of_edge(e as usize)
            .iter()
            .for_each(|t| rim[patches.patches[*t as usize] as usize] = true);
    }
    let mut order: Vec<usize> = (0..patches.count).collect();
    // Patches with a boundary first, then by area. Each is tested once, so the time is that of a
    // sort.
    order.sort_by(|&p, &q| {
        rim[q]
            .cmp(&rim[p])
            .then(area[p].total_cmp(&area[q]))
            .then(p.cmp(&q))
    });
    let mut at_edge: Vec<Vec<u32>> = vec![Vec::new(); patches.count];
    let mut left: Vec<usize> = vec![0; topology.edges.len()];
    for &e in edges {
        let around = topology.triangles_of_edge(e as usize);
        left[e as usize] = around.len();
        around
            .iter()
            .for_each(|t| at_edge[patches.patches[*t as usize] as usize].push(e));
    }
    let mut sheet = vec![false; patches.count];
    for p in order {
        // The patch may only touch edges with one surplus triangle, each with one triangle of its
        // own.
        let once = at_edge[p].windows(2).all(|w| w[0] != w[1]);
        if !at_edge[p].is_empty() && once && at_edge[p].iter().all(|&e| left[e as usize] % 2 == 1) {
            sheet[p] = true;
            at_edge[p].iter().for_each(|&e| left[e as usize] -= 1);
        }
    }
    taken
        .iter_mut()
        .zip(&patches.patches)
        .for_each(|(taken, p)| *taken = sheet[*p as usize]);
    taken
}

/// The pairs of triangles around an edge that stay together; a triangle without a partner is a
/// group of its own.
fn groups(
    edge: [u32; 2],
    around: &[u32],
    sheets: &[bool],
    triangles: &[[u32; 3]],
    points: &[Point3<f64>],
) -> Vec<Vec<u32>> {
    let bodies: Vec<u32> = around
        .iter()
        .filter(|t| !sheets[**t as usize])
        .copied()
        .collect();
    let mut groups = pairs(edge, &bodies, triangles, points);
    let paired: BTreeSet<u32> = groups.iter().flatten().copied().collect();
    groups.extend(
        around
            .iter()
            .filter(|t| !paired.contains(t))
            .map(|t| vec![*t]),
    );
    groups
}

/// Pairs of triangles around an edge that face each other across the inside of a body.
fn pairs(
    edge: [u32; 2],
    around: &[u32],
    triangles: &[[u32; 3]],
    points: &[Point3<f64>],
) -> Vec<Vec<u32>> {
    if around.len() == 2 {
        return vec![around.to_vec()];
    }
    let order = by_angle(edge, around, triangles, points);
    let runs = |t: u32| {
        (0..3).any(|k| {
            triangles[t as usize][k] == edge[0] && triangles[t as usize][(k + 1) % 3] == edge[1]
        })
    };
    let mut joined = Vec::new();
    // A triangle that traverses the edge backwards has the inside after it, one that traverses it
    // forwards before it: they match like brackets. Two rounds, since a body can lie across the
    // start.
    let mut open: Vec<usize> = Vec::new();
    let (mut opened, mut closed) = (vec![false; order.len()], vec![false; order.len()]);
    for k in (0..2 * order.len()).map(|k| k % order.len()) {
        if closed[k] || opened[k] {
            continue;
        }
        if !runs(order[k]) {
            opened[k] = true;
            open.push(k);
        } else if let Some(first) = open.pop() {
            joined.push(vec![order[first], order[k]]);
            (closed[first], closed[k]) = (true, true);
        }
    }
    joined
}

/// The triangles by their angle about the edge, from that of the first, counter-clockwise seen against its direction.
///
/// Angles have a rounding error of about 1e-15 times the length of the edge over the height of the
/// triangle. Triangles nearer to each other are sorted by index.
fn by_angle(
    edge: [u32; 2],
    around: &[u32],
    triangles: &[[u32; 3]],
    points: &[Point3<f64>],
) -> Vec<u32> {
    let [a, b] = edge.map(|v| points[v as usize]);
    let axis = (b - a).try_normalize(0.0).unwrap_or_else(Vector3::z);
    let across = |t: u32| {
        let apex = triangles[t as usize]
            .into_iter()
            .find(|v| !edge.contains(v))
            .unwrap_or(edge[0]);
        let away = points[apex as usize] - a;
        away - axis * away.dot(&axis)
    };
    // A triangle without area has no reference direction.
    let open = around
        .iter()
        .find(|t| !is_flat(&triangles[**t as usize].map(|v| points[v as usize])));
    let start = open.map_or_else(Vector3::x, |t| across(*t));
    let angle = |t: u32| {
        let away = across(t);
        let angle = libm::atan2(axis.dot(&start.cross(&away)), start.dot(&away));
        if angle < 0.0 {
            angle + std::f64::consts::TAU
        } else {
            angle
        }
    };
    let mut order: Vec<(f64, u32)> = around.iter().map(|t| (angle(*t), *t)).collect();
    order.sort_by(|s, t| s.0.total_cmp(&t.0).then(s.1.cmp(&t.1)));
    order.into_iter().map(|(_, t)| t).collect()
}

/// Corners of triangles, joined where they share a vertex.
struct Corners {
    sets: UnionFind,
}

impl Corners {
    fn new(triangles: usize) -> Self {
        Self {
            sets: UnionFind::new(3 * triangles),
        }
    }

    /// Joins the corners of two triangles at both ends of a common edge.
    fn join_along(&mut self, triangles: &[[u32; 3]], edge: [u32; 2], s: u32, t: u32) {
        let corner = |t: u32, v: u32| {
            3 * t
                + triangles[t as usize]
                    .iter()
                    .position(|w| *w == v)
                    .unwrap_or(0) as u32
        };
        for v in edge {
            self.sets.join(corner(s, v), corner(t, v));
        }
    }

    /// Gives each group of corners beyond the first of a vertex a copy of the vertex. Returns the
    /// copied vertices, once per copy, by their original index.
    fn give_vertices(mut self, working: &mut Working, topology: &Topology) -> Vec<u32> {
        let mut copied = Vec::new();
        for v in 0..topology.vertex_count() {
            let corner = |t: &u32| {
                3 * t
                    + working.triangles[*t as usize]
                        .iter()
                        .position(|w| *w as usize == v)
                        .unwrap_or(0) as u32
            };
            let corners: Vec<u32> = topology.triangles_of_vertex(v).iter().map(corner).collect();
            let mut groups: Vec<(u32, u32)> = corners
                .into_iter()
                .map(|c| (self.sets.root(c), c))
                .collect();
            // The group of the lowest triangle is first and keeps the vertex.
            groups.sort_unstable();
            for (k, group) in groups.chunk_by(|a, b| a.0 == b.0).enumerate() {
                if k == 0 {
                    continue;
                }
                let copy = working.copy_vertex(v);
                copied.push(working.vertex_origin[v]);
                group
                    .iter()
                    .for_each(|(_, c)| working.triangles[*c as usize / 3][*c as usize % 3] = copy);
            }
        }
        copied
    }
}

impl Working {
    fn copy_vertex(&mut self, v: usize) -> u32 {
        self.vertices.push(self.vertices[v]);
        self.vertex_origin.push(self.vertex_origin[v]);
        self.vertices.len() as u32 - 1
    }
}
