//! A bounding sphere of a body, and a point inside the body.

use crate::mesh::measures::max_or_nan;
use nalgebra::{Point3, Vector3};

use super::SphereError;
use crate::mesh::TriangleMesh;
use crate::mesh::closest::SurfaceTree;
use crate::mesh::inside::Inside;

/// A bounding sphere of some points in two passes \[ritter1990\]: up to about 14 % larger than the
/// smallest.
///
/// Returns centre and radius \[m\]; for no points a sphere of radius 0 at the origin.
pub fn bounding_sphere(points: &[Point3<f64>]) -> (Point3<f64>, f64) {
    let bounds = crate::mesh::Aabb::of_points(points);
    if bounds.is_empty() {
        return (Point3::origin(), 0.0);
    }
    let (mut centre, mut radius) = (bounds.center(), 0.5 * bounds.extents().max());
    for p in points {
        let distance = (p - centre).norm();
        if distance > radius {
            let grown = 0.5 * (distance - radius);
            centre += (p - centre) * (grown / distance);
            radius += grown;
        }
    }
    // Points that rounding left outside.
    let farthest = max_or_nan(points.iter().map(|p| (p - centre).norm()).chain([radius]));
    (centre, farthest)
}

/// Number of attempts to find a point inside, each from the end of the last one.
const ATTEMPTS: usize = 8;

/// A point inside the body near `from`: `from` itself if it is inside, otherwise the point half the
/// local thickness behind the nearest point of the surface, tested again (errata M6 to M8).
///
/// # Errors
/// No such point was found: the surface intersects itself or is inside out.
pub fn inside_near(mesh: &TriangleMesh, from: &Point3<f64>) -> Result<Point3<f64>, SphereError> {
    let inside = Inside::new(&mesh.vertices, &mesh.triangles);
    let tree = SurfaceTree::new(&mesh.vertices, &mesh.triangles);
    let mut at = *from;
    for _ in 0..ATTEMPTS {
        if inside.winding(&at) == 1 {
            return Ok(at);
        }
        let Some(near) = tree.closest(&at, f64::INFINITY) else {
            break;
        };
        let [a, b, c] = mesh.corners(near.triangle as usize);
        let Some(inward) = (c - a).cross(&(b - a)).try_normalize(0.0) else {
            break;
        };
        at = near.point + inward * (0.5 * thickness(mesh, near.triangle, &near.point, &inward));
    }
    Err(SphereError::Centre {
        winding: inside.winding(&at),
        at: at.coords.into(),
    })
}

/// Distance from a point of the surface through the body to the other side \[m\]; 0 without another
/// side.
fn thickness(mesh: &TriangleMesh, own: u32, from: &Point3<f64>, along: &Vector3<f64>) -> f64 {
    let hit = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        let (u, v) = (b - a, c - a);
        let p = along.cross(&v);
        let area = u.dot(&p);
        let w = from - a;
        let q = w.cross(&u);
        let (s, t, distance) = (w.dot(&p) / area, along.dot(&q) / area, v.dot(&q) / area);
        // The ray leaves the body at the far side; it does not enter there.
        let leaves = u.cross(&v).dot(along) > 0.0;
        (leaves && s >= 0.0 && t >= 0.0 && s + t <= 1.0 && distance > 0.0).then_some(distance)
    };
    let others = (0..mesh.triangles.len()).filter(|&t| t != own as usize);
    let nearest = others.filter_map(hit).fold(f64::INFINITY, f64::min);
    if nearest.is_finite() { nearest } else { 0.0 }
}
