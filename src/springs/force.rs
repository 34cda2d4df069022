//! What acts on the points of a spring system.

use nalgebra::{Point3, Vector3};

use crate::constraints::stencil::at;
use crate::constraints::{Potential, Stencil, Stencils};
use crate::mesh::sum::tree_sum_by;

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
