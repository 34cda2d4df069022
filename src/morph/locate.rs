//! Point location in a map of the sphere, by a tree of caps.

use nalgebra::{Point3, Vector3};

use super::sphere::{SphereMap, turn};

/// Triangles in a leaf.
const LEAF: usize = 4;
/// Tolerance of a cap's opening: cosines near 1 lose half of their digits.
const MARGIN: f64 = 1e-12;

/// A point in a triangle of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// The triangle.
    pub triangle: u32,
    /// Barycentric weights, at least 0 and of sum 1, of the intersection of the triangle's plane
    /// with the line from the centre.
    pub weights: [f64; 3],
}

impl Located {
    /// The point with these weights for other positions of the same vertices \[m\].
    pub fn of(&self, triangles: &[[u32; 3]], positions: &[Point3<f64>]) -> Point3<f64> {
        let [a, b, c] = triangles[self.triangle as usize].map(|v| positions[v as usize]);
        // The difference form reproduces a corner exactly.
        a + (b - a) * self.weights[1] + (c - a) * self.weights[2]
    }
}

/// A tree of caps over the triangles of a map.
#[derive(Clone, Debug)]
pub struct Locator<'a> {
    map: &'a SphereMap,
    nodes: Vec<Node>,
    order: Vec<u32>,
}

/// Children `link`, `link + 1` where `count` is zero, otherwise triangles `link..link + count` of
/// the order.
#[derive(Clone, Copy, Debug)]
struct Node {
    axis: Vector3<f64>,
    /// Lower bound of the cosine between the axis and any point of the triangles below.
    cosine: f64,
    link: u32,
    count: u32,
}

impl<'a> Locator<'a> {
    /// Builds the tree over the triangles of a map.
    pub fn new(map: &'a SphereMap) -> Self {
        let corner = |v: u32| map.points()[v as usize].coords;
        let middles: Vec<Vector3<f64>> = map
            .triangles()
            .iter()
            .map(|t| t.map(corner).iter().sum::<Vector3<f64>>().normalize())
            .collect();
        let mut order: Vec<u32> = (0..middles.len() as u32).collect();
        let empty = Node {
            axis: Vector3::z(),
            cosine: -1.0,
            link: 0,
            count: 0,
        };
        let (mut nodes, mut open) = (vec![empty], vec![(0usize, 0usize, order.len())]);
        while let Some((node, start, end)) = open.pop() {
            let part = &mut order[start..end];
            let sum: Vector3<f64> = part.iter().map(|&t| middles[t as usize]).sum();
            if let Some(axis) = sum.try_normalize(0.0) {
                let corners = part.iter().flat_map(|&t| map.triangles()[t as usize]);
                let cosine = corners.map(|v| axis.dot(&corner(v))).fold(1.0, f64::min);
                // A cap smaller than a hemisphere that contains the corners contains the triangles;
                // a larger cap need not.
                (nodes[node].axis, nodes[node].cosine) =
                    (axis, if cosine > 0.0 { cosine - MARGIN } else { -2.0 });
            }
            if part.len() <= LEAF {
                (nodes[node].link, nodes[node].count) = (start as u32, part.len() as u32);
                continue;
            }
            let low = part
                .iter()
                .fold(Vector3::repeat(2.0), |m, &t| m.inf(&middles[t as usize]));
            let high = part
                .iter()
                .fold(Vector3::repeat(-2.0), |m, &t| m.sup(&middles[t as usize]));
            let axis = (high - low).imax();
            let half = part.len() / 2;
            part.select_nth_unstable_by(half, |&i, &j| {
                middles[i as usize][axis]
                    .total_cmp(&middles[j as usize][axis])
                    .then(i.cmp(&j))
            });
            let child = nodes.len();
            nodes[node].link = child as u32;
            nodes.extend([empty; 2]);
            open.push((child, start, start + half));
            open.push((child + 1, start + half, end));
        }
        Self { map, nodes, order }
    }

    /// The map.
    pub fn map(&self) -> &'a SphereMap {
        self.map
    }

    /// The triangle that contains a direction, exactly; on an edge the one with the lower index.
    /// `None` only for a zero or NaN direction.
    pub fn locate(&self, direction: &Vector3<f64>) -> Option<Located> {
        self.locate_exactly(&Point3::from(direction.try_normalize(0.0)?))
    }

    /// The same as [`Self::locate`], for a point as stored.
    pub(super) fn locate_exactly(&self, p: &Point3<f64>) -> Option<Located> {
        let triangle = self.holding(p)?;
        Some(Located {
            triangle,
            weights: self.weights(triangle, p),
        })
    }

    fn holding(&self, p: &Point3<f64>) -> Option<u32> {
        let mut open = vec![0u32];
        let mut found: Option<u32> = None;
        while let Some(node) = open.pop().map(|n| &self.nodes[n as usize]) {
            if node.axis.dot(&p.coords) < node.cosine {
                continue;
            }
            if node.count == 0 {
                open.extend([node.link + 1, node.link]);
                continue;
            }
            for &t in &self.order[node.link as usize..(node.link + node.count) as usize] {
                if found.is_none_or(|f| t < f) && self.sides(t, p).iter().all(|s| *s >= 0.0) {
                    found = Some(t);
                }
            }
        }
        found
    }

    /// The side of each triangle edge on which a point lies, exact in sign: edge k is opposite
    /// corner k.
    pub(super) fn sides(&self, triangle: u32, p: &Point3<f64>) -> [f64; 3] {
        let [a, b, c] =
            self.map.triangles()[triangle as usize].map(|v| &self.map.points()[v as usize]);
        [turn(b, c, p), turn(c, a, p), turn(a, b, p)]
    }

    fn weights(&self, triangle: u32, p: &Point3<f64>) -> [f64; 3] {
        let sides = self.sides(triangle, p).map(|s| s.max(0.0));
        let sum: f64 = sides.iter().sum();
        sides.map(|s| s / sum)
    }
}
