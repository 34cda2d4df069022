//! Crossings of two surfaces, by exact predicates.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::solid::Solid;
use crate::contact::surface::Surface;
use crate::mesh::measures::Aabb;
use crate::mesh::predicates;

/// A scalar product above this share of the product of the lengths is positive: far above its
/// rounding error.
const CERTAIN: f64 = 1e-12;

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
    let mut candidates = Candidates::default();
    candidates.renew(a, b, 0.0, 0.0);
    candidates.crossings(a, b)
}

/// The pairs of triangles of two surfaces, or of one, that may share a point, while their motion is
/// small.
#[derive(Default)]
pub(super) struct Candidates {
    /// Motion of both surfaces up to which there are no others [m]; `None` at first.
    until: Option<f64>,
    /// The pairs, ascending.
    pairs: Vec<[u32; 2]>,
}

impl Candidates {
    /// Finds the pairs anew if the surfaces `travelled` too far since the last search [m]; they are
    /// valid for a motion by `lasting` [m]. The positions of `b` are those of its hierarchy.
    pub fn renew(&mut self, a: &Faced<'_>, b: &Faced<'_>, travelled: f64, lasting: f64) {
        if self.until.is_some_and(|until| travelled <= until) {
            return;
        }
        self.until = Some(travelled + lasting);
        let all = 0..a.surface.triangles().len() as u32;
        self.pairs.clear();
        if a.bounds.inflate(lasting).intersects(&b.bounds) {
            let found = all.into_par_iter().with_min_len(256);
            let found = found.flat_map_iter(|s| near(a, b, s, lasting));
            self.pairs.par_extend(found);
        }
    }

    /// The pairs of triangles of `a` and `b` that share a point, ascending; exact.
    pub fn crossings(&self, a: &Faced<'_>, b: &Faced<'_>) -> Vec<[u32; 2]> {
        self.among(|[s, t]| {
            let (one, other) = (a.corners(s), b.corners(t));
            Aabb::of_points(&one).intersects(&Aabb::of_points(&other))
                && share_a_point(&one, &other)
        })
    }

    /// The pairs of triangles of one surface that share a point other than their common corners, the
    /// lower first, ascending; exact.
    pub fn of_itself(&self, a: &Solid) -> Vec<[u32; 2]> {
        self.among(|[s, t]| {
            let [one, other] = [s, t].map(|t| a.triangles()[t as usize]);
            t > s
                && Aabb::of_points(&a.corners(s)).intersects(&Aabb::of_points(&a.corners(t)))
                && !fall_away(one, other, a.x())
                && predicates::intersect(one, other, |v| a.x()[v as usize])
        })
    }

    fn among(&self, crosses: impl Fn([u32; 2]) -> bool + Sync) -> Vec<[u32; 2]> {
        let pairs = self.pairs.par_iter().with_min_len(1024).copied();
        pairs.filter(|pair| crosses(*pair)).collect()
    }
}

/// The triangles of `b` nearer than `reach` to triangle `s` of `a` in each direction, ascending.
fn near(a: &Faced<'_>, b: &Faced<'_>, s: u32, reach: f64) -> Vec<[u32; 2]> {
    let bounds = Aabb::of_points(&a.corners(s)).inflate(reach);
    let mut near = Vec::new();
    if bounds.intersects(&b.bounds) {
        let half = 0.5 * bounds.extents().amax();
        b.surface.within(&bounds.center(), half, &mut near);
        near.retain(|&t| Aabb::of_points(&b.corners(t)).intersects(&bounds));
        near.sort_unstable();
    }
    near.into_iter().map(|t| [s, t]).collect()
}

/// True if two triangles that share a corner lie on both sides of a plane through it, beyond doubt:
/// the common case, without an exact predicate.
fn fall_away(one: [u32; 3], other: [u32; 3], x: &[Point3<f64>]) -> bool {
    let Some(&shared) = one.iter().find(|v| other.contains(v)) else {
        return false;
    };
    let from = |t: [u32; 3]| t.map(|v| x[v as usize] - x[shared as usize]);
    let (one, other) = (from(one), from(other));
    let normal = one.iter().sum::<Vector3<f64>>() - other.iter().sum::<Vector3<f64>>();
    // The shared corner is on the plane, the two others of each triangle are not.
    let is_beyond = |corners: [Vector3<f64>; 3], normal: Vector3<f64>| {
        let least = CERTAIN * normal.norm();
        let beyond = corners.iter().filter(|c| normal.dot(c) > least * c.norm());
        beyond.count() == 2
    };
    is_beyond(one, normal) && is_beyond(other, -normal)
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
