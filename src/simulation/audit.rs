//! Independent audit of a written frame: vertices inside bones and bone vertices inside muscles, by
//! exact winding numbers, without the contact code.

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
        let depths: Vec<f64> = (0..x.len())
            .into_par_iter()
            .with_min_len(256)
            .filter(|&v| free(v) && bone.inside.winding(&(back * x[v])) != 0)
            .map(|v| {
                bone.surface
                    .closest(&(back * x[v]))
                    .map_or(0.0, |c| c.distance.abs())
            })
            .collect();
        findings.vertices_inside += depths.iter().filter(|d| **d > DEPTH).count();
        findings.depth = max_or_nan(depths.into_iter().chain([findings.depth]));
        let points = bone.mesh.vertices.par_iter().with_min_len(256);
        findings.bone_vertices_inside += points
            .filter(|p| muscle.winding(&(pose * **p)) != 0)
            .count();
    }
    findings
}
