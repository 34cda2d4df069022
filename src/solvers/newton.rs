//! Equilibrium by Newton's method with a sparse factor of the whole second derivative: the
//! reference for the others.
//!
//! A positive definite second derivative is used as it is. Otherwise each constraint's part is
//! replaced by its positive semi-definite part (projection on demand \[longva2023\]).
//!
//! *Limitations.* The method has no obstacles: with them, [`super::quasi_static`] to a small force
//! is the reference. Of several equilibria it finds one near the start. A factor of 3 unknowns per
//! vertex takes some hundred times the memory of the constant one of [`super::quasi_static`].

use nalgebra::{Matrix3, Point3, Vector3};

use super::descent::{DescentOutcome, DescentProblem, DescentSettings, State};
use super::energy::Energy;
use super::history::Field;
use super::sparse::{Factor, FactorError};
use crate::rest::{Relax, relax};

/// Shifts of the diagonal that are tried if even the projected matrix has no factor, relative to
/// its mean entry.
const SHIFTS: [f64; 4] = [1e-10, 1e-6, 1e-3, 1.0];

/// Number of fields to which the inverse is applied at once.
const AT_ONCE: usize = 2;

/// A body prepared for the search of its equilibrium.
pub struct Newton {
    /// The minimised problem.
    pub problem: DescentProblem,
    factor: Factor<3>,
    numbers: Vec<f64>,
    /// The pressure in each volume [Pa].
    pub pressures: Vec<f64>,
    /// Number of factorisations.
    pub factorisations: u64,
    /// Number of factorisations of projected matrices.
    pub projections: u64,
}

impl Newton {
    /// Prepares a body; vertices without inverse mass are fixed.
    ///
    /// # Errors
    /// Too little memory for the factor.
    pub fn new(
        energy: Energy,
        x: &[Point3<f64>],
        inverse_mass: &[f64],
        settings: DescentSettings,
    ) -> Result<Self, FactorError> {
        let problem = DescentProblem::new(energy, x, inverse_mass, settings);
        let unknowns = &problem.unknowns;
        let factor = Factor::new(
            unknowns.free.len(),
            &unknowns.pairs(|pair| problem.energy.pairs(pair)),
        )?;
        let numbers = vec![0.0; unknowns.free.len() * 3 * AT_ONCE];
        Ok(Self {
            problem,
            factor,
            numbers,
            pressures: Vec::new(),
            factorisations: 0,
            projections: 0,
        })
    }

    /// Sets another energy over the same vertices. The scale of forces is unchanged; the order of
    /// elimination is reused if it covers all pairs of the new energy.
    ///
    /// # Errors
    /// Too little memory for the factor.
    pub fn renew(&mut self, energy: Energy) -> Result<(), FactorError> {
        self.problem.energy = energy;
        let unknowns = &self.problem.unknowns;
        let pairs = unknowns.pairs(|pair| self.problem.energy.pairs(pair));
        if !self.factor.covers(&pairs) {
            self.factor = Factor::new(unknowns.free.len(), &pairs)?;
        }
        Ok(())
    }

    /// Number of entries of the factor.
    pub fn entries(&self) -> usize {
        self.factor.entries()
    }

    /// Brings the free vertices to equilibrium; `watch` sees every iteration and stops the solution
    /// by returning false.
    ///
    /// # Errors
    /// The second derivative is singular even after shifts: a part moves freely.
    pub fn solve(
        &mut self,
        x: &mut [Point3<f64>],
        mut watch: impl FnMut(&DescentOutcome, &[Point3<f64>]) -> bool,
    ) -> Result<DescentOutcome, FactorError> {
        self.keep_volumes(x)?;
        let state = self.problem.state(x);
        let multipliers = self.problem.first_multipliers(&state);
        let limit = self.problem.settings.iterations as usize;
        let mut descent = Descent {
            solver: self,
            x,
            state,
            multipliers,
            outcome: DescentOutcome {
                evaluations: 1,
                ..DescentOutcome::default()
            },
        };
        relax(&mut descent, limit, |now| watch(&now.outcome, now.x))?;
        Ok(descent.outcome)
    }

    /// Brings volumes without compliance to their targets along the fields of least energy; the
    /// line search then starts with correct volumes.
    fn keep_volumes(&mut self, x: &mut [Point3<f64>]) -> Result<(), FactorError> {
        if self.problem.volumes_kept(x) {
            return Ok(());
        }
        let volumes = &self.problem.energy.volumes;
        let mut areas: Vec<Field> = volumes.iter().map(|v| v.value_and_gradient(x).1).collect();
        let none = vec![0.0; areas.len()];
        self.factorise(x, &none)?;
        self.invert(areas.iter_mut());
        self.problem.keep_volumes(x, &areas);
        Ok(())
    }

