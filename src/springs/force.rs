//! What acts on the points of a spring system.

use nalgebra::{Point3, Vector3};

/// A force on the points of a system, from their positions alone.
///
/// Everything is added to what is there already, in an order that is the same for any number of threads.
pub trait Force: Send + Sync {
    /// What reports call it.
    fn name(&self) -> &'static str;

    /// Number of springs, or of whatever else it consists of.
    fn elements(&self) -> usize;

    /// The highest point that it acts on; `None` where it acts on none.
    fn highest_point(&self) -> Option<u32>;

    /// Stored energy [J].
    fn energy(&self, x: &[Point3<f64>]) -> f64;

    /// Adds the force on each point [N], shape `[point_count]`.
    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]);

    /// Adds K p [N] for displacements `p` [m], K the negative derivative of the force.
    ///
    /// With `definite` parts of K that push out, such as those across a compressed spring, are left out: then K is
    /// symmetric and positive semi-definite, as the method of conjugate gradients needs it.
    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    );

    /// Adds for each point a bound on the sum of the norms of the blocks in its row of K [N/m].
    fn add_row_sums(&self, x: &[Point3<f64>], sums: &mut [f64]);
}
