//! Connectivity of triangle meshes: edges, hinges, rings, components; tests for closed, oriented
//! and manifold.

use super::TriangleMesh;
use super::union_find::UnionFind;

/// Marks the absence of a triangle, edge or component in the arrays of [`Topology`].
pub const NONE: u32 = u32::MAX;

/// The combinatorial structure of a triangle mesh, without positions.
///
/// Edges are sorted by their two vertices, hinges by their edge, rings by triangle; the order
/// depends on the triangles alone. Vertices without triangles are not part of components or of the
/// Euler characteristic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Topology {
    /// Vertices of each edge, lower index first, in lexicographic order.
    pub edges: Vec<[u32; 2]>,
    /// `(p1, p2, p3, p4)` of each edge with exactly two triangles: `p1, p2` shared, `p3, p4` the wing tips.
    ///
    /// Triangle 1 is `(p1, p2, p3)` up to rotation; triangle 2 is `(p2, p1, p4)` if both have the
    /// same orientation.
    pub hinges: Vec<[u32; 4]>,
    /// The edge of each hinge, ascending.
    pub hinge_edges: Vec<u32>,
    /// The edges of each triangle; side `k` runs from corner `k` to corner `k + 1`.
    pub triangle_edges: Vec<[u32; 3]>,
    vertex_count: usize,
    used_vertices: usize,
    edge_starts: Vec<u32>,
    edge_triangles: Vec<u32>,
    ring_starts: Vec<u32>,
    ring_triangles: Vec<u32>,
    neighbours: Vec<[u32; 3]>,
    /// Number of triangles per edge that traverse it from the lower to the higher vertex.
    forward: Vec<u32>,
}

/// Connected components of a mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Components {
    /// Label of each vertex, 0 for the component of the lowest vertex; [`NONE`] for a vertex
    /// without triangles.
    pub labels: Vec<u32>,
    /// Number of components.
    pub count: usize,
}

/// One side of one triangle.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    edge: [u32; 2],
    triangle: u32,
    side: u8,
}

impl Topology {
    /// Builds the structure of a mesh with valid indices, see [`TriangleMesh::new`].
    pub fn new(mesh: &TriangleMesh) -> Self {
        Self::of_triangles(mesh.vertices.len(), &mesh.triangles)
    }

    /// Builds the structure of triangles over `vertex_count` vertices.
    pub fn of_triangles(vertex_count: usize, triangles: &[[u32; 3]]) -> Self {
        let mut topology = Self {
            vertex_count,
            ..Self::default()
        };
        topology.collect_edges(triangles);
        topology.collect_neighbours_and_hinges(triangles);
        topology.collect_rings(triangles);
        topology
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        let numbers = [
            &self.hinge_edges,
            &self.edge_starts,
            &self.edge_triangles,
            &self.ring_starts,
            &self.ring_triangles,
            &self.forward,
        ];
        self.edges.capacity() * 8
            + self.hinges.capacity() * 16
            + (self.triangle_edges.capacity() + self.neighbours.capacity()) * 12
            + numbers.iter().map(|n| n.capacity() * 4).sum::<usize>()
    }

    fn collect_edges(&mut self, triangles: &[[u32; 3]]) {
        let mut sides: Vec<Side> = Vec::with_capacity(3 * triangles.len());
        for (t, corners) in triangles.iter().enumerate() {
            for side in 0..3 {
                let (a, b) = (corners[side], corners[(side + 1) % 3]);
                sides.push(Side {
                    edge: [a.min(b), a.max(b)],
                    triangle: t as u32,
                    side: side as u8,
                });
            }
        }
        sides.sort_unstable();
        self.triangle_edges = vec![[NONE; 3]; triangles.len()];
        self.edge_triangles = sides.iter().map(|s| s.triangle).collect();
        for (k, s) in sides.iter().enumerate() {
            if self.edges.last() != Some(&s.edge) {
                self.edges.push(s.edge);
                self.edge_starts.push(k as u32);
                self.forward.push(0);
            }
            let e = self.edges.len() - 1;
            let side = s.side as usize;
            self.triangle_edges[s.triangle as usize][side] = e as u32;
            self.forward[e] += u32::from(triangles[s.triangle as usize][side] == s.edge[0]);
        }
        self.edge_starts.push(sides.len() as u32);
    }

