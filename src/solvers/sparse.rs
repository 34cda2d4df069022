//! Sparse symmetric positive definite systems over the vertices of a mesh; the only file that uses
//! faer.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::solvers::LltError;
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

/// Error of a factorisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FactorError {
    /// A pivot was not positive.
    #[error("the matrix is not positive definite (at unknown {unknown})")]
    NotPositiveDefinite {
        /// The vertex among the unknowns with that pivot.
        unknown: usize,
    },
    /// Too little memory for the factor, or more entries than can be counted.
    #[error("a factor of {bytes} bytes does not fit into memory")]
    OutOfMemory {
        /// Size of the factor [bytes]; 0 if it cannot be computed.
        bytes: usize,
    },
}

/// A symmetric matrix with `B` by `B` blocks over `count` vertices and a fixed pattern, with its
/// Cholesky factor.
///
/// The order of elimination is computed once, on blocks (approximate minimum degree), and reused by
/// every factorisation. One thread does all the work, so the bits do not depend on the number of
/// threads.
pub struct Factor<const B: usize> {
    /// Number of vertices.
    count: usize,
    /// Block rows of each block column, from the diagonal downwards.
    start: Vec<usize>,
    rows: Vec<u32>,
    /// The lower triangle by scalar columns.
    column: Vec<usize>,
    row: Vec<usize>,
    values: Vec<f64>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
    memory: MemBuffer,
}

impl<const B: usize> Factor<B> {
    /// Creates a system whose blocks can be non-zero on the diagonal and at the given `pairs` of
    /// vertices.
    ///
    /// # Errors
    /// Too little memory.
    pub fn new(count: usize, pairs: &[[u32; 2]]) -> Result<Self, FactorError> {
        let (start, rows) = pattern(count, pairs);
        let columns: Vec<usize> = start.clone();
        let blocks: Vec<usize> = rows.iter().map(|&r| r as usize).collect();
        let by_block = analyse(count, &columns, &blocks, SymmetricOrdering::Amd)?;
        let (column, row) = scalar_pattern::<B>(count, &start, &rows);
        let symbolic = match by_block.perm() {
            Some(order) if B > 1 => {
                let (forward, inverse) =
                    (spread::<B>(order.arrays().0), spread::<B>(order.arrays().1));
                let order = PermRef::new_checked(&forward, &inverse, count * B);
                analyse(count * B, &column, &row, SymmetricOrdering::Custom(order))?
            }
            _ => by_block,
        };
        let too_large = FactorError::OutOfMemory {
            bytes: symbolic.len_val().saturating_mul(8),
        };
        let mut factor = Vec::new();
        factor
            .try_reserve_exact(symbolic.len_val())
            .map_err(|_| too_large)?;
        factor.resize(symbolic.len_val(), 0.0);
        let factoring = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let solving = symbolic.solve_in_place_scratch::<f64>(MOST_COLUMNS, Par::Seq);
        let memory = MemBuffer::try_new(factoring.or(solving)).map_err(|_| too_large)?;
        Ok(Self {
            count,
            start,
            rows,
            values: vec![0.0; row.len()],
            column,
            row,
            symbolic,
            factor,
            memory,
        })
    }

    /// Number of vertices.
    pub fn count(&self) -> usize {
        self.count
    }

    /// True if the pattern contains all these pairs of vertices.
    pub fn covers(&self, pairs: &[[u32; 2]]) -> bool {
        let has = |&[a, b]: &[u32; 2]| {
            let column = a.min(b) as usize;
            self.rows[self.start[column]..self.start[column + 1]]
                .binary_search(&a.max(b))
                .is_ok()
        };
        pairs.iter().all(has)
    }

    /// Number of entries of the factor.
    pub fn entries(&self) -> usize {
        self.factor.len()
    }

