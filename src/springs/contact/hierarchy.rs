//! Boxes about the triangles of a surface that moves: a tree that is built once and follows.

use nalgebra::{Point3, Vector3};

use crate::mesh::measures::{Aabb, triangle_areas};
use crate::mesh::topology::NONE;

/// Each side of a split gets at least one of so many triangles: where areas differ by powers, the half of an area may be one
/// triangle, and the tree would be as deep as it has triangles.
const LEAST_SHARE: usize = 8;

/// What a node of a [`Hierarchy`] holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One triangle.
    Leaf(u32),
    /// Two nodes, both after this one.
    Inner([u32; 2]),
}

/// The first child of an inner node is the node after it.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    /// The second child; [`NONE`] for a leaf.
    second: u32,
    /// The triangle of a leaf.
    triangle: u32,
}

/// A bounding volume hierarchy with one triangle a leaf, so that `n` triangles have `2 n - 1` nodes.
///
/// Built from above: triangles are sorted along the longest side of the box of their middles and split where both sides have
/// the same area, but for an eighth of the triangles at least on each side. That is an area-median split, not the surface
/// area heuristic (errata B08). Afterwards only boxes change ([`Self::refit`]); the tree depends on the surface it was built
/// of alone.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    nodes: Vec<Node>,
}

impl Hierarchy {
    /// The tree over triangles with valid indices, vertices [m].
    pub fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let middle = |t: &[u32; 3]| {
            t.iter()
                .map(|&v| vertices[v as usize].coords)
                .sum::<Vector3<f64>>()
        };
        let build = Build {
            middles: triangles.iter().map(middle).collect(),
            areas: triangle_areas(vertices, triangles),
            nodes: Vec::with_capacity((2 * triangles.len()).saturating_sub(1)),
        };
        let mut this = Self { nodes: build.all() };
        this.refit(vertices, triangles);
        this
    }

    /// Follows the triangles it was built of to other positions [m]. A triangle that is nowhere meets nothing.
    pub fn refit(&mut self, vertices: &[Point3<f64>], triangles: &[[u32; 3]]) {
        self.refit_by(|t| {
            let [a, b, c] = triangles[t as usize].map(|v| vertices[v as usize]);
            Aabb {
                min: a.inf(&b).inf(&c),
                max: a.sup(&b).sup(&c),
            }
        });
    }

    /// Takes any box for each triangle [m], such as that of the way it goes; children come before their parents.
    pub fn refit_by(&mut self, mut bounds: impl FnMut(u32) -> Aabb) {
        for i in (0..self.nodes.len()).rev() {
            let Node {
                second, triangle, ..
            } = self.nodes[i];
            self.nodes[i].bounds = if second == NONE {
                let bounds = bounds(triangle);
                // One box that is no number would make those above it forget their other children.
                if bounds.min <= bounds.max {
                    bounds
                } else {
                    Aabb::EMPTY
                }
            } else {
                self.nodes[i + 1]
                    .bounds
                    .union(&self.nodes[second as usize].bounds)
            };
        }
    }

    /// Number of nodes; node 0 is the root.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The box about all [m]; empty for none.
    pub fn bounds(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, |n| n.bounds)
    }

    /// Box [m] and content of a node.
    pub fn node(&self, node: u32) -> (&Aabb, Kind) {
        let n = &self.nodes[node as usize];
        (
            &n.bounds,
            if n.second == NONE {
                Kind::Leaf(n.triangle)
            } else {
                Kind::Inner([node + 1, n.second])
            },
        )
    }

    /// Number of nodes on each level, the root's first.
    pub fn levels(&self) -> Vec<usize> {
        let mut level = vec![0usize; self.nodes.len()];
        let mut counts = Vec::new();
        for node in 0..self.nodes.len() {
            let own = level[node];
            if counts.len() <= own {
                counts.push(0);
            }
            counts[own] += 1;
            if let (_, Kind::Inner(children)) = self.node(node as u32) {
                children.iter().for_each(|&c| level[c as usize] = own + 1);
            }
        }
        counts
    }

    /// Visits every pair of triangles, of this and of another surface, whose boxes share a point; each once, in an order that
    /// depends on the two trees and their boxes alone.
    ///
    /// Boxes first; then a leaf against a node takes only the node apart (errata B08), and of two nodes the larger is.
    pub fn pairs(&self, other: &Self, mut visit: impl FnMut(u32, u32)) {
        if self.is_empty() || other.is_empty() {
            return;
        }
        let mut open = vec![(0u32, 0u32)];
        while let Some((a, b)) = open.pop() {
            let (n, m) = (&self.nodes[a as usize], &other.nodes[b as usize]);
            if !n.bounds.intersects(&m.bounds) {
                continue;
            }
            match (n.second, m.second) {
                (NONE, NONE) => visit(n.triangle, m.triangle),
                (NONE, second) => open.extend([(a, second), (a, b + 1)]),
                (second, NONE) => open.extend([(second, b), (a + 1, b)]),
                (second, _) if size(&n.bounds) >= size(&m.bounds) => {
                    open.extend([(second, b), (a + 1, b)])
                }
                (_, second) => open.extend([(a, second), (a, b + 1)]),
            }
        }
    }

    /// Visits the triangles whose boxes share a point with a box [m].
    pub fn meeting(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        let mut open = if self.is_empty() {
            Vec::new()
        } else {
            vec![0u32]
        };
        while let Some(i) = open.pop() {
            let n = &self.nodes[i as usize];
            if n.bounds.intersects(bounds) {
                if n.second == NONE {
                    visit(n.triangle)
                } else {
                    open.extend([n.second, i + 1])
                }
            }
        }
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>()
    }
}

