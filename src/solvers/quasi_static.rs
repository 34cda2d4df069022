//! Equilibrium of a body by L-BFGS over a constant matrix that is factored once.
//!
//! The error of a pose is smooth, and a local solver needs thousands of sweeps for it; the energy's second derivative,
//! averaged over the directions of space and taken at rest, is a scalar matrix over a surface, cheap to factor, and its
//! inverse spreads a correction over the whole body at once \[liu2017\]. The enclosed volume enters as one row beside
//! that matrix (Sherman-Morrison), and is satisfied exactly after every step.
//!
//! *Limitations.* Mass, velocities and friction play no part. A net of springs can be folded in many ways: there may be
//! several equilibria, and the one that is found is near the start.

use nalgebra::{Point3, Vector3};

use super::active::{Active, Touched};
use super::descent::{Guard, Outcome, Problem, Settings, State};
use super::energy::Energy;
use super::history::{Field, History};
use super::sparse::FactorError;
use super::unknowns::Laplacian;
use crate::contact::Row;
use crate::state::{self, Corrupt, Reader, Writer};

/// Steps of the minimisation that are remembered: more cost more than they save.
const MEMORY: usize = 8;

/// Iterations for which the inverse of the volume's gradient is kept: it changes little, and is half of the solves. Any
/// field that changes the volume keeps it exactly.
const KEPT: u32 = 4;

/// Iterations after which constraints that are known up to a period note where they are.
const NOTED: u32 = 8;

/// A volume that is off by less than this share of its target is off by rounding.
const ROUNDED: f64 = 64.0 * f64::EPSILON;

/// A body ready to be brought to equilibrium.
pub struct QuasiStatic {
    /// What is minimised.
    pub problem: Problem,
    laplacian: Laplacian,
    history: History,
    touched: Touched,
    active: Active,
    /// The inverse matrix times the volume's gradient, and the iterations since it was computed.
    spread: (Field, u32),
}

impl QuasiStatic {
    /// Prepares a body that rests at `x`; vertices without inverse mass are held.
    ///
    /// # Errors
    /// A part of the body that nothing holds; no memory.
    pub fn new(
        energy: Energy,
        x: &[Point3<f64>],
        inverse_mass: &[f64],
        settings: Settings,
    ) -> Result<Self, FactorError> {
        let problem = Problem::new(energy, x, inverse_mass, settings);
        let laplacian = Laplacian::new(&problem.energy, &problem.unknowns, x)?;
        let (touched, active) = (Touched::default(), Active::default());
        Ok(Self { problem, laplacian, history: History::new(MEMORY), touched, active, spread: (Field::new(), 0) })
    }

    /// Entries of the factored matrix.
    pub fn entries(&self) -> usize {
        self.laplacian.entries()
    }

    /// Heap memory held by the matrix and what was learnt [bytes].
    pub fn bytes(&self) -> usize {
        self.laplacian.bytes() + self.history.bytes() + self.touched.bytes()
    }

    /// Moves held vertices to `held` and carries the others along smoothly, then keeps volume and obstacles.
    pub fn follow(&mut self, x: &mut [Point3<f64>], held: &[(u32, Point3<f64>)], guard: &mut impl Guard) {
        let mut displacement = vec![Vector3::zeros(); x.len()];
        held.iter().for_each(|&(v, to)| displacement[v as usize] = to - x[v as usize]);
        if displacement.iter().all(|d| *d == Vector3::zeros()) {
            return;
        }
        let start = x.to_vec();
        if let Some(inertia) = &self.problem.energy.inertia {
            // With inertia, a vertex flies on unless something holds it.
            let flown = x.iter_mut().zip(&mut displacement).zip(&inertia.target);
            flown.for_each(|((x, d), target)| (*d, *x) = (*d - (target - *x), *target));
        }
        self.laplacian.extend(&self.problem.unknowns, &mut displacement);
        x.iter_mut().zip(&displacement).for_each(|(x, d)| *x += d);
        // Exactly, and not by what the addition rounds to.
        held.iter().for_each(|&(v, to)| x[v as usize] = to);
        if !self.active.rows().is_empty() {
            self.active = Active::default();
            self.spread.0.clear();
        }
        self.stay_over(&guard.rows(), x);
        guard.push(&start, x);
        self.keep_volume(x);
        guard.accept(x);
        self.problem.energy.remember(x);
    }

    /// Brings the free vertices to equilibrium; `watch` sees every iteration and says whether to go on.
    pub fn solve(
        &mut self,
        x: &mut [Point3<f64>],
        guard: &mut impl Guard,
        mut watch: impl FnMut(&Outcome, &[Point3<f64>]) -> bool,
    ) -> Outcome {
        let mut outcome = Outcome { evaluations: 1, ..Outcome::default() };
        self.keep_volume(x);
        let mut state = self.problem.state(x);
        let mut multiplier = self.problem.first_multiplier(&state);
        loop {
            let rows = guard.rows();
            let pressed = self.problem.pressed(x, &state, multiplier, &rows, guard.touching());
            if pressed != self.active.rows() {
                self.active = self.touched.hold(pressed, &mut self.laplacian, &self.problem.unknowns);
                self.spread.0.clear();
            }
            let last = outcome.iterations >= self.problem.settings.iterations;
            let direction;
            (direction, multiplier) = match last && self.active.rows().is_empty() {
                // Nothing goes along it any more; the least force by which the volume's multiplier can be told needs none.
                true => (Field::new(), self.problem.first_multiplier(&state)),
                false => self.direction(&state),
            };
            self.problem.judge(&state, multiplier, self.active.rows(), &mut outcome);
            let more = watch(&outcome, x);
            if outcome.converged || last || !more {
                self.problem.energy.remember(x);
                return outcome;
            }
            let Some((end, new)) = self.search(x, &state, &direction, &rows, guard, &mut outcome) else {
                if self.history.is_empty() {
                    return outcome;
                }
                // What was remembered misled it: once more from the constant matrix alone.
                self.history.clear();
                self.spread.0.clear();
                continue;
            };
            outcome.iterations += 1;
            self.learn(x, &end, &state, &new, multiplier);
            x.copy_from_slice(&end);
            // An angle turns by far less than a period between two notes.
            if outcome.iterations.is_multiple_of(NOTED) {
                self.problem.energy.remember(x);
            }
            guard.accept(x);
            state = new;
        }
    }

