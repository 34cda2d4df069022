//! Active contact rows of an equilibrium: the constant inverse restricted to the displacements that
//! they allow.
//!
//! With the rows N and the constant matrix A, the inverse is A^-1 - A^-1 N^T (N A^-1 N^T)^-1 N
//! A^-1: a correction for a contact spreads as smoothly as any other. The small matrix in the
//! middle needs only the entries of A^-1 between touching vertices. They never change, and each
//! vertex is solved for once.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Point3, Vector3};

use super::dense::DenseFactor;
use super::history::Field;
use super::unknowns::{Laplacian, Unknowns};
use crate::contact::ContactPlane;
use crate::state::{DecodeError, Reader, Writer};

/// Greatest number of vertices with stored entries of the inverse; further rows only act by the
/// push.
const MOST_VERTICES: usize = 4096;

/// Addition to the diagonal of the small matrix, relative to it: rows of one vertex can be
/// dependent.
pub(super) const RIDGE: f64 = 1e-9;

/// Greatest number of sweeps over the reactions of coupled rows, and the change of the last sweep
/// relative to the greatest reaction: they only choose the rows.
const SWEEPS: usize = 400;
const SETTLED: f64 = 1e-5;

/// Multiplications in about the time of a step of one vertex, of an entry of the small matrix, and of an
/// unknown for columns of the inverse.
const OF_A_STEP: usize = 128;
const ENTRY: usize = 8;
const COLUMNS: usize = 1000;

/// Entries of the constant inverse between vertices that have touched an obstacle.
#[derive(Default)]
pub struct Touched {
    place: BTreeMap<u32, usize>,
    vertices: Vec<u32>,
    /// For each vertex, the entries with all earlier vertices and itself.
    entries: Vec<Vec<f64>>,
    /// Work since the last [`Self::take_work`], in multiplications.
    multiplications: usize,
}

impl Touched {
    /// The work since the last call, in steps of a vertex: a thousand rows cost more than a trial.
    pub fn take_work(&mut self) -> usize {
        let steps = self.multiplications / OF_A_STEP;
        self.multiplications %= OF_A_STEP;
        steps
    }

    fn learn(&mut self, rows: &[ContactPlane], laplacian: &mut Laplacian, unknowns: &Unknowns) {
        let all = rows
            .iter()
            .flat_map(|row| row.terms)
            .filter(|(_, w)| *w != 0.0)
            .map(|(v, _)| v);
        let mut fresh: Vec<u32> = all
            .filter(|v| unknowns.of(*v).is_some() && !self.place.contains_key(v))
            .collect();
        fresh.sort_unstable();
        fresh.dedup();
        if self.vertices.len() + fresh.len() > MOST_VERTICES && !self.vertices.is_empty() {
            // Only what touches now is kept.
            *self = Self {
                multiplications: self.multiplications,
                ..Self::default()
            };
            return self.learn(rows, laplacian, unknowns);
        }
        fresh.truncate(MOST_VERTICES.saturating_sub(self.vertices.len()));
        for group in fresh.chunks(6) {
            self.multiplications += COLUMNS * unknowns.count();
            let columns = laplacian.columns(unknowns, group);
            for (&v, column) in group.iter().zip(columns) {
                self.place.insert(v, self.vertices.len());
                self.vertices.push(v);
                let before = self.vertices.iter().filter_map(|w| unknowns.of(*w));
                self.entries
                    .push(before.map(|w| column[w as usize]).collect());
            }
        }
    }

    /// The rows with the factor of N A^-1 N^T; rows without an unknown vertex are left out.
    pub fn hold(
        &mut self,
        mut rows: Vec<ContactPlane>,
        laplacian: &mut Laplacian,
        unknowns: &Unknowns,
    ) -> Active {
        self.learn(&rows, laplacian, unknowns);
        rows.retain(|row| self.knows(row));
        let matrix = self.matrix(&rows);
        let factor = self.factor(&matrix);
        Active { factor, rows }
    }

    /// The rows that hold against `force` [N]: those that push in the
    /// displacement of least energy of the constant matrix that no row forbids.
    pub fn press(
        &mut self,
        mut rows: Vec<ContactPlane>,
        force: &[Vector3<f64>],
        laplacian: &mut Laplacian,
        unknowns: &Unknowns,
    ) -> Active {
        self.learn(&rows, laplacian, unknowns);
        rows.retain(|row| self.knows(row));
        let matrix = self.matrix(&rows);
        let mut pull = force.to_vec();
        laplacian.solve(unknowns, &mut [&mut pull]);
        let lack: Vec<f64> = rows.iter().map(|row| -row.along(&pull)).collect();
        let (reactions, sweeps) = complementary(&matrix, &lack);
        self.multiplications += sweeps * rows.len().pow(2);
        let pushing: Vec<usize> = (0..rows.len()).filter(|&i| reactions[i] > 0.0).collect();
        let chosen = matrix.select_rows(&pushing).select_columns(&pushing);
        Active {
            rows: pushing.iter().map(|&i| rows[i]).collect(),
            factor: self.factor(&chosen),
        }
    }