/// Sum of the sides of a box [m]: which of two boxes is the larger.
fn size(b: &Aabb) -> f64 {
    (b.max.x - b.min.x) + (b.max.y - b.min.y) + (b.max.z - b.min.z)
}

/// A tree under construction.
struct Build {
    /// Thrice the middle of each triangle [m].
    middles: Vec<Vector3<f64>>,
    areas: Vec<f64>,
    nodes: Vec<Node>,
}

impl Build {
    fn all(mut self) -> Vec<Node> {
        let mut order: Vec<u32> = (0..self.areas.len() as u32).collect();
        if !order.is_empty() {
            self.part(&mut order);
        }
        self.nodes
    }

    /// Appends the nodes of some triangles, at least one. As deep as the tree, of which the shares are a bound.
    fn part(&mut self, part: &mut [u32]) {
        let node = self.nodes.len();
        self.nodes.push(Node {
            bounds: Aabb::EMPTY,
            second: NONE,
            triangle: part[0],
        });
        if part.len() > 1 {
            let at = self.split(part);
            let (first, second) = part.split_at_mut(at);
            self.part(first);
            self.nodes[node].second = self.nodes.len() as u32;
            self.part(second);
        }
    }

    /// Sorts some triangles, at least two, along an axis; returns how many are on the first side.
    fn split(&self, part: &mut [u32]) -> usize {
        let middle = |t: u32| &self.middles[t as usize];
        let (mut low, mut high) = (*middle(part[0]), *middle(part[0]));
        for &t in part.iter() {
            (low, high) = (low.inf(middle(t)), high.sup(middle(t)));
        }
        let axis = (high - low).imax();
        // The index breaks ties, so that the tree is determined.
        part.sort_unstable_by(|&i, &j| middle(i)[axis].total_cmp(&middle(j)[axis]).then(i.cmp(&j)));
        let half = 0.5 * part.iter().map(|&t| self.areas[t as usize]).sum::<f64>();
        let (least, count) = (part.len().div_ceil(LEAST_SHARE), part.len());
        if !(half > 0.0 && half.is_finite()) {
            return count / 2;
        }
        let (mut sum, mut best) = (0.0, (f64::INFINITY, count / 2));
        for (k, &t) in part.iter().enumerate() {
            sum += self.areas[t as usize];
            let off = (sum - half).abs();
            if off < best.0 {
                best = (off, k + 1);
            }
        }
        best.1.clamp(least, count - least)
    }
}
