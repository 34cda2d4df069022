//! Closest points on a fixed surface by a tree of boxes; remeshing projects onto them.

use std::cell::Cell;

use nalgebra::{Point3, Vector3};

use super::measures::Aabb;

/// Triangles in a leaf of the tree.
const LEAF: usize = 4;
/// Upper bound of the depth of a query's stack: each level halves the triangles.
const STACK: usize = 64;

/// The point of a triangle closest to `p` [m]. For a triangle without area this is a point of its
/// longest side.
#[inline]
pub fn closest_on_triangle(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> Point3<f64> {
    let (u, v, w) = (b - a, c - a, p - a);
    let normal = u.cross(&v);
    let square = normal.norm_squared();
    // Below a sine of 1e-8 rounding turns the normal by as much as the triangle is flat; its sides
    // are equally accurate.
    if square > 1e-16 * u.norm_squared() * v.norm_squared() {
        let (s, t) = (
            w.cross(&v).dot(&normal) / square,
            u.cross(&w).dot(&normal) / square,
        );
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            return a + u * s + v * t;
        }
    }
    // Outside the prism over the triangle the closest point lies on a side.
    let mut best = closest_on_segment(p, a, b);
    for (from, to) in [(b, c), (c, a)] {
        let other = closest_on_segment(p, from, to);
        if (p - other).norm_squared() < (p - best).norm_squared() {
            best = other;
        }
    }
    best
}

