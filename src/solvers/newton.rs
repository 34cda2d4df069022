//! Equilibrium by Newton's method with a sparse factor of the whole second derivative: the
//! reference for the others.
//!
//! A positive definite second derivative is used as it is. Otherwise each constraint's part is
//! replaced by its positive semi-definite part (projection on demand \[longva2023\]).
//!
//! Obstacles and other parts that touch are linear inequalities of the step, so that each step is the
//! minimum of a quadratic energy over them. A row of the inequalities joins as soon as the step would
//! break it, and needs a solution with the factor.
//!
//! *Limitations.* The second derivative has no curvature of obstacles: where they are curved, the force
//! falls by a constant factor in each step. Of several equilibria it finds one near the start. A factor
//! of 3 unknowns per vertex takes some hundred times the memory of the constant one of
//! [`super::quasi_static`].

use nalgebra::{DMatrix, DVector, Matrix3, Point3, Vector3};

use super::active::{RIDGE, complementary};
use super::dense::DenseFactor;
use super::descent::{ContactFilter, DescentOutcome, DescentProblem, DescentSettings, State};
use super::energy::Energy;
use super::history::{Field, add_scaled};
use super::sparse::{Factor, FactorError};
use crate::contact::ContactPlane;
use crate::rest::{Relax, relax};

/// Shifts of the diagonal that are tried if even the projected matrix has no factor, relative to
/// its mean entry.
const SHIFTS: [f64; 4] = [1e-10, 1e-6, 1e-3, 1.0];

/// Number of fields to which the inverse is applied at once.
const AT_ONCE: usize = 2;

