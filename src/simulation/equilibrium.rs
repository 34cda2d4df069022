//! A muscle whose energy is minimised at every step, with or without inertia, the bones its guard.

use nalgebra::{Point3, Vector3};

use crate::constraints::EnclosedVolume;
use crate::constraints::bending::Bending;
use crate::constraints::distance::Distance;
use crate::contact::{Contacts, Placed, Row};
use crate::mesh::measures::greatest;
use crate::particles::Particles;
use crate::scene::{self, Effects};
use crate::solvers::descent::{Guard, Outcome, Settings, Unguarded};
use crate::solvers::energy::{Energy, Inertia};
use crate::solvers::potential::Quadratic;
use crate::solvers::press::Press;
use crate::solvers::quasi_static::QuasiStatic;
use crate::solvers::sparse::FactorError;
use crate::solvers::tension::Tension;
use crate::solvers::tracking::Tracking;
use crate::solvers::{Broken, System};
use crate::state::{Corrupt, Reader, State, Writer};

/// A vertex touches a bone where it has no more room than this many contact thicknesses.
const TOUCHING: f64 = 0.02;

/// What a muscle's energy is made of.
pub(super) struct Parts {
    /// Edges and their stiffness [N/m].
    pub edges: (Vec<Distance>, Vec<f64>),
    /// Hinges and their stiffness [N m].
    pub hinges: (Vec<Bending>, Vec<f64>),
    /// The enclosed volume.
    pub volume: Option<EnclosedVolume>,
}

/// Rounds at most in which the planes of contact are looked up again.
const ROUNDS: usize = 3;

/// Planes are right where nothing moved by more than this share of the contact thickness since they were looked up.
const STILL: f64 = 1e-2;

/// Share of the contact thickness that has to be left over a bone.
const LEAST_LEFT: f64 = 0.1;

/// Vertices nearer to a bone than so many contact thicknesses are looked at while a muscle comes to rest.
const REACH: f64 = 4.0;

/// Stiffness of the band over bones for a muscle that tracks a shape, over that of the stiffest edge.
const PRESS: f64 = 10.0;

/// A muscle's equilibrium, followed from step to step.
pub struct Equilibrium {
    solver: QuasiStatic,
    /// The last step's end.
    pub outcome: Outcome,
    /// Iterations of all steps so far.
    pub iterations: u64,
    /// Greatest residual of the frame's steps, as a share of the force of a strain of one.
    pub residual: f64,
    scratch: Particles,
    /// The shape that is tracked [m], and the one of the next step.
    tracked: Option<[Vec<Point3<f64>>; 2]>,
}

impl Equilibrium {
    /// Prepares a muscle with `particles` at rest; with a time `step` [s] for implicit Euler, else for equilibrium.
    ///
    /// # Errors
    /// A part of it that nothing holds, or no memory.
    pub(super) fn new(
        parts: Parts,
        particles: &Particles,
        loads: &[(u32, Vector3<f64>)],
        effects: &Effects,
        settings: scene::Minimisation,
        step: Option<f64>,
    ) -> Result<Self, FactorError> {
        let mut energy = Energy { volumes: parts.volume.into_iter().collect(), ..Energy::default() };
        let (edges, k) = parts.edges;
        // An edge without stiffness (along a fibre, at full strength) exerts no force.
        let (edges, k): (Vec<_>, Vec<_>) = edges.into_iter().zip(k).filter(|(_, k)| *k > 0.0).unzip();
        if !edges.is_empty() {
            energy.elastic.push(Box::new(Quadratic::<Distance, 2>::new(edges, k)));
        }
        if !parts.hinges.0.is_empty() {
            energy.elastic.push(Box::new(Quadratic::<Bending, 4>::new(parts.hinges.0, parts.hinges.1)));
        }
        energy.forces = forces(particles, loads, effects.gravity);
        energy.inertia = step.map(|dt| {
            let weight = |w: &f64| if *w > 0.0 { 1.0 / (w * dt * dt) } else { 0.0 };
            let weight = particles.inverse_mass.iter().map(weight).collect();
            Inertia { weight, target: particles.position.clone() }
        });
        let settings = Settings { tolerance: settings.tolerance, iterations: settings.iterations };
        let solver = QuasiStatic::new(energy, &particles.position, &particles.inverse_mass, settings)?;
        Ok(Self {
            solver,
            outcome: Outcome::default(),
            iterations: 0,
            residual: 0.0,
            scratch: particles.clone(),
            tracked: None,
        })
    }

