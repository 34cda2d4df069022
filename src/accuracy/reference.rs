//! The reference of a scene: steps and tolerances refined until the solution stands still.

use nalgebra::Point3;

use super::candidates::{Candidate, Question};
use super::distance::Distance;
use super::trajectory::Trajectory;
use crate::constraints::Order;
use crate::scene::{Scene, Solver, Xpbd};
use crate::simulation::{Assets, LoadError};

/// A solution that others are compared with.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// What it answers.
    pub question: Question,
    /// Its finest solver.
    pub candidate: Candidate,
    /// The run.
    pub run: Trajectory,
    /// What the finest level may be off: the distance between the two finest, times what the ratio of the last two
    /// distances says is still to come.
    pub uncertainty: Distance,
    /// Distance of each level from the one before it, as a root mean square [m].
    pub steps: Vec<f64>,
}

impl Reference {
    /// Positions `[frame][vertex]`.
    pub fn frames(&self) -> &[Vec<Point3<f64>>] {
        &self.run.frames
    }
}

/// The levels of refinement: each has half the step and a quarter of the tolerance; of an equilibrium a sixteenth of the
/// tolerance, and every second one half the path between poses, which matters only where bones are slid over.
fn level(scene: &Scene, question: Question, k: u32) -> Solver {
    let tolerance = |ratio: f64| 1e-4 * libm::pow(ratio, f64::from(k));
    match question {
        Question::Equilibrium => question.minimised(1 << (k / 2), tolerance(1.0 / 16.0)),
        Question::Motion if has_friction(scene) => Solver::Xpbd(Xpbd {
            substeps: scene.solver.substeps().max(16) << (k + 1),
            iterations: 1,
            order: Order::Coloured,
            tolerance: 0.01,
        }),
        Question::Motion => question.minimised(1 << k, tolerance(0.25)),
    }
}

/// The sum of all further steps, in units of the last one, if they fall as the last two did: a geometric series. At
/// least one, as of first order; without bound where they do not fall.
fn to_come(steps: &[f64]) -> f64 {
    match steps {
        [.., before, last] if last < before => (last / (before - last)).max(1.0),
        [.., _, _] => f64::INFINITY,
        _ => 1.0,
    }
}

/// Friction is no energy: only steps with it can be refined.
fn has_friction(scene: &Scene) -> bool {
    scene.effects.contact.is_some_and(|c| c.friction > 0.0)
}

/// Refines until levels differ by no more than `wanted` [m] or `allows` says that there is no time for another
/// one; at least two levels. `watch` hears of every frame with its level and time [s],
/// and says whether to go on.
///
/// # Errors
/// The scene cannot be run by the reference's solver.
pub fn refine(
    scene: &Scene,
    assets: &Assets,
    (question, threads): (Question, usize),
    mut frames: usize,
    wanted: f64,
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
        // The first two levels, if time ran out in them, are compared as far as they went; a later one is not needed.
        let partial = run.cut_short && !run.stopped && run.frames.len() >= 2 && k < 2;
        if (run.cut_short || run.stopped) && !partial {
            break;
        }
        frames = run.frames.len();
        let (apart, mut steps) = match found.take() {
            Some(before) => (
                Distance::between(before.frames(), &run.frames),
                before.steps,
            ),
            None => (
                Distance {
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
        let uncertainty = Distance {
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
        if (partial && k > 0) || uncertainty.rms <= wanted {
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
