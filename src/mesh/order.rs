//! Reverse Cuthill-McKee order of vertices: neighbours are near each other in memory.

use super::TriangleMesh;
use super::topology::Topology;

/// Reverse Cuthill-McKee order: entry `k` is the vertex at the new place `k`, shape
/// `[vertex_count]`.
///
/// Components follow each other. Each starts from a peripheral vertex. The index breaks ties, so
/// the order is deterministic.
pub fn permutation(topology: &Topology) -> Vec<u32> {
    let (starts, neighbours) = topology.vertex_neighbours();
    let graph = Graph { starts, neighbours };
    let count = topology.vertex_count();
    let mut order = Vec::with_capacity(count);
    let mut placed = vec![false; count];
    let mut levels = vec![u32::MAX; count];
    for seed in 0..count as u32 {
        if !placed[seed as usize] {
            let start = graph.far_vertex(seed, &mut levels);
            graph.place(start, &mut placed, &mut order);
        }
    }
    order.reverse();
    order
}

/// The mesh with its vertices in the order of `permutation` and its triangles sorted by their
/// lowest vertex.
///
/// Each triangle keeps the cyclic order of its corners and its first corner. `permutation` must
/// contain each vertex once, as [`permutation`] returns it.
#[must_use]
pub fn apply(mesh: &TriangleMesh, permutation: &[u32]) -> TriangleMesh {
    let places = inverse(permutation);
    let vertices = permutation
        .iter()
        .map(|&v| mesh.vertices[v as usize])
        .collect();
    let mut triangles: Vec<[u32; 3]> = mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| places[v as usize]))
        .collect();
    triangles.sort_by_key(|t| {
        let mut sorted = *t;
        sorted.sort_unstable();
        sorted
    });
    TriangleMesh {
        vertices,
        triangles,
    }
}

/// The inverse permutation: entry `v` is the new place of vertex `v`.
pub fn inverse(permutation: &[u32]) -> Vec<u32> {
    let mut places = vec![0; permutation.len()];
    for (place, &v) in permutation.iter().enumerate() {
        places[v as usize] = place as u32;
    }
    places
}

/// Largest index difference of the two ends of an edge; zero without edges.
pub fn bandwidth(topology: &Topology) -> u32 {
    topology
        .edges
        .iter()
        .map(|&[a, b]| b - a)
        .max()
        .unwrap_or(0)
}

struct Graph {
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Graph {
    fn ring(&self, v: u32) -> &[u32] {
        &self.neighbours[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize]
    }

    fn degree(&self, v: u32) -> usize {
        self.ring(v).len()
    }

    /// A pseudo-peripheral vertex: repeats the search from the farthest vertex until the distance
    /// does not increase.
    fn far_vertex(&self, seed: u32, levels: &mut [u32]) -> u32 {
        let mut start = seed;
        let mut depth = 0;
        loop {
            let reached = self.search(start, levels);
            let deepest = reached.last().map_or(0, |&v| levels[v as usize]);
            let last_level = reached
                .iter()
                .copied()
                .filter(|&v| levels[v as usize] == deepest);
            let next = last_level
                .min_by_key(|&v| (self.degree(v), v))
                .unwrap_or(start);
            for v in reached {
                levels[v as usize] = u32::MAX;
            }
            if deepest <= depth {
                return start;
            }
            (start, depth) = (next, deepest);
        }
    }

    /// Vertices reached from `start` by increasing distance; `levels` receives their distances.
    fn search(&self, start: u32, levels: &mut [u32]) -> Vec<u32> {
        levels[start as usize] = 0;
        let mut reached = vec![start];
        let mut next = 0;
        while next < reached.len() {
            let v = reached[next];
            next += 1;
            for &w in self.ring(v) {
                if levels[w as usize] == u32::MAX {
                    levels[w as usize] = levels[v as usize] + 1;
                    reached.push(w);
                }
            }
        }
        reached
    }

    fn place(&self, start: u32, placed: &mut [bool], order: &mut Vec<u32>) {
        let mut next = order.len();
        placed[start as usize] = true;
        order.push(start);
        while next < order.len() {
            let v = order[next];
            next += 1;
            let first = order.len();
            for &w in self.ring(v) {
                if !placed[w as usize] {
                    placed[w as usize] = true;
                    order.push(w);
                }
            }
            order[first..].sort_by_key(|&w| (self.degree(w), w));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::{box_surface, icosphere};
    use proptest::prelude::*;

    fn shuffled(count: usize, seed: u64) -> Vec<u32> {
        let mut order: Vec<u32> = (0..count as u32).collect();
        order.sort_by_key(|&v| {
            (u64::from(v) ^ seed)
                .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .rotate_left(17)
                ^ seed
        });
        order
    }

    #[test]
    fn vertices_without_triangles_and_pieces_are_kept() {
        let one = icosphere(1.0, 1);
        let mut m = one.clone();
        m.vertices.push(Default::default());
        m.vertices.extend(one.vertices.iter().map(|p| p * 2.0));
        m.triangles
            .extend(one.triangles.iter().map(|t| t.map(|v| v + 43)));
        let order = permutation(&Topology::new(&m));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..85).collect::<Vec<_>>());
        // The components stay contiguous.
        assert!(order[..42].iter().all(|&v| v > 42) && order[43..].iter().all(|&v| v < 42));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn a_shuffled_mesh_comes_back_narrow(seed in any::<u64>(), thin in any::<bool>()) {
            let tidy = if thin { box_surface([2.0, 0.3, 0.2], 0.1) } else { icosphere(1.0, 3) };
            let m = apply(&tidy, &shuffled(tidy.vertices.len(), seed));
            let before = Topology::new(&m);
            let order = permutation(&before);
            let after = apply(&m, &order);
            let topology = Topology::new(&after);
            // A breadth-first level contains at most about a ring around the body.
            let ring = if thin { 30 } else { 120 };
            prop_assert!(bandwidth(&topology) < ring, "{} of {}", bandwidth(&topology), bandwidth(&before));
            prop_assert!(bandwidth(&before) > 2 * ring);
            prop_assert!(topology.is_closed() && topology.is_oriented());
            // The same surface: each triangle has the corners of an original one.
            let places = inverse(&order);
            for t in &m.triangles {
                prop_assert!(after.triangles.contains(&t.map(|v| places[v as usize])));
            }
            prop_assert_eq!(after.triangles.len(), m.triangles.len());
            prop_assert!((after.volume() - m.volume()).abs() < 1e-13);
            for (place, &v) in order.iter().enumerate() {
                prop_assert_eq!(after.vertices[place], m.vertices[v as usize]);
            }
        }
    }
}
