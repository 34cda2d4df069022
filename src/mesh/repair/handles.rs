//! Cuts small handles, as those that noise leaves in segmented surfaces: a bridge between two parts, or a
//! tunnel through one.
//!
//! A loop around a handle does not divide the surface. The band of triangles along such a loop goes, and
//! both rims are closed, so that a bridge becomes two stumps, and a tunnel two dents. Loops come from a
//! tree of shortest paths and the greatest tree of the dual graph without its edges: each edge in neither
//! closes a loop, and all these loops together generate those that do not divide the surface
//! \[eppstein2003, erickson2005\].

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use nalgebra::Point3;

use super::working::Working;
use super::{LONGEST_RIM, RepairStep, fill, topology};
use crate::format::counted;
use crate::mesh::TriangleMesh;
use crate::mesh::crossings::crossings_of;
use crate::mesh::measures::Aabb;
use crate::mesh::topology::Topology;
use crate::mesh::union_find::UnionFind;

/// Widths of a band on each side of its loop, relative to the loop's length, and whether all loops get
/// theirs at once. With the first, rims are as far apart as a bridge or a tunnel is thick. A wider band takes
/// more of the parts that a bridge joins, a narrower one leaves less between the rims.
const WIDTHS: [(f64, bool); 4] = [(0.25, true), (0.25, false), (0.5, false), (0.0, false)];

/// Cuts every handle around which a loop of edges of at most this length leads. Acts on closed, oriented
/// surfaces; elsewhere a loop can end at a boundary. Handles stay where the closed rims would cross.
pub(super) fn cut(working: &mut Working, longest: f64) {
    if !(longest > 0.0) {
        return;
    }
    let side = Aabb::of_points(&working.vertices).extents().max();
    let (mut around, mut greatest) = (Vec::new(), 0.0_f64);
    let genus = |of: i64| (of / 2) as usize;
    let first = topology(working).euler_characteristic();
    while let Some((next, lengths, vertices)) = without_some(working, longest) {
        *working = next;
        greatest = lengths
            .into_iter()
            .fold(greatest, |a, b| if b <= a { a } else { b });
        around.extend(vertices);
    }
    let count = genus(topology(working).euler_characteristic() - first);
    let message = || {
        let handles = counted(count, "handle", "handles");
        // Repair does not know the unit.
        let share = crate::format::number(100.0 * greatest / side);
        format!("cut {handles}, around loops of up to {share} % of its longest side")
    };
    working.note(RepairStep::CutHandles, count, message, around);
}

/// A surface with fewer handles, the lengths of the loops, and their original vertices.
type Fewer = (Working, Vec<f64>, Vec<u32>);

/// The surface without one or more of its handles; `None` if no short loop can be cut.
fn without_some(working: &Working, longest: f64) -> Option<Fewer> {
    let topology = topology(working);
    if !(topology.is_closed() && topology.is_oriented()) {
        return None;
    }
    let sought = Loops::new(&working.vertices, &topology);
    let loops = sought.short(longest);
    let crossings = crossings_of(&working.vertices, &working.triangles).count;
    let attempt = |loops: &[(f64, Vec<u32>)], width: f64| -> Option<Fewer> {
        let mut is_in = vec![false; working.vertices.len()];
        let (mut lengths, mut around) = (Vec::new(), Vec::new());
        for (length, ring) in loops {
            let band = sought.paths(ring, width * length).reached;
            // Bands that touch are cut one after the other.
            let is_apart = |v: &u32| sought.around(*v).all(|next| !is_in[next as usize]);
            if band.keys().all(is_apart) {
                band.keys().for_each(|v| is_in[*v as usize] = true);
                lengths.push(*length);
                around.extend(ring.iter().map(|v| working.vertex_origin[*v as usize]));
            }
        }
        let mut next = working.clone();
        let _ = next.retain(|t| !working.triangles[t].iter().any(|v| is_in[*v as usize]));
        let notes = next.changes.len();
        fill::close(&mut next, LONGEST_RIM);
        // It is a part of one step.
        next.changes.truncate(notes);
        is_better(&next, &topology, crossings).then_some((next, lengths, around))
    };
    WIDTHS.iter().find_map(|&(width, at_once)| match at_once {
        true if !loops.is_empty() => attempt(&loops, width),
        true => None,
        false => loops
            .iter()
            .find_map(|one| attempt(std::slice::from_ref(one), width)),
    })
}

