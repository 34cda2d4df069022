//! Equilibrium of a body by L-BFGS over a constant matrix with one factorisation.
//!
//! The error of a pose is smooth, and a local solver needs thousands of sweeps for it. The energy's
//! second derivative, averaged over the directions of space and taken at rest, is a scalar matrix
//! over a surface with a cheap factorisation. Its inverse spreads a correction over the whole body
//! at once \[liu2017\]. Enclosed volumes enter as rows beside that matrix
//! (Sherman-Morrison-Woodbury), and are satisfied exactly after every step.
//!
//! *Limitations.* Mass, velocities and friction have no effect. A net of springs can fold in
//! different states: several equilibria can exist, and the solver finds one near the start.

use std::convert::Infallible;

use nalgebra::{Point3, Vector3};

use super::active::{Active, Touched};
use super::descent::{
    ContactFilter, DescentOutcome, DescentProblem, DescentSettings, KEEPING, ROUNDED, State,
};
use super::energy::Energy;
use super::history::{Field, History};
use super::sparse::FactorError;
use super::unknowns::Laplacian;
use crate::constraints::EnclosedVolume;
use crate::contact::ContactPlane;
use crate::mesh::measures::max_or_nan;
use crate::rest::{End, Relax, relax};
use crate::state::{self, DecodeError, Reader, Writer};

/// Number of stored steps of the minimisation: more cost more than they save.
const MEMORY: usize = 8;

/// Number of iterations that reuse the inverse of the volumes' gradients: it changes little and is
/// half of the solves. Any field that changes a volume can correct it exactly.
const KEPT: u32 = 4;

/// Greatest number of rounds of contact and volume before a minimisation.
const SETTLING: usize = 8;

/// Greatest number of times in turn that coupled rows are brought to their distance without a step.
const RESTORED: usize = 3;

/// Number of iterations between updates of constraints with a period.
const NOTED: u32 = 8;

/// A body prepared for the search of its equilibrium.
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// use pliant::solvers::{DescentSettings, NoContact};
/// use pliant::{Distance, Energy, Quadratic, QuasiStatic};
///
/// // A spring of 100 N/m and 1 m hangs from a held point and carries 10 N.
/// let mut x = vec![Point3::origin(), Point3::new(0.0, 0.0, -1.0)];
/// let spring = Distance { points: [0, 1], rest: 1.0 };
/// let energy = Energy {
///     elastic: vec![Box::new(Quadratic::<_, 2>::new(vec![spring], vec![100.0]))],
///     forces: vec![Vector3::zeros(), Vector3::new(0.0, 0.0, -10.0)],
///     ..Energy::default()
/// };
/// let settings = DescentSettings { tolerance: 1e-9, iterations: 100 };
/// let mut solver = QuasiStatic::new(energy, &x, &[0.0, 1.0], settings)?;
/// let outcome = solver.solve(&mut x, &mut NoContact, |_, _| true);
/// assert!(outcome.converged);
/// assert!((x[1].z + 1.1).abs() <= 1e-9);
/// # Ok::<(), pliant::solvers::FactorError>(())
/// ```
pub struct QuasiStatic {
    /// The minimised problem.
    pub problem: DescentProblem,
    laplacian: Laplacian,
    history: History,
    touched: Touched,
    active: Active,
    /// The inverse matrix times the volumes' gradients, and the number of iterations since their
    /// computation.
    spreads: (Vec<Field>, u32),
    /// The pressure in each volume [Pa].
    pub pressures: Vec<f64>,
}

