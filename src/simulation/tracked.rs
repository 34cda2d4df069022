//! A muscle that tracks a prescribed shape: what is nearest to equilibrium there, with its volume kept and bones that give
//! way.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::constraints::distance::Distance;
use crate::contact::PosedObstacle;
use crate::contact::smooth::SmoothDistance;
use crate::mesh::measures::max_or_nan;
use crate::solvers::descent::{Outcome, Settings};
use crate::solvers::energy::Energy;
use crate::solvers::newton::Newton;
use crate::solvers::press::{Press, Sample};
use crate::solvers::sparse::FactorError;
use crate::solvers::tension::Tension;
use crate::solvers::tracking::Tracking;
use crate::solvers::{Broken, System};

/// Rounds at most in which samples that have come near to a bone are looked up again.
const ROUNDS: usize = 4;

/// Samples nearer to a bone than so many contact thicknesses are looked at while a muscle comes to rest.
pub const REACH: f64 = 8.0;

/// Stiffness of the band over bones, over that of the stiffest edge and of what it tracks with.
const PRESS: f64 = 10.0;

/// A vertex that at rest is nearer to a bone than so many contact thicknesses is supported by that bone.
const RESTS: f64 = 2.0;

/// Share of the band over a bone that has to be left.
const LEAST_LEFT: f64 = 0.2;

/// Factor by which the band gets stiffer where less is left.
const STIFFER: f64 = 10.0;

/// What a muscle that tracks a shape is made of.
pub struct Parts<'a> {
    /// Edges with their rest lengths [m].
    pub edges: &'a [Distance],
    /// Their stiffness at rest [N/m].
    pub stiffness: Vec<f64>,
    /// The share of that with which they keep the prescribed shape.
    pub tracking: f64,
    /// Smoothed distances to all obstacles.
    pub bones: &'a [Arc<SmoothDistance>],
}

/// A muscle's shape as a function of the prescribed one.
pub struct Tracked {
    solver: Newton,
    /// Its tone.
    tension: Tension,
    /// Vertices that at rest lie on an obstacle, and the direction away from it in its own frame.
    lies_on: Vec<(u32, usize, Vector3<f64>)>,
    /// The last step's end.
    pub outcome: Outcome,
    /// The shape that was tracked last [m], and that of the next step.
    shapes: [Vec<Point3<f64>>; 2],
}

impl Tracked {
    /// Prepares the muscle of `system`, which is at rest; see [`Tracking`], [`Tension`] and [`Press`].
    ///
    /// # Errors
    /// No memory.
    pub fn new(
        parts: Parts<'_>,
        system: &System,
        placed: &[PosedObstacle],
        settings: Settings,
    ) -> Result<Self, FactorError> {
        let Parts {
            edges,
            stiffness,
            tracking,
            bones,
        } = parts;
        let particles = &system.particles;
        let shape = particles.position.clone();
        let points: Vec<Sample> = edges.iter().map(|e| e.points).collect();
        let free = |v: &u32| particles.inverse_mass[*v as usize] > 0.0;
        let vertices = (0..shape.len() as u32).map(|v| [v, v]);
        let samples = vertices
            .chain(points.iter().copied())
            .filter(|s| s.iter().any(free))
            .collect();
        let press = system.contacts.as_ref().map(|contacts| {
            let stiffest = max_or_nan(stiffness.iter().copied());
            let bones = contacts
                .obstacles()
                .iter()
                .map(|&o| bones[o].clone())
                .collect();
            Press::new(
                PRESS * (1.0 + tracking) * stiffest,
                contacts.thickness(),
                samples,
                bones,
            )
        });
        let mut energy = Energy {
            volumes: system.volume.iter().cloned().collect(),
            press,
            ..Energy::default()
        };
        let shares = stiffness.iter().map(|k| k * tracking).collect();
        energy
            .elastic
            .push(Box::new(Tracking::new(points, shares, shape.clone())));
        let tension = Tension::new(edges.to_vec(), stiffness);
        energy.elastic.push(Box::new(tension.clone()));
        let lies_on = system.contacts.as_ref().map_or_else(Vec::new, |contacts| {
            let reach = RESTS * contacts.thickness();
            let of = |&o: &usize| on_obstacle(&shape, o, &placed[o], reach);
            contacts.obstacles().iter().flat_map(of).collect()
        });
        let solver = Newton::new(energy, &shape, &particles.inverse_mass, settings)?;
        Ok(Self {
            solver,
            tension,
            lies_on,
            outcome: Outcome::default(),
            shapes: [shape.clone(), shape],
        })
    }