    fn collect_neighbours_and_hinges(&mut self, triangles: &[[u32; 3]]) {
        self.neighbours = vec![[NONE; 3]; triangles.len()];
        let side_of = |t: u32, e: u32, of: &Self| {
            // An edge's triangle has the edge among its sides by construction.
            of.triangle_edges[t as usize]
                .iter()
                .position(|&f| f == e)
                .unwrap_or(0)
        };
        for e in 0..self.edges.len() {
            let (first, second) = match *self.triangles_of_edge(e) {
                [first, second] => (first, second),
                _ => continue,
            };
            let (i, j) = (
                side_of(first, e as u32, self),
                side_of(second, e as u32, self),
            );
            self.neighbours[first as usize][i] = second;
            self.neighbours[second as usize][j] = first;
            // Triangle 1 traverses the edge upwards; if both or neither do, it is the first in
            // order.
            let first_runs_up = triangles[first as usize][i] == self.edges[e][0];
            let second_runs_up = triangles[second as usize][j] == self.edges[e][0];
            let swap = second_runs_up && !first_runs_up;
            let ((t1, k1), (t2, k2)) = if swap {
                ((second, j), (first, i))
            } else {
                ((first, i), (second, j))
            };
            let (one, two) = (triangles[t1 as usize], triangles[t2 as usize]);
            self.hinges.push([
                one[k1],
                one[(k1 + 1) % 3],
                one[(k1 + 2) % 3],
                two[(k2 + 2) % 3],
            ]);
            self.hinge_edges.push(e as u32);
        }
    }

    fn collect_rings(&mut self, triangles: &[[u32; 3]]) {
        let mut starts = vec![0u32; self.vertex_count + 1];
        for &v in triangles.iter().flatten() {
            starts[v as usize + 1] += 1;
        }
        self.used_vertices = starts.iter().filter(|&&n| n > 0).count();
        for v in 0..self.vertex_count {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        self.ring_triangles = vec![0; 3 * triangles.len()];
        for (t, corners) in triangles.iter().enumerate() {
            for &v in corners {
                self.ring_triangles[next[v as usize] as usize] = t as u32;
                next[v as usize] += 1;
            }
        }
        self.ring_starts = starts;
    }

    /// Number of vertices, including those without triangles.
    pub fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangle_edges.len()
    }

    /// Triangles at an edge, ascending.
    pub fn triangles_of_edge(&self, edge: usize) -> &[u32] {
        &self.edge_triangles[self.edge_starts[edge] as usize..self.edge_starts[edge + 1] as usize]
    }

    /// Triangles at a vertex, ascending.
    pub fn triangles_of_vertex(&self, vertex: usize) -> &[u32] {
        &self.ring_triangles
            [self.ring_starts[vertex] as usize..self.ring_starts[vertex + 1] as usize]
    }

    /// The triangle across each side of a triangle; `None` at a boundary or an edge with more than two triangles.
    pub fn neighbours_of_triangle(&self, triangle: usize) -> [Option<u32>; 3] {
        self.neighbours[triangle].map(|t| (t != NONE).then_some(t))
    }

    /// The edge between two vertices, if there is one.
    pub fn find_edge(&self, a: u32, b: u32) -> Option<u32> {
        self.edges
            .binary_search(&[a.min(b), a.max(b)])
            .ok()
            .map(|e| e as u32)
    }

    /// Length of each edge [m], shape `[edge_count]`.
    ///
    /// The mesh must have the triangles of this structure; its vertices can be at other positions.
    pub fn edge_lengths(&self, mesh: &TriangleMesh) -> Vec<f64> {
        let length =
            |&[a, b]: &[u32; 2]| (mesh.vertices[b as usize] - mesh.vertices[a as usize]).norm();
        self.edges.iter().map(length).collect()
    }