impl QuasiStatic {
    /// Prepares a body at rest at `x`; vertices without inverse mass are fixed.
    ///
    /// # Errors
    /// A part of the body without a fixed vertex, or too little memory.
    pub fn new(
        energy: Energy,
        x: &[Point3<f64>],
        inverse_mass: &[f64],
        settings: DescentSettings,
    ) -> Result<Self, FactorError> {
        let problem = DescentProblem::new(energy, x, inverse_mass, settings);
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

    /// Number of entries of the factorised matrix.
    pub fn entries(&self) -> usize {
        self.laplacian.entries()
    }

    /// Heap memory of the matrix and the history [bytes].
    pub fn bytes(&self) -> usize {
        self.laplacian.bytes() + self.history.bytes() + self.touched.bytes()
    }

    /// Moves fixed vertices to `held` and carries the others along smoothly, then corrects volumes
    /// and obstacles.
    pub fn follow(
        &mut self,
        x: &mut [Point3<f64>],
        held: &[(u32, Point3<f64>)],
        contact: &mut impl ContactFilter,
    ) {
        let mut displacement = vec![Vector3::zeros(); x.len()];
        held.iter()
            .for_each(|&(v, to)| displacement[v as usize] = to - x[v as usize]);
        let mut flight = vec![Vector3::zeros(); x.len()];
        if let Some(inertia) = &self.problem.energy.inertia {
            // With inertia, a vertex keeps its velocity and falls with its constant force unless
            // something holds it. Otherwise forces below the tolerance never move a free body.
            let each = flight.iter_mut().zip(x.iter()).zip(&inertia.target);
            each.for_each(|((flight, x), target)| *flight = target - x);
            let forces = self.problem.energy.forces.iter().zip(&inertia.weight);
            let each = flight.iter_mut().zip(forces);
            each.filter(|(_, (_, weight))| **weight > 0.0)
                .for_each(|(flight, (force, weight))| *flight += force / *weight);
        }
        let mut all = displacement.iter().chain(&flight);
        let is_still = all.all(|d| *d == Vector3::zeros());
        if is_still && contact.parts(&displacement) == 1 {
            return;
        }
        let each = displacement.iter_mut().zip(&flight);
        each.for_each(|(d, flight)| *d -= flight);
        self.laplacian
            .extend(&self.problem.unknowns, &mut displacement);
        displacement
            .iter_mut()
            .zip(&flight)
            .for_each(|(d, flight)| *d += flight);
        if !self.active.rows().is_empty() {
            self.active = Active::default();
            self.spreads.0.clear();
        }
        let parts = contact.parts(&displacement);
        for part in 1..=parts {
            if contact.is_stopped() {
                break;
            }
            let start = x.to_vec();
            let each = x.iter_mut().zip(&displacement);
            each.for_each(|(x, d)| *x += d / parts as f64);
            if part == parts {
                // Exactly, without the rounding of the addition.
                held.iter().for_each(|&(v, to)| x[v as usize] = to);
            }
            contact.begin_part(part as f64 / parts as f64, &start);
            if parts == 1 {
                let rows = contact.planes();
                if !is_coupled(&rows) {
                    self.stay_over(&rows, x);
                }
            }
            contact.push(&start, x);
            self.keep_volumes_apart(x, contact);
            if part < parts {
                contact.accept(x);
            }
        }
        contact.accept(x);
        self.problem.energy.remember(x);
    }

    /// Brings the free vertices to equilibrium; `watch` sees every iteration and stops the solution
    /// by returning false.
    pub fn solve(
        &mut self,
        x: &mut [Point3<f64>],
        contact: &mut impl ContactFilter,
        mut watch: impl FnMut(&DescentOutcome, &[Point3<f64>]) -> bool,
    ) -> DescentOutcome {
        self.keep_volumes_apart(x, contact);
        let state = self.problem.state(x);
        let multipliers = self.problem.first_multipliers(&state);
        let limit = self.problem.settings.iterations as usize;
        let mut descent = Descent {
            solver: self,
            x,
            contact,
            state,
            multipliers,
            rows: Vec::new(),
            direction: Field::new(),
            restored: 0,
            outcome: DescentOutcome {
                evaluations: 1,
                ..DescentOutcome::default()
            },
        };
        let Ok(end) = relax(&mut descent, limit, |now| watch(&now.outcome, now.x));
        let outcome = descent.outcome;
        if end != End::Stuck {
            self.problem.energy.remember(x);
        }
        outcome
    }

    /// Adds a step with the change of the Lagrangian's gradient over it, at constant multipliers.
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
        state: (&State, &[f64]),
        direction: &[Vector3<f64>],
        rows: &[ContactPlane],
        contact: &mut impl ContactFilter,
        outcome: &mut DescentOutcome,
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
            if contact.is_stopped() {
                return false;
            }
            // Rows of pairs repeat each other, and a lift over all of them is long.
            if !is_coupled(rows) {
                lift(problem, laplacian, touched, active, rows, end);
                contact.spend(touched.take_work());
            }
            problem.complete_trial(x, end, spreads, contact)
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

    /// Brings rows to their distance and volumes to their targets, until both are there.
    pub(crate) fn settle(&mut self, x: &mut [Point3<f64>], contact: &mut impl ContactFilter) {
        for _ in 0..SETTLING {
            let before = x.to_vec();
            self.bring_apart(x, contact);
            let moved = x.iter().zip(&before).map(|(x, before)| (x - before).norm());
            if max_or_nan(moved) <= contact.touching() {
                return;
            }
        }
    }

    /// Pushes what is too near to its distance where it is, and keeps the volumes.
    fn bring_apart(&mut self, x: &mut [Point3<f64>], contact: &mut impl ContactFilter) {
        let before = x.to_vec();
        contact.push(&before, x);
        self.keep_volumes_apart(x, contact);
        contact.accept(x);
    }

    /// Brings volumes to their targets without motion through something. Where both cannot be had,
    /// nothing passes through anything.
    fn keep_volumes_apart(&mut self, x: &mut [Point3<f64>], contact: &mut impl ContactFilter) {
        for _ in 0..KEEPING {
            self.keep_volumes(x);
            match contact.hold(x) {
                Some(false) => return,
                Some(true) => {}
                None => contact.hold_all(x),
            }
        }
    }

    /// Brings volumes without compliance to their targets, along the smoothest fields.
    fn keep_volumes(&mut self, x: &mut [Point3<f64>]) {
        let volumes = &self.problem.energy.volumes;
        let (excess, mut areas): (Vec<f64>, Vec<Field>) =
            volumes.iter().map(|v| v.value_and_gradient(x)).unzip();
        // Any smooth fields are suitable, and these are available; volumes are already right up to
        // rounding after `follow`.
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

/// A body on its way to equilibrium.
struct Descent<'a, G> {
    solver: &'a mut QuasiStatic,
    x: &'a mut [Point3<f64>],
    contact: &'a mut G,
    state: State,
    multipliers: Vec<f64>,
    /// The planes that vertices near an obstacle must stay over.
    rows: Vec<ContactPlane>,
    direction: Field,
    /// Number of times that rows were brought to their distance since the last step.
    restored: usize,
    outcome: DescentOutcome,
}

impl<G: ContactFilter> Descent<'_, G> {
    /// Brings coupled rows to their distance where the body is: what is off them has more energy with
    /// every trial. Returns false if nothing moves.
    fn restore(&mut self) -> bool {
        if !is_coupled(&self.rows) || self.restored >= RESTORED {
            return false;
        }
        self.restored += 1;
        let before = self.x.to_vec();
        self.solver.bring_apart(self.x, self.contact);
        self.state = self.solver.problem.state(self.x);
        self.outcome.evaluations += 1;
        self.x.iter().zip(&before).any(|(x, before)| x != before)
    }
}

impl<G: ContactFilter> Relax for Descent<'_, G> {
    type Error = Infallible;

