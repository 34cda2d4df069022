//! Energy minimisation of a muscle at every step, with or without inertia, with the bones as
//! obstacles.

use nalgebra::{Point3, Vector3};

use super::frame::{FrameSteps, Stop};
use crate::constraints::EnclosedVolume;
use crate::constraints::Potential;
use crate::contact::{ContactPlane, Contacts, PosedObstacle};
use crate::particles::Particles;
use crate::scene::{self, Effects};
use crate::solvers::descent::{ContactFilter, DescentOutcome, DescentSettings, NoContact};
use crate::solvers::energy::{Energy, Inertia};
use crate::solvers::quasi_static::QuasiStatic;
use crate::solvers::sparse::FactorError;
use crate::solvers::{Broken, System};
use crate::state::{DecodeError, Reader, State, Writer};

/// Greatest distance of a touching vertex from a bone, in contact thicknesses.
pub(super) const TOUCHING: f64 = 0.02;

/// The equilibrium of a muscle over time.
pub struct Equilibrium {
    solver: QuasiStatic,
    /// Result of the last step.
    pub outcome: DescentOutcome,
    /// Number of iterations of all steps so far.
    pub iterations: u64,
    /// Greatest residual of the frame's steps, relative to the force of unit strain.
    pub residual: f64,
    scratch: Particles,
}

impl Equilibrium {
    /// Prepares a muscle with `particles` at rest: with a time `step` [s] for implicit Euler,
    /// without one for equilibrium.
    ///
    /// # Errors
    /// A part of the muscle without a fixed vertex, or too little memory.
    pub(super) fn new(
        (elastic, volume): (Vec<Box<dyn Potential>>, Option<EnclosedVolume>),
        particles: &Particles,
        loads: &[(u32, Vector3<f64>)],
        effects: &Effects,
        settings: scene::Minimisation,
        step: Option<f64>,
    ) -> Result<Self, FactorError> {
        let mut energy = Energy {
            elastic,
            volumes: volume.into_iter().collect(),
            ..Energy::default()
        };
        energy.forces = forces(particles, loads, effects.gravity);
        energy.inertia = step.map(|dt| {
            let weight = |w: &f64| if *w > 0.0 { 1.0 / (w * dt * dt) } else { 0.0 };
            let weight = particles.inverse_mass.iter().map(weight).collect();
            Inertia {
                weight,
                target: particles.position.clone(),
            }
        });
        let settings = DescentSettings {
            tolerance: settings.tolerance,
            iterations: settings.iterations,
        };
        let solver = QuasiStatic::new(
            energy,
            &particles.position,
            &particles.inverse_mass,
            settings,
        )?;
        Ok(Self {
            solver,
            outcome: DescentOutcome::default(),
            iterations: 0,
            residual: 0.0,
            scratch: particles.clone(),
        })
    }

    /// The energy, for changes between steps.
    pub(super) fn energy_mut(&mut self) -> &mut Energy {
        &mut self.solver.problem.energy
    }

    /// Stopping criteria.
    pub(super) fn settings(&self) -> DescentSettings {
        self.solver.problem.settings
    }

    /// Changes the tolerance of later steps.
    pub(super) fn set_tolerance(&mut self, tolerance: f64) {
        self.solver.problem.settings.tolerance = tolerance;
    }

    /// Begins a frame.
    pub(super) fn begin_frame(&mut self) {
        self.residual = 0.0;
    }

    /// Moves with the bones to their present poses and minimises the energy. Velocities become
    /// zero, or with inertia those of the step.
    ///
    /// # Errors
    /// A number that is not finite; the body is restored to the state before.
    pub(super) fn step(
        &mut self,
        system: &mut System,
        placed: &[PosedObstacle],
        of: &FrameSteps<'_>,
    ) -> Result<(), Broken> {
        let dt = of.dt;
        let start = system.particles.position.clone();
        self.aim(system, dt);
        let held: Vec<(u32, Point3<f64>)> = system
            .held
            .iter()
            .map(|h| (h.vertex, placed[h.bone].now * h.local))
            .collect();
        let x = &mut system.particles.position;
        let outcome = match &mut system.contacts {
            None => {
                self.solver.follow(x, &held, &mut NoContact);
                let watch = |_: &DescentOutcome, x: &[Point3<f64>]| {
                    of.stop.spend_trial(x.len());
                    !of.stop.is_asked()
                };
                self.solver.solve(x, &mut NoContact, watch)
            }
            Some(contacts) => {
                let mut bones = Bones::new(contacts, &mut self.scratch, placed, of.stop);
                self.solver.follow(x, &held, &mut bones);
                // A bone can move without any of its attached vertices.
                if bones.moves() {
                    let before = x.clone();
                    bones.push(&before, x);
                    bones.accept(x);
                }
                self.solver.solve(x, &mut bones, |_, _| !of.stop.is_asked())
            }
        };
        if let Some(particle) = first_non_finite(&system.particles.position) {
            system.particles.position = start;
            system.particles.velocity.fill(Vector3::zeros());
            return Err(Broken {
                effect: "equilibrium",
                particle,
            });
        }
        self.take_outcome(outcome, &start, &mut system.particles, dt);
        Ok(())
    }