    /// Edges with one triangle, ascending.
    pub fn boundary_edges(&self) -> Vec<u32> {
        (0..self.edges.len())
            .filter(|&e| self.triangles_of_edge(e).len() == 1)
            .map(|e| e as u32)
            .collect()
    }

    /// Edges with more than two triangles, ascending.
    pub fn non_manifold_edges(&self) -> Vec<u32> {
        (0..self.edges.len())
            .filter(|&e| self.triangles_of_edge(e).len() > 2)
            .map(|e| e as u32)
            .collect()
    }

    /// Edges with two triangles that traverse them in the same direction, ascending.
    pub fn inconsistent_edges(&self) -> Vec<u32> {
        let disagree = |&e: &usize| self.triangles_of_edge(e).len() == 2 && self.forward[e] != 1;
        (0..self.edges.len())
            .filter(disagree)
            .map(|e| e as u32)
            .collect()
    }

    /// Vertices whose triangles form more than one fan, ascending: surfaces touch in these points.
    pub fn non_manifold_vertices(&self, mesh: &TriangleMesh) -> Vec<u32> {
        (0..self.vertex_count)
            .filter(|&v| self.fan_count(mesh, v) > 1)
            .map(|v| v as u32)
            .collect()
    }

    fn fan_count(&self, mesh: &TriangleMesh, vertex: usize) -> usize {
        let ring = self.triangles_of_vertex(vertex);
        // Each triangle has two sides at the vertex; triangles with a common side belong to one
        // fan.
        let mut sides: Vec<(u32, u32)> = Vec::with_capacity(2 * ring.len());
        for (k, &t) in ring.iter().enumerate() {
            for side in 0..3 {
                let corners = mesh.triangles[t as usize];
                if [corners[side], corners[(side + 1) % 3]].contains(&(vertex as u32)) {
                    sides.push((self.triangle_edges[t as usize][side], k as u32));
                }
            }
        }
        sides.sort_unstable();
        let mut sets = UnionFind::new(ring.len());
        let mut fans = ring.len();
        for pair in sides.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            fans -= usize::from(sets.join(pair[0].1, pair[1].1));
        }
        fans
    }

    /// True if the mesh has triangles and each edge has exactly two.
    pub fn is_closed(&self) -> bool {
        !self.edges.is_empty()
            && (0..self.edges.len()).all(|e| self.triangles_of_edge(e).len() == 2)
    }

    /// True if the mesh has triangles and each edge is traversed as often in one direction as in the
    /// other, so that the winding number about each point off the surface is a whole number.
    pub fn is_cycle(&self) -> bool {
        !self.edges.is_empty()
            && (0..self.edges.len())
                .all(|e| self.triangles_of_edge(e).len() == 2 * self.forward[e] as usize)
    }

    /// True if each edge with two triangles is traversed once in each direction, and no edge has
    /// more than two.
    pub fn is_oriented(&self) -> bool {
        (0..self.edges.len()).all(|e| match self.triangles_of_edge(e).len() {
            1 => true,
            2 => self.forward[e] == 1,
            _ => false,
        })
    }

    /// Euler characteristic V - E + F; 2 for each sphere, 0 for each torus, 1 for each disc.
    pub fn euler_characteristic(&self) -> i64 {
        self.used_vertices as i64 - self.edges.len() as i64 + self.triangle_count() as i64
    }

    /// The connected components, numbered by their lowest vertex.
    pub fn components(&self) -> Components {
        let mut sets = UnionFind::new(self.vertex_count);
        for &[a, b] in &self.edges {
            sets.join(a, b);
        }
        let mut labels = vec![NONE; self.vertex_count];
        let mut count = 0;
        for v in 0..self.vertex_count as u32 {
            if self.triangles_of_vertex(v as usize).is_empty() {
                continue;
            }
            let top = sets.root(v);
            if top == v {
                labels[v as usize] = count as u32;
                count += 1;
            } else {
                labels[v as usize] = labels[top as usize];
            }
        }
        Components { labels, count }
    }

    /// Neighbours of each vertex along edges, ascending: offsets (`vertex_count + 1`) and
    /// neighbours.
    pub fn vertex_neighbours(&self) -> (Vec<u32>, Vec<u32>) {
        let mut starts = vec![0u32; self.vertex_count + 1];
        for &v in self.edges.iter().flatten() {
            starts[v as usize + 1] += 1;
        }
        for v in 0..self.vertex_count {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut neighbours = vec![0; 2 * self.edges.len()];
        // Lexicographic edges give each vertex first its lower, then its higher neighbours, both in
        // ascending order.
        for ends in [[1, 0], [0, 1]] {
            for edge in &self.edges {
                let (from, to) = (edge[ends[0]] as usize, edge[ends[1]]);
                neighbours[next[from] as usize] = to;
                next[from] += 1;
            }
        }
        (starts, neighbours)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use proptest::prelude::*;

    fn mesh(vertices: usize, triangles: &[[u32; 3]]) -> TriangleMesh {
        let vertices = (0..vertices)
            .map(|i| Point3::new(i as f64, (i * i) as f64, 0.5))
            .collect();
        TriangleMesh::new(vertices, triangles.to_vec()).expect("test mesh")
    }

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    /// A grid of `m` x `n` quads, periodic in both directions: a torus.
    fn torus(m: u32, n: u32) -> TriangleMesh {
        let at = |i: u32, j: u32| (i % m) * n + j % n;
        let mut triangles = Vec::new();
        for i in 0..m {
            for j in 0..n {
                triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        mesh((m * n) as usize, &triangles)
    }

    fn rotations(t: [u32; 3]) -> [[u32; 3]; 3] {
        [t, [t[1], t[2], t[0]], [t[2], t[0], t[1]]]
    }

    fn assert_hinges_run_with_triangles(mesh: &TriangleMesh, topology: &Topology) {
        let has = |t: [u32; 3]| mesh.triangles.iter().any(|&u| rotations(t).contains(&u));
        for &[p1, p2, p3, p4] in &topology.hinges {
            assert!(has([p1, p2, p3]), "triangle 1 of {p1} {p2} {p3} {p4}");
            assert!(has([p2, p1, p4]), "triangle 2 of {p1} {p2} {p3} {p4}");
        }
    }

    #[test]
    fn tetrahedron() {
        let m = mesh(4, &TETRAHEDRON);
        let t = Topology::new(&m);
        assert_eq!(t.edges, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
        assert_eq!(t.hinges.len(), 6);
        assert_hinges_run_with_triangles(&m, &t);
        assert_eq!(t.hinges[0], [0, 1, 3, 2]);
        assert!(t.is_closed() && t.is_oriented());
        assert_eq!(t.euler_characteristic(), 2);
        assert_eq!(t.triangles_of_edge(0), [0, 1]);
        assert_eq!(t.triangles_of_vertex(3), [1, 2, 3]);
        assert_eq!(t.neighbours_of_triangle(0), [Some(2), Some(3), Some(1)]);
        assert_eq!(t.find_edge(3, 1), Some(4));
        assert_eq!(
            t.components(),
            Components {
                labels: vec![0; 4],
                count: 1
            }
        );
        assert!(t.non_manifold_vertices(&m).is_empty());
    }

    #[test]
    fn open_strip_has_a_boundary() {
        let m = mesh(5, &[[0, 1, 2], [2, 1, 3]]);
        let t = Topology::new(&m);
        assert!(!t.is_closed() && t.is_oriented());
        assert_eq!(t.boundary_edges(), [0, 1, 3, 4]);
        assert_eq!(t.hinges, [[1, 2, 0, 3]]);
        assert_eq!(
            t.euler_characteristic(),
            1,
            "the unused vertex 4 is not counted"
        );
        assert_eq!(
            t.components(),
            Components {
                labels: vec![0, 0, 0, 0, NONE],
                count: 1
            }
        );
        assert_eq!(t.neighbours_of_triangle(0), [None, Some(1), None]);
    }

    #[test]
    fn flipped_triangle_is_not_oriented() {
        let mut triangles = TETRAHEDRON;
        triangles[2].swap(0, 1);
        let t = Topology::new(&mesh(4, &triangles));
        assert!(t.is_closed() && !t.is_oriented());
        // Both triangles of edge 0-2 traverse it in the same direction; triangle 1 is still (p1,
        // p2, p3).
        let m = mesh(4, &triangles);
        for &[p1, p2, p3, _] in &t.hinges {
            assert!(
                m.triangles
                    .iter()
                    .any(|&u| rotations([p1, p2, p3]).contains(&u))
            );
        }
    }

    #[test]
    fn fin_is_not_manifold() {
        let t = Topology::new(&mesh(5, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]));
        assert_eq!(t.non_manifold_edges(), [0]);
        assert!(!t.is_closed() && !t.is_oriented());
        assert!(t.hinges.is_empty());
    }

    #[test]
    fn two_tetrahedra_that_share_a_vertex() {
        let mut triangles = TETRAHEDRON.to_vec();
        triangles.extend(TETRAHEDRON.map(|t| t.map(|v| if v == 0 { 0 } else { v + 3 })));
        let m = mesh(7, &triangles);
        let t = Topology::new(&m);
        assert!(t.is_closed() && t.is_oriented());
        assert_eq!(t.non_manifold_vertices(&m), [0]);
        assert_eq!(t.components().count, 1);
        let apart: Vec<_> = TETRAHEDRON
            .iter()
            .copied()
            .chain(TETRAHEDRON.map(|t| t.map(|v| v + 4)))
            .collect();
        let apart = mesh(8, &apart);
        let t = Topology::new(&apart);
        assert_eq!(
            t.components(),
            Components {
                labels: vec![0, 0, 0, 0, 1, 1, 1, 1],
                count: 2
            }
        );
        assert_eq!(t.euler_characteristic(), 4);
    }

    #[test]
    fn nothing() {
        let t = Topology::new(&TriangleMesh::default());
        assert!(t.edges.is_empty() && !t.is_closed());
        assert_eq!(t.components().count, 0);
    }

    proptest! {
        #[test]
        fn torus_of_any_size(m in 3u32..9, n in 3u32..9, seed in any::<u64>()) {
            let mut mesh = torus(m, n);
            // Rotating corners and permuting triangles must not change edges.
            let reference = Topology::new(&mesh);
            let count = mesh.triangles.len();
            for k in 0..count {
                let j = (seed.wrapping_mul(2 * k as u64 + 1) >> 7) as usize % count;
                mesh.triangles.swap(k, j);
                mesh.triangles[k].rotate_left(j % 3);
            }
            let t = Topology::new(&mesh);
            prop_assert_eq!(&t.edges, &reference.edges);
            prop_assert!(t.is_closed() && t.is_oriented());
            prop_assert_eq!(t.euler_characteristic(), 0);
            prop_assert_eq!(t.hinges.len(), t.edges.len());
            prop_assert_eq!(&t.hinges, &reference.hinges);
            assert_hinges_run_with_triangles(&mesh, &t);
            for (i, ends) in t.edges.iter().enumerate() {
                prop_assert!(ends[0] < ends[1]);
                prop_assert_eq!(t.find_edge(ends[1], ends[0]), Some(i as u32));
                for &f in t.triangles_of_edge(i) {
                    prop_assert!(ends.iter().all(|v| mesh.triangles[f as usize].contains(v)));
                }
            }
            let (starts, neighbours) = t.vertex_neighbours();
            for v in 0..mesh.vertices.len() {
                let ring = &neighbours[starts[v] as usize..starts[v + 1] as usize];
                prop_assert!(ring.windows(2).all(|w| w[0] < w[1]));
                prop_assert_eq!(ring.len(), t.triangles_of_vertex(v).len());
            }
        }
    }
}
