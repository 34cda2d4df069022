//! The generalised winding number: the sign of distances to surfaces that are not closed and
//! oriented.

use nalgebra::Point3;

use crate::mesh::TriangleMesh;
use crate::mesh::measures::Aabb;

/// Triangles at a leaf of the tree.
const LEAF: usize = 8;

/// A tree over triangles \[jacobson2013\]. Seen from outside the box of a node, its triangles have
/// the same winding number as any other surface with the same boundary. A fan over the boundary
/// edges therefore replaces the node: exact, and short for a large patch.
#[derive(Clone, Debug)]
pub struct WindingTree {
    corners: Vec<[Point3<f64>; 3]>,
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    bounds: Aabb,
    /// Fan of triangles over the boundary of this node's triangles.
    cap: Vec<[Point3<f64>; 3]>,
    /// Range of triangles.
    range: (u32, u32),
    /// Index of the first of two children; 0 for a leaf.
    children: u32,
}

/// Signed solid angle of a triangle seen from `p`, divided by 4 pi \[vanoosterom1983\].
fn winding_of(p: &Point3<f64>, t: &[Point3<f64>; 3]) -> f64 {
    let [a, b, c] = t.map(|v| v - p);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let volume = a.dot(&b.cross(&c));
    let cosine = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    libm::atan2(volume, cosine) / std::f64::consts::TAU
}

impl WindingTree {
    /// Builds the tree over any set of triangles.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let mut order: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let centre = |t: u32| {
            let [a, b, c] = mesh.corners(t as usize);
            (a.coords + b.coords + c.coords) / 3.0
        };
        let mut nodes = vec![Node {
            bounds: Aabb::of_points([]),
            cap: Vec::new(),
            range: (0, order.len() as u32),
            children: 0,
        }];
        let mut next = 0;
        while next < nodes.len() {
            let (begin, end) = nodes[next].range;
            let part = &mut order[begin as usize..end as usize];
            let points = || part.iter().flat_map(|&t| mesh.triangles[t as usize]);
            nodes[next].bounds = Aabb::of_points(points().map(|v| &mesh.vertices[v as usize]));
            nodes[next].cap = cap(mesh, part);
            if part.len() > LEAF {
                let extents = nodes[next].bounds.extents();
                let axis = extents.imax();
                part.sort_by(|&s, &t| centre(s)[axis].total_cmp(&centre(t)[axis]).then(s.cmp(&t)));
                let middle = begin + (end - begin) / 2;
                nodes[next].children = nodes.len() as u32;
                for range in [(begin, middle), (middle, end)] {
                    nodes.push(Node {
                        bounds: Aabb::of_points([]),
                        cap: Vec::new(),
                        range,
                        children: 0,
                    });
                }
            }
            next += 1;
        }
        Self {
            corners: order.iter().map(|&t| mesh.corners(t as usize)).collect(),
            nodes,
        }
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        let caps: usize = self.nodes.iter().map(|n| n.cap.capacity()).sum();
        (self.corners.capacity() + caps) * 72 + self.nodes.capacity() * std::mem::size_of::<Node>()
    }

    /// Winding number of the surface about `p`: 1 inside a closed outward surface, 0 outside,
    /// intermediate near openings.
    pub fn number(&self, p: &Point3<f64>) -> f64 {
        let mut sum = 0.0;
        let mut stack = vec![0u32];
        while let Some(n) = stack.pop() {
            let node = &self.nodes[n as usize];
            let (begin, end) = (node.range.0 as usize, node.range.1 as usize);
            if node.cap.len() < end - begin && !node.bounds.contains(p) {
                sum += node.cap.iter().map(|t| winding_of(p, t)).sum::<f64>();
            } else if node.children == 0 {
                sum += self.corners[begin..end]
                    .iter()
                    .map(|t| winding_of(p, t))
                    .sum::<f64>();
            } else {
                stack.extend([node.children, node.children + 1]);
            }
        }
        sum
    }
}

/// Fan from the first boundary vertex over the boundary edges of a set of triangles.
fn cap(mesh: &TriangleMesh, part: &[u32]) -> Vec<[Point3<f64>; 3]> {
    // Each side with its lower end first, and its direction.
    let mut sides: Vec<(u32, u32, i32)> = Vec::with_capacity(3 * part.len());
    for &t in part {
        let [a, b, c] = mesh.triangles[t as usize];
        sides.extend(
            [(a, b), (b, c), (c, a)].map(|(u, v)| if u < v { (u, v, 1) } else { (v, u, -1) }),
        );
    }
    sides.sort_unstable();
    let mut fan = Vec::new();
    let mut apex = None;
    for same in sides.chunk_by(|s, t| (s.0, s.1) == (t.0, t.1)) {
        let (u, v, times) = (same[0].0, same[0].1, same.iter().map(|s| s.2).sum::<i32>());
        let (from, to) = if times > 0 { (u, v) } else { (v, u) };
        for _ in 0..times.abs() {
            let at = *apex.get_or_insert(from);
            if at != from && at != to {
                fan.push([at, from, to].map(|i| mesh.vertices[i as usize]));
            }
        }
    }
    fan
}

/// Winding number by the direct sum, for comparison.
pub fn winding_number_direct(mesh: &TriangleMesh, p: &Point3<f64>) -> f64 {
    (0..mesh.triangles.len())
        .map(|t| winding_of(p, &mesh.corners(t)))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;
    use crate::testing::Draw;
    use nalgebra::Vector3;

    #[test]
    fn the_tree_sums_what_the_plain_sum_does() {
        let mut mesh = icosphere(1.0, 3);
        // A hole and a flipped patch: pseudo-normals fail here.
        mesh.triangles.drain(100..140);
        mesh.triangles[0..20].iter_mut().for_each(|t| t.swap(0, 1));
        let tree = WindingTree::new(&mesh);
        let mut draw = Draw::new(5);
        for _ in 0..500 {
            let p = Point3::from(draw.direction() * draw.between(0.0, 2.0));
            let (fast, plain) = (tree.number(&p), winding_number_direct(&mesh, &p));
            assert!(
                (fast - plain).abs() <= 1e-11,
                "{fast} against {plain} at {p}"
            );
        }
    }

    #[test]
    fn a_sphere_winds_once_inside_and_not_outside() {
        let tree = WindingTree::new(&icosphere(1.0, 2));
        let p = |r: f64| Point3::from(Vector3::new(0.3, -0.5, 0.8).normalize() * r);
        assert!((tree.number(&p(0.9)) - 1.0).abs() <= 1e-12);
        assert!(tree.number(&p(1.1)).abs() <= 1e-12);
    }
}
