//! The trait of the forces on the points of a spring system.

use nalgebra::{Point3, Vector3};

use crate::constraints::stencil::at;
use crate::constraints::{Potential, Stencil, Stencils};
use crate::mesh::sum::tree_sum_by;

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

/// Every sum over stencils acts as a force: minus its gradient.
impl<T: Stencil<K>, const K: usize> Force for Stencils<T, K> {
    fn name(&self) -> &'static str {
        Potential::name(self)
    }

    fn elements(&self) -> usize {
        self.terms().len()
    }

    fn highest_point(&self) -> Option<u32> {
        self.terms().iter().flat_map(Stencil::points).max()
    }

    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        let terms = self.terms();
        let energy = |t: usize| terms[t].energy(&at(terms[t].points(), x));
        tree_sum_by(terms.len(), |t| energy(t).unwrap_or(0.0))
    }

    fn add_force(&self, x: &[Point3<f64>], force: &mut [Vector3<f64>]) {
        for term in self.terms() {
            let points = term.points();
            if let Some((_, gradient)) = term.energy_and_gradient(&at(points, x)) {
                for (p, slope) in points.into_iter().zip(gradient) {
                    force[p as usize] -= slope;
                }
            }
        }
    }

    fn add_product(
        &self,
        x: &[Point3<f64>],
        p: &[Vector3<f64>],
        definite: bool,
        product: &mut [Vector3<f64>],
    ) {
        for term in self.terms() {
            let points = term.points();
            if let Some(rows) = term.product(&at(points, x), &at(points, p), definite) {
                for (p, row) in points.into_iter().zip(rows) {
                    product[p as usize] += row;
                }
            }
        }
    }

    fn add_row_sums(&self, x: &[Point3<f64>], sums: &mut [f64]) {
        for term in self.terms() {
            let points = term.points();
            if let Some(rows) = term.row_sums(&at(points, x)) {
                for (p, row) in points.into_iter().zip(rows) {
                    sums[p as usize] += row;
                }
            }
        }
    }
}