/// Whether a surface is as sound as before, in as many pieces, and has fewer handles.
fn is_better(next: &Working, before: &Topology, crossings: usize) -> bool {
    let topology = topology(next);
    let mesh = TriangleMesh {
        vertices: next.vertices.clone(),
        triangles: next.triangles.clone(),
    };
    topology.is_closed()
        && topology.is_oriented()
        && topology.non_manifold_vertices(&mesh).is_empty()
        && topology.components().count == before.components().count
        && topology.euler_characteristic() > before.euler_characteristic()
        && crossings_of(&mesh.vertices, &mesh.triangles).count <= crossings
}

/// A surface in which loops are sought.
struct Loops<'a> {
    vertices: &'a [Point3<f64>],
    topology: &'a Topology,
    lengths: Vec<f64>,
    /// The edges of each vertex: where they start in the list.
    starts: Vec<u32>,
    edges: Vec<u32>,
}

/// Shortest paths from a vertex: of each that was reached, its distance and the edge towards the root.
#[derive(Default)]
struct Paths {
    reached: BTreeMap<u32, (f64, Option<u32>)>,
}

impl<'a> Loops<'a> {
    fn new(vertices: &'a [Point3<f64>], topology: &'a Topology) -> Self {
        let length = |[a, b]: &[u32; 2]| (vertices[*a as usize] - vertices[*b as usize]).norm();
        let mut starts = vec![0u32; vertices.len() + 1];
        for v in topology.edges.iter().flatten() {
            starts[*v as usize + 1] += 1;
        }
        for v in 0..vertices.len() {
            starts[v + 1] += starts[v];
        }
        let (mut next, mut edges) = (starts.clone(), vec![0; 2 * topology.edges.len()]);
        for (e, ends) in topology.edges.iter().enumerate() {
            for v in ends {
                edges[next[*v as usize] as usize] = e as u32;
                next[*v as usize] += 1;
            }
        }
        Self {
            vertices,
            lengths: topology.edges.iter().map(length).collect(),
            topology,
            starts,
            edges,
        }
    }

