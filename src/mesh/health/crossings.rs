//! Self-intersections: triangles of one surface that intersect where they are not joined.

use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::Aabb;
use crate::mesh::predicates;
use nalgebra::Point3;
use rayon::prelude::*;

/// Number of triangles between two checks of the budget.
const CHUNK: usize = 4096;

/// Greatest number of box pairs in a search, in all and per triangle. A normal surface has about
/// twenty per triangle; only thousands of triangles at one position would need their square.
const BUDGET: (usize, usize) = (1 << 22, 256);

/// Greatest number of listed pairs; the count covers all pairs.
const LISTED: usize = 100;

/// Self-intersections of a surface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Crossings {
    /// Pairs of triangles, the lower index first, ascending; at most 100 of them.
    pub pairs: Vec<[u32; 2]>,
    /// Number of pairs.
    pub count: usize,
    /// True if all pairs were tested; false if too many triangles at one position ended the search
    /// early.
    pub complete: bool,
}

/// All pairs of triangles that share a point other than their common corners; exact.
///
/// `names` maps each vertex to its representative, so that coincident vertices count as one.
/// Triangles with `skipped` (zero area, duplicates) are left out.
pub fn crossings(
    vertices: &[Point3<f64>],
    triangles: &[[u32; 3]],
    names: &[u32],
    skipped: impl Fn(usize) -> bool + Sync,
) -> Crossings {
    let tree = SurfaceTree::new(vertices, triangles);
    let budget = BUDGET.0 + BUDGET.1 * triangles.len();
    let mut all = Crossings {
        complete: true,
        ..Crossings::default()
    };
    let mut looked = 0;
    for start in (0..triangles.len()).step_by(CHUNK) {
        let end = (start + CHUNK).min(triangles.len());
        let share = (budget - looked) / (end - start);
        let of = |t: usize| triangles[t].map(|v| names[v as usize]);
        let search = |t: usize| {
            let mut near = Vec::new();
            if skipped(t) {
                return (near, 0, 0, true);
            }
            let bounds = Aabb::of_points(&triangles[t].map(|v| vertices[v as usize]));
            let whole = tree.meeting(&bounds, share, &mut near);
            let looked = near.len();
            near.retain(|&u| {
                let u = u as usize;
                u > t
                    && !skipped(u)
                    && predicates::intersect(of(t), of(u), |v| vertices[v as usize])
            });
            near.sort_unstable();
            let count = near.len();
            near.truncate(LISTED);
            near.shrink_to_fit();
            (near, count, looked, whole)
        };
        let found: Vec<_> = (start..end).into_par_iter().map(search).collect();
        for (t, (others, count, boxes, whole)) in (start..end).zip(found) {
            looked += boxes;
            all.complete &= whole;
            all.count += count;
            let room = LISTED.saturating_sub(all.pairs.len());
            all.pairs
                .extend(others.iter().take(room).map(|&u| [t as u32, u]));
        }
    }
    all
}
