//! A surface in a grid of equal cubes, for tests against the hierarchy of another: a fine surface
//! against a coarse one.

use nalgebra::{Point3, Vector3};

use super::hierarchy::Hierarchy;
use crate::contact::broad_phase::overlap::may_meet;
use crate::mesh::measures::Aabb;

/// Greatest number of entries of all lists.
const MOST: usize = 1 << 26;
/// Upper bound of the rounding error of a cube's coordinate, relative to the largest coordinate.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Error of [`VoxelGrid::new`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum VoxelError {
    /// The side is not a positive length.
    #[error("a voxel has sides of {0} m; they have to be longer than nothing")]
    Side(f64),
    /// The cubes are too small for the lists.
    #[error(
        "voxels of {side} m are too small for this surface: triangles would be in more than 2^26 of them"
    )]
    TooSmall {
        /// Side of a cube [m].
        side: f64,
    },
}

/// The cubes that a surface intersects, each with its triangles; empty cubes are not stored.
///
/// [`crate::contact::broad_phase::BitGrid`] uses cubes as a solid obstacle.
#[derive(Clone, Debug, Default)]
pub struct VoxelGrid {
    origin: Point3<f64>,
    side: f64,
    slack: f64,
    /// Indices of the cubes in the grid, ascending.
    cells: Vec<[u32; 3]>,
    /// Start of each list, and the end of the last one.
    start: Vec<u32>,
    listed: Vec<u32>,
}

impl VoxelGrid {
    /// Sorts triangles with valid indices and vertices [m] into cubes of side `side` [m].
    ///
    /// # Errors
    /// A side that is not positive, or far too short for the surface.
    pub fn new(x: &[Point3<f64>], triangles: &[[u32; 3]], side: f64) -> Result<Self, VoxelError> {
        if !(side > 0.0 && side.is_finite()) {
            return Err(VoxelError::Side(side));
        }
        let all = Aabb::of_points(triangles.iter().flatten().map(|&v| &x[v as usize]));
        if all.is_empty() {
            return Ok(Self {
                side,
                start: vec![0],
                ..Self::default()
            });
        }
        let slack = ROUNDING * (all.min.coords.amax().max(all.max.coords.amax()) + side);
        let mut this = Self {
            origin: all.min - Vector3::repeat(slack),
            side,
            slack,
            ..Self::default()
        };
        let corners = |t: usize| triangles[t].map(|v| x[v as usize]);
        let boxes = (0..triangles.len()).map(|t| this.range(&corners(t)));
        let count: f64 = boxes
            .map(|[low, high]| (0..3).map(|k| high[k] - low[k] + 1.0).product::<f64>())
            .sum();
        // This also keeps indices within 32 bits: a connected surface intersects all cubes on its
        // way.
        if !(count <= MOST as f64 && all.extents().max() / side < f64::from(u32::MAX)) {
            return Err(VoxelError::TooSmall { side });
        }
        let mut found: Vec<([u32; 3], u32)> = Vec::new();
        for t in 0..triangles.len() {
            this.each(&corners(t), |cell| found.push((cell, t as u32)));
        }
        found.sort_unstable();
        for (k, &(cell, triangle)) in found.iter().enumerate() {
            if this.cells.last() != Some(&cell) {
                this.cells.push(cell);
                this.start.push(k as u32);
            }
            this.listed.push(triangle);
        }
        this.start.push(found.len() as u32);
        Ok(this)
    }

    /// Lowest and highest cube of a triangle's box, as numbers.
    fn range(&self, t: &[Point3<f64>; 3]) -> [Vector3<f64>; 2] {
        let b = Aabb::of_points(t).inflate(self.slack);
        [b.min, b.max].map(|p| ((p - self.origin) / self.side).map(|c| c.floor().max(0.0)))
    }

    /// Visits a superset of the cubes that a triangle intersects.
    fn each(&self, t: &[Point3<f64>; 3], mut visit: impl FnMut([u32; 3])) {
        let [low, high] = self.range(t).map(|v| v.map(|c| c as u32));
        for i in low.x..=high.x {
            for j in low.y..=high.y {
                for k in low.z..=high.z {
                    if self.may_meet(t, [i, j, k]) {
                        visit([i, j, k]);
                    }
                }
            }
        }
    }

    fn may_meet(&self, t: &[Point3<f64>; 3], cell: [u32; 3]) -> bool {
        may_meet(
            t,
            &self.bounds(cell).center(),
            &Vector3::repeat(0.5 * self.side + self.slack),
        )
    }

    /// The box of a cube [m].
    pub fn bounds(&self, cell: [u32; 3]) -> Aabb {
        let min = self.origin + Vector3::from(cell).map(f64::from) * self.side;
        Aabb {
            min,
            max: min + Vector3::repeat(self.side),
        }
    }

    /// The indices of cubes with triangles, ascending.
    pub fn cells(&self) -> &[[u32; 3]] {
        &self.cells
    }

    /// The triangles of the cube with an index into [`Self::cells`], ascending.
    pub fn triangles(&self, cell: usize) -> &[u32] {
        &self.listed[self.start[cell] as usize..self.start[cell + 1] as usize]
    }

    /// Pairs of cubes, as indices into [`Self::cells`], and triangles of another surface that
    /// intersect them, by a descent of its hierarchy, refitted to `x` [m]. Ascending by cube;
    /// rounding can add a pair but never removes one.
    pub fn pairs_with(
        &self,
        hierarchy: &Hierarchy,
        x: &[Point3<f64>],
        triangles: &[[u32; 3]],
    ) -> Vec<[u32; 2]> {
        let mut found = Vec::new();
        for (index, &cell) in self.cells.iter().enumerate() {
            let begin = found.len();
            hierarchy.meeting(&self.bounds(cell).inflate(self.slack), |t| {
                if self.may_meet(&triangles[t as usize].map(|v| x[v as usize]), cell) {
                    found.push([index as u32, t]);
                }
            });
            found[begin..].sort_unstable();
        }
        found
    }

    /// All pairs of a triangle of this surface and one of another that intersect the same cube,
    /// each once, ascending. They include all triangles with a common point.
    pub fn pairs(
        &self,
        hierarchy: &Hierarchy,
        x: &[Point3<f64>],
        triangles: &[[u32; 3]],
    ) -> Vec<[u32; 2]> {
        let found = self.pairs_with(hierarchy, x, triangles);
        let both = found.iter().flat_map(|&[cell, t]| {
            self.triangles(cell as usize)
                .iter()
                .map(move |&own| [own, t])
        });
        let mut pairs: Vec<[u32; 2]> = both.collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }
}
