//! Simulation to rest: forces and motion are both small, within a limit of steps.

use nalgebra::{Point3, Vector3};

use super::integrators::{Integrator, StepError};
use super::system::{SpringEnergy, SpringSystem};
use crate::mesh::measures::{Aabb, max_or_nan};
use crate::rest::{self, Relax, all_within, relax};

/// Criterion of rest.
///
/// Small moves from step to step do not prove rest: a steady drift satisfies any rule on their
/// ratio, and slow decay satisfies it hundreds of steps too early (errata B09). Force and motion
/// must both be small.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestSettings {
    /// Greatest force without damping on a free point [N].
    pub force: f64,
    /// Kinetic energy [J].
    pub energy: f64,
}

impl RestSettings {
    /// A criterion relative to the force that stretches the springs of a point by their rest
    /// length, and by the square of `share` relative to the energy of doing so everywhere.
    ///
    /// For springs of rest length 0, the size of the system replaces the rest length.
    pub fn share_of(system: &SpringSystem, share: f64) -> Self {
        let mut sums = vec![0.0; system.len()];
        system
            .forces()
            .iter()
            .for_each(|f| f.add_row_sums(&system.position, &mut sums));
        let size = Aabb::of_points(&system.position).extents().norm();
        Self::of(max_or_nan(sums), size, system.len(), share)
    }

    /// The same for `count` points in a box with this diagonal [m], and the greatest row sum of the stiffness
    /// [N/m].
    pub(crate) fn of(row_sum: f64, size: f64, count: usize, share: f64) -> Self {
        let spacing = size / (count as f64).cbrt();
        let force = share * row_sum * spacing;
        Self {
            force,
            energy: share * force * spacing * count as f64,
        }
    }

    /// Whether a system with these measures is at rest.
    pub fn allows(&self, step: &StepRecord) -> bool {
        all_within([
            (step.residual, self.force),
            (step.energy.kinetic, self.energy),
        ])
    }
}

/// Measures of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepRecord {
    /// Index of the step, from 1.
    pub step: usize,
    /// Length of the step [s].
    pub dt: f64,
    /// Greatest move of a point [m].
    pub greatest_move: f64,
    /// Energies [J].
    pub energy: SpringEnergy,
    /// Greatest force without damping on a free point [N].
    pub residual: f64,
}

impl StepRecord {
    /// The measures of a system after a step of `dt` [s] from the positions `before` [m].
    pub fn of(system: &SpringSystem, step: usize, dt: f64, before: &[Point3<f64>]) -> Self {
        let mut force: Vec<Vector3<f64>> = Vec::new();
        system.static_force(&system.position, &mut force);
        let moves = system.position.iter().zip(before);
        Self {
            step,
            dt,
            greatest_move: max_or_nan(moves.map(|(x, b)| (x - b).norm())),
            energy: system.energy(),
            residual: max_or_nan(force.iter().map(Vector3::norm)),
        }
    }
}

/// End of a run to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RestEnd {
    /// The system is at rest.
    Rest,
    /// The system is not at rest after the greatest number of steps.
    Steps,
    /// The watcher stopped the run.
    Stopped,
    /// A step failed.
    Failed(StepError),
}

/// A run to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settled {
    /// Reason of the end.
    pub end: RestEnd,
    /// Number of steps.
    pub steps: usize,
    /// Measures of the last step.
    pub last: StepRecord,
}

/// Makes steps of `dt` [s] until `system` is at rest, at most `steps`. `watch` receives each record
/// and stops the run by returning false.
pub fn settle(
    system: &mut SpringSystem,
    integrator: &mut dyn Integrator,
    dt: f64,
    rest: RestSettings,
    steps: usize,
    mut watch: impl FnMut(&SpringSystem, &StepRecord) -> bool,
) -> Settled {
    let advance = |system: &mut SpringSystem| integrator.step(system, dt).map(|()| dt);
    let mut settling = Settling::new(system, advance, rest);
    let ended = relax(&mut settling, steps, |now| {
        now.steps == 0 || watch(now.system, &now.last)
    });
    Settled {
        end: match ended {
            Ok(rest::End::Rest) => RestEnd::Rest,
            Ok(rest::End::Stopped) => RestEnd::Stopped,
            Ok(rest::End::Steps | rest::End::Stuck) => RestEnd::Steps,
            Err(error) => RestEnd::Failed(error),
        },
        steps: settling.steps,
        last: settling.last,
    }
}

/// A system that moves towards rest. `A` makes a step and returns its length [s].
struct Settling<'a, A> {
    system: &'a mut SpringSystem,
    advance: A,
    rest: RestSettings,
    steps: usize,
    /// The last step [s].
    dt: f64,
    /// Positions before it [m].
    before: Vec<Point3<f64>>,
    last: StepRecord,
}

impl<'a, A> Settling<'a, A> {
    /// A system before its first step.
    fn new(system: &'a mut SpringSystem, advance: A, rest: RestSettings) -> Self {
        Self {
            advance,
            rest,
            steps: 0,
            dt: 0.0,
            before: system.position.clone(),
            last: StepRecord::default(),
            system,
        }
    }
}

impl<A: FnMut(&mut SpringSystem) -> Result<f64, StepError>> Relax for Settling<'_, A> {
    type Error = StepError;

    fn judge(&mut self) -> Result<bool, StepError> {
        self.last = StepRecord::of(self.system, self.steps, self.dt, &self.before);
        Ok(self.rest.allows(&self.last))
    }

    fn steps(&self) -> usize {
        self.steps
    }

    fn advance(&mut self) -> Result<bool, StepError> {
        self.before.clone_from(&self.system.position);
        self.dt = (self.advance)(self.system)?;
        self.steps += 1;
        Ok(true)
    }
}
