//! Distance between two surfaces.

use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::max_or_nan;
use nalgebra::Point3;
use rayon::prelude::*;

/// Greatest distances between two surfaces, measured from the corners, edge midpoints and centroids
/// of all triangles [unit of the coordinates]; `None` where one surface has no triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Deviation {
    /// From points of the first surface to the second: what the second lost or moved.
    pub lost: Option<f64>,
    /// From points of the second surface to the first: what the second added.
    pub added: Option<f64>,
}

/// Measures both directions.
pub fn deviation(first: &TriangleMesh, second: &TriangleMesh) -> Deviation {
    Deviation {
        lost: greatest_distance(first, second),
        added: greatest_distance(second, first),
    }
}

/// Greatest distance from the samples of one surface to another one.
fn greatest_distance(from: &TriangleMesh, to: &TriangleMesh) -> Option<f64> {
    if from.triangles.is_empty() || to.triangles.is_empty() {
        return None;
    }
    let tree = SurfaceTree::new(&to.vertices, &to.triangles);
    let distance = |p: &Point3<f64>| tree.closest(p, f64::MAX).map_or(f64::NAN, |c| c.distance);
    let furthest = |t: usize| max_or_nan(samples(from.corners(t)).iter().map(distance));
    Some(max_or_nan(
        (0..from.triangles.len())
            .into_par_iter()
            .map(furthest)
            .collect::<Vec<_>>(),
    ))
}

/// The corners, edge midpoints and centroid of a triangle.
fn samples([a, b, c]: [Point3<f64>; 3]) -> [Point3<f64>; 7] {
    let middle = |p: Point3<f64>, q: Point3<f64>| p + (q - p) * 0.5;
    let centroid = a + ((b - a) + (c - a)) / 3.0;
    [a, b, c, middle(a, b), middle(b, c), middle(c, a), centroid]
}