    /// Prepares a muscle that tracks a prescribed shape and pulls at every length; see [`Tracking`] and
    /// [`Tension`]. `stiffness` [N/m] is that of edges, of which tracking has the share `tracking`.
    ///
    /// # Errors
    /// A part of it that nothing holds, or no memory.
    pub fn tracking(
        edges: &[Distance],
        stiffness: Vec<f64>,
        tracking: f64,
        volume: Option<EnclosedVolume>,
        particles: &Particles,
        settings: Settings,
    ) -> Result<Self, FactorError> {
        let target = particles.position.clone();
        let points = edges.iter().map(|e| e.points).collect();
        let part = Tracking::new(points, stiffness.iter().map(|k| k * tracking).collect(), target.clone());
        let press = PRESS * (1.0 + tracking) * greatest(stiffness.iter().copied());
        let press = Some(Press::new(press));
        let mut energy = Energy { volumes: volume.into_iter().collect(), press, ..Energy::default() };
        energy.elastic.push(Box::new(part));
        energy.elastic.push(Box::new(Tension::new(edges.to_vec(), stiffness, &particles.position)));
        let solver = QuasiStatic::new(energy, &particles.position, &particles.inverse_mass, settings)?;
        let tracked = Some([target.clone(), target]);
        let outcome = Outcome::default();
        Ok(Self { solver, outcome, iterations: 0, residual: 0.0, scratch: particles.clone(), tracked })
    }

    /// The shape to track in the next step [m]; nothing for a muscle that tracks none.
    pub fn aim(&mut self, target: Vec<Point3<f64>>) {
        if let Some([_, next]) = &mut self.tracked {
            *next = target;
        }
    }

    /// Values over all vertices that are as even as can be, given those of held vertices.
    pub fn spread(&mut self, held: &[(u32, f64)]) -> Vec<f64> {
        let mut values = vec![Vector3::zeros(); self.scratch.position.len()];
        held.iter().for_each(|&(v, value)| values[v as usize].x = value);
        self.solver.extend(&mut values);
        values.into_iter().map(|v| v.x).collect()
    }

    /// A new frame begins.
    pub(super) fn begin_frame(&mut self) {
        self.residual = 0.0;
    }

    /// Follows the bones to where they are now and minimises there; velocities become zero, or with inertia those of
    /// the step of `dt` [s].
    ///
    /// # Errors
    /// A number that is not finite; the body is as it was before.
    pub(super) fn step(&mut self, system: &mut System, placed: &[Placed], dt: f64) -> Result<(), Broken> {
        let start = system.particles.position.clone();
        let factor = system.settings.velocity_factor;
        if let Some(inertia) = &mut self.solver.problem.energy.inertia {
            let flown = start.iter().zip(&system.particles.velocity).map(|(x, v)| x + v * (factor * dt));
            inertia.target.clear();
            inertia.target.extend(flown);
        }
        let held: Vec<(u32, Point3<f64>)> =
            system.held.iter().map(|h| (h.vertex, placed[h.bone].now * h.local)).collect();
        let x = &mut system.particles.position;
        let tracks = self.tracked.is_some();
        if tracks {
            self.go_on(x, &held);
        }
        let outcome = match &mut system.contacts {
            Some(contacts) if tracks => {
                let guard = Bones { contacts, placed: placed.to_vec(), scratch: &mut self.scratch };
                lean(&mut self.solver, guard, &start, x)
            }
            None => {
                self.solver.follow(x, &held, &mut Unguarded);
                self.solver.solve(x, &mut Unguarded, |_, _| true)
            }
            Some(contacts) => {
                let mut guard = Bones { contacts, placed: placed.to_vec(), scratch: &mut self.scratch };
                self.solver.follow(x, &held, &mut guard);
                // A bone may have moved though nothing that it holds did.
                if guard.moves() {
                    guard.push(&start, x);
                    guard.accept(x);
                }
                self.solver.solve(x, &mut guard, |_, _| true)
            }
        };
        system.particles.velocity.fill(Vector3::zeros());
        if self.solver.problem.energy.inertia.is_some() {
            let moved = system.particles.position.iter().zip(&start);
            system.particles.velocity.iter_mut().zip(moved).for_each(|(v, (x, start))| *v = (x - start) / dt);
        }
        if let Some(particle) = system.particles.first_non_finite() {
            system.particles.position = start;
            return Err(Broken { effect: "equilibrium", particle });
        }
        // Not `f64::max`, which would hide a NaN.
        if !(outcome.residual <= self.residual) {
            self.residual = outcome.residual;
        }
        self.outcome = outcome;
        self.iterations += u64::from(outcome.iterations);
        Ok(())
    }
}