    /// Heap memory held [bytes], without the lists of the order of elimination.
    pub fn bytes(&self) -> usize {
        (self.start.len()
            + self.column.len()
            + self.row.len()
            + self.values.len()
            + self.factor.len())
            * 8
            + self.rows.len() * 4
            + self.memory.len()
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds `block[c][r]` to row r, column c of the block of vertices `i` (rows) and `j` (columns),
    /// i >= j; only the lower triangle of a block on the diagonal is used.
    ///
    /// # Panics
    /// If the pair is not in the pattern.
    pub fn add(&mut self, i: u32, j: u32, block: &[[f64; B]; B]) {
        let range = self.start[j as usize]..self.start[j as usize + 1];
        let found = self.rows[range].binary_search(&i);
        let k = found.unwrap_or_else(|_| panic!("vertices {i} and {j} have no entry"));
        for (c, numbers) in block.iter().enumerate() {
            let first = if k == 0 { c } else { 0 };
            let begin = self.column[j as usize * B + c] + k * B + first - c;
            self.values[begin..begin + B - first]
                .iter_mut()
                .zip(&numbers[first..])
                .for_each(|(v, n)| *v += n);
        }
    }

    /// Adds `value` to every entry of the diagonal of vertex `i`.
    pub fn add_diagonal(&mut self, i: u32, value: f64) {
        for c in 0..B {
            self.values[self.column[i as usize * B + c]] += value;
        }
    }

    /// Trace of the matrix.
    pub fn trace(&self) -> f64 {
        crate::mesh::sum::tree_sum_by(self.count * B, |c| self.values[self.column[c]])
    }

    /// Factorises the matrix.
    ///
    /// # Errors
    /// The matrix is not positive definite.
    pub fn factorise(&mut self) -> Result<(), FactorError> {
        let n = self.count * B;
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &self.column, None, &self.row);
        let matrix = SparseColMatRef::new(pattern, &self.values);
        let stack = MemStack::new(&mut self.memory);
        let done = self.symbolic.factorize_numeric_llt(
            &mut self.factor,
            matrix,
            Side::Lower,
            Default::default(),
            Par::Seq,
            stack,
            Default::default(),
        );
        match done.map(|_| ()) {
            // A NaN passes as a pivot and spoils all later ones.
            Ok(()) if self.factor.iter().all(|v| v.is_finite()) => Ok(()),
            Ok(()) => Err(FactorError::NotPositiveDefinite { unknown: 0 }),
            Err(LltError::NonPositivePivot { index }) => {
                let unknown = self.symbolic.perm().map_or(index, |p| p.arrays().0[index]);
                Err(FactorError::NotPositiveDefinite {
                    unknown: unknown / B,
                })
            }
        }
    }

    /// Solves for `columns` right-hand sides of `count` times `B` numbers each, in sequence, in
    /// place.
    ///
    /// # Panics
    /// If `rhs` has another length, or there are more than six columns.
    pub fn solve(&mut self, rhs: &mut [f64], columns: usize) {
        assert!(
            columns <= MOST_COLUMNS,
            "at most {MOST_COLUMNS} right-hand sides"
        );
        let rhs = MatMut::from_column_major_slice_mut(rhs, self.count * B, columns);
        let factor = LltRef::new(&self.symbolic, &self.factor);
        factor.solve_in_place_with_conj(Conj::No, rhs, Par::Seq, MemStack::new(&mut self.memory));
    }
}

/// Right-hand sides solved at once: a direction and the volume's gradient.
const MOST_COLUMNS: usize = 6;

/// Sorted block rows of each block column from the diagonal downwards, without duplicates.
fn pattern(count: usize, pairs: &[[u32; 2]]) -> (Vec<usize>, Vec<u32>) {
    // Into buckets by column first: each is short, and sorting all pairs would cost more than the
    // analysis of the factor.
    let mut end = vec![1; count];
    pairs.iter().for_each(|[a, b]| end[*a.min(b) as usize] += 1);
    let mut first = Vec::with_capacity(count);
    let mut sum = 0;
    for length in &end {
        first.push(sum);
        sum += length;
    }
    let mut all = vec![0; sum];
    end.copy_from_slice(&first);
    let mut put = |column: u32, row: u32| {
        all[end[column as usize]] = row;
        end[column as usize] += 1;
    };
    (0..count as u32).for_each(|i| put(i, i));
    pairs.iter().for_each(|&[a, b]| put(a.min(b), a.max(b)));
    let (mut start, mut rows) = (vec![0], Vec::new());
    for (first, end) in first.into_iter().zip(end) {
        let bucket = &mut all[first..end];
        bucket.sort_unstable();
        rows.extend(bucket.chunk_by(|a, b| a == b).map(|same| same[0]));
        start.push(rows.len());
    }
    (start, rows)
}

/// The lower triangle by scalar columns: column c of a diagonal block begins at its own row.
fn scalar_pattern<const B: usize>(
    count: usize,
    start: &[usize],
    rows: &[u32],
) -> (Vec<usize>, Vec<usize>) {
    let (mut column, mut row) = (
        Vec::with_capacity(count * B + 1),
        Vec::with_capacity(rows.len() * B * B),
    );
    column.push(0);
    for j in 0..count {
        for c in 0..B {
            for (k, &i) in rows[start[j]..start[j + 1]].iter().enumerate() {
                row.extend(((if k == 0 { c } else { 0 })..B).map(|r| i as usize * B + r));
            }
            column.push(row.len());
        }
    }
    (column, row)
}

/// Expands an order of blocks to an order of their unknowns.
fn spread<const B: usize>(order: &[usize]) -> Vec<usize> {
    order
        .iter()
        .flat_map(|&i| (0..B).map(move |c| i * B + c))
        .collect()
}

fn analyse(
    n: usize,
    column: &[usize],
    row: &[usize],
    order: SymmetricOrdering<'_, usize>,
) -> Result<SymbolicCholesky<usize>, FactorError> {
    let pattern = SymbolicSparseColMatRef::new_checked(n, n, column, None, row);
    factorize_symbolic_cholesky(
        pattern,
        Side::Lower,
        order,
        CholeskySymbolicParams::default(),
    )
    .map_err(|_| FactorError::OutOfMemory { bytes: 0 })
}
