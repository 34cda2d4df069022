//! Crossings of two surfaces, by exact predicates.

use nalgebra::Point3;
use rayon::prelude::*;

use super::solid::Solid;
use crate::contact::surface::Surface;
use crate::mesh::measures::Aabb;
use crate::mesh::predicates;

/// An edge of one surface that passes through a triangle of another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piercing {
    /// The edge.
    pub edge: u32,
    /// Place of the crossing along the edge, 0 at its first vertex and 1 at its second.
    pub at: f64,
    /// The triangle of the other surface.
    pub triangle: u32,
}

/// The triangles of a surface with positions in the frame of another one.
pub(super) struct Faced<'a> {
    x: &'a [Point3<f64>],
    surface: &'a Surface,
    /// Bounds of the positions [m].
    pub bounds: Aabb,
}

impl<'a> Faced<'a> {
    /// The triangles of `surface` with positions `x` [m].
    pub fn new(x: &'a [Point3<f64>], surface: &'a Surface) -> Self {
        let bounds = Aabb::of_points(x);
        Self { x, surface, bounds }
    }

    /// Corners of a triangle [m].
    pub fn corners(&self, t: u32) -> [Point3<f64>; 3] {
        self.surface.triangles()[t as usize].map(|v| self.x[v as usize])
    }
}

/// The pairs of triangles of `a` and `b` that share a point, ascending; exact. The positions of `b`
/// are those of its hierarchy.
pub(super) fn crossings(a: &Faced<'_>, b: &Faced<'_>) -> Vec<[u32; 2]> {
    if !a.bounds.intersects(&b.bounds) {
        return Vec::new();
    }
    (0..a.surface.triangles().len() as u32)
        .into_par_iter()
        .with_min_len(256)
        .flat_map_iter(|s| crossings_of(a, b, s))
        .collect()
}

fn crossings_of(a: &Faced<'_>, b: &Faced<'_>, s: u32) -> Vec<[u32; 2]> {
    let one = a.corners(s);
    let bounds = Aabb::of_points(&one);
    if !bounds.intersects(&b.bounds) {
        return Vec::new();
    }
    let mut near = Vec::new();
    let reach = 0.5 * bounds.extents().amax();
    b.surface.within(&bounds.center(), reach, &mut near);
    near.retain(|&t| {
        let other = b.corners(t);
        Aabb::of_points(&other).intersects(&bounds) && share_a_point(&one, &other)
    });
    near.into_iter().map(|t| [s, t]).collect()
}

/// The pairs of triangles of one surface that share a point other than their common corners, the
/// lower first, ascending; exact.
pub(super) fn of_itself(a: &Solid) -> Vec<[u32; 2]> {
    (0..a.triangles().len() as u32)
        .into_par_iter()
        .with_min_len(256)
        .flat_map_iter(|s| {
            let bounds = Aabb::of_points(&a.corners(s));
            let mut near = Vec::new();
            let reach = 0.5 * bounds.extents().amax();
            a.surface.within(&bounds.center(), reach, &mut near);
            near.retain(|&t| {
                let [one, other] = [s, t].map(|t| a.triangles()[t as usize]);
                t > s
                    && Aabb::of_points(&a.corners(t)).intersects(&bounds)
                    && predicates::intersect(one, other, |v| a.x()[v as usize])
            });
            near.sort_unstable();
            near.into_iter().map(move |t| [s, t])
        })
        .collect()
}

fn share_a_point(one: &[Point3<f64>; 3], other: &[Point3<f64>; 3]) -> bool {
    predicates::intersect([0, 1, 2], [3, 4, 5], |v| match v {
        0..3 => one[v as usize],
        _ => other[v as usize - 3],
    })
}

/// The edges of `a` through triangles of `b`, by edge and place, from the crossing triangles
/// `(of a, of b)`.
pub(super) fn piercings(
    a: &Solid,
    b: &Solid,
    crossing: impl IntoIterator<Item = (u32, u32)>,
) -> Vec<Piercing> {
    let mut tried: Vec<(u32, u32)> = crossing
        .into_iter()
        .flat_map(|(s, t)| a.topology.triangle_edges[s as usize].map(|edge| (edge, t)))
        .collect();
    tried.sort_unstable();
    tried.dedup();
    let mut found: Vec<Piercing> = tried
        .into_iter()
        .filter_map(|(edge, triangle)| piercing(a, b, edge, triangle))
        .collect();
    found.sort_by(|p, q| {
        let key = |p: &Piercing| (p.edge, p.triangle);
        let order = p.edge.cmp(&q.edge).then(p.at.total_cmp(&q.at));
        order.then(key(p).cmp(&key(q)))
    });
    found
}

fn piercing(a: &Solid, b: &Solid, edge: u32, triangle: u32) -> Option<Piercing> {
    let [p, q] = a.topology.edges[edge as usize].map(|v| a.x()[v as usize]);
    let t = b.corners(triangle);
    if !predicates::segment_meets(&p, &q, &t) {
        return None;
    }
    let normal = (t[1] - t[0]).cross(&(t[2] - t[0]));
    let (above, below) = (normal.dot(&(p - t[0])), normal.dot(&(q - t[0])));
    let at = above / (above - below);
    // Within the plane of the triangle every place is as good.
    let at = if at.is_finite() {
        at.clamp(0.0, 1.0)
    } else {
        0.5
    };
    Some(Piercing { edge, at, triangle })
}
