//! Triangles of one surface that meet where they are not joined.

use crate::mesh::closest::SurfaceTree;
use crate::mesh::measures::Aabb;
use crate::mesh::predicates;
use nalgebra::Point3;
use rayon::prelude::*;

/// Triangles searched between two looks at the budget; a part of what a search that stopped early reports.
const CHUNK: usize = 4096;

/// Pairs of boxes that a search may look at, in all and for each triangle. A surface has some twenty for each; only where
/// thousands of triangles lie in one place would their square be asked for.
const BUDGET: (usize, usize) = (1 << 22, 256);

/// The most pairs that are listed; all are counted.
const LISTED: usize = 100;

/// Triangles that meet where they are not joined.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Crossings {
    /// Pairs of triangles, the lower index first, ascending; at most 100 of them.
    pub pairs: Vec<[u32; 2]>,
    /// How many pairs there are.
    pub count: usize,
    /// Whether all were searched; else there may be more of them, because too many triangles lie in one place.
    pub complete: bool,
}

/// All pairs of triangles that share a point other than the corners they have in common; exact.
///
/// `names` says which vertex each vertex is, so that coincident vertices count as one. Triangles for which `skipped` holds
/// (those without area, duplicates) are left out.
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