    fn factor(&mut self, matrix: &DMatrix<f64>) -> Option<DenseFactor> {
        let rows = matrix.nrows();
        self.multiplications += rows.pow(3) / 6;
        DenseFactor::new(matrix)
    }

    fn knows(&self, row: &ContactPlane) -> bool {
        let mut terms = row.terms.iter().filter(|(_, w)| *w != 0.0);
        terms.any(|(v, _)| self.place.contains_key(v))
    }

    /// N A^-1 N^T.
    fn matrix(&mut self, rows: &[ContactPlane]) -> DMatrix<f64> {
        let n = rows.len();
        self.multiplications += ENTRY * n.pow(2);
        let weighed = |row: &ContactPlane| -> Vec<(usize, f64)> {
            let terms = row.terms.iter().filter(|(_, w)| *w != 0.0);
            terms
                .filter_map(|(v, w)| self.place.get(v).map(|place| (*place, *w)))
                .collect()
        };
        let terms: Vec<Vec<(usize, f64)>> = rows.iter().map(weighed).collect();
        let product = |r: usize, s: usize| {
            let mut sum = 0.0;
            for &(a, wa) in &terms[r] {
                for &(b, wb) in &terms[s] {
                    sum += wa * wb * self.entries[a.max(b)][a.min(b)];
                }
            }
            sum * rows[r].normal.dot(&rows[s].normal)
        };
        let mut matrix = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                matrix[(i, j)] = product(i, j);
                matrix[(j, i)] = matrix[(i, j)];
            }
            matrix[(i, i)] *= 1.0 + RIDGE;
        }
        matrix
    }

    /// Heap memory held [bytes].
    pub fn bytes(&self) -> usize {
        self.entries.iter().map(|e| e.capacity() * 8).sum::<usize>() + self.vertices.len() * 24
    }
}

impl Touched {
    /// Appends the state with the entries: a column of the inverse can have other bits if it is
    /// solved beside other columns.
    pub fn save(&self, to: &mut Writer) {
        let Self {
            place: _,
            vertices,
            entries,
            multiplications: _,
        } = self;
        to.list(vertices);
        entries.iter().for_each(|entries| to.list(entries));
    }

    /// Restores the state.
    pub fn restore(
        &mut self,
        from: &mut Reader<'_>,
        unknowns: &Unknowns,
    ) -> Result<(), DecodeError> {
        self.vertices = from.take()?;
        from.check(
            self.vertices.len() <= MOST_VERTICES,
            "too many vertices that touched",
        )?;
        let is_unknown = |v: &u32| (*v as usize) < unknowns.count() && unknowns.of(*v).is_some();
        from.check(
            self.vertices.iter().all(is_unknown),
            "a vertex touched that is not free",
        )?;
        self.place = self
            .vertices
            .iter()
            .enumerate()
            .map(|(place, v)| (*v, place))
            .collect();
        from.check(
            self.place.len() == self.vertices.len(),
            "a vertex that touched stands there twice",
        )?;
        // For each vertex, the entries with all earlier vertices and itself.
        self.entries = (1..=self.vertices.len())
            .map(|n| from.exactly(n))
            .collect::<Result<_, _>>()?;
        Ok(())
    }
}

/// Active rows.
#[derive(Default)]
pub struct Active {
    rows: Vec<ContactPlane>,
    factor: Option<DenseFactor>,
}

impl Active {
    /// The rows.
    pub fn rows(&self) -> &[ContactPlane] {
        &self.rows
    }

    /// Appends the state; the factor follows from the rows.
    pub fn save(&self, to: &mut Writer) {
        let Self { rows, factor: _ } = self;
        to.list(rows);
    }

    /// Restores the state of rows over `count` vertices; `touched` must contain all entries of
    /// their activation.
    pub fn restore(
        from: &mut Reader<'_>,
        touched: &mut Touched,
        laplacian: &mut Laplacian,
        unknowns: &Unknowns,
        count: usize,
    ) -> Result<Self, DecodeError> {
        let rows: Vec<ContactPlane> = from.take()?;
        let is_there = |row: &ContactPlane| row.terms.iter().all(|(v, _)| (*v as usize) < count);
        from.check(rows.iter().all(is_there), "a row of no vertex")?;
        let known = touched.vertices.len();
        let full = known >= MOST_VERTICES;
        let learnt = |v: u32| full || unknowns.of(v).is_none() || touched.place.contains_key(&v);
        let sound = rows
            .iter()
            .flat_map(|row| row.terms)
            .all(|(v, w)| w == 0.0 || learnt(v));
        from.check(sound, "a row of a vertex that never touched")?;
        let count = rows.len();
        let active = touched.hold(rows, laplacian, unknowns);
        from.check(active.rows.len() == count, "a row that cannot hold")?;
        Ok(active)
    }

