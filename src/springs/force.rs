//! The trait of the forces on the points of a spring system.

use nalgebra::{Point3, Vector3};

/// A force on the points of a system, as a function of their positions.
///
/// All methods add to the given arrays, in an order that is the same for any number of threads.
pub trait Force: Send + Sync {
    /// Name in reports.
    fn name(&self) -> &'static str;

    /// Number of springs or other elements.
    fn elements(&self) -> usize;

    /// The greatest index of a point with a force; `None` for no points.
    fn highest_point(&self) -> Option<u32>;

    /// Stored energy [J].
    fn energy(&self, x: &[Point3<f64>]) -> f64;

    /// Adds the force on each point [N], shape `[point_count]`.
    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]);

    /// Adds K p [N] for displacements `p` [m], where K is the negative derivative of the force.
    ///
    /// With `definite`, negative parts of K are left out, such as those across a compressed spring.
    /// K is then symmetric and positive semi-definite, as conjugate gradients require.
    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    );

    /// Adds to `sums`, for each point, a bound on the sum of the norms of the blocks in its row of
    /// K [N/m].
    fn add_row_sums(&self, x: &[Point3<f64>], sums: &mut [f64]);
}
