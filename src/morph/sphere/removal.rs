//! The order of the removal of vertices: the remaining vertices are an even sample of the surface
//! at every stage.
//!
//! Each step removes the vertex whose replacement triangles have the shortest edges. The new edges
//! count, not the contracted one. On a regular mesh all contracted edges are equally long, and a
//! tube would be removed from one end; the reinsertion would then have to fit its whole length into
//! the room of one cap.
//!
//! Lengths are not those in space. Around a thin limb few vertices would remain at stations far
//! apart, finally three. A triangle whose corners lie on the sides of another has a quarter of its
//! area, so every further station would have a quarter of the room of the last one, and doubles
//! would end after a few. Therefore points are also as far apart as their normals: around a limb
//! the normals make a full turn, for any thickness and bend.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use super::super::oriented_point::OrientedPoint;
use super::SphereError;
use super::centre::bounding_sphere;
use super::rings::{Removed, Rings};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;

/// Radius of the body in units where two perpendicular unit normals are 1.4 apart. Maps are equally
/// good from 2 to 6.
const EXTENT: f64 = 3.0;

/// The vertices of a body.
pub fn oriented_points(mesh: &TriangleMesh) -> Vec<OrientedPoint> {
    let (centre, radius) = bounding_sphere(&mesh.vertices);
    // A body of size 0 has no order.
    let scale = if radius > 0.0 { EXTENT / radius } else { 0.0 };
    let oriented_point = |(p, normal): (&Point3<f64>, Vector3<f64>)| OrientedPoint {
        place: Point3::from((p - centre) * scale),
        normal,
    };
    mesh.vertices
        .iter()
        .zip(mesh.vertex_normals())
        .map(oriented_point)
        .collect()
}

/// Cost of the contraction of a vertex into its best neighbour.
#[derive(Clone, Copy, PartialEq)]
struct Candidate {
    cost: f64,
    vertex: u32,
    into: u32,
    /// Number of earlier evaluations of the vertex; candidates with a smaller stamp are obsolete.
    stamp: u32,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cost
            .total_cmp(&other.cost)
            .then(self.vertex.cmp(&other.vertex))
            .then(self.stamp.cmp(&other.stamp))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Removes vertices until four remain.
pub fn reduce(
    oriented_points: &[OrientedPoint],
    mut rings: Rings,
) -> Result<(Rings, Vec<Removed>), SphereError> {
    let count = oriented_points.len();
    let mut stamps = vec![0u32; count];
    let mut open: BinaryHeap<Reverse<Candidate>> = (0..count as u32)
        .filter_map(|v| best(oriented_points, &rings, v, 0))
        .map(Reverse)
        .collect();
    let mut removed = Vec::with_capacity(count - 4);
    while removed.len() + 4 < count {
        let Some(Reverse(candidate)) = open.pop() else {
            let left = (0..count as u32).filter(|&v| !rings.of(v).is_empty());
            let again: Vec<_> = left
                .clone()
                .filter_map(|v| best(oriented_points, &rings, v, stamps[v as usize]))
                .collect();
            if again.is_empty() {
                return Err(SphereError::Stuck {
                    vertex: left.min().unwrap_or(0),
                    left: count - removed.len(),
                });
            }
            open.extend(again.into_iter().map(Reverse));
            continue;
        };
        let Candidate {
            vertex,
            into,
            stamp,
            ..
        } = candidate;
        if rings.of(vertex).is_empty() || stamp != stamps[vertex as usize] {
            continue;
        }
        let possible = rings.of(vertex).contains(&into) && rings.can_draw(vertex, into);
        let touched = if possible {
            let last = rings.draw(vertex, into);
            let touched = last.ring.clone();
            removed.push(last);
            touched
        } else {
            vec![vertex]
        };
        for v in touched {
            stamps[v as usize] += 1;
            open.extend(best(oriented_points, &rings, v, stamps[v as usize]).map(Reverse));
        }
    }
    Ok((rings, removed))
}

/// The neighbour with the least cost of a contraction: without long new edges, and without many
/// neighbours afterwards.
fn best(
    oriented_points: &[OrientedPoint],
    rings: &Rings,
    vertex: u32,
    stamp: u32,
) -> Option<Candidate> {
    let ours = rings.of(vertex);
    let cost = |into: u32| {
        let from = &oriented_points[into as usize];
        let longest = max_or_nan(
            ours.iter()
                .map(|&v| from.square(&oriented_points[v as usize])),
        );
        let degree = ours.len() + rings.of(into).len() - 4;
        let many = degree.saturating_sub(6) as f64 + ours.len().saturating_sub(6) as f64;
        longest * (1.0 + many * many)
    };
    let possible = ours
        .iter()
        .copied()
        .filter(|&into| rings.can_draw(vertex, into));
    possible
        .map(|into| Candidate {
            cost: cost(into),
            vertex,
            into,
            stamp,
        })
        .min()
}