impl Equilibrium {
    /// Carries a muscle along with the shape that it tracks.
    fn go_on(&mut self, x: &mut [Point3<f64>], held: &[(u32, Point3<f64>)]) {
        let Some([last, next]) = &mut self.tracked else { return };
        let moved = x.iter_mut().zip(next.iter().zip(last.iter()));
        moved.for_each(|(x, (next, last))| *x += next - last);
        // Exactly, and not by what the addition rounds to: then nothing that is held is left to follow.
        held.iter().for_each(|&(v, to)| x[v as usize] = to);
        self.solver.problem.energy.elastic.iter_mut().for_each(|part| part.aim(next));
        last.copy_from_slice(next);
    }
}

/// Brings a muscle to rest against bones that give way by a share of the contact thickness, so that what is minimised is
/// smooth; planes over which points of bones keep triangles are looked up again until nothing moves.
fn lean(solver: &mut QuasiStatic, mut guard: Bones<'_>, start: &[Point3<f64>], x: &mut [Point3<f64>]) -> Outcome {
    let thickness = guard.contacts.thickness();
    let obstacles = guard.contacts.obstacles().to_vec();
    let (mut outcome, mut iterations, mut evaluations) = (Outcome::default(), 0, 0);
    let mut pushed = x.to_vec();
    for _ in 0..ROUNDS {
        let before = x.to_vec();
        pushed.copy_from_slice(x);
        guard.push(start, &mut pushed);
        if let Some(press) = &mut solver.problem.energy.press {
            press.thickness = thickness;
            press.place(&obstacles, &guard.placed, x, REACH * thickness);
            press.rows = guard.rows().into_iter().filter(|row| row.terms[1].1 != 0.0).collect();
        }
        outcome = solver.solve(x, &mut Unguarded, |_, _| true);
        iterations += outcome.iterations;
        evaluations += outcome.evaluations;
        let moved = x.iter().zip(&before).map(|(x, before)| (x - before).norm());
        let moved = greatest(moved);
        if moved <= STILL * thickness {
            break;
        }
    }
    if let Some(press) = &mut solver.problem.energy.press {
        press.place(&obstacles, &guard.placed, x, REACH * thickness);
        // A muscle that presses through the band is pushed out as by rigid bones.
        if !(press.left(x) >= LEAST_LEFT) {
            guard.push(start, x);
            solver.keep_volumes(x);
        }
    }
    guard.accept(x);
    outcome.iterations = iterations;
    outcome.evaluations = evaluations;
    outcome
}

impl State for Equilibrium {
    fn save(&self, to: &mut Writer) {
        let Self { solver, outcome, iterations, residual, scratch: _, tracked: _ } = self;
        solver.save(to);
        to.put(outcome);
        to.put(iterations);
        to.put(residual);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), Corrupt> {
        self.solver.restore(from)?;
        self.outcome = from.take()?;
        self.iterations = from.take()?;
        self.residual = from.take()?;
        Ok(())
    }
}

/// Weight and given forces on each vertex [N]; empty where there is none.
fn forces(particles: &Particles, loads: &[(u32, Vector3<f64>)], gravity: Option<Vector3<f64>>) -> Vec<Vector3<f64>> {
    if loads.is_empty() && gravity.is_none() {
        return Vec::new();
    }
    let weight = |w: &f64| if *w > 0.0 { gravity.unwrap_or_else(Vector3::zeros) / *w } else { Vector3::zeros() };
    let mut all: Vec<Vector3<f64>> = particles.inverse_mass.iter().map(weight).collect();
    loads.iter().for_each(|&(v, force)| all[v as usize] += force);
    all
}

/// The bones keep a muscle out while its solver tries positions.
struct Bones<'a> {
    contacts: &'a mut Contacts,
    placed: Vec<Placed>,
    scratch: &'a mut Particles,
}

impl Bones<'_> {
    fn moves(&self) -> bool {
        self.placed.iter().any(|p| p.before != p.now)
    }
}

impl Guard for Bones<'_> {
    fn rows(&self) -> Vec<Row> {
        self.contacts.near_rows()
    }

    fn touching(&self) -> f64 {
        TOUCHING * self.contacts.thickness()
    }

    fn push(&mut self, start: &[Point3<f64>], x: &mut [Point3<f64>]) {
        self.contacts.begin_step(start);
        self.scratch.position.copy_from_slice(x);
        self.contacts.project(&self.placed, self.scratch);
        x.copy_from_slice(&self.scratch.position);
    }

    fn accept(&mut self, x: &[Point3<f64>]) {
        self.scratch.position.copy_from_slice(x);
        self.contacts.end_step(&self.placed, self.scratch, 1.0);
        // From here on the bones stand still.
        self.placed.iter_mut().for_each(|p| p.before = p.now);
    }
}
