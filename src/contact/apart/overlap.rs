//! The pairs of surfaces that overlap.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::crossing::{Faced, crossings};
use super::{Moved, PartedPair, RigidBody, SoftBody};
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
    /// Number of vertices of the first in the second, and of the second in the first.
    pub inside: [usize; 2],
    /// Greatest depth of a vertex of one in the other [m].
    pub depth: f64,
    /// A place of the overlap [m].
    pub place: Point3<f64>,
}

impl Overlap {
    /// The overlap with the names of its surfaces and the motion that removed it.
    pub fn pair(&self, names: [&str; 2], moved: Moved) -> PartedPair {
        PartedPair {
            pair: names.map(str::to_owned),
            depth: self.depth,
            crossings: self.crossings,
            inside: self.inside,
            place: self.place,
            moved,
        }
    }
}

/// The pairs of muscles, and of a muscle and a bone, that cross or of which one is in the other;
/// muscles have the first indices.
pub(super) fn find(soft: &[SoftBody<'_>], rigid: &[RigidBody<'_>]) -> Vec<Overlap> {
    let mut all = Vec::new();
    for (i, body) in soft.iter().enumerate() {
        for (j, other) in soft.iter().enumerate().skip(i + 1) {
            let x = body.surface.positions();
            all.extend(of_two(
                body.surface,
                x,
                other.surface,
                &Isometry3::identity(),
                [i, j],
            ));
        }
        for (j, bone) in rigid.iter().enumerate() {
            let back = bone.pose.inverse();
            let x: Vec<Point3<f64>> = body.surface.positions().iter().map(|p| back * p).collect();
            all.extend(of_two(
                body.surface,
                &x,
                bone.surface,
                &bone.pose,
                [i, soft.len() + j],
            ));
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
    let crossing = crossings(&one, &other);
    let ends = [x.first().copied(), b.positions().first().map(|p| pose * p)];
    let is_inside =
        |surface: &Surface, p: Option<Point3<f64>>| p.is_some_and(|p| depth(surface, &p) > 0.0);
    // Without a crossing one body can only be inside the other as a whole.
    if crossing.is_empty() && !is_inside(b, ends[0]) && !is_inside(a, ends[1]) {
        return None;
    }
    let in_b: Vec<f64> = x.par_iter().map(|p| depth(b, p)).collect();
    let in_a = b.positions().par_iter().map(|p| depth(a, &(pose * p)));
    let in_a: Vec<f64> = in_a.collect();
    let place = match crossing.first() {
        Some([s, _]) => pose * one.corners(*s)[0],
        None => pose * x.first().copied().unwrap_or_else(Point3::origin),
    };
    Some(Overlap {
        of,
        crossings: crossing.len(),
        inside: [&in_b, &in_a].map(|depths| depths.iter().filter(|d| **d > 0.0).count()),
        depth: max_or_nan(in_b.into_iter().chain(in_a)),
        place,
    })
}

/// Depth of a point in a surface [m]; 0 outside.
fn depth(surface: &Surface, p: &Point3<f64>) -> f64 {
    if !surface.bounding_box().contains(p) {
        return 0.0;
    }
    surface.closest(p).map_or(0.0, |on| (-on.distance).max(0.0))
}
