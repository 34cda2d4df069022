//! Comparisons of contact methods on the same vertices, for benches and the command: the responses
//! to penetration, and the methods of detection \[cervenka2019\].

pub(crate) mod detection;
pub(crate) mod responses;

use nalgebra::Point3;

use super::{Obstacle, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::inside::Inside;
use crate::mesh::measures::Aabb;

/// Rounding error of a distance, relative to the greatest coordinate of the bone.
const ROUNDING: f64 = 1e-13;

/// A vertex in the bounding box of a bone, in the frame of the bone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Query {
    /// Index of the bone.
    pub bone: usize,
    /// The vertex [m].
    pub point: Point3<f64>,
    /// Its place beside the bone one frame before [m].
    pub before: Point3<f64>,
    /// True if the vertex is inside, by exact winding numbers if the surface is closed and
    /// oriented.
    pub inside: bool,
    /// Signed distance by the hierarchy of the library [m].
    pub distance: f64,
}

/// The vertices among `points`, each with its place one frame before, that are in the box of a bone.
/// All are in the frame of the bone [m].
pub fn queries(
    bone: usize,
    mesh: &TriangleMesh,
    surface: &Surface,
    points: impl IntoIterator<Item = (Point3<f64>, Point3<f64>)>,
) -> Vec<Query> {
    let bounds = mesh.bounding_box();
    let exact = surface
        .is_sound()
        .then(|| Inside::new(&mesh.vertices, &mesh.triangles));
    let mut found = Vec::new();
    for (point, before) in points {
        if !bounds.contains(&point) {
            continue;
        }
        if let Some(closest) = surface.closest(&point) {
            found.push(Query {
                bone,
                point,
                before,
                inside: exact
                    .as_ref()
                    .map_or(closest.distance < 0.0, |i| i.winding(&point) != 0),
                distance: closest.distance,
            });
        }
    }
    found
}

/// The greatest absolute coordinate of a box [m].
pub(crate) fn size(bounds: &Aabb) -> f64 {
    bounds.min.coords.amax().max(bounds.max.coords.amax())
}
