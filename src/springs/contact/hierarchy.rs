//! A bounding volume hierarchy over the triangles of a moving surface: built once, then refitted.

use nalgebra::{Point3, Vector3};

use crate::mesh::measures::{Aabb, triangle_areas};
use crate::mesh::topology::NONE;

/// Each side of a split gets at least one in this number of triangles. If areas differ by orders of
/// magnitude, half of the area can be one triangle, and the tree would be as deep as it has
/// triangles.
const LEAST_SHARE: usize = 8;

/// Content of a node of a [`Hierarchy`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoundKind {
    /// One triangle.
    Leaf(u32),
    /// Two nodes, both after this one.
    Inner([u32; 2]),
}

/// The first child of an inner node is the next node.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    /// The second child; [`NONE`] for a leaf.
    second: u32,
    /// The triangle of a leaf.
    triangle: u32,
}

/// A bounding volume hierarchy with one triangle per leaf: `n` triangles have `2 n - 1` nodes.
///
/// The construction is top-down. Triangles are sorted by their centroids along the longest side of
/// the centroids' box, and split where both sides have equal area, but with at least an eighth of
/// the triangles on each side. This is an area-median split, not the surface area heuristic (errata
/// B08). Later only boxes change ([`Self::refit`]); the tree depends only on the surface of its
/// construction.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    nodes: Vec<Node>,
}

impl Hierarchy {
    /// Builds the tree over triangles with valid indices, vertices [m].
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

    /// Updates the boxes to other positions of the same triangles [m]. A triangle without finite
    /// positions intersects nothing.
    pub fn refit(&mut self, vertices: &[Point3<f64>], triangles: &[[u32; 3]]) {
        self.refit_by(|t| {
            let [a, b, c] = triangles[t as usize].map(|v| vertices[v as usize]);
            Aabb {
                min: a.inf(&b).inf(&c),
                max: a.sup(&b).sup(&c),
            }
        });
    }

    /// Sets any box for each triangle [m], such as that of its path; children come before their
    /// parents.
    pub fn refit_by(&mut self, mut bounds: impl FnMut(u32) -> Aabb) {
        for i in (0..self.nodes.len()).rev() {
            let Node {
                second, triangle, ..
            } = self.nodes[i];
            self.nodes[i].bounds = if second == NONE {
                let bounds = bounds(triangle);
                // A NaN box would hide the other children from the boxes above.
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

    /// True for no triangles.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Bounds of all triangles [m]; empty for none.
    pub fn bounds(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, |n| n.bounds)
    }

    /// Box [m] and content of a node.
    pub fn node(&self, node: u32) -> (&Aabb, BoundKind) {
        let n = &self.nodes[node as usize];
        (
            &n.bounds,
            if n.second == NONE {
                BoundKind::Leaf(n.triangle)
            } else {
                BoundKind::Inner([node + 1, n.second])
            },
        )
    }

    /// Number of nodes on each level, from the root.
    pub fn levels(&self) -> Vec<usize> {
        let mut level = vec![0usize; self.nodes.len()];
        let mut counts = Vec::new();
        for node in 0..self.nodes.len() {
            let own = level[node];
            if counts.len() <= own {
                counts.push(0);
            }
            counts[own] += 1;
            if let (_, BoundKind::Inner(children)) = self.node(node as u32) {
                children.iter().for_each(|&c| level[c as usize] = own + 1);
            }
        }
        counts
    }

    /// Visits every pair of triangles of this and another surface whose boxes intersect, each once,
    /// in an order that depends on the two trees and their boxes alone.
    ///
    /// Boxes are tested first. A leaf against an inner node descends only into the inner node
    /// (errata B08); of two inner nodes the larger is opened.
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

    /// Visits the triangles whose boxes intersect a box [m].
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

/// Sum of the sides of a box [m], the measure for the larger of two boxes.
fn size(b: &Aabb) -> f64 {
    (b.max.x - b.min.x) + (b.max.y - b.min.y) + (b.max.z - b.min.z)
}

/// A tree under construction.
struct Build {
    /// Three times the centroid of each triangle [m].
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

    /// Appends the nodes of at least one triangle. The recursion is as deep as the tree, whose
    /// depth the least share bounds.
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

    /// Sorts at least two triangles along an axis. Returns the number on the first side.
    fn split(&self, part: &mut [u32]) -> usize {
        let middle = |t: u32| &self.middles[t as usize];
        let (mut low, mut high) = (*middle(part[0]), *middle(part[0]));
        for &t in part.iter() {
            (low, high) = (low.inf(middle(t)), high.sup(middle(t)));
        }
        let axis = (high - low).imax();
        // The index breaks ties, so that the tree is deterministic.
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
