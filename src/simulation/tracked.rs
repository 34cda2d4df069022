//! A muscle that tracks a prescribed shape: the equilibrium nearest to it, with a volume constraint
//! and compliant bones.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::constraints::distance::Distance;
use crate::contact::PosedObstacle;
use crate::contact::smooth::SmoothDistance;
use crate::mesh::measures::max_or_nan;
use crate::rest::{Relax, relax};
use crate::solvers::NoContact;
use crate::solvers::descent::{DescentOutcome, DescentSettings};
use crate::solvers::energy::Energy;
use crate::solvers::newton::Newton;
use crate::solvers::press::{Press, Sample};
use crate::solvers::sparse::FactorError;
use crate::solvers::tension::{Tension, support, tension};
use crate::solvers::tracking::{Tracking, toward, tracking};
use crate::solvers::{Broken, System};

/// Greatest number of rounds with new queries for samples near a bone.
const ROUNDS: usize = 4;

/// Distance of active samples from a bone during the minimisation, in contact thicknesses.
pub const REACH: f64 = 8.0;

/// Stiffness of the band over bones, relative to that of the stiffest edge with its tracking.
const PRESS: f64 = 10.0;

/// Distance from a bone, in contact thicknesses, within which the bone supports a vertex at rest.
const RESTS: f64 = 2.0;

/// Least remaining share of the band over a bone.
const LEAST_LEFT: f64 = 0.2;

/// Stiffness factor of the band where less remains.
const STIFFER: f64 = 10.0;

/// Components of a muscle that tracks a shape.
pub struct TrackedParts<'a> {
    /// Edges with their rest lengths [m].
    pub edges: &'a [Distance],
    /// Rest stiffness of the edges [N/m].
    pub stiffness: Vec<f64>,
    /// Stiffness of the tracking relative to that of the edges.
    pub tracking: f64,
    /// Smoothed distances to all obstacles.
    pub bones: &'a [Arc<SmoothDistance>],
}

/// The shape of a muscle as a function of the prescribed one.
pub struct Tracked {
    solver: Newton,
    /// What draws it to its target; the first elastic part.
    tracking: Tracking,
    /// Tone of the muscle.
    tension: Tension,
    /// Vertices that lie on an obstacle at rest, with the direction away from it in its own frame.
    lies_on: Vec<(u32, usize, Vector3<f64>)>,
    /// Result of the last step.
    pub outcome: DescentOutcome,
    /// The last prescribed shape [m], and that of the next step.
    shapes: [Vec<Point3<f64>>; 2],
}

impl Tracked {
    /// Prepares the muscle of `system` at rest; see [`Tracking`], [`Tension`] and [`Press`].
    ///
    /// # Errors
    /// Too little memory.
    pub fn new(
        parts: TrackedParts<'_>,
        system: &System,
        placed: &[PosedObstacle],
        settings: DescentSettings,
    ) -> Result<Self, FactorError> {
        let TrackedParts {
            edges,
            stiffness,
            tracking: share,
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
                PRESS * (1.0 + share) * stiffest,
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
        let shares: Vec<f64> = stiffness.iter().map(|k| k * share).collect();
        let tracking = tracking(&points, &shares, &shape);
        energy.elastic.push(Box::new(tracking.clone()));
        let tension = tension(edges, &stiffness);
        energy.elastic.push(Box::new(tension.clone()));
        let lies_on = system.contacts.as_ref().map_or_else(Vec::new, |contacts| {
            let reach = RESTS * contacts.thickness();
            let of = |&o: &usize| on_obstacle(&shape, o, &placed[o], reach);
            contacts.obstacles().iter().flat_map(of).collect()
        });
        let solver = Newton::new(energy, &shape, &particles.inverse_mass, settings)?;
        Ok(Self {
            solver,
            tracking,
            tension,
            lies_on,
            outcome: DescentOutcome::default(),
            shapes: [shape.clone(), shape],
        })
    }

    /// Sets the shape to track in the next step [m].
    pub fn aim(&mut self, target: Vec<Point3<f64>>) {
        self.shapes[1] = target;
    }

    /// Moves with the bones to their present poses and minimises the energy; velocities become
    /// zero.
    ///
    /// # Errors
    /// A number that is not finite, or a part without a restraint; the body is restored to the
    /// state before.
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
        self.solver.problem.energy.elastic[0] = Box::new(toward(&self.tracking, next));
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

    /// The forces [N] that hold a muscle with tone in the prescribed shape: those of the
    /// surrounding tissue. Where the muscle lies on a bone at rest, the bone holds it, so the tone
    /// presses it against the bone from the beginning.
    fn support(&self, placed: &[PosedObstacle]) -> Vec<Vector3<f64>> {
        let mut forces = support(&self.tension, &self.shapes[1]);
        for (v, o, away) in &self.lies_on {
            let away = placed[*o].now * away;
            let force = &mut forces[*v as usize];
            *force -= away * force.dot(&away).max(0.0);
        }
        forces
    }

    /// Minimises until all samples in bands are active and enough of every band remains.
    fn rest(&mut self, x: &mut [Point3<f64>], poses: &[Isometry3<f64>]) -> Result<(), FactorError> {
        let mut rounds = Rounds {
            solver: &mut self.solver,
            poses,
            x,
            outcome: self.outcome,
            iterations: 0,
            evaluations: 0,
            done: 0,
            is_settled: false,
        };
        rounds.place();
        relax(&mut rounds, ROUNDS, |_| true)?;
        self.outcome = DescentOutcome {
            iterations: rounds.iterations,
            evaluations: rounds.evaluations,
            ..rounds.outcome
        };
        Ok(())
    }
}

/// Rounds in which samples that have come near to a bone are looked up again.
struct Rounds<'a> {
    solver: &'a mut Newton,
    poses: &'a [Isometry3<f64>],
    x: &'a mut [Point3<f64>],
    /// The end of the last round.
    outcome: DescentOutcome,
    /// Of all rounds.
    iterations: u32,
    evaluations: u32,
    done: usize,
    is_settled: bool,
}

impl Rounds<'_> {
    /// Looks up the samples near the bones; whether all that are in a band were looked at before.
    fn place(&mut self) -> bool {
        match &mut self.solver.problem.energy.press {
            Some(press) => press.place(self.poses.to_vec(), self.x, REACH * press.thickness),
            None => true,
        }
    }
}

impl Relax for Rounds<'_> {
    type Error = FactorError;

    fn judge(&mut self) -> Result<bool, FactorError> {
        Ok(self.is_settled)
    }

    fn steps(&self) -> usize {
        self.done
    }

    fn advance(&mut self) -> Result<bool, FactorError> {
        self.outcome = self.solver.solve(self.x, &mut NoContact, |_, _| true)?;
        self.iterations += self.outcome.iterations;
        self.evaluations += self.outcome.evaluations;
        self.done += 1;
        let all_known = self.place();
        match &mut self.solver.problem.energy.press {
            Some(press) if !(press.left(self.x) >= LEAST_LEFT) => press.stiffness *= STIFFER,
            _ => self.is_settled = all_known,
        }
        Ok(true)
    }
}

/// The vertices of `x` [m] within `reach` [m] of an obstacle, with the direction away from it in
/// its own frame.
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