    /// Sets where the inertia takes the particles in a step of `dt` [s].
    pub(super) fn aim(&mut self, system: &System, dt: f64) {
        if let Some(inertia) = &mut self.solver.problem.energy.inertia {
            inertia.target.clear();
            inertia.target.extend(system.coasting(dt));
        }
    }

    /// Notes the outcome of a step of `dt` [s] from `start` [m], and sets the velocities.
    pub(super) fn take_outcome(
        &mut self,
        outcome: DescentOutcome,
        start: &[Point3<f64>],
        particles: &mut Particles,
        dt: f64,
    ) {
        particles.velocity.fill(Vector3::zeros());
        if self.solver.problem.energy.inertia.is_some() {
            let moved = particles.position.iter().zip(start);
            let each = particles.velocity.iter_mut().zip(moved);
            each.for_each(|(v, (x, start))| *v = (x - start) / dt);
        }
        // Not `f64::max`, which would hide a NaN.
        if !(outcome.residual <= self.residual) {
            self.residual = outcome.residual;
        }
        self.outcome = outcome;
        self.iterations += u64::from(outcome.iterations);
    }

    /// The bones around the muscle with `contacts`.
    pub(super) fn bones<'a>(
        &'a mut self,
        contacts: &'a mut Contacts,
        placed: &[PosedObstacle],
        stop: Stop<'a>,
    ) -> Bones<'a> {
        Bones::new(contacts, &mut self.scratch, placed, stop)
    }
}

impl State for Equilibrium {
    fn save(&self, to: &mut Writer) {
        let Self {
            solver,
            outcome,
            iterations,
            residual,
            scratch: _,
        } = self;
        solver.save(to);
        to.put(outcome);
        to.put(iterations);
        to.put(residual);
    }

    fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), DecodeError> {
        self.solver.restore(from)?;
        self.outcome = from.take()?;
        self.iterations = from.take()?;
        self.residual = from.take()?;
        Ok(())
    }
}

/// Weight and given forces on each vertex [N]; empty without any.
fn forces(
    particles: &Particles,
    loads: &[(u32, Vector3<f64>)],
    gravity: Option<Vector3<f64>>,
) -> Vec<Vector3<f64>> {
    if loads.is_empty() && gravity.is_none() {
        return Vec::new();
    }
    let weight = |w: &f64| {
        if *w > 0.0 {
            gravity.unwrap_or_else(Vector3::zeros) / *w
        } else {
            Vector3::zeros()
        }
    };
    let mut all: Vec<Vector3<f64>> = particles.inverse_mass.iter().map(weight).collect();
    loads
        .iter()
        .for_each(|&(v, force)| all[v as usize] += force);
    all
}

/// The first position that is not finite.
pub(super) fn first_non_finite(x: &[Point3<f64>]) -> Option<usize> {
    let is_finite = |p: &Point3<f64>| p.coords.iter().all(|c| c.is_finite());
    x.iter().position(|p| !is_finite(p))
}

/// Bones as obstacles during the solver's trials.
pub(super) struct Bones<'a> {
    contacts: &'a mut Contacts,
    placed: Vec<PosedObstacle>,
    scratch: &'a mut Particles,
    stop: Stop<'a>,
}

impl<'a> Bones<'a> {
    fn new(
        contacts: &'a mut Contacts,
        scratch: &'a mut Particles,
        placed: &[PosedObstacle],
        stop: Stop<'a>,
    ) -> Self {
        Self {
            contacts,
            placed: placed.to_vec(),
            scratch,
            stop,
        }
    }

    fn moves(&self) -> bool {
        self.placed.iter().any(|p| p.before != p.now)
    }

    /// Sets where the bones are at the start and at the end of the next motion.
    pub(super) fn place(&mut self, placed: &[PosedObstacle]) {
        self.placed.clone_from_slice(placed);
    }
}

impl ContactFilter for Bones<'_> {
    fn planes(&self) -> Vec<ContactPlane> {
        self.contacts.contact_planes()
    }

    fn touching(&self) -> f64 {
        TOUCHING * self.contacts.thickness()
    }

    fn push(&mut self, start: &[Point3<f64>], x: &mut [Point3<f64>]) {
        self.stop.spend_trial(x.len());
        self.contacts.begin_step(start);
        self.scratch.position.copy_from_slice(x);
        self.contacts.project(&self.placed, self.scratch);
        self.stop.spend(self.contacts.take_work());
        x.copy_from_slice(&self.scratch.position);
    }

    fn is_stopped(&self) -> bool {
        self.stop.is_asked()
    }

    fn spend(&mut self, steps: usize) {
        self.stop.spend(steps);
    }

    fn accept(&mut self, x: &[Point3<f64>]) {
        self.scratch.position.copy_from_slice(x);
        self.contacts.end_step(&self.placed, self.scratch, 1.0);
        // The bones do not move from here on.
        self.placed.iter_mut().for_each(|p| p.before = p.now);
    }
}
