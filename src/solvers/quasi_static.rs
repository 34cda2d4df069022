//! Equilibrium of a body by L-BFGS over a constant matrix that is factored once.
//!
//! The error of a pose is smooth, and a local solver needs thousands of sweeps for it; the energy's second derivative,
//! averaged over the directions of space and taken at rest, is a scalar matrix over a surface, cheap to factor, and its
//! inverse spreads a correction over the whole body at once \[liu2017\]. Enclosed volumes enter as rows beside
//! that matrix (Sherman-Morrison-Woodbury), and are satisfied exactly after every step.
//!
//! *Limitations.* Mass, velocities and friction play no part. A net of springs can be folded in many ways: there may be
//! several equilibria, and the one that is found is near the start.

use nalgebra::{Point3, Vector3};

use super::active::{Active, Touched};
use super::descent::{Guard, Outcome, Problem, ROUNDED, Settings, State};
use super::energy::Energy;
use super::history::{Field, History};
use super::sparse::FactorError;
use super::unknowns::Laplacian;
use crate::constraints::EnclosedVolume;
use crate::contact::ContactPlane;
use crate::state::{self, DecodeError, Reader, Writer};

/// Steps of the minimisation that are remembered: more cost more than they save.
const MEMORY: usize = 8;

/// Iterations for which the inverse of the volumes' gradients is kept: it changes little, and is half of the solves. Any
/// field that changes a volume keeps it exactly.
const KEPT: u32 = 4;

/// Iterations after which constraints that are known up to a period note where they are.
const NOTED: u32 = 8;

