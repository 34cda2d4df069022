//! Shapes between two bodies of any genus and any number of pieces, by their distance fields.
//!
//! The first body is taken to the second by the linear map between both (see
//! [`super::shape_similarity`]), by a part of its rotation and of its stretch that grows with t. In
//! that moving frame the signed distances of both bodies are blended linearly, and the shape is the
//! zero set of the blend \[cohenor1998\]. So handles and pieces appear and vanish on the way.

use nalgebra::{Matrix3, Point3, UnitQuaternion};

use super::align::rotation_of;
use super::correspondence::CorrespondenceError;
use super::pose::nearest_pose;
use super::shape_similarity::ShapeSimilarity;
use super::sphere::SphereError;
use super::sphere::surface::check_closed;
use crate::mesh::inside::Inside;
use crate::mesh::measures::Aabb;
use crate::mesh::{RepairOptions, SurfaceTree, TriangleMesh, isosurface, repair};
use crate::progress::Progress;

/// Cells beyond the bodies on each side.
const BEYOND: f64 = 2.0;

/// The shapes between two closed, oriented, outward surfaces as a function of t: near the first at
/// 0, near the second at 1, as surface nets with `cells` cells along the longest side of both.
/// Where surfaces touch in an edge or a vertex, they are separated. After a stop by `progress`
/// shapes mean nothing.
///
/// # Errors
/// A surface that is open, not manifold, not oriented, or inside out.
pub fn by_volume<'a>(
    meshes: [&'a TriangleMesh; 2],
    cells: usize,
    progress: &'a (dyn Progress + Sync),
) -> Result<impl Fn(f64) -> TriangleMesh + Sync + 'a, CorrespondenceError> {
    for (side, mesh) in meshes.iter().enumerate() {
        check_closed(mesh).map_err(|error| CorrespondenceError::Surface { side, error })?;
        let volume = mesh.volume();
        if !(volume > 0.0) {
            return Err(CorrespondenceError::InsideOut { side, volume });
        }
    }
    let frame = MovingFrame::new(meshes)?;
    let bodies = meshes.map(Body::new);
    let cell = longest(meshes[0]).max(longest(meshes[1])) / cells.max(1) as f64;
    Ok(move |t: f64| {
        let at = frame.at(t);
        let distance = |p: Point3<f64>| {
            if progress.is_stopped() {
                return f64::INFINITY;
            }
            let first = frame.middles[0] + at.back * (p - at.middle);
            let second = frame.second_of(&first);
            bodies[0].distance(&first) * (1.0 - t) + bodies[1].distance(&second) * t
        };
        let own = meshes[0].vertices.iter().map(|p| frame.moved(&at, p));
        let other = meshes[1].vertices.iter();
        let other = other.map(|p| frame.moved(&at, &frame.first_of(p)));
        let all: Vec<Point3<f64>> = own.chain(other).collect();
        let room = Aabb::of_points(&all);
        let beyond = nalgebra::Vector3::repeat(BEYOND * cell);
        let net = isosurface(distance, room.min - beyond, room.max + beyond, cell);
        repair(&net, &[], &RepairOptions::default()).mesh
    })
}

fn longest(mesh: &TriangleMesh) -> f64 {
    Aabb::of_points(&mesh.vertices).extents().max()
}

/// A body with its signed distance.
struct Body<'a> {
    tree: SurfaceTree,
    inside: Inside<'a>,
}

impl<'a> Body<'a> {
    fn new(mesh: &'a TriangleMesh) -> Self {
        Self {
            tree: SurfaceTree::new(&mesh.vertices, &mesh.triangles),
            inside: Inside::new(&mesh.vertices, &mesh.triangles),
        }
    }

    /// Signed distance [m], negative inside.
    fn distance(&self, p: &Point3<f64>) -> f64 {
        let found = self.tree.closest(p, f64::INFINITY);
        let distance = found.map_or(f64::INFINITY, |found| found.distance);
        if self.inside.winding(p) > 0 {
            -distance
        } else {
            distance
        }
    }
}

/// The linear map between both bodies, relative to their middles.
struct MovingFrame {
    middles: [Point3<f64>; 2],
    turn: UnitQuaternion<f64>,
    stretch: Matrix3<f64>,
    back: Matrix3<f64>,
}

/// The frame of the first body at t.
struct Part {
    middle: Point3<f64>,
    onward: Matrix3<f64>,
    back: Matrix3<f64>,
}

impl MovingFrame {
    fn new(meshes: [&TriangleMesh; 2]) -> Result<Self, CorrespondenceError> {
        let middles = meshes.map(|mesh| mesh.surface_centroid().unwrap_or_default());
        let (_, pose, _) = nearest_pose(&ShapeSimilarity::new(meshes));
        let turn = rotation_of(&pose);
        let stretch = turn.inverse().to_rotation_matrix() * pose;
        let flat = || CorrespondenceError::Surface {
            side: 0,
            error: SphereError::TooFew {
                vertices: meshes[0].vertices.len(),
                triangles: meshes[0].triangles.len(),
            },
        };
        let back = pose.try_inverse().ok_or_else(flat)?;
        Ok(Self {
            middles,
            turn,
            stretch,
            back,
        })
    }

    /// The place of the second body that lies at one of the first.
    fn second_of(&self, first: &Point3<f64>) -> Point3<f64> {
        self.middles[1] + self.turn * (self.stretch * (first - self.middles[0]))
    }

    fn first_of(&self, second: &Point3<f64>) -> Point3<f64> {
        self.middles[0] + self.back * (second - self.middles[1])
    }

    /// Where a place of the first body is at t.
    fn moved(&self, at: &Part, first: &Point3<f64>) -> Point3<f64> {
        at.middle + at.onward * (first - self.middles[0])
    }

    fn at(&self, t: f64) -> Part {
        let turn = UnitQuaternion::from_scaled_axis(self.turn.scaled_axis() * t);
        let stretch = Matrix3::identity() * (1.0 - t) + self.stretch * t;
        let onward = turn.to_rotation_matrix() * stretch;
        // A blend of two positive definite matrices has an inverse.
        let back = onward.try_inverse().unwrap_or_else(Matrix3::identity);
        let middle = self.middles[0] + (self.middles[1] - self.middles[0]) * t;
        Part {
            middle,
            onward,
            back,
        }
    }
}
