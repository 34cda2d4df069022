//! Every triangle for every point: the reference of the other methods.

use nalgebra::Point3;

use super::{Best, BroadPhase, NearestTriangle};
use crate::mesh::TriangleMesh;

/// Entry in the list of methods.
pub(super) const METHOD: BroadPhase = BroadPhase {
    name: "brute force",
    sizes: &[0],
    usual: 0,
    sort: |_, _| Box::new(BruteForce),
};

/// Tests all triangles: `n m` tests for `n` points and `m` triangles (errata A03).
#[derive(Clone, Copy, Debug, Default)]
pub struct BruteForce;

impl NearestTriangle for BruteForce {
    fn nearest(&self, mesh: &TriangleMesh, point: &Point3<f64>, reach: f64) -> Option<u32> {
        let mut best = Best::within(reach);
        (0..mesh.triangles.len() as u32).for_each(|t| best.look_at(mesh, point, t));
        best.triangle
    }

    fn bytes(&self) -> usize {
        0
    }
}