/// A body ready to be brought to equilibrium.
pub struct QuasiStatic {
    /// What is minimised.
    pub problem: Problem,
    laplacian: Laplacian,
    history: History,
    touched: Touched,
    active: Active,
    /// The inverse matrix times the volumes' gradients, and the iterations since they were computed.
    spreads: (Vec<Field>, u32),
    /// The pressure in each volume [Pa].
    pub pressures: Vec<f64>,
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
        Ok(Self {
            problem,
            laplacian,
            history: History::new(MEMORY),
            touched,
            active,
            spreads: (Vec::new(), 0),
            pressures: Vec::new(),
        })
    }

    /// Entries of the factored matrix.
    pub fn entries(&self) -> usize {
        self.laplacian.entries()
    }

    /// Heap memory held by the matrix and what was learnt [bytes].
    pub fn bytes(&self) -> usize {
        self.laplacian.bytes() + self.history.bytes() + self.touched.bytes()
    }

    /// Moves held vertices to `held` and carries the others along smoothly, then keeps volumes and obstacles.
    pub fn follow(
        &mut self,
        x: &mut [Point3<f64>],
        held: &[(u32, Point3<f64>)],
        guard: &mut impl Guard,
    ) {
        let mut displacement = vec![Vector3::zeros(); x.len()];
        held.iter()
            .for_each(|&(v, to)| displacement[v as usize] = to - x[v as usize]);
        if displacement.iter().all(|d| *d == Vector3::zeros()) {
            return;
        }
        let start = x.to_vec();
        if let Some(inertia) = &self.problem.energy.inertia {
            // With inertia, a vertex flies on unless something holds it.
            let flown = x.iter_mut().zip(&mut displacement).zip(&inertia.target);
            flown.for_each(|((x, d), target)| (*d, *x) = (*d - (target - *x), *target));
        }
        self.laplacian
            .extend(&self.problem.unknowns, &mut displacement);
        x.iter_mut().zip(&displacement).for_each(|(x, d)| *x += d);
        // Exactly, and not by what the addition rounds to.
        held.iter().for_each(|&(v, to)| x[v as usize] = to);
        if !self.active.rows().is_empty() {
            self.active = Active::default();
            self.spreads.0.clear();
        }
        self.stay_over(&guard.rows(), x);
        guard.push(&start, x);
        self.keep_volumes(x);
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
        let mut outcome = Outcome {
            evaluations: 1,
            ..Outcome::default()
        };
        self.keep_volumes(x);
        let mut state = self.problem.state(x);
        let mut multipliers = self.problem.first_multipliers(&state);
        loop {
            let rows = guard.rows();
            let pressed = self
                .problem
                .pressed(x, &state, &multipliers, &rows, guard.touching());
            if pressed != self.active.rows() {
                self.active =
                    self.touched
                        .hold(pressed, &mut self.laplacian, &self.problem.unknowns);
                self.spreads.0.clear();
            }
            let last = outcome.iterations >= self.problem.settings.iterations;
            let direction;
            (direction, multipliers) = match last && self.active.rows().is_empty() {
                // Nothing goes along it any more; the least force by which the volumes' multipliers can be told needs none.
                true => (Field::new(), self.problem.first_multipliers(&state)),
                false => self.direction(&state),
            };
            self.problem
                .judge(&state, &multipliers, self.active.rows(), &mut outcome);
            self.pressures = self.problem.pressures(&state, &multipliers);
            let more = watch(&outcome, x);
            if outcome.converged || last || !more {
                self.problem.energy.remember(x);
                return outcome;
            }
            let Some((end, new)) = self.search(x, &state, &direction, &rows, guard, &mut outcome)
            else {
                if self.history.is_empty() {
                    return outcome;
                }
                // What was remembered misled it: once more from the constant matrix alone.
                self.history.clear();
                self.spreads.0.clear();
                continue;
            };
            outcome.iterations += 1;
            self.learn(x, &end, &state, &new, &multipliers);
            x.copy_from_slice(&end);
            // An angle turns by far less than a period between two notes.
            if outcome.iterations.is_multiple_of(NOTED) {
                self.problem.energy.remember(x);
            }
            guard.accept(x);
            state = new;
        }
    }

    /// Notes a step and how the gradient of the Lagrangian changed over it, at the same multipliers.
    fn learn(
        &mut self,
        x: &[Point3<f64>],
        end: &[Point3<f64>],
        old: &State,
        new: &State,
        multipliers: &[f64],
    ) {
        let step: Field = end.iter().zip(x).map(|(end, x)| end - x).collect();
        let mut change: Field = new
            .gradient
            .iter()
            .zip(&old.gradient)
            .map(|(new, old)| new - old)
            .collect();
        for (multiplier, (new, old)) in multipliers.iter().zip(new.areas.iter().zip(&old.areas)) {
            let areas = change.iter_mut().zip(new.iter().zip(old));
            areas.for_each(|(c, (new, old))| *c += (new - old) * *multiplier);
        }
        self.history.note(step, change);
    }

    fn direction(&mut self, state: &State) -> (Field, Vec<f64>) {
        let Self {
            problem,
            laplacian,
            history,
            active,
            spreads: (spreads, age),
            ..
        } = self;
        let invert = |laplacian: &mut Laplacian, fields: &mut [&mut [Vector3<f64>]]| {
            history.apply(fields, |fields| {
                active.solve(laplacian, &problem.unknowns, fields)
            });
        };
        let mut pull: Field = state.gradient.iter().map(|g| -g).collect();
        if state.areas.is_empty() || (*age < KEPT && !spreads.is_empty()) {
            invert(laplacian, &mut [&mut pull]);
            *age += 1;
        } else {
            spreads.clone_from(&state.areas);
            let mut fields: Vec<&mut [Vector3<f64>]> = [&mut pull]
                .into_iter()
                .chain(spreads.iter_mut())
                .map(Vec::as_mut_slice)
                .collect();
            invert(laplacian, &mut fields);
            *age = 0;
        }
        problem.direction(state, pull, spreads)
    }

    fn search(
        &mut self,
        x: &[Point3<f64>],
        state: &State,
        direction: &[Vector3<f64>],
        rows: &[ContactPlane],
        guard: &mut impl Guard,
        outcome: &mut Outcome,
    ) -> Option<(Vec<Point3<f64>>, State)> {
        let Self {
            problem,
            laplacian,
            touched,
            active,
            spreads: (spreads, _),
            ..
        } = self;
        problem.search(x, state, direction, outcome, |end| {
            lift(problem, laplacian, touched, active, rows, end);
            guard.push(x, end);
            problem.keep_volumes(end, spreads)
        })
    }

    fn stay_over(&mut self, rows: &[ContactPlane], x: &mut [Point3<f64>]) {
        lift(
            &self.problem,
            &mut self.laplacian,
            &mut self.touched,
            &self.active,
            rows,
            x,
        );
    }

    /// Brings volumes without compliance to their targets, by the smoothest fields that do it.
    fn keep_volumes(&mut self, x: &mut [Point3<f64>]) {
        let volumes = &self.problem.energy.volumes;
        let (excess, mut areas): (Vec<f64>, Vec<Field>) =
            volumes.iter().map(|v| v.value_and_gradient(x)).unzip();
        // Any smooth fields do, and these are at hand; to rounding volumes hold already after `follow`.
        let off = |(excess, volume): (&f64, &EnclosedVolume)| {
            !(excess.abs() <= ROUNDED * volume.target().abs())
        };
        if !excess.iter().zip(volumes).any(off)
            || (!self.spreads.0.is_empty() && self.problem.keep_volumes(x, &self.spreads.0))
        {
            return;
        }
        let mut fields: Vec<&mut [Vector3<f64>]> =
            areas.iter_mut().map(Vec::as_mut_slice).collect();
        self.active
            .solve(&mut self.laplacian, &self.problem.unknowns, &mut fields);
        self.problem.keep_volumes(x, &areas);
    }
}

impl state::State for QuasiStatic {
    fn save(&self, to: &mut Writer) {
        let Self {
            problem,
            laplacian: _,
            history,
            touched,
            active,
            spreads: (spreads, age),
            pressures: _,
        } = self;
        let Problem {
            energy,
            settings: _,
            unknowns: _,
            force_scale: _,
        } = problem;
        energy.save(to);
        history.save(to);
        touched.save(to);
        active.save(to);
        to.list(&spreads.concat());
        to.put(age);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        let Self {
            problem,
            laplacian,
            history,
            touched,
            active,
            spreads: (spreads, age),
            pressures: _,
        } = self;
        let count = problem.unknowns.count();
        problem.energy.restore(from)?;
        history.restore(from, count)?;
        touched.restore(from, &problem.unknowns)?;
        *active = Active::restore(from, touched, laplacian, &problem.unknowns, count)?;
        let all: Field = from.take()?;
        let volumes = problem.energy.volumes.len();
        from.check(
            all.is_empty() || all.len() == count * volumes,
            "a field over another body",
        )?;
        *spreads = all.chunks(count.max(1)).map(<[_]>::to_vec).collect();
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
    rows: &[ContactPlane],
    x: &mut [Point3<f64>],
) {
    let mut all: Vec<ContactPlane> = rows
        .iter()
        .filter(|row| row.room(x) < 0.0)
        .copied()
        .collect();
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