/// Greatest number of times that rows which a step would break join it.
const JOINING: usize = 16;

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
        contact: &mut impl ContactFilter,
        mut watch: impl FnMut(&DescentOutcome, &[Point3<f64>]) -> bool,
    ) -> Result<DescentOutcome, FactorError> {
        let before = x.to_vec();
        contact.push(&before, x);
        self.keep_volumes(x)?;
        if contact.hold(x).is_none() {
            contact.hold_all(x);
        }
        contact.accept(x);
        let state = self.problem.state(x);
        let multipliers = self.problem.first_multipliers(&state);
        let limit = self.problem.settings.iterations as usize;
        let mut descent = Descent {
            solver: self,
            x,
            contact,
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
    pub(super) fn invert<'a>(&mut self, fields: impl Iterator<Item = &'a mut Field>) {
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

    /// The step to the minimum of the quadratic energy over `rows` at `x`, and the multipliers of the
    /// volumes; `pull` and `spreads` are those of [`DescentProblem::direction`].
    fn step_over(
        &mut self,
        x: &[Point3<f64>],
        state: &State,
        pull: &Field,
        spreads: &[Field],
        mut rows: Vec<ContactPlane>,
    ) -> (Field, Vec<f64>) {
        let mut step = self.problem.direction(state, pull.clone(), spreads);
        let free = step.0.clone();
        let mut joined: Vec<Joined> = Vec::new();
        for _ in 0..JOINING {
            let is_broken = |row: &ContactPlane| row.room(x) + row.along(&step.0) < 0.0;
            let (broken, others): (Vec<_>, Vec<_>) = rows.into_iter().partition(is_broken);
            if broken.is_empty() {
                break;
            }
            rows = others;
            let before = joined.len();
            joined.extend(broken.into_iter().map(|row| {
                let mut pull = vec![Vector3::zeros(); x.len()];
                row.spread(1.0, &mut pull);
                Joined {
                    row,
                    moves: Field::new(),
                    pull,
                }
            }));
            self.invert(joined[before..].iter_mut().map(|joined| &mut joined.pull));
            for joined in &mut joined[before..] {
                joined.moves = self.problem.keeping(state, joined.pull.clone(), spreads);
            }
            let reactions = reactions(&joined, x, &free);
            let mut pressed = pull.clone();
            for (joined, reaction) in joined.iter().zip(&reactions) {
                add_scaled(&mut pressed, *reaction, &joined.pull);
            }
            step = self.problem.direction(state, pressed, spreads);
        }
        step
    }

    /// Factorises the second derivative, projected or shifted if necessary.
    pub(super) fn factorise(
        &mut self,
        x: &[Point3<f64>],
        pressures: &[f64],
    ) -> Result<(), FactorError> {
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

/// A row that a step would break.
struct Joined {
    row: ContactPlane,
    /// The displacement by a unit force of the row, and the same with the volumes kept.
    pull: Field,
    moves: Field,
}

/// The reactions of rows [N] that keep the displacement `free` over them at `x`: none pulls.
fn reactions(joined: &[Joined], x: &[Point3<f64>], free: &[Vector3<f64>]) -> Vec<f64> {
    let n = joined.len();
    let mut matrix = DMatrix::from_fn(n, n, |i, j| joined[i].row.along(&joined[j].moves));
    let own = matrix.diagonal();
    let lack: Vec<f64> = joined
        .iter()
        .map(|joined| -(joined.row.room(x) + joined.row.along(free)))
        .collect();
    let ridged = own.map(|own| own * (1.0 + RIDGE));
    matrix.set_diagonal(&ridged);
    let (mut found, _) = complementary(&matrix, &lack);
    // The sweeps choose the rows; these then hold exactly.
    let pushing: Vec<usize> = (0..n).filter(|&i| found[i] > 0.0).collect();
    let chosen = matrix.select_rows(&pushing).select_columns(&pushing);
    let mut exact = chosen.clone();
    exact.set_diagonal(&own.select_rows(&pushing));
    if let Some(factor) = DenseFactor::new(&exact).or_else(|| DenseFactor::new(&chosen)) {
        let right = DVector::from_iterator(pushing.len(), pushing.iter().map(|&i| lack[i]));
        let exact = factor.solve(&right);
        let each = pushing.iter().zip(exact.iter());
        each.for_each(|(&i, exact)| found[i] = exact.max(0.0));
    }
    found
}

/// A body on its way to equilibrium.
struct Descent<'a, G> {
    solver: &'a mut Newton,
    x: &'a mut [Point3<f64>],
    contact: &'a mut G,
    state: State,
    multipliers: Vec<f64>,
    outcome: DescentOutcome,
}

impl<G: ContactFilter> Relax for Descent<'_, G> {
    type Error = FactorError;

    fn judge(&mut self) -> Result<bool, FactorError> {
        let problem = &self.solver.problem;
        let touching = self.contact.touching();
        let mut rows = self.contact.planes();
        rows.retain(|row| row.room(self.x) <= touching);
        let support = |force: &mut Field| problem.support_together(&rows, force);
        problem.judge(&self.state, &self.multipliers, support, &mut self.outcome);
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
            contact,
            state,
            multipliers,
            outcome,
        } = self;
        let pressures: Vec<f64> = multipliers.iter().map(|m| -m).collect();
        solver.factorise(x, &pressures)?;
        let mut pull: Field = state.gradient.iter().map(|g| -g).collect();
        let mut spreads = state.areas.clone();
        solver.invert([&mut pull].into_iter().chain(&mut spreads));
        let direction;
        let mut rows = contact.planes();
        let is_free = |(v, w): &(u32, f64)| *w != 0.0 && solver.problem.unknowns.of(*v).is_some();
        rows.retain(|row| row.terms.iter().any(is_free));
        (direction, *multipliers) = solver.step_over(x, state, &pull, &spreads, rows);
        let problem = &solver.problem;
        let complete = |end: &mut [Point3<f64>]| problem.complete_trial(x, end, &spreads, *contact);
        let Some((end, new)) =
            problem.search(x, (state, multipliers), &direction, outcome, complete)
        else {
            return Ok(false);
        };
        outcome.iterations += 1;
        x.copy_from_slice(&end);
        solver.problem.energy.remember(x);
        contact.accept(x);
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
