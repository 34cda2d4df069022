//! Potentials: parts of the energy of a body, with forces and second derivatives.

use nalgebra::{DMatrix, Matrix3, Point3, Vector3};

use crate::constraints::EnclosedVolume;
use crate::state::State;

/// A part of a body's energy, a function of the positions of its vertices.
pub trait Potential: Send + Sync {
    /// The effect's name.
    fn name(&self) -> &'static str;
    /// Energy [J] at positions `x` [m].
    fn energy(&self, x: &[Point3<f64>]) -> f64;
    /// Energy [J]; adds its gradient [N] to `gradient`, one entry per vertex.
    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64;
    /// Calls `pair` with every two vertices between which the second derivative can differ from
    /// zero.
    fn pairs(&self, pair: &mut dyn FnMut(u32, u32));
    /// Calls `add` with the blocks of the second derivative [N/m], by row and column. With
    /// `convex`, the blocks are those of the nearest positive semi-definite part of each stencil.
    fn hessian(
        &self,
        x: &[Point3<f64>],
        convex: bool,
        add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
    );
    /// Calls `add` with the entries [N/m] of a positive semi-definite matrix over vertices. The
    /// matrix approximates the second derivative at `x`, equally in all directions of space.
    fn scalar_hessian(&self, x: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64));
    /// Greatest force [N] at a strain or an angle of one. Forces are compared with it. Zero for a
    /// part whose forces are compared with those of other parts.
    fn force_scale(&self, _x: &[Point3<f64>]) -> f64 {
        0.0
    }
    /// Sets the shortening of fibres, relative to their length at rest.
    fn shorten(&mut self, _shortening: f64) {}
    /// Moves the planes over bones: a point [m] and the unit normal of each.
    fn place(&mut self, _planes: &[(Point3<f64>, Vector3<f64>)]) {}
    /// Sets the directions along which edges are kept, each as long as the root of its share in the
    /// stiffness. Without any, none of these constraints acts.
    fn turn(&mut self, _along: &[Vector3<f64>]) {}
    /// State beside the positions; `None` for a part that depends on positions alone.
    fn memory(&self) -> Option<&dyn Memory> {
        None
    }
    /// The same as [`Self::memory`], mutable.
    fn memory_mut(&mut self) -> Option<&mut dyn Memory> {
        None
    }
}

/// State of a potential beside the positions, such as the branches of periodic constraints.
/// Checkpoints contain it.
pub trait Memory: State {
    /// Stores the branch of each periodic constraint at positions `x` [m].
    fn remember(&mut self, x: &[Point3<f64>]);
}

/// The nearest positive semi-definite matrix: negative eigenvalues become zero.
pub(crate) fn positive_part<const K: usize>(
    blocks: &[[Matrix3<f64>; K]; K],
) -> [[Matrix3<f64>; K]; K] {
    let whole = DMatrix::from_fn(3 * K, 3 * K, |r, c| blocks[r / 3][c / 3][(r % 3, c % 3)]);
    let mut split = whole.symmetric_eigen();
    split.eigenvalues.iter_mut().for_each(|v| *v = v.max(0.0));
    let whole = split.recompose();
    std::array::from_fn(|i| {
        std::array::from_fn(|j| whole.fixed_view::<3, 3>(3 * i, 3 * j).into_owned())
    })
}

/// Second derivative of the enclosed volume. Calls `add` with its blocks times `factor`, by row and
/// column.
pub fn volume_hessian(
    volume: &EnclosedVolume,
    x: &[Point3<f64>],
    factor: f64,
    add: &mut dyn FnMut(u32, u32, &Matrix3<f64>),
) {
    for t in volume.triangles() {
        let p = t.map(|v| x[v as usize]);
        for k in 0..3 {
            // V = a.(b x c)/6: d2V/(da db) v = (v x c)/6. On a closed surface only the difference
            // of c for the two triangles of an edge remains. Therefore both may be measured from
            // the middle of the edge.
            let (i, j, c) = (t[k], t[(k + 1) % 3], p[(k + 2) % 3]);
            let middle = nalgebra::center(&p[k], &p[(k + 1) % 3]);
            let block = (c - middle).cross_matrix() * (-factor / 6.0);
            add(i, j, &block);
            add(j, i, &block.transpose());
        }
    }
}
