//! The unknown vertices, and the constant matrix over them that approximates the energy's second
//! derivative.

use nalgebra::{Point3, Vector3};

use super::energy::Energy;
use super::sparse::{Factor, FactorError};
use crate::mesh::union_find::UnionFind;

/// Number of fields to which the inverse is applied at once: a direction and the gradient of a
/// volume.
const AT_ONCE: usize = 2;

/// Marks a fixed vertex, which has no index among the unknowns.
const HELD: u32 = u32::MAX;

/// Numbering of the free vertices.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Unknowns {
    /// The vertex of each unknown, ascending.
    pub free: Vec<u32>,
    number: Vec<u32>,
}

impl Unknowns {
    /// Numbers the vertices with positive inverse mass.
    pub fn new(inverse_mass: &[f64]) -> Self {
        let mut unknowns = Self::default();
        for (v, w) in inverse_mass.iter().enumerate() {
            unknowns.number.push(if *w > 0.0 {
                unknowns.free.len() as u32
            } else {
                HELD
            });
            if *w > 0.0 {
                unknowns.free.push(v as u32);
            }
        }
        unknowns
    }

    /// The index of a vertex; `None` for a fixed one.
    #[inline]
    pub fn of(&self, vertex: u32) -> Option<u32> {
        Some(self.number[vertex as usize]).filter(|n| *n != HELD)
    }

    /// Number of vertices, including fixed ones.
    pub fn count(&self) -> usize {
        self.number.len()
    }

    /// Pairs of unknowns among those of `pairs`, which can repeat.
    pub fn pairs(&self, pairs: impl FnOnce(&mut dyn FnMut(u32, u32))) -> Vec<[u32; 2]> {
        let mut all = Vec::new();
        pairs(&mut |a, b| {
            if let (Some(a), Some(b)) = (self.of(a), self.of(b)) {
                all.push([a.min(b), a.max(b)]);
            }
        });
        all
    }

    /// Sets all entries but those of the unknowns to zero.
    pub fn release_held(&self, field: &mut [Vector3<f64>]) {
        field
            .iter_mut()
            .zip(&self.number)
            .filter(|(_, n)| **n == HELD)
            .for_each(|(f, _)| *f = Vector3::zeros());
    }
}

/// The first unknown of a part without a fixed vertex and without inertia: rounding can hide its
/// free motion from a factorisation.
fn first_loose(unknowns: &Unknowns, energy: &Energy, to_held: &[(u32, u32, f64)]) -> Option<usize> {
    if energy.inertia.is_some() {
        return None;
    }
    let mut sets = UnionFind::new(unknowns.free.len());
    // By elastic parts alone: the pattern of the volume joins vertices without a force between
    // them.
    energy.elastic_pairs(&mut |a, b| {
        if let (Some(i), Some(j)) = (unknowns.of(a), unknowns.of(b)) {
            sets.join(i, j);
        }
    });
    let mut is_held = vec![false; unknowns.free.len()];
    for &(i, _, value) in to_held.iter().filter(|(_, _, value)| *value != 0.0) {
        debug_assert!(value.is_finite());
        is_held[sets.root(i) as usize] = true;
    }
    (0..is_held.len() as u32)
        .find(|&i| !is_held[sets.root(i) as usize])
        .map(|i| i as usize)
}

/// A constant matrix over vertices, equal in every direction of space, with its factorisation.
pub struct Laplacian {
    factor: Factor<1>,
    /// Entries between an unknown and a fixed vertex.
    to_held: Vec<(u32, u32, f64)>,
    numbers: Vec<f64>,
}

impl Laplacian {
    /// The factorised scalar second derivative of `energy` at `x`.
    ///
    /// # Errors
    /// A part of the body without a connection to a fixed vertex and without another restraint, or
    /// too little memory.
    pub fn new(
        energy: &Energy,
        unknowns: &Unknowns,
        x: &[Point3<f64>],
    ) -> Result<Self, FactorError> {
        let mut factor = Factor::new(
            unknowns.free.len(),
            &unknowns.pairs(|pair| energy.pairs(pair)),
        )?;
        let mut to_held = Vec::new();
        energy.scalar_hessian(
            x,
            &mut |a, b, value| match (unknowns.of(a), unknowns.of(b)) {
                (Some(i), Some(j)) if i >= j => factor.add(i, j, &[[value]]),
                (Some(i), None) => to_held.push((i, b, value)),
                _ => {}
            },
        );
        if let Some(unknown) = first_loose(unknowns, energy, &to_held) {
            return Err(FactorError::NotPositiveDefinite { unknown });
        }
        factor.factorise()?;
        let numbers = vec![0.0; unknowns.free.len() * 3 * AT_ONCE];
        Ok(Self {
            factor,
            to_held,
            numbers,
        })
    }

    /// Number of entries of the factor.
    pub fn entries(&self) -> usize {
        self.factor.entries()
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.factor.bytes() + self.to_held.capacity() * 16 + self.numbers.capacity() * 8
    }

    /// Applies the inverse to fields over all vertices, in place; entries of fixed vertices become
    /// zero.
    pub fn solve(&mut self, unknowns: &Unknowns, fields: &mut [&mut [Vector3<f64>]]) {
        fields
            .chunks_mut(AT_ONCE)
            .for_each(|fields| self.solve_at_once(unknowns, fields));
    }

    fn solve_at_once(&mut self, unknowns: &Unknowns, fields: &mut [&mut [Vector3<f64>]]) {
        let n = unknowns.free.len();
        for (f, field) in fields.iter().enumerate() {
            for (i, &v) in unknowns.free.iter().enumerate() {
                (0..3).for_each(|c| self.numbers[(3 * f + c) * n + i] = field[v as usize][c]);
            }
        }
        let columns = 3 * fields.len();
        self.factor.solve(&mut self.numbers[..columns * n], columns);
        for (f, field) in fields.iter_mut().enumerate() {
            unknowns.release_held(field);
            for (i, &v) in unknowns.free.iter().enumerate() {
                field[v as usize] = Vector3::from_fn(|c, _| self.numbers[(3 * f + c) * n + i]);
            }
        }
    }

    /// Columns of the inverse of at most six vertices, by unknown.
    pub fn columns(
        &mut self,
        unknowns: &Unknowns,
        vertices: &[u32],
    ) -> impl Iterator<Item = &[f64]> {
        let n = unknowns.free.len();
        let wanted = &mut self.numbers[..vertices.len() * n];
        wanted.fill(0.0);
        for (column, &v) in vertices.iter().enumerate() {
            if let Some(i) = unknowns.of(v) {
                wanted[column * n + i as usize] = 1.0;
            }
        }
        self.factor.solve(wanted, vertices.len());
        wanted.chunks_exact(n.max(1))
    }

    /// Computes the displacements of the unknowns with the least energy of the matrix, for given
    /// displacements of fixed vertices.
    pub fn extend(&mut self, unknowns: &Unknowns, displacement: &mut [Vector3<f64>]) {
        let mut pull = vec![Vector3::zeros(); displacement.len()];
        for &(i, held, value) in &self.to_held {
            pull[unknowns.free[i as usize] as usize] -= displacement[held as usize] * value;
        }
        self.solve(unknowns, &mut [&mut pull]);
        unknowns
            .free
            .iter()
            .for_each(|&v| displacement[v as usize] = pull[v as usize]);
    }
}