    /// Applies the restricted inverse to fields, in place: no row's height changes along the
    /// result.
    pub fn solve(
        &self,
        laplacian: &mut Laplacian,
        unknowns: &Unknowns,
        fields: &mut [&mut [Vector3<f64>]],
    ) {
        laplacian.solve(unknowns, fields);
        let Some(factor) = &self.factor else { return };
        let mut pulls: Vec<Field> = fields
            .iter()
            .map(|field| {
                let along = DVector::from_iterator(
                    self.rows.len(),
                    self.rows.iter().map(|row| row.along(field)),
                );
                self.pull(&factor.solve(&along), field.len())
            })
            .collect();
        let mut all: Vec<&mut [Vector3<f64>]> = pulls.iter_mut().map(Vec::as_mut_slice).collect();
        laplacian.solve(unknowns, &mut all);
        for (field, pull) in fields.iter_mut().zip(&pulls) {
            field.iter_mut().zip(pull).for_each(|(f, p)| *f -= p);
        }
    }

    /// The smoothest displacement that brings every row of `x` to exactly its required height.
    pub fn lift(
        &self,
        x: &[Point3<f64>],
        laplacian: &mut Laplacian,
        unknowns: &Unknowns,
    ) -> Option<Field> {
        let factor = self.factor.as_ref()?;
        let lack =
            DVector::from_iterator(self.rows.len(), self.rows.iter().map(|row| -row.room(x)));
        let mut pull = self.pull(&factor.solve(&lack), x.len());
        laplacian.solve(unknowns, &mut [&mut pull]);
        Some(pull)
    }

    fn pull(&self, factors: &DVector<f64>, count: usize) -> Field {
        let mut pull = vec![Vector3::zeros(); count];
        self.rows
            .iter()
            .zip(factors.iter())
            .for_each(|(row, factor)| row.spread(*factor, &mut pull));
        pull
    }
}

/// The numbers r >= 0 with M r >= `lack`, where r is zero wherever that is not an equality: sweeps over
/// the rows of the symmetric matrix M. Also the number of sweeps.
pub(super) fn complementary(matrix: &DMatrix<f64>, lack: &[f64]) -> (Vec<f64>, usize) {
    let (mut found, mut sweeps) = (DVector::zeros(lack.len()), 0);
    for _ in 0..SWEEPS {
        sweeps += 1;
        let (mut change, mut most) = (0.0_f64, 0.0_f64);
        for i in 0..lack.len() {
            let own = matrix[(i, i)];
            if !(own > 0.0) {
                continue;
            }
            // A number that is not finite gives no reaction here, and shows in the force that is left.
            let before = found[i];
            let after = (before + (lack[i] - matrix.column(i).dot(&found)) / own).max(0.0);
            found[i] = after;
            change = change.max((after - before).abs());
            most = most.max(after);
        }
        if change <= SETTLED * most {
            break;
        }
    }
    (found.as_slice().to_vec(), sweeps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solvers::energy::{Energy, Inertia};

    #[test]
    fn the_algebra_of_rows_counts_as_work() {
        const COUNT: u32 = 80;
        let x: Vec<Point3<f64>> = (0..COUNT)
            .map(|k| Point3::new(f64::from(k), 0.0, 0.0))
            .collect();
        let inertia = Inertia {
            weight: vec![2.0; x.len()],
            target: x.clone(),
        };
        let energy = Energy {
            inertia: Some(inertia),
            ..Energy::default()
        };
        let unknowns = Unknowns::new(&vec![1.0; x.len()]);
        let mut laplacian = Laplacian::new(&energy, &unknowns, &x).expect("held by its inertia");
        let rows = |count: u32| -> Vec<ContactPlane> {
            let row = |v: u32| ContactPlane {
                terms: [1.0, 0.0, 0.0, 0.0].map(|w| (v, w)),
                normal: Vector3::z(),
                origin: Point3::origin(),
                distance: 0.1,
            };
            (0..count).map(row).collect()
        };
        let mut touched = Touched::default();
        touched.hold(rows(COUNT), &mut laplacian, &unknowns);
        let all = touched.take_work();
        assert_eq!(touched.take_work(), 0, "it is taken once");
        // The columns of the inverse are known from here on.
        touched.hold(rows(COUNT), &mut laplacian, &unknowns);
        let again = touched.take_work();
        touched.hold(rows(COUNT / 2), &mut laplacian, &unknowns);
        let half = touched.take_work();
        assert!(all > again && again > 2 * half, "{all} {again} {half}");
        touched.press(
            rows(COUNT),
            &vec![-Vector3::z(); x.len()],
            &mut laplacian,
            &unknowns,
        );
        assert!(touched.take_work() > again, "it chooses the rows as well");
        touched.hold(Vec::new(), &mut laplacian, &unknowns);
        assert_eq!(touched.take_work(), 0, "control");
    }
}
