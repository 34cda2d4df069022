//! The reference of a scene: steps and tolerances are refined until the solution converges.

use nalgebra::Point3;

use super::candidates::{Candidate, SolverQuestion};
use super::distance::FrameDistance;
use super::trajectory::Trajectory;
use crate::constraints::SweepOrder;
use crate::scene::{Scene, Solver, Xpbd};
use crate::simulation::{Assets, LoadError};

/// A solution for comparisons.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// The problem that it solves.
    pub question: SolverQuestion,
    /// The finest solver.
    pub candidate: Candidate,
    /// The run of the finest solver.
    pub run: Trajectory,
    /// Uncertainty of the finest level: the distance between the two finest levels, times the
    /// extrapolation factor from the last two distances.
    pub uncertainty: FrameDistance,
    /// Distance of each level from the previous one, as a root mean square [m].
    pub steps: Vec<f64>,
}

impl Reference {
    /// Positions `[frame][vertex]`.
    pub fn frames(&self) -> &[Vec<Point3<f64>>] {
        &self.run.frames
    }
}

/// The levels of refinement: each has half the step and a quarter of the tolerance. For an
/// equilibrium each has a sixteenth of the tolerance, and every second level half the path between
/// poses, which only matters where muscles slide over bones.
fn level(scene: &Scene, question: SolverQuestion, k: u32) -> Solver {
    let tolerance = |ratio: f64| 1e-4 * libm::pow(ratio, f64::from(k));
    match question {
        SolverQuestion::Equilibrium => question.minimised(1 << (k / 2), tolerance(1.0 / 16.0)),
        SolverQuestion::Motion if has_friction(scene) => Solver::Xpbd(Xpbd {
            substeps: scene.solver.substeps().max(16) << (k + 1),
            iterations: 1,
            order: SweepOrder::Coloured,
            tolerance: 0.01,
        }),
        SolverQuestion::Motion => question.minimised(1 << k, tolerance(0.25)),
    }
}

/// The sum of all further differences in units of the last one, if they decrease geometrically. At
/// least one, as for first order; infinite if they do not decrease.
fn to_come(steps: &[f64]) -> f64 {
    match steps {
        [.., before, last] if last < before => (last / (before - last)).max(1.0),
        [.., _, _] => f64::INFINITY,
        _ => 1.0,
    }
}

/// Friction has no energy: only solvers with time steps can refine it.
fn has_friction(scene: &Scene) -> bool {
    scene.effects.contact.is_some_and(|c| c.friction > 0.0)
}

/// Refines until levels differ by at most `tolerance` [m] or `allows` returns false; at least two
/// levels. `watch` receives every frame with its level and time [s], and stops the refinement by
/// returning false.
///
/// # Errors
/// The solver of the reference cannot run the scene.
pub fn refine(
    scene: &Scene,
    assets: &Assets,
    (question, threads): (SolverQuestion, usize),
    mut frames: usize,
    tolerance: f64,
    mut allows: impl FnMut() -> bool,
    watch: &mut dyn FnMut(&Candidate, u32, f64) -> bool,
) -> Result<Option<Reference>, LoadError> {
    let mut found: Option<Reference> = None;
    for k in 0..8 {
        if k >= 2 && !allows() {
            break;
        }
        let candidate = Candidate::new(level(scene, question, k), threads);
        let run = Trajectory::of(scene, assets, &candidate, frames, &mut |_, s| {
            watch(&candidate, k, s)
        })?;
        // The first two levels are compared over their common frames if the time ran out; a later
        // incomplete level is discarded.
        let partial = run.cut_short && !run.stopped && run.frames.len() >= 2 && k < 2;
        if (run.cut_short || run.stopped) && !partial {
            break;
        }
        frames = run.frames.len();
        let (apart, mut steps) = match found.take() {
            Some(before) => (
                FrameDistance::between(before.frames(), &run.frames),
                before.steps,
            ),
            None => (
                FrameDistance {
                    rms: f64::INFINITY,
                    max: f64::INFINITY,
                    frame: 0,
                },
                Vec::new(),
            ),
        };
        if k > 0 {
            steps.push(apart.rms);
        }
        let still = to_come(&steps);
        let uncertainty = FrameDistance {
            rms: apart.rms * still,
            max: apart.max * still,
            ..apart
        };
        found = Some(Reference {
            question,
            candidate,
            run,
            uncertainty,
            steps,
        });
        if (partial && k > 0) || uncertainty.rms <= tolerance {
            break;
        }
    }
    Ok(found.filter(|r| r.uncertainty.rms.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_to_come_is_a_geometric_series() {
        assert_eq!(to_come(&[1.0]), 1.0);
        assert_eq!(to_come(&[1.0, 0.5]), 1.0);
        assert_eq!(to_come(&[1.0, 0.1]), 1.0, "never less than the last step");
        assert!((to_come(&[9.0, 1.0, 0.75]) - 3.0).abs() <= 1e-12);
        assert_eq!(to_come(&[1.0, 1.0]), f64::INFINITY);
        assert_eq!(to_come(&[1.0, f64::NAN]), f64::INFINITY);
    }
}
