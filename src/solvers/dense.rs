//! The factor of a dense symmetric matrix, by faer, which works in blocks: a thousand rows of contact,
//! column by column, took most of the time of a minimum.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::cholesky::llt::solve::solve_in_place;
use faer::{MatMut, MatRef, Par};
use nalgebra::{DMatrix, DVector};

/// A Cholesky factor.
#[derive(Clone, Debug)]
pub(super) struct DenseFactor {
    /// Its lower triangle; what lies above belongs to the matrix.
    lower: DMatrix<f64>,
}

impl DenseFactor {
    /// `None` for a matrix that is not positive definite, or without rows.
    pub fn new(matrix: &DMatrix<f64>) -> Option<Self> {
        let (rows, columns) = matrix.shape();
        if rows == 0 {
            return None;
        }
        let mut lower = matrix.clone();
        let request = cholesky_in_place_scratch::<f64>(rows, Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(request).ok()?;
        cholesky_in_place(
            MatMut::from_column_major_slice_mut(lower.as_mut_slice(), rows, columns),
            Default::default(),
            // The same bits for any number of threads.
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .ok()?;
        Some(Self { lower })
    }

    /// The solution for a right-hand side.
    pub fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        let mut found = right.clone();
        let rows = found.len();
        solve_in_place(
            MatRef::from_column_major_slice(self.lower.as_slice(), rows, rows),
            MatMut::from_column_major_slice_mut(found.as_mut_slice(), rows, 1),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(StackReq::EMPTY)),
        );
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Draw;

    #[test]
    fn it_solves_and_refuses_what_is_not_positive_definite() {
        let mut draw = Draw::new(5);
        for n in [1, 2, 7, 130] {
            let root = DMatrix::from_fn(n, n, |_, _| draw.between(-1.0, 1.0));
            let matrix = &root * root.transpose() + DMatrix::identity(n, n);
            let right = DVector::from_fn(n, |_, _| draw.between(-1.0, 1.0));
            let factor = DenseFactor::new(&matrix).expect("positive definite");
            let found = factor.solve(&right);
            // The solution of a matrix that is as near as rounding.
            let near = 8.0 * n as f64 * f64::EPSILON * matrix.norm() * found.norm();
            let residual = (&matrix * &found - &right).norm();
            assert!(residual <= near, "{n} rows: {residual:e}");
            for bad in [-2.0 * matrix[(0, 0)], f64::NAN] {
                let mut wrong = matrix.clone();
                wrong[(n - 1, n - 1)] = bad;
                assert!(DenseFactor::new(&wrong).is_none(), "{n} rows with {bad}");
            }
        }
        assert!(DenseFactor::new(&DMatrix::zeros(0, 0)).is_none());
    }
}
