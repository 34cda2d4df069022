//! Every triangle for every point: what the other ways are measured by.

use nalgebra::Point3;

use super::{Best, Kind, Way};
use crate::mesh::TriangleMesh;

/// Line of the list of ways.
pub(super) const KIND: Kind = Kind {
    name: "brute force",
    sizes: &[0],
    usual: 0,
    sort: |_, _| Box::new(BruteForce),
};

/// Looks at all triangles; `n m` of them for `n` points and `m` triangles (errata A03).
#[derive(Clone, Copy, Debug, Default)]
pub struct BruteForce;

impl Way for BruteForce {
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32> {
        let mut best = Best::within(reach);
        (0..mesh.triangles.len() as u32).for_each(|t| best.look_at(mesh, point, t));
        best.triangle
    }

    fn bytes(&self) -> usize {
        0
    }
}