    /// Applies the inverse to fields, in place.
    fn invert<'a>(&mut self, fields: impl Iterator<Item = &'a mut Field>) {
        let Self {
            problem,
            factor,
            numbers,
            ..
        } = self;
        let mut fields: Vec<&mut [Vector3<f64>]> = fields.map(Vec::as_mut_slice).collect();
        fields
            .chunks_mut(AT_ONCE)
            .for_each(|fields| invert(problem, factor, numbers, fields));
    }

    /// Factorises the second derivative, projected or shifted if necessary.
    fn factorise(&mut self, x: &[Point3<f64>], pressures: &[f64]) -> Result<(), FactorError> {
        let mut last = FactorError::NotPositiveDefinite { unknown: 0 };
        for (attempt, shift) in [0.0, 0.0].into_iter().chain(SHIFTS).enumerate() {
            // A shift adds to the matrix of the last attempt.
            if attempt < 2 {
                self.assemble(x, pressures, attempt > 0);
            }
            let mean = self.factor.trace() / (3 * self.factor.count().max(1)) as f64;
            (0..self.factor.count() as u32).for_each(|i| self.factor.add_diagonal(i, shift * mean));
            self.factorisations += 1;
            self.projections += u64::from(attempt > 0);
            match self.factor.factorise() {
                Ok(()) => return Ok(()),
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    fn assemble(&mut self, x: &[Point3<f64>], pressures: &[f64], convex: bool) {
        let Self {
            problem, factor, ..
        } = self;
        factor.clear();
        problem
            .energy
            .hessian(x, pressures, convex, &mut |a, b, block| {
                if let (Some(i), Some(j)) = (problem.unknowns.of(a), problem.unknowns.of(b))
                    && i >= j
                {
                    factor.add(i, j, &columns(block));
                }
            });
    }
}

/// A body on its way to equilibrium.
struct Descent<'a> {
    solver: &'a mut Newton,
    x: &'a mut [Point3<f64>],
    state: State,
    multipliers: Vec<f64>,
    outcome: DescentOutcome,
}

impl Relax for Descent<'_> {
    type Error = FactorError;

    fn judge(&mut self) -> Result<bool, FactorError> {
        let problem = &self.solver.problem;
        problem.judge(&self.state, &self.multipliers, |_| (), &mut self.outcome);
        self.solver.pressures = problem.pressures(&self.state, &self.multipliers);
        Ok(self.outcome.converged)
    }

    fn steps(&self) -> usize {
        self.outcome.iterations as usize
    }

    fn advance(&mut self) -> Result<bool, FactorError> {
        let Self {
            solver,
            x,
            state,
            multipliers,
            outcome,
        } = self;
        let pressures: Vec<f64> = multipliers.iter().map(|m| -m).collect();
        solver.factorise(x, &pressures)?;
        let mut pull: Field = state.gradient.iter().map(|g| -g).collect();
        let mut spreads = state.areas.clone();
        solver.invert([&mut pull].into_iter().chain(&mut spreads));
        let problem = &solver.problem;
        let direction;
        (direction, *multipliers) = problem.direction(state, pull, &spreads);
        let complete = |end: &mut [Point3<f64>]| problem.keep_volumes(end, &spreads);
        let Some((end, new)) =
            problem.search(x, (state, multipliers), &direction, outcome, complete)
        else {
            return Ok(false);
        };
        outcome.iterations += 1;
        x.copy_from_slice(&end);
        solver.problem.energy.remember(x);
        *state = new;
        Ok(true)
    }
}

fn columns(block: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|c| std::array::from_fn(|r| block[(r, c)]))
}

/// Applies the inverse to fields, in place.
fn invert(
    problem: &DescentProblem,
    factor: &mut Factor<3>,
    numbers: &mut [f64],
    fields: &mut [&mut [Vector3<f64>]],
) {
    let free = &problem.unknowns.free;
    let n = 3 * free.len();
    for (f, field) in fields.iter().enumerate() {
        for (i, &v) in free.iter().enumerate() {
            (0..3).for_each(|c| numbers[f * n + 3 * i + c] = field[v as usize][c]);
        }
    }
    factor.solve(&mut numbers[..fields.len() * n], fields.len());
    for (f, field) in fields.iter_mut().enumerate() {
        problem.unknowns.release_held(field);
        for (i, &v) in free.iter().enumerate() {
            field[v as usize] = Vector3::from_fn(|c, _| numbers[f * n + 3 * i + c]);
        }
    }
}