    fn judge(&mut self) -> Result<bool, Infallible> {
        let Self {
            solver,
            x,
            contact,
            state,
            multipliers,
            rows,
            direction,
            restored: _,
            outcome,
        } = self;
        *rows = contact.planes();
        let force = solver.problem.force(state, multipliers);
        let touching = contact.touching();
        let touched: Vec<ContactPlane> = rows
            .iter()
            .filter(|row| row.room(x) <= touching)
            .copied()
            .collect();
        let unknowns = &solver.problem.unknowns;
        // Rows that share vertices are chosen together.
        let next = if is_coupled(rows) {
            let (touches, all) = (&mut solver.touched, touched.clone());
            Some(touches.press(all, &force, &mut solver.laplacian, unknowns))
        } else {
            let mut pressed = touched.clone();
            pressed.retain(|row| row.is_pressed(&force));
            let changed = pressed != solver.active.rows();
            changed.then(|| {
                solver
                    .touched
                    .hold(pressed, &mut solver.laplacian, unknowns)
            })
        };
        contact.spend(solver.touched.take_work());
        if let Some(next) = next {
            if next.rows() != solver.active.rows() {
                solver.spreads.0.clear();
            }
            solver.active = next;
        }
        let last = outcome.iterations >= solver.problem.settings.iterations;
        (*direction, *multipliers) = match last && solver.active.rows().is_empty() {
            // No field moves along it any more; the multipliers of the volumes with the least
            // force need none.
            true => (Field::new(), solver.problem.first_multipliers(state)),
            false => solver.direction(state),
        };
        let problem = &solver.problem;
        let support = |force: &mut Field| match is_coupled(rows) {
            true => problem.support_together(&touched, force),
            // Twice, as rows of one vertex share the force.
            false => (0..2).for_each(|_| {
                solver
                    .active
                    .rows()
                    .iter()
                    .for_each(|row| row.support(force))
            }),
        };
        problem.judge(state, multipliers, support, outcome);
        solver.pressures = problem.pressures(state, multipliers);
        Ok(outcome.converged)
    }

    fn steps(&self) -> usize {
        self.outcome.iterations as usize
    }

    fn advance(&mut self) -> Result<bool, Infallible> {
        let Self {
            solver,
            x,
            contact,
            state,
            multipliers,
            rows,
            direction,
            restored,
            outcome,
        } = self;
        let Some((end, new)) =
            solver.search(x, (state, multipliers), direction, rows, *contact, outcome)
        else {
            if solver.history.is_empty() {
                return Ok(self.restore());
            }
            // The history is misleading: tries again with the constant matrix alone.
            solver.history.clear();
            solver.spreads.0.clear();
            return Ok(true);
        };
        outcome.iterations += 1;
        *restored = 0;
        solver.learn(x, &end, state, &new, multipliers);
        x.copy_from_slice(&end);
        // An angle turns by much less than a period between two updates.
        if outcome.iterations.is_multiple_of(NOTED) {
            solver.problem.energy.remember(x);
        }
        contact.accept(x);
        *state = new;
        Ok(true)
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
        let DescentProblem {
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

/// True if rows share vertices of two parts that both move.
fn is_coupled(rows: &[ContactPlane]) -> bool {
    rows.iter().any(ContactPlane::is_pair)
}

/// Lifts `x` smoothly over the violated rows.
fn lift(
    problem: &DescentProblem,
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
    // Satisfied rows must stay satisfied.
    all.extend(active.rows().iter().filter(|row| row.room(x) >= 0.0));
    let over = touched.hold(all, laplacian, &problem.unknowns);
    if let Some(lift) = over.lift(x, laplacian, &problem.unknowns) {
        x.iter_mut().zip(&lift).for_each(|(x, d)| *x += d);
    }
}
