//! In which order vertices are taken out, so that what is left is a fair sample of the surface at every stage.
//!
//! Each time the vertex goes whose triangles give way to the ones with the shortest edges. What counts is the length of the
//! edges that come, not of the one that is contracted: on a regular mesh all contracted edges are equally long, and a tube would
//! be eaten up from one end, with all of its length put back later into what one cap has left for it.
//!
//! Lengths are not those in space. Around a thin limb few vertices would be left at stations far apart, three at last; and a
//! triangle whose corners lie on the sides of another has a quarter of its area: so every further station has a quarter of the
//! room of the last, and doubles end after a few. Hence places count as far apart as the normals there, as well: around a limb
//! normals turn all the way, however thin it is and whichever way it bends.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use super::super::oriented_point::OrientedPoint;
use super::SphereError;
use super::centre::bounding_sphere;
use super::rings::{Removed, Rings};
use crate::mesh::TriangleMesh;
use crate::mesh::measures::max_or_nan;

/// The radius of the body, where two unit vectors at a right angle are 1.4 apart. Maps are as good from 2 to 6.
const EXTENT: f64 = 3.0;

/// The vertices of a body.
pub fn oriented_points(mesh: &TriangleMesh) -> Vec<OrientedPoint> {
    let (centre, radius) = bounding_sphere(&mesh.vertices);
    // A body without size has no order either.
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

/// What it costs to draw a vertex into its best neighbour.
#[derive(Clone, Copy, PartialEq)]
struct Candidate {
    cost: f64,
    vertex: u32,
    into: u32,
    /// How often the vertex was looked at before; older ones are out of date.
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

/// Takes vertices out until four are left.
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

/// The cheapest neighbour to draw a vertex into: one without long new edges, and without many neighbours afterwards.
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