    /// Notes a step and how the gradient of the Lagrangian changed over it, at one multiplier.
    fn learn(&mut self, x: &[Point3<f64>], end: &[Point3<f64>], old: &State, new: &State, multiplier: f64) {
        let step: Field = end.iter().zip(x).map(|(end, x)| end - x).collect();
        let mut change: Field = new.gradient.iter().zip(&old.gradient).map(|(new, old)| new - old).collect();
        let areas = change.iter_mut().zip(new.area.iter().zip(&old.area));
        areas.for_each(|(c, (new, old))| *c += (new - old) * multiplier);
        self.history.note(step, change);
    }

    fn direction(&mut self, state: &State) -> (Field, f64) {
        let Self { problem, laplacian, history, active, spread: (spread, age), .. } = self;
        let invert = |laplacian: &mut Laplacian, fields: &mut [&mut [Vector3<f64>]]| {
            history.apply(fields, |fields| active.solve(laplacian, &problem.unknowns, fields));
        };
        let mut pull: Field = state.gradient.iter().map(|g| -g).collect();
        if state.area.is_empty() || (*age < KEPT && !spread.is_empty()) {
            invert(laplacian, &mut [&mut pull]);
            *age += 1;
        } else {
            spread.clone_from(&state.area);
            invert(laplacian, &mut [&mut pull, spread]);
            *age = 0;
        }
        problem.direction(state, pull, spread)
    }

    fn search(
        &mut self,
        x: &[Point3<f64>],
        state: &State,
        direction: &[Vector3<f64>],
        rows: &[Row],
        guard: &mut impl Guard,
        outcome: &mut Outcome,
    ) -> Option<(Vec<Point3<f64>>, State)> {
        let Self { problem, laplacian, touched, active, spread: (spread, _), .. } = self;
        problem.search(x, state, direction, outcome, |end| {
            lift(problem, laplacian, touched, active, rows, end);
            guard.push(x, end);
            problem.keep_volume(end, spread)
        })
    }

    fn stay_over(&mut self, rows: &[Row], x: &mut [Point3<f64>]) {
        lift(&self.problem, &mut self.laplacian, &mut self.touched, &self.active, rows, x);
    }

    /// Brings a volume without compliance to its target, by the smoothest field that does it.
    fn keep_volume(&mut self, x: &mut [Point3<f64>]) {
        let Some(volume) = &self.problem.energy.volume else { return };
        let (excess, mut field) = volume.value_and_gradient(x);
        // Any smooth field does, and this one is at hand; to rounding it holds already after `follow`.
        if excess.abs() <= ROUNDED * volume.target().abs()
            || (!self.spread.0.is_empty() && self.problem.keep_volume(x, &self.spread.0))
        {
            return;
        }
        self.active.solve(&mut self.laplacian, &self.problem.unknowns, &mut [&mut field]);
        self.problem.keep_volume(x, &field);
    }
}

impl state::State for QuasiStatic {
    fn save(&self, to: &mut Writer) {
        let Self { problem, laplacian: _, history, touched, active, spread: (spread, age) } = self;
        let Problem { energy, settings: _, unknowns: _, force_scale: _ } = problem;
        energy.save(to);
        history.save(to);
        touched.save(to);
        active.save(to);
        to.list(spread);
        to.put(age);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), Corrupt> {
        let Self { problem, laplacian, history, touched, active, spread: (spread, age) } = self;
        let count = problem.unknowns.count();
        problem.energy.restore(from)?;
        history.restore(from, count)?;
        touched.restore(from, &problem.unknowns)?;
        *active = Active::restore(from, touched, laplacian, &problem.unknowns, count)?;
        *spread = from.take()?;
        from.check(spread.is_empty() || spread.len() == count, "a field over another body")?;
        *age = from.take()?;
        Ok(())
    }
}

/// Lifts `x` smoothly over the rows that it went under.
fn lift(
    problem: &Problem,
    laplacian: &mut Laplacian,
    touched: &mut Touched,
    active: &Active,
    rows: &[Row],
    x: &mut [Point3<f64>],
) {
    let mut all: Vec<Row> = rows.iter().filter(|row| row.room(x) < 0.0).copied().collect();
    if all.is_empty() {
        return;
    }
    // Those that hold must go on holding.
    all.extend(active.rows().iter().filter(|row| row.room(x) >= 0.0));
    let over = touched.hold(all, laplacian, &problem.unknowns);
    if let Some(lift) = over.lift(x, laplacian, &problem.unknowns) {
        x.iter_mut().zip(&lift).for_each(|(x, d)| *x += d);
    }
}
