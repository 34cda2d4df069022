//! The pairs of surfaces that overlap.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::crossing::{Faced, crossings};
use super::{RigidBody, SoftBody};
use crate::contact::Obstacle;
use crate::contact::surface::Surface;
use crate::mesh::measures::max_or_nan;

/// Two surfaces that overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Overlap {
    /// Indices of the surfaces, muscles first.
    pub of: [usize; 2],
    /// Number of pairs of triangles that cross.
    pub crossings: usize,
    /// Greatest depth of a vertex of one in the other [m].
    pub depth: f64,
}

/// The pairs of muscles, and of a muscle and a bone, that cross or of which one is in the other;
/// muscles have the first indices.
pub(super) fn find(soft: &[SoftBody<'_>], rigid: &[RigidBody<'_>]) -> Vec<Overlap> {
    let mut all = Vec::new();
    for (i, body) in soft.iter().enumerate() {
        for (j, other) in soft.iter().enumerate().skip(i + 1) {
            let x = body.surface.positions();
            all.extend(of_two(body.surface, x, other.surface, &Isometry3::identity(), [i, j]));
        }
        for (j, bone) in rigid.iter().enumerate() {
            let back = bone.pose.inverse();
            let x: Vec<Point3<f64>> = body.surface.positions().iter().map(|p| back * p).collect();
            all.extend(of_two(body.surface, &x, bone.surface, &bone.pose, [i, soft.len() + j]));
        }
    }
    all
}

/// The overlap of surface `a`, with positions `x` in the frame of `b`, and surface `b` at `pose`.
fn of_two(
    a: &Surface,
    x: &[Point3<f64>],
    b: &Surface,
    pose: &Isometry3<f64>,
    of: [usize; 2],
) -> Option<Overlap> {
    let one = Faced::new(x, a);
    let other = Faced::new(b.positions(), b);
    if !one.bounds.intersects(&other.bounds) {
        return None;
    }
    let crossings = crossings(&one, &other).len();
    let is_inside = |surface: &Surface, p: Option<Point3<f64>>| {
        p.is_some_and(|p| depth(surface, &p) > 0.0)
    };
    // Without a crossing one body can only be inside the other as a whole.
    if crossings == 0
        && !is_inside(b, x.first().copied())
        && !is_inside(a, b.positions().first().map(|p| pose * p))
    {
        return None;
    }
    let in_b = x.par_iter().map(|p| depth(b, p));
    let in_a = b.positions().par_iter().map(|p| depth(a, &(pose * p)));
    let depths: Vec<f64> = in_b.chain(in_a).collect();
    Some(Overlap {
        of,
        crossings,
        depth: max_or_nan(depths),
    })
}

/// Depth of a point in a surface [m]; 0 outside.
fn depth(surface: &Surface, p: &Point3<f64>) -> f64 {
    if !surface.bounding_box().contains(p) {
        return 0.0;
    }
    surface.closest(p).map_or(0.0, |on| (-on.distance).max(0.0))
}