    /// The shape to track in the next step [m].
    pub fn aim(&mut self, target: Vec<Point3<f64>>) {
        self.shapes[1] = target;
    }

    /// Follows the bones to where they are now and minimises there; velocities become zero.
    ///
    /// # Errors
    /// A number that is not finite, or a part that nothing holds; the body is as it was before.
    pub(super) fn step(
        &mut self,
        system: &mut System,
        placed: &[PosedObstacle],
    ) -> Result<(), Broken> {
        let mut x = system.particles.position.clone();
        let [last, next] = &mut self.shapes;
        x.iter_mut()
            .zip(next.iter().zip(last.iter()))
            .for_each(|(x, (next, last))| *x += next - last);
        system
            .held
            .iter()
            .for_each(|h| x[h.vertex as usize] = placed[h.bone].now * h.local);
        self.solver
            .problem
            .energy
            .elastic
            .iter_mut()
            .for_each(|part| part.aim(next));
        last.copy_from_slice(next);
        self.solver.problem.energy.forces = self.support(placed);
        let obstacles = system.contacts.as_ref().map_or(&[][..], |c| c.obstacles());
        let poses: Vec<Isometry3<f64>> = obstacles.iter().map(|&o| placed[o].now).collect();
        let stiffness = self
            .solver
            .problem
            .energy
            .press
            .as_ref()
            .map(|press| press.stiffness);
        let done = self.rest(&mut x, &poses);
        if let (Some(press), Some(stiffness)) = (&mut self.solver.problem.energy.press, stiffness) {
            press.stiffness = stiffness;
        }
        done.map_err(|_| Broken {
            effect: "equilibrium",
            particle: 0,
        })?;
        if let Some(particle) = x
            .iter()
            .position(|p| !p.coords.iter().all(|c| c.is_finite()))
        {
            return Err(Broken {
                effect: "equilibrium",
                particle,
            });
        }
        system.particles.position = x;
        system.particles.velocity.fill(Vector3::zeros());
        Ok(())
    }

    /// The forces [N] that hold a muscle with tone in the prescribed shape: those of what lies around it. Where it lies on a
    /// bone at rest, it is the bone that holds it, so that its tone presses it against the bone from the beginning.
    fn support(&self, placed: &[PosedObstacle]) -> Vec<Vector3<f64>> {
        let mut forces = self.tension.support(&self.shapes[1]);
        for (v, o, away) in &self.lies_on {
            let away = placed[*o].now * away;
            let force = &mut forces[*v as usize];
            *force -= away * force.dot(&away).max(0.0);
        }
        forces
    }

    /// Minimises, until no sample is in a band that was not looked at and enough is left of every band.
    fn rest(&mut self, x: &mut [Point3<f64>], poses: &[Isometry3<f64>]) -> Result<(), FactorError> {
        let (mut iterations, mut evaluations) = (0, 0);
        let place = |solver: &mut Newton, x: &[Point3<f64>]| match &mut solver.problem.energy.press
        {
            Some(press) => press.place(poses.to_vec(), x, REACH * press.thickness),
            None => true,
        };
        place(&mut self.solver, x);
        for _ in 0..ROUNDS {
            self.outcome = self.solver.solve(x, |_, _| true)?;
            iterations += self.outcome.iterations;
            evaluations += self.outcome.evaluations;
            let all_known = place(&mut self.solver, x);
            match &mut self.solver.problem.energy.press {
                Some(press) if !(press.left(x) >= LEAST_LEFT) => press.stiffness *= STIFFER,
                _ if all_known => break,
                _ => {}
            }
        }
        (self.outcome.iterations, self.outcome.evaluations) = (iterations, evaluations);
        Ok(())
    }
}

/// The vertices of `x` [m] nearer to an obstacle than `reach` [m], with the direction away from it in its own frame.
fn on_obstacle(
    x: &[Point3<f64>],
    o: usize,
    placed: &PosedObstacle,
    reach: f64,
) -> Vec<(u32, usize, Vector3<f64>)> {
    let back = placed.now.inverse();
    let near = |(v, x): (usize, &Point3<f64>)| {
        let found = placed.obstacle.closest(&(back * x))?;
        (found.distance < reach).then_some((v as u32, o, found.normal))
    };
    x.iter().enumerate().filter_map(near).collect()
}
