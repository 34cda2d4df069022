//! Independent audit of a frame by exact predicates and winding numbers, without the contact code
//! and without a solver: crossings of triangles, vertices inside, shared volumes, depths of
//! rigid surfaces in each other.

mod frame;
mod rigid;
mod summary;
#[cfg(test)]
mod tests;

pub use frame::{Audit, AuditedPair, AuditedSurface, CrossingCounts, FrameAudit};
pub use summary::{AuditSummary, PairSummary};

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crate::contact::{Obstacle, Surface};
use crate::mesh::TriangleMesh;
use crate::mesh::inside::Inside;
use crate::mesh::measures::max_or_nan;

/// A vertex at a smaller depth [m] counts as touching.
pub const DEPTH: f64 = 1e-5;

/// Findings of one muscle in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Findings {
    /// Free vertices deeper than [`DEPTH`] in a bone.
    pub vertices_inside: usize,
    /// Bone vertices inside the muscle.
    pub bone_vertices_inside: usize,
    /// Greatest depth of a free vertex [m].
    pub depth: f64,
}

/// A bone prepared for the audit.
pub struct AuditedBone<'a> {
    inside: Inside<'a>,
    surface: &'a Surface,
    mesh: &'a TriangleMesh,
}

impl<'a> AuditedBone<'a> {
    /// Prepares a bone; `surface` only gives the depth of vertices that `mesh` contains.
    pub fn new(mesh: &'a TriangleMesh, surface: &'a Surface) -> Self {
        Self {
            inside: Inside::new(&mesh.vertices, &mesh.triangles),
            surface,
            mesh,
        }
    }
}

/// Examines a muscle with vertices `x` among bones at their poses; `free` is true for vertices that
/// are not fixed.
pub fn examine(
    x: &[Point3<f64>],
    triangles: &[[u32; 3]],
    free: &(impl Fn(usize) -> bool + Sync),
    bones: &[(&AuditedBone<'_>, Isometry3<f64>)],
) -> Findings {
    let mut findings = Findings::default();
    let muscle = Inside::new(x, triangles);
    for (bone, pose) in bones {
        let back = pose.inverse();
        let moved: Vec<Point3<f64>> = x.iter().map(|p| back * p).collect();
        let depths = depths(&moved, free, &bone.inside, |p| {
            bone.surface.closest(p).map_or(0.0, |c| c.distance.abs())
        });
        findings.vertices_inside += depths.iter().filter(|(_, d)| *d > DEPTH).count();
        findings.depth = max_or_nan(depths.iter().map(|(_, d)| *d).chain([findings.depth]));
        let points = bone.mesh.vertices.par_iter().with_min_len(256);
        findings.bone_vertices_inside += points
            .filter(|p| muscle.winding(&(pose * **p)) != 0)
            .count();
    }
    findings
}

/// The points among those that `count` inside a closed surface, in order, with their depths [m].
fn depths(
    points: &[Point3<f64>],
    count: impl Fn(usize) -> bool + Sync,
    inside: &Inside<'_>,
    depth: impl Fn(&Point3<f64>) -> f64 + Sync,
) -> Vec<(usize, f64)> {
    let is_inside = |v: &usize| count(*v) && inside.winding(&points[*v]) != 0;
    let all = (0..points.len()).into_par_iter().with_min_len(256);
    all.filter(is_inside)
        .map(|v| (v, depth(&points[v])))
        .collect()
}