/// Place of the point of the segment from `a` to `b` closest to `p`, from 0 at `a` to 1 at `b`; 0
/// for a segment without length.
#[inline]
pub(crate) fn place_on_segment(p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    let along = b - a;
    let square = along.norm_squared();
    if square > 0.0 {
        ((p - a).dot(&along) / square).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

#[inline]
fn closest_on_segment(p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> Point3<f64> {
    a + (b - a) * place_on_segment(p, a, b)
}

/// Result of [`SurfaceTree::closest`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleProjection {
    /// The closest point [m].
    pub point: Point3<f64>,
    /// The triangle that contains the point; of several equally close triangles the first in tree
    /// order.
    pub triangle: u32,
    /// Distance to the point [m].
    pub distance: f64,
}

/// A tree of boxes over the triangles of a fixed surface.
#[derive(Clone, Debug)]
pub struct SurfaceTree {
    nodes: Vec<Node>,
    corners: Vec<[Point3<f64>; 3]>,
    /// Box of each triangle.
    boxes: Vec<Aabb>,
    normals: Vec<Vector3<f64>>,
    /// Index in the mesh of each triangle as stored here.
    names: Vec<u32>,
}

/// Children `link`, `link + 1` where `count` is zero, else triangles `link..link + count`.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    link: u32,
    count: u32,
}

impl Node {
    fn distance_squared(&self, p: &Point3<f64>) -> f64 {
        (p - self.bounds.min.sup(&self.bounds.max.inf(p))).norm_squared()
    }
}

/// The unit normal of a triangle; zero for one without area.
fn normal([a, b, c]: &[Point3<f64>; 3]) -> Vector3<f64> {
    let across = (b - a).cross(&(c - a));
    across.try_normalize(0.0).unwrap_or_default()
}

impl SurfaceTree {
    /// Builds the tree over triangles with valid indices.
    pub fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let of = |t: &[u32; 3]| t.map(|v| vertices[v as usize]);
        let mut names: Vec<u32> = (0..triangles.len() as u32).collect();
        let corners: Vec<[Point3<f64>; 3]> = triangles.iter().map(of).collect();
        let middles: Vec<Vector3<f64>> = corners
            .iter()
            .map(|[a, b, c]| a.coords + b.coords + c.coords)
            .collect();
        let mut nodes = vec![Node {
            bounds: Aabb::EMPTY,
            link: 0,
            count: 0,
        }];
        let mut open = vec![(0usize, 0usize, names.len())];
        while let Some((node, start, end)) = open.pop() {
            let part = &mut names[start..end];
            nodes[node].bounds = Aabb::of_points(part.iter().flat_map(|&t| &corners[t as usize]));
            if part.len() <= LEAF {
                (nodes[node].link, nodes[node].count) = (start as u32, part.len() as u32);
                continue;
            }
            let axis = nodes[node].bounds.extents().imax();
            let half = part.len() / 2;
            // The index breaks ties, so that the tree is deterministic.
            part.select_nth_unstable_by(half, |&i, &j| {
                middles[i as usize][axis]
                    .total_cmp(&middles[j as usize][axis])
                    .then(i.cmp(&j))
            });
            let child = nodes.len();
            nodes[node].link = child as u32;
            nodes.extend([nodes[node]; 2]);
            open.push((child, start, start + half));
            open.push((child + 1, start + half, end));
        }
        let corners: Vec<[Point3<f64>; 3]> = names.iter().map(|&t| corners[t as usize]).collect();
        let normals = corners.iter().map(normal).collect();
        let boxes = corners.iter().map(Aabb::of_points).collect();
        Self {
            nodes,
            corners,
            boxes,
            normals,
            names,
        }
    }

    /// Sets new positions of the same `triangles`; the tree keeps its structure and updates its
    /// boxes.
    pub fn refit(&mut self, vertices: &[Point3<f64>], triangles: &[[u32; 3]]) {
        for (k, &t) in self.names.iter().enumerate() {
            self.corners[k] = triangles[t as usize].map(|v| vertices[v as usize]);
            self.boxes[k] = Aabb::of_points(&self.corners[k]);
            self.normals[k] = normal(&self.corners[k]);
        }
        // Children have higher indices than their parent.
        for n in (0..self.nodes.len()).rev() {
            let Node { link, count, .. } = self.nodes[n];
            let (first, end) = (link as usize, (link + count) as usize);
            self.nodes[n].bounds = match self.nodes.get(first..first + 2) {
                Some([one, other]) if count == 0 => one.bounds.union(&other.bounds),
                _ => Aabb::of_points(self.corners[first..end].iter().flatten()),
            };
        }
    }

    /// The closest point of the surface within the distance `within` [m]; `None` if there is none.
    pub fn closest(&self, p: &Point3<f64>, within: f64) -> Option<TriangleProjection> {
        self.search(p, within, |_| true, false)
    }

    /// The same as [`SurfaceTree::closest`] among the triangles for which `admit` holds.
    pub fn closest_of(
        &self,
        p: &Point3<f64>,
        within: f64,
        admit: impl Fn(u32) -> bool,
    ) -> Option<TriangleProjection> {
        self.search(p, within, |t| admit(self.names[t]), false)
    }

    /// The same as [`SurfaceTree::closest`] among the triangles whose unit normal has a dot product
    /// above `cosine` with `normal`.
    ///
    /// Triangles without area have no normal; they are included if `cosine` is negative.
    pub fn closest_facing(
        &self,
        p: &Point3<f64>,
        normal: &Vector3<f64>,
        cosine: f64,
        within: f64,
    ) -> Option<TriangleProjection> {
        self.search(p, within, |t| self.normals[t].dot(normal) > cosine, false)
    }

    /// True if [`SurfaceTree::closest_facing`] would find a point; faster.
    pub fn is_near_facing(
        &self,
        p: &Point3<f64>,
        normal: &Vector3<f64>,
        cosine: f64,
        within: f64,
    ) -> bool {
        self.search(p, within, |t| self.normals[t].dot(normal) > cosine, true)
            .is_some()
    }

    /// The same as [`SurfaceTree::is_near_facing`]; faster if the triangle `likely` is near, such
    /// as the result of the previous query.
    pub fn is_near_facing_from(
        &self,
        likely: &Cell<u32>,
        p: &Point3<f64>,
        normal: &Vector3<f64>,
        cosine: f64,
        within: f64,
    ) -> bool {
        let faces = |t: usize| self.normals[t].dot(normal) > cosine;
        let t = likely.get() as usize;
        if let Some(corners) = self.corners.get(t)
            && faces(t)
            && (p - closest_on_triangle(p, corners)).norm_squared() <= within * within
        {
            return true;
        }
        // The last admitted triangle is the result.
        let admit = |t: usize| {
            let is_admitted = faces(t);
            if is_admitted {
                likely.set(t as u32);
            }
            is_admitted
        };
        self.search(p, within, admit, true).is_some()
    }

    /// Appends the triangles whose boxes intersect `bounds`, in tree order. Returns false, and
    /// stops, if there are more than `most` of them.
    pub fn meeting(&self, bounds: &Aabb, most: usize, found: &mut Vec<u32>) -> bool {
        let mut stack = [0u32; STACK];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let node = &self.nodes[stack[depth] as usize];
            if !node.bounds.intersects(bounds) {
                continue;
            }
            if node.count == 0 && !node.bounds.is_empty() {
                stack[depth] = node.link + 1;
                stack[depth + 1] = node.link;
                depth += 2;
                continue;
            }
            for t in node.link as usize..(node.link + node.count) as usize {
                if self.boxes[t].intersects(bounds) {
                    if found.len() == most {
                        return false;
                    }
                    found.push(self.names[t]);
                }
            }
        }
        true
    }

    fn search(
        &self,
        p: &Point3<f64>,
        within: f64,
        admit: impl Fn(usize) -> bool,
        any: bool,
    ) -> Option<TriangleProjection> {
        let mut best = None;
        let mut limit = within * within;
        let mut stack = [(0u32, 0.0); STACK];
        let mut depth = 1;
        stack[0].1 = self.nodes[0].distance_squared(p);
        while depth > 0 {
            depth -= 1;
            let (index, lower) = stack[depth];
            if lower > limit || lower.is_nan() {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count == 0 && !node.bounds.is_empty() {
                let child = |n: u32| (n, self.nodes[n as usize].distance_squared(p));
                let (near, far) = (child(node.link), child(node.link + 1));
                let (near, far) = if far.1 < near.1 {
                    (far, near)
                } else {
                    (near, far)
                };
                stack[depth] = far;
                stack[depth + 1] = near;
                depth += 2;
                continue;
            }
            for t in node.link as usize..(node.link + node.count) as usize {
                // The plane of a triangle is never farther than the triangle; a flat triangle has
                // no normal and passes.
                let above = self.normals[t].dot(&(p - self.corners[t][0]));
                if above * above > limit || !admit(t) {
                    continue;
                }
                let point = closest_on_triangle(p, &self.corners[t]);
                let square = (p - point).norm_squared();
                if square < limit || (best.is_none() && square <= limit) {
                    limit = square;
                    best = Some(TriangleProjection {
                        point,
                        triangle: self.names[t],
                        distance: square.sqrt(),
                    });
                    if any || square == 0.0 {
                        return best;
                    }
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::{box_surface, icosphere};
    use proptest::prelude::*;

    fn point(size: f64) -> impl Strategy<Value = Point3<f64>> {
        prop::array::uniform3(-size..size).prop_map(Point3::from)
    }

    #[test]
    fn empty_surface() {
        let tree = SurfaceTree::new(&[], &[]);
        assert_eq!(tree.closest(&Point3::origin(), f64::INFINITY), None);
    }

    #[test]
    fn facing_picks_the_side_of_a_thin_sheet() {
        let m = box_surface([1.0, 0.01, 1.0], 0.1);
        let tree = SurfaceTree::new(&m.vertices, &m.triangles);
        let p = Point3::new(0.03, 0.004, 0.02);
        let down = -Vector3::y();
        assert!((tree.closest(&p, 1.0).expect("near").point.y - 0.005).abs() < 1e-15);
        assert!(
            (tree
                .closest_facing(&p, &down, 0.0, 1.0)
                .expect("near")
                .point
                .y
                + 0.005)
                .abs()
                < 1e-15
        );
        assert!(!tree.is_near_facing(&p, &down, 0.0, 0.008));
        assert!(tree.is_near_facing(&p, &down, 0.0, 0.010));
        assert_eq!(tree.closest(&p, 0.000_9), None);
    }

    proptest! {
        #[test]
        fn closest_point_of_a_triangle_is_a_minimum(p in point(2.0), a in point(1.0), b in point(1.0), c in point(1.0), weights in prop::array::uniform3(0.001..1.0), flat in any::<bool>()) {
            let c = if flat { a + 0.3 * (b - a) } else { c };
            let q = closest_on_triangle(&p, &[a, b, c]);
            let total: f64 = weights.iter().sum();
            let other = (a.coords * weights[0] + b.coords * weights[1] + c.coords * weights[2]) / total;
            prop_assert!((p - q).norm() <= (p.coords - other).norm() + 1e-14);
            // The plane of the triangle bounds the distance from below, corners from above.
            prop_assert!([a, b, c].iter().all(|v| (p - q).norm() <= (p - v).norm() + 1e-14));
            let n = (b - a).cross(&(c - a));
            prop_assert!((q - a).dot(&n).abs() < 1e-13);
        }

        #[test]
        fn what_was_found_last_changes_no_answer(
            points in prop::collection::vec(point(1.2), 30),
            normal in point(1.0),
            within in 0.0..0.3,
        ) {
            let m = icosphere(1.0, 2);
            let (tree, likely) = (SurfaceTree::new(&m.vertices, &m.triangles), Cell::new(u32::MAX));
            for p in &points {
                let alone = tree.is_near_facing(p, &normal.coords, 0.1, within);
                prop_assert_eq!(tree.is_near_facing_from(&likely, p, &normal.coords, 0.1, within), alone);
            }
        }

        #[test]
        fn tree_finds_what_a_scan_finds(p in point(1.5), rings in 0u32..4, within in 0.0..1.5) {
            let m = icosphere(1.0, rings);
            let tree = SurfaceTree::new(&m.vertices, &m.triangles);
            let scan = (0..m.triangles.len()).map(|t| (p - closest_on_triangle(&p, &m.corners(t))).norm()).fold(f64::INFINITY, f64::min);
            match tree.closest(&p, within) {
                Some(found) => {
                    prop_assert!((found.distance - scan).abs() < 1e-15);
                    prop_assert!((p - closest_on_triangle(&p, &m.corners(found.triangle as usize))).norm() == found.distance);
                }
                None => prop_assert!(scan >= within),
            }
        }
    }
}
