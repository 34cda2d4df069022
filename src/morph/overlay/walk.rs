//! The path of an edge of one map through the triangles of the other.

use nalgebra::Point3;

use super::super::sphere::{SphereMap, turn};
use crate::mesh::Topology;
use crate::mesh::topology::NONE;

/// True if two arcs of less than half a turn cross in their interiors, exactly.
///
/// The intersection is +-(p1 x p2) x (q1 x q2). It lies on both arcs only if both contain it with
/// the same sign. The printed test uses the two parameters alone, and so finds crossings of
/// antipodal arcs (M4).
pub fn arcs_cross(p: [&Point3<f64>; 2], q: [&Point3<f64>; 2]) -> bool {
    let (a, b) = (turn(p[0], q[0], q[1]), turn(p[1], q[0], q[1]));
    let (c, d) = (turn(q[0], p[0], p[1]), turn(q[1], p[0], p[1]));
    // If p leaves the plane of q from above, q must leave that of p from below, and vice versa.
    (a > 0.0 && b < 0.0 && c < 0.0 && d > 0.0) || (a < 0.0 && b > 0.0 && c > 0.0 && d < 0.0)
}

/// Data of a map for overlays with other maps.
pub(super) struct Ground<'a> {
    pub map: &'a SphereMap,
    pub topology: Topology,
}

/// A vertex or edge lies exactly on another: no general position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Exactly;

impl<'a> Ground<'a> {
    pub fn new(map: &'a SphereMap) -> Self {
        Self {
            map,
            topology: Topology::of_triangles(map.points().len(), map.triangles()),
        }
    }

    fn point(&self, v: u32) -> &'a Point3<f64> {
        &self.map.points()[v as usize]
    }

    /// The edges that the arc from `from` in triangle `start` to `to` in triangle `end` crosses, in
    /// order.
    pub fn crossed(
        &self,
        from: &Point3<f64>,
        start: u32,
        to: &Point3<f64>,
        end: u32,
    ) -> Result<Vec<u32>, Exactly> {
        let (mut found, mut at, mut came) = (Vec::new(), start, NONE);
        while at != end {
            let corners = self.map.triangles()[at as usize];
            let mut next = None;
            for k in 0..3 {
                let edge = self.topology.triangle_edges[at as usize][k];
                if edge == came {
                    continue;
                }
                let (a, b) = (self.point(corners[k]), self.point(corners[(k + 1) % 3]));
                // The sides of the arc with the ends of the edge, and the sides of the edge with
                // the ends of the arc.
                let ends = [turn(a, from, to), turn(b, from, to)];
                if ends.contains(&0.0) {
                    return Err(Exactly);
                }
                if arcs_cross([from, to], [a, b]) {
                    next = Some((edge, k));
                }
            }
            let Some((edge, k)) = next else {
                return Err(Exactly);
            };
            let Some(other) = self.topology.neighbours_of_triangle(at as usize)[k] else {
                return Err(Exactly);
            };
            found.push(edge);
            (at, came) = (other, edge);
            if found.len() > self.map.triangles().len() {
                return Err(Exactly);
            }
        }
        Ok(found)
    }
}