    /// Loops of at most this length that together do not divide the surface and have no common vertex,
    /// the shortest first.
    fn short(&self, longest: f64) -> Vec<(f64, Vec<u32>)> {
        let mut found: Vec<(f64, Vec<u32>)> = Vec::new();
        for seed in self.generators() {
            // Seen from its own handle, the loop is the shortest one.
            let [root, _] = self.topology.edges[seed as usize];
            let paths = self.paths(&[root], 0.5 * longest);
            found.extend(self.through(&paths, longest));
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        let mut used = vec![false; self.vertices.len()];
        let mut cut = vec![false; self.topology.edges.len()];
        let mut chosen = Vec::new();
        let pieces = self.pieces(&cut);
        for (length, ring) in found {
            if ring.iter().any(|v| used[*v as usize]) {
                continue;
            }
            let along = self.along(&ring);
            along.iter().for_each(|e| cut[*e as usize] = true);
            // Two loops around one handle divide the surface.
            if self.pieces(&cut) > pieces {
                along.iter().for_each(|e| cut[*e as usize] = false);
                continue;
            }
            ring.iter().for_each(|v| used[*v as usize] = true);
            chosen.push((length, ring));
        }
        chosen
    }

    fn along(&self, ring: &[u32]) -> Vec<u32> {
        let sides = (0..ring.len()).map(|k| [ring[k], ring[(k + 1) % ring.len()]]);
        sides
            .filter_map(|[a, b]| self.topology.find_edge(a, b))
            .collect()
    }

    /// Number of pieces of the surface without these edges.
    fn pieces(&self, cut: &[bool]) -> usize {
        let mut sets = UnionFind::new(self.topology.triangle_count());
        let mut pieces = self.topology.triangle_count();
        for e in (0..cut.len()).filter(|e| !cut[*e]) {
            pieces -= usize::from(self.join(&mut sets, e as u32));
        }
        pieces
    }

    /// Joins the two triangles of an edge; false if they are joined already.
    fn join(&self, sets: &mut UnionFind, edge: u32) -> bool {
        match self.topology.triangles_of_edge(edge as usize) {
            &[s, t] => sets.join(s, t),
            _ => false,
        }
    }

    /// An edge of each loop of a basis, two for each handle.
    fn generators(&self) -> Vec<u32> {
        let components = self.topology.components();
        let mut roots = vec![None; components.count];
        for (v, label) in components.labels.iter().enumerate() {
            if let Some(root) = roots.get_mut(*label as usize) {
                root.get_or_insert(v as u32);
            }
        }
        let roots: Vec<u32> = roots.into_iter().flatten().collect();
        self.closing(&self.paths(&roots, f64::INFINITY))
            .into_iter()
            .map(|(_, e)| e)
            .collect()
    }

    /// Shortest paths from some vertices, as far as a distance.
    fn paths(&self, roots: &[u32], farthest: f64) -> Paths {
        let mut paths = Paths::default();
        // Distances are not negative, so that their bits are in order.
        let mut open: BinaryHeap<Reverse<(u64, u32, Option<u32>)>> = roots
            .iter()
            .map(|root| Reverse((0.0_f64.to_bits(), *root, None)))
            .collect();
        while let Some(Reverse((bits, v, by))) = open.pop() {
            if paths.reached.contains_key(&v) {
                continue;
            }
            let distance = f64::from_bits(bits);
            paths.reached.insert(v, (distance, by));
            let [first, last] = [0, 1].map(|k| self.starts[v as usize + k] as usize);
            for &e in &self.edges[first..last] {
                let farther = distance + self.lengths[e as usize];
                if farther <= farthest {
                    let next = self.across(e, v);
                    open.push(Reverse((farther.to_bits(), next, Some(e))));
                }
            }
        }
        paths
    }

    /// A vertex and its neighbours.
    fn around(&self, v: u32) -> impl Iterator<Item = u32> {
        let [first, last] = [0, 1].map(|k| self.starts[v as usize + k] as usize);
        let edges = self.edges[first..last].iter();
        edges.map(move |e| self.across(*e, v)).chain([v])
    }

    /// The other end of an edge.
    fn across(&self, edge: u32, v: u32) -> u32 {
        let [a, b] = self.topology.edges[edge as usize];
        if a == v { b } else { a }
    }

    /// The edges between reached vertices that are in neither tree, each with the length of the way from
    /// a root along it and back.
    fn closing(&self, paths: &Paths) -> Vec<(f64, u32)> {
        let mut is_tree = vec![false; self.lengths.len()];
        for e in paths.reached.values().filter_map(|(_, by)| *by) {
            is_tree[e as usize] = true;
        }
        let mut sets = UnionFind::new(self.topology.triangle_count());
        let mut between = Vec::new();
        for (e, ends) in self.topology.edges.iter().enumerate() {
            let reached = ends.map(|v| paths.reached.get(&v));
            match reached {
                _ if is_tree[e] => {}
                [Some((a, _)), Some((b, _))] => {
                    between.push((a + b + self.lengths[e], e as u32));
                }
                // No loop leads along it.
                _ => _ = self.join(&mut sets, e as u32),
            }
        }
        // The longest first, so that those which are left are the shortest.
        between.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        between.retain(|(_, e)| !self.join(&mut sets, *e));
        between
    }

    /// The shortest loop from the root of paths that does not divide the surface, if it is short enough.
    fn through(&self, paths: &Paths, longest: f64) -> Option<(f64, Vec<u32>)> {
        let closing = self.closing(paths);
        let (_, edge) = closing.last()?;
        // The two ways to the root, without what they have in common.
        let way = |mut v: u32| {
            let mut way = vec![v];
            while let Some((_, Some(e))) = paths.reached.get(&v) {
                v = self.across(*e, v);
                way.push(v);
            }
            way
        };
        let [mut one, mut other] = self.topology.edges[*edge as usize].map(way);
        while one.len() > 1 && other.len() > 1 && one[one.len() - 2] == other[other.len() - 2] {
            one.pop();
            other.pop();
        }
        one.pop();
        one.extend(other.into_iter().rev());
        let length: f64 = self
            .along(&one)
            .iter()
            .map(|e| self.lengths[*e as usize])
            .sum();
        (one.len() >= 3 && length <= longest).then_some((length, one))
    }
}

#[cfg(test)]
mod tests;
