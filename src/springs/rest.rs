//! Coming to rest: forces and motion both small, within a limit of steps.

use nalgebra::{Point3, Vector3};

use super::integrators::{Integrator, StepError};
use super::system::{Energy, SpringSystem};
use crate::mesh::measures::{Aabb, max_or_nan};

/// When a system counts as at rest.
///
/// Small moves from step to step are no sign of rest: a steady drift passes any rule on their ratio, and slow decay stops
/// hundreds of steps too early (errata B09). Both force and motion have to be small.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Greatest force without damping on a free point [N].
    pub force: f64,
    /// Kinetic energy [J].
    pub energy: f64,
}

impl Rest {
    /// A share of the force that stretches what holds a point by its own rest length, and the square of that share of the
    /// energy of doing so everywhere.
    ///
    /// What has no length of its own, as springs of rest length 0, is measured by the size of the system.
    pub fn share_of(system: &SpringSystem, share: f64) -> Self {
        let mut sums = vec![0.0; system.len()];
        system
            .forces()
            .iter()
            .for_each(|f| f.add_row_sums(&system.position, &mut sums));
        let size = Aabb::of_points(&system.position).extents().norm();
        let spacing = size / (system.len() as f64).cbrt();
        let stiffest = max_or_nan(sums);
        let force = share * stiffest * spacing;
        Self {
            force,
            energy: share * force * spacing * system.len() as f64,
        }
    }
}

/// What a step left.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepRecord {
    /// Number of the step, from 1.
    pub step: usize,
    /// The step [s].
    pub dt: f64,
    /// Greatest move of a point [m].
    pub greatest_move: f64,
    /// Energies [J].
    pub energy: Energy,
    /// Greatest force without damping on a free point [N].
    pub residual: f64,
}

/// How a run to rest ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// It is at rest.
    Rest,
    /// It is not, after as many steps as were allowed.
    Steps,
    /// The watcher wanted to stop.
    Stopped,
    /// A step failed.
    Failed(StepError),
}

/// A run to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settled {
    /// How it ended.
    pub end: End,
    /// Steps made.
    pub steps: usize,
    /// What the last step left.
    pub last: StepRecord,
}

/// Steps of `dt` [s] until `system` is at rest, at most `steps`; `watch` hears of each and says whether to go on.
pub fn settle(
    system: &mut SpringSystem,
    integrator: &mut dyn Integrator,
    dt: f64,
    rest: Rest,
    steps: usize,
    mut watch: impl FnMut(&SpringSystem, &StepRecord) -> bool,
) -> Settled {
    let step = |system: &mut SpringSystem| integrator.step(system, dt).map(|()| dt);
    settle_by(system, step, rest, steps, &mut watch)
}

/// As [`settle`], by any way to make a step, which tells how long it was [s].
pub fn settle_by(
    system: &mut SpringSystem,
    mut advance: impl FnMut(&mut SpringSystem) -> Result<f64, StepError>,
    rest: Rest,
    steps: usize,
    watch: &mut dyn FnMut(&SpringSystem, &StepRecord) -> bool,
) -> Settled {
    let mut last = record(system, 0, 0.0, &system.position);
    let mut before: Vec<Point3<f64>> = Vec::new();
    // Where it is at rest already nothing has to be done.
    let is_rest = |r: &StepRecord| r.residual <= rest.force && r.energy.kinetic <= rest.energy;
    for step in 0..=steps {
        if is_rest(&last) {
            return Settled {
                end: End::Rest,
                steps: step,
                last,
            };
        }
        if step == steps {
            break;
        }
        before.clone_from(&system.position);
        let dt = match advance(system) {
            Ok(dt) => dt,
            Err(error) => {
                return Settled {
                    end: End::Failed(error),
                    steps: step,
                    last,
                };
            }
        };
        last = record(system, step + 1, dt, &before);
        if !watch(system, &last) {
            return Settled {
                end: End::Stopped,
                steps: step + 1,
                last,
            };
        }
    }
    Settled {
        end: End::Steps,
        steps,
        last,
    }
}

fn record(system: &SpringSystem, step: usize, dt: f64, before: &[Point3<f64>]) -> StepRecord {
    let mut force: Vec<Vector3<f64>> = Vec::new();
    system.static_force(&system.position, &mut force);
    StepRecord {
        step,
        dt,
        greatest_move: max_or_nan(
            system
                .position
                .iter()
                .zip(before)
                .map(|(x, b)| (x - b).norm()),
        ),
        energy: system.energy(),
        residual: max_or_nan(force.iter().map(Vector3::norm)),
    }
}
